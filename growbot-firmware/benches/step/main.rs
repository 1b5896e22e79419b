//! Measurement of the cost of the step interrupt on the microcontroller: instructions of `Engine::tick` in each kind of
//! tick, and of an emergency stop over the link, on QEMU's mps2-an386.
//!
//! Every tick of some turns is measured. For each kind of tick one line is sent over UART0, `turns,tick,count,max`, and
//! a line `end` after all kinds. `tests/step_cost.rs` runs this program and makes the table. It counts instructions,
//! not cycles: QEMU must run it with `-icount shift=10`, that is 1024 ns an instruction.

#![no_std]
#![no_main]

mod emergency_stop;
#[path = "../../boards/runtime/interrupt_cell.rs"]
mod interrupt_cell;
#[path = "../../boards/an386/interrupts.rs"]
mod interrupts;
/// Mailbox in which the UART's interrupt reports an emergency stop.
#[path = "../../boards/an386/mailbox.rs"]
mod mailbox;
mod pins;
#[path = "../polled_uart.rs"]
mod polled_uart;
#[path = "../../boards/an386/registers.rs"]
mod registers;
mod step_timer;
mod timer;
#[expect(dead_code, reason = "nothing here moves the emulated tip")]
#[path = "../../boards/an386/tip.rs"]
mod tip;
#[expect(dead_code, reason = "nothing is sent by the UART's interrupt")]
#[path = "../../boards/an386/uart.rs"]
mod uart;
#[path = "../../boards/an386/vectors.rs"]
mod vectors;

use core::fmt::Write;
use core::panic::PanicInfo;

use cortex_m_rt::entry;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::LayerEncoder;
use growbot_core::robot::{FeedStrategy, HeadRotation, Robot, RobotDescription};
use growbot_firmware::board_robot;
use growbot_firmware::stepping::{
    AxisMove, EngineConfig, HomingMove, Mailbox, MotorDirection, Move, Report, Turn, TurnPlanner,
};

use crate::pins::{BenchmarkEngine, World};
use crate::polled_uart::PolledUart;
use crate::timer::Timer;

/// Number of turns that are laid in each run.
const TURNS: u32 = 4;

/// Kinds of ticks of the step engine.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Idle,
    Homing,
    Feeding,
    Begin,
    Nothing,
    Head,
    Feed,
    Both,
    Sector,
    End,
    Halt,
    Stop,
}

const KINDS: [(Kind, &str); 12] = [
    (Kind::Idle, "idle"),
    (Kind::Homing, "homing"),
    (Kind::Feeding, "feed move"),
    (Kind::Begin, "turn taken"),
    (Kind::Nothing, "no step"),
    (Kind::Head, "head step"),
    (Kind::Feed, "feed step"),
    (Kind::Both, "both steps"),
    (Kind::Sector, "sector ends"),
    (Kind::End, "turn ends"),
    (Kind::Halt, "halt"),
    (Kind::Stop, "emergency stop"),
];

/// Number of ticks of each kind, and the max number of instructions of one.
#[derive(Default)]
struct Costs([(u32, u32); KINDS.len()]);

impl Costs {
    fn add(&mut self, kind: Kind, instructions: u32) {
        for ((known, _), (count, max)) in KINDS.iter().zip(&mut self.0) {
            if *known == kind {
                *count += 1;
                *max = instructions.max(*max);
            }
        }
    }
}

#[entry]
fn main() -> ! {
    let stops = emergency_stop::measure(&Timer::start());
    // Until here the interrupts have driven the UART.
    let mut uart = PolledUart::start();
    if let Some((count, max)) = stops {
        let _ = writeln!(uart, "link,emergency stop,{count},{max}");
    }
    let robot = board_robot::built_in_robot();
    for strategy in [FeedStrategy::Feed, FeedStrategy::Speed] {
        let name = if strategy == FeedStrategy::Feed { "feed" } else { "speed" };
        run(&mut uart, name, "", &robot, |description| description.motion.strategy = strategy);
        run(&mut uart, name, " with ramps", &robot, |description| {
            description.motion.strategy = strategy;
            needs_ramps(description);
        });
    }
    let _ = writeln!(uart, "end");
    loop {
        cortex_m::asm::wfi();
    }
}

/// Changes the description to that of a fast robot for wide bends, whose motors need ramps.
fn needs_ramps(description: &mut RobotDescription) {
    description.planning_radius_mm = 150.0;
    description.layer.period_s = 3.0;
    description.motion.tick_hz = 20_000;
    description.motion.turning = HeadRotation::Alternate;
    description.head.speed_jump_turns_per_s = 0.1;
    description.feed.steps_per_mm = 25.0;
}

fn run(uart: &mut PolledUart, name: &str, ramps: &str, robot: &Robot, change: impl FnOnce(&mut RobotDescription)) {
    let mut description = robot.description().clone();
    change(&mut description);
    let costs = Robot::new(description).ok().and_then(|robot| Bench::new(&robot).measure(&robot));
    let Some(costs) = costs else {
        let _ = writeln!(uart, "{name}{ramps} cannot be laid");
        return;
    };
    for ((_, kind), (count, max)) in KINDS.iter().zip(costs.0) {
        let _ = writeln!(uart, "{name}{ramps},{kind},{count},{max}");
    }
}

/// A step engine and its simulated hardware.
struct Bench {
    engine: BenchmarkEngine,
    handover: Mailbox,
    world: World,
    timer: Timer,
    costs: Costs,
}

impl Bench {
    fn new(robot: &Robot) -> Self {
        Self {
            engine: pins::engine(EngineConfig::for_robot(robot)),
            handover: Mailbox::new(),
            world: World::of(robot),
            timer: Timer::start(),
            costs: Costs::default(),
        }
    }

    /// Measures all kinds of ticks. Returns `None` if the step engine does not behave as expected.
    fn measure(mut self, robot: &Robot) -> Option<Costs> {
        let head = &robot.description().head;
        let homing = HomingMove {
            ticks_per_step: 4,
            max_steps: 2 * head.steps_per_turn,
            steps_to_zero: self.world.steps_from_mark_to_zero(),
        };
        self.idle(100);
        self.until_report(Move::Home(homing), Kind::Homing)?;
        self.idle(100);
        for direction in [MotorDirection::Backward, MotorDirection::Forward] {
            self.until_report(
                Move::Feed(AxisMove { steps: 50, direction, ticks_per_step: 8, changes_filament: false }),
                Kind::Feeding,
            )?;
        }
        self.lay(robot)?;
        self.idle(100);
        self.handover.halt();
        self.tick(Kind::Halt);
        pins::press_emergency_stop(true);
        self.tick(Kind::Stop);
        pins::press_emergency_stop(false);
        Some(self.costs)
    }

    /// Runs and measures one tick. If `kind` is `Nothing`, the steps that the tick has made determine its kind.
    fn tick(&mut self, kind: Kind) {
        let instructions = self.timer.instructions(|| pins::tick(&mut self.engine, &self.handover));
        let steps = self.world.watch();
        let kind = match (kind, steps) {
            (Kind::Nothing, (true, true)) => Kind::Both,
            (Kind::Nothing, (true, false)) => Kind::Head,
            (Kind::Nothing, (false, true)) => Kind::Feed,
            (kind, _) => kind,
        };
        self.costs.add(kind, instructions);
    }

    fn idle(&mut self, ticks: u32) {
        for _ in 0..ticks {
            self.tick(Kind::Idle);
        }
    }

    fn until_report(&mut self, order: Move, kind: Kind) -> Option<()> {
        self.handover.submit(order);
        while !self.handover.has_report() {
            self.tick(kind);
        }
        matches!(self.handover.pop_report(), Some(Report::Homed | Report::Fed)).then_some(())
    }

    /// Lays some turns without a stop between them, and measures their ticks.
    fn lay(&mut self, robot: &Robot) -> Option<()> {
        let alternate = robot.description().motion.turning == HeadRotation::Alternate;
        let (mut material, mut encoder) = (TurnPlanner::default(), LayerEncoder::default());
        let mut turn_of = |index: u32| {
            let lean = f64::from(index % 3) * 0.0025;
            let layer = Layer { alpha: 0.9 * f64::from(index), height: 0.77 - 0.1 * f64::from(index % 2), tilt: lean };
            let direction =
                if alternate && index % 2 == 1 { MotorDirection::Backward } else { MotorDirection::Forward };
            material.next_turn(&encoder.encode(&layer), robot, direction).ok()
        };
        let mut laid = 0;
        let mut next = turn_of(0)?;
        self.handover.submit(Move::Lay(next));
        while laid < TURNS {
            // This tick accepts the turn. Without ramps it is also a tick of the turn itself, except for the first
            // turn.
            let turn = next;
            self.tick(Kind::Begin);
            if laid + 1 < TURNS {
                next = turn_of(laid + 1)?;
                self.handover.submit(Move::Lay(next));
            }
            self.lay_one(&turn, u32::from(laid > 0));
            let Some(Report::Laid(_)) = self.handover.pop_report() else { return None };
            laid += 1;
        }
        Some(())
    }

    /// Lays the rest of a turn, of which `passed` ticks are over, and measures its ticks.
    fn lay_one(&mut self, turn: &Turn, passed: u32) {
        let (mut sectors, mut now) = (turn.sectors.iter(), passed);
        let mut sector_ends = sectors.next().map_or(0, |sector| sector.ticks);
        // At full speed the sectors give the ticks. With ramps only the steps show the kind of a tick.
        let full_speed = turn.needs_no_ramp();
        while !self.handover.has_report() {
            now += 1;
            let last = now == turn.ticks;
            if full_speed && !last && now == sector_ends {
                sector_ends += sectors.next().map_or(0, |sector| sector.ticks);
                self.tick(Kind::Sector);
            } else {
                self.tick(if full_speed && last { Kind::End } else { Kind::Nothing });
            }
        }
    }
}

#[panic_handler]
fn panic(_info: &PanicInfo) -> ! {
    let _ = writeln!(PolledUart::start(), "panic");
    loop {
        cortex_m::asm::wfi();
    }
}
