//! Checks of the board itself: link, firmware and robot description.

use growbot_client::client::{Client, ClientError};
use growbot_client::commissioning_report::Finding;
use growbot_core::link::message::{BootReport, ImageCheck, Refusal};

use super::session::{DoctorSession, describe};
use crate::cli::board_report::{described, is_configured};
use crate::cli::failure::Failure;

/// Checks that the board responds. Reports its firmware, the cause of its start, and a crash.
pub fn check_link(session: &mut DoctorSession) -> Result<Finding, Failure> {
    let hello = session.client.identify()?;
    let [major, minor, patch] = hello.firmware;
    let mut found = format!("firmware {major}.{minor}.{patch}, started by {}", hello.reset_cause.name());
    let boot = boot(&mut session.client)?;
    if let Some(BootReport { image: ImageCheck::Corrupt { sealed, found: crc }, .. }) = &boot {
        return Ok(Finding::failed(
            format!("the image in flash is corrupt: its CRC is {crc:08x}, the CRC in its seal {sealed:08x}"),
            "flash the board again",
        ));
    }
    if boot.is_some_and(|boot| boot.crash.is_some()) {
        found += "; this firmware has crashed before, see `growbot status`";
    }
    match hello.status.fault {
        None => Ok(Finding::passed(found)),
        Some(fault) => match session.clear()? {
            None => Ok(Finding::passed(format!("{found}; the fault {} was cleared", fault.code()))),
            Some(_) => Ok(Finding::failed(
                format!("{found}; {}", describe(fault)),
                "remove the cause of the fault: the board does nothing until then",
            )),
        },
    }
}

/// Returns the board's report about its start. `None` if the board does not know the request.
fn boot(client: &mut Client) -> Result<Option<BootReport>, Failure> {
    match client.boot_report() {
        Ok(report) => Ok(Some(report)),
        Err(ClientError::Refused { refusal: Refusal::UnknownRequest, .. }) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// Checks that the board has the description of this robot.
pub fn check_description(session: &mut DoctorSession) -> Result<Finding, Failure> {
    let hello = session.client.identify()?;
    let (name, hash) = (session.robot.name(), session.robot.hash());
    let configure = format!("send the robot file to the board with `growbot configure FILE --port {}`", session.port);
    if !is_configured(&hello) {
        return Ok(Finding::failed("the board has no robot description", configure));
    }
    if hello.robot_hash != hash {
        return Ok(Finding::failed(
            format!("the board has {}, but the robot file is {name} ({hash:016x})", described(&hello)),
            format!("{configure}; or choose the board's robot with --robot"),
        ));
    }
    Ok(Finding::passed(described(&hello)))
}
