//! Tests of the ownership of a board by a session, of repeated and late frames, and of a host that falls silent.

use growbot_core::link::frame::{self, FrameHeader, MAX_BODY_LEN};
use growbot_core::link::message::{
    BoardInfo, Empty, Hello, HostName, HostSilencePolicy, Message, PauseCause, Refusal, RefusalResponse, SCHEMA_HASH,
    Start, State,
};

use super::bench::{Bench, WARM};
use super::requests::{PLAN, bends, clear, start, stop};
use crate::testing::fast_robot;

/// Requests a session for another host, without taking the board over. Returns the board's response.
fn knock(bench: &mut Bench, session: u32) -> Message {
    let host = HostName::from_slice(b"another").unwrap();
    bench.ask_in(session, &Message::Hello(Hello { schema: SCHEMA_HASH, host, take_over: false }))
}

fn bytes_of(message: &Message, session: u32, seq: u16) -> frame::FrameBytes {
    let mut buffer = [0; MAX_BODY_LEN];
    let body = message.encode(&mut buffer).unwrap();
    frame::encode(&FrameHeader { kind: message.kind(), session, seq, ack: 0 }, body).unwrap()
}

#[test]
fn a_second_host_is_refused_until_the_first_is_silent() {
    let mut bench = Bench::in_state(State::Growing);
    let answer = knock(&mut bench, 99);
    assert!(
        matches!(
            answer,
            Message::Refused(RefusalResponse { refusal: Refusal::OwnedByOtherHost { silent_ms: 0..1000 }, .. })
        ),
        "{answer:?}"
    );
    // The board still responds to this request, and names its owner.
    let Message::BoardInfo(BoardInfo { owner, .. }) = bench.ask_in(99, &Message::GetBoardInfo(Empty {})) else {
        panic!()
    };
    assert_eq!(owner, Some(HostName::new()));
    bench.reads = false;
    bench.run(10.5);
    assert!(matches!(knock(&mut bench, 99), Message::BoardInfo(_)));
}

#[test]
fn goodbye_frees_the_board_for_the_next_host() {
    let mut bench = Bench::greeted(fast_robot(), WARM);
    let goodbye = bytes_of(&Message::Goodbye(Empty {}), bench.session, 500);
    bench.send(&goodbye);
    assert!(matches!(knock(&mut bench, 99), Message::BoardInfo(_)));
}

#[test]
fn an_ended_session_is_never_reopened() {
    let mut bench = Bench::greeted(fast_robot(), WARM);
    let old = bench.session;
    bench.hello();
    let hello = Message::Hello(Hello { schema: SCHEMA_HASH, host: HostName::new(), take_over: true });
    let answer = bench.ask_in(old, &hello);
    assert!(matches!(answer, Message::Refused(RefusalResponse { refusal: Refusal::NoSession, .. })), "{answer:?}");
    bench.begin(3);
}

#[test]
fn late_and_duplicate_requests_are_not_executed_again() {
    let mut bench = Bench::greeted(fast_robot(), WARM);
    let session = bench.session;
    let old_stop = bytes_of(&stop(), session, 2);
    let old_begin = bytes_of(&super::requests::begin(&bench.robot.clone(), PLAN, 1), session, 3);
    bench.grow(&bends(40));
    bench.run_to(State::Growing, 60.0);
    for late in [&old_stop, &old_begin] {
        bench.send(late);
        let (_, answers) = bench.read(Some(3));
        assert!(answers.is_empty());
        assert_eq!(bench.controller.state(), State::Growing);
    }
    bench.run_to(State::Done, 60.0);
    // This frame is the start of a growth that ended long ago.
    let old_start = bytes_of(&start(), session, 4);
    bench.send(&old_start);
    bench.run(5.0);
    assert_eq!(bench.controller.state(), State::Done);
}

#[test]
fn a_silent_host_pauses_growth_unless_configured_to_continue() {
    for silence in [HostSilencePolicy::Pause, HostSilencePolicy::Continue] {
        let mut bench = Bench::greeted(fast_robot(), WARM);
        bench.begin(100);
        bench.hand_over(0, &bends(100));
        bench.accepted(&Message::Start(Start { plan_id: PLAN, on_host_silence: silence, is_continuation: false }));
        bench.run_to(State::Growing, 60.0);
        bench.reads = false;
        bench.run(9.5);
        assert_eq!(bench.controller.state(), State::Growing);
        match silence {
            HostSilencePolicy::Continue => bench.run_to(State::Done, 60.0),
            HostSilencePolicy::Pause => {
                bench.run_to(State::Paused, 3.0);
                assert_eq!(bench.controller.status().pause_cause, PauseCause::HostSilent);
                bench.run(30.0);
                assert_eq!(bench.controller.state(), State::Paused);
                bench.reads = true;
                bench.start();
                bench.run_to(State::Done, 60.0);
                assert_eq!(bench.laid().len(), 100);
            }
        }
    }
}

#[test]
fn a_link_emergency_stop_acts_and_is_acknowledged_each_time() {
    for state in State::ALL {
        let mut bench = Bench::in_state(state);
        bench.events.clear();
        for _ in 0..2 {
            bench.call_emergency_stop();
            bench.run(0.05);
            assert_eq!(bench.stops_acknowledged(), 1, "{state:?}");
            assert!(bench.heater.off() && !bench.motors.enabled());
            assert!(matches!(bench.controller.state(), State::EmergencyStop | State::Fault));
        }
        if bench.controller.state() == State::EmergencyStop {
            bench.accepted(&clear());
            assert_eq!(bench.controller.state(), State::Idle);
        }
    }
}
