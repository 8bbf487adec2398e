//! 256-bit unsigned integers: what products and quotients of decimals need.

use std::cmp::Ordering;

/// `high * 2^128 + low`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Wide {
    high: u128,
    low: u128,
}

impl PartialOrd for Wide {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Wide {
    fn cmp(&self, other: &Self) -> Ordering {
        (self.high, self.low).cmp(&(other.high, other.low))
    }
}

impl From<u128> for Wide {
    fn from(low: u128) -> Self {
        Self { high: 0, low }
    }
}

impl Wide {
    pub(super) fn is_zero(self) -> bool {
        self.high == 0 && self.low == 0
    }

    /// The value, where it fits.
    pub(super) fn narrow(self) -> Option<u128> {
        (self.high == 0).then_some(self.low)
    }

    pub(super) fn product(a: u128, b: u128) -> Self {
        const MASK: u128 = u64::MAX as u128;
        let (a1, a0, b1, b0) = (a >> 64, a & MASK, b >> 64, b & MASK);
        let (low, mid1, mid2, high) = (a0 * b0, a1 * b0, a0 * b1, a1 * b1);
        let (mid, carried) = mid1.overflowing_add(mid2);
        let (low, carry) = low.overflowing_add(mid << 64);
        let high = high.wrapping_add(mid >> 64).wrapping_add(u128::from(carried) << 64).wrapping_add(u128::from(carry));
        Self { high, low }
    }

    /// `self * factor`, wrapping.
    pub(super) fn times(self, factor: u128) -> Self {
        let low = Self::product(self.low, factor);
        Self { high: low.high.wrapping_add(self.high.wrapping_mul(factor)), low: low.low }
    }

    pub(super) fn plus(self, other: Self) -> Self {
        let (low, carry) = self.low.overflowing_add(other.low);
        Self { high: self.high.wrapping_add(other.high).wrapping_add(u128::from(carry)), low }
    }

    /// `self - other`, wrapping.
    pub(super) fn minus(self, other: Self) -> Self {
        let (low, borrow) = self.low.overflowing_sub(other.low);
        Self { high: self.high.wrapping_sub(other.high).wrapping_sub(u128::from(borrow)), low }
    }

    fn bit(self, index: u32) -> bool {
        if index < 128 { self.low >> index & 1 == 1 } else { self.high >> (index - 128) & 1 == 1 }
    }

    fn with_bit(mut self, index: u32) -> Self {
        if index < 128 {
            self.low |= 1 << index
        } else {
            self.high |= 1 << (index - 128)
        }
        self
    }

    fn doubled(self, carry: bool) -> Self {
        Self { high: self.high << 1 | self.low >> 127, low: self.low << 1 | u128::from(carry) }
    }

    /// How many bits the value needs.
    fn bits(self) -> u32 {
        if self.high == 0 { 128 - self.low.leading_zeros() } else { 256 - self.high.leading_zeros() }
    }

    /// Quotient and remainder; `(0, self)` for a divisor of zero.
    pub(super) fn divided(self, divisor: Self) -> (Self, Self) {
        if divisor.is_zero() || self < divisor {
            return (Self::default(), self);
        }
        if let (Some(a), Some(b)) = (self.narrow(), divisor.narrow()) {
            return ((a / b).into(), (a % b).into());
        }
        let (mut quotient, mut rest) = (Self::default(), Self::default());
        for index in (0..self.bits()).rev() {
            rest = rest.doubled(self.bit(index));
            if rest >= divisor {
                rest = rest.minus(divisor);
                quotient = quotient.with_bit(index);
            }
        }
        (quotient, rest)
    }

    /// `10^exponent`, up to 77.
    pub(super) fn ten_to(exponent: u32) -> Self {
        let first = exponent.min(38);
        let rest = exponent.saturating_sub(38).min(39);
        let power = Self::from(10u128.pow(first));
        if rest == 39 { power.times(10u128.pow(38)).times(10) } else { power.times(10u128.pow(rest)) }
    }

    /// How many decimal digits the value has; 0 has none.
    pub(super) fn digits(self) -> u32 {
        if let Some(low) = self.narrow() {
            return if low == 0 { 0 } else { low.ilog10() + 1 };
        }
        let mut digits = 39;
        while digits < 77 && self >= Self::ten_to(digits) {
            digits += 1;
        }
        if self >= Self::ten_to(digits) && digits == 77 { 78 } else { digits }
    }

    /// The largest integer whose square is not more.
    pub(super) fn root(self) -> u128 {
        let mut root: u128 = 0;
        for index in (0..self.bits().div_ceil(2)).rev() {
            let candidate = root | 1 << index;
            if Self::product(candidate, candidate) <= self {
                root = candidate;
            }
        }
        root
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn divides_what_it_multiplied() {
        let a = 9_999_999_999_999_999_999_999_999_999_999_999u128;
        let b = 1_234_567_890_123_456_789_012_345_678u128;
        let (quotient, rest) = Wide::product(a, b).plus(17.into()).divided(b.into());
        assert_eq!((quotient.narrow(), rest.narrow()), (Some(a), Some(17)));
        assert_eq!(Wide::product(a, a).root(), a);
    }

    #[test]
    fn counts_digits() {
        for exponent in 0..=77 {
            assert_eq!(Wide::ten_to(exponent).digits(), exponent + 1, "10^{exponent}");
        }
    }
}
