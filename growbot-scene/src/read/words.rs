//! Texts, split into lines, words and coordinates.

use nalgebra::Vector3;

/// Returns the lines of a text, each split into words. Bytes that are not UTF-8 may occur in names and comments.
pub(super) fn lines(bytes: &[u8]) -> impl Iterator<Item = Vec<&str>> {
    bytes.split(|byte| *byte == b'\n').map(words)
}

/// Splits a line into words. A word that is not UTF-8, and so not a number, is replaced.
fn words(line: &[u8]) -> Vec<&str> {
    let words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
    words.map(|word| std::str::from_utf8(word).unwrap_or("(no UTF-8)")).collect()
}

/// Parses the first three words as coordinates. Returns `None` if they are not numbers.
pub(super) fn parse_point(words: &[&str]) -> Option<Vector3<f64>> {
    let [x, y, z, ..] = words else { return None };
    Some(Vector3::new(x.parse().ok()?, y.parse().ok()?, z.parse().ok()?))
}
