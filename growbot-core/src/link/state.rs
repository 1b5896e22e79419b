//! The states of a board, with their names.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};
use strum::{IntoStaticStr, VariantArray};

/// State of a board, which its firmware reports to hosts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum State {
    /// The board is inactive. Heater and steppers are off.
    Idle,
    /// The nozzle heats up. Nothing moves, because cold plastic may hold the nozzle.
    Heating,
    /// The head searches for its index mark.
    Homing,
    /// The board lays layers.
    Growing,
    /// The board pauses between layers, with the nozzle hot or at standby. It waits for layers, or for a request to
    /// continue.
    Paused,
    /// All layers of the job are laid. Heater and steppers are off.
    Done,
    /// A request stopped the job. Heater and steppers are off.
    Stopped,
    /// A fault is latched. Heater and steppers are off until the fault is cleared.
    Fault,
    /// The board has just started and tests its sensors. Everything is off.
    SelfTest,
    /// A pause lasted longer than the robot's limit, so the board switched the heater off. The board stores the job,
    /// and `Start` continues it.
    Parked,
    /// The board makes the temperature of the nozzle oscillate round a target to find the gains of the heater's
    /// controller.
    Tuning,
    /// The emergency stop was pressed. Heater and steppers are off until the emergency stop is released and cleared.
    EmergencyStop,
    /// The nozzle is hot, and head and feed move as a host requests, without a job. The board leaves this state by
    /// itself after some minutes.
    Maintenance,
}

impl State {
    /// All states.
    pub const ALL: [Self; 13] = *Self::VARIANTS.as_array().unwrap();

    /// Returns the state's name, as programs print it.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

#[cfg(test)]
mod tests {
    use super::super::fault::Fault;
    use super::*;
    use std::collections::BTreeSet;
    use std::vec::Vec;

    /// Returns the codes in the first column of the table in a section of SAFETY.md, in the order of the rows.
    fn first_column(section: &str) -> Vec<&'static str> {
        let safety = include_str!("../../../SAFETY.md");
        let (_, rest) = safety.split_once(section).unwrap_or_else(|| panic!("SAFETY.md has no section {section}"));
        let rows = rest.split("\n## ").next().unwrap_or_default().lines();
        // The first row is the heading. The line below it does not begin with `| `.
        let cells = rows.filter_map(|row| row.strip_prefix("| ")?.split('|').next()).skip(1);
        cells.flat_map(|cell| cell.split(',')).map(|code| code.trim().trim_matches('`')).collect()
    }

    #[test]
    fn safety_md_lists_every_fault_by_its_code() {
        let listed = first_column("\n## Faults\n");
        let codes = BTreeSet::from(Fault::ALL.map(Fault::code));
        assert_eq!(listed.iter().copied().collect::<BTreeSet<_>>(), codes);
        assert_eq!((listed.len(), codes.len()), (Fault::ALL.len(), Fault::ALL.len()), "one is there twice");
    }

    #[test]
    fn safety_md_lists_every_state_by_its_name() {
        // The table of events follows that of the states.
        let listed: BTreeSet<_> =
            first_column("\n## States\n").into_iter().take_while(|name| *name != "event").collect();
        assert_eq!(listed, BTreeSet::from(State::ALL.map(State::name)));
    }
}
