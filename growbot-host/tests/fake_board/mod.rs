//! Fake boards for tests: simulated robots over TCP or a serial line, and boards that misbehave.

use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread;
use std::time::Duration;

use growbot_client::port::Port;
use growbot_core::link::frame::{self, FrameDecoder, FrameHeader, LinkFrame, MAX_BODY_LEN};
use growbot_core::link::message::{BoardInfo, Hello, Message, Refusal, RefusalResponse};
use growbot_plan::robot_file;
use growbot_sim::port::sim::Sim;
use serialport::{SerialPort, TTYPort};

/// A fake board on a TCP port of this machine. Its thread ends with the connection or with the test process.
pub struct FakeBoard {
    port: u16,
    /// Number of layers reported by a [`lasting`](FakeBoard::lasting) board after which the board's time almost stops.
    pauses_after: Arc<AtomicU32>,
    /// True if a [`lasting`](FakeBoard::lasting) board behaves as if its firmware had another message schema.
    is_other_release: Arc<AtomicBool>,
}

impl FakeBoard {
    fn serving(serve: impl FnOnce(TcpStream) + Send + 'static) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        thread::spawn(move || {
            if let Ok((stream, _)) = listener.accept() {
                serve(stream);
            }
        });
        Self { port, pauses_after: Arc::default(), is_other_release: Arc::default() }
    }

    /// Returns the value of `--port` for this board.
    pub fn port(&self) -> String {
        format!("tcp:127.0.0.1:{}", self.port)
    }

    /// Starts a board that receives everything and sends nothing.
    pub fn silent() -> Self {
        Self::serving(|mut stream| while matches!(stream.read(&mut [0; 256]), Ok(1..)) {})
    }

    /// Starts a device that sends data in another protocol all the time.
    pub fn garbage() -> Self {
        Self::serving(|mut stream| while stream.write_all(b"$GPGGA,123519,4807.038,N\r\n\0").is_ok() {})
    }

    /// Starts a board that closes the connection after it has received the first bytes.
    pub fn that_hangs_up() -> Self {
        Self::serving(|mut stream| {
            let _ = stream.read(&mut [0; 256]);
        })
    }

    /// Starts a board that responds with frames of this version.
    pub fn of_frame_version(version: u8) -> Self {
        Self::serving(move |mut stream| {
            while matches!(stream.read(&mut [0; 256]), Ok(1..)) {
                let header = FrameHeader { kind: 0x41, session: 1, seq: 1, ack: 1 };
                let mut raw = [0; 256];
                let bytes = frame::encode(&header, &[]).unwrap();
                let length = cobs_decode(&bytes[..bytes.len() - 1], &mut raw);
                raw[0] = version;
                let checksum = crc::Crc::<u32>::new(&crc::CRC_32_ISCSI).checksum(&raw[..length - 4]);
                raw[length - 4..length].copy_from_slice(&checksum.to_le_bytes());
                let mut again = vec![0; 300];
                let count = cobs::encode(&raw[..length], &mut again);
                let _ = stream.write_all(&again[..=count]);
            }
        })
    }

    /// Starts a board that refuses every request, because its message schema has this hash.
    pub fn of_schema(board: u64) -> Self {
        Self::serving(move |mut stream| {
            let mut receiver = FrameDecoder::default();
            let mut byte = [0];
            while matches!(stream.read(&mut byte), Ok(1)) {
                let Some(Ok(request)) = receiver.push(byte[0]) else { continue };
                let refusal = Refusal::SchemaMismatch { board };
                let message = Message::Refused(RefusalResponse { kind: request.header.kind, refusal });
                let mut buffer = [0; MAX_BODY_LEN];
                let body = message.encode(&mut buffer).unwrap();
                let header = FrameHeader { kind: message.kind(), ack: request.header.seq, ..request.header };
                let _ = stream.write_all(&frame::encode(&header, body).unwrap());
            }
        })
    }

    /// Starts a simulated robot that accepts one TCP connection. Its time passes fast.
    pub fn simulated(robot: &'static str) -> Self {
        Self::serving(move |stream| {
            stream.set_nodelay(true).unwrap();
            stream.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
            serve(stream, robot, |_| true);
        })
    }

    /// Starts a simulated robot that accepts successive TCP connections. Its time passes also between connections.
    pub fn lasting(robot: &'static str) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        listener.set_nonblocking(true).unwrap();
        let port = listener.local_addr().unwrap().port();
        let pauses_after = Arc::new(AtomicU32::new(u32::MAX));
        let limit = Arc::clone(&pauses_after);
        let is_other_release = Arc::new(AtomicBool::new(false));
        let is_other = Arc::clone(&is_other_release);
        thread::spawn(move || {
            let mut sim = Sim::new(robot_file::load(robot.as_ref()).unwrap());
            let told = AtomicU32::new(0);
            let look = || {
                let pauses = told.load(Ordering::Relaxed) >= limit.load(Ordering::Relaxed);
                if pauses { Duration::from_millis(1) } else { Duration::from_secs(1) }
            };
            let count = |frame: &LinkFrame| {
                if let Ok(Message::LayerLaid(laid)) = Message::decode(frame.header.kind, &frame.body) {
                    told.fetch_max(laid.index + 1, Ordering::Relaxed);
                }
                true
            };
            loop {
                match listener.accept() {
                    Ok((stream, _)) => {
                        stream.set_nonblocking(false).unwrap();
                        stream.set_nodelay(true).unwrap();
                        stream.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
                        if is_other.load(Ordering::Relaxed) {
                            serve_sim(&mut sim, OtherRelease::new(stream), count, look);
                        } else {
                            serve_sim(&mut sim, stream, count, look);
                        }
                        // A board waits 10 s for a host that has gone.
                        sim.run_for(Duration::from_secs(12));
                    }
                    Err(_) => {
                        sim.run_for(look());
                        thread::sleep(Duration::from_millis(1));
                    }
                }
            }
        });
        Self { port, pauses_after, is_other_release }
    }

    /// Selects the message schema of a [`lasting`](FakeBoard::lasting) board for later connections: another schema if
    /// `is_other` is true.
    pub fn set_other_release(&self, is_other: bool) {
        self.is_other_release.store(is_other, Ordering::Relaxed);
    }

    /// Lets the time of a [`lasting`](FakeBoard::lasting) board pass fast until the board has reported this number of
    /// layers. Afterwards the time passes slowly, so that a test has time to act.
    pub fn pause_after(&self, layers: u32) {
        self.pauses_after.store(layers, Ordering::Relaxed);
    }

    /// Starts a simulated robot on a line that loses every second report of a laid layer.
    pub fn losing_reports(robot: &'static str) -> Self {
        Self::serving(move |stream| {
            stream.set_nodelay(true).unwrap();
            stream.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
            let mut reports = 0;
            serve(stream, robot, move |frame| {
                reports += u32::from(frame.header.kind == 0x50);
                frame.header.kind != 0x50 || reports % 2 == 1
            });
        })
    }

    /// Starts a simulated robot at the end of a serial line. Returns the robot's thread.
    pub fn on_serial(mut master: TTYPort, robot: &'static str) -> thread::JoinHandle<()> {
        master.set_timeout(Duration::from_millis(1)).unwrap();
        thread::spawn(move || serve(master, robot, |_| true))
    }
}

/// Transfers frames between a line and a simulated robot until the line is closed. The robot's time passes by 1 s for
/// each poll of the line. Only those frames of the robot for which `passes` returns true are transferred.
fn serve(line: impl Read + Write, robot: &str, passes: impl FnMut(&LinkFrame) -> bool) {
    let mut sim = Sim::new(robot_file::load(robot.as_ref()).unwrap());
    serve_sim(&mut sim, line, passes, || Duration::from_secs(1));
}

/// Like [`serve`], but `look` returns the time that passes on the robot for each poll of the line, and the robot is
/// given.
fn serve_sim(
    sim: &mut Sim,
    mut line: impl Read + Write,
    mut passes: impl FnMut(&LinkFrame) -> bool,
    look: impl Fn() -> Duration,
) {
    let mut receiver = FrameDecoder::default();
    let mut buffer = [0; 256];
    loop {
        match line.read(&mut buffer) {
            Ok(0) => return,
            Ok(count) => sim.send(&buffer[..count]).unwrap(),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => return,
        }
        let count = sim.receive(&mut buffer, look()).unwrap();
        for byte in &buffer[..count] {
            let Some(Ok(frame)) = receiver.push(*byte) else { continue };
            if passes(&frame) && line.write_all(&frame::encode(&frame.header, &frame.body).unwrap()).is_err() {
                return;
            }
        }
    }
}

/// A line that simulates a board with another message schema. It inverts the hash of the schema in the messages between
/// host and board.
struct OtherRelease<L> {
    line: L,
    from_host: FrameDecoder,
    from_board: FrameDecoder,
    /// Bytes of the frame that the host is sending and that is not complete yet.
    partial: Vec<u8>,
    /// Bytes of complete frames of the host, which the board has not read yet.
    ready: VecDeque<u8>,
}

impl<L> OtherRelease<L> {
    fn new(line: L) -> Self {
        Self {
            line,
            from_host: FrameDecoder::default(),
            from_board: FrameDecoder::default(),
            partial: Vec::new(),
            ready: VecDeque::new(),
        }
    }

    /// Returns the bytes of a frame after `change` has changed its message. `None` if `change` returns `None` or the
    /// frame has no valid message.
    fn changed(frame: &LinkFrame, change: impl FnOnce(Message) -> Option<Message>) -> Option<Vec<u8>> {
        let message = change(Message::decode(frame.header.kind, &frame.body).ok()?)?;
        let mut buffer = [0; MAX_BODY_LEN];
        let body = message.encode(&mut buffer).unwrap();
        Some(frame::encode(&FrameHeader { kind: message.kind(), ..frame.header }, body).unwrap().to_vec())
    }
}

impl<L: Read> Read for OtherRelease<L> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let count = self.line.read(buffer)?;
        for byte in &buffer[..count] {
            self.partial.push(*byte);
            let frame = self.from_host.push(*byte);
            if *byte == 0 {
                let hello = frame.and_then(Result::ok).and_then(|frame| {
                    Self::changed(&frame, |message| match message {
                        Message::Hello(hello) => Some(Message::Hello(Hello { schema: !hello.schema, ..hello })),
                        _ => None,
                    })
                });
                self.ready.extend(hello.as_ref().unwrap_or(&self.partial));
                self.partial.clear();
            }
        }
        if count > 0 && self.ready.is_empty() {
            return Err(ErrorKind::WouldBlock.into());
        }
        self.ready.read(buffer)
    }
}

impl<L: Write> Write for OtherRelease<L> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let frame = bytes.iter().find_map(|byte| self.from_board.push(*byte)).and_then(Result::ok);
        let changed = frame.and_then(|frame| {
            Self::changed(&frame, |message| match message {
                Message::BoardInfo(info) => {
                    Some(Message::BoardInfo(BoardInfo { schema_hash: !info.schema_hash, ..info }))
                }
                Message::Refused(RefusalResponse { kind, refusal: Refusal::SchemaMismatch { board } }) => {
                    Some(Message::Refused(RefusalResponse { kind, refusal: Refusal::SchemaMismatch { board: !board } }))
                }
                _ => None,
            })
        });
        self.line.write_all(changed.as_deref().unwrap_or(bytes))?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.line.flush()
    }
}

fn cobs_decode(stuffed: &[u8], into: &mut [u8]) -> usize {
    let mut bytes = stuffed.to_vec();
    let length = cobs::decode_in_place(&mut bytes).unwrap();
    into[..length].copy_from_slice(&bytes[..length]);
    length
}
