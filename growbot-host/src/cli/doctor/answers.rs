//! What a person types, a line an answer.

use std::io::{self, BufRead, IsTerminal, Read};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use growbot_client::pose_text::parse_number;

/// No answer is longer than this, bytes.
const LONGEST_ANSWER: u64 = 256;

/// What is expected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wanted {
    /// That something is done; Enter says so.
    Ready,
    /// Yes or no, in words.
    YesOrNo,
    /// A number above 0.
    Number,
}

/// An answer, understood.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Answer {
    /// It is done, or it is so.
    Yes,
    /// It is not so.
    No,
    /// The step is left out.
    Skip,
    /// The rest is left for another time.
    Quit,
    /// A number.
    Number(f64),
}

impl Wanted {
    /// What may be typed.
    pub fn choices(self) -> &'static str {
        match self {
            Self::Ready => "Enter, skip or quit",
            Self::YesOrNo => "yes, no, skip or quit",
            Self::Number => "a number above 0, skip or quit",
        }
    }

    /// Understands a line.
    ///
    /// # Errors
    /// What is wrong with it, and what may be typed.
    pub fn read(self, line: &str) -> Result<Answer, String> {
        let line = line.trim();
        match (self, line.to_lowercase().as_str()) {
            (_, "skip" | "s") => Ok(Answer::Skip),
            (_, "quit" | "q") => Ok(Answer::Quit),
            (Self::Ready, "") | (Self::Ready | Self::YesOrNo, "yes" | "y") => Ok(Answer::Yes),
            (Self::YesOrNo, "no" | "n") => Ok(Answer::No),
            (Self::Number, _) if parse_number(line).is_some_and(|number| number.is_finite() && number > 0.0) => {
                Ok(parse_number(line).map_or(Answer::Skip, Answer::Number))
            }
            _ => Err(format!("{line:?} is no answer here: type {}", self.choices())),
        }
    }
}

/// Why there is no line.
#[derive(Debug, PartialEq, Eq)]
pub enum NoLine {
    /// Not yet.
    Yet,
    /// Nor will there be one.
    Ever,
    /// It cannot be read.
    Unreadable(String),
}

/// The lines that are typed.
pub struct Answers {
    lines: Receiver<Result<String, String>>,
    /// Somebody types them: what is wrong is asked for again.
    pub by_hand: bool,
}

impl Answers {
    /// Those of standard input, read by a thread that ends with the program.
    pub fn of_standard_input() -> Self {
        let (tell, lines) = mpsc::sync_channel(1);
        thread::spawn(move || {
            while let Some(line) = next_line() {
                let failed = line.is_err();
                if tell.send(line).is_err() || failed {
                    return;
                }
            }
        });
        Self { lines, by_hand: io::stdin().is_terminal() }
    }

    /// These.
    #[cfg(test)]
    pub fn of(lines: &[&str]) -> Self {
        let (tell, told) = mpsc::sync_channel(lines.len());
        for line in lines {
            tell.send(Ok((*line).to_owned())).unwrap();
        }
        Self { lines: told, by_hand: false }
    }

    /// The next line, if there is one within this time.
    pub fn within(&self, time: Duration) -> Result<String, NoLine> {
        match self.lines.recv_timeout(time) {
            Ok(line) => line.map_err(NoLine::Unreadable),
            Err(RecvTimeoutError::Timeout) => Err(NoLine::Yet),
            Err(RecvTimeoutError::Disconnected) => Err(NoLine::Ever),
        }
    }
}

/// A line of standard input, none at its end.
fn next_line() -> Option<Result<String, String>> {
    let mut line = Vec::new();
    if let Err(error) = io::stdin().lock().take(LONGEST_ANSWER).read_until(b'\n', &mut line) {
        return Some(Err(error.to_string()));
    }
    match line.len() as u64 {
        0 => None,
        LONGEST_ANSWER.. => Some(Err(format!("an answer is longer than {LONGEST_ANSWER} bytes"))),
        _ => Some(String::from_utf8(line).map_err(|_| "an answer is not UTF-8 text".to_owned())),
    }
}
