//! One growth: sends a plan's layers to a board and follows it until the last of them is laid, or resumes an earlier
//! job.

mod amendment;
mod commands;
mod monitor;
mod report;
mod start;

use growbot_core::job::{job_layers, plan_id};
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::crash::CrashWords;
use growbot_core::link::message::{
    Accepted, BoardInfo, BootReport, EnergizingRequest, Fault, HostSilencePolicy, InterruptedLayer, LayerReadings,
    Message, PassiveRequest, ResetCause, Start, State, Status,
};
use growbot_core::path::{Segment, length};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use serde::{Deserialize, Serialize};

pub use self::commands::{Command, CommandQueue};
pub use self::report::{GrowthReport, MeasuredBy, as_built_hash, as_built_or_commanded};
use crate::clearance_guard::{ClearanceViolation, Detour};
use crate::client::{Client, ClientError, ClockDrift};
use crate::feedback::{EncoderReference, Feedback};
use crate::plan::Plan;
use crate::stop_signal::Permit;

/// A job: the layers of a path, for a robot.
#[derive(Debug, Clone, PartialEq)]
pub struct Job<'a> {
    /// The robot.
    pub robot: &'a Robot,
    /// Pose at which the body begins.
    pub start: &'a Pose,
    /// Goal of the tip.
    pub goal: &'a Pose,
    /// Length of the path from start to goal, mm.
    pub length: f64,
    /// Plan id: the hash of the layers.
    pub plan_id: u64,
    /// The layers.
    pub layers: Vec<LayerBytes>,
}

impl<'a> Job<'a> {
    /// Creates the job of a plan. `robot` is the plan's robot.
    #[must_use]
    pub fn of_plan(robot: &'a Robot, plan: &'a Plan) -> Self {
        Self::new(robot, &plan.start, &plan.goal, &plan.path)
    }

    /// Creates the job of a path from `start` to `goal`.
    #[must_use]
    pub fn new(robot: &'a Robot, start: &'a Pose, goal: &'a Pose, path: &[Segment]) -> Self {
        let layers: Vec<LayerBytes> = job_layers(path, robot).collect();
        Self { robot, start, goal, length: length(path), plan_id: plan_id(robot, &layers), layers }
    }
}

/// End of a growth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Every layer is laid.
    Done,
    /// Stopped on request.
    Stopped,
    /// A fault switched everything off.
    Fault(Fault),
    /// The board was stopped, because its clock is wrong and heating, speeds and time limits depend on that clock.
    ClockDrift(ClockDrift),
    /// A long pause has switched the heater off. The body can be resumed.
    Parked,
    /// The board has restarted, or another host has taken it or left it idle. The body can be resumed.
    Interrupted,
    /// The board is silent. It may still be growing.
    Lost,
}

impl Outcome {
    /// Returns the name of the outcome in files.
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

/// An event of a job.
#[derive(Debug, Clone, PartialEq)]
pub enum JobEvent {
    /// The board changed to this state.
    State(State),
    /// The board reported its identity.
    Board(BoardInfo),
    /// The board has restarted because its firmware crashed.
    Crash(CrashWords),
    /// The board's status, which is requested when no events arrive.
    Status(Status),
    /// A layer is laid.
    Laid {
        /// Index of the layer.
        index: u32,
        /// The layer as built, if known.
        as_built: Option<LayerBytes>,
        /// Measurements after the layer.
        measured: Option<LayerReadings>,
    },
    /// Layers of a simulated tip as they came out. A layer is reported once it no longer changes, the last ones at the
    /// end.
    Simulated {
        /// Index of the first layer.
        from: u32,
        /// The layers as they came out.
        layers: Vec<Layer>,
    },
    /// Feedback counts filament from here on.
    EncoderReference(EncoderReference),
    /// An amendment is about to be sent. It takes effect unless `AmendmentRejected` follows.
    Amendment(Amendment),
    /// The board has not accepted the latest amendment. Contains the reason, unless the amendment just came too late.
    AmendmentRejected(Option<String>),
    /// With feedback in a scene: the rest takes another path, because the previous one would be too near to an
    /// obstacle.
    Detour(Detour),
    /// With feedback in a scene: the rest would be too near to an obstacle and no other path was found, so the board is
    /// commanded to pause.
    ClearanceViolation(ClearanceViolation),
    /// With feedback: layers of the job after the layers of its latest amendment are sent.
    LayersSent {
        /// Index of the first layer.
        from: u32,
        /// The layers.
        layers: Vec<LayerBytes>,
    },
    /// An order was given and is now executed.
    Command(Command),
    /// The board refused the order. Contains the reason.
    CommandFailed(String),
    /// The board does not respond. The host reconnects.
    NoResponse,
    /// The board responds again.
    Reconnected,
}

/// Replacement of the layers from an index on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Amendment {
    /// New plan id of the job.
    #[serde(with = "crate::run_log::hash")]
    #[cfg_attr(feature = "schema", schemars(with = "String", extend("pattern" = r"^[0-9a-f]{16}$")))]
    pub plan_id: u64,
    /// Index of the first replaced layer.
    pub from: u32,
    /// Total number of layers of the job after the amendment.
    pub total: u32,
    /// The first of the replacement layers. More may follow.
    #[serde(with = "crate::run_log::layers")]
    #[cfg_attr(feature = "schema", schemars(with = "String", extend("pattern" = r"^([0-9a-f]{24})*$")))]
    pub layers: Vec<LayerBytes>,
}

/// Error that prevents a growth from starting or from being measured.
#[derive(Debug, thiserror::Error)]
pub enum GrowthError {
    /// The growth did not start: nothing was heated or moved.
    #[error(transparent)]
    NotStarted(ClientError),
    /// The board was lost during the growth. It may still be growing.
    #[error("{0}; the robot may still be growing: run `growbot status`, and if that fails cut the robot's power")]
    Interrupted(ClientError),
    /// There is nothing to resume.
    #[error(
        "the board has no unfinished body of this plan ({plan_id:016x}), but {stored}: give the plan of that body, or \
         start a new growth"
    )]
    NothingToResume {
        /// Plan id of the plan.
        plan_id: u64,
        /// Description of the job that the board stores.
        stored: String,
    },
    /// An unfinished body is attached to the robot.
    #[error(
        "the board has an unfinished body of plan {plan_id:016x}, {laid} of {layers} layers laid: resume it (`growbot \
         resume`), or discard it (`growbot cancel`)"
    )]
    Unfinished {
        /// Plan id of the body.
        plan_id: u64,
        /// Number of laid layers.
        laid: u32,
        /// Number of layers of the plan.
        layers: u32,
    },
}

impl GrowthError {
    /// Returns the error for a board whose status shows nothing to resume of this plan.
    #[must_use]
    pub fn nothing_to_resume(plan_id: u64, status: &Status) -> Self {
        let stored = match status.plan_id {
            0 => "no unfinished body".to_string(),
            id => format!("one of plan {id:016x}, with {} of {} layers laid", status.layers_laid, status.layer_count),
        };
        Self::NothingToResume { plan_id, stored }
    }

    /// Reports whether the board responded but did not accept the job.
    #[must_use]
    pub fn is_refusal(&self) -> bool {
        match self {
            Self::NotStarted(ClientError::Refused { .. } | ClientError::Voided { .. })
            | Self::NothingToResume { .. }
            | Self::Unfinished { .. } => true,
            Self::NotStarted(_) | Self::Interrupted(_) => false,
        }
    }
}

/// Treatment of an interrupted layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OnInterrupted {
    /// The interrupted layer is laid again as a whole, on top of the part that is finished.
    #[default]
    Redo,
    /// The layer is skipped and stays as it is.
    Skip,
}

/// Options of a growth.
pub struct GrowthOptions<'a> {
    /// Reaction of the board when this host falls silent.
    pub silence: HostSilencePolicy,
    /// If given, the remaining layers are planned again after each layer. For a job that is resumed, it must include
    /// the known layers.
    pub feedback: Option<Feedback<'a>>,
    /// Effect on the growth when the board parks.
    pub parked: OnParked,
}

/// Effect on a growth when its board parks after a long pause.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OnParked {
    /// The growth ends, and can be resumed.
    #[default]
    End,
    /// The growth waits, because a user can command it to continue.
    Wait,
}

impl From<HostSilencePolicy> for GrowthOptions<'_> {
    /// Creates options without feedback. A board that parks ends the growth.
    fn from(silence: HostSilencePolicy) -> Self {
        Self { silence, feedback: None, parked: OnParked::End }
    }
}

/// Grows a job from its first layer. Commands may be added to `orders` at any time. `on_event` receives the events of
/// the job.
///
/// # Errors
/// If the board belongs to another robot, holds an unfinished body, refuses or falls silent.
pub fn grow_job<'a>(
    client: &'a mut Client,
    job: &Job<'a>,
    manner: impl Into<GrowthOptions<'a>>,
    orders: &CommandQueue,
    on_event: &mut dyn FnMut(&JobEvent),
) -> Result<GrowthReport, GrowthError> {
    let mut growth = JobRunner::begin(client, job, manner.into(), orders, on_event)?;
    growth.start_unless_stopped(orders)?;
    growth.finish(orders, on_event)
}

/// Resumes a job that the board knows. `known` are the layers as built that this host already has.
///
/// # Errors
/// Like [`grow_job`], or if the board does not know this job.
pub fn resume_job<'a>(
    client: &'a mut Client,
    job: &Job<'a>,
    known: Vec<Option<LayerBytes>>,
    cut: OnInterrupted,
    manner: impl Into<GrowthOptions<'a>>,
    orders: &CommandQueue,
    on_event: &mut dyn FnMut(&JobEvent),
) -> Result<GrowthReport, GrowthError> {
    let mut growth = JobRunner::resume(client, job, known, cut, manner.into(), orders, on_event)?;
    growth.start_unless_stopped(orders)?;
    growth.finish(orders, on_event)
}

/// A growth in progress.
struct JobRunner<'a> {
    client: &'a mut Client,
    /// The job after its latest amendment.
    job: Job<'a>,
    silence: HostSilencePolicy,
    feedback: Option<Feedback<'a>>,
    parked: OnParked,
    /// Permit of the growth, or of the latest order to continue it.
    permit: Permit,
    /// True once the board has begun the growth: it has accepted a start, or its status shows an earlier start.
    is_started: bool,
    sent: UploadState,
    built: LaidProgress,
    board: BoardClock,
}

/// Parts of the job that were sent to the board; see `handover.rs`.
struct UploadState {
    /// All plan ids that the job has had.
    names: Vec<u64>,
    /// An amendment that the board may or may not have applied.
    pending: Option<PendingAmendment>,
    /// Number of laid layers at which the job is amended next.
    amend_at: u32,
    /// True if the board was commanded to pause because the rest would be too near to an obstacle.
    pausing: bool,
    /// Number of layers that were reported as sent.
    handed_over: u32,
    /// Layers that the board has accepted, and its free space.
    accepted: Accepted,
    /// Number of layers that the board can store.
    capacity: u32,
}

/// Progress of the job as reported by the board.
#[derive(Default)]
struct LaidProgress {
    /// Number of laid layers.
    laid: u32,
    /// The layers as built, as the board reports them.
    as_built: Vec<Option<LayerBytes>>,
    interrupted: Option<InterruptedLayer>,
}

impl LaidProgress {
    /// Reports whether every laid layer is reported.
    fn is_reported(&self) -> bool {
        self.as_built.len() >= self.laid as usize
    }
}

/// Times on the board's clock since one of its starts.
struct BoardClock {
    /// Boot number of the board during these times.
    boot_id: u32,
    /// Start and end of the growth, ms.
    began_ms: Option<u64>,
    ended_ms: u64,
}

impl BoardClock {
    /// Returns the duration of the growth, s.
    fn duration_s(&self) -> f64 {
        self.began_ms.map_or(0.0, |began| self.ended_ms.saturating_sub(began) as f64 / 1000.0)
    }
}

/// An amendment that the board may or may not have applied.
struct PendingAmendment {
    /// Plan id of the amended job.
    plan_id: u64,
    /// Layers of the amended job.
    layers: Vec<LayerBytes>,
    /// Number of layers that count as sent once the board has applied the amendment.
    handed_over: u32,
}

/// Reports the latest crash of the board's firmware, if the board has one recorded.
fn report_crash(client: &mut Client, on_event: &mut dyn FnMut(&JobEvent)) {
    // The growth continues even if the board does not respond to this.
    if let Ok(BootReport { crash: Some(crash), .. }) = client.boot_report() {
        on_event(&JobEvent::Crash(crash));
    }
}

/// Reports whether a board that restarted for this reason has crashed.
fn is_crash(cause: ResetCause) -> bool {
    matches!(cause, ResetCause::Watchdog | ResetCause::ProcessorFault | ResetCause::StackOverflow)
}

impl<'a> JobRunner<'a> {
    fn new(
        client: &'a mut Client,
        job: &Job<'a>,
        manner: GrowthOptions<'a>,
        orders: &CommandQueue,
        hello: &BoardInfo,
    ) -> Self {
        Self {
            client,
            job: job.clone(),
            silence: manner.silence,
            feedback: manner.feedback,
            parked: manner.parked,
            permit: orders.permit(),
            is_started: false,
            sent: UploadState::new(job, hello.layer_capacity),
            built: LaidProgress::default(),
            board: BoardClock { boot_id: hello.boot_id, began_ms: None, ended_ms: 0 },
        }
    }

    /// Sends a request whose response is `Accepted`.
    fn request_accepted(&mut self, what: &'static str, request: &PassiveRequest) -> Result<(), ClientError> {
        let response = self.client.request(what, request)?;
        self.accept(what, response)
    }

    fn accept(&mut self, what: &'static str, response: Message) -> Result<(), ClientError> {
        match response {
            Message::Accepted(accepted) => self.sent.accepted = accepted,
            other => return Err(ClientError::Unexpected { request: what, kind: other.kind() }),
        }
        Ok(())
    }

    /// Starts the growth. Heats nothing if a user has commanded a stop while layers were sent, or if the board waits for
    /// a person and the permit is that of a continuation. A pause that is commanded while a new growth starts takes
    /// effect after the start.
    fn start_unless_stopped(&mut self, orders: &CommandQueue) -> Result<(), GrowthError> {
        if orders.stop_requested() {
            return Ok(());
        }
        if self.permit.is_continuation() {
            let status = self.client.status().map_err(GrowthError::Interrupted)?;
            self.is_started = status.state != State::Idle;
            if orders.pause_waits() || !self.permit.allows_start(&status) {
                return Ok(());
            }
        }
        let started = self.start();
        // From here on, a pause voids each `Start` that no later order requests.
        self.permit = self.permit.until_pause();
        started.or_else(|error| match error {
            // The growth carries out the pause or the stop next.
            ClientError::Voided { .. } if self.permit.is_continuation() => Ok(()),
            ClientError::Refused { .. } | ClientError::Voided { .. } => Err(GrowthError::NotStarted(error)),
            // It may have started, and only the response is lost.
            error => Err(GrowthError::Interrupted(error)),
        })
    }

    fn start(&mut self) -> Result<(), ClientError> {
        let what = "the request to start";
        let start = Start { plan_id: self.job.plan_id, on_host_silence: self.silence };
        let response = self.client.energize(what, &EnergizingRequest::Start(start), &self.permit)?;
        self.accept(what, response)?;
        self.is_started = true;
        Ok(())
    }
}
