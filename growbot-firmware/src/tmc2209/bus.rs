//! One exchange at a time on the drivers' line: a register is written, or read with a few attempts (data sheet of the
//! TMC2209, rev. 1.09, 4.1).
//!
//! What the board sends comes back to it, as all share one wire. An answer is told apart by its address, which no
//! request has, its register and its CRC; whatever else comes in is passed over.

use tmc2209::reg::{Address, State};
use tmc2209::{MASTER_ADDR, ReadRequest, SYNC_AND_RESERVED, WriteRequest, crc};

/// A serial line with one wire for both directions. Nothing waits.
pub trait Wire {
    /// Sends some bytes, 8 at most. False where there is no room for all of them, and then none is sent.
    fn send(&mut self, bytes: &[u8]) -> bool;
    /// The next byte that has come in, the board's own ones included.
    fn receive(&mut self) -> Option<u8>;
}

/// Rate of the line, baud. Drivers take what the host's line has: 9,600 to 500,000 (4.2).
pub const BAUD: u32 = 115_200;
/// Bytes of an answer.
const ANSWER_BYTES: usize = 8;
/// Time until 8 bytes of 10 bits are written and the line is quiet again, us: twice what they take.
const WRITTEN_US: u64 = 2 * 8 * 10 * 1_000_000 / BAUD as u64;
/// Max time from a request to its answer's end, us: 12 bytes and the driver's delay take 1.3 ms.
const ANSWER_US: u64 = 10_000;
/// How often a register is asked for.
const ATTEMPTS: u8 = 3;
/// Bytes that are taken at once: what a FIFO holds.
const TAKEN_AT_ONCE: usize = 32;

/// How an exchange has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outcome {
    /// A register was written. Only the driver's counter says whether it was taken.
    Written,
    /// A register was read.
    Read(u32),
    /// No answer came, or none that is whole.
    Silent,
}

#[derive(Debug, Clone, Copy)]
enum Exchange {
    None,
    /// Bytes wait for room until this time.
    Sending {
        node: u8,
        what: What,
        attempts: u8,
        until: u64,
    },
    /// They have been sent, and something is due by this time.
    Sent {
        node: u8,
        what: What,
        attempts: u8,
        until: u64,
    },
}

#[derive(Debug, Clone, Copy)]
enum What {
    Read(Address),
    Write(State),
}

/// The line, and the exchange under way.
pub(super) struct Bus<W> {
    wire: W,
    exchange: Exchange,
    /// The latest bytes that have come in.
    latest: [u8; ANSWER_BYTES],
}

impl<W: Wire> Bus<W> {
    pub(super) fn new(wire: W) -> Self {
        Self { wire, exchange: Exchange::None, latest: [0; ANSWER_BYTES] }
    }

    /// Begins to read a register of a driver.
    pub(super) fn read(&mut self, node: u8, register: Address, now: u64) {
        self.begin(node, What::Read(register), ATTEMPTS, now);
    }

    /// Begins to write one.
    pub(super) fn write(&mut self, node: u8, state: State, now: u64) {
        self.begin(node, What::Write(state), 1, now);
    }

    fn begin(&mut self, node: u8, what: What, attempts: u8, now: u64) {
        self.exchange = Exchange::Sending { node, what, attempts, until: now.saturating_add(ANSWER_US) };
        self.send(now);
    }

    /// Sends what waits for room, if there is some.
    fn send(&mut self, now: u64) {
        let Exchange::Sending { node, what, attempts, .. } = self.exchange else { return };
        // What has come in until now is no answer to this.
        self.take();
        self.latest = [0; ANSWER_BYTES];
        let (sent, time) = match what {
            What::Read(register) => (self.wire.send(ReadRequest::from_addr(node, register).bytes()), ANSWER_US),
            What::Write(state) => {
                let request = WriteRequest::from_raw_data(node, state.addr(), state);
                (self.wire.send(request.bytes()), WRITTEN_US)
            }
        };
        if sent {
            self.exchange = Exchange::Sent { node, what, attempts, until: now.saturating_add(time) };
        }
    }

    /// How the exchange has ended; none while it is under way, and where there is none.
    pub(super) fn poll(&mut self, now: u64) -> Option<Outcome> {
        // Bytes come first: an answer counts that was there in time and looked at late.
        let answer = self.take();
        match self.exchange {
            Exchange::None => None,
            Exchange::Sending { until, .. } => {
                self.send(now);
                (now > until).then(|| self.end(Outcome::Silent))
            }
            Exchange::Sent { node, what, attempts, until } => match (what, answer) {
                (What::Read(_), Some(value)) => Some(self.end(Outcome::Read(value))),
                _ if now <= until => None,
                (What::Write(_), _) => Some(self.end(Outcome::Written)),
                (What::Read(_), None) if attempts > 1 => {
                    self.begin(node, what, attempts - 1, now);
                    None
                }
                (What::Read(_), None) => Some(self.end(Outcome::Silent)),
            },
        }
    }

    fn end(&mut self, outcome: Outcome) -> Outcome {
        self.exchange = Exchange::None;
        outcome
    }

    /// Takes bytes that have come in: the value, where they end an answer to what was asked.
    fn take(&mut self) -> Option<u32> {
        for _ in 0..TAKEN_AT_ONCE {
            let byte = self.wire.receive()?;
            let [_, rest @ ..] = self.latest;
            let [b1, b2, b3, b4, b5, b6, b7] = rest;
            self.latest = [b1, b2, b3, b4, b5, b6, b7, byte];
            if let Exchange::Sent { what: What::Read(register), .. } = self.exchange
                && let Some(value) = answer(&self.latest, register)
            {
                return Some(value);
            }
        }
        None
    }
}

/// The value in an answer (table 4.1.2); none where the bytes are none, or that of another register.
fn answer(bytes: &[u8; ANSWER_BYTES], register: Address) -> Option<u32> {
    let [sync, master, of, value @ .., check] = *bytes;
    let is_answer = sync & 0xF == SYNC_AND_RESERVED && master == MASTER_ADDR && of == register as u8;
    let [covered @ .., _] = bytes;
    (is_answer && crc(covered) == check).then_some(u32::from_be_bytes(value))
}
