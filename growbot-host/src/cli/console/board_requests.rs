//! Requests that a board answers at once, with the response as a few lines of text.

use growbot_client::client::{Client, ClientError};
use growbot_client::growth::GrowthRefusal;
use growbot_client::maintenance::MaterialPresets;
use growbot_client::robot_command::CommandOutcome;
use growbot_client::stop_signal::Permit;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::decode;
use growbot_core::link::message::{
    Accepted, Empty, EnergizingRequest, HostSilencePolicy, Message, PassiveRequest, PlanRequest, ReadLayers, Resume,
    Start, State, StoredLayers,
};
use growbot_core::plan::Planner;
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_pictures::layer_table::layer_columns;
use growbot_plan::table::{NumberFormat, Table};

use super::commands::BoardRequest;
use crate::cli::board_report::BoardReport;
use crate::cli::failure::Failure;
use crate::cli::port_arg::SelectedPort;
use crate::cli::remedies;

/// Sends a request to the board of `robot` and returns the response as text. Bodies begin at [`Pose::UPRIGHT`].
pub fn send(
    client: &mut Client,
    robot: &Robot,
    port: &SelectedPort,
    presets: &MaterialPresets,
    what: &BoardRequest,
    permit: &Permit,
) -> Result<String, Failure> {
    let text = |outcome: CommandOutcome| format!("{}\n", outcome.message(port.kind()));
    match what {
        BoardRequest::Status => Ok(BoardReport::read(client, port)?.text()),
        BoardRequest::Plan(goal) => plan(client, robot, goal),
        BoardRequest::Start => start_stored(client, permit),
        BoardRequest::Pause => {
            client.request("the request to pause", &PassiveRequest::Pause(Empty {}))?;
            Ok("the robot pauses after the current layer; `start` continues\n".to_owned())
        }
        BoardRequest::Layers(first) => layers(client, *first),
        BoardRequest::Stop => Ok(format!("{}\n", remedies::stop_message(client.stop()?, port.kind()))),
        BoardRequest::EmergencyStop => {
            client.emergency_stop()?;
            Ok(text(CommandOutcome::EmergencyStopped))
        }
        BoardRequest::Maintain(word, rest) => Ok(text(client.maintain(presets.task(word, rest, robot)?, permit)?)),
        BoardRequest::Clear => Ok(text(client.clear(permit)?)),
    }
}

fn plan(client: &mut Client, robot: &Robot, goal: &Pose) -> Result<String, Failure> {
    let request = PlanRequest {
        start: (&Pose::UPRIGHT).into(),
        goal: goal.into(),
        radius: robot.description().planning_radius_mm,
        planner: Planner::Shortest,
    };
    let what = "the request to plan";
    match client.request(what, &PassiveRequest::Plan(request))? {
        Message::Planned(planned) => {
            Ok(format!("plan {:016x}: {} layers, {:.3} mm\n", planned.plan_id, planned.layers, planned.length))
        }
        other => Err(unexpected(what, &other)),
    }
}

fn start_stored(client: &mut Client, permit: &Permit) -> Result<String, Failure> {
    let what = "the request to start";
    let status = client.status()?;
    let plan_id = status.plan_id;
    let mut text = String::new();
    if plan_id != 0 && (status.state == State::Stopped || status.interrupted.is_some()) {
        // An interrupted layer is laid again. `growbot resume` offers the choice.
        let resume = Resume { plan_id, start_layer: status.layers_laid, reported_layers: status.layers_laid };
        client.request("the request to resume", &PassiveRequest::Resume(resume))?;
        text += &format!("the growth resumes at layer {}\n", status.layers_laid);
    }
    let start = Start { plan_id, on_host_silence: HostSilencePolicy::Pause, is_continuation: false };
    match client.energize(what, &EnergizingRequest::Start(start), permit)? {
        Message::Accepted(Accepted { next, .. }) => {
            Ok(text + &format!("the growth has started; {next} layers are laid or stored\n"))
        }
        other => Err(unexpected(what, &other)),
    }
}

fn layers(client: &mut Client, first: Option<u32>) -> Result<String, Failure> {
    let what = "the request for stored layers";
    let first = match first {
        Some(first) => first,
        None => client.status()?.layers_laid,
    };
    match client.request(what, &PassiveRequest::ReadLayers(ReadLayers { first }))? {
        Message::StoredLayers(StoredLayers { first, layers }) => {
            let table = Table::new(NumberFormat::Shortest).column("layer", |(index, _): &(u64, Layer)| *index);
            let layers = (u64::from(first)..).zip(layers.iter().map(decode));
            Ok(layer_columns(table, |(_, layer)| *layer).csv(layers))
        }
        other => Err(unexpected(what, &other)),
    }
}

fn unexpected(request: &'static str, answer: &Message) -> Failure {
    Failure::request_failed(ClientError::Unexpected { request, kind: answer.kind() })
}

/// Returns the text of a growth that the console refuses: code, reason and remedy.
pub fn refusal_text(refusal: &GrowthRefusal) -> String {
    format!("{}: {refusal}: choose another pose, or grow it with `growbot grow --force`", refusal.code())
}
