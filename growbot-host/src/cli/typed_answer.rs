//! Answers that a person types, one per line.

use std::io::{self, BufRead, Read};

/// Length from which an answer is too long, bytes.
const LONGEST_ANSWER: u64 = 4096;

/// Reads a line of standard input. `None` at its end.
///
/// # Errors
/// Returns a message if standard input cannot be read, or if the line is too long or is not UTF-8.
pub fn read_answer() -> Result<Option<String>, String> {
    let mut line = Vec::new();
    let unreadable = |error| format!("cannot read the answers from standard input: {error}");
    io::stdin().lock().take(LONGEST_ANSWER).read_until(b'\n', &mut line).map_err(unreadable)?;
    match line.len() as u64 {
        0 => Ok(None),
        LONGEST_ANSWER.. => {
            Err(format!("an answer is longer than {LONGEST_ANSWER} bytes: check that standard input is the right file"))
        }
        _ => String::from_utf8(line).map(Some).map_err(|_| "an answer is not UTF-8 text: type it as UTF-8".to_owned()),
    }
}
