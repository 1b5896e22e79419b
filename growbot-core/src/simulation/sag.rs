//! The sag of a body under its own weight, as a cantilever to first order.
//!
//! The body is clamped at its start. Every cross-section bears the moment of the weight beyond it: the rings of the
//! wall and the tip at the end. The moment turns the section, by `M h / (E I)` across a layer of height `h`. Everything
//! beyond a section was laid after it. So the section was laid without that moment and turns by all of it. The part of
//! a moment along the tube's axis twists: for a ring `G J = E I / (1 + nu)`.
//!
//! First order means that moments are taken on the body as laid, before it sags, and that turns add up as vectors. The
//! error is some percent for a sag of a tenth of the length. The model neglects shear, which matters only to tubes that
//! are no longer than a few diameters. It also neglects buckling of a thin wall, creep, and all supports of the body
//! but its root.
//!
//! The model treats the tip's mass as a point, and computes the stress of the root only. A section further from the
//! root may bear more stress if the body extends to both sides of its root or turns sideways in the horizontal plane.

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::DisturbedLayer;
use crate::kinematics::advance;
use crate::pose::{Frame, tip_direction};
use crate::robot::Robot;

/// Standard acceleration of gravity, m/s^2.
const STANDARD_GRAVITY_M_PER_S2: f64 = 9.806_65;
/// Poisson's ratio that is assumed for the wall. Plastics have 0.3 to 0.45. Only twist depends on it.
const POISSON: f64 = 0.35;

/// A body that grows and sags, in a base whose z axis is up. The number of operations for a layer does not depend on
/// the length of the body. The turns of all sections by a weight depend on its position only through sums over the
/// sections.
#[derive(Debug, Clone)]
pub struct SaggingBody {
    /// Weight of the wall per length of body, N/mm. `tip_weight` is the weight of the tip, N.
    ring_weight: f64,
    tip_weight: f64,
    /// Bending stiffness `E I` of the wall, N mm^2.
    stiffness: f64,
    /// Stress in the outer fibre of the wall per unit of moment, MPa/(N mm), which is 1/mm^3.
    stress_per_moment: f64,
    root: Vector3<f64>,
    root_direction: Vector3<f64>,
    /// Frame of the tip as if the body had no weight.
    base_from_unloaded_tip: Frame,
    sections: Sections,
    /// Sag of the tip that the weight of the rings alone causes.
    by_rings: Sag,
    /// First moment of the rings' weight about the root, N mm.
    rings_moment: Vector3<f64>,
    length: f64,
    max_stress: RootStress,
}

/// Max stress that the root has borne, with the moment and the length of the body at that time.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct RootStress {
    /// Principal stress of bending and twist in the outer fibre of the wall, MPa.
    pub stress: f64,
    /// Magnitude of the moment of bending and twist at the root, N mm.
    pub moment: f64,
    /// Length of the body at the time of the greatest stress, mm.
    pub length: f64,
}

/// Sums over all sections. `A` is the flexibility of a section, rad/(N mm), and `m` its position from the root, mm.
#[derive(Debug, Clone, Default)]
struct Sections {
    /// Sum of `A`.
    flexibility: Matrix3<f64>,
    /// Sum of `A Z m`, where `Z v` is the moment that a unit weight at `v` has about the root.
    turned: Vector3<f64>,
    /// Sum of `m x A`, the cross products of position and flexibility.
    moved_flexibility: Matrix3<f64>,
    /// Sum of `m x A Z m`.
    moved: Vector3<f64>,
}

/// Effect of weights on the part of the body beyond all sections: the sum of the sections' turns, and the sum of the
/// cross products of position and turn.
#[derive(Debug, Clone, Copy, Default)]
struct Sag {
    turn: Vector3<f64>,
    crossed: Vector3<f64>,
}

/// Returns the moment about the root of a unit weight at this position from the root.
fn moment(at: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(-at.y, at.x, 0.0)
}

impl Sections {
    /// Adds a section with this flexibility in bending (`length / stiffness`), position and axis of the tube.
    fn add(&mut self, flexibility: f64, at: &Vector3<f64>, axis: &Vector3<f64>) {
        let flexibility = (Matrix3::identity() + axis * axis.transpose() * POISSON) * flexibility;
        let crossed = at.cross_matrix() * flexibility;
        self.flexibility += flexibility;
        self.turned += flexibility * moment(at);
        self.moved_flexibility += crossed;
        self.moved += crossed * moment(at);
    }

    /// Returns the sag that a weight (N) causes by turning all sections, if the weight is at this position (mm), beyond
    /// the last section.
    fn under(&self, weight: f64, at: &Vector3<f64>) -> Sag {
        let moment = moment(at);
        Sag {
            turn: (self.flexibility * moment - self.turned) * weight,
            crossed: (self.moved - self.moved_flexibility * moment) * weight,
        }
    }
}

impl Sag {
    fn plus(&self, other: &Self) -> Self {
        Self { turn: self.turn + other.turn, crossed: self.crossed + other.crossed }
    }

    /// Returns the displacement of a point at this position (mm from the root) beyond all sections, mm.
    fn displacement(&self, at: &Vector3<f64>) -> Vector3<f64> {
        self.turn.cross(at) - self.crossed
    }
}

impl SaggingBody {
    /// Creates a body of no length, whose tip is at this frame.
    pub fn new(robot: &Robot, base_from_start: &Frame) -> Self {
        let description = robot.description();
        let mut hanging = Self {
            // Units: kg/mm^3 and kg, times m/s^2, give N.
            ring_weight: 1e-6 * description.material.density_g_per_cm3 * robot.wall_area() * STANDARD_GRAVITY_M_PER_S2,
            tip_weight: 1e-3 * description.tip.mass_g * STANDARD_GRAVITY_M_PER_S2,
            stiffness: description.material.youngs_modulus_mpa * robot.wall_second_moment(),
            stress_per_moment: 0.5 * robot.outer_diameter() / robot.wall_second_moment(),
            root: base_from_start.translation.vector,
            root_direction: tip_direction(base_from_start),
            base_from_unloaded_tip: *base_from_start,
            sections: Sections::default(),
            by_rings: Sag::default(),
            rings_moment: Vector3::zeros(),
            length: 0.0,
            max_stress: RootStress::default(),
        };
        hanging.load_root();
        hanging
    }

    /// Adds a layer at the tip of the body.
    pub fn add_layer(&mut self, laid: &DisturbedLayer) {
        let (height, before) = (laid.layer.height, self.base_from_unloaded_tip);
        self.base_from_unloaded_tip = advance(&before, &laid.step());
        self.length += height;
        // The weight of a ring acts at the middle of its chord, and the ring turns there.
        let middle = 0.5 * (before.translation.vector + self.base_from_unloaded_tip.translation.vector) - self.root;
        let weight = self.ring_weight * height;
        self.by_rings = self.by_rings.plus(&self.sections.under(weight, &middle));
        self.rings_moment += middle * weight;
        self.sections.add(height / self.stiffness, &middle, &tip_direction(&before));
        self.load_root();
    }

    /// Returns the frame of the tip of the sagging body.
    pub fn base_from_tip(&self) -> Frame {
        let (at, sag) = (self.reach(), self.sag());
        let moved = self.base_from_unloaded_tip.translation.vector + sag.displacement(&at);
        Frame::from_parts(moved.into(), Rotation3::new(sag.turn) * self.base_from_unloaded_tip.rotation)
    }

    /// Returns the distance by which the weight displaces the tip, mm.
    pub fn deflection(&self) -> f64 {
        self.sag().displacement(&self.reach()).norm()
    }

    /// Returns the max stress that the root has borne since growth began.
    pub fn root_stress(&self) -> RootStress {
        self.max_stress
    }

    /// Returns the vector from the root to the tip of the body without weight, mm.
    fn reach(&self) -> Vector3<f64> {
        self.base_from_unloaded_tip.translation.vector - self.root
    }

    fn sag(&self) -> Sag {
        self.by_rings.plus(&self.sections.under(self.tip_weight, &self.reach()))
    }

    /// Calls `each` with the frame at the end of each layer in the finished, sagging body, from the root on. The last
    /// frame is [`Self::base_from_tip`] of this body.
    pub fn frames_of(robot: &Robot, base_from_start: &Frame, laid: &[DisturbedLayer], mut each: impl FnMut(Frame)) {
        let Self { root, ring_weight, tip_weight, stiffness, .. } = Self::new(robot, base_from_start);
        // Weight beyond a section (N), and its first moment about the root (N mm).
        let (mut weight, mut moments) = (tip_weight, Vector3::zeros());
        let mut unloaded = *base_from_start;
        let middle =
            |before: &Frame, after: &Frame| 0.5 * (before.translation.vector + after.translation.vector) - root;
        for layer in laid {
            let after = advance(&unloaded, &layer.step());
            weight += ring_weight * layer.layer.height;
            moments += middle(&unloaded, &after) * (ring_weight * layer.layer.height);
            unloaded = after;
        }
        moments += (unloaded.translation.vector - root) * tip_weight;
        let (mut unloaded, mut sag) = (*base_from_start, Sag::default());
        for layer in laid {
            let after = advance(&unloaded, &layer.step());
            let (section, ring) = (middle(&unloaded, &after), ring_weight * layer.layer.height);
            weight -= ring;
            moments -= section * ring;
            let axis = tip_direction(&unloaded);
            let load = moment(&(moments - section * weight));
            let turn = (load + axis * (POISSON * axis.dot(&load))) * (layer.layer.height / stiffness);
            sag = sag.plus(&Sag { turn, crossed: turn.cross(&section) });
            let moved = after.translation.vector + sag.displacement(&(after.translation.vector - root));
            each(Frame::from_parts(moved.into(), Rotation3::new(sag.turn) * after.rotation));
            unloaded = after;
        }
    }

    fn load_root(&mut self) {
        let moment = moment(&(self.rings_moment + self.reach() * self.tip_weight));
        let (bending, all) = (moment.cross(&self.root_direction).norm(), moment.norm());
        // The twist is the rest of the moment. The rule is Rankine's, for materials that break without yielding.
        let stress = 0.5 * (bending + all) * self.stress_per_moment;
        if stress > self.max_stress.stress {
            self.max_stress = RootStress { stress, moment: all, length: self.length };
        }
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

    /// Returns a robot whose body weighs almost nothing, with a tip of mass `tip_g` (g).
    fn light_body(tip_g: f64) -> Robot {
        robot(|robot| (robot.material.density_g_per_cm3, robot.tip.mass_g) = (1e-3, tip_g))
    }

    fn light_tip() -> Robot {
        robot(|robot| robot.tip.mass_g = 0.0)
    }

    fn tube(tilt: f64, alpha: f64) -> impl Iterator<Item = DisturbedLayer> + Clone {
        let layer = Layer { alpha, height: LENGTH / COUNT as f64, tilt: tilt / COUNT as f64 };
        core::iter::repeat_n(DisturbedLayer { layer, twist: 0.0 }, COUNT)
    }

    fn hang(robot: &Robot, start: &Frame, laid: impl Iterator<Item = DisturbedLayer>) -> SaggingBody {
        laid.fold(SaggingBody::new(robot, start), |mut hanging, layer| {
            hanging.add_layer(&layer);
            hanging
        })
    }

    fn from(heading: f64, pitch: f64) -> Frame {
        Pose::from_degrees([10.0, 20.0, 30.0, heading, pitch]).unwrap().frame()
    }

    /// Returns the weight of the body per length, N/mm, and its stiffness, N mm^2.
    fn weight_and_stiffness(robot: &Robot) -> (f64, f64) {
        let material = robot.description().material;
        let ring = core::f64::consts::TAU * 22.0 * 1.6;
        let second_moment = 0.25 * core::f64::consts::PI * (libm::pow(22.8, 4.0) - libm::pow(21.2, 4.0));
        assert!((robot.wall_second_moment() / second_moment - 1.0).abs() < 1e-12);
        (
            1e-6 * material.density_g_per_cm3 * ring * STANDARD_GRAVITY_M_PER_S2,
            material.youngs_modulus_mpa * second_moment,
        )
    }

    #[test]
    fn a_horizontal_tube_sags_by_its_weight_like_a_cantilever() {
        let robot = light_tip();
        let (weight, stiffness) = weight_and_stiffness(&robot);
        for heading in [0.0, 70.0, -135.0] {
            let start = from(heading, 0.0);
            let hung = hang(&robot, &start, tube(0.0, 0.0));
            let sag = weight * libm::pow(LENGTH, 4.0) / (8.0 * stiffness);
            let turn = weight * libm::pow(LENGTH, 3.0) / (6.0 * stiffness);
            assert!((hung.deflection() / sag - 1.0).abs() < 1e-4, "{} {sag}", hung.deflection());
            assert!((30.0 - hung.base_from_tip().translation.vector.z - sag).abs() < 1e-4 * sag);
            let direction = tip_direction(&hung.base_from_tip());
            assert!((-direction.z / turn - 1.0).abs() < 1e-4, "{direction} {turn}");
            let moment = 0.5 * weight * LENGTH * LENGTH;
            assert!((hung.root_stress().moment / moment - 1.0).abs() < 1e-9);
            let second_moment = robot.wall_second_moment();
            assert!((hung.root_stress().stress / (moment * 22.8 / second_moment) - 1.0).abs() < 1e-9);
            assert!((hung.root_stress().length - LENGTH).abs() < 1e-9);
        }
    }

    #[test]
    fn a_horizontal_tube_sags_by_its_tip_like_a_cantilever() {
        let robot = light_body(200.0);
        let (weight, stiffness) = weight_and_stiffness(&robot);
        let force = 0.2 * STANDARD_GRAVITY_M_PER_S2;
        let hung = hang(&robot, &from(30.0, 0.0), tube(0.0, 0.0));
        let sag =
            force * libm::pow(LENGTH, 3.0) / (3.0 * stiffness) + weight * libm::pow(LENGTH, 4.0) / (8.0 * stiffness);
        assert!((hung.deflection() / sag - 1.0).abs() < 1e-4, "{} {sag}", hung.deflection());
    }

    #[test]
    fn an_upright_tube_does_not_sag() {
        for pitch in [90.0, -90.0] {
            let hung = hang(&robot(|_| ()), &from(40.0, pitch), tube(0.0, 0.0));
            assert!(hung.deflection() < 1e-9 && hung.root_stress().stress < 1e-9, "{hung:?}");
        }
        let nothing = hang(&robot(|_| ()), &from(0.0, 0.0), core::iter::empty());
        assert!(nothing.deflection() == 0.0 && nothing.root_stress() == RootStress::default());
        assert_eq!(nothing.base_from_tip(), from(0.0, 0.0));
    }

    #[test]
    fn a_horizontal_arch_twists_and_bends() {
        // A quarter of a circle with a weight at its end: P R^3 / (E I) (pi / 4 + (1 + nu) (3 pi / 4 - 2)), Timoshenko.
        let robot = light_body(200.0);
        let (_, stiffness) = weight_and_stiffness(&robot);
        let hung = hang(&robot, &from(0.0, 0.0), tube(FRAC_PI_2, FRAC_PI_2));
        let radius = LENGTH / FRAC_PI_2;
        let pi = core::f64::consts::PI;
        let by_tip = 0.2 * STANDARD_GRAVITY_M_PER_S2 * libm::pow(radius, 3.0) / stiffness
            * (pi / 4.0 + (1.0 + POISSON) * (0.75 * pi - 2.0));
        let weightless = hang(&light_body(0.0), &from(0.0, 0.0), tube(FRAC_PI_2, FRAC_PI_2));
        // The weight acts on the root with an arm of one radius ahead and one sideways.
        let stress = 0.2 * STANDARD_GRAVITY_M_PER_S2 * radius * 0.5 * (1.0 + libm::sqrt(2.0)) * 22.8
            / robot.wall_second_moment();
        assert!((hung.root_stress().stress / stress - 1.0).abs() < 1e-3);
        let sag = weightless.base_from_tip().translation.z - hung.base_from_tip().translation.z;
        assert!((sag / by_tip - 1.0).abs() < 1e-3, "{sag} {by_tip}");
    }

    proptest! {
        #[test]
        fn twice_the_load_sags_twice_as_far(tilt in 0.0..3.0, alpha in 0.0..6.0, pitch in -80.0..80.0) {
            let start = from(0.0, pitch);
            let light = robot(|robot| (robot.material.density_g_per_cm3, robot.tip.mass_g) = (0.01, 1.0));
            let heavy = robot(|robot| (robot.material.density_g_per_cm3, robot.tip.mass_g) = (0.02, 2.0));
            let (one, two) = (hang(&light, &start, tube(tilt, alpha)), hang(&heavy, &start, tube(tilt, alpha)));
            prop_assert!((two.deflection() / one.deflection() - 2.0).abs() < 1e-9);
            prop_assert!((two.root_stress().stress / one.root_stress().stress - 2.0).abs() < 1e-9);
        }

        #[test]
        fn mirrored_bodies_sag_symmetrically(tilt in 0.0..3.0, alpha in 0.0..3.0, pitch in -80.0..80.0) {
            let start = from(0.0, pitch);
            let robot = robot(|_| ());
            let (left, right) = (hang(&robot, &start, tube(tilt, alpha)), hang(&robot, &start, tube(tilt, -alpha)));
            let (a, b) = (left.base_from_tip().translation.vector, right.base_from_tip().translation.vector);
            prop_assert!((a.x - b.x).abs() < 1e-9 && (a.y + b.y - 40.0).abs() < 1e-9 && (a.z - b.z).abs() < 1e-9);
            prop_assert!((left.root_stress().stress - right.root_stress().stress).abs() < 1e-9);
        }

        #[test]
        fn sag_is_invariant_under_rotation_about_the_vertical(tilt in 0.0..3.0, alpha in 0.0..6.0, heading in -180.0..180.0) {
            let robot = robot(|_| ());
            let (here, there) =
                (hang(&robot, &from(0.0, 20.0), tube(tilt, alpha)), hang(&robot, &from(heading, 20.0), tube(tilt, alpha)));
            prop_assert!((here.deflection() - there.deflection()).abs() < 1e-9);
            prop_assert!((here.base_from_tip().translation.z - there.base_from_tip().translation.z).abs() < 1e-9);
        }
    }

    /// Returns the frame of the tip of the sagging body, computed section by section without running sums.
    fn hang_section_by_section(robot: &Robot, start: &Frame, laid: &[DisturbedLayer]) -> Frame {
        let hanging = SaggingBody::new(robot, start);
        let mut frames = std::vec![*start];
        for layer in laid {
            frames.push(frames.last().unwrap() * layer.step());
        }
        let at = |index: usize| frames[index].translation.vector;
        let middle = |index: usize| 0.5 * (at(index) + at(index + 1));
        let (mut turn, mut moved) = (Vector3::zeros(), Vector3::zeros());
        for section in 0..laid.len() {
            let from = middle(section);
            let mut load = moment(&(at(laid.len()) - from)) * hanging.tip_weight;
            for (ring, layer) in laid.iter().enumerate().skip(section + 1) {
                load += moment(&(middle(ring) - from)) * (hanging.ring_weight * layer.layer.height);
            }
            let axis = tip_direction(&frames[section]);
            let turned = (load + axis * (POISSON * axis.dot(&load))) * (laid[section].layer.height / hanging.stiffness);
            turn += turned;
            moved += turned.cross(&(at(laid.len()) - from));
        }
        Frame::from_parts((at(laid.len()) + moved).into(), Rotation3::new(turn) * frames[laid.len()].rotation)
    }

    proptest! {
        #[test]
        fn running_sums_match_section_by_section_sum(seed in 0_u64..1000, pitch in -90.0..90.0, count in 1_usize..80) {
            let robot = robot(|_| ());
            let layer = Layer { alpha: 1.0, height: 0.7, tilt: 0.02 };
            let wild = super::super::Disturbance {
                growth_noise: 0.5, tilt_noise: 0.05, alpha_noise: 1.0, twist_noise: 0.3, ..Default::default()
            };
            let laid: std::vec::Vec<DisturbedLayer> = (0..count as u64).map(|index| wild.lay(seed, index, &layer)).collect();
            let start = from(50.0, pitch);
            let hung = hang(&robot, &start, laid.iter().copied()).base_from_tip();
            let plain = hang_section_by_section(&robot, &start, &laid);
            prop_assert!((hung.to_homogeneous() - plain.to_homogeneous()).norm() < 1e-11);
            let mut frames = std::vec::Vec::new();
            SaggingBody::frames_of(&robot, &start, &laid, |frame| frames.push(frame));
            prop_assert_eq!(frames.len(), laid.len());
            let last = frames.last().unwrap();
            prop_assert!((hung.to_homogeneous() - last.to_homogeneous()).norm() < 1e-11);
        }
    }
}
