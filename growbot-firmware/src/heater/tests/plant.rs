//! Simulation of a nozzle with its thermistor and their possible defects. Its equations differ from the model of the
//! supervision on purpose.

use growbot_core::robot::RobotDescription;

use crate::heater::{Demand, HeaterController, HeaterOutput, PERIOD_US};
use crate::oversampler::Oversampler;
use crate::testing::robot_a;
use crate::thermistor::{FULL_SCALE, raw_from_celsius};
use growbot_core::link::message::Fault;

/// Generator of random numbers from a seed (xorshift).
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        let mut random = Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
        for _ in 0..8 {
            random.next();
        }
        random
    }

    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    pub fn between(&mut self, min: f64, max: f64) -> f64 {
        min + (max - min) * (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Returns one of the choices, at random.
    pub fn of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[(self.next() >> 8) as usize % choices.len()]
    }

    /// Returns a number from an almost normal distribution with deviation 1.
    fn normal(&mut self) -> f64 {
        let bits = self.next();
        let sum: u64 = (0..4).map(|part| bits >> (16 * part) & 0xFFFF).sum();
        (sum as f64 / 65_536.0 - 2.0) * libm::sqrt(3.0)
    }
}

/// Defect of a nozzle, its heater or its thermistor.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Wrong {
    #[default]
    Nothing,
    /// A wire of the thermistor is open.
    Open,
    /// The thermistor's wires touch.
    Short,
    /// The ADC delivers no readings.
    Silent,
    /// The ADC delivers the same number in every conversion.
    Frozen,
    /// The voltage at the thermistor's input stays constant, with noise on it.
    Stuck,
    /// The thermistor is detached. Its excess over the surroundings approaches this share (second value) of the
    /// nozzle's, with this time constant, s (first value).
    Detached(f64, f64),
    /// A wire of the heater is open.
    HeaterOpen,
    /// The power stage gives at least this duty, even if a lower one is requested.
    StuckOn(f64),
    /// The second switch in the heater's supply is always closed.
    Welded,
    /// A draught multiplies the nozzle's loss of heat by this factor.
    Draught(f64),
    /// No filament flows and the fan stands still, in spite of the demand.
    NoFlow,
}

/// Deviations of a nozzle from its description, as factors, and its surroundings.
#[derive(Debug, Clone, Copy)]
pub struct Spread {
    pub capacity: f64,
    pub loss: f64,
    pub power: f64,
    pub supply: f64,
    /// True if the supply voltage is measured.
    pub measured: bool,
    pub ambient_c: f64,
    /// Lag of the thermistor behind the nozzle, s.
    pub lag_s: f64,
    /// Noise of each ADC conversion (standard deviation), counts.
    pub noise: f64,
    /// Pull-up resistor of the thermistor, ohm: 4,700 as described, 25,000 for half a degree a count.
    pub pull_up_ohm: f64,
}

impl Spread {
    /// Draws random deviations of up to `share` to either side. The extremes, which are the hardest cases, are
    /// frequent.
    pub fn of(random: &mut Random, share: f64) -> Self {
        let mut near = |share: f64| {
            let even = random.between(-share, share);
            1.0 + random.of(&[-share, share, even])
        };
        let (capacity, loss, power, supply) = (near(share), near(share), near(share), near(0.1));
        Self {
            capacity,
            loss,
            power,
            supply,
            measured: true,
            ambient_c: random.between(15.0, 35.0),
            lag_s: random.between(1.0, 4.0),
            noise: random.of(&[0.0, 0.0, 0.5, 1.0, 1.5]),
            pull_up_ohm: random.of(&[4700.0, 25_000.0]),
        }
    }
}

/// Simulation of a heater on its nozzle.
pub struct Rig {
    pub robot: RobotDescription,
    pub heater: HeaterController,
    pub spread: Spread,
    pub wrong: Wrong,
    pub random: Random,
    pub flow: f64,
    pub fan: f64,
    pub now: u64,
    pub block_c: f64,
    pub sensor_c: f64,
    pub peak_c: f64,
    /// States of the heater's two switches.
    pub output: HeaterOutput,
    latest: u16,
    conversions: u16,
}

/// Time after which a nozzle that is not hot yet will never get hot, us.
const LONGEST_HEATING_US: u64 = 1_000_000_000;

pub const DT: f64 = PERIOD_US as f64 * 1e-6;

impl Rig {
    pub fn new(spread: Spread, seed: u64) -> Self {
        let mut robot = robot_a().description().clone();
        robot.thermistor.pull_up_ohm = spread.pull_up_ohm;
        Self {
            robot,
            heater: HeaterController::default(),
            spread,
            wrong: Wrong::Nothing,
            random: Random::new(seed),
            flow: 0.0,
            fan: 0.0,
            now: 0,
            block_c: spread.ambient_c,
            sensor_c: spread.ambient_c,
            peak_c: spread.ambient_c,
            output: HeaterOutput::OFF,
            latest: 0,
            conversions: 10,
        }
    }

    /// Advances the simulation by one period of the regulation: first the nozzle at the present duty, then the reading
    /// and the heater's update.
    pub fn step(&mut self) -> Result<(), Fault> {
        let HeaterOutput { duty, enable: closed } = self.output;
        let duty = match self.wrong {
            Wrong::HeaterOpen => 0.0,
            Wrong::StuckOn(min) if closed => duty.max(min),
            Wrong::Welded => duty,
            _ if closed => duty,
            _ => 0.0,
        };
        let Spread { capacity, loss, power, supply, ambient_c, lag_s, .. } = self.spread;
        let draught = if let Wrong::Draught(times) = self.wrong { times } else { 1.0 };
        let warmth = self.block_c - ambient_c;
        let cooled = if self.wrong == Wrong::NoFlow { 0.0 } else { 1.0 };
        let away = self.robot.heater.loss_w_per_k * loss * draught
            + self.robot.fan.loss_w_per_k * self.fan * loss * cooled
            + self.robot.filament.heat_j_per_mm3_k * self.flow * cooled;
        let gain = self.robot.heater.power_w * power * supply * supply * duty;
        self.block_c += (gain - away * warmth) / (self.robot.heater.heat_capacity_j_per_k * capacity) * DT;
        self.peak_c = self.peak_c.max(self.block_c);
        let (towards, tau) = match self.wrong {
            Wrong::Detached(tau, share) => (ambient_c + share * (self.block_c - ambient_c), tau),
            _ => (self.block_c, lag_s),
        };
        if self.wrong != Wrong::Stuck {
            self.sensor_c += (towards - self.sensor_c) * DT / tau;
        }
        self.now += PERIOD_US;
        let supply_v = self.spread.measured.then_some(self.robot.supply.nominal_v * supply);
        let demand = Demand { flow_mm3_per_s: self.flow, fan: self.fan, supply_v };
        let mut sampler = Oversampler::default();
        let exact = raw_from_celsius(self.sensor_c, &self.robot.thermistor);
        for _ in 0..self.conversions {
            let noise = if self.spread.noise > 0.0 { self.spread.noise * self.random.normal() } else { 0.0 };
            let raw = libm::rint(exact + noise).clamp(0.0, f64::from(FULL_SCALE)) as u16;
            match self.wrong {
                Wrong::Silent => {}
                Wrong::Open => sampler.add(FULL_SCALE),
                Wrong::Short => sampler.add(0),
                Wrong::Frozen => sampler.add(self.latest),
                _ => {
                    self.latest = raw;
                    sampler.add(raw);
                }
            }
        }
        let output = self.heater.update(sampler.pop_mean(), &demand, &self.robot, self.now);
        self.output = output.unwrap_or(HeaterOutput::OFF);
        output.map(|_| ())
    }

    /// Advances the simulation until the proof test has ended. Returns the fault if the test finds one.
    pub fn prove(&mut self) -> Result<(), Fault> {
        let begin = self.now;
        while self.heater.proof.is_some() {
            self.step()?;
            assert!(self.now - begin < LONGEST_HEATING_US, "the switches are not proven");
        }
        Ok(())
    }

    pub fn off(&mut self) {
        self.heater.switch_off();
        self.output = HeaterOutput::OFF;
    }

    pub fn on(&mut self, celsius: f64) {
        self.heater.switch_on(celsius, self.now);
    }

    pub fn target(&mut self, celsius: f64) {
        self.heater.set_target(celsius, self.now);
    }

    /// Advances the simulation by some seconds. Returns the first fault.
    pub fn run(&mut self, seconds: f64) -> Result<(), Fault> {
        for _ in 0..(seconds / DT) as u64 {
            self.step()?;
        }
        Ok(())
    }

    /// Advances the simulation until the nozzle is hot. Returns the fault if one occurs before.
    pub fn heat(&mut self) -> Result<(), Fault> {
        let begin = self.now;
        while !self.heater.is_hot(self.now) {
            self.step()?;
            assert!(self.now - begin < LONGEST_HEATING_US, "not hot, and no fault: {} C", self.block_c);
        }
        Ok(())
    }

    /// Heats, grows, waits, cools the nozzle to standby and heats again for some hours, as in a robot's life. Returns
    /// the first fault.
    pub fn live(&mut self, hours: f64) -> Result<(), Fault> {
        let until = self.now + (hours * 3.6e9) as u64;
        let (target, pause) = (self.robot.heater.target_c, self.robot.pause);
        while self.now < until {
            self.on(target);
            self.heat()?;
            // Homing.
            let homing = self.random.between(1.0, 15.0);
            self.run(homing)?;
            for _ in 0..3 {
                let layers = self.random.between(0.0, 15.0) as u32;
                for _ in 0..layers {
                    self.layer(|_| {})?;
                }
                self.fan = self.random.of(&[0.0, self.fan]);
                let held = self.random.between(0.0, pause.standby_after_s);
                self.run(held)?;
                if self.random.of(&[true, false]) {
                    self.run(pause.standby_after_s - held)?;
                    self.target(pause.standby_c);
                    let held = self.random.between(0.0, pause.off_after_s - pause.standby_after_s);
                    self.run(held)?;
                    self.target(target);
                    self.heat()?;
                }
            }
            // The robot is parked or has finished.
            self.off();
            self.fan = 0.0;
            let parked = self.random.between(0.0, 200.0);
            self.run(parked)?;
        }
        Ok(())
    }

    /// Simulates a layer of 18 s, with a flow that varies by 35 % around the turn. Calls `look` after each period.
    pub fn layer(&mut self, mut look: impl FnMut(&Self)) -> Result<(), Fault> {
        let period = self.robot.layer.period_s;
        let steps = (period / DT) as u64;
        self.fan = self.robot.fan.growing_duty;
        for step in 0..steps {
            self.flow = 10.0 * (1.0 + 0.35 * libm::sin(core::f64::consts::TAU * step as f64 / steps as f64));
            self.step()?;
            look(self);
        }
        self.flow = 0.0;
        Ok(())
    }
}
