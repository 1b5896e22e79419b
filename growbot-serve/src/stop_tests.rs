//! Tests of stops and pauses of robots that do not receive them at once, with longer sequences of steps than the pairs
//! that `stop_model` runs.

use growbot_client::robot_command::{CommandOutcome, RobotCommand, StopOutcome};
use growbot_core::link::message::{PauseCause, State as BoardState};

use super::commands::run_command;
use super::fake_board::LineState;
use super::stop_model::{Case, Step, service};

/// Runs a sequence of steps, and checks it by the model. Returns the board's state and the cause of its pause at the
/// end.
fn run(steps: &[Step]) -> (BoardState, PauseCause) {
    let directory = tempfile::tempdir().unwrap();
    let service = service(&directory);
    let mut case = Case::new(&service, "lab".to_owned());
    case.wait_for_connection();
    for step in steps {
        case.step(*step);
        if *step == Step::LineBack {
            // Before the service has connected and corrected its list of jobs, it refuses orders.
            case.wait_for_connection();
        }
        case.settle();
    }
    let violations = case.finish();
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

/// A board that the stop has not reached keeps growing until the service, after the withdrawal of the stop, pauses it.
/// On a silent line, the stop may already be on its way when it is withdrawn, and still stop the board. A stop without a
/// response is followed by the emergency stop.
#[test]
fn a_growth_whose_stop_was_withdrawn_is_paused() {
    for line in [Step::LineLost, Step::LineSilent] {
        for restarts in [&[][..], &[Step::ServiceRestarts]] {
            let steps = [&[Step::Grow, line, Step::Stop, Step::WithdrawStop], restarts].concat();
            let end = run(&steps);
            let is_off = matches!(end.0, BoardState::Stopped | BoardState::EmergencyStop);
            let is_stopped = line == Step::LineSilent && is_off;
            assert!(is_stopped || end == (BoardState::Paused, PauseCause::Requested), "{steps:?}: {end:?}");
        }
    }
}

/// A growth gives up a line that is lost while an emergency stop is not confirmed, so that the next connection delivers
/// the stop.
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

/// On a silent line, the service repeats the `Start` of an order to continue. A later pause voids that order and is
/// delivered.
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

/// A person's order to continue stays valid if the board parks before the order reaches it. A later pause voids the
/// order.
#[test]
fn a_continue_that_was_given_before_the_board_parked_reaches_it() {
    for before in [&[Step::Grow][..], &[Step::Grow, Step::Pause], &[Step::Grow, Step::BoardParks]] {
        let steps = [before, &[Step::LineSilent, Step::Continue, Step::BoardParks]].concat();
        assert_eq!(run(&steps).0, BoardState::Growing, "{steps:?}");
        let steps = [&steps[..], &[Step::Pause]].concat();
        assert_eq!(run(&steps).0, BoardState::Parked, "{steps:?}");
    }
}

/// The user has to learn that the board needs to be cleared.
#[test]
fn a_stop_reports_that_it_became_an_emergency_stop() {
    let directory = tempfile::tempdir().unwrap();
    let service = service(&directory);
    let case = Case::new(&service, "lab".to_owned());
    case.wait_for_connection();
    for (ignores, state, outcome) in [
        (false, BoardState::Stopped, StopOutcome::ByRequest),
        (true, BoardState::EmergencyStop, StopOutcome::ByEmergencyStop),
    ] {
        case.line.board().ignores_stop = ignores;
        let permit = case.worker.signal().permit();
        let stopped = run_command(&case.worker, RobotCommand::Stop, &permit).unwrap();
        assert_eq!(stopped, CommandOutcome::Stopped(outcome));
        assert_eq!(case.line.board().state, state);
    }
}

/// The board reports the gains once, and forgets them with the session.
#[test]
fn the_gains_of_a_tuning_that_ended_without_a_connection_are_lost() {
    let directory = tempfile::tempdir().unwrap();
    let service = service(&directory);
    let mut case = Case::new(&service, "lab".to_owned());
    case.wait_for_connection();
    case.step(Step::Tune);
    case.line.board().line = LineState::Missing;
    super::stop_model::wait_until(|| case.worker.status().connection_error.is_some());
    {
        let mut board = case.line.board();
        (board.state, board.line) = (BoardState::Idle, LineState::Up);
    }
    super::stop_model::wait_until(|| case.worker.status().command_error.is_some_and(|error| error.contains("lost")));
    // The next tuning is a new one, and its cancellation loses nothing.
    case.step(Step::Tune);
    assert_eq!(case.worker.status().command_error, None);
    case.step(Step::Cancel);
    assert_eq!(case.worker.ensure_idle().map_err(|error| error.to_string()), Ok(()));
    case.settle();
    assert_eq!(case.worker.status().command_error, None);
}

/// The service opens no session with the board of another robot, but delivers an unconfirmed stop to it.
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
        // Only the robot's own thread can deliver the stop, because the thread that sends emergency stops cannot
        // connect.
        let permit = case.worker.signal().permit();
        assert!(run_command(&case.worker, stop, &permit).is_err());
        case.line.board().line = LineState::Up;
        super::stop_model::wait_until(|| case.worker.status().pending_stop.is_none());
        assert_eq!(case.line.board().state, state, "{stop:?}");
        assert!(case.worker.status().connection_error.is_some());
    }
}
