//! The plastic that the tip lays, summed over the angle of the head for each layer.
//!
//! Between two feed steps one step's volume flows, evenly in time, and is laid along the positions of the head in that
//! time. Over a sweep of the head the sum gives the mean height and the first harmonic the tilt: `h = sum`,
//! `r_t phi = 2 |sum e^(i psi)|`, in units of the height that one step spread over the whole ring would have.
//!
//! A layer is a sweep from one visit of the tip's x axis to the next, in either direction of the head. If the head
//! turns back elsewhere, because it has lost steps, a layer ends there. A sweep of less than half a turn is not a layer
//! and belongs to the next.

use growbot_core::angle::wrap_positive;
use growbot_core::layer::Layer;
use growbot_core::pose::Frame;
use growbot_core::robot::Robot;
use growbot_core::simulation::ErrorModel;
use growbot_firmware::stepping::MotorDirection;

/// An amount of plastic (or of time) summed over one turn of the head, and its first Fourier coefficients (cosine,
/// sine) over the head angle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Moments {
    sum: f64,
    cosine: f64,
    sine: f64,
}

impl Moments {
    /// Returns true if the whole amount lies on the tip's x axis. Such plastic is the edge of a layer, and not a layer
    /// by itself.
    fn is_edge(&self) -> bool {
        // On the x axis, `cosine` and `sum` are sums of the same numbers, so they are equal to the last bit.
        self.cosine >= self.sum
    }

    fn add(&mut self, other: Self, factor: f64) {
        self.sum += factor * other.sum;
        self.cosine += factor * other.cosine;
        self.sine += factor * other.sine;
    }
}

/// Plastic that was laid in one sweep of the head (see the module's description).
#[derive(Debug, Clone, Copy, PartialEq)]
struct Ring {
    sweep: u64,
    moments: Moments,
}

/// Returns the plastic of a sweep. Adds an empty ring if the sweep is new.
fn ring_of(rings: &mut Vec<Ring>, sweep: u64) -> &mut Moments {
    // A sweep ends with the head on the axis, and half of the plastic there belongs to that sweep, so its ring may be
    // the last but one.
    let at = rings.iter().rposition(|ring| ring.sweep <= sweep).filter(|at| rings[*at].sweep == sweep);
    let at = at.unwrap_or_else(|| {
        rings.push(Ring { sweep, moments: Moments::default() });
        rings.len() - 1
    });
    &mut rings[at].moments
}

/// Assembles layers from consecutive rings of plastic.
#[derive(Debug, Clone, Default)]
struct LayerAssembler {
    /// Plastic on the tip's x axis that belongs to the layer that begins there.
    edge: Moments,
}

impl LayerAssembler {
    /// Adds a ring of plastic. Returns the layer that the ring completes, or `None` if the ring is only the edge of a
    /// layer.
    fn next(&mut self, ring: &Ring) -> Option<Moments> {
        self.edge.add(ring.moments, 1.0);
        (!ring.moments.is_edge()).then(|| std::mem::take(&mut self.edge))
    }
}

/// The body that consists of the rings that no longer change.
#[derive(Debug, Clone)]
struct SettledBody {
    rings: usize,
    layers: LayerAssembler,
    start_from_tip: Frame,
    /// Index of the next layer.
    index: u64,
}

impl SettledBody {
    fn add(&mut self, ring: &Ring, robot: &Robot, imperfection: &ErrorModel) {
        if let Some(moments) = self.layers.next(ring) {
            self.start_from_tip *= imperfection.lay(self.index, &layer(&moments, robot)).step();
            self.index += 1;
        }
    }
}

/// All plastic that the tip has laid.
#[derive(Debug, Clone)]
pub(super) struct Plastic {
    steps_per_turn: i64,
    /// Cosine and sine of the head's angle at each step of a turn.
    directions: Vec<(f64, f64)>,
    /// Position of the head in its turn, steps from the tip's x axis, below `directions.len()`.
    head: usize,
    /// Direction of the head's latest step.
    direction: MotorDirection,
    /// Number of sweeps of the head so far.
    sweep: u64,
    /// Number of head steps in the current sweep.
    swept: i64,
    /// Time of the latest step of head or feed, ticks.
    stepped: u64,
    /// True if filament is retracted, so that nothing flows.
    held_back: bool,
    /// Number of head steps since the latest feed step. `None` before the first feed step.
    since_fed: Option<i64>,
    /// Positions of the head since the latest feed step, weighted by time.
    stood: Vec<Ring>,
    laid: Vec<Ring>,
    /// Number of layers whose sweep is finished.
    swept_layers: u64,
    grown: SettledBody,
    settled: SettledLayers,
}

/// The layers whose plastic no longer changes.
#[derive(Debug, Clone, Default)]
struct SettledLayers {
    rings: usize,
    layers: LayerAssembler,
    came_out: Vec<Layer>,
    twist: f64,
}

impl SettledLayers {
    fn add(&mut self, moments: &Moments, robot: &Robot, imperfection: &ErrorModel) {
        let laid = imperfection.lay(self.came_out.len() as u64, &layer(moments, robot));
        let alpha = wrap_positive(laid.layer.alpha + self.twist);
        self.twist += laid.twist;
        self.came_out.push(Layer { alpha, ..laid.layer });
    }
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
            head: head.rem_euclid(i64::from(steps)) as usize,
            direction: MotorDirection::Forward,
            sweep: 0,
            // The first visit of the axis begins a layer.
            swept: i64::from(steps),
            stepped: 0,
            held_back: false,
            since_fed: None,
            stood: Vec::new(),
            laid: Vec::new(),
            swept_layers: 0,
            grown: SettledBody {
                rings: 0,
                layers: LayerAssembler::default(),
                start_from_tip: Frame::identity(),
                index: 0,
            },
            settled: SettledLayers::default(),
        }
    }

    /// Makes a step of the head at this tick.
    pub fn turn(&mut self, direction: MotorDirection, tick: u64) {
        self.stand(tick);
        if self.sweep_is_whole() && (self.is_on_axis() || direction != self.direction) {
            let is_layer = |ring: &&Ring| ring.sweep == self.sweep && !ring.moments.is_edge();
            self.swept_layers += self.laid.iter().rev().take(2).find(is_layer).map_or(0, |_| 1);
            self.sweep += 1;
            self.swept = 0;
        }
        self.direction = direction;
        let steps = self.directions.len();
        self.head = match (direction, self.head) {
            (MotorDirection::Forward, head) => {
                if head + 1 == steps {
                    0
                } else {
                    head + 1
                }
            }
            (MotorDirection::Backward, head) => head.checked_sub(1).unwrap_or(steps - 1),
        };
        self.swept += 1;
        self.since_fed = self.since_fed.map(|steps| steps + 1);
    }

    fn is_on_axis(&self) -> bool {
        self.head == 0
    }

    /// Returns true if the current sweep is long enough to be a layer: at least half a turn. Shorter sweeps result from
    /// lost steps.
    fn sweep_is_whole(&self) -> bool {
        self.swept >= self.steps_per_turn / 2
    }

    /// Records the time for which the head has been at its present position. On the tip's x axis one layer ends and the
    /// next begins, so half of the time counts for each of the two layers.
    fn stand(&mut self, tick: u64) {
        let time = tick.saturating_sub(self.stepped) as f64;
        self.stepped = self.stepped.max(tick);
        if time == 0.0 || self.held_back {
            return;
        }
        let (cosine, sine) = self.directions[self.head];
        let moments = Moments { sum: 1.0, cosine, sine };
        if self.is_on_axis() && self.sweep_is_whole() {
            ring_of(&mut self.stood, self.sweep).add(moments, 0.5 * time);
            ring_of(&mut self.stood, self.sweep + 1).add(moments, 0.5 * time);
        } else {
            ring_of(&mut self.stood, self.sweep).add(moments, time);
        }
    }

    /// Makes a step of the feed at this tick. The plastic that flowed since the previous feed step is laid at the
    /// positions where the head has been since.
    pub fn lay(&mut self, tick: u64) {
        self.stand(tick);
        let time: f64 = self.stood.iter().map(|ring| ring.moments.sum).sum();
        // After a whole turn since the latest step, as after homing, nothing flowed, and this step begins.
        let flowed = self.since_fed.is_some_and(|steps| steps < self.steps_per_turn) && time > 0.0;
        if flowed {
            for stood in &self.stood {
                ring_of(&mut self.laid, stood.sweep).add(stood.moments, 1.0 / time);
            }
        } else {
            let (cosine, sine) = self.directions[self.head];
            let begins = self.is_on_axis() && self.sweep_is_whole();
            let sweep = self.sweep + u64::from(begins);
            // Rings are in order, and half of the plastic that flows here next belongs to the sweep that ends.
            ring_of(&mut self.laid, self.sweep);
            ring_of(&mut self.laid, sweep).add(Moments { sum: 1.0, cosine, sine }, 1.0);
        }
        self.stood.clear();
        self.since_fed = Some(0);
    }

    /// Records a feed step that laid nothing, because no filament flowed.
    pub fn pass(&mut self, tick: u64) {
        self.stand(tick);
        self.stood.clear();
        self.since_fed = None;
    }

    /// Records that filament is retracted (nothing flows) or has come forward again.
    pub fn hold_back(&mut self, held_back: bool, tick: u64) {
        self.stand(tick);
        self.held_back = held_back;
    }

    /// Returns the index of the current or next layer.
    pub fn layer_index(&self) -> u64 {
        self.swept_layers
    }

    /// Returns the layers as they were really laid, including the one in progress. Their twist is contained in the
    /// deposition angles of the following layers, so the layers chain to the same body although the returned layers
    /// have no twist.
    pub fn layers(&self, robot: &Robot, imperfection: &ErrorModel) -> Vec<Layer> {
        let mut layers = LayerAssembler::default();
        let mut all: Vec<Moments> = self.laid.iter().filter_map(|ring| layers.next(ring)).collect();
        // At the very end an edge belongs to the layer that it closes.
        match all.last_mut() {
            Some(last) => last.add(layers.edge, 1.0),
            None if layers.edge.sum > 0.0 => all.push(layers.edge),
            None => {}
        }
        let mut settled = SettledLayers::default();
        all.iter().for_each(|moments| settled.add(moments, robot, imperfection));
        settled.came_out
    }

    /// Returns the layers whose plastic can no longer change.
    pub fn settled(&mut self, robot: &Robot, imperfection: &ErrorModel) -> &[Layer] {
        // Only the last two rings still change. An edge at the very end may belong to the layer before it.
        let settled = &mut self.settled;
        let end = self.laid.len().saturating_sub(3);
        for ring in self.laid.get(settled.rings..end).unwrap_or_default() {
            if let Some(moments) = settled.layers.next(ring) {
                settled.add(&moments, robot, imperfection);
            }
        }
        settled.rings = settled.rings.max(end);
        &settled.came_out
    }

    /// Returns the pose of the tip in the frame of the start of growth, including the layer in progress.
    pub fn start_from_tip(&mut self, robot: &Robot, imperfection: &ErrorModel) -> Frame {
        // Only the last two rings still change.
        let grown = &mut self.grown;
        let settled = self.laid.len().saturating_sub(2);
        for ring in self.laid.get(grown.rings..settled).unwrap_or_default() {
            grown.add(ring, robot, imperfection);
        }
        grown.rings = grown.rings.max(settled);
        let mut present = grown.clone();
        for ring in self.laid.get(grown.rings..).unwrap_or_default() {
            present.add(ring, robot, imperfection);
        }
        present.start_from_tip
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
