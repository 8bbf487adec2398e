//! Dates: parts, texts, and sums.

mod format;
mod scan;

use bson::{Bson, DateTime};

use super::boundary::{Unit, date_bin, date_difference, date_step};
use super::operator::{Arguments, Named, Operator, document, is_null, type_name, wrong_type};
use super::value::Value;
use crate::calendar::{Civil, iso_date};
use crate::query::error::{QueryError, Result};
use crate::query::number::Number;
use crate::query::zone::Zone;
use format::{check_format, formatted};
use scan::{scan, scan_iso};

pub(super) use scan::parse_iso;

pub(super) const OPERATORS: [Operator; 0] = [];

/// An operator that takes a part out of a date.
macro_rules! part {
    ($name:literal, $take:expr) => {
        Named {
            name: $name,
            fields: &[("date", true), ("timezone", false)],
            bare: true,
            call: |arguments| part(arguments, $take),
        }
    };
}

pub(super) const NAMED: [Named; 21] = [
    part!("$year", |civil| int(civil.year)),
    part!("$month", |civil| int(civil.month)),
    part!("$dayOfMonth", |civil| int(civil.day)),
    part!("$dayOfWeek", |civil| int(civil.weekday() + 1)),
    part!("$dayOfYear", |civil| int(civil.day_of_year())),
    part!("$hour", |civil| int(civil.hour)),
    part!("$minute", |civil| int(civil.minute)),
    part!("$second", |civil| int(civil.second)),
    part!("$millisecond", |civil| int(civil.millisecond)),
    part!("$week", |civil| int(civil.week())),
    part!("$isoWeek", |civil| int(civil.iso_week().1)),
    part!("$isoWeekYear", |civil| Bson::Int64(civil.iso_week().0)),
    part!("$isoDayOfWeek", |civil| int((civil.weekday() + 6) % 7 + 1)),
    Named {
        name: "$dateToParts",
        fields: &[("date", true), ("timezone", false), ("iso8601", false)],
        bare: false,
        call: to_parts,
    },
    Named {
        name: "$dateFromParts",
        fields: &[
            ("year", false),
            ("month", false),
            ("day", false),
            ("hour", false),
            ("minute", false),
            ("second", false),
            ("millisecond", false),
            ("isoWeekYear", false),
            ("isoWeek", false),
            ("isoDayOfWeek", false),
            ("timezone", false),
        ],
        bare: false,
        call: from_parts,
    },
    Named {
        name: "$dateToString",
        fields: &[("date", true), ("format", false), ("timezone", false), ("onNull", false)],
        bare: false,
        call: to_string,
    },
    Named {
        name: "$dateFromString",
        fields: &[("dateString", true), ("format", false), ("timezone", false), ("onError", false), ("onNull", false)],
        bare: false,
        call: from_string,
    },
    Named {
        name: "$dateAdd",
        fields: &[("startDate", true), ("unit", true), ("amount", true), ("timezone", false)],
        bare: false,
        call: |a| moved(a, 1),
    },
    Named {
        name: "$dateSubtract",
        fields: &[("startDate", true), ("unit", true), ("amount", true), ("timezone", false)],
        bare: false,
        call: |a| moved(a, -1),
    },
    Named {
        name: "$dateDiff",
        fields: &[("startDate", true), ("endDate", true), ("unit", true), ("timezone", false), ("startOfWeek", false)],
        bare: false,
        call: difference,
    },
    Named {
        name: "$dateTrunc",
        fields: &[("date", true), ("unit", true), ("binSize", false), ("timezone", false), ("startOfWeek", false)],
        bare: false,
        call: truncated,
    },
];

fn int(value: i64) -> Bson {
    i32::try_from(value).map_or(Bson::Int64(value), Bson::Int32)
}

/// Returns the moment that a date, a timestamp or an ObjectId has.
fn moment(operator: &str, value: &Bson) -> Result<i64> {
    match value {
        Bson::DateTime(moment) => Ok(moment.timestamp_millis()),
        Bson::Timestamp(timestamp) => Ok(i64::from(timestamp.time) * 1000),
        Bson::ObjectId(id) => Ok(object_id_millis(id)),
        other => {
            let code = match operator {
                "$dateAdd" | "$dateSubtract" => 5_166_403,
                "$dateDiff" => 5_166_307,
                "$dateTrunc" => 5_439_012,
                _ => 16_006,
            };
            Err(wrong_type(code, operator, "a date", other))
        }
    }
}

/// Returns the moment in an ObjectId, whose seconds are signed.
pub(super) fn object_id_millis(id: &bson::oid::ObjectId) -> i64 {
    let [a, b, c, d, ..] = id.bytes();
    i64::from(i32::from_be_bytes([a, b, c, d])) * 1000
}

/// Returns the zone of an argument: UTC where it is not given, nothing where it is null.
fn zone(arguments: &Arguments, index: usize) -> Result<Option<Zone>> {
    if !arguments.given(index) {
        return Ok(Some(Zone::UTC));
    }
    match arguments.get(index) {
        value if is_null(value) => Ok(None),
        Bson::String(name) => Zone::parse(name)
            .map(Some)
            .ok_or_else(|| QueryError::invalid(40_485, format!("unrecognized time zone identifier: \"{name}\""))),
        other => {
            let code = if is_part(arguments.operator) { 40_533 } else { 40_517 };
            Err(wrong_type(code, arguments.operator, "a time zone as string", other))
        }
    }
}

/// Whether it takes a part out of a date: these need no names of arguments.
pub(super) fn is_part(operator: &str) -> bool {
    NAMED.iter().any(|named| named.bare && named.name == operator)
}

fn part(arguments: &Arguments, take: fn(Civil) -> Bson) -> Result<Value> {
    let Some(value) = arguments.present(0) else { return Ok(Some(Bson::Null)) };
    let millis = moment(arguments.operator, value)?;
    let Some(zone) = zone(arguments, 1)? else { return Ok(Some(Bson::Null)) };
    Ok(Some(take(Civil::from_millis(zone.local(millis)))))
}

fn to_parts(arguments: &Arguments) -> Result<Value> {
    let Some(zone) = zone(arguments, 1)? else { return Ok(Some(Bson::Null)) };
    let iso = match arguments.get(2) {
        _ if !arguments.given(2) => false,
        value if is_null(value) => return Ok(Some(Bson::Null)),
        Bson::Boolean(iso) => *iso,
        other => return Err(wrong_type(40_521, "$dateToParts", "a boolean iso8601", other)),
    };
    let Some(value) = arguments.present(0) else { return Ok(Some(Bson::Null)) };
    let civil = Civil::from_millis(zone.local(moment("$dateToParts", value)?));
    let time = [
        ("hour", int(civil.hour)),
        ("minute", int(civil.minute)),
        ("second", int(civil.second)),
        ("millisecond", int(civil.millisecond)),
    ];
    let date = if iso {
        let (year, week) = civil.iso_week();
        [("isoWeekYear", int(year)), ("isoWeek", int(week)), ("isoDayOfWeek", int((civil.weekday() + 6) % 7 + 1))]
    } else {
        [("year", int(civil.year)), ("month", int(civil.month)), ("day", int(civil.day))]
    };
    Ok(Some(document(date.into_iter().chain(time))))
}

/// Where the arguments of `$dateFromParts` are.
const YEAR: usize = 0;
const ISO_YEAR: usize = 7;

fn from_parts(arguments: &Arguments) -> Result<Value> {
    let (plain, iso) = (arguments.given(YEAR), arguments.given(ISO_YEAR));
    let mixed =
        plain && (iso || arguments.given(8) || arguments.given(9)) || iso && (arguments.given(1) || arguments.given(2));
    if mixed {
        return Err(QueryError::invalid(40_489, "$dateFromParts does not allow mixing natural dates with ISO dates"));
    }
    if !plain && !iso {
        return Err(QueryError::invalid(
            40_516,
            "$dateFromParts requires either 'year' or 'isoWeekYear' to be present",
        ));
    }
    let mut parts = [0i64; 10];
    for (index, part) in parts.iter_mut().enumerate() {
        let default = if matches!(index, 1 | 2 | 8 | 9) { 1 } else { 0 };
        *part = match arguments.get(index) {
            _ if !arguments.given(index) => default,
            value if is_null(value) => return Ok(Some(Bson::Null)),
            value => Number::of(value).and_then(Number::integral).ok_or_else(|| {
                QueryError::invalid(40_515, format!("$dateFromParts needs integers, not {}", type_name(value)))
            })?,
        };
    }
    let Some(zone) = zone(arguments, 10)? else { return Ok(Some(Bson::Null)) };
    let [year, month, day, hour, minute, second, millisecond, iso_year, iso_week, iso_day] = parts;
    if plain && !(1..=9999).contains(&year) || iso && !(1..=9999).contains(&iso_year) {
        return Err(QueryError::invalid(40_523, "the year must be between 1 and 9999"));
    }
    let limited = [month, day, iso_week, iso_day, hour, minute].iter().all(|part| (-32_768..=32_767).contains(part));
    if !limited || second.unsigned_abs() > 1 << 52 || millisecond.unsigned_abs() > 1 << 52 {
        return Err(QueryError::invalid(31_034, "a part of the date is out of range"));
    }
    let (year, month, day) = if iso { iso_date(iso_year, iso_week, iso_day) } else { (year, month, day) };
    let civil = Civil { year, month, day, hour, minute, second, millisecond };
    let local = civil.to_millis().ok_or_else(|| QueryError::invalid(31_034, "the date is out of range"))?;
    Ok(Some(Bson::DateTime(DateTime::from_millis(zone.moment(local)))))
}

fn to_string(arguments: &Arguments) -> Result<Value> {
    let format = match arguments.get(1) {
        _ if !arguments.given(1) => "%Y-%m-%dT%H:%M:%S.%LZ",
        value if is_null(value) => return Ok(Some(Bson::Null)),
        Bson::String(format) => format,
        other => return Err(wrong_type(18_533, "$dateToString", "a format as string", other)),
    };
    check_format(format)?;
    let Some(zone) = zone(arguments, 2)? else { return Ok(Some(Bson::Null)) };
    let Some(value) = arguments.present(0) else {
        return Ok(if arguments.given(3) {
            arguments.values.get(3).cloned().flatten().flatten()
        } else {
            Some(Bson::Null)
        });
    };
    let millis = moment("$dateToString", value)?;
    let format = if arguments.given(1) || zone == Zone::UTC { format } else { "%Y-%m-%dT%H:%M:%S.%L" };
    formatted(format, millis, &zone).map(|text| Some(Bson::String(text)))
}

fn from_string(arguments: &Arguments) -> Result<Value> {
    let fallback = |index: usize| arguments.values.get(index).cloned().flatten().flatten();
    let format = match arguments.get(1) {
        _ if !arguments.given(1) => None,
        value if is_null(value) => return Ok(Some(Bson::Null)),
        Bson::String(format) => {
            check_format(format)?;
            Some(format.as_str())
        }
        other => return Err(wrong_type(40_684, "$dateFromString", "a format as string", other)),
    };
    let zone_given = arguments.given(2);
    let Some(zone) = zone(arguments, 2)? else { return Ok(Some(Bson::Null)) };
    let text = match arguments.get(0) {
        value if is_null(value) => return Ok(if arguments.given(4) { fallback(4) } else { Some(Bson::Null) }),
        Bson::String(text) => text,
        _ if arguments.given(3) => return Ok(fallback(3)),
        other => return Err(wrong_type(241, "$dateFromString", "a string", other)),
    };
    let read = match format {
        Some(format) => scan(text, format),
        None => scan_iso(text),
    };
    let millis = read.filter(|read| !(zone_given && read.offset.is_some())).map(|read| match read.offset {
        Some(offset) => read.local - offset * 1000,
        None => zone.moment(read.local),
    });
    match millis {
        Some(millis) => Ok(Some(Bson::DateTime(DateTime::from_millis(millis)))),
        None if arguments.given(3) => Ok(fallback(3)),
        None => Err(QueryError::invalid(241, format!("error parsing date string '{text}'"))),
    }
}

fn unit(arguments: &Arguments, index: usize) -> Result<Option<Unit>> {
    match arguments.get(index) {
        value if is_null(value) => Ok(None),
        Bson::String(name) => Unit::parse(name)
            .map(Some)
            .ok_or_else(|| QueryError::failed_to_parse(format!("unknown time unit value: {name}"))),
        other => {
            let moves = matches!(arguments.operator, "$dateAdd" | "$dateSubtract");
            let code = if moves { 5_166_404 } else { 5_439_013 };
            Err(wrong_type(code, arguments.operator, "a unit as string", other))
        }
    }
}

/// 0 is Sunday.
fn start_of_week(arguments: &Arguments, index: usize) -> Result<Option<i64>> {
    const DAYS: [&str; 7] = ["sunday", "monday", "tuesday", "wednesday", "thursday", "friday", "saturday"];
    if !arguments.given(index) {
        return Ok(Some(0));
    }
    match arguments.get(index) {
        value if is_null(value) => Ok(None),
        Bson::String(name) => {
            let name = name.to_ascii_lowercase();
            let day = DAYS.iter().position(|day| *day == name || (name.len() == 3 && day.starts_with(&name)));
            day.and_then(|day| i64::try_from(day).ok())
                .map(Some)
                .ok_or_else(|| QueryError::failed_to_parse(format!("unknown day of week value: {name}")))
        }
        other => Err(wrong_type(5_439_015, arguments.operator, "a day of the week as string", other)),
    }
}

/// Whether an argument is null, which decides before any that is wrong.
fn nothing(arguments: &Arguments) -> bool {
    (0..arguments.values.len()).any(|index| arguments.given(index) && arguments.present(index).is_none())
}

fn moved(arguments: &Arguments, sign: i64) -> Result<Value> {
    let operator = arguments.operator;
    if nothing(arguments) {
        return Ok(Some(Bson::Null));
    }
    let zone = zone(arguments, 3)?;
    let start = arguments.present(0).map(|start| moment(operator, start)).transpose()?;
    let unit = unit(arguments, 1)?;
    let amount = match arguments.present(2) {
        None => None,
        Some(value) => Some(
            Number::of(value)
                .and_then(Number::integral)
                .ok_or_else(|| QueryError::invalid(5_166_405, format!("{operator} expects an integer amount")))?,
        ),
    };
    let (Some(start), Some(unit), Some(amount), Some(zone)) = (start, unit, amount, zone) else {
        return Ok(Some(Bson::Null));
    };
    let overflow = || QueryError::invalid(5_166_406, format!("{operator} overflowed"));
    let amount = amount.checked_mul(sign).ok_or_else(overflow)?;
    let moved = date_step(start, unit, amount, &zone).ok_or_else(overflow)?;
    Ok(Some(Bson::DateTime(DateTime::from_millis(moved))))
}

fn difference(arguments: &Arguments) -> Result<Value> {
    if nothing(arguments) {
        return Ok(Some(Bson::Null));
    }
    let zone = zone(arguments, 3)?;
    let date = |index: usize| arguments.present(index).map(|date| moment("$dateDiff", date)).transpose();
    let (start, end) = (date(0)?, date(1)?);
    let unit = unit(arguments, 2)?;
    let week = if unit == Some(Unit::Week) { start_of_week(arguments, 4)? } else { Some(0) };
    let (Some(start), Some(end), Some(unit), Some(zone), Some(week)) = (start, end, unit, zone, week) else {
        return Ok(Some(Bson::Null));
    };
    date_difference(start, end, unit, week, &zone)
        .map(|difference| Some(Bson::Int64(difference)))
        .ok_or_else(|| QueryError::invalid(5_166_308, "$dateDiff overflowed"))
}

/// The most units that `$dateTrunc` takes together.
const MOST_UNITS: i64 = 100_000_000_000;

fn truncated(arguments: &Arguments) -> Result<Value> {
    if nothing(arguments) {
        return Ok(Some(Bson::Null));
    }
    let zone = zone(arguments, 3)?;
    let date = arguments.present(0).map(|date| moment("$dateTrunc", date)).transpose()?;
    let unit = unit(arguments, 1)?;
    let bin = match arguments.get(2) {
        _ if !arguments.given(2) => Some(1),
        value if is_null(value) => None,
        value => Some(
            Number::of(value)
                .and_then(Number::integral)
                .filter(|bin| *bin > 0)
                .ok_or_else(|| QueryError::invalid(5_439_017, "$dateTrunc requires a positive integral 'binSize'"))?,
        ),
    };
    if bin.is_some_and(|bin| bin > MOST_UNITS) {
        return Err(QueryError::invalid(5_439_006, format!("$dateTrunc takes a 'binSize' of at most {MOST_UNITS}")));
    }
    let week = if unit == Some(Unit::Week) { start_of_week(arguments, 4)? } else { Some(0) };
    let (Some(millis), Some(unit), Some(bin), Some(zone), Some(week)) = (date, unit, bin, zone, week) else {
        return Ok(Some(Bson::Null));
    };
    date_bin(millis, unit, bin, week, &zone)
        .map(|millis| Some(Bson::DateTime(DateTime::from_millis(millis))))
        .ok_or_else(|| QueryError::invalid(5_439_018, "$dateTrunc overflowed"))
}
