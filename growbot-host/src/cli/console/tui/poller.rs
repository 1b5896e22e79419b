//! Follows a board while the screen is shown: lets time pass on `sim`, receives events and requests the status.

use std::time::{Duration, Instant};

use growbot_client::client::{Client, ClientError};
use growbot_plan::robot_kind::RobotKind;

use super::model::ConsoleModel;
use crate::cli::growth_monitor::clock_drift_failure;
use crate::cli::port_arg::SelectedPort;
use crate::cli::remedies;

/// Interval of status requests to a real board.
const STATUS_INTERVAL: Duration = Duration::from_millis(500);
/// Interval of sensor requests.
const SENSORS: Duration = Duration::from_secs(2);
/// Interval of requests to a board that does not respond.
const LOST: Duration = Duration::from_secs(3);
/// Time to wait for an event of a real board.
const EVENT: Duration = Duration::from_millis(10);
/// Step of time on `sim` between two status requests. If `sim` runs fast, the step is longer, as [`LOOKS`] requires.
const VIRTUAL_STEP: Duration = Duration::from_secs(2);
/// Maximum number of steps of time on `sim` in one call of [`BoardPoller::follow`].
const LOOKS: u32 = 20;
/// Maximum time to compute `sim` or to receive events before the keys are read again.
const COMPUTE: Duration = Duration::from_millis(200);
/// Possible speeds of `sim`, in multiples of real time. The fifth is the initial one.
const SPEEDS: [u32; 9] = [1, 3, 10, 30, 60, 200, 600, 2_000, 6_000];

/// Change of the speed of `sim`.
#[derive(Debug, Clone, Copy)]
pub enum SpeedChange {
    /// To the next faster speed.
    Faster,
    /// To the next slower speed.
    Slower,
}

/// Follows a board for the screen: requests its status and its sensors, and receives its events.
pub struct BoardPoller {
    client: Client,
    kind: RobotKind,
    /// Index of the speed of the virtual clock in [`SPEEDS`]. `None` for a board that runs by its own clock.
    pace: Option<usize>,
    /// The board's clock at the latest status request, ms.
    latest_ms: u64,
    last_request: Option<Instant>,
    sensed: Option<Instant>,
}

impl BoardPoller {
    /// Creates a poller of the board at this port. The time of a board with a virtual clock passes only in
    /// [`BoardPoller::follow`].
    pub fn new(client: Client, port: &SelectedPort) -> Self {
        Self {
            client,
            kind: port.kind(),
            pace: port.name().is_virtual().then_some(4),
            latest_ms: 0,
            last_request: None,
            sensed: None,
        }
    }

    /// Returns the client of the board.
    pub fn client(&mut self) -> &mut Client {
        &mut self.client
    }

    /// Returns the speed of the virtual clock in multiples of real time. `None` for a board that runs by its own
    /// clock.
    pub fn speed(&self) -> Option<f64> {
        self.factor().map(f64::from)
    }

    fn factor(&self) -> Option<u32> {
        self.pace.and_then(|index| SPEEDS.get(index)).copied()
    }

    /// Selects the next faster or slower speed of `sim`. Returns false if the speed stays as it is.
    pub fn change_speed(&mut self, change: SpeedChange) -> bool {
        let Some(speed) = &mut self.pace else { return false };
        let next = match change {
            SpeedChange::Faster => speed.saturating_add(1),
            SpeedChange::Slower => speed.wrapping_sub(1),
        };
        let there = next < SPEEDS.len();
        if there {
            *speed = next;
        }
        there
    }

    /// Receives the board's events, requests status and sensors when they are due, and updates the model. On `sim` it
    /// also lets time pass. `passed` is the real time since the previous call.
    pub fn follow(&mut self, model: &mut ConsoleModel, passed: Duration) {
        let due = |last_request: Option<Instant>, every| last_request.is_none_or(|at| at.elapsed() >= every);
        if model.link_error.is_some() && !due(self.last_request, LOST) {
            return;
        }
        let done = match self.factor() {
            Some(factor) => self.let_pass(model, passed * factor),
            None => self.listen(model, due(self.last_request, STATUS_INTERVAL)),
        };
        let done = done.and_then(|()| {
            if due(self.sensed, SENSORS) {
                model.sensors = Some(self.client.sensors()?);
                self.sensed = Some(Instant::now());
            }
            Ok(())
        });
        if let Err(error) = done {
            self.last_request = Some(Instant::now());
            model.apply_loss(&remedies::message(&error));
        }
    }

    fn listen(&mut self, model: &mut ConsoleModel, ask: bool) -> Result<(), ClientError> {
        let began = Instant::now();
        while let Some(event) = self.client.event(EVENT)? {
            model.apply_event(&event);
            if began.elapsed() > COMPUTE {
                break;
            }
        }
        if ask { self.poll_status(model).map(drop) } else { Ok(()) }
    }

    fn let_pass(&mut self, model: &mut ConsoleModel, time: Duration) -> Result<(), ClientError> {
        let began = Instant::now();
        let mut now = self.poll_status(model)?;
        let until = now.saturating_add(time.as_millis() as u64);
        let step = VIRTUAL_STEP.max(time / LOOKS);
        while now < until && began.elapsed() < COMPUTE {
            if let Some(event) = self.client.event(step.min(Duration::from_millis(until - now)))? {
                model.apply_event(&event);
            }
            let before = now;
            now = self.poll_status(model)?;
            if now < before {
                // The board has restarted, and its clock with it.
                break;
            }
        }
        Ok(())
    }

    /// Requests the board's status and applies it. Returns the board's clock, ms.
    fn poll_status(&mut self, model: &mut ConsoleModel) -> Result<u64, ClientError> {
        self.last_request = Some(Instant::now());
        let mut status = self.client.status()?;
        if status.uptime_ms < self.latest_ms {
            // The board has restarted, and does not know the session.
            status = self.client.open_session()?.status;
            model.log("the board has restarted");
        }
        self.latest_ms = status.uptime_ms;
        model.apply_status(status);
        if let Some(drift) = self.client.stop_if_clock_drifts()? {
            model.log_error(clock_drift_failure(&drift, self.kind).message());
        }
        Ok(self.latest_ms)
    }
}
