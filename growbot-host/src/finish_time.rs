//! The time of day at which something is done, as text. `finishText` of growbot-pictures/viewer/src/text.js gives the
//! same text.

use time::{Duration, OffsetDateTime, UtcOffset};

/// The time of day here. Where the system does not tell its offset, it is that of UTC.
#[must_use]
pub fn now_here() -> OffsetDateTime {
    here(OffsetDateTime::now_utc())
}

/// A time of day as clocks here show it, summer time included.
fn here(time: OffsetDateTime) -> OffsetDateTime {
    time.to_offset(UtcOffset::local_offset_at(time).unwrap_or(UtcOffset::UTC))
}

/// When it is done, as a clock here shows it: see [`clock_text`].
#[must_use]
pub fn clock_text_here(finish: OffsetDateTime) -> String {
    clock_text(now_here(), here(finish))
}

/// `14:05`, with the day where that is another one: `tomorrow 02:10`, `2026-11-26 02:10`.
#[must_use]
pub fn clock_text(now: OffsetDateTime, finish: OffsetDateTime) -> String {
    // To the nearest minute, as durations are.
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
    fn the_day_is_said_where_it_is_another_one() {
        let offset = UtcOffset::from_hms(2, 0, 0).unwrap();
        // 2026-07-01 23:30 there.
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
