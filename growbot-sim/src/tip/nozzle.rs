//! The nozzle: a heated block, and a thermistor that follows the block's temperature.
//!
//! `C dT/dt = P - (K + c Q) (T - T_ambient)` for the block, and `tau dS/dt = T_ambient + share (T - T_ambient) - S` for
//! the thermistor. T and S are the temperatures of block and thermistor, C is the heat capacity of the block, P the
//! heating power, K the heat loss, and Q the flow of the heated filament with the heat capacity c.
//!
//! A copy of a robot may have a [`Cartridge`] instead, whose equations are solved differently. The following applies to
//! a nozzle without a [`Cartridge`].
//!
//! Both equations are solved in closed form while power, loss and flow are constant. The flow is counted in time slots
//! of a tenth of a second. In each slot, the nozzle evenly heats the filament that was fed in the previous slot. The
//! total heat is therefore exact, the result does not depend on the polling interval, and hours without flow are
//! computed in one step.

use growbot_core::robot::{Heater, Robot};

use super::cartridge::{Cartridge, Load};
use super::nozzle_inputs::NozzleInputs;
use super::variation::Variation;

/// Number of time slots per second in which the flow of filament is counted.
const SLOTS_PER_S: u64 = 10;

/// The nozzle and its temperatures.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Nozzle {
    ambient_c: f64,
    heat_capacity: f64,
    /// Heater cartridge. `None` if the heater and the block are simulated as one part.
    cartridge: Option<Cartridge>,
    tick_hz: f64,
    /// Length of a time slot of the filament flow, ticks.
    slot: u64,
    /// Heat that a feed step removes for each degree above the surroundings, J/K.
    heat_of_step: f64,
    /// Tick up to which the nozzle has been simulated.
    tick: u64,
    block: f64,
    sensor: f64,
    peak: f64,
    /// Temperature of the block at the start of the current time slot, degrees Celsius.
    at_slot: f64,
    /// Number of feed steps whose filament is heated in the current slot: the feed steps of the previous slot.
    heated: f64,
    /// Number of feed steps made in the current slot.
    fed: f64,
    decays: Decays,
}

impl Nozzle {
    /// Creates a nozzle at the temperature of its surroundings.
    pub fn new(robot: &Robot, variation: &Variation) -> Self {
        let description = robot.description();
        let Heater { heat_capacity_j_per_k, loss_w_per_k, target_c, .. } = description.heater;
        let heat_capacity = heat_capacity_j_per_k * variation.heat_capacity;
        let loss = loss_w_per_k * variation.loss;
        let cartridge =
            variation.parts.map(|parts| Cartridge::new(parts, heat_capacity, loss, target_c, variation.ambient_c));
        let tick_hz = u64::from(description.motion.tick_hz);
        Self {
            ambient_c: variation.ambient_c,
            heat_capacity,
            cartridge,
            tick_hz: tick_hz as f64,
            slot: (tick_hz / SLOTS_PER_S).max(1),
            heat_of_step: description.filament.heat_j_per_mm3_k * robot.filament_area() / description.feed.steps_per_mm,
            tick: 0,
            block: variation.ambient_c,
            sensor: variation.ambient_c,
            peak: variation.ambient_c,
            at_slot: variation.ambient_c,
            heated: 0.0,
            fed: 0.0,
            decays: Decays::default(),
        }
    }

    /// Returns the tick up to which the nozzle has been simulated.
    pub fn tick(&self) -> u64 {
        self.tick
    }

    /// Returns the temperature of the block, degrees Celsius.
    pub fn block(&self) -> f64 {
        self.block
    }

    /// Returns the temperature of the block at the start of the current tenth of a second, degrees Celsius.
    pub fn at_slot(&self) -> f64 {
        self.at_slot
    }

    /// Returns the temperature of the thermistor, degrees Celsius.
    pub fn sensor(&self) -> f64 {
        self.sensor
    }

    /// Returns the highest temperature that the block has had, degrees Celsius.
    pub fn peak(&self) -> f64 {
        self.peak
    }

    /// Sets block and thermistor to a temperature, degrees Celsius.
    pub fn set(&mut self, celsius: f64) {
        (self.block, self.sensor, self.at_slot) = (celsius, celsius, celsius);
        if let Some(cartridge) = &mut self.cartridge {
            cartridge.set(celsius);
        }
        self.peak = self.peak.max(celsius);
    }

    /// Returns true if this tick is after the end of the current time slot of the filament flow.
    pub fn slot_is_over(&self, tick: u64) -> bool {
        tick / self.slot > self.tick / self.slot
    }

    /// Records a feed step, which brings cold filament.
    pub fn feed(&mut self) {
        self.fed += 1.0;
    }

    /// Advances the simulated time to the tick `until`, with constant inputs.
    pub fn advance(&mut self, until: u64, drive: &NozzleInputs) {
        while self.tick < until {
            let still = self.heated == 0.0 && self.fed == 0.0;
            let next_slot = (self.tick / self.slot + 1) * self.slot;
            let end = if still { (until / self.slot * self.slot).max(next_slot) } else { next_slot };
            let end = end.min(until);
            self.pass((end - self.tick) as f64 / self.tick_hz, drive);
            self.tick = end;
            if end.is_multiple_of(self.slot) {
                self.at_slot = self.block;
                self.heated = std::mem::take(&mut self.fed);
            }
        }
    }

    /// Advances the time, with constant inputs.
    fn pass(&mut self, seconds: f64, drive: &NozzleInputs) {
        let flow = self.heated * self.heat_of_step * self.tick_hz / self.slot as f64;
        if let Some(cartridge) = &mut self.cartridge {
            let load = Load { drive, flow_w_per_k: flow };
            let peak;
            (self.block, self.sensor, peak) = cartridge.pass(seconds, self.block, self.sensor, &load);
            self.peak = self.peak.max(peak);
            return;
        }
        let decay = self.decays.of(seconds, drive, flow, self.heat_capacity);
        let settled = drive.power_w / decay.loss_w_per_k;
        // Temperature above the surroundings and above the steady state of the block.
        let above = self.block - self.ambient_c - settled;
        let sensor = self.sensor - self.ambient_c;
        self.sensor = self.ambient_c
            + drive.share * settled
            + (sensor - drive.share * settled) * decay.sensor
            + drive.share * above * decay.mixed;
        self.block = self.ambient_c + settled + above * decay.block;
        self.peak = self.peak.max(self.block);
    }
}

/// Cache of the most recently used [`Decay`]s. A board that is polled at even intervals uses the same few decays again
/// and again.
#[derive(Debug, Clone, PartialEq, Default)]
struct Decays {
    known: [Option<Decay>; 8],
    /// Index of the entry to replace next.
    next: usize,
}

impl Decays {
    fn of(&mut self, seconds: f64, drive: &NozzleInputs, flow_w_per_k: f64, heat_capacity: f64) -> Decay {
        let mut known = self.known.iter().flatten();
        if let Some(decay) = known.find(|decay| decay.is_of(seconds, drive, flow_w_per_k)) {
            return *decay;
        }
        let decay = Decay::new(seconds, drive, flow_w_per_k, heat_capacity);
        self.known[self.next] = Some(decay);
        self.next = (self.next + 1) % self.known.len();
        decay
    }
}

/// Fractions of the temperature differences that remain after some time.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Decay {
    seconds: f64,
    lag_s: f64,
    drive_loss_w_per_k: f64,
    flow_w_per_k: f64,
    /// Heat loss to the surroundings and to the filament, W/K.
    loss_w_per_k: f64,
    /// Fraction of the block's temperature difference from its steady state that remains. `sensor` is the fraction for
    /// the thermistor.
    block: f64,
    sensor: f64,
    /// Temperature change of the thermistor per degree of the block's initial temperature difference from its steady
    /// state.
    mixed: f64,
}

impl Decay {
    fn new(seconds: f64, drive: &NozzleInputs, flow_w_per_k: f64, heat_capacity: f64) -> Self {
        let loss_w_per_k = (drive.loss_w_per_k + flow_w_per_k).max(f64::MIN_POSITIVE);
        let (of_block, of_sensor) = (loss_w_per_k / heat_capacity, 1.0 / drive.lag_s.max(1e-6));
        let (slow, quick) = (of_block.min(of_sensor), of_block.max(of_sensor));
        // The integral, in a form that does not subtract nearly equal numbers.
        let apart = quick - slow;
        let mixed = libm::exp(-slow * seconds)
            * if apart * seconds > 1e-12 { -libm::expm1(-apart * seconds) / apart } else { seconds };
        Self {
            seconds,
            lag_s: drive.lag_s,
            drive_loss_w_per_k: drive.loss_w_per_k,
            flow_w_per_k,
            loss_w_per_k,
            block: libm::exp(-of_block * seconds),
            sensor: libm::exp(-of_sensor * seconds),
            mixed: mixed * of_sensor,
        }
    }

    /// Reports whether the decay was computed for exactly these conditions, to the last bit.
    fn is_of(&self, seconds: f64, drive: &NozzleInputs, flow_w_per_k: f64) -> bool {
        (self.seconds, self.lag_s, self.drive_loss_w_per_k, self.flow_w_per_k)
            == (seconds, drive.lag_s, drive.loss_w_per_k, flow_w_per_k)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK_HZ: u64 = 4000;

    fn nozzle() -> (Nozzle, Heater) {
        let robot = growbot_plan::robot_file::load("growbot-a".as_ref()).unwrap();
        (Nozzle::new(&robot, &Variation::default()), robot.description().heater)
    }

    fn drive(power_w: f64) -> NozzleInputs {
        NozzleInputs { power_w, loss_w_per_k: 0.12, lag_s: 2.0, share: 1.0 }
    }

    #[test]
    fn temperature_settles_where_losses_balance_power() {
        let (mut nozzle, heater) = nozzle();
        nozzle.advance(100_000 * TICK_HZ, &drive(25.0));
        assert!((nozzle.block() - (22.0 + 25.0 / heater.loss_w_per_k)).abs() < 1e-9);
        assert!((nozzle.sensor() - nozzle.block()).abs() < 1e-9);
        nozzle.advance(200_000 * TICK_HZ, &drive(0.0));
        assert!((nozzle.block() - 22.0).abs() < 1e-9);
        assert!((nozzle.peak() - (22.0 + 25.0 / heater.loss_w_per_k)).abs() < 1e-9);
    }

    #[test]
    fn temperatures_do_not_depend_on_the_sampling() {
        let run = |every: u64| {
            let (mut nozzle, _) = nozzle();
            for tick in 0..60 * TICK_HZ {
                if tick % every == 0 {
                    nozzle.advance(tick, &drive(40.0));
                }
                // A step every 2.5 ms, and none in the third quarter of a minute.
                if tick % 10 == 0 && !(30..45).contains(&(tick / TICK_HZ)) {
                    if nozzle.slot_is_over(tick) {
                        nozzle.advance(tick, &drive(40.0));
                    }
                    nozzle.feed();
                }
            }
            nozzle.advance(60 * TICK_HZ, &drive(40.0));
            (nozzle.block(), nozzle.sensor(), nozzle.at_slot())
        };
        let (block, sensor, at_slot) = run(1);
        for every in [7, 40, 400, 3001, 1_000_000] {
            let (b, s, a) = run(every);
            assert!((b - block).abs() < 1e-8 && (s - sensor).abs() < 1e-8 && (a - at_slot).abs() < 1e-8, "{every}");
        }
    }

    #[test]
    fn the_thermistor_lags() {
        let (mut nozzle, heater) = nozzle();
        nozzle.advance(20 * TICK_HZ, &drive(50.0));
        // After several lags, the thermistor follows a steady rise with a delay of one time constant.
        let rate = (50.0 - 0.12 * (nozzle.block() - 22.0)) / heater.heat_capacity_j_per_k;
        assert!((nozzle.block() - nozzle.sensor() - 2.0 * rate).abs() < 0.3, "{nozzle:?}");
    }

    #[test]
    fn equal_thermistor_and_block_time_constants_are_handled() {
        let (base, heater) = nozzle();
        let tau = heater.heat_capacity_j_per_k / 0.12;
        let after = |lag_s| {
            let mut nozzle = base.clone();
            nozzle.advance(100 * TICK_HZ, &NozzleInputs { lag_s, ..drive(50.0) });
            nozzle.sensor()
        };
        assert!((after(tau) - after(tau * (1.0 + 1e-9))).abs() < 1e-6);
        assert!((after(tau) - after(tau * (1.0 - 1e-9))).abs() < 1e-6);
    }

    #[test]
    fn energy_is_conserved() {
        let (mut nozzle, heater) = nozzle();
        nozzle.set(200.0);
        // 400 feed steps a second for a minute. The heat that is carried away and lost is summed from the temperatures.
        let (mut lost, mut carried) = (0.0, 0.0);
        for slot in 0..600 {
            let heated = nozzle.heated;
            let before = nozzle.block();
            for _ in 0..40 {
                nozzle.feed();
            }
            nozzle.advance((slot + 1) * 400, &drive(45.0));
            let mean = 0.5 * (before + nozzle.block()) - 22.0;
            lost += 0.12 * mean * 0.1;
            carried += heated * nozzle.heat_of_step * mean;
        }
        let stored = heater.heat_capacity_j_per_k * (nozzle.block() - 200.0);
        assert!((45.0 * 60.0 - lost - carried - stored).abs() < 0.01, "{lost} {carried} {stored}");
        assert!(carried > 100.0);
    }
}
