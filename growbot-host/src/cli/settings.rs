//! `growbot settings`: shows the settings of all commands and their origins.

use std::path::Path;

use clap::Args;
use growbot_host::output::print;
use growbot_plan::sanitize::json_line;
use growbot_serve::settings::{
    FILE_NAME, InvalidFiles, Key, Setting, SettingOrigin, SettingsJson, load_service, nearest, user_file,
};

use super::failure::Failure;
use super::remedies;

/// Show the default robot and port of commands, and where they are set
///
/// An option has the highest priority. The environment (GROWBOT_ROBOT, GROWBOT_PORT) comes second. The nearest
/// growbot.toml comes third: it is searched from this directory upwards. The growbot.toml of the user's configuration
/// ($XDG_CONFIG_HOME/growbot/growbot.toml, or ~/.config/growbot/growbot.toml) comes fourth. The built-in value comes
/// last. Paths in a growbot.toml are relative to that file. A plan contains its robot, so these settings do not change
/// it.
///
/// A growbot.toml is refused if another user can have written it: it and all folders above it must belong to you or to
/// root, and no other user may have write permission.
#[derive(Args)]
#[command(after_help = "\
Examples:
  growbot settings
  printf 'robot = \"growbot-b\"\\nport = \"/dev/ttyACM0\"\\n' > growbot.toml")]
pub struct ConfigArgs {
    /// Print one line of JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &ConfigArgs) -> Result<(), Failure> {
    let settings =
        Key::ALL.into_iter().map(|key| Ok((key, Setting::load(key)?))).collect::<Result<Vec<_>, Failure>>()?;
    if args.json {
        let settings: SettingsJson =
            settings.iter().map(|(key, setting)| (key.name().to_owned(), setting.into())).collect();
        return Ok(print(&json_line(&settings))?);
    }
    let width = settings.iter().map(|(_, setting)| setting.value.chars().count()).max().unwrap_or(0).max(5);
    let mut text = format!("setting  {:<width$}  from\n", "value");
    for (key, setting) in &settings {
        text += &format!("{:<7}  {:<width$}  {}\n", key.name(), setting.value, describe(&setting.origin));
    }
    let there = |file: Option<&Path>| file.filter(|file| file.is_file()).map(|file| file.display().to_string());
    let none = || "none".to_owned();
    let user = user_file();
    text += &format!("\nnearest {FILE_NAME}     {}\n", there(nearest().as_deref()).unwrap_or_else(none));
    let missing = || user.as_deref().map_or_else(none, |file| format!("none ({} does not exist)", file.display()));
    text += &format!("user's configuration     {}\n", there(user.as_deref()).unwrap_or_else(missing));
    let service = match load_service(InvalidFiles::Refuse)?.origin {
        SettingOrigin::BuiltIn => none(),
        origin => describe(&origin),
    };
    text += &format!("service configuration    {service}\n");
    Ok(print(&text)?)
}

/// Returns the value of a setting, and prints its origin. The origin of a port from the nearest `growbot.toml` is
/// always printed, because that file belongs to a project and chooses the robot. Other origins are printed only with
/// `--verbose`.
pub fn log_setting(key: Key, setting: Setting) -> String {
    if let (Key::Port, SettingOrigin::Nearest(file)) = (key, &setting.origin) {
        growbot_host::note!("port {} is from {}", setting.value, file.display());
        return setting.value;
    }
    growbot_host::detail!("{} {}, from: {}", key.name(), setting.value, describe(&setting.origin));
    setting.value
}

/// Returns the origin of a value as text for messages.
fn describe(origin: &SettingOrigin) -> String {
    match origin {
        SettingOrigin::Environment(variable) => (*variable).to_owned(),
        SettingOrigin::Nearest(file) | SettingOrigin::User(file) => file.display().to_string(),
        SettingOrigin::BuiltIn => "built in".to_owned(),
    }
}

/// Calls `load` so that it skips invalid settings files, and prints a warning for each of them.
pub fn skip_invalid<T>(load: impl FnOnce(InvalidFiles) -> Result<T, Failure>) -> Result<T, Failure> {
    let mut skipped = Vec::new();
    let loaded = load(InvalidFiles::Skip(&mut skipped));
    for error in &skipped {
        growbot_host::warning!(
            "the settings cannot be read and are not used for this stop: {}",
            remedies::message(error)
        );
    }
    loaded
}
