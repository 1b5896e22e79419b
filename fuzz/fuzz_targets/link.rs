//! Sends any bytes and frames to a simulated board, with pauses between them. The board must not crash, and its heater
//! must be off in each state in which the board does not grow, tune or do maintenance.
//!
//! The input consists of actions: a byte with the type, a byte with the length, and the data. An action sends a frame
//! with the data as its body, sends the data as raw bytes, or lets time pass.

#![no_main]

use std::sync::LazyLock;
use std::time::Duration;

use growbot_client::port::Port;
use growbot_core::link::frame::{self, FrameHeader, MAX_BODY_LEN};
use growbot_core::link::message::{Hello, HostName, Message, SCHEMA_HASH, State};
use growbot_core::robot::Robot;
use growbot_plan::robot_file;
use growbot_sim::port::sim::Sim;
use libfuzzer_sys::fuzz_target;

static ROBOT: LazyLock<Robot> = LazyLock::new(|| robot_file::load("growbot-a".as_ref()).expect("robot A is built in"));

const SESSION: u32 = 7;

fn send(sim: &mut Sim, seq: &mut u16, kind: u8, body: &[u8]) {
    // Each frame is a new request, because the board does not execute a repeated request again.
    *seq = frame::next_seq(*seq);
    let header = FrameHeader { kind, session: SESSION, seq: *seq, ack: 0 };
    if let Ok(bytes) = frame::encode(&header, body) {
        sim.send(&bytes).expect("a simulated line does not break");
    }
}

fuzz_target!(|bytes: &[u8]| {
    let mut sim = Sim::new(ROBOT.clone());
    sim.run_for(Duration::from_millis(800));
    let mut buffer = [0; MAX_BODY_LEN];
    let hello = Message::Hello(Hello { schema: SCHEMA_HASH, host: HostName::new(), take_over: false });
    let mut seq = 0;
    send(&mut sim, &mut seq, hello.kind(), hello.encode(&mut buffer).expect("a hello fits"));
    let mut rest = bytes;
    while let [what, length, tail @ ..] = rest {
        let (piece, after) = tail.split_at(tail.len().min(usize::from(*length)));
        rest = after;
        match what {
            0..0x40 => send(&mut sim, &mut seq, *what, piece),
            0x40..0x80 => sim.send(piece).expect("a simulated line does not break"),
            _ => sim.run_for(Duration::from_millis(u64::from(*length))),
        }
        let rests = !matches!(
            sim.state(),
            State::Heating | State::Homing | State::Growing | State::Paused | State::Tuning | State::Maintenance
        );
        let heats = sim.simulated_tip().heater_is_on();
        assert!(!(rests && heats), "the heater is on in {:?}", sim.state());
    }
});
