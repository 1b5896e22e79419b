//! A simulated board at the end of a serial line or TCP connection, with faults that a test sets, and programs such as
//! `growbot grow` that use the line.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::net::TcpListener;
use std::os::unix::fs::OpenOptionsExt;
use std::process::{Child, Stdio};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle, sleep};
use std::time::{Duration, Instant};

use growbot_client::port::Port;
use growbot_core::link::emergency_stop::EmergencyStopDetector;
use growbot_core::link::message::State;
use growbot_core::random::Rng;
use growbot_plan::robot_file;
use growbot_sim::port::sim::Sim;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use serialport::{SerialPort, TTYPort};

use crate::running::{PATIENCE, PROGRAM, Ran, command, in_lines};

/// Ratio of the board's time to real time while it neither grows nor pauses.
const PACE: u32 = 50;
/// Ratio of the board's time to real time while it grows or pauses. The ratio is low, so that 10 s of the board's time
/// are enough for a host that a busy machine delays.
const PACE_OF_GROWTH: u32 = 2;
/// Temperature of a warm nozzle, degrees Celsius.
const WARM_C: f64 = 190.0;
/// Number of bytes of the board that arrive at a time, as from a UART. Two programs that read the line may each receive
/// some of the bytes.
const PIECE: usize = 8;
/// Seed of the random bit errors of the line.
const SEED: u64 = 11;

/// Faults of the line between the host and the board.
#[derive(Default)]
pub struct Line {
    /// True if the line carries nothing in either direction.
    pub is_cut: bool,
    /// Number of emergency stops of the host after which a cut line works again. `None` if it stays cut.
    pub heals_after: Option<u32>,
    /// True if the line accepts no more bytes from the host, so that writes block.
    pub is_stalled: bool,
    /// Probability that a byte has a flipped bit after the transfer, in either direction.
    pub flips: f64,
    /// Bytes that the board receives next, as if the host had sent them.
    pub inject: Vec<u8>,
}

/// Observations of the line and the board, for a test.
#[derive(Debug, Clone)]
pub struct Seen {
    /// State of the board.
    pub state: State,
    /// True if the board's heater or a stepper is on.
    pub heats: bool,
    /// Number of emergency stops that the host has sent.
    pub stops: u32,
    /// Number of emergency stops that reached the board until the board carried one out. `None` if the board has not
    /// carried one out.
    pub passed: Option<u32>,
    /// True if heater and steppers were off as soon as the board had received the emergency stop that it carried out,
    /// before any time passed on the board. `None` before that.
    pub off_at_once: Option<bool>,
    /// Number of times that bytes of the board were sent to the host.
    pub answers: u32,
    /// Number of bytes that arrived from the host after the line was stalled and before the first emergency stop.
    pub bytes_before_stop: usize,
}

/// A simulated board at the end of a line. A thread runs the board until the value is dropped.
pub struct Bench {
    /// Name of the port at the host's end of the line, for `--port`.
    pub name: String,
    line: Arc<Mutex<Line>>,
    seen: Arc<Mutex<Seen>>,
    /// Open handle of a serial line's device, which prevents a hang-up of the line. `None` for TCP.
    _open: Option<File>,
    over: Arc<Mutex<bool>>,
    thread: Option<JoinHandle<()>>,
}

impl Bench {
    /// Starts a board on a serial line.
    pub fn new() -> Self {
        Self::on_serial(false)
    }

    /// Like [`Self::new`], but the nozzle is warm as soon as it is heated.
    pub fn warm() -> Self {
        Self::on_serial(true)
    }

    fn on_serial(is_warm: bool) -> Self {
        let (mut master, slave) = TTYPort::pair().unwrap();
        let name = slave.name().unwrap();
        // A plain file does not close the device to other programs, unlike serialport.
        let open = File::open(&name).unwrap();
        drop(slave);
        master.set_timeout(Duration::from_millis(1)).unwrap();
        Self::behind(name, Some(open), is_warm, |_| Some(master))
    }

    /// Starts a board behind TCP that accepts one connection.
    pub fn on_tcp() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let name = format!("tcp:{}", listener.local_addr().unwrap());
        listener.set_nonblocking(true).unwrap();
        Self::behind(name, None, false, move |over| {
            while !*over.lock().unwrap() {
                if let Ok((stream, _)) = listener.accept() {
                    stream.set_nonblocking(false).unwrap();
                    stream.set_nodelay(true).unwrap();
                    stream.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
                    return Some(stream);
                }
                sleep(Duration::from_millis(1));
            }
            None
        })
    }

    fn behind<L: Read + Write>(
        name: String,
        open: Option<File>,
        is_warm: bool,
        far_end: impl FnOnce(&Mutex<bool>) -> Option<L> + Send + 'static,
    ) -> Self {
        let seen = Seen {
            state: State::Idle,
            heats: false,
            stops: 0,
            passed: None,
            off_at_once: None,
            answers: 0,
            bytes_before_stop: 0,
        };
        let (line, seen, over) = (Arc::default(), Arc::new(Mutex::new(seen)), Arc::default());
        let thread = thread::spawn({
            let (line, seen, over) = (Arc::clone(&line), Arc::clone(&seen), Arc::clone(&over));
            move || {
                if let Some(end) = far_end(&over) {
                    carry(end, is_warm, &line, &seen, &over);
                }
            }
        });
        Self { name, line, seen, _open: open, over, thread: Some(thread) }
    }

    /// Changes the faults of the line.
    pub fn set(&self, change: impl FnOnce(&mut Line)) {
        change(&mut self.line.lock().unwrap());
    }

    pub fn seen(&self) -> Seen {
        self.seen.lock().unwrap().clone()
    }

    /// Writes to the host's end of the line until it accepts no more bytes, as a host does on a stalled line. Returns
    /// the number of bytes that it accepted.
    pub fn fill(&self) -> usize {
        let mut near = self.near_end();
        let mut taken = 0;
        // The kernel moves bytes to the far end for some time, on a busy machine later, and each move frees space.
        while self.takes_bytes() {
            while let Ok(count) = near.write(&[0xAA; 64]) {
                taken += count;
            }
            sleep(Duration::from_millis(100));
        }
        self.seen.lock().unwrap().bytes_before_stop = 0;
        taken
    }

    /// Returns true if the host's end of the line accepts bytes.
    pub fn takes_bytes(&self) -> bool {
        let near = self.near_end();
        poll(&mut [PollFd::new(&near, PollFlags::OUT)], Some(&Timespec::default())).unwrap() > 0
    }

    fn near_end(&self) -> File {
        let non_blocking = rustix::fs::OFlags::NONBLOCK.bits().cast_signed();
        OpenOptions::new().write(true).custom_flags(non_blocking).open(&self.name).unwrap()
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        *self.over.lock().unwrap() = true;
        if let Some(thread) = self.thread.take() {
            let done = thread.join();
            assert!(done.is_ok() || thread::panicking());
        }
    }
}

/// Carries bytes between the line and a simulated board until `over` is set.
fn carry(mut master: impl Read + Write, is_warm: bool, line: &Mutex<Line>, seen: &Mutex<Seen>, over: &Mutex<bool>) {
    println!("noise of seed {SEED}");
    let mut sim = Sim::new(robot_file::load("growbot-a".as_ref()).unwrap());
    if is_warm {
        sim.simulated_tip().preheat_instantly(WARM_C);
    }
    let (mut random, mut buffer) = (Rng::new(&[SEED]), [0; 256]);
    // Recognises the emergency stops that the host sends, even if the line is cut.
    let mut sent = EmergencyStopDetector::new();
    let (mut passes, mut last, mut has_gone) = (0, Instant::now(), false);
    while !*over.lock().unwrap() {
        let mut line = line.lock().unwrap();
        let count = if line.is_stalled { Ok(0) } else { master.read(&mut buffer) };
        let heats = |sim: &mut Sim| sim.simulated_tip().heater_is_on() || sim.simulated_tip().steppers_are_on();
        let mut bytes = std::mem::take(&mut line.inject);
        let mut idle = bytes.is_empty();
        let count = match count {
            Ok(count) => {
                has_gone |= count == 0;
                count
            }
            Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock) => 0,
            // A socket that is closed with unread bytes is reset.
            Err(error) if error.kind() == ErrorKind::ConnectionReset => {
                has_gone = true;
                0
            }
            Err(error) => panic!("the line is gone: {error}"),
        };
        for byte in buffer.iter().take(count) {
            idle = false;
            let mut seen = seen.lock().unwrap();
            seen.bytes_before_stop += usize::from(seen.stops == 0);
            if !line.is_cut {
                bytes.push(*byte);
            }
            if sent.push(*byte) {
                seen.stops += 1;
                passes += u32::from(!line.is_cut);
                if line.heals_after == Some(seen.stops) {
                    (line.is_cut, line.heals_after) = (false, None);
                }
                flip(&mut bytes, line.flips, &mut random);
                sim.send(&bytes).unwrap();
                bytes.clear();
                // No time has passed on the board yet.
                if sim.state() == State::EmergencyStop && seen.passed.is_none() {
                    (seen.passed, seen.off_at_once) = (Some(passes), Some(!heats(&mut sim)));
                }
            }
        }
        flip(&mut bytes, line.flips, &mut random);
        sim.send(&bytes).unwrap();
        let passed = last.elapsed();
        last = Instant::now();
        let grows = matches!(sim.state(), State::Growing | State::Paused);
        sim.run_for(passed * if grows { PACE_OF_GROWTH } else { PACE });
        {
            let mut seen = seen.lock().unwrap();
            (seen.state, seen.heats) = (sim.state(), heats(&mut sim));
        }
        let count = sim.receive(&mut buffer, Duration::ZERO).unwrap();
        let mut answer = buffer[..count].to_vec();
        flip(&mut answer, line.flips, &mut random);
        if !line.is_cut && !answer.is_empty() {
            seen.lock().unwrap().answers += 1;
            for piece in answer.chunks(PIECE) {
                // Bytes are lost if the host does not read.
                let _ = master.write_all(piece);
                sleep(Duration::from_micros(500));
            }
        }
        let idle = idle && count == 0;
        let stalled = line.is_stalled;
        drop(line);
        // A read returns at once after the host has gone.
        if idle && (stalled || has_gone) {
            sleep(Duration::from_millis(1));
        }
    }
}

/// Flips a random bit of each byte with this probability.
fn flip(bytes: &mut [u8], chance: f64, random: &mut Rng) {
    for byte in bytes {
        if random.uniform_between(0.0, 1.0) < chance {
            *byte ^= 1 << random.uniform_between(0.0, 8.0) as u32;
        }
    }
}

/// A running `growbot` command, usually `growbot grow`. The standard error is read by a thread.
pub struct Growing {
    child: Child,
    output: Arc<Mutex<String>>,
    listener: Option<JoinHandle<()>>,
}

impl Drop for Growing {
    /// Kills the program if it still runs when its test ends.
    fn drop(&mut self) {
        if self.is_running() {
            let _ = self.child.kill();
        }
    }
}

impl Growing {
    /// Starts a growth that takes hours, and waits until the board heats.
    pub fn begin(bench: &Bench) -> Self {
        let mut growing =
            Self::run(&["grow", "--to", "0,0,300,0,90", "--on-host-silence", "continue", "--port", &bench.name], "");
        growing.until_hot(bench);
        growing
    }

    /// Starts a growth by a script for `growbot console`, and waits until the board heats. The script then waits.
    pub fn by_console(bench: &Bench) -> Self {
        let mut growing =
            Self::run(&["console", "--port", &bench.name], "plan 0,0,60,0,90\nstart\nwait 1000000\nstart\n");
        growing.until_hot(bench);
        growing
    }

    /// Starts `growbot` in the background with these arguments and this text on its standard input.
    pub fn run(args: &[&str], input: &str) -> Self {
        let mut child = command(PROGRAM)
            .args(args)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        child.stdin.take().unwrap().write_all(input.as_bytes()).unwrap();
        let (mut stderr, output) = (child.stderr.take().unwrap(), Arc::new(Mutex::new(String::new())));
        let heard = Arc::clone(&output);
        let listener = thread::spawn(move || {
            let mut buffer = [0; 256];
            while let Ok(count @ 1..) = stderr.read(&mut buffer) {
                heard.lock().unwrap().push_str(&String::from_utf8_lossy(&buffer[..count]));
            }
        });
        Self { child, output, listener: Some(listener) }
    }

    fn until_hot(&mut self, bench: &Bench) {
        until("the board heats", || {
            assert!(self.is_running(), "{}", self.output());
            bench.seen().heats
        });
    }

    pub fn is_running(&mut self) -> bool {
        self.child.try_wait().unwrap().is_none()
    }

    fn output(&self) -> String {
        self.output.lock().unwrap().clone()
    }

    /// Sends Ctrl-C, and waits for a message with this text.
    pub fn interrupt(&mut self, answer: &str) {
        let killed = command("kill").args(["-INT", &self.child.id().to_string()]).status().unwrap();
        assert!(killed.success());
        until(answer, || self.output().contains(answer));
    }

    /// Waits until the program ends, and returns its exit code and its messages.
    pub fn end(mut self) -> Ran {
        let began = Instant::now();
        let code = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status.code();
            }
            assert!(began.elapsed() <= PATIENCE, "growbot does not end: {}", self.output());
            sleep(Duration::from_millis(10));
        };
        self.listener.take().into_iter().for_each(|listener| listener.join().unwrap());
        let err = in_lines(&self.output.lock().unwrap());
        Ran { code, out: String::new(), err }
    }
}

/// Waits until `is_so` returns true. `what` describes the condition in the message of a failure.
pub fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    let began = Instant::now();
    while !is_so() {
        assert!(began.elapsed() < PATIENCE, "{what}: not within {PATIENCE:?}");
        sleep(Duration::from_millis(5));
    }
}

/// Runs `growbot` without the privilege of root to open a device that another program holds exclusively.
pub fn without_privilege(args: &[&str]) -> Ran {
    const SYS_ADMIN: u64 = 1 << 21;
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let capabilities = status.lines().find_map(|line| line.strip_prefix("CapEff:")).unwrap();
    let is_privileged = u64::from_str_radix(capabilities.trim(), 16).unwrap() & SYS_ADMIN != 0;
    let mut command = if is_privileged {
        let mut command = command("setpriv");
        command.args(["--inh-caps=-sys_admin", "--bounding-set=-sys_admin", PROGRAM]);
        command
    } else {
        command(PROGRAM)
    };
    let output = command.args(args).stdin(Stdio::null()).output().unwrap();
    Ran {
        code: output.status.code(),
        out: String::from_utf8(output.stdout).unwrap(),
        err: in_lines(&String::from_utf8(output.stderr).unwrap()),
    }
}
