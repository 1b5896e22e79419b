//! Host and microcontroller plan the same goals to the same bits.
//!
//! The emulated board plans by itself. The hash of its layers in full precision and every byte of them must equal the
//! desktop's. The emulator executes the M4's instructions, so this compares two compilations for two processors.
//!
//! `GROWBOT_BOARD_GOALS=48 cargo test -p growbot-tests --test it bit_identical_plans::` sets the number of random
//! goals, by default 14.

use growbot_client::client::Client;
use growbot_core::job::{job_layers, summarize};
use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::message::{Message, PassiveRequest, PlanRequest, Planned, ReadLayers, StoredLayers};
use growbot_core::path::{Segment, length};
use growbot_core::plan::{Planner, plan};
use growbot_core::pose::Pose;
use growbot_plan::robot_file;
use growbot_sim::port::emulator::Emulator;
use growbot_tests::firmware;

/// Default number of random goals around the start, near and far, in any direction.
const RANDOM_GOALS: u32 = 14;

/// Special goals, at which planes or circles of the planners degenerate: x, y, z in mm, heading and pitch in degrees.
const SPECIAL_GOALS: [[f64; 5]; 12] = [
    [0.0, 0.0, 0.0, 0.0, 90.0],
    [0.0, 0.0, 0.0, 0.0, -90.0],
    [0.0, 0.0, 0.0, 45.0, 0.0],
    [0.0, 0.0, 500.0, 0.0, 90.0],
    [0.0, 0.0, 500.0, 0.0, -90.0],
    [0.0, 0.0, -500.0, 0.0, 90.0],
    [400.0, 0.0, 0.0, 0.0, 0.0],
    [400.0, 0.0, 0.0, 180.0, 0.0],
    [0.0, 300.0, 300.0, 90.0, 45.0],
    [1e-9, 0.0, 500.0, 0.0, 90.0],
    [1e-3, 1e-6, 0.0, 1e-7, 90.0],
    [100.0, 0.0, 100.0, 0.0, 0.0],
];

/// Returns a number in [0, 1) for each n by Weyl's sequence, which is the same on every machine.
fn spread(n: u32, factor: f64) -> f64 {
    let value = f64::from(n + 1) * factor;
    value - value.floor()
}

fn goals(random: u32) -> impl Iterator<Item = [f64; 5]> {
    let random = (0..random).map(|n| {
        let around = |factor: f64| spread(n, factor) - 0.5;
        [
            1200.0 * around(0.754_877_666_246_692_7),
            1200.0 * around(0.569_840_290_998_053_2),
            1200.0 * around(0.430_159_709_001_946_7),
            360.0 * around(0.618_033_988_749_894_9),
            180.0 * around(0.819_172_513_396_164_4),
        ]
    });
    random.chain(SPECIAL_GOALS)
}

/// Number of boards that plan at the same time.
const BOARDS: usize = 2;

/// Numbers of plans, helicoidal arcs and layers that were compared.
#[derive(Debug, Default)]
struct Compared {
    plans: u32,
    helicoids: u32,
    layers: usize,
}

#[test]
fn board_and_desktop_plan_identical_layers() {
    let random = std::env::var("GROWBOT_BOARD_GOALS").map_or(RANDOM_GOALS, |goals| goals.parse().unwrap());
    let goals: Vec<_> = goals(random).collect();
    let compared: Vec<Compared> = std::thread::scope(|scope| {
        let boards: Vec<_> = (0..BOARDS)
            .map(|board| {
                let goals = goals.iter().skip(board).step_by(BOARDS);
                scope.spawn(move || compare(goals))
            })
            .collect();
        boards.into_iter().map(|board| board.join().unwrap()).collect()
    });
    let (plans, helicoids, layers) = compared.iter().fold((0, 0, 0), |(plans, helicoids, layers), compared| {
        (plans + compared.plans, helicoids + compared.helicoids, layers + compared.layers)
    });
    assert_eq!(plans as usize, 2 * goals.len());
    assert!(helicoids > 0);
    println!("{plans} plans, {helicoids} of them helicoidal arcs, {layers} layers: every bit alike");
}

/// Plans these goals with both planners on an emulated board, and compares the results.
fn compare<'a>(goals: impl Iterator<Item = &'a [f64; 5]>) -> Compared {
    let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
    let emulator = Emulator::start(&robot, Some(&firmware("an386"))).unwrap();
    let mut client = Client::new(Box::new(emulator), "the emulated board");
    client.open_session_for(&robot).unwrap();
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();

    let mut compared = Compared::default();
    for (goal, planner) in goals.flat_map(|goal| [(goal, Planner::TwoPlane), (goal, Planner::Shortest)]) {
        let goal = Pose::from_degrees(*goal).unwrap();
        let path = plan(&robot, &start, &goal, 100.0, planner).unwrap().path;
        compared.helicoids += u32::from(path.iter().any(|segment| matches!(segment, Segment::Helicoid { .. })));
        let expected = summarize(&path, &robot);

        let request = PlanRequest { start: (&start).into(), goal: (&goal).into(), radius: 100.0, planner };
        let Message::Planned(planned) = client.request("to plan", &PassiveRequest::Plan(request)).unwrap() else {
            panic!("no plan for {goal:?}");
        };
        let expected_plan = Planned {
            plan_id: expected.plan_id,
            exact_hash: expected.exact_hash,
            layers: expected.layers,
            length: length(&path),
        };
        assert_eq!(planned, expected_plan, "{goal:?}, {planner:?}");

        let mut held: Vec<LayerBytes> = Vec::new();
        while held.len() < expected.layers as usize {
            let read = PassiveRequest::ReadLayers(ReadLayers { first: held.len() as u32 });
            let Message::StoredLayers(StoredLayers { layers, .. }) = client.request("for layers", &read).unwrap()
            else {
                panic!("no layers for {goal:?}");
            };
            assert!(!layers.is_empty(), "{} layers of {} for {goal:?}", held.len(), expected.layers);
            held.extend(layers);
        }
        assert!(held.iter().copied().eq(job_layers(&path, &robot)), "{goal:?}");
        compared.plans += 1;
        compared.layers += held.len();
    }
    compared
}
