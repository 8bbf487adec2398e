//! Decimal128 (IEEE 754-2008, binary integer coding): reading, exact order, arithmetic to 34 digits.

mod arithmetic;
mod coding;
mod logarithm;

use std::cmp::Ordering;

use ethnum::U256;

use super::u256::{digits, ten_to};

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
        let rounded = Self::from_bits(value).or_else(|| Self::parse(&format!("{value:.33e}")));
        rounded.map_or(Self::NaN, Self::reduced)
    }

    /// The same, by the bits of the double: a whole number times a power of two, which is a whole number times a power of
    /// ten. Nothing for numbers so small or large that this takes more than 256 bits.
    fn from_bits(value: f64) -> Option<Self> {
        let (bits, negative) = (value.to_bits(), value.is_sign_negative());
        let fraction = bits & ((1 << 52) - 1);
        let exponent = i32::try_from(bits >> 52 & 0x7ff).ok().filter(|exponent| *exponent > 0)?;
        let whole = fraction | 1 << 52;
        let (whole, power) = (U256::from(whole >> whole.trailing_zeros()), exponent - 1075);
        let power = power + i32::try_from(fraction.trailing_zeros().min(52)).ok()?;
        match power {
            0..=200 => Some(Self::rounded(negative, whole << power, 0, false)),
            -77..=-1 => {
                let five_to = ten_to(power.unsigned_abs()) >> power.unsigned_abs();
                Some(Self::rounded(negative, whole * five_to, power, false))
            }
            _ => None,
        }
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
                let quotient = value / ten_to(dropped);
                let rest = value - quotient * ten_to(dropped);
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
#[cfg(test)]
mod tests {
    use bson::Decimal128;

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
    fn a_double_is_rounded_to_the_digits_that_its_text_has() {
        let mut random = 88_172_645_463_325_252_u64;
        let drawn = std::iter::repeat_with(|| {
            random ^= random << 13;
            random ^= random >> 7;
            random ^= random << 17;
            random
        });
        // Of any size, between 0 and 1, around 2^53, with few digits, and with 35 of which the last one is 5.
        let doubles = drawn.take(20_000).flat_map(|bits| {
            let (part, whole) = (bits as f64 / u64::MAX as f64, (bits >> 40) as f64);
            [f64::from_bits(bits), part, part * 1e16, -whole / 1e3, (whole * 2.0 + 1.0) * 2f64.powi(-35)]
        });
        for double in doubles.chain([0.0, -0.0, f64::MIN_POSITIVE, 5e-324, f64::MAX, 1.0, 2f64.powi(200), -0.5]) {
            if double.is_finite() {
                let text = format!("{double:.33e}");
                assert_eq!(shown(Decimal::from_double(double)), shown(decimal(&text).reduced()), "{text}");
            }
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
