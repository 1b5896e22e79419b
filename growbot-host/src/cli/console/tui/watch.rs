//! Follows a board while the screen lives: lets time pass on `sim`, takes what the board says, asks how it does.

use std::time::{Duration, Instant};

use growbot_client::client::{Client, ClientError};

use super::model::Model;
use crate::cli::following::stopped_for;

/// How often a real board is asked how it does,
const STATUS: Duration = Duration::from_millis(500);
/// how often for its sensors,
const SENSORS: Duration = Duration::from_secs(2);
/// and how often once it does not answer.
const LOST: Duration = Duration::from_secs(3);
/// How long to wait for what a real board says unasked.
const EVENT: Duration = Duration::from_millis(10);
/// The longest that time on `sim` passes without a look, unless it runs fast.
const VIRTUAL_STEP: Duration = Duration::from_secs(2);
/// Looks at `sim` in one go, at most.
const LOOKS: u32 = 20;
/// How long `sim` may compute before the keys are looked at again.
const COMPUTE: Duration = Duration::from_millis(200);
/// How many times as fast as real time `sim` may run; it begins with the fifth.
const SPEEDS: [u32; 9] = [1, 3, 10, 30, 60, 200, 600, 2_000, 6_000];

/// A board that is followed.
pub struct Watch {
    client: Client,
    /// Index into [`SPEEDS`]; none for a board with a clock of its own.
    speed: Option<usize>,
    /// The board's clock when it was asked latest, ms.
    latest_ms: u64,
    asked: Option<Instant>,
    sensed: Option<Instant>,
}

impl Watch {
    /// Follows a board; on a virtual clock, time passes only here.
    pub fn new(client: Client, virtual_clock: bool) -> Self {
        Self { client, speed: virtual_clock.then_some(4), latest_ms: 0, asked: None, sensed: None }
    }

    /// The board.
    pub fn client(&mut self) -> &mut Client {
        &mut self.client
    }

    /// How many times as fast as real time it runs; none for a board with a clock of its own.
    pub fn speed(&self) -> Option<f64> {
        self.factor().map(f64::from)
    }

    fn factor(&self) -> Option<u32> {
        self.speed.and_then(|index| SPEEDS.get(index)).copied()
    }

    /// Lets time on `sim` pass faster or slower. Whether there is such a speed.
    pub fn change_speed(&mut self, faster: bool) -> bool {
        let Some(speed) = &mut self.speed else { return false };
        let next = if faster { speed.saturating_add(1) } else { speed.wrapping_sub(1) };
        let there = next < SPEEDS.len();
        if there {
            *speed = next;
        }
        there
    }

    /// Takes what happens within so much real time.
    pub fn follow(&mut self, model: &mut Model, passed: Duration) {
        let due = |asked: Option<Instant>, every| asked.is_none_or(|at| at.elapsed() >= every);
        if model.lost.is_some() && !due(self.asked, LOST) {
            return;
        }
        let done = match self.factor() {
            Some(factor) => self.let_pass(model, passed * factor),
            None => self.listen(model, due(self.asked, STATUS)),
        };
        let done = done.and_then(|()| {
            if due(self.sensed, SENSORS) {
                model.sensors = Some(self.client.sensors()?);
                self.sensed = Some(Instant::now());
            }
            Ok(())
        });
        if let Err(error) = done {
            self.asked = Some(Instant::now());
            model.apply_loss(&error.to_string());
        }
    }

    fn listen(&mut self, model: &mut Model, ask: bool) -> Result<(), ClientError> {
        let began = Instant::now();
        while let Some(event) = self.client.event(EVENT)? {
            model.apply_event(&event);
            if began.elapsed() > COMPUTE {
                break;
            }
        }
        if ask { self.ask(model).map(drop) } else { Ok(()) }
    }

    fn let_pass(&mut self, model: &mut Model, time: Duration) -> Result<(), ClientError> {
        let began = Instant::now();
        let mut now = self.ask(model)?;
        let until = now.saturating_add(time.as_millis() as u64);
        let step = VIRTUAL_STEP.max(time / LOOKS);
        while now < until && began.elapsed() < COMPUTE {
            if let Some(event) = self.client.event(step.min(Duration::from_millis(until - now)))? {
                model.apply_event(&event);
            }
            let before = now;
            now = self.ask(model)?;
            if now < before {
                // The board has started anew, and its clock too.
                break;
            }
        }
        Ok(())
    }

    /// How the board does; gives its clock, ms.
    fn ask(&mut self, model: &mut Model) -> Result<u64, ClientError> {
        self.asked = Some(Instant::now());
        let mut status = self.client.status()?;
        if status.uptime_ms < self.latest_ms {
            // It has started anew, and knows nothing of our session.
            status = self.client.hello()?.status;
            model.say("the board has started anew");
        }
        self.latest_ms = status.uptime_ms;
        model.apply_status(status);
        if let Some(drift) = self.client.stop_if_clock_drifts()? {
            model.complain(stopped_for(&drift, self.speed.is_some()).message());
        }
        Ok(self.latest_ms)
    }
}
