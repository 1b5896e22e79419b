//! The robot's own image, unmodified, boots in the emulator and answers over its serial line.

use growbot_core::link::message::{Message, Refusal, Start, State};
use growbot_host::client::{Client, ClientError};
use growbot_host::port::stream::Stream;
use growbot_host::robot_file;
use growbot_tests::{firmware, netduinoplus2};

#[test]
fn the_robots_board_says_hello_and_answers_requests() {
    let board = netduinoplus2::boot(&firmware("stm32f405")).unwrap();
    let link = board.link.try_clone().unwrap();
    let mut client = Client::new(Box::new(Stream::over("netduinoplus2".to_owned(), link).unwrap()), "netduinoplus2");

    let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
    let hello = client.hello_robot(&robot).unwrap();
    assert_eq!(hello.robot_name, "growbot-a");
    assert_eq!(hello.status.state, State::Idle);
    assert_eq!(hello.status.target_centi_c, None);

    // The clock runs.
    let before = client.status().unwrap().uptime_ms;
    std::thread::sleep(std::time::Duration::from_millis(100));
    assert!(client.status().unwrap().uptime_ms > before);

    // What makes no sense is refused.
    let refused = client.request("to start", &Message::Start(Start { plan_id: 7 })).unwrap_err();
    assert!(matches!(refused, ClientError::Refused { refusal: Refusal::OtherPlan { board: 0 }, .. }), "{refused}");
}
