//! Manual actions on a tip, which commissioning requests from a person beside the robot.

use growbot_core::pose::Pose;
use growbot_firmware::stepping::MotorDirection;
use serde::{Deserialize, Serialize};

use super::{TipFault, TipModel};

/// A manual action.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ManualAction {
    /// Turns the head counter-clockwise by this number of 64ths of a turn.
    TurnHead(i32),
    /// Takes the filament out of the filament switch (true), or puts it back (false).
    TakeFilament(bool),
    /// Presses the emergency stop (true), or releases it (false).
    PressEmergencyStop(bool),
    /// Disconnects the heater (true), or connects it (false).
    DisconnectHeater(bool),
    /// Takes the filament out of the nozzle, so that it moves freely (true), or puts it back into the nozzle (false).
    FreeFilament(bool),
    /// Puts a full spool in place of the present one.
    ChangeSpool,
    /// Lays the tip on its side (true), or sets it upright (false).
    LayDown(bool),
}

impl TipModel {
    /// Performs a manual action on the tip, as if the motors were released.
    pub fn apply_action(&mut self, hand: ManualAction) {
        match hand {
            ManualAction::TurnHead(sixty_fourths) => {
                let steps = i64::from(sixty_fourths) * i64::from(self.mark.steps_per_turn) / 64;
                self.sync();
                for _ in 0..steps.unsigned_abs() {
                    self.plastic.turn(MotorDirection::of(sixty_fourths), self.now);
                }
                self.position += steps;
                self.slipped += steps;
            }
            ManualAction::TakeFilament(taken) => self.break_or_mend(TipFault::FilamentOut, taken),
            ManualAction::PressEmergencyStop(pressed) => self.break_or_mend(TipFault::EmergencyStop, pressed),
            ManualAction::DisconnectHeater(off) => self.break_or_mend(TipFault::HeaterOpen, off),
            ManualAction::FreeFilament(true) => self.filament.release(),
            ManualAction::FreeFilament(false) => self.filament.insert(),
            ManualAction::ChangeSpool => self.filament.refill(),
            ManualAction::LayDown(down) => {
                let pitch = if down { 0.0 } else { 90.0 };
                if let Ok(pose) = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, pitch]) {
                    self.start_at(&pose);
                }
            }
        }
    }

    fn break_or_mend(&mut self, fault: TipFault, breaks: bool) {
        if breaks {
            self.inject(fault);
        } else {
            self.clear_fault(fault);
        }
    }
}

#[cfg(test)]
mod tests {
    use growbot_plan::robot_file;

    use super::*;
    use crate::tip::Variation;
    use growbot_core::link::message::Motor;

    fn tip() -> TipModel {
        TipModel::new(robot_file::load("growbot-a".as_ref()).unwrap(), 0, Variation::default())
    }

    #[test]
    fn a_manual_turn_passes_the_index_mark_and_returns() {
        let mut tip = tip();
        let steps = i64::from(tip.mark.steps_per_turn);
        let mut seen = Vec::new();
        for _ in 0..64 {
            tip.apply_action(ManualAction::TurnHead(1));
            seen.push(tip.mark.covers(tip.head_position()));
        }
        assert!(seen.contains(&true) && seen.contains(&false));
        assert_eq!((tip.head_position(), tip.head_slip()), (steps, steps));
    }

    #[test]
    fn released_filament_passes_a_cold_nozzle() {
        let mut tip = tip();
        tip.set_enabled(Motor::Feed, true);
        tip.set_direction(Motor::Feed, MotorDirection::Forward);
        let feed = |tip: &mut TipModel| (0..100).for_each(|_| tip.step(Motor::Feed));
        feed(&mut tip);
        assert_eq!(tip.cold_feed_steps(), 100);
        tip.apply_action(ManualAction::FreeFilament(true));
        feed(&mut tip);
        assert_eq!(tip.cold_feed_steps(), 100);
        tip.apply_action(ManualAction::FreeFilament(false));
        feed(&mut tip);
        assert_eq!(tip.cold_feed_steps(), 200);
    }
}
