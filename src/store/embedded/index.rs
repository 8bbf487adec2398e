//! The indexes of a collection: their catalogue, and the keys in them.
//!
//! An index is a table of its own, `entries_ID`: keys, each with the position
//! of its document and a checksum (`keys`). It is changed in the transaction that changes the document.
//! Every collection has a generation, which grows with each change of its
//! indexes; a store compares it with the generation of its cached indexes.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use bson::raw::RawBsonRef;
use bson::{Bson, Document, RawDocument, RawDocumentBuf};
use rusqlite::{OptionalExtension as _, params};

use super::catalog::Collection;
use super::indexed::{AllEntries, Defined, Indexed, Indexes, PARTIAL, decay, of_ids};
use super::keys::seal;
use super::scan::check_ending;
use super::{Embedded, body};
use crate::query::index::{Entries, Pattern};
use crate::query::{Collation, Filter, QueryError, text};
use crate::store::{Index, IndexChange, Modifiers, Namespace, StoreError, TakenKey, index, metadata};

/// MongoDB's code for an index that is there with other options.
const OPTIONS_CONFLICT: i32 = 85;
/// MongoDB's code for an index of that name that is another one.
const KEYS_CONFLICT: i32 = 86;
/// Options of geospatial indexes, and those that every index may have.
const OPTIONS: [&str; 8] =
    ["2dsphereIndexVersion", "bits", "min", "max", "wildcardProjection", PARTIAL, index::HIDDEN, index::COLLATION];
/// MongoDB's code for an index that cannot be made.
const CANNOT_CREATE: i32 = 67;
/// MongoDB's code for an index that has to stay, or cannot be.
const INVALID: i32 = 72;
/// MongoDB's code for a unique index with a hashed key.
const UNIQUE_HASHED: i32 = 16_764;
/// The most indexes of a collection, with that on `_id`.
const MOST_INDEXES: usize = 64;

impl Embedded {
    /// The indexes of a collection, but the one on `_id`.
    pub(super) fn indexes_of(&self, collection: Collection) -> Result<Indexes, StoreError> {
        if let Some(indexes) = self.indexes.get(collection) {
            return Ok(indexes);
        }
        let indexes = Arc::new(self.load(collection)?);
        self.indexes.set(collection, &indexes);
        Ok(indexes)
    }

    /// Reads how a collection is defined.
    pub(super) fn load(&self, collection: Collection) -> Result<Defined, StoreError> {
        let indexes = self.load_indexes(collection)?;
        let collation = of_ids(&indexes).and_then(|ids| ids.pattern.collation());
        let validation = self.load_validation(collection, collation)?;
        Ok(Defined { indexes, validation })
    }

    fn load_indexes(&self, collection: Collection) -> Result<Vec<Indexed>, StoreError> {
        let sql = "SELECT id, definition, multikey, EXISTS (
                       SELECT 1 FROM pragma_table_info('entries_' || id) AS info WHERE info.name = 'seal')
                   FROM indexes WHERE collection = ? ORDER BY id";
        let rows: Vec<(i64, Vec<u8>, i64, bool)> = self
            .connection
            .prepare_cached(sql)
            .and_then(|mut statement| statement.query_map([collection.id], |row| row.try_into())?.collect())
            .map_err(|e| self.explain(&e))?;
        rows.into_iter()
            .map(|(id, definition, multikey, is_sealed)| {
                let definition = RawDocumentBuf::from_bytes(definition).map_err(QueryError::from)?;
                let definition = Index::parse(&Document::try_from(&*definition).map_err(QueryError::from)?)?;
                Ok(Indexed::new(id, definition, multikey.cast_unsigned(), is_sealed)?)
            })
            .collect()
    }

    /// The keys of a document, where no unique index has one of them for
    /// another document than that at `position`.
    pub(super) fn entries(
        &self,
        ns: &Namespace,
        indexes: &[Indexed],
        body: &RawDocument,
        position: Option<i64>,
    ) -> Result<AllEntries, StoreError> {
        indexes
            .iter()
            .map(|index| {
                let entries = index.entries(body)?;
                if index.definition.unique {
                    self.check_unique(ns, index, body, &entries, position)?;
                    let keys = index.keys();
                    let check = |key: &Vec<u8>| keys.check_around(&self.connection, key);
                    entries.keys.iter().try_for_each(check).map_err(|e| self.explain(&e))?;
                }
                Ok(entries)
            })
            .collect()
    }

    fn check_unique(
        &self,
        ns: &Namespace,
        index: &Indexed,
        body: &RawDocument,
        entries: &Entries,
        position: Option<i64>,
    ) -> Result<(), StoreError> {
        let sql = format!("SELECT 1 FROM {} WHERE key = ? AND position IS NOT ? LIMIT 1", index.table());
        let mut statement = self.connection.prepare_cached(&sql).map_err(|e| self.explain(&e))?;
        for key in &entries.keys {
            let taken = statement.query_row(params![key, position], |_| Ok(())).optional();
            if taken.map_err(|e| self.explain(&e))?.is_some() {
                return Err(taken_key(ns, index, body, key));
            }
        }
        Ok(())
    }

    /// Notes the keys of a document. In a write transaction only.
    pub(super) fn add_entries(
        &self,
        collection: Collection,
        indexes: &[Indexed],
        position: i64,
        entries: &[Entries],
    ) -> Result<(), StoreError> {
        for (index, entries) in indexes.iter().zip(entries) {
            self.note_multikey(collection, index, entries.multikey)?;
            self.add_keys(index, &entries.keys, position)?;
        }
        Ok(())
    }

    /// Forgets the keys of a document. In a write transaction only.
    pub(super) fn remove_entries(
        &self,
        indexes: &[Indexed],
        position: i64,
        body: &RawDocument,
    ) -> Result<(), StoreError> {
        for index in indexes {
            let keys = index.entries(body)?.keys;
            self.remove_keys(index, &keys, position)?;
        }
        Ok(())
    }

    /// Notes new keys of a document instead of old ones. In a write transaction only.
    pub(super) fn change_entries(
        &self,
        collection: Collection,
        indexes: &[Indexed],
        position: i64,
        old: &RawDocument,
        entries: &[Entries],
    ) -> Result<(), StoreError> {
        for (index, new) in indexes.iter().zip(entries) {
            let old = index.entries(old)?;
            if old.keys == new.keys && new.multikey & !index.multikey() == 0 {
                continue;
            }
            let gone: Vec<_> = old.keys.iter().filter(|key| !new.keys.contains(key)).cloned().collect();
            let more: Vec<_> = new.keys.iter().filter(|key| !old.keys.contains(key)).cloned().collect();
            self.note_multikey(collection, index, new.multikey)?;
            self.remove_keys(index, &gone, position)?;
            self.add_keys(index, &more, position)?;
        }
        Ok(())
    }

    fn add_keys(&self, index: &Indexed, keys: &[Vec<u8>], position: i64) -> Result<(), StoreError> {
        if keys.is_empty() {
            return Ok(());
        }
        let (column, value) = if index.is_sealed { (", seal", ", ?") } else { ("", "") };
        let sql = format!("INSERT OR IGNORE INTO {} (key, position{column}) VALUES (?, ?{value})", index.table());
        let add = || -> rusqlite::Result<()> {
            let mut statement = self.connection.prepare_cached(&sql)?;
            for key in keys {
                match index.is_sealed {
                    true => statement.execute(params![key, position, seal(key, position)])?,
                    false => statement.execute(params![key, position])?,
                };
            }
            Ok(())
        };
        add().map_err(|e| self.explain(&e))
    }

    fn remove_keys(&self, index: &Indexed, keys: &[Vec<u8>], position: i64) -> Result<(), StoreError> {
        if keys.is_empty() {
            return Ok(());
        }
        let sql = format!("DELETE FROM {} WHERE key = ? AND position = ?", index.table());
        let mut statement = self.connection.prepare_cached(&sql).map_err(|e| self.explain(&e))?;
        for key in keys {
            statement.execute(params![key, position]).map_err(|e| self.explain(&e))?;
        }
        Ok(())
    }

    fn note_multikey(&self, collection: Collection, index: &Indexed, bits: u64) -> Result<(), StoreError> {
        let known = index.multikey();
        if bits & !known == 0 {
            return Ok(());
        }
        self.connection
            .execute("UPDATE indexes SET multikey = ? WHERE id = ?", params![(known | bits).cast_signed(), index.id])
            .and_then(|_| self.catalog_cache.advance(&self.connection, collection))
            .map_err(|e| self.explain(&e))?;
        index.multikey.store(known | bits, Ordering::Relaxed);
        Ok(())
    }

    /// Makes sure that what decays is found: with the first document that does,
    /// the index on the dates is made. In a write transaction only.
    pub(super) fn expect_decay(
        &self,
        ns: &Namespace,
        collection: Collection,
        indexes: Indexes,
        body: &RawDocument,
    ) -> Result<Indexes, StoreError> {
        if !may_decay(body) || decay(&indexes).is_some() {
            return Ok(indexes);
        }
        self.make_index(ns, collection, &Index::of_decay())?;
        self.indexes_of(collection)
    }

    /// Makes an index, where there is none like it; returns whether it is new. One that says nothing of collation has
    /// that of the collection.
    pub(super) fn create(&self, ns: &Namespace, index: &Index) -> Result<bool, StoreError> {
        check(index)?;
        self.write(|| {
            let collection = self.ensure(ns)?;
            let present = self.indexes_of(collection)?;
            let collation = of_ids(&present).and_then(|ids| ids.pattern.collation());
            let index = &stored(&index.clone().inheriting(collation))?;
            match conflict(index, &present)? {
                true => Ok(false),
                false if self.list_indexes(ns)?.len() >= MOST_INDEXES => {
                    let message = format!("a collection has at most {MOST_INDEXES} indexes");
                    Err(QueryError::invalid(CANNOT_CREATE, message).into())
                }
                false => self.make_index(ns, collection, index).map(|()| true),
            }
        })
    }

    /// Makes an empty collection, whose strings compare by a collation, where there is none; returns whether it is new.
    pub(super) fn create_collection(&self, ns: &Namespace, collation: Option<&Collation>) -> Result<bool, StoreError> {
        self.write(|| {
            if self.collection(ns)?.is_some() {
                return Ok(false);
            }
            let collection = self.ensure(ns)?;
            if let Some(collation) = collation.filter(|collation| !collation.is_simple()) {
                let ids = Index { unique: true, ..Index::of_collated_ids(collation) };
                self.make_index(ns, collection, &ids)?;
            }
            Ok(true)
        })
    }

    /// How strings compare in an operation: as it says itself, else as in its collection.
    pub(super) fn collation(
        &self,
        collection: Option<Collection>,
        modifiers: &Modifiers,
    ) -> Result<Option<Collation>, StoreError> {
        match (&modifiers.collation, collection) {
            (Some(own), _) => Ok(Some(own.clone())),
            (None, None) => Ok(None),
            (None, Some(collection)) => {
                let indexes = self.indexes_of(collection)?;
                Ok(of_ids(&indexes).and_then(|ids| ids.pattern.collation().cloned()))
            }
        }
    }

    pub(super) fn make_index(&self, ns: &Namespace, collection: Collection, index: &Index) -> Result<(), StoreError> {
        let definition = RawDocumentBuf::try_from(&index.definition()).map_err(QueryError::from)?;
        self.connection
            .prepare_cached("INSERT INTO indexes (collection, name, definition) VALUES (?, ?, ?)")
            .and_then(|mut insert| insert.execute(params![collection.id, index.name, definition.as_bytes()]))
            .map_err(|e| self.explain(&e))?;
        let made = Indexed::new(self.connection.last_insert_rowid(), index.clone(), 0, true)?;
        if made.is_kept() {
            let sql = format!(
                "CREATE TABLE {} (key BLOB NOT NULL, position INTEGER NOT NULL, seal INTEGER, PRIMARY KEY (key, position)) \
                 STRICT, WITHOUT ROWID",
                made.table()
            );
            self.connection.execute_batch(&sql).map_err(|e| self.explain(&e))?;
        }
        self.fill(ns, collection, &made)?;
        self.catalog_cache.advance(&self.connection, collection).map_err(|e| self.explain(&e))?;
        let collection = collection.reread(&self.connection).map_err(|e| self.explain(&e))?;
        let indexes = Arc::new(self.load(collection)?);
        self.indexes.set(collection, &indexes);
        Ok(())
    }

    /// Notes the keys of all documents that are there.
    pub(super) fn fill(&self, ns: &Namespace, collection: Collection, index: &Indexed) -> Result<(), StoreError> {
        let sql = format!("SELECT position, body FROM {} ORDER BY position", collection.table());
        let mut statement = self.connection.prepare_cached(&sql).map_err(|e| self.explain(&e))?;
        let mut rows = statement.query([]).map_err(|e| self.explain(&e))?;
        while let Some(row) = rows.next().map_err(|e| self.explain(&e))? {
            check_ending()?;
            let position: i64 = row.get(0).map_err(|e| self.explain(&e))?;
            let bytes = row.get_ref(1).and_then(|column| Ok(column.as_blob()?)).map_err(|e| self.explain(&e))?;
            let body =
                body::open(bytes).map_err(|damage| self.damaged(collection, body::name(bytes).as_deref(), damage))?;
            let entries = index.entries(body)?;
            if index.definition.unique {
                self.check_unique(ns, index, body, &entries, Some(position))?;
            }
            self.add_entries(collection, std::slice::from_ref(index), position, std::slice::from_ref(&entries))?;
        }
        Ok(())
    }

    /// Removes an index; returns whether it was there.
    pub(super) fn discard(&self, ns: &Namespace, name: &str) -> Result<bool, StoreError> {
        check_droppable(name)?;
        self.write(|| {
            let Some(collection) = self.collection(ns)? else { return Ok(false) };
            let indexes = self.indexes_of(collection)?;
            let Some(index) = indexes.iter().find(|index| index.definition.name == name) else { return Ok(false) };
            self.forget_index(index)?;
            self.catalog_cache.advance(&self.connection, collection).map_err(|e| self.explain(&e))?;
            Ok(true)
        })
    }

    /// Changes an index, whose keys stay as they are; returns whether it is there.
    pub(super) fn change_index(&self, ns: &Namespace, name: &str, change: IndexChange) -> Result<bool, StoreError> {
        check_modifiable(name, change)?;
        self.write(|| {
            let Some(collection) = self.collection(ns)? else { return Ok(false) };
            let indexes = self.indexes_of(collection)?;
            let Some(index) = indexes.iter().find(|index| index.definition.name == name) else { return Ok(false) };
            let definition = index.definition.clone().changed(change);
            if change.expire_after.is_some() {
                check(&definition)?;
            }
            let definition = RawDocumentBuf::try_from(&definition.definition()).map_err(QueryError::from)?;
            self.connection
                .execute("UPDATE indexes SET definition = ? WHERE id = ?", params![definition.as_bytes(), index.id])
                .and_then(|_| self.catalog_cache.advance(&self.connection, collection))
                .map_err(|e| self.explain(&e))?;
            Ok(true)
        })
    }

    /// Removes all indexes of a collection, whose documents are going to be removed too.
    pub(super) fn forget_indexes(&self, collection: Collection) -> Result<(), StoreError> {
        self.indexes_of(collection)?.iter().try_for_each(|index| self.forget_index(index))
    }

    fn forget_index(&self, index: &Indexed) -> Result<(), StoreError> {
        let forget = || {
            self.connection.prepare_cached("DELETE FROM indexes WHERE id = ?")?.execute([index.id])?;
            match index.is_kept() {
                true => self.connection.execute_batch(&format!("DROP TABLE {}", index.table())),
                false => Ok(()),
            }
        };
        forget().map_err(|e| self.explain(&e))
    }

    /// All indexes of a collection, that on `_id` first.
    pub(super) fn list_indexes(&self, ns: &Namespace) -> Result<Vec<Index>, StoreError> {
        let Some(collection) = self.collection(ns)? else { return Ok(Vec::new()) };
        let indexes = self.indexes_of(collection)?;
        let others = indexes.iter().filter(|index| !index.is_of_ids()).map(|index| index.definition.clone());
        Ok([ids(&indexes)].into_iter().chain(others).collect())
    }
}

/// Whether a document may have a date from which on it is invisible.
fn may_decay(body: &RawDocument) -> bool {
    match body.get(metadata::INFO) {
        Ok(Some(RawBsonRef::Document(info))) => matches!(info.get(metadata::DECAY), Ok(Some(_))),
        Ok(Some(RawBsonRef::Array(_))) => true,
        _ => false,
    }
}

/// Refuses keys that are none, and what only a server can keep.
pub(super) fn check(index: &Index) -> Result<(), QueryError> {
    let pattern = Pattern::parse_with(&index.keys, &index.other)?;
    if pattern.is_wildcard() && (index.unique || index.sparse || index.expire_after.is_some()) {
        let message = "a wildcard index is neither unique nor sparse, and no document expires by it";
        return Err(QueryError::invalid(CANNOT_CREATE, message));
    }
    if pattern.is_hashed() && index.unique {
        return Err(QueryError::invalid(UNIQUE_HASHED, "an index with a hashed key cannot be unique"));
    }
    if index.name.is_empty() {
        return Err(QueryError::invalid(CANNOT_CREATE, "the name of an index cannot be empty"));
    }
    let known = |option: &str| OPTIONS.contains(&option) || pattern.text().is_some() && text::OPTIONS.contains(&option);
    if let Some(option) = index.other.keys().find(|option| !known(option)) {
        let mut refusal = QueryError::unsupported(option);
        refusal.message = format!("the option `{option}` of an index is not supported by the embedded store");
        return Err(refusal);
    }
    check_partial(index)?;
    if index.expire_after.is_some() && index.keys.len() != 1 {
        return Err(QueryError::invalid(67, "an index by which documents expire has one key"));
    }
    let is_plain = match index.collation() {
        // Whether it is that of the collection is found out where it is made.
        Some(collation) => index.is_like(&Index::of_collated_ids(&collation)),
        None => index.clone().inheriting(None).is_like(&Index::of_ids()),
    };
    let is_plain = is_plain && index.expire_after.is_none();
    if index.keys.len() == 1 && index.keys.contains_key("_id") && !is_plain {
        let message = "the index on _id is there already, and takes no options";
        return Err(QueryError::invalid(INVALID, message));
    }
    Ok(())
}

/// An index as it is kept: MongoDB keeps a text index with other keys than it is given.
fn stored(index: &Index) -> Result<Index, QueryError> {
    check(index)?;
    match Pattern::parse_with(&index.keys, &index.other)?.text() {
        None => Ok(index.clone()),
        Some(text) => {
            let (keys, other) = text.stored(&index.other);
            Ok(Index { keys, other, ..index.clone() })
        }
    }
}

/// Refuses a partial filter that MongoDB refuses, and `hidden` that is neither true nor false.
fn check_partial(index: &Index) -> Result<(), QueryError> {
    if index.other.get(index::HIDDEN).is_some_and(|hidden| hidden.as_bool().is_none()) {
        return Err(QueryError::type_mismatch("`hidden` of an index is true or false"));
    }
    let Some(partial) = index.other.get(PARTIAL) else { return Ok(()) };
    let Bson::Document(partial) = partial else {
        return Err(QueryError::type_mismatch("the partialFilterExpression of an index must be an object"));
    };
    if index.sparse {
        return Err(QueryError::invalid(CANNOT_CREATE, "an index is either sparse or partial"));
    }
    Filter::parse(partial)?;
    check_plain(partial)
}

/// Refuses conditions that a partial index cannot have.
fn check_plain(filter: &Document) -> Result<(), QueryError> {
    const PLAIN: [&str; 13] = [
        "$and",
        "$or",
        "$eq",
        "$gt",
        "$gte",
        "$lt",
        "$lte",
        "$in",
        "$all",
        "$exists",
        "$type",
        "$geoIntersects",
        "$geoWithin",
    ];
    let is_false = |value: &Bson| matches!(value, Bson::Boolean(false) | Bson::Null | Bson::Int32(0) | Bson::Int64(0));
    for (name, value) in filter {
        if name.starts_with('$') && !PLAIN.contains(&name.as_str()) || name == "$exists" && is_false(value) {
            let message = format!("the partialFilterExpression of an index cannot have {name}: {value}");
            return Err(QueryError::invalid(CANNOT_CREATE, message).about(name));
        }
        let inner: Vec<&Document> = match value {
            // What is in these is a place.
            Bson::Document(_) if matches!(name.as_str(), "$geoIntersects" | "$geoWithin") => Vec::new(),
            Bson::Document(inner) if is_operators(inner) => vec![inner],
            Bson::Array(items) if matches!(name.as_str(), "$and" | "$or") => {
                items.iter().filter_map(Bson::as_document).collect()
            }
            _ => Vec::new(),
        };
        inner.into_iter().try_for_each(check_plain)?;
    }
    Ok(())
}

fn is_operators(document: &Document) -> bool {
    document.keys().next().is_some_and(|name| name.starts_with('$'))
}

/// Refuses to drop what has to stay.
fn check_droppable(name: &str) -> Result<(), QueryError> {
    if name == index::ID {
        return Err(QueryError::invalid(INVALID, "the index on _id cannot be dropped"));
    }
    if name == index::DECAY {
        return Err(QueryError::invalid(INVALID, format!("{name} is rmem's: by it what has decayed is found")));
    }
    Ok(())
}

/// Refuses to hide what has to be used, or to have documents removed by it.
fn check_modifiable(name: &str, change: IndexChange) -> Result<(), QueryError> {
    match name {
        index::ID if change.hidden.is_some() => Err(QueryError::bad_value("the index on _id cannot be hidden")),
        index::ID => Err(QueryError::invalid(INVALID, "no document expires by the index on _id")),
        index::DECAY => Err(QueryError::invalid(INVALID, format!("{name} is rmem's: by it what has decayed is found"))),
        _ => Ok(()),
    }
}

/// The index on `_id`, as it is listed.
fn ids(indexes: &[Indexed]) -> Index {
    match of_ids(indexes) {
        Some(index) => Index { unique: false, ..index.definition.clone() },
        None => Index::of_ids(),
    }
}

/// Whether the index is there already.
///
/// # Errors
/// Where one is there that only differs in its name or in its options.
fn conflict(wanted: &Index, present: &[Indexed]) -> Result<bool, QueryError> {
    let ids = ids(present);
    let others = present.iter().filter(|index| !index.is_of_ids()).map(|index| &index.definition);
    let mut all = others.chain([&ids]);
    if wanted.is_like(&ids) {
        return Ok(true);
    }
    if wanted.has_keys(&ids.keys) {
        return Err(QueryError::bad_value("the index on _id must have the collation of its collection"));
    }
    if let Some(same) = all.clone().find(|index| index.name == wanted.name) {
        return match same.is_same(wanted) {
            true => Ok(true),
            false => Err(QueryError::invalid(
                if same.is_like(wanted) { OPTIONS_CONFLICT } else { KEYS_CONFLICT },
                format!(
                    "there is another index called {}: {}; drop it first, or give another name",
                    wanted.name,
                    same.definition()
                ),
            )),
        };
    }
    // Whatever it searches, a collection has one text index.
    let both = |index: &Index| [index, wanted].iter().all(|index| index.keys.values().any(text::is_key));
    match all.find(|index| index.is_like(wanted) || both(index)) {
        None => Ok(false),
        Some(same) => {
            let message = match both(same) {
                true => format!("a collection has one text index; {} is there: {}", same.name, same.definition()),
                false => format!("the index is there already, as {}", same.definition()),
            };
            Err(QueryError::invalid(OPTIONS_CONFLICT, message))
        }
    }
}

fn taken_key(ns: &Namespace, index: &Indexed, body: &RawDocument, key: &[u8]) -> StoreError {
    let values = index.pattern.values(body, key);
    let key = match index.is_of_ids() {
        true => TakenKey::on(values),
        false => TakenKey::of_index(&index.definition.name, values),
    };
    StoreError::Duplicate { namespace: ns.clone(), key, stored: Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::{Store as _, UpdateRequest, UpdateSpec};
    use bson::doc;

    /// Keys with the positions of documents.
    type Rows = Vec<(Vec<u8>, i64)>;

    /// What is in the tables of all indexes, by name.
    fn tables(store: &Embedded, ns: &Namespace) -> Vec<(String, Rows)> {
        let collection = store.collection(ns).unwrap().unwrap();
        let indexes = store.load_indexes(collection).unwrap();
        let rows = |index: &Indexed| {
            let sql = format!("SELECT key, position FROM {}", index.table());
            let mut statement = store.connection.prepare(&sql).unwrap();
            let rows = statement.query_map([], |row| Ok((row.get(0)?, row.get(1)?))).unwrap();
            rows.collect::<Result<Vec<_>, _>>().unwrap()
        };
        indexes.iter().map(|index| (index.definition.name.clone(), rows(index))).collect()
    }

    fn update(filter: Document, update: Document) -> UpdateRequest {
        let update = UpdateSpec::Document(update);
        UpdateRequest { filter, update, many: true, upsert: true, ..UpdateRequest::default() }
    }

    #[test]
    fn every_kind_of_write_keeps_the_keys_exact() {
        let store = Embedded::in_memory().unwrap();
        let (ns, other) = (Namespace::parse("a.b").unwrap(), Namespace::parse("a.c").unwrap());
        let wanted = [
            Index::on(doc! { "n": 1 }),
            Index::on(doc! { "tags": -1, "n": 1 }),
            Index { sparse: true, ..Index::on(doc! { "at.x": 1 }) },
        ];
        for index in &wanted {
            store.create_index(&ns, index).unwrap();
        }
        let soon = bson::DateTime::from_millis(i64::MAX);
        let documents = (0..20).map(|n| doc! { "_id": n, "n": n % 4, "tags": [n % 3, n % 2], "at": { "x": n } });
        store.insert(&ns, documents.collect()).unwrap();
        let decaying = doc! { "_id": 50, "_robmem_info": { "decay_time": soon } };
        store.put(&ns, vec![doc! { "_id": 3, "n": 9 }, decaying], None).unwrap();
        store
            .update(&ns, &update(doc! { "n": 1 }, doc! { "$push": { "tags": "new" }, "$unset": { "at": 1 } }), None)
            .unwrap();
        store.update(&ns, &update(doc! { "_id": 99 }, doc! { "$set": { "n": 7 } }), None).unwrap();
        store.delete(&ns, (&doc! { "tags": 2 }).into(), false).unwrap();
        store.delete(&ns, (&doc! {}).into(), true).unwrap();
        store.insert(&other, vec![doc! { "_id": 5, "n": 70 }, doc! { "_id": 77, "tags": [] }]).unwrap();
        let merge = [doc! { "$merge": { "into": "b", "whenMatched": "replace" } }];
        store.aggregate(&other, (&merge).into()).unwrap().for_each(drop);
        assert!(store.insert(&ns, vec![doc! { "_id": 5 }]).is_err());
        let kept = tables(&store, &ns);
        assert_eq!(kept.len(), 4, "three were made, and one by the document that decays");
        assert!(kept.iter().all(|(_, rows)| !rows.is_empty()));
        for index in &wanted {
            store.drop_index(&ns, &index.name).unwrap();
            store.create_index(&ns, index).unwrap();
        }
        let mut made_anew = tables(&store, &ns);
        made_anew.rotate_left(1);
        for ((name, kept), (_, anew)) in kept.iter().zip(&made_anew) {
            assert_eq!(kept, anew, "{name}");
        }
        let out = [doc! { "$out": "b" }];
        store.aggregate(&other, (&out).into()).unwrap().for_each(drop);
        assert_eq!(tables(&store, &ns).iter().map(|(_, rows)| rows.len()).collect::<Vec<_>>(), [0, 2, 2, 0]);
    }
}
