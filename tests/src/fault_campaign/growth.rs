//! One growth with one fault.

use growbot_client::client::ClientError;
use growbot_core::link::message::{Fault, Motor, State};
use growbot_core::random::Rng;
use growbot_core::robot::Robot;
use growbot_plan::robot_file;
use growbot_sim::tip::{CartridgeParameters, STEINHART_HART_104GT_2, Variation};

use super::cases::{Case, Expected, Onset};
use super::rig::Rig;

/// Number of layers of the job. Half of them are sent at first, and the growth pauses until the others are sent.
const LAYERS: u32 = 6;
/// Time from a fault in a pause until the other layers are sent, s.
const HELD_ON: f64 = 45.0;
/// Max time until the board notices a fault, s.
const PATIENCE: f64 = 900.0;
/// Number of degrees Celsius by which the nozzle may exceed the robot's max temperature.
pub const ALLOWED_ABOVE_MAX: f64 = 5.0;

/// Result of a growth with a fault.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    /// Time from the fault until everything was switched off, s. `None` if the growth continued to its end.
    pub after_s: Option<f64>,
    /// Fault that the board has latched. `None` without one.
    pub fault: Option<Fault>,
    /// State at the end.
    pub state: State,
    /// Highest temperature of the nozzle, including the first minute after the end, degrees Celsius.
    pub peak_c: f64,
    /// True if heater and steppers were off a minute after the end.
    pub off: bool,
}

impl Observation {
    /// Returns the reason why this result is wrong for a case. `None` if it is right.
    pub fn mismatch(&self, case: &Case, robot: &Robot) -> Option<String> {
        let limit = robot.description().heater.max_c + ALLOWED_ABOVE_MAX;
        let as_it_should = match case.expected() {
            Expected::Codes(codes) | Expected::AtNextStart(codes) => {
                self.state == State::Fault && self.fault.is_some_and(|code| codes.contains(&code))
            }
            Expected::CodesOrPause(codes) => {
                self.state == State::Paused
                    || self.state == State::Fault && self.fault.is_some_and(|fault| codes.contains(&fault))
            }
            Expected::EmergencyStop => self.state == State::EmergencyStop,
            Expected::Continues => self.state == State::Done,
            Expected::Refused => self.state == State::Idle && self.fault.is_none(),
            Expected::StaysPaused => self.state == State::Paused,
        };
        if !as_it_should {
            return Some(format!(
                "the growth ended in state {:?} with fault {:?}, but {:?} was expected",
                self.state,
                self.fault,
                case.expected()
            ));
        }
        if !self.off && self.state != State::Paused {
            return Some("the heater or a motor was still on after the fault".to_string());
        }
        (self.peak_c > limit).then(|| format!("the nozzle reached {:.1} C, above the limit of {limit} C", self.peak_c))
    }
}

/// Thermal model of the simulated tips.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Plant {
    /// One heat capacity with a loss in proportion to its temperature, and a thermistor that follows its equation. The
    /// firmware computes with the same model.
    Lump,
    /// A heater cartridge in a block that loses heat by convection and radiation, and a thermistor with a published
    /// table.
    Cartridge,
}

impl Plant {
    /// Both models.
    pub const ALL: [Self; 2] = [Self::Lump, Self::Cartridge];
}

/// Returns the robot of the campaign: robot A with the thermistor of the plant.
///
/// # Panics
/// Never panics, because the robot is built in.
pub fn robot(plant: Plant) -> Robot {
    let robot = robot_file::load("growbot-a".as_ref()).expect("robot A is built in");
    if plant == Plant::Lump {
        return robot;
    }
    let mut description = robot.description().clone();
    (description.thermistor.r25_ohm, description.thermistor.beta_k) = (None, None);
    description.thermistor.steinhart_hart = Some(STEINHART_HART_104GT_2);
    Robot::new(description).expect("so is its thermistor")
}

/// Returns a variation of the robot. Power, heat capacity, loss and supply vary within 10 %, and the room and the
/// sensor vary too. A cartridge has 10 to 30 % of the heat capacity and conducts 1 to 4 W/K. Radiation is 10 to 30 % of
/// the loss.
pub fn sample_variation(plant: Plant, random: &mut Rng, seed: u64) -> Variation {
    let mut within = |min: f64, max: f64| random.uniform_between(min, max);
    let lump = Variation {
        power: within(0.9, 1.1),
        heat_capacity: within(0.9, 1.1),
        loss: within(0.9, 1.1),
        ambient_c: within(15.0, 32.0),
        supply_v: Some(within(10.8, 13.2)),
        sensor_lag_s: within(1.0, 3.0),
        noise_counts: within(0.5, 1.5),
        seed,
        parts: None,
    };
    let mut parts = || CartridgeParameters {
        capacity_share: within(0.1, 0.3),
        coupling_w_per_k: within(1.0, 4.0),
        radiation_share: within(0.1, 0.3),
    };
    Variation { parts: (plant == Plant::Cartridge).then(&mut parts), ..lump }
}

/// Grows with a variation of the robot, and injects a fault.
///
/// # Panics
/// Panics if the growth does not reach the moment of the fault.
pub fn run_case(plant: Plant, case: &Case, seed: u64) -> Observation {
    let mut random = Rng::new(&[seed]);
    let robot = robot(plant);
    let mut rig = Rig::new(&robot, sample_variation(plant, &mut random, seed));
    let at = random.uniform_between(0.0, 1.0);
    if case.onset != Onset::Boot {
        bring_to(&mut rig, &robot, case.onset, at).unwrap_or_else(|error| panic!("{case:?}, seed {seed}: {error}"));
    }
    let onset = rig.seconds();
    rig.sim.borrow_mut().inject(case.fault);
    // An error here means that the growth has ended, so it is ignored.
    let _ = grow_on(&mut rig, case.onset);
    let mut ended = rig.pass(PATIENCE, has_ended);
    if rig.state() == State::Done && matches!(case.expected(), Expected::AtNextStart(_)) {
        let again = begin_anew(&mut rig);
        ended = again.is_ok() && rig.pass(PATIENCE, has_ended);
    }
    let after_s = (ended && rig.state() != State::Done).then(|| rig.seconds() - onset);
    rig.pass(60.0, |_| false);
    let state = rig.state();
    let mut sim = rig.sim.borrow_mut();
    let fault = sim.fault();
    let mut tip = sim.simulated_tip();
    let off = !tip.heater_is_on() && !tip.is_enabled(Motor::Head) && !tip.is_enabled(Motor::Feed);
    Observation { after_s, fault, state, peak_c: tip.nozzle_peak_c(), off }
}

fn has_ended(rig: &Rig) -> bool {
    matches!(rig.state(), State::Fault | State::EmergencyStop | State::Done | State::Parked)
}

/// Brings a growth to the moment of a fault. `at` (0 to 1) is the position of this moment within the growth's phase
/// `onset`.
fn bring_to(rig: &mut Rig, robot: &Robot, onset: Onset, at: f64) -> Result<(), ClientError> {
    rig.connect()?;
    rig.begin(LAYERS)?;
    rig.send_layers(LAYERS / 2)?;
    rig.start()?;
    let period = robot.description().layer.period_s;
    match onset {
        Onset::Boot => {}
        Onset::Heating => {
            rig.pass(PATIENCE, Rig::heats);
            rig.pass(2.0 + 40.0 * at, |_| false);
        }
        Onset::FirstLayer | Onset::MidLayer => {
            rig.pass(PATIENCE, |rig| rig.state() == State::Growing);
            let layer = if onset == Onset::FirstLayer { 0.0 } else { 2.0 };
            rig.pass((layer + 0.02 + 0.9 * at) * period, |_| false);
        }
        Onset::Pause | Onset::Cooling => {
            rig.pass(PATIENCE, |rig| rig.state() == State::Paused);
            let standby = robot.description().pause.standby_after_s;
            rig.pass(if onset == Onset::Pause { 2.0 + 0.8 * standby * at } else { standby + 1.0 + 20.0 * at }, |_| {
                false
            });
        }
    }
    Ok(())
}

/// Begins and starts another growth.
fn begin_anew(rig: &mut Rig) -> Result<(), ClientError> {
    rig.begin(LAYERS)?;
    rig.send_layers(LAYERS)?;
    rig.start()
}

/// Continues the growth after the fault, like a host that has not noticed it.
fn grow_on(rig: &mut Rig, onset: Onset) -> Result<(), ClientError> {
    match onset {
        Onset::Boot => {
            rig.pass(3.0, has_ended);
            rig.connect()?;
            begin_anew(rig)
        }
        Onset::Pause | Onset::Cooling => {
            rig.pass(HELD_ON, has_ended);
            rig.send_layers(LAYERS / 2)
        }
        _ => {
            rig.pass(0.0, has_ended);
            rig.send_layers(LAYERS / 2)
        }
    }
}
