//! Names of enum variants in messages, files and JSON. Programs read them, so they do not follow the names in the code.

use std::collections::BTreeSet;
use std::fmt::Debug;

use growbot_client::robot_command::RobotCommand;
use growbot_core::link::message::{DriverProblem, Fault, Motor, PauseCause, ResetCause, State};
use growbot_core::plan::Planner;
use growbot_core::robot::{BoardKind, Signal};
use growbot_firmware::safety::transitions::Event;
use growbot_paper::experiments::ErrorQuantity;
use growbot_paper::slicing_rule::SlicingRule;
use growbot_pictures::export::body::LayerSource;
use growbot_pictures::export::foxglove::Topic;
use growbot_plan::growth_report::MeasuredBy;
use growbot_plan::job::Command;
use growbot_plan::run_log::{BodyKind, OutcomeKind};
use growbot_remote::api::JobState;
use growbot_serve::notification::NotificationEvent;
use growbot_serve::settings::Key;
use growbot_sim::tip::TipFault;
use serde::{Deserialize, Serialize};

/// Checks the names of all `count` variants of an enum.
#[track_caller]
fn check<T: Copy + Debug>(name: impl Fn(T) -> &'static str, count: usize, names: &[(T, &str)]) {
    for (variant, expected) in names {
        assert_eq!(name(*variant), *expected, "{variant:?}");
    }
    assert_eq!(names.iter().map(|(_, name)| name).collect::<BTreeSet<_>>().len(), count);
}

/// Checks the names of variants in JSON.
#[track_caller]
fn check_json<T: Copy + Debug + PartialEq + Serialize + for<'de> Deserialize<'de>>(names: &[(T, &str)]) {
    for (variant, name) in names {
        assert_eq!(serde_json::to_value(variant).unwrap(), *name);
        assert_eq!(serde_json::from_value::<T>((*name).into()).unwrap(), *variant);
    }
}

#[test]
fn names_of_the_board() {
    use {DriverProblem as D, Event as E, Fault as F, ResetCause as R, State as S};
    let faults = [
        (F::ThermistorOpen, "thermistor-open"),
        (F::ThermistorShort, "thermistor-short"),
        (F::ThermistorSilent, "thermistor-silent"),
        (F::OverTemperature, "over-temperature"),
        (F::UnderTemperature, "under-temperature"),
        (F::HeatingTooSlow, "heating-too-slow"),
        (F::IndexNotFound, "index-not-found"),
        (F::StepRate, "step-rate"),
        (F::Hardware, "hardware"),
        (F::ThermistorFrozen, "thermistor-frozen"),
        (F::ThermistorDetached, "thermistor-detached"),
        (F::TemperatureDrop, "temperature-drop"),
        (F::HeaterStuckOn, "heater-stuck-on"),
        (F::HeaterSwitchWelded, "heater-switch-welded"),
        (F::HeaterEnergy, "heater-energy"),
        (F::IndexMissing, "index-missing"),
        (F::IndexStuck, "index-stuck"),
        (F::HeadStepsLost, "head-steps-lost"),
        (F::FilamentOut, "filament-out"),
        (F::FilamentJam, "filament-jam"),
        (F::DriverFault, "driver-fault"),
        (F::SupplyLow, "supply-low"),
        (F::SupplyHigh, "supply-high"),
        (F::MotionOverdue, "motion-overdue"),
        (F::StepsStalled, "steps-stalled"),
        (F::BrownOut, "brown-out"),
        (F::WatchdogReset, "watchdog-reset"),
        (F::ProcessorFault, "processor-fault"),
        (F::StackOverflow, "stack-overflow"),
        (F::PowerLost, "power-lost"),
        (F::ImageCorrupt, "image-corrupt"),
        (F::ClockFailed, "clock-failed"),
        (F::DebugProbe, "debug-probe"),
    ];
    check(F::code, F::ALL.len(), &faults);
    let states = [
        (S::SelfTest, "self-test"),
        (S::Idle, "idle"),
        (S::Heating, "heating"),
        (S::Homing, "homing"),
        (S::Growing, "growing"),
        (S::Paused, "paused"),
        (S::Parked, "parked"),
        (S::Done, "done"),
        (S::Stopped, "stopped"),
        (S::Tuning, "tuning"),
        (S::Maintenance, "maintenance"),
        (S::Fault, "fault"),
        (S::EmergencyStop, "emergency-stop"),
    ];
    check(S::name, S::ALL.len(), &states);
    let events = [
        (E::Begin, "begin"),
        (E::Plan, "plan"),
        (E::Resume, "resume"),
        (E::Layers, "layers"),
        (E::Amend, "amend"),
        (E::Start, "start"),
        (E::Pause, "pause"),
        (E::Tune, "tune"),
        (E::Preheat, "preheat"),
        (E::CoolDown, "cool down"),
        (E::MoveHead, "move head"),
        (E::MoveFilament, "move filament"),
        (E::Stop, "stop"),
        (E::Cancel, "cancel"),
        (E::Clear, "clear"),
        (E::SelfTestPassed, "tested"),
        (E::TemperatureReached, "hot"),
        (E::Homed, "homed"),
        (E::LayersExhausted, "layers exhausted"),
        (E::LayersAvailable, "layers available"),
        (E::Finished, "finished"),
        (E::PauseTimeout, "paused too long"),
        (E::Tuned, "tuned"),
        (E::MaintenanceTimeout, "unattended"),
        (E::EmergencyStop, "emergency stop"),
        (E::Fault, "fault"),
    ];
    check(E::name, E::ALL.len(), &events);
    let problems = [
        (D::Silent, "silent"),
        (D::NotConfigured, "not-configured"),
        (D::Reset, "reset"),
        (D::Undervoltage, "undervoltage"),
        (D::Hot, "hot"),
        (D::OverTemperature, "over-temperature"),
        (D::ShortToGround, "short-to-ground"),
        (D::ShortToSupply, "short-to-supply"),
        (D::ShutDown, "shut-down"),
        (D::OpenLoad, "open-load"),
        (D::Stall, "stall"),
    ];
    check(D::code, D::ALL.len(), &problems);
    check(Motor::name, 2, &[(Motor::Head, "head"), (Motor::Feed, "feed")]);
    let causes = [
        (R::PowerOn, "power on"),
        (R::BrownOut, "brown-out"),
        (R::Watchdog, "watchdog"),
        (R::ProcessorFault, "processor fault"),
        (R::External, "reset from outside"),
        (R::StackOverflow, "stack overflow"),
        (R::ClockFailed, "clock failure"),
    ];
    check(R::name, 7, &causes);
    let pauses = [
        (PauseCause::LayersExhausted, "layers-exhausted"),
        (PauseCause::Requested, "requested"),
        (PauseCause::HostSilent, "host-silent"),
        (PauseCause::FilamentOut, "filament-out"),
    ];
    check(PauseCause::code, 4, &pauses);
}

#[test]
fn names_in_robot_files() {
    use {BoardKind as B, Signal as S};
    let boards = [(B::Stm32f405, "stm32f405"), (B::Pico, "pico"), (B::SkrPico, "skr-pico")];
    check(B::name, 3, &boards);
    check_json(&boards);
    let signals = [
        (S::HeadStep, "head_step"),
        (S::HeadDirection, "head_direction"),
        (S::HeadEnable, "head_enable"),
        (S::FeedStep, "feed_step"),
        (S::FeedDirection, "feed_direction"),
        (S::FeedEnable, "feed_enable"),
        (S::Heater, "heater"),
        (S::HeaterEnable, "heater_enable"),
        (S::Fan, "fan"),
        (S::DriverFault, "driver_fault"),
        (S::FilamentPresence, "filament_presence"),
        (S::FilamentMotion, "filament_motion"),
        (S::Index, "index"),
        (S::EmergencyStop, "emergency_stop"),
        (S::OrientationData, "orientation_data"),
        (S::OrientationClock, "orientation_clock"),
        (S::Thermistor, "thermistor"),
        (S::Supply, "supply"),
    ];
    check(S::name, S::ALL.len(), &signals);
}

#[test]
fn names_in_plans_run_logs_and_exports() {
    use {Command as C, OutcomeKind as O, Topic as T};
    let planners = [(Planner::TwoPlane, "two-plane"), (Planner::Shortest, "shortest")];
    check(Planner::name, 2, &planners);
    check_json(&planners);
    let commands = [
        (C::Continue, "continue"),
        (C::Pause, "pause"),
        (C::Preheat, "preheat"),
        (C::Unload, "unload"),
        (C::Load, "load"),
        (C::Purge, "purge"),
        (C::Stop, "stop"),
        (C::EmergencyStop, "emergency-stop"),
    ];
    check(C::name, C::ALL.len(), &commands);
    check_json(&commands);
    let outcomes = [
        (O::Done, "done"),
        (O::Stopped, "stopped"),
        (O::ClockDrift, "clock-drift"),
        (O::Fault, "fault"),
        (O::Parked, "parked"),
        (O::Interrupted, "interrupted"),
        (O::Lost, "lost"),
        (O::Refused, "refused"),
        (O::Unfinished, "unfinished"),
        (O::Unknown, "unknown"),
    ];
    check(O::name, 10, &outcomes);
    check_json(&outcomes);
    let sources = [(MeasuredBy::Tip, "tip"), (MeasuredBy::Estimate, "estimate"), (MeasuredBy::Steps, "steps")];
    check(MeasuredBy::name, 3, &sources);
    check_json(&sources);
    let kinds = [
        (BodyKind::Laid, "laid (simulated)"),
        (BodyKind::Commanded, "commanded (simulated)"),
        (BodyKind::AsBuilt, "as built"),
    ];
    check(BodyKind::name, 3, &kinds);
    let sources = [
        (LayerSource::Planned, "planned"),
        (LayerSource::AsBuilt, "as-built"),
        (LayerSource::Simulated, "laid-simulated"),
    ];
    check(LayerSource::name, 3, &sources);
    let topics = [
        (T::Start, "/start"),
        (T::Goal, "/goal"),
        (T::Tip, "/tip"),
        (T::Commanded, "/commanded"),
        (T::Plan, "/plan"),
        (T::Body, "/body"),
        (T::Layers, "/layers"),
        (T::Status, "/status"),
        (T::Faults, "/faults"),
        (T::Events, "/events"),
    ];
    check(T::name, T::ALL.len(), &topics);
}

#[test]
fn names_of_simulated_faults() {
    let names = TipFault::ALL.map(TipFault::name);
    let expected = "thermistor-open thermistor-short thermistor-silent thermistor-frozen thermistor-stuck \
                    thermistor-detached heater-open power-stage-on second-switch-closed draught index-dead index-stuck \
                    head-loses-steps head-gains-steps head-blocked filament-out filament-jam driver-fault supply-low \
                    supply-high supply-dip emergency-stop orientation-silent step-interrupt-stopped";
    assert_eq!(names.join(" "), expected);
}

#[test]
fn names_in_settings_results_and_the_service() {
    use {ErrorQuantity as Q, JobState as J, NotificationEvent as N, RobotCommand as C, SlicingRule as S};
    check(Key::name, Key::ALL.len(), &[(Key::Robot, "robot"), (Key::Port, "port")]);
    let rules = [
        (S::Text, "whole-text"),
        (S::Table, "whole-table"),
        (S::Half, "whole-half"),
        (S::Tenth, "whole-tenth"),
        (S::Exact, "exact"),
    ];
    check(S::name, 5, &rules);
    let quantities = [
        (Q::Position, "position_error_over_length"),
        (Q::Heading, "heading_error_deg"),
        (Q::Pitch, "pitch_error_deg"),
        (Q::Direction, "direction_error_deg"),
        (Q::Length, "path_length_over_radius"),
    ];
    check(Q::name, Q::ALL.len(), &quantities);
    let events = [
        (N::Finish, "finish"),
        (N::Fault, "fault"),
        (N::Pause, "pause"),
        (N::FilamentRunout, "filament-runout"),
        (N::Interrupted, "interrupted"),
        (N::Parked, "parked"),
        (N::EmergencyStop, "emergency-stop"),
        (N::Disconnected, "disconnected"),
        (N::BoardRestart, "board-restart"),
        (N::ServiceRestart, "service-restart"),
    ];
    check(N::name, N::ALL.len(), &events);
    check_json(&events);
    check_json(&[
        (C::Pause, "pause"),
        (C::Continue, "continue"),
        (C::Stop, "stop"),
        (C::EmergencyStop, "emergency-stop"),
        (C::ClearFault, "clear-fault"),
        (C::Cancel, "cancel"),
        (C::WithdrawStop, "withdraw-stop"),
    ]);
    check_json(&[(J::Active, "active"), (J::Interrupted, "interrupted"), (J::Done, "done"), (J::Failed, "failed")]);
}
