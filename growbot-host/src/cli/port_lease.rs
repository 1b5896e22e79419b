//! Lease of a robot's port from the service.

use growbot_remote::client::{LeasedPort, ServiceClient};

/// Lease of a robot's link from the service to this program. It ends when this guard is dropped. The connection to
/// the service is dropped last.
pub struct PortLeaseGuard {
    _line: LeasedPort,
    _caller: ServiceClient,
}

impl PortLeaseGuard {
    /// Creates the guard of a lease that the service at `caller` has given.
    pub fn new(line: LeasedPort, caller: ServiceClient) -> Self {
        Self { _line: line, _caller: caller }
    }
}
