//! Each limit of the supervision, from both sides, in numbers that single precision has exactly.

use std::boxed::Box;
use std::sync::LazyLock;
use std::vec::Vec;

use super::*;
use crate::heater::Demand;
use crate::testing::robot_a;

/// Between two looks, s.
const DT: f32 = 0.25;
const TARGET_C: f32 = 200.0;

/// The nozzle of robot A: 50 W, 12 J/K, 0.12 W/K, a band of 3 C, 240 C at most.
fn nozzle(measured: bool) -> &'static Nozzle<'static> {
    static MEASURED_OR_NOT: LazyLock<[Nozzle; 2]> = LazyLock::new(|| {
        let robot = Box::leak(Box::new(robot_a()));
        let supplies = [Some(robot.description().supply.nominal_v), None];
        supplies.map(|supply_v| Nozzle::new(&Demand { supply_v, ..Demand::default() }, robot.description()))
    });
    let [known, unknown] = &*MEASURED_OR_NOT;
    if measured { known } else { unknown }
}

const STEADY: Regulated = Regulated { trim: 0.0, saturated: false, wiggle: None };

/// A look at a hot nozzle at its target, without power.
fn at(reading_c: f32) -> Look<'static> {
    let nozzle = nozzle(true);
    Look { reading_c, target_c: TARGET_C, duty: 0.0, seconds: DT, hot: true, regulated: Some(STEADY), nozzle }
}

/// A nozzle and a reading that change by so much.
const fn by(change: f32) -> Reckoned {
    Reckoned { prompt: change, late: change, late_rate: 0.0 }
}

/// A moment so long ago, from which all is reckoned.
fn mark(age_s: f32, reading_c: f32) -> Mark {
    Mark { age_s, reading_c, sure: by(0.0), likely: by(0.0), most: by(0.0), fall_c: 0.0 }
}

/// A supervision that looks back at this moment only.
fn since(age_s: f32, reading_c: f32) -> Supervision {
    let mut supervision = Supervision::default();
    let _ = supervision.marks.push_back(mark(age_s, reading_c));
    supervision
}

/// For how many looks in a row nothing is found.
fn looks_in_peace(most: u32, mut look: impl FnMut() -> Option<Fault>) -> (u32, Option<Fault>) {
    for looks in 0..most {
        if let Some(fault) = look() {
            return (looks, Some(fault));
        }
    }
    (most, None)
}

/// Reckons on for so long at this duty.
fn reckon(supervision: &mut Supervision, look: &Look, seconds: f32) {
    for _ in 0..(seconds / DT) as u32 {
        supervision.reckon(look);
    }
}

fn assert_near(value: f32, expected: f32) {
    assert!((value - expected).abs() <= 2e-3 * expected.abs().max(0.1), "{value}, not {expected}");
}

#[test]
fn three_nozzles_are_reckoned_along() {
    // At full power and 125 C: 50 W, of which 12 W are needed.
    for (measured, least, greatest) in [(true, 1.0, 1.0), (false, 0.81, 1.21)] {
        let look = Look { duty: 1.0, nozzle: nozzle(measured), ..at(125.0) };
        let mut supervision = Supervision::default();
        reckon(&mut supervision, &look, 8.0);
        let rates = [
            (supervision.sure, (50.0 * 0.88 * least - 12.0 * 1.15) / (12.0 * 1.12)),
            (supervision.most, (50.0 * 1.12 * greatest - 12.0 * 0.85) / (12.0 * 0.88)),
            (supervision.likely, (50.0 * least - 12.0) / 12.0),
        ];
        for (reckoned, rate) in rates {
            assert_near(reckoned.prompt, 8.0 * rate);
            assert_near(reckoned.late_rate, rate * (1.0 - libm::powf(1.0 - DT / 4.0, 32.0)));
            // What a lag of 4 s has not shown yet.
            assert_near(reckoned.late, 8.0 * rate - 4.0 * reckoned.late_rate);
            let earlier = by(1.0);
            assert_eq!(reckoned.since(&earlier), (reckoned.late - 1.0, reckoned.prompt - 1.0));
        }
        assert_near(supervision.fall_c, 8.0 * 1.6 * 12.0 / 12.0);
        assert_eq!(supervision.zero_s, 0.0);
    }
}

#[test]
fn a_late_reading_never_overtakes_the_nozzle() {
    let mut reckoned = Reckoned::default();
    reckoned.add(2.0, 10.0);
    assert_eq!((reckoned.prompt, reckoned.late, reckoned.late_rate), (20.0, 0.0, 2.0));
}

#[test]
fn below_the_surroundings_nothing_falls() {
    let mut supervision = Supervision::default();
    reckon(&mut supervision, &at(15.0), 5.0);
    assert_eq!(supervision.fall_c, 0.0);
    assert_eq!(supervision.zero_s, 5.0);
    supervision.reckon(&Look { duty: 0.01, ..at(15.0) });
    assert_eq!(supervision.zero_s, 0.0);
}

#[test]
fn the_trim_is_learned_near_the_target_while_the_power_is_free() {
    let learn = |reading_c: f32, saturated: bool, seconds: f32| {
        let regulated = Regulated { trim: 0.25, saturated, wiggle: None };
        let mut supervision = Supervision::default();
        reckon(&mut supervision, &Look { regulated: Some(regulated), ..at(reading_c) }, seconds);
        supervision.learned
    };
    for reading_c in [TARGET_C, TARGET_C + 1.75, TARGET_C - 1.75] {
        assert_near(learn(reading_c, false, 30.0), 0.25 * (1.0 - libm::powf(1.0 - DT / 30.0, 120.0)));
    }
    for reading_c in [TARGET_C + 2.0, TARGET_C - 2.0] {
        assert_eq!(learn(reading_c, false, 30.0), 0.0);
    }
    assert_eq!(learn(TARGET_C, true, 30.0), 0.0);
    // What is learned says how much less each watt does: at 1/0.8 of the power that it should need, it stays where it is.
    let look = Look { duty: 21.0 / 50.0 * 1.25, regulated: None, ..at(TARGET_C) };
    let mut supervision = Supervision { learned: 0.25, ..Supervision::default() };
    reckon(&mut supervision, &look, 10.0);
    assert!(supervision.likely.prompt.abs() < 1e-3);
}

#[test]
fn what_is_looked_back_at_is_kept_for_25_s_and_stays_small() {
    let look = Look { duty: 1.0, ..at(125.0) };
    let mut supervision = Supervision { still: Some(still(125.0)), ..Supervision::default() };
    for _ in 0..200 {
        supervision.reckon(&look);
        if supervision.since_mark_s >= MARK_S {
            supervision.mark(125.0);
        }
    }
    let ages: Vec<f32> = supervision.marks.iter().map(|mark| mark.age_s).collect();
    assert_eq!(ages, (0..25).rev().map(|age| age as f32).collect::<Vec<_>>());
    let rate = (50.0 * 0.88 - 12.0 * 1.15) / (12.0 * 1.12);
    for mark in &supervision.marks {
        assert_near(supervision.sure.since(&mark.sure).1, rate * mark.age_s);
        assert_near(supervision.likely.since(&mark.likely).1, 38.0 / 12.0 * mark.age_s);
        assert_near(supervision.most.since(&mark.most).1, (56.0 - 10.2) / 10.56 * mark.age_s);
        assert_near(supervision.fall_c - mark.fall_c, 1.6 * mark.age_s);
    }
    let since_still = supervision.likely.since(&supervision.still.unwrap().likely).1;
    assert_near(since_still, 38.0 / 12.0 * 50.0);
    for sums in [supervision.sure, supervision.likely, supervision.most] {
        assert_eq!((sums.prompt, sums.late), (0.0, 0.0));
    }
    assert_eq!(supervision.fall_c, 0.0);
}

#[test]
fn a_mark_is_made_each_second() {
    let mut supervision = Supervision::default();
    for looks in 1..=12 {
        // Power that the nozzle needs there.
        supervision.look(&Look { duty: 21.0 / 50.0, ..at(TARGET_C) }).unwrap();
        assert_eq!(supervision.marks.len(), looks / 4);
    }
}

#[test]
fn a_fall_that_no_nozzle_can_do_is_a_thermistor_out_of_its_place() {
    let found = |age_s: f32, change: f32| {
        let mut supervision = Supervision { fall_c: 2.5, ..Supervision::default() };
        let _ = supervision.marks.push_back(Mark { fall_c: 0.5, ..mark(age_s, 190.0) });
        supervision.rises_or_falls(&at(190.0 + change))
    };
    // It may fall by 2 C, and by 4 C that nobody knows of.
    for age_s in [1.0, 5.0] {
        assert_eq!(found(age_s, -6.0), None);
        assert_eq!(found(age_s, -6.25), Some(Fault::ThermistorDetached));
    }
    for age_s in [0.75, 5.25] {
        assert_eq!(found(age_s, -50.0), None);
    }
}

#[test]
fn a_rise_that_no_power_can_do_is_a_heater_stuck_on() {
    let found = |age_s: f32, zero_s: f32, most: Reckoned, change: f32| {
        let supervision = Supervision { zero_s, most, ..since(age_s, 100.0) };
        supervision.rises_or_falls(&at(100.0 + change))
    };
    let most = Reckoned { prompt: 5.0, late: 3.0, late_rate: 0.0 };
    for age_s in [3.0, 6.0] {
        assert_eq!(found(age_s, 0.0, most, 11.0), None);
        assert_eq!(found(age_s, 0.0, most, 11.25), Some(Fault::HeaterStuckOn));
        // Without any power in all the time, less is too much.
        assert_eq!(found(age_s, age_s, most, 7.0), None);
        assert_eq!(found(age_s, age_s, most, 7.25), Some(Fault::HeaterStuckOn));
        assert_eq!(found(age_s, age_s - DT, most, 7.25), None);
        // A nozzle that should have cooled may have stayed as it was.
        assert_eq!(found(age_s, age_s, by(-8.0), 2.0), None);
        assert_eq!(found(age_s, age_s, by(-8.0), 2.25), Some(Fault::HeaterStuckOn));
    }
    for age_s in [2.75, 6.25] {
        assert_eq!(found(age_s, age_s, most, 30.0), None);
    }
}

#[test]
fn a_nozzle_that_will_be_too_hot_is_cut_off_before() {
    let found = |age_s: f32, reading_c: f32, change: f32| {
        let supervision = Supervision { most: by(100.0), ..since(age_s, reading_c - change) };
        supervision.rises_or_falls(&at(reading_c))
    };
    for age_s in [2.5, 3.0, 3.5] {
        // 2 C/s, of which 1.5 go on for 4 s.
        let change = 2.0 * age_s;
        assert_eq!(found(age_s, 234.0, change), None);
        assert_eq!(found(age_s, 234.25, change), Some(Fault::OverTemperature));
        // A reading that falls does not hide what it says.
        assert_eq!(found(age_s, 240.0, -1.0), None);
        assert_eq!(found(age_s, 240.25, -1.0), Some(Fault::OverTemperature));
    }
    for age_s in [2.25, 3.75] {
        assert_eq!(found(age_s, 239.0, 2.0 * age_s), None);
    }
}

fn still(reading_c: f32) -> Still {
    Still { reading_c, seconds: 0.0, wiggled_s: 0.0, likely: by(0.0) }
}

#[test]
fn a_reading_that_stands_through_a_change_is_frozen() {
    let found = |likely: f32, moved: bool, hot: bool, measured: bool, zero_s: f32| {
        let mut supervision = Supervision {
            likely: by(likely),
            still: Some(still(150.0)),
            first_c: Some(150.0),
            moved,
            zero_s,
            ..Supervision::default()
        };
        supervision.stands_still(&Look { hot, nozzle: nozzle(measured), ..at(150.0) })
    };
    assert_eq!(found(12.0, true, false, true, 0.0), None);
    assert_eq!(found(12.25, true, false, true, 0.0), Some(Fault::ThermistorFrozen));
    // It has never moved: a heater without effect looks just so.
    assert_eq!(found(12.25, false, false, true, 0.0), Some(Fault::HeatingTooSlow));
    assert_eq!(found(12.25, false, true, true, 0.0), Some(Fault::ThermistorFrozen));
    assert_eq!(found(-12.0, false, false, true, 0.0), None);
    assert_eq!(found(-12.25, false, false, true, 0.0), Some(Fault::ThermistorFrozen));
    // With a supply that is not measured, a fall is known only without power.
    assert_eq!(found(-12.25, false, false, false, 4.0), None);
    assert_eq!(found(-12.25, false, false, false, 4.25), Some(Fault::ThermistorFrozen));
    assert_eq!(found(12.25, true, false, false, 0.0), Some(Fault::ThermistorFrozen));
}

#[test]
fn of_a_reading_that_lags_the_lesser_change_counts_where_it_stands() {
    for (prompt, late) in [(20.0, 12.0), (12.0, 20.0), (-20.0, -12.0), (-12.0, -20.0)] {
        let likely = Reckoned { prompt, late, late_rate: 0.0 };
        let mut supervision = Supervision { likely, still: Some(still(150.0)), ..Supervision::default() };
        assert_eq!(supervision.stands_still(&at(150.0)), None);
    }
}

#[test]
fn a_reading_that_stands_while_the_power_is_wiggled_is_frozen_after_45_s() {
    let wiggled = Regulated { wiggle: Some((0.0, 0.5)), ..STEADY };
    let stand = |regulated: Option<Regulated>| {
        let mut supervision = Supervision::default();
        looks_in_peace(400, || supervision.stands_still(&Look { regulated, ..at(TARGET_C) }))
    };
    // The first look is none of those in which it stands; then 180 make 45 s.
    assert_eq!(stand(Some(wiggled)), (180, Some(Fault::ThermistorFrozen)));
    assert_eq!(stand(Some(Regulated { saturated: true, ..wiggled })), (400, None));
    assert_eq!(stand(Some(STEADY)), (400, None));
    assert_eq!(stand(None), (400, None));
    // The least change will do.
    let mut supervision = Supervision::default();
    for look in 0..1000 {
        let reading_c = if look % 100 == 99 { 1.000_1 } else { 1.0 };
        assert_eq!(supervision.stands_still(&Look { regulated: Some(wiggled), ..at(reading_c) }), None);
    }
}

#[test]
fn a_reading_has_moved_once_it_was_more_than_3_c_from_its_first() {
    for (change, moved) in [(3.0, false), (3.25, true), (-3.0, false), (-3.25, true)] {
        let mut supervision = Supervision::default();
        for reading_c in [150.0, 150.0 + change, 150.0] {
            assert_eq!(supervision.stands_still(&at(reading_c)), None);
        }
        assert_eq!(supervision.moved, moved, "{change}");
        assert_eq!(supervision.still.unwrap().seconds, 0.0);
        supervision.stands_still(&at(150.0));
        assert_eq!(supervision.still.unwrap().seconds, DT);
    }
}

#[test]
fn a_reading_must_follow_a_sure_rise_by_70_percent_and_a_likely_one_by_40() {
    let found = |sure: f32, likely: f32, change: f32| {
        let supervision = Supervision { sure: by(sure), likely: by(likely), ..since(5.0, 150.0) };
        supervision.does_not_follow(&Look { hot: false, ..at(150.0 + change) })
    };
    assert_eq!(found(12.0, 0.0, 0.0), None);
    assert_eq!(found(20.0, 0.0, 14.0), None);
    assert_eq!(found(20.0, 0.0, 13.75), Some(Fault::HeatingTooSlow));
    assert_eq!(found(0.0, 26.0, 0.0), None);
    assert_eq!(found(0.0, 30.0, 12.0), None);
    assert_eq!(found(0.0, 30.0, 11.75), Some(Fault::HeatingTooSlow));
    // What the lesser of both says.
    let late = Reckoned { prompt: 40.0, late: 12.0, late_rate: 0.0 };
    let supervision = Supervision { sure: late, ..since(5.0, 150.0) };
    assert_eq!(supervision.does_not_follow(&at(150.0)), None);
}

#[test]
fn the_state_says_what_a_missing_rise_is() {
    let found = |reading_c: f32, hot: bool, moved: bool, still_s: f32| {
        let still = Some(Still { seconds: still_s, ..still(reading_c) });
        let supervision = Supervision { sure: by(20.0), moved, still, ..since(5.0, reading_c) };
        supervision.does_not_follow(&Look { hot, ..at(reading_c) })
    };
    assert_eq!(found(150.0, false, true, 4.25), Some(Fault::ThermistorFrozen));
    assert_eq!(found(150.0, false, true, 4.0), Some(Fault::HeatingTooSlow));
    assert_eq!(found(150.0, false, false, 4.25), Some(Fault::HeatingTooSlow));
    assert_eq!(found(196.75, true, true, 0.0), Some(Fault::TemperatureDrop));
    assert_eq!(found(197.0, true, true, 0.0), Some(Fault::HeaterEnergy));
}

#[test]
fn a_reading_must_follow_a_likely_fall_by_40_percent() {
    let look = |reading_c: f32, hot: bool, measured: bool| Look { hot, nozzle: nozzle(measured), ..at(reading_c) };
    // Without power, from 150 C.
    let cools = |fall: f32, zero_s: f32, change: f32, hot: bool| {
        let supervision = Supervision { likely: by(-fall), zero_s, ..since(5.0, 150.0) };
        supervision.does_not_follow(&look(150.0 + change, hot, false))
    };
    assert_eq!(cools(26.0, 5.0, 0.0, true), None);
    assert_eq!(cools(30.0, 5.0, -12.0, true), None);
    assert_eq!(cools(30.0, 5.0, -11.75, true), Some(Fault::HeaterStuckOn));
    assert_eq!(cools(30.0, 4.75, -11.75, true), None);
    // Of a reading that has not risen either, who knows.
    assert_eq!(cools(30.0, 5.0, 2.0, false), Some(Fault::ThermistorFrozen));
    assert_eq!(cools(30.0, 5.0, 2.25, false), Some(Fault::HeaterStuckOn));
    // With little power, from above the target's band.
    let above = |reading_c: f32, measured: bool| {
        let supervision = Supervision { likely: by(-30.0), ..since(5.0, reading_c) };
        supervision.does_not_follow(&look(reading_c, true, measured))
    };
    assert_eq!(above(203.0, true), None);
    assert_eq!(above(203.25, true), Some(Fault::HeaterStuckOn));
    assert_eq!(above(203.25, false), None);
    assert_eq!(above(150.0, true), None);
}

#[test]
fn a_reading_that_stands_at_all_the_power_may_be_that_of_a_nozzle_that_comes_no_further() {
    let still = Some(Still { seconds: 4.25, ..still(150.0) });
    for (duty, hot, fault) in [
        (0.99, false, Fault::ThermistorFrozen),
        (1.0, false, Fault::HeatingTooSlow),
        (0.99, true, Fault::ThermistorFrozen),
        (1.0, true, Fault::TemperatureDrop),
    ] {
        let look = Look { duty, hot, ..at(150.0) };
        let mut stands = Supervision { likely: by(12.25), moved: true, still, ..Supervision::default() };
        assert_eq!(stands.stands_still(&look), Some(fault), "{duty}");
        let follows_not = Supervision { sure: by(20.0), moved: true, still, ..since(5.0, 150.0) };
        assert_eq!(follows_not.does_not_follow(&look), Some(fault), "{duty}");
    }
}

#[test]
fn a_hot_nozzle_that_is_8_c_too_cold_for_3_s_or_out_of_its_band_for_30_s_drops() {
    let low = |below: f32, hot: bool, regulated: Option<Regulated>| {
        let mut supervision = Supervision::default();
        looks_in_peace(400, || supervision.drops(&Look { hot, regulated, ..at(TARGET_C - below) }))
    };
    let drop = Some(Fault::TemperatureDrop);
    assert_eq!(low(8.25, true, Some(STEADY)), (12, drop));
    assert_eq!(low(8.0, true, Some(STEADY)), (120, drop));
    assert_eq!(low(3.25, true, Some(STEADY)), (120, drop));
    assert_eq!(low(3.0, true, Some(STEADY)), (400, None));
    assert_eq!(low(-50.0, true, Some(STEADY)), (400, None));
    assert_eq!(low(50.0, false, Some(STEADY)), (400, None));
    assert_eq!(low(50.0, true, None), (400, None));
    // A moment within begins anew, and so does another target.
    let mut supervision = Supervision::default();
    for round in 0..40 {
        for _ in 0..11 {
            assert_eq!(supervision.drops(&at(TARGET_C - 9.0)), None);
        }
        if round % 2 == 0 {
            assert_eq!(supervision.drops(&at(TARGET_C)), None);
        } else {
            supervision.retarget();
        }
    }
}

#[test]
fn a_hot_nozzle_that_takes_60_percent_more_than_it_needs_loses_it_elsewhere() {
    // It needs 21 W at 200 C: 0.42 of the power.
    let takes = |times: f32, hot: bool, measured: bool| {
        let look = Look { duty: 0.42 * times, hot, nozzle: nozzle(measured), ..at(TARGET_C) };
        let mut supervision = Supervision::default();
        supervision.reckon(&Look { hot: false, ..at(TARGET_C) });
        looks_in_peace(4000, || {
            supervision.reckon(&look);
            supervision.takes_energy(&look)
        })
    };
    assert_eq!(takes(1.59, true, true), (4000, None));
    assert_eq!(takes(2.0, false, true), (4000, None));
    // The mean of 60 s passes 1.6 times the need when 0.4 of the surplus is left: after 55 s.
    let (looks, fault) = takes(2.0, true, true);
    assert_eq!(fault, Some(Fault::HeaterEnergy));
    assert!((218..=221).contains(&looks), "{looks}");
    // A supply that is not measured may give a fifth less.
    assert_eq!(takes(1.95, true, false), (4000, None));
    assert_eq!(takes(2.3, true, false).1, Some(Fault::HeaterEnergy));
}

#[test]
fn power_that_goes_along_with_the_need_is_no_fault() {
    let mut supervision = Supervision::default();
    supervision.reckon(&Look { hot: false, ..at(100.0) });
    // From 9 W at 100 C to 21 W at 200 C.
    for _ in 0..4000 {
        let look = Look { duty: 0.42, ..at(TARGET_C) };
        supervision.reckon(&look);
        assert_eq!(supervision.takes_energy(&look), None);
    }
    assert_near(supervision.energy.0, 21.0);
    assert_near(supervision.energy.1, 21.0);
}

/// Periods of the wiggle in which the reading swings by this share of it; in so much of each the power is saturated.
fn swing(
    supervision: &mut Supervision,
    share: f32,
    shift: f32,
    saturated_s: f32,
    periods: u32,
) -> (u32, Option<Fault>) {
    const AMPLITUDE_C: f32 = 0.5;
    let looks = (WIGGLE_PERIOD_S / DT) as u32;
    let mut look = 0;
    looks_in_peace(periods * looks, || {
        let phase = (look % looks) as f32 / looks as f32;
        let saturated = (look % looks) as f32 * DT < saturated_s;
        look += 1;
        let swings = share * AMPLITUDE_C * wiggle_at(phase + shift).0;
        let regulated = Some(Regulated { trim: 0.0, saturated, wiggle: Some((phase, AMPLITUDE_C)) });
        supervision.wiggles(&Look { regulated, ..at(TARGET_C + swings) })
    })
}

#[test]
fn a_wiggle_that_does_not_show_twice_is_a_reading_that_is_not_the_nozzles() {
    let frozen = Some(Fault::ThermistorFrozen);
    for shift in [0.0, 0.25, 0.625] {
        assert_eq!(swing(&mut Supervision::default(), 0.16, shift, 0.0, 10), (640, None), "{shift}");
        assert_eq!(swing(&mut Supervision::default(), 0.14, shift, 0.0, 10), (128, frozen), "{shift}");
    }
    assert_eq!(swing(&mut Supervision::default(), 0.0, 0.0, 0.0, 10), (128, frozen));
    // One that shows in between begins anew, and so does a time without wiggle, and another target.
    let mut supervision = Supervision::default();
    let forget: [fn(&mut Supervision); 3] = [
        |supervision| assert_eq!(swing(supervision, 1.0, 0.0, 0.0, 1), (64, None)),
        |supervision| assert_eq!(supervision.wiggles(&at(TARGET_C)), None),
        Supervision::retarget,
    ];
    for forget in forget.iter().cycle().take(9) {
        assert_eq!(swing(&mut supervision, 0.0, 0.0, 0.0, 1), (64, None));
        forget(&mut supervision);
    }
}

#[test]
fn a_reading_that_stands_at_its_target_shows_no_wiggle_where_the_looks_do_not_divide_its_period() {
    // The period that is looked at ends within half a look of 16 s: after 15.9 and 15.95 s.
    for (seconds, looks) in [(0.3, 53), (0.11, 145)] {
        let mut supervision = Supervision::default();
        let mut look = 0;
        let found = looks_in_peace(10 * looks, || {
            let phase = look as f32 * seconds / WIGGLE_PERIOD_S;
            look += 1;
            let regulated = Some(Regulated { wiggle: Some((phase - libm::floorf(phase), 0.5)), ..STEADY });
            supervision.wiggles(&Look { seconds, regulated, ..at(TARGET_C) })
        });
        assert_eq!(found, (2 * looks, Some(Fault::ThermistorFrozen)));
    }
}

#[test]
fn power_that_is_saturated_for_three_periods_is_more_than_a_hot_nozzle_needs() {
    let energy = Some(Fault::HeaterEnergy);
    // 0.6 of 16 s are 9.6 s.
    assert_eq!(swing(&mut Supervision::default(), 1.0, 0.0, 9.5, 10), (640, None));
    assert_eq!(swing(&mut Supervision::default(), 1.0, 0.0, 9.75, 10), (192, energy));
    // Where there is no wiggle for want of power, a reading without it is not frozen.
    assert_eq!(swing(&mut Supervision::default(), 0.0, 0.0, 9.75, 10), (128, energy));
    // One period with room for it begins anew.
    let mut supervision = Supervision::default();
    for _ in 0..5 {
        assert_eq!(swing(&mut supervision, 1.0, 0.0, 16.0, 2), (128, None));
        assert_eq!(swing(&mut supervision, 1.0, 0.0, 0.0, 1), (64, None));
    }
}
