//! Pictures: a line `![caption](PATH.svg)` becomes a figure with its caption below. A drawing from `pictures/` becomes
//! a part of the page, so it takes the page's colours, light or dark. A drawing of growbot in `figures/` stays an
//! image.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use mdbook_preprocessor::book::Book;
use mdbook_preprocessor::{Preprocessor, PreprocessorContext};

use crate::growbot::in_each_chapter;

/// Replaces lines of pictures by figures.
pub struct Pictures;

impl Preprocessor for Pictures {
    fn name(&self) -> &str {
        "pictures"
    }

    fn run(&self, context: &PreprocessorContext, mut book: Book) -> Result<Book> {
        let sources = context.root.join(&context.config.book.src);
        in_each_chapter(&mut book, |chapter| {
            let mut text = String::with_capacity(chapter.len());
            for line in chapter.lines() {
                match picture(line) {
                    None => text += line,
                    Some((caption, path)) => {
                        let shown = match path.trim_start_matches("../") {
                            path if path.starts_with("pictures/") => drawing(&sources.join(path))?,
                            _ => format!("<img src=\"{path}\" alt=\"{}\">", caption.replace('"', "&quot;")),
                        };
                        text += &format!("<figure>\n{shown}\n<figcaption>\n\n{caption}\n\n</figcaption>\n</figure>");
                    }
                }
                text.push('\n');
            }
            Ok(text)
        })?;
        Ok(book)
    }
}

/// Returns the drawing in a file, without empty lines, because an empty line ends a block of HTML in Markdown.
fn drawing(file: &Path) -> Result<String> {
    let svg = fs::read_to_string(file).with_context(|| format!("{} is not there", file.display()))?;
    Ok(svg.lines().filter(|line| !line.trim().is_empty()).collect::<Vec<_>>().join("\n"))
}

/// Returns the caption and the path of a line that is a picture.
fn picture(line: &str) -> Option<(&str, &str)> {
    let (caption, path) = line.strip_prefix("![")?.strip_suffix(')')?.split_once("](")?;
    path.ends_with(".svg").then_some((caption, path))
}
