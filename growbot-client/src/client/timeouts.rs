//! Timeouts for a board's responses, and the intervals of retries.

use std::time::Duration;

use growbot_core::link::frame::FrameError;

/// Time after which a request is first repeated. Further retries come at increasing intervals.
pub(super) const FIRST_RETRY_DELAY: Duration = Duration::from_millis(250);
/// Maximum interval between retries.
pub(super) const MAX_RETRY_DELAY: Duration = Duration::from_millis(500);
/// Interval between retries of a request to plan. A plan takes a board up to a minute for a near goal, and several
/// times that if a busy machine emulates it.
pub(super) const PLAN_RETRY_DELAY: Duration = Duration::from_secs(10);
/// Time without any bytes after which a board counts as silent if it has never responded.
pub(super) const SILENCE_TIMEOUT: Duration = Duration::from_secs(8);
/// Time without a frame after which a board that has responded before counts as silent. It is longer because the line
/// may be bad.
pub(super) const OPEN_SESSION_TIMEOUT: Duration = Duration::from_secs(20);
/// Time limit for a board that has never responded but sends fragments of frames at a low rate.
pub(super) const FRAGMENT_TIMEOUT: Duration = Duration::from_secs(60);
/// Maximum rate of fragments, 1/s. A device that sends more is not a growbot board.
pub(super) const MAX_FRAGMENTS_PER_S: f64 = 8.0;
/// Time without a frame after which a board that plans counts as silent.
pub(super) const PLAN_TIMEOUT: Duration = Duration::from_secs(180);
/// Maximum number of repetitions of a request on a line that carries frames but never the response.
pub(super) const MAX_ATTEMPTS: u32 = 120;

/// State of a wait for a response.
#[derive(Debug, Default)]
pub(super) struct ResponseWait {
    /// Time since the latest frame.
    pub quiet: Duration,
    /// Number of fragments of frames that were received since the latest frame.
    pub pieces: u32,
    /// Error of received bytes that were not a valid frame.
    pub unreadable: Option<FrameError>,
}

impl ResponseWait {
    /// Returns true once the board has been silent for longer than its timeout. The timeout is longer if the board is
    /// `known` to respond, and never shorter than `least`.
    pub fn has_timed_out(&self, least: Duration, known: bool) -> bool {
        let pieces = f64::from(self.pieces);
        let patience = if known {
            OPEN_SESSION_TIMEOUT
        } else if pieces > 0.0 && pieces <= MAX_FRAGMENTS_PER_S * self.quiet.as_secs_f64() {
            FRAGMENT_TIMEOUT
        } else {
            SILENCE_TIMEOUT
        };
        // A complete frame of another version is not noise.
        let speaks_otherwise = !known && matches!(self.unreadable, Some(FrameError::Version { .. }));
        speaks_otherwise || self.quiet >= patience.max(least)
    }
}
