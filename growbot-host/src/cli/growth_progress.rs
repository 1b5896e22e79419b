//! Progress of a growth, which is shown on standard error.

use growbot_core::link::message::{PauseCause, State};
use growbot_host::progress::{Progress, ResultTiming};
use growbot_pictures::clock_text::local_clock_text;
use growbot_plan::clearance_guard::Detour;
use growbot_plan::job::Command;
use growbot_plan::run_log::{GrowthResult, RunEvent, RunLine};
use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;

/// States of the board whose beginning is shown.
const SHOWN: [State; 5] = [State::Heating, State::Homing, State::Growing, State::Paused, State::Parked];

/// Progress of a growth, of this program or of the service.
pub struct GrowthProgress {
    progress: Progress,
    layers: u32,
    /// Number of layers that the job had before the latest amendment.
    layers_before: u32,
    laid: u64,
    /// Expected date and time of the last layer.
    finish: Option<OffsetDateTime>,
    state: String,
    /// True if the emergency stop was sent, or if the button was pressed.
    pub emergency: bool,
    /// Latest printed reason why the board did not accept an amendment.
    not_amended: Option<String>,
    /// True if the robot waits for filament and the user was warned.
    is_out_of_filament: bool,
    /// Instructions for a robot that waits for filament.
    out_of_filament: &'static str,
    /// Date and time before which events are not shown, because they occurred before this program looked.
    since: Option<OffsetDateTime>,
    /// True while an event is ingested that is not shown.
    is_past: bool,
}

impl GrowthProgress {
    /// Creates the progress of a body with this number of layers, of which `laid` are laid.
    pub fn new(layers: u32, laid: u64, out_of_filament: &'static str) -> Self {
        Self {
            progress: Progress::start(Some(u64::from(layers)), ResultTiming::AtEnd),
            layers,
            layers_before: layers,
            laid,
            finish: None,
            state: "starting".to_owned(),
            emergency: false,
            not_amended: None,
            is_out_of_filament: false,
            out_of_filament,
            since: None,
            is_past: false,
        }
    }

    /// Does not show lines of a run log that were written before this moment.
    pub fn begin_now(mut self) -> Self {
        self.since = Some(OffsetDateTime::now_utc());
        self
    }

    /// Shows a line of a run log. Returns the result if it is the last line.
    pub fn ingest_line(&mut self, line: &str) -> Option<GrowthResult> {
        let RunLine { event, utc } = serde_json::from_str(line).ok()?;
        let written = utc.and_then(|utc| OffsetDateTime::parse(&utc, &Rfc3339).ok());
        if let RunEvent::End { result } = event {
            return Some(*result);
        }
        self.is_past = written.zip(self.since).is_some_and(|(written, since)| written < since);
        if !self.is_past && self.since.take().is_some() {
            // What happened before is shown by the present state alone.
            self.note(&self.state);
        }
        self.ingest(&event);
        self.is_past = false;
        None
    }

    /// Shows an event.
    pub fn ingest(&mut self, event: &RunEvent) {
        match event {
            RunEvent::State { state } => {
                self.set_state(state);
                self.finish = None;
                if SHOWN.iter().any(|shown| shown.name() == state) {
                    self.note(state);
                }
            }
            RunEvent::Status(status) => {
                let runs_out = status.pause_cause.as_deref() == Some(PauseCause::FilamentOut.code());
                if runs_out && !self.is_out_of_filament {
                    self.warn(self.out_of_filament);
                }
                self.is_out_of_filament = runs_out && !self.is_past;
                self.finish = status.finish_utc.as_ref().and_then(|time| OffsetDateTime::parse(time, &Rfc3339).ok());
                if let Some(state) = &status.state {
                    self.set_state(state);
                }
            }
            RunEvent::Amendment(amendment) => {
                self.layers_before = std::mem::replace(&mut self.layers, amendment.total);
            }
            RunEvent::AmendmentRejected { reason } => {
                self.layers = self.layers_before;
                if let Some(why) = reason.as_ref().filter(|why| self.not_amended.as_ref() != Some(why)) {
                    self.warn(&format!("{why}; the robot continues with the layers that it has"));
                    self.not_amended = Some(why.clone());
                }
            }
            RunEvent::Crash(_) => self.warn("the board's firmware crashed: `growbot status` shows where"),
            RunEvent::Command { command } => {
                self.emergency |= *command == Command::EmergencyStop;
                self.note(&format!("ordered: {}", command.name()));
            }
            RunEvent::Detour(Detour { from, clearance_mm, instead_of, .. }) => self.warn(&format!(
                "{instead_of}: from layer {from} on the body takes another path, which is {clearance_mm:.2} mm clear \
                 of obstacles"
            )),
            RunEvent::ClearanceViolation(too_near) => {
                self.warn(&format!("{too_near}; the robot pauses: stop the robot, and plan another body from here"));
            }
            RunEvent::CommandFailed { reason } => self.warn(reason),
            RunEvent::NoResponse => self.warn("the board does not respond: growbot tries again"),
            RunEvent::Reconnected => self.note("the board responds again"),
            RunEvent::Laid(laid) => self.laid = u64::from(laid.layer) + 1,
            RunEvent::Header(_)
            | RunEvent::Board(_)
            | RunEvent::EncoderReference(_)
            | RunEvent::LayersSent { .. }
            | RunEvent::Simulated(_)
            | RunEvent::Resumed(_)
            | RunEvent::End { .. } => {}
        }
        let Self { state, laid, layers, finish, .. } = self;
        self.progress.update(*laid, || {
            let done = finish.map_or_else(String::new, |finish| format!(", done at {}", local_clock_text(finish)));
            format!("{state}, layer {laid} of {layers}{done}")
        });
    }

    fn set_state(&mut self, state: &str) {
        self.emergency |= state == State::EmergencyStop.name();
        state.clone_into(&mut self.state);
    }

    /// Prints a note, even if a progress bar is shown.
    pub fn note(&self, words: &str) {
        if !self.is_past {
            self.progress.note(words);
        }
    }

    /// Prints a warning, even if a progress bar is shown.
    pub fn warn(&self, words: &str) {
        if !self.is_past {
            self.progress.warn(words);
        }
    }

    /// Ends the display.
    pub fn end(&self) {
        self.progress.finish();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_runout_of_the_past_is_reported_once_it_is_present() {
        let mut progress = GrowthProgress::new(9, 0, "out of filament").begin_now();
        let status = |utc: &str| {
            format!(r#"{{"event":"status","state":"paused","pause_cause":"filament-out","laid":4,"utc":"{utc}"}}"#)
        };
        assert!(progress.ingest_line(&status("2000-01-01T00:00:00.000Z")).is_none());
        assert!(!progress.is_out_of_filament && progress.since.is_some());
        assert_eq!(progress.state, "paused");
        progress.ingest_line(&status("2999-01-01T00:00:00.000Z"));
        assert!(progress.is_out_of_filament && progress.since.is_none());
    }
}
