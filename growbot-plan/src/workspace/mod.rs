//! Goals within reach of a body of a given length.
//!
//! Positions are given in the frame of the start: axial, along the direction of growth, and lateral. For any final
//! direction, everything is symmetric around the start's direction, and the shortest body to a position has a closed
//! form ([`shortest_to`]). The planner computes the share of final directions within reach. For a given final
//! direction, the planner computes everything. Collisions of a body with itself are not checked.
//!
//! The share of final directions, and everything with a given direction, is planned on coarse grids. Planning to near
//! goals takes longest, and a grid has a few thousand of them. Through a scene, [`POSITIONS`] goals spread evenly in
//! the ball are planned to and counted by result. A search there may end without a result, so a picture of a grid would
//! have to guess. The picture has filled contours (marching squares).

mod anywhere;
mod in_scene;
mod json;

use std::f64::consts::{FRAC_PI_2, PI, TAU};

pub use anywhere::shortest_to;
use growbot_core::path;
use growbot_core::plan::{PlanError, Planner, plan};
use growbot_core::pose::{Frame, Pose};
use growbot_core::robot::Robot;
pub use in_scene::{GoalCounts, GoalResult, Reachability, SceneWorkspace, scene_workspace};
pub use json::{SceneWorkspaceJson, WorkspaceJson};
use nalgebra::{Point3, Vector3};

use crate::parallel;

/// Parameters of a workspace.
#[derive(Debug, Clone, Copy)]
pub struct WorkspaceQuery<'a> {
    /// The robot.
    pub robot: &'a Robot,
    /// Start pose of the body.
    pub start: Pose,
    /// Length of the body, mm.
    pub length: f64,
    /// Radius of the bends, mm.
    pub radius: f64,
    /// Planner of the paths.
    pub planner: Planner,
    /// Heading and pitch of the tip at the end, radians. `None` for any direction.
    pub direction: Option<(f64, f64)>,
    /// True to compute the section through the workspace. If `direction` is given, most of the computing time goes into
    /// it.
    pub section: bool,
}

/// A computed workspace.
#[derive(Debug, Clone, PartialEq)]
pub struct Workspace {
    /// Volume of the positions within reach, mm^3, and its standard error, mm^3 (0 if the volume is integrated).
    pub volume: (f64, f64),
    /// Distances from the start to the furthest positions within reach, mm: ahead, to the side along the start's x
    /// axis, to the side against it, and behind. `None` if not even the nearest position that was tried is within
    /// reach.
    pub reach: [Option<f64>; 4],
    /// Share of final directions within reach, for each shell around the start. Empty if the final direction is
    /// given.
    pub shares: Vec<Band>,
    /// Section through the start, in the plane of its direction and its x axis: the length of the shortest body to
    /// each position, mm. Values above the length of the given body may be too small. `None` if the section was not
    /// requested.
    pub section: Option<WorkspaceSection>,
    /// Share of final directions within reach, 0 to 1, in the plane of `section`. `None` if the final direction is
    /// given.
    pub share_section: Option<WorkspaceSection>,
}

/// Positions in a shell around the start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Band {
    /// Outer radius of the shell, mm. Its inner radius is the outer radius of the shell before.
    pub to: f64,
    /// Share of all final directions at all positions of the shell that are within reach, 0 to 1.
    pub share: f64,
}

/// Values on a grid of positions in a plane.
#[derive(Debug, Clone, PartialEq)]
pub struct WorkspaceSection {
    /// Distance between neighbours, mm.
    pub spacing: f64,
    /// Number of positions in a row, along `lateral` from `lateral_from`.
    pub columns: usize,
    /// `lateral` of the first column, mm.
    pub lateral_from: f64,
    /// `axial` of the first row, mm.
    pub axial_from: f64,
    /// Values of all positions, row by row: the length of the shortest body, mm, or the share of directions. The first
    /// row is the one farthest behind the start.
    pub values: Vec<f64>,
}

/// Maximum number of plans to positions within [`NEAR`] radii of the start, for the shares of final directions.
/// Planning takes long there.
const MAX_NEAR: f64 = 3000.0;
const MAX_NEAR_IN_DIRECTION: f64 = 400.0;
/// Distance from the start within which planning takes long, radii.
const NEAR: f64 = 4.0;
/// Number of final directions that are tried for each position. They are on one half of the sphere, on one side of
/// the section, because the other side is symmetric.
pub const DIRECTIONS: usize = 24;
/// Number of shells in [`Workspace::shares`].
const BANDS: usize = 10;
/// Maximum number of grid rows between the start and the end of the section, for the shares of final directions.
const FINEST_SHARES: f64 = 30.0;
const FINEST_PLANNED: f64 = 60.0;
const FINEST_CLOSED: f64 = 120.0;
/// Number of positions from which a volume is estimated.
pub const POSITIONS: usize = 1000;
/// Number of positions that are tried along each axis.
pub const ALONG_AXIS: usize = 200;

/// Computes the workspace. `at` receives the number of finished steps and the number of all steps.
///
/// # Errors
/// Errors of [`plan`], mostly a radius that the robot cannot bend to.
pub fn workspace(question: &WorkspaceQuery, at: impl FnMut(u64, u64)) -> Result<Workspace, PlanError> {
    question.check()?;
    match question.direction {
        None => Ok(question.anywhere(at)),
        Some((heading, pitch)) => Ok(question.in_direction(heading, pitch, at)),
    }
}

/// Returns the volume of a ball with this radius, mm^3.
pub fn ball(radius: f64) -> f64 {
    4.0 / 3.0 * PI * radius * radius * radius
}

impl WorkspaceQuery<'_> {
    /// Checks the parameters that are the same for all positions, such as the radius.
    fn check(&self) -> Result<(), PlanError> {
        plan(self.robot, &self.start, &self.start, self.radius, self.planner).map(|_| ())
    }

    /// Returns the radius around the start within which planning takes long, mm. It is at most the length of the
    /// body.
    fn near(&self) -> f64 {
        (NEAR * self.radius).min(self.length)
    }

    fn start_frame(&self) -> Frame {
        self.start.frame()
    }

    /// Converts a position from the start's frame to the base's frame.
    fn position(&self, position: Vector3<f64>) -> Vector3<f64> {
        (self.start_frame() * Point3::from(position)).coords
    }

    /// Returns the length of the planned body to a position in the start's frame, mm. It is infinite without a path.
    fn planned(&self, position: Vector3<f64>, heading: f64, pitch: f64) -> f64 {
        Pose::new(self.position(position), heading, pitch)
            .ok()
            .and_then(|goal| plan(self.robot, &self.start, &goal, self.radius, self.planner).ok())
            .map_or(f64::INFINITY, |chosen| path::length(&chosen.path))
    }

    /// Returns a lower bound of the length of a body to this position and direction, mm. It is the larger of two
    /// lengths: that of the shortest body with any final direction, and that of the shortest body from the goal back
    /// to the start with any direction at the start.
    fn at_least(&self, position: Vector3<f64>, heading: f64, pitch: f64) -> f64 {
        let forth = shortest_to(position.z, libm::hypot(position.x, position.y), self.radius);
        let Ok(goal) = Pose::new(self.position(position), heading, pitch) else { return f64::INFINITY };
        let back = goal.position() - self.start.position();
        let axial = back.dot(&goal.direction());
        let lateral = (back - goal.direction() * axial).norm();
        forth.max(shortest_to(axial, lateral, self.radius))
    }

    /// Returns true if a body of this length reaches this position and direction. The planner runs only if neither a
    /// lower bound nor the two-plane path, which is quickly found, decides.
    fn within(&self, position: Vector3<f64>, heading: f64, pitch: f64) -> bool {
        if self.at_least(position, heading, pitch) > self.length * (1.0 + 1e-9) {
            return false;
        }
        let two_plane = Self { planner: Planner::TwoPlane, ..*self };
        two_plane.planned(position, heading, pitch) <= self.length
            || self.planner != Planner::TwoPlane && self.planned(position, heading, pitch) <= self.length
    }

    fn anywhere(&self, mut at: impl FnMut(u64, u64)) -> Workspace {
        let shortest = |axial: f64, lateral: f64| shortest_to(axial, lateral, self.radius);
        let spacing = self.length / FINEST_CLOSED;
        let section = self.section.then(|| WorkspaceSection::on_a_half_plane(self.length, spacing, shortest));

        // The cells are rings around the start's direction, as in `share_section`.
        let near = FRAC_PI_2 * self.near() * self.near();
        let coarse = (self.length / FINEST_SHARES).max(libm::sqrt(near * DIRECTIONS as f64 / MAX_NEAR));
        let rows = libm::ceil(self.length / coarse);
        let coarse = self.length / rows;
        let cells: Vec<(f64, f64)> = (0..2 * rows as usize)
            .flat_map(|row| (0..rows as usize).map(move |column| (row, column)))
            .map(|(row, column)| ((row as f64 + 0.5) * coarse - self.length, (column as f64 + 0.5) * coarse))
            .collect();
        let directions = half_sphere();
        let share = |&(axial, lateral): &(f64, f64)| {
            if shortest(axial, lateral) > self.length {
                return 0.0;
            }
            let within = directions.iter().filter(|direction| {
                let (heading, pitch) = heading_and_pitch(&(self.start_frame().rotation * **direction));
                self.within(Vector3::new(lateral, 0.0, axial), heading, pitch)
            });
            within.count() as f64 / DIRECTIONS as f64
        };
        let values = parallel::map(&cells, share, |done| at(done as u64, cells.len() as u64));

        let bands = (0..BANDS).map(|band| {
            let to = self.length * (band + 1) as f64 / BANDS as f64;
            let from = self.length * band as f64 / BANDS as f64;
            let inside =
                |&(&(axial, lateral), _): &(&(f64, f64), &f64)| (from..to).contains(&libm::hypot(axial, lateral));
            let (weight, sum) = cells
                .iter()
                .zip(&values)
                .filter(inside)
                .fold((0.0, 0.0), |(weight, sum), (cell, value)| (weight + cell.1, sum + cell.1 * value));
            Band { to, share: if weight > 0.0 { sum / weight } else { 0.0 } }
        });
        let lateral = furthest(self.length, |distance| shortest(0.0, distance));
        Workspace {
            volume: (self.volume_of_rings(shortest), 0.0),
            reach: [Some(self.length), lateral, lateral, furthest(self.length, |distance| shortest(-distance, 0.0))],
            shares: bands.collect(),
            section,
            share_section: Some(WorkspaceSection {
                spacing: coarse,
                columns: rows as usize,
                lateral_from: 0.5 * coarse,
                axial_from: 0.5 * coarse - self.length,
                values,
            }),
        }
    }

    /// Returns the volume of the positions that a body of this length reaches, mm^3, as a sum over rings around the
    /// start's direction. `shortest` returns the length of the shortest body to an axial and a lateral position.
    fn volume_of_rings(&self, shortest: impl Fn(f64, f64) -> f64) -> f64 {
        let rows = 500;
        let step = self.length / f64::from(rows);
        let mut volume = 0.0;
        for row in -rows..rows {
            for column in 0..rows {
                let (axial, lateral) = ((f64::from(row) + 0.5) * step, (f64::from(column) + 0.5) * step);
                if shortest(axial, lateral) <= self.length {
                    volume += TAU * lateral * step * step;
                }
            }
        }
        volume
    }

    fn in_direction(&self, heading: f64, pitch: f64, mut at: impl FnMut(u64, u64)) -> Workspace {
        let near = PI * self.near() * self.near();
        let spacing = (self.length / FINEST_PLANNED).max(libm::sqrt(near / MAX_NEAR_IN_DIRECTION));
        let rows = libm::ceil(self.length / spacing);
        let spacing = self.length / rows;
        let columns = if self.section { 2 * rows as usize + 1 } else { 0 };
        let place = |index: usize| index as f64 * spacing - self.length;
        let in_plane: Vec<Vector3<f64>> = (0..columns)
            .flat_map(|row| (0..columns).map(move |column| Vector3::new(place(column), 0.0, place(row))))
            .collect();
        let axes = [Vector3::z(), Vector3::x(), -Vector3::x(), -Vector3::z()];
        let of = (axes.len() + POSITIONS + in_plane.len()) as u64;

        // The furthest position along an axis is searched from far to near.
        let furthest = |axis: &Vector3<f64>| {
            let along = |step: usize| self.length * step as f64 / ALONG_AXIS as f64;
            (1..=ALONG_AXIS).rev().map(along).find(|distance| self.within(axis * *distance, heading, pitch))
        };
        let reach = parallel::map(&axes, furthest, |done| at(done as u64, of));
        let in_space: Vec<Vector3<f64>> = (0..POSITIONS).map(|index| in_ball(index) * self.length).collect();
        let before = axes.len();
        let within = parallel::map(
            &in_space,
            |position| self.within(*position, heading, pitch),
            |done| at((before + done) as u64, of),
        );
        let before = before + POSITIONS;
        let values = parallel::map(
            &in_plane,
            |position| match self.at_least(*position, heading, pitch) {
                // Near the edge the lengths themselves are needed, because the contour is interpolated between them.
                beyond if beyond > self.length + 2.0 * spacing => beyond,
                _ => self.planned(*position, heading, pitch),
            },
            |done| at((before + done) as u64, of),
        );

        let share = within.iter().filter(|within| **within).count() as f64 / POSITIONS as f64;
        let ball = ball(self.length);
        let error = libm::sqrt(share * (1.0 - share) / POSITIONS as f64);
        let corner = -self.length;
        let section = WorkspaceSection { spacing, columns, lateral_from: corner, axial_from: corner, values };
        Workspace {
            volume: (share * ball, error * ball),
            reach: std::array::from_fn(|axis| reach.get(axis).copied().flatten()),
            shares: Vec::new(),
            section: self.section.then_some(section),
            share_section: None,
        }
    }
}

impl WorkspaceSection {
    /// Computes a section of the half plane on the side of the x axis. `value` returns the value at an axial and a
    /// lateral position.
    fn on_a_half_plane(length: f64, spacing: f64, value: impl Fn(f64, f64) -> f64) -> Self {
        let side = libm::round(length / spacing) as usize;
        let columns = side + 1;
        let place = |row: usize, column: usize| (row as f64 * spacing - length, column as f64 * spacing);
        let values = (0..=2 * side)
            .flat_map(|row| (0..columns).map(move |column| (row, column)))
            .map(|(row, column)| place(row, column))
            .map(|(axial, lateral)| value(axial, lateral))
            .collect();
        Self { spacing, columns, lateral_from: 0.0, axial_from: -length, values }
    }

    /// Returns the value at a row and a column, with its lateral and axial position, mm.
    pub fn at(&self, row: usize, column: usize) -> Option<(f64, f64, f64)> {
        let value = (column < self.columns).then(|| self.values.get(row * self.columns + column)).flatten()?;
        let lateral = self.lateral_from + column as f64 * self.spacing;
        Some((*value, lateral, self.axial_from + row as f64 * self.spacing))
    }

    /// Returns the number of rows.
    pub fn rows(&self) -> usize {
        self.values.len().checked_div(self.columns).unwrap_or(0)
    }
}

/// Returns the furthest distance for which `shortest` is not longer than `length`. Only multiples of a thousandth of
/// `length` are tried. `None` if all of them are too far.
fn furthest(length: f64, shortest: impl Fn(f64) -> f64) -> Option<f64> {
    (1..=1000).rev().map(|step| length * f64::from(step) / 1000.0).find(|distance| shortest(*distance) <= length)
}

/// Returns directions that are spread evenly over the half sphere of positive y.
fn half_sphere() -> Vec<Vector3<f64>> {
    let golden = PI * (3.0 - libm::sqrt(5.0));
    let direction = |index: usize| {
        let y = (index as f64 + 0.5) / DIRECTIONS as f64;
        let across = libm::sqrt(1.0 - y * y);
        let (sin, cos) = libm::sincos(golden * index as f64);
        Vector3::new(across * cos, y, across * sin)
    };
    (0..DIRECTIONS).map(direction).collect()
}

/// Returns a point of a sequence that is spread evenly through the unit ball (Roberts's sequence in three dimensions).
fn in_ball(index: usize) -> Vector3<f64> {
    // The root of x^4 = x + 1.
    let root = 1.220_744_084_605_759_5;
    let part = |power: f64| {
        let sum = 0.5 + (index as f64 + 1.0) / power;
        sum - libm::floor(sum)
    };
    let [radius, up, round] = [part(root), part(root * root), part(root * root * root)];
    let (radius, up) = (libm::cbrt(radius), 2.0 * up - 1.0);
    let across = libm::sqrt(1.0 - up * up);
    let (sin, cos) = libm::sincos(TAU * round);
    Vector3::new(across * cos, across * sin, up) * radius
}

fn heading_and_pitch(direction: &Vector3<f64>) -> (f64, f64) {
    (
        libm::atan2(direction.y, direction.x),
        libm::atan2(direction.z, libm::hypot(direction.x, direction.y)).clamp(-FRAC_PI_2, FRAC_PI_2),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot_file;

    fn question(robot: &Robot, length: f64) -> WorkspaceQuery<'_> {
        WorkspaceQuery {
            robot,
            start: Pose::from_degrees([10.0, 20.0, 30.0, 40.0, 50.0]).unwrap(),
            length,
            radius: 100.0,
            planner: Planner::TwoPlane,
            direction: None,
            section: true,
        }
    }

    #[test]
    fn no_plan_is_shorter_than_the_lower_bound() {
        let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
        let question = question(&robot, 1000.0);
        for index in 0..2000 {
            let position = in_ball(index) * 1000.0;
            let (heading, pitch) = heading_and_pitch(&in_ball(index + 2000));
            let lateral = libm::hypot(position.x, position.y);
            let planned = question.planned(position, heading, pitch);
            assert!(planned >= shortest_to(position.z, lateral, 100.0) - 1e-6, "{position:?}");
            assert!(planned >= question.at_least(position, heading, pitch) - 1e-6, "{position:?}");
        }
    }

    #[test]
    fn long_bodies_reach_nearly_everything_and_short_ones_only_ahead() {
        let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
        let ball = |length: f64| 4.0 / 3.0 * PI * length * length * length;
        let short = workspace(&question(&robot, 100.0), |_, _| {}).unwrap();
        // A body as long as a radius reaches a plume ahead, and nothing behind or to the side.
        assert!(short.volume.0 < 0.2 * ball(100.0) && short.reach[0] == Some(100.0));
        assert!(short.reach[3].is_none() || short.reach[3] < Some(1.0), "{:?}", short.reach);
        let long = workspace(&question(&robot, 5000.0), |_, _| {}).unwrap();
        assert!(long.volume.0 > 0.85 * ball(5000.0), "{}", long.volume.0 / ball(5000.0));
        assert!(long.shares[7].share > 0.9 && long.shares[9].share < 0.9, "{:?}", long.shares);
        assert_eq!(long.shares.len(), BANDS);
    }

    #[test]
    fn a_fixed_direction_reaches_less_than_a_free_one() {
        let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
        let any = workspace(&question(&robot, 600.0), |_, _| {}).unwrap();
        let down = WorkspaceQuery { direction: Some((0.0, -1.5)), ..question(&robot, 600.0) };
        let mut progress = (0, 0);
        let down = workspace(&down, |done, of| progress = (done, of)).unwrap();
        assert!(down.volume.0 + 3.0 * down.volume.1 < any.volume.0 && down.volume.0 > 0.0);
        assert!(down.reach[0] < any.reach[0] && down.shares.is_empty() && down.share_section.is_none());
        assert!(progress.1 > 1000 && progress.0 <= progress.1);
        let tight = WorkspaceQuery { radius: 50.0, ..question(&robot, 600.0) };
        assert!(matches!(workspace(&tight, |_, _| {}), Err(PlanError::RadiusTooSmall { .. })));
    }
}
