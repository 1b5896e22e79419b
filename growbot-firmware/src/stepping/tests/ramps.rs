//! Tests of ramps, and of turns that follow each other without a stop.

use super::*;

#[test]
fn turns_without_ramps_follow_each_other_without_a_gap() {
    let robot = robot_a_with(FeedStrategy::Feed, HeadRotation::Continuous);
    let mut rig = Rig::homed(robot.clone());
    rig.run(100);
    let began = rig.world.now.get();
    rig.lay(turns(&robot, &layers(&robot, 5, 0.5)));
    // The directions need one tick to settle.
    assert_eq!(rig.world.now.get() - began, 5 * 72_000 + 1);
}

/// Returns the positions of a motor at regular times, in turns of the head or mm of filament, from the rising edges of
/// its step pin.
fn positions(rises: &[Rise], motor: usize, steps_per_unit: f64, every: u64, until: u64) -> Vec<f64> {
    let (mut rises, mut at) = (rises.iter().filter(|rise| rise.motor == motor).peekable(), 0_i64);
    (0..until / every)
        .map(|i| {
            while let Some(rise) = rises.next_if(|rise| rise.tick <= i * every) {
                at += if rise.backwards { -1 } else { 1 };
            }
            at as f64 / steps_per_unit
        })
        .collect()
}

/// Asserts that the speed over any time changes by no more than the speed jump and the acceleration allow.
fn assert_limits(rig: &Rig, rises: &[Rise]) {
    let description = rig.robot.description();
    let (head, feed) = (&description.head, &description.feed);
    let hz = f64::from(description.motion.tick_hz);
    let (every, until) = (u64::from(description.motion.tick_hz) / 20, rig.world.now.get());
    for (motor, per_unit, jump, acceleration) in [
        (HEAD, f64::from(head.steps_per_turn), head.speed_jump_turns_per_s, head.acceleration_turns_per_s2),
        (FEED, feed.steps_per_mm, feed.speed_jump_mm_per_s, feed.acceleration_mm_per_s2),
    ] {
        let window = every as f64 / hz;
        let positions = positions(rises, motor, per_unit, every, until);
        let speeds: Vec<f64> = positions.windows(2).map(|pair| (pair[1] - pair[0]) / window).collect();
        assert!(speeds.iter().any(|speed| speed.abs() > 2.0 * jump), "no ramp is needed");
        // Rounding shifts each end of a window by at most a step.
        let grain = 4.0 / per_unit / window;
        for (i, a) in speeds.iter().enumerate() {
            for (n, b) in speeds[i..].iter().enumerate() {
                let limit = jump + acceleration * n as f64 * window + grain;
                assert!((b - a).abs() <= limit, "motor {motor}: {a} to {b} in {n} windows, over {limit}");
            }
        }
    }
}

#[test]
fn ramps_stay_within_the_motor_limits() {
    for (strategy, turning) in ALL {
        let robot = ramping(strategy, turning);
        // Thin and thick layers follow each other, so that the speed of the feed jumps between them.
        let layers = layers(&robot, 8, 0.1);
        let mut rig = Rig::homed(robot.clone());
        rig.record();
        rig.run(5000);
        let began = rig.world.now.get();
        let turns = turns(&robot, &layers);
        let longest: u32 = turns.iter().map(Turn::longest_ticks).sum();
        let (reports, end) = rig.lay(turns);
        assert_eq!((reports.len(), end), (8, None));
        assert!(rig.world.now.get() - began <= u64::from(longest) + 8);
        let took = (rig.world.now.get() - began) as f64 / 20_000.0;
        // Ramps take only a little time.
        assert!(took > 24.5 && took < 33.0, "{took} s for 24 s of layers, {strategy:?} {turning:?}");
        rig.run(5000);
        assert_limits(&rig, &rig.rises());
    }
}

#[test]
fn late_moves_lose_no_step_and_exceed_no_limit() {
    for (strategy, turning) in ALL {
        let robot = ramping(strategy, turning);
        let layers = layers(&robot, 10, 0.2);
        let mut rig = Rig::homed(robot.clone());
        let (head, feed) = (rig.moved(HEAD), rig.moved(FEED));
        rig.record();
        rig.run(5000);
        let (mut laid, mut given) = (0, 0);
        let turns = turns(&robot, &layers);
        while laid < 10 {
            // The next turns arrive in time, then later and later while the engine brakes, then after the end.
            let wait = [50_000, 57_000, 59_000, 61_000, 63_000, 65_000, 67_000, 70_000, 90_000, 1000][given.min(9)];
            if given < 10 {
                rig.handover.submit(Move::Lay(turns[given]));
                given += 1;
            }
            let until = rig.world.now.get() + wait;
            while rig.world.now.get() < until || (given < 10 && !rig.handover.can_accept_move()) {
                if rig.handover.pop_report().is_some() {
                    laid += 1;
                }
                rig.advance(10);
            }
        }
        assert_eq!(rig.moved(FEED) - feed, feed_steps(&layers, &robot));
        assert_eq!((rig.moved(HEAD) - head) % 3200, 0);
        rig.run(5000);
        assert_limits(&rig, &rig.rises());
    }
}
