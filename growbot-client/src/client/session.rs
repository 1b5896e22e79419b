//! Sessions: who the board is, who owns it, and how a host comes to own it.

use std::time::Duration;

use growbot_core::link::message::{BoardHello, Empty, HostHello, HostName, Message, Refusal, SCHEMA_HASH, State};
use growbot_core::robot::Robot;

use super::{Client, ClientError};

/// A host that owns the board and is silent for 10 s has lost it (PROTOCOL.md): it is waited for in this many looks,
const OWNED_LOOKS: u32 = 24;
/// with such pauses.
const OWNED_LOOK: Duration = Duration::from_millis(500);
/// The kind of a refusal.
const REFUSED: u8 = 0x44;
/// A board that has just started tests itself for two seconds at most, ms of its own clock: a busy machine stretches
/// that of an emulated one.
const SELF_TEST_MS: u64 = 5000;
/// It is looked at so often,
const MAX_LOOKS_AT_SELF_TEST: u32 = 1200;
/// so often while its clock stands,
const MAX_LOOKS_AT_A_CLOCK: u32 = 60;
/// with such pauses.
const SELF_TEST_LOOK: Duration = Duration::from_millis(50);

impl Client {
    /// Opens the session: both sides say who they are. A host that has gone without a goodbye is waited for.
    ///
    /// # Errors
    /// A board that is silent, garbled, of another version, or held by another host.
    pub fn hello(&mut self) -> Result<BoardHello, ClientError> {
        let mut silent_before = 0;
        for _ in 0..OWNED_LOOKS {
            match self.open_session(self.takes_over) {
                Err(ClientError::Refused { refusal: Refusal::Owned { .. }, .. })
                    if self.board()?.owner == Some(host_name()) =>
                {
                    // It is this program, which the line had lost.
                    return self.open_session(true);
                }
                // As long as it is silent it may be gone.
                Err(ClientError::Refused { refusal: Refusal::Owned { silent_ms }, .. })
                    if silent_ms >= silent_before =>
                {
                    silent_before = silent_ms;
                    self.pass(OWNED_LOOK)?;
                }
                other => return other.or_else(|error| self.name_owner(error)),
            }
        }
        self.open_session(false).or_else(|error| self.name_owner(error))
    }

    fn open_session(&mut self, take_over: bool) -> Result<BoardHello, ClientError> {
        if self.open {
            // Another one: the board may have restarted, or forgotten us.
            self.session = new_session();
            (self.seq, self.received, self.acknowledged, self.open) = (0, 0, true, false);
            self.events.clear();
        }
        let request = Message::Hello(HostHello { schema: SCHEMA_HASH, host: host_name(), take_over });
        match self.request("hello", &request) {
            Ok(Message::BoardHello(hello)) => {
                self.open = true;
                self.after_self_test(same_schema(hello)?)
            }
            Err(ClientError::Refused { refusal: Refusal::OtherSchema { board }, .. }) => {
                Err(ClientError::Schema { board, host: SCHEMA_HASH })
            }
            Ok(other) => Err(ClientError::Unexpected { request: "hello", kind: other.kind() }),
            Err(error) => Err(error),
        }
    }

    /// The board is held: by whom.
    fn name_owner(&mut self, error: ClientError) -> Result<BoardHello, ClientError> {
        let ClientError::Refused { refusal: Refusal::Owned { silent_ms }, .. } = error else { return Err(error) };
        let owner = self.board()?.owner.unwrap_or_default();
        Err(ClientError::Held {
            port: self.name.clone(),
            host: String::from_utf8_lossy(&owner).into_owned(),
            silent_s: f64::from(silent_ms) / 1000.0,
        })
    }

    /// Who the board is and what it is doing, without a session: the host that owns the board keeps it.
    ///
    /// # Errors
    /// A board that is silent, garbled or of another version.
    pub fn board(&mut self) -> Result<BoardHello, ClientError> {
        let what = "the question who it is";
        match self.request(what, &Message::AskBoard(Empty {})) {
            Ok(Message::BoardHello(hello)) => self.after_self_test(same_schema(hello)?),
            Ok(other) => Err(ClientError::Unexpected { request: what, kind: other.kind() }),
            Err(ClientError::Refused { refusal: Refusal::OtherSchema { board }, .. }) => {
                Err(ClientError::Schema { board, host: SCHEMA_HASH })
            }
            // Another release, which does not know the question.
            Err(ClientError::Refused { refusal: Refusal::NotUnderstood, .. }) => {
                Err(ClientError::Unexpected { request: what, kind: REFUSED })
            }
            Err(error) => Err(error),
        }
    }

    /// Waits until a board that has just started has tested itself: until then it takes no job.
    fn after_self_test(&mut self, mut hello: BoardHello) -> Result<BoardHello, ClientError> {
        let mut standing = 0;
        for _ in 0..MAX_LOOKS_AT_SELF_TEST {
            let before = hello.status.uptime_ms;
            // One that is not configured has nothing to test.
            if hello.status.state != State::SelfTest
                || hello.robot == 0
                || before > SELF_TEST_MS
                || standing > MAX_LOOKS_AT_A_CLOCK
            {
                break;
            }
            self.pass(SELF_TEST_LOOK)?;
            hello.status = self.status()?;
            standing = if hello.status.uptime_ms == before { standing + 1 } else { 0 };
        }
        Ok(hello)
    }

    /// Fails unless the board belongs to this robot.
    ///
    /// # Errors
    /// [`ClientError::OtherRobot`]; also for a board that is not configured.
    pub fn belongs_to(hello: &BoardHello, robot: &Robot) -> Result<(), ClientError> {
        if hello.robot == robot.hash() {
            return Ok(());
        }
        Err(ClientError::OtherRobot {
            board_name: hello.robot_name.to_string(),
            board: hello.robot,
            host_name: robot.name().to_string(),
            host: robot.hash(),
        })
    }

    /// Opens the session with a board that must belong to this robot.
    ///
    /// # Errors
    /// As [`Client::hello`], or a board of another robot.
    pub fn hello_robot(&mut self, robot: &Robot) -> Result<BoardHello, ClientError> {
        let hello = self.hello()?;
        if hello.robot == 0 {
            return Err(ClientError::NotConfigured { port: self.name.clone() });
        }
        Self::belongs_to(&hello, robot)?;
        Ok(hello)
    }
}

fn same_schema(hello: BoardHello) -> Result<BoardHello, ClientError> {
    if hello.schema == SCHEMA_HASH {
        Ok(hello)
    } else {
        Err(ClientError::Schema { board: hello.schema, host: SCHEMA_HASH })
    }
}

/// The name of this host, for others.
fn host_name() -> HostName {
    let program =
        std::env::args().nth(1).filter(|word| !word.starts_with('-')).unwrap_or_else(|| "growbot".to_string());
    let machine = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let name = format!("{program} {} on {}", std::process::id(), machine.trim());
    name.bytes().take(HostName::new().capacity()).collect()
}

/// A number for this session that another host will hardly have.
pub(super) fn new_session() -> u32 {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    // Never 0, which stands for no session.
    (now.as_secs() as u32).rotate_left(12) ^ now.subsec_nanos() ^ std::process::id() | 1
}
