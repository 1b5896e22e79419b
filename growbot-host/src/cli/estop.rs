//! `growbot estop`: the emergency stop.

use std::fmt::Display;
use std::process::ExitCode;
use std::thread::sleep;

use clap::Args;
use growbot_host::client::{Client, EMERGENCY_LIMIT, EMERGENCY_PAUSE};
use growbot_host::output::print;
use growbot_host::port::{self, PortName, real_time};

use super::{ChosenPort, Failure, RobotArg, RobotPortArg};

/// Emergency stop: heater and steppers off before the board does anything else
///
/// Whoever holds the board or the port, and whatever is queued: eight bytes that the board recognises as they arrive, sent again and again for
/// three seconds until it says that it has obeyed. It stays off until the stop is cleared (`clear` in `growbot console`).
#[derive(Args)]
#[command(
    after_help = "Example:\n  growbot estop --port /dev/ttyACM0\n\nExit codes: 0, the board has said that everything is off; 1, it has not,\nfor whatever reason: cut its power."
)]
pub struct EstopArgs {
    #[command(flatten)]
    port: RobotPortArg,
    #[command(flatten)]
    robot: RobotArg,
}

/// Runs the command. Whatever fails, its exit code is 1, and it says to cut the power.
pub fn run(args: &EstopArgs) -> Result<(), Failure> {
    let port = args.port.choose().map_err(|failure| cut_the_power(failure.message()))?;
    stop(&port, &args.robot).map_err(cut_the_power)?;
    let done = format!("emergency stop: heater and steppers of the {}robot are off\n", port.kind());
    if print(&done).is_err() {
        // The board has obeyed, whether or not anybody can read it.
        growbot_host::tell!("growbot: {}", done.trim_end());
    }
    Ok(())
}

/// Why nobody has acknowledged the stop, and what to do.
fn cut_the_power(why: impl Display) -> Failure {
    Failure::answered_no(format!("NOBODY HAS ACKNOWLEDGED THE EMERGENCY STOP: cut the power of the robot now ({why})"))
}

/// What a command line that cannot be understood ends with. An emergency stop that is mistyped stops nothing, and that is said.
pub fn usage_error(error: &clap::Error) -> ExitCode {
    let is_estop = std::env::args_os().any(|argument| argument == "estop");
    if !is_estop || !error.use_stderr() {
        return ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2));
    }
    cut_the_power("none was sent: the command line was not understood").report()
}

/// Has the board stop, or tells why nobody knows whether it has.
fn stop(port: &ChosenPort, robot: &RobotArg) -> Result<(), String> {
    if port.is_simulated() {
        let robot = robot.load().map_err(|failure| failure.message().to_string())?;
        let mut client = port.client(&robot).map_err(|failure| failure.message().to_string())?;
        return client.emergency_stop().map_err(|error| error.to_string());
    }
    let began = real_time();
    let left = || EMERGENCY_LIMIT.saturating_sub(real_time().saturating_sub(began));
    loop {
        // A line that breaks or is not there may come back: it is opened anew for as long as a stop is tried.
        let why = match port::open_for_emergency_stop(port.name(), left()) {
            Err(error) => error,
            Ok(line) => match Client::new(line, port.text()).emergency_stop_within(left()) {
                Ok(true) => return Ok(()),
                Ok(false) => return Err(unheard(port)),
                Err(error) => error,
            },
        };
        if left().is_zero() {
            return Err(why.to_string());
        }
        sleep(EMERGENCY_PAUSE.min(left()));
    }
}

/// The bytes were sent for as long as they are, and no answer came.
fn unheard(port: &ChosenPort) -> String {
    let mut why = format!("{} has not answered for {} s", port.text(), EMERGENCY_LIMIT.as_secs());
    if matches!(port.name(), PortName::Tcp(_)) {
        why += "; a robot behind TCP hears one program at a time, and another one may be connected";
    }
    why
}
