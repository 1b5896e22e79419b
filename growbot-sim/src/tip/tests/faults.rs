//! Variation between copies of a robot, and faults.

use super::*;

#[test]
fn the_seed_determines_the_noise() {
    let run = |seed| {
        let mut tip = TipModel::new(robot(), 0, Variation { seed, ..Variation::default() });
        (1..1000).map(|tick| (tip.advance(400 * tick), tip.sample_thermistor()).1).collect::<Vec<_>>()
    };
    assert_eq!(run(1), run(1));
    assert_ne!(run(1), run(2));
}

#[test]
fn variations_change_power_loss_and_ambient_temperature() {
    let settled = |variation| {
        let mut tip = TipModel::new(robot(), 0, variation);
        tip.set_heater(0.5, true);
        wait(&mut tip, 100_000.0);
        tip.nozzle_c()
    };
    let rise = 0.5 * 50.0 / 0.12;
    let cold = Variation { ambient_c: 5.0, power: 1.1, loss: 1.2, ..Variation::default() };
    assert!((settled(cold) - 5.0 - rise * 1.1 / 1.2).abs() < 1e-6);
    let low = Variation { supply_v: Some(11.0), heat_capacity: 2.0, ..Variation::default() };
    assert!((settled(low) - 22.0 - rise * 121.0 / 144.0).abs() < 1e-6);
}

#[test]
fn every_thermistor_fault_is_simulated() {
    let mut tip = hot_tip();
    assert!((temperature(&mut tip).unwrap() - 200.0).abs() < 1.0);
    tip.inject(TipFault::ThermistorOpen);
    assert_eq!(temperature(&mut tip), Err(ThermistorError::Open));
    tip.clear_fault(TipFault::ThermistorOpen);
    tip.inject(TipFault::ThermistorShort);
    assert_eq!(temperature(&mut tip), Err(ThermistorError::Short));
    tip.clear_fault(TipFault::ThermistorShort);
    tip.inject(TipFault::ThermistorSilent);
    assert_eq!(tip.sample_thermistor(), None);
    tip.clear_fault(TipFault::ThermistorSilent);

    tip.inject(TipFault::ThermistorFrozen);
    wait(&mut tip, 60.0);
    assert!((temperature(&mut tip).unwrap() - 200.0).abs() < 1.0 && tip.nozzle_c() < 130.0);
    tip.clear_fault(TipFault::ThermistorFrozen);
    let real = tip.nozzle_c();
    tip.inject(TipFault::ThermistorDetached { tau_s: 5.0, share: 0.2 });
    wait(&mut tip, 30.0);
    let air = 22.0 + 0.2 * (tip.nozzle_c() - 22.0);
    assert!((temperature(&mut tip).unwrap() - air).abs() < 3.0 && tip.nozzle_c() > 0.6 * real);
}

#[test]
fn a_stuck_thermistor_is_noisy_and_a_frozen_adc_is_not() {
    let different = |fault| {
        let mut tip = TipModel::new(robot(), 0, Variation::default());
        tip.set_heater(1.0, true);
        wait(&mut tip, 30.0);
        tip.inject(fault);
        let mut samples: Vec<_> = (0..100).map(|_| (wait(&mut tip, 0.1), tip.sample_thermistor()).1.unwrap()).collect();
        samples.sort_unstable();
        (samples[99] - samples[0], tip.nozzle_c())
    };
    assert_eq!(different(TipFault::ThermistorFrozen).0, 0);
    let (spread, real) = different(TipFault::ThermistorStuck);
    assert!((3..8).contains(&spread) && real > 150.0, "{spread} {real}");
}

#[test]
fn every_heater_fault_is_simulated() {
    let mut tip = hot_tip();
    tip.set_heater(0.5, true);
    assert!((tip.heater_power_w() - 25.0).abs() < 1e-12);
    for (fault, on, off) in [
        (TipFault::HeaterOpen, 0.0, 0.0),
        (TipFault::PowerStageOn, 50.0, 0.0),
        (TipFault::SecondSwitchClosed, 25.0, 25.0),
        (TipFault::SupplyLow { volts: 6.0 }, 6.25, 0.0),
        (TipFault::SupplyHigh { volts: 24.0 }, 100.0, 0.0),
    ] {
        tip.inject(fault);
        tip.set_heater(0.5, true);
        assert!((tip.heater_power_w() - on).abs() < 1e-12, "{fault:?}");
        tip.set_heater(0.5, false);
        assert!((tip.heater_power_w() - off).abs() < 1e-12, "{fault:?}");
        tip.clear_fault(fault);
    }
    tip.set_heater(0.5, true);
    assert!((tip.heater_power_w() - 25.0).abs() < 1e-12);
}

#[test]
fn a_draught_cools_the_nozzle() {
    let cooled = |fault: Option<TipFault>| {
        let mut tip = hot_tip();
        fault.into_iter().for_each(|fault| tip.inject(fault));
        wait(&mut tip, 20.0);
        tip.nozzle_c()
    };
    let left = (cooled(Some(TipFault::Draught { factor: 8.0 })) - 22.0) / (cooled(None) - 22.0);
    assert!((left - libm::exp(-7.0 * 0.12 / 12.0 * 20.0)).abs() < 1e-9);
}

#[test]
fn the_supply_is_measured_and_a_dip_ends_by_itself() {
    let mut tip = hot_tip();
    let volts = |tip: &mut TipModel| f64::from(tip.sample_supply().unwrap()) / 4095.0 * 36.3;
    assert!((volts(&mut tip) - 12.0).abs() < 0.01);
    tip.inject(TipFault::SupplyDip { volts: 9.0, seconds: 1.0 });
    wait(&mut tip, 0.9);
    assert!((volts(&mut tip) - 9.0).abs() < 0.01);
    wait(&mut tip, 0.2);
    assert!((volts(&mut tip) - 12.0).abs() < 0.01);
    assert_eq!(tip.faults().iter().count(), 0);
}

#[test]
fn both_index_sensor_faults_are_simulated() {
    let mut tip = hot_tip();
    let seen = |tip: &mut TipModel| (0..3200).filter(|_| (tip.step(Motor::Head), tip.on_index()).1).count();
    assert_eq!(seen(&mut tip), 44);
    tip.inject(TipFault::IndexDead);
    assert_eq!(seen(&mut tip), 0);
    tip.clear_fault(TipFault::IndexDead);
    tip.inject(TipFault::IndexStuck);
    assert_eq!(seen(&mut tip), 3200);
    assert!(!tip.index_follows());
}

#[test]
fn a_head_slips_once_and_a_blocked_head_does_not_move() {
    let mut tip = hot_tip();
    let after = |tip: &mut TipModel, steps| {
        (0..steps).for_each(|_| tip.step(Motor::Head));
        (tip.head_position(), tip.head_slip())
    };
    assert_eq!(after(&mut tip, 100), (100, 0));
    tip.inject(TipFault::HeadLosesSteps { steps: 10 });
    assert_eq!(after(&mut tip, 100), (190, -10));
    tip.clear_fault(TipFault::HeadLosesSteps { steps: 10 });
    tip.inject(TipFault::HeadGainsSteps { steps: 30 });
    assert_eq!(after(&mut tip, 100), (320, 20));
    for fault in [TipFault::HeadBlocked, TipFault::DriverFault] {
        let before = tip.head_position();
        tip.inject(fault);
        assert_eq!(tip.driver_fault(), fault == TipFault::DriverFault);
        assert_eq!(after(&mut tip, 50).0, before);
        tip.clear_fault(fault);
    }
    assert_eq!(after(&mut tip, 1), (321, -80));
}

#[test]
fn the_emergency_stop_is_only_an_input() {
    let mut tip = hot_tip();
    tip.set_heater(0.5, true);
    tip.inject(TipFault::EmergencyStop);
    assert!(tip.is_emergency_stop_pressed() && tip.heater_power_w() > 0.0);
    tip.clear_fault(TipFault::EmergencyStop);
    assert!(!tip.is_emergency_stop_pressed());
}

#[test]
fn every_fault_can_come_and_go_at_any_time() {
    let mut tip = hot_tip();
    for fault in TipFault::ALL {
        tip.inject(fault);
        feed(&mut tip, 3);
        tip.step(Motor::Head);
        tip.clear_fault(fault);
    }
    assert_eq!(tip.faults().iter().count(), 0);
    assert!(tip.sample_thermistor().is_some() && tip.gravity().is_some());
}
