//! The robot of a board: what a host has configured, else the one that this firmware was built for.
//!
//! `build.rs` reads and checks `robots/<GROWBOT_ROBOT>.toml` (`growbot-a` unless the variable says otherwise; a path to
//! a file works too) and writes the robot down as source. With `none` nothing is built in: the board only communicates
//! until it is configured.

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
    /// The robot; where there is none, any, for outputs that are off.
    pub robot: Robot,
    /// Whether there is one.
    pub configured: bool,
}

impl Machine {
    /// The robot of the board's flash, else the one that the firmware was built for.
    pub fn find<F: MultiwriteNorFlash>(descriptions: &mut Descriptions<F>) -> Self {
        Self::or_built_in(descriptions.newest())
    }

    /// The robot of a description; without one, that which the firmware was built for. A board with a description that
    /// it cannot read is not configured: the built-in robot may be wired otherwise.
    #[must_use]
    pub fn or_built_in(stored: Stored) -> Self {
        match stored {
            Stored::Robot(robot) => Self { robot, configured: true },
            Stored::Unreadable => Self { configured: false, ..built_in() },
            Stored::Nothing => built_in(),
        }
    }
}

/// The robot that the firmware was built for.
#[must_use]
pub fn built_for() -> Robot {
    built_in().robot
}

fn built_in() -> Machine {
    include!(concat!(env!("OUT_DIR"), "/machine.rs"))
}
