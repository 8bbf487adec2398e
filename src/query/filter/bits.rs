//! `$bitsAllSet`, `$bitsAllClear`, `$bitsAnySet`, `$bitsAnyClear`.

use crate::query::decimal::Rounding;
use crate::query::error::{QueryError, Result};
use crate::query::number::Number;
use crate::query::view::View;

/// The deprecated subtype of binary data.
const OLD: u8 = 2;

/// Positions of bits and what is wanted of them.
#[derive(Debug)]
pub(in crate::query) struct Bits {
    positions: Vec<u32>,
    /// All of them, or any.
    all: bool,
    /// Set, or clear.
    set: bool,
}

impl Bits {
    /// Reads a mask: a number, binary data, or positions.
    ///
    /// # Errors
    /// If the mask is negative, fractional, or of another type.
    pub(super) fn parse(mask: View<'_>, all: bool, set: bool) -> Result<Self> {
        let positions = match mask {
            View::Number(number) => positions_of_mask(number)?,
            View::Binary(_, bytes) => positions_of_bytes(bytes),
            View::Array(items) => items.iter().map(position).collect::<Result<_>>()?,
            _ => return Err(QueryError::bad_value("a bit mask must be a number, binary data, or an array")),
        };
        Ok(Self { positions, all, set })
    }

    pub(super) fn matches(&self, value: View<'_>) -> bool {
        match value {
            View::Number(number) => {
                let number = match (number.integral(), number) {
                    (Some(number), _) => number,
                    // Of a decimal, what is before the point counts.
                    (None, Number::Decimal(decimal)) => {
                        let whole = decimal.round_to(0, Rounding::Truncate).to_i128();
                        let Some(whole) = whole.and_then(|whole| i64::try_from(whole).ok()) else { return false };
                        whole
                    }
                    (None, _) => return false,
                };
                self.test(|position| number >> position.min(63) & 1 == 1)
            }
            View::Binary(subtype, bytes) => {
                // The old subtype has its length within its bytes.
                let length = u32::try_from(bytes.len()).unwrap_or(0).to_le_bytes();
                let prefix: &[u8] = if subtype == OLD { &length } else { &[] };
                self.test(|position| {
                    let index = position as usize / 8;
                    let byte = prefix.iter().chain(bytes).nth(index).copied().unwrap_or(0);
                    byte >> (position % 8) & 1 == 1
                })
            }
            _ => false,
        }
    }

    fn test(&self, is_set: impl Fn(u32) -> bool) -> bool {
        let mut positions = self.positions.iter();
        if self.all {
            positions.all(|position| is_set(*position) == self.set)
        } else {
            positions.any(|position| is_set(*position) == self.set)
        }
    }
}

fn positions_of_mask(number: Number) -> Result<Vec<u32>> {
    let mask = number
        .integral()
        .filter(|mask| *mask >= 0)
        .ok_or_else(|| QueryError::failed_to_parse("a bit mask must be an integer that is not negative"))?;
    Ok((0..63).filter(|position| mask >> position & 1 == 1).collect())
}

fn positions_of_bytes(bytes: &[u8]) -> Vec<u32> {
    let bits = bytes.iter().enumerate().flat_map(|(index, byte)| {
        let base = u32::try_from(index * 8).unwrap_or(u32::MAX);
        (0..8).filter(move |bit| byte >> bit & 1 == 1).map(move |bit| base.saturating_add(bit))
    });
    bits.collect()
}

fn position(value: View<'_>) -> Result<u32> {
    let wrong = || QueryError::bad_value("bit positions must be integers that are not negative");
    let View::Number(number) = value else { return Err(wrong()) };
    number.integral_32().and_then(|position| u32::try_from(position).ok()).ok_or_else(wrong)
}
