//! Tests of the supervision's limits for a reading that does not change.

use super::*;

#[test]
fn a_constant_reading_during_an_expected_change_is_frozen() {
    let found = |nominal: f32, moved: bool, hot: bool, measured: bool, unpowered_s: f32| {
        let mut supervision = Supervision {
            nominal: by(nominal),
            still: Some(still(150.0)),
            first_c: Some(150.0),
            moved,
            unpowered_s,
            ..Supervision::default()
        };
        supervision.check_frozen(&SupervisionInput { hot, nozzle: nozzle(measured), ..at(150.0) })
    };
    assert_eq!(found(12.0, true, false, true, 0.0), None);
    assert_eq!(found(12.25, true, false, true, 0.0), Some(Fault::ThermistorFrozen));
    // The reading has never moved, like that of a heater without effect.
    assert_eq!(found(12.25, false, false, true, 0.0), Some(Fault::HeatingTooSlow));
    assert_eq!(found(12.25, false, true, true, 0.0), Some(Fault::ThermistorFrozen));
    assert_eq!(found(-12.0, false, false, true, 0.0), None);
    assert_eq!(found(-12.25, false, false, true, 0.0), Some(Fault::ThermistorFrozen));
    // If the supply is not measured, a fall is certain only without power.
    assert_eq!(found(-12.25, false, false, false, 4.0), None);
    assert_eq!(found(-12.25, false, false, false, 4.25), Some(Fault::ThermistorFrozen));
    assert_eq!(found(12.25, true, false, false, 0.0), Some(Fault::ThermistorFrozen));
}

#[test]
fn the_smaller_expected_change_decides_on_a_frozen_reading() {
    for (prompt, late) in [(20.0, 12.0), (12.0, 20.0), (-20.0, -12.0), (-12.0, -20.0)] {
        let nominal = Change { prompt, late, late_rate: 0.0 };
        let mut supervision = Supervision { nominal, still: Some(still(150.0)), ..Supervision::default() };
        assert_eq!(supervision.check_frozen(&at(150.0)), None);
    }
}

#[test]
fn a_constant_reading_under_dither_is_frozen_after_45_s() {
    let dithered = ControlState { dither: Some(Dither { phase: 0.0, amplitude_c: 0.5 }), ..STEADY };
    let stand = |regulated: Option<ControlState>| {
        let mut supervision = Supervision::default();
        looks_without_fault(400, || supervision.check_frozen(&SupervisionInput { regulated, ..at(TARGET_C) }))
    };
    // The first update does not count as standing still. The next 180 make 45 s.
    assert_eq!(stand(Some(dithered)), (180, Some(Fault::ThermistorFrozen)));
    assert_eq!(stand(Some(ControlState { saturated: true, ..dithered })), (400, None));
    assert_eq!(stand(Some(STEADY)), (400, None));
    assert_eq!(stand(None), (400, None));
    // Any change is enough, however small.
    let mut supervision = Supervision::default();
    for look in 0..1000 {
        let reading_c = if look % 100 == 99 { 1.000_1 } else { 1.0 };
        assert_eq!(supervision.check_frozen(&SupervisionInput { regulated: Some(dithered), ..at(reading_c) }), None);
    }
}

#[test]
fn a_reading_has_moved_if_it_differed_by_more_than_3_c() {
    for (change, moved) in [(3.0, false), (3.25, true), (-3.0, false), (-3.25, true)] {
        let mut supervision = Supervision::default();
        for reading_c in [150.0, 150.0 + change, 150.0] {
            assert_eq!(supervision.check_frozen(&at(reading_c)), None);
        }
        assert_eq!(supervision.moved, moved, "{change}");
        assert_eq!(supervision.still.unwrap().seconds, 0.0);
        supervision.check_frozen(&at(150.0));
        assert_eq!(supervision.still.unwrap().seconds, DT);
    }
}

#[test]
fn a_constant_reading_at_full_power_is_not_reported_as_frozen() {
    let still = Some(FrozenReading { seconds: 4.25, ..still(150.0) });
    for (duty, hot, fault) in [
        (0.99, false, Fault::ThermistorFrozen),
        (1.0, false, Fault::HeatingTooSlow),
        (0.99, true, Fault::ThermistorFrozen),
        (1.0, true, Fault::TemperatureDrop),
    ] {
        let look = SupervisionInput { duty, hot, ..at(150.0) };
        let mut stands = Supervision { nominal: by(12.25), moved: true, still, ..Supervision::default() };
        assert_eq!(stands.check_frozen(&look), Some(fault), "{duty}");
        let follows_not = Supervision { lower: by(20.0), moved: true, still, ..since(5.0, 150.0) };
        assert_eq!(follows_not.check_response(&look), Some(fault), "{duty}");
    }
}
