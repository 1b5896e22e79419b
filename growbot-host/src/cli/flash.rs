//! `growbot flash`: puts the firmware on a robot's board, through a debug probe or as a UF2 file.
//!
//! Two tools do the work, cargo and probe-rs. Their output goes straight to the terminal, and Ctrl-C reaches them too.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{fmt, fs, io};

use clap::{Args, ValueEnum};
use growbot_core::robot::{BoardDescription, BoardKind, Robot};
use growbot_host::output::print;
use growbot_host::{note, warning};
use growbot_plan::robot_file;
use growbot_sim::image_seal::{self, SealError};
use growbot_sim::uf2;

use super::failure::Failure;
use super::robot_arg::RobotArg;
use super::uf2_drive;

/// The robot's processor, by its name in probe-rs.
const CHIP: &str = "STM32F405RGTx";
/// Options that let the board run on after a fault or a reset of its processor. If the probe halted the processor, the
/// board could not make the tip safe.
const NO_VECTOR_CATCH: [&str; 2] = ["--no-catch-reset", "--no-catch-hardfault"];
/// Note about the last step, which the user does by hand.
const POWER_CYCLE: &str = "after flashing, unplug the probe and disconnect the board's power for a moment: a probe \
                           leaves the processor in debug mode, in which the firmware does not heat";
/// Path of the firmware image in cargo's target directory.
const IMAGE: &str = "thumbv7em-none-eabihf/firmware/stm32f405";

/// The boards that can be flashed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
enum FlashTarget {
    /// The robot's board, through a debug probe
    #[default]
    Stm32f405,
    /// The Raspberry Pi Pico, by a UF2 file (experimental)
    Pico,
    /// The BTT SKR Pico, by a UF2 file (experimental)
    SkrPico,
}

impl FlashTarget {
    /// Returns the cargo alias that builds the firmware image of the board.
    fn build(self) -> &'static str {
        match self {
            Self::Stm32f405 => "build-stm32f405",
            Self::Pico | Self::SkrPico => "build-pico",
        }
    }

    /// Returns the path of the image in cargo's target directory.
    fn image(self) -> &'static str {
        match self {
            Self::Stm32f405 => IMAGE,
            Self::Pico | Self::SkrPico => "thumbv6m-none-eabi/firmware/pico",
        }
    }

    /// Returns the instruction for the user that makes the board appear as a USB drive.
    fn way_to_drive(self) -> &'static str {
        match self {
            Self::SkrPico => "set the jumper BOOT and press RESET",
            _ => "hold BOOTSEL while you plug the board in",
        }
    }

    fn kind(self) -> BoardKind {
        match self {
            Self::Stm32f405 => BoardKind::Stm32f405,
            Self::Pico => BoardKind::Pico,
            Self::SkrPico => BoardKind::SkrPico,
        }
    }

    /// Returns the value of `GROWBOT_ROBOT` for the build: the robot that the image is built for. If the description
    /// does not name a board, an image for an SKR Pico is built for `none`, because the signals would be wrong. Its
    /// board is configured once it runs.
    fn built_for(self, robot: &Robot, name: &Path) -> Result<OsString, Failure> {
        match robot.description().board {
            Some(BoardDescription { kind, .. }) if kind != self.kind() => Err(Failure::bad_input(format!(
                "{}: board.kind is {kind} in this robot's description, but --board is {}: give the same board in both",
                robot.name(),
                self.kind()
            ))),
            None if self == Self::SkrPico => Ok("none".into()),
            _ => named(name),
        }
    }
}

/// Put the firmware on a robot's board, through a debug probe or as a UF2 file
///
/// In growbot's source tree the command first builds the firmware for the given robot. Elsewhere, give a firmware
/// image. The image gets a seal, which the board checks at each start. A board with a damaged image does not heat. Then
/// probe-rs writes the image to the board and shows its log, until Ctrl-C. Afterwards take the board's power away for a
/// moment, because a probe leaves the processor in debug mode, in which the firmware does not heat.
///
/// A Pico needs no probe. Plugged in with BOOTSEL held (an SKR Pico: with the BOOT jumper set) it is a drive, to which
/// a UF2 file is copied. If the robot file does not name its board, an SKR Pico gets an image for no robot, and its
/// robot by `growbot configure`.
#[derive(Args)]
#[command(
    after_help = "Examples:\n  growbot flash --robot growbot-b\n  growbot flash --firmware stm32f405 --no-log\n  \
                  growbot flash --board skr-pico\n  growbot flash --board pico --firmware pico.uf2\n\nRequires a \
                  debug probe and probe-rs (cargo install probe-rs-tools --locked)."
)]
pub struct FlashArgs {
    #[command(flatten)]
    robot: RobotArg,
    /// Write this image, an ELF or UF2 file, and build nothing (the robot is the one it was built for)
    #[arg(long, value_name = "FILE", conflicts_with = "robot")]
    firmware: Option<PathBuf>,
    /// The board
    #[arg(long, value_enum, default_value_t)]
    board: FlashTarget,
    /// Write the UF2 file here, for you to copy, instead of flashing (pico and skr-pico only)
    #[arg(long, value_name = "FILE", conflicts_with_all = ["no_log", "seal_only", "drive"])]
    uf2: Option<PathBuf>,
    /// Drive of a pico or skr-pico [default: the one that is mounted as RPI-RP2]
    #[arg(long, value_name = "DIR", conflicts_with_all = ["no_log", "seal_only"])]
    drive: Option<PathBuf>,
    /// Start the firmware and leave without showing its log
    #[arg(long)]
    no_log: bool,
    /// Only seal the image, so that the board can check it, and flash nothing
    #[arg(long, conflicts_with = "no_log")]
    seal_only: bool,
    /// Print the commands that would be run
    #[arg(long)]
    dry_run: bool,
}

/// Runs the command.
pub fn run(args: &FlashArgs) -> Result<(), Failure> {
    let is_drive = args.board != FlashTarget::Stm32f405;
    if !is_drive && (args.uf2.is_some() || args.drive.is_some()) {
        return Err(Failure::bad_input(
            "--uf2 and --drive apply only to boards that take UF2 files: pass --board pico or --board skr-pico",
        ));
    }
    let (build, image) = match &args.firmware {
        Some(image) => (None, image.clone()),
        None => {
            let build = ToolRun::build(&args.robot, args.board)?;
            let image = build.target().join(args.board.image());
            (Some(build), image)
        }
    };
    // The image in a UF2 file is sealed already.
    let is_uf2 = args.firmware.as_ref().is_some_and(|file| fs::read(file).is_ok_and(|bytes| uf2::is_uf2(&bytes)));
    if is_uf2 && (args.seal_only || !is_drive) {
        return Err(Failure::bad_input(format!(
            "{} is a UF2 file, which only --board pico and skr-pico take, and a UF2 file cannot be sealed: give the \
             ELF image, or pass --board pico or skr-pico without --seal-only",
            image.display()
        )));
    }
    let flash = if args.seal_only || is_drive { Vec::new() } else { ToolRun::flash(&image, args.no_log) };
    if args.dry_run {
        let seal = format!("growbot flash --seal-only --firmware {}\n", quoted(image.as_os_str()));
        let seal = if is_uf2 { "" } else { &seal };
        let [build, flash] = [&build.into_iter().collect(), &flash]
            .map(|steps: &Vec<ToolRun>| steps.iter().map(|step| format!("{step}\n")).collect::<String>());
        return Ok(print(&format!("{build}{seal}{flash}"))?);
    }
    if let Some(build) = build {
        build.run()?;
    }
    if !image.is_file() {
        let what = if args.firmware.is_some() {
            "give the ELF image that cargo builds"
        } else {
            "cargo did not build this image"
        };
        return Err(Failure::bad_input(format!("firmware image {} not found: {what}", image.display())));
    }
    if !is_uf2 {
        match image_seal::seal_in_place(&image) {
            Ok(crc) => note!("sealed {}, CRC {crc:08x}", image.display()),
            Err(error @ SealError::NoImage { .. }) if !args.seal_only => {
                warning!(
                    "{error}; the image is flashed without a seal, so the board cannot check whether it is intact"
                );
            }
            Err(error) => return Err(Failure::before_start(&error)),
        }
    }
    if args.seal_only {
        return Ok(());
    }
    if is_drive {
        return uf2_drive::write(&image, args.uf2.as_deref(), args.drive.as_deref(), args.board.way_to_drive());
    }
    if args.no_log {
        flash.iter().try_for_each(ToolRun::run)?;
        note!("{POWER_CYCLE}");
        return Ok(());
    }
    // The note is printed first, because Ctrl-C ends the log and this program.
    note!("{POWER_CYCLE}");
    flash.iter().try_for_each(ToolRun::run)
}

/// Returns the paths of the firmware images that cargo builds in this source tree. The files need not exist.
pub fn built_images() -> Vec<PathBuf> {
    let target = target_in(&source_tree().unwrap_or_else(|| ".".into()));
    [IMAGE, growbot_sim::port::emulator::FIRMWARE_PATH].map(|image| target.join(image)).into()
}

/// Returns cargo's target directory if cargo runs in this directory.
fn target_in(directory: &Path) -> PathBuf {
    directory.join(std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into()))
}

/// A run of a tool, which is cargo or probe-rs.
struct ToolRun {
    tool: &'static str,
    /// Instructions to install the tool.
    remedy: &'static str,
    /// Meaning of a failure of the tool.
    failed: &'static str,
    arguments: Vec<OsString>,
    robot: Option<OsString>,
    directory: Option<PathBuf>,
}

impl ToolRun {
    /// Returns the step that builds the firmware for a robot.
    fn build(robot: &RobotArg, board: FlashTarget) -> Result<Self, Failure> {
        // An invalid robot is reported before the build, which takes a minute.
        let (name, robot) = (robot.name()?, robot.load()?);
        let checked = robot.check_for_board();
        checked.map_err(|error| Failure::bad_input(format!("{}: {error}", name.display())))?;
        let built_for = board.built_for(&robot, &name)?;
        let directory = source_tree().ok_or_else(|| {
            Failure::bad_input(
                "this directory is not growbot's source tree, so there is nothing to build: give an image with \
                 --firmware, or change to the source tree",
            )
        })?;
        Ok(Self {
            tool: "cargo",
            remedy: "install Rust, https://rustup.rs",
            failed: "building the firmware failed",
            arguments: vec![board.build().into()],
            robot: Some(built_for),
            directory: Some(directory),
        })
    }

    /// Returns the steps that write an image to the board and start it.
    fn flash(image: &Path, no_log: bool) -> Vec<Self> {
        let probe_rs = |subcommand: &str, options: &[&str], image: Option<&Path>| {
            let arguments = [subcommand, "--chip", CHIP].into_iter().chain(options.iter().copied()).map(OsString::from);
            Self {
                tool: "probe-rs",
                remedy: "install it with `cargo install probe-rs-tools --locked`",
                failed: "flashing the board failed, or the board's log was interrupted: check that the probe is \
                         connected and the board has power",
                arguments: arguments.chain(image.map(|image| image.as_os_str().to_owned())).collect(),
                robot: None,
                directory: None,
            }
        };
        if no_log {
            // A download alone leaves the processor halted.
            vec![probe_rs("download", &[], Some(image)), probe_rs("reset", &[], None)]
        } else {
            vec![probe_rs("run", &NO_VECTOR_CATCH, Some(image))]
        }
    }

    /// Returns cargo's target directory, for a step of cargo.
    fn target(&self) -> PathBuf {
        target_in(self.directory.as_deref().unwrap_or(Path::new(".")))
    }

    fn run(&self) -> Result<(), Failure> {
        let Self { tool, remedy, failed, .. } = self;
        note!("{self}");
        let mut command = Command::new(tool);
        command.args(&self.arguments);
        if let Some(robot) = &self.robot {
            command.env("GROWBOT_ROBOT", robot);
        }
        if let Some(directory) = &self.directory {
            command.current_dir(directory);
        }
        match command.status() {
            Ok(status) if status.success() => Ok(()),
            // probe-rs may have changed the board, cargo has not.
            Ok(status) if *tool == "probe-rs" => {
                Err(Failure::request_failed(format!("{tool} failed ({status}): {failed}")))
            }
            Ok(status) => Err(Failure::bad_input(format!("{tool} failed ({status}): {failed}"))),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                Err(Failure::bad_input(format!("{tool} is not on the PATH: {remedy}")))
            }
            Err(error) => Err(Failure::bad_input(format!("cannot run {tool}: {error}"))),
        }
    }
}

impl fmt::Display for ToolRun {
    /// Formats the step as a line for a shell.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(directory) = &self.directory {
            write!(f, "cd {} && ", quoted(directory.as_os_str()))?;
        }
        if let Some(robot) = &self.robot {
            write!(f, "GROWBOT_ROBOT={} ", quoted(robot))?;
        }
        write!(f, "{}", self.tool)?;
        self.arguments.iter().try_for_each(|argument| write!(f, " {}", quoted(argument)))
    }
}

/// Quotes a word for a shell.
fn quoted(word: &OsStr) -> String {
    let word = word.to_string_lossy();
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./:@%+=,".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.into_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

/// Returns the value of `GROWBOT_ROBOT`: a built-in name, or the absolute path of a file, because cargo runs elsewhere.
fn named(robot: &Path) -> Result<OsString, Failure> {
    if robot.to_str().is_some_and(robot_file::is_built_in) {
        return Ok(robot.as_os_str().to_owned());
    }
    if robot.extension() != Some(OsStr::new("toml")) {
        return Err(Failure::bad_input(format!(
            "the name of the robot file {} must end in .toml, because the firmware is built for it: rename the file",
            robot.display()
        )));
    }
    let whole = robot.canonicalize();
    whole.map(PathBuf::into_os_string).map_err(|error| Failure::bad_input(format!("{}: {error}", robot.display())))
}

/// Returns the source tree that contains the current directory.
fn source_tree() -> Option<PathBuf> {
    let here = std::env::current_dir().ok()?;
    here.ancestors().find(|folder| folder.join("growbot-firmware/Cargo.toml").is_file()).map(Path::to_path_buf)
}
