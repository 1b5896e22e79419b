//! Measures the distance between the centreline of the layers that a board receives and the centreline whose clearance
//! is proven.
//!
//! Layers of arcs and lines have the curvature of the path, so they deviate from it only by the rounding to fixed
//! point. Layers of helicoidal arcs deviate from the arcs, and this distance is printed too. The centrelines are
//! compared at equal lengths, in the middle and at the end of each layer, which gives an upper bound of the distance
//! between the curves.
//!
//! `GROWBOT_CENTRELINES` is the number of plans, 200 by default.
//!
//! ```sh
//! GROWBOT_CENTRELINES=10000 cargo test -p growbot-client --test it laid_centrelines:: -- --nocapture
//! ```

use growbot_core::job::job_layers;
use growbot_core::layer_bytes::decode;
use growbot_core::path::{Segment, length};
use growbot_core::plan::{Planner, plan};
use growbot_core::pose::{Frame, Pose};
use growbot_core::random::Rng;
use growbot_core::robot::Robot;
use growbot_plan::robot_file;
use growbot_plan::scene_planning::{MAX_LAYER_OFFSET_MM, laid};
use nalgebra::Vector3;

const RADIUS: f64 = 100.0;

/// Iterator-like access to points along a path, at increasing lengths.
struct Along<'a> {
    left: &'a [Segment],
    base_from_segment: Frame,
    before: f64,
}

impl Along<'_> {
    fn point(&mut self, along: f64) -> Vector3<f64> {
        while let [first, rest @ ..] = self.left
            && !rest.is_empty()
            && along > self.before + first.length()
        {
            self.base_from_segment *= first.step();
            self.before += first.length();
            self.left = rest;
        }
        let part = self.left.first().map(|segment| segment.shortened((along - self.before).min(segment.length())));
        let step = part.map_or_else(Frame::identity, |part| part.step());
        (self.base_from_segment * step).translation.vector
    }
}

/// Returns the maximum distance between the layers of a path and the centreline `body`, mm.
fn apart(robot: &Robot, path: &[Segment], body: &[Segment]) -> f64 {
    let mut along = Along { left: body, base_from_segment: Frame::identity(), before: 0.0 };
    let (mut base_from_tip, mut so_far, mut most) = (Frame::identity(), 0.0, 0.0_f64);
    for layer in job_layers(path, robot).map(|bytes| decode(&bytes)) {
        let part =
            |share: f64| Segment::Arc { alpha: layer.alpha, bend: share * layer.tilt, length: share * layer.height };
        for share in [0.5, 1.0] {
            let here = (base_from_tip * part(share).step()).translation.vector;
            most = most.max((here - along.point(so_far + share * layer.height)).norm());
        }
        base_from_tip *= layer.step();
        so_far += layer.height;
    }
    // The layers of a helicoidal arc are a little longer than the arc.
    assert!((so_far - length(path)).abs() < 1e-2, "{so_far} mm of {}", length(path));
    most
}

fn goal(random: &mut Rng) -> Pose {
    let far = RADIUS * libm::exp(random.uniform_between(libm::log(0.3), libm::log(300.0)));
    let (heading, up) = (random.uniform_between(-3.1, 3.1), random.uniform_between(-1.0, 1.0));
    Pose::new(random.direction() * far, heading, libm::asin(up)).expect("a pose")
}

#[test]
fn layers_follow_the_path_that_was_proven_clear() {
    let count = std::env::var("GROWBOT_CENTRELINES").map_or(200, |text| text.parse().expect("a number"));
    let robot = robot_file::load(robot_file::DEFAULT.as_ref()).expect("the default robot");
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).expect("a pose");
    let (mut random, mut made) = (Rng::new(&[2026]), [0; 2]);
    let (mut most, mut helicoidal) = (0.0_f64, 0.0_f64);
    for _ in 0..count {
        let goal = goal(&mut random);
        let path = plan(&robot, &start, &goal, RADIUS, Planner::Shortest).expect("a path").path;
        let is_helicoidal = path.iter().any(|segment| matches!(segment, Segment::Helicoid { .. }));
        let found = apart(&robot, &path, &laid(&path, &robot));
        assert!(found <= MAX_LAYER_OFFSET_MM, "{found} mm: {goal:?}");
        most = most.max(found);
        if is_helicoidal {
            helicoidal = helicoidal.max(apart(&robot, &path, &path));
        }
        made[usize::from(is_helicoidal)] += 1;
    }
    println!(
        "{} plans of arcs and lines, {} with a helicoidal arc: layers are {most:.1e} mm from what is proven, and \
         {helicoidal:.1e} mm from helicoidal arcs, at most",
        made[0], made[1]
    );
    assert!(made[0] > 0 && made[1] > 0, "{made:?}");
}
