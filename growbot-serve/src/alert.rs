//! Conditions of a robot that cause notices. The database stores those that were reported last, so that each is
//! reported once.

use growbot_core::link::message::{Fault, PauseCause, ResetCause, State, Status};
use rusqlite::{Connection, OptionalExtension};

use super::notification::{Notification, NotificationChannel, NotificationContext, NotificationEvent};

/// Conditions of a robot that this process has recorded last.
#[derive(Default)]
pub(super) struct LastAlerts {
    pub state: Option<AlertState>,
    pub is_connected: Option<bool>,
}

/// Conditions of a robot, read from its status, that cause notices.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct AlertState {
    fault: Option<Fault>,
    /// Cause of a pause that a user has to end, and the number of laid layers. `None` without such a pause.
    pause: Option<(PauseCause, u32)>,
    /// Number of laid layers of a parked robot. `None` if it is not parked.
    parked: Option<u32>,
    has_emergency_stop: bool,
}

impl AlertState {
    pub fn from_status(status: &Status) -> Self {
        let pauses = matches!(status.state, State::Paused | State::Parked);
        // The robot ends a pause by itself if it waits for layers or for its host.
        let waits_for_people = matches!(status.pause_cause, PauseCause::Requested | PauseCause::FilamentOut);
        Self {
            fault: status.fault,
            pause: (pauses && waits_for_people).then_some((status.pause_cause, status.layers_laid)),
            parked: (status.state == State::Parked).then_some(status.layers_laid),
            has_emergency_stop: status.state == State::EmergencyStop,
        }
    }

    /// Returns an alert for each kind of condition: fault, pause, parking and emergency stop. Its notice is sent only
    /// if the condition is new.
    pub fn alerts(&self, about: &NotificationContext) -> Vec<Alert> {
        let fault = self.fault.map(|fault| {
            let notice = about.notice(NotificationEvent::Fault, Some(fault), Some(fault.explanation()));
            (Fault::code(fault).to_owned(), notice)
        });
        let pause = self.pause.map(|(cause, laid)| {
            let event = match cause {
                PauseCause::FilamentOut => NotificationEvent::FilamentRunout,
                _ => NotificationEvent::Pause,
            };
            let notice = about.notice(event, None, Some(cause.explanation()));
            (format!("{cause:?} {laid}"), notice)
        });
        let parked = self.parked.map(|laid| (laid.to_string(), about.notice(NotificationEvent::Parked, None, None)));
        let emergency_stop = self
            .has_emergency_stop
            .then(|| ("latched".to_owned(), about.notice(NotificationEvent::EmergencyStop, None, None)));
        [("fault", fault), ("pause", pause), ("parked", parked), ("emergency-stop", emergency_stop)]
            .map(|(name, condition)| Alert::of_condition(name, condition))
            .into()
    }
}

/// A condition of a robot, such as its fault or its connection, with the notice that is sent if the condition is new.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Alert {
    name: &'static str,
    /// Text that identifies the condition, such as the fault's code. Empty if the robot does not have the condition.
    value: String,
    /// True if the notice is sent only if another value of this condition was recorded before.
    needs_earlier: bool,
    notice: Option<Notification>,
}

impl Alert {
    fn of_condition(name: &'static str, condition: Option<(String, Notification)>) -> Self {
        let (value, notice) = condition.map_or((String::new(), None), |(value, notice)| (value, Some(notice)));
        Self { name, value, needs_earlier: false, notice }
    }

    /// Returns the alert about a robot's connection. `lost` is the reason of a lost connection, or `None` if the
    /// connection is open.
    pub fn of_connection(lost: Option<&str>, about: &NotificationContext) -> Self {
        let value = if lost.is_some() { "lost" } else { "open" };
        let notice = lost.map(|why| about.notice(NotificationEvent::Disconnected, None, Some(why)));
        Self { name: "connection", value: value.to_owned(), needs_earlier: true, notice }
    }

    /// Returns the alert about a start of the board. It has a notice only if the robot has a job.
    pub fn of_boot(boot_id: u32, cause: ResetCause, about: &NotificationContext) -> Self {
        let notice = about.job.map(|_| about.notice(NotificationEvent::BoardRestart, None, Some(cause.name())));
        Self { name: "boot", value: boot_id.to_string(), needs_earlier: true, notice }
    }

    /// Returns the change of the database that records the condition and queues its notice on these channels. A notice
    /// whose event is not in `events` is dropped.
    pub fn into_update(
        self,
        robot: &str,
        events: &[NotificationEvent],
        channels: &[NotificationChannel],
        created_ms: i64,
    ) -> AlertUpdate {
        let Self { name, value, needs_earlier, notice } = self;
        let notice = notice.filter(|notice| events.contains(&notice.event));
        AlertUpdate {
            robot: robot.to_owned(),
            name,
            value,
            needs_earlier,
            notice: notice.map(|notice| notice.to_text()),
            channels: channels.to_vec(),
            created_ms,
        }
    }
}

/// A change of the database that records a condition of a robot and queues the notice about it.
#[derive(Debug, Clone)]
pub(super) struct AlertUpdate {
    robot: String,
    name: &'static str,
    value: String,
    needs_earlier: bool,
    pub notice: Option<String>,
    pub channels: Vec<NotificationChannel>,
    pub created_ms: i64,
}

impl AlertUpdate {
    /// Records the condition in the database. Returns true if its notice has to be sent, because the condition is new.
    pub fn record(&self, database: &Connection) -> rusqlite::Result<bool> {
        let query = "SELECT value FROM alert WHERE robot = ?1 AND name = ?2";
        let before: Option<String> =
            database.query_row(query, (&self.robot, self.name), |row| row.get(0)).optional()?;
        if before.as_ref() == Some(&self.value) {
            return Ok(false);
        }
        let replace = "INSERT OR REPLACE INTO alert (robot, name, value) VALUES (?1, ?2, ?3)";
        database.execute(replace, (&self.robot, self.name, &self.value))?;
        Ok(before.is_some() || !self.needs_earlier)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ServicePaths;
    use crate::job_store::JobStore;
    use crate::job_updates::JobUpdate;
    use crate::notification::MAX_QUEUED_PER_CHANNEL;

    fn jobs() -> (tempfile::TempDir, JobStore) {
        let directory = tempfile::tempdir().unwrap();
        let jobs = JobStore::open(&ServicePaths::in_dir(directory.path().to_path_buf())).unwrap();
        (directory, jobs)
    }

    #[test]
    fn each_condition_is_notified_once() {
        let (_directory, mut jobs) = jobs();
        let about = NotificationContext { robot: "lab", simulated: true, job: Some("a"), laid: 12, layers: 78 };
        let mut notices = |alerts: Vec<Alert>| {
            for alert in alerts {
                let update = alert.into_update("lab", &NotificationEvent::ALL, &[NotificationChannel::Webhook], 0);
                jobs.write(JobUpdate::Alert(update));
            }
            let mut news = Vec::new();
            while let Some(next) = jobs.next_notification(NotificationChannel::Webhook).unwrap() {
                jobs.remove_notification(next.id).unwrap();
                let notice: Notification = serde_json::from_str(&next.notice).unwrap();
                news.push((notice.event, notice.message));
            }
            news
        };
        let nothing = AlertState { fault: None, pause: None, parked: None, has_emergency_stop: false };
        let pause = AlertState { pause: Some((PauseCause::Requested, 12)), ..nothing.clone() };
        assert_eq!(notices(nothing.alerts(&about)), []);
        assert_eq!(
            notices(pause.alerts(&about)),
            [(NotificationEvent::Pause, "simulated robot lab pauses after layer 12 of 78: on request".to_owned())]
        );
        assert_eq!(notices(pause.alerts(&about)), [], "as after a restart");
        assert_eq!(notices(nothing.alerts(&about)), []);
        let states = [
            (NotificationEvent::Pause, AlertState { pause: Some((PauseCause::Requested, 13)), ..nothing.clone() }),
            (
                NotificationEvent::FilamentRunout,
                AlertState { pause: Some((PauseCause::FilamentOut, 14)), ..nothing.clone() },
            ),
            (NotificationEvent::Fault, AlertState { fault: Some(Fault::WatchdogReset), ..nothing.clone() }),
            (NotificationEvent::Parked, AlertState { parked: Some(14), ..nothing.clone() }),
            (NotificationEvent::EmergencyStop, AlertState { has_emergency_stop: true, ..nothing.clone() }),
        ];
        for (event, state) in states {
            for _ in 0..2 {
                let news = notices(state.alerts(&about));
                assert_eq!(news.iter().map(|(event, _)| *event).collect::<Vec<_>>(), [event]);
                assert_eq!(notices(state.alerts(&about)), []);
                assert_eq!(notices(nothing.alerts(&about)), []);
            }
        }
        let lost = || vec![Alert::of_connection(Some("cut"), &about)];
        assert_eq!(notices(lost()), [], "it was not connected before");
        for _ in 0..2 {
            assert_eq!(notices(vec![Alert::of_connection(None, &about)]), []);
            let message = "simulated robot lab has lost its connection after layer 12 of 78: cut".to_owned();
            assert_eq!(notices(lost()), [(NotificationEvent::Disconnected, message)]);
            assert_eq!(notices(lost()), []);
        }
        let idle = NotificationContext { job: None, layers: 0, ..about };
        let mut boots = |boot_id, about| notices(vec![Alert::of_boot(boot_id, ResetCause::PowerOn, about)]).len();
        let restarts = [boots(1, &about), boots(1, &about), boots(2, &about), boots(2, &about), boots(3, &idle)];
        assert_eq!(restarts, [0, 0, 1, 0, 0]);
    }

    #[test]
    fn automatic_pauses_are_not_notified() {
        for (state, pause_cause, is_reported) in [
            (State::Paused, PauseCause::Requested, true),
            (State::Parked, PauseCause::FilamentOut, true),
            (State::Growing, PauseCause::FilamentOut, false),
            (State::Paused, PauseCause::LayersExhausted, false),
            (State::Paused, PauseCause::HostSilent, false),
        ] {
            let status = Status {
                state,
                fault: None,
                temperature_centi_c: None,
                target_centi_c: None,
                duty: 0,
                plan_id: 0,
                layer_count: 0,
                next_layer: 0,
                layers_laid: 0,
                interrupted: None,
                pause_cause,
                is_resumable: true,
                uptime_ms: 0,
            };
            assert_eq!(AlertState::from_status(&status).pause.is_some(), is_reported, "{state:?} {pause_cause:?}");
        }
    }

    #[test]
    fn the_queue_is_bounded_and_pops_the_oldest_due_entry() {
        let (_directory, mut jobs) = jobs();
        let about = NotificationContext { robot: "lab", simulated: false, job: None, laid: 0, layers: 0 };
        let notice = about.notice(NotificationEvent::Finish, None, None);
        for number in 0..i64::from(MAX_QUEUED_PER_CHANNEL) + 5 {
            let channels = vec![NotificationChannel::Webhook];
            jobs.write(JobUpdate::Notice { text: notice.to_text(), channels, created_ms: number });
        }
        let first = jobs.next_notification(NotificationChannel::Webhook).unwrap().unwrap();
        assert_eq!((first.created_ms, jobs.next_notification(NotificationChannel::Command).unwrap()), (5, None));
        jobs.reschedule_notification(first.id, 5000).unwrap();
        let second = jobs.next_notification(NotificationChannel::Webhook).unwrap().unwrap();
        assert_eq!(second.created_ms, 6);
        for _ in 1..MAX_QUEUED_PER_CHANNEL {
            let next = jobs.next_notification(NotificationChannel::Webhook).unwrap().unwrap();
            jobs.remove_notification(next.id).unwrap();
        }
        let last = jobs.next_notification(NotificationChannel::Webhook).unwrap().unwrap();
        assert_eq!((last.id, last.attempts, last.due_ms), (first.id, 1, 5000));
    }
}
