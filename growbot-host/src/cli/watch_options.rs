//! `--watch`: a page that follows a growth, and the pace of a simulated growth.

use std::sync::Arc;

use clap::Args;
use growbot_client::growth::CommandQueue;
use growbot_client::status::RobotStatus;
use growbot_core::layer_bytes::LayerBytes;
use growbot_pictures::view::Subject;
use growbot_pictures::view::page::PageAccess;
use growbot_plan::job::Job;
use growbot_serve::watch::WatchPage;
use growbot_sim::port::PortName;

use super::failure::Failure;

/// Default pace of a simulated growth that is watched, in multiples of real time.
const WATCHED_PACE: f64 = 60.0;

/// Options for watching a growth.
#[derive(Args, Default)]
pub struct WatchArgs {
    /// Serve a page that follows the growth, only on this machine
    ///
    /// The command prints its address, which contains a secret: anyone who knows it may look. From another machine: ssh
    /// -L 8080:localhost:8080, and --watch-port 8080.
    #[arg(long)]
    watch: bool,
    /// Port of the page [default: any]
    #[arg(long, value_name = "PORT", requires = "watch")]
    watch_port: Option<u16>,
    /// Let the page also pause, continue and stop the growth
    #[arg(long, requires = "watch")]
    control: bool,
    /// Pace on sim, in multiples of real time [default: 60 with --watch, otherwise as fast as it is computed]
    #[arg(long, value_name = "TIMES", value_parser = parse_pace)]
    pace: Option<f64>,
}

impl WatchArgs {
    /// Returns the requested speed of a port's virtual clock, in multiples of real time. `None` if the port has no
    /// virtual clock, or if the clock of `sim` is to run as fast as possible.
    pub fn pace(&self, port: &PortName) -> Result<Option<f64>, Failure> {
        if self.pace.is_some() && !port.is_virtual() {
            return Err(Failure::bad_input(
                "--pace applies only to --port sim: remove --pace (`growbot power on --pace` sets the pace of sim:NAME)"
                    .to_string(),
            ));
        }
        Ok(self.pace.or((self.watch && port.is_virtual()).then_some(WATCHED_PACE)))
    }

    /// Returns true if the page may send commands.
    pub fn can_control(&self) -> bool {
        self.watch && self.control
    }

    /// Returns the kind of page that is requested for a growth by the service, or `None`. Returns an error if a port
    /// or a pace is given, because the service has its own.
    pub fn of_service(&self) -> Result<Option<PageAccess>, Failure> {
        let only = [(self.watch_port.is_some(), "--watch-port"), (self.pace.is_some(), "--pace")];
        if let Some((_, option)) = only.iter().find(|(given, _)| *given) {
            return Err(Failure::bad_input(format!(
                "{option} applies only to growths without a service, but a service owns this robot: remove {option}, \
                 and see `growbot serve --help` and [robots] in growbot.toml"
            )));
        }
        Ok(self.watch.then_some(if self.control { PageAccess::Control } else { PageAccess::View }))
    }

    /// Starts to serve the page, and prints its address. `None` if no page is requested. `robot` has the port, the kind
    /// and the pace of the robot.
    pub fn begin(
        &self,
        subject: &Subject,
        job: &Job,
        known: &[Option<LayerBytes>],
        robot: RobotStatus,
        orders: &Arc<CommandQueue>,
    ) -> Result<Option<WatchPage>, Failure> {
        if !self.watch {
            return Ok(None);
        }
        let orders = self.control.then(|| Arc::clone(orders));
        let watch = WatchPage::start(subject, job, known, robot, orders, self.watch_port.unwrap_or(0))?;
        growbot_host::note!("live view: {}", watch.address());
        Ok(Some(watch))
    }
}

/// Parses a pace, in multiples of real time, as 10 or 10x.
pub fn parse_pace(text: &str) -> Result<f64, String> {
    let times: f64 =
        text.strip_suffix('x').map_or(text, str::trim_end).parse().map_err(|_| format!("`{text}` is not a number"))?;
    // At a slower pace, commands would wait for long.
    if (0.1..=1e6).contains(&times) {
        Ok(times)
    } else {
        Err(format!("{times} is not between 0.1 and 1000000: give such a number"))
    }
}
