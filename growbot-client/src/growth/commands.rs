//! Commands of users during a growth, and the queue in which they wait for the thread of the growth.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use growbot_plan::job::Command;

use crate::stop_signal::{Permit, StopLevel};

/// Returns the message for a command that is not sent again although it is unknown whether the board executed it.
pub(super) fn uncertain_message(command: Command) -> String {
    format!(
        "the connection was lost, so it is unknown whether the robot executed `{}`: check the robot's state before \
         you send the command again",
        command.name()
    )
}

impl From<StopLevel> for Command {
    fn from(level: StopLevel) -> Self {
        match level {
            StopLevel::Stop => Self::Stop,
            StopLevel::EmergencyStop => Self::EmergencyStop,
        }
    }
}

/// A command in the queue.
#[derive(Debug, Clone)]
pub(super) struct QueuedCommand {
    pub command: Command,
    /// Permit that was taken when the command arrived.
    pub permit: Permit,
}

impl QueuedCommand {
    /// Reports whether this command replaces the queued command `before`. Equal commands replace each other, and so do
    /// commands to pause and to continue. A command to continue that arrived before a pause does not replace that
    /// pause, even if it is queued later.
    fn replaces(&self, before: &Self) -> bool {
        self.command == before.command
            || match (self.command, before.command) {
                (Command::Pause, Command::Continue) => true,
                (Command::Continue, Command::Pause) => self.permit.is_valid(),
                _ => false,
            }
    }
}

/// Commands for a running growth. Any thread may add a command. The thread of the growth polls the queue every 20 ms
/// and executes the commands in order, but a stop first. A stop is not in the queue but in the robot's
/// [`StopSignal`](crate::stop_signal::StopSignal), where only an emergency stop overrides it.
#[derive(Debug)]
pub struct CommandQueue {
    /// Permit of the growth. It contains the stop signal of the robot.
    permit: Mutex<Permit>,
    waiting: Mutex<Vec<QueuedCommand>>,
    /// True if the user has interrupted the program, for example with Ctrl-C.
    interrupted: AtomicBool,
}

impl Default for CommandQueue {
    /// Returns an empty queue with a stop signal of its own, for a program that is the only user of the robot.
    fn default() -> Self {
        Self::new(Permit::standalone())
    }
}

impl CommandQueue {
    /// Returns an empty command queue for a growth with this permit.
    pub fn new(permit: Permit) -> Self {
        Self { permit: Mutex::new(permit), waiting: Mutex::default(), interrupted: AtomicBool::default() }
    }

    /// Adds a command to the queue, or raises a stop in the robot's signal. A command to pause or to continue replaces
    /// a queued command to pause or to continue.
    pub fn push(&self, order: Command) {
        match order {
            Command::Stop => _ = self.permit().signal().raise(StopLevel::Stop),
            Command::EmergencyStop => _ = self.permit().signal().raise(StopLevel::EmergencyStop),
            order => self.push_with(order, self.permit_now()),
        }
    }

    /// Adds a command that is not a stop to the queue, with the permit of the moment at which the command arrived. A
    /// command to pause also voids the permits of earlier commands to continue, so their `Start` request is not sent
    /// again.
    pub fn push_with(&self, order: Command, permit: Permit) {
        let mut waiting = self.waiting();
        let permit = match order {
            Command::Continue => permit.until_pause(),
            _ => permit,
        };
        if order == Command::Pause {
            permit.signal().pause();
        }
        let order = QueuedCommand { command: order, permit };
        waiting.retain(|before| !order.replaces(before));
        waiting.push(order);
    }

    /// Returns the permit of the growth.
    #[must_use]
    pub fn permit(&self) -> Permit {
        self.permit.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Returns a new permit for a command that arrives now.
    #[must_use]
    pub fn permit_now(&self) -> Permit {
        self.permit().signal().permit()
    }

    fn waiting(&self) -> MutexGuard<'_, Vec<QueuedCommand>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Raises a stop because the user interrupts the program. Returns true if the user has already interrupted it
    /// before.
    pub fn interrupt(&self) -> bool {
        self.push(Command::Stop);
        self.interrupted.swap(true, Ordering::Relaxed)
    }

    /// Reports whether a command to pause is in the queue.
    pub fn pause_waits(&self) -> bool {
        self.waiting().iter().any(|order| order.command == Command::Pause)
    }

    /// Reports whether a stop or an emergency stop was commanded that the board has not confirmed.
    pub fn stop_requested(&self) -> bool {
        self.requested_stop().is_some()
    }

    /// Returns the stop that was commanded and that the board has not confirmed.
    pub(super) fn requested_stop(&self) -> Option<StopLevel> {
        self.permit().signal().level()
    }

    /// Drops all queued commands and any unconfirmed stop, and gives the queue a new permit for another growth. Returns
    /// true if a stop was dropped.
    pub fn clear(&self) -> bool {
        self.interrupted.store(false, Ordering::Relaxed);
        self.waiting().clear();
        let signal = Arc::clone(self.permit().signal());
        let stopped = signal.pending().is_some_and(|(_, stop)| signal.confirm(stop));
        *self.permit.lock().unwrap_or_else(PoisonError::into_inner) = signal.permit();
        stopped
    }

    /// Returns the next command. A stop is returned again in each call until it is confirmed. Other commands are
    /// removed from the queue.
    pub(super) fn pop(&self) -> Option<QueuedCommand> {
        if let Some(stop) = self.requested_stop() {
            return Some(QueuedCommand { command: stop.into(), permit: self.permit_now() });
        }
        let mut waiting = self.waiting();
        (!waiting.is_empty()).then(|| waiting.remove(0))
    }

    /// Puts a command that could not be executed back to the front of the queue, unless a newer queued command replaces
    /// it. A stop is not put back, because it is in the signal.
    pub(super) fn requeue(&self, order: QueuedCommand) {
        let mut waiting = self.waiting();
        if order.command < Command::Stop && !waiting.iter().any(|newer| newer.replaces(&order)) {
            waiting.insert(0, order);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn next(orders: &CommandQueue) -> Option<Command> {
        orders.pop().map(|order| order.command)
    }

    #[test]
    fn a_stop_stays_queued_and_other_commands_are_popped_once() {
        let orders = CommandQueue::default();
        assert_eq!(next(&orders), None);
        orders.push(Command::Pause);
        orders.push(Command::Continue);
        assert_eq!((next(&orders), next(&orders)), (Some(Command::Continue), None));
        orders.push(Command::Stop);
        orders.push(Command::Pause);
        assert_eq!((next(&orders), next(&orders)), (Some(Command::Stop), Some(Command::Stop)));
        orders.push(Command::EmergencyStop);
        orders.push(Command::Stop);
        assert_eq!(next(&orders), Some(Command::EmergencyStop));
        assert!(orders.stop_requested() && orders.clear() && !orders.stop_requested() && !orders.clear());
    }

    #[test]
    fn a_new_command_does_not_discard_queued_commands() {
        let orders = CommandQueue::default();
        for order in [Command::Pause, Command::Preheat, Command::Load, Command::Load, Command::Purge] {
            orders.push(order);
        }
        let all = || std::iter::from_fn(|| next(&orders)).collect::<Vec<_>>();
        assert_eq!(all(), [Command::Pause, Command::Preheat, Command::Load, Command::Purge]);
        orders.push(Command::Load);
        orders.push(Command::Pause);
        orders.push(Command::Continue);
        assert_eq!(all(), [Command::Load, Command::Continue]);
    }

    #[test]
    fn a_command_is_requeued_unless_a_newer_one_is_pending() {
        let orders = CommandQueue::default();
        let pause = || QueuedCommand { command: Command::Pause, permit: orders.permit_now() };
        orders.requeue(pause());
        assert_eq!(next(&orders), Some(Command::Pause));
        orders.push(Command::Continue);
        orders.requeue(pause());
        assert_eq!((next(&orders), next(&orders)), (Some(Command::Continue), None));
    }

    #[test]
    fn a_continue_that_arrived_before_a_pause_does_not_replace_it() {
        let orders = CommandQueue::default();
        let earlier = orders.permit_now();
        orders.push(Command::Pause);
        orders.push_with(Command::Continue, earlier);
        let pause = orders.pop().unwrap();
        assert_eq!(pause.command, Command::Pause);
        orders.requeue(pause);
        assert!(orders.pause_waits());
        let (pause, late) = (orders.pop().unwrap(), orders.pop().unwrap());
        assert_eq!((pause.command, late.command, late.permit.is_valid()), (Command::Pause, Command::Continue, false));
        // A pause voids a continue that was already taken from the queue.
        orders.push(Command::Continue);
        let taken = orders.pop().unwrap();
        assert!(taken.permit.is_valid());
        orders.push(Command::Pause);
        assert!(!taken.permit.is_valid());
        orders.requeue(taken);
        assert_eq!((next(&orders), next(&orders)), (Some(Command::Pause), None));
    }

    #[test]
    fn only_a_second_interrupt_counts_as_repeated() {
        let orders = CommandQueue::default();
        orders.push(Command::Stop);
        assert!(!orders.interrupt() && orders.interrupt());
        orders.clear();
        assert!(!orders.interrupt() && orders.stop_requested());
    }
}
