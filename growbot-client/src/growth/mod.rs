//! One growth: a plan's layers handed to a board, followed until the last of them is laid; or taken up again where it
//! was left.

mod beginning;
mod following;
mod grown;
mod handover;
mod orders;

use growbot_core::job::{job_layers, plan_id};
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::crash::CrashWords;
use growbot_core::link::message::{
    Accepted, BoardHello, BootReport, Fault, InterruptedLayer, Measured, Message, ResetCause, Silence, Start, State,
    Status,
};
use growbot_core::path::{Segment, length};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use serde::{Deserialize, Serialize};

pub use self::grown::{Grown, MeasuredBy, as_built_hash, as_built_or_commanded};
pub use self::orders::{Order, Orders};
use crate::client::{Client, ClientError, ClockDrift};
use crate::feedback::{Count, Feedback};
use crate::keep_clear::{Detour, TooNear};
use crate::plan::Plan;

/// A job: the layers of a path, for a robot.
#[derive(Debug, Clone, PartialEq)]
pub struct Job<'a> {
    /// The robot.
    pub robot: &'a Robot,
    /// Where the body begins.
    pub start: &'a Pose,
    /// Where its tip is to arrive.
    pub goal: &'a Pose,
    /// Length of the path between, mm.
    pub length: f64,
    /// Hash of the layers: the job's name.
    pub plan_id: u64,
    /// The layers.
    pub layers: Vec<LayerBytes>,
}

impl<'a> Job<'a> {
    /// The job of a plan. `robot` is the plan's robot.
    #[must_use]
    pub fn of_plan(robot: &'a Robot, plan: &'a Plan) -> Self {
        Self::new(robot, &plan.start, &plan.goal, &plan.path)
    }

    /// The job of a path from `start` to `goal`.
    #[must_use]
    pub fn new(robot: &'a Robot, start: &'a Pose, goal: &'a Pose, path: &[Segment]) -> Self {
        let layers: Vec<LayerBytes> = job_layers(path, robot).collect();
        Self { robot, start, goal, length: length(path), plan_id: plan_id(robot, &layers), layers }
    }
}

/// How a growth ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Every layer is laid.
    Done,
    /// Stopped on request.
    Stopped,
    /// A fault switched everything off.
    Fault(Fault),
    /// The board's clock is wrong, and with it heating, speeds and limits in time: it was stopped.
    ClockDrift(ClockDrift),
    /// A long pause has switched the heater off; it can be resumed.
    Parked,
    /// The board has started anew, or another host has it; what was laid can be resumed.
    Interrupted,
    /// The board is silent: it may still be growing.
    Lost,
}

impl Outcome {
    /// The outcome in a word.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Stopped => "stopped",
            Self::ClockDrift(_) => "clock-drift",
            Self::Fault(_) => "fault",
            Self::Parked => "parked",
            Self::Interrupted => "interrupted",
            Self::Lost => "lost",
        }
    }
}

/// Something that happened to a job.
#[derive(Debug, Clone, PartialEq)]
pub enum JobEvent {
    /// The board went into a state.
    State(State),
    /// The board has said who it is.
    Board(BoardHello),
    /// The board has started anew because its firmware crashed.
    Crash(CrashWords),
    /// The board's status, asked for in quiet times.
    Status(Status),
    /// A layer is laid.
    Laid {
        /// Its index.
        index: u32,
        /// The layer as built, where that is known.
        as_built: Option<LayerBytes>,
        /// What was measured after it.
        measured: Option<Measured>,
    },
    /// Where the plastic of a simulated tip is. A layer comes once it no longer changes, the last ones at the end.
    Simulated {
        /// Index of the first layer.
        from: u32,
        /// The layers as they came out.
        layers: Vec<Layer>,
    },
    /// Feedback counts filament from here on.
    Counting(Count),
    /// The job is about to be amended. It is, unless `NotAmended` follows.
    Amending(Amendment),
    /// The board has not taken the latest amendment: why, unless it just came too late.
    NotAmended(Option<String>),
    /// With feedback in a scene: the rest takes another path, since the one so far would be too near to an obstacle.
    Detour(Detour),
    /// With feedback in a scene: the rest would be too near to an obstacle and no other way was found, so the board is
    /// asked to pause.
    TooNear(TooNear),
    /// With feedback: layers of the job beyond those of its latest amendment are handed over.
    HandingOver {
        /// Index of the first layer.
        from: u32,
        /// The layers.
        layers: Vec<LayerBytes>,
    },
    /// Somebody has given an order, which is now carried out.
    Ordered(Order),
    /// The board refused it: why.
    NotObeyed(String),
    /// The board does not answer, and is called again.
    Silent,
    /// It answers again.
    Back,
}

/// Other layers from an index on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Amendment {
    /// The job's new name.
    #[serde(with = "crate::run_log::hash")]
    #[cfg_attr(feature = "schema", schemars(with = "String", extend("pattern" = r"^[0-9a-f]{16}$")))]
    pub plan_id: u64,
    /// Index of the first other layer.
    pub from: u32,
    /// Layers of the job from now on.
    pub total: u32,
    /// The first of the other layers.
    #[serde(with = "crate::run_log::layers")]
    #[cfg_attr(feature = "schema", schemars(with = "String", extend("pattern" = r"^([0-9a-f]{24})*$")))]
    pub layers: Vec<LayerBytes>,
}

/// Why a growth came to no end that could be measured.
#[derive(Debug, thiserror::Error)]
pub enum GrowthError {
    /// It did not start: nothing was heated or moved.
    #[error(transparent)]
    Before(ClientError),
    /// The board was lost on the way; it may still be growing.
    #[error("{0}; the robot may still be growing: see `growbot status`, and cut its power if that does not answer")]
    During(ClientError),
    /// There is nothing to resume.
    #[error("the board has no unfinished body of this plan ({plan_id:016x}); it has {stored}")]
    NothingToResume {
        /// The plan.
        plan_id: u64,
        /// What the board stores.
        stored: String,
    },
    /// An unfinished body hangs on the robot.
    #[error(
        "the board has an unfinished body of plan {plan_id:016x}, {laid} of {layers} layers laid: resume it (`growbot resume`), or give it up (`growbot cancel`)"
    )]
    Unfinished {
        /// Its plan.
        plan_id: u64,
        /// Layers laid.
        laid: u32,
        /// Layers of the plan.
        layers: u32,
    },
}

impl GrowthError {
    /// The board of this status has nothing to resume of this plan.
    #[must_use]
    pub fn nothing_to_resume(plan_id: u64, status: &Status) -> Self {
        let stored = match status.plan_id {
            0 => "no job".to_string(),
            id => format!("plan {id:016x}, {} of {} layers laid", status.laid, status.layers),
        };
        Self::NothingToResume { plan_id, stored }
    }

    /// Whether the board answered, and did not accept the job.
    #[must_use]
    pub fn is_refusal(&self) -> bool {
        match self {
            Self::Before(ClientError::Refused { .. }) | Self::NothingToResume { .. } | Self::Unfinished { .. } => true,
            Self::Before(_) | Self::During(_) => false,
        }
    }
}

/// What becomes of an interrupted layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OnInterrupted {
    /// It is laid anew, on top of what there is of it.
    #[default]
    Again,
    /// It is let be, as far as it came.
    LetBe,
}

/// How a job is grown.
pub struct Manner<'a> {
    /// What the board does when it no longer hears from this host.
    pub silence: Silence,
    /// With it, layers to come are planned again after each that is laid. Of a job that is resumed it knows the layers
    /// that are known.
    pub feedback: Option<Feedback<'a>>,
    /// What a board that parks means for the growth.
    pub parked: WhenParked,
}

/// What becomes of a growth whose board has parked after a long pause.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum WhenParked {
    /// It ends, and can be resumed.
    #[default]
    Ends,
    /// It waits, since somebody is there to order it to continue.
    Waits,
}

impl From<Silence> for Manner<'_> {
    /// Without feedback; a board that parks ends the growth.
    fn from(silence: Silence) -> Self {
        Self { silence, feedback: None, parked: WhenParked::Ends }
    }
}

/// Grows a job from its first layer. `orders` may be given at any time; `on_event` gets what happens to the job.
///
/// # Errors
/// A board that is of another robot, holds an unfinished body, refuses or falls silent.
pub fn grow_job<'a>(
    client: &'a mut Client,
    job: &Job<'a>,
    manner: impl Into<Manner<'a>>,
    orders: &Orders,
    on_event: &mut dyn FnMut(&JobEvent),
) -> Result<Grown, GrowthError> {
    let mut growth = Growth::begin(client, job, manner.into(), on_event)?;
    growth.start_unless_stopped(orders)?;
    growth.finish(orders, on_event)
}

/// Goes on with a job that the board knows. `known` are the layers as built that this host has already.
///
/// # Errors
/// As [`grow_job`], or a board that knows nothing of this job.
pub fn resume_job<'a>(
    client: &'a mut Client,
    job: &Job<'a>,
    known: Vec<Option<LayerBytes>>,
    cut: OnInterrupted,
    manner: impl Into<Manner<'a>>,
    orders: &Orders,
    on_event: &mut dyn FnMut(&JobEvent),
) -> Result<Grown, GrowthError> {
    let mut growth = Growth::take_up(client, job, known, cut, manner.into(), on_event)?;
    growth.start_unless_stopped(orders)?;
    growth.finish(orders, on_event)
}

/// A growth under way.
struct Growth<'a> {
    client: &'a mut Client,
    /// As it was amended last.
    job: Job<'a>,
    silence: Silence,
    feedback: Option<Feedback<'a>>,
    parked: WhenParked,
    sent: Sent,
    built: Built,
    board: BoardClock,
}

/// What the board has been sent of the job: `handover.rs`.
struct Sent {
    /// Every name that the job has had.
    names: Vec<u64>,
    /// An amendment that the board may have applied, or not yet.
    pending: Option<PendingAmendment>,
    /// The job is amended once this many layers are laid.
    amend_at: u32,
    /// The board was asked to pause because the rest would be too near to an obstacle.
    pausing: bool,
    /// Layers below this were reported as handed over.
    handed_over: u32,
    /// What the board has accepted, and has room for.
    accepted: Accepted,
    /// Layers that the board can store.
    capacity: u32,
}

/// What the board has built of the job, as far as it has reported.
#[derive(Default)]
struct Built {
    /// Layers that the board has laid.
    laid: u32,
    /// The layers as the board reports them.
    as_built: Vec<Option<LayerBytes>>,
    interrupted: Option<InterruptedLayer>,
}

impl Built {
    /// Whether every layer laid is reported.
    fn is_reported(&self) -> bool {
        self.as_built.len() >= self.laid as usize
    }
}

/// The board's clock, since one of its starts.
struct BoardClock {
    /// The start.
    boot_id: u32,
    /// When growing began, and when it ended, ms.
    began_ms: Option<u64>,
    ended_ms: u64,
}

impl BoardClock {
    /// How long it has grown.
    fn duration_s(&self) -> f64 {
        self.began_ms.map_or(0.0, |began| self.ended_ms.saturating_sub(began) as f64 / 1000.0)
    }
}

/// An amendment that the board may have applied, or not yet.
struct PendingAmendment {
    /// The job's name then.
    plan_id: u64,
    /// The job's layers then.
    layers: Vec<LayerBytes>,
    /// Layers below this are reported as handed over then.
    handed_over: u32,
}

/// Reports the latest crash of the board's firmware, if the board knows of one.
fn report_crash(client: &mut Client, on_event: &mut dyn FnMut(&JobEvent)) {
    // Whether the board answers this changes nothing for the growth.
    if let Ok(BootReport { crash: Some(crash), .. }) = client.boot() {
        on_event(&JobEvent::Crash(crash));
    }
}

/// Whether a board that has started for this reason has crashed before.
fn is_crash(cause: ResetCause) -> bool {
    matches!(cause, ResetCause::Watchdog | ResetCause::ProcessorFault | ResetCause::StackOverflow)
}

impl<'a> Growth<'a> {
    fn new(client: &'a mut Client, job: &Job<'a>, manner: Manner<'a>, hello: &BoardHello) -> Self {
        Self {
            client,
            job: job.clone(),
            silence: manner.silence,
            feedback: manner.feedback,
            parked: manner.parked,
            sent: Sent::new(job, hello.capacity),
            built: Built::default(),
            board: BoardClock { boot_id: hello.boot_id, began_ms: None, ended_ms: 0 },
        }
    }

    /// Asks for something that is answered by `Accepted`.
    fn ask(&mut self, what: &'static str, request: &Message) -> Result<(), ClientError> {
        match self.client.request(what, request)? {
            Message::Accepted(accepted) => self.sent.accepted = accepted,
            other => return Err(ClientError::Unexpected { request: what, kind: other.kind() }),
        }
        Ok(())
    }

    /// Starts, unless it was to stop while layers were handed over: then nothing is heated.
    fn start_unless_stopped(&mut self, orders: &Orders) -> Result<(), GrowthError> {
        if orders.stops() {
            return Ok(());
        }
        self.start().map_err(|error| match error {
            ClientError::Refused { .. } => GrowthError::Before(error),
            // It may have started, and only the answer is lost.
            error => GrowthError::During(error),
        })
    }

    fn start(&mut self) -> Result<(), ClientError> {
        self.ask("to start", &Message::Start(Start { plan_id: self.job.plan_id, silence: self.silence }))
    }
}
