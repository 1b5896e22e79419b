//! Keys of the whole screen and their actions.

use crossterm::event::{KeyCode, KeyEvent, KeyModifiers};

use crate::cli::console::commands::BoardRequest;

/// Action of a key.
#[derive(Debug, Clone, PartialEq)]
pub enum Action {
    /// A request to the board.
    Ask(BoardRequest),
    /// Open the prompt with this beginning of a command.
    Prompt(&'static str),
    /// Let time on `sim` pass faster.
    Faster,
    /// Let time on `sim` pass slower.
    Slower,
    /// Leave the screen. A robot that grows finishes its layer and pauses.
    Quit,
}

/// Keys in the last line of the screen. The first line shows + and - if the speed can be changed.
pub const KEYS: [(&str, &str); 8] = [
    ("h", "pause"),
    ("g", "start"),
    ("s", "stop"),
    ("e ^E", "EMERGENCY STOP"),
    ("c", "clear"),
    ("p", "plan"),
    (":", "type"),
    ("q", "quit"),
];

/// Returns the action of a key while no command is being typed.
pub fn action(key: KeyEvent) -> Option<Action> {
    if let Some(action) = always(key) {
        return Some(action);
    }
    if key.modifiers.intersects(KeyModifiers::CONTROL | KeyModifiers::ALT) {
        return None;
    }
    match key.code {
        KeyCode::Char('h') => Some(Action::Ask(BoardRequest::Pause)),
        KeyCode::Char('g') => Some(Action::Ask(BoardRequest::Start)),
        KeyCode::Char('s') => Some(Action::Ask(BoardRequest::Stop)),
        KeyCode::Char('e') => Some(Action::Ask(BoardRequest::EmergencyStop)),
        KeyCode::Char('c') => Some(Action::Ask(BoardRequest::Clear)),
        KeyCode::Char('p') => Some(Action::Prompt("plan ")),
        KeyCode::Char(':') => Some(Action::Prompt("")),
        KeyCode::Char('+' | '=') => Some(Action::Faster),
        KeyCode::Char('-') => Some(Action::Slower),
        KeyCode::Char('q') => Some(Action::Quit),
        _ => None,
    }
}

/// Returns the action of a key that also works while a command is being typed.
pub fn always(key: KeyEvent) -> Option<Action> {
    match key.code {
        KeyCode::Char('e') if key.modifiers.contains(KeyModifiers::CONTROL) => {
            Some(Action::Ask(BoardRequest::EmergencyStop))
        }
        KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => Some(Action::Quit),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_displayed_key_has_an_action() {
        for letter in KEYS.iter().filter_map(|(keys, _)| keys.chars().next()) {
            assert!(action(KeyEvent::from(KeyCode::Char(letter))).is_some(), "{letter}");
        }
        let control = |letter| KeyEvent::new(KeyCode::Char(letter), KeyModifiers::CONTROL);
        assert_eq!(always(control('e')), Some(Action::Ask(BoardRequest::EmergencyStop)));
        assert_eq!(action(control('c')), Some(Action::Quit));
        assert_eq!(action(control('s')), None);
        assert_eq!(always(KeyEvent::from(KeyCode::Char('e'))), None);
    }
}
