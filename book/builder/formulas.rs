//! Preprocessor for formulas: TeX between `$` or `$$` becomes MathML, which browsers render without a script or a
//! network.

use anyhow::{Result, bail};
use mdbook_preprocessor::book::Book;
use mdbook_preprocessor::{Preprocessor, PreprocessorContext};
use pulldown_cmark::{Event, Options, Parser};
use pulldown_latex::config::{DisplayMode, RenderConfig};
use pulldown_latex::{Storage, push_mathml};

use crate::growbot::in_each_chapter;

/// Preprocessor of mdBook that replaces TeX formulas by MathML.
pub struct Formulas;

impl Preprocessor for Formulas {
    fn name(&self) -> &str {
        "formulas"
    }

    fn run(&self, _: &PreprocessorContext, mut book: Book) -> Result<Book> {
        in_each_chapter(&mut book, with_mathml)?;
        Ok(book)
    }
}

/// Returns the text of a chapter with its formulas as MathML. The text is parsed as Markdown, so `$` in code is not
/// changed.
fn with_mathml(chapter: &str) -> Result<String> {
    let mut text = String::with_capacity(chapter.len());
    let mut copied = 0;
    let options = Options::ENABLE_MATH | Options::ENABLE_TABLES;
    for (event, place) in Parser::new_ext(chapter, options).into_offset_iter() {
        let (tex, mode) = match event {
            Event::InlineMath(tex) => (tex, DisplayMode::Inline),
            Event::DisplayMath(tex) => (tex, DisplayMode::Block),
            _ => continue,
        };
        text += &chapter[copied..place.start];
        text += &mathml(&tex, mode)?;
        copied = place.end;
    }
    text += &chapter[copied..];
    Ok(text)
}

fn mathml(tex: &str, display_mode: DisplayMode) -> Result<String> {
    let storage = Storage::new();
    let events: Vec<_> = pulldown_latex::Parser::new(tex, &storage).collect();
    if let Some(error) = events.iter().find_map(|event| event.as_ref().err()) {
        bail!("the formula {tex:?} cannot be read: {error}");
    }
    let mut text = String::new();
    push_mathml(&mut text, events.into_iter(), RenderConfig { display_mode, ..RenderConfig::default() })?;
    Ok(safe_in_markdown(&text))
}

/// Returns HTML on one line, in which characters between tags that have a meaning in Markdown are replaced by character
/// references.
fn safe_in_markdown(html: &str) -> String {
    let mut text = String::with_capacity(html.len());
    let mut in_tag = false;
    for c in html.chars() {
        match c {
            '<' => in_tag = true,
            '>' => in_tag = false,
            _ => {}
        }
        match c {
            '\n' => text.push(' '),
            '*' | '_' | '[' | ']' | '|' | '\\' | '`' | '~' | '$' if !in_tag => text += &format!("&#{};", u32::from(c)),
            c => text.push(c),
        }
    }
    text
}
