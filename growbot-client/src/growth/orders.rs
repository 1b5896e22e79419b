//! What people order while a body grows.

use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};

use growbot_core::link::message::Task;
use growbot_core::robot::Robot;
use serde::{Deserialize, Serialize};

use crate::maintenance::Preset;

/// One order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[repr(u8)]
pub enum Order {
    /// Continue after a pause.
    Continue = 1,
    /// Pause after the layer under way.
    Pause,
    /// In a pause: heat the nozzle, to change filament.
    Preheat,
    /// In a pause: pull filament out.
    Unload,
    /// In a pause: push filament in.
    Load,
    /// In a pause: push filament through the nozzle.
    Purge,
    /// Heater and steppers off; the body can be resumed.
    Stop,
    /// The same, ahead of all else; the board stays off until that is cleared.
    EmergencyStop,
}

impl Order {
    /// All of them.
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

    /// Its name in addresses and logs.
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

    /// The task of maintenance that it asks for, if it does; with the lengths of the default preset.
    pub(super) fn task(self, robot: &Robot) -> Option<Task> {
        let Preset { load_mm, unload_mm, purge_mm, .. } = Preset::default();
        let feed = |mm: f64| Task::Feed { um: (mm * 1000.0).round() as i32 };
        match self {
            Self::Preheat => {
                let target_centi_c = (robot.description().heater.target_c * 100.0).round() as i32;
                Some(Task::Preheat { target_centi_c })
            }
            Self::Unload => Some(feed(-unload_mm)),
            Self::Load => Some(feed(load_mm)),
            Self::Purge => Some(feed(purge_mm)),
            Self::Continue | Self::Pause | Self::Stop | Self::EmergencyStop => None,
        }
    }

    fn of(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|order| *order as u8 == code)
    }
}

/// The order to be carried out next, given from any thread and looked at a few times a second by the thread that
/// follows the growth. A stop is for good: nothing but the emergency stop goes over it.
#[derive(Debug, Default)]
pub struct Orders {
    latest: AtomicU8,
    /// Whether the user has interrupted the program.
    interrupted: AtomicBool,
}

impl Orders {
    /// Gives an order, in place of one that has not been looked at yet.
    pub fn give(&self, order: Order) {
        let _ = self.latest.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |before| {
            let stops = before >= Order::Stop as u8;
            (!stops || order as u8 > before).then_some(order as u8)
        });
    }

    /// Orders to stop, as the user interrupts the program. Returns whether that had happened before.
    pub fn interrupt(&self) -> bool {
        self.give(Order::Stop);
        self.interrupted.swap(true, Ordering::Relaxed)
    }

    /// Whether the growth is to stop.
    #[must_use]
    pub fn stops(&self) -> bool {
        self.latest.load(Ordering::Relaxed) >= Order::Stop as u8
    }

    /// Whether that is the emergency stop.
    pub(super) fn stop_at_once(&self) -> bool {
        self.latest.load(Ordering::Relaxed) == Order::EmergencyStop as u8
    }

    /// Forgets all orders, say for another growth; gives whether it was to stop.
    pub fn clear(&self) -> bool {
        self.interrupted.store(false, Ordering::Relaxed);
        self.latest.swap(0, Ordering::Relaxed) >= Order::Stop as u8
    }

    /// The latest order. A stop stays; the others are given once.
    pub(super) fn next(&self) -> Option<Order> {
        let order = Order::of(self.latest.load(Ordering::Relaxed))?;
        if order < Order::Stop {
            // One that comes just now stays for the next look.
            let _ = self.latest.compare_exchange(order as u8, 0, Ordering::Relaxed, Ordering::Relaxed);
        }
        Some(order)
    }

    /// An order could not be carried out: it is given again, unless there is a newer one.
    pub(super) fn give_back(&self, order: Order) {
        let _ = self.latest.compare_exchange(0, order as u8, Ordering::Relaxed, Ordering::Relaxed);
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
