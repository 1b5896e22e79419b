//! The condition for feeding the watchdog: all parts that keep the robot safe have shown that they run.

/// The parts that have reported since the watchdog was last fed.
#[derive(Debug, Clone, Copy, Default)]
pub struct ProofOfLife {
    /// The thermistor's ADC has been sampled.
    pub sampler: bool,
    /// The heater's duty has been computed again.
    pub regulator: bool,
    /// All inputs that can indicate danger have been checked.
    pub supervisor: bool,
    /// The step interrupt has run.
    pub steps: bool,
}

impl ProofOfLife {
    /// Returns `true` once all parts have reported, and clears the reports. Feed the watchdog only then.
    pub fn accept(&mut self) -> bool {
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
    fn one_missing_proof_is_enough_to_withhold_it() {
        let all = ProofOfLife { sampler: true, regulator: true, supervisor: true, steps: true };
        for mut incomplete in [
            ProofOfLife { sampler: false, ..all },
            ProofOfLife { regulator: false, ..all },
            ProofOfLife { supervisor: false, ..all },
            ProofOfLife { steps: false, ..all },
        ] {
            assert!(!incomplete.accept());
        }
        let mut proof = all;
        assert!(proof.accept());
        assert!(!proof.accept(), "each time anew");
    }
}
