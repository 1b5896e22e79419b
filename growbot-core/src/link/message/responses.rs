//! The responses and events of a board.

use heapless::String;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;

use super::layer_batch::LayerBatch;
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
    /// The job was planned for another robot than that of the board.
    RobotMismatch {
        /// Hash of the board's robot.
        board: u64,
    },
    /// The board stores a different plan.
    PlanMismatch {
        /// Identifier of the plan that the board stores, 0 if there is none.
        board: u64,
    },
    /// The layers do not follow immediately after the layers that the board has received.
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
        /// Fault whose cause still exists.
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
    /// Another host owns the board. [`BoardInfo::owner`] contains the name of this host.
    OwnedByOtherHost {
        /// Time since the last frame of the host that owns the board, ms.
        silent_ms: u32,
    },
    /// The board has begun one of the layers to be replaced.
    LayerAlreadyBegun {
        /// Index of the first layer that can still be replaced.
        first: u32,
    },
    /// The nozzle is too hot for the board to erase its journal, which stops the processor for seconds.
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
    /// The board has no robot description, so it only communicates and refuses to heat or move.
    NotConfigured,
    /// The board stores a job that is not complete, and that a new description would delete.
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

/// Defect of a robot description that a board has received. A host can find the defective field by checking the
/// description with the same code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum DescriptionError {
    /// The version of the encoding is not the one that the board reads.
    VersionMismatch {
        /// Version of the encoding that the board reads.
        board: u8,
    },
    /// The bytes are not a description.
    Unreadable,
    /// The hash of the received description differs from the hash in the request.
    HashMismatch {
        /// Hash of the received description.
        found: u64,
    },
    /// The description is too long.
    TooLong,
    /// A number is not finite, out of its range, or beyond a limit of the board.
    Number,
    /// The name is not a valid name of a robot.
    Name,
    /// The description gives no equation for the thermistor, or two equations.
    Thermistor,
    /// A pin cannot have the function that the description gives it.
    Pins,
    /// A stepper driver cannot have the settings in the description.
    Drivers,
    /// The description is for another kind of board.
    BoardMismatch {
        /// Kind of board for which the description is.
        asked: BoardKind,
        /// Kind of the board that received the description.
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
    /// Number of the board's present start, which differs from start to start.
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
    /// Name of the host that owns the board. `None` if no host owns it.
    pub owner: Option<HostName>,
}

/// Converts hundredths of a degree Celsius, the unit of temperatures in messages, to degrees Celsius.
pub fn celsius(centi_c: i32) -> f64 {
    f64::from(centi_c) / 100.0
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
    /// Duty of the heater's power stage, 0 to 65,535 for 0 to 100 %. In the proof test of the heater's second switch,
    /// this switch is open, so the heater has no power whatever the duty is.
    pub duty: u16,
    /// Identifier of the job, 0 if there is none.
    pub plan_id: u64,
    /// Number of layers of the job.
    pub layer_count: u32,
    /// Index of the next layer that the board expects to receive.
    pub next_layer: u32,
    /// Number of layers of the job that have been laid.
    pub layers_laid: u32,
    /// Progress of the layer that a stop, a fault, a reset or a loss of power interrupted. The index of this layer is
    /// `layers_laid`. `None` if no layer was interrupted.
    pub interrupted: Option<InterruptedLayer>,
    /// Reason why the board pauses. The field has a meaning only in the states `Paused` and `Parked`.
    pub pause_cause: PauseCause,
    /// True if the job can be resumed after a reset or a loss of power.
    pub is_resumable: bool,
    /// Time since the board started, ms.
    pub uptime_ms: u64,
}

impl Status {
    /// Returns the cause of the pause. `None` unless the board pauses or is parked.
    pub fn pause(&self) -> Option<PauseCause> {
        matches!(self.state, State::Paused | State::Parked).then_some(self.pause_cause)
    }
}

/// Lower and upper bound on the number of sectors of an interrupted layer, of 64, that were printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct InterruptedLayer {
    /// Min number of sectors that were printed. 0 if the progress is unknown.
    pub min: u8,
    /// Max number of sectors that were printed. 64 if the progress is unknown.
    pub max: u8,
}

/// Reason why a board pauses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum PauseCause {
    /// The board has laid all layers that it has received. The field also has this value while the board does not
    /// pause.
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
    /// Returns the code of the cause, as programs print it.
    pub fn code(self) -> &'static str {
        self.into()
    }

    /// Returns a description of the cause and, if a person has to end the pause, what to do.
    pub const fn explanation(self) -> &'static str {
        match self {
            Self::LayersExhausted => "waiting for layers",
            Self::Requested => "on request",
            Self::HostSilent => "the board lost contact with its host",
            Self::FilamentOut => {
                "out of filament: push new filament in up to the feed; preheat, load and purge it, then continue"
            }
        }
    }

    /// Returns true if a job in this state, with this cause of a pause, may be continued without an order of a person:
    /// its heater is on, and at most its host kept it waiting.
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
    /// Index of the next layer that the board expects to receive.
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
    /// Identifier of the job: the hash of the robot's hash and of the bytes of all layers.
    pub plan_id: u64,
    /// Hash of alpha, height and tilt of all layers as `f64` ([`crate::job::JobSummary::exact_hash`]).
    pub exact_hash: u64,
    /// Number of layers.
    pub layers: u32,
    /// Arc length of the path, mm.
    pub length: f64,
}

/// Response with layers that the board stores.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct StoredLayers {
    /// Index in the job of the first layer in this message.
    pub first: u32,
    /// The stored layers from this index on. There are fewer than
    /// [`MAX_LAYERS_PER_MESSAGE`](super::MAX_LAYERS_PER_MESSAGE) only at the end of the stored layers. It is empty if
    /// the layer with this index is not stored, for example because it has been laid.
    pub layers: LayerBatch,
}

/// Event: the board has laid a layer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct LayerLaid {
    /// Identifier of the job.
    pub plan_id: u64,
    /// Index of the layer.
    pub index: u32,
    /// The layer as built, computed from the motor steps that were made. `None` if the layer was interrupted and
    /// skipped, or if the journal could not be written.
    pub as_built: Option<LayerBytes>,
    /// Readings of the sensors when the layer was laid. `None` if the board no longer has them, because it keeps them
    /// only for its latest layers and loses them at a reset.
    pub readings: Option<LayerReadings>,
}

/// Readings of the sensors when a layer was laid. A field is `None` if the robot does not have the sensor, or if the
/// sensor gave no reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
pub struct LayerReadings {
    /// Pulses of the filament's encoder since the board started ([`SensorReadings::filament_pulses`]).
    pub filament_pulses: Option<u32>,
    /// Acceleration that a resting accelerometer measures, in the tip's frame, thousandths of standard gravity
    /// ([`SensorReadings::gravity_milli_g`]).
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
    /// Integral gain, duty per degree and per second.
    pub ki: f64,
    /// Derivative gain, duty per (degree per second).
    pub kd: f64,
}

/// Event: the tuning that a `Tune` requested has found the gains.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Tuned {
    /// Gains that were found.
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
    /// Filament that is retracted and pushed forward again contributes nothing in total.
    pub filament_pulses: Option<u32>,
    /// True if a stepper driver reports a fault.
    pub driver_fault: Option<bool>,
    /// Problem that a stepper driver reports over its UART. `None` if all drivers work, or if they have no UART.
    pub driver_problem: Option<DriverReport>,
    /// True if the emergency stop is pressed.
    pub emergency_stop: Option<bool>,
    /// Acceleration that a resting accelerometer measures, in the tip's frame, thousandths of standard gravity. The
    /// vector points upwards, opposite to gravity.
    pub gravity_milli_g: Option<[i16; 3]>,
}

/// Status of the board at the time of a fault. The board retains it through resets, until the next fault.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Schema)]
pub struct FaultRecord {
    /// The fault. `None` for the emergency stop.
    pub fault: Option<Fault>,
    /// True if the fault has been cleared since it occurred.
    pub cleared: bool,
    /// State of the board when the fault occurred.
    pub state: State,
    /// Time from the start of the board to the fault, ms.
    pub uptime_ms: u64,
    /// Temperature of the nozzle, hundredths of a degree Celsius. `None` without a reading.
    pub temperature_centi_c: Option<i32>,
    /// Target temperature of the nozzle, hundredths of a degree Celsius. `None` if the heater is off.
    pub target_centi_c: Option<i32>,
    /// Duty of the heater's power stage, 0 to 65,535 for 0 to 100 %. In the proof test of the heater's second switch,
    /// this switch is open, so the heater has no power whatever the duty is.
    pub duty: u16,
    /// Readings of the sensors other than the thermistor, at the time of the fault.
    pub sensors: SensorReadings,
    /// Identifier of the job, 0 if there is none.
    pub plan_id: u64,
    /// Number of layers of the job that had been laid.
    pub laid: u32,
    /// Number of layers of the job that had been begun. If the fault interrupted a layer, it is one more than the
    /// number of layers laid.
    pub layers_begun: u32,
}

/// Response with the latest fault.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct LatestFault {
    /// Record of the fault. `None` if the board has no record of a fault.
    pub record: Option<FaultRecord>,
}

/// Response about the board's start: the result of the check of its firmware image, and the latest crash.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct BootReport {
    /// Result of the check of the firmware image at this start.
    pub image: ImageCheck,
    /// Record of the latest crash, which [`CrashRecord`](crate::link::crash::CrashRecord) decodes. It is kept in memory
    /// that is retained through resets, until the next crash or a loss of power. `None` without a crash.
    pub crash: Option<CrashWords>,
}

/// The result of the check of the firmware image when the board started. The check compares the image with its seal, a
/// CRC-32C that is stored in the image after linking.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum ImageCheck {
    /// The image has no seal, so the board could not check it.
    Unsealed,
    /// The image matches the CRC in its seal.
    Valid {
        /// CRC-32C of the image.
        crc: u32,
    },
    /// The image is damaged: its CRC differs from the one in its seal, or the seal is not valid. The board refuses to
    /// heat.
    Corrupt {
        /// CRC-32C that the seal of the image contains.
        sealed: u32,
        /// CRC-32C that the board has computed of the image. It equals `sealed` if the seal itself is not valid.
        found: u32,
    },
}
