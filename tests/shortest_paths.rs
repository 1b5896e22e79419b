//! Checks that a planned path is at most as long as the best path of a slow and independent search.
//!
//! `examples/best_known.rs` made the table `best_known.csv` and describes how. This test searches a few more goals.
//! `GROWBOT_NEAR` is the number of these that lie within 3 radii, by default 8:
//!
//! ```sh
//! GROWBOT_NEAR=10000 cargo test --release -p growbot-tests --test it shortest_paths:: -- --nocapture fresh_search
//! ```

use std::time::Instant;

use growbot_core::path::length;
use growbot_core::plan::{Planner, plan};
use growbot_core::pose::Pose;
use growbot_core::random::Rng;
use growbot_core::robot::Robot;
use growbot_plan::robot_file;
use growbot_tests::reference_search::table::{Row, Stratum, read};
use growbot_tests::reference_search::{Effort, Problem, helicoid, shortest};
use nalgebra::Vector3;

/// Max difference of lengths that count as equal, radii.
const SAME: f64 = 1e-6;
/// Distance up to which goals are near, radii. For near goals, a few paths may be longer than the best, because
/// shortest curves are hard to find there.
const NEAR: f64 = 3.0;
/// Min fraction of near goals whose paths are not longer than the best.
const MIN_SHARE: f64 = 0.99;
/// Ratio to the best length above which a path is much longer.
const MAX_RATIO: f64 = 1.005;
/// Max fraction of evenly drawn goals within [`NEAR`] whose paths are much longer. It should be 0, but some such goals
/// are known.
const MAX_MUCH_LONGER: f64 = 0.003;
/// Min fraction of the goals selected as hard whose paths are not longer than the best.
const MIN_SHARE_OF_PICKED: f64 = 0.85;
/// Turning radius, mm.
const RADIUS: f64 = 100.0;

/// Returns the length of the planned path from the origin along z to a goal (radii) with a direction, radii.
fn planned_length(robot: &Robot, goal: &Vector3<f64>, tangent: &Vector3<f64>) -> f64 {
    // The planner under test. No other place names it.
    let planner = Planner::Shortest;

    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
    let heading = libm::atan2(tangent.y, tangent.x);
    let pitch = libm::atan2(tangent.z, libm::hypot(tangent.x, tangent.y));
    let goal = Pose::new(goal * RADIUS, heading, pitch).unwrap();
    // A path that does not arrive is a separate error.
    let path = plan(robot, &start, &goal, RADIUS, planner).unwrap_or_else(|error| panic!("{goal:?}: {error}")).path;
    for segment in path.iter() {
        let bends = segment.bend() * RADIUS;
        assert!(bends <= segment.length() * (1.0 + 1e-9), "{goal:?}: {segment:?} bends tighter than {RADIUS} mm");
    }
    length(&path) / RADIUS
}

/// Counts of planned paths that are as long as, shorter than or longer than the best known path.
#[derive(Default)]
struct Comparison {
    same: usize,
    shorter: usize,
    longer: usize,
    much_longer: usize,
    worst: Option<(f64, Problem)>,
    /// Largest ratio of planned and best length.
    ratio: f64,
    shortest: f64,
}

impl Comparison {
    fn of<'a>(robot: &Robot, rows: impl Iterator<Item = &'a Row>) -> Self {
        let mut comparison = Self::default();
        for Row { problem, length, .. } in rows {
            let planned = planned_length(robot, &problem.goal, &problem.tangent);
            let excess = planned - length;
            match excess {
                _ if excess > SAME => comparison.longer += 1,
                _ if excess < -SAME => comparison.shorter += 1,
                _ => comparison.same += 1,
            }
            comparison.much_longer += usize::from(planned > length * MAX_RATIO);
            comparison.ratio = comparison.ratio.max(planned / length);
            comparison.shortest = comparison.shortest.min(excess);
            if comparison.worst.is_none_or(|(worst, _)| excess > worst) {
                comparison.worst = Some((excess, *problem));
            }
        }
        comparison
    }

    fn count(&self) -> usize {
        self.same + self.shorter + self.longer
    }

    fn print(&self, name: &str) {
        let Self { same, shorter, longer, ratio, .. } = self;
        println!(
            "{name}: {} cases; as long as the best {same}, shorter {shorter}, longer {longer} ({:.2} %)",
            self.count(),
            100.0 * *longer as f64 / self.count() as f64
        );
        if let Some((excess, Problem { goal, tangent })) = self.worst {
            println!(
                "  worst by {excess:+.3e} radii, ratio up to {ratio:.6}: at {:.3} radii, goal {:?}, direction {:?}",
                goal.norm(),
                goal.as_slice(),
                tangent.as_slice()
            );
        }
        if *shorter > 0 {
            println!("  shorter by up to {:.3e} radii: the table does not know the best there", -self.shortest);
        }
    }
}

#[test]
fn planned_paths_are_as_short_as_the_best_known() {
    let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
    let rows = read(include_str!("best_known.csv"));
    for stratum in Stratum::ALL {
        let rows: Vec<&Row> = rows.iter().filter(|row| row.stratum == stratum.name()).collect();
        assert!(!rows.is_empty(), "the table has no stratum {}", stratum.name());
        Comparison::of(&robot, rows.into_iter()).print(stratum.name());
    }
    let is_near = |row: &&Row| row.problem.goal.norm() < NEAR;
    // Cases selected as hard do not count in the fraction of evenly drawn goals.
    let is_picked =
        |row: &&Row| [Stratum::NearlyCoplanar, Stratum::Narrow].iter().any(|stratum| stratum.name() == row.stratum);
    let drawn = || rows.iter().filter(|row| !is_picked(row));
    let far = Comparison::of(&robot, drawn().filter(|row| !is_near(row)));
    let near = Comparison::of(&robot, drawn().filter(is_near));
    let picked = Comparison::of(&robot, rows.iter().filter(is_picked));
    far.print("drawn evenly from 3 radii");
    near.print("drawn evenly within 3 radii");
    picked.print("picked");

    assert_eq!(far.longer, 0, "from {NEAR} radii every path is as short as the best: worst {:?}", far.worst);
    let share = |of: usize, comparison: &Comparison| of as f64 / comparison.count() as f64;
    let as_short = 1.0 - share(near.longer, &near);
    assert!(
        as_short >= MIN_SHARE,
        "within {NEAR} radii {as_short} of the paths are as short as the best: {:?}",
        near.worst
    );
    let much_longer = share(near.much_longer, &near);
    assert!(much_longer <= MAX_MUCH_LONGER, "within {NEAR} radii {much_longer} are much longer: {:?}", near.worst);
    let as_short = 1.0 - share(picked.longer, &picked);
    assert!(as_short >= MIN_SHARE_OF_PICKED, "{as_short} of those picked are as short as the best: {:?}", picked.worst);
}

#[test]
fn planned_paths_are_as_short_as_a_fresh_search() {
    /// Seed of cases and searches that are not in the table.
    const SEED: u64 = 2026;
    let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
    let helicoid = helicoid::Effort { shots: 40, lines: 15, chains: 6, rounds: 1, max_rounds: 6, hits: 4 };
    let effort = Effort { csc_starts: 150, helicoid: Some(helicoid) };
    let near = std::env::var("GROWBOT_NEAR").map_or(8, |count| count.parse().expect("GROWBOT_NEAR is a number"));
    let counts = [near, 4, 4, 4, 4, 4];
    let strata = Stratum::ALL.into_iter().zip(counts).flat_map(|(stratum, count)| std::iter::repeat_n(stratum, count));
    let (mut longer, mut differing) = (Vec::new(), 0);
    for (number, stratum) in strata.enumerate() {
        let began = Instant::now();
        let problem = stratum.case(SEED, number as u64);
        let best = shortest(&problem, &effort, &mut Rng::new(&[SEED, number as u64]));
        let planned = planned_length(&robot, &problem.goal, &problem.tangent);
        println!(
            "{} {number} at {:.3} radii: planned {planned:.9}, best {} {:.9}, found by {} shots, {} lines and {} chains, in {:.1} s",
            stratum.name(),
            problem.goal.norm(),
            best.path_type,
            best.curve.length(),
            best.helicoids.by_shots,
            best.helicoids.by_lines,
            best.helicoids.by_chains,
            began.elapsed().as_secs_f64()
        );
        differing += u32::from(planned > best.curve.length() + SAME);
        let is_near = problem.goal.norm() < NEAR;
        let max = if is_near { best.curve.length() * MAX_RATIO } else { best.curve.length() + SAME };
        if planned > max {
            longer.push((planned, best.curve.length(), problem));
        }
    }
    println!("{differing} planned paths are longer than the best by more than {SAME:e}");
    assert!(longer.is_empty(), "planned, shorter, goal and direction: {longer:?}");
}
