//! Series to plot of a body: one value for each layer, and the temperatures in a run log.

use growbot_core::angle::degrees;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::{LayerBytes, decode};
use growbot_core::pose::Frame;
use growbot_plan::plan::Plan;
use growbot_plan::run_clock::{RunClock, events, time_for};
use growbot_plan::run_log::RunEvent;

use crate::view::centreline::points_along;

/// Values of the layers of a body. Each value belongs to the end of its layer.
pub struct LayerSeries {
    /// Length of the body after the layer, mm.
    pub lengths: Vec<f64>,
    /// Height of the layer on the middle of the wall, mm: minimum, mean and maximum around the wall.
    pub heights: Vec<[f64; 3]>,
    /// Tilt of the layer, degrees.
    pub tilts: Vec<f64>,
}

impl LayerSeries {
    /// Returns the values of these layers. `tip_radius` is the radius of the middle of the wall, mm.
    pub fn of(layers: &[LayerBytes], tip_radius: f64) -> Self {
        let mut length = 0.0;
        let mut of = Self { lengths: Vec::new(), heights: Vec::new(), tilts: Vec::new() };
        for layer in layers.iter().map(decode) {
            length += layer.height;
            of.lengths.push(length);
            of.heights.push([layer.min_height(tip_radius), layer.height, layer.max_height(tip_radius)]);
            of.tilts.push(degrees(layer.tilt));
        }
        of
    }
}

/// Returns the distance between the points of a body and of the planned body at the same length, after each layer of
/// the body, mm.
pub fn deviation_from_plan(start: &Frame, built: &[LayerBytes], planned: &[LayerBytes]) -> Vec<f64> {
    let planned = points_along(start, planned);
    let mut near = 0;
    let off = points_along(start, built).into_iter().skip(1).map(|(point, length)| {
        while planned.get(near + 1).is_some_and(|(_, next)| *next < length) {
            near += 1;
        }
        let Some((at, from)) = planned.get(near) else { return 0.0 };
        let Some((ahead, to)) = planned.get(near + 1) else { return (point - at).norm() };
        let share = if to > from { ((length - from) / (to - from)).clamp(0.0, 1.0) } else { 0.0 };
        (point - at.lerp(ahead, share)).norm()
    });
    off.collect()
}

/// Times of layers and readings, s.
#[derive(Debug, Default, PartialEq)]
pub struct Timeline {
    /// Time at which each layer was laid, s.
    pub laid: Vec<f64>,
    /// Temperatures of the nozzle in the run log. Empty for a plan.
    pub temperatures: Vec<TemperatureReading>,
}

/// Temperature of the nozzle in a status report.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TemperatureReading {
    /// Time of the report, s.
    pub at: f64,
    /// Number of layers laid before the report.
    pub laid: usize,
    /// Temperature, degrees Celsius.
    pub celsius: f64,
    /// Setpoint, degrees Celsius. `None` if the heater is off.
    pub target: Option<f64>,
}

impl Timeline {
    /// Returns the timeline of a plan, with the time that the robot needs for each layer.
    pub fn planned(layers: &[Layer], plan: &Plan) -> Self {
        let mut now = 0;
        let laid = layers.iter().map(|layer| {
            now += time_for(layer, plan);
            now as f64 / 1000.0
        });
        Self { laid: laid.collect(), temperatures: Vec::new() }
    }

    /// Returns the timeline of a run log, given as its bytes, of a body with these layers.
    pub fn from_log(log: &[u8], layers: &[Layer], plan: &Plan) -> Self {
        let mut clock = RunClock::default();
        let mut series = Self::default();
        for event in events(log) {
            match event {
                RunEvent::Status(status) => {
                    clock.status(&status);
                    if let Some(celsius) = status.temperature_c {
                        let (at, laid) = (seconds(&clock), series.laid.len());
                        series.temperatures.push(TemperatureReading { at, laid, celsius, target: status.target_c });
                    }
                }
                RunEvent::Laid(laid) if (laid.layer as usize) < layers.len() => {
                    // A layer may be reported again after a resumption, and the first report counts. A layer whose line
                    // is lost came before the next layer.
                    while let Some(layer) = layers.get(series.laid.len())
                        && laid.layer as usize >= series.laid.len()
                    {
                        clock.add_layer(time_for(layer, plan));
                        series.laid.push(seconds(&clock));
                    }
                }
                _ => {}
            }
        }
        series
    }
}

fn seconds(clock: &RunClock) -> f64 {
    clock.now() as f64 / 1000.0
}

#[cfg(test)]
mod tests {
    use growbot_core::layer_bytes::LayerEncoder;

    use super::*;

    fn straight(heights: &[f64]) -> Vec<LayerBytes> {
        let mut encoder = LayerEncoder::default();
        heights.iter().map(|height| encoder.encode(&Layer { alpha: 0.0, height: *height, tilt: 0.0 })).collect()
    }

    #[test]
    fn deviation_from_plan_is_lateral_distance_and_excess_length() {
        let start = Frame::identity();
        let planned = straight(&[1.0; 10]);
        // Higher layers lie on the same line. They deviate only beyond its end.
        let off = deviation_from_plan(&start, &straight(&[1.5; 8]), &planned);
        assert!(off[..6].iter().all(|mm| *mm < 1e-6), "{off:?}");
        assert!((off[7] - 2.0).abs() < 1e-6, "{off:?}");
        assert_eq!(deviation_from_plan(&start, &straight(&[1.0]), &[]), [1.0]);
        assert!(deviation_from_plan(&start, &[], &planned).is_empty());
    }
}
