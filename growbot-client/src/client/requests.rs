//! Requests to a board: status, stop, clearing of faults, maintenance, sensors, the latest fault and crash.

use std::time::Duration;

use growbot_core::link::message::{
    BootReport, Cancel, Empty, EnergizingRequest, FaultRecord, LatestFault, Maintain, MaintenanceTask, Message,
    PassiveRequest, ReadLayers, Refusal, SensorReadings, State, Status, Tune,
};
use growbot_plan::clock_drift::ClockDrift;

use super::clock::{ClockSample, ClockWatch};
use super::{Client, ClientError};
use crate::maintenance::request_name;
use crate::robot_command::{CommandOutcome, StopOutcome};
use crate::stop_signal::Permit;

/// Maximum number of retries of a request to clear the emergency stop. After an emergency stop by the link, the board
/// refuses this request for up to 20 ms.
const MAX_LOOKS_AT_RELEASE: u32 = 6;
/// Time between two retries of a request to clear the emergency stop.
const LOOK_AT_RELEASE: Duration = Duration::from_millis(50);

impl Client {
    /// Requests the status of the board. Also uses the response to compare the board's clock with the port's.
    ///
    /// # Errors
    /// Like [`Client::request`].
    pub fn status(&mut self) -> Result<Status, ClientError> {
        let what = "the request for its status";
        let sent = self.port.now();
        match self.request(what, &PassiveRequest::GetStatus(Empty {}))? {
            Message::Status(status) => {
                if self.port.has_comparable_clock() {
                    self.clocks.take(&ClockSample { board_ms: status.uptime_ms, sent, received: self.port.now() });
                }
                Ok(status)
            }
            other => Err(ClientError::Unexpected { request: what, kind: other.kind() }),
        }
    }

    /// Checks that this client's session is still open on the board. If so, it was also open at the time of earlier
    /// responses, because a session that has ended is never opened again.
    ///
    /// # Errors
    /// Like [`Client::request`]. [`Refusal::NoSession`] if the session has ended.
    pub fn check_session(&mut self) -> Result<(), ClientError> {
        // The board accepts this request only in the open session. No layer has this index, so the response is short.
        self.request("the request for its session", &PassiveRequest::ReadLayers(ReadLayers { first: u32::MAX }))
            .map(drop)
    }

    /// Reports whether events have arrived that [`Client::event`] has not returned yet.
    pub fn has_events(&self) -> bool {
        !self.events.is_empty()
    }

    /// Stops the board by a request, after which its body can be resumed. If the board does not respond to the request,
    /// sends the emergency stop.
    ///
    /// # Errors
    /// [`ClientError::Refused`]. [`ClientError::StopNotAcknowledged`] if it is unknown whether the board has stopped.
    /// The robot's power must then be cut.
    pub fn stop(&mut self) -> Result<StopOutcome, ClientError> {
        match self.request("the request to stop", &PassiveRequest::Stop(Empty {})) {
            Ok(_) => Ok(StopOutcome::ByRequest),
            Err(error @ ClientError::Refused { .. }) => Err(error),
            Err(_) => self.emergency_stop().map(|()| StopOutcome::ByEmergencyStop),
        }
    }

    /// Clears a fault or an emergency stop, after which the board accepts jobs again. The board refuses this for some
    /// milliseconds after an emergency stop by the link, and while its emergency-stop button is pressed, so the request
    /// is retried for 0.3 s.
    ///
    /// # Errors
    /// Like [`Client::request`].
    pub fn clear_fault(&mut self, permit: &Permit) -> Result<(), ClientError> {
        let (what, request) = ("the request to clear the fault", EnergizingRequest::ClearFault(Empty {}));
        for _ in 0..MAX_LOOKS_AT_RELEASE {
            match self.energize(what, &request, permit) {
                Err(ClientError::Refused { refusal: Refusal::EmergencyStop, .. }) => self.wait(LOOK_AT_RELEASE)?,
                done => return done.map(drop),
            }
        }
        self.energize(what, &request, permit).map(drop)
    }

    /// Stops the board if its clock runs at another rate than the port's clock, according to the responses to
    /// [`Client::status`]. Sends a request to stop, after which the body can be resumed, or else the emergency stop.
    /// Returns the error of the clock. `None` while the clocks agree or cannot be compared.
    ///
    /// # Errors
    /// [`ClientError::StopNotAcknowledged`] if it is unknown whether the board has stopped. The robot's power must then
    /// be cut.
    pub fn stop_if_clock_drifts(&mut self) -> Result<Option<ClockDrift>, ClientError> {
        let Some(drift) = self.clocks.drift() else { return Ok(None) };
        if self.request("the request to stop", &PassiveRequest::Stop(Empty {})).is_err() {
            self.emergency_stop()?;
        }
        // If the board is started again, its clock is compared again from the beginning.
        self.clocks = ClockWatch::default();
        Ok(Some(drift))
    }

    /// Reports whether the status should be requested now for the comparison of the clocks.
    pub fn clock_sample_due(&self) -> bool {
        self.port.has_comparable_clock() && self.clocks.wants(self.port.now())
    }

    /// Starts a maintenance task on the board. The permit must be valid, except for cooling down.
    ///
    /// # Errors
    /// Like [`Client::energize`].
    pub fn maintain(&mut self, task: MaintenanceTask, permit: &Permit) -> Result<CommandOutcome, ClientError> {
        let what = request_name(task);
        match task {
            MaintenanceTask::CoolDown => self.request(what, &PassiveRequest::CoolDown),
            task => self.energize(what, &EnergizingRequest::Maintain(Maintain { task }), permit),
        }
        .map(|_| CommandOutcome::Task(task))
    }

    /// Starts the tuning of the heater at a temperature, degrees Celsius. The board reports the gains with the event
    /// [`Message::Tuned`].
    ///
    /// # Errors
    /// Like [`Client::energize`].
    pub fn tune(&mut self, target_c: f64, permit: &Permit) -> Result<CommandOutcome, ClientError> {
        let request = EnergizingRequest::Tune(Tune { target_centi_c: (target_c * 100.0).round() as i32 });
        self.energize("the request to tune", &request, permit)?;
        Ok(CommandOutcome::TuningStarted { target_c })
    }

    /// Discards the body that the board stores, and switches heater and steppers off.
    ///
    /// # Errors
    /// Like [`Client::request`].
    pub fn cancel(&mut self) -> Result<CommandOutcome, ClientError> {
        let Status { plan_id, layers_laid: laid, .. } = self.status()?;
        self.request("the request to discard the body", &PassiveRequest::Cancel(Cancel { plan_id }))?;
        Ok(if plan_id == 0 { CommandOutcome::NothingToCancel } else { CommandOutcome::Cancelled { plan_id, laid } })
    }

    /// Clears a fault or an emergency stop, if there is one.
    ///
    /// # Errors
    /// Like [`Client::clear_fault`].
    pub fn clear(&mut self, permit: &Permit) -> Result<CommandOutcome, ClientError> {
        let state = self.status()?.state;
        self.clear_fault(permit)?;
        let is_off = matches!(state, State::Fault | State::EmergencyStop);
        Ok(if is_off { CommandOutcome::Cleared(state) } else { CommandOutcome::NothingToClear(state) })
    }

    /// Requests the current readings of the board's sensors.
    ///
    /// # Errors
    /// Like [`Client::request`].
    pub fn sensors(&mut self) -> Result<SensorReadings, ClientError> {
        let what = "the request for its sensor readings";
        match self.request(what, &PassiveRequest::GetSensorReadings(Empty {}))? {
            Message::SensorReadings(readings) => Ok(readings),
            other => Err(ClientError::Unexpected { request: what, kind: other.kind() }),
        }
    }

    /// Requests the record of the board's latest fault, whether it is cleared or not. `None` if no fault is recorded.
    ///
    /// # Errors
    /// Like [`Client::request`].
    pub fn latest_fault(&mut self) -> Result<Option<FaultRecord>, ClientError> {
        let what = "the request for its latest fault";
        match self.request(what, &PassiveRequest::GetLatestFault(Empty {}))? {
            Message::LatestFault(LatestFault { record }) => Ok(record),
            other => Err(ClientError::Unexpected { request: what, kind: other.kind() }),
        }
    }

    /// Requests the board's boot report: whether the firmware's image is intact, and the latest crash.
    ///
    /// # Errors
    /// Like [`Client::request`].
    pub fn boot_report(&mut self) -> Result<BootReport, ClientError> {
        let what = "the request for the cause of its start";
        match self.request(what, &PassiveRequest::GetBootReport(Empty {}))? {
            Message::BootReport(report) => Ok(report),
            other => Err(ClientError::Unexpected { request: what, kind: other.kind() }),
        }
    }
}
