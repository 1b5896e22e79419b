//! The step engine, which the step interrupt runs tick by tick. It computes with integers only.
//!
//! The steps of both axes are spread evenly over the ticks of a sector: see `bresenham`. The ticks of a turn are
//! virtual: see `ramp`.
//!
//! A step pulse is raised in one tick and lowered in the next, so that it is high for a tick and low for at least one.
//! A direction changes while no pulse is high, at least one tick before the next pulse.
//!
//! [`Engine::ticks_to_event`] and [`Engine::skip`] let a simulation skip ticks in which no pin changes. The result is
//! the same as with every tick.

use embedded_hal::digital::{InputPin, OutputPin};
use growbot_core::layer::SECTORS;
use growbot_core::robot::Robot;

use super::axis_move::AxisMoveRun;
use super::bresenham::Bresenham;
use super::direction::MotorDirection;
use super::homing::HomingRun;
use super::index_monitor::{IndexMonitor, IndexWindow, read_index_sensor};
use super::mailbox::{Mailbox, PendingMove, PendingReport, Slot, TurnHeader};
use super::moves::EngineFault;
use super::ramp::VirtualClock;
use super::stepper::{Stepper, StepperPins};
use super::turn::Sector;
use crate::hal::Outputs;

/// Inputs of the step engine. Levels are logical.
pub struct EngineInputs<I, M, S> {
    /// Input that is high while the index sensor detects its mark.
    pub index: I,
    /// Input of the filament's encoder. Without an encoder it is a pin that never changes.
    pub filament_motion: M,
    /// Input that is high while the emergency stop is pressed.
    pub emergency_stop: S,
}

/// The part of a robot's description that the step engine needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EngineConfig {
    mark: IndexWindow,
    emergency_stop: bool,
    /// Number of feed steps without a pulse of the filament's encoder beyond which the filament counts as jammed.
    /// `u32::MAX` without an encoder.
    jam_steps: u32,
}

impl EngineConfig {
    /// Returns the configuration of the step engine for a robot.
    pub fn for_robot(robot: &Robot) -> Self {
        let description = robot.description();
        let sensors = &description.sensors;
        Self {
            mark: IndexWindow::of(robot),
            emergency_stop: sensors.emergency_stop.is_some(),
            jam_steps: sensors
                .filament_motion
                .map_or(u32::MAX, |motion| libm::rint(motion.jam_mm * description.feed.steps_per_mm) as u32),
        }
    }
}

/// The move that the step engine makes now.
enum Mode {
    Idle,
    Homing(HomingRun),
    Feeding(AxisMoveRun),
    Rotating(AxisMoveRun),
    /// A layer is laid in one turn of the head. [`Engine::turn`] is the header of the turn, and [`Engine::progress`]
    /// its progress.
    Laying,
    /// Everything is off after an alarm. No move begins until the controller requests a halt, which also drops a
    /// pending move.
    Alarmed,
}

/// Progress of the current turn of the head.
struct TurnProgress {
    /// Index of the current sector, in the order of increasing angles of the head.
    sector: usize,
    sectors_left: usize,
    /// Number of remaining virtual ticks of the current sector. `turn_left` is the number for the whole turn.
    sector_left: u32,
    turn_left: u32,
    head: Bresenham,
    feed: Bresenham,
    /// Number of steps that the head has made in the turn. `feed_made` is the number that the feed has made in the
    /// sector.
    head_made: u32,
    feed_made: u32,
}

impl TurnProgress {
    const NONE: Self = Self {
        sector: 0,
        sectors_left: 0,
        sector_left: 0,
        turn_left: 0,
        head: Bresenham::NONE,
        feed: Bresenham::NONE,
        head_made: 0,
        feed_made: 0,
    };
}

/// The step engine that drives head and feed. A robot has one, and the step interrupt calls it in each tick.
pub struct Engine<HS, HD, HE, FS, FD, FE, I, M, S, O> {
    head: Stepper<HS, HD, HE>,
    feed: Stepper<FS, FD, FE>,
    inputs: EngineInputs<I, M, S>,
    outputs: O,
    settings: EngineConfig,
    mode: Mode,
    turn: TurnHeader,
    progress: TurnProgress,
    /// Slot of the mailbox in which the feed steps of the current turn are counted.
    made: Slot,
    clock: VirtualClock,
    watch: IndexMonitor,
    ticks: u32,
    filament_pulses: u32,
    filament_high: bool,
    /// Number of monitored feed steps since the latest pulse of the filament's encoder.
    feed_steps_without_pulse: u32,
}

impl<HS, HD, HE, FS, FD, FE, I, M, S, O> Engine<HS, HD, HE, FS, FD, FE, I, M, S, O>
where
    HS: OutputPin,
    HD: OutputPin,
    HE: OutputPin,
    FS: OutputPin,
    FD: OutputPin,
    FE: OutputPin,
    I: InputPin,
    M: InputPin,
    S: InputPin,
    O: Outputs,
{
    /// Creates an idle engine, with both stepper drivers off. `outputs` are all outputs of the tip, which an emergency
    /// stop or an alarm switches off.
    pub fn new(
        head: StepperPins<HS, HD, HE>,
        feed: StepperPins<FS, FD, FE>,
        inputs: EngineInputs<I, M, S>,
        outputs: O,
        settings: EngineConfig,
    ) -> Self {
        let mut engine = Self {
            head: Stepper::new(head),
            feed: Stepper::new(feed),
            inputs,
            outputs,
            settings,
            mode: Mode::Idle,
            turn: TurnHeader::NONE,
            progress: TurnProgress::NONE,
            made: Slot::A,
            clock: VirtualClock::AT_REST,
            watch: IndexMonitor::LOST,
            ticks: 0,
            filament_pulses: 0,
            filament_high: true,
            feed_steps_without_pulse: 0,
        };
        engine.head.disable();
        engine.feed.disable();
        engine
    }

    /// Runs one tick of the step interrupt.
    pub fn tick(&mut self, handover: &Mailbox) {
        self.ticks = self.ticks.wrapping_add(1);
        handover.set_ticks(self.ticks);
        if let Err(alarm) = self.watch_and_advance(handover) {
            self.release(handover);
            self.mode = Mode::Alarmed;
            self.outputs.make_safe();
            handover.post_alarm(alarm);
        }
    }

    /// Returns the number of ticks up to and including the next tick that does more than count itself: it makes a step,
    /// begins a sector or a move, changes the speed, or halts. `u32::MAX` if nothing happens without a new move.
    pub fn ticks_to_event(&self, handover: &Mailbox) -> u32 {
        if self.head.raised || self.feed.raised || handover.is_halt_requested() || handover.is_link_stop_pending() {
            return 1;
        }
        match &self.mode {
            Mode::Idle if handover.can_begin_move() => 1,
            Mode::Idle | Mode::Alarmed => u32::MAX,
            Mode::Homing(run) => run.ticks_to_step.max(1),
            Mode::Feeding(run) | Mode::Rotating(run) => run.ticks_to_step.max(1),
            Mode::Laying => {
                let progress = &self.progress;
                let steady = self.clock.steady_ticks(&self.turn.pace, progress.turn_left, handover.next_entry_rate());
                let steps = progress.head.ticks_to_step().min(progress.feed.ticks_to_step());
                progress.sector_left.min(steps).min(steady).max(1)
            }
        }
    }

    /// Skips ticks that do no more than count. The number of skipped ticks must be below [`Engine::ticks_to_event`].
    pub fn skip(&mut self, ticks: u32) {
        self.ticks = self.ticks.wrapping_add(ticks);
        match &mut self.mode {
            Mode::Idle if ticks > 0 => self.clock = VirtualClock::AT_REST,
            Mode::Idle | Mode::Alarmed => {}
            Mode::Homing(run) => run.ticks_to_step -= ticks,
            Mode::Feeding(run) | Mode::Rotating(run) => run.ticks_to_step -= ticks,
            Mode::Laying => {
                self.progress.sector_left -= ticks;
                self.progress.turn_left -= ticks;
                self.progress.head.skip(ticks);
                self.progress.feed.skip(ticks);
            }
        }
    }

    fn release(&mut self, handover: &Mailbox) {
        self.mode = Mode::Idle;
        handover.set_sector(&Sector::default());
        self.clock = VirtualClock::AT_REST;
        self.watch = IndexMonitor::LOST;
        self.feed_steps_without_pulse = 0;
        self.head.disable();
        self.feed.disable();
    }

    fn watch_and_advance(&mut self, handover: &Mailbox) -> Result<(), EngineFault> {
        let halted = handover.take_halt_request();
        self.count_filament(handover)?;
        let stopped = self.check_emergency_stop(halted, handover)?;
        if stopped || halted {
            self.release(handover);
            if stopped {
                // The step interrupt itself switches the outputs off, because the main loop may hang while the heater
                // is on.
                self.outputs.make_safe();
            }
            return Ok(());
        }
        self.advance(handover)
    }

    fn count_filament(&mut self, handover: &Mailbox) -> Result<(), EngineFault> {
        let high = self.inputs.filament_motion.is_high().map_err(|_| EngineFault::Hardware)?;
        let before = core::mem::replace(&mut self.filament_high, high);
        if high && !before {
            self.feed_steps_without_pulse = 0;
        }
        // Filament that moves while it is changed does not count as growth.
        if matches!(&self.mode, Mode::Feeding(run) if run.changes_filament) {
            return Ok(());
        }
        // The encoder's level rises in forward motion at the position at which it falls in reverse motion.
        self.filament_pulses = match (before, high, self.feed.direction == Some(MotorDirection::Backward)) {
            (false, true, false) => self.filament_pulses.wrapping_add(1),
            (true, false, true) => self.filament_pulses.wrapping_sub(1),
            _ => return Ok(()),
        };
        handover.set_filament_pulses(self.filament_pulses);
        Ok(())
    }

    /// Returns whether the emergency stop is pressed, or was received over the link. The engine latches even a very
    /// short emergency stop for the controller.
    fn check_emergency_stop(&mut self, halted: bool, handover: &Mailbox) -> Result<bool, EngineFault> {
        let pressed =
            self.settings.emergency_stop && self.inputs.emergency_stop.is_high().map_err(|_| EngineFault::Hardware)?;
        let stopped = handover.take_link_stop() || pressed;
        if stopped {
            handover.latch_emergency_stop();
            if handover.has_move() {
                handover.discard_move();
            }
        } else if halted {
            handover.set_emergency_stop(false);
        }
        Ok(stopped)
    }

    fn advance(&mut self, handover: &Mailbox) -> Result<(), EngineFault> {
        self.head.lower()?;
        self.feed.lower()?;
        if matches!(self.mode, Mode::Idle) {
            if !handover.can_begin_move() {
                self.clock = VirtualClock::AT_REST;
                return read_index_sensor(&mut self.inputs.index, handover).map(|_| ());
            }
            if handover.is_emergency_stopped() {
                // The stop is released, but the controller has not handled it yet.
                handover.discard_move();
            }
            let Some(task) = handover.take_move() else { return Ok(()) };
            if !self.begin(task, handover)? {
                return Ok(());
            }
        }
        match &mut self.mode {
            Mode::Idle | Mode::Alarmed => Ok(()),
            Mode::Homing(run) => {
                if run.tick(&mut self.head, &mut self.inputs.index, &self.settings.mark, handover)? {
                    self.watch.homed(&self.settings.mark);
                    self.finish(PendingReport::Homed, handover);
                }
                Ok(())
            }
            Mode::Feeding(run) => {
                if run.is_watched_step() {
                    self.feed_steps_without_pulse = self.feed_steps_without_pulse.saturating_add(1);
                    if self.feed_steps_without_pulse > self.settings.jam_steps {
                        return Err(EngineFault::FilamentJam);
                    }
                }
                if run.tick(&mut self.feed)? {
                    self.finish(PendingReport::Fed, handover);
                }
                Ok(())
            }
            Mode::Rotating(run) => {
                // The move reads the sensor, but it does not check for a missing mark. The homing before the next layer
                // does.
                read_index_sensor(&mut self.inputs.index, handover)?;
                if run.tick(&mut self.head)? {
                    self.finish(PendingReport::Rotated, handover);
                }
                Ok(())
            }
            Mode::Laying => self.lay(handover),
        }
    }

    /// Begins a move. Returns whether the move makes its first tick at once. A turn does so if it follows another turn
    /// in the same direction.
    fn begin(&mut self, task: PendingMove, handover: &Mailbox) -> Result<bool, EngineFault> {
        match task {
            PendingMove::Home(homing) => {
                self.head.enable(MotorDirection::Forward)?;
                self.watch = IndexMonitor::LOST;
                self.mode = Mode::Homing(HomingRun::new(homing));
                Ok(false)
            }
            PendingMove::Feed(order) => {
                self.feed.enable(order.direction)?;
                if order.changes_filament {
                    self.feed_steps_without_pulse = 0;
                }
                self.mode = Mode::Feeding(AxisMoveRun::new(order));
                Ok(false)
            }
            PendingMove::Rotate(order) => {
                self.head.enable(order.direction)?;
                self.watch = IndexMonitor::LOST;
                self.mode = Mode::Rotating(AxisMoveRun::new(order));
                Ok(false)
            }
            PendingMove::Lay(turn) => {
                let (head, feed) = (self.head.enable(turn.direction)?, self.feed.enable(MotorDirection::Forward)?);
                let follows = !(self.clock.is_at_rest() || head || feed);
                self.turn = turn;
                self.clock.enter(&self.turn.pace);
                self.watch.begin_turn(self.turn.direction);
                self.progress.head_made = 0;
                self.progress.turn_left = self.turn.ticks;
                self.progress.sectors_left = SECTORS;
                handover.set_progress(0);
                self.mode = Mode::Laying;
                self.start_sector(if turn.direction == MotorDirection::Forward { 0 } else { SECTORS - 1 }, handover);
                Ok(follows)
            }
        }
    }

    /// Ends the current move and reports its end to the controller.
    fn finish(&mut self, report: PendingReport, handover: &Mailbox) {
        self.mode = Mode::Idle;
        handover.set_sector(&Sector::default());
        handover.post_report(report);
    }

    fn start_sector(&mut self, index: usize, handover: &Mailbox) {
        let Some(sector) = handover.sector(&self.turn, index) else { return };
        handover.set_sector(&sector);
        let Sector { ticks, head_steps: head, feed_steps: feed } = sector;
        self.progress.sector = index;
        self.progress.sector_left = ticks;
        self.progress.head = Bresenham::new(head, ticks);
        self.progress.feed = Bresenham::new(feed, ticks);
        self.progress.feed_made = 0;
    }

    fn lay(&mut self, handover: &Mailbox) -> Result<(), EngineFault> {
        let progress = &mut self.progress;
        if !self.clock.tick(&self.turn.pace, progress.turn_left, handover.next_entry_rate()) {
            return Ok(());
        }
        if progress.head.tick() {
            progress.head_made += 1;
            let on = read_index_sensor(&mut self.inputs.index, handover)?;
            self.watch.step(on, &self.settings.mark)?;
            self.head.raise()?;
        }
        if progress.feed.tick() {
            progress.feed_made += 1;
            self.feed.raise()?;
            self.feed_steps_without_pulse = self.feed_steps_without_pulse.saturating_add(1);
            if self.feed_steps_without_pulse > self.settings.jam_steps {
                return Err(EngineFault::FilamentJam);
            }
        }
        progress.turn_left -= 1;
        progress.sector_left -= 1;
        if progress.sector_left == 0 {
            handover.store_feed_steps(self.made, progress.sector, progress.feed_made);
            progress.sectors_left -= 1;
            handover.set_progress(SECTORS - progress.sectors_left);
            if progress.sectors_left > 0 {
                let is_forward = self.turn.direction == MotorDirection::Forward;
                let sector = progress.sector;
                self.start_sector(if is_forward { sector + 1 } else { sector.wrapping_sub(1) }, handover);
            } else {
                self.watch.end_turn()?;
                handover.end_progress();
                let slot = self.made;
                self.made = slot.other();
                self.finish(PendingReport::Laid { slot, head: self.progress.head_made }, handover);
            }
        }
        Ok(())
    }
}
