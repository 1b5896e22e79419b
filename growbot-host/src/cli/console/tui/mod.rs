//! The console on the whole screen.
//!
//! `poller` follows the board and fills the `model`. `draw` turns the model into text. `keys` and `prompt` define the
//! meaning of keys. This file contains the loop that calls them, and the terminal.
//!
//! `draw` depends neither on a terminal nor on a board, so tests check its output in a buffer. On `sim` time passes
//! only in `poller`, by the factor that the user chose. `grow` plans on the host, to show the body and its warnings,
//! and the board computes the same plan to the same bits. So the board has all layers, and pauses after a layer if
//! the console ends.

mod draw;
mod keys;
mod model;
mod poller;
mod prompt;
mod temperature_history;
#[cfg(test)]
mod testing;

use std::io::{self, IsTerminal};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use crossterm::event::{self, Event, KeyEvent, KeyEventKind};
use growbot_client::client::Client;
use growbot_client::growth::GrowthRequest;
use growbot_client::maintenance::MaterialPresets;
use growbot_client::stop_signal::Permit;
use growbot_core::job::job_layers;
use growbot_core::layer_bytes::decode;
use growbot_core::plan::Planner;
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_host::interrupt::on_interrupt;
use growbot_plan::plan::{Goal, Plan, PlanOptions};
use growbot_plan::tracked_body::TrackedBody;
use keys::Action;
use model::ConsoleModel;
use poller::{BoardPoller, SpeedChange};
use prompt::{Prompt, PromptAction};
use ratatui::DefaultTerminal;

use super::board_requests::{refusal_text, send};
use super::commands::{BoardRequest, ConsoleCommand, parse, screen_help};
use super::script::{is_active, still_active_text};
use crate::cli::failure::Failure;
use crate::cli::port_arg::SelectedPort;
use crate::cli::remedies;

/// Maximum time to wait for a key before the screen is drawn again.
const TICK: Duration = Duration::from_millis(80);
/// Maximum real time of a tick, so that time spent elsewhere, for example on planning, does not pass on `sim` at once.
const LONGEST_TICK: Duration = Duration::from_millis(250);

/// Maximum time between a signal to end the program and its end.
const PATIENCE: Duration = Duration::from_secs(1);

/// Checks that standard input and standard output are terminals.
pub fn check_terminal() -> Result<(), Failure> {
    for (is_terminal, what) in
        [(io::stdin().is_terminal(), "standard input"), (io::stdout().is_terminal(), "standard output")]
    {
        if !is_terminal {
            return Err(Failure::bad_input(format!(
                "--tui needs a terminal, but {what} is not a terminal: remove --tui and give commands line by line"
            )));
        }
    }
    Ok(())
}

/// Shows the robot until the user leaves.
pub fn run(client: Client, robot: Robot, presets: MaterialPresets, port: &SelectedPort) -> Result<(), Failure> {
    let mut watch = BoardPoller::new(client, port);
    // A board that does not respond is reported before the screen is taken.
    let hello = watch.client().open_session()?;
    let place = format!("{}{}", port.text(), port.kind().suffix());
    let mut model = ConsoleModel::new(robot, &place, watch.speed());
    if hello.robot_hash != model.robot.hash() {
        model.log_error(&format!(
            "the board's robot is {}, but the limits shown are for {}: choose the board's robot with --robot",
            hello.robot_name,
            model.robot.name()
        ));
    }
    model.apply_status(hello.status);
    let leave = install_exit_handler()?;
    let mut console = TuiApp { watch, model, port: port.clone(), presets, history: Vec::new(), quit: false };
    let mut screen = Screen::open()?;
    let done = console.run(&mut screen, &leave);
    drop(screen);
    done?;
    if !port.name().is_virtual()
        && let Some(status) = &console.model.status
        && is_active(status.state)
    {
        growbot_host::warning!("{}", still_active_text(status.state, &console.model.robot, port));
    }
    Ok(())
}

/// Returns a flag that is set by a signal to end the program, or when the terminal closes. The console then ends, and
/// the robot finishes its layer and pauses, as after `q`. If the program still runs after [`PATIENCE`], the signal
/// handler ends it.
fn install_exit_handler() -> Result<Arc<AtomicBool>, Failure> {
    let leave = Arc::new(AtomicBool::new(false));
    let signal = Arc::clone(&leave);
    on_interrupt(move || {
        signal.store(true, Ordering::Relaxed);
        // A read of keys from a terminal that has gone away may never return.
        thread::sleep(PATIENCE);
        ratatui::restore();
        std::process::exit(0);
    })
    .map_err(Failure::bad_input)?;
    Ok(leave)
}

/// The terminal. It is restored on drop.
struct Screen(DefaultTerminal);

impl Screen {
    fn open() -> Result<Self, Failure> {
        // After a panic, ratatui restores the terminal.
        ratatui::try_init().map(Self).map_err(|error| {
            ratatui::restore();
            Failure::bad_input(format!("cannot control the terminal's screen ({error}): remove --tui"))
        })
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        // A panic has already restored the terminal. A second time would put the cursor before the panic's message.
        if !thread::panicking() {
            ratatui::restore();
        }
    }
}

/// A session on the whole screen.
struct TuiApp {
    watch: BoardPoller,
    model: ConsoleModel,
    port: SelectedPort,
    presets: MaterialPresets,
    /// Lines that were typed, the latest last.
    history: Vec<String>,
    quit: bool,
}

impl TuiApp {
    fn run(&mut self, screen: &mut Screen, leave: &AtomicBool) -> Result<(), Failure> {
        let gone = |error: io::Error| {
            Failure::bad_input(format!(
                "the terminal was closed ({error}), and no stop was sent to the robot: run `growbot status`, or \
                 stop the robot with `growbot stop`"
            ))
        };
        let mut last = Instant::now();
        while !self.quit && !leave.load(Ordering::Relaxed) {
            screen.0.draw(|frame| draw::screen(frame, &self.model)).map_err(gone)?;
            let mut wait = TICK;
            while event::poll(wait).map_err(gone)? {
                if let Event::Key(key) = event::read().map_err(gone)?
                    && key.kind != KeyEventKind::Release
                {
                    self.apply_key(key);
                }
                wait = Duration::ZERO;
            }
            let passed = last.elapsed().min(LONGEST_TICK);
            last = Instant::now();
            self.watch.follow(&mut self.model, passed);
        }
        Ok(())
    }

    fn apply_key(&mut self, key: KeyEvent) {
        self.model.popup = None;
        let always = keys::always(key);
        let action = match &mut self.model.prompt {
            Some(prompt) if always.is_none() => {
                match prompt.apply(key, &self.history) {
                    PromptAction::Continue => {}
                    PromptAction::Cancelled => self.model.prompt = None,
                    PromptAction::Done(line) => {
                        self.model.prompt = None;
                        self.carry_out(&line);
                    }
                }
                None
            }
            Some(_) => always,
            None => keys::action(key),
        };
        match action {
            None => {}
            Some(Action::Ask(what)) => self.send_and_show(&what),
            Some(Action::Prompt(begun)) => self.model.prompt = Some(Prompt::new(begun)),
            Some(Action::Faster) => self.change_speed(SpeedChange::Faster),
            Some(Action::Slower) => self.change_speed(SpeedChange::Slower),
            Some(Action::Quit) => self.quit = true,
        }
    }

    fn change_speed(&mut self, change: SpeedChange) {
        if !self.watch.change_speed(change) {
            self.model.log(match self.watch.speed() {
                Some(_) => "the speed is at its limit",
                None => "the speed can be changed only on the port sim",
            });
        }
        self.model.speed = self.watch.speed();
    }

    fn carry_out(&mut self, line: &str) {
        if !line.trim().is_empty() && self.history.last().is_none_or(|last| last != line) {
            self.history.push(line.to_owned());
        }
        match parse(line) {
            Err(why) => self.model.log_error(&why),
            Ok(ConsoleCommand::Nothing) => {}
            Ok(ConsoleCommand::Board(BoardRequest::Plan(goal))) => drop(self.plan(&goal.into())),
            Ok(ConsoleCommand::Board(what)) => self.send_and_show(&what),
            Ok(ConsoleCommand::Grow(goal)) => {
                if self.plan(&goal) {
                    self.send_and_show(&BoardRequest::Start);
                }
            }
            Ok(ConsoleCommand::Wait(_)) => {
                self.model
                    .log("`wait` has no effect here, where time passes by itself: + and - change its speed on sim");
            }
            Ok(ConsoleCommand::Help) => self.model.popup = Some(screen_help()),
            Ok(ConsoleCommand::Quit) => self.quit = true,
        }
    }

    fn send(&mut self, what: &BoardRequest) -> Result<String, Failure> {
        let (client, permit) = (self.watch.client(), Permit::standalone());
        send(client, &self.model.robot, &self.port, &self.presets, what, &permit)
    }

    fn send_and_show(&mut self, what: &BoardRequest) {
        let answer = self.send(what);
        self.show_response(answer);
    }

    /// Plans on the host to check the body, and requests the same plan from the board. Returns true if the board has
    /// the plan.
    fn plan(&mut self, goal: &Goal) -> bool {
        let robot = &self.model.robot;
        let search = PlanOptions {
            radius: robot.description().planning_radius_mm,
            planner: Planner::Shortest,
            avoid_self_collision: false,
            existing: None,
        };
        let planned = Plan::through_waypoints(robot, &Pose::UPRIGHT, &[], goal, &search);
        // The board plans only to poses, so the direction is chosen here.
        let planned = planned.and_then(|plan| match goal {
            Goal::Pose(_) => Ok(plan),
            Goal::Position(_) => Plan::through_waypoints(robot, &Pose::UPRIGHT, &[], &plan.goal, &search),
        });
        let plan = match planned {
            Ok(plan) => plan,
            Err(error) => {
                self.model.log_error(&error.to_string());
                return false;
            }
        };
        let layers = job_layers(&plan.path, robot);
        let body = TrackedBody::new(layers.summary().plan_id, layers.map(|layer| decode(&layer)).collect());
        let request = GrowthRequest { kind: self.port.kind(), ..GrowthRequest::new(robot, &plan) };
        let refused = request.check().err().map(|refusal| refusal_text(&refusal));
        for warning in &plan.warnings {
            self.model.log_error(&format!("{}: {}", warning.code, remedies::warning_message(warning)));
        }
        if let Some(text) = refused {
            self.model.log_error(&text);
            return false;
        }
        let request = BoardRequest::Plan(plan.goal);
        let answer = self.send(&request);
        let planned = answer.is_ok();
        if planned {
            self.model.body = body;
        }
        self.show_response(answer);
        planned
    }

    fn show_response(&mut self, answer: Result<String, Failure>) {
        match answer {
            Ok(text) if text.lines().count() > 1 => self.model.popup = Some(text),
            Ok(text) => self.model.log(&text),
            Err(failure) => self.model.log_error(failure.message()),
        }
    }
}

#[cfg(test)]
mod tests {
    use crossterm::event::{KeyCode, KeyModifiers};
    use growbot_core::link::message::State;
    use growbot_plan::robot_file;
    use growbot_sim::port::sim::Sim;

    use super::*;
    use crate::cli::port_arg::LinkArgs;

    /// Returns a console on a simulated robot, without a terminal.
    fn console() -> TuiApp {
        let robot = robot_file::load("growbot-a".as_ref()).unwrap();
        let port = LinkArgs::default().at("sim".to_owned()).ok().unwrap();
        let mut watch = BoardPoller::new(Client::new(Box::new(Sim::new(robot.clone())), "sim"), &port);
        watch.client().open_session().unwrap();
        let model = ConsoleModel::new(robot, "sim", watch.speed());
        TuiApp { watch, model, port, presets: MaterialPresets::default(), history: Vec::new(), quit: false }
    }

    impl TuiApp {
        fn press(&mut self, letters: &str) {
            for letter in letters.chars() {
                let code = if letter == '\n' { KeyCode::Enter } else { KeyCode::Char(letter) };
                self.apply_key(KeyEvent::from(code));
            }
        }

        fn follow_until(&mut self, state: State) {
            for _ in 0..100_000 {
                self.watch.follow(&mut self.model, TICK);
                if self.model.status.as_ref().is_some_and(|status| status.state == state) {
                    return;
                }
            }
            panic!("never {}: {:?}", state.name(), self.model.log);
        }

        fn says(&self, part: &str) -> bool {
            self.model.log.iter().any(|line| line.text.contains(part))
        }
    }

    #[test]
    fn a_body_is_planned_paused_and_grown_by_keys() {
        let mut console = console();
        console.press("p0,0,7.74,0,90\n");
        assert!(console.says("10 layers"), "{:?}", console.model.log);
        assert_eq!(console.model.body.planned_points().len(), 11);
        console.press("+++g");
        console.follow_until(State::Growing);
        console.press("h");
        console.follow_until(State::Paused);
        console.press("g");
        console.follow_until(State::Done);
        assert_eq!((console.model.body.built().len(), console.model.body.unreported()), (10, 0));
        assert!((console.model.body.tip().position().z - 7.74).abs() < 0.01);
        assert!(console.model.readings.range().is_some_and(|(_, max)| max > 150.0));
    }

    #[test]
    fn the_emergency_stop_works_while_a_command_is_typed() {
        let mut console = console();
        console.press(":grow 0,0,7.74,0,90\n");
        console.follow_until(State::Heating);
        console.press(":pla");
        console.apply_key(KeyEvent::new(KeyCode::Char('e'), KeyModifiers::CONTROL));
        console.follow_until(State::EmergencyStop);
        assert!(console.says("emergency stop"));
        assert_eq!(console.model.prompt.as_ref().map(Prompt::text).as_deref(), Some("pla"));
    }

    #[test]
    fn errors_are_displayed_and_long_output_opens_an_overlay() {
        let mut console = console();
        console.press(":stop now\n");
        assert!(console.says("`stop` takes no arguments"));
        console.press("g");
        assert!(console.says("stores no plan"));
        console.press(":plan 20,0,0,0,90\n");
        assert!(console.says("not grown because of self-collision"), "{:?}", console.model.log);
        console.press(":plan 0,0,4000,0,90\n");
        assert!(console.says("not grown because of filament-short"), "{:?}", console.model.log);
        console.press(":status\n");
        assert!(console.model.popup.as_ref().is_some_and(|sheet| sheet.contains("growbot-a")));
        console.press("-");
        assert!(console.model.popup.is_none());
        assert_eq!(console.model.speed, Some(30.0));
        console.press("q");
        assert!(console.quit);
    }
}
