//! Robots for this crate's tests: the files in `robots/`, so that there is one description of each.

use crate::robot::{Robot, RobotDescription};

/// The description of the paper's robot A.
pub fn description_a() -> RobotDescription {
    toml::from_str(include_str!("../../robots/growbot-a.toml")).expect("robots/growbot-a.toml is readable")
}

/// The paper's robot A.
pub fn robot_a() -> Robot {
    Robot::new(description_a()).expect("robots/growbot-a.toml is valid")
}
