//! `growbot recover`: leads a person through the steps after a fault, a stop, a pause or a runout.

use std::io::{self, IsTerminal};
use std::thread::sleep;
use std::time::{Duration, Instant};

use clap::Args;
use growbot_client::growth::OnInterrupted;
use growbot_client::recovery::{RecoveryAction, RecoverySequence, RecoveryStep, StepEffect};
use growbot_client::robot_command::RobotCommand;
use growbot_client::status::RobotStatus;
use growbot_core::link::message::HostSilencePolicy;
use growbot_host::output::print;
use growbot_plan::sanitize::json_line;
use growbot_plan::text_wrap::{TERMINAL_WIDTH, wrap};

use super::failure::Failure;
use super::find_robot::robot_at;
use super::growth_monitor::ResultFormat;
use super::port_arg::RequiredPortArg;
use super::robot_arg::RobotArg;
use super::robot_handle::{ResumedGrowth, RobotHandle};
use super::typed_answer::read_answer;
use super::watch_options::WatchArgs;

/// Difference to the target below which the nozzle counts as hot, C.
const HOT_WITHIN_C: f64 = 5.0;
/// Time after which the status of a growth that pauses has the new target.
const SETTLING_TIME: Duration = Duration::from_secs(5);
/// Interval of the requests for the temperature while the nozzle heats.
const HEATING_POLL_INTERVAL: Duration = Duration::from_millis(500);

/// Lead through the steps after a fault, a stop, a pause or a filament runout
///
/// The command shows the cause, what is safe, and the steps. On a terminal it then prompts before each step. A step
/// that heats or moves has its own confirmation. You can leave after any step: the robot stays in the state that
/// `growbot status` shows. In a pipe, and with --json, the steps are printed and nothing is done.
#[derive(Args)]
#[command(after_help = "Examples:\n  growbot recover\n  growbot recover lab-1\n  growbot recover lab-1 --json")]
pub struct RecoverArgs {
    /// The robot, by its name or port, like --port
    #[arg(value_name = "ROBOT", conflicts_with = "port")]
    name: Option<String>,
    #[command(flatten)]
    port: RequiredPortArg,
    #[command(flatten)]
    robot: RobotArg,
    /// Print the steps as one line of JSON, null if the robot needs nothing
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &RecoverArgs) -> Result<(), Failure> {
    let port = match &args.name {
        Some(name) => args.port.at(name.clone())?,
        None => args.port.resolve_or_only()?,
    };
    let robot = || robot_at(&port, &args.robot);
    let sequence = RecoverySequence::of(&robot()?.status()?.status);
    if args.json {
        return Ok(print(&json_line(&sequence))?);
    }
    let Some(mut sequence) = sequence else {
        return Ok(print(&format!("the {}robot needs nothing: see `growbot status`\n", port.kind().prefix()))?);
    };
    loop {
        print(&text_of(&sequence, port.kind().prefix()))?;
        if !io::stdin().is_terminal() {
            return Ok(());
        }
        let ended = run_sequence(&sequence, robot)?;
        if ended == SequenceEnd::Left {
            return Ok(print(&format!("left. {}\n", sequence.safety))?);
        }
        match RecoverySequence::of(&robot()?.status()?.status) {
            None => return Ok(print("the robot needs nothing else\n")?),
            Some(next) if ended == SequenceEnd::Done && next.situation == sequence.situation => {
                return Ok(print("these were all steps: see `growbot status`\n")?);
            }
            Some(next) => sequence = next,
        }
    }
}

/// End of a sequence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum SequenceEnd {
    /// All steps are done.
    Done,
    /// The robot is in another situation, which interrupts the sequence, or the alternative was chosen.
    Interrupted,
    /// The person has left.
    Left,
}

/// Prompts for each step of a sequence, and carries it out. A step changes the situation, and the sequence goes on
/// unless the new situation interrupts it.
fn run_sequence<'a>(
    sequence: &RecoverySequence,
    robot: impl Fn() -> Result<Box<dyn RobotHandle + 'a>, Failure>,
) -> Result<SequenceEnd, Failure> {
    for step in &sequence.steps {
        match ask(step, sequence.alternative.as_ref())? {
            Answer::Leave => return Ok(SequenceEnd::Left),
            Answer::Alternative(action) => {
                carry_out(action, robot()?.as_ref())?;
                return Ok(SequenceEnd::Interrupted);
            }
            Answer::Do => {
                if let Some(action) = step.action {
                    carry_out(action, robot()?.as_ref())?;
                }
            }
        }
        let now = RecoverySequence::of(&robot()?.status()?.status).map(|now| now.situation);
        if now.is_some_and(|now| now.interrupts() && now != sequence.situation) {
            return Ok(SequenceEnd::Interrupted);
        }
    }
    Ok(SequenceEnd::Done)
}

/// Answer of the person to a step.
enum Answer {
    Do,
    Alternative(RecoveryAction),
    Leave,
}

/// Prompts for the confirmation of a step.
fn ask(step: &RecoveryStep, alternative: Option<&RecoveryStep>) -> Result<Answer, Failure> {
    let confirm = |step: &RecoveryStep| match (step.action, warning(step.effect)) {
        (None, _) => "Done? [y/N] ".to_owned(),
        (Some(_), None) => "Do it? [y/N] ".to_owned(),
        (Some(_), Some(warning)) => format!("{warning} Do it? [y/N] "),
    };
    let is_yes = |question: String| -> Result<bool, Failure> {
        print(&question)?;
        let answer = read_answer().map_err(Failure::bad_input)?.unwrap_or_default();
        Ok(matches!(answer.trim(), "y" | "yes"))
    };
    print(&format!("\n{}\n", step.text))?;
    if is_yes(confirm(step))? {
        return Ok(Answer::Do);
    }
    if let Some(RecoveryStep { action: Some(action), text, .. }) = alternative {
        print(&format!("\nOr: {text}\n"))?;
        if is_yes(alternative.map(confirm).unwrap_or_default())? {
            return Ok(Answer::Alternative(*action));
        }
    }
    Ok(Answer::Leave)
}

/// Returns the warning before a step. `None` for a safe one.
fn warning(effect: StepEffect) -> Option<&'static str> {
    match effect {
        StepEffect::Safe => None,
        StepEffect::Heats => Some("The nozzle gets hot."),
        StepEffect::Moves => Some("The motors move."),
        StepEffect::HeatsAndMoves => Some("The nozzle gets hot, and the motors move."),
        StepEffect::Discards => Some("The body cannot be resumed after that."),
        StepEffect::MayStayOn => Some("The robot may stay hot or moving."),
    }
}

/// Carries an action out, and prints its result.
fn carry_out(action: RecoveryAction, robot: &dyn RobotHandle) -> Result<(), Failure> {
    let message = match action {
        RecoveryAction::ClearFault => robot.command(RobotCommand::ClearFault)?,
        RecoveryAction::Continue => robot.command(RobotCommand::Continue)?,
        RecoveryAction::Cancel => robot.command(RobotCommand::Cancel)?,
        RecoveryAction::Stop => robot.command(RobotCommand::Stop)?,
        RecoveryAction::WithdrawStop => robot.command(RobotCommand::WithdrawStop)?,
        RecoveryAction::Resume => {
            return robot.resume(ResumedGrowth {
                opened: None,
                scene: None,
                interrupted: OnInterrupted::Redo,
                silence: HostSilencePolicy::Pause,
                is_confirmed: true,
                watching: &WatchArgs::default(),
                print: ResultFormat::Table,
            });
        }
        RecoveryAction::Preheat => {
            print(&format!("{}\n", robot.maintain(action.code(), "")?))?;
            return wait_until_hot(robot);
        }
        RecoveryAction::Load
        | RecoveryAction::Purge
        | RecoveryAction::Cooldown
        | RecoveryAction::DryRun
        | RecoveryAction::Home
        | RecoveryAction::Jog => robot.maintain(action.code(), action.value())?,
        RecoveryAction::Tune => return Err(Failure::bad_input("tune the heater: `growbot tune`")),
    };
    Ok(print(&format!("{message}\n"))?)
}

/// Waits until the nozzle is at its target. The board's supervision ends a heating that takes too long with a fault.
fn wait_until_hot(robot: &dyn RobotHandle) -> Result<(), Failure> {
    let began = Instant::now();
    loop {
        sleep(HEATING_POLL_INTERVAL);
        let RobotStatus { temperature_c, target_c, fault, state, .. } = robot.status()?.status;
        if fault.is_none() && began.elapsed() < SETTLING_TIME {
            continue;
        }
        match (temperature_c, target_c) {
            (Some(temperature), Some(target)) if temperature > target - HOT_WITHIN_C => {
                return Ok(print(&format!("the nozzle is at {temperature:.0} C\n"))?);
            }
            (_, Some(_)) => {}
            (_, None) => {
                let why = fault.or(state).unwrap_or_else(|| "unknown state".to_owned());
                return Err(Failure::request_failed(format!(
                    "the nozzle does not heat ({why}): see `growbot status`, then run this command again"
                )));
            }
        }
    }
}

/// Returns a sequence as text.
fn text_of(sequence: &RecoverySequence, kind: &str) -> String {
    let mut text = String::new();
    for (label, words) in [
        ("situation", format!("{} of the {kind}robot", sequence.situation.code())),
        ("cause", sequence.cause.clone()),
        ("safe", sequence.safety.to_owned()),
    ] {
        text += &wrap(&words, TERMINAL_WIDTH, &format!("{label:<11}"), &" ".repeat(11));
    }
    for (number, step) in sequence.steps.iter().enumerate() {
        text += &wrap(&step.text, TERMINAL_WIDTH, &format!("{:>9}. ", number + 1), &" ".repeat(11));
    }
    if let Some(step) = &sequence.alternative {
        text += &wrap(&step.text, TERMINAL_WIDTH, "       or  ", &" ".repeat(11));
    }
    text
}
