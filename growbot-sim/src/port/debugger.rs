//! Clock control of a board in QEMU: the board runs to a tick and stops there.
//!
//! QEMU is controlled through GDB's remote protocol. The board writes a word at each tick
//! (`growbot_firmware::emulated_tip::ALARMS`). A watchpoint on the word of the next required tick stops the board
//! there. While the board is stopped, its virtual clock is stopped too, and QEMU accepts the bytes that the host has
//! sent to the board.

use std::fmt::Write as _;
use std::io::{self, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use growbot_firmware::emulated_tip as table;

/// Connection to the GDB server of QEMU, through which the emulated board is run and stopped.
pub struct Debugger {
    line: TcpStream,
    received: Vec<u8>,
    /// Address of the word of shared memory that has the watchpoint. `None` before the first run.
    watched: Option<usize>,
    runs: bool,
}

impl Debugger {
    /// Creates the debugger of a stopped board from the connection to QEMU's GDB server.
    pub(super) fn on(line: TcpStream) -> Self {
        Self { line, received: Vec::new(), watched: None, runs: false }
    }

    /// Runs the board until it reaches `tick`, which must be less than [`table::ALARM_WORDS`] ticks ahead. If the board
    /// still runs from an earlier call, the board continues to the tick of the earlier call instead. Returns true if
    /// the board stops within `patience` of real time.
    ///
    /// # Errors
    /// QEMU has ended, or reports an error.
    pub fn run_to(&mut self, tick: u32, patience: Duration) -> io::Result<bool> {
        if !self.runs {
            let word = table::ADDRESS + table::alarm_offset(tick);
            let mut commands = String::new();
            if let Some(before) = self.watched.replace(word) {
                push(&mut commands, &format!("z2,{before:x},4"));
            }
            push(&mut commands, &format!("Z2,{word:x},4"));
            push(&mut commands, "c");
            self.line.write_all(commands.as_bytes())?;
            self.runs = true;
        }
        self.line.set_read_timeout(Some(patience.max(Duration::from_millis(1))))?;
        let mut buffer = [0; 512];
        loop {
            while let Some(packet) = next_packet(&mut self.received) {
                match packet.first() {
                    Some(b'T' | b'S') => {
                        self.runs = false;
                        return Ok(true);
                    }
                    None | Some(b'O') => {}
                    _ => return Err(io::Error::other(format!("QEMU reported {}", String::from_utf8_lossy(&packet)))),
                }
            }
            match self.line.read(&mut buffer) {
                Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
                Ok(count) => self.received.extend(buffer.iter().take(count)),
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => return Ok(false),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
    }
}

/// Appends a packet of GDB's remote protocol with the content `text` to `commands`.
fn push(commands: &mut String, text: &str) {
    let sum = text.bytes().fold(0_u8, u8::wrapping_add);
    // Writing to a String does not fail.
    let _ = write!(commands, "${text}#{sum:02x}");
}

/// Removes the first whole packet from the received bytes, and returns its content. Returns `None` if no whole packet
/// has been received.
fn next_packet(received: &mut Vec<u8>) -> Option<Vec<u8>> {
    let begin = received.iter().position(|byte| *byte == b'$')?;
    let end = begin + received.get(begin..)?.iter().position(|byte| *byte == b'#')?;
    if received.len() < end + 3 {
        return None;
    }
    let packet = received.get(begin + 1..end)?.to_vec();
    received.drain(..end + 3);
    Some(packet)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packets_are_encoded_and_decoded() {
        let mut commands = String::new();
        push(&mut commands, "c");
        push(&mut commands, "Z2,210c0004,4");
        assert_eq!(commands, "$c#63$Z2,210c0004,4#d2");
        let mut received = b"+$OK#9a+$#00$T05thread:01;watch:210c0004;#5".to_vec();
        assert_eq!(next_packet(&mut received).unwrap(), b"OK");
        assert_eq!(next_packet(&mut received).unwrap(), b"");
        assert_eq!(next_packet(&mut received), None);
        received.push(b'0');
        assert_eq!(next_packet(&mut received).unwrap(), b"T05thread:01;watch:210c0004;");
        assert!(received.is_empty());
    }
}
