//! Simulation of plans without a robot: layer by layer, with disturbances, in open or in closed loop, once or a million
//! times.
//!
//! The physics and the loop are in growbot-core ([`growbot_core::simulation`]). This module applies them to a plan
//! ([`Simulation`]). [`campaign`] repeats them with many seeds, and [`statistics`] summarizes the results.
//! [`json`] has both as JSON, with the errors of the simulation ([`disturbance_report`]), and
//! [`samples_table`] has a row for each growth.

pub mod campaign;
pub mod disturbance_report;
pub mod json;
pub mod obstacles;
pub mod samples_table;
pub mod statistics;

use growbot_core::angle::wrap_positive;
use growbot_core::kinematics::advance;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::LayerBytes;
use growbot_core::pose::{Frame, Pose, tip_direction};
use growbot_core::robot::Robot;
use growbot_core::simulation::{
    Disturbance, DisturbedLayer, GrownBody, GrowthTask, RootStress, SaggingBody, SimulatedSensors,
    grow_closed_loop_while, grow_open_loop,
};
use growbot_core::slicing::{SlicedLayers, Slicing, layers};
use growbot_plan::arrival::Arrival;
use growbot_plan::clearance_guard::SceneContext;
use growbot_plan::plan::Plan;
use growbot_plan::warning::Warning;
use growbot_scene::scene_file::LoadedScene;
use serde::{Deserialize, Serialize};

use self::obstacles::{ContactDetector, GuardedGrowth, ObstacleReport};

/// Code of the warning for a root that would break under the body's weight. The value of the warning is the greatest
/// stress, and its limit is the strength of the plastic, MPa.
pub const ROOT_FAILS: &str = "root-fails";
/// Code of the warning for a body that sags beyond the range of the model. The value of the warning is the deflection
/// of the tip, and its limit is a tenth of the path's length, mm.
pub const LARGE_SAG: &str = "sags-far";

/// Maximum sag in the range of the small-deflection model, as a fraction of the path's length.
const SMALL_SAG: f64 = 0.1;

/// A growth that can be simulated with any seed.
#[derive(Debug, Clone)]
pub struct Simulation<'a> {
    task: GrowthTask<'a>,
    /// Length of the path, mm.
    path_length: f64,
    /// Layers that the plan consists of, which an open-loop growth lays.
    layers: SlicedLayers<'a>,
    /// Disturbance of the layers.
    pub disturbance: Disturbance,
    /// Sensors of a closed-loop growth. `None` for an open-loop growth.
    pub sensors: Option<SimulatedSensors>,
    /// True if the body sags under its own weight.
    pub sag: bool,
    /// Scene with the obstacles around the growth. `None` without obstacles. A closed-loop growth avoids the obstacles.
    /// Contacts are computed for the body as it was laid, without its sag.
    pub scene: Option<&'a LoadedScene>,
    /// Radius of the bends of detours, mm.
    radius: f64,
    /// Layers of the body at whose tip the growth begins.
    existing_layers: &'a [LayerBytes],
}

/// Result of a simulated growth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulationResult {
    /// The body that was grown.
    pub grown: GrownBody,
    /// Pose of the tip and its errors from the goal.
    pub arrival: Arrival,
    /// Sag of the body. `None` if sag is not simulated.
    pub sag: Option<SagResult>,
    /// Result among the obstacles of a scene. `None` without a scene.
    pub obstacles: Option<ObstacleReport>,
}

/// Sag of a body.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SagResult {
    /// Distance of the tip from its position without weight, mm.
    pub deflection: f64,
    /// Stress at the root of the body.
    pub root: RootStress,
}

impl<'a> Simulation<'a> {
    /// Creates an undisturbed growth of this plan in open loop, with this slicing.
    pub fn new(plan: &'a Plan, robot: &'a Robot, slicing: Slicing) -> Self {
        Self {
            task: GrowthTask { robot, start: plan.start, path: &plan.path, legs: &plan.legs },
            path_length: plan.requirements.length,
            layers: layers(&plan.path, robot, slicing),
            disturbance: Disturbance::default(),
            sensors: None,
            sag: false,
            scene: None,
            radius: plan.radius,
            existing_layers: &plan.existing_layers,
        }
    }

    /// Simulates the growth. The same seed gives the same growth, to the bit.
    ///
    /// ```
    /// use growbot_core::{plan::Planner, slicing::Slicing};
    /// use growbot_plan::{plan::Plan, pose_text::parse_pose, robot_file};
    /// use growbot_sim::simulation::Simulation;
    /// let robot = robot_file::load("growbot-a".as_ref()).unwrap();
    /// let (start, goal) = (parse_pose("0,0,0,0,90").unwrap(), parse_pose("200,100,600,0,45").unwrap());
    /// let plan = Plan::new(&robot, &start, &goal, 100.0, Planner::Shortest).unwrap();
    ///
    /// let mut simulation = Simulation::new(&plan, &robot, Slicing::Exact);
    /// assert!(simulation.run(1).arrival.normalized_position_error < 1e-9);
    /// simulation.disturbance.growth_noise = 0.1;
    /// assert!(simulation.run(1).arrival.normalized_position_error > 1e-6);
    /// assert_eq!(simulation.run(1), simulation.run(1));
    /// ```
    pub fn run(&self, seed: u64) -> SimulationResult {
        self.run_by_layer(seed, |_| ())
    }

    /// Like [`Self::run`], and calls `each` with every layer as it was laid. The result contains the sag of the body,
    /// the layers do not.
    pub fn run_by_layer(&self, seed: u64, mut each: impl FnMut(&DisturbedLayer)) -> SimulationResult {
        let Self { task, disturbance, .. } = self;
        let base_from_start = task.start.frame();
        let mut hanging = self.sag.then(|| SaggingBody::new(task.robot, &base_from_start));
        let mut touching = self.scene.map(|loaded| ContactDetector::new(&loaded.scene, task.robot, base_from_start));
        let mut each = |laid: &DisturbedLayer| {
            each(laid);
            if let Some(touching) = &mut touching {
                touching.lay(laid);
            }
            if let Some(hanging) = &mut hanging {
                hanging.add_layer(laid);
            }
            hanging.as_ref().map(SaggingBody::base_from_tip)
        };
        let around = self
            .scene
            .map(|loaded| SceneContext::new(task.robot, loaded, self.radius).after_layers(self.existing_layers));
        let (mut grown, kept) = match &self.sensors {
            None => {
                let layers = self.layers.clone().map(|sliced| sliced.layer);
                (
                    grow_open_loop(&task.start, layers, disturbance, seed, |laid| {
                        each(laid);
                    }),
                    None,
                )
            }
            // The sensors measure the body with its sag after each layer.
            Some(sensors) => {
                let mut keeping =
                    around.as_ref().map(|around| GuardedGrowth::new(around, sensors.measured_quantities()));
                let tip = |_: &Layer, laid: &DisturbedLayer, by_growth: &Frame| each(laid).unwrap_or(*by_growth);
                let grown = grow_closed_loop_while(task, disturbance, sensors, seed, tip, |tracker, laid| {
                    keeping.as_mut().is_none_or(|keeping| keeping.check_correction(tracker, laid))
                });
                (grown, keeping)
            }
        };
        let hung = hanging.map(|hanging| {
            grown.base_from_tip = hanging.base_from_tip();
            SagResult { deflection: hanging.deflection(), root: hanging.root_stress() }
        });
        let among = touching.map(|touching| match kept {
            Some(GuardedGrowth { detours, paused, .. }) => ObstacleReport { detours, paused, ..touching.among },
            None => touching.among,
        });
        let arrival = Arrival::of(&grown.base_from_tip, &task.goal(), self.path_length);
        SimulationResult { grown, arrival, sag: hung, obstacles: among }
    }

    /// Returns the start pose.
    pub fn start(&self) -> Pose {
        self.task.start
    }

    /// Returns the goal.
    pub fn goal(&self) -> Pose {
        self.task.goal()
    }

    /// Returns the length of the planned path, mm.
    pub fn path_length(&self) -> f64 {
        self.path_length
    }

    /// Returns layers that chain (Eq 4) to the body as it lies after the growth. These layers have no twist: the twist
    /// of the laid layers is contained in their angles, and the sag in their directions. `laid` are the layers that
    /// [`Self::run_by_layer`] passes to `each`.
    ///
    /// Twist turns the angles of all later layers. Sag turns the directions of the layers, but their lengths stay as
    /// laid. Therefore the end of the returned layers differs from the position of the sagging tip ([`SaggingBody`], a
    /// first-order model) by some percent of the sag.
    pub fn layers_as_laid(&self, laid: &[DisturbedLayer]) -> Vec<Layer> {
        if !self.sag {
            let mut twist = 0.0;
            let layers = laid.iter().map(|DisturbedLayer { layer, twist: more }| {
                let layer = Layer { alpha: wrap_positive(layer.alpha + twist), ..*layer };
                twist += more;
                layer
            });
            return layers.collect();
        }
        let mut tip = self.task.start.frame();
        let mut directions = Vec::with_capacity(laid.len());
        SaggingBody::frames_of(self.task.robot, &tip, laid, |frame| directions.push(tip_direction(&frame)));
        let layers = laid.iter().zip(directions).map(|(laid, direction)| {
            let towards = tip.inverse_transform_vector(&direction);
            let across = libm::hypot(towards.x, towards.y);
            let alpha = libm::atan2(-towards.y, -towards.x);
            let tilt = libm::atan2(across, towards.z);
            let layer = Layer { alpha: wrap_positive(alpha), height: laid.layer.height, tilt };
            tip = advance(&tip, &layer.step());
            layer
        });
        layers.collect()
    }

    /// Returns the warnings for a body with this sag.
    pub fn warnings(&self, hung: &SagResult) -> Vec<Warning> {
        let mut found = Vec::new();
        let (stress, strength) = (hung.root.stress, self.task.robot.description().material.strength_mpa);
        if stress > strength {
            let message = format!(
                "the root fails: with {:.0} mm of body it bears {stress:.1} MPa, more than the {strength:.1} MPa of \
                 material.strength_mpa: grow less far sideways, support the body, or make the wall thicker \
                 (wall.width_mm)",
                hung.root.length
            );
            found.push(Warning { code: ROOT_FAILS.to_owned(), message, value: stress, limit: strength });
        }
        let small = SMALL_SAG * self.path_length;
        if hung.deflection > small {
            let message = format!(
                "the tip sags by {:.0} mm, more than 10 % of the path: this exceeds the range of the small-deflection \
                 model, so treat it as a rough estimate",
                hung.deflection
            );
            found.push(Warning { code: LARGE_SAG.to_owned(), message, value: hung.deflection, limit: small });
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use growbot_core::layer::grow;
    use growbot_core::plan::Planner;
    use growbot_plan::pose_text::parse_pose;
    use growbot_plan::robot_file;

    use super::*;

    fn plan(robot: &Robot, from: &str, to: &str) -> Plan {
        let (start, goal) = (parse_pose(from).unwrap(), parse_pose(to).unwrap());
        Plan::new(robot, &start, &goal, robot.description().planning_radius_mm, Planner::Shortest).unwrap()
    }

    #[test]
    fn without_noise_every_robot_reaches_the_goal() {
        for name in robot_file::names() {
            let robot = robot_file::load(name.as_ref()).unwrap();
            let radius = robot.description().planning_radius_mm;
            for [x, y, z, heading, pitch] in [[2.0, 1.0, 6.0, 30.0, 45.0], [-8.0, 5.0, -20.0, -100.0, -30.0]] {
                let goal = Pose::from_degrees([x * radius, y * radius, z * radius, heading, pitch]).unwrap();
                for planner in [Planner::Shortest, Planner::TwoPlane] {
                    let start = parse_pose("0,0,0,0,90").unwrap();
                    let plan = Plan::new(&robot, &start, &goal, radius, planner).unwrap();
                    let arrival = Simulation::new(&plan, &robot, Slicing::Exact).run(1).arrival;
                    assert!(arrival.normalized_position_error <= 1e-9, "{name}: {arrival:?}");
                    assert!(arrival.direction_error_deg.to_radians() <= 1e-9, "{name}: {arrival:?}");
                }
            }
        }
    }

    #[test]
    fn whole_steps_overshoot_the_goal_by_up_to_one_step() {
        let robot = robot_file::load("growbot-a".as_ref()).unwrap();
        let plan = plan(&robot, "0,0,0,0,90", "0,0,100,0,90");
        // 32.3 steps, rounded up: 33 of them are 102.168 mm.
        let outcome = Simulation::new(&plan, &robot, Slicing::Whole { step: 3.096 }).run(1);
        assert_eq!(outcome.grown.layers, 33);
        assert!((outcome.arrival.position_error_mm - 2.168).abs() < 1e-9, "{outcome:?}");
        assert!((outcome.arrival.normalized_position_error - 0.021_68).abs() < 1e-11);
        assert_eq!(outcome.arrival.direction_error_deg, 0.0);
    }

    #[test]
    fn a_horizontal_body_sags_and_a_long_one_breaks() {
        let robot = robot_file::load("growbot-a".as_ref()).unwrap();
        for (length, code) in [(1000.0, None), (8000.0, Some(ROOT_FAILS))] {
            let plan = plan(&robot, "0,0,0,0,0", &format!("{length},0,0,0,0"));
            let mut simulation = Simulation::new(&plan, &robot, Slicing::Exact);
            simulation.sag = true;
            let outcome = simulation.run(1);
            let hung = outcome.sag.unwrap();
            assert!((outcome.arrival.position_error_mm - hung.deflection).abs() < 1e-9 * length);
            let codes: Vec<String> = simulation.warnings(&hung).into_iter().map(|warning| warning.code).collect();
            assert_eq!(codes.first().map(String::as_str), code, "{hung:?}");
        }
    }

    #[test]
    fn layers_as_laid_lead_to_the_tip_of_a_twisted_body() {
        let robot = robot_file::load("growbot-a".as_ref()).unwrap();
        let plan = plan(&robot, "0,0,0,0,90", "200,100,600,0,45");
        let mut simulation = Simulation::new(&plan, &robot, Slicing::Exact);
        simulation.disturbance = Disturbance { twist_bias: 0.01, twist_noise: 0.02, ..Disturbance::default() };
        let mut laid = Vec::new();
        let outcome = simulation.run_by_layer(1, |layer| laid.push(*layer));
        let tip = grow(&plan.start.frame(), simulation.layers_as_laid(&laid)).translation.vector;
        assert!((tip - outcome.grown.base_from_tip.translation.vector).norm() < 1e-9 && laid[5].twist != 0.0);
        assert!(outcome.arrival.position_error_mm > 10.0, "{outcome:?}");
    }

    #[test]
    fn layers_as_laid_of_a_sagging_body_hang_with_its_tip() {
        let robot = robot_file::load("growbot-a".as_ref()).unwrap();
        let plan = plan(&robot, "0,0,0,0,0", "1000,0,0,0,0");
        let mut simulation = Simulation::new(&plan, &robot, Slicing::Exact);
        (simulation.sag, simulation.disturbance.twist_bias) = (true, 0.01);
        let mut laid = Vec::new();
        let outcome = simulation.run_by_layer(1, |layer| laid.push(*layer));
        let tip = grow(&plan.start.frame(), simulation.layers_as_laid(&laid)).translation.vector;
        let (off, sag) =
            ((tip - outcome.grown.base_from_tip.translation.vector).norm(), outcome.sag.unwrap().deflection);
        assert!(sag > 5.0 && off < 0.05 * sag, "{off} mm of {sag} mm");
    }

    #[test]
    fn feedback_compensates_sag() {
        let robot = robot_file::load("growbot-a".as_ref()).unwrap();
        let plan = plan(&robot, "0,0,0,0,0", "1500,0,200,0,0");
        let mut simulation = Simulation::new(&plan, &robot, Slicing::Exact);
        simulation.sag = true;
        let open = simulation.run(1).arrival.position_error_mm;
        let noise = growbot_core::tracking::SensorNoise { odometry: 0.01, direction: 0.01 };
        simulation.sensors = Some(SimulatedSensors { noise, odometry_scale: 0.0, direction: Default::default() });
        let closed = simulation.run(1).arrival.position_error_mm;
        assert!(closed < open, "{closed} {open}");
    }
}
