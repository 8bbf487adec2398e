//! Reading little-endian numbers, strings and documents off the front of a slice.

use bson::RawDocument;

use super::WireError;

/// The bytes that have not been read.
pub(super) struct Bytes<'a>(pub(super) &'a [u8]);

impl<'a> Bytes<'a> {
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(super) fn take(&mut self, count: usize) -> Result<&'a [u8], WireError> {
        let taken = self.0.split_at_checked(count);
        let (taken, rest) = taken.ok_or_else(|| WireError::malformed("it ends early"))?;
        self.0 = rest;
        Ok(taken)
    }

    pub(super) fn byte(&mut self) -> Result<u8, WireError> {
        Ok(self.take(1)?.first().copied().unwrap_or_default())
    }

    pub(super) fn int32(&mut self) -> Result<i32, WireError> {
        let bytes = self.take(4)?.try_into().map_err(|_| WireError::malformed("it ends early"))?;
        Ok(i32::from_le_bytes(bytes))
    }

    /// A length that counts itself.
    pub(super) fn length(&mut self) -> Result<usize, WireError> {
        usize::try_from(self.int32()?).map_err(|_| WireError::malformed("a length is negative"))
    }

    /// Text that ends with a zero byte.
    pub(super) fn text(&mut self) -> Result<&'a str, WireError> {
        let end = memchr::memchr(0, self.0).ok_or_else(|| WireError::malformed("a text has no end"))?;
        let text = self.take(end)?;
        self.take(1)?;
        std::str::from_utf8(text).map_err(|_| WireError::malformed("a text is not UTF-8"))
    }

    pub(super) fn document(&mut self) -> Result<&'a RawDocument, WireError> {
        let length = Bytes(self.0).length()?;
        let bytes = self.take(length)?;
        RawDocument::from_bytes(bytes).map_err(|error| WireError::malformed(error.to_string()))
    }
}
