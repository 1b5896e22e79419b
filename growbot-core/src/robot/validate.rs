//! The checks of a robot description, in the order in which a person would correct the errors.

use super::checked_field::{CheckedField, MAX_SIZE, MIN_SIZE, advice};
use super::driver_settings;
use super::step_rate::{AxisMotion, BusiestSector, LayerMotion, MAX_RAMP_S};
use super::{Feed, Head, Heater, Material, Motion, RobotDescription, RobotError};
use crate::angle::radians;
use crate::curvature::{min_radius_by_layers, min_radius_by_packaging};
use crate::layer::{Layer, SECTORS};

/// Value that stands for no limit. An optional limit has this value if the robot file omits it.
const UNLIMITED: f64 = 1e9;

/// Max rate of the step interrupt on a board, Hz. At 112 kHz the step interrupt uses half of the processor of the
/// robot's board (`cargo step-cost`).
pub const MAX_BOARD_TICK_HZ: u32 = 100_000;

/// Checks the whole description, and returns the first defect as an error.
pub(super) fn check(robot: &RobotDescription) -> Result<(), RobotError> {
    let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    if robot.name.is_empty() || !robot.name.chars().all(plain) {
        return Err(RobotError::Name);
    }
    check_geometry(robot)?;
    check_material(robot)?;
    check_layer(robot)?;
    check_radius(robot)?;
    check_motors(robot)?;
    check_heater(robot)?;
    check_thermistor(robot)?;
    check_fan_and_pause(robot)?;
    check_sensors(robot)?;
    check_board(robot)?;
    check_step_rates(robot)?;
    check_accelerations(robot)
}

/// Checks the requirement of a board that [`check`] does not contain: the max rate of the step interrupt.
///
/// `motion.tick_hz` has two limits, because a description has two uses. A plan or a simulation may be of a robot that
/// needs more ticks than any board makes, for example the paper's robot C. For these uses the limit is 1 MHz, which
/// only excludes absurd numbers. On a board the step interrupt must leave processor time for everything else, so the
/// limit is [`MAX_BOARD_TICK_HZ`].
pub(super) fn check_for_board(robot: &RobotDescription) -> Result<(), RobotError> {
    CheckedField("motion.tick_hz", f64::from(robot.motion.tick_hz)).between(
        0.0,
        f64::from(MAX_BOARD_TICK_HZ),
        advice(
            "the step interrupt of a board runs at 100 kHz at most: lower motion.tick_hz; a robot that needs more \
         can only be simulated",
        ),
    )
}

fn check_geometry(robot: &RobotDescription) -> Result<(), RobotError> {
    let geometry = &robot.geometry;
    CheckedField("geometry.tip_radius_mm", geometry.tip_radius_mm).size()?;
    CheckedField("geometry.inner_radius_mm", geometry.inner_radius_mm).size()?;
    CheckedField("geometry.inner_length_mm", geometry.inner_length_mm).size()?;
    if geometry.tip_radius_mm <= geometry.inner_radius_mm {
        return Err(RobotError::TooSmall {
            field: "geometry.tip_radius_mm",
            value: geometry.tip_radius_mm,
            limit: geometry.inner_radius_mm,
            advice: advice("the tube (r_t) must be wider than the parts inside it (geometry.inner_radius_mm, r_r)"),
        });
    }
    CheckedField("wall.width_mm", robot.wall.width_mm).between(
        MIN_SIZE,
        geometry.tip_radius_mm,
        advice("give the width of the tube's wall in mm, at most the tip's radius (geometry.tip_radius_mm)"),
    )
}

fn check_material(robot: &RobotDescription) -> Result<(), RobotError> {
    let &Material { density_g_per_cm3, youngs_modulus_mpa, strength_mpa } = &robot.material;
    CheckedField("material.density_g_per_cm3", density_g_per_cm3).between(
        1e-3,
        25.0,
        advice("give the density in grams per cubic centimetre (PLA has 1.24), and check the unit"),
    )?;
    CheckedField("material.youngs_modulus_mpa", youngs_modulus_mpa).between(
        1e-3,
        1e6,
        advice("give the modulus in MPa, which is N/mm^2 (printed PLA has about 2300), and check the unit"),
    )?;
    CheckedField("material.strength_mpa", strength_mpa).between(
        1e-3,
        1e5,
        advice(
            "give the strength in MPa, which is N/mm^2 (printed PLA bears about 30 between layers), and check the unit",
        ),
    )?;
    CheckedField("tip.mass_g", robot.tip.mass_g).between(
        0.0,
        1e6,
        advice("give the tip's mass in grams, at most a tonne, or 0 for a weightless tip"),
    )
}

fn check_layer(robot: &RobotDescription) -> Result<(), RobotError> {
    let layer = &robot.layer;
    CheckedField("layer.height_mm", layer.height_mm).size()?;
    CheckedField("layer.height_min_mm", layer.height_min_mm).between(
        MIN_SIZE,
        layer.height_mm * (1.0 - 1e-6),
        advice("give a minimum height in mm that is positive and below layer.height_mm"),
    )?;
    // 255 mm is the max height that a layer's bytes on the link can hold.
    CheckedField("layer.height_max_mm", layer.height_max_mm).between(
        layer.height_mm,
        255.0,
        advice(
            "give a maximum height in mm between layer.height_mm and 255 mm, the largest height that can be sent to a \
         board",
        ),
    )?;
    CheckedField("layer.tilt_max_deg", layer.tilt_max_deg).between(
        1e-3,
        57.0,
        advice("give a maximum tilt between 0.001 and 57 degrees"),
    )?;
    CheckedField("layer.period_s", layer.period_s).between(
        1e-3,
        86_400.0,
        advice("give the time for a layer in seconds, between a millisecond and a day"),
    )
}

fn check_radius(robot: &RobotDescription) -> Result<(), RobotError> {
    let (geometry, layer) = (&robot.geometry, &robot.layer);
    let by_packaging =
        min_radius_by_packaging(geometry.tip_radius_mm, geometry.inner_radius_mm, geometry.inner_length_mm);
    let by_layers = min_radius_by_layers(
        geometry.tip_radius_mm,
        layer.height_mm,
        layer.height_min_mm,
        layer.height_max_mm,
        radians(layer.tilt_max_deg),
    );
    CheckedField("planning_radius_mm", robot.planning_radius_mm).between(
        by_packaging.max(by_layers),
        MAX_SIZE,
        advice(
            "give a radius in mm from R_min to 10,000 (R_min is the larger of two limits, by the size of the parts \
         in the tip, table [geometry], and by the tilt and height of layers, table [layer])",
        ),
    )
}

fn check_motors(robot: &RobotDescription) -> Result<(), RobotError> {
    let motion = &robot.motion;
    // A board has a lower limit, see `check_for_board`.
    CheckedField("motion.tick_hz", f64::from(motion.tick_hz)).between(
        100.0,
        1e6,
        advice("the step interrupt can run at 100 Hz to 1 MHz in simulations, and at 100 kHz at most on a board"),
    )?;
    check_head(motion, &robot.head)?;
    check_feed(motion, &robot.feed)?;
    CheckedField("filament.spool_mm", robot.filament.spool_mm).between(
        1.0,
        1e9,
        advice("give the length of filament on the spool in mm (1 kg of filament of 1.75 mm is some 330,000 mm)"),
    )?;
    CheckedField("filament.heat_j_per_mm3_k", robot.filament.heat_j_per_mm3_k).between(
        0.0,
        0.01,
        advice("give density times specific heat in J/(mm^3 K) (PLA has 0.0022)"),
    )
}

fn check_head(motion: &Motion, head: &Head) -> Result<(), RobotError> {
    CheckedField("head.steps_per_turn", f64::from(head.steps_per_turn)).between(
        8.0,
        1e6,
        advice("give 8 to 1,000,000 steps of the head's motor per turn of the head"),
    )?;
    CheckedField("head.homing_turns_per_s", head.homing_turns_per_s).between(
        1e-4,
        f64::from(motion.tick_hz) / (2.0 * f64::from(head.steps_per_turn)),
        advice(
            "give the speed of homing in turns/s, with at most one motor step in two ticks of the step interrupt (see \
         head.steps_per_turn and motion.tick_hz)",
        ),
    )?;
    CheckedField("head.index_angle_deg", head.index_angle_deg).between(
        -360.0,
        360.0,
        advice("give an angle in degrees within one turn"),
    )?;
    CheckedField("head.index_width_deg", head.index_width_deg).between(
        2.0 * 360.0 / f64::from(head.steps_per_turn),
        180.0,
        advice(
            "give the width of the index mark in degrees, at least two steps of the head's motor and at most \
         half a turn",
        ),
    )?;
    CheckedField("head.index_tolerance_deg", head.index_tolerance_deg).between(
        360.0 / f64::from(head.steps_per_turn),
        90.0,
        advice(
            "give the allowed deviation of an edge of the index mark in degrees, at least one step of the head's \
         motor and at most a quarter of a turn",
        ),
    )?;
    CheckedField("head.acceleration_turns_per_s2", head.acceleration_turns_per_s2).between(
        1e-4,
        UNLIMITED,
        advice("give the acceleration in turns/s^2, or remove this line for no limit"),
    )?;
    CheckedField("head.speed_jump_turns_per_s", head.speed_jump_turns_per_s).between(
        head.homing_turns_per_s,
        UNLIMITED,
        advice(
            "homing stops at once, without a ramp, so this speed jump must be at least head.homing_turns_per_s; remove \
         this line for no limit",
        ),
    )
}

fn check_feed(motion: &Motion, feed: &Feed) -> Result<(), RobotError> {
    CheckedField("feed.steps_per_mm", feed.steps_per_mm).between(
        1e-3,
        1e6,
        advice("give the steps of the feed's motor per mm of filament"),
    )?;
    CheckedField("feed.filament_diameter_mm", feed.filament_diameter_mm).size()?;
    CheckedField("feed.acceleration_mm_per_s2", feed.acceleration_mm_per_s2).between(
        1e-3,
        UNLIMITED,
        advice("give the acceleration of the filament in mm/s^2, or remove this line for no limit"),
    )?;
    CheckedField("feed.retract_mm", feed.retract_mm).between(
        0.0,
        100.0,
        advice("give the length of filament that is pulled back in mm, or 0 to pull none back"),
    )?;
    let mut min_jump = 1e-3;
    // Maintenance uses this speed too, within the limit of the step interrupt.
    CheckedField("feed.retract_mm_per_s", feed.retract_mm_per_s).between(
        min_jump,
        1e6,
        advice("give the speed of the filament in mm/s"),
    )?;
    if feed.retract_mm > 0.0 {
        CheckedField("feed.retract_mm_per_s", feed.retract_mm_per_s).between(
            min_jump,
            f64::from(motion.tick_hz) / (2.0 * feed.steps_per_mm),
            advice(
                "the step interrupt makes at most one motor step in two ticks: lower feed.retract_mm_per_s, or raise \
             motion.tick_hz",
            ),
        )?;
        min_jump = feed.retract_mm_per_s;
    }
    CheckedField("feed.speed_jump_mm_per_s", feed.speed_jump_mm_per_s).between(
        min_jump,
        UNLIMITED,
        advice(
            "give the speed jump in mm/s, at least feed.retract_mm_per_s if feed.retract_mm is above 0 (filament is \
         pulled back without a ramp), or remove this line for no limit",
        ),
    )
}

fn check_heater(robot: &RobotDescription) -> Result<(), RobotError> {
    let heater = &robot.heater;
    CheckedField("heater.max_c", heater.max_c).between(
        40.0,
        500.0,
        advice("give the highest permitted temperature of the nozzle, between 40 and 500 C"),
    )?;
    CheckedField("heater.target_c", heater.target_c).between(
        30.0,
        heater.max_c - Heater::TARGET_MARGIN_C,
        advice("give a temperature above 30 C and at least 5 C below heater.max_c"),
    )?;
    CheckedField("heater.extrusion_min_c", heater.extrusion_min_c).between(
        25.0,
        heater.target_c - heater.band_c,
        advice(
            "filament is fed only above this temperature: give at least 25 C, and at most heater.target_c minus \
         heater.band_c",
        ),
    )?;
    CheckedField("heater.band_c", heater.band_c).between(
        0.1,
        5.0,
        advice("give the permitted deviation from heater.target_c in degrees, 0.1 to 5"),
    )?;
    CheckedField("heater.heating_timeout_s", heater.heating_timeout_s).between(
        1.0,
        3600.0,
        advice("give the longest time for heating from cold to hot, in seconds"),
    )?;
    CheckedField("heater.kp", heater.kp).between(
        1e-9,
        100.0,
        advice("give the proportional gain in duty per degree; heating needs a positive gain"),
    )?;
    CheckedField("heater.ki", heater.ki).between(
        0.0,
        100.0,
        advice("give the integral gain in duty per degree and second"),
    )?;
    CheckedField("heater.kd", heater.kd).between(
        0.0,
        100.0,
        advice("give the derivative gain in duty per degree per second"),
    )?;
    CheckedField("heater.power_w", heater.power_w).between(
        0.1,
        10_000.0,
        advice("give the power of the heater at full duty in W"),
    )?;
    CheckedField("heater.heat_capacity_j_per_k", heater.heat_capacity_j_per_k).between(
        0.01,
        1e5,
        advice("give the heat capacity of the nozzle in J/K"),
    )?;
    CheckedField("heater.loss_w_per_k", heater.loss_w_per_k).between(
        1e-6,
        1e3,
        advice("give the heat loss of the nozzle in W/K"),
    )
}

fn check_thermistor(robot: &RobotDescription) -> Result<(), RobotError> {
    let thermistor = &robot.thermistor;
    match (thermistor.r25_ohm, thermistor.beta_k, thermistor.steinhart_hart) {
        (Some(r25_ohm), Some(beta_k), None) => {
            CheckedField("thermistor.r25_ohm", r25_ohm).between(
                10.0,
                1e7,
                advice("give the resistance at 25 C in ohm"),
            )?;
            CheckedField("thermistor.beta_k", beta_k).between(
                500.0,
                10_000.0,
                advice("give the B value of the thermistor in K"),
            )?;
        }
        (None, None, Some([a, b, c])) => {
            let advice =
                advice("give the coefficient in 1/K from the data sheet: A is near 1e-3, B near 2e-4, C near 1e-7");
            CheckedField("thermistor.steinhart_hart[0]", a).between(-0.01, 0.01, advice)?;
            CheckedField("thermistor.steinhart_hart[1]", b).between(1e-6, 0.01, advice)?;
            CheckedField("thermistor.steinhart_hart[2]", c).between(0.0, 1e-4, advice)?;
        }
        _ => return Err(RobotError::ThermistorEquation),
    }
    CheckedField("thermistor.pull_up_ohm", thermistor.pull_up_ohm).between(
        10.0,
        1e7,
        advice("give the resistance of the pull-up resistor in ohm"),
    )
}

fn check_fan_and_pause(robot: &RobotDescription) -> Result<(), RobotError> {
    let (fan, pause) = (&robot.fan, &robot.pause);
    CheckedField("fan.growing_duty", fan.growing_duty).between(
        0.0,
        1.0,
        advice("give the fan's duty from 0 to 1, where 1 is full duty"),
    )?;
    CheckedField("fan.loss_w_per_k", fan.loss_w_per_k).between(
        0.0,
        1e3,
        advice("give the additional heat loss by the fan in W/K"),
    )?;
    CheckedField("pause.standby_c", pause.standby_c).between(
        0.0,
        500.0,
        advice("give a temperature in C; a value above heater.target_c has the effect of heater.target_c"),
    )?;
    CheckedField("pause.standby_after_s", pause.standby_after_s).between(
        0.0,
        86_400.0,
        advice("give a time in seconds, at most a day"),
    )?;
    CheckedField("pause.off_after_s", pause.off_after_s).between(
        0.0,
        86_400.0,
        advice("give a time in seconds, at most a day"),
    )
}

fn check_sensors(robot: &RobotDescription) -> Result<(), RobotError> {
    let (supply, sensors) = (&robot.supply, &robot.sensors);
    CheckedField("supply.nominal_v", supply.nominal_v).between(
        1.0,
        100.0,
        advice("give the nominal voltage of the supply in V"),
    )?;
    CheckedField("supply.min_v", supply.min_v).between(
        0.5,
        supply.nominal_v,
        advice("give a minimum voltage from 0.5 V to supply.nominal_v"),
    )?;
    CheckedField("supply.max_v", supply.max_v).between(
        supply.nominal_v,
        200.0,
        advice("give a maximum voltage from supply.nominal_v to 200 V"),
    )?;
    CheckedField("supply.full_scale_v", supply.full_scale_v).between(
        supply.max_v,
        1000.0,
        advice(
            "give the supply's voltage in V at which the ADC's input reaches its reference; it must be above \
         supply.max_v, so that the ADC can measure that voltage",
        ),
    )?;
    if let Some(motion) = sensors.filament_motion {
        CheckedField("sensors.filament_motion.mm_per_pulse", motion.mm_per_pulse).between(
            1e-3,
            1e3,
            advice("give the length of filament per pulse of the sensor in mm"),
        )?;
        CheckedField("sensors.filament_motion.jam_mm", motion.jam_mm).between(
            2.0 * motion.mm_per_pulse,
            1e4,
            advice(
                "give a length of filament in mm of at least two pulses of the sensor, because a shorter one would \
             give false alarms",
            ),
        )?;
    }
    Ok(())
}

fn check_board(robot: &RobotDescription) -> Result<(), RobotError> {
    if let Some(board) = &robot.board {
        board.check(robot).map_err(RobotError::Pins)?;
    }
    driver_settings::check(robot)
}

/// Checks that the step interrupt can make the steps of the steepest layer of a plan at the planning radius, in the
/// sector with the most steps per tick.
fn check_step_rates(robot: &RobotDescription) -> Result<(), RobotError> {
    let layer = &robot.layer;
    let ticks = layer.period_s * f64::from(robot.motion.tick_hz);
    CheckedField(advice("layer.period_s * motion.tick_hz"), ticks).between(
        4.0 * f64::from(SECTORS as u32),
        f64::from(u32::MAX / 4),
        advice(
            "a layer must take at least four ticks of the step interrupt in each of its sectors, and at most 2^30 - 1 \
         ticks: change motion.tick_hz or layer.period_s",
        ),
    )?;
    // The steepest layer of a plan at the planning radius.
    let tilt = layer.height_mm / robot.planning_radius_mm;
    let busiest = BusiestSector::of(robot, layer.height_mm, tilt);
    let remedy = advice(
        "the step interrupt makes at most one motor step in two ticks: lower head.steps_per_turn or \
                  feed.steps_per_mm, or raise motion.tick_hz or layer.period_s",
    );
    let max = libm::floor(busiest.ticks / 2.0);
    CheckedField("head steps in the busiest sector", busiest.head).between(0.0, max, remedy)?;
    CheckedField("feed steps in the busiest sector", busiest.feed).between(0.0, max, remedy)
}

/// Checks that the motors can follow the steepest layer of a plan at the planning radius, and can reach its speed.
fn check_accelerations(robot: &RobotDescription) -> Result<(), RobotError> {
    let height = robot.layer.height_mm;
    let steepest = Layer { alpha: 0.0, height, tilt: height / robot.planning_radius_mm };
    let LayerMotion { head, feed } = LayerMotion::of(robot, &steepest);
    let check = |motion: &AxisMotion, acceleration: CheckedField, profile: &'static str| {
        if motion.is_within_jump() {
            return Ok(());
        }
        let min = 2.0 * motion.speed / MAX_RAMP_S;
        acceleration.between(
            min,
            UNLIMITED,
            advice(
                "the motor must reach the speed of a layer within ten seconds: raise this acceleration or \
             layer.period_s",
            ),
        )?;
        CheckedField(profile, motion.acceleration).between(
            0.0,
            motion.acceleration_limit,
            advice(
                "a layer of a bend of planning_radius_mm may use at most half of the axis's acceleration, and a \
             quarter of its speed jump between sectors: raise the acceleration and the speed jump, or layer.period_s",
            ),
        )
    };
    let acceleration = CheckedField("head.acceleration_turns_per_s2", robot.head.acceleration_turns_per_s2);
    check(&head, acceleration, advice("head acceleration within a layer"))?;
    let acceleration = CheckedField("feed.acceleration_mm_per_s2", robot.feed.acceleration_mm_per_s2);
    check(&feed, acceleration, advice("feed acceleration within a layer"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{Robot, Tip};
    use crate::testing::description_a;
    use std::string::ToString;

    #[test]
    fn invalid_materials_and_tips_are_refused() {
        let refused = |change: fn(&mut RobotDescription)| {
            let mut description = description_a();
            change(&mut description);
            Robot::new(description).unwrap_err().to_string()
        };
        for (message, part) in [
            (
                refused(|robot| robot.material.density_g_per_cm3 = 1240.0),
                "density_g_per_cm3 is 1240, above 25: give the density in grams",
            ),
            (refused(|robot| robot.material.density_g_per_cm3 = f64::NAN), "density_g_per_cm3 is NaN"),
            (
                refused(|robot| robot.material.youngs_modulus_mpa = 0.0),
                "youngs_modulus_mpa is 0, below 0.001: give the modulus in MPa",
            ),
            (
                refused(|robot| robot.material.strength_mpa = 3e7),
                "strength_mpa is 30000000, above 100000: give the strength in MPa",
            ),
            (refused(|robot| robot.tip.mass_g = -1.0), "tip.mass_g is -1, below 0: give the tip's mass in grams"),
        ] {
            assert!(message.contains(part), "{message}");
        }
    }

    #[test]
    fn a_board_limits_the_step_interrupt_more_than_a_simulation() {
        let with = |tick_hz| {
            let mut description = description_a();
            description.motion.tick_hz = tick_hz;
            Robot::new(description)
        };
        assert!(with(100_000).unwrap().check_for_board().is_ok());
        let fast = with(100_001).unwrap().check_for_board().unwrap_err().to_string();
        assert!(fast.starts_with("motion.tick_hz is 100001, above 100000: "), "{fast}");
        assert!(with(1_000_000).is_ok());
        let faster = with(1_000_001).unwrap_err().to_string();
        assert!(faster.starts_with("motion.tick_hz is 1000001, above 1000000: "), "{faster}");
    }

    #[test]
    fn material_defaults_to_pla() {
        let text = include_str!("../../../robots/growbot-a.toml");
        let sections = |names: &[&str]| {
            let retained = text.split("\n[").filter(|section| !names.iter().any(|name| section.starts_with(name)));
            retained.collect::<std::vec::Vec<_>>().join("\n[")
        };
        let robot: RobotDescription = toml::from_str(&sections(&["material]", "tip]"])).unwrap();
        assert_eq!((robot.material, robot.tip), (Material::default(), Tip::default()));
        assert_eq!(robot, description_a());
    }
}
