//! Class `growbot.Plan`. Its methods are in `plan.rs`.

use std::sync::Arc;

use growbot_core::robot::Robot as Described;
use growbot_plan::plan as client;
use pyo3::prelude::*;

/// A path that has been checked to end at its goal, with its properties.
///
/// growbot.plan returns plans. Plan.load reads them from files that `growbot plan -o` or save wrote. Plans can be
/// pickled.
#[pyclass(name = "Plan", frozen, module = "growbot")]
#[derive(Clone)]
pub struct PyPlan {
    pub inner: Arc<client::Plan>,
    pub robot: Arc<Described>,
}
