//! Geometry, planning, layers and link messages of robots that move by growing.
//!
//! Such a robot prints the tube behind its tip, layer by layer, as a root grows. A layer that is higher on one side
//! bends the tube away from that side. Many such layers form a curve, and the tip of the robot is at the end of the
//! curve. This crate computes the layers that lead to a goal pose. It has no I/O, no clock and no heap, and gives the
//! same bits on the desktop and on the robot's microcontroller. The model is that of Del Dottore et al. 2019, Front.
//! Robot. AI 6:45, doi 10.3389/frobt.2019.00045 ("the paper"). Comments at the functions that use an equation of the
//! paper list the errors in its printed form.
//!
//! # Conventions
//!
//! - Millimetres, radians, seconds, degrees Celsius, all `f64`. Only text for people uses degrees. Names of such values
//!   contain the unit, as in `tilt_max_deg` or [`pose::Pose::from_degrees`].
//! - Right-handed frames; counter-clockwise is positive.
//! - A [`pose::Pose`] is a point and a direction: *heading*, the angle in the x-y plane, and *pitch*, the angle above
//!   it. Pitch 90 degrees is straight up. Its roll is 0, unless it is the tip of a body.
//! - A [`pose::Frame`] is named after the conversion that it makes, as in `base_from_tip`, so that products read right:
//!   `base_from_tip * tip_from_next_tip`. The tip's z axis is the direction of growth. x and y span the plane in which
//!   material is laid. Growth carries the frame along without twist.
//! - *alpha* is the angle, from the tip's x axis, of the point of **max deposition**. The tip bends **away** from it.
//! - Errors are small enums that hold the value and the limit. No input panics.
//!
//! # From a goal to layers, in file order
//!
//! | file | what |
//! |---|---|
//! | [`angle`], [`trigonometry`], [`pose`] | angles wrapped; their sines and cosines; poses and frames |
//! | [`kinematics`] | one step of growth (Eq 4), chained (Eq 5) without drift |
//! | [`curvature`], [`robot`] | the tightest bend (Eq 7); a robot's description, checked once |
//! | [`dubins2`], [`two_plane`] | the shortest path in a plane; a path in space of two planar paths |
//! | [`shortest`], [`to_position`] | the shortest path in space to a pose, or to a position |
//! | [`plan`] | a path that is checked to arrive |
//! | [`path`], [`helicoid`] | arcs, straight lines and helicoidal arcs, of which a path consists |
//! | [`slicing`], [`layer`] | the layers of a path; one layer |
//! | [`layer_bytes`], [`job`], [`hash`] | a layer in 12 bytes; a board's job; the hash that identifies it |
//! | [`link`] | frames and messages (PROTOCOL.md) |
//! | [`tracking`] | the closed loop: an estimate of the tip, and a reference trajectory to the goal |
//! | [`simulation`] | layers with errors, bodies that sag |
//! | [`random`] | random numbers that are the same on every machine |
//!
//! ```
//! use growbot_core::layer::grow;
//! use growbot_core::plan::{Planner, goal_error, plan};
//! use growbot_core::pose::Pose;
//! use growbot_core::robot::Robot;
//! use growbot_core::slicing::{Slicing, layers};
//!
//! # let file = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../robots/growbot-a.toml"));
//! // `file` is the text of robots/growbot-a.toml.
//! let robot = Robot::new(toml::from_str(file).unwrap()).unwrap();
//! let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
//! let goal = Pose::from_degrees([200.0, 100.0, 600.0, 0.0, 45.0]).unwrap();
//!
//! let path = plan(&robot, &start, &goal, 100.0, Planner::TwoPlane).unwrap().path;
//! assert_eq!(path.len(), 5);
//!
//! // Laid one on the other, the layers end where the goal is.
//! let layers: Vec<_> = layers(&path, &robot, Slicing::Exact).map(|sliced| sliced.layer).collect();
//! assert_eq!(layers.len(), 833);
//! let base_from_tip = grow(&start.frame(), layers);
//! assert!(goal_error(&base_from_tip, &goal).distance < 1e-9);
//! ```
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod angle;
pub mod compact_number;
pub mod curvature;
#[cfg(feature = "planning")]
pub mod dubins2;
#[cfg(feature = "planning")]
mod float;
pub mod hash;
#[cfg(feature = "planning")]
pub mod helicoid;
#[cfg(feature = "planning")]
pub mod job;
#[cfg(feature = "planning")]
pub mod kinematics;
pub mod layer;
#[cfg(feature = "planning")]
pub mod layer_bytes;
#[cfg(feature = "planning")]
mod linalg5;
#[cfg(feature = "planning")]
pub mod link;
#[cfg(feature = "planning")]
pub mod path;
#[cfg(feature = "planning")]
pub mod plan;
#[cfg(feature = "planning")]
pub mod pose;
#[cfg(feature = "planning")]
pub mod random;
pub mod robot;
#[cfg(feature = "planning")]
pub mod shortest;
#[cfg(feature = "planning")]
pub mod simulation;
#[cfg(feature = "planning")]
pub mod slicing;
#[cfg(test)]
mod testing;
#[cfg(feature = "planning")]
pub mod to_position;
#[cfg(feature = "planning")]
pub mod tracking;
pub mod trigonometry;
#[cfg(feature = "planning")]
pub mod two_plane;
