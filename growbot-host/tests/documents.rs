//! Checks README.md and the book: runs their commands and compares the output, reads their robot files, and follows
//! their links and file names. (`src/cli/tests.rs` parses the commands that cannot be run here.)

mod blocks;
mod transcript;

use std::path::{Component, Path};

use blocks::{Document, beside, for_users, root};
use growbot_plan::robot_file;
use growbot_serve::settings;
use pulldown_cmark::Event;
use transcript::{agree, differences, differences_in, runs};

/// Words after the language of a code block that this test does not run. Each word names a need of the block.
const NEEDS: [&str; 6] = ["robot", "emulator", "build", "install", "terminal", "long"];

fn assert_nothing_wrong(wrong: &[String]) {
    assert!(wrong.is_empty(), "{} differences:\n{}", wrong.len(), wrong.join("\n"));
}

/// Returns the name of a document's test: `maths_two_planes` for `book/src/maths/two-planes.md`.
fn test_of(document: &Document) -> String {
    let path = document.path.strip_prefix("book/src").unwrap_or(&document.path).with_extension("");
    path.to_str().unwrap().to_lowercase().replace(['/', '-'], "_")
}

/// Defines a test for each of these documents, which runs the commands of the document in a directory of its own. A
/// single test is run by `cargo test -p growbot-host --test it documents::chapters::see_it`.
macro_rules! chapters {
    ($($test:ident),*) => {
        mod chapters {
            $(
                #[test]
                fn $test() {
                    let document = super::for_users().into_iter().find(|one| super::test_of(one) == stringify!($test));
                    super::assert_nothing_wrong(&super::differences(&document.unwrap()));
                }
            )*
        }
        const CHAPTERS: &[&str] = &[$(stringify!($test)),*];
    };
}

chapters! {
    answers, bag_of_parts, connect, console, describe, drive, export, feedback, files, first_growth, first_start, flash,
    install, maintain, maths_clearance, maths_layers, maths_space, maths_step, maths_two_planes, obstacles, paper,
    paper_figures, pipe_rack, plan_goals, practise, readme, robot_file, scene_file, see_it, simulate, stop, survive,
    tutorial
}

#[test]
fn every_document_with_commands_has_a_test() {
    let mut names: Vec<_> = for_users().iter().filter(|document| !runs(document).is_empty()).map(test_of).collect();
    names.sort();
    assert_eq!(names, CHAPTERS);
}

/// Returns README.md, then the chapters in the order of the book.
fn in_order() -> Vec<Document> {
    let mut documents = for_users();
    let summary = documents.iter().find(|document| document.path.ends_with("SUMMARY.md")).unwrap();
    let chapters: Vec<_> = summary.links().into_iter().map(|(_, link)| Path::new("book/src").join(link)).collect();
    documents.retain(|document| document.path == Path::new("README.md") || chapters.contains(&document.path));
    documents.sort_by_key(|document| chapters.iter().position(|chapter| *chapter == document.path));
    documents
}

#[test]
fn a_new_user_can_follow_all_documents_in_one_directory() {
    let documents = in_order();
    assert_eq!(documents[0].path, Path::new("README.md"));
    assert!(documents.len() > 20, "{}", documents.len());
    let directory = tempfile::tempdir().unwrap();
    let wrong: Vec<_> = documents.iter().flat_map(|document| differences_in(document, directory.path())).collect();
    assert_nothing_wrong(&wrong);
}

#[test]
fn elided_parts_of_lines_are_ignored() {
    assert!(agree(&["a", "...", "d"], &["a", "b", "c", "d"]));
    assert!(agree(&["...", "c", "..."], &["a", "b", "c"]));
    assert!(agree(&["took [..] s, [..]."], &["took 3.2 s, really."]));
    assert!(!agree(&["a", "..."], &["b"]));
    assert!(!agree(&["...", "e"], &["a", "d"]));
    assert!(!agree(&["a"], &["a", "b"]));
    assert!(!agree(&["took [..] s"], &["took 3.2 s, really"]));
    assert!(!agree(&[], &["a"]));
}

#[test]
fn a_wrong_transcript_is_reported() {
    let transcript = |text: &str| Document { path: "made-up.md".into(), text: format!("```console\n{text}\n```\n") };
    assert_eq!(differences(&transcript("$ growbot rmin\n...\n  by its layers       60.20 mm")).len(), 0);
    assert_eq!(differences(&transcript("$ growbot rmin\n...\n  by its layers       60.21 mm")).len(), 1);
    assert_eq!(differences(&transcript("$ growbot rmin --robot nobody\n...")).len(), 1);
    assert_eq!(differences(&transcript("$ growbot rmin --robot nobody\n...\n$ echo $?\n2")).len(), 0);
    assert_eq!(differences(&transcript("$ growbot rmin --robot nobody\n...\n$ echo $?\n1")).len(), 1);
    let script = Document { path: "made-up.md".into(), text: "```sh\ngrowbot rmin --robot nobody\n```\n".to_owned() };
    assert_eq!(differences(&script).len(), 1);
}

#[test]
fn every_block_has_a_known_language_and_known_needs() {
    let mut wrong = Vec::new();
    for document in for_users() {
        for block in document.blocks() {
            let known = match block.language.as_deref() {
                Some("console" | "sh") => block.needs.iter().all(|need| NEEDS.contains(&need.as_str())),
                Some("toml" | "rust" | "text" | "python" | "nginx") => block.needs.is_empty(),
                _ => false,
            };
            if !known || (block.is("console") && block.steps().is_empty()) {
                wrong.push(format!(
                    "{}:{}: {:?} {:?}",
                    document.path.display(),
                    block.line,
                    block.language,
                    block.needs
                ));
            }
            // Documentation tests compile this chapter alone (src/lib.rs).
            if block.is("rust") && !document.path.ends_with("libraries.md") {
                wrong.push(format!("{}:{}: nothing compiles it", document.path.display(), block.line));
            }
        }
    }
    assert_nothing_wrong(&wrong);
}

/// Copies the values of the table `from` into the table `into`, also those of nested tables.
fn merge(into: &mut toml::Table, from: toml::Table) {
    for (key, value) in from {
        match (into.get_mut(&key), value) {
            (Some(toml::Value::Table(section)), toml::Value::Table(fields)) => merge(section, fields),
            (_, value) => drop(into.insert(key, value)),
        }
    }
}

#[test]
fn every_toml_block_is_valid_in_a_robot_file_or_settings() {
    let (robot_a, _) = robot_file::text_of("growbot-a".as_ref()).unwrap();
    let mut read = 0;
    for document in for_users() {
        for block in document.blocks().iter().filter(|block| block.is("toml")) {
            let place = format!("{}:{}", document.path.display(), block.line);
            if ["[robots.", "[serve.", "[serve]"].iter().any(|table| block.text.contains(table)) {
                let (robots, serve) = settings::parse_service(&block.text, &place).unwrap();
                let is_read = robots.len() > 1
                    || serve.notify.webhook.is_some()
                    || !serve.origins.is_empty()
                    || serve.cameras.len() > 1;
                assert!(is_read, "{place}");
                continue;
            }
            let mut whole: toml::Table = robot_a.parse().unwrap();
            merge(&mut whole, block.text.parse().unwrap_or_else(|error| panic!("{place}: {error}")));
            robot_file::parse(&toml::to_string(&whole).unwrap(), &place).unwrap();
            read += 1;
        }
    }
    assert!(read > 0);
}

#[test]
fn every_link_target_exists() {
    let mut wrong = Vec::new();
    let chapters = for_users();
    for document in chapters.iter().chain(&beside()) {
        let directory = root().join(&document.path).parent().unwrap().to_owned();
        for (line, link) in document.links() {
            let path = link.split('#').next().unwrap_or_default();
            let elsewhere = ["http:", "https:", "mailto:"].iter().any(|scheme| link.starts_with(scheme));
            // Figures are drawn when the book is built, and the build checks them.
            if elsewhere || path.is_empty() || path.starts_with("figures/") || path.starts_with("../figures/") {
                continue;
            }
            if !directory.join(path).exists() {
                wrong.push(format!("{}:{line}: {link}", document.path.display()));
            }
        }
    }
    let summary = chapters.iter().find(|document| document.path.ends_with("SUMMARY.md")).unwrap();
    let listed: Vec<_> = summary.links().into_iter().map(|(_, link)| root().join("book/src").join(link)).collect();
    for chapter in chapters.iter().filter(|document| document.path.starts_with("book")) {
        if !chapter.path.ends_with("SUMMARY.md") && !listed.contains(&root().join(&chapter.path)) {
            wrong.push(format!("{} is no chapter of SUMMARY.md", chapter.path.display()));
        }
    }
    assert_nothing_wrong(&wrong);
}

/// Returns a message for each file or directory of the repository that a document names in inline code but that does
/// not exist. Names that .gitignore lists may be missing, because a build creates them. A name with a number, such as
/// `growbot-plan/1`, is the version of a format.
fn names_without_a_file(document: &Document) -> Vec<String> {
    let made: Vec<_> = include_str!("../../.gitignore").lines().filter_map(|line| line.strip_prefix('/')).collect();
    let missing = |(event, line)| {
        let Event::Code(code) = event else { return None };
        let path = Path::new(code.split(' ').next().unwrap_or_default());
        let Some(Component::Normal(first)) = path.components().next() else { return None };
        let is_format = code.rsplit_once('/').is_some_and(|(_, version)| version.parse::<u32>().is_ok());
        let made = made.iter().any(|directory| path.starts_with(directory));
        let missing = root().join(first).is_dir() && !made && !is_format && !root().join(path).exists();
        missing.then(|| format!("{}:{line}: there is no {}", document.path.display(), path.display()))
    };
    document.events().filter_map(missing).collect()
}

#[test]
fn every_named_file_exists() {
    let wrong: Vec<_> = for_users().iter().chain(&beside()).flat_map(names_without_a_file).collect();
    assert_nothing_wrong(&wrong);
    let missing =
        |text: &str| names_without_a_file(&Document { path: "made-up.md".into(), text: text.to_owned() }).len();
    assert_eq!(missing("`growbot-core/src/path.rs`, `tests/run`, `growbot-plan/1`, `book/target/word.html`"), 0);
    assert_eq!(missing("| a | `growbot-core/src/word.rs` (`Word`) |"), 1);
    assert_eq!(missing("`growbot-py/src/word.rs`, `.cargo/word.toml`"), 2);
}
