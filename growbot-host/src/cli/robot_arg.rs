//! `--robot` of commands.

use std::path::PathBuf;

use clap::Args;
use growbot_client::maintenance::MaterialPresets;
use growbot_core::robot::Robot;
use growbot_plan::robot_file;
use growbot_serve::settings::{InvalidFiles, Key, Setting};

use super::failure::Failure;
use super::settings;

/// Name of an argument for a robot in the help. [`super::completions`] recognises such arguments by this name.
pub const ROBOT: &str = "FILE|NAME";

/// `--robot` of commands that need a robot.
#[derive(Args, Default)]
pub struct RobotArg {
    /// The robot: a built-in name (growbot-a, -a1 to -a8, -b, -c) or a TOML file [default: GROWBOT_ROBOT, then
    /// growbot.toml, then growbot-a]
    #[arg(long, value_name = ROBOT)]
    pub robot: Option<PathBuf>,
}

impl RobotArg {
    /// Reads and checks the robot's description.
    pub fn load(&self) -> Result<Robot, Failure> {
        Ok(robot_file::load(&self.name()?)?)
    }

    /// Like [`RobotArg::load`], but invalid settings files only cause warnings, because they must not prevent a stop.
    pub fn load_for_stop(&self) -> Result<Robot, Failure> {
        settings::skip_invalid(|invalid| Ok(robot_file::load(&self.name_from_files(invalid)?)?))
    }

    /// Returns the name or the file of the robot.
    pub fn name(&self) -> Result<PathBuf, Failure> {
        self.name_from_files(InvalidFiles::Refuse)
    }

    pub fn name_from_files(&self, invalid: InvalidFiles) -> Result<PathBuf, Failure> {
        match &self.robot {
            Some(robot) => Ok(robot.clone()),
            None => Ok(settings::log_setting(Key::Robot, Setting::load_from_files(Key::Robot, invalid)?).into()),
        }
    }

    /// Reads the presets of materials.
    pub fn presets(&self) -> Result<MaterialPresets, Failure> {
        Ok(MaterialPresets::load(&self.name()?)?)
    }
}
