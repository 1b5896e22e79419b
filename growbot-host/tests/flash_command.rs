//! Tests of `growbot flash` with fake flashing tools, which only record how they were called.
#![cfg(unix)]

use crate::running;

use std::fs::{self, File, Permissions};
use std::io::Read;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::PathBuf;
use std::thread;

use running::{PROGRAM, command};
use tempfile::TempDir;

/// Result of a run of `growbot flash`.
struct Ran {
    code: Option<i32>,
    out: String,
    err: String,
}

/// A directory with a source tree, a directory `bin` of fake tools, and the file `calls`, in which the tools record
/// their calls.
struct Bench(TempDir);

impl Bench {
    fn new() -> Self {
        let bench = Self(tempfile::tempdir().unwrap());
        for folder in ["bin", "tree/growbot-firmware", "tree/robots", "elsewhere"] {
            fs::create_dir_all(bench.path(folder)).unwrap();
        }
        fs::write(bench.path("tree/growbot-firmware/Cargo.toml"), "").unwrap();
        fs::write(bench.path("firmware.elf"), "an image").unwrap();
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        // The path as the command sees it, without links that lead to the directory for temporary files.
        self.0.path().canonicalize().unwrap().join(name)
    }

    fn text(&self, name: &str) -> String {
        self.path(name).into_os_string().into_string().unwrap()
    }

    /// Adds a fake tool that records its call and then runs the shell script `then`.
    fn tool(&self, name: &str, then: &str) {
        let script = format!(
            "#!/bin/sh\necho \"${{GROWBOT_ROBOT:+robot $GROWBOT_ROBOT: }}{name} $*\" >> '{}'\n{then}\n",
            self.text("calls")
        );
        let tool = self.path("bin").join(name);
        fs::write(&tool, script).unwrap();
        fs::set_permissions(&tool, Permissions::from_mode(0o755)).unwrap();
    }

    /// Adds a fake `cargo` that creates a firmware image at the same path as the real `cargo`.
    fn cargo(&self) {
        self.tool("cargo", "d=target/thumbv7em-none-eabihf/firmware; /bin/mkdir -p $d && echo image > $d/stm32f405");
    }

    fn calls(&self) -> String {
        fs::read_to_string(self.path("calls")).unwrap_or_default()
    }

    fn flash(&self, folder: &str, args: &[&str]) -> Ran {
        let output = command(PROGRAM)
            .arg("flash")
            .args(args)
            .current_dir(self.path(folder))
            .env("PATH", self.path("bin"))
            .env_remove("CARGO_TARGET_DIR")
            .env_remove("GROWBOT_ROBOT")
            .output()
            .unwrap();
        let [out, err] = [output.stdout, output.stderr].map(|answer| String::from_utf8(answer).unwrap());
        Ran { code: output.status.code(), out, err: running::in_lines(&err) }
    }
}

/// Checks for exit code 2, no output, and a last line of the messages that begins with "error: " and contains `parts`.
#[track_caller]
fn assert_refused(ran: &Ran, parts: &[&str]) {
    assert_error(ran, 2, parts);
}

fn assert_error(ran: &Ran, code: i32, parts: &[&str]) {
    assert_eq!((ran.code, ran.out.as_str()), (Some(code), ""), "{}", ran.err);
    let last = ran.err.lines().last().unwrap_or_default();
    assert!(last.starts_with("error: "), "{}", ran.err);
    for part in parts {
        assert!(last.contains(part), "no {part:?} in {last:?}");
    }
}

#[test]
fn a_given_image_is_flashed_without_building() {
    let bench = Bench::new();
    bench.cargo();
    bench.tool("probe-rs", "echo the log");
    let image = bench.text("firmware.elf");
    let ran = bench.flash("tree", &["--firmware", &image]);
    assert_eq!((ran.code, ran.out.as_str()), (Some(0), "the log\n"), "{}", ran.err);
    assert_eq!(
        bench.calls(),
        format!("probe-rs run --chip STM32F405RGTx --no-catch-reset --no-catch-hardfault {image}\n")
    );
}

#[test]
fn without_a_log_the_firmware_is_still_started() {
    let bench = Bench::new();
    bench.tool("probe-rs", "");
    let image = bench.text("firmware.elf");
    assert_eq!(bench.flash("elsewhere", &["--firmware", &image, "--no-log"]).code, Some(0));
    let calls = format!("probe-rs download --chip STM32F405RGTx {image}\nprobe-rs reset --chip STM32F405RGTx\n");
    assert_eq!(bench.calls(), calls);
}

#[test]
fn firmware_is_built_for_the_robot_in_the_source_tree() {
    let bench = Bench::new();
    bench.cargo();
    bench.tool("probe-rs", "");
    let image = bench.text("tree/target/thumbv7em-none-eabihf/firmware/stm32f405");
    let own = include_str!("../../robots/growbot-b.toml");
    fs::write(bench.path("tree/robots/my own.toml"), own).unwrap();
    let file = bench.text("tree/robots/my own.toml");
    for (robot, named) in [("growbot-b", "growbot-b"), ("my own.toml", file.as_str())] {
        let _ = fs::remove_file(bench.path("calls"));
        let ran = bench.flash("tree/robots", &["--robot", robot]);
        assert_eq!(ran.code, Some(0), "{}", ran.err);
        let calls = format!(
            "robot {named}: cargo build-stm32f405\nprobe-rs run --chip STM32F405RGTx --no-catch-reset --no-catch-hardfault {image}\n"
        );
        assert_eq!(bench.calls(), calls);
    }
}

/// `cargo run-stm32f405` calls the flashing tool with the same arguments as `growbot flash`.
#[test]
fn the_cargo_runner_makes_the_same_call() {
    let config = include_str!("../../.cargo/config.toml");
    let bench = Bench::new();
    let ran = bench.flash("tree", &["--dry-run", "--firmware", "image"]);
    let call = ran.out.lines().last().unwrap().strip_suffix(" image").unwrap();
    assert!(config.contains(&format!("runner = \"{call}\"")), "{call}");
    assert!(call.contains("--no-catch-reset") && call.contains("--no-catch-hardfault"), "{call}");
}

#[test]
fn flashing_asks_for_a_power_cycle() {
    let bench = Bench::new();
    bench.tool("probe-rs", "");
    let image = bench.text("firmware.elf");
    for args in [&["--firmware", &image][..], &["--firmware", &image, "--no-log"]] {
        let ran = bench.flash("elsewhere", args);
        assert_eq!(ran.code, Some(0), "{}", ran.err);
        assert!(ran.err.contains("disconnect the board's power"), "{}", ran.err);
    }
}

#[test]
fn an_image_is_not_built_for_an_undrivable_robot() {
    let bench = Bench::new();
    bench.cargo();
    bench.tool("probe-rs", "");
    let ran = bench.flash("tree", &["--robot", "growbot-c"]);
    assert_refused(&ran, &["growbot-c", "motion.tick_hz is 1000000, above 100000", "only be simulated"]);
    assert_eq!(bench.calls(), "");
}

#[test]
fn a_dry_run_prints_the_commands() {
    let bench = Bench::new();
    bench.cargo();
    bench.tool("probe-rs", "");
    let tree = bench.text("tree");
    let ran = bench.flash("tree", &["--dry-run", "--robot", "growbot-b"]);
    let commands = format!(
        "cd {tree} && GROWBOT_ROBOT=growbot-b cargo build-stm32f405\ngrowbot flash --seal-only --firmware {tree}/target/thumbv7em-none-eabihf/firmware/stm32f405\nprobe-rs run --chip STM32F405RGTx --no-catch-reset --no-catch-hardfault {tree}/target/thumbv7em-none-eabihf/firmware/stm32f405\n"
    );
    assert_eq!((ran.code, ran.out.as_str()), (Some(0), commands.as_str()), "{}", ran.err);
    let ran = bench.flash("elsewhere", &["--dry-run", "--firmware", "an image", "--no-log"]);
    let commands = "growbot flash --seal-only --firmware 'an image'\nprobe-rs download --chip STM32F405RGTx 'an image'\nprobe-rs reset --chip STM32F405RGTx\n";
    assert_eq!(ran.out, commands);
    assert_eq!(bench.calls(), "", "nothing is run");
}

#[test]
fn an_unsealable_image_is_flashed_with_a_warning() {
    let bench = Bench::new();
    bench.tool("probe-rs", "");
    let image = bench.text("firmware.elf");
    let ran = bench.flash("elsewhere", &["--firmware", &image]);
    assert_eq!(ran.code, Some(0));
    for part in ["cannot be sealed", "not a 32-bit ELF file", "the board cannot check"] {
        assert!(ran.err.contains(part), "no {part:?} in {}", ran.err);
    }
    let calls = bench.calls();
    assert_refused(&bench.flash("elsewhere", &["--firmware", &image, "--seal-only"]), &["cannot be sealed"]);
    assert_eq!(bench.calls(), calls, "nothing is flashed");
}

#[test]
fn missing_tools_and_files_are_reported_with_remedies() {
    let bench = Bench::new();
    let image = bench.text("firmware.elf");
    assert_refused(
        &bench.flash("tree", &["--firmware", &image]),
        &["probe-rs", "cargo install probe-rs-tools --locked"],
    );
    assert_refused(&bench.flash("tree", &["--firmware", "nothing.elf"]), &["firmware image nothing.elf not found"]);
    assert_refused(&bench.flash("tree", &[]), &["cargo is not on the PATH", "rustup.rs"]);
    assert_refused(&bench.flash("elsewhere", &[]), &["source tree", "--firmware"]);
    assert_refused(&bench.flash("tree", &["--robot", "growbot-z"]), &["growbot-z"]);
    assert_eq!(bench.calls(), "");
}

#[test]
fn a_failing_tool_ends_the_command() {
    let bench = Bench::new();
    bench.tool("probe-rs", "exit 1");
    bench.tool("cargo", "exit 101");
    assert_refused(&bench.flash("tree", &[]), &["cargo failed", "101", "building the firmware failed"]);
    assert_eq!(bench.calls(), "robot growbot-a: cargo build-stm32f405\n");
    bench.tool("cargo", "");
    assert_refused(&bench.flash("tree", &[]), &["firmware image", "not found", "cargo did not build this image"]);
    let image = bench.text("firmware.elf");
    let ran = bench.flash("tree", &["--firmware", &image, "--no-log"]);
    assert_error(&ran, 1, &["probe-rs failed", "probe is connected"]);
    assert!(!bench.calls().contains("reset"), "{}", bench.calls());
}

#[test]
fn a_robot_cannot_be_combined_with_an_image() {
    let bench = Bench::new();
    let ran = bench.flash("tree", &["--firmware", "x", "--robot", "growbot-b"]);
    assert_eq!(ran.code, Some(2));
    assert!(ran.err.contains("cannot be used with"), "{}", ran.err);
    fs::write(bench.path("tree/robot"), include_str!("../../robots/growbot-b.toml")).unwrap();
    assert_refused(&bench.flash("tree", &["--robot", "robot"]), &["must end in .toml"]);
}

/// Returns an ELF file that has these bytes at the beginning of an RP2040's flash.
fn image_of_a_pico(bytes: &[u8]) -> Vec<u8> {
    let mut file = b"\x7fELF\x01\x01\x01\0\0\0\0\0\0\0\0\0\x02\0\x28\0".to_vec();
    let length = bytes.len() as u32;
    for word in [1, 0, 52, 0, 0, 52 | 32 << 16, 1, 0, 1, 84, 0x1000_0000, 0x1000_0000, length, length, 5, 4] {
        file.extend(u32::to_le_bytes(word));
    }
    file.extend(bytes);
    file
}

#[test]
fn a_pico_image_is_written_to_a_file_or_drive() {
    let bench = Bench::new();
    let (image, file, drive) = (bench.text("pico.elf"), bench.text("pico.uf2"), bench.text("elsewhere"));
    fs::write(&image, image_of_a_pico(&[0x5a; 300])).unwrap();
    let with = |more: &[&str]| bench.flash("elsewhere", &[&["--board", "pico", "--firmware", &image], more].concat());

    let ran = with(&["--uf2", &file]);
    assert_eq!((ran.code, ran.out.as_str()), (Some(0), ""), "{}", ran.err);
    assert!(ran.err.contains("hold BOOTSEL") && ran.err.contains("RPI-RP2"), "{}", ran.err);
    let written = fs::read(&file).unwrap();
    assert_eq!((written.len(), &written[..4]), (1024, &b"UF2\n"[..]));

    assert_refused(&with(&["--drive", &drive]), &["no drive RPI-RP2", "INFO_UF2.TXT", "--uf2 FILE"]);
    fs::write(bench.path("elsewhere/INFO_UF2.TXT"), "UF2 Bootloader v3.0\n").unwrap();
    let ran = with(&["--drive", &drive]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    assert_eq!(fs::read(bench.path("elsewhere/growbot.uf2")).unwrap(), written);
    assert_eq!(bench.calls(), "", "no tool is needed");

    // A UF2 file is accepted as an image, but only for these boards.
    fs::remove_file(bench.path("elsewhere/growbot.uf2")).unwrap();
    let released = |board: &str, more: &[&str]| {
        bench.flash("elsewhere", &[&["--board", board, "--firmware", &file], more].concat())
    };
    let ran = released("skr-pico", &["--drive", &drive]);
    assert_eq!((ran.code, ran.err.contains("warning")), (Some(0), false), "{}", ran.err);
    assert_eq!(fs::read(bench.path("elsewhere/growbot.uf2")).unwrap(), written);
    let ran = released("pico", &["--dry-run"]);
    assert_eq!((ran.code, ran.out.as_str()), (Some(0), ""), "{}", ran.err);
    assert_refused(&released("stm32f405", &[]), &["pico.uf2 is a UF2 file", "give the ELF image"]);
    assert_refused(&released("pico", &["--seal-only"]), &["pico.uf2 is a UF2 file", "give the ELF image"]);
    fs::write(&file, &written[..512]).unwrap();
    let refused = released("pico", &["--drive", &drive]);
    assert_refused(&refused, &["pico.uf2 cannot be flashed", "block 0 of 1", "download the file again"]);
    fs::write(&file, &written).unwrap();

    fs::write(&image, "no image").unwrap();
    assert_refused(&with(&["--uf2", &file]), &["pico.elf", "not a 32-bit ELF", "cargo build-pico"]);
    assert_eq!(fs::read(&file).unwrap(), written, "what was written before stays");
    assert_refused(&bench.flash("elsewhere", &["--firmware", &image, "--uf2", &file]), &["pass --board pico"]);
}

#[test]
fn a_failing_drive_is_distinguished_from_one_that_disappears() {
    let bench = Bench::new();
    let (image, drive) = (bench.text("pico.elf"), bench.text("elsewhere"));
    fs::write(&image, image_of_a_pico(&[0x5a; 300])).unwrap();
    let flash = || bench.flash("elsewhere", &["--board", "pico", "--firmware", &image, "--drive", &drive]);
    let (mark, file) = (bench.path("elsewhere/INFO_UF2.TXT"), bench.path("elsewhere/growbot.uf2"));
    fs::write(&mark, "").unwrap();

    // This drive takes everything, but cannot confirm the write.
    symlink("/dev/null", &file).unwrap();
    assert_error(&flash(), 1, &["cannot write", "growbot.uf2", "only a part of the file", "hold BOOTSEL"]);

    // This one cannot confirm it either, because it disappears when it has everything.
    fs::remove_file(&file).unwrap();
    assert!(command("mkfifo").arg(&file).status().unwrap().success());
    let board = thread::spawn(move || {
        let mut blocks = [0; 1024];
        File::open(&file).unwrap().read_exact(&mut blocks).unwrap();
        fs::remove_file(&mark).unwrap();
    });
    let ran = flash();
    board.join().unwrap();
    assert_eq!(ran.code, Some(0), "{}", ran.err);
}

#[test]
fn a_pico_image_is_built_in_the_source_tree() {
    let bench = Bench::new();
    let ran = bench.flash("tree", &["--board", "pico", "--robot", "growbot-b", "--dry-run"]);
    assert!(ran.out.contains("GROWBOT_ROBOT=growbot-b cargo build-pico\n"), "{}", ran.out);
    assert!(ran.out.contains("target/thumbv6m-none-eabi/firmware/pico\n"), "{}", ran.out);
    // A description without the signals' pins on an SKR Pico is not built into the image.
    let ran = bench.flash("tree", &["--board", "skr-pico", "--robot", "growbot-b", "--dry-run"]);
    assert!(ran.out.contains("GROWBOT_ROBOT=none cargo build-pico\n"), "{}", ran.out);
    let robot = fs::read_to_string("../robots/growbot-a.toml").unwrap() + "[board]\nkind = \"pico\"\n";
    fs::write(bench.text("tree/own.toml"), robot).unwrap();
    let ran = bench.flash("tree", &["--board", "skr-pico", "--robot", "own.toml", "--dry-run"]);
    assert_refused(&ran, &["board.kind is pico", "--board is skr-pico"]);
    assert!(!ran.out.contains("probe-rs"), "{}", ran.out);
}
