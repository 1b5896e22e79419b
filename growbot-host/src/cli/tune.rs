//! `growbot tune`: finds the gains of the heater's control loop on the robot.

use std::time::Duration;

use clap::Args;
use growbot_client::client::{Client, ClientError};
use growbot_client::command_report::TuningReport;
use growbot_client::growth::CommandQueue;
use growbot_core::link::message::{Message, State};
use growbot_host::output::print;
use growbot_plan::pose_text::parse_temperature;
use growbot_plan::robot_kind::RobotKind;
use growbot_plan::sanitize::json_line;

use super::failure::Failure;
use super::find_robot::robot_at;
use super::growth_monitor::clock_drift_failure;
use super::port_arg::RequiredPortArg;
use super::remedies;
use super::robot_arg::RobotArg;
use super::stop_on_interrupt::stop_on_interrupt;

/// Time without an event after which the board gets a status request.
const QUIET: Duration = Duration::from_secs(2);

/// Find the PID gains of the heater by letting the nozzle temperature oscillate around a target
///
/// The command prints the gains for the heater section of the robot file; the board does not store them. The nozzle
/// gets hot, but no motor moves. Tuning takes some minutes, and Ctrl-C stops it.
#[derive(Args)]
#[command(after_help = "Example:\n  growbot tune --port /dev/ttyACM0 --target 210")]
pub struct TuneArgs {
    #[command(flatten)]
    port: RequiredPortArg,
    #[command(flatten)]
    robot: RobotArg,
    /// Temperature, degrees Celsius [default: the robot's heater.target_c]
    #[arg(long, value_name = "C", allow_hyphen_values = true)]
    target: Option<String>,
    /// Print one line of JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &TuneArgs) -> Result<(), Failure> {
    let port = args.port.resolve()?;
    let robot = args.robot.load()?;
    let target = match &args.target {
        None => robot.description().heater.target_c,
        Some(text) => {
            parse_temperature(text).filter(|celsius| (-1000.0..=1000.0).contains(celsius)).ok_or_else(|| {
                Failure::bad_input(format!("--target {text:?} is not a temperature: give degrees Celsius"))
            })?
        }
    };
    let _lent = robot_at(&port, &args.robot)?.lease("growbot tune")?;
    let mut client = port.client(&robot)?;
    client.open_session_for(&robot)?;
    // From here on Ctrl-C stops the board. Nothing heats before this line.
    let orders = stop_on_interrupt(&mut client, &port);
    let tuned = tune(&mut client, &orders, target, port.kind())?;
    print(&if args.json {
        json_line(&tuned)
    } else {
        format!(
            "# the temperature swung by {:.2} C to either side of {target} C, with a period of {:.1} s\n{}",
            tuned.amplitude_c,
            tuned.period_s,
            tuned.robot_file_section()
        )
    })?;
    Ok(())
}

/// Tunes on the board, unless a stop was requested before.
fn tune(client: &mut Client, orders: &CommandQueue, target: f64, robot: RobotKind) -> Result<TuningReport, Failure> {
    if orders.stop_requested() {
        return Err(Failure::request_failed("tuning was stopped before anything was heated"));
    }
    client.tune(target, &orders.permit()).map_err(lost)?;
    growbot_host::note!("tuning the heater at {target} C, which takes some minutes");
    follow(client, orders, robot)
}

/// Converts an error of a board that tunes. The message warns that the robot may be heating if the board does not
/// respond.
fn lost(error: ClientError) -> Failure {
    match error {
        ClientError::Refused { .. } | ClientError::StopNotAcknowledged { .. } => error.into(),
        error => Failure::request_failed(format!(
            "{}; the robot may still be heating: run `growbot status`, and if that fails cut the robot's power",
            remedies::message(&error)
        )),
    }
}

fn follow(client: &mut Client, orders: &CommandQueue, robot: RobotKind) -> Result<TuningReport, Failure> {
    loop {
        if orders.stop_requested() {
            return Err(Failure::request_failed(remedies::stop_message(client.stop()?, robot)));
        }
        if let Some(drift) = client.stop_if_clock_drifts()? {
            return Err(clock_drift_failure(&drift, robot));
        }
        match client.event(QUIET).map_err(lost)? {
            Some(Message::Tuned(tuned)) => return Ok(TuningReport::new(&tuned, robot)),
            Some(_) => {}
            None => {
                let status = client.status().map_err(lost)?;
                match (status.state, status.fault) {
                    (State::Tuning, _) => {}
                    (_, Some(fault)) => {
                        return Err(Failure::request_failed(format!(
                            "fault {}: {}",
                            fault.code(),
                            remedies::fault_explanation(fault)
                        )));
                    }
                    (state, None) => {
                        return Err(Failure::request_failed(format!(
                            "the board is in state {} and has not reported the heater's gains: tuning was stopped, or \
                             the report was lost; run `growbot tune` again",
                            state.name()
                        )));
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::rc::Rc;

    use growbot_plan::robot_file;
    use growbot_sim::port::sim::Sim;

    use super::*;

    /// Returns a board, and a client that has a session with it.
    fn board() -> (Rc<RefCell<Sim>>, Client) {
        let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
        let sim = Rc::new(RefCell::new(Sim::new(robot.clone())));
        let mut client = Client::new(Box::new(Rc::clone(&sim)), "sim");
        client.open_session_for(&robot).unwrap();
        (sim, client)
    }

    #[test]
    fn an_interrupt_before_tuning_starts_heats_nothing() {
        let (sim, mut client) = board();
        let orders = CommandQueue::default();
        orders.interrupt();
        let Err(failure) = tune(&mut client, &orders, 200.0, RobotKind::Simulated) else { panic!("it has tuned") };
        assert!(failure.message().contains("before anything was heated"), "{}", failure.message());
        assert_eq!(sim.borrow().state(), State::Idle);
        assert!(sim.borrow_mut().simulated_tip().nozzle_c() < 30.0);
    }

    #[test]
    fn an_interrupt_during_tuning_stops_it() {
        let (sim, mut client) = board();
        let orders = CommandQueue::default();
        client.tune(200.0, &orders.permit()).unwrap();
        client.wait(Duration::from_secs(5)).unwrap();
        assert_eq!(sim.borrow().state(), State::Tuning);
        orders.interrupt();
        let Err(failure) = follow(&mut client, &orders, RobotKind::Simulated) else { panic!("it has tuned") };
        assert_eq!(failure.message(), "stopped: heater and steppers of the simulated robot are off");
        assert_eq!(sim.borrow().state(), State::Stopped);
        assert!(!sim.borrow_mut().simulated_tip().heater_is_on());
    }
}
