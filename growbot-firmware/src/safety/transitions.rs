//! The table of states and events. It alone decides which state an event leads to.

use growbot_core::link::message::State;
use strum::{IntoStaticStr, VariantArray};

/// The events that a state can react to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "lowercase")]
pub enum Event {
    /// A host begins a job, or repeats that request.
    Begin,
    /// A host requests that the board plan on its own.
    Plan,
    /// A host resumes the job in the board's journal.
    Resume,
    /// A host sends layers of the current job.
    Layers,
    /// A host replaces the layers of the job from an index on.
    Amend,
    /// A host starts the stored job, or continues it.
    Start,
    /// A host requests a pause after the current layer.
    Pause,
    /// A host requests tuning of the heater's gains.
    Tune,
    /// A host requests a hot nozzle without a job, or a dry run, in which head and feed move with the heater off.
    Preheat,
    /// A host requests that the nozzle cool down.
    #[strum(serialize = "cool down")]
    CoolDown,
    /// A host requests a move of the head.
    #[strum(serialize = "move head")]
    MoveHead,
    /// A host requests a move of filament.
    #[strum(serialize = "move filament")]
    MoveFilament,
    /// A host requests that everything be switched off.
    Stop,
    /// A host cancels the job.
    Cancel,
    /// A host clears a fault or an emergency stop whose cause is gone.
    Clear,
    /// Every sensor gives the reading of a healthy robot at rest.
    #[strum(serialize = "tested")]
    SelfTestPassed,
    /// The nozzle has settled at its target.
    #[strum(serialize = "hot")]
    TemperatureReached,
    /// Homing is finished: the head stands at the tip's x axis.
    Homed,
    /// A layer is laid, and no further layer can follow now.
    #[strum(serialize = "layers exhausted")]
    LayersExhausted,
    /// The nozzle is hot, and the next layer is stored.
    #[strum(serialize = "layers available")]
    LayersAvailable,
    /// The last layer is laid.
    Finished,
    /// The pause has lasted for the max time in which the heater may be on without growth.
    #[strum(serialize = "paused too long")]
    PauseTimeout,
    /// The tuning has found the gains of the heater.
    Tuned,
    /// No request for maintenance has arrived for ten minutes.
    #[strum(serialize = "unattended")]
    MaintenanceTimeout,
    /// The emergency stop is pressed.
    #[strum(serialize = "emergency stop")]
    EmergencyStop,
    /// A fault was found.
    Fault,
}

impl Event {
    /// All events, with the requests first.
    pub const ALL: [Self; 26] = *Self::VARIANTS.as_array().unwrap();

    /// Returns the name of the event, in lower case.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Returns the state that an event leads to. The result is the unchanged state if the state accepts the event and the
/// event changes nothing. `None` if the state refuses the request, or ignores an event that is not a request.
pub const fn next_state(state: State, event: Event) -> Option<State> {
    use State as S;
    match (state, event) {
        // A fault is latched, and the first one is kept.
        (S::Fault | S::EmergencyStop, Event::Fault | Event::EmergencyStop | Event::Stop | Event::Cancel) => Some(state),
        (S::Fault | S::EmergencyStop, Event::Clear) => Some(S::Idle),
        (S::Fault | S::EmergencyStop, _) => None,
        (_, Event::Fault) => Some(S::Fault),
        (_, Event::EmergencyStop) => Some(S::EmergencyStop),

        (S::SelfTest, Event::SelfTestPassed) => Some(S::Idle),
        // There is nothing to stop yet.
        (S::SelfTest, Event::Stop | Event::Clear) => Some(S::SelfTest),
        (S::SelfTest, _) => None,

        (_, Event::Stop) => Some(S::Stopped),
        (_, Event::Cancel) => Some(S::Idle),
        // There is nothing to clear.
        (_, Event::Clear) => Some(state),

        (S::Idle | S::Done | S::Stopped, Event::Begin | Event::Plan) => Some(S::Idle),
        (S::Idle | S::Done | S::Stopped, Event::Tune) => Some(S::Tuning),
        (S::Idle | S::Done | S::Stopped, Event::Preheat) => Some(S::Maintenance),
        (S::Maintenance | S::Paused, Event::Preheat | Event::MoveFilament) => Some(state),
        (S::Maintenance, Event::MoveHead) => Some(state),
        (S::Maintenance, Event::CoolDown | Event::MaintenanceTimeout) => Some(S::Idle),
        (S::Idle | S::Done | S::Stopped | S::Parked, Event::CoolDown) => Some(state),
        // The request for the same job is repeated while the job is in progress.
        (S::Heating | S::Homing | S::Growing | S::Paused | S::Parked, Event::Begin) => Some(state),

        // A stopped job is resumed from rest. A job in progress continues.
        (S::Stopped, Event::Resume) => Some(S::Idle),
        (S::Idle | S::Heating | S::Homing | S::Growing | S::Paused | S::Parked | S::Done, Event::Resume) => Some(state),

        (S::Idle | S::Heating | S::Homing | S::Growing | S::Paused | S::Parked | S::Done, Event::Layers) => Some(state),
        (S::Idle | S::Heating | S::Homing | S::Growing | S::Paused | S::Parked, Event::Amend) => Some(state),

        (S::Idle | S::Parked, Event::Start) => Some(S::Heating),
        // A job whose layers are all laid is finished at once.
        (S::Idle, Event::Finished) => Some(S::Done),
        (S::Heating | S::Homing | S::Growing | S::Paused | S::Done, Event::Start) => Some(state),

        (S::Heating | S::Homing | S::Growing | S::Paused | S::Parked, Event::Pause) => Some(state),

        (S::Heating, Event::TemperatureReached) => Some(S::Homing),
        (S::Homing, Event::Homed) => Some(S::Growing),
        (S::Growing, Event::LayersExhausted) => Some(S::Paused),
        (S::Growing, Event::Finished) => Some(S::Done),
        (S::Paused, Event::LayersAvailable) => Some(S::Growing),
        (S::Paused, Event::PauseTimeout) => Some(S::Parked),
        (S::Tuning, Event::Tuned) => Some(S::Idle),
        _ => None,
    }
}

/// Returns whether the heater may be on in this state.
pub const fn may_heat(state: State) -> bool {
    matches!(
        state,
        State::Heating | State::Homing | State::Growing | State::Paused | State::Tuning | State::Maintenance
    )
}

/// Returns whether motors may be energised and turn in this state. In maintenance they do so only while the nozzle is
/// hot, or in a dry run with the heater off.
pub const fn may_move(state: State) -> bool {
    matches!(state, State::Homing | State::Growing | State::Paused | State::Maintenance)
}

/// Returns whether filament may be fed in this state, so that a nozzle below the min extrusion temperature is a fault.
pub const fn may_feed(state: State) -> bool {
    matches!(state, State::Homing | State::Growing)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_state_can_be_stopped_and_faults_lead_to_rest() {
        for state in State::ALL {
            for event in [Event::Stop, Event::Fault, Event::EmergencyStop] {
                let to = next_state(state, event).expect("taken in every state");
                assert!(!may_heat(to) && !may_move(to), "{state:?} and {event:?} lead to {to:?}");
            }
        }
    }

    #[test]
    fn only_a_start_heats_and_motion_needs_heat() {
        for state in State::ALL {
            for event in Event::ALL {
                let Some(to) = next_state(state, event) else { continue };
                if !may_heat(state) && may_heat(to) {
                    assert!(
                        matches!(event, Event::Start | Event::Tune | Event::Preheat),
                        "{state:?} and {event:?} heat"
                    );
                }
                if !may_move(state) && may_move(to) {
                    // In maintenance the controller refuses to move with a cold nozzle.
                    assert!(
                        matches!((state, event), (State::Heating, Event::TemperatureReached) | (_, Event::Preheat)),
                        "{state:?} and {event:?} move"
                    );
                }
            }
        }
    }

    #[test]
    fn latched_states_end_only_by_clearing() {
        for state in [State::Fault, State::EmergencyStop] {
            for event in Event::ALL {
                let leaves = next_state(state, event).is_some_and(|to| to != state);
                assert_eq!(leaves, event == Event::Clear, "{state:?} and {event:?}");
            }
        }
    }

    /// Returns the rows of a table of SAFETY.md that follows the text `from`, as cells.
    fn rows(from: &'static str) -> impl Iterator<Item = std::vec::Vec<&'static str>> {
        let (_, rest) = include_str!("../../../SAFETY.md").split_once(from).expect("SAFETY.md has the table");
        let rows = rest.trim_start_matches('\n').lines().take_while(|row| row.starts_with('|')).skip(2);
        rows.map(|row| row.trim_matches('|').split('|').map(str::trim).collect())
    }

    #[test]
    fn safety_md_lists_the_states_that_may_heat_and_move() {
        let mut states = 0;
        for row in rows("\n## States\n") {
            for name in row[0].split(", ") {
                let state = *State::ALL.iter().find(|state| state.name() == name).expect("a state");
                assert_eq!(may_heat(state), row[1] != "off", "{state:?}");
                assert_eq!(may_move(state), row[2] != "off", "{state:?}");
                states += 1;
            }
        }
        assert_eq!(states, State::ALL.len());
    }

    #[test]
    fn safety_md_lists_the_states_that_need_hot_plastic() {
        let (_, faults) = include_str!("../../../SAFETY.md").split_once("\n| `under-temperature` |").expect("its row");
        let states = faults.lines().next().and_then(|row| row.split('|').nth(1)).expect("where it is looked for");
        for state in State::ALL {
            assert_eq!(may_feed(state), states.split(',').any(|name| name.trim() == state.name()), "{state:?}");
        }
    }

    #[test]
    fn every_state_is_reachable_from_the_initial_one() {
        let mut reached = std::vec![State::SelfTest];
        let mut next = 0;
        while let Some(state) = reached.get(next).copied() {
            next += 1;
            for to in Event::ALL.iter().filter_map(|event| next_state(state, *event)) {
                if !reached.contains(&to) {
                    reached.push(to);
                }
            }
        }
        assert_eq!(reached.len(), State::ALL.len());
    }
}
