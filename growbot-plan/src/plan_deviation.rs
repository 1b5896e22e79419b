//! Comparison of a grown body with its plan and its scene: the greatest distance from the planned path, and the
//! smallest distance from an obstacle.

use growbot_core::kinematics::advance;
use growbot_core::layer::Layer;
use growbot_core::pose::Frame;
use growbot_core::robot::Robot;
use growbot_core::slicing::{Slicing, layers};
use growbot_scene::scene::Scene;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::plan::Plan;
use crate::warning::{FAR_FROM_PLAN, TOUCHES_OBSTACLE, Warning};

/// Limit of the distance from the planned path above which growbot warns, as a fraction of the planned length.
const LIMIT: f64 = 0.005;
/// Number of planned layers, after the nearest one of the previous point, among which the nearest layer of the next
/// point is searched. A body that passes near an earlier part of itself is therefore not compared with that part.
const AHEAD: usize = 16;

/// Greatest distance of a body from the path of its plan.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct PlanDeviation {
    /// Greatest distance of the body's centreline from the planned one, mm.
    pub max_mm: f64,
    /// Length of the body up to the point of the greatest distance, mm.
    pub at_mm: f64,
    /// Limit above which growbot warns, mm.
    pub limit_mm: f64,
}

/// Smallest clearance of a grown body from the obstacles of its scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct BodyClearance {
    /// Smallest distance between the outside of the tube and an obstacle, mm, negative inside.
    pub clearance_mm: f64,
    /// Length of the body up to the point of the smallest distance, mm.
    pub at_mm: f64,
    /// Point of the centreline at which the distance is smallest, mm.
    pub point_mm: [f64; 3],
    /// Name of the obstacle that is nearest to the body.
    pub obstacle: String,
    /// True if the body touches the obstacle.
    pub contact: bool,
}

/// Returns the points of the centreline of a body, mm: the start, and the tip after each layer.
pub fn centreline(base_from_start: &Frame, layers: impl IntoIterator<Item = Layer>) -> Vec<Vector3<f64>> {
    let mut tip = *base_from_start;
    let mut points = vec![tip.translation.vector];
    points.extend(layers.into_iter().map(|layer| {
        tip = advance(&tip, &layer.step());
        tip.translation.vector
    }));
    points
}

impl PlanDeviation {
    /// Computes the greatest distance between the centreline of a body and the planned path. `body` are points of the
    /// centreline, mm.
    ///
    /// The limit is 0.5 % of the planned length, and at least the width of the wall. Noise of 10 % moves the end of a
    /// body of 600 mm in open loop by 0.2 % (one standard deviation), so a larger distance has another cause, such as a
    /// systematic error, a detour, or a wrong correction.
    pub fn of(plan: &Plan, robot: &Robot, body: &[Vector3<f64>]) -> Self {
        let sliced = layers(&plan.path, robot, Slicing::Exact).map(|sliced| sliced.layer);
        let planned = centreline(&plan.start.frame(), sliced);
        let limit_mm = (LIMIT * plan.requirements.length).max(robot.description().wall.width_mm);
        let mut deviation = Self { max_mm: 0.0, at_mm: 0.0, limit_mm };
        let (mut nearest, mut along, mut before) = (0, 0.0, body.first());
        for point in body {
            along += before.map_or(0.0, |before| (point - before).norm());
            before = Some(point);
            let distance;
            (nearest, distance) = nearest_from(&planned, nearest, point);
            if distance > deviation.max_mm {
                (deviation.max_mm, deviation.at_mm) = (distance, along);
            }
        }
        deviation
    }

    /// Returns the warning for a body that is farther from its plan than the limit. `None` within the limit.
    pub fn warning(&self) -> Option<Warning> {
        let Self { max_mm, at_mm, limit_mm } = *self;
        (max_mm > limit_mm).then(|| Warning {
            code: FAR_FROM_PLAN.to_owned(),
            message: format!(
                "the body lies up to {max_mm:.1} mm from its plan, {at_mm:.0} mm along, above the limit of \
                 {limit_mm:.1} mm (0.5 % of the length, or the width of the wall if that is larger): check the \
                 distance to obstacles at that place, and grow with feedback or calibrate the robot"
            ),
            value: max_mm,
            limit: limit_mm,
        })
    }
}

/// Returns the index of the line of `planned` that is nearest to `point`, and its distance, mm. Line `i` leads from
/// point `i` to point `i + 1`. Only lines near index `from` are searched.
fn nearest_from(planned: &[Vector3<f64>], from: usize, point: &Vector3<f64>) -> (usize, f64) {
    let last = planned.len().saturating_sub(1);
    let candidates = from.saturating_sub(2)..=(from + AHEAD).min(last);
    let distance = |index: usize| match (planned.get(index), planned.get(index + 1)) {
        (Some(a), Some(b)) => {
            let (line, to_point) = (b - a, point - a);
            let share = (to_point.dot(&line) / line.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
            (to_point - line * share).norm()
        }
        (Some(a), None) => (point - a).norm(),
        (None, _) => f64::INFINITY,
    };
    let found = candidates.map(|index| (index, distance(index))).min_by(|a, b| a.1.total_cmp(&b.1));
    found.unwrap_or((from, 0.0))
}

impl BodyClearance {
    /// Computes the smallest clearance over the points of a body's centreline and the middles between them. `body` are
    /// these points, mm. `None` without points or obstacles.
    pub fn of(scene: &Scene, robot: &Robot, body: &[Vector3<f64>]) -> Option<Self> {
        let half_tube = 0.5 * robot.outer_diameter();
        let middles = body.windows(2).map(|pair| 0.5 * (pair[0] + pair[1]));
        let lengths = body.windows(2).scan(0.0, |along, pair| {
            let (before, step) = (*along, (pair[1] - pair[0]).norm());
            *along += step;
            Some((before + 0.5 * step, *along))
        });
        let ends = middles.zip(body.iter().skip(1)).zip(lengths);
        let halves = ends.flat_map(|((middle, end), (to_middle, to_end))| [(middle, to_middle), (*end, to_end)]);
        let points = body.first().map(|start| (*start, 0.0)).into_iter().chain(halves);
        // The distance from obstacles changes at most by the length along the body, so points within the difference to
        // the smallest distance so far are skipped.
        let (mut nearest, mut skip_to) = (None::<(f64, Vector3<f64>, f64)>, 0.0);
        for (point, along) in points {
            if along < skip_to {
                continue;
            }
            let distance = scene.distance(&point);
            match nearest {
                Some((least, ..)) if distance >= least => skip_to = along + (distance - least),
                _ => nearest = Some((distance, point, along)),
            }
        }
        let (distance, point, at_mm) = nearest?;
        let obstacle = scene.nearest(&point)?.to_string();
        let clearance_mm = distance - half_tube;
        Some(Self { clearance_mm, at_mm, point_mm: point.into(), obstacle, contact: clearance_mm < 0.0 })
    }

    /// Returns the warning for a body that touches an obstacle. `None` without contact.
    pub fn warning(&self) -> Option<Warning> {
        let Self { clearance_mm, at_mm, point_mm: [x, y, z], obstacle, contact } = self;
        contact.then(|| Warning {
            code: TOUCHES_OBSTACLE.to_owned(),
            message: format!(
                "the body lies {:.2} mm inside {obstacle}, {at_mm:.0} mm along, at {x:.1}, {y:.1}, {z:.1} mm, so the \
                 body touches this obstacle: inspect both, and plan with a larger margin",
                -clearance_mm
            ),
            value: *clearance_mm,
            limit: 0.0,
        })
    }
}

#[cfg(test)]
mod tests {
    use growbot_core::plan::Planner;
    use growbot_scene::shapes::Shape;

    use super::*;
    use crate::pose_text::parse_pose;
    use crate::robot_file;

    fn upright() -> (Robot, Plan) {
        let robot = robot_file::load("growbot-a".as_ref()).unwrap();
        let [start, goal] = ["0,0,0,0,90", "0,0,600,0,90"].map(|pose| parse_pose(pose).unwrap());
        let plan = Plan::new(&robot, &start, &goal, 100.0, Planner::Shortest).unwrap();
        (robot, plan)
    }

    /// Returns points every mm of a bow between the ends of the plan. Its middle is `height` mm from the plan.
    fn bow(height: f64) -> Vec<Vector3<f64>> {
        let point =
            |z: u32| Vector3::new(height * libm::sin(f64::from(z) * std::f64::consts::PI / 600.0), 0.0, z.into());
        (0..=600).map(point).collect()
    }

    #[test]
    fn a_body_as_planned_does_not_deviate() {
        let (robot, plan) = upright();
        let sliced = layers(&plan.path, &robot, Slicing::Exact).map(|sliced| sliced.layer);
        let body = centreline(&plan.start.frame(), sliced);
        let deviation = PlanDeviation::of(&plan, &robot, &body);
        assert!(deviation.max_mm < 1e-9 && deviation.warning().is_none(), "{deviation:?}");
        assert_eq!(deviation.limit_mm, 3.0);
    }

    #[test]
    fn a_bow_that_ends_at_the_goal_is_reported() {
        let (robot, plan) = upright();
        let deviation = PlanDeviation::of(&plan, &robot, &bow(13.2));
        assert!((deviation.max_mm - 13.2).abs() < 1e-6 && (deviation.at_mm - 300.0).abs() < 2.0, "{deviation:?}");
        let warning = deviation.warning().unwrap();
        assert!(warning.code == FAR_FROM_PLAN && warning.message.contains("13.2 mm"), "{warning:?}");
        assert_eq!(PlanDeviation::of(&plan, &robot, &bow(2.9)).warning(), None);
    }

    #[test]
    fn length_beyond_the_goal_is_a_deviation() {
        let (robot, plan) = upright();
        let body: Vec<_> = (0..=620).map(|z| Vector3::new(0.0, 0.0, f64::from(z))).collect();
        let deviation = PlanDeviation::of(&plan, &robot, &body);
        assert!((deviation.max_mm - 20.0).abs() < 1e-9 && (deviation.at_mm - 620.0).abs() < 1e-9, "{deviation:?}");
    }

    #[test]
    fn contact_is_found_between_the_points() {
        let (robot, _) = upright();
        let ball = |x: f64| {
            let shape = Shape::Ball { centre: Vector3::new(x, 0.0, 300.3), radius: 10.0 };
            Scene::new(vec![shape], vec![], vec![], vec![])
        };
        let half_tube = 0.5 * robot.outer_diameter();
        let beside = BodyClearance::of(&ball(10.0 + half_tube + 1.0), &robot, &bow(0.0)).unwrap();
        assert!((beside.clearance_mm - 1.0).abs() < 1e-2 && !beside.contact, "{beside:?}");
        assert!((beside.at_mm - 300.5).abs() < 1.0 && beside.warning().is_none(), "{beside:?}");
        let inside = BodyClearance::of(&ball(10.0 + half_tube - 1.0), &robot, &bow(0.0)).unwrap();
        assert!(inside.contact && (inside.clearance_mm + 1.0).abs() < 1e-2, "{inside:?}");
        assert_eq!(inside.warning().unwrap().code, TOUCHES_OBSTACLE);
    }
}
