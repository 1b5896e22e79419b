//! Mailbox for moves and reports between the controller and the step interrupt.

use growbot_firmware::stepping::Mailbox;

/// The mailbox of the board.
pub static MAILBOX: Mailbox = Mailbox::new();
