//! Configures the firmware's own image in QEMU as another robot. The image checks and stores the description, and
//! restarts with it.

use growbot_client::client::{Client, ClientError};
use growbot_client::stop_signal::Permit;
use growbot_core::link::message::{
    Configure, DescriptionError, MAX_DESCRIPTION_PART, MaintenanceTask, PassiveRequest, Refusal, ResetCause, State,
};
use growbot_core::robot::{MAX_VERSIONED_LEN, Robot};
use growbot_plan::robot_file;
use growbot_sim::port::emulator::Emulator;
use growbot_tests::firmware;

fn robot(name: &str) -> Robot {
    robot_file::load(name.as_ref()).unwrap()
}

fn refusal<T: std::fmt::Debug>(done: Result<T, ClientError>) -> Refusal {
    match done {
        Err(ClientError::Refused { refusal, .. }) => refusal,
        other => panic!("{other:?}"),
    }
}

/// Sends these bytes as the description of a robot.
fn hand_over(client: &mut Client, robot: &Robot, bytes: &[u8]) -> Result<(), ClientError> {
    for (index, part) in bytes.chunks(MAX_DESCRIPTION_PART).enumerate() {
        let part = Configure {
            robot: robot.hash(),
            length: bytes.len() as u16,
            offset: (index * MAX_DESCRIPTION_PART) as u16,
            bytes: part.iter().copied().collect(),
        };
        client.request("a description", &PassiveRequest::Configure(part))?;
    }
    Ok(())
}

#[test]
fn the_image_stores_a_description_and_restarts_with_it() {
    let [old, new] = ["growbot-a", "growbot-b"].map(robot);
    let emulator = Emulator::start(&old, Some(&firmware("an386"))).unwrap();
    let mut client = Client::new(Box::new(emulator), "the emulated board");
    client.open_session_for(&old).unwrap();

    let mut buffer = [0; MAX_VERSIONED_LEN];
    let bytes = new.encode_for_board(&mut buffer).unwrap().to_vec();
    let mut negative = bytes.clone();
    // The planning radius comes after the name.
    let at = 2 + new.name().len();
    negative[at..at + 8].copy_from_slice(&(-1.0_f64).to_le_bytes());
    for (bad, why) in [
        (&bytes[..bytes.len() - 1], DescriptionError::Unreadable),
        (&negative[..], DescriptionError::Number),
        (
            &old.encode_for_board(&mut [0; MAX_VERSIONED_LEN]).unwrap().to_vec()[..],
            DescriptionError::HashMismatch { found: old.hash() },
        ),
    ] {
        assert_eq!(refusal(hand_over(&mut client, &new, bad)), Refusal::InvalidDescription { error: why });
    }
    assert_eq!(client.identify().unwrap().robot_hash, old.hash());

    let hello = client.configure(&new).unwrap();
    assert_eq!((hello.robot_hash, hello.robot_name.as_str()), (new.hash(), "growbot-b"));
    assert_eq!((hello.reset_cause, hello.status.state), (ResetCause::External, State::Idle));

    client.maintain(MaintenanceTask::Preheat { target_centi_c: 20_000 }, &Permit::standalone()).unwrap();
    assert_eq!(refusal(client.configure(&old)), Refusal::WrongState { state: State::Maintenance });
    client.stop().unwrap();
    assert_eq!(client.identify().unwrap().robot_hash, new.hash());
}
