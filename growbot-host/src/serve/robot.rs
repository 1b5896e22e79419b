//! One robot of the service: a thread owns its board, and finds it again when its port comes back.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use growbot_client::client::{Client, ClientError};
use growbot_client::growth::{Order, Orders};
use growbot_client::maintenance::Presets;
use growbot_client::plan::Plan;
use growbot_client::robot_file;
use growbot_core::link::message::{BoardInfo, Cancel, Fault, MaintenanceTask, Message, PauseCause, State, Status};
use growbot_core::robot::Robot;
use growbot_scene::scene_file::LoadedScene;
use growbot_sim::port::{self, Opened, PortName, TipSettings};
use growbot_sim::resident::Place;
use growbot_sim::truth::Simulation;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Shared;
use super::config::RobotEntry;
use super::jobs::{Job, JobState};
use super::lending::Loan;
use super::notices::{About, Condition};
use crate::switch::switch_on;
use crate::watch::Live;

/// A port that is not there is looked for again after this.
const RETRY: Duration = Duration::from_secs(1);
/// A robot without a job is asked for its status so often, and what is asked of it waits no longer.
const LOOK: Duration = Duration::from_millis(100);

/// What a robot does, in a word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum RobotState {
    /// Its port is not there, or its board does not answer.
    Disconnected,
    /// Its board waits for orders.
    Ready,
    /// It has a job.
    Busy,
}

/// A robot as the service knows it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RobotView {
    /// What the service calls it.
    pub name: String,
    /// Its port.
    pub port: String,
    /// Whether it is a simulated one.
    pub simulated: bool,
    /// How fast its time passes, in multiples of real time; null where that is not known.
    pub pace: Option<f64>,
    /// What it does.
    pub state: RobotState,
    /// What is wrong; null where nothing is.
    pub trouble: Option<String>,
    /// The name of its description; null until its board was met.
    pub robot: Option<String>,
    /// Its board's state.
    pub board: Option<String>,
    /// Code of the fault that is latched; null if there is none.
    pub fault: Option<String>,
    /// What the fault means.
    pub fault_explanation: Option<String>,
    /// Why it pauses.
    pub pause: Option<String>,
    /// Temperature of the nozzle, C; null without a reading.
    pub temperature_c: Option<f64>,
    /// What the temperature is regulated to, C; null while the heater is off.
    pub target_c: Option<f64>,
    /// Layers laid of the job that the board stores.
    pub laid: u32,
    /// Layers of that job.
    pub layers: u32,
    /// The job that is under way.
    pub job: Option<String>,
    /// When the last layer is expected, RFC 3339; null unless the robot grows, at a known pace.
    pub finish_utc: Option<String>,
    /// Why the board has refused the latest order; null unless it has.
    pub refused: Option<String>,
}

/// A job that is to be grown.
pub struct NewJob {
    pub job: Job,
    pub plan: Plan,
    pub robot: Robot,
    /// What corrections are kept clear of.
    pub scene: Option<LoadedScene>,
    pub feedback: bool,
}

/// What is asked of a robot.
pub enum Ask {
    Grow(Box<NewJob>),
    Resume(Box<Job>),
    Cancel,
    Stop,
    EmergencyStop,
    ClearFault,
    Task(MaintenanceTask),
    /// Give the line up, until it is back.
    Lend(Loan),
}

/// A question, and who waits for the answer.
pub struct Asked {
    pub ask: Ask,
    pub reply: Sender<Result<(), String>>,
    /// Whether the robot has taken it on, or who asked has given it up: whichever was first.
    settled: Arc<AtomicBool>,
}

impl Asked {
    /// Takes it on, unless it was given up. An emergency stop is never too late.
    fn take(&self) -> bool {
        let is_given_up = self.settled.swap(true, Ordering::AcqRel);
        !is_given_up || matches!(self.ask, Ask::EmergencyStop)
    }

    pub(super) fn answer(self, answer: Result<(), String>) {
        // Who asked may have gone.
        let _ = self.reply.send(answer);
    }
}

/// One robot, with its thread.
pub struct Keeper {
    pub(super) name: String,
    pub(super) entry: RobotEntry,
    pub(super) shared: Arc<Shared>,
    known: Mutex<Known>,
    asks: Sender<Asked>,
    /// What was told of it last, as far as this process knows.
    told: Mutex<Option<Condition>>,
    /// Held from the look whether it has a job to the beginning of another.
    beginning: Mutex<()>,
}

/// What is known of a robot.
#[derive(Default)]
pub struct Known {
    pub trouble: Option<String>,
    /// Its description, once its board was met.
    pub robot: Option<Robot>,
    pub status: Option<Status>,
    pub job: Option<String>,
    /// Who can give orders to the growth under way.
    pub orders: Option<Arc<Orders>>,
    /// What pages are told of it.
    pub live: Option<Arc<Live>>,
    pub finish_utc: Option<String>,
    pub refused: Option<String>,
    /// A stop was ordered that the board may not have heard of when its line was lost.
    pub stop_when_back: bool,
}

/// A board that was met.
pub struct Connection {
    pub client: Client,
    pub simulation: Option<Box<dyn Simulation>>,
    pub robot: Robot,
    pub hello: BoardInfo,
}

/// What a board leaves its keeper with.
pub enum Left {
    /// It waits for orders.
    Ready,
    /// The line has broken, or the board is silent: why.
    Lost(String),
    /// The line is to be lent; who waits for it.
    Lent(Loan, Sender<Result<(), String>>),
}

impl Keeper {
    /// Has a thread own a robot.
    pub(super) fn start(name: &str, entry: &RobotEntry, shared: Arc<Shared>) -> Arc<Self> {
        let (asks, asked) = mpsc::channel();
        let known = Mutex::new(Known { trouble: Some("it is looked for".to_owned()), ..Known::default() });
        let keeper = Arc::new(Self {
            name: name.to_owned(),
            entry: entry.clone(),
            shared,
            known,
            asks,
            told: Mutex::default(),
            beginning: Mutex::default(),
        });
        let own = Arc::clone(&keeper);
        let spawned = thread::Builder::new().name(format!("robot {name}")).spawn(move || own.keep(&asked));
        if let Err(error) = spawned {
            keeper.know(|known| known.trouble = Some(format!("the system gives it no thread: {error}")));
        }
        keeper
    }

    fn known(&self) -> MutexGuard<'_, Known> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes what is known, and has all who listen look.
    pub(super) fn know(&self, change: impl FnOnce(&mut Known)) {
        change(&mut self.known());
        self.shared.changed();
    }

    /// Its board has said how it is.
    pub(super) fn met(&self, status: Status) {
        let condition = Condition::of(&status);
        self.know(|known| known.status = Some(status));
        let mut told = self.told.lock().unwrap_or_else(PoisonError::into_inner);
        if told.as_ref() != Some(&condition) {
            self.about(|about| self.shared.tell_condition(about, &condition));
            *told = Some(condition);
        }
    }

    /// What is to be said of it in a notice.
    pub(super) fn about(&self, tell: impl FnOnce(&About)) {
        let view = self.view();
        tell(&About {
            robot: &self.name,
            simulated: view.simulated,
            job: view.job.as_deref(),
            laid: view.laid,
            layers: view.layers,
        });
    }

    pub(super) fn port(&self) -> Result<PortName, String> {
        self.entry.port.parse().map_err(|error: port::OpenError| error.to_string())
    }

    /// Whether it is a simulated robot.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        self.port().is_ok_and(|port| port.is_simulated())
    }

    /// How fast its time passes, in multiples of real time.
    pub(super) fn pace(&self) -> Option<f64> {
        match self.port().ok()? {
            PortName::Resident(name) => Place::of(&name).ok()?.pace(),
            port if port.is_virtual() => None,
            _ => Some(1.0),
        }
    }

    /// The robot as it is known now.
    #[must_use]
    pub fn view(&self) -> RobotView {
        let (simulated, pace) = (self.is_simulated(), self.pace());
        let known = self.known();
        let status = known.status.as_ref().filter(|_| known.trouble.is_none());
        let celsius = |centi: i32| f64::from(centi) / 100.0;
        let fault = status.and_then(|status| status.fault);
        let pauses = |status: &&Status| matches!(status.state, State::Paused | State::Parked);
        RobotView {
            name: self.name.clone(),
            port: self.entry.port.clone(),
            simulated,
            pace,
            state: match (&known.trouble, &known.job) {
                (Some(_), _) => RobotState::Disconnected,
                (None, Some(_)) => RobotState::Busy,
                (None, None) => RobotState::Ready,
            },
            trouble: known.trouble.clone(),
            robot: known.robot.as_ref().map(|robot| robot.name().to_owned()),
            board: status.map(|status| status.state.name().to_owned()),
            fault: fault.map(|fault| Fault::code(fault).to_owned()),
            fault_explanation: fault.map(|fault| fault.explanation().to_owned()),
            pause: status.filter(pauses).map(|status| pause(status.pause_cause).to_owned()),
            temperature_c: status.and_then(|status| status.temperature_centi_c).map(celsius),
            target_c: status.and_then(|status| status.target_centi_c).map(celsius),
            laid: status.map_or(0, |status| status.layers_laid),
            layers: status.map_or(0, |status| status.layer_count),
            job: known.job.clone(),
            finish_utc: known.finish_utc.clone(),
            refused: known.refused.clone(),
        }
    }

    /// The description of its robot: that of its board, or else the configured one.
    pub fn description(&self) -> Result<Robot, String> {
        if let Some(robot) = &self.known().robot {
            return Ok(robot.clone());
        }
        let robot = self.entry.robot.as_deref().unwrap_or(robot_file::DEFAULT);
        robot_file::load(robot.as_ref()).map_err(|error| error.to_string())
    }

    /// The presets of its materials.
    pub fn presets(&self) -> Presets {
        let robot = self.entry.robot.as_deref().unwrap_or(robot_file::DEFAULT);
        Presets::load(robot.as_ref()).unwrap_or_default()
    }

    /// The growth under way, if it is this job's.
    pub fn live(&self, job: &str) -> Option<Arc<Live>> {
        let known = self.known();
        known.live.clone().filter(|_| known.job.as_deref() == Some(job))
    }

    /// Gives an order to the growth under way; none is, where this gives false.
    pub fn order(&self, order: Order) -> bool {
        let known = self.known();
        known.orders.as_ref().map(|orders| orders.give(order)).is_some()
    }

    /// Its holder begins a job, and nobody else does.
    pub(super) fn begins(&self) -> MutexGuard<'_, ()> {
        self.beginning.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Refuses what cannot be begun beside the job that is under way. One that has just ended may still be known here.
    pub(super) fn has_no_job(&self) -> Result<(), String> {
        let job = self.known().job.clone();
        let is_active = |id: &String| {
            let job = self.shared.jobs_to_read().get(id);
            job.is_ok_and(|job| job.is_some_and(|job| job.state == JobState::Active))
        };
        job.filter(is_active)
            .map_or(Ok(()), |job| Err(format!("robot {} has a job, {job}: wait for its end, or stop it", self.name)))
    }

    /// Asks something of the robot, and waits for the answer.
    ///
    /// # Errors
    /// Why it was refused.
    pub fn ask(&self, ask: Ask, limit: Duration) -> Result<(), String> {
        let (reply, answer) = mpsc::channel();
        let settled = Arc::new(AtomicBool::new(false));
        let asked = Asked { ask, reply, settled: Arc::clone(&settled) };
        self.asks.send(asked).map_err(|_| "its thread has ended: restart the service".to_owned())?;
        answer.recv_timeout(limit).unwrap_or_else(|_| {
            let (robot, limit) = (&self.name, limit.as_secs_f64());
            // It would come unexpectedly later, when the robot has ended what it does.
            Err(match settled.swap(true, Ordering::AcqRel) {
                false => format!("robot {robot} has not taken it on for {limit:.0} s, and it was given up: try again"),
                true => {
                    format!("robot {robot} has taken it on, and not ended it within {limit:.0} s: look at its state")
                }
            })
        })
    }

    /// Owns the robot, for ever.
    fn keep(self: Arc<Self>, asked: &Receiver<Asked>) {
        let mut switches_on = true;
        loop {
            let left = match self.connect(switches_on) {
                Ok(connection) => self.own(connection, asked),
                Err(why) => Left::Lost(why),
            };
            let why = match left {
                Left::Ready => continue,
                Left::Lost(why) => why,
                Left::Lent(loan, reply) => {
                    // The line is closed now. Who waits for it may have gone.
                    let _ = reply.send(Ok(()));
                    self.wait_for_line(&loan, asked);
                    continue;
                }
            };
            // Who switches it off later wants it off.
            switches_on = false;
            self.know(|known| {
                (known.orders, known.live, known.finish_utc) = (None, None, None);
                known.trouble = Some(why.clone());
            });
            let until = Instant::now() + RETRY;
            while let Ok(asked) = asked.recv_timeout(until.saturating_duration_since(Instant::now())) {
                asked.answer(Err(format!("robot {} is not connected: {why}", self.name)));
            }
        }
    }

    fn connect(&self, switches_on: bool) -> Result<Connection, String> {
        let name = self.port()?;
        let configured = self.entry.robot.as_ref().map(PathBuf::from);
        let mut robot = match &configured {
            Some(robot) => Some(robot_file::load(robot).map_err(|error| error.to_string())?),
            None => None,
        };
        if let PortName::Resident(name) = &name {
            let place = Place::of(name).map_err(|error| error.to_string())?;
            if switches_on && !place.is_on() {
                let pace = self.entry.pace.unwrap_or(1.0);
                switch_on(&place, configured.as_deref(), pace).map_err(|error| error.to_string())?;
            }
            robot = place.robot().map_err(|error| error.to_string())?.or(robot);
        }
        let robot = match robot {
            Some(robot) => Some(robot),
            None if name.is_simulated() => {
                Some(robot_file::load(robot_file::DEFAULT.as_ref()).map_err(|e| e.to_string())?)
            }
            None => None,
        };
        // On a line, which robot it is, the board says.
        let any = robot_file::load(robot_file::DEFAULT.as_ref()).map_err(|error| error.to_string())?;
        let settings = TipSettings::default();
        let opened = port::open(&name, robot.as_ref().unwrap_or(&any), &settings).map_err(|error| error.to_string())?;
        let Opened { port, simulation } = opened;
        let mut client = Client::new(port, &self.entry.port);
        let hello = client.board().map_err(|error| error.to_string())?;
        let robot = match robot {
            Some(robot) => robot,
            None => robot_file::load(hello.robot_name.as_str().as_ref())
                .map_err(|_| format!("its board is {}, which is not built in: say `robot` of it", hello.robot_name))?,
        };
        let hello = client.hello_robot(&robot).map_err(|error| error.to_string())?;
        Ok(Connection { client, simulation, robot, hello })
    }

    /// Looks after a board until its line is lost or to be lent.
    fn own(&self, mut connection: Connection, asked: &Receiver<Asked>) -> Left {
        let active = self.shared.jobs().active(&self.name).ok().flatten();
        self.know(|known| {
            known.trouble = None;
            known.robot = Some(connection.robot.clone());
            known.job = active.as_ref().map(|job| job.id.clone());
        });
        self.met(connection.hello.status.clone());
        if let Some(job) = active {
            let stops = self.known().stop_when_back;
            let left = match stops {
                true => self.stop_as_ordered(&mut connection, &job),
                false => self.take_up(&mut connection, &job),
            };
            if matches!(left, Left::Lost(_)) {
                return left;
            }
        }
        loop {
            let done = match asked.try_recv() {
                Ok(asked) if asked.take() => self.answer(&mut connection, asked),
                Ok(_) => Left::Ready,
                Err(_) => self.look(&mut connection.client),
            };
            if !matches!(done, Left::Ready) {
                return done;
            }
        }
    }

    /// Looks how a board without a job is.
    fn look(&self, client: &mut Client) -> Left {
        let wait = LOOK.mul_f64(self.pace().unwrap_or(1.0).max(1.0));
        let looked = client.event(wait).and_then(|_| client.status());
        match looked {
            Ok(status) => {
                let is_new = self.known().status.as_ref() != Some(&status);
                if is_new {
                    self.met(status);
                }
                Left::Ready
            }
            Err(error) => Left::Lost(error.to_string()),
        }
    }

    fn answer(&self, connection: &mut Connection, asked: Asked) -> Left {
        let client = &mut connection.client;
        let done = match asked.ask {
            Ask::Grow(new) => return self.begin(connection, *new, asked.reply),
            Ask::Resume(job) => return self.resume(connection, &job, asked.reply),
            Ask::Lend(loan) => return Left::Lent(loan, asked.reply),
            Ask::Cancel => client.status().and_then(|status| {
                let cancel = Message::Cancel(Cancel { plan_id: status.plan_id });
                client.request("to give the body up", &cancel).map(drop)
            }),
            Ask::Stop => client.stop().map(drop),
            Ask::EmergencyStop => client.emergency_stop(),
            Ask::ClearFault => client.clear_fault(),
            Ask::Task(task) => client.maintain(task),
        };
        let left = match &done {
            Err(error @ (ClientError::Port(_) | ClientError::Silent { .. })) => Left::Lost(error.to_string()),
            _ => Left::Ready,
        };
        let _ = asked.reply.send(done.map_err(|error| error.to_string()));
        left
    }
}

/// Why it pauses, in words.
pub(super) fn pause(cause: PauseCause) -> &'static str {
    match cause {
        PauseCause::LayersExhausted => "it waits for layers",
        PauseCause::Requested => "as asked",
        PauseCause::FilamentOut => "the filament has run out: load a spool, and continue",
        PauseCause::HostSilent => "nobody was there to look after it",
    }
}
