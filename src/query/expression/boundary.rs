//! Units of time: their boundaries, and steps by them.

use crate::calendar::{Civil, DAY, days_in_month, days_of, weekday};
use crate::query::zone::Zone;

/// A unit of time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::query) enum Unit {
    Year,
    Quarter,
    Month,
    Week,
    Day,
    Hour,
    Minute,
    Second,
    Millisecond,
}

impl Unit {
    /// Reads `day`, `hour`, ….
    pub(in crate::query) fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "year" => Self::Year,
            "quarter" => Self::Quarter,
            "month" => Self::Month,
            "week" => Self::Week,
            "day" => Self::Day,
            "hour" => Self::Hour,
            "minute" => Self::Minute,
            "second" => Self::Second,
            "millisecond" => Self::Millisecond,
            _ => return None,
        })
    }

    /// Returns the months of the unit, if it is one of months.
    pub(in crate::query) fn months(self) -> Option<i64> {
        match self {
            Self::Year => Some(12),
            Self::Quarter => Some(3),
            Self::Month => Some(1),
            _ => None,
        }
    }

    /// Milliseconds of the unit, where it is not one of months.
    pub(in crate::query) fn millis(self) -> i64 {
        match self {
            Self::Week => 7 * DAY,
            Self::Hour => 3_600_000,
            Self::Minute => 60_000,
            Self::Second => 1000,
            Self::Millisecond => 1,
            _ => DAY,
        }
    }

    /// Returns whether the unit is counted on the local clock.
    fn is_local(self) -> bool {
        !matches!(self, Self::Hour | Self::Minute | Self::Second | Self::Millisecond)
    }
}

/// Returns a moment some units later; a month's day is cut to the month's length. `None` on overflow.
pub(in crate::query) fn date_step(millis: i64, unit: Unit, amount: i64, zone: &Zone) -> Option<i64> {
    if !unit.is_local() {
        return millis.checked_add(unit.millis().checked_mul(amount)?);
    }
    let local = zone.local(millis);
    let moved = match unit.months() {
        None => local.checked_add(unit.millis().checked_mul(amount)?)?,
        Some(months) => {
            let mut civil = Civil::from_millis(local);
            let months = (civil.month - 1).checked_add(months.checked_mul(amount)?)?;
            civil.year = civil.year.checked_add(months.div_euclid(12))?;
            civil.month = months.rem_euclid(12) + 1;
            if civil.year.unsigned_abs() > 300_000_000 {
                return None;
            }
            civil.day = civil.day.min(days_in_month(civil.year, civil.month));
            civil.to_millis()?
        }
    };
    Some(zone.moment(moved))
}

/// How many boundaries of a unit lie between two moments.
pub(super) fn date_difference(start: i64, end: i64, unit: Unit, week: i64, zone: &Zone) -> Option<i64> {
    // Units up to hours are elapsed time, on the clock of the start.
    let (start, end) = if unit.is_local() {
        (zone.local(start), zone.local(end))
    } else {
        let offset = zone.offset_at(start) * 1000;
        (start.checked_add(offset)?, end.checked_add(offset)?)
    };
    let index = |local: i64| match unit.months() {
        Some(months) => {
            let civil = Civil::from_millis(local);
            (civil.year * 12 + civil.month - 1).div_euclid(months)
        }
        None if unit == Unit::Week => (local.div_euclid(DAY) + 4 - week).div_euclid(7),
        None => local.div_euclid(unit.millis()),
    };
    index(end).checked_sub(index(start))
}

/// Returns the start of the bin of some units that a moment is in; bins are counted from 2000.
pub(in crate::query) fn date_bin(millis: i64, unit: Unit, bin: i64, week: i64, zone: &Zone) -> Option<i64> {
    let reference = days_of(2000, 1, 1) * DAY;
    match unit.months() {
        Some(months) => {
            let civil = Civil::from_millis(zone.local(millis));
            let size = months.checked_mul(bin)?;
            let since = (civil.year - 2000) * 12 + civil.month - 1;
            let first = since.div_euclid(size).checked_mul(size)?;
            let civil = Civil {
                year: 2000 + first.div_euclid(12),
                month: first.rem_euclid(12) + 1,
                day: 1,
                hour: 0,
                minute: 0,
                second: 0,
                millisecond: 0,
            };
            Some(zone.moment(civil.to_millis()?))
        }
        None => {
            let reference = match unit {
                Unit::Week => {
                    let first = days_of(2000, 1, 1);
                    (first + (week - weekday(first)).rem_euclid(7)) * DAY
                }
                _ => reference,
            };
            let size = unit.millis().checked_mul(bin)?;
            if unit.is_local() {
                let since = zone.local(millis).checked_sub(reference)?;
                return Some(zone.moment(since.div_euclid(size) * size + reference));
            }
            // Shorter units are counted in elapsed time from the local reference.
            let reference = zone.moment(reference);
            let since = millis.checked_sub(reference)?;
            Some(since.div_euclid(size) * size + reference)
        }
    }
}
