//! Tests of `growbot console` with piped input, on a simulated robot.

use crate::running;

use running::{Ran, growbot, growbot_reading, growbot_reading_bytes, growbot_unread};

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
fn the_console_works_in_a_pipe() {
    let commands = "plan 0,0,2.3,0,90\nlayers\nstart\nwait 600\nstatus\nquit\nstart\n";
    let ran = growbot_reading(&["console"], commands);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    for part in ["3 layers", "layer,alpha_deg", "heating", "homing", "growing", "layer 2", "done"] {
        assert!(ran.out.contains(part), "no {part}: {}", ran.out);
    }
    // Commands after `quit` are not executed.
    assert!(ran.out.lines().last().is_some_and(|line| line.starts_with("sensors ")), "{}", ran.out);
}

#[test]
fn one_board_grows_several_bodies_in_a_row() {
    let ran = growbot_reading(&["console"], "grow 0,0,7.74,0,90\ngrow 0,0,7.74,0,90\ngrow 0,0,3,0,90\n");
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    assert_eq!(ran.out.matches("10 layers of 10,").count(), 2, "{}", ran.out);
    assert_eq!(ran.out.matches("4 layers of 4,").count(), 1, "{}", ran.out);
    assert_eq!(ran.out.matches("\ndone\n").count(), 3, "{}", ran.out);
}

#[test]
fn a_position_goal_is_planned_like_in_the_plan_command() {
    let ran = growbot_reading(&["console"], "grow 60,20,100\n");
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    let of = |text: &str, line: &str| -> Vec<f64> {
        let line = text.lines().find(|row| row.starts_with(line)).unwrap_or_else(|| panic!("{text}"));
        line.split_whitespace().filter_map(|word| word.parse().ok()).collect()
    };
    let (target, arrived) = (of(&ran.out, "target"), of(&ran.out, "final"));
    assert_eq!(target[..3], [60.0, 20.0, 100.0], "{}", ran.out);
    assert!(target.iter().zip(&arrived).all(|(target, arrived)| (target - arrived).abs() < 0.1), "{}", ran.out);
    let plan: serde_json::Value = serde_json::from_str(&growbot(&["plan", "--to", "60,20,100", "--json"]).out).unwrap();
    assert!((plan["goal"]["pitch_deg"].as_f64().unwrap() - target[4]).abs() < 1e-3, "{}", ran.out);
    assert!(ran.out.contains(&format!("{} layers of {0},", plan["layers"])), "{}", ran.out);
}

#[test]
fn a_stop_does_not_affect_the_next_growth() {
    let ran = growbot_reading(&["console"], "grow 0,0,3,0,90\nstop\ngrow 0,0,7.74,0,90\n");
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    assert_eq!(ran.out.matches("10 layers of 10,").count(), 1, "{}", ran.out);
}

#[test]
fn a_script_ends_at_the_first_failing_line() {
    for (line, part) in [
        ("dance", "\"dance\""),
        ("plan 1,2,3", "five numbers"),
        ("start", "stores no plan"),
        ("wait soon", "\"soon\""),
        ("layers -1", "\"-1\""),
        ("stop now", "`stop` takes no arguments: remove \"now\""),
        ("grow 0,0,9,0,95", "pitch is 95"),
    ] {
        // The line after the faulty line would heat the nozzle.
        let ran = growbot_reading(&["console"], &format!("help\n{line}\ngrow 0,0,3,0,90\n"));
        assert_eq!(ran.code, Some(1), "{line}: {}", ran.err);
        for part in [part, "line 2 failed"] {
            assert!(ran.err.contains(part), "no {part}: {}", ran.err);
        }
        assert!(ran.out.contains("plan POSE") && !ran.out.contains("heating"), "{line}: {}", ran.out);
    }
}

#[test]
fn a_script_stops_immediately_and_ends_with_the_growth() {
    let ran = growbot_reading(&["console"], "plan 0,0,60,0,90\nstart\nwait 5\nestop\nstatus\nstart\nstatus\n");
    assert_eq!(ran.code, Some(1), "{}", ran.err);
    assert!(ran.err.contains("line 6 failed"), "{}", ran.err);
    assert!(ran.out.contains("emergency stop: heater and steppers of the simulated robot are off"), "{}", ran.out);
    assert_eq!(ran.out.matches("state        emergency-stop").count(), 1, "{}", ran.out);
    assert!(growbot_reading(&["console"], "help\n").out.contains("estop "));
}

#[test]
fn a_failed_script_reports_skipped_commands_and_the_robot_state() {
    let told = |script: &str, parts: &[&str]| {
        let ran = growbot_reading(&["console"], script);
        assert_eq!(ran.code, Some(1), "{script}: {}", ran.err);
        for part in parts {
            assert!(ran.err.contains(part), "no {part:?} after {script:?}: {}", ran.err);
        }
    };
    told(
        "plan 0,0,60,0,90\nstart\nwait 5\ndance\nstatus\n\nstop\nquit\nstart\n",
        &[
            "line 4 failed",
            "2 more commands are not executed, among them `stop` in line 7",
            "the simulated robot is heating and ends with this program",
        ],
    );
    told(
        "stop\ndance\nestop\n",
        &["1 more command is not executed, among them `estop` in line 3", "(it is in state stopped)"],
    );
    told("dance", &["there were no later commands", "heater and steppers of the simulated robot are off"]);
}

#[cfg(unix)]
#[test]
fn a_script_fails_if_standard_output_is_closed() {
    let script = "plan 0,0,60,0,90\nstart\nwait 5\nstop\n";
    let ran = growbot_unread(&["console"], script);
    assert_eq!(ran.code, Some(1), "{}", ran.err);
    for part in [
        "standard output was closed by the program that reads it",
        "4 more commands are not executed, among them `stop` in line 4",
        "heater and steppers of the simulated robot are off",
    ] {
        assert!(ran.err.contains(part), "no {part:?}: {}", ran.err);
    }
    // Without commands the console has nothing to do, so a closed standard output is not an error, as with other
    // commands.
    let ran = growbot_unread(&["console"], "");
    assert_eq!((ran.code, ran.err.as_str()), (Some(0), ""));
}

#[test]
fn an_emergency_stop_can_be_cleared_at_once() {
    let ran = growbot_reading(&["console"], "estop\nclear\nstatus\nstop\nestop\nclear\n");
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    assert_eq!(
        (ran.out.matches("the emergency-stop is cleared").count(), ran.out.matches("state        idle").count()),
        (2, 2),
        "{}",
        ran.out
    );
}

#[test]
fn an_invalid_utf8_line_ends_a_script() {
    let ran = growbot_reading_bytes(&["console"], b"sta\xfftus\nstatus\n");
    assert_eq!(ran.code, Some(1));
    assert!(ran.err.contains("not UTF-8 text (at byte 3)") && ran.err.contains("line 1 failed"), "{}", ran.err);
    assert_eq!(ran.out.matches("state        idle").count(), 1, "{}", ran.out);
}

#[test]
fn the_full_screen_console_needs_a_terminal() {
    assert_refused(&growbot(&["console", "--tui"]), &["--tui needs a terminal", "standard input", "line by line"]);
}

#[test]
fn a_nozzle_is_preheated_loaded_and_cooled_down_without_a_job() {
    let commands =
        "preheat 200\nwait 120\nload 20\nwait 20\nrotate 90\nwait 20\nhome\nwait 60\nstatus\ncooldown\nstatus\n";
    let ran = growbot_reading(&["console"], commands);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    for part in [
        "heats to 200 C",
        "pushes 20 mm of filament",
        "the head turns by 90 degrees",
        "to its index mark",
        "state        maintenance\n",
        "heater and steppers are off",
    ] {
        assert!(ran.out.contains(part), "no {part}: {}", ran.out);
    }
    let (_, last) = ran.out.rsplit_once("state ").unwrap();
    assert!(last.trim_start().starts_with("idle"), "{last}");
}

#[test]
fn unsafe_requests_are_refused_with_value_limit_and_remedy() {
    for (commands, parts) in [
        ("load\n", &["preheat the nozzle first"][..]),
        ("preheat 300\n", &["between 50 and 235 C"]),
        ("preheat 200\nload\n", &["22", "must reach 180 C", "preheat, and wait"]),
        ("preheat 200\nwait 120\nrotate 400\n", &["by at most 360 degrees per command"]),
        ("preheat 200\nwait 120\njog 1e5\n", &["mm of filament per command"]),
        ("preheat 200\nwait 120\njog 50\njog 1\n", &["still moving"]),
        ("plan 0,0,60,0,90\nstart\npreheat\n", &["this is not allowed in state heating"]),
        ("preheat pla\n", &["\"pla\" is neither a number nor a material", "[materials.pla]"]),
    ] {
        let ran = growbot_reading(&["console"], commands);
        assert_eq!(ran.code, Some(1), "{commands}: {}", ran.err);
        for part in parts {
            assert!(ran.err.contains(part), "{commands}: no {part}: {}", ran.err);
        }
    }
}

#[test]
fn maintenance_works_on_the_command_line() {
    let ran = growbot(&["maintain", "preheat", "--port", "sim"]);
    assert_eq!(
        (ran.code, ran.out.starts_with("simulated robot: the nozzle heats to 200 C")),
        (Some(0), true),
        "{}",
        ran.err
    );
    let ran = growbot(&["maintain", "jog", "-5", "--port", "sim"]);
    assert_eq!(ran.code, Some(1));
    assert!(ran.err.contains("preheat the nozzle first"), "{}", ran.err);
    assert_refused(&growbot(&["maintain", "dance", "--port", "sim"]), &["preheat"]);
}
