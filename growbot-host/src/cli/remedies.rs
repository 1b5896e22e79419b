//! The table of remedies that name options and commands, for errors of the libraries, which know neither.

use std::borrow::Cow;
use std::error::Error;

use growbot_client::client::{ClientError, SEND_DESCRIPTION};
use growbot_client::commissioning_report::ReportError;
use growbot_client::growth::GrowthError;
use growbot_client::maintenance::MaintenanceError;
use growbot_client::port::PortError;
use growbot_client::robot_command::StopOutcome;
use growbot_core::link::message::{Fault, Refusal};
use growbot_pictures::drawing::png::PngError;
use growbot_pictures::export::mesh::MeshError;
use growbot_pictures::view::ViewError;
use growbot_plan::batch::PathTooLong;
use growbot_plan::input::InputError;
use growbot_plan::plan_file::{PlanCheckError, PlanFileError};
use growbot_plan::remedy::with_remedies;
use growbot_plan::robot_kind::RobotKind;
use growbot_plan::run_log::{ReadRunLogError, RunLogError};
use growbot_plan::scene_planning::{NoPathError, SceneCheckError};
use growbot_plan::warning::{SELF_COLLISION, Warning};
use growbot_remote::client::ServiceError;
use growbot_serve::LockError;
use growbot_serve::server::ServerError;
use growbot_serve::watch::WatchError;
use growbot_sim::sim_daemon::SimDaemonError;
use growbot_sim::sim_daemon::process::SimProcessError;

/// Returns the text of an error with its remedies for users of the command line.
pub fn message(error: &(dyn Error + 'static)) -> String {
    with_remedies(error, |error, text| {
        let text = name_options(error, text);
        let remedy = remedy(error);
        text + &remedy
    })
}

/// Returns the explanation of a fault with its remedies.
pub fn fault_explanation(fault: Fault) -> String {
    fault.explanation().to_owned() + of_fault(fault)
}

/// Returns the message of a warning with its remedies.
pub fn warning_message(Warning { code, message, .. }: &Warning) -> String {
    let remedy = if code == SELF_COLLISION { " (--avoid-self-collision, another goal or another radius)" } else { "" };
    message.clone() + remedy
}

/// Returns the message about a board that was stopped, with the command that clears an emergency stop.
pub fn stop_message(stopped: StopOutcome, robot: RobotKind) -> String {
    let remedy = match stopped {
        StopOutcome::ByRequest => "",
        StopOutcome::ByEmergencyStop => " (`growbot clear`)",
    };
    stopped.message(robot) + remedy
}

/// Replaces the names of parameters in the text of an error by the options that set them.
fn name_options(error: &(dyn Error + 'static), text: String) -> String {
    let (parameter, option) = match error.downcast_ref() {
        Some(NoPathError::AtResolution { .. }) => ("smaller radius", "smaller --radius"),
        Some(NoPathError::TooFar { .. } | NoPathError::TwoPlaneBlocked) => ("the maximum length", "--max-length"),
        _ if matches!(error.downcast_ref(), Some(ServiceError::Unreachable(_) | ServiceError::ForeignPeer { .. })) => {
            ("the service", "`growbot serve`")
        }
        _ if error.is::<LockError>() => ("a service", "`growbot serve`"),
        _ if error.is::<PathTooLong>() => ("the maximum length", "--max-length"),
        _ if error.is::<ReportError>() => ("report of the commissioning", "report of growbot doctor"),
        _ if error.is::<SimDaemonError>() => ("the robot description", "--robot"),
        _ => return text,
    };
    text.replacen(parameter, option, 1)
}

/// Returns the text that follows the text of an error. It is empty if no option and no command is a remedy.
fn remedy(error: &(dyn Error + 'static)) -> Cow<'static, str> {
    macro_rules! first_of {
        ($($remedy:path),* $(,)?) => {
            $(if let Some(error) = error.downcast_ref() { return Cow::from($remedy(error)); })*
        };
    }
    first_of!(
        of_board,
        of_file_check,
        of_growth,
        of_input,
        of_live_page,
        of_log,
        of_maintenance,
        of_mesh,
        of_no_path,
        of_picture,
        of_plan_file,
        of_port,
        of_read_log,
        of_report,
        of_scene_check,
        of_server,
        of_simulated_robot,
        of_simulator_start,
        of_too_long,
        of_view,
    );
    Cow::from("")
}

fn of_fault(fault: Fault) -> &'static str {
    if fault == Fault::DriverFault { "; `growbot status` shows more for drivers with a UART" } else { "" }
}

fn of_board(error: &ClientError) -> &'static str {
    match error {
        ClientError::Schema { .. } => " (`growbot flash`); stop and estop work with any release",
        ClientError::OtherRobot { .. } => {
            " with --robot, or send the board this robot's description (`growbot configure`)"
        }
        ClientError::NotConfigured { .. } => " with `growbot configure`",
        ClientError::NotRestarted { .. } => ", and check with `growbot status` whether it has the description",
        ClientError::Owned { .. } => " (--take-over)",
        ClientError::Refused { refusal, request } => match *refusal {
            Refusal::RobotMismatch { .. } => " with --robot",
            Refusal::OutOfOrder { .. } if *request != SEND_DESCRIPTION => " (`growbot resume`)",
            Refusal::FaultRemains { fault } => of_fault(fault),
            Refusal::OwnedByOtherHost { .. } => " (--take-over)",
            Refusal::NotConfigured => " with `growbot configure`",
            Refusal::JobNotDone { .. } => " with `growbot cancel`",
            _ => "",
        },
        _ => "",
    }
}

fn of_file_check(error: &PlanCheckError) -> &'static str {
    match error {
        PlanCheckError::OtherRobot { .. } => " with --robot",
        PlanCheckError::OtherHash { .. } => " with --robot FILE",
        PlanCheckError::TooTight { .. } => " with a larger --radius",
        _ => "",
    }
}

fn of_growth(error: &GrowthError) -> &'static str {
    match error {
        GrowthError::Interrupted(_) => ": run `growbot status`, and if that fails cut the robot's power",
        GrowthError::Unfinished { .. } => " (`growbot resume`), or discard it (`growbot cancel`)",
        _ => "",
    }
}

fn of_input(error: &InputError) -> &'static str {
    match error {
        InputError::NotAFile { .. } => ", or send it to standard input (-), as in `growbot COMMAND - < FILE`",
        _ => "",
    }
}

fn of_live_page(error: &WatchError) -> &'static str {
    match error {
        WatchError::Listen(_) => " with --watch-port, or remove --watch",
        WatchError::Server(_) => ": remove --watch",
        WatchError::View(_) => "",
    }
}

fn of_log(error: &RunLogError) -> &'static str {
    match error {
        RunLogError::Begin { .. } => ", or for a new growth choose another file with --log",
        RunLogError::Exists { .. } => ", or replace it with --overwrite; --log without a name chooses a new one",
        _ => "",
    }
}

fn of_maintenance(error: &MaintenanceError) -> &'static str {
    match error {
        MaintenanceError::UnknownMaterial { .. } => ", and give that file with --robot",
        _ => "",
    }
}

fn of_mesh(error: &MeshError) -> &'static str {
    match error {
        MeshError::TooMany { .. } => ": lower --segments, or raise --every",
        _ => "",
    }
}

fn of_no_path(error: &NoPathError) -> &'static str {
    match error {
        NoPathError::Start { .. } | NoPathError::Goal { .. } | NoPathError::Separated { .. } => " (--margin)",
        NoPathError::TooFar { .. } => ": raise --max-length, or choose a nearer goal",
        NoPathError::NotFound => ": raise --effort or --time-limit",
        NoPathError::AtResolution { .. } | NoPathError::TwoPlaneBlocked => "",
    }
}

fn of_picture(error: &PngError) -> &'static str {
    match error {
        PngError::TooLarge { .. } => ": give a smaller --width",
        _ => "",
    }
}

fn of_plan_file(error: &PlanFileError) -> &'static str {
    match error {
        PlanFileError::NotJson { .. } | PlanFileError::NoPlan { .. } => ": give a file that `growbot plan -o` wrote",
        PlanFileError::LayerCsv { .. } => {
            ": give that plan, or the table with its plan, as `growbot layers --json` prints it"
        }
        PlanFileError::UnknownRobot { .. } => " with --robot",
        _ => "",
    }
}

fn of_port(error: &PortError) -> String {
    match error {
        PortError::Busy(port, _) => format!(
            " (in an emergency, `growbot estop --port {port}` stops the robot without waiting for that program)"
        ),
        _ => String::new(),
    }
}

fn of_read_log(error: &ReadRunLogError) -> &'static str {
    match error {
        ReadRunLogError::Header { .. } => ": give a file that `growbot grow --log` wrote",
        _ => "",
    }
}

fn of_report(_: &ReportError) -> &'static str {
    " with -o"
}

fn of_scene_check(error: &SceneCheckError) -> &'static str {
    match error {
        SceneCheckError::Scene(_) => ", or pass the scene file with --scene to `grow` or `simulate`",
        SceneCheckError::MarginViolated { .. } => {
            " (`growbot plan --scene`), or lower the margin (margin_mm of the scene, --margin)"
        }
        _ => "",
    }
}

fn of_server(error: &ServerError) -> &'static str {
    if matches!(error, ServerError::Address { .. }) { " with --page-port" } else { "" }
}

fn of_simulated_robot(error: &SimDaemonError) -> String {
    match error {
        SimDaemonError::NotRunning(name) => format!(" with `growbot power on --port sim:{name}`"),
        SimDaemonError::AlreadyRunning(name) => format!(" with `growbot power off --port sim:{name}`"),
        _ => String::new(),
    }
}

fn of_simulator_start(error: &SimProcessError) -> String {
    match error {
        SimProcessError::NotStarted(name) => {
            format!(": see the cause with `growbot power on --foreground --port sim:{name}`")
        }
        _ => String::new(),
    }
}

fn of_too_long(_: &PathTooLong) -> &'static str {
    ": raise --max-length, or choose a smaller radius or another goal"
}

fn of_view(error: &ViewError) -> &'static str {
    match error {
        ViewError::NotMeasured { .. } => ", as `growbot grow --log` writes it",
        ViewError::NoTemperatures { .. } => ": remove temperature from --plot",
        ViewError::TooManyLayers { .. } => "",
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use growbot_plan::batch::QueryError;
    use growbot_plan::plan_file;
    use growbot_plan::scene_planning::ScenePlanError;
    use growbot_remote::client::ResponseError;
    use growbot_sim::port::OpenError;

    use super::*;

    #[test]
    fn remedies_with_options_are_in_the_messages_of_the_command_line_only() {
        let busy = || ClientError::Port(PortError::Busy("/dev/ttyACM0".to_owned(), "cu".to_owned()));
        let refused = |refusal| ClientError::Refused { request: "the request to start", refusal };
        let errors: [(Box<dyn Error>, &str); 16] = [
            (
                Box::new(ScenePlanError::from(NoPathError::TooFar { distance: 700.0, left: 600.0 })),
                "only 600 mm of --max-length remain: raise --max-length, or choose a nearer goal",
            ),
            (
                Box::new(NoPathError::AtResolution { step: 20.0, rolls: 8, cell: 10.0 }),
                "cells of 10 mm): give a smaller --radius, or another goal",
            ),
            (Box::new(NoPathError::TwoPlaneBlocked), "clear of the scene and of the body itself within --max-length,"),
            (Box::new(NoPathError::Goal { distance: 1.0, need: 2.0 }), "or lower the margin (--margin)"),
            (
                Box::new(QueryError::from(PathTooLong { found: 700.0, max: 640.0 })),
                "700.0 mm long, but --max-length is 640 mm: raise --max-length, or choose a smaller radius or another",
            ),
            (
                Box::new(GrowthError::NotStarted(busy())),
                "is in use by cu: close that program first (in an emergency, `growbot estop --port /dev/ttyACM0` stops",
            ),
            (
                Box::new(GrowthError::Interrupted(refused(Refusal::OwnedByOtherHost { silent_ms: 9 }))),
                "or take over the board (--take-over); the robot may still be growing: run `growbot status`, and if",
            ),
            (
                Box::new(GrowthError::Unfinished { plan_id: 1, laid: 2, layers: 3 }),
                "2 of 3 layers laid: resume it (`growbot resume`), or discard it (`growbot cancel`)",
            ),
            (
                Box::new(refused(Refusal::FaultRemains { fault: Fault::DriverFault })),
                "and the motor's wires; `growbot status` shows more for drivers with a UART",
            ),
            (
                Box::new(OpenError::from(SimDaemonError::NotRunning("lab".to_owned()))),
                "sim:lab is off: switch it on with `growbot power on --port sim:lab`",
            ),
            (
                Box::new(plan_file::read("solid", "a.json", None).unwrap_err()),
                "a.json is not JSON (expected value at line 1 column 1): give a file that `growbot plan -o` wrote",
            ),
            (
                Box::new(WatchError::Server(std::io::Error::other("no"))),
                "cannot start the page's server (no): remove --watch",
            ),
            (
                Box::new(ServerError::from(LockError::Held { folder: "state".into(), holder: "process 7".to_owned() })),
                "this user already runs `growbot serve` with the data folder state (process 7): end that process first",
            ),
            (
                Box::new(ServerError::Address { port: 80, error: std::io::Error::other("no") }),
                "cannot serve pages at 127.0.0.1:80 (no): choose another port with --page-port",
            ),
            (
                Box::new(ServiceError::from(ResponseError::Late(Duration::from_secs(2)))),
                "service (no response within 2.0 s): check that `growbot serve` runs and has the release of this",
            ),
            (
                Box::new(ServiceError::ForeignPeer { socket: "serve.sock".to_owned(), owner: 7 }),
                "is not the growbot service of this user: remove the socket, and start `growbot serve` again",
            ),
        ];
        for (error, expected) in errors {
            let complete = message(&*error);
            assert!(complete.contains(expected), "{complete}");
            let text = error.to_string();
            assert!(!text.contains("--") && !text.contains("`growbot"), "{text}");
        }
        // An error without a remedy with options has the same text everywhere.
        let error = ClientError::NoResponse { port: "sim".to_owned() };
        assert_eq!(message(&error), error.to_string());
    }
}
