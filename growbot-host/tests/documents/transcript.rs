//! Runs the commands of a document in their order, and compares their output with the output that the document shows.
//!
//! `trycmd` compares such blocks too, but runs programs without a shell: no pipes, no redirections, no `echo $?`.

use std::fs;
use std::path::Path;
use std::process::Stdio;

use super::blocks::{Block, Document};
use crate::running::{self, PROGRAM};

/// Returns the code blocks of a document whose commands this test runs.
pub fn runs(document: &Document) -> Vec<Block> {
    let mut blocks = document.blocks();
    blocks.retain(|block| block.needs.is_empty() && (block.is("console") || block.is("sh")));
    blocks
}

/// Returns every difference between the output of a document's commands and the output that the document shows.
pub fn differences(document: &Document) -> Vec<String> {
    let directory = tempfile::tempdir().unwrap();
    differences_in(document, directory.path())
}

/// Like [`differences`], but runs the commands in this directory.
pub fn differences_in(document: &Document, directory: &Path) -> Vec<String> {
    let mut shell = Shell { directory, last: 0 };
    let mut wrong = Vec::new();
    for block in runs(document) {
        let place = |line: usize| format!("{}:{line}", document.path.display());
        if block.is("sh") {
            for command in block.commands() {
                let printed = shell.run(&command);
                if shell.last != 0 {
                    wrong.push(format!("{}: {command}\n  ends with {}: {printed}", place(block.line), shell.last));
                }
            }
            continue;
        }
        let steps = block.steps();
        for (index, step) in steps.iter().enumerate() {
            let printed = shell.run(&step.command);
            let expected = steps.get(index + 1).is_some_and(|next| next.command == "echo $?");
            if shell.last != 0 && !expected {
                wrong.push(format!("{}: {}\n  ends with {}: {printed}", place(step.line), step.command, shell.last));
            }
            let printed = with_messages_in_lines(printed.lines().filter(|line| !is_progress(line)));
            let wanted = with_messages_in_lines(step.prints.iter().map(String::as_str));
            let [prints, wants] = [&printed, &wanted].map(|lines| lines.iter().map(String::as_str).collect::<Vec<_>>());
            if !agree(&wants, &prints) {
                let (wanted, printed) = (wanted.join("\n    "), printed.join("\n    "));
                wrong.push(format!(
                    "{}: {}\n  should print\n    {wanted}\n  and prints\n    {printed}",
                    place(step.line),
                    step.command
                ));
            }
        }
    }
    wrong
}

/// A shell that runs successive commands in one directory.
struct Shell<'a> {
    directory: &'a Path,
    /// Exit code of the latest command.
    last: i32,
}

impl Shell<'_> {
    /// Runs a command and returns its standard output and standard error in their order.
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

/// Returns the lines, with each message joined into one line, because the line breaks of messages depend on the lengths
/// of file names.
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

/// Returns true if printed lines match the wanted ones. A line `...` matches any number of lines, and `[..]` within a
/// line matches any text.
pub fn agree(wanted: &[&str], printed: &[&str]) -> bool {
    match wanted.split_first() {
        None => printed.is_empty(),
        Some((&"...", rest)) => (0..=printed.len()).any(|skipped| agree(rest, &printed[skipped..])),
        Some((line, rest)) => {
            printed.split_first().is_some_and(|(first, others)| line_agrees(line, first) && agree(rest, others))
        }
    }
}

/// Returns true if a line reports the progress of a long command. A slow machine prints more of these lines.
fn is_progress(line: &str) -> bool {
    line.starts_with("note: ") && line.ends_with(" %")
}

fn line_agrees(wanted: &str, printed: &str) -> bool {
    let (wanted, printed) = (wanted.trim_end(), printed.trim_end());
    match wanted.split_once("[..]") {
        None => wanted == printed,
        Some((before, after)) => printed.strip_prefix(before).is_some_and(|rest| {
            (0..=rest.len()).filter(|at| rest.is_char_boundary(*at)).any(|at| line_agrees(after, &rest[at..]))
        }),
    }
}
