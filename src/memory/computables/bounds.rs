//! Bounds of numbers: which values a condition on a key can match.
//!
//! They exclude what certainly does not match, so that a spec is tried on few queries; whether it matches, the spec says.

use bson::{Bson, Document};

/// The least and the greatest number that a condition matches, both included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bounds {
    low: f64,
    high: f64,
}

impl Bounds {
    /// What matches values of other types, too.
    pub(super) const NONE: Self = Self { low: f64::NEG_INFINITY, high: f64::INFINITY };

    /// The bounds of a condition on one key.
    pub(super) fn of(condition: &Bson) -> Self {
        match condition {
            Bson::Document(operators) if operators.keys().all(|name| name.starts_with('$')) => Self::within(operators),
            value => number(value).map_or(Self::NONE, |number| Self { low: number, high: number }),
        }
    }

    fn within(operators: &Document) -> Self {
        let mut bounds = Self::NONE;
        for (name, value) in operators {
            let Some(number) = number(value) else { continue };
            if matches!(name.as_str(), "$gt" | "$gte" | "$eq") {
                bounds.low = bounds.low.max(number);
            }
            if matches!(name.as_str(), "$lt" | "$lte" | "$eq") {
                bounds.high = bounds.high.min(number);
            }
        }
        bounds
    }

    /// Whether the condition can match a value. Numbers equal numbers only; an array may have elements of any kind.
    pub(super) fn admit(&self, value: &Bson) -> bool {
        match value {
            Bson::Int32(value) => self.contain(f64::from(*value)),
            Bson::Int64(value) => self.contain(*value as f64),
            Bson::Double(value) if !value.is_nan() => self.contain(*value),
            Bson::String(_) | Bson::Document(_) | Bson::Boolean(_) | Bson::ObjectId(_) => *self == Self::NONE,
            _ => true,
        }
    }

    fn contain(&self, number: f64) -> bool {
        self.low <= number && number <= self.high
    }
}

/// A finite number; a whole one beyond 2^53 as the nearest that a double can be, which keeps the order.
fn number(value: &Bson) -> Option<f64> {
    let number = match value {
        Bson::Int32(value) => f64::from(*value),
        Bson::Int64(value) => *value as f64,
        Bson::Double(value) => *value,
        _ => return None,
    };
    number.is_finite().then_some(number)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::query::Filter;
    use bson::doc;

    #[test]
    fn what_a_condition_matches_is_admitted() {
        let large = (1_i64 << 53) + 1;
        let conditions: [Bson; 9] = [
            5.into(),
            doc! { "$gt": 3 }.into(),
            doc! { "$exists": true, "$gte": 3, "$lt": 5.5 }.into(),
            doc! { "$eq": 4_i64 }.into(),
            doc! { "$gt": large - 1 }.into(),
            doc! { "$lt": f64::INFINITY, "$ne": 4 }.into(),
            doc! { "$not": { "$gt": 3 } }.into(),
            doc! { "$in": [1, "x"] }.into(),
            doc! { "$gt": f64::NEG_INFINITY }.into(),
        ];
        let values: [Bson; 14] = [
            3.into(),
            4_i64.into(),
            5.0.into(),
            5.5.into(),
            large.into(),
            f64::NAN.into(),
            f64::INFINITY.into(),
            "x".into(),
            Bson::Null,
            vec![1, 9].into(),
            doc! { "$gt": 4 }.into(),
            true.into(),
            Bson::Decimal128("4".parse().unwrap()),
            Bson::MaxKey,
        ];
        let mut excluded = 0;
        for condition in &conditions {
            let (bounds, filter) = (Bounds::of(condition), Filter::parse(&doc! { "x": condition.clone() }).unwrap());
            for value in &values {
                let is_match = filter.matches_document(&doc! { "x": value.clone() }).unwrap();
                assert!(bounds.admit(value) || !is_match, "{condition} {value}");
                excluded += u32::from(!bounds.admit(value));
            }
        }
        assert!(excluded > 30, "{excluded}");
    }
}
