//! Build of a board's firmware: copies the board's memory map, sets the linker arguments and writes the robot's
//! description as Rust source.

use std::path::{Path, PathBuf};
use std::{env, fs, process};

use growbot_core::robot::{BoardKind, Robot};

/// A board that firmware can be built for. The cargo feature and the memory map (`memory/<name>.x`) have the board's
/// name.
struct BoardTarget {
    name: &'static str,
    target: &'static str,
    command: &'static str,
    /// Values of `board.kind` in a robot file that this board accepts. Empty if the board accepts any robot.
    kinds: &'static [BoardKind],
}

const BOARDS: [BoardTarget; 3] = [
    BoardTarget { name: "an386", target: "thumbv7em-none-eabihf", command: "build-an386", kinds: &[] },
    BoardTarget {
        name: "pico",
        target: "thumbv6m-none-eabi",
        command: "build-pico",
        kinds: &[BoardKind::Pico, BoardKind::SkrPico],
    },
    BoardTarget {
        name: "stm32f405",
        target: "thumbv7em-none-eabihf",
        command: "build-stm32f405",
        kinds: &[BoardKind::Stm32f405],
    },
];

/// Name of the robot that is built in if the environment variable GROWBOT_ROBOT is not set.
const DEFAULT_ROBOT: &str = "growbot-a";

/// Prepares the build of the board whose cargo feature is enabled.
pub fn prepare() {
    println!("cargo:rerun-if-changed=memory");
    println!("cargo:rerun-if-env-changed=GROWBOT_ROBOT");

    let mut chosen = BOARDS.iter().filter(|board| feature(&board.name.to_uppercase()));
    let Some(&BoardTarget { name: board, target: wanted, command, kinds }) = chosen.next() else { return };
    if let Some(other) = chosen.next() {
        stop(&format!(
            "the features `{board}` and `{}` exclude each other: build one board at a time, with `cargo {command}` \
             or `cargo {}`",
            other.name, other.command
        ));
    }

    let target = env::var("TARGET").unwrap_or_default();
    if target != wanted {
        stop(&format!("the feature `{board}` is for --target {wanted}, not {target}: use `cargo {command}`"));
    }

    let (Some(out), Some(here)) = (directory("OUT_DIR"), directory("CARGO_MANIFEST_DIR")) else {
        stop("OUT_DIR or CARGO_MANIFEST_DIR is not set: this script is run by cargo");
    };
    let map = here.join("memory").join(format!("{board}.x"));
    if let Err(error) = fs::copy(&map, out.join("board.x")) {
        stop(&format!("cannot copy {}: {error}", map.display()));
    }

    let source = describe(&here, kinds);
    if let Err(error) = fs::write(out.join("board_robot.rs"), source) {
        stop(&format!("cannot write board_robot.rs: {error}"));
    }

    // The linker finds the workspace's `memory.x` in cargo's working directory, and the `board.x` that it includes
    // here.
    println!("cargo:rustc-link-search={}", out.display());
    for script in ["link.x", "defmt.x"] {
        println!("cargo:rustc-link-arg-bin={board}=-T{script}");
    }
    // lld would otherwise fill page-sized gaps between segments, which probes then flash.
    println!("cargo:rustc-link-arg-bin={board}=--nmagic");
    if board == "an386" {
        // These programs do not log.
        for measuring in ["plan_cost", "step_cost", "feedback_cost"] {
            println!("cargo:rustc-link-arg-bin={measuring}=-Tlink.x");
        }
    }
}

/// Returns the robot that is built into the firmware, as Rust source. Stops the build if the robot file is invalid or
/// is for another board.
fn describe(here: &Path, kinds: &[BoardKind]) -> String {
    let name = env::var("GROWBOT_ROBOT").unwrap_or_else(|_| DEFAULT_ROBOT.to_string());
    let is_built_in = name != "none";
    let name = if is_built_in { name } else { DEFAULT_ROBOT.to_string() };
    // Cargo runs this in the package's folder, but a path is relative to the folder where cargo was called, which is
    // the workspace.
    let workspace = here.join("..");
    let file = if name.ends_with(".toml") {
        workspace.join(&name)
    } else {
        workspace.join("robots").join(format!("{name}.toml"))
    };
    println!("cargo:rerun-if-changed={}", file.display());
    let text = fs::read_to_string(&file).unwrap_or_else(|error| {
        stop(&format!("cannot read the robot {}: {error}; set GROWBOT_ROBOT to another robot", file.display()))
    });
    let description =
        toml::from_str(&text).unwrap_or_else(|error| stop(&format!("{} is no robot file: {error}", file.display())));
    let robot = Robot::new(description).unwrap_or_else(|error| stop(&format!("{}: {error}", file.display())));
    robot.check_for_board().unwrap_or_else(|error| stop(&format!("{}: {error}", file.display())));
    if let Some(kind) = robot.description().board.map(|board| board.kind)
        && !kinds.is_empty()
        && !kinds.contains(&kind)
    {
        stop(&format!("{}: its board.kind is {kind}: build the firmware of that board", file.display()));
    }
    as_source(&robot, is_built_in)
}

/// Returns a robot as Rust source, so that the board does not have to decode and check a description.
fn as_source(robot: &Robot, is_built_in: bool) -> String {
    let description = format!("{:?}", robot.description());
    // The output of the derived `Debug` is an expression, except for the name and for variants without their enum.
    let name = format!("name: {:?}", robot.name());
    let description = description
        .replace(&name, &format!("name: String::try_from({:?}).unwrap_or_default()", robot.name()))
        .replace("strategy: ", "strategy: FeedStrategy::")
        .replace("turning: ", "turning: HeadRotation::")
        .replace("kind: ", "kind: BoardKind::")
        .replace("mode: ", "mode: ChopperMode::");
    let robot = format!("Robot::from_checked({description}, {})", robot.hash());
    format!("BoardRobot {{ robot: {robot}, configured: {is_built_in} }}\n")
}

fn feature(name: &str) -> bool {
    env::var_os(format!("CARGO_FEATURE_{name}")).is_some()
}

fn directory(variable: &str) -> Option<PathBuf> {
    env::var_os(variable).map(|path| Path::new(&path).to_path_buf())
}

fn stop(message: &str) -> ! {
    eprintln!("error: {message}");
    process::exit(1)
}
