//! Random scenes for experiments: a rack of pipes, and a heap of rubble.
//!
//! Each scene has a free way, along which a tube can grow through it.

use std::f64::consts::TAU;

use growbot_core::random::Rng;
use growbot_core::trigonometry::sin_cos;
use nalgebra::Vector3;

use crate::scene_file::{BoxToml, CapsuleToml, FORMAT, HalfSpaceToml, SceneFile};
use crate::shapes::Shape;

/// Minimum distance between the outside of the tube and the obstacles, mm.
const MARGIN: f64 = 5.0;
/// Distance from the middle of the free way within which there are no obstacles, mm: enough for a tube with a diameter
/// of 44 mm, its margin, and deviations from the way.
const ROOM: f64 = 34.0;
/// Length by which the free way continues straight beyond both ends, mm.
const BEYOND: f64 = 120.0;

/// Kind of example scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DemoScene {
    /// Levels of pipes between posts, alternately along x and along y. The free way leads from 0, 0, 0 upwards.
    PipeRack,
    /// Slabs and bricks on a floor. The free way leads from 0, 0, 60 along x.
    RubbleHeap,
}

impl DemoScene {
    /// Returns the ends of the free way as arguments of the command line: the start as a pose, the goal as a position.
    pub fn endpoints(self) -> (&'static str, &'static str) {
        match self {
            Self::PipeRack => ("0,0,0,0,90", "0,0,960"),
            Self::RubbleHeap => ("0,0,60,0,0", "900,0,60"),
        }
    }

    /// Returns the point at this fraction (0 to 1) of the free way, mm.
    fn way(self, share: f64) -> Vector3<f64> {
        let (_, cosine) = sin_cos(TAU * share);
        let aside = 0.5 * (1.0 - cosine);
        match self {
            Self::PipeRack => Vector3::new(130.0 * aside, -90.0 * aside, 960.0 * share),
            Self::RubbleHeap => Vector3::new(900.0 * share, 90.0 * aside, 60.0 + 20.0 * aside),
        }
    }

    /// Returns points of the free way, including the straight parts beyond its ends.
    fn free(self) -> Vec<Vector3<f64>> {
        let along = match self {
            Self::PipeRack => Vector3::z(),
            Self::RubbleHeap => Vector3::x(),
        };
        let ends = (0..=30).map(f64::from).flat_map(|step| {
            let beyond = along * (BEYOND * step / 30.0);
            [self.way(0.0) - beyond, self.way(1.0) + beyond]
        });
        (0..=240).map(|step| self.way(f64::from(step) / 240.0)).chain(ends).collect()
    }

    /// Returns the scene of a seed, which is the same on every machine.
    pub fn scene(self, seed: u64) -> SceneFile {
        let mut random = Rng::new(&[self as u64, seed, 47]);
        let free = self.free();
        let is_free = |shape: &Shape| free.iter().all(|point| shape.distance(point) > ROOM);
        let mut scene = SceneFile { format: FORMAT.to_owned(), margin_mm: Some(MARGIN), ..SceneFile::default() };
        match self {
            Self::PipeRack => pipe_rack(&mut random, &mut scene, is_free),
            Self::RubbleHeap => rubble_heap(&mut random, &mut scene, is_free),
        }
        scene
    }
}

/// Rounds lengths (mm) or angles (degrees) to whole numbers.
fn whole(point: [f64; 3]) -> [f64; 3] {
    point.map(f64::round)
}

fn pipe_rack(random: &mut Rng, scene: &mut SceneFile, is_free: impl Fn(&Shape) -> bool) {
    for (x, y) in [(-350.0, -350.0), (-350.0, 350.0), (350.0, -350.0), (350.0, 350.0)] {
        scene.boxes.push(BoxToml { center_mm: [x, y, 450.0], size_mm: [50.0, 50.0, 900.0], rpy_deg: [0.0; 3] });
    }
    for level in 0..6 {
        let height = 150.0 + 130.0 * f64::from(level);
        let mut aside = -300.0 + random.uniform_between(0.0, 60.0);
        while aside < 310.0 {
            let (lower, higher) = (height + random.uniform_between(-12.0, 12.0), random.uniform_between(-12.0, 12.0));
            let ends = [[-380.0, aside, lower], [380.0, aside + higher, lower]];
            // Every other level has the other direction.
            let ends = if level % 2 == 0 { ends } else { ends.map(|[x, y, z]| [y, x, z]) };
            let [from_mm, to_mm] = ends.map(whole);
            let pipe = CapsuleToml { from_mm, to_mm, radius_mm: random.uniform_between(10.0, 26.0).round() };
            if is_free(&Shape::Capsule { from: from_mm.into(), to: to_mm.into(), radius: pipe.radius_mm }) {
                scene.capsules.push(pipe);
            }
            aside += random.uniform_between(70.0, 115.0);
        }
    }
}

fn rubble_heap(random: &mut Rng, scene: &mut SceneFile, is_free: impl Fn(&Shape) -> bool) {
    scene.half_spaces.push(HalfSpaceToml { point_mm: [0.0; 3], normal: [0.0, 0.0, 1.0] });
    for _ in 0..130 {
        // The heap is lower towards its edge.
        let (x, y) = (random.uniform_between(120.0, 780.0), random.uniform_between(-300.0, 300.0));
        let [along, across] = [(x - 450.0) / 400.0, y / 380.0];
        let slope = 1.0 - (along * along + across * across).min(1.0);
        let height = random.uniform_between(10.0, 20.0 + 260.0 * slope);
        let size_mm = if random.below(3) == 0 {
            [
                random.uniform_between(90.0, 200.0),
                random.uniform_between(60.0, 140.0),
                random.uniform_between(15.0, 30.0),
            ]
        } else {
            [
                random.uniform_between(40.0, 110.0),
                random.uniform_between(30.0, 60.0),
                random.uniform_between(25.0, 50.0),
            ]
        };
        let (center_mm, size_mm) = (whole([x, y, height]), whole(size_mm));
        let rpy_deg = whole([
            random.uniform_between(-40.0, 40.0),
            random.uniform_between(-40.0, 40.0),
            random.uniform_between(-180.0, 180.0),
        ]);
        let stone = SceneFile { boxes: vec![BoxToml { center_mm, size_mm, rpy_deg }], ..SceneFile::default() };
        if stone.shapes().iter().all(&is_free) {
            scene.boxes.extend(stone.boxes);
        }
    }
}

/// Returns the text of a scene file that begins with these comments. It contains only the half spaces, boxes and
/// capsules of `scene`.
pub fn to_toml(scene: &SceneFile, comments: &[String]) -> String {
    let mut text: String = comments.iter().map(|comment| format!("# {comment}\n")).collect();
    text += &format!("format = {:?}\n", scene.format);
    text += &scene.margin_mm.map_or_else(String::new, |margin| format!("margin_mm = {margin:?}\n"));
    for it in &scene.half_spaces {
        text += &format!("\n[[halfspace]]\npoint_mm = {:?}\nnormal = {:?}\n", it.point_mm, it.normal);
    }
    for it in &scene.boxes {
        text += &format!(
            "\n[[box]]\ncenter_mm = {:?}\nsize_mm = {:?}\nrpy_deg = {:?}\n",
            it.center_mm, it.size_mm, it.rpy_deg
        );
    }
    for it in &scene.capsules {
        text += &format!(
            "\n[[capsule]]\nfrom_mm = {:?}\nto_mm = {:?}\nradius_mm = {:?}\n",
            it.from_mm, it.to_mm, it.radius_mm
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_file::parse;

    const EXAMPLES: [DemoScene; 2] = [DemoScene::PipeRack, DemoScene::RubbleHeap];

    #[test]
    fn a_scene_is_determined_by_its_seed_and_round_trips() {
        for example in EXAMPLES {
            let scene = example.scene(1);
            assert_eq!(scene, example.scene(1));
            assert_ne!(scene, example.scene(2));
            let text = to_toml(&scene, &["What it is".to_owned()]);
            assert!(text.starts_with("# What it is\nformat"), "{text}");
            assert_eq!(parse(&text, "scene.toml").unwrap(), scene);
            assert!(scene.boxes.len() + scene.capsules.len() > 30, "{}", text.len());
        }
    }

    #[test]
    fn the_free_passage_has_the_required_clearance() {
        for example in EXAMPLES {
            for seed in 0..20 {
                let shapes = example.scene(seed).shapes();
                let free = example.free();
                let nearest = |shape: &Shape| free.iter().map(|at| shape.distance(at)).fold(f64::INFINITY, f64::min);
                let least = shapes.iter().map(nearest).fold(f64::INFINITY, f64::min);
                // The distance must not be much larger than needed, or there would be nothing in the way.
                assert!((ROOM..ROOM + 40.0).contains(&least), "{example:?}, seed {seed}: {least}");
            }
        }
    }
}
