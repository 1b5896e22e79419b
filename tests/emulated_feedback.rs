//! The firmware in the emulator grows with feedback. It measures, its job is amended while it grows, and it arrives
//! where a growth without feedback does not.

use growbot_client::client::Client;
use growbot_client::ground_truth::grow_with_ground_truth;
use growbot_client::growth::{CommandQueue, GrowthOptions, grow_job};
use growbot_core::link::message::HostSilencePolicy;
use growbot_core::path::{Leg, Segment, end};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_core::simulation::{Disturbance, ErrorModel};
use growbot_core::tracking::SensorNoise;
use growbot_plan::feedback::Feedback;
use growbot_plan::growth_report::{GrowthReport, MeasuredBy, Outcome};
use growbot_plan::job::{Job, JobEvent};
use growbot_sim::port::emulator::Emulator;
use growbot_tests::firmware;

/// Returns robot A2, which is fast, with robot A's sensors.
fn robot() -> Robot {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../robots/growbot-a2.toml");
    let sensors = "[sensors]\nfilament_motion = { mm_per_pulse = 1.25, jam_mm = 8.0 }\norientation = true\n";
    let text = std::fs::read_to_string(file).unwrap().replace("[sensors]\n", sensors);
    let folder = std::env::temp_dir().join(format!("growbot-feedback-{}.toml", std::process::id()));
    std::fs::write(&folder, text).unwrap();
    let robot = growbot_plan::robot_file::load(&folder).unwrap();
    let _ = std::fs::remove_file(folder);
    robot
}

/// Grows 62 layers on an emulated robot that lays 10 % too little, with 10 % noise.
fn grow(robot: &Robot, with_feedback: bool) -> GrowthReport {
    let path = [
        Segment::Arc { alpha: 1.0, bend: 0.15, length: 20.0 },
        Segment::Straight { length: 10.0 },
        Segment::Arc { alpha: 4.0, bend: 0.12, length: 18.0 },
    ];
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
    let goal = Pose::from_frame(&end(&path, &start.frame()));
    let legs = [Leg { goal, segment_count: path.len() }];
    let job = Job::new(robot, &start, &goal, &path);
    assert!(job.layers.len() >= 60);
    let mut emulator = Emulator::start(robot, Some(&firmware("an386"))).unwrap();
    let noise = SensorNoise { odometry: 0.01, direction: 0.005 };
    let disturbance = Disturbance { growth_bias: -0.1, growth_noise: 0.1, ..Disturbance::default() };
    let imperfection = ErrorModel { disturbance, noise, seed: 11 };
    emulator.simulated_tip(|tip| {
        tip.disturb(&imperfection);
        // A warm nozzle saves the heating time.
        tip.preheat_instantly(190.0);
    });
    let feedback = with_feedback.then(|| Feedback::new(robot, &start, &path, &legs, noise));
    let mut simulation = emulator.tip_handle();
    let mut client = Client::new(Box::new(emulator), "a board under test");
    let manner = GrowthOptions { feedback, ..HostSilencePolicy::Pause.into() };
    let grow =
        |on_event: &mut dyn FnMut(&JobEvent)| grow_job(&mut client, &job, manner, &CommandQueue::default(), on_event);
    grow_with_ground_truth(Some(simulation.as_mut()), &job, &mut |_| (), grow).unwrap()
}

#[test]
fn an_emulated_board_amended_during_growth_reaches_the_goal() {
    let robot = robot();
    let (open, closed) = (grow(&robot, false), grow(&robot, true));
    let miss = |grown: &GrowthReport| {
        assert_eq!((grown.outcome, grown.measured_by), (Outcome::Done, MeasuredBy::Tip));
        grown.arrival.normalized_position_error
    };
    let fed_back = closed.feedback.as_ref().unwrap();
    let estimated = fed_back.estimate.base_from_tip.translation.vector;
    let off = (estimated - closed.arrival.final_pose.position()).norm();
    println!("{:.4} without feedback, {:.4} with; {} amendments", miss(&open), miss(&closed), fed_back.amendments);
    println!("{} layers, estimated to be {off:.3} mm from where it is", closed.body.len());
    assert!(miss(&open) > 0.08 && miss(&closed) < 0.02, "{:?} {:?}", open.arrival, closed.arrival);
    assert!(fed_back.amendments >= 8 && closed.body.len() > open.body.len() + 3);
    assert!(off < 0.8 && (fed_back.estimate.systematic_errors.growth + 0.1).abs() < 0.03, "{off} {fed_back:?}");
}
