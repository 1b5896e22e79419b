//! Costs of the step interrupt on the microcontroller, as a table: `cargo step-cost`. The table lists each kind of
//! tick, the step rate that it allows, and an emergency stop by the link.
//!
//! The test builds the program that measures it (`growbot-firmware/benches/step/`) and runs it in the emulator. The
//! emulator counts each instruction, so the figures are the same on every machine. They are instructions. The time on
//! the robot's board is computed from them with a conservative estimate.

use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use growbot_core::link::emergency_stop::EMERGENCY_STOP;
use growbot_core::link::frame::MAX_FRAME_LEN;
use growbot_sim::port::qemu::{Qemu, QemuSocket};
use growbot_tests::{build_image, firmware};

/// Clock of the robot's board, Hz.
const CLOCK_HZ: f64 = 168e6;
/// Cycles of an instruction: 1.2 by itself and 1.3 for its fetch. A Cortex-M4 takes one cycle, or two for a load or the
/// refill after a taken branch. The fetch assumes that no line is ever in the flash's cache: 5 wait states and an
/// access for 16 bytes, about five instructions.
const CYCLES: f64 = 2.5;
/// Cycles of each interrupt besides the tick: entry and exit, 12 each, and 30 instructions that acknowledge the timer
/// and save registers. The tick computes no floats, so the processor's lazy stacking never saves their registers.
const AROUND: f64 = 24.0 + 30.0 * CYCLES;
/// Max fraction of the processor's time for the step interrupt. The rest is for the controller and the link.
const SHARE: f64 = 0.5;
/// Min tick rate, Hz: 10,000 steps per second on each axis, because a step takes two ticks.
const TICK_HZ: f64 = 20_000.0;
/// Max instructions of an idle tick. They include a check for a turn of the head between jobs.
const IDLE: u32 = 84;

/// Max instructions from the last byte of an emergency stop until heater and drivers are off, including a step tick
/// that comes before it.
const STOP: u32 = 2_000;

/// Timeout of the board's next line.
const NEXT: Duration = Duration::from_secs(120);

/// All ticks of one kind.
struct Row {
    turns: String,
    tick: String,
    count: u32,
    worst: u32,
}

impl Row {
    fn cycles(&self) -> f64 {
        f64::from(self.worst) * CYCLES + AROUND
    }

    /// Returns the tick rate at which a sequence of such ticks takes the allowed fraction of the processor's time.
    fn tick_hz(&self) -> f64 {
        SHARE * CLOCK_HZ / self.cycles()
    }
}

fn measure() -> Vec<Row> {
    let line = QemuSocket::open("serial line").unwrap();
    let serial = line.argument().unwrap();
    let arguments = ["-icount", "shift=10,sleep=off", "-serial", &serial];
    let mut qemu = Qemu::start("mps2-an386", &firmware("step_cost"), arguments).unwrap();
    let stream = qemu.connect(&line).unwrap();
    stream.set_read_timeout(Some(NEXT)).unwrap();
    let enough = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| send_stops(&stream, &enough));
        let rows = read_rows(&stream, &enough);
        enough.store(true, Ordering::Relaxed);
        rows.unwrap_or_else(|| panic!("the board ended before its last tick: {}", qemu.messages()))
    })
}

/// Sends emergency stops after noise until there are enough. The last byte of each stop is sent by itself.
fn send_stops(mut line: &TcpStream, enough: &AtomicBool) {
    for length in (0..MAX_FRAME_LEN).cycle() {
        if enough.load(Ordering::Relaxed) {
            return;
        }
        let noise = (0..length).map(|byte| byte as u8 | 1);
        let bytes: Vec<u8> = noise.chain(EMERGENCY_STOP).collect();
        let Some((last, before)) = bytes.split_last() else { return };
        // The reader reports a board that has ended.
        let _ = line.write_all(before);
        thread::sleep(Duration::from_millis(2));
        let _ = line.write_all(&[*last]);
        thread::sleep(Duration::from_millis(2));
    }
}

/// Reads all rows. `None` if the board ends before the last one. The board measures stops before it prints anything.
fn read_rows(line: &TcpStream, enough: &AtomicBool) -> Option<Vec<Row>> {
    let mut rows = Vec::new();
    for line in BufReader::new(line).lines() {
        enough.store(true, Ordering::Relaxed);
        let line = line.ok()?;
        if line == "end" {
            return Some(rows);
        }
        let [turns, tick, count, worst] = line.split(',').collect::<Vec<_>>()[..] else {
            panic!("the board answer: {line}");
        };
        rows.push(Row {
            turns: turns.to_owned(),
            tick: tick.to_owned(),
            count: count.parse().unwrap(),
            worst: worst.parse().unwrap(),
        });
    }
    None
}

#[test]
fn the_step_interrupt_fits_its_processor_budget() {
    build_image("build-step-cost");
    let (stops, ticks): (Vec<Row>, Vec<Row>) = measure().into_iter().partition(|row| row.turns == "link");
    let rows: Vec<Row> = ticks.into_iter().filter(|row| row.count > 0).collect();
    println!("{:<18} {:<12} {:>8} {:>14} {:>8} {:>12}", "turns", "tick", "ticks", "instr., worst", "us", "ticks/s");
    for row in &rows {
        let us = row.cycles() / CLOCK_HZ * 1e6;
        println!(
            "{:<18} {:<12} {:>8} {:>14} {:>8.2} {:>12.0}",
            row.turns,
            row.tick,
            row.count,
            row.worst,
            us,
            row.tick_hz()
        );
    }
    let slowest = rows.iter().map(Row::tick_hz).fold(f64::INFINITY, f64::min);
    println!("even if every tick were the worst: {slowest:.0} ticks/s, {:.0} steps/s on each axis", slowest / 2.0);

    let [stop] = &stops[..] else { panic!("the board has measured no emergency stop") };
    let tick = rows.iter().map(|row| row.worst).max().unwrap_or_default();
    println!(
        "an emergency stop by the link, worst of {}: {} instructions from its last byte to heater and drivers off, {} behind the worst tick",
        stop.count,
        stop.worst,
        stop.worst + tick
    );

    assert!(stop.count > 0);
    assert!(
        stop.worst + tick < STOP,
        "an emergency stop takes {} instructions, and a tick before it {tick}",
        stop.worst
    );
    assert!(slowest >= TICK_HZ, "only {slowest:.0} ticks a second");
    for row in rows.iter().filter(|row| row.tick == "idle") {
        assert!(row.worst <= IDLE, "{}: an idle tick takes {} instructions", row.turns, row.worst);
    }
    for turns in ["feed", "speed", "feed with ramps", "speed with ramps"] {
        for tick in [
            "idle",
            "homing",
            "feed move",
            "turn taken",
            "no step",
            "head step",
            "feed step",
            "both steps",
            "halt",
            "emergency stop",
        ] {
            let seen = rows.iter().any(|row| row.turns == turns && row.tick == tick);
            assert!(seen, "nothing was measured of {tick}, {turns}");
        }
    }
}
