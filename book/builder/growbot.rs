//! Preprocessor for the parts of the book that growbot prints: the reference of its commands, and the fields of a robot
//! file.
//!
//! A line `{{#commands}}` of a chapter is replaced by all commands with their help. A line `{{#robot-fields growbot-a
//! growbot-b}}` is replaced by tables of the fields of a robot file, with their meaning and their values for these
//! robots.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};
use mdbook_preprocessor::book::{Book, BookItem};
use mdbook_preprocessor::{Preprocessor, PreprocessorContext};
use serde_json::Value;

/// Path of the program `growbot`.
#[derive(Clone)]
pub struct Growbot(PathBuf);

impl Growbot {
    /// Creates the value for the program at this path.
    ///
    /// # Errors
    /// Fails if the file does not exist.
    pub fn at(path: &Path) -> Result<Self> {
        let path = path.canonicalize();
        Ok(Self(path.context("there is no growbot: give the program, or nothing to have it built")?))
    }

    /// Runs growbot with these arguments in a directory, and returns its standard output.
    ///
    /// # Errors
    /// Fails if growbot fails.
    pub fn says(&self, arguments: &[&str], directory: &Path) -> Result<String> {
        let output = Command::new(&self.0).args(arguments).current_dir(directory).output();
        let output = output.with_context(|| format!("{} cannot be run", self.0.display()))?;
        let message = String::from_utf8_lossy(&output.stderr);
        ensure!(output.status.success(), "growbot {} fails: {message}", arguments.join(" "));
        Ok(String::from_utf8(output.stdout)?)
    }

    fn help(&self, arguments: &[&str]) -> Result<String> {
        self.says(arguments, Path::new("."))
    }

    /// Returns the text of the reference: for each command, a heading and the output of `--help`.
    fn commands(&self) -> Result<String> {
        let help = self.help(&["--help"])?;
        let (list, _) = help.split_once("\nOptions:\n").context("growbot --help lists no options")?;
        // The line of a command begins with two spaces. Its continuation lines begin with more.
        let names = list.lines().filter_map(|line| line.strip_prefix("  ")).filter(|line| !line.starts_with(' '));
        let names: Vec<_> = names.filter_map(|line| line.split(' ').next()).filter(|name| *name != "help").collect();
        ensure!(!names.is_empty(), "growbot --help lists no commands");
        let mut text = format!("## growbot\n\n```text\n{}\n```\n", help.trim_end());
        for name in names {
            let help = self.help(&[name, "--help"])?;
            write!(text, "\n## growbot {name}\n\n```text\n{}\n```\n", help.trim_end())?;
        }
        Ok(text)
    }

    /// Returns tables of the fields of a robot file, one for each section, with the values of the fields for these
    /// robots.
    fn robot_fields(&self, robots: &[&str]) -> Result<String> {
        let Some((first, _)) = robots.split_first() else { bail!("robot-fields wants the names of robots") };
        let explained = |robot: &&str| Ok(serde_json::from_str(&self.help(&["robots", robot, "--json"])?)?);
        let all: Vec<Value> = robots.iter().map(explained).collect::<Result<_>>()?;
        let fields = |robot: &Value| robot["fields"].as_array().cloned().unwrap_or_default();
        let paths = all.iter().flat_map(fields).filter_map(|field| field["field"].as_str().map(str::to_owned));
        let mut seen: Vec<String> = Vec::new();
        for path in paths {
            if !seen.contains(&path) {
                // A field is inserted after the other fields of its section.
                let after = seen.iter().rposition(|other| section(other) == section(&path));
                seen.insert(after.map_or(seen.len(), |place| place + 1), path);
            }
        }
        ensure!(!seen.is_empty(), "growbot robots {first} --json has no fields");
        let mut text = String::new();
        let mut last = None;
        for path in &seen {
            if last != Some(section(path)) {
                last = Some(section(path));
                let name = section(path);
                let title = if name.is_empty() { "At the top".to_owned() } else { format!("`[{name}]`") };
                // A non-breaking hyphen keeps the names of robots on one line.
                let names = robots.join(" | ").replace('-', "\u{2011}");
                write!(text, "\n### {title}\n\n| key | {names} |\n|---|{}\n", "---|".repeat(robots.len()))?;
            }
            let key = path.strip_prefix(&format!("{}.", section(path))).unwrap_or(path);
            let (mut means, mut values) = ("", String::new());
            for robot in &all {
                let field =
                    robot["fields"].as_array().and_then(|all| all.iter().find(|field| field["field"] == **path));
                let default = field.and_then(|field| field["value"].as_str()).unwrap_or("");
                let value =
                    if default.is_empty() { "-".to_owned() } else { format!("`{}`", default.replace('|', "\\|")) };
                let is = |what: &str, so: bool| field.is_some_and(|field| field[what] == so);
                let mark = if is("assumed", true) {
                    "\\*"
                } else if is("in_file", false) {
                    "°"
                } else {
                    ""
                };
                write!(values, " {value}{mark} |")?;
                means = field.and_then(|field| field["means"].as_str()).unwrap_or(means);
            }
            let means = means.replace('|', "\\|").replace('<', "&lt;").replace('*', "\\*").replace('_', "\\_");
            writeln!(text, "| `{key}`<br>{means} |{values}")?;
        }
        Ok(text)
    }

    /// Returns the text of a chapter in which the lines `{{#commands}}` and `{{#robot-fields ...}}` are replaced.
    fn fill(&self, chapter: &str) -> Result<String> {
        let mut text = String::with_capacity(chapter.len());
        for line in chapter.lines() {
            match line.strip_prefix("{{#").and_then(|rest| rest.strip_suffix("}}")) {
                None => text += line,
                Some(directive) => {
                    let words: Vec<_> = directive.split_whitespace().collect();
                    text += &match words.split_first() {
                        Some((&"commands", [])) => self.commands()?,
                        Some((&"robot-fields", robots)) => self.robot_fields(robots)?,
                        _ => bail!("nobody knows what {line} stands for, or the file that it names is not there"),
                    };
                }
            }
            text.push('\n');
        }
        Ok(text)
    }
}

/// Returns the section of a field, such as `layer` for `layer.height_mm`. Empty for a field at the top.
fn section(path: &str) -> &str {
    path.split_once('.').map_or("", |(section, _)| section)
}

/// Preprocessor of mdBook that replaces lines such as `{{#commands}}` by growbot's output.
pub struct Reference(pub Growbot);

impl Preprocessor for Reference {
    fn name(&self) -> &str {
        "growbot"
    }

    fn run(&self, _: &PreprocessorContext, mut book: Book) -> Result<Book> {
        in_each_chapter(&mut book, |text| self.0.fill(text))?;
        Ok(book)
    }
}

/// Replaces the text of each chapter of a book by the result of `change`.
///
/// # Errors
/// Fails with the first error, which names the chapter.
pub fn in_each_chapter(book: &mut Book, change: impl Fn(&str) -> Result<String>) -> Result<()> {
    let mut done = Ok(());
    book.for_each_mut(|item| {
        if let BookItem::Chapter(chapter) = item
            && done.is_ok()
        {
            match change(&chapter.content) {
                Ok(text) => chapter.content = text,
                Err(error) => done = Err(error.context(format!("in the chapter {:?}", chapter.name))),
            }
        }
    });
    done
}
