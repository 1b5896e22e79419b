//! Tests of the heater's time limits and temperature bands, each from both sides.

use growbot_core::link::message::{Fault, Gains, Tuned};
use growbot_core::robot::RobotDescription;

use crate::heater::autotune::RelayTuner;
use crate::heater::{Demand, HeaterController, HeaterOutput, PERIOD_US, STEADY_BANDS};
use crate::testing::robot_a;
use crate::thermistor::{FULL_SCALE, celsius_from_raw, raw_from_celsius};

const TUNED: Tuned = Tuned { gains: Gains { kp: 0.1, ki: 0.01, kd: 0.2 }, period_s: 10.0, amplitude_c: 1.0 };

fn robot() -> RobotDescription {
    robot_a().description().clone()
}

/// Returns a heater that has taken this reading at the time `now`, us.
fn having_read(celsius: f64, now: u64) -> HeaterController {
    let (mut heater, robot) = (HeaterController::default(), robot());
    heater.update(Some(raw_from_celsius(celsius, &robot.thermistor)), &Demand::default(), &robot, now).unwrap();
    heater
}

#[test]
fn a_reading_is_valid_for_400_ms_even_after_switching_off() {
    let mut heater = having_read(100.0, 1_000_000);
    for _ in 0..2 {
        assert!((heater.temperature(1_400_000).unwrap() - 100.0).abs() < 1e-6);
        assert_eq!(heater.temperature(1_400_001), None);
        heater.switch_off();
    }
    assert_eq!(heater.sensor_fault(), Fault::ThermistorSilent);
    for (raw, fault) in [(f64::from(FULL_SCALE), Fault::ThermistorOpen), (0.0, Fault::ThermistorShort)] {
        let robot = robot();
        assert_eq!(heater.update(Some(raw), &Demand::default(), &robot, 1_100_000), Ok(HeaterOutput::OFF));
        for _ in 0..2 {
            assert_eq!((heater.sensor_fault(), heater.temperature(1_100_000)), (fault, None));
            heater.switch_off();
        }
        heater.switch_on(200.0, 1_100_000);
        assert_eq!(heater.update(Some(raw), &Demand::default(), &robot, 1_200_000), Err(fault));
        heater.switch_off();
    }
}

#[test]
fn a_rested_nozzle_is_proven_in_15_s() {
    let robot = robot();
    let (mut heater, raw) = (HeaterController::default(), raw_from_celsius(25.0, &robot.thermistor));
    let mut now = 0;
    let mut update = |heater: &mut HeaterController| {
        now += PERIOD_US;
        heater.update(Some(raw), &Demand { supply_v: Some(12.0), ..Demand::default() }, &robot, now).unwrap()
    };
    for _ in 0..80 {
        assert_eq!(update(&mut heater), HeaterOutput::OFF);
    }
    heater.switch_on(200.0, 8_000_000);
    let outputs: std::vec::Vec<HeaterOutput> = (0..160).map(|_| update(&mut heater)).collect();
    let heats = outputs.iter().position(|output| output.enable && output.duty > 0.0).unwrap();
    // Each switch is closed for 7 s, from the next whole second on.
    assert!((140..=150).contains(&heats), "{heats} periods");
}

#[test]
fn a_missing_reading_is_a_fault_after_400_ms() {
    let robot = robot();
    let mut heater = HeaterController::default();
    heater.switch_on(200.0, 1_000_000);
    assert_eq!(heater.update(None, &Demand::default(), &robot, 1_400_000), Ok(HeaterOutput::OFF));
    assert_eq!(heater.update(None, &Demand::default(), &robot, 1_400_001), Err(Fault::ThermistorSilent));
}

#[test]
fn a_reading_at_the_max_temperature_is_allowed() {
    let mut robot = robot();
    let raw = raw_from_celsius(239.0, &robot.thermistor);
    robot.heater.max_c = celsius_from_raw(raw, &robot.thermistor).unwrap();
    for on in [false, true] {
        let mut heater = HeaterController::default();
        if on {
            heater.switch_on(200.0, 0);
        }
        assert!(heater.update(Some(raw), &Demand::default(), &robot, 1).is_ok());
        // The resistance falls as the temperature rises.
        assert_eq!(heater.update(Some(raw - 1.0), &Demand::default(), &robot, 2), Err(Fault::OverTemperature));
    }
}

#[test]
fn hot_after_2_s_in_the_band_and_steady_after_10_s_near_or_60_s_in_it() {
    let heater = HeaterController { in_band_since: Some(1_000_000), ..HeaterController::default() };
    assert!(!heater.is_hot(2_999_999) && heater.is_hot(3_000_000));
    assert!(!heater.is_steady(60_999_999) && heater.is_steady(61_000_000));
    let heater = HeaterController { steady_since: Some(1_000_000), ..HeaterController::default() };
    assert!(!heater.is_steady(10_999_999) && heater.is_steady(11_000_000) && !heater.is_hot(11_000_000));
    assert!(!HeaterController::default().is_steady(u64::MAX) && !HeaterController::default().is_hot(u64::MAX));
}

#[test]
fn power_with_an_expired_reading_is_detected() {
    let heater = HeaterController { duty: 0.5, ..having_read(100.0, 1_000_000) };
    assert!(!heater.is_powered_without_reading(1_400_000) && heater.is_powered_without_reading(1_400_001));
    assert!((heater.duty() - 0.5).abs() < 1e-12);
    assert!(!HeaterController { duty: 0.0, ..heater }.is_powered_without_reading(9_000_000));
}

#[test]
fn power_is_dithered_within_two_bands_of_the_target() {
    let robot = robot();
    let raw = raw_from_celsius(150.0, &robot.thermistor);
    let reading_c = celsius_from_raw(raw, &robot.thermistor).unwrap() as f32;
    // The band is 3 C.
    for (off, dithers) in [(5.9, true), (6.0, false), (6.1, false), (-5.9, true), (-6.1, false)] {
        let mut heater = HeaterController { target: Some(f64::from(reading_c + off)), ..HeaterController::default() };
        for now in [1, 1 + PERIOD_US] {
            let demand = Demand { supply_v: Some(12.0), ..Demand::default() };
            heater.update(Some(raw), &demand, &robot, now).unwrap();
        }
        assert_eq!(heater.regulation.dither().phase > 0.0, dithers, "{off}");
    }
}

#[test]
fn the_band_includes_its_edges() {
    const BAND: f32 = 4.0;
    let watch = |heater: &mut HeaterController, error: f32, now: u64| heater.watch_band(error, BAND, 1_000, now);
    let steady = STEADY_BANDS * BAND;
    for side in [1.0, -1.0] {
        let mut heater = HeaterController::default();
        watch(&mut heater, side * steady, 10).unwrap();
        watch(&mut heater, 0.0, 20).unwrap();
        assert_eq!((heater.steady_since, heater.in_band_since), (Some(10), Some(10)));
        watch(&mut heater, side * steady * 1.001, 30).unwrap();
        assert_eq!((heater.steady_since, heater.in_band_since), (None, Some(10)));
        watch(&mut heater, side * BAND, 40).unwrap();
        assert_eq!(heater.in_band_since, Some(10));
        watch(&mut heater, side * 4.25, 50).unwrap();
        assert_eq!(heater.in_band_since, None);
        // Once the nozzle is hot, the band does not judge a dip.
        heater.in_band_since = Some(0);
        watch(&mut heater, side * 4.25, 2_000_000).unwrap();
        assert_eq!(heater.in_band_since, Some(0));
    }
}

#[test]
fn a_heating_timeout_is_a_fault_below_the_target() {
    let watch = |heater: &HeaterController, error: f32, now: u64| heater.clone().watch_band(error, 4.0, 1_000, now);
    let heater = HeaterController { on_since: 500, ..HeaterController::default() };
    assert_eq!(watch(&heater, 50.0, 1_500), Ok(()));
    assert_eq!(watch(&heater, 50.0, 1_501), Err(Fault::HeatingTooSlow));
    // The nozzle may still be cooling to a lower target.
    assert_eq!(watch(&heater, -50.0, 1_501), Ok(()));
    assert_eq!(watch(&heater, 3.0, 1_501), Ok(()));
    let tuning = HeaterController { tuning: Some(RelayTuner::default()), ..heater };
    for error in [50.0, 0.0, -50.0] {
        assert_eq!(watch(&tuning, error, 2_500), Ok(()));
        assert_eq!(watch(&tuning, error, 2_501), Err(Fault::HeatingTooSlow));
    }
}

#[test]
fn a_new_target_restarts_the_timers_and_the_same_one_does_not() {
    let mut heater = HeaterController::default();
    heater.set_target(150.0, 5);
    assert_eq!(heater.target(), None, "it is off");
    heater.switch_on(200.0, 10);
    assert_eq!((heater.target(), heater.on_since), (Some(200.0), 10));
    (heater.in_band_since, heater.steady_since) = (Some(20), Some(20));
    heater.set_target(200.0, 30);
    assert_eq!((heater.on_since, heater.in_band_since, heater.steady_since), (10, Some(20), Some(20)));
    heater.set_target(150.0, 40);
    assert_eq!((heater.target(), heater.on_since), (Some(150.0), 40));
    assert_eq!((heater.in_band_since, heater.steady_since), (None, None));
    heater.tune(210.0, 50);
    heater.set_target(150.0, 60);
    assert_eq!((heater.target(), heater.on_since), (Some(210.0), 50), "it is being tuned");
    heater.switch_off();
    assert_eq!(heater.target(), None);
}

#[test]
fn a_tuning_result_is_kept_until_it_is_taken_once() {
    let mut heater = HeaterController { tuned: Some(TUNED), ..HeaterController::default() };
    heater.switch_off();
    heater.switch_on(200.0, 0);
    assert_eq!(heater.take_tuning_result(), Some(TUNED));
    assert_eq!(heater.take_tuning_result(), None);
    heater.tuned = Some(TUNED);
    heater.tune(200.0, 0);
    assert_eq!(heater.take_tuning_result(), None, "a new search forgets the one before");
}
