//! Decimal128 (IEEE 754-2008, binary integer coding): reading, exact order, arithmetic to 34 digits.

use std::cmp::Ordering;

use bson::Decimal128;
use ethnum::U256;

use super::u256::{digits, square_root, ten_to};

/// Digits of a coefficient.
const PRECISION: u32 = 34;
const MAX_COEFFICIENT: u128 = 9_999_999_999_999_999_999_999_999_999_999_999;
const MIN_EXPONENT: i32 = -6176;
const MAX_EXPONENT: i32 = 6111;

/// A Decimal128, taken apart.
#[derive(Debug, Clone, Copy)]
pub(super) enum Decimal {
    /// Not a number.
    NaN,
    /// Negative or positive infinity.
    Infinite {
        /// Below zero.
        negative: bool,
    },
    /// `± coefficient × 10^exponent`.
    Finite {
        /// Below zero, or the negative zero.
        negative: bool,
        /// At most 34 digits.
        coefficient: u128,
        /// From -6176 to 6111.
        exponent: i32,
    },
}

/// How a number with too many digits is rounded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Rounding {
    /// To the nearest, ties to even.
    HalfEven,
    /// Towards zero.
    Truncate,
    /// Towards positive infinity.
    Ceiling,
    /// Towards negative infinity.
    Floor,
}

impl Decimal {
    pub(super) const ZERO: Self = Self::Finite { negative: false, coefficient: 0, exponent: 0 };
    pub(super) const ONE: Self = Self::Finite { negative: false, coefficient: 1, exponent: 0 };

    pub(super) fn from_integer(value: i128) -> Self {
        Self::rounded(value < 0, value.unsigned_abs().into(), 0, false)
    }

    /// Returns the nearest decimal of 34 digits.
    pub(super) fn from_double(value: f64) -> Self {
        if value.is_nan() {
            return Self::NaN;
        }
        if value.is_infinite() {
            return Self::Infinite { negative: value < 0.0 };
        }
        let text = format!("{value:.33e}");
        Self::parse(&text).map_or(Self::NaN, Self::reduced)
    }

    /// What a double shows with 15 digits, as MongoDB converts a double for arithmetic with decimals.
    pub(super) fn from_double_15(value: f64) -> Self {
        if !value.is_finite() {
            return Self::from_double(value);
        }
        if value == 0.0 {
            return Self::Finite { negative: value.is_sign_negative(), coefficient: 0, exponent: 0 };
        }
        let text = format!("{value:.14e}");
        Self::parse(&text).unwrap_or(Self::NaN)
    }

    pub(super) fn is_nan(self) -> bool {
        matches!(self, Self::NaN)
    }

    pub(super) fn is_zero(self) -> bool {
        matches!(self, Self::Finite { coefficient: 0, .. })
    }

    pub(super) fn is_infinite(self) -> bool {
        matches!(self, Self::Infinite { .. })
    }

    pub(super) fn is_negative(self) -> bool {
        match self {
            Self::NaN => false,
            Self::Infinite { negative } | Self::Finite { negative, .. } => negative,
        }
    }

    /// Without the trailing zeros of the coefficient.
    pub(super) fn reduced(self) -> Self {
        let Self::Finite { negative, mut coefficient, mut exponent } = self else { return self };
        if coefficient == 0 {
            return Self::Finite { negative, coefficient, exponent: 0 };
        }
        while coefficient % 10 == 0 && exponent < MAX_EXPONENT {
            coefficient /= 10;
            exponent += 1;
        }
        Self::Finite { negative, coefficient, exponent }
    }

    /// Sign, and the digits as a 34-digit integer with the exponent of the first digit; nothing for zero.
    pub(super) fn scientific(negative: bool, coefficient: u128, exponent: i32) -> Option<(bool, i32, u128)> {
        if coefficient == 0 {
            return None;
        }
        let digits = coefficient.ilog10() + 1;
        let scaled = if digits <= PRECISION { coefficient * 10u128.pow(PRECISION - digits) } else { coefficient };
        Some((negative, exponent + i32::try_from(digits).unwrap_or(0), scaled))
    }

    /// Rounds a coefficient of up to 256 bits half to even; `sticky`: nonzero digits followed it.
    pub(super) fn rounded(negative: bool, mut value: U256, mut exponent: i32, sticky: bool) -> Self {
        let mut excess = digits(value).saturating_sub(PRECISION);
        if exponent < MIN_EXPONENT {
            let below = u32::try_from(MIN_EXPONENT.saturating_sub(exponent)).unwrap_or(0);
            excess = excess.max(below);
        }
        if excess > 0 {
            let dropped = excess.min(77);
            if excess > 77 {
                value = U256::ZERO;
                exponent = MIN_EXPONENT;
            } else {
                let (quotient, rest) = (value / ten_to(dropped), value % ten_to(dropped));
                let half = ten_to(dropped - 1) * 5;
                value = quotient;
                exponent += i32::try_from(dropped).unwrap_or(0);
                if round_up(quotient, rest, half, sticky, negative, Rounding::HalfEven) {
                    value += 1;
                }
                if digits(value) > PRECISION {
                    value /= 10;
                    exponent += 1;
                }
            }
        }
        let mut coefficient = u128::try_from(value).unwrap_or(MAX_COEFFICIENT);
        if coefficient == 0 {
            return Self::Finite { negative, coefficient, exponent: exponent.clamp(MIN_EXPONENT, MAX_EXPONENT) };
        }
        while exponent > MAX_EXPONENT && coefficient <= MAX_COEFFICIENT / 10 {
            coefficient *= 10;
            exponent -= 1;
        }
        if exponent > MAX_EXPONENT {
            return Self::Infinite { negative };
        }
        Self::Finite { negative, coefficient, exponent }
    }

    /// Reads `-12.5E+3`, `Infinity`, `NaN`; `None` if the text is none of these.
    pub(super) fn parse(text: &str) -> Option<Self> {
        let (negative, rest) = match text.as_bytes().first()? {
            b'-' => (true, text.get(1..)?),
            b'+' => (false, text.get(1..)?),
            _ => (false, text),
        };
        match rest.to_ascii_lowercase().as_str() {
            "inf" | "infinity" => return Some(Self::Infinite { negative }),
            "nan" => return Some(Self::NaN),
            _ => {}
        }
        let (mantissa, power) = match rest.find(['e', 'E']) {
            Some(at) => (rest.get(..at)?, exponent_of(rest.get(at + 1..)?)?),
            None => (rest, 0),
        };
        let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
        if whole.is_empty() && fraction.is_empty() {
            return None;
        }
        let mut coefficient = U256::ZERO;
        let (mut exponent, mut sticky) = (power, false);
        for (index, byte) in whole.bytes().chain(fraction.bytes()).enumerate() {
            if !byte.is_ascii_digit() {
                return None;
            }
            let in_fraction = index >= whole.len();
            if digits(coefficient) < 70 {
                coefficient = coefficient * 10 + U256::from(byte - b'0');
                exponent -= i64::from(in_fraction);
            } else {
                sticky |= byte != b'0';
                exponent += i64::from(!in_fraction);
            }
        }
        let exponent = i32::try_from(exponent.clamp(-20_000, 20_000)).ok()?;
        Some(Self::rounded(negative, coefficient, exponent, sticky))
    }

    pub(super) fn compare(self, other: Self) -> Ordering {
        use Decimal::{Finite, Infinite, NaN};
        let infinity = |negative| if negative { Ordering::Less } else { Ordering::Greater };
        match (self, other) {
            (NaN, NaN) => Ordering::Equal,
            (NaN, _) => Ordering::Less,
            (_, NaN) => Ordering::Greater,
            (Infinite { negative: a }, Infinite { negative: b }) => b.cmp(&a),
            (Infinite { negative }, Finite { .. }) => infinity(negative),
            (Finite { .. }, Infinite { negative }) => infinity(negative).reverse(),
            (
                Finite { negative: n1, coefficient: c1, exponent: e1 },
                Finite { negative: n2, coefficient: c2, exponent: e2 },
            ) => match (Self::scientific(n1, c1, e1), Self::scientific(n2, c2, e2)) {
                (None, None) => Ordering::Equal,
                (None, Some((negative, ..))) => infinity(negative).reverse(),
                (Some((negative, ..)), None) => infinity(negative),
                (Some((false, e1, c1)), Some((false, e2, c2))) => (e1, c1).cmp(&(e2, c2)),
                (Some((true, e1, c1)), Some((true, e2, c2))) => (e2, c2).cmp(&(e1, c1)),
                (Some((true, ..)), Some((false, ..))) => Ordering::Less,
                (Some((false, ..)), Some((true, ..))) => Ordering::Greater,
            },
        }
    }

    pub(super) fn negated(self) -> Self {
        match self {
            Self::NaN => Self::NaN,
            Self::Infinite { negative } => Self::Infinite { negative: !negative },
            Self::Finite { negative, coefficient, exponent } => {
                Self::Finite { negative: !negative, coefficient, exponent }
            }
        }
    }

    pub(super) fn absolute(self) -> Self {
        if self.is_negative() { self.negated() } else { self }
    }

    pub(super) fn plus(self, other: Self) -> Self {
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

    pub(super) fn minus(self, other: Self) -> Self {
        self.plus(other.negated())
    }

    pub(super) fn times(self, other: Self) -> Self {
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
    pub(super) fn over(self, other: Self) -> Self {
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
    pub(super) fn modulo(self, other: Self) -> Self {
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
    pub(super) fn round_to(self, places: i32, mode: Rounding) -> Self {
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
    fn quantized(self, target: i32) -> Self {
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
    pub(super) fn root(self) -> Self {
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
    fn towards(self, preferred: i32) -> Self {
        let Self::Finite { negative, mut coefficient, mut exponent } = self else { return self };
        while exponent < preferred && coefficient % 10 == 0 && coefficient != 0 {
            coefficient /= 10;
            exponent += 1;
        }
        Self::Finite { negative, coefficient, exponent }
    }

    /// With all 34 digits written out; zero has the smallest exponent there is.
    pub(super) fn padded(self) -> Self {
        match self {
            Self::Finite { coefficient, .. } if coefficient != 0 => self.quantized(MIN_EXPONENT),
            Self::Finite { .. } => Self::Finite { negative: false, coefficient: 0, exponent: MIN_EXPONENT },
            other => other,
        }
    }

    /// Returns whether all digits before the point fit the coefficient.
    pub(super) fn has_unit_digit(self) -> bool {
        match self {
            Self::Finite { coefficient: 0, .. } => true,
            Self::Finite { coefficient, exponent, .. } => {
                exponent <= 0 || exponent.unsigned_abs() + coefficient.ilog10() < PRECISION
            }
            _ => false,
        }
    }

    /// Returns the natural logarithm of a positive number, by Newton's method from that of the double.
    pub(super) fn logarithm(self) -> Self {
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
    pub(super) fn logarithm_10(self) -> Self {
        if let Self::Finite { negative: false, coefficient: 1, exponent } = self.reduced() {
            return Self::from_integer(exponent.into());
        }
        self.logarithm().over(Self::from_integer(10).logarithm())
    }

    /// e to this power, by its series after halving the argument.
    pub(super) fn exponential(self) -> Self {
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

    /// Returns the nearest double.
    pub(super) fn to_double(self) -> f64 {
        match self {
            Self::NaN => f64::NAN,
            Self::Infinite { negative } => {
                if negative {
                    f64::NEG_INFINITY
                } else {
                    f64::INFINITY
                }
            }
            Self::Finite { negative, coefficient, exponent } => {
                format!("{}{coefficient}e{exponent}", if negative { "-" } else { "" }).parse().unwrap_or(f64::NAN)
            }
        }
    }

    /// Returns the integer part, where the value is finite and fits.
    pub(super) fn to_i128(self) -> Option<i128> {
        let Self::Finite { negative, coefficient, exponent } = self.round_to(0, Rounding::Truncate) else {
            return None;
        };
        if coefficient == 0 {
            return Some(0);
        }
        let scale = u32::try_from(exponent).ok()?;
        let magnitude = i128::try_from(coefficient).ok()?.checked_mul(10i128.checked_pow(scale)?)?;
        Some(if negative { -magnitude } else { magnitude })
    }

    /// Returns whether it is finite and has no fraction.
    pub(super) fn is_integral(self) -> bool {
        matches!(self, Self::Finite { .. }) && self.compare(self.round_to(0, Rounding::Truncate)) == Ordering::Equal
    }
}

/// Returns whether the dropped `rest` takes the quotient up (away from zero).
fn round_up(quotient: U256, rest: U256, half: U256, sticky: bool, negative: bool, mode: Rounding) -> bool {
    let inexact = sticky || rest != 0;
    match mode {
        Rounding::Truncate => false,
        Rounding::Ceiling => inexact && !negative,
        Rounding::Floor => inexact && negative,
        Rounding::HalfEven => match rest.cmp(&half) {
            Ordering::Greater => true,
            Ordering::Less => false,
            Ordering::Equal => sticky || quotient % 2 != 0,
        },
    }
}

/// `value * 10^digits`, up to 76 digits.
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
    if exact { value.towards(preferred) } else { value }
}

fn exponent_of(text: &str) -> Option<i64> {
    let digits = text.strip_prefix(['+', '-']).unwrap_or(text);
    if digits.is_empty() || !digits.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let magnitude = digits.parse::<i64>().unwrap_or(1_000_000).min(1_000_000);
    Some(if text.starts_with('-') { -magnitude } else { magnitude })
}

impl From<Decimal128> for Decimal {
    fn from(value: Decimal128) -> Self {
        let bits = u128::from_le_bytes(value.bytes());
        let negative = bits >> 127 == 1;
        match bits >> 122 & 0b11111 {
            0b11111 => Self::NaN,
            0b11110 => Self::Infinite { negative },
            top => {
                // The second form of the coding has coefficients above the maximum: they read as zero.
                let (biased, coefficient) = if top >> 3 == 0b11 {
                    (bits >> 111 & 0x3fff, 0)
                } else {
                    (bits >> 113 & 0x3fff, bits & ((1 << 113) - 1))
                };
                let coefficient = if coefficient > MAX_COEFFICIENT { 0 } else { coefficient };
                let exponent = i32::try_from(biased).unwrap_or(0) + MIN_EXPONENT;
                Self::Finite { negative, coefficient, exponent }
            }
        }
    }
}

impl From<Decimal> for Decimal128 {
    fn from(value: Decimal) -> Self {
        let bits = match value {
            Decimal::NaN => 0b11111 << 122,
            Decimal::Infinite { negative } => u128::from(negative) << 127 | 0b11110 << 122,
            Decimal::Finite { negative, coefficient, exponent } => {
                let biased = u128::from((exponent - MIN_EXPONENT).unsigned_abs());
                u128::from(negative) << 127 | biased << 113 | coefficient
            }
        };
        Self::from_bytes(bits.to_le_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decimal(text: &str) -> Decimal {
        Decimal::parse(text).unwrap()
    }

    fn shown(value: Decimal) -> String {
        Decimal128::from(value).to_string()
    }

    #[test]
    fn reads_and_writes_the_128_bits() {
        for text in ["0", "-1.50", "1E+3", "9.999999999999999999999999999999999E+6144", "1E-6176", "Infinity", "NaN"] {
            let theirs: Decimal128 = text.parse().unwrap();
            assert_eq!(shown(Decimal::from(theirs)), theirs.to_string());
            assert_eq!(shown(decimal(text)), theirs.to_string());
        }
    }

    #[test]
    fn calculates_with_34_digits() {
        assert_eq!(shown(decimal("1").over(decimal("3"))), "0.3333333333333333333333333333333333");
        assert_eq!(shown(decimal("10").over(decimal("4"))), "2.5");
        assert_eq!(shown(decimal("1.10").plus(decimal("2.2"))), "3.30");
        assert_eq!(shown(decimal("1E+40").minus(decimal("1"))), "1.000000000000000000000000000000000E+40");
        assert_eq!(shown(decimal("2").root()), "1.414213562373095048801688724209698");
        assert_eq!(shown(decimal("100").root()), "10");
        assert_eq!(shown(decimal("10.5").modulo(decimal("3"))), "1.5");
        assert_eq!(shown(decimal("2.5").round_to(0, Rounding::HalfEven)), "2");
        assert_eq!(shown(decimal("-1.25").round_to(1, Rounding::Truncate)), "-1.2");
    }

    #[test]
    fn orders_exactly() {
        let texts = ["NaN", "-Infinity", "-1E+10", "-1", "-0.1", "0", "1E-6176", "0.1", "1", "1.0001", "1E+10"];
        for pair in texts.windows(2) {
            assert_eq!(decimal(pair[0]).compare(decimal(pair[1])), Ordering::Less, "{pair:?}");
        }
        assert_eq!(decimal("1.00").compare(decimal("1")), Ordering::Equal);
        assert_eq!(decimal("-0").compare(decimal("0E+7")), Ordering::Equal);
    }
}
