//! Scenes of obstacles, the certified clearance of a growing body in them, and paths through them.
//!
//! - [`scene_file`]: scene files, with meshes and clouds in their own files ([`read`]);
//! - [`scene`]: the distance of a point from the obstacles, which are [`shapes`] in [`bvh`]s;
//! - [`centreline`]: centrelines of arcs and lines; [`clearance`]: proof that a centreline is clear of the obstacles;
//!   [`path_clearance`]: the same for a path that may also contain helicoidal arcs;
//! - [`closest_approach`]: the point at which a body is nearest to the obstacles; [`obstacle_selection`]: the part of a
//!   scene that views show;
//! - [`scene_summary`]: the content of a scene in numbers;
//! - [`planner`]: a path through a scene, or the proof that none exists;
//! - [`demo_scenes`]: random scenes for experiments;
//! - [`random_scenes`]: random scenes for tests and measurements.
//!
//! Lengths are in mm, angles in radians. All results are the same on every machine.
//!
//! ```
//! use growbot_scene::clearance::RequiredClearance;
//! use growbot_scene::centreline::TipPose;
//! use growbot_scene::planner::{PlannerGoal, PlanningProblem, SearchBudget, SearchOutcome, search};
//! use growbot_scene::scene::Scene;
//! use growbot_scene::shapes::Shape;
//! use nalgebra::Vector3;
//!
//! // A ball of 100 mm in the middle of the way.
//! let ball = Shape::Ball { centre: Vector3::new(0.0, 0.0, 400.0), radius: 100.0 };
//! let scene = Scene::new(vec![ball], vec![], vec![], vec![]);
//! let problem = PlanningProblem {
//!     scene: &scene,
//!     start: TipPose { position: Vector3::zeros(), direction: Vector3::z() },
//!     goal: PlannerGoal::Position { at: Vector3::new(0.0, 0.0, 800.0), tolerance: 0.0 },
//!     radius: 100.0,
//!     required_clearance: RequiredClearance { distance: 28.0, tolerance: 0.03 },
//!     max_length: 2000.0,
//!     accept: &|_| true,
//! };
//! let budget = SearchBudget { max_queries: 200_000, deadline: None, stop_at_first: false };
//! let SearchOutcome::Found(path) = search(&problem, &budget, &mut |_| ()) else { panic!() };
//! assert!(path.length < 860.0);
//! ```
#![forbid(unsafe_code)]

pub mod bvh;
pub mod centreline;
pub mod clearance;
pub mod closest_approach;
pub mod demo_scenes;
pub mod obstacle_selection;
pub mod path_clearance;
pub mod planner;
pub mod random_scenes;
pub mod read;
pub mod scene;
pub mod scene_file;
pub mod scene_summary;
pub mod shapes;
