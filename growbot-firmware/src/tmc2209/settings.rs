//! Settings of a TMC2209 stepper driver, and the registers that configure them (data sheet of the TMC2209, rev. 1.09,
//! 5).

use growbot_core::robot::{ChopperMode, DriverSettings, RobotDescription};
use tmc2209::data::MicroStepResolution;
use tmc2209::reg::{
    CHOPCONF, COOLCONF, GCONF, GSTAT, IHOLD_IRUN, PWMCONF, SGTHRS, SLAVECONF, State, TCOOLTHRS, TPOWERDOWN, TPWMTHRS,
    VACTUAL,
};

/// Address of the head's driver on the serial line of an SKR Pico: the driver at terminal X. [`FEED_ADDRESS`] is that
/// of the feed's driver, at terminal E.
const HEAD_ADDRESS: u8 = 0;
const FEED_ADDRESS: u8 = 3;
/// Number of registers that are written to configure a driver.
pub(super) const REGISTERS: usize = 12;
/// Blank time of the chopper's comparator: 24 clocks (table 5.5.1, TBL).
const BLANK_TIME: u32 = 1;
/// Delay of a driver's response: 3 times 8 bits after the request, which several drivers on one line need (table 5.1,
/// SENDDELAY).
const SEND_DELAY: u8 = 2;
/// All flags of the register GSTAT. Writing ones clears them (table 5.1).
const ALL_FLAGS: u32 = 0b111;
/// Max time between two 256ths of a step at which StallGuard's reading is used, clocks of 12 MHz. The value corresponds
/// to one turn a second of a motor of 200 full steps. Below about this speed StallGuard is not reliable (11.5).
pub(super) const STALL_MAX_STEP_TIME: u32 = 12_000_000 / (200 * 256);

/// The settings of one TMC2209 stepper driver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriverConfig {
    /// Address of the driver on the serial line, 0 to 3, set by its pins MS1 and MS2.
    pub address: u8,
    /// Resistance of the driver's sense resistors, ohm.
    pub sense_ohm: f64,
    /// Current of a motor's phase, A rms.
    pub current_a: f64,
    /// Number of microsteps (pulses at STEP) in a full step, a power of two up to 256.
    pub microsteps: u16,
    /// True if the driver runs in SpreadCycle, false for StealthChop.
    pub spread_cycle: bool,
    /// Load value (SGTHRS) at which the motor counts as stalled. `None` if stalls are not detected. The driver measures
    /// the load only in StealthChop.
    pub stall_threshold: Option<u8>,
}

impl DriverConfig {
    /// Returns the settings of the drivers of head and feed. `None` if the robot's board does not configure drivers.
    pub fn of(robot: &RobotDescription) -> Option<[Self; 2]> {
        let (head, feed) = (robot.head.driver?, robot.feed.driver?);
        Some([Self::of_driver(&head, HEAD_ADDRESS), Self::of_driver(&feed, FEED_ADDRESS)])
    }

    fn of_driver(driver: &DriverSettings, address: u8) -> Self {
        Self {
            address,
            sense_ohm: driver.sense_ohm,
            current_a: driver.current_a,
            microsteps: driver.microsteps,
            spread_cycle: driver.mode == ChopperMode::SpreadCycle,
            stall_threshold: driver.stall_threshold,
        }
    }

    /// Returns the stall threshold if the load is monitored. `None` without a threshold and in SpreadCycle, because
    /// StallGuard4 measures in StealthChop only.
    pub(super) fn watched_threshold(&self) -> Option<u8> {
        self.stall_threshold.filter(|_| !self.spread_cycle)
    }

    /// Returns the values of all registers that have to be written, in the order of writing. The driver's pin EN keeps
    /// the motor off while they are written.
    pub(super) fn registers(&self) -> [State; REGISTERS] {
        let (current, scale) = self.current();
        let threshold = self.watched_threshold();
        // StallGuard measures above this speed. Without a threshold it never measures.
        let stall_max = threshold.map_or(0, |_| STALL_MAX_STEP_TIME);
        [
            State::GCONF(self.general()),
            State::SLAVECONF(with(0, |register: &mut SLAVECONF| register.set_send_delay(SEND_DELAY))),
            State::CHOPCONF(self.chopper(scale)),
            State::IHOLD_IRUN(current),
            State::TPOWERDOWN(TPOWERDOWN::default()),
            State::PWMCONF(PWMCONF::default()),
            // The driver uses StealthChop at every speed, or never.
            State::TPWMTHRS(TPWMTHRS::from(0)),
            State::TCOOLTHRS(TCOOLTHRS::from(stall_max)),
            State::SGTHRS(SGTHRS::from(threshold.map_or(0, u32::from))),
            // The driver does not adapt the current to the load.
            State::COOLCONF(COOLCONF::from(0)),
            // The motor follows the pin STEP.
            State::VACTUAL(VACTUAL::from(0)),
            State::GSTAT(GSTAT::from(ALL_FLAGS)),
        ]
    }

    /// Returns the register GCONF: the serial line and registers configure the driver instead of pins, and the
    /// reference of the current is internal.
    fn general(&self) -> GCONF {
        with(0, |register: &mut GCONF| {
            register.set_pdn_disable(true);
            register.set_mstep_reg_select(true);
            register.set_multistep_filt(true);
            register.set_en_spread_cycle(self.spread_cycle);
        })
    }

    /// Returns the register CHOPCONF: the chopper's default values, with the configured microsteps, interpolated to
    /// 256.
    fn chopper(&self, high_sensitivity: bool) -> CHOPCONF {
        let mut register = CHOPCONF::default();
        let exponent = self.microsteps.trailing_zeros().min(8);
        register.set_mres(MicroStepResolution::from_driver(8 - exponent));
        register.set_intpol(true);
        register.set_tbl(BLANK_TIME);
        register.set_vsense(high_sensitivity);
        register
    }

    /// Returns the register IHOLD_IRUN, and whether the sense resistors' full scale is the lower one (data sheet, 9).
    /// The current is the same whether the motor turns or not, because a motor without current loses its position. The
    /// current is rounded down to a current that the driver can be set to.
    fn current(&self) -> (IHOLD_IRUN, bool) {
        let milliamps = (self.current_a * 1000.0) as f32;
        let (high_sensitivity, scale) = tmc2209::rms_current_to_vsense_cs(self.sense_ohm as f32, milliamps);
        let register = with(0, |register: &mut IHOLD_IRUN| {
            register.set_irun(scale);
            register.set_ihold(scale);
            register.set_ihold_delay(1);
        });
        (register, high_sensitivity)
    }
}

/// Returns a register with the value `bits`, after `set` has set some of its fields.
fn with<R: From<u32>>(bits: u32, set: impl FnOnce(&mut R)) -> R {
    let mut register = R::from(bits);
    set(&mut register);
    register
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::robot_a;
    use std::vec::Vec;

    const PLAIN: DriverConfig = DriverConfig {
        address: 0,
        sense_ohm: 0.11,
        current_a: 0.8,
        microsteps: 16,
        spread_cycle: false,
        stall_threshold: None,
    };

    fn value(settings: &DriverConfig, address: u8) -> u32 {
        let registers = settings.registers();
        let found: Vec<_> = registers.iter().filter(|state| u8::from(state.addr()) == address).collect();
        assert_eq!(found.len(), 1, "register {address:#x}");
        (*found[0]).into()
    }

    #[test]
    fn driver_config_comes_from_the_robot_file() {
        let mut robot = robot_a().description().clone();
        assert_eq!(DriverConfig::of(&robot), None);
        robot.head.driver = Some(DriverSettings { stall_threshold: Some(60), ..DriverSettings::with_current(0.8) });
        robot.feed.driver = Some(DriverSettings {
            mode: ChopperMode::SpreadCycle,
            microsteps: 32,
            ..DriverSettings::with_current(0.5)
        });
        let head = DriverConfig { stall_threshold: Some(60), ..PLAIN };
        let feed = DriverConfig { address: 3, current_a: 0.5, microsteps: 32, spread_cycle: true, ..PLAIN };
        assert_eq!(DriverConfig::of(&robot), Some([head, feed]));
    }

    #[test]
    fn registers_match_the_data_sheet() {
        // GCONF: pdn_disable, mstep_reg_select, multistep_filt.
        assert_eq!(value(&PLAIN, 0x00), 0x1C0);
        assert_eq!(value(&DriverConfig { spread_cycle: true, ..PLAIN }, 0x00), 0x1C4);
        // CHOPCONF: TOFF 3, HSTRT 5, TBL 1, vsense, MRES 4 for 16 microsteps, intpol.
        assert_eq!(value(&PLAIN, 0x6C), 0x1402_8053);
        // IHOLD_IRUN: 26 of 32 parts of 0.98 A, and 1 for IHOLDDELAY.
        assert_eq!(value(&PLAIN, 0x10), 0x0001_1919);
        for (microsteps, resolution) in [(1, 8), (2, 7), (32, 3), (256, 0)] {
            assert_eq!(value(&DriverConfig { microsteps, ..PLAIN }, 0x6C) >> 24 & 0xF, resolution);
        }
    }

    /// Checks the formula of section 9: I rms = (CS + 1) / 32 * V_FS / (R + 20 mOhm) / sqrt 2.
    #[test]
    fn the_current_is_the_greatest_not_above_the_requested_one() {
        for hundredths in 5..=170 {
            let settings = DriverConfig { current_a: f64::from(hundredths) / 100.0, ..PLAIN };
            let scale = value(&settings, 0x10) >> 8 & 0x1F;
            assert_eq!(value(&settings, 0x10) & 0x1F, scale, "at rest as in motion");
            let full_scale_v = if value(&settings, 0x6C) & 1 << 17 == 0 { 0.325 } else { 0.180 };
            let amps = |scale: u32| f64::from(scale + 1) / 32.0 * full_scale_v / 0.13 / f64::sqrt(2.0);
            assert!(amps(scale) <= settings.current_a * (1.0 + 1e-6), "{hundredths}: {scale}");
            assert!(amps(scale + 1) > settings.current_a * (1.0 - 1e-6), "{hundredths}: {scale}");
        }
    }

    #[test]
    fn stall_detection_is_enabled_in_stealth_chop_only() {
        let watched = DriverConfig { stall_threshold: Some(60), ..PLAIN };
        assert_eq!((value(&watched, 0x40), value(&watched, 0x14)), (60, 234));
        for settings in [PLAIN, DriverConfig { spread_cycle: true, ..watched }] {
            assert_eq!((value(&settings, 0x40), value(&settings, 0x14)), (0, 0));
        }
    }

    #[test]
    fn invalid_settings_give_registers_without_panic() {
        for current_a in [-1.0, 0.0, 1e9, f64::NAN, f64::INFINITY] {
            for (sense_ohm, microsteps) in [(0.0, 0), (-1.0, 3), (f64::NAN, u16::MAX)] {
                let _ = DriverConfig { current_a, sense_ohm, microsteps, ..PLAIN }.registers();
            }
        }
    }
}
