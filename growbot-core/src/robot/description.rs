//! The fields of a robot file, and the version of their encoding. Names contain the units.

use core::ops::RangeInclusive;

use heapless::String;
use serde::{Deserialize, Serialize};

use super::BoardDescription;

/// Version of the encoding of robot descriptions. It changes whenever a field of [`RobotDescription`] is added,
/// removed, moved or redefined.
pub const ENCODING_VERSION: u8 = 2;

/// A robot as described in its file, before the checks of [`super::Robot::new`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct RobotDescription {
    /// The robot's name: lower-case letters, digits and hyphens.
    #[cfg_attr(feature = "schema", schemars(with = "str", extend("pattern" = "^[a-z0-9-]+$", "maxLength" = 32)))]
    pub name: String<32>,
    /// Radius of the arcs in plans, mm, unless the user requests another radius.
    pub planning_radius_mm: f64,
    /// True if this is a test bench under supervision. A test bench heats even if a debug probe is attached. A robot
    /// that grows must not do so.
    #[serde(default)]
    pub test_bench: bool,
    /// The controller board and its pins. By default the description fits any board, which then uses its default pins.
    #[serde(default)]
    pub board: Option<BoardDescription>,
    /// The sizes of the tip that bound the curvature.
    pub geometry: Geometry,
    /// One layer of material and its limits.
    pub layer: LayerDescription,
    /// The printed wall.
    pub wall: Wall,
    /// The wall's material. Default: PLA.
    #[serde(default)]
    pub material: Material,
    /// The tip at the end of the body, with its mass.
    #[serde(default)]
    pub tip: Tip,
    /// The step interrupt and the motion of the two stepper motors, of head and feed.
    pub motion: Motion,
    /// The head, which turns the nozzle round the deposition plane.
    pub head: Head,
    /// The feed, which pushes filament.
    pub feed: Feed,
    /// The filament.
    pub filament: Filament,
    /// The nozzle's heater.
    pub heater: Heater,
    /// The nozzle's temperature sensor.
    pub thermistor: Thermistor,
    /// The fan that cools the print. Default: no fan.
    #[serde(default)]
    pub fan: Fan,
    /// The temperature of the nozzle in a pause, and the times at which it changes.
    #[serde(default)]
    pub pause: Pause,
    /// The supply of heater and motors.
    #[serde(default)]
    pub supply: Supply,
    /// The sensors in addition to thermistor and index sensor. Default: none.
    #[serde(default)]
    pub sensors: Sensors,
}

/// The sizes of the tip that bound the curvature of the body (Eq 7 of the paper).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Geometry {
    /// `r_t`: distance from the centreline to where material is laid, mm.
    pub tip_radius_mm: f64,
    /// `r_r`: radius of the cylinder round the parts inside the tube, mm.
    pub inner_radius_mm: f64,
    /// `L`: distance from the deposition plane to the back end of the parts inside the tube, mm.
    pub inner_length_mm: f64,
}

/// One layer of material and its limits.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct LayerDescription {
    /// Max mean height of a layer, mm. Layers on tight bends, and layers that divide a segment equally, are lower.
    pub height_mm: f64,
    /// Min height of a layer that prints well, on the inner side of a bend, mm.
    pub height_min_mm: f64,
    /// Max height of a layer, on the outer side of a bend, mm.
    pub height_max_mm: f64,
    /// Max tilt of one layer, degrees.
    pub tilt_max_deg: f64,
    /// Time for one layer, which is one turn of the head, s.
    pub period_s: f64,
}

/// The printed wall: a ring of mean radius `r_t`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Wall {
    /// Thickness of the wall, mm.
    pub width_mm: f64,
}

/// The wall's material, as printed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// Density, g/cm^3.
    pub density_g_per_cm3: f64,
    /// Young's modulus along the body, MPa.
    pub youngs_modulus_mpa: f64,
    /// Bending stress at which the wall fails, MPa. A printed wall fails between its layers.
    pub strength_mpa: f64,
}

/// The tip at the end of the body: head, feed, heater and the other parts inside the tube.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Tip {
    /// Mass of the tip, g.
    pub mass_g: f64,
}

/// Method by which the amount of material per angle varies within a turn of the head.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum FeedStrategy {
    /// The head turns at constant speed, and the speed of the feed varies.
    Feed,
    /// The feed has constant speed, and the head turns more slowly where the layer needs more material.
    Speed,
}

/// Direction in which the head turns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum HeadRotation {
    /// Always counter-clockwise. The wires to the head pass through a slip ring.
    #[default]
    Continuous,
    /// One layer counter-clockwise, the next one clockwise, so that wires never wind up.
    Alternate,
}

/// The step interrupt and the motion of the two stepper motors, of head and feed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Motion {
    /// Rate of the step interrupt, Hz. A step pulse is high for one tick of the interrupt and low for at least one. A
    /// board reaches at most 100 kHz. A robot that needs a higher rate can only be simulated.
    pub tick_hz: u32,
    /// Method by which the amount of material per angle varies within a turn of the head.
    pub strategy: FeedStrategy,
    /// True if a low level enables the stepper drivers. This is the usual wiring.
    pub enable_low: bool,
    /// Direction in which the head turns from layer to layer.
    #[serde(default)]
    pub turning: HeadRotation,
}

/// The head, which turns the nozzle round the deposition plane.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Head {
    /// Motor steps (microsteps included) for one turn of the head.
    pub steps_per_turn: u32,
    /// True if the direction pin is high for a counter-clockwise turn, seen against the direction of growth.
    pub direction_high_is_positive: bool,
    /// Speed of homing, turns a second.
    pub homing_turns_per_s: f64,
    /// Angle of the head, from the tip's x axis, at the step at which the index sensor first detects the mark in a
    /// positive turn, degrees. It is rounded to the nearest step.
    pub index_angle_deg: f64,
    /// True if the index pin is low while the sensor detects the mark. This is the usual wiring.
    pub index_low_on_mark: bool,
    /// Width of the index mark, degrees.
    pub index_width_deg: f64,
    /// Max deviation of an edge of the mark from its expected angle, degrees. A larger deviation means that the head
    /// has lost or gained steps.
    #[serde(default = "defaults::index_tolerance_deg")]
    pub index_tolerance_deg: f64,
    /// Max acceleration, turns/s^2.
    #[serde(default = "defaults::unlimited")]
    pub acceleration_turns_per_s2: f64,
    /// Max instantaneous change of speed, turns/s. Up to this speed the motor needs no ramp.
    #[serde(default = "defaults::unlimited")]
    pub speed_jump_turns_per_s: f64,
    /// Configuration of the head's TMC2209 stepper driver, for boards that have such drivers.
    #[serde(default)]
    pub driver: Option<DriverSettings>,
}

/// The feed, which pushes filament.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Feed {
    /// Motor steps (microsteps included) for a mm of filament.
    pub steps_per_mm: f64,
    /// True if the direction pin is high to push filament out.
    pub direction_high_is_forward: bool,
    /// Diameter of the filament, mm.
    pub filament_diameter_mm: f64,
    /// Max acceleration, mm/s^2 of filament.
    #[serde(default = "defaults::unlimited")]
    pub acceleration_mm_per_s2: f64,
    /// Max instantaneous change of speed, mm/s of filament. Up to this speed the motor needs no ramp.
    #[serde(default = "defaults::unlimited")]
    pub speed_jump_mm_per_s: f64,
    /// Length of filament that is retracted when feeding pauses, and pushed forward again before it continues, mm.
    #[serde(default)]
    pub retract_mm: f64,
    /// Speed at which filament is retracted and pushed forward again, mm/s.
    #[serde(default = "defaults::retract_mm_per_s")]
    pub retract_mm_per_s: f64,
    /// Configuration of the feed's TMC2209 stepper driver, for boards that have such drivers.
    #[serde(default)]
    pub driver: Option<DriverSettings>,
}

/// Configuration of a TMC2209 stepper driver.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct DriverSettings {
    /// Current in each phase of the motor, A rms.
    pub current_a: f64,
    /// Chopper mode of the driver.
    #[serde(default)]
    pub mode: ChopperMode,
    /// Microsteps in a full step of the motor: a power of two up to 256. `steps_per_turn` and `steps_per_mm` include
    /// them.
    #[serde(default = "defaults::microsteps")]
    pub microsteps: u16,
    /// Load at which the motor counts as stalled, as the driver's register SGTHRS: 0 for never, 255 for very early. It
    /// is allowed only in StealthChop. If it is absent, the board does not check for stalls.
    #[serde(default)]
    pub stall_threshold: Option<u8>,
    /// Resistance of the sense resistors on the board, ohm.
    #[serde(default = "defaults::sense_ohm")]
    pub sense_ohm: f64,
}

impl DriverSettings {
    /// Creates a configuration with a current, A rms, and the defaults of all other fields.
    pub fn with_current(current_a: f64) -> Self {
        Self {
            current_a,
            mode: ChopperMode::default(),
            microsteps: defaults::microsteps(),
            stall_threshold: None,
            sense_ohm: defaults::sense_ohm(),
        }
    }

    /// Returns the max current that the sense resistors allow, A rms (data sheet of the TMC2209, rev. 1.09, 9).
    pub fn max_current_a(&self) -> f64 {
        0.325 / (self.sense_ohm + 0.02) * core::f64::consts::FRAC_1_SQRT_2
    }
}

/// Chopper mode of a stepper driver: the method by which it regulates the current of the motor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum ChopperMode {
    /// Regulation by voltage: quiet, and stalls can be detected.
    #[default]
    StealthChop,
    /// Regulation by current: more torque at speed.
    SpreadCycle,
}

/// The filament of the robot, on a full spool.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Filament {
    /// Length of filament on the spool when growth begins, mm. A plan that needs more has the warning `filament-short`.
    pub spool_mm: f64,
    /// Heat that the nozzle gives to the filament, per volume and temperature rise, J/(mm^3 K): density times specific
    /// heat. A value of 0 neglects it.
    #[serde(default)]
    pub heat_j_per_mm3_k: f64,
}

/// The nozzle's heater: its limits, the gains of its controller, and the parameters of its thermal model.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Heater {
    /// Target temperature of the nozzle while growing, degrees Celsius.
    pub target_c: f64,
    /// Min temperature at which filament is fed, degrees Celsius.
    pub extrusion_min_c: f64,
    /// Max temperature of the nozzle, degrees Celsius. Above it the heater is switched off.
    pub max_c: f64,
    /// Half width of the band round the target temperature in which the nozzle counts as hot, degrees Celsius.
    pub band_c: f64,
    /// Max time in which the nozzle must heat up from cold to the target temperature, s.
    pub heating_timeout_s: f64,
    /// Proportional gain of the heater's controller, duty (0 to 1) per degree.
    pub kp: f64,
    /// Integral gain of the heater's controller, duty per degree and per second.
    pub ki: f64,
    /// Derivative gain of the heater's controller, duty per (degree per second).
    pub kd: f64,
    /// Power of the heater at full duty, W.
    pub power_w: f64,
    /// Heat capacity of the nozzle, J/K.
    pub heat_capacity_j_per_k: f64,
    /// Heat loss of the nozzle to the surroundings, W/K.
    pub loss_w_per_k: f64,
}

impl Heater {
    /// Min temperature to which the nozzle is heated for maintenance, degrees Celsius.
    const MIN_PREHEAT_C: f64 = 50.0;
    /// Min distance of a target temperature below `max_c`, degrees.
    pub(super) const TARGET_MARGIN_C: f64 = 5.0;

    /// Returns the temperatures to which the nozzle may be heated for maintenance, degrees Celsius.
    pub fn preheat_range_c(&self) -> RangeInclusive<f64> {
        Self::MIN_PREHEAT_C..=self.max_c - Self::TARGET_MARGIN_C
    }
}

/// The nozzle's temperature sensor: a thermistor (NTC) to ground below a pull-up resistor, read by a 12-bit ADC.
///
/// The equation of the thermistor is either the Beta equation (`r25_ohm` and `beta_k`) or that of Steinhart and Hart.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Thermistor {
    /// Resistance of the thermistor at 25 degrees Celsius, ohm.
    #[serde(default)]
    pub r25_ohm: Option<f64>,
    /// Coefficient Beta of the thermistor, K.
    #[serde(default)]
    pub beta_k: Option<f64>,
    /// Coefficients A (1/K), B (1/K) and C (1/K) of `1/T = A + B ln R + C (ln R)^3`, with R in ohm.
    #[serde(default)]
    pub steinhart_hart: Option<[f64; 3]>,
    /// Resistance of the pull-up resistor, ohm.
    pub pull_up_ohm: f64,
}

/// The fan that cools the print.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Fan {
    /// Duty of the fan while growing, 0 to 1. A value of 0 means that the robot has no fan.
    pub growing_duty: f64,
    /// Heat that the fan takes from the nozzle at full duty, W/K, in addition to [`Heater::loss_w_per_k`].
    pub loss_w_per_k: f64,
}

/// The temperature of the nozzle in a pause, and the times at which it changes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Pause {
    /// Standby temperature of the nozzle in a pause, degrees Celsius. If [`Heater::target_c`] is lower, the nozzle has
    /// that temperature.
    pub standby_c: f64,
    /// Time from the beginning of a pause to standby, s.
    pub standby_after_s: f64,
    /// Time from the beginning of a pause until the board switches the heater off and parks (state `Parked`), s.
    pub off_after_s: f64,
}

/// The supply of heater and motors, whose voltage a 12-bit ADC measures behind a divider.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Supply {
    /// Nominal supply voltage, at which the heater has the power [`Heater::power_w`], V.
    pub nominal_v: f64,
    /// Min supply voltage, V. Below it the board switches everything off.
    pub min_v: f64,
    /// Max supply voltage, V. Above it the board switches everything off.
    pub max_v: f64,
    /// Supply voltage at which the ADC reads its full scale, V.
    pub full_scale_v: f64,
}

/// The sensors of a robot in addition to thermistor and index sensor, with their wiring.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct Sensors {
    /// Switch that closes if there is filament.
    pub filament_presence: Option<DigitalInput>,
    /// Encoder that the filament turns.
    pub filament_motion: Option<FilamentMotion>,
    /// Fault outputs of the stepper drivers, joined on one wire.
    pub driver_fault: Option<DigitalInput>,
    /// Emergency-stop button.
    pub emergency_stop: Option<DigitalInput>,
    /// True if the board measures the supply's voltage.
    pub supply: bool,
    /// True if the robot has an orientation sensor.
    pub orientation: bool,
}

/// A digital input of a sensor or a button.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct DigitalInput {
    /// True if the active level of the input is low. Active means filament present, a driver's fault, or the button
    /// pressed.
    pub active_low: bool,
}

/// An encoder that the filament turns, to detect that the filament moves.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct FilamentMotion {
    /// Length of filament from one rising edge of the encoder's signal to the next, mm.
    pub mm_per_pulse: f64,
    /// Length of filament that is fed without an edge of the encoder's signal until the filament counts as jammed, mm.
    pub jam_mm: f64,
}

impl Default for Material {
    /// Returns the values of printed PLA: 2.3 GPa along the body, and a strength of 30 MPa between layers.
    fn default() -> Self {
        Self { density_g_per_cm3: 1.24, youngs_modulus_mpa: 2300.0, strength_mpa: 30.0 }
    }
}

impl Default for Tip {
    fn default() -> Self {
        Self { mass_g: 150.0 }
    }
}

impl Default for Pause {
    fn default() -> Self {
        Self { standby_c: 150.0, standby_after_s: 60.0, off_after_s: 300.0 }
    }
}

impl Default for Supply {
    fn default() -> Self {
        Self { nominal_v: 12.0, min_v: 10.0, max_v: 14.0, full_scale_v: 36.3 }
    }
}

/// Defaults of fields that are absent from a robot file.
mod defaults {
    /// Returns a limit that no robot reaches.
    pub fn unlimited() -> f64 {
        1e9
    }

    pub fn index_tolerance_deg() -> f64 {
        2.0
    }

    pub fn retract_mm_per_s() -> f64 {
        5.0
    }

    pub fn microsteps() -> u16 {
        16
    }

    pub fn sense_ohm() -> f64 {
        0.11
    }
}
