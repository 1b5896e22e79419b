//! Temperatures over time, as many as a chart can show. They are thinned out, so that they always cover the whole time.

use growbot_core::link::message::celsius;

/// Maximum number of stored readings.
const MAX_READINGS: usize = 1024;

/// Readings and targets of the nozzle over time: pairs of s on the board's clock and degrees Celsius.
#[derive(Debug, Default)]
pub struct TemperatureHistory {
    readings: Vec<(f64, f64)>,
    targets: Vec<(f64, f64)>,
    /// Minimum time between two stored readings, s.
    apart_s: f64,
    latest_s: Option<f64>,
}

impl TemperatureHistory {
    /// Adds the measured and the target temperature of the nozzle (hundredths of a degree Celsius) at `at_s` on the
    /// board's clock. They are ignored if the latest stored time is too near.
    pub fn add(&mut self, at_s: f64, reading: Option<i32>, target: Option<i32>) {
        match self.latest_s {
            // The board has restarted, and its clock with it.
            Some(latest) if at_s < latest => *self = Self::default(),
            Some(latest) if at_s < latest + self.apart_s || at_s <= latest => return,
            _ => {}
        }
        self.latest_s = Some(at_s);
        self.readings.extend(reading.map(|centi| (at_s, celsius(centi))));
        self.targets.extend(target.map(|centi| (at_s, celsius(centi))));
        if self.readings.len().max(self.targets.len()) > MAX_READINGS {
            self.apart_s =
                2.0 * self.apart_s.max(self.span().map_or(0.0, |(from, to)| (to - from) / MAX_READINGS as f64));
            for track in [&mut self.readings, &mut self.targets] {
                let mut keep = false;
                track.retain(|_| {
                    keep = !keep;
                    keep
                });
            }
        }
    }

    /// Returns the measured temperatures with their times.
    pub fn readings(&self) -> &[(f64, f64)] {
        &self.readings
    }

    /// Returns the target temperatures with their times.
    pub fn targets(&self) -> &[(f64, f64)] {
        &self.targets
    }

    /// Returns the first and the last time with a temperature, s of the board's clock. `None` without temperatures.
    pub fn span(&self) -> Option<(f64, f64)> {
        let tracks = [&self.readings, &self.targets];
        let first = tracks.iter().filter_map(|track| track.first()).map(|(at, _)| *at).reduce(f64::min)?;
        Some((first, self.latest_s.unwrap_or(first).max(first)))
    }

    /// Returns the minimum and the maximum of all measured and target temperatures, degrees Celsius.
    pub fn range(&self) -> Option<(f64, f64)> {
        let all = || self.readings.iter().chain(&self.targets).map(|(_, celsius)| *celsius);
        Some((all().reduce(f64::min)?, all().reduce(f64::max)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_day_of_readings_is_thinned_out_over_its_whole_time() {
        let mut readings = TemperatureHistory::default();
        for second in 0..86_400 {
            readings.add(f64::from(second), Some(21_000 + second % 7), (second > 60).then_some(21_000));
        }
        assert!(
            (MAX_READINGS / 4..=MAX_READINGS).contains(&readings.readings().len()),
            "{}",
            readings.readings().len()
        );
        let (from, to) = readings.span().unwrap();
        assert!(from == 0.0 && to > 86_000.0, "{from} {to}");
        assert!(readings.readings().is_sorted_by(|one, next| one.0 < next.0));
    }

    #[test]
    fn a_board_restart_begins_a_new_chart() {
        let mut readings = TemperatureHistory::default();
        readings.add(5.0, Some(2_000), None);
        readings.add(5.0, Some(2_100), None);
        assert_eq!(readings.readings(), [(5.0, 20.0)]);
        readings.add(0.5, Some(2_200), Some(21_000));
        assert_eq!(readings.readings(), [(0.5, 22.0)]);
        assert_eq!(readings.range(), Some((22.0, 210.0)));
    }
}
