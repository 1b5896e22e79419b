//! Maintenance and the end of a spool, on the firmware's own image in QEMU. Tasks that a cold board refuses are done by
//! a hot one, and the tip moves. A body that ran out of filament equals an undisturbed one. The controller's own tests
//! cover two more rules: the board switches everything off when the host is silent for ten minutes, and a robot parks
//! after an hour without filament.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

use growbot_client::client::{Client, ClientError};
use growbot_client::growth::{CommandQueue, GrowthOptions, OnParked, grow_job};
use growbot_client::stop_signal::Permit;
use growbot_core::link::message::{HostSilencePolicy, MaintenanceTask, Motor, PauseCause, Refusal, State};
use growbot_core::path::Segment;
use growbot_core::pose::Pose;
use growbot_core::robot::{DigitalInput, Robot};
use growbot_plan::growth_report::{GrowthReport, Outcome, as_built_hash};
use growbot_plan::job::{Command, Job, JobEvent};
use growbot_plan::robot_file;
use growbot_sim::port::emulator::Emulator;
use growbot_sim::tip::TipFault;
use growbot_tests::firmware;
use growbot_tests::tip_memory::{BoardLimit, TipMemoryView};

/// Time limit for the board to accept a task that it refuses because it is cold or moving, s of its clock.
const LIMIT_S: u32 = 180;

/// Returns robot A2, whose motors are fast, with faster homing and a filament switch.
fn robot() -> Robot {
    let mut description = robot_file::load("growbot-a2".as_ref()).unwrap().description().clone();
    description.layer.period_s = 0.3;
    description.head.homing_turns_per_s = 1.0;
    description.heater.band_c = 5.0;
    description.sensors.filament_presence = Some(DigitalInput { active_low: true });
    Robot::new(description).unwrap()
}

type Board = Rc<RefCell<Emulator>>;

fn board(robot: &Robot) -> (Board, Client) {
    let mut emulator = Emulator::start(robot, Some(&firmware("an386"))).unwrap();
    emulator.simulated_tip(|tip| tip.preheat_instantly(198.0));
    let board = Rc::new(RefCell::new(emulator));
    let mut client = Client::new(Box::new(Rc::clone(&board)), "the emulated board");
    client.open_session_for(robot).unwrap();
    (board, client)
}

fn refusal<T: std::fmt::Debug>(done: Result<T, ClientError>) -> Refusal {
    match done {
        Err(ClientError::Refused { refusal, .. }) => refusal,
        other => panic!("{other:?}"),
    }
}

/// Repeats a task until the board no longer refuses it because it is cold or moving.
fn once_possible(board: &Board, client: &mut Client, task: MaintenanceTask) {
    let mut limit = BoardLimit::new(&TipMemoryView::of(&mut board.borrow_mut()), LIMIT_S);
    loop {
        match client.maintain(task, &Permit::standalone()) {
            Err(ClientError::Refused { refusal: Refusal::NozzleTooCold { .. } | Refusal::StillMoving, .. }) => {}
            done => {
                done.unwrap();
                return;
            }
        }
        limit.check(format_args!("{task:?}: {:?}", client.status()));
        client.wait(Duration::from_millis(200)).unwrap();
    }
}

fn feed(mm: i32) -> MaintenanceTask {
    MaintenanceTask::Feed { um: mm * 1000 }
}

#[test]
fn maintenance_is_refused_cold_and_executed_hot() {
    let robot = robot();
    let (board, mut client) = board(&robot);
    for task in [feed(10), feed(-10), MaintenanceTask::Home, MaintenanceTask::Rotate { centi_deg: 9000 }] {
        let refused = refusal(client.maintain(task, &Permit::standalone()));
        assert!(matches!(refused, Refusal::WrongState { .. } | Refusal::NozzleTooCold { .. }), "{task:?}: {refused:?}");
    }
    assert!(matches!(
        refusal(client.maintain(MaintenanceTask::Preheat { target_centi_c: 90_000 }, &Permit::standalone())),
        Refusal::TemperatureOutOfRange { .. }
    ));
    client.maintain(MaintenanceTask::Preheat { target_centi_c: 20_000 }, &Permit::standalone()).unwrap();
    let steps_per_mm = robot.description().feed.steps_per_mm;
    let at = |what: fn(&mut growbot_sim::tip::TipModel) -> i64| {
        let mut position = 0;
        board.borrow_mut().simulated_tip(|tip| position = what(tip));
        position
    };
    let before = at(|tip| tip.feed_position());
    once_possible(&board, &mut client, feed(20));
    once_possible(&board, &mut client, feed(-5));
    once_possible(&board, &mut client, MaintenanceTask::Home);
    let fed = at(|tip| tip.feed_position()) - before;
    assert_eq!(fed, (15.0 * steps_per_mm).round() as i64);
    once_possible(&board, &mut client, MaintenanceTask::Rotate { centi_deg: 9000 });
    assert!(matches!(
        refusal(client.maintain(MaintenanceTask::Rotate { centi_deg: 36_001 }, &Permit::standalone())),
        Refusal::MoveTooLong { .. } | Refusal::StillMoving
    ));
    once_possible(&board, &mut client, feed(1));
    let turn = i64::from(robot.description().head.steps_per_turn);
    assert_eq!(at(|tip| tip.head_position()).rem_euclid(turn), turn / 4, "a quarter of a turn from where it homed");
    assert!(matches!(
        refusal(client.maintain(feed(2_000_000), &Permit::standalone())),
        Refusal::MoveTooLong { .. } | Refusal::StillMoving
    ));
    client.maintain(MaintenanceTask::CoolDown, &Permit::standalone()).unwrap();
    assert_eq!(client.status().unwrap().state, State::Idle);
    assert!(!at(|tip| i64::from(tip.is_enabled(Motor::Feed))).is_positive(), "motors are let go");
}

/// Grows a straight body of 20 layers. `on_event` may inject a fault into the tip.
fn grow(robot: &Robot, mut on_event: impl FnMut(&Board, &JobEvent, &CommandQueue)) -> GrowthReport {
    let (board, mut client) = board(robot);
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
    let length = 22.0 * 0.7;
    let path = [Segment::Straight { length }];
    let goal = Pose::from_degrees([0.0, 0.0, length, 0.0, 90.0]).unwrap();
    let job = Job::new(robot, &start, &goal, &path);
    let orders = CommandQueue::default();
    let manner = GrowthOptions { parked: OnParked::Wait, ..HostSilencePolicy::Pause.into() };
    grow_job(&mut client, &job, manner, &orders, &mut |event| on_event(&board, event, &orders)).unwrap()
}

#[test]
fn running_out_of_filament_does_not_change_the_body() {
    let robot = robot();
    let undisturbed = grow(&robot, |_, _, _| {});
    assert_eq!(undisturbed.outcome, Outcome::Done);
    let (mut ran_out, mut waited, mut steps) = (false, 0, vec![Command::Continue, Command::Load, Command::Preheat]);
    let grown = grow(&robot, |board, event, orders| match event {
        JobEvent::Laid { index: 3, .. } if !std::mem::replace(&mut ran_out, true) => {
            board.borrow_mut().inject(TipFault::FilamentOut);
        }
        JobEvent::Status(status) if status.state == State::Paused => {
            assert_eq!(status.pause_cause, PauseCause::FilamentOut);
            waited += 1;
            board.borrow_mut().clear_fault(TipFault::FilamentOut);
            // A refused command is given again with the next status.
            if let Some(order) = steps.last() {
                orders.push(*order);
            }
        }
        JobEvent::Command(order) if steps.last() == Some(order) => drop(steps.pop()),
        // The command came too early.
        JobEvent::CommandFailed(_) => steps.push(if steps.is_empty() { Command::Continue } else { Command::Load }),
        _ => {}
    });
    assert_eq!((grown.outcome, ran_out), (Outcome::Done, true));
    assert!(waited > 0);
    assert_eq!(as_built_hash(&grown.as_built), as_built_hash(&undisturbed.as_built));
}
