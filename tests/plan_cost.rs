//! Cost of planning on the microcontroller, as a table: `cargo plan-cost`.
//!
//! The test builds the program that measures it (`growbot-firmware/benches/plan/`) and runs it in the emulator. The
//! emulator counts each instruction, so the figures are the same on every machine. They are instructions, not cycles: a
//! Cortex-M4 takes somewhat more cycles.

use std::io::{BufRead, BufReader};
use std::time::Duration;

use growbot_sim::port::qemu::{Qemu, QemuSocket};
use growbot_tests::{build_image, firmware};

/// Max median of the instructions of the planar planner for random goals.
const PLANAR_INSTRUCTIONS: u64 = 35_000;
/// Max median of the instructions of the shortest path for goals at 4 radii or more, for which no helicoidal arcs are
/// searched.
const SHORTEST_INSTRUCTIONS: u64 = 1_600_000;
/// Max stack of a planar or two-plane plan, bytes: a sixteenth of the robot's memory.
const STACK: u64 = 8 * 1024;
/// Max stack of the shortest path, bytes. It includes the list of candidates, 1.4 kB, and 1 kB of the result.
const SHORTEST_STACK: u64 = 10 * 1024;
/// Max stack of the shortest path with helicoidal arcs, bytes.
const HELICOIDS_STACK: u64 = 14 * 1024;

/// Max time until the program prints the result of the next plan. A plan takes milliseconds.
const NEXT: Duration = Duration::from_secs(300);

/// All plans of one planner for one kind of goals.
struct Row {
    planner: String,
    goals: String,
    instructions: Vec<u64>,
    stack: u64,
}

impl Row {
    fn median(&self) -> u64 {
        let mut sorted = self.instructions.clone();
        sorted.sort_unstable();
        sorted[sorted.len() / 2]
    }

    fn worst(&self) -> u64 {
        self.instructions.iter().copied().max().unwrap_or(0)
    }
}

fn measure() -> Vec<Row> {
    let line = QemuSocket::open("serial line").unwrap();
    let serial = line.argument().unwrap();
    let arguments = ["-icount", "shift=10,sleep=off", "-serial", &serial];
    let mut qemu = Qemu::start("mps2-an386", &firmware("plan_cost"), arguments).unwrap();
    let stream = qemu.connect(&line).unwrap();
    stream.set_read_timeout(Some(NEXT)).unwrap();

    let mut rows: Vec<Row> = Vec::new();
    for line in BufReader::new(stream).lines() {
        let line = line.unwrap();
        if line == "end" {
            return rows;
        }
        let [planner, goals, instructions, stack] = line.split(',').collect::<Vec<_>>()[..] else {
            panic!("the board answer: {line}");
        };
        let (instructions, stack) = (instructions.parse().unwrap(), stack.parse().unwrap());
        match rows.last_mut() {
            Some(row) if row.planner == planner && row.goals == goals => {
                row.instructions.push(instructions);
                row.stack = row.stack.max(stack);
            }
            _ => rows.push(Row {
                planner: planner.to_owned(),
                goals: goals.to_owned(),
                instructions: vec![instructions],
                stack,
            }),
        }
    }
    panic!("the board ended before its last plan: {}", qemu.messages());
}

#[test]
fn planning_fits_the_microcontroller() {
    build_image("build-plan-cost");
    let rows = measure();
    println!(
        "{:<12} {:<12} {:>6} {:>14} {:>14} {:>10}",
        "planner", "goals", "plans", "instructions", "worst", "stack (B)"
    );
    for row in &rows {
        println!(
            "{:<12} {:<12} {:>6} {:>14} {:>14} {:>10}",
            row.planner,
            row.goals,
            row.instructions.len(),
            row.median(),
            row.worst(),
            row.stack
        );
    }
    for row in &rows {
        let (stack, instructions) = match (row.planner.as_str(), row.goals.as_str()) {
            ("planar", _) => (STACK, PLANAR_INSTRUCTIONS),
            ("two-plane", _) => (STACK, u64::MAX),
            ("shortest", "from 4 R") => (SHORTEST_STACK, SHORTEST_INSTRUCTIONS),
            ("shortest", _) => (HELICOIDS_STACK, u64::MAX),
            _ => panic!("no limits for {}, {}", row.planner, row.goals),
        };
        assert!(row.stack <= stack, "{}, {}: {} B of stack, over {stack}", row.planner, row.goals, row.stack);
        let median = row.median();
        assert!(median <= instructions, "{}, {}: {median} instructions, over {instructions}", row.planner, row.goals);
    }
    for planner in ["planar", "two-plane", "shortest"] {
        assert!(rows.iter().any(|row| row.planner == planner), "nothing was measured of {planner}");
    }
}
