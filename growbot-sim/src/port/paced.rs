//! A simulated robot whose time does not run away: for people who look on.

use std::thread::sleep;
use std::time::{Duration, Instant};

use growbot_client::port::{Port, PortError};

use super::sim::Sim;

/// A pause of this program is not made up for beyond this.
const MAX_BEHIND: Duration = Duration::from_secs(1);

/// A simulated robot whose time passes faster than real time by a factor, or as fast as it is computed where that is
/// slower.
pub struct Paced {
    sim: Sim,
    times: f64,
    /// When its time would have been 0.
    began: Instant,
}

impl Paced {
    /// A robot at this pace: above 0.
    #[must_use]
    pub fn new(sim: Sim, times: f64) -> Self {
        Self { sim, times, began: Instant::now() }
    }

    /// Waits until as much real time has passed as there should have.
    fn keep_pace(&mut self) {
        let Ok(due) = Duration::try_from_secs_f64(self.sim.now_s() / self.times) else { return };
        let passed = self.began.elapsed();
        sleep(due.saturating_sub(passed));
        let behind = passed.saturating_sub(due);
        if behind > MAX_BEHIND {
            self.began += behind;
        }
    }
}

impl Port for Paced {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        self.sim.send(bytes)
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        let count = self.sim.receive(buffer, timeout)?;
        self.keep_pace();
        Ok(count)
    }

    fn now(&self) -> Duration {
        self.sim.now()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_passes_no_faster_than_asked_for() {
        let robot = growbot_client::robot_file::load("growbot-a".as_ref()).unwrap();
        let mut paced = Paced::new(Sim::new(robot), 100.0);
        let began = Instant::now();
        for _ in 0..50 {
            paced.receive(&mut [0; 64], Duration::from_millis(200)).unwrap();
        }
        let simulated = paced.sim.now_s();
        assert!(simulated > 1.0 && began.elapsed().as_secs_f64() >= 0.999 * simulated / 100.0, "{simulated}");
    }
}
