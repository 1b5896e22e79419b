//! Notices for users who do not watch a page: a body is finished, or a robot needs attention. They are queued in the
//! database, so that the service sends them after a restart if it could not do so before.
//!
//! The database also stores the condition of each robot that was reported last. So a fault is reported once, although
//! the service may be killed at any moment. A notice is sent twice only if the service is killed between sending and
//! recording.

use growbot_client::run_log::utc_now;
use growbot_client::sanitize::json_line;
use growbot_core::link::message::{Fault, PauseCause, State, Status};
use rusqlite::{OptionalExtension, named_params};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::JobStoreError;
use super::job_store::JobStore;

/// Maximum number of queued notices of a channel. Beyond it the oldest ones are dropped.
const MAX_QUEUED_PER_CHANNEL: u32 = 1000;
/// Version of [`Notice`].
const VERSION: u32 = 1;

/// Event that a notice reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum NotificationEvent {
    /// All layers are laid.
    Finish,
    /// A fault is latched.
    Fault,
    /// A growth pauses until a user continues it.
    Pause,
    /// The filament has run out, and the growth pauses.
    FilamentRunout,
    /// A robot does not resume its job by itself, mostly after a loss of power.
    Interrupted,
}

impl NotificationEvent {
    /// All events.
    pub const ALL: [Self; 5] = [Self::Finish, Self::Fault, Self::Pause, Self::FilamentRunout, Self::Interrupted];

    /// Returns the event's name in notices and settings.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Finish => "finish",
            Self::Fault => "fault",
            Self::Pause => "pause",
            Self::FilamentRunout => "filament-runout",
            Self::Interrupted => "interrupted",
        }
    }
}

/// Way by which notices are sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NotificationChannel {
    Webhook,
    Command,
}

impl NotificationChannel {
    fn name(self) -> &'static str {
        match self {
            Self::Webhook => "webhook",
            Self::Command => "command",
        }
    }
}

/// A notice, as it is sent.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Notification {
    /// Version of this format.
    pub version: u32,
    /// Event that the notice reports.
    pub event: NotificationEvent,
    /// Time of the event, RFC 3339.
    pub time_utc: String,
    /// Name of the robot in the service.
    pub robot: String,
    /// True if the robot is simulated.
    pub simulated: bool,
    /// Identifier of the job. Null without a job.
    pub job: Option<String>,
    /// Number of laid layers.
    pub laid: u32,
    /// Number of layers of the body.
    pub layers: u32,
    /// Code of the fault. Null without a fault.
    pub fault: Option<String>,
    /// Description of the event for people.
    pub message: String,
}

/// Robot and job that a notice is about.
pub(super) struct NotificationContext<'a> {
    pub robot: &'a str,
    pub simulated: bool,
    pub job: Option<&'a str>,
    pub laid: u32,
    pub layers: u32,
}

impl NotificationContext<'_> {
    pub fn notice(&self, event: NotificationEvent, fault: Option<Fault>, why: Option<&str>) -> Notification {
        let robot = format!("{} {}", if self.simulated { "simulated robot" } else { "robot" }, self.robot);
        let at = format!("after layer {} of {}", self.laid, self.layers);
        let why = why.unwrap_or("check the robot");
        let message = match event {
            NotificationEvent::Finish => format!("{robot} has laid all {} layers", self.layers),
            NotificationEvent::Fault => format!("{robot} stopped with a fault {at}: {why}"),
            NotificationEvent::Pause => format!("{robot} pauses {at}: {why}"),
            NotificationEvent::FilamentRunout => format!("{robot} pauses {at}: {why}"),
            NotificationEvent::Interrupted => format!("{robot} abandoned its job {at}: {why}"),
        };
        Notification {
            version: VERSION,
            event,
            time_utc: utc_now(),
            robot: self.robot.to_owned(),
            simulated: self.simulated,
            job: self.job.map(str::to_owned),
            laid: self.laid,
            layers: self.layers,
            fault: fault.map(|fault| Fault::code(fault).to_owned()),
            message,
        }
    }
}

/// Part of a robot's status that notices report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct AlertState {
    fault: Option<Fault>,
    /// Cause of a pause that a user has to end, and the number of laid layers. `None` without such a pause.
    pause: Option<(PauseCause, u32)>,
}

impl AlertState {
    pub fn from_status(status: &Status) -> Self {
        let pauses = matches!(status.state, State::Paused | State::Parked);
        // The robot ends a pause by itself if it waits for layers or for its host.
        let waits_for_people = matches!(status.pause_cause, PauseCause::Requested | PauseCause::FilamentOut);
        let pause = (pauses && waits_for_people).then_some((status.pause_cause, status.layers_laid));
        Self { fault: status.fault, pause }
    }

    /// Returns fault and pause as the database stores them.
    fn to_columns(&self) -> [String; 2] {
        let pause = self.pause.map(|(cause, laid)| format!("{cause:?} {laid}"));
        [self.fault.map(|fault| Fault::code(fault).to_owned()).unwrap_or_default(), pause.unwrap_or_default()]
    }

    /// Returns the notices that are due if `reported` is the condition that was reported last.
    fn since(&self, reported: &[String; 2], about: &NotificationContext) -> Vec<Notification> {
        let now = self.to_columns();
        let fault = self.fault.filter(|_| now[0] != reported[0]);
        let pause = self.pause.filter(|_| now[1] != reported[1]);
        let fault = fault.map(|fault| about.notice(NotificationEvent::Fault, Some(fault), Some(fault.explanation())));
        let pause = pause.map(|(cause, _)| {
            let event = match cause {
                PauseCause::FilamentOut => NotificationEvent::FilamentRunout,
                _ => NotificationEvent::Pause,
            };
            about.notice(event, None, Some(super::robot_worker::pause_reason(cause)))
        });
        fault.into_iter().chain(pause).collect()
    }
}

/// A queued notice.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct QueuedNotification {
    pub id: i64,
    pub notice: String,
    pub created_ms: i64,
    pub due_ms: i64,
    pub attempts: u32,
}

impl JobStore {
    /// Queues a notice for each of these channels.
    pub(super) fn enqueue_notification(
        &mut self,
        notice: &Notification,
        channels: &[NotificationChannel],
        now_ms: i64,
    ) -> Result<(), JobStoreError> {
        let text = json_line(notice);
        let transaction = self.database.transaction()?;
        for channel in channels {
            transaction.execute(
                "INSERT INTO notice (channel, notice, created_ms, due_ms) VALUES (:channel, :notice, :now, :now)",
                named_params! { ":channel": channel.name(), ":notice": text.trim_end(), ":now": now_ms },
            )?;
            transaction.execute(
                "DELETE FROM notice WHERE channel = ?1 AND id NOT IN \
                 (SELECT id FROM notice WHERE channel = ?1 ORDER BY id DESC LIMIT ?2)",
                (channel.name(), MAX_QUEUED_PER_CHANNEL),
            )?;
        }
        Ok(transaction.commit()?)
    }

    /// Returns the notices that are due for a robot's condition. They stay due until [`Jobs::set_notified`].
    pub(super) fn new_notifications(
        &self,
        about: &NotificationContext,
        condition: &AlertState,
    ) -> Result<Vec<Notification>, JobStoreError> {
        let query = "SELECT fault, pause FROM told WHERE robot = ?1";
        let reported =
            self.database.query_row(query, [about.robot], |row| Ok([row.get(0)?, row.get(1)?])).optional()?;
        Ok(condition.since(&reported.unwrap_or_default(), about))
    }

    /// Records the condition of a robot that was reported last, so that a restart does not report it again.
    pub(super) fn set_notified(&self, robot: &str, condition: &AlertState) -> Result<(), JobStoreError> {
        let [fault, pause] = condition.to_columns();
        let replace = "INSERT OR REPLACE INTO told (robot, fault, pause) VALUES (?1, ?2, ?3)";
        self.database.execute(replace, (robot, fault, pause))?;
        Ok(())
    }

    /// Returns the next notice of a channel.
    pub(super) fn next_notification(
        &self,
        channel: NotificationChannel,
    ) -> Result<Option<QueuedNotification>, JobStoreError> {
        let query = "SELECT id, notice, created_ms, due_ms, attempts FROM notice WHERE channel = ?1 \
                     ORDER BY due_ms, id LIMIT 1";
        let row = self.database.query_row(query, [channel.name()], |row| {
            Ok(QueuedNotification {
                id: row.get(0)?,
                notice: row.get(1)?,
                created_ms: row.get(2)?,
                due_ms: row.get(3)?,
                attempts: row.get(4)?,
            })
        });
        Ok(row.optional()?)
    }

    /// Removes a notice that was sent or given up.
    pub(super) fn remove_notification(&self, id: i64) -> Result<(), JobStoreError> {
        self.database.execute("DELETE FROM notice WHERE id = ?1", [id])?;
        Ok(())
    }

    /// Schedules another attempt to send a notice.
    pub(super) fn reschedule_notification(&self, id: i64, due_ms: i64) -> Result<(), JobStoreError> {
        self.database.execute("UPDATE notice SET attempts = attempts + 1, due_ms = ?2 WHERE id = ?1", (id, due_ms))?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::serve::ServicePaths;

    fn jobs() -> (tempfile::TempDir, JobStore) {
        let directory = tempfile::tempdir().unwrap();
        let jobs = JobStore::open(&ServicePaths::in_dir(directory.path().to_path_buf())).unwrap();
        (directory, jobs)
    }

    #[test]
    fn each_fault_pause_and_empty_spool_is_notified_once() {
        let (_directory, jobs) = jobs();
        let about = NotificationContext { robot: "lab", simulated: true, job: Some("a"), laid: 12, layers: 78 };
        let notices = |fault, pause| {
            let condition = AlertState { fault, pause };
            let news = jobs.new_notifications(&about, &condition).unwrap();
            jobs.set_notified("lab", &condition).unwrap();
            news.into_iter().map(|notice| (notice.event, notice.message)).collect::<Vec<_>>()
        };
        let pause = Some((PauseCause::Requested, 12));
        assert_eq!(notices(None, None), []);
        assert_eq!(
            notices(None, pause),
            [(NotificationEvent::Pause, "simulated robot lab pauses after layer 12 of 78: on request".to_owned())]
        );
        assert_eq!(notices(None, pause), [], "as after a restart");
        assert_eq!(notices(None, None), []);
        assert_eq!(notices(None, Some((PauseCause::Requested, 13))).len(), 1);
        let runout = notices(None, Some((PauseCause::FilamentOut, 14)));
        assert!(runout[0].0 == NotificationEvent::FilamentRunout && runout[0].1.contains("load a spool"), "{runout:?}");
        let fault = notices(Some(Fault::WatchdogReset), None);
        assert!(
            fault[0].0 == NotificationEvent::Fault && fault[0].1.contains(Fault::WatchdogReset.explanation()),
            "{fault:?}"
        );
        assert_eq!(notices(Some(Fault::WatchdogReset), None), []);
    }

    #[test]
    fn automatic_pauses_are_not_notified() {
        for (state, pause_cause, is_told) in [
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
            assert_eq!(AlertState::from_status(&status).pause.is_some(), is_told, "{state:?} {pause_cause:?}");
        }
    }

    #[test]
    fn the_queue_is_bounded_and_pops_the_oldest_due_entry() {
        let (_directory, mut jobs) = jobs();
        let about = NotificationContext { robot: "lab", simulated: false, job: None, laid: 0, layers: 0 };
        let notice = about.notice(NotificationEvent::Finish, None, None);
        for number in 0..i64::from(MAX_QUEUED_PER_CHANNEL) + 5 {
            jobs.enqueue_notification(&notice, &[NotificationChannel::Webhook], number).unwrap();
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
