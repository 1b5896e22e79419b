//! Stops of a robot, and the permits to heat or move it that a stop makes invalid (voids).
//!
//! Each command of a user gets a [`Permit`] when it arrives, before anything is planned, read or sent. Each stop voids
//! all earlier permits. [`Client::energize`](crate::client::Client::energize) sends nothing with a void permit, so the
//! robot heats or moves after a stop only if a later command requests it. A pause voids only permits to continue a
//! growth ([`Permit::until_pause`]).

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use growbot_core::link::message::Status;
use serde::{Deserialize, Serialize};

/// Number of low bits of `StopSignal::stops` that hold the level of the stop.
const LEVEL_BITS: u32 = 2;

/// Kind of a stop of a robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum StopLevel {
    /// The board switches heater and steppers off. The body can be resumed.
    Stop,
    /// The board switches heater and steppers off before anything else, and stays off until the stop is cleared.
    EmergencyStop,
}

/// Number of a stop, which counts up with each stop of a [`StopSignal`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Generation(u64);

/// Stops and pauses that were commanded to one robot. All its permits refer to it.
#[derive(Debug, Default)]
pub struct StopSignal {
    /// Number of stops so far, and in the low bits the level of the latest stop until it is confirmed. One atomic
    /// number holds both, so that they change at the same time.
    stops: AtomicU64,
    /// Number of pauses that were commanded.
    pauses: AtomicU64,
}

impl StopSignal {
    /// Raises a stop, which voids all permits and stays pending until [`Self::confirm`]. If an emergency stop is
    /// pending, the level stays that of an emergency stop. Returns the number of the stop.
    pub fn raise(&self, level: StopLevel) -> Generation {
        self.change(Some(level))
    }

    /// Voids all permits without raising a stop, because the board is off already or the body is discarded.
    pub fn void(&self) -> Generation {
        self.change(None)
    }

    /// Voids all permits to continue a growth, because a pause was commanded.
    pub fn pause(&self) {
        self.pauses.fetch_add(1, Ordering::SeqCst);
    }

    fn change(&self, raised: Option<StopLevel>) -> Generation {
        let mut state = self.stops.load(Ordering::SeqCst);
        loop {
            let next = encode(decode(state).0.wrapping_add(1), decode(state).1.max(raised));
            match self.stops.compare_exchange_weak(state, next, Ordering::SeqCst, Ordering::SeqCst) {
                Ok(_) => return Generation(decode(next).0),
                Err(newer) => state = newer,
            }
        }
    }

    /// Marks this stop as confirmed, because the board has switched off. Returns false and changes nothing if a newer
    /// stop was raised since.
    pub fn confirm(&self, generation: Generation) -> bool {
        let state = self.stops.load(Ordering::SeqCst);
        let confirmed = encode(generation.0, None);
        decode(state).0 == generation.0
            && self.stops.compare_exchange(state, confirmed, Ordering::SeqCst, Ordering::SeqCst).is_ok()
    }

    /// Returns the level and number of the stop that is not confirmed yet. `None` without such a stop.
    pub fn pending(&self) -> Option<(StopLevel, Generation)> {
        let (generation, level) = decode(self.stops.load(Ordering::SeqCst));
        level.map(|level| (level, Generation(generation)))
    }

    /// Returns the level of the stop that is not confirmed yet. `None` without such a stop.
    pub fn level(&self) -> Option<StopLevel> {
        self.pending().map(|(level, _)| level)
    }

    /// Returns a permit for a command of a person that arrives now.
    #[must_use]
    pub fn permit(self: &Arc<Self>) -> Permit {
        self.permit_of(Authority::Person)
    }

    /// Returns a permit to resume a growth after a lost connection or a restart, without a command of a person. A pause
    /// voids it.
    #[must_use]
    pub fn continuation(self: &Arc<Self>) -> Permit {
        self.permit_of(Authority::Continuation).until_pause()
    }

    fn permit_of(self: &Arc<Self>, authority: Authority) -> Permit {
        let (generation, _) = decode(self.stops.load(Ordering::SeqCst));
        let pauses = self.pauses.load(Ordering::SeqCst);
        Permit { signal: Arc::clone(self), generation, pauses, ends_at_pause: false, authority }
    }
}

/// Origin of a [`Permit`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Authority {
    /// The permit belongs to a command of a person or of a person's program.
    Person,
    /// The permit belongs to a growth that is resumed automatically after a lost connection or a restart.
    Continuation,
}

/// Permission to heat or move a robot. Each later stop of the robot voids it. A permit to continue a growth is also
/// voided by each later pause.
#[derive(Debug, Clone)]
pub struct Permit {
    signal: Arc<StopSignal>,
    generation: u64,
    /// Number of pauses that were commanded before the permit was given.
    pauses: u64,
    /// True if a later pause voids the permit.
    ends_at_pause: bool,
    authority: Authority,
}

impl Permit {
    /// Returns a permit with a new signal that nothing else uses, for a program whose only user sends the request. Only
    /// a stop that is raised through [`Permit::signal`] voids it.
    pub fn standalone() -> Self {
        Arc::<StopSignal>::default().permit()
    }

    /// Returns a copy of this permit that is also voided by each pause commanded after the original permit was given.
    pub fn until_pause(&self) -> Self {
        Self { ends_at_pause: true, ..self.clone() }
    }

    /// Reports whether the permit is not void: no stop was raised since it was given, and every earlier stop is
    /// confirmed. For a permit to continue a growth, also no pause was commanded since.
    pub fn is_valid(&self) -> bool {
        let is_paused = self.ends_at_pause && self.signal.pauses.load(Ordering::SeqCst) != self.pauses;
        self.signal.stops.load(Ordering::SeqCst) == encode(self.generation, None) && !is_paused
    }

    /// Reports whether the permit allows the start of a job on a board with this status. A permit without a command of
    /// a person does not start a board that waits for a person, after a requested pause, a filament runout or a long
    /// pause with the heater off.
    pub fn allows_start(&self, status: &Status) -> bool {
        self.authority == Authority::Person || status.pause_cause.allows_continuation(status.state)
    }

    /// Reports whether the permit was given without a command of a person, to resume a growth.
    pub fn is_continuation(&self) -> bool {
        self.authority == Authority::Continuation
    }

    /// Returns the signal of the robot, whose stops and pauses void the permit.
    pub fn signal(&self) -> &Arc<StopSignal> {
        &self.signal
    }
}

fn encode(generation: u64, level: Option<StopLevel>) -> u64 {
    let level = match level {
        None => 0,
        Some(StopLevel::Stop) => 1,
        Some(StopLevel::EmergencyStop) => 2,
    };
    generation << LEVEL_BITS | level
}

fn decode(state: u64) -> (u64, Option<StopLevel>) {
    let level = match state & ((1 << LEVEL_BITS) - 1) {
        0 => None,
        1 => Some(StopLevel::Stop),
        _ => Some(StopLevel::EmergencyStop),
    };
    (state >> LEVEL_BITS, level)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stop_voids_every_earlier_permit_and_no_later_one() {
        let signal = Arc::<StopSignal>::default();
        let before = signal.permit();
        assert!(before.is_valid());
        let stop = signal.raise(StopLevel::Stop);
        let meanwhile = signal.permit();
        assert!(!before.is_valid() && !meanwhile.is_valid(), "the stop is not confirmed");
        assert!(signal.confirm(stop));
        assert!(!before.is_valid() && meanwhile.is_valid());
        signal.void();
        assert!(!meanwhile.is_valid() && signal.permit().is_valid());
    }

    #[test]
    fn a_newer_stop_is_never_confirmed_with_an_older_one() {
        let signal = Arc::<StopSignal>::default();
        let first = signal.raise(StopLevel::EmergencyStop);
        let second = signal.raise(StopLevel::Stop);
        assert!(!signal.confirm(first));
        assert_eq!(signal.level(), Some(StopLevel::EmergencyStop), "a stop does not lower an emergency stop");
        assert!(signal.confirm(second));
        assert_eq!(signal.level(), None);
    }

    #[test]
    fn a_pause_voids_earlier_permits_to_continue_and_no_others() {
        let signal = Arc::<StopSignal>::default();
        let before = signal.permit();
        let continuation = signal.continuation();
        assert!(before.until_pause().is_valid() && continuation.is_valid());
        signal.pause();
        assert!(before.is_valid() && !before.until_pause().is_valid() && !continuation.is_valid());
        let after = signal.permit().until_pause();
        assert!(after.is_valid() && signal.level().is_none());
        signal.raise(StopLevel::Stop);
        assert!(!after.is_valid());
    }

    /// Tries one new stop, one confirmation of the previous stop, and one check of an older permit in every order.
    #[test]
    fn no_interleaving_makes_an_old_permit_valid() {
        let orders = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
        for order in orders {
            let signal = Arc::<StopSignal>::default();
            let old = signal.permit();
            let stop = signal.raise(StopLevel::Stop);
            for step in order {
                match step {
                    0 => drop(signal.raise(StopLevel::EmergencyStop)),
                    1 => drop(signal.confirm(stop)),
                    _ => assert!(!old.is_valid(), "{order:?}"),
                }
            }
            assert_eq!(signal.level(), Some(StopLevel::EmergencyStop), "{order:?}");
        }
    }
}
