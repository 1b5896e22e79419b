//! The stack of a running board. An overflow ends in a clean reset, and a growth that the board plans by itself leaves
//! half of the stack unused.

use std::time::Duration;

use growbot_client::client::Client;
use growbot_client::growth::{CommandQueue, grow_job};
use growbot_core::link::message::{HostSilencePolicy, Message, PassiveRequest, PlanRequest, ResetCause, State};
use growbot_core::path::{Segment, end};
use growbot_core::plan::Planner;
use growbot_core::pose::Pose;
use growbot_firmware::emulated_tip as table;
use growbot_plan::growth_report::Outcome;
use growbot_plan::job::Job;
use growbot_plan::robot_file;
use growbot_sim::port::emulator::Emulator;
use growbot_tests::firmware;
use growbot_tests::tip_memory::TipMemoryView;

/// Size of the stack on both boards, bytes.
const STACK: u32 = 64 * 1024;

#[test]
fn a_stack_overflow_is_reported_at_the_next_boot() {
    let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
    let mut emulator = Emulator::start(&robot, Some(&firmware("an386"))).unwrap();
    let words = TipMemoryView::of(&mut emulator);
    let mut client = Client::new(Box::new(emulator), "the emulated board");
    assert_eq!(client.open_session_for(&robot).unwrap().reset_cause, ResetCause::PowerOn);

    words.write(table::OVERFLOW_STACK, 1);
    words.wait("a second boot", |words| words.read(table::BOOTS) > 1);
    words.write(table::OVERFLOW_STACK, 0);

    assert_eq!(words.read(table::RESET_CAUSE), table::RESET_STACK_OVERFLOW);
    for output in [table::HEATER_DUTY, table::HEATER_ENABLE, table::HEAD_ENABLE, table::FEED_ENABLE] {
        assert_eq!(words.read(output), 0);
    }
    let hello = client.open_session_for(&robot).unwrap();
    assert_eq!((hello.reset_cause, hello.status.state), (ResetCause::StackOverflow, State::Idle));
}

#[test]
fn planning_and_growing_leave_half_of_the_stack_unused() {
    let robot = robot_file::load("growbot-a2".as_ref()).unwrap();
    let mut emulator = Emulator::start(&robot, Some(&firmware("an386"))).unwrap();
    let words = TipMemoryView::of(&mut emulator);
    // A warm nozzle saves the heating time.
    emulator.simulated_tip(|tip| tip.preheat_instantly(190.0));
    let mut client = Client::new(Box::new(emulator), "the emulated board");
    client.open_session_for(&robot).unwrap();

    // A near goal, for which helicoidal arcs are searched, and one further away.
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
    for goal in [[150.0, 40.0, 200.0, 60.0, 10.0], [300.0, 200.0, 400.0, 30.0, 10.0]] {
        for planner in [Planner::TwoPlane, Planner::Shortest] {
            let goal = Pose::from_degrees(goal).unwrap();
            let request = PlanRequest { start: (&start).into(), goal: (&goal).into(), radius: 100.0, planner };
            let answer = client.request("to plan", &PassiveRequest::Plan(request)).unwrap();
            assert!(matches!(answer, Message::Planned(_)), "{answer:?}");
        }
    }

    let path = [Segment::Arc { alpha: 1.0, bend: 0.03, length: 3.0 }];
    let goal = Pose::from_frame(&end(&path, &start.frame()));
    let job = Job::new(&robot, &start, &goal, &path);
    let grown = grow_job(&mut client, &job, HostSilencePolicy::Pause, &CommandQueue::default(), &mut |_| ()).unwrap();
    assert_eq!(grown.outcome, Outcome::Done);

    // Time of a whole scan of the stack, by the board's clock.
    let grown_ms = client.status().unwrap().uptime_ms;
    while client.status().unwrap().uptime_ms < grown_ms + 1000 {
        client.wait(Duration::from_millis(50)).unwrap();
    }
    words.wait("a count of the stack", |words| words.read(table::STACK_UNUSED) > 0);
    let used = STACK - words.read(table::STACK_UNUSED);
    println!("{used} B of {STACK} B of the emulated board's stack were used, {} %", 100 * used / STACK);
    assert!(used < STACK / 2);
}
