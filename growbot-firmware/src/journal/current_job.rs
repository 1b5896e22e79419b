//! The present job, as its records describe it.

use super::record::{LAST_COUNT, LAST_INDEX, Record, RecordKind, join, lean_owed};

/// The latest job in the journal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct JobState {
    /// Id of the plan.
    pub plan_id: u64,
    /// Hash of the robot's description.
    pub robot: u64,
    /// Number of layers of the job.
    pub layers: u32,
    /// Number of layers laid, including the interrupted ones that count as laid.
    pub laid: u32,
    /// Number of layers begun: as many as laid, or one more.
    pub begun: u32,
    /// The job is done or cancelled.
    pub ended: bool,
}

/// Carry from the laid layers to the next ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Carry {
    /// Sum of the planned heights of the laid layers, units of [`growbot_core::layer_bytes`].
    pub height_units: u64,
    /// Lean that is owed to the next layers.
    pub lean_owed: [i16; 2],
}

/// The present job, and its position in the journal.
pub(super) struct CurrentJob {
    pub state: JobState,
    pub carry: Carry,
    /// Number of its records, as a record counts them.
    pub count: u32,
    /// Slot of its first record.
    pub at: u32,
    pub found: Found,
    /// The record applied last.
    pub latest: Record,
}

/// Position at which a layer was found last.
#[derive(Clone, Copy)]
pub(super) struct Found {
    pub layer: u32,
    /// The min number of slots between the job's first record and the layer's record.
    pub offset: u32,
}

impl CurrentJob {
    /// Creates a job from its first record, with this content.
    pub fn new(record: &Record, at: u32, [a, b, c, d, layers]: [u32; 5]) -> Self {
        let state = JobState { plan_id: join(a, b), robot: join(c, d), layers, laid: 0, begun: 0, ended: false };
        let found = Found { layer: 0, offset: 1 };
        Self { state, carry: Carry::default(), count: 1, at, found, latest: *record }
    }

    /// Applies one more record of the job. Returns `false` if it does not follow. The state of the job is unknown then.
    pub fn apply(&mut self, record: &Record) -> bool {
        if record.count != self.count {
            return false;
        }
        self.count = (self.count + 1) & LAST_COUNT;
        self.latest = *record;
        let state = &mut self.state;
        let is_next = record.index == state.laid && state.laid < state.layers;
        let [a, b, layers, height_units, lean] = record.content;
        match record.kind {
            RecordKind::Begun if is_next => state.begun = state.laid + 1,
            RecordKind::Laid | RecordKind::LaidNextBegun | RecordKind::Interrupted if is_next => {
                state.laid += 1;
                state.begun = state.laid + u32::from(record.kind == RecordKind::LaidNextBegun);
                self.carry.height_units += u64::from(height_units);
                self.carry.lean_owed = lean_owed(lean);
            }
            RecordKind::Amended if state.laid <= record.index && record.index <= layers.min(LAST_INDEX) => {
                (state.plan_id, state.layers) = (join(a, b), layers);
            }
            RecordKind::Ended => state.ended = true,
            _ => return false,
        }
        true
    }
}
