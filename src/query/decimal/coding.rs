//! Decimals as text and as the 128 bits of BSON.

use bson::Decimal128;
use ethnum::U256;

use super::{Decimal, MAX_COEFFICIENT, MIN_EXPONENT};
use crate::query::u256::digits;

impl Decimal {
    /// Reads `-12.5E+3`, `Infinity`, `NaN`; `None` if the text is none of these.
    pub(in crate::query) fn parse(text: &str) -> Option<Self> {
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
