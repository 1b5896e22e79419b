//! The module `growbot._growbot`: growbot's crates as Python sees them. What users import is `growbot`, in `python/`.
//!
//! - `robot`, `pose`, `scene`, `plan`: what goes in, and what a plan is; `course`: places along a path;
//! - `conditions`, `simulate`, `summary`: growths without a board, one, many, and what many came to;
//! - `run`: logs of growths; `board`: growths on a board;
//! - `arguments`: values from Python, checked; `refused`: exceptions.
//!
//! Long work leaves the interpreter to other threads, and heeds Ctrl-C.

mod arguments;
mod board;
mod conditions;
mod course;
mod growable;
mod plan;
mod pose;
mod refused;
mod robot;
mod run;
mod scene;
mod simulate;
mod state;
mod summary;

use pyo3::prelude::*;

/// growbot's crates as Python sees them.
#[pymodule]
mod _growbot {
    #[pymodule_export]
    use crate::board::{Board, Growth};
    #[pymodule_export]
    use crate::plan::{Plan, PlanWarning, Segment, plan, plan_many};
    #[pymodule_export]
    use crate::pose::Pose;
    #[pymodule_export]
    use crate::robot::Robot;
    #[pymodule_export]
    use crate::run::RunLog;
    #[pymodule_export]
    use crate::scene::Scene;
    #[pymodule_export]
    use crate::simulate::{Simulated, simulate_many};
    #[pymodule_export]
    use crate::summary::{_repeat_rows, Summary, repeat};
}
