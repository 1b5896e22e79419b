//! What a board answers, and what it tells unasked.

use heapless::String;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::LayerBatch;
use super::requests::HostName;
use crate::layer_bytes::LayerBytes;
use crate::link::crash::CrashWords;
use crate::link::state::{Fault, ResetCause, State};

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
    /// The host has not said `Hello` in this session.
    NoSession,
    /// The job is for another robot.
    OtherRobot {
        /// Hash of the board's robot.
        board: u64,
    },
    /// The board holds another plan.
    OtherPlan {
        /// The plan that it holds, 0 for none.
        board: u64,
    },
    /// The layers do not follow on those held.
    OutOfOrder {
        /// The index expected.
        expected: u32,
    },
    /// No room for more layers now.
    Full,
    /// A layer breaks a limit of the robot, or lies beyond the job's end.
    BadLayer {
        /// Its index.
        index: u32,
    },
    /// Not in this state.
    WrongState {
        /// The state that the board is in.
        state: State,
    },
    /// The cause of the fault is still there.
    FaultRemains {
        /// The fault.
        fault: Fault,
    },
    /// There is no plan for these poses and this radius: not finite, out of range, or below the min radius.
    NoPlan,
    /// The plan has more layers than the board holds.
    PlanTooLong {
        /// Layers of the plan.
        layers: u32,
        /// Layers that the board holds.
        capacity: u32,
    },
    /// A temperature outside of what the robot's description allows.
    Temperature {
        /// Min, hundredths of a degree Celsius.
        least: i32,
        /// Max, hundredths of a degree Celsius.
        greatest: i32,
    },
    /// The emergency stop is still pressed.
    EmergencyStop,
    /// Another host holds the board: [`BoardHello::holder`] tells which.
    Held {
        /// Since when that host has not been heard, ms.
        silent_ms: u32,
    },
    /// The layers to be replaced have been begun.
    Begun {
        /// The first layer that can still be replaced.
        first: u32,
    },
    /// The nozzle is too hot for what stops the processor for seconds: making room in the journal.
    Hot {
        /// It must be below this, hundredths of a degree Celsius.
        below: i32,
    },
    /// The journal cannot be written: the board must not begin what it could not resume.
    Journal,
    /// A debug probe has switched the processor's debugging on: it may halt, so the board does not heat.
    DebugProbe,
}

/// Who the board is and what it knows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct BoardHello {
    /// The board's [`SCHEMA_HASH`](super::SCHEMA_HASH).
    pub schema: u64,
    /// Another number at each start of the board.
    pub boot_id: u32,
    /// Why it started.
    pub reset_cause: ResetCause,
    /// Version of the firmware: major, minor, patch.
    pub firmware: [u8; 3],
    /// Name of the robot whose description the board carries.
    pub robot_name: String<32>,
    /// Hash of that description.
    pub robot: u64,
    /// Layers that the board can hold.
    pub capacity: u32,
    /// What it is doing.
    pub status: Status,
    /// The host that holds the board.
    pub holder: Option<HostName>,
}

/// What the board is doing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Status {
    /// The state.
    pub state: State,
    /// The fault that is latched.
    pub fault: Option<Fault>,
    /// Temperature of the nozzle, hundredths of a degree Celsius; none without a reading.
    pub temperature_centi_c: Option<i32>,
    /// What it is regulated to; none with the heater off.
    pub target_centi_c: Option<i32>,
    /// Duty of the power stage, 0 to 65,535; in the proof test with the second switch open.
    pub duty: u16,
    /// The job, 0 for none.
    pub plan_id: u64,
    /// Layers of the job.
    pub layers: u32,
    /// Index of the next layer that the board expects.
    pub next: u32,
    /// Layers laid.
    pub laid: u32,
    /// The layer that was begun and not finished, after a stop, a fault or a reset: how much of its turn has been made.
    pub cut: Option<Cut>,
    /// What the board waits for, in `Hold` and `Parked`.
    pub waits: Waits,
    /// Whether the job can be taken up again after a reset or a loss of power.
    pub journal: bool,
    /// Time since the board started, ms.
    pub uptime_ms: u64,
}

/// How much of a layer's turn was made when it was cut: between these two.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Cut {
    /// Min number of its 64 sectors.
    pub least: u8,
    /// Max number; 64 where nothing is known.
    pub most: u8,
}

/// What a board waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
pub enum Waits {
    /// Nothing, or more layers.
    #[default]
    ForLayers,
    /// A host has asked it to hold.
    AsAsked,
    /// Its host has fallen silent.
    ForHost,
}

/// A request was carried out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Accepted {
    /// The job, 0 for none.
    pub plan_id: u64,
    /// Index of the next layer expected.
    pub next: u32,
    /// Number of further layers that there is room for.
    pub room: u32,
}

/// A request was refused.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Refused {
    /// Kind of the request.
    pub kind: u8,
    /// Why.
    pub refusal: Refusal,
}

/// The board's own plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Planned {
    /// Hash of the layers' bytes: the job's name.
    pub plan_id: u64,
    /// Hash of the layers in full precision.
    pub exact_hash: u64,
    /// Layers.
    pub layers: u32,
    /// Arc length, mm.
    pub length: f64,
}

/// Layers that the board holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct HeldLayers {
    /// Index of the first.
    pub first: u32,
    /// The layers; fewer than [`MOST_LAYERS`](super::MOST_LAYERS) at the end.
    pub layers: LayerBatch,
}

/// A layer is laid. The board sends this unasked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Laid {
    /// The job.
    pub plan_id: u64,
    /// Index of the layer.
    pub index: u32,
    /// The layer as built, from the steps that were made. Nothing is known of one that was cut and let be, or after a
    /// failure of the journal.
    pub as_built: Option<LayerBytes>,
    /// What the sensors said when it was laid. The board keeps that for its latest layers only, and not through a
    /// reset.
    pub measured: Option<Measured>,
}

/// What the sensors said when a layer was laid. None where a robot does not have the sensor, or where it gave nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
pub struct Measured {
    /// Pulses of the filament's encoder since the board started, as in [`SensorReadings`].
    pub filament_pulses: Option<u32>,
    /// Gravity in the tip's frame, as in [`SensorReadings`].
    pub gravity_milli_g: Option<[i16; 3]>,
}

/// The state changed. The board sends this unasked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct StateChanged {
    /// The new state.
    pub state: State,
    /// The fault that is latched.
    pub fault: Option<Fault>,
}

/// Gains that were found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Schema)]
pub struct Gains {
    /// Duty (0 to 1) per degree.
    pub kp: f64,
    /// Duty per degree and second.
    pub ki: f64,
    /// Duty per degree a second.
    pub kd: f64,
}

/// The nozzle was driven round its temperature. The board sends this unasked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Tuned {
    /// What suits it.
    pub gains: Gains,
    /// Period of its swings, s.
    pub period_s: f64,
    /// How far it swung to either side, degrees.
    pub amplitude_c: f64,
}

/// What the board's sensors say. None where a robot does not have the sensor, or where it gives nothing.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, Schema)]
pub struct SensorReadings {
    /// The supply's voltage, mV.
    pub supply_mv: Option<u32>,
    /// Whether the head is on its index mark.
    pub on_index: bool,
    /// Whether there is filament.
    pub filament_present: Option<bool>,
    /// Pulses of the filament's encoder since the board started: those forwards less those backwards, wrapping. So
    /// filament that is pulled back and pushed forward again does not count, and what has gone into the body does.
    pub filament_pulses: Option<u32>,
    /// Whether a stepper driver reports a fault.
    pub driver_fault: Option<bool>,
    /// Whether the emergency stop is pressed.
    pub emergency_stop: Option<bool>,
    /// Gravity in the tip's frame, thousandths of the earth's; upwards, as a resting accelerometer shows it.
    pub gravity_milli_g: Option<[i16; 3]>,
}

/// A fault as it was when it came, kept until the next one, through resets.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Schema)]
pub struct FaultRecord {
    /// What went wrong; none for the emergency stop.
    pub fault: Option<Fault>,
    /// Whether it has been cleared since.
    pub cleared: bool,
    /// What the board was doing.
    pub state: State,
    /// Time since the start of the board in which it came, ms.
    pub uptime_ms: u64,
    /// Temperature of the nozzle, hundredths of a degree Celsius.
    pub temperature_centi_c: Option<i32>,
    /// What it was regulated to.
    pub target_centi_c: Option<i32>,
    /// Duty of the power stage, 0 to 65,535; in the proof test with the second switch open.
    pub duty: u16,
    /// What the other sensors said.
    pub sensors: SensorReadings,
    /// The job, 0 for none.
    pub plan_id: u64,
    /// Layers laid.
    pub laid: u32,
    /// Layers begun: one more than those laid where one was cut.
    pub begun: u32,
}

/// The latest fault.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct LatestFault {
    /// None where the board knows of none.
    pub record: Option<FaultRecord>,
}

/// How the board came up: whether its image is sound, and the latest crash.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct BootReport {
    /// What the check of the image found at this start.
    pub image: ImageCheck,
    /// The latest crash that the retained memory knows of, through resets until the next one; none where there was none
    /// since the board was without power. [`CrashRecord`](crate::link::crash::CrashRecord) says what the words mean.
    pub crash: Option<CrashWords>,
}

/// What the check of the firmware's image found when the board started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum ImageCheck {
    /// The image was never sealed, so nothing could be checked.
    NotSealed,
    /// The image is what was sealed.
    Sound {
        /// Its CRC-32C.
        crc: u32,
    },
    /// The image is not what was sealed: nothing heats.
    Corrupt {
        /// The CRC-32C that its seal states.
        sealed: u32,
        /// That of what is there; the same where the seal itself makes no sense.
        found: u32,
    },
}
