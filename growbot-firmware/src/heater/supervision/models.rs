//! The three models of the nozzle that run along with the real nozzle, and their predictions for the last seconds.
//!
//! *Nominal* is the nozzle as the description states it, corrected by the trim that the regulation has learned. *Lower*
//! warms as slowly as a healthy nozzle may, and *upper* as fast. Each model's change is computed twice: for a reading
//! that follows the nozzle at once, and for a reading that lags behind it by [`LAG_S`].

/// Max lag of a healthy reading behind the nozzle, s. The thermistors of the trials lag by 1 to 4 s
/// (`heater::tests::plant`, `tests/fault_campaign.rs`).
pub const LAG_S: f32 = 4.0;
/// Number of checkpoints, [`MARK_S`] apart, that are compared with the present reading. `heater::tests::faults` bounds
/// it: with fewer checkpoints slow faults are found too late.
pub const MARKS: usize = 25;
/// Time between two checkpoints, s: the shortest time over which a change is checked ([`super::FALL_WINDOW_S`]).
pub const MARK_S: f32 = 1.0;

/// Deviation of a model from the nominal model: factors of the heater's power, of the power that the nozzle loses, and
/// of its heat capacity.
#[derive(Debug, Clone, Copy)]
pub struct Factors {
    pub power: f32,
    pub need: f32,
    pub capacity: f32,
}

/// Factors of the lower model, which warms as slowly as a healthy nozzle may. They include the 10 % by which a nozzle
/// may differ from its description, and a margin (docs/decisions/0023-heater-supervision.md).
pub const LOWER: Factors = Factors { power: 0.88, need: 1.15, capacity: 1.12 };
/// Factors of the upper model, which warms as fast as a healthy nozzle may. They deviate from 1 in the opposite
/// direction to [`LOWER`].
pub const UPPER: Factors = Factors { power: 1.12, need: 0.85, capacity: 0.88 };

/// Min factor of the heater's power if the supply is not measured. [`UNMEASURED_MAX`] is the max. An unmeasured voltage
/// may be 10 % below or above the nominal voltage, so the factors are the squares of 0.9 and 1.1.
pub const UNMEASURED_MIN: f32 = 0.81;
pub const UNMEASURED_MAX: f32 = 1.21;

/// Temperature change that a model computes, degrees: of the nozzle (`prompt`), and of a reading that lags behind the
/// nozzle (`late`).
#[derive(Debug, Clone, Copy, Default)]
pub struct Change {
    pub prompt: f32,
    pub late: f32,
    pub late_rate: f32,
}

impl Change {
    pub fn add(&mut self, rate: f32, seconds: f32) {
        self.prompt += rate * seconds;
        self.late += self.late_rate * seconds;
        self.late_rate += (rate - self.late_rate) * (seconds / LAG_S).min(1.0);
    }

    /// Subtracts the change up to `origin`, so that the change counts from that later moment on. Sums over hours would
    /// grow until rounding loses the small additions.
    pub fn rebase(&mut self, origin: &Self) {
        self.prompt -= origin.prompt;
        self.late -= origin.late;
    }

    /// Returns the change since an earlier moment. Its bounds are the smaller and the larger of the changes of the
    /// nozzle and of the lagging reading.
    pub fn since(&self, earlier: &Self) -> CheckBounds {
        let (prompt, late) = (self.prompt - earlier.prompt, self.late - earlier.late);
        CheckBounds { min: prompt.min(late), max: prompt.max(late) }
    }
}

/// Smallest and largest change that a model predicts, degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CheckBounds {
    pub min: f32,
    pub max: f32,
}

/// A checkpoint: an earlier moment, with the reading and the models' changes at that moment.
#[derive(Debug, Clone, Copy)]
pub struct Checkpoint {
    pub age_s: f32,
    pub reading_c: f32,
    pub lower: Change,
    pub nominal: Change,
    pub upper: Change,
    /// Running sum, up to that moment, of the max fall of the reading that is possible without any power, degrees.
    pub fall_c: f32,
}
