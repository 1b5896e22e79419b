//! Soft I2C: an I2C bus on two open-drain pins that the processor drives bit by bit. The duration of a transaction is
//! bounded, even if a chip misbehaves.
//!
//! The firmware avoids hardware I2C controllers on purpose. Some of them wait for flags that a disturbed bus never
//! sets, and their recovery cannot be tested on a desktop. The soft bus can run on a desktop, pin by pin, against a
//! simulated chip that misbehaves. A byte takes some 30 us.
//!
//! No other controller may clock the bus.

use embedded_hal::delay::DelayNs;
use embedded_hal::digital::{InputPin, OutputPin};
use embedded_hal::i2c::{Error, ErrorKind, ErrorType, I2c, NoAcknowledgeSource, Operation};

/// Half a clock period, ns, which gives 333 kHz at most. In fast mode the clock must be low for at least 1.3 us and
/// high for at least 0.6 us.
const HALF_NS: u32 = 1500;
/// Time for which all chips together may hold the clock low in one transaction, us.
const MAX_CLOCK_STRETCH_US: u16 = 100;
/// Number of clock pulses after which a chip that was interrupted while it sent a byte releases the data line: the rest
/// of the byte, and its acknowledgement (UM10204, 3.1.16).
const CLOCKS_TO_FREE: u8 = 9;

/// The reason why an I2C transaction failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SoftI2cError {
    /// No chip acknowledged the address, or the chip did not acknowledge a byte.
    NotAcknowledged(NoAcknowledgeSource),
    /// A chip holds the clock low.
    ClockStretchTimeout,
    /// A chip holds the data line low, and did not release it when it was clocked.
    BusStuck,
    /// A pin cannot be set or read.
    Pin,
}

impl Error for SoftI2cError {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::NotAcknowledged(source) => ErrorKind::NoAcknowledge(*source),
            Self::ClockStretchTimeout | Self::BusStuck => ErrorKind::Bus,
            Self::Pin => ErrorKind::Other,
        }
    }
}

/// An I2C bus. Both pins are open-drain outputs with pull-up resistors, so that "high" releases the line.
pub struct SoftI2c<C, D, T> {
    clock: C,
    data: D,
    timer: T,
    /// Time for which chips may still hold the clock low in the current transaction, us.
    patience_us: u16,
}

impl<C: InputPin + OutputPin, D: InputPin + OutputPin, T: DelayNs> SoftI2c<C, D, T> {
    /// Creates a bus on two pins that are both released.
    pub fn new(clock: C, data: D, timer: T) -> Self {
        Self { clock, data, timer, patience_us: MAX_CLOCK_STRETCH_US }
    }

    #[inline(never)] // Transactions call it and `clock_high` often: one copy of each saves 0.4 kB of flash.
    fn half(&mut self) {
        self.timer.delay_ns(HALF_NS);
    }

    fn set_data(&mut self, high: bool) -> Result<(), SoftI2cError> {
        self.data.set_state(high.into()).map_err(|_| SoftI2cError::Pin)
    }

    fn data(&mut self) -> Result<bool, SoftI2cError> {
        self.data.is_high().map_err(|_| SoftI2cError::Pin)
    }

    fn clock_low(&mut self) -> Result<(), SoftI2cError> {
        self.clock.set_low().map_err(|_| SoftI2cError::Pin)
    }

    /// Releases the clock, and waits for chips that hold it low.
    #[inline(never)]
    fn clock_high(&mut self) -> Result<(), SoftI2cError> {
        self.clock.set_high().map_err(|_| SoftI2cError::Pin)?;
        while self.clock.is_low().map_err(|_| SoftI2cError::Pin)? {
            self.patience_us = self.patience_us.checked_sub(1).ok_or(SoftI2cError::ClockStretchTimeout)?;
            self.timer.delay_us(1);
        }
        Ok(())
    }

    /// Makes one clock pulse, with the data line released if `high` and low otherwise. Returns the level of the data
    /// line while the clock was high.
    fn bit(&mut self, high: bool) -> Result<bool, SoftI2cError> {
        self.set_data(high)?;
        self.half();
        self.clock_high()?;
        self.half();
        let level = self.data();
        self.clock_low()?;
        level
    }

    /// Frees the bus, so that both lines are high.
    fn recover_bus(&mut self) -> Result<(), SoftI2cError> {
        self.set_data(true)?;
        self.clock_high()?;
        for _ in 0..CLOCKS_TO_FREE {
            if self.data()? {
                return Ok(());
            }
            self.clock_low()?;
            self.half();
            self.clock_high()?;
            self.half();
        }
        if self.data()? { Ok(()) } else { Err(SoftI2cError::BusStuck) }
    }

    /// Makes a start condition, or a repeated start condition: the data line falls while the clock is high. The clock
    /// is low afterwards.
    fn start(&mut self) -> Result<(), SoftI2cError> {
        self.set_data(true)?;
        self.half();
        self.clock_high()?;
        self.half();
        self.set_data(false)?;
        self.half();
        self.clock_low()
    }

    /// Makes a stop condition: the data line rises while the clock is high.
    fn stop(&mut self) -> Result<(), SoftI2cError> {
        self.clock_low()?;
        self.set_data(false)?;
        self.half();
        // The data line is released even if a chip holds the clock low.
        let clock = self.clock_high();
        self.half();
        self.set_data(true)?;
        self.half();
        clock
    }

    fn send(&mut self, byte: u8, source: NoAcknowledgeSource) -> Result<(), SoftI2cError> {
        for bit in (0..8).rev() {
            self.bit(byte & (1 << bit) != 0)?;
        }
        if self.bit(true)? { Err(SoftI2cError::NotAcknowledged(source)) } else { Ok(()) }
    }

    fn receive(&mut self, is_last: bool) -> Result<u8, SoftI2cError> {
        let mut byte = 0;
        for _ in 0..8 {
            byte = byte << 1 | u8::from(self.bit(true)?);
        }
        self.bit(is_last)?;
        Ok(byte)
    }

    /// Performs the operations of a transaction, except for the stop condition. Consecutive operations of one direction
    /// are merged, as [`I2c::transaction`] requires.
    fn operate(&mut self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), SoftI2cError> {
        let mut direction = None;
        let mut operations = operations.iter_mut().peekable();
        while let Some(operation) = operations.next() {
            let reads = matches!(operation, Operation::Read(_));
            if direction != Some(reads) {
                self.start()?;
                self.send(address << 1 | u8::from(reads), NoAcknowledgeSource::Address)?;
                direction = Some(reads);
            }
            match operation {
                Operation::Write(bytes) => {
                    for byte in bytes.iter() {
                        self.send(*byte, NoAcknowledgeSource::Data)?;
                    }
                }
                Operation::Read(bytes) => {
                    let continues = matches!(operations.peek(), Some(Operation::Read(_)));
                    let mut bytes = bytes.iter_mut().peekable();
                    while let Some(byte) = bytes.next() {
                        *byte = self.receive(bytes.peek().is_none() && !continues)?;
                    }
                }
            }
        }
        Ok(())
    }
}

impl<C, D, T> ErrorType for SoftI2c<C, D, T> {
    type Error = SoftI2cError;
}

impl<C: InputPin + OutputPin, D: InputPin + OutputPin, T: DelayNs> I2c for SoftI2c<C, D, T> {
    fn transaction(&mut self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), SoftI2cError> {
        if operations.is_empty() {
            return Ok(());
        }
        self.patience_us = MAX_CLOCK_STRETCH_US;
        self.recover_bus()?;
        let done = self.operate(address, operations);
        let stopped = self.stop();
        done.and(stopped)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::fake_i2c_bus::{ADDRESS, BusFault, FakeChip, FakeWires};

    fn bus(chip: &FakeChip) -> (FakeWires, impl I2c<Error = SoftI2cError> + use<>) {
        let wires = FakeWires::new(chip.clone());
        let bus = SoftI2c::new(wires.clock(), wires.data(), wires.timer());
        (wires, bus)
    }

    #[test]
    fn registers_are_written_and_read() {
        let chip = FakeChip::default();
        let (wires, mut bus) = bus(&chip);
        chip.set(0x20, &[0xA5, 0x00, 0xFF, 0x81]);
        let mut bytes = [0; 4];
        bus.write_read(ADDRESS, &[0x20], &mut bytes).unwrap();
        assert_eq!(bytes, [0xA5, 0x00, 0xFF, 0x81]);
        bus.write(ADDRESS, &[0x30, 0x5A]).unwrap();
        assert_eq!(chip.get(0x30), 0x5A);
        let mut two = ([0; 1], [0; 2]);
        bus.transaction(
            ADDRESS,
            &mut [
                Operation::Write(&[0x21]),
                Operation::Write(&[]),
                Operation::Read(&mut two.0),
                Operation::Read(&mut two.1),
            ],
        )
        .unwrap();
        assert_eq!(two, ([0x00], [0xFF, 0x81]));
        assert!(wires.is_free());
    }

    #[test]
    fn a_device_that_does_not_acknowledge_is_an_error() {
        let chip = FakeChip::default();
        let (wires, mut bus) = bus(&chip);
        let nobody = SoftI2cError::NotAcknowledged(NoAcknowledgeSource::Address);
        assert_eq!(bus.write(ADDRESS ^ 2, &[0]), Err(nobody));
        assert_eq!(nobody.kind(), ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address));
        chip.trouble(BusFault::RefusesData);
        assert_eq!(bus.write(ADDRESS, &[0x30, 1]), Err(SoftI2cError::NotAcknowledged(NoAcknowledgeSource::Data)));
        chip.trouble(BusFault::Absent);
        assert_eq!(bus.read(ADDRESS, &mut [0]), Err(nobody));
        assert!(wires.is_free());
        chip.trouble(BusFault::None);
        bus.write(ADDRESS, &[0x30, 7]).unwrap();
        assert_eq!(chip.get(0x30), 7);
    }

    #[test]
    fn a_line_held_low_takes_less_than_a_millisecond() {
        let chip = FakeChip::default();
        for (trouble, error) in
            [(BusFault::HoldsClock, SoftI2cError::ClockStretchTimeout), (BusFault::HoldsData, SoftI2cError::BusStuck)]
        {
            let (wires, mut bus) = bus(&chip);
            chip.trouble(trouble);
            let before = wires.elapsed_us();
            assert_eq!(bus.write_read(ADDRESS, &[0x20], &mut [0; 6]), Err(error));
            assert!(wires.elapsed_us() - before < 200, "{} us", wires.elapsed_us() - before);
            chip.trouble(BusFault::None);
            bus.write_read(ADDRESS, &[0x20], &mut [0; 6]).unwrap();
        }
    }

    #[test]
    fn short_clock_stretching_is_tolerated() {
        let chip = FakeChip::default();
        let (wires, mut bus) = bus(&chip);
        chip.set(0x20, &[0x3C]);
        wires.stretch_next(80);
        let mut bytes = [0; 1];
        bus.write_read(ADDRESS, &[0x20], &mut bytes).unwrap();
        assert_eq!(bytes, [0x3C]);
        wires.stretch_next(130);
        assert_eq!(bus.write_read(ADDRESS, &[0x20], &mut bytes), Err(SoftI2cError::ClockStretchTimeout));
        wires.stretch_next(0);
        bus.write_read(ADDRESS, &[0x20], &mut bytes).unwrap();
    }

    #[test]
    fn a_chip_stuck_in_the_middle_of_a_byte_is_clocked_free() {
        let chip = FakeChip::default();
        chip.set(0x20, &[0x00, 0x00]);
        for clocks in 1..40 {
            let (wires, mut bus) = bus(&chip);
            // The board is reset during a read, and the chip keeps its state.
            wires.disconnect_after(clocks);
            let _ = bus.write_read(ADDRESS, &[0x20], &mut [0xFF; 2]);
            let mut again = SoftI2c::new(wires.clock(), wires.data(), wires.timer());
            wires.reconnect();
            let mut bytes = [0xFF; 2];
            let answer = again.write_read(ADDRESS, &[0x20], &mut bytes);
            assert_eq!((answer, bytes), (Ok(()), [0x00, 0x00]), "disconnected after {clocks} clocks");
        }
    }

    #[test]
    fn reading_six_bytes_takes_less_than_a_third_of_a_millisecond() {
        let chip = FakeChip::default();
        let (wires, mut bus) = bus(&chip);
        bus.write_read(ADDRESS, &[0x12], &mut [0; 6]).unwrap();
        assert!(wires.elapsed_us() < 300, "{} us", wires.elapsed_us());
    }

    #[test]
    fn pin_errors_are_returned() {
        let chip = FakeChip::default();
        let (wires, mut bus) = bus(&chip);
        wires.break_pins();
        assert_eq!(bus.write(ADDRESS, &[0]), Err(SoftI2cError::Pin));
    }
}
