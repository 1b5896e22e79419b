//! Tests of the list of jobs and of the notices, with a board that is stopped, restarted, parked or disconnected.

use std::fs;
use std::sync::Arc;

use growbot_client::robot_command::RobotCommand;
use growbot_client::stop_signal::StopLevel;
use growbot_core::link::message::State as BoardState;
use growbot_remote::api::{Job, JobState};

use super::commands::{COMMAND_TIMEOUT, run_command};
use super::config::NotifyEntry;
use super::fake_board::LineState;
use super::job_store::JobStore;
use super::notification::NotificationChannel;
use super::robot_error::RobotRequestError;
use super::robot_request::RobotRequest;
use super::service::Service;
use super::stop_model::{Case, Step, service, service_with, wait_until};

/// Returns the latest job of the list.
fn latest(service: &Service) -> Job {
    service.shared.jobs_to_read().latest(1).unwrap().remove(0)
}

fn end_of(service: &Service) -> (JobState, String) {
    let job = latest(service);
    (job.state, job.reason.unwrap_or_default())
}

/// Carries out a step of a test case, and waits until the robot's thread has handled its effect.
fn order(case: &mut Case, step: Step) {
    assert_eq!(case.carry_out(step), Ok(()), "{step:?}");
    case.settle();
}

fn wait_for_end(case: &Case) {
    wait_until(|| case.worker.status().job.is_none());
}

#[test]
fn an_emergency_stop_is_the_reason_of_its_job_also_in_a_list_that_is_rebuilt() {
    for (stop, reason) in [(Step::EmergencyStop, "emergency-stop"), (Step::Stop, "stopped")] {
        let directory = tempfile::tempdir().unwrap();
        let service = service(&directory);
        let mut case = Case::new(&service, "lab".to_owned());
        case.wait_for_connection();
        order(&mut case, Step::Grow);
        order(&mut case, stop);
        wait_for_end(&case);
        let end = (JobState::Interrupted, reason.to_owned());
        assert_eq!(end_of(&service), end);
        let database = service.places.database();
        fs::rename(&database, database.with_extension("old")).unwrap();
        let rebuilt = JobStore::open(&service.places).unwrap().latest(1).unwrap().remove(0);
        assert_eq!((rebuilt.state, rebuilt.reason), (end.0, Some(end.1)));
    }
}

#[test]
fn a_job_that_was_stopped_without_a_connection_names_its_stop() {
    for (stop, reason) in [(Step::EmergencyStop, "emergency-stop, as"), (Step::Stop, "stopped, as")] {
        let directory = tempfile::tempdir().unwrap();
        let service = service(&directory);
        let mut case = Case::new(&service, "lab".to_owned());
        case.wait_for_connection();
        order(&mut case, Step::Grow);
        case.line.board().laid = 6;
        order(&mut case, Step::LineLost);
        wait_until(|| case.worker.status().connection_error.is_some());
        assert!(case.carry_out(stop).is_err());
        order(&mut case, Step::LineBack);
        wait_until(|| latest(&service).state == JobState::Interrupted && latest(&service).laid == 6);
        assert!(end_of(&service).1.starts_with(reason), "{:?}", end_of(&service));
    }
}

#[test]
fn the_list_has_as_many_laid_layers_as_the_board() {
    let directory = tempfile::tempdir().unwrap();
    let service = service(&directory);
    let mut case = Case::new(&service, "lab".to_owned());
    case.wait_for_connection();
    order(&mut case, Step::Grow);
    // The board reports none of these layers.
    case.line.board().laid = 5;
    // The growth waits some seconds on the board's clock for the missing reports, so this does not wait for the response.
    drop(case.worker.raise_stop(StopLevel::Stop));
    wait_for_end(&case);
    assert_eq!(latest(&service).laid, 5);
    order(&mut case, Step::Resume);
    // The board lays two more and stops while the service is down.
    case.line.kill_service();
    (case.line.board().laid, case.line.board().state) = (7, BoardState::Stopped);
    order(&mut case, Step::ServiceRestarts);
    case.wait_for_connection();
    wait_until(|| latest(&service).state == JobState::Interrupted);
    wait_until(|| latest(&service).laid == 7);
}

/// Makes all writes to the list of jobs fail, as a full disk does.
fn fill_disk(service: &Service, is_full: bool) {
    service.shared.jobs().database.pragma_update(None, "query_only", is_full).unwrap();
}

#[test]
fn the_end_of_a_job_is_recorded_once_the_disk_has_room() {
    let directory = tempfile::tempdir().unwrap();
    let notify = NotifyEntry { command: Some(vec!["true".to_owned()]), ..NotifyEntry::default() };
    let service = service_with(&directory, &notify);
    let mut case = Case::new(&service, "lab".to_owned());
    case.wait_for_connection();
    order(&mut case, Step::Grow);
    fill_disk(&service, true);
    order(&mut case, Step::EmergencyStop);
    wait_for_end(&case);
    assert_eq!((latest(&service).state, notices(&service)), (JobState::Active, vec![]));
    fill_disk(&service, false);
    wait_until(|| latest(&service).state == JobState::Interrupted);
    assert_eq!((end_of(&service).1.as_str(), notices(&service)), ("emergency-stop", vec!["emergency-stop".to_owned()]));
}

#[test]
fn a_resumption_with_a_full_disk_is_followed_after_a_lost_line() {
    let directory = tempfile::tempdir().unwrap();
    let service = service(&directory);
    let mut case = Case::new(&service, "lab".to_owned());
    case.wait_for_connection();
    for step in [Step::Grow, Step::Stop] {
        order(&mut case, step);
    }
    wait_for_end(&case);
    fill_disk(&service, true);
    for step in [Step::Resume, Step::LineLost] {
        order(&mut case, step);
    }
    wait_until(|| case.worker.status().connection_error.is_some());
    case.line.board().line = LineState::Up;
    case.wait_for_connection();
    case.settle();
    assert!(case.worker.status().job.is_some());
    fill_disk(&service, false);
    order(&mut case, Step::Stop);
    wait_for_end(&case);
    assert_eq!(end_of(&service), (JobState::Interrupted, "stopped".to_owned()));
}

#[test]
fn the_resumed_jobs_of_several_robots_are_active_while_the_disk_is_full() {
    let directory = tempfile::tempdir().unwrap();
    let service = service(&directory);
    let mut case = Case::new(&service, "lab".to_owned());
    case.wait_for_connection();
    for step in [Step::Grow, Step::Stop] {
        order(&mut case, step);
    }
    wait_for_end(&case);
    let ours = latest(&service);
    let other = Job { id: "other-1".to_owned(), robot: "other".to_owned(), ..ours.clone() };
    let mut jobs = service.shared.jobs();
    jobs.insert(&other, None).unwrap();
    fs::write(jobs.log_path(&other.id), "").unwrap();
    for job in [&ours, &other] {
        jobs.set_state(&job.id, JobState::Failed, None);
    }
    jobs.database.pragma_update(None, "query_only", true).unwrap();
    for job in [&ours, &other] {
        jobs.set_state(&job.id, JobState::Active, None);
    }
    for job in [&ours, &other] {
        assert_eq!(jobs.active(&job.robot).unwrap().map(|job| job.id).as_ref(), Some(&job.id));
    }
}

#[test]
fn only_the_body_of_the_board_can_be_resumed() {
    let directory = tempfile::tempdir().unwrap();
    let service = service(&directory);
    let mut case = Case::new(&service, "lab".to_owned());
    case.wait_for_connection();
    order(&mut case, Step::Grow);
    order(&mut case, Step::Stop);
    wait_for_end(&case);
    assert_eq!(latest(&service).state, JobState::Interrupted);
    // Another host discards the body. Then the first board is back on the line.
    let plan_id = std::mem::take(&mut case.line.board().plan_id);
    wait_until(|| latest(&service).state == JobState::Failed);
    assert_eq!(end_of(&service).1, "discarded: the board does not have its body");
    case.line.board().plan_id = plan_id;
    wait_until(|| latest(&service).state == JobState::Interrupted);
    order(&mut case, Step::Cancel);
    assert_eq!(end_of(&service), (JobState::Failed, "discarded: the board has deleted the body".to_owned()));
}

#[test]
fn a_new_job_ends_all_earlier_ones_that_the_list_has_as_unfinished() {
    let directory = tempfile::tempdir().unwrap();
    let service = service(&directory);
    let mut case = Case::new(&service, "lab".to_owned());
    case.wait_for_connection();
    for left in ["interrupted", "active"] {
        order(&mut case, Step::Grow);
        order(&mut case, Step::Stop);
        wait_for_end(&case);
        let earlier = latest(&service);
        // A service that ends while the disk is full leaves a job active.
        let update = "UPDATE job SET state = ?2 WHERE id = ?1";
        service.shared.jobs().database.execute(update, (&earlier.id, left)).unwrap();
        order(&mut case, Step::Grow);
        let job = service.job(&earlier.id).unwrap();
        let reason = job.reason.unwrap_or_default();
        assert_eq!((job.state, &*reason), (JobState::Failed, "discarded: the robot has begun another job"), "{left}");
        assert_eq!(latest(&service).state, JobState::Active);
        order(&mut case, Step::Stop);
        wait_for_end(&case);
    }
}

/// Returns the events of all queued notices.
fn notices(service: &Service) -> Vec<String> {
    let jobs = service.shared.jobs_to_read();
    let mut statement = jobs.database.prepare("SELECT notice FROM notice ORDER BY id").unwrap();
    let notices = statement.query_map([], |row| row.get::<_, String>(0)).unwrap();
    let event = |text: String| serde_json::from_str::<serde_json::Value>(&text).unwrap()["event"].clone();
    notices.map(|text| event(text.unwrap()).as_str().unwrap().to_owned()).collect()
}

#[test]
fn each_event_of_a_growth_has_exactly_one_notice() {
    let notify = NotifyEntry { command: Some(vec!["true".to_owned()]), ..NotifyEntry::default() };
    let cases: [(&[Step], &[&str]); 9] = [
        (&[Step::Grow, Step::BoardParks], &["parked"]),
        (&[Step::Grow, Step::BoardParks, Step::ServiceRestarts], &["parked", "service-restart"]),
        (&[Step::Grow, Step::EmergencyStop], &["emergency-stop"]),
        (&[Step::Grow, Step::EmergencyStop, Step::ServiceRestarts], &["emergency-stop"]),
        (&[Step::Grow, Step::EmergencyStop, Step::ClearFault, Step::EmergencyStop], &["emergency-stop"; 2]),
        (&[Step::Grow, Step::BoardLosesPower], &["board-restart", "interrupted"]),
        (&[Step::Grow, Step::ServiceRestarts], &["service-restart"]),
        (&[Step::Grow, Step::ServiceRestarts, Step::ServiceRestarts], &["service-restart"; 2]),
        (&[Step::Grow, Step::Stop, Step::BoardLosesPower, Step::ServiceRestarts], &[]),
    ];
    for (steps, events) in cases {
        let directory = tempfile::tempdir().unwrap();
        let service = service_with(&directory, &notify);
        let mut case = Case::new(&service, "lab".to_owned());
        case.wait_for_connection();
        for step in steps {
            order(&mut case, *step);
            case.wait_for_connection();
            let state = case.line.board().state.name();
            wait_until(|| case.worker.status().state.as_deref() == Some(state));
            // The notice of an event is written after the status shows it.
            case.settle();
        }
        wait_until(|| notices(&service).len() >= events.len());
        case.settle();
        assert_eq!(notices(&service), events, "{steps:?}");
    }
}

#[test]
fn each_lost_line_has_exactly_one_notice() {
    let notify = NotifyEntry { command: Some(vec!["true".to_owned()]), ..NotifyEntry::default() };
    let directory = tempfile::tempdir().unwrap();
    let service = service_with(&directory, &notify);
    let mut case = Case::new(&service, "lab".to_owned());
    case.wait_for_connection();
    order(&mut case, Step::Grow);
    for count in 1..=2 {
        order(&mut case, Step::LineLost);
        wait_until(|| notices(&service).len() == count);
        // The thread tries to connect several times meanwhile.
        std::thread::sleep(20 * super::connector::Connector::reconnect_interval(&case.line));
        order(&mut case, Step::LineBack);
        case.wait_for_connection();
        case.settle();
        assert_eq!(notices(&service), vec!["disconnected"; count]);
    }
    let next = service.shared.jobs().next_notification(NotificationChannel::Command).unwrap().unwrap();
    assert!(next.notice.contains("robot lab has lost its connection") && next.notice.contains("cut"), "{next:?}");
}

#[test]
fn refused_commands_have_a_typed_reason() {
    let directory = tempfile::tempdir().unwrap();
    let service = service(&directory);
    let mut case = Case::new(&service, "lab".to_owned());
    case.wait_for_connection();
    let worker = Arc::clone(&case.worker);
    let refused = |command| run_command(&worker, command, &worker.signal().permit()).unwrap_err();
    assert!(matches!(refused(RobotCommand::Pause), RobotRequestError::NoGrowth { command: "pause", .. }));
    assert!(matches!(refused(RobotCommand::WithdrawStop), RobotRequestError::NoStop { .. }));
    order(&mut case, Step::Grow);
    assert!(matches!(refused(RobotCommand::Cancel), RobotRequestError::CancelDuringJob { .. }));
}

#[test]
fn a_fault_is_not_cleared_during_a_growth_and_the_answer_is_immediate() {
    let directory = tempfile::tempdir().unwrap();
    let service = service(&directory);
    let mut case = Case::new(&service, "lab".to_owned());
    case.wait_for_connection();
    order(&mut case, Step::Grow);
    let permit = case.worker.signal().permit();
    let why = run_command(&case.worker, RobotCommand::ClearFault, &permit).unwrap_err();
    assert!(matches!(why, RobotRequestError::Busy { .. }), "{why}");
    order(&mut case, Step::BoardFails);
    wait_for_end(&case);
    case.worker.request(RobotRequest::ClearFault(case.worker.signal().permit()), COMMAND_TIMEOUT).unwrap();
    assert_eq!(case.line.board().state, BoardState::Idle);
}
