//! The limits of values that expressions, accumulators, stages and updates make.
//!
//! A short expression can describe a value of any size: `$reduce` over a `$range` nests a document thousands of levels
//! deep, or doubles a string thirty times. mongod refuses results beyond 200 levels (code 15) and 16 MiB (code 10334),
//! strings beyond 16 MiB (16493), and stages that need more than 100 MB (146). Values that only exist while an
//! expression is evaluated have wider limits, here as in mongod.

use std::cell::Cell;

use bson::{Bson, Document, RawDocument, RawDocumentBuf};

use super::error::{QueryError, Result};
use super::nesting::MAX_DEPTH;
use super::view::{Fields, Items, View};

/// The largest result in bytes: 16 MiB, and 16 KiB for what mongod adds to stored documents.
const MAX_RESULT: usize = (16 << 20) + (16 << 10);
/// The largest document between two stages in bytes, as in mongod.
pub(super) const MAX_BETWEEN: usize = 64 << 20;
/// The longest string in bytes that an operator makes, as in mongod.
const MAX_STRING: usize = 16 << 20;
/// The deepest value while an expression is evaluated. mongod has no limit and fails at some ten thousand levels.
const MAX_LEVELS: usize = 2 * MAX_DEPTH;
/// The memory in bytes of all values that one evaluation or one accumulator holds. mongod's limits are near 100 MB, but
/// its values are smaller.
const MAX_MEMORY: usize = 256 << 20;

/// Where an evaluation holds so many bytes, what it copies is measured before it is copied.
const MUCH: usize = 16 << 20;

/// Bytes of memory that a small value on the heap needs.
pub(super) const ALLOCATION: usize = 32;
/// Bytes of memory that a field of a document needs beside its name and value.
const FIELD: usize = 64;

thread_local! {
    static HELD: Cell<usize> = const { Cell::new(0) };
}

/// The memory of values that an evaluation holds while it makes more of them. All that a thread evaluates at a time
/// shares one limit.
#[derive(Debug, Default)]
pub(super) struct Held {
    bytes: usize,
}

impl Held {
    /// Adds a value.
    ///
    /// # Errors
    /// If it is nested too deeply, or too much memory is held.
    pub(super) fn add(&mut self, value: &Bson) -> Result<()> {
        self.add_below(value, 0)
    }

    /// Adds a value so many levels below a document.
    ///
    /// # Errors
    /// As [`Held::add`].
    pub(super) fn add_below(&mut self, value: &Bson, level: usize) -> Result<()> {
        let bytes = below(value, level)?;
        self.bytes += bytes;
        HELD.set(HELD.get() + bytes);
        check_memory(HELD.get())
    }

    /// Adds several values.
    ///
    /// # Errors
    /// As [`Held::add`].
    pub(super) fn add_all(&mut self, values: &[Bson]) -> Result<()> {
        values.iter().try_for_each(|value| self.add(value))
    }

    /// Holds a value in place of all that was held.
    ///
    /// # Errors
    /// As [`Held::add`].
    pub(super) fn replace(&mut self, value: Option<&Bson>) -> Result<()> {
        self.release();
        value.map_or(Ok(()), |value| self.add(value))
    }

    fn release(&mut self) {
        HELD.set(HELD.get().saturating_sub(self.bytes));
        self.bytes = 0;
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        self.release();
    }
}

/// Whether so much is held that a copy is to be measured before it is made.
pub(super) fn holds_much() -> bool {
    HELD.get() >= MUCH
}

/// Refuses to copy a value that is too large beside what is held already.
///
/// # Errors
/// As [`Held::add`].
pub(super) fn check_copy(value: View<'_>) -> Result<()> {
    let bytes = match value {
        View::Document(Fields::Owned(document)) => fields(document, 0)?,
        View::Array(Items::Owned(items)) => elements(items, 0)?,
        // Values in raw bytes are those of a document that was not decoded, which is not larger than a stored one.
        _ => return Ok(()),
    };
    check_memory(HELD.get() + bytes)
}

/// The memory of the values that one accumulator holds.
#[derive(Debug, Clone, Default)]
pub(super) struct Memory {
    bytes: usize,
}

impl Memory {
    /// Adds a value.
    ///
    /// # Errors
    /// If it is nested too deeply, or too much memory is held.
    pub(super) fn add(&mut self, value: &Bson) -> Result<()> {
        self.bytes += memory(value)?;
        check_memory(self.bytes)
    }

    /// Adds several values.
    ///
    /// # Errors
    /// As [`Memory::add`].
    pub(super) fn add_all(&mut self, values: &[Bson]) -> Result<()> {
        values.iter().try_for_each(|value| self.add(value))
    }

    /// Returns the bytes of all values.
    pub(super) fn bytes(&self) -> usize {
        self.bytes
    }

    /// Adds the fields that a document gets from another one.
    ///
    /// # Errors
    /// As [`Memory::add`].
    pub(super) fn add_new(&mut self, document: &Document, more: &Document) -> Result<()> {
        for (name, value) in more {
            document.get(name).into_iter().for_each(|old| self.remove(old));
            self.bytes += name.len() + FIELD;
            self.add(value)?;
        }
        Ok(())
    }

    /// Subtracts a value that was added.
    pub(super) fn remove(&mut self, value: &Bson) {
        self.bytes = self.bytes.saturating_sub(memory(value).unwrap_or(0));
    }
}

/// Returns the memory that a value needs, in bytes.
///
/// # Errors
/// If it is nested too deeply.
pub(super) fn memory(value: &Bson) -> Result<usize> {
    below(value, 0)
}

fn below(value: &Bson, level: usize) -> Result<usize> {
    let heap = match value {
        Bson::Document(document) => fields(document, level)?,
        Bson::Array(items) => elements(items, level)?,
        Bson::String(text) | Bson::Symbol(text) | Bson::JavaScriptCode(text) => text.len(),
        Bson::Binary(binary) => binary.bytes.len(),
        _ => 0,
    };
    Ok(size_of::<Bson>() + heap)
}

fn fields(document: &Document, level: usize) -> Result<usize> {
    check_level(level)?;
    // A loop takes less of the stack than an iterator that sums.
    let mut bytes = 0;
    for (name, value) in document {
        bytes += name.len() + FIELD + below(value, level + 1)?;
    }
    Ok(bytes)
}

fn elements(items: &[Bson], level: usize) -> Result<usize> {
    check_level(level)?;
    let mut bytes = 0;
    for item in items {
        bytes += below(item, level + 1)?;
    }
    Ok(bytes)
}

fn check_level(level: usize) -> Result<()> {
    if level >= MAX_LEVELS {
        return Err(QueryError::invalid(15, format!("a value is nested deeper than {MAX_LEVELS} levels")));
    }
    Ok(())
}

/// Refuses values that are nested too deeply, so many levels below a document.
///
/// # Errors
/// If there are more than 400 levels.
pub(super) fn check_levels(value: &Bson, level: usize) -> Result<()> {
    below(value, level).map(drop)
}

/// Refuses values that need too much memory.
///
/// # Errors
/// If the bytes are more than an evaluation may hold.
pub(super) fn check_memory(bytes: usize) -> Result<()> {
    if bytes > MAX_MEMORY {
        let message = format!("a value needs more than {} MB of memory", MAX_MEMORY >> 20);
        return Err(QueryError::invalid(146, message));
    }
    Ok(())
}

/// Refuses arrays of too many elements before they are made; each has `heap` bytes beside the value itself.
///
/// # Errors
/// If they need more memory than an evaluation may hold. What it holds already may be the same elements, which are let
/// go afterwards, and is not added.
pub(super) fn check_elements(count: usize, heap: usize) -> Result<()> {
    check_memory(count.saturating_mul(size_of::<Bson>() + heap))
}

/// Refuses strings that are too long before they are made.
///
/// # Errors
/// If they have more than 16 MiB.
pub(super) fn check_string(bytes: usize) -> Result<()> {
    if bytes > MAX_STRING {
        return Err(QueryError::invalid(16_493, "a string would be longer than 16 MB"));
    }
    Ok(())
}

/// Encodes a document that another stage reads.
///
/// # Errors
/// If it is nested deeper than 400 levels, or larger than 64 MB.
pub(super) fn encode_between(document: &Document) -> Result<RawDocumentBuf> {
    check_document(document)?;
    let raw = RawDocumentBuf::try_from(document)?;
    check_between(&raw)?;
    Ok(raw)
}

/// Refuses documents that are too large for another stage.
///
/// # Errors
/// If there are more than 64 MB.
pub(super) fn check_between(document: &RawDocument) -> Result<()> {
    match document.as_bytes().len() > MAX_BETWEEN {
        true => Err(QueryError::invalid(13_548, "a document between stages is larger than 64 MB")),
        false => Ok(()),
    }
}

/// Encodes a document that is a result.
///
/// # Errors
/// If it is nested deeper than 200 levels, or larger than 16 MB.
pub(super) fn encode_result(document: &Document) -> Result<RawDocumentBuf> {
    let raw = encode_between(document)?;
    check_result(&raw)?;
    Ok(raw)
}

/// Refuses results that mongod cannot send.
///
/// # Errors
/// If the document is nested deeper than 200 levels, or larger than 16 MB.
pub(super) fn check_result(document: &RawDocument) -> Result<()> {
    let size = document.as_bytes().len();
    if size > MAX_RESULT {
        let message = format!("a result has {size} bytes, more than the {MAX_RESULT} that a document may have");
        return Err(QueryError::invalid(10_334, message));
    }
    // Fewer bytes cannot nest so deeply: each level takes a length, a type, a name and two ends.
    if size < MAX_DEPTH * 7 { Ok(()) } else { super::nesting::check(document) }
}

/// Refuses documents nested too deeply to be encoded.
///
/// # Errors
/// If there are more than 400 levels.
fn check_document(document: &Document) -> Result<()> {
    document.values().try_for_each(|value| below(value, 1).map(drop))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::bson;

    fn nested(levels: usize) -> Bson {
        (0..levels).fold(Bson::Int32(1), |inner, _| Bson::Array(vec![inner]))
    }

    #[test]
    fn a_value_of_400_levels_is_held_and_one_of_401_is_not() {
        assert!(Held::default().add(&nested(MAX_LEVELS)).is_ok());
        assert_eq!(Held::default().add(&nested(MAX_LEVELS + 1)).unwrap_err().code, 15);
    }

    #[test]
    fn what_is_dropped_is_no_longer_held() {
        let text = Bson::String("x".repeat(100 << 20));
        let mut held = Held::default();
        held.add(&text).unwrap();
        held.add(&text).unwrap();
        assert_eq!(Held::default().add(&text).unwrap_err().code, 146);
        held.replace(None).unwrap();
        assert!(Held::default().add(&text).is_ok());
    }

    #[test]
    fn where_much_is_held_what_is_too_large_is_not_copied() {
        let text = || Bson::String("x".repeat(100 << 20));
        let (document, array) = (bson!({ "a": text() }), Bson::Array(vec![text()]));
        assert!(!holds_much() && check_copy(View::from(&document)).is_ok());
        let mut held = Held::default();
        held.add(&text()).unwrap();
        assert!(holds_much() && check_copy(View::from(&document)).is_ok());
        held.add(&text()).unwrap();
        for value in [&document, &array] {
            assert_eq!(check_copy(View::from(value)).unwrap_err().code, 146);
        }
    }

    #[test]
    fn a_result_has_at_most_200_levels_and_16_megabytes() {
        let wrapped = |value: Bson| Document::from_iter([("a".to_owned(), value)]);
        assert!(encode_result(&wrapped(nested(199))).is_ok());
        assert_eq!(encode_result(&wrapped(nested(200))).unwrap_err().code, 15);
        assert!(encode_between(&wrapped(nested(200))).is_ok());
        assert_eq!(encode_result(&wrapped(bson!("x".repeat(17 << 20)))).unwrap_err().code, 10_334);
    }
}
