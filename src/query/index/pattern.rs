//! The key pattern of an index, and the keys of a document under it.

use std::sync::Arc;

use bson::{Bson, Document, RawDocument};

use super::wildcard::{self, Wildcard};
use crate::query::collation::{self, Collation};
use crate::query::error::{QueryError, Result};
use crate::query::filter::Filter;
use crate::query::geo::{Near, Places, is_place};
use crate::query::key::{self, Text};
use crate::query::keys::Keys;
use crate::query::number::Number;
use crate::query::path::{Part, Path};
use crate::query::text::{self, TextIndex};
use crate::query::view::{Fields, Items, View};

/// The most fields a pattern may have.
const MAX_FIELDS: usize = 32;
/// MongoDB's code for a key pattern that cannot be.
const CANNOT_CREATE: i32 = 67;
/// MongoDB's code for an index with several hashed keys.
const MANY_HASHED: i32 = 31_303;
/// MongoDB's code for an array under a hashed key.
const HASHED_ARRAY: i32 = 16_766;
/// MongoDB's code for a document with two arrays where one may be.
const PARALLEL: i32 = 171;
/// MongoDB's code for a path that means an element and a field.
const AMBIGUOUS: i32 = 16_746;

/// A compiled key pattern like `{a: 1, "b.c": -1}`.
#[derive(Debug)]
pub struct Pattern {
    keys: Keys,
    /// How its strings compare; without one, byte by byte.
    collation: Option<Collation>,
    /// What an index of places checks; it is kept in the catalogue and answered by a scan.
    places: Option<Places>,
    /// The paths of a wildcard index, which is kept in the catalogue, too.
    wildcard: Option<Wildcard>,
    /// What a text index searches; it is kept in the catalogue, too.
    text: Option<Arc<TextIndex>>,
    /// Whether one of its keys is hashed: its values are kept as they are, and arrays are refused.
    hashed: bool,
}

/// The keys of a document.
#[derive(Debug, Default)]
pub struct Entries {
    /// In order, each once.
    pub keys: Vec<Vec<u8>>,
    /// A bit for each path of the pattern that runs through an array.
    pub multikey: u64,
}

impl Pattern {
    /// Reads a key pattern.
    ///
    /// # Errors
    /// If MongoDB refuses it, or rmem does not support its type.
    pub fn parse(pattern: &Document) -> Result<Self> {
        Self::parse_with(pattern, &Document::new())
    }

    /// [`Pattern::parse`] with the options of an index of places, like `max`.
    ///
    /// # Errors
    /// As [`Pattern::parse`].
    pub fn parse_with(pattern: &Document, options: &Document) -> Result<Self> {
        if pattern.is_empty() {
            return Err(cannot("an index needs at least one key, like {name: 1}"));
        }
        if pattern.len() > MAX_FIELDS {
            return Err(QueryError::invalid(13_103, format!("an index has at most {MAX_FIELDS} keys")));
        }
        if pattern.values().any(text::is_key) {
            let text = Some(Arc::new(TextIndex::parse(pattern, options)?));
            return Ok(Self { text, ..Self::empty() });
        }
        if pattern.keys().any(|name| wildcard::is_key(name)) {
            let wildcard = Some(Wildcard::parse(pattern, options)?);
            return Ok(Self { wildcard, ..Self::empty() });
        }
        if options.contains_key(wildcard::PROJECTION) {
            return Err(QueryError::bad_value("wildcardProjection is for wildcard indexes, like {'$**': 1}")
                .about("wildcardProjection"));
        }
        let keys = keys(pattern)?;
        let hashed = pattern.values().any(is_hashed);
        if pattern.values().filter(|kind| is_hashed(kind)).count() > 1 {
            return Err(QueryError::invalid(MANY_HASHED, "an index has at most one hashed key"));
        }
        if hashed && pattern.values().any(is_place) {
            return Err(cannot("an index of places cannot have a hashed key"));
        }
        let places = pattern.values().any(is_place).then(|| Places::parse(pattern, options)).transpose()?;
        let collation = match options.get("collation") {
            Some(Bson::Document(spec)) => Some(Collation::parse(spec)?).filter(|collation| !collation.is_simple()),
            _ => None,
        };
        if collation.is_some() && pattern.values().any(|kind| matches!(kind.as_str(), Some("2d"))) {
            return Err(cannot("an index of type 2d compares strings byte by byte"));
        }
        Ok(Self { keys: keys.with_text(Text::By(collation.clone())), collation, places, hashed, ..Self::empty() })
    }

    /// A pattern that has nothing yet.
    fn empty() -> Self {
        Self { keys: Keys::default(), collation: None, places: None, wildcard: None, text: None, hashed: false }
    }

    /// Returns how its strings compare, where that is not byte by byte.
    #[must_use]
    pub fn collation(&self) -> Option<&Collation> {
        self.collation.as_ref()
    }

    /// Returns the key of a value under this pattern.
    pub(super) fn encode(&self, value: &Bson) -> Vec<u8> {
        collation::during(self.collation(), || key::collated(value))
    }

    /// Returns whether its keys are in the order, and equal, as in the operation that runs.
    #[must_use]
    pub fn is_in_effect(&self) -> bool {
        collation::is(self.collation())
    }

    /// Returns whether it is a geospatial index, whose keys are not in the order of values.
    #[must_use]
    pub fn is_geospatial(&self) -> bool {
        self.places.is_some()
    }

    /// Returns whether one of its keys is hashed.
    #[must_use]
    pub fn is_hashed(&self) -> bool {
        self.hashed
    }

    /// Returns whether it is a wildcard index, which has no keys.
    #[must_use]
    pub fn is_wildcard(&self) -> bool {
        self.wildcard.is_some()
    }

    /// Returns what a text index searches; it has no keys.
    #[must_use]
    pub fn text(&self) -> Option<&Arc<TextIndex>> {
        self.text.as_ref()
    }

    /// Returns whether an index could serve a filter: a wildcard index only one that asks for its paths.
    #[must_use]
    pub fn serves(&self, filter: &Filter) -> bool {
        self.text.is_none() && self.wildcard.as_ref().is_none_or(|wildcard| wildcard.serves(filter.root()))
    }

    /// Checks that an index of places can be asked what is near a point.
    ///
    /// # Errors
    /// If the point is outside of its bounds.
    pub fn check_centre(&self, near: &Near) -> Result<()> {
        self.places.as_ref().map_or(Ok(()), |places| places.check_centre(near))
    }

    /// Returns the paths, and whether each is descending.
    pub fn fields(&self) -> impl ExactSizeIterator<Item = (&str, bool)> {
        self.keys.fields()
    }

    /// Returns the keys of a document; with `sparse`, none where all fields are missing.
    ///
    /// # Errors
    /// If two paths run through different arrays, or a number in a path is
    /// both an element and a field of an element; where something is no place.
    pub fn entries(&self, document: &RawDocument, sparse: bool) -> Result<Entries> {
        if self.wildcard.is_some() {
            return Ok(Entries::default());
        }
        if let Some(text) = &self.text {
            text.check(document)?;
            return Ok(Entries::default());
        }
        if let Some(places) = &self.places {
            places.check(document)?;
            return Ok(Entries::default());
        }
        let mut keys = Vec::new();
        let multikey = self.each(document, &mut |key, is_missing| {
            if !(sparse && is_missing) {
                keys.push(key);
            }
        })?;
        if self.hashed && multikey != 0 {
            let paths: Vec<&str> = self.keys.fields().map(|(name, _)| name).collect();
            let message =
                format!("an index with a hashed key takes no arrays; one of {} has an array", paths.join(", "));
            return Err(QueryError::invalid(HASHED_ARRAY, message));
        }
        if keys.len() > 1 {
            keys.sort_unstable();
            keys.dedup();
        }
        Ok(Entries { keys, multikey })
    }

    fn each(&self, document: &RawDocument, show: &mut dyn FnMut(Vec<u8>, bool)) -> Result<u64> {
        let fields = Fields::from(document);
        if let Some(path) = self.keys.paths().find(|path| is_ambiguous(fields, path.parts())) {
            let message = format!("a number in the path {} of an index is an element and a field", path.text());
            return Err(QueryError::invalid(AMBIGUOUS, message));
        }
        let parallel = || {
            let paths: Vec<&str> = self.keys.fields().map(|(name, _)| name).collect();
            let message =
                format!("cannot index parallel arrays: two of {} are arrays in one document", paths.join(", "));
            QueryError::invalid(PARALLEL, message)
        };
        let keys = self.keys.each(fields, &mut |key| show(key.encode(), key.values().all(|value| value.is_none())));
        keys.map_err(|unclear| unclear.complaint(parallel))
    }

    /// Returns the key that has these values, one for each path in the order of the pattern; nothing where there are other
    /// paths, or strings that compare in another way in the operation that runs.
    #[must_use]
    pub fn bound(&self, values: &Document) -> Option<Vec<u8>> {
        if self.fields().len() == 0 || !self.fields().map(|(path, _)| path).eq(values.keys().map(String::as_str)) {
            return None;
        }
        if !self.is_in_effect() && values.values().any(may_have_strings) {
            return None;
        }
        let mut key = Vec::new();
        for (value, (_, descending)) in values.values().zip(self.fields()) {
            let bytes = self.encode(value);
            key.extend(bytes.into_iter().map(|byte| if descending { !byte } else { byte }));
        }
        Some(key)
    }

    /// Returns the values behind a key of a document, path by path.
    #[must_use]
    pub fn values(&self, document: &RawDocument, wanted: &[u8]) -> Document {
        let mut found = Document::new();
        // A document that was indexed has no parallel arrays.
        let _ = self.keys.each(document.into(), &mut |key| {
            if found.is_empty() && key.encode() == wanted {
                let names = self.keys.fields().map(|(name, _)| name.to_owned());
                let values = key.values().map(|value| value.map_or(Bson::Null, View::to_bson));
                found = names.zip(values).collect();
            }
        });
        found
    }
}

/// Returns whether a value is, or may contain, a string.
pub(super) fn may_have_strings(value: &Bson) -> bool {
    matches!(value, Bson::String(_) | Bson::Symbol(_) | Bson::Document(_) | Bson::Array(_))
}

/// Whether a key of an index is hashed.
fn is_hashed(kind: &Bson) -> bool {
    kind.as_str() == Some("hashed")
}

/// Reads the keys of a pattern, each with its direction or type.
fn keys(pattern: &Document) -> Result<Keys> {
    let mut keys = Keys::default();
    for (name, direction) in pattern {
        check_name(name)?;
        let descending = match (direction, Number::of(direction).map(Number::to_double)) {
            (direction, _) if is_place(direction) => false,
            (direction, _) if is_hashed(direction) => false,
            (Bson::String(index_type), _) => {
                let mut refusal = QueryError::unsupported(index_type);
                refusal.message = format!("an index of type `{index_type}` is not supported by the embedded store");
                return Err(refusal);
            }
            (_, Some(number)) if number > 0.0 => false,
            (_, Some(number)) if number < 0.0 => true,
            _ => {
                return Err(cannot(format!(
                    "the key `{name}` of an index takes 1, -1, \"2d\", \"2dsphere\", \"hashed\" or \"text\""
                )));
            }
        };
        keys.push(Path::parse(name)?, descending);
    }
    Ok(keys)
}

fn cannot(message: impl Into<String>) -> QueryError {
    QueryError::invalid(CANNOT_CREATE, message)
}

fn check_name(name: &str) -> Result<()> {
    if name.is_empty() || name.split('.').any(str::is_empty) {
        return Err(QueryError::invalid(CANNOT_CREATE, "the keys of an index cannot have an empty part").about(name));
    }
    if name.split('.').any(|part| part.starts_with('$') && !crate::query::dollar::is_reference_key(part)) {
        let message = format!("the key `{name}` of an index has a part that starts with '$'");
        return Err(QueryError::invalid(CANNOT_CREATE, message).about(name));
    }
    Ok(())
}

/// Returns whether a number of the path is both an element of an array and a field of one of its elements.
fn is_ambiguous(fields: Fields<'_>, parts: &[Part]) -> bool {
    if parts.iter().all(|part| part.index.is_none()) {
        return false;
    }
    let Some((part, rest)) = parts.split_first() else { return false };
    match fields.get(&part.name) {
        Some(View::Document(inner)) => is_ambiguous(inner, rest),
        Some(View::Array(items)) => is_ambiguous_in(items, rest),
        _ => false,
    }
}

fn is_ambiguous_in(items: Items<'_>, parts: &[Part]) -> bool {
    let Some((part, rest)) = parts.split_first() else { return false };
    let documents =
        || items.iter().filter_map(|item| if let View::Document(fields) = item { Some(fields) } else { None });
    let Some(item) = part.index.and_then(|index| items.get(index)) else {
        return documents().any(|fields| is_ambiguous(fields, parts));
    };
    documents().any(|fields| fields.get(&part.name).is_some())
        || match item {
            View::Document(fields) => is_ambiguous(fields, rest),
            View::Array(inner) => is_ambiguous_in(inner, rest),
            _ => false,
        }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::query::key;
    use bson::{bson, doc};

    fn keys(pattern: Document, document: Document) -> (Vec<Vec<u8>>, u64) {
        let document = bson::RawDocumentBuf::try_from(&document).unwrap();
        let entries = Pattern::parse(&pattern).unwrap().entries(&document, false).unwrap();
        (entries.keys, entries.multikey)
    }

    fn encoded(values: &[Bson]) -> Vec<Vec<u8>> {
        values.iter().map(key::encode_value).collect()
    }

    #[test]
    fn every_element_of_an_array_is_a_key_once() {
        assert_eq!(keys(doc! {"a": 1}, doc! {"a": [2, 1, 2.0]}), (encoded(&[bson!(1), bson!(2)]), 1));
        assert_eq!(keys(doc! {"a": 1}, doc! {"a": []}), (encoded(&[Bson::Undefined]), 1));
        assert_eq!(keys(doc! {"a.b": 1}, doc! {"a": [{"b": 1}, {}]}), (encoded(&[Bson::Null, bson!(1)]), 1));
        assert_eq!(keys(doc! {"a": 1}, doc! {}), (encoded(&[Bson::Null]), 0));
    }

    #[test]
    fn a_sparse_index_leaves_out_what_has_none_of_its_fields() {
        let pattern = Pattern::parse(&doc! {"a": 1, "b": -1}).unwrap();
        let count = |document: Document| {
            let document = bson::RawDocumentBuf::try_from(&document).unwrap();
            pattern.entries(&document, true).unwrap().keys.len()
        };
        assert_eq!([count(doc! {"c": 1}), count(doc! {"b": 1}), count(doc! {"a": Bson::Null})], [0, 1, 1]);
    }

    #[test]
    fn what_mongod_refuses_to_index_is_refused() {
        let refusal = |pattern: Document, document: Document| {
            let document = bson::RawDocumentBuf::try_from(&document).unwrap();
            Pattern::parse(&pattern).unwrap().entries(&document, false).unwrap_err().code
        };
        assert_eq!(refusal(doc! {"a": 1, "b": 1}, doc! {"a": [1], "b": [2]}), PARALLEL);
        assert_eq!(refusal(doc! {"a.0": 1}, doc! {"a": [{"0": 1}]}), AMBIGUOUS);
        for pattern in [doc! {}, doc! {"a": 0}, doc! {"a": "up"}, doc! {"": 1}, doc! {"a..b": 1}, doc! {"$a": 1}] {
            assert!(Pattern::parse(&pattern).is_err(), "{pattern}");
        }
    }

    #[test]
    fn a_hashed_key_takes_no_arrays() {
        let refusal = |document: Document| {
            let document = bson::RawDocumentBuf::try_from(&document).unwrap();
            Pattern::parse(&doc! {"b": 1, "a.x": "hashed"})
                .unwrap()
                .entries(&document, false)
                .map_err(|error| error.code)
        };
        for array in [doc! {"a": {"x": []}}, doc! {"a": [{"x": 1}]}, doc! {"b": [1]}] {
            assert_eq!(refusal(array).unwrap_err(), HASHED_ARRAY);
        }
        assert_eq!(refusal(doc! {"a": {"x": 1}, "b": 2}).unwrap().keys.len(), 1);
        for (pattern, code) in
            [(doc! {"a": "hashed", "b": "hashed"}, MANY_HASHED), (doc! {"a": "hashed", "b": "2d"}, CANNOT_CREATE)]
        {
            assert_eq!(Pattern::parse(&pattern).unwrap_err().code, code);
        }
    }

    #[test]
    fn the_values_of_a_key_can_be_told() {
        let document = bson::rawdoc! {"a": [1, "x"], "b": 2};
        let pattern = Pattern::parse(&doc! {"a": 1, "b": 1}).unwrap();
        let keys = pattern.entries(&document, false).unwrap().keys;
        assert_eq!(pattern.values(&document, &keys[1]), doc! {"a": "x", "b": 2});
    }
}
