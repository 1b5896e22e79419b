//! Rights of a client of the service.

use growbot_pictures::view::page::PageAccess;

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

impl Access {
    /// Returns the first part of the path of the pages for clients with these rights, in addresses without a token.
    pub fn path(self) -> &'static str {
        if self == Self::View { "view" } else { "control" }
    }

    /// Returns the kind of page for clients with these rights.
    pub fn page(self) -> PageAccess {
        if self == Self::View { PageAccess::View } else { PageAccess::Control }
    }
}

/// Returns the source of the client's commands if the client can send commands, otherwise an error.
pub(super) fn require_control(access: Access) -> Result<CommandSource, Problem> {
    match access {
        Access::Control(by) => Ok(by),
        Access::View => Err(Problem::read_only()),
    }
}
