//! The robot's own image, unmodified, boots in the emulator and answers over its serial line.
//!
//! There its pins read low and its converter gives nothing: to this board that is a robot whose drivers report a fault and whose
//! sensors are silent. So its self-test must fail, and nothing must ever be switched on.

use std::thread::sleep;
use std::time::{Duration, Instant};

use growbot_core::link::message::{Begin, Empty, Fault, Message, Refusal, Silence, Start, State};
use growbot_host::client::{Client, ClientError};
use growbot_host::port::stream::Stream;
use growbot_host::robot_file;
use growbot_tests::{firmware, netduinoplus2};

#[test]
fn the_robots_board_says_hello_and_answers_requests() {
    let board = netduinoplus2::boot(&firmware("stm32f405")).unwrap();
    let mut client = client_of(&board);

    let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
    let hello = client.hello_robot(&robot).unwrap();
    assert_eq!(hello.robot_name, "growbot-a");
    assert!(matches!(hello.status.state, State::SelfTest | State::Fault), "{:?}", hello.status.state);
    assert_eq!((hello.status.target_centi_c, hello.status.duty), (None, 0));

    // The clock runs.
    let before = client.status().unwrap().uptime_ms;
    sleep(Duration::from_millis(100));
    assert!(client.status().unwrap().uptime_ms > before);

    // The self-test ends, within its 2 s and some for a slow machine, by a fault that such sensors are.
    let deadline = Instant::now() + Duration::from_secs(20);
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

    // Nothing is begun, started or cleared while that is so.
    let begin = Begin { plan_id: 7, layers: 1, robot: robot.hash() };
    let refused = client.request("to begin", &Message::Begin(begin)).unwrap_err();
    let state = State::Fault;
    assert!(
        matches!(refused, ClientError::Refused { refusal: Refusal::WrongState { state: said }, .. } if said == state),
        "{refused}"
    );
    let refused =
        client.request("to start", &Message::Start(Start { plan_id: 7, silence: Silence::Hold })).unwrap_err();
    assert!(matches!(refused, ClientError::Refused { refusal: Refusal::OtherPlan { board: 0 }, .. }), "{refused}");
    let refused = client.request("to clear the fault", &Message::ClearFault(Empty {})).unwrap_err();
    assert!(matches!(refused, ClientError::Refused { refusal: Refusal::FaultRemains { .. }, .. }), "{refused}");
}

#[test]
fn without_its_crystal_the_board_answers_and_refuses_to_work() {
    let setup = netduinoplus2::Setup { without_crystal: true, trace: None };
    let board = netduinoplus2::boot_with(&firmware("stm32f405"), &setup).unwrap();
    let mut client = client_of(&board);
    let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
    client.hello_robot(&robot).unwrap();
    let status = client.status().unwrap();
    assert_eq!((status.state, status.fault), (State::Fault, Some(Fault::ClockFailed)));
    let refused = client.request("to clear the fault", &Message::ClearFault(Empty {})).unwrap_err();
    let fault = Fault::ClockFailed;
    assert!(
        matches!(refused, ClientError::Refused { refusal: Refusal::FaultRemains { fault: said }, .. } if said == fault),
        "{refused}"
    );
}

fn client_of(board: &netduinoplus2::Board) -> Client {
    let link = board.link.try_clone().unwrap();
    Client::new(Box::new(Stream::over("netduinoplus2".to_owned(), link).unwrap()), "netduinoplus2")
}
