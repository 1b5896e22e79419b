//! Guided sequences: the steps by which a person brings a robot out of a state that needs a person.
//!
//! A sequence follows from the status of the robot alone. A program that has begun it requests the status again after
//! each step, and gives it up for a situation that interrupts it. A person can leave it after any step: the robot then
//! stays in the state that its board reports.

use growbot_core::link::message::{PauseCause, State};
use serde::Serialize;
use strum::{IntoStaticStr, VariantArray};

use crate::status::{ConnectionState, RobotStatus};
use crate::stop_signal::StopLevel;

/// Situation that a sequence ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, IntoStaticStr, VariantArray)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Situation {
    /// The board has not confirmed a stop.
    UnconfirmedStop,
    /// The robot is not connected.
    Disconnected,
    /// A fault is latched.
    Fault,
    /// The emergency stop is latched.
    EmergencyStop,
    /// The growth pauses because the filament has run out.
    FilamentOut,
    /// The growth pauses because a person or a host requested it, or because its host was silent.
    Paused,
    /// A pause exceeded the limit of the robot, so the board switched the heater off.
    Parked,
    /// The robot has no filament, and no growth is active.
    NoFilament,
    /// The board stores a body that is not complete, and no growth is active.
    Unfinished,
    /// The nozzle is hot for maintenance, or the motors may move in a dry run.
    Maintenance,
    /// The heater is being tuned.
    Tuning,
}

impl Situation {
    /// All situations.
    pub const ALL: &'static [Self] = Self::VARIANTS;

    /// Returns true if a sequence for another situation must not go on once the robot is in this one.
    pub const fn interrupts(self) -> bool {
        matches!(self, Self::UnconfirmedStop | Self::Disconnected | Self::Fault | Self::EmergencyStop)
    }

    /// Returns the code of the situation.
    pub fn code(self) -> &'static str {
        self.into()
    }

    /// Returns what is safe in this situation, as a sentence.
    pub const fn safety(self) -> &'static str {
        match self {
            Self::UnconfirmedStop => "Nothing is known to be safe: the robot may be hot or moving.",
            Self::Disconnected => "The board acts alone: it pauses at the latest when its layers end, and parks later.",
            Self::Fault | Self::EmergencyStop => "Heater and motors are off, until the cause is cleared.",
            Self::FilamentOut | Self::Paused => {
                "The nozzle may be hot. Nothing moves. After a long pause the robot parks."
            }
            Self::Parked => "Heater and motors are off. The board keeps the body.",
            Self::Unfinished => "Heater and motors are off.",
            Self::NoFilament => "The nozzle may be hot from maintenance. Nothing moves by itself.",
            Self::Maintenance => "The nozzle may be hot. It goes off 10 minutes after the latest task.",
            Self::Tuning => "The nozzle is hot. Nothing moves. The heater goes off when the gains are found.",
        }
    }
}

/// Action of a program in a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, IntoStaticStr, VariantArray)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum RecoveryAction {
    /// Clear the fault or the emergency stop.
    ClearFault,
    /// Continue the growth that pauses.
    Continue,
    /// Resume the unfinished body.
    Resume,
    /// Switch heater and motors off.
    Stop,
    /// Discard the body.
    Cancel,
    /// Withdraw the stop that the board has not confirmed.
    WithdrawStop,
    /// Heat the nozzle.
    Preheat,
    /// Push filament in.
    Load,
    /// Push filament through the nozzle.
    Purge,
    /// Switch the heater off after maintenance.
    Cooldown,
    /// Let head and feed move with the heater off.
    DryRun,
    /// Turn the head to its index mark.
    Home,
    /// Move a short length of filament.
    Jog,
    /// Find the gains of the heater's control loop.
    Tune,
}

impl RecoveryAction {
    /// All actions.
    pub const ALL: &'static [Self] = Self::VARIANTS;

    /// Returns the code of the action.
    pub fn code(self) -> &'static str {
        self.into()
    }

    /// Returns the effect of the action on the robot.
    pub const fn effect(self) -> StepEffect {
        match self {
            Self::ClearFault | Self::Stop | Self::Cooldown => StepEffect::Safe,
            Self::Continue | Self::Resume => StepEffect::HeatsAndMoves,
            Self::Preheat | Self::Tune => StepEffect::Heats,
            Self::Load | Self::Purge | Self::DryRun | Self::Home | Self::Jog => StepEffect::Moves,
            Self::Cancel => StepEffect::Discards,
            Self::WithdrawStop => StepEffect::MayStayOn,
        }
    }

    /// Returns the instruction of the step.
    const fn instruction(self) -> &'static str {
        match self {
            Self::ClearFault => "Clear it.",
            Self::Continue => "Continue the growth.",
            Self::Resume => "Resume the body at its first layer that is not laid.",
            Self::Stop => "Switch heater and motors off. A body can be resumed.",
            Self::Cancel => "Discard the body. It cannot be resumed after that.",
            Self::WithdrawStop => "Withdraw the stop, if you have seen that the robot is off.",
            Self::Preheat => "Heat the nozzle, and wait until it is hot.",
            Self::Load => "Push the new filament in.",
            Self::Purge => "Push filament through the nozzle, until it comes out clean.",
            Self::Cooldown => "Switch the heater off.",
            Self::DryRun => "Switch the motors on, with the heater off.",
            Self::Home => "Turn the head. It must stop at its index mark.",
            Self::Jog => "Push 10 mm of filament in. It must move by that length.",
            Self::Tune => "Tune the heater. The temperature swings around that of a growth for some minutes.",
        }
    }

    /// Returns the value of the maintenance task with this name. Empty if the task has its default value.
    pub const fn value(self) -> &'static str {
        match self {
            Self::Jog => "10",
            _ => "",
        }
    }
}

/// Effect of a step on the robot. Each step that is not safe needs its own confirmation by a person.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum StepEffect {
    /// The step neither heats nor moves anything.
    Safe,
    /// The step heats the nozzle.
    Heats,
    /// The step moves head or filament.
    Moves,
    /// The step heats the nozzle, and then moves head and filament.
    HeatsAndMoves,
    /// The step deletes the body on the board.
    Discards,
    /// After the step the robot may stay on.
    MayStayOn,
}

/// A step of a sequence.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct RecoveryStep {
    /// Instruction, as a sentence.
    pub text: String,
    /// Action of the program. Null if the person acts.
    pub action: Option<RecoveryAction>,
    /// Value of the maintenance task that the action runs. Empty if it has its default value.
    pub value: &'static str,
    /// Effect on the robot.
    pub effect: StepEffect,
}

impl From<RecoveryAction> for RecoveryStep {
    fn from(action: RecoveryAction) -> Self {
        Self {
            text: action.instruction().to_owned(),
            action: Some(action),
            value: action.value(),
            effect: action.effect(),
        }
    }
}

impl From<String> for RecoveryStep {
    /// Returns a step in which the person acts.
    fn from(text: String) -> Self {
        Self { text, action: None, value: "", effect: StepEffect::Safe }
    }
}

impl From<&str> for RecoveryStep {
    fn from(text: &str) -> Self {
        text.to_owned().into()
    }
}

/// A guided sequence.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct RecoverySequence {
    /// Situation that the sequence ends.
    pub situation: Situation,
    /// True if the situation interrupts the sequence of another one.
    pub interrupts: bool,
    /// Cause of the situation.
    pub cause: String,
    /// State of heater and motors in the situation, as a sentence.
    pub safety: &'static str,
    /// Steps in order. The first is the next step.
    pub steps: Vec<RecoveryStep>,
    /// Step that may replace all others. Null if there is none.
    pub alternative: Option<RecoveryStep>,
}

impl RecoverySequence {
    /// Returns the sequence for a robot with this status. `None` if the robot needs no person.
    pub fn of(status: &RobotStatus) -> Option<Self> {
        let situation = situation(status)?;
        Some(Self {
            situation,
            interrupts: situation.interrupts(),
            cause: cause(situation, status),
            safety: situation.safety(),
            steps: steps(situation, status),
            alternative: alternative(situation, status).map(RecoveryStep::from),
        })
    }
}

/// Returns the situation of a robot. `None` if the robot needs no person.
fn situation(status: &RobotStatus) -> Option<Situation> {
    if status.pending_stop.is_some() {
        return Some(Situation::UnconfirmedStop);
    }
    if status.connection == ConnectionState::Disconnected {
        return Some(Situation::Disconnected);
    }
    let state = State::ALL.into_iter().find(|state| Some(state.name()) == status.state.as_deref())?;
    let is_unfinished = status.plan_id.is_some() && status.laid > 0 && status.laid < status.layers;
    let pauses_for = |cause: PauseCause| status.pause_cause.as_deref() == Some(cause.code());
    match state {
        State::Fault => Some(Situation::Fault),
        State::EmergencyStop => Some(Situation::EmergencyStop),
        State::Parked => Some(Situation::Parked),
        State::Paused if pauses_for(PauseCause::FilamentOut) => Some(Situation::FilamentOut),
        State::Paused if !pauses_for(PauseCause::LayersExhausted) => Some(Situation::Paused),
        State::Maintenance if has_filament(status) => Some(Situation::Maintenance),
        State::Maintenance => Some(Situation::NoFilament),
        State::Tuning => Some(Situation::Tuning),
        State::Idle | State::Stopped | State::Done if status.job.is_none() => match has_filament(status) {
            false => Some(Situation::NoFilament),
            true => is_unfinished.then_some(Situation::Unfinished),
        },
        _ => None,
    }
}

/// Reports whether the robot has filament, as far as it can detect that.
fn has_filament(status: &RobotStatus) -> bool {
    status.sensors.as_ref().is_none_or(|sensors| sensors.filament_present != Some(false))
}

fn cause(situation: Situation, status: &RobotStatus) -> String {
    let text = |text: &Option<String>| text.clone().unwrap_or_else(|| "unknown".to_owned());
    match situation {
        Situation::UnconfirmedStop => match status.pending_stop {
            Some(StopLevel::EmergencyStop) => "the board has not confirmed the emergency stop".to_owned(),
            _ => "the board has not confirmed the stop".to_owned(),
        },
        Situation::Disconnected => text(&status.connection_error),
        Situation::Fault => format!("{}: {}", text(&status.fault), text(&status.fault_explanation)),
        Situation::EmergencyStop => "the emergency stop was pressed or ordered".to_owned(),
        Situation::FilamentOut | Situation::Paused => text(&status.pause_explanation),
        Situation::Parked => format!("a long pause: {}", text(&status.pause_explanation)),
        Situation::NoFilament => "the filament switch sees no filament".to_owned(),
        Situation::Unfinished => format!("{} of {} layers of the body are laid", status.laid, status.layers),
        Situation::Maintenance => "a maintenance task has switched the heater or the motors on".to_owned(),
        Situation::Tuning => "the heater is being tuned".to_owned(),
    }
}

fn steps(situation: Situation, status: &RobotStatus) -> Vec<RecoveryStep> {
    use RecoveryAction::{ClearFault, Continue, Cooldown, Load, Preheat, Purge, Resume, Stop};
    let inspect = || RecoveryStep::from("Inspect the tip: nothing may touch it, and the last layer must stick.");
    let spool = || RecoveryStep::from("Put a new spool in, and push its filament up to the feed.");
    match situation {
        Situation::UnconfirmedStop => {
            vec!["Cut the robot's power, unless you see that it is off. The stop is sent as soon as it answers.".into()]
        }
        Situation::Disconnected => vec!["Check the robot's power and its cable.".into()],
        Situation::Fault => vec![
            format!("Remove the cause: {}.", status.fault_explanation.as_deref().unwrap_or("see SAFETY.md")).into(),
            ClearFault.into(),
        ],
        // A stop over the link reads as a pressed button for a moment, so the step does not depend on that reading.
        Situation::EmergencyStop => {
            let look =
                "Release the emergency stop button, and make sure that the robot can be switched on again safely.";
            vec![look.into(), ClearFault.into()]
        }
        Situation::FilamentOut => vec![spool(), Preheat.into(), Load.into(), Purge.into(), Continue.into()],
        Situation::Paused => vec![inspect(), Continue.into()],
        Situation::Parked if !has_filament(status) => vec![Stop.into()],
        Situation::Parked => vec![inspect(), Continue.into()],
        Situation::NoFilament => vec![spool(), Preheat.into(), Load.into(), Purge.into(), Cooldown.into()],
        Situation::Unfinished => vec![inspect(), Resume.into()],
        Situation::Maintenance => vec![Cooldown.into()],
        Situation::Tuning => vec!["Wait until the gains are found. That takes some minutes.".into()],
    }
}

fn alternative(situation: Situation, status: &RobotStatus) -> Option<RecoveryAction> {
    match situation {
        Situation::UnconfirmedStop => Some(RecoveryAction::WithdrawStop),
        Situation::FilamentOut | Situation::Paused | Situation::Tuning => Some(RecoveryAction::Stop),
        // The body of an active job is discarded only after a stop.
        Situation::Parked if status.job.is_some() => Some(RecoveryAction::Stop),
        Situation::Parked | Situation::Unfinished => Some(RecoveryAction::Cancel),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::status::SensorStatus;

    fn status(state: State) -> RobotStatus {
        RobotStatus { state: Some(state.name().to_owned()), ..RobotStatus::default() }
    }

    fn with_filament(present: bool, status: RobotStatus) -> RobotStatus {
        let sensors = SensorStatus {
            supply_v: None,
            on_index: false,
            filament_present: Some(present),
            filament_pulses: None,
            driver_fault: None,
            driver_problem: None,
            emergency_stop: None,
            gravity_g: None,
        };
        RobotStatus { sensors: Some(sensors), ..status }
    }

    /// Returns one status for each situation.
    fn statuses() -> Vec<(Situation, RobotStatus)> {
        let paused = |cause: PauseCause| RobotStatus {
            pause_cause: Some(cause.code().to_owned()),
            pause_explanation: Some(cause.explanation().to_owned()),
            ..status(State::Paused)
        };
        let unconfirmed = RobotStatus { pending_stop: Some(StopLevel::Stop), ..status(State::Growing) };
        let lost = RobotStatus { connection: ConnectionState::Disconnected, ..RobotStatus::default() };
        let fault = RobotStatus { fault_explanation: Some("check the board".to_owned()), ..status(State::Fault) };
        let unfinished = RobotStatus { plan_id: Some("1".to_owned()), laid: 3, layers: 9, ..status(State::Stopped) };
        vec![
            (Situation::UnconfirmedStop, unconfirmed),
            (Situation::Disconnected, lost),
            (Situation::Fault, fault),
            (Situation::EmergencyStop, status(State::EmergencyStop)),
            (Situation::FilamentOut, paused(PauseCause::FilamentOut)),
            (Situation::Paused, paused(PauseCause::Requested)),
            (Situation::Paused, paused(PauseCause::HostSilent)),
            (Situation::Parked, status(State::Parked)),
            (Situation::NoFilament, with_filament(false, status(State::Stopped))),
            (Situation::Unfinished, unfinished),
            (Situation::Maintenance, status(State::Maintenance)),
            (Situation::Tuning, status(State::Tuning)),
        ]
    }

    #[test]
    fn each_situation_follows_from_a_status() {
        let found = statuses();
        for (situation, status) in &found {
            let sequence = RecoverySequence::of(status).unwrap();
            assert_eq!(sequence.situation, *situation);
            assert!(!sequence.steps.is_empty() && !sequence.cause.is_empty(), "{sequence:?}");
        }
        for situation in Situation::ALL {
            assert!(found.iter().any(|(other, _)| other == situation), "{}", situation.code());
        }
    }

    #[test]
    fn a_robot_that_works_or_rests_needs_no_person() {
        for state in [State::Idle, State::Heating, State::Homing, State::Growing, State::Done, State::SelfTest] {
            assert_eq!(RecoverySequence::of(&status(state)), None, "{}", state.name());
        }
        let waits =
            RobotStatus { pause_cause: Some(PauseCause::LayersExhausted.code().to_owned()), ..status(State::Paused) };
        assert_eq!(RecoverySequence::of(&waits), None);
    }

    #[test]
    fn nothing_heats_or_moves_in_a_robot_that_is_off_for_a_cause() {
        for (situation, status) in statuses() {
            if situation.interrupts() {
                let steps = RecoverySequence::of(&status).unwrap().steps;
                assert!(steps.iter().all(|step| step.effect == StepEffect::Safe), "{steps:?}");
            }
        }
    }

    #[test]
    fn a_parked_robot_without_filament_is_stopped_before_it_is_loaded() {
        let parked = with_filament(false, status(State::Parked));
        let steps = RecoverySequence::of(&parked).unwrap().steps;
        assert_eq!(steps[0].action, Some(RecoveryAction::Stop));
        let stopped = with_filament(false, status(State::Stopped));
        assert_eq!(RecoverySequence::of(&stopped).unwrap().situation, Situation::NoFilament);
    }

    /// SAFETY.md lists each situation with what is safe, and each action with its effect.
    #[test]
    fn safety_md_has_every_situation_and_every_action() {
        let safety = include_str!("../../SAFETY.md");
        let (_, rest) = safety.split_once("\n## Guided recovery\n").unwrap();
        let section = rest.split("\n## ").next().unwrap();
        for situation in Situation::ALL {
            let row = format!("| `{}` | {} |", situation.code(), situation.safety());
            assert!(section.contains(&row), "{row}");
        }
        for action in RecoveryAction::ALL {
            let effect = serde_json::to_value(action.effect()).unwrap();
            let row = format!("| `{}` | {} |", action.code(), effect.as_str().unwrap().replace('-', " "));
            assert!(section.contains(&row), "{row}");
        }
    }
}
