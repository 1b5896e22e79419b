//! `growbot console`: commands line by line, on a terminal or in a pipe.

use std::io::{self, BufRead, IsTerminal};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use clap::Args;
use growbot_core::layer_bytes::decode;
use growbot_core::link::message::{Accepted, Empty, HeldLayers, Message, PlanRequest, ReadLayers, Silence, Start};
use growbot_core::plan::Planner;
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_host::client::Client;
use growbot_host::degrees::degrees_below_turn;
use growbot_host::growth::{Job, News, grow_job};
use growbot_host::output::print;
use growbot_host::plan::{Plan, Search};
use growbot_host::port;
use growbot_host::pose_text::{parse_number, parse_pose};
use rustyline::DefaultEditor;
use rustyline::error::ReadlineError;

use super::interrupt::stop_on_interrupt;
use super::status::Report;
use super::{Failure, PortArg, RobotArg, growth_table};

/// Type commands, see the robot; works in a pipe
///
/// `help` lists the commands. In a pipe each line of standard input is a command, and the exit code is 1 if any was refused.
#[derive(Args)]
#[command(
    after_help = "Examples:\n  growbot console --port /dev/ttyACM0\n  printf 'plan 0,0,60,0,90\\nstart\\nwait 60\\nstatus\\n' | growbot console"
)]
pub struct ConsoleArgs {
    #[command(flatten)]
    port: PortArg,
    #[command(flatten)]
    robot: RobotArg,
}

const HELP: &str = "\
status          who the board is, what it is doing, what its sensors say
plan POSE       the board plans from 0,0,0,0,90 to POSE and holds the layers
start           heat, home and grow what the board holds; go on after a hold
hold            finish the layer under way and wait
grow POSE       plan here, hand over, grow, and wait until it is done
layers [FROM]   up to 16 of the layers that the board holds
wait [SECONDS]  show what happens for so long (1)
stop            heater and steppers off
clear           leave a fault or an emergency stop, if its cause is gone
help            this list
quit            leave; what the robot does, it goes on doing
";

/// Runs the command.
pub fn run(args: &ConsoleArgs) -> Result<(), Failure> {
    let robot = args.robot.load()?;
    let mut client = Client::new(port::open(&args.port.name()?, &robot)?, args.port.text());
    print(&Report::of(&mut client)?.text())?;
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).map_err(Failure::bad_input)?;
    let mut console = Console { client, robot, start, stop: stop_on_interrupt() };
    if io::stdin().is_terminal() { console.interact() } else { console.read_pipe() }
}

/// A session on a terminal or a pipe.
struct Console {
    client: Client,
    robot: Robot,
    start: Pose,
    /// Set by Ctrl-C.
    stop: Arc<AtomicBool>,
}

/// What to do after a command.
enum Next {
    GoOn,
    Quit,
}

impl Console {
    fn interact(&mut self) -> Result<(), Failure> {
        let mut editor = DefaultEditor::new().map_err(Failure::bad_input)?;
        loop {
            match editor.readline("growbot> ") {
                Ok(line) => {
                    // A history that cannot be kept is no reason to stop.
                    let _ = editor.add_history_entry(&line);
                    match self.command(&line) {
                        Ok(Next::GoOn) => {}
                        Ok(Next::Quit) => return Ok(()),
                        Err(failure) => failure.say(),
                    }
                }
                Err(ReadlineError::Eof | ReadlineError::Interrupted) => return Ok(()),
                Err(error) => return Err(Failure::bad_input(error)),
            }
        }
    }

    fn read_pipe(&mut self) -> Result<(), Failure> {
        let mut refused = 0;
        for line in io::stdin().lock().split(b'\n') {
            // Bytes that are no text make a command that there is not, and the next line is read all the same.
            let line = line.map_err(Failure::bad_input)?;
            match self.command(&String::from_utf8_lossy(&line)) {
                Ok(Next::GoOn) => {}
                Ok(Next::Quit) => break,
                Err(failure) if failure.is_reader_gone() => return Err(failure),
                Err(failure) => {
                    refused += 1;
                    failure.say();
                }
            }
        }
        if refused > 0 {
            return Err(Failure::answered_no(format!("{refused} commands failed: see above")));
        }
        Ok(())
    }

    fn command(&mut self, line: &str) -> Result<Next, Failure> {
        let line = line.trim();
        let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim();
        match word {
            "" => {}
            "help" => print(HELP)?,
            "quit" | "exit" => return Ok(Next::Quit),
            "status" => {
                print(&Report::of(&mut self.client)?.text())?;
            }
            "plan" => self.plan(&pose(rest)?)?,
            "start" => self.start_held()?,
            "grow" => self.grow(&pose(rest)?)?,
            "layers" => self.layers(rest)?,
            "wait" => self.wait(rest)?,
            "hold" => {
                self.client.request("to hold", &Message::Hold(Empty {}))?;
                print("holds after the layer under way; `start` goes on\n")?;
            }
            "stop" => {
                self.client.request("to stop", &Message::Stop(Empty {}))?;
                print("stopped: heater and steppers are off\n")?;
            }
            "clear" => {
                self.client.request("to clear the fault", &Message::ClearFault(Empty {}))?;
                print("cleared\n")?;
            }
            _ => return Err(Failure::answered_no(format!("there is no command {word:?}: `help` lists them"))),
        }
        Ok(Next::GoOn)
    }

    fn plan(&mut self, goal: &Pose) -> Result<(), Failure> {
        let request = PlanRequest {
            start: (&self.start).into(),
            goal: goal.into(),
            radius: self.robot.description().planning_radius_mm,
            planner: Planner::Shortest,
        };
        match self.client.request("to plan", &Message::Plan(request))? {
            Message::Planned(planned) => Ok(print(&format!(
                "plan {:016x}: {} layers, {:.3} mm\n",
                planned.plan_id, planned.layers, planned.length
            ))?),
            other => Err(Failure::answered_no(format!("the board answered with kind {:#04x}", other.kind()))),
        }
    }

    fn start_held(&mut self) -> Result<(), Failure> {
        let plan_id = self.client.status()?.plan_id;
        match self.client.request("to start", &Message::Start(Start { plan_id, silence: Silence::Hold }))? {
            Message::Accepted(Accepted { next, .. }) => Ok(print(&format!("started with {next} layers\n"))?),
            other => Err(Failure::answered_no(format!("the board answered with kind {:#04x}", other.kind()))),
        }
    }

    fn grow(&mut self, goal: &Pose) -> Result<(), Failure> {
        let radius = self.robot.description().planning_radius_mm;
        let search = Search { radius, planner: Planner::Shortest, clear_of_self: true };
        let plan = Plan::through(&self.robot, &self.start, &[], goal, &search)?;
        let job = Job::new(&self.robot, &plan.start, &plan.goal, &plan.path);
        let grown = grow_job(&mut self.client, &job, Silence::Hold, &self.stop, &mut |news| {
            if let News::State(state) = news {
                // A reader that is gone is noticed when the table is printed.
                let _ = print(&format!("{}\n", state.name()));
            }
        })
        .map_err(Failure::answered_no)?;
        self.stop.store(false, Ordering::Relaxed);
        Ok(print(&growth_table::table(&plan, &self.robot, &grown))?)
    }

    fn layers(&mut self, from: &str) -> Result<(), Failure> {
        let first = if from.is_empty() { self.client.status()?.laid } else { whole(from)? };
        match self.client.request("for layers", &Message::ReadLayers(ReadLayers { first }))? {
            Message::HeldLayers(HeldLayers { first, layers }) => {
                let mut text = String::from("layer,alpha_deg,height_mm,tilt_deg\n");
                for (index, layer) in (first..).zip(layers.iter().map(decode)) {
                    let tilt = growbot_core::angle::degrees(layer.tilt);
                    text += &format!("{index},{},{},{tilt}\n", degrees_below_turn(layer.alpha), layer.height);
                }
                Ok(print(&text)?)
            }
            other => Err(Failure::answered_no(format!("the board answered with kind {:#04x}", other.kind()))),
        }
    }

    fn wait(&mut self, seconds: &str) -> Result<(), Failure> {
        let seconds = if seconds.is_empty() { 1.0 } else { number(seconds)? };
        let clock = |client: &mut Client| client.status().map(|status| status.uptime_ms);
        // By the board's clock: on `sim` time passes only while we wait.
        let until = clock(&mut self.client)? + (seconds * 1000.0) as u64;
        loop {
            let now = clock(&mut self.client)?;
            if now >= until || self.stop.swap(false, Ordering::Relaxed) {
                return Ok(());
            }
            let left = Duration::from_millis((until - now).min(1000));
            match self.client.event(left)? {
                Some(Message::StateChanged(change)) => {
                    let fault = change.fault.map_or(String::new(), |fault| format!(", {}", fault.code()));
                    print(&format!("{}{fault}\n", change.state.name()))?;
                }
                Some(Message::Laid(laid)) => {
                    let height = laid.as_built.map_or(f64::NAN, |bytes| decode(&bytes).height);
                    print(&format!("layer {}: {height:.4} mm\n", laid.index))?;
                }
                _ => {}
            }
        }
    }
}

fn pose(text: &str) -> Result<Pose, Failure> {
    parse_pose(text).map_err(Failure::answered_no)
}

fn number(text: &str) -> Result<f64, Failure> {
    parse_number(text)
        .filter(|number| (0.0..=1e6).contains(number))
        .ok_or_else(|| Failure::answered_no(format!("{text:?} is no time: give seconds, 0 to 1000000")))
}

fn whole(text: &str) -> Result<u32, Failure> {
    text.parse().map_err(|_| Failure::answered_no(format!("{text:?} is no layer: give a whole number from 0 on")))
}
