//! Sums, means and deviations over numbers of all types.

use bson::{Bson, Decimal128};

use super::decimal::Decimal;
use super::number::Number;

/// A running sum: pure integers exactly, everything with a rest beside the sum of doubles, decimals apart.
///
/// The last digit is MongoDB's: each number takes the rest along before it is added (Boldo, Graillat and Muller, "On
/// the robustness of the 2Sum and Fast2Sum algorithms", 2016).
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sum {
    integers: i128,
    double: f64,
    rest: f64,
    /// The sum without a rest, which stays right when infinities come in.
    plain: f64,
    decimal: Option<Decimal>,
    has_longs: bool,
    floating: bool,
}

impl Sum {
    pub(super) fn add(&mut self, number: Number) {
        match number {
            Number::Int(value) => {
                self.integers += i128::from(value);
                self.add_double(f64::from(value));
            }
            Number::Long(value) => {
                self.integers += i128::from(value);
                self.add_long(value);
                self.has_longs = true;
            }
            Number::Double(value) => {
                self.floating = true;
                self.add_double(value);
            }
            Number::Decimal(value) => self.decimal = Some(self.decimal.map_or(value, |sum| sum.plus(value))),
        }
    }

    /// Adds in two parts that are doubles exactly.
    #[expect(clippy::cast_precision_loss, reason = "each part has at most 32 significant bits")]
    fn add_long(&mut self, value: i64) {
        let low = value % (1 << 32);
        self.add_double(low as f64);
        self.add_double((value - low) as f64);
    }

    fn add_double(&mut self, value: f64) {
        self.plain += value;
        let carried = value + self.rest;
        let lost = self.rest - (carried - value);
        let sum = self.double + carried;
        let part = sum - carried;
        let error = (self.double - part) + (carried - (sum - part));
        self.double = sum;
        self.rest = lost + error;
    }

    /// Returns what [`Sum::load`] makes the same sum of.
    pub(super) fn save(self) -> Vec<u8> {
        let mut bytes = self.integers.to_le_bytes().to_vec();
        for double in [self.double, self.rest, self.plain] {
            bytes.extend_from_slice(&double.to_le_bytes());
        }
        bytes.extend_from_slice(&[self.has_longs.into(), self.floating.into()]);
        if let Some(Bson::Decimal128(decimal)) = self.decimal.map(|decimal| Number::Decimal(decimal).into()) {
            bytes.extend_from_slice(&decimal.bytes());
        }
        bytes
    }

    /// Returns the sum that was saved.
    pub(super) fn load(mut bytes: &[u8]) -> Self {
        let mut sum = Self { integers: i128::from_le_bytes(part(&mut bytes)), ..Self::default() };
        for double in [&mut sum.double, &mut sum.rest, &mut sum.plain] {
            *double = f64::from_le_bytes(part(&mut bytes));
        }
        let [has_longs, floating] = part(&mut bytes);
        (sum.has_longs, sum.floating) = (has_longs != 0, floating != 0);
        if !bytes.is_empty() {
            sum.decimal = Some(Decimal128::from_bytes(part(&mut bytes)).into());
        }
        sum
    }

    fn to_double(self) -> f64 {
        if self.double.is_nan() { self.plain } else { self.double }
    }

    /// What is no decimal, as one: doubles with 34 digits.
    fn others(self) -> Decimal {
        if !self.floating {
            Decimal::from_integer(self.integers)
        } else if self.double.is_finite() {
            Decimal::from_double(self.double).plus(Decimal::from_double(self.rest))
        } else {
            Decimal::from_double(self.plain)
        }
    }

    pub(super) fn total(self) -> Number {
        if let Some(decimal) = self.decimal {
            return Number::Decimal(decimal.plus(self.others()));
        }
        if self.floating {
            return Number::Double(self.to_double());
        }
        match (i32::try_from(self.integers), i64::try_from(self.integers)) {
            (Ok(value), _) if !self.has_longs => Number::Int(value),
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

/// Takes so many bytes off the front; zeros where there are fewer.
fn part<const N: usize>(bytes: &mut &[u8]) -> [u8; N] {
    let Some((first, rest)) = bytes.split_first_chunk() else { return [0; N] };
    *bytes = rest;
    *first
}

/// Returns the sum.
pub(super) fn total(numbers: impl Iterator<Item = Number>) -> Number {
    let mut sum = Sum::default();
    for number in numbers {
        sum.add(number);
    }
    sum.total()
}

/// Returns the mean; nothing of nothing.
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

    /// Returns what [`Deviation::load`] makes the same of.
    pub(super) fn save(self) -> [f64; 3] {
        [self.count, self.mean, self.squares]
    }

    /// Returns the deviation that was saved.
    pub(super) fn load(mut parts: impl Iterator<Item = f64>) -> Self {
        let mut part = || parts.next().unwrap_or_default();
        Self { count: part(), mean: part(), squares: part() }
    }

    pub(super) fn value(self, sample: bool) -> Bson {
        let divisor = if sample { self.count - 1.0 } else { self.count };
        if divisor <= 0.0 { Bson::Null } else { Bson::Double((self.squares / divisor).sqrt()) }
    }
}

/// Returns the standard deviation, of a sample or of a population; null of too few.
pub(super) fn deviation(numbers: impl Iterator<Item = Number>, sample: bool) -> Bson {
    let mut running = Deviation::default();
    for number in numbers {
        running.add(number);
    }
    running.value(sample)
}
