//! Readings of the tip's sensors.

use growbot_core::robot::Robot;
use growbot_core::simulation::ErrorModel;
use growbot_firmware::thermistor::{self, FULL_SCALE};

use super::cartridge::resistance_104gt_2;
use super::noise::noise;
use super::{Motor, TipFault, TipModel};

/// Channel of the ADC. Each channel has its own noise.
#[derive(Debug, Clone, Copy)]
enum SensorChannel {
    Thermistor,
    Supply,
}

/// Length of filament from the filament switch to the feed, mm. Two layers of robot A use less filament. So the robot
/// can finish the layers in its step engine after the filament's end has passed the switch.
const SWITCH_AHEAD_MM: f64 = 200.0;

impl TipModel {
    /// Returns the thermistor's voltage, counts of the ADC. `None` while the ADC delivers no readings.
    pub fn sample_thermistor(&mut self) -> Option<u16> {
        self.sync();
        if self.faults.has(TipFault::ThermistorSilent) {
            return None;
        }
        Some(if self.faults.has(TipFault::ThermistorFrozen) { self.held.number } else { self.converted_thermistor() })
    }

    /// Returns the thermistor's reading as the ADC converts it now.
    pub(super) fn converted_thermistor(&self) -> u16 {
        self.convert(self.thermistor_counts(), SensorChannel::Thermistor)
    }

    /// Returns the thermistor's voltage in counts of the ADC, without noise and rounding.
    pub(super) fn thermistor_counts(&self) -> f64 {
        if self.faults.has(TipFault::ThermistorOpen) {
            f64::from(FULL_SCALE)
        } else if self.faults.has(TipFault::ThermistorShort) {
            0.0
        } else if self.faults.has(TipFault::ThermistorStuck) {
            self.held.counts
        } else {
            let thermistor = &self.robot.description().thermistor;
            match self.variation.parts {
                None => thermistor::raw_from_celsius(self.nozzle.sensor(), thermistor),
                Some(_) => {
                    let ohm = resistance_104gt_2(self.nozzle.sensor());
                    ohm / (ohm + thermistor.pull_up_ohm) * f64::from(FULL_SCALE)
                }
            }
        }
    }

    /// Returns the supply's voltage, counts of the ADC.
    pub fn sample_supply(&mut self) -> Option<u16> {
        self.sync();
        let supply = &self.robot.description().supply;
        Some(self.convert(self.supply_v() / supply.full_scale_v * f64::from(FULL_SCALE), SensorChannel::Supply))
    }

    /// Converts a voltage, given in counts, to a reading of the 12-bit ADC, with noise.
    fn convert(&self, counts: f64, channel: SensorChannel) -> u16 {
        let noisy = counts + self.variation.noise_counts * noise(self.variation.seed, channel as u64, self.now);
        libm::rint(noisy).clamp(0.0, f64::from(FULL_SCALE)) as u16
    }

    /// Reports whether the index sensor detects its mark.
    pub fn on_index(&self) -> bool {
        if self.faults.has(TipFault::IndexDead) {
            return false;
        }
        self.faults.has(TipFault::IndexStuck) || self.mark.covers(self.position)
    }

    /// Reports whether the index sensor's level depends on the head's steps.
    pub fn index_follows(&self) -> bool {
        let dead = self.faults.has(TipFault::IndexDead) || self.faults.has(TipFault::IndexStuck);
        !dead && !self.head_is_held()
    }

    /// Reports whether the switch in the filament's path detects filament.
    pub fn has_filament(&self) -> bool {
        self.filament.left() > SWITCH_AHEAD_MM && !self.faults.has(TipFault::FilamentOut)
    }

    /// Returns the level of the encoder that the filament turns. It rises once for each pulse's length of filament that
    /// actually moves.
    pub fn encoder(&self) -> bool {
        self.filament.encoder()
    }

    /// Returns lower bounds of the numbers of steps of the head and of the feed until a sensor's level may change,
    /// including the step of the change, in either direction.
    pub fn steps_to_next_edge(&self) -> [u32; 2] {
        let feed = self.steps_to_switch().min(self.steps_to_pulse());
        [self.steps_to_mark(), feed]
    }

    fn steps_to_mark(&self) -> u32 {
        if self.to_slip != 0 {
            return 1;
        }
        if self.index_follows() { self.mark.steps_to_edge(self.position) } else { u32::MAX }
    }

    fn steps_to_pulse(&self) -> u32 {
        // If each layer moves the encoder differently, any step may change it.
        if self.imperfection == ErrorModel::default() { self.filament.steps_to_edge() } else { 1 }
    }

    fn steps_to_switch(&self) -> u32 {
        let steps_per_mm = self.robot.description().feed.steps_per_mm;
        ((self.filament.left() - SWITCH_AHEAD_MM).abs() * steps_per_mm).max(1.0) as u32
    }

    /// Returns the length of filament by which the encoder has turned so far, and the length by which each further feed
    /// step of the current layer turns it. Both are in feed steps.
    pub fn encoder_mapping(&mut self) -> (f64, f64) {
        (self.filament.turned(), self.seen_per_step())
    }

    /// Reports whether the filament moves when the feed motor makes steps.
    pub fn filament_moves_with_feed(&mut self) -> bool {
        self.sync();
        let min_c = self.robot.description().heater.extrusion_min_c;
        let cold = self.nozzle.block() < min_c && self.filament.is_at_front();
        !cold && self.has_filament() && !self.filament_is_held() && !self.faults.has(TipFault::DriverFault)
    }

    /// Reports whether a stepper driver reports a fault.
    pub fn driver_fault(&self) -> bool {
        self.faults.has(TipFault::DriverFault)
    }

    /// Reports whether the emergency stop is pressed.
    pub fn is_emergency_stop_pressed(&self) -> bool {
        self.faults.has(TipFault::EmergencyStop)
    }

    /// Returns the reading of the orientation sensor: a vector in the tip's frame that points upwards, as a resting
    /// accelerometer measures gravity, in thousandths of the earth's gravity. Returns `None` if the sensor does not
    /// respond.
    pub fn gravity(&mut self) -> Option<[i16; 3]> {
        if self.faults.has(TipFault::OrientationSilent) {
            return None;
        }
        let base_from_tip = self.base_from_tip();
        let up = self.imperfection.up(self.plastic.layer_index(), &base_from_tip);
        Some([up.x, up.y, up.z].map(|share| libm::rint(1000.0 * share) as i16))
    }

    /// Reports whether any motor is energised.
    pub fn steppers_are_on(&self) -> bool {
        self.is_enabled(Motor::Head) || self.is_enabled(Motor::Feed)
    }
}

/// Returns the number of feed steps from one rising edge of a robot's filament encoder to the next, in units of 1/256
/// step. Returns 0 for a robot without an encoder.
pub fn encoder_pitch(robot: &Robot) -> u32 {
    let description = robot.description();
    description
        .sensors
        .filament_motion
        .map_or(0, |motion| libm::rint(256.0 * motion.mm_per_pulse * description.feed.steps_per_mm) as u32)
}
