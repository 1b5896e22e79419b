//! Notices for users who do not watch a page: a body is finished, or a robot needs attention. They are queued in the
//! database, so that the service sends them after a restart if it could not do so before.
//!
//! The database also stores the conditions of each robot that were reported last, in the transaction that queues the
//! notice. So a fault is reported once, although the service may be killed at any time. A notice is sent twice only if
//! the service is killed between sending and recording.

use growbot_core::link::message::Fault;
use growbot_plan::run_log::utc_now;
use growbot_plan::sanitize::json_line;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use strum::{IntoStaticStr, VariantArray};

/// Maximum number of queued notices for each channel. If there are more, the oldest notices are dropped.
pub(super) const MAX_QUEUED_PER_CHANNEL: u32 = 1000;
/// Version of the format of [`Notification`].
const VERSION: u32 = 1;

/// Event that a notice reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, IntoStaticStr, VariantArray)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
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
    /// A long pause has switched the heater off.
    Parked,
    /// An emergency stop is latched.
    EmergencyStop,
    /// The connection to a robot is lost.
    Disconnected,
    /// The board has restarted during a job.
    BoardRestart,
    /// The service has restarted during a job.
    ServiceRestart,
}

impl NotificationEvent {
    /// All events.
    pub const ALL: [Self; 10] = *Self::VARIANTS.as_array().unwrap();

    /// Returns the event's name in notices and settings.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Channel on which notices are sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub(super) enum NotificationChannel {
    Webhook,
    Command,
}

impl NotificationChannel {
    pub(super) fn name(self) -> &'static str {
        self.into()
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

impl Notification {
    /// Returns the notice as one line of JSON, without a newline.
    pub(super) fn to_text(&self) -> String {
        json_line(self).trim_end().to_owned()
    }
}

/// Robot and job that a notice is about.
#[derive(Clone, Copy)]
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
        let at = match self.layers {
            0 => String::new(),
            layers => format!(" after layer {} of {layers}", self.laid),
        };
        let why = why.unwrap_or("check the robot");
        let message = match event {
            NotificationEvent::Finish => format!("{robot} has laid all {} layers", self.layers),
            NotificationEvent::Fault => format!("{robot} stopped with a fault{at}: {why}"),
            NotificationEvent::Pause => format!("{robot} pauses{at}: {why}"),
            NotificationEvent::FilamentRunout => format!("{robot} pauses{at}: {why}"),
            NotificationEvent::Interrupted => format!("the job of {robot} was interrupted{at}: {why}"),
            NotificationEvent::Parked => {
                format!(
                    "{robot} is parked{at}, with its heater off: continue the job, or stop the job and then cancel it"
                )
            }
            NotificationEvent::EmergencyStop => format!(
                "{robot} was stopped by the emergency stop{at}: release the button if it is pressed, clear the \
                 emergency stop, and resume or cancel the job if there is one"
            ),
            NotificationEvent::Disconnected => format!("{robot} has lost its connection{at}: {why}"),
            NotificationEvent::BoardRestart => format!("{robot} has restarted{at} ({why}): check the robot"),
            NotificationEvent::ServiceRestart => {
                format!("the service has restarted while {robot} had a job{at}: check the robot")
            }
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
