//! Tuning of the heater of a robot, which its board reports with an event.

use std::time::Duration;

use growbot_client::client::{Client, ClientError};
use growbot_client::command_report::TuningReport;
use growbot_client::robot_command::CommandOutcome;
use growbot_client::stop_signal::Permit;
use growbot_core::link::message::{Message, State};

use super::robot_worker::RobotWorker;

/// Number of status requests after a tuning within which the gains must have been reported.
const MAX_POLLS_AFTER_TUNING: u32 = 20;

impl RobotWorker {
    /// Follows the tuning of a board that was connected in this state. The service may have been started again
    /// meanwhile. If a tuning has ended without a connection, its gains are lost, and the next status requests notice
    /// that.
    pub(super) fn follow_tuning(&self, state: State) {
        self.update_state(|known| {
            let follows = state == State::Tuning || known.polls_after_tuning.is_some();
            known.polls_after_tuning = follows.then_some(0);
        });
    }

    /// Starts a tuning at this temperature, degrees Celsius.
    pub(super) fn start_tuning(
        &self,
        client: &mut Client,
        target_c: f64,
        permit: &Permit,
    ) -> Result<CommandOutcome, ClientError> {
        // The gains of an earlier tuning may still be among the events.
        self.record_gains(client, None)?;
        let started = client.tune(target_c, permit)?;
        self.update_state(|known| {
            (known.tuning, known.polls_after_tuning, known.command_error) = (None, Some(0), None);
        });
        Ok(started)
    }

    /// Records the gains of a tuning, if they are among the events that the board has sent. `first` is the first one.
    pub(super) fn record_gains(&self, client: &mut Client, first: Option<Message>) -> Result<(), ClientError> {
        let mut next = first.map_or_else(|| client.event(Duration::ZERO), |first| Ok(Some(first)))?;
        while let Some(event) = next {
            if let Message::Tuned(tuned) = event {
                let report = TuningReport::new(&tuned, self.is_simulated().into());
                self.update_state(|known| {
                    (known.tuning, known.polls_after_tuning, known.command_error) = (Some(report), None, None);
                });
            }
            next = client.event(Duration::ZERO)?;
        }
        Ok(())
    }

    /// Ends a tuning whose gains have not been reported some time after the board has left its state. A stop or a fault
    /// explains itself.
    pub(super) fn end_tuning(&self, state: State) {
        let Some(polls) = self.lock_state().polls_after_tuning else { return };
        match state {
            State::Tuning => {}
            State::Idle if polls < MAX_POLLS_AFTER_TUNING => {
                self.lock_state().polls_after_tuning = Some(polls + 1);
            }
            State::Idle => self.update_state(|known| {
                known.polls_after_tuning = None;
                known.command_error = Some("the gains of the heater were lost: tune it again".to_owned());
            }),
            _ => self.update_state(|known| known.polls_after_tuning = None),
        }
    }
}
