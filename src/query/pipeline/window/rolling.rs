//! Values over windows that move: what enters is added, what leaves is taken away again, as in mongod, so that the
//! last digits are mongod's, too.

use std::ops::Range;

use bson::Bson;

use super::bounds::Moving;
use super::column::Column;
use super::member::Member;
use crate::query::error::Result;
use crate::query::number::Number;
use crate::query::pipeline::run::Run;
use crate::query::statistics::Sum;

/// What is known of the items in a window.
pub(super) trait Rolling {
    /// What enters and leaves.
    type Item;

    fn add(&mut self, item: &Self::Item) -> Result<()>;
    fn remove(&mut self, item: &Self::Item) -> Result<()>;
    fn value(&mut self) -> Result<Bson>;
}

/// The value of each window over the items that documents give. An item that leaves is computed again.
pub(super) fn rolled<'a, R: Rolling + 'a, E>(
    item: impl Fn(&Member, &Run<'_, E>) -> Result<R::Item> + 'a,
    mut windows: Moving<'a>,
    start: impl Fn() -> R + 'a,
) -> Column<'a, E> {
    let (mut state, mut done): (R, Range<usize>) = (start(), 0..0);
    Box::new(move |partition, index, run| {
        let window = windows.at(partition, index)?;
        if window.start < done.start || window.end < done.end || window.start > done.end {
            (state, done) = (start(), window.start..window.start);
        }
        for number in done.end..window.end {
            let Some(member) = partition.get(number)? else { break };
            state.add(&item(&member, run)?)?;
        }
        for number in done.start..window.start {
            let Some(member) = partition.get(number)? else { break };
            state.remove(&item(&member, run)?)?;
        }
        done = window;
        state.value().map(Some)
    })
}

/// The standard deviation over a window that moves at both ends: the sum and the squared distances are corrected for
/// each number that enters or leaves.
#[derive(Debug)]
pub(super) struct Deviation {
    sample: bool,
    n: u32,
    /// How many others are infinite or NaN.
    special: u32,
    sum: Sum,
    squares: Sum,
}

impl Deviation {
    pub(super) fn new(sample: bool) -> Self {
        Self { sample, n: 0, special: 0, sum: Sum::default(), squares: Sum::default() }
    }

    /// Takes a number to `n` others, or away from them, with its part of the squares.
    fn correct(&mut self, value: f64, n: f64, sign: f64) {
        let distance = n * value - self.sum.total().to_double();
        self.sum.add(Number::Double(value * sign));
        self.squares.add(Number::Double(distance * distance * sign / ((n + sign) * n)));
    }
}

impl Rolling for Deviation {
    type Item = Option<Number>;

    fn add(&mut self, item: &Self::Item) -> Result<()> {
        match *item {
            None => {}
            Some(number) if !number.is_finite() => self.special += 1,
            Some(number) if self.n == 0 => {
                self.n = 1;
                self.sum.add(number);
            }
            Some(number) => {
                self.correct(number.to_double(), f64::from(self.n), 1.0);
                self.n += 1;
            }
        }
        Ok(())
    }

    fn remove(&mut self, item: &Self::Item) -> Result<()> {
        match *item {
            None => {}
            Some(number) if !number.is_finite() => self.special = self.special.saturating_sub(1),
            Some(_) if self.n <= 1 => (self.n, self.sum, self.squares) = (0, Sum::default(), Sum::default()),
            Some(number) => {
                self.correct(number.to_double(), f64::from(self.n), -1.0);
                self.n -= 1;
            }
        }
        Ok(())
    }

    fn value(&mut self) -> Result<Bson> {
        let squares = self.squares.total().to_double();
        // The deviation of a sample of none is the root of nothing over -1.
        let divisor = f64::from(self.n) - if self.sample { 1.0 } else { 0.0 };
        Ok(match divisor {
            _ if self.special > 0 => Bson::Null,
            0.0 => Bson::Null,
            // Squares are not negative: what is, begins anew.
            _ if squares < 0.0 || self.n == 1 => {
                self.squares = Sum::default();
                Bson::Int32(0)
            }
            divisor => Bson::Double((squares / divisor).sqrt()),
        })
    }
}
