use std::path::Path;
use std::thread;
use std::time::Duration;

use growbot_client::client::Client;
use growbot_client::growth::{CommandQueue, GrowthOptions, grow_job, resume_job};
use growbot_core::link::message::HostSilencePolicy;
use growbot_core::plan::Planner;
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_plan::growth_report::{Outcome, as_built_hash};
use growbot_plan::job::{Job, JobEvent};
use growbot_plan::plan::Plan;
use growbot_plan::robot_file;

use super::{DaemonPort, SimDaemonError, StateDir, serve};
use crate::port::{PortName, TipSettings, open, open_for_emergency_stop};

fn robot() -> Robot {
    robot_file::load("growbot-a2".as_ref()).unwrap()
}

/// Starts a robot in a thread of this process instead of a process of its own.
fn on(directory: &Path, pace: f64) -> (StateDir, thread::JoinHandle<Result<(), SimDaemonError>>) {
    let place = StateDir::of(&format!("{}/", directory.display())).unwrap();
    let (ready, is_ready) = std::sync::mpsc::channel();
    let played = place.clone();
    let thread = thread::spawn(move || serve(&played, &robot(), pace, || ready.send(()).unwrap()));
    is_ready.recv().unwrap();
    (place, thread)
}

fn client(place: &StateDir) -> Client {
    let name = PortName::SimDaemon(place.name().to_owned());
    Client::new(open(&name, &robot(), &TipSettings::default()).unwrap().port, "sim")
}

fn off(place: &StateDir) {
    DaemonPort::open_shared(place).unwrap().power_off().unwrap();
}

fn plan() -> Plan {
    let goal = Pose::from_degrees([2.0, 1.0, 24.0, 0.0, 80.0]).unwrap();
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
    let radius = robot().description().planning_radius_mm;
    Plan::new(&robot(), &start, &goal, radius, Planner::Shortest).unwrap()
}

#[test]
fn a_power_loss_does_not_change_the_body() {
    let (robot, plan) = (robot(), plan());
    let job = Job::of_plan(&robot, &plan);
    let whole = tempfile::tempdir().unwrap();
    let (place, thread) = on(whole.path(), 1e4);
    let manner = || GrowthOptions::from(HostSilencePolicy::Pause);
    let grown = grow_job(&mut client(&place), &job, manner(), &CommandQueue::default(), &mut |_| {}).unwrap();
    assert_eq!(grown.outcome, Outcome::Done);
    off(&place);
    thread.join().unwrap().unwrap();

    let cut = tempfile::tempdir().unwrap();
    let (place, thread) = on(cut.path(), 1e4);
    let mut switch = Some(place.clone());
    let lost = grow_job(&mut client(&place), &job, manner(), &CommandQueue::default(), &mut |event| {
        if let JobEvent::Laid { index: 5, .. } = event {
            switch.take().iter().for_each(off);
        }
    });
    assert!(lost.is_err() || lost.unwrap().outcome != Outcome::Done);
    thread.join().unwrap().unwrap();
    assert!(!place.is_on());
    let (place, thread) = on(cut.path(), 1e4);
    let mut client = client(&place);
    let resumed = resume_job(&mut client, &job, vec![], manner(), &CommandQueue::default(), &mut |_| {}).unwrap();
    assert_eq!(resumed.outcome, Outcome::Done);
    assert_eq!(as_built_hash(&resumed.as_built), as_built_hash(&grown.as_built));
    drop(client);
    off(&place);
    thread.join().unwrap().unwrap();
}

#[test]
fn one_client_owns_the_link_and_any_may_send_an_emergency_stop() {
    let directory = tempfile::tempdir().unwrap();
    let (place, thread) = on(directory.path(), 1.0);
    let mut owner = client(&place);
    owner.open_session_for(&robot()).unwrap();
    assert!(matches!(DaemonPort::open(&place), Err(SimDaemonError::Busy(_))));
    let name = PortName::SimDaemon(place.name().to_owned());
    let beside = open_for_emergency_stop(&name, Duration::from_secs(1)).unwrap();
    Client::new(beside, "sim").emergency_stop().unwrap();
    assert!(matches!(serve(&place, &robot(), 1.0, || {}), Err(SimDaemonError::AlreadyRunning(_))));
    off(&place);
    thread.join().unwrap().unwrap();
    assert!(matches!(DaemonPort::open(&place), Err(SimDaemonError::NotRunning(_))));
    let other = robot_file::load("growbot-b".as_ref()).unwrap();
    let message = serve(&place, &other, 1.0, || {}).unwrap_err().to_string();
    assert!(message.contains("growbot-a2") && message.contains("growbot-b"), "{message}");
}
