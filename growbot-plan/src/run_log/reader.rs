//! Reader of the lines of a run log, each of which is a JSON object. A line that is not a JSON object, because a disk
//! was full or a byte was corrupted, is skipped and counted.

use serde_json::{Map, Value};

use super::event::{RunEvent, RunLine};

/// Maximum length of a line of a log, bytes (16 MiB). The layers of a job are in one line.
const LONGEST_LINE: usize = 16 << 20;

/// Parts of a log that could not be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Damage {
    /// Number of lines that are not JSON objects.
    pub lines: usize,
    /// Line number of the first line that is not a JSON object, counted from 1.
    pub first: usize,
    /// Number of bytes at the end of the log that belong to an incomplete line.
    pub cut_off: usize,
}

impl Damage {
    /// Returns a message for users. `None` if all lines could be read. `file` is the name of the log.
    pub fn message(&self, file: &str) -> Option<String> {
        let Self { lines, first, cut_off } = self;
        let skipped = match lines {
            0 => None,
            1 => Some(format!("skipped line {first} of {file}: not a valid event")),
            _ => Some(format!("skipped {lines} lines of {file}, the first is line {first}: not valid events")),
        };
        let cut = (*cut_off > 0).then(|| {
            format!(
                "the last {cut_off} bytes of {file} are not a complete line: the run log was cut off there, and these \
                 bytes are ignored"
            )
        });
        match (skipped, cut) {
            (Some(skipped), Some(cut)) => Some(format!("{skipped}; {cut}")),
            (skipped, cut) => skipped.or(cut),
        }
    }
}

/// Iterator over the events of a log. Events with an unknown name or invalid values are skipped.
pub struct Events<'a> {
    rest: &'a [u8],
    number: usize,
    /// Parts of the log that could not be read so far.
    pub damage: Damage,
}

impl<'a> Events<'a> {
    /// Creates an iterator over all events in the bytes of a log.
    pub fn of(log: &'a [u8]) -> Self {
        Self { rest: log, number: 0, damage: Damage::default() }
    }

    /// Creates an iterator over the events in the bytes of a log after the header, which is the first line that is a
    /// JSON object.
    pub fn after_header(log: &'a [u8]) -> Self {
        let mut events = Self::of(log);
        events.next_line();
        events
    }

    /// Returns the next line that is a JSON object. `None` at the end of the log.
    pub(super) fn next_line(&mut self) -> Option<LogLine> {
        while !self.rest.is_empty() {
            let end = self.rest.iter().position(|byte| *byte == b'\n').map_or(self.rest.len(), |end| end + 1);
            let (line, rest) = self.rest.split_at(end);
            self.rest = rest;
            self.number += 1;
            let text = line.trim_ascii();
            match (text.len() <= LONGEST_LINE).then(|| LogLine::read(text)).flatten() {
                Some(line) => return Some(line),
                // An empty line: writing failed before the first byte of a line.
                None if text.is_empty() => {}
                None if !line.ends_with(b"\n") => self.damage.cut_off = line.len(),
                None => {
                    if self.damage.lines == 0 {
                        self.damage.first = self.number;
                    }
                    self.damage.lines += 1;
                }
            }
        }
        None
    }
}

impl Iterator for Events<'_> {
    type Item = RunEvent;

    fn next(&mut self) -> Option<RunEvent> {
        loop {
            if let LogLine::Event(event) = self.next_line()? {
                return Some(event);
            }
        }
    }
}

/// A line that is a JSON object.
pub(super) enum LogLine {
    /// An event that this version can read.
    Event(RunEvent),
    /// The fields of another JSON object: an event with an unknown name or invalid values.
    Other(Map<String, Value>),
}

impl LogLine {
    fn read(text: &[u8]) -> Option<Self> {
        match serde_json::from_slice::<RunLine>(text) {
            Ok(line) => Some(Self::Event(line.event)),
            Err(_) => serde_json::from_slice(text).ok().map(Self::Other),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reading_continues_after_an_invalid_line() {
        let log = b"{\"event\":\"no-response\"}\n{\"b\":\n\n7\n{\"event\":\"reconnected\"}\r\n\xff\xfe\n{\"event\":\"state\",\"state\":\"idle\"}\n{\"e\":";
        let mut events = Events::of(log);
        let read: Vec<RunEvent> = events.by_ref().collect();
        assert_eq!(read, [RunEvent::NoResponse, RunEvent::Reconnected, RunEvent::State { state: "idle".to_owned() }]);
        assert_eq!(events.damage, Damage { lines: 3, first: 2, cut_off: 5 });
        let words = events.damage.message("run").unwrap();
        assert!(words.contains("3 lines of run, the first is line 2") && words.contains("last 5 bytes"), "{words}");
        assert_eq!(Damage::default().message("run"), None);
        // A last line that only lacks its newline is complete.
        assert_eq!(Events::of(b"{\"event\":\"no-response\"}").count(), 1);
    }

    #[test]
    fn unknown_or_invalid_events_are_skipped_without_counting_as_damage() {
        let log = b"{}\n{\"event\":\"dance\"}\n{\"event\":3}\n{\"event\":\"laid\",\"layer\":-1}\n{\"event\":\"reconnected\",\"new\":[1]}\n";
        let mut events = Events::of(log);
        assert_eq!(events.by_ref().collect::<Vec<_>>(), [RunEvent::Reconnected]);
        assert_eq!(events.damage, Damage::default());
    }
}
