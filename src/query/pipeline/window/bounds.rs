//! The bounds of windows: by positions, or by values of the field that is sorted by.

use std::ops::Range;

use bson::Bson;

use super::member::{number, wrong};
use super::order::Order;
use super::partition::Partition;
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Unit, date_step};
use crate::query::number::Number;
use crate::query::zone::Zone;

/// One end of a window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum End<T> {
    Unbounded,
    Current,
    At(T),
}

/// The bounds of the window of each document.
#[derive(Debug, Clone)]
pub(super) enum Bounds {
    Documents(End<i64>, End<i64>),
    Range(End<Number>, End<Number>, Option<Unit>),
}

impl Bounds {
    /// The whole partition.
    pub(super) const ALL: Self = Self::Documents(End::Unbounded, End::Unbounded);

    pub(super) fn parse(value: &Bson, order: &Order) -> Result<Self> {
        let Bson::Document(spec) = value else { return Err(wrong("the 'window' must be an object")) };
        if let Some(name) = spec.keys().find(|name| !matches!(name.as_str(), "documents" | "range" | "unit")) {
            return Err(wrong(format!("the 'window' has the unknown field: {name}")));
        }
        let unit = match spec.get("unit") {
            None => None,
            Some(Bson::String(name)) => {
                Some(Unit::parse(name).ok_or_else(|| wrong(format!("unknown time unit value: {name}")))?)
            }
            Some(_) => return Err(wrong("'unit' must be a string")),
        };
        match (spec.get("documents"), spec.get("range")) {
            (Some(_), Some(_)) => Err(wrong("a window has either documents or a range")),
            (None, None) if unit.is_some() => Err(wrong("'unit' needs a range")),
            (None, None) => Ok(Self::ALL),
            (Some(_), None) if unit.is_some() => Err(wrong("'unit' is for windows of a range only")),
            (Some(documents), None) => Self::documents(documents, order),
            (None, Some(range)) => Self::range(range, unit, order),
        }
    }

    fn documents(value: &Bson, order: &Order) -> Result<Self> {
        let integer = |value: &Bson| {
            let number = Number::of(value).and_then(Number::integral);
            number.ok_or_else(|| wrong("bounds of documents must be integers"))
        };
        let (low, high) = pair(value, integer)?;
        if (low, high) != (End::Unbounded, End::Unbounded) && !order.is_sorted() {
            return Err(QueryError::invalid(5_339_901, "bounds of documents need a sortBy"));
        }
        let position = |end: End<i64>, unbounded: i64| match end {
            End::Unbounded => unbounded,
            End::Current => 0,
            End::At(offset) => offset,
        };
        if position(low, i64::MIN) > position(high, i64::MAX) {
            return Err(QueryError::invalid(5_339_900, "the lower bound of a window exceeds the upper one"));
        }
        Ok(Self::Documents(low, high))
    }

    fn range(value: &Bson, unit: Option<Unit>, order: &Order) -> Result<Self> {
        let numeric = |value: &Bson| Number::of(value).ok_or_else(|| wrong("bounds of a range must be numbers"));
        let (low, high) = pair(value, numeric)?;
        if !order.is_by_one() {
            return Err(QueryError::invalid(5_339_902, "bounds of a range need a sortBy of one field"));
        }
        if let (End::At(low), End::At(high)) = (low, high)
            && low.compare(high).is_gt()
        {
            return Err(QueryError::invalid(5_339_900, "the lower bound of a window exceeds the upper one"));
        }
        Ok(Self::Range(low, high, unit))
    }

    /// Whether documents leave the window as it moves on.
    pub(super) fn leaves(&self) -> bool {
        !matches!(self, Self::Documents(End::Unbounded, _) | Self::Range(End::Unbounded, ..))
    }

    /// Returns the window of each document of a partition, one after the other.
    pub(super) fn moving(&self, descending: bool) -> Moving<'_> {
        Moving { bounds: self, descending, before: 0..0 }
    }

    /// Returns the value at one end of a range; `None` where it is unbounded.
    fn limit(&self, end: End<Number>, at: Option<&Bson>, unit: Option<Unit>) -> Result<Option<Bson>> {
        let by = match end {
            End::Unbounded => return Ok(None),
            End::Current => Number::Int(0),
            End::At(by) => by,
        };
        match (at, unit) {
            (Some(Bson::DateTime(date)), Some(unit)) => {
                let moved = date_step(date.timestamp_millis(), unit, by.to_long(), &Zone::UTC);
                let moved = moved.ok_or_else(|| QueryError::bad_value("a date of a range is out of bounds"))?;
                Ok(Some(Bson::DateTime(bson::DateTime::from_millis(moved))))
            }
            (_, Some(_)) => Err(QueryError::invalid(5_429_513, "the field of a range with a 'unit' must be a date")),
            (at, None) => {
                let number = number(at)
                    .ok_or_else(|| QueryError::invalid(5_429_414, "the field of a range must be a number"))?;
                use crate::query::arithmetic::{Overflow, add};
                Ok(Some(add(number, by, Overflow::Double)?.into()))
            }
        }
    }
}

/// The windows of the documents of a partition, as numbers of documents.
#[derive(Debug)]
pub(super) struct Moving<'a> {
    bounds: &'a Bounds,
    descending: bool,
    /// The window before: the next one begins and ends near it.
    before: Range<usize>,
}

impl Moving<'_> {
    /// Returns the window of a document.
    pub(super) fn at(&mut self, partition: &Partition<'_>, index: usize) -> Result<Range<usize>> {
        let length = partition.len();
        match self.bounds {
            Bounds::Documents(low, high) => {
                let offset = |by: i64| i64::try_from(index).unwrap_or(i64::MAX).saturating_add(by).max(0);
                let position = |by: i64| usize::try_from(offset(by)).unwrap_or(usize::MAX).min(length);
                let low = match low {
                    End::Unbounded => 0,
                    End::Current => index,
                    End::At(by) => position(*by),
                };
                let high = match high {
                    End::Unbounded => length,
                    End::Current => index + 1,
                    End::At(by) => position(by.saturating_add(1)),
                };
                Ok(low..high.max(low))
            }
            Bounds::Range(low, high, unit) => {
                if self.descending {
                    return Err(QueryError::invalid(8_947_400, "bounds of a range need an ascending sortBy"));
                }
                let member = partition.get(index)?;
                let at = member.as_ref().and_then(|member| member.at.as_ref());
                let low = self.bounds.limit(*low, at, *unit)?;
                let high = self.bounds.limit(*high, at, *unit)?;
                let compare = crate::query::compare::compare_values;
                let start = match low {
                    None => 0,
                    Some(low) => boundary(partition, self.before.start, |at| compare(at, &low).is_lt())?,
                };
                let end = match high {
                    None => length,
                    Some(high) => boundary(partition, self.before.end, |at| compare(at, &high).is_le())?,
                };
                self.before = start..end;
                Ok(start..end.max(start))
            }
        }
    }
}

/// Returns the number of the first document that is not before a boundary, which is searched from a document near it.
fn boundary(partition: &Partition<'_>, near: usize, is_before: impl Fn(&Bson) -> bool) -> Result<usize> {
    let is_before = |index: usize| {
        let member = partition.get(index)?;
        Ok::<_, QueryError>(member.is_some_and(|member| is_before(member.at.as_ref().unwrap_or(&Bson::Null))))
    };
    let mut index = near;
    while index > 0 && !is_before(index - 1)? {
        index -= 1;
    }
    while is_before(index)? {
        index += 1;
    }
    Ok(index)
}

fn pair<T>(value: &Bson, read: impl Fn(&Bson) -> Result<T>) -> Result<(End<T>, End<T>)> {
    let Bson::Array(items) = value else { return Err(wrong("the bounds of a window must be an array of two")) };
    let [low, high] = items.as_slice() else {
        return Err(wrong("the bounds of a window must be an array of two"));
    };
    let end = |value: &Bson| match value {
        Bson::String(name) if name == "unbounded" => Ok(End::Unbounded),
        Bson::String(name) if name == "current" => Ok(End::Current),
        Bson::String(_) => Err(wrong("the bounds of a window are 'unbounded', 'current', or numbers")),
        value => read(value).map(End::At),
    };
    Ok((end(low)?, end(high)?))
}
