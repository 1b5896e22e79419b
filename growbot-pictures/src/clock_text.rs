//! Text of the time at which a job is finished. `finishText` of growbot-pictures/viewer/src/text.js returns the same
//! text.

use time::{Duration, OffsetDateTime, UtcOffset};

/// Returns the present time in the local time zone, or in UTC if the system does not provide the offset of the zone.
pub fn now_here() -> OffsetDateTime {
    here(OffsetDateTime::now_utc())
}

/// Converts a time to local time, including daylight saving time.
fn here(time: OffsetDateTime) -> OffsetDateTime {
    time.to_offset(UtcOffset::local_offset_at(time).unwrap_or(UtcOffset::UTC))
}

/// Returns the text of a finish time in local time, see [`clock_text`].
pub fn local_clock_text(finish: OffsetDateTime) -> String {
    clock_text(now_here(), here(finish))
}

/// Formats a finish time, for example `14:05`. The day is added if the finish is not today: `tomorrow 02:10`,
/// `2026-11-26 02:10`.
pub fn clock_text(now: OffsetDateTime, finish: OffsetDateTime) -> String {
    // The time is rounded to the nearest minute, as durations are.
    let finish = finish.checked_add(Duration::seconds(30)).unwrap_or(finish);
    let clock = format!("{:02}:{:02}", finish.hour(), finish.minute());
    match finish.to_julian_day() - now.to_julian_day() {
        0 => clock,
        1 => format!("tomorrow {clock}"),
        _ => format!("{:04}-{:02}-{:02} {clock}", finish.year(), u8::from(finish.month()), finish.day()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_day_is_included_if_it_is_not_today() {
        let offset = UtcOffset::from_hms(2, 0, 0).unwrap();
        // Local time 2026-07-01 23:30.
        let now = OffsetDateTime::from_unix_timestamp(1_782_941_400).unwrap().to_offset(offset);
        assert_eq!((now.day(), now.hour(), now.minute()), (1, 23, 30));
        for (minutes, text) in [
            (0.0, "23:30"),
            (29.4, "23:59"),
            (29.6, "tomorrow 00:00"),
            (240.0, "tomorrow 03:30"),
            (1500.0, "2026-07-03 00:30"),
        ] {
            assert_eq!(clock_text(now, now + Duration::seconds_f64(minutes * 60.0)), text);
        }
    }
}
