//! Tests of the reference line and of the stages of the heater's proof test, with each limit from both sides.

use super::*;
use crate::heater::Demand;
use crate::testing::robot_a;
use growbot_core::robot::Robot;

const DT: f32 = 0.25;
/// Max time for which the proof test waits for a nozzle to come to rest, s. It ends between two one-second means.
const TIMEOUT_S: f32 = 299.5;

/// Returns the model of robot A's nozzle: 50 W, 12 J/K, 0.12 W/K, 240 C at most.
fn nozzle(robot: &Robot) -> NozzleModel<'_> {
    let supply_v = Some(robot.description().supply.nominal_v);
    NozzleModel::new(&Demand { supply_v, ..Demand::default() }, robot.description())
}

/// Returns a trend at rest with these one-second means.
fn of(means: impl IntoIterator<Item = f32>) -> UnheatedTrend {
    let mut rest = UnheatedTrend::default();
    for mean in means {
        assert_eq!(rest.add(mean, 1.0), Some(mean));
    }
    rest
}

fn line(from: f32, slope: f32) -> [f32; 7] {
    [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0].map(|second| from + slope * second)
}

#[test]
fn means_cover_one_second() {
    let mut rest = UnheatedTrend::default();
    for _ in 0..3 {
        let found = [10.0, 20.0, 20.0, 40.0].map(|reading| rest.add(reading, DT));
        assert_eq!(found, [None, None, None, Some(22.5)]);
    }
    // If the periods do not fit a second, the nearest number of them makes a mean. Each reading is weighted by its
    // time.
    let found = [10.0, 20.0, 30.0].map(|reading| rest.add(reading, 0.3));
    assert!(found[..2] == [None; 2] && (found[2].unwrap() - 20.0).abs() < 1e-4);
    assert_eq!(rest.add(10.0, 0.25), None);
    assert_eq!(rest.add(20.0, 0.75), Some(17.5));
    // A mean that ends half a period early is complete.
    assert_eq!([rest.add(5.0, 0.5), rest.add(5.0, 0.5)], [None, Some(5.0)]);
    assert_eq!([rest.add(5.0, 0.4), rest.add(5.0, 0.4)], [None, Some(5.0)]);
    assert_eq!([rest.add(5.0, 0.625), rest.add(5.0, 0.625)], [None, Some(5.0)]);
    assert_eq!(rest.add(5.0, 0.6875), Some(5.0));
    assert_eq!(rest.means.len(), MEANS);
}

#[test]
fn a_baseline_uses_the_latest_seven_means() {
    let robot = robot_a();
    let nozzle = nozzle(&robot);
    for count in 0..7 {
        assert_eq!(of(line(100.0, 0.0).into_iter().take(count)).reference(&nozzle), None);
    }
    // Earlier means no longer count.
    let rest = of([500.0, 300.0].into_iter().chain(line(100.0, -0.5)));
    assert_eq!(rest.reference(&nozzle), Some(Baseline { at_c: 97.0, slope_c_per_s: -0.5 }));
    assert_eq!(rest.latter_half(), Some(Baseline { at_c: 97.0, slope_c_per_s: -0.5 }));
    assert_eq!(rest.bend_c(), 0.0);
}

#[test]
fn a_baseline_must_be_straight_and_fit_an_unheated_nozzle() {
    let robot = robot_a();
    let nozzle = nozzle(&robot);
    let is_reference = |means: [f32; 7]| of(means).reference(&nozzle).is_some();
    // The rise is limited to 0.3 C/s, and a rising reference counts as level.
    assert_eq!(of(line(100.0, 0.25)).reference(&nozzle).unwrap().slope_c_per_s, 0.0);
    assert!(is_reference(line(100.0, 0.29)) && !is_reference(line(100.0, 0.31)));
    assert!(!of(line(100.0, 0.29)).rises() && of(line(100.0, 0.31)).rises());
    // A slope that is allowed for a reference does not count as a rise, to the last bit.
    let steepest = of([0.0, 0.0, 0.0, 0.0, 0.3, 0.6, 0.900_000_04]);
    assert_eq!(steepest.latter_half(), Some(Baseline { at_c: 0.900_000_04, slope_c_per_s: RISING_C_PER_S }));
    assert!(!steepest.rises());
    assert!(!of(line(100.0, -0.5)).rises() && !UnheatedTrend::default().rises());
    // 125 C need 12 W: 1.6 C/s, and 0.3 C/s more.
    let down = |slope: f32| line(125.0 - 6.0 * slope, slope);
    assert!(is_reference(down(-1.89)) && !is_reference(down(-1.91)));
    // Below the temperature of the surroundings nothing falls by itself.
    let cold = |slope: f32| line(10.0 - 6.0 * slope, slope);
    assert!(is_reference(cold(-0.29)) && !is_reference(cold(-0.31)));
    // Each mean may deviate by up to 0.4 C from the line.
    for at in 1..6 {
        for (off, straight) in [(0.39, true), (-0.39, true), (0.41, false), (-0.41, false)] {
            let mut means = line(100.0, -0.5);
            means[at] += off;
            let rest = of(means);
            assert!((rest.bend_c() - off.abs()).abs() < 1e-4);
            assert_eq!(rest.reference(&nozzle).is_some(), straight, "{off} at {at}");
        }
    }
}

#[test]
fn two_equal_means_count_as_a_frozen_reading() {
    assert!(of([100.0, 90.0, 90.0]).stands_still());
    assert!(of([100.0, 90.0, 90.000_5]).stands_still());
    for apart in [90.002, 89.998] {
        assert!(!of([90.0, 90.0, apart]).stands_still());
    }
    assert!(!of([90.0]).stands_still() && !UnheatedTrend::default().stands_still());
}

#[test]
fn a_falling_baseline_levels_off() {
    let robot = robot_a();
    let nozzle = nozzle(&robot);
    let reference = Baseline { at_c: 100.0, slope_c_per_s: -1.0 };
    assert!((reference.after(0.0, &nozzle) - 100.0).abs() < 1e-4);
    // The fall is reduced by a share of 0.5 * 10 s * 0.12 W/K / 12 J/K = 0.05, and by half at most.
    assert!((reference.after(10.0, &nozzle) - (100.0 - 10.0 * 0.95)).abs() < 1e-3);
    assert!((reference.after(200.0, &nozzle) - (100.0 - 200.0 * 0.5)).abs() < 1e-3);
}

#[test]
fn a_stage_lasts_until_full_power_would_be_detectable() {
    let robot = robot_a();
    assert!((stage_s(&nozzle(&robot)) - (5.0 + 8.0 * 12.0 / 50.0)).abs() < 1e-4);
}

/// Runs a proof test whose reading is a function of time and switches. Returns the time spent in each output (both
/// open, second switch alone, power stage alone), s, and the result of the test.
fn prove(mut reading: impl FnMut(f32, HeaterOutput) -> f32) -> ([f32; 3], Result<(), Fault>) {
    let robot = robot_a();
    let nozzle = nozzle(&robot);
    let (mut proof, mut rest) = (ProofTest::default(), UnheatedTrend::default());
    let (mut times, mut output) = ([0.0; 3], HeaterOutput::OFF);
    for look in 1..4000_u32 {
        let reading_c = reading(look as f32 * DT, output);
        match proof.look(&mut rest, reading_c, DT, TIMEOUT_S, &nozzle) {
            Ok(Some(next)) => output = next,
            Ok(None) => return (times, Ok(())),
            Err(fault) => return (times, Err(fault)),
        }
        let stage = [HeaterOutput::OFF, HeaterOutput::SECOND_SWITCH_ALONE, HeaterOutput::POWER_STAGE_ALONE];
        times[stage.iter().position(|stage| *stage == output).unwrap()] += DT;
    }
    panic!("it did not end: {times:?}");
}

#[test]
fn working_switches_are_proven_in_sequence() {
    // The test rests for seven means, then closes each switch for seven more, which is the next whole second after 6.92
    // s.
    for celsius in [20.0, 205.0] {
        let cools = if celsius > 100.0 { 1.0 } else { 0.0 };
        let reading = |time: f32, _| celsius - cools * time;
        assert_eq!(prove(reading), ([6.75, 7.0, 7.0], Ok(())));
    }
}

#[test]
fn a_welded_switch_is_detected_in_its_stage() {
    // The limit is 3.5 C above the reference.
    for (rise, found) in [(3.5, false), (3.6, true)] {
        let stuck = prove(|_, output| if output == HeaterOutput::SECOND_SWITCH_ALONE { 30.0 + rise } else { 30.0 });
        let welded = prove(|_, output| if output == HeaterOutput::POWER_STAGE_ALONE { 30.0 + rise } else { 30.0 });
        if found {
            assert_eq!(stuck, ([6.75, 1.0, 0.0], Err(Fault::HeaterStuckOn)));
            assert_eq!(welded, ([6.75, 7.0, 1.0], Err(Fault::HeaterSwitchWelded)));
        } else {
            // The rise bends the reference after the stage, so that the nozzle must come to rest again.
            assert_eq!((stuck.1, welded.1), (Ok(()), Ok(())));
        }
    }
}

#[test]
fn a_fall_that_stops_when_a_switch_closes_is_a_frozen_reading() {
    // The reading falls by 1 C/s during the rest.
    let mut last = 0.0;
    let (_, ended) = prove(|time, output| {
        if output == HeaterOutput::OFF {
            last = 150.0 - time;
        }
        last
    });
    assert_eq!(ended, Err(Fault::ThermistorFrozen));
}

#[test]
fn a_nozzle_that_still_rises_after_30_s_at_rest_is_a_fault() {
    let (times, ended) = prove(|time, _| 20.0 + 0.5 * time);
    assert_eq!((times, ended), ([30.75, 0.0, 0.0], Err(Fault::HeaterStuckOn)));
    // A reading that swings every 3 s is never at rest. It does not rise either over the 3 s that the test compares.
    let swings = |time: f32, _| if (time as u32).is_multiple_of(3) { 101.5 } else { 100.0 };
    assert_eq!(prove(swings), ([299.75, 0.0, 0.0], Err(Fault::HeaterStuckOn)));
}

#[test]
fn the_proof_test_waits_until_35_c_below_the_max_temperature() {
    let (times, ended) = prove(|time, _| 225.0 - time);
    assert_eq!(ended, Ok(()));
    // The mean of a second equals the reading in its middle.
    assert!((19.0..=21.0).contains(&times[0]), "{times:?}");
    for (celsius, proves) in [(205.0, true), (205.5, false)] {
        assert_eq!(prove(|_, _| celsius).1.is_ok(), proves, "{celsius}");
    }
}
