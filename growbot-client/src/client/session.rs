//! Sessions: a host opens a session and so becomes the owner of the board.

use std::time::Duration;

use growbot_core::link::message::{
    BoardInfo, Empty, Hello, HostName, Message, PassiveRequest, Refusal, SCHEMA_HASH, State,
};
use growbot_core::robot::Robot;

use super::{Client, ClientError, new_session};

/// Maximum number of attempts to open a session with a board that another host owns. That host loses the board if it
/// sends nothing for 10 s (PROTOCOL.md).
const OWNED_LOOKS: u32 = 24;
/// Time between two attempts to open a session with a board that another host owns.
const OWNED_LOOK: Duration = Duration::from_millis(500);
/// Message kind of a refusal (`Refused`).
const REFUSED: u8 = 0x44;
/// Maximum time to wait for the end of a board's self-test, ms of the board's clock. The self-test takes two seconds at
/// most, but longer on a board that a busy machine emulates.
const SELF_TEST_MS: u64 = 5000;
/// Maximum number of polls for the end of the self-test.
const MAX_LOOKS_AT_SELF_TEST: u32 = 1200;
/// Maximum number of successive polls for the end of the self-test in which the board's clock does not advance.
const MAX_LOOKS_AT_A_CLOCK: u32 = 60;
/// Time between two polls for the end of the self-test.
const SELF_TEST_LOOK: Duration = Duration::from_millis(50);

impl Client {
    /// Opens a session with the board: host and board exchange their identities. If another host owns the board but
    /// sends nothing, waits up to 12 s until that host loses the board.
    /// # Errors
    /// If the board does not respond, sends no valid frames, has another version of the protocol, or is owned by
    /// another host.
    pub fn open_session(&mut self) -> Result<BoardInfo, ClientError> {
        let mut silent_before = 0;
        for _ in 0..OWNED_LOOKS {
            match self.try_open_session(self.takes_over) {
                Err(ClientError::Refused { refusal: Refusal::OwnedByOtherHost { .. }, .. })
                    if self.identify()?.owner == Some(host_name()) =>
                {
                    // The owner is this program, whose earlier connection was lost.
                    return self.try_open_session(true);
                }
                // While the owner sends nothing, it may be gone.
                Err(ClientError::Refused { refusal: Refusal::OwnedByOtherHost { silent_ms }, .. })
                    if silent_ms >= silent_before =>
                {
                    silent_before = silent_ms;
                    self.wait(OWNED_LOOK)?;
                }
                other => return other.or_else(|error| self.name_owner(error)),
            }
        }
        self.try_open_session(false).or_else(|error| self.name_owner(error))
    }

    fn try_open_session(&mut self, take_over: bool) -> Result<BoardInfo, ClientError> {
        if self.open {
            // Use another session number, because the board may have restarted or dropped this session.
            self.session = new_session();
            (self.seq, self.received, self.acknowledged, self.open) = (0, 0, true, false);
            self.events.clear();
        }
        let request = PassiveRequest::Hello(Hello { schema: SCHEMA_HASH, host: host_name(), take_over });
        match self.request("hello", &request) {
            Ok(Message::BoardInfo(hello)) => {
                self.open = true;
                self.wait_for_self_test(same_schema(hello)?)
            }
            Err(ClientError::Refused { refusal: Refusal::SchemaMismatch { board }, .. }) => {
                Err(ClientError::Schema { board, host: SCHEMA_HASH })
            }
            Ok(other) => Err(ClientError::Unexpected { request: "hello", kind: other.kind() }),
            Err(error) => Err(error),
        }
    }

    /// Replaces the refusal of a board that another host owns by [`ClientError::Owned`], which contains the name of
    /// that host. Returns other errors unchanged.
    fn name_owner(&mut self, error: ClientError) -> Result<BoardInfo, ClientError> {
        let ClientError::Refused { refusal: Refusal::OwnedByOtherHost { silent_ms }, .. } = error else {
            return Err(error);
        };
        let owner = self.identify()?.owner.unwrap_or_default();
        Err(ClientError::Owned {
            port: self.name.clone(),
            host: String::from_utf8_lossy(&owner).into_owned(),
            silent_s: f64::from(silent_ms) / 1000.0,
        })
    }

    /// Requests identity and state of the board without a session, so a host that owns the board stays its owner.
    ///
    /// # Errors
    /// If the board does not respond, sends no valid frames, or has another version of the protocol.
    pub fn identify(&mut self) -> Result<BoardInfo, ClientError> {
        let what = "the request for its identity";
        match self.request(what, &PassiveRequest::GetBoardInfo(Empty {})) {
            Ok(Message::BoardInfo(hello)) => self.wait_for_self_test(same_schema(hello)?),
            Ok(other) => Err(ClientError::Unexpected { request: what, kind: other.kind() }),
            Err(ClientError::Refused { refusal: Refusal::SchemaMismatch { board }, .. }) => {
                Err(ClientError::Schema { board, host: SCHEMA_HASH })
            }
            // The firmware is of another release, which does not know this request.
            Err(ClientError::Refused { refusal: Refusal::UnknownRequest, .. }) => {
                Err(ClientError::Unexpected { request: what, kind: REFUSED })
            }
            Err(error) => Err(error),
        }
    }

    /// Waits until a board that has just started has finished its self-test, because it accepts no job before. Returns
    /// `hello` with the latest status.
    fn wait_for_self_test(&mut self, mut hello: BoardInfo) -> Result<BoardInfo, ClientError> {
        let mut standing = 0;
        for _ in 0..MAX_LOOKS_AT_SELF_TEST {
            let before = hello.status.uptime_ms;
            // A board without a robot description runs no self-test.
            if hello.status.state != State::SelfTest
                || hello.robot_hash == 0
                || before > SELF_TEST_MS
                || standing > MAX_LOOKS_AT_A_CLOCK
            {
                break;
            }
            self.wait(SELF_TEST_LOOK)?;
            hello.status = self.status()?;
            standing = if hello.status.uptime_ms == before { standing + 1 } else { 0 };
        }
        Ok(hello)
    }

    /// Checks that the board stores the description of this robot.
    /// # Errors
    /// [`ClientError::OtherRobot`] if the board stores another description or none.
    pub fn check_robot(hello: &BoardInfo, robot: &Robot) -> Result<(), ClientError> {
        if hello.robot_hash == robot.hash() {
            return Ok(());
        }
        Err(ClientError::OtherRobot {
            board_name: hello.robot_name.to_string(),
            board: hello.robot_hash,
            host_name: robot.name().to_string(),
            host: robot.hash(),
        })
    }

    /// Opens a session with the board, and checks that the board stores the description of this robot.
    ///
    /// # Errors
    /// Like [`Client::open_session`], or if the board stores the description of another robot or none.
    pub fn open_session_for(&mut self, robot: &Robot) -> Result<BoardInfo, ClientError> {
        let hello = self.open_session()?;
        if hello.robot_hash == 0 {
            return Err(ClientError::NotConfigured { port: self.name.clone() });
        }
        Self::check_robot(&hello, robot)?;
        Ok(hello)
    }
}

fn same_schema(hello: BoardInfo) -> Result<BoardInfo, ClientError> {
    if hello.schema_hash == SCHEMA_HASH {
        Ok(hello)
    } else {
        Err(ClientError::Schema { board: hello.schema_hash, host: SCHEMA_HASH })
    }
}

/// Returns the name of this host, which the board reports to other hosts: program or command, process number and
/// machine.
fn host_name() -> HostName {
    let program =
        std::env::args().nth(1).filter(|word| !word.starts_with('-')).unwrap_or_else(|| "growbot".to_string());
    let machine = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let name = format!("{program} {} on {}", std::process::id(), machine.trim());
    name.bytes().take(HostName::new().capacity()).collect()
}
