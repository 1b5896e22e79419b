//! Writes of the robot's own image to registers that the emulator does not have: the watchdog, the clocks and the
//! heater's timer. They include the settings for a halt by a debug probe and for a stopped crystal.

use std::path::Path;
use std::thread::sleep;
use std::time::{Duration, Instant};

use growbot_client::client::Client;
use growbot_client::port::stream::Stream;
use growbot_core::link::message::{ResetCause, State};
use growbot_plan::robot_file;
use growbot_tests::netduinoplus2::{self, Board, RegisterWrite, Setup};
use growbot_tests::{firmware, wiring};

/// Timeout of the emulator.
const PATIENCE: Duration = Duration::from_secs(120);

const TIM1: u32 = 0x4001_0000;
const CR2: u32 = 0x04;
const CCR1: u32 = 0x34;
const BDTR: u32 = 0x44;
const WATCHDOG_KEY: u32 = 0x4000_3000;
const WATCHDOG_START: u32 = 0xCCCC;
const DBGMCU_APB1_FZ: u32 = 0xE004_2008;
const DBGMCU_APB2_FZ: u32 = 0xE004_200C;
const DEMCR: u32 = 0xE000_EDFC;
/// Register that resets the processor.
const AIRCR: u32 = 0xE000_ED0C;
/// Value of [`AIRCR`] that resets the processor.
const RESET_REQUEST: u32 = 0x05FA_0004;

struct Traced {
    board: Board,
    directory: tempfile::TempDir,
}

impl Traced {
    fn boot() -> Self {
        let directory = tempfile::tempdir().unwrap();
        let setup = Setup { trace: Some(directory.path().join("trace")), ..Setup::default() };
        let board = netduinoplus2::boot_with(&firmware("stm32f405"), &setup).unwrap();
        Self { board, directory }
    }

    fn writes(&self) -> Vec<RegisterWrite> {
        let trace: &Path = &self.directory.path().join("trace");
        netduinoplus2::writes(&std::fs::read_to_string(trace).unwrap())
    }

    fn client(&self) -> Client {
        let link = Stream::over("netduinoplus2".to_owned(), self.board.link.try_clone().unwrap()).unwrap();
        Client::new(Box::new(link), "netduinoplus2")
    }
}

fn to(writes: &[RegisterWrite], address: u32) -> Vec<u32> {
    writes.iter().filter(|write| write.address == address).map(|write| write.value).collect()
}

fn position(writes: &[RegisterWrite], what: &str, is_so: impl Fn(&RegisterWrite) -> bool) -> usize {
    writes.iter().position(is_so).unwrap_or_else(|| panic!("never: {what}"))
}

#[test]
fn a_halted_processor_is_reset_with_the_heater_off() {
    let traced = Traced::boot();
    let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
    let mut client = traced.client();
    client.open_session_for(&robot).unwrap();
    // The watchdog has been fed since. Probes change these registers, and each feed restores them.
    let began = Instant::now();
    while to(&traced.writes(), DBGMCU_APB1_FZ).len() < 3 {
        assert!(began.elapsed() < PATIENCE, "the watchdog is not fed");
        sleep(Duration::from_millis(50));
    }
    let writes = traced.writes();
    // DBG_TIM2_STOP alone. DBG_IWDG_STOP, bit 12, would stop the watchdog while a probe halts the processor.
    assert!(to(&writes, DBGMCU_APB1_FZ).iter().all(|value| *value == 1));
    // DBG_TIM1_STOP.
    assert!(to(&writes, DBGMCU_APB2_FZ).iter().all(|value| *value == 1));
    assert_eq!(to(&writes, DBGMCU_APB1_FZ).len(), to(&writes, DBGMCU_APB2_FZ).len());
    // No vector catch.
    assert!(to(&writes, DEMCR).iter().all(|value| value & 0x7F1 == 0) && !to(&writes, DEMCR).is_empty());
    // Without MOE, TIM1 drives its output (OSSI, bit 10) to OIS1 of CR2, which is 0 and never written. A break (BKE,
    // bit 12, active high: BKP, bit 13) clears MOE (bit 15). The clock security system causes one.
    assert_eq!(to(&writes, TIM1 + BDTR), [1 << 15 | 1 << 13 | 1 << 12 | 1 << 10]);
    assert!(to(&writes, TIM1 + CR2).is_empty());
    assert!(to(&writes, TIM1 + CCR1).iter().all(|duty| *duty == 0));
}

#[test]
fn clock_supervision_starts_before_the_clock_is_used() {
    let traced = Traced::boot();
    let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
    traced.client().open_session_for(&robot).unwrap();
    let writes = traced.writes();
    // The first writes come from the test.
    let watchdog = position(&writes, "the watchdog starts", |write| {
        (write.address, write.value) == (WATCHDOG_KEY, WATCHDOG_START)
    });
    let by_board =
        |write: &RegisterWrite, bit: u32| write.address == netduinoplus2::RCC_CR && write.value >> bit & 1 == 1;
    let crystal = position(&writes, "the crystal is switched on", |write| by_board(write, 16));
    let security = position(&writes, "the clock security system is switched on", |write| by_board(write, 19));
    let used = position(&writes, "the PLL is switched on", |write| by_board(write, 24));
    assert!(watchdog < crystal && crystal < security && security < used, "{watchdog} {crystal} {security} {used}");
}

#[test]
fn a_crystal_failure_switches_outputs_off_and_is_reported_after_reset() {
    let traced = Traced::boot();
    let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
    let mut client = traced.client();
    client.open_session_for(&robot).unwrap();
    let before = traced.writes().len();
    traced.board.raise_nmi().unwrap();
    let began = Instant::now();
    let resets = |write: &RegisterWrite| (write.address, write.value) == (AIRCR, RESET_REQUEST);
    while !traced.writes()[before..].iter().any(resets) {
        assert!(began.elapsed() < PATIENCE, "the board is not reset");
        sleep(Duration::from_millis(20));
    }
    let writes = traced.writes().split_off(before);
    let reset = position(&writes, "a reset", resets);
    let off = |signal: &str, high: bool| {
        let pin = wiring::pin_of(signal);
        let port = 0x4002_0000 + 0x400 * u32::from(pin.as_bytes()[1] - b'A');
        let number: u32 = pin[2..].parse().unwrap();
        let bit = 1 << if high { number } else { number + 16 };
        let at = position(&writes, signal, |write| write.address == port + 0x18 && write.value & bit != 0);
        assert!(at < reset, "{signal}");
    };
    off("heater second switch", false);
    let enable_low = robot.description().motion.enable_low;
    off("head EN", enable_low);
    off("feed EN", enable_low);
    let duty = position(&writes, "no duty", |write| (write.address, write.value) == (TIM1 + CCR1, 0));
    assert!(duty < reset);
    // The test makes the clocks ready again, as hardware would. The reset comes some time after its request and clears
    // the ready bits, so the test waits for it.
    let starts = |write: &RegisterWrite| (write.address, write.value) == (WATCHDOG_KEY, WATCHDOG_START);
    while !traced.writes()[before + reset..].iter().any(starts) {
        assert!(began.elapsed() < PATIENCE, "the board does not start again");
        sleep(Duration::from_millis(5));
    }
    traced.board.make_clocks_ready(true).unwrap();
    let hello = traced.client().open_session_for(&robot).unwrap();
    assert_eq!(hello.reset_cause, ResetCause::ClockFailed);
    assert!(matches!(hello.status.state, State::SelfTest | State::Fault), "{:?}", hello.status.state);
}
