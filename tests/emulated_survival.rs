//! The firmware's own image grows over bad lines and through interruptions, in QEMU. In each case the layers are those
//! of an undisturbed simulated growth.
//!
//! `GROWBOT_EMULATED_JOBS` is the number of growths over bad lines, by default 10. `GROWBOT_EMULATED_POINTS` is the
//! number of interruptions, by default 5:
//!
//! ```sh
//! GROWBOT_EMULATED_JOBS=100 GROWBOT_EMULATED_POINTS=50 cargo test -p growbot-tests --test it emulated_survival:: -- --nocapture
//! ```

use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use growbot_client::client::Client;
use growbot_client::growth::{CommandQueue, GrowthError, grow_job, resume_job};
use growbot_client::port::faulty::{FaultSpec, FaultyPort};
use growbot_client::stop_signal::Permit;
use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::crash::CrashRecord;
use growbot_core::link::message::{Empty, EnergizingRequest, Fault, HostSilencePolicy, ResetCause, State, Status};
use growbot_core::random::Rng;
use growbot_core::robot::Robot;
use growbot_firmware::emulated_tip as table;
use growbot_plan::growth_report::{GrowthReport, Outcome};
use growbot_plan::job::{Job, JobEvent};
use growbot_plan::robot_file;
use growbot_sim::port::emulator::Emulator;
use growbot_tests::firmware;
use growbot_tests::recovery::crash::{self, Interruption, Recovery};
use growbot_tests::recovery::{Body, CuttablePort, ReferenceGrowth};
use growbot_tests::tip_memory::TipMemoryView;

/// Layers of each job.
const LAYERS: usize = 20;
/// Length of the body, in layers of 0.7 mm.
const LENGTH: u32 = 22;
/// Time of a layer, s.
const PERIOD_S: f64 = 0.3;
/// Number of boards that run at a time. Each takes half of a core.
const BOARDS: usize = 2;

/// The board and its tip, which a test shares with its port.
type Board = Rc<RefCell<Emulator>>;

/// Returns robot A2, whose motors are fast, with faster homing and the widest band of nozzle temperature.
fn robot() -> Robot {
    let mut description = robot_file::load("growbot-a2".as_ref()).unwrap().description().clone();
    description.layer.period_s = PERIOD_S;
    description.head.homing_turns_per_s = 1.0;
    description.heater.band_c = 5.0;
    Robot::new(description).unwrap()
}

/// Returns the number in an environment variable, or `otherwise` if the variable is not set.
fn number(variable: &str, otherwise: u64) -> u64 {
    let Ok(text) = std::env::var(variable) else { return otherwise };
    text.parse().unwrap_or_else(|_| panic!("{variable} is {text:?}: give a whole number"))
}

/// Returns a board whose journal has these contents, or a new one. Its nozzle is warm as soon as it is heated, but not
/// before, because the board erases its journal only with a cold nozzle.
fn board(robot: &Robot, flash: &[u8]) -> Result<Board, String> {
    let mut emulator =
        Emulator::start_with_flash(robot, Some(&firmware("an386")), flash).map_err(|error| error.to_string())?;
    emulator.simulated_tip(|tip| tip.preheat_instantly(198.0));
    Ok(Rc::new(RefCell::new(emulator)))
}

/// Calls a function for each number below `count`, on [`BOARDS`] boards at a time, and prints the results. `work` is
/// called once for each board and returns this function.
fn each<W: FnMut(u64) -> Result<String, String>>(count: u64, work: impl Fn() -> W + Sync) {
    // The tests of this file run one after the other, because four boards are too many.
    static BUSY: Mutex<()> = Mutex::new(());
    let _alone = BUSY.lock().unwrap_or_else(PoisonError::into_inner);
    let (next, wrong) = (AtomicU64::new(0), Mutex::new(Vec::new()));
    thread::scope(|scope| {
        for _ in 0..BOARDS {
            scope.spawn(|| {
                let mut work = work();
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    if number >= count {
                        return;
                    }
                    let began = Instant::now();
                    let came_to = work(number);
                    let seconds = began.elapsed().as_secs_f64();
                    match came_to {
                        Ok(what) => println!("{number}: {what}; {seconds:.0} s"),
                        Err(what) => {
                            println!("{number}: WRONG: {what}; {seconds:.0} s");
                            wrong.lock().unwrap().push(format!("{number}: {what}"));
                        }
                    }
                }
            });
        }
    });
    let wrong = wrong.into_inner().unwrap();
    assert!(wrong.is_empty(), "{} of {count} went wrong:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn each_layer_is_laid_once_over_a_bad_link() {
    let (robot, body) = (robot(), Body::of(LENGTH));
    let job = body.job(&robot);
    assert_eq!(job.layers.len(), LAYERS);
    let undisturbed = ReferenceGrowth::grow(&job);
    each(number("GROWBOT_EMULATED_JOBS", 10), || {
        // Successive jobs run on one board, because its journal has room for them.
        let mut running = None;
        let (job, undisturbed) = (&job, &undisturbed);
        move |seed| {
            let board = running.take().map_or_else(|| board(job.robot, &[]), Ok)?;
            let told = over_a_bad_line(&board, job, undisturbed, seed)?;
            running = Some(board);
            Ok(told)
        }
    });
}

fn over_a_bad_line(board: &Board, job: &Job, undisturbed: &ReferenceGrowth, seed: u64) -> Result<String, String> {
    let mut random = Rng::new(&[1, seed]);
    let (drop, flip) = (random.uniform_between(0.0, 0.1), random.uniform_between(0.0, 1e-3));
    let few = drop / 10.0;
    let spec = FaultSpec { drop, flip, dup: few, reorder: few, truncate: few, seed, ..FaultSpec::default() };
    let wire = Rc::new(RefCell::new(FaultyPort::new(Box::new(Rc::clone(board)), spec)));
    let mut client = Client::new(Box::new(Rc::clone(&wire)), "the emulated board");
    let never = CommandQueue::default();
    let laid_before = board.borrow().tip_handle().laid().map_err(|error| error.to_string())?.body.len();
    let grown = grow_job(&mut client, job, HostSilencePolicy::Pause, &never, &mut |_| ());
    let what = format!("{:.1} % of frames lost, {flip:.1e} of bytes flipped", 100.0 * drop);
    let grown = grown.map_err(|error| format!("{what}: {error}"))?;
    // The tip has recorded each layer that was laid.
    let laid = board.borrow().tip_handle().laid().map_err(|error| format!("{what}: {error}"))?.body.len() - laid_before;
    if (grown.outcome, laid) != (Outcome::Done, LAYERS) || grown.as_built != undisturbed.as_built {
        return Err(format!("{what}: {:?} after {laid} layers, {:?}", grown.outcome, grown.as_built));
    }
    let (tally, repeated) = (wire.borrow().tally(), client.repeated());
    Ok(format!(
        "{what}: {laid} layers, {} frames, of which {} lost, {} bits flipped, {repeated} requests repeated",
        tally.frames, tally.dropped, tally.flipped
    ))
}

#[test]
fn each_layer_is_laid_once_after_any_interruption() {
    let (robot, body) = (robot(), Body::of(LENGTH));
    let job = body.job(&robot);
    let undisturbed = ReferenceGrowth::grow(&job);
    let count = number("GROWBOT_EMULATED_POINTS", 5);
    each(count, || |point| Point::of(point, count).interrupt(&job, &undisturbed));
}

/// Moment and kind of an interruption.
#[derive(Debug)]
struct Point {
    crash: Interruption,
    /// Number of events that the host receives before the interruption: first three changes of the state, then the
    /// laid layers.
    events_seen: u64,
    /// Delay from the last of the [`Self::events_seen`] events to the interruption.
    later: Duration,
}

impl Point {
    /// Returns one of `count` points, spread over the first three quarters of the growth.
    fn of(point: u64, count: u64) -> Self {
        let mut random = Rng::new(&[2, point]);
        let crash = [Interruption::Power, Interruption::Board, Interruption::Host][(point % 3) as usize];
        let share = (point as f64 + random.uniform()) / count as f64;
        Self {
            crash,
            events_seen: 1 + (share * 0.75 * (3 + LAYERS) as f64) as u64,
            later: Duration::from_secs_f64(random.uniform_between(0.0, PERIOD_S)),
        }
    }

    /// Grows up to this point, interrupts the growth, reconnects, and resumes to the end.
    fn interrupt(&self, job: &Job, undisturbed: &ReferenceGrowth) -> Result<String, String> {
        let (Self { crash, events_seen: told, later }, first) = (self, board(job.robot, &[])?);
        let what = format!("{crash:?} {:.2} s after event {told}", later.as_secs_f64());
        let mut known = Vec::new();
        let (broken, flash) = self.grow(job, &first, &mut known);
        match (crash, broken.map(|grown| grown.outcome)) {
            // The first report is either that the board has restarted, or the fault for which it did.
            (Interruption::Board, Ok(Outcome::Interrupted | Outcome::Fault(Fault::StackOverflow))) => {}
            (Interruption::Host | Interruption::Power, Err(_)) => {}
            (_, other) => return Err(format!("{what}: the interrupted growth ended unexpectedly with {other:?}")),
        }
        let second = flash.map(|flash| board(job.robot, &flash)).transpose()?;
        let laid = known.len();
        let (found, grown) = reconnect_and_resume(second.as_ref().unwrap_or(&first), job, known, *crash)
            .map_err(|error| format!("{what}: {error}"))?;
        if grown.outcome != Outcome::Done {
            return Err(format!("{what}: the resumed growth ended with {:?} instead of done", grown.outcome));
        }
        let feed_steps: u64 = [Some(&first), second.as_ref()].into_iter().flatten().map(feed_steps).sum();
        let more_feed_steps = feed_steps as i64 - undisturbed.feed_steps as i64;
        let told = format!(
            "{what}: {laid} layers known to the host, {} laid by the board, interrupted layer {:?}",
            found.layers_laid, found.interrupted
        );
        let recovered = Recovery { found, as_built: grown.as_built, more_feed_steps };
        crash::check(job, undisturbed, *crash, &recovered).map_err(|wrong| format!("{told}: {wrong}"))?;
        Ok(format!(
            "{told}: the resumed body has {} layers, and {more_feed_steps} feed steps were made twice",
            recovered.as_built.len()
        ))
    }

    /// Grows until the interruption. Also returns the flash of a board that loses power.
    fn grow(
        &self,
        job: &Job,
        board: &Board,
        known: &mut Vec<Option<LayerBytes>>,
    ) -> (Result<GrowthReport, GrowthError>, Option<Vec<u8>>) {
        let gone = Rc::new(Cell::new(false));
        let line = CuttablePort { port: Rc::clone(board), cut: Rc::clone(&gone) };
        let mut client = Client::new(Box::new(line), "the emulated board");
        let (mut told, mut flash) = (0, None);
        let mut crashed = None;
        let grown = grow_job(&mut client, job, HostSilencePolicy::Pause, &CommandQueue::default(), &mut |event| {
            match event {
                JobEvent::Laid { as_built, .. } => known.push(*as_built),
                JobEvent::State(_) => {}
                JobEvent::Crash(words) => return crashed = Some(CrashRecord::from(words).cause),
                _ => return,
            }
            told += 1;
            if told == self.events_seen {
                board.borrow().clock().pass(self.later).unwrap();
                match self.crash {
                    Interruption::Power => flash = Some(board.borrow_mut().cut_power().unwrap()),
                    Interruption::Board => reset(board),
                    _ => gone.set(true),
                }
            }
        });
        client.drop_without_goodbye();
        // A board whose firmware crashed reports this after its restart.
        assert_eq!(crashed, (self.crash == Interruption::Board).then_some(ResetCause::StackOverflow));
        (grown, flash)
    }
}

/// Resets a working board by an overflow of its stack.
fn reset(board: &Board) {
    let words = TipMemoryView::of(&mut board.borrow_mut());
    let boots = words.read(table::BOOTS);
    words.write(table::OVERFLOW_STACK, 1);
    words.wait("another boot", |words| words.read(table::BOOTS) != boots);
    words.write(table::OVERFLOW_STACK, 0);
}

fn feed_steps(board: &Board) -> u64 {
    board.borrow().tip_handle().laid().unwrap().feed_steps
}

/// Connects another host, which clears a fault and resumes. Returns the status that it found, and the growth.
fn reconnect_and_resume(
    board: &Board,
    job: &Job,
    known: Vec<Option<LayerBytes>>,
    crash: Interruption,
) -> Result<(Status, GrowthReport), GrowthError> {
    let mut client = Client::new(Box::new(Rc::clone(board)), "the emulated board");
    let hello = client.open_session().map_err(GrowthError::NotStarted)?;
    let cause = if crash == Interruption::Board { ResetCause::StackOverflow } else { ResetCause::PowerOn };
    assert_eq!(hello.reset_cause, cause, "{crash:?}");
    if hello.status.state == State::Fault {
        client
            .energize("to clear the fault", &EnergizingRequest::ClearFault(Empty {}), &Permit::standalone())
            .map_err(GrowthError::NotStarted)?;
    }
    let found = client.status().map_err(GrowthError::NotStarted)?;
    let grown = resume_job(&mut client, job, known, HostSilencePolicy::Pause, &CommandQueue::default(), &mut |_| ())?;
    Ok((found, grown))
}
