//! The lines of a log on their way to the file: where it cannot be written they wait, and none is torn.

use std::collections::VecDeque;
use std::io::{self, Write};

/// Lines wait for a file that cannot be written, up to this many bytes; further ones are lost.
const MAX_WAITING: usize = 64 << 20;

/// Lines on their way to a file.
pub(super) struct LineQueue {
    out: Box<dyn Write>,
    /// Lines that are not written yet, the next one first.
    waiting: VecDeque<String>,
    /// Bytes in them.
    waiting_bytes: usize,
    /// Lines for which there was no room in memory.
    lost: usize,
    /// Bytes of the first line waiting that were written before it failed: another line is begun for it.
    torn: usize,
}

impl LineQueue {
    pub fn new(out: Box<dyn Write>) -> Self {
        Self { out, waiting: VecDeque::new(), waiting_bytes: 0, lost: 0, torn: 0 }
    }

    /// Lines that are not in the file: those that wait, and those that are lost.
    pub fn missing(&self) -> usize {
        self.waiting.len() + self.lost
    }

    /// Writes what waits, and this line, which ends with its newline.
    pub fn write(&mut self, line: String) -> io::Result<()> {
        if self.waiting_bytes + line.len() > MAX_WAITING {
            self.lost += 1;
        } else {
            self.waiting_bytes += line.len();
            self.waiting.push_back(line);
        }
        self.drain()
    }

    /// Writes what waits. What a failure has left of a line is ended first, and the whole line comes on a new one.
    fn drain(&mut self) -> io::Result<()> {
        while let Some(line) = self.waiting.front() {
            if self.torn > 0 {
                self.out.write_all(b"\n")?;
                // Where only the end of the line was missing, it is whole now.
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
