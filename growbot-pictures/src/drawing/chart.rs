//! Charts: scales and axes.

use super::canvas::Canvas;

/// Greatest number of steps between the ticks of an axis.
const MAX_STEPS: f64 = 6.0;

/// A mapping from values to positions on an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scale {
    /// Linear scale from the first to the second value.
    Linear(f64, f64),
    /// Logarithmic scale from the first to the second value. Both are positive.
    Log(f64, f64),
}

impl Scale {
    /// Returns a linear scale from 0 to a little above the max of these values.
    pub fn from_zero(values: impl IntoIterator<Item = f64>) -> Self {
        let max = values.into_iter().fold(0.0, f64::max);
        let step = round_step(if max > 0.0 { max } else { 1.0 }, MAX_STEPS);
        Self::Linear(0.0, step * libm::ceil(1.02 * max / step).max(1.0))
    }

    /// Returns a linear scale from a round number below these values to one above. The values may be equal, and the
    /// list may be empty.
    pub fn around(values: impl IntoIterator<Item = f64>) -> Self {
        let all = values.into_iter().filter(|value| value.is_finite());
        let (min, max) =
            all.fold((f64::INFINITY, f64::NEG_INFINITY), |(min, max), value| (min.min(value), max.max(value)));
        if min > max {
            return Self::Linear(0.0, 1.0);
        }
        let alike = (1e-3 * max.abs()).max(1e-9);
        let wide = if max - min > alike { max - min } else { alike.max(0.1 * max.abs()) };
        let step = round_step(wide, MAX_STEPS - 1.0);
        let from = step * libm::floor(min / step + 1e-9);
        let to = step * libm::ceil(max / step - 1e-9);
        Self::Linear(from, if to > from { to } else { from + step })
    }

    /// Returns a logarithmic scale from a round number below the positive values to one above.
    pub fn log_around(values: impl IntoIterator<Item = f64>) -> Self {
        let (min, max) = values
            .into_iter()
            .filter(|value| *value > 0.0)
            .fold((f64::INFINITY, 0.0_f64), |(min, max), value| (min.min(value), max.max(value)));
        if max == 0.0 {
            return Self::Log(0.1, 1.0);
        }
        let below = |value: f64| libm::pow(10.0, libm::floor(libm::log10(value)));
        let round = |value: f64| [1.0, 2.0, 5.0, 10.0].map(|step| step * below(value));
        let from = round(min).into_iter().rfind(|step| *step <= 0.95 * min).unwrap_or(0.5 * below(min));
        let to = round(max).into_iter().find(|step| *step >= 1.05 * max).unwrap_or(20.0 * below(max));
        Self::Log(from, to)
    }

    /// Returns the position of a value on the axis: 0 at its start, 1 at its end.
    pub fn share(self, value: f64) -> f64 {
        match self {
            Self::Linear(from, to) => (value - from) / (to - from),
            Self::Log(from, to) => libm::log10(value / from) / libm::log10(to / from),
        }
    }

    /// Returns the values at which grid lines and labels are drawn.
    pub fn ticks(self) -> Vec<f64> {
        match self {
            Self::Linear(from, to) => {
                let step = round_step(to - from, MAX_STEPS);
                let count = libm::floor((to - from) / step + 1e-9) as i32;
                (0..=count).map(|i| from + step * f64::from(i)).collect()
            }
            Self::Log(from, to) => {
                let (first, last) = (libm::floor(libm::log10(from)) as i32, libm::ceil(libm::log10(to)) as i32);
                // A short scale has ticks between whole decades too.
                let steps: &[f64] = if to / from < 300.0 { &[1.0, 2.0, 5.0] } else { &[1.0] };
                (first..=last)
                    .flat_map(|power| steps.iter().map(move |step| step * libm::pow(10.0, f64::from(power))))
                    .filter(|tick| (0.999 * from..=1.001 * to).contains(tick))
                    .collect()
            }
        }
    }
}

/// Returns the smallest step, 1, 2 or 5 times a power of ten, that divides `whole` into at most `max` parts.
pub fn round_step(whole: f64, max: f64) -> f64 {
    let power = libm::pow(10.0, libm::floor(libm::log10(whole / max)));
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|step| step * power).find(|step| whole / step <= max).unwrap_or(whole)
}

/// Returns the largest of 1, 2 or 5 times a power of ten that is at most `max`, which is positive.
pub fn round_below(max: f64) -> f64 {
    let power = libm::pow(10.0, libm::floor(libm::log10(max)));
    [5.0, 2.0, 1.0].into_iter().map(|step| step * power).find(|step| *step <= max).unwrap_or(power)
}

/// Formats a number on an axis, without an exponent if four decimals suffice.
pub fn number(value: f64) -> String {
    let text = format!("{value:.4}");
    let plain = text.trim_end_matches('0').trim_end_matches('.');
    if plain.parse().is_ok_and(|parsed: f64| (parsed - value).abs() <= 1e-3 * value.abs()) {
        return plain.to_owned();
    }
    format!("{value:.1e}").replace(".0e", "e")
}

/// A plot in a drawing.
pub struct Panel {
    /// Left edge, top edge, width and height, units of the drawing.
    pub area: [f64; 4],
    /// Horizontal scale.
    pub x: Scale,
    /// Vertical scale, upwards.
    pub y: Scale,
}

impl Panel {
    /// Returns the position of a point in the drawing. A point above or below the panel is moved to its edge.
    pub fn place(&self, x: f64, y: f64) -> (f64, f64) {
        let [left, top, width, height] = self.area;
        (left + width * self.x.share(x), top + height * (1.0 - self.y.share(y).clamp(0.0, 1.0)))
    }

    /// Draws the frame, lines, labels and names of the axes. `ticks` are the positions and labels of the ticks on the x
    /// axis. If `None`, they are derived from its scale.
    pub fn axes(&self, canvas: &mut Canvas, head: &str, x_name: &str, y_name: &str, ticks: Option<&[(f64, String)]>) {
        let [left, top, width, height] = self.area;
        let (right, bottom) = (left + width, top + height);
        for value in self.y.ticks() {
            let (_, y) = self.place(0.0_f64.max(self.min_x()), value);
            canvas.add(format_args!("<path class=\"grid\" d=\"M{left} {y:.1}H{right}\"/>"));
            canvas.text(left - 8.0, y + 4.5, "end", number(value));
        }
        let by_scale: Vec<(f64, String)> = match ticks {
            Some(ticks) => ticks.to_vec(),
            None => self.x.ticks().into_iter().map(|value| (value, number(value))).collect(),
        };
        for (value, label) in &by_scale {
            let x = left + width * self.x.share(*value);
            canvas.add(format_args!("<path class=\"grid\" d=\"M{x:.1} {top}V{bottom}\"/>"));
            canvas.text(x, bottom + 19.0, "mid", label);
        }
        canvas
            .add(format_args!("<rect class=\"axis\" x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\"/>"));
        canvas.text(left, top - 12.0, "head", head);
        canvas.text(left + width / 2.0, bottom + 40.0, "mid", x_name);
        canvas.add(format_args!(
            "<text class=\"mid\" transform=\"translate({:.1} {:.1}) rotate(-90)\">{y_name}</text>",
            left - 64.0,
            top + height / 2.0
        ));
    }

    /// Returns the value at the start of the x axis.
    pub fn min_x(&self) -> f64 {
        match self.x {
            Scale::Linear(from, _) | Scale::Log(from, _) => from,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_contain_their_values_and_end_on_a_tick() {
        let scale = Scale::from_zero([0.011, 0.047]);
        assert_eq!(scale, Scale::Linear(0.0, 0.05));
        assert_eq!(scale.ticks().len(), 6);
        let scale = Scale::log_around([0.0, 3e-5, 0.2]);
        assert!((scale.share(2e-5)).abs() < 1e-12 && (scale.share(0.5) - 1.0).abs() < 1e-12, "{scale:?}");
        assert_eq!(scale.ticks().len(), 4);
        assert!((Scale::Log(1e-5, 1.0).share(1e-5)).abs() < 1e-12);
        assert_eq!(Scale::from_zero([]), Scale::Linear(0.0, 0.2));
    }

    #[test]
    fn a_scale_encloses_the_values() {
        let Scale::Linear(from, to) = Scale::around([0.61, 0.93]) else { panic!("not linear") };
        assert!((from - 0.6).abs() < 1e-12 && (to - 1.0).abs() < 1e-12, "{from} {to}");
        assert_eq!(Scale::around([]), Scale::Linear(0.0, 1.0));
        for alike in [0.0, 0.774, -3.0, 200.0] {
            let Scale::Linear(from, to) = Scale::around([alike, alike]) else { panic!("{alike}") };
            assert!(
                from <= alike && alike <= to && from < to && to - from < 0.5 * alike.abs() + 1e-8,
                "{from} {alike} {to}"
            );
        }
    }

    #[test]
    fn tick_steps_are_round() {
        for (whole, max, step) in [(1000.0, 12.0, 100.0), (3589.0, 12.0, 500.0), (2.0, 10.0, 0.2), (7.0, 10.0, 1.0)] {
            assert!((round_step(whole, max) - step).abs() < 1e-12 * step, "{whole}");
        }
    }

    #[test]
    fn a_scale_bar_is_round() {
        assert_eq!([1.0, 199.0, 200.0, 7e3].map(round_below), [1.0, 100.0, 200.0, 5e3]);
        assert!((round_below(0.03) - 0.02).abs() < 1e-12);
    }

    #[test]
    fn numbers_on_axes_are_short() {
        let numbers = [0.0, 0.05, 0.1 + 0.2, 20.0, 1e-5, 1e-4, 1.2e-4].map(number);
        assert_eq!(numbers, ["0", "0.05", "0.3", "20", "1e-5", "0.0001", "1.2e-4"]);
    }
}
