//! Sums, means and deviations over numbers of all types.

use bson::Bson;

use super::decimal::Decimal;
use super::number::Number;

/// A running sum: integers exactly, doubles with compensation, decimals apart.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sum {
    integers: i128,
    double: f64,
    lost: f64,
    decimal: Option<Decimal>,
    wide: bool,
    floating: bool,
}

impl Sum {
    pub(super) fn add(&mut self, number: Number) {
        match number {
            Number::Int(value) => self.integers += i128::from(value),
            Number::Long(value) => {
                self.integers += i128::from(value);
                self.wide = true;
            }
            Number::Double(value) => {
                self.floating = true;
                self.add_double(value);
            }
            Number::Decimal(value) => self.decimal = Some(self.decimal.map_or(value, |sum| sum.plus(value))),
        }
    }

    /// Adds with the rounding error kept (two-sum).
    fn add_double(&mut self, value: f64) {
        let sum = self.double + value;
        if sum.is_finite() {
            let part = sum - self.double;
            self.lost += (self.double - (sum - part)) + (value - part);
        }
        self.double = sum;
    }

    #[expect(clippy::cast_precision_loss, reason = "the nearest double is meant")]
    fn to_double(self) -> f64 {
        let mut sum = self;
        let high = sum.integers as f64;
        let rest = sum.integers.saturating_sub(high as i128) as f64;
        sum.add_double(high);
        sum.add_double(rest);
        if sum.double.is_finite() { sum.double + sum.lost } else { sum.double }
    }

    pub(super) fn total(self) -> Number {
        if let Some(decimal) = self.decimal {
            let decimal = decimal.plus(Decimal::from_integer(self.integers));
            let floating = if self.floating { Self { integers: 0, ..self }.to_double() } else { 0.0 };
            return Number::Decimal(if self.floating {
                decimal.plus(Decimal::from_double_15(floating))
            } else {
                decimal
            });
        }
        if self.floating {
            return Number::Double(self.to_double());
        }
        match (i32::try_from(self.integers), i64::try_from(self.integers)) {
            (Ok(value), _) if !self.wide => Number::Int(value),
            (_, Ok(value)) => Number::Long(value),
            _ => Number::Double(self.to_double()),
        }
    }

    pub(super) fn mean(self, count: u64) -> Option<Number> {
        if count == 0 {
            return None;
        }
        Some(match self.total() {
            Number::Decimal(total) => Number::Decimal(total.over(Decimal::from_integer(count.into()))),
            #[expect(clippy::cast_precision_loss, reason = "counts are far below 2^53")]
            _ => Number::Double(self.to_double() / count as f64),
        })
    }
}

/// The sum.
pub(super) fn total(numbers: impl Iterator<Item = Number>) -> Number {
    let mut sum = Sum::default();
    for number in numbers {
        sum.add(number);
    }
    sum.total()
}

/// The mean; nothing of nothing.
pub(super) fn mean(numbers: impl Iterator<Item = Number>) -> Option<Number> {
    let (mut sum, mut count) = (Sum::default(), 0);
    for number in numbers {
        sum.add(number);
        count += 1;
    }
    sum.mean(count)
}

/// A running standard deviation (Welford).
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Deviation {
    count: f64,
    mean: f64,
    squares: f64,
}

impl Deviation {
    pub(super) fn add(&mut self, number: Number) {
        let value = number.to_double();
        let delta = value - self.mean;
        self.count += 1.0;
        self.mean += delta / self.count;
        self.squares += delta * (value - self.mean);
    }

    pub(super) fn value(self, sample: bool) -> Bson {
        let divisor = if sample { self.count - 1.0 } else { self.count };
        if divisor <= 0.0 { Bson::Null } else { Bson::Double((self.squares / divisor).sqrt()) }
    }
}

/// The standard deviation, of a sample or of a population; null of too few.
pub(super) fn deviation(numbers: impl Iterator<Item = Number>, sample: bool) -> Bson {
    let mut running = Deviation::default();
    for number in numbers {
        running.add(number);
    }
    running.value(sample)
}
