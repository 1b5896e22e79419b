//! Sends notices about a robot: its conditions, its connection, and restarts of its board and of the service.

use growbot_client::port::time_since_boot;
use growbot_core::link::message::{BoardInfo, Status};
use growbot_remote::api::Job;

use super::alert::{Alert, AlertState};
use super::notification::{NotificationContext, NotificationEvent};
use super::robot_worker::RobotWorker;

impl RobotWorker {
    /// Records a status that the board has reported. Sends notices if the robot's condition differs from the condition
    /// that was recorded last.
    pub(super) fn record_status(&self, status: Status) {
        let condition = AlertState::from_status(&status);
        self.update_state(|known| (known.status, known.reported) = (Some(status), Some(time_since_boot())));
        let mut last = self.lock_last_alerts();
        if last.state.as_ref() != Some(&condition) {
            self.with_notification_context(|about| self.shared.notify_alerts(about, condition.alerts(about)));
            last.state = Some(condition);
        }
    }

    /// Records the state of the robot's connection. `lost` is the reason of a lost connection, or `None` if the robot
    /// is connected. Sends a notice if a robot that was connected before, even before a restart of the service, has
    /// lost its connection.
    pub(super) fn record_connection(&self, lost: Option<&str>) {
        let mut last = self.lock_last_alerts();
        if last.is_connected != Some(lost.is_none()) {
            self.with_notification_context(|about| {
                self.shared.notify_alerts(about, [Alert::of_connection(lost, about)]);
            });
            last.is_connected = Some(lost.is_none());
        }
    }

    /// Records the start of the board. Sends a notice if the board has restarted during a job.
    pub(super) fn record_boot(&self, board: &BoardInfo) {
        self.update_state(|known| known.board = Some(board.clone()));
        self.with_notification_context(|about| {
            self.shared.notify_alerts(about, [Alert::of_boot(board.boot_id, board.reset_cause, about)]);
        });
    }

    /// Sends a notice that the service has restarted, if the robot had a job.
    pub(super) fn notify_service_restart(&self) {
        let active = self.shared.jobs().active(&self.name);
        if let Ok(Some(job)) = active {
            self.notify_job(&job, NotificationEvent::ServiceRestart, None);
        }
    }

    /// Sends a notice about an event of a job. `why` is the reason of the event.
    pub(super) fn notify_job(&self, job: &Job, event: NotificationEvent, why: Option<&str>) {
        self.with_notification_context(|about| {
            let about = match about.layers {
                0 => NotificationContext { job: Some(&job.id), laid: job.laid, layers: job.layers, ..*about },
                _ => NotificationContext { job: Some(&job.id), ..*about },
            };
            self.shared.notify_event(&about, event, why);
        });
    }

    /// Calls `send` with the robot and its active job, for a notice about them.
    fn with_notification_context(&self, send: impl FnOnce(&NotificationContext)) {
        let view = self.status();
        send(&NotificationContext {
            robot: &self.name,
            simulated: view.simulated,
            job: view.job.as_deref(),
            laid: view.laid,
            layers: view.layers,
        });
    }
}
