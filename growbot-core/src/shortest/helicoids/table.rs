//! Seeds from a table of arcs. The chosen arcs are those whose ends have most nearly the same relative pose as start
//! and goal.
//!
//! The table was made from goals drawn at random, beginning with an empty table. If the search did not find an arc that
//! was found from thousands of seeds, the arc was added to the table.

use heapless::Vec;

use super::invariants::Invariants;
use super::seed::Seed;
use crate::shortest::ordered_list::insert_behind;

/// Number of arcs of the table that are tried as seeds. In a trial with a table of 24 arcs and 6,000 goals within 3.6
/// radii, the search missed the shortest path of 8 goals with 8 seeds, of 4 goals with 10, and of 3 goals with 12.
const NEAREST: usize = 10;

/// An arc of the table.
struct TableEntry {
    seed: Seed<f32>,
    /// The relative pose of the arc's start and end, in the numbers of [`Invariants::numbers`].
    invariants: [f32; 5],
}

/// Creates an entry of the table. The first argument holds the logarithms of narrowness and twist, and the phases of
/// start and end.
const fn arc([narrowness, twist, start, end]: [f32; 4], mirrored: bool, invariants: [f32; 5]) -> TableEntry {
    TableEntry { seed: Seed { narrowness, twist, mirrored, start, end, uses_circles: false }, invariants }
}

/// Returns the arcs of the table whose invariants are nearest to those of the problem, nearest first.
pub(super) fn nearest(query: &Invariants) -> impl Iterator<Item = Seed<f32>> + use<> {
    let mut nearest = Vec::<(f32, &'static TableEntry), NEAREST>::new();
    for entry in ARCS.iter() {
        let distance = query.distance(&entry.invariants);
        insert_behind(&mut nearest, (distance, entry), |other| other.0 <= distance);
    }
    let (reversed, mirrored) = (query.reversed, query.mirrored);
    nearest.into_iter().map(move |(_, TableEntry { seed, .. })| {
        let (start, end) = if reversed { (-seed.end, -seed.start) } else { (seed.start, seed.end) };
        Seed { start, end, mirrored: seed.mirrored != mirrored, ..*seed }
    })
}

static ARCS: [TableEntry; 32] = [
    arc([-3.675, -0.297, -0.925, 7.074], true, [-0.124, -0.326, -0.512, 0.441, 0.298]),
    arc([-14.353, -0.759, -1.126, 7.002], true, [0.279, -0.243, -0.583, 0.216, 0.000]),
    arc([-21.291, -0.676, -0.922, 6.586], true, [0.063, -0.538, -0.019, 0.379, 0.000]),
    arc([-0.842, 0.974, -2.345, 6.309], true, [2.559, -0.987, -0.424, 1.817, 0.265]),
    arc([-5.442, -1.534, -0.755, 2.861], true, [1.865, 0.038, -0.655, 1.591, 0.387]),
    arc([-4.733, -1.275, -0.799, 5.199], true, [0.149, -1.005, -0.393, 0.729, 0.144]),
    arc([0.221, 0.092, -1.853, 6.514], false, [2.116, 1.421, 1.201, 1.953, 0.312]),
    arc([0.412, -1.285, -3.426, 3.414], true, [0.290, 0.285, 1.224, 1.048, 0.347]),
    arc([-4.195, -0.189, -1.746, 7.889], true, [0.341, 0.043, -1.090, 0.490, 0.036]),
    arc([-3.441, -1.205, -1.553, 1.782], true, [1.710, 1.418, 0.756, 1.735, 0.978]),
    arc([0.002, -0.949, -1.944, 4.850], true, [0.662, 0.372, 1.281, 1.274, 0.038]),
    arc([0.174, 0.197, -1.222, 7.213], true, [1.868, 1.694, 1.295, 1.854, 0.000]),
    arc([0.901, -0.406, -4.497, 0.104], true, [1.161, 0.696, -0.073, 1.527, 1.176]),
    arc([-1.861, -0.629, -1.286, 6.822], true, [1.041, 0.596, 0.771, 0.745, 0.123]),
    arc([-1.186, 1.236, -1.649, 4.929], true, [1.955, -0.601, -0.798, 1.649, 0.592]),
    arc([-7.630, -3.276, -0.371, 0.589], true, [0.866, 0.834, 1.177, 0.622, 0.047]),
    arc([-5.049, -0.078, -3.385, 3.601], false, [1.187, 0.426, 1.274, 2.731, 0.069]),
    arc([0.730, -0.569, -5.843, 0.620], true, [1.486, 0.612, 1.028, 1.953, 0.932]),
    arc([2.191, 2.410, -3.691, 4.308], true, [1.947, 1.760, 1.261, 2.103, 0.377]),
    arc([1.945, 2.846, -1.904, 4.670], true, [1.939, 0.642, 0.407, 1.742, 1.037]),
    arc([1.097, -0.211, -4.587, 3.964], true, [1.838, 1.198, 0.992, 1.733, 0.737]),
    arc([0.433, -0.763, -4.332, 0.400], true, [0.256, 0.040, -0.304, 1.502, 1.448]),
    arc([-0.420, 0.831, -1.777, 7.238], true, [1.987, 0.813, 0.490, 1.629, 0.784]),
    arc([1.973, 0.375, -4.113, 3.599], true, [0.918, 0.346, -0.116, 1.525, 1.345]),
    arc([-4.817, -1.652, -1.370, 2.040], true, [2.169, 1.127, 0.759, 1.840, 0.838]),
    arc([0.168, 1.706, -1.990, 2.584], true, [1.733, 1.428, 0.904, 1.444, 0.540]),
    arc([-4.014, -0.911, -0.417, 4.773], true, [-0.478, -1.030, -0.604, 1.074, 0.221]),
    arc([0.140, 1.651, -2.234, 6.617], true, [2.536, 0.016, 0.109, 1.859, 0.531]),
    arc([-2.419, 1.118, -1.749, 3.317], true, [2.356, 0.856, 0.445, 1.665, 0.211]),
    arc([-4.430, -0.540, -1.625, 7.583], true, [0.379, -0.179, -1.148, 0.352, 0.000]),
    arc([-18.752, 1.049, -2.339, 7.720], true, [2.087, 0.006, -0.507, 1.589, 0.000]),
    arc([-18.223, -7.476, -0.616, 2.891], true, [1.890, -0.266, -0.846, 1.611, 0.180]),
];
