//! Handling of Ctrl-C and of requests to end: the robot is stopped first.

use std::sync::Arc;

use growbot_client::client::{Client, ClientError};
use growbot_client::growth::CommandQueue;
use growbot_client::port::Port;
use growbot_host::interrupt::on_interrupt;

use super::port_arg::SelectedPort;

/// Requests a stop at Ctrl-C, at SIGTERM and when the terminal goes away. A second signal gives the emergency stop and
/// ends the program, because users expect that of a program that seems to hang. The emergency stop has its own link, so
/// that it does not wait for the rest of the program.
pub fn stop_on_interrupt(client: &mut Client, port: &SelectedPort) -> Arc<CommandQueue> {
    let orders = Arc::new(CommandQueue::default());
    let given = Arc::clone(&orders);
    let (mut line, name, ends_with_us) = (client.emergency_port(), port.text().to_string(), port.is_in_process());
    let kind = port.kind().prefix();
    react_to_interrupt(move || {
        if given.interrupt() {
            // The line is held to the end, so that the rest of the program does not continue in between.
            let _line = if ends_with_us { None } else { stop_at_once(line.take(), &name) };
            std::process::exit(1);
        }
        growbot_host::warning!(
            "stopping; press Ctrl-C again for the emergency stop, and to leave without waiting for the \
             {kind}robot"
        );
    });
    orders
}

/// Sets the reaction to Ctrl-C, to SIGTERM and to the end of the terminal. If that fails, a warning is printed.
pub fn react_to_interrupt(action: impl FnMut() + Send + 'static) {
    if let Err(error) = on_interrupt(action) {
        growbot_host::warning!(
            "Ctrl-C will end this program, but will not stop the robot ({error}): stop the robot with `growbot stop` \
             or `growbot estop`"
        );
    }
}

/// Sends the emergency stop on the port `line`, and prints the result. Returns the client of that port.
fn stop_at_once(line: Option<Box<dyn Port + Send>>, name: &str) -> Option<Client> {
    growbot_host::warning!("sending the emergency stop");
    let mut client = line.map(|line| Client::new(line, name));
    let stopped = client.as_mut().is_some_and(|client| client.emergency_stop().is_ok());
    if stopped {
        growbot_host::warning!(
            "emergency stop: heater and steppers are off until the emergency stop is cleared (`growbot clear`)"
        );
    } else {
        let error = ClientError::StopNotAcknowledged { port: name.to_string() };
        growbot_host::error!("{error}");
    }
    client
}
