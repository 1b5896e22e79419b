//! Test of all interleavings of the controller and the step interrupt around the end of a turn.
//!
//! The step interrupt occurs before each access of the controller to the mailbox, also between the accesses within one
//! function. The tick of that interrupt is the last one of a turn, the one after it, or the first one of the next turn.
//! In that tick a pin may fail, or the emergency stop may be pressed for that tick alone. Afterwards the board must
//! know how far the head has turned, to a sector, and it must have noticed the failure and the emergency stop.

use std::format;
use std::vec::Vec;

use growbot_core::link::message::{Cancel, Fault, Message, State, Status};

use super::bench::{Bench, WARM};
use super::requests::{PLAN, bends, stop};
use super::tip::{EMERGENCY_STOP, FILAMENT_MOTION};
use crate::safety::transitions::Event;
use crate::testing::{FakePins, fast_robot, number_from_environment};

/// Number of layers that are laid before the turn at whose end the interrupt occurs.
const LAID: usize = 2;

/// The work of the main loop that the step interrupt interrupts.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Work {
    Poll,
    Stop,
    Cancel,
    Fault,
    LinkStop,
}

/// The change of the pins for the first tick of the interrupt.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Change {
    Nothing,
    /// The pin of the encoder cannot be read in this tick.
    Failure,
    /// The emergency stop is pressed for this tick.
    Press,
}

const WORKS: [Work; 5] = [Work::Poll, Work::Stop, Work::Cancel, Work::Fault, Work::LinkStop];
const CHANGES: [Change; 3] = [Change::Nothing, Change::Failure, Change::Press];

impl Change {
    fn apply(self, pins: &FakePins, begins: bool) {
        match self {
            Self::Nothing => {}
            Self::Failure if begins => pins.fail(FILAMENT_MOTION),
            Self::Failure => pins.repair(FILAMENT_MOTION),
            Self::Press => pins.set(EMERGENCY_STOP, begins),
        }
    }
}

impl Work {
    fn act(self, bench: &mut Bench) {
        match self {
            Self::Poll => bench.poll(),
            Self::Stop => drop(bench.accepted(&stop())),
            Self::Cancel => drop(bench.accepted(&Message::Cancel(Cancel { plan_id: PLAN }))),
            Self::Fault => bench.fail(Fault::Hardware),
            Self::LinkStop => {
                bench.call_emergency_stop();
                bench.poll();
            }
        }
    }
}

/// Returns a bench whose board lays layers, and the position of its head at the beginning of the first layer, steps.
/// The board has neither heated nor homed.
fn growing() -> (Bench, i64) {
    let mut bench = Bench::greeted(fast_robot(), WARM);
    bench.begin(20);
    bench.hand_over(0, &bends(20));
    for event in [Event::Start, Event::TemperatureReached, Event::Homed] {
        assert!(bench.controller.apply_event(event));
    }
    let head = bench.motors.moved.head;
    bench.run_until(10.0, |bench| bench.controller.layers_laid() == LAID as u32);
    (bench, head)
}

/// Returns the number of ticks from the moment at which [`growing`] returns to the end of the current turn.
fn ticks_to_end() -> u64 {
    let (mut bench, _) = growing();
    let from = bench.ticks();
    while !bench.has_report() {
        bench.run_ticks(1);
        if bench.ticks() % 200 == 0 && !bench.has_report() {
            bench.poll();
        }
    }
    bench.ticks() - from
}

struct Trial {
    work: Work,
    change: Change,
    /// Number of ticks between the last tick of the turn and the work; -1 is the tick before the last one.
    after_end: i64,
    points: Vec<usize>,
}

impl Trial {
    /// Runs the trial and checks its result. Returns the number of points at which the interrupt can occur in the work.
    fn run(&self, to_end: u64) -> usize {
        let (mut bench, start) = growing();
        let from = bench.ticks();
        let until = from + to_end.saturating_add_signed(self.after_end);
        while bench.ticks() < until {
            bench.run_ticks(1);
            if bench.ticks() % 200 == 0 && !bench.has_report() {
                bench.poll();
            }
        }
        let change = self.change;
        let begun = bench.ticks();
        let passed =
            bench.preempt(&self.points, move |pins, begins| change.apply(pins, begins), |bench| self.work.act(bench));
        assert_eq!(bench.ticks(), begun);
        if self.points.iter().any(|point| *point > passed) {
            return passed;
        }
        bench.run_ticks(3);
        bench.run(0.03);
        let is_changed = self.change != Change::Nothing && !self.points.is_empty();
        if self.work == Work::Poll && !is_changed {
            bench.accepted(&stop());
            bench.run(0.03);
        }
        self.check(&mut bench, start);
        passed
    }

    fn check(&self, bench: &mut Bench, start: i64) {
        let what =
            format!("{:?}, {:?}, {} after the end, at {:?}", self.work, self.change, self.after_end, self.points);
        let status = bench.status();
        let states = bench.states();
        let is_changed = !self.points.is_empty();
        let expected = match (self.work, self.change) {
            (_, Change::Failure) if is_changed => &[State::Fault, State::EmergencyStop][..],
            (Work::Fault, _) => &[State::Fault],
            (_, Change::Press) if is_changed => &[State::EmergencyStop],
            (Work::LinkStop, _) => &[State::EmergencyStop],
            (Work::Cancel, _) => &[State::Idle],
            (Work::Poll | Work::Stop, _) => &[State::Stopped],
        };
        assert!(expected.contains(&status.state), "{:?}, {states:?}: {what}", status.state);
        if self.work != Work::LinkStop && self.change == Change::Failure && is_changed {
            assert_eq!(status.state, State::Fault, "{what}");
        }
        if self.work != Work::Cancel {
            Self::check_position(bench, &status, start, &what);
        }
    }

    /// Checks that the status states the position of the head, to a sector.
    fn check_position(bench: &Bench, status: &Status, start: i64, what: &str) {
        let turn = i64::from(bench.robot.description().head.steps_per_turn);
        let moved = bench.motors.moved.head - start;
        let over = moved - i64::from(status.layers_laid) * turn;
        let position = format!(
            "{} laid, {:?}, and {moved} steps of {turn} a turn: {what}",
            status.layers_laid, status.interrupted
        );
        match status.interrupted {
            None => assert_eq!(over, 0, "{position}"),
            Some(interrupted) => {
                let step = |sectors: u8| i64::from(sectors) * turn / 64;
                assert!((step(interrupted.min)..=step(interrupted.max) + 1).contains(&over), "{position}");
                // If no step of this layer was made, the layer may have begun, but no sector is complete.
                assert!(over > 0 || interrupted.min == 0, "{position}");
            }
        }
    }
}

#[test]
fn the_board_knows_the_heads_position_wherever_the_step_interrupt_occurs() {
    let ticks = number_from_environment("GROWBOT_PREEMPTIONS", 1);
    let to_end = ticks_to_end();
    let mut trials = 0;
    for work in WORKS {
        for change in CHANGES {
            for after_end in -1..=1 {
                let trial = |points: &[usize]| Trial { work, change, after_end, points: points.to_vec() }.run(to_end);
                let mut points = trial(&[]);
                let mut first = 1;
                while first <= points {
                    points = points.max(trial(&[first]));
                    trials += 1;
                    let mut second = first + 1;
                    let mut last = points;
                    while ticks > 1 && second <= last {
                        last = last.max(trial(&[first, second]));
                        trials += 1;
                        second += 1;
                    }
                    first += 1;
                }
            }
        }
    }
    std::println!("{trials} interleavings");
    assert!(trials > 1000, "{trials}");
}

#[test]
fn a_layer_that_has_not_begun_is_not_interrupted() {
    // The turn has ended, and the engine begins the next one in the tick after the stop.
    let to_end = ticks_to_end();
    let (mut bench, start) = growing();
    let from = bench.ticks();
    while bench.ticks() < from + to_end {
        bench.run_ticks(1);
        if bench.ticks() % 200 == 0 && !bench.has_report() {
            bench.poll();
        }
    }
    bench.accepted(&stop());
    let status = bench.status();
    assert_eq!((status.layers_laid, status.interrupted), (LAID as u32 + 1, None));
    bench.run(0.1);
    Trial::check_position(&bench, &status, start, "at rest");
}
