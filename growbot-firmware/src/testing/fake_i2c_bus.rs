//! Simulated I2C bus with a BMI160, level by level. The chip has its I2C interface and the registers that the firmware
//! uses.

use std::cell::RefCell;
use std::rc::Rc;

use embedded_hal::delay::DelayNs;
use embedded_hal::digital::{ErrorType, InputPin, OutputPin};

use super::PinFailed;

/// Address of the simulated chip on the bus, with its SDO pin low.
pub const ADDRESS: u8 = 0x68;

/// Address of the register CHIP_ID (BMI160 data sheet, 2.11). The next constants are the addresses of other registers,
/// and a command.
const CHIP_ID: u8 = 0x00;
const PMU_STATUS: u8 = 0x03;
const ACC_RANGE: u8 = 0x41;
const CMD: u8 = 0x7E;
const ACC_NORMAL: u8 = 0x11;

/// Defect of the simulated chip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BusFault {
    /// No defect.
    #[default]
    None,
    /// The chip is absent, or has no power.
    Absent,
    /// The chip acknowledges its address and nothing more.
    RefusesData,
    /// The chip holds the clock low.
    HoldsClock,
    /// The chip holds the data line low.
    HoldsData,
}

/// Simulated chip with 256 registers. All clones share their content.
#[derive(Clone)]
pub struct FakeChip(Rc<RefCell<Chip>>);

struct Chip {
    registers: [u8; 256],
    trouble: BusFault,
}

impl Default for FakeChip {
    fn default() -> Self {
        let chip = Self(Rc::new(RefCell::new(Chip { registers: [0; 256], trouble: BusFault::None })));
        chip.power_up();
        chip
    }
}

impl FakeChip {
    /// Sets the registers to their values after a short loss of the chip's power.
    pub fn power_up(&self) {
        let mut chip = self.0.borrow_mut();
        chip.registers = [0; 256];
        chip.registers[usize::from(CHIP_ID)] = 0xD1;
        chip.registers[usize::from(ACC_RANGE)] = 0x03;
    }

    /// Gives the chip this defect from now on.
    pub fn trouble(&self, trouble: BusFault) {
        self.0.borrow_mut().trouble = trouble;
    }

    /// Sets the content of registers, from `register` on.
    pub fn set(&self, register: u8, bytes: &[u8]) {
        let from = usize::from(register);
        self.0.borrow_mut().registers[from..from + bytes.len()].copy_from_slice(bytes);
    }

    /// Returns the content of a register.
    pub fn get(&self, register: u8) -> u8 {
        self.0.borrow().registers[usize::from(register)]
    }

    fn write(&self, register: u8, byte: u8) {
        let mut chip = self.0.borrow_mut();
        chip.registers[usize::from(register)] = byte;
        if (register, byte) == (CMD, ACC_NORMAL) {
            chip.registers[usize::from(PMU_STATUS)] = 0x10;
        }
    }

    fn has(&self, trouble: BusFault) -> bool {
        self.0.borrow().trouble == trouble
    }
}

/// State of the simulated chip on the bus.
#[derive(Clone, Copy)]
enum Phase {
    /// The chip waits for a start condition.
    Idle,
    /// The chip receives the bits of the address, of the register's number, or of data.
    Takes { what: ByteKind, byte: u8, bits: u8 },
    /// The chip holds the data line low to acknowledge a byte. Then it sends if `reads`, and otherwise receives `next`.
    Acknowledges { reads: bool, next: ByteKind },
    /// The chip sends a byte, of which `bits` bits have been sent.
    Sends { byte: u8, bits: u8 },
    /// The chip checks whether the board acknowledges the byte and so reads another one.
    Listens { goes_on: bool },
}

#[derive(Clone, Copy, PartialEq)]
enum ByteKind {
    Address,
    Register,
    Data,
}

struct Bus {
    chip: FakeChip,
    phase: Phase,
    register: u8,
    /// True if the chip holds the data line low.
    chip_data_low: bool,
    /// Time until which the chip holds the clock low, ns.
    clock_held_until: u64,
    /// Time for which the chip will hold the clock low after its next falling edge, ns.
    stretch: u64,
    /// Level of the board's clock output; `true` releases the line. `board_data` is that of the data line.
    board_clock: bool,
    board_data: bool,
    /// Level of the clock line before the latest change. `data` is that of the data line.
    clock: bool,
    data: bool,
    now: u64,
    /// Number of clock pulses after which the board's pins fail. `None` if they do not fail.
    clocks_left: Option<u32>,
    broken: bool,
}

impl Bus {
    fn clock_level(&self) -> bool {
        self.board_clock && self.now >= self.clock_held_until && !self.chip.has(BusFault::HoldsClock)
    }

    fn data_level(&self) -> bool {
        self.board_data && !self.chip_data_low && !self.chip.has(BusFault::HoldsData)
    }

    /// Updates the chip after a possible change of a line's level.
    fn look(&mut self) {
        let (clock, data) = (self.clock_level(), self.data_level());
        let (clock_before, data_before) = (self.clock, self.data);
        (self.clock, self.data) = (clock, data);
        if clock && clock_before && data != data_before {
            self.chip_data_low = false;
            let starts = !data && !self.chip.has(BusFault::Absent);
            self.phase = if starts { Phase::Takes { what: ByteKind::Address, byte: 0, bits: 0 } } else { Phase::Idle };
        } else if clock && !clock_before {
            self.rise(data);
        } else if !clock && clock_before {
            self.clock_held_until = self.now + std::mem::take(&mut self.stretch);
            self.fall();
        }
        (self.clock, self.data) = (self.clock_level(), self.data_level());
    }

    fn rise(&mut self, data: bool) {
        match &mut self.phase {
            Phase::Takes { byte, bits, .. } => {
                *byte = *byte << 1 | u8::from(data);
                *bits += 1;
            }
            Phase::Listens { goes_on } => *goes_on = !data,
            _ => {}
        }
        if let Some(left) = &mut self.clocks_left {
            *left = left.saturating_sub(1);
            self.broken |= *left == 0;
        }
    }

    fn fall(&mut self) {
        self.chip_data_low = false;
        self.phase = match self.phase {
            Phase::Takes { what, byte, bits: 8 } => self.accept_byte(what, byte),
            Phase::Acknowledges { reads: true, .. } | Phase::Listens { goes_on: true } => self.send(),
            Phase::Acknowledges { reads: false, next } => Phase::Takes { what: next, byte: 0, bits: 0 },
            Phase::Sends { bits: 8, .. } => Phase::Listens { goes_on: false },
            Phase::Sends { byte, bits } => {
                self.chip_data_low = byte << bits & 0x80 == 0;
                Phase::Sends { byte, bits: bits + 1 }
            }
            Phase::Listens { goes_on: false } => Phase::Idle,
            other => other,
        };
    }

    fn accept_byte(&mut self, what: ByteKind, byte: u8) -> Phase {
        let (acknowledged, reads, next) = match what {
            ByteKind::Address => (byte >> 1 == ADDRESS, byte & 1 == 1, ByteKind::Register),
            ByteKind::Register => (true, false, ByteKind::Data),
            ByteKind::Data => (true, false, ByteKind::Data),
        };
        if !acknowledged || what != ByteKind::Address && self.chip.has(BusFault::RefusesData) {
            return Phase::Idle;
        }
        match what {
            ByteKind::Address => {}
            ByteKind::Register => self.register = byte,
            ByteKind::Data => {
                self.chip.write(self.register, byte);
                self.register = self.register.wrapping_add(1);
            }
        }
        self.chip_data_low = true;
        Phase::Acknowledges { reads, next }
    }

    fn send(&mut self) -> Phase {
        let byte = self.chip.get(self.register);
        self.register = self.register.wrapping_add(1);
        self.chip_data_low = byte & 0x80 == 0;
        Phase::Sends { byte, bits: 1 }
    }
}

/// The simulated bus, for tests. All clones share it.
#[derive(Clone)]
pub struct FakeWires(Rc<RefCell<Bus>>);

impl FakeWires {
    /// Creates a bus with one chip. Both lines are released.
    pub fn new(chip: FakeChip) -> Self {
        Self(Rc::new(RefCell::new(Bus {
            chip,
            phase: Phase::Idle,
            register: 0,
            chip_data_low: false,
            clock_held_until: 0,
            stretch: 0,
            board_clock: true,
            board_data: true,
            clock: true,
            data: true,
            now: 0,
            clocks_left: None,
            broken: false,
        })))
    }

    /// Returns the board's pin of the clock line.
    pub fn clock(&self) -> Wire<true> {
        Wire(self.clone())
    }

    /// Returns the board's pin of the data line.
    pub fn data(&self) -> Wire<false> {
        Wire(self.clone())
    }

    /// Returns the timer that advances time on the bus.
    pub fn timer(&self) -> WireTimer {
        WireTimer(self.clone())
    }

    /// Returns the time that has passed on the bus, us.
    pub fn elapsed_us(&self) -> u64 {
        self.0.borrow().now / 1000
    }

    /// Returns whether both lines are high.
    pub fn is_free(&self) -> bool {
        let bus = self.0.borrow();
        bus.clock_level() && bus.data_level()
    }

    /// Makes the chip hold the clock low for this time after its next falling edge. 0 cancels that.
    pub fn stretch_next(&self, us: u64) {
        let mut bus = self.0.borrow_mut();
        bus.stretch = us * 1000;
        bus.clock_held_until = 0;
    }

    /// Disconnects the board from the bus after a number of clock pulses.
    pub fn disconnect_after(&self, clocks: u32) {
        self.0.borrow_mut().clocks_left = Some(clocks);
    }

    /// Reconnects the board to the bus. While it was disconnected, its pins have released the lines.
    pub fn reconnect(&self) {
        let mut bus = self.0.borrow_mut();
        (bus.clocks_left, bus.broken) = (None, false);
        (bus.board_clock, bus.board_data) = (true, true);
        bus.look();
    }

    /// Makes every access to the board's pins fail from now on.
    pub fn break_pins(&self) {
        self.0.borrow_mut().broken = true;
    }
}

/// A pin of the board at the clock line (`CLOCK`) or at the data line.
pub struct Wire<const CLOCK: bool>(FakeWires);

impl<const CLOCK: bool> Wire<CLOCK> {
    fn set(&self, high: bool) -> Result<(), PinFailed> {
        let mut bus = self.0.0.borrow_mut();
        if bus.broken {
            return Err(PinFailed);
        }
        *(if CLOCK { &mut bus.board_clock } else { &mut bus.board_data }) = high;
        bus.look();
        Ok(())
    }
}

impl<const CLOCK: bool> ErrorType for Wire<CLOCK> {
    type Error = PinFailed;
}

impl<const CLOCK: bool> OutputPin for Wire<CLOCK> {
    fn set_low(&mut self) -> Result<(), PinFailed> {
        self.set(false)
    }

    fn set_high(&mut self) -> Result<(), PinFailed> {
        self.set(true)
    }
}

impl<const CLOCK: bool> InputPin for Wire<CLOCK> {
    fn is_high(&mut self) -> Result<bool, PinFailed> {
        let bus = self.0.0.borrow();
        if bus.broken {
            return Err(PinFailed);
        }
        Ok(if CLOCK { bus.clock_level() } else { bus.data_level() })
    }

    fn is_low(&mut self) -> Result<bool, PinFailed> {
        self.is_high().map(|high| !high)
    }
}

/// Timer that advances time on the bus.
pub struct WireTimer(FakeWires);

impl DelayNs for WireTimer {
    fn delay_ns(&mut self, ns: u32) {
        let mut bus = self.0.0.borrow_mut();
        bus.now += u64::from(ns);
        bus.look();
    }
}
