//! Tests of commands on a terminal, which `script` of util-linux provides: they show that they work, and Ctrl-C ends
//! them and leaves nothing.

use std::fs;
use std::io::{Read, Write};
use std::path::Path;
use std::process::{Child, Stdio};

use crate::running::{PROGRAM, command};

/// Starts a command on a terminal of its own, in this directory.
fn on_terminal(arguments: &str, directory: &Path) -> Child {
    command("script")
        .args(["--quiet", "--return", "--flush", "--command", &format!("{PROGRAM} {arguments}"), "/dev/null"])
        .current_dir(directory)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Reads what a command shows, until it shows this text or ends.
fn read_until(child: &mut Child, text: &str) -> String {
    let (mut shown, mut byte) = (Vec::new(), [0]);
    let out = child.stdout.as_mut().unwrap();
    while !String::from_utf8_lossy(&shown).contains(text) && out.read(&mut byte).unwrap_or(0) > 0 {
        shown.push(byte[0]);
    }
    String::from_utf8_lossy(&shown).into_owned()
}

/// Commands that compute for long, and what they show meanwhile.
const LONG: [(&str, &str); 8] = [
    ("export plan.json -o body.stl --segments 900", "working"),
    ("view plan.json -o body.png --width 8000", "working"),
    ("plan --to 0,0,960 --scene rack.toml --effort 100000 -o path.json", "working"),
    ("simulate plan.json --noise 10 --repeat 10000000 -o growths.json", "growths"),
    ("workspace --length 5000 --heading 10 --pitch 40 -o reach.svg", "positions"),
    ("workspace --length 900 --scene rack.toml --effort 100000 -o goals.csv", "goals"),
    ("reproduce --repeat 1000 -o paper", "pieces of work"),
    ("grow --to 0,0,960 --scene rack.toml --effort 100000 --log run.jsonl", "working"),
];

#[test]
fn long_commands_show_that_they_work_and_ctrl_c_leaves_nothing() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    for arguments in
        [&["plan", "--to", "200,100,2000,0,45", "-o", "plan.json"][..], &["scene", "pipe-rack", "-o", "rack.toml"]]
    {
        assert!(command(PROGRAM).args(arguments).current_dir(directory).output().unwrap().status.success());
    }
    let files = || fs::read_dir(directory).unwrap().map(|file| file.unwrap().file_name()).collect::<Vec<_>>();
    let before = files();
    let mut silent = Vec::new();
    for (arguments, shown) in LONG {
        let mut child = on_terminal(arguments, directory);
        let text = read_until(&mut child, shown);
        if !text.contains(shown) {
            silent.push(format!("{arguments}: {text:?}"));
        }
        child.stdin.take().unwrap().write_all(b"\x03").unwrap();
        let mut rest = String::new();
        child.stdout.as_mut().unwrap().read_to_string(&mut rest).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(130), "{arguments}: {text:?} {rest:?}");
        // The last thing on the line of the display is that it was cleared.
        let end = rest.trim_end().trim_end_matches("^C");
        assert!(end.ends_with("\x1b[2K") || end.ends_with("\x1b[2K\r"), "{arguments}: {rest:?}");
        assert_eq!(files(), before, "{arguments}");
    }
    assert_eq!(silent, [""; 0]);
}

#[test]
fn recover_asks_before_each_step() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let run = |arguments: &[&str]| {
        let ran = command(PROGRAM).args(arguments).current_dir(directory).stdin(Stdio::null()).output().unwrap();
        assert!(ran.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&ran.stderr));
        String::from_utf8(ran.stdout).unwrap()
    };
    run(&["power", "on", "--port", "sim:./robot", "--pace", "100"]);
    run(&["estop", "--port", "sim:./robot"]);
    // Without a terminal the steps are only shown.
    let shown = run(&["recover", "sim:./robot"]);
    assert!(shown.contains("emergency-stop of the simulated robot") && shown.contains("2. Clear it."), "{shown}");
    let state = || run(&["status", "--port", "sim:./robot"]);
    for (answers, left) in [(&["n"][..], "emergency-stop"), (&["y", "n"], "emergency-stop"), (&["y", "y"], "idle")] {
        let mut child = on_terminal("recover sim:./robot", directory);
        let mut input = child.stdin.take().unwrap();
        for (answer, question) in answers.iter().zip(["Done? [y/N]", "Do it? [y/N]"]) {
            let text = read_until(&mut child, question);
            assert!(text.contains(question), "{text}");
            input.write_all(format!("{answer}\n").as_bytes()).unwrap();
        }
        let mut rest = String::new();
        child.stdout.as_mut().unwrap().read_to_string(&mut rest).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(0), "{rest}");
        let end = if left == "idle" { "the robot needs nothing else" } else { "left. Heater and motors are off" };
        assert!(rest.contains(end), "{rest}");
        assert!(state().contains(&format!("state        {left}\n")), "{answers:?}: {}", state());
    }
    assert!(run(&["recover", "sim:./robot"]).contains("the simulated robot needs nothing"));
    run(&["maintain", "preheat", "60", "--port", "sim:./robot"]);
    let mut child = on_terminal("recover sim:./robot", directory);
    let text = read_until(&mut child, "Do it? [y/N]");
    assert!(text.contains("maintenance of the simulated robot") && text.contains("Switch the heater off."), "{text}");
    child.stdin.take().unwrap().write_all(b"y\n").unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert!(state().contains("heater off"), "{}", state());
    run(&["power", "off", "--port", "sim:./robot"]);
}
