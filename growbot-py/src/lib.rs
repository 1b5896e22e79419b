//! The Python extension module `growbot._growbot`. Users import the Python package `growbot` in `python/`, which is
//! based on it.
//!
//! - `robot`, `pose`, `scene`, `plan`, `py_plan`: the inputs and plans
//! - `path_frames`: positions along a path
//! - `conditions`, `simulate`, `summary`: growths without a board, one or many, and their statistics
//! - `run`: logs of growths
//! - `board`, `board_handle`: robots at a port, which this program owns (`local_board`) or the user's service
//!   (`remote_board`)
//! - `growth`, `preconditions`: growths on a board
//! - `arguments`: conversion and checks of arguments; `arrays`: arrays with named fields
//! - `page`: the page that shows a body
//! - `interruptible`: computations and waits that Ctrl-C ends
//! - `pickle`: state of plans for Python's pickle
//! - `error`: conversion of errors to Python exceptions
//!
//! Long computations release the interpreter for other threads, and Ctrl-C ends them.

// Return types are tuples of arrays. Aliases would hide them.
#![allow(clippy::type_complexity)]

mod arguments;
mod arrays;
mod board;
mod board_handle;
mod conditions;
mod error;
mod growth;
mod interruptible;
mod local_board;
mod page;
mod path_frames;
mod pickle;
mod plan;
mod pose;
mod preconditions;
mod py_plan;
mod remedies;
mod remote_board;
mod robot;
mod run;
mod scene;
mod simulate;
mod summary;

use pyo3::prelude::*;

/// growbot's crates for Python.
#[pymodule]
mod _growbot {
    #[pymodule_export]
    use crate::board::PyBoard;
    #[pymodule_export]
    use crate::growth::Growth;
    #[pymodule_export]
    use crate::plan::{PlanWarning, PySegment, plan, plan_many};
    #[pymodule_export]
    use crate::pose::PyPose;
    #[pymodule_export]
    use crate::py_plan::PyPlan;
    #[pymodule_export]
    use crate::robot::PyRobot;
    #[pymodule_export]
    use crate::run::PyRunLog;
    #[pymodule_export]
    use crate::scene::PyScene;
    #[pymodule_export]
    use crate::simulate::{PySimulationResult, simulate_many};
    #[pymodule_export]
    use crate::summary::{_simulate_repeated_rows, SimulationSummary, simulate_repeated};
}
