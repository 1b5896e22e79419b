//! One layer as one turn of the head: how many steps of head and feed, in how many ticks, in each sector.
//!
//! The material between angle 0 and `psi` has a closed form ([`Layer::share_of_material`]). At the edges of the
//! sectors both axes stand where it puts them, to the step; within a sector both run evenly. Running evenly within a
//! sector flattens the first harmonic of the profile, which *is* the tilt, by `sinc^2` of half the sector's angle (0.08 % for 64
//! sectors); the turn asks for that much more, so that the layer as laid has the tilt that was asked for.
//!
//! Two strategies lay the same steps in the same sectors: `feed` gives every sector the same time and varies the feed,
//! `speed` gives every sector time in proportion to its material, so that the feed is steady and the head slower where
//! more is due.
//!
//! Feed steps are counted from the beginning of the job ([`Material`]), so that what one layer rounds off the next one lays.

use core::f64::consts::{PI, TAU};

use growbot_core::angle::wrap_positive;
use growbot_core::layer::{Layer, SECTORS};
use growbot_core::layer_bytes::{Fields, HEIGHT_UNITS, LayerBytes};
use growbot_core::robot::{FeedStrategy, Robot};

/// Steps and ticks of one sector. Neither axis makes more than one step in two ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Sector {
    /// How long it takes, ticks of the step interrupt.
    pub ticks: u32,
    /// Steps of the head.
    pub head: u32,
    /// Steps of the feed.
    pub feed: u32,
}

/// One layer as one turn of the head.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Turn {
    /// The sectors, from the tip's x axis on.
    pub sectors: [Sector; SECTORS],
}

/// How much the job has laid so far: the origin from which feed steps are counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Material {
    /// Sum of the heights of all layers, in the units of [`Fields::height`].
    height_units: u64,
}

/// A layer asks for steps faster than one in two ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StepRate;

impl Material {
    /// The feed's position, steps, after this share of a layer.
    fn feed_steps(self, robot: &Robot, height_units: u32, share: f64) -> f64 {
        let height = (self.height_units as f64 + f64::from(height_units) * share) / HEIGHT_UNITS;
        libm::rint(height * robot.feed_steps_per_length())
    }

    /// Counts a layer as laid.
    pub fn add(&mut self, bytes: &LayerBytes) {
        self.height_units += u64::from(Fields::of(bytes).height);
    }
}

/// By how much running evenly within a sector flattens the first harmonic of a profile.
fn flattening() -> f64 {
    let half_sector = PI / SECTORS as f64;
    let sinc = libm::sin(half_sector) / half_sector;
    sinc * sinc
}

impl Turn {
    /// The turn that lays a layer after the given material.
    ///
    /// # Errors
    /// [`StepRate`] if a sector asks for more than one step in two ticks, or the layer for no height or for feed taken back.
    /// No layer does that which [`growbot_core::layer_bytes::decode_checked`] has passed.
    pub fn new(bytes: &LayerBytes, laid: Material, robot: &Robot) -> Result<Self, StepRate> {
        let fields = Fields::of(bytes);
        if fields.height == 0 {
            return Err(StepRate);
        }
        let layer = fields.layer();
        let steeper = Layer { tilt: layer.tilt / flattening(), ..layer };
        // The check of a layer knows of no steeper one, so a layer close to its limits goes as it is.
        Self::of_profile(&steeper, fields.height, laid, robot)
            .or_else(|StepRate| Self::of_profile(&layer, fields.height, laid, robot))
    }

    /// The turn that lays this profile, as high as `height_units` say.
    fn of_profile(profile: &Layer, height_units: u32, laid: Material, robot: &Robot) -> Result<Self, StepRate> {
        let description = robot.description();
        let ticks = description.layer.period_s * f64::from(description.motion.tick_hz);
        let head_steps = f64::from(description.head.steps_per_turn);

        // Positions at the edge between two sectors: ticks, head steps, feed steps.
        let edge = |index: usize| {
            let even = index as f64 / SECTORS as f64;
            let share = if index == SECTORS { 1.0 } else { profile.share_of_material(even * TAU, robot.tip_radius()) };
            let time = match description.motion.strategy {
                FeedStrategy::Feed => even,
                FeedStrategy::Speed => share,
            };
            [libm::rint(ticks * time), libm::rint(head_steps * even), laid.feed_steps(robot, height_units, share)]
        };
        let mut sectors = [Sector::default(); SECTORS];
        let mut from = edge(0);
        for (index, sector) in sectors.iter_mut().enumerate() {
            let to = edge(index + 1);
            let [ticks, head, feed] = [to[0] - from[0], to[1] - from[1], to[2] - from[2]];
            // A lean of more than the whole height would take feed back; no layer that was checked has one.
            if ticks < 1.0 || head < 0.0 || feed < 0.0 || 2.0 * head.max(feed) > ticks {
                return Err(StepRate);
            }
            *sector = Sector { ticks: ticks as u32, head: head as u32, feed: feed as u32 };
            from = to;
        }
        Ok(Self { sectors })
    }
}

/// The layer that the feed steps made in each sector amount to.
///
/// The mean height follows from the sum, tilt and alpha from the first harmonic: `h(psi) = h + r_t phi cos(psi - alpha)`.
#[must_use]
pub fn as_built(feed: &[u32; SECTORS], robot: &Robot) -> Layer {
    let half_sector = PI / SECTORS as f64;
    let (mut sum, mut cosine, mut sine) = (0.0, 0.0, 0.0);
    for (index, steps) in feed.iter().enumerate() {
        let (sin, cos) = libm::sincos((2 * index + 1) as f64 * half_sector);
        let steps = f64::from(*steps);
        sum += steps;
        cosine += steps * cos;
        sine += steps * sin;
    }
    let even = libm::sin(half_sector) / half_sector;
    let length_per_step = 1.0 / robot.feed_steps_per_length();
    let harmonic = 2.0 * even * length_per_step * libm::hypot(cosine, sine);
    Layer {
        alpha: wrap_positive(libm::atan2(sine, cosine)),
        height: sum * length_per_step,
        tilt: harmonic / robot.tip_radius(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{fast_robot, robot_a, robot_a_by};
    use growbot_core::layer_bytes::{Encoder, decode, decode_checked};
    use proptest::prelude::*;

    fn layer() -> impl Strategy<Value = Layer> {
        (0.0..TAU, 0.1..0.774, 98.2..1e5).prop_map(|(alpha, height, radius)| Layer {
            alpha,
            height,
            tilt: height / radius,
        })
    }

    fn bytes(layer: &Layer) -> LayerBytes {
        Encoder::default().encode(layer)
    }

    proptest! {
        #[test]
        fn every_sector_is_within_a_step_of_the_closed_form(layer in layer()) {
            let robot = robot_a();
            let turn = Turn::new(&bytes(&layer), Material::default(), &robot).unwrap();
            let steps = layer.height * robot.feed_steps_per_length();
            for (index, sector) in turn.sectors.iter().enumerate() {
                let share = |edge: usize| layer.share_of_material(TAU * edge as f64 / SECTORS as f64, robot.tip_radius());
                let closed_form = steps * (share(index + 1) - share(index));
                prop_assert!((f64::from(sector.feed) - closed_form).abs() <= 1.1, "{index}: {} for {closed_form}", sector.feed);
            }
        }

        #[test]
        fn both_strategies_lay_the_same_steps_in_the_same_sectors(layer in layer()) {
            let (by_feed, by_speed) = (robot_a_by(FeedStrategy::Feed), robot_a_by(FeedStrategy::Speed));
            let [feed, speed] = [&by_feed, &by_speed].map(|robot| Turn::new(&bytes(&layer), Material::default(), robot).unwrap());
            for (a, b) in feed.sectors.iter().zip(&speed.sectors) {
                prop_assert_eq!((a.head, a.feed), (b.head, b.feed));
            }
            let total = |turn: &Turn| turn.sectors.iter().map(|sector| sector.ticks).sum::<u32>();
            prop_assert_eq!((total(&feed), total(&speed)), (72_000, 72_000));
        }

        #[test]
        fn what_was_asked_for_is_what_is_built(layer in layer()) {
            let robot = robot_a();
            let turn = Turn::new(&bytes(&layer), Material::default(), &robot).unwrap();
            let built = as_built(&turn.sectors.map(|sector| sector.feed), &robot);
            let step = 1.0 / robot.feed_steps_per_length();
            prop_assert!((built.height - layer.height).abs() <= 0.5 * step + 1e-6);
            let tilt = |layer: &Layer| {
                let (sin, cos) = libm::sincos(layer.alpha);
                nalgebra::Vector2::new(cos, sin) * layer.tilt * robot.tip_radius()
            };
            // Each edge is rounded by half a step at most; in the first harmonic that is far less than the sum of all.
            prop_assert!((tilt(&built) - tilt(&layer)).norm() < 4.0 * step, "{built:?} for {layer:?}");
        }
    }

    #[test]
    fn every_layer_that_passes_its_check_has_a_turn() {
        for strategy in [FeedStrategy::Feed, FeedStrategy::Speed] {
            let robot = robot_a_by(strategy);
            for height in 1..200 {
                for tilt in 0..50 {
                    let layer = Layer { alpha: 1.0, height: f64::from(height) * 0.005, tilt: f64::from(tilt) * 0.0002 };
                    if robot.check_layer(&layer, 0.0).is_ok() {
                        Turn::new(&bytes(&layer), Material::default(), &robot).unwrap();
                    }
                }
            }
        }
    }

    #[test]
    fn layers_at_a_limit_have_a_turn_however_their_steps_are_rounded() {
        let quick = fast_robot();
        let mut by_speed = quick.description().clone();
        by_speed.motion.strategy = FeedStrategy::Speed;
        let by_speed = Robot::new(by_speed).unwrap();
        // Nearly nothing on the inner side; and nearly more than one head step in two ticks there.
        for (robot, height, leans) in [(robot_a(), 0.17, 0.999..1.0), (by_speed, 0.5, 0.2888..0.2889)] {
            let (mut material, mut laid) = (Material::default(), 0);
            for i in 0..4000 {
                let lean = leans.start + (leans.end - leans.start) * f64::from(i) / 4000.0;
                let alpha = wrap_positive(f64::from(i) * 0.37);
                let bytes = bytes(&Layer { alpha, height, tilt: lean * height / robot.tip_radius() });
                if decode_checked(&bytes, &robot).is_ok() {
                    let turn = Turn::new(&bytes, material, &robot).unwrap();
                    assert!(turn.sectors.iter().all(|sector| 2 * sector.head.max(sector.feed) <= sector.ticks));
                    material.add(&bytes);
                    laid += 1;
                }
            }
            assert!(laid > 2000, "{laid} passed their check");
        }
    }

    #[test]
    fn feed_steps_never_drift_over_five_thousand_layers() {
        let robot = robot_a();
        let layer = Layer { alpha: 1.0, height: 0.7731, tilt: 0.0077 };
        let (mut encoder, mut material, mut steps, mut height) = (Encoder::default(), Material::default(), 0_u64, 0.0);
        for _ in 0..5000 {
            let bytes = encoder.encode(&layer);
            let turn = Turn::new(&bytes, material, &robot).unwrap();
            material.add(&bytes);
            steps += turn.sectors.iter().map(|sector| u64::from(sector.feed)).sum::<u64>();
            height += decode(&bytes).height;
            assert!((steps as f64 - height * robot.feed_steps_per_length()).abs() < 0.51);
        }
    }

    #[test]
    fn the_steady_feed_is_steady() {
        let robot = robot_a_by(FeedStrategy::Speed);
        let layer = Layer { alpha: 0.3, height: 0.77, tilt: 0.0077 };
        let turn = Turn::new(&bytes(&layer), Material::default(), &robot).unwrap();
        let rate = |sector: &Sector| f64::from(sector.feed) / f64::from(sector.ticks);
        let mean = turn.sectors.iter().map(rate).sum::<f64>() / SECTORS as f64;
        assert!(turn.sectors.iter().all(|sector| (rate(sector) / mean - 1.0).abs() < 0.02));
    }

    #[test]
    fn what_the_step_interrupt_cannot_carry_is_refused() {
        let robot = robot_a();
        assert_eq!(Turn::new(&[0; 12], Material::default(), &robot), Err(StepRate));
        let absurd = Layer { alpha: 0.0, height: 200.0, tilt: 0.1 };
        assert_eq!(Turn::new(&bytes(&absurd), Material::default(), &robot), Err(StepRate));
        let more_lean_than_height = Layer { alpha: 0.0, height: 0.1, tilt: 0.1 };
        assert_eq!(Turn::new(&bytes(&more_lean_than_height), Material::default(), &robot), Err(StepRate));
    }
}
