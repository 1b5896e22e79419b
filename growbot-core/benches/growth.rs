//! Benchmark of an open-loop growth with noise, in layers a second: `cargo bench -p growbot-core --bench growth`.

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use growbot_core::layer::Layer;
use growbot_core::plan::{Planner, plan};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_core::simulation::{Disturbance, SaggingBody, grow_open_loop};
use growbot_core::slicing::{Slicing, layers};

fn growth(criterion: &mut Criterion) {
    let file = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../robots/growbot-a.toml"));
    let robot = Robot::new(toml::from_str(file).unwrap()).unwrap();
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
    let goal = Pose::from_degrees([200.0, 100.0, 600.0, 0.0, 45.0]).unwrap();
    let path = plan(&robot, &start, &goal, 100.0, Planner::TwoPlane).unwrap().path;
    let plain: Vec<Layer> = layers(&path, &robot, Slicing::Exact).map(|sliced| sliced.layer).collect();

    let mut group = criterion.benchmark_group("growth");
    group.throughput(Throughput::Elements(plain.len() as u64));
    let growth_only = Disturbance { growth_noise: 0.1, ..Disturbance::default() };
    let everything =
        Disturbance { tilt_noise: 0.001, tilt_bias: 0.01, alpha_noise: 0.1, twist_noise: 0.01, ..growth_only };
    for (name, disturbance) in [("growth noise", growth_only), ("every noise", everything)] {
        let mut seed = 0;
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                seed += 1;
                grow_open_loop(&start, black_box(&plain).iter().copied(), &disturbance, seed, |_| ())
            });
        });
    }
    group.bench_function("sliced too", |bencher| {
        bencher.iter(|| {
            let sliced = layers(black_box(&path), &robot, Slicing::Exact).map(|sliced| sliced.layer);
            grow_open_loop(&start, sliced, &growth_only, 1, |_| ())
        });
    });
    group.bench_function("sag", |bencher| {
        bencher.iter(|| {
            let mut hanging = SaggingBody::new(&robot, &start.frame());
            let grown = grow_open_loop(&start, black_box(&plain).iter().copied(), &growth_only, 1, |laid| {
                hanging.add_layer(laid);
            });
            (grown, hanging)
        });
    });
    group.finish();
}

criterion_group! {
    name = all;
    config = Criterion::default().warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(2));
    targets = growth
}
criterion_main!(all);
