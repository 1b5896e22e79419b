//! growbot on the robot: an STM32F405RG at 168 MHz.
//!
//! | priority | task | function |
//! |---|---|---|
//! | not maskable | NMI | the crystal has stopped: everything off |
//! | 5 | PVD | the processor's supply sags: everything off |
//! | 4 | TIM2 | steps the motors |
//! | 3 | USART2 | moves the bytes of the link |
//! | 2 | SysTick | the clock, 1 kHz |
//! | idle | | polls the controller, at least at 1 kHz |

#![no_std]
#![no_main]

mod adc;
mod brown_out;
mod clock;
mod debug_port;
mod fan;
mod flash;
mod heater;
mod orientation_bus;
mod outputs;
mod pins;
mod reset;
#[path = "../runtime/mod.rs"]
mod runtime;
mod step_timer;
mod uart;
mod watchdog;

defmt::timestamp!("{=u64:ms}", clock::milliseconds());

#[rtic::app(device = stm32f4xx_hal::pac, peripherals = true)]
mod app {
    use growbot_core::link::message::State;
    use growbot_core::robot::BoardKind;
    use growbot_firmware::board_robot::BoardRobot;
    use growbot_firmware::controller::{BootInfo, Controller};
    use growbot_firmware::description_store::DescriptionStore;
    use growbot_firmware::hal::{Board, BoardResources, UnmanagedDrivers};
    use growbot_firmware::journal::Journal;
    use growbot_firmware::layer_store::LayerStore;
    use growbot_firmware::stepping::{Engine, EngineConfig, EngineInputs, Mailbox, StepperPins};
    use stm32f4xx_hal::pac;
    use stm32f4xx_hal::prelude::*;

    use crate::adc::{self, SupplyAdc, ThermistorAdc};
    use crate::clock::ClockSource;
    use crate::debug_port::{BoardDebugPort, DebugFreeze};
    use crate::fan::FanPwm;
    use crate::flash::{Stm32Flash, SuppliedFlash};
    use crate::heater::HeaterPwm;
    use crate::orientation_bus::{self, BoardOrientation};
    use crate::pins::{self, Stm32Pins};
    use crate::runtime::retained::RetainedRam;
    use crate::runtime::{crash, seal};
    use crate::step_timer::StepTimer;
    use crate::uart::{self, LinkUart};
    use crate::watchdog::Stm32Watchdog;
    use crate::{brown_out, clock, outputs, reset, watchdog};

    /// Mailbox for moves and reports between the controller and the step interrupt.
    static MAILBOX: Mailbox = Mailbox::new();

    type StepEngine = Engine<
        pins::HeadStep,
        pins::HeadDirection,
        pins::HeadEnable,
        pins::FeedStep,
        pins::FeedDirection,
        pins::FeedEnable,
        pins::Index,
        pins::FilamentMotionPin,
        pins::EmergencyStop,
        outputs::Stm32Outputs,
    >;

    /// The hardware drivers of this board, by type.
    pub struct Stm32f405;

    impl Board for Stm32f405 {
        const KINDS: &'static [BoardKind] = &[BoardKind::Stm32f405];
        type HeaterPower = HeaterPwm;
        type HeaterEnable = pins::HeaterEnable;
        type FanPwm = FanPwm;
        type ThermistorAdc = ThermistorAdc;
        type SupplyAdc = SupplyAdc;
        type FilamentPresence = pins::FilamentPresence;
        type DriverFault = pins::DriverFault;
        type Drivers = UnmanagedDrivers;
        type Orientation = BoardOrientation;
        type Watchdog = Stm32Watchdog;
        type DebugPort = BoardDebugPort;
        type Retained = RetainedRam;
        type Flash = SuppliedFlash;
        type Store = &'static mut LayerStore;
    }

    #[shared]
    struct Shared {}

    #[local]
    struct Local {
        engine: StepEngine,
        step_timer: StepTimer,
        uart: LinkUart,
        controller: Controller<Stm32f405>,
        logged: State,
    }

    #[init(local = [store: LayerStore = LayerStore::new()])]
    fn init(cx: init::Context) -> (Shared, Local) {
        let device = cx.device;
        let mut core = cx.core;
        let watchdog = watchdog::start(device.IWDG, DebugFreeze::set_up(device.DBGMCU, &mut core.DCB));
        let Some(retained) = RetainedRam::take() else {
            // This is unreachable, because no code has taken the memory before.
            cortex_m::peripheral::SCB::sys_reset()
        };

        brown_out::check_reset_level(&device.FLASH);
        let mut identity = boot_info(&device.RCC, &device.FLASH);
        let mut rcc = device.RCC.constrain();
        brown_out::start_detector(&device.PWR, &mut rcc);
        let [descriptions, journal] = Stm32Flash::parts(device.FLASH);
        let mut descriptions = DescriptionStore::open(descriptions);
        let BoardRobot { robot, configured } = BoardRobot::load(&mut descriptions);
        identity.configured = configured;
        let pins = Stm32Pins::new(robot.description(), device.GPIOA, device.GPIOB, device.GPIOC, &mut rcc);
        clock::start(&mut core.SYST);

        let uart = LinkUart::start(device.USART2, (pins.link_tx, pins.link_rx), &mut rcc);

        let engine = Engine::new(
            StepperPins { step: pins.head_step, direction: pins.head_direction, enable: pins.head_enable },
            StepperPins { step: pins.feed_step, direction: pins.feed_direction, enable: pins.feed_enable },
            EngineInputs {
                index: pins.index,
                filament_motion: pins.filament_motion,
                emergency_stop: pins.emergency_stop,
            },
            outputs::Stm32Outputs,
            EngineConfig::for_robot(&robot),
        );
        let (thermistor, supply) = adc::new(device.ADC1, device.ADC_COMMON, pins.thermistor, pins.supply, &mut rcc);
        // The journal is opened below. If the supply falls meanwhile, the board must restart, because the journal may
        // have been read wrongly.
        brown_out::arm(&device.PWR, &device.EXTI);
        let parts = BoardResources {
            heater_power: HeaterPwm::new(device.TIM1, pins.heater, &mut rcc),
            heater_enable: pins.heater_enable,
            fan: FanPwm::new(device.TIM12, pins.fan, &mut rcc),
            thermistor,
            supply,
            filament_presence: pins.filament_presence,
            driver_fault: pins.driver_fault,
            drivers: UnmanagedDrivers,
            orientation: orientation_bus::orientation(
                pins.orientation_clock,
                pins.orientation_data,
                clock::PROCESSOR_HZ,
            ),
            watchdog,
            debug_port: BoardDebugPort,
            retained,
            journal: Journal::open(journal),
            descriptions,
            store: cx.local.store,
        };
        let step_timer = StepTimer::start(device.TIM2, robot.description().motion.tick_hz, &mut rcc);
        defmt::info!(
            "stm32f405 for {=str}, boot id {=u32:08x}, started by {=str}",
            robot.name(),
            identity.boot_id,
            identity.reset_cause.name()
        );
        let controller = Controller::new(robot, identity, parts, &MAILBOX);
        let logged = controller.state();
        (Shared {}, Local { engine, step_timer, uart, controller, logged })
    }

    /// Returns the facts about this start. Sets the fast clocks before it checks the image, so that it ends long before
    /// the watchdog must be fed.
    fn boot_info(rcc: &pac::RCC, flash: &pac::FLASH) -> BootInfo {
        BootInfo {
            reset_cause: reset::read_and_clear_cause(rcc),
            boot_id: reset::next_boot_id(),
            crystal_failed: clock::speed_up(rcc, flash) == ClockSource::Internal,
            image: seal::check(),
            crash: crash::latest(),
            configured: false,
        }
    }

    #[idle(local = [controller, logged])]
    fn idle(cx: idle::Context) -> ! {
        let idle::LocalResources { controller, logged, .. } = cx.local;
        let (received, to_send) = (&uart::RECEIVED, &uart::TO_SEND);
        loop {
            while let Some(byte) = received.dequeue() {
                controller.receive(byte, &MAILBOX);
            }
            controller.poll(clock::now_us(), &MAILBOX);
            while to_send.has_room() {
                let Some(byte) = controller.next_tx_byte() else { break };
                let _ = to_send.enqueue(byte);
            }
            if controller.needs_reset() {
                cortex_m::peripheral::SCB::sys_reset();
            }
            if controller.state() != *logged {
                *logged = controller.state();
                let fault = controller.fault().map_or("none", |fault| fault.code());
                defmt::info!("{=str}, fault {=str}", logged.name(), fault);
            }
            rtic::pend(pac::Interrupt::USART2);
            // The next SysTick ends the wait at the latest.
            cortex_m::asm::wfi();
        }
    }

    #[task(binds = PVD, priority = 5)]
    fn supply_sags(_cx: supply_sags::Context) {
        reset::reset_on_brown_out();
    }

    #[task(binds = TIM2, priority = 4, local = [engine, step_timer])]
    fn step(cx: step::Context) {
        cx.local.step_timer.acknowledge();
        cx.local.engine.tick(&MAILBOX);
    }

    #[task(binds = USART2, priority = 3, local = [uart])]
    fn link(cx: link::Context) {
        cx.local.uart.on_interrupt(&MAILBOX);
    }

    #[task(binds = SysTick, priority = 2)]
    fn systick(_cx: systick::Context) {
        clock::on_tick();
    }
}
