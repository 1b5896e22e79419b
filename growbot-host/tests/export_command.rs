//! Tests of `growbot export` as users and scripts run it: formats, results, exit codes, messages. tests/exports/run
//! checks the exported files with other programs.

use crate::running;

use std::fs;
use std::path::Path;

use running::{growbot, growbot_reading};
use serde_json::Value;
use tempfile::TempDir;

/// A directory with a plan of 100 mm and the run log of a growth of 5 mm.
struct Bodies(TempDir);

impl Bodies {
    fn new() -> Self {
        let bodies = Self(tempfile::tempdir().unwrap());
        assert_eq!(growbot(&["plan", "--to", "0,0,100,0,90", "-o", &bodies.path("plan.json")]).code, Some(0));
        let grow = ["grow", "--robot", "growbot-a2", "--to", "0,0,5,0,90", "--log", &bodies.path("run.jsonl")];
        assert_eq!(growbot(&grow).code, Some(0));
        bodies
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().to_string()
    }

    /// Exports the file `from` of the directory to the file `to`, and returns the content of `to`.
    #[track_caller]
    fn export(&self, from: &str, to: &str, more: &[&str]) -> Vec<u8> {
        let to = self.path(to);
        let ran = growbot(&[&["export", &self.path(from), "-o", &to], more].concat());
        assert_eq!((ran.code, ran.out.as_str()), (Some(0), ""), "{}", ran.err);
        fs::read(to).unwrap()
    }
}

#[test]
fn help_has_examples_and_fits_80_columns() {
    let ran = growbot(&["export", "--help"]);
    assert!(ran.out.contains("Usage: growbot") && ran.out.contains("Example"), "{}", ran.out);
    assert!(ran.out.lines().all(|line| line.chars().count() <= 80), "{}", ran.out);
}

#[test]
fn the_format_comes_from_the_extension_unless_given() {
    let bodies = Bodies::new();
    assert!(bodies.export("plan.json", "a.stl", &[]).starts_with(b"binary STL, units mm"));
    assert!(bodies.export("plan.json", "a.obj", &[]).starts_with(b"# growbot"));
    assert!(bodies.export("plan.json", "a.3mf", &[]).starts_with(b"PK\x03\x04"));
    assert!(bodies.export("plan.json", "a.GLB", &[]).starts_with(b"glTF"));
    assert!(bodies.export("plan.json", "a.csv", &[]).starts_with(b"laid,x_mm"));
    assert!(bodies.export("run.jsonl", "a.mcap", &[]).starts_with(b"\x89MCAP0\r\n"));
    assert!(bodies.export("plan.json", "b", &["--format", "csv"]).starts_with(b"laid,x_mm"));
    assert!(bodies.export("plan.json", "b.STL", &["--format", "stl"]).starts_with(b"binary STL, units mm"));
    assert!(bodies.export("plan.json", "b.3MF", &["--format", "3mf"]).starts_with(b"PK\x03\x04"));
    // Coarser meshes have fewer triangles, and a simulated body is called so.
    let [coarse, fine] = ["8", "16"].map(|segments| {
        let text = String::from_utf8(bodies.export("run.jsonl", "c.obj", &["--segments", segments])).unwrap();
        assert!(text.lines().next().unwrap().contains("growbot-a2, laid (simulated)"), "{text}");
        text.lines().filter(|line| line.starts_with("f ")).count()
    });
    assert_eq!(2 * coarse, fine);
}

#[test]
fn a_plan_is_exported_from_pipe_to_pipe() {
    let plan = growbot(&["plan", "--to", "0,0,100,0,90", "--json"]).out;
    let ran = growbot_reading(&["export", "-", "--format", "csv"], &plan);
    assert_eq!((ran.code, ran.err.as_str()), (Some(0), ""));
    let layers = serde_json::from_str::<Value>(&plan).unwrap()["layers"].as_u64().unwrap();
    assert_eq!(ran.out.lines().count() as u64, layers + 2);
    assert!(ran.out.lines().last().unwrap().starts_with(&format!("{layers},")));
}

#[test]
fn a_log_is_exported_as_built_even_if_truncated() {
    let bodies = Bodies::new();
    let whole = String::from_utf8(bodies.export("run.jsonl", "whole.csv", &[])).unwrap();
    assert!(whole.lines().skip(2).all(|row| row.contains(",laid-simulated,")), "{whole}");
    let commanded = String::from_utf8(bodies.export("run.jsonl", "commanded.csv", &["--body", "commanded"])).unwrap();
    assert!(commanded.lines().skip(2).all(|row| row.ends_with(",as-built")), "{commanded}");
    // The log of a real robot contains only what follows from its steps.
    let log = fs::read_to_string(bodies.path("run.jsonl")).unwrap();
    let steps: String =
        log.lines().filter(|line| !line.contains("\"event\":\"simulated\"")).flat_map(|line| [line, "\n"]).collect();
    assert!(steps.len() < log.len());
    fs::write(bodies.path("robot.jsonl"), &steps).unwrap();
    assert_eq!(String::from_utf8(bodies.export("robot.jsonl", "robot.csv", &[])).unwrap(), commanded);
    for (log, of) in [(&log, &whole), (&steps, &commanded)] {
        fs::write(bodies.path("cut.jsonl"), &log[..log.len() * 4 / 5]).unwrap();
        let part = String::from_utf8(bodies.export("cut.jsonl", "part.csv", &[])).unwrap();
        let told = part.lines().filter(|row| !row.contains(",as-built,")).count();
        assert!(part.lines().take(told).eq(of.lines().take(told)) && told > 1 && part.len() < of.len(), "{part}");
    }
}

#[test]
fn a_trajectory_matches_the_layer_table_in_seconds_and_metres() {
    let bodies = Bodies::new();
    for (from, more) in [("plan.json", &[][..]), ("run.jsonl", &[]), ("run.jsonl", &["--body", "commanded"])] {
        let text = String::from_utf8(bodies.export(from, "a.tum", more)).unwrap();
        let table = String::from_utf8(bodies.export(from, "a.csv", more)).unwrap();
        let rows: Vec<Vec<f64>> = text
            .lines()
            .filter(|line| !line.starts_with('#'))
            .map(|line| line.split(' ').map(|number| number.parse().unwrap()).collect())
            .collect();
        let places: Vec<Vec<f64>> = table
            .lines()
            .skip(1)
            .map(|row| row.split(',').skip(1).take(3).map(|mm| mm.parse::<f64>().unwrap() / 1000.0).collect())
            .collect();
        let places = &places[places.len() - rows.len()..];
        assert!(rows.len() > 5 && rows.windows(2).all(|pair| pair[0][0] < pair[1][0]), "{text}");
        assert!(rows.iter().zip(places).all(|(row, place)| row[1..4] == place[..]), "{text}");
        assert!(text.contains("s and m"), "{text}");
    }
}

#[test]
fn a_ros_2_recording_has_complete_type_definitions() {
    let bodies = Bodies::new();
    let bytes = bodies.export("run.jsonl", "bag.mcap", &["--ros2"]);
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let mut channels: Vec<(String, String)> = summary
        .channels
        .values()
        .map(|channel| {
            let schema = channel.schema.as_ref().unwrap();
            assert_eq!((channel.message_encoding.as_str(), schema.encoding.as_str()), ("cdr", "ros2msg"));
            let definition = String::from_utf8(schema.data.to_vec()).unwrap();
            assert!(definition.contains("MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\n"), "{definition}");
            (channel.topic.clone(), schema.name.clone())
        })
        .collect();
    channels.sort();
    let of =
        |kind: &'static str| channels.iter().filter(move |(_, name)| name == kind).map(|(topic, _)| topic.as_str());
    let poses = ["/growbot/commanded", "/growbot/goal", "/growbot/start", "/growbot/tip"];
    assert!(of("geometry_msgs/msg/PoseStamped").eq(poses), "{channels:?}");
    assert!(of("nav_msgs/msg/Path").eq(["/growbot/body", "/growbot/plan"]));
    assert!(of("tf2_msgs/msg/TFMessage").eq(["/tf"]) && of("visualization_msgs/msg/Marker").eq(["/growbot/layers"]));
    assert!(of("diagnostic_msgs/msg/DiagnosticArray").eq(["/diagnostics"]) && channels.len() == 9);
    // The last pose: header, timestamp, "base" of five bytes including its zero, then seven numbers of eight bytes.
    let tip =
        mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap).filter(|it| it.channel.topic == "/growbot/tip");
    let tip = tip.last().unwrap();
    assert_eq!((tip.data[..4].to_vec(), tip.data.len()), (vec![0, 1, 0, 0], 4 + 24 + 56));
    let number = |index: usize| f64::from_le_bytes(tip.data[28 + 8 * index..36 + 8 * index].try_into().unwrap());
    let table = String::from_utf8(bodies.export("run.jsonl", "a.csv", &[])).unwrap();
    let last: Vec<f64> = table.lines().last().unwrap().split(',').take(4).map(|at| at.parse().unwrap()).collect();
    assert_eq!([number(0), number(1), number(2)], [last[1] / 1000.0, last[2] / 1000.0, last[3] / 1000.0]);
    // Without --ros2 the output remains JSON.
    let bytes = bodies.export("run.jsonl", "a.mcap", &[]);
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    assert!(summary.channels.values().all(|channel| channel.message_encoding == "json"));
}

#[test]
fn failed_exports_give_one_line_and_leave_no_file() {
    let bodies = Bodies::new();
    let [plan, log, kept] = ["plan.json", "run.jsonl", "kept.stl"].map(|name| bodies.path(name));
    fs::write(&kept, "kept").unwrap();
    let header = fs::read_to_string(&log).unwrap().lines().next().unwrap().to_string() + "\n";
    fs::write(bodies.path("empty.jsonl"), &header).unwrap();
    fs::write(bodies.path("old.jsonl"), header.replace("growbot-run/4", "growbot-run/1")).unwrap();
    let names = |directory: &Path| fs::read_dir(directory).unwrap().count();
    let before = names(bodies.0.path());
    for (args, answer) in [
        (vec![plan.as_str(), "-o", &bodies.path("a.mcap")], "run log"),
        (vec![&plan, "-o", &bodies.path("a.ply")], "use .stl, .obj, .3mf, .glb, .csv, .tum or .mcap"),
        (vec![&plan], "--format"),
        (vec![&log, "-o", &bodies.path("a.stl"), "--ros2"], "--ros2 applies only to MCAP"),
        (vec![&log, "-o", &bodies.path("a.3mf"), "--scene", "room.toml"], "--scene applies only to GLB"),
        (vec![&plan, "-o", &bodies.path("a.obj"), "--format", "3mf"], "use .3mf"),
        (vec![&bodies.path("empty.jsonl"), "-o", &kept], "0 mm long"),
        (vec![&bodies.path("empty.jsonl"), "-o", &bodies.path("a.3mf")], "0 mm long"),
        (vec![&bodies.path("empty.jsonl"), "-o", &bodies.path("a.obj")], "0 mm long"),
        (vec![&bodies.path("old.jsonl"), "-o", &kept], "growbot-run/1"),
        (vec![&kept, "-o", &bodies.path("a.glb")], "not JSON"),
        (vec![&bodies.path("missing"), "-o", &kept], "missing"),
        (vec![&plan, "-o", &bodies.path("missing/a.stl")], "does not exist"),
        (vec![&log, "-o", &kept, "--robot", "growbot-b"], "robot"),
        (vec![&plan, "-o", &kept, "--segments", "7"], "8..=1024"),
    ] {
        let ran = growbot(&[vec!["export"], args.clone()].concat());
        assert_eq!((ran.code, ran.out.as_str()), (Some(2), ""), "{args:?}: {}", ran.err);
        assert!(ran.err.contains(answer), "{args:?}: {}", ran.err);
        assert!(args.contains(&"--segments") || ran.err.lines().count() == 1, "{args:?}: {}", ran.err);
    }
    assert_eq!(names(bodies.0.path()), before);
    assert_eq!(fs::read(&kept).unwrap(), b"kept");
}
