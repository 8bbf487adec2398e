//! `$covariancePop` and `$covarianceSamp`.

use bson::Bson;

use super::bounds::Moving;
use super::column::{Column, evaluate};
use super::member::Member;
use super::rolling::{Rolling, rolled};
use crate::query::arithmetic::{Overflow, multiply, subtract};
use crate::query::error::Result;
use crate::query::expression::{Expression, Scope};
use crate::query::number::Number;
use crate::query::pipeline::run::Run;
use crate::query::statistics::Sum;

/// The covariance of pairs.
#[derive(Debug)]
pub(super) struct Covariance {
    pair: Expression,
    sample: bool,
}

impl Covariance {
    pub(super) fn parse(name: &str, argument: &Bson, scope: &Scope) -> Result<Self> {
        Ok(Self { pair: Expression::parse_in(argument, scope)?, sample: name == "$covarianceSamp" })
    }

    pub(super) fn column<'a, E>(&'a self, windows: Moving<'a>) -> Column<'a, E> {
        let pair = |member: &Member, run: &Run<'_, E>| {
            Ok(match evaluate(&self.pair, member, run)? {
                Some(Bson::Array(items)) => match items.as_slice() {
                    [x, y] => Number::of(x).zip(Number::of(y)),
                    _ => None,
                },
                _ => None,
            })
        };
        rolled(pair, windows, || Pairs { sample: self.sample, ..Pairs::default() })
    }
}

/// The pairs in a window, as mongod sums them: each adds the product of its distances from the mean of x before it
/// and the mean of y with it, in compensated sums. Infinities and NaN are kept apart, so that they can leave again.
#[derive(Debug, Default)]
struct Pairs {
    sample: bool,
    n: u32,
    x: Sum,
    y: Sum,
    products: Sum,
    special: Special,
}

/// How many values are no finite numbers.
#[derive(Debug, Default)]
struct Special {
    infinite: u32,
    negative: u32,
    nan: u32,
    /// How many of them are decimals.
    decimals: u32,
}

impl Rolling for Pairs {
    type Item = Option<(Number, Number)>;

    fn add(&mut self, item: &Self::Item) -> Result<()> {
        let Some((x, y)) = *item else { return Ok(()) };
        if !x.is_finite() || !y.is_finite() {
            self.special.count(x, y, |count| *count += 1);
            return Ok(());
        }
        self.y.add(y);
        if self.n > 0 {
            let product = self.product(x, y, self.n, self.n + 1)?;
            self.products.add(product);
        }
        self.x.add(x);
        self.n += 1;
        Ok(())
    }

    fn remove(&mut self, item: &Self::Item) -> Result<()> {
        let Some((x, y)) = *item else { return Ok(()) };
        if !x.is_finite() || !y.is_finite() {
            self.special.count(x, y, |count| *count = count.saturating_sub(1));
            return Ok(());
        }
        if self.n <= 1 {
            *self = Self { sample: self.sample, special: std::mem::take(&mut self.special), ..Self::default() };
            return Ok(());
        }
        self.x.add(negated(x)?);
        let product = self.product(x, y, self.n - 1, self.n)?;
        self.products.add(negated(product)?);
        self.y.add(negated(y)?);
        self.n -= 1;
        Ok(())
    }

    fn value(&mut self) -> Result<Bson> {
        let n = self.n.saturating_sub(u32::from(self.sample));
        Ok(match (n, self.n, self.special.value()) {
            (0, ..) => Bson::Null,
            (_, 1, _) => Bson::Double(0.0),
            (_, _, Some(special)) => special.into(),
            (n, ..) => over(self.products, n).into(),
        })
    }
}

impl Pairs {
    /// The product of the distances of a pair from the means of so many values.
    fn product(&self, x: Number, y: Number, n_x: u32, n_y: u32) -> Result<Number> {
        let mean = |sum: Sum, count: u32| sum.mean(count.into()).unwrap_or(Number::Int(0));
        let x = subtract(x, mean(self.x, n_x), Overflow::Double)?;
        let y = subtract(y, mean(self.y, n_y), Overflow::Double)?;
        multiply(x, y, Overflow::Double)
    }
}

impl Special {
    fn count(&mut self, x: Number, y: Number, change: fn(&mut u32)) {
        for number in [x, y].into_iter().filter(|number| !number.is_finite()) {
            if matches!(number, Number::Decimal(_)) {
                change(&mut self.decimals);
            }
            match number.to_double() {
                value if value.is_nan() => change(&mut self.nan),
                f64::INFINITY => change(&mut self.infinite),
                f64::NEG_INFINITY => change(&mut self.negative),
                _ => {}
            }
        }
    }

    /// Their sum, where there are any.
    fn value(&self) -> Option<Number> {
        let sum = match (self.infinite, self.negative, self.nan) {
            (0, 0, 0) => return None,
            (_, 0, 0) => f64::INFINITY,
            (0, _, 0) => f64::NEG_INFINITY,
            _ => f64::NAN,
        };
        let sum = Number::Double(sum);
        Some(if self.decimals > 0 { Number::Decimal(sum.exact()) } else { sum })
    }
}

fn negated(number: Number) -> Result<Number> {
    multiply(number, Number::Int(-1), Overflow::Double)
}

/// A sum over a count, which is a double in mongod: as a divisor it gives decimals their exponent.
fn over(sum: Sum, count: u32) -> Number {
    match sum.total() {
        Number::Decimal(total) => Number::Decimal(total.over(Number::Double(count.into()).to_decimal())),
        total => Number::Double(total.to_double() / f64::from(count)),
    }
}
