//! A simulated robot with limited speed, for people who watch it.

use std::thread::sleep;
use std::time::{Duration, Instant};

use growbot_client::port::{Port, PortError};

use super::sim::Sim;

/// Longest delay of the robot's time behind real time that the simulated robot makes up for.
const MAX_BEHIND: Duration = Duration::from_secs(1);

/// A simulated robot whose time passes `times` as fast as real time, or as fast as it can be computed if that is
/// slower.
pub struct PacedSim {
    sim: Sim,
    times: f64,
    /// Real time at which the robot's time was 0.
    began: Instant,
}

impl PacedSim {
    /// Creates a paced robot from `sim`. `times` is the speed of its time as a multiple of real time, above 0.
    pub fn new(sim: Sim, times: f64) -> Self {
        Self { sim, times, began: Instant::now() }
    }

    /// Returns the time to wait until the real time matches the robot's time. `passed` is the real time so far.
    fn wait(&mut self, passed: Duration) -> Duration {
        let Ok(due) = Duration::try_from_secs_f64(self.sim.now_s() / self.times) else { return Duration::ZERO };
        let behind = passed.saturating_sub(due);
        if behind > MAX_BEHIND {
            self.began += behind;
        }
        due.saturating_sub(passed)
    }
}

impl Port for PacedSim {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        self.sim.send(bytes)
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        let count = self.sim.receive(buffer, timeout)?;
        sleep(self.wait(self.began.elapsed()));
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
    fn time_passes_no_faster_than_the_pace() {
        let robot = growbot_plan::robot_file::load("growbot-a".as_ref()).unwrap();
        let mut paced = PacedSim::new(Sim::new(robot), 100.0);
        paced.sim.run_for(Duration::from_secs(300));
        let [before, early, late] = [0, 1, 4].map(Duration::from_secs).map(|passed| paced.wait(passed));
        assert_eq!([before, early, late].map(|wait| wait.as_secs_f64().round()), [3.0, 2.0, 0.0]);
        assert!(before <= Duration::from_secs(3));
        // A delay of more than a second is not made up for.
        let began = paced.began;
        assert_eq!(paced.wait(Duration::from_secs(10)), Duration::ZERO);
        assert_eq!((paced.began - began).as_secs_f64().round(), 7.0);
    }
}
