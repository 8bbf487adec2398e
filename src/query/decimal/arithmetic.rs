//! Sums, products, quotients, roots and roundings of decimals, to 34 digits.

use std::cmp::Ordering;

use ethnum::U256;

use super::{Decimal, MAX_EXPONENT, MIN_EXPONENT, PRECISION, Rounding, round_up};
use crate::query::u256::{square_root, ten_to};

impl Decimal {
    pub(in crate::query) fn negated(self) -> Self {
        match self {
            Self::NaN => Self::NaN,
            Self::Infinite { negative } => Self::Infinite { negative: !negative },
            Self::Finite { negative, coefficient, exponent } => {
                Self::Finite { negative: !negative, coefficient, exponent }
            }
        }
    }

    pub(in crate::query) fn absolute(self) -> Self {
        if self.is_negative() { self.negated() } else { self }
    }

    pub(in crate::query) fn plus(self, other: Self) -> Self {
        use Decimal::{Finite, Infinite, NaN};
        match (self, other) {
            (NaN, _) | (_, NaN) => NaN,
            (Infinite { negative: a }, Infinite { negative: b }) if a != b => NaN,
            (Infinite { .. }, _) => self,
            (_, Infinite { .. }) => other,
            (
                Finite { negative: n1, coefficient: c1, exponent: e1 },
                Finite { negative: n2, coefficient: c2, exponent: e2 },
            ) => {
                if e1 >= e2 {
                    sum((n1, c1, e1), (n2, c2, e2))
                } else {
                    sum((n2, c2, e2), (n1, c1, e1))
                }
            }
        }
    }

    pub(in crate::query) fn minus(self, other: Self) -> Self {
        self.plus(other.negated())
    }

    pub(in crate::query) fn times(self, other: Self) -> Self {
        use Decimal::{Finite, Infinite, NaN};
        let negative = self.is_negative() != other.is_negative();
        match (self, other) {
            (NaN, _) | (_, NaN) => NaN,
            (Infinite { .. }, Infinite { .. }) => Infinite { negative },
            (Infinite { .. }, finite) | (finite, Infinite { .. }) => {
                if finite.is_zero() {
                    NaN
                } else {
                    Infinite { negative }
                }
            }
            (Finite { coefficient: c1, exponent: e1, .. }, Finite { coefficient: c2, exponent: e2, .. }) => {
                Self::rounded(negative, U256::from(c1) * U256::from(c2), e1 + e2, false)
            }
        }
    }

    /// Returns the quotient; dividing by zero gives an infinity, or NaN.
    pub(in crate::query) fn over(self, other: Self) -> Self {
        use Decimal::{Finite, Infinite, NaN};
        let negative = self.is_negative() != other.is_negative();
        match (self, other) {
            (NaN, _) | (_, NaN) | (Infinite { .. }, Infinite { .. }) => NaN,
            (Infinite { .. }, Finite { .. }) => Infinite { negative },
            (Finite { .. }, Infinite { .. }) => Finite { negative, coefficient: 0, exponent: MIN_EXPONENT },
            (Finite { coefficient: c1, exponent: e1, .. }, Finite { coefficient: c2, exponent: e2, .. }) => {
                if c2 == 0 {
                    return if c1 == 0 { NaN } else { Infinite { negative } };
                }
                quotient(negative, (c1, e1), (c2, e2))
            }
        }
    }

    /// Returns the remainder with the sign of the dividend.
    pub(in crate::query) fn modulo(self, other: Self) -> Self {
        use Decimal::{Finite, Infinite, NaN};
        match (self, other) {
            (Finite { .. }, Infinite { .. }) => self,
            (Finite { negative, coefficient: c1, exponent: e1 }, Finite { coefficient: c2, exponent: e2, .. }) => {
                if c2 == 0 {
                    return NaN;
                }
                let exponent = e1.min(e2);
                // Brings both to one exponent; the dividend digit by digit, so that nothing overflows.
                let up2 = e2 - exponent;
                if up2 > 40 {
                    return self;
                }
                let divisor = U256::from(c2) * ten_to(up2.unsigned_abs());
                let mut rest = U256::from(c1) % divisor;
                for _ in 0..(e1 - exponent) {
                    rest = rest * 10 % divisor;
                }
                Self::rounded(negative, rest, exponent, false)
            }
            _ => NaN,
        }
    }

    /// Rounded to `places` digits after the point (before it, where negative).
    pub(in crate::query) fn round_to(self, places: i32, mode: Rounding) -> Self {
        let Self::Finite { negative, coefficient, exponent } = self else { return self };
        let target = -places;
        if exponent >= target {
            return self.quantized(target);
        }
        let dropped = (target - exponent).unsigned_abs();
        let (quotient, rest) = if dropped > 76 {
            (U256::ZERO, U256::from(u8::from(coefficient != 0)))
        } else {
            (U256::from(coefficient) / ten_to(dropped), U256::from(coefficient) % ten_to(dropped))
        };
        let half = ten_to(dropped.min(77) - 1) * 5;
        let up = round_up(quotient, rest, half, false, negative, mode);
        let quotient = if up { quotient + 1 } else { quotient };
        Self::rounded(negative, quotient, target, false)
    }

    /// Returns the same value with a smaller exponent, as far as its digits allow.
    pub(super) fn quantized(self, target: i32) -> Self {
        let Self::Finite { negative, coefficient, exponent } = self else { return self };
        let target = target.max(MIN_EXPONENT);
        if coefficient == 0 {
            return Self::Finite { negative, coefficient, exponent: target };
        }
        let free_digits = PRECISION - (coefficient.ilog10() + 1).min(PRECISION);
        let steps = (exponent - target).unsigned_abs().min(free_digits);
        let lowered = exponent - i32::try_from(steps).unwrap_or(0);
        Self::Finite { negative, coefficient: coefficient * 10u128.pow(steps), exponent: lowered }
    }

    /// Returns the square root; NaN below zero.
    pub(in crate::query) fn root(self) -> Self {
        match self {
            Self::Infinite { negative: false } => self,
            Self::Finite { coefficient: 0, negative, exponent } => {
                Self::Finite { negative, coefficient: 0, exponent: exponent.div_euclid(2) }
            }
            Self::Finite { negative: false, coefficient, exponent } => {
                let digits = coefficient.ilog10() + 1;
                let mut shift = 74 - i32::try_from(digits).unwrap_or(0);
                if (exponent - shift).rem_euclid(2) != 0 {
                    shift -= 1;
                }
                let scaled = scale(coefficient.into(), shift.unsigned_abs());
                let root = square_root(scaled);
                let exact = U256::from(root) * U256::from(root) == scaled;
                let result = Self::rounded(false, root.into(), (exponent - shift) / 2, !exact);
                if exact { result.towards(exponent.div_euclid(2)) } else { result }
            }
            _ => Self::NaN,
        }
    }

    /// Drops trailing zeros until the exponent is `preferred`.
    pub(super) fn towards(self, preferred: i32) -> Self {
        let Self::Finite { negative, mut coefficient, mut exponent } = self else { return self };
        while exponent < preferred && coefficient % 10 == 0 && coefficient != 0 {
            coefficient /= 10;
            exponent += 1;
        }
        Self::Finite { negative, coefficient, exponent }
    }
}

fn scale(value: U256, digits: u32) -> U256 {
    value.wrapping_mul(ten_to(digits.min(76)))
}

/// `(sign, coefficient, exponent)`.
type Parts = (bool, u128, i32);

/// Returns the sum where `a` has the larger exponent.
fn sum(a: Parts, b: Parts) -> Decimal {
    let (n1, c1, e1) = a;
    let (n2, c2, e2) = b;
    if c1 == 0 && c2 == 0 {
        return Decimal::Finite { negative: n1 && n2, coefficient: 0, exponent: e2 };
    }
    if c1 == 0 {
        return Decimal::Finite { negative: n2, coefficient: c2, exponent: e2 };
    }
    let gap = (e1 - e2).unsigned_abs();
    let free_digits = 75 - c1.ilog10() - 1;
    let shift = gap.min(free_digits);
    let scaled1 = scale(c1.into(), shift);
    let (scaled2, lost) = if gap == shift {
        (U256::from(c2), false)
    } else if gap - shift > 40 {
        (U256::ZERO, c2 != 0)
    } else {
        let divisor = ten_to(gap - shift);
        (U256::from(c2) / divisor, U256::from(c2) % divisor != 0)
    };
    let exponent = e1 - i32::try_from(shift).unwrap_or(0);
    if n1 == n2 {
        return Decimal::rounded(n1, scaled1 + scaled2, exponent, lost);
    }
    match scaled1.cmp(&scaled2) {
        Ordering::Equal => Decimal::Finite { negative: false, coefficient: 0, exponent },
        Ordering::Greater if lost => Decimal::rounded(n1, scaled1 - scaled2 - 1, exponent, true),
        Ordering::Greater => Decimal::rounded(n1, scaled1 - scaled2, exponent, false),
        Ordering::Less => Decimal::rounded(n2, scaled2 - scaled1, exponent, lost),
    }
}

fn quotient(negative: bool, (c1, e1): (u128, i32), (c2, e2): (u128, i32)) -> Decimal {
    let preferred = e1 - e2;
    if c1 == 0 {
        return Decimal::Finite { negative, coefficient: 0, exponent: preferred.clamp(MIN_EXPONENT, MAX_EXPONENT) };
    }
    let digits1 = c1.ilog10() + 1;
    let digits2 = c2.ilog10() + 1;
    let shift = (PRECISION + 2 + digits2).saturating_sub(digits1).min(76 - digits1);
    let scaled = scale(c1.into(), shift);
    let exact = scaled % U256::from(c2) == 0;
    let value =
        Decimal::rounded(negative, scaled / U256::from(c2), preferred - i32::try_from(shift).unwrap_or(0), !exact);
    if exact { value.towards(preferred.min(MAX_EXPONENT)) } else { value }
}
