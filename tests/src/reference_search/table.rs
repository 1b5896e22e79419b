//! The cases of `tests/best_known.csv` and its lines: stratum, goal (radii), direction there, best known length
//! (radii), path type.

use core::f64::consts::TAU;
use core::fmt;

use nalgebra::Vector3;

use super::{Piece, Problem, Tip, across};
use growbot_core::random::Rng;

/// Kind of cases in the table. A case is a goal with a direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stratum {
    /// Goals at 0.2 to 3 radii.
    Near,
    /// Goals at 3 to 4.5 radii. From 4 radii outwards no shortest curve is helicoidal.
    Middle,
    /// Goals at 4.5 to 32 radii.
    Far,
    /// Goals at 0.2 to 8 radii, in one plane with both directions.
    Coplanar,
    /// Like `Coplanar`, but goal and direction are moved out of the plane by 0.1 to 1e-7.
    NearlyCoplanar,
    /// Ends of arc, line, arc whose line has a negative length of 0.3 to 3e-4 radii. In most cases the shortest curve
    /// to such an end is a helicoidal arc that turns from one circle to another within about this length.
    Narrow,
}

impl Stratum {
    /// All strata.
    pub const ALL: [Self; 6] =
        [Self::Near, Self::Middle, Self::Far, Self::Coplanar, Self::NearlyCoplanar, Self::Narrow];

    /// Returns the name of the stratum in the table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Near => "near",
            Self::Middle => "middle",
            Self::Far => "far",
            Self::Coplanar => "coplanar",
            Self::NearlyCoplanar => "nearly-coplanar",
            Self::Narrow => "narrow",
        }
    }

    /// Returns the case with this number, drawn with this seed. Distances are distributed uniformly, and so are
    /// directions on the sphere or circle.
    pub fn case(self, seed: u64, number: u64) -> Problem {
        let mut random = Rng::new(&[seed, self as u64, number]);
        match self {
            Self::Near => anywhere(random.uniform_between(0.2, 3.0), &mut random),
            Self::Middle => anywhere(random.uniform_between(3.0, 4.5), &mut random),
            Self::Far => anywhere(random.uniform_between(4.5, 32.0), &mut random),
            Self::Coplanar => match SPECIAL.get(number as usize) {
                Some([x, z, tangent_x, tangent_z]) => {
                    Problem { goal: Vector3::new(*x, 0.0, *z), tangent: Vector3::new(*tangent_x, 0.0, *tangent_z) }
                }
                None => in_a_plane(number, &mut random),
            },
            Self::NearlyCoplanar => {
                let Problem { goal, tangent } = in_a_plane(number, &mut random);
                let off = libm::pow(10.0, random.uniform_between(-7.0, -1.0));
                let mut beside = || random.normal_vector() * off;
                Problem { goal: goal + beside(), tangent: (tangent + beside()).normalize() }
            }
            Self::Narrow => {
                let first = Piece::Arc { axis: Vector3::x(), angle: random.uniform_between(0.3, 4.5) };
                let corner = first.walk(&Tip::start());
                let (sin, cos) = libm::sincos(random.uniform_between(0.0, TAU));
                let (side, other) = across(&corner.tangent);
                let last = Piece::Arc { axis: side * cos + other * sin, angle: random.uniform_between(0.3, 4.5) };
                let line = Piece::Line { length: -libm::pow(10.0, random.uniform_between(-3.5, -0.5)) };
                let Tip { position, tangent } = last.walk(&line.walk(&corner));
                Problem { goal: position, tangent: tangent.normalize() }
            }
        }
    }
}

fn anywhere(distance: f64, random: &mut Rng) -> Problem {
    Problem { goal: random.direction() * distance, tangent: random.direction() }
}

/// Returns a case in the x-z plane, or in another plane if the number is odd.
fn in_a_plane(number: u64, random: &mut Rng) -> Problem {
    let distance = random.uniform_between(0.2, 8.0);
    let azimuth = if number.is_multiple_of(2) { 0.0 } else { random.uniform_between(0.0, TAU) };
    let mut direction = || {
        let (sin, cos) = libm::sincos(random.uniform_between(0.0, TAU));
        Vector3::new(sin * libm::cos(azimuth), sin * libm::sin(azimuth), cos)
    };
    Problem { goal: direction() * distance, tangent: direction() }
}

/// Special cases in one plane, such as goals straight ahead, straight behind or on a turning circle: x and z of the
/// goal (radii), x and z of the direction there.
const SPECIAL: [[f64; 4]; 12] = [
    [0.0, 5.0, 0.0, 1.0],
    [0.0, -5.0, 0.0, 1.0],
    [0.0, 5.0, 0.0, -1.0],
    [0.0, -5.0, 0.0, -1.0],
    [0.0, -1.0, 0.0, 1.0],
    [0.0, 1.0, 0.0, -1.0],
    [2.0, 0.0, 0.0, -1.0],
    [1.0, 1.0, 1.0, 0.0],
    [2.0, 0.0, 0.0, 1.0],
    [4.0, 0.0, 0.0, -1.0],
    [4.0, 0.0, 0.0, 1.0],
    [0.0, 1.0, 1.0, 0.0],
];

/// A line of the table.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Name of the stratum.
    pub stratum: String,
    /// The case.
    pub problem: Problem,
    /// Best known length, radii.
    pub length: f64,
    /// Path type of the curve of that length.
    pub path_type: String,
}

/// Names of the columns.
pub const COLUMNS: &str = "stratum,goal_x,goal_y,goal_z,tangent_x,tangent_y,tangent_z,length,path_type";

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Problem { goal, tangent } = self.problem;
        write!(f, "{},{:?},{:?},{:?}", self.stratum, goal.x, goal.y, goal.z)?;
        write!(f, ",{:?},{:?},{:?},{:?},{}", tangent.x, tangent.y, tangent.z, self.length, self.path_type)
    }
}

/// Returns the lines of a table. Lines that begin with `#` are comments.
///
/// # Panics
/// Panics if the text is not a valid table.
pub fn read(text: &str) -> Vec<Row> {
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    assert_eq!(lines.next(), Some(COLUMNS), "the first line names the columns");
    lines
        .map(|line| {
            let fields: Vec<&str> = line.split(',').collect();
            assert_eq!(fields.len(), 9, "{line}");
            let number = |index: usize| -> f64 { fields[index].parse().unwrap_or_else(|_| panic!("{line}")) };
            Row {
                stratum: fields[0].to_owned(),
                problem: Problem {
                    goal: Vector3::new(number(1), number(2), number(3)),
                    tangent: Vector3::new(number(4), number(5), number(6)),
                },
                length: number(7),
                path_type: fields[8].to_owned(),
            }
        })
        .collect()
}
