//! A robot: its description as written, and the validated [`Robot`] that all other code uses.
//!
//! A [`RobotDescription`] has the fields of a robot file, in mm, degrees, seconds and degrees Celsius. [`Robot::new`]
//! checks it once. No other code needs to check again whether a radius is positive or a limit makes sense.

mod board;
mod checked_field;
mod description;
mod driver_settings;
mod encoding;
mod error;
mod pins;
mod step_rate;
mod validate;

pub use board::{BoardDescription, BoardKind, PinOverrides, Signal};
pub use description::{
    ChopperMode, DigitalInput, DriverSettings, ENCODING_VERSION, Fan, Feed, FeedStrategy, Filament, FilamentMotion,
    Geometry, Head, HeadRotation, Heater, LayerDescription, Material, Motion, Pause, RobotDescription, Sensors, Supply,
    Thermistor, Tip, Wall,
};
pub use encoding::MAX_VERSIONED_LEN;
pub use error::{DriverError, RobotError};
pub use pins::{FIRST_ANALOG_PIN, PinError, STEP_SLICE, pwm_slice};
pub use step_rate::{AxisMotion, LayerMotion};
pub use validate::MAX_BOARD_TICK_HZ;

use crate::angle::radians;
use crate::curvature::{max_mean_height, min_radius_by_layers, min_radius_by_packaging};
use crate::hash::Hasher;
use crate::layer::{Layer, LayerError};

/// A robot whose description has been checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Robot {
    description: RobotDescription,
    hash: u64,
}

/// Max size of a description in postcard form, bytes.
pub const MAX_ENCODED_LEN: usize = 768;

impl Robot {
    /// Creates a robot from a description, after checking the description.
    ///
    /// # Errors
    /// Returns the first field that is not finite, out of its range, or inconsistent with another one, with its value
    /// and limit.
    pub fn new(description: RobotDescription) -> Result<Self, RobotError> {
        validate::check(&description)?;
        let mut bytes = [0; MAX_ENCODED_LEN];
        let encoded = postcard::to_slice(&description, &mut bytes).map_err(|_| RobotError::TooLong)?;
        let hash = Hasher::hash(encoded);
        Ok(Self { description, hash })
    }

    /// Checks that a board can drive this robot. [`Robot::new`] also accepts robots that only a simulation can drive.
    ///
    /// # Errors
    /// Returns [`RobotError::TooLarge`] if `motion.tick_hz` is above [`MAX_BOARD_TICK_HZ`].
    pub fn check_for_board(&self) -> Result<(), RobotError> {
        validate::check_for_board(&self.description)
    }

    /// Creates a robot, without checks, from a description that [`Robot::new`] has accepted before and the hash that it
    /// computed. The build of the firmware stores both in the image.
    pub fn from_checked(description: RobotDescription, hash: u64) -> Self {
        Self { description, hash }
    }

    /// Decodes a description from the postcard form that [`Robot::encode`] gives, and checks it.
    ///
    /// # Errors
    /// Returns [`RobotError::Unreadable`] if the bytes are not exactly one description. Otherwise returns the errors of
    /// [`Robot::new`].
    pub fn decode(bytes: &[u8]) -> Result<Self, RobotError> {
        match postcard::take_from_bytes(bytes) {
            Ok((description, [])) => Self::new(description),
            _ => Err(RobotError::Unreadable),
        }
    }

    /// Encodes the description in postcard form. A board stores these bytes, and [`Robot::hash`] is their hash.
    ///
    /// # Errors
    /// Returns [`RobotError::TooLong`] if `buffer` is too short. Up to [`MAX_ENCODED_LEN`] bytes are needed.
    pub fn encode<'a>(&self, buffer: &'a mut [u8]) -> Result<&'a [u8], RobotError> {
        postcard::to_slice(&self.description, buffer).map(|bytes| &*bytes).map_err(|_| RobotError::TooLong)
    }

    /// Returns the description that was checked.
    pub fn description(&self) -> &RobotDescription {
        &self.description
    }

    /// Returns the robot's name.
    pub fn name(&self) -> &str {
        &self.description.name
    }

    /// Returns the CRC-64 over the postcard form of the whole description. Robots with equal hashes have equal
    /// descriptions.
    pub fn hash(&self) -> u64 {
        self.hash
    }

    /// Returns `r_t`, the distance from the centreline to where material is laid, mm.
    pub fn tip_radius(&self) -> f64 {
        self.description.geometry.tip_radius_mm
    }

    /// Returns the outer diameter of the printed tube, mm. The wall is a ring of mean radius `r_t`.
    pub fn outer_diameter(&self) -> f64 {
        2.0 * self.tip_radius() + self.description.wall.width_mm
    }

    /// Returns the max tilt of a layer, radians.
    pub fn max_tilt(&self) -> f64 {
        radians(self.description.layer.tilt_max_deg)
    }

    /// Returns the min radius of curvature by the packaging limit (Eq 7), mm.
    pub fn min_radius_by_packaging(&self) -> f64 {
        let geometry = &self.description.geometry;
        min_radius_by_packaging(geometry.tip_radius_mm, geometry.inner_radius_mm, geometry.inner_length_mm)
    }

    /// Returns the min radius of curvature by the limits of a layer's height and tilt, mm.
    pub fn min_radius_by_layers(&self) -> f64 {
        let layer = &self.description.layer;
        let tilt_max = self.max_tilt();
        min_radius_by_layers(self.tip_radius(), layer.height_mm, layer.height_min_mm, layer.height_max_mm, tilt_max)
    }

    /// Returns R_min, the min radius of curvature of the centreline, mm. It is the larger of the radius by the
    /// packaging limit and the radius by the limits of a layer.
    pub fn min_radius(&self) -> f64 {
        self.min_radius_by_packaging().max(self.min_radius_by_layers())
    }

    /// Returns the max mean height of a layer on a bend of this curvature (1/mm), mm.
    pub fn max_mean_height(&self, curvature: f64) -> f64 {
        let layer = &self.description.layer;
        let tilt_max = self.max_tilt();
        max_mean_height(self.tip_radius(), layer.height_mm, layer.height_max_mm, tilt_max, curvature)
    }

    /// Returns the motion of head and feed while this layer is laid at full speed.
    pub fn layer_motion(&self, layer: &Layer) -> LayerMotion {
        LayerMotion::of(&self.description, layer)
    }

    /// Checks that the motors can follow the changes of speed within this layer.
    ///
    /// # Errors
    /// Returns [`LayerError::Acceleration`] if they cannot.
    pub fn check_motion(&self, layer: &Layer) -> Result<(), LayerError> {
        self.layer_motion(layer).check()
    }

    /// Checks that the robot can lay this layer. The layer must not exceed the max height or the max tilt, and it must
    /// have material all round. Its steps must not be faster than the step interrupt makes them, and its speeds must
    /// not change faster than the motors can follow.
    ///
    /// `slack` is the fraction by which a layer may exceed a limit, to allow for rounding. A layer thinner than the min
    /// height can be laid (a plan with one has a warning). A layer without material on its inner side cannot be laid.
    ///
    /// # Errors
    /// Returns a [`LayerError`] with the value of the layer and the limit that it exceeds.
    pub fn check_layer(&self, layer: &Layer, slack: f64) -> Result<(), LayerError> {
        let limits = &self.description.layer;
        if !(layer.alpha.is_finite() && layer.height.is_finite() && layer.tilt.is_finite()) {
            return Err(LayerError::NotFinite);
        }
        if layer.tilt < 0.0 {
            return Err(LayerError::Tilt { tilt: layer.tilt, limit: 0.0 });
        }
        let tilt_max = self.max_tilt();
        if layer.tilt > tilt_max * (1.0 + slack) {
            return Err(LayerError::Tilt { tilt: layer.tilt, limit: tilt_max });
        }
        let outer = layer.max_height(self.tip_radius());
        if outer > limits.height_max_mm * (1.0 + slack) {
            return Err(LayerError::TooHigh { height: outer, limit: limits.height_max_mm });
        }
        let inner = layer.min_height(self.tip_radius());
        if inner <= 0.0 {
            return Err(LayerError::NoMaterial { height: inner });
        }
        if !step_rate::BusiestSector::of(&self.description, layer.height, layer.tilt).is_feasible() {
            return Err(LayerError::StepRate);
        }
        self.check_motion(layer)
    }

    /// Returns the cross-section of the printed wall, mm^2. The wall is a ring of mean radius `r_t`.
    pub fn wall_area(&self) -> f64 {
        core::f64::consts::TAU * self.tip_radius() * self.description.wall.width_mm
    }

    /// Returns the second moment of area of the printed wall about a diameter, mm^4. The second moment about the tube's
    /// axis is twice this value.
    pub fn wall_second_moment(&self) -> f64 {
        let (radius, width) = (self.tip_radius(), self.description.wall.width_mm);
        core::f64::consts::PI * radius * width * (radius * radius + 0.25 * width * width)
    }

    /// Returns the cross-section of the filament, mm^2.
    pub fn filament_area(&self) -> f64 {
        let diameter = self.description.feed.filament_diameter_mm;
        core::f64::consts::FRAC_PI_4 * diameter * diameter
    }

    /// Returns the length of filament for 1 mm of body, mm/mm.
    pub fn filament_per_length(&self) -> f64 {
        self.wall_area() / self.filament_area()
    }

    /// Returns the number of motor steps of the feed for 1 mm of body, 1/mm.
    pub fn feed_steps_per_length(&self) -> f64 {
        self.filament_per_length() * self.description.feed.steps_per_mm
    }
}
