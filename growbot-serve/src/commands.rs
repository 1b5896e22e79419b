//! Sends commands to a robot, and waits for their effect.

use std::sync::mpsc;
use std::time::{Duration, Instant};

use growbot_client::robot_command::{CommandOutcome, RobotCommand, StopOutcome};
use growbot_client::status::{ConnectionState, RobotStatus};
use growbot_client::stop_signal::{Permit, StopLevel};
use growbot_plan::job::Command;

use super::robot_error::RobotRequestError;
use super::robot_request::RobotRequest;
use super::robot_worker::RobotWorker;

/// Timeout of a robot's response to a command.
pub(super) const COMMAND_TIMEOUT: Duration = Duration::from_secs(10);
/// Timeout of the start of a growth, for which files are written and layers sent. It is shorter than the 30 s for which
/// a command of growbot waits, if no other start is before it.
pub(super) const START_TIMEOUT: Duration = Duration::from_secs(25);
/// Timeout of what a board reports beside its status.
const DETAILS_TIMEOUT: Duration = Duration::from_secs(1);
/// Number of reconnection intervals for which a stop waits for a robot that is not connected, before the stop fails.
const RECONNECTIONS: u32 = 2;
/// Interval of the checks whether the board has confirmed a stop.
const CONFIRM_POLL_INTERVAL: Duration = Duration::from_millis(2);

/// Sends a command to a robot, with the permit that was issued when the command arrived. Waits until the board has
/// carried the command out. Pause and continue are only queued for the active growth.
pub(super) fn run_command(
    keeper: &RobotWorker,
    order: RobotCommand,
    permit: &Permit,
) -> Result<CommandOutcome, RobotRequestError> {
    let robot = || keeper.name.clone();
    match order {
        RobotCommand::EmergencyStop => emergency_stop(keeper),
        RobotCommand::Stop => stop(keeper),
        RobotCommand::WithdrawStop => keeper.withdraw_stop().map(|()| CommandOutcome::StopWithdrawn),
        // A growth ends at a fault, so its robot has none. The thread that follows it takes no requests.
        RobotCommand::ClearFault => {
            keeper.ensure_idle()?;
            keeper.request(RobotRequest::ClearFault(permit.clone()), COMMAND_TIMEOUT)
        }
        RobotCommand::Cancel if keeper.status().job.is_some() => {
            Err(RobotRequestError::CancelDuringJob { robot: robot() })
        }
        RobotCommand::Cancel => {
            // The body of an order that has not begun is discarded, too.
            keeper.signal().void();
            keeper.request(RobotRequest::Cancel, COMMAND_TIMEOUT)
        }
        RobotCommand::Pause => keeper.order_growth(Command::Pause, None, permit),
        RobotCommand::Continue => keeper.order_growth(Command::Continue, None, permit),
    }
}

/// Returns the status of a robot with what its board reports beside it. Without these details if the robot has a job,
/// is not connected, or does not report them in time.
pub(super) fn full_status(keeper: &RobotWorker) -> RobotStatus {
    let (sender, details) = mpsc::channel();
    if keeper.status().connection == ConnectionState::Ready {
        // An error needs no report: the status shows a lost connection or a new job.
        let _ = keeper.request(RobotRequest::ReadDetails(sender), DETAILS_TIMEOUT);
    }
    let mut status = keeper.status();
    details.try_iter().for_each(|details| status.set_details(&details));
    status
}

/// Sends the emergency stop on every connection that reaches the board, and waits until the board has confirmed it.
fn emergency_stop(keeper: &RobotWorker) -> Result<CommandOutcome, RobotRequestError> {
    let stop = keeper.raise_stop(StopLevel::EmergencyStop);
    let ticket = keeper.stopper.send();
    keeper.sync_stop_file();
    ticket.wait()?;
    keeper.record_emergency_stop();
    keeper.lock_state().latest_stop = StopOutcome::ByEmergencyStop;
    keeper.notify_thread(RobotRequest::StopConfirmed(stop.generation));
    Ok(CommandOutcome::EmergencyStopped)
}

/// Stops the robot, and waits until the board has confirmed the stop.
fn stop(keeper: &RobotWorker) -> Result<CommandOutcome, RobotRequestError> {
    let reconnects_within = RECONNECTIONS * keeper.connector.reconnect_interval();
    let began = Instant::now();
    let _stop = keeper.raise_stop(StopLevel::Stop);
    keeper.sync_stop_file();
    while keeper.signal().level().is_some() {
        let robot = || keeper.name.clone();
        let lost = keeper.lock_state().connection_error.clone().filter(|_| began.elapsed() > reconnects_within);
        if let Some(reason) = lost {
            return Err(RobotRequestError::StopNotSent { robot: robot(), reason });
        }
        if began.elapsed() > COMMAND_TIMEOUT {
            return Err(RobotRequestError::StopUnconfirmed { robot: robot(), limit: COMMAND_TIMEOUT });
        }
        std::thread::sleep(CONFIRM_POLL_INTERVAL);
    }
    Ok(CommandOutcome::Stopped(keeper.lock_state().latest_stop))
}
