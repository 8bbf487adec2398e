//! Durations, sizes and times as people write them: `500ms`, `2s`, `1m`, `7d`; `512M`, `2GiB`; `14:03:20`.

use std::time::Duration;

use bson::DateTime;

use super::shell;
use crate::calendar::DAY;

/// Reads a duration: a number and a unit of `ms`, `s`, `m`, `h` or `d`.
///
/// # Errors
/// A sentence that says what was expected.
pub fn duration(text: &str) -> Result<Duration, String> {
    let wrong = || format!("`{text}` is not a duration; expected a number and a unit, like 500ms, 2s, 1m or 1h");
    let (number, unit) = split(text).ok_or_else(wrong)?;
    let seconds = match unit {
        "ms" => number / 1e3,
        "s" => number,
        "m" | "min" => number * 60.0,
        "h" => number * 3600.0,
        "d" => number * 86_400.0,
        _ => return Err(wrong()),
    };
    Duration::try_from_secs_f64(seconds).map_err(|_| wrong())
}

/// Reads a limit of time: a duration that is not 0.
///
/// # Errors
/// A sentence that says what was expected.
pub fn time_limit(text: &str) -> Result<Duration, String> {
    let limit = duration(text)?;
    let wrong = || format!("`{text}` leaves no time; expected more than 0, like 500ms, 2s, 1m or 1h");
    if limit.is_zero() { Err(wrong()) } else { Ok(limit) }
}

/// Reads a limit of memory: a size with its unit, as a number of bytes is rarely meant.
///
/// # Errors
/// A sentence that says what was expected.
pub fn memory_limit(text: &str) -> Result<u64, String> {
    let has_unit = text.ends_with(|c: char| c.is_ascii_alphabetic());
    let wrong = || format!("`{text}` has no unit; expected a size like 512M or 2G (512B for bytes)");
    if has_unit || size(text).is_err() { size(text) } else { Err(wrong()) }
}

/// Writes a duration as it is read, in its largest unit without a remainder.
#[must_use]
pub fn write_duration(duration: Duration) -> String {
    let millis = duration.as_millis();
    let units = [(86_400_000, "d"), (3_600_000, "h"), (60_000, "m"), (1000, "s"), (1, "ms")];
    let unit = units.iter().find(|(length, _)| millis.is_multiple_of(*length));
    unit.map_or_else(|| format!("{millis}ms"), |(length, name)| format!("{}{name}", millis / length))
}

/// Writes a size as it is read, in its largest unit without a remainder.
#[must_use]
pub fn write_size(bytes: u64) -> String {
    let units = [(40, "T"), (30, "G"), (20, "M"), (10, "K")];
    let unit = units.iter().find(|(power, _)| bytes > 0 && bytes.is_multiple_of(1 << power));
    unit.map_or_else(|| bytes.to_string(), |(power, name)| format!("{}{name}", bytes >> power))
}

/// Reads a time: `14:03:20` (the last time it was that late, in UTC), a date as in ISO 8601, or a duration before `now`.
///
/// # Errors
/// A sentence that says what was expected.
pub fn time(text: &str, now: DateTime) -> Result<DateTime, String> {
    let wrong =
        || format!("`{text}` is not a time; expected 14:03:20 (UTC), 2026-01-31T14:03:20Z, or how long ago, like 10m");
    let now = now.timestamp_millis();
    if let Some(millis) = shell::parse_date(&format!("1970-01-01T{text}")) {
        let today = now - now.rem_euclid(DAY) + millis.rem_euclid(DAY);
        return Ok(DateTime::from_millis(if today > now { today - DAY } else { today }));
    }
    if let Some(millis) = shell::parse_date(text) {
        return Ok(DateTime::from_millis(millis));
    }
    let ago = duration(text.trim_end_matches("ago").trim_end()).map_err(|_| wrong())?;
    let ago = i64::try_from(ago.as_millis()).map_err(|_| wrong())?;
    now.checked_sub(ago).map(DateTime::from_millis).ok_or_else(wrong)
}

/// Reads a size in bytes: a number and, perhaps, a unit of `K`, `M`, `G` or `T` (powers of 1024).
///
/// # Errors
/// A sentence that says what was expected.
pub fn size(text: &str) -> Result<u64, String> {
    let wrong = || format!("`{text}` is not a size; expected a number and a unit, like 512M or 2G");
    let (number, unit) = split(text).ok_or_else(wrong)?;
    let power = match unit.trim_end_matches("iB").trim_end_matches('B') {
        "" => 0,
        "K" | "k" => 1,
        "M" => 2,
        "G" => 3,
        "T" => 4,
        _ => return Err(wrong()),
    };
    let bytes = number * 1024_f64.powi(power);
    if !(1.0..=9e18).contains(&bytes) {
        return Err(wrong());
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the range is checked above")]
    Ok(bytes as u64)
}

fn split(text: &str) -> Option<(f64, &str)> {
    let end = text.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(text.len());
    let number = text[..end].parse().ok()?;
    Some((number, text[end..].trim_start()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_durations() {
        assert_eq!(duration("500ms"), Ok(Duration::from_millis(500)));
        assert_eq!(duration("2s"), Ok(Duration::from_secs(2)));
        assert_eq!(duration("1.5m"), Ok(Duration::from_secs(90)));
        for text in ["", "2", "s", "-1s", "1e9s", "1 fortnight", "99999999999999999999999h"] {
            assert!(duration(text).is_err(), "{text}");
        }
    }

    #[test]
    fn reads_times() {
        let now = DateTime::from_millis(20 * DAY + 50_000);
        let millis = |text: &str| time(text, now).map(DateTime::timestamp_millis);
        assert_eq!(millis("00:00:20"), Ok(20 * DAY + 20_000));
        assert_eq!(millis("00:00:20.125"), Ok(20 * DAY + 20_125));
        assert_eq!(millis("00:01"), Ok(19 * DAY + 60_000), "today it was not that late yet");
        assert_eq!(millis("1970-01-03"), Ok(2 * DAY));
        assert_eq!(millis("1970-01-03T01:00+01:00"), Ok(2 * DAY));
        assert_eq!(millis("30s"), Ok(20 * DAY + 20_000));
        assert_eq!(millis("30s ago"), millis("30s"));
        for text in ["", "14", "25:00", "14:61", "yesterday", "2023-02-30", "-3s", "ago"] {
            assert!(time(text, now).is_err(), "{text}");
        }
    }

    #[test]
    fn limits_are_more_than_0_and_have_units() {
        assert_eq!(time_limit("1ms"), Ok(Duration::from_millis(1)));
        assert_eq!(memory_limit("2G"), Ok(2 << 30));
        assert_eq!(memory_limit("100B"), Ok(100));
        assert!(time_limit("0s").is_err_and(|words| words.contains("more than 0")));
        assert!(memory_limit("1").is_err_and(|words| words.contains("no unit")));
        assert!(memory_limit("x").is_err_and(|words| words.contains("not a size")));
    }

    #[test]
    fn reads_sizes() {
        assert_eq!(size("512M"), Ok(512 << 20));
        assert_eq!(size("2GiB"), Ok(2 << 30));
        assert_eq!(size("100"), Ok(100));
        for text in ["", "M", "0", "1X", "-1M", "9999999999999T"] {
            assert!(size(text).is_err(), "{text}");
        }
    }
}
