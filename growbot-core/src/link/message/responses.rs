//! The responses and events of a board.

use heapless::String;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::LayerBatch;
use super::requests::HostName;
use crate::layer_bytes::LayerBytes;
use crate::link::crash::CrashWords;
use crate::link::driver_report::DriverReport;
use crate::link::fault::Fault;
use crate::link::reset_cause::ResetCause;
use crate::link::state::State;
use crate::robot::{BoardKind, ENCODING_VERSION, RobotError};

/// Reason why the board refused a request. A refused request changes nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum Refusal {
    /// The kind of the message is unknown, or its body does not decode.
    UnknownRequest,
    /// The schema of the host's messages differs from that of the board.
    SchemaMismatch {
        /// The board's [`SCHEMA_HASH`](super::SCHEMA_HASH).
        board: u64,
    },
    /// The host has not opened this session with `Hello`.
    NoSession,
    /// The job is for another robot.
    RobotMismatch {
        /// Hash of the board's robot.
        board: u64,
    },
    /// The board stores a different plan.
    PlanMismatch {
        /// Identifier of the plan that the board stores, 0 if there is none.
        board: u64,
    },
    /// The layers do not continue the layers that the board has.
    OutOfOrder {
        /// Index of the layer that the board expects.
        expected: u32,
    },
    /// The board has no free memory for more layers now.
    LayerStoreFull,
    /// A layer exceeds a limit of the robot, or its index is beyond the end of the job.
    LayerOutOfLimits {
        /// Index of the refused layer.
        index: u32,
    },
    /// The board does not accept the request in its present state.
    WrongState {
        /// Present state of the board.
        state: State,
    },
    /// The cause of the fault still exists.
    FaultRemains {
        /// The fault.
        fault: Fault,
    },
    /// The board found no plan for these poses and this radius, because a number is not finite or out of range, or
    /// because the radius is below R_min.
    PlanningFailed,
    /// The plan has more layers than the board can store.
    PlanTooLong {
        /// Number of layers of the plan.
        layers: u32,
        /// Number of layers that the board can store.
        capacity: u32,
    },
    /// The requested temperature is outside the limits of the robot's description.
    TemperatureOutOfRange {
        /// Min temperature, hundredths of a degree Celsius.
        min: i32,
        /// Max temperature, hundredths of a degree Celsius.
        max: i32,
    },
    /// The emergency stop is still pressed.
    EmergencyStop,
    /// Another host owns the board. [`BoardInfo::owner`] is its name.
    OwnedByOtherHost {
        /// Time since the last frame of that host, ms.
        silent_ms: u32,
    },
    /// The board has begun one of the layers to be replaced.
    LayerAlreadyBegun {
        /// Index of the first layer that can still be replaced.
        first: u32,
    },
    /// The nozzle is too hot to erase the journal, which stops the processor for seconds.
    NozzleTooHot {
        /// Temperature below which the nozzle must cool, hundredths of a degree Celsius.
        below: i32,
    },
    /// The journal cannot be written, so the board could not resume the job that it would begin.
    JournalNotWritable,
    /// A debug probe has enabled debugging of the processor. The processor may halt, so the board does not heat.
    DebugProbe,
    /// The nozzle is too cold for any motion.
    NozzleTooCold {
        /// Temperature of the nozzle, hundredths of a degree Celsius.
        now: i32,
        /// Min temperature for motion, hundredths of a degree Celsius.
        min: i32,
    },
    /// The requested motion is too long.
    MoveTooLong {
        /// Max motion, um of filament or hundredths of a degree of the head.
        max: u32,
    },
    /// Head or feed are still moving.
    StillMoving,
    /// The filament switch detects no filament.
    NoFilament,
    /// The board has no robot description, so it only communicates.
    NotConfigured,
    /// The board stores a job that is not complete and would be lost with the old description.
    JobNotDone {
        /// Identifier of the job.
        plan_id: u64,
    },
    /// The robot description is not valid. The board keeps its present description.
    InvalidDescription {
        /// The defect of the description.
        error: DescriptionError,
    },
    /// The robot description could not be written to flash. The board keeps its present description.
    DescriptionNotStored,
}

/// Defect of a robot description. A host can find the field by checking the description with the same code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum DescriptionError {
    /// The version of the encoding is not the one that the board reads.
    VersionMismatch {
        /// Version of the encoding that the board reads.
        board: u8,
    },
    /// The bytes are not a description.
    Unreadable,
    /// The hash of the description is not that of the request.
    HashMismatch {
        /// Hash of the description.
        found: u64,
    },
    /// The description is too long.
    TooLong,
    /// A number is not finite, or out of its range or that of the board.
    Number,
    /// The name is not a valid name of a robot.
    Name,
    /// The thermistor has no equation, or two.
    Thermistor,
    /// A pin cannot have the function that the description gives it.
    Pins,
    /// A stepper driver cannot have these settings.
    Drivers,
    /// The description is for another kind of board.
    BoardMismatch {
        /// Kind of board in the description.
        asked: BoardKind,
        /// Kind of the board.
        board: BoardKind,
    },
}

impl From<RobotError> for DescriptionError {
    fn from(error: RobotError) -> Self {
        match error {
            RobotError::VersionMismatch { .. } => Self::VersionMismatch { board: ENCODING_VERSION },
            RobotError::Unreadable => Self::Unreadable,
            RobotError::TooLong => Self::TooLong,
            RobotError::NotFinite { .. } | RobotError::TooSmall { .. } | RobotError::TooLarge { .. } => Self::Number,
            RobotError::Name => Self::Name,
            RobotError::ThermistorEquation => Self::Thermistor,
            RobotError::Pins(_) => Self::Pins,
            RobotError::Drivers(_) => Self::Drivers,
        }
    }
}

/// The board's identity and status.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct BoardInfo {
    /// The board's [`SCHEMA_HASH`](super::SCHEMA_HASH).
    pub schema_hash: u64,
    /// Number that differs at each start of the board.
    pub boot_id: u32,
    /// Cause of the board's latest start.
    pub reset_cause: ResetCause,
    /// Version of the firmware: major, minor, patch.
    pub firmware: [u8; 3],
    /// Name of the robot in the board's description. Empty if the board has no description.
    pub robot_name: String<32>,
    /// Hash of the robot description. 0 if the board has no description.
    pub robot_hash: u64,
    /// Number of layers that the board can store.
    pub layer_capacity: u32,
    /// Status of the board.
    pub status: Status,
    /// Name of the host that owns the board.
    pub owner: Option<HostName>,
}

/// Status of the board.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Status {
    /// State of the board.
    pub state: State,
    /// Latched fault, if there is one.
    pub fault: Option<Fault>,
    /// Temperature of the nozzle, hundredths of a degree Celsius. `None` without a reading.
    pub temperature_centi_c: Option<i32>,
    /// Target temperature of the nozzle, hundredths of a degree Celsius. `None` if the heater is off.
    pub target_centi_c: Option<i32>,
    /// Duty of the power stage, 0 to 65,535. During the proof test of the second switch, that switch is open.
    pub duty: u16,
    /// Identifier of the job, 0 if there is none.
    pub plan_id: u64,
    /// Number of layers of the job.
    pub layer_count: u32,
    /// Index of the next layer that the board expects.
    pub next_layer: u32,
    /// Number of layers laid.
    pub layers_laid: u32,
    /// Progress of the layer that a stop, a fault, a reset or a loss of power interrupted, if any. The index of that
    /// layer is `laid`.
    pub interrupted: Option<InterruptedLayer>,
    /// Reason why the board pauses. It is valid in `Paused` and `Parked`.
    pub pause_cause: PauseCause,
    /// True if the job can be resumed after a reset or a loss of power.
    pub is_resumable: bool,
    /// Time since the board started, ms.
    pub uptime_ms: u64,
}

/// Number of the 64 sectors of an interrupted layer that were made, between two bounds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct InterruptedLayer {
    /// Min number of sectors made. 0 if the progress is unknown.
    pub min: u8,
    /// Max number of sectors made. 64 if the progress is unknown.
    pub max: u8,
}

/// Reason why a board pauses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
pub enum PauseCause {
    /// The board has laid every layer that it has. The field also has this value while the board does not pause.
    #[default]
    LayersExhausted,
    /// A host requested the pause.
    Requested,
    /// The host stopped sending.
    HostSilent,
    /// The filament has run out, and a spool must be loaded.
    FilamentOut,
}

impl PauseCause {
    /// Returns true if a job in this state, with this cause of a pause, may be continued without an order of a person:
    /// its heater is on, and at most its host kept it waiting.
    #[must_use]
    pub const fn allows_continuation(self, state: State) -> bool {
        matches!(self, Self::LayersExhausted | Self::HostSilent)
            && matches!(state, State::Heating | State::Homing | State::Growing | State::Paused)
    }
}

/// Response to a request that was carried out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Accepted {
    /// Identifier of the job, 0 if there is none.
    pub plan_id: u64,
    /// Index of the next layer that the board expects.
    pub next: u32,
    /// Number of further layers that the board can store now.
    pub free_layers: u32,
}

/// Response to a part of a robot description.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Configured {
    /// Hash of the description in the request.
    pub robot: u64,
    /// Number of bytes of the description that the board has received.
    pub received: u16,
    /// True if the description is valid and in flash. If so, the board restarts with it within a second.
    pub stored: bool,
}

/// Response to a request that was refused.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct RefusalResponse {
    /// Kind of the request.
    pub kind: u8,
    /// Reason for the refusal.
    pub refusal: Refusal,
}

/// Summary of a plan that the board has made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Planned {
    /// Identifier of the job: the hash of the layers' bytes.
    pub plan_id: u64,
    /// Hash of the layers in full precision.
    pub exact_hash: u64,
    /// Number of layers.
    pub layers: u32,
    /// Arc length of the path, mm.
    pub length: f64,
}

/// Layers that the board stores, read by a host.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct StoredLayers {
    /// Index of the first layer.
    pub first: u32,
    /// The layers. There are fewer than [`MAX_LAYERS_PER_MESSAGE`](super::MAX_LAYERS_PER_MESSAGE) at the end of the
    /// stored layers.
    pub layers: LayerBatch,
}

/// Event: a layer is laid.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct LayerLaid {
    /// Identifier of the job.
    pub plan_id: u64,
    /// Index of the layer.
    pub index: u32,
    /// The layer as built, computed from the steps made. `None` if the layer was interrupted and skipped, or if the
    /// journal could not be written.
    pub as_built: Option<LayerBytes>,
    /// Readings of the sensors when the layer was laid. The board retains them for its latest layers only, and loses
    /// them at a reset.
    pub readings: Option<LayerReadings>,
}

/// Readings of the sensors when a layer was laid. A field is `None` if the robot does not have the sensor, or if the
/// sensor gave no reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
pub struct LayerReadings {
    /// Pulses of the filament's encoder since the board started ([`SensorReadings::filament_pulses`]).
    pub filament_pulses: Option<u32>,
    /// Gravity in the tip's frame, thousandths of the earth's ([`SensorReadings::gravity_milli_g`]).
    pub gravity_milli_g: Option<[i16; 3]>,
}

/// Event: the board is in a new state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct StateChanged {
    /// The new state.
    pub state: State,
    /// Latched fault, if there is one.
    pub fault: Option<Fault>,
}

/// Gains of the heater's controller.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Schema)]
pub struct Gains {
    /// Proportional gain, duty (0 to 1) per degree.
    pub kp: f64,
    /// Integral gain, duty per degree and second.
    pub ki: f64,
    /// Derivative gain, duty per degree a second.
    pub kd: f64,
}

/// Event: a `Tune` has ended and found the gains.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Tuned {
    /// The gains.
    pub gains: Gains,
    /// Period of the temperature's oscillation, s.
    pub period_s: f64,
    /// Amplitude of the oscillation to either side, degrees Celsius.
    pub amplitude_c: f64,
}

/// Readings of the board's sensors. A field is `None` if the robot does not have the sensor, or if the sensor gives no
/// reading.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, Schema)]
pub struct SensorReadings {
    /// Voltage of the supply, mV.
    pub supply_mv: Option<u32>,
    /// True if the head is at its index mark.
    pub on_index: bool,
    /// True if the filament switch detects filament.
    pub filament_present: Option<bool>,
    /// Pulses of the filament's encoder since the board started: forward pulses minus backward pulses, modulo 2^32.
    /// Filament that is retracted and pushed forward again does not count, but filament that has gone into the body
    /// does.
    pub filament_pulses: Option<u32>,
    /// True if a stepper driver reports a fault.
    pub driver_fault: Option<bool>,
    /// Problem that a stepper driver reports over its UART. `None` if all drivers are well, or if they have no UART.
    pub driver_problem: Option<DriverReport>,
    /// True if the emergency stop is pressed.
    pub emergency_stop: Option<bool>,
    /// Gravity in the tip's frame, thousandths of the earth's. The vector points upwards, as a resting accelerometer
    /// measures it.
    pub gravity_milli_g: Option<[i16; 3]>,
}

/// Status of the board at the time of a fault. The board retains it through resets, until the next fault.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Schema)]
pub struct FaultRecord {
    /// The fault. `None` for the emergency stop.
    pub fault: Option<Fault>,
    /// True if the fault has been cleared since.
    pub cleared: bool,
    /// State of the board when the fault occurred.
    pub state: State,
    /// Time from the start of the board to the fault, ms.
    pub uptime_ms: u64,
    /// Temperature of the nozzle, hundredths of a degree Celsius. `None` without a reading.
    pub temperature_centi_c: Option<i32>,
    /// Target temperature of the nozzle, hundredths of a degree Celsius. `None` if the heater is off.
    pub target_centi_c: Option<i32>,
    /// Duty of the power stage, 0 to 65,535. During the proof test of the second switch, that switch is open.
    pub duty: u16,
    /// Readings of the other sensors.
    pub sensors: SensorReadings,
    /// Identifier of the job, 0 if there is none.
    pub plan_id: u64,
    /// Number of layers laid.
    pub laid: u32,
    /// Number of layers begun. If a layer was interrupted, it is one more than the number of layers laid.
    pub layers_begun: u32,
}

/// Response with the latest fault.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct LatestFault {
    /// Record of the fault. `None` if the board has no record of a fault.
    pub record: Option<FaultRecord>,
}

/// The result of the image's check at the board's start, and the latest crash.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct BootReport {
    /// Result of the check of the firmware's image at this start.
    pub image: ImageCheck,
    /// The latest crash. Retained memory stores it through resets, until the next crash or a loss of power. `None`
    /// without a crash. [`CrashRecord`](crate::link::crash::CrashRecord) decodes the words.
    pub crash: Option<CrashWords>,
}

/// The result of the check of the firmware's image when the board started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum ImageCheck {
    /// The image was never sealed, so the board could not check it.
    Unsealed,
    /// The image agrees with its seal.
    Valid {
        /// CRC-32C of the image.
        crc: u32,
    },
    /// The firmware image is damaged: its CRC differs from the one stored in it, or what is stored is not valid. The
    /// board refuses to heat.
    Corrupt {
        /// CRC-32C in the seal of the image.
        sealed: u32,
        /// CRC-32C of the image as found. It equals `sealed` if the seal itself is not valid.
        found: u32,
    },
}
