//! Preprocessor of links between documents: a link to a document such as SAFETY.md leads to the chapter that includes
//! the document.
//!
//! Chapters and included documents contain links to files of the repository, so that the links work there. In the book,
//! a link to a document that a chapter includes leads to that chapter, and a link to a file outside the book is
//! replaced by its text. The name of a document in the text of an included document becomes a link.

use std::path::{Path, PathBuf};

use anyhow::Result;
use mdbook_preprocessor::book::{Book, BookItem, Chapter};
use mdbook_preprocessor::{Preprocessor, PreprocessorContext};
use pulldown_cmark::{Event, Options, Parser, Tag, TagEnd};

use crate::links::normal;

/// Documents of the repository, and the chapters that include them.
const CHAPTERS: [(&str, &str); 6] = [
    ("ARCHITECTURE.md", "architecture.md"),
    ("PROTOCOL.md", "link.md"),
    ("SAFETY.md", "safety.md"),
    ("WIRING.md", "wiring.md"),
    ("docs/decisions/README.md", DECISIONS),
    ("docs/measurements.md", "measurements.md"),
];
/// Chapter that includes all documents about decisions, each below its title.
const DECISIONS: &str = "decisions.md";
/// Directory of the chapters' files, relative to the repository.
const SOURCES: &str = "book/src";

/// Preprocessor of mdBook that redirects links to documents to the chapters that include them, and adds links to names
/// of documents.
pub struct Mentions;

impl Preprocessor for Mentions {
    fn name(&self) -> &str {
        "mentions"
    }

    fn run(&self, _: &PreprocessorContext, mut book: Book) -> Result<Book> {
        book.for_each_mut(|item| {
            if let BookItem::Chapter(chapter) = item {
                let place = Place::of(chapter);
                chapter.content = with_links(&chapter.content, &place);
            }
        });
        Ok(book)
    }
}

/// Location of a chapter, and the document that it includes.
struct Place {
    /// Path of the chapter's file below [`SOURCES`].
    chapter: PathBuf,
    /// Document of the repository that the chapter includes. `None` if it includes none.
    document: Option<&'static str>,
}

impl Place {
    fn of(chapter: &Chapter) -> Self {
        let chapter = chapter.path.clone().unwrap_or_default();
        let document = CHAPTERS.iter().find(|(_, own)| Path::new(own) == chapter).map(|(document, _)| *document);
        Self { chapter, document }
    }

    /// Converts the target of a link in this chapter to its target in the book. `None` if the file is outside the book,
    /// so that the link is replaced by its text.
    fn link(&self, target: &str) -> Option<String> {
        let (path, anchor) = target.split_once('#').map_or((target, ""), |(path, anchor)| (path, anchor));
        if path.is_empty() || path.contains(':') {
            return Some(target.to_owned());
        }
        let own = self.document.map_or_else(|| Path::new(SOURCES).join(&self.chapter), PathBuf::from);
        let file = normal(&own.parent().unwrap_or(Path::new("")).join(path));
        let file = file.to_str()?;
        let chapter = CHAPTERS.iter().find(|(document, _)| *document == file).map(|(_, chapter)| *chapter);
        let (chapter, anchor) = match (chapter, decision(file)) {
            (Some(chapter), _) => (chapter, anchor),
            (None, Some(title)) => (DECISIONS, title),
            (None, None) => (file.strip_prefix(SOURCES)?.strip_prefix('/')?, anchor),
        };
        let up = "../".repeat(self.chapter.components().count().saturating_sub(1));
        let hash = if anchor.is_empty() { "" } else { "#" };
        Some(format!("{up}{chapter}{hash}{anchor}"))
    }
}

/// Returns the anchor of a decision in [`DECISIONS`]: the title in the name of its file, `NUMBER-TITLE.md`. `None` for
/// other files.
fn decision(file: &str) -> Option<&str> {
    let name = file.strip_prefix("docs/decisions/")?.strip_suffix(".md")?;
    name.split_once('-').filter(|(number, _)| number.parse::<u16>().is_ok()).map(|(_, title)| title)
}

/// Returns the text of a chapter with its links converted. In an included document, names of other documents become
/// links unless they are in code, in a link or in a heading.
fn with_links(chapter: &str, place: &Place) -> String {
    let mut text = String::with_capacity(chapter.len());
    let (mut copied, mut within) = (0, 0);
    for (event, range) in Parser::new_ext(chapter, Options::ENABLE_TABLES).into_offset_iter() {
        match event {
            Event::Start(Tag::Link { dest_url, .. }) => {
                within += 1;
                // `[words](target)`, with the target at its end.
                let whole = &chapter[range.clone()];
                let Some(words) = whole.strip_suffix(&format!("]({dest_url})")) else { continue };
                text += &chapter[copied..range.start];
                text += &match place.link(&dest_url) {
                    Some(link) => format!("{words}]({link})"),
                    None => words[1..].to_owned(),
                };
                copied = range.end;
            }
            Event::Start(Tag::CodeBlock(_) | Tag::Heading { .. }) => within += 1,
            Event::End(TagEnd::CodeBlock | TagEnd::Link | TagEnd::Heading(_)) => within -= 1,
            Event::Text(_) if within == 0 && place.document.is_some() => {
                text += &chapter[copied..range.start];
                text += &with_mentions(&chapter[range.clone()], place);
                copied = range.end;
            }
            _ => {}
        }
    }
    text + &chapter[copied..]
}

/// Returns the text with links in place of the names of other documents.
fn with_mentions(text: &str, place: &Place) -> String {
    let others = CHAPTERS.iter().filter(|(document, _)| place.document != Some(document));
    others
        .fold(text.to_owned(), |text, (document, chapter)| text.replace(document, &format!("[{document}]({chapter})")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(chapter: &str, document: Option<&'static str>) -> Place {
        Place { chapter: chapter.into(), document }
    }

    #[test]
    fn links_lead_to_chapters() {
        let maths = place("maths/space.md", None);
        assert_eq!(maths.link("step.md#a-step").unwrap(), "../maths/step.md#a-step");
        assert_eq!(maths.link("../../../SAFETY.md#faults").unwrap(), "../safety.md#faults");
        assert_eq!(maths.link("#here").unwrap(), "#here");
        assert_eq!(maths.link("https://doi.org/10").unwrap(), "https://doi.org/10");
        let measured = place("measurements.md", Some("docs/measurements.md"));
        assert_eq!(measured.link("decisions/0040-stack.md").unwrap(), "decisions.md#stack");
        assert_eq!(measured.link("../book/src/maths/sag.md").unwrap(), "maths/sag.md");
        assert_eq!(measured.link("releasing.md"), None);
    }

    #[test]
    fn file_names_become_links_and_links_outside_the_book_become_text() {
        let place = place("architecture.md", Some("ARCHITECTURE.md"));
        let text = "See SAFETY.md, `SAFETY.md`, [the link](PROTOCOL.md) and [releasing](docs/releasing.md).";
        let book = "See [SAFETY.md](safety.md), `SAFETY.md`, [the link](link.md) and releasing.";
        assert_eq!(with_links(text, &place), book);
    }
}
