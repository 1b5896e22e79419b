//! The robot of a board: the one that a host has configured, otherwise the one that this firmware was built for.
//!
//! `build/board.rs` reads and checks `robots/<GROWBOT_ROBOT>.toml` and writes the robot as source. The default of
//! GROWBOT_ROBOT is `growbot-a`, and it may also be the path to a file. With `none` no robot is built in: the board
//! only communicates until it is configured.

use embedded_storage::nor_flash::MultiwriteNorFlash;
#[allow(unused_imports, reason = "not every robot has every sensor")]
use growbot_core::robot::{
    BoardDescription, BoardKind, ChopperMode, DigitalInput, DriverSettings, Fan, Feed, FeedStrategy, Filament,
    FilamentMotion, Geometry, Head, HeadRotation, Heater, LayerDescription, Material, Motion, Pause, PinOverrides,
    Robot, RobotDescription, Sensors, Supply, Thermistor, Tip, Wall,
};
use heapless::String;

use crate::description_store::{DescriptionStore, StoredDescription};

/// The robot that a board drives, and whether the board is configured.
pub struct BoardRobot {
    /// The robot that the board drives. On a board that is not configured this is an arbitrary robot, whose outputs
    /// stay off.
    pub robot: Robot,
    /// True if the board has a robot description.
    pub configured: bool,
}

impl BoardRobot {
    /// Returns the robot whose description is in the board's flash, otherwise the robot that the firmware was built
    /// for.
    pub fn load<F: MultiwriteNorFlash>(descriptions: &mut DescriptionStore<F>) -> Self {
        Self::from_stored(descriptions.newest())
    }

    /// Returns the robot of the stored description. If no description is stored, returns the robot that the firmware
    /// was built for. A board with a description that it cannot decode is not configured, because the built-in robot
    /// may be wired differently.
    pub fn from_stored(stored: StoredDescription) -> Self {
        match stored {
            StoredDescription::Robot(robot) => Self { robot, configured: true },
            StoredDescription::Undecodable => Self { configured: false, ..built_in() },
            StoredDescription::Empty => built_in(),
        }
    }
}

/// Returns the robot that the firmware was built for.
pub fn built_in_robot() -> Robot {
    built_in().robot
}

fn built_in() -> BoardRobot {
    include!(concat!(env!("OUT_DIR"), "/board_robot.rs"))
}
