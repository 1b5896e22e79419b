//! Mentions: SAFETY.md and its like, named in a text that the book includes, become links to their chapters.

use anyhow::Result;
use mdbook_preprocessor::book::{Book, BookItem};
use mdbook_preprocessor::{Preprocessor, PreprocessorContext};
use pulldown_cmark::{Event, Options, Parser, Tag, TagEnd};

/// The documents, and the chapters that include them.
const CHAPTERS: [(&str, &str); 5] = [
    ("CHANGELOG.md", "changes.md"),
    ("DESIGN.md", "design.md"),
    ("PROTOCOL.md", "link.md"),
    ("SAFETY.md", "safety.md"),
    ("WIRING.md", "wiring.md"),
];

/// Puts links for mentions.
pub struct Mentions;

impl Preprocessor for Mentions {
    fn name(&self) -> &str {
        "mentions"
    }

    fn run(&self, _: &PreprocessorContext, mut book: Book) -> Result<Book> {
        book.for_each_mut(|item| {
            if let BookItem::Chapter(chapter) = item {
                // Chapters that include a document lie beside each other at the top.
                let own = chapter.path.as_ref().and_then(|path| path.to_str()).unwrap_or_default().to_owned();
                if CHAPTERS.iter().any(|(_, chapter)| *chapter == own) {
                    chapter.content = with_links(&chapter.content, &own);
                }
            }
        });
        Ok(book)
    }
}

/// The chapter of this path with links, but to itself, where it is neither code nor a link or heading.
fn with_links(chapter: &str, own: &str) -> String {
    let mut text = String::with_capacity(chapter.len());
    let (mut copied, mut within) = (0, 0);
    for (event, place) in Parser::new_ext(chapter, Options::ENABLE_TABLES).into_offset_iter() {
        match event {
            Event::Start(Tag::CodeBlock(_) | Tag::Link { .. } | Tag::Heading { .. }) => within += 1,
            Event::End(TagEnd::CodeBlock | TagEnd::Link | TagEnd::Heading(_)) => within -= 1,
            Event::Text(_) if within == 0 => {
                let mut said = chapter[place.clone()].to_owned();
                for (document, path) in CHAPTERS.iter().filter(|(_, path)| *path != own) {
                    said = said.replace(document, &format!("[{document}]({path})"));
                }
                text += &chapter[copied..place.start];
                text += &said;
                copied = place.end;
            }
            _ => {}
        }
    }
    text + &chapter[copied..]
}
