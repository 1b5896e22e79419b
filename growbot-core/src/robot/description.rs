//! The fields of a robot file. Names contain the units.

use heapless::String;
use serde::{Deserialize, Serialize};

use super::BoardDescription;

/// A robot as described in its file, before the checks of [`super::Robot::new`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct RobotDescription {
    /// The robot's name: letters, digits and hyphens.
    #[cfg_attr(feature = "schema", schemars(with = "str", extend("pattern" = "^[a-z0-9-]+$", "maxLength" = 32)))]
    pub name: String<32>,
    /// Radius that plans use unless the user requests another, mm.
    pub planning_radius_mm: f64,
    /// True if this is a test bench under supervision. A test bench heats even if a debug probe is attached. A robot
    /// that grows must not.
    #[serde(default)]
    pub test_bench: bool,
    /// The controller board and its pins. By default any board, with its own pins.
    #[serde(default)]
    pub board: Option<BoardDescription>,
    /// The sizes that bound the curvature.
    pub geometry: Geometry,
    /// One layer of material and its limits.
    pub layer: LayerDescription,
    /// The printed wall.
    pub wall: Wall,
    /// The wall's material. Default: PLA.
    #[serde(default)]
    pub material: Material,
    /// The mass at the body's end.
    #[serde(default)]
    pub tip: Tip,
    /// The motion of both steppers.
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
    /// The nozzle's temperature in a pause.
    #[serde(default)]
    pub pause: Pause,
    /// The supply of heater and motors.
    #[serde(default)]
    pub supply: Supply,
    /// The sensors beyond thermistor and index sensor. Default: none.
    #[serde(default)]
    pub sensors: Sensors,
}

/// The sizes that bound the curvature (Eq 7).
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
    /// Mean height of a full layer, mm.
    pub height_mm: f64,
    /// Min height that prints well, on the inner side of a bend, mm.
    pub height_min_mm: f64,
    /// Max height, on the outer side of a bend, mm.
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

/// Method of varying the material round a turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum FeedStrategy {
    /// The head turns at constant speed, and the feed is modulated.
    Feed,
    /// The feed is constant, and the head turns more slowly where the layer needs more material.
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

/// The motion of both steppers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Motion {
    /// Rate of the step interrupt, Hz. A step pulse is high for one tick and low for at least one. A board reaches at
    /// most 100 kHz. A robot that needs a higher rate can only be simulated.
    pub tick_hz: u32,
    /// Method of varying the material round a turn.
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
    /// Configuration of the head's TMC2209, on a board that has them.
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
    /// Configuration of the feed's TMC2209, on a board that has them.
    #[serde(default)]
    pub driver: Option<DriverSettings>,
}

/// Configuration of a TMC2209 stepper driver.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct DriverSettings {
    /// Current of a motor's phase, A rms.
    pub current_a: f64,
    /// Chopper mode of the driver.
    #[serde(default)]
    pub mode: ChopperMode,
    /// Microsteps in a full step of the motor: a power of two up to 256. `steps_per_turn` and `steps_per_mm` include
    /// them.
    #[serde(default = "defaults::microsteps")]
    pub microsteps: u16,
    /// Load at which the motor counts as stalled, from the driver's SGTHRS: 0 for never, 255 for very early. It is
    /// allowed only in StealthChop. Without it, the board does not check for stalls.
    #[serde(default)]
    pub stall_threshold: Option<u8>,
    /// Resistance of the sense resistors on the board, ohm.
    #[serde(default = "defaults::sense_ohm")]
    pub sense_ohm: f64,
}

impl DriverSettings {
    /// Creates a configuration with a current, A rms, and the defaults of all other fields.
    #[must_use]
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
    #[must_use]
    pub fn max_current_a(&self) -> f64 {
        0.325 / (self.sense_ohm + 0.02) * core::f64::consts::FRAC_1_SQRT_2
    }
}

/// Chopper mode of a driver, which regulates the motor's current.
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

/// The filament of the robot: a full spool.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Filament {
    /// Length on the spool when growth begins, mm. A plan that needs more has the warning `filament-short`.
    pub spool_mm: f64,
    /// Heat that the nozzle gives to the filament, J/(mm^3 K): density times specific heat. A value of 0 neglects it.
    #[serde(default)]
    pub heat_j_per_mm3_k: f64,
}

/// The nozzle's heater: its limits, the gains of its controller, and the parameters of its thermal model.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Heater {
    /// Temperature while growing, degrees Celsius.
    pub target_c: f64,
    /// Min temperature at which filament is fed, degrees Celsius.
    pub extrusion_min_c: f64,
    /// Max temperature of the nozzle, degrees Celsius. Above it the heater is switched off.
    pub max_c: f64,
    /// Half width of the band round the target in which the nozzle counts as hot, degrees Celsius.
    pub band_c: f64,
    /// Max time from cold to hot, s.
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
    /// Heat loss to the surroundings, W/K.
    pub loss_w_per_k: f64,
}

/// The nozzle's temperature sensor: a thermistor (NTC) to ground below a pull-up resistor, read by a 12-bit ADC.
///
/// The equation of the thermistor is either the Beta equation (`r25_ohm` and `beta_k`) or that of Steinhart and Hart.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Thermistor {
    /// Resistance at 25 degrees Celsius, ohm.
    #[serde(default)]
    pub r25_ohm: Option<f64>,
    /// Beta, K.
    #[serde(default)]
    pub beta_k: Option<f64>,
    /// Coefficients A (1/K), B (1/K) and C (1/K) of `1/T = A + B ln R + C (ln R)^3`, with R in ohm.
    #[serde(default)]
    pub steinhart_hart: Option<[f64; 3]>,
    /// Pull-up resistor, ohm.
    pub pull_up_ohm: f64,
}

/// The fan that cools the print.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Fan {
    /// Duty while growing, 0 to 1. A value of 0 means that the robot has no fan.
    pub growing_duty: f64,
    /// Heat that the fan takes from the nozzle at full duty, W/K, in addition to [`Heater::loss_w_per_k`].
    pub loss_w_per_k: f64,
}

/// The nozzle's temperature in a pause.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Pause {
    /// Standby temperature of the nozzle, degrees Celsius. If [`Heater::target_c`] is lower, that is used.
    pub standby_c: f64,
    /// Time from the beginning of the pause to standby, s.
    pub standby_after_s: f64,
    /// Time from the beginning of the pause until the board parks with its heater off, s.
    pub off_after_s: f64,
}

/// The supply of heater and motors, read by a 12-bit ADC behind a divider.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Supply {
    /// Voltage at which the heater has [`Heater::power_w`], V.
    pub nominal_v: f64,
    /// Min voltage, V. Below it the board switches everything off.
    pub min_v: f64,
    /// Max voltage, V. Above it the board switches everything off.
    pub max_v: f64,
    /// Voltage at the ADC's full scale, V.
    pub full_scale_v: f64,
}

/// The sensors of a robot beyond thermistor and index sensor, with their wiring.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct Sensors {
    /// Switch that closes if there is filament.
    pub filament_presence: Option<DigitalInput>,
    /// Encoder that the filament turns.
    pub filament_motion: Option<FilamentMotion>,
    /// Fault outputs of the stepper drivers, joined.
    pub driver_fault: Option<DigitalInput>,
    /// Emergency-stop button.
    pub emergency_stop: Option<DigitalInput>,
    /// True if the board measures the supply's voltage.
    pub supply: bool,
    /// True if the robot has an orientation sensor.
    pub orientation: bool,
}

/// An input with two levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct DigitalInput {
    /// True if the active level is low. Active means filament present, a driver's fault, or the button pressed.
    pub active_low: bool,
}

/// An encoder that the filament turns.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct FilamentMotion {
    /// Length of filament from one rising edge to the next, mm.
    pub mm_per_pulse: f64,
    /// Length of filament fed without an edge at which the filament counts as jammed, mm.
    pub jam_mm: f64,
}

impl Default for Material {
    /// Printed PLA: 2.3 GPa along a print, and 30 MPa from layer to layer.
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

/// Defaults of fields that are absent from a file.
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
