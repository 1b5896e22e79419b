//! `growbot estop`: the emergency stop.

use std::fmt::Display;
use std::process::ExitCode;
use std::thread::sleep;
use std::time::Duration;

use clap::Args;
use growbot_client::client::{Client, EMERGENCY_LIMIT, EMERGENCY_PAUSE};
use growbot_client::port::time_since_boot;
use growbot_host::output::print;
use growbot_sim::port::{self, OpenError, PortName};

use super::service_robot::owner_in_emergency;
use super::{Failure, RequiredPortArg, RobotArg, SelectedPort, usage};

/// Emergency stop: heater and steppers off before the board does anything else
///
/// The command sends eight bytes that the board recognises as they arrive. It repeats them for three seconds, until the
/// board acknowledges them. It works beside another host or program that owns the board or the port, and ahead of all
/// queued bytes. The board stays off until the stop is cleared (`clear` in `growbot console`).
#[derive(Args)]
#[command(after_help = "Example:\n  growbot estop --port /dev/ttyACM0\n\nExit codes: 0, the board has confirmed that \
                        everything is off; 1, it has not,\nfor any reason: cut its power.")]
pub struct EstopArgs {
    #[command(flatten)]
    port: RequiredPortArg,
    #[command(flatten)]
    robot: RobotArg,
}

/// Runs the command. On any failure its exit code is 1, and its message advises to cut the power.
pub fn run(args: &EstopArgs) -> Result<(), Failure> {
    let port = args.port.choose().map_err(|failure| unacknowledged(failure.message()))?;
    // A service that does not respond must not delay the stop.
    let by_service = owner_in_emergency(&port).is_some_and(|owned| owned.emergency_stop());
    if !by_service {
        stop(&port, &args.robot).map_err(unacknowledged)?;
    }
    let done = format!("emergency stop: heater and steppers of the {}robot are off\n", port.kind());
    if print(&done).is_err() {
        // The board has stopped, even if the result cannot be printed.
        growbot_host::warning!("{}", done.trim_end());
    }
    Ok(())
}

/// Returns the failure for a stop that the board did not acknowledge, with the advice to cut the power.
fn unacknowledged(why: impl Display) -> Failure {
    Failure::request_failed(format!("THE BOARD DID NOT CONFIRM THE EMERGENCY STOP: cut the robot's power now ({why})"))
}

/// Reports a command line that cannot be parsed. For an emergency stop, the message states that none was sent.
pub fn usage_error(error: &clap::Error) -> ExitCode {
    let is_estop = std::env::args_os().any(|argument| argument == "estop");
    if !is_estop {
        return Failure::bad_input(usage::message(error)).report();
    }
    unacknowledged(format_args!("no emergency stop was sent: {}", usage::message(error))).report()
}

/// Stops the board. Returns the reason if the board did not acknowledge the stop.
fn stop(port: &SelectedPort, robot: &RobotArg) -> Result<(), String> {
    let mut attempts = 0;
    if port.is_in_process() {
        let robot = robot.load().map_err(|failure| failure.message().to_string())?;
        let mut client = port.client(&robot).map_err(|failure| failure.message().to_string())?;
        let began = client.port().now();
        let why = match client.emergency_stop_within(EMERGENCY_LIMIT, &mut attempts) {
            Ok(true) => return Ok(()),
            Ok(false) => unheard(port),
            Err(error) => error.to_string(),
        };
        return Err(tried(&why, attempts, client.port().now().saturating_sub(began)));
    }
    let began = time_since_boot();
    let elapsed = || time_since_boot().saturating_sub(began);
    let left = || EMERGENCY_LIMIT.saturating_sub(elapsed());
    let mut why: Option<OpenError> = None;
    loop {
        // A port that fails or does not exist may come back, so it is opened again until the time is over.
        let error = match port::open_for_emergency_stop(port.name(), left()) {
            Err(error) => {
                attempts += 1;
                error
            }
            Ok(line) => match Client::new(line, port.text()).emergency_stop_within(left(), &mut attempts) {
                Ok(true) => return Ok(()),
                Ok(false) => {
                    let why = why.map_or_else(|| unheard(port), |error| error.to_string());
                    return Err(tried(&why, attempts, elapsed()));
                }
                Err(error) => error.into(),
            },
        };
        let is_over = left().is_zero();
        // An error because the time ran out does not replace the error of an earlier attempt.
        let latest = match why {
            Some(before) if is_over => before,
            _ => error,
        };
        if is_over {
            return Err(tried(&latest.to_string(), attempts, elapsed()));
        }
        why = Some(latest);
        sleep(EMERGENCY_PAUSE.min(left()));
    }
}

/// Returns the reason with the number of attempts and their duration.
fn tried(why: &str, attempts: u32, time: Duration) -> String {
    let times = if attempts == 1 { "once" } else { &format!("{attempts} times") };
    format!("{why}; tried {times} in {:.1} s", time.as_secs_f64())
}

/// Returns the reason for a stop that was sent for the whole time without a response.
fn unheard(port: &SelectedPort) -> String {
    let mut why = format!("{} has not responded for {} s", port.text(), EMERGENCY_LIMIT.as_secs());
    if matches!(port.name(), PortName::Tcp(_)) {
        why += "; a robot behind TCP serves one program at a time, and another program may be connected";
    }
    why
}
