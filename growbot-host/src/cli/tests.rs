//! Tests that the commands in README.md and the book exist. The definitions of the command line parse each command,
//! even if it needs a robot, an emulator or a long time. (`tests/documents.rs` runs the others.)

#[path = "../../tests/documents/blocks.rs"]
#[expect(dead_code, reason = "tests/documents.rs uses the rest")]
mod blocks;

use std::fs;

use blocks::{Document, beside, for_users, root};
use clap::error::ErrorKind;
use clap::{CommandFactory, Parser};
use pulldown_cmark::Event;

use super::Cli;

/// Returns the words of each simple command of a shell line, without redirections and comments.
fn simple_commands(line: &str) -> Vec<Vec<String>> {
    let mut commands = vec![Vec::new()];
    let mut word: Option<String> = None;
    let mut quote = None;
    let mut redirected = false;
    let mut chars = line.chars().peekable();
    loop {
        let c = chars.next();
        match (c, quote) {
            (Some(c), Some(open)) if c == open => quote = None,
            (Some(c), Some(_)) => word.get_or_insert_default().push(c),
            (Some(c @ ('\'' | '"')), None) => {
                quote = Some(c);
                word.get_or_insert_default();
            }
            (Some('\\'), None) => word.get_or_insert_default().extend(chars.next().filter(|c| *c != '\n')),
            (Some(' ' | '\n' | '|' | '&' | ';' | '>' | '<') | None, _) => {
                if let Some(word) = word.take()
                    && !std::mem::take(&mut redirected)
                {
                    commands.last_mut().expect("there is always one").push(word);
                }
                match c {
                    Some('>' | '<') => redirected = true,
                    Some('|' | '&' | ';' | '\n') => commands.push(Vec::new()),
                    Some(_) => {}
                    None => break,
                }
            }
            (Some('#'), None) if word.is_none() => while chars.next_if(|c| *c != '\n').is_some() {},
            (Some(c), None) => word.get_or_insert_default().push(c),
        }
    }
    commands.retain(|words| !words.is_empty());
    commands
}

/// Returns the words of a command that runs growbot, directly or by `cargo run`. `None` for another command.
fn growbot(words: &[String]) -> Option<Vec<&str>> {
    let words: Vec<_> = words.iter().map(String::as_str).skip_while(|word| word.contains('=')).collect();
    match words.as_slice() {
        ["growbot", ..] => Some(words),
        ["cargo", "run", "--release", "--", rest @ ..] => Some([&["growbot"], rest].concat()),
        _ => None,
    }
}

/// Returns the error if the command line of growbot cannot be parsed.
fn wrong(words: &[&str]) -> Option<String> {
    match Cli::try_parse_from(words) {
        Ok(_) => None,
        Err(error) if matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) => None,
        Err(error) => Some(error.to_string()),
    }
}

/// Returns the commands in the code blocks of a document, with their line numbers. Commands whose exit code the
/// document shows are omitted, because they are run in `tests/documents.rs`.
fn commands(document: &Document) -> Vec<(usize, Vec<String>)> {
    let mut found = Vec::new();
    for block in document.blocks() {
        let commands = block.commands();
        for (index, command) in commands.iter().enumerate() {
            let answered_no = commands.get(index + 1).is_some_and(|next| next == "echo $?");
            if !(block.needs.is_empty() && answered_no) {
                found.extend(simple_commands(command).into_iter().map(|words| (block.line, words)));
            }
        }
    }
    found
}

/// Returns the inline code of a document with its line numbers.
fn inline_code(document: &Document) -> Vec<(usize, String)> {
    let code = |(event, line)| if let Event::Code(code) = event { Some((line, code.to_string())) } else { None };
    document.events().filter_map(code).collect()
}

#[test]
fn every_command_in_a_code_block_is_valid() {
    let (mut all, mut faults) = (0, Vec::new());
    for document in for_users().iter().chain(&beside()) {
        for (line, words) in commands(document) {
            if let Some(words) = growbot(&words) {
                all += 1;
                faults.extend(wrong(&words).map(|why| format!("{}:{line}: {words:?}: {why}", document.path.display())));
            }
        }
    }
    assert!(all > 60, "only {all} commands found");
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn every_inline_command_has_valid_name_and_options() {
    let mut root = Cli::command();
    root.build();
    let (mut all, mut faults) = (0, Vec::new());
    for document in for_users().iter().chain(&beside()) {
        for (line, code) in inline_code(document) {
            for words in simple_commands(&code) {
                let mut words = words.iter().map(String::as_str);
                if words.next() != Some("growbot") {
                    continue;
                }
                all += 1;
                let mut fault = |what: &str| faults.push(format!("{}:{line}: {code}: {what}", document.path.display()));
                let mut command = &root;
                for word in words {
                    let name = word.split('=').next().unwrap_or(word);
                    if let Some(option) = name.strip_prefix("--") {
                        if !command.get_arguments().any(|argument| argument.get_long() == Some(option)) {
                            fault(&format!("has no option --{option}"));
                        }
                    } else if std::ptr::eq(command, &root) {
                        match root.find_subcommand(word) {
                            Some(found) => command = found,
                            None if word == "COMMAND" => {}
                            None => fault(&format!("unknown command {word}")),
                        }
                    }
                }
            }
        }
    }
    assert!(all > 40, "only {all} commands found");
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn every_cargo_alias_exists() {
    let config = fs::read_to_string(root().join(".cargo/config.toml")).unwrap();
    let config: toml::Table = config.parse().unwrap();
    let aliases = config["alias"].as_table().unwrap();
    let cargos_own = ["bench", "build", "clippy", "doc", "fmt", "install", "run", "rustc", "test", "tree"];
    let mut faults = Vec::new();
    for document in for_users().iter().chain(&beside()) {
        let inline = inline_code(document)
            .into_iter()
            .flat_map(|(line, code)| simple_commands(&code).into_iter().map(move |words| (line, words)));
        for (line, words) in inline.chain(commands(document)) {
            let mut words = words.iter().map(String::as_str).skip_while(|word| word.contains('='));
            if let (Some("cargo"), Some(name)) = (words.next(), words.next())
                && !cargos_own.contains(&name)
                && !aliases.contains_key(name)
            {
                faults.push(format!("{}:{line}: there is no cargo {name}", document.path.display()));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn lines_are_split_like_in_a_shell() {
    let taken = simple_commands("A=1 growbot plan --to '1, 2' > x.json  # and so on | not\nfoo\\ bar | growbot x && b");
    let expected: [&[&str]; 4] = [&["A=1", "growbot", "plan", "--to", "1, 2"], &["foo bar"], &["growbot", "x"], &["b"]];
    assert_eq!(taken, expected);
    assert_eq!(growbot(&taken[0]).unwrap()[1], "plan");
}

#[test]
fn invalid_commands_are_reported() {
    assert!(wrong(&["growbot", "plan", "--to", "1,2,3,4,5"]).is_none());
    assert!(wrong(&["growbot", "grow", "--help"]).is_none());
    assert!(wrong(&["growbot", "plan", "--two", "1,2,3,4,5"]).is_some());
    assert!(wrong(&["growbot", "fly"]).is_some());
}
