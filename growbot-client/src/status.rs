//! Status of a robot: of its board, of the connection to the board, and of its job. The command line, the console, the
//! service and its page show this one type.

use std::time::Duration;

use growbot_core::link::crash::CrashRecord;
use growbot_core::link::message::{
    BoardInfo, BootReport, DriverReport, Fault, FaultRecord, ImageCheck, Refusal, SensorReadings, State, Status,
    celsius,
};
use growbot_plan::crash::CrashJson;
use growbot_plan::forecast::Forecast;
use growbot_plan::robot_file;
use growbot_plan::robot_kind::RobotKind;
use growbot_plan::run_log::{InterruptedLayerJson, utc_text};
use serde::{Deserialize, Serialize};
use time::OffsetDateTime;

use crate::client::{Client, ClientError};
use crate::command_report::TuningReport;
use crate::stop_signal::StopLevel;

/// Age of the board's latest status beyond which the status is stale.
const STALE_AFTER: Duration = Duration::from_secs(5);

/// State of the connection to a robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum ConnectionState {
    /// The robot's port is missing, or its board does not respond.
    Disconnected,
    /// The robot is connected and has no job.
    #[default]
    Ready,
    /// The robot has a job.
    Busy,
}

/// Status of a robot. A field is null if it is not known.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct RobotStatus {
    /// Name of the robot in the service. Null without a service.
    pub name: Option<String>,
    /// Port of the robot.
    pub port: String,
    /// True if the robot is simulated.
    pub simulated: bool,
    /// Pace of the robot's time, in multiples of real time.
    pub pace: Option<f64>,
    /// State of the connection.
    pub connection: ConnectionState,
    /// Reason why the robot is not connected. Null if it is connected.
    pub connection_error: Option<String>,
    /// Time since the board's latest report, s. What the board reports in its status is as old. Null before the first
    /// report.
    pub status_age_s: Option<f64>,
    /// True if the latest report is older than 5 s, or if there is none. The board may be in another state by now.
    pub stale: bool,
    /// Name of the robot description of the board. Null if the board has none.
    pub robot: Option<String>,
    /// Hash of the robot description, 16 hexadecimal digits.
    pub robot_hash: Option<String>,
    /// Version of the firmware.
    pub firmware: Option<String>,
    /// Hash of the schema of the link's messages, 16 hexadecimal digits.
    pub schema: Option<String>,
    /// Number of the board's present start, which differs from start to start.
    pub boot_id: Option<u32>,
    /// Cause of the board's latest start.
    pub reset_cause: Option<String>,
    /// Number of layers that the board can store.
    pub capacity: Option<u32>,
    /// Name of the host that owns the board. Null if no host owns it.
    pub owner: Option<String>,
    /// State of the board. Null if the robot is not connected.
    pub state: Option<String>,
    /// Code of the latched fault. Null if no fault is latched.
    pub fault: Option<String>,
    /// Explanation of the fault. Null if no fault is latched.
    pub fault_explanation: Option<String>,
    /// Code of the cause of a pause. Null if the board does not pause.
    pub pause_cause: Option<String>,
    /// Explanation of the pause. Null if the board does not pause.
    pub pause_explanation: Option<String>,
    /// Temperature of the nozzle, C. Null without a reading.
    pub temperature_c: Option<f64>,
    /// Target temperature of the nozzle, C. Null while the heater is off.
    pub target_c: Option<f64>,
    /// Duty of the heater, 0 to 1.
    pub duty: Option<f64>,
    /// Plan id of the job that the board stores, 16 hexadecimal digits. Null if it stores none.
    pub plan_id: Option<String>,
    /// Number of layers of the job that the board stores.
    pub layers: u32,
    /// Number of laid layers of the job that the board stores.
    pub laid: u32,
    /// Number of layers that the board has received and not laid.
    pub stored: u32,
    /// The interrupted layer. Null if no layer was interrupted.
    pub interrupted: Option<InterruptedLayerJson>,
    /// True if the job can be resumed after a reset or a loss of power.
    pub journal: Option<bool>,
    /// Time since the board started, s.
    pub uptime_s: Option<f64>,
    /// Identifier of the active job in the service. Null if the robot has no such job.
    pub job: Option<String>,
    /// Expected time until the last layer is laid, s. Null unless the robot grows at a known pace.
    pub left_s: Option<f64>,
    /// Expected date and time of the last layer, RFC 3339. Null unless the robot grows at a known pace.
    pub finish_utc: Option<String>,
    /// Reason why the board did not carry out the latest command, or why the run log cannot be written. Null otherwise.
    pub command_error: Option<String>,
    /// Stop that the board has not confirmed. It is sent before anything else, also after a restart of the service.
    /// Null if there is none.
    pub pending_stop: Option<StopLevel>,
    /// Gains that the latest tuning of the heater in the service has found. Null if there is none.
    pub tuning: Option<TuningReport>,
    /// Readings of the sensors.
    pub sensors: Option<SensorStatus>,
    /// Check of the firmware's image at the start of the board.
    pub image: Option<ImageStatus>,
    /// Latest crash of the firmware. Null if the board has recorded none.
    pub crash: Option<CrashJson>,
    /// Latest fault, with the board's data at that time. Null if the board has recorded none.
    pub latest_fault: Option<FaultStatus>,
}

impl RobotStatus {
    /// Sets what the board has reported about itself: all except its sensors, its image, its latest crash and its
    /// latest fault.
    pub fn set_board(&mut self, board: &BoardInfo) {
        let [major, minor, patch] = board.firmware;
        let is_configured = board.robot_hash != 0;
        self.robot = is_configured.then(|| board.robot_name.to_string());
        self.robot_hash = is_configured.then(|| format!("{:016x}", board.robot_hash));
        self.firmware = Some(format!("{major}.{minor}.{patch}"));
        self.schema = Some(format!("{:016x}", board.schema_hash));
        self.boot_id = Some(board.boot_id);
        self.reset_cause = Some(board.reset_cause.name().to_owned());
        self.capacity = Some(board.layer_capacity);
        self.owner = board.owner.as_ref().map(|owner| String::from_utf8_lossy(owner).into_owned());
        self.set_status(&board.status);
    }

    /// Sets the fields of the board's status.
    pub fn set_status(&mut self, status: &Status) {
        let pause = status.pause();
        self.state = Some(status.state.name().to_owned());
        self.fault = status.fault.map(|fault| Fault::code(fault).to_owned());
        self.fault_explanation = status.fault.map(|fault| fault.explanation().to_owned());
        self.pause_cause = pause.map(|cause| cause.code().to_owned());
        self.pause_explanation = pause.map(|cause| cause.explanation().to_owned());
        self.temperature_c = status.temperature_centi_c.map(celsius);
        self.target_c = status.target_centi_c.map(celsius);
        self.duty = Some(fraction(status.duty));
        self.plan_id = plan_id_text(status.plan_id);
        self.layers = status.layer_count;
        self.laid = status.layers_laid;
        self.stored = status.next_layer.saturating_sub(status.layers_laid);
        self.interrupted =
            status.interrupted.map(|layer| InterruptedLayerJson::new(status.layers_laid as usize, layer));
        self.journal = Some(status.is_resumable);
        self.uptime_s = Some(status.uptime_ms as f64 / 1000.0);
    }

    /// Sets what the board reports beside its status.
    pub fn set_details(&mut self, details: &BoardDetails) {
        self.sensors = Some(SensorStatus::from(&details.sensors));
        self.latest_fault = details.latest_fault.as_ref().map(FaultStatus::from);
        self.image = details.boot.as_ref().map(|boot| ImageStatus::from(boot.image));
        let crash = details.boot.as_ref().and_then(|boot| boot.crash.as_ref());
        self.crash = crash.map(|words| CrashJson::from(&CrashRecord::from(words)));
    }

    /// Requests the status of a board without a service. `port` is the name of its port, and `pace` that of its time.
    ///
    /// # Errors
    /// Like [`Client::request`].
    pub fn read(client: &mut Client, port: &str, kind: RobotKind, pace: Option<f64>) -> Result<Self, ClientError> {
        let board = client.identify()?;
        let mut status = Self {
            port: port.to_owned(),
            simulated: kind.is_simulated(),
            pace,
            connection: ConnectionState::Ready,
            status_age_s: Some(0.0),
            ..Self::default()
        };
        status.set_details(&BoardDetails::read(client)?);
        status.set_board(&board);
        let now = OffsetDateTime::now_utc();
        let robot = robot_file::load(board.robot_name.as_str().as_ref()).ok();
        let robot = robot.filter(|robot| robot.hash() == board.robot_hash);
        let forecast = robot.zip(pace);
        let forecast = forecast.map(|(robot, pace)| Forecast { period_s: robot.description().layer.period_s, pace });
        status.set_finish(forecast.and_then(|forecast| forecast.finish_of(now, &board.status)), now);
        Ok(status)
    }

    /// Sets the state of the board after an event. The status that follows has the cause of a fault or of a pause, and
    /// the finish time.
    pub fn set_state(&mut self, state: State) {
        self.state = Some(state.name().to_owned());
        (self.left_s, self.finish_utc) = (None, None);
        (self.fault, self.fault_explanation, self.pause_cause, self.pause_explanation) = (None, None, None, None);
    }

    /// Sets the time since the board's latest report, s. `None` before the first report.
    pub fn set_age(&mut self, age_s: Option<f64>) {
        self.status_age_s = age_s;
        self.stale = age_s.is_none_or(|age_s| age_s > STALE_AFTER.as_secs_f64());
    }

    /// Sets the expected date and time of the last layer. `now` is the current date and time.
    pub fn set_finish(&mut self, finish: Option<OffsetDateTime>, now: OffsetDateTime) {
        self.left_s = finish.map(|finish| (finish - now).as_seconds_f64());
        self.finish_utc = finish.map(utc_text);
    }

    /// Returns a copy without the times that pass by themselves, so that two statuses can be compared.
    pub fn without_times(&self) -> Self {
        Self { status_age_s: None, uptime_s: None, left_s: None, ..self.clone() }
    }
}

/// Sensors, latest fault and start of a board.
#[derive(Debug, Clone)]
pub struct BoardDetails {
    sensors: SensorReadings,
    latest_fault: Option<FaultRecord>,
    /// Report about the start of the board. `None` for a board that has none.
    boot: Option<BootReport>,
}

impl BoardDetails {
    /// Requests the details from a board.
    ///
    /// # Errors
    /// Like [`Client::request`].
    pub fn read(client: &mut Client) -> Result<Self, ClientError> {
        let boot = match client.boot_report() {
            Ok(report) => Some(report),
            Err(ClientError::Refused { refusal: Refusal::UnknownRequest, .. }) => None,
            Err(error) => return Err(error),
        };
        Ok(Self { sensors: client.sensors()?, latest_fault: client.latest_fault()?, boot })
    }
}

/// Readings of a board's sensors. A field is null if the board has no such sensor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SensorStatus {
    /// Voltage of the supply, V.
    pub supply_v: Option<f64>,
    /// True if the head is at its index mark.
    pub on_index: bool,
    /// True if the filament switch detects filament.
    pub filament_present: Option<bool>,
    /// Pulses of the filament's encoder since the board started.
    pub filament_pulses: Option<u32>,
    /// True if a stepper driver reports a fault.
    pub driver_fault: Option<bool>,
    /// Problem that a stepper driver reports over its UART. Null if all drivers work.
    pub driver_problem: Option<DriverStatus>,
    /// True if the emergency stop is pressed.
    pub emergency_stop: Option<bool>,
    /// Acceleration that a resting accelerometer measures, in the tip's frame, in units of standard gravity.
    pub gravity_g: Option<[f64; 3]>,
}

/// Problem of a stepper driver.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct DriverStatus {
    /// Name of the motor.
    pub motor: String,
    /// Code of the problem.
    pub problem: String,
}

/// Check of a firmware image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ImageStatus {
    /// Result of the check: `not-sealed`, `sound` or `corrupt`.
    pub check: String,
    /// CRC in the seal of the image, 8 hexadecimal digits. Null if the image is not sealed.
    pub crc: Option<String>,
    /// CRC of a corrupt image, 8 hexadecimal digits. Null otherwise.
    pub found_crc: Option<String>,
}

/// Data of a board at the time of a fault.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct FaultStatus {
    /// Code of the fault, or `emergency-stop`.
    pub fault: String,
    /// True if the fault has been cleared since it occurred.
    pub cleared: bool,
    /// State of the board when the fault occurred.
    pub state: String,
    /// Time from the start of the board to the fault, s.
    pub uptime_s: f64,
    /// Temperature of the nozzle, C. Null without a reading.
    pub temperature_c: Option<f64>,
    /// Target temperature of the nozzle, C. Null if the heater was off.
    pub target_c: Option<f64>,
    /// Duty of the heater, 0 to 1.
    pub duty: f64,
    /// Readings of the sensors.
    pub sensors: SensorStatus,
    /// Plan id of the job. Null if there was none.
    pub plan_id: Option<String>,
    /// Number of laid layers.
    pub laid: u32,
    /// Number of begun layers.
    pub begun: u32,
}

impl From<&SensorReadings> for SensorStatus {
    fn from(sensors: &SensorReadings) -> Self {
        Self {
            supply_v: sensors.supply_mv.map(|millivolts| f64::from(millivolts) / 1000.0),
            on_index: sensors.on_index,
            filament_present: sensors.filament_present,
            filament_pulses: sensors.filament_pulses,
            driver_fault: sensors.driver_fault,
            driver_problem: sensors.driver_problem.map(|DriverReport { motor, problem }| DriverStatus {
                motor: motor.name().to_owned(),
                problem: problem.code().to_owned(),
            }),
            emergency_stop: sensors.emergency_stop,
            gravity_g: sensors.gravity_milli_g.map(|gravity| gravity.map(|milli| f64::from(milli) / 1000.0)),
        }
    }
}

impl From<ImageCheck> for ImageStatus {
    fn from(image: ImageCheck) -> Self {
        let (check, crc, found) = match image {
            ImageCheck::Unsealed => ("not-sealed", None, None),
            ImageCheck::Valid { crc } => ("sound", Some(crc), None),
            ImageCheck::Corrupt { sealed, found } => ("corrupt", Some(sealed), Some(found)),
        };
        let text = |crc: u32| format!("{crc:08x}");
        Self { check: check.to_owned(), crc: crc.map(text), found_crc: found.map(text) }
    }
}

impl From<&FaultRecord> for FaultStatus {
    fn from(record: &FaultRecord) -> Self {
        Self {
            fault: record.fault.map_or("emergency-stop", Fault::code).to_owned(),
            cleared: record.cleared,
            state: record.state.name().to_owned(),
            uptime_s: record.uptime_ms as f64 / 1000.0,
            temperature_c: record.temperature_centi_c.map(celsius),
            target_c: record.target_centi_c.map(celsius),
            duty: fraction(record.duty),
            sensors: SensorStatus::from(&record.sensors),
            plan_id: plan_id_text(record.plan_id),
            laid: record.laid,
            begun: record.layers_begun,
        }
    }
}

fn fraction(duty: u16) -> f64 {
    f64::from(duty) / f64::from(u16::MAX)
}

fn plan_id_text(plan_id: u64) -> Option<String> {
    (plan_id != 0).then(|| format!("{plan_id:016x}"))
}
