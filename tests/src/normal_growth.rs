//! Growths without faults. No variation of a robot may raise a fault, and the nozzle must keep its temperature.

use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;

use growbot_core::link::message::{Fault, State};

use crate::fault_campaign::growth::{Plant, robot, sample_variation};
use crate::fault_campaign::rig::Rig;
use growbot_core::random::Rng;

/// Interval at which the nozzle is sampled, s.
const LOOK: f64 = 0.1;
/// Layers of a growth. With its pauses it takes about an hour.
const LAYERS: u32 = 180;

/// Observations of one or several growths.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GrowthStats {
    /// Simulated time, s.
    pub seconds: f64,
    /// Layers laid.
    pub layers: u32,
    /// Seed and fault of every growth that a fault ended.
    pub false_alarms: Vec<(u64, Option<Fault>)>,
    /// Largest deviation of the nozzle from its target while layers were laid.
    pub furthest: Furthest,
    /// Max temperature above the target, degrees. The time in which the nozzle cools to standby does not count.
    pub overshoot_c: f64,
}

/// Largest deviation of the nozzle from its target.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Furthest {
    /// Deviation, degrees. It is positive above the target.
    pub above_c: f64,
    /// Seed of the growth.
    pub seed: u64,
    /// Time in the growth, s.
    pub at_s: f64,
    /// Layer in progress.
    pub layer: u32,
}

impl Furthest {
    /// Returns the larger deviation of the two.
    fn or(self, other: Self) -> Self {
        if other.above_c.abs() > self.above_c.abs() { other } else { self }
    }
}

impl GrowthStats {
    fn add(&mut self, other: Self) {
        self.seconds += other.seconds;
        self.layers += other.layers;
        self.false_alarms.extend(other.false_alarms);
        self.furthest = self.furthest.or(other.furthest);
        self.overshoot_c = self.overshoot_c.max(other.overshoot_c);
    }
}

/// Grows with variations of the robot with this plant, on all cores, until this many hours are simulated.
///
/// # Panics
/// Panics if a growth cannot be run.
pub fn run(plant: Plant, hours: f64) -> GrowthStats {
    let (next, sum) = (AtomicU64::new(0), Mutex::new(GrowthStats::default()));
    thread::scope(|scope| {
        for _ in 0..thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                while sum.lock().expect("no growth panics with the sum in hand").seconds < hours * 3600.0 {
                    let one = grow(plant, next.fetch_add(1, Ordering::Relaxed));
                    sum.lock().expect("no growth panics with the sum in hand").add(one);
                }
            });
        }
    });
    sum.into_inner().expect("all growths have ended")
}

/// Runs one growth. Its layers have many heights and are sent in portions, so it pauses between them: hot, at standby,
/// or parked.
fn grow(plant: Plant, seed: u64) -> GrowthStats {
    let mut random = Rng::new(&[seed, 2]);
    let variation = sample_variation(plant, &mut random, seed);
    let mut rig = Rig::new(&robot(plant), variation);
    let mut seen = GrowthStats::default();
    let alarm = |rig: &Rig| matches!(rig.state(), State::Fault | State::EmergencyStop);
    let mut all = || -> Result<(), growbot_client::client::ClientError> {
        rig.connect()?;
        rig.begin(LAYERS)?;
        let mut left = LAYERS;
        while left > 0 {
            let portion = (1.0 + random.uniform_between(0.0, 40.0)) as u32;
            let portion = portion.min(left);
            rig.hand_over_varied(portion, &mut random)?;
            left -= portion;
            rig.start()?;
            watch(&mut rig, seed, 1e5, &mut seen, |rig| alarm(rig) || rig.has_laid_all());
            if alarm(&rig) || rig.state() == State::Done {
                break;
            }
            // Most pauses are short. One in eight is long enough for standby, and one in sixteen for parking.
            let pause = match random.uniform_between(0.0, 16.0) {
                ..1.0 => 300.0..400.0,
                1.0..2.0 => 60.0..200.0,
                _ => 0.0..20.0,
            };
            let Range { start, end } = pause;
            watch(&mut rig, seed, random.uniform_between(start, end), &mut seen, alarm);
            // The supply voltage of a workshop varies.
            rig.sim.borrow_mut().simulated_tip().set_supply_v(random.uniform_between(10.8, 13.2));
        }
        Ok(())
    };
    let ended = all();
    seen.seconds = rig.seconds();
    seen.layers = rig.status().map_or(0, |status| status.layers_laid);
    if rig.state() != State::Done || ended.is_err() {
        seen.false_alarms.push((seed, rig.sim.borrow().fault()));
    }
    seen
}

/// Lets time pass and samples the nozzle.
fn watch(rig: &mut Rig, seed: u64, seconds: f64, seen: &mut GrowthStats, until: impl Fn(&Rig) -> bool) {
    let end = rig.seconds() + seconds;
    let mut cooling = false;
    let target_c = rig.robot().description().heater.target_c;
    while rig.seconds() < end && !until(rig) {
        rig.pass(LOOK, |_| false);
        let mut sim = rig.sim.borrow_mut();
        let Some(target) = sim.controller().target_c() else { continue };
        let above = sim.simulated_tip().nozzle_c() - target;
        let layer = sim.controller().layers_laid();
        drop(sim);
        if rig.state() == State::Growing {
            seen.furthest = seen.furthest.or(Furthest { above_c: above, seed, at_s: rig.seconds(), layer });
        }
        // While it cools to standby, the nozzle is above the target until it has reached it once.
        cooling = target < target_c && (cooling || above > 10.0) && above > 0.0;
        if !cooling {
            seen.overshoot_c = seen.overshoot_c.max(above);
        }
    }
}
