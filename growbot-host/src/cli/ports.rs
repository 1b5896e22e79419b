//! `growbot ports`: lists the ports at which robots are, or may be.

use clap::Args;
use growbot_host::output::print;
use growbot_plan::sanitize::json_line;
use growbot_serve::known_ports::known_ports;
use serde_json::json;

use super::failure::Failure;
use super::known_robots::service_robots;

/// List robots and serial devices: names for --port
///
/// The list has the robots of the service and of growbot.toml, the simulated robots that are on (sim:NAME), and the
/// serial devices of this computer, which are not opened. Commands take a port or the name of a robot as --port.
#[derive(Args)]
#[command(after_help = "Examples:\n  growbot ports\n  growbot ports --json")]
pub struct PortsArgs {
    /// Print one line of JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &PortsArgs) -> Result<(), Failure> {
    let ports = known_ports(service_robots())?;
    if args.json {
        return Ok(print(&json_line(&json!({ "ports": ports })))?);
    }
    if ports.is_empty() {
        growbot_host::note!(
            "there are no robots and no serial devices: `growbot power on --port sim:lab` switches a \
                             simulated robot on"
        );
    }
    let width = ports.iter().map(|known| known.port.chars().count()).max().unwrap_or(0).max(4);
    let name_width = ports.iter().filter_map(|known| known.name.as_ref()).map(String::len).max().unwrap_or(0).max(5);
    let mut text = format!("{:<width$}  {:<name_width$}  from\n", "port", "robot");
    for known in &ports {
        let name = known.name.as_deref().unwrap_or("-");
        text += &format!("{:<width$}  {name:<name_width$}  {}\n", known.port, known.source.text());
    }
    Ok(print(&text)?)
}
