//! Hostile boards behind a TCP connection: a simulated robot whose messages are changed on their way to the host, or a
//! sender of noise.

use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::thread;
use std::time::{Duration, Instant};

use growbot_client::port::Port;
use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::frame::{self, FrameDecoder, FrameHeader, LinkFrame};
use growbot_core::link::message::{BoardInfo, LayerLaid, Message, Refusal, RefusalResponse, Status};
use growbot_core::random::Rng;
use growbot_plan::robot_file;
use growbot_sim::port::sim::Sim;

/// Time after which a board closes its connection. The host must then end.
pub const LIFE: Duration = Duration::from_secs(3);

/// Numbers at the limits of common types.
const EXTREMES: [u32; 8] = [0, 1, 63, 65_535, 1 << 31, u32::MAX - 2, u32::MAX - 1, u32::MAX];
/// Texts that control a terminal.
const HOSTILE: [&str; 4] = ["\u{1b}[2J\u{1b}[31mA", "\u{9b}2J\u{7}", "\u{202e}\u{2066}bot", "a\r\nb\u{7f}"];

/// Behaviour of a board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Manner {
    /// The board sends nothing.
    Silent,
    /// The board sends random bytes.
    Noise,
    /// The board sends random messages in valid frames.
    RandomMessages,
    /// The board is a simulated robot whose messages are changed, in valid frames.
    Lies,
    /// The board is a simulated robot whose frames are lost, repeated, swapped and corrupted.
    Garbles,
}

impl Manner {
    /// Behaviours that the tests use in turn. [`Self::Lies`] is the most frequent.
    pub const ALL: [Self; 8] = [
        Self::Lies,
        Self::Garbles,
        Self::Lies,
        Self::RandomMessages,
        Self::Lies,
        Self::Noise,
        Self::Lies,
        Self::Silent,
    ];
}

/// Starts a hostile board behind TCP that accepts one connection. Returns the value of `--port` for the board.
pub fn start(manner: Manner, seed: u64) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    thread::spawn(move || {
        if let Ok((stream, _)) = listener.accept() {
            // A host that closes the connection is not a fault of the board.
            let _ = serve(stream, manner, Rng::new(&[seed, 99]));
        }
    });
    format!("tcp:127.0.0.1:{port}")
}

fn serve(mut line: TcpStream, manner: Manner, mut random: Rng) -> std::io::Result<()> {
    line.set_nodelay(true)?;
    line.set_read_timeout(Some(Duration::from_millis(2)))?;
    line.set_write_timeout(Some(LIFE))?;
    let mut sim = Sim::new(robot_file::load("growbot-a2".as_ref()).unwrap());
    let (mut to_us, mut from_sim) = (FrameDecoder::default(), FrameDecoder::default());
    let mut last: Vec<u8> = Vec::new();
    let mut buffer = [0; 512];
    let began = Instant::now();
    while began.elapsed() < LIFE {
        let count = match line.read(&mut buffer) {
            Ok(0) => return Ok(()),
            Ok(count) => count,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => 0,
            Err(error) => return Err(error),
        };
        let heard = buffer.get(..count).unwrap_or_default().to_vec();
        match manner {
            Manner::Silent => {}
            Manner::Noise => {
                let noise: Vec<u8> = (0..random.below(600)).map(|_| random.next_u64() as u8).collect();
                line.write_all(&noise)?;
            }
            Manner::RandomMessages => {
                for byte in heard {
                    let Some(Ok(request)) = to_us.push(byte) else { continue };
                    let body: Vec<u8> = (0..random.below(120)).map(|_| random.next_u64() as u8).collect();
                    let kind =
                        if random.below(2) == 0 { 0x40 + random.below(24) as u8 } else { random.next_u64() as u8 };
                    let header = FrameHeader { kind, ack: request.header.seq, ..request.header };
                    line.write_all(&frame::encode(&header, &body).unwrap())?;
                }
            }
            Manner::Lies | Manner::Garbles => {
                sim.send(&heard).unwrap();
                let count = sim.receive(&mut buffer, Duration::from_secs(2)).unwrap();
                for byte in buffer.get(..count).unwrap_or_default() {
                    let Some(Ok(frame)) = from_sim.push(*byte) else { continue };
                    let bytes = frame::encode(&frame.header, &frame.body).unwrap().to_vec();
                    let answer = if manner == Manner::Lies {
                        lie(&frame, bytes, &mut random)
                    } else {
                        garble(bytes, &mut last, &mut random)
                    };
                    line.write_all(&answer)?;
                }
            }
        }
    }
    Ok(())
}

fn extreme(random: &mut Rng) -> u32 {
    EXTREMES[random.below(EXTREMES.len() as u64) as usize]
}

/// Replaces a random field of a status by an extreme or random value.
fn status(status: &mut Status, random: &mut Rng) {
    match random.below(6) {
        0 => status.layers_laid = extreme(random),
        1 => status.next_layer = extreme(random),
        2 => status.layer_count = extreme(random),
        3 => status.uptime_ms = if random.below(2) == 0 { u64::MAX } else { random.next_u64() },
        4 => status.temperature_centi_c = Some(extreme(random).cast_signed()),
        _ => status.plan_id = random.next_u64(),
    }
}

/// Returns the bytes of the frame unchanged, or at random the bytes of a frame with a changed message.
fn lie(frame: &LinkFrame, bytes: Vec<u8>, random: &mut Rng) -> Vec<u8> {
    if random.below(3) > 0 {
        return bytes;
    }
    let name = HOSTILE[random.below(HOSTILE.len() as u64) as usize];
    let Ok(message) = Message::decode(frame.header.kind, &frame.body) else { return bytes };
    let told = match message {
        Message::LayerLaid(laid) => {
            let measured = laid.readings;
            let as_built: Option<LayerBytes> =
                (random.below(2) == 0).then(|| std::array::from_fn(|_| random.next_u64() as u8));
            Message::LayerLaid(LayerLaid { index: extreme(random), as_built, readings: measured, ..laid })
        }
        Message::BoardInfo(mut hello) => {
            match random.below(4) {
                0 => hello.robot_name = name.try_into().unwrap(),
                1 => hello.layer_capacity = extreme(random),
                _ => status(&mut hello.status, random),
            }
            Message::BoardInfo(BoardInfo { boot_id: extreme(random), ..hello })
        }
        Message::Status(mut told) => {
            status(&mut told, random);
            Message::Status(told)
        }
        Message::Accepted(mut accepted) => {
            if random.below(2) == 0 {
                accepted.next = extreme(random);
            } else {
                accepted.free_layers = extreme(random);
            }
            Message::Accepted(accepted)
        }
        _ if random.below(4) == 0 => {
            let refusal = match random.below(4) {
                0 => Refusal::OutOfOrder { expected: extreme(random) },
                1 => Refusal::LayerAlreadyBegun { first: extreme(random) },
                2 => Refusal::LayerOutOfLimits { index: extreme(random) },
                _ => Refusal::OwnedByOtherHost { silent_ms: extreme(random) },
            };
            Message::Refused(RefusalResponse { kind: frame.header.kind, refusal })
        }
        _ => {
            // Changes the body in a way that may still be a message.
            let mut body = frame.body.to_vec();
            let at = random.below(body.len().max(1) as u64) as usize;
            if let Some(byte) = body.get_mut(at) {
                *byte = random.next_u64() as u8;
            }
            return frame::encode(&frame.header, &body).map_or(bytes, |frame| frame.to_vec());
        }
    };
    let mut buffer = [0; frame::MAX_BODY_LEN];
    let header = FrameHeader { kind: told.kind(), ..frame.header };
    match told.encode(&mut buffer) {
        Ok(body) => frame::encode(&header, body).map_or(bytes, |frame| frame.to_vec()),
        Err(_) => bytes,
    }
}

/// Returns the bytes that arrive if a frame is sent over a very bad line. `last` is a frame that is held back and sent
/// later.
fn garble(mut bytes: Vec<u8>, last: &mut Vec<u8>, random: &mut Rng) -> Vec<u8> {
    match random.below(8) {
        0 => Vec::new(),
        1 => bytes.repeat(2),
        2 => std::mem::replace(last, bytes),
        3 => {
            bytes.truncate(random.below(bytes.len() as u64 + 1) as usize);
            bytes
        }
        4 => {
            let at = random.below(bytes.len() as u64) as usize;
            bytes[at] = random.next_u64() as u8;
            bytes
        }
        // Noise that is longer than any frame.
        5 => [vec![0x55; 2000], bytes].concat(),
        _ => bytes,
    }
}
