//! The board's clock compared with the host's while a body grows. A board with a wrong clock is stopped. A good board
//! on a bad connection is not.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

use growbot_client::client::Client;
use growbot_client::growth::{CommandQueue, grow_job};
use growbot_client::port::{Port, PortError};
use growbot_core::link::message::{HostSilencePolicy, State};
use growbot_core::path::{Segment, end};
use growbot_core::pose::Pose;
use growbot_core::random::Rng;
use growbot_plan::growth_report::{GrowthReport, Outcome};
use growbot_plan::job::Job;
use growbot_plan::robot_file;
use growbot_sim::port::sim::Sim;

/// A simulated robot whose clock runs `rate` times as fast as its host's, on a connection that delays responses.
struct Skewed {
    sim: Rc<RefCell<Sim>>,
    rate: f64,
    /// Greatest delay of responses, s of the host's time.
    jitter: f64,
    random: Rng,
}

impl Skewed {
    /// Converts a duration from the host's clock to the board's.
    fn on_board(&self, time: Duration) -> Duration {
        time.mul_f64(self.rate)
    }
}

impl Port for Skewed {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        self.sim.send(bytes)?;
        let delay = Duration::from_secs_f64(self.random.uniform_between(0.0, self.jitter));
        self.sim.borrow_mut().run_for(self.on_board(delay));
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        self.sim.receive(buffer, self.on_board(timeout))
    }

    fn now(&self) -> Duration {
        Duration::from_secs_f64(self.sim.borrow().now_s() / self.rate)
    }
}

/// Grows 20 upright layers, which takes six minutes. Returns the report, the state of the board, and the host's time at
/// the end, s.
fn grow(rate: f64, jitter: f64) -> (GrowthReport, State, f64) {
    let robot = robot_file::load("growbot-a".as_ref()).unwrap();
    let path = [Segment::Straight { length: 20.0 * 0.774 }];
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
    let goal = Pose::from_frame(&end(&path, &start.frame()));
    let job = Job::new(&robot, &start, &goal, &path);
    let sim = Rc::new(RefCell::new(Sim::new(robot.clone())));
    let line = Skewed { sim: Rc::clone(&sim), rate, jitter, random: Rng::new(&[1]) };
    let mut client = Client::new(Box::new(line), "a board of its own time");
    let grown = grow_job(&mut client, &job, HostSilencePolicy::Pause, &CommandQueue::default(), &mut |_| {}).unwrap();
    let (state, seconds) = (sim.borrow().state(), sim.borrow().now_s() / rate);
    (grown, state, seconds)
}

#[test]
fn a_board_with_clock_drift_is_stopped() {
    for (rate, way) in [(0.95, "slow"), (1.05, "fast")] {
        for jitter in [0.0, 0.1] {
            let (grown, state, seconds) = grow(rate, jitter);
            let Outcome::ClockDrift(drift) = grown.outcome else { panic!("{rate}, {jitter}: {:?}", grown.outcome) };
            println!("rate {rate}, jitter {jitter} s: stopped after {seconds:.0} s: {drift}");
            assert_eq!(state, State::Stopped, "{rate}, {jitter}");
            assert!(drift.to_string().contains(way) && (1.9..6.0).contains(&drift.percent().abs()), "{drift}");
            // The limit is two windows of half a minute, and the delays.
            assert!(seconds < 90.0, "{rate}, {jitter}: {seconds} s");
        }
    }
}

#[test]
fn link_delays_do_not_stop_a_healthy_board() {
    for rate in [0.995, 1.0, 1.005] {
        for jitter in [0.0, 0.1, 0.4] {
            let (grown, state, _) = grow(rate, jitter);
            assert_eq!((grown.outcome, state, grown.body.len()), (Outcome::Done, State::Done, 20), "{rate}, {jitter}");
        }
    }
}
