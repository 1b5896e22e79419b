//! Measurement of the cost of planning on the microcontroller: instructions and stack of each plan, on QEMU's
//! mps2-an386.
//!
//! For each plan one line is sent over UART0, `planner,goals,instructions,stack`, and a line `end` after all plans.
//! `tests/plan_cost.rs` runs this program and makes the table. It counts instructions, not cycles: QEMU must run it
//! with `-icount shift=10`, that is 1024 ns an instruction.

#![no_std]
#![no_main]

mod goals;
#[path = "../measure.rs"]
mod measure;
#[path = "../polled_uart.rs"]
mod polled_uart;
#[path = "../../boards/an386/registers.rs"]
mod registers;

use core::f64::consts::TAU;
use core::fmt::Write;
use core::hint::black_box;
use core::panic::PanicInfo;

use cortex_m_rt::entry;
use growbot_core::dubins2::{self, PathType, PlanarPath, PlanarPose};
use growbot_core::plan::{Planner, plan};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_firmware::board_robot;

use crate::goals::{RADIUS, goal, spread};
use crate::measure::measure;
use crate::polled_uart::PolledUart;

#[entry]
fn main() -> ! {
    let mut uart = PolledUart::start();
    measure_all(&mut uart, &board_robot::built_in_robot());
    let _ = writeln!(uart, "end");
    loop {
        cortex_m::asm::wfi();
    }
}

/// Measures each planner with each kind of goals. To measure a further combination, add a line.
fn measure_all(to: &mut PolledUart, robot: &Robot) {
    run(to, "planar", "0 to 40 R", 512, |n| planar_goal(n, 40.0), dubins2::shortest);
    run(to, "planar", "0 to 5 R", 512, |n| planar_goal(n, 5.0), dubins2::shortest);
    run(to, "planar", "degenerate", 512, degenerate_goal, dubins2::shortest);
    run(to, "two-plane", "from 4 R", 64, |n| goal(n, 4.0, 12.0), |goal| plan_to(robot, goal, Planner::TwoPlane));
    run(to, "two-plane", "0 to 4 R", 64, |n| goal(n, 0.0, 4.0), |goal| plan_to(robot, goal, Planner::TwoPlane));
    run(to, "shortest", "from 4 R", 64, |n| goal(n, 4.0, 12.0), |goal| plan_to(robot, goal, Planner::Shortest));
    run(to, "shortest", "0 to 4 R", 12, |n| goal(n, 0.0, 4.0), |goal| plan_to(robot, goal, Planner::Shortest));
}

fn run<G, P>(
    to: &mut PolledUart,
    planner: &str,
    goals: &str,
    count: u32,
    goal: impl Fn(u32) -> G,
    plan: impl Fn(&G) -> P,
) {
    for n in 0..count {
        let goal = black_box(goal(n));
        let cost = measure(&mut || {
            black_box(plan(&goal));
        });
        let _ = writeln!(to, "{planner},{goals},{},{}", cost.instructions, cost.stack);
    }
}

/// Plans a path from the origin, straight up, to a goal. Returns the number of candidates from which the path was
/// chosen.
#[inline(never)] // If it were inlined, its stack frame would count once for each use.
fn plan_to(robot: &Robot, goal: &Option<Pose>, planner: Planner) -> Option<usize> {
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).ok()?;
    plan(robot, &start, goal.as_ref()?, RADIUS, planner).ok().map(|chosen| black_box(chosen).candidate_count)
}

/// Returns a goal in the plane, evenly spread over direction, heading and distance up to `farthest`.
fn planar_goal(n: u32, farthest: f64) -> PlanarPose {
    let distance = farthest * spread(n, 0.754_877_666_246_692_7);
    let (y, x) = libm::sincos(TAU * spread(n, 0.569_840_290_998_053_2));
    PlanarPose { x: distance * x, y: distance * y, heading: TAU * spread(n, 0.618_033_988_749_894_9) }
}

/// Returns the end of a degenerate planar path, of which some segments have no length: by `n`, the segments that remain
/// are C, CC, CS, SC, S, or none.
fn degenerate_goal(n: u32) -> PlanarPose {
    let (first, last) = (TAU * spread(n, 0.754_877_666_246_692_7), TAU * spread(n, 0.569_840_290_998_053_2));
    let line = 40.0 * spread(n, 0.618_033_988_749_894_9);
    let (path_type, lengths) = match n % 6 {
        0 => (PathType::Lsl, [first, 0.0, 0.0]),
        1 => (PathType::Lsr, [first, 0.0, last]),
        2 => (PathType::Rsr, [first, line, 0.0]),
        3 => (PathType::Lsl, [0.0, line, last]),
        4 => (PathType::Lsl, [0.0, line, 0.0]),
        _ => (PathType::Lsl, [0.0; 3]),
    };
    PlanarPath { path_type, lengths }.end()
}

#[panic_handler]
fn panic(_info: &PanicInfo) -> ! {
    let _ = writeln!(PolledUart::start(), "panic");
    loop {
        cortex_m::asm::wfi();
    }
}
