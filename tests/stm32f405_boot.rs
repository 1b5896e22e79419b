//! The robot's own image, sealed like by `growbot flash`, boots in the emulator and responds over its serial line.
//!
//! In the emulator its pins read low and its ADC provides nothing. For the board this is a robot whose drivers report a
//! fault and whose sensors are silent. Therefore its self-test must fail, and it must never switch anything on.

use std::path::Path;
use std::thread::sleep;
use std::time::{Duration, Instant};

use growbot_client::client::{Client, ClientError};
use growbot_client::port::stream::Stream;
use growbot_client::stop_signal::Permit;
use growbot_core::link::message::{
    BeginJob, BootReport, Empty, EnergizingRequest, Fault, HostSilencePolicy, ImageCheck, PassiveRequest, Refusal,
    Start, State,
};
use growbot_plan::robot_file;
use growbot_sim::image_seal::seal;
use growbot_tests::{firmware, netduinoplus2};

/// Timeout of the board: it needs seconds, or more on a busy machine.
const PATIENCE: Duration = Duration::from_secs(120);

#[test]
fn the_robots_board_boots_and_responds() {
    let image = Path::new(env!("CARGO_TARGET_TMPDIR")).join("stm32f405-sealed");
    let sealed = seal(&std::fs::read(firmware("stm32f405")).unwrap()).unwrap();
    std::fs::write(&image, &sealed.bytes).unwrap();
    let board = netduinoplus2::boot(&image).unwrap();
    let mut client = client_of(&board);

    let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
    let hello = client.open_session_for(&robot).unwrap();
    assert_eq!(hello.robot_name, "growbot-a");
    assert!(matches!(hello.status.state, State::SelfTest | State::Fault), "{:?}", hello.status.state);
    assert_eq!((hello.status.target_centi_c, hello.status.duty), (None, 0));

    // The image has been checked and is sound. The memory lost power since the last crash, so the board knows of none.
    let report = client.boot_report().unwrap();
    assert_eq!(report, BootReport { image: ImageCheck::Valid { crc: sealed.crc }, crash: None });

    // The clock runs.
    let deadline = Instant::now() + PATIENCE;
    let before = client.status().unwrap().uptime_ms;
    while client.status().unwrap().uptime_ms <= before {
        assert!(Instant::now() < deadline, "its clock stands at {before} ms");
        sleep(Duration::from_millis(10));
    }

    // The self-test ends with a fault that such sensors cause.
    let status = loop {
        let status = client.status().unwrap();
        if status.state != State::SelfTest || Instant::now() > deadline {
            break status;
        }
        sleep(Duration::from_millis(50));
    };
    assert_eq!(status.state, State::Fault);
    let sensors =
        [Fault::DriverFault, Fault::SupplyLow, Fault::ThermistorSilent, Fault::ThermistorShort, Fault::ThermistorOpen];
    assert!(status.fault.is_some_and(|fault| sensors.contains(&fault)), "{:?}", status.fault);
    assert_eq!((status.target_centi_c, status.duty), (None, 0));

    // The board refuses to begin, start or clear anything in this state.
    let begin = BeginJob { plan_id: 7, layers: 1, robot_hash: robot.hash() };
    let refused = client.request("to begin", &PassiveRequest::BeginJob(begin)).unwrap_err();
    let state = State::Fault;
    assert!(
        matches!(refused, ClientError::Refused { refusal: Refusal::WrongState { state: answer }, .. } if answer == state),
        "{refused}"
    );
    let refused = client
        .energize(
            "to start",
            &EnergizingRequest::Start(Start {
                plan_id: 7,
                on_host_silence: HostSilencePolicy::Pause,
                is_continuation: false,
            }),
            &Permit::standalone(),
        )
        .unwrap_err();
    assert!(matches!(refused, ClientError::Refused { refusal: Refusal::PlanMismatch { board: 0 }, .. }), "{refused}");
    let refused = client
        .energize("to clear the fault", &EnergizingRequest::ClearFault(Empty {}), &Permit::standalone())
        .unwrap_err();
    assert!(matches!(refused, ClientError::Refused { refusal: Refusal::FaultRemains { .. }, .. }), "{refused}");
}

#[test]
fn without_its_crystal_the_board_responds_but_refuses_work() {
    let setup = netduinoplus2::Setup { without_crystal: true, trace: None };
    let board = netduinoplus2::boot_with(&firmware("stm32f405"), &setup).unwrap();
    let mut client = client_of(&board);
    let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
    client.open_session_for(&robot).unwrap();
    let status = client.status().unwrap();
    assert_eq!((status.state, status.fault), (State::Fault, Some(Fault::ClockFailed)));
    let refused = client
        .energize("to clear the fault", &EnergizingRequest::ClearFault(Empty {}), &Permit::standalone())
        .unwrap_err();
    let fault = Fault::ClockFailed;
    assert!(
        matches!(refused, ClientError::Refused { refusal: Refusal::FaultRemains { fault: answer }, .. } if answer == fault),
        "{refused}"
    );
}

fn client_of(board: &netduinoplus2::Board) -> Client {
    let link = board.link.try_clone().unwrap();
    Client::new(Box::new(Stream::over("netduinoplus2".to_owned(), link).unwrap()), "netduinoplus2")
}
