//! Tests of each limit of the heater's supervision, from both sides, with numbers that are exact in single precision.

mod changes;
mod dither;
mod hot;
mod models;
mod standing;

use std::boxed::Box;
use std::sync::LazyLock;

use super::*;
use crate::heater::Demand;
use crate::testing::robot_a;

/// Time between two updates of the supervision, s.
const DT: f32 = 0.25;
const TARGET_C: f32 = 200.0;

/// Returns the model of robot A's nozzle: 50 W, 12 J/K, 0.12 W/K, a band of 3 C, 240 C at most. `measured` is true if
/// the supply voltage is measured.
fn nozzle(measured: bool) -> &'static NozzleModel<'static> {
    static MEASURED_OR_NOT: LazyLock<[NozzleModel; 2]> = LazyLock::new(|| {
        let robot = Box::leak(Box::new(robot_a()));
        let supplies = [Some(robot.description().supply.nominal_v), None];
        supplies.map(|supply_v| NozzleModel::new(&Demand { supply_v, ..Demand::default() }, robot.description()))
    });
    let [known, unknown] = &*MEASURED_OR_NOT;
    if measured { known } else { unknown }
}

const STEADY: ControlState = ControlState { trim: 0.0, saturated: false, dither: None };

/// Returns the supervision's input for a hot nozzle with this reading, without power. Its target is [`TARGET_C`].
fn at(reading_c: f32) -> SupervisionInput<'static> {
    let nozzle = nozzle(true);
    SupervisionInput {
        reading_c,
        target_c: TARGET_C,
        duty: 0.0,
        seconds: DT,
        hot: true,
        regulated: Some(STEADY),
        nozzle,
    }
}

/// Returns a change of a model that is the same for the nozzle and for the lagging reading.
const fn by(change: f32) -> Change {
    Change { prompt: change, late: change, late_rate: 0.0 }
}

/// Returns a checkpoint of this age and reading, since which no model has changed.
fn mark(age_s: f32, reading_c: f32) -> Checkpoint {
    Checkpoint { age_s, reading_c, lower: by(0.0), nominal: by(0.0), upper: by(0.0), fall_c: 0.0 }
}

/// Returns a supervision with a single checkpoint, of this age and reading.
fn since(age_s: f32, reading_c: f32) -> Supervision {
    let mut supervision = Supervision::default();
    let _ = supervision.marks.push_back(mark(age_s, reading_c));
    supervision
}

/// Calls `look` until it returns a fault, at most `max` times. Returns the number of calls before that without a fault,
/// and the fault.
fn looks_without_fault(max: u32, mut look: impl FnMut() -> Option<Fault>) -> (u32, Option<Fault>) {
    for looks in 0..max {
        if let Some(fault) = look() {
            return (looks, Some(fault));
        }
    }
    (max, None)
}

/// Advances the models for some seconds with the same input.
fn run(supervision: &mut Supervision, look: &SupervisionInput, seconds: f32) {
    for _ in 0..(seconds / DT) as u32 {
        supervision.advance_models(look);
    }
}

fn assert_near(value: f32, expected: f32) {
    assert!((value - expected).abs() <= 2e-3 * expected.abs().max(0.1), "{value}, not {expected}");
}

fn still(reading_c: f32) -> FrozenReading {
    FrozenReading { reading_c, seconds: 0.0, dithered_s: 0.0, nominal: by(0.0) }
}
