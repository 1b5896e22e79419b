//! Compares distances and clearances with the minimum over every obstacle, computed one by one with independent
//! formulas.

use growbot_core::random::Rng;
use growbot_scene::centreline::{ArcSegment, Curve, TipPose, any_perpendicular};
use growbot_scene::clearance::{DistanceQueries, RequiredClearance, is_clear, min_clearance};
use growbot_scene::random_scenes::{FAMILIES, TubeLimits, brute_force_clearance, brute_force_triangle, random_scene};
use growbot_scene::scene::{Mesh, Scene};
use growbot_scene::shapes::{HalfSpace, Triangle};
use nalgebra::Vector3;

/// Maximum excess of a computed distance over the true distance, mm.
const ABOVE: f64 = 1e-9;
/// Returns the number of points that are tested in each scene. GROWBOT_DISTANCES sets it for a long trial.
fn points() -> u32 {
    std::env::var("GROWBOT_DISTANCES").ok().and_then(|count| count.parse().ok()).unwrap_or(2_000)
}

const BODY: TubeLimits = TubeLimits { radius: 100.0, clearance: 28.55 };

fn anywhere(random: &mut Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| random.uniform_between(-500.0, 1000.0))
}

#[test]
fn point_distance_is_that_of_the_nearest_obstacle() {
    for family in FAMILIES {
        let drawn = random_scene(family, 3, &BODY);
        let scene = drawn.scene();
        let mut random = Rng::new(&[family as u64, 1]);
        for _ in 0..points() {
            let point = anywhere(&mut random);
            let here = ArcSegment::line(TipPose { position: point, direction: Vector3::z() }, 0.0);
            let truth = brute_force_clearance(&drawn, &[here], 1.0);
            let found = scene.distance(&point);
            // Inside, the brute force returns 0, or the distance from a mesh's surface.
            assert!(found <= truth + ABOVE, "{family:?} {point:?}: {found} is above {truth}");
            assert!(found < 0.0 || found >= truth - ABOVE, "{family:?} {point:?}: {found} is far below {truth}");
        }
    }
}

/// Returns triangles of any kind, including thin ones.
fn triangles(random: &mut Rng, count: u32) -> Vec<Triangle> {
    let triangle = |_| {
        let centre = anywhere(random);
        let size = libm::exp2(random.uniform_between(-4.0, 8.0));
        let mut corners = [0; 3].map(|_| centre + random.normal_vector() * size);
        if random.below(4) == 0 {
            let share = random.uniform_between(-0.5, 1.5);
            let off = random.normal_vector() * size * libm::exp2(random.uniform_between(-20.0, 0.0));
            corners[2] = corners[0] + (corners[1] - corners[0]) * share + off;
        }
        Triangle(corners)
    };
    (0..count).map(triangle).collect()
}

#[test]
fn distances_to_random_meshes_are_lower_bounds() {
    let mut random = Rng::new(&[7]);
    for _ in 0..20 {
        let triangles = triangles(&mut random, 200);
        let scene = Scene::new(vec![], vec![], vec![], vec![Mesh::surface(triangles.clone())]);
        let truth = |point: &Vector3<f64>| {
            triangles.iter().map(|triangle| brute_force_triangle(triangle, point)).fold(f64::INFINITY, f64::min)
        };
        for _ in 0..points() / 20 {
            let point = anywhere(&mut random);
            let (found, truth_here) = (scene.distance(&point), truth(&point));
            assert!(found <= truth_here + ABOVE, "{found} is above {truth_here}");
            assert!(found >= truth_here - 1e-6, "{found} is far below {truth_here}");
            let line = ArcSegment::line(
                TipPose { position: point, direction: random.direction() },
                random.uniform_between(0.0, 100.0),
            );
            let nearest = min_clearance(&scene, &[line], 1e-3).distance;
            let sampled = (0..=50).map(|i| truth(&line.point(line.length * f64::from(i) / 50.0)));
            assert!(nearest <= sampled.fold(f64::INFINITY, f64::min) + ABOVE);
        }
    }
}

#[test]
fn points_inside_a_closed_mesh_are_distinguished_from_outside() {
    let mut random = Rng::new(&[11]);
    for number in 0..10 {
        let drawn = random_scene(growbot_scene::random_scenes::SceneFamily::Rubble, number, &BODY);
        let scene = drawn.scene();
        for _ in 0..200 {
            let point = anywhere(&mut random);
            // The solid angles of all triangles add up to whole turns if the point is inside (van Oosterom and Strackee
            // 1983).
            let angle = |Triangle(corners): &Triangle| {
                let [a, b, c] = corners.map(|corner| corner - point);
                let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
                let below = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
                2.0 * libm::atan2(a.dot(&b.cross(&c)), below)
            };
            let turns = drawn.triangles.iter().map(angle).sum::<f64>() / (4.0 * std::f64::consts::PI);
            assert_eq!(scene.distance(&point) < 0.0, turns.round() != 0.0, "{point:?}: {turns} turns");
        }
    }
}

#[test]
fn distance_is_negative_inside() {
    let floor = HalfSpace { point: Vector3::zeros(), normal: Vector3::z() };
    let scene = Scene::new(vec![], vec![floor], vec![], vec![]);
    assert_eq!(scene.distance(&Vector3::new(5.0, 5.0, -3.0)), -3.0);
    assert_eq!(Scene::default().distance(&Vector3::zeros()), f64::INFINITY);
}

#[test]
fn proven_clearances_are_tight_lower_bounds_at_every_point() {
    for family in FAMILIES {
        let drawn = random_scene(family, 8, &BODY);
        let scene = drawn.scene();
        let mut random = Rng::new(&[family as u64, 2]);
        for _ in 0..100 {
            let from = TipPose { position: anywhere(&mut random), direction: random.direction() };
            let towards = any_perpendicular(&from.direction);
            let arc = ArcSegment { from, towards, curvature: 0.01, length: random.uniform_between(1.0, 300.0) };
            let stretch = if random.below(2) == 0 { arc } else { ArcSegment { curvature: 0.0, ..arc } };
            let proven = min_clearance(&scene, &[stretch], 1e-3).distance;
            let sampled = (0..=3000).map(|i| {
                let along = stretch.length * f64::from(i) / 3000.0;
                scene.distance_within(&stretch.point(along), f64::INFINITY)
            });
            let sampled = sampled.fold(f64::INFINITY, f64::min);
            // Between samples the distance may be smaller by half their interval.
            assert!(proven <= sampled && proven >= sampled - 1e-3 - stretch.length / 6000.0, "{proven}, {sampled}");
            for (distance, clear) in [(sampled - 0.2, true), (sampled + 1e-6, false)] {
                let need = RequiredClearance { distance, tolerance: 1e-3 };
                assert_eq!(is_clear(&scene, &stretch, &need, &mut DistanceQueries(0)), clear, "{distance}, {sampled}");
            }
        }
    }
}
