//! Settings for all commands, from the environment and from files named `growbot.toml`.
//!
//! An option overrides the environment. The environment overrides the nearest `growbot.toml`, which is searched from
//! the working directory upwards. That file overrides the one in the user's configuration. A file is read only when a
//! command needs it, so an invalid file does not stop other commands. A file that another user can have written is
//! refused ([`ownership`]). Only the user's file can name what is run or called for a notification, and cameras.

use std::collections::BTreeMap;
use std::env::{self, VarError};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use growbot_plan::input::{self, InputError};
use growbot_plan::ownership::{self, OwnershipError};
use growbot_plan::robot_file::{self, RobotFileError};
use growbot_plan::suggest::did_you_mean;
use growbot_plan::user_dirs::config_dir;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::config::{NotifyEntry, RobotEntry, ServeEntry};
use crate::settings_paths::{port_from, robot_from};

/// Name of the settings files.
pub const FILE_NAME: &str = "growbot.toml";

/// A setting for all commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Key {
    /// Robot of commands without `--robot` and without a plan.
    Robot,
    /// Port of commands without `--port`.
    Port,
}

/// Origin of a value.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum SettingOrigin {
    /// An environment variable.
    Environment(&'static str),
    /// The nearest `growbot.toml`.
    Nearest(PathBuf),
    /// The file in the user's configuration.
    User(PathBuf),
    /// The built-in default.
    #[default]
    BuiltIn,
}

/// A value with its origin.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Setting {
    /// The value.
    pub value: String,
    /// Origin of the value.
    pub origin: SettingOrigin,
}

/// The settings of all commands as JSON, by name.
pub type SettingsJson = BTreeMap<String, SettingJson>;

/// A value with its origin, as JSON.
#[derive(Debug, Serialize, JsonSchema)]
#[serde(tag = "origin", rename_all = "kebab-case")]
pub enum SettingJson {
    /// An environment variable.
    Environment {
        /// The value.
        value: String,
        /// Name of the variable.
        variable: String,
    },
    /// The nearest `growbot.toml`.
    Nearest {
        /// The value.
        value: String,
        /// Path of the file.
        file: String,
    },
    /// The file in the user's configuration.
    User {
        /// The value.
        value: String,
        /// Path of the file.
        file: String,
    },
    /// The built-in default.
    BuiltIn {
        /// The value.
        value: String,
    },
}

impl From<&Setting> for SettingJson {
    fn from(Setting { value, origin }: &Setting) -> Self {
        let (value, text) = (value.clone(), |file: &Path| file.display().to_string());
        match origin {
            SettingOrigin::Environment(variable) => Self::Environment { value, variable: (*variable).to_owned() },
            SettingOrigin::Nearest(file) => Self::Nearest { value, file: text(file) },
            SettingOrigin::User(file) => Self::User { value, file: text(file) },
            SettingOrigin::BuiltIn => Self::BuiltIn { value },
        }
    }
}

/// Prefix of growbot's environment variables.
const PREFIX: &str = "GROWBOT_";

/// Variables that growbot reads, or that it sets for the command of a notification.
const VARIABLES: [&str; 6] = [
    "GROWBOT_ROBOT",
    "GROWBOT_PORT",
    "GROWBOT_EMULATOR_TIME",
    "GROWBOT_NOTIFICATION_EVENT",
    "GROWBOT_NOTIFICATION_ROBOT",
    "GROWBOT_NOTIFICATION_MESSAGE",
];

/// Maximum length of a robot's name, letters.
const MAX_NAME: usize = 64;

/// Errors of the settings.
#[derive(Debug, thiserror::Error)]
pub enum SettingsError {
    /// An environment variable is not UTF-8.
    #[error("{variable} is not valid UTF-8 ({text:?}): set it again, or unset it")]
    NotText {
        /// Name of the variable.
        variable: &'static str,
        /// Value of the variable.
        text: OsString,
    },
    /// An environment variable has the prefix `GROWBOT_`, but growbot has no such variable.
    #[error(
        "unknown environment variable {name:?}{}: unset it, or rename it; growbot reads {}",
        did_you_mean(.name, VARIABLES),
        VARIABLES[..3].join(", ")
    )]
    UnknownVariable {
        /// Name of the variable.
        name: String,
    },
    /// A file cannot be read.
    #[error("{0}")]
    Input(#[from] InputError),
    /// Another user can have written a file.
    #[error("the settings file {file} is not used, because another user may have written it: {error}")]
    Ownership {
        /// Name of the file.
        file: String,
        /// Unsafe file or folder.
        error: OwnershipError,
    },
    /// A `growbot.toml` that is not the user's own names receivers of notifications, or cameras.
    #[error(
        "{file}: [serve.{section}] is allowed only in your own settings, because it names a command to run or an \
         address to call: move this section to {user_file}"
    )]
    ProjectSection {
        /// Name of the file.
        file: String,
        /// Name of the section in `[serve]`.
        section: &'static str,
        /// Name of the user's file.
        user_file: String,
    },
    /// A file is not TOML, or contains an unknown setting.
    #[error("{0}")]
    Toml(#[from] RobotFileError),
    /// A value is empty.
    #[error("{file}: {key} is empty: give a value, or remove the line")]
    Empty {
        /// Name of the file.
        file: String,
        /// Name of the setting.
        key: &'static str,
    },
    /// A robot's name is not allowed in addresses and file names.
    #[error(
        "{file}: [robots.{name:?}]: the name of a robot is 1 to {MAX_NAME} letters, digits, - and _, without accents: \
         rename it"
    )]
    RobotName {
        /// Name of the file.
        file: String,
        /// Name of the robot.
        name: String,
    },
}

/// Contents of a settings file.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SettingsToml {
    /// Robot of commands without `--robot` and without a plan: a built-in name or a file.
    robot: Option<String>,
    /// Port of commands without `--port`.
    port: Option<String>,
    /// Robots that `growbot serve` owns, by their names in the service.
    #[serde(default)]
    robots: BTreeMap<String, RobotEntry>,
    /// Settings of `growbot serve`.
    #[serde(default)]
    serve: ServeEntry,
}

impl Key {
    /// All settings.
    pub const ALL: [Self; 2] = [Self::Robot, Self::Port];

    /// Returns the name of the setting in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Robot => "robot",
            Self::Port => "port",
        }
    }

    /// Returns the environment variable that sets this setting.
    pub fn variable(self) -> &'static str {
        match self {
            Self::Robot => "GROWBOT_ROBOT",
            Self::Port => "GROWBOT_PORT",
        }
    }

    /// Returns the built-in default.
    pub fn built_in(self) -> &'static str {
        match self {
            Self::Robot => robot_file::DEFAULT,
            Self::Port => "sim",
        }
    }

    /// Returns the value of this setting in the contents of a file. A relative path is resolved from `directory`,
    /// which contains the file.
    fn value_from(self, written: &SettingsToml, directory: &Path) -> Option<String> {
        match self {
            Self::Robot => written.robot.as_ref().map(|robot| robot_from(robot, directory)),
            Self::Port => written.port.as_ref().map(|port| port_from(port, directory)),
        }
    }
}

/// Checks that no variable of the environment looks like one of growbot's without being one. An empty variable counts
/// as not set.
///
/// # Errors
/// [`SettingsError::UnknownVariable`] with the first such variable.
pub fn check_environment() -> Result<(), SettingsError> {
    let set = env::vars_os().filter(|(_, value)| !value.is_empty());
    let mut names: Vec<String> = set.map(|(name, _)| name.to_string_lossy().into_owned()).collect();
    names.sort();
    let unknown = names.into_iter().find(|name| name.starts_with(PREFIX) && !VARIABLES.contains(&name.as_str()));
    unknown.map_or(Ok(()), |name| Err(SettingsError::UnknownVariable { name }))
}

impl Setting {
    /// Returns the value of a setting, or the built-in default.
    ///
    /// # Errors
    /// [`SettingsError`] of a variable or file that had to be read.
    pub fn load(key: Key) -> Result<Self, SettingsError> {
        Self::load_from_files(key, InvalidFiles::Refuse)
    }

    /// Like [`Setting::load`], but invalid files are treated as `invalid` requires.
    ///
    /// # Errors
    /// [`SettingsError`] of a variable, or of a file that had to be read.
    pub fn load_from_files(key: Key, invalid: InvalidFiles) -> Result<Self, SettingsError> {
        match env::var(key.variable()) {
            Ok(value) if !value.is_empty() => {
                return Ok(Self { value, origin: SettingOrigin::Environment(key.variable()) });
            }
            Ok(_) | Err(VarError::NotPresent) => {}
            Err(VarError::NotUnicode(text)) => {
                return Err(SettingsError::NotText { variable: key.variable(), text });
            }
        }
        let found = find_in_files(invalid, |file, origin| {
            Ok(value_in(file, key)?.map(|value| Self { value, origin: origin.clone() }))
        })?;
        if let Some(found) = found {
            return Ok(found);
        }
        Ok(Self { value: key.built_in().to_owned(), origin: SettingOrigin::BuiltIn })
    }
}

/// Returns true if a robot may have this name, which becomes a part of addresses and file names.
fn is_name(name: &str) -> bool {
    let is_letter = |letter: u8| letter.is_ascii_alphanumeric() || matches!(letter, b'-' | b'_');
    (1..=MAX_NAME).contains(&name.len()) && name.bytes().all(is_letter)
}

/// Robots and settings of the service.
#[derive(Debug, Clone, Default)]
pub struct ServiceSettings {
    /// Robots by name.
    pub robots: BTreeMap<String, RobotEntry>,
    /// Settings of the service itself.
    pub serve: ServeEntry,
    /// File from which the robots and the settings come.
    pub origin: SettingOrigin,
}

/// Returns the robots and the service's settings in a text. Messages refer to the text as `file`.
///
/// # Errors
/// [`SettingsError::Toml`] or [`SettingsError::RobotName`].
pub fn parse_service(text: &str, file: &str) -> Result<(BTreeMap<String, RobotEntry>, ServeEntry), SettingsError> {
    let SettingsToml { robots, serve, .. } = robot_file::from_toml(text, file)?;
    match robots.keys().find(|name| !is_name(name)) {
        None => Ok((robots, serve)),
        Some(name) => Err(SettingsError::RobotName { file: file.to_owned(), name: name.clone() }),
    }
}

/// Returns the robots that the service owns, with the service's settings. They come from the nearest file if it has any
/// of them, otherwise from the file in the user's configuration. The receivers of notifications and the cameras always
/// come from the user's file.
///
/// # Errors
/// [`SettingsError`] of the files that had to be read.
pub fn load_service(mut invalid: InvalidFiles) -> Result<ServiceSettings, SettingsError> {
    let found = find_in_files(invalid.reborrow(), |file, origin| {
        let (robots, serve) = service_in(file)?;
        let is_users = matches!(origin, SettingOrigin::User(_));
        let calls = [("notify", serve.notify != NotifyEntry::default()), ("cameras", !serve.cameras.is_empty())];
        if let Some((section, _)) = calls.into_iter().find(|(_, is_set)| *is_set && !is_users) {
            let user_file =
                user_file().map_or_else(|| "your own settings".to_owned(), |file| input::display_name(&file));
            return Err(SettingsError::ProjectSection { file: input::display_name(file), section, user_file });
        }
        let is_set = !robots.is_empty() || serve != ServeEntry::default();
        Ok(is_set.then(|| ServiceSettings { robots, serve, origin: origin.clone() }))
    })?;
    let mut settings = found.unwrap_or_default();
    if let SettingOrigin::Nearest(_) = settings.origin {
        let users = find_in_files(invalid, |file, origin| match origin {
            SettingOrigin::User(_) => service_in(file).map(|(_, serve)| Some(serve)),
            _ => Ok(None),
        })?;
        ServeEntry { notify: settings.serve.notify, cameras: settings.serve.cameras, .. } = users.unwrap_or_default();
    }
    Ok(settings)
}

/// Returns the robots and the service's settings in a file, with their paths resolved.
fn service_in(file: &Path) -> Result<(BTreeMap<String, RobotEntry>, ServeEntry), SettingsError> {
    let (robots, serve) = parse_service(&read_safe(file)?, &input::display_name(file))?;
    let directory = file.parent().unwrap_or(Path::new(""));
    let robots = robots.into_iter().map(|(name, entry)| (name, entry.in_directory(directory)));
    Ok((robots.collect(), serve.in_directory(directory)))
}

/// Treatment of settings files that cannot be used.
pub enum InvalidFiles<'a> {
    /// The command fails.
    Refuse,
    /// The file is skipped, and its error is collected. This is for stop commands, which an invalid file must not
    /// prevent.
    Skip(&'a mut Vec<SettingsError>),
}

impl InvalidFiles<'_> {
    /// Returns the same treatment, for another search through the files.
    pub fn reborrow(&mut self) -> InvalidFiles<'_> {
        match self {
            Self::Refuse => InvalidFiles::Refuse,
            Self::Skip(errors) => InvalidFiles::Skip(errors),
        }
    }
}

/// Returns the result of `pick` for the nearest `growbot.toml`, or else for the user's file. `None` if it returns
/// `None` for both files.
fn find_in_files<T>(
    mut invalid: InvalidFiles,
    pick: impl Fn(&Path, &SettingOrigin) -> Result<Option<T>, SettingsError>,
) -> Result<Option<T>, SettingsError> {
    let user = user_file().filter(|file| file.is_file());
    let is_users =
        |file: &PathBuf| user.as_ref().is_some_and(|user| user.canonicalize().ok() == file.canonicalize().ok());
    let nearest = nearest().filter(|file| !is_users(file)).map(SettingOrigin::Nearest);
    for origin in nearest.into_iter().chain(user.clone().map(SettingOrigin::User)) {
        let (SettingOrigin::Nearest(file) | SettingOrigin::User(file)) = &origin else { continue };
        match (pick(file, &origin), &mut invalid) {
            (Ok(None), _) => {}
            (Ok(found), _) => return Ok(found),
            (Err(error), InvalidFiles::Refuse) => return Err(error),
            (Err(error), InvalidFiles::Skip(errors)) => errors.push(error),
        }
    }
    Ok(None)
}

/// Reads a settings file, if no other user can have written it.
fn read_safe(file: &Path) -> Result<String, SettingsError> {
    ownership::check_path(file).map_err(|error| SettingsError::Ownership { file: input::display_name(file), error })?;
    Ok(input::read_text(file)?)
}

/// Returns the value of a setting in a file. `None` if the file does not set it.
fn value_in(file: &Path, key: Key) -> Result<Option<String>, SettingsError> {
    let name = input::display_name(file);
    let written: SettingsToml = robot_file::from_toml(&read_safe(file)?, &name)?;
    for (key, value) in [(Key::Robot, &written.robot), (Key::Port, &written.port)] {
        if value.as_ref().is_some_and(String::is_empty) {
            return Err(SettingsError::Empty { file: name, key: key.name() });
        }
    }
    Ok(key.value_from(&written, file.parent().unwrap_or(Path::new(""))))
}

/// Returns the path of the nearest `growbot.toml`, from the working directory upwards.
pub fn nearest() -> Option<PathBuf> {
    let here = env::current_dir().ok()?;
    here.ancestors().map(|directory| directory.join(FILE_NAME)).find(|file| file.is_file())
}

/// Returns the path of the file in the user's configuration, even if it does not exist.
pub fn user_file() -> Option<PathBuf> {
    Some(config_dir()?.join(FILE_NAME))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robot_names_are_valid_in_urls() {
        let named = |name: &str| parse_service(&format!("[robots.{name:?}]\nport = \"sim:lab\"\n"), "growbot.toml");
        for name in ["lab", "Lab-2_b", &"a".repeat(MAX_NAME)] {
            assert!(named(name).is_ok(), "{name}");
        }
        for name in ["our lab", "a/b", "a?b", "", "l\u{e4}b", &"a".repeat(MAX_NAME + 1)] {
            let message = named(name).unwrap_err().to_string();
            assert!(message.contains("rename it") && message.contains(name), "{message}");
        }
    }

    #[test]
    fn paths_are_relative_to_the_file_and_robot_names_are_kept() {
        let value = |text: &str, key: Key| key.value_from(&toml::from_str(text).unwrap(), Path::new("/lab"));
        for (text, key, expected) in [
            ("robot = \"growbot-b\"", Key::Robot, "growbot-b"),
            ("robot = \"our.toml\"", Key::Robot, "/lab/our.toml"),
            ("robot = \"/else/our.toml\"", Key::Robot, "/else/our.toml"),
            ("port = \"emulator\"", Key::Port, "emulator"),
            ("port = \"emulator:image.elf\"", Key::Port, "emulator:/lab/image.elf"),
            ("port = \"rp2040:image.elf\"", Key::Port, "rp2040:/lab/image.elf"),
            ("port = \"/dev/ttyACM0\"", Key::Port, "/dev/ttyACM0"),
        ] {
            assert_eq!(value(text, key).as_deref(), Some(expected), "{text}");
        }
        assert_eq!(value("port = \"sim\"", Key::Robot), None);
    }
}
