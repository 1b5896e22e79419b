//! Configuration with a new robot description from a host. The board accepts a description only while it is at rest and
//! cold, checks it, and stores it in flash. The new description takes effect after a restart of the board, so that no
//! part of the firmware keeps using the old one.

use growbot_core::link::message::{Configure, DescriptionError, Message, Refusal, State};
use growbot_core::robot::{BoardKind, Robot};

use super::job::COLD_C;
use super::{Controller, centi};
use crate::hal::{Board, Watchdog};
use crate::safety::transitions::may_heat;

/// Time at rest after which a nozzle counts as cold, whatever its thermistor reads, us. Without this limit a
/// description of the wrong thermistor could not be replaced, because the nozzle might always read as hot. In
/// `no_false_alarms.rs` a nozzle cools below 50 C in a quarter of this time.
const COOLED_US: u64 = 20 * 60 * 1_000_000;
/// Time from the response to the last part of a description until the board restarts, us. In this time the board sends
/// the response, and answers a repetition of the request too.
const RESTART_US: u64 = 500_000;

/// Returns the robot if its description states one of the board kinds `kinds`, or no kind. Returns an error otherwise.
/// If `kinds` is empty, every description is accepted.
pub(super) fn check_board_kind(kinds: &[BoardKind], robot: Robot) -> Result<Robot, DescriptionError> {
    let asked = robot.description().board.map(|board| board.kind);
    match (asked, kinds.first()) {
        (Some(asked), Some(&board)) if !kinds.contains(&asked) => Err(DescriptionError::BoardMismatch { asked, board }),
        _ => Ok(robot),
    }
}

impl<B: Board> Controller<B> {
    /// Returns whether the board must be reset now to start with the new robot description. Everything is off then.
    pub fn needs_reset(&self) -> bool {
        self.configuring.restart_at.is_some_and(|at| self.now_us >= at)
    }

    /// Accepts a part of a robot description, and stores the description once its last part has arrived.
    pub(super) fn configure(&mut self, part: &Configure) -> Result<Message, Refusal> {
        if self.configuring.is_restart_pending() {
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
            let robot = robot
                .and_then(|robot| check_board_kind(B::KINDS, robot))
                .map_err(|error| Refusal::InvalidDescription { error })?;
            self.parts.watchdog.feed();
            let stored = self.parts.descriptions.store(&robot);
            self.parts.watchdog.feed();
            stored.map_err(|_| Refusal::DescriptionNotStored)?;
            // Steps of the old description mean nothing to the new one.
            self.motion.set_retracted_steps(0);
            self.retain();
            self.configuring.restart_at = Some(self.now_us.saturating_add(RESTART_US));
        }
        Ok(self.configuring.answer())
    }

    /// Checks that the board may accept a new robot description: the robot is at rest, nothing is hot, and no job is
    /// unfinished.
    fn check_configurable(&self) -> Result<(), Refusal> {
        if !self.identity.configured {
            return Ok(());
        }
        if may_heat(self.state) || matches!(self.state, State::SelfTest | State::Parked) {
            return Err(Refusal::WrongState { state: self.state });
        }
        if self.job.plan_id != 0 && self.job.layers_laid < self.job.layer_count {
            return Err(Refusal::JobNotDone { plan_id: self.job.plan_id });
        }
        let is_cold = self.heater.temperature(self.now_us).is_some_and(|temperature| temperature < COLD_C);
        if is_cold || self.in_state_us() >= COOLED_US {
            Ok(())
        } else {
            Err(Refusal::NozzleTooHot { below: centi(COLD_C) })
        }
    }
}
