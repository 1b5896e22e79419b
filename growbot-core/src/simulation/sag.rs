//! How a body hangs under its own weight: a cantilever, to first order.
//!
//! The body is clamped where it starts. Every cross-section carries the moment of the weight of all that lies beyond it, the rings of the
//! wall and the tip at the end, and turns by it: by `M h / (E I)` across a layer of height `h`. As all that lies beyond a section was
//! laid after it, the section was laid without that moment and turns by all of it. The part of a moment along the tube's axis twists:
//! for a ring `G J = E I / (1 + nu)`.
//!
//! First order: moments are taken on the body as it was laid, before it hangs. That is good to some percent of a sag of a tenth of the
//! length. Left out are shear, which matters to tubes no longer than a few diameters; buckling of a thin wall; creep; and the supports of
//! a body that lies on something.

use nalgebra::{Rotation3, Vector3};

use super::Laid;
use crate::pose::{Frame, tip_direction};
use crate::robot::Robot;

/// Standard gravity, m/s^2.
const GRAVITY: f64 = 9.806_65;
/// Poisson's ratio, assumed: plastics have 0.3 to 0.45. It is in twist only.
const POISSON: f64 = 0.35;

/// A body that hangs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hung {
    /// Where the tip is.
    pub base_from_tip: Frame,
    /// How far that is from where it would be without weight, mm.
    pub deflection: f64,
    /// The moment that bends the root, N mm.
    pub root_moment: f64,
    /// The greatest bending stress in the wall, MPa.
    pub stress: f64,
    /// Where it is: so far along the body, mm.
    pub stressed_at: f64,
}

/// Weight, N, and its first moment, N mm.
#[derive(Debug, Clone, Copy)]
struct Load {
    weight: f64,
    first_moment: Vector3<f64>,
}

impl Load {
    fn at(weight: f64, centre: Vector3<f64>) -> Self {
        Self { weight, first_moment: weight * centre }
    }

    fn plus(&self, other: &Self) -> Self {
        Self { weight: self.weight + other.weight, first_moment: self.first_moment + other.first_moment }
    }

    fn minus(&self, other: &Self) -> Self {
        Self { weight: self.weight - other.weight, first_moment: self.first_moment - other.first_moment }
    }

    /// Its moment about a point, N mm.
    fn moment_about(&self, point: &Vector3<f64>) -> Vector3<f64> {
        (self.first_moment - self.weight * point).cross(&-Vector3::z())
    }
}

/// How the body of these layers hangs, which starts at this frame of a base whose z axis is up. The layers are gone through twice.
#[must_use]
pub fn hang(robot: &Robot, base_from_start: &Frame, laid: impl Iterator<Item = Laid> + Clone) -> Hung {
    let description = robot.description();
    // kg/mm^3 and kg, m/s^2: N.
    let weight_per_length = 1e-6 * description.material.density_g_per_cm3 * robot.wall_area() * GRAVITY;
    let tip_weight = 1e-3 * description.tip.mass_g * GRAVITY;
    let stiffness = description.material.youngs_modulus_mpa * robot.wall_second_moment();
    let stress_per_moment = (0.5 * robot.outer_diameter()) / robot.wall_second_moment();

    // A layer lies about the middle of its chord.
    let middle = |from: &Frame, step: &Frame| from * nalgebra::Point3::from(0.5 * step.translation.vector);
    let ring = |layer: &Laid, middle: Vector3<f64>| Load::at(weight_per_length * layer.layer.height, middle);

    let mut straight = *base_from_start;
    let mut beyond = Load::at(0.0, Vector3::zeros());
    for layer in laid.clone() {
        let step = layer.step();
        beyond = beyond.plus(&ring(&layer, middle(&straight, &step).coords));
        straight *= step;
    }
    let unhung = straight.translation.vector;
    beyond = beyond.plus(&Load::at(tip_weight, unhung));

    straight = *base_from_start;
    let mut hung = *base_from_start;
    let mut along = 0.0;
    let (mut root_moment, mut stress, mut stressed_at) = (None, 0.0, 0.0);
    for layer in laid {
        let step = layer.step();
        let middle = middle(&straight, &step).coords;

        let moment = beyond.moment_about(&straight.translation.vector);
        let bending = moment.cross(&tip_direction(&straight)).norm();
        root_moment.get_or_insert(bending);
        if bending * stress_per_moment > stress {
            (stress, stressed_at) = (bending * stress_per_moment, along);
        }

        beyond = beyond.minus(&ring(&layer, middle));
        let moment = straight.rotation.inverse() * beyond.moment_about(&middle);
        let twisting = Vector3::new(0.0, 0.0, moment.z);
        let turn = Rotation3::new((moment + POISSON * twisting) * (layer.layer.height / stiffness));
        // The layer turns about its middle.
        let half = 0.5 * step.translation.vector;
        hung *= Frame::from_parts((half + turn * half).into(), turn * step.rotation);
        straight *= step;
        along += layer.layer.height;
    }
    Hung {
        base_from_tip: hung,
        deflection: (hung.translation.vector - unhung).norm(),
        root_moment: root_moment.unwrap_or(0.0),
        stress,
        stressed_at,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layer::Layer;
    use crate::pose::Pose;
    use crate::robot::RobotDescription;
    use crate::testing::description_a;
    use core::f64::consts::FRAC_PI_2;
    use proptest::prelude::*;

    const LENGTH: f64 = 500.0;
    const COUNT: usize = 640;

    fn robot(change: impl Fn(&mut RobotDescription)) -> Robot {
        let mut description = description_a();
        change(&mut description);
        Robot::new(description).unwrap()
    }

    /// A robot whose body, or whose tip, weighs next to nothing.
    fn light_body(tip_g: f64) -> Robot {
        robot(|robot| (robot.material.density_g_per_cm3, robot.tip.mass_g) = (1e-3, tip_g))
    }

    fn light_tip() -> Robot {
        robot(|robot| robot.tip.mass_g = 0.0)
    }

    fn tube(tilt: f64, alpha: f64) -> impl Iterator<Item = Laid> + Clone {
        let layer = Layer { alpha, height: LENGTH / COUNT as f64, tilt: tilt / COUNT as f64 };
        core::iter::repeat_n(Laid { layer, twist: 0.0 }, COUNT)
    }

    fn from(heading: f64, pitch: f64) -> Frame {
        Pose::from_degrees([10.0, 20.0, 30.0, heading, pitch]).unwrap().frame()
    }

    /// N/mm of body and N mm^2.
    fn weight_and_stiffness(robot: &Robot) -> (f64, f64) {
        let material = robot.description().material;
        let ring = core::f64::consts::TAU * 22.0 * 1.6;
        let second_moment = 0.25 * core::f64::consts::PI * (22.8_f64.powi(4) - 21.2_f64.powi(4));
        assert!((robot.wall_second_moment() / second_moment - 1.0).abs() < 1e-12);
        (1e-6 * material.density_g_per_cm3 * ring * GRAVITY, material.youngs_modulus_mpa * second_moment)
    }

    #[test]
    fn a_horizontal_tube_bends_by_its_own_weight_as_a_cantilever() {
        let robot = light_tip();
        let (weight, stiffness) = weight_and_stiffness(&robot);
        for heading in [0.0, 70.0, -135.0] {
            let start = from(heading, 0.0);
            let hung = hang(&robot, &start, tube(0.0, 0.0));
            let sag = weight * LENGTH.powi(4) / (8.0 * stiffness);
            let turn = weight * LENGTH.powi(3) / (6.0 * stiffness);
            assert!((hung.deflection / sag - 1.0).abs() < 1e-4, "{} {sag}", hung.deflection);
            assert!((30.0 - hung.base_from_tip.translation.vector.z - sag).abs() < 1e-4 * sag);
            let direction = tip_direction(&hung.base_from_tip);
            assert!((-direction.z / turn - 1.0).abs() < 1e-4, "{direction} {turn}");
            let moment = 0.5 * weight * LENGTH * LENGTH;
            assert!((hung.root_moment / moment - 1.0).abs() < 1e-9);
            let second_moment = robot.wall_second_moment();
            assert!((hung.stress / (moment * 22.8 / second_moment) - 1.0).abs() < 1e-9 && hung.stressed_at == 0.0);
        }
    }

    #[test]
    fn a_horizontal_tube_bends_by_its_tip_as_a_cantilever() {
        let robot = light_body(200.0);
        let (weight, stiffness) = weight_and_stiffness(&robot);
        let force = 0.2 * GRAVITY;
        let hung = hang(&robot, &from(30.0, 0.0), tube(0.0, 0.0));
        let sag = force * LENGTH.powi(3) / (3.0 * stiffness) + weight * LENGTH.powi(4) / (8.0 * stiffness);
        assert!((hung.deflection / sag - 1.0).abs() < 1e-4, "{} {sag}", hung.deflection);
    }

    #[test]
    fn an_upright_tube_does_not_sag() {
        for pitch in [90.0, -90.0] {
            let hung = hang(&robot(|_| ()), &from(40.0, pitch), tube(0.0, 0.0));
            assert!(hung.deflection < 1e-12 && hung.root_moment < 1e-9 && hung.stress < 1e-9, "{hung:?}");
        }
        let nothing = hang(&robot(|_| ()), &from(0.0, 0.0), core::iter::empty());
        assert!(nothing.deflection == 0.0 && nothing.root_moment == 0.0 && nothing.base_from_tip == from(0.0, 0.0));
    }

    #[test]
    fn an_arch_in_a_level_plane_twists_as_well_as_it_bends() {
        // A quarter of a circle with a weight at its end: P R^3 / (E I) (pi / 4 + (1 + nu) (3 pi / 4 - 2)), Timoshenko.
        let robot = light_body(200.0);
        let (_, stiffness) = weight_and_stiffness(&robot);
        let hung = hang(&robot, &from(0.0, 0.0), tube(FRAC_PI_2, FRAC_PI_2));
        let radius = LENGTH / FRAC_PI_2;
        let pi = core::f64::consts::PI;
        let by_tip = 0.2 * GRAVITY * radius.powi(3) / stiffness * (pi / 4.0 + (1.0 + POISSON) * (0.75 * pi - 2.0));
        let weightless = hang(&light_body(0.0), &from(0.0, 0.0), tube(FRAC_PI_2, FRAC_PI_2));
        let sag = weightless.base_from_tip.translation.z - hung.base_from_tip.translation.z;
        assert!((sag / by_tip - 1.0).abs() < 1e-3, "{sag} {by_tip}");
    }

    proptest! {
        #[test]
        fn twice_the_load_sags_twice_as_far(tilt in 0.0..3.0, alpha in 0.0..6.0, pitch in -80.0..80.0) {
            let start = from(0.0, pitch);
            let light = robot(|robot| (robot.material.density_g_per_cm3, robot.tip.mass_g) = (0.01, 1.0));
            let heavy = robot(|robot| (robot.material.density_g_per_cm3, robot.tip.mass_g) = (0.02, 2.0));
            let (one, two) = (hang(&light, &start, tube(tilt, alpha)), hang(&heavy, &start, tube(tilt, alpha)));
            prop_assert!((two.deflection / one.deflection - 2.0).abs() < 1e-3);
            prop_assert!((two.root_moment / one.root_moment - 2.0).abs() < 1e-9);
            prop_assert!((two.stress / one.stress - 2.0).abs() < 1e-9);
        }

        #[test]
        fn mirrored_bodies_hang_mirrored(tilt in 0.0..3.0, alpha in 0.0..3.0, pitch in -80.0..80.0) {
            let start = from(0.0, pitch);
            let robot = robot(|_| ());
            let (left, right) = (hang(&robot, &start, tube(tilt, alpha)), hang(&robot, &start, tube(tilt, -alpha)));
            let (a, b) = (left.base_from_tip.translation.vector, right.base_from_tip.translation.vector);
            prop_assert!((a.x - b.x).abs() < 1e-9 && (a.y + b.y - 40.0).abs() < 1e-9 && (a.z - b.z).abs() < 1e-9);
            prop_assert!((left.stress - right.stress).abs() < 1e-9);
        }

        #[test]
        fn turning_all_about_the_vertical_changes_nothing(tilt in 0.0..3.0, alpha in 0.0..6.0, heading in -180.0..180.0) {
            let robot = robot(|_| ());
            let (here, there) =
                (hang(&robot, &from(0.0, 20.0), tube(tilt, alpha)), hang(&robot, &from(heading, 20.0), tube(tilt, alpha)));
            prop_assert!((here.deflection - there.deflection).abs() < 1e-9);
            prop_assert!((here.base_from_tip.translation.z - there.base_from_tip.translation.z).abs() < 1e-9);
        }
    }
}
