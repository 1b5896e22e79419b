//! Measurement of the PID gains of the heater: the relay method of Astrom and Hagglund (Automatica 20, 1984).
//!
//! The power switches between two levels, above and below the power that holds the nozzle at the target. The power is
//! low while the reading is above the target and high while the reading is below it, each by a hysteresis that exceeds
//! the noise. The nozzle's temperature then swings steadily. The ultimate gain of the loop is `Ku = 4 d / (pi sqrt(a^2
//! - h^2))`, with `a` the amplitude of the swings, `d` half the distance of the power levels and `h` the hysteresis.
//! The ultimate period `Tu` is the period of the swings.
//!
//! The gains follow from `Ku` and `Tu` by the rules of Tyreus and Luyben (Ind. Eng. Chem. Res. 31, 1992: `kp = Ku /
//! 2.2`, `Ti = 2.2 Tu`, `Td = Tu / 6.3`). These rules are for a plant that integrates, as a nozzle does in the time of
//! a swing. Their gains are made for disturbances, but a nozzle also heats up at full power and must not pass its
//! target by much. The proportional and the integral gain are therefore half of those by the rules. The derivative gain
//! is that by the rules.
//!
//! `heater::tests::regulating` bounds the constants: on 40 nozzles that differ from their description by up to 30 %,
//! the measured gains keep the nozzle within 1.5 C of its target, with 4 C of overshoot.
//!
//! Supervision stays on, except for the checks that need a regulated nozzle. A swing that takes longer than 90 s ends
//! the tuning with a fault, and so does a tuning that takes longer than twice `heating_timeout_s`. A nozzle whose power
//! per heat capacity differs from its description by about 30 % is reported as a fault, because the description has to
//! be corrected first.

use core::f32::consts::PI;

use growbot_core::link::message::{Gains, Tuned};

use super::model::NozzleModel;

/// Number of swings at the beginning of the tuning that are not measured, because they are not yet steady
/// (docs/decisions/0022-heater-regulation.md).
const FIRST_CYCLES: u32 = 2;
/// Number of swings that are measured (decision 0022).
const CYCLES: u32 = 4;
/// Hysteresis of the relay, counts of the ADC. It equals the largest noise of the trials (`heater::tests::plant`).
const HYSTERESIS_COUNTS: f32 = 1.5;
/// Min hysteresis of the relay, degrees. The derivation of this value is not recorded. `heater::tests::regulating`
/// bounds this value.
const MIN_HYSTERESIS_C: f32 = 0.4;
/// Half the distance of the relay's two power levels, as a share of the distance from their middle to zero or full
/// power. A tenth is left, so that neither level is zero or full power. `heater::tests::regulating` bounds this share.
const SHARE_OF_ROOM: f32 = 0.9;
/// Min of the middle of the relay's two power levels, as a share of the heater's power, so that both levels can differ
/// from the middle. [`MAX_MIDDLE`] is the max.
const MIN_MIDDLE: f32 = 0.05;
const MAX_MIDDLE: f32 = 0.95;
/// Min factor by which one swing may change the middle of the relay's two power levels. [`MAX_STEP`] is the max. The
/// factors are limited because a swing that is not yet steady is a poor measure of the middle.
/// `heater::tests::regulating` bounds them.
const MIN_STEP: f32 = 0.7;
const MAX_STEP: f32 = 1.4;
/// Distance below the target, degrees, up to which the nozzle is heated at full power at the beginning of the tuning.
/// The derivation of this value is not recorded. `heater::tests::regulating` bounds it from below: the nozzle stays 15
/// C above its target at most.
const FULL_POWER_BELOW_C: f32 = 10.0;
/// Min of `a^2 - h^2` as a share of `a^2`, where `a` is the amplitude of the swings and `h` the hysteresis: the square
/// of a fifth. The derivation of this value is not recorded. Without a bound the gains would be infinite if the
/// hysteresis were all of the swing.
const MIN_SWING_SQUARED: f32 = 0.04;
/// Factor between the proportional and integral gains by the rules of Tyreus and Luyben and the gains that are used
/// (decision 0022).
const GAIN_SHARE: f32 = 0.5;

/// State of a tuning, in which the nozzle temperature oscillates around a target.
#[derive(Debug, Clone, Copy)]
pub struct RelayTuner {
    high: bool,
    /// Middle of the two power levels, as a multiple of the holding power that the nozzle's model predicts.
    middle: f32,
    cycles: u32,
    /// Duration of the current swing until now, s.
    length_s: f32,
    /// Time at the high power level in the current swing until now, s.
    on_s: f32,
    /// Lowest reading in the current swing, degrees Celsius. `highest_c` is the highest reading.
    lowest_c: f32,
    highest_c: f32,
    sums: Sums,
}

/// Sums of period, amplitude and power step over the measured swings.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    period_s: f32,
    amplitude_c: f32,
    relay: f32,
}

impl Default for RelayTuner {
    fn default() -> Self {
        Self {
            high: true,
            middle: 1.0,
            cycles: 0,
            length_s: 0.0,
            on_s: 0.0,
            lowest_c: f32::INFINITY,
            highest_c: f32::NEG_INFINITY,
            sums: Sums::default(),
        }
    }
}

impl RelayTuner {
    /// Returns the duration of the current swing until now, s. `None` while the nozzle is still heated up to the
    /// target.
    pub fn swing_s(&self) -> Option<f32> {
        (self.cycles > 0 || !self.high).then_some(self.length_s)
    }

    /// Processes a reading. Returns the duty until the next reading, 0 to 1, or the gains as `Err` once they are found.
    pub fn update(&mut self, target_c: f32, reading_c: f32, seconds: f32, nozzle: &NozzleModel) -> Result<f32, Tuned> {
        let available = nozzle.available_w;
        let need = nozzle.needed_w(target_c) / available;
        let middle = (need * self.middle).clamp(MIN_MIDDLE, MAX_MIDDLE);
        let reach = middle.min(1.0 - middle) * SHARE_OF_ROOM;
        let hysteresis = (HYSTERESIS_COUNTS * nozzle.count_c(target_c)).max(MIN_HYSTERESIS_C);
        self.length_s += seconds;
        if self.high {
            self.on_s += seconds;
        }
        self.lowest_c = self.lowest_c.min(reading_c);
        self.highest_c = self.highest_c.max(reading_c);
        if self.high && reading_c > target_c + hysteresis {
            self.high = false;
            if self.cycles == 0 {
                (self.length_s, self.on_s) = (0.0, 0.0);
            }
        } else if !self.high && reading_c < target_c - hysteresis {
            self.high = true;
            // Heating up to the target is not a swing.
            if self.cycles >= FIRST_CYCLES {
                self.sums.period_s += self.length_s;
                self.sums.amplitude_c += 0.5 * (self.highest_c - self.lowest_c);
                self.sums.relay += reach * available / nozzle.power_w;
            }
            if self.cycles > 0 && self.length_s > 0.0 {
                // If the middle is right, both power levels last equally long.
                let share = self.on_s / self.length_s;
                self.middle *= ((middle + (2.0 * share - 1.0) * reach) / middle).clamp(MIN_STEP, MAX_STEP);
            }
            self.cycles += 1;
            (self.length_s, self.on_s) = (0.0, 0.0);
            (self.lowest_c, self.highest_c) = (reading_c, reading_c);
            if self.cycles == FIRST_CYCLES + CYCLES {
                return Err(self.found(hysteresis));
            }
        }
        // The nozzle gets full power while it is heated up to the target.
        let first = self.cycles == 0 && self.high && reading_c < target_c - FULL_POWER_BELOW_C;
        Ok(if first {
            1.0
        } else if self.high {
            middle + reach
        } else {
            middle - reach
        })
    }

    fn found(&self, hysteresis: f32) -> Tuned {
        let count = CYCLES as f32;
        let (period_s, amplitude_c) = (self.sums.period_s / count, self.sums.amplitude_c / count);
        let min = MIN_SWING_SQUARED * amplitude_c * amplitude_c;
        let swing = libm::sqrtf((amplitude_c * amplitude_c - hysteresis * hysteresis).max(min));
        let ultimate = 4.0 * self.sums.relay / count / (PI * swing);
        let theirs = ultimate / 2.2;
        let kp = GAIN_SHARE * theirs;
        let (ki, kd) = (kp / (2.2 * period_s), theirs * period_s / 6.3);
        Tuned {
            gains: Gains { kp: kp.into(), ki: ki.into(), kd: kd.into() },
            period_s: period_s.into(),
            amplitude_c: amplitude_c.into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::heater::Demand;
    use crate::testing::robot_a;

    #[test]
    fn power_switches_between_two_levels_at_the_hysteresis_edges() {
        let robot = robot_a();
        let nozzle = NozzleModel::new(&Demand { supply_v: Some(12.0), ..Demand::default() }, robot.description());
        let mut relay = RelayTuner::default();
        let duty = |relay: &mut RelayTuner, reading_c| relay.update(200.0, reading_c, 0.25, &nozzle).unwrap();
        // The power is full far below the target, then 0.42 of it, plus or minus nine tenths of that.
        let [high, low] = [0.42 + 0.378, 0.42 - 0.378];
        assert!((duty(&mut relay, 189.5) - 1.0).abs() < 1e-5);
        for reading_c in [190.5, 199.0, 200.39] {
            assert!((duty(&mut relay, reading_c) - high).abs() < 1e-4);
            assert_eq!(relay.swing_s(), None, "the way up is no swing");
        }
        assert!((duty(&mut relay, 200.41) - low).abs() < 1e-4);
        assert_eq!(relay.swing_s(), Some(0.0));
        assert!((duty(&mut relay, 199.61) - low).abs() < 1e-4);
        assert_eq!(relay.swing_s(), Some(0.25));
        assert!((duty(&mut relay, 199.59) - high).abs() < 1e-4);
        assert_eq!((relay.cycles, relay.swing_s()), (1, Some(0.0)));
        duty(&mut relay, 199.7);
        assert_eq!(relay.swing_s(), Some(0.25), "a swing under way with the power high");
        // The power was low for most of the swing, so the middle was too high. It is changed by a factor of 0.7 at
        // most.
        duty(&mut relay, 200.41);
        for _ in 0..20 {
            duty(&mut relay, 200.0);
        }
        let middle = 0.42 * 0.7;
        assert!((duty(&mut relay, 199.59) - 1.9 * middle).abs() > 1e-3, "the levels are those of the swing that ends");
        assert_eq!(relay.cycles, 2);
        assert!((duty(&mut relay, 199.7) - 1.9 * middle).abs() < 1e-4);
    }

    #[test]
    fn power_levels_stay_within_the_available_power() {
        let robot = robot_a();
        let nozzle = NozzleModel::new(&Demand { supply_v: Some(12.0), ..Demand::default() }, robot.description());
        let mut relay = RelayTuner::default();
        // The levels are 33 W of 50 W, plus or minus nine tenths of the remaining 17 W.
        for (reading_c, duty) in [(299.0, 0.66 + 0.306), (301.0, 0.66 - 0.306)] {
            assert!((relay.update(300.0, reading_c, 0.25, &nozzle).unwrap() - duty).abs() < 1e-4);
        }
    }

    /// Runs the relay through one swing, with a number of updates at each level. The reading is at its extremes in the
    /// last update of each level.
    fn swing(
        relay: &mut RelayTuner,
        nozzle: &NozzleModel,
        looks: [u32; 2],
        extremes_c: [f32; 2],
    ) -> Result<f32, Tuned> {
        let mut latest = Ok(0.0);
        for (looks, extreme_c) in looks.into_iter().zip(extremes_c) {
            for look in 1..=looks {
                latest = relay.update(200.0, if look < looks { 200.0 } else { extreme_c }, 0.25, nozzle);
            }
        }
        latest
    }

    #[test]
    fn gains_come_from_the_mean_of_four_swings_after_two() {
        let robot = robot_a();
        let nozzle = NozzleModel::new(&Demand { supply_v: Some(13.2), ..Demand::default() }, robot.description());
        let mut relay = RelayTuner::default();
        // The first two swings are not yet steady.
        for (looks, highest_c) in [(50, 230.0), (90, 210.0)] {
            assert!(swing(&mut relay, &nozzle, [looks; 2], [highest_c, 199.0]).is_ok());
        }
        // Both levels last equally long, so that they do not change: 9, 10, 12 and 13 s, and 1, 1.5, 2 and 2.5 C.
        for (looks, highest_c) in [(18, 201.0), (20, 202.0), (24, 203.0)] {
            assert!(swing(&mut relay, &nozzle, [looks; 2], [highest_c, 199.0]).is_ok());
        }
        let tuned = swing(&mut relay, &nozzle, [26; 2], [204.0, 199.0]).unwrap_err();
        assert_eq!((tuned.period_s, tuned.amplitude_c), (11.0, 1.75));
        // The need is 0.42 of the nominal power at any supply, and the levels are nine tenths of it above and below.
        let ultimate = 4.0 * 0.9 * 0.42 / (core::f64::consts::PI * libm::sqrt(1.75 * 1.75 - 0.4 * 0.4));
        let kp = 0.5 * ultimate / 2.2;
        assert!((tuned.gains.kp / kp - 1.0).abs() < 1e-5, "{}, not {kp}", tuned.gains.kp);
    }

    #[test]
    fn a_swing_of_zero_duration_keeps_the_levels() {
        let robot = robot_a();
        let nozzle = NozzleModel::new(&Demand { supply_v: Some(12.0), ..Demand::default() }, robot.description());
        let mut relay = RelayTuner::default();
        assert!(swing(&mut relay, &nozzle, [10; 2], [201.0, 199.0]).is_ok());
        for reading_c in [201.0, 199.0] {
            assert!(relay.update(200.0, reading_c, 0.0, &nozzle).is_ok());
        }
        let duty = relay.update(200.0, 199.0, 0.25, &nozzle).unwrap();
        assert!((duty - 1.9 * 0.42).abs() < 1e-4, "{duty}");
    }

    #[test]
    fn bias_follows_the_duty_asymmetry_within_limits() {
        let robot = robot_a();
        let nozzle = NozzleModel::new(&Demand { supply_v: Some(12.0), ..Demand::default() }, robot.description());
        // The power is high for 0.6, 0.4, 0.9 and 0.1 of a swing. The middle changes by nine tenths of 0.2, or by the
        // limit.
        for (looks, times) in [([6, 4], 1.18), ([4, 6], 0.82), ([9, 1], 1.4), ([1, 9], 0.7)] {
            let mut relay = RelayTuner::default();
            for looks in [[10, 10], looks] {
                assert!(swing(&mut relay, &nozzle, looks, [201.0, 199.0]).is_ok());
            }
            let middle: f32 = 0.42 * times;
            let high = middle + 0.9 * middle.min(1.0 - middle);
            let duty = relay.update(200.0, 200.0, 0.25, &nozzle).unwrap();
            assert!((duty - high).abs() < 1e-4, "{duty}, not {high}");
        }
    }

    #[test]
    fn gains_follow_tyreus_luyben_with_half_the_proportional_gain() {
        let of = |amplitude_c: f32| {
            let sums = Sums { period_s: 4.0 * 10.0, amplitude_c: 4.0 * amplitude_c, relay: 4.0 * 0.3 };
            RelayTuner { sums, ..RelayTuner::default() }.found(0.5)
        };
        // If noise is all of the swing, a fifth of the amplitude counts.
        for (amplitude_c, swing) in [(2.0, libm::sqrt(3.75)), (0.5, 0.1)] {
            let tuned = of(amplitude_c);
            let ultimate = 4.0 * 0.3 / (core::f64::consts::PI * swing);
            let kp = 0.5 * ultimate / 2.2;
            let right =
                [(tuned.gains.kp, kp), (tuned.gains.ki, kp / 22.0), (tuned.gains.kd, ultimate / 2.2 * 10.0 / 6.3)];
            for (found, expected) in right {
                assert!((found / expected - 1.0).abs() < 1e-5, "{found}, not {expected}");
            }
            assert_eq!((tuned.period_s, tuned.amplitude_c), (10.0, f64::from(amplitude_c)));
        }
    }
}
