//! The user's service, and the robots that it owns, for commands that must not wait.

use std::sync::Once;
use std::time::Duration;

use growbot_client::status::RobotStatus;
use growbot_remote::client::ServiceClient;
use growbot_serve::settings::{self, InvalidFiles, SettingsError};

use super::remedies;

/// Time for which an emergency stop waits for the list of the service's robots, and then for its confirmation. After
/// that the command sends the stop to the robot's port, too.
pub const EMERGENCY: Duration = Duration::from_millis(50);

/// Returns the port of the robot with this name, from the settings, or else from the service that owns the robot.
/// `None` if the name is unknown.
pub fn port_of_robot(name: &str, invalid: InvalidFiles) -> Result<Option<String>, SettingsError> {
    let configured = settings::load_service(invalid)?.robots.remove(name);
    Ok(configured.map(|entry| entry.port).or_else(|| {
        let owned = robots_in_emergency().into_iter().find(|robot| robot.name.as_deref() == Some(name))?;
        Some(owned.port)
    }))
}

/// Returns all robots of the user's service, for an emergency. The list is empty if no service responds at once.
pub fn robots_in_emergency() -> Vec<RobotStatus> {
    service_in_emergency().and_then(|caller| caller.robots(EMERGENCY).ok()).unwrap_or_default()
}

/// Returns the user's service, for an emergency. `None` if no service runs. A service that may belong to another user
/// is ignored, with a warning.
pub fn service_in_emergency() -> Option<ServiceClient> {
    static WARNED: Once = Once::new();
    ServiceClient::find().unwrap_or_else(|error| {
        WARNED.call_once(|| growbot_host::warning!("{}", remedies::message(&error)));
        None
    })
}
