//! Answers that a person types, one per line.

use std::io::{self, IsTerminal};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use growbot_plan::pose_text::parse_number;

use crate::cli::typed_answer::read_answer;

/// Expected kind of an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnswerKind {
    /// Confirmation that something is done: Enter or yes.
    Ready,
    /// The word yes or no.
    YesOrNo,
    /// A number above 0.
    Number,
}

/// A parsed answer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum OperatorAnswer {
    /// Done, or yes.
    Yes,
    /// No.
    No,
    /// Skip the present step.
    Skip,
    /// Quit, and leave the remaining steps for another time.
    Quit,
    /// A number.
    Number(f64),
}

impl AnswerKind {
    /// Returns the choices for the user.
    pub fn choices(self) -> &'static str {
        match self {
            Self::Ready => "Enter, skip or quit",
            Self::YesOrNo => "yes, no, skip or quit",
            Self::Number => "a number above 0, skip or quit",
        }
    }

    /// Parses a line.
    ///
    /// # Errors
    /// Returns a message about the mistake, with the choices.
    pub fn read(self, line: &str) -> Result<OperatorAnswer, String> {
        let line = line.trim();
        match (self, line.to_lowercase().as_str()) {
            (_, "skip" | "s") => Ok(OperatorAnswer::Skip),
            (_, "quit" | "q") => Ok(OperatorAnswer::Quit),
            (Self::Ready, "") | (Self::Ready | Self::YesOrNo, "yes" | "y") => Ok(OperatorAnswer::Yes),
            (Self::YesOrNo, "no" | "n") => Ok(OperatorAnswer::No),
            (Self::Number, _) if parse_number(line).is_some_and(|number| number.is_finite() && number > 0.0) => {
                Ok(parse_number(line).map_or(OperatorAnswer::Skip, OperatorAnswer::Number))
            }
            _ => Err(format!("{line:?} is not a valid answer: type {}", self.choices())),
        }
    }
}

/// Reason why no line was received.
#[derive(Debug, PartialEq, Eq)]
pub enum AnswerReadError {
    /// No line has arrived yet.
    Timeout,
    /// The input has ended.
    EndOfInput,
    /// The input cannot be read.
    Unreadable(String),
}

/// Lines that the user types.
pub struct OperatorInput {
    lines: Receiver<Result<String, String>>,
    /// True if a person types at a terminal. In that case a question is repeated after an invalid answer.
    pub by_hand: bool,
}

impl OperatorInput {
    /// Starts a thread that reads lines of standard input. It ends with the input or with the program.
    pub fn of_standard_input() -> Self {
        let (sender, lines) = mpsc::sync_channel(1);
        thread::spawn(move || {
            while let Some(line) = read_answer().transpose() {
                let failed = line.is_err();
                if sender.send(line).is_err() || failed {
                    return;
                }
            }
        });
        Self { lines, by_hand: io::stdin().is_terminal() }
    }

    /// Creates an input that delivers these lines.
    #[cfg(test)]
    pub fn of(lines: &[&str]) -> Self {
        let (sender, receiver) = mpsc::sync_channel(lines.len());
        for line in lines {
            sender.send(Ok((*line).to_owned())).unwrap();
        }
        Self { lines: receiver, by_hand: false }
    }

    /// Returns the next line, if it arrives within this time.
    pub fn within(&self, time: Duration) -> Result<String, AnswerReadError> {
        match self.lines.recv_timeout(time) {
            Ok(line) => line.map_err(AnswerReadError::Unreadable),
            Err(RecvTimeoutError::Timeout) => Err(AnswerReadError::Timeout),
            Err(RecvTimeoutError::Disconnected) => Err(AnswerReadError::EndOfInput),
        }
    }
}
