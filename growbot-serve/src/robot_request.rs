//! Requests to the thread of a robot.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Sender;

use growbot_client::growth::{GrowthRequest, Override};
use growbot_client::robot_command::CommandOutcome;
use growbot_client::status::BoardDetails;
use growbot_client::stop_signal::{Generation, Permit};
use growbot_core::link::message::MaintenanceTask;
use growbot_core::robot::Robot;
use growbot_plan::feedback::assumed_noise;
use growbot_plan::plan::Plan;
use growbot_plan::robot_kind::RobotKind;
use growbot_remote::api::Job;
use growbot_scene::scene_file::LoadedScene;

use super::robot_error::RobotRequestError;

/// Channel on which the response to a request is sent.
pub(super) type Reply = Sender<Result<CommandOutcome, RobotRequestError>>;

/// A body to grow, with the choices of the client.
pub struct NewBody {
    pub plan: Plan,
    pub robot: Robot,
    /// Scene with whose obstacles corrections of the path must not collide. `None` without a scene.
    pub scene: Option<LoadedScene>,
    /// Checks that the client ignores.
    pub overrides: Vec<Override>,
    pub feedback: bool,
}

impl NewBody {
    /// Returns the request to grow the body on a robot of this kind.
    pub fn request(&self, kind: RobotKind) -> GrowthRequest<'_> {
        GrowthRequest {
            scene: self.scene.as_ref(),
            overrides: &self.overrides,
            feedback: self.feedback.then(|| assumed_noise(kind)),
            kind,
            ..GrowthRequest::new(&self.robot, &self.plan)
        }
    }
}

/// A job to start.
pub struct NewJob {
    pub job: Job,
    pub body: NewBody,
    /// Permit that was issued when the order to grow arrived.
    pub permit: Permit,
}

/// A request that is sent to a robot's thread.
pub enum RobotRequest {
    Grow(Box<NewJob>),
    Resume(Box<Job>, Permit),
    Cancel,
    ClearFault(Permit),
    Task(MaintenanceTask, Permit),
    /// Tune the heater at this temperature, degrees Celsius.
    Tune(f64, Permit),
    /// Read what the board reports beside its status, and send it on this channel.
    ReadDetails(Sender<BoardDetails>),
    /// Wake the thread, because a stop was raised that it has to deliver.
    Wake,
    /// Record that the board has confirmed this stop to the thread that sends emergency stops.
    StopConfirmed(Generation),
    /// Lease the port: close it until the lease ends.
    Lend(PortLease),
}

/// A request in the queue of a robot's thread, with the channel on which its response is sent.
pub struct PendingRequest {
    pub request: RobotRequest,
    pub reply: Reply,
    pub claim: Claim,
}

/// Flag that the robot's thread and the caller share for a request. It is set by the one that acts first: the thread,
/// which takes the request, or the caller, which gives the request up.
#[derive(Clone, Default)]
pub struct Claim(Arc<AtomicBool>);

impl Claim {
    /// Sets the flag. Returns false if it was already set, so that the request had been taken or given up before.
    pub fn take(&self) -> bool {
        !self.0.swap(true, Ordering::AcqRel)
    }

    /// Returns an error if the flag is set. Before the request is sent to the thread, this means that the caller has
    /// given it up.
    pub fn check(&self) -> Result<(), RobotRequestError> {
        if self.0.load(Ordering::Acquire) { Err(RobotRequestError::GivenUp) } else { Ok(()) }
    }
}

impl PendingRequest {
    pub(super) fn respond(self, response: Result<CommandOutcome, RobotRequestError>) {
        // The caller may no longer wait for the response.
        let _ = self.reply.send(response);
    }
}

/// A lease of a robot's port.
pub struct PortLease {
    /// Name of the command that has the port.
    pub to: String,
    pub is_over: Arc<AtomicBool>,
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use growbot_core::link::message::State;

    use super::*;
    use crate::stop_model::{Case, service};

    /// The robot's thread waits for its board until the caller has given its request up.
    #[test]
    fn a_request_that_was_given_up_is_not_carried_out() {
        let directory = tempfile::tempdir().unwrap();
        let service = service(&directory);
        let case = Case::new(&service, "lab".to_owned());
        case.wait_for_connection();
        let is_given_up = |request, limit| match case.worker.request(request, limit) {
            Err(RobotRequestError::NotAccepted { .. }) => true,
            Err(RobotRequestError::NotFinished { .. }) => false,
            other => panic!("{other:?}"),
        };
        {
            let mut board = case.line.board();
            board.may_heat = true;
            // The thread waits for this guard at its next use of the line, and then takes no more requests.
            while !is_given_up(RobotRequest::Wake, Duration::from_millis(200)) {}
            let preheat = MaintenanceTask::Preheat { target_centi_c: 20_000 };
            let preheat = RobotRequest::Task(preheat, case.worker.signal().permit());
            assert!(is_given_up(preheat, Duration::ZERO));
        }
        // The thread takes requests in their order.
        assert!(!is_given_up(RobotRequest::Wake, Duration::from_secs(60)));
        assert_eq!(case.line.board().state, State::Idle);
    }
}
