use std::f64::consts::PI;

use growbot_core::plan::goal_error;
use growbot_core::simulation::{DirectionSensor, Disturbance, GrowthTask, SimulatedSensors, grow_closed_loop_while};
use growbot_core::tracking::SensorNoise;
use growbot_scene::scene::Scene;
use growbot_scene::shapes::Shape;

use super::*;
use crate::job::Job;
use crate::pose_text::parse_pose;
use crate::robot_file;

const SEEN: MeasuredQuantities = MeasuredQuantities { growth: true, direction: false, up: true };
const SENSORS: SimulatedSensors = SimulatedSensors {
    noise: SensorNoise { odometry: 0.01, direction: 0.0087 },
    odometry_scale: 0.0,
    direction: DirectionSensor::Gravity,
};

fn robot() -> Robot {
    robot_file::load("growbot-a".as_ref()).unwrap()
}

/// Returns a plan of 600 mm straight up.
fn plan(robot: &Robot) -> Plan {
    let (start, goal) = (parse_pose("0,0,0,0,90").unwrap(), parse_pose("0,0,600,0,90").unwrap());
    Plan::new(robot, &start, &goal, 100.0, Planner::Shortest).unwrap()
}

/// Returns a scene of balls with a radius of 50 mm at these centres, mm.
fn balls(centres: &[[f64; 3]]) -> LoadedScene {
    let ball = |centre: &[f64; 3]| Shape::Ball { centre: (*centre).into(), radius: 50.0 };
    let scene = Scene::new(centres.iter().map(ball).collect(), vec![], vec![], vec![]);
    LoadedScene { scene, margin: Some(0.0), hash: 0 }
}

fn tracker<'a>(robot: &'a Robot, plan: &'a Plan) -> Tracker<'a> {
    Tracker::new(robot, &plan.start, &plan.path, &plan.legs, SENSORS.noise)
}

#[test]
fn clearance_must_exceed_three_forecast_standard_deviations() {
    let robot = robot();
    let plan = plan(&robot);
    let tracker = tracker(&robot, &plan);
    let known: Vec<f64> = tracker.forecast(tracker.remaining_layers(), SEEN).collect();
    for height in [50.0, 300.0, 550.0] {
        let deviation = 3.0 * known[(height / 0.774) as usize];
        let touching = 50.0 + 0.5 * robot.outer_diameter();
        for (off, is_clear) in [(deviation + 0.05, true), (deviation - 0.05, false), (-1.0, false)] {
            let loaded = balls(&[[touching + off, 0.0, height]]);
            let around = SceneContext::new(&robot, &loaded, 100.0);
            let found = ClearanceGuard::new(&around, SEEN).check(&tracker, &[]);
            assert_eq!(found.is_ok(), is_clear, "{height} {off} {found:?}");
            if let Err(too_near) = found {
                // The first layer that is too near lies shortly before the point nearest to the ball.
                let z = too_near.point_mm[2];
                assert!(z <= height + 1.0 && z > height - 30.0, "{too_near}");
                assert!(too_near.obstacle.starts_with("the ball at"), "{too_near}");
                assert!(too_near.clearance_mm <= too_near.deviation_mm, "{too_near:?}");
                assert!((too_near.point_mm[2] / 0.774 - f64::from(too_near.layer)).abs() <= 1.0);
            }
        }
    }
}

#[test]
fn layers_in_flight_are_checked_too() {
    let robot = robot();
    let plan = plan(&robot);
    let mut tracker = tracker(&robot, &plan);
    let under_way: Vec<Layer> = tracker.remaining_layers().take(40).collect();
    tracker.replan(&under_way);
    let loaded = balls(&[[60.0, 0.0, 15.0]]);
    let around = SceneContext::new(&robot, &loaded, 100.0);
    let too_near = ClearanceGuard::new(&around, SEEN).check(&tracker, &under_way).unwrap_err();
    assert!(too_near.layer < 40, "{too_near}");
}

/// Simulates a growth in a scene. Returns the frame of the tip at the end, the detours, the violation that paused
/// the growth, and the smallest clearance of the true body, mm.
fn grow(
    loaded: &LoadedScene,
    disturbance: &Disturbance,
    seed: u64,
) -> (Frame, Vec<Detour>, Option<ClearanceViolation>, f64) {
    let robot = robot();
    let plan = plan(&robot);
    let around = SceneContext::new(&robot, loaded, 100.0);
    let mut guard = ClearanceGuard::new(&around, SEEN);
    let task = GrowthTask { robot: &robot, start: plan.start, path: &plan.path, legs: &plan.legs };
    let (mut detours, mut paused, mut least) = (Vec::new(), None, f64::INFINITY);
    let tip = |_: &Layer, _: &growbot_core::simulation::DisturbedLayer, base_from_tip: &Frame| {
        let distance = loaded.scene.distance(&base_from_tip.translation.vector);
        least = least.min(distance - 0.5 * robot.outer_diameter());
        *base_from_tip
    };
    let grown = grow_closed_loop_while(&task, disturbance, &SENSORS, seed, tip, |tracker, laid| {
        if let Some(layer) = laid {
            guard.record_layer(layer, &tracker.estimate().systematic_errors);
        }
        match guard.ensure_clear(tracker, &[]) {
            Ok(detour) => detours.extend(detour),
            Err(too_near) => paused = Some(too_near),
        }
        paused.is_none()
    });
    (grown.base_from_tip, detours, paused, least)
}

#[test]
fn a_detour_avoids_an_obstacle_and_reaches_the_goal() {
    let loaded = balls(&[[40.0, 0.0, 300.0]]);
    let disturbance = Disturbance { growth_noise: 0.1, growth_bias: 0.05, ..Disturbance::default() };
    let (end, detours, paused, least) = grow(&loaded, &disturbance, 3);
    assert!(paused.is_none() && !detours.is_empty() && least > 0.0, "{detours:?} {paused:?} {least}");
    assert_eq!(detours[0].from, 0);
    assert!(detours[0].clearance_mm > detours[0].instead_of.deviation_mm, "{detours:?}");
    let missed = goal_error(&end, &parse_pose("0,0,600,0,90").unwrap());
    assert!(missed.distance < 3.0 && missed.angle < 0.03, "{missed:?}");
}

/// Returns the tips of these segments, mm.
fn tips(segments: impl Iterator<Item = Segment>, base_from_tip: Frame) -> Vec<Vector3<f64>> {
    let tips = segments.scan(base_from_tip, |tip, segment| {
        *tip = path::end(&[segment], tip);
        Some(tip.translation.vector)
    });
    tips.collect()
}

#[test]
fn a_detour_avoids_the_existing_body() {
    let robot = robot();
    let plan = plan(&robot);
    // The ball leaves the side of the existing body free. That body comes down at x = -55 mm, turns below the start
    // and ends there.
    let loaded = balls(&[[40.0, 0.0, 300.0]]);
    let turn = |alpha: f64, bend: f64| Segment::Arc { alpha, bend, length: 100.0 * bend };
    let body = [
        Segment::Straight { length: 110.0 },
        turn(PI, 1.292),
        turn(0.0, 1.292),
        Segment::Straight { length: 100.0 },
        turn(0.0, PI),
    ];
    let existing = Job::new(&robot, &plan.start, &plan.start, &body).layers;
    let tip_from_base = path::end(&body, &Frame::identity()).inverse();
    let base = plan.start.frame() * tip_from_base;
    let corners = tips(body.into_iter(), base);
    assert!((corners[0] - Vector3::new(-55.0, 0.0, 292.0)).norm() < 2.0, "{corners:?}");
    let existing_tips = tips(segments(&existing).into_iter(), base);
    for (layers, is_clear) in [(&[][..], false), (&existing, true)] {
        let around = SceneContext::new(&robot, &loaded, 100.0).after_layers(layers);
        let mut tracker = tracker(&robot, &plan);
        ClearanceGuard::new(&around, SEEN).ensure_clear(&mut tracker, &[]).unwrap().expect("a detour");
        let detour = tips(tracker.remaining_layers().map(|layer| Segment::from(&layer)), plan.start.frame());
        // Both bodies meet at the start.
        let upper = |point: &&Vector3<f64>| point.z > 200.0;
        let distances = detour
            .iter()
            .filter(upper)
            .flat_map(|point| existing_tips.iter().filter(upper).map(move |other| (point - other).norm()));
        let least = distances.fold(f64::INFINITY, f64::min);
        assert_eq!(least > robot.outer_diameter(), is_clear, "{} layers: {least} mm", layers.len());
    }
}

#[test]
fn growth_pauses_with_a_reason_if_there_is_no_detour() {
    // The goal itself is too near.
    let loaded = balls(&[[0.0, 70.0, 600.0]]);
    let (_, detours, paused, least) = grow(&loaded, &Disturbance::default(), 3);
    let paused = paused.unwrap();
    assert!(detours.is_empty() && least > 0.0, "{detours:?} {least}");
    let words = paused.to_string();
    assert!(words.contains("the ball at 0, 70, 600") && words.contains("no detour was found: "), "{words}");
}

#[test]
fn a_deviating_robot_is_stopped_before_contact() {
    // A shaft with 3 mm of space around the tube. A robot with random tilts soon leaves the straight line.
    let wall = |x: f64, y: f64| Shape::Box {
        centre: Vector3::new(x, y, 300.0),
        half_extents: Vector3::new(50.0, 50.0, 300.0),
        rotation: nalgebra::Rotation3::identity(),
    };
    let walls = [(76.5, 0.0), (-76.5, 0.0), (0.0, 76.5), (0.0, -76.5)].map(|(x, y)| wall(x, y));
    let scene = Scene::new(walls.to_vec(), vec![], vec![], vec![]);
    let loaded = LoadedScene { scene, margin: Some(5.0), hash: 0 };
    for tilt_noise in [0.004, 0.008] {
        let disturbance = Disturbance { tilt_noise, ..Disturbance::default() };
        for seed in 0..12 {
            let (end, _, paused, least) = grow(&loaded, &disturbance, seed);
            let z = end.translation.z;
            assert!(paused.is_some() && least > 0.0, "{tilt_noise} {seed}: {least} mm, {paused:?} at {z} mm");
        }
    }
}
