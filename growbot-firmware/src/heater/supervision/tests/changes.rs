//! Tests of the supervision's limits for rises and falls: those that no healthy nozzle shows, and those that it must
//! show.

use super::*;

#[test]
fn an_impossible_fall_is_a_detached_thermistor() {
    let found = |age_s: f32, change: f32| {
        let mut supervision = Supervision { fall_c: 2.5, ..Supervision::default() };
        let _ = supervision.marks.push_back(Checkpoint { fall_c: 0.5, ..mark(age_s, 190.0) });
        supervision.check_rate(&at(190.0 + change))
    };
    // The reading may fall by 2 C, plus the margin of 4 C.
    for age_s in [1.0, 5.0] {
        assert_eq!(found(age_s, -6.0), None);
        assert_eq!(found(age_s, -6.25), Some(Fault::ThermistorDetached));
    }
    for age_s in [0.75, 5.25] {
        assert_eq!(found(age_s, -50.0), None);
    }
}

#[test]
fn an_impossible_rise_is_a_stuck_on_heater() {
    let found = |age_s: f32, unpowered_s: f32, upper: Change, change: f32| {
        let supervision = Supervision { unpowered_s, upper, ..since(age_s, 100.0) };
        supervision.check_rate(&at(100.0 + change))
    };
    let upper = Change { prompt: 5.0, late: 3.0, late_rate: 0.0 };
    for age_s in [3.0, 6.0] {
        assert_eq!(found(age_s, 0.0, upper, 11.0), None);
        assert_eq!(found(age_s, 0.0, upper, 11.25), Some(Fault::HeaterStuckOn));
        // Without any power in the whole time, the limit is lower.
        assert_eq!(found(age_s, age_s, upper, 7.0), None);
        assert_eq!(found(age_s, age_s, upper, 7.25), Some(Fault::HeaterStuckOn));
        assert_eq!(found(age_s, age_s - DT, upper, 7.25), None);
        // A nozzle that should have cooled may have kept its temperature.
        assert_eq!(found(age_s, age_s, by(-8.0), 2.0), None);
        assert_eq!(found(age_s, age_s, by(-8.0), 2.25), Some(Fault::HeaterStuckOn));
    }
    for age_s in [2.75, 6.25] {
        assert_eq!(found(age_s, age_s, upper, 30.0), None);
    }
}

#[test]
fn predicted_over_temperature_is_detected_early() {
    let found = |age_s: f32, reading_c: f32, change: f32| {
        let supervision = Supervision { upper: by(100.0), ..since(age_s, reading_c - change) };
        supervision.check_rate(&at(reading_c))
    };
    for age_s in [2.5, 3.0, 3.5] {
        // The rate is 2 C/s, of which 1.5 C/s are extrapolated by 4 s.
        let change = 2.0 * age_s;
        assert_eq!(found(age_s, 234.0, change), None);
        assert_eq!(found(age_s, 234.25, change), Some(Fault::OverTemperature));
        // A falling reading does not lower the temperature that is compared.
        assert_eq!(found(age_s, 240.0, -1.0), None);
        assert_eq!(found(age_s, 240.25, -1.0), Some(Fault::OverTemperature));
    }
    for age_s in [2.25, 3.75] {
        assert_eq!(found(age_s, 239.0, 2.0 * age_s), None);
    }
}

#[test]
fn a_reading_must_follow_the_lower_model_by_70_percent_and_the_nominal_one_by_40() {
    let found = |lower: f32, nominal: f32, change: f32| {
        let supervision = Supervision { lower: by(lower), nominal: by(nominal), ..since(5.0, 150.0) };
        supervision.check_response(&SupervisionInput { hot: false, ..at(150.0 + change) })
    };
    assert_eq!(found(12.0, 0.0, 0.0), None);
    assert_eq!(found(20.0, 0.0, 14.0), None);
    assert_eq!(found(20.0, 0.0, 13.75), Some(Fault::HeatingTooSlow));
    assert_eq!(found(0.0, 26.0, 0.0), None);
    assert_eq!(found(0.0, 30.0, 12.0), None);
    assert_eq!(found(0.0, 30.0, 11.75), Some(Fault::HeatingTooSlow));
    // The smaller of both changes counts.
    let late = Change { prompt: 40.0, late: 12.0, late_rate: 0.0 };
    let supervision = Supervision { lower: late, ..since(5.0, 150.0) };
    assert_eq!(supervision.check_response(&at(150.0)), None);
}

#[test]
fn the_fault_of_a_missing_rise_depends_on_the_state() {
    let found = |reading_c: f32, hot: bool, moved: bool, still_s: f32| {
        let still = Some(FrozenReading { seconds: still_s, ..still(reading_c) });
        let supervision = Supervision { lower: by(20.0), moved, still, ..since(5.0, reading_c) };
        supervision.check_response(&SupervisionInput { hot, ..at(reading_c) })
    };
    assert_eq!(found(150.0, false, true, 4.25), Some(Fault::ThermistorFrozen));
    assert_eq!(found(150.0, false, true, 4.0), Some(Fault::HeatingTooSlow));
    assert_eq!(found(150.0, false, false, 4.25), Some(Fault::HeatingTooSlow));
    assert_eq!(found(196.75, true, true, 0.0), Some(Fault::TemperatureDrop));
    assert_eq!(found(197.0, true, true, 0.0), Some(Fault::HeaterEnergy));
}

#[test]
fn a_reading_must_follow_a_fall_of_the_nominal_model_by_40_percent() {
    let look =
        |reading_c: f32, hot: bool, measured: bool| SupervisionInput { hot, nozzle: nozzle(measured), ..at(reading_c) };
    // The nozzle cools without power, from 150 C.
    let cools = |fall: f32, unpowered_s: f32, change: f32, hot: bool| {
        let supervision = Supervision { nominal: by(-fall), unpowered_s, ..since(5.0, 150.0) };
        supervision.check_response(&look(150.0 + change, hot, false))
    };
    assert_eq!(cools(26.0, 5.0, 0.0, true), None);
    assert_eq!(cools(30.0, 5.0, -12.0, true), None);
    assert_eq!(cools(30.0, 5.0, -11.75, true), Some(Fault::HeaterStuckOn));
    assert_eq!(cools(30.0, 4.75, -11.75, true), None);
    // A reading that has not risen either may be frozen.
    assert_eq!(cools(30.0, 5.0, 2.0, false), Some(Fault::ThermistorFrozen));
    assert_eq!(cools(30.0, 5.0, 2.25, false), Some(Fault::HeaterStuckOn));
    // The nozzle has little power, and its reading is above the target's band.
    let above = |reading_c: f32, measured: bool| {
        let supervision = Supervision { nominal: by(-30.0), ..since(5.0, reading_c) };
        supervision.check_response(&look(reading_c, true, measured))
    };
    assert_eq!(above(203.0, true), None);
    assert_eq!(above(203.25, true), Some(Fault::HeaterStuckOn));
    assert_eq!(above(203.25, false), None);
    assert_eq!(above(150.0, true), None);
}
