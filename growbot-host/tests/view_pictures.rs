//! Tests of `growbot view --svg`, `--png` and `--plot` as a user runs them. The picture at the head of README.md is
//! compared with the output of the commands below the picture.

use crate::running;

use std::fs;
use std::path::{Path, PathBuf};

use running::{Ran, growbot};

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn done(args: &[&str]) -> Ran {
    let ran = growbot(args);
    assert_eq!(ran.code, Some(0), "{args:?}: {}", ran.err);
    ran
}

/// Runs growbot, and checks that it ended with exit code 2, printed one message of one line that contains `parts`, and
/// wrote no file.
fn assert_refused(args: &[&str], parts: &[&str], file: &Path) {
    let ran = growbot(args);
    assert_eq!((ran.code, ran.err.lines().count()), (Some(2), 1), "{args:?}: {}", ran.err);
    for part in parts {
        assert!(ran.err.contains(part), "{part:?} is not in {:?}", ran.err);
    }
    assert!(ran.out.is_empty() && !file.exists(), "{args:?}");
}

/// Returns a directory, and the paths of two files in it: a plan with a bend, and the run log of a growth of the plan
/// with noise.
fn plan_and_run() -> (tempfile::TempDir, PathBuf, PathBuf) {
    let directory = tempfile::tempdir().unwrap();
    let (plan, run) = (directory.path().join("plan.json"), directory.path().join("run.jsonl"));
    done(&["plan", "--to", "120,60,200,30,20", "-o", text(&plan)]);
    done(&["grow", text(&plan), "--noise", "10", "--seed", "1", "--log", text(&run)]);
    (directory, plan, run)
}

/// Returns the width and the height of a PNG file, pixels, and its RGB values.
fn pixels(file: &Path) -> (u32, u32, Vec<u8>) {
    let decoder = png::Decoder::new(std::io::BufReader::new(fs::File::open(file).unwrap()));
    let mut reader = decoder.read_info().unwrap();
    let mut colours = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut colours).unwrap();
    assert_eq!(info.color_type, png::ColorType::Rgb);
    (info.width, info.height, colours)
}

/// Checks that a new picture equals the committed picture of this name in the book.
fn assert_same_picture(name: &str, made: &Path) {
    /// Difference of a colour value above which a pixel counts as different. Up to a fraction `MAX_OTHERS` of the
    /// pixels may differ, because edges and letters move slightly with each release of the drawing libraries.
    const OTHER: u8 = 48;
    const MAX_OTHERS: f64 = 0.005;
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("../book/src/pictures").join(name);
    assert!(fs::metadata(&committed).unwrap().len() < 200_000, "{name} is too large");
    let (before, now) = (pixels(&committed), pixels(made));
    assert_eq!(
        (before.0, before.1),
        (now.0, now.1),
        "{} is of another size than {}",
        made.display(),
        committed.display()
    );
    let pairs = before.2.chunks_exact(3).zip(now.2.chunks_exact(3));
    let others = pairs.filter(|(a, b)| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > OTHER)).count();
    let share = others as f64 / (f64::from(now.0) * f64::from(now.1));
    assert!(
        share <= MAX_OTHERS,
        "{:.3} % of the pixels differ: look at {}, and if that is meant, copy it to {}",
        100.0 * share,
        made.display(),
        committed.display()
    );
}

#[test]
fn pictures_of_the_chapters_match_their_commands() {
    let directory = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let book = Path::new(env!("CARGO_MANIFEST_DIR")).join("../book/src/pipe-rack.md");
    let book = fs::read_to_string(book).unwrap();
    for (kind, scene, plan, to) in [
        ("pipe-rack", "rack.toml", "rack.json", &["--to", "0,0,960"][..]),
        ("rubble-heap", "heap.toml", "heap.json", &["--from", "0,0,60,0,0", "--to", "900,0,60"]),
    ] {
        let planned = format!("growbot plan {} --scene {scene} -o {plan}\n", to.join(" "));
        let drawn = format!("growbot view {plan} --png --width 800\n");
        for command in [format!("growbot scene {kind} --seed 1 -o {scene}\n"), planned, drawn] {
            assert!(book.contains(&command), "pipe-rack.md has another command than {command:?}");
        }
        let name = format!("{kind}.png");
        let [scene, plan, made] = [scene, plan, &name].map(|name| directory.join(name));
        done(&["scene", kind, "--seed", "1", "-o", text(&scene)]);
        done(&[&["plan", "--scene", text(&scene), "-o", text(&plan)], to].concat());
        done(&["view", text(&plan), "--png", "--width", "800", "-o", text(&made)]);
        assert_same_picture(&name, &made);
    }
}

#[test]
fn the_picture_of_the_readme_matches_its_commands() {
    let directory = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let [two_plane, shortest, made] =
        ["two-plane.json", "shortest.json", "compare.png"].map(|name| directory.join(name));

    // The commands of README.md, in another directory.
    let readme = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../README.md")).unwrap();
    for command in [
        "growbot plan --to 300,200,250,-45,-30 --planner two-plane -o two-plane.json ",
        "growbot plan --to 300,200,250,-45,-30 -o shortest.json ",
        "growbot view --compare two-plane.json shortest.json --png --width 1400 -o compare.png\n",
    ] {
        assert!(readme.contains(command), "README.md has another command than {command:?}");
    }
    done(&["plan", "--to", "300,200,250,-45,-30", "--planner", "two-plane", "-o", text(&two_plane)]);
    done(&["plan", "--to", "300,200,250,-45,-30", "-o", text(&shortest)]);
    done(&["view", "--compare", text(&two_plane), text(&shortest), "--png", "--width", "1400", "-o", text(&made)]);

    assert_same_picture("compare.png", &made);
}

#[test]
fn a_picture_has_a_title_and_a_limited_file_size() {
    let (directory, plan, run) = plan_and_run();
    let path = |name: &str| directory.path().join(name);
    done(&["view", text(&plan), "--svg"]);
    let svg = fs::read_to_string(path("plan.svg")).unwrap();
    for part in [
        "<title>plan.json: shortest (",
        " layers</title>",
        ">start<",
        ">goal<",
        "Height of the layers, mm",
        " mm</text>",
    ] {
        assert!(svg.contains(part), "{part}");
    }
    assert!(svg.len() < 500_000 && !svg.contains("NaN") && !svg.contains("inf"), "{}", svg.len());
    // The extension selects the format, and `--viewpoint side` gives another picture.
    done(&["view", text(&plan), "-o", text(&path("side.svg")), "--viewpoint", "side"]);
    assert_ne!(fs::read_to_string(path("side.svg")).unwrap(), svg);
    done(&["view", text(&run), "--svg"]);
    let grown = fs::read_to_string(path("run.svg")).unwrap();
    assert!(grown.contains("off the goal, as the tip says; up to ") && grown.contains("stroke-dasharray"));
    assert!(grown.contains(">plan</text>") && !grown.contains(">estimated</text>"));
    // A plan and its log often have the same name.
    fs::copy(&plan, path("run.json")).unwrap();
    done(&["view", "--compare", text(&path("run.json")), text(&run), "--svg"]);
    let alike = fs::read_to_string(path("run.json-run.jsonl.svg")).unwrap();
    assert!(alike.contains(">run.json</text>") && alike.contains(">run.jsonl</text>"), "both have one name");
    // With feedback, the picture also has the estimated line.
    let followed = path("followed.jsonl");
    done(&["grow", text(&plan), "--bias", "20", "--feedback", "--log", text(&followed)]);
    done(&["view", "--compare", text(&run), text(&followed), "-o", text(&path("feedback.svg"))]);
    let compared = fs::read_to_string(path("feedback.svg")).unwrap();
    for name in [">plan</text>", ">estimated</text>"] {
        assert_eq!(compared.matches(name).count(), 1, "{name}");
    }
    assert_eq!(compared.matches(r##"stroke="#c2185b" stroke-width="1.5""##).count(), 2, "the line and its sample");
    done(&["view", "--compare", text(&plan), text(&run), "--png", "--width", "640"]);
    assert_eq!(pixels(&path("plan-run.png")).0, 640);

    // All texts are within the drawing from every side.
    let level = path("level.json");
    let many: Vec<String> = (1..9).map(|n| format!("--via={},0,{},0,0", 400 * n, 200 + 40 * (n % 2))).collect();
    let many: Vec<&str> = many.iter().map(String::as_str).collect();
    done(&[&["plan", "--to", "4000,0,200,0,0", "-o", text(&level)], &many[..]].concat());
    for look in ["corner", "front", "side", "top"] {
        done(&["view", "--compare", text(&level), text(&plan), "--viewpoint", look, "-o", text(&path("level.svg"))]);
        let svg = fs::read_to_string(path("level.svg")).unwrap();
        for word in svg.split("<text ").skip(1) {
            let (attributes, rest) = word.split_once('>').unwrap();
            let number = |name: &str| attributes.split_once(name).unwrap().1.split('"').next().unwrap().parse::<f64>();
            let (x, letters) = (number(" x=\"").unwrap(), rest.split("</text>").next().unwrap().chars().count() as f64);
            let left = if attributes.contains("mid") { x - 3.0 * letters } else { x };
            assert!(attributes.contains("end") || (left >= 0.0 && left + 6.0 * letters <= 960.0), "{look}: {word}");
        }
    }

    let long = path("long.json");
    let via = ["--via", "1800,0,1200,90,0", "--via", "900,1800,700,180,20", "--via", "-400,1200,1600,-90,0"];
    done(&[&["plan", "--to", "0,0,500,0,-90", "-o", text(&long)], &via[..]].concat());
    done(&["view", text(&long), "--svg"]);
    let svg = fs::read_to_string(path("long.svg")).unwrap();
    assert!(svg.len() < 500_000 && svg.contains(">via 3<"), "{}", svg.len());
}

#[test]
fn the_smallest_bodies_have_pictures_and_plots() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    for to in ["0,0,0,0,90", "0,0,0.1,0,90"] {
        done(&["plan", "--to", to, "-o", text(&path("plan.json"))]);
        for look in ["corner", "front", "side", "top"] {
            done(&[
                "view",
                text(&path("plan.json")),
                "-o",
                text(&path("plan.png")),
                "--viewpoint",
                look,
                "--width",
                "100",
            ]);
        }
        done(&["view", text(&path("plan.json")), "--plot", "heights,tilt", "--x-axis", "time"]);
        let svg = fs::read_to_string(path("plan-plot.svg")).unwrap();
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    }
}

#[test]
fn plots_have_a_panel_for_each_quantity_with_units() {
    let (directory, plan, run) = plan_and_run();
    let path = |name: &str| directory.path().join(name);
    done(&["view", text(&plan), "--plot", "heights,tilt"]);
    let svg = fs::read_to_string(path("plan-plot.svg")).unwrap();
    for part in ["Height of the layers", "Tilt of the layers", ">mm</text>", ">deg</text>", "along the body, mm"] {
        assert!(svg.contains(part), "{part}");
    }
    done(&["view", text(&run), "--plot", "heights,tilt,error,temperature", "--x-axis", "time"]);
    let svg = fs::read_to_string(path("run-plot.svg")).unwrap();
    for part in ["Deviation", "Temperature of the nozzle", "\u{b0}C</text>", "time, min"] {
        assert!(svg.contains(part), "{part}");
    }
    assert_eq!(svg.matches("class=\"head\"").count(), 4);
    done(&["view", text(&run), "--plot", "error", "--png", "--width", "300"]);
    assert_eq!(pixels(&path("run-plot.png")).0, 300);
}

#[test]
fn a_picture_for_a_paper_has_axes_a_range_a_palette_and_no_title() {
    let (directory, plan, run) = plan_and_run();
    let path = |name: &str| directory.path().join(name);
    let svg = |args: &[&str]| {
        done(&[&["view", "-o", text(&path("out.svg"))], args].concat());
        fs::read_to_string(path("out.svg")).unwrap()
    };
    let usual = svg(&[text(&run)]);
    assert!(usual.contains(">from percentile 1 to 99<") && usual.contains(">&lt; 0."), "the range is told");
    assert!(usual.contains("class=\"title\"") && !usual.contains(">x, mm<") && usual.contains("#2f5fae"));
    let paper = svg(&[text(&run), "--no-title", "--axes", "--range", "0.5,1.25", "--palette", "viridis"]);
    for part in [">x, mm<", ">z, mm<", ">0.50<", ">1.25<", "#440154", "Height of the layers, mm"] {
        assert!(paper.contains(part), "{part}");
    }
    assert!(!paper.contains("percentile") && !paper.contains("class=\"title\""));
    assert!(svg(&[text(&plan), "--palette", "cividis"]).contains("#00224e"));
    // Several files are drawn in one drawing at one scale, each with its name.
    let five = svg(&["--compare", text(&plan), text(&run), text(&plan), text(&plan), text(&run)]);
    assert_eq!((five.matches("class=\"title\"").count(), five.matches("gc-heights").count()), (5, 2));
    for (args, part) in [
        (&["--range", "1,0.5"][..], "give the smaller height first"),
        (&["--range", "1"], "give two heights in mm"),
        (&["--palette", "jet"], "viridis"),
        (&["--axes", "--plot", "tilt"], "cannot be used with"),
    ] {
        let ran = growbot(&[&["view", text(&plan), "-o", text(&path("none.svg"))], args].concat());
        assert!(ran.code == Some(2) && ran.err.contains(part) && !path("none.svg").exists(), "{}", ran.err);
    }
    let ran = growbot(&["view", text(&plan), "--axes"]);
    assert!(ran.code == Some(2) && ran.err.contains("--axes applies only to pictures"), "{}", ran.err);
    let ran = growbot(&["view", "--compare", text(&plan), text(&run), text(&plan)]);
    assert!(ran.code == Some(2) && ran.err.contains("a page can show two bodies at most"), "{}", ran.err);
}

#[test]
fn a_pdf_has_a_page_of_the_drawing() {
    let (directory, plan, run) = plan_and_run();
    let path = |name: &str| directory.path().join(name);
    for (args, name) in [
        (&["view", text(&plan), "--pdf"][..], "plan.pdf"),
        (&["view", text(&run), "--plot", "heights,error", "--pdf"], "run-plot.pdf"),
        (&["workspace", "--length", "500", "-o", text(&path("reach.pdf"))], "reach.pdf"),
    ] {
        done(args);
        let bytes = fs::read(path(name)).unwrap();
        let words = String::from_utf8_lossy(&bytes);
        assert!(
            bytes.starts_with(b"%PDF-") && words.contains("/Count 1") && words.contains("/MediaBox [0 0 "),
            "{name}"
        );
        assert!((5_000..500_000).contains(&bytes.len()), "{name}: {}", bytes.len());
    }
    done(&["workspace", "--length", "500", "-o", text(&path("reach.png"))]);
    assert_eq!(pixels(&path("reach.png")).0, 1760);
    let ran = growbot(&["workspace", "--length", "500", "-o", text(&path("reach.jpg"))]);
    assert!(ran.code == Some(2) && ran.err.contains(".svg, .png or .pdf"), "{}", ran.err);
}

#[test]
fn several_runs_are_plotted_in_different_colours() {
    let (directory, plan, run) = plan_and_run();
    let path = |name: &str| directory.path().join(name);
    let other = path("other.jsonl");
    done(&["grow", text(&plan), "--noise", "10", "--seed", "2", "--log", text(&other)]);
    done(&["view", "--compare", text(&run), text(&other), "--plot", "heights,error", "-o", text(&path("both.svg"))]);
    let svg = fs::read_to_string(path("both.svg")).unwrap();
    for (part, count) in
        [("#0072b2", 3), ("#d55e00", 3), (">run</text>", 1), (">other</text>", 1), ("class=\"head\"", 2)]
    {
        assert_eq!(svg.matches(part).count(), count, "{part}");
    }
    assert!(
        svg.contains("Deviation from the plan") && svg.contains("along the body, mm") && svg.contains(">mm</text>")
    );
    done(&["view", text(&run), "--plot", "tilt", "--no-title"]);
    assert!(!fs::read_to_string(path("run-plot.svg")).unwrap().contains("class=\"title\""));
}

#[test]
fn failed_drawings_are_reported_and_leave_no_file() {
    let (directory, plan, run) = plan_and_run();
    let file = directory.path().join("out.svg");
    let view =
        |args: &[&str], parts: &[&str]| assert_refused(&[&["view", "-o", text(&file)], args].concat(), parts, &file);
    view(
        &[text(&plan), "--plot", "temperature"],
        &["plan.json is not the log of a growth", "no temperature", "run log"],
    );
    view(&[text(&plan), "--plot", "heights,error"], &["plan.json is not the log of a growth", "error", "run log"]);
    let lines = fs::read_to_string(&run).unwrap();
    let cold: String =
        lines.lines().filter(|line| !line.contains("temperature_c")).map(|line| format!("{line}\n")).collect();
    fs::write(directory.path().join("cold.jsonl"), cold).unwrap();
    view(&[text(&directory.path().join("cold.jsonl")), "--plot", "temperature"], &["cold.jsonl has no temperature"]);
    view(&[text(&directory.path().join("none.json")), "--svg"], &["none.json", "cannot read"]);
    view(&[text(&plan), text(&run), "--svg"], &["--compare"]);
    view(&[text(&plan), "--png"], &["out.svg", "use .png"]);
    // Errors of the options' own parser take more lines.
    for args in [
        &["--plot", "heigth"][..],
        &["--svg", "--png"],
        &["--png", "--width", "7"],
        &["--x-axis", "time"],
        &["--plot", "tilt", "--viewpoint", "top"],
    ] {
        let ran = growbot(&[&["view", text(&plan)], args].concat());
        assert_eq!(ran.code, Some(2), "{args:?}: {}", ran.err);
    }
    let refused = growbot(&["view", text(&plan), "--plot", "tilt", "-o", text(&directory.path().join("tilt.html"))]);
    assert!(refused.code == Some(2) && refused.err.contains("use .svg, .png or .pdf"), "{}", refused.err);
    let refused = growbot(&["view", text(&plan), "--width", "800"]);
    assert!(refused.code == Some(2) && refused.err.contains("--png"), "{}", refused.err);
    let refused = growbot(&["view", text(&plan), "--viewpoint", "top"]);
    assert!(refused.code == Some(2) && refused.err.contains("--svg"), "{}", refused.err);
}
