//! Sanitizing of text for a terminal. Names, outcomes and messages come from files, boards and other programs, so their
//! control characters might move the cursor, change colours or reverse the direction of writing.

use std::borrow::Cow;

use serde::Serialize;

/// Reports whether this is a control character for a terminal: C0, DEL, C1, or a character that separates lines or
/// changes the direction of writing.
pub fn is_control(letter: char) -> bool {
    letter.is_control()
        || matches!(letter, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Returns the text with a space in place of each control character ([`is_control`]) except newlines.
pub fn lines(text: &str) -> Cow<'_, str> {
    without(text, |letter| letter != '\n' && is_control(letter))
}

/// Returns the text in one line, with a space in place of each control character ([`is_control`]).
pub fn one_line(text: &str) -> Cow<'_, str> {
    without(text, is_control)
}

/// Returns a value as one line of JSON that ends with a newline. Control characters ([`is_control`]) are escaped as
/// `\uXXXX`, so that a reader gets the exact text.
pub fn json_line(value: &impl Serialize) -> String {
    // Serialization fails only for maps whose keys are not strings, which do not occur. Control characters occur only
    // in strings.
    let plain = serde_json::to_string(value).unwrap_or_default();
    let mut line = String::with_capacity(plain.len() + 1);
    for letter in plain.chars() {
        if is_control(letter) {
            // All of them are below 0x10000.
            line += &format!("\\u{:04x}", u32::from(letter));
        } else {
            line.push(letter);
        }
    }
    line + "\n"
}

fn without(text: &str, goes: impl Fn(char) -> bool) -> Cow<'_, str> {
    if text.contains(&goes) { text.replace(goes, " ").into() } else { text.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terminal_control_characters_are_removed() {
        let hostile = "a\u{1b}[31mb\u{7}\u{7f}\u{9b}2J\u{202e}c\u{2066}d\u{200f}e\rf\tg\nh";
        assert_eq!(lines(hostile), "a [31mb   2J c d e f g\nh");
        assert_eq!(one_line(hostile), "a [31mb   2J c d e f g h");
        let plain = "73 \u{b0} \u{b7} \u{2026} \u{645}\u{631}\u{62d}\u{628}\u{627}";
        assert!(matches!(one_line(plain), Cow::Borrowed(same) if same == plain));
        assert_eq!(
            (0..=0x10_ffff_u32).filter_map(char::from_u32).filter(|letter| is_control(*letter)).count(),
            65 + 3 + 7 + 4
        );
    }
    #[test]
    fn json_escapes_control_characters_and_round_trips() {
        let hostile: String =
            (0..=0x10_ffff_u32).filter_map(char::from_u32).filter(|letter| is_control(*letter)).collect();
        let text = format!("\"\\{hostile}73 \u{b0}");
        let line = json_line(&serde_json::json!({ "id": text, &text: [1.5] }));
        assert_eq!(lines(&line), line);
        assert!(line.ends_with("}\n") && line.matches('\n').count() == 1 && line.contains("\\u202e\\u2066"), "{line}");
        let read: serde_json::Value = serde_json::from_str(&line).unwrap();
        assert_eq!((&read["id"], &read[&text]), (&text.clone().into(), &serde_json::json!([1.5])));
    }
}
