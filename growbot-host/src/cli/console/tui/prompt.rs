//! Prompt in which the user types a command.

use crossterm::event::{KeyCode, KeyEvent, KeyModifiers};

use crate::cli::console::commands::complete;

/// Maximum length of a command, characters.
const LONGEST: usize = 200;

/// A command being typed.
#[derive(Debug, Default)]
pub struct Prompt {
    text: Vec<char>,
    cursor: usize,
    /// Position of the recalled line in the history, 1 for the latest line. It is 0 if no line was recalled.
    back: usize,
}

/// Effect of a key on the line.
#[derive(Debug, PartialEq)]
pub enum PromptAction {
    /// The user is still typing the line.
    Continue,
    /// The line is to be run.
    Done(String),
    /// The user has cancelled the line.
    Cancelled,
}

impl Prompt {
    /// Creates a prompt that starts with this text.
    pub fn new(begun: &str) -> Self {
        let mut prompt = Self::default();
        prompt.set(begun);
        prompt
    }

    fn set(&mut self, text: &str) {
        self.text = text.chars().take(LONGEST).collect();
        self.cursor = self.text.len();
    }

    /// Returns the text.
    pub fn text(&self) -> String {
        self.text.iter().collect()
    }

    /// Returns the number of characters before the cursor.
    pub fn cursor(&self) -> usize {
        self.cursor
    }

    /// Applies a key. `history` contains the earlier lines, the latest last.
    pub fn apply(&mut self, key: KeyEvent, history: &[String]) -> PromptAction {
        let plain = !key.modifiers.intersects(KeyModifiers::CONTROL | KeyModifiers::ALT);
        match key.code {
            KeyCode::Enter => return PromptAction::Done(self.text()),
            KeyCode::Esc => return PromptAction::Cancelled,
            KeyCode::Backspace if self.text.is_empty() => return PromptAction::Cancelled,
            KeyCode::Backspace if self.cursor > 0 => {
                self.cursor -= 1;
                self.text.remove(self.cursor);
            }
            KeyCode::Delete if self.cursor < self.text.len() => {
                self.text.remove(self.cursor);
            }
            KeyCode::Left => self.cursor = self.cursor.saturating_sub(1),
            KeyCode::Right => self.cursor = (self.cursor + 1).min(self.text.len()),
            KeyCode::Home => self.cursor = 0,
            KeyCode::End => self.cursor = self.text.len(),
            KeyCode::Up => self.recall(self.back + 1, history),
            KeyCode::Down => self.recall(self.back.saturating_sub(1), history),
            KeyCode::Tab => self.complete(),
            KeyCode::Char(letter) if plain && self.text.len() < LONGEST => {
                self.text.insert(self.cursor, letter);
                self.cursor += 1;
            }
            _ => {}
        }
        PromptAction::Continue
    }

    fn recall(&mut self, back: usize, history: &[String]) {
        if back == 0 {
            (self.back, self.cursor) = (0, 0);
            self.text.clear();
        } else if let Some(line) = history.iter().rev().nth(back - 1) {
            self.back = back;
            self.set(line);
        }
    }

    /// Completes the text before the cursor as far as it is unambiguous.
    fn complete(&mut self) {
        let begun: String = self.text.iter().take(self.cursor).collect();
        let (from, candidates) = complete(&begun);
        let Some(common) = candidates.into_iter().reduce(|one, other| common_beginning(&one, &other)) else { return };
        let before = begun.get(..from).unwrap_or_default();
        let completed = format!("{before}{common}");
        if completed.len() > begun.len() {
            let rest: String = self.text.iter().skip(self.cursor).collect();
            self.set(&format!("{completed}{rest}"));
            self.cursor = completed.chars().count().min(self.text.len());
        }
    }
}

fn common_beginning(one: &str, other: &str) -> String {
    one.chars().zip(other.chars()).take_while(|(a, b)| a == b).map(|(a, _)| a).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn press(prompt: &mut Prompt, keys: &[KeyCode], history: &[String]) -> PromptAction {
        keys.iter().fold(PromptAction::Continue, |_, key| prompt.apply(KeyEvent::from(*key), history))
    }

    #[test]
    fn a_line_is_edited_and_submitted() {
        let mut prompt = Prompt::new("plan ");
        let keys = ['1', 'x'].map(KeyCode::Char);
        press(&mut prompt, &keys, &[]);
        press(&mut prompt, &[KeyCode::Backspace, KeyCode::Char(','), KeyCode::Home, KeyCode::Delete], &[]);
        assert_eq!((prompt.text().as_str(), prompt.cursor()), ("lan 1,", 0));
        press(&mut prompt, &[KeyCode::Char('p'), KeyCode::End], &[]);
        assert_eq!(press(&mut prompt, &[KeyCode::Enter], &[]), PromptAction::Done("plan 1,".to_owned()));
    }

    #[test]
    fn tab_completes_the_common_prefix() {
        for (begun, completed) in [("pl", "plan "), ("s", "st"), ("grow 2", "grow 200,100,600,0,45"), ("x", "x")] {
            let mut prompt = Prompt::new(begun);
            press(&mut prompt, &[KeyCode::Tab], &[]);
            assert_eq!(prompt.text(), completed);
        }
    }

    #[test]
    fn earlier_lines_are_recalled() {
        let history = ["one".to_owned(), "two".to_owned()];
        let mut prompt = Prompt::new("");
        for (key, text) in [
            (KeyCode::Up, "two"),
            (KeyCode::Up, "one"),
            (KeyCode::Up, "one"),
            (KeyCode::Down, "two"),
            (KeyCode::Down, ""),
        ] {
            press(&mut prompt, &[key], &history);
            assert_eq!(prompt.text(), text);
        }
    }

    #[test]
    fn escape_and_backspace_on_an_empty_line_cancel() {
        assert_eq!(press(&mut Prompt::new("stop"), &[KeyCode::Esc], &[]), PromptAction::Cancelled);
        assert_eq!(
            press(&mut Prompt::new("a"), &[KeyCode::Backspace, KeyCode::Backspace], &[]),
            PromptAction::Cancelled
        );
    }

    #[test]
    fn line_length_is_limited() {
        let mut prompt = Prompt::new("");
        press(&mut prompt, &[KeyCode::Char('é'); 500], &[]);
        press(&mut prompt, &[KeyCode::Tab], &[]);
        assert_eq!(prompt.text().chars().count(), LONGEST);
    }
}
