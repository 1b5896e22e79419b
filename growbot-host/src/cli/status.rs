//! `growbot status`: shows the identity and the state of the board.

use std::path::PathBuf;

use clap::Args;
use growbot_client::client::{Client, ClientError};
use growbot_core::link::crash::{CrashRecord, CrashWords};
use growbot_core::link::message::{
    BoardInfo, BootReport, DriverReport, Fault, FaultRecord, ImageCheck, Refusal, SensorReadings, State, celsius,
};
use growbot_host::clock_text::local_clock_text;
use growbot_host::crash::{CrashReport, FirmwareImage};
use growbot_host::output::print;
use growbot_pictures::duration::duration_text;
use growbot_plan::figures::fixed;
use growbot_plan::forecast::Forecast;
use growbot_plan::robot_file;
use growbot_plan::run_log::{InterruptedLayerJson, utc_text};
use growbot_plan::sanitize::json_line;
use serde_json::{Value, json};
use time::OffsetDateTime;

use super::failure::Failure;
use super::flash::built_images;
use super::growth_table::made;
use super::port_arg::RequiredPortArg;
use super::remedies;
use super::robot_arg::RobotArg;
use super::service_robot::find_service_robot;

/// Show the identity, state and sensors of the robot's board
///
/// The latest fault is shown with its data at that time, until the next fault or until the board loses its power.
#[derive(Args)]
#[command(after_help = "Example:\n  growbot status --port /dev/ttyACM0")]
pub struct StatusArgs {
    #[command(flatten)]
    port: RequiredPortArg,
    #[command(flatten)]
    robot: RobotArg,
    /// After a crash: firmware image that gives the names of functions and lines
    ///
    /// The default is the image that `growbot flash` built last, if it is the one that crashed.
    #[arg(long, value_name = "FILE")]
    elf: Option<PathBuf>,
    /// Print one line of JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &StatusArgs) -> Result<(), Failure> {
    let port = args.port.resolve()?;
    if let Some(owned) = find_service_robot(&port)? {
        return owned.status(args.json);
    }
    let robot = args.robot.load()?;
    let given = args.elf.as_deref().map(FirmwareImage::open).transpose()?;
    let mut client = port.client(&robot)?;
    let mut report = BoardReport::of(&mut client, port.is_simulated())?;
    report.look_up_in(given)?;
    print(&if args.json { json_line(&report.json()) } else { report.text() })?;
    Ok(())
}

/// Everything that a board reports.
pub struct BoardReport {
    simulated: bool,
    hello: BoardInfo,
    sensors: SensorReadings,
    latest_fault: Option<FaultRecord>,
    /// Report of the start. `None` if the board's firmware does not know the request.
    boot: Option<BootReport>,
    /// Image that names the functions and lines of a crash. `None` if no image is known.
    image: Option<FirmwareImage>,
}

impl BoardReport {
    /// Requests the report from the board.
    pub fn of(client: &mut Client, simulated: bool) -> Result<Self, ClientError> {
        Ok(Self {
            simulated,
            hello: client.identify()?,
            sensors: client.sensors()?,
            latest_fault: client.latest_fault()?,
            boot: match client.boot_report() {
                Ok(report) => Some(report),
                Err(ClientError::Refused { refusal: Refusal::UnknownRequest, .. }) => None,
                Err(error) => return Err(error),
            },
            image: None,
        })
    }

    /// Sets the image of a crash: the given one, or the one that was built last if it is the one that crashed. Returns
    /// an error if the given image is not the one that crashed.
    fn look_up_in(&mut self, given: Option<FirmwareImage>) -> Result<(), Failure> {
        let Some(crashed) = self.crash_words().map(CrashRecord::from) else { return Ok(()) };
        if let (Some(image), Some(crc)) = (&given, crashed.image)
            && image.crc() != Some(crc)
        {
            let other = image.crc().map_or_else(|| "none".to_string(), |crc| format!("{crc:08x}"));
            return Err(Failure::bad_input(format!(
                "the image given with --elf is not the image that crashed: the CRC of the given image is {other}, but \
                 the crash record has CRC {crc:08x}; give the image that the board was flashed with"
            )));
        }
        let built = || {
            let images = built_images().into_iter().filter_map(|image| FirmwareImage::open(&image).ok());
            images.into_iter().find(|image| crashed.image.is_some() && image.crc() == crashed.image)
        };
        self.image = given.or_else(built);
        Ok(())
    }

    fn crash_words(&self) -> Option<&CrashWords> {
        self.boot.as_ref()?.crash.as_ref()
    }

    fn crash(&self) -> Option<CrashReport<'_>> {
        self.crash_words().map(|words| CrashReport::new(words, self.image.as_ref()))
    }

    fn json(&self) -> Value {
        let mut value = json_of(&self.hello, self.simulated);
        if let Value::Object(fields) = &mut value {
            fields.insert("simulated".to_string(), self.simulated.into());
            fields.insert("sensors".to_string(), json_of_sensors(&self.sensors));
            fields
                .insert("image".to_string(), self.boot.as_ref().map_or(Value::Null, |boot| json_of_image(boot.image)));
            fields.insert("crash".to_string(), json!(self.crash().map(|crash| crash.to_json())));
            fields.insert("latest_fault".to_string(), self.latest_fault.as_ref().map_or(Value::Null, json_of_record));
        }
        value
    }

    /// Returns the report as a few lines of text.
    pub fn text(&self) -> String {
        let mut text = text_of(&self.hello, self.simulated);
        if let Some(boot) = &self.boot {
            text += &format!("image        {}\n", text_of_image(boot.image));
        }
        text += &format!("sensors      {}\n", text_of_sensors(&self.sensors));
        if let Some(record) = &self.latest_fault {
            text += &text_of_record(record);
        }
        if let Some(crash) = self.crash() {
            text += &crash.text();
            text += &match (crash.image, crash.record.image) {
                (Some(_), _) => String::new(),
                (None, Some(crc)) => {
                    format!("             for functions and lines, give the image with CRC {crc:08x} with --elf FILE\n")
                }
                (None, None) => {
                    "             for functions and lines, give the flashed ELF image with --elf FILE\n".to_owned()
                }
            };
        }
        text
    }
}

fn text_of_image(image: ImageCheck) -> String {
    match image {
        ImageCheck::Unsealed => "not sealed: the board has not checked it".to_string(),
        ImageCheck::Valid { crc } => format!("checked at the start, CRC {crc:08x}"),
        ImageCheck::Corrupt { sealed, found } => {
            format!("corrupt: its CRC is {found:08x}, the CRC in its seal {sealed:08x}; flash the board again")
        }
    }
}

fn json_of_image(image: ImageCheck) -> Value {
    let (check, crc) = match image {
        ImageCheck::Unsealed => ("not-sealed", None),
        ImageCheck::Valid { crc } => ("sound", Some(crc)),
        ImageCheck::Corrupt { sealed, .. } => ("corrupt", Some(sealed)),
    };
    json!({ "check": check, "crc": crc.map(|crc| format!("{crc:08x}")) })
}

fn json_of_sensors(sensors: &SensorReadings) -> Value {
    json!({
        "supply_v": sensors.supply_mv.map(|millivolts| f64::from(millivolts) / 1000.0),
        "on_index": sensors.on_index,
        "filament_present": sensors.filament_present,
        "filament_pulses": sensors.filament_pulses,
        "driver_fault": sensors.driver_fault,
        "driver_problem": sensors.driver_problem.map(|trouble| json!({
            "motor": trouble.motor.name(),
            "problem": trouble.problem.code(),
        })),
        "emergency_stop": sensors.emergency_stop,
        "gravity_g": sensors.gravity_milli_g.map(|gravity| gravity.map(|milli| f64::from(milli) / 1000.0)),
    })
}

/// Returns the code of the fault in a record. A record without a fault is that of an emergency stop, and has the code
/// `emergency-stop`.
fn fault_code(record: &FaultRecord) -> &'static str {
    record.fault.map_or("emergency-stop", Fault::code)
}

fn json_of_record(record: &FaultRecord) -> Value {
    json!({
        "fault": fault_code(record),
        "cleared": record.cleared,
        "state": record.state.name(),
        "uptime_s": record.uptime_ms as f64 / 1000.0,
        "temperature_c": record.temperature_centi_c.map(celsius),
        "target_c": record.target_centi_c.map(celsius),
        "duty": f64::from(record.duty) / f64::from(u16::MAX),
        "sensors": json_of_sensors(&record.sensors),
        "plan_id": (record.plan_id != 0).then(|| format!("{:016x}", record.plan_id)),
        "laid": record.laid,
        "begun": record.layers_begun,
    })
}

fn text_of_sensors(sensors: &SensorReadings) -> String {
    let mut parts = Vec::new();
    if let Some(millivolts) = sensors.supply_mv {
        parts.push(format!("supply {:.1} V", f64::from(millivolts) / 1000.0));
    }
    parts.push(if sensors.on_index { "head on its mark" } else { "head off its mark" }.to_string());
    if let Some(present) = sensors.filament_present {
        parts.push(if present { "filament" } else { "no filament" }.to_string());
    }
    match sensors.driver_problem {
        Some(DriverReport { motor, problem }) => parts.push(format!("{} driver {}", motor.name(), problem.code())),
        None if sensors.driver_fault == Some(true) => parts.push("driver fault".to_string()),
        None => {}
    }
    if sensors.emergency_stop == Some(true) {
        parts.push("emergency stop pressed".to_string());
    }
    if let Some(gravity) = sensors.gravity_milli_g {
        let [x, y, z] = gravity.map(|milli| f64::from(milli) / 1000.0);
        parts.push(format!("gravity {} {} {}", fixed(x, 2), fixed(y, 2), fixed(z, 2)));
    }
    parts.join(", ")
}

/// Returns the record of a fault as a few lines of text.
pub fn text_of_record(record: &FaultRecord) -> String {
    let since = if record.cleared { ", cleared since" } else { "" };
    let temperature =
        record.temperature_centi_c.map_or("no reading".to_string(), |centi| format!("{:.1} C", celsius(centi)));
    let target =
        record.target_centi_c.map_or("heater off".to_string(), |centi| format!("target {:.1} C", celsius(centi)));
    let interrupted = match record.layers_begun.saturating_sub(record.laid) {
        0 => String::new(),
        _ => format!(", layer {} interrupted", record.laid),
    };
    let mut text = format!(
        "last fault   {}, while {}, {:.1} s after the start of the board{since}\n",
        fault_code(record),
        record.state.name(),
        record.uptime_ms as f64 / 1000.0
    );
    text += &format!(
        "             {temperature}, {target}, duty {:.0} %, {} layers laid{interrupted}\n",
        f64::from(record.duty) / f64::from(u16::MAX) * 100.0,
        record.laid
    );
    if let Some(DriverReport { motor, problem }) = record.sensors.driver_problem {
        text += &format!("             the {}'s driver {}\n", motor.name(), problem.explanation());
    }
    text
}

fn json_of(hello: &BoardInfo, is_simulated: bool) -> Value {
    let status = &hello.status;
    let time_left = time_left(hello, OffsetDateTime::now_utc()).filter(|_| !is_simulated);
    json!({
        "robot": is_configured(hello).then_some(&hello.robot_name),
        "robot_hash": is_configured(hello).then(|| format!("{:016x}", hello.robot_hash)),
        "firmware": version(hello),
        "schema": format!("{:016x}", hello.schema_hash),
        "boot_id": hello.boot_id,
        "reset_cause": hello.reset_cause.name(),
        "state": status.state.name(),
        "fault": status.fault.map(Fault::code),
        "temperature_c": status.temperature_centi_c.map(celsius),
        "target_c": status.target_centi_c.map(celsius),
        "duty": f64::from(status.duty) / f64::from(u16::MAX),
        "plan_id": (status.plan_id != 0).then(|| format!("{:016x}", status.plan_id)),
        "layers": status.layer_count,
        "laid": status.layers_laid,
        "stored": status.next_layer.saturating_sub(status.layers_laid),
        "capacity": hello.layer_capacity,
        "interrupted": status.interrupted.map(|layer| InterruptedLayerJson::new(status.layers_laid as usize, layer)),
        "pause_cause": is_paused(status.state).then(|| status.pause_cause.code()),
        "journal": status.is_resumable,
        "owner": hello.owner.as_ref().map(|owner| String::from_utf8_lossy(owner).into_owned()),
        "uptime_s": status.uptime_ms as f64 / 1000.0,
        "left_s": time_left.map(|(left_s, _)| left_s),
        "finish_utc": time_left.map(|(_, finish)| utc_text(finish)),
    })
}

/// Returns true if the board has a robot description.
pub fn is_configured(hello: &BoardInfo) -> bool {
    hello.robot_hash != 0
}

/// Returns the name and the hash of the board's description, or a remedy if the board has none.
pub fn described(hello: &BoardInfo) -> String {
    if is_configured(hello) {
        format!("{} ({:016x})", hello.robot_name, hello.robot_hash)
    } else {
        "none: the board is not configured; send it a description with `growbot configure`".to_string()
    }
}

fn is_paused(state: State) -> bool {
    matches!(state, State::Paused | State::Parked)
}

fn version(hello: &BoardInfo) -> String {
    let [major, minor, patch] = hello.firmware;
    format!("{major}.{minor}.{patch}")
}

/// Returns the remaining time of a growth, s, and its finish time. `None` if the board does not grow, or if its robot
/// is not known.
fn time_left(hello: &BoardInfo, now: OffsetDateTime) -> Option<(f64, OffsetDateTime)> {
    let robot =
        robot_file::load(hello.robot_name.as_str().as_ref()).ok().filter(|robot| robot.hash() == hello.robot_hash)?;
    let forecast = Forecast { period_s: robot.description().layer.period_s, pace: 1.0 };
    let finish = forecast.finish_of(now, &hello.status)?;
    Some(((finish - now).as_seconds_f64(), finish))
}

/// Returns the status as a few lines of text.
fn text_of(hello: &BoardInfo, is_simulated: bool) -> String {
    let status = &hello.status;
    let temperature = status.temperature_centi_c.map_or("no reading".to_string(), |t| format!("{:.1} C", celsius(t)));
    let target = status.target_centi_c.map_or("heater off".to_string(), |t| format!("target {:.1} C", celsius(t)));
    let job = match status.plan_id {
        0 => "none".to_string(),
        id => {
            format!(
                "{id:016x}, {} of {} layers laid, {} stored",
                status.layers_laid,
                status.layer_count,
                status.next_layer.saturating_sub(status.layers_laid)
            )
        }
    };
    let simulated = if is_simulated { ", simulated" } else { "" };
    let mut text = format!("robot        {}, firmware {}{simulated}\n", described(hello), version(hello));
    text += &format!("state        {}\n", status.state.name());
    if let Some(fault) = status.fault {
        text += &format!("fault        {}: {}\n", fault.code(), remedies::fault_explanation(fault));
    }
    text += &format!("temperature  {temperature}, {target}\n");
    text += &format!("job          {job}\n");
    if let Some((left_s, finish)) = time_left(hello, OffsetDateTime::now_utc()).filter(|_| !is_simulated) {
        text += &format!("time left    {}, done at {}\n", duration_text(left_s), local_clock_text(finish));
    }
    if let Some(interrupted) = status.interrupted {
        text += &format!("interrupted  layer {}: {}\n", status.layers_laid, made(interrupted));
    }
    if is_paused(status.state) {
        text += &format!("paused       {}\n", status.pause_cause.explanation());
    }
    if !status.is_resumable {
        text += "journal      failed: this body cannot be resumed after a reset\n";
    }
    if let Some(owner) = &hello.owner {
        text += &format!("owned by     {}\n", String::from_utf8_lossy(owner));
    }
    text += &format!(
        "board        up {:.1} s, started by {}, boot {:08x}\n",
        status.uptime_ms as f64 / 1000.0,
        hello.reset_cause.name(),
        hello.boot_id
    );
    text
}

#[cfg(test)]
mod tests {
    use growbot_core::link::message::{DriverProblem, Motor};

    use super::*;

    #[test]
    fn a_driver_problem_is_reported_with_cause_and_remedy() {
        let trouble = Some(DriverReport { motor: Motor::Feed, problem: DriverProblem::Silent });
        let sensors = SensorReadings { driver_fault: Some(true), driver_problem: trouble, ..SensorReadings::default() };
        assert_eq!(text_of_sensors(&sensors), "head off its mark, feed driver silent");
        assert_eq!(json_of_sensors(&sensors)["driver_problem"], json!({ "motor": "feed", "problem": "silent" }));
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
        let text = text_of_record(&record);
        let expected = "the feed's driver does not respond: check the motors' supply, without which the driver is off";
        assert!(text.contains(expected), "{text}");
    }
}
