//! The cases of `tests/best_known.csv` and its lines: stratum, goal (radii), direction there, best known length (radii), word.

use core::f64::consts::TAU;
use core::fmt;

use nalgebra::Vector3;

use super::Problem;
use super::random::Random;

/// Cases of one kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stratum {
    /// Goals at 0.2 to 3 radii.
    Near,
    /// Goals at 3 to 4.5 radii: from 4 radii outwards no shortest curve is helicoidal.
    Middle,
    /// Goals at 4.5 to 32 radii.
    Far,
    /// Goals at 0.2 to 8 radii, in one plane with both directions.
    Coplanar,
}

impl Stratum {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Near, Self::Middle, Self::Far, Self::Coplanar];

    /// Its name in the table.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Near => "near",
            Self::Middle => "middle",
            Self::Far => "far",
            Self::Coplanar => "coplanar",
        }
    }

    /// The least and the greatest distance of a goal, radii.
    #[must_use]
    pub fn distances(self) -> (f64, f64) {
        match self {
            Self::Near => (0.2, 3.0),
            Self::Middle => (3.0, 4.5),
            Self::Far => (4.5, 32.0),
            Self::Coplanar => (0.2, 8.0),
        }
    }

    /// The case of this number: distances, and directions on the sphere (or the circle), are distributed uniformly.
    #[must_use]
    pub fn case(self, seed: u64, number: u64) -> Problem {
        let mut random = Random::new(&[seed, self as u64, number]);
        let (least, greatest) = self.distances();
        let distance = random.between(least, greatest);
        if self == Self::Coplanar {
            if let Some([x, z, tangent_x, tangent_z]) = SPECIAL.get(number as usize) {
                let problem = |x, z| Vector3::new(x, 0.0, z);
                return Problem { goal: problem(*x, *z), tangent: problem(*tangent_x, *tangent_z) };
            }
            // In the x-z plane, and in any other.
            let azimuth = if number.is_multiple_of(2) { 0.0 } else { random.between(0.0, TAU) };
            let mut direction = || {
                let (sin, cos) = libm::sincos(random.between(0.0, TAU));
                Vector3::new(sin * libm::cos(azimuth), sin * libm::sin(azimuth), cos)
            };
            return Problem { goal: direction() * distance, tangent: direction() };
        }
        Problem { goal: random.direction() * distance, tangent: random.direction() }
    }
}

/// Cases on a plane's or circle's edge: x and z of the goal, x and z of the direction there.
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
    /// The stratum's name.
    pub stratum: String,
    /// The case.
    pub problem: Problem,
    /// The least length known, radii.
    pub length: f64,
    /// The word of the curve of that length.
    pub word: String,
}

/// The names of the columns.
pub const COLUMNS: &str = "stratum,goal_x,goal_y,goal_z,tangent_x,tangent_y,tangent_z,length,word";

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Problem { goal, tangent } = self.problem;
        write!(f, "{},{:?},{:?},{:?}", self.stratum, goal.x, goal.y, goal.z)?;
        write!(f, ",{:?},{:?},{:?},{:?},{}", tangent.x, tangent.y, tangent.z, self.length, self.word)
    }
}

/// The lines of a table; comments begin with `#`.
///
/// # Panics
/// If the text is no such table.
#[must_use]
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
                word: fields[8].to_owned(),
            }
        })
        .collect()
}
