//! Axes of dates: ticks at round times, as many as there is room for.

use bson::DateTime;
use kuva::render::datetime::{DateTimeAxis, DateUnit};

use super::words;

/// Years 1 to 9999, in seconds since 1970: what else is called a date is drawn as a number.
const YEARS: std::ops::RangeInclusive<f64> = -62_135_596_800.0..=253_402_300_799.0;
/// The size of ticks' labels in pixels.
const SIZE: f64 = 12.0;
/// Pixels between two labels.
const GAP: f64 = 14.0;

const MINUTE: f64 = 60.0;
const HOUR: f64 = 60.0 * MINUTE;
const DAY: f64 = 24.0 * HOUR;
const MONTH: f64 = 30.4 * DAY;
const YEAR: f64 = 365.2 * DAY;

const SECONDS: &str = "%H:%M:%S";
const MINUTES: &str = "%H:%M";
const HOURS: &str = "%m-%d %H:%M";
const DAYS: &str = "%Y-%m-%d";
const MONTHS: &str = "%Y-%m";
const YEARLY: &str = "%Y";

/// Distances between ticks: in seconds, as so many of a unit, with the format of labels and its length.
const STEPS: [(f64, DateUnit, usize, &str, usize); 33] = [
    (1.0, DateUnit::Second, 1, SECONDS, 8),
    (2.0, DateUnit::Second, 2, SECONDS, 8),
    (5.0, DateUnit::Second, 5, SECONDS, 8),
    (10.0, DateUnit::Second, 10, SECONDS, 8),
    (15.0, DateUnit::Second, 15, SECONDS, 8),
    (30.0, DateUnit::Second, 30, SECONDS, 8),
    (MINUTE, DateUnit::Minute, 1, MINUTES, 5),
    (2.0 * MINUTE, DateUnit::Minute, 2, MINUTES, 5),
    (5.0 * MINUTE, DateUnit::Minute, 5, MINUTES, 5),
    (10.0 * MINUTE, DateUnit::Minute, 10, MINUTES, 5),
    (15.0 * MINUTE, DateUnit::Minute, 15, MINUTES, 5),
    (30.0 * MINUTE, DateUnit::Minute, 30, MINUTES, 5),
    (HOUR, DateUnit::Hour, 1, MINUTES, 5),
    (2.0 * HOUR, DateUnit::Hour, 2, HOURS, 11),
    (3.0 * HOUR, DateUnit::Hour, 3, HOURS, 11),
    (6.0 * HOUR, DateUnit::Hour, 6, HOURS, 11),
    (12.0 * HOUR, DateUnit::Hour, 12, HOURS, 11),
    (DAY, DateUnit::Day, 1, DAYS, 10),
    (2.0 * DAY, DateUnit::Day, 2, DAYS, 10),
    (7.0 * DAY, DateUnit::Week, 1, DAYS, 10),
    (14.0 * DAY, DateUnit::Week, 2, DAYS, 10),
    (MONTH, DateUnit::Month, 1, MONTHS, 7),
    (2.0 * MONTH, DateUnit::Month, 2, MONTHS, 7),
    (3.0 * MONTH, DateUnit::Month, 3, MONTHS, 7),
    (6.0 * MONTH, DateUnit::Month, 6, MONTHS, 7),
    (YEAR, DateUnit::Year, 1, YEARLY, 4),
    (2.0 * YEAR, DateUnit::Year, 2, YEARLY, 4),
    (5.0 * YEAR, DateUnit::Year, 5, YEARLY, 4),
    (10.0 * YEAR, DateUnit::Year, 10, YEARLY, 4),
    (25.0 * YEAR, DateUnit::Year, 25, YEARLY, 4),
    (100.0 * YEAR, DateUnit::Year, 100, YEARLY, 4),
    (500.0 * YEAR, DateUnit::Year, 500, YEARLY, 4),
    (2_000.0 * YEAR, DateUnit::Year, 2_000, YEARLY, 4),
];

/// The ticks of an axis of dates, `pixels` long, and what its label adds: in which zone, and on which day.
/// None for what no calendar has.
pub(super) fn axis((least, greatest): (f64, f64), pixels: f64) -> Option<(DateTimeAxis, String)> {
    if !YEARS.contains(&least) || !YEARS.contains(&greatest) {
        return None;
    }
    let most = |length: usize| (pixels / (words::width("0", SIZE) * length as f64 + GAP)).max(1.0);
    let fits = |(seconds, _, _, _, length): &&(f64, DateUnit, usize, &str, usize)| {
        (greatest - least) / seconds <= most(*length)
    };
    let (_, unit, step, format, _) = STEPS.iter().find(fits).unwrap_or(&STEPS[STEPS.len() - 1]);
    let axis = DateTimeAxis { unit: unit.clone(), step: *step, format: (*format).to_owned() };
    let zone = match *format {
        SECONDS | MINUTES => format!("UTC, {}", days(least, greatest)),
        HOURS => format!("UTC, {}", day(least).get(..4).unwrap_or_default()),
        _ => "UTC".to_owned(),
    };
    Some((axis, zone))
}

/// The day, or the first and the last.
fn days(least: f64, greatest: f64) -> String {
    let (first, last) = (day(least), day(greatest));
    if first == last { first } else { format!("{first} to {last}") }
}

fn day(seconds: f64) -> String {
    let date = DateTime::from_millis((seconds * 1000.0) as i64);
    date.try_to_rfc3339_string().unwrap_or_default().chars().take(10).collect()
}

#[cfg(test)]
mod tests {
    use super::axis;

    #[test]
    fn ticks_are_at_round_times_and_fit() {
        let start = 1_795_340_000.0;
        for (length, format) in [
            (0.0, "%H:%M:%S"),
            (50.0, "%H:%M:%S"),
            (2_400.0, "%H:%M"),
            (86_400.0, "%m-%d %H:%M"),
            (1e6, "%Y-%m-%d"),
            (3e7, "%Y-%m"),
            (3e9, "%Y"),
            (2e11, "%Y"),
        ] {
            let (axis, _) = axis((start, start + length), 600.0).unwrap();
            assert_eq!(axis.format, format, "{length}");
            assert!(axis.generate_ticks(start, start + length).len() <= 15, "{length}");
        }
    }

    #[test]
    fn the_label_has_the_day_where_ticks_do_not() {
        assert_eq!(axis((0.0, 60.0), 600.0).unwrap().1, "UTC, 1970-01-01");
        assert_eq!(axis((86_370.0, 86_430.0), 600.0).unwrap().1, "UTC, 1970-01-01 to 1970-01-02");
        assert_eq!(axis((0.0, 1e8), 600.0).unwrap().1, "UTC");
        assert!(axis((0.0, 1e15), 600.0).is_none() && axis((f64::NEG_INFINITY, 0.0), 600.0).is_none());
    }
}
