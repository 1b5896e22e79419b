//! Sends robot A's description with some changed bytes to a simulated board. The board must store it and restart with
//! it, or reject it and keep its current description. The heater must stay off.
//!
//! Each three bytes of the input are a change: the position in two bytes (little-endian), and the new value of the
//! byte.

#![no_main]

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::LazyLock;
use std::time::Duration;

use growbot_client::client::{Client, ClientError};
use growbot_client::port::Port;
use growbot_core::link::message::{Configure, MAX_DESCRIPTION_PART, PassiveRequest, Refusal};
use growbot_core::robot::{MAX_VERSIONED_LEN, Robot};
use growbot_plan::robot_file;
use growbot_sim::port::sim::Sim;
use libfuzzer_sys::fuzz_target;

static ROBOT: LazyLock<Robot> = LazyLock::new(|| robot_file::load("growbot-a".as_ref()).expect("robot A is built in"));

/// Time that is longer than the restart of a board.
const RESTART: Duration = Duration::from_secs(3);

/// Returns the encoded description of robot A with these changes.
fn changed(changes: &[u8]) -> Vec<u8> {
    let mut buffer = [0; MAX_VERSIONED_LEN];
    let mut description = ROBOT.encode_for_board(&mut buffer).expect("robot A has a board").to_vec();
    let length = description.len();
    for [low, high, value] in changes.as_chunks::<3>().0 {
        description[usize::from(u16::from_le_bytes([*low, *high])) % length] = *value;
    }
    description
}

/// Sends the parts of an encoded description to the board. `robot` is the hash of the description. Returns an error if
/// the board rejects a part.
fn hand_over(client: &mut Client, robot: u64, description: &[u8]) -> Result<(), ClientError> {
    for (index, part) in description.chunks(MAX_DESCRIPTION_PART).enumerate() {
        let part = Configure {
            robot,
            length: description.len() as u16,
            offset: (index * MAX_DESCRIPTION_PART) as u16,
            bytes: part.iter().copied().collect(),
        };
        client.request("a description", &PassiveRequest::Configure(part))?;
    }
    Ok(())
}

fuzz_target!(|changes: &[u8]| {
    let description = changed(changes);
    let named = Robot::decode_for_board(&description).map_or(ROBOT.hash(), |robot| robot.hash());
    let sim = Rc::new(RefCell::new(Sim::new(ROBOT.clone())));
    let mut client = Client::new(Box::new(Rc::clone(&sim)), "sim");
    client.open_session().expect("a simulated board answers");
    let stored = match hand_over(&mut client, named, &description) {
        Ok(()) => true,
        Err(ClientError::Refused { refusal: Refusal::InvalidDescription { .. }, .. }) => false,
        Err(other) => panic!("{other}"),
    };
    let _ = client.wait(RESTART);
    let hello = client.open_session().expect("it answers as before");
    assert_eq!(hello.robot_hash, if stored { named } else { ROBOT.hash() });
    assert!(stored || hello.status.uptime_ms > RESTART.as_millis() as u64, "it has started anew");
    let mut sim = sim.borrow_mut();
    assert!(sim.now() > RESTART && !sim.simulated_tip().heater_is_on());
});
