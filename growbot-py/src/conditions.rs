//! Reading of `growbot.Conditions`: errors of simulated layers and measurements, and feedback. Names and limits are
//! those of the options of the command `growbot`.

use growbot_core::angle::radians;
use growbot_core::robot::Robot;
use growbot_core::simulation::{DirectionSensor, Disturbance, MAX_ERROR, SimulatedSensors};
use growbot_core::slicing::Slicing;
use growbot_core::tracking::SensorNoise;
use growbot_plan::feedback::DEFAULT_SENSOR_NOISE;
use growbot_sim::simulation::Simulation;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;

use crate::arguments::{flag, within, word, wrong_type};
use crate::error::{Error, ErrorKind};
use crate::py_plan::PyPlan;

/// Limits of biases, percent or degrees.
const SIGNED: [f64; 2] = [-MAX_ERROR, MAX_ERROR];
/// Limits of noise, percent or degrees.
const UNSIGNED: [f64; 2] = [0.0, MAX_ERROR];
/// Limits of the layer height for whole slicing (`step_mm`), mm.
const STEPS_MM: [f64; 2] = [0.01, 1e4];
/// Maximum number of layers of a simulated body. More layers would take minutes.
const MAX_LAYERS: usize = 50_000_000;

/// Conditions of a growth: errors of layers and sensors, feedback, sag and slicing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Conditions {
    disturbance: Disturbance,
    noise: Option<f64>,
    direction: Option<f64>,
    sensors: Option<SimulatedSensors>,
    sag: bool,
    whole_steps: Option<Option<f64>>,
}

impl Conditions {
    /// Converts a Python object of class `growbot.Conditions`. `None` stands for conditions without errors.
    pub fn read(value: Option<&Bound<PyAny>>) -> Result<Self, Error> {
        static CLASS: PyOnceLock<Py<PyType>> = PyOnceLock::new();
        let Some(value) = value else { return Ok(Self::default()) };
        let class = CLASS.import(value.py(), "growbot._conditions", "Conditions")?;
        if !value.is_instance(class)? {
            return Err(wrong_type("conditions", value, "a growbot.Conditions"));
        }
        let number = |name: &str, limits, unit| within(name, &value.getattr(name)?, limits, unit);
        let optional = |name: &str, limits, unit| {
            let value = value.getattr(name)?;
            if value.is_none() { Ok(None) } else { within(name, &value, limits, unit).map(Some) }
        };
        let is = |name: &str| flag(name, &value.getattr(name)?);
        let disturbance = Disturbance {
            growth_noise: number("noise_percent", UNSIGNED, "percent")? / 100.0,
            growth_bias: number("bias_percent", SIGNED, "percent")? / 100.0,
            tilt_noise: radians(number("tilt_noise_deg", UNSIGNED, "degrees")?),
            tilt_bias: number("tilt_bias_percent", SIGNED, "percent")? / 100.0,
            alpha_noise: radians(number("alpha_noise_deg", UNSIGNED, "degrees")?),
            alpha_bias: radians(number("alpha_bias_deg", SIGNED, "degrees")?),
            twist_noise: radians(number("twist_noise_deg", UNSIGNED, "degrees")?),
            twist_bias: radians(number("twist_bias_deg", SIGNED, "degrees")?),
        };
        let odometry = optional("odometry_noise_percent", UNSIGNED, "percent")?.map(|percent| percent / 100.0);
        let direction = optional("direction_noise_deg", UNSIGNED, "degrees")?.map(radians);
        let (feedback, gravity_only) = (is("feedback")?, is("gravity_only")?);
        let scale = number("odometry_scale_percent", SIGNED, "percent")?;
        if !feedback && (gravity_only || scale != 0.0) {
            return Err(Error::new(
                ErrorKind::Input,
                "gravity_only and odometry_scale_percent apply only with feedback: set feedback=True, or remove them",
            ));
        }
        let sensors = feedback.then(|| SimulatedSensors {
            noise: SensorNoise {
                odometry: odometry.unwrap_or(DEFAULT_SENSOR_NOISE.odometry),
                direction: direction.unwrap_or(DEFAULT_SENSOR_NOISE.direction),
            },
            odometry_scale: scale / 100.0,
            direction: if gravity_only { DirectionSensor::Gravity } else { DirectionSensor::Tip },
        });
        let step = optional("step_mm", STEPS_MM, "mm")?;
        let whole_steps = match (word("slicing", &value.getattr("slicing")?)?.as_str(), step) {
            ("exact", None) => None,
            ("exact", Some(_)) => {
                return Err(Error::new(
                    ErrorKind::Input,
                    "step_mm is the height of whole steps, but slicing is not \"whole\": set slicing=\"whole\", or \
                     remove step_mm",
                ));
            }
            ("whole", _) if feedback => {
                return Err(Error::new(
                    ErrorKind::Input,
                    "feedback plans each layer separately, so slicing=\"whole\" has no effect: remove one of them",
                ));
            }
            ("whole", step) => Some(step),
            (other, _) => {
                let message = format!("slicing is {other:?}: give \"exact\" or \"whole\"");
                return Err(Error::with(ErrorKind::Input, message, other, "exact, whole"));
            }
        };
        Ok(Self { disturbance, noise: odometry, direction, sensors, sag: is("sag")?, whole_steps })
    }

    /// Returns the errors of simulated layers.
    pub fn disturbance(&self) -> Disturbance {
        self.disturbance
    }

    /// Returns the noise of the sensors of a simulated robot on a board. The default is 0.
    pub fn sensor_noise(&self) -> SensorNoise {
        SensorNoise { odometry: self.noise.unwrap_or(0.0), direction: self.direction.unwrap_or(0.0) }
    }

    /// Returns the noise that feedback assumes for the sensors of a real robot.
    pub fn assumed_noise(&self) -> SensorNoise {
        SensorNoise {
            odometry: self.noise.unwrap_or(DEFAULT_SENSOR_NOISE.odometry),
            direction: self.direction.unwrap_or(DEFAULT_SENSOR_NOISE.direction),
        }
    }

    /// Reports whether the growth uses feedback.
    pub fn feedback(&self) -> bool {
        self.sensors.is_some()
    }

    /// Reports whether a condition is set that applies only to growths without a board.
    pub fn needs_simulation(&self) -> bool {
        let scaled = self
            .sensors
            .is_some_and(|sensors| sensors.odometry_scale != 0.0 || sensors.direction == DirectionSensor::Gravity);
        self.sag || self.whole_steps.is_some() || scaled
    }

    /// Creates the simulation of a plan under these conditions, without a board.
    pub fn simulation<'a>(&self, plan: &'a PyPlan) -> Result<Simulation<'a>, Error> {
        let robot: &Robot = &plan.robot;
        let layers = plan.inner.requirements.layers;
        if layers > MAX_LAYERS {
            let message = format!("the plan has {layers} layers, above the limit of {MAX_LAYERS}: split the plan");
            return Err(Error::with(ErrorKind::Input, message, layers as f64, MAX_LAYERS as f64));
        }
        let slicing = match self.whole_steps {
            None => Slicing::Exact,
            Some(step) => Slicing::Whole { step: step.unwrap_or(robot.description().layer.height_mm) },
        };
        let mut simulation = Simulation::new(&plan.inner, robot, slicing);
        simulation.disturbance = self.disturbance;
        simulation.sensors = self.sensors;
        simulation.sag = self.sag;
        Ok(simulation)
    }
}
