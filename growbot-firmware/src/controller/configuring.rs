//! Another robot description from a host: taken at rest and cold, checked, kept in flash, and in effect after a restart
//! of the board, so that no part of the firmware goes on with the old one.

use growbot_core::link::message::{BadDescription, Configure, Configured, Message, Refusal, State};
use growbot_core::robot::{BoardKind, LONGEST_VERSIONED, Robot};
use heapless::Vec;

use super::job::COLD_C;
use super::{Controller, centi};
use crate::hal::{Board, Watchdog};
use crate::safety::transitions::may_heat;

/// Time at rest after which a nozzle counts as cold whatever its thermistor says, us: a description of the wrong
/// thermistor must not keep itself. A nozzle is below 50 C after a quarter of that (`normal_growth.rs`).
const COOLED_US: u64 = 20 * 60 * 1_000_000;
/// Time from the answer to the restart, us, in which the answer leaves the board and its repetition is answered too.
const RESTART_US: u64 = 500_000;

/// The description that is on its way.
#[derive(Default)]
pub(super) struct Configuring {
    /// Its hash, as the host says.
    robot: u64,
    /// Its length, as the host says.
    length: u16,
    bytes: Vec<u8, LONGEST_VERSIONED>,
    /// When the board restarts with it, us.
    restart_at: Option<u64>,
}

impl Configuring {
    fn answer(&self) -> Message {
        let stored = self.restarts();
        let received = if stored { self.length } else { self.bytes.len() as u16 };
        Message::Configured(Configured { robot: self.robot, received, stored })
    }

    /// Whether the board is to restart. It takes no other requests until then.
    pub(super) fn restarts(&self) -> bool {
        self.restart_at.is_some()
    }

    /// Adds a part. True where it was the last one.
    fn add(&mut self, part: &Configure) -> Result<bool, Refusal> {
        if usize::from(part.length) > LONGEST_VERSIONED {
            return Err(Refusal::BadDescription { why: BadDescription::TooLong });
        }
        if (part.robot, part.length) != (self.robot, self.length) || part.offset == 0 {
            *self = Self { robot: part.robot, length: part.length, ..Self::default() };
        }
        let received = self.bytes.len();
        let (offset, end) = (usize::from(part.offset), usize::from(part.offset) + part.bytes.len());
        if offset > received {
            return Err(Refusal::OutOfOrder { expected: received as u32 });
        }
        if end > usize::from(part.length) || part.bytes.is_empty() {
            return Err(Refusal::NotUnderstood);
        }
        // What it has already came with an answer that was lost.
        let news = part.bytes.get(received - offset..).unwrap_or_default();
        self.bytes.extend_from_slice(news).map_err(|_| Refusal::NotUnderstood)?;
        Ok(self.bytes.len() == usize::from(self.length))
    }

    /// The robot, all of whose bytes are there.
    fn robot(&self) -> Result<Robot, BadDescription> {
        let robot = Robot::decode_for_board(&self.bytes)?;
        if robot.hash() == self.robot { Ok(robot) } else { Err(BadDescription::OtherHash { found: robot.hash() }) }
    }
}

/// The robot, if its description is for one of these kinds of board, or for any. Without kinds, all suit.
pub(super) fn suits_kinds(kinds: &[BoardKind], robot: Robot) -> Result<Robot, BadDescription> {
    let asked = robot.description().board.map(|board| board.kind);
    match (asked, kinds.first()) {
        (Some(asked), Some(&board)) if !kinds.contains(&asked) => Err(BadDescription::OtherBoard { asked, board }),
        _ => Ok(robot),
    }
}

impl<B: Board> Controller<B> {
    /// Whether the board is to be reset now, to start with another robot description. Everything is off.
    #[must_use]
    pub fn is_to_restart(&self) -> bool {
        self.configuring.restart_at.is_some_and(|at| self.now >= at)
    }

    /// Takes a part of a description; with the last one, stores it.
    pub(super) fn configure(&mut self, part: &Configure) -> Result<Message, Refusal> {
        if self.configuring.restarts() {
            return if part.robot == self.configuring.robot {
                Ok(self.configuring.answer())
            } else {
                Err(Refusal::NoSession)
            };
        }
        self.check_configurable()?;
        if self.configuring.add(part)? {
            let robot = self.configuring.robot();
            self.configuring.bytes.clear();
            let robot =
                robot.and_then(|robot| suits_kinds(B::KINDS, robot)).map_err(|why| Refusal::BadDescription { why })?;
            self.parts.watchdog.feed();
            let stored = self.parts.descriptions.store(&robot);
            self.parts.watchdog.feed();
            stored.map_err(|_| Refusal::DescriptionNotStored)?;
            self.configuring.restart_at = Some(self.now.saturating_add(RESTART_US));
        }
        Ok(self.configuring.answer())
    }

    /// Whether the board may get another description: nothing is under way, nothing is hot, and there is no job that
    /// is not done.
    fn check_configurable(&self) -> Result<(), Refusal> {
        if !self.identity.configured {
            return Ok(());
        }
        if may_heat(self.state) || matches!(self.state, State::SelfTest | State::Parked) {
            return Err(Refusal::WrongState { state: self.state });
        }
        if self.job.plan_id != 0 && self.job.laid < self.job.layers {
            return Err(Refusal::JobNotDone { plan_id: self.job.plan_id });
        }
        let is_cold = self.heater.temperature(self.now).is_some_and(|temperature| temperature < COLD_C);
        if is_cold || self.in_state_us() >= COOLED_US { Ok(()) } else { Err(Refusal::Hot { below: centi(COLD_C) }) }
    }
}
