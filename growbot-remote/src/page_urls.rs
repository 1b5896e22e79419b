//! URLs of the service's page.

use serde::{Deserialize, Serialize};

/// URLs of the service's page. Only growbot's commands can request them, on the user's socket.
#[derive(Debug, Clone, Default, Deserialize, Serialize)]
pub struct PageUrls {
    /// URL of the page that can send commands.
    pub control_url: String,
    /// URL of the read-only page.
    pub view_url: String,
}
