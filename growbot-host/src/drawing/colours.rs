//! The colours of heights, and colours between others.

/// Colours of heights, from the min to the max: from blue over sand to orange, to be read on light and on dark ground
/// and by the colour-blind. The page gets them in its data.
pub const HEIGHTS: [[u8; 3]; 5] =
    [[0x2f, 0x5f, 0xae], [0x3f, 0x93, 0xb8], [0x8f, 0xb8, 0x9a], [0xe0, 0xb6, 0x5c], [0xd9, 0x70, 0x2e]];

/// The colour at a place, 0 to 1, of a scale of two colours or more.
pub fn mixed(scale: &[[u8; 3]], at: f64) -> [u8; 3] {
    let place = at.clamp(0.0, 1.0) * scale.len().saturating_sub(1) as f64;
    let first = (place as usize).min(scale.len().saturating_sub(2));
    let [from, to] = [first, first + 1].map(|index| scale.get(index).or(scale.last()).copied().unwrap_or_default());
    let share = place - first as f64;
    std::array::from_fn(|i| (f64::from(from[i]) + share * (f64::from(to[i]) - f64::from(from[i]))).round() as u8)
}

/// As SVG writes it.
pub fn hex([red, green, blue]: [u8; 3]) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

/// [`mixed`], as SVG writes it.
pub fn colour(scale: &[[u8; 3]], at: f64) -> String {
    hex(mixed(scale, at))
}

#[cfg(test)]
mod tests {
    use super::*;

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
