//! What a user has set for all commands: in the environment, and in files called `growbot.toml`.
//!
//! An option says more than the environment, that more than the nearest `growbot.toml`, which is searched from the
//! working directory upwards, and that more than the one of the user's configuration. Nothing is read that nobody asks
//! for: a file that is wrong stops no command that does not need it.

use std::collections::BTreeMap;
use std::env::{self, VarError};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use growbot_client::input::{self, InputError};
use growbot_client::robot_file::{self, RobotFileError};
use schemars::JsonSchema;
use serde::Deserialize;

use crate::serve::config::{RobotEntry, ServeEntry};

/// What the files are called.
pub const FILE: &str = "growbot.toml";

/// What can be set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Key {
    /// The robot of commands that are given no `--robot` and no plan.
    Robot,
    /// The port of commands that are given no `--port`.
    Port,
}

/// Where a value comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Origin {
    /// A variable of the environment.
    Environment(&'static str),
    /// The nearest `growbot.toml`.
    Nearest(PathBuf),
    /// That of the user's configuration.
    User(PathBuf),
    /// Nobody has set it.
    BuiltIn,
}

/// A value, and where it comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Setting {
    /// The value.
    pub value: String,
    /// Where it comes from.
    pub origin: Origin,
}

/// A robot's name has so many letters at most.
const MAX_NAME: usize = 64;

/// Why a value is not known.
#[derive(Debug, thiserror::Error)]
pub enum SettingsError {
    /// A variable is no text.
    #[error("{variable} is {text:?}, which is no UTF-8 text: set it anew, or unset it")]
    NotText {
        /// The variable.
        variable: &'static str,
        /// What it holds.
        text: OsString,
    },
    /// A file cannot be read.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A file is no TOML, or says what nobody can set.
    #[error(transparent)]
    Toml(#[from] RobotFileError),
    /// A value cannot be one.
    #[error("{file}: {key} is empty: give a value, or take the line out")]
    Empty {
        /// The file.
        file: String,
        /// The key.
        key: &'static str,
    },
    /// A robot's name cannot stand in addresses and file names.
    #[error(
        "{file}: [robots.{name:?}]: the name of a robot is 1 to {MAX_NAME} letters, digits, - and _, without accents: \
         rename it"
    )]
    RobotName {
        /// The file.
        file: String,
        /// The name.
        name: String,
    },
}

/// A file as written.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Written {
    /// The robot of commands that are given none: a built-in name or a file.
    robot: Option<String>,
    /// The port of commands that are given none.
    port: Option<String>,
    /// The robots that `growbot serve` owns, by the names that it gives them.
    #[serde(default)]
    robots: BTreeMap<String, RobotEntry>,
    /// How `growbot serve` works.
    #[serde(default)]
    serve: ServeEntry,
}

impl Key {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Robot, Self::Port];

    /// As files call it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Robot => "robot",
            Self::Port => "port",
        }
    }

    /// The variable that sets it.
    #[must_use]
    pub fn variable(self) -> &'static str {
        match self {
            Self::Robot => "GROWBOT_ROBOT",
            Self::Port => "GROWBOT_PORT",
        }
    }

    /// What it is where nobody has set it.
    #[must_use]
    pub fn built_in(self) -> &'static str {
        match self {
            Self::Robot => robot_file::DEFAULT,
            Self::Port => "sim",
        }
    }

    /// The value that a file in this directory gives it: paths are relative to the file.
    fn from(self, written: &Written, directory: &Path) -> Option<String> {
        match self {
            Self::Robot => written.robot.as_ref().map(|robot| robot_from(robot, directory)),
            Self::Port => written.port.as_ref().map(|port| port_from(port, directory)),
        }
    }
}

/// A robot as a file in this directory names it.
#[must_use]
pub fn robot_from(robot: &str, directory: &Path) -> String {
    if robot_file::is_built_in(robot) { robot.to_owned() } else { beside(directory, robot) }
}

/// A port as a file in this directory names it.
#[must_use]
pub fn port_from(port: &str, directory: &Path) -> String {
    match port.split_once(':') {
        Some((board @ ("emulator" | "rp2040"), image)) => format!("{board}:{}", beside(directory, image)),
        Some(("sim", name)) if name.contains('/') => format!("sim:{}", beside(directory, name)),
        _ => port.to_owned(),
    }
}

/// A path that is relative to this directory.
fn beside(directory: &Path, path: &str) -> String {
    directory.join(path).to_string_lossy().into_owned()
}

impl Setting {
    /// The value of a key, as it is set or else built in.
    ///
    /// # Errors
    /// [`SettingsError`] of the places that had to be looked at.
    pub fn of(key: Key) -> Result<Self, SettingsError> {
        match env::var(key.variable()) {
            Ok(value) if !value.is_empty() => return Ok(Self { value, origin: Origin::Environment(key.variable()) }),
            Ok(_) | Err(VarError::NotPresent) => {}
            Err(VarError::NotUnicode(text)) => {
                return Err(SettingsError::NotText { variable: key.variable(), text });
            }
        }
        let places = [
            nearest().map(|file| (file.clone(), Origin::Nearest(file))),
            user_file().map(|file| (file.clone(), Origin::User(file))),
        ];
        for (file, origin) in places.into_iter().flatten().filter(|(file, _)| file.is_file()) {
            if let Some(value) = value_in(&file, key)? {
                return Ok(Self { value, origin });
            }
        }
        Ok(Self { value: key.built_in().to_owned(), origin: Origin::BuiltIn })
    }
}

/// Whether a robot can be called so: its name stands in addresses and in names of files.
fn is_name(name: &str) -> bool {
    let is_letter = |letter: u8| letter.is_ascii_alphanumeric() || matches!(letter, b'-' | b'_');
    (1..=MAX_NAME).contains(&name.len()) && name.bytes().all(is_letter)
}

/// The robots of a service, by name, and how it is set.
pub type Robots = (BTreeMap<String, RobotEntry>, ServeEntry);

/// What a text of settings, which messages call `file`, says of the service.
///
/// # Errors
/// [`SettingsError::Toml`] or [`SettingsError::RobotName`].
pub fn service_of(text: &str, file: &str) -> Result<Robots, SettingsError> {
    let Written { robots, serve, .. } = robot_file::from_toml(text, file)?;
    match robots.keys().find(|name| !is_name(name)) {
        None => Ok((robots, serve)),
        Some(name) => Err(SettingsError::RobotName { file: file.to_owned(), name: name.clone() }),
    }
}

/// The robots that the service owns, and how it is set: by the nearest file that says anything of either, or that of
/// the user's configuration.
///
/// # Errors
/// [`SettingsError`] of the files that had to be looked at.
pub fn service() -> Result<Robots, SettingsError> {
    for file in [nearest(), user_file()].into_iter().flatten().filter(|file| file.is_file()) {
        let (robots, serve) = service_of(&input::read_text(&file)?, &input::name_of(&file))?;
        if !robots.is_empty() || serve != ServeEntry::default() {
            let directory = file.parent().unwrap_or(Path::new(""));
            let robots = robots.into_iter().map(|(name, entry)| (name, entry.in_directory(directory)));
            return Ok((robots.collect(), serve.in_directory(directory)));
        }
    }
    Ok((BTreeMap::new(), ServeEntry::default()))
}

/// The value that this file gives a key.
fn value_in(file: &Path, key: Key) -> Result<Option<String>, SettingsError> {
    let name = input::name_of(file);
    let written: Written = robot_file::from_toml(&input::read_text(file)?, &name)?;
    for (key, value) in [(Key::Robot, &written.robot), (Key::Port, &written.port)] {
        if value.as_ref().is_some_and(String::is_empty) {
            return Err(SettingsError::Empty { file: name, key: key.name() });
        }
    }
    Ok(key.from(&written, file.parent().unwrap_or(Path::new(""))))
}

/// The nearest `growbot.toml`, from the working directory upwards.
#[must_use]
pub fn nearest() -> Option<PathBuf> {
    let here = env::current_dir().ok()?;
    here.ancestors().map(|directory| directory.join(FILE)).find(|file| file.is_file())
}

/// The file of the user's configuration, whether or not it is there: `growbot/growbot.toml` in `$XDG_CONFIG_HOME`, or
/// in `~/.config`.
#[must_use]
pub fn user_file() -> Option<PathBuf> {
    user_file_in(env::var_os("XDG_CONFIG_HOME"), env::var_os("HOME"))
}

fn user_file_in(configuration: Option<OsString>, home: Option<OsString>) -> Option<PathBuf> {
    // What is not absolute is to be passed over, by the XDG base directory specification.
    let absolute = |name: Option<OsString>| name.map(PathBuf::from).filter(|path| path.is_absolute());
    let directory = absolute(configuration).or_else(|| Some(absolute(home)?.join(".config")))?;
    Some(directory.join("growbot").join(FILE))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_users_file_is_in_the_configuration_directory() {
        let of = |configuration: &str, home: &str| user_file_in(Some(configuration.into()), Some(home.into()));
        assert_eq!(of("/conf", "/home/me"), Some("/conf/growbot/growbot.toml".into()));
        assert_eq!(of("", "/home/me"), Some("/home/me/.config/growbot/growbot.toml".into()));
        assert_eq!(of("relative", "/home/me"), Some("/home/me/.config/growbot/growbot.toml".into()));
        assert_eq!(user_file_in(None, None), None);
    }

    #[test]
    fn a_robots_name_can_stand_in_an_address() {
        let named = |name: &str| service_of(&format!("[robots.{name:?}]\nport = \"sim:lab\"\n"), "growbot.toml");
        for name in ["lab", "Lab-2_b", &"a".repeat(MAX_NAME)] {
            assert!(named(name).is_ok(), "{name}");
        }
        for name in ["our lab", "a/b", "a?b", "", "l\u{e4}b", &"a".repeat(MAX_NAME + 1)] {
            let said = named(name).unwrap_err().to_string();
            assert!(said.contains("rename it") && said.contains(name), "{said}");
        }
    }

    #[test]
    fn paths_are_relative_to_the_file_and_names_are_names() {
        let value = |text: &str, key: Key| key.from(&toml::from_str(text).unwrap(), Path::new("/lab"));
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
