//! A robot whose port belongs to this program.

use std::io::{self, IsTerminal, Write};
use std::path::PathBuf;

use growbot_client::client::{Client, ClientError};
use growbot_client::growth::{Beginning, GrowthBoard, GrowthError, GrowthRequest, LogTarget};
use growbot_client::robot_command::{CommandOutcome, RobotCommand, StopOutcome};
use growbot_client::status::RobotStatus;
use growbot_client::stop_signal::Permit;
use growbot_core::link::message::{BoardInfo, Empty, PassiveRequest, State};
use growbot_pictures::duration::duration_text;
use growbot_pictures::growth_table::made;
use growbot_plan::robot_kind::RobotKind;
use growbot_plan::run_log::{InterruptedLayerJson, RecordedRun};
use growbot_sim::port::{PortName, TipSettings};
use growbot_sim::simulated_tip::ground_truth;

use super::board_report::BoardReport;
use super::body_input::BodyInput;
use super::failure::Failure;
use super::growth_monitor::{GrowthMonitor, ResultFormat};
use super::port_arg::{Connection, SelectedPort};
use super::remedies;
use super::robot_arg::RobotArg;
use super::robot_handle::{NewGrowth, ResumedGrowth, RobotHandle};
use super::stop_on_interrupt::stop_on_interrupt;
use super::terminal_commands::TerminalCommands;
use super::typed_answer::read_answer;

/// A robot whose port belongs to this program.
pub struct LocalRobot<'a> {
    /// Port of the robot.
    pub port: &'a SelectedPort,
    /// Robot that a simulated port simulates.
    pub robot: &'a RobotArg,
}

impl LocalRobot<'_> {
    /// Returns the failure for a command that only a service supports. `what` is what the command does.
    fn no_service(&self, what: &str) -> Failure {
        Failure::bad_input(format!(
            "no service owns the {}robot at {}: {what} the growth in the terminal or on the page that started it, or \
             start the growth while `growbot serve` runs",
            self.port.kind().prefix(),
            self.port.text()
        ))
    }

    /// Switches heater and steppers off. Opens no session with the board, because a board of another firmware release
    /// or of another robot must also stop.
    fn stop(&self) -> Result<CommandOutcome, Failure> {
        self.port.require_running_robot("the stop")?;
        let mut client = self.port.client(&self.robot.load_for_stop()?)?;
        match client.request("the request to stop", &PassiveRequest::Stop(Empty {})) {
            Ok(_) => Ok(CommandOutcome::Stopped(StopOutcome::ByRequest)),
            Err(error @ ClientError::Refused { .. }) => Err(error.into()),
            Err(error) => Err(Failure::bad_input(format!(
                "{}; the robot may still be hot or moving: send the emergency stop (`growbot estop --port {}`), or cut \
                 its power",
                remedies::message(&error),
                self.port.text()
            ))),
        }
    }

    /// Runs a growth on the connected board, shows it, and prints its result. `laid` is the number of layers that were
    /// laid before.
    fn run(&self, growth: NewGrowth, connection: Connection, laid: usize) -> Result<(), Failure> {
        let NewGrowth { request, opened, name, log, silence, watching, print, .. } = growth;
        let Connection { mut client, mut simulation } = connection;
        let orders = stop_on_interrupt(&mut client, self.port);
        let job = request.job();
        let (known, truth) = match request.beginning {
            Beginning::FirstLayer => (Vec::new(), ground_truth(&mut simulation)),
            Beginning::Resume { record, .. } => (record.map(RecordedRun::known_layers).unwrap_or_default(), None),
        };
        let (kind, pace) = (self.port.kind(), self.port.pace(watching.pace(self.port.name())?));
        let status = RobotStatus {
            port: self.port.text().to_owned(),
            simulated: kind.is_simulated(),
            pace,
            ..RobotStatus::default()
        };
        let name = format!("{name}{}", kind.suffix());
        let watch = watching.begin(&opened.subject(&name), &job, &known, status, &orders)?;
        let following = GrowthMonitor {
            request,
            log: request.open_log(&log, &job, self.port.text())?,
            watch,
            print,
            laid,
            pace,
            keyboard: TerminalCommands::of_terminal(&orders),
            page_controls: watching.can_control(),
        };
        let parked = following.when_parked();
        following.follow(&job, GrowthBoard { client: &mut client, truth, commands: &orders, silence, parked })
    }
}

impl RobotHandle for LocalRobot<'_> {
    fn kind(&self) -> RobotKind {
        self.port.kind()
    }

    fn status(&self) -> Result<BoardReport, Failure> {
        Ok(BoardReport::read(&mut self.port.client(&self.robot.load()?)?, self.port)?)
    }

    fn command(&self, command: RobotCommand) -> Result<String, Failure> {
        let outcome = match command {
            RobotCommand::Stop => self.stop()?,
            // It has a path of its own, which needs no robot description and waits for no other program.
            RobotCommand::EmergencyStop => return Err(Failure::bad_input("send the emergency stop: `growbot estop`")),
            RobotCommand::Cancel => {
                self.port.require_running_robot("the cancellation")?;
                let mut client = self.port.client(&self.robot.load()?)?;
                client.open_session()?;
                client.cancel()?
            }
            RobotCommand::ClearFault => {
                self.port.require_running_robot("the request to clear")?;
                let mut client = self.port.client(&self.robot.load()?)?;
                client.open_session()?;
                client.clear(&Permit::standalone())?
            }
            RobotCommand::WithdrawStop => return Err(self.no_service("withdraw the stop of")),
            RobotCommand::Pause => return Err(self.no_service("pause")),
            RobotCommand::Continue => return Err(self.no_service("continue")),
        };
        Ok(outcome.message(self.kind()))
    }

    fn maintain(&self, task: &str, value: &str) -> Result<String, Failure> {
        let (robot, presets) = (self.robot.load()?, self.robot.presets()?);
        let task = presets.task(task, value, &robot)?;
        let mut client = self.port.client(&robot)?;
        client.open_session_for(&robot)?;
        Ok(client.maintain(task, &Permit::standalone())?.message(self.kind()))
    }

    fn attach(&self, _: ResultFormat) -> Result<(), Failure> {
        Err(self.no_service("follow"))
    }

    fn grow(&self, growth: NewGrowth) -> Result<(), Failure> {
        let GrowthRequest { robot, plan, imperfection, .. } = growth.request;
        let pace = growth.watching.pace(self.port.name())?;
        if matches!(self.port.name(), PortName::Emulator(_)) {
            let time = duration_text(plan.requirements.duration);
            growbot_host::note!("the emulated board runs in real time: the layers alone take {time}");
        }
        let settings = TipSettings { imperfection, pace };
        let connection = self.port.connect(robot, &settings)?;
        self.run(growth, connection, 0)
    }

    fn resume(&self, growth: ResumedGrowth) -> Result<(), Failure> {
        let ResumedGrowth { opened, scene, interrupted, silence, is_confirmed, watching, print } = growth;
        let Some((file, mut opened)) = opened else {
            let forgets = "; a robot at `sim` ends with its command, so grow at a port sim:NAME if you want to resume";
            let forgets = if self.port.is_in_process() { forgets } else { "" };
            return Err(Failure::bad_input(format!(
                "no service owns this robot, so its latest job is unknown: give the run log of the growth, or its \
                 plan{forgets}"
            )));
        };
        let mut record = opened.run.take().map(|(record, _)| record);
        let with_feedback = record.as_ref().filter(|record| record.feedback.is_some());
        if let (Some(record), None) = (with_feedback, &opened.scene) {
            // Corrections are proven to be clear of the plan's scene, so nothing is resumed without it.
            let named = opened.plan.scene.as_ref().map(|scene| scene.file.clone()).unwrap_or_default();
            let scene = record.scene(&opened.plan, &opened.robot, scene.map(PathBuf::as_path))?;
            opened.scene = scene.map(|loaded| (named, loaded));
        }
        let BodyInput { robot, plan, .. } = &opened;
        let pace = watching.pace(self.port.name())?;
        let mut connection = self.port.connect(robot, &TipSettings { pace, ..TipSettings::default() })?;
        let board = connection.client.identify()?;
        Client::check_robot(&board, robot)?;
        if let Some(record) = &mut record {
            record.sync_to_board(board.status.plan_id);
        }
        let request = GrowthRequest {
            beginning: Beginning::Resume { record: record.as_ref(), interrupted },
            scene: opened.scene(),
            kind: self.port.kind(),
            ..GrowthRequest::new(robot, plan)
        };
        show(&board, request.job().plan_id, self.port)?;
        if !is_confirmed {
            ask(&board)?;
        }
        if record.as_ref().is_some_and(|record| record.feedback.is_some()) {
            growbot_host::note!("with feedback, as it was started");
        }
        let growth = NewGrowth {
            request,
            opened: &opened,
            name: file.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            scene_path: None,
            log: if record.is_some() { LogTarget::File(file.clone()) } else { LogTarget::Disabled },
            silence,
            watching,
            print,
        };
        self.run(growth, connection, board.status.layers_laid as usize)
    }
}

/// Prints the state of the body on the board. Returns an error if the board cannot resume this plan.
fn show(board: &BoardInfo, plan_id: u64, port: &SelectedPort) -> Result<(), Failure> {
    let status = &board.status;
    if status.plan_id != plan_id || status.plan_id == 0 {
        let nothing = GrowthError::nothing_to_resume(plan_id, status);
        let remark = if port.is_in_process() { "; this robot is simulated and restarts with each command" } else { "" };
        return Err(Failure::request_failed(format_args!("{nothing}{remark}")));
    }
    growbot_host::note!(
        "plan {plan_id:016x}: {} of {} layers laid; the {}board is {}, started by {}",
        status.layers_laid,
        status.layer_count,
        port.kind().prefix(),
        status.state.name(),
        board.reset_cause.name()
    );
    match status.interrupted {
        Some(layer) => {
            let layer = InterruptedLayerJson::new(status.layers_laid as usize, layer);
            growbot_host::note!("layer {} was interrupted: {}", layer.layer, made(&layer));
        }
        None => growbot_host::note!("no layer was interrupted"),
    }
    if let Some(fault) = status.fault {
        return Err(Failure::request_failed(format!(
            "the board has the fault {}: {}; fix the cause and clear the fault first (`growbot clear`)",
            fault.code(),
            remedies::fault_explanation(fault)
        )));
    }
    Ok(())
}

/// Waits for a confirmation at the terminal, because the next steps heat and move. Returns an error without a terminal.
fn ask(board: &BoardInfo) -> Result<(), Failure> {
    if matches!(board.status.state, State::Heating | State::Homing | State::Growing | State::Paused) {
        // The robot works already, so the command only follows it.
        return Ok(());
    }
    if !io::stdin().is_terminal() {
        return Err(Failure::bad_input(
            "cannot ask for confirmation, because standard input is not a terminal: pass --yes to heat and resume",
        ));
    }
    eprint!("Heat the nozzle, find the index mark of the head and resume the growth? [y/N] ");
    let _ = io::stderr().flush();
    let answer = read_answer().map_err(Failure::bad_input)?;
    match answer.unwrap_or_default().trim() {
        "y" | "Y" | "yes" => Ok(()),
        _ => Err(Failure::request_failed("not resumed: nothing was heated or moved")),
    }
}
