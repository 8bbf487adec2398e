//! Dates read from texts.

use crate::calendar::{Civil, days_in_month, iso_date};
use crate::query::zone::Zone;

/// What a text says: a local clock, and perhaps seconds east of UTC.
pub(super) struct Read {
    pub(super) local: i64,
    pub(super) offset: Option<i64>,
}

/// Reads an ISO 8601 date, as `$toDate` does.
pub(in crate::query::expression) fn parse_iso(text: &str) -> Option<i64> {
    scan_iso(text).map(|read| read.local - read.offset.unwrap_or(0) * 1000)
}

/// A cursor over a text.
struct Cursor<'a> {
    rest: &'a str,
}

impl<'a> Cursor<'a> {
    fn digits(&mut self, least: usize, most: usize) -> Option<i64> {
        let count = self.rest.bytes().take(most).take_while(u8::is_ascii_digit).count();
        if count < least {
            return None;
        }
        let (digits, rest) = self.rest.split_at_checked(count)?;
        self.rest = rest;
        digits.parse().ok()
    }

    fn eat(&mut self, text: &str) -> bool {
        match self.rest.strip_prefix(text) {
            Some(rest) => {
                self.rest = rest;
                true
            }
            None => false,
        }
    }

    /// `Z`, `UTC`, `GMT`, `+02:00`, `-0330`, or a name of a zone.
    fn zone(&mut self, local: i64) -> Option<i64> {
        let text = std::mem::take(&mut self.rest).trim_start();
        let zone = Zone::parse(text)?;
        Some(zone.offset_at(zone.moment(local)))
    }
}

/// Reads a date in the forms of ISO 8601 that MongoDB takes.
pub(super) fn scan_iso(text: &str) -> Option<Read> {
    let mut cursor = Cursor { rest: text.trim_matches(|c: char| c.is_whitespace() || c == '\0') };
    let year = cursor.digits(4, 4)?;
    let dashed = cursor.eat("-");
    let month = cursor.digits(1, 2)?;
    if dashed && !cursor.eat("-") || !dashed && cursor.rest.is_empty() {
        return None;
    }
    let day = cursor.digits(1, 2)?;
    let (mut hour, mut minute, mut second, mut millisecond) = (0, 0, 0, 0);
    if cursor.eat("T")
        || cursor.eat("t")
        || (cursor.rest.starts_with([' ', '\t']) && cursor.rest.trim_start().starts_with(|c: char| c.is_ascii_digit()))
    {
        cursor.rest = cursor.rest.trim_start();
        hour = cursor.digits(1, 2)?;
        let colon = cursor.eat(":");
        minute = if colon { cursor.digits(1, 2)? } else { cursor.digits(2, 2).unwrap_or(0) };
        if cursor.eat(":") || !colon && cursor.rest.starts_with(|c: char| c.is_ascii_digit()) {
            second = cursor.digits(1, 2)?;
            if cursor.eat(".") || cursor.eat(",") {
                millisecond = fraction(&mut cursor)?;
            }
        }
    }
    let local = checked(year, month, day, hour, minute, second, millisecond)?;
    let offset = if cursor.rest.is_empty() { None } else { Some(cursor.zone(local)?) };
    Some(Read { local, offset })
}

/// Digits after the point as milliseconds.
fn fraction(cursor: &mut Cursor<'_>) -> Option<i64> {
    let count = cursor.rest.bytes().take_while(u8::is_ascii_digit).count();
    let digits = cursor.rest.get(..count.min(3))?;
    let value: i64 = digits.parse().ok()?;
    cursor.rest = cursor.rest.get(count..)?;
    Some(value * [100, 10, 1].get(digits.len().checked_sub(1)?)?)
}

fn checked(year: i64, month: i64, day: i64, hour: i64, minute: i64, second: i64, millisecond: i64) -> Option<i64> {
    let valid = (1..=12).contains(&month)
        && (1..=days_in_month(year, month)).contains(&day)
        && (0..24).contains(&hour)
        && (0..60).contains(&minute)
        && (0..60).contains(&second);
    if !valid {
        return None;
    }
    Civil { year, month, day, hour, minute, second, millisecond }.to_millis()
}

/// Reads a date in a format.
pub(super) fn scan(text: &str, format: &str) -> Option<Read> {
    let mut cursor = Cursor { rest: text };
    let (mut year, mut month, mut day, mut of_year) = (None, None, None, None);
    let (mut iso_year, mut iso_week, mut iso_day) = (None, None, None);
    let (mut hour, mut minute, mut second, mut millisecond) = (0, 0, 0, 0);
    let mut offset = None;
    let mut zone = None;
    let mut chars = format.chars();
    while let Some(c) = chars.next() {
        if c != '%' {
            if !cursor.eat(c.encode_utf8(&mut [0; 4])) {
                return None;
            }
            continue;
        }
        match chars.next()? {
            'Y' => year = Some(cursor.digits(4, 4)?),
            'm' => month = Some(cursor.digits(1, 2)?),
            'd' => day = Some(cursor.digits(1, 2)?),
            'j' => of_year = Some(cursor.digits(1, 3)?),
            'G' => iso_year = Some(cursor.digits(4, 4)?),
            'V' => iso_week = Some(cursor.digits(1, 2)?),
            'u' => iso_day = Some(cursor.digits(1, 1)?),
            'H' => hour = cursor.digits(1, 2)?,
            'M' => minute = cursor.digits(1, 2)?,
            'S' => second = cursor.digits(1, 2)?,
            'L' => millisecond = cursor.digits(1, 3)?,
            '%' => {
                if !cursor.eat("%") {
                    return None;
                }
            }
            'z' => {
                let length = cursor
                    .rest
                    .find(|c: char| !(c.is_ascii_alphanumeric() || "+-:/_".contains(c)))
                    .unwrap_or(cursor.rest.len());
                let (name, rest) = cursor.rest.split_at_checked(length)?;
                cursor.rest = rest;
                zone = Some(Zone::parse(name)?);
            }
            'Z' => {
                let sign = if cursor.eat("-") { -1 } else { i64::from(cursor.eat("+")) };
                if sign == 0 {
                    return None;
                }
                offset = Some(sign * cursor.digits(1, 4)? * 60);
            }
            _ => return None,
        }
    }
    if !cursor.rest.is_empty() {
        return None;
    }
    let local = match (iso_year, of_year) {
        (Some(iso_year), _) => {
            let (year, month, day) = iso_date(iso_year, iso_week.unwrap_or(1), iso_day.unwrap_or(1));
            Civil { year, month, day, hour, minute, second, millisecond }.to_millis()?
        }
        (None, Some(of_year)) => {
            Civil { year: year?, month: 1, day: of_year, hour, minute, second, millisecond }.to_millis()?
        }
        _ => checked(year?, month?, day?, hour, minute, second, millisecond)?,
    };
    let offset = offset.or_else(|| zone.map(|zone| zone.offset_at(zone.moment(local))));
    Some(Read { local, offset })
}
