//! The numbers of series.

use bson::Bson;

use crate::query::decimal::Decimal;
use crate::query::number::Number;

/// A number as a double, or as a decimal where a decimal takes part.
#[derive(Debug, Clone, Copy)]
pub(super) enum Real {
    Double(f64),
    Decimal(Decimal),
}

impl From<Number> for Real {
    fn from(number: Number) -> Self {
        match number {
            Number::Decimal(decimal) => Self::Decimal(decimal),
            other => Self::Double(other.to_double()),
        }
    }
}

impl From<Real> for Bson {
    fn from(real: Real) -> Self {
        match real {
            Real::Double(double) => Self::Double(double),
            Real::Decimal(decimal) => Self::Decimal128(decimal.into()),
        }
    }
}

impl Real {
    fn with(self, other: Self, double: fn(f64, f64) -> f64, decimal: fn(Decimal, Decimal) -> Decimal) -> Self {
        match (self, other) {
            (Self::Double(a), Self::Double(b)) => Self::Double(double(a, b)),
            (a, b) => Self::Decimal(decimal(a.decimal(), b.decimal())),
        }
    }

    fn decimal(self) -> Decimal {
        match self {
            Self::Double(double) => Number::Double(double).to_decimal(),
            Self::Decimal(decimal) => decimal,
        }
    }

    pub(super) fn plus(self, other: Self) -> Self {
        self.with(other, |a, b| a + b, Decimal::plus)
    }

    pub(super) fn minus(self, other: Self) -> Self {
        self.with(other, |a, b| a - b, Decimal::minus)
    }

    pub(super) fn times(self, other: Self) -> Self {
        self.with(other, |a, b| a * b, Decimal::times)
    }

    pub(super) fn over(self, other: Self) -> Self {
        self.with(other, |a, b| a / b, Decimal::over)
    }
}
