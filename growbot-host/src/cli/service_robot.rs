//! A robot that a service owns: commands send requests to the service.

use std::io::{self, IsTerminal};
use std::ops::ControlFlow;
use std::path::Path;

use growbot_client::growth::{LogTarget, OnInterrupted};
use growbot_client::robot_command::RobotCommand;
use growbot_core::link::message::HostSilencePolicy;
use growbot_host::output::print;
use growbot_pictures::view::page::PageAccess;
use growbot_plan::robot_kind::RobotKind;
use growbot_plan::run_log::{GrowthResult, OutcomeKind, RecordedRun};
use growbot_plan::sanitize::json_line;
use growbot_remote::PREFIX;
use growbot_remote::api::{Job, JobState, MaintenanceRequest, PageUrls};
use growbot_remote::client::{JobLogUpdate, RequestHandle, ServiceError};
use growbot_remote::remote_robot::{LeasedPort, RemoteRobot};

use super::board_report::BoardReport;
use super::body_input::BodyInput;
use super::failure::Failure;
use super::growth_monitor::ResultFormat;
use super::growth_progress::GrowthProgress;
use super::replay;
use super::robot_handle::{NewGrowth, ResumedGrowth, RobotHandle};
use super::stop_on_interrupt::react_to_interrupt;

impl From<ServiceError> for Failure {
    fn from(error: ServiceError) -> Self {
        if error.is_invalid_request() { Self::before_start(&error) } else { Self::during_request(&error) }
    }
}

/// Prints the address of a growth's page, if it is requested.
fn say_page(robot: &RemoteRobot, job: &Job, page: Option<PageAccess>) -> Result<(), Failure> {
    let Some(page) = page else { return Ok(()) };
    let PageUrls { control_url: operate, view_url: look } = robot.client.page_urls()?;
    let at = if page == PageAccess::Control { operate } else { look };
    growbot_host::note!("live view: {at}{}/jobs/{}/live/", PREFIX.trim_start_matches('/'), job.id);
    Ok(())
}

/// Instructions for a robot that waits for filament.
const OUT_OF_FILAMENT: &str = "out of filament: change it with `growbot recover`, or on the page of the service; the \
                               robot waits for an hour at standby temperature";

/// Shows a job until it ends. Ctrl-C stops the job, but closing the terminal does not.
fn follow(
    robot: &RemoteRobot,
    job: &Job,
    mut show: GrowthProgress,
    print: ResultFormat,
    log: Option<&Path>,
) -> Result<(), Failure> {
    stop_on_interrupt(robot);
    let (mut result, mut is_silent) = (None, false);
    let ended = robot.client.follow_job(&job.id, |update| {
        let was_silent = std::mem::replace(&mut is_silent, update == JobLogUpdate::NoResponse);
        match (was_silent, is_silent) {
            (false, true) => show.warn(
                "the service does not respond: waiting for it; without a service the robot pauses after its layer",
            ),
            (true, false) => show.note("the service responds again"),
            _ => {}
        }
        if let JobLogUpdate::Line(line) = update {
            result = show.ingest_line(line).or(result.take());
        }
        ControlFlow::Continue(())
    });
    show.end();
    let ended = ended?.unwrap_or_else(|| job.clone());
    end(robot, &ended, result, print, log)
}

/// Returns the progress of a job whose events are all shown.
fn progress_of(job: &Job) -> GrowthProgress {
    GrowthProgress::new(job.layers, 0, OUT_OF_FILAMENT)
}

fn end(
    robot: &RemoteRobot,
    job: &Job,
    result: Option<GrowthResult>,
    format: ResultFormat,
    copy: Option<&Path>,
) -> Result<(), Failure> {
    let log = robot.client.job_log(&job.id)?;
    if let Some(path) = copy {
        growbot_plan::atomic_file::write_atomic(path, &log)?;
    }
    let Some(result) = result else {
        let why = job.reason.as_deref().unwrap_or("the service gave no reason");
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
            robot.kind().prefix(),
            robot.name,
            result.fault.map_or_else(String::new, |fault| format!(" (fault {fault})"))
        ))),
    }
}

/// Lets Ctrl-C request a stop from the service. If the terminal is closed instead, the robot continues.
fn stop_on_interrupt(robot: &RemoteRobot) {
    let (robot, mut is_repeated) = (robot.clone(), false);
    react_to_interrupt(move || {
        if !io::stderr().is_terminal() {
            std::process::exit(1);
        }
        growbot_host::warning!("stopping; press Ctrl-C again for the emergency stop");
        let order = if is_repeated { RobotCommand::EmergencyStop } else { RobotCommand::Stop };
        is_repeated = true;
        let robot = robot.clone();
        // In a thread, so that the second request need not wait for the response to the first.
        std::thread::spawn(move || {
            if robot.send_command(order).is_err() {
                growbot_host::error!(
                    "the service has not confirmed the stop: run `growbot estop`, or cut the robot's power"
                );
            }
        });
    });
}

impl RobotHandle for RemoteRobot {
    fn kind(&self) -> RobotKind {
        self.found.simulated.into()
    }

    fn status(&self) -> Result<BoardReport, Failure> {
        Ok(BoardReport::new(self.request_status()?))
    }

    fn command(&self, command: RobotCommand) -> Result<String, Failure> {
        Ok(self.send_command(command)?)
    }

    fn maintain(&self, task: &str, value: &str) -> Result<String, Failure> {
        Ok(RemoteRobot::maintain(self, &MaintenanceRequest { task: task.to_owned(), value: value.to_owned() })?)
    }

    fn attach(&self, print: ResultFormat) -> Result<(), Failure> {
        let Some(id) = &self.found.job else {
            return Err(Failure::request_failed(format!(
                "robot {} has no active job: start a job with `growbot grow`",
                self.name
            )));
        };
        let job = self.client.job(id)?;
        follow(self, &job, progress_of(&job).begin_now(), print, None)
    }

    fn grow(&self, growth: NewGrowth) -> Result<(), Failure> {
        let NewGrowth { request, name, scene_path, log, watching, print, .. } = growth;
        if request.has_imperfection() {
            return Err(Failure::bad_input(
                "the service owns this robot and does not support noise and bias options: remove them, or use \
                 --port sim",
            ));
        }
        if log == LogTarget::StandardOutput {
            return Err(Failure::bad_input(
                "the service keeps the run log of its jobs: name a file for a copy after --log, or remove --log",
            ));
        }
        let log = log.copy()?;
        let page = watching.of_service()?;
        let job = RemoteRobot::grow(self, &request, name, scene_path, &RequestHandle::default())?;
        growbot_host::note!("the service runs the growth as job {}; the job continues after this command ends", job.id);
        say_page(self, &job, page)?;
        follow(self, &job, progress_of(&job), print, log.as_deref())
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
        let jobs = self.client.jobs()?;
        let is_wanted = |job: &Job| plan_id.as_ref().is_none_or(|id| job.plan_id == *id);
        let is_open = |job: &Job| job.state == JobState::Interrupted || self.found.job.as_ref() == Some(&job.id);
        let job = jobs.into_iter().find(|job| job.robot == self.name && is_open(job) && is_wanted(job));
        let job = job.ok_or_else(|| {
            let of_plan = plan_id.map_or_else(String::new, |id| format!(" of plan {id}"));
            Failure::request_failed(format!(
                "the service has no unfinished job{of_plan} on robot {}: start a job with `growbot grow`",
                self.name
            ))
        })?;
        let show = progress_of(&job).begin_now();
        if self.found.job.as_ref() != Some(&job.id) {
            RemoteRobot::resume(self, &job.id)?;
        }
        say_page(self, &job, page)?;
        follow(self, &job, show, growth.print, None)
    }

    fn lease(&self, command: &str) -> Result<Option<LeasedPort>, Failure> {
        let lease = self.lease_port(command)?;
        growbot_host::note!(
            "the service released the port of {}robot {} to this command",
            self.kind().prefix(),
            self.name
        );
        Ok(Some(lease))
    }
}
