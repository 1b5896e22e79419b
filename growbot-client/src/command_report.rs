//! Reports of commands to a robot, as JSON.

use growbot_core::link::message::{Gains, Tuned};
use growbot_plan::robot_kind::RobotKind;
use serde::{Deserialize, Serialize};

/// Report of a command to a robot, such as a stop or a pause.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct CommandReport {
    /// Port of the robot.
    pub port: String,
    /// True for a simulated robot.
    pub simulated: bool,
    /// Result of the command, as text.
    pub message: String,
}

impl CommandReport {
    /// Returns the report of a command that has succeeded.
    pub fn new(port: &str, robot: RobotKind, message: &str) -> Self {
        Self { port: port.to_owned(), simulated: robot.is_simulated(), message: message.trim_end().to_owned() }
    }
}

/// Report of the tuning of a heater.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct TuningReport {
    /// Proportional gain, 1/C.
    pub kp: f64,
    /// Integral gain, 1/(C s).
    pub ki: f64,
    /// Derivative gain, s/C.
    pub kd: f64,
    /// Period of the oscillation, s.
    pub period_s: f64,
    /// Amplitude of the oscillation, C.
    pub amplitude_c: f64,
    /// True for a simulated robot.
    pub simulated: bool,
}

impl TuningReport {
    /// Returns the report of the gains that the board of a robot has found.
    pub fn new(&Tuned { gains: Gains { kp, ki, kd }, period_s, amplitude_c }: &Tuned, robot: RobotKind) -> Self {
        Self { kp, ki, kd, period_s, amplitude_c, simulated: robot.is_simulated() }
    }

    /// Returns the gains as the section of a robot file, with a caution for those of a simulated robot.
    pub fn robot_file_section(&self) -> String {
        let Self { kp, ki, kd, .. } = self;
        let caution = if self.simulated {
            "# These gains are for a simulated robot. Tune a real robot itself, and do not use these gains for it.\n"
        } else {
            ""
        };
        format!("{caution}[heater]\nkp = {kp:.5}\nki = {ki:.6}\nkd = {kd:.4}\n")
    }
}

/// Report of the configuration of a board.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ConfigurationReport {
    /// Name of the robot in the board's new description.
    pub robot: String,
    /// Hash of that description, 16 hexadecimal digits.
    pub robot_hash: String,
    /// Name of the robot in the description before. Null if the board was not configured.
    pub robot_before: Option<String>,
    /// Hash of the description before. Null if the board was not configured.
    pub robot_hash_before: Option<String>,
    /// True for a simulated robot.
    pub simulated: bool,
}
