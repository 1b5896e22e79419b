//! Robots for this crate's tests, from the files in `robots/`, so that each robot has only one description.

use crate::robot::{Robot, RobotDescription};

/// Returns the description of the paper's robot A.
pub fn description_a() -> RobotDescription {
    toml::from_str(include_str!("../../robots/growbot-a.toml")).expect("robots/growbot-a.toml is readable")
}

/// Returns the paper's robot A.
pub fn robot_a() -> Robot {
    Robot::new(description_a()).expect("robots/growbot-a.toml is valid")
}
