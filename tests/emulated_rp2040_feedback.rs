//! The Pico's firmware runs pin by pin in an emulator and grows with feedback, one layer in 0.18 s. It measures
//! filament and gravity at its pins. The corrected layers arrive in time, and the body arrives at its goal.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

use growbot_client::client::Client;
use growbot_client::ground_truth::grow_with_ground_truth;
use growbot_client::growth::{CommandQueue, GrowthOptions, grow_job};
use growbot_client::port::Port;
use growbot_core::link::message::{HostSilencePolicy, State};
use growbot_core::path::{Leg, Segment, end};
use growbot_core::pose::Pose;
use growbot_core::robot::{FilamentMotion, Robot};
use growbot_core::simulation::{Disturbance, ErrorModel};
use growbot_core::tracking::SensorNoise;
use growbot_plan::feedback::Feedback;
use growbot_plan::growth_report::{MeasuredBy, Outcome};
use growbot_plan::job::{Job, JobEvent};
use growbot_plan::robot_file;
use growbot_sim::port::rp2040::Rp2040Emulator;
use growbot_tests::pico_firmware;

/// Max excess of the mean time of a layer over that of the robot's description, as a fraction.
const LATER: f64 = 0.01;

/// Returns robot A2, which lays a layer in 0.18 s, with robot A's sensors.
fn robot() -> Robot {
    let mut description = robot_file::load("growbot-a2".as_ref()).unwrap().description().clone();
    description.sensors.filament_motion = Some(FilamentMotion { mm_per_pulse: 1.25, jam_mm: 8.0 });
    description.sensors.orientation = true;
    Robot::new(description).unwrap()
}

/// Observations while layers are laid.
#[derive(Default)]
struct Seen {
    /// Time at which each layer was reported, by the chip's clock.
    laid: Vec<Duration>,
    /// Min number of layers between the layer in progress and the first layer that an amendment changes. `None`
    /// before the first amendment.
    lead: Option<u32>,
    /// Number of times that the board waited for layers.
    waits: u32,
}

impl Seen {
    fn see(&mut self, event: &JobEvent, now: Duration) {
        match event {
            JobEvent::Laid { .. } => self.laid.push(now),
            JobEvent::Amendment(amendment) => {
                let lead = amendment.from.saturating_sub(self.laid.len() as u32 + 1);
                self.lead = Some(self.lead.map_or(lead, |least| least.min(lead)));
            }
            JobEvent::State(State::Paused) => self.waits += 1,
            _ => {}
        }
    }
}

#[test]
fn corrected_layers_reach_the_pico_in_time() {
    let robot = robot();
    let period_s = robot.description().layer.period_s;
    assert!(period_s <= 0.18);
    let path = [
        Segment::Arc { alpha: 1.0, bend: 0.15, length: 20.0 },
        Segment::Straight { length: 10.0 },
        Segment::Arc { alpha: 4.0, bend: 0.12, length: 18.0 },
    ];
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
    let goal = Pose::from_frame(&end(&path, &start.frame()));
    let legs = [Leg { goal, segment_count: path.len() }];
    let job = Job::new(&robot, &start, &goal, &path);
    let board = Rc::new(RefCell::new(Rp2040Emulator::start(&robot, Some(&pico_firmware("growbot-a2"))).unwrap()));
    let mut client = Client::new(Box::new(Rc::clone(&board)), "the board under test");
    client.open_session().unwrap();
    client.configure(&robot).unwrap();
    // The robot lays 10 % too little, with 10 % noise.
    let noise = SensorNoise { odometry: 0.01, direction: 0.005 };
    let disturbance = Disturbance { growth_bias: -0.1, growth_noise: 0.1, ..Disturbance::default() };
    let imperfection = ErrorModel { disturbance, noise, seed: 11 };
    board.borrow_mut().simulated_tip().disturb(&imperfection);
    board.borrow_mut().simulated_tip().preheat_instantly(190.0);
    let feedback = Some(Feedback::new(&robot, &start, &path, &legs, noise));
    let manner = GrowthOptions { feedback, ..HostSilencePolicy::Pause.into() };
    let mut simulation = board.borrow().tip_handle();
    let mut seen = Seen::default();
    let grow = |on_event: &mut dyn FnMut(&JobEvent)| {
        grow_job(&mut client, &job, manner, &CommandQueue::default(), &mut |event| {
            seen.see(event, board.now());
            on_event(event);
        })
    };
    let grown = grow_with_ground_truth(Some(simulation.as_mut()), &job, &mut |_| (), grow).unwrap();

    assert_eq!((grown.outcome, grown.measured_by), (Outcome::Done, MeasuredBy::Tip));
    let fed_back = grown.feedback.as_ref().unwrap();
    let miss = grown.arrival.normalized_position_error;
    let steps: Vec<f64> = seen.laid.windows(2).map(|two| (two[1] - two[0]).as_secs_f64()).collect();
    let mean = steps.iter().sum::<f64>() / steps.len() as f64;
    let longest = steps.iter().copied().fold(0.0, f64::max);
    println!("{} layers, {} amendments, {miss:.4} off the goal", grown.body.len(), fed_back.amendments);
    println!("a layer in {mean:.4} s, {longest:.3} s at most; {:?} layers of lead, {} waits", seen.lead, seen.waits);
    assert!(miss < 0.02 && fed_back.amendments >= 8 && grown.body.len() > job.layers.len() + 3);
    assert_eq!(seen.waits, 0, "it waited for layers");
    assert!(mean < (1.0 + LATER) * period_s, "{mean} s a layer");
    assert!(seen.lead.is_some_and(|lead| lead >= 1), "{:?} layers of lead", seen.lead);
}
