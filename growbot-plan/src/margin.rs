//! Default margin between a body and obstacles, and the warning for a plan with a smaller clearance.
//!
//! If a scene has no margin, plans through it keep the distance by which the robot is expected to deviate from a plan.
//! A plan with a smaller clearance may be grown, but gets a warning. For the warning, growbot simulates many growths
//! with noise, and reports how many of these bodies touch an obstacle. The seeds and the number of growths are fixed,
//! so the result is the same on every machine.

use growbot_core::kinematics::advance;
use growbot_core::robot::Robot;
use growbot_core::simulation::{Disturbance, grow_open_loop};
use growbot_core::slicing::{Slicing, layers};
use growbot_scene::scene::Scene;
use growbot_scene::scene_file::LoadedScene;

use crate::plan::Plan;
use crate::warning::{NEAR_OBSTACLE, Warning};

/// Number of standard deviations of its position that a body must stay clear of obstacles.
pub const CLEARANCE_SIGMAS: f64 = 3.0;
/// Expected noise of a layer's height: half-width of its uniform distribution, as a fraction of the height. It is the
/// largest noise that Del Dottore et al. 2019 expect of a real robot.
const EXPECTED_NOISE: f64 = 0.1;
/// Length of body for which the expected deviation is computed, mm. The deviation grows with the root of the length.
const EXPECTED_LENGTH_MM: f64 = 1000.0;
/// Maximum number of simulated growths with noise. `MAX_LAYERS` is the maximum number of their layers together, which
/// take some 0.2 s.
const MAX_GROWTHS: usize = 100;
const MAX_LAYERS: usize = 100_000;

/// Returns the expected deviation of a robot's tip from its plan: 3 standard deviations of its position after 1 m of
/// body in open loop, mm, rounded to 0.01 mm.
///
/// Layers of height `h` with independent noise, uniform within a fraction `a` of `h`, add up to a standard deviation of
/// `a / sqrt(3) * sqrt(h * length)`. The result is 4.8 mm for growbot-a, whose layers are 0.774 mm high.
pub fn expected_deviation_mm(robot: &Robot) -> f64 {
    let height = robot.description().layer.height_mm;
    let deviation = CLEARANCE_SIGMAS * EXPECTED_NOISE / 3.0_f64.sqrt() * (height * EXPECTED_LENGTH_MM).sqrt();
    (100.0 * deviation).round() / 100.0
}

/// Returns the margin of plans through a scene, mm: the scene's margin, or else the expected deviation of the robot.
pub fn planning_margin_mm(robot: &Robot, loaded: &LoadedScene) -> f64 {
    loaded.margin.unwrap_or_else(|| expected_deviation_mm(robot))
}

/// Returns the warning for a plan with this clearance from a scene (mm). `None` if the clearance is at least the
/// expected deviation of the robot.
pub fn near_obstacle(plan: &Plan, robot: &Robot, loaded: &LoadedScene, clearance: f64) -> Option<Warning> {
    let limit = expected_deviation_mm(robot);
    if clearance >= limit {
        return None;
    }
    let growths = (MAX_LAYERS / plan.requirements.layers.max(1)).clamp(1, MAX_GROWTHS);
    let touching = (1..=growths as u64).filter(|seed| touches(plan, robot, &loaded.scene, *seed)).count();
    let message = format!(
        "the body comes within {clearance:.2} mm of an obstacle, less than the {limit:.2} mm by which {} is expected to \
         deviate (3 standard deviations over 1 m with 10 % noise): {touching} of {growths} simulated growths with that \
         noise touch it; plan with a larger margin, or grow with feedback",
        robot.name()
    );
    Some(Warning { code: NEAR_OBSTACLE.to_owned(), message, value: clearance, limit })
}

/// Reports whether a body that is laid with the expected noise and this seed touches an obstacle at the end of a layer.
fn touches(plan: &Plan, robot: &Robot, scene: &Scene, seed: u64) -> bool {
    let noise = Disturbance { growth_noise: EXPECTED_NOISE, ..Disturbance::default() };
    let half_tube = 0.5 * robot.outer_diameter();
    let mut tip = plan.start.frame();
    // Length of further body that cannot touch anything, because the last queried point was this far from all
    // obstacles.
    let (mut free, mut touched) = (0.0, false);
    let sliced = layers(&plan.path, robot, Slicing::Exact).map(|sliced| sliced.layer);
    grow_open_loop(&plan.start, sliced, &noise, seed, |laid| {
        tip = advance(&tip, &laid.step());
        free -= laid.layer.height;
        if !touched && free <= 0.0 {
            free = scene.distance(&tip.translation.vector) - half_tube;
            touched = free < 0.0;
        }
    });
    touched
}

#[cfg(test)]
mod tests {
    use growbot_core::plan::Planner;
    use growbot_scene::scene::Scene;
    use growbot_scene::shapes::HalfSpace;
    use nalgebra::Vector3;

    use super::*;
    use crate::pose_text::parse_pose;
    use crate::robot_file;

    /// Returns a plan that bends towards a wall, and a scene with the wall at the distance `spare` (mm) from the tube.
    fn towards_wall(spare: f64) -> (Robot, Plan, LoadedScene) {
        let robot = robot_file::load("growbot-a".as_ref()).unwrap();
        let [start, goal] = ["0,0,0,0,90", "400,0,300,0,0"].map(|pose| parse_pose(pose).unwrap());
        let plan = Plan::new(&robot, &start, &goal, 100.0, Planner::Shortest).unwrap();
        let top = 300.0 + 0.5 * robot.outer_diameter();
        let wall = HalfSpace { point: Vector3::new(0.0, 0.0, top + spare), normal: Vector3::new(0.0, 0.0, -1.0) };
        let scene = Scene::new(vec![], vec![wall], vec![], vec![]);
        (robot, plan, LoadedScene { scene, margin: None, hash: 0 })
    }

    #[test]
    fn the_default_margin_is_the_expected_deviation_of_the_robot() {
        let (robot, _, mut loaded) = towards_wall(0.0);
        assert_eq!(planning_margin_mm(&robot, &loaded), 4.82);
        loaded.margin = Some(0.5);
        assert_eq!(planning_margin_mm(&robot, &loaded), 0.5);
    }

    #[test]
    fn a_plan_beside_a_wall_gives_a_warning_with_the_share_that_touches_it() {
        let (robot, plan, loaded) = towards_wall(0.02);
        let warning = near_obstacle(&plan, &robot, &loaded, 0.02).unwrap();
        assert_eq!((warning.code.as_str(), warning.value), (NEAR_OBSTACLE, 0.02));
        let before = warning.message.split(" of 100 simulated").next().unwrap();
        let count: usize = before.rsplit(' ').next().unwrap().parse().unwrap();
        assert!((30..70).contains(&count), "{}", warning.message);
        assert_eq!(near_obstacle(&plan, &robot, &loaded, 0.02).unwrap(), warning);
        let (robot, plan, loaded) = towards_wall(4.5);
        let far = near_obstacle(&plan, &robot, &loaded, 4.5).unwrap();
        assert!(far.message.contains(": 0 of 100 simulated growths"), "{}", far.message);
        assert_eq!(near_obstacle(&plan, &robot, &loaded, 5.0), None);
    }
}
