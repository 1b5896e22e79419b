//! The robot of a board: the one that a host has configured, otherwise the one that this firmware was built for.
//!
//! `build.rs` reads and checks `robots/<GROWBOT_ROBOT>.toml` and writes the robot as source. The default of
//! GROWBOT_ROBOT is `growbot-a`, and it may also be the path to a file. With `none` no robot is built in: the board
//! only communicates until it is configured.

use embedded_storage::nor_flash::MultiwriteNorFlash;
#[allow(unused_imports, reason = "not every robot has every sensor")]
use growbot_core::robot::{
    Board, BoardKind, Driver, DriverMode, Fan, Feed, FeedStrategy, Filament, FilamentMotion, Geometry, Head, Heater,
    Input, LayerDescription, Material, Motion, Pause, PinNumbers, Robot, RobotDescription, Sensors, Supply, Thermistor,
    Tip, Turning, Wall,
};
use heapless::String;

use crate::descriptions::{Descriptions, Stored};

/// The robot of a board.
pub struct Machine {
    /// The robot. On a board that is not configured it is any robot, for outputs that are off.
    pub robot: Robot,
    /// The board has a robot.
    pub configured: bool,
}

impl Machine {
    /// Returns the robot in the board's flash, otherwise the one that the firmware was built for.
    pub fn find<F: MultiwriteNorFlash>(descriptions: &mut Descriptions<F>) -> Self {
        Self::or_built_in(descriptions.newest())
    }

    /// Returns the robot of a description, or without one the robot that the firmware was built for. A board with a
    /// description that it cannot decode is not configured, because the built-in robot may be wired differently.
    #[must_use]
    pub fn or_built_in(stored: Stored) -> Self {
        match stored {
            Stored::Robot(robot) => Self { robot, configured: true },
            Stored::Unreadable => Self { configured: false, ..built_in() },
            Stored::Nothing => built_in(),
        }
    }
}

/// Returns the robot that the firmware was built for.
#[must_use]
pub fn built_for() -> Robot {
    built_in().robot
}

fn built_in() -> Machine {
    include!(concat!(env!("OUT_DIR"), "/machine.rs"))
}
