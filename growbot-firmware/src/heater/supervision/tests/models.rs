//! Tests of the supervision's three models and their checkpoints.

use std::vec::Vec;

use super::*;

#[test]
fn three_models_are_updated() {
    // At full power and 125 C the heater gives 50 W, and the nozzle needs 12 W.
    for (measured, min, max) in [(true, 1.0, 1.0), (false, 0.81, 1.21)] {
        let look = SupervisionInput { duty: 1.0, nozzle: nozzle(measured), ..at(125.0) };
        let mut supervision = Supervision::default();
        run(&mut supervision, &look, 8.0);
        let rates = [
            (supervision.lower, (50.0 * 0.88 * min - 12.0 * 1.15) / (12.0 * 1.12)),
            (supervision.upper, (50.0 * 1.12 * max - 12.0 * 0.85) / (12.0 * 0.88)),
            (supervision.nominal, (50.0 * min - 12.0) / 12.0),
        ];
        for (change, rate) in rates {
            assert_near(change.prompt, 8.0 * rate);
            assert_near(change.late_rate, rate * (1.0 - libm::powf(1.0 - DT / 4.0, 32.0)));
            // The late change lags by 4 s of its rate.
            assert_near(change.late, 8.0 * rate - 4.0 * change.late_rate);
            let earlier = by(1.0);
            assert_eq!(change.since(&earlier), CheckBounds { min: change.late - 1.0, max: change.prompt - 1.0 });
        }
        assert_near(supervision.fall_c, 8.0 * 1.6 * 12.0 / 12.0);
        assert_eq!(supervision.unpowered_s, 0.0);
    }
}

#[test]
fn the_lagged_reading_never_overtakes_the_nozzle() {
    let mut change = Change::default();
    change.add(2.0, 10.0);
    assert_eq!((change.prompt, change.late, change.late_rate), (20.0, 0.0, 2.0));
}

#[test]
fn the_model_does_not_fall_below_ambient() {
    let mut supervision = Supervision::default();
    run(&mut supervision, &at(15.0), 5.0);
    assert_eq!(supervision.fall_c, 0.0);
    assert_eq!(supervision.unpowered_s, 5.0);
    supervision.advance_models(&SupervisionInput { duty: 0.01, ..at(15.0) });
    assert_eq!(supervision.unpowered_s, 0.0);
}

#[test]
fn trim_is_learned_near_the_target_without_saturation() {
    let learn = |reading_c: f32, saturated: bool, seconds: f32| {
        let regulated = ControlState { trim: 0.25, saturated, dither: None };
        let mut supervision = Supervision::default();
        run(&mut supervision, &SupervisionInput { regulated: Some(regulated), ..at(reading_c) }, seconds);
        supervision.learned
    };
    for reading_c in [TARGET_C, TARGET_C + 1.75, TARGET_C - 1.75] {
        assert_near(learn(reading_c, false, 30.0), 0.25 * (1.0 - libm::powf(1.0 - DT / 30.0, 120.0)));
    }
    for reading_c in [TARGET_C + 2.0, TARGET_C - 2.0] {
        assert_eq!(learn(reading_c, false, 30.0), 0.0);
    }
    assert_eq!(learn(TARGET_C, true, 30.0), 0.0);
    // The learned trim reduces the effect of each watt. At 1/0.8 of the power that it should need, the nozzle keeps its
    // temperature.
    let look = SupervisionInput { duty: 21.0 / 50.0 * 1.25, regulated: None, ..at(TARGET_C) };
    let mut supervision = Supervision { learned: 0.25, ..Supervision::default() };
    run(&mut supervision, &look, 10.0);
    assert!(supervision.nominal.prompt.abs() < 1e-3);
}

#[test]
fn marks_are_kept_for_25_s() {
    let look = SupervisionInput { duty: 1.0, ..at(125.0) };
    let mut supervision = Supervision { still: Some(still(125.0)), ..Supervision::default() };
    for _ in 0..200 {
        supervision.advance_models(&look);
        if supervision.since_mark_s >= MARK_S {
            supervision.mark(125.0);
        }
    }
    let ages: Vec<f32> = supervision.marks.iter().map(|mark| mark.age_s).collect();
    assert_eq!(ages, (0..25).rev().map(|age| age as f32).collect::<Vec<_>>());
    let rate = (50.0 * 0.88 - 12.0 * 1.15) / (12.0 * 1.12);
    for mark in &supervision.marks {
        assert_near(supervision.lower.since(&mark.lower).max, rate * mark.age_s);
        assert_near(supervision.nominal.since(&mark.nominal).max, 38.0 / 12.0 * mark.age_s);
        assert_near(supervision.upper.since(&mark.upper).max, (56.0 - 10.2) / 10.56 * mark.age_s);
        assert_near(supervision.fall_c - mark.fall_c, 1.6 * mark.age_s);
    }
    let since_still = supervision.nominal.since(&supervision.still.unwrap().nominal).max;
    assert_near(since_still, 38.0 / 12.0 * 50.0);
    for sums in [supervision.lower, supervision.nominal, supervision.upper] {
        assert_eq!((sums.prompt, sums.late), (0.0, 0.0));
    }
    assert_eq!(supervision.fall_c, 0.0);
}

#[test]
fn a_mark_is_added_each_second() {
    let mut supervision = Supervision::default();
    for looks in 1..=12 {
        // The nozzle needs this power there.
        supervision.look(&SupervisionInput { duty: 21.0 / 50.0, ..at(TARGET_C) }).unwrap();
        assert_eq!(supervision.marks.len(), looks / 4);
    }
}
