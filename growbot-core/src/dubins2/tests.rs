//! Tests with each family of goals for which path types degenerate, and of the bounds that exclude path types.

use core::f64::consts::{FRAC_PI_2, PI, TAU};

use proptest::prelude::*;

use super::*;
use crate::angle::wrap_positive;

/// Max error of a path at the goal, radii and radians, for goals within some 60 radii.
const GOAL_TOLERANCE: f64 = 1e-12;
/// Max error of a path at goals beyond some 60 radii, as a fraction of the distance, because the goal itself has fewer
/// digits there.
const GOAL_TOLERANCE_PER_DISTANCE: f64 = 1e-12 / 64.0;

/// A goal, and the length of a path to it that the test has constructed.
#[derive(Debug, Clone, Copy)]
struct Laid {
    goal: PlanarPose,
    length: f64,
}

fn laid(path_type: PathType, lengths: [f64; 3]) -> Laid {
    let path = PlanarPath { path_type, lengths };
    Laid { goal: path.end(), length: path.length() }
}

fn assert_arrives(goal: &PlanarPose) -> PlanarPath {
    let path = shortest(goal);
    let miss = path.goal_error(goal);
    let tolerance = GOAL_TOLERANCE.max(GOAL_TOLERANCE_PER_DISTANCE * libm::hypot(goal.x, goal.y));
    assert!(miss <= tolerance, "{goal:?}: {path:?} misses by {miss}");
    path
}

/// Asserts that the path found reaches the goal and is not longer than the constructed path.
fn assert_as_short(laid: &Laid) {
    let path = assert_arrives(&laid.goal);
    assert!(path.length() <= laid.length + 1e-9, "{laid:?}: {path:?} is {} long", path.length());
}

fn any_path_type() -> impl Strategy<Value = PathType> + Clone {
    prop::sample::select(&PathType::ALL)
}

/// Generates one of the path types LSL and RSR.
fn outer() -> impl Strategy<Value = PathType> {
    prop::sample::select(&[PathType::Lsl, PathType::Rsr])
}

/// Generates one of the path types LSR and RSL.
fn inner() -> impl Strategy<Value = PathType> {
    prop::sample::select(&[PathType::Lsr, PathType::Rsl])
}

/// Generates ten to the power of a number in a range.
fn magnitude(exponents: core::ops::Range<f64>) -> impl Strategy<Value = f64> {
    exponents.prop_map(|exponent| libm::pow(10.0, exponent))
}

fn random_goal() -> impl Strategy<Value = PlanarPose> {
    (-40.0..40.0, -40.0..40.0, -7.0..7.0).prop_map(|(x, y, heading)| PlanarPose { x, y, heading })
}

fn near_goal() -> impl Strategy<Value = PlanarPose> {
    (-5.0..5.0, -5.0..5.0, -7.0..7.0).prop_map(|(x, y, heading)| PlanarPose { x, y, heading })
}

fn far_goal() -> impl Strategy<Value = PlanarPose> {
    (magnitude(0.0..300.0), random_goal()).prop_map(|(scale, goal)| PlanarPose {
        x: goal.x * scale,
        y: goal.y * scale,
        heading: goal.heading,
    })
}

fn whole_path_type() -> impl Strategy<Value = Laid> {
    (any_path_type(), 0.0..TAU, 0.0..TAU, 0.0..TAU)
        .prop_map(|(path_type, first, middle, last)| laid(path_type, [first, middle, last]))
}

fn arc_below_pi() -> impl Strategy<Value = Laid> {
    (outer(), 0.0..PI).prop_map(|(path_type, angle)| laid(path_type, [angle, 0.0, 0.0]))
}

fn arc_above_pi() -> impl Strategy<Value = Laid> {
    (outer(), PI..TAU).prop_map(|(path_type, angle)| laid(path_type, [angle, 0.0, 0.0]))
}

fn tangent_arcs() -> impl Strategy<Value = Laid> {
    (inner(), 0.0..TAU, 0.0..TAU).prop_map(|(path_type, first, last)| laid(path_type, [first, 0.0, last]))
}

fn arc_then_line() -> impl Strategy<Value = Laid> {
    (outer(), 0.0..TAU, 0.0..40.0).prop_map(|(path_type, angle, line)| laid(path_type, [angle, line, 0.0]))
}

fn line_then_arc() -> impl Strategy<Value = Laid> {
    (outer(), 0.0..40.0, 0.0..TAU).prop_map(|(path_type, line, angle)| laid(path_type, [0.0, line, angle]))
}

/// Generates goals straight ahead, exactly or up to a rounding error.
fn line() -> impl Strategy<Value = Laid> {
    (0.0..40.0, -1e-13..1e-13, -1e-14..1e-14, any::<bool>()).prop_map(|(x, y, heading, exact)| {
        let goal = if exact { PlanarPose { x, y: 0.0, heading: 0.0 } } else { PlanarPose { x, y, heading } };
        Laid { goal, length: x }
    })
}

/// Generates goals at the position and in the direction of the start, up to a rounding error, with any number of turns
/// added to the heading.
fn coincident() -> impl Strategy<Value = Laid> {
    (-4e-13..4e-13, -4e-13..4e-13, -4e-13..4e-13, -3_i8..4).prop_map(|(x, y, off, turns)| Laid {
        goal: PlanarPose { x, y, heading: off + f64::from(turns) * TAU },
        length: 0.0,
    })
}

/// Generates goals whose direction is opposite to that of the start.
fn antiparallel() -> impl Strategy<Value = Laid> {
    (any_path_type(), 0.0..TAU, 0.0..TAU).prop_map(|(path_type, first, middle)| {
        let last = match path_type {
            PathType::Lsl | PathType::Rsr => PI - first,
            PathType::Lsr | PathType::Rsl => first - PI,
            PathType::Lrl | PathType::Rlr => PI - first + middle,
        };
        let Laid { goal, length } = laid(path_type, [first, middle, wrap_positive(last)]);
        Laid { goal: PlanarPose { heading: PI, ..goal }, length }
    })
}

fn tiny_step() -> impl Strategy<Value = Laid> {
    (magnitude(-12.0..-3.0), 0.0..1.0, any_path_type()).prop_map(|(size, share, path_type)| {
        laid(path_type, [size * share, size * (1.0 - share), size * share * share])
    })
}

/// Generates goals of all families above, many of them displaced by a rounding error or more.
fn any_goal() -> impl Strategy<Value = PlanarPose> {
    let laid = prop_oneof![
        whole_path_type(),
        arc_below_pi(),
        arc_above_pi(),
        tangent_arcs(),
        arc_then_line(),
        line_then_arc(),
        line(),
        coincident(),
        antiparallel(),
        tiny_step(),
    ];
    let off = (laid, prop_oneof![Just(0.0), magnitude(-17.0..-1.0)], [-1.0..1.0, -1.0..1.0, -1.0..1.0]).prop_map(
        |(Laid { goal, .. }, size, [x, y, heading])| PlanarPose {
            x: goal.x + size * x,
            y: goal.y + size * y,
            heading: goal.heading + size * heading,
        },
    );
    prop_oneof![2 => random_goal(), 2 => near_goal(), 1 => far_goal(), 5 => off]
}

/// Returns the shortest path of all path types, each of which is built.
fn shortest_of_all(goal: &PlanarPose) -> PlanarPath {
    shortest_within(&PlanarGoal::new(goal).tangents(), [0.0; 6])
}

fn bits(path: &PlanarPath) -> (PathType, [u64; 3]) {
    (path.path_type, path.lengths.map(f64::to_bits))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    #[test]
    fn random_goals_are_reached(goal in random_goal()) {
        assert_arrives(&goal);
    }

    #[test]
    fn near_goals_are_reached(goal in near_goal()) {
        assert_arrives(&goal);
    }

    #[test]
    fn no_path_is_longer_than_a_constructed_one(laid in whole_path_type()) {
        assert_as_short(&laid);
    }

    #[test]
    fn arcs_below_pi_have_no_extra_turn(laid in arc_below_pi()) {
        assert_as_short(&laid);
    }

    #[test]
    fn arcs_above_pi_have_no_extra_turn(laid in arc_above_pi()) {
        assert_as_short(&laid);
    }

    #[test]
    fn tangent_arcs_have_no_extra_turn(laid in tangent_arcs()) {
        assert_as_short(&laid);
    }

    #[test]
    fn an_arc_and_a_line_have_no_extra_turn(laid in arc_then_line()) {
        assert_as_short(&laid);
    }

    #[test]
    fn a_line_and_an_arc_have_no_extra_turn(laid in line_then_arc()) {
        assert_as_short(&laid);
    }

    #[test]
    fn a_line_has_no_turn(laid in line()) {
        assert_as_short(&laid);
    }

    #[test]
    fn a_goal_at_the_start_needs_no_path(laid in coincident()) {
        assert_as_short(&laid);
    }

    #[test]
    fn antiparallel_goals_are_reached_by_the_shorter_side(laid in antiparallel()) {
        assert_as_short(&laid);
    }

    #[test]
    fn tiny_displacements_give_tiny_paths(laid in tiny_step()) {
        assert_as_short(&laid);
    }

    #[test]
    fn paths_are_the_shortest_of_all_types(goal in any_goal()) {
        let path = shortest(&goal);
        let of_all = shortest_of_all(&goal);
        prop_assert!(path.length() <= of_all.length() + 1e-12 + 1e-15 * of_all.length(), "{path:?} {of_all:?}");
        // At larger distances the arcs are lost in the rounding of the line.
        if goal.x.abs() + goal.y.abs() < 1e3 {
            prop_assert_eq!(bits(&path), bits(&of_all));
        }
    }

    #[test]
    fn no_path_type_is_shorter_than_its_bound(goal in any_goal()) {
        let tangents = PlanarGoal::new(&goal).tangents();
        for (path_type, bound) in PathType::ALL.into_iter().zip(bounds::lower_bounds(&tangents)) {
            let path = PlanarPath { path_type, lengths: lengths(&tangents, path_type) };
            let excludes = f64::from(bound) > path.length();
            prop_assert!(!excludes, "{:?} is bounded by {}", path, bound);
        }
    }
}

#[test]
fn start_equal_to_goal_gives_zero_length() {
    for heading in [0.0, TAU, -TAU, -1e-17] {
        assert_eq!(shortest(&PlanarPose { x: 0.0, y: 0.0, heading }).length(), 0.0);
    }
}

#[test]
fn reversing_direction_in_place_takes_three_arcs() {
    let path = assert_arrives(&PlanarPose { x: 0.0, y: 0.0, heading: PI });
    // pi/3 + 5 pi/3 + pi/3: the classic way to reverse the direction.
    assert!((path.length() - 7.0 * PI / 3.0).abs() < 1e-12, "{path:?}");
}

#[test]
fn goals_at_the_edges_of_the_path_types_are_reached() {
    for distance in [2.0, 4.0, 4.0 - 1e-16, 4.0 + 1e-15, 2.0 - 1e-13, 2.0 - 1e-10, 4.0 + 1e-10, 1e-300] {
        for heading in [0.0, PI, FRAC_PI_2, -FRAC_PI_2] {
            for angle in [0.0, FRAC_PI_2, PI, 1.0] {
                let (y, x) = libm::sincos(angle);
                assert_arrives(&PlanarPose { x: distance * x, y: distance * y, heading });
            }
        }
    }
}

#[test]
fn ties_start_with_a_left_turn() {
    for x in [-7.0, -4.0, -3.0, -1.0, -0.1, 0.0, 0.1, 1.0, 3.0, 7.0] {
        for heading in [0.0, PI, -PI] {
            let path = assert_arrives(&PlanarPose { x, y: 0.0, heading });
            assert!(matches!(path.path_type, PathType::Lsl | PathType::Lsr | PathType::Lrl), "{x} {heading}: {path:?}");
        }
    }
}

#[test]
fn no_input_panics() {
    let values = [0.0, -0.0, 1.0, 1e-320, 1e20, 1e155, -1e308, f64::INFINITY, f64::NEG_INFINITY, f64::NAN];
    for x in values {
        for y in values {
            for heading in values {
                let goal = PlanarPose { x, y, heading };
                let of_all = shortest_of_all(&goal);
                assert_eq!(shortest(&goal).pieces().count(), of_all.pieces().count(), "{goal:?}");
            }
        }
    }
}
