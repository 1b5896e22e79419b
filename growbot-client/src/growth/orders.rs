//! Orders of users during a growth.

use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use growbot_core::link::message::MaintenanceTask;
use growbot_core::robot::Robot;
use serde::{Deserialize, Serialize};

use crate::maintenance::Preset;

/// An order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[repr(u8)]
pub enum Order {
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

impl Order {
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
        let Preset { load_mm, unload_mm, purge_mm, .. } = Preset::default();
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
    pub(super) fn is_uncertain(self) -> String {
        format!(
            "the line was lost, so it is not known whether `{}` was carried out: look before you order it again",
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
pub struct Orders {
    /// [`Order::Stop`], [`Order::EmergencyStop`] or 0.
    stop: AtomicU8,
    waiting: Mutex<Vec<Order>>,
    /// True if the user has interrupted the program.
    interrupted: AtomicBool,
}

impl Orders {
    /// Gives an order. An order to pause or to continue replaces a waiting order to pause or to continue.
    pub fn give(&self, order: Order) {
        if order >= Order::Stop {
            self.stop.fetch_max(order as u8, Ordering::Relaxed);
            return;
        }
        let mut waiting = self.waiting();
        waiting.retain(|before| !order.replaces(*before));
        waiting.push(order);
    }

    fn waiting(&self) -> MutexGuard<'_, Vec<Order>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Orders a stop because the user interrupts the program. Returns true if that had happened before.
    pub fn interrupt(&self) -> bool {
        self.give(Order::Stop);
        self.interrupted.swap(true, Ordering::Relaxed)
    }

    /// Reports whether a stop or an emergency stop was ordered.
    #[must_use]
    pub fn stops(&self) -> bool {
        self.stop.load(Ordering::Relaxed) > 0
    }

    /// Reports whether an emergency stop was ordered.
    pub(super) fn stop_at_once(&self) -> bool {
        self.stop.load(Ordering::Relaxed) == Order::EmergencyStop as u8
    }

    /// Drops all orders, for example before another growth. Returns true if a stop was among them.
    pub fn clear(&self) -> bool {
        self.interrupted.store(false, Ordering::Relaxed);
        self.waiting().clear();
        self.stop.swap(0, Ordering::Relaxed) > 0
    }

    /// Returns the next order. A stop stays, the others are returned once.
    pub(super) fn next(&self) -> Option<Order> {
        if let Some(stop) = Order::of(self.stop.load(Ordering::Relaxed)) {
            return Some(stop);
        }
        let mut waiting = self.waiting();
        (!waiting.is_empty()).then(|| waiting.remove(0))
    }

    /// Returns an order that could not be executed to the front of the queue, unless a waiting order replaces it.
    pub(super) fn give_back(&self, order: Order) {
        let mut waiting = self.waiting();
        if order < Order::Stop && !waiting.iter().any(|newer| newer.replaces(order)) {
            waiting.insert(0, order);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stop_is_for_good_and_the_others_are_given_once() {
        let orders = Orders::default();
        assert_eq!(orders.next(), None);
        orders.give(Order::Pause);
        orders.give(Order::Continue);
        assert_eq!((orders.next(), orders.next()), (Some(Order::Continue), None));
        orders.give(Order::Stop);
        orders.give(Order::Pause);
        assert_eq!((orders.next(), orders.next()), (Some(Order::Stop), Some(Order::Stop)));
        orders.give(Order::EmergencyStop);
        orders.give(Order::Stop);
        assert_eq!(orders.next(), Some(Order::EmergencyStop));
        assert!(orders.stops() && orders.clear() && !orders.stops() && !orders.clear());
    }

    #[test]
    fn an_order_is_not_lost_behind_another() {
        let orders = Orders::default();
        for order in [Order::Pause, Order::Preheat, Order::Load, Order::Load, Order::Purge] {
            orders.give(order);
        }
        let all = || std::iter::from_fn(|| orders.next()).collect::<Vec<_>>();
        assert_eq!(all(), [Order::Pause, Order::Preheat, Order::Load, Order::Purge]);
        orders.give(Order::Load);
        orders.give(Order::Pause);
        orders.give(Order::Continue);
        assert_eq!(all(), [Order::Load, Order::Continue]);
    }

    #[test]
    fn an_order_comes_back_unless_there_is_a_newer_one() {
        let orders = Orders::default();
        orders.give_back(Order::Pause);
        assert_eq!(orders.next(), Some(Order::Pause));
        orders.give(Order::Continue);
        orders.give_back(Order::Pause);
        assert_eq!((orders.next(), orders.next()), (Some(Order::Continue), None));
    }

    #[test]
    fn only_a_second_interruption_is_one_again_whatever_else_orders_a_stop() {
        let orders = Orders::default();
        orders.give(Order::Stop);
        assert!(!orders.interrupt() && orders.interrupt());
        orders.clear();
        assert!(!orders.interrupt() && orders.stops());
    }
}
