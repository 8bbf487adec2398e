//! Logarithms and powers of e of decimals.

use std::cmp::Ordering;

use super::{Decimal, MIN_EXPONENT};

impl Decimal {
    /// Returns the natural logarithm of a positive number, by Newton's method from that of the double.
    pub(in crate::query) fn logarithm(self) -> Self {
        match self {
            Self::Infinite { negative: false } => self,
            Self::Finite { negative: false, .. } if self.compare(Self::ONE) == Ordering::Equal => Self::ZERO,
            Self::Finite { negative: false, coefficient, exponent } if coefficient != 0 => {
                let digits = i32::try_from(coefficient.ilog10()).unwrap_or(0);
                let scaled = Self::Finite { negative: false, coefficient, exponent: -digits };
                let ten = Self::from_integer(10).logarithm_near_one();
                scaled.logarithm_near_one().plus(ten.times(Self::from_integer((exponent + digits).into())))
            }
            _ => Self::NaN,
        }
    }

    /// Returns the logarithm of a number from 1 to 10.
    fn logarithm_near_one(self) -> Self {
        let mut guess = Self::from_double(self.to_double().ln());
        for _ in 0..2 {
            let power = guess.exponential();
            let step = self.minus(power).over(self.plus(power)).times(Self::from_integer(2));
            guess = guess.plus(step);
        }
        guess
    }

    /// Returns the logarithm to base 10 of a positive number; exact for powers of ten.
    pub(in crate::query) fn logarithm_10(self) -> Self {
        if let Self::Finite { negative: false, coefficient: 1, exponent } = self.reduced() {
            return Self::from_integer(exponent.into());
        }
        self.logarithm().over(Self::from_integer(10).logarithm())
    }

    /// e to this power, by its series after halving the argument.
    pub(in crate::query) fn exponential(self) -> Self {
        match self {
            Self::Infinite { negative: true } => Self::ZERO,
            Self::NaN | Self::Infinite { .. } => self,
            Self::Finite { .. } if self.is_zero() => Self::ONE,
            Self::Finite { .. } => {
                let size = self.to_double();
                if size > 15_000.0 {
                    return Self::Infinite { negative: false };
                }
                if size < -15_000.0 {
                    return Self::Finite { negative: false, coefficient: 0, exponent: MIN_EXPONENT };
                }
                let mut halvings = 0u32;
                let mut argument = self;
                let half = Self::Finite { negative: false, coefficient: 5, exponent: -1 };
                while argument.to_double().abs() > 0.5 {
                    argument = argument.times(half);
                    halvings += 1;
                }
                let (mut sum, mut term) = (Self::ONE, Self::ONE);
                for index in 1..40 {
                    term = term.times(argument).over(Self::from_integer(index));
                    sum = sum.plus(term);
                }
                for _ in 0..halvings {
                    sum = sum.times(sum);
                }
                sum
            }
        }
    }
}
