//! The current job of the journal, as its records describe it.

use super::record::{LAST_COUNT, LAST_INDEX, Record, RecordKind, join, lean_owed};

/// State of the latest job in the journal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct JournalJob {
    /// Identifier of the job's plan.
    pub plan_id: u64,
    /// Hash of the description of the robot that the job is for.
    pub robot: u64,
    /// Number of layers of the job.
    pub layer_count: u32,
    /// Number of layers laid, including the interrupted ones that count as laid.
    pub layers_laid: u32,
    /// Number of layers begun. It is the number of laid layers, or one more.
    pub layers_begun: u32,
    /// True if the job is done or cancelled.
    pub ended: bool,
}

/// Rounding errors that the laid layers carry over to the next layers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct RoundingCarry {
    /// Sum of the planned heights of the laid layers, units of [`growbot_core::layer_bytes`].
    pub height_units: u64,
    /// Lean that the laid layers lack because of rounding. The next layers must add it.
    pub residual_lean: [i16; 2],
}

/// The current job, and the position of its records in the journal.
pub(super) struct CurrentJob {
    pub state: JournalJob,
    pub carry: RoundingCarry,
    /// Number of the job's records, counted modulo 16 like [`Record::count`].
    pub count: u32,
    /// Number of the slot that contains the job's first record.
    pub at: u32,
    pub found: LookupHint,
    /// The job's record that was applied last.
    pub latest: Record,
}

/// Position of the layer that was looked up last, from which the next search starts.
#[derive(Clone, Copy)]
pub(super) struct LookupHint {
    pub layer: u32,
    /// Min number of slots between the job's first record and the record of `layer`.
    pub offset: u32,
}

impl CurrentJob {
    /// Creates a job from its first record, whose content is `[a, b, c, d, layers]`.
    pub fn new(record: &Record, at: u32, [a, b, c, d, layers]: [u32; 5]) -> Self {
        let state = JournalJob {
            plan_id: join(a, b),
            robot: join(c, d),
            layer_count: layers,
            layers_laid: 0,
            layers_begun: 0,
            ended: false,
        };
        let found = LookupHint { layer: 0, offset: 1 };
        Self { state, carry: RoundingCarry::default(), count: 1, at, found, latest: *record }
    }

    /// Applies the next record of the job to the job's state. Returns `false` if the record does not follow from the
    /// previous records. The state of the job is then unknown.
    pub fn apply(&mut self, record: &Record) -> bool {
        if record.count != self.count {
            return false;
        }
        self.count = (self.count + 1) & LAST_COUNT;
        self.latest = *record;
        let state = &mut self.state;
        let is_next = record.index == state.layers_laid && state.layers_laid < state.layer_count;
        let [a, b, layers, height_units, lean] = record.content;
        match record.kind {
            RecordKind::Begun if is_next => state.layers_begun = state.layers_laid + 1,
            RecordKind::Laid | RecordKind::LaidNextBegun | RecordKind::Interrupted if is_next => {
                state.layers_laid += 1;
                state.layers_begun = state.layers_laid + u32::from(record.kind == RecordKind::LaidNextBegun);
                self.carry.height_units += u64::from(height_units);
                self.carry.residual_lean = lean_owed(lean);
            }
            RecordKind::Amended if state.layers_laid <= record.index && record.index <= layers.min(LAST_INDEX) => {
                (state.plan_id, state.layer_count) = (join(a, b), layers);
            }
            RecordKind::Ended => state.ended = true,
            _ => return false,
        }
        true
    }
}
