//! Preprocessor for pictures: a line `![caption](PATH.svg)` becomes a figure with its caption below. The SVG text of a
//! drawing from `pictures/` is inserted into the page, so that it has the page's colours, light or dark. A drawing of
//! growbot in `figures/` stays an image.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use mdbook_preprocessor::book::Book;
use mdbook_preprocessor::{Preprocessor, PreprocessorContext};

use crate::growbot::in_each_chapter;

/// Preprocessor of mdBook that replaces lines with a picture by figures with a caption.
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

/// Returns the text of an SVG file without empty lines, because an empty line ends a block of HTML in Markdown.
fn drawing(file: &Path) -> Result<String> {
    let svg = fs::read_to_string(file).with_context(|| format!("{} is not there", file.display()))?;
    Ok(svg.lines().filter(|line| !line.trim().is_empty()).collect::<Vec<_>>().join("\n"))
}

/// Returns the caption and the path of the picture in a line. `None` if the line is not an SVG picture.
fn picture(line: &str) -> Option<(&str, &str)> {
    let (caption, path) = line.strip_prefix("![")?.strip_suffix(')')?.split_once("](")?;
    path.ends_with(".svg").then_some((caption, path))
}
