//! Tests of the files that commands read and write. No input is overwritten under any name, each extension matches its
//! format, and no command waits forever. The content of files cannot control a terminal, and a run log that cannot be
//! written is reported at once.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::symlink;
use std::process::Stdio;

use growbot_plan::sanitize::is_control;
use running::{PROGRAM, Ran, command, growbot, growbot_reading, in_lines};
use serde_json::Value;
use tempfile::TempDir;

use crate::running;

/// A directory with a plan, the run log of its growth with a simulated tip that lays layers imperfectly, a robot file
/// and a batch of goals.
struct Files(TempDir);

impl Files {
    fn new() -> Self {
        let files = Self(tempfile::tempdir().unwrap());
        assert_eq!(growbot(&["plan", "--to", "200,0,200,0,0", "-o", &files.path("plan.json")]).code, Some(0));
        let log = files.path("run.jsonl");
        let grown = growbot(&["grow", &files.path("plan.json"), "--tilt-bias", "20", "--log", &log, "--json"]);
        assert_eq!(grown.code, Some(0), "{}", grown.err);
        fs::write(files.path("grown.json"), grown.out).unwrap();
        fs::write(files.path("robot.toml"), text_of_robot()).unwrap();
        let header = "id,from_x_mm,from_y_mm,from_z_mm,from_heading_deg,from_pitch_deg,to_x_mm,to_y_mm,to_z_mm,to_heading_deg,to_pitch_deg";
        fs::write(files.path("queries.csv"), format!("{header}\na,0,0,0,0,90,0,0,100,0,90\n")).unwrap();
        files
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().to_owned()
    }
}

fn text_of_robot() -> String {
    fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../robots/growbot-a.toml")).unwrap()
}

/// Checks that the output contains no character that controls a terminal.
#[track_caller]
fn assert_plain(ran: &Ran) {
    for text in [&ran.out, &ran.err] {
        let hostile = text.chars().find(|letter| *letter != '\n' && is_control(*letter));
        assert_eq!(hostile, None, "{text:?}");
    }
}

#[test]
fn no_command_overwrites_its_input_under_any_path() {
    let files = Files::new();
    let [plan, run, robot] = ["plan.json", "run.jsonl", "robot.toml"].map(|name| files.path(name));
    // Each command, the input that the test tries to overwrite, the option for the output, and the extension of the
    // output.
    let table: [(Vec<&str>, &str, &str, &str); 16] = [
        (vec!["plan", "--to", "0,0,50,0,90", "--robot", &robot], &robot, "-o", "json"),
        (vec!["view", &plan], &plan, "-o", "html"),
        (vec!["view", &run], &run, "-o", "html"),
        (vec!["view", &run, "--svg"], &run, "-o", "svg"),
        (vec!["view", &run, "--plot", "heights"], &run, "-o", "svg"),
        (vec!["view", "--compare", &plan, &run], &run, "-o", "html"),
        (vec!["view", &plan, "--robot", &robot], &robot, "-o", "html"),
        (vec!["export", &plan, "--format", "stl"], &plan, "-o", "stl"),
        (vec!["export", &run, "--format", "mcap"], &run, "-o", "mcap"),
        (vec!["export", &run, "--format", "csv", "--robot", &robot], &robot, "-o", "csv"),
        (vec!["workspace", "--robot", &robot, "--length", "100"], &robot, "-o", "svg"),
        (vec!["simulate", &plan], &plan, "--samples", "csv"),
        (vec!["simulate", &plan, "--noise", "1"], &plan, "-o", "json"),
        (vec!["simulate", &plan, "--repeat", "3", "--robot", &robot], &robot, "--samples", "csv"),
        (vec!["grow", &plan], &plan, "--log", "jsonl"),
        (vec!["grow", "--to", "0,0,5,0,90", "--robot", &robot], &robot, "--log", "jsonl"),
    ];
    fs::create_dir(files.path("sub")).unwrap();
    for (index, (args, input, option, ending)) in table.iter().enumerate() {
        let before = fs::read(input).unwrap();
        let [hard, soft] = ["hard", "soft"].map(|name| files.path(&format!("{name}{index}.{ending}")));
        fs::hard_link(input, &hard).unwrap();
        symlink(input, &soft).unwrap();
        let name = input.rsplit('/').next().unwrap();
        let around = files.path(&format!("sub/../{name}"));
        for output in [(*input).to_owned(), hard, soft, around] {
            let ran = growbot(&[&args[..], &[option, &output]].concat());
            assert_eq!(ran.code, Some(2), "{args:?} {option} {output}: {}", ran.err);
            assert_eq!(fs::read(input).unwrap(), before, "{args:?} {option} {output}");
            assert_eq!(ran.err.lines().filter(|line| !line.contains("warning")).count(), 1, "{}", ran.err);
        }
        // The same file as a descriptor that the shell has opened.
        let through = command("sh")
            .args(["-c", "exec \"$0\" \"$@\" 3<\"$INPUT\"", PROGRAM])
            .args([&args[..], &[*option, "/proc/self/fd/3"]].concat())
            .env("INPUT", input)
            .stdin(Stdio::null())
            .output()
            .unwrap();
        assert_eq!(through.status.code(), Some(2), "{args:?}: {}", String::from_utf8_lossy(&through.stderr));
        assert_eq!(fs::read(input).unwrap(), before, "{args:?} through a descriptor");
    }
    // The file that must not be overwritten can also be the standard input.
    let through = command(PROGRAM)
        .args(["export", "-", "--format", "csv", "-o", &plan])
        .stdin(fs::File::open(&plan).unwrap())
        .output()
        .unwrap();
    assert_eq!(through.status.code(), Some(2), "{}", String::from_utf8_lossy(&through.stderr));
    assert!(fs::read_to_string(&plan).unwrap().starts_with('{'));
}

#[test]
fn a_wrong_extension_is_refused_with_the_list_of_formats() {
    let files = Files::new();
    let [plan, run] = ["plan.json", "run.jsonl"].map(|name| files.path(name));
    let before = fs::read_dir(files.0.path()).unwrap().count();
    for (args, option, name, listed) in [
        (vec!["view", &plan], "-o", "a.eps", ".html, .svg, .png or .pdf"),
        (vec!["view", &run], "-o", "a.xyz", ".html, .svg, .png or .pdf"),
        (vec!["view", &run, "--plot", "error"], "-o", "a.eps", ".svg, .png or .pdf"),
        (vec!["view", &plan, "--png"], "-o", "a.pdf", ".png"),
        (vec!["export", &run], "-o", "a.pdf", ".stl, .obj, .3mf, .glb, .csv, .tum or .mcap"),
        (vec!["export", &plan], "-o", "a.json", ".stl, .obj, .3mf, .glb, .csv, .tum or .mcap"),
        (vec!["export", &run, "--format", "stl"], "-o", "a.glb", ".stl"),
        (vec!["export", &run, "--format", "mcap"], "-o", "a.CSV", ".mcap"),
        (vec!["export", &plan, "--format", "csv"], "-o", "a.json", ".csv"),
        (vec!["view", &run, "--svg"], "-o", "a.png", ".svg"),
        (vec!["view", &run, "--png"], "-o", "a.html", ".png"),
        (vec!["view", &run, "--pdf"], "-o", "a.png", ".pdf"),
        (vec!["simulate", &plan], "-o", "a.ply", ".csv, .stl, .obj, .3mf, .glb, .html, .svg, .png, .pdf or .json"),
        (vec!["simulate", &plan], "--samples", "a.json", ".csv"),
        (vec!["workspace", "--length", "100"], "-o", "a.html", ".svg, .png or .pdf"),
        (vec!["plan", "--to", "0,0,50,0,90"], "-o", "a.svg", ".json"),
        (vec!["new-robot"], "-o", "a.json", ".toml"),
        (vec!["grow", "--to", "0,0,5,0,90"], "--log", "a.mcap", ".jsonl or .json"),
    ] {
        let ran = growbot(&[&args[..], &[option, &files.path(name)]].concat());
        assert_eq!((ran.code, ran.out.as_str()), (Some(2), ""), "{args:?}: {}", ran.err);
        assert!(ran.err.contains(listed) && ran.err.contains(name), "{args:?}: {}", ran.err);
    }
    assert_eq!(fs::read_dir(files.0.path()).unwrap().count(), before);
}

#[test]
fn endless_and_oversized_inputs_are_refused() {
    let files = Files::new();
    let fifo = files.path("fifo");
    assert!(command("mkfifo").arg(&fifo).status().unwrap().success());
    let huge = files.path("huge.jsonl");
    // A sparse file, longer than any log, does not fill the disk.
    fs::File::create(&huge).unwrap().set_len((256 << 20) + 1).unwrap();
    for file in [fifo.as_str(), "/dev/zero", "/dev/tty", &huge, files.0.path().to_str().unwrap()] {
        for args in [
            vec!["replay", file],
            vec!["resume", file],
            vec!["view", file, "-o", "/dev/null"],
            vec!["export", file, "--format", "csv"],
            vec!["layers", file],
            vec!["simulate", file],
            vec!["grow", file],
            vec!["rmin", "--robot", file],
            vec!["plan", "--batch", file, "--json"],
        ] {
            // A batch is a stream without a limit on its length.
            if args.contains(&"--batch") && file == huge {
                continue;
            }
            let ran = growbot(&args);
            assert_eq!(ran.code, Some(2), "{args:?}: {}", ran.err);
            assert_eq!(ran.err.lines().count(), 1, "{args:?}: {}", ran.err);
        }
    }
    let endless = "x".repeat(3 << 20);
    for args in [vec!["plan", "--batch", "-", "--json"], vec!["console"]] {
        let ran = growbot_reading(&args, &endless);
        assert!(ran.code == Some(2) && ran.err.contains("longer than 1048576 bytes"), "{args:?}: {}", ran.err);
    }
    // Files that the shell opens are read.
    let run = files.path("run.jsonl");
    let piped = command("bash")
        .args(["-c", "exec \"$0\" replay <(cat \"$RUN\") --json", PROGRAM])
        .env("RUN", &run)
        .output()
        .unwrap();
    let direct = growbot(&["replay", &run, "--json"]);
    assert_eq!(String::from_utf8_lossy(&piped.stdout), direct.out, "{}", String::from_utf8_lossy(&piped.stderr));
    assert_eq!(growbot_reading(&["replay", "-", "--json"], &fs::read_to_string(&run).unwrap()).out, direct.out);
}

/// Runs this shell script, in which `$0` is growbot. Environment variables contain the names of files.
fn in_shell(script: &str, files: &[(&str, &str)]) -> Ran {
    let ran = command("bash").args(["-c", script, PROGRAM]).envs(files.iter().copied()).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
    Ran { code: ran.status.code(), out: text(ran.stdout), err: in_lines(&text(ran.stderr)) }
}

#[test]
fn run_logs_are_viewed_and_exported_from_pipes() {
    let files = Files::new();
    let [run, plan] = ["run.jsonl", "plan.json"].map(|name| files.path(name));
    for (file, format) in [(&run, "csv"), (&run, "stl"), (&plan, "csv")] {
        let direct =
            in_shell("\"$0\" export \"$RUN\" --format $FORMAT | sha256sum", &[("RUN", file), ("FORMAT", format)]);
        for script in [
            "\"$0\" export - --format $FORMAT <\"$RUN\" | sha256sum",
            "cat \"$RUN\" | \"$0\" export - --format $FORMAT | sha256sum",
            "\"$0\" export <(cat \"$RUN\") --format $FORMAT | sha256sum",
        ] {
            let ran = in_shell(script, &[("RUN", file), ("FORMAT", format)]);
            assert_eq!((&ran.out, &ran.err), (&direct.out, &direct.err), "{script}");
        }
    }
    let page = files.path("a.html");
    for script in [
        "cat \"$RUN\" | \"$0\" view - -o \"$PAGE\"",
        "\"$0\" view - -o \"$PAGE\" <\"$RUN\"",
        "\"$0\" view <(cat \"$RUN\") -o \"$PAGE\"",
    ] {
        let ran = in_shell(script, &[("RUN", &run), ("PAGE", &page)]);
        assert_eq!(ran.code, Some(0), "{script}: {}", ran.err);
        assert!(fs::read_to_string(&page).unwrap().contains("\"built_name\":\"Laid (simulated)\""), "{script}");
        fs::remove_file(&page).unwrap();
    }
    // Input that is not a log has the size limit of a plan.
    let ran = growbot_reading(&["export", "-", "--format", "csv"], &" ".repeat((16 << 20) + 1));
    assert!(ran.code == Some(2) && ran.err.contains("longer than 16777216 bytes"), "{}", ran.err);
}

#[test]
fn standard_output_onto_an_input_is_refused_and_the_input_kept() {
    let files = Files::new();
    let [run, plan, robot, queries] =
        ["run.jsonl", "plan.json", "robot.toml", "queries.csv"].map(|name| files.path(name));
    let before: Vec<Vec<u8>> = [&run, &plan, &robot, &queries].map(|file| fs::read(file).unwrap()).into();
    for (command, input) in [
        ("export \"$IN\" -o - --format csv", &run),
        ("export \"$IN\" --format mcap", &run),
        ("export - --format stl <\"$IN\"", &run),
        ("replay \"$IN\" --layers", &run),
        ("resume \"$IN\" --yes", &run),
        ("layers \"$IN\"", &plan),
        ("simulate \"$IN\" --json", &plan),
        ("grow \"$IN\" --json", &plan),
        ("rmin --robot \"$IN\"", &robot),
        ("plan --batch \"$IN\" --json", &queries),
        ("plan --batch - --json <\"$IN\"", &queries),
        ("console <\"$IN\"", &queries),
    ] {
        for onto in [">>\"$IN\"", "1<>\"$IN\""] {
            let ran = in_shell(&format!("\"$0\" {command} {onto}"), &[("IN", input)]);
            assert_eq!(ran.code, Some(2), "{command} {onto}: {}", ran.err);
            assert!(ran.err.contains("standard output is redirected to it"), "{command} {onto}: {}", ran.err);
            let after: Vec<Vec<u8>> = [&run, &plan, &robot, &queries].map(|file| fs::read(file).unwrap()).into();
            assert!(after == before, "{command} {onto}");
        }
    }
    // A hard link is detected too. Output to another file is written.
    fs::hard_link(&run, files.path("hard")).unwrap();
    let ran =
        in_shell("\"$0\" export \"$IN\" --format csv 1<>\"$OTHER\"", &[("IN", &run), ("OTHER", &files.path("hard"))]);
    assert_eq!(ran.code, Some(2), "{}", ran.err);
    assert!(fs::read(&run).unwrap() == before[0]);
    let ran = in_shell("\"$0\" layers \"$IN\" >>\"$OUT\"", &[("IN", &plan), ("OUT", &files.path("out.csv"))]);
    assert!(ran.code == Some(0) && fs::metadata(files.path("out.csv")).unwrap().len() > 1000, "{}", ran.err);
}

#[test]
fn any_simulated_run_is_marked_as_simulated() {
    let files = Files::new();
    let log = fs::read_to_string(files.path("run.jsonl")).unwrap();
    let header = log.lines().next().unwrap();
    let end = r#"{"event":"end","result":{"outcome":"stopped"}}"#;
    let stopped = files.path("stopped.jsonl");
    fs::write(&stopped, format!("{header}\n{end}\n")).unwrap();
    let robots = files.path("robots.jsonl");
    fs::write(&robots, log.replacen("\"tip\":\"simulated\"", "\"tip\":\"robot\"", 1)).unwrap();
    let json = |file: &str| -> Value { serde_json::from_str(&growbot(&["replay", file, "--json"]).out).unwrap() };
    for (file, simulated, by) in
        [(files.path("run.jsonl"), true, "tip"), (stopped.clone(), true, "tip"), (robots.clone(), false, "steps")]
    {
        let told = json(&file);
        assert_eq!((&told["simulated"], &told["measured_by"]), (&simulated.into(), &by.into()), "{file}");
        let text = growbot(&["replay", &file]).out;
        assert_eq!(text.contains("simulated"), simulated, "{text}");
        assert_eq!(text.lines().next().unwrap().ends_with(", simulated"), simulated, "{text}");
    }
    for (file, name) in [(&stopped, "Laid (simulated)"), (&robots, "As built")] {
        assert_eq!(growbot(&["view", file, "-o", &files.path("a.html")]).code, Some(0));
        let page = fs::read_to_string(files.path("a.html")).unwrap();
        assert!(page.contains(&format!("\"built_name\":\"{name}\"")), "{file}");
        assert_eq!(growbot(&["view", file, "-o", &files.path("a.svg")]).code, Some(0));
        let picture = fs::read_to_string(files.path("a.svg")).unwrap();
        assert_eq!(picture.contains("simulated"), file == &stopped, "{file}");
    }
    for (file, says) in [(&stopped, true), (&robots, false)] {
        let ran = growbot(&["export", file, "--format", "csv"]);
        assert_eq!((ran.code, ran.err.contains("laid (simulated)")), (Some(0), says), "{}", ran.err);
        let ran = growbot(&["export", file, "-o", &files.path("a.mcap")]);
        assert_eq!((ran.code, ran.err.contains("laid (simulated)")), (Some(0), says), "{}", ran.err);
    }
    for (from, body, says) in [
        ("run", "laid", "laid (simulated)"),
        ("run", "commanded", "commanded (simulated)"),
        ("robots", "laid", "as built"),
    ] {
        let stl = files.path("a.stl");
        assert_eq!(
            growbot(&["export", &files.path(&format!("{from}.jsonl")), "--body", body, "-o", &stl]).code,
            Some(0)
        );
        let header = String::from_utf8_lossy(&fs::read(&stl).unwrap()[..80]).into_owned();
        assert!(header.contains(says), "{from}, {body}: {header}");
    }
}

#[test]
fn replay_and_page_report_a_stop_for_clock_drift() {
    let files = Files::new();
    let drift = growbot_plan::clock_drift::ClockDrift { board_ms: 28_500, host_ms: [30_000, 30_100] };
    let log = fs::read_to_string(files.path("run.jsonl")).unwrap();
    let end = serde_json::json!({ "event": "end", "result": { "outcome": "clock-drift", "clock_drift": drift } });
    let run = files.path("drift.jsonl");
    fs::write(&run, format!("{}\n{end}\n", log.lines().next().unwrap())).unwrap();
    let told: Value = serde_json::from_str(&growbot(&["replay", &run, "--json"]).out).unwrap();
    assert_eq!((&told["outcome"], &told["clock_drift"]), (&"clock-drift".into(), &serde_json::json!(drift)));
    let text = growbot(&["replay", &run]).out;
    assert!(text.contains("clock-drift") && text.contains("5.0 % slow") && text.contains("limit 2 %"), "{text}");
    assert_eq!(growbot(&["view", &run, "-o", &files.path("a.html")]).code, Some(0));
    let page = fs::read_to_string(files.path("a.html")).unwrap();
    assert!(page.contains("growth of growbot-a: clock-drift") && page.contains("5.0 % slow"));
    assert_eq!(
        serde_json::from_str::<Value>(&growbot(&["replay", &files.path("run.jsonl"), "--json"]).out).unwrap()["clock_drift"],
        Value::Null
    );
}

#[test]
fn replay_reports_a_disturbed_growth_as_laid_and_as_commanded() {
    let files = Files::new();
    let run = files.path("run.jsonl");
    let grown: Value = serde_json::from_str(&fs::read_to_string(files.path("grown.json")).unwrap()).unwrap();
    let replayed: Value = serde_json::from_str(&growbot(&["replay", &run, "--json"]).out).unwrap();
    let number = |value: &Value| value.as_f64().unwrap();
    let error = number(&grown["position_error_mm"]);
    assert!(error > 1.0, "{error}");
    assert!((number(&replayed["position_error_mm"]) - error).abs() < 1e-9, "{replayed}");
    assert_eq!((&replayed["measured_by"], &replayed["layers"]), (&grown["measured_by"], &grown["layers"]));
    assert!(number(&replayed["commanded"]["position_error_mm"]) < 0.1, "{replayed}");
    let told = growbot(&["replay", &run]).out;
    assert!(told.contains("laid (simulated)") && told.contains("commanded "), "{told}");
    // The last rows of the export are the position of the tip that replay prints.
    let reached = number(&replayed["final"]["x_mm"]);
    let last = |args: &[&str]| -> Vec<String> {
        let out = growbot(&[&["export", &run, "--format", "csv"], args].concat()).out;
        out.lines().last().unwrap().split(',').map(str::to_owned).collect()
    };
    let row = last(&[]);
    assert!((row[1].parse::<f64>().unwrap() - reached).abs() < 1e-9 && row[10] == "laid-simulated", "{row:?}");
    let commanded = number(&replayed["commanded"]["final"]["x_mm"]);
    assert!((row[11].parse::<f64>().unwrap() - commanded).abs() < 1e-9, "{row:?}");
    assert_eq!(last(&["--body", "commanded"])[1], row[11]);
    for (output, says) in [("a.html", "Laid (simulated)"), ("a.svg", "commanded")] {
        assert_eq!(growbot(&["view", &run, "-o", &files.path(output)]).code, Some(0));
        assert!(fs::read_to_string(files.path(output)).unwrap().contains(says), "{output}");
    }
    let plot = growbot(&["view", &run, "--plot", "error", "-o", &files.path("plot.svg")]);
    assert_eq!(plot.code, Some(0), "{}", plot.err);
    assert!(fs::read_to_string(files.path("plot.svg")).unwrap().contains("laid (simulated); dashed, commanded"));
    let glb = growbot(&["export", &run, "-o", &files.path("a.glb")]);
    assert_eq!(glb.code, Some(0), "{}", glb.err);
    let glb = fs::read(files.path("a.glb")).unwrap();
    let text = String::from_utf8_lossy(&glb);
    assert!(text.contains("\"laid (simulated)\"") && text.contains("\"commanded\""));
}

#[test]
fn control_characters_from_files_and_arguments_are_removed() {
    let files = Files::new();
    let hostile = "\u{1b}[31mred\u{7}\u{9b}2J\u{202e}\u{7f}";
    let log = fs::read_to_string(files.path("run.jsonl")).unwrap();
    let escaped = serde_json::to_string(hostile).unwrap();
    let outcome = log.replace("\"outcome\":\"done\"", &format!("\"outcome\":{escaped}"));
    let named = log.replace("\"robot\":\"growbot-a\"", &format!("\"robot\":{escaped}"));
    let format = log.replace("growbot-run/4", hostile.trim_matches('\u{1b}'));
    assert!([&outcome, &named].iter().all(|changed| **changed != log));
    for (name, text) in [("outcome", &outcome), ("named", &named), ("format", &format)] {
        let file = files.path(&format!("{name}.jsonl"));
        fs::write(&file, text).unwrap();
        for args in [
            vec!["replay", &file],
            vec!["replay", &file, "--json"],
            vec!["replay", &file, "--layers"],
            vec!["resume", &file, "--yes"],
            vec!["view", &file, "-o", "/dev/null"],
            vec!["export", &file, "--format", "csv"],
        ] {
            assert_plain(&growbot(&args));
        }
    }
    let plan = fs::read_to_string(files.path("plan.json")).unwrap().replace("shortest", hostile);
    fs::write(files.path("hostile.json"), plan).unwrap();
    let toml = text_of_robot().replacen("growbot-a", "growbot\\u001b[31m", 1);
    fs::write(files.path("hostile.toml"), toml).unwrap();
    let odd = files.path(&format!("odd{hostile}.json"));
    fs::write(&odd, "{").unwrap();
    for args in [
        vec!["layers", &files.path("hostile.json")],
        vec!["rmin", "--robot", &files.path("hostile.toml")],
        vec!["layers", &odd],
        vec!["view", &odd],
        vec!["plan", "--to", hostile],
        vec![hostile],
        vec!["status", "--port", hostile],
        vec!["man", hostile],
    ] {
        let ran = growbot(&args);
        assert!(ran.code == Some(2), "{args:?}");
        assert_plain(&ran);
    }
    let queries = fs::read_to_string(files.path("queries.csv")).unwrap().replace("\na,", &format!("\na{hostile},"));
    assert_plain(&growbot_reading(&["plan", "--batch", "-", "--json"], &queries));
    assert_plain(&growbot_reading(&["console"], &format!("{hostile}\nplan {hostile}\n")));
}

/// Runs `growbot grow` with a limit on the length of files, in blocks of 512 bytes. A write beyond the limit fails as
/// on a full disk. Returns the result of the command and the path of its run log.
fn grow_on_a_full_disk(files: &Files, blocks: u32, more: &str) -> (Ran, String) {
    let log = files.path(&format!("full{blocks}.jsonl"));
    let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" grow --to 0,0,120,0,90 --log \"$LOG\" {more}");
    let ran = command("sh").args(["-c", &script, PROGRAM]).env("LOG", &log).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
    (Ran { code: ran.status.code(), out: text(&ran.stdout), err: in_lines(&text(&ran.stderr)) }, log)
}

#[test]
fn a_log_failure_is_reported_at_once_and_the_result_still_printed() {
    let files = Files::new();
    // The limit allows a header and some layers.
    let (ran, log) = grow_on_a_full_disk(&files, 48, "--json");
    assert_eq!(ran.code, Some(1), "{}", ran.err);
    let result: Value = serde_json::from_str(&ran.out).unwrap();
    assert_eq!((&result["outcome"], result["layers"].as_u64()), (&Value::from("done"), Some(156)));
    let missing = result["log_lines_missing"].as_u64().unwrap();
    assert!(missing > 10, "{missing}");
    let answer: Vec<&str> = ran.err.lines().collect();
    let failed = answer.iter().position(|line| line.contains("cannot write the run log")).unwrap();
    assert!(failed + 1 < answer.len() && answer.last().unwrap().contains("the run log is incomplete"), "{answer:?}");
    let replayed = growbot(&["replay", &log, "--json"]);
    assert_eq!(replayed.code, Some(0), "{}", replayed.err);
    let replayed: Value = serde_json::from_str(&replayed.out).unwrap();
    assert!((1..156).contains(&replayed["layers"].as_u64().unwrap()), "{replayed}");
    // Without space for the header, the growth does not begin and leaves no file.
    let (ran, log) = grow_on_a_full_disk(&files, 1, "");
    assert_eq!((ran.code, ran.out.as_str()), (Some(2), ""), "{}", ran.err);
    assert!(!fs::exists(log).unwrap());
}
