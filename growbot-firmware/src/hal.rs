//! The traits of a board, beyond those of embedded-hal.
//!
//! Levels are logical. A board whose wiring inverts a pin wraps it in [`crate::invertible_pin::InvertiblePin`]. A robot
//! may lack some sensors: the firmware never reads pins that the robot's description does not name.

use core::ops::DerefMut;

use embedded_hal::digital::{InputPin, OutputPin};
use embedded_hal::pwm::SetDutyCycle;
use embedded_storage::nor_flash::MultiwriteNorFlash;
use growbot_core::link::message::DriverReport;
use growbot_core::robot::BoardKind;

use crate::description_store::DescriptionStore;
use crate::journal::Journal;
use crate::layer_store::LayerStore;

/// Number of copies of the retained state in the [`RetainedMemory`].
pub const COPIES: usize = 2;
/// Length of a copy, bytes: its content, its generation number and its checksum.
pub const COPY_BYTES: usize = 128;
/// Length of the retained memory, bytes.
pub const RETAINED_BYTES: usize = COPIES * COPY_BYTES;

/// A channel of a 12-bit ADC.
pub trait Adc {
    /// Returns a reading (0 to 4095) taken since the last call. `None` if none was taken. Never blocks.
    fn sample(&mut self) -> Option<u16>;
}

/// The tip's orientation sensor.
pub trait GravitySensor {
    /// Returns the direction of gravity in the tip's frame, thousandths of the earth's. The vector points upwards, like
    /// that of a resting accelerometer. `None` if the sensor does not respond. The measurement takes a millisecond at
    /// most.
    fn gravity(&mut self) -> Option<[i16; 3]>;
}

/// Watchdog that resets the board unless it is fed.
pub trait Watchdog {
    /// Restarts the watchdog's timeout. The controller calls this only after the liveness check has passed, or during a
    /// long operation with the heater off.
    fn feed(&mut self);
}

/// The debug port of the processor.
pub trait DebugPort {
    /// Returns whether a debug probe has enabled debugging. The processor may then be halted at any time. Debugging
    /// stays enabled until the next power cycle, even after the probe is unplugged.
    fn is_on(&self) -> bool;
}

/// Debug port of a board whose processor a debug probe cannot halt.
pub struct NoDebugPort;

impl DebugPort for NoDebugPort {
    fn is_on(&self) -> bool {
        false
    }
}

/// The stepper drivers, as far as they are controlled over a serial line.
pub trait StepperDrivers {
    /// Does everything that is due at time `now`, us since the board started. Never waits. The motors are `in_use`
    /// while they are energised or may soon be.
    fn poll(&mut self, now: u64, in_use: bool);
    /// Returns whether all drivers are configured. Until then no motor may be energised.
    fn are_configured(&self) -> bool;
    /// Returns a driver's problem. `None` if all drivers are healthy.
    fn problem(&self) -> Option<DriverReport>;
}

/// Drivers without a serial line. Their current and microsteps are set in hardware.
pub struct UnmanagedDrivers;

impl StepperDrivers for UnmanagedDrivers {
    fn poll(&mut self, _now: u64, _in_use: bool) {}

    fn are_configured(&self) -> bool {
        true
    }

    fn problem(&self) -> Option<DriverReport> {
        None
    }
}

/// Stepper drivers that are optional: `None` if the robot does not use the board's serial line for drivers.
impl<D: StepperDrivers> StepperDrivers for Option<D> {
    fn poll(&mut self, now: u64, in_use: bool) {
        if let Some(drivers) = self {
            drivers.poll(now, in_use);
        }
    }

    fn are_configured(&self) -> bool {
        self.as_ref().is_none_or(StepperDrivers::are_configured)
    }

    fn problem(&self) -> Option<DriverReport> {
        self.as_ref()?.problem()
    }
}

/// All outputs of the tip, for an interrupt that switches them off and must not wait until the main loop releases them.
pub trait Outputs {
    /// Switches heater, fan and both stepper drivers off at once, from any context. This function cannot fail and never
    /// waits.
    fn make_safe(&mut self);
}

/// Memory that survives a reset but not a loss of power.
pub trait RetainedMemory {
    /// Reads the whole content: [`COPIES`] copies, one after the other.
    fn read(&mut self) -> [u8; RETAINED_BYTES];
    /// Writes one of the copies, from its first byte to its last, and changes no other copy. All later memory accesses
    /// take effect after the last byte is in the memory.
    fn write(&mut self, copy: usize, bytes: &[u8; COPY_BYTES]);
}

/// The parts of a board that the controller drives. The [`crate::stepping::Engine`] owns the steppers, the index
/// sensor, the filament encoder and the emergency stop.
pub trait Board {
    /// Values of `board.kind` in a robot file that this board accepts. Empty for a board that accepts any robot.
    const KINDS: &'static [BoardKind] = &[];
    /// Power stage of the heater.
    type HeaterPower: SetDutyCycle;
    /// Second switch, in series with the heater's power stage. The heater can heat only while this output is high.
    type HeaterEnable: OutputPin;
    /// Fan that cools the print.
    type FanPwm: SetDutyCycle;
    /// ADC channel of the thermistor's voltage divider.
    type ThermistorAdc: Adc;
    /// ADC channel of the supply's voltage divider.
    type SupplyAdc: Adc;
    /// Input that is high while filament is present.
    type FilamentPresence: InputPin;
    /// Input that is high while a stepper driver reports a fault.
    type DriverFault: InputPin;
    /// Stepper drivers, as far as they are controlled over a serial line.
    type Drivers: StepperDrivers;
    /// Orientation sensor of the tip.
    type Orientation: GravitySensor;
    /// Watchdog that resets the board unless it is fed.
    type Watchdog: Watchdog;
    /// Debug port of the processor.
    type DebugPort: DebugPort;
    /// Memory that survives a reset.
    type Retained: RetainedMemory;
    /// Flash of the journal, and flash of the robot's description. Each has two sectors or more. A programmed word can
    /// be programmed again to the same value, and to zero.
    type Flash: MultiwriteNorFlash;
    /// Pointer to the store of the job's layers, which has some 48 KiB: a reference or a box.
    type Store: DerefMut<Target = LayerStore>;
}

/// The parts of a board that the controller drives, as values.
pub struct BoardResources<B: Board> {
    /// Power stage of the heater.
    pub heater_power: B::HeaterPower,
    /// Second switch, in series with the heater's power stage.
    pub heater_enable: B::HeaterEnable,
    /// Fan that cools the print.
    pub fan: B::FanPwm,
    /// ADC channel of the nozzle's thermistor.
    pub thermistor: B::ThermistorAdc,
    /// ADC channel of the supply voltage.
    pub supply: B::SupplyAdc,
    /// Input that is high while filament is present.
    pub filament_presence: B::FilamentPresence,
    /// Input that is high while a stepper driver reports a fault.
    pub driver_fault: B::DriverFault,
    /// Stepper drivers, as far as they are controlled over a serial line.
    pub drivers: B::Drivers,
    /// Orientation sensor of the tip.
    pub orientation: B::Orientation,
    /// Watchdog that resets the board unless it is fed.
    pub watchdog: B::Watchdog,
    /// Debug port of the processor.
    pub debug_port: B::DebugPort,
    /// Memory that survives a reset.
    pub retained: B::Retained,
    /// Journal of the job.
    pub journal: Journal<B::Flash>,
    /// Store of the robot's description in flash.
    pub descriptions: DescriptionStore<B::Flash>,
    /// Store of the job's layers.
    pub store: B::Store,
}
