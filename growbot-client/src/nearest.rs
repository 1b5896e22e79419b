//! Which known name a person may have meant.

/// The known name nearest to a word: the one that the fewest single-letter edits turn it into, if they are few enough
/// for a slip (a third of the letters or two, but not all); else one that begins or ends with the word.
///
/// ```
/// use growbot_client::nearest::nearest;
/// assert_eq!(nearest("growbot-a", ["growbot-b", "growbot-a1", "growbot-a"]), Some("growbot-a"));
/// assert_eq!(nearest("heigth_mm", ["width_mm", "height_mm"]), Some("height_mm"));
/// assert_eq!(nearest("a8", ["growbot-a", "growbot-a8"]), Some("growbot-a8"));
/// assert_eq!(nearest("elephant", ["growbot-a"]), None);
/// ```
#[must_use]
pub fn nearest<'a>(word: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let letters = word.chars().count();
    let slip = (letters / 3).max(2).min(letters.saturating_sub(1));
    let mut best: Option<((bool, usize), &str)> = None;
    for name in known {
        let edits = edits(word, name);
        let part = !word.is_empty() && (name.starts_with(word) || name.ends_with(word));
        let rank = (edits > slip, edits);
        if (edits <= slip || part) && best.is_none_or(|(best, _)| rank < best) {
            best = Some((rank, name));
        }
    }
    best.map(|(_, name)| name)
}

/// Insertions, deletions and replacements that turn one word into another (Levenshtein's distance). Names are short:
/// of longer words only the first 64 letters count.
fn edits(from: &str, to: &str) -> usize {
    let to: Vec<char> = to.chars().take(64).collect();
    let mut row: Vec<usize> = (0..=to.len()).collect();
    for (i, a) in from.chars().take(64).enumerate() {
        let mut diagonal = i;
        let mut left = i + 1;
        let mut next = vec![left];
        for (b, above) in to.iter().zip(row.iter().skip(1)) {
            left = (diagonal + usize::from(a != *b)).min(left + 1).min(above + 1);
            diagonal = *above;
            next.push(left);
        }
        row = next;
    }
    row.last().copied().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edits_are_counted() {
        assert_eq!(edits("", ""), 0);
        assert_eq!(edits("", "abc"), 3);
        assert_eq!(edits("abc", ""), 3);
        assert_eq!(edits("kitten", "sitting"), 3);
        assert_eq!(edits("heigth", "height"), 2);
    }
}
