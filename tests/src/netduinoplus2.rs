//! Boots the robot's own image, unmodified, on QEMU's netduinoplus2 (an STM32F405).
//!
//! QEMU's clock controller is plain storage on this machine. Nothing in it ever becomes ready, so firmware that sets
//! its clocks waits forever. Therefore the emulator starts halted. The tests set the bits that hardware would set, and
//! only then the board runs.
//!
//! This covers start-up, clocks, interrupts, SysTick and the link. It does not cover timing, pins, the ADC and the
//! watchdog, because timers run at another rate and the rest is absent. The emulator's trace still shows what the
//! firmware writes to their registers.

use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

use growbot_sim::port::qemu::{Qemu, QemuError, QemuSocket, doing};

/// Clock control register.
pub const RCC_CR: u32 = 0x4002_3800;
/// Value of the clock control register while the internal oscillator is on, as after reset, and the PLL is ready.
const CLOCKS_READY: u32 = 0x0200_0083;
/// Bit of the clock control register that reports a ready crystal (HSERDY).
const CRYSTAL_READY: u32 = 1 << 17;
/// Clock configuration register, and the value that reports the PLL as system clock.
const RCC_CFGR: (u32, u32) = (0x4002_3808, 0x0000_0008);

/// Timeout of a response from QEMU.
const ANSWER: Duration = Duration::from_secs(120);

/// Options of the emulated board.
#[derive(Debug, Clone, Default)]
pub struct Setup {
    /// True if the crystal never gets ready.
    pub without_crystal: bool,
    /// File for a trace of all writes to registers, see [`writes`]. `None` writes no trace.
    pub trace: Option<PathBuf>,
}

/// A running board. Dropping it kills the emulator.
pub struct Board {
    _qemu: Qemu,
    // This connection stays open because QEMU ends when it closes.
    control: TcpStream,
    registers: TcpStream,
    /// USART2, the robot's link.
    pub link: TcpStream,
}

impl Board {
    /// Writes a register from outside, as hardware would.
    ///
    /// # Errors
    /// Returns an error if the emulator does not respond.
    pub fn write(&self, address: u32, value: u32) -> Result<(), QemuError> {
        self.command(&format!("writel {address:#x} {value:#x}"))
    }

    /// Sets the registers that report ready clocks, with the crystal or without it. A reset of the board clears them.
    ///
    /// # Errors
    /// Returns an error if the emulator does not respond.
    pub fn make_clocks_ready(&self, crystal: bool) -> Result<(), QemuError> {
        self.write(RCC_CR, CLOCKS_READY | if crystal { CRYSTAL_READY } else { 0 })?;
        let (address, value) = RCC_CFGR;
        self.write(address, value)
    }

    /// Raises the non-maskable interrupt. On the robot's board the clock security system raises it when the crystal has
    /// stopped.
    ///
    /// # Errors
    /// Returns an error if the emulator does not respond.
    pub fn raise_nmi(&self) -> Result<(), QemuError> {
        // ICSR, NMIPENDSET.
        self.write(0xE000_ED04, 1 << 31)
    }

    fn command(&self, command: &str) -> Result<(), QemuError> {
        ask(&self.registers, &mut reader(&self.registers)?, command, "OK", "FAIL")
    }
}

/// A write to a register.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RegisterWrite {
    /// Address of the register.
    pub address: u32,
    /// Value that was written.
    pub value: u32,
}

/// Returns the writes to registers in a trace, in order. An incomplete line is left out.
pub fn writes(trace: &str) -> Vec<RegisterWrite> {
    let whole = trace.rsplit_once('\n').map_or("", |(whole, _)| whole);
    let lines = whole.lines().filter(|line| line.contains("memory_region_ops_write"));
    lines
        .filter_map(|line| Some(RegisterWrite { address: number(line, "addr")?, value: number(line, "value")? }))
        .collect()
}

/// Returns the hexadecimal number after a word in a line of the trace.
fn number(line: &str, word: &str) -> Option<u32> {
    let mut words = line.split_ascii_whitespace().skip_while(|found| *found != word);
    u64::from_str_radix(words.nth(1)?.strip_prefix("0x")?, 16).ok().map(|number| number as u32)
}

/// Boots a firmware image and returns once the processor runs.
///
/// # Errors
/// Returns an error if QEMU is missing or fails.
pub fn boot(firmware: &Path) -> Result<Board, QemuError> {
    boot_with(firmware, &Setup::default())
}

/// Boots a firmware image on a board with these options.
///
/// # Errors
/// Returns the same errors as [`boot`].
pub fn boot_with(firmware: &Path, setup: &Setup) -> Result<Board, QemuError> {
    let trace = setup.trace.as_ref().map(|file| file.to_string_lossy().into_owned());
    let (serial, control, registers) =
        (QemuSocket::open("serial line")?, QemuSocket::open("control line")?, QemuSocket::open("register line")?);
    let (serial_to, control_to, registers_to) = (serial.argument()?, control.argument()?, registers.argument()?);
    let mut arguments = vec![
        // USART1 is not used, because in QEMU 10.0 the reset of any peripheral on its bus ends the emulator.
        "-serial",
        "null",
        "-serial",
        &serial_to,
        "-S",
        "-accel",
        "tcg",
        "-qtest",
        &registers_to,
        "-qtest-log",
        "none",
        "-qmp",
        &control_to,
    ];
    if let Some(file) = &trace {
        arguments.extend(["-trace", "memory_region_ops_write", "-D", file]);
    }
    let mut qemu = Qemu::start("netduinoplus2", firmware, arguments)?;
    let link = qemu.connect(&serial)?;
    let registers = qemu.connect(&registers)?;
    let control = qemu.connect(&control)?;

    let board = Board { _qemu: qemu, control, registers, link };
    board.make_clocks_ready(!setup.without_crystal)?;
    let control = &board.control;
    let mut answers = reader(control)?;
    for command in [r#"{"execute":"qmp_capabilities"}"#, r#"{"execute":"cont"}"#] {
        // Events may come between the greeting and the responses. They begin with other text.
        ask(control, &mut answers, command, r#"{"return""#, r#"{"error""#)?;
    }
    Ok(board)
}

fn reader(stream: &TcpStream) -> Result<BufReader<TcpStream>, QemuError> {
    stream.set_read_timeout(Some(ANSWER)).map_err(doing("set up the emulator's line"))?;
    stream.try_clone().map(BufReader::new).map_err(doing("share the emulator's line"))
}

/// Sends a command and waits for its response. Other lines are skipped.
fn ask(mut to: &TcpStream, from: &mut impl BufRead, command: &str, yes: &str, no: &str) -> Result<(), QemuError> {
    writeln!(to, "{command}").map_err(doing("send the emulator a command"))?;
    loop {
        let mut answer = String::new();
        let length = from.read_line(&mut answer).map_err(doing("read the emulator's answer"))?;
        if answer.starts_with(yes) {
            return Ok(());
        }
        if length == 0 || answer.starts_with(no) {
            return Err(QemuError::Refused(command.to_string(), answer.trim().to_string()));
        }
    }
}
