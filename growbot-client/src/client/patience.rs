//! How long a host waits for a board, and how often it asks again.

use std::time::Duration;

use growbot_core::link::frame::FrameError;

/// A request is repeated after so long without its answer, and then ever more rarely,
pub(super) const FIRST_REPEAT: Duration = Duration::from_millis(250);
/// up to this.
pub(super) const SLOWEST_REPEAT: Duration = Duration::from_millis(500);
/// A plan takes a board up to a minute for a near goal, and emulated by a busy machine some times that: it is not asked
/// more often.
pub(super) const REPEAT_OF_PLAN: Duration = Duration::from_secs(10);
/// A board of which nothing at all comes for so long while it is asked is silent,
pub(super) const SILENCE: Duration = Duration::from_secs(8);
/// and one that has answered before after so long: the line may be bad.
pub(super) const SILENCE_OF_KNOWN: Duration = Duration::from_secs(20);
/// One that has never answered, and of which pieces of frames come now and then, is given so long,
pub(super) const SILENCE_OF_PIECES: Duration = Duration::from_secs(60);
/// unless more of them come a second: then it is no growbot.
pub(super) const MAX_PIECES_A_SECOND: f64 = 8.0;
/// One that plans is silent when it says nothing for so long.
pub(super) const SILENCE_OF_PLAN: Duration = Duration::from_secs(180);
/// A line that carries some frames and never the answer is given up after this many repetitions.
pub(super) const MAX_TRIES: u32 = 120;

/// How a wait for an answer has gone.
#[derive(Debug, Default)]
pub(super) struct Wait {
    /// For so long no frame has come.
    pub quiet: Duration,
    /// Pieces of frames that have come in that time.
    pub pieces: u32,
    /// What came that was none.
    pub unreadable: Option<FrameError>,
}

impl Wait {
    /// Whether nothing more is to be hoped for, from a board that has `known` answered before; not before `least`.
    pub fn is_hopeless(&self, least: Duration, known: bool) -> bool {
        let pieces = f64::from(self.pieces);
        let patience = if known {
            SILENCE_OF_KNOWN
        } else if pieces > 0.0 && pieces <= MAX_PIECES_A_SECOND * self.quiet.as_secs_f64() {
            SILENCE_OF_PIECES
        } else {
            SILENCE
        };
        // A whole frame of another version is no noise.
        let speaks_otherwise = !known && matches!(self.unreadable, Some(FrameError::Version { .. }));
        speaks_otherwise || self.quiet >= patience.max(least)
    }
}
