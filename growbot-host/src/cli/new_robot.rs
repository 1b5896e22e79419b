//! `growbot new-robot`: guides the user through the values of a robot, and writes its file.

use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};

use clap::Args;
use growbot_host::messages::print_prompt as ask_line;
use growbot_host::output::{is_standard_output, print, write_to};
use growbot_plan::atomic_file::format_from_extension;
use growbot_plan::input::is_standard_input;
use growbot_plan::robot_file;
use growbot_plan::robot_questions::{ASKED_FIELDS, Draft, NAME, NO_LIMIT, UNLIMITED};
use growbot_plan::robot_schema;
use serde_json::Value;

use super::failure::Failure;
use super::robot_arg::ROBOT;
use super::typed_answer::read_answer;

/// Describe a robot of your own: answer questions, get its file
///
/// The questions are about the most important values. Enter accepts the value in brackets: that of the base robot
/// (--base), or one near it that fits the earlier answers. `back` returns to the previous question. `skip` accepts the
/// proposed values of the rest of a section.
///
/// Answers may come from a pipe, one per line. Then the first invalid answer ends the command. If the answers end
/// early, the remaining values are those in brackets. All other values stay as they are in the base robot, with their
/// comments.
#[derive(Args)]
#[command(after_help = "Examples:\n  growbot new-robot --base growbot-a -o my-robot.toml\n  printf \
                        'my-robot\\n14\\n60\\n25\\n' | growbot new-robot")]
pub struct NewRobotArgs {
    /// Write this file (- for standard output) [default: the robot's name and .toml]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// The robot to start from: a built-in name or a TOML file
    #[arg(long, value_name = ROBOT, default_value = robot_file::DEFAULT)]
    base: PathBuf,
    /// Replace an existing file
    #[arg(long)]
    overwrite: bool,
}

/// Runs the command.
pub fn run(args: &NewRobotArgs) -> Result<(), Failure> {
    if let Some(output) = &args.output {
        format_from_extension(output, &["toml"])?;
        refuse_to_overwrite(output, args.overwrite)?;
    }
    if is_standard_input(&args.base) {
        return Err(Failure::bad_input("standard input is needed for the answers: give the base robot as a file"));
    }
    let (text, file) = robot_file::text_of(&args.base)?;
    let name = name_in(args.output.as_deref());
    let mut draft = Draft::of(&text, &file, &name)?;
    let given = ask(&mut draft)?;
    let (robot, text) = draft.file(&given)?;
    let output = args.output.clone().unwrap_or_else(|| PathBuf::from(format!("{}.toml", robot.name())));
    refuse_to_overwrite(&output, args.overwrite)?;
    if !write_to(&output, text.as_bytes())? {
        return Ok(());
    }
    let assumed = text.matches("# assumed").count();
    let output = output.display();
    let mut notes = String::new();
    if robot.description().test_bench {
        notes += "\ntest_bench is true, as in the base robot: the board heats although a debug probe is attached. \
                  Remove this line before the robot works unattended.\n";
    }
    if let Err(error) = robot.check_for_board() {
        notes += &format!("\nThe robot can be planned for and simulated, but no board can drive it: {error}.\n");
    }
    Ok(print(&format!(
        "{name}, written to {output}\nR_min     {r_min:.2} mm: {by_geometry:.2} by its mechanics, {by_layers:.2} by \
         its layers\nplans at  {radius} mm\n\nMeasure next, before the heater is switched on ({assumed} lines are \
         still assumed):\n  layer.height_min_mm, height_max_mm, tilt_max_deg: print bends; they decide R_min\n  \
         feed.steps_per_mm: how much filament a revolution pushes\n  head.index_angle_deg: where the mark is\n  \
         thermistor, heater.max_c: what the data sheets of your parts say\n  heater.kp, ki, kd: growbot tune --robot \
         {output} --port PORT, on the real robot: a simulated robot has other gains\ngrowbot robots {output} explains \
         all of it.\n{notes}",
        name = robot.name(),
        r_min = robot.min_radius(),
        by_geometry = robot.min_radius_by_packaging(),
        by_layers = robot.min_radius_by_layers(),
        radius = robot.description().planning_radius_mm,
    ))?)
}

fn refuse_to_overwrite(output: &Path, overwrite: bool) -> Result<(), Failure> {
    if !overwrite && !is_standard_output(output) && output.symlink_metadata().is_ok() {
        return Err(Failure::bad_input(format!(
            "{} already exists: choose another name with -o, or replace it with --overwrite",
            output.display()
        )));
    }
    Ok(())
}

/// Returns the proposed name of the robot: the name of the output file without its extension, or `my-robot` if that
/// is not a valid name.
fn name_in(output: Option<&Path>) -> String {
    let stem = output.and_then(Path::file_stem).map(|stem| stem.to_string_lossy().to_lowercase());
    let plain = |name: &String| {
        !name.starts_with('-')
            && !name.is_empty()
            && name.len() <= 32
            && name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-')
            && !robot_file::is_built_in(name)
    };
    stem.filter(plain).unwrap_or_else(|| "my-robot".to_owned())
}

/// Answer that returns to the previous question.
const BACK: &str = "back";
/// Answer that accepts the proposed values of the rest of a section.
const SKIP: &str = "skip";

/// State of the dialogue: the present draft, the fields that were answered so far (`given`), and both as they were
/// before each answer (`before`).
struct Interview<'a> {
    draft: &'a mut Draft,
    given: Vec<&'static str>,
    before: Vec<(Draft, Vec<&'static str>)>,
    answers: AnswerReader,
}

/// Goes through all questions. Returns the fields for which the user typed more than Enter.
fn ask(draft: &mut Draft) -> Result<Vec<&'static str>, Failure> {
    let schema = robot_schema::robot_file_schema_without_bounds();
    let answers = AnswerReader { ended: false, is_interactive: io::stdin().is_terminal() };
    let mut asking = Interview { draft, given: Vec::new(), before: Vec::new(), answers };
    // Section whose remaining questions are skipped.
    let mut skipped = None;
    while let Some(path) = ASKED_FIELDS.get(asking.before.len()).copied() {
        let proposed = asking.draft.suggested_value(path);
        let is_skipped = skipped == Some(section(path));
        if !is_skipped {
            skipped = None;
        }
        let answer = if asking.answers.ended || (is_skipped && proposed.is_some()) {
            None
        } else {
            ask_for(path, proposed.as_deref(), &schema);
            asking.answers.next()?
        };
        match answer.as_deref().map(str::trim).filter(|answer| !answer.is_empty()) {
            Some(BACK) => {
                skipped = None;
                asking.back();
            }
            Some(SKIP) if proposed.is_some() => {
                skipped = Some(section(path));
                asking.take(path, None, proposed.as_deref())?;
            }
            text => asking.take(path, text, proposed.as_deref())?,
        }
    }
    Ok(asking.given)
}

/// Returns the section of a field. A field outside of all sections is a section of its own.
fn section(path: &'static str) -> &'static str {
    path.split('.').next().unwrap_or(path)
}

fn ask_for(path: &str, proposed: Option<&str>, schema: &Value) {
    let words: Vec<&str> = robot_schema::choices(schema, path).iter().map(|(word, _)| *word).collect();
    let words = if words.is_empty() { String::new() } else { format!(" ({})", words.join(", ")) };
    ask_line(format_args!("{}", robot_schema::meaning(schema, path)));
    match proposed {
        Some(proposed) => ask_line(format_args!("  {path}{words} [{}]:", in_brackets(proposed))),
        None => ask_line(format_args!("  {path}{words} (no value fits the previous answers, type {BACK}):")),
    }
}

/// Returns a value as it is shown in brackets.
fn in_brackets(value: &str) -> &str {
    if value == UNLIMITED { NO_LIMIT } else { value.trim_matches('"') }
}

impl Interview<'_> {
    /// Returns to the previous question.
    fn back(&mut self) {
        match self.before.pop() {
            Some((draft, given)) => (*self.draft, self.given) = (draft, given),
            None => growbot_host::note!("this is the first question"),
        }
    }

    /// Applies the answer `text` to the field `path`, or the proposed value if `text` is `None`. At a terminal, the
    /// question is repeated after an invalid answer.
    fn take(&mut self, path: &'static str, text: Option<&str>, proposed: Option<&str>) -> Result<(), Failure> {
        let shown = self.draft.shown(path);
        let taken = text.unwrap_or_else(|| in_brackets(proposed.unwrap_or(&shown)));
        let before = (self.draft.clone(), self.given.clone());
        match self.draft.apply_answer(path, taken) {
            Ok(adapted) => {
                for change in adapted {
                    growbot_host::note!(
                        "{} was {}, which is not possible with the new answer: {0} is now {}",
                        change.path,
                        change.from,
                        change.to
                    );
                }
                self.before.push(before);
                if text.is_some() && path != NAME {
                    self.given.push(path);
                }
                Ok(())
            }
            // In a pipe the next line is the answer to the next question.
            Err(refused) if self.answers.is_interactive && !self.answers.ended => {
                Failure::bad_input(refused).print();
                Ok(())
            }
            Err(refused) => Err(Failure::bad_input(refused)),
        }
    }
}

/// Reader of the answers from standard input.
struct AnswerReader {
    ended: bool,
    is_interactive: bool,
}

impl AnswerReader {
    /// Returns the next answer. `None` after the end of the input, which is reported once.
    fn next(&mut self) -> Result<Option<String>, Failure> {
        let line = read_answer().map_err(Failure::bad_input)?;
        if line.is_none() {
            self.ended = true;
            growbot_host::note!(
                "standard input ends here: all further questions keep the value in brackets, or stay unchanged"
            );
        }
        Ok(line)
    }
}
