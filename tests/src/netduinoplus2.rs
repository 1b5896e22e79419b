//! Boots the robot's own image, unmodified, on QEMU's netduinoplus2 (an STM32F405).
//!
//! QEMU's clock controller is plain storage there: nothing in it ever becomes ready, and firmware that sets its clocks waits for
//! ever. So the emulator is started halted, the bits that hardware would set are set from outside, and only then the board runs.
//!
//! What this shows: start-up, clocks, interrupts, SysTick, and the link. What it cannot: timers run at a rate of their own, and pins,
//! the analog converter and the watchdog are absent.

use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::path::Path;
use std::time::Duration;

use growbot_host::port::qemu::{Line, Qemu, QemuError, doing};

/// Clock control register: both oscillators and the PLL ready, the internal one on as after reset.
const RCC_CR: (u32, u32) = (0x4002_3800, 0x0202_0083);
/// Clock configuration register: the PLL is the system clock.
const RCC_CFGR: (u32, u32) = (0x4002_3808, 0x0000_0008);

/// How long QEMU may take to answer a command.
const ANSWER: Duration = Duration::from_secs(120);

/// The running board; killed when dropped.
pub struct Board {
    _qemu: Qemu,
    // Held open: QEMU ends when they close.
    _control: TcpStream,
    _registers: TcpStream,
    /// USART2, the robot's link.
    pub link: TcpStream,
}

/// Boots a firmware image and returns once the processor runs.
pub fn boot(firmware: &Path) -> Result<Board, QemuError> {
    let (serial, control, registers) =
        (Line::open("serial line")?, Line::open("control line")?, Line::open("register line")?);
    let (serial_to, control_to, registers_to) = (serial.argument()?, control.argument()?, registers.argument()?);
    let arguments = [
        // USART1 is left alone: in QEMU 10.0 the reset of any peripheral on its bus ends the emulator.
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
    let mut qemu = Qemu::start("netduinoplus2", firmware, arguments)?;
    let link = qemu.connect(&serial)?;
    let registers = qemu.connect(&registers)?;
    let control = qemu.connect(&control)?;

    let mut answers = reader(&registers)?;
    for (address, value) in [RCC_CR, RCC_CFGR] {
        let command = format!("writel {address:#x} {value:#x}");
        ask(&registers, &mut answers, &command, "OK", "FAIL")?;
    }
    let mut answers = reader(&control)?;
    for command in [r#"{"execute":"qmp_capabilities"}"#, r#"{"execute":"cont"}"#] {
        // Between the greeting and the answers there may be events; they begin otherwise.
        ask(&control, &mut answers, command, r#"{"return""#, r#"{"error""#)?;
    }
    Ok(Board { _qemu: qemu, _control: control, _registers: registers, link })
}

fn reader(stream: &TcpStream) -> Result<BufReader<TcpStream>, QemuError> {
    stream.set_read_timeout(Some(ANSWER)).map_err(doing("set up the emulator's line"))?;
    stream.try_clone().map(BufReader::new).map_err(doing("share the emulator's line"))
}

/// Sends a command and waits for its answer, passing over whatever else comes.
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
