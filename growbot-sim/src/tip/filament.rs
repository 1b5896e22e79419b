//! The filament between spool and nozzle: how far it has come, where it ends, and the encoder that it turns.

use growbot_core::robot::Robot;

/// What a feed step has done to the filament.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Moved {
    /// Pushed out: that much flows.
    Out,
    /// Pushed forward, to fill what was pulled back before.
    Filled,
    /// Pulled back.
    Back,
    /// Not at all.
    Not,
}

/// The filament. Lengths are feed steps.
#[derive(Debug, Clone)]
pub(super) struct Filament {
    steps_per_mm: f64,
    /// Half of what passes from one rising edge of the encoder to the next; none without an encoder.
    half_pulse: Option<f64>,
    /// How far it has come, as far as the feed's steps tell.
    position: i64,
    /// How far it has turned the encoder.
    turned: f64,
    /// The encoder's level: asked for in each tick, and only changed by a step.
    level: bool,
    /// Between these two ends of `turned` the level is the same.
    level_span: [f64; 2],
    /// How far it has been at most: beyond, it flows.
    front: i64,
    /// Where it ends.
    end: i64,
}

impl Filament {
    /// A full spool.
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
        };
        filament.set_left(description.filament.spool_mm);
        filament.turn(0.0);
        filament
    }

    /// From now on there is so much left, mm.
    pub fn set_left(&mut self, mm: f64) {
        self.end = self.position + libm::rint(mm * self.steps_per_mm) as i64;
    }

    /// What is left, mm.
    pub fn left(&self) -> f64 {
        (self.end - self.position) as f64 / self.steps_per_mm
    }

    /// Whether there is any.
    pub fn is_there(&self) -> bool {
        self.position < self.end
    }

    /// Whether a step forwards would push it out.
    pub fn is_at_front(&self) -> bool {
        self.position == self.front
    }

    /// Is taken out of the nozzle, so that nothing stops it; or its end rests where it is.
    pub fn free(&mut self, free: bool) {
        self.front = if free { i64::MAX } else { self.position };
    }

    /// A step of the feed that takes it along. Where that pushes it out the encoder sees so much of it.
    pub fn step(&mut self, forwards: bool, seen: f64) -> Moved {
        if !forwards {
            self.position -= 1;
            self.turn(-1.0);
            return Moved::Back;
        }
        if !self.is_there() {
            return Moved::Not;
        }
        self.position += 1;
        if self.position <= self.front {
            self.turn(1.0);
            return Moved::Filled;
        }
        self.turn(seen);
        self.front = self.position;
        Moved::Out
    }

    fn turn(&mut self, steps: f64) {
        self.turned += steps;
        let [from, to] = self.level_span;
        if let Some(half) = self.half_pulse
            && !(from < self.turned && self.turned < to)
        {
            // Half pulses from the start are even where it is high.
            let halves = libm::floor(self.turned / half);
            self.level = halves as i64 % 2 == 0;
            // Close to the ends rounding decides, so they stay outside.
            self.level_span = [halves + 1e-6, halves + 1.0 - 1e-6].map(|halves| halves * half);
        }
    }

    /// How far it has turned the encoder, steps.
    pub fn turned(&self) -> f64 {
        self.turned
    }

    /// So many whole steps there are at least until the encoder's level may change, that step included.
    pub fn steps_to_edge(&self) -> u32 {
        let [from, to] = self.level_span;
        if self.half_pulse.is_none() { u32::MAX } else { (self.turned - from).min(to - self.turned).max(1.0) as u32 }
    }

    /// The level of the encoder.
    pub fn encoder(&self) -> bool {
        self.level
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filament() -> Filament {
        Filament::new(&growbot_client::robot_file::load("growbot-a".as_ref()).unwrap())
    }

    #[test]
    fn the_encoder_rises_once_for_each_pulse_length() {
        let mut filament = filament();
        let (mut rises, mut before) = (0, filament.encoder());
        // 90 steps a mm, 1.25 mm a pulse: 112.5 steps.
        for _ in 0..1125 {
            assert_eq!(filament.step(true, 1.0), Moved::Out);
            rises += u32::from(filament.encoder() && !before);
            before = filament.encoder();
        }
        assert_eq!(rises, 10);
    }

    #[test]
    fn what_was_pulled_back_is_filled_first() {
        let mut filament = filament();
        filament.step(true, 1.25);
        assert_eq!([filament.step(false, 1.25), filament.step(false, 1.25)], [Moved::Back, Moved::Back]);
        assert_eq!([(); 3].map(|()| filament.step(true, 1.25)), [Moved::Filled, Moved::Filled, Moved::Out]);
        assert_eq!(filament.turned(), 2.5, "only what goes out slips");
    }

    #[test]
    fn it_comes_to_an_end() {
        let mut filament = filament();
        assert!((filament.left() - 330_000.0).abs() < 1e-6);
        filament.set_left(0.1);
        assert_eq!((0..20).filter(|_| filament.step(true, 1.0) == Moved::Out).count(), 9);
        assert!(!filament.is_there());
        filament.step(false, 1.0);
        assert!(filament.is_there());
    }
}
