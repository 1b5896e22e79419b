//! Durations as text.

/// Formats a duration in its two largest relevant units. `durationText` in growbot-pictures/viewer/src/text.js gives
/// the same texts.
pub fn duration_text(seconds: f64) -> String {
    if seconds < 0.995 {
        return format!("{seconds:.2} s");
    }
    if seconds < 59.95 {
        return format!("{seconds:.1} s");
    }
    let whole = seconds.round();
    let (minutes, rest) = ((whole / 60.0).floor(), whole % 60.0);
    if minutes < 60.0 {
        return format!("{minutes} min {rest} s");
    }
    let minutes = (seconds / 60.0).round();
    format!("{} h {} min", (minutes / 60.0).floor(), minutes % 60.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_rounded_to_useful_precision() {
        for (seconds, text) in [
            (0.0, "0.00 s"),
            (0.058, "0.06 s"),
            (0.996, "1.0 s"),
            (59.94, "59.9 s"),
            (59.96, "1 min 0 s"),
            (60.0, "1 min 0 s"),
            (3599.4, "59 min 59 s"),
            (3599.6, "1 h 0 min"),
            (18_900.0, "5 h 15 min"),
            (1e6, "277 h 47 min"),
        ] {
            assert_eq!(duration_text(seconds), text);
        }
    }
}
