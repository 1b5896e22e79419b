//! A simulated robot with a host on its link. Its tip can fail at any moment.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

use growbot_client::client::{Client, ClientError};
use growbot_client::stop_signal::Permit;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::{LayerBytes, LayerEncoder};
use growbot_core::link::message::{
    AppendLayers, BeginJob, EnergizingRequest, HostSilencePolicy, MAX_LAYERS_PER_MESSAGE, PassiveRequest, Start, State,
    Status,
};
use growbot_core::robot::Robot;
use growbot_sim::port::sim::Sim;
use growbot_sim::tip::Variation;

use growbot_core::random::Rng;

/// Identifier of the job's plan.
const PLAN: u64 = 1;

/// A simulated robot with a host on its link.
pub struct Rig {
    /// The simulated robot.
    pub sim: Rc<RefCell<Sim>>,
    client: Client,
    robot: Robot,
    encoder: LayerEncoder,
    handed_over: u32,
}

impl Rig {
    /// Returns a robot that has just been switched on.
    pub fn new(robot: &Robot, variation: Variation) -> Self {
        let mut sim = Sim::with(robot.clone(), variation);
        sim.poll_late(variation.seed);
        let sim = Rc::new(RefCell::new(sim));
        let client = Client::new(Box::new(Rc::clone(&sim)), "sim");
        Self { sim, client, robot: robot.clone(), encoder: LayerEncoder::default(), handed_over: 0 }
    }

    /// Opens the session.
    ///
    /// # Errors
    /// Returns an error if the board does not respond.
    pub fn connect(&mut self) -> Result<(), ClientError> {
        self.client.open_session_for(&self.robot).map(|_| ())
    }

    /// Begins a job of this many layers.
    ///
    /// # Errors
    /// Returns an error if the board refuses.
    pub fn begin(&mut self, layers: u32) -> Result<(), ClientError> {
        (self.encoder, self.handed_over) = (LayerEncoder::default(), 0);
        let begin = BeginJob { plan_id: PLAN, layers, robot_hash: self.robot.hash() };
        self.client.request("to begin", &PassiveRequest::BeginJob(begin)).map(|_| ())
    }

    /// Sends this many more layers of a bend.
    ///
    /// # Errors
    /// Returns an error if the board refuses.
    pub fn send_layers(&mut self, count: u32) -> Result<(), ClientError> {
        self.hand_over_shares((0..count).map(|_| 1.0))
    }

    /// Sends this many more layers with random heights between half of the max and the max.
    ///
    /// # Errors
    /// Returns an error if the board refuses.
    pub fn hand_over_varied(&mut self, count: u32, random: &mut Rng) -> Result<(), ClientError> {
        self.hand_over_shares((0..count).map(|_| random.uniform_between(0.5, 1.0)))
    }

    /// Sends layers of a bend. `shares` are their heights as fractions of the max height.
    fn hand_over_shares(&mut self, shares: impl Iterator<Item = f64>) -> Result<(), ClientError> {
        let radius = self.robot.description().planning_radius_mm;
        let max_height = 0.97 * self.robot.max_mean_height(1.0 / radius);
        let layer = |share: f64| Layer { alpha: 1.0, height: share * max_height, tilt: share * max_height / radius };
        let layers: Vec<LayerBytes> = shares.map(|share| self.encoder.encode(&layer(share))).collect();
        for batch in layers.chunks(MAX_LAYERS_PER_MESSAGE) {
            let layers =
                AppendLayers { plan_id: PLAN, first: self.handed_over, layers: batch.iter().copied().collect() };
            self.client.request("to store layers", &PassiveRequest::AppendLayers(layers))?;
            self.handed_over += batch.len() as u32;
        }
        Ok(())
    }

    /// Starts the job.
    ///
    /// # Errors
    /// Returns an error if the board refuses.
    pub fn start(&mut self) -> Result<(), ClientError> {
        self.client
            .energize(
                "to start",
                &EnergizingRequest::Start(Start {
                    plan_id: PLAN,
                    on_host_silence: HostSilencePolicy::Continue,
                    is_continuation: false,
                }),
                &Permit::standalone(),
            )
            .map(|_| ())
    }

    /// Returns the board's status.
    ///
    /// # Errors
    /// Returns an error if the board does not respond.
    pub fn status(&mut self) -> Result<Status, ClientError> {
        self.client.status()
    }

    /// Returns the time since the robot was switched on, s.
    pub fn seconds(&self) -> f64 {
        self.sim.borrow().now_s()
    }

    /// Returns the state of the robot's firmware.
    pub fn state(&self) -> State {
        self.sim.borrow().state()
    }

    /// Returns the robot's description.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Returns true if the heater gets power.
    pub fn heats(&self) -> bool {
        let mut sim = self.sim.borrow_mut();
        let tip = sim.simulated_tip();
        tip.heater_is_on() && tip.heater_duty() > 0.0
    }

    /// Returns true if every layer that was sent has been laid.
    pub fn has_laid_all(&self) -> bool {
        self.sim.borrow().controller().layers_laid() == self.handed_over
    }

    /// Lets at most `seconds` pass, until `until` returns true. Returns true if it did.
    pub fn pass(&mut self, seconds: f64, until: impl Fn(&Self) -> bool) -> bool {
        let end = self.seconds() + seconds;
        while self.seconds() < end {
            if until(self) {
                return true;
            }
            let left = Duration::from_secs_f64((end - self.seconds()).clamp(1e-3, 0.1));
            // Events are ignored here.
            let _ = self.client.event(left);
        }
        until(self)
    }
}
