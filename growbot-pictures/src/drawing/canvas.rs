//! A drawing in SVG, with its style.

use std::fmt::{Display, Write};

/// CSS rules of drawings. They apply only inside drawings, so they do not change a page around a drawing.
/// [`super::png`] contains the font Inter.
const STYLE: &str = ".gc text{font-family:Inter,system-ui,'Segoe UI','DejaVu \
                     Sans',sans-serif;font-size:13px;fill:#1c2430}\
.gc .title{font-size:18px;font-weight:600}.gc .head{font-size:14px;font-weight:600}.gc \
.note{font-size:12px;fill:#4a5565}\
.gc .mid{text-anchor:middle}.gc .end{text-anchor:end}\
.gc .axis{stroke:#1c2430;stroke-width:1;fill:none}.gc .grid{stroke:#1c2430;stroke-opacity:.12;fill:none}";

/// An unfinished SVG drawing.
pub struct Canvas(String);

impl Canvas {
    /// Returns an empty drawing of this size. The title is for screen readers.
    pub fn new(width: f64, height: f64, title: &str) -> Self {
        Self(format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"gc\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" \
             height=\"{height}\" role=\"img\">\n<title>{title}</title>\n<style>{STYLE}</style>\n\
             <rect width=\"{width}\" height=\"{height}\" rx=\"8\" fill=\"#fff\"/>\n"
        ))
    }

    /// Returns the finished drawing as SVG.
    pub fn finish(mut self) -> String {
        self.0.push_str("</svg>\n");
        self.0
    }

    /// Adds an SVG element. It cannot fail, because it writes to a String.
    pub fn add(&mut self, element: impl Display) {
        let _ = writeln!(self.0, "{element}");
    }

    /// Adds a text at a position, with these CSS classes.
    pub fn text(&mut self, x: f64, y: f64, class: &str, text: impl Display) {
        self.add(format_args!("<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\">{text}</text>"));
    }

    /// Adds a line through points. `style` consists of SVG attributes.
    pub fn line(&mut self, points: impl IntoIterator<Item = (f64, f64)>, style: impl Display) {
        let mut path = String::new();
        for (index, (x, y)) in points.into_iter().enumerate() {
            let _ = write!(path, "{}{x:.1} {y:.1}", if index == 0 { 'M' } else { 'L' });
        }
        self.add(format_args!("<path fill=\"none\" d=\"{path}\" {style}/>"));
    }
}

/// Escapes a text for SVG and HTML, and replaces characters that neither can contain by spaces.
pub fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '"' => escaped += "&quot;",
            letter if letter.is_control() || matches!(letter, '\u{fffe}' | '\u{ffff}') => escaped.push(' '),
            letter => escaped.push(letter),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_escaped() {
        assert_eq!(escape("</script><b a=\"&\">"), "&lt;/script&gt;&lt;b a=&quot;&amp;&quot;&gt;");
        assert_eq!(escape("a\u{1}b\nc\u{ffff}"), "a b c ");
    }
}
