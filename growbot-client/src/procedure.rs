//! Procedures: the steps of calibration and commissioning, which a person begins. On a terminal at the robot, they are
//! `growbot tune` and `growbot doctor`.
//!
//! A program that shows a procedure shows a sequence of recovery that interrupts first, and continues the procedure
//! after it. It begins a procedure only while heater and motors are off. It ends the procedure when the connection to
//! the robot is lost, because nothing is known of the steps before then.

use serde::Serialize;
use strum::IntoStaticStr;

use crate::recovery::{RecoveryAction, RecoveryStep};

/// Name of a procedure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, IntoStaticStr)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum ProcedureName {
    /// The gains of the heater are found.
    Calibration,
    /// The parts of the robot are checked, one after the other.
    Commissioning,
}

/// Steps that a person begins.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Procedure {
    /// Name of the procedure.
    pub name: ProcedureName,
    /// Reason to begin it.
    pub cause: &'static str,
    /// State of heater and motors between the steps, as a sentence.
    pub safety: &'static str,
    /// Steps in order.
    pub steps: Vec<RecoveryStep>,
}

/// State of heater and motors between the steps.
const SAFETY: &str = "Heater and motors are off until a step switches them on. They go off 10 minutes after the latest \
                      task, and the heater when it is tuned.";
/// Instruction before the feed pushes filament with a cold nozzle.
pub const FREE_FILAMENT: &str =
    "Take the filament out of the nozzle, so that it moves freely, and mark it where it enters the feed.";

impl Procedure {
    /// Returns all procedures.
    pub fn all() -> [Self; 2] {
        use RecoveryAction::{Cooldown, DryRun, Home, Jog, Preheat, Tune};
        let calibration = vec![
            Tune.into(),
            "Write the gains that are shown to the robot file, and configure the board with it.".into(),
        ];
        // Like `growbot doctor`: sensors first, then motors, and the heater last.
        let commissioning = vec![
            "Disconnect the heater. The status must name the description of this robot.".into(),
            "Compare the temperature of the nozzle with that of the room. They must be within 5 C.".into(),
            "Press the emergency stop button. The robot must show that it is pressed.".into(),
            FREE_FILAMENT.into(),
            DryRun.into(),
            Home.into(),
            Jog.into(),
            Cooldown.into(),
            "Connect the heater, with nothing near the nozzle that can burn.".into(),
            Preheat.into(),
            "Compare the temperature with its target. It must have risen without a break, and hold.".into(),
            Cooldown.into(),
        ];
        [
            Self {
                name: ProcedureName::Calibration,
                cause: "the heater is new, or its nozzle, sensor or supply",
                safety: SAFETY,
                steps: calibration,
            },
            Self {
                name: ProcedureName::Commissioning,
                cause: "the robot or its wiring is new; growbot doctor has these steps with limits and a report",
                safety: SAFETY,
                steps: commissioning,
            },
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recovery::StepEffect;

    #[test]
    fn commissioning_ends_off_and_heats_last() {
        let [_, commissioning] = Procedure::all();
        let first = |effect| commissioning.steps.iter().position(|step| step.effect == effect).unwrap();
        assert!(first(StepEffect::Moves) < first(StepEffect::Heats));
        assert_eq!(commissioning.steps.last().unwrap().action, Some(RecoveryAction::Cooldown));
    }

    /// SAFETY.md has the state in which a procedure leaves the robot.
    #[test]
    fn safety_md_has_every_procedure() {
        let safety = include_str!("../../SAFETY.md");
        for Procedure { name, safety: state, .. } in Procedure::all() {
            let row = format!("| `{}` | {state} |", <&str>::from(name));
            assert!(safety.contains(&row), "{row}");
        }
    }
}
