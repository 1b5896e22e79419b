//! The truth about a growth on a simulated tip: where its plastic really is.
//!
//! A port carries bytes; who opens one to a simulated robot also gets its [`Simulation`]. [`compare`] follows a growth
//! with it, and replaces what the steps or the sensors say of the body by what the tip has laid.

use growbot_client::arrival::Arrival;
use growbot_client::client::ClientError;
use growbot_client::growth::{Grown, GrowthError, Job, JobEvent, MeasuredBy, Outcome};
use growbot_client::port::PortError;
use growbot_core::layer::{Layer, grow};

use crate::tip::hand::Hand;
use crate::tip::pins::SharedTip;

/// What can be asked of a simulated tip while a port talks to its board.
pub trait Simulation {
    /// What it has laid so far.
    ///
    /// # Errors
    /// If the tip can no longer be read.
    fn laid(&mut self) -> Result<Laid, PortError>;

    /// Does what a person would do to it by hand. False where nobody can.
    fn by_hand(&mut self, _hand: Hand) -> bool {
        false
    }

    /// The layers of its body which no longer change, from this index on.
    fn settled(&mut self, from: usize) -> Vec<Layer>;
}

/// What a simulated tip has laid, from its steps.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Laid {
    /// The body, layer by layer.
    pub body: Vec<Layer>,
    /// Steps of the feed.
    pub feed_steps: u64,
}

impl Simulation for SharedTip {
    fn laid(&mut self) -> Result<Laid, PortError> {
        let tip = self.borrow();
        Ok(Laid { body: tip.body(), feed_steps: tip.feed_steps() })
    }

    fn settled(&mut self, from: usize) -> Vec<Layer> {
        self.borrow_mut().settled(from).to_vec()
    }

    fn by_hand(&mut self, hand: Hand) -> bool {
        self.borrow_mut().by_hand(hand);
        true
    }
}

/// Grows a job by `grow`. Where a simulation is given, whose tip stands where the body begins, `on_event` also gets
/// where the plastic is, and the result is measured by the tip, unless the board was lost.
///
/// # Errors
/// Those of `grow`, and a tip that cannot be read.
pub fn compare(
    simulation: Option<&mut Box<dyn Simulation>>,
    job: &Job,
    on_event: &mut dyn FnMut(&JobEvent),
    grow: impl FnOnce(&mut dyn FnMut(&JobEvent)) -> Result<Grown, GrowthError>,
) -> Result<Grown, GrowthError> {
    let Some(simulation) = simulation else { return grow(on_event) };
    let mut truth =
        Truth::from_here(simulation.as_mut()).map_err(|error| GrowthError::Before(ClientError::Port(error)))?;
    let mut grown = grow(&mut |event| {
        on_event(event);
        if let JobEvent::Laid { .. } = event {
            truth.report_settled(on_event);
        }
    })?;
    if grown.outcome != Outcome::Lost {
        truth.measure(&mut grown, job, on_event).map_err(|error| GrowthError::During(ClientError::Port(error)))?;
    }
    Ok(grown)
}

/// The truth about one growth, from the body's beginning on.
struct Truth<'a> {
    simulation: &'a mut dyn Simulation,
    /// What the tip had laid before.
    layers_before: usize,
    feed_steps_before: u64,
    /// Of how many layers since then it has been told where their plastic is.
    told: usize,
}

impl<'a> Truth<'a> {
    fn from_here(simulation: &'a mut dyn Simulation) -> Result<Self, PortError> {
        let Laid { body, feed_steps } = simulation.laid()?;
        Ok(Self { simulation, layers_before: body.len(), feed_steps_before: feed_steps, told: 0 })
    }

    fn report_settled(&mut self, on_event: &mut dyn FnMut(&JobEvent)) {
        let settled = self.simulation.settled(self.layers_before.saturating_add(self.told));
        self.report(&settled, on_event);
    }

    fn measure(&mut self, grown: &mut Grown, job: &Job, on_event: &mut dyn FnMut(&JobEvent)) -> Result<(), PortError> {
        let Laid { mut body, feed_steps } = self.simulation.laid()?;
        let body = body.split_off(self.layers_before.min(body.len()));
        self.report(body.get(self.told..).unwrap_or_default(), on_event);
        let end = grow(&job.start.frame(), body.iter().copied());
        let fed = feed_steps.saturating_sub(self.feed_steps_before) as f64;
        grown.measured_by = MeasuredBy::Tip;
        grown.arrival = Arrival::of(&end, job.goal, job.length);
        grown.filament_mm = fed / job.robot.description().feed.steps_per_mm;
        grown.body = body;
        Ok(())
    }

    fn report(&mut self, layers: &[Layer], on_event: &mut dyn FnMut(&JobEvent)) {
        if !layers.is_empty() {
            on_event(&JobEvent::Simulated {
                from: u32::try_from(self.told).unwrap_or(u32::MAX),
                layers: layers.to_vec(),
            });
            self.told += layers.len();
        }
    }
}
