//! Pages of the service's jobs.

use std::future::ready;
use std::sync::Arc;
use std::time::Duration;

use axum::body::Bytes;
use axum::response::Html;
use futures_util::stream::{BoxStream, StreamExt, once, unfold};
use growbot_client::robot_command::RobotCommand;
use growbot_client::status::RobotStatus;
use growbot_pictures::view::page::PageAccess;
use growbot_pictures::view::{NamedScene, Subject, page};
use growbot_plan::job::Command;
use growbot_plan::run_log::RecordedRun;
use growbot_remote::api::{Job, JobState};
use serde_json::json;
use tokio::sync::watch;
use tokio::time::sleep;

use super::audit::CommandSource;
use super::commands::run_command;
use super::handler::{find_robot, found_job, run_blocking};
use super::limits::RoleLimits;
use super::page_source::{ArrivalPermits, PageSource};
use super::plan_routes::scene_name;
use super::problem::Problem;
use super::robot_worker::RobotWorker;
use super::service::Service;
use super::stream_event::StreamEvent;
use crate::watch::heartbeat::{Heartbeat, OrderAge};

/// Time after which the stream of updates of an active job ends if its robot is disconnected. The page then requests
/// the updates again.
const AWAY: Duration = Duration::from_secs(2);

impl PageSource for Service {
    fn robots(&self) -> Vec<RobotStatus> {
        self.robots.values().map(|robot| robot.status()).collect()
    }

    fn changes(&self) -> watch::Receiver<u64> {
        self.shared.changes.subscribe()
    }

    fn permits(&self, age: OrderAge) -> ArrivalPermits {
        let permit = |(name, robot): (&String, &Arc<RobotWorker>)| (name.clone(), robot.signal().permit());
        ArrivalPermits { permits: self.robots.iter().map(permit).collect(), age }
    }

    async fn live_page(&self, job: &str, limits: &RoleLimits) -> Result<Html<Bytes>, Problem> {
        let found = found_job(self, job)?;
        let is_live = find_robot(self, &found.robot).is_ok_and(|keeper| keeper.live(job).is_some());
        page_of(self, limits, found, is_live.then(|| limits.access().page())).await
    }

    /// If the robot of an active job is disconnected, the stream ends after one heartbeat and a pause, and the page
    /// connects again. For a job that is not active, the stream contains only the event that the job has ended.
    fn live_events(&self, job: &str) -> Result<BoxStream<'static, StreamEvent>, Problem> {
        let job = found_job(self, job)?;
        let robot = self.robot(&job.robot);
        if let Some(live) = robot.and_then(|robot| robot.live(&job.id)) {
            return Ok(live.updates().boxed());
        }
        if job.state != JobState::Active {
            let detail = format!("job {} is {}", job.id, job.state.name());
            let end = StreamEvent::new("end", &json!({ "detail": detail }).to_string());
            return Ok(once(ready(end)).boxed());
        }
        let age = robot.and_then(|robot| robot.status().status_age_s);
        let pause = unfold((), |()| async {
            sleep(AWAY).await;
            None
        });
        Ok(once(ready(StreamEvent::heartbeat(&Heartbeat::now(age)))).chain(pause).boxed())
    }

    async fn send_live_command(
        self: Arc<Self>,
        by: CommandSource,
        job: String,
        command: Command,
        permits: ArrivalPermits,
    ) -> Result<(), Problem> {
        let keeper = find_robot_of_job(&self, &job).await?;
        let permit = permits.for_command(&keeper.name, command)?.clone();
        run_blocking(move || {
            let given = match command {
                Command::Stop => run_command(&keeper, RobotCommand::Stop, &permit),
                Command::EmergencyStop => run_command(&keeper, RobotCommand::EmergencyStop, &permit),
                command => keeper.order_growth(command, Some(&job), &permit),
            };
            self.shared.audit.note(by, &keeper.name, command.name(), &given);
            Ok(given.map(drop)?)
        })
        .await
    }
}

/// Returns the robot of a job. The robot of an active job is found without the list of jobs, so that a stop does not
/// wait for the database.
async fn find_robot_of_job(service: &Arc<Service>, id: &str) -> Result<Arc<RobotWorker>, Problem> {
    if let Some(worker) = service.robots.values().find(|worker| worker.lock_state().job.as_deref() == Some(id)) {
        return Ok(Arc::clone(worker));
    }
    let (list, id) = (Arc::clone(service), id.to_owned());
    let job = run_blocking(move || found_job(&list, &id)).await?;
    find_robot(service, &job.robot).cloned()
}

/// Returns the page of a job: a live page with this access, or the page of its run log if `access` is `None`.
pub(super) async fn page_of(
    service: &Service,
    limits: &RoleLimits,
    job: Job,
    access: Option<PageAccess>,
) -> Result<Html<Bytes>, Problem> {
    let path = service.shared.jobs_to_read().log_path(&job.id);
    let computed = limits.compute(move |_| {
        let record = RecordedRun::open(&path).map_err(Problem::conflict)?;
        let robot = record.own_robot().map_err(Problem::conflict)?;
        let plan = record.plan(&robot).map_err(Problem::conflict)?;
        let name = format!("{} on {}", job.name, job.robot);
        // A body can be shown without its scene.
        let scene = record.scene(&plan, &robot, None).ok().flatten();
        let scene = scene.as_ref().map(|loaded| NamedScene { file: scene_name(&plan), scene: &loaded.scene });
        let of = |run| Subject { name: &name, robot: &robot, plan: &plan, run, laid: None, scene };
        let page = match access {
            Some(access) => page::render_live(&of(None), access),
            None => page::render(&of(Some(&record))),
        };
        page.map(|page| Html(page.into())).map_err(Problem::bad)
    });
    computed.await
}
