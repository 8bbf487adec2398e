//! Values that an accumulator collects, as BSON: a small value needs a tenth of the memory that it needs as a value of
//! its own.

use std::collections::HashSet;

use bson::{Bson, RawArrayBuf, RawBson};

use crate::query::error::{QueryError, Result};
use crate::query::key;
use crate::query::limit::{ALLOCATION, MAX_BETWEEN, Memory, check_levels};

/// The memory in bytes of a set: more than one needs that is a result.
const MAX_SET: usize = 128 << 20;
/// Bytes of memory that a key of a set needs beside its own bytes.
const ENTRY: usize = ALLOCATION + 2 * size_of::<Box<[u8]>>();

/// Values in the order in which they came.
#[derive(Debug, Clone)]
pub(super) struct Collected {
    array: RawArrayBuf,
    /// What the values need where they are read again.
    decoded: Memory,
}

/// The first ones of equal values, in the order in which they came.
#[derive(Debug, Clone, Default)]
pub(super) struct Distinct {
    values: Collected,
    keys: HashSet<Box<[u8]>>,
    /// The bytes of memory of the keys.
    held: usize,
}

impl Default for Collected {
    fn default() -> Self {
        Self { array: RawArrayBuf::new(), decoded: Memory::default() }
    }
}

impl Collected {
    /// Adds a value.
    ///
    /// # Errors
    /// If it is nested too deeply, the values are more than a document can hold, or a stage that reads them would need
    /// too much memory.
    pub(super) fn add(&mut self, value: Bson) -> Result<()> {
        // In an array, in a document.
        check_levels(&value, 2)?;
        self.decoded.add(&value)?;
        self.array.push(RawBson::try_from(value)?);
        if self.bytes() > MAX_BETWEEN {
            let message = format!("an accumulator collects more than {} MB of values", MAX_BETWEEN >> 20);
            return Err(QueryError::invalid(146, message));
        }
        Ok(())
    }

    /// The bytes of memory of the values.
    pub(super) fn bytes(&self) -> usize {
        self.array.as_bytes().len()
    }

    /// The values as an array.
    pub(super) fn into_array(self) -> RawArrayBuf {
        self.array
    }

    /// The values, one by one.
    pub(super) fn values(&self) -> Result<Vec<Bson>> {
        self.array.into_iter().map(|value| Ok(Bson::try_from(value?)?)).collect()
    }
}

impl Distinct {
    /// Adds a value, unless there is an equal one.
    ///
    /// # Errors
    /// If it is nested too deeply, or too much memory is held.
    pub(super) fn add(&mut self, value: Bson) -> Result<()> {
        let key = key::collated(&value).into_boxed_slice();
        if self.keys.contains(&key) {
            return Ok(());
        }
        self.held += key.len() + ENTRY;
        self.keys.insert(key);
        self.values.add(value)?;
        if self.bytes() > MAX_SET {
            let message = format!("a set needs more than {} MB of memory", MAX_SET >> 20);
            return Err(QueryError::invalid(146, message));
        }
        Ok(())
    }

    /// The bytes of memory of the values and their keys.
    pub(super) fn bytes(&self) -> usize {
        self.values.bytes() + self.held
    }

    /// The values without their keys.
    pub(super) fn into_collected(self) -> Collected {
        self.values
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    #[test]
    fn values_come_back_in_their_order_and_in_a_set_the_first_of_equal_ones() {
        let values = [Bson::from(2), 1.0.into(), doc! { "a": [1, Bson::Null] }.into(), Bson::from(1), 2i64.into()];
        let (mut all, mut set) = (Collected::default(), Distinct::default());
        for value in &values {
            all.add(value.clone()).unwrap();
            set.add(value.clone()).unwrap();
        }
        assert_eq!(all.values().unwrap(), values);
        assert_eq!(set.into_collected().values().unwrap(), values[..3]);
    }

    #[test]
    fn what_is_collected_ends_with_its_memory() {
        let text = Bson::String("x".repeat(1 << 20));
        let mut all = Collected::default();
        assert_eq!((0..).find_map(|_| all.add(text.clone()).err()).unwrap().code, 146);
        let document = Bson::from(doc! { "x": 1, "y": 2 });
        let mut small = Collected::default();
        assert_eq!((0..).find_map(|_| small.add(document.clone()).err()).unwrap().code, 146);
        assert!(small.bytes() < MAX_BETWEEN, "small documents need more where they are read than as BSON");
        let mut set = Distinct::default();
        assert_eq!((0..).find_map(|number: i32| set.add(number.into()).err()).unwrap().code, 146);
        assert!(set.keys.len() > 1_300_000, "as many as a result can have");
    }
}
