//! Checks that the search misses no path of arc, line, arc: paths are constructed, and the path that the search finds
//! to their ends must not be longer.
//!
//! The paths are drawn in regimes in which searches fail: tiny arcs, half turns, short lines, folds (where the path has
//! a singular Jacobian, so that two paths meet), and far goals. `GROWBOT_LAID` is the number of paths constructed in
//! each regime, 10,000 by default.
//!
//! ```sh
//! GROWBOT_LAID=1000000 cargo test --release -p growbot-core --test it constructed_csc_paths:: -- --nocapture
//! ```

use core::f64::consts::{PI, TAU};

use growbot_core::path::{Segment, end};
use growbot_core::pose::{Frame, tip_direction};
use growbot_core::random::Rng;
use growbot_core::shortest::PathProblem;
use growbot_core::shortest::csc::{Csc, paths};
use nalgebra::{Matrix5, Vector3, Vector5};

/// Max excess of the length of the path found over the constructed one, as a fraction and in radii. Goals are reached
/// to 1e-10.
const LONGER: (f64, f64) = (1e-6, 1e-9);
/// Max distance of a path's end from the goal, in radii and radians, within 100 radii. At larger distances it grows in
/// proportion.
const GOAL_TOLERANCE: f64 = 1e-9;

/// A constructed path of an arc, a line and an arc. Angles are in radians, lengths in radii.
#[derive(Debug, Clone, Copy)]
struct Laid {
    first_towards: f64,
    first: f64,
    line: f64,
    last_towards: f64,
    last: f64,
}

impl Laid {
    fn length(&self) -> f64 {
        self.first + self.line + self.last
    }

    /// Returns the position and the direction at the end of the path.
    fn end(&self) -> (Vector3<f64>, Vector3<f64>) {
        end_of(&Csc {
            first_bend_direction: self.first_towards,
            first_angle: self.first,
            straight: self.line,
            last_bend_direction: self.last_towards,
            last_angle: self.last,
        })
    }

    fn numbers(&mut self) -> [&mut f64; 5] {
        [&mut self.first_towards, &mut self.first, &mut self.line, &mut self.last_towards, &mut self.last]
    }

    /// Returns the determinant of the end's derivatives with respect to the five numbers. It is 0 where two paths meet.
    fn determinant(&self) -> f64 {
        const STEP: f64 = 1e-6;
        let (_, direction) = self.end();
        let other = if direction.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
        let across = direction.cross(&other).normalize();
        let both = [across, direction.cross(&across)];
        let columns: Vec<Vector5<f64>> = (0..5)
            .map(|index| {
                let moved = |step: f64| {
                    let mut laid = *self;
                    *laid.numbers()[index] += step;
                    laid.end()
                };
                let ((from, before), (to, after)) = (moved(-STEP), moved(STEP));
                let (position, turn) = ((to - from) / (2.0 * STEP), (after - before) / (2.0 * STEP));
                Vector5::new(position.x, position.y, position.z, turn.dot(&both[0]), turn.dot(&both[1]))
            })
            .collect();
        Matrix5::from_columns(&columns).determinant()
    }
}

fn end_of(path: &Csc) -> (Vector3<f64>, Vector3<f64>) {
    let arc = |towards: f64, bend: f64| Segment::Arc { alpha: towards + PI, bend, length: bend };
    let straight = Segment::Straight { length: path.straight };
    let tip = end(
        &[arc(path.first_bend_direction, path.first_angle), straight, arc(path.last_bend_direction, path.last_angle)],
        &Frame::identity(),
    );
    (tip.translation.vector, tip_direction(&tip))
}

/// Generator of random numbers and paths for the regimes.
struct Draw(Rng);

impl Draw {
    fn turn(&mut self) -> f64 {
        self.0.uniform_between(0.0, TAU)
    }

    fn even(&mut self, from: f64, to: f64) -> f64 {
        self.0.uniform_between(from, to)
    }

    /// Returns a number whose logarithm is uniform.
    fn log(&mut self, from: f64, to: f64) -> f64 {
        libm::exp(self.0.uniform_between(libm::log(from), libm::log(to)))
    }

    fn tiny(&mut self) -> f64 {
        self.log(1e-8, 0.3)
    }

    fn about(&mut self, angle: f64) -> f64 {
        let off = self.tiny();
        if self.0.uniform() < 0.5 { angle - off } else { angle + off }
    }

    fn laid(&mut self, first: f64, line: f64, last: f64) -> Laid {
        Laid { first_towards: self.turn(), first, line, last_towards: self.turn(), last }
    }

    /// Returns a path with a singular Jacobian whose line has a length between `from` and `to`.
    fn fold(&mut self, from: f64, to: f64) -> Laid {
        loop {
            let (first, last) = (self.turn(), self.turn());
            let laid = self.laid(first, from, last);
            // Two columns are linear in the length of the line, so the determinant is quadratic in it.
            let half = 0.5 * (to - from);
            let at = |line: f64| Laid { line, ..laid }.determinant();
            let [low, middle, high] = [at(from), at(from + half), at(to)];
            let (bend, slope) = (0.5 * (low + high) - middle, 0.5 * (high - low));
            let root = (slope * slope - 4.0 * bend * middle).sqrt();
            let product = -0.5 * (slope + root.copysign(slope));
            let lines: Vec<f64> = [product / bend, middle / product]
                .into_iter()
                .filter(|share| share.abs() < 1.0)
                .map(|share| from + half * (1.0 + share))
                .collect();
            if !lines.is_empty() {
                let line = lines[(self.0.uniform() * lines.len() as f64) as usize % lines.len()];
                return Laid { line, ..laid };
            }
        }
    }

    /// Returns a path for which the line along the start's direction and the line along the goal's direction cross, or
    /// nearly cross.
    fn crossing(&mut self) -> Laid {
        loop {
            let (first, last) = (self.turn(), self.turn());
            let line = -libm::tan(0.5 * first) - libm::tan(0.5 * last);
            if (0.0..40.0).contains(&line) {
                let off = self.log(1e-14, 1e-3);
                return self.laid(first, line + off, last);
            }
        }
    }
}

/// A kind of constructed paths.
struct Regime {
    name: &'static str,
    draw: fn(&mut Draw) -> Laid,
}

const fn all(name: &'static str, draw: fn(&mut Draw) -> Laid) -> Regime {
    Regime { name, draw }
}

const REGIMES: [Regime; 23] = [
    all("uniform, line 0 to 40", |draw| {
        let (first, line, last) = (draw.turn(), draw.even(0.0, 40.0), draw.turn());
        draw.laid(first, line, last)
    }),
    all("line 0 to 4", |draw| {
        let (first, line, last) = (draw.turn(), draw.even(0.0, 4.0), draw.turn());
        draw.laid(first, line, last)
    }),
    all("line 40 to 100", |draw| {
        let (first, line, last) = (draw.turn(), draw.even(40.0, 100.0), draw.turn());
        draw.laid(first, line, last)
    }),
    all("first tiny", |draw| {
        let (first, line, last) = (draw.tiny(), draw.even(0.0, 40.0), draw.turn());
        draw.laid(first, line, last)
    }),
    all("last tiny", |draw| {
        let (first, line, last) = (draw.turn(), draw.even(0.0, 40.0), draw.tiny());
        draw.laid(first, line, last)
    }),
    all("first tiny, last half a turn", |draw| {
        let (first, line, last) = (draw.tiny(), draw.even(0.0, 40.0), draw.about(PI));
        draw.laid(first, line, last)
    }),
    all("first half a turn, last tiny", |draw| {
        let (first, line, last) = (draw.about(PI), draw.even(0.0, 40.0), draw.tiny());
        draw.laid(first, line, last)
    }),
    all("both tiny", |draw| {
        let (first, line, last) = (draw.tiny(), draw.even(0.0, 40.0), draw.tiny());
        draw.laid(first, line, last)
    }),
    all("first half a turn", |draw| {
        let (first, line, last) = (draw.about(PI), draw.even(0.0, 40.0), draw.turn());
        draw.laid(first, line, last)
    }),
    all("both half a turn", |draw| {
        let (first, line, last) = (draw.about(PI), draw.even(0.0, 40.0), draw.about(PI));
        draw.laid(first, line, last)
    }),
    all("first a whole turn", |draw| {
        let (first, line, last) = (TAU - draw.tiny(), draw.even(0.0, 40.0), draw.turn());
        draw.laid(first, line, last)
    }),
    all("short lines", |draw| {
        let (first, line, last) = (draw.turn(), draw.tiny(), draw.turn());
        draw.laid(first, line, last)
    }),
    all("nearly in one plane", |draw| {
        let (first, line, last) = (draw.turn(), draw.even(0.0, 40.0), draw.turn());
        let laid = draw.laid(first, line, last);
        let off = draw.log(1e-12, 0.1);
        Laid { last_towards: laid.first_towards + if draw.0.uniform() < 0.5 { off } else { PI - off }, ..laid }
    }),
    all("any two or three of these", |draw| {
        let angle = |draw: &mut Draw| match (4.0 * draw.0.uniform()) as u32 {
            0 => draw.tiny(),
            1 => draw.about(PI),
            2 => TAU - draw.tiny(),
            _ => draw.turn(),
        };
        let line = match (3.0 * draw.0.uniform()) as u32 {
            0 => draw.tiny(),
            1 => draw.even(0.0, 4.0),
            _ => draw.even(0.0, 40.0),
        };
        let (first, last) = (angle(draw), angle(draw));
        draw.laid(first, line, last)
    }),
    all("line 100 to 10,000", |draw| {
        let (first, line, last) = (draw.turn(), draw.log(100.0, 1e4), draw.turn());
        draw.laid(first, line, last)
    }),
    all("line 10,000 to 1,000,000", |draw| {
        let (first, line, last) = (draw.turn(), draw.log(1e4, 1e6), draw.turn());
        draw.laid(first, line, last)
    }),
    all("folds", |draw| draw.fold(4.0, 40.0)),
    all("folds, near", |draw| draw.fold(0.0, 4.0)),
    all("last half a turn", |draw| {
        let (first, line, last) = (draw.turn(), draw.even(0.0, 40.0), draw.about(PI));
        draw.laid(first, line, last)
    }),
    all("last a whole turn", |draw| {
        let (first, line, last) = (draw.turn(), draw.even(0.0, 40.0), TAU - draw.tiny());
        draw.laid(first, line, last)
    }),
    all("both a whole turn", |draw| {
        let (first, line, last) = (TAU - draw.tiny(), draw.even(0.0, 40.0), TAU - draw.tiny());
        draw.laid(first, line, last)
    }),
    all("far behind", |draw| {
        let (first, line, last) = (draw.about(PI), draw.log(100.0, 1e4), draw.turn());
        draw.laid(first, line, last)
    }),
    all("lines through start and goal cross", Draw::crossing),
];

/// Counts and greatest deviation over all constructed paths of one regime.
#[derive(Default)]
struct Tally {
    laid: u32,
    missed: u32,
    without_a_path: u32,
    max_excess: f64,
    example: Option<(Laid, f64)>,
}

fn try_regime(regime: &Regime, number: u64, count: u32) -> Tally {
    let mut draw = Draw(Rng::new(&[16, number]));
    let mut tally = Tally { laid: count, ..Tally::default() };
    for _ in 0..tally.laid {
        let laid = (regime.draw)(&mut draw);
        let (goal, direction) = laid.end();
        let found = paths(&PathProblem::new(&goal, &direction));
        for path in &found {
            let (at, pointing) = end_of(path);
            let miss = (at - goal).norm().max((pointing - direction).norm());
            assert!(miss <= GOAL_TOLERANCE * (0.01 * goal.norm()).max(1.0), "{path:?} misses by {miss:e}: {laid:?}");
        }
        let best = found.first().map_or(f64::INFINITY, Csc::length);
        if best > laid.length() * (1.0 + LONGER.0) + LONGER.1 {
            tally.missed += 1;
            tally.without_a_path += u32::from(found.is_empty());
            tally.max_excess = tally.max_excess.max(best / laid.length() - 1.0);
            tally.example.get_or_insert((laid, best));
        }
    }
    tally
}

#[test]
fn constructed_paths_are_found() {
    let count = std::env::var("GROWBOT_LAID").map_or(10_000, |count| count.parse().expect("GROWBOT_LAID is a number"));
    let tallies: Vec<Tally> = std::thread::scope(|scope| {
        let running: Vec<_> = REGIMES
            .iter()
            .enumerate()
            .map(|(number, regime)| scope.spawn(move || try_regime(regime, number as u64, count)))
            .collect();
        running.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    println!("{:<34} {:>9} {:>7} {:>8} {:>10}", "regime", "laid", "missed", "no path", "max excess");
    for (Regime { name, .. }, tally) in REGIMES.iter().zip(&tallies) {
        let Tally { laid, missed, without_a_path, max_excess, .. } = tally;
        println!("{name:<34} {laid:>9} {missed:>7} {without_a_path:>8} {max_excess:>10.1e}");
    }
    for (Regime { name, .. }, tally) in REGIMES.iter().zip(&tallies) {
        assert_eq!(tally.missed, 0, "{name}: {:?}", tally.example);
    }
}
