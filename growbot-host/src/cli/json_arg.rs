//! The option --json of commands to a robot.

use clap::Args;
use growbot_client::command_report::CommandReport;
use growbot_host::output::print;
use growbot_plan::sanitize::json_line;

use super::failure::Failure;
use super::port_arg::SelectedPort;

/// The option that prints JSON.
#[derive(Args)]
pub struct JsonArg {
    /// Print one line of JSON
    #[arg(long)]
    json: bool,
}

impl JsonArg {
    /// Prints the message of a command that has succeeded at a port.
    pub fn print(&self, port: &SelectedPort, message: &str) -> Result<(), Failure> {
        let report = CommandReport::new(port.text(), port.kind(), message);
        Ok(print(&if self.json { json_line(&report) } else { message.to_owned() })?)
    }
}
