//! Requests and layers that the tests send to the board.

use std::vec::Vec;

use growbot_core::layer::Layer;
use growbot_core::layer_bytes::{LayerBytes, LayerEncoder, decode};
use growbot_core::link::message::{
    Amend, AppendLayers, BeginJob, Empty, Hello, HostName, HostSilencePolicy, LayerLaid, Maintain, MaintenanceTask,
    Message, Resume, Start, Tune,
};
use growbot_core::robot::Robot;

pub const PLAN: u64 = 0x1234;

pub fn begin(robot: &Robot, plan_id: u64, layers: u32) -> Message {
    Message::BeginJob(BeginJob { plan_id, layers, robot_hash: robot.hash() })
}

/// Returns a request that opens a session and takes the board over from any other host.
pub fn hello(schema: u64) -> Message {
    Message::Hello(Hello { schema, host: HostName::new(), take_over: true })
}

pub fn batch_of(first: usize, layers: &[LayerBytes]) -> Message {
    let layers = layers.iter().copied().collect();
    Message::AppendLayers(AppendLayers { plan_id: PLAN, first: first as u32, layers })
}

pub fn start() -> Message {
    Message::Start(Start { plan_id: PLAN, on_host_silence: HostSilencePolicy::Continue, is_continuation: false })
}

/// Starts the job without an order of a person.
pub fn continuation() -> Message {
    Message::Start(Start { plan_id: PLAN, on_host_silence: HostSilencePolicy::Continue, is_continuation: true })
}

/// Returns a request to resume the job at a layer. It states that the host has received no reports of laid layers.
pub fn resume(from: u32) -> Message {
    Message::Resume(Resume { plan_id: PLAN, start_layer: from, reported_layers: 0 })
}

/// Identifier of the plan with which the tests amend the job.
pub const AMENDED: u64 = 0x5678;

/// Returns a request that replaces the job's layers from `from` on. The job then has `layers` layers, and the request
/// contains three of them.
pub fn amend(from: u32, layers: u32) -> Message {
    let first_layers = bends(3).into_iter().collect();
    Message::Amend(Amend { plan_id: PLAN, new_plan_id: AMENDED, first_replaced: from, layers, first_layers })
}

pub fn stop() -> Message {
    Message::Stop(Empty {})
}

pub fn pause() -> Message {
    Message::Pause(Empty {})
}

pub fn tune(celsius: f64) -> Message {
    Message::Tune(Tune { target_centi_c: (celsius * 100.0) as i32 })
}

pub fn maintain(task: MaintenanceTask) -> Message {
    Message::Maintain(Maintain { task })
}

pub fn preheat(celsius: f64) -> Message {
    maintain(MaintenanceTask::Preheat { target_centi_c: (celsius * 100.0) as i32 })
}

/// Returns a maintenance request to move filament by this length, mm.
pub fn feed(mm: f64) -> Message {
    maintain(MaintenanceTask::Feed { um: (mm * 1000.0) as i32 })
}

pub fn clear() -> Message {
    Message::ClearFault(Empty {})
}

/// Returns the number of feed steps of a reported layer, which its height gives exactly.
pub fn feed_steps_of(laid: &LayerLaid, robot: &Robot) -> u32 {
    libm::rint(decode(&laid.as_built.unwrap()).height * robot.feed_steps_per_length()) as u32
}

/// Returns the layers of a body that bends in several directions. `count` is their number.
pub fn bends(count: usize) -> Vec<LayerBytes> {
    let mut encoder = LayerEncoder::default();
    let layer = |i: usize| Layer {
        alpha: i as f64 * 0.37,
        height: 0.76 - 0.003 * (i % 7) as f64,
        tilt: 0.0009 * (i % 9) as f64,
    };
    (0..count).map(|i| encoder.encode(&layer(i))).collect()
}
