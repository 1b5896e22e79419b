//! Tests of the temperature control's equation, term by term. [`crate::heater::tests`] tests it in closed loop.

use super::*;
use crate::heater::Demand;
use crate::testing::robot_a;
use growbot_core::robot::Robot;

const DT: f32 = 0.25;

/// Returns the model of robot A's nozzle: 50 W, 12 J/K, 0.12 W/K; gains 0.07, 0.004, 0.2. At 200 C it needs 21 W.
fn nozzle(robot: &Robot, measured: bool) -> NozzleModel<'_> {
    let supply_v = measured.then_some(robot.description().supply.nominal_v);
    NozzleModel::new(&Demand { supply_v, ..Demand::default() }, robot.description())
}

fn assert_near(value: f32, expected: f32) {
    assert!((value - expected).abs() < 2e-5, "{value}, not {expected}");
}

#[test]
fn duty_is_the_sum_of_feed_forward_trim_and_pd_terms() {
    let robot = robot_a();
    let nozzle = nozzle(&robot, true);
    let mut regulation = TemperatureControl::default();
    let mut duty = |reading_c| regulation.duty(200.0, reading_c, false, DT, &nozzle);
    assert_near(duty(198.0), (21.0 + 0.07 * 2.0 * 50.0) / 50.0);
    // The trim changes by 0.004 / s for each degree, as a share of a need of 21 W of 50 W.
    let trim = 0.004 * 50.0 / 21.0 * 2.0 * DT;
    let slope = 4.0 * DT / (1.0 + DT);
    assert_near(duty(199.0), (21.0 * (1.0 + trim) + (0.07 - 0.2 * slope) * 50.0) / 50.0);
    // The reading approaches the target by itself, so nothing is learned.
    let slope = slope + (0.0 - slope) * DT / (1.0 + DT);
    assert_near(duty(199.0), (21.0 * (1.0 + trim) + (0.07 - 0.2 * slope) * 50.0) / 50.0);
    assert_near(regulation.trim(), trim);
    assert!(!regulation.saturated());
}

#[test]
fn a_higher_supply_voltage_lowers_the_duty() {
    let robot = robot_a();
    let demand = Demand { supply_v: Some(1.2 * robot.description().supply.nominal_v), ..Demand::default() };
    let nozzle = NozzleModel::new(&demand, robot.description());
    let duty = TemperatureControl::default().duty(200.0, 198.0, false, DT, &nozzle);
    assert_near(duty, (21.0 + 0.07 * 2.0 * 50.0) / 72.0);
}

#[test]
fn zero_elapsed_time_gives_no_slope() {
    let robot = robot_a();
    let nozzle = nozzle(&robot, true);
    let mut regulation = TemperatureControl::default();
    regulation.duty(200.0, 198.0, false, DT, &nozzle);
    let trim = regulation.trim();
    assert_near(regulation.duty(200.0, 199.0, false, 0.0, &nozzle), (21.0 * (1.0 + trim) + 3.5) / 50.0);
    assert_near(regulation.trim(), trim);
}

#[test]
fn trim_is_not_learned_while_approaching_faster_than_0_15_c_per_s() {
    let robot = robot_a();
    let nozzle = nozzle(&robot, true);
    for (slope, learns) in [(0.14, true), (0.16, false), (-0.5, true)] {
        for error in [2.0, -2.0_f32] {
            // From above, the reading approaches by falling.
            let slope_c_per_s = slope * error.signum();
            let reading_c = 200.0 - error;
            let previous_c = Some(reading_c - slope_c_per_s * DT);
            let mut regulation = TemperatureControl { previous_c, slope_c_per_s, ..TemperatureControl::default() };
            regulation.duty(200.0, reading_c, false, DT, &nozzle);
            let learned = regulation.trim().to_bits() != 0.0_f32.to_bits();
            assert_eq!(learned, learns, "{slope} C/s, {error} C off");
        }
    }
}

#[test]
fn a_saturated_duty_is_clamped_and_trim_is_not_learned() {
    let robot = robot_a();
    let nozzle = nozzle(&robot, true);
    for (reading_c, max) in [(150.0, 1.0), (250.0, 0.0)] {
        let mut regulation = TemperatureControl { trim: 0.1, ..TemperatureControl::default() };
        assert_near(regulation.duty(200.0, reading_c, false, DT, &nozzle), max);
        assert!(regulation.saturated());
        assert_near(regulation.trim(), 0.1);
        // The saturation ends as soon as power is available again.
        regulation.slope_c_per_s = 0.0;
        regulation.previous_c = None;
        regulation.duty(200.0, 200.0, false, DT, &nozzle);
        assert!(!regulation.saturated());
    }
}

#[test]
fn trim_is_limited_to_its_authority() {
    let robot = robot_a();
    for (measured, max) in [(true, 0.35), (false, 0.55)] {
        let nozzle = nozzle(&robot, measured);
        for error in [1.0, -1.0] {
            let mut regulation = TemperatureControl::default();
            for _ in 0..1000 {
                regulation.duty(200.0, 200.0 - error, false, DT, &nozzle);
            }
            assert_near(regulation.trim(), max * error);
        }
    }
}

#[test]
fn near_ambient_trim_is_scaled_by_2_percent_of_the_power() {
    let robot = robot_a();
    let nozzle = nozzle(&robot, true);
    let mut regulation = TemperatureControl::default();
    regulation.duty(25.0, 24.0, false, DT, &nozzle);
    assert_near(regulation.trim(), 0.004 * 50.0 * DT);
}

#[test]
fn a_new_target_keeps_the_trim_and_resets_the_dither() {
    let robot = robot_a();
    let nozzle = nozzle(&robot, true);
    let mut regulation = TemperatureControl { trim: 0.1, ..TemperatureControl::default() };
    for reading_c in [100.0, 101.0] {
        regulation.duty(200.0, reading_c, true, DT, &nozzle);
    }
    let before = regulation;
    assert!(before.saturated && before.amplitude_c.is_some() && before.phase > 0.0 && before.slope_c_per_s > 0.0);
    regulation.retarget();
    assert_near(regulation.trim, before.trim);
    assert_near(regulation.slope_c_per_s, before.slope_c_per_s);
    assert_eq!(regulation.previous_c, before.previous_c);
    assert_near(regulation.dither().phase, 0.0);
    assert_eq!((regulation.amplitude_c, regulation.saturated()), (None, false));
}

#[test]
fn the_dither_period_is_16_s() {
    let robot = robot_a();
    let nozzle = nozzle(&robot, true);
    let mut regulation = TemperatureControl::default();
    assert_near(regulation.dither().amplitude_c, 0.35);
    for step in 1..=200_u32 {
        regulation.duty(200.0, 200.0, true, DT, &nozzle);
        assert_near(regulation.dither().phase, (step % 64) as f32 / 64.0);
    }
    // Without the dither its phase is frozen.
    regulation.duty(200.0, 200.0, false, DT, &nozzle);
    assert_near(regulation.dither().phase, 8.0 / 64.0);
}

#[test]
fn the_dither_moves_target_and_power_together() {
    let robot = robot_a();
    let nozzle = nozzle(&robot, true);
    let lag = TAU * 2.0 / 16.0;
    for step in 0..64_u32 {
        let phase = step as f32 / 64.0;
        let mut regulation = TemperatureControl { phase, ..TemperatureControl::default() };
        let duty = regulation.duty(200.0, 200.0, true, DT, &nozzle);
        let (sin, cos) = dither_at((phase + 1.0 / 64.0) % 1.0);
        let in_reading = 0.35 * (sin - lag * cos) / (1.0 + lag * lag);
        let power = 12.0 * 0.35 * TAU / 16.0 * cos;
        assert_near(duty, (21.0 + power + 0.07 * in_reading * 50.0) / 50.0);
    }
}

#[test]
fn dither_amplitude_is_about_one_adc_count_within_bounds() {
    for (pull_up_ohm, bounds) in [(4_700.0, (0.35, 0.35)), (25_000.0, (0.36, 0.69)), (40_000.0, (0.7, 0.7))] {
        let mut description = robot_a().description().clone();
        description.thermistor.pull_up_ohm = pull_up_ohm;
        let nozzle = NozzleModel::new(&Demand::default(), &description);
        let mut regulation = TemperatureControl::default();
        regulation.duty(200.0, 200.0, true, DT, &nozzle);
        let amplitude = regulation.dither().amplitude_c;
        let count = 1.2 * nozzle.count_c(200.0);
        assert!(bounds.0 <= amplitude && amplitude <= bounds.1, "{amplitude} of {count}");
        assert!(amplitude.to_bits() == count.to_bits() || bounds.0.to_bits() == amplitude.to_bits());
    }
}

#[test]
fn dither_sine_and_cosine_match_its_phase() {
    for (phase, sin, cos) in [(0.0, 0.0, 1.0), (0.25, 1.0, 0.0), (0.5, 0.0, -1.0), (0.75, -1.0, 0.0)] {
        let (found_sin, found_cos) = dither_at(phase);
        assert_near(found_sin, sin);
        assert_near(found_cos, cos);
    }
}
