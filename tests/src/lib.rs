//! Code that the tests across crates share: paths of firmware images, the robot's board in the emulator, campaigns of
//! faults and long growths, interrupted growths, a slow search for shortest paths, and the table of pins.

pub mod fault_campaign;
pub mod netduinoplus2;
pub mod normal_growth;
pub mod recovery;
pub mod reference_search;
pub mod stack_depth;
pub mod tip_memory;
pub mod wiring;

use std::env;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Builds an image by one of the aliases in `.cargo/config.toml`.
///
/// # Panics
/// Panics if the build fails.
pub fn build_image(alias: &str) {
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let cargo = env::var_os("CARGO").unwrap_or("cargo".into());
    let status = Command::new(cargo).arg(alias).arg("--quiet").current_dir(workspace).status();
    assert!(status.is_ok_and(|status| status.success()), "the command `cargo {alias}` failed");
}

/// Returns the path of a board's image (`an386` or `stm32f405`), as `cargo build-an386` and `cargo build-stm32f405`
/// build it.
///
/// # Panics
/// Panics if the image has not been built, because a test without its image proves nothing.
pub fn firmware(board: &str) -> PathBuf {
    let image = target().join("thumbv7em-none-eabihf/firmware").join(board);
    assert!(
        image.is_file(),
        "the firmware image {} does not exist: run tests/run, or `cargo build-an386` and `cargo build-stm32f405`",
        image.display()
    );
    image
}

/// Returns the path of the Pico's image for a robot.
///
/// # Panics
/// Panics if the image has not been built.
pub fn pico_firmware(robot: &str) -> PathBuf {
    let image = target().join("thumbv6m-none-eabi/firmware").join(format!("pico-{robot}"));
    assert!(
        image.is_file(),
        "the firmware image {} does not exist: run tests/run, or `tests/rp2040/build` and `npm ci --prefix \
         tests/rp2040`",
        image.display()
    );
    image
}

fn target() -> PathBuf {
    env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../target"), PathBuf::from)
}
