//! The growth of this process, as the source of its page. It has no list of jobs, no files and no queue.

use std::sync::Arc;

use axum::body::Bytes;
use axum::response::Html;
use futures_util::stream::{BoxStream, StreamExt};
use growbot_client::growth::CommandQueue;
use growbot_client::status::RobotStatus;
use growbot_core::layer_bytes::LayerBytes;
use growbot_pictures::view::{Subject, ViewError, page};
use growbot_plan::job::{Command, Job};
use tokio::sync::watch;

use super::heartbeat::OrderAge;
use super::live_growth::LiveGrowth;
use crate::access::Access;
use crate::audit::CommandSource;
use crate::limits::RoleLimits;
use crate::page_source::{ArrivalPermits, PageSource};
use crate::problem::Problem;
use crate::stream_event::StreamEvent;

/// Identifier of the growth in the paths of its page.
pub const JOB: &str = "growth";

/// The growth of this process, as the source of its page.
pub struct WatchedGrowth {
    /// State of the growth for live pages.
    pub live: Arc<LiveGrowth>,
    page: Bytes,
    /// Queue of commands to the growth. `None` if the page is read-only.
    orders: Option<Arc<CommandQueue>>,
    /// Name of the robot in paths.
    name: String,
}

impl WatchedGrowth {
    /// Creates the source of the page that shows this body while it grows. `known` are the layers that have already
    /// been built, and `robot` is the part of the robot's status that its board does not report.
    ///
    /// # Errors
    /// [`ViewError`] if the page cannot be created.
    pub fn new(
        subject: &Subject,
        job: &Job,
        known: &[Option<LayerBytes>],
        robot: RobotStatus,
        orders: Option<Arc<CommandQueue>>,
    ) -> Result<Self, ViewError> {
        let name = subject.robot.name().to_owned();
        let robot = RobotStatus { name: Some(name.clone()), job: Some(JOB.to_owned()), ..robot };
        let live = LiveGrowth::new(job, known, robot);
        let mut growth = Self { live, page: Bytes::new(), orders, name };
        growth.page = page::render_live(subject, growth.access().page())?.into();
        Ok(growth)
    }

    /// Returns the rights of the page.
    pub fn access(&self) -> Access {
        if self.orders.is_some() { Access::Control(CommandSource::Web) } else { Access::View }
    }

    fn check_job(&self, job: &str) -> Result<(), Problem> {
        if job == JOB { Ok(()) } else { Err(Problem::not_found("job", job)) }
    }
}

impl PageSource for WatchedGrowth {
    fn robots(&self) -> Vec<RobotStatus> {
        vec![self.live.status()]
    }

    fn changes(&self) -> watch::Receiver<u64> {
        self.live.changes()
    }

    fn permits(&self, age: OrderAge) -> ArrivalPermits {
        let permit = |orders: &Arc<CommandQueue>| (self.name.clone(), orders.permit_now());
        ArrivalPermits { permits: self.orders.iter().map(permit).collect(), age }
    }

    async fn live_page(&self, job: &str, _: &RoleLimits) -> Result<Html<Bytes>, Problem> {
        self.check_job(job).map(|()| Html(self.page.clone()))
    }

    fn live_events(&self, job: &str) -> Result<BoxStream<'static, StreamEvent>, Problem> {
        self.check_job(job).map(|()| Arc::clone(&self.live).updates().boxed())
    }

    async fn send_live_command(
        self: Arc<Self>,
        _: CommandSource,
        job: String,
        command: Command,
        permits: ArrivalPermits,
    ) -> Result<(), Problem> {
        self.check_job(&job)?;
        let orders = self.orders.as_ref().ok_or_else(Problem::read_only)?;
        let permit = permits.for_command(&self.name, command)?;
        match command {
            Command::Stop | Command::EmergencyStop => orders.push(command),
            command => orders.push_with(command, permit.clone()),
        }
        Ok(())
    }
}
