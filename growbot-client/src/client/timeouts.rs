//! Timeouts for a board's responses, and the intervals at which requests are sent again.

use std::time::Duration;

use growbot_core::link::frame::FrameError;

/// Time without a response after which a request is sent a second time. Further retries follow at increasing intervals.
pub(super) const FIRST_RETRY_DELAY: Duration = Duration::from_millis(250);
/// Maximum interval between retries.
pub(super) const MAX_RETRY_DELAY: Duration = Duration::from_millis(500);
/// Interval between retries of a request to plan. Planning takes a board up to a minute for a near goal, and several
/// times as long on a board that a busy machine emulates.
pub(super) const PLAN_RETRY_DELAY: Duration = Duration::from_secs(10);
/// Time without a valid frame after which a request fails, if no session is open.
pub(super) const SILENCE_TIMEOUT: Duration = Duration::from_secs(8);
/// Time without a valid frame after which a request fails in an open session. It is longer than [`SILENCE_TIMEOUT`],
/// because the board is known to respond and the line may only be noisy.
pub(super) const OPEN_SESSION_TIMEOUT: Duration = Duration::from_secs(20);
/// Time without a valid frame after which a request fails, if no session is open but invalid frames arrive at a low
/// rate, as on a noisy line.
pub(super) const FRAGMENT_TIMEOUT: Duration = Duration::from_secs(60);
/// Maximum rate of invalid frames at which [`FRAGMENT_TIMEOUT`] applies, 1/s. A device that sends more is not a growbot
/// board.
pub(super) const MAX_FRAGMENTS_PER_S: f64 = 8.0;
/// Time without a valid frame after which a request to plan fails.
pub(super) const PLAN_TIMEOUT: Duration = Duration::from_secs(180);
/// Maximum number of times that a request is sent, if frames arrive but never the response.
pub(super) const MAX_ATTEMPTS: u32 = 120;

/// State of the wait for a response to a request.
#[derive(Debug, Default)]
pub(super) struct ResponseWait {
    /// True if a session is open, in which the timeout is longer.
    pub in_session: bool,
    /// Time since the latest valid frame.
    pub quiet: Duration,
    /// Number of invalid frames that were received since the latest valid frame.
    pub pieces: u32,
    /// Error of the latest invalid frame. `None` if none was received.
    pub unreadable: Option<FrameError>,
}

impl ResponseWait {
    /// Reports whether the time without a valid frame has reached the timeout. `least` is the minimum timeout.
    pub fn has_timed_out(&self, least: Duration) -> bool {
        let pieces = f64::from(self.pieces);
        let patience = if self.in_session {
            OPEN_SESSION_TIMEOUT
        } else if pieces > 0.0 && pieces <= MAX_FRAGMENTS_PER_S * self.quiet.as_secs_f64() {
            FRAGMENT_TIMEOUT
        } else {
            SILENCE_TIMEOUT
        };
        // A complete frame of another version of the protocol is not noise, so waiting would not help.
        let speaks_otherwise = !self.in_session && matches!(self.unreadable, Some(FrameError::Version { .. }));
        speaks_otherwise || self.quiet >= patience.max(least)
    }
}
