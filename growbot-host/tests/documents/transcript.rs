//! Runs the commands of a document, in the order in which they stand there, and compares what they print.

use std::fs;
use std::path::Path;
use std::process::Stdio;

use super::blocks::Document;
use crate::running::{self, PROGRAM};

/// All that a document's commands do otherwise than it says; nothing, if it is right.
pub fn differences(document: &Document) -> Vec<String> {
    let directory = tempfile::tempdir().unwrap();
    differences_in(document, directory.path())
}

/// As [`differences`], where the commands are run in this directory.
pub fn differences_in(document: &Document, directory: &Path) -> Vec<String> {
    let mut shell = Shell { directory, last: 0 };
    let mut wrong = Vec::new();
    let mut blocks: Vec<_> = document.blocks().into_iter().filter(|block| block.needs.is_empty()).collect();
    blocks.retain(|block| block.is("console") || block.is("sh"));
    for block in blocks {
        let place = |line: usize| format!("{}:{line}", document.path.display());
        if block.is("sh") {
            for command in block.commands() {
                let said = shell.run(&command);
                if shell.last != 0 {
                    wrong.push(format!("{}: {command}\n  ends with {}: {said}", place(block.line), shell.last));
                }
            }
            continue;
        }
        let steps = block.steps();
        for (index, step) in steps.iter().enumerate() {
            let said = shell.run(&step.command);
            let asked = steps.get(index + 1).is_some_and(|next| next.command == "echo $?");
            if shell.last != 0 && !asked {
                wrong.push(format!("{}: {}\n  ends with {}: {said}", place(step.line), step.command, shell.last));
            }
            let said = with_messages_in_lines(said.lines().filter(|line| !is_progress(line)));
            let wanted = with_messages_in_lines(step.says.iter().map(String::as_str));
            let [says, wants] = [&said, &wanted].map(|lines| lines.iter().map(String::as_str).collect::<Vec<_>>());
            if !agree(&wants, &says) {
                let (wanted, said) = (wanted.join("\n    "), said.join("\n    "));
                wrong.push(format!(
                    "{}: {}\n  should say\n    {wanted}\n  and says\n    {said}",
                    place(step.line),
                    step.command
                ));
            }
        }
    }
    wrong
}

/// A directory in which commands follow each other.
struct Shell<'a> {
    directory: &'a Path,
    /// How the last command ended.
    last: i32,
}

impl Shell<'_> {
    /// What the command prints, messages and all, in the order in which it does.
    fn run(&mut self, command: &str) -> String {
        let growbot = Path::new(PROGRAM).parent().unwrap();
        let path = format!("{}:{}", growbot.display(), std::env::var("PATH").unwrap_or_default());
        let home = self.directory.join("home");
        fs::create_dir_all(&home).unwrap();
        let output = running::command("sh")
            .arg("-c")
            .arg(format!("exec 2>&1\n(exit {})\n{command}", self.last))
            .current_dir(self.directory)
            .env_clear()
            .envs([("PATH", path.as_ref()), ("HOME", home.as_os_str())])
            .stdin(Stdio::null())
            .output()
            .unwrap();
        self.last = output.status.code().unwrap_or(-1);
        String::from_utf8_lossy(&output.stdout).into_owned()
    }
}

/// The lines, with each message in one: where it is broken depends on the names of files.
fn with_messages_in_lines<'a>(lines: impl Iterator<Item = &'a str>) -> Vec<String> {
    let mut joined: Vec<String> = Vec::new();
    for line in lines {
        let is_message = |last: &String| ["error: ", "warning: ", "note: "].iter().any(|label| last.starts_with(label));
        let more = line.strip_prefix("    ").filter(|more| !more.starts_with(' '));
        match (more, joined.last_mut()) {
            (Some(more), Some(last)) if is_message(last) => *last += &format!(" {more}"),
            _ => joined.push(line.to_owned()),
        }
    }
    joined
}

/// Whether lines are as wanted: a line `...` stands for any number of them, `[..]` within one for anything.
pub fn agree(wanted: &[&str], said: &[&str]) -> bool {
    match wanted.split_first() {
        None => said.is_empty(),
        Some((&"...", rest)) => (0..=said.len()).any(|skipped| agree(rest, &said[skipped..])),
        Some((line, rest)) => {
            said.split_first().is_some_and(|(first, others)| line_agrees(line, first) && agree(rest, others))
        }
    }
}

/// Whether a line tells how far a long work has come: on a slow machine there are more of them.
fn is_progress(line: &str) -> bool {
    line.starts_with("note: ") && line.ends_with(" %")
}

fn line_agrees(wanted: &str, said: &str) -> bool {
    let (wanted, said) = (wanted.trim_end(), said.trim_end());
    match wanted.split_once("[..]") {
        None => wanted == said,
        Some((before, after)) => said.strip_prefix(before).is_some_and(|rest| {
            (0..=rest.len()).filter(|at| rest.is_char_boundary(*at)).any(|at| line_agrees(after, &rest[at..]))
        }),
    }
}
