//! Seeds for the refinement, from a grid over the two numbers at the neck.
//!
//! Each curve of the grid is integrated once. Every pair of its points is an arc, and the arcs whose ends lie to each
//! other nearly as start and goal do are the seeds.

use core::mem;

use heapless::Vec;
use nalgebra::Vector3;

use super::neck::{Neck, Point, before_if};
use super::refine::Seed;
use crate::shortest::{Problem, insert_behind, move_last_behind};

/// Step of the grid along the curve, radii. Trial: 11 misses; with 0.3 and 0.6 there are 14 and 18.
const GRID_STEP: f64 = 0.4;
/// Max number of steps by which an arc may end before the neck or begin after it. Trial: with 2 and 8 there are 13
/// misses.
const OUTSIDE: usize = 5;
/// Max number of steps of an arc: the max length of an arc, [`super::MAX_LENGTH`], in steps of [`GRID_STEP`].
const MAX_STEPS: usize = 21;
/// Points on each side of the neck.
const SIDE: usize = MAX_STEPS + OUTSIDE;
/// Points of a curve: both sides and the neck.
const POINTS: usize = 2 * SIDE + 1;
/// The grid's axis over the logarithm of the narrowness. Trial: with 10 and 40 cells there are 22 and 10 misses,
/// and 15 with cells of this width from -12 on.
const NARROWNESS: Axis = Axis { from: -9.5, to: 1.2, count: 20 };
/// The grid's axis over the logarithm of the twist. Trial: with 6 and 22 cells there are 16 and 13 misses.
const TWIST: Axis = Axis { from: -2.5, to: 1.9, count: 11 };
/// Max number of seeds. Those that fit best are retained. Trial: with 40 and 160 there are 18 and 10 misses; more
/// cost time.
const MAX_SEEDS: usize = 80;
/// Max misfit of a seed (square of radii and radians). Trial: with 0.2 there are 12 misses, with 1.8 as many as
/// with 0.6.
const MAX_MISFIT: f32 = 0.6;
/// Max difference of the logarithms of narrowness for two seeds to count as one. Trial: with half of this, of
/// [`SAME_TWIST`] and of [`SAME_LENGTH`], there are 22 misses, with twice as much as many as now.
const SAME_NARROWNESS: f32 = 0.6;
/// Max difference of the logarithms of twist for two seeds to count as one; tried with [`SAME_NARROWNESS`].
const SAME_TWIST: f32 = 0.5;
/// Max difference of each length, before and after the neck (radii), for two seeds to count as one; tried with
/// [`SAME_NARROWNESS`].
const SAME_LENGTH: f32 = 0.5;

/// An axis of the grid: cells of equal width, each with its value in the middle.
struct Axis {
    from: f64,
    to: f64,
    count: u32,
}

impl Axis {
    fn at(&self, index: u32) -> f64 {
        self.from + (self.to - self.from) * (f64::from(index) + 0.5) / f64::from(self.count)
    }
}

/// The seeds found so far.
pub(super) type Seeds = Vec<GridSeed, MAX_SEEDS>;

/// Removes and returns the shortest seed. The last seed moves to its place.
pub(super) fn pop_shortest(seeds: &mut Seeds) -> Option<GridSeed> {
    let (last, others) = seeds.split_last_mut()?;
    if let Some(shortest) = others.iter_mut().min_by(|a, b| a.length().total_cmp(&b.length()))
        && shortest.length() <= last.length()
    {
        mem::swap(shortest, last);
    }
    seeds.pop()
}

/// A seed from the grid, in few bytes: see [`Seed`].
#[derive(Debug, Clone, Copy)]
pub(super) struct GridSeed {
    narrowness: f32,
    twist: f32,
    mirrored: bool,
    before: f32,
    after: f32,
    /// Square of the misfit.
    misfit: f32,
}

impl GridSeed {
    fn length(&self) -> f32 {
        self.before + self.after
    }

    pub(super) fn seed(&self) -> Seed {
        let Self { narrowness, twist, mirrored, before, after, .. } = *self;
        Seed {
            narrowness: narrowness.into(),
            twist: twist.into(),
            mirrored,
            before: before.into(),
            after: after.into(),
        }
    }
}

/// How start and goal lie to each other, in numbers that the roll does not change. Single precision is enough for a
/// grid, and the microcontroller has hardware for it.
pub(super) struct Grid {
    distance_square: f32,
    along_start: f32,
    along_goal: f32,
    cosine: f32,
    /// The triple product of the start's direction, the offset and the goal's direction: 0 if they lie in one plane.
    handedness: f64,
}

/// A point of a curve of the grid.
#[derive(Debug, Clone, Copy, Default)]
struct GridPoint {
    position: [f32; 3],
    direction: [f32; 3],
}

impl From<Point> for GridPoint {
    fn from(Point { position, direction }: Point) -> Self {
        let single = |vector: Vector3<f64>| [vector.x as f32, vector.y as f32, vector.z as f32];
        Self { position: single(position), direction: single(direction) }
    }
}

impl Grid {
    pub(super) fn new(problem: &Problem) -> Self {
        let (goal, direction) = (&problem.goal, &problem.direction);
        Self {
            distance_square: goal.norm_squared() as f32,
            along_start: goal.z as f32,
            along_goal: goal.dot(direction) as f32,
            cosine: direction.z as f32,
            handedness: goal.x * direction.y - goal.y * direction.x,
        }
    }

    pub(super) fn seeds(&self, longest: f64, seeds: &mut Seeds, keep_alive: &mut dyn FnMut()) {
        for row in 0..NARROWNESS.count {
            for column in 0..TWIST.count {
                let (narrowness, twist) = (NARROWNESS.at(row), TWIST.at(column));
                let neck = Neck { narrowness: libm::exp(narrowness), twist: libm::exp(twist) };
                // With less twist `|m|` would have its max here.
                if neck.twist * neck.twist >= neck.narrowness * (neck.narrowness - 1.0) {
                    self.search(&neck, narrowness, twist, longest, seeds);
                    keep_alive();
                }
            }
        }
    }

    /// Points of a curve, from before the neck to after it.
    fn points(&self, neck: &Neck) -> [GridPoint; POINTS] {
        let mut points = [GridPoint::default(); POINTS];
        let mut point = Point { position: Vector3::zeros(), direction: Vector3::z() };
        for index in 0..=SIDE {
            for (before, at) in [(false, SIDE + index), (true, SIDE - index)] {
                if let Some(place) = points.get_mut(at) {
                    *place = before_if(before, &point).into();
                }
            }
            point = if index == 0 {
                neck.walk(point, 0.0, GRID_STEP)
            } else {
                neck.step(&neck.step(&point, 0.5 * GRID_STEP), 0.5 * GRID_STEP)
            };
        }
        points
    }

    /// Finds the arcs of one curve that fit better than their neighbours.
    #[inline(never)]
    fn search(&self, neck: &Neck, narrowness: f64, twist: f64, longest: f64, seeds: &mut Seeds) {
        let points = self.points(neck);
        let steps = ((longest / GRID_STEP) as usize).min(MAX_STEPS);
        let mut rows = [[f32::INFINITY; MAX_STEPS + 2]; 3];
        // Arcs by first point and number of steps. A row is judged once the next row is known.
        for next in 0..POINTS {
            // Not `rotate_left`, which needs 1.5 kB of a microcontroller's flash.
            rows.swap(0, 1);
            rows.swap(1, 2);
            rows[2] = self.misfits(points.get(next..).unwrap_or_default(), steps);
            let Some(first) = next.checked_sub(1) else { continue };
            let [row_before, row, row_after] = &rows;
            let beside = row_before.windows(3).zip(row.windows(3)).zip(row_after.windows(3));
            for (length, beside) in (1..=steps).zip(beside) {
                let ((&[_, a, b], &[c, misfit, d]), &[e, f, _]) = beside else { continue };
                if misfit > MAX_MISFIT || [a, b, c, d, e, f].iter().any(|other| *other < misfit) {
                    continue;
                }
                let (Some(start), Some(end)) = (points.get(first), points.get(first + length)) else { continue };
                let handedness = handedness(start, end);
                let twisted = 0.3 * (handedness.abs() - self.handedness.abs());
                let before = (SIDE as f64 - first as f64) * GRID_STEP;
                let seed = GridSeed {
                    narrowness: narrowness as f32,
                    twist: twist as f32,
                    mirrored: handedness * self.handedness < 0.0,
                    before: before as f32,
                    after: (length as f64 * GRID_STEP - before) as f32,
                    misfit: misfit + (twisted * twisted) as f32,
                };
                keep(seeds, seed);
                // Near a plane either handedness may lead to the goal.
                if self.handedness.abs() < 0.1 || handedness.abs() < 0.1 {
                    keep(seeds, GridSeed { mirrored: !seed.mirrored, ..seed });
                }
            }
        }
    }

    /// The misfits of all arcs that begin at the first of these points, by number of steps.
    fn misfits(&self, points: &[GridPoint], steps: usize) -> [f32; MAX_STEPS + 2] {
        let mut misfits = [f32::INFINITY; MAX_STEPS + 2];
        let Some((start, ends)) = points.split_first() else { return misfits };
        let (&[x0, y0, z0], &[a0, b0, c0]) = (&start.position, &start.direction);
        let per_distance = 1.0 / (1.0 + self.distance_square);
        for (misfit, end) in misfits.iter_mut().skip(1).take(steps).zip(ends) {
            let (&[x, y, z], &[a, b, c]) = (&end.position, &end.direction);
            let (dx, dy, dz) = (x - x0, y - y0, z - z0);
            let distance = dx * dx + dy * dy + dz * dz - self.distance_square;
            let along_start = dx * a0 + dy * b0 + dz * c0 - self.along_start;
            let along_goal = dx * a + dy * b + dz * c - self.along_goal;
            let cosine = a0 * a + b0 * b + c0 * c - self.cosine;
            *misfit = distance * distance * per_distance * 0.5
                + along_start * along_start
                + along_goal * along_goal
                + cosine * cosine;
        }
        misfits
    }
}

/// As the field `handedness` of [`Grid`], for two points of a curve.
fn handedness(start: &GridPoint, end: &GridPoint) -> f64 {
    let double = |&[x, y, z]: &[f32; 3]| Vector3::new(f64::from(x), f64::from(y), f64::from(z));
    let offset = double(&end.position) - double(&start.position);
    double(&start.direction).dot(&offset.cross(&double(&end.direction)))
}

/// Adds a seed if it is among the best. Of seeds next to each other only the best stays.
fn keep(seeds: &mut Seeds, seed: GridSeed) {
    let beside = |other: &GridSeed| {
        other.mirrored == seed.mirrored
            && (other.narrowness - seed.narrowness).abs() < SAME_NARROWNESS
            && (other.twist - seed.twist).abs() < SAME_TWIST
            && (other.before - seed.before).abs() < SAME_LENGTH
            && (other.after - seed.after).abs() < SAME_LENGTH
    };
    let fits_better = |other: &GridSeed| other.misfit <= seed.misfit;
    let up_to_other = seeds.iter().position(beside).and_then(|other| seeds.get_mut(..=other));
    if let Some(up_to_other) = up_to_other {
        if let Some(other) = up_to_other.last_mut()
            && !fits_better(other)
        {
            *other = seed;
            move_last_behind(up_to_other, fits_better);
        }
    } else {
        insert_behind(seeds, seed, fits_better);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seed(before: f32, misfit: f32) -> GridSeed {
        GridSeed { narrowness: 0.0, twist: 0.0, mirrored: false, before, after: 1.0, misfit }
    }

    fn collected(seeds: impl IntoIterator<Item = GridSeed>) -> Seeds {
        let mut collected = Seeds::new();
        for seed in seeds {
            keep(&mut collected, seed);
        }
        collected
    }

    #[test]
    fn of_seeds_next_to_each_other_the_best_stays() {
        let retained = collected([seed(0.0, 0.3), seed(2.0, 0.2), seed(0.1, 0.1), seed(0.2, 0.4)]);
        assert_eq!(retained.iter().map(|seed| seed.misfit).collect::<std::vec::Vec<_>>(), [0.1, 0.2]);
    }

    #[test]
    fn the_best_seeds_are_retained() {
        let all = (0..2 * MAX_SEEDS).map(|n| seed(n as f32, 1.0 - 0.001 * n as f32));
        let retained = collected(all);
        assert_eq!(retained.len(), MAX_SEEDS);
        assert!(retained.iter().all(|seed| seed.before >= MAX_SEEDS as f32));
        assert!(retained.is_sorted_by(|a, b| a.misfit <= b.misfit));
    }

    #[test]
    fn seeds_are_removed_by_length() {
        let mut seeds = collected([seed(3.0, 0.1), seed(1.0, 0.2), seed(4.0, 0.3), seed(2.0, 0.4)]);
        let lengths: std::vec::Vec<_> =
            core::iter::from_fn(|| pop_shortest(&mut seeds)).map(|seed| seed.length()).collect();
        assert_eq!(lengths, [2.0, 3.0, 4.0, 5.0]);
    }
}
