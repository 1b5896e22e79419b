//! Requests to a simulated board, over connections that deliver only some of them.

use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::time::Duration;

use growbot_client::client::{Client, ClientError};
use growbot_client::port::{Port, PortError};
use growbot_client::robot_command::StopOutcome;
use growbot_client::stop_signal::Permit;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::{LayerBytes, LayerEncoder};
use growbot_core::link::emergency_stop::EMERGENCY_STOP;
use growbot_core::link::message::{BeginJob, Message, PassiveRequest, Refusal, State};
use growbot_plan::robot_file;
use growbot_sim::port::sim::Sim;
use growbot_sim::tip::TipFault;

/// A port that counts the bytes that the host sends.
struct Counting(Sim, Rc<Cell<usize>>);

impl Port for Counting {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        self.1.set(self.1.get() + bytes.len());
        self.0.send(bytes)
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        self.0.receive(buffer, timeout)
    }

    fn now(&self) -> Duration {
        self.0.now()
    }
}

#[test]
fn on_a_clean_link_most_bytes_are_layers() {
    let robot = robot_file::load("growbot-a".as_ref()).unwrap();
    let sent = Rc::new(Cell::new(0));
    let mut client = Client::new(Box::new(Counting(Sim::new(robot.clone()), Rc::clone(&sent))), "sim");
    client.open_session_for(&robot).unwrap();
    let mut encoder = LayerEncoder::default();
    let layers: Vec<LayerBytes> = (0..4096)
        .map(|index| encoder.encode(&Layer { alpha: f64::from(index) * 0.01, height: 0.7, tilt: 0.006 }))
        .collect();
    let plan_id = u64::MAX;
    let begin = BeginJob { plan_id, layers: 4096, robot_hash: robot.hash() };
    let Message::Accepted(accepted) = client.request("to begin", &PassiveRequest::BeginJob(begin)).unwrap() else {
        panic!()
    };
    let before = sent.get();
    let accepted = client.upload_layers(plan_id, &layers, accepted).unwrap();
    assert_eq!((accepted.next, accepted.free_layers), (4096, 0));
    let bytes = sent.get() - before;
    let share = (layers.len() * 12) as f64 / bytes as f64;
    let seconds = bytes as f64 * 10.0 / 115_200.0;
    println!("{bytes} bytes for 4,096 layers: {:.1} % layers, {seconds:.2} s at 115200 baud", 100.0 * share);
    assert!(share >= 0.85 && seconds < 8.0);
    assert_eq!(client.repeated(), 0);
}

/// A connection that delivers only the emergency stop to the board.
struct OnlyStops(Rc<RefCell<Sim>>);

impl Port for OnlyStops {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        if bytes == EMERGENCY_STOP { self.0.send(bytes) } else { Ok(()) }
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        self.0.receive(buffer, timeout)
    }

    fn now(&self) -> Duration {
        self.0.now()
    }
}

fn shared_sim() -> Rc<RefCell<Sim>> {
    Rc::new(RefCell::new(Sim::new(robot_file::load("growbot-a".as_ref()).unwrap())))
}

#[test]
fn an_unanswered_stop_becomes_an_emergency_stop() {
    let sim = shared_sim();
    let mut client = Client::new(Box::new(OnlyStops(Rc::clone(&sim))), "sim");
    assert_eq!(client.stop().unwrap(), StopOutcome::ByEmergencyStop);
    assert_eq!(sim.borrow().state(), State::EmergencyStop);
    let mut client = Client::new(Box::new(shared_sim()), "sim");
    client.open_session().unwrap();
    assert_eq!(client.stop().unwrap(), StopOutcome::ByRequest);
}

#[test]
fn a_link_emergency_stop_clears_at_once_but_a_pressed_button_does_not() {
    let sim = shared_sim();
    let mut client = Client::new(Box::new(Rc::clone(&sim)), "sim");
    client.open_session().unwrap();
    for _ in 0..3 {
        client.emergency_stop().unwrap();
        assert_eq!(sim.borrow().state(), State::EmergencyStop);
        client.clear_fault(&Permit::standalone()).unwrap();
        assert_eq!(sim.borrow().state(), State::Idle);
    }
    sim.borrow_mut().inject(TipFault::EmergencyStop);
    client.wait(Duration::from_millis(100)).unwrap();
    let refused = client.clear_fault(&Permit::standalone()).unwrap_err();
    assert!(matches!(refused, ClientError::Refused { refusal: Refusal::EmergencyStop, .. }), "{refused}");
}
