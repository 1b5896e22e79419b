//! Commands on a robot that a service owns: they send requests to the service.

use std::io::{self, IsTerminal};
use std::sync::Arc;
use std::time::Duration;

use clap::Args;
use growbot_client::status::RobotStatus;
use growbot_core::robot::Robot;
use growbot_host::clock_text::local_clock_text;
use growbot_host::output::print;
use growbot_host::progress::{Progress, ResultTiming};
use growbot_plan::plan::Plan;
use growbot_plan::plan_file::PlanFile;
use growbot_plan::run_log::{GrowthResult, OutcomeKind, RecordedRun, RunEvent};
use growbot_plan::sanitize::json_line;
use growbot_serve::PREFIX;
use growbot_serve::api::MaintenanceRequest;
use growbot_serve::client::{LeasedPort, RESPONSE_TIMEOUT, ServiceClient, ServiceError};
use growbot_serve::commands::{CommandRequest, RobotCommand};
use growbot_serve::grow_request::GrowRequest;
use growbot_serve::job::{Job, JobState};
use growbot_serve::page_urls::PageUrls;
use serde_json::value::to_raw_value;
use serde_json::{Value, json};
use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;

use super::failure::Failure;
use super::growth_monitor::ResultFormat;
use super::port_arg::{RequiredPortArg, SelectedPort};
use super::replay;
use super::service_lookup::{EMERGENCY, service_in_emergency};
use super::status_text::status_text;

impl From<ServiceError> for Failure {
    fn from(error: ServiceError) -> Self {
        match &error {
            ServiceError::Rejected { status: 422 | 404, .. } => Self::bad_input(error),
            _ => Self::request_failed(error),
        }
    }
}

/// A robot that a service owns.
pub struct ServiceRobot {
    caller: ServiceClient,
    /// Name of the robot in the service.
    name: String,
    robot: RobotStatus,
}

/// Returns the robot at this port, if a service of this user owns it.
pub fn find_service_robot(port: &SelectedPort) -> Result<Option<ServiceRobot>, Failure> {
    owner_within(port, RESPONSE_TIMEOUT)
}

/// Like [`find_service_robot`], but for an emergency, in which a service that hangs must not delay the stop. A robot
/// that is simulated inside the service can be stopped only by the service, so there the timeout is longer.
pub fn owner_in_emergency(port: &SelectedPort) -> Option<ServiceRobot> {
    let limit = if port.is_in_process() { RESPONSE_TIMEOUT } else { EMERGENCY };
    owner_of(service_in_emergency()?, port, limit).ok().flatten()
}

fn owner_within(port: &SelectedPort, limit: Duration) -> Result<Option<ServiceRobot>, Failure> {
    ServiceClient::find()?.map_or(Ok(None), |caller| owner_of(caller, port, limit))
}

fn owner_of(caller: ServiceClient, port: &SelectedPort, limit: Duration) -> Result<Option<ServiceRobot>, Failure> {
    let robot = caller.robot_at(port.text(), limit)?;
    Ok(robot.and_then(|robot| Some(ServiceRobot { caller, name: robot.name.clone()?, robot })))
}

/// Lease of a robot's link from the service to this program. It ends when this guard is dropped. The connection to
/// the service is dropped last.
pub struct PortLeaseGuard {
    _line: LeasedPort,
    _caller: ServiceClient,
}

/// Leases the link of a robot from the service that owns it, for a command that communicates with the board itself.
/// `None` if no service owns the robot.
pub fn lease_port(port: &SelectedPort, command: &str) -> Result<Option<PortLeaseGuard>, Failure> {
    let Some(ServiceRobot { caller, robot, name }) = find_service_robot(port)? else { return Ok(None) };
    let line = caller.lease_port(&name, command)?;
    growbot_host::note!(
        "the service released the port of {}robot {} to this command",
        super::port_arg::simulated_prefix(robot.simulated),
        name
    );
    Ok(Some(PortLeaseGuard { _line: line, _caller: caller }))
}

impl ServiceRobot {
    fn at(&self, what: &str) -> String {
        format!("/robots/{}/{what}", self.name)
    }

    /// Returns the word that precedes "robot" in messages if the robot is simulated.
    fn kind(&self) -> &'static str {
        super::port_arg::simulated_prefix(self.robot.simulated)
    }

    fn send_command(&self, order: RobotCommand) -> Result<RobotStatus, ServiceError> {
        self.caller.post(&self.at("commands"), &CommandRequest { command: order })
    }

    /// Prints the status of the robot.
    pub fn print_status(&self, as_json: bool) -> Result<(), Failure> {
        Ok(print(&if as_json { json_line(&self.robot) } else { status_text(&self.robot) })?)
    }

    /// Stops the robot.
    pub fn stop(&self) -> Result<(), Failure> {
        self.send_command(RobotCommand::Stop)?;
        Ok(print(&format!("stopped: heater and steppers of the {}robot are off\n", self.kind()))?)
    }

    /// Discards the unfinished body of the robot.
    pub fn cancel(&self) -> Result<(), Failure> {
        self.send_command(RobotCommand::Cancel)?;
        Ok(print(&format!("the {}board stores no body any more\n", self.kind()))?)
    }

    /// Sends the emergency stop. Returns false if the service does not confirm it in time. For a robot that is
    /// simulated inside the service, the timeout is longer, because only the service can stop that robot.
    pub fn emergency_stop(&self, is_in_process: bool) -> bool {
        let given = CommandRequest { command: RobotCommand::EmergencyStop };
        let limit = if is_in_process { RESPONSE_TIMEOUT } else { EMERGENCY };
        self.caller.post_within::<Value>(&self.at("commands"), &given, limit).is_ok()
    }

    /// Runs a maintenance task.
    pub fn maintain(&self, task: &str, value: &str) -> Result<(), Failure> {
        let maintenance = MaintenanceRequest { task: task.to_owned(), value: value.to_owned() };
        let _: RobotStatus = self.caller.post(&self.at("maintenance"), &maintenance)?;
        Ok(print(&format!("{}robot {}: {task} {value}\n", self.kind(), self.name))?)
    }

    /// Grows a plan, and follows it. `scene` is the path of the scene that the plan leads through.
    pub fn grow(
        &self,
        robot: &Robot,
        plan: &Plan,
        scene: Option<String>,
        name: String,
        options: &ServiceGrowthOptions,
    ) -> Result<(), Failure> {
        let written = PlanFile::with_robot(plan, robot);
        let wanted = GrowRequest {
            plan: Some(to_raw_value(&written).map_err(Failure::bad_input)?),
            scene,
            feedback: options.feedback,
            force: options.force,
            ignore_scene: options.ignore_scene,
            name: Some(name),
            ..GrowRequest::default()
        };
        let job: Job = self.caller.post(&self.at("jobs"), &wanted)?;
        growbot_host::note!("the service runs the growth as job {}; the job continues after this command ends", job.id);
        self.say_page(&job, options.page)?;
        self.follow(&job, options)
    }

    /// Resumes the latest unfinished job of this robot, or follows the one under way.
    pub fn resume(&self, plan_id: Option<u64>, options: &ServiceGrowthOptions) -> Result<(), Failure> {
        let jobs: Vec<Job> = self.caller.get("/jobs?limit=1000")?;
        let plan_id = plan_id.map(|id| format!("{id:016x}"));
        let is_wanted = |job: &Job| plan_id.as_ref().is_none_or(|id| job.plan_id == *id);
        let is_open = |job: &Job| job.state == JobState::Interrupted || self.robot.job.as_ref() == Some(&job.id);
        let job = jobs.into_iter().find(|job| job.robot == self.name && is_open(job) && is_wanted(job));
        let job = job.ok_or_else(|| {
            let of_plan = plan_id.map_or_else(String::new, |id| format!(" of plan {id}"));
            Failure::request_failed(format!(
                "the service has no unfinished job{of_plan} on robot {}: start a job with `growbot grow`",
                self.name
            ))
        })?;
        if self.robot.job.as_ref() != Some(&job.id) {
            let _: Job = self.caller.post(&format!("/jobs/{}/resume", job.id), &json!({}))?;
        }
        self.say_page(&job, options.page)?;
        self.follow(&job, options)
    }

    /// Prints the address of a growth's page, if it is requested.
    fn say_page(&self, job: &Job, page: Option<PageAccess>) -> Result<(), Failure> {
        let Some(page) = page else { return Ok(()) };
        let PageUrls { control_url: operate, view_url: look } = self.caller.get("/page-urls")?;
        let at = if page == PageAccess::Control { operate } else { look };
        growbot_host::note!("live view: {at}{}/jobs/{}/live/", PREFIX.trim_start_matches('/'), job.id);
        Ok(())
    }

    /// Shows a job until it ends. Ctrl-C stops the job, but closing the terminal does not.
    fn follow(&self, job: &Job, options: &ServiceGrowthOptions) -> Result<(), Failure> {
        self.stop_on_interrupt();
        let mut show = JobProgress::new(job);
        let mut after = 0;
        let mut result = None;
        loop {
            let followed = self.caller.follow(&job.id, &mut after, |line| {
                if let Ok(event) = serde_json::from_str(line) {
                    result = show.ingest(event).or(result.take());
                }
                true
            });
            match followed {
                Ok(()) => break,
                Err(ServiceError::Unreachable(_)) => show.wait_for_service(),
                Err(error) => return Err(error.into()),
            }
        }
        show.progress.finish();
        self.end(job, result, options)
    }

    fn end(&self, job: &Job, result: Option<GrowthResult>, options: &ServiceGrowthOptions) -> Result<(), Failure> {
        let log = self.log(&job.id)?;
        if let Some(path) = &options.log {
            growbot_plan::atomic_file::write_atomic(path, &log)?;
        }
        let now: Job = self.caller.get(&format!("/jobs/{}", job.id))?;
        let Some(result) = result else {
            let why = now.reason.unwrap_or_else(|| "the service gave no reason".to_owned());
            return Err(Failure::request_failed(format!("job {} ended without a result: {why}", job.id)));
        };
        match options.print {
            ResultFormat::Json => print(&json_line(&result))?,
            ResultFormat::Table => {
                let record = RecordedRun::read(&log, &job.id)?;
                print(&replay::text_of(&record)?)?;
            }
            ResultFormat::Nothing => {}
        }
        match result.outcome {
            OutcomeKind::Done => Ok(()),
            outcome => Err(Failure::request_failed(format!(
                "job {} of the {}robot {} ended with outcome {outcome}{}: check the robot, then resume the body with \
                 `growbot resume` if the robot still stores it, or discard it with `growbot cancel`",
                job.id,
                self.kind(),
                self.name,
                result.fault.map_or_else(String::new, |fault| format!(" (fault {fault})"))
            ))),
        }
    }

    fn log(&self, job: &str) -> Result<Vec<u8>, Failure> {
        Ok(self.caller.bytes(&format!("/jobs/{job}/log"))?)
    }

    /// Lets Ctrl-C request a stop from the service. If the terminal is closed instead, the robot continues.
    fn stop_on_interrupt(&self) {
        let name = Arc::new(self.name.clone());
        let installed = ctrlc::set_handler(move || {
            if !io::stderr().is_terminal() {
                std::process::exit(1);
            }
            growbot_host::warning!("stopping; press Ctrl-C again for the emergency stop");
            let orders = [RobotCommand::Stop, RobotCommand::EmergencyStop];
            let order = orders[usize::from(INTERRUPTED.swap(true, std::sync::atomic::Ordering::Relaxed))];
            let path = format!("/robots/{name}/commands");
            // In a thread, so that the second request need not wait for the response to the first.
            std::thread::spawn(move || {
                let given = service_in_emergency()
                    .map(|caller| caller.post::<Value>(&path, &CommandRequest { command: order }));
                if !matches!(given, Some(Ok(_))) {
                    growbot_host::error!(
                        "the service has not confirmed the stop: run `growbot estop`, or cut the robot's power"
                    );
                }
            });
        });
        if let Err(error) = installed {
            growbot_host::warning!(
                "Ctrl-C will end this program, but will not stop the robot ({error}): stop the robot with `growbot \
                 stop` or `growbot estop`"
            );
        }
    }
}

/// True if Ctrl-C was pressed before.
static INTERRUPTED: std::sync::atomic::AtomicBool = std::sync::atomic::AtomicBool::new(false);

/// Options of a growth by the service, and of its output in this program.
pub struct ServiceGrowthOptions {
    pub feedback: bool,
    pub force: bool,
    pub ignore_scene: bool,
    pub print: ResultFormat,
    /// File for a copy of the run log. `None` for no copy.
    pub log: Option<std::path::PathBuf>,
    /// Kind of page whose address is printed. `None` if no page is requested.
    pub page: Option<PageAccess>,
}

/// Kind of page that shows a growth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PageAccess {
    /// Page that only shows the growth.
    View,
    /// Page that can also send commands.
    Control,
}

/// Progress of a job, which is shown on standard error.
struct JobProgress {
    progress: Progress,
    state: String,
    laid: u64,
    layers: u32,
    finish: Option<OffsetDateTime>,
    is_silent: bool,
}

impl JobProgress {
    fn new(job: &Job) -> Self {
        let progress = Progress::start(Some(u64::from(job.layers)), ResultTiming::AtEnd);
        Self { progress, state: "starting".to_owned(), laid: 0, layers: job.layers, finish: None, is_silent: false }
    }

    /// Processes a line of the run log. Returns the result if the line is the last one.
    fn ingest(&mut self, event: RunEvent) -> Option<GrowthResult> {
        if std::mem::take(&mut self.is_silent) {
            self.progress.note("the service responds again");
        }
        match event {
            RunEvent::State { state } => {
                if state != self.state {
                    self.progress.note(&state);
                }
                self.state = state;
            }
            RunEvent::Status(status) => {
                self.finish = status.finish_utc.and_then(|time| OffsetDateTime::parse(&time, &Rfc3339).ok());
            }
            RunEvent::Laid(laid) => self.laid = u64::from(laid.layer) + 1,
            RunEvent::Amendment(amendment) => self.layers = amendment.total,
            RunEvent::Command { command } => self.progress.note(&format!("command: {}", command.name())),
            RunEvent::CommandFailed { reason } => self.progress.warn(&reason),
            RunEvent::NoResponse => self.progress.warn("the board does not respond: the service tries again"),
            RunEvent::Reconnected => self.progress.note("the board responds again"),
            RunEvent::End { result } => return Some(*result),
            _ => {}
        }
        let Self { state, laid, layers, finish, .. } = self;
        self.progress.update(*laid, || {
            let done = finish.map_or_else(String::new, |finish| format!(", done at {}", local_clock_text(finish)));
            format!("{state}, layer {laid} of {layers}{done}")
        });
        None
    }

    fn wait_for_service(&mut self) {
        if !std::mem::replace(&mut self.is_silent, true) {
            self.progress.warn(
                "the service does not respond: waiting for it; without a service the robot pauses after its layer",
            );
        }
        std::thread::sleep(Duration::from_millis(500));
    }
}

/// Pause the present growth of the service, after the layer under way
#[derive(Args)]
#[command(
    after_help = "Example:\n  growbot pause --port /dev/ttyACM0\n\nA growth without a service is paused from its \
                        own terminal or page."
)]
pub struct PauseArgs {
    #[command(flatten)]
    port: RequiredPortArg,
}

/// Continue a paused growth of the service
#[derive(Args)]
#[command(after_help = "Example:\n  growbot continue --port /dev/ttyACM0")]
pub struct ContinueArgs {
    #[command(flatten)]
    port: RequiredPortArg,
}

/// Follow the present growth of the service to its end
#[derive(Args)]
#[command(after_help = "Example:\n  growbot attach --port /dev/ttyACM0")]
pub struct AttachArgs {
    #[command(flatten)]
    port: RequiredPortArg,
    /// End with one line of JSON instead of a table
    #[arg(long)]
    json: bool,
}

fn owned(port: &RequiredPortArg, what: &str) -> Result<ServiceRobot, Failure> {
    let port = port.resolve()?;
    find_service_robot(&port)?.ok_or_else(|| {
        Failure::bad_input(format!(
            "no service owns the {}robot at {}: {what} the growth in the terminal or on the page that started it, or \
             start the growth while `growbot serve` runs",
            port.kind(),
            port.text()
        ))
    })
}

/// Runs `growbot pause`.
pub fn run_pause(args: &PauseArgs) -> Result<(), Failure> {
    let owned = owned(&args.port, "pause")?;
    owned.send_command(RobotCommand::Pause)?;
    Ok(print(&format!("the {}robot {} was ordered to pause after its layer\n", owned.kind(), owned.name))?)
}

/// Runs `growbot continue`.
pub fn run_continue(args: &ContinueArgs) -> Result<(), Failure> {
    let owned = owned(&args.port, "continue")?;
    owned.send_command(RobotCommand::Continue)?;
    Ok(print(&format!("the {}robot {} was ordered to continue\n", owned.kind(), owned.name))?)
}

/// Runs `growbot attach`.
pub fn run_attach(args: &AttachArgs) -> Result<(), Failure> {
    let owned = owned(&args.port, "follow")?;
    let Some(id) = &owned.robot.job else {
        return Err(Failure::request_failed(format!(
            "robot {} has no active job: start a job with `growbot grow`",
            owned.name
        )));
    };
    let job: Job = owned.caller.get(&format!("/jobs/{id}"))?;
    let options = ServiceGrowthOptions {
        feedback: false,
        force: false,
        ignore_scene: false,
        print: ResultFormat::of(args.json),
        log: None,
        page: None,
    };
    owned.follow(&job, &options)
}
