//! One growth: a plan's layers handed to a board, followed until the last of them is laid.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use growbot_core::job::{job_layers, summarize};
use growbot_core::layer::{Layer, grow};
use growbot_core::layer_bytes::{LayerBytes, decode};
use growbot_core::link::message::{
    Accepted, Begin, Empty, Fault, LayerBatch, Layers, MOST_LAYERS, Message, Refusal, Start, State, Status,
};
use growbot_core::path::{Segment, length};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;

use crate::arrival::Arrival;
use crate::client::{Client, ClientError};

/// How long to wait for an event before asking for the status.
const QUIET: Duration = Duration::from_secs(2);

/// A job: a path for a robot.
#[derive(Debug, Clone, Copy)]
pub struct Job<'a> {
    /// The robot.
    pub robot: &'a Robot,
    /// Where the body begins.
    pub start: &'a Pose,
    /// Where its tip is to arrive.
    pub goal: &'a Pose,
    /// The path between.
    pub path: &'a [Segment],
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
}

impl Outcome {
    /// The outcome in a word.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Stopped => "stopped",
            Self::Fault(_) => "fault",
        }
    }
}

/// What a growth came to, measured from the steps that were made.
#[derive(Debug, Clone, PartialEq)]
pub struct Grown {
    /// How it ended.
    pub outcome: Outcome,
    /// The body, layer by layer.
    pub body: Vec<Layer>,
    /// Where the tip is, and how far that is from the goal.
    pub arrival: Arrival,
    /// From the first layer to the last, s, by the board's clock.
    pub duration_s: f64,
    /// Filament that was fed, mm.
    pub filament_mm: f64,
    /// Layers that the board laid and whose report was lost: in the body they stand as planned.
    pub unreported: usize,
}

impl Grown {
    /// Length of the body, mm.
    #[must_use]
    pub fn length_mm(&self) -> f64 {
        self.body.iter().fold(0.0, |length, layer| length + layer.height)
    }
}

/// News of a growth.
#[derive(Debug, Clone, PartialEq)]
pub enum News {
    /// The board went into a state.
    State(State),
    /// The board's status, asked for in quiet times.
    Status(Status),
    /// A layer is laid: its index, and the layer as built.
    Laid(u32, Layer),
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
}

/// Grows a job. `stop` may be set at any time; `tell` hears the news.
///
/// # Errors
/// A board that is of another robot, refuses or falls silent.
pub fn grow_job(
    client: &mut Client,
    job: &Job,
    stop: &AtomicBool,
    tell: &mut dyn FnMut(&News),
) -> Result<Grown, GrowthError> {
    let mut growth = Growth::hand_over(client, job).map_err(GrowthError::Before)?;
    growth.start().map_err(GrowthError::Before)?;
    let outcome = growth.follow(stop, tell).map_err(GrowthError::During)?;
    growth.measure(outcome).map_err(GrowthError::During)
}

/// A growth under way.
struct Growth<'a> {
    client: &'a mut Client,
    job: &'a Job<'a>,
    plan_id: u64,
    layers: Vec<LayerBytes>,
    /// Layers that the board has accepted.
    accepted: u32,
    /// Layers that the board has laid.
    laid: u32,
    /// Layers that the board can still take.
    room: u32,
    /// What a simulated tip had laid before: layers, and feed steps.
    laid_before: (usize, u64),
    /// The layers as the board reports them, each with its feed steps.
    reported: BTreeMap<u32, (Layer, u32)>,
    /// Layers that the board can hold.
    capacity: u32,
    /// When growing began and ended, ms on the board's clock.
    began_ms: Option<u64>,
    ended_ms: u64,
}

impl<'a> Growth<'a> {
    /// Hands the job to the board: as many layers as it holds.
    fn hand_over(client: &'a mut Client, job: &'a Job<'a>) -> Result<Self, ClientError> {
        let hello = client.hello_robot(job.robot)?;
        let laid_before = client.port().tip()?.map_or((0, 0), |tip| (tip.body.len(), tip.feed_steps));
        let summary = summarize(job.path, job.robot);
        let layers: Vec<LayerBytes> = job_layers(job.path, job.robot).collect();
        let begin = Begin { plan_id: summary.plan_id, layers: summary.layers, robot: job.robot.hash() };
        let answer = client.request("to begin a job", &Message::Begin(begin))?;
        let mut growth = Self {
            client,
            job,
            plan_id: summary.plan_id,
            layers,
            accepted: 0,
            laid: 0,
            room: 0,
            laid_before,
            reported: BTreeMap::new(),
            capacity: hello.capacity,
            began_ms: None,
            ended_ms: 0,
        };
        growth.take_accepted("to begin a job", &answer)?;
        while growth.send_batch()? {}
        Ok(growth)
    }

    fn take_accepted(&mut self, request: &'static str, answer: &Message) -> Result<(), ClientError> {
        let Message::Accepted(Accepted { next, room, .. }) = *answer else {
            return Err(ClientError::Unexpected { request, kind: answer.kind() });
        };
        (self.accepted, self.room) = (next, room);
        Ok(())
    }

    /// Sends the next layers, if there are any and the board has room. Whether it did.
    fn send_batch(&mut self) -> Result<bool, ClientError> {
        let rest = self.layers.get(self.accepted as usize..).unwrap_or_default();
        let count = rest.len().min(MOST_LAYERS).min(self.room as usize);
        // Whole batches, but for the last.
        if count == 0 || count < rest.len().min(MOST_LAYERS) {
            return Ok(false);
        }
        let layers: LayerBatch = rest.iter().take(count).copied().collect();
        let batch = Message::Layers(Layers { plan_id: self.plan_id, first: self.accepted, layers });
        let what = "to take layers";
        match self.client.request(what, &batch) {
            Ok(answer) => self.take_accepted(what, &answer)?,
            // It stopped in between; the status will say so.
            Err(ClientError::Refused { refusal: Refusal::WrongState { .. }, .. }) => return Ok(false),
            Err(error) => return Err(error),
        }
        Ok(true)
    }

    fn start(&mut self) -> Result<(), ClientError> {
        let what = "to start";
        let answer = self.client.request(what, &Message::Start(Start { plan_id: self.plan_id }))?;
        self.take_accepted(what, &answer)
    }

    fn follow(&mut self, stop: &AtomicBool, tell: &mut dyn FnMut(&News)) -> Result<Outcome, ClientError> {
        let mut asked_to_stop = false;
        // A body of no length is done at once.
        let mut ask = true;
        loop {
            if stop.load(Ordering::Relaxed) && !asked_to_stop {
                self.client.request("to stop", &Message::Stop(Empty {}))?;
                asked_to_stop = true;
                ask = true;
            }
            if std::mem::take(&mut ask) {
                let status = self.client.status()?;
                if let Some(outcome) = self.take_status(&status)? {
                    return Ok(outcome);
                }
                tell(&News::Status(status));
            }
            match self.client.event(QUIET)? {
                Some(Message::Laid(laid)) if laid.plan_id == self.plan_id => {
                    let layer = decode(&laid.as_built);
                    self.reported.insert(laid.index, (layer, laid.feed_steps));
                    self.laid = laid.index + 1;
                    self.room = self.room.saturating_add(1);
                    tell(&News::Laid(laid.index, layer));
                    self.send_batch()?;
                }
                Some(Message::StateChanged(change)) => {
                    tell(&News::State(change.state));
                    // The news may be of the job before: only the status says how this one stands.
                    ask = true;
                }
                Some(_) => {}
                // Quiet: perhaps an event was lost.
                None => ask = true,
            }
        }
    }

    /// Takes what the board says of itself: how the job ended, if it did.
    fn take_status(&mut self, status: &Status) -> Result<Option<Outcome>, ClientError> {
        if status.state == State::Growing && self.began_ms.is_none() {
            self.began_ms = Some(status.uptime_ms);
        }
        // A board that has restarted, or that another host has taken, knows nothing of this job.
        let lost = (status.plan_id != self.plan_id).then_some(Outcome::Stopped);
        if let Some(outcome) = outcome(status.state, status.fault).or(lost) {
            self.ended_ms = status.uptime_ms;
            self.laid = status.laid;
            return Ok(Some(outcome));
        }
        (self.accepted, self.laid) = (status.next, status.laid);
        self.room = self.capacity.saturating_sub(status.next.saturating_sub(status.laid));
        while self.send_batch()? {}
        Ok(None)
    }

    /// The body from the steps: the simulated tip's where there is one, else as the board reports it.
    fn measure(self, outcome: Outcome) -> Result<Grown, ClientError> {
        let (layers_before, feed_before) = self.laid_before;
        let mut unreported = 0;
        let (body, feed_steps) = match self.client.port().tip()? {
            Some(mut tip) => (tip.body.split_off(layers_before.min(tip.body.len())), tip.feed_steps - feed_before),
            None => {
                let body = (0..self.laid).zip(&self.layers).map(|(index, planned)| {
                    let reported = self.reported.get(&index);
                    unreported += usize::from(reported.is_none());
                    reported.map_or_else(|| decode(planned), |(layer, _)| *layer)
                });
                (body.collect(), self.reported.values().map(|(_, steps)| u64::from(*steps)).sum())
            }
        };
        let end = grow(&self.job.start.frame(), body.iter().copied());
        Ok(Grown {
            outcome,
            arrival: Arrival::of(&end, self.job.goal, length(self.job.path)),
            body,
            duration_s: self.began_ms.map_or(0.0, |began| self.ended_ms.saturating_sub(began) as f64 / 1000.0),
            filament_mm: feed_steps as f64 / self.job.robot.description().feed.steps_per_mm,
            unreported,
        })
    }
}

/// How a growth in this state has ended, if it has.
fn outcome(state: State, fault: Option<Fault>) -> Option<Outcome> {
    match state {
        State::Done => Some(Outcome::Done),
        State::Stopped | State::EmergencyStop => Some(Outcome::Stopped),
        State::Fault => Some(Outcome::Fault(fault.unwrap_or(Fault::Hardware))),
        State::SelfTest
        | State::Idle
        | State::Heating
        | State::Homing
        | State::Growing
        | State::Hold
        | State::Parked
        | State::Tuning => None,
    }
}
