//! `--watch`: a growth to look at while it grows, and the pace of one that is simulated.

use std::sync::Arc;

use clap::Args;
use growbot_client::growth::{Job, Orders};
use growbot_core::layer_bytes::LayerBytes;
use growbot_host::watch::Watch;
use growbot_pictures::view::Subject;
use growbot_sim::port::PortName;

use super::Failure;
use super::service::Page;

/// The default pace of a simulated growth that is watched, in multiples of real time.
const WATCHED_PACE: f64 = 60.0;

/// How a growth is watched.
#[derive(Args)]
pub struct WatchArgs {
    /// Serve a page that follows the growth, on this machine alone
    ///
    /// The command prints its address, which contains a secret: everyone who knows it may look. From another machine:
    /// ssh -L 8080:localhost:8080, and --watch-port 8080.
    #[arg(long)]
    watch: bool,
    /// Serve it on this port [default: any]
    #[arg(long, value_name = "PORT", requires = "watch")]
    watch_port: Option<u16>,
    /// Let the page pause, continue and stop the growth, too
    #[arg(long, requires = "watch")]
    control: bool,
    /// On sim, the pace in multiples of real time [default: 60 with --watch,
    /// otherwise as fast as it is computed]
    #[arg(long, value_name = "TIMES", value_parser = times)]
    pace: Option<f64>,
}

impl WatchArgs {
    /// How fast time passes at a port.
    pub fn pace(&self, port: &PortName) -> Result<Option<f64>, Failure> {
        if self.pace.is_some() && !port.is_virtual() {
            return Err(Failure::bad_input(
                "--pace is for --port sim: time passes by itself elsewhere; leave it out".to_string(),
            ));
        }
        Ok(self.pace.or((self.watch && port.is_virtual()).then_some(WATCHED_PACE)))
    }

    /// Whether the page may give orders.
    pub fn controls(&self) -> bool {
        self.watch && self.control
    }

    /// Which page of the service is asked for, where that grows the body: it has its own, at its own port and pace.
    pub fn of_service(&self) -> Result<Option<Page>, Failure> {
        let only = [(self.watch_port.is_some(), "--watch-port"), (self.pace.is_some(), "--pace")];
        if let Some((_, option)) = only.iter().find(|(given, _)| *given) {
            return Err(Failure::bad_input(format!(
                "{option} is for growths without a service: leave it out, and see `growbot serve --help` and [robots] \
                 in growbot.toml"
            )));
        }
        Ok(self.watch.then_some(if self.control { Page::Control } else { Page::Look }))
    }

    /// Begins to serve the page, if one is asked for, and says where.
    pub fn begin(
        &self,
        subject: &Subject,
        job: &Job,
        known: &[Option<LayerBytes>],
        orders: &Arc<Orders>,
    ) -> Result<Option<Watch>, Failure> {
        if !self.watch {
            return Ok(None);
        }
        let orders = self.control.then(|| Arc::clone(orders));
        let watch =
            Watch::start(subject, job, known, orders, self.watch_port.unwrap_or(0)).map_err(Failure::bad_input)?;
        growbot_host::note!("watch it at {}", watch.address());
        Ok(Some(watch))
    }
}

/// A factor of time.
pub fn times(text: &str) -> Result<f64, String> {
    let times: f64 = text.parse().map_err(|_| format!("`{text}` is no number"))?;
    // Slower, orders would wait for long.
    if (0.1..=1e6).contains(&times) { Ok(times) } else { Err(format!("{times} is not between 0.1 and 1000000")) }
}
