//! Stops of a robot of the service: raised by any thread, delivered and confirmed by the robot's own thread.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use growbot_client::client::{Client, ClientError};
use growbot_client::robot_command::StopOutcome;
use growbot_client::stop_signal::{Generation, StopLevel, StopSignal};
use growbot_core::link::message::State;
use growbot_plan::job::Command;

use super::robot_error::RobotRequestError;
use super::robot_request::RobotRequest;
use super::robot_worker::RobotWorker;

impl RobotWorker {
    /// Returns the stop signal of the robot, which issues permits and voids them.
    pub(super) fn signal(&self) -> &Arc<StopSignal> {
        &self.signal
    }

    /// Raises a stop. It voids all earlier orders, and the robot's thread sends it to the board before anything else.
    pub(super) fn raise_stop(&self, level: StopLevel) -> StopInProgress<'_> {
        self.stops_in_progress.fetch_add(1, Ordering::SeqCst);
        let generation = self.signal.raise(level);
        self.notify_thread(RobotRequest::Wake);
        self.shared.signal_change();
        StopInProgress { worker: self, generation }
    }

    /// Sets the board's latest known state to the emergency stop, because the board has confirmed one to the thread
    /// that sends emergency stops.
    pub(super) fn record_emergency_stop(&self) {
        self.update_state(|known| {
            if let Some(status) = &mut known.status {
                status.state = State::EmergencyStop;
            }
        });
    }

    /// Stores an unconfirmed stop on disk, or removes the stored stop if it is confirmed.
    pub(super) fn sync_stop_file(&self) {
        self.stop_file.sync(&self.signal);
        self.shared.signal_change();
    }

    /// Drops a stop that the board has not confirmed, at a person's request. A growth that the stop has not reached is
    /// paused once the robot is connected again, so that only an order of a person continues it.
    pub(super) fn withdraw_stop(&self) -> Result<(), RobotRequestError> {
        let robot = || self.name.clone();
        let Some((_, generation)) = self.signal.pending() else {
            return Err(RobotRequestError::NoStop { robot: robot() });
        };
        if self.stops_in_progress.load(Ordering::SeqCst) > 0 || !self.signal.confirm(generation) {
            return Err(RobotRequestError::StopInProgress { robot: robot() });
        }
        self.update_state(|known| match &known.commands {
            Some(commands) => commands.push(Command::Pause),
            None => known.pauses_on_reconnect = true,
        });
        self.pause_file.set(true);
        self.sync_stop_file();
        Ok(())
    }

    /// Records that the board has confirmed this stop.
    pub(super) fn confirm_stop(&self, generation: Generation) {
        // A newer stop stays, and is sent next.
        self.signal.confirm(generation);
        self.sync_stop_file();
    }

    /// Sends each unconfirmed stop to the board, and records its confirmation. This does not need a session. Returns
    /// false if no stop was sent, because all stops were confirmed before.
    pub(super) fn deliver_stop(&self, client: &mut Client) -> Result<bool, ClientError> {
        let mut is_stopped = false;
        while let Some((level, generation)) = self.signal.pending() {
            let outcome = match level {
                StopLevel::Stop => client.stop()?,
                StopLevel::EmergencyStop => client.emergency_stop().map(|()| StopOutcome::ByEmergencyStop)?,
            };
            is_stopped = true;
            self.lock_state().latest_stop = outcome;
            self.confirm_stop(generation);
        }
        Ok(is_stopped)
    }

    /// Voids all earlier orders if the board has changed to a stopped state or a fault without a stop of this service.
    pub(super) fn void_if_stopped_elsewhere(&self, state: State) {
        let is_off = |state| matches!(state, State::Stopped | State::EmergencyStop | State::Fault);
        let was_on = self.lock_state().status.as_ref().is_some_and(|status| !is_off(status.state));
        if was_on && is_off(state) && self.signal.level().is_none() {
            self.signal.void();
        }
    }
}

/// A stop whose caller waits for the board's confirmation. Until it is dropped, the stop cannot be withdrawn.
pub struct StopInProgress<'a> {
    worker: &'a RobotWorker,
    /// Number of the stop in the robot's stop signal.
    pub generation: Generation,
}

impl Drop for StopInProgress<'_> {
    fn drop(&mut self) {
        self.worker.stops_in_progress.fetch_sub(1, Ordering::SeqCst);
    }
}
