//! The present job, as its records say.

use super::record::{Kind, LAST_COUNT, LAST_INDEX, Record, join, lean_owed};

/// The job that the journal knows of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct JobState {
    /// Id of the plan.
    pub plan_id: u64,
    /// Hash of the robot's description.
    pub robot: u64,
    /// Number of layers of the job.
    pub layers: u32,
    /// Number of layers laid, the interrupted ones that count as laid included.
    pub laid: u32,
    /// Number of layers begun: as many as laid, or one more.
    pub begun: u32,
    /// Whether the job is done or given up.
    pub ended: bool,
}

/// The carry of the layers laid to those after them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Carry {
    /// Sum of their planned heights, units of [`growbot_core::layer_bytes`].
    pub height_units: u64,
    /// The lean that is owed.
    pub lean_owed: [i16; 2],
}

/// The present job, and where it is.
pub(super) struct Present {
    pub state: JobState,
    pub carry: Carry,
    /// Number of its records, as a record counts them.
    pub count: u32,
    /// Place of its own record.
    pub at: u32,
    pub found: Found,
    /// The record applied last.
    pub latest: Record,
}

/// Where a layer was found last.
#[derive(Clone, Copy)]
pub(super) struct Found {
    pub layer: u32,
    /// The min number of places between the job's own record and the layer's.
    pub offset: u32,
}

impl Present {
    /// A job by its own record, of which this is the content.
    pub fn new(record: &Record, at: u32, [a, b, c, d, layers]: [u32; 5]) -> Self {
        let state = JobState { plan_id: join(a, b), robot: join(c, d), layers, laid: 0, begun: 0, ended: false };
        let found = Found { layer: 0, offset: 1 };
        Self { state, carry: Carry::default(), count: 1, at, found, latest: *record }
    }

    /// Applies one more record of the job. False if it does not follow; then nothing more is known of the job.
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
            Kind::Begun if is_next => state.begun = state.laid + 1,
            Kind::Laid | Kind::LaidNextBegun | Kind::Interrupted if is_next => {
                state.laid += 1;
                state.begun = state.laid + u32::from(record.kind == Kind::LaidNextBegun);
                self.carry.height_units += u64::from(height_units);
                self.carry.lean_owed = lean_owed(lean);
            }
            Kind::Amended if state.laid <= record.index && record.index <= layers.min(LAST_INDEX) => {
                (state.plan_id, state.layers) = (join(a, b), layers);
            }
            Kind::Ended => state.ended = true,
            _ => return false,
        }
        true
    }
}
