//! Growths that are interrupted, and growths over unreliable lines. In each case every layer is laid once.
//!
//! - [`crash`]: the host, the cable, the board or its power fails at any moment of a growth, which is then resumed.
//! - [`wire`]: growths over a line with faults.

pub mod crash;
pub mod wire;

use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::time::Duration;

use growbot_client::client::Client;
use growbot_client::growth::{CommandQueue, grow_job};
use growbot_client::port::{Port, PortError};
use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::message::HostSilencePolicy;
use growbot_core::path::{Segment, end};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_plan::growth_report::Outcome;
use growbot_plan::job::{Job, JobEvent};
use growbot_plan::robot_file;
use growbot_sim::port::sim::Sim;

/// Returns robot A with faster homing and growth, so that campaigns do not take long.
///
/// # Panics
/// Never panics, because the description is valid.
pub fn robot() -> Robot {
    let mut description = robot_file::load("growbot-a".as_ref()).expect("it is built in").description().clone();
    description.layer.period_s = 4.0;
    description.head.homing_turns_per_s = 0.2;
    Robot::new(description).expect("the motors are quick enough")
}

/// A body that consists of one bend: its start, its goal and its path.
pub struct Body {
    start: Pose,
    goal: Pose,
    path: [Segment; 1],
}

impl Body {
    /// Returns a bend of this many layers.
    ///
    /// # Panics
    /// Never panics, because its start is a valid pose.
    pub fn of(layers: u32) -> Self {
        let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).expect("upright");
        let length = 0.7 * f64::from(layers);
        // The bend is never more than a fifth of a turn, so any number of layers is a path.
        let path = [Segment::Arc { alpha: 1.0, bend: (length / 120.0).min(1.2), length }];
        let goal = Pose::from_frame(&end(&path, &start.frame()));
        Self { start, goal, path }
    }

    /// Returns the job that grows the body.
    pub fn job<'a>(&'a self, robot: &'a Robot) -> Job<'a> {
        Job::new(robot, &self.start, &self.goal, &self.path)
    }
}

/// A simulated robot that a test shares with its port.
pub type Board = Rc<RefCell<Sim>>;

/// Returns a simulated robot whose controller is polled at irregular times, drawn with this seed.
fn late_board(job: &Job, seed: u64) -> Board {
    let mut sim = Sim::new(job.robot.clone());
    sim.poll_late(seed);
    Rc::new(RefCell::new(sim))
}

/// An undisturbed growth.
pub struct ReferenceGrowth {
    /// The layers as built.
    pub as_built: Vec<Option<LayerBytes>>,
    /// Steps that the simulated feed has made.
    pub feed_steps: u64,
    /// Number of events that the host received: layers, states, and so on.
    pub events: usize,
}

impl ReferenceGrowth {
    /// Grows a job without a disturbance.
    ///
    /// # Panics
    /// Panics if the growth fails.
    pub fn grow(job: &Job) -> Self {
        let board: Board = Rc::new(RefCell::new(Sim::new(job.robot.clone())));
        let mut client = Client::new(Box::new(Rc::clone(&board)), "sim");
        let mut events = 0;
        let count = &mut |_: &JobEvent| events += 1;
        let grown = grow_job(&mut client, job, HostSilencePolicy::Pause, &CommandQueue::default(), count);
        let grown = grown.expect("nothing is in the way");
        assert_eq!((grown.outcome, grown.as_built.len()), (Outcome::Done, job.layers.len()));
        let feed_steps = board.borrow_mut().simulated_tip().feed_steps();
        Self { as_built: grown.as_built, feed_steps, events }
    }
}

/// A port that a test can cut.
pub struct CuttablePort<P> {
    /// Port that is used while it is not cut.
    pub port: P,
    /// True while the port is cut.
    pub cut: Rc<Cell<bool>>,
}

impl<P> CuttablePort<P> {
    fn whole(&mut self) -> Result<&mut P, PortError> {
        if self.cut.get() {
            return Err(PortError::Lost("the line".to_string(), std::io::Error::other("its test cut it")));
        }
        Ok(&mut self.port)
    }
}

impl<P: Port> Port for CuttablePort<P> {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        self.whole()?.send(bytes)
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        self.whole()?.receive(buffer, timeout)
    }

    fn now(&self) -> Duration {
        self.port.now()
    }

    fn has_comparable_clock(&self) -> bool {
        self.port.has_comparable_clock()
    }
}
