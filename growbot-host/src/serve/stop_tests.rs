//! Stops and pauses of robots that are not reached at once, as sequences of the model that are longer than its pairs.

use growbot_core::link::message::{PauseCause, State as BoardState};

use super::commands::{RobotCommand, run_command};
use super::fake_board::LineState;
use super::stop_model::{Case, Step, service};

/// Runs a sequence. Returns the state and pause of the board at its end.
fn run(steps: &[Step]) -> (BoardState, PauseCause) {
    let directory = tempfile::tempdir().unwrap();
    let service = service(&directory);
    let mut case = Case::new(&service, "lab".to_owned());
    let violations = case.run(steps.iter().copied());
    assert!(violations.is_empty(), "{steps:?}: {violations:?}");
    let board = case.line.board();
    (board.state, board.pause)
}

#[test]
fn a_stop_of_a_robot_that_is_not_reached_outlives_the_service() {
    for line in [Step::LineLost, Step::LineSilent] {
        for (stop, state) in [(Step::Stop, BoardState::Stopped), (Step::EmergencyStop, BoardState::EmergencyStop)] {
            for restarts in [&[][..], &[Step::ServiceRestarts], &[Step::ServiceRestarts, Step::ServiceRestarts]] {
                let steps = [&[Step::Grow, line, stop], restarts].concat();
                assert_eq!(run(&steps).0, state, "{steps:?}");
            }
        }
    }
}

/// Without a stop, the board grows on. The service does not start it again by itself, but pauses it. On a silent line
/// the stop may be on its way when it is withdrawn, and reach the board.
#[test]
fn a_growth_whose_stop_was_withdrawn_is_paused() {
    for line in [Step::LineLost, Step::LineSilent] {
        for restarts in [&[][..], &[Step::ServiceRestarts]] {
            let steps = [&[Step::Grow, line, Step::Stop, Step::WithdrawStop], restarts].concat();
            let end = run(&steps);
            let is_stopped = line == Step::LineSilent && end.0 == BoardState::Stopped;
            assert!(is_stopped || end == (BoardState::Paused, PauseCause::Requested), "{steps:?}: {end:?}");
        }
    }
}

/// A growth leaves a line that is lost while its emergency stop waits, so that a new connection delivers the stop.
#[test]
fn an_emergency_stop_of_a_silent_robot_is_delivered_after_its_line_is_lost() {
    assert_eq!(run(&[Step::Grow, Step::LineSilent, Step::EmergencyStop, Step::LineLost]).0, BoardState::EmergencyStop);
}

#[test]
fn a_pause_of_a_silent_robot_outlives_the_service() {
    let paused = (BoardState::Paused, PauseCause::Requested);
    assert_eq!(run(&[Step::Grow, Step::LineSilent, Step::Pause, Step::ServiceRestarts]), paused);
    // The newest order counts, and a pause that was carried out is not repeated.
    for steps in [
        &[Step::Grow, Step::Pause, Step::Continue, Step::ServiceRestarts][..],
        &[Step::Grow, Step::LineSilent, Step::Pause, Step::LineBack, Step::Continue, Step::ServiceRestarts],
        &[Step::Grow, Step::LineSilent, Step::Pause, Step::Stop, Step::ServiceRestarts, Step::LineBack, Step::Resume],
    ] {
        assert_eq!(run(steps).0, BoardState::Growing, "{steps:?}");
    }
}

/// A pause voids an order to continue whose `Start` is being repeated, and is delivered.
#[test]
fn a_pause_ends_the_repetitions_of_an_earlier_continue() {
    let paused = (BoardState::Paused, PauseCause::Requested);
    let silent = [Step::LineSilent, Step::Continue, Step::Pause];
    for before in [&[Step::Grow][..], &[Step::Grow, Step::Pause]] {
        for after in [&[][..], &[Step::ServiceRestarts], &[Step::LineLost]] {
            let steps = [before, &silent, after].concat();
            assert_eq!(run(&steps), paused, "{steps:?}");
        }
        let steps = [before, &silent, &[Step::Continue]].concat();
        assert_eq!(run(&steps).0, BoardState::Growing, "the newest order counts: {steps:?}");
    }
    assert_eq!(run(&[&[Step::Grow, Step::BoardParks], &silent[..]].concat()).0, BoardState::Parked);
}

/// An order of a person to continue outlives the parking of the board. A later pause voids it.
#[test]
fn a_continue_that_was_given_before_the_board_parked_reaches_it() {
    for before in [&[Step::Grow][..], &[Step::Grow, Step::Pause], &[Step::Grow, Step::BoardParks]] {
        let steps = [before, &[Step::LineSilent, Step::Continue, Step::BoardParks]].concat();
        assert_eq!(run(&steps).0, BoardState::Growing, "{steps:?}");
        let steps = [&steps[..], &[Step::Pause]].concat();
        assert_eq!(run(&steps).0, BoardState::Parked, "{steps:?}");
    }
}

/// A board of another robot gets no session, but it is stopped.
#[test]
fn a_stop_reaches_a_board_of_another_robot() {
    for (stop, state) in
        [(RobotCommand::Stop, BoardState::Stopped), (RobotCommand::EmergencyStop, BoardState::EmergencyStop)]
    {
        let directory = tempfile::tempdir().unwrap();
        let service = service(&directory);
        let case = Case::new(&service, "lab".to_owned());
        case.wait_for_connection();
        case.line.board().line = LineState::Missing;
        super::stop_model::wait_until(|| case.worker.status().connection_error.is_some());
        {
            let mut board = case.line.board();
            (board.is_of_other_robot, board.state) = (true, BoardState::Growing);
        }
        // Only a connection of the robot's own thread delivers it: the line of the stop thread is missing.
        let permit = case.worker.signal().permit();
        assert!(run_command(&case.worker, stop, &permit).is_err());
        case.line.board().line = LineState::Up;
        super::stop_model::wait_until(|| case.worker.status().pending_stop.is_none());
        assert_eq!(case.line.board().state, state, "{stop:?}");
        assert!(case.worker.status().connection_error.is_some());
    }
}
