//! Short simulated growths with noise of every kind and feedback, whose results are the same on every machine.

use growbot_core::hash::Hasher;
use growbot_core::path::{Leg, Segment, end};
use growbot_core::pose::{Frame, Pose};
use growbot_core::random::Rng;
use growbot_core::robot::Robot;
use growbot_core::simulation::{DirectionSensor, Disturbance, GrowthTask, SimulatedSensors, grow_closed_loop};
use growbot_core::tracking::SensorNoise;

/// Number of simulated growths, each with its own seed.
pub const GROWTHS: u64 = 2;

/// Result of a simulated growth.
pub struct Trial {
    /// Number of layers laid.
    pub layers: u64,
    /// Hash of the bits of all planned layers, and of the tip's frame and its estimate at the end.
    pub hash: u64,
}

const DEGREE: f64 = core::f64::consts::PI / 180.0;

/// Simulates the growth of an arc, a line and an arc. For every other seed the sensor of the tip's direction measures
/// gravity only.
pub fn grow(robot: &Robot, seed: u64) -> Option<Trial> {
    let mut random = Rng::new(&[seed]);
    let mut arc = || Segment::Arc { alpha: random.uniform_between(0.0, 6.0), bend: 0.3, length: 30.0 };
    let path = [arc(), Segment::Straight { length: 10.0 }, arc()];
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 30.0, 40.0]).ok()?;
    let goal = Pose::from_frame(&end(&path, &start.frame()));
    let disturbance = Disturbance {
        growth_noise: 0.1,
        growth_bias: 0.05,
        tilt_noise: 0.01 * DEGREE,
        tilt_bias: -0.05,
        alpha_noise: DEGREE,
        alpha_bias: 2.0 * DEGREE,
        twist_noise: 0.01 * DEGREE,
        twist_bias: 0.005 * DEGREE,
    };
    let sensors = SimulatedSensors {
        noise: SensorNoise { odometry: 0.01, direction: 0.5 * DEGREE },
        odometry_scale: 0.0,
        direction: if seed.is_multiple_of(2) { DirectionSensor::Tip } else { DirectionSensor::Gravity },
    };
    let mut hasher = Hasher::default();
    let legs = [Leg { goal, segment_count: path.len() }];
    let task = GrowthTask { robot, start, path: &path, legs: &legs };
    let grown = grow_closed_loop(&task, &disturbance, &sensors, seed, |layer, _, base_from_tip| {
        for number in [layer.alpha, layer.height, layer.tilt] {
            hasher.write_f64(number);
        }
        *base_from_tip
    });
    let mut frame = |frame: &Frame| {
        frame.translation.vector.iter().chain(frame.rotation.matrix()).for_each(|&number| hasher.write_f64(number));
    };
    frame(&grown.base_from_tip);
    frame(&grown.estimate?.base_from_tip);
    Some(Trial { layers: grown.layers, hash: hasher.finish() })
}
