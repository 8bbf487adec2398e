//! Dates written in a format of `$dateToString`.

use crate::calendar::Civil;
use crate::query::error::{QueryError, Result};
use crate::query::zone::Zone;

/// The letters that may follow `%`.
const SPECIFIERS: &str = "dGHjLmMSuUVwYzZ%";

/// Refuses a format that says something unknown.
pub(super) fn check_format(format: &str) -> Result<()> {
    let mut chars = format.chars();
    while let Some(c) = chars.next() {
        if c == '%' {
            match chars.next() {
                None => return Err(QueryError::invalid(18_535, "unmatched '%' at end of format string")),
                Some(next) if SPECIFIERS.contains(next) => {}
                Some(next) => {
                    return Err(QueryError::invalid(
                        18_536,
                        format!("invalid format character '%{next}' in format string"),
                    ));
                }
            }
        }
    }
    Ok(())
}

/// The text of a date in a format.
pub(super) fn formatted(format: &str, millis: i64, zone: &Zone) -> Result<String> {
    let civil = Civil::from_millis(zone.local(millis));
    if !(0..=9999).contains(&civil.year) {
        return Err(QueryError::invalid(
            18_537,
            format!("$dateToString is only defined on year 0-9999, tried to use year {}", civil.year),
        ));
    }
    let offset = zone.offset_at(millis) / 60;
    let mut text = String::with_capacity(format.len() + 16);
    let mut chars = format.chars();
    while let Some(c) = chars.next() {
        if c != '%' {
            text.push(c);
            continue;
        }
        let part = match chars.next() {
            Some('d') => format!("{:02}", civil.day),
            Some('G') => format!("{:04}", civil.iso_week().0),
            Some('H') => format!("{:02}", civil.hour),
            Some('j') => format!("{:03}", civil.day_of_year()),
            Some('L') => format!("{:03}", civil.millisecond),
            Some('m') => format!("{:02}", civil.month),
            Some('M') => format!("{:02}", civil.minute),
            Some('S') => format!("{:02}", civil.second),
            Some('u') => format!("{}", (civil.weekday() + 6) % 7 + 1),
            Some('U') => format!("{:02}", civil.week()),
            Some('V') => format!("{:02}", civil.iso_week().1),
            Some('w') => format!("{}", civil.weekday() + 1),
            Some('Y') => format!("{:04}", civil.year),
            Some('z') => {
                let sign = if offset < 0 { '-' } else { '+' };
                format!("{sign}{:02}{:02}", offset.abs() / 60, offset.abs() % 60)
            }
            Some('Z') => offset.to_string(),
            _ => "%".to_owned(),
        };
        text.push_str(&part);
    }
    Ok(text)
}
