//! Orders of users during a growth.

use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use growbot_core::link::message::MaintenanceTask;
use growbot_core::robot::Robot;
use serde::{Deserialize, Serialize};

use crate::maintenance::MaterialPreset;

/// An order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[repr(u8)]
pub enum Command {
    /// Continue after a pause.
    Continue = 1,
    /// Pause after the layer in progress.
    Pause,
    /// In a pause: heat the nozzle, to change filament.
    Preheat,
    /// In a pause: pull filament out.
    Unload,
    /// In a pause: push filament in.
    Load,
    /// In a pause: push filament through the nozzle.
    Purge,
    /// Switch heater and steppers off. The body can be resumed.
    Stop,
    /// Switch heater and steppers off before anything else. The board stays off until the stop is cleared.
    EmergencyStop,
}

impl Command {
    /// All orders.
    pub const ALL: [Self; 8] = [
        Self::Continue,
        Self::Pause,
        Self::Preheat,
        Self::Unload,
        Self::Load,
        Self::Purge,
        Self::Stop,
        Self::EmergencyStop,
    ];

    /// Returns the name in addresses and logs.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Continue => "continue",
            Self::Pause => "pause",
            Self::Preheat => "preheat",
            Self::Unload => "unload",
            Self::Load => "load",
            Self::Purge => "purge",
            Self::Stop => "stop",
            Self::EmergencyStop => "emergency-stop",
        }
    }

    /// Returns the maintenance task of the order, if it has one, with the lengths of the default preset.
    pub(super) fn task(self, robot: &Robot) -> Option<MaintenanceTask> {
        let MaterialPreset { load_mm, unload_mm, purge_mm, .. } = MaterialPreset::default();
        let feed = |mm: f64| MaintenanceTask::Feed { um: (mm * 1000.0).round() as i32 };
        match self {
            Self::Preheat => {
                let target_centi_c = (robot.description().heater.target_c * 100.0).round() as i32;
                Some(MaintenanceTask::Preheat { target_centi_c })
            }
            Self::Unload => Some(feed(-unload_mm)),
            Self::Load => Some(feed(load_mm)),
            Self::Purge => Some(feed(purge_mm)),
            Self::Continue | Self::Pause | Self::Stop | Self::EmergencyStop => None,
        }
    }

    /// Reports whether the order replaces a waiting one. An equal order is not repeated, and the latest of pausing and
    /// continuing counts.
    fn replaces(self, before: Self) -> bool {
        let of_pause = |order| matches!(order, Self::Pause | Self::Continue);
        self == before || (of_pause(self) && of_pause(before))
    }

    /// Reports whether the order may safely be executed twice if it is unknown whether it was executed.
    pub(super) fn may_be_repeated(self) -> bool {
        !matches!(self, Self::Unload | Self::Load | Self::Purge)
    }

    /// Returns the message for an order that may have been executed and is not repeated.
    pub(super) fn uncertain_message(self) -> String {
        format!(
            "the connection was lost, so it is unknown whether `{}` was executed: check before sending it again",
            self.name()
        )
    }

    fn of(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|order| *order as u8 == code)
    }
}

/// Orders for a running growth. Any thread may give one. The growth thread polls them every 20 ms and executes them in
/// order, but a stop before all others. A stop is latched: only an emergency stop overrides it.
#[derive(Debug, Default)]
pub struct CommandQueue {
    /// [`Move::Stop`], [`Move::EmergencyStop`] or 0.
    stop: AtomicU8,
    waiting: Mutex<Vec<Command>>,
    /// True if the user has interrupted the program.
    interrupted: AtomicBool,
}

impl CommandQueue {
    /// Gives an order. An order to pause or to continue replaces a waiting order to pause or to continue.
    pub fn push(&self, order: Command) {
        if order >= Command::Stop {
            self.stop.fetch_max(order as u8, Ordering::Relaxed);
            return;
        }
        let mut waiting = self.waiting();
        waiting.retain(|before| !order.replaces(*before));
        waiting.push(order);
    }

    fn waiting(&self) -> MutexGuard<'_, Vec<Command>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Orders a stop because the user interrupts the program. Returns true if that had happened before.
    pub fn interrupt(&self) -> bool {
        self.push(Command::Stop);
        self.interrupted.swap(true, Ordering::Relaxed)
    }

    /// Reports whether a stop or an emergency stop was ordered.
    #[must_use]
    pub fn stop_requested(&self) -> bool {
        self.stop.load(Ordering::Relaxed) > 0
    }

    /// Reports whether an emergency stop was ordered.
    pub(super) fn emergency_stop_requested(&self) -> bool {
        self.stop.load(Ordering::Relaxed) == Command::EmergencyStop as u8
    }

    /// Drops all orders, for example before another growth. Returns true if a stop was among them.
    pub fn clear(&self) -> bool {
        self.interrupted.store(false, Ordering::Relaxed);
        self.waiting().clear();
        self.stop.swap(0, Ordering::Relaxed) > 0
    }

    /// Returns the next order. A stop stays, the others are returned once.
    pub(super) fn pop(&self) -> Option<Command> {
        if let Some(stop) = Command::of(self.stop.load(Ordering::Relaxed)) {
            return Some(stop);
        }
        let mut waiting = self.waiting();
        (!waiting.is_empty()).then(|| waiting.remove(0))
    }

    /// Returns an order that could not be executed to the front of the queue, unless a waiting order replaces it.
    pub(super) fn requeue(&self, order: Command) {
        let mut waiting = self.waiting();
        if order < Command::Stop && !waiting.iter().any(|newer| newer.replaces(order)) {
            waiting.insert(0, order);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stop_stays_queued_and_other_commands_are_popped_once() {
        let orders = CommandQueue::default();
        assert_eq!(orders.pop(), None);
        orders.push(Command::Pause);
        orders.push(Command::Continue);
        assert_eq!((orders.pop(), orders.pop()), (Some(Command::Continue), None));
        orders.push(Command::Stop);
        orders.push(Command::Pause);
        assert_eq!((orders.pop(), orders.pop()), (Some(Command::Stop), Some(Command::Stop)));
        orders.push(Command::EmergencyStop);
        orders.push(Command::Stop);
        assert_eq!(orders.pop(), Some(Command::EmergencyStop));
        assert!(orders.stop_requested() && orders.clear() && !orders.stop_requested() && !orders.clear());
    }

    #[test]
    fn a_new_command_does_not_discard_queued_commands() {
        let orders = CommandQueue::default();
        for order in [Command::Pause, Command::Preheat, Command::Load, Command::Load, Command::Purge] {
            orders.push(order);
        }
        let all = || std::iter::from_fn(|| orders.pop()).collect::<Vec<_>>();
        assert_eq!(all(), [Command::Pause, Command::Preheat, Command::Load, Command::Purge]);
        orders.push(Command::Load);
        orders.push(Command::Pause);
        orders.push(Command::Continue);
        assert_eq!(all(), [Command::Load, Command::Continue]);
    }

    #[test]
    fn a_command_is_requeued_unless_a_newer_one_is_pending() {
        let orders = CommandQueue::default();
        orders.requeue(Command::Pause);
        assert_eq!(orders.pop(), Some(Command::Pause));
        orders.push(Command::Continue);
        orders.requeue(Command::Pause);
        assert_eq!((orders.pop(), orders.pop()), (Some(Command::Continue), None));
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
