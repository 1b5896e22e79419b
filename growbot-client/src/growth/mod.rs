//! One growth: sends the layers of a plan to a board, or resumes the job that the board stores, and processes the
//! board's events until the last layer is laid.

mod amendment;
mod commands;
mod monitor;
mod request;
pub(crate) mod start;

use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::message::{
    Accepted, BoardInfo, BootReport, EnergizingRequest, HostSilencePolicy, InterruptedLayer, Message, PassiveRequest,
    PauseCause, Refusal, ResetCause, Start, State, Status,
};
use growbot_plan::feedback::Feedback;
use growbot_plan::growth_report::GrowthReport;
use growbot_plan::job::{Job, JobEvent};

pub use self::commands::CommandQueue;
pub use self::request::{Beginning, DEFAULT_SEED, GrowthBoard, GrowthRefusal, GrowthRequest, LogTarget, Override};
use crate::client::{Client, ClientError};
use crate::stop_signal::Permit;

/// Error of a growth that could not start, or whose result is unknown.
#[derive(Debug, thiserror::Error)]
pub enum GrowthError {
    /// The growth did not start: nothing was heated or moved.
    #[error("{0}")]
    NotStarted(#[source] ClientError),
    /// The connection to the board failed during the growth. The board may still be growing.
    #[error("{0}; the robot may still be growing")]
    Interrupted(#[source] ClientError),
    /// The board does not store an unfinished job with the plan id that was to be resumed.
    #[error("the board has no unfinished body of this plan ({plan_id:016x}): {stored}")]
    NothingToResume {
        /// Plan id of the job that was to be resumed.
        plan_id: u64,
        /// Description of the job that the board stores.
        stored: String,
    },
    /// The board stores an unfinished job, so it does not begin a new one.
    #[error("the board has an unfinished body of plan {plan_id:016x}, {laid} of {layers} layers laid: resume it")]
    Unfinished {
        /// Plan id of the unfinished job.
        plan_id: u64,
        /// Number of laid layers.
        laid: u32,
        /// Number of layers of the unfinished job.
        layers: u32,
    },
}

impl GrowthError {
    /// Returns [`GrowthError::NothingToResume`] for a board with this status. `plan_id` is the job that was to be
    /// resumed.
    pub fn nothing_to_resume(plan_id: u64, status: &Status) -> Self {
        let stored = match status.plan_id {
            0 => "it stores none, so start a new growth".to_string(),
            id => format!(
                "it stores a body of plan {id:016x}, with {} of {} layers laid: resume that one if layers are missing, \
                 or start a new growth",
                status.layers_laid, status.layer_count
            ),
        };
        Self::NothingToResume { plan_id, stored }
    }

    /// Reports whether the growth did not start because the board refused the job or a stop voided the start, and not
    /// because the connection failed.
    pub fn is_refusal(&self) -> bool {
        match self {
            Self::NotStarted(ClientError::Refused { .. } | ClientError::Voided { .. })
            | Self::NothingToResume { .. }
            | Self::Unfinished { .. } => true,
            Self::NotStarted(_) | Self::Interrupted(_) => false,
        }
    }
}

/// Treatment of an interrupted layer when its job is resumed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OnInterrupted {
    /// The interrupted layer is laid again as a whole, on top of the part that is finished.
    #[default]
    Redo,
    /// The interrupted layer stays as it is, and the job continues with the next layer.
    Skip,
}

/// Options of a growth.
pub struct GrowthOptions<'a> {
    /// Reaction of the board if it receives nothing from this host for too long.
    pub silence: HostSilencePolicy,
    /// Feedback that plans the remaining layers again after each layer. `None` for a growth without feedback. For a
    /// resumed job, the laid layers must already be recorded in it.
    pub feedback: Option<Feedback<'a>>,
    /// Reaction of the growth when the board switches its heater off after a long pause (parks).
    pub parked: OnParked,
    /// Treatment of an interrupted layer when the job is resumed.
    pub interrupted: OnInterrupted,
}

/// Reaction of a growth when its board switches the heater off after a long pause (parks).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OnParked {
    /// The growth ends with [`Outcome::Parked`](growbot_plan::growth_report::Outcome::Parked), and can be resumed.
    #[default]
    End,
    /// The growth waits for a user's command to continue.
    Wait,
}

impl From<HostSilencePolicy> for GrowthOptions<'_> {
    /// Creates options without feedback. A board that parks ends the growth.
    fn from(silence: HostSilencePolicy) -> Self {
        Self { silence, feedback: None, parked: OnParked::End, interrupted: OnInterrupted::Redo }
    }
}

/// Grows a job from its first layer. Commands may be added to `orders` at any time. `on_event` receives the events of
/// the job.
///
/// # Errors
/// If the board belongs to another robot, stores an unfinished job, refuses a request or does not respond.
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

/// Resumes the job that the board stores. `known` are the layers as built that this host already has, from the first
/// layer on; the board reports the later ones again.
///
/// # Errors
/// Like [`grow_job`], or if the board does not store this job.
pub fn resume_job<'a>(
    client: &'a mut Client,
    job: &Job<'a>,
    known: Vec<Option<LayerBytes>>,
    manner: impl Into<GrowthOptions<'a>>,
    orders: &CommandQueue,
    on_event: &mut dyn FnMut(&JobEvent),
) -> Result<GrowthReport, GrowthError> {
    let mut growth = JobRunner::resume(client, job, known, manner.into(), orders, on_event)?;
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
    /// Permit of the growth, or of the latest command to continue it.
    permit: Permit,
    /// True once the board has accepted a `Start` request, or its status shows an earlier start.
    is_started: bool,
    /// State of the board that was known or recorded last. The first report of a board repeats the state in which a
    /// session was opened, unless an earlier session has received that report.
    state: State,
    sent: UploadState,
    built: LaidProgress,
    board: BoardClock,
}

/// Progress of sending the layers of a job to the board; see `amendment.rs`.
struct UploadState {
    /// All plan ids of the job: the original one, and one for each amendment.
    names: Vec<u64>,
    /// Amendment that was sent, but for which the board's response has not arrived. `None` otherwise.
    pending: Option<PendingAmendment>,
    /// Number of laid layers from which on the job may be amended again.
    amend_at: u32,
    /// True if the board was commanded to pause because the remaining layers would be too near to an obstacle.
    pausing: bool,
    /// Number of layers, from the first of the job, that were recorded as sent in a [`JobEvent`].
    handed_over: u32,
    /// Index of the next layer that the board expects, and its free space for layers.
    accepted: Accepted,
    /// Number of layers that the board can store.
    capacity: u32,
}

/// Progress of the job as reported by the board.
#[derive(Default)]
struct LaidProgress {
    /// Number of laid layers.
    laid: u32,
    /// Layers as built, in order, as the board has reported them. `None` for a layer of which nothing is known.
    as_built: Vec<Option<LayerBytes>>,
    interrupted: Option<InterruptedLayer>,
}

impl LaidProgress {
    /// Reports whether the board has reported every laid layer.
    fn is_reported(&self) -> bool {
        self.as_built.len() >= self.laid as usize
    }
}

/// Begin and end of the growth on the board's clock, which starts at 0 when the board starts.
struct BoardClock {
    /// Boot number of the board whose clock is used.
    boot_id: u32,
    /// Time of the first status in which the board grows, ms. `None` before.
    began_ms: Option<u64>,
    ended_ms: u64,
}

impl BoardClock {
    /// Returns the duration of the growth, s.
    fn duration_s(&self) -> f64 {
        self.began_ms.map_or(0.0, |began| self.ended_ms.saturating_sub(began) as f64 / 1000.0)
    }
}

/// An amendment that was sent, but for which the board's response has not arrived.
struct PendingAmendment {
    /// Plan id of the amended job.
    plan_id: u64,
    /// Layers of the amended job.
    layers: Vec<LayerBytes>,
    /// Number of layers, from the first of the job, that count as sent once the board has applied the amendment.
    handed_over: u32,
}

/// Requests the latest crash of the board's firmware, and reports it as an event if the board has recorded one.
fn report_crash(client: &mut Client, on_event: &mut dyn FnMut(&JobEvent)) {
    // The growth continues even if the board does not respond to this request.
    if let Ok(BootReport { crash: Some(crash), .. }) = client.boot_report() {
        on_event(&JobEvent::Crash(crash));
    }
}

/// Reports whether this cause of a restart is a crash of the firmware.
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
            state: hello.status.state,
            sent: UploadState::new(job, hello.layer_capacity),
            built: LaidProgress::default(),
            board: BoardClock { boot_id: hello.boot_id, began_ms: None, ended_ms: 0 },
        }
    }

    /// Sends a request whose response is `Accepted`, and stores that response. `what` names the request in error
    /// messages.
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

    /// Sends `Start` to the board, unless a user has commanded a stop meanwhile. A growth that is resumed without a
    /// command of a person is not started either if the board waits for a person. A pause that is commanded while a new
    /// growth starts takes effect after the start.
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
        // From here on, a pause voids this permit, so only a later command to continue can start the growth again.
        self.permit = self.permit.until_pause();
        started.or_else(|error| match error {
            // The growth executes the pause or the stop next.
            ClientError::Voided { .. } if self.permit.is_continuation() => Ok(()),
            // Meanwhile the board has begun to wait for a person.
            ClientError::Refused { refusal: Refusal::WrongState { .. }, .. } if self.permit.is_continuation() => Ok(()),
            ClientError::Refused { refusal: Refusal::NoSession, .. } => self.follow_if_started(error),
            ClientError::Refused { .. } | ClientError::Voided { .. } => Err(GrowthError::NotStarted(error)),
            // The board may have started, and only its response is lost.
            error => Err(GrowthError::Interrupted(error)),
        })
    }

    /// Decides by the board's status what a `Start` that was refused without a session means: the board may have
    /// accepted an earlier copy of it, whose response was lost before another host took the board over.
    fn follow_if_started(&mut self, refusal: ClientError) -> Result<(), GrowthError> {
        let status = self.client.status().map_err(GrowthError::Interrupted)?;
        let has_started = match status.state {
            State::Heating | State::Homing | State::Growing | State::Done => true,
            // A start has ended any other pause.
            State::Paused => status.pause_cause == PauseCause::LayersExhausted,
            _ => false,
        };
        self.is_started = has_started && status.plan_id == self.job.plan_id;
        if self.is_started { Ok(()) } else { Err(GrowthError::NotStarted(refusal)) }
    }

    fn start(&mut self) -> Result<(), ClientError> {
        let what = "the request to start";
        let is_continuation = self.permit.is_continuation();
        let start = Start { plan_id: self.job.plan_id, on_host_silence: self.silence, is_continuation };
        let response = self.client.energize(what, &EnergizingRequest::Start(start), &self.permit)?;
        self.accept(what, response)?;
        self.is_started = true;
        Ok(())
    }
}
