//! A simulated board at the far end of a line, serial or TCP, whose faults a test sets, and `growbot grow` at the near
//! end.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::net::TcpListener;
use std::os::unix::fs::OpenOptionsExt;
use std::process::{Child, Stdio};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle, sleep};
use std::time::{Duration, Instant};

use growbot_client::port::Port;
use growbot_client::robot_file;
use growbot_core::link::emergency_stop::EmergencyStopDetector;
use growbot_core::link::message::State;
use growbot_core::random::Rng;
use growbot_sim::port::sim::Sim;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use serialport::{SerialPort, TTYPort};

use crate::running::{PATIENCE, PROGRAM, Ran, command, in_lines};

/// The board's time passes faster than real time by this factor,
const PACE: u32 = 50;
/// and so once it grows or pauses: 10 s of it are long enough for a host that a busy machine holds up.
const PACE_OF_GROWTH: u32 = 2;
/// The temperature at which a nozzle is warm, degrees Celsius.
const WARM_C: f64 = 190.0;
/// What the board says arrives in such pieces, bytes, as from a UART: of two programs that read the line, each may have
/// some of them.
const PIECE: usize = 8;
/// Seed of the noise.
const SEED: u64 = 11;

/// What a line does to what it carries.
#[derive(Default)]
pub struct Line {
    /// Nothing passes, either way.
    pub is_cut: bool,
    /// A line that is disconnected passes again after this many emergency stops.
    pub heals_after: Option<u32>,
    /// It takes no bytes of the host.
    pub is_stalled: bool,
    /// Chance that a bit of a byte is turned over, either way.
    pub flips: f64,
    /// Comes to the board next, as if the host had sent it.
    pub inject: Vec<u8>,
}

/// What was seen of the line and the board.
#[derive(Debug, Clone)]
pub struct Seen {
    /// The board's state.
    pub state: State,
    /// Whether its heater is on.
    pub heats: bool,
    /// Emergency stops that the host has sent.
    pub stops: u32,
    /// The one that came first while the line passed, and was obeyed: 1 for the first such.
    pub passed: Option<u32>,
    /// Whether all was off as soon as that one had arrived, before any time passed on the board.
    pub off_at_once: Option<bool>,
    /// How often the board has answered.
    pub answers: u32,
    /// Bytes that came after the line was stalled, before the first stop.
    pub bytes_before_stop: usize,
}

/// A board at the end of a line.
pub struct Bench {
    /// The near end's name.
    pub name: String,
    line: Arc<Mutex<Line>>,
    seen: Arc<Mutex<Seen>>,
    /// Keeps a serial line from being hung up.
    _open: Option<File>,
    over: Arc<Mutex<bool>>,
    thread: Option<JoinHandle<()>>,
}

impl Bench {
    /// A board on a serial line.
    pub fn new() -> Self {
        Self::on_serial(false)
    }

    /// The same whose nozzle is warm as soon as it is heated.
    pub fn warm() -> Self {
        Self::on_serial(true)
    }

    fn on_serial(is_warm: bool) -> Self {
        let (mut master, slave) = TTYPort::pair().unwrap();
        let name = slave.name().unwrap();
        // Not closed to others, as serialport would have it.
        let open = File::open(&name).unwrap();
        drop(slave);
        master.set_timeout(Duration::from_millis(1)).unwrap();
        Self::behind(name, Some(open), is_warm, |_| Some(master))
    }

    /// A board behind TCP, which hears one host.
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

    /// Changes what the line does.
    pub fn set(&self, change: impl FnOnce(&mut Line)) {
        change(&mut self.line.lock().unwrap());
    }

    pub fn seen(&self) -> Seen {
        self.seen.lock().unwrap().clone()
    }

    /// Writes to the near end until it takes no more, as a host does whose line has stalled. Bytes that it has taken.
    pub fn fill(&self) -> usize {
        let mut near = self.near_end();
        let mut taken = 0;
        // Twice: what the far end still takes makes room.
        for _ in 0..2 {
            while let Ok(count) = near.write(&[0xAA; 64]) {
                taken += count;
            }
            sleep(Duration::from_millis(50));
        }
        self.seen.lock().unwrap().bytes_before_stop = 0;
        assert!(!self.takes_bytes());
        taken
    }

    /// Whether the near end takes bytes.
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

/// Carries bytes between the line and a simulated board until it is over.
fn carry(mut master: impl Read + Write, is_warm: bool, line: &Mutex<Line>, seen: &Mutex<Seen>, over: &Mutex<bool>) {
    println!("noise of seed {SEED}");
    let mut sim = Sim::new(robot_file::load("growbot-a".as_ref()).unwrap());
    if is_warm {
        sim.simulated_tip().warm_at_once(WARM_C);
    }
    let (mut random, mut buffer) = (Rng::new(&[SEED]), [0; 256]);
    // Of what the host sends, and of what of it passes.
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
            // A socket that is closed with bytes unread is reset.
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
                // Before any time passes on the board.
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
        sim.pass(passed * if grows { PACE_OF_GROWTH } else { PACE });
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
                // Where nobody reads, it is lost.
                let _ = master.write_all(piece);
                sleep(Duration::from_micros(500));
            }
        }
        let idle = idle && count == 0;
        let stalled = line.is_stalled;
        drop(line);
        // A host that has gone makes reading return at once.
        if idle && (stalled || has_gone) {
            sleep(Duration::from_millis(1));
        }
    }
}

/// Turns bits over.
fn flip(bytes: &mut [u8], chance: f64, random: &mut Rng) {
    for byte in bytes {
        if random.uniform_between(0.0, 1.0) < chance {
            *byte ^= 1 << random.uniform_between(0.0, 8.0) as u32;
        }
    }
}

/// `growbot grow`, under way.
pub struct Growing {
    child: Child,
    said: Arc<Mutex<String>>,
    listener: Option<JoinHandle<()>>,
}

impl Drop for Growing {
    /// One that a test has not seen end does not outlive it.
    fn drop(&mut self) {
        if self.is_running() {
            let _ = self.child.kill();
        }
    }
}

impl Growing {
    /// Begins a body of some hours, and waits until the board heats.
    pub fn begin(bench: &Bench) -> Self {
        let mut growing =
            Self::run(&["grow", "--to", "0,0,300,0,90", "--on-silence", "continue", "--port", &bench.name], "");
        growing.until_hot(bench);
        growing
    }

    /// The same by a script for the console, which then waits.
    pub fn by_console(bench: &Bench) -> Self {
        let mut growing =
            Self::run(&["console", "--port", &bench.name], "plan 0,0,60,0,90\nstart\nwait 1000000\nstart\n");
        growing.until_hot(bench);
        growing
    }

    /// Runs `growbot` and leaves it running.
    pub fn run(args: &[&str], input: &str) -> Self {
        let mut child = command(PROGRAM)
            .args(args)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        child.stdin.take().unwrap().write_all(input.as_bytes()).unwrap();
        let (mut stderr, said) = (child.stderr.take().unwrap(), Arc::new(Mutex::new(String::new())));
        let heard = Arc::clone(&said);
        let listener = thread::spawn(move || {
            let mut buffer = [0; 256];
            while let Ok(count @ 1..) = stderr.read(&mut buffer) {
                heard.lock().unwrap().push_str(&String::from_utf8_lossy(&buffer[..count]));
            }
        });
        Self { child, said, listener: Some(listener) }
    }

    fn until_hot(&mut self, bench: &Bench) {
        until("the board heats", || {
            assert!(self.is_running(), "{}", self.said());
            bench.seen().heats
        });
    }

    pub fn is_running(&mut self) -> bool {
        self.child.try_wait().unwrap().is_none()
    }

    fn said(&self) -> String {
        self.said.lock().unwrap().clone()
    }

    /// Ctrl-C, and waits until it is answered so.
    pub fn interrupt(&mut self, answer: &str) {
        let killed = command("kill").args(["-INT", &self.child.id().to_string()]).status().unwrap();
        assert!(killed.success());
        until(answer, || self.said().contains(answer));
    }

    /// Waits for its end.
    pub fn end(mut self) -> Ran {
        let began = Instant::now();
        let code = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status.code();
            }
            assert!(began.elapsed() <= PATIENCE, "growbot does not end: {}", self.said());
            sleep(Duration::from_millis(10));
        };
        self.listener.take().into_iter().for_each(|listener| listener.join().unwrap());
        let err = in_lines(&self.said.lock().unwrap());
        Ran { code, out: String::new(), err }
    }
}

/// Waits for something that takes a moment.
pub fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    let began = Instant::now();
    while !is_so() {
        assert!(began.elapsed() < PATIENCE, "{what}: not within {PATIENCE:?}");
        sleep(Duration::from_millis(5));
    }
}

/// Runs `growbot` without the privilege by which the superuser opens devices that are closed to others.
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
