//! `growbot tune`: the gains of the heater's regulation, found on the robot.

use std::time::Duration;

use clap::Args;
use growbot_core::link::message::{Empty, Message, State, Tune, Tuned};
use growbot_host::client::Client;
use growbot_host::growth::Orders;
use growbot_host::output::print;
use growbot_host::pose_text::parse_number;
use serde_json::json;

use super::following::stopped_for;
use super::interrupt::stop_on_interrupt;
use super::{Failure, RobotArg, RobotPortArg, kind};

/// How long the board may be quiet before it is asked how it does.
const QUIET: Duration = Duration::from_secs(2);

/// Find the gains of the heater's regulation by driving the nozzle round a temperature
///
/// Prints lines for the heater section of the robot file: the board itself changes nothing. Takes some minutes; Ctrl-C stops
/// it. Nothing moves.
#[derive(Args)]
#[command(after_help = "Example:\n  growbot tune --port /dev/ttyACM0 --target 210")]
pub struct TuneArgs {
    #[command(flatten)]
    port: RobotPortArg,
    #[command(flatten)]
    robot: RobotArg,
    /// The temperature, degrees Celsius [default: the robot's heater.target_c]
    #[arg(long, value_name = "C", allow_hyphen_values = true)]
    target: Option<String>,
    /// Print one line of JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &TuneArgs) -> Result<(), Failure> {
    let port = args.port.choose()?;
    let robot = args.robot.load()?;
    let target = match &args.target {
        None => robot.description().heater.target_c,
        Some(text) => parse_number(text)
            .filter(|celsius| (-1000.0..=1000.0).contains(celsius))
            .ok_or_else(|| Failure::bad_input(format!("--target {text:?} is no temperature: give degrees Celsius")))?,
    };
    let mut client = port.client(&robot)?;
    client.hello_robot(&robot)?;
    // Before anything heats: from here on Ctrl-C stops the board.
    let orders = stop_on_interrupt(&mut client, &port);
    client.request("to tune", &Message::Tune(Tune { target_centi_c: (target * 100.0) as i32 }))?;
    growbot_host::tell!("growbot: tuning at {target} C; this takes some minutes");
    let tuned = follow(&mut client, &orders, port.is_simulated())?;
    let gains = &tuned.gains;
    print(&if args.json {
        let result = json!({
            "kp": gains.kp, "ki": gains.ki, "kd": gains.kd,
            "period_s": tuned.period_s, "amplitude_c": tuned.amplitude_c,
            "simulated": port.is_simulated(),
        });
        format!("{result}\n")
    } else {
        let caution = if port.is_simulated() {
            "# found on a simulated robot: they suit no real one, which finds its own\n"
        } else {
            ""
        };
        format!(
            "{caution}# swung by {:.2} C with a period of {:.1} s round {target} C\n[heater]\nkp = {:.5}\nki = {:.6}\nkd = {:.4}\n",
            tuned.amplitude_c, tuned.period_s, gains.kp, gains.ki, gains.kd
        )
    })?;
    Ok(())
}

fn follow(client: &mut Client, orders: &Orders, simulated: bool) -> Result<Tuned, Failure> {
    loop {
        if orders.stops() {
            client.request("to stop", &Message::Stop(Empty {}))?;
            return Err(Failure::answered_no(format!(
                "stopped: heater and steppers of the {}robot are off",
                kind(simulated)
            )));
        }
        if let Some(drift) = client.stop_if_clock_drifts()? {
            return Err(stopped_for(&drift, simulated));
        }
        match client.event(QUIET)? {
            Some(Message::Tuned(tuned)) => return Ok(tuned),
            Some(_) => {}
            None => {
                let status = client.status()?;
                match (status.state, status.fault) {
                    (State::Tuning, _) => {}
                    (_, Some(fault)) => {
                        return Err(Failure::answered_no(format!("fault {}: {}", fault.code(), fault.explanation())));
                    }
                    (state, None) => {
                        return Err(Failure::answered_no(format!(
                            "the board is {} and has told no gains: it was stopped, or the news was lost; tune again",
                            state.name()
                        )));
                    }
                }
            }
        }
    }
}
