//! `growbot serve`: the service that owns robots.

use std::collections::BTreeMap;
use std::env;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;

use clap::Args;
use growbot_host::output::print;
use growbot_serve::config::{PRACTICE, RobotEntry, practice};
use growbot_serve::page_listener::take_handed_over;
use growbot_serve::server::Server;
use growbot_serve::settings::{InvalidFiles, Key, ServiceSettings, Setting, SettingOrigin, load_service};
use growbot_serve::{Service, ServicePaths};
use rustix::fs::Mode;
use rustix::process::umask;

use super::failure::Failure;
use super::settings;

/// Run the service that owns robots: one process for all programs and pages
///
/// Robots are the tables [robots.NAME] of growbot.toml, with a port and, for a robot that is not built in, its
/// description. Without such tables, the service has a simulated robot for practice. Growths continue after the end of
/// the command that has started them, and of this process. When the service is started again, it finds its robots and
/// continues.
///
/// The pages are available only on this machine. Their address contains a secret: anyone who knows it may send
/// commands. Each start has a new secret, unless systemd holds the port (growbot.socket). From another machine:
/// ssh -L 8017:localhost:8017.
#[derive(Args)]
#[command(after_help = AFTER_HELP)]
pub struct ServeArgs {
    /// Port of this machine for the pages, 0 for any [default: that of growbot.toml, or else 8017]
    #[arg(long, value_name = "PORT")]
    page_port: Option<u16>,
}

const AFTER_HELP: &str = "\
Examples:
  growbot serve
  growbot serve --page-port 9000";

/// Default port of the pages.
const PAGE_PORT: u16 = 8017;

/// Maximum number of threads that send commands to robots. It is greater than the number of possible connections to
/// the service, so that a stop never waits for a thread.
const COMMAND_THREADS: usize = 1024;

/// Environment variable of glibc: number of free bytes at the end of a heap above which they are returned to the
/// system.
const TRIM_THRESHOLD: &str = "MALLOC_TRIM_THRESHOLD_";

/// Runs the command.
pub fn run(args: &ServeArgs) -> Result<(), Failure> {
    restart_with_small_heap();
    let ServiceSettings { robots, serve, origin } = load_service(InvalidFiles::Refuse)?;
    let robots = if robots.is_empty() { practising()? } else { robots };
    let places = ServicePaths::for_user().ok_or_else(|| {
        Failure::bad_input(
            "neither XDG_STATE_HOME nor HOME is set: set one of them, because the service needs a directory for its \
             files",
        )
    })?;
    // Other users cannot read what the service writes.
    umask(Mode::RWXG | Mode::RWXO);
    places.create().map_err(|error| {
        Failure::bad_input(format!(
            "cannot create the folders of the service, {} and {}: {error}; set XDG_STATE_HOME and XDG_RUNTIME_DIR to \
             folders that you can write",
            places.state_dir().display(),
            places.socket().parent().unwrap_or(Path::new("")).display()
        ))
    })?;
    let handed_over = take_handed_over().map_err(Failure::bad_input)?;
    let port = args.page_port.or(serve.port).unwrap_or(PAGE_PORT);
    let runtime = tokio::runtime::Builder::new_current_thread()
        .max_blocking_threads(COMMAND_THREADS)
        .enable_all()
        .build()
        .map_err(Failure::bad_input)?;
    runtime.block_on(async {
        let bound = Server::bind(&places, handed_over, port).await.map_err(|error| Failure::before_start(&error))?;
        let service = Service::start(places, &robots, &serve).map_err(Failure::bad_input)?;
        let [operate, read] = bound.page_urls().map_err(Failure::bad_input)?;
        if let SettingOrigin::Nearest(file) | SettingOrigin::User(file) = &origin {
            growbot_host::note!("settings of {}", file.display());
        }
        for (name, entry) in &robots {
            growbot_host::note!("robot {name} at {}", entry.port);
        }
        print(&format!("control  {operate}\nview     {read}\n"))?;
        bound.serve(Arc::new(service), &serve).await.map_err(Failure::request_failed)
    })
}

/// Replaces this process by itself, with a setting that glibc reads only at the start. Without the setting, glibc keeps
/// hundreds of MB after plans through a scene of 16 MB, because it raises its limits with the longest block.
fn restart_with_small_heap() {
    if !cfg!(target_env = "gnu") || env::var_os(TRIM_THRESHOLD).is_some() {
        return;
    }
    let mut args = env::args_os();
    let (Some(name), Ok(program)) = (args.next(), env::current_exe()) else { return };
    let error = Command::new(program).arg0(name).args(args).env(TRIM_THRESHOLD, "131072").exec();
    growbot_host::warning!(
        "the service may use more memory than necessary, because it cannot set {TRIM_THRESHOLD}: {error}"
    );
}

/// Returns the settings of a simulated robot for practice, for a user who has configured no robots.
fn practising() -> Result<BTreeMap<String, RobotEntry>, Failure> {
    let robot = settings::log_setting(Key::Robot, Setting::load(Key::Robot)?);
    growbot_host::note!("no robots are configured: {PRACTICE} is a simulated robot, 60 times as fast as real time");
    Ok(practice(&robot))
}
