//! Dates as text: ISO 8601 with the extended years of ECMA-262, in UTC.

use std::fmt::Write as _;

use crate::calendar::{DAY, date_of, days_in_month, days_of};

/// What is out of range in a text that is spelled as a date, in words; none where it is not spelled as one.
pub(super) fn wrong(text: &str) -> Option<String> {
    let (year, rest) = year(text)?;
    let (month, rest) = part(rest, '-', 2)?;
    if !(1..=12).contains(&month) {
        return Some(format!("the month {month:02} of `{text}` is not from 01 to 12"));
    }
    let (day, rest) = part(rest, '-', 2)?;
    let days = days_in_month(year, month);
    if !(1..=days).contains(&day) {
        return Some(format!("the day {day:02} of `{text}` is not from 01 to {days}, which this month has"));
    }
    let (hour, rest) = number(rest.strip_prefix(['T', 't', ' '])?, 2)?;
    if hour > 24 {
        return Some(format!("the hour {hour:02} of `{text}` is not from 00 to 23"));
    }
    let (minute, rest) = part(rest, ':', 2)?;
    let second = part(rest, ':', 2).map_or(0, |(second, _)| second);
    let (name, value) = if minute > 59 { ("minute", minute) } else { ("second", second) };
    (value > 59).then(|| format!("the {name} {value:02} of `{text}` is not from 00 to 59"))
}

/// Milliseconds since 1970 of `2024-02-29`, `2024-02-29T12:00Z`, `+012024-02-29T12:00:00.123+01:00`.
/// Without a zone it is UTC.
pub(super) fn parse(text: &str) -> Option<i64> {
    let (year, rest) = year(text)?;
    let (month, rest) = part(rest, '-', 2).unwrap_or((1, rest));
    let (day, rest) = part(rest, '-', 2).unwrap_or((1, rest));
    if !(1..=12).contains(&month) || day < 1 || day > days_in_month(year, month) {
        return None;
    }
    let midnight = days_of(year, month, day).checked_mul(DAY)?;
    if rest.is_empty() {
        return Some(midnight);
    }
    let rest = rest.strip_prefix(['T', 't', ' '])?;
    let (hour, rest) = number(rest, 2)?;
    let (minute, rest) = part(rest, ':', 2)?;
    let (second, rest) = part(rest, ':', 2).unwrap_or((0, rest));
    let (milli, rest) = fraction(rest)?;
    let leap_or_end = hour == 24 && (minute, second, milli) == (0, 0, 0);
    if (hour > 23 && !leap_or_end) || minute > 59 || second > 59 {
        return None;
    }
    let time = ((hour * 60 + minute) * 60 + second) * 1000 + milli;
    midnight.checked_add(time)?.checked_sub(zone(rest)?)
}

/// Like `2024-02-29T12:00:00.123Z`; milliseconds only where there are any.
/// `None` where Extended JSON does not write text: before 1970 and after 9999.
pub(super) fn format(millis: i64) -> Option<String> {
    let (year, month, day) = date_of(millis.div_euclid(DAY));
    if !(1970..=9999).contains(&year) {
        return None;
    }
    let time = millis.rem_euclid(DAY);
    let (seconds, milli) = (time / 1000, time % 1000);
    let (hour, minute, second) = (seconds / 3600, seconds / 60 % 60, seconds % 60);
    let mut text = format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}");
    if milli != 0 {
        let _ = write!(text, ".{milli:03}");
    }
    text.push('Z');
    Some(text)
}

fn year(text: &str) -> Option<(i64, &str)> {
    if let Some(rest) = text.strip_prefix('+') {
        return number(rest, 6);
    }
    match text.strip_prefix('-') {
        Some(rest) => number(rest, 6).map(|(year, rest)| (-year, rest)),
        None => number(text, 4),
    }
}

/// `width` digits.
fn number(text: &str, width: usize) -> Option<(i64, &str)> {
    let digits = text.get(..width)?;
    let all = digits.bytes().all(|byte| byte.is_ascii_digit());
    Some((if all { digits.parse().ok()? } else { return None }, text.get(width..)?))
}

fn part(text: &str, mark: char, width: usize) -> Option<(i64, &str)> {
    number(text.strip_prefix(mark)?, width)
}

/// `.123456` in milliseconds, the rest cut off.
fn fraction(text: &str) -> Option<(i64, &str)> {
    let Some(rest) = text.strip_prefix('.') else { return Some((0, text)) };
    let length = rest.bytes().take_while(u8::is_ascii_digit).count();
    let digits = rest.get(..length).filter(|digits| !digits.is_empty())?;
    let milli = format!("{digits:0<3}").get(..3)?.parse().ok()?;
    Some((milli, rest.get(length..)?))
}

/// The zone's distance from UTC in milliseconds.
fn zone(text: &str) -> Option<i64> {
    if matches!(text, "" | "Z" | "z") {
        return Some(0);
    }
    let (sign, rest) = match text.strip_prefix('+') {
        Some(rest) => (1, rest),
        None => (-1, text.strip_prefix('-')?),
    };
    let (hours, rest) = number(rest, 2)?;
    let rest = rest.strip_prefix(':').unwrap_or(rest);
    let (minutes, rest) = if rest.is_empty() { (0, rest) } else { number(rest, 2)? };
    (rest.is_empty() && hours < 24 && minutes < 60).then_some(sign * (hours * 60 + minutes) * 60_000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_known_instants() {
        assert_eq!(parse("1970-01-01"), Some(0));
        assert_eq!(parse("2012-12-24T12:15:30.501Z"), Some(1_356_351_330_501));
        assert_eq!(parse("1969-12-31T23:59:59.999Z"), Some(-1));
        assert_eq!(parse("2012-12-24T12:15:30.501+01:30"), Some(1_356_351_330_501 - 5_400_000));
        assert_eq!(parse("+010000-01-01T00:00:00Z"), Some(253_402_300_800_000));
        assert_eq!(parse("-000001-01-01T00:00:00Z"), Some(-62_198_755_200_000));
    }

    #[test]
    fn refuses_days_that_are_not_in_the_calendar() {
        for text in ["2023-02-29", "2023-13-01", "2023-00-01", "2023-01-01T25:00Z", "23-1-1", "", "2023-01-01Tnoon"] {
            assert_eq!(parse(text), None, "{text}");
        }
    }

    #[test]
    fn reads_back_what_it_writes() {
        for millis in (0..253_402_300_799_999_i64).step_by(86_399_999_917) {
            assert_eq!(format(millis).as_deref().and_then(parse), Some(millis));
        }
        assert_eq!(format(-1), None);
        assert_eq!(format(i64::MAX), None);
        assert_eq!(format(i64::MIN), None);
    }
}
