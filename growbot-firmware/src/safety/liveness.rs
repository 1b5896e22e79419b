//! The condition for feeding the watchdog: all parts of the firmware that keep the robot safe have shown that they run.

/// The parts of the firmware that have run since the watchdog was last fed.
#[derive(Debug, Clone, Copy, Default)]
pub struct LivenessCheck {
    /// True if the thermistor's ADC has been sampled.
    pub sampler: bool,
    /// True if the heater's duty has been computed again.
    pub regulator: bool,
    /// True if all inputs that can indicate danger have been checked.
    pub supervisor: bool,
    /// True if the step interrupt has run.
    pub steps: bool,
}

impl LivenessCheck {
    /// Returns `true` once all parts have run, and clears the flags. Feed the watchdog only if the result is `true`.
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
