//! The four numeric types as one.

use std::cmp::Ordering;

use bson::Bson;

use super::decimal::{Decimal, Rounding};

/// A number of any BSON type.
#[derive(Debug, Clone, Copy)]
pub(super) enum Number {
    Int(i32),
    Long(i64),
    Double(f64),
    Decimal(Decimal),
}

impl Number {
    /// Order by value across the types; NaN is the least and equals itself.
    pub(super) fn compare(self, other: Self) -> Ordering {
        use Number::{Decimal as D, Double, Int, Long};
        match (self, other) {
            (Int(a), Int(b)) => a.cmp(&b),
            (Long(a), Long(b)) => a.cmp(&b),
            (Int(a), Long(b)) => i64::from(a).cmp(&b),
            (Long(a), Int(b)) => a.cmp(&i64::from(b)),
            (Double(a), Double(b)) => doubles(a, b),
            (Double(a), Int(b)) => doubles(a, f64::from(b)),
            (Int(a), Double(b)) => doubles(f64::from(a), b),
            (Double(a), Long(b)) => double_and_long(a, b),
            (Long(a), Double(b)) => double_and_long(b, a).reverse(),
            (D(a), b) => a.compare(b.exact()),
            (a, D(b)) => a.exact().compare(b),
        }
    }

    /// As a decimal, doubles with 34 digits.
    pub(super) fn exact(self) -> Decimal {
        match self {
            Self::Int(value) => Decimal::from_integer(value.into()),
            Self::Long(value) => Decimal::from_integer(value.into()),
            Self::Double(value) => Decimal::from_double(value),
            Self::Decimal(value) => value,
        }
    }

    /// As a decimal, doubles with the 15 digits MongoDB gives them in arithmetic.
    pub(super) fn to_decimal(self) -> Decimal {
        match self {
            Self::Double(value) => Decimal::from_double_15(value),
            other => other.exact(),
        }
    }

    pub(super) fn to_double(self) -> f64 {
        match self {
            Self::Int(value) => value.into(),
            #[expect(clippy::cast_precision_loss, reason = "the nearest double is meant")]
            Self::Long(value) => value as f64,
            Self::Double(value) => value,
            Self::Decimal(value) => value.to_double(),
        }
    }

    /// Truncated; saturating, and 0 for NaN.
    pub(super) fn to_long(self) -> i64 {
        match self {
            Self::Int(value) => value.into(),
            Self::Long(value) => value,
            #[expect(clippy::cast_possible_truncation, reason = "truncation is meant")]
            Self::Double(value) => value as i64,
            Self::Decimal(value) => match value.to_i128() {
                Some(value) => i64::try_from(value).unwrap_or(if value < 0 { i64::MIN } else { i64::MAX }),
                None if value.is_nan() => 0,
                None if value.is_negative() => i64::MIN,
                None => i64::MAX,
            },
        }
    }

    /// Returns the value as an integer, where it is one that fits 64 bits.
    pub(super) fn integral(self) -> Option<i64> {
        match self {
            Self::Int(value) => Some(value.into()),
            Self::Long(value) => Some(value),
            Self::Double(value) => double_to_long(value).filter(|_| value.fract() == 0.0),
            Self::Decimal(value) if value.is_integral() => i64::try_from(value.to_i128()?).ok(),
            Self::Decimal(_) => None,
        }
    }

    /// Returns the value as a 32-bit integer, where it is one.
    pub(super) fn integral_32(self) -> Option<i32> {
        i32::try_from(self.integral()?).ok()
    }

    pub(super) fn is_nan(self) -> bool {
        match self {
            Self::Double(value) => value.is_nan(),
            Self::Decimal(value) => value.is_nan(),
            _ => false,
        }
    }

    pub(super) fn is_finite(self) -> bool {
        match self {
            Self::Double(value) => value.is_finite(),
            Self::Decimal(value) => !value.is_nan() && !value.is_infinite(),
            _ => true,
        }
    }

    /// Returns an integer, as MongoDB takes one of options: the fraction of a double is cut off, a decimal is rounded.
    pub(super) fn coerced(self) -> i64 {
        match self {
            Self::Decimal(value) => Self::Decimal(value.round_to(0, Rounding::HalfEven)).to_long(),
            other => other.to_long(),
        }
    }

    pub(super) fn is_zero(self) -> bool {
        match self {
            Self::Int(value) => value == 0,
            Self::Long(value) => value == 0,
            Self::Double(value) => value == 0.0,
            Self::Decimal(value) => value.is_zero(),
        }
    }

    /// Returns the number a value is.
    pub(super) fn of(value: &Bson) -> Option<Self> {
        match value {
            Bson::Int32(value) => Some(Self::Int(*value)),
            Bson::Int64(value) => Some(Self::Long(*value)),
            Bson::Double(value) => Some(Self::Double(*value)),
            Bson::Decimal128(value) => Some(Self::Decimal((*value).into())),
            _ => None,
        }
    }
}

impl From<Number> for Bson {
    fn from(number: Number) -> Self {
        match number {
            Number::Int(value) => Self::Int32(value),
            Number::Long(value) => Self::Int64(value),
            Number::Double(value) => Self::Double(value),
            Number::Decimal(value) => Self::Decimal128(value.into()),
        }
    }
}

/// Returns the integer part, where it is in the range of 64-bit integers.
pub(super) fn double_to_long(value: f64) -> Option<i64> {
    const LIMIT: f64 = 9_223_372_036_854_775_808.0;
    #[expect(clippy::cast_possible_truncation, reason = "the range is checked")]
    (-LIMIT..LIMIT).contains(&value).then_some(value as i64)
}

fn doubles(a: f64, b: f64) -> Ordering {
    a.partial_cmp(&b).unwrap_or_else(|| b.is_nan().cmp(&a.is_nan()))
}

fn double_and_long(a: f64, b: i64) -> Ordering {
    if a.is_nan() {
        return Ordering::Less;
    }
    match double_to_long(a) {
        None if a < 0.0 => Ordering::Less,
        None => Ordering::Greater,
        Some(whole) => whole.cmp(&b).then_with(|| doubles(a.fract(), 0.0)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn compares_longs_and_doubles_exactly() {
        let big = (1i64 << 53) + 1;
        assert_eq!(Number::Long(big).compare(Number::Double(9_007_199_254_740_992.0)), Ordering::Greater);
        assert_eq!(Number::Long(i64::MAX).compare(Number::Double(9.3e18)), Ordering::Less);
        assert_eq!(Number::Long(-3).compare(Number::Double(-3.5)), Ordering::Greater);
        assert_eq!(Number::Double(f64::NAN).compare(Number::Long(i64::MIN)), Ordering::Less);
        assert_eq!(Number::Double(0.1).compare(Number::Decimal(Decimal::parse("0.1").unwrap())), Ordering::Greater);
    }
}
