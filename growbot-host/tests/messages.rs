//! Tests that all messages have one style. The tests use every subcommand wrongly in many ways, and run commands with
//! simulated robots.

use crate::running;

use std::fs;
use std::process::Stdio;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use running::{PROGRAM, Ran, command, growbot, growbot_reading};

/// Number of columns of a terminal, which messages must not exceed.
const WIDTH: usize = 80;

/// Returns the names of all subcommands, read from the pages of the manual.
fn subcommands() -> Vec<String> {
    let directory = tempfile::tempdir().unwrap();
    assert_eq!(growbot(&["man", "-o", directory.path().to_str().unwrap()]).code, Some(0));
    let pages = fs::read_dir(directory.path()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> =
        pages.filter_map(|page| Some(page.strip_prefix("growbot-")?.strip_suffix(".1")?.to_owned())).collect();
    names.sort();
    names
}

/// Returns the names of the options of a subcommand that take a value.
fn options_with_values(subcommand: &str) -> Vec<String> {
    let help = growbot(&[subcommand, "--help"]);
    assert_eq!(help.code, Some(0));
    let options = help.out.lines().filter_map(|line| {
        let line = line.trim_start();
        let long = line.split([' ', ',']).find(|word| word.starts_with("--"))?;
        (line.starts_with('-') && line.contains('<')).then(|| long.trim_end_matches('[').to_owned())
    });
    options.collect()
}

/// Runs growbot with these wrong arguments. Returns a description of the fault if the message or the exit code is not
/// as it should be, otherwise `None`. Lines that contain `path` may be longer than a terminal's line.
fn faults(args: &[&str], path: &str) -> Option<String> {
    let output = command(PROGRAM).args(args).stdin(Stdio::null()).output().unwrap();
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    // An emergency stop that was not sent ends with exit code 1 for any cause.
    let code = if args.contains(&"estop") { 1 } else { 2 };
    let errors = err.lines().filter(|line| line.starts_with("error: ")).count();
    let wide = err.lines().find(|line| line.chars().count() > WIDTH && !line.contains(path));
    let mut plain = err
        .lines()
        .filter(|line| !["error: ", "warning: ", "note: ", "    "].iter().any(|begin| line.starts_with(begin)));
    let is_right = output.status.code() == Some(code)
        && out.is_empty()
        && errors == 1
        && wide.is_none()
        && plain.next().is_none()
        && !err.contains("panicked")
        && !err.contains("-- --");
    (!is_right).then(|| format!("{args:?} ends with {:?}\n{out}{err}", output.status.code()))
}

#[test]
fn wrong_usage_gives_one_error_in_80_columns_and_code_2() {
    // The text is not a valid file, directory, number, port or choice.
    let path = format!("/no/such/place/{}.json", "long".repeat(30));
    let mut uses: Vec<Vec<String>> = Vec::new();
    let names = subcommands();
    assert!(names.len() > 22, "{names:?}");
    let mut options = 0;
    for name in &names {
        let with = |more: &[&str]| {
            let words = [name.as_str()].into_iter().chain(more.iter().copied());
            words.map(str::to_owned).collect::<Vec<_>>()
        };
        for more in [&["--no-such-option"][..], &["--no-such-option=1"], &["-Z"], &[&path, &path, &path], &["-q", "-v"]]
        {
            uses.push(with(more));
        }
        uses.push(with(&["--color", &path]));
        // As an argument it is a wrong shell, schema or file, or one argument too many.
        uses.push(with(&[&path]));
        for option in options_with_values(name) {
            options += 1;
            uses.push(with(&[&option, &path]));
            // The option lacks its value. `--log` then chooses a name itself, but there is nothing to grow.
            uses.push(with(&[&option]));
        }
    }
    assert!(options > 100, "{options}");
    uses.extend([vec!["--no-such-option".to_owned()], vec!["no-such-command".to_owned()], vec![path.clone()]]);
    let (next, wrong) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    thread::scope(|scope| {
        for _ in 0..thread::available_parallelism().map_or(2, usize::from) {
            scope.spawn(|| {
                while let Some(words) = uses.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let words: Vec<&str> = words.iter().map(String::as_str).collect();
                    wrong.lock().unwrap().extend(faults(&words, &path));
                }
            });
        }
    });
    let wrong = wrong.into_inner().unwrap();
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), uses.len(), wrong.join("\n"));
}

#[test]
fn every_command_with_a_port_marks_a_simulated_robot() {
    let directory = tempfile::tempdir().unwrap();
    let file = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let plan = file("plan.json");
    assert_eq!(growbot(&["plan", "--to", "0,0,20,0,90", "-o", &plan]).code, Some(0));
    let with_port: Vec<String> =
        subcommands().into_iter().filter(|name| options_with_values(name).contains(&"--port".to_owned())).collect();
    for name in &with_port {
        let uses: &[&[&str]] = match name.as_str() {
            "grow" => &[&[&plan], &[&plan, "--json"]],
            "resume" => &[&[&plan, "--yes"]],
            "tune" | "status" => &[&[], &["--json"]],
            "power" => &[&["status"]],
            "configure" => &[&["growbot-b"], &["growbot-b", "--json"]],
            "maintain" => &[&["preheat", "200"], &["cooldown"]],
            _ => &[&[]],
        };
        for args in uses {
            let ran = growbot_reading(&[&[name.as_str()], *args, &["--port", "sim"]].concat(), "status\nstop\n");
            let answer = format!("{}{}", ran.out, ran.err);
            assert!(answer.contains("simulated"), "{name} {args:?}: {answer}");
            // A user may keep standard output alone, so it must state the simulation too.
            assert!(ran.out.is_empty() || ran.out.contains("simulated"), "{name} {args:?}: {}", ran.out);
        }
    }
    assert!(with_port.len() >= 8, "{with_port:?}");
    for args in [&[][..], &["grow", &plan], &["console"], &["simulate", &plan], &["simulate", &plan, "--repeat", "3"]] {
        let ran = growbot_reading(args, "status\n");
        assert!(ran.out.contains("simulated"), "{args:?}: {}", ran.out);
    }
}

/// Runs growbot with these arguments and environment variables.
fn in_environment(args: &[&str], variables: &[(&str, &str)]) -> Ran {
    let output = command(PROGRAM).args(args).envs(variables.iter().copied()).stdin(Stdio::null()).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    Ran { code: output.status.code(), out: text(output.stdout), err: text(output.stderr) }
}

#[test]
fn messages_are_coloured_on_request_and_not_in_a_pipe() {
    let coloured = |args: &[&str], variables: &[(&str, &str)]| in_environment(args, variables).err.contains('\u{1b}');
    assert!(!coloured(&["rmin", "--robot", "none"], &[]));
    assert!(coloured(&["rmin", "--robot", "none", "--color", "always"], &[]));
    assert!(coloured(&["--color=always", "rmin", "--robot", "none"], &[("NO_COLOR", "1")]));
    assert!(coloured(&["rmin", "--nonsense", "--color", "always"], &[]));
    assert!(!coloured(&["rmin", "--robot", "none", "--color", "never"], &[]));
    assert!(in_environment(&["rmin", "--help", "--color", "always"], &[]).out.contains('\u{1b}'));
    // A terminal for this test, if the program `script` exists.
    let on_terminal = |more: &str| {
        let typed = format!("{more} {PROGRAM} rmin --robot none");
        let output = command("script").args(["-qec", &typed, "/dev/null"]).stdin(Stdio::null()).output().ok()?;
        Some(String::from_utf8(output.stdout).unwrap())
    };
    if let (Some(plain), Some(coloured)) = (on_terminal("NO_COLOR=1"), on_terminal("NO_COLOR= TERM=xterm")) {
        assert!(plain.starts_with("error: "), "{plain:?}");
        assert!(coloured.starts_with("\u{1b}[1;31merror:\u{1b}[0m "), "{coloured:?}");
    }
}

#[test]
fn quiet_hides_notes_but_not_warnings_and_errors() {
    let directory = tempfile::tempdir().unwrap();
    let plan = directory.path().join("plan.json");
    let plan = plan.to_str().unwrap();
    let goal = ["plan", "--to", "0,0,20,0,90", "-o", plan];
    let answer = |more: &[&str]| growbot(&[&goal[..], more].concat()).err;
    assert!(answer(&[]).contains("note: plan written") && answer(&[]).contains("warning: "), "{}", answer(&[]));
    assert!(!answer(&["-q"]).contains("note: ") && answer(&["--quiet"]).contains("warning: "), "{}", answer(&["-q"]));
    assert_eq!(growbot(&["grow", plan, "-q"]).err, "");
    assert!(growbot(&["-q", "rmin", "--robot", "none"]).err.starts_with("error: "));
    assert!(growbot(&["grow", plan, "-v"]).err.contains("note: port sim, from: built in"));
    let set = in_environment(&["status", "-v"], &[("GROWBOT_PORT", "sim"), ("GROWBOT_ROBOT", "growbot-b")]).err;
    for part in ["note: port sim, from: GROWBOT_PORT", "note: robot growbot-b, from: GROWBOT_ROBOT"] {
        assert!(set.contains(part), "{set}");
    }
}

#[test]
fn every_message_in_the_source_follows_the_style() {
    let mut folders = vec![concat!(env!("CARGO_MANIFEST_DIR"), "/src/cli").into()];
    let mut files = 0;
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir::<std::path::PathBuf>(folder).unwrap().map(|entry| entry.unwrap().path()) {
            if entry.is_dir() {
                folders.push(entry);
                continue;
            }
            let Ok(text) = fs::read_to_string(&entry) else { continue };
            files += 1;
            for other in ["eprintln!", "\"growbot: "] {
                assert!(!text.contains(other), "{}: {other}: use error!, warning! or note!", entry.display());
            }
        }
    }
    assert!(files > 40, "{files}");
}
