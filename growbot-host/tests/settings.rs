//! Tests of the robot and the port of commands without the options `--robot` and `--port`: from the environment, from
//! growbot.toml, and from plans that contain their robot.

use crate::running;

use std::fs;
use std::path::PathBuf;

use running::{PROGRAM, Ran, command, in_lines};
use serde_json::Value;
use tempfile::TempDir;

/// Directories for settings: `lab/project/deep`, in which commands run, and `conf`, the user's configuration.
struct Place {
    root: TempDir,
    environment: Vec<(&'static str, String)>,
}

impl Place {
    fn new() -> Self {
        let root = tempfile::tempdir().unwrap();
        for directory in ["lab/project/deep", "conf/growbot"] {
            fs::create_dir_all(root.path().join(directory)).unwrap();
        }
        Self { root, environment: Vec::new() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.root.path().canonicalize().unwrap().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    fn run(&self, args: &[&str]) -> Ran {
        let output = command(PROGRAM)
            .args(args)
            .current_dir(self.path("lab/project/deep"))
            .env("XDG_CONFIG_HOME", self.path("conf"))
            .envs(self.environment.iter().map(|(name, value)| (*name, value)))
            .output()
            .unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        Ran { code: output.status.code(), out: text(output.stdout), err: in_lines(&text(output.stderr)) }
    }

    fn config(&self) -> Value {
        let ran = self.run(&["settings", "--json"]);
        assert_eq!(ran.code, Some(0), "{}", ran.err);
        serde_json::from_str(&ran.out).unwrap()
    }

    /// Returns the name of the robot that a command without `--robot` uses.
    fn robot(&self) -> String {
        let ran = self.run(&["rmin", "--json"]);
        assert_eq!(ran.code, Some(0), "{}", ran.err);
        serde_json::from_str::<Value>(&ran.out).unwrap()["robot"].as_str().unwrap().to_owned()
    }
}

/// Returns the text of a robot file with a name that no built-in robot has.
fn own_robot() -> String {
    include_str!("../../robots/growbot-a.toml").replacen("\"growbot-a\"", "\"ours\"", 1)
}

#[test]
fn options_override_the_environment_and_then_the_nearest_file() {
    let mut place = Place::new();
    let is = |place: &Place, robot: &str, origin: &str| {
        assert_eq!((place.robot().as_str(), place.config()["robot"]["origin"].as_str()), (robot, Some(origin)));
    };
    is(&place, "growbot-a", "built-in");
    place.write("conf/growbot/growbot.toml", "robot = \"growbot-a1\"\nport = \"tcp:localhost:1\"\n");
    is(&place, "growbot-a1", "user");
    place.write("lab/growbot.toml", "robot = \"growbot-a2\"\n");
    is(&place, "growbot-a2", "nearest");
    // A setting that the nearest file lacks comes from the user's file.
    assert_eq!(place.config()["port"]["value"], "tcp:localhost:1");
    place.write("lab/project/growbot.toml", "robot = \"growbot-a3\"\nport = \"sim\"\n");
    is(&place, "growbot-a3", "nearest");
    assert_eq!(place.config()["port"]["value"], "sim");
    assert_eq!(place.config()["robot"]["file"], place.path("lab/project/growbot.toml").to_str().unwrap());
    place.environment = vec![("GROWBOT_ROBOT", "growbot-b".to_owned()), ("GROWBOT_PORT", "emulator".to_owned())];
    is(&place, "growbot-b", "environment");
    assert_eq!(place.config()["port"]["variable"], "GROWBOT_PORT");
    assert!(place.run(&["rmin", "--robot", "growbot-c"]).out.starts_with("growbot-c"));
    // An empty variable counts as not set.
    place.environment = vec![("GROWBOT_ROBOT", String::new()), ("GROWBOT_PORT", String::new())];
    is(&place, "growbot-a3", "nearest");
    let text = place.run(&["settings"]).out;
    assert!(text.contains("growbot-a3") && text.contains("project/growbot.toml"), "{text}");
}

#[test]
fn a_port_from_a_file_is_used_also_by_safety_commands() {
    let place = Place::new();
    let refused = place.run(&["status"]);
    assert!(refused.code == Some(2) && refused.err.contains("growbot.toml"), "{}", refused.err);
    place.write("lab/growbot.toml", "port = \"sim\"\n");
    let status = place.run(&["status"]);
    assert!(status.code == Some(0) && status.out.contains("simulated"), "{}{}", status.out, status.err);
    place.write("lab/growbot.toml", "port = \"tcp:127.0.0.1:1\"\n");
    let grown = place.run(&["grow", "--to", "0,0,5,0,90"]);
    assert!(grown.code == Some(2) && grown.err.contains("127.0.0.1:1"), "{}", grown.err);
    // `growbot` without a command shows a simulated robot, regardless of the settings.
    place.write("lab/growbot.toml", "port = \"tcp:127.0.0.1:1\"\nrobot = \"growbot-c\"\n");
    let alone = place.run(&[]);
    assert!(alone.code == Some(0) && alone.out.contains("simulated growbot-a"), "{}{}", alone.out, alone.err);
}

#[test]
fn paths_are_relative_to_their_file() {
    let place = Place::new();
    place.write("lab/ours.toml", &own_robot());
    place.write("lab/growbot.toml", "robot = \"ours.toml\"\n");
    assert_eq!(place.robot(), "ours");
    assert_eq!(place.config()["robot"]["value"], place.path("lab/ours.toml").to_str().unwrap());
}

#[test]
fn settings_errors_are_reported_and_affect_only_commands_with_settings() {
    let place = Place::new();
    for (text, parts) in [
        ("robbot = \"growbot-a\"\n", &["line 1", "unknown field", "did you mean robot?"][..]),
        ("port = 3\n", &["line 1", "string"]),
        ("robot = \"\"\n", &["robot is empty"]),
        ("robot = [\n", &["line"]),
    ] {
        place.write("lab/growbot.toml", text);
        for args in [&["settings"][..], &["rmin"], &["status"], &["console"]] {
            let ran = place.run(args);
            assert_eq!(ran.code, Some(2), "{args:?}: {}", ran.err);
            assert!(
                ran.err.contains("growbot.toml") && parts.iter().all(|part| ran.err.contains(part)),
                "{args:?}: {}",
                ran.err
            );
        }
        // The emergency stop of a named robot does not need a valid file. No robot runs here.
        let ran = place.run(&["estop", "--port", "sim", "--robot", "growbot-a"]);
        assert!(ran.code == Some(1) && ran.err.contains("no robot runs at sim"), "{}", ran.err);
        assert_eq!(place.run(&["rmin", "--robot", "growbot-a"]).code, Some(0));
        assert_eq!(place.run(&["estop"]).code, Some(1));
    }
}

#[test]
fn unknown_keys_are_refused_with_the_known_ones() {
    let place = Place::new();
    for (text, expected) in [
        (
            "baud = 9600\n",
            "unknown field `baud`, expected one of `robot`, `port`, `robots`, `serve`: remove or rename it",
        ),
        ("robot = \"growbot-a\"\nports = \"sim\"\n", "line 2, column 1: unknown field `ports`"),
        (
            "[serve.notice]\nwebhook = \"https://example.org\"\n",
            "unknown field `notice`, expected one of `port`, `request_s`",
        ),
        ("[robots.lab]\nport = \"sim\"\nspeed = 2\n", "unknown field `speed`, expected one of `port`, `robot`, `pace`"),
    ] {
        place.write("lab/growbot.toml", text);
        let ran = place.run(&["rmin"]);
        assert_eq!((ran.code, ran.out.as_str()), (Some(2), ""), "{}", ran.err);
        assert!(ran.err.contains("growbot.toml, line") && ran.err.contains(expected), "{}", ran.err);
        assert_eq!(ran.err.lines().count(), 1, "{}", ran.err);
    }
}

#[test]
fn unknown_variables_are_refused_but_do_not_prevent_a_stop() {
    let mut place = Place::new();
    place.environment = vec![("GROWBOT_PROT", "/dev/ttyNONE7".to_owned())];
    let refusal = "unknown environment variable \"GROWBOT_PROT\" (did you mean GROWBOT_PORT?): unset it, or rename it; \
                   growbot reads GROWBOT_ROBOT, GROWBOT_PORT, GROWBOT_EMULATOR_TIME";
    for args in [&["rmin"][..], &["status", "--port", "sim"], &[]] {
        let ran = place.run(args);
        assert_eq!((ran.code, ran.out.as_str()), (Some(2), ""), "{args:?}: {}", ran.err);
        assert!(ran.err.contains(refusal), "{args:?}: {}", ran.err);
    }
    for command in ["stop", "estop"] {
        let ran = place.run(&[command, "--port", "sim"]);
        let is_tried = ran.code == Some(1) && ran.err.contains("no robot runs at sim");
        assert!(is_tried && ran.err.contains(refusal), "{command}: {}", ran.err);
    }
    // A command of a notification calls growbot with these variables. Empty variables count as not set.
    place.environment = vec![
        ("GROWBOT_NOTIFICATION_EVENT", "done".to_owned()),
        ("GROWBOT_NOTIFICATION_ROBOT", "lab".to_owned()),
        ("GROWBOT_NOTIFICATION_MESSAGE", "done".to_owned()),
        ("GROWBOT_PROT", String::new()),
    ];
    assert_eq!(place.robot(), "growbot-a");
}

#[test]
fn a_plan_embeds_its_robot_and_another_one_is_refused() {
    let place = Place::new();
    place.write("lab/project/deep/ours.toml", &own_robot());
    let planned = place.run(&["plan", "--to", "200,0,200,0,0", "--robot", "ours.toml", "-o", "plan.json"]);
    assert_eq!(planned.code, Some(0), "{}", planned.err);
    let described = fs::read_to_string(place.path("lab/project/deep/plan.json")).unwrap();
    let written: Value = serde_json::from_str(&described).unwrap();
    assert_eq!(written["robot_description"]["name"], "ours");
    fs::remove_file(place.path("lab/project/deep/ours.toml")).unwrap();
    // The setting is for commands without a plan, so it does not apply here.
    place.write("lab/growbot.toml", "robot = \"growbot-b\"\n");
    assert_eq!(place.run(&["grow", "plan.json", "--log", "run.jsonl"]).code, Some(0));
    for args in [
        &["layers", "plan.json"][..],
        &["simulate", "plan.json"],
        &["view", "plan.json", "-o", "-"],
        &["export", "plan.json", "--format", "csv"],
        &["grow", "plan.json"],
        &["replay", "run.jsonl"],
        &["view", "run.jsonl", "-o", "-"],
        &["export", "run.jsonl", "--format", "mcap"],
    ] {
        let ran = command(PROGRAM).args(args).current_dir(place.path("lab/project/deep")).output().unwrap();
        assert!(ran.status.success(), "{args:?}: {}", String::from_utf8_lossy(&ran.stderr));
    }
    let resumed = place.run(&["resume", "run.jsonl", "--port", "sim", "--yes"]);
    assert_eq!(resumed.code, Some(1), "{}", resumed.err);
    // The hash is checked against a given robot, and against the description in the plan.
    for (name, args, part) in [
        ("plan.json", &["--robot", "growbot-b"][..], "is for robot \"ours\""),
        ("other.json", &[], "the robot description has changed"),
        ("broken.json", &[], "robot_description"),
    ] {
        for (name, period_s) in [("other.json", 17.0), ("broken.json", -1.0)] {
            let mut plan = written.clone();
            plan["robot_description"]["layer"]["period_s"] = period_s.into();
            place.write(&format!("lab/project/deep/{name}"), &plan.to_string());
        }
        let ran = place.run(&[&["layers", name], args].concat());
        assert!(ran.code == Some(2) && ran.err.contains(part), "{name}: {}", ran.err);
    }
    // An older plan without a robot description.
    let mut older = written;
    older.as_object_mut().unwrap().remove("robot_description");
    place.write("lab/project/deep/older.json", &older.to_string());
    let ran = place.run(&["layers", "older.json"]);
    assert!(ran.code == Some(2) && ran.err.contains("--robot"), "{}", ran.err);
}
