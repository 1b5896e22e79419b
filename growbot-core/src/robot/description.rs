//! What a robot file says, field by field: the units are in the names.

use heapless::String;
use serde::{Deserialize, Serialize};

/// A robot as written in its file, not yet checked (see [`super::Robot::new`]).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotDescription {
    /// The robot's name: letters, digits and hyphens.
    pub name: String<32>,
    /// The radius that plans use unless another is asked for, mm.
    pub planning_radius_mm: f64,
    /// The sizes that bound the curvature.
    pub geometry: Geometry,
    /// One layer of material and its limits.
    pub layer: LayerDescription,
    /// The printed wall.
    pub wall: Wall,
    /// How both steppers are driven.
    pub motion: Motion,
    /// The head, which turns the nozzle round the deposition plane.
    pub head: Head,
    /// The feed, which pushes filament.
    pub feed: Feed,
    /// The filament that it has.
    pub filament: Filament,
    /// The nozzle's heater.
    pub heater: Heater,
    /// The nozzle's temperature sensor.
    pub thermistor: Thermistor,
}

/// The sizes that bound the curvature (Eq 7).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Geometry {
    /// `r_t`: from the centreline to where material is laid, mm.
    pub tip_radius_mm: f64,
    /// `r_r`: radius of the cylinder round the parts inside the tube, mm.
    pub inner_radius_mm: f64,
    /// `L`: from the deposition plane to the back end of those parts, mm.
    pub inner_length_mm: f64,
}

/// One layer of material and its limits.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LayerDescription {
    /// Mean height of a full layer, mm.
    pub height_mm: f64,
    /// Least height that prints well, on the inner side of a bend, mm.
    pub height_min_mm: f64,
    /// Greatest height, on the outer side of a bend, mm.
    pub height_max_mm: f64,
    /// Greatest tilt of one layer, degrees.
    pub tilt_max_deg: f64,
    /// Time for one layer, which is one turn of the head, s.
    pub period_s: f64,
}

/// The printed wall: a ring of mean radius `r_t`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wall {
    /// Thickness, mm.
    pub width_mm: f64,
}

/// How material is varied round a turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FeedStrategy {
    /// The head turns steadily and the feed is modulated.
    Feed,
    /// The feed is steady and the head turns slower where more material is due.
    Speed,
}

/// How both steppers are driven.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motion {
    /// Rate of the step interrupt, Hz. A step pulse is high for one tick and low for at least one.
    pub tick_hz: u32,
    /// How material is varied round a turn.
    pub strategy: FeedStrategy,
    /// Whether the stepper drivers are enabled by a low level, as most are.
    pub enable_low: bool,
}

/// The head, which turns the nozzle round the deposition plane.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Head {
    /// Motor steps (microsteps included) for one turn of the head.
    pub steps_per_turn: u32,
    /// Whether the direction pin is high for a counter-clockwise turn, seen against the direction of growth.
    pub direction_high_is_positive: bool,
    /// Speed of homing, turns a second.
    pub homing_turns_per_s: f64,
    /// Angle of the head, from the tip's x axis, at the step at which the index sensor first sees the mark in a positive
    /// turn, degrees. Taken to the nearest step.
    pub index_angle_deg: f64,
    /// Whether the index pin is low while the sensor sees the mark, as most are.
    pub index_low_on_mark: bool,
    /// Width of the index mark, degrees.
    pub index_width_deg: f64,
}

/// The feed, which pushes filament.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Feed {
    /// Motor steps (microsteps included) for a mm of filament.
    pub steps_per_mm: f64,
    /// Whether the direction pin is high to push filament out.
    pub direction_high_is_forward: bool,
    /// Diameter of the filament, mm.
    pub filament_diameter_mm: f64,
}

/// The filament that the robot has: a full spool.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Filament {
    /// Length on the spool when growth begins, mm. A plan that needs more is warned of (`filament-short`).
    pub spool_mm: f64,
}

/// The nozzle's heater: limits, regulation, and the figures that a simulation of it takes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Heater {
    /// Temperature while growing, degrees Celsius.
    pub target_c: f64,
    /// Below this no filament is fed, degrees Celsius.
    pub extrusion_min_c: f64,
    /// Above this the heater is cut off, degrees Celsius.
    pub max_c: f64,
    /// The nozzle counts as hot within this distance of the target, degrees.
    pub band_c: f64,
    /// Longest time from cold to hot, s.
    pub heating_timeout_s: f64,
    /// Proportional gain, duty (0 to 1) per degree.
    pub kp: f64,
    /// Integral gain, duty per degree and second.
    pub ki: f64,
    /// Derivative gain, duty per degree a second.
    pub kd: f64,
    /// Power at full duty, W.
    pub power_w: f64,
    /// Heat capacity of the nozzle, J/K.
    pub heat_capacity_j_per_k: f64,
    /// Heat lost to the surroundings, W/K.
    pub loss_w_per_k: f64,
}

/// The nozzle's temperature sensor: a thermistor (NTC) to ground below a pull-up resistor, read by a 12-bit converter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Thermistor {
    /// Resistance at 25 degrees Celsius, ohm.
    pub r25_ohm: f64,
    /// Beta, K.
    pub beta_k: f64,
    /// Pull-up resistor, ohm.
    pub pull_up_ohm: f64,
}
