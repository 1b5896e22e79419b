//! The tip's orientation by a BMI160: the direction of gravity in the tip's frame.
//!
//! Each call of [`GravitySensor::gravity`] either finds and starts the chip, or reads it. Both take well below a
//! millisecond. If the chip is absent, or another chip responds, each call tries again and takes the time of one
//! address byte. If the chip has lost its power for a moment, the next call finds it asleep, and the call after that
//! starts it again.

use bmi160::interface::I2cInterface;
use bmi160::{AccelerometerPowerMode, AccelerometerRange, Bmi160, SensorSelector, SlaveAddr};
use embedded_hal::i2c::I2c;

use crate::hal::GravitySensor;

/// Content of the register CHIP_ID of a BMI160 (data sheet, register 0x00).
const CHIP_ID: u8 = 0xD1;
/// Reading of an axis that measures the earth's gravity (1 g), in counts, at a measuring range of 2 g (data sheet,
/// table 1).
const COUNTS_PER_G: i32 = 16_384;

/// A BMI160 whose SDO pin is low, with address 0x68. Its axes are the tip's: x, and z along the direction of growth.
pub struct Bmi160Sensor<I> {
    chip: Bmi160<I2cInterface<I>>,
    /// True if the chip has been started. It gives readings from the next call on, because it needs 3.8 ms to start
    /// (data sheet, table 1).
    started: bool,
}

impl<I: I2c> Bmi160Sensor<I> {
    /// Creates the sensor on this I2C bus. The chip may be absent.
    pub fn new(bus: I) -> Self {
        Self { chip: Bmi160::new_with_i2c(bus, SlaveAddr::Alternative(false)), started: false }
    }

    /// Finds the chip and starts it. Returns `None` if no BMI160 responds.
    fn start(&mut self) -> Option<()> {
        if self.chip.chip_id().ok()? != CHIP_ID {
            return None;
        }
        self.chip.set_accel_range(AccelerometerRange::G2).ok()?;
        self.chip.set_accel_power_mode(AccelerometerPowerMode::Normal).ok()
    }

    fn read(&mut self) -> Option<[i16; 3]> {
        // A sleeping chip would return its last reading.
        if self.chip.power_mode().ok()?.accel != AccelerometerPowerMode::Normal {
            return None;
        }
        let counts = self.chip.data(SensorSelector::new().accel()).ok()?.accel?;
        Some([counts.x, counts.y, counts.z].map(milli_g))
    }
}

impl<I: I2c> GravitySensor for Bmi160Sensor<I> {
    fn gravity(&mut self) -> Option<[i16; 3]> {
        if self.started {
            let read = self.read();
            self.started = read.is_some();
            read
        } else {
            self.started = self.start().is_some();
            None
        }
    }
}

/// Converts a reading in counts to thousandths of the earth's gravity, rounded to the nearest. The result is between
/// -2,000 and 2,000.
fn milli_g(counts: i16) -> i16 {
    ((i32::from(counts) * 1000 + COUNTS_PER_G / 2).div_euclid(COUNTS_PER_G)) as i16
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::soft_i2c::SoftI2c;
    use crate::testing::fake_i2c_bus::{BusFault, FakeChip, FakeWires};

    /// Address of the first of the six registers of the acceleration.
    const ACC: u8 = 0x12;

    struct Bench {
        chip: FakeChip,
        wires: FakeWires,
        looks: std::boxed::Box<dyn FnMut() -> Option<[i16; 3]>>,
    }

    impl Bench {
        fn new() -> Self {
            let chip = FakeChip::default();
            let wires = FakeWires::new(chip.clone());
            let mut orientation = Bmi160Sensor::new(SoftI2c::new(wires.clock(), wires.data(), wires.timer()));
            Self { chip, wires, looks: std::boxed::Box::new(move || orientation.gravity()) }
        }

        /// Reads gravity once. The call must take less than a millisecond on a board whose waits are up to twice as
        /// long, so the limit is 500 us.
        #[track_caller]
        fn look(&mut self) -> Option<[i16; 3]> {
            let before = self.wires.elapsed_us();
            let gravity = (self.looks)();
            let took = self.wires.elapsed_us() - before;
            assert!(took < 500, "{took} us");
            gravity
        }
    }

    /// Content of the acceleration registers for an upright tip that leans a little.
    const LEANS: [u8; 6] = [0x00, 0x04, 0x00, 0xFE, 0x00, 0x40];

    #[test]
    fn gravity_is_read_in_thousandths_of_g() {
        let mut bench = Bench::new();
        assert_eq!(bench.look(), None, "it starts first");
        bench.chip.set(ACC, &LEANS);
        assert_eq!(bench.look(), Some([63, -31, 1000]));
        bench.chip.set(ACC, &[0xFF, 0x7F, 0x00, 0x80, 0x00, 0x00]);
        assert_eq!(bench.look(), Some([2000, -2000, 0]));
    }

    #[test]
    fn an_absent_chip_is_detected_once_connected() {
        let mut bench = Bench::new();
        bench.chip.trouble(BusFault::Absent);
        for _ in 0..10 {
            assert_eq!(bench.look(), None);
        }
        bench.chip.trouble(BusFault::None);
        assert_eq!(bench.look(), None);
        bench.chip.set(ACC, &LEANS);
        assert_eq!(bench.look(), Some([63, -31, 1000]));
    }

    #[test]
    fn a_chip_with_another_id_is_not_read() {
        let mut bench = Bench::new();
        bench.chip.set(0x00, &[0x68]);
        bench.chip.set(ACC, &LEANS);
        for _ in 0..10 {
            assert_eq!(bench.look(), None);
        }
        assert_eq!(bench.chip.get(0x7E), 0, "nothing is written to it");
    }

    #[test]
    fn a_chip_that_lost_power_is_reinitialised() {
        let mut bench = Bench::new();
        bench.look();
        assert!(bench.look().is_some());
        bench.chip.power_up();
        bench.chip.set(ACC, &LEANS);
        assert_eq!(bench.look(), None, "it sleeps");
        assert_eq!(bench.look(), None, "it starts");
        assert_eq!(bench.look(), Some([63, -31, 1000]));
    }

    #[test]
    fn readings_resume_after_any_bus_fault() {
        let mut bench = Bench::new();
        for trouble in [BusFault::RefusesData, BusFault::HoldsClock, BusFault::HoldsData, BusFault::Absent] {
            for looks_before in [0, 2] {
                for _ in 0..looks_before {
                    bench.look();
                }
                bench.chip.trouble(trouble);
                for _ in 0..5 {
                    assert_eq!(bench.look(), None, "{trouble:?}");
                }
                bench.chip.trouble(BusFault::None);
                bench.look();
                assert!(bench.look().is_some(), "{trouble:?} has passed");
            }
        }
    }
}
