//! Decodes any bytes as an encoded robot description. If the description is accepted, the methods of the robot must not
//! fail.

#![no_main]

use growbot_core::robot::{MAX_VERSIONED_LEN, Robot};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(robot) = Robot::decode_for_board(bytes) else { return };
    assert!(robot.min_radius() > 0.0);
    assert!(robot.feed_steps_per_length() > 0.0);
    let mut buffer = [0; MAX_VERSIONED_LEN];
    let encoded = robot.encode_for_board(&mut buffer).expect("what was read can be written");
    assert_eq!(Robot::decode_for_board(encoded).expect("and read again").hash(), robot.hash());
});
