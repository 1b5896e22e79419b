//! The heater, in three steps: nothing connected, a lamp, the nozzle.

use std::time::Duration;

use growbot_client::commissioning_report::Finding;
use growbot_core::link::message::{Fault, MaintenanceTask, State, Status, celsius};
use growbot_host::note;
use growbot_sim::tip::manual_action::ManualAction;

use super::answers::{AnswerKind, OperatorAnswer};
use super::session::{DoctorSession, describe};
use crate::cli::failure::Failure;

/// Temperature to which the nozzle is heated, C. It is a little above the lowest that the board heats to.
const LOW_C: f64 = 60.0;
/// Maximum rise of the nozzle's temperature while its heater is disconnected, K.
const WARMER_C: f64 = 5.0;
/// Maximum time of the proof test of the two switches, with all its pauses.
const PROOF: Duration = Duration::from_secs(60);

fn preheat() -> MaintenanceTask {
    MaintenanceTask::Preheat { target_centi_c: (LOW_C * 100.0) as i32 }
}

/// Returns true if a board raises this fault when a heated nozzle does not get warmer.
fn is_no_heat(fault: Fault) -> bool {
    matches!(fault, Fault::HeatingTooSlow | Fault::TemperatureDrop | Fault::ThermistorFrozen | Fault::HeaterEnergy)
}

/// Returns the maximum time until the board reports that a heated nozzle does not get warmer. It includes the proof
/// test.
fn patience(session: &DoctorSession) -> Duration {
    Duration::from_secs_f64(session.robot.description().heater.heating_timeout_s.clamp(1.0, 3600.0)) + PROOF
}

/// Checks with no heater connected that the board detects that the nozzle stays cold, and switches off.
pub fn without_heater(session: &mut DoctorSession) -> Result<Finding, Failure> {
    let question = "Disconnect both wires of the heater from the board; the thermistor stays. The board will drive the \
                    heater output with nothing connected until it detects that the nozzle stays cold.";
    if !session.confirm(question)? {
        return Ok(Finding::skipped());
    }
    session.act(ManualAction::DisconnectHeater(true));
    let found = heat_nothing(session);
    session.act(ManualAction::DisconnectHeater(false));
    let found = found?;
    session.switch_off()?;
    session.clear()?;
    Ok(found)
}

fn heat_nothing(session: &mut DoctorSession) -> Result<Finding, Failure> {
    let before = session.sample()?.status.temperature_centi_c.unwrap_or_default();
    if let Some(why) = session.maintain(preheat())? {
        return Ok(Finding::failed(why, "see the state of the board with `growbot status`"));
    }
    let time = patience(session);
    note!("this step takes up to {} s", time.as_secs());
    let warmer = |centi_c: Option<i32>| celsius(centi_c.unwrap_or(before).saturating_sub(before));
    let seen = session.wait_until(time, None, |seen| {
        seen.status.fault.is_some() || warmer(seen.status.temperature_centi_c) > WARMER_C
    })?;
    Ok(match seen.map(|seen| (seen.status.fault, warmer(seen.status.temperature_centi_c))) {
        Some((Some(fault), _)) if is_no_heat(fault) => {
            Finding::passed(format!("the board switched off by {}, as it must", fault.code()))
        }
        Some((Some(fault), _)) => Finding::failed(
            format!("the board switched the heater off by another fault, {}", describe(fault)),
            "remove the cause of this fault, check that nothing is connected to the heater's terminals, and repeat \
             this step",
        ),
        Some((None, degrees)) => Finding::failed(
            format!("the nozzle got warmer by {degrees:.1} degrees; the limit is {WARMER_C}"),
            "cut the power: the heater is still connected, or the thermistor sits on something else that heats",
        ),
        None => Finding::failed(
            format!("the board reported no fault within {} s", time.as_secs()),
            "do not connect a heater: the board does not detect that its nozzle stays cold",
        ),
    })
}

/// Checks with a lamp that the power reaches the terminals, and that the emergency stop cuts it.
pub fn lamp(session: &mut DoctorSession) -> Result<Finding, Failure> {
    let question = "Connect a lamp for the supply's voltage, 5 to 20 W, in place of the heater; the thermistor stays. \
                    It stays dark for some 20 s while the board tests the switches, and then lights.";
    if !session.confirm(question)? {
        return Ok(Finding::skipped());
    }
    // A lamp does not warm the nozzle either.
    session.act(ManualAction::DisconnectHeater(true));
    let found = light(session);
    session.act(ManualAction::DisconnectHeater(false));
    let found = found?;
    session.switch_off()?;
    session.clear()?;
    Ok(found)
}

fn light(session: &mut DoctorSession) -> Result<Finding, Failure> {
    if let Some(why) = session.maintain(preheat())? {
        return Ok(Finding::failed(why, "see the state of the board with `growbot status`"));
    }
    let heater = &session.robot.description().heater;
    // The proof test drives the power stage, too: docs/decisions/0021-heater-proof-test.md.
    let proof_s = 8.0 * heater.heat_capacity_j_per_k / heater.power_w.max(1e-3) + 5.0;
    let looks = ((proof_s + 2.0) / super::session::LOOK.as_secs_f64()) as u32;
    let mut driven = 0;
    let seen = session.wait_until(PROOF, None, |seen| {
        driven += u32::from(seen.status.duty > 0);
        seen.status.fault.is_some() || driven > looks
    })?;
    if let Some(fault) = seen.and_then(|seen| seen.status.fault) {
        return Ok(Finding::failed(
            format!(
                "the board switched the heater's output off before the lamp could light, because of {}",
                describe(fault)
            ),
            "remove the cause of this fault, such as a thermistor that is disconnected or warm, and repeat this step",
        ));
    }
    check_lamp(session)
}

/// Checks with the person that the lamp is lit, and that the emergency stop switches it off.
pub fn check_lamp(session: &mut DoctorSession) -> Result<Finding, Failure> {
    let lit = session.ask(
        "Is the lamp lit? Answer soon: the board will detect that the nozzle stays cold and switch off.",
        AnswerKind::YesOrNo,
    );
    // The status is read first, because the emergency stop changes it. Without an answer the stop is sent at once.
    let status = matches!(lit, Ok(Some(_))).then(|| session.status());
    session.emergency_stop()?;
    let (Some(lit), Some(status)) = (lit?, status) else { return Ok(Finding::skipped()) };
    // The answer about the lamp counts only if the board was driving the lamp.
    if let Some(by) = switched_off_by(&status?) {
        return Ok(Finding::failed(
            format!("the board switched the heater's output off before you answered, because of {by}"),
            "repeat this step, and answer sooner",
        ));
    }
    if lit != OperatorAnswer::Yes {
        return Ok(Finding::failed(
            "the lamp stayed dark",
            "check the supply at the heater's terminals, both switches of the heater and their wires, and that the \
             lamp is for the supply's voltage",
        ));
    }
    Ok(match session.ask("The emergency stop was sent. Is the lamp dark now?", AnswerKind::YesOrNo)? {
        None => Finding::skipped(),
        Some(OperatorAnswer::Yes) => Finding::passed("the emergency stop switches the lit lamp off"),
        Some(_) => Finding::failed(
            "the lamp is lit after the emergency stop",
            "cut the power: the power stage or the second switch conducts by itself; replace it, and do not connect a \
             heater",
        ),
    })
}

/// Returns the reason why the board has switched the heater off. `None` if the board is still in maintenance without
/// a fault.
fn switched_off_by(status: &Status) -> Option<String> {
    match (status.fault, status.state) {
        (Some(fault), _) => Some(describe(fault)),
        (None, State::Maintenance) => None,
        (None, state) => Some(format!("the board's state {}", state.name())),
    }
}

/// Heats the nozzle itself, to a low temperature.
pub fn nozzle(session: &mut DoctorSession) -> Result<Finding, Failure> {
    let question = format!(
        "Connect the nozzle's heater in place of the lamp, with its thermal cut-off and the thermistor in its seat, \
         and keep your hand at the supply's switch. The board will heat the nozzle to {LOW_C} C."
    );
    if !session.confirm(&question)? {
        return Ok(Finding::skipped());
    }
    if let Some(why) = session.maintain(preheat())? {
        return Ok(Finding::failed(why, "see the state of the board with `growbot status`"));
    }
    let time = patience(session);
    note!("this step takes up to {} s", time.as_secs());
    let band = session.robot.description().heater.band_c;
    let mut in_band = 0;
    let seen = session.wait_until(time, None, |seen| {
        let temperature_c = seen.status.temperature_centi_c.map_or(0.0, celsius);
        in_band = if (temperature_c - LOW_C).abs() <= band { in_band + 1 } else { 0 };
        seen.status.fault.is_some() || in_band > 50
    })?;
    session.switch_off()?;
    Ok(match seen.map(|seen| (seen.status.fault, seen.status.temperature_centi_c.unwrap_or_default())) {
        Some((None, centi)) => {
            Finding::passed(format!("nozzle at {:.1} C, within {band} C of {LOW_C} C for 5 s", celsius(centi)))
        }
        Some((Some(fault), _)) => Finding::failed(
            describe(fault),
            "the heater is off: remove the cause of this fault, and compare [heater] of the robot file with the parts",
        ),
        None => Finding::failed(
            format!("the nozzle did not come within {band} C of {LOW_C} C in {} s", time.as_secs()),
            "check the heater, the supply and the thermistor's seat; then find the heater's gains with `growbot tune`",
        ),
    })
}
