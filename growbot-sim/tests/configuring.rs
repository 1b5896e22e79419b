//! A simulated board that receives another robot description, even with power cuts in between.

use std::time::Duration;

use growbot_client::client::{Client, ClientError};
use growbot_client::stop_signal::Permit;
use growbot_core::link::message::{BeginJob, Cancel, PassiveRequest, Refusal, ResetCause, State};
use growbot_core::robot::{MAX_VERSIONED_LEN, Robot};
use growbot_firmware::description_store::DescriptionStore;
use growbot_plan::robot_file;
use growbot_sim::port::sim::Sim;
use growbot_sim::tip::flash::SECTOR_BYTES;

fn robot(name: &str) -> Robot {
    robot_file::load(name.as_ref()).unwrap()
}

#[test]
fn the_board_restarts_as_every_supported_robot() {
    let sim = Sim::new(robot("growbot-a"));
    let flash = sim.descriptions();
    let mut client = Client::new(Box::new(sim), "sim");
    client.open_session().unwrap();
    let mut configured = 0;
    for name in robot_file::names() {
        let next = robot(name);
        if next.check_for_board().is_err() {
            let refused = client.configure(&next).unwrap_err();
            assert!(matches!(refused, ClientError::Description(_)), "{name}: {refused}");
            continue;
        }
        let hello = client.configure(&next).unwrap();
        configured += 1;
        assert_eq!((hello.robot_hash, hello.robot_name.as_str(), hello.status.state), (next.hash(), name, State::Idle));
        assert_eq!(DescriptionStore::open(flash.clone()).newest().robot(), Some(next.clone()));
        let begin = BeginJob { plan_id: 1, layers: 1, robot_hash: next.hash() };
        client.request("to begin", &PassiveRequest::BeginJob(begin)).unwrap();
        let refused = client.configure(&next).unwrap_err();
        assert!(
            matches!(refused, ClientError::Refused { refusal: Refusal::JobNotDone { plan_id: 1 }, .. }),
            "{refused}"
        );
        client.request("to give it up", &PassiveRequest::Cancel(Cancel { plan_id: 1 })).unwrap();
    }
    assert!(configured >= 3, "{configured}");
}

#[test]
fn an_unconfigured_board_is_detected_and_configured() {
    let mut sim = Sim::new(robot("growbot-a"));
    sim.restart_without_description();
    let mut client = Client::new(Box::new(sim), "sim");
    let error = client.open_session_for(&robot("growbot-a")).unwrap_err();
    assert!(matches!(error, ClientError::NotConfigured { .. }), "{error}");
    let refused = client.clear_fault(&Permit::standalone()).unwrap_err();
    assert!(matches!(refused, ClientError::Refused { refusal: Refusal::NotConfigured, .. }), "{refused}");
    client.configure(&robot("growbot-b")).unwrap();
    client.open_session_for(&robot("growbot-b")).unwrap();
}

/// Number of bytes of an erasure between two power cuts that are tested.
const EVERY: usize = 256;

#[test]
fn a_power_loss_at_any_time_leaves_the_old_or_the_new_robot() {
    let [first, old, new] = ["growbot-c", "growbot-a", "growbot-b"].map(robot);
    let written = 16 + MAX_VERSIONED_LEN.next_multiple_of(4);
    let cuts = (1..SECTOR_BYTES).step_by(EVERY).chain(SECTOR_BYTES..=SECTOR_BYTES + written);
    let mut olds = 0;
    for cut in cuts.clone() {
        let mut sim = Sim::new(first.clone());
        let flash = sim.descriptions();
        // Both slots are in use.
        for robot in [&first, &old] {
            DescriptionStore::open(flash.clone()).store(robot).unwrap();
        }
        sim.reset(ResetCause::PowerOn);
        assert_eq!(sim.robot(), &old);
        let mut descriptions = DescriptionStore::open(flash.clone());
        flash.lose_power_after(cut, cut as u64);
        let stored = descriptions.store(&new);
        sim.reset(ResetCause::PowerOn);
        assert!(*sim.robot() == old || *sim.robot() == new, "cut at byte {cut}: {}", sim.robot().name());
        assert!(stored.is_err() || *sim.robot() == new, "cut at byte {cut}");
        olds += u32::from(*sim.robot() == old);
    }
    assert!(olds as usize > cuts.count() - 8, "{olds}");
}

#[test]
fn configuring_survives_a_power_loss() {
    let [old, new] = ["growbot-a", "growbot-b"].map(robot);
    for cut in [1, SECTOR_BYTES / 2, SECTOR_BYTES + 1, SECTOR_BYTES + 400, SECTOR_BYTES + 780] {
        let sim = Sim::new(old.clone());
        let flash = sim.descriptions();
        let mut client = Client::new(Box::new(sim), "sim");
        client.open_session().unwrap();
        flash.lose_power_after(cut, cut as u64);
        let refused = client.configure(&new).unwrap_err();
        assert!(matches!(refused, ClientError::Refused { .. }), "cut at byte {cut}: {refused}");
        // The power fails at the next tick.
        client.wait(Duration::from_millis(100)).unwrap();
        assert_eq!(client.open_session().unwrap().robot_hash, old.hash(), "cut at byte {cut}");
        assert_eq!(client.configure(&new).unwrap().robot_hash, new.hash(), "cut at byte {cut}");
    }
}
