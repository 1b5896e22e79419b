//! Tests of `growbot simulate` as users and scripts run it: results, exit codes, messages.

use crate::running;

use running::growbot;
use serde_json::Value;

/// Arguments to simulate a tube of 643 mm of robot A. The planner `two-plane` is given, so that improvements of other
/// planners do not change the path.
const GOAL: [&str; 5] = ["simulate", "--to", "200,100,600,0,45", "--planner", "two-plane"];
/// Arguments to simulate a straight horizontal tube of 1000 mm.
const LEVEL: [&str; 5] = ["simulate", "--from", "0,0,0,0,0", "--to", "1000,0,0,0,0"];

const ROBOTS: [&str; 11] = [
    "growbot-a",
    "growbot-a1",
    "growbot-a2",
    "growbot-a3",
    "growbot-a4",
    "growbot-a5",
    "growbot-a6",
    "growbot-a7",
    "growbot-a8",
    "growbot-b",
    "growbot-c",
];

fn with<'a>(args: &[&'a str], more: &[&'a str]) -> Vec<&'a str> {
    args.iter().chain(more).copied().collect()
}

#[track_caller]
fn json(args: &[&str], more: &[&str]) -> Value {
    let ran = growbot(&[args, more, &["--json"]].concat());
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    assert_eq!(ran.out.matches('\n').count(), 1);
    serde_json::from_str(&ran.out).unwrap_or_else(|error| panic!("{error}: {}", ran.out))
}

fn number(value: &Value, field: &str) -> f64 {
    value[field].as_f64().unwrap_or_else(|| panic!("no {field} in {value}"))
}

#[test]
fn help_has_examples_and_fits_80_columns() {
    let ran = growbot(&["simulate", "--help"]);
    assert!(ran.out.contains("Usage: growbot") && ran.out.contains("Example"), "{}", ran.out);
    assert!(ran.out.lines().all(|line| line.chars().count() <= 80), "{}", ran.out);
}

#[test]
fn without_noise_every_robot_reaches_the_goal_exactly() {
    for robot in ROBOTS {
        let found = json(&["simulate", "--to", "300,-200,900,40,30", "--robot", robot], &[]);
        assert!(number(&found, "normalized_position_error") <= 1e-9, "{robot}: {found}");
        assert!(number(&found, "direction_error_deg").to_radians() <= 1e-9, "{robot}: {found}");
    }
}

#[test]
fn a_growth_is_printed_as_a_table_or_line_with_the_seed() {
    let ran = growbot(&with(&GOAL, &["--noise", "10", "--seed", "42"]));
    assert_eq!((ran.code, ran.err.as_str()), (Some(0), ""));
    assert!(ran.out.contains("final") && ran.out.contains("\nseed      42, of a simulated growth\n"), "{}", ran.out);
    assert!(ran.out.lines().all(|line| line.chars().count() <= 80), "{}", ran.out);

    let found = json(&GOAL, &["--noise", "10", "--seed", "42"]);
    let fields: Vec<&String> = found.as_object().unwrap().keys().collect();
    let expected = [
        "direction_error_deg",
        "disturbances",
        "final",
        "heading_error_deg",
        "layers",
        "length_mm",
        "normalized_position_error",
        "path_length_mm",
        "pitch_error_deg",
        "plan_deviation",
        "position_error_mm",
        "seed",
    ];
    assert_eq!(fields, expected);
    assert_eq!((&found["seed"], &found["layers"]), (&42.into(), &833.into()));
    let share = number(&found, "position_error_mm") / number(&found, "path_length_mm");
    assert!((number(&found, "normalized_position_error") / share - 1.0).abs() < 1e-12);
    // Uniform noise of 10 % on each of 833 layers gives about 0.2 % of the whole.
    assert!((1e-5..0.01).contains(&share), "{share}");
}

#[test]
fn the_seed_determines_the_growth() {
    let noise = ["--noise", "10", "--tilt-noise", "0.1", "--alpha-noise", "5", "--twist-noise", "1", "--json"];
    for loops in [&[][..], &["--feedback"]] {
        let run = |seed: &str| growbot(&[&GOAL[..], &noise, loops, &["--seed", seed]].concat()).out;
        assert_eq!(run("5"), run("5"));
        assert_ne!(run("5"), run("6"));
        assert!(run("18446744073709551615").contains("\"seed\":18446744073709551615}"));
    }
}

#[test]
fn whole_steps_are_laid_as_in_the_paper() {
    let straight = ["simulate", "--to", "0,0,100,0,90", "--slice", "whole"];
    // 33 steps of 3.096 mm are 102.168 mm, and 130 layers of the robot's height are 100.62 mm.
    for (more, layers, over) in [(&["--step", "3.096"][..], 33, 2.168), (&[], 130, 0.62)] {
        let found = json(&straight, more);
        assert_eq!(found["layers"], layers);
        assert!((number(&found, "position_error_mm") - over).abs() < 1e-9, "{found}");
        assert!((number(&found, "length_mm") - 100.0 - over).abs() < 1e-9, "{found}");
        assert!((number(&found, "normalized_position_error") - 0.01 * over).abs() < 1e-11, "{found}");
    }
}

#[test]
fn a_goal_at_the_start_grows_nothing() {
    for more in [&["--noise", "10"][..], &["--feedback"], &["--sag"], &["--slice", "whole"]] {
        let found = json(&["simulate", "--to", "0,0,0,0,90"], more);
        assert_eq!((&found["layers"], found["path_length_mm"].to_string().as_str()), (&0.into(), "0.0"), "{found}");
        assert_eq!(number(&found, "normalized_position_error"), 0.0);
        assert_eq!(number(&found, "direction_error_deg"), 0.0);
    }
}

#[test]
fn every_layer_disturbance_changes_the_goal_error() {
    for disturbance in [
        ["--bias", "5"],
        ["--tilt-noise", "0.1"],
        ["--tilt-bias", "-10"],
        ["--alpha-noise", "20"],
        ["--alpha-bias", "-5"],
        ["--twist-noise", "1"],
        ["--twist-bias", "0.1"],
    ] {
        let found = json(&GOAL, &disturbance);
        assert!(number(&found, "position_error_mm") > 0.1, "{disturbance:?}: {found}");
    }
}

#[test]
fn feedback_reduces_the_error_of_a_biased_growth() {
    let bias = ["--bias", "5", "--noise", "10"];
    let open = json(&GOAL, &bias);
    let closed = json(&GOAL, &with(&bias, &["--feedback"]));
    assert!(number(&closed, "position_error_mm") < 0.2 * number(&open, "position_error_mm"), "{closed} {open}");
    let found = &closed["feedback"];
    assert!((number(found, "growth_bias_percent") - 5.0).abs() < 2.0, "{found}");
    assert!(number(found, "position_sd_mm") > 0.0 && found["estimate"]["x_mm"].is_f64());
    // The loop cannot detect this error: everything is 1 % shorter than measured.
    let scaled = json(&GOAL, &["--feedback", "--odometry-scale", "1"]);
    assert!((0.004..0.02).contains(&number(&scaled, "normalized_position_error")), "{scaled}");
}

#[test]
fn a_body_sags_under_its_weight_and_may_break() {
    let found = json(&LEVEL, &["--sag"]);
    let sag = number(&found["sag"], "deflection_mm");
    assert!((number(&found, "position_error_mm") - sag).abs() < 1e-9 && (4.0..10.0).contains(&sag), "{found}");
    let table = growbot(&with(&LEVEL, &["--sag"]));
    assert!(table.out.contains("\nsag       ") && table.err.is_empty(), "{}{}", table.out, table.err);
    assert!(growbot(&LEVEL).out.lines().all(|line| !line.starts_with("sag")));

    let directory = tempfile::tempdir().unwrap();
    let robot = directory.path().join("soft.toml");
    let soft = include_str!("../../robots/growbot-a.toml").replace("strength_mpa = 30.0", "strength_mpa = 0.5");
    std::fs::write(&robot, soft).unwrap();
    for more in [&[][..], &["--repeat", "3"]] {
        let robot = robot.to_str().unwrap();
        let ran = growbot(&[&LEVEL[..], &["--sag", "--robot", robot, "--noise", "5"], more].concat());
        assert_eq!(ran.code, Some(0));
        for part in ["warning: root-fails: ", "more than the 0.5 MPa of material.strength_mpa", "wall.width_mm"] {
            assert!(ran.err.contains(part), "{}", ran.err);
        }
        assert_eq!(ran.err.matches('\n').count(), 1, "{}", ran.err);
    }
}

#[test]
fn a_plan_with_warnings_is_still_simulated() {
    let ran = growbot(&["simulate", "--to", "0,0,4000,0,90"]);
    assert_eq!(ran.code, Some(0));
    assert!(ran.err.starts_with("warning: filament-short: ") && ran.err.matches('\n').count() == 1, "{}", ran.err);
}

#[test]
fn repetitions_do_not_depend_on_the_thread_count() {
    for loops in [&["--repeat", "200"][..], &["--repeat", "20", "--feedback"]] {
        let run = |threads: &str| {
            growbot(&[&GOAL[..], &["--noise", "10", "--sag", "--threads", threads], loops, &["--json"]].concat())
        };
        let (one, two) = (run("1"), run("2"));
        assert_eq!(one.code, Some(0), "{}", one.err);
        assert_eq!(one.out, two.out);
    }
}

#[test]
fn repetitions_are_summarised() {
    let ran = growbot(&with(&GOAL, &["--noise", "10", "--repeat", "100"]));
    assert_eq!((ran.code, ran.err.as_str()), (Some(0), ""));
    assert!(
        ran.out.starts_with("100 simulated growths of growbot-a, 833 layers, 643.6 mm, seeds 1 to 100\n"),
        "{}",
        ran.out
    );
    assert!(ran.out.lines().all(|line| line.chars().count() <= 80), "{}", ran.out);

    let all = json(&GOAL, &["--noise", "10", "--repeat", "100", "--seed", "3"]);
    assert_eq!((&all["repeat"], &all["seed"]), (&100.into(), &3.into()));
    let position = &all["position_error_mm"];
    let of = |field: &str| number(position, field);
    assert!(of("min") <= of("p50") && of("p50") < of("p95") && of("p95") <= of("max"), "{all}");
    assert!(of("min") < of("mean") && of("mean") < of("max") && of("sd") > 0.0, "{all}");
    for field in ["normalized_position_error", "heading_error_deg", "pitch_error_deg", "direction_error_deg", "layers"]
    {
        assert!(number(&all[field], "mean") >= 0.0);
    }
    // The worst growth can be repeated alone.
    let seed = all["worst_seed"].to_string();
    assert_eq!(json(&GOAL, &["--noise", "10", "--seed", &seed])["position_error_mm"], position["max"]);
}

#[test]
fn every_disturbance_is_printed_with_its_distribution() {
    let off = ["--noise", "7", "--tilt-bias", "-2", "--twist-noise", "0.1", "--feedback", "--direction-noise", "0.3"];
    let words = "noise     growth of each layer: uniform, half-width 7 %\n\
                 bias      tilt: -2 %\n\
                 noise     twist of each layer: uniform, half-width 0.1 deg\n\
                 noise     odometry of each layer: normal, SD 1 %\n\
                 noise     measured direction, about either axis: normal, SD 0.3 deg\n";
    for repeat in [&[][..], &["--repeat", "3"]] {
        let more = [&off[..], repeat].concat();
        let ran = growbot(&with(&GOAL, &more));
        assert!(ran.out.contains(words), "{}", ran.out);
        let found = &json(&GOAL, &more)["disturbances"];
        assert_eq!(found["growth_noise"]["distribution"], "uniform");
        assert_eq!((number(&found["growth_noise"], "max"), number(&found["tilt_bias"], "value")), (7.0, -2.0));
        assert_eq!(number(&found["twist_noise"], "max"), 0.1);
        assert_eq!(found["direction_noise"]["distribution"], "normal");
        assert_eq!(number(&found["direction_noise"], "standard_deviation"), 0.3);
        assert_eq!(found["odometry_scale"]["value"], 0.0);
    }
    let help = growbot(&["simulate", "--help"]).out;
    let help = help.split_whitespace().collect::<Vec<_>>().join(" ");
    assert_eq!(help.matches("Half-width of the uniform noise").count(), 4, "{help}");
    assert_eq!(help.matches("Standard deviation of the normal noise").count(), 2, "{help}");
}

#[test]
fn every_growth_gives_one_row_of_samples() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("growths.csv");
    let path = file.to_str().unwrap();
    for loops in [&[][..], &["--feedback", "--sag"]] {
        let off = [&["--noise", "7", "--repeat", "20", "--seed", "5", "--samples", path][..], loops].concat();
        let all = json(&GOAL, &off);
        let mut reader = csv::Reader::from_path(&file).unwrap();
        let names = reader.headers().unwrap().clone();
        let rows: Vec<csv::StringRecord> = reader.records().collect::<Result<_, _>>().unwrap();
        let at = |row: &csv::StringRecord, name: &str| -> f64 {
            let column =
                names.iter().position(|found| found == name).unwrap_or_else(|| panic!("no {name} in {names:?}"));
            row[column].parse().unwrap()
        };
        assert_eq!(rows.len(), 20);
        assert_eq!(
            rows.iter().map(|row| at(row, "seed")).collect::<Vec<_>>(),
            (5..25).map(f64::from).collect::<Vec<_>>()
        );
        // Each row equals the result of that growth alone, bit for bit.
        let alone = [&["--noise", "7", "--seed", "9"][..], loops].concat();
        let alone = json(&GOAL, &alone);
        for name in ["position_error_mm", "normalized_position_error", "heading_error_deg", "pitch_error_deg"]
            .into_iter()
            .chain(["direction_error_deg", "length_mm", "path_length_mm", "layers"])
        {
            assert_eq!(at(&rows[4], name), number(&alone, name), "{name}");
        }
        assert_eq!(at(&rows[4], "final_x_mm"), number(&alone["final"], "x_mm"));
        assert_eq!((at(&rows[0], "start_pitch_deg"), at(&rows[0], "goal_z_mm")), (90.0, 600.0));
        assert_eq!(at(&rows[0], "growth_noise_uniform_half_width_percent"), 7.0);
        let max = rows.iter().map(|row| at(row, "position_error_mm")).fold(0.0, f64::max);
        assert_eq!(max, number(&all["position_error_mm"], "max"));
        assert_eq!(names.iter().any(|name| name == "sag_mm"), !loops.is_empty());
    }
    // A file that cannot be written is reported before anything is grown.
    let ran = growbot(&with(&GOAL, &["--repeat", "1000000", "--noise", "1", "--samples", "no/where/growths.csv"]));
    assert_eq!((ran.code, ran.out.as_str()), (Some(2), ""), "{}", ran.err);
    assert!(ran.err.contains("does not exist"), "{}", ran.err);
    let ran = growbot(&with(&GOAL, &["--samples", "growths.parquet"]));
    assert!(ran.code == Some(2) && ran.err.contains("use .csv"), "{}", ran.err);
}

#[test]
fn the_body_file_format_follows_the_extension() {
    let directory = tempfile::tempdir().unwrap();
    let file = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    for (name, begin) in [
        ("body.csv", &b"laid,x_mm"[..]),
        ("body.stl", b"binary STL"),
        ("body.obj", b"# growbot"),
        ("body.3mf", b"PK\x03\x04"),
        ("body.glb", b"glTF"),
        ("body.html", b"<!"),
        ("body.svg", b"<svg"),
        ("body.png", b"\x89PNG"),
        ("body.pdf", b"%PDF"),
        ("result.json", b"{\"final\""),
    ] {
        let ran = growbot(&with(&GOAL, &["--noise", "10", "--twist-noise", "0.5", "-o", &file(name)]));
        assert_eq!(ran.code, Some(0), "{}", ran.err);
        assert!(std::fs::read(file(name)).unwrap().starts_with(begin), "{name}");
        assert!(
            ran.err.contains(if name == "result.json" { "result written" } else { "laid (simulated)" }),
            "{}",
            ran.err
        );
    }
    // The body ends at the pose of the result.
    let found = json(&GOAL, &["--noise", "10", "--twist-noise", "0.5"]);
    let text = std::fs::read_to_string(file("body.csv")).unwrap();
    let last: Vec<f64> =
        text.lines().last().unwrap().split(',').skip(1).take(3).map(|at| at.parse().unwrap()).collect();
    for (at, name) in last.iter().zip(["x_mm", "y_mm", "z_mm"]) {
        assert!((at - number(&found["final"], name)).abs() < 1e-9, "{name}");
    }
    for (args, part) in [
        (&["-o", "body.ply"][..], "its extension .ply is not supported here"),
        (&["-o", "body"], "unknown format of"),
        (&["--repeat", "2", "-o", "body.stl"], "--repeat simulates many growths"),
    ] {
        let ran = growbot(&with(&GOAL, args));
        assert!(ran.code == Some(2) && ran.out.is_empty() && ran.err.contains(part), "{}", ran.err);
    }
}

#[test]
fn repeating_a_deterministic_growth_gives_a_note() {
    let ran = growbot(&with(&GOAL, &["--bias", "5", "--repeat", "4"]));
    assert_eq!(ran.err, "note: no noise is given, so all 4 growths are the same\n");
}

#[test]
fn bad_input_is_refused_in_one_message() {
    for (args, parts) in [
        (&["simulate"][..], ["there is nothing to grow", "--to"]),
        (&["simulate", "none.json"], ["none.json", "No such file"]),
        (
            &["simulate", "--to", "0,0,100,0,90", "--step", "3"],
            ["--step is the height of whole steps", "--slice whole"],
        ),
        (&["simulate", "--to", "0,0,100,0,90", "--slice", "whole", "--feedback"], ["--feedback", "--slice whole"]),
        (&["simulate", "--to", "0,0,100,0,90", "--radius", "50"], ["50", "98.2"]),
    ] {
        let ran = growbot(args);
        assert_eq!((ran.code, ran.out.as_str()), (Some(2), ""), "{}", ran.err);
        assert!(ran.err.starts_with("error: ") && ran.err.matches('\n').count() == 1, "{:?}", ran.err);
        parts.iter().for_each(|part| assert!(ran.err.contains(part), "no {part:?} in {}", ran.err));
    }
    let to = ["simulate", "--to", "0,0,100,0,90"];
    for (args, part) in [
        (&["--slice", "whole", "--step", "0"][..], "the value is 0 mm: give 0.01 to 10000"),
        (&["--slice", "whole", "--step", "nan"], "the value is NaN mm"),
        (&["--slice", "thick"], "exact, whole"),
        (&["--noise", "91"], "the value is 91 percent: give 0 to 90"),
        (&["--odometry-scale", "2"], "--feedback"),
        (&["--feedback", "--odometry-scale", "-91"], "the value is -91 percent: give -90 to 90"),
        (&["--gravity-only"], "--feedback"),
        (&["--repeat", "0"], "0 is not in 1.."),
        (&["--threads", "2"], "--repeat"),
        (&["--repeat", "2", "--threads", "0"], "0 is not in 1.."),
        (&["--seed", "-1"], "--seed"),
    ] {
        let ran = growbot(&with(&to, args));
        assert_eq!((ran.code, ran.out.as_str()), (Some(2), ""), "{}", ran.err);
        assert!(ran.err.contains(part), "no {part:?} in {}", ran.err);
    }
}

#[test]
fn samples_can_go_to_standard_output() {
    let ran = growbot(&["simulate", "--to", "0,0,50,0,90", "--noise", "10", "--repeat", "3", "--samples", "-"]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    let lines: Vec<&str> = ran.out.lines().collect();
    assert!(lines.len() == 4 && lines[0].starts_with("seed,") && lines[3].starts_with("3,"), "{}", ran.out);
    let ran = growbot(&["simulate", "--to", "0,0,50,0,90", "--samples", "-", "--json"]);
    assert!(ran.code == Some(2) && ran.err.contains("remove one of them"), "{}", ran.err);
}
