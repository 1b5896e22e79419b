//! Tests of layers and filament moves, with exact step counts.

use super::*;

#[test]
fn five_thousand_layers_are_laid_with_exact_step_counts() {
    for (strategy, turning) in ALL {
        let robot = robot_a_with(strategy, turning);
        let layers = layers(&robot, 1250, 0.5);
        let mut rig = Rig::homed(robot.clone());
        let (head, feed) = (rig.moved(HEAD), rig.moved(FEED));
        let (reports, end) = rig.lay(turns(&robot, &layers));
        assert_eq!((reports.len(), end), (layers.len(), None));
        assert_eq!(rig.moved(FEED) - feed, feed_steps(&layers, &robot));
        let turned = if turning == HeadRotation::Alternate { 0 } else { 1250 * 3200 };
        assert_eq!(rig.moved(HEAD) - head, turned);
        assert!(reports.iter().all(|report| report.head == 3200));
        for (report, bytes) in reports.iter().zip(&layers) {
            let layer = decode(bytes);
            let steps = layer.height * robot.feed_steps_per_length();
            let edge = |i: usize| steps * layer.material_fraction(TAU * i as f64 / SECTORS as f64, robot.tip_radius());
            for (i, made) in report.feed.iter().enumerate() {
                let closed_form = edge(i + 1) - edge(i);
                let off = (f64::from(*made) - closed_form).abs();
                // Rounding adds up to a step. The lean that the previous layers lack is at most a tenth of a step in a
                // sector.
                assert!(off <= (0.01 * closed_form).max(1.1), "sector {i}: {made} for {closed_form}");
            }
        }
    }
}

#[test]
fn feed_strategies_and_directions_lay_the_same_plastic_per_sector() {
    for at in [robot_a_with, ramping] {
        let layers = layers(&at(FeedStrategy::Feed, HeadRotation::Continuous), 40, 0.02);
        let laid = ALL.map(|(strategy, turning)| {
            let robot = at(strategy, turning);
            let mut rig = Rig::homed(robot.clone());
            let (reports, end) = rig.lay(turns(&robot, &layers));
            assert_eq!(end, None);
            reports
        });
        assert!(laid.iter().all(|reports| reports.len() == 40 && *reports == laid[0]));
    }
}

#[test]
fn skipping_idle_ticks_changes_nothing() {
    for robot in ALL.map(|(strategy, turning)| ramping(strategy, turning)).into_iter().chain([robot_a()]) {
        let runs = [false, true].map(|skipping| {
            let mut rig = Rig::new(robot.clone());
            rig.record();
            rig.skipping = skipping;
            let mut reports = std::vec![rig.order(Move::Home(rig.homing()))];
            reports.push(rig.order(Move::Feed(AxisMove {
                steps: 40,
                direction: MotorDirection::Backward,
                ticks_per_step: 7,
                changes_filament: false,
            })));
            rig.run(1000);
            reports.push(rig.order(Move::Feed(AxisMove {
                steps: 40,
                direction: MotorDirection::Forward,
                ticks_per_step: 9,
                changes_filament: false,
            })));
            let turns = turns(&robot, &layers(&robot, 6, 0.3));
            let (laid, end) = rig.lay(turns[..3].iter().copied());
            rig.run(12_345);
            // The next two turns arrive while this one is laid: the second one late, while the engine brakes.
            rig.handover.submit(Move::Lay(turns[3]));
            rig.run(u64::from(turns[3].ticks));
            rig.handover.submit(Move::Lay(turns[4]));
            reports.push(rig.report());
            reports.push(rig.report());
            rig.run(100);
            (rig.rises(), reports, laid, end, rig.world.now.get(), rig.handover.filament_pulses())
        });
        assert!(runs[0].0.len() > 10_000);
        assert_eq!(runs[0], runs[1]);
    }
}

#[test]
fn a_pending_report_loses_no_steps() {
    let robot = ramping(FeedStrategy::Feed, HeadRotation::Continuous);
    let layers = layers(&robot, 3, 0.5);
    let turns = turns(&robot, &layers);
    let mut rig = Rig::homed(robot.clone());
    let feed = rig.moved(FEED);
    rig.handover.submit(Move::Lay(turns[0]));
    rig.run(100);
    rig.handover.submit(Move::Lay(turns[1]));
    rig.run(150_000);
    rig.handover.submit(Move::Lay(turns[2]));
    rig.run(150_000);
    // The second turn is laid, and its report waits for the controller.
    assert!(!rig.handover.can_accept_move());
    assert_eq!(rig.engine.ticks_to_event(&rig.handover), u32::MAX);
    for _ in 0..3 {
        assert!(matches!(rig.report(), Report::Laid(_)));
    }
    assert_eq!(rig.moved(FEED) - feed, feed_steps(&layers, &robot));
}

#[test]
fn alternating_turns_do_not_wind_up_the_wires() {
    let robot = robot_a_with(FeedStrategy::Speed, HeadRotation::Alternate);
    let turns = turns(&robot, &layers(&robot, 4, 0.5));
    let mut rig = Rig::homed(robot);
    rig.record();
    let head = rig.moved(HEAD);
    rig.lay(turns.clone());
    assert_eq!(rig.moved(HEAD), head);
    let rises = rig.rises();
    let backwards = |motor: usize| rises.iter().filter(|rise| rise.motor == motor && rise.backwards).count();
    assert_eq!((backwards(HEAD), backwards(FEED)), (2 * 3200, 0));
    // In reverse the last sector comes first.
    assert_eq!([1, 2].map(|turn| turns[turn].direction), [MotorDirection::Backward, MotorDirection::Forward]);
}

#[test]
fn feed_moves_are_exact_in_both_directions() {
    use MotorDirection::{Backward, Forward};
    let mut rig = Rig::new(robot_a());
    for (steps, direction) in [(180, Backward), (180, Forward), (1, Backward), (0, Backward), (7, Forward)] {
        let before = rig.moved(FEED);
        let began = rig.world.now.get();
        assert_eq!(
            rig.order(Move::Feed(AxisMove { steps, direction, ticks_per_step: 8, changes_filament: false })),
            Report::Fed
        );
        let moved = i64::from(steps) * if direction == Backward { -1 } else { 1 };
        assert_eq!(rig.moved(FEED) - before, moved);
        assert_eq!(rig.world.now.get() - began, u64::from(steps + 1) * 8 + 1);
    }
    assert_eq!(rig.moved(HEAD), 0);
}

#[test]
fn the_engine_counts_filament_pulses_and_detects_the_index() {
    let robot = robot_a();
    let mut rig = Rig::homed(robot.clone());
    let layers = layers(&robot, 2, 0.5);
    rig.lay(turns(&robot, &layers));
    assert_eq!(i64::from(rig.handover.filament_pulses()), (feed_steps(&layers, &robot) + 50) / 100);
    let before = rig.handover.filament_pulses();
    for steps in [180, 333, 7] {
        for direction in [MotorDirection::Backward, MotorDirection::Forward] {
            rig.order(Move::Feed(AxisMove { steps, direction, ticks_per_step: 8, changes_filament: false }));
            let pulled = before.wrapping_sub(rig.handover.filament_pulses());
            let is_right =
                if direction == MotorDirection::Backward { pulled.abs_diff(steps / 100) <= 1 } else { pulled == 0 };
            assert!(is_right, "{steps}: {pulled}");
        }
    }
    assert!(!rig.handover.on_index());
    rig.world.sensor.set(Sensor::Stuck);
    rig.run(1);
    assert!(rig.handover.on_index());
}
