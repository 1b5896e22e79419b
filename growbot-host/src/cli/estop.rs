//! `growbot estop`: the emergency stop.

use std::fmt::Display;
use std::process::ExitCode;
use std::thread::{self, ScopedJoinHandle, sleep};
use std::time::Duration;

use clap::{Args, Command};
use growbot_client::client::{Client, EMERGENCY_LIMIT, EMERGENCY_PAUSE};
use growbot_client::port::time_since_boot;
use growbot_host::output::print;
use growbot_remote::client::RESPONSE_TIMEOUT;
use growbot_remote::emergency::ServiceStop;
use growbot_serve::settings::{self, InvalidFiles, SettingOrigin};
use growbot_sim::port::{self, OpenError, PortName};

use super::failure::Failure;
use super::json_arg::JsonArg;
use super::port_arg::{RequiredPortArg, SelectedPort};
use super::robot_arg::RobotArg;
use super::service_lookup::{EMERGENCY, robots_in_emergency, service_in_emergency};
use super::{remedies, usage};

/// Emergency stop: heater and steppers off before the board does anything else
///
/// The command sends eight bytes that the board recognises as they arrive. It repeats them for three seconds, until the
/// board acknowledges them. It works beside another host or program that owns the board or the port, and ahead of all
/// queued bytes. The board stays off until the stop is cleared (`growbot clear`).
///
/// Without --port, the command stops every robot of the service and of growbot.toml.
#[derive(Args)]
#[command(
    after_help = "Examples:\n  growbot estop\n  growbot estop --port lab-1\n  growbot estop --port /dev/ttyACM0\n\nExit \
                        codes: 0, each board has confirmed that everything is off; 1, one has not,\nfor any reason: \
                        cut its power."
)]
pub struct EstopArgs {
    #[command(flatten)]
    port: RequiredPortArg,
    #[command(flatten)]
    /// Accepted, because the other commands on a board have it. No stop depends on it.
    _robot: RobotArg,
    #[command(flatten)]
    json: JsonArg,
}

/// Runs the command. On any failure its exit code is 1, and its message advises to cut the power.
pub fn run(args: &EstopArgs) -> Result<(), Failure> {
    let ports = ports(&args.port).map_err(|failure| unacknowledged(failure.message()))?;
    // Each robot has a thread, so that none waits for another.
    let stopped: Vec<Result<(), String>> = thread::scope(|scope| {
        let threads: Vec<_> = ports.iter().map(|port| scope.spawn(|| stop(port))).collect();
        let end = |thread: ScopedJoinHandle<_>| {
            thread.join().unwrap_or_else(|_| Err("the program's thread for this robot failed".to_owned()))
        };
        threads.into_iter().map(end).collect()
    });
    let mut failed = Vec::new();
    for (port, stopped) in ports.iter().zip(stopped) {
        let at = if ports.len() > 1 { format!(" at {}", port.text()) } else { String::new() };
        match stopped {
            Ok(()) => {
                let done =
                    format!("emergency stop: heater and steppers of the {}robot{at} are off\n", port.kind().prefix());
                if print(&args.json.report(port, &done)).is_err() {
                    // The board has stopped, even if the result cannot be printed.
                    growbot_host::warning!("{}", done.trim_end());
                }
            }
            Err(why) => failed.push(format!("{why}{at}")),
        }
    }
    if failed.is_empty() { Ok(()) } else { Err(unacknowledged(failed.join("; "))) }
}

/// Returns the given port, or those of all robots: of the service, of the settings, and the default one. A settings
/// file that cannot be used is left out with a warning.
fn ports(given: &RequiredPortArg) -> Result<Vec<SelectedPort>, Failure> {
    let mut skipped = Vec::new();
    let found = ports_from_files(given, InvalidFiles::Skip(&mut skipped));
    if let (Err(_), [error, ..]) = (&found, &skipped[..]) {
        return Err(Failure::before_start(error));
    }
    for error in &skipped {
        growbot_host::warning!(
            "the settings cannot be read, so robots that are named only in the settings are not stopped: {}",
            remedies::message(error)
        );
    }
    found
}

fn ports_from_files(given: &RequiredPortArg, mut invalid: InvalidFiles) -> Result<Vec<SelectedPort>, Failure> {
    if given.is_given() {
        return Ok(vec![given.resolve_configured(invalid)?]);
    }
    let owned = robots_in_emergency().into_iter().map(|robot| robot.port);
    let settings = settings::load_service(invalid.reborrow()).unwrap_or_default();
    if let (SettingOrigin::Nearest(file) | SettingOrigin::User(file), false) =
        (&settings.origin, settings.robots.is_empty())
    {
        growbot_host::note!("stopping the robots of {} and of the service", file.display());
    }
    let default = given.resolve_configured(invalid);
    let mut ports: Vec<SelectedPort> = Vec::new();
    let owned: Vec<_> = owned.filter_map(|port| given.at(port).ok()).collect();
    let configured = settings.robots.into_values().filter_map(|entry| given.at(entry.port).ok());
    // A simulated robot without a service ends with the program that runs it.
    let configured = configured.chain(default.as_ref().ok().cloned()).filter(|port| !port.is_in_process());
    for port in owned.into_iter().chain(configured) {
        if ports.iter().all(|other| other.text() != port.text()) {
            ports.push(port);
        }
    }
    if ports.is_empty() { default.map(|port| vec![port]) } else { Ok(ports) }
}

/// Stops one robot. Returns the reason if its board did not acknowledge the stop.
fn stop(port: &SelectedPort) -> Result<(), String> {
    let mut by_service = ServiceStop::begin(service_in_emergency(), port.text());
    // Only the service can stop a robot that is simulated inside it.
    if by_service.wait(if port.is_in_process() { 2 * RESPONSE_TIMEOUT } else { EMERGENCY }) {
        return Ok(());
    }
    if port.is_in_process() && by_service.has_failed() {
        return Err("the service has not confirmed the emergency stop".to_owned());
    }
    stop_at_port(port, || by_service.wait(Duration::ZERO))
}

/// Returns the failure for a stop that the board did not acknowledge, with the advice to cut the power.
fn unacknowledged(why: impl Display) -> Failure {
    Failure::request_failed(format!("THE BOARD DID NOT CONFIRM THE EMERGENCY STOP: cut the robot's power now ({why})"))
}

/// Reports a command line that cannot be parsed. For an emergency stop, the message states that none was sent.
pub fn usage_error(error: &clap::Error, root: &Command) -> ExitCode {
    let is_estop = std::env::args().any(|argument| argument == "estop" || usage::EMERGENCY_WORDS.contains(&&*argument));
    if !is_estop {
        return Failure::bad_input(usage::message(error, root)).report();
    }
    unacknowledged(format_args!("no emergency stop was sent: {}", usage::message(error, root))).report()
}

/// Sends the stop to the port itself, until the board or `is_confirmed` confirms it or the time is over.
fn stop_at_port(port: &SelectedPort, mut is_confirmed: impl FnMut() -> bool) -> Result<(), String> {
    port.require_running_robot("the emergency stop").map_err(|failure| failure.message().to_string())?;
    let mut attempts = 0;
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
            Ok(line) => {
                let mut client = Client::new(line, port.text());
                loop {
                    match client.emergency_stop_within(EMERGENCY_PAUSE, &mut attempts) {
                        Ok(by_board) if by_board || is_confirmed() => return Ok(()),
                        Ok(_) if left().is_zero() => {
                            let why = why.map_or_else(|| unheard(port), |error| remedies::message(&error));
                            return Err(tried(&why, attempts, elapsed()));
                        }
                        Ok(_) => {}
                        Err(error) => break error.into(),
                    }
                }
            }
        };
        if is_confirmed() {
            return Ok(());
        }
        let is_over = left().is_zero();
        // An error because the time ran out does not replace the error of an earlier attempt.
        let latest = match why {
            Some(before) if is_over => before,
            _ => error,
        };
        if is_over {
            return Err(tried(&remedies::message(&latest), attempts, elapsed()));
        }
        why = Some(latest);
        sleep(EMERGENCY_PAUSE.min(left()));
    }
}

/// Returns the reason with the number of attempts and their duration.
fn tried(why: &str, attempts: u32, time: Duration) -> String {
    let times = if attempts == 1 { "once" } else { &format!("{attempts} times") };
    format!("{why}; the stop was tried {times} in {:.1} s", time.as_secs_f64())
}

/// Returns the reason for a stop that was sent for the whole time without a response.
fn unheard(port: &SelectedPort) -> String {
    let mut why = format!("{} has not responded for {} s", port.text(), EMERGENCY_LIMIT.as_secs());
    if matches!(port.name(), PortName::Tcp(_)) {
        why += "; a robot behind TCP serves one program at a time, and another program may be connected";
    }
    why
}
