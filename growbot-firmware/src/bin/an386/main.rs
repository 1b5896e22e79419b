//! growbot on QEMU's mps2-an386, a Cortex-M4F at 25 MHz: the emulated robot.
//!
//! The controller is the robot's own; its pins and sensors are words of memory that the desktop maps (see
//! `growbot_firmware::emulated_tip`). Interrupts step the motors and move the bytes of the line; the main loop does the rest.

#![no_std]
#![no_main]

mod interrupt_owned;
mod interrupts;
mod line;
#[path = "../placeholder.rs"]
mod placeholder;
mod registers;
mod reset;
mod step_timer;
mod tip;
mod watchdog;

use cortex_m_rt::entry;
use defmt_rtt as _;

use crate::line::Line;
use crate::placeholder::{Controller, Engine};
use crate::tip::Tip;

/// The board's only clock.
const CLOCK_HZ: u32 = 25_000_000;
/// Step interrupts a second.
const TICK_HZ: u32 = 4_000;

defmt::timestamp!("{=u64:us}", step_timer::ticks() * 1_000_000 / u64::from(TICK_HZ));

#[entry]
fn main() -> ! {
    let tip = Tip::start(reset::take_cause);
    let watchdog = watchdog::start(CLOCK_HZ);
    let (Some(mut core), Some((received, to_send))) = (cortex_m::Peripherals::take(), line::queues()) else {
        // `main` runs once, so both are there.
        cortex_m::peripheral::SCB::sys_reset()
    };

    let mut line = Line::start(received, to_send, CLOCK_HZ);
    let engine = Engine {
        head_step: tip.head_step,
        head_direction: tip.head_direction,
        feed_step: tip.feed_step,
        feed_direction: tip.feed_direction,
        phase: 0,
    };
    let clock = step_timer::start(engine, TICK_HZ, CLOCK_HZ);
    interrupts::start(&mut core.NVIC);
    defmt::info!("an386, boot id {=u32:08x}, reset cause {=u32}", tip::boot_id(), tip::reset_cause());

    let mut machine = [0; growbot_firmware::emulated_tip::MACHINE_CAPACITY];
    let machine_length = tip::copy_machine_description(&mut machine);
    defmt::info!("machine description of {=usize} bytes", machine_length);

    let mut controller = Controller {
        drivers: (tip.head_enable, tip.feed_enable),
        heater: tip.heater,
        heater_enable: tip.heater_enable,
        thermistor: tip.thermistor,
        index: tip.index,
        watchdog,
        feeding: true,
        reading: 0,
    };
    for &byte in b"growbot an386\n" {
        let _ = line.to_send.enqueue(byte);
    }
    loop {
        controller.poll(clock.now_us(), &mut line.received, &mut line.to_send);
        line.send_queued();
        // The next step tick ends it at the latest.
        cortex_m::asm::wfi();
    }
}
