//! The documents for users, and their code blocks.
//!
//! The language of a block determines how the block is tested. Words after the language name what the block needs
//! besides growbot.
//!
//! | block | test |
//! |---|---|
//! | `console` | `$ ` lines are run, and their output is compared with the lines that follow |
//! | `sh` | all lines are run and must succeed |
//! | `console,robot`, `sh,build` and the like | growbot's commands are parsed as on the command line, but not run |
//! | `toml` | parsed as a part of a robot file |
//! | `rust` | compiled and run as a documentation test |
//! | `text` | not tested |
//! | `nginx` | used by tests/viewer/proxy.js |

use std::fs;
use std::path::{Path, PathBuf};

use pulldown_cmark::{CodeBlockKind, Event, Options, Parser, Tag, TagEnd};

/// A Markdown document of the repository.
pub struct Document {
    /// Path from the repository's root.
    pub path: PathBuf,
    /// Content of the document.
    pub text: String,
}

/// A code block of a document.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// Line of the document at which the block begins.
    pub line: usize,
    /// Language of the block. `None` if the block is indented.
    pub language: Option<String>,
    /// Words after the language: what the block needs besides growbot.
    pub needs: Vec<String>,
    /// Content of the block.
    pub text: String,
}

/// Returns the root of the repository.
pub fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

/// Returns README.md and the chapters of the book.
pub fn for_users() -> Vec<Document> {
    let mut paths = vec![PathBuf::from("README.md")];
    list(Path::new("book/src"), &mut paths);
    paths.sort();
    paths.into_iter().map(read).collect()
}

/// Returns the documents in the root directory of the repository and below `docs/`.
pub fn beside() -> Vec<Document> {
    let mut paths = Vec::new();
    for entry in fs::read_dir(root()).unwrap() {
        let path = PathBuf::from(entry.unwrap().file_name());
        if path.extension().is_some_and(|extension| extension == "md") && path != Path::new("README.md") {
            paths.push(path);
        }
    }
    list(Path::new("docs"), &mut paths);
    paths.sort();
    paths.into_iter().map(read).collect()
}

fn read(path: PathBuf) -> Document {
    let text = fs::read_to_string(root().join(&path)).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    Document { path, text }
}

fn list(directory: &Path, paths: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(root().join(directory)).unwrap() {
        let entry = entry.unwrap();
        let path = directory.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            list(&path, paths);
        } else if path.extension().is_some_and(|extension| extension == "md") {
            paths.push(path);
        }
    }
}

impl Document {
    /// Returns the Markdown events of the document, each with the number of its line.
    pub fn events(&self) -> impl Iterator<Item = (Event<'_>, usize)> {
        let line = |place: usize| self.text[..place].lines().count() + 1;
        Parser::new_ext(&self.text, Options::ENABLE_TABLES)
            .into_offset_iter()
            .map(move |(event, range)| (event, line(range.start)))
    }

    /// Returns the code blocks of the document.
    pub fn blocks(&self) -> Vec<Block> {
        let mut blocks = Vec::new();
        let mut open: Option<Block> = None;
        for (event, line) in self.events() {
            match (event, &mut open) {
                (Event::Start(Tag::CodeBlock(kind)), _) => {
                    let info = match kind {
                        CodeBlockKind::Indented => None,
                        CodeBlockKind::Fenced(info) => Some(info.to_string()),
                    };
                    let mut words = info.as_deref().unwrap_or_default().split([',', ' ']).map(str::to_owned);
                    let language = words.next().filter(|_| info.is_some());
                    open = Some(Block { line, language, needs: words.collect(), text: String::new() });
                }
                (Event::Text(text), Some(block)) => block.text += &text,
                (Event::End(TagEnd::CodeBlock), _) => blocks.extend(open.take()),
                _ => {}
            }
        }
        blocks
    }

    /// Returns the targets of links and pictures, each with the number of its line.
    pub fn links(&self) -> Vec<(usize, String)> {
        let link = |(event, line)| match event {
            Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => {
                Some((line, dest_url.to_string()))
            }
            _ => None,
        };
        self.events().filter_map(link).collect()
    }
}

impl Block {
    /// Returns true if the block has this language.
    pub fn is(&self, language: &str) -> bool {
        self.language.as_deref() == Some(language)
    }

    /// Returns the commands of the block. In a `console` they are the lines after `$ `, continued by lines after `> `.
    /// In `sh` they are all lines.
    pub fn commands(&self) -> Vec<String> {
        if self.is("console") {
            return self.steps().into_iter().map(|step| step.command).collect();
        }
        if self.is("sh") {
            return self.text.lines().filter(|line| !line.trim().is_empty()).map(str::to_owned).collect();
        }
        Vec::new()
    }

    /// Returns the steps of a `console` block: each command with its expected output. Lines before the first command
    /// are ignored.
    pub fn steps(&self) -> Vec<Step> {
        let mut steps: Vec<Step> = Vec::new();
        for (index, line) in self.text.lines().enumerate() {
            if let Some(command) = line.strip_prefix("$ ") {
                steps.push(Step { line: self.line + 1 + index, command: command.to_owned(), prints: Vec::new() });
            } else if let Some(step) = steps.last_mut() {
                match line.strip_prefix("> ") {
                    Some(more) if step.prints.is_empty() => step.command += &format!("\n{more}"),
                    _ => step.prints.push(line.to_owned()),
                }
            }
        }
        steps
    }
}

/// A command and its expected output.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Line of the document that contains the command.
    pub line: usize,
    /// Text of the command.
    pub command: String,
    /// Lines that the command should print.
    pub prints: Vec<String>,
}
