//! growbot on the robot: an STM32F405RG at 168 MHz.
//!
//! | priority | task | does |
//! |---|---|---|
//! | 4 | TIM2 | steps the motors |
//! | 3 | USART2 | moves the bytes of the link |
//! | 2 | SysTick | the clock, 1 kHz |
//! | idle | | polls the controller, at least at 1 kHz |

#![no_std]
#![no_main]

mod active_low;
mod clock;
mod heater;
mod line;
mod pins;
#[path = "../placeholder.rs"]
mod placeholder;
mod reset;
mod step_timer;
mod thermistor;
mod watchdog;

use defmt_rtt as _;

defmt::timestamp!("{=u64:ms}", clock::milliseconds());

#[rtic::app(device = stm32f4xx_hal::pac, peripherals = true)]
mod app {
    use heapless::spsc::{Consumer, Producer, Queue};
    use stm32f4xx_hal::pac;
    use stm32f4xx_hal::prelude::*;
    use stm32f4xx_hal::rcc::Config;

    use crate::heater::Heater;
    use crate::line::{self, Line};
    use crate::pins::{self, Pins};
    use crate::placeholder::{Controller, Engine};
    use crate::step_timer::StepTimer;
    use crate::thermistor::BoardThermistor;
    use crate::watchdog::BoardWatchdog;
    use crate::{clock, reset, watchdog};

    /// Step interrupts a second.
    const TICK_HZ: u32 = 4_000;

    type StepEngine = Engine<pins::HeadStep, pins::HeadDirection, pins::FeedStep, pins::FeedDirection>;
    type BoardController = Controller<
        (pins::HeadEnable, pins::FeedEnable),
        Heater,
        pins::HeaterEnable,
        BoardThermistor,
        pins::Index,
        BoardWatchdog,
    >;

    #[shared]
    struct Shared {}

    #[local]
    struct Local {
        engine: StepEngine,
        step_timer: StepTimer,
        line: Line,
        controller: BoardController,
        received: Consumer<'static, u8>,
        to_send: Producer<'static, u8>,
    }

    #[init(local = [
        receive_queue: Queue<u8, { line::QUEUE }> = Queue::new(),
        send_queue: Queue<u8, { line::QUEUE }> = Queue::new(),
    ])]
    fn init(cx: init::Context) -> (Shared, Local) {
        let device = cx.device;
        let mut core = cx.core;
        let cause = reset::take_cause(&device.RCC);
        let boot_id = reset::next_boot_id();

        let mut rcc = device.RCC.freeze(Config::hse(8.MHz()).sysclk(168.MHz()));
        let pins = Pins::new(device.GPIOA, device.GPIOB, device.GPIOC, &mut rcc);
        let watchdog = watchdog::start(device.IWDG, &device.DBGMCU);
        clock::start(&mut core.SYST, rcc.clocks.hclk().raw());

        let (receiver, received) = cx.local.receive_queue.split();
        let (mut to_send, transmitter) = cx.local.send_queue.split();
        let line = Line::start(device.USART2, (pins.link_tx, pins.link_rx), receiver, transmitter, &mut rcc);

        let engine = Engine {
            head_step: pins.head_step,
            head_direction: pins.head_direction,
            feed_step: pins.feed_step,
            feed_direction: pins.feed_direction,
            phase: 0,
        };
        let controller = Controller {
            drivers: (pins.head_enable, pins.feed_enable),
            heater: Heater::new(device.TIM3, pins.heater, &mut rcc),
            heater_enable: pins.heater_enable,
            thermistor: BoardThermistor::new(device.ADC1, device.ADC_COMMON, pins.thermistor, &mut rcc),
            index: pins.index,
            watchdog,
            feeding: true,
            reading: 0,
        };
        let step_timer = StepTimer::start(device.TIM2, TICK_HZ, &mut rcc);

        for &byte in b"growbot stm32f405\n" {
            let _ = to_send.enqueue(byte);
        }
        defmt::info!("stm32f405, boot id {=u32:08x}, reset cause {}", boot_id, cause);
        (Shared {}, Local { engine, step_timer, line, controller, received, to_send })
    }

    #[idle(local = [controller, received, to_send])]
    fn idle(cx: idle::Context) -> ! {
        loop {
            cx.local.controller.poll(clock::now_us(), cx.local.received, cx.local.to_send);
            rtic::pend(pac::Interrupt::USART2);
            // The next SysTick ends it at the latest.
            cortex_m::asm::wfi();
        }
    }

    #[task(binds = TIM2, priority = 4, local = [engine, step_timer])]
    fn step(cx: step::Context) {
        cx.local.step_timer.acknowledge();
        cx.local.engine.tick();
    }

    #[task(binds = USART2, priority = 3, local = [line])]
    fn link(cx: link::Context) {
        cx.local.line.on_interrupt();
    }

    #[task(binds = SysTick, priority = 2)]
    fn systick(_cx: systick::Context) {
        clock::on_tick();
    }
}
