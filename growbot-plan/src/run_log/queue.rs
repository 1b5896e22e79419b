//! Queue of log lines for a file. If the file cannot be written, the lines wait in memory, and a line that was written
//! in part is written again as a whole.

use std::collections::VecDeque;
use std::io::{self, Write};

/// Maximum total length of the waiting lines, bytes. Further lines are dropped.
const MAX_WAITING: usize = 64 << 20;

/// Queue of log lines that are written to a file in order.
pub(super) struct LineQueue {
    out: Box<dyn Write + Send>,
    /// Lines that are not written yet, the oldest first.
    waiting: VecDeque<String>,
    /// Number of bytes in the waiting lines.
    waiting_bytes: usize,
    /// Number of lines that were dropped because the queue was full.
    lost: usize,
    /// Number of bytes of the first waiting line that were written before a failure. The line is written again on a new
    /// line.
    torn: usize,
}

impl LineQueue {
    pub fn new(out: Box<dyn Write + Send>) -> Self {
        Self { out, waiting: VecDeque::new(), waiting_bytes: 0, lost: 0, torn: 0 }
    }

    /// Returns the number of lines that are not in the file: those that wait and those that are lost.
    pub fn missing(&self) -> usize {
        self.waiting.len() + self.lost
    }

    /// Returns the number of lines that were dropped because the queue was full.
    pub fn lost(&self) -> usize {
        self.lost
    }

    /// Writes the waiting lines, and then this line, which must end with a newline.
    pub fn write(&mut self, line: String) -> io::Result<()> {
        if self.waiting_bytes + line.len() > MAX_WAITING {
            self.lost += 1;
        } else {
            self.waiting_bytes += line.len();
            self.waiting.push_back(line);
        }
        self.drain()
    }

    /// Writes the waiting lines. If only a part of the first one was written before a failure, that part is ended by a
    /// newline, and the whole line is written again.
    pub fn drain(&mut self) -> io::Result<()> {
        while let Some(line) = self.waiting.front() {
            if self.torn > 0 {
                self.out.write_all(b"\n")?;
                // If only the newline was missing, the line is complete now.
                let is_whole = self.torn + 1 == line.len();
                self.torn = 0;
                if is_whole {
                    self.pop_written();
                    continue;
                }
            }
            let mut rest = line.as_bytes();
            while !rest.is_empty() {
                match self.out.write(rest) {
                    Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
                    Ok(count) => {
                        rest = rest.get(count..).unwrap_or_default();
                        self.torn += count;
                    }
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                    Err(error) => return Err(error),
                }
            }
            self.torn = 0;
            self.pop_written();
        }
        self.out.flush()
    }

    fn pop_written(&mut self) {
        let written = self.waiting.pop_front().map_or(0, |line| line.len());
        self.waiting_bytes = self.waiting_bytes.saturating_sub(written);
    }
}
