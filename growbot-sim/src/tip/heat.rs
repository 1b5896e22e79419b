//! Heater, fan and supply of the simulated tip, and the temperature of its nozzle.

use super::nozzle_inputs::NozzleInputs;
use super::{HeaterInput, TipFault, TipModel};

impl TipModel {
    /// Sets the heater's signals: a fraction of full power (0 to 1), and the state of the second switch.
    pub fn set_heater(&mut self, duty: f64, closed: bool) {
        let input = HeaterInput { duty, closed };
        if self.heater != input {
            self.sync();
            self.heater = input;
            self.warmed &= closed;
            if let Some(celsius) = self.warm_at_once.filter(|_| closed && duty > 0.0 && !self.warmed) {
                self.nozzle.set(celsius.max(self.nozzle.block()));
                self.warmed = true;
            }
        }
    }

    /// Sets the fan's signal: a fraction of full speed (0 to 1).
    pub fn set_fan(&mut self, duty: f64) {
        if self.fan != duty {
            self.sync();
            self.fan = duty;
        }
    }

    /// Sets the supply's voltage, V. A fault of the supply overrides it.
    pub fn set_supply_v(&mut self, volts: f64) {
        self.sync();
        self.variation.supply_v = Some(volts);
    }

    /// Advances the nozzle to the present tick. The nozzle's inputs have been constant since it was advanced last.
    pub(super) fn sync(&mut self) {
        if let Some(end) = self.dip_until.take_if(|end| *end <= self.now) {
            let drive = self.drive();
            self.nozzle.advance(end, &drive);
            self.faults.remove(TipFault::SupplyDip { volts: 0.0, seconds: 0.0 });
        }
        if self.nozzle.tick() < self.now {
            let drive = self.drive();
            self.nozzle.advance(self.now, &drive);
        }
    }

    /// Advances the nozzle to the present tick if the current time slot of the filament flow (a tenth of a second) has
    /// ended.
    pub(super) fn sync_slot(&mut self) {
        if self.nozzle.slot_is_over(self.now) {
            self.sync();
        }
    }

    /// Returns the present inputs of the nozzle: heating power, heat loss, and the coupling of the thermistor.
    fn drive(&self) -> NozzleInputs {
        let description = self.robot.description();
        let heater = &description.heater;
        let mut drive = NozzleInputs {
            power_w: self.power(),
            loss_w_per_k: heater.loss_w_per_k * self.variation.loss + description.fan.loss_w_per_k * self.fan,
            lag_s: self.variation.sensor_lag_s,
            share: 1.0,
        };
        for fault in self.faults.iter() {
            match fault {
                TipFault::Draught { factor } => drive.loss_w_per_k *= factor,
                TipFault::ThermistorDetached { tau_s, share } => (drive.lag_s, drive.share) = (tau_s, share),
                _ => {}
            }
        }
        drive
    }

    /// Returns the actual power of the heater, W.
    pub fn heater_power_w(&mut self) -> f64 {
        self.sync();
        self.power()
    }

    fn power(&self) -> f64 {
        let description = self.robot.description();
        let closed = self.heater.closed || self.faults.has(TipFault::SecondSwitchClosed);
        let duty = if self.faults.has(TipFault::PowerStageOn) { 1.0 } else { self.heater.duty };
        if !closed || self.faults.has(TipFault::HeaterOpen) {
            return 0.0;
        }
        let voltage = self.supply_v() / description.supply.nominal_v;
        description.heater.power_w * self.variation.power * duty * voltage * voltage
    }

    /// Returns the voltage of the supply, V.
    pub(super) fn supply_v(&self) -> f64 {
        let sound = self.variation.supply_v.unwrap_or(self.robot.description().supply.nominal_v);
        self.faults.iter().fold(sound, |voltage, fault| match fault {
            TipFault::SupplyLow { volts } | TipFault::SupplyHigh { volts } | TipFault::SupplyDip { volts, .. } => volts,
            _ => voltage,
        })
    }

    /// Returns the temperature of the nozzle, degrees Celsius.
    pub fn nozzle_c(&mut self) -> f64 {
        self.sync();
        self.nozzle.block()
    }

    /// Returns the highest temperature that the nozzle has had, degrees Celsius.
    pub fn nozzle_peak_c(&mut self) -> f64 {
        self.sync();
        self.nozzle.peak()
    }

    /// Sets the temperature of the nozzle, degrees Celsius.
    pub fn set_nozzle_c(&mut self, celsius: f64) {
        self.sync();
        self.nozzle.set(celsius);
    }

    /// Sets the temperature, degrees Celsius, to which the nozzle jumps when its heater first gets power. It is for
    /// tests in real time, in which heating would take most of the time. If the jump came earlier or later, the
    /// firmware would rightly detect a heater out of control.
    pub fn preheat_instantly(&mut self, celsius: f64) {
        self.warm_at_once = Some(celsius);
    }

    /// Reports whether the heater's second switch is commanded to close.
    pub fn heater_is_on(&self) -> bool {
        self.heater.closed
    }

    /// Returns the heater's commanded fraction of full power, 0 to 1.
    pub fn heater_duty(&self) -> f64 {
        self.heater.duty
    }
}
