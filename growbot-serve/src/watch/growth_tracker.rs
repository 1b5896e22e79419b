//! Tracks the state of a growth, and computes the part that a page has not yet received.

use std::time::Duration;

use growbot_client::port::time_since_boot;
use growbot_client::status::{ConnectionState, RobotStatus};
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::{LayerBytes, LayerEncoder};
use growbot_core::link::message::{State, Status, celsius};
use growbot_plan::hexadecimal::hex_of;
use growbot_plan::job::{Job, JobEvent};
use growbot_plan::run_clock::RunClock;
use growbot_plan::run_log::{BodyKind, GrowthResult};
use serde::Serialize;
use time::OffsetDateTime;

use super::heartbeat::status_age_s;

/// Maximum number of temperature readings that are kept, more than a chart draws. If there are more, every second
/// reading is dropped.
const MAX_READINGS: usize = 1024;

/// State of a growth as live pages show it.
pub struct GrowthTracker {
    period_s: f64,
    /// Status of the robot.
    robot: RobotStatus,
    /// Time of the board's latest report, since the start of this computer. `None` before the first report.
    reported: Option<Duration>,
    /// Layers of the job as commanded, as far as the host knows them.
    commanded: Vec<LayerBytes>,
    /// Number of layers of the job.
    total: usize,
    /// Layers that the latest amendment of the plan has replaced. They are restored if the board rejects the amendment.
    /// `None` without an amendment.
    replaced: Option<LayerReplacement>,
    /// Laid layers as built. A layer without an as-built report of the board is as commanded.
    built: Vec<LayerBytes>,
    readings: Vec<TemperaturePoint>,
    /// Number of times that every second reading was dropped.
    thinned: u32,
    clock: RunClock,
    /// Problem with this program's own files. `None` without a problem.
    warned: Option<String>,
    /// Number of layers at the beginning of `built` that are stored as a simulated tip has actually laid them.
    simulated: usize,
    /// Encoder of the layers that a simulated tip has laid. It carries the rounding errors of a layer over to the next
    /// layer.
    rounding: LayerEncoder,
    ended: Option<GrowthResult>,
}

/// Layers that an amendment has replaced.
struct LayerReplacement {
    /// Index of the first replaced layer.
    from: u32,
    /// Replaced layers.
    layers: Vec<LayerBytes>,
    /// Number of layers of the job before the amendment.
    total: usize,
}

/// A point of the nozzle's temperature curve: time, s; temperature, C; target temperature, C, or `None` while the
/// heater is off. In JSON it is an array of these three values.
#[derive(Debug, Clone, Copy, Serialize)]
struct TemperaturePoint(f64, f64, Option<f64>);

/// Changes since the last update that was sent to a page.
#[derive(Debug, Serialize)]
pub struct Update<'a> {
    /// Name of the board's state.
    state: &'a str,
    /// True if the board responds.
    board_responding: bool,
    /// Explanation of the state or the fault for users. `None` if the name of the state is clear enough.
    explanation: Option<&'a str>,
    /// Reason why the board rejected the latest command. `None` otherwise.
    command_error: Option<&'a str>,
    /// Problem with this program's own files. `None` without a problem.
    warning: Option<&'a str>,
    /// Title of the shown body if it is shown as a simulated tip has laid it, otherwise `None`.
    built_name: Option<&'static str>,
    /// Number of layers of the job.
    total_layers: usize,
    /// Time on the robot's clock that the remaining layers take, s.
    remaining_s: f64,
    /// Real time until the last layer, s. Null unless the robot grows at a known pace.
    finish_in_s: Option<f64>,
    layers: LayersUpdate,
    readings: NewReadings<'a>,
    /// Result of the growth. `None` before the growth has ended.
    result: Option<&'a GrowthResult>,
}

/// Layers that replace the layers of the page from the index `from` on.
#[derive(Debug, Serialize)]
struct LayersUpdate {
    from: usize,
    /// Layers in hexadecimal, 24 digits each.
    built: String,
}

/// Temperature readings that replace the readings of the page from the index `from` on.
#[derive(Debug, Serialize)]
struct NewReadings<'a> {
    from: usize,
    taken: &'a [TemperaturePoint],
}

/// The numbers of layers and readings of a growth that a page has received.
#[derive(Debug, Default)]
pub struct UpdateCursor {
    layers: usize,
    /// Number of layers that the page has received as a simulated tip has actually laid them.
    simulated: usize,
    readings: usize,
    thinned: u32,
    /// True if the page has received the result of the growth.
    pub ended: bool,
}

impl GrowthTracker {
    /// Creates the state of a growth that is about to start, or to be resumed after the `known` layers, which are
    /// already built. `robot` is the part of the robot's status that its board does not report.
    pub fn new(job: &Job, known: &[Option<LayerBytes>], robot: RobotStatus) -> Self {
        Self {
            period_s: job.robot.description().layer.period_s,
            robot: RobotStatus { connection: ConnectionState::Busy, ..robot },
            reported: None,
            commanded: job.layers.clone(),
            total: job.layers.len(),
            replaced: None,
            built: known.iter().zip(&job.layers).map(|(built, commanded)| built.unwrap_or(*commanded)).collect(),
            readings: Vec::new(),
            thinned: 0,
            clock: RunClock::default(),
            warned: None,
            simulated: 0,
            rounding: LayerEncoder::default(),
            ended: None,
        }
    }

    /// Updates the state with an event of the growth.
    pub fn ingest(&mut self, event: &JobEvent) {
        if matches!(event, JobEvent::Board(_) | JobEvent::Status(_) | JobEvent::State(_) | JobEvent::Laid { .. }) {
            self.reported = Some(time_since_boot());
        }
        match event {
            JobEvent::Board(board) => {
                self.robot.set_board(board);
                self.record_status(&board.status);
            }
            JobEvent::State(state) => self.record_state(*state),
            JobEvent::Status(status) => self.record_status(status),
            JobEvent::Laid { index, as_built, .. } => self.record_layer(*index as usize, *as_built),
            JobEvent::Amendment(amendment) => {
                let from = self.commanded.len().min(amendment.from as usize);
                let layers = self.commanded.split_off(from);
                self.replaced = Some(LayerReplacement { from: from as u32, layers, total: self.total });
                self.replace(amendment.from, &amendment.layers);
                self.total = amendment.total as usize;
            }
            JobEvent::AmendmentRejected(_) => {
                if let Some(before) = self.replaced.take() {
                    self.replace(before.from, &before.layers);
                    self.total = before.total;
                }
            }
            JobEvent::LayersSent { from, layers } => self.replace(*from, layers),
            JobEvent::CommandFailed(why) => self.robot.command_error = Some(why.clone()),
            JobEvent::Command(_) => self.robot.command_error = None,
            JobEvent::NoResponse => self.robot.connection = ConnectionState::Disconnected,
            JobEvent::Reconnected => self.robot.connection = ConnectionState::Busy,
            JobEvent::Simulated { from, layers } => self.record_simulated_layers(*from as usize, layers),
            JobEvent::ClearanceViolation(too_near) => self.robot.command_error = Some(too_near.to_string()),
            JobEvent::EncoderReference(_) | JobEvent::Crash(_) | JobEvent::Detour(_) => {}
        }
    }

    /// Returns the status of the robot.
    pub fn status(&self) -> RobotStatus {
        let mut robot = self.robot.clone();
        robot.set_age(self.reported.map(|reported| status_age_s(reported, robot.pace)));
        robot
    }

    /// Sets or clears the problem with this program's own files.
    pub fn set_warning(&mut self, words: Option<String>) {
        self.warned = words;
    }

    /// Sets the result of the growth.
    pub fn end(&mut self, result: GrowthResult) {
        self.ended = Some(result);
    }

    /// Returns the changes that the page with this cursor has not received yet, and updates the cursor. The layers and
    /// readings replace those of the page from the given index on.
    pub fn update_for(&self, seen: &mut UpdateCursor) -> Update<'_> {
        if seen.thinned != self.thinned {
            (seen.readings, seen.thinned) = (0, self.thinned);
        }
        // The layers that a simulated tip has laid replace those that were commanded.
        if self.simulated > seen.simulated {
            seen.layers = seen.layers.min(seen.simulated);
        }
        let layers = self.built.get(seen.layers..).unwrap_or_default();
        let readings = self.readings.get(seen.readings..).unwrap_or_default();
        let update = Update {
            state: self.robot.state.as_deref().unwrap_or("starting"),
            board_responding: self.robot.connection != ConnectionState::Disconnected,
            explanation: self.explanation(),
            command_error: self.robot.command_error.as_deref(),
            warning: self.warned.as_deref(),
            built_name: (self.simulated > 0).then(|| BodyKind::Laid.title()),
            total_layers: self.total,
            remaining_s: self.remaining_s(),
            finish_in_s: self.finish_in_s(),
            layers: LayersUpdate { from: seen.layers, built: hex_of(layers) },
            readings: NewReadings { from: seen.readings, taken: readings },
            result: self.ended.as_ref(),
        };
        (seen.layers, seen.readings, seen.ended) = (self.built.len(), self.readings.len(), self.ended.is_some());
        seen.simulated = self.simulated;
        update
    }

    /// Returns an explanation of the state or the fault for users. `None` if the name of the state is clear enough.
    fn explanation(&self) -> Option<&str> {
        match self.robot.state.as_deref() {
            _ if self.robot.fault.is_some() => self.robot.fault_explanation.as_deref(),
            Some("paused") => self.robot.pause_explanation.as_deref(),
            Some("parked") => Some("the heater was switched off after a long pause: Continue heats and homes first"),
            Some("emergency-stop") => Some("the robot stays off until the emergency stop is cleared"),
            _ => None,
        }
    }

    /// Returns the time on the robot's clock that the remaining layers take, s.
    fn remaining_s(&self) -> f64 {
        self.total.saturating_sub(self.built.len()) as f64 * self.period_s
    }

    /// Returns the real time until the last layer, s. `None` unless the robot grows at a known pace.
    fn finish_in_s(&self) -> Option<f64> {
        let is_growing = self.robot.state.as_deref() == Some(State::Growing.name());
        self.robot.pace.filter(|_| is_growing).map(|pace| self.remaining_s() / pace)
    }

    /// Handles a change of the board's state. A pause or a fault is not shown yet, because its cause is only in the
    /// board's next status.
    fn record_state(&mut self, state: State) {
        if !matches!(state, State::Paused | State::Fault) {
            self.robot.set_state(state);
        }
    }

    fn record_status(&mut self, status: &Status) {
        self.robot.set_status(status);
        let utc = OffsetDateTime::now_utc();
        let left = self.finish_in_s().and_then(time::Duration::checked_seconds_f64);
        self.robot.set_finish(left.and_then(|left| utc.checked_add(left)), utc);
        self.clock.set_uptime(status.uptime_ms);
        let now = self.clock.now() as f64 / 1000.0;
        if let Some(temperature) = status.temperature_centi_c {
            self.readings.push(TemperaturePoint(now, celsius(temperature), status.target_centi_c.map(celsius)));
        }
        if self.readings.len() > MAX_READINGS {
            let mut index = 0;
            self.readings.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.thinned += 1;
        }
    }

    fn record_layer(&mut self, index: usize, as_built: Option<LayerBytes>) {
        // A layer may be reported again after a resumption. The first report stays.
        if index < self.built.len() {
            return;
        }
        self.robot.laid = u32::try_from(index + 1).unwrap_or(u32::MAX);
        self.built.extend_from_slice(self.commanded.get(self.built.len()..index).unwrap_or_default());
        self.built.extend(as_built.or_else(|| self.commanded.get(index).copied()));
    }

    /// Replaces the layers from the index `from` on by these layers, which a simulated tip has actually laid.
    fn record_simulated_layers(&mut self, from: usize, layers: &[Layer]) {
        for (index, layer) in (from..).zip(layers) {
            let layer = self.rounding.encode(layer);
            match self.built.get_mut(index) {
                Some(built) => *built = layer,
                None => self.built.push(layer),
            }
        }
        self.simulated = self.simulated.max(from + layers.len());
    }

    fn replace(&mut self, from: u32, layers: &[LayerBytes]) {
        self.commanded.truncate(from as usize);
        self.commanded.extend_from_slice(layers);
    }
}

#[cfg(test)]
mod tests {
    use growbot_core::link::message::{Fault, PauseCause};
    use growbot_core::path::{Segment, end};
    use growbot_core::pose::Pose;
    use growbot_plan::job::Amendment;
    use growbot_plan::run_log::OutcomeKind;
    use serde_json::{Value, json};

    use super::*;

    fn update_of(watched: &GrowthTracker, seen: &mut UpdateCursor) -> Value {
        serde_json::to_value(watched.update_for(seen)).unwrap()
    }

    fn watched(known: &[Option<LayerBytes>]) -> GrowthTracker {
        let robot = growbot_plan::robot_file::load("growbot-a".as_ref()).unwrap();
        let path = [Segment::Straight { length: 7.0 }];
        let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
        let goal = Pose::from_frame(&end(&path, &start.frame()));
        GrowthTracker::new(&Job::new(&robot, &start, &goal, &path), known, RobotStatus::default())
    }

    fn status(uptime_ms: u64) -> JobEvent {
        JobEvent::Status(Status {
            state: State::Growing,
            fault: None,
            temperature_centi_c: Some(20_050),
            target_centi_c: None,
            duty: 0,
            plan_id: 1,
            layer_count: 10,
            next_layer: 10,
            layers_laid: 0,
            interrupted: None,
            pause_cause: PauseCause::LayersExhausted,
            is_resumable: true,
            uptime_ms,
        })
    }

    #[test]
    fn a_page_gets_each_update_once_and_a_new_page_gets_all() {
        let mut watched = watched(&[Some([7; 12]), None]);
        let total = watched.total;
        let mut seen = UpdateCursor::default();
        let first = update_of(&watched, &mut seen);
        assert_eq!(first["layers"]["built"].as_str().unwrap().len(), 2 * 24);
        assert_eq!((&first["state"], &first["total_layers"]), (&json!("starting"), &json!(total)));
        watched.ingest(&JobEvent::Laid { index: 1, as_built: Some([9; 12]), measured: None });
        watched.ingest(&JobEvent::Laid { index: 2, as_built: Some([1; 12]), measured: None });
        watched.ingest(&JobEvent::Laid { index: 4, as_built: None, measured: None });
        watched.ingest(&status(1000));
        let second = update_of(&watched, &mut seen);
        let commanded = hex_of(&watched.commanded[3..5]);
        assert_eq!(second["layers"], json!({ "from": 2, "built": format!("{}{commanded}", hex_of(&[[1; 12]])) }));
        assert_eq!(second["readings"], json!({ "from": 0, "taken": [[0.0, 200.5, null]] }));
        assert_eq!(second["remaining_s"], json!((total - 5) as f64 * 18.0));
        let third = update_of(&watched, &mut seen);
        assert_eq!((&third["layers"]["built"], &third["readings"]["taken"]), (&json!(""), &json!([])));
        let anew = update_of(&watched, &mut UpdateCursor::default());
        assert_eq!(anew["layers"]["built"].as_str().unwrap().len(), 5 * 24);
    }

    #[test]
    fn finish_time_is_sent_only_while_growing_at_a_known_pace() {
        let mut watched = watched(&[]);
        let left_s = watched.total as f64 * 18.0;
        let finish = |watched: &GrowthTracker| update_of(watched, &mut UpdateCursor::default())["finish_in_s"].clone();
        watched.ingest(&status(0));
        assert_eq!(finish(&watched), Value::Null, "the pace is not known");
        watched.robot.pace = Some(60.0);
        assert_eq!(finish(&watched), json!(left_s / 60.0));
        watched.ingest(&JobEvent::State(State::Parked));
        assert_eq!(finish(&watched), Value::Null, "it waits");
    }

    #[test]
    fn thinned_readings_are_resent_and_time_continues_over_a_restart() {
        let mut watched = watched(&[]);
        let mut seen = UpdateCursor::default();
        for second in 0..MAX_READINGS as u64 {
            watched.ingest(&status(1000 * second));
        }
        update_of(&watched, &mut seen);
        watched.ingest(&status(0));
        let update = update_of(&watched, &mut seen);
        let taken = update["readings"]["taken"].as_array().unwrap();
        assert_eq!((update["readings"]["from"].as_u64(), taken.len()), (Some(0), MAX_READINGS / 2 + 1));
        assert_eq!((taken[1][0].as_f64(), taken.last().unwrap()[0].as_f64()), (Some(2.0), Some(1023.0)));
    }

    #[test]
    fn a_refused_amendment_is_reverted() {
        let mut watched = watched(&[]);
        let (commanded, total) = (watched.commanded.clone(), watched.total);
        watched.ingest(&JobEvent::Amendment(Amendment { plan_id: 2, from: 1, total: 20, layers: vec![[5; 12]; 2] }));
        assert_eq!((watched.commanded.len(), watched.total), (3, 20));
        watched.ingest(&JobEvent::AmendmentRejected(None));
        assert!(watched.commanded == commanded && watched.total == total);
    }

    #[test]
    fn simulated_layers_replace_commanded_ones() {
        let mut watched = watched(&[]);
        let mut seen = UpdateCursor::default();
        watched.ingest(&JobEvent::Laid { index: 0, as_built: Some([7; 12]), measured: None });
        watched.ingest(&JobEvent::Laid { index: 1, as_built: Some([8; 12]), measured: None });
        assert_eq!(update_of(&watched, &mut seen)["built_name"], json!(null));
        let layer = Layer { alpha: 1.0, height: 0.5, tilt: 0.003 };
        watched.ingest(&JobEvent::Simulated { from: 0, layers: vec![layer] });
        let update = update_of(&watched, &mut seen);
        let expected = hex_of(&[LayerEncoder::default().encode(&layer), [8; 12]]);
        assert_eq!(
            (&update["built_name"], &update["layers"]),
            (&json!("Laid (simulated)"), &json!({ "from": 0, "built": expected }))
        );
        assert_eq!(update_of(&watched, &mut seen)["layers"]["from"], 2);
    }

    #[test]
    fn a_log_failure_is_reported_until_it_recovers() {
        let mut watched = watched(&[]);
        watched.set_warning(Some("disk full".to_owned()));
        watched.ingest(&JobEvent::Command(growbot_plan::job::Command::Pause));
        assert_eq!(update_of(&watched, &mut UpdateCursor::default())["warning"], "disk full");
        watched.set_warning(None);
        assert_eq!(update_of(&watched, &mut UpdateCursor::default())["warning"], Value::Null);
    }

    #[test]
    fn a_fault_is_explained() {
        let mut watched = watched(&[]);
        let JobEvent::Status(mut status) = status(0) else { unreachable!() };
        (status.state, status.fault) = (State::Fault, Some(Fault::OverTemperature));
        watched.ingest(&JobEvent::Status(status));
        let update = update_of(&watched, &mut UpdateCursor::default());
        assert_eq!(
            (&update["state"], &update["explanation"]),
            (&json!("fault"), &json!(Fault::OverTemperature.explanation()))
        );
    }

    /// The board's event of a new state arrives before the status that contains the cause of the state.
    #[test]
    fn a_state_is_displayed_only_with_its_explanation() {
        let shown = |watched: &GrowthTracker| {
            let update = update_of(watched, &mut UpdateCursor::default());
            (update["state"].clone(), update["explanation"].clone())
        };
        let mut watched = watched(&[]);
        watched.ingest(&status(0));
        let JobEvent::Status(growing) = status(1) else { unreachable!() };
        let pause = |pause_cause| Status { state: State::Paused, pause_cause, ..growing.clone() };
        for waits in [PauseCause::Requested, PauseCause::HostSilent] {
            watched.ingest(&JobEvent::State(State::Paused));
            assert_eq!(shown(&watched), (json!("growing"), Value::Null), "not yet known why");
            watched.ingest(&JobEvent::Status(pause(waits)));
            assert_eq!(shown(&watched), (json!("paused"), json!(waits.explanation())));
            watched.ingest(&JobEvent::State(State::Growing));
            assert_eq!(shown(&watched), (json!("growing"), Value::Null));
        }
        watched.ingest(&JobEvent::State(State::Fault));
        assert_eq!(shown(&watched), (json!("growing"), Value::Null), "not yet known which");
        let fault = Status { state: State::Fault, fault: Some(Fault::FilamentOut), ..growing };
        watched.ingest(&JobEvent::Status(fault));
        assert_eq!(shown(&watched), (json!("fault"), json!(Fault::FilamentOut.explanation())));
        watched.ingest(&JobEvent::State(State::Idle));
        assert_eq!(shown(&watched), (json!("idle"), Value::Null), "a fault that was cleared is not told any more");
    }

    #[test]
    fn amended_layers_stand_in_for_unknown_ones() {
        let mut watched = watched(&[]);
        watched.ingest(&JobEvent::Amendment(Amendment { plan_id: 2, from: 1, total: 20, layers: vec![[5; 12]; 2] }));
        watched.ingest(&JobEvent::LayersSent { from: 3, layers: vec![[6; 12]] });
        watched.ingest(&JobEvent::Laid { index: 3, as_built: None, measured: None });
        assert_eq!(watched.built[1..], [[5; 12], [5; 12], [6; 12]]);
        let update = update_of(&watched, &mut UpdateCursor::default());
        assert_eq!(update["total_layers"], 20);
        watched.end(serde_json::from_value(json!({ "outcome": "stopped" })).unwrap());
        assert_eq!(watched.ended.unwrap().outcome, OutcomeKind::Stopped);
    }
}
