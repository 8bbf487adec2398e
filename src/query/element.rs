//! Elements of a raw document, found by name without decoding the others.
//!
//! An element is a type byte, a name that ends in NUL, and a value whose length depends on the type
//! (<https://bsonspec.org/spec.html>). Damaged bytes end the iteration without an error.

use bson::{RawBsonRef, RawDocument};

/// The type of a document.
pub(super) const DOCUMENT: u8 = 0x03;
/// The type of an array.
pub(super) const ARRAY: u8 = 0x04;

/// Returns the value of a field of the document itself, without looking at the others; none where its bytes are damaged.
#[must_use]
pub fn field<'a>(document: &'a RawDocument, name: &str) -> Option<RawBsonRef<'a>> {
    let Element { type_code, value, .. } = Elements::new(document).find(name.as_bytes())?;
    decode(document, name, type_code, value)
}

/// Returns the value of a field of the document itself, whose type and bytes are known.
pub(super) fn decode<'a>(
    document: &'a RawDocument,
    name: &str,
    type_code: u8,
    value: &'a [u8],
) -> Option<RawBsonRef<'a>> {
    Some(match type_code {
        0x01 => RawBsonRef::Double(f64::from_le_bytes(value.try_into().ok()?)),
        0x02 => RawBsonRef::String(string(value)?),
        0x08 => RawBsonRef::Boolean(match value {
            [0] => false,
            [1] => true,
            _ => return None,
        }),
        0x10 => RawBsonRef::Int32(i32::from_le_bytes(value.try_into().ok()?)),
        0x12 => RawBsonRef::Int64(i64::from_le_bytes(value.try_into().ok()?)),
        _ => return document.get(name).ok().flatten(),
    })
}

/// Returns where in the bytes of the document a field of its own begins and ends.
#[must_use]
pub fn extent(document: &RawDocument, name: &str) -> Option<(usize, usize)> {
    let length = document.as_bytes().len();
    let mut elements = Elements::new(document);
    loop {
        let start = length - elements.left();
        let element = elements.next()?;
        if element.name == name.as_bytes() {
            return Some((start, length - elements.left()));
        }
    }
}

/// An iterator over elements; `rest` are the bytes not yet read.
#[derive(Debug, Clone)]
pub(super) struct Elements<'a> {
    rest: &'a [u8],
}

/// One element, its value not yet decoded.
#[derive(Debug, Clone, Copy)]
pub(super) struct Element<'a> {
    pub(super) type_code: u8,
    name: &'a [u8],
    pub(super) value: &'a [u8],
}

impl<'a> Elements<'a> {
    pub(super) fn new(document: &'a RawDocument) -> Self {
        Self { rest: document.as_bytes().get(4..).unwrap_or_default() }
    }

    /// The elements in bytes that are nothing else.
    pub(super) fn of(rest: &'a [u8]) -> Self {
        Self { rest }
    }

    /// How many bytes are left.
    pub(super) fn left(&self) -> usize {
        self.rest.len()
    }

    /// Whether no bytes are left.
    pub(super) fn is_at_end(&self) -> bool {
        self.rest.is_empty()
    }

    /// Returns the first element of that name.
    pub(super) fn find(mut self, name: &[u8]) -> Option<Element<'a>> {
        Iterator::find(&mut self, |element| element.name == name)
    }

    /// Returns the first elements of two names.
    pub(super) fn find_both(self, [first, second]: [&[u8]; 2]) -> [Option<Element<'a>>; 2] {
        let (mut one, mut other) = (None, None);
        for element in self {
            if one.is_none() && element.name == first {
                one = Some(element);
            }
            if other.is_none() && element.name == second {
                other = Some(element);
            }
            if one.is_some() && other.is_some() {
                break;
            }
        }
        [one, other]
    }
}

impl<'a> Iterator for Elements<'a> {
    type Item = Element<'a>;

    fn next(&mut self) -> Option<Element<'a>> {
        let (type_code, rest) = self.rest.split_first()?;
        let (name, rest) = text_and_rest(rest)?;
        let (value, rest) = rest.split_at_checked(length(*type_code, rest)?)?;
        self.rest = rest;
        Some(Element { type_code: *type_code, name, value })
    }
}

impl<'a> Element<'a> {
    pub(super) fn name_bytes(self) -> &'a [u8] {
        self.name
    }

    /// Returns the name if it is valid UTF-8.
    pub(super) fn name(self) -> Option<&'a str> {
        std::str::from_utf8(self.name).ok()
    }

    /// Whether it has the type and the bytes of another one: then the values are equal, in every collation.
    pub(super) fn has_same_bytes(&self, other: &Self) -> bool {
        self.type_code == other.type_code && self.value == other.value
    }
}

/// Returns the number of bytes of a value that the given bytes begin with.
#[inline]
pub(super) fn length(type_code: u8, bytes: &[u8]) -> Option<usize> {
    Some(match type_code {
        0x06 | 0x0A | 0x7F | 0xFF => 0,
        0x08 => 1,
        0x10 => 4,
        0x01 | 0x09 | 0x11 | 0x12 => 8,
        0x07 => 12,
        0x13 => 16,
        0x02 | 0x0D | 0x0E => sized(bytes, 4)?,
        0x05 => sized(bytes, 5)?,
        0x0C => sized(bytes, 16)?,
        0x03 | 0x04 | 0x0F => sized(bytes, 0)?,
        0x0B => {
            let (_, rest) = text_and_rest(bytes)?;
            let (_, rest) = text_and_rest(rest)?;
            bytes.len() - rest.len()
        }
        _ => return None,
    })
}

/// Returns the length that the bytes begin with, plus `more`.
#[inline]
pub(super) fn sized(bytes: &[u8], more: usize) -> Option<usize> {
    let length = i32::from_le_bytes(*bytes.first_chunk()?);
    usize::try_from(length).ok()?.checked_add(more)
}

/// Splits at the next NUL, which neither part contains.
#[inline]
pub(super) fn text_and_rest(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (text, rest) = bytes.split_at_checked(end_of_text(bytes)?)?;
    Some((text, rest.get(1..)?))
}

/// Returns where the next NUL is: names are short, so that eight bytes at a time find most ends at once.
#[inline]
fn end_of_text(bytes: &[u8]) -> Option<usize> {
    const ONES: u64 = 0x0101_0101_0101_0101;
    let (mut rest, mut end) = (bytes, 0);
    while let Some((word, behind)) = rest.split_first_chunk() {
        let word = u64::from_le_bytes(*word);
        // The lowest bit that is set is in the first byte that is zero.
        let zeros = word.wrapping_sub(ONES) & !word & (ONES << 7);
        if zeros != 0 {
            return Some(end + (zeros.trailing_zeros() / 8) as usize);
        }
        (rest, end) = (behind, end + 8);
    }
    Some(end + rest.iter().position(|byte| *byte == 0)?)
}

/// Returns the text between its length and its NUL.
pub(super) fn string(value: &[u8]) -> Option<&str> {
    let (0, text) = value.get(4..)?.split_last()? else { return None };
    std::str::from_utf8(text).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_ends_at_its_first_nul_however_long_it_is() {
        for before in 0..40 {
            for behind in [&b""[..], b"\0", b"\x01\x80\xff", b"\x01\0\x01\0\0longer than a word\0"] {
                for filling in [0x01, 0x80, 0xff, b'a'] {
                    let bytes = [&vec![filling; before][..], b"\0", behind].concat();
                    assert_eq!(text_and_rest(&bytes), Some((&bytes[..before], behind)));
                    assert_eq!(text_and_rest(&bytes[..before]), None);
                }
            }
        }
    }
}
