//! Tests of `growbot robots`, `new-robot`, `completions` and `man`, as users and scripts run them.

use std::fs;
use std::process::Stdio;

use growbot_plan::robot_file;
use running::{PROGRAM, command, growbot, growbot_reading};
use serde_json::Value;

use crate::running;
use crate::schemas::faults;

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

/// Returns the names of the commands that `growbot --help` lists.
pub fn commands() -> Vec<String> {
    let help = growbot(&["--help"]).out;
    let listed = help.split("Usage:").nth(1).unwrap().split("\nOptions:").next().unwrap();
    let names = listed.lines().filter_map(|line| line.strip_prefix("  ")).filter(|line| !line.starts_with(' '));
    names.map(|line| line.split(' ').next().unwrap().to_owned()).filter(|name| name != "help").collect()
}

/// `growbot new-robot` warns of properties of the robot that are important but easy to overlook in the robot file.
#[test]
fn new_robot_reports_a_test_bench_or_excess_speed() {
    let folder = tempfile::tempdir().unwrap();
    let bench = folder.path().join("bench.toml");
    let text = include_str!("../../robots/growbot-a.toml").replacen(
        "planning_radius_mm",
        "test_bench = true\nplanning_radius_mm",
        1,
    );
    fs::write(&bench, text).unwrap();
    for (base, says) in [
        (bench.to_str().unwrap(), Some("heats although a debug probe is attached")),
        ("growbot-c", Some("no board can drive it: motion.tick_hz is 1000000, above 100000")),
        ("growbot-b", None),
    ] {
        let output = folder.path().join("new.toml");
        let ran = command(PROGRAM)
            .args(["new-robot", "--overwrite", "--base", base, "-o"])
            .arg(&output)
            .stdin(Stdio::null())
            .output()
            .unwrap();
        let out = String::from_utf8(ran.stdout).unwrap();
        assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
        match says {
            Some(words) => assert!(out.contains(words), "{out}"),
            None => assert!(!out.contains("test_bench") && !out.contains("no board"), "{out}"),
        }
    }
    let ran = command(PROGRAM).arg("robots").arg(&bench).output().unwrap();
    let out = String::from_utf8(ran.stdout).unwrap();
    let row = out.lines().find(|line| line.contains("test_bench")).unwrap_or_else(|| panic!("{out}"));
    assert!(row.contains("true"), "{row}");
}

#[test]
fn robots_lists_all_with_figures_and_sources() {
    let table = growbot(&["robots"]).out;
    assert!(table.lines().all(|line| line.chars().count() <= 80), "{table}");
    for name in robot_file::names() {
        assert!(table.lines().any(|line| line.split(' ').next() == Some(name)), "{name}");
    }
    assert!(table.contains("growbot-a        98.20           100      0.774         18         154.8\n"), "{table}");
    assert_eq!(table.matches("et al. 201").count(), 13, "{table}");
    let list = json(&growbot(&["robots", "--json"]).out);
    assert_eq!(list.as_array().unwrap().len(), robot_file::names().count());
    assert_eq!(list[0]["growth_mm_per_h"].as_f64().unwrap().round(), 155.0);
}

#[test]
fn robots_lists_the_pins_of_a_given_board() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("mine.toml");
    let text = include_str!("../../robots/examples/skr-pico.toml");
    fs::write(&file, text.replace("[geometry]", "[board.pins]\nfan = 18\n\n[geometry]")).unwrap();
    let ran = growbot(&["robots", file.to_str().unwrap()]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    for part in [
        "\nskr-pico, signal by signal:\n  head_step         pin 11, XM\n",
        "\n  heater            pin 23, HE\n  heater_enable     pin 21, HB\n  fan               pin 18\n",
    ] {
        assert!(ran.out.contains(part), "no {part:?} in {}", ran.out);
    }
    assert!(!ran.out.contains("  driver_fault  "), "the robot has none: {}", ran.out);
    assert!(!growbot(&["robots", "growbot-a"]).out.contains("signal by signal"), "it names no board");
}

#[test]
fn robots_explains_a_robot() {
    let words = growbot(&["robots", "growbot-b"]).out;
    assert!(words.lines().all(|line| line.chars().count() <= 80), "{words}");
    for part in [
        "R_min, the radius of the tightest bend, is 594.11 mm",
        "[heater] The nozzle's heater.",
        "  tip_radius_mm = 57.5 # r_t, Table 3\n      r_t: distance from the centreline to where material is laid, mm.",
        "  height_min_mm = 25.0 # assumed\n",
        "standby_c = 150.0 (not in the file)",
        "acceleration_mm_per_s2 = no limit (not in the file)",
        "values are assumed",
    ] {
        assert!(words.contains(part), "no {part:?} in {words}");
    }
    let robot = json(&growbot(&["robots", "growbot-b", "--json"]).out);
    let fields = robot["fields"].as_array().unwrap();
    let field = fields.iter().find(|field| field["field"] == "layer.height_min_mm").unwrap();
    assert_eq!((field["value"].as_str(), field["assumed"].as_bool()), (Some("25.0"), Some(true)));

    let unknown = growbot(&["robots", "growbot_b"]);
    assert_eq!((unknown.code, unknown.out.as_str()), (Some(2), ""));
    assert!(unknown.err.contains("did you mean growbot-b?"), "{}", unknown.err);
}

#[test]
fn built_in_robots_match_the_schema_and_errors_do_not() {
    let schema = json(&growbot(&["robots", "--schema"]).out);
    let faults_of =
        |text: &str| faults(&schema, &serde_json::to_value(text.parse::<toml::Table>().unwrap()).unwrap(), "");
    for name in robot_file::names() {
        let (text, _) = robot_file::text_of(name.as_ref()).unwrap();
        assert_eq!(faults_of(&text), [""; 0], "{name}");
    }
    let (good, _) = robot_file::text_of("growbot-a".as_ref()).unwrap();
    for (from, to) in [
        ("height_min_mm", "heigth_min_mm"),
        ("tip_radius_mm = 22.0", "tip_radius_mm = -22.0"),
        ("strategy = \"feed\"", "strategy = \"fead\""),
        ("tick_hz = 4000", "tick_hz = 4000.5"),
        ("max_c = 240.0", "max_c = 2400.0"),
        ("name = \"growbot-a\"", "name = \"Growbot A\""),
        ("[wall]\nwidth_mm = 1.6", "[wall]"),
    ] {
        assert!(good.contains(from));
        assert!(!faults_of(&good.replace(from, to)).is_empty(), "{to}");
    }
    let steinhart =
        good.replace("r25_ohm = 100000.0", "steinhart_hart = [1e-3, 2e-4, 1e-7]").replace("beta_k = 3950.0", "");
    assert!(robot_file::parse(&steinhart, "steinhart").is_ok());
    assert_eq!(faults_of(&steinhart), [""; 0]);
}

#[test]
fn new_robot_writes_a_file_from_answers_in_a_pipe() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("mine.toml");
    let file = path.to_str().unwrap();
    let ran = growbot_reading(&["new-robot", "-o", file], "my-robot\n14\n60\n25\n\n");
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    assert!(
        ran.err.contains("geometry.tip_radius_mm [22.0]:") && ran.err.contains("standard input ends here"),
        "{}",
        ran.err
    );
    assert!(ran.out.contains("R_min     144.14 mm") && ran.out.contains("Measure next"), "{}", ran.out);
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains("tip_radius_mm = 25.0 # given; growbot-a has 22.0, r_t\n"), "{text}");
    assert!(text.contains("planning_radius_mm = 145.0 # adapted; R_min is 144.14\n"), "{text}");
    assert!(text.contains("height_min_mm = 0.3     # assumed\n"), "{text}");
    assert!(growbot(&["rmin", "--robot", file]).out.starts_with("my-robot: R_min is 144.14 mm"));

    let again = growbot_reading(&["new-robot", "-o", file], "");
    assert_eq!((again.code, again.out.as_str()), (Some(2), ""));
    assert!(again.err.contains("--overwrite"), "{}", again.err);
    assert_eq!(fs::read_to_string(&path).unwrap(), text);
    assert_eq!(growbot_reading(&["new-robot", "-o", file, "--overwrite", "--base", "growbot-b"], "").code, Some(0));
    assert!(fs::read_to_string(&path).unwrap().contains("name = \"mine\""));
    assert!(growbot(&["rmin", "--robot", file]).out.starts_with("mine: R_min is 594.11 mm"));
}

#[test]
fn an_invalid_answer_leaves_no_file() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("mine.toml");
    for (answers, part) in [
        ("mine\n14\n60\n10\n", "geometry.tip_radius_mm is 10, below 14"),
        ("mine\nfourteen\n", "expected a number"),
        ("growbot-a\n", "growbot-a is the name of a built-in robot"),
        ("mine\n1e400\n", "finite"),
    ] {
        let ran = growbot_reading(&["new-robot", "-o", path.to_str().unwrap()], answers);
        assert_eq!((ran.code, ran.out.as_str()), (Some(2), ""), "{}", ran.err);
        let last = ran.err.lines().last().unwrap();
        assert!(last.starts_with("error: ") && last.contains(part), "{}", ran.err);
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 0);
    }
    let nowhere = directory.path().join("none").join("mine.toml");
    let ran = growbot_reading(&["new-robot", "-o", nowhere.to_str().unwrap()], "");
    assert_eq!(ran.code, Some(2));
    assert!(ran.err.contains("does not exist"), "{}", ran.err);
}

#[test]
fn each_command_has_a_man_page_with_examples_and_exit_codes() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().to_str().unwrap();
    assert_eq!(growbot(&["man", "-o", path]).code, Some(0));
    let mut pages: Vec<String> = commands().iter().map(|command| format!("growbot-{command}.1")).collect();
    pages.push("growbot.1".to_owned());
    assert!(pages.len() > 20, "{pages:?}");
    for page in &pages {
        let text = fs::read_to_string(directory.path().join(page)).unwrap_or_else(|error| panic!("{page}: {error}"));
        for section in ["NAME", "SYNOPSIS", "DESCRIPTION", "OPTIONS", "EXAMPLES", "EXIT STATUS"] {
            assert!(text.lines().any(|line| line.replace('"', "") == format!(".SH {section}")), "{page}: {section}");
        }
    }
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), pages.len());
    assert_eq!(growbot(&["man", "plan"]).out, fs::read_to_string(directory.path().join("growbot-plan.1")).unwrap());
    assert!(growbot(&["man", "estop"]).out.contains("for any reason: cut its power"));

    let unknown = growbot(&["man", "plam"]);
    assert_eq!(unknown.code, Some(2));
    assert!(unknown.err.contains("did you mean plan?"), "{}", unknown.err);
    assert_eq!(growbot(&["man", "-o", &format!("{path}/none/deeper")]).code, Some(2));
}

/// Returns the completions of bash for the last of these words of a command line, with this completion script.
fn completed(script: &str, words: &[&str]) -> Vec<String> {
    let (last, before) = (words[words.len() - 1], words[words.len() - 2]);
    let line = format!(
        "source {script}; COMP_WORDS=({}); COMP_CWORD={}; _growbot growbot '{last}' '{before}'; echo \"${{COMPREPLY[@]}}\"",
        words.join(" "),
        words.len() - 1,
    );
    let output = command("bash").args(["--norc", "-c", &line]).output().unwrap();
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap().split_whitespace().map(str::to_owned).collect()
}

#[cfg(unix)]
#[test]
fn bash_completes_commands_and_robot_names() {
    let directory = tempfile::tempdir().unwrap();
    let script = directory.path().join("growbot.bash");
    fs::write(&script, growbot(&["completions", "bash"]).out).unwrap();
    let script = script.to_str().unwrap();
    assert_eq!(completed(script, &["growbot", "pl"]), ["plan"]);
    assert_eq!(completed(script, &["growbot", "new"]), ["new-robot"]);
    assert_eq!(completed(script, &["growbot", "robots", "growbot-b"]), ["growbot-b"]);
    let names: Vec<&str> = robot_file::names().collect();
    for command in ["plan", "grow", "layers", "resume", "rmin", "status"] {
        assert_eq!(completed(script, &["growbot", command, "--robot", "grow"]), names, "{command}");
    }
    assert_eq!(completed(script, &["growbot", "new-robot", "--base", "growbot-c"]), ["growbot-c"]);
    // Bash itself continues with files.
    assert!(completed(script, &["growbot", "rmin", "--robot", "my"]).is_empty());
}

#[test]
fn every_shell_has_completions_with_all_commands() {
    let commands = commands();
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let script = growbot(&["completions", shell]).out;
        for command in &commands {
            assert!(script.contains(command.as_str()), "{shell}: {command}");
        }
        // The generators for the other two shells do not support values of options.
        let values = ["bash", "zsh", "fish"].contains(&shell);
        assert_eq!(script.contains("growbot-a8"), values, "{shell}");
    }
    assert_eq!(growbot(&["completions", "tcsh"]).code, Some(2));
}

#[test]
fn answers_can_be_undone_and_sections_skipped() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("robot.toml");
    let file = path.to_str().unwrap();
    // Goes back to change the inner radius after the length, then skips the rest of geometry.
    let ran = growbot_reading(&["new-robot", "-o", file], "ours\n14\n60\nback\nback\n13\nskip\n2.0\n");
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    let robot = robot_file::load(&path).unwrap();
    let description = robot.description();
    assert_eq!((robot.name(), description.geometry.inner_radius_mm, description.wall.width_mm), ("ours", 13.0, 2.0));
    let base = robot_file::load("growbot-a".as_ref()).unwrap();
    assert_eq!(description.geometry.inner_length_mm, base.description().geometry.inner_length_mm);
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.lines().filter(|line| line.contains("# given")).count() == 2, "{text}");
    assert!(ran.err.matches("geometry.inner_radius_mm").count() == 2, "{}", ran.err);
    assert_eq!(ran.err.matches("geometry.tip_radius_mm [").count(), 1, "{}", ran.err);
    // `back` has no effect at the first question.
    let ran = growbot_reading(&["new-robot", "-o", file, "--overwrite"], "back\nours\n");
    assert!(ran.code == Some(0) && ran.err.contains("the first question"), "{}", ran.err);
}
