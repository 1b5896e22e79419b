//! The filament between spool and nozzle: its position, its end, and the encoder that it turns.

use growbot_core::robot::Robot;
use growbot_firmware::stepping::MotorDirection;

/// Effect of a feed step on the filament.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FeedResult {
    /// The filament was pushed out, so a step's volume flows.
    Extruded,
    /// The filament was pushed forward into the space that retraction left.
    Refilled,
    /// The filament was retracted.
    Retracted,
    /// The filament did not move.
    Blocked,
}

/// The filament between spool and nozzle. Lengths and positions are in feed steps.
#[derive(Debug, Clone)]
pub(super) struct SimulatedFilament {
    steps_per_mm: f64,
    /// Half the length of filament from one rising edge of the encoder to the next. `None` without an encoder.
    half_pulse: Option<f64>,
    /// Position of the filament: the feed steps that have moved it, forwards minus backwards.
    position: i64,
    /// Length of filament by which the encoder has turned.
    turned: f64,
    /// Level of the encoder. It is read in each tick, but only changed by a step.
    level: bool,
    /// Range of `turned` in which the encoder's level stays the same.
    level_span: [f64; 2],
    /// Foremost position that the filament has reached. Filament that moves beyond this position is extruded.
    front: i64,
    /// Position at which the filament ends.
    end: i64,
    /// Length of filament on a full spool, mm.
    spool: f64,
}

impl SimulatedFilament {
    /// Creates the filament of a full spool.
    pub fn new(robot: &Robot) -> Self {
        let description = robot.description();
        let steps_per_mm = description.feed.steps_per_mm;
        let mut filament = Self {
            steps_per_mm,
            half_pulse: description.sensors.filament_motion.map(|motion| 0.5 * motion.mm_per_pulse * steps_per_mm),
            position: 0,
            turned: 0.0,
            level: false,
            level_span: [0.0; 2],
            front: 0,
            end: 0,
            spool: description.filament.spool_mm,
        };
        filament.refill();
        filament.turn(0.0);
        filament
    }

    /// Sets the remaining length of filament to that of a full spool.
    pub fn refill(&mut self) {
        self.set_left(self.spool);
    }

    /// Sets the remaining length of filament, mm.
    pub fn set_left(&mut self, mm: f64) {
        self.end = self.position + libm::rint(mm * self.steps_per_mm) as i64;
    }

    /// Returns the remaining length of filament, mm.
    pub fn left(&self) -> f64 {
        (self.end - self.position) as f64 / self.steps_per_mm
    }

    /// Reports whether any filament remains.
    pub fn is_there(&self) -> bool {
        self.position < self.end
    }

    /// Reports whether a step forwards would push filament out of the nozzle, because no retracted filament is left.
    pub fn is_at_front(&self) -> bool {
        self.position == self.front
    }

    /// Takes the filament out of the nozzle, so that nothing stops it.
    pub fn release(&mut self) {
        self.front = i64::MAX;
    }

    /// Puts the filament into the nozzle at its present position.
    pub fn insert(&mut self) {
        self.front = self.position;
    }

    /// Moves the filament by a step of the feed. `seen` is the distance, in feed steps, by which the encoder turns if
    /// the step pushes filament out of the nozzle.
    pub fn step(&mut self, direction: MotorDirection, seen: f64) -> FeedResult {
        if direction == MotorDirection::Backward {
            self.position -= 1;
            self.turn(-1.0);
            return FeedResult::Retracted;
        }
        if !self.is_there() {
            return FeedResult::Blocked;
        }
        self.position += 1;
        if self.position <= self.front {
            self.turn(1.0);
            return FeedResult::Refilled;
        }
        self.turn(seen);
        self.front = self.position;
        FeedResult::Extruded
    }

    fn turn(&mut self, steps: f64) {
        self.turned += steps;
        let [from, to] = self.level_span;
        if let Some(half) = self.half_pulse
            && !(from < self.turned && self.turned < to)
        {
            // Half pulses from the start are even where the level is high.
            let halves = libm::floor(self.turned / half);
            self.level = halves as i64 % 2 == 0;
            // Rounding may decide close to the ends, so they are excluded.
            self.level_span = [halves + 1e-6, halves + 1.0 - 1e-6].map(|halves| halves * half);
        }
    }

    /// Returns the length of filament by which the encoder has turned, feed steps.
    pub fn turned(&self) -> f64 {
        self.turned
    }

    /// Returns a lower bound of the number of whole steps of the feed until the encoder's level may change, including
    /// the step of the change.
    pub fn steps_to_edge(&self) -> u32 {
        let [from, to] = self.level_span;
        if self.half_pulse.is_none() { u32::MAX } else { (self.turned - from).min(to - self.turned).max(1.0) as u32 }
    }

    /// Returns the level of the encoder.
    pub fn encoder(&self) -> bool {
        self.level
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filament() -> SimulatedFilament {
        SimulatedFilament::new(&growbot_plan::robot_file::load("growbot-a".as_ref()).unwrap())
    }

    #[test]
    fn the_encoder_rises_once_for_each_pulse_length() {
        let mut filament = filament();
        let (mut rises, mut before) = (0, filament.encoder());
        // 90 steps a mm, 1.25 mm a pulse: 112.5 steps.
        for _ in 0..1125 {
            assert_eq!(filament.step(MotorDirection::Forward, 1.0), FeedResult::Extruded);
            rises += u32::from(filament.encoder() && !before);
            before = filament.encoder();
        }
        assert_eq!(rises, 10);
    }

    #[test]
    fn retracted_filament_is_refilled_first() {
        let mut filament = filament();
        filament.step(MotorDirection::Forward, 1.25);
        assert_eq!(
            [filament.step(MotorDirection::Backward, 1.25), filament.step(MotorDirection::Backward, 1.25)],
            [FeedResult::Retracted, FeedResult::Retracted]
        );
        assert_eq!(
            [(); 3].map(|()| filament.step(MotorDirection::Forward, 1.25)),
            [FeedResult::Refilled, FeedResult::Refilled, FeedResult::Extruded]
        );
        assert_eq!(filament.turned(), 2.5, "only what goes out slips");
    }

    #[test]
    fn filament_runs_out() {
        let mut filament = filament();
        assert!((filament.left() - 330_000.0).abs() < 1e-6);
        filament.set_left(0.1);
        assert_eq!((0..20).filter(|_| filament.step(MotorDirection::Forward, 1.0) == FeedResult::Extruded).count(), 9);
        assert!(!filament.is_there());
        filament.step(MotorDirection::Backward, 1.0);
        assert!(filament.is_there());
    }
}
