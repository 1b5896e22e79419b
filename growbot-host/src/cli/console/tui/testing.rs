//! Messages of boards for the tests of this folder.

use growbot_core::layer::Layer;
use growbot_core::layer_bytes::LayerEncoder;
use growbot_core::link::message::{LayerLaid, Message, PauseCause, State, Status};
use growbot_plan::robot_file;

use super::model::ConsoleModel;

/// Returns the model of a simulated robot A whose state is not known yet.
pub fn model() -> ConsoleModel {
    let robot = robot_file::load("growbot-a".as_ref()).unwrap();
    ConsoleModel::new(robot, "sim", Some(60.0))
}

/// Returns the status of a board with a job of 100 layers, none of them laid, at 200 C with a target of 210 C.
pub fn status(state: State, uptime_s: f64) -> Status {
    Status {
        state,
        fault: None,
        temperature_centi_c: Some(20_000),
        target_centi_c: Some(21_000),
        duty: 0x8000,
        plan_id: 7,
        layer_count: 100,
        next_layer: 100,
        layers_laid: 0,
        interrupted: None,
        pause_cause: PauseCause::LayersExhausted,
        is_resumable: true,
        uptime_ms: (uptime_s * 1000.0) as u64,
    }
}

/// Returns the report of a layer that leans a little.
pub fn laid(index: u32) -> Message {
    let layer = Layer { alpha: 0.5, height: 0.7, tilt: 0.005 };
    let as_built = LayerEncoder::default().encode(&layer);
    Message::LayerLaid(LayerLaid { plan_id: 7, index, as_built: Some(as_built), readings: None })
}
