//! Maintenance commands of users, presets of materials, and the conversion of commands to tasks of the board.

use std::collections::BTreeMap;
use std::path::Path;

use growbot_core::link::message::{MaintenanceTask, celsius};
use growbot_core::robot::Robot;
use growbot_plan::pose_text::{parse_angle, parse_length, parse_temperature};
pub use growbot_plan::robot_file::MaterialPreset;
use growbot_plan::robot_file::{self, RobotFileError};
use growbot_plan::suggest::did_you_mean;

/// Material presets of a robot file, by name of the material.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MaterialPresets {
    by_name: BTreeMap<String, MaterialPreset>,
}

/// Error in the arguments of a maintenance command.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MaintenanceError {
    /// The argument is neither a number nor a known material.
    #[error(
        "{name:?} is neither a number nor a material of the robot file{meant}: give a number, or add \
         [materials.{name}] to a robot file"
    )]
    UnknownMaterial {
        /// The argument.
        name: String,
        /// Suggestion of a material with a similar name. Empty if there is none.
        meant: String,
    },
    /// No task has this name.
    #[error("unknown maintenance task {name:?}: give one of {}", task_names())]
    UnknownTask {
        /// The name.
        name: String,
    },
    /// The command takes no arguments.
    #[error("`{command}` takes no arguments: remove {arguments:?}")]
    NoArguments {
        /// Name of the command.
        command: String,
        /// Given arguments.
        arguments: String,
    },
    /// The argument is not a number.
    #[error("{text:?} is not a number: give a number, for example `{command} 10`")]
    NotANumber {
        /// Name of the command.
        command: String,
        /// The argument.
        text: String,
    },
    /// The command moves filament in one direction only, and its length is negative.
    #[error("`{command}` cannot move {mm} mm: give a length of 0 or more, or use `jog`, which also moves backwards")]
    Backwards {
        /// Name of the command.
        command: String,
        /// Length, mm.
        mm: f64,
    },
}

/// Maintenance commands: name, arguments and description of each.
pub const COMMANDS: [(&str, &str, &str); 9] = [
    ("preheat", "[C|MATERIAL]", "heat the nozzle, by default to the temperature of growth"),
    ("cooldown", "", "end maintenance: heater and steppers off"),
    ("load", "[MM|MATERIAL]", "push filament in, by default 60 mm"),
    ("unload", "[MM|MATERIAL]", "pull filament out, by default 80 mm"),
    ("purge", "[MM|MATERIAL]", "push filament through the hot nozzle, by default 30 mm"),
    ("home", "", "turn the head to its index mark"),
    ("rotate", "DEGREES", "turn the head by an angle of -360 to 360 degrees"),
    ("jog", "MM", "move filament forwards, or backwards if MM is negative"),
    ("dry-run", "", "let head and feed move with the heater off, to check them"),
];

impl MaterialPresets {
    /// Reads the material presets of a robot file. A built-in robot has no presets.
    ///
    /// # Errors
    /// If the file cannot be read, or is not valid.
    pub fn load(name_or_file: &Path) -> Result<Self, RobotFileError> {
        let (text, file) = robot_file::text_of(name_or_file)?;
        Ok(Self { by_name: robot_file::checked_materials(&text, &file)? })
    }

    fn find(&self, name: &str) -> Result<MaterialPreset, MaintenanceError> {
        self.by_name.get(name).copied().ok_or_else(|| {
            let meant = did_you_mean(name, self.by_name.keys().map(String::as_str));
            MaintenanceError::UnknownMaterial { name: name.to_owned(), meant }
        })
    }

    /// Converts a command of [`COMMANDS`] to a task of the board. `word` is the name of the command, `rest` are its
    /// arguments.
    ///
    /// # Errors
    /// [`MaintenanceError`].
    pub fn task(&self, word: &str, rest: &str, robot: &Robot) -> Result<MaintenanceTask, MaintenanceError> {
        let rest = rest.trim();
        let command = || word.to_owned();
        let alone = |task| match rest {
            "" => Ok(task),
            _ => Err(MaintenanceError::NoArguments { command: command(), arguments: rest.to_owned() }),
        };
        let length = |text: &str| parse_length(text).ok().map(|length| length.value).filter(|mm| mm.is_finite());
        let angle = |text: &str| parse_angle(text).ok().map(|angle| angle.value).filter(|angle| angle.is_finite());
        let wrong = || MaintenanceError::NotANumber { command: command(), text: rest.to_owned() };
        let feed = |mm: f64| MaintenanceTask::Feed { um: (mm * 1000.0).round() as i32 };
        let of_preset = |of: fn(&MaterialPreset) -> f64| match (rest, length(rest)) {
            ("", _) => Ok(of(&MaterialPreset::default())),
            (_, Some(number)) if number >= 0.0 => Ok(number),
            (_, Some(mm)) => Err(MaintenanceError::Backwards { command: command(), mm }),
            (name, None) => self.find(name).map(|preset| of(&preset)),
        };
        match word {
            "preheat" => self.temperature(rest, robot),
            "cooldown" => alone(MaintenanceTask::CoolDown),
            "dry-run" => alone(MaintenanceTask::DryRun),
            "home" => alone(MaintenanceTask::Home),
            "load" => of_preset(|preset| preset.load_mm).map(feed),
            "unload" => of_preset(|preset| preset.unload_mm).map(|mm| feed(-mm)),
            "purge" => of_preset(|preset| preset.purge_mm).map(feed),
            "rotate" => angle(rest)
                .ok_or_else(wrong)
                .map(|degrees| MaintenanceTask::Rotate { centi_deg: (degrees * 100.0).round() as i32 }),
            "jog" => length(rest).ok_or_else(wrong).map(feed),
            _ => Err(MaintenanceError::UnknownTask { name: command() }),
        }
    }

    fn temperature(&self, text: &str, robot: &Robot) -> Result<MaintenanceTask, MaintenanceError> {
        let growth = robot.description().heater.target_c;
        let celsius = match (text, parse_temperature(text)) {
            ("", _) => growth,
            (_, Some(celsius)) => celsius,
            (name, None) => self.find(name)?.nozzle_c.unwrap_or(growth),
        };
        Ok(MaintenanceTask::Preheat { target_centi_c: (celsius * 100.0).round() as i32 })
    }
}

/// Returns the names of all maintenance commands.
fn task_names() -> String {
    COMMANDS.map(|(name, ..)| name).join(", ")
}

/// Returns the name of the request for a maintenance task, for error messages.
pub fn request_name(task: MaintenanceTask) -> &'static str {
    match task {
        MaintenanceTask::Preheat { .. } => "the request to preheat",
        MaintenanceTask::CoolDown => "the request to cool down",
        MaintenanceTask::Home | MaintenanceTask::Rotate { .. } => crate::client::TURN_HEAD,
        MaintenanceTask::Feed { .. } => crate::client::MOVE_FILAMENT,
        MaintenanceTask::DryRun => "the request to move without heat",
    }
}

/// Returns the message for a user whose maintenance task the board has accepted.
pub fn task_message(task: MaintenanceTask) -> String {
    match task {
        MaintenanceTask::Preheat { target_centi_c } => format!(
            "the nozzle heats to {} C; in maintenance the heater switches off by itself after 10 minutes without \
             commands",
            celsius(target_centi_c)
        ),
        MaintenanceTask::CoolDown => "heater and steppers are off".to_owned(),
        MaintenanceTask::DryRun => "the head and the feed can now be moved with the heater off".to_owned(),
        MaintenanceTask::Home => "the head turns to its index mark".to_owned(),
        MaintenanceTask::Rotate { centi_deg } => format!("the head turns by {} degrees", f64::from(centi_deg) / 100.0),
        MaintenanceTask::Feed { um } => {
            let way = if um < 0 { "pulls" } else { "pushes" };
            format!("the feed {way} {} mm of filament", f64::from(um.unsigned_abs()) / 1000.0)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn robot() -> Robot {
        robot_file::load("growbot-a".as_ref()).unwrap()
    }

    fn presets() -> MaterialPresets {
        let text = "[materials.pla]\nnozzle_c = 205.0\nload_mm = 90.0\n\n[materials.pcl]\nnozzle_c = 110.0\n";
        MaterialPresets { by_name: robot_file::materials(text, "mine.toml").unwrap() }
    }

    #[test]
    fn task_names_are_parsed() {
        let task = |line: &str| {
            let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
            presets().task(word, rest, &robot())
        };
        assert_eq!(task("preheat"), Ok(MaintenanceTask::Preheat { target_centi_c: 20_000 }));
        assert_eq!(task("preheat 210.5"), Ok(MaintenanceTask::Preheat { target_centi_c: 21_050 }));
        assert_eq!(task("preheat pla"), Ok(MaintenanceTask::Preheat { target_centi_c: 20_500 }));
        assert_eq!(task("load pla"), Ok(MaintenanceTask::Feed { um: 90_000 }));
        assert_eq!(task("unload"), Ok(MaintenanceTask::Feed { um: -80_000 }));
        assert_eq!(task("purge 12.5"), Ok(MaintenanceTask::Feed { um: 12_500 }));
        assert_eq!(task("jog -3"), Ok(MaintenanceTask::Feed { um: -3000 }));
        assert_eq!(task("rotate -90"), Ok(MaintenanceTask::Rotate { centi_deg: -9000 }));
        assert_eq!((task("home"), task("cooldown")), (Ok(MaintenanceTask::Home), Ok(MaintenanceTask::CoolDown)));
        for (line, part) in [
            ("preheat plaa", "did you mean pla?"),
            ("load -3", "give a length of 0 or more"),
            ("rotate", "is not a number"),
            ("jog far", "is not a number"),
            ("home 3", "takes no arguments"),
        ] {
            assert!(task(line).unwrap_err().to_string().contains(part), "{line}: {:?}", task(line));
        }
        assert_eq!(task("load -3"), Err(MaintenanceError::Backwards { command: "load".to_owned(), mm: -3.0 }));
        for line in ["rotate nan", "jog inf", "preheat nan", "load nan"] {
            assert!(task(line).is_err(), "{line}: {:?}", task(line));
        }
        assert!(
            task("dance")
                .unwrap_err()
                .to_string()
                .contains("preheat, cooldown, load, unload, purge, home, rotate, jog, dry-run")
        );
    }

    #[test]
    fn materials_do_not_change_the_robot_hash() {
        let (text, _) = robot_file::text_of("growbot-a".as_ref()).unwrap();
        let with = format!("{text}\n[materials.pla]\nnozzle_c = 205.0 # mine\n");
        assert_eq!(robot_file::parse(&with, "mine.toml").unwrap().hash(), robot().hash());
        assert_eq!(robot_file::materials(&with, "mine.toml").unwrap().len(), 1);
        let wrong = format!("{text}\n[materials.pla]\nnozle_c = 205.0\n");
        let message = robot_file::materials(&wrong, "mine.toml").unwrap_err().to_string();
        assert!(message.contains("nozle_c") && message.contains("did you mean nozzle_c?"), "{message}");
        assert!(robot_file::parse(&wrong, "mine.toml").is_err(), "no robot of a file that is wrong");
        for length in ["-60.0", "nan", "inf"] {
            let wrong = format!("{text}\n[materials.pla]\nload_mm = {length}\n");
            let message = robot_file::materials(&wrong, "mine.toml").unwrap_err().to_string();
            assert!(message.contains("is not a length of filament: give 0 mm or more"), "{message}");
        }
    }
}
