//! Suggestions of known names for mistyped names.

/// Returns the known name that fits a mistyped name `text` best: the name with the fewest single-letter edits, if there
/// are at most two or a third of the letters, and fewer than all letters. Otherwise a name that begins or ends with the
/// text. `None` if no name fits.
///
/// ```
/// use growbot_plan::suggest::suggest;
/// assert_eq!(suggest("growbot-a", ["growbot-b", "growbot-a1", "growbot-a"]), Some("growbot-a"));
/// assert_eq!(suggest("heigth_mm", ["width_mm", "height_mm"]), Some("height_mm"));
/// assert_eq!(suggest("a8", ["growbot-a", "growbot-a8"]), Some("growbot-a8"));
/// assert_eq!(suggest("elephant", ["growbot-a"]), None);
/// ```
pub fn suggest<'a>(text: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let letters = text.chars().count();
    let slip = (letters / 3).max(2).min(letters.saturating_sub(1));
    let mut best: Option<((bool, usize), &str)> = None;
    for name in known {
        let edits = edits(text, name);
        let part = !text.is_empty() && (name.starts_with(text) || name.ends_with(text));
        let rank = (edits > slip, edits);
        if (edits <= slip || part) && best.is_none_or(|(best, _)| rank < best) {
            best = Some((rank, name));
        }
    }
    best.map(|(_, name)| name)
}

/// Returns the best known name as the end of an error message, ` (did you mean growbot-a?)`. Empty if no name fits.
pub fn did_you_mean<'a>(text: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    suggest(text, known).map(|name| format!(" (did you mean {name}?)")).unwrap_or_default()
}

/// Returns the number of insertions, deletions and replacements that turn one name into another (Levenshtein's
/// distance). Only the first 64 letters of each name count.
fn edits(from: &str, to: &str) -> usize {
    let [from, to] = [from, to].map(|name| name.chars().take(64).collect::<String>());
    strsim::levenshtein(&from, &to)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edit_distance_is_correct() {
        assert_eq!(edits("", ""), 0);
        assert_eq!(edits("", "abc"), 3);
        assert_eq!(edits("abc", ""), 3);
        assert_eq!(edits("kitten", "sitting"), 3);
        assert_eq!(edits("heigth", "height"), 2);
    }
}
