//! growbot on boards with an RP2040 at 125 MHz, whose second core stays asleep: a Raspberry Pi Pico, or a BTT SKR Pico.
//! The robot's description defines which of them it is, and the pins of the signals.
//!
//! | priority | interrupt | task |
//! |---|---|---|
//! | 0, the highest | PWM_IRQ_WRAP | steps the motors |
//! | 1 | UART0_IRQ, USBCTRL_IRQ | move the bytes of the link |
//! | main loop | | polls the controller, at each step tick |
//!
//! The interrupts run from RAM (`memory/pico.x`), so that they do not wait while the flash is written to. In this time
//! steps continue, and an emergency stop is carried out.
//!
//! The processor has neither a floating-point unit nor atomic swaps. The compiler's arithmetic is used instead of the
//! boot ROM's, because the results are the same bits as on all other machines. The boot ROM's arithmetic flushes
//! denormal numbers.

#![no_std]
#![no_main]

mod adc;
mod clock;
mod flash;
#[path = "../runtime/interrupt_cell.rs"]
mod interrupt_cell;
mod mailbox;
mod pins;
mod pwm;
mod reset;
#[path = "../runtime/mod.rs"]
mod runtime;
mod step_timer;
mod tmc_uart;
mod uart;
mod usb;
mod vectors;
mod watchdog;

use cortex_m::peripheral::NVIC;
use cortex_m_rt::entry;
use embedded_hal::delay::DelayNs;
use growbot_core::robot::BoardKind;
use growbot_firmware::bmi160_sensor::Bmi160Sensor;
use growbot_firmware::board_robot::BoardRobot;
use growbot_firmware::controller::{BootInfo, Controller};
use growbot_firmware::description_store::DescriptionStore;
use growbot_firmware::hal::{Board, BoardResources, NoDebugPort};
use growbot_firmware::journal::Journal;
use growbot_firmware::layer_store::LayerStore;
use growbot_firmware::link_mux::LinkMux;
use growbot_firmware::soft_i2c::SoftI2c;
use growbot_firmware::stepping::{Engine, EngineConfig, EngineInputs, StepperPins};
use growbot_firmware::tmc2209::{DriverConfig, Tmc2209};
use rp2040_pac as pac;

use crate::flash::{FlashPartition, Rp2040Flash};
use crate::mailbox::MAILBOX;
use crate::pins::PicoPins;
use crate::pwm::PwmOutput;
use crate::runtime::retained::RetainedRam;
use crate::runtime::{crash, seal};
use crate::tmc_uart::TmcUart;

/// The second stage of the boot loader, for the flash chip of the board.
#[unsafe(link_section = ".boot2")]
#[used]
static BOOT2: [u8; 256] = rp2040_boot2::BOOT_LOADER_W25Q080;

defmt::timestamp!("{=u64:us}", clock::now_us());

/// Interrupts and their priorities, of which only the upper two bits count.
const INTERRUPTS: [(pac::Interrupt, u8); 3] =
    [(pac::Interrupt::PWM_IRQ_WRAP, 0), (pac::Interrupt::UART0_IRQ, 1 << 6), (pac::Interrupt::USBCTRL_IRQ, 1 << 6)];

/// The hardware drivers of this board, by type.
struct Pico;

impl Board for Pico {
    const KINDS: &'static [BoardKind] = &[BoardKind::Pico, BoardKind::SkrPico];
    type HeaterPower = PwmOutput;
    type HeaterEnable = pins::Output;
    type FanPwm = PwmOutput;
    type ThermistorAdc = adc::ThermistorAdc;
    type SupplyAdc = adc::SupplyAdc;
    type FilamentPresence = pins::Sensor;
    type DriverFault = pins::Sensor;
    type Drivers = Option<Tmc2209<TmcUart>>;
    type Orientation = Bmi160Sensor<SoftI2c<pins::OpenDrain, pins::OpenDrain, CycleDelay>>;
    type Watchdog = watchdog::Rp2040Watchdog;
    type DebugPort = NoDebugPort;
    type Retained = RetainedRam;
    type Flash = FlashPartition;
    type Store = &'static mut LayerStore;
}

/// Delay by counting the processor's cycles.
pub struct CycleDelay;

impl DelayNs for CycleDelay {
    fn delay_ns(&mut self, ns: u32) {
        cortex_m::asm::delay(ns.div_ceil(8));
    }
}

#[entry]
fn main() -> ! {
    run(set_up())
}

/// Runs the main loop, which never ends.
#[inline(never)] // Its stack frame must not exist during the start-up.
fn run(controller: &mut Controller<Pico>) -> ! {
    let mut lines = LinkMux::new(&uart::RECEIVED, &usb::RECEIVED);
    let mut logged = controller.state();
    loop {
        while let Some(byte) = lines.next_byte() {
            controller.receive(byte, &MAILBOX);
        }
        controller.poll(clock::now_us(), &MAILBOX);
        let to_send = if lines.is_second_active() { &usb::TO_SEND } else { &uart::TO_SEND };
        while to_send.has_room() {
            let Some(byte) = controller.next_tx_byte() else { break };
            let _ = to_send.enqueue(byte);
        }
        uart::send_queued();
        usb::send_queued();
        if controller.needs_reset() {
            reset::restart();
        }
        if controller.state() != logged {
            logged = controller.state();
            let fault = controller.fault().map_or("none", |fault| fault.code());
            defmt::info!("{=str}, fault {=str}", logged.name(), fault);
        }
        // The next step tick ends the wait at the latest.
        cortex_m::asm::wfi();
    }
}

/// Initialises the board.
#[inline(never)] // Its stack frame is needed only during the start-up.
fn set_up() -> &'static mut Controller<Pico> {
    let store = cortex_m::singleton!(: LayerStore = LayerStore::new());
    let (Some(mut core), Some(store), Some(retained)) = (cortex_m::Peripherals::take(), store, RetainedRam::take())
    else {
        // This is unreachable, because `main` runs once.
        reset::restart()
    };
    // SAFETY: this is done once, like that of the processor's own peripherals above.
    let device = unsafe { pac::Peripherals::steal() };
    let watchdog = watchdog::start(&device);
    // The fast clocks come first, because without them the check of the image takes ten times as long.
    clock::start(&device);
    let mut descriptions = DescriptionStore::open(Rp2040Flash::of_description());
    let board = BoardRobot::load(&mut descriptions);
    let identity = BootInfo { configured: board.configured, ..boot_info(&device) };
    let pins = PicoPins::new(&board, device.IO_BANK0, device.PADS_BANK0);
    uart::start(&device.UART0);
    usb::start(&device.RESETS);
    let engine = Engine::new(
        StepperPins { step: pins.head_step, direction: pins.head_direction, enable: pins.head_enable },
        StepperPins { step: pins.feed_step, direction: pins.feed_direction, enable: pins.feed_enable },
        EngineInputs { index: pins.index, filament_motion: pins.filament_motion, emergency_stop: pins.emergency_stop },
        pins::PicoOutputs,
        EngineConfig::for_robot(&board.robot),
    );
    let (thermistor, supply) = adc::new(device.ADC, pins.thermistor, pins.supply);
    let parts = BoardResources {
        heater_power: PwmOutput::start(pins.heater),
        heater_enable: pins.heater_enable,
        fan: PwmOutput::start(pins.fan),
        thermistor,
        supply,
        filament_presence: pins.filament_presence,
        driver_fault: pins.driver_fault,
        drivers: DriverConfig::of(board.robot.description())
            .map(|settings| Tmc2209::new(TmcUart::start(device.UART1), settings)),
        orientation: Bmi160Sensor::new(SoftI2c::new(pins.orientation_clock, pins.orientation_data, CycleDelay)),
        watchdog,
        debug_port: NoDebugPort,
        retained,
        journal: Journal::open(Rp2040Flash::of_journal()),
        descriptions,
        store,
    };
    defmt::info!(
        "pico for {=str}, boot id {=u32:08x}, started by {=str}",
        board.robot.name(),
        identity.boot_id,
        identity.reset_cause.name()
    );
    vectors::relocate_to_ram();
    step_timer::start(engine, &device.PWM, board.robot.description().motion.tick_hz);
    start_interrupts(&mut core.NVIC);
    // The controller is not on the stack, because planning needs the stack.
    let controller = cortex_m::singleton!(: Controller<Pico> = Controller::new(board.robot, identity, parts, &MAILBOX));
    let Some(controller) = controller else { reset::restart() };
    controller
}

/// Enables the interrupts. All data that their handlers use is initialised.
fn start_interrupts(nvic: &mut NVIC) {
    for (interrupt, priority) in INTERRUPTS {
        // SAFETY: no code here depends on a priority mask that this could weaken.
        unsafe { nvic.set_priority(interrupt, priority) };
        // SAFETY: the data of the handlers is initialised, and this is in no critical section.
        unsafe { NVIC::unmask(interrupt) };
    }
}

/// Returns the facts about this start.
fn boot_info(device: &pac::Peripherals) -> BootInfo {
    BootInfo {
        reset_cause: reset::read_and_clear_cause(device),
        boot_id: reset::next_boot_id(),
        image: seal::check(),
        crash: crash::latest(),
        configured: false,
        crystal_failed: false,
    }
}
