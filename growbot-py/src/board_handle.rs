//! A robot at a port, which this program or the user's service owns.

use growbot_client::growth::{GrowthRequest, LogTarget, Override};
use growbot_client::status::RobotStatus;
use growbot_core::simulation::ErrorModel;
use growbot_plan::robot_kind::RobotKind;
use pyo3::prelude::*;

use crate::conditions::Conditions;
use crate::error::Error;
use crate::growth::Growth;
use crate::py_plan::PyPlan;
use crate::scene::PyScene;

/// A robot at a port. Its methods wait, and Ctrl-C ends the wait.
pub trait BoardHandle: Send + Sync {
    /// Requests the full status of the robot.
    fn status(&self, py: Python<'_>) -> Result<RobotStatus, Error>;

    /// Stops a growth that another program has started. Returns a sentence about the result.
    fn stop(&self, py: Python<'_>) -> Result<String, Error>;

    /// Sends the emergency stop, and waits until the board confirms it.
    fn emergency_stop(&self, py: Python<'_>) -> Result<(), Error>;

    /// Starts a growth.
    fn grow(&self, py: Python<'_>, arguments: GrowthArguments) -> Result<Growth, Error>;

    /// Returns the growth in progress of a robot of the service, from its first event on.
    fn attach(&self, py: Python<'_>) -> Result<Growth, Error>;

    /// Stops a growth of this program, and disconnects. A growth of the service continues.
    fn close(&self, py: Python<'_>) -> Result<(), Error>;
}

/// Arguments of a growth.
pub struct GrowthArguments {
    pub plan: PyPlan,
    pub conditions: Conditions,
    pub seed: u64,
    /// Scene that replaces the one of the plan. Corrections of feedback stay clear of it.
    pub scene: Option<PyScene>,
    pub log: LogTarget,
    pub overrides: Vec<Override>,
}

impl GrowthArguments {
    /// Returns the requested growth on a robot of this kind.
    pub fn request(&self, kind: RobotKind) -> GrowthRequest<'_> {
        let Self { plan: PyPlan { inner: plan, robot }, conditions, scene, overrides, seed, .. } = self;
        let noise = if kind.is_simulated() { conditions.sensor_noise() } else { conditions.assumed_noise() };
        GrowthRequest {
            scene: scene.as_ref().map(|scene| &*scene.loaded),
            overrides,
            feedback: conditions.feedback().then_some(noise),
            imperfection: ErrorModel {
                disturbance: conditions.disturbance(),
                noise: conditions.sensor_noise(),
                seed: *seed,
            },
            kind,
            ..GrowthRequest::new(robot, plan)
        }
    }
}
