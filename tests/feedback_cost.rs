//! Growths in closed loop have the same bits on the desktop and on the microcontroller. `cargo feedback-cost` also
//! prints a table of the cost of a layer there.
//!
//! The test builds the program that grows them (`growbot-firmware/benches/feedback/`) and runs it in the emulator.
//! The emulator counts each instruction, so the figures are the same on every machine.

#[path = "../growbot-firmware/benches/feedback/trial.rs"]
mod trial;

use std::io::{BufRead, BufReader};
use std::time::Duration;

use growbot_plan::robot_file;
use growbot_sim::port::qemu::{Qemu, QemuSocket};
use growbot_tests::{build_image, firmware};

/// Max instructions of a layer: a seventh of a second of the robot's processor, at two cycles an instruction.
const INSTRUCTIONS: u64 = 12_000_000;
/// Max stack, bytes. The measuring program sees 32 KiB.
const STACK: u64 = 30 * 1024;
/// Max time until the program prints the result of the next growth. A growth takes seconds.
const NEXT: Duration = Duration::from_secs(300);

#[test]
fn closed_loops_are_bit_identical_on_the_microcontroller() {
    build_image("build-feedback-cost");
    let line = QemuSocket::open("serial line").unwrap();
    let serial = line.argument().unwrap();
    let arguments = ["-icount", "shift=10,sleep=off", "-serial", &serial];
    let mut qemu = Qemu::start("mps2-an386", &firmware("feedback_cost"), arguments).unwrap();
    let stream = qemu.connect(&line).unwrap();
    stream.set_read_timeout(Some(NEXT)).unwrap();

    let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
    println!("{:>6} {:>8} {:>18} {:>24} {:>10}", "seed", "layers", "hash", "instructions, a layer", "stack (B)");
    for (grown, line) in BufReader::new(stream).lines().enumerate() {
        let line = line.unwrap();
        if line == "end" {
            assert_eq!(grown as u64, trial::GROWTHS);
            return;
        }
        let [seed, layers, hash, instructions, stack] = line.split(',').collect::<Vec<_>>()[..] else {
            panic!("the board answer: {line}");
        };
        println!("{seed:>6} {layers:>8} {hash:>18} {instructions:>24} {stack:>10}");
        let here = trial::grow(&robot, seed.parse().unwrap()).unwrap();
        assert_eq!(layers, here.layers.to_string(), "layers of growth {seed}");
        assert_eq!(hash, format!("{:016x}", here.hash), "growth {seed}");
        let (instructions, stack): (u64, u64) = (instructions.parse().unwrap(), stack.parse().unwrap());
        assert!(instructions <= INSTRUCTIONS, "{instructions} instructions a layer, over {INSTRUCTIONS}");
        assert!(stack < STACK, "{stack} B of stack, over {STACK}");
    }
    panic!("the board ended before its last growth: {}", qemu.messages());
}
