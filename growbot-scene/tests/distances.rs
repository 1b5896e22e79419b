//! Compares distances and clearances with those of every obstacle, computed one by one with independent formulas.

use growbot_core::random::Random;
use growbot_scene::clear::{Need, Work, is_clear, least};
use growbot_scene::families::{Body, FAMILIES, brute_force_least, brute_force_triangle, draw};
use growbot_scene::motion::{Curve, Stretch, Tip, any_across};
use growbot_scene::scene::{Mesh, Scene};
use growbot_scene::shapes::{HalfSpace, Triangle};
use nalgebra::Vector3;

/// Maximum excess of a distance over the true one, mm.
const ABOVE: f64 = 1e-9;
/// Returns the number of points for each scene. GROWBOT_DISTANCES sets it for a long trial.
fn points() -> u32 {
    std::env::var("GROWBOT_DISTANCES").ok().and_then(|count| count.parse().ok()).unwrap_or(2_000)
}

const BODY: Body = Body { radius: 100.0, need: 28.55 };

fn anywhere(random: &mut Random) -> Vector3<f64> {
    Vector3::from_fn(|_, _| random.between(-500.0, 1000.0))
}

#[test]
fn distances_of_points_are_those_of_the_nearest_obstacle() {
    for family in FAMILIES {
        let drawn = draw(family, 3, &BODY);
        let scene = drawn.scene();
        let mut random = Random::new(&[family as u64, 1]);
        for _ in 0..points() {
            let point = anywhere(&mut random);
            let here = Stretch::line(Tip { position: point, direction: Vector3::z() }, 0.0);
            let truth = brute_force_least(&drawn, &[here], 1.0);
            let found = scene.distance(&point);
            // Inside, the brute force returns 0, or the distance from a mesh's surface.
            assert!(found <= truth + ABOVE, "{family:?} {point:?}: {found} is above {truth}");
            assert!(found < 0.0 || found >= truth - ABOVE, "{family:?} {point:?}: {found} is far below {truth}");
        }
    }
}

/// Returns triangles of any kind, including thin ones.
fn triangles(random: &mut Random, count: u32) -> Vec<Triangle> {
    let triangle = |_| {
        let centre = anywhere(random);
        let size = libm::exp2(random.between(-4.0, 8.0));
        let mut corners = [0; 3].map(|_| centre + random.normal_vector() * size);
        if random.below(4) == 0 {
            let share = random.between(-0.5, 1.5);
            let off = random.normal_vector() * size * libm::exp2(random.between(-20.0, 0.0));
            corners[2] = corners[0] + (corners[1] - corners[0]) * share + off;
        }
        Triangle(corners)
    };
    (0..count).map(triangle).collect()
}

#[test]
fn distances_of_points_and_segments_to_random_meshes_are_never_above_the_true_ones() {
    let mut random = Random::new(&[7]);
    for _ in 0..20 {
        let triangles = triangles(&mut random, 200);
        let scene = Scene::new(vec![], vec![], vec![], vec![Mesh::new(triangles.clone(), false)]);
        let truth = |point: &Vector3<f64>| {
            triangles.iter().map(|triangle| brute_force_triangle(triangle, point)).fold(f64::INFINITY, f64::min)
        };
        for _ in 0..points() / 20 {
            let point = anywhere(&mut random);
            let (found, truth_here) = (scene.distance(&point), truth(&point));
            assert!(found <= truth_here + ABOVE, "{found} is above {truth_here}");
            assert!(found >= truth_here - 1e-6, "{found} is far below {truth_here}");
            let line =
                Stretch::line(Tip { position: point, direction: random.direction() }, random.between(0.0, 100.0));
            let nearest = least(&scene, &[line], 1e-3).distance;
            let sampled = (0..=50).map(|i| truth(&line.point(line.length * f64::from(i) / 50.0)));
            assert!(nearest <= sampled.fold(f64::INFINITY, f64::min) + ABOVE);
        }
    }
}

#[test]
fn points_inside_a_closed_mesh_are_told_from_those_outside() {
    let mut random = Random::new(&[11]);
    for number in 0..10 {
        let drawn = draw(growbot_scene::families::Family::Rubble, number, &BODY);
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
fn inside_is_below_zero() {
    let floor = HalfSpace { point: Vector3::zeros(), normal: Vector3::z() };
    let scene = Scene::new(vec![], vec![floor], vec![], vec![]);
    assert_eq!(scene.distance(&Vector3::new(5.0, 5.0, -3.0)), -3.0);
    assert_eq!(Scene::default().distance(&Vector3::zeros()), f64::INFINITY);
}

#[test]
fn proven_clearances_hold_at_every_point_and_are_not_far_below() {
    for family in FAMILIES {
        let drawn = draw(family, 8, &BODY);
        let scene = drawn.scene();
        let mut random = Random::new(&[family as u64, 2]);
        for _ in 0..100 {
            let from = Tip { position: anywhere(&mut random), direction: random.direction() };
            let towards = any_across(&from.direction);
            let arc = Stretch { from, towards, curvature: 0.01, length: random.between(1.0, 300.0) };
            let stretch = if random.below(2) == 0 { arc } else { Stretch { curvature: 0.0, ..arc } };
            let proven = least(&scene, &[stretch], 1e-3).distance;
            let sampled = (0..=3000).map(|i| {
                let along = stretch.length * f64::from(i) / 3000.0;
                scene.distance_within(&stretch.point(along), f64::INFINITY)
            });
            let sampled = sampled.fold(f64::INFINITY, f64::min);
            // Between samples the distance may be smaller by half their interval.
            assert!(proven <= sampled && proven >= sampled - 1e-3 - stretch.length / 6000.0, "{proven}, {sampled}");
            for (distance, clear) in [(sampled - 0.2, true), (sampled + 1e-6, false)] {
                let need = Need { distance, slack: 1e-3 };
                assert_eq!(is_clear(&scene, &stretch, &need, &mut Work(0)), clear, "{distance}, {sampled}");
            }
        }
    }
}
