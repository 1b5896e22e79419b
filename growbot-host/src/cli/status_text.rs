//! Status of a robot as text, for the command and the console.

use growbot_client::status::{FaultStatus, ImageStatus, RobotStatus, SensorStatus};
use growbot_core::link::message::{DriverProblem, Fault};
use growbot_pictures::clock_text::local_clock_text;
use growbot_pictures::duration::duration_text;
use growbot_pictures::growth_table::made;
use growbot_plan::figures::fixed;
use growbot_plan::robot_kind::RobotKind;
use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;

use super::remedies;

/// Returns the status of a robot as a few lines of text. What is not known is left out.
pub fn status_text(status: &RobotStatus) -> String {
    let simulated = RobotKind::from(status.simulated).suffix();
    let age = status.status_age_s.map_or("never".to_owned(), |age_s| format!("{age_s:.0} s ago"));
    let mut text = String::new();
    if let Some(name) = &status.name {
        text += &format!("robot        {name}, owned by the service{simulated}\n");
    }
    if let Some(error) = &status.connection_error {
        return text + &format!("problem      {error}\nlast report  {age}\n");
    }
    if let Some(firmware) = &status.firmware {
        let described = described(status.robot.as_deref(), status.robot_hash.as_deref());
        text += &match &status.name {
            Some(_) => format!("description  {described}, firmware {firmware}\n"),
            None => format!("robot        {described}, firmware {firmware}{simulated}\n"),
        };
    }
    text += &format!("state        {}\n", status.state.as_deref().unwrap_or("unknown"));
    if status.stale {
        text += &format!("stale        the board last reported {age}, so what is shown here may have changed\n");
    }
    if let Some(fault) = &status.fault {
        let explanation = fault
            .parse::<Fault>()
            .map_or_else(|_| status.fault_explanation.clone().unwrap_or_default(), remedies::fault_explanation);
        text += &format!("fault        {fault}: {explanation}\n");
    }
    text += &format!("temperature  {}\n", temperature_text(status.temperature_c, status.target_c));
    text += &match status.job.as_ref().or(status.plan_id.as_ref()) {
        None => "job          none\n".to_owned(),
        Some(job) => {
            format!("job          {job}, {} of {} layers laid, {} stored\n", status.laid, status.layers, status.stored)
        }
    };
    let finish = status.finish_utc.as_ref().and_then(|finish| OffsetDateTime::parse(finish, &Rfc3339).ok());
    if let (Some(left_s), Some(finish)) = (status.left_s, finish) {
        text += &format!("time left    {}, done at {}\n", duration_text(left_s), local_clock_text(finish));
    }
    if let Some(layer) = &status.interrupted {
        text += &format!("interrupted  layer {}: {}\n", layer.layer, made(layer));
    }
    if let Some(pause) = &status.pause_explanation {
        text += &format!("paused       {pause}\n");
    }
    if status.journal == Some(false) {
        text += "journal      failed: this body cannot be resumed after a reset\n";
    }
    if let Some(error) = &status.command_error {
        text += &format!("problem      {error}\n");
    }
    // The service is the owner of its robots.
    if let (Some(owner), None) = (&status.owner, &status.name) {
        text += &format!("owned by     {owner}\n");
    }
    if let (Some(uptime_s), Some(cause), Some(boot_id)) = (status.uptime_s, &status.reset_cause, status.boot_id) {
        text += &format!("board        up {uptime_s:.1} s, started by {cause}, boot {boot_id:08x}\n");
    }
    if let Some(image) = &status.image {
        text += &format!("image        {}\n", text_of_image(image));
    }
    if let Some(sensors) = &status.sensors {
        text += &format!("sensors      {}\n", text_of_sensors(sensors));
    }
    if let Some(fault) = &status.latest_fault {
        text += &text_of_fault(fault);
    }
    text
}

/// Returns the name and the hash of a board's description, or a remedy if the board has none.
pub fn described(name: Option<&str>, hash: Option<&str>) -> String {
    match (name, hash) {
        (Some(name), Some(hash)) => format!("{name} ({hash})"),
        _ => "none: the board is not configured; send it a description with `growbot configure`".to_owned(),
    }
}

fn text_of_image(image: &ImageStatus) -> String {
    match (&image.crc, &image.found_crc) {
        (None, _) => "not sealed: the board has not checked it".to_owned(),
        (Some(crc), None) => format!("checked at the start, CRC {crc}"),
        (Some(sealed), Some(found)) => {
            format!("corrupt: its CRC is {found}, the CRC in its seal {sealed}; flash the board again")
        }
    }
}

fn temperature_text(temperature_c: Option<f64>, target_c: Option<f64>) -> String {
    let temperature = temperature_c.map_or("no reading".to_owned(), |celsius| format!("{celsius:.1} C"));
    let target = target_c.map_or("heater off".to_owned(), |celsius| format!("target {celsius:.1} C"));
    format!("{temperature}, {target}")
}

fn text_of_sensors(sensors: &SensorStatus) -> String {
    let mut parts = Vec::new();
    if let Some(volts) = sensors.supply_v {
        parts.push(format!("supply {volts:.1} V"));
    }
    parts.push(if sensors.on_index { "head on its mark" } else { "head off its mark" }.to_string());
    if let Some(present) = sensors.filament_present {
        parts.push(if present { "filament" } else { "no filament" }.to_string());
    }
    match &sensors.driver_problem {
        Some(driver) => parts.push(format!("{} driver {}", driver.motor, driver.problem)),
        None if sensors.driver_fault == Some(true) => parts.push("driver fault".to_string()),
        None => {}
    }
    if sensors.emergency_stop == Some(true) {
        parts.push("emergency stop pressed".to_string());
    }
    if let Some([x, y, z]) = sensors.gravity_g {
        parts.push(format!("gravity {} {} {}", fixed(x, 2), fixed(y, 2), fixed(z, 2)));
    }
    parts.join(", ")
}

fn text_of_fault(fault: &FaultStatus) -> String {
    let since = if fault.cleared { ", cleared since" } else { "" };
    let interrupted = match fault.begun.saturating_sub(fault.laid) {
        0 => String::new(),
        _ => format!(", layer {} interrupted", fault.laid),
    };
    let mut text = format!(
        "last fault   {}, while {}, {:.1} s after the start of the board{since}\n",
        fault.fault, fault.state, fault.uptime_s
    );
    text += &format!(
        "             {}, duty {:.0} %, {} layers laid{interrupted}\n",
        temperature_text(fault.temperature_c, fault.target_c),
        fault.duty * 100.0,
        fault.laid
    );
    if let Some(driver) = &fault.sensors.driver_problem
        && let Ok(problem) = driver.problem.parse::<DriverProblem>()
    {
        text += &format!("             the {}'s driver {}\n", driver.motor, problem.explanation());
    }
    text
}

#[cfg(test)]
mod tests {
    use growbot_core::link::message::{DriverReport, FaultRecord, Motor, SensorReadings, State};
    use serde_json::json;

    use super::*;

    #[test]
    fn a_driver_problem_is_reported_with_cause_and_remedy() {
        let trouble = Some(DriverReport { motor: Motor::Feed, problem: DriverProblem::Silent });
        let sensors = SensorReadings { driver_fault: Some(true), driver_problem: trouble, ..SensorReadings::default() };
        let readings = SensorStatus::from(&sensors);
        assert_eq!(text_of_sensors(&readings), "head off its mark, feed driver silent");
        assert_eq!(json!(readings)["driver_problem"], json!({ "motor": "feed", "problem": "silent" }));
        let record = FaultRecord {
            fault: Some(Fault::DriverFault),
            cleared: false,
            state: State::Heating,
            uptime_ms: 5000,
            temperature_centi_c: Some(2500),
            target_centi_c: None,
            duty: 0,
            sensors,
            plan_id: 0,
            laid: 0,
            layers_begun: 0,
        };
        let text = text_of_fault(&FaultStatus::from(&record));
        let expected = "the feed's driver does not respond: check the motors' supply, without which the driver is off";
        assert!(text.contains(expected), "{text}");
    }
}
