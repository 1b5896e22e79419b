//! Measurement of the cost of a layer in closed loop on the microcontroller, and check that the result is the same as
//! on a desktop. The program computes growths with noise and feedback, on QEMU's mps2-an386.
//!
//! For each growth one line is sent over UART0, `seed,layers,hash,instructions,stack`, and a line `end` after all
//! growths. The hash is over the bits of every planned layer and of the tip's last frame. The instructions are those of
//! one layer, in the mean. `tests/feedback_cost.rs` runs this program, and the same growths on the desktop. QEMU must
//! run it with `-icount shift=10`, that is 1024 ns an instruction.

#![no_std]
#![no_main]

#[path = "../measure.rs"]
mod measure;
#[path = "../polled_uart.rs"]
mod polled_uart;
#[path = "../../boards/an386/registers.rs"]
mod registers;
mod trial;

use core::fmt::Write;
use core::panic::PanicInfo;

use cortex_m_rt::entry;
use growbot_firmware::board_robot;

use crate::measure::measure;
use crate::polled_uart::PolledUart;

#[entry]
fn main() -> ! {
    let mut uart = PolledUart::start();
    let robot = board_robot::built_in_robot();
    for seed in 0..trial::GROWTHS {
        let mut grown = None;
        let cost = measure(&mut || grown = trial::grow(&robot, seed));
        let Some(trial::Trial { layers, hash }) = grown else { continue };
        let a_layer = cost.instructions / layers.max(1);
        let _ = writeln!(uart, "{seed},{layers},{hash:016x},{a_layer},{}", cost.stack);
    }
    let _ = writeln!(uart, "end");
    loop {
        cortex_m::asm::wfi();
    }
}

#[panic_handler]
fn panic(_info: &PanicInfo) -> ! {
    let _ = writeln!(PolledUart::start(), "panic");
    loop {
        cortex_m::asm::wfi();
    }
}
