//! Arithmetic with intervals (Moore 1966, "Interval analysis"): which values an expression may have, given which values
//! its variables may have.
//!
//! An interval errs on one side only: it contains each value that the arithmetic of [`Expression::value`] leads to. Rounding
//! is monotone, so that bounds are rounded as values are.

use super::number::{Comparator, Expression};

/// The values from one bound to the other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Interval {
    pub(super) low: f64,
    pub(super) high: f64,
    /// Whether there may be no value.
    pub(super) may_lack: bool,
}

impl Interval {
    const ALL: Self = Self { low: f64::NEG_INFINITY, high: f64::INFINITY, may_lack: true };

    /// One value; none where it is not a number.
    pub(super) fn of(value: f64) -> Self {
        match value.is_nan() {
            true => Self { low: f64::INFINITY, high: f64::NEG_INFINITY, may_lack: true },
            false => Self { low: value, high: value, may_lack: false },
        }
    }

    /// Whether there is no value.
    pub(super) fn is_empty(self) -> bool {
        self.low > self.high
    }

    /// The values of both.
    pub(super) fn joined(self, other: Self) -> Self {
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            may_lack: self.may_lack || other.may_lack,
        }
    }

    /// From the lowest to the highest result of bounds.
    fn hull(self, other: Self, results: [f64; 4]) -> Self {
        if self.is_empty() || other.is_empty() {
            return Self::of(f64::NAN);
        }
        if results.iter().any(|result| result.is_nan()) {
            return Self::ALL;
        }
        let (low, high) = results
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), result| (low.min(*result), high.max(*result)));
        Self { low, high, may_lack: self.may_lack || other.may_lack }
    }

    fn plus(self, other: Self) -> Self {
        let (low, high) = (self.low + other.low, self.high + other.high);
        self.hull(other, [low, high, low, high])
    }

    pub(super) fn times(self, other: Self) -> Self {
        let corners = |by: f64| [self.low * by, self.high * by];
        let ([one, two], [three, four]) = (corners(other.low), corners(other.high));
        self.hull(other, [one, two, three, four])
    }

    pub(super) fn divided(self, other: Self) -> Self {
        if other.low <= 0.0 && other.high >= 0.0 {
            return Self::ALL;
        }
        let corners = |by: f64| [self.low / by, self.high / by];
        let ([one, two], [three, four]) = (corners(other.low), corners(other.high));
        self.hull(other, [one, two, three, four])
    }
}

/// The values that an expression may have.
pub(super) fn values(expression: &Expression, variables: &[Interval]) -> Interval {
    match expression {
        Expression::Number(number) => Interval::of(*number),
        Expression::Variable(variable) => variables[*variable as usize],
        Expression::Sum(parts) => {
            parts.iter().map(|part| values(part, variables)).fold(Interval::of(0.0), Interval::plus)
        }
        Expression::Product(left, right) => values(left, variables).times(values(right, variables)),
        Expression::Quotient(left, right) => values(left, variables).divided(values(right, variables)),
    }
}

/// Whether two intervals have values that compare so, and such that do not.
pub(super) fn outcomes(comparator: Comparator, left: Interval, right: Interval) -> [bool; 2] {
    if left.is_empty() || right.is_empty() {
        return [false; 2];
    }
    let compare = |left: f64, right: f64| comparator.compare(left, right);
    match comparator {
        Comparator::Less | Comparator::AtMost => [compare(left.low, right.high), !compare(left.high, right.low)],
        Comparator::AtLeast | Comparator::Greater => [compare(left.high, right.low), !compare(left.low, right.high)],
        Comparator::Equal => {
            let is_apart = |low: f64, high: f64| Comparator::Greater.compare(low, high);
            let meets = !is_apart(left.low, right.high) && !is_apart(right.low, left.high);
            [meets, !(compare(left.low, right.high) && compare(left.high, right.low))]
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn between(low: f64, high: f64) -> Interval {
        Interval { low, high, may_lack: false }
    }

    #[test]
    fn bounds_are_those_of_the_results() {
        let (some, signed) = (between(1.0, 2.0), between(-3.0, 4.0));
        assert_eq!(some.plus(signed), between(-2.0, 6.0));
        assert_eq!(some.times(signed), between(-6.0, 8.0));
        assert_eq!(signed.divided(some), between(-3.0, 4.0));
        assert_eq!(some.divided(signed), Interval::ALL);
        assert!(some.plus(Interval::of(f64::NAN)).is_empty());
    }

    #[test]
    fn comparisons_of_intervals() {
        let (low, high) = (between(0.0, 1.0), between(1.0, 3.0));
        assert_eq!(outcomes(Comparator::Less, low, high), [true, true]);
        assert_eq!(outcomes(Comparator::AtMost, low, high), [true, false]);
        assert_eq!(outcomes(Comparator::Greater, low, high), [false, true]);
        assert_eq!(outcomes(Comparator::Equal, low, high), [true, true]);
        assert_eq!(outcomes(Comparator::Equal, low, between(2.0, 2.0)), [false, true]);
        assert_eq!(outcomes(Comparator::Equal, between(2.0, 2.0), between(2.0, 2.0)), [true, false]);
        assert_eq!(outcomes(Comparator::Less, low, Interval::of(f64::NAN)), [false, false]);
    }

    fn expression() -> impl Strategy<Value = Expression> {
        let number = prop::sample::select(vec![0.0, 1.0, -1.0, 0.5, 3.0, 1e-7]).prop_map(Expression::Number);
        let leaf = prop_oneof![number, (0..2_u32).prop_map(Expression::Variable)];
        leaf.prop_recursive(3, 12, 3, |inner| {
            let two = (inner.clone(), inner.clone());
            prop_oneof![
                prop::collection::vec(inner, 1..3).prop_map(Expression::Sum),
                two.clone().prop_map(|(left, right)| Expression::Product(Box::new(left), Box::new(right))),
                two.prop_map(|(left, right)| Expression::Quotient(Box::new(left), Box::new(right))),
            ]
        })
    }

    proptest! {
        #[test]
        fn no_value_is_out_of_bounds(
            (left, right) in (expression(), expression()),
            bounds in prop::collection::vec((-4_i32..4, 0_i32..3), 2),
            (one, other) in (0.0..=1.0, 0.0..=1.0),
        ) {
            let variables: Vec<Interval> =
                bounds.iter().map(|(low, width)| between(f64::from(*low), f64::from(low + width))).collect();
            let places: [f64; 2] = [one, other];
            let value = |variable: u32| {
                let Interval { low, high, .. } = variables[variable as usize];
                (low + (high - low) * places[variable as usize]).clamp(low, high)
            };
            for expression in [&left, &right] {
                let (found, value) = (values(expression, &variables), expression.value(&value));
                let contains = if value.is_nan() { found.may_lack } else { found.low <= value && value <= found.high };
                prop_assert!(contains);
            }
            let comparators =
                [Comparator::Less, Comparator::AtMost, Comparator::Equal, Comparator::AtLeast, Comparator::Greater];
            for comparator in comparators {
                let [may_hold, may_fail] = outcomes(comparator, values(&left, &variables), values(&right, &variables));
                match comparator.outcome(left.value(&value), right.value(&value)) {
                    Some(true) => prop_assert!(may_hold),
                    Some(false) => prop_assert!(may_fail),
                    None => {}
                }
            }
        }
    }
}
