//! The condition for feeding the watchdog: all parts that keep the robot safe have shown that they run.

/// The parts that have reported since the watchdog was last fed.
#[derive(Debug, Clone, Copy, Default)]
pub struct LivenessCheck {
    /// The thermistor's ADC has been sampled.
    pub sampler: bool,
    /// The heater's duty has been computed again.
    pub regulator: bool,
    /// All inputs that can indicate danger have been checked.
    pub supervisor: bool,
    /// The step interrupt has run.
    pub steps: bool,
}

impl LivenessCheck {
    /// Returns `true` once all parts have reported, and clears the reports. Feed the watchdog only if the result is
    /// `true`.
    pub fn take_if_complete(&mut self) -> bool {
        let complete = self.sampler && self.regulator && self.supervisor && self.steps;
        if complete {
            *self = Self::default();
        }
        complete
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_missing_proof_withholds_the_watchdog_feed() {
        let all = LivenessCheck { sampler: true, regulator: true, supervisor: true, steps: true };
        for mut incomplete in [
            LivenessCheck { sampler: false, ..all },
            LivenessCheck { regulator: false, ..all },
            LivenessCheck { supervisor: false, ..all },
            LivenessCheck { steps: false, ..all },
        ] {
            assert!(!incomplete.take_if_complete());
        }
        let mut proof = all;
        assert!(proof.take_if_complete());
        assert!(!proof.take_if_complete(), "each time anew");
    }
}
