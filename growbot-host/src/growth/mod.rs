//! One growth: a plan's layers handed to a board, followed until the last of them is laid; or taken up again where it was left.

mod handover;
mod orders;

use std::time::Duration;

use growbot_core::hash::Hasher;
use growbot_core::job::{job_layers, summarize};
use growbot_core::layer::{Layer, grow};
use growbot_core::layer_bytes::{LayerBytes, decode};
use growbot_core::link::message::{
    Accepted, Begin, BoardHello, Cut, Empty, Fault, Laid, Measured, Message, Refusal, Resume, Silence, Start, State,
    Status, Waits,
};
use growbot_core::path::{Segment, length};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;

use self::handover::IN_ENGINE;
pub use self::orders::{Order, Orders};
use crate::arrival::Arrival;
use crate::client::{Client, ClientError};
use crate::feedback::{Count, FedBack, Feedback};

/// How long to wait for an event before orders are looked at,
const LOOK: Duration = Duration::from_millis(200);
/// and, after so many looks in vain, before the board is asked for its status.
const QUIET_LOOKS: u32 = 10;
/// Layers whose news are still on the way when the growth has ended are waited for in so many looks.
const LOOKS_AFTER_THE_END: u32 = 40;
/// A board that has fallen silent is called again so often before it counts as lost.
const CALLS: u32 = 12;

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
    /// The job that a path is.
    #[must_use]
    pub fn new(robot: &'a Robot, start: &'a Pose, goal: &'a Pose, path: &[Segment]) -> Self {
        Self {
            robot,
            start,
            goal,
            length: length(path),
            plan_id: summarize(path, robot).plan_id,
            layers: job_layers(path, robot).collect(),
        }
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
    /// It was held for so long that the heater was switched off; it can be resumed.
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
            Self::Fault(_) => "fault",
            Self::Parked => "parked",
            Self::Interrupted => "interrupted",
            Self::Lost => "lost",
        }
    }
}

/// What a growth came to, measured from the steps that were made.
#[derive(Debug, Clone, PartialEq)]
pub struct Grown {
    /// How it ended.
    pub outcome: Outcome,
    /// The job's name.
    pub plan_id: u64,
    /// The body, layer by layer.
    pub body: Vec<Layer>,
    /// Where the tip is, and how far that is from the goal.
    pub arrival: Arrival,
    /// From the first layer to the last, s, by the board's clock.
    pub duration_s: f64,
    /// Filament that was fed, mm.
    pub filament_mm: f64,
    /// The layers as the board has built them, from the first one. None where nothing is known of one: it was cut and let be, and in
    /// the body it stands as planned.
    pub as_built: Vec<Option<LayerBytes>>,
    /// The layer under way when it ended: how much of it was made.
    pub cut: Option<Cut>,
    /// What the arrival is measured by.
    pub measured_by: MeasuredBy,
    /// What feedback came to; none without it.
    pub fed_back: Option<FedBack>,
}

/// What an arrival is measured by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeasuredBy {
    /// The simulated tip: it is the truth.
    Tip,
    /// What feedback has made of the sensors.
    Estimate,
    /// The steps that the board has made, as if each layer had come out as they say.
    Steps,
}

impl MeasuredBy {
    /// In a word.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Tip => "tip",
            Self::Estimate => "estimate",
            Self::Steps => "steps",
        }
    }
}

impl Grown {
    /// Length of the body, mm.
    #[must_use]
    pub fn length_mm(&self) -> f64 {
        self.body.iter().fold(0.0, |length, layer| length + layer.height)
    }

    /// Layers of which nothing is known.
    #[must_use]
    pub fn unknown(&self) -> usize {
        self.as_built.iter().filter(|layer| layer.is_none()).count()
    }
}

/// CRC-64/XZ of the layers as built, in order, each in its 12 bytes; one of which nothing is known is 12 zeros.
#[must_use]
pub fn as_built_hash(layers: &[Option<LayerBytes>]) -> u64 {
    let mut hasher = Hasher::default();
    for layer in layers {
        hasher.bytes(&layer.unwrap_or_default());
    }
    hasher.finish()
}

/// News of a growth.
#[derive(Debug, Clone, PartialEq)]
pub enum News {
    /// The board went into a state.
    State(State),
    /// The board has said who it is.
    Board(BoardHello),
    /// The board's status, asked for in quiet times.
    Status(Status),
    /// A layer is laid: its index, the layer as built where that is known, and what was measured after it.
    Laid(u32, Option<LayerBytes>, Option<Measured>),
    /// Feedback counts filament from here on.
    Counting(Count),
    /// The job is about to be amended. It is, unless `NotAmended` follows.
    Amending(Amendment),
    /// The board has not taken the latest amendment: why, unless it just came too late.
    NotAmended(Option<String>),
    /// With feedback: layers of the job beyond those of its latest amendment are handed over, from this index on.
    HandingOver(u32, Vec<LayerBytes>),
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
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Amendment {
    /// The job's new name.
    pub plan_id: u64,
    /// Index of the first other layer.
    pub from: u32,
    /// Layers of the job from now on.
    pub total: u32,
    /// The first of the other layers.
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
    /// There is nothing to go on with.
    #[error("the board has no unfinished body of this plan ({plan_id:016x}); it holds {held}")]
    NothingToResume {
        /// The plan.
        plan_id: u64,
        /// What the board holds.
        held: String,
    },
    /// An unfinished body hangs on the robot.
    #[error(
        "the board holds an unfinished body of plan {plan_id:016x}, {laid} of {layers} layers laid: go on with it (`growbot resume`), or give it up (`growbot cancel`)"
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

/// What becomes of a layer that was cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CutLayer {
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
    /// With it, layers to come are planned again after each that is laid. Of a job that goes on it has heard of the layers known.
    pub feedback: Option<Feedback<'a>>,
}

impl From<Silence> for Manner<'_> {
    /// Without feedback.
    fn from(silence: Silence) -> Self {
        Self { silence, feedback: None }
    }
}

/// Grows a job from its first layer. `orders` may be given at any time; `tell` hears the news.
///
/// # Errors
/// A board that is of another robot, holds an unfinished body, refuses or falls silent.
pub fn grow_job<'a>(
    client: &'a mut Client,
    job: &Job<'a>,
    manner: impl Into<Manner<'a>>,
    orders: &Orders,
    tell: &mut dyn FnMut(&News),
) -> Result<Grown, GrowthError> {
    let mut growth = Growth::begin(client, job, manner.into(), tell)?;
    growth.start().map_err(GrowthError::Before)?;
    growth.finish(orders, tell)
}

/// Goes on with a job that the board knows. `known` are the layers as built that this host has already.
///
/// # Errors
/// As [`grow_job`], or a board that knows nothing of this job.
pub fn resume_job<'a>(
    client: &'a mut Client,
    job: &Job<'a>,
    known: Vec<Option<LayerBytes>>,
    cut: CutLayer,
    manner: impl Into<Manner<'a>>,
    orders: &Orders,
    tell: &mut dyn FnMut(&News),
) -> Result<Grown, GrowthError> {
    let mut growth = Growth::take_up(client, job, known, cut, manner.into(), tell)?;
    growth.start().map_err(GrowthError::Before)?;
    growth.finish(orders, tell)
}

/// A growth under way.
struct Growth<'a> {
    client: &'a mut Client,
    /// As it was amended last.
    job: Job<'a>,
    silence: Silence,
    feedback: Option<Feedback<'a>>,
    /// Every name that the job has had.
    names: Vec<u64>,
    /// An amendment of which it is not known whether the board has taken it: the job's name and layers then, and what is told of them.
    amending: Option<(u64, Vec<LayerBytes>, u32)>,
    /// The job is amended once so many layers are laid.
    amend_at: u32,
    /// Layers below this have been told to whoever hears the news.
    told: u32,
    /// What the board has accepted, and has room for.
    accepted: Accepted,
    /// Layers that the board has laid.
    laid: u32,
    /// What a simulated tip had laid before: layers, and feed steps. None where this host has not seen the body's beginning.
    laid_before: Option<(usize, u64)>,
    /// The layers as the board reports them.
    as_built: Vec<Option<LayerBytes>>,
    cut: Option<Cut>,
    /// Layers that the board can hold.
    capacity: u32,
    boot_id: u32,
    /// When growing began and ended, ms on the board's clock.
    began_ms: Option<u64>,
    ended_ms: u64,
}

impl<'a> Growth<'a> {
    fn new(client: &'a mut Client, job: &Job<'a>, manner: Manner<'a>, hello: &BoardHello) -> Self {
        Self {
            client,
            job: job.clone(),
            silence: manner.silence,
            feedback: manner.feedback,
            names: vec![job.plan_id],
            amending: None,
            amend_at: 0,
            told: job.layers.len() as u32,
            accepted: Accepted { plan_id: 0, next: 0, room: 0 },
            laid: 0,
            laid_before: None,
            as_built: Vec::new(),
            cut: None,
            capacity: hello.capacity,
            boot_id: hello.boot_id,
            began_ms: None,
            ended_ms: 0,
        }
    }

    /// Hands a new job to the board: as many layers as it holds.
    fn begin(
        client: &'a mut Client,
        job: &Job<'a>,
        manner: Manner<'a>,
        tell: &mut dyn FnMut(&News),
    ) -> Result<Self, GrowthError> {
        let hello = client.hello_robot(job.robot).map_err(GrowthError::Before)?;
        tell(&News::Board(hello.clone()));
        let Status { plan_id, laid, layers, state, cut, .. } = hello.status;
        if plan_id != 0 && (laid > 0 || cut.is_some()) && laid < layers && state != State::Stopped {
            return Err(GrowthError::Unfinished { plan_id, laid, layers });
        }
        let mut growth = Self::new(client, job, manner, &hello);
        growth.hand_over_all(tell).map_err(GrowthError::Before)?;
        growth.count_from_here(tell).map_err(GrowthError::Before)?;
        Ok(growth)
    }

    fn hand_over_all(&mut self, tell: &mut dyn FnMut(&News)) -> Result<(), ClientError> {
        let tip = self.client.port().tip()?;
        self.laid_before = Some(tip.map_or((0, 0), |tip| (tip.body.len(), tip.feed_steps)));
        let begin =
            Begin { plan_id: self.job.plan_id, layers: self.job.layers.len() as u32, robot: self.job.robot.hash() };
        self.ask("to begin a job", &Message::Begin(begin))?;
        self.hand_over(tell)
    }

    /// Takes up a job that the board knows.
    fn take_up(
        client: &'a mut Client,
        job: &Job<'a>,
        known: Vec<Option<LayerBytes>>,
        cut: CutLayer,
        manner: Manner<'a>,
        tell: &mut dyn FnMut(&News),
    ) -> Result<Self, GrowthError> {
        let hello = client.hello_robot(job.robot).map_err(GrowthError::Before)?;
        tell(&News::Board(hello.clone()));
        let mut growth = Self::new(client, job, manner, &hello);
        if hello.status.plan_id != growth.job.plan_id {
            return Err(GrowthError::NothingToResume { plan_id: growth.job.plan_id, held: held(&hello.status) });
        }
        growth.as_built = known;
        growth.attach(&hello.status, cut, tell).map_err(GrowthError::Before)?;
        Ok(growth)
    }

    /// Feedback counts the filament from now on, unless it already counts what this start of the board has fed.
    fn count_from_here(&mut self, tell: &mut dyn FnMut(&News)) -> Result<(), ClientError> {
        let Some(feedback) = self.feedback.as_mut().filter(|feedback| !feedback.counts_in(self.boot_id)) else {
            return Ok(());
        };
        let filament_pulses = self.client.sensors()?.filament_pulses;
        let count = Count { boot_id: self.boot_id, laid: self.laid, filament_pulses };
        feedback.count_from(&count);
        tell(&News::Counting(count));
        Ok(())
    }

    fn attach(&mut self, status: &Status, cut: CutLayer, tell: &mut dyn FnMut(&News)) -> Result<(), ClientError> {
        let skip = status.cut.is_some() && cut == CutLayer::LetBe;
        self.laid = status.laid;
        // What is not known is told from the first hole on.
        let known = self.as_built.len().min(status.laid as usize);
        self.as_built.truncate(known);
        let from = status.laid + u32::from(skip);
        let resume = Resume { plan_id: self.job.plan_id, from, known: known as u32 };
        self.ask("to resume", &Message::Resume(resume))?;
        self.laid = from;
        self.count_from_here(tell)?;
        // At rest any layer can be another one.
        self.amend_at = 0;
        self.amend(self.laid, tell)?;
        self.hand_over(tell)
    }

    /// Asks for something that is answered by `Accepted`.
    fn ask(&mut self, what: &'static str, request: &Message) -> Result<(), ClientError> {
        match self.client.request(what, request)? {
            Message::Accepted(accepted) => self.accepted = accepted,
            other => return Err(ClientError::Unexpected { request: what, kind: other.kind() }),
        }
        Ok(())
    }

    fn start(&mut self) -> Result<(), ClientError> {
        self.ask("to start", &Message::Start(Start { plan_id: self.job.plan_id, silence: self.silence }))
    }

    /// Follows the growth to its end and measures the body.
    fn finish(mut self, orders: &Orders, tell: &mut dyn FnMut(&News)) -> Result<Grown, GrowthError> {
        let mut outcome = self.follow(orders, tell);
        for _ in 0..CALLS {
            match outcome {
                Err(ClientError::Silent { .. } | ClientError::Garbage { .. }) => {
                    tell(&News::Silent);
                    outcome = self.call_again(orders, tell);
                }
                // The board does not know us any more: it has restarted, or another host has taken it.
                Err(ClientError::Refused { refusal: Refusal::NoSession, .. }) => {
                    outcome = self.call_again(orders, tell);
                }
                _ => break,
            }
        }
        let outcome = match outcome {
            Ok(outcome) => outcome,
            Err(ClientError::Silent { .. } | ClientError::Garbage { .. }) => Outcome::Lost,
            Err(ClientError::Held { .. } | ClientError::Refused { refusal: Refusal::NoSession, .. }) => {
                Outcome::Interrupted
            }
            Err(error) => return Err(GrowthError::During(error)),
        };
        self.measure(outcome).map_err(GrowthError::During)
    }

    /// Opens another session and goes on following, if the board still has the job.
    fn call_again(&mut self, orders: &Orders, tell: &mut dyn FnMut(&News)) -> Result<Outcome, ClientError> {
        let hello = self.client.hello_robot(self.job.robot)?;
        tell(&News::Back);
        if self.amending.as_ref().is_some_and(|(plan_id, ..)| *plan_id == hello.status.plan_id) {
            self.amended();
        } else if self.amending.take().is_some() {
            tell(&News::NotAmended(None));
        }
        if hello.boot_id != self.boot_id || hello.status.plan_id != self.job.plan_id {
            self.laid = hello.status.laid;
            self.cut = hello.status.cut;
            self.ended_ms = hello.status.uptime_ms;
            return Ok(Outcome::Interrupted);
        }
        if outcome(hello.status.state, hello.status.fault).is_none() || hello.status.state == State::Done {
            self.attach(&hello.status, CutLayer::Again, tell)?;
        }
        self.follow(orders, tell)
    }

    fn follow(&mut self, orders: &Orders, tell: &mut dyn FnMut(&News)) -> Result<Outcome, ClientError> {
        let mut stopped_by = None;
        let mut quiet_looks = 0;
        // A body of no length is done at once.
        let mut ask = true;
        // Asked so often after the end, for layers that have not been told yet.
        let mut looks_after_the_end = 0;
        loop {
            if let Some(order) = orders.take().filter(|order| stopped_by != Some(*order)) {
                self.obey(order, tell)?;
                stopped_by = Some(order).filter(|order| *order >= Order::Stop);
                ask = true;
            }
            if std::mem::take(&mut ask) {
                let status = self.client.status()?;
                if let Some(outcome) = self.take_status(&status, tell)? {
                    if self.as_built.len() >= self.laid as usize || looks_after_the_end > LOOKS_AFTER_THE_END {
                        return Ok(outcome);
                    }
                    looks_after_the_end += 1;
                } else {
                    tell(&News::Status(status));
                }
            }
            let event = self.client.event(LOOK)?;
            quiet_looks = if event.is_some() { 0 } else { quiet_looks + 1 };
            match event {
                Some(Message::Laid(laid)) if self.names.contains(&laid.plan_id) => {
                    if laid.index as usize == self.as_built.len() {
                        self.take_layer(&laid);
                        tell(&News::Laid(laid.index, laid.as_built, laid.measured));
                    }
                    self.laid = self.laid.max(laid.index + 1);
                    self.accepted.room = self.capacity.saturating_sub(self.accepted.next.saturating_sub(self.laid));
                    self.amend(self.laid + IN_ENGINE, tell)?;
                    self.refill(tell)?;
                    // The last of those that were missing at the end.
                    ask = looks_after_the_end > 0 && self.as_built.len() >= self.laid as usize;
                }
                Some(Message::StateChanged(change)) => {
                    tell(&News::State(change.state));
                    // The news may be of the job before: only the status says how this one stands.
                    ask = true;
                }
                Some(_) => {}
                None if quiet_looks >= QUIET_LOOKS => {
                    quiet_looks = 0;
                    ask = true;
                }
                None => {}
            }
        }
    }

    /// Carries an order out. One that does not suit the board's state is refused, and the growth goes on as it was.
    fn obey(&mut self, order: Order, tell: &mut dyn FnMut(&News)) -> Result<(), ClientError> {
        tell(&News::Ordered(order));
        let done = match order {
            Order::GoOn => self.start(),
            Order::Hold => self.client.request("to hold", &Message::Hold(Empty {})).map(drop),
            Order::Stop => self.client.request("to stop", &Message::Stop(Empty {})).map(drop),
            Order::EmergencyStop => self.client.emergency_stop(),
        };
        match done {
            Err(error @ ClientError::Refused { refusal: Refusal::WrongState { .. }, .. }) => {
                tell(&News::NotObeyed(error.to_string()));
                Ok(())
            }
            done => done,
        }
    }

    /// A layer is laid, the next one after those that are known.
    fn take_layer(&mut self, laid: &Laid) {
        let commanded = self.job.layers.get(self.as_built.len());
        if let (Some(feedback), Some(layer)) = (&mut self.feedback, laid.as_built.as_ref().or(commanded)) {
            feedback.laid(layer, laid.measured.as_ref());
        }
        self.as_built.push(laid.as_built);
    }

    /// Takes what the board says of itself: how the job ended, if it did.
    fn take_status(&mut self, status: &Status, tell: &mut dyn FnMut(&News)) -> Result<Option<Outcome>, ClientError> {
        if status.state == State::Growing && self.began_ms.is_none() {
            self.began_ms = Some(status.uptime_ms);
        }
        // A board that has restarted, or that another host has taken, knows nothing of this job.
        let lost = (status.plan_id != self.job.plan_id).then_some(Outcome::Interrupted);
        if let Some(outcome) = outcome(status.state, status.fault).or(lost) {
            self.ended_ms = status.uptime_ms;
            if status.plan_id == self.job.plan_id {
                (self.laid, self.cut) = (status.laid, status.cut);
            }
            return Ok(Some(outcome));
        }
        self.accepted.next = status.next;
        self.laid = status.laid;
        self.accepted.room = self.capacity.saturating_sub(status.next.saturating_sub(status.laid));
        self.refill(tell)?;
        // It held because it had not heard of us for long.
        if status.state == State::Hold && status.waits == Waits::ForHost {
            self.start()?;
        }
        Ok(None)
    }

    /// The body from the steps: the simulated tip's where there is one, else as the board reports it.
    fn measure(self, outcome: Outcome) -> Result<Grown, ClientError> {
        let as_reported = || {
            let layers = self.as_built.iter().zip(&self.job.layers);
            layers.map(|(as_built, planned)| decode(as_built.as_ref().unwrap_or(planned))).collect()
        };
        // What cannot be asked any more is not asked.
        let tip = if outcome == Outcome::Lost { None } else { self.client.port().tip()? };
        let per_length = self.job.robot.feed_steps_per_length();
        let is_tip = tip.is_some() && self.laid_before.is_some();
        let (body, feed_steps): (Vec<Layer>, f64) = match (tip, self.laid_before) {
            (Some(mut tip), Some((layers, feed))) => {
                (tip.body.split_off(layers.min(tip.body.len())), (tip.feed_steps - feed) as f64)
            }
            _ => {
                let body: Vec<Layer> = as_reported();
                let fed = body.iter().fold(0.0, |sum, layer| sum + layer.height) * per_length;
                (body, fed)
            }
        };
        let fed_back = self.feedback.as_ref().map(Feedback::result);
        let (measured_by, end) = match &fed_back {
            Some(fed_back) if !is_tip => (MeasuredBy::Estimate, fed_back.estimate.base_from_tip),
            _ => {
                let measured_by = if is_tip { MeasuredBy::Tip } else { MeasuredBy::Steps };
                (measured_by, grow(&self.job.start.frame(), body.iter().copied()))
            }
        };
        Ok(Grown {
            outcome,
            plan_id: self.job.plan_id,
            arrival: Arrival::of(&end, self.job.goal, self.job.length),
            body,
            duration_s: self.began_ms.map_or(0.0, |began| self.ended_ms.saturating_sub(began) as f64 / 1000.0),
            filament_mm: feed_steps / self.job.robot.description().feed.steps_per_mm,
            as_built: self.as_built,
            cut: self.cut,
            measured_by,
            fed_back,
        })
    }
}

/// What a board holds, in words.
fn held(status: &Status) -> String {
    match status.plan_id {
        0 => "no job".to_string(),
        id => format!("plan {id:016x}, {} of {} layers laid", status.laid, status.layers),
    }
}

/// How a growth in this state has ended, if it has.
fn outcome(state: State, fault: Option<Fault>) -> Option<Outcome> {
    match state {
        State::Done => Some(Outcome::Done),
        State::Stopped | State::EmergencyStop => Some(Outcome::Stopped),
        State::Fault => Some(Outcome::Fault(fault.unwrap_or(Fault::Hardware))),
        State::Parked => Some(Outcome::Parked),
        State::SelfTest
        | State::Idle
        | State::Heating
        | State::Homing
        | State::Growing
        | State::Hold
        | State::Tuning => None,
    }
}
