//! Tests of the service's list of jobs and run logs after the disk was full.

use std::process::Stdio;

use growbot_plan::run_log::RecordedRun;
use rustix::process::{Pid, Resource, Rlimit, prlimit};
use serde_json::{Value, json};

use crate::lab::{Lab, wait_for};
use crate::running::{PROGRAM, command};

/// Limits the size of all files that a process can write, so that writes fail as on a full disk. `None` removes the
/// limit.
fn limit_files(pid: u32, bytes: Option<u64>) {
    let pid = Pid::from_raw(i32::try_from(pid).unwrap());
    prlimit(pid, Resource::Fsize, Rlimit { current: bytes, maximum: None }).unwrap();
}

/// Restarts the service so that a write beyond the limit on file sizes is an error and does not end the process.
fn restart_with_errors(lab: &mut Lab) {
    lab.kill();
    let port = lab.pages.as_ref().unwrap().0.to_string();
    let mut service = command("sh");
    service.args(["-c", "trap '' XFSZ; exec \"$0\" serve --page-port \"$1\"", PROGRAM, &port]);
    let of_lab = lab.command(&[]);
    service.current_dir(of_lab.get_current_dir().unwrap());
    service.envs(of_lab.get_envs().filter_map(|(name, value)| Some((name, value?))));
    service.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    lab.service = Some(service.spawn().unwrap());
    wait_for("the service listens", || std::os::unix::net::UnixStream::connect(lab.socket()).ok());
    lab.wait_until_ready();
}

#[test]
fn list_and_log_are_completed_once_the_disk_has_room() {
    let mut lab = Lab::new(100.0);
    lab.wait_until_ready();
    restart_with_errors(&mut lab);
    let (status, job) = lab.ask("POST", "/robots/lab/jobs", &json!({ "to": "100,100,600,0,45" }).to_string());
    assert_eq!(status, 201, "{job}");
    let id = job["id"].as_str().unwrap();
    let robot = || lab.ask("GET", "/robots/lab", "").1;
    let listed = || lab.ask("GET", &format!("/jobs/{id}"), "").1;
    wait_for("some layers are laid", || (robot()["laid"].as_u64() > Some(3)).then_some(()));
    let pid = lab.service.as_ref().unwrap().id();
    limit_files(pid, Some(0));
    let laid = robot()["laid"].as_u64().unwrap();
    wait_for("more layers are laid", || (robot()["laid"].as_u64() > Some(laid + 2)).then_some(()));
    let (status, stopped) = lab.ask("POST", "/robots/lab/commands", r#"{"command":"stop"}"#);
    assert_eq!(status, 200, "{stopped}");
    wait_for("the growth has ended", || robot()["job"].is_null().then_some(()));
    assert_eq!(listed()["state"], "active", "nothing could be written");
    assert_eq!(RecordedRun::open(&lab.log(id)).unwrap().result, None);
    limit_files(pid, None);
    let ended = lab.wait_for_end(id);
    assert_eq!((&ended["state"], &ended["reason"]), (&json!("interrupted"), &json!("stopped")), "{ended}");
    let record = wait_for("the log is complete", || {
        RecordedRun::open(&lab.log(id)).ok().filter(|record| record.result.is_some())
    });
    let laid = robot()["laid"].clone();
    assert_eq!((&ended["laid"], &json!(record.as_built.len())), (&laid, &laid));
    assert_eq!((record.lost, record.result.unwrap().log_lines_missing), (vec![], None));
    // The body can still be resumed.
    let (status, resumed): (u16, Value) = lab.ask("POST", &format!("/jobs/{id}/resume"), "{}");
    assert_eq!((status, &resumed["state"]), (200, &json!("active")), "{resumed}");
}
