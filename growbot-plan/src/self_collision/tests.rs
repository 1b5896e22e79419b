use std::f64::consts::{PI, TAU};

use growbot_core::helicoid::Helicoid;
use growbot_core::path;
use growbot_core::pose::Frame;
use nalgebra::Vector3;
use proptest::prelude::*;

use super::body_tree::BodyPiece;
use super::*;

const DIAMETER: f64 = 60.0;

fn segment() -> impl Strategy<Value = Segment> {
    let helicoid = (0.0..TAU, -2.0..0.0, -1.0..1.0, -1.0..1.0, 0.1..1.0, 98.2..200.0, 0.01..7.0).prop_map(
        |(angle, exponent, x, y, along, radius, bend): (f64, f64, f64, f64, f64, f64, f64)| {
            let size = libm::pow(10.0, exponent);
            let axis = Vector3::new(libm::cos(angle), libm::sin(angle), 0.0);
            let side = Vector3::new(-axis.y, axis.x, 0.0);
            let curve = Helicoid { m0: axis * size, p: axis * along + side * x + Vector3::z() * y };
            Segment::Helicoid { curve, radius, length: bend * radius }
        },
    );
    prop_oneof![
        (0.0..TAU, 1e-9..TAU, 98.2..300.0).prop_map(|(alpha, bend, radius)| Segment::Arc {
            alpha,
            bend,
            length: bend * radius
        }),
        (1e-7..500.0).prop_map(|length| Segment::Straight { length }),
        helicoid,
    ]
}

/// Returns points of a body at most `step` mm apart, each with its length along the body.
fn points(path: &[Segment], step: f64) -> Vec<(f64, Vector3<f64>)> {
    let (mut points, mut tip, mut at) = (Vec::new(), Frame::identity(), 0.0);
    for segment in path {
        let count = libm::ceil(segment.length() / step);
        for i in 0..count as usize {
            let along = segment.length() * i as f64 / count;
            let part = match *segment {
                Segment::Arc { alpha, bend, length } => {
                    Segment::Arc { alpha, bend: bend * along / length, length: along }
                }
                Segment::Straight { .. } => Segment::Straight { length: along },
                Segment::Helicoid { curve, radius, .. } => Segment::Helicoid { curve, radius, length: along },
            };
            points.push((at + along, (tip * part.step()).translation.vector));
        }
        tip *= segment.step();
        at += segment.length();
    }
    points.push((at, tip.translation.vector));
    points
}

/// Returns the minimum distance over all pairs of points that are not neighbours.
fn by_looking_at_all(path: &[Segment], since: f64, step: f64) -> f64 {
    let points = points(path, step);
    let mut min = f64::INFINITY;
    for (i, (to, b)) in points.iter().enumerate().filter(|(_, (to, _))| *to > since) {
        let strangers = points[..i].iter().take_while(|(from, _)| to - from >= FRAC_PI_2 * DIAMETER);
        min = strangers.fold(min, |min, (_, a)| min.min((a - b).norm()));
    }
    min
}

fn assert_agrees(path: &[Segment], since: f64) {
    let step = 2.5;
    let (found, all) = (closest_self_approach(path, DIAMETER, since), by_looking_at_all(path, since, step));
    match found {
        None => assert!(all >= DIAMETER * (1.0 - 1e-9), "missed {all} in {path:?}"),
        Some(Collision { distance, at: [from, to] }) => {
            assert!(distance <= all + 1e-9, "{distance} is not the min, {all} is: {path:?}");
            // The true minimum distance may be smaller than that of the sampled points, by at most the step.
            assert!(distance >= all - step - TOLERANCE * DIAMETER, "{distance} is no distance: {all} is: {path:?}");
            assert!(to >= since - 1e-6 && to - from >= FRAC_PI_2 * DIAMETER * (1.0 - 1e-9), "{from} to {to}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn search_agrees_with_brute_force(path in prop::collection::vec(segment(), 0..7)) {
        assert_agrees(&path, 0.0);
    }

    #[test]
    fn only_the_later_part_is_checked(path in prop::collection::vec(segment(), 2..6), before in 1_usize..3) {
        let before = path::length(&path[..before.min(path.len())]);
        assert_agrees(&path, before);
    }

    #[test]
    fn reported_distance_matches_the_reported_points(path in prop::collection::vec(segment(), 2..7)) {
        let Some(Collision { distance, at }) = closest_self_approach(&path, DIAMETER, 0.0) else { return Ok(()) };
        let [a, b] = at.map(|at| {
            let mut left = at;
            let mut tip = Frame::identity();
            for segment in &path {
                let piece = BodyPiece { base_from_start: tip, segment: *segment, at: 0.0, turned: 0.0 };
                if left <= segment.length() {
                    return piece.point(left);
                }
                left -= segment.length();
                tip *= segment.step();
            }
            tip.translation.vector
        });
        prop_assert!(((a - b).norm() - distance).abs() <= TOLERANCE * DIAMETER, "{} is not {distance}", (a - b).norm());
    }
}

fn arc(bend: f64, radius: f64) -> Segment {
    Segment::Arc { alpha: 0.0, bend, length: bend * radius }
}

#[test]
fn points_brought_close_by_one_bend_do_not_collide() {
    for radius in [35.0, 45.0, 100.0, 1e4] {
        assert_eq!(closest_self_approach(&[arc(PI, radius)], DIAMETER, 0.0), None);
    }
    assert_eq!(closest_self_approach(&[Segment::Straight { length: 1e7 }], DIAMETER, 0.0), None);
    assert_eq!(closest_self_approach(&[], DIAMETER, 0.0), None);
}

#[test]
fn a_full_turn_collides_with_its_start() {
    let Collision { distance, at: [from, to] } = closest_self_approach(&[arc(TAU, 100.0)], DIAMETER, 0.0).unwrap();
    assert!(distance == 0.0 && from < 1.0 && to > TAU * 100.0 - 1.0, "{distance} at {from}, {to}");
}

#[test]
fn distance_between_antiparallel_segments_is_measured() {
    for (radius, meets) in [(29.9, true), (29.99, true), (30.01, false), (30.1, false)] {
        let path = [Segment::Straight { length: 3000.0 }, arc(PI, radius), Segment::Straight { length: 2500.0 }];
        let found = closest_self_approach(&path, DIAMETER, 0.0);
        assert_eq!(found.is_some(), meets, "{radius}");
        if let Some(Collision { distance, .. }) = found {
            assert!((distance - 2.0 * radius).abs() < TOLERANCE * DIAMETER);
        }
    }
}

#[test]
fn long_bodies_need_few_pair_checks() {
    // A body of 10 km that stays clear of itself, one of 200 turns, and one that collides with itself everywhere.
    let min_distance = |path: &[Segment], max_pairs: usize| {
        let (found, pairs) = search(path, DIAMETER, 0.0);
        println!("{} segments: {pairs} pairs", path.len());
        assert!(pairs <= max_pairs, "{pairs} pairs");
        found.map(|found| found.distance)
    };
    let far = [arc(1.0, 1e6), Segment::Straight { length: 1e7 }, arc(3.0, 1e6)];
    assert_eq!(min_distance(&far, 50), None);
    let pitch = 61.0;
    let turns: Vec<Segment> = (0..400).flat_map(|i| [arc(PI, 100.0 + pitch * f64::from(i) / 2.0)]).collect();
    assert_eq!(min_distance(&turns, 3_000_000), None);
    let ring: Vec<Segment> = (0..5000).map(|_| arc(TAU, 100.0)).collect();
    assert_eq!(min_distance(&ring, 200_000), Some(0.0));
    let nearly: Vec<Segment> = (0..300).flat_map(|_| [arc(TAU, 100.0), Segment::Straight { length: 0.37 }]).collect();
    assert!(min_distance(&nearly, 20_000).unwrap() < 0.5);
}
