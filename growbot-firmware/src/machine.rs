//! The description of the robot that this firmware was built for.
//!
//! `build.rs` reads and checks `robots/<GROWBOT_ROBOT>.toml` (`growbot-a` unless the variable says otherwise; a path to a file works too).

use growbot_core::robot::{Robot, RobotError};

/// The robot that the firmware was built for.
///
/// # Errors
/// None that `build.rs` did not meet first.
pub fn built_for() -> Result<Robot, RobotError> {
    Robot::decode(include_bytes!(concat!(env!("OUT_DIR"), "/machine.bin")))
}
