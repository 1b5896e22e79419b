//! Line breaks in texts for users.

use textwrap::core::Word;
use textwrap::{Options, WordSeparator, WordSplitter, WrapAlgorithm, fill};

/// Columns of a terminal.
pub const TERMINAL_WIDTH: usize = 80;
/// Maximum length of a part in backquotes that is not wrapped, bytes.
const LONGEST_QUOTE: usize = 40;

/// Wraps a text between words into lines of at most `width` columns. The first line begins with `head`, and all others
/// with `indent`. A part in backquotes is for copying, so it stays in one line, unless it is long.
pub fn wrap(text: &str, width: usize, head: &str, indent: &str) -> String {
    let options = Options::new(width)
        .initial_indent(head)
        .subsequent_indent(indent)
        .break_words(false)
        .word_separator(WordSeparator::Custom(words))
        .word_splitter(WordSplitter::NoHyphenation)
        .wrap_algorithm(WrapAlgorithm::FirstFit);
    let words: Vec<&str> = text.split_ascii_whitespace().collect();
    fill(&words.join(" "), options).trim_end().to_owned() + "\n"
}

/// Splits a line into words. A part in backquotes counts as one word, unless it is long.
fn words(line: &str) -> Box<dyn Iterator<Item = Word<'_>> + '_> {
    let (mut words, mut start, mut end, mut is_quoted) = (Vec::new(), 0, 0, false);
    for word in line.split_inclusive(' ') {
        if end > start && !(is_quoted && end - start + word.trim_end().len() <= LONGEST_QUOTE) {
            words.push(Word::from(&line[start..end]));
            start = end;
        }
        end += word.len();
        is_quoted ^= word.matches('`').count() % 2 == 1;
    }
    words.push(Word::from(&line[start..]));
    Box::new(words.into_iter())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lines_are_wrapped_between_words() {
        let text = wrap(&"eleven  long ".repeat(20), 80, "  path type ", "            ");
        assert!(text.lines().count() == 4 && text.lines().all(|line| line.len() <= 80), "{text}");
        assert!(
            text.lines()
                .skip(1)
                .all(|line| line.starts_with("            eleven") || line.starts_with("            long"))
        );
        assert_eq!(wrap("", 80, "", "  "), "\n");
        assert_eq!(wrap("", 80, "# ", "# "), "#\n");
    }

    #[test]
    fn quotes_are_words() {
        let split = |line| words(line).map(|word| word.word.to_owned()).collect::<Vec<_>>();
        assert_eq!(split("a ` b"), ["a", "` b"]);
        assert_eq!(split("run `growbot stop --port sim` now"), ["run", "`growbot stop --port sim`", "now"]);
        assert!(split(&format!("`{}`", "word ".repeat(20))).len() > 2);
    }
}
