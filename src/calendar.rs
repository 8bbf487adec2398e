//! The proleptic Gregorian calendar, in days and milliseconds since 1970, without time zones.
//!
//! It is written here because BSON's dates reach 292 million years to either side of 1970; the dates of jiff, chrono
//! and time end at the years 9999, 262,142 and 999,999.

/// Returns `2026-11-22 08:12:36`, with milliseconds where there are some, in UTC; takes milliseconds since 1970.
pub(crate) fn day_and_time(millis: i64) -> String {
    let text = bson::DateTime::from_millis(millis).try_to_rfc3339_string().unwrap_or_else(|_| millis.to_string());
    text.trim_end_matches('Z').replacen('T', " ", 1)
}

/// Milliseconds of a day.
pub(crate) const DAY: i64 = 86_400_000;

/// A date and time of day by its fields. `month` and `day` begin with 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Civil {
    pub(crate) year: i64,
    pub(crate) month: i64,
    pub(crate) day: i64,
    pub(crate) hour: i64,
    pub(crate) minute: i64,
    pub(crate) second: i64,
    pub(crate) millisecond: i64,
}

impl Civil {
    /// Returns the fields of a time given as milliseconds since 1970.
    pub(crate) fn from_millis(millis: i64) -> Self {
        let (year, month, day) = date_of(millis.div_euclid(DAY));
        let rest = millis.rem_euclid(DAY);
        Self {
            year,
            month,
            day,
            hour: rest / 3_600_000,
            minute: rest / 60_000 % 60,
            second: rest / 1000 % 60,
            millisecond: rest % 1000,
        }
    }

    /// Returns milliseconds since 1970; fields out of range carry over. `None` beyond the range of 64 bits.
    pub(crate) fn to_millis(self) -> Option<i64> {
        let months = self.month.checked_sub(1)?;
        let year = self.year.checked_add(months.div_euclid(12))?;
        if year.unsigned_abs() > 400_000_000 {
            return None;
        }
        let days = days_of(year, months.rem_euclid(12) + 1, 1).checked_add(self.day)?.checked_sub(1)?;
        let millis = i128::from(days) * i128::from(DAY)
            + i128::from(self.hour) * 3_600_000
            + i128::from(self.minute) * 60_000
            + i128::from(self.second) * 1000
            + i128::from(self.millisecond);
        i64::try_from(millis).ok()
    }

    /// Returns the day of the year; 1 is the first of January.
    pub(crate) fn day_of_year(self) -> i64 {
        days_of(self.year, self.month, self.day) - days_of(self.year, 1, 1) + 1
    }

    /// Returns the day of the week; 0 is Sunday.
    pub(crate) fn weekday(self) -> i64 {
        weekday(days_of(self.year, self.month, self.day))
    }

    /// Returns the week of the year, weeks beginning on Sunday; days before the first Sunday are in week 0.
    pub(crate) fn week(self) -> i64 {
        (self.day_of_year() + 6 - self.weekday()) / 7
    }

    /// Returns year and week of ISO 8601.
    pub(crate) fn iso_week(self) -> (i64, i64) {
        let weekday = (self.weekday() + 6) % 7;
        let week = (self.day_of_year() - 1 - weekday + 10) / 7;
        if week < 1 {
            return (self.year - 1, iso_weeks(self.year - 1));
        }
        if week > iso_weeks(self.year) {
            return (self.year + 1, 1);
        }
        (self.year, week)
    }
}

/// Returns the day of the week of a day since 1970; 0 is Sunday.
pub(crate) fn weekday(days: i64) -> i64 {
    (days + 4).rem_euclid(7)
}

/// Returns the date of a day of an ISO week: as the day of a January, which may be out of range.
pub(crate) fn iso_date(year: i64, week: i64, day: i64) -> (i64, i64, i64) {
    let fourth = days_of(year, 1, 4);
    let monday = fourth - (weekday(fourth) + 6) % 7;
    let days = monday + (week - 1) * 7 + day - 1;
    (year, 1, days - days_of(year, 1, 1) + 1)
}

/// Returns the number of weeks that a year has in ISO 8601.
fn iso_weeks(year: i64) -> i64 {
    let first = weekday(days_of(year, 1, 1));
    if first == 4 || (first == 3 && is_leap(year)) { 53 } else { 52 }
}

/// Returns whether a year has a 29th of February.
pub(crate) fn is_leap(year: i64) -> bool {
    year % 4 == 0 && (year % 100 != 0 || year % 400 == 0)
}

/// Returns the number of days of a month (1 to 12).
pub(crate) fn days_in_month(year: i64, month: i64) -> i64 {
    match month {
        2 => 28 + i64::from(is_leap(year)),
        4 | 6 | 9 | 11 => 30,
        _ => 31,
    }
}

/// Returns the days from 1970-01-01 to a date, counting in eras of 400 years that begin in March.
pub(crate) fn days_of(year: i64, month: i64, day: i64) -> i64 {
    let year = if month <= 2 { year - 1 } else { year };
    let era = year.div_euclid(400);
    let of_era = year.rem_euclid(400);
    let of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + of_year - 719_468
}

/// Returns year, month and day of a day since 1970: the inverse of [`days_of`].
pub(crate) fn date_of(days: i64) -> (i64, i64, i64) {
    let days = days + 719_468;
    let era = days.div_euclid(146_097);
    let of_era = days.rem_euclid(146_097);
    let year = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year + year / 4 - year / 100);
    let month = (5 * of_year + 2) / 153;
    let day = of_year - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    (year + era * 400 + i64::from(month <= 2), month, day)
}

/// Returns the ISO 8601 text of milliseconds since 1970, in UTC, like `2000-02-29T00:00:00.123Z`.
pub(crate) fn iso_text(millis: i64) -> String {
    let civil = Civil::from_millis(millis);
    format!(
        "{:04}-{:02}-{:02}T{:02}:{:02}:{:02}.{:03}Z",
        civil.year, civil.month, civil.day, civil.hour, civil.minute, civil.second, civil.millisecond
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn takes_moments_apart_and_puts_them_together() {
        for millis in [0, -1, 951_782_400_123, -62_135_596_800_000, 253_402_300_799_999, 1 << 50] {
            assert_eq!(Civil::from_millis(millis).to_millis(), Some(millis));
        }
        assert_eq!(iso_text(951_782_400_123), "2000-02-29T00:00:00.123Z");
    }

    #[test]
    fn knows_weeks() {
        let civil = |year, month, day| Civil::from_millis(days_of(year, month, day) * DAY);
        assert_eq!(civil(2021, 1, 1).iso_week(), (2020, 53));
        assert_eq!(civil(2024, 12, 30).iso_week(), (2025, 1));
        assert_eq!(civil(2024, 1, 6).week(), 0);
        assert_eq!(civil(2024, 1, 7).week(), 1);
        assert_eq!(civil(2024, 1, 7).weekday(), 0);
    }
}
