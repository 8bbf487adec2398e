//! The definition of an index.

use bson::{Bson, DateTime, Document, doc};

use crate::query::{Collation, QueryError};

/// The name of the index on `_id`, which every collection has.
pub const ID: &str = "_id_";

/// The name of the index by which a memory finds what has decayed.
pub const DECAY: &str = "_robmem_info.decay_time_1";

/// The option of an index whose strings do not compare byte by byte.
pub const COLLATION: &str = "collation";

/// The option of an index that queries do not use.
pub const HIDDEN: &str = "hidden";

/// MongoDB's code for an option that cannot be.
const INVALID_OPTIONS: i32 = 67;

/// The option of an index on a sphere that says how its keys are written …
const SPHERE_VERSION: &str = "2dsphereIndexVersion";
/// … which is so where nothing is said.
const CURRENT_SPHERE: i32 = 3;

/// An index of a collection.
#[derive(Debug, Clone, PartialEq)]
pub struct Index {
    /// What it is called, like `a_1_b_-1`.
    pub name: String,
    /// Dotted paths with 1, -1, or a geospatial kind: `2d`, `2dsphere`.
    pub keys: Document,
    /// No two documents have one key.
    pub unique: bool,
    /// Documents that have none of the fields are not in it.
    pub sparse: bool,
    /// Documents are removed so many seconds after the date they have there.
    pub expire_after: Option<i64>,
    /// Other options, as MongoDB spells them: `partialFilterExpression`, `hidden`, those of geospatial indexes, and ones
    /// that only a server understands.
    pub other: Document,
}

/// What is to be changed of an index; what is `None` stays.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct IndexChange {
    /// Whether it is kept from queries.
    pub hidden: Option<bool>,
    /// Documents are removed so many seconds after the date they have there.
    pub expire_after: Option<i64>,
}

impl Index {
    /// A plain index on these keys, with the name MongoDB gives it.
    #[must_use]
    pub fn on(keys: Document) -> Self {
        let name = default_name(&keys);
        Self { name, keys, unique: false, sparse: false, expire_after: None, other: Document::new() }
    }

    /// The index on `_id`.
    #[must_use]
    pub fn of_ids() -> Self {
        Self { name: ID.to_owned(), ..Self::on(doc! { "_id": 1 }) }
    }

    /// The index on `_id` of a collection with a collation of its own.
    #[must_use]
    pub fn of_collated_ids(collation: &Collation) -> Self {
        Self { other: doc! { COLLATION: collation.definition().clone() }, ..Self::of_ids() }
    }

    /// The index by which a memory finds what has decayed. While a collection
    /// has none, nothing in it decays.
    #[must_use]
    pub fn of_decay() -> Self {
        Self { sparse: true, expire_after: Some(0), ..Self::on(doc! { super::metadata::DECAY_PATH: 1 }) }
    }

    /// Reads a definition as MongoDB lists and dumps them: `{v: 2, key: {…}, name: …, unique: true, …}`.
    ///
    /// # Errors
    /// Where there are no keys, or an option has the wrong type.
    pub fn parse(definition: &Document) -> Result<Self, QueryError> {
        let Ok(keys) = definition.get_document("key") else {
            return Err(QueryError::failed_to_parse("the definition of an index needs `key`, a document"));
        };
        let mut index = Self::on(keys.clone());
        for (option, value) in definition {
            match (option.as_str(), value) {
                ("key" | "v" | "ns" | "background", _) => {}
                ("name", Bson::String(name)) => index.name.clone_from(name),
                ("unique", value) => index.unique = flag(option, value)?,
                ("sparse", value) => index.sparse = flag(option, value)?,
                ("expireAfterSeconds", value) => index.expire_after = Some(seconds(value)?),
                ("collation", Bson::Document(spec)) if spec.is_empty() => {
                    return Err(QueryError::bad_value("the collation of an index cannot be empty"));
                }
                ("collation", Bson::Document(spec)) => {
                    index.other.insert(option, Collation::parse(spec)?.definition().clone());
                }
                ("collation", _) => return Err(QueryError::type_mismatch("the collation of an index is an object")),
                ("name", _) => return Err(QueryError::type_mismatch("the name of an index is a string")),
                (option, value) => {
                    index.other.insert(option, value.clone());
                }
            }
        }
        Ok(index)
    }

    /// The definition as MongoDB lists and dumps it.
    #[must_use]
    pub fn definition(&self) -> Document {
        let mut definition = doc! { "v": 2, "key": self.keys.clone(), "name": &self.name };
        if self.unique {
            definition.insert("unique", true);
        }
        if self.sparse {
            definition.insert("sparse", true);
        }
        if let Some(seconds) = self.expire_after {
            definition.insert("expireAfterSeconds", i32::try_from(seconds).map_or(Bson::Int64(seconds), Bson::Int32));
        }
        definition.extend(self.other.clone());
        if self.keys.values().any(|kind| kind.as_str() == Some("2dsphere")) && !definition.contains_key(SPHERE_VERSION)
        {
            // Without it, mongorestore makes an index of version 1.
            definition.insert(SPHERE_VERSION, CURRENT_SPHERE);
        }
        definition
    }

    /// Whether it keeps the same keys of the same documents, whatever it is called.
    #[must_use]
    pub fn is_like(&self, other: &Self) -> bool {
        same_keys(&self.keys, &other.keys)
            && (self.unique, self.sparse, self.options()) == (other.unique, other.sparse, other.options())
    }

    /// The other options, without what an index on a sphere has where nothing is said.
    fn options(&self) -> Document {
        let mut options = self.other.clone();
        if options.get(SPHERE_VERSION) == Some(&Bson::Int32(CURRENT_SPHERE)) {
            options.remove(SPHERE_VERSION);
        }
        options
    }

    /// How its strings compare, where that is not byte by byte. That of the index on `_id` is the collation of the
    /// collection.
    #[must_use]
    pub fn collation(&self) -> Option<Collation> {
        let collation = Collation::parse(self.other.get_document(COLLATION).ok()?).ok()?;
        (!collation.is_simple()).then_some(collation)
    }

    /// The same index, for a collection that has this collation or none: one that says nothing of collation gets it, and
    /// one whose strings compare byte by byte says nothing.
    #[must_use]
    pub fn inheriting(mut self, collation: Option<&Collation>) -> Self {
        match (self.other.get_document(COLLATION), collation) {
            (Ok(spec), _) if Collation::parse(spec).is_ok_and(|own| own.is_simple()) => {
                self.other.remove(COLLATION);
            }
            (Err(_), Some(collation)) => {
                self.other.insert(COLLATION, collation.definition().clone());
            }
            _ => {}
        }
        self
    }

    /// The same index as one that is made in a collection with a collation: it inherits none.
    #[must_use]
    pub fn standing_alone(mut self) -> Self {
        if !self.other.contains_key(COLLATION) {
            self.other.insert(COLLATION, Collation::simple().definition().clone());
        }
        self
    }

    /// Whether it is kept from queries.
    #[must_use]
    pub fn is_hidden(&self) -> bool {
        self.other.get_bool(HIDDEN).unwrap_or(false)
    }

    /// The same index with a change.
    #[must_use]
    pub fn changed(mut self, change: IndexChange) -> Self {
        match change.hidden {
            Some(true) => drop(self.other.insert(HIDDEN, true)),
            Some(false) => drop(self.other.remove(HIDDEN)),
            None => {}
        }
        Self { expire_after: change.expire_after.or(self.expire_after), ..self }
    }

    /// Whether it has these keys, in this order.
    #[must_use]
    pub fn has_keys(&self, keys: &Document) -> bool {
        same_keys(&self.keys, keys)
    }

    /// Whether it is the same in everything.
    #[must_use]
    pub fn is_same(&self, other: &Self) -> bool {
        self.is_like(other) && self.name == other.name && self.expire_after == other.expire_after
    }

    /// The field by whose dates documents are removed, where there is one, and the latest of these dates at a time.
    #[must_use]
    pub fn expiring(&self, now: DateTime) -> Option<(&str, DateTime)> {
        let age = self.expire_after?.saturating_mul(1_000);
        Some((self.keys.keys().next()?, DateTime::from_millis(now.timestamp_millis().saturating_sub(age))))
    }
}

/// The collation of a collection with these indexes: that of its index on `_id`.
#[must_use]
pub fn collation(indexes: &[Index]) -> Option<Collation> {
    indexes.iter().find(|index| index.name == ID)?.collation()
}

/// The name MongoDB gives to an index on these keys.
#[must_use]
pub fn default_name(keys: &Document) -> String {
    let parts = keys.iter().map(|(path, direction)| match direction {
        Bson::String(kind) => format!("{path}_{kind}"),
        Bson::Double(number) if number.fract() == 0.0 => format!("{path}_{number:.0}"),
        number => format!("{path}_{number}"),
    });
    parts.collect::<Vec<_>>().join("_")
}

/// Whether two patterns have the same paths in the same order and directions.
fn same_keys(a: &Document, b: &Document) -> bool {
    let equal = |a: &Bson, b: &Bson| crate::query::compare_values(a, b).is_eq();
    a.len() == b.len() && a.iter().zip(b).all(|((path, a), (other, b))| path == other && equal(a, b))
}

fn flag(option: &str, value: &Bson) -> Result<bool, QueryError> {
    match value {
        Bson::Boolean(value) => Ok(*value),
        Bson::Int32(value) => Ok(*value != 0),
        Bson::Int64(value) => Ok(*value != 0),
        Bson::Double(value) => Ok(*value != 0.0),
        Bson::Decimal128(_) => Ok(!crate::query::compare_values(value, &Bson::Int32(0)).is_eq()),
        _ => Err(QueryError::type_mismatch(format!("the option {option} of an index is true or false"))),
    }
}

/// Seconds from 0 to 2^31 - 1, as MongoDB takes them.
fn seconds(value: &Bson) -> Result<i64, QueryError> {
    let seconds = match value {
        Bson::Int32(value) => i64::from(*value),
        Bson::Int64(value) => *value,
        #[expect(clippy::cast_possible_truncation, reason = "MongoDB truncates too")]
        Bson::Double(value) => *value as i64,
        #[expect(clippy::cast_possible_truncation, reason = "MongoDB rounds too")]
        Bson::Decimal128(value) => value.to_string().parse::<f64>().unwrap_or(f64::NAN).round_ties_even() as i64,
        _ => return Err(QueryError::invalid(INVALID_OPTIONS, "expireAfterSeconds is a number of seconds")),
    };
    match seconds {
        0..=0x7FFF_FFFF => Ok(seconds),
        _ => Err(QueryError::invalid(INVALID_OPTIONS, "expireAfterSeconds is from 0 to 2147483647")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_mongodb() {
        assert_eq!(default_name(&doc! { "a": 1, "b.c": -1, "p": "2d", "d": 1.0 }), "a_1_b.c_-1_p_2d_d_1");
    }

    #[test]
    fn what_is_defined_is_read() {
        let index = Index { unique: true, expire_after: Some(7), ..Index::on(doc! { "a": 1 }) };
        assert_eq!(Index::parse(&index.definition()).unwrap(), index);
        let partial = doc! { "key": { "a": 1 }, "name": "x", "partialFilterExpression": { "b": 1 } };
        assert_eq!(Index::parse(&partial).unwrap().other, doc! { "partialFilterExpression": { "b": 1 } });
        let decimal = |text: &str| Bson::Decimal128(text.parse().unwrap());
        let given = doc! { "key": { "a": 1 }, "unique": decimal("0.5"), "sparse": decimal("0E+3"), "expireAfterSeconds": decimal("2.5") };
        let index = Index::parse(&given).unwrap();
        assert_eq!((index.unique, index.sparse, index.expire_after), (true, false, Some(2)));
        let simple = Index::parse(&doc! { "key": { "a": 1 }, "collation": { "locale": "simple" } }).unwrap();
        let collation = Collation::parse(&doc! { "locale": "en", "strength": 2 }).ok();
        assert_eq!(simple.clone().inheriting(collation.as_ref()), Index::on(doc! { "a": 1 }));
        assert_eq!(Index::on(doc! { "a": 1 }).standing_alone(), simple);
        let inheriting = Index::on(doc! { "a": 1 }).inheriting(collation.as_ref());
        assert_eq!(inheriting.collation(), collation);
        assert_eq!(inheriting.clone().standing_alone().inheriting(None), inheriting);
        for wrong in [doc! {}, doc! { "key": { "a": 1 }, "unique": "yes" }, doc! { "key": { "a": 1 }, "name": 3 }] {
            assert!(Index::parse(&wrong).is_err(), "{wrong}");
        }
    }
}
