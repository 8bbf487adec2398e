//! Time zones: offsets from UTC, and names in the system's time zone database.
//!
//! The database's files are read here because the timestamps of jiff end with the year 9999, those of BSON do not.

use crate::calendar::{Civil, days_in_month, days_of, weekday};

/// A time zone.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Zone {
    /// Seconds east of UTC.
    Offset(i64),
    /// When which offset began, in seconds since 1970; the offset before the first; the rule after the last.
    Table { first: i64, changes: Vec<(i64, i64)>, rule: Option<Rule> },
}

/// The yearly rule of a zone: standard and summer time.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Rule {
    standard: i64,
    summer: Option<(i64, Day, Day)>,
}

/// The `week`th `weekday` of a month (5 is the last), and the local second of that day.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Day {
    month: i64,
    week: i64,
    weekday: i64,
    second: i64,
}

/// Folders of the time zone database.
const FOLDERS: [&str; 3] = ["/usr/share/zoneinfo", "/usr/lib/zoneinfo", "/usr/share/lib/zoneinfo"];

impl Zone {
    pub(super) const UTC: Self = Self::Offset(0);

    /// Reads `+05:30`, `-0330`, `+02`, `UTC`, `Europe/Berlin`; `None` if it is none of these.
    pub(super) fn parse(text: &str) -> Option<Self> {
        match text.as_bytes().first()? {
            b'+' => offset(text.get(1..)?).map(Self::Offset),
            b'-' => offset(text.get(1..)?).map(|seconds| Self::Offset(-seconds)),
            _ if matches!(text, "UTC" | "GMT" | "Z" | "Etc/UTC") => Some(Self::UTC),
            _ => Self::named(text),
        }
    }

    fn named(name: &str) -> Option<Self> {
        let plain = name.split('/').all(|part| {
            !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"_+-".contains(&byte))
        });
        if !plain {
            return None;
        }
        let bytes = FOLDERS.iter().find_map(|folder| std::fs::read(format!("{folder}/{name}")).ok())?;
        table(&bytes)
    }

    /// Seconds east of UTC at a moment.
    pub(super) fn offset_at(&self, millis: i64) -> i64 {
        let second = millis.div_euclid(1000);
        match self {
            Self::Offset(offset) => *offset,
            Self::Table { first, changes, rule } => {
                let after = changes.partition_point(|(start, _)| *start <= second);
                if after == changes.len()
                    && let Some(rule) = rule
                {
                    return rule.offset_at(second);
                }
                after.checked_sub(1).and_then(|index| changes.get(index)).map_or(*first, |(_, offset)| *offset)
            }
        }
    }

    /// Returns the local clock at a moment, as milliseconds.
    pub(super) fn local(&self, millis: i64) -> i64 {
        millis.saturating_add(self.offset_at(millis) * 1000)
    }

    /// Returns the moment at which the local clock shows this.
    pub(super) fn moment(&self, local: i64) -> i64 {
        let guess = local.saturating_sub(self.offset_at(local) * 1000);
        let offset = self.offset_at(guess);
        let moment = local.saturating_sub(offset * 1000);
        // In the hour that a change skips, the clock before the change counts.
        if self.offset_at(moment) == offset { moment } else { guess.max(moment) }
    }
}

impl Rule {
    fn offset_at(&self, second: i64) -> i64 {
        let Some((summer, start, end)) = self.summer else { return self.standard };
        let year = Civil::from_millis((second + self.standard).saturating_mul(1000)).year;
        let start = start.second_in(year) - self.standard;
        let end = end.second_in(year) - summer;
        let is_summer = if start < end { (start..end).contains(&second) } else { !(end..start).contains(&second) };
        if is_summer { summer } else { self.standard }
    }
}

impl Day {
    fn second_in(self, year: i64) -> i64 {
        let first = days_of(year, self.month, 1);
        let mut day = first + (self.weekday - weekday(first)).rem_euclid(7) + 7 * (self.week - 1);
        while day >= first + days_in_month(year, self.month) {
            day -= 7;
        }
        day * 86_400 + self.second
    }
}

/// `05:30`, `0530`, `05`.
fn offset(text: &str) -> Option<i64> {
    let digits: String = match text.len() {
        5 if text.as_bytes().get(2) == Some(&b':') => text.replacen(':', "", 1),
        2 | 4 => text.to_owned(),
        _ => return None,
    };
    if !digits.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let hours: i64 = digits.get(..2)?.parse().ok()?;
    let minutes: i64 = digits.get(2..).filter(|rest| !rest.is_empty()).map_or(Some(0), |rest| rest.parse().ok())?;
    Some(hours * 3600 + minutes * 60)
}

/// Reads a file of the database (TZif, RFC 8536), its 64-bit part.
fn table(bytes: &[u8]) -> Option<Zone> {
    let counts = |at: usize| -> Option<[usize; 6]> {
        let mut counts = [0; 6];
        for (index, count) in counts.iter_mut().enumerate() {
            *count = usize::try_from(u32::from_be_bytes(bytes.get(at + 20 + index * 4..)?.get(..4)?.try_into().ok()?))
                .ok()?;
        }
        Some(counts)
    };
    if bytes.get(..4)? != b"TZif" {
        return None;
    }
    let [utc, wall, leap, times, types, names] = counts(0)?;
    let second = 44 + times * 5 + types * 6 + names + leap * 8 + wall + utc;
    let [utc, wall, leap, times, types, names] = counts(second)?;
    let at = second + 44;
    let offsets = at + times * 9;
    let offset_of = |index: usize| -> Option<i64> {
        Some(i32::from_be_bytes(bytes.get(offsets + index * 6..)?.get(..4)?.try_into().ok()?).into())
    };
    let mut changes = Vec::with_capacity(times.min(4096));
    for index in 0..times {
        let start = i64::from_be_bytes(bytes.get(at + index * 8..)?.get(..8)?.try_into().ok()?);
        let offset_index = *bytes.get(at + times * 8 + index)?;
        changes.push((start, offset_of(offset_index.into())?));
    }
    let footer = offsets + types * 6 + names + leap * 12 + wall + utc;
    let text = std::str::from_utf8(bytes.get(footer..)?).ok()?;
    Some(Zone::Table { first: offset_of(0)?, changes, rule: rule(text.trim()) })
}

/// Reads a POSIX rule like `CET-1CEST,M3.5.0,M10.5.0/3`.
fn rule(text: &str) -> Option<Rule> {
    let mut parts = text.split(',');
    let rest = name_end(parts.next()?)?;
    let (standard, rest) = clock(rest)?;
    let standard = -standard;
    if rest.is_empty() {
        return Some(Rule { standard, summer: None });
    }
    let rest = name_end(rest)?;
    let summer = if rest.is_empty() { standard + 3600 } else { -clock(rest)?.0 };
    Some(Rule { standard, summer: Some((summer, day(parts.next()?)?, day(parts.next()?)?)) })
}

/// What follows the name of a zone.
fn name_end(text: &str) -> Option<&str> {
    if text.starts_with('<') {
        return text.find('>').and_then(|end| text.get(end + 1..));
    }
    Some(text.trim_start_matches(|c: char| c.is_ascii_alphabetic()))
}

/// `[-]h[:mm[:ss]]` as seconds, and what follows.
fn clock(text: &str) -> Option<(i64, &str)> {
    let end = text.find(|c: char| !(c.is_ascii_digit() || "+-:".contains(c))).unwrap_or(text.len());
    let (clock, rest) = text.split_at_checked(end)?;
    let negative = clock.starts_with('-');
    let mut seconds = 0;
    for (part, unit) in clock.trim_start_matches(['-', '+']).split(':').zip([3600, 60, 1]) {
        seconds += part.parse::<i64>().ok()?.checked_mul(unit)?;
    }
    Some((if negative { -seconds } else { seconds }, rest))
}

/// `Mm.w.d[/time]`.
fn day(text: &str) -> Option<Day> {
    let (date, time) = text.split_once('/').unwrap_or((text, "2"));
    let mut numbers = date.strip_prefix('M')?.split('.').map(|part| part.parse::<i64>().ok());
    Some(Day {
        month: numbers.next()??.clamp(1, 12),
        week: numbers.next()??.clamp(1, 5),
        weekday: numbers.next()??.rem_euclid(7),
        second: clock(time)?.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_offsets() {
        assert_eq!(Zone::parse("+05:30"), Some(Zone::Offset(19_800)));
        assert_eq!(Zone::parse("-0330"), Some(Zone::Offset(-12_600)));
        assert_eq!(Zone::parse("+5"), None);
        assert_eq!(Zone::parse("Not/AZone"), None);
        assert_eq!(Zone::parse("../../etc/passwd"), None);
    }

    #[test]
    fn knows_summer_time_by_rule() {
        let rule = rule("CET-1CEST,M3.5.0,M10.5.0/3").unwrap();
        assert_eq!(rule.offset_at(days_of(2100, 7, 1) * 86_400), 7200);
        assert_eq!(rule.offset_at(days_of(2100, 1, 1) * 86_400), 3600);
    }
}
