//! Tests of settings files that another user may have written: no command uses them, and no stop depends on them.

use crate::fake_board::FakeBoard;
use crate::running;

use std::fs;
use std::net::TcpListener;
use std::os::unix::fs::{PermissionsExt, chown};
use std::path::PathBuf;

use running::{PROGRAM, Ran, command, in_lines};
use tempfile::TempDir;

/// Numeric identifier of another user, which no process of the tests has.
const OTHER_USER: u32 = 54_321;

/// Directories for settings: `lab`, with a settings file that another user may have written; `lab/project`, in which
/// commands run; and `conf`, with the settings of the user, who has a robot.
struct Place {
    root: TempDir,
    users_robot: FakeBoard,
    /// Listener at the port of the robot in the settings file `lab/growbot.toml`. If no connection is pending, no
    /// program has used that file.
    projects_robot: TcpListener,
}

impl Place {
    fn new() -> Self {
        let root = tempfile::tempdir().unwrap();
        for directory in ["lab/project", "conf/growbot"] {
            fs::create_dir_all(root.path().join(directory)).unwrap();
        }
        let (users_robot, projects_robot) =
            (FakeBoard::lasting("growbot-a2"), TcpListener::bind(("127.0.0.1", 0)).unwrap());
        projects_robot.set_nonblocking(true).unwrap();
        // No service can start with a file as its folder, so none runs on if its settings are not refused.
        fs::write(root.path().join("state"), "").unwrap();
        let port = format!("tcp:{}", projects_robot.local_addr().unwrap());
        let place = Self { root, users_robot, projects_robot };
        let port_of_user = place.users_robot.port();
        place.write(
            "conf/growbot/growbot.toml",
            &format!("port = \"{port_of_user}\"\nrobot = \"growbot-a2\"\n[robots.lab]\nport = \"{port_of_user}\"\n"),
        );
        place.write("lab/growbot.toml", &format!("port = \"{port}\"\n[robots.lab]\nport = \"{port}\"\n"));
        place
    }

    fn path(&self, name: &str) -> PathBuf {
        self.root.path().canonicalize().unwrap().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
        self.set_mode(name, 0o644);
    }

    fn set_mode(&self, name: &str, mode: u32) {
        fs::set_permissions(self.path(name), fs::Permissions::from_mode(mode)).unwrap();
    }

    fn run(&self, args: &[&str]) -> Ran {
        let output = command(PROGRAM)
            .args(args)
            .current_dir(self.path("lab/project"))
            .env("XDG_CONFIG_HOME", self.path("conf"))
            .env("XDG_STATE_HOME", self.path("state"))
            .env("XDG_RUNTIME_DIR", self.path("state"))
            .output()
            .unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        Ran { code: output.status.code(), out: text(output.stdout), err: in_lines(&text(output.stderr)) }
    }

    /// Checks that commands refuse `lab/growbot.toml` with messages that contain these texts, and that stops are sent
    /// to the user's robot.
    fn check_refused(&self, words: &[&str]) {
        for args in
            [&["rmin"][..], &["settings"], &["status"], &["serve", "--page-port", "0"], &["pause", "--port", "lab"]]
        {
            let ran = self.run(args);
            assert_eq!((ran.code, ran.out.as_str()), (Some(2), ""), "{args:?}: {}", ran.err);
            for words in words.iter().chain(&["lab/growbot.toml is not used, because another user may have written it"])
            {
                assert!(ran.err.contains(words), "{args:?}, {words}: {}", ran.err);
            }
        }
        for args in [&["estop"][..], &["estop", "--port", "lab"], &["stop"], &["stop", "--port", "lab"]] {
            let ran = self.run(args);
            assert_eq!(ran.code, Some(0), "{args:?}: {}", ran.err);
            let is_reported =
                ran.err.contains("settings cannot be read") && words.iter().all(|words| ran.err.contains(words));
            assert!(is_reported, "{args:?}: {}", ran.err);
        }
        assert!(self.projects_robot.accept().is_err(), "a robot of another user was reached");
    }
}

#[test]
fn a_file_that_others_can_write_is_refused_but_prevents_no_stop() {
    let place = Place::new();
    place.set_mode("lab/growbot.toml", 0o666);
    place.check_refused(&["has mode 0666", "`chmod go-w "]);
    place.set_mode("lab/growbot.toml", 0o644);
    place.set_mode("lab", 0o777);
    place.check_refused(&["lab has mode 0777", "`chmod go-w "]);
    // A file that only its user can write is used, and its path is shown.
    place.set_mode("lab", 0o755);
    let status = place.run(&["status"]);
    let file = place.path("lab/growbot.toml").display().to_string();
    assert!(status.err.contains(&format!("is from {file}")), "{}", status.err);
    assert!(place.projects_robot.accept().is_ok());
    assert!(place.run(&["estop"]).err.contains(&format!("stopping the robots of {file}")));
}

#[test]
fn a_file_of_another_user_is_refused_but_prevents_no_stop() {
    let place = Place::new();
    // Only root can change the owner of a file. Without root, only the unit tests of src/ownership.rs check the owner.
    if chown(place.path("lab/growbot.toml"), Some(OTHER_USER), None).is_ok() {
        place.check_refused(&["belongs to user 54321", "run `chown "]);
    }
    if chown(place.path("lab"), Some(OTHER_USER), None).is_ok() {
        chown(place.path("lab/growbot.toml"), Some(0), None).unwrap();
        place.check_refused(&["lab belongs to user 54321", "run `chown "]);
    }
}

#[test]
fn only_the_users_file_names_commands_webhooks_and_cameras() {
    let place = Place::new();
    let users_file = place.path("conf/growbot/growbot.toml").display().to_string();
    for (section, line) in [
        ("notify", "command = [\"touch\", \"ran\"]"),
        ("notify", "webhook = \"https://hooks.example/\""),
        ("cameras", "lab = \"http://camera.example/\""),
    ] {
        place.write("lab/growbot.toml", &format!("[robots.lab]\nport = \"sim:lab\"\n[serve.{section}]\n{line}\n"));
        let ran = place.run(&["serve", "--page-port", "0"]);
        let expected = format!(
            "lab/growbot.toml: [serve.{section}] is allowed only in your own settings, because it names a command"
        );
        assert_eq!((ran.code, ran.out.as_str()), (Some(2), ""), "{}", ran.err);
        assert!(
            ran.err.contains(&expected) && ran.err.contains(&format!("move this section to {users_file}")),
            "{}",
            ran.err
        );
    }
    // The user's settings of notices apply to the robots of a project. An invalid setting shows that they are read.
    place.write("lab/growbot.toml", "[robots.lab]\nport = \"sim:lab\"\n");
    place.write("conf/growbot/growbot.toml", "[serve.notify]\nevents = [\"dance\"]\n");
    let ran = place.run(&["serve", "--page-port", "0"]);
    assert!(
        ran.code == Some(2) && ran.err.contains("conf/growbot/growbot.toml") && ran.err.contains("dance"),
        "{}",
        ran.err
    );
}
