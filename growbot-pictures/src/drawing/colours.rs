//! Colours of heights and of series, and interpolation of colours. Colour-blind readers can distinguish all of them.

/// Colours of the heights of layers, from the smallest to the largest height: from blue through sand to orange. They
/// are legible on light and on dark ground and for colour-blind readers. The data of the HTML page contain them.
pub const HEIGHTS: [[u8; 3]; 5] =
    [[0x2f, 0x5f, 0xae], [0x3f, 0x93, 0xb8], [0x8f, 0xb8, 0x9a], [0xe0, 0xb6, 0x5c], [0xd9, 0x70, 0x2e]];

/// Colours of the scale viridis (Smith and van der Walt 2015). Equal steps look equal, and brightness alone shows the
/// order.
pub const VIRIDIS: [[u8; 3]; 9] = [
    [68, 1, 84],
    [71, 45, 123],
    [59, 82, 139],
    [44, 114, 142],
    [33, 145, 140],
    [40, 174, 128],
    [94, 201, 98],
    [173, 220, 48],
    [253, 231, 37],
];
/// Colours of the scale cividis (Nunez, Anderton and Renslow 2018). It is like viridis, and looks the same to
/// colour-blind readers.
pub const CIVIDIS: [[u8; 3]; 9] = [
    [0, 34, 78],
    [18, 53, 112],
    [59, 73, 108],
    [87, 93, 109],
    [112, 113, 115],
    [138, 134, 120],
    [165, 157, 117],
    [202, 186, 106],
    [254, 232, 56],
];
/// Colours of series in plots (Okabe and Ito 2008), without yellow, because it is too pale for a line.
pub const SERIES: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000"];

/// Returns the colour of a series. After the last colour, the colours repeat.
pub fn series(index: usize) -> &'static str {
    SERIES[index % SERIES.len()]
}

/// A named scale of colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Palette {
    /// Blue for low values, through sand, to orange for high values.
    #[default]
    BlueOrange,
    /// From violet over green to yellow.
    Viridis,
    /// From dark blue over grey to yellow.
    Cividis,
}

impl Palette {
    /// Returns the colours, from the smallest to the largest value.
    pub fn colours(self) -> &'static [[u8; 3]] {
        match self {
            Self::BlueOrange => &HEIGHTS,
            Self::Viridis => &VIRIDIS,
            Self::Cividis => &CIVIDIS,
        }
    }
}

/// Returns the interpolated colour at a position from 0 to 1 on a scale of at least two colours.
pub fn mixed(scale: &[[u8; 3]], at: f64) -> [u8; 3] {
    let place = at.clamp(0.0, 1.0) * scale.len().saturating_sub(1) as f64;
    let first = (place as usize).min(scale.len().saturating_sub(2));
    let [from, to] = [first, first + 1].map(|index| scale.get(index).or(scale.last()).copied().unwrap_or_default());
    let share = place - first as f64;
    std::array::from_fn(|i| (f64::from(from[i]) + share * (f64::from(to[i]) - f64::from(from[i]))).round() as u8)
}

/// Formats a colour for SVG.
pub fn hex([red, green, blue]: [u8; 3]) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

/// Returns the colour of [`mixed`], formatted for SVG.
pub fn colour(scale: &[[u8; 3]], at: f64) -> String {
    hex(mixed(scale, at))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brightness_is_monotonic_in_the_palettes_for_papers() {
        let bright = |[red, green, blue]: &[u8; 3]| {
            let linear = |part: u8| libm::pow(f64::from(part) / 255.0, 2.2);
            0.2126 * linear(*red) + 0.7152 * linear(*green) + 0.0722 * linear(*blue)
        };
        for scale in [Palette::Viridis.colours(), Palette::Cividis.colours()] {
            assert!(scale.windows(2).all(|pair| bright(&pair[1]) > bright(&pair[0]) + 0.005), "{scale:?}");
        }
        // No two neighbours among the series are equal, and the first follows after the last.
        assert!(SERIES.windows(2).all(|pair| pair[0] != pair[1]) && series(7) == SERIES[0]);
    }

    #[test]
    fn colours_run_from_end_to_end() {
        let scale = [[0, 0, 0], [10, 20, 255], [1, 2, 3]];
        assert_eq!(
            [-1.0, 0.25, 0.5, 1.0, 7.0].map(|at| colour(&scale, at)),
            ["#000000", "#050a80", "#0a14ff", "#010203", "#010203"]
        );
        assert_eq!((mixed(&[[7, 8, 9]], 0.5), mixed(&[], 0.5)), ([7, 8, 9], [0, 0, 0]));
    }
}
