//! When the watchdog may be fed: only once everything that keeps the robot safe has shown that it runs.

/// The parts that have reported since the watchdog was last fed.
#[derive(Debug, Clone, Copy, Default)]
pub struct ProofOfLife {
    /// The thermistor's ADC has been sampled.
    pub sampler: bool,
    /// The heater's duty has been computed anew.
    pub regulator: bool,
    /// Everything that can mean danger has been looked at.
    pub supervisor: bool,
    /// The step interrupt has run.
    pub steps: bool,
}

impl ProofOfLife {
    /// Whether all have reported. If so, they have to report again before the next time.
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
