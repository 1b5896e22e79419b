//! `growbot status`: who the board is and what it is doing.

use clap::Args;
use growbot_core::link::message::{BoardHello, Fault};
use growbot_host::client::Client;
use growbot_host::output::print;
use growbot_host::port;
use serde_json::{Value, json};

use super::{Failure, PortArg, RobotArg};

/// Ask the robot's board who it is and what it is doing
#[derive(Args)]
#[command(after_help = "Example:\n  growbot status --port /dev/ttyACM0")]
pub struct StatusArgs {
    #[command(flatten)]
    port: PortArg,
    #[command(flatten)]
    robot: RobotArg,
    /// Print one line of JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &StatusArgs) -> Result<(), Failure> {
    let robot = args.robot.load()?;
    let mut client = Client::new(port::open(&args.port.name()?, &robot)?, args.port.text());
    let hello = client.hello()?;
    print(&if args.json { format!("{}\n", json_of(&hello)) } else { text_of(&hello) })?;
    Ok(())
}

fn celsius(centi: i32) -> f64 {
    f64::from(centi) / 100.0
}

fn json_of(hello: &BoardHello) -> Value {
    let status = &hello.status;
    json!({
        "robot": hello.robot_name,
        "robot_hash": format!("{:016x}", hello.robot),
        "firmware": version(hello),
        "schema": format!("{:016x}", hello.schema),
        "boot_id": hello.boot_id,
        "reset_cause": hello.reset_cause.name(),
        "state": status.state.name(),
        "fault": status.fault.map(Fault::code),
        "temperature_c": status.temperature_centi_c.map(celsius),
        "target_c": status.target_centi_c.map(celsius),
        "duty": f64::from(status.duty) / f64::from(u16::MAX),
        "plan_id": (status.plan_id != 0).then(|| format!("{:016x}", status.plan_id)),
        "layers": status.layers,
        "laid": status.laid,
        "held": status.next.saturating_sub(status.laid),
        "capacity": hello.capacity,
        "uptime_s": status.uptime_ms as f64 / 1000.0,
    })
}

fn version(hello: &BoardHello) -> String {
    let [major, minor, patch] = hello.firmware;
    format!("{major}.{minor}.{patch}")
}

/// The status in a few lines.
pub fn text_of(hello: &BoardHello) -> String {
    let status = &hello.status;
    let temperature = status.temperature_centi_c.map_or("no reading".to_string(), |t| format!("{:.1} C", celsius(t)));
    let target = status.target_centi_c.map_or("heater off".to_string(), |t| format!("target {:.1} C", celsius(t)));
    let job = match status.plan_id {
        0 => "none".to_string(),
        id => {
            format!("{id:016x}, {} of {} layers laid, {} held", status.laid, status.layers, status.next - status.laid)
        }
    };
    let mut text = format!("robot        {} ({:016x}), firmware {}\n", hello.robot_name, hello.robot, version(hello));
    text += &format!("state        {}\n", status.state.name());
    if let Some(fault) = status.fault {
        text += &format!("fault        {}: {}\n", fault.code(), fault.explanation());
    }
    text += &format!("temperature  {temperature}, {target}\n");
    text += &format!("job          {job}\n");
    text += &format!(
        "board        up {:.1} s, started by {}, boot {:08x}\n",
        status.uptime_ms as f64 / 1000.0,
        hello.reset_cause.name(),
        hello.boot_id
    );
    text
}
