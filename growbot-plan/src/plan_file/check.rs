//! Checks of a plan that was read from a file.
//!
//! The plan must have been made for a robot with the same description, its numbers must be valid, and the robot must be
//! able to make its bends. Its totals must match its segments. The segments, chained from the start by Eq 4, must pass
//! through each waypoint and end at the goal. Warnings are computed again. Warnings in the file with other codes are
//! kept, because another program or a person may have added them.

use growbot_core::angle::{radians, wrap_positive};
use growbot_core::helicoid::Helicoid;
use growbot_core::layer_bytes::decode;
use growbot_core::path::{Leg, Segment, end, length};
use growbot_core::plan::{GoalError, MAX_RADIUS_MM, goal_error};
use growbot_core::pose::{Frame, Pose};
use growbot_core::robot::Robot;
use nalgebra::Vector3;

use super::check_error::MAX_SEGMENTS;
use super::{LegJson, PlanCheckError, PlanFile, PoseJson, SegmentJson, layer_rows};
use crate::hexadecimal::format_hash;
use crate::plan::{MAX_EXISTING_LAYERS, Plan, PlanLegs, SearchSummary, path_type};
use crate::pose_text::pose_of_numbers;
use crate::warning::{THIN_LAYER, Warning};

/// Maximum length of a segment, mm. It is longer than twice the diagonal of the range of coordinates.
const LONGEST_SEGMENT: f64 = 8.0 * Pose::MAX_COORDINATE_MM;
/// Maximum total length of all helicoidal arcs, in radii. It limits the time for the integration, and no planner
/// returns longer ones.
const MAX_TURNS: f64 = 1e4;
/// Maximum number of candidates in the search statistics of a plan. No planner finds more.
const MAX_CANDIDATES: f64 = 1e9;
/// Maximum number of letters of a path type that an error message quotes.
const LONGEST_PATH_TYPE: usize = 40;
/// Maximum absolute value of the components of the vectors `m0` and `p` of a helicoidal arc.
const MAX_MOMENT: f64 = 1e6;
/// Minimum of the larger norm of the vectors `m0` and `p` of a helicoidal arc.
const MIN_MOMENT: f64 = 1e-6;
/// Maximum component of the vector `m0` of a helicoidal arc along the tip's direction, as a fraction of the larger norm
/// of `m0` and `p`.
const PERPENDICULAR: f64 = 1e-9;
/// Relative tolerance of comparisons, because the conversion between degrees and radians is not exact.
const ROUNDING: f64 = 1e-9;
/// Maximum distance of the end of a leg from its goal, mm, for legs of up to 100 radii. The limit grows in proportion
/// to the distance of longer legs.
const ARRIVED_DISTANCE: f64 = 1e-6;
/// Maximum angle between the directions at the end of a leg and of its goal, radians, for legs of up to 100 radii. The
/// limit grows in proportion to the distance of longer legs, as in the planner's check.
const ARRIVED_ANGLE: f64 = 1e-8;

impl PlanFile {
    /// Checks this plan file for a robot and converts it to a plan.
    ///
    /// # Errors
    /// The first check that fails.
    pub fn check(&self, robot: &Robot) -> Result<Plan, PlanCheckError> {
        self.check_robot(robot)?;
        range("radius_mm", self.radius_mm, robot.min_radius(), MAX_RADIUS_MM)?;
        let start = pose_from_json("start", &self.start)?;
        let goal = pose_from_json("goal", &self.goal.pose())?;
        let path = self.path(robot, &start)?;
        let legs = self.legs(&start, &goal, &path)?;
        range("the number of existing_layers", self.existing_layers.len() as f64, 0.0, MAX_EXISTING_LAYERS as f64)?;
        // A layer without height that bends has no centreline.
        let without_height = self.existing_layers.iter().map(decode).filter(|layer| layer.height == 0.0);
        let bend = without_height.map(|layer| layer.tilt).fold(0.0, f64::max);
        range("the tilt of a layer without height in existing_layers", bend, 0.0, 0.0)?;
        let plan = Plan::of_path(robot, &start, self.radius_mm, self.planner, legs, path);
        let mut plan = plan.after_layers(self.existing_layers.clone(), robot);
        let stands = |warning: &&Warning| {
            warning.code != THIN_LAYER && plan.warnings.iter().all(|found| found.code != warning.code)
        };
        let standing: Vec<_> = self.warnings.iter().filter(stands).cloned().collect();
        plan.warnings.extend(standing);
        self.check_totals(&plan, robot)?;
        self.check_description(&plan)?;
        self.check_layer_table(&plan, robot)?;
        Ok(plan)
    }

    fn check_robot(&self, robot: &Robot) -> Result<(), PlanCheckError> {
        if self.robot != robot.name() {
            return Err(PlanCheckError::OtherRobot { plan: self.robot.clone(), robot: robot.name().to_owned() });
        }
        let here = format_hash(robot.hash());
        if self.robot_hash != here {
            return Err(PlanCheckError::OtherHash { robot: self.robot.clone(), plan: self.robot_hash.clone(), here });
        }
        Ok(())
    }

    fn path(&self, robot: &Robot, start: &Pose) -> Result<Vec<Segment>, PlanCheckError> {
        let found = self.segments.len();
        if found > MAX_SEGMENTS {
            return Err(PlanCheckError::TooManySegments { found });
        }
        let mut path = Vec::with_capacity(found);
        let mut base_from_tip = start.frame();
        let mut turns = 0.0;
        for (index, written) in self.segments.iter().enumerate() {
            if let SegmentJson::Helicoid { length_mm, .. } = written {
                turns += length_mm / self.radius_mm;
                range(
                    format!("the sum of the lengths of the helicoids up to segment {index}, in radii,"),
                    turns,
                    0.0,
                    MAX_TURNS,
                )?;
            }
            let segment = segment(index, written, self.radius_mm, &base_from_tip, robot.min_radius())?;
            base_from_tip *= segment.step();
            path.push(segment);
        }
        Ok(path)
    }

    /// Converts the legs and their search statistics, and checks that each leg ends at its waypoint or at the goal.
    fn legs(&self, start: &Pose, goal: &Pose, path: &[Segment]) -> Result<PlanLegs, PlanCheckError> {
        let (found, expected) = (self.legs.len(), if self.via.is_empty() { 0 } else { self.via.len() + 1 });
        if found != expected {
            return Err(PlanCheckError::Legs { found, expected });
        }
        let whole;
        let written = if self.legs.is_empty() {
            let (candidates, two_plane_length_mm, passed_over) =
                (self.candidates, self.two_plane_length_mm, self.passed_over);
            whole = [LegJson {
                segments: path.len(),
                path_type: self.path_type.clone().unwrap_or_else(|| path_type(path)),
                length_mm: self.length_mm,
                candidates,
                passed_over,
                two_plane_length_mm,
            }];
            &whole[..]
        } else {
            &self.legs
        };
        let sum = written.iter().map(|leg| leg.segments as u128).sum::<u128>();
        if sum != path.len() as u128 {
            return Err(PlanCheckError::Total {
                what: "the number of segments in the legs",
                value: sum as f64,
                expected: path.len() as f64,
            });
        }
        let (mut legs, mut choices) = (Vec::with_capacity(written.len()), Vec::with_capacity(written.len()));
        let (mut base_from_tip, mut from, mut rest) = (start.frame(), *start, path);
        for (index, leg) in written.iter().enumerate() {
            let to = match self.via.get(index) {
                Some(written) => pose_from_json("via", &written.pose())?,
                None => *goal,
            };
            let (own, after) = rest.split_at_checked(leg.segments).unwrap_or((rest, &[]));
            rest = after;
            base_from_tip = end(own, &base_from_tip);
            let which = if index + 1 < written.len() { format!("via {}", index + 1) } else { "the goal".to_owned() };
            check_arrival(which, &base_from_tip, &from, &to, self.radius_mm)?;
            check_path_type(&leg.path_type, own)?;
            check_total("length_mm of a leg", leg.length_mm, length(own), 0.0)?;
            legs.push(Leg { goal: to, segment_count: leg.segments });
            choices.push(leg.choice()?);
            from = to;
        }
        let goals = self.via.iter().chain([&self.goal]);
        Ok(PlanLegs { legs, choices, free_directions: goals.map(|goal| goal.direction_free).collect() })
    }

    /// Checks the path type and the search statistics of the whole path.
    fn check_description(&self, plan: &Plan) -> Result<(), PlanCheckError> {
        if let Some(written) = &self.path_type {
            check_path_type(written, &plan.path)?;
        }
        let Some(choice) = plan.search_summary() else { return Ok(()) };
        let percent = choice.two_plane_longer_percent(plan.requirements.length);
        for (what, value, expected) in [
            ("candidates", self.candidates.map(|count| count as f64), choice.candidates as f64),
            ("passed_over", Some(self.passed_over as f64), choice.rejected as f64),
            ("two_plane_length_mm", self.two_plane_length_mm, choice.two_plane_length),
        ] {
            check_total(what, value.unwrap_or(expected), expected, 0.0)?;
        }
        // The percentage is a difference of two lengths, so its tolerance is absolute.
        check_total("two_plane_longer_percent", self.two_plane_longer_percent.unwrap_or(percent), percent, 1e-6)
    }

    /// Checks that the table of layers, if there is one, is that of the plan.
    fn check_layer_table(&self, plan: &Plan, robot: &Robot) -> Result<(), PlanCheckError> {
        if self.layer_table.is_empty() {
            return Ok(());
        }
        let mut written = self.layer_table.iter();
        let mut rows = layer_rows(&plan.path, robot);
        let first_wrong = (0..).find_map(|row| match (written.next(), rows.next()) {
            (None, None) => Some(None),
            (written, row_of_plan) => (written != row_of_plan.as_ref()).then_some(Some(row)),
        });
        first_wrong.flatten().map_or(Ok(()), |row| Err(PlanCheckError::LayerRow { row }))
    }

    /// Checks length, number of layers, duration and filament against the segments. A mismatch shows that segments were
    /// changed, removed or duplicated.
    fn check_totals(&self, plan: &Plan, robot: &Robot) -> Result<(), PlanCheckError> {
        let needs = &plan.requirements;
        // If a segment is almost exactly a whole number of layers, rounding may give one layer more or less.
        let layers_off = plan.path.len() as f64;
        let duration_off = layers_off * robot.description().layer.period_s;
        for (what, value, expected, off) in [
            ("length_mm", self.length_mm, needs.length, 0.0),
            ("layers", self.layers as f64, needs.layers as f64, layers_off),
            ("duration_s", self.duration_s, needs.duration, duration_off),
            ("filament_mm", self.filament_mm, needs.filament, 0.0),
        ] {
            check_total(what, value, expected, off)?;
        }
        Ok(())
    }
}

impl LegJson {
    fn choice(&self) -> Result<Option<SearchSummary>, PlanCheckError> {
        let (Some(candidates), Some(two_plane_length)) = (self.candidates, self.two_plane_length_mm) else {
            return Ok(None);
        };
        range("candidates", candidates as f64, 1.0, MAX_CANDIDATES)?;
        range("passed_over", self.passed_over as f64, 0.0, candidates as f64 - 1.0)?;
        range("two_plane_length_mm", two_plane_length, 0.0, LONGEST_SEGMENT)?;
        Ok(Some(SearchSummary { candidates, rejected: self.passed_over, two_plane_length }))
    }
}

/// Checks that a value in the file equals the expected value. It may differ by `off`, and by rounding.
fn check_total(what: &'static str, value: f64, expected: f64, off: f64) -> Result<(), PlanCheckError> {
    // This rejects NaN too.
    if (value - expected).abs() <= off + ROUNDING * expected.abs() {
        return Ok(());
    }
    Err(PlanCheckError::Total { what, value, expected })
}

fn check_path_type(found: &str, path: &[Segment]) -> Result<(), PlanCheckError> {
    let expected = path_type(path);
    if found == expected {
        return Ok(());
    }
    Err(PlanCheckError::PathType { found: found.chars().take(LONGEST_PATH_TYPE).collect(), expected })
}

fn range(what: impl Into<String>, value: f64, min: f64, max: f64) -> Result<(), PlanCheckError> {
    if (min..=max).contains(&value) {
        return Ok(());
    }
    Err(PlanCheckError::Range { what: what.into(), value, min, max })
}

/// Converts a pose in JSON form. `which` is the name of the pose in error messages.
pub fn pose_from_json(which: &'static str, written: &PoseJson) -> Result<Pose, PlanCheckError> {
    let &PoseJson { x_mm, y_mm, z_mm, heading_deg, pitch_deg, roll_deg } = written;
    pose_of_numbers([x_mm, y_mm, z_mm, heading_deg, pitch_deg])
        .and_then(|pose| pose.with_roll(radians(roll_deg)))
        .map_err(|error| PlanCheckError::Pose { which, error })
}

fn segment(
    index: usize,
    written: &SegmentJson,
    radius: f64,
    base_from_tip: &Frame,
    min_radius: f64,
) -> Result<Segment, PlanCheckError> {
    let named = |field: &str| format!("{field} of segment {index}");
    let check_length = |length_mm| range(named("length_mm"), length_mm, f64::MIN_POSITIVE, LONGEST_SEGMENT);
    match *written {
        SegmentJson::Straight { length_mm } => {
            check_length(length_mm)?;
            Ok(Segment::Straight { length: length_mm })
        }
        SegmentJson::Arc { alpha_deg, beta_deg, length_mm } => {
            check_length(length_mm)?;
            range(named("alpha_deg"), alpha_deg, -360.0, 360.0)?;
            range(named("beta_deg"), beta_deg, 0.0, 360.0)?;
            let bend = radians(beta_deg);
            if bend * min_radius > length_mm * (1.0 + ROUNDING) {
                return Err(PlanCheckError::TooTight { segment: index, radius: length_mm / bend, limit: min_radius });
            }
            Ok(Segment::Arc { alpha: wrap_positive(radians(alpha_deg)), bend, length: length_mm })
        }
        SegmentJson::Helicoid { length_mm, m0, p } => {
            check_length(length_mm)?;
            for value in m0.into_iter().chain(p) {
                range(named("m0 and p"), value, -MAX_MOMENT, MAX_MOMENT)?;
            }
            let tip_from_base = base_from_tip.rotation.inverse();
            let (m0, p) = (tip_from_base * Vector3::from(m0), tip_from_base * Vector3::from(p));
            let scale = m0.norm().max(p.norm());
            range(format!("the scale of m0 and p of segment {index}"), scale, MIN_MOMENT, MAX_MOMENT)?;
            if m0.z.abs() > PERPENDICULAR * scale {
                return Err(PlanCheckError::NotPerpendicular {
                    segment: index,
                    value: m0.z / scale,
                    limit: PERPENDICULAR,
                });
            }
            // Set the component along the tip to 0: it is a rounding error, which would add up along the curve.
            Ok(Segment::Helicoid {
                curve: Helicoid { m0: Vector3::new(m0.x, m0.y, 0.0), p },
                radius,
                length: length_mm,
            })
        }
    }
}

fn check_arrival(
    which: String,
    base_from_tip: &Frame,
    start: &Pose,
    goal: &Pose,
    radius: f64,
) -> Result<(), PlanCheckError> {
    let distance = (goal.position() - start.position()).norm();
    let scale = (distance / (100.0 * radius)).max(1.0);
    let limit = GoalError { distance: ARRIVED_DISTANCE.max(1e-8 * scale * radius), angle: ARRIVED_ANGLE * scale };
    let error = goal_error(base_from_tip, goal);
    if error.distance <= limit.distance && error.angle <= limit.angle {
        return Ok(());
    }
    Err(PlanCheckError::Missed { which, miss: error, limit })
}

#[cfg(test)]
mod tests {
    use growbot_core::layer::Layer;
    use growbot_core::plan::Planner;
    use growbot_core::slicing::{Slicing, layers};

    use super::*;
    use crate::pose_text::parse_pose;
    use crate::robot_file;

    fn robot(name: &str) -> Robot {
        robot_file::load(name.as_ref()).unwrap()
    }

    fn plan() -> Plan {
        let (start, goal) = (parse_pose("1,2,3,40,50").unwrap(), parse_pose("-300,200,900,170,-20").unwrap());
        Plan::new(&robot("growbot-a"), &start, &goal, 100.0, Planner::TwoPlane).unwrap()
    }

    /// Returns the error message for a plan file after this change.
    fn fault(change: impl Fn(&mut PlanFile)) -> String {
        let mut written = PlanFile::from(&plan());
        change(&mut written);
        written.check(&robot("growbot-a")).unwrap_err().to_string()
    }

    fn sliced(path: &[Segment], robot: &Robot) -> Vec<Layer> {
        layers(path, robot, Slicing::Exact).map(|sliced| sliced.layer).collect()
    }

    #[test]
    fn a_written_plan_has_the_same_layers() {
        let (plan, robot) = (plan(), robot("growbot-a"));
        let again = PlanFile::from(&plan).check(&robot).unwrap();
        assert_eq!((again.start, again.goal, again.requirements), (plan.start, plan.goal, plan.requirements));
        let (before, after) = (sliced(&plan.path, &robot), sliced(&again.path, &robot));
        assert_eq!(before.len(), after.len());
        for (before, after) in before.iter().zip(&after) {
            assert!((before.alpha - after.alpha).abs() < 1e-14);
            assert!((before.tilt - after.tilt).abs() < 1e-17);
            assert_eq!(before.height, after.height);
        }
    }

    #[test]
    fn a_robot_mismatch_names_both_robots() {
        let written = PlanFile::from(&plan());
        let message = written.check(&robot("growbot-b")).unwrap_err().to_string();
        assert!(message.contains("\"growbot-a\"") && message.contains("\"growbot-b\""), "{message}");
        let here = format_hash(robot("growbot-a").hash());
        let message = fault(|plan| plan.robot_hash = "0123456789abcdef".to_owned());
        assert!(message.contains("0123456789abcdef") && message.contains(&here), "{message}");
    }

    #[test]
    fn inconsistent_plans_are_refused_with_value_and_limit() {
        fn arc(plan: &mut PlanFile) -> (&mut f64, &mut f64, &mut f64) {
            plan.segments
                .iter_mut()
                .find_map(|segment| match segment {
                    SegmentJson::Arc { alpha_deg, beta_deg, length_mm } => Some((alpha_deg, beta_deg, length_mm)),
                    _ => None,
                })
                .unwrap()
        }
        type Change = fn(&mut PlanFile);
        let cases: [(Change, &str); 13] = [
            (|plan| plan.radius_mm = 98.0, "radius_mm is 98.0; it must lie between 98.2 and"),
            (|plan| plan.radius_mm = f64::NAN, "radius_mm is NaN"),
            (|plan| plan.start.pitch_deg = 91.0, "start: pitch is 91 deg"),
            (|plan| plan.goal.x_mm = f64::INFINITY, "goal: x is inf"),
            (|plan| *arc(plan).2 = 0.0, "length_mm of segment 0 is 0"),
            (|plan| *arc(plan).2 = -5.0, "length_mm of segment 0 is -5"),
            (|plan| *arc(plan).1 = -1.0, "beta_deg of segment 0 is -1"),
            (|plan| *arc(plan).1 *= 1.05, "below R_min = 98.2 mm"),
            (|plan| *arc(plan).0 = 400.0, "alpha_deg of segment 0 is 400"),
            (|plan| plan.goal.z_mm += 1e-4, "from the goal"),
            (|plan| plan.goal.heading_deg += 1e-5, "from the goal"),
            (|plan| plan.layers += 20, "layers is"),
            (|plan| plan.filament_mm *= 1.001, "filament_mm is"),
        ];
        for (change, part) in cases {
            let message = fault(change);
            assert!(message.contains(part), "{part}: {message}");
        }
        let message = fault(|plan| plan.segments = vec![SegmentJson::Straight { length_mm: 1.0 }; 10_001]);
        assert!(message.contains("10001 segments") && message.contains("10000"), "{message}");
    }
}
