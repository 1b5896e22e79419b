//! `growbot ports`: lists the ports at which robots are, or may be.

use clap::Args;
use growbot_host::output::print;
use growbot_plan::sanitize::json_line;
use growbot_serve::known_ports::{KnownPort, KnownPorts, known_ports};

use super::failure::Failure;
use super::known_robots::service_robots;
use super::remedies;

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
    let owned = service_robots().unwrap_or_else(|error| {
        growbot_host::warning!("the robots of the service are not listed: {}", remedies::message(&error));
        Vec::new()
    });
    let ports = known_ports(owned)?;
    if args.json {
        return Ok(print(&json_line(&KnownPorts { ports }))?);
    }
    if ports.is_empty() {
        growbot_host::note!("no robots and no serial devices: `growbot power --help` shows how to simulate a robot");
    }
    let width = |of: fn(&KnownPort) -> usize| ports.iter().map(of).max().unwrap_or(0).max(5);
    let (port, name) = (width(|known| known.port.len()), width(|known| known.name.as_ref().map_or(0, String::len)));
    let mut text = format!("{:<port$}  {:<name$}  from\n", "port", "robot");
    for known in &ports {
        let robot = known.name.as_deref().unwrap_or("-");
        text += &format!("{:<port$}  {robot:<name$}  {}\n", known.port, <&str>::from(known.source));
    }
    Ok(print(&text)?)
}
