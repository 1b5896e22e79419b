//! Interruptions of a growth by loss of the host, the cable, the board or its power. A host then resumes the growth.

use std::cell::Cell;
use std::rc::Rc;
use std::time::Duration;

use growbot_client::client::Client;
use growbot_client::growth::{CommandQueue, GrowthError, grow_job, resume_job};
use growbot_client::stop_signal::Permit;
use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::message::{HostSilencePolicy, ResetCause, State, Status};
use growbot_plan::growth_report::{GrowthReport, Outcome};
use growbot_plan::job::{Job, JobEvent};

use super::{Board, CuttablePort, ReferenceGrowth, late_board};

/// Kind of interruption.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interruption {
    /// The host's program is killed and restarts at once.
    Host,
    /// The cable is pulled and put back after a minute. The board has paused long before.
    Cable,
    /// The board is reset. Its RAM keeps its contents.
    Board,
    /// The board loses power.
    Power,
    /// The board is reset in the middle of the next layer.
    BoardInLayer,
    /// The board loses power in the middle of the next layer.
    PowerInLayer,
}

impl Interruption {
    /// All kinds of interruption.
    pub const ALL: [Self; 6] =
        [Self::Host, Self::Cable, Self::Board, Self::Power, Self::BoardInLayer, Self::PowerInLayer];
}

/// Result of a resumed growth.
#[derive(Debug, Clone, PartialEq)]
pub struct Recovery {
    /// Status of the board when a host reconnected.
    pub found: Status,
    /// Layers as built, at the end.
    pub as_built: Vec<Option<LayerBytes>>,
    /// Number of feed steps in excess of an undisturbed growth. They come from the interrupted layer, a part of which
    /// is laid twice.
    pub more_feed_steps: i64,
}

/// Grows until the host has received `event` events, interrupts the growth, and resumes.
///
/// # Errors
/// Returns a message that describes the failure.
pub fn crash_at(
    job: &Job,
    undisturbed: &ReferenceGrowth,
    crash: Interruption,
    event: usize,
) -> Result<Recovery, String> {
    let board = late_board(job, event as u64);
    let mut known = Vec::new();
    let broken = grow_until(job, &board, crash, event, &mut known);
    if let Ok(GrowthReport { outcome: Outcome::Done, .. }) = &broken {
        return Err("the growth was done before the interruption".to_string());
    }
    if crash == Interruption::Cable {
        board.borrow_mut().run_for(Duration::from_secs(60));
    }
    let (found, grown) = reconnect_and_resume(job, &board, known).map_err(|error| error.to_string())?;
    if grown.outcome != Outcome::Done {
        return Err(format!("the resumed growth ended with {:?} instead of done", grown.outcome));
    }
    let feed_steps = board.borrow_mut().simulated_tip().feed_steps();
    let more_feed_steps = feed_steps as i64 - undisturbed.feed_steps as i64;
    Ok(Recovery { found, as_built: grown.as_built, more_feed_steps })
}

/// Grows until the interruption.
fn grow_until(
    job: &Job,
    board: &Board,
    crash: Interruption,
    event: usize,
    known: &mut Vec<Option<LayerBytes>>,
) -> Result<GrowthReport, GrowthError> {
    let cut = Rc::new(Cell::new(false));
    let line = CuttablePort { port: Rc::clone(board), cut: Rc::clone(&cut) };
    let mut client = Client::new(Box::new(line), "sim");
    let mut told = 0;
    let grown = grow_job(&mut client, job, HostSilencePolicy::Pause, &CommandQueue::default(), &mut |happened| {
        if cut.get() {
            return;
        }
        if let JobEvent::Laid { as_built, .. } = happened {
            known.push(*as_built);
        }
        told += 1;
        if told == event {
            let in_layer = Duration::from_secs_f64(0.4 * job.robot.description().layer.period_s);
            let mut sim = board.borrow_mut();
            match crash {
                Interruption::Host | Interruption::Cable => {}
                Interruption::Board => sim.reset(ResetCause::Watchdog),
                Interruption::Power => sim.reset(ResetCause::PowerOn),
                Interruption::BoardInLayer => {
                    sim.run_for(in_layer);
                    sim.reset(ResetCause::Watchdog);
                }
                Interruption::PowerInLayer => {
                    sim.run_for(in_layer);
                    sim.reset(ResetCause::PowerOn);
                }
            }
            // From here on, nothing that the host sends reaches the board.
            cut.set(true);
        }
    });
    client.drop_without_goodbye();
    grown
}

/// Connects another host, which clears a fault and resumes. Returns the status that it found, and the growth.
fn reconnect_and_resume(
    job: &Job,
    board: &Board,
    known: Vec<Option<LayerBytes>>,
) -> Result<(Status, GrowthReport), GrowthError> {
    let mut client = Client::new(Box::new(Rc::clone(board)), "sim");
    let hello = client.open_session().map_err(GrowthError::NotStarted)?;
    if hello.status.state == State::Fault {
        client.clear_fault(&Permit::standalone()).map_err(GrowthError::NotStarted)?;
    }
    let found = client.status().map_err(GrowthError::NotStarted)?;
    let (stop, on_event) = (CommandQueue::default(), &mut |_: &JobEvent| {});
    let grown = if found.plan_id == job.plan_id {
        resume_job(&mut client, job, known, HostSilencePolicy::Pause, &stop, on_event)
    } else {
        // The board has not begun a job, so the growth starts from the beginning.
        grow_job(&mut client, job, HostSilencePolicy::Pause, &stop, on_event)
    };
    Ok((found, grown?))
}

/// Checks that every layer was laid once and equals that of the undisturbed growth, and that an interrupted layer was
/// reported.
///
/// # Errors
/// Returns a message that describes the first difference.
pub fn check(
    job: &Job,
    undisturbed: &ReferenceGrowth,
    crash: Interruption,
    recovered: &Recovery,
) -> Result<(), String> {
    if recovered.as_built != undisturbed.as_built {
        let other = recovered.as_built.iter().zip(&undisturbed.as_built).position(|(one, other)| one != other);
        return Err(format!(
            "layer {other:?} of {} differs from that of the undisturbed growth",
            recovered.as_built.len()
        ));
    }
    let layer = 0.8 * job.robot.feed_steps_per_length();
    let more = recovered.more_feed_steps as f64;
    match recovered.found.interrupted {
        None if more != 0.0 => {
            Err(format!("the growth made {more} feed steps too many, although no layer was interrupted"))
        }
        Some(_) if !(0.0..layer).contains(&more) => {
            Err(format!("the growth made {more} feed steps too many, more than the layer that was interrupted has"))
        }
        Some(cut) => {
            let share = more / layer;
            let (min, max) = (f64::from(cut.min) / 64.0, f64::from(cut.max) / 64.0);
            let in_layer = matches!(crash, Interruption::BoardInLayer | Interruption::PowerInLayer);
            if in_layer && crash == Interruption::BoardInLayer && max - min > 0.3 {
                return Err(format!(
                    "the board's report of the made part of the interrupted layer is too inaccurate: {min} to {max} of \
                     the layer"
                ));
            }
            // No layer is thinner than half of its mean height.
            if share > 2.0 * max + 0.01 || share < min / 2.5 - 0.01 {
                return Err(format!(
                    "{share} of the interrupted layer was made, but the board reported {min} to {max}"
                ));
            }
            Ok(())
        }
        None => Ok(()),
    }
}
