//! The answers and events of a board.

use heapless::String;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::LayerBatch;
use super::requests::HostName;
use crate::layer_bytes::LayerBytes;
use crate::link::crash::CrashWords;
use crate::link::drivers::DriverTrouble;
use crate::link::state::{Fault, ResetCause, State};
use crate::robot::{BoardKind, ENCODING_VERSION, RobotError};

/// Why a request was refused. The board did nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum Refusal {
    /// The message is of no known kind or does not decode.
    NotUnderstood,
    /// The host's messages differ from the board's.
    OtherSchema {
        /// The board's [`SCHEMA_HASH`](super::SCHEMA_HASH).
        board: u64,
    },
    /// The host has not opened this session with `Hello`.
    NoSession,
    /// The job is for another robot.
    OtherRobot {
        /// Hash of the board's robot.
        board: u64,
    },
    /// The board stores another plan.
    OtherPlan {
        /// The id of the plan that it stores, 0 for none.
        board: u64,
    },
    /// The layers do not follow on those that the board has.
    OutOfOrder {
        /// The index that the board expects.
        expected: u32,
    },
    /// No room for more layers now.
    Full,
    /// A layer breaks a limit of the robot, or lies beyond the job's end.
    BadLayer {
        /// The index of that layer.
        index: u32,
    },
    /// The board does not do this in its state.
    WrongState {
        /// The state that the board is in.
        state: State,
    },
    /// The cause of the fault is still there.
    FaultRemains {
        /// The fault.
        fault: Fault,
    },
    /// There is no plan for these poses and this radius: a number is not finite or out of range, or the radius is below
    /// R_min.
    NoPlan,
    /// The plan has more layers than the board can store.
    PlanTooLong {
        /// Number of layers of the plan.
        layers: u32,
        /// Number of layers that the board can store.
        capacity: u32,
    },
    /// The temperature asked for is outside the limits of the robot's description.
    Temperature {
        /// The min, hundredths of a degree Celsius.
        min: i32,
        /// The max, hundredths of a degree Celsius.
        max: i32,
    },
    /// The emergency stop is still pressed.
    EmergencyStop,
    /// Another host owns the board; [`BoardHello::owner`] names it.
    Owned {
        /// The time since the last frame of that host, ms.
        silent_ms: u32,
    },
    /// One of the layers to be replaced has been begun.
    Begun {
        /// The first layer that can still be replaced.
        first: u32,
    },
    /// The nozzle is too hot to erase the journal, which stops the processor for seconds.
    Hot {
        /// The nozzle must be below this, hundredths of a degree Celsius.
        below: i32,
    },
    /// The journal cannot be written, and the board must not begin a job that it could not resume.
    Journal,
    /// A debug probe has switched the processor's debugging on. The processor may halt, so the board does not heat.
    DebugProbe,
    /// The nozzle is too cold to move anything.
    Cold {
        /// Its temperature, hundredths of a degree Celsius.
        now: i32,
        /// It must have this, hundredths of a degree Celsius.
        min: i32,
    },
    /// The move is too long.
    TooFar {
        /// The max, um of filament or hundredths of a degree of the head.
        max: u32,
    },
    /// Head or feed still move.
    Moving,
    /// There is no filament.
    NoFilament,
    /// The board has no robot description, so it only communicates.
    NotConfigured,
    /// The board knows a job that is not done, which would be lost with its robot.
    JobNotDone {
        /// The job's id.
        plan_id: u64,
    },
    /// The robot description is not valid, and the board keeps the one that it has.
    BadDescription {
        /// What is wrong with it.
        why: BadDescription,
    },
    /// The robot description could not be written to flash, and the board keeps the one that it has.
    DescriptionNotStored,
}

/// What is wrong with a robot description. A host that checks it with the same code can say which field.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum BadDescription {
    /// It has another version of the encoding than the board reads.
    OtherVersion {
        /// The version that the board reads.
        board: u8,
    },
    /// The bytes are no description.
    Unreadable,
    /// Its hash is not that of the request.
    OtherHash {
        /// Its hash.
        found: u64,
    },
    /// It is too long.
    TooLong,
    /// A number is not finite, or out of its range or that of the board.
    Number,
    /// The name is not one that a robot may have.
    Name,
    /// The thermistor has no equation, or two.
    Thermistor,
    /// Pins that cannot be what they are to be.
    Pins,
    /// Settings that a stepper driver cannot have.
    Drivers,
    /// It is for another kind of board.
    OtherBoard {
        /// The kind that it is for.
        asked: BoardKind,
        /// The kind that the board is.
        board: BoardKind,
    },
}

impl From<RobotError> for BadDescription {
    fn from(error: RobotError) -> Self {
        match error {
            RobotError::OtherVersion { .. } => Self::OtherVersion { board: ENCODING_VERSION },
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
pub struct BoardHello {
    /// The board's [`SCHEMA_HASH`](super::SCHEMA_HASH).
    pub schema: u64,
    /// A number that differs at each start of the board.
    pub boot_id: u32,
    /// Why the board started.
    pub reset_cause: ResetCause,
    /// Version of the firmware: major, minor, patch.
    pub firmware: [u8; 3],
    /// Name of the robot whose description the board has; empty without one.
    pub robot_name: String<32>,
    /// Hash of the robot description; 0 without one.
    pub robot: u64,
    /// Number of layers that the board can store.
    pub capacity: u32,
    /// What the board is doing.
    pub status: Status,
    /// The name of the host that owns the board.
    pub owner: Option<HostName>,
}

/// What the board is doing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Status {
    /// The state.
    pub state: State,
    /// The fault that is latched, if any.
    pub fault: Option<Fault>,
    /// Temperature of the nozzle, hundredths of a degree Celsius; `None` without a reading.
    pub temperature_centi_c: Option<i32>,
    /// Target temperature of the nozzle, hundredths of a degree Celsius; `None` with the heater off.
    pub target_centi_c: Option<i32>,
    /// Duty of the power stage, 0 to 65,535. In the proof test the second switch is open in that time.
    pub duty: u16,
    /// The job's id, 0 for none.
    pub plan_id: u64,
    /// Number of layers of the job.
    pub layers: u32,
    /// Index of the next layer that the board expects.
    pub next: u32,
    /// Number of layers laid.
    pub laid: u32,
    /// The progress of the layer that a stop, a fault, a reset or a loss of power has interrupted, if any. Its index is
    /// `laid`.
    pub interrupted: Option<InterruptedLayer>,
    /// Why the board pauses, in `Paused` and `Parked`.
    pub pause_cause: PauseCause,
    /// Whether the job can be resumed after a reset or a loss of power.
    pub journal: bool,
    /// Time since the board started, ms.
    pub uptime_ms: u64,
}

/// How many of its 64 sectors an interrupted layer has. The number is known between two bounds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct InterruptedLayer {
    /// Min number of sectors made; 0 where nothing is known.
    pub min: u8,
    /// Max number of sectors made; 64 where nothing is known.
    pub max: u8,
}

/// Why a board pauses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
pub enum PauseCause {
    /// It has laid every layer that it has. Also the value while the board does not pause.
    #[default]
    LayersExhausted,
    /// A host has requested it.
    Requested,
    /// Its host has fallen silent.
    HostSilent,
    /// There is no more filament: a spool must be loaded.
    FilamentOut,
}

/// A request was carried out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Accepted {
    /// The job's id, 0 for none.
    pub plan_id: u64,
    /// Index of the next layer that the board expects.
    pub next: u32,
    /// Number of further layers that the board has room for.
    pub room: u32,
}

/// A part of a robot description has arrived.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Configured {
    /// Hash of the description.
    pub robot: u64,
    /// Number of bytes of it that the board has.
    pub received: u16,
    /// Whether it is valid and in flash. The board then restarts with it within a second.
    pub stored: bool,
}

/// A request was refused.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Refused {
    /// The kind of the request.
    pub kind: u8,
    /// Why it was refused.
    pub refusal: Refusal,
}

/// The summary of a plan that the board has made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Planned {
    /// The job's id: the hash of the layers' bytes.
    pub plan_id: u64,
    /// Hash of the layers in full precision.
    pub exact_hash: u64,
    /// Number of layers.
    pub layers: u32,
    /// Arc length of the path, mm.
    pub length: f64,
}

/// Layers that the board stores.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct StoredLayers {
    /// Index of the first of them.
    pub first: u32,
    /// The layers; fewer than [`MAX_LAYERS`](super::MAX_LAYERS) at the end.
    pub layers: LayerBatch,
}

/// The event of a layer that is laid.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Laid {
    /// The job's id.
    pub plan_id: u64,
    /// Index of the layer.
    pub index: u32,
    /// The layer as built, from the steps that were made. `None` for an interrupted layer that was let be, and after a
    /// failure of the journal.
    pub as_built: Option<LayerBytes>,
    /// The sensors' readings when the layer was laid. The board retains them for its latest layers only, and not
    /// through a reset.
    pub measured: Option<Measured>,
}

/// The sensors' readings when a layer was laid. `None` where the robot does not have the sensor, or where the sensor
/// gave nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
pub struct Measured {
    /// Pulses of the filament's encoder since the board started ([`SensorReadings::filament_pulses`]).
    pub filament_pulses: Option<u32>,
    /// Gravity in the tip's frame, thousandths of the earth's ([`SensorReadings::gravity_milli_g`]).
    pub gravity_milli_g: Option<[i16; 3]>,
}

/// The event of a new state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct StateChanged {
    /// The new state.
    pub state: State,
    /// The fault that is latched, if any.
    pub fault: Option<Fault>,
}

/// Gains of the heater's regulation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Schema)]
pub struct Gains {
    /// Proportional gain, duty (0 to 1) per degree.
    pub kp: f64,
    /// Integral gain, duty per degree and second.
    pub ki: f64,
    /// Derivative gain, duty per degree a second.
    pub kd: f64,
}

/// The event that ends a `Tune`: the gains that were found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Tuned {
    /// The gains.
    pub gains: Gains,
    /// Period of the nozzle's swings, s.
    pub period_s: f64,
    /// Amplitude of the swings to either side, degrees Celsius.
    pub amplitude_c: f64,
}

/// The readings of the board's sensors. `None` where the robot does not have the sensor, or where the sensor gives
/// nothing.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, Schema)]
pub struct SensorReadings {
    /// The supply's voltage, mV.
    pub supply_mv: Option<u32>,
    /// Whether the head is on its index mark.
    pub on_index: bool,
    /// Whether there is filament.
    pub filament_present: Option<bool>,
    /// Pulses of the filament's encoder since the board started: forward pulses less backward ones, modulo 2^32.
    /// Filament that is pulled back and pushed forward again does not count; filament that has gone into the body does.
    pub filament_pulses: Option<u32>,
    /// Whether a stepper driver reports a fault.
    pub driver_fault: Option<bool>,
    /// What a stepper driver says of itself over its serial line; `None` while all are well, and without such a line.
    pub driver_trouble: Option<DriverTrouble>,
    /// Whether the emergency stop is pressed.
    pub emergency_stop: Option<bool>,
    /// Gravity in the tip's frame, thousandths of the earth's. It points upwards, as a resting accelerometer shows it.
    pub gravity_milli_g: Option<[i16; 3]>,
}

/// The board's status when a fault came. The board retains it through resets, until the next fault.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Schema)]
pub struct FaultRecord {
    /// What went wrong; `None` for the emergency stop.
    pub fault: Option<Fault>,
    /// Whether the fault has been cleared since.
    pub cleared: bool,
    /// What the board was doing.
    pub state: State,
    /// When the fault came: the time since the board's start before it, ms.
    pub uptime_ms: u64,
    /// Temperature of the nozzle, hundredths of a degree Celsius; `None` without a reading.
    pub temperature_centi_c: Option<i32>,
    /// Target temperature of the nozzle, hundredths of a degree Celsius; `None` with the heater off.
    pub target_centi_c: Option<i32>,
    /// Duty of the power stage, 0 to 65,535. In the proof test the second switch is open in that time.
    pub duty: u16,
    /// The readings of the other sensors.
    pub sensors: SensorReadings,
    /// The job's id, 0 for none.
    pub plan_id: u64,
    /// Number of layers laid.
    pub laid: u32,
    /// Number of layers begun: one more than those laid where one was interrupted.
    pub begun: u32,
}

/// The latest fault.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct LatestFault {
    /// The record; `None` where the board knows of no fault.
    pub record: Option<FaultRecord>,
}

/// The result of the image's check at the board's start, and the latest crash.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct BootReport {
    /// What the check of the image found at this start.
    pub image: ImageCheck,
    /// The latest crash. The retained memory stores it through resets, until the next crash or a loss of power. `None`
    /// without a crash. [`CrashRecord`](crate::link::crash::CrashRecord) decodes the words.
    pub crash: Option<CrashWords>,
}

/// The result of the check of the firmware's image when the board started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum ImageCheck {
    /// The image was never sealed, so nothing could be checked.
    NotSealed,
    /// The image is what was sealed.
    Sound {
        /// The image's CRC-32C.
        crc: u32,
    },
    /// The image is not what was sealed. Nothing heats.
    Corrupt {
        /// The CRC-32C in the image's seal.
        sealed: u32,
        /// The CRC-32C of the image as found; the same where the seal itself makes no sense.
        found: u32,
    },
}
