//! Tests of the emergency stop from the host: over a serial line that `grow` holds, through noise, over a line that is
//! cut in the middle of a frame, and by a second Ctrl-C. The stop must reach the board within 1 s (six attempts) after
//! the line works. Otherwise the host must print that the power has to be cut.

use std::cell::{Cell, RefCell};
use std::fs::OpenOptions;
use std::net::TcpListener;
use std::rc::Rc;
use std::thread;
use std::time::Duration;

use emergency::{Bench, Growing, until, without_privilege};
use growbot_client::client::{Client, ClientError, EMERGENCY_LIMIT, EMERGENCY_PAUSE};
use growbot_client::port::{Port, PortError};
use growbot_core::link::emergency_stop::EMERGENCY_STOP;
use growbot_core::link::frame::{FrameHeader, encode};
use growbot_core::link::message::State;
use growbot_core::random::Rng;
use growbot_plan::robot_file;
use growbot_sim::port::sim::Sim;
use running::{Ran, growbot};
use rustix::fs::{FlockOperation, fcntl_lock};
use serialport::{SerialPort, TTYPort};

use crate::fake_board::FakeBoard;
use crate::{emergency, running};

/// Number of emergency stops that the host sends per second.
const A_SECOND: u32 = 6;

/// Checks that the command reported an unconfirmed emergency stop: exit code 1, and a message to cut the power that
/// contains `parts`.
fn assert_power_to_be_cut(ran: &Ran, parts: &[&str]) {
    assert_eq!(ran.code, Some(1), "{}", ran.err);
    assert!(ran.out.is_empty(), "{}", ran.out);
    for part in [&["cut the robot's power"], parts].concat() {
        assert!(ran.err.contains(part), "{part:?} is not in {:?}", ran.err);
    }
}

/// A simulated board on a line with a virtual clock. Noise reaches the host at the full rate of the line. Half of the
/// bytes of the noise are zeros, each of which ends an incomplete frame. Bytes of the host do not reach the board until
/// the line is usable.
struct Noisy {
    sim: Rc<RefCell<Sim>>,
    random: Rng,
    usable_at: Duration,
    /// Number of emergency stops that the host sent, and number of those that reached the board.
    sent: Rc<Cell<(u32, u32)>>,
}

/// Time of a byte at 115200 baud.
const BYTE: Duration = Duration::from_nanos(86_806);

impl Port for Noisy {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        let is_usable = self.now() >= self.usable_at;
        if bytes == EMERGENCY_STOP {
            let (sent, carried) = self.sent.get();
            self.sent.set((sent + 1, carried + u32::from(is_usable)));
        }
        if is_usable { self.sim.send(bytes) } else { Ok(()) }
    }

    fn receive(&mut self, buffer: &mut [u8], _: Duration) -> Result<usize, PortError> {
        let count = buffer.len().min(32);
        let mut answer = [0; 256];
        let answered = self.sim.receive(&mut answer, Duration::ZERO)?;
        self.sim.borrow_mut().run_for(BYTE * (count + answered) as u32);
        // Bytes of the board arrive unbroken between the noise. A zero before them ends the frame that the noise has
        // begun.
        let noise = buffer.iter_mut().take(count - answered.min(count));
        if answered > 0 {
            let whole: Vec<u8> = [&[0], &answer[..answered]].concat();
            let length = whole.len().min(buffer.len());
            buffer[..length].copy_from_slice(&whole[..length]);
            return Ok(length);
        }
        noise.for_each(|byte| *byte = self.random.uniform_between(-256.0, 256.0) as u8);
        Ok(count)
    }

    fn now(&self) -> Duration {
        self.sim.borrow().now()
    }
}

/// Sends an emergency stop to a board behind a noisy line that is usable after this time. Returns the result, the
/// board's state, the numbers of stops that were sent and that reached the board, and the duration of the attempts, s.
fn stop_behind_noise(usable_after: Duration) -> (Result<(), ClientError>, State, (u32, u32), f64) {
    let sim = Rc::new(RefCell::new(Sim::new(robot_file::load("growbot-a".as_ref()).unwrap())));
    sim.borrow_mut().run_for(Duration::from_secs(5));
    let began = sim.borrow().now();
    let sent = Rc::default();
    let line =
        Noisy { sim: Rc::clone(&sim), random: Rng::new(&[3]), usable_at: began + usable_after, sent: Rc::clone(&sent) };
    let done = Client::new(Box::new(line), "noise").emergency_stop();
    let board = sim.borrow();
    (done, board.state(), sent.get(), (board.now() - began).as_secs_f64())
}

#[test]
fn noise_at_line_rate_does_not_end_an_emergency_stop_early() {
    for milliseconds in [0, 600, 2800] {
        let usable = Duration::from_millis(milliseconds);
        let (done, state, (sent, carried), seconds) = stop_behind_noise(usable);
        println!("usable after {milliseconds} ms: {sent} stops sent, told after {seconds:.3} s");
        assert!(done.is_ok(), "{milliseconds} ms: {done:?} after {seconds} s, {sent} stops");
        assert_eq!(state, State::EmergencyStop);
        assert!(carried <= A_SECOND && seconds <= usable.as_secs_f64() + 1.0, "{carried} attempts, {seconds} s");
    }
}

#[test]
fn an_emergency_stop_is_retried_until_its_timeout() {
    let (done, _, (sent, _), seconds) = stop_behind_noise(Duration::MAX / 2);
    assert!(matches!(done, Err(ClientError::StopNotAcknowledged { .. })), "{done:?}");
    let limit = EMERGENCY_LIMIT.as_secs_f64();
    assert!((limit..limit + EMERGENCY_PAUSE.as_secs_f64()).contains(&seconds), "{seconds} s");
    let attempts = (limit / EMERGENCY_PAUSE.as_secs_f64()) as u32;
    // A pause ends with the frame during which it expires.
    assert!((attempts - 2..=attempts + 1).contains(&sent), "{sent} of {attempts} stops");
}

/// A broken line, which loses everything. Each attempt to send takes 1 s of its virtual clock. The counter is the
/// number of attempts.
struct Broken(Rc<Cell<u32>>);

impl Port for Broken {
    fn send(&mut self, _: &[u8]) -> Result<(), PortError> {
        self.0.set(self.0.get() + 1);
        Err(PortError::Lost("nowhere".to_string(), std::io::Error::other("it is broken")))
    }

    fn receive(&mut self, _: &mut [u8], _: Duration) -> Result<usize, PortError> {
        Err(PortError::Lost("nowhere".to_string(), std::io::Error::other("it is broken")))
    }

    fn now(&self) -> Duration {
        Duration::from_secs(self.0.get().into())
    }
}

#[test]
fn a_broken_link_is_retried_until_the_timeout() {
    let sent = Rc::default();
    let done = Client::new(Box::new(Broken(Rc::clone(&sent))), "nowhere").emergency_stop();
    assert!(matches!(done, Err(ClientError::StopNotAcknowledged { .. })), "{done:?}");
    assert_eq!(u64::from(sent.get()), EMERGENCY_LIMIT.as_secs());
}

#[test]
fn the_stop_reaches_a_board_whose_port_is_held_by_grow() {
    let bench = Bench::new();
    let growing = Growing::begin(&bench);
    // Other commands respect the lock of a port.
    let status = growbot(&["status", "--port", &bench.name]);
    assert_eq!(status.code, Some(2), "{}", status.err);
    assert!(status.err.contains("is in use by") && status.err.contains("growbot estop --port"), "{}", status.err);
    // A missing robot file does not delay the stop. Without the privilege, a port that is closed to others could not be
    // opened.
    let ran = without_privilege(&["estop", "--port", &bench.name, "--robot", "/no/such.toml"]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    assert!(ran.out.contains("heater and steppers of the robot are off"), "{}", ran.out);
    let grown = growing.end();
    assert_eq!(grown.code, Some(1), "{}", grown.err);
    assert!(grown.err.contains("emergency stop"), "{}", grown.err);
    let seen = bench.seen();
    assert_eq!((seen.state, seen.passed, seen.off_at_once), (State::EmergencyStop, Some(1), Some(true)), "{seen:?}");
}

#[test]
fn the_port_holder_is_silent_while_an_emergency_stop_listens() {
    let bench = Bench::new();
    let listening = OpenOptions::new().read(true).write(true).open(&bench.name).unwrap();
    fcntl_lock(&listening, FlockOperation::NonBlockingLockExclusive).unwrap();
    let mut status = Growing::run(&["status", "--port", &bench.name], "");
    // The board responds to repetitions of one request. The command needs three responses.
    until("the board answers some times", || {
        assert!(status.is_running(), "it has read an answer");
        bench.seen().answers >= 8
    });
    fcntl_lock(&listening, FlockOperation::NonBlockingUnlock).unwrap();
    let ran = status.end();
    assert_eq!(ran.code, Some(0), "{}", ran.err);
}

#[test]
fn ctrl_c_stops_the_robot_of_a_waiting_script() {
    let bench = Bench::new();
    let mut console = Growing::by_console(&bench);
    console.interrupt("stopping");
    let ran = console.end();
    assert_eq!(ran.code, Some(1), "{}", ran.err);
    assert!(ran.err.contains("stopped: heater and steppers of the robot are off"), "{}", ran.err);
    until("the board is stopped", || bench.seen().state == State::Stopped);
}

#[test]
fn a_script_that_ends_while_heating_reports_it() {
    for (line, code, parts) in [
        ("dance", 1, &["line 4 failed", "2 more commands are not executed, among them `stop` in line 6"][..]),
        ("quit", 0, &[][..]),
    ] {
        let bench = Bench::new();
        let script = format!("plan 0,0,60,0,90\nstart\nwait 5\n{line}\nstatus\nstop\n");
        let ran = Growing::run(&["console", "--port", &bench.name], &script).end();
        assert_eq!(ran.code, Some(code), "{}", ran.err);
        let remedy = format!("`growbot stop --port {}`", bench.name);
        // On a slow machine the nozzle may be hot by then.
        let is_at_work = ["heating", "homing", "growing"].map(|state| ran.err.contains(&format!("robot is {state}")));
        assert!(is_at_work.contains(&true), "{}", ran.err);
        for part in [&["pauses after the current layer", "300 s", &remedy], parts].concat() {
            assert!(ran.err.contains(part), "no {part:?}: {}", ran.err);
        }
        // The heater is off for moments while it holds the temperature.
        until("the board still heats", || bench.seen().heats);
    }
}

#[test]
fn the_stop_gets_through_noise_while_grow_holds_the_port() {
    let bench = Bench::new();
    let growing = Growing::begin(&bench);
    bench.set(|line| line.flips = 0.01);
    let ran = without_privilege(&["estop", "--port", &bench.name]);
    until("the board stops", || bench.seen().state == State::EmergencyStop);
    let seen = bench.seen();
    assert!(seen.passed.is_some_and(|attempts| attempts <= A_SECOND), "{seen:?}");
    // On such a line, every acknowledgement may be lost. In that case the command reports it.
    if ran.code != Some(0) {
        assert_power_to_be_cut(&ran, &[]);
    }
    bench.set(|line| line.flips = 0.0);
    let grown = growing.end();
    assert_eq!(grown.code, Some(1), "{}", grown.err);
}

#[test]
fn the_stop_gets_through_after_a_partial_frame() {
    let bench = Bench::new();
    let growing = Growing::begin(&bench);
    // The line is cut when it has carried half a frame of the growing host. It works again after five stops.
    let whole = encode(&FrameHeader { kind: 4, session: 1, seq: 1, ack: 0 }, &[7; 200]).unwrap();
    bench.set(|line| {
        line.inject = whole[..whole.len() / 2].to_vec();
        line.is_cut = true;
        line.heals_after = Some(5);
    });
    let ran = without_privilege(&["estop", "--port", &bench.name]);
    until("the board stops", || bench.seen().state == State::EmergencyStop);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    let seen = bench.seen();
    assert!(seen.passed.is_some_and(|attempts| attempts <= A_SECOND) && seen.stops > 5, "{seen:?}");
    assert_eq!(seen.off_at_once, Some(true));
    let grown = growing.end();
    assert_eq!(grown.code, Some(1), "{}", grown.err);
}

#[test]
fn a_dead_link_is_reported_after_the_timeout() {
    let bench = Bench::new();
    bench.set(|line| line.is_cut = true);
    let ran = growbot(&["estop", "--port", &bench.name]);
    assert_power_to_be_cut(&ran, &[&bench.name, "for 3 s"]);
    assert!(bench.seen().stops > 1, "{:?}", bench.seen());
}

#[test]
fn the_second_ctrl_c_stops_a_board_that_ignored_the_first() {
    for bench in [Bench::new(), Bench::on_tcp()] {
        the_second_ctrl_c_stops(&bench);
    }
}

fn the_second_ctrl_c_stops(bench: &Bench) {
    let mut growing = Growing::begin(bench);
    bench.set(|line| {
        line.is_cut = true;
        line.heals_after = Some(3);
    });
    growing.interrupt("stopping");
    growing.interrupt("sending the emergency stop");
    let grown = growing.end();
    assert_eq!(grown.code, Some(1), "{}", grown.err);
    assert!(grown.err.contains("emergency stop: heater and steppers are off"), "{}", grown.err);
    let seen = bench.seen();
    assert_eq!((seen.state, seen.off_at_once), (State::EmergencyStop, Some(true)), "{seen:?}");
    assert!(seen.passed.is_some_and(|attempts| attempts <= A_SECOND), "{seen:?}");
}

#[test]
fn the_second_ctrl_c_overtakes_unsent_bytes_of_a_stalled_link() {
    let bench = Bench::new();
    let mut growing = Growing::begin(&bench);
    // The line takes no more bytes and its queue is full, so writes of `grow` block.
    bench.set(|line| line.is_stalled = true);
    let queued = bench.fill();
    growing.interrupt("stopping");
    growing.interrupt("sending the emergency stop");
    until("the stop is ahead of the queue", || bench.takes_bytes());
    bench.set(|line| line.is_stalled = false);
    let grown = growing.end();
    assert_eq!(grown.code, Some(1), "{}", grown.err);
    assert!(grown.err.contains("emergency stop: heater and steppers are off"), "{}", grown.err);
    let seen = bench.seen();
    assert_eq!((seen.state, seen.off_at_once), (State::EmergencyStop, Some(true)), "{seen:?}");
    // Bytes that were queued on this side were dropped. The far end of such a line had already taken some.
    println!("{queued} bytes queued, {} of them before the stop", seen.bytes_before_stop);
    assert!(seen.bytes_before_stop < queued / 2, "{seen:?}");
}

#[test]
fn the_second_ctrl_c_on_a_dead_link_asks_to_cut_the_power() {
    let bench = Bench::new();
    let mut growing = Growing::begin(&bench);
    bench.set(|line| line.is_cut = true);
    growing.interrupt("stopping");
    growing.interrupt("sending the emergency stop");
    assert_power_to_be_cut(&growing.end(), &[&bench.name]);
    assert!(bench.seen().stops > 1);
}

#[test]
fn every_failed_emergency_stop_asks_to_cut_the_power() {
    let estop = |port: &str| growbot(&["estop", "--port", port]);
    assert_power_to_be_cut(&growbot(&["estop"]), &["no port given", "GROWBOT_PORT"]);
    assert_power_to_be_cut(&growbot(&["estop", "--bogus"]), &["--bogus"]);
    assert_power_to_be_cut(&growbot(&["estop", "--port"]), &["--port"]);
    assert_power_to_be_cut(&growbot(&["estop", "--port", "sim", "--link-fault", "drop=200%"]), &["200%"]);
    assert_power_to_be_cut(&estop("simulator"), &["simulator"]);
    assert_power_to_be_cut(&estop("sim"), &["was not sent: no robot runs at sim"]);
    assert_power_to_be_cut(&estop("emulator"), &["was not sent: no robot runs at emulator"]);
    // These commands retry for the whole time, so they run in parallel.
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let held = format!("tcp:{}", listener.local_addr().unwrap());
    let [missing, no_device, refused, lost, held] = thread::scope(|scope| {
        let tried = [
            scope.spawn(|| estop("/dev/ttyNONE7")),
            scope.spawn(|| estop("/proc/self/status")),
            scope.spawn(|| estop(&format!("tcp:127.0.0.1:{free}"))),
            scope.spawn(|| estop(&FakeBoard::silent().port())),
            // Another host is connected, so this connection waits.
            scope.spawn(|| estop(&held)),
        ];
        tried.map(|tried| tried.join().unwrap())
    });
    assert_power_to_be_cut(&missing, &["/dev/ttyNONE7", "not found"]);
    assert_power_to_be_cut(&no_device, &["/proc/self/status"]);
    assert_power_to_be_cut(&refused, &["no response at", "refused", "tried ", " times in "]);
    assert_power_to_be_cut(&lost, &[" has not responded for 3 s", "tried ", " times in 3."]);
    assert_power_to_be_cut(&held, &["one program at a time"]);
    for ran in [&refused, &lost] {
        assert!(!ran.err.contains("no connection within"), "{}", ran.err);
        assert_eq!((ran.err.matches("DID NOT CONFIRM").count(), ran.err.lines().count()), (1, 1), "{}", ran.err);
    }
    // Help is not an emergency.
    assert_eq!(growbot(&["estop", "--help"]).code, Some(0));
    assert_eq!(growbot(&["stop", "--bogus"]).code, Some(2));
}

#[test]
fn an_exclusively_locked_port_is_reported() {
    let (_master, slave) = TTYPort::pair().unwrap();
    let name = slave.name().unwrap();
    drop(slave);
    let mut locked = TTYPort::open(&serialport::new(&name, 115_200)).unwrap();
    locked.set_exclusive(true).unwrap();
    assert_power_to_be_cut(&without_privilege(&["estop", "--port", &name]), &[&name, "locked by"]);
}
