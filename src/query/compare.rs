//! The order of BSON values: by type, then by value.

use std::cmp::Ordering;

use bson::{Bson, RawBsonRef};

use super::collation;
use super::view::{Fields, Items, View};

/// Compares two values in BSON order: first by type (numbers are one type,
/// strings and symbols are one), then by value. A total order in which `1`,
/// `1L`, `1.0` and `Decimal 1` are equal, and NaN is the least number. Strings compare by the
/// [collation](super::collation) in effect.
#[must_use]
pub fn compare(a: RawBsonRef<'_>, b: RawBsonRef<'_>) -> Ordering {
    views(a.into(), b.into())
}

/// [`compare`] for owned values.
#[must_use]
pub fn compare_values(a: &Bson, b: &Bson) -> Ordering {
    views(a.into(), b.into())
}

/// Returns the place of a type in the order; types of one place are compared by value.
pub(super) fn canonical_type(value: View<'_>) -> u8 {
    match value {
        View::MinKey => 1,
        View::Undefined => 2,
        View::Null => 5,
        View::Number(_) => 10,
        View::String(_) | View::Symbol(_) => 15,
        View::Document(_) => 20,
        View::Array(_) => 25,
        View::Binary(..) => 30,
        View::ObjectId(_) => 35,
        View::Bool(_) => 40,
        View::Date(_) => 45,
        View::Timestamp(..) => 47,
        View::Regex(..) => 50,
        View::DbPointer(_) => 55,
        View::Code(_) => 60,
        View::CodeWithScope(..) => 65,
        View::MaxKey => 127,
    }
}

/// Compares two views.
pub(super) fn views(a: View<'_>, b: View<'_>) -> Ordering {
    match (a, b) {
        (View::Number(a), View::Number(b)) => a.compare(b),
        (View::String(a) | View::Symbol(a), View::String(b) | View::Symbol(b)) => collation::compare(a, b),
        (View::Document(a), View::Document(b)) => documents(a, b),
        (View::Array(a), View::Array(b)) => arrays(a, b),
        (View::Binary(s1, b1), View::Binary(s2, b2)) => (b1.len(), s1, b1).cmp(&(b2.len(), s2, b2)),
        (View::ObjectId(a), View::ObjectId(b)) => a.bytes().cmp(&b.bytes()),
        (View::Bool(a), View::Bool(b)) => a.cmp(&b),
        (View::Date(a), View::Date(b)) => a.cmp(&b),
        (View::Timestamp(t1, i1), View::Timestamp(t2, i2)) => (t1, i1).cmp(&(t2, i2)),
        (View::Regex(p1, o1), View::Regex(p2, o2)) => (p1, o1).cmp(&(p2, o2)),
        (View::DbPointer(a), View::DbPointer(b)) => a.text().cmp(&b.text()),
        (View::Code(a), View::Code(b)) => a.cmp(b),
        (View::CodeWithScope(c1, s1), View::CodeWithScope(c2, s2)) => c1.cmp(c2).then_with(|| documents(s1, s2)),
        (a, b) => canonical_type(a).cmp(&canonical_type(b)),
    }
}

/// Returns a value that may be missing; a missing one comes before all but MinKey and equals only itself.
pub(super) fn optional(a: Option<View<'_>>, b: Option<View<'_>>) -> Ordering {
    match (a, b) {
        (Some(a), Some(b)) => views(a, b),
        (None, None) => Ordering::Equal,
        (None, Some(View::MinKey)) => Ordering::Greater,
        (Some(View::MinKey), None) => Ordering::Less,
        (None, Some(_)) => Ordering::Less,
        (Some(_), None) => Ordering::Greater,
    }
}

pub(super) fn equal(a: View<'_>, b: View<'_>) -> bool {
    views(a, b) == Ordering::Equal
}

pub(super) fn equal_values(a: &Bson, b: &Bson) -> bool {
    compare_values(a, b) == Ordering::Equal
}

/// A value whose fields are sorted by name: schemas take no notice of their order.
pub(super) fn settled(value: Bson) -> Bson {
    match value {
        Bson::Document(fields) => {
            let mut fields: Vec<(String, Bson)> =
                fields.into_iter().map(|(name, value)| (name, settled(value))).collect();
            fields.sort_by(|(one, _), (other, _)| one.cmp(other));
            Bson::Document(fields.into_iter().collect())
        }
        Bson::Array(items) => Bson::Array(items.into_iter().map(settled).collect()),
        other => other,
    }
}

/// Whether two of the items are equal.
pub(super) fn has_equal<T: Copy>(mut items: Vec<T>, compare: impl Fn(T, T) -> Ordering) -> bool {
    items.sort_by(|one, other| compare(*one, *other));
    items.windows(2).any(|pair| matches!(pair, [one, other] if compare(*one, *other).is_eq()))
}

/// Field by field: type, then name, then value.
fn documents(a: Fields<'_>, b: Fields<'_>) -> Ordering {
    let (mut a, mut b) = (a.iter(), b.iter());
    loop {
        let ((name1, value1), (name2, value2)) = match (a.next(), b.next()) {
            (None, None) => return Ordering::Equal,
            (None, Some(_)) => return Ordering::Less,
            (Some(_), None) => return Ordering::Greater,
            (Some(first), Some(second)) => (first, second),
        };
        let order = canonical_type(value1)
            .cmp(&canonical_type(value2))
            .then_with(|| name1.as_bytes().cmp(name2.as_bytes()))
            .then_with(|| views(value1, value2));
        if order != Ordering::Equal {
            return order;
        }
    }
}

fn arrays(a: Items<'_>, b: Items<'_>) -> Ordering {
    let (mut a, mut b) = (a.iter(), b.iter());
    loop {
        let order = match (a.next(), b.next()) {
            (None, None) => return Ordering::Equal,
            (None, Some(_)) => return Ordering::Less,
            (Some(_), None) => return Ordering::Greater,
            (Some(first), Some(second)) => views(first, second),
        };
        if order != Ordering::Equal {
            return order;
        }
    }
}
