//! The commands of the console, as text and as values.

use growbot_client::maintenance;
use growbot_core::pose::Pose;
use growbot_plan::plan::Goal;
use growbot_plan::pose_text::{parse_goal, parse_number, parse_pose};
use growbot_plan::suggest::did_you_mean;

use crate::cli::usage;

/// Longest time that `wait` accepts, s.
const LONGEST_WAIT_S: f64 = 1e6;

/// The command of a line that the user has typed.
#[derive(Debug, Clone, PartialEq)]
pub enum ConsoleCommand {
    /// An empty line.
    Nothing,
    /// A request that the board answers at once.
    Board(BoardRequest),
    /// Plan to this goal, and grow the body.
    Grow(Goal),
    /// Print the board's events for this time, s of the board's clock.
    Wait(f64),
    /// Print the list of commands.
    Help,
    /// Leave the console.
    Quit,
}

/// Requests that the board answers at once.
#[derive(Debug, Clone, PartialEq)]
pub enum BoardRequest {
    /// Read the identity, the status and the sensors of the board.
    Status,
    /// Plan to this pose on the board, which stores the layers.
    Plan(Pose),
    /// Grow the stored layers, or continue after a pause.
    Start,
    /// Pause after the layer under way.
    Pause,
    /// Print the layers that the board stores, from this index on. `None` means from the next layer that will be
    /// laid.
    Layers(Option<u32>),
    /// Switch heater and steppers off.
    Stop,
    /// Emergency stop: switch heater and steppers off before anything else, until the stop is cleared.
    EmergencyStop,
    /// Clear a fault or an emergency stop.
    Clear,
    /// A maintenance command and its argument, which may name a preset.
    Maintain(&'static str, String),
}

/// A command of the console, as `help` lists it.
struct CommandEntry {
    name: &'static str,
    argument: &'static str,
    help: &'static str,
}

const COMMANDS: [CommandEntry; 12] = [
    CommandEntry { name: "status", argument: "", help: "identity and state of the board, sensor readings" },
    CommandEntry { name: "plan", argument: "POSE", help: "plan on the board to POSE, and store the layers" },
    CommandEntry { name: "start", argument: "", help: "heat and grow the stored layers, or continue a pause" },
    CommandEntry { name: "pause", argument: "", help: "finish the current layer and wait; `start` continues" },
    CommandEntry { name: "grow", argument: "GOAL", help: "plan here to POSE or X,Y,Z, heat, grow, and wait" },
    CommandEntry { name: "layers", argument: "[FROM]", help: "list up to 16 of the stored layers" },
    CommandEntry { name: "wait", argument: "[SECONDS]", help: "show events for SECONDS (1)" },
    CommandEntry { name: "stop", argument: "", help: "heater and steppers off" },
    CommandEntry { name: "estop", argument: "", help: "emergency stop: off at once, and off until `clear`" },
    CommandEntry { name: "clear", argument: "", help: "clear a fault or an emergency stop whose cause is gone" },
    CommandEntry { name: "help", argument: "", help: "this list" },
    CommandEntry { name: "quit", argument: "", help: "quit; a growing robot finishes its layer and pauses" },
];

/// Poses that completion offers: straight up, to the side, and bent in both planes.
const POSES: [&str; 3] = ["0,0,100,0,90", "200,100,600,0,45", "550,345,610,120,-25"];

/// Returns the list of commands as text.
pub fn help() -> String {
    let line = |name: &str, argument: &str, help: &str| format!("{:<21}{help}\n", format!("{name} {argument}"));
    let own = COMMANDS.iter().map(|entry| line(entry.name, entry.argument, entry.help));
    let maintaining = maintenance::COMMANDS.iter().map(|(name, argument, help)| line(name, argument, help));
    own.chain(maintaining).collect()
}

/// Returns the list of commands for a screen of 80 by 24, without the command that shows it.
pub fn screen_help() -> String {
    help().lines().filter(|line| !line.starts_with("help ")).map(|line| format!("{line}\n")).collect()
}

/// Parses a line.
///
/// # Errors
/// Returns a message about the mistake in the line.
pub fn parse(line: &str) -> Result<ConsoleCommand, String> {
    let line = line.trim();
    let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
    let rest = rest.trim();
    let alone = |command: ConsoleCommand| match rest {
        "" => Ok(command),
        _ => Err(format!("`{word}` takes no arguments: remove {rest:?}")),
    };
    match word {
        "" => Ok(ConsoleCommand::Nothing),
        "status" => alone(ConsoleCommand::Board(BoardRequest::Status)),
        "plan" => Ok(ConsoleCommand::Board(BoardRequest::Plan(pose(rest)?))),
        "start" => alone(ConsoleCommand::Board(BoardRequest::Start)),
        "pause" => alone(ConsoleCommand::Board(BoardRequest::Pause)),
        "grow" => parse_goal(rest).map(|typed| ConsoleCommand::Grow(typed.goal)).map_err(|error| error.to_string()),
        "layers" if rest.is_empty() => Ok(ConsoleCommand::Board(BoardRequest::Layers(None))),
        "layers" => rest
            .parse()
            .map(|first| ConsoleCommand::Board(BoardRequest::Layers(Some(first))))
            .map_err(|_| format!("{rest:?} is not a layer number: give a whole number, 0 or more")),
        "wait" if rest.is_empty() => Ok(ConsoleCommand::Wait(1.0)),
        "wait" => parse_number(rest)
            .filter(|seconds| (0.0..=LONGEST_WAIT_S).contains(seconds))
            .map(ConsoleCommand::Wait)
            .ok_or_else(|| format!("{rest:?} is not a time: give seconds, 0 to {LONGEST_WAIT_S}")),
        "stop" => alone(ConsoleCommand::Board(BoardRequest::Stop)),
        // The rest of the line is ignored, so that a typing error does not prevent an emergency stop.
        "estop" => Ok(ConsoleCommand::Board(BoardRequest::EmergencyStop)),
        "clear" => alone(ConsoleCommand::Board(BoardRequest::Clear)),
        "help" => alone(ConsoleCommand::Help),
        "quit" | "exit" => alone(ConsoleCommand::Quit),
        _ => {
            if let Some((name, ..)) = maintenance::COMMANDS.iter().find(|(name, ..)| *name == word) {
                return Ok(ConsoleCommand::Board(BoardRequest::Maintain(name, rest.to_owned())));
            }
            let suggestion = did_you_mean(word, names().filter(|name| !usage::may_move(name)));
            Err(format!("unknown command {word:?}{suggestion}: `help` lists the commands"))
        }
    }
}

/// Returns the names of all commands.
fn names() -> impl Iterator<Item = &'static str> {
    COMMANDS.iter().map(|entry| entry.name).chain(maintenance::COMMANDS.iter().map(|(name, ..)| *name))
}

fn pose(text: &str) -> Result<Pose, String> {
    parse_pose(text).map_err(|error| error.to_string())
}

/// Returns the completions of a line that is partly typed: the byte index from which a completion replaces the line,
/// and the possible texts.
pub fn complete(begun: &str) -> (usize, Vec<String>) {
    let indent = begun.len() - begun.trim_start().len();
    match begun.trim_start().split_once(char::is_whitespace) {
        None => {
            let begun = begun.trim_start();
            let own = COMMANDS.iter().map(|entry| (entry.name, entry.argument));
            let maintaining = maintenance::COMMANDS.iter().map(|(name, argument, _)| (*name, *argument));
            let fit = own.chain(maintaining).filter(|(name, _)| name.starts_with(begun));
            let space = |argument: &str| if argument.is_empty() { "" } else { " " };
            (indent, fit.map(|(name, argument)| format!("{name}{}", space(argument))).collect())
        }
        Some((word, rest)) if matches!(argument(word), "POSE" | "GOAL") => {
            let rest = rest.trim_start();
            let poses = POSES.into_iter().filter(|pose| pose.starts_with(rest));
            (begun.len() - rest.len(), poses.map(str::to_owned).collect())
        }
        Some(_) => (begun.len(), Vec::new()),
    }
}

/// Returns a hint about the argument of the command in `line`, if the line ends with a space. `None` if the command
/// takes neither a pose nor a goal.
pub fn hint(line: &str) -> Option<&'static str> {
    let word = line.strip_suffix(' ')?;
    match argument(word.trim()) {
        "POSE" => Some("X,Y,Z,HEADING,PITCH in mm and degrees"),
        "GOAL" => Some("X,Y,Z,HEADING,PITCH in mm and degrees, or X,Y,Z for any direction"),
        _ => None,
    }
}

/// Returns the placeholder of a command's argument. It is empty if the command takes none.
fn argument(name: &str) -> &'static str {
    COMMANDS.iter().find(|entry| entry.name == name).map_or("", |entry| entry.argument)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_listed_command_is_parsed() {
        for word in &COMMANDS {
            let argument = if matches!(word.argument, "POSE" | "GOAL") { POSES[0] } else { "" };
            assert!(parse(&format!(" {} {argument} ", word.name)).is_ok(), "{}", word.name);
        }
        assert_eq!(parse("wait 2.5"), Ok(ConsoleCommand::Wait(2.5)));
        assert_eq!(parse("layers 16"), Ok(ConsoleCommand::Board(BoardRequest::Layers(Some(16)))));
        assert_eq!(parse("exit"), Ok(ConsoleCommand::Quit));
        assert_eq!(parse("estop now"), Ok(ConsoleCommand::Board(BoardRequest::EmergencyStop)));
        assert_eq!(parse("\t"), Ok(ConsoleCommand::Nothing));
        assert!(parse("plan 0, 0, 100, 0, 90").is_ok());
        assert!(matches!(parse("grow 0, 0.1m, 100"), Ok(ConsoleCommand::Grow(Goal::Position(_)))));
        assert!(matches!(parse("grow 0,0,100,0,90"), Ok(ConsoleCommand::Grow(Goal::Pose(_)))));
    }

    #[test]
    fn unknown_commands_and_extra_arguments_are_quoted() {
        for (line, part) in [
            ("stop now", "`stop` takes no arguments: remove \"now\""),
            ("status 1 2", "remove \"1 2\""),
            ("quit please", "`quit` takes no arguments"),
            ("plam 0,0,100,0,90", "unknown command \"plam\" (did you mean plan?)"),
            ("stat", "unknown command \"stat\" (did you mean status?)"),
            ("prehet", "unknown command \"prehet\": `help` lists the commands"),
            ("gro", "unknown command \"gro\": `help` lists the commands"),
            ("layers 1 2", "\"1 2\" is not a layer number"),
            ("layers -1", "\"-1\" is not a layer number"),
            ("wait 1 2", "\"1 2\" is not a time"),
            ("wait 1e9", "\"1e9\" is not a time: give seconds, 0 to 1000000"),
            ("wait nan", "not a time"),
            ("plan", "five numbers"),
            ("plan 0,0,100", "five numbers"),
            ("grow", "X,Y,Z"),
        ] {
            let message = parse(line).unwrap_err();
            assert!(message.contains(part), "{line:?}: {message}");
        }
    }

    #[test]
    fn lines_are_completed_and_hinted() {
        let completed = |begun: &str| complete(begun);
        assert_eq!(completed("st"), (0, vec!["status".to_owned(), "start".to_owned(), "stop".to_owned()]));
        assert_eq!(completed(" pl"), (1, vec!["plan ".to_owned()]));
        assert_eq!(completed("grow 2"), (5, vec!["200,100,600,0,45".to_owned()]));
        assert_eq!(completed("plan ").1.len(), POSES.len());
        assert!(completed("stop ").1.is_empty());
        for pose in POSES {
            assert!(parse(&format!("plan {pose}")).is_ok(), "{pose}");
        }
        assert!(
            hint("grow ").is_some() && hint("plan ").is_some() && hint("plan").is_none() && hint("stop ").is_none()
        );
    }
}
