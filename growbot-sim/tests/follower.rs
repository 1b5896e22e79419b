//! Growths with disturbances at every frame of the connection. The host must report the true outcome of each growth,
//! and its log must contain every layer that it reports.

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;

use growbot_client::client::Client;
use growbot_client::growth::{CommandQueue, GrowthError, grow_job, resume_job};
use growbot_client::stop_signal::Permit;
use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::message::{HostSilencePolicy, State};
use growbot_core::path::{Segment, end};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_plan::growth_report::{GrowthReport, Outcome};
use growbot_plan::job::{Job, JobEvent};
use growbot_plan::robot_file;
use growbot_sim::port::sim::Sim;

use crate::disturbed::{Board, Disturbance, DisturbedLine, ENDLESS, KILLED};

/// Numbers of layers of the growths.
const LAYERS: [u32; 2] = [3, 37];
/// Policies of the board for a silent host.
const SILENCES: [HostSilencePolicy; 2] = [HostSilencePolicy::Pause, HostSilencePolicy::Continue];
/// Time limit of a growth, far beyond all timeouts of the host.
const LIMIT: Duration = Duration::from_secs(1200);

/// Returns robot A with faster homing and growth.
fn robot() -> Robot {
    let mut description = robot_file::load("growbot-a".as_ref()).unwrap().description().clone();
    description.layer.period_s = 4.0;
    description.head.homing_turns_per_s = 0.2;
    Robot::new(description).unwrap()
}

/// A growth that is repeated with disturbances.
struct Subject<'a> {
    job: Job<'a>,
    silence: HostSilencePolicy,
    /// The layers as built when the growth is not disturbed.
    as_built: Vec<Option<LayerBytes>>,
    /// Number of feed steps when the growth is not disturbed.
    feed_steps: u64,
    /// Number of link frames that are exchanged when the growth is not disturbed.
    frames: usize,
}

/// Result of a growth with disturbances.
struct Attempt {
    board: Board,
    grown: Result<GrowthReport, GrowthError>,
    /// The layers in the log, in the order of their events.
    logged: Vec<(u32, Option<LayerBytes>)>,
    frames: usize,
}

/// Grows with disturbances at these frames.
fn attempt(job: &Job, silence: HostSilencePolicy, disturbances: &[(usize, Disturbance)]) -> Attempt {
    let board: Board = Rc::new(RefCell::new(Sim::new(job.robot.clone())));
    // Frames while the nozzle heats up are alike, and would be most of all.
    board.borrow_mut().simulated_tip().preheat_instantly(job.robot.description().heater.target_c);
    let line = DisturbedLine::new(&board, job.plan_id, silence, disturbances, LIMIT);
    let line = Rc::new(RefCell::new(line));
    let mut client = Client::new(Box::new(Rc::clone(&line)), "sim");
    let mut logged = Vec::new();
    let grown = grow_job(&mut client, job, silence, &CommandQueue::default(), &mut |event| {
        if let JobEvent::Laid { index, as_built, .. } = event {
            logged.push((*index, *as_built));
        }
    });
    client.drop_without_goodbye();
    let frames = line.borrow().frames();
    Attempt { board, grown, logged, frames }
}

/// Calls `act` with every growth that is repeated with disturbances.
fn for_each_subject(mut act: impl FnMut(&Subject)) {
    let robot = robot();
    for layers in LAYERS {
        let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
        let length = 0.774 * f64::from(layers);
        let path = [Segment::Arc { alpha: 1.0, bend: length / 120.0, length }];
        let goal = Pose::from_frame(&end(&path, &start.frame()));
        for silence in SILENCES {
            let job = Job::new(&robot, &start, &goal, &path);
            let Attempt { board, grown, frames, .. } = attempt(&job, silence, &[]);
            let grown = grown.unwrap();
            assert_eq!((grown.outcome, grown.as_built.len()), (Outcome::Done, layers as usize));
            let feed_steps = board.borrow_mut().simulated_tip().feed_steps();
            act(&Subject { job, silence, as_built: grown.as_built, feed_steps, frames });
        }
    }
}

impl Subject<'_> {
    /// Grows with disturbances at these frames, and checks the outcome, the log and the continuation by another host.
    /// Returns the number of frames.
    fn check(&self, disturbances: &[(usize, Disturbance)]) -> Result<usize, String> {
        let attempt = attempt(&self.job, self.silence, disturbances);
        let frames = attempt.frames;
        let has = |is: fn(Disturbance) -> bool| disturbances.iter().any(|(_, disturbance)| is(*disturbance));
        self.check_log(&attempt)?;
        let outcome = match &attempt.grown {
            Ok(grown) => Some(grown.outcome),
            Err(error) => {
                let answer = error.to_string();
                let killed = answer.contains(KILLED);
                let early = matches!(error, GrowthError::NotStarted(_));
                if answer.contains(ENDLESS)
                    || !killed && (!early || disturbances.iter().all(|(_, one)| one.is_of_line()))
                {
                    return Err(answer);
                }
                let state = attempt.board.borrow().state();
                let is_at_rest = matches!(state, State::Idle | State::Stopped | State::Fault | State::SelfTest);
                let other_started = has(|one| one == Disturbance::OtherRestarts);
                if early && !killed && !is_at_rest && !other_started {
                    return Err(format!("it has not started, but the board is {}", state.name()));
                }
                None
            }
        };
        match outcome {
            Some(Outcome::Done) if attempt.logged.len() < self.as_built.len() => {
                return Err(format!("done with {} of {} layers", attempt.logged.len(), self.as_built.len()));
            }
            None | Some(Outcome::Done) => {}
            Some(outcome) if disturbances.iter().all(|(_, one)| one.is_reset()) => {
                if attempt.logged.len() == self.as_built.len() {
                    return Err(format!("{outcome:?} with all layers in the log"));
                }
                let is_fault = attempt.board.borrow().state() == State::Fault;
                // A loss of power may make the board forget the fault of the reset before it.
                let forgets = disturbances.len() > 1 && has(|one| one == Disturbance::PowerLoss);
                let is_reported = matches!(outcome, Outcome::Fault(_));
                if is_fault != is_reported && !(is_reported && forgets) {
                    return Err(format!("{outcome:?}, but the board is {}", attempt.board.borrow().state().name()));
                }
            }
            Some(Outcome::Stopped) if has(Disturbance::is_stop) => {}
            // Half a frame takes the greeting of the other host with it, and of its requests only the stop is served.
            Some(Outcome::Stopped)
                if has(|one| one == Disturbance::Cut) && has(|one| one == Disturbance::OtherRestarts) => {}
            Some(Outcome::Interrupted) if has(|one| one.is_reset() || one.is_stop()) => {}
            // A host waits for the end of one silent owner, and gives up if another host takes the board meanwhile.
            Some(Outcome::Interrupted)
                if has(|one| one == Disturbance::OtherFallsSilent)
                    && disturbances.iter().filter(|(_, one)| one.is_other_host()).count() > 1 => {}
            Some(Outcome::Fault(_)) if has(Disturbance::is_reset) => {}
            Some(outcome) => return Err(format!("ended as {outcome:?}")),
        }
        // A loss of power makes the board forget the sessions that were closed, and it takes their delayed frames for
        // those of a new host (PROTOCOL.md, rule 11). Here these frames cancel the body.
        let power_loss = disturbances.iter().find(|(_, one)| *one == Disturbance::PowerLoss);
        let is_cancelled = power_loss.is_some_and(|(lost, _)| {
            disturbances.iter().any(|(frame, one)| *one == Disturbance::OldSession && frame >= lost)
        });
        if !is_cancelled {
            self.check_continuation(power_loss.is_some(), attempt)?;
        }
        Ok(frames)
    }

    /// Checks that the log contains the layers in their order, and each layer as it is built without a disturbance.
    fn check_log(&self, Attempt { grown, logged, .. }: &Attempt) -> Result<(), String> {
        for (at, (index, as_built)) in logged.iter().enumerate() {
            if *index as usize != at || self.as_built.get(at) != Some(as_built) {
                return Err(format!("event {at} of the log is layer {index}, which is another one"));
            }
        }
        match grown {
            Ok(grown) if grown.as_built.len() != logged.len() => Err("the result is not the log".to_string()),
            _ => Ok(()),
        }
    }

    /// Lets another host continue the growth from the log, and checks that the body is completed.
    fn check_continuation(&self, power_was_lost: bool, Attempt { board, logged, .. }: Attempt) -> Result<(), String> {
        let known: Vec<_> = logged.into_iter().map(|(_, as_built)| as_built).collect();
        let mut client = Client::new(Box::new(Rc::clone(&board)), "sim").with_take_over();
        let hello = client.open_session().map_err(|error| error.to_string())?;
        if matches!(hello.status.state, State::Fault) {
            client.clear_fault(&Permit::standalone()).map_err(|error| error.to_string())?;
        }
        let (orders, on_event) = (CommandQueue::default(), &mut |_: &JobEvent| {});
        let is_known = hello.status.plan_id == self.job.plan_id;
        if is_known {
            let grown = resume_job(&mut client, &self.job, known, self.silence, &orders, on_event)
                .map_err(|error| format!("resumed: {error}"))?;
            if (grown.outcome, &grown.as_built) != (Outcome::Done, &self.as_built) {
                return Err(format!("resumed: {:?} with {} layers", grown.outcome, grown.as_built.len()));
            }
        }
        // The board forgets a job that is done, and has none before it has begun one.
        let feed_steps = board.borrow_mut().simulated_tip().feed_steps();
        let is_untouched = feed_steps == 0;
        let more = feed_steps as f64 - self.feed_steps as f64;
        // A board that loses its power in a pause before the first layer, or before an interrupted layer is repeated,
        // does not know that it has pulled filament back.
        let feed = &self.job.robot.description().feed;
        let missing = if power_was_lost { (feed.retract_mm * feed.steps_per_mm).ceil() } else { 0.0 };
        let layer = 2.0 * 0.774 * self.job.robot.feed_steps_per_length();
        if !is_untouched && !(-missing..layer).contains(&more) {
            return Err(format!("{more} feed steps more than without a disturbance"));
        }
        Ok(())
    }
}

/// Returns the number in an environment variable, or `usual` if it is not set.
fn number(variable: &str, usual: usize) -> usize {
    std::env::var(variable).map_or(usual, |text| text.parse().expect("it is a number"))
}

/// Checks growths with these disturbances on all cores. Returns the error messages of those that are wrong.
fn check_all(subject: &Subject, cases: &[Vec<(usize, Disturbance)>]) -> Vec<String> {
    let (next, wrong) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    thread::scope(|scope| {
        for _ in 0..thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                while let Some(case) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if let Err(error) = subject.check(case) {
                        let (layers, silence) = (subject.as_built.len(), subject.silence);
                        wrong.lock().unwrap().push(format!("{layers} layers, {silence:?}, {case:?}: {error}"));
                    }
                }
            });
        }
    });
    wrong.into_inner().unwrap()
}

fn assert_none_wrong(checked: usize, wrong: &[String]) {
    println!("{checked} disturbed growths, {} of them wrong", wrong.len());
    assert!(wrong.is_empty(), "{} of {checked} are wrong:\n{}", wrong.len(), wrong.join("\n"));
}

/// Tests every disturbance at every frame of 3 layers. In 37 layers most frames are alike, so only some of them are
/// tested unless `GROWBOT_FRAME_STEP` is 1.
#[test]
fn each_growth_with_a_disturbance_has_a_true_end_and_log() {
    let (mut checked, mut wrong) = (0, Vec::new());
    for_each_subject(|subject| {
        let step = if subject.as_built.len() == 3 { 1 } else { number("GROWBOT_FRAME_STEP", 23) };
        let frames = (0..subject.frames).step_by(step);
        let at = |frame| Disturbance::ALL.map(|disturbance| vec![(frame, disturbance)]);
        let cases: Vec<_> = frames.flat_map(at).collect();
        wrong.extend(check_all(subject, &cases));
        checked += cases.len();
    });
    assert_none_wrong(checked, &wrong);
}

/// Tests growths of 3 layers that lose a frame just when another host takes the board over, so that the host learns
/// only from the board's status whether its request was accepted.
#[test]
fn each_growth_that_loses_a_frame_to_another_host_has_a_true_end_and_log() {
    let (mut checked, mut wrong) = (0, Vec::new());
    for_each_subject(|subject| {
        if subject.as_built.len() == 3 {
            let lost = |frame| vec![(frame, Disturbance::Lost), (frame, Disturbance::OtherLeaves)];
            let cases: Vec<_> = (0..subject.frames).map(lost).collect();
            wrong.extend(check_all(subject, &cases));
            checked += cases.len();
        }
    });
    assert_none_wrong(checked, &wrong);
}

/// Tests pairs of disturbances at frames of 3 layers. All pairs are tested if `GROWBOT_PAIR_STEP` is 1.
#[test]
fn each_growth_with_two_disturbances_has_a_true_end_and_log() {
    let step = number("GROWBOT_PAIR_STEP", 24_001);
    let (mut checked, mut wrong) = (0, Vec::new());
    for_each_subject(|subject| {
        if subject.as_built.len() > 3 {
            return;
        }
        let singles = (0..subject.frames).flat_map(|frame| Disturbance::ALL.map(|disturbance| (frame, disturbance)));
        let singles: Vec<_> = singles.collect();
        for first in 0..singles.len() {
            // The usual step is a prime, so it meets all combinations of disturbances.
            let pairs = (first..singles.len()).filter(|second| (first * singles.len() + second) % step == 0);
            let cases: Vec<_> = pairs.map(|second| vec![singles[first], singles[second]]).collect();
            wrong.extend(check_all(subject, &cases));
            checked += cases.len();
        }
    });
    assert_none_wrong(checked, &wrong);
}
