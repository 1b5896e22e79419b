//! Tests of `growbot view` and `export` in scenes with obstacles: pages, pictures and GLB files show the scene and the
//! narrowest clearance. The live pages of growths show them too.

use crate::fake_board;
use crate::lab;
use crate::running;

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Stdio};

use fake_board::FakeBoard;
use lab::wait_for;
use running::{PROGRAM, Ran, command, growbot};
use serde_json::Value;
use tempfile::TempDir;

const ROOM: &str = "format = \"growbot-scene/1\"\nmargin_mm = 5.0\n[[ball]]\ncenter_mm = [0, 0, 150]\nradius_mm = 40\n\
                    [[box]]\ncenter_mm = [150, 0, 100]\nsize_mm = [20, 200, 200]\n[[capsule]]\nfrom_mm = [-200, 90, 200]\n\
                    to_mm = [200, 90, 200]\nradius_mm = 15\n[[halfspace]]\npoint_mm = [0, 0, -40]\nnormal = [0, 0, 1]\n";

/// A directory with the scene `room.toml` and two plans: `straight.json`, which hits the ball of the scene and does not
/// name the scene, and `past.json`, which avoids the ball. Tests add `run.jsonl`, the run log of a growth.
struct Fixture(TempDir);

impl Fixture {
    fn new() -> Self {
        let fixture = Self(tempfile::tempdir().unwrap());
        fs::write(fixture.path("room.toml"), ROOM).unwrap();
        fixture.done(&["plan", "--to", "0,0,300", "-o", &fixture.path("straight.json")]);
        fixture.done(&[
            "plan",
            "--to",
            "0,0,300",
            "--scene",
            &fixture.path("room.toml"),
            "-o",
            &fixture.path("past.json"),
        ]);
        let text = fs::read_to_string(fixture.path("past.json")).unwrap();
        fs::write(fixture.path("past.json"), text.replace(&fixture.path("room.toml"), "room.toml")).unwrap();
        fixture
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().to_owned()
    }

    #[track_caller]
    fn done(&self, args: &[&str]) -> Ran {
        let ran = growbot(args);
        assert_eq!(ran.code, Some(0), "{args:?}: {}", ran.err);
        ran
    }

    /// Runs a command on the file `from` of the directory, and returns the content of its output file `to`.
    #[track_caller]
    fn made(&self, command: &str, from: &str, to: &str, more: &[&str]) -> Vec<u8> {
        self.done(&[&[command, &self.path(from), "-o", &self.path(to)], more].concat());
        fs::read(self.path(to)).unwrap()
    }

    /// Returns the clearance that `past.json` contains, mm.
    fn clearance(&self) -> f64 {
        let plan: Value = serde_json::from_slice(&fs::read(self.path("past.json")).unwrap()).unwrap();
        plan["scene"]["clearance_mm"].as_f64().unwrap()
    }
}

/// Returns the JSON data that an HTML page contains.
fn data(page: &[u8]) -> Value {
    let page = std::str::from_utf8(page).unwrap();
    let data = page.split_once("id=\"data\">").unwrap().1.split_once("</script>").unwrap().0;
    serde_json::from_str(data).unwrap()
}

/// Returns the names and values that a page lists under `Scene`.
fn scene_numbers(data: &Value) -> Vec<(String, String)> {
    let groups = data["numbers"].as_array().unwrap().iter();
    let scene = groups.clone().find(|group| group[0] == "Scene").map(|group| group[1].clone());
    serde_json::from_value(scene.unwrap_or_else(|| Value::Array(vec![]))).unwrap()
}

fn value<'a>(rows: &'a [(String, String)], name: &str) -> &'a str {
    &rows.iter().find(|row| row.0 == name).unwrap_or_else(|| panic!("no {name} in {rows:?}")).1
}

/// Returns the JSON part of a GLB file.
fn document(glb: &[u8]) -> Value {
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    serde_json::from_slice(&glb[20..20 + length]).unwrap()
}

#[test]
fn a_page_has_the_obstacles_and_the_narrowest_clearance() {
    let fixture = Fixture::new();
    let page = data(&fixture.made("view", "past.json", "past.html", &[]));
    let scene = &page["scene"];
    for kind in ["boxes", "balls", "capsules", "squares"] {
        assert_eq!(scene[kind].as_array().unwrap().len(), 1, "{kind}: {scene}");
    }
    let rows = scene_numbers(&page);
    assert_eq!((value(&rows, "File"), value(&rows, "Obstacles")), ("room.toml", "4, all shown"));
    let told: f64 = value(&rows, "Clearance").trim_end_matches(" mm").parse().unwrap();
    // The page rounds to hundredths, and the proof is repeated to 0.001 mm when the plan is read.
    assert!((told - fixture.clearance()).abs() <= 0.0071, "{told}");
    let narrowest = &scene["narrowest"];
    let point = |name: &str| -> Vec<f64> { serde_json::from_value(narrowest[name].clone()).unwrap() };
    let (body, obstacle) = (point("on_body"), point("on_obstacle"));
    let apart: f64 = body.iter().zip(&obstacle).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
    let outer = page["robot"]["outer_radius_mm"].as_f64().unwrap();
    assert!((apart - outer - told).abs() < 0.05, "{apart} mm, {told} mm and {outer} mm");
    // A page without a scene shows none of this.
    let page = data(&fixture.made("view", "straight.json", "straight.html", &[]));
    assert!(page["scene"].is_null() && scene_numbers(&page).is_empty());
}

#[test]
fn a_picture_has_obstacles_labels_and_a_text_alternative() {
    let fixture = Fixture::new();
    let svg = String::from_utf8(fixture.made("view", "past.json", "past.svg", &[])).unwrap();
    let title = svg.split_once("<title>").unwrap().1.split_once("</title>").unwrap().0;
    assert!(title.contains("room.toml: narrowest 5.") && title.contains("obstacles: 4, all shown"), "{title}");
    let words: Vec<&str> = svg.split("</text>").filter_map(|text| text.rsplit('>').next()).collect();
    assert!(words.iter().any(|line| line.starts_with("5.0") && line.contains(" mm to the ")), "{words:?}");
    assert!(svg.matches("fill-opacity=").count() >= 4, "few faces");
    assert!(fixture.made("view", "past.json", "past.pdf", &[]).starts_with(b"%PDF"));
    let without = String::from_utf8(fixture.made("view", "straight.json", "straight.svg", &[])).unwrap();
    assert!(!without.contains("narrowest") && !without.contains("fill-opacity"));
    // Two views side by side have a label each.
    let pair = [&fixture.path("past.json"), "--scene", &fixture.path("room.toml"), "--compare"];
    let svg = String::from_utf8(fixture.made("view", "straight.json", "pair.svg", &pair.map(|it| it as &str))).unwrap();
    let svg = svg.split_once("</title>").unwrap().1;
    let labels = svg.matches(" mm to").count() + svg.matches(" mm inside").count();
    assert_eq!(labels, 4, "two labels, each with its edge");
}

#[test]
fn a_glb_has_translucent_obstacles() {
    let fixture = Fixture::new();
    let glb = document(&fixture.made("export", "past.json", "past.glb", &[]));
    let names = |list: &str| -> Vec<String> {
        glb[list].as_array().unwrap().iter().map(|it| it["name"].as_str().unwrap().to_owned()).collect()
    };
    assert_eq!(names("nodes"), ["growbot-a", "obstacles", "narrowest place"]);
    assert_eq!(names("meshes"), ["wall", "obstacles", "narrowest place"]);
    let material = &glb["materials"][1];
    assert_eq!((&material["alphaMode"], &material["doubleSided"]), (&"BLEND".into(), &true.into()));
    assert!(material["pbrMetallicRoughness"]["baseColorFactor"][3].as_f64().unwrap() < 0.5, "{material}");
    assert_eq!(glb["meshes"][1]["extras"]["of"], 4);
    let told = glb["meshes"][2]["extras"]["clearance_mm"].as_f64().unwrap();
    assert!((told - fixture.clearance()).abs() < 0.01, "{told}");
    let stl = growbot(&["export", &fixture.path("past.json"), "-o", &fixture.path("a.stl"), "--scene", "room.toml"]);
    assert_eq!(stl.code, Some(2), "{}", stl.err);
    assert!(stl.err.contains("--scene applies only to GLB") && !fixture.0.path().join("a.stl").exists(), "{}", stl.err);
}

#[test]
fn a_plan_is_displayed_in_a_scene_it_collides_with() {
    let fixture = Fixture::new();
    let room = fixture.path("room.toml");
    let page = data(&fixture.made("view", "straight.json", "straight.html", &["--scene", &room]));
    let rows = scene_numbers(&page);
    assert!(value(&rows, "Clearance").ends_with(" mm inside"), "{rows:?}");
    assert!(value(&rows, "Narrowest").contains("the ball at 0, 0, 150"), "{rows:?}");
}

#[test]
fn a_missing_scene_is_an_error_for_a_plan_and_a_warning_for_a_growth() {
    let fixture = Fixture::new();
    let run = fixture.path("run.jsonl");
    fixture.done(&["grow", &fixture.path("past.json"), "--log", &run]);
    let page = data(&fixture.made("view", "run.jsonl", "run.html", &[]));
    let rows = scene_numbers(&page);
    assert!(value(&rows, "Narrowest").contains("the ball at") && !page["scene"].is_null(), "{rows:?}");
    let glb = document(&fixture.made("export", "run.jsonl", "run.glb", &[]));
    assert!(glb["nodes"].as_array().unwrap().iter().any(|node| node["name"] == "obstacles"), "{}", glb["nodes"]);

    fs::rename(fixture.path("room.toml"), fixture.path("moved.toml")).unwrap();
    let refused = growbot(&["view", &fixture.path("past.json"), "-o", &fixture.path("no.html")]);
    assert_eq!(refused.code, Some(2), "{}", refused.err);
    assert!(!fixture.0.path().join("no.html").exists());
    let warned = growbot(&["view", &run, "-o", &fixture.path("bare.html")]);
    assert_eq!(warned.code, Some(0), "{}", warned.err);
    let words = warned.err.replace("\n    ", " ");
    assert!(words.contains("warning: ") && words.contains("is left out"), "{words}");
    assert!(data(&fs::read(fixture.path("bare.html")).unwrap())["scene"].is_null());
    // The scene was moved. Another scene is refused for plans and growths.
    let moved = fixture.path("moved.toml");
    for file in ["past.json", "run.jsonl"] {
        let page = data(&fixture.made("view", file, "found.html", &["--scene", &moved]));
        assert_eq!(value(&scene_numbers(&page), "File"), moved);
    }
    fs::write(&moved, ROOM.replace("= 40", "= 41")).unwrap();
    for file in ["past.json", "run.jsonl"] {
        let refused = growbot(&["view", &fixture.path(file), "-o", &fixture.path("no.html"), "--scene", &moved]);
        assert_eq!(refused.code, Some(2), "{}", refused.err);
        assert!(refused.err.contains("has changed"), "{}", refused.err);
    }
}

#[test]
fn a_view_shows_the_nearest_points_of_a_huge_cloud_and_their_number() {
    const POINTS: usize = 300_000;
    let fixture = Fixture::new();
    let mut cloud = format!(
        "ply\nformat ascii 1.0\nelement vertex {POINTS}\nproperty float x\nproperty float y\nproperty float z\n\
         end_header\n"
    );
    for i in 0..POINTS {
        cloud += &format!("{} {} {}\n", 60 + i / 3000, i % 60, (i / 60) % 50 * 6);
    }
    fs::write(fixture.path("scan.ply"), cloud).unwrap();
    let scan = fixture.path("scan.ply");
    let page = fixture.made("view", "straight.json", "huge.html", &["--scene", &scan]);
    assert!(page.len() < 2_000_000, "{} bytes", page.len());
    let rows = scene_numbers(&data(&page));
    assert_eq!(value(&rows, "Obstacles"), "300000, the nearest 20000 shown");
    let svg = fixture.made("view", "straight.json", "huge.svg", &["--scene", &scan]);
    assert!(svg.len() < 1_500_000, "{} bytes", svg.len());
}

#[test]
fn an_example_is_determined_by_its_seed_and_passable() {
    let fixture = Fixture::new();
    for (kind, from, to) in [("pipe-rack", "0,0,0,0,90", "0,0,960"), ("rubble-heap", "0,0,60,0,0", "900,0,60")] {
        for seed in ["1", "2", "3"] {
            let scene = fixture.path("example.toml");
            let text = fixture.done(&["scene", kind, "--seed", seed]).out;
            fixture.done(&["scene", kind, "--seed", seed, "-o", &scene]);
            assert_eq!(fs::read_to_string(&scene).unwrap(), text);
            assert!(text.contains(&format!("--from {from} --to {to} ")), "{text}");
            // A straight path must not be clear, because the example would then be trivial.
            let plan = fixture.path("through.json");
            fixture.done(&["plan", "--from", from, "--to", to, "-o", &plan]);
            let straight = growbot(&["grow", &plan, "--scene", &scene]);
            assert_eq!(straight.code, Some(1), "{kind}, seed {seed}: {}", straight.err);
            fixture.done(&["plan", "--from", from, "--to", to, "--scene", &scene, "-o", &plan]);
        }
    }
    assert_eq!(growbot(&["scene", "pipe-rack", "-o", &fixture.path("a.json")]).code, Some(2));
    assert_eq!(growbot(&["scene", "attic"]).code, Some(2));
    assert_eq!(growbot(&["scene", "pipe-rack", "--json"]).code, Some(2));
}

#[test]
fn scene_shows_what_was_read_from_a_file() {
    let fixture = Fixture::new();
    let shown = fixture.done(&["scene", &fixture.path("room.toml")]).out;
    assert!(shown.contains("  x          -215.00 to     215.00 mm\n"), "{shown}");
    assert!(
        shown.contains("3 boxes, balls and capsules, 1 half spaces") && shown.contains("margin    5 mm"),
        "{shown}"
    );
    // An exported body is read where it is, from both formats.
    let read = |name: &str| -> Value {
        fixture.made("export", "straight.json", name, &[]);
        serde_json::from_str(&fixture.done(&["scene", &fixture.path(name), "--json"]).out).unwrap()
    };
    let [stl, glb] = [read("body.stl"), read("body.glb")];
    assert_eq!((&stl["margin_mm"], &stl["triangles"]), (&Value::Null, &glb["triangles"]));
    for corner in ["min_mm", "max_mm"] {
        for axis in 0..3 {
            let [stl, glb] = [&stl, &glb].map(|scene| scene["box"][corner][axis].as_f64().unwrap());
            assert!((stl - glb).abs() < 0.01, "{corner} {axis}: {stl} {glb}");
        }
    }
    assert!((glb["box"]["max_mm"][2].as_f64().unwrap() - 300.0).abs() < 0.01, "{glb}");
    let with_seed = growbot(&["scene", &fixture.path("body.stl"), "--seed", "2"]);
    assert!(with_seed.code == Some(2) && with_seed.err.contains("remove these options"), "{}", with_seed.err);
}

/// Requests the live page of a growth from the address that the growth prints, and returns the page.
fn page_of(growing: &mut Child) -> String {
    let answer = BufReader::new(growing.stderr.as_mut().unwrap());
    let address = answer.lines().find_map(|line| {
        let line = line.unwrap();
        Some(line.split_once("live view: http://")?.1.to_owned())
    });
    let address = address.expect("the growth says where it can be watched");
    let (host, path) = address.split_once('/').unwrap();
    let mut stream = TcpStream::connect(host).unwrap();
    write!(stream, "GET /{path}api/v1/jobs/growth/live/ HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n")
        .unwrap();
    let mut page = String::new();
    stream.read_to_string(&mut page).unwrap();
    page
}

#[test]
fn the_page_shows_the_scene_before_and_after_a_resume() {
    let fixture = Fixture::new();
    let board = FakeBoard::lasting("growbot-a");
    // The board's time almost stops after these layers.
    board.pause_after(3);
    let (plan, log) = (fixture.path("past.json"), fixture.path("run.jsonl"));
    for growth in [vec!["grow", &plan, "--log", &log], vec!["resume", &log, "--yes"]] {
        let mut growing = command(PROGRAM)
            .args(&growth)
            .args(["--port", &board.port(), "--on-host-silence", "continue", "--watch"])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let page = data(page_of(&mut growing).as_bytes());
        assert_eq!(page["scene"]["balls"].as_array().unwrap().len(), 1, "{growth:?}: {}", page["scene"]);
        let laid = || fs::read_to_string(&log).unwrap_or_default().matches("\"laid\",").count();
        wait_for("three layers are laid", || (laid() >= 3).then_some(()));
        growing.kill().unwrap();
        growing.wait().unwrap();
    }
}
