//! The checks of the settings of the stepper drivers that the firmware configures.

use super::checked_field::CheckedField;
use super::{ChopperMode, DriverError, DriverSettings, RobotDescription, RobotError};

/// Names of the fields of one stepper driver in a robot file.
struct DriverFields {
    table: &'static str,
    current_a: &'static str,
    microsteps: &'static str,
    stall_threshold: &'static str,
    sense_ohm: &'static str,
}

const HEAD_DRIVER: DriverFields = DriverFields {
    table: "head.driver",
    current_a: "head.driver.current_a",
    microsteps: "head.driver.microsteps",
    stall_threshold: "head.driver.stall_threshold",
    sense_ohm: "head.driver.sense_ohm",
};
const FEED_DRIVER: DriverFields = DriverFields {
    table: "feed.driver",
    current_a: "feed.driver.current_a",
    microsteps: "feed.driver.microsteps",
    stall_threshold: "feed.driver.stall_threshold",
    sense_ohm: "feed.driver.sense_ohm",
};

/// Checks the settings of both stepper drivers. They are required if the board has configurable drivers, and not
/// allowed otherwise.
pub(super) fn check(robot: &RobotDescription) -> Result<(), RobotError> {
    let has_drivers = robot.board.is_some_and(|board| board.kind.has_onboard_drivers());
    for (driver, fields) in [(&robot.head.driver, HEAD_DRIVER), (&robot.feed.driver, FEED_DRIVER)] {
        match driver {
            Some(driver) if has_drivers => check_driver(driver, &fields)?,
            Some(_) => return Err(RobotError::Drivers(DriverError::NotSupported { field: fields.table })),
            None if has_drivers => return Err(RobotError::Drivers(DriverError::Missing { field: fields.table })),
            None => {}
        }
    }
    Ok(())
}

fn check_driver(driver: &DriverSettings, fields: &DriverFields) -> Result<(), RobotError> {
    CheckedField(fields.sense_ohm, driver.sense_ohm).between(
        0.05,
        1.0,
        "give the resistance of the driver's sense resistors in ohm, as printed on the board (R110 means 0.11)",
    )?;
    CheckedField(fields.current_a, driver.current_a).between(
        0.05,
        driver.max_current_a(),
        "give the motor's current in A rms, within what the driver's sense resistors allow; most motors need less",
    )?;
    if !driver.microsteps.is_power_of_two() || driver.microsteps > 256 {
        let (field, value) = (fields.microsteps, driver.microsteps);
        return Err(RobotError::Drivers(DriverError::Microsteps { field, value }));
    }
    if driver.stall_threshold.is_some() && driver.mode != ChopperMode::StealthChop {
        return Err(RobotError::Drivers(DriverError::StallMode { field: fields.stall_threshold }));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{BoardDescription, BoardKind, PinOverrides, Robot};
    use crate::testing::description_a;

    fn with(kind: BoardKind, driver: Option<DriverSettings>) -> Result<Robot, RobotError> {
        let mut robot = description_a();
        (robot.sensors.supply, robot.sensors.driver_fault) = (false, None);
        robot.board = Some(BoardDescription { kind, pins: PinOverrides::default() });
        (robot.head.driver, robot.feed.driver) = (driver, driver);
        Robot::new(robot)
    }

    #[test]
    fn unsupported_driver_settings_are_refused_with_the_reason() {
        let driver = DriverSettings::with_current(0.8);
        with(BoardKind::SkrPico, Some(driver)).unwrap();
        let stalls = DriverSettings { mode: ChopperMode::SpreadCycle, stall_threshold: Some(80), ..driver };
        for (kind, driver, why) in [
            (BoardKind::Pico, Some(driver), "only skr-pico"),
            (BoardKind::SkrPico, None, "[head.driver] is missing"),
            (BoardKind::SkrPico, Some(DriverSettings::with_current(2.5)), "head.driver.current_a is 2.5, above 1.7"),
            (BoardKind::SkrPico, Some(DriverSettings::with_current(f64::NAN)), "finite"),
            (BoardKind::SkrPico, Some(DriverSettings { microsteps: 12, ..driver }), "12"),
            (BoardKind::SkrPico, Some(DriverSettings { microsteps: 512, ..driver }), "512"),
            (BoardKind::SkrPico, Some(stalls), "only in StealthChop"),
        ] {
            let message = std::format!("{}", with(kind, driver).unwrap_err());
            assert!(message.contains(why), "{message}");
        }
    }
}
