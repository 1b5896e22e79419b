//! Rights of a client of the service.

use super::audit::CommandSource;
use super::problem::Problem;

/// Rights of a client. They depend on the address or socket that the client uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// The client can only read.
    View,
    /// The client can read and send commands.
    Control(CommandSource),
}

/// Returns the source of the client's commands if the client can send commands, otherwise an error.
pub(super) fn require_control(access: Access) -> Result<CommandSource, Problem> {
    match access {
        Access::Control(by) => Ok(by),
        Access::View => Err(Problem::read_only()),
    }
}
