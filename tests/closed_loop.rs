//! Closed loop against open loop with the same seeds: robot A over 4, 8, 16 and 32 radii, with noisy growth and noisy
//! sensors.
//!
//! `GROWBOT_LOOPS=1000 cargo test --release -p growbot-tests --test it closed_loop:: -- --nocapture` grows a thousand
//! bodies of each kind.

use growbot_core::path::{Leg, length};
use growbot_core::plan::{Planner, plan};
use growbot_core::pose::Pose;
use growbot_core::random::Rng;
use growbot_core::robot::Robot;
use growbot_core::simulation::{
    DirectionSensor, Disturbance, GrowthTask, SimulatedSensors, grow_closed_loop, grow_open_loop,
};
use growbot_core::slicing::{LIMIT_SLACK, Slicing, layers};
use growbot_core::tracking::SensorNoise;
use growbot_plan::arrival::Arrival;
use growbot_plan::parallel;
use growbot_plan::robot_file;
use nalgebra::Vector3;

/// Default number of bodies for each distance and each bias.
const LOOPS: u64 = 25;
/// Distances from start to goal, radii.
const DISTANCES: [u32; 4] = [4, 8, 16, 32];
/// Max error of a layer's growth, as a fraction of it.
const NOISE: f64 = 0.1;
/// Standard deviation of the odometry's noise, as a fraction of a layer.
const ODOMETRY: f64 = 0.01;
/// Standard deviation of the noise of the measured direction, degrees per axis.
const DIRECTION: f64 = 0.5;

/// Returns a pose at a position with a random direction.
fn pose(position: Vector3<f64>, random: &mut Rng) -> Pose {
    let direction = random.direction();
    Pose::new(position, libm::atan2(direction.y, direction.x), libm::asin(direction.z)).unwrap()
}

/// Returns the arrival of one body in open loop, and that of a body with the same seed in closed loop.
fn pair(robot: &Robot, distance: u32, disturbance: &Disturbance, seed: u64) -> [Arrival; 2] {
    let mut random = Rng::new(&[u64::from(distance), seed]);
    let radius = robot.description().planning_radius_mm;
    let start = pose(Vector3::zeros(), &mut random);
    let place = random.direction() * f64::from(distance) * radius;
    let goal = pose(place, &mut random);
    let path = plan(robot, &start, &goal, radius, Planner::Shortest).unwrap().path;
    let sensors = SimulatedSensors {
        noise: SensorNoise { odometry: ODOMETRY, direction: DIRECTION.to_radians() },
        odometry_scale: 0.0,
        direction: DirectionSensor::Tip,
    };
    let planned = layers(&path, robot, Slicing::Exact).map(|sliced| sliced.layer);
    let open = grow_open_loop(&start, planned, disturbance, seed, |_| {});
    let legs = [Leg { goal, segment_count: path.len() }];
    let task = GrowthTask { robot, start, path: &path, legs: &legs };
    let closed = grow_closed_loop(&task, disturbance, &sensors, seed, |layer, _, base_from_tip| {
        if let Err(error) = robot.check_layer(layer, LIMIT_SLACK) {
            panic!("{}, {distance} R, seed {seed}: {error}", robot.name());
        }
        *base_from_tip
    });
    [open, closed].map(|grown| Arrival::of(&grown.base_from_tip, &goal, length(&path)))
}

/// Returns the arrivals in open and in closed loop of `loops` bodies at this distance (radii) and with this bias of
/// growth.
fn pairs(robot: &Robot, distance: u32, bias: f64, loops: u64) -> Vec<[Arrival; 2]> {
    let disturbance = Disturbance { growth_noise: NOISE, growth_bias: bias, ..Disturbance::default() };
    let seeds: Vec<u64> = (0..loops).collect();
    parallel::map(&seeds, |&seed| pair(robot, distance, &disturbance, seed), |_| {})
}

/// Returns the mean, the 95th percentile and the max of some values.
fn figures(values: impl Iterator<Item = f64>) -> [f64; 3] {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    [mean, values[(values.len() * 95).div_ceil(100) - 1], values[values.len() - 1]]
}

#[test]
fn closed_loops_reach_goals_that_open_loops_miss() {
    let loops = std::env::var("GROWBOT_LOOPS").map_or(LOOPS, |loops| loops.parse().unwrap());
    let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
    println!("{loops} bodies of each kind; position errors over the path's length: mean, 95th percentile, max");
    println!("{:>6} {:>6}  {:^28}  {:^28}  {:>14}", "bias", "R", "open loop", "closed loop", "direction, deg");
    // Limits of the mean position error and the mean direction error.
    for (bias, position, direction) in [(0.0, 0.0007, 0.5), (0.05, 0.002, 0.5), (-0.05, 0.002, 0.5)] {
        for distance in DISTANCES {
            let pairs = pairs(&robot, distance, bias, loops);
            let of = |which: usize| figures(pairs.iter().map(|pair| pair[which].normalized_position_error));
            let (open, closed) = (of(0), of(1));
            let [angle, _, max] = figures(pairs.iter().map(|pair| pair[1].direction_error_deg));
            let three = |[mean, p95, max]: [f64; 3]| format!("{mean:.6} {p95:.6} {max:.6}");
            println!("{:>5} % {distance:>5}  {}  {}  {angle:.3} {max:.3}", 100.0 * bias, three(open), three(closed));
            assert!(closed[0] <= position && angle <= direction, "{distance} R: {} and {angle} deg", closed[0]);
            assert!(closed[0] < open[0] && closed[1] < open[1], "{distance} R: {closed:?} and {open:?} in open loop");
        }
    }
}

#[test]
fn no_commanded_layer_exceeds_the_limits() {
    let everything = Disturbance {
        growth_noise: 0.2,
        growth_bias: 0.1,
        tilt_noise: 1e-3,
        tilt_bias: -0.1,
        alpha_noise: 0.1,
        alpha_bias: 0.05,
        twist_noise: 1e-3,
        twist_bias: 1e-3,
    };
    let less = Disturbance { growth_bias: -0.1, tilt_bias: 0.1, ..everything };
    for name in robot_file::names() {
        let robot = robot_file::load(name.as_ref()).unwrap();
        let (mut open, mut closed) = (0.0, 0.0);
        for (disturbance, seed) in
            [everything, less].iter().zip(0..).flat_map(|(one, seed)| [(one, seed), (one, seed + 2)])
        {
            // The growth panics at the first such layer.
            let [one, other] = pair(&robot, 8, disturbance, seed);
            (open, closed) =
                (open + one.normalized_position_error / 4.0, closed + other.normalized_position_error / 4.0);
        }
        println!("{name:<12} {open:.5} in open loop, {closed:.5} in closed loop");
        assert!(closed < open, "{name}");
    }
}
