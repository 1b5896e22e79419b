//! Tests of `growbot grow`, `status` and `stop`, as a user runs them: on a simulated robot, over TCP and over a serial
//! line.

use crate::fake_board;
use crate::lab;
use crate::running;

use serde_json::Value;

use fake_board::FakeBoard;
use lab::wait_for;
use running::{PROGRAM, Ran, command, growbot, growbot_reading, growbot_unread};

fn json(ran: &Ran) -> Value {
    serde_json::from_str(ran.out.lines().last().unwrap_or_default())
        .unwrap_or_else(|error| panic!("{error}: {:?}, {:?}", ran.out, ran.err))
}

fn number(value: &Value, field: &str) -> f64 {
    value[field].as_f64().unwrap_or_else(|| panic!("no {field} in {value}"))
}

/// Checks that the command ended with exit code 2 and printed one message of one line that contains `parts`.
fn assert_refused(ran: &Ran, parts: &[&str]) {
    assert_eq!(ran.code, Some(2), "{}", ran.err);
    for part in parts {
        assert!(ran.err.contains(part), "{part:?} is not in {:?}", ran.err);
    }
    assert!(ran.out.is_empty(), "{}", ran.out);
    assert!(!ran.err.contains("panicked"));
}

#[test]
fn the_main_job_grows_one_metre_to_its_pose() {
    let ran = growbot(&[]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    for part in ["target", "final", "error", "body", "growth", "filament", " mm"] {
        assert!(ran.out.contains(part), "no {part}: {}", ran.out);
    }
    assert!(ran.out.lines().all(|line| line.len() <= 80), "{}", ran.out);
}

#[test]
fn a_growth_reports_the_body_built_by_the_steps() {
    let ran = growbot(&["grow", "--to", "550,345,610,120,-25", "--planner", "two-plane", "--json"]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    let result = json(&ran);
    assert_eq!(result["outcome"], "done");
    assert!(number(&result, "layers") >= 1300.0);
    assert!((number(&result, "length_mm") - 1006.4).abs() < 0.1, "{result}");
    assert!(number(&result, "position_error_mm") <= 0.0005 * number(&result, "length_mm"), "{result}");
    assert!(number(&result, "normalized_position_error") <= 0.0005, "{result}");
    assert!(number(&result, "direction_error_deg") <= 0.1, "{result}");
    assert!((number(&result["final"], "x_mm") - 550.0).abs() < 0.5);
    // 18 s a layer by the board's clock.
    assert!((number(&result, "duration_s") / (18.0 * number(&result, "layers")) - 1.0).abs() < 0.001);
}

#[test]
fn both_feed_strategies_reach_the_goal() {
    let directory = tempfile::tempdir().unwrap();
    let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../robots/growbot-a.toml")).unwrap();
    let file = directory.path().join("by-speed.toml");
    std::fs::write(&file, text.replace("strategy = \"feed\"", "strategy = \"speed\"")).unwrap();
    let ran = growbot(&["grow", "--robot", file.to_str().unwrap(), "--to", "300,200,500,30,10", "--json"]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    assert!(number(&json(&ran), "normalized_position_error") <= 0.0005, "{}", ran.out);
}

#[test]
fn a_plan_from_a_file_is_grown_and_logged() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let (plan, log) = (path("plan.json"), path("run.jsonl"));
    assert_eq!(growbot(&["plan", "--to", "0,0,38.7,0,90", "-o", &plan]).code, Some(0));
    let ran = growbot(&["grow", &plan, "--log", &log, "--json"]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    assert_eq!(number(&json(&ran), "layers"), 50.0);

    let lines: Vec<Value> =
        std::fs::read_to_string(&log).unwrap().lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines[0]["format"], "growbot-run/4");
    assert_eq!(lines[0]["plan"]["robot"], "growbot-a");
    assert_eq!(lines.iter().filter(|line| line["event"] == "laid").count(), 50);
    assert_eq!(lines.last().unwrap()["result"]["outcome"], "done");

    // The log of a body is never overwritten without `--overwrite`.
    assert_refused(&growbot(&["grow", &plan, "--log", &log]), &["run log", "--log"]);
}

#[test]
fn a_body_of_zero_length_is_done_at_once() {
    let ran = growbot(&["grow", "--to", "0,0,0,0,90", "--json"]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    assert_eq!(number(&json(&ran), "normalized_position_error"), 0.0);
}

#[test]
fn invalid_growths_are_refused_before_any_start() {
    assert_refused(&growbot(&["grow"]), &["--to"]);
    assert_refused(&growbot(&["grow", "plan.json", "--to", "0,0,100,0,90"]), &["cannot be used with"]);
    assert_refused(&growbot(&["grow", "missing.json"]), &["missing.json"]);
    assert_refused(&growbot(&["grow", "--to", "0,0,100,0,90", "--radius", "50"]), &["50", "98.2"]);
    assert_refused(&growbot(&["grow", "--to", "0,0,100,0,90", "--log", "/nowhere/run.jsonl"]), &["/nowhere/run.jsonl"]);
}

#[test]
fn each_flag_overrides_one_refusal_and_no_other() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let (warns, plain, near, old) = (path("warns.json"), path("plain.json"), path("near.toml"), path("old.jsonl"));
    let plan = growbot(&["plan", "--to", "0,0,60,0,90", "--json"]).out;
    let warning = r#""warnings":[{"code":"self-collision","message":"it meets itself","value":31.0,"limit":47.1}]"#;
    std::fs::write(&plain, &plan).unwrap();
    std::fs::write(&warns, plan.replace(r#""warnings":[]"#, warning)).unwrap();
    std::fs::write(&near, "format = \"growbot-scene/1\"\n[[ball]]\ncenter_mm = [0, 0, 90]\nradius_mm = 40\n").unwrap();
    std::fs::write(&old, "").unwrap();
    let new = path("new.jsonl");
    for (arguments, flag, refusal) in [
        (vec!["grow", &warns, "--log", &new], "--force", "self-collision"),
        (vec!["grow", &plain, "--scene", &near, "--log", &new], "--ignore-scene", "into the ball"),
        (vec!["grow", &plain, "--log", &old], "--overwrite", "already exists"),
    ] {
        let others: Vec<_> =
            ["--force", "--ignore-scene", "--overwrite"].into_iter().filter(|other| *other != flag).collect();
        let ran = growbot(&[&arguments[..], &others].concat());
        assert!(matches!(ran.code, Some(1 | 2)) && ran.err.contains(refusal) && ran.err.contains(flag), "{}", ran.err);
        let ran = growbot(&[&arguments[..], &[flag]].concat());
        assert_eq!(ran.code, Some(0), "{}", ran.err);
        let log = std::fs::read_to_string(if flag == "--overwrite" { &old } else { &new }).unwrap();
        let header: Value = serde_json::from_str(log.lines().next().unwrap()).unwrap();
        let ignores = flag == "--ignore-scene";
        assert_eq!((header["ignore_scene"].as_bool(), ran.err.contains("--ignore-scene")), (Some(ignores), ignores));
        std::fs::remove_file(&new).unwrap_or_default();
    }
}

#[test]
fn a_plan_with_a_collision_warning_needs_force() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("plan.json");
    let file = file.to_str().unwrap();
    let plan = growbot(&["plan", "--to", "0,0,7.74,0,90", "--json"]).out;
    let warning = r#""warnings":[{"code":"self-collision","message":"it meets itself","value":31.0,"limit":47.1}]"#;
    std::fs::write(file, plan.replace(r#""warnings":[]"#, warning)).unwrap();
    let ran = growbot(&["grow", file, "--json"]);
    assert_eq!((ran.code, json(&ran)["outcome"].as_str()), (Some(1), Some("refused")), "{}", ran.err);
    assert!(ran.err.contains("self-collision") && ran.err.contains("--force"), "{}", ran.err);
    assert_eq!(growbot(&["grow", file, "--force"]).code, Some(0));
}

#[test]
fn a_write_error_on_standard_error_does_not_end_a_growth() {
    let ran = command(PROGRAM)
        .args(["grow", "--to", "0,0,7.74,0,90", "--json"])
        .stderr(std::fs::File::create("/dev/full").unwrap())
        .output()
        .unwrap();
    assert_eq!(ran.status.code(), Some(0));
    assert!(String::from_utf8(ran.stdout).unwrap().contains("\"outcome\":\"done\""));
}

#[test]
fn a_closed_standard_output_does_not_change_the_outcome() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let log = path("run.jsonl");
    for more in [&["--json", "--log", &log][..], &[]] {
        let done = growbot_unread(&[&["grow", "--to", "0,0,7.74,0,90"], more].concat(), "");
        assert_eq!(done.code, Some(0), "{}", done.err);
    }
    let lines = std::fs::read_to_string(&log).unwrap();
    assert!(lines.lines().last().unwrap().contains("\"outcome\":\"done\""), "{lines}");

    let plan = growbot(&["plan", "--to", "0,0,7.74,0,90", "--json"]).out;
    let warning = r#""warnings":[{"code":"self-collision","message":"it meets itself","value":31.0,"limit":47.1}]"#;
    std::fs::write(path("plan.json"), plan.replace(r#""warnings":[]"#, warning)).unwrap();
    let refused = growbot_unread(&["grow", &path("plan.json"), "--json"], "");
    assert_eq!(refused.code, Some(1), "{}", refused.err);
    assert!(refused.err.contains("not grown because of self-collision"), "{}", refused.err);

    let board = FakeBoard::simulated("growbot-b");
    let other = growbot_unread(&["grow", "--to", "0,0,100,0,90", "--port", &board.port(), "--json"], "");
    assert_eq!(other.code, Some(2), "{}", other.err);
    assert!(other.err.contains("growbot-b"), "{}", other.err);

    let tuned = growbot_unread(&["tune", "--port", "sim", "--json"], "");
    assert_eq!(tuned.code, Some(0), "{}", tuned.err);
}

#[test]
fn the_log_of_a_job_that_did_not_begin_is_deleted() {
    let directory = tempfile::tempdir().unwrap();
    let log = directory.path().join("run.jsonl");
    let board = FakeBoard::simulated("growbot-b");
    let args = ["grow", "--to", "0,0,100,0,90", "--port", &board.port(), "--log", log.to_str().unwrap()];
    assert_refused(&growbot(&args), &["growbot-b"]);
    assert!(!log.exists());
}

#[test]
fn missing_ports_are_reported() {
    let status = |port: &str| growbot(&["status", "--port", port]);
    assert_refused(&status("simulator"), &["simulator", "emulator", "tcp:HOST:PORT"]);
    assert_refused(&status("/dev/ttyNONE7"), &["/dev/ttyNONE7", "not found"]);
    assert_refused(&status("emulator:/no/such.elf"), &["/no/such.elf", "build-an386"]);
    assert_refused(
        &status("emulator:/etc/passwd"),
        &["qemu-system-arm ended while the board was running: ", "qemu", "build-an386"],
    );
    // A port that was free just before.
    let free = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    assert_refused(&status(&format!("tcp:127.0.0.1:{free}")), &["no response at"]);
}

#[test]
fn link_faults_are_set_by_option() {
    let status = |spec: &str| growbot(&["status", "--port", "sim", "--link-fault", spec]);
    assert_refused(&status("drop=200%"), &["--link-fault", "\"200%\"", "0% to 100%"]);
    assert_refused(&status("dorp=1%"), &["did you mean drop?"]);
    assert_refused(&status("drop=100%"), &["has not responded"]);
    let doubled = status("dup=100%,stall=500ms@20%,seed=3");
    assert_eq!(doubled.code, Some(0), "{}", doubled.err);
    assert!(doubled.out.contains("growbot-a"), "{}", doubled.out);
}

#[test]
fn invalid_responses_of_boards_are_reported() {
    let status = |board: &FakeBoard| growbot(&["status", "--port", &board.port()]);
    assert_refused(&status(&FakeBoard::silent()), &["has not responded", "power"]);
    assert_refused(&status(&FakeBoard::garbage()), &["no valid frame", "115200"]);
    assert_refused(&status(&FakeBoard::of_frame_version(9)), &["version 9", "this end uses version 2"]);
    assert_refused(&status(&FakeBoard::of_schema(0x1234)), &["0000000000001234", "flash"]);
    assert_refused(&status(&FakeBoard::that_hangs_up()), &["lost the connection", "closed"]);
}

#[test]
fn a_board_of_another_robot_is_refused() {
    let board = FakeBoard::simulated("growbot-b");
    let ran = growbot(&["grow", "--to", "0,0,100,0,90", "--port", &board.port()]);
    assert_refused(&ran, &["growbot-b", "growbot-a", "--robot"]);
}

#[test]
fn a_body_grows_over_tcp_as_reported_by_the_board() {
    let board = FakeBoard::simulated("growbot-a");
    let ran = growbot(&["grow", "--to", "0,0,77.4,0,90", "--port", &board.port(), "--json"]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    let result = json(&ran);
    assert_eq!(number(&result, "layers"), 100.0);
    assert!(number(&result, "position_error_mm") < 0.05, "{result}");
}

#[test]
fn with_feedback_the_measured_tip_reaches_the_goal() {
    let board = FakeBoard::simulated("growbot-a");
    let ran = growbot(&["grow", "--to", "0,0,38.7,0,90", "--port", &board.port(), "--feedback", "--json"]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    let result = json(&ran);
    assert_eq!((&result["measured_by"], &result["seed"]), (&"estimate".into(), &Value::Null));
    assert!(number(&result["feedback"], "amendments") > 10.0 && result["feedback"]["estimate_error_mm"].is_null());
    assert!(number(&result, "position_error_mm") < 1.0, "{result}");
}

#[test]
fn lost_reports_are_sent_again() {
    let board = FakeBoard::losing_reports("growbot-a");
    let ran = growbot(&["grow", "--to", "0,0,15.48,0,90", "--port", &board.port(), "--json"]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    let result = json(&ran);
    assert_eq!((number(&result, "layers"), number(&result, "unknown_layers")), (20.0, 0.0));
    assert!(number(&result, "position_error_mm") < 0.05, "{result}");
}

/// Starts a growth, and kills its program when the run log contains this number of layers. After these layers the
/// board's time almost stops.
fn grow_and_kill(board: &FakeBoard, log: &std::path::Path, layers: usize, on_silence: &str) {
    board.pause_after(layers as u32);
    let mut child = command(PROGRAM)
        .args(["grow", "--to", "0,0,46.44,0,90", "--port", &board.port(), "--on-host-silence", on_silence, "--log"])
        .arg(log)
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let laid = || std::fs::read_to_string(log).unwrap_or_default().matches("\"laid\",").count();
    wait_for("the layers are laid", || (laid() >= layers).then_some(()));
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn a_killed_growth_resumes_from_its_log() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    let log = path("run.jsonl");
    let whole = path("whole.jsonl");
    let whole_text = whole.to_str().unwrap();
    let unbroken = growbot(&["grow", "--to", "0,0,46.44,0,90", "--log", whole_text, "--json"]);
    assert_eq!(unbroken.code, Some(0), "{}", unbroken.err);

    let board = FakeBoard::lasting("growbot-a");
    grow_and_kill(&board, &log, 12, "continue");
    let log = log.to_str().unwrap();
    // An incomplete last line, as after an interrupted write.
    let mut bytes = std::fs::read(log).unwrap();
    bytes.extend_from_slice(b"{\"event\":\"laid\",\"layer\":1");
    std::fs::write(log, bytes).unwrap();
    let told = growbot(&["replay", log]);
    assert_eq!(told.code, Some(0), "{}", told.err);
    assert!(told.out.contains("unfinished") && told.err.contains("cut off"), "{}{}", told.out, told.err);
    // Another growth does not begin on top of this body.
    let other = growbot(&["grow", "--to", "0,0,100,0,90", "--port", &board.port()]);
    assert_eq!(other.code, Some(1), "{}", other.err);
    assert!(other.err.contains("growbot resume"), "{}", other.err);
    // From here on the board's time runs so fast that any host seems silent for long.
    board.pause_after(u32::MAX);
    let ran = growbot(&["resume", log, "--port", &board.port(), "--yes", "--on-host-silence", "continue", "--json"]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    let (result, unbroken) = (json(&ran), json(&unbroken));
    assert_eq!((number(&result, "layers"), number(&result, "unknown_layers")), (60.0, 0.0));
    for same in ["plan_id", "as_built_hash"] {
        assert_eq!(result[same], unbroken[same], "{same}");
    }
    let replayed = [log, whole_text].map(|log| json(&growbot(&["replay", log, "--json"])));
    for replayed in &replayed {
        assert_eq!(replayed["outcome"], "done");
        assert_eq!(replayed["as_built_hash"], unbroken["as_built_hash"]);
    }
    // For a board at the end of a line, only its steps are known.
    assert_eq!(
        (&replayed[0]["measured_by"], &replayed[1]["measured_by"]),
        (&Value::from("steps"), &Value::from("tip"))
    );
    assert_eq!(replayed[0]["final"], replayed[1]["commanded"]["final"]);
    // Nothing of the body is left to grow. Without --port the command uses the port in the log, so it finds the board.
    for port in [&["--port", &board.port()][..], &[]] {
        let again = growbot(&[&["resume", log, "--yes"], port].concat());
        assert!(again.code != Some(2), "{}", again.err);
        assert!(again.err.contains("60 of 60 layers laid"), "{}", again.err);
    }
}

#[test]
fn a_job_is_cancelled_and_the_emergency_stop_acts() {
    let directory = tempfile::tempdir().unwrap();
    let log = directory.path().join("run.jsonl");
    let board = FakeBoard::lasting("growbot-a");
    grow_and_kill(&board, &log, 3, "continue");
    let stopped = growbot(&["estop", "--port", &board.port()]);
    assert_eq!(stopped.code, Some(0), "{}", stopped.err);
    let status = json(&growbot(&["status", "--port", &board.port(), "--json"]));
    assert_eq!(status["state"], "emergency-stop");
    assert!(number(&status, "laid") >= 3.0);
    let log = log.to_str().unwrap();
    // Without a user who can confirm heating, `--yes` is required.
    assert_refused(&growbot(&["resume", log, "--port", &board.port()]), &["--yes"]);
    let resumed = growbot(&["resume", log, "--port", &board.port(), "--yes"]);
    assert_eq!(resumed.code, Some(1), "not before it is cleared: {}", resumed.err);
    assert_eq!(growbot(&["cancel", "--port", &board.port()]).code, Some(0));
    let status = json(&growbot(&["status", "--port", &board.port(), "--json"]));
    assert_eq!(status["plan_id"], Value::Null);
}

#[test]
fn a_body_on_a_board_of_another_release_is_kept_and_can_be_stopped() {
    let directory = tempfile::tempdir().unwrap();
    let log = directory.path().join("run.jsonl");
    let board = FakeBoard::lasting("growbot-a");
    grow_and_kill(&board, &log, 3, "pause");
    let port = board.port();
    board.pause_after(u32::MAX);
    let before = wait_for("the body is parked", || {
        let status = json(&growbot(&["status", "--port", &port, "--json"]));
        (status["state"] == "parked").then_some(status)
    });
    // The host is updated now, so that the board's release is another one.
    board.set_other_release(true);
    let refusal = [
        "the board's firmware is of another release",
        "finish or cancel a body that the board stores with the growbot of that release, then flash this release",
        "stop and estop work with any release",
    ];
    let log = log.to_str().unwrap();
    for args in [
        &["status"][..],
        &["resume", log, "--yes"],
        &["cancel"],
        &["grow", "--to", "0,0,100,0,90"],
        &["maintain", "preheat"],
        &["tune"],
    ] {
        let ran = growbot(&[args, &["--port", &port]].concat());
        assert_refused(&ran, &refusal);
        assert_eq!(ran.out, "", "{args:?}");
    }
    for (command, state) in [("stop", "stopped"), ("estop", "emergency-stop")] {
        let ran = growbot(&[command, "--port", &port]);
        assert!(ran.code == Some(0) && ran.out.contains("are off"), "{command}: {}{}", ran.out, ran.err);
        board.set_other_release(false);
        let after = json(&growbot(&["status", "--port", &port, "--json"]));
        board.set_other_release(true);
        assert_eq!((&after["state"], &after["plan_id"]), (&state.into(), &before["plan_id"]), "{command}: {after}");
        assert!(number(&after, "laid") >= number(&before, "laid"), "{after}");
    }
}

#[test]
fn an_unacknowledged_emergency_stop_is_reported() {
    let ran = growbot(&["estop", "--port", &FakeBoard::silent().port()]);
    assert_eq!(ran.code, Some(1));
    assert!(ran.err.contains("power"), "{}", ran.err);
}

#[test]
fn invalid_run_logs_are_reported() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    for (name, text) in
        [("empty", ""), ("words", "hello\n"), ("list", "[1]\n"), ("old", "{\"format\":\"growbot-run/1\"}\n")]
    {
        std::fs::write(path(name), text).unwrap();
        assert_refused(&growbot(&["replay", &path(name)]), &[name, "run log"]);
    }
    // The plan of the old header is readable, but nothing of the log is read.
    let log = path("run.jsonl");
    assert_eq!(growbot(&["grow", "--to", "0,0,5,0,90", "--log", &log]).code, Some(0));
    let old = std::fs::read_to_string(&log).unwrap().replacen("growbot-run/4", "growbot-run/3", 1);
    std::fs::write(&log, &old).unwrap();
    let refusal =
        "the format is \"growbot-run/3\", but this version of growbot reads \"growbot-run/4\": use the version";
    for args in [&["replay", &log][..], &["resume", &log, "--port", "sim", "--yes"], &["view", &log, "-o", "-"]] {
        let ran = growbot(args);
        assert_refused(&ran, &["run.jsonl", refusal]);
        assert_eq!(ran.out, "", "{args:?}");
    }
    assert_eq!(std::fs::read_to_string(&log).unwrap(), old);
    assert_refused(&growbot(&["replay", &path("missing")]), &["missing"]);
    assert_refused(&growbot(&["resume", &path("missing")]), &["missing"]);
}

#[test]
fn status_reports_robot_and_state() {
    let ran = growbot(&["status", "--port", "sim"]);
    assert_eq!(ran.code, Some(0));
    for part in ["growbot-a", "simulated", "idle", "heater off", "power on"] {
        assert!(ran.out.contains(part), "{}", ran.out);
    }
    let status = json(&growbot(&["status", "--port", "sim", "--robot", "growbot-b", "--json"]));
    assert_eq!((&status["robot"], &status["simulated"]), (&"growbot-b".into(), &true.into()));
    let board = FakeBoard::lasting("growbot-a");
    assert_eq!(json(&growbot(&["status", "--port", &board.port(), "--json"]))["simulated"], false);
    assert_eq!(status["plan_id"], Value::Null);
    assert_eq!(number(&status, "capacity"), 4096.0);
    assert_eq!((&status["image"]["check"], &status["crash"]), (&"not-sealed".into(), &Value::Null));
    assert_refused(
        &growbot(&["status", "--port", "sim", "--elf", "nothing.elf"]),
        &["nothing.elf", "give the ELF image"],
    );
}

#[test]
fn a_command_to_a_simulated_robot_that_nothing_runs_fails() {
    for (command, what) in [("stop", "the stop"), ("cancel", "the cancellation"), ("estop", "the emergency stop")] {
        for ran in [growbot(&[command, "--port", "sim"]), growbot_configured("sim", &[command])] {
            assert_eq!(ran.code, Some(1), "{}", ran.out);
            let expected = format!("{what} was not sent: no robot runs at sim");
            assert!(ran.out.is_empty() && ran.err.contains(&expected) && ran.err.contains("Ctrl-C"), "{}", ran.err);
        }
    }
}

#[test]
fn tests_ignore_the_users_settings() {
    let tested = command(PROGRAM);
    let changes = || tested.get_envs().map(|(name, value)| (name.to_string_lossy(), value));
    let set: Vec<_> = changes().filter_map(|(name, value)| value.and(Some(name))).collect();
    assert_eq!(set, ["XDG_CONFIG_HOME", "XDG_RUNTIME_DIR", "XDG_STATE_HOME"]);
    for (name, _) in std::env::vars().filter(|(name, _)| name.starts_with("GROWBOT_")) {
        assert!(changes().any(|(removed, value)| removed == name && value.is_none()), "{name}");
    }
    let mut folders = vec![concat!(env!("CARGO_MANIFEST_DIR"), "/tests").into()];
    let mut files = 0;
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir::<std::path::PathBuf>(folder).unwrap().map(|entry| entry.unwrap().path()) {
            if entry.is_dir() {
                folders.push(entry);
            } else if !entry.ends_with("running/mod.rs") {
                let text = std::fs::read_to_string(&entry).unwrap();
                for way in [concat!("Command", "::new("), concat!("CARGO_BIN", "_EXE")] {
                    assert!(!text.contains(way), "{}: {way}: use running::command and PROGRAM", entry.display());
                }
                files += 1;
            }
        }
    }
    assert!(files > 20, "{files}");
    let checks = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests");
    for (file, way) in [
        ("viewer/check.js", "env: environment"),
        ("viewer/live.js", "env: environment"),
        ("exports/check.py", "env=ENVIRONMENT"),
    ] {
        let text = std::fs::read_to_string(format!("{checks}/{file}")).unwrap();
        // Each start of a program has the environment.
        let starts: usize =
            ["spawn(", "execFileSync(", "subprocess.run("].iter().map(|start| text.matches(start).count()).sum();
        assert!(starts > 0, "{file}");
        assert_eq!(starts, text.matches(way).count(), "{file}");
    }
}

/// Runs a growbot command with this port as the configured port.
fn growbot_configured(port: &str, args: &[&str]) -> Ran {
    let output =
        command(PROGRAM).args(args).env("GROWBOT_PORT", port).stdin(std::process::Stdio::null()).output().unwrap();
    let [out, err] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    Ran { code: output.status.code(), out, err: running::in_lines(&err) }
}

#[test]
fn commands_for_a_physical_robot_require_a_port() {
    for command in ["stop", "cancel", "status", "tune"] {
        let remedy = ["no port given", "--port PORT", "set GROWBOT_PORT"];
        assert_refused(&growbot(&[command]), &remedy);
        assert_refused(&growbot_configured("", &[command]), &remedy);
        assert_refused(&growbot_configured("/dev/ttyNONE7", &[command]), &["/dev/ttyNONE7", "not found"]);
        // The option overrides the configured port.
        let ran = growbot_configured("/dev/ttyNONE7", &[command, "--port", "sim"]);
        let answer = if matches!(command, "stop" | "cancel") { &ran.err } else { &ran.out };
        assert!(answer.contains("simulated"), "{command}: {}", ran.err);
        assert!(growbot(&[command, "--help"]).out.contains("GROWBOT_PORT"));
    }
    // Commands that begin a growth simulate it without a port, and `growbot` alone always does.
    assert_refused(&growbot_configured("/dev/ttyNONE7", &["grow", "--to", "0,0,9,0,90"]), &["/dev/ttyNONE7"]);
    assert_eq!(growbot_configured("/dev/ttyNONE7", &[]).code, Some(0));
}

#[test]
fn messages_of_a_simulated_robot_are_marked() {
    let grown = growbot(&["grow", "--to", "0,0,7.74,0,90", "--json"]);
    assert_eq!(json(&grown)["simulated"], true);
    assert!(growbot(&["grow", "--to", "0,0,7.74,0,90"]).out.contains("on simulated growbot-a"));
    let board = FakeBoard::simulated("growbot-a");
    let grown = growbot(&["grow", "--to", "0,0,7.74,0,90", "--port", &board.port(), "--json"]);
    assert_eq!(json(&grown)["simulated"], false);
    let tuned = growbot(&["tune", "--port", "sim"]);
    assert!(tuned.out.contains("# These gains are for a simulated robot"), "{}", tuned.out);
    assert_eq!(json(&growbot(&["tune", "--port", "sim", "--json"]))["simulated"], true);
    let told = growbot_reading(&["console"], "stop\nestop\n");
    assert_eq!(told.out.matches("simulated").count(), 3, "{}", told.out);
}

#[cfg(unix)]
mod serial {
    use super::*;
    use serialport::{SerialPort, TTYPort};

    /// Returns the board's end of a serial line, the name of the host's end, and an open handle that prevents a hang-up
    /// of the line.
    fn line() -> (TTYPort, String, std::fs::File) {
        let (master, slave) = TTYPort::pair().unwrap();
        let name = slave.name().unwrap();
        let open = std::fs::File::open(&name).unwrap();
        (master, name, open)
    }

    #[test]
    fn a_robot_on_a_serial_port_responds() {
        let (master, name, _open) = line();
        let _board = FakeBoard::on_serial(master, "growbot-a");
        // The board's time runs so fast that any host seems silent for long.
        let args = ["grow", "--to", "0,0,7.74,0,90", "--on-host-silence", "continue", "--port", &name, "--json"];
        let ran = growbot(&args);
        assert_eq!(ran.code, Some(0), "{}", ran.err);
        assert_eq!(number(&json(&ran), "layers"), 10.0);
    }

    #[test]
    fn a_busy_serial_port_is_reported() {
        let (_master, name, open) = line();
        open.try_lock().unwrap();
        // This test process holds the port.
        let holder = format!("(process {})", std::process::id());
        assert_refused(&growbot(&["status", "--port", &name]), &[&name, "is in use by", &holder]);
    }
}
