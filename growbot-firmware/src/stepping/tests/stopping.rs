//! Tests of the step engine with halts, emergency stops, and pins that fail.

use super::*;
use crate::stepping::mailbox::PendingReport;
use crate::stepping::moves::EngineFault;

#[test]
fn an_emergency_stop_releases_at_once_and_blocks_moves_until_noticed() {
    let robot = robot_a();
    let turn = turns(&robot, &layers(&robot, 1, 0.5))[0];
    let mut rig = Rig::homed(robot);
    rig.handover.submit(Move::Lay(turn));
    rig.run(1000);
    rig.handover.submit(Move::Lay(turn));
    rig.world.pressed.set(true);
    rig.run(1);
    assert!(!rig.energised() && rig.handover.is_emergency_stopped() && !rig.handover.can_accept_move());
    assert_eq!(*rig.outputs.0.borrow(), 1, "the heater waits for the main loop");
    rig.world.pressed.set(false);
    let moved = [rig.moved(HEAD), rig.moved(FEED)];
    rig.handover.submit(Move::Lay(turn));
    rig.run(1000);
    assert!(!rig.energised() && rig.handover.is_emergency_stopped(), "it was pressed, however short");
    rig.handover.halt();
    rig.run(2);
    assert!(!rig.handover.is_emergency_stopped() && rig.handover.can_accept_move());
    rig.run(1000);
    assert_eq!([rig.moved(HEAD), rig.moved(FEED)], moved);
    // While the stop is pressed, a halt changes nothing.
    rig.world.pressed.set(true);
    rig.run(1);
    rig.handover.halt();
    rig.run(2);
    assert!(rig.handover.is_emergency_stopped());

    let mut without = Rig::new(with(|description| description.sensors.emergency_stop = None));
    without.world.pressed.set(true);
    without.run(10);
    assert!(!without.handover.is_emergency_stopped());
}

#[test]
fn a_halt_releases_the_motors_at_the_next_tick() {
    let robot = robot_a();
    let turn = turns(&robot, &layers(&robot, 1, 0.5))[0];
    let mut rig = Rig::new(robot);
    assert!(!rig.energised());
    rig.handover.submit(Move::Lay(turn));
    rig.run(1000);
    assert!(rig.energised());
    rig.handover.halt();
    assert_eq!(rig.engine.ticks_to_event(&rig.handover), 1);
    rig.run(1);
    assert!(!rig.energised());
    assert_eq!(rig.engine.ticks_to_event(&rig.handover), u32::MAX);
}

#[test]
fn the_progress_of_a_halted_turn_is_taken_once() {
    let robot = robot_a();
    let turn = turns(&robot, &layers(&robot, 1, 0.5))[0];
    let mut rig = Rig::homed(robot);
    rig.handover.submit(Move::Lay(turn));
    rig.run(1000);
    rig.handover.halt();
    rig.run(1);
    assert!(rig.handover.take_sectors_done().is_some());
    assert_eq!((rig.handover.sectors_done(), rig.handover.take_sectors_done()), (None, None));
}

#[test]
fn an_alarm_is_reported_and_blocks_moves_until_it_is_taken() {
    let mailbox = Mailbox::new();
    assert!(!mailbox.has_report() && mailbox.can_accept_move());
    mailbox.post_alarm(EngineFault::Hardware);
    assert!(mailbox.has_report() && !mailbox.can_accept_move());
    assert_eq!((mailbox.pop_report(), mailbox.pop_report()), (Some(Report::Hardware), None));
    assert!(!mailbox.has_report() && mailbox.can_accept_move());
}

#[test]
fn reports_of_ended_moves_are_dropped_without_the_alarm() {
    let mailbox = Mailbox::new();
    mailbox.post_report(PendingReport::Homed);
    mailbox.post_report(PendingReport::Fed);
    mailbox.post_alarm(EngineFault::Hardware);
    mailbox.discard_ended_moves();
    assert_eq!((mailbox.pop_ended_move(), mailbox.pop_report()), (None, Some(Report::Hardware)));
}

#[test]
fn no_turn_follows_without_a_stop_while_a_report_waits() {
    let robot = robot_a();
    let turn = turns(&robot, &layers(&robot, 1, 0.5))[0];
    let mailbox = Mailbox::new();
    assert!(turn.pace.entry_rate > 0);
    mailbox.submit(Move::Lay(turn));
    assert_eq!(mailbox.next_entry_rate(), turn.pace.entry_rate);
    mailbox.post_report(PendingReport::Homed);
    assert_eq!(mailbox.next_entry_rate(), 0);
}

#[test]
fn feed_rate_is_0_after_the_engine_has_released() {
    let robot = robot_a();
    let turn = turns(&robot, &layers(&robot, 1, 0.5))[0];
    let ends: [fn(&mut Rig); 3] = [
        |rig| rig.handover.halt(),
        |rig| rig.world.pressed.set(true),
        // The next step of the head finds the mark outside its position.
        |rig| rig.world.sensor.set(Sensor::Stuck),
    ];
    for (number, end) in ends.into_iter().enumerate() {
        let mut rig = Rig::homed(robot.clone());
        assert_eq!(rig.handover.feed_steps_per_tick(), 0.0);
        rig.handover.submit(Move::Lay(turn));
        rig.run(1000);
        assert!(rig.handover.feed_steps_per_tick() > 0.0);
        end(&mut rig);
        rig.run(1_000_000);
        assert!(!rig.energised());
        assert_eq!(rig.handover.feed_steps_per_tick(), 0.0, "end {number}");
    }
}

#[test]
fn a_pin_error_switches_everything_off() {
    let robot = robot_a();
    let turn = turns(&robot, &layers(&robot, 1, 0.5))[0];
    for broken in [0, 1, 2, 3, 4, 5, 6, 7, 8] {
        let (pins, handover) = (FakePins::default(), Mailbox::new());
        let axis =
            |at: usize| StepperPins { step: pins.pin(at), direction: pins.pin(at + 1), enable: pins.pin(at + 2) };
        let inputs = EngineInputs { index: pins.pin(6), filament_motion: pins.pin(7), emergency_stop: pins.pin(8) };
        let outputs = FakeOutputs::default();
        let mut engine = Engine::new(axis(0), axis(3), inputs, outputs.clone(), EngineConfig::for_robot(&robot));
        engine.tick(&handover);
        assert_eq!(handover.pop_report(), None);
        pins.fail(broken);
        handover.submit(Move::Lay(turn));
        for _ in 0..1000 {
            engine.tick(&handover);
        }
        assert_eq!(handover.pop_report(), Some(Report::Hardware), "pin {broken}");
        assert!(*outputs.0.borrow() > 0, "pin {broken}: the heater waits for the main loop");
        assert!([2, 5].into_iter().all(|enable| enable == broken || !pins.level(enable)));
    }
}
