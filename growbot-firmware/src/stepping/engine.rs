//! The step interrupt: tick by tick, integers only.
//!
//! Both axes of a sector are spread evenly over its ticks by adding and comparing: with `n` steps in `t` ticks, `n` is added
//! in each tick to an accumulator that starts at `t / 2`, and each time it reaches `t` a step is due. So steps fall
//! where the even line crosses half steps, and after `t` ticks there are exactly `n`.
//!
//! A step pulse is raised in one tick and lowered in the next, so it is high for a tick and low for at least one.
//!
//! [`Engine::ticks_to_event`] and [`Engine::skip`] let a simulation pass over ticks in which no pin changes; what happens
//! is the same, tick for tick.

use embedded_hal::digital::{InputPin, OutputPin};
use growbot_core::layer::SECTORS;

use super::handover::{Handover, Homing, Order, Report, TurnReport};
use super::turn::{Sector, Turn};

/// A stepper driver: step, direction and enable pins. Levels are logical; a board that wires them the other way round wraps
/// its pins in [`crate::polarity::Polarized`].
pub struct Axis<S, D, E> {
    /// A rising edge is a step.
    pub step: S,
    /// High: the head turns counter-clockwise, the feed pushes filament out.
    pub direction: D,
    /// High: the motor is held.
    pub enable: E,
}

/// An axis, and whether its step pin is high.
struct Driver<S, D, E> {
    pins: Axis<S, D, E>,
    raised: bool,
}

impl<S: OutputPin, D: OutputPin, E: OutputPin> Driver<S, D, E> {
    fn enable(&mut self) -> Result<(), Failed> {
        self.pins.direction.set_high().map_err(|_| Failed)?;
        self.pins.enable.set_high().map_err(|_| Failed)
    }

    /// Lets go of the motor. Tried even where a pin has failed before.
    fn disable(&mut self) {
        self.raised = false;
        let _ = self.pins.step.set_low();
        let _ = self.pins.enable.set_low();
    }

    fn raise(&mut self) -> Result<(), Failed> {
        self.raised = true;
        self.pins.step.set_high().map_err(|_| Failed)
    }

    fn lower(&mut self) -> Result<(), Failed> {
        if !self.raised {
            return Ok(());
        }
        self.raised = false;
        self.pins.step.set_low().map_err(|_| Failed)
    }
}

/// A pin failed.
struct Failed;

/// Spreads steps evenly over ticks.
#[derive(Debug, Clone, Copy)]
struct Spread {
    steps: u32,
    ticks: u32,
    accumulator: u32,
}

impl Spread {
    const NONE: Self = Self { steps: 0, ticks: 1, accumulator: 0 };

    fn new(steps: u32, ticks: u32) -> Self {
        Self { steps, ticks, accumulator: ticks / 2 }
    }

    /// One tick on: whether a step is due.
    fn tick(&mut self) -> bool {
        self.accumulator += self.steps;
        let due = self.accumulator >= self.ticks;
        if due {
            self.accumulator -= self.ticks;
        }
        due
    }

    /// Ticks until a step is due, that tick included.
    fn ticks_to_step(&self) -> u32 {
        if self.steps == 0 { u32::MAX } else { (self.ticks - self.accumulator).div_ceil(self.steps) }
    }

    /// Passes over ticks in which no step is due.
    fn skip(&mut self, ticks: u32) {
        self.accumulator += self.steps * ticks;
    }
}

/// What the engine is doing.
enum Mode {
    Idle,
    Homing(HomingRun),
    /// The turn is in [`Engine::turn`], its progress in [`Engine::progress`].
    Laying,
}

/// A homing under way.
struct HomingRun {
    homing: Homing,
    ticks_to_step: u32,
    steps_made: u32,
    /// The mark has been seen from outside, so that its leading edge is told from its middle.
    left_mark: bool,
    /// Steps still to make after the leading edge.
    steps_to_zero: Option<u32>,
}

/// A turn under way.
struct Progress {
    sector: usize,
    ticks_left: u32,
    head: Spread,
    feed: Spread,
    made: TurnReport,
}

/// Drives head and feed. One per robot, ticked by the step interrupt.
pub struct Engine<HS, HD, HE, FS, FD, FE, I> {
    head: Driver<HS, HD, HE>,
    feed: Driver<FS, FD, FE>,
    index: I,
    mode: Mode,
    turn: Turn,
    progress: Progress,
}

impl<HS, HD, HE, FS, FD, FE, I> Engine<HS, HD, HE, FS, FD, FE, I>
where
    HS: OutputPin,
    HD: OutputPin,
    HE: OutputPin,
    FS: OutputPin,
    FD: OutputPin,
    FE: OutputPin,
    I: InputPin,
{
    /// An idle engine; both drivers are switched off. The index pin is high while the sensor sees the mark.
    pub fn new(head: Axis<HS, HD, HE>, feed: Axis<FS, FD, FE>, index: I) -> Self {
        let mut engine = Self {
            head: Driver { pins: head, raised: false },
            feed: Driver { pins: feed, raised: false },
            index,
            mode: Mode::Idle,
            turn: Turn { sectors: [Sector::default(); SECTORS] },
            progress: Progress {
                sector: 0,
                ticks_left: 0,
                head: Spread::NONE,
                feed: Spread::NONE,
                made: TurnReport { head: 0, feed: [0; SECTORS] },
            },
        };
        engine.let_go();
        engine
    }

    /// One tick of the step interrupt.
    pub fn tick(&mut self, handover: &Handover) {
        handover.ticks.fetch_add(1, core::sync::atomic::Ordering::Relaxed);
        if handover.take_halt() {
            self.let_go();
            return;
        }
        if self.advance(handover).is_err() {
            self.let_go();
            handover.report(Report::Hardware);
        }
    }

    /// Ticks until something happens, that tick included. `u32::MAX` where nothing will without an order.
    pub fn ticks_to_event(&self, handover: &Handover) -> u32 {
        if self.head.raised || self.feed.raised || handover.halt_waits() {
            return 1;
        }
        match &self.mode {
            Mode::Idle if handover.order_is_ready() => 1,
            Mode::Idle => u32::MAX,
            Mode::Homing(run) => run.ticks_to_step.max(1),
            Mode::Laying => {
                let progress = &self.progress;
                progress.ticks_left.min(progress.head.ticks_to_step()).min(progress.feed.ticks_to_step())
            }
        }
    }

    /// Passes over ticks in which nothing happens: fewer than [`Engine::ticks_to_event`].
    pub fn skip(&mut self, ticks: u32) {
        match &mut self.mode {
            Mode::Idle => {}
            Mode::Homing(run) => run.ticks_to_step -= ticks,
            Mode::Laying => {
                self.progress.ticks_left -= ticks;
                self.progress.head.skip(ticks);
                self.progress.feed.skip(ticks);
            }
        }
    }

    fn let_go(&mut self) {
        self.mode = Mode::Idle;
        self.head.disable();
        self.feed.disable();
    }

    fn advance(&mut self, handover: &Handover) -> Result<(), Failed> {
        self.head.lower()?;
        self.feed.lower()?;
        if matches!(self.mode, Mode::Idle) && handover.order_is_ready() {
            match handover.take_order() {
                Some(Order::Home(homing)) => {
                    self.head.enable()?;
                    self.mode = Mode::Homing(HomingRun {
                        homing,
                        ticks_to_step: homing.ticks_per_step,
                        steps_made: 0,
                        left_mark: false,
                        steps_to_zero: None,
                    });
                }
                Some(Order::Lay(turn)) => {
                    self.head.enable()?;
                    self.feed.enable()?;
                    self.turn = turn;
                    self.progress.made = TurnReport { head: 0, feed: [0; SECTORS] };
                    self.mode = Mode::Laying;
                    self.start_sector(0);
                }
                Some(Order::Feed(_)) => handover.report(Report::Fed),
                None => {}
            }
        }
        match &mut self.mode {
            Mode::Idle => Ok(()),
            Mode::Homing(run) => {
                let outcome = run.tick(&mut self.head, &mut self.index)?;
                if let Some(report) = outcome {
                    self.mode = Mode::Idle;
                    handover.report(report);
                }
                Ok(())
            }
            Mode::Laying => self.lay(handover),
        }
    }

    fn start_sector(&mut self, index: usize) {
        let Some(&Sector { ticks, head, feed }) = self.turn.sectors.get(index) else { return };
        self.progress.sector = index;
        self.progress.ticks_left = ticks;
        self.progress.head = Spread::new(head, ticks);
        self.progress.feed = Spread::new(feed, ticks);
    }

    fn lay(&mut self, handover: &Handover) -> Result<(), Failed> {
        let progress = &mut self.progress;
        if progress.head.tick() {
            progress.made.head += 1;
            self.head.raise()?;
        }
        if progress.feed.tick() {
            if let Some(made) = progress.made.feed.get_mut(progress.sector) {
                *made += 1;
            }
            self.feed.raise()?;
        }
        progress.ticks_left -= 1;
        if progress.ticks_left == 0 {
            let next = progress.sector + 1;
            if next < SECTORS {
                self.start_sector(next);
            } else {
                self.mode = Mode::Idle;
                handover.report(Report::Laid(self.progress.made));
            }
        }
        Ok(())
    }
}

impl HomingRun {
    /// One tick: a report when it is over.
    fn tick<S: OutputPin, D: OutputPin, E: OutputPin, I: InputPin>(
        &mut self,
        head: &mut Driver<S, D, E>,
        index: &mut I,
    ) -> Result<Option<Report>, Failed> {
        self.ticks_to_step = self.ticks_to_step.saturating_sub(1);
        if self.ticks_to_step > 0 {
            return Ok(None);
        }
        if self.steps_to_zero.is_none() {
            let on_mark = index.is_high().map_err(|_| Failed)?;
            if on_mark && self.left_mark {
                self.steps_to_zero = Some(self.homing.steps_to_zero);
            }
            self.left_mark |= !on_mark;
        }
        match &mut self.steps_to_zero {
            Some(0) => return Ok(Some(Report::Homed)),
            Some(left) => *left -= 1,
            None if self.steps_made == self.homing.most_steps => return Ok(Some(Report::IndexNotFound)),
            None => self.steps_made += 1,
        }
        self.ticks_to_step = self.homing.ticks_per_step;
        head.raise()?;
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stepping::Material;
    use crate::testing::{FakePin, FakePins, robot_a};
    use growbot_core::layer::Layer;
    use growbot_core::layer_bytes::Encoder;
    use std::vec::Vec;

    type FakeEngine = Engine<FakePin, FakePin, FakePin, FakePin, FakePin, FakePin, FakePin>;

    fn engine(pins: &FakePins) -> FakeEngine {
        let axis = |at: usize| Axis { step: pins.pin(at), direction: pins.pin(at + 1), enable: pins.pin(at + 2) };
        Engine::new(axis(0), axis(3), pins.pin(6))
    }

    fn turn() -> Turn {
        let layer = Layer { alpha: 1.0, height: 0.774, tilt: 0.0077 };
        Material::default().lay(&Encoder::default().encode(&layer), &robot_a(), false).unwrap()
    }

    /// Ticks (from 1) at which head and feed rise, until the report.
    fn rises(skipping: bool) -> (Vec<(u64, usize)>, Report) {
        let (pins, handover) = (FakePins::default(), Handover::new());
        let mut engine = engine(&pins);
        handover.give(Order::Lay(turn()));
        let (mut now, mut rises) = (0_u64, Vec::new());
        loop {
            if skipping {
                let quiet = engine.ticks_to_event(&handover) - 1;
                engine.skip(quiet);
                now += u64::from(quiet);
            }
            let before = [pins.level(0), pins.level(3)];
            engine.tick(&handover);
            now += 1;
            for (axis, at) in [0, 3].into_iter().enumerate() {
                if pins.level(at) && !before[axis] {
                    rises.push((now, axis));
                }
                assert!(!(pins.level(at) && before[axis]), "a pulse lasts one tick");
            }
            if let Some(report) = handover.take_report() {
                return (rises, report);
            }
            assert!(now < 100_000);
        }
    }

    #[test]
    fn a_turn_makes_exactly_its_steps() {
        let (rises, report) = rises(false);
        let Report::Laid(made) = report else { panic!("{report:?}") };
        let turn = turn();
        assert_eq!(made.feed, turn.sectors.map(|sector| sector.feed));
        assert_eq!(made.head, 3200);
        assert_eq!(rises.iter().filter(|(_, axis)| *axis == 0).count(), 3200);
        assert_eq!(rises.iter().filter(|(_, axis)| *axis == 1).count() as u32, made.feed.iter().sum::<u32>());
    }

    #[test]
    fn skipping_quiet_ticks_changes_nothing() {
        assert_eq!(rises(true), rises(false));
    }

    #[test]
    fn steps_of_a_spread_fall_within_its_ticks_and_leave_room_for_the_pulse() {
        for ticks in 2..60 {
            for steps in 0..=ticks / 2 {
                // Two sectors alike, one after the other.
                let mut due = Vec::new();
                for sector in 0..2 {
                    let mut spread = Spread::new(steps, ticks);
                    for tick in 0..ticks {
                        if spread.tick() {
                            due.push(sector * ticks + tick);
                        }
                    }
                }
                assert_eq!(due.len() as u32, 2 * steps);
                assert!(due.windows(2).all(|pair| pair[1] - pair[0] >= 2), "{steps} in {ticks}: {due:?}");
            }
        }
    }

    #[test]
    fn a_halt_lets_go_at_the_next_tick() {
        let (pins, handover) = (FakePins::default(), Handover::new());
        let mut engine = engine(&pins);
        assert!(!pins.level(2) && !pins.level(5));
        handover.give(Order::Lay(turn()));
        for _ in 0..1000 {
            engine.tick(&handover);
        }
        assert!(pins.level(2) && pins.level(5));
        handover.halt();
        assert_eq!(engine.ticks_to_event(&handover), 1);
        engine.tick(&handover);
        assert!((0..6).all(|pin| !pins.level(pin) || pin == 1 || pin == 4));
        assert_eq!(engine.ticks_to_event(&handover), u32::MAX);
    }

    #[test]
    fn homing_gives_up_without_an_index_mark() {
        let (pins, handover) = (FakePins::default(), Handover::new());
        let mut engine = engine(&pins);
        handover.give(Order::Home(Homing { ticks_per_step: 2, most_steps: 100, steps_to_zero: 5 }));
        for _ in 0..201 {
            engine.tick(&handover);
            assert_eq!(handover.take_report(), None);
        }
        for _ in 0..2 {
            engine.tick(&handover);
        }
        assert_eq!(handover.take_report(), Some(Report::IndexNotFound));
    }

    #[test]
    fn a_pin_that_fails_switches_everything_off() {
        let (pins, handover) = (FakePins::default(), Handover::new());
        let mut engine = engine(&pins);
        handover.give(Order::Lay(turn()));
        engine.tick(&handover);
        pins.fail(0);
        for _ in 0..1000 {
            engine.tick(&handover);
        }
        assert_eq!(handover.take_report(), Some(Report::Hardware));
        assert!(!pins.level(2) && !pins.level(5));
    }
}
