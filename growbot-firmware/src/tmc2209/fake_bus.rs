//! Model of the drivers' serial line for tests: four TMC2209 drivers that share one wire.

use std::cell::RefCell;
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;
use std::vec::Vec;

use tmc2209::crc;

use super::SingleWireUart;

pub const GSTAT: u8 = 0x01;
pub const IFCNT: u8 = 0x02;
pub const TSTEP: u8 = 0x12;
pub const SG_RESULT: u8 = 0x41;
pub const DRV_STATUS: u8 = 0x6F;
/// Value of DRV_STATUS while the motor turns in StealthChop. [`STANDING`] is the value while the motor stands still.
pub const TURNING: u32 = 1 << 30;
pub const STANDING: u32 = 1 << 31 | TURNING;

/// Model of one TMC2209 driver.
#[derive(Clone)]
pub struct Chip {
    pub registers: BTreeMap<u8, u32>,
    /// Number of writes to this driver, including those that it did not accept.
    pub writes: u32,
    /// True if the driver does not respond.
    pub silent: bool,
    /// True if the driver accepts and counts no writes.
    pub deaf: bool,
    /// Number of the next responses that have a wrong CRC.
    pub corrupt: u32,
}

impl Chip {
    fn new() -> Self {
        let mut chip = Self { registers: BTreeMap::new(), writes: 0, silent: false, deaf: false, corrupt: 0 };
        chip.start_anew();
        chip
    }

    /// Sets the registers to their values after a short loss of the driver's supply.
    pub fn start_anew(&mut self) {
        self.registers = BTreeMap::from([(GSTAT, 1), (DRV_STATUS, STANDING), (TSTEP, 0xFFFFF), (SG_RESULT, 300)]);
    }

    fn write(&mut self, register: u8, value: u32) {
        self.writes += 1;
        if self.deaf || self.silent {
            return;
        }
        let count = self.registers.entry(IFCNT).or_default();
        *count = (*count + 1) % 256;
        // Ones clear the flags of GSTAT.
        let value = if register == GSTAT { self.registers[&GSTAT] & !value } else { value };
        self.registers.insert(register, value);
    }

    fn answer(&mut self, register: u8) -> Vec<u8> {
        if self.silent {
            return Vec::new();
        }
        let value = self.registers.get(&register).copied().unwrap_or_default();
        let mut bytes = Vec::from([0x05, 0xFF, register]);
        bytes.extend(value.to_be_bytes());
        let check = crc(&bytes) ^ u8::from(self.corrupt > 0);
        self.corrupt = self.corrupt.saturating_sub(1);
        bytes.push(check);
        bytes
    }
}

/// Model of the serial line with four drivers.
pub struct FakeDriverLine {
    pub chips: [Chip; 4],
    /// True if the board receives the bytes that it sends.
    pub echoes: bool,
    /// True if the transmit buffer has no room for the board's bytes.
    pub full: bool,
    /// Bytes on their way to the board.
    pub incoming: VecDeque<u8>,
    /// Byte that the board receives without end, once `incoming` is empty. `None` for no such byte.
    pub babbles: Option<u8>,
}

#[derive(Clone)]
pub struct FakeWire(pub Rc<RefCell<FakeDriverLine>>);

impl FakeWire {
    pub fn new() -> Self {
        let chips = [Chip::new(), Chip::new(), Chip::new(), Chip::new()];
        let line = FakeDriverLine { chips, echoes: true, full: false, incoming: VecDeque::new(), babbles: None };
        Self(Rc::new(RefCell::new(line)))
    }

    /// Calls `change` with the driver at an address.
    pub fn chip(&self, address: usize, change: impl FnOnce(&mut Chip)) {
        change(&mut self.0.borrow_mut().chips[address]);
    }

    /// Returns the value of a register of the driver at an address.
    pub fn register(&self, address: usize, register: u8) -> u32 {
        self.0.borrow().chips[address].registers.get(&register).copied().unwrap_or_default()
    }
}

impl SingleWireUart for FakeWire {
    fn send(&mut self, bytes: &[u8]) -> bool {
        let mut line = self.0.borrow_mut();
        if line.full {
            return false;
        }
        if line.echoes {
            line.incoming.extend(bytes);
        }
        let (check, covered) = bytes.split_last().unwrap();
        assert_eq!(*check, crc(covered), "{bytes:?}");
        let answer = match *covered {
            [0x05, node, register] => line.chips[usize::from(node)].answer(register),
            [0x05, node, register, ref value @ ..] => {
                let value = u32::from_be_bytes(value.try_into().unwrap());
                line.chips[usize::from(node)].write(register & 0x7F, value);
                Vec::new()
            }
            _ => panic!("{bytes:?} is no datagram"),
        };
        line.incoming.extend(answer);
        true
    }

    fn receive(&mut self) -> Option<u8> {
        let mut line = self.0.borrow_mut();
        line.incoming.pop_front().or(line.babbles)
    }
}
