//! Tests of the check of the index mark, with lost steps and failing sensors.

use super::*;

/// Lays turns with a fault at the beginning of the second one. Returns the report of the fault, and the number of turns
/// that were laid after it.
fn index_fault(robot: &Robot, fault: impl Fn(&World)) -> (Option<Report>, usize) {
    index_fault_at(0.0, robot, fault)
}

/// Lays turns as [`index_fault`] does, with the fault after a share of the second turn.
fn index_fault_at(share: f64, robot: &Robot, fault: impl Fn(&World)) -> (Option<Report>, usize) {
    let turns = turns(robot, &layers(robot, 5, 0.5));
    let mut rig = Rig::homed(robot.clone());
    let (first, none) = rig.lay(turns[..1].iter().copied());
    assert_eq!((first.len(), none), (1, None));
    rig.handover.submit(Move::Lay(turns[1]));
    rig.run((f64::from(turns[1].ticks) * share) as u64);
    assert_eq!(rig.handover.pop_report(), None);
    fault(&rig.world);
    let (laid, report) = match rig.report() {
        Report::Laid(_) => {
            let (more, report) = rig.lay(turns[2..].iter().copied());
            (1 + more.len(), report)
        }
        other => (0, Some(other)),
    };
    if report.is_some() {
        assert!(!rig.energised(), "the engine releases by itself");
        rig.run(1000);
    }
    (report, laid)
}

#[test]
fn lost_and_gained_steps_are_detected_within_one_turn() {
    for (strategy, turning) in ALL {
        let robot = robot_a_with(strategy, turning);
        // The tolerance of 2 degrees is 18 steps, and two samples must contradict the position.
        for steps in [20, 21, 25, 30, 44, 60, 61, 62, 63, 64, 100, 200, 320, 321, 399, 400, 1600, 3000] {
            for lost in [steps, -steps] {
                let (report, laid) = index_fault(&robot, |world| world.lost.set(lost));
                assert_eq!(report, Some(Report::HeadStepsLost), "{lost} lost, {turning:?}");
                assert!(laid <= 1, "{lost} lost: noticed after {laid} more layers");
                // If the steps are lost during a turn, the turn may end before the mark comes.
                let (report, laid) = index_fault_at(0.5, &robot, |world| world.lost.set(lost));
                assert!(
                    matches!(report, Some(Report::HeadStepsLost | Report::IndexMissing)),
                    "{lost} lost: {report:?}"
                );
                assert!(laid <= 2, "{lost} lost: noticed after {laid} more layers");
            }
        }
        for lost in [0, 8, -8, 18, -18] {
            assert_eq!(index_fault(&robot, |world| world.lost.set(lost)), (None, 4), "{lost} are within the tolerance");
        }
    }
}

#[test]
fn a_narrow_mark_is_checked() {
    // One mark is three steps wide with a tolerance of one. The other is narrower than its tolerances.
    let coarse = |steps, width, tolerance| {
        with(|description| {
            description.head.steps_per_turn = steps;
            description.head.index_width_deg = width;
            description.head.index_tolerance_deg = tolerance;
        })
    };
    for (robot, tolerance) in [(coarse(200, 5.0, 2.0), 1), (coarse(3200, 2.0, 2.0), 18)] {
        for steps in [tolerance + 2, 60, 100] {
            for lost in [steps, -steps] {
                let (report, laid) = index_fault(&robot, |world| world.lost.set(lost));
                assert_eq!((report, laid <= 1), (Some(Report::HeadStepsLost), true), "{lost} {laid}");
            }
        }
        for lost in [tolerance, -tolerance] {
            assert_eq!(index_fault(&robot, |world| world.lost.set(lost)), (None, 4));
        }
        assert_eq!(index_fault(&robot, |world| world.sensor.set(Sensor::Dead)).0, Some(Report::IndexMissing));
        assert_eq!(index_fault(&robot, |world| world.sensor.set(Sensor::Stuck)).0, Some(Report::IndexStuck));
    }
    // With a coarse head, 8 steps of 200 are 14 degrees.
    for lost in (8..=192).step_by(8) {
        let (report, _) = index_fault(&coarse(200, 5.0, 2.0), |world| world.lost.set(lost));
        assert_eq!(report, Some(Report::HeadStepsLost), "{lost}");
    }
}

#[test]
fn a_mark_at_the_boundary_between_turns_is_checked() {
    for turning in [HeadRotation::Continuous, HeadRotation::Alternate] {
        for angle in [0.0, -5.0, -2.0, 1.0, 359.9] {
            let robot = with(|description| {
                description.motion.turning = turning;
                description.head.index_angle_deg = angle;
            });
            assert_eq!(index_fault(&robot, |_| {}), (None, 4), "{angle}");
            for lost in [-400, -25, 25, 400] {
                let (report, _) = index_fault(&robot, |world| world.lost.set(lost));
                assert_eq!(report, Some(Report::HeadStepsLost), "{lost} lost, mark at {angle}, {turning:?}");
            }
        }
    }
}

#[test]
fn dead_and_stuck_sensors_are_distinguished_from_lost_steps() {
    for (strategy, turning) in ALL {
        let robot = robot_a_with(strategy, turning);
        let (report, laid) = index_fault(&robot, |world| world.sensor.set(Sensor::Dead));
        assert_eq!((report, laid <= 1), (Some(Report::IndexMissing), true));
        let (report, laid) = index_fault(&robot, |world| world.sensor.set(Sensor::Stuck));
        assert_eq!((report, laid), (Some(Report::IndexStuck), 0));
    }
}

#[test]
fn a_single_disturbed_sample_raises_no_alarm() {
    let robot = robot_a();
    let mark = -320;
    for place in [0, 100, 1600, mark - 20, mark - 10, mark, mark + 20, mark + 21, mark + 43, mark + 60, mark + 63] {
        assert_eq!(
            index_fault(&robot, |world| world.sensor.set(Sensor::Disturbed { from: place, steps: 1 })),
            (None, 4),
            "{place}"
        );
    }
    for place in [100, 1600, mark + 20] {
        let (report, _) = index_fault(&robot, |world| world.sensor.set(Sensor::Disturbed { from: place, steps: 2 }));
        assert_eq!(report, Some(Report::HeadStepsLost), "{place}");
    }
}

#[test]
fn homing_reports_the_problem_of_the_mark() {
    for (sensor, report, max) in
        [(Sensor::Dead, Report::IndexNotFound, 4800), (Sensor::Stuck, Report::IndexStuck, 44 + 18)]
    {
        let mut rig = Rig::new(robot_a());
        rig.world.sensor.set(sensor);
        assert_eq!(rig.order(Move::Home(rig.homing())), report);
        assert!(!rig.energised() && rig.moved(HEAD) <= max, "{} steps", rig.moved(HEAD));
    }
    // The head starts within the mark and turns round once more.
    let mut rig = Rig::new(robot_a());
    rig.world.lost.set(320 - 20);
    assert_eq!(rig.order(Move::Home(rig.homing())), Report::Homed);
    assert_eq!((rig.moved(HEAD) - 300) % 3200, 0);
}
