//! Checks that plans and layers in their published format reach their goals. Eq 4 of Del Dottore et al. 2019 is
//! implemented here independently, from its corrected form and with separate matrices, without code of growbot-core.

#![expect(clippy::disallowed_methods, reason = "an independent check computes with another library")]

use crate::running;

use running::{growbot, growbot_reading};
use serde_json::Value;

type Matrix = [[f64; 4]; 4];

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    let mut c = [[0.0; 4]; 4];
    for i in 0..4 {
        for j in 0..4 {
            c[i][j] = (0..4).map(|k| a[i][k] * b[k][j]).sum();
        }
    }
    c
}

/// Returns the transform of one step of growth by Eq 4: an arc of length `s`, mm, that bends by `phi_deg` in the
/// direction `alpha_deg` + 180 deg.
fn eq_4(alpha_deg: f64, phi_deg: f64, s: f64) -> Matrix {
    let (b, phi) = (alpha_deg.to_radians() + std::f64::consts::PI, phi_deg.to_radians());
    let (sb, cb) = b.sin_cos();
    let (sine, cosine) = phi.sin_cos();
    // R_c (1 - C) and R_c S. They come from their series if R_c = s / phi is too inexact.
    let (aside, along) = if phi < 1e-3 {
        (s * phi / 2.0 * (1.0 - phi * phi / 12.0), s * (1.0 - phi * phi / 6.0))
    } else {
        (s / phi * 2.0 * (phi / 2.0).sin().powi(2), s / phi * sine)
    };
    [
        [cb * cb * cosine + sb * sb, cb * sb * (cosine - 1.0), cb * sine, cb * aside],
        [cb * sb * (cosine - 1.0), cb * cb + sb * sb * cosine, sb * sine, sb * aside],
        [-cb * sine, -sb * sine, cosine, along],
        [0.0, 0.0, 0.0, 1.0],
    ]
}

fn number(value: &Value, field: &str) -> f64 {
    value[field].as_f64().unwrap_or_else(|| panic!("no number {field} in {value}"))
}

/// Returns the frame of a pose in JSON: the rotation `Rz(heading) Ry(90 deg - pitch)` at the position.
fn frame(pose: &Value) -> Matrix {
    let (sh, ch) = number(pose, "heading_deg").to_radians().sin_cos();
    let (sp, cp) = (90.0 - number(pose, "pitch_deg")).to_radians().sin_cos();
    let turn = [[ch, -sh, 0.0, 0.0], [sh, ch, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    let lean = [[cp, 0.0, sp, 0.0], [0.0, 1.0, 0.0, 0.0], [-sp, 0.0, cp, 0.0], [0.0, 0.0, 0.0, 1.0]];
    let mut frame = product(&turn, &lean);
    for (row, field) in frame.iter_mut().zip(["x_mm", "y_mm", "z_mm"]) {
        row[3] = number(pose, field);
    }
    frame
}

/// Returns the distance between two frames, mm, and the angle between their directions of growth, rad.
fn apart(a: &Matrix, b: &Matrix) -> (f64, f64) {
    let column = |m: &Matrix, j: usize| [m[0][j], m[1][j], m[2][j]];
    let norm = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let minus = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    // The chord between unit vectors equals their angle if it is small.
    (norm(minus(column(a, 3), column(b, 3))), norm(minus(column(a, 2), column(b, 2))))
}

/// Tolerance at the goal for a chain of straight lines, arcs or layers that are computed by Eq 4, mm.
const ARRIVED: f64 = 1e-6;
/// Tolerance at the goal for the segments of plans with a helicoidal arc, mm. A helicoidal arc may pass a narrow neck,
/// near which the plane of its bend turns within a short length. There the rounding errors of the integration grow. The
/// layers of these plans have the tolerance [`ARRIVED`].
const INTEGRATED: f64 = 1e-5;

fn assert_arrives(frame_at_end: &Matrix, plan: &Value, what: &str, limit: f64) {
    let (distance, angle) = apart(frame_at_end, &frame(&plan["goal"]));
    assert!(distance < limit && angle < 0.01 * limit, "{what} end {distance} mm and {angle} rad off: {plan}");
}

/// Properties of a robot that this test needs.
struct Robot {
    name: &'static str,
    tip_radius: f64,
    height: f64,
    min_height: f64,
    max_height: f64,
}

const ROBOTS: [Robot; 3] = [
    Robot { name: "growbot-a", tip_radius: 22.0, height: 0.774, min_height: 0.3, max_height: 0.95 },
    Robot { name: "growbot-b", tip_radius: 57.5, height: 62.64, min_height: 25.0, max_height: 70.0 },
    Robot { name: "growbot-c", tip_radius: 19.0, height: 20.0, min_height: 10.0, max_height: 30.0 },
];

fn three(value: &Value) -> [f64; 3] {
    std::array::from_fn(|i| value[i].as_f64().unwrap_or_else(|| panic!("no three numbers: {value}")))
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Returns the frame at the end of a helicoidal arc, integrated by the classical Runge-Kutta method: `x'' = w x x'`
/// with `w = m/|m|` and `m = m0 + p x x`, in units of `radius`. All three axes of the frame turn about w.
fn helicoid(start: &Matrix, segment: &Value, length: f64, radius: f64) -> Matrix {
    let (m0, p) = (three(&segment["m0"]), three(&segment["p"]));
    type State = [[f64; 3]; 4];
    let rate = |state: &State| -> State {
        let m = std::array::from_fn(|i| m0[i] + cross(p, state[3])[i]);
        let norm = m.iter().map(|x: &f64| x * x).sum::<f64>().sqrt();
        let w = m.map(|x| x / norm);
        [cross(w, state[0]), cross(w, state[1]), cross(w, state[2]), state[2]]
    };
    let ahead = |state: &State, rate: &State, step: f64| -> State {
        std::array::from_fn(|i| std::array::from_fn(|j| state[i][j] + step * rate[i][j]))
    };
    let column = |j: usize| [start[0][j], start[1][j], start[2][j]];
    let mut state = [column(0), column(1), column(2), [0.0; 3]];
    let norm = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let mut left = length / radius;
    while left > 0.0 {
        // If m is small, its direction turns fast. A step of 2e-3 makes an error below 1e-10 radii.
        let m = std::array::from_fn(|i| m0[i] + cross(p, state[3])[i]);
        let step = left.min(2e-3).min((0.01 * norm(m) / norm(p)).max(1e-7));
        left -= step;
        let first = rate(&state);
        let second = rate(&ahead(&state, &first, step / 2.0));
        let third = rate(&ahead(&state, &second, step / 2.0));
        let fourth = rate(&ahead(&state, &third, step));
        for (sum, part) in [(first, 6.0), (second, 3.0), (third, 3.0), (fourth, 6.0)] {
            state = ahead(&state, &sum, step / part);
        }
    }
    let mut end = *start;
    for i in 0..3 {
        for j in 0..3 {
            end[i][j] = state[j][i];
        }
        end[i][3] += radius * state[3][i];
    }
    end
}

/// Chains the segments of a plan, and checks that they pass the end of every leg and reach the goal.
fn check_segments(plan: &Value, radius: f64) {
    let mut at = frame(&plan["start"]);
    let mut length = 0.0;
    let none = Vec::new();
    let legs = plan.get("legs").map_or(&none, |legs| legs.as_array().unwrap());
    let mut ends = legs.iter().scan(0, |sum, leg| {
        *sum += leg["segments"].as_u64().unwrap() as usize;
        Some(*sum)
    });
    let mut vias = plan.get("via").map_or(&none, |via| via.as_array().unwrap()).iter();
    let mut next_end = ends.next();
    let mut path_type = String::new();
    for (index, segment) in plan["segments"].as_array().unwrap().iter().enumerate() {
        while next_end == Some(index)
            && let Some(via) = vias.next()
        {
            let (distance, angle) = apart(&at, &frame(via));
            let limit = if path_type.contains('H') { INTEGRATED } else { ARRIVED };
            assert!(distance < limit && angle < 0.01 * limit, "passes {via} {distance} mm and {angle} rad off: {plan}");
            next_end = ends.next();
        }
        let letter = match segment["kind"].as_str().unwrap() {
            "arc" => "C",
            "straight" => "S",
            _ => "H",
        };
        // A helicoidal arc may consist of two segments.
        if !(letter == "H" && path_type.ends_with('H')) {
            path_type += letter;
        }
        let s = number(segment, "length_mm");
        length += s;
        at = match segment["kind"].as_str().unwrap() {
            "arc" => {
                let (alpha, beta) = (number(segment, "alpha_deg"), number(segment, "beta_deg"));
                assert!((0.0..360.0).contains(&alpha) && beta > 0.0, "{segment}");
                assert!((s / beta.to_radians() - radius).abs() < 1e-9 * radius, "{segment}");
                product(&at, &eq_4(alpha, beta, s))
            }
            "straight" => product(&at, &eq_4(0.0, 0.0, s)),
            "helicoid" => helicoid(&at, segment, s, radius),
            kind => panic!("unknown kind {kind}"),
        };
    }
    assert!(vias.len() == 0 || next_end == Some(plan["segments"].as_array().unwrap().len()), "{plan}");
    assert_eq!(plan["path_type"], path_type);
    let percent = if length > 0.0 { 100.0 * (number(plan, "two_plane_length_mm") / length - 1.0) } else { 0.0 };
    assert!((number(plan, "two_plane_longer_percent") - percent).abs() < 1e-6, "{plan}");
    assert!((length - number(plan, "length_mm")).abs() <= 1e-12 * length, "{plan}");
    assert_arrives(&at, plan, "the segments", if path_type.contains('H') { INTEGRATED } else { ARRIVED });
}

fn check_layers(plan: &Value, csv: &str, robot: &Robot) {
    let mut lines = csv.lines();
    assert_eq!(lines.next(), Some("layer,segment,alpha_deg,height_mm,tilt_deg"));
    let segments = plan["segments"].as_array().unwrap();
    let mut at = frame(&plan["start"]);
    let mut laid = vec![0.0; segments.len()];
    let mut thin = vec![false; segments.len()];
    let mut count = 0;
    for line in lines {
        let fields: Vec<&str> = line.split(',').collect();
        let [layer, segment, alpha, height, tilt] = fields[..] else { panic!("{line}") };
        assert_eq!(layer, count.to_string());
        let segment: usize = segment.parse().unwrap();
        let [alpha, height, tilt]: [f64; 3] = [alpha, height, tilt].map(|field| field.parse().unwrap());
        assert!((0.0..360.0).contains(&alpha) && height > 0.0 && tilt >= 0.0, "{line}");
        assert_eq!(tilt > 0.0, segments[segment]["kind"] != "straight", "{line}");
        assert!(tilt > 0.0 || alpha == 0.0, "{line}");
        let lean = robot.tip_radius * tilt.to_radians();
        assert!(height <= robot.height * (1.0 + 2e-9) && height - lean > 0.0, "{line}");
        assert!(height + lean <= robot.max_height * (1.0 + 2e-9), "{line}");
        thin[segment] |= height - lean < robot.min_height * (1.0 - 1e-8);
        laid[segment] += height;
        at = product(&at, &eq_4(alpha, tilt, height));
        count += 1;
    }
    assert_eq!(plan["layers"], count);
    assert_arrives(&at, plan, "the layers", ARRIVED);
    for (laid, segment) in laid.iter().zip(segments) {
        // The layers of a helicoidal arc are arcs with the same end. If its bend reverses within a layer, their total
        // length differs by a fraction of a layer.
        let off = if segment["kind"] == "helicoid" { robot.height } else { 1e-9 * laid };
        assert!((laid - number(segment, "length_mm")).abs() < off, "{laid} mm laid: {segment}");
    }
    // The warnings name every segment with thin layers, and no other. The layers of a planned path keep all limits.
    let all = plan["warnings"].as_array().unwrap();
    assert!(all.iter().all(|warning| warning["code"] != "layer-limit"), "{plan}");
    let warnings: Vec<&Value> = all.iter().filter(|warning| warning["code"] == "thin-layer").collect();
    assert_eq!(warnings.len(), thin.iter().filter(|thin| **thin).count(), "{plan}");
    for (index, _) in thin.iter().enumerate().filter(|(_, thin)| **thin) {
        let named = |warning: &Value| warning["message"].as_str().unwrap().starts_with(&format!("segment {index} "));
        let warning = warnings.iter().find(|warning| named(warning)).unwrap();
        assert_eq!(number(warning, "limit"), robot.min_height);
        assert!(number(warning, "value") < robot.min_height);
    }
}

/// Generator of random poses (splitmix64), which depends only on its seed.
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn between(&mut self, min: f64, max: f64) -> f64 {
        min + (max - min) * (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn one_of(&mut self, values: &[f64]) -> f64 {
        values[(self.bits() % values.len() as u64) as usize]
    }

    fn pose(&mut self) -> [f64; 5] {
        let mut coordinate = || self.between(-2000.0, 2000.0);
        let (x, y, z) = (coordinate(), coordinate(), coordinate());
        [x, y, z, self.between(-180.0, 180.0), self.between(-90.0, 90.0)]
    }

    /// Returns a start and a goal pose, at most 40 `radius` apart in any direction.
    fn pair(&mut self, radius: f64) -> [[f64; 5]; 2] {
        let start = self.pose();
        let (up, round) = (self.between(-1.0, 1.0), self.between(0.0, std::f64::consts::TAU));
        let across = (1.0 - up * up).sqrt();
        let distance = self.between(0.0, 40.0 * radius);
        let mut goal = self.pose();
        for (i, part) in [across * round.cos(), across * round.sin(), up].into_iter().enumerate() {
            goal[i] = start[i] + distance * part;
        }
        [start, goal]
    }

    /// Returns a pose for which planes, lines or circles of the path coincide exactly or nearly.
    fn special_pose(&mut self) -> [f64; 5] {
        let mut coordinate = || self.one_of(&[0.0, 0.0, 1e-9, -1e-3, 100.0, -200.0, 400.0, 800.0]);
        let (x, y, z) = (coordinate(), coordinate(), coordinate());
        let heading = self.one_of(&[0.0, 0.0, 90.0, 180.0, -180.0, 45.0, 359.999_999_999, 1e-10]);
        [x, y, z, heading, self.one_of(&[90.0, 90.0, -90.0, 0.0, 0.0, 45.0, 89.999_999_999, -1e-10])]
    }
}

fn queries(seed: u64, radius: f64, random: usize, special: usize) -> String {
    let mut numbers = Random(seed);
    let ends =
        ["from", "to"].map(|end| ["x_mm", "y_mm", "z_mm", "heading_deg", "pitch_deg"].map(|f| format!("{end}_{f}")));
    let mut text = format!("id,{}\n", ends.as_flattened().join(","));
    for i in 0..random + special {
        let poses = if i < random { numbers.pair(radius) } else { [numbers.special_pose(), numbers.special_pose()] };
        let fields: Vec<String> = poses.as_flattened().iter().map(f64::to_string).collect();
        text += &format!("{i},{}\n", fields.join(","));
    }
    text
}

/// Interval of the plans whose layers are checked too: one in 40 plans.
const LAYERS_OF_ONE_IN: usize = 40;

#[test]
fn segments_and_layers_of_every_plan_end_at_the_goal() {
    let seed = 20_190_045;
    println!("seed {seed}");
    let share = if std::env::var_os("GROWBOT_GOALS").is_some_and(|goals| goals == "all") { 1 } else { 5 };
    for (robot, (random, special)) in ROBOTS.iter().zip([(10_000, 1_000), (1_000, 200), (1_000, 200)]) {
        let (random, special) = (random / share, special / share);
        let rmin: Value = serde_json::from_str(&growbot(&["rmin", "--json", "--robot", robot.name]).out).unwrap();
        assert_eq!(rmin["robot"], robot.name);
        let queries = queries(seed, number(&rmin, "r_min_mm"), random, special);
        let ran = growbot_reading(&["plan", "--batch", "-", "--json", "--robot", robot.name], &queries);
        // A long command reports its progress.
        assert!(ran.err.lines().all(|line| line.ends_with("planned, 0 failed")), "{}", ran.err);
        assert_eq!(ran.code, Some(0));
        let lines: Vec<&str> = ran.out.lines().collect();
        assert_eq!(lines.len(), random + special);
        for (i, line) in lines.iter().enumerate() {
            let plan: Value = serde_json::from_str(line).unwrap();
            assert_eq!(plan["id"], i.to_string());
            let radius = number(&plan, "radius_mm");
            assert!(radius >= number(&rmin, "r_min_mm"));
            check_segments(&plan, radius);
            if i % LAYERS_OF_ONE_IN == 0 {
                let layers = growbot_reading(&["layers", "-"], line);
                assert_eq!((layers.code, layers.err.as_str()), (Some(0), ""), "{line}");
                check_layers(&plan, &layers.out, robot);
            }
        }
    }
}

#[test]
fn segments_and_layers_pass_through_every_waypoint() {
    let mut numbers = Random(2019);
    let robot = &ROBOTS[0];
    let text = |pose: &[f64; 5]| pose.map(|number| number.to_string()).join(",");
    for round in 0..40 {
        let poses: Vec<[f64; 5]> = match round {
            // Straight on, a turn at one place, there and back. Some legs are empty, a line, or nearly a line.
            0 => vec![[0.0, 0.0, 0.0, 30.0, 90.0], [0.0, 0.0, 300.0, 30.0, 90.0], [0.0, 0.0, 500.0, -70.0, 90.0]],
            1 => vec![[0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0], [400.0, 0.0, 0.0, 0.0, 0.0], [0.0; 5]],
            2 => (0..50).map(|i| [0.0, f64::from(i) * 20.0, 0.0, 90.0, 0.0]).collect(),
            round if round % 2 == 0 => (0..12).map(|_| numbers.special_pose()).collect(),
            _ => (0..10).map(|_| numbers.pose()).collect(),
        };
        let poses: Vec<String> = poses.iter().map(text).collect();
        let [from, via @ .., to] = &poses[..] else { panic!("too few poses") };
        let mut args = vec!["plan", "--json", "--from", from, "--to", to];
        args.extend(via.iter().flat_map(|pose| ["--via", pose]));
        let planned = growbot(&args);
        assert_eq!(planned.code, Some(0), "{}", planned.err);
        let plan: Value = serde_json::from_str(&planned.out).unwrap();
        assert_eq!(plan["via"].as_array().map_or(0, Vec::len), via.len());
        if round == 2 {
            assert!((number(&plan, "length_mm") - 980.0).abs() < 1e-6, "a straight line is a straight line: {plan}");
        }
        check_segments(&plan, number(&plan, "radius_mm"));
        let layers = growbot_reading(&["layers", "-"], &planned.out);
        assert_eq!((layers.code, layers.err.as_str()), (Some(0), ""), "{plan}");
        check_layers(&plan, &layers.out, robot);
    }
}
