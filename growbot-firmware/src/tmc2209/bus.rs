//! The serial line of the stepper drivers. It makes one exchange at a time: it writes a register, or reads one with
//! several attempts (data sheet of the TMC2209, rev. 1.09, 4.1).
//!
//! The board receives its own bytes too, because board and drivers share one wire. A response is recognised by its
//! address, which no request has, its register and its CRC. All other bytes are ignored.

use tmc2209::reg::{Address, State};
use tmc2209::{MASTER_ADDR, ReadRequest, SYNC_AND_RESERVED, WriteRequest, crc};

/// Serial line with one wire for both directions. Its functions never wait.
pub trait SingleWireUart {
    /// Sends at most 8 bytes. Returns `false`, and sends no byte, if the transmit buffer does not have room for all of
    /// them.
    fn send(&mut self, bytes: &[u8]) -> bool;
    /// Returns the next received byte. `None` if no byte has arrived. The bytes that the board itself has sent are
    /// received too.
    fn receive(&mut self) -> Option<u8>;
}

/// Rate of the drivers' serial line, baud. The drivers detect the rate of the host's line: 9,600 to 500,000 (4.2).
pub const BAUD: u32 = 115_200;
/// Length of a driver's response, bytes.
const ANSWER_BYTES: usize = 8;
/// Time until 8 bytes of 10 bits are written and the line is quiet again, us. The value is twice the time that the
/// bytes take on the line.
const WRITTEN_US: u64 = 2 * 8 * 10 * 1_000_000 / BAUD as u64;
/// Max time from a request to the end of its response, us. 12 bytes and the driver's delay take 1.3 ms.
const ANSWER_US: u64 = 10_000;
/// Max number of attempts to read a register of a driver.
const ATTEMPTS: u8 = 3;
/// Max number of received bytes that one call processes: the capacity of a FIFO.
const TAKEN_AT_ONCE: usize = 32;

/// Result of an exchange with a driver.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TransactionResult {
    /// A register was written. Only the driver's counter of writes shows whether the driver accepted the write.
    Written,
    /// A register was read, and has this value.
    Read(u32),
    /// No valid response of the driver arrived.
    Silent,
}

#[derive(Debug, Clone, Copy)]
enum Transaction {
    None,
    /// The request waits until the time `until`, us, for room in the transmit buffer.
    Sending {
        node: u8,
        what: RegisterAccess,
        attempts: u8,
        until: u64,
    },
    /// The request has been sent. A response, or the end of the write, is due by the time `until`, us.
    Sent {
        node: u8,
        what: RegisterAccess,
        attempts: u8,
        until: u64,
    },
}

#[derive(Debug, Clone, Copy)]
enum RegisterAccess {
    Read(Address),
    Write(State),
}

/// The serial line of the drivers, and the current exchange.
pub(super) struct Bus<W> {
    wire: W,
    exchange: Transaction,
    /// The latest received bytes, of which the newest is the last.
    latest: [u8; ANSWER_BYTES],
}

impl<W: SingleWireUart> Bus<W> {
    pub(super) fn new(wire: W) -> Self {
        Self { wire, exchange: Transaction::None, latest: [0; ANSWER_BYTES] }
    }

    /// Begins to read a register of the driver with the address `node`.
    pub(super) fn read(&mut self, node: u8, register: Address, now: u64) {
        self.begin(node, RegisterAccess::Read(register), ATTEMPTS, now);
    }

    /// Begins to write a register of the driver with the address `node`.
    pub(super) fn write(&mut self, node: u8, state: State, now: u64) {
        self.begin(node, RegisterAccess::Write(state), 1, now);
    }

    fn begin(&mut self, node: u8, what: RegisterAccess, attempts: u8, now: u64) {
        self.exchange = Transaction::Sending { node, what, attempts, until: now.saturating_add(ANSWER_US) };
        self.send(now);
    }

    /// Sends the pending request if the transmit buffer has room for it.
    fn send(&mut self, now: u64) {
        let Transaction::Sending { node, what, attempts, .. } = self.exchange else { return };
        // Bytes received until now are not a response to this request.
        self.take();
        self.latest = [0; ANSWER_BYTES];
        let (sent, time) = match what {
            RegisterAccess::Read(register) => {
                (self.wire.send(ReadRequest::from_addr(node, register).bytes()), ANSWER_US)
            }
            RegisterAccess::Write(state) => {
                let request = WriteRequest::from_raw_data(node, state.addr(), state);
                (self.wire.send(request.bytes()), WRITTEN_US)
            }
        };
        if sent {
            self.exchange = Transaction::Sent { node, what, attempts, until: now.saturating_add(time) };
        }
    }

    /// Continues the exchange and returns its result once it has ended. `None` while the exchange is in progress, and
    /// if no exchange was started.
    pub(super) fn poll(&mut self, now: u64) -> Option<TransactionResult> {
        // Received bytes are processed first, so that a response that arrived in time counts even if it is read late.
        let answer = self.take();
        match self.exchange {
            Transaction::None => None,
            Transaction::Sending { until, .. } => {
                self.send(now);
                (now > until).then(|| self.end(TransactionResult::Silent))
            }
            Transaction::Sent { node, what, attempts, until } => match (what, answer) {
                (RegisterAccess::Read(_), Some(value)) => Some(self.end(TransactionResult::Read(value))),
                _ if now <= until => None,
                (RegisterAccess::Write(_), _) => Some(self.end(TransactionResult::Written)),
                (RegisterAccess::Read(_), None) if attempts > 1 => {
                    self.begin(node, what, attempts - 1, now);
                    None
                }
                (RegisterAccess::Read(_), None) => Some(self.end(TransactionResult::Silent)),
            },
        }
    }

    fn end(&mut self, outcome: TransactionResult) -> TransactionResult {
        self.exchange = Transaction::None;
        outcome
    }

    /// Processes the received bytes. Returns the value of the register if they complete the response to the current
    /// request.
    fn take(&mut self) -> Option<u32> {
        for _ in 0..TAKEN_AT_ONCE {
            let byte = self.wire.receive()?;
            let [_, rest @ ..] = self.latest;
            let [b1, b2, b3, b4, b5, b6, b7] = rest;
            self.latest = [b1, b2, b3, b4, b5, b6, b7, byte];
            if let Transaction::Sent { what: RegisterAccess::Read(register), .. } = self.exchange
                && let Some(value) = answer(&self.latest, register)
            {
                return Some(value);
            }
        }
        None
    }
}

/// Returns the value of the register in a driver's response (table 4.1.2). `None` if the bytes are not a response, or
/// the response is for another register.
fn answer(bytes: &[u8; ANSWER_BYTES], register: Address) -> Option<u32> {
    let [sync, master, of, value @ .., check] = *bytes;
    let is_answer = sync & 0xF == SYNC_AND_RESERVED && master == MASTER_ADDR && of == register as u8;
    let [covered @ .., _] = bytes;
    (is_answer && crc(covered) == check).then_some(u32::from_be_bytes(value))
}
