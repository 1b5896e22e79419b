//! A robot that a service owns: commands send requests to the service.

use std::io::{self, IsTerminal};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use growbot_client::growth::{LogTarget, OnInterrupted, Override};
use growbot_client::status::RobotStatus;
use growbot_core::link::message::HostSilencePolicy;
use growbot_host::interrupt::on_interrupt;
use growbot_host::output::print;
use growbot_host::progress::{Progress, ResultTiming};
use growbot_pictures::clock_text::local_clock_text;
use growbot_pictures::view::page::PageAccess;
use growbot_plan::plan_file::PlanFile;
use growbot_plan::robot_kind::RobotKind;
use growbot_plan::run_log::{GrowthResult, OutcomeKind, RecordedRun, RunEvent};
use growbot_plan::sanitize::json_line;
use growbot_remote::PREFIX;
use growbot_remote::client::{RESPONSE_TIMEOUT, ServiceClient, ServiceError};
use growbot_remote::commands::{CommandRequest, MaintenanceRequest, RobotCommand};
use growbot_remote::grow_request::GrowRequest;
use growbot_remote::job::{Job, JobState};
use growbot_remote::page_urls::PageUrls;
use growbot_sim::crash::FirmwareImage;
use serde_json::value::to_raw_value;
use serde_json::{Value, json};
use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;

use super::board_report::BoardReport;
use super::body_input::BodyInput;
use super::failure::Failure;
use super::growth_monitor::ResultFormat;
use super::port_arg::SelectedPort;
use super::port_lease::PortLeaseGuard;
use super::replay;
use super::robot_handle::{NewGrowth, ResumedGrowth, RobotHandle, clear_message};
use super::service_lookup::{EMERGENCY, service_in_emergency};

impl From<ServiceError> for Failure {
    fn from(error: ServiceError) -> Self {
        match &error {
            ServiceError::Rejected { status: 422 | 404, .. } => Self::before_start(&error),
            _ => Self::during_request(&error),
        }
    }
}

/// A robot that a service owns.
pub struct ServiceRobot {
    caller: ServiceClient,
    /// Name of the robot in the service.
    name: String,
    robot: RobotStatus,
    /// Timeout of an emergency stop. It is longer for a robot that is simulated inside the service, because only the
    /// service can stop that robot.
    emergency_limit: Duration,
}

/// Returns the robot at this port, if a service of this user owns it.
pub fn find_service_robot(port: &SelectedPort) -> Result<Option<ServiceRobot>, Failure> {
    owner_within(port, RESPONSE_TIMEOUT)
}

/// Like [`find_service_robot`], but for an emergency, in which a service that hangs must not delay the stop. A robot
/// that is simulated inside the service can be stopped only by the service, so there the timeout is longer.
pub fn owner_in_emergency(port: &SelectedPort) -> Option<ServiceRobot> {
    owner_of(service_in_emergency()?, port, emergency_limit(port)).ok().flatten()
}

fn emergency_limit(port: &SelectedPort) -> Duration {
    if port.is_in_process() { RESPONSE_TIMEOUT } else { EMERGENCY }
}

fn owner_within(port: &SelectedPort, limit: Duration) -> Result<Option<ServiceRobot>, Failure> {
    ServiceClient::find()?.map_or(Ok(None), |caller| owner_of(caller, port, limit))
}

fn owner_of(caller: ServiceClient, port: &SelectedPort, limit: Duration) -> Result<Option<ServiceRobot>, Failure> {
    let robot = caller.robot_at(port.text(), limit)?;
    let emergency_limit = emergency_limit(port);
    Ok(robot.and_then(|robot| Some(ServiceRobot { caller, name: robot.name.clone()?, robot, emergency_limit })))
}

impl ServiceRobot {
    fn at(&self, what: &str) -> String {
        format!("/robots/{}/{what}", self.name)
    }

    fn send_command(&self, order: RobotCommand) -> Result<RobotStatus, ServiceError> {
        self.caller.post(&self.at("commands"), &CommandRequest { command: order })
    }

    /// Sends the emergency stop. Returns false if the service does not confirm it in time.
    pub fn emergency_stop(&self) -> bool {
        let given = CommandRequest { command: RobotCommand::EmergencyStop };
        self.caller.post_within::<Value>(&self.at("commands"), &given, self.emergency_limit).is_ok()
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
    fn follow(&self, job: &Job, print: ResultFormat, log: Option<&Path>) -> Result<(), Failure> {
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
        self.end(job, result, print, log)
    }

    fn end(
        &self,
        job: &Job,
        result: Option<GrowthResult>,
        format: ResultFormat,
        copy: Option<&Path>,
    ) -> Result<(), Failure> {
        let log = self.log(&job.id)?;
        if let Some(path) = copy {
            growbot_plan::atomic_file::write_atomic(path, &log)?;
        }
        let now: Job = self.caller.get(&format!("/jobs/{}", job.id))?;
        let Some(result) = result else {
            let why = now.reason.unwrap_or_else(|| "the service gave no reason".to_owned());
            return Err(Failure::request_failed(format!("job {} ended without a result: {why}", job.id)));
        };
        match format {
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
                self.kind().prefix(),
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
        let installed = on_interrupt(move || {
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

impl RobotHandle for ServiceRobot {
    fn kind(&self) -> RobotKind {
        self.robot.simulated.into()
    }

    fn status(&self, _: Option<FirmwareImage>) -> Result<BoardReport, Failure> {
        Ok(BoardReport::of_status(self.robot.clone()))
    }

    fn stop(&self) -> Result<(), Failure> {
        self.send_command(RobotCommand::Stop)?;
        Ok(())
    }

    fn cancel(&self) -> Result<String, Failure> {
        self.send_command(RobotCommand::Cancel)?;
        Ok(format!("the {}board stores no body any more\n", self.kind().prefix()))
    }

    fn clear(&self) -> Result<String, Failure> {
        self.send_command(RobotCommand::ClearFault)?;
        Ok(clear_message(self.kind(), self.robot.state.as_deref().unwrap_or("unknown")))
    }

    fn maintain(&self, task: &str, value: &str) -> Result<String, Failure> {
        let maintenance = MaintenanceRequest { task: task.to_owned(), value: value.to_owned() };
        let _: RobotStatus = self.caller.post(&self.at("maintenance"), &maintenance)?;
        Ok(format!("{}robot {}: {task} {value}\n", self.kind().prefix(), self.name))
    }

    fn pause(&self) -> Result<String, Failure> {
        self.send_command(RobotCommand::Pause)?;
        Ok(format!("the {}robot {} was ordered to pause after its layer\n", self.kind().prefix(), self.name))
    }

    fn continue_growth(&self) -> Result<String, Failure> {
        self.send_command(RobotCommand::Continue)?;
        Ok(format!("the {}robot {} was ordered to continue\n", self.kind().prefix(), self.name))
    }

    fn attach(&self, print: ResultFormat) -> Result<(), Failure> {
        let Some(id) = &self.robot.job else {
            return Err(Failure::request_failed(format!(
                "robot {} has no active job: start a job with `growbot grow`",
                self.name
            )));
        };
        let job: Job = self.caller.get(&format!("/jobs/{id}"))?;
        self.follow(&job, print, None)
    }

    fn grow(&self, growth: NewGrowth) -> Result<(), Failure> {
        let NewGrowth { request, name, scene_path, log, watching, print, .. } = growth;
        if request.has_imperfection() {
            return Err(Failure::bad_input(
                "the service owns this robot and does not support noise and bias options: remove them, or use \
                 --port sim",
            ));
        }
        let log = match log {
            LogTarget::StandardOutput => {
                return Err(Failure::bad_input(
                    "the service keeps the run log of its jobs: name a file for a copy after --log, or remove --log",
                ));
            }
            LogTarget::File(path) if path.exists() => {
                return Err(Failure::bad_input(format!(
                    "run log {} already exists: name another file, or replace it with --overwrite",
                    path.display()
                )));
            }
            LogTarget::File(path) | LogTarget::Replaced(path) => Some(path),
            LogTarget::Disabled => None,
        };
        let page = watching.of_service()?;
        let written = PlanFile::with_robot(request.plan, request.robot);
        let wanted = GrowRequest {
            plan: Some(to_raw_value(&written).map_err(Failure::bad_input)?),
            scene: scene_path,
            feedback: request.feedback.is_some(),
            force: request.overrides.contains(&Override::Warnings),
            ignore_scene: request.overrides.contains(&Override::Scene),
            name: Some(name),
            ..GrowRequest::default()
        };
        let job: Job = self.caller.post(&self.at("jobs"), &wanted)?;
        growbot_host::note!("the service runs the growth as job {}; the job continues after this command ends", job.id);
        self.say_page(&job, page)?;
        self.follow(&job, print, log.as_deref())
    }

    /// Resumes the latest unfinished job of this robot, or follows the active one. A service lays an interrupted layer
    /// again, lets the board pause if the service is silent, and takes the scene from its original place.
    fn resume(&self, growth: ResumedGrowth) -> Result<(), Failure> {
        let given = [
            ("--interrupted-layer keep", growth.interrupted == OnInterrupted::Skip),
            ("--on-host-silence continue", growth.silence == HostSilencePolicy::Continue),
            ("--scene", growth.scene.is_some()),
        ];
        if let Some((option, _)) = given.into_iter().find(|(_, is_given)| *is_given) {
            return Err(Failure::bad_input(format!(
                "a service owns this robot and does not support {option}: remove this option, or end `growbot serve` \
                 first"
            )));
        }
        let page = growth.watching.of_service()?;
        let plan_id = growth.opened.map(|(_, BodyInput { robot, plan, .. })| {
            let plan_id = growbot_plan::job::Job::of_plan(&robot, &plan).plan_id;
            format!("{plan_id:016x}")
        });
        let jobs: Vec<Job> = self.caller.get("/jobs?limit=1000")?;
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
        self.say_page(&job, page)?;
        self.follow(&job, growth.print, None)
    }

    fn lease(self: Box<Self>, command: &str) -> Result<Option<PortLeaseGuard>, Failure> {
        let line = self.caller.lease_port(&self.name, command)?;
        growbot_host::note!(
            "the service released the port of {}robot {} to this command",
            self.kind().prefix(),
            self.name
        );
        Ok(Some(PortLeaseGuard::new(line, self.caller)))
    }
}

/// True if Ctrl-C was pressed before.
static INTERRUPTED: std::sync::atomic::AtomicBool = std::sync::atomic::AtomicBool::new(false);

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
