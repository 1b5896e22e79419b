//! growbot on QEMU's mps2-an386, a Cortex-M4F at 25 MHz: the emulated robot.
//!
//! The controller is the same as on the real robot. Its pins and sensors are words of memory that the desktop maps (see
//! `growbot_firmware::emulated_tip`). Interrupts step the motors and move the bytes of the link. The main loop does
//! everything else.

#![no_std]
#![no_main]

mod flash;
#[path = "../runtime/interrupt_cell.rs"]
mod interrupt_cell;
mod interrupts;
mod mailbox;
mod registers;
mod reset;
#[path = "../runtime/mod.rs"]
mod runtime;
mod stack_monitor;
mod step_timer;
mod tip;
mod uart;
mod vectors;
mod watchdog;

use cortex_m_rt::entry;
use embedded_hal::digital::PinState;
use growbot_core::robot::{Robot, RobotError};
use growbot_firmware::board_robot::BoardRobot;
use growbot_firmware::controller::{BootInfo, Controller};
use growbot_firmware::description_store::{DescriptionStore, StoredDescription};
use growbot_firmware::hal::{Board, BoardResources, NoDebugPort, UnmanagedDrivers};
use growbot_firmware::invertible_pin::InvertiblePin;
use growbot_firmware::journal::Journal;
use growbot_firmware::layer_store::LayerStore;
use growbot_firmware::stepping::{Engine, EngineConfig, EngineInputs, StepperPins};

use crate::flash::{SharedMemoryPartition, SharedWords};
use crate::mailbox::MAILBOX;
use crate::runtime::retained::RetainedRam;
use crate::runtime::{crash, seal};
use crate::stack_monitor::StackMonitor;
use crate::tip::TipPins;
use crate::uart::Uart;

/// Frequency of the board's only clock, Hz.
const CLOCK_HZ: u32 = 25_000_000;

defmt::timestamp!("{=u64:us}", step_timer::now_us());

/// The hardware drivers of this board, by type.
struct An386;

impl Board for An386 {
    type HeaterPower = tip::Power;
    type HeaterEnable = tip::Switch;
    type FanPwm = tip::Power;
    type ThermistorAdc = tip::TipAdc;
    type SupplyAdc = tip::TipAdc;
    type FilamentPresence = tip::Flag;
    type DriverFault = tip::Flag;
    type Drivers = UnmanagedDrivers;
    type Orientation = tip::OrientationSensor;
    type Watchdog = watchdog::CmsdkWatchdog;
    type DebugPort = NoDebugPort;
    type Retained = RetainedRam;
    type Flash = SharedMemoryPartition;
    type Store = &'static mut LayerStore;
}

#[entry]
fn main() -> ! {
    let (uart, controller) = set_up();
    run(&uart, controller)
}

/// Runs the main loop, which never ends.
#[inline(never)] // Its stack frame must not exist during the start-up.
fn run(uart: &Uart, controller: &mut Controller<An386>) -> ! {
    let mut logged = controller.state();
    let mut high_water = StackMonitor::default();
    loop {
        high_water.look();
        watchdog::hang();
        while let Some(byte) = uart.received.dequeue() {
            controller.receive(byte, &MAILBOX);
        }
        controller.poll(step_timer::now_us(), &MAILBOX);
        while uart.to_send.has_room() {
            let Some(byte) = controller.next_tx_byte() else { break };
            let _ = uart.to_send.enqueue(byte);
        }
        uart.send_queued();
        if controller.needs_reset() {
            cortex_m::peripheral::SCB::sys_reset();
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
fn set_up() -> (Uart, &'static mut Controller<An386>) {
    let tip = TipPins::start(reset::read_and_clear_cause);
    let watchdog = watchdog::start(CLOCK_HZ);
    let store = cortex_m::singleton!(: LayerStore = LayerStore::new());
    let [descriptions, journal] = SharedWords::parts();
    let mut descriptions = DescriptionStore::open(descriptions);
    let (Some(mut core), Some(store), Some(retained), Ok(BoardRobot { robot, configured })) =
        (cortex_m::Peripherals::take(), store, RetainedRam::take(), load_robot(&mut descriptions))
    else {
        // This is unreachable: `main` runs once, and the built-in robot was checked by the build.
        cortex_m::peripheral::SCB::sys_reset()
    };

    let uart = Uart::start(CLOCK_HZ);
    let engine = Engine::new(
        StepperPins { step: tip.head_step, direction: tip.head_direction, enable: tip.head_enable },
        StepperPins { step: tip.feed_step, direction: tip.feed_direction, enable: tip.feed_enable },
        EngineInputs {
            // The emulated sensor pulls its line low on the mark.
            index: InvertiblePin::new(tip.index, PinState::Low),
            filament_motion: tip.filament_motion,
            emergency_stop: tip.emergency_stop,
        },
        tip::EmulatedOutputs,
        EngineConfig::for_robot(&robot),
    );
    step_timer::start(engine, robot.description().motion.tick_hz, CLOCK_HZ);
    interrupts::start(&mut core.NVIC);
    let identity = BootInfo { configured, ..boot_info() };
    defmt::info!(
        "an386 for {=str}, boot id {=u32:08x}, started by {=str}",
        robot.name(),
        identity.boot_id,
        identity.reset_cause.name()
    );

    let parts = BoardResources {
        heater_power: tip.heater,
        heater_enable: tip.heater_enable,
        fan: tip.fan,
        thermistor: tip.thermistor,
        supply: tip.supply,
        filament_presence: tip.filament_presence,
        driver_fault: tip.driver_fault,
        drivers: UnmanagedDrivers,
        orientation: tip.orientation,
        watchdog,
        debug_port: NoDebugPort,
        retained,
        journal: Journal::open(journal),
        descriptions,
        store,
    };
    // The controller is not on the stack, because planning needs the stack.
    let Some(controller) =
        cortex_m::singleton!(: Controller<An386> = Controller::new(robot, identity, parts, &MAILBOX))
    else {
        cortex_m::peripheral::SCB::sys_reset()
    };
    (uart, controller)
}

/// Returns the facts about this start.
fn boot_info() -> BootInfo {
    BootInfo {
        boot_id: tip::boot_id(),
        reset_cause: reset::named(tip::reset_cause()),
        image: seal::check(),
        crash: crash::latest(),
        configured: false,
        crystal_failed: false,
    }
}

fn decode_for_board(bytes: &[u8]) -> Result<Robot, RobotError> {
    let robot = Robot::decode(bytes)?;
    robot.check_for_board()?;
    Ok(robot)
}

/// Returns the robot whose description is stored in the board's flash. If none is stored, returns the robot whose
/// description the desktop has written to the shared memory, or else the robot that the firmware was built for.
#[inline(never)] // Its stack frame is needed only during the start-up.
fn load_robot(descriptions: &mut DescriptionStore<SharedMemoryPartition>) -> Result<BoardRobot, RobotError> {
    let mut bytes = [0; growbot_core::robot::MAX_ENCODED_LEN];
    let length = tip::copy_robot_description(&mut bytes);
    match (bytes.get(..length), descriptions.newest()) {
        (Some(given), StoredDescription::Empty) if !given.is_empty() => {
            Ok(BoardRobot { robot: decode_for_board(given)?, configured: true })
        }
        (_, found) => Ok(BoardRobot::from_stored(found)),
    }
}
