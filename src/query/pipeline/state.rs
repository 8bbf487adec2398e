//! The state of an accumulator, in memory and in temporary files.

use bson::spec::BinarySubtype;
use bson::{Binary, Bson, Document};

use super::collected::{Collected, Distinct};
use crate::query::error::Result;
use crate::query::limit::{ALLOCATION, Memory, memory};
use crate::query::statistics::{Deviation, Sum};

/// The state of an accumulator.
#[derive(Debug, Clone)]
pub(super) enum State {
    Sum(Sum),
    Average(Sum, u64),
    Deviation(Deviation),
    One(Option<Bson>),
    Many(Collected),
    Distinct(Distinct),
    Merged(Document, Memory),
    Counted(usize, Vec<Bson>, Memory),
    Ranked(usize, Vec<(Vec<u8>, Bson)>, Memory),
}

impl State {
    /// Returns the bytes of memory that it needs beside itself.
    pub(super) fn bytes(&self) -> usize {
        let spare = |values: &Vec<Bson>| (values.capacity() - values.len()) * size_of::<Bson>();
        let bytes = match self {
            Self::Sum(_) | Self::Average(..) | Self::Deviation(_) | Self::One(None) => 0,
            Self::One(Some(value)) => memory(value).unwrap_or_default(),
            Self::Many(values) => values.bytes(),
            Self::Distinct(values) => values.bytes(),
            Self::Counted(_, values, held) => held.bytes() + spare(values),
            Self::Merged(_, held) => held.bytes(),
            Self::Ranked(_, ranked, held) => {
                held.bytes() + ranked.iter().map(|(key, _)| key.len() + 2 * ALLOCATION).sum::<usize>()
            }
        };
        // Tables of documents have room to spare, and allocations are rounded up.
        bytes + bytes / 2
    }

    /// Returns what [`State::load`] makes the same state of.
    ///
    /// # Errors
    /// If a value is malformed.
    pub(super) fn save(self) -> Result<Vec<Bson>> {
        let number = |count: u64| Bson::Int64(count.cast_signed());
        Ok(match self {
            Self::Sum(sum) => vec![bytes(&sum.save())],
            Self::Average(sum, count) => vec![bytes(&sum.save()), number(count)],
            Self::Deviation(deviation) => vec![deviation.save().to_vec().into()],
            Self::One(value) => value.into_iter().collect(),
            Self::Many(values) => values.values()?,
            Self::Distinct(values) => values.into_collected().values()?,
            Self::Merged(document, _) => vec![document.into()],
            Self::Counted(_, values, _) => values,
            Self::Ranked(_, ranked, _) => ranked.into_iter().flat_map(|(key, value)| [bytes(&key), value]).collect(),
        })
    }

    /// Returns the state that was saved; `start` is what it was before the first document.
    ///
    /// # Errors
    /// If it needs too much memory.
    pub(super) fn load(start: Self, saved: Vec<Bson>) -> Result<Self> {
        let mut saved = saved.into_iter();
        Ok(match start {
            Self::Sum(_) => Self::Sum(sum(saved.next())),
            Self::Average(..) => {
                let sum = sum(saved.next());
                Self::Average(sum, saved.next().as_ref().and_then(Bson::as_i64).unwrap_or_default().cast_unsigned())
            }
            Self::Deviation(_) => {
                let parts = saved.next();
                let parts = parts.as_ref().and_then(Bson::as_array).into_iter().flatten().filter_map(Bson::as_f64);
                Self::Deviation(Deviation::load(parts))
            }
            Self::One(_) => Self::One(saved.next()),
            Self::Many(mut values) => {
                saved.try_for_each(|value| values.add(value))?;
                Self::Many(values)
            }
            Self::Distinct(mut values) => {
                saved.try_for_each(|value| values.add(value))?;
                Self::Distinct(values)
            }
            Self::Merged(mut document, mut held) => {
                if let Some(Bson::Document(fields)) = saved.next() {
                    held.add_new(&document, &fields)?;
                    document = fields;
                }
                Self::Merged(document, held)
            }
            Self::Counted(limit, mut values, mut held) => {
                values.extend(saved);
                held.add_all(&values)?;
                Self::Counted(limit, values, held)
            }
            Self::Ranked(limit, mut ranked, mut held) => {
                while let (Some(Bson::Binary(key)), Some(value)) = (saved.next(), saved.next()) {
                    held.add(&value)?;
                    ranked.push((key.bytes, value));
                }
                Self::Ranked(limit, ranked, held)
            }
        })
    }
}

fn bytes(bytes: &[u8]) -> Bson {
    Bson::Binary(Binary { subtype: BinarySubtype::Generic, bytes: bytes.to_vec() })
}

fn sum(saved: Option<Bson>) -> Sum {
    match saved {
        Some(Bson::Binary(saved)) => Sum::load(&saved.bytes),
        _ => Sum::default(),
    }
}
