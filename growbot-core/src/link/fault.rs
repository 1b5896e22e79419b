//! The faults of a board, with their codes and explanations.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr, VariantArray};

/// A fault of a board. Every fault switches the heater and the steppers off.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema, EnumString, IntoStaticStr, VariantArray,
)]
#[strum(serialize_all = "kebab-case")]
pub enum Fault {
    /// The thermistor reads as if its wire were cut.
    ThermistorOpen,
    /// The thermistor reads as if its wires touched.
    ThermistorShort,
    /// There has been no temperature reading for half a second.
    ThermistorSilent,
    /// The nozzle is hotter than the robot's max temperature.
    OverTemperature,
    /// The nozzle cooled below the min extrusion temperature while growing.
    UnderTemperature,
    /// The nozzle did not reach its target temperature within the robot's heating timeout.
    HeatingTooSlow,
    /// In homing, the head made one and a half turns without passing its index mark.
    IndexNotFound,
    /// A layer needs steps at a higher rate than the step interrupt makes them.
    StepRate,
    /// A pin of the board, or its output for the heater, did not carry out a command.
    Hardware,
    /// The reading of the thermistor does not change although the heater's power varies.
    ThermistorFrozen,
    /// The reading of the thermistor fell faster than the nozzle can cool.
    ThermistorDetached,
    /// The nozzle cools although it is heated with the expected power.
    TemperatureDrop,
    /// The nozzle gets hotter, or does not cool, although the heater is off.
    HeaterStuckOn,
    /// The heater uses more energy than the nozzle can need.
    HeaterEnergy,
    /// While laying layers, the head made a full turn without passing its index mark.
    IndexMissing,
    /// The index sensor detects its mark at every angle.
    IndexStuck,
    /// The index mark was detected at another angle than expected, because the head has lost or gained steps.
    HeadStepsLost,
    /// The filament has run out.
    FilamentOut,
    /// The feed runs, but the filament does not move.
    FilamentJam,
    /// A stepper driver reports a fault.
    DriverFault,
    /// The supply's voltage is below the robot's min.
    SupplyLow,
    /// The supply's voltage is above the robot's max.
    SupplyHigh,
    /// A layer, or the homing, took longer than it may.
    MotionOverdue,
    /// The step interrupt has stopped.
    StepsStalled,
    /// The board restarted during operation because its supply voltage dropped.
    BrownOut,
    /// The board restarted during operation because its watchdog was not fed.
    WatchdogReset,
    /// The board restarted during operation because its processor faulted.
    ProcessorFault,
    /// The board restarted during operation because its stack overflowed.
    StackOverflow,
    /// The board restarted during operation because of a loss of power or an external reset.
    PowerLost,
    /// The nozzle gets hotter although the heater's second switch is open.
    HeaterSwitchWelded,
    /// The firmware image in the board's flash does not match the CRC in its seal.
    ImageCorrupt,
    /// The crystal does not oscillate, so the board's clock is not reliable.
    ClockFailed,
    /// A debug probe has enabled debugging of the processor, so it could halt with the heater on.
    DebugProbe,
}

impl Fault {
    /// All faults.
    pub const ALL: [Self; 33] = *Self::VARIANTS.as_array().unwrap();

    /// Returns the code of the fault, as programs print it.
    pub fn code(self) -> &'static str {
        self.into()
    }

    /// Returns a description of the fault and its remedy.
    pub const fn explanation(self) -> &'static str {
        match self {
            Self::ThermistorOpen => {
                "the thermistor's reading is that of an open circuit: check its connector and wires"
            }
            Self::ThermistorShort => {
                "the thermistor's reading is that of a short circuit: check the insulation of its wires"
            }
            Self::ThermistorSilent => "no temperature reading for 0.4 s or longer: check the board",
            Self::OverTemperature => {
                "the nozzle got hotter than heater.max_c, or was about to: check the heater's switches and the \
                 thermistor's seat"
            }
            Self::UnderTemperature => {
                "the nozzle cooled below heater.extrusion_min_c while growing or while filament was fed: check heater, \
                 fan and draught"
            }
            Self::HeatingTooSlow => {
                "the nozzle was not hot within heater.heating_timeout_s, or warmed less than the heater's power should \
                 warm it: check heater, supply and the thermistor's seat"
            }
            Self::IndexNotFound => {
                "the head turned one and a half turns without passing its index mark: check the sensor, the motor \
                 and its driver"
            }
            Self::StepRate => {
                "a layer needs more than one motor step in two ticks of the step interrupt: raise motion.tick_hz, or \
                 lower head.steps_per_turn or feed.steps_per_mm"
            }
            Self::Hardware => "a pin or the heater's output refused a command: check the board",
            Self::ThermistorFrozen => {
                "the thermistor's reading does not change although the heater's power varies: check the ADC and the \
                 board"
            }
            Self::ThermistorDetached => {
                "the measured temperature fell faster than the nozzle can cool: check that the thermistor sits in its \
                 place"
            }
            Self::TemperatureDrop => {
                "the nozzle cools although the heater is driven: check the heater, its wires, the thermistor's seat \
                 and draught"
            }
            Self::HeaterStuckOn => {
                "the nozzle gets hotter, or cools less, than the heater's duty allows: the heater's power stage \
                 conducts by itself, or the thermistor does not follow; replace it"
            }
            Self::HeaterSwitchWelded => {
                "the nozzle gets hotter although the heater's second switch is open: the switch conducts by itself; \
                 replace it"
            }
            Self::HeaterEnergy => {
                "the heater takes more energy than the nozzle needs: check the thermistor's seat, the fan and draught"
            }
            Self::IndexMissing => {
                "the head made a turn without passing its index mark: check the head's motor, its driver and the index \
                 sensor"
            }
            Self::IndexStuck => {
                "the index sensor reports its mark over a wider angle than the mark has: check the sensor and its \
                 wire, that the head turns, and head.index_width_deg"
            }
            Self::HeadStepsLost => {
                "the index mark is at another position, so the head has lost or gained steps: remove what blocks the \
                 head, raise the motor's current, or lower the speed"
            }
            Self::FilamentOut => "there is no filament: load a spool",
            Self::FilamentJam => {
                "the feed turns, but the filament does not move: check for a knot, a clogged nozzle, or a feed that \
                 grinds"
            }
            Self::DriverFault => {
                "a stepper driver reports a fault: check its temperature, its supply and the motor's wires"
            }
            Self::SupplyLow => {
                "the supply's voltage fell below supply.min_v, or could not be measured: check the supply and its \
                 wires, and the wires to the board's measuring input"
            }
            Self::SupplyHigh => "the supply's voltage rose above supply.max_v: check the supply",
            Self::MotionOverdue => {
                "a layer or the homing took too long: the step interrupt is late or has stopped; check the board"
            }
            Self::StepsStalled => "the step interrupt has stopped: check the board",
            Self::BrownOut => "the supply dropped during operation and the board restarted: check the supply",
            Self::WatchdogReset => {
                "the firmware hung during operation and the watchdog restarted the board: please report it"
            }
            Self::ProcessorFault => "the processor faulted and the board restarted: please report it",
            Self::StackOverflow => "the stack overflowed and the board restarted: please report it",
            Self::ImageCorrupt => {
                "the firmware in the board's flash does not match its seal: flash the board again; if the fault \
                 returns, replace the board"
            }
            Self::PowerLost => {
                "the board was reset or lost power during operation: the nozzle may have stood still on the body; \
                 check the layer"
            }
            Self::ClockFailed => {
                "the board's crystal has stopped or did not start, and its other oscillator is too inaccurate for \
                 heating: check the crystal, then reset the board"
            }
            Self::DebugProbe => {
                "a debug probe is or was attached: in debug mode the processor may halt with the heater on. Detach the \
                 probe and disconnect the board's power for a moment; for a test bench set test_bench = true in the \
                 robot file"
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn every_fault_has_a_unique_explanation_and_a_remedy() {
        let explanations = BTreeSet::from(Fault::ALL.map(Fault::explanation));
        assert_eq!(explanations.len(), Fault::ALL.len());
        for explanation in explanations {
            let (what, remedy) = explanation.split_once(": ").unwrap_or_default();
            assert!(what.len() > 10 && remedy.len() > 10, "{explanation}");
        }
    }
}
