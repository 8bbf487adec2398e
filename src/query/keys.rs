//! The keys of a document for several paths, as sorts order by and as indexes hold.
//!
//! Each combination of values is a key. Paths that run through one array are
//! followed through each of its elements together; a number in a path names
//! an element, as far as it can.

use super::error::QueryError;
use super::key::Text;
use super::path::Path;
use super::view::{Fields, Items, View};

/// Paths with directions.
#[derive(Debug, Clone, Default)]
pub(super) struct Keys {
    fields: Vec<Field>,
    text: Text,
}

#[derive(Debug, Clone)]
struct Field {
    path: Path,
    descending: bool,
}

/// The reason why a document has no keys.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Unclear {
    /// Two of the paths run through different arrays.
    Parallel,
    /// A number in a path is both the index of an element and the name of a field in one.
    Ambiguous(String),
}

impl Unclear {
    /// Returns the error; sorts and indexes have different codes for parallel arrays.
    pub(super) fn complaint(self, parallel: impl FnOnce() -> QueryError) -> QueryError {
        match self {
            Self::Parallel => parallel(),
            Self::Ambiguous(name) => {
                let message = format!(
                    "ambiguous field name: '{name}' is the index of an element of an array and the name of a field in one"
                );
                QueryError::invalid(16_746, message).about(&name)
            }
        }
    }
}

/// One combination of values, a key.
pub(super) struct Key<'a> {
    keys: &'a Keys,
    slots: &'a [Slot<'a>],
}

impl Keys {
    pub(super) fn push(&mut self, path: Path, descending: bool) {
        self.fields.push(Field { path, descending });
    }

    /// The same paths, with strings that compare in a way of their own.
    pub(super) fn with_text(self, text: Text) -> Self {
        Self { text, ..self }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.fields.is_empty()
    }

    /// Returns the paths, and whether each is descending.
    pub(super) fn fields(&self) -> impl ExactSizeIterator<Item = (&str, bool)> {
        self.fields.iter().map(|field| (field.path.text(), field.descending))
    }

    pub(super) fn paths(&self) -> impl Iterator<Item = &Path> {
        self.fields.iter().map(|field| &field.path)
    }

    /// Shows every key of a document; gives the paths that run through an array, as bits.
    pub(super) fn each(&self, fields: Fields<'_>, show: &mut dyn FnMut(Key<'_>)) -> Result<u64, Unclear> {
        // `_id` is compared as a whole: a stored one is no array, but a stage can make one.
        let slot = |path| match Path::text(path) {
            "_id" => Slot::Value(fields.get("_id")),
            _ => Slot::Path(fields, path, 0),
        };
        let slots = self.fields.iter().map(|field| slot(&field.path)).collect();
        self.expand(slots, show)
    }

    /// Follows all paths to the first array on the way, and through each of its elements.
    fn expand(&self, mut slots: Vec<Slot<'_>>, show: &mut dyn FnMut(Key<'_>)) -> Result<u64, Unclear> {
        for slot in &mut slots {
            slot.advance();
        }
        let Some(items) = slots.iter().find_map(Slot::array) else {
            show(Key { keys: self, slots: &slots });
            return Ok(0);
        };
        if slots.iter().filter_map(Slot::array).any(|other| !other.is(items)) {
            return Err(Unclear::Parallel);
        }
        let at_array = slots.iter().enumerate().filter(|(_, slot)| slot.array().is_some());
        let mut through = at_array.fold(0, |bits, (index, _)| bits | 1u64 << index.min(63));
        if items.is_empty() {
            return Ok(through | self.expand(slots.iter().map(Slot::in_empty).collect(), show)?);
        }
        for item in items.iter() {
            let inside = slots.iter().map(|slot| slot.in_item(item)).collect::<Result<_, _>>()?;
            through |= self.expand(inside, show)?;
        }
        Ok(through)
    }
}

impl Key<'_> {
    /// Bytes in the order of the pattern.
    pub(super) fn encode(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(16 * self.slots.len());
        for (slot, field) in self.slots.iter().zip(&self.keys.fields) {
            let start = bytes.len();
            self.keys.text.append(slot.value().unwrap_or(View::Null), &mut bytes);
            if field.descending {
                for byte in bytes.iter_mut().skip(start) {
                    *byte = !*byte;
                }
            }
        }
        bytes
    }

    /// Returns the values, path by path; nothing where one is missing.
    pub(super) fn values(&self) -> impl Iterator<Item = Option<View<'_>>> {
        self.slots.iter().map(Slot::value)
    }
}

/// The progress along one path.
#[derive(Debug, Clone)]
enum Slot<'a> {
    /// In a document, with so many parts behind.
    Path(Fields<'a>, &'a Path, usize),
    /// At an array, with so many parts behind; one that was named by its index counts as a whole.
    Array { items: Items<'a>, path: &'a Path, done: usize, indexed: bool },
    /// At the end; nothing is a missing value.
    Value(Option<View<'a>>),
}

impl<'a> Slot<'a> {
    fn advance(&mut self) {
        while let Self::Path(fields, path, done) = *self {
            let value = path.parts().get(done).and_then(|part| fields.get(&part.name));
            *self = Self::at(value, path, done + 1, false);
        }
    }

    /// At a value, with so many parts behind.
    fn at(value: Option<View<'a>>, path: &'a Path, done: usize, indexed: bool) -> Self {
        match value {
            Some(View::Array(items)) => Self::Array { items, path, done, indexed },
            value if done >= path.parts().len() => Self::Value(value),
            Some(View::Document(fields)) => Self::Path(fields, path, done),
            _ => Self::Value(None),
        }
    }

    fn value(&self) -> Option<View<'a>> {
        if let Self::Value(value) = self { *value } else { None }
    }

    fn array(&self) -> Option<Items<'a>> {
        match self {
            Self::Array { items, .. } => Some(*items),
            _ => None,
        }
    }

    fn in_item(&self, item: View<'a>) -> Result<Self, Unclear> {
        let Self::Array { items, path, done, indexed } = *self else { return Ok(self.clone()) };
        let Some(part) = path.parts().get(done) else {
            return Ok(Self::Value(Some(if indexed { View::Array(items) } else { item })));
        };
        // A number names an element, where there is one.
        match (part.index.and_then(|index| items.get(index)), item) {
            (Some(_), View::Document(fields)) if fields.get(&part.name).is_some() => {
                Err(Unclear::Ambiguous(part.name.clone()))
            }
            (Some(named), _) => Ok(Self::at(Some(named), path, done + 1, true)),
            (None, View::Document(fields)) => Ok(Self::Path(fields, path, done)),
            (None, _) => Ok(Self::Value(None)),
        }
    }

    fn in_empty(&self) -> Self {
        match self {
            Self::Array { path, done, .. } if *done == path.parts().len() => Self::Value(Some(View::Undefined)),
            Self::Array { .. } => Self::Value(None),
            other => other.clone(),
        }
    }
}
