//! Checks of head and feed in a dry run, with the heater off.

use std::time::Duration;

use growbot_client::commissioning_report::Finding;
use growbot_client::procedure::FREE_FILAMENT;
use growbot_core::link::message::MaintenanceTask;
use growbot_sim::tip::manual_action::ManualAction;

use super::answers::{AnswerKind, OperatorAnswer};
use super::session::{DoctorSession, describe};
use crate::cli::failure::Failure;

/// Angle by which the check turns the head, degrees.
const TURN_DEG: f64 = 90.0;
/// Maximum turns of the head for homing, with a margin: 1.5 turns to the mark, and nearly one from there to zero.
const HOMING_TURNS: f64 = 2.6;
/// Length of filament that the check feeds, mm.
const FEED_MM: f64 = 50.0;
/// Permitted error of the feed, percent.
const FEED_PERCENT: f64 = 2.0;
/// Time that is added to the computed time of a move, as a margin.
const SPARE: Duration = Duration::from_secs(2);

/// Starts a maintenance task and watches the board for this time. Returns a finding if the task has failed.
fn run_motor_task(
    session: &mut DoctorSession,
    task: MaintenanceTask,
    time: Duration,
) -> Result<Option<Finding>, Failure> {
    if let Some(why) = session.maintain(task)? {
        return Ok(Some(Finding::failed(why, "see the state of the board with `growbot status`")));
    }
    let faulted = session.wait_until(time + SPARE, None, |seen| seen.status.fault.is_some())?;
    Ok(faulted.and_then(|seen| seen.status.fault).map(|fault| {
        Finding::failed(
            describe(fault),
            "check the pairs of the motor's wires, the current of its driver, and that nothing blocks the motor",
        )
    }))
}

/// Runs a check in a dry run. Afterwards the motors are released, and a fault is cleared.
fn in_dry_run(
    session: &mut DoctorSession,
    run: impl FnOnce(&mut DoctorSession) -> Result<Finding, Failure>,
) -> Result<Finding, Failure> {
    if let Some(why) = session.dry_run()? {
        return Ok(Finding::failed(why, "see the state of the board with `growbot status`"));
    }
    // The step interrupt accepts no command before it has released the motors.
    session.sample()?;
    let found = run(session)?;
    session.switch_off()?;
    // The next step detects a fault that remains.
    session.clear()?;
    Ok(found)
}

/// Checks that the head finds its mark and turns the right way.
pub fn head(session: &mut DoctorSession) -> Result<Finding, Failure> {
    if !session.confirm("The head will make up to three turns: keep your hands off and clear its way.")? {
        return Ok(Finding::skipped());
    }
    in_dry_run(session, |session| {
        let per_s = session.robot.description().head.homing_turns_per_s;
        let homing = Duration::from_secs_f64((HOMING_TURNS / per_s).clamp(1.0, 600.0));
        if let Some(failed) = run_motor_task(session, MaintenanceTask::Home, homing)? {
            return Ok(failed);
        }
        let turn = Duration::from_secs_f64((TURN_DEG / 360.0 / per_s).clamp(0.5, 600.0));
        if let Some(failed) =
            run_motor_task(session, MaintenanceTask::Rotate { centi_deg: (TURN_DEG * 100.0) as i32 }, turn)?
        {
            return Ok(failed);
        }
        let question = "The head has found its mark and turned by 90 degrees. Seen from the front, looking at the \
                        nozzle: did it make a quarter turn counter-clockwise?";
        Ok(match session.ask(question, AnswerKind::YesOrNo)? {
            None => Finding::skipped(),
            Some(OperatorAnswer::Yes) => {
                Finding::passed("the head found its mark, and turned counter-clockwise by 90 degrees")
            }
            Some(_) => Finding::failed(
                "the head found its mark, but turned the wrong way or by another angle",
                "invert head.direction_high_is_positive if the way is wrong; compare head.steps_per_turn with the \
                 driver's microsteps if the angle is wrong",
            ),
        })
    })
}

/// Checks that the feed moves filament by the commanded length.
pub fn feed(session: &mut DoctorSession) -> Result<Finding, Failure> {
    let question = format!("{FREE_FILAMENT} The feed will push {FEED_MM} mm.");
    if !session.confirm(&question)? {
        return Ok(Finding::skipped());
    }
    session.act(ManualAction::FreeFilament(true));
    let found = in_dry_run(session, |session| {
        // The time is that of the slowest possible feed.
        let time = Duration::from_secs_f64(feed_s(session).clamp(1.0, 290.0));
        if let Some(failed) = run_motor_task(session, MaintenanceTask::Feed { um: (FEED_MM * 1000.0) as i32 }, time)? {
            return Ok(failed);
        }
        match session.ask("By how many mm has the filament moved forwards?", AnswerKind::Number)? {
            Some(OperatorAnswer::Number(mm)) => Ok(judge(session, mm)),
            _ => Ok(Finding::skipped()),
        }
    });
    session.act(ManualAction::FreeFilament(false));
    found
}

/// Returns the time in which the feed moves `FEED_MM` at the slowest speed that the board may choose, s.
fn feed_s(session: &DoctorSession) -> f64 {
    let description = session.robot.description();
    let grows = description.layer.height_mm * session.robot.wall_area() / session.robot.filament_area();
    let feed = &description.feed;
    // A step takes at least two ticks.
    let fastest = f64::from(description.motion.tick_hz) / (2.0 * feed.steps_per_mm);
    let slowest =
        (grows / description.layer.period_s).min(feed.retract_mm_per_s).min(feed.speed_jump_mm_per_s).min(fastest);
    FEED_MM / slowest.max(1e-3)
}

fn judge(session: &DoctorSession, mm: f64) -> Finding {
    let now = session.robot.description().feed.steps_per_mm;
    let percent = (mm / FEED_MM - 1.0) * 100.0;
    let found = format!(
        "the filament moved {mm} mm instead of {FEED_MM} mm, a deviation of {percent:+.1} %; {FEED_PERCENT} % is \
         allowed"
    );
    if percent.abs() <= FEED_PERCENT {
        return Finding::passed(found);
    }
    let right = now * FEED_MM / mm;
    Finding::failed(
        found,
        format!(
            "set feed.steps_per_mm = {right:.2} (now {now}) in the robot file, and send the robot file to the board \
             with `growbot configure`"
        ),
    )
}
