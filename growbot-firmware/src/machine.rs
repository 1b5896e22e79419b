//! The robot that this firmware was built for.
//!
//! `build.rs` reads and checks `robots/<GROWBOT_ROBOT>.toml` (`growbot-a` unless the variable says otherwise; a path to
//! a file works too) and writes the robot down as source.

#[allow(unused_imports, reason = "not every robot has every sensor")]
use growbot_core::robot::{
    Fan, Feed, FeedStrategy, Filament, FilamentMotion, Geometry, Head, Heater, Input, LayerDescription, Material,
    Motion, Pause, Robot, RobotDescription, Sensors, Supply, Thermistor, Tip, Turning, Wall,
};
use heapless::String;

/// The robot that the firmware was built for.
#[must_use]
pub fn built_for() -> Robot {
    include!(concat!(env!("OUT_DIR"), "/machine.rs"))
}
