//! What programs of CLIPS know by an external address: documents, cursors, arrays, triggers, mutexes.
//!
//! An address is a number: a place in the table, and how often that place was taken. So an
//! address whose thing was destroyed is known for what it is, whatever came to its place.

use std::collections::VecDeque;

use bson::{Bson, Document};

/// Something that an address stands for.
#[derive(Debug)]
pub(super) enum Thing {
    Document(Document),
    /// What is left of an answer.
    Cursor(VecDeque<Document>),
    /// An array that is being put together.
    Array(Vec<Bson>),
    /// A trigger, by the number that its watch has.
    Trigger(u64),
}

impl Thing {
    fn name(&self) -> &'static str {
        match self {
            Self::Document(_) => "a document",
            Self::Cursor(_) => "a cursor",
            Self::Array(_) => "an array",
            Self::Trigger(_) => "a trigger",
        }
    }
}

#[derive(Debug, Default)]
struct Slot {
    generation: u32,
    thing: Option<Thing>,
}

/// All things that have an address.
#[derive(Debug, Default)]
pub(super) struct Table {
    places: Vec<Slot>,
    free: Vec<u32>,
}

impl Table {
    /// Takes a thing in; returns its address.
    pub(super) fn add(&mut self, thing: Thing) -> u64 {
        let index = self.free.pop().unwrap_or_else(|| {
            self.places.push(Slot::default());
            u32::try_from(self.places.len() - 1).unwrap_or(u32::MAX)
        });
        let Some(place) = self.places.get_mut(index as usize) else { return 0 };
        place.generation = place.generation.wrapping_add(1);
        place.thing = Some(thing);
        u64::from(place.generation) << 32 | (u64::from(index) + 1)
    }

    fn place(&mut self, address: u64) -> Option<(u32, &mut Slot)> {
        let index = u32::try_from((address & u64::from(u32::MAX)).checked_sub(1)?).ok()?;
        let generation = u32::try_from(address >> 32).ok()?;
        let place = self.places.get_mut(index as usize)?;
        (place.generation == generation).then_some((index, place))
    }

    fn thing(&mut self, address: u64) -> Result<&mut Thing, String> {
        let thing = self.place(address).and_then(|(_, place)| place.thing.as_mut());
        thing.ok_or_else(|| "the address is of something that was destroyed".to_owned())
    }

    /// The document of an address.
    ///
    /// # Errors
    /// Where it is of something else, or of what is gone.
    pub(super) fn document(&mut self, address: u64) -> Result<&mut Document, String> {
        match self.thing(address)? {
            Thing::Document(document) => Ok(document),
            other => Err(format!("expected a document, found {}", other.name())),
        }
    }

    /// The cursor of an address; errors as for [`Table::document`].
    pub(super) fn cursor(&mut self, address: u64) -> Result<&mut VecDeque<Document>, String> {
        match self.thing(address)? {
            Thing::Cursor(cursor) => Ok(cursor),
            other => Err(format!("expected a cursor, found {}", other.name())),
        }
    }

    /// The array of an address; errors as for [`Table::document`].
    pub(super) fn array(&mut self, address: u64) -> Result<&mut Vec<Bson>, String> {
        match self.thing(address)? {
            Thing::Array(array) => Ok(array),
            other => Err(format!("expected an array, found {}", other.name())),
        }
    }

    /// The number of a trigger; errors as for [`Table::document`].
    pub(super) fn trigger(&mut self, address: u64) -> Result<u64, String> {
        match self.thing(address)? {
            Thing::Trigger(number) => Ok(*number),
            other => Err(format!("expected a trigger, found {}", other.name())),
        }
    }

    /// What an address holds as a value of a document: documents and arrays.
    pub(super) fn value(&mut self, address: u64) -> Result<Bson, String> {
        match self.thing(address)? {
            Thing::Document(document) => Ok(Bson::Document(document.clone())),
            Thing::Array(array) => Ok(Bson::Array(array.clone())),
            other => Err(format!("{} cannot be in a document", other.name())),
        }
    }

    /// Gives a place free; returns whether something was there.
    pub(super) fn remove(&mut self, address: u64) -> bool {
        let Some((index, place)) = self.place(address) else { return false };
        let was = place.thing.take().is_some();
        if was {
            self.free.push(index);
        }
        was
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_of_what_was_destroyed_is_not_taken_for_what_came_after_it() {
        let mut table = Table::default();
        let first = table.add(Thing::Document(bson::doc! { "a": 1 }));
        assert!(table.remove(first) && !table.remove(first));
        let second = table.add(Thing::Array(Vec::new()));
        assert_ne!(first, second);
        assert!(table.document(first).unwrap_err().contains("destroyed"));
        assert!(table.document(second).unwrap_err().contains("found an array"));
        for address in [0, 1, u64::MAX, second + 1] {
            assert!(table.document(address).is_err());
        }
    }
}
