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
        Ok(print(&self.report(port, message))?)
    }

    /// Returns the message of a command that has succeeded at a port, as text or as JSON.
    pub fn report(&self, port: &SelectedPort, message: &str) -> String {
        let report = || json_line(&CommandReport::new(port.text(), port.kind(), message));
        if self.json { report() } else { format!("{}\n", message.trim_end()) }
    }
}
