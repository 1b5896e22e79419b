//! Plastic by angle, turn by turn.
//!
//! Between two feed steps one step's volume flows, evenly in time, and lies wherever the head stood meanwhile. Over a turn the
//! sum gives the mean height and the first harmonic the tilt: `h = sum`, `r_t phi = 2 |sum e^(i psi)|`, in units of the
//! height that one step spread over the whole ring would have.

use growbot_core::angle::wrap_positive;
use growbot_core::layer::Layer;
use growbot_core::robot::Robot;

/// An amount of plastic, or of time, and its first harmonic.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Moments {
    sum: f64,
    cosine: f64,
    sine: f64,
}

impl Moments {
    /// Whether all of it lies on the tip's x axis: the edge of a turn, not a turn.
    fn is_edge(&self) -> bool {
        // Sums of the same numbers, so equal to the last bit.
        self.cosine >= self.sum
    }

    fn add(&mut self, other: Self, factor: f64) {
        self.sum += factor * other.sum;
        self.cosine += factor * other.cosine;
        self.sine += factor * other.sine;
    }
}

/// What belongs to one turn of the head.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Ring {
    turn: i64,
    moments: Moments,
}

/// The ring of a turn, which is the last one or comes after it.
fn ring_of(rings: &mut Vec<Ring>, turn: i64) -> &mut Moments {
    // A turn ends with the head on the axis, half of which counts to it: the ring may be the last but one.
    let at = rings.iter().rposition(|ring| ring.turn == turn).unwrap_or_else(|| {
        rings.push(Ring { turn, moments: Moments::default() });
        rings.len() - 1
    });
    &mut rings[at].moments
}

/// All plastic laid.
#[derive(Debug, Clone)]
pub(super) struct Plastic {
    steps_per_turn: i64,
    /// Cosine and sine of each head step.
    directions: Vec<(f64, f64)>,
    head: i64,
    /// When the head or the feed last stepped, ticks.
    stepped: u64,
    /// Where the head stood at the last feed step; none before the first.
    fed: Option<i64>,
    /// Where the head has stood since then, weighed by time.
    stood: Vec<Ring>,
    laid: Vec<Ring>,
}

impl Plastic {
    pub fn new(robot: &Robot, head: i64) -> Self {
        let steps = robot.description().head.steps_per_turn;
        let directions = (0..steps).map(|step| {
            let (sine, cosine) = libm::sincos(f64::from(step) / f64::from(steps) * std::f64::consts::TAU);
            (cosine, sine)
        });
        Self {
            steps_per_turn: i64::from(steps),
            directions: directions.collect(),
            head,
            stepped: 0,
            fed: None,
            stood: Vec::new(),
            laid: Vec::new(),
        }
    }

    /// The head steps to a position at this tick.
    pub fn turn_to(&mut self, head: i64, tick: u64) {
        self.stand(tick);
        self.head = head;
    }

    /// Notes how long the head has stood. On the tip's x axis, where one turn ends and the next begins, half of the time
    /// counts to either.
    fn stand(&mut self, tick: u64) {
        let time = tick.saturating_sub(self.stepped) as f64;
        self.stepped = tick;
        if time == 0.0 {
            return;
        }
        let (turn, step) = (self.head.div_euclid(self.steps_per_turn), self.head.rem_euclid(self.steps_per_turn));
        let (cosine, sine) = self.directions[step as usize];
        let moments = Moments { sum: 1.0, cosine, sine };
        if step == 0 {
            ring_of(&mut self.stood, turn - 1).add(moments, 0.5 * time);
            ring_of(&mut self.stood, turn).add(moments, 0.5 * time);
        } else {
            ring_of(&mut self.stood, turn).add(moments, time);
        }
    }

    /// The feed steps at this tick: what flowed since its last step lies where the head stood.
    pub fn lay(&mut self, tick: u64) {
        self.stand(tick);
        let time: f64 = self.stood.iter().map(|ring| ring.moments.sum).sum();
        // With a whole turn since the last step, as after homing, nothing flowed; this one begins.
        let flowed = self.fed.is_some_and(|fed| self.head - fed < self.steps_per_turn) && time > 0.0;
        if flowed {
            for stood in &self.stood {
                ring_of(&mut self.laid, stood.turn).add(stood.moments, 1.0 / time);
            }
        } else {
            let (cosine, sine) = self.directions[self.head.rem_euclid(self.steps_per_turn) as usize];
            let turn = self.head.div_euclid(self.steps_per_turn);
            ring_of(&mut self.laid, turn).add(Moments { sum: 1.0, cosine, sine }, 1.0);
        }
        self.stood.clear();
        self.fed = Some(self.head);
    }

    /// The feed steps without effect: nothing flowed.
    pub fn pass(&mut self, tick: u64) {
        self.stand(tick);
        self.stood.clear();
        self.fed = None;
    }

    /// The turns as layers, that under way included.
    pub fn layers(&self, robot: &Robot) -> Vec<Layer> {
        let mut layers: Vec<Moments> = Vec::new();
        // An edge belongs to the turn that it opens, and at the very end to the one that it closes.
        let mut edge = Moments::default();
        for ring in &self.laid {
            edge.add(ring.moments, 1.0);
            if !ring.moments.is_edge() {
                layers.push(std::mem::take(&mut edge));
            }
        }
        match layers.last_mut() {
            Some(last) => last.add(edge, 1.0),
            None if edge.sum > 0.0 => layers.push(edge),
            None => {}
        }
        layers.iter().map(|moments| layer(moments, robot)).collect()
    }
}

fn layer(plastic: &Moments, robot: &Robot) -> Layer {
    let height_of_step = 1.0 / robot.feed_steps_per_length();
    Layer {
        alpha: wrap_positive(libm::atan2(plastic.sine, plastic.cosine)),
        height: plastic.sum * height_of_step,
        tilt: 2.0 * height_of_step * libm::hypot(plastic.cosine, plastic.sine) / robot.tip_radius(),
    }
}
