//! State of a plan for Python's pickle: tuples of plain values that restore the plan bit for bit. The JSON of a plan
//! cannot, because its angles are in degrees.

use growbot_core::helicoid::Helicoid;
use growbot_core::path::{Leg, Segment};
use growbot_core::plan::{Planner, requirements};
use growbot_core::robot::Robot;
use growbot_plan::hexadecimal::{hex_of, unhex};
use growbot_plan::plan::{Plan, SceneClearance, SearchSummary};
use growbot_plan::warning::Warning;
use nalgebra::Vector3;

use crate::error::{Error, ErrorKind};
use crate::pose::{pose_from, state_of};

type Numbers = (f64, f64, f64, f64, f64, f64);
/// State of a leg: its goal, number of segments, search statistics (candidates, rejected, two-plane length in mm), and
/// true if the direction of the goal was free.
type LegState = (Numbers, usize, Option<(usize, usize, f64)>, bool);
/// State of a plan's scene: name of the file, hash, clearance (mm) and margin (mm).
type SceneState = (String, u64, f64, f64);
/// State of a warning: code, message, value and limit.
type WarningState = (String, String, f64, f64);
/// State of a plan: true for the planner `shortest`, radius (mm), start, legs, numbers of each segment, scene,
/// warnings, and the layers of the existing body as hexadecimal digits.
pub type PlanState = (bool, f64, Numbers, Vec<LegState>, Vec<Vec<f64>>, Option<SceneState>, Vec<WarningState>, String);

/// Returns the state of a plan.
pub fn of(plan: &Plan) -> PlanState {
    let legs = plan.legs.iter().zip(&plan.choices).zip(&plan.free_directions).map(|((leg, choice), free)| {
        let choice = choice.map(|choice| (choice.candidates, choice.rejected, choice.two_plane_length));
        (state_of(&leg.goal), leg.segment_count, choice, *free)
    });
    let segments = plan.path.iter().map(|segment| match *segment {
        Segment::Arc { alpha, bend, length } => vec![alpha, bend, length],
        Segment::Straight { length } => vec![length],
        Segment::Helicoid { curve: Helicoid { m0, p }, radius, length } => {
            vec![m0.x, m0.y, m0.z, p.x, p.y, p.z, radius, length]
        }
    });
    let scene = plan.scene.as_ref().map(|scene| (scene.file.clone(), scene.hash, scene.clearance, scene.margin));
    let shortest = plan.planner == Planner::Shortest;
    let warnings =
        plan.warnings.iter().map(|found| (found.code.clone(), found.message.clone(), found.value, found.limit));
    let (legs, segments, warnings) = (legs.collect(), segments.collect(), warnings.collect());
    let existing = hex_of(&plan.existing_layers);
    (shortest, plan.radius, state_of(&plan.start), legs, segments, scene, warnings, existing)
}

/// Restores a plan from its state.
pub fn plan(
    robot: &Robot,
    (shortest, radius, start, legs, segments, scene, warnings, existing): PlanState,
) -> Result<Plan, Error> {
    let path = segments.iter().map(|numbers| segment(numbers)).collect::<Result<Vec<_>, _>>()?;
    let start = pose_from(start)?;
    let requirements = requirements(&path, robot);
    let (mut all, mut choices, mut free_directions) = (Vec::new(), Vec::new(), Vec::new());
    for (goal, segment_count, choice, free) in legs {
        all.push(Leg { goal: pose_from(goal)?, segment_count });
        choices.push(choice.map(|(candidates, rejected, two_plane_length)| SearchSummary {
            candidates,
            rejected,
            two_plane_length,
        }));
        free_directions.push(free);
    }
    Ok(Plan {
        robot: robot.name().to_owned(),
        robot_hash: robot.hash(),
        planner: if shortest { Planner::Shortest } else { Planner::TwoPlane },
        radius,
        start,
        goal: all.last().map_or(start, |leg| leg.goal),
        legs: all,
        choices,
        free_directions,
        warnings: warnings
            .into_iter()
            .map(|(code, message, value, limit)| Warning { code, message, value, limit })
            .collect(),
        requirements,
        path,
        scene: scene.map(|(file, hash, clearance, margin)| SceneClearance { file, hash, clearance, margin }),
        existing_layers: unhex(&existing).ok_or_else(|| {
            Error::new(ErrorKind::Input, "the pickled plan has an invalid existing body: pickle it again")
        })?,
    })
}

fn segment(numbers: &[f64]) -> Result<Segment, Error> {
    let sound = numbers.iter().all(|number| number.is_finite());
    match *numbers {
        [alpha, bend, length] if sound && length > 0.0 && bend >= 0.0 => Ok(Segment::Arc { alpha, bend, length }),
        [length] if sound && length >= 0.0 => Ok(Segment::Straight { length }),
        [a, b, c, d, e, f, radius, length] if sound && radius > 0.0 && length > 0.0 => Ok(Segment::Helicoid {
            curve: Helicoid { m0: Vector3::new(a, b, c), p: Vector3::new(d, e, f) },
            radius,
            length,
        }),
        _ => Err(Error::new(ErrorKind::Input, "the pickled plan has an invalid segment: pickle it again")),
    }
}
