//! Tests of the tip, whose signals are set directly.

use std::f64::consts::FRAC_PI_2;

use growbot_core::layer::grow;
use growbot_core::simulation::Disturbance;
use growbot_core::tracking::SensorNoise;
use growbot_firmware::emulated_tip::{ENCODER_OK, EncoderMapping, encoder_level};
use growbot_firmware::thermistor::{self, ThermistorError};

use super::*;

mod faults;

fn robot() -> Robot {
    growbot_plan::robot_file::load("growbot-a".as_ref()).unwrap()
}

/// Returns a tip without noise, with a nozzle at 200 degrees Celsius and both motors enabled.
fn hot_tip() -> TipModel {
    let mut tip = TipModel::new(robot(), 0, Variation { noise_counts: 0.0, ..Variation::default() });
    tip.set_nozzle_c(200.0);
    for motor in [Motor::Head, Motor::Feed] {
        tip.set_enabled(motor, true);
        tip.set_direction(motor, MotorDirection::Forward);
    }
    tip
}

fn temperature(tip: &mut TipModel) -> Result<f64, ThermistorError> {
    thermistor::celsius_from_raw(f64::from(tip.sample_thermistor().unwrap()), &robot().description().thermistor)
}

fn seconds(tip: &TipModel, seconds: f64) -> u64 {
    tip.now() + (seconds * 4000.0) as u64
}

/// Advances the tip's time by `time`, s.
fn wait(tip: &mut TipModel, time: f64) {
    tip.advance(seconds(tip, time));
}

/// Makes this number of feed steps, one per tick.
fn feed(tip: &mut TipModel, steps: u32) {
    for _ in 0..steps {
        tip.advance(tip.now() + 1);
        tip.step(Motor::Feed);
    }
}

/// Lays one turn of plastic while the head turns in the given direction, with twice the plastic in the quarter turn
/// around 90 degrees. The plastic of each head step is laid half before and half after the step, so both directions lay
/// the same layer.
fn lay_turn(tip: &mut TipModel, positive: bool) {
    tip.set_direction(Motor::Head, if positive { MotorDirection::Forward } else { MotorDirection::Backward });
    for step in 0..3200 {
        let at = if positive { step } else { 3199 - step };
        for _ in 0..if (400..1200).contains(&at) { 4 } else { 2 } {
            tip.advance(tip.now() + 1);
            tip.step(Motor::Feed);
        }
        tip.step(Motor::Head);
    }
}

#[test]
fn instant_preheat_applies_when_the_heater_is_switched_on() {
    let mut tip = TipModel::new(robot(), 0, Variation { noise_counts: 0.0, ..Variation::default() });
    tip.preheat_instantly(190.0);
    wait(&mut tip, 1.0);
    assert!(tip.nozzle_c() < 30.0);
    // It does not jump while its switches are tested.
    tip.set_heater(0.0, true);
    tip.set_heater(1.0, false);
    assert!(tip.nozzle_c() < 30.0);
    tip.set_heater(0.5, true);
    assert_eq!(tip.nozzle_c(), 190.0);
    tip.set_heater(0.0, true);
    // It jumps only then: a heated nozzle cools and heats normally, and a hotter one is not cooled.
    wait(&mut tip, 5.0);
    let cooled = tip.nozzle_c();
    tip.set_heater(0.1, true);
    assert!(cooled < 189.0 && tip.nozzle_c() == cooled);
    tip.set_heater(0.0, false);
    tip.set_nozzle_c(200.0);
    tip.set_heater(0.1, true);
    assert_eq!(tip.nozzle_c(), 200.0);
}

#[test]
fn the_index_passes_once_a_turn() {
    let mut tip = hot_tip();
    let mut edges = 0;
    let mut before = tip.on_index();
    for _ in 0..5 * 3200 {
        tip.step(Motor::Head);
        edges += u32::from(tip.on_index() && !before);
        before = tip.on_index();
    }
    assert_eq!(edges, 5);
}

#[test]
fn disabled_motors_do_not_move() {
    let mut tip = TipModel::new(robot(), 17, Variation::default());
    tip.step(Motor::Head);
    tip.step(Motor::Feed);
    assert_eq!((tip.head_position(), tip.feed_steps()), (17, 0));
}

#[test]
fn a_cold_nozzle_lays_nothing_and_holds_the_filament() {
    let mut tip = TipModel::new(robot(), 0, Variation::default());
    tip.set_enabled(Motor::Feed, true);
    tip.set_direction(Motor::Feed, MotorDirection::Forward);
    tip.step(Motor::Feed);
    assert_eq!((tip.feed_steps(), tip.cold_feed_steps()), (1, 1));
    assert!(tip.body().is_empty() && !tip.filament_moves_with_feed());
    assert!((tip.filament_left() - 330_000.0).abs() < 1e-6);
}

#[test]
fn more_plastic_on_one_side_tilts_the_layer_away_from_it() {
    let mut tip = hot_tip();
    lay_turn(&mut tip, true);
    let body = tip.body();
    assert_eq!(body.len(), 1);
    assert!((body[0].alpha - FRAC_PI_2).abs() < 2e-3, "{body:?}");
    let height = 8000.0 / robot().feed_steps_per_length();
    assert!((body[0].height - height).abs() < 1e-9);
}

#[test]
fn an_alternating_head_lays_the_same_body() {
    let grown = |alternate: bool| {
        let mut tip = hot_tip();
        for turn in 0..6 {
            tip.set_nozzle_c(200.0);
            lay_turn(&mut tip, !alternate || turn % 2 == 0);
        }
        (tip.body(), tip.base_from_tip())
    };
    let ((there, end), (to_and_fro, end_too)) = (grown(false), grown(true));
    assert_eq!((there.len(), to_and_fro.len()), (6, 6));
    for (a, b) in there.iter().zip(&to_and_fro).skip(1) {
        assert!((a.height - b.height).abs() < 2.0 / robot().feed_steps_per_length(), "{a:?} {b:?}");
        assert!((a.tilt / b.tilt - 1.0).abs() < 2e-3 && (a.alpha - b.alpha).abs() < 3e-3, "{a:?} {b:?}");
    }
    assert!((end.translation.vector - end_too.translation.vector).norm() < 1e-3);
}

#[test]
fn an_early_reversal_adds_no_layers() {
    let mut tip = hot_tip();
    for turn in 0..6 {
        tip.set_nozzle_c(200.0);
        if turn == 1 {
            tip.inject(TipFault::HeadLosesSteps { steps: 40 });
        }
        lay_turn(&mut tip, turn % 2 == 0);
    }
    assert_eq!(tip.head_slip(), 40);
    let body = tip.body();
    assert_eq!(body.len(), 6);
    let height: f64 = body.iter().map(|layer| layer.height).sum();
    assert!((height - 48_000.0 / robot().feed_steps_per_length()).abs() < 1e-9);
}

#[test]
fn retracting_and_refilling_filament_lays_nothing() {
    let grown = |retracts: bool| {
        let mut tip = hot_tip();
        for _ in 0..3 {
            tip.set_nozzle_c(200.0);
            lay_turn(&mut tip, true);
            if retracts {
                tip.set_direction(Motor::Feed, MotorDirection::Backward);
                feed(&mut tip, 180);
                wait(&mut tip, 1.0);
                tip.set_direction(Motor::Feed, MotorDirection::Forward);
                feed(&mut tip, 180);
            }
        }
        (tip.body(), tip.feed_steps())
    };
    let ((plain, steps), (retracted, steps_too)) = (grown(false), grown(true));
    assert_eq!((plain.len(), steps), (retracted.len(), steps_too));
    for (a, b) in plain.iter().zip(&retracted) {
        assert!((a.height - b.height).abs() < 1e-12 && (a.tilt - b.tilt).abs() < 1e-12, "{a:?} {b:?}");
    }
}

#[test]
fn gravity_turns_as_the_body_bends() {
    let mut tip = hot_tip();
    assert_eq!(tip.gravity(), Some([0, 0, 1000]));
    for _ in 0..100 {
        tip.set_nozzle_c(200.0);
        lay_turn(&mut tip, true);
    }
    let whole = grow(&Frame::identity(), tip.body());
    assert!((tip.base_from_tip().translation.vector - whole.translation.vector).norm() < 1e-9);
    // The tip has leant away from its y axis, so up lies on that side of it.
    let lean: f64 = tip.body().iter().map(|layer| layer.tilt).sum();
    let [x, y, z] = tip.gravity().unwrap().map(f64::from);
    assert!(lean > 0.1 && x.abs() < 5.0, "{lean} {x}");
    assert!((y - 1000.0 * libm::sin(lean)).abs() < 2.0 && (z - 1000.0 * libm::cos(lean)).abs() < 2.0, "{lean} {y} {z}");

    // The next body begins there, whatever was laid before.
    let next = Pose::from_degrees([10.0, 20.0, 30.0, 40.0, 0.0]).unwrap().with_roll(0.5).unwrap();
    tip.start_at(&next);
    assert!((tip.base_from_tip().to_homogeneous() - next.frame().to_homogeneous()).amax() < 1e-9);
    tip.start_at(&Pose::from_degrees([0.0; 5]).unwrap());
    assert_eq!(tip.gravity(), Some([-1000, 0, 0]));
    tip.inject(TipFault::OrientationSilent);
    assert_eq!(tip.gravity(), None);
    let mut level = hot_tip();
    level.start_at(&Pose::from_degrees([0.0; 5]).unwrap());
    assert_eq!(level.gravity(), Some([-1000, 0, 0]));
}

#[test]
fn flowing_filament_and_fan_cool_the_nozzle() {
    let mut tip = hot_tip();
    let description = robot().description().clone();
    tip.set_heater(1.0, true);
    tip.set_fan(1.0);
    for _ in 0..10 * 60 * 400 {
        // 400 feed steps a second: 10.7 mm^3/s.
        tip.advance(tip.now() + 10);
        tip.step(Motor::Feed);
    }
    let flow = 400.0 / 90.0 * robot().filament_area() * 0.0022;
    let heater = description.heater;
    let settled = 22.0 + heater.power_w / (heater.loss_w_per_k + description.fan.loss_w_per_k + flow);
    assert!((tip.nozzle_c() - settled).abs() < 0.05, "{} {settled}", tip.nozzle_c());
    assert_eq!(tip.cold_feed_steps(), 0);
}

#[test]
fn the_tip_does_not_depend_on_the_sampling() {
    let run = |every: u64| {
        let mut tip = TipModel::new(robot(), 0, Variation::default());
        tip.set_enabled(Motor::Feed, true);
        tip.set_direction(Motor::Feed, MotorDirection::Forward);
        tip.set_heater(1.0, true);
        for tick in 0..90 * 4000 {
            tip.advance(tick);
            if tick == 40_000 {
                tip.inject(TipFault::SupplyDip { volts: 9.0, seconds: 2.5 });
            }
            if tick % 10 == 0 {
                tip.step(Motor::Feed);
            }
            if tick % every == 0 {
                tip.sample_thermistor();
            }
        }
        (tip.nozzle_c(), tip.cold_feed_steps(), tip.body(), tip.sample_thermistor())
    };
    let (celsius, cold, body, raw) = run(1);
    assert!(cold > 1000 && !body.is_empty());
    for every in [13, 400, 100_000_000] {
        let (c, k, b, r) = run(every);
        assert!((c - celsius).abs() < 1e-7, "{every}: {c} {celsius}");
        assert_eq!((k, b, r), (cold, body.clone(), raw), "{every}");
    }
}

#[test]
fn the_encoder_turns_with_the_filament_and_not_with_the_feed() {
    let mut tip = hot_tip();
    let pulses = |tip: &mut TipModel| {
        let mut level = tip.encoder();
        let rises = (0..1125).filter(|_| {
            feed(tip, 1);
            let before = std::mem::replace(&mut level, tip.encoder());
            level && !before
        });
        rises.count()
    };
    assert_eq!(pulses(&mut tip), 10);
    for fault in [TipFault::FilamentJam, TipFault::FilamentOut, TipFault::DriverFault] {
        tip.inject(fault);
        assert_eq!(pulses(&mut tip), 0);
        assert_eq!(tip.has_filament(), fault != TipFault::FilamentOut);
        assert!(!tip.filament_moves_with_feed());
        tip.clear_fault(fault);
    }
    let laid: f64 = tip.body().iter().map(|layer| layer.height).sum();
    assert!((laid * robot().feed_steps_per_length() - 1125.0).abs() < 1e-6);
    assert!(tip.filament_moves_with_feed());
    tip.load_filament(5.0);
    assert_eq!(pulses(&mut tip), 4);
    assert!(!tip.has_filament());
}

#[test]
fn the_emulated_board_computes_the_same_encoder_level() {
    let mut tip = hot_tip();
    let pitch = encoder_pitch(&robot());
    for step in 0..1000 {
        assert_eq!(tip.encoder(), encoder_level(step, pitch, ENCODER_OK, EncoderMapping::default()), "{step}");
        feed(&mut tip, 1);
    }
}

/// Returns a tip that has laid this number of turns, and the length of filament by which its encoder had turned after
/// each turn, mm.
fn laid(turns: u32, imperfection: &ErrorModel) -> (TipModel, Vec<f64>) {
    let mut tip = hot_tip();
    tip.disturb(imperfection);
    let mut turned = Vec::new();
    for _ in 0..turns {
        tip.set_nozzle_c(200.0);
        lay_turn(&mut tip, true);
        turned.push(tip.encoder_mapping().0 / robot().description().feed.steps_per_mm);
    }
    (tip, turned)
}

#[test]
fn a_disturbed_tip_lays_inexact_layers_and_its_encoder_measures_them() {
    let (mut exact, _) = laid(6, &ErrorModel::default());
    let disturbance = Disturbance { growth_noise: 0.1, growth_bias: -0.05, ..Disturbance::default() };
    let imperfection = ErrorModel { disturbance, seed: 7, ..ErrorModel::default() };
    let (mut tip, turned) = laid(6, &imperfection);
    let filament_per_length = robot().feed_steps_per_length() / robot().description().feed.steps_per_mm;
    let mut before = 0.0;
    for (index, (layer, expected)) in tip.body().iter().zip(exact.body()).enumerate() {
        assert_eq!(*layer, disturbance.lay(7, index as u64, &expected).layer);
        // Half a step lies on either side of the boundary of two layers.
        let grown = (turned[index] - before) / filament_per_length;
        assert!((grown / layer.height - 1.0).abs() < 1e-3, "{index}: {grown} {}", layer.height);
        before = turned[index];
    }
    assert_ne!(tip.base_from_tip(), exact.base_from_tip());
    assert_eq!(tip.feed_steps(), exact.feed_steps());
}

#[test]
fn twisted_layers_add_up_to_the_tip_pose() {
    let disturbance = Disturbance { twist_bias: 0.02, alpha_noise: 0.1, tilt_noise: 0.002, ..Disturbance::default() };
    let (mut tip, _) = laid(20, &ErrorModel { disturbance, seed: 3, ..ErrorModel::default() });
    let chained = grow(&Frame::identity(), tip.body());
    let there = tip.base_from_tip();
    assert!((chained.translation.vector - there.translation.vector).norm() < 1e-12);
    let roll = (chained.rotation.inverse() * there.rotation).angle();
    assert!((roll - 0.4).abs() < 1e-12, "{roll}");
}

#[test]
fn settled_layers_do_not_change() {
    let disturbance = Disturbance { growth_noise: 0.1, twist_noise: 0.1, tilt_bias: 0.2, ..Disturbance::default() };
    let imperfection = ErrorModel { disturbance, seed: 11, ..ErrorModel::default() };
    for alternate in [false, true] {
        let mut tip = hot_tip();
        tip.disturb(&imperfection);
        let mut reported = Vec::new();
        for turn in 0..12 {
            tip.set_nozzle_c(200.0);
            lay_turn(&mut tip, !alternate || turn % 2 == 0);
            reported.extend_from_slice(tip.settled(reported.len()));
            // The settled layers are three turns behind at most, and none of them changes later.
            assert!(reported.len() <= tip.body().len() && reported.len() + 4 > turn, "{} after {turn}", reported.len());
        }
        let body = tip.body();
        assert_eq!((&body[..reported.len()], body.len()), (&reported[..], 12));
    }
}

#[test]
fn sensor_noise_affects_only_the_readings() {
    let noise = SensorNoise { odometry: 0.02, direction: 0.01 };
    let (mut noisy, turned) = laid(8, &ErrorModel { noise, seed: 5, ..ErrorModel::default() });
    let (mut exact, really) = laid(8, &ErrorModel::default());
    assert_eq!(noisy.body(), exact.body());
    assert_eq!(noisy.base_from_tip(), exact.base_from_tip());
    assert!(noisy.gravity() != exact.gravity());
    let off = (turned[7] - really[7]).abs() / really[7];
    assert!(off > 1e-4 && off < 0.04, "{off}");
}
