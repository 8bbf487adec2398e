//! Changing documents: update, upsert, replace by `_id`, delete.

use std::sync::Arc;

use bson::{Bson, DateTime, Document, RawDocument, RawDocumentBuf};
use rusqlite::{OptionalExtension as _, params};

use super::answer::with_variables;
use super::catalog::Collection;
use super::change_log::Noted;
use super::indexed::{Indexed, of_ids};
use super::keys::Keys;
use super::scan::Found;
use super::slices::Selection;
use super::{Embedded, body as stored, failure};
use crate::query::{Filter, QueryError, Update, check_upsert, constants, key};
use crate::store::{ChangeKind, Namespace, Put, Query, StoreError, UpdateRequest, Updated, document, metadata};

/// MongoDB's code for an attempt to change an `_id`.
const IMMUTABLE_FIELD: i32 = 66;

impl Embedded {
    /// Applies an update, in slices; where one document cannot be changed, those before it stay changed.
    pub(super) fn change(
        &self,
        ns: &Namespace,
        request: &UpdateRequest,
        timestamp: Option<DateTime>,
    ) -> Result<Updated, StoreError> {
        let constants = constants(&request.modifiers.variables)?;
        let change = Change::parse(request, timestamp, &constants)?;
        if request.upsert {
            check_upsert(&request.filter)?;
        }
        self.bind_search(ns, &change.filter)?;
        // The scan may simplify its own filter.
        let mut filter = Arc::new(Filter::parse_with_constants(&request.filter, &constants)?);
        let mut upserted = None;
        let most = if request.many { u64::MAX } else { 1 };
        let met = self.each_match(
            ns,
            &mut filter,
            // What rmem keeps for itself may be asked for after its time.
            Selection { most, hint: request.modifiers.hint.as_ref(), is_sweeping: !ns.is_own() },
            &mut |collection, found| Ok(self.change_one(ns, collection, found, &change)?.is_some()),
            &mut || {
                if request.upsert {
                    upserted = Some(self.upsert(ns, &request.filter, &change)?.0);
                }
                Ok(())
            },
        )?;
        Ok(Updated { matched: met.matched, modified: met.changed, upserted })
    }

    /// Applies an update to a document; returns it as it is afterwards, where it is different. In a write transaction only.
    pub(super) fn change_one(
        &self,
        ns: &Namespace,
        collection: Collection,
        found: &Found,
        change: &Change,
    ) -> Result<Option<RawDocumentBuf>, StoreError> {
        let Some(body) = change.apply(&found.body)? else { return Ok(None) };
        document::vet(&body)?;
        if id_key(&body)? != id_key(&found.body)? {
            return Err(QueryError::invalid(IMMUTABLE_FIELD, "the _id of a document cannot change").into());
        }
        self.rewrite(ns, collection, found, &body, change.kind())?;
        Ok(Some(body))
    }

    /// Inserts what a filter that nothing matches and an update describe; returns its `_id`, and it. In a write transaction
    /// only.
    pub(super) fn upsert(
        &self,
        ns: &Namespace,
        filter: &Document,
        change: &Change,
    ) -> Result<(Bson, RawDocumentBuf), StoreError> {
        let mut body = change.update.upsert(filter, change.now)?;
        if let Some(at) = change.timestamp {
            body = metadata::upsert(&body, at)?;
        }
        let id = document::vet(&body)?;
        let collection = self.ensure(ns)?;
        self.add(ns, collection, &id, &body)?;
        Ok((id, body))
    }

    /// Stores documents in one transaction, each in place of the one with its `_id`.
    pub(super) fn put_all(
        &self,
        ns: &Namespace,
        documents: Vec<Document>,
        timestamp: Option<DateTime>,
    ) -> Result<Put, StoreError> {
        if documents.is_empty() {
            return Ok(Put::default());
        }
        self.write(|| {
            let collection = self.ensure(ns)?;
            if !ns.is_own() {
                self.sweep(ns, collection)?;
            }
            let mut done = Put::default();
            for document in documents {
                self.put_one(ns, collection, document, timestamp, &mut done)?;
            }
            Ok(done)
        })
    }

    fn put_one(
        &self,
        ns: &Namespace,
        collection: Collection,
        mut document: Document,
        timestamp: Option<DateTime>,
        done: &mut Put,
    ) -> Result<(), StoreError> {
        let Some(found) = self.with_id_of(collection, &document)? else {
            if let Some(at) = timestamp {
                metadata::insert(&mut document, at)?;
            }
            let (id, body) = document::settle(document)?;
            done.inserted += 1;
            return self.add(ns, collection, &id, &body);
        };
        let (_, body) = document::settle(document)?;
        match settle_change(&found.body, body, true, timestamp)? {
            Some(body) => {
                done.replaced += 1;
                self.rewrite(ns, collection, &found, &body, ChangeKind::Replace)
            }
            None => {
                done.same += 1;
                Ok(())
            }
        }
    }

    /// The document at a position where one was found in the same transaction.
    pub(super) fn at(&self, collection: Collection, position: i64) -> Result<Found, StoreError> {
        let sql = format!("SELECT body FROM {} WHERE position = ?", collection.table());
        let read = self.connection.prepare_cached(&sql);
        let bytes: Vec<u8> = read
            .and_then(|mut statement| statement.query_row([position], |row| row.get(0)))
            .map_err(|e| self.explain(&e))?;
        Ok(Found { position, body: self.opened(collection, &bytes)? })
    }

    /// The stored document with the `_id` of `document`.
    pub(super) fn with_id_of(&self, collection: Collection, document: &Document) -> Result<Option<Found>, StoreError> {
        let Some(id) = document.get("_id") else { return Ok(None) };
        if let Some(index) = of_ids(&self.indexes_of(collection)?) {
            return self.with_key_of(collection, index, document);
        }
        let (keys, key) = (Keys::of_documents(collection), key::encode_value(id));
        let sql = format!("SELECT position, body FROM {} WHERE key = ?", keys.table);
        let row = self
            .connection
            .prepare_cached(&sql)
            .and_then(|mut statement| {
                let row = |row: &rusqlite::Row<'_>| Ok((row.get(0)?, row.get::<_, Vec<u8>>(1)?));
                statement.query_row([&key], row).optional()
            })
            .map_err(|e| self.explain(&e))?;
        let Some((position, bytes)) = row else {
            keys.check_around(&self.connection, &key).map_err(|e| self.explain(&e))?;
            return Ok(None);
        };
        Ok(Some(Found { position, body: self.opened(collection, &bytes)? }))
    }

    /// The stored document that has a key of `document` in a unique index.
    pub(super) fn with_key_of(
        &self,
        collection: Collection,
        index: &Indexed,
        document: &Document,
    ) -> Result<Option<Found>, StoreError> {
        let entries = index.entries(&RawDocumentBuf::try_from(document).map_err(QueryError::from)?)?;
        let (documents, keys) = (collection.table(), index.keys());
        let sql = format!(
            "SELECT {0}.key, {0}.position, {1}, body FROM {0} LEFT JOIN {documents} ON {documents}.position = {0}.position \
             WHERE {0}.key = ? LIMIT 1",
            keys.table,
            keys.proof(&keys.table)
        );
        for key in &entries.keys {
            let row = self.connection.prepare_cached(&sql).and_then(|mut statement| {
                let row = |row: &rusqlite::Row<'_>| Ok((Keys::position(row, 2)?, row.get::<_, Option<Vec<u8>>>(3)?));
                statement.query_row([key], row).optional()
            });
            if let Some((position, bytes)) = row.map_err(|e| self.explain(&e))? {
                let bytes = bytes.ok_or_else(|| self.explain(&failure::no_document()))?;
                return Ok(Some(Found { position, body: self.opened(collection, &bytes)? }));
            }
            keys.check_around(&self.connection, key).map_err(|e| self.explain(&e))?;
        }
        Ok(None)
    }

    /// Stores `body` in place of what was found. In a write transaction only.
    pub(super) fn rewrite(
        &self,
        ns: &Namespace,
        collection: Collection,
        found: &Found,
        body: &RawDocument,
        kind: ChangeKind,
    ) -> Result<(), StoreError> {
        let indexes = self.expect_decay(ns, collection, self.indexes_of(collection)?, body)?;
        self.check_valid(ns, &indexes, body, Some(&found.body))?;
        let entries = self.entries(ns, &indexes, body, Some(found.position))?;
        let sql = format!("UPDATE {} SET body = ? WHERE position = ?", collection.table());
        self.connection
            .prepare_cached(&sql)
            .and_then(|mut statement| statement.execute(params![stored::seal(body), found.position]))
            .map_err(|e| self.explain(&e))?;
        self.change_entries(collection, &indexes, found.position, &found.body, &entries)?;
        self.note(ns, Noted::change(kind, &found.body, body, found.position))
    }

    /// Removes a document. In a write transaction only.
    pub(super) fn erase(&self, ns: &Namespace, collection: Collection, found: &Found) -> Result<(), StoreError> {
        let sql = format!("DELETE FROM {} WHERE position = ?", collection.table());
        self.connection
            .prepare_cached(&sql)
            .and_then(|mut statement| statement.execute([found.position]))
            .map_err(|e| self.explain(&e))?;
        self.remove_entries(&self.indexes_of(collection)?, found.position, &found.body)?;
        self.note(ns, Noted::delete(&found.body, found.position))
    }

    pub(super) fn remove(&self, ns: &Namespace, query: Query<'_>, first_only: bool) -> Result<u64, StoreError> {
        let mut filter = Arc::new(with_variables(query.filter, query.modifiers)?);
        let most = if first_only { 1 } else { u64::MAX };
        let erase = &mut |collection, found: &Found| self.erase(ns, collection, found).map(|()| true);
        let selection = Selection { most, hint: query.modifiers.hint.as_ref(), is_sweeping: false };
        Ok(self.each_match(ns, &mut filter, selection, erase, &mut || Ok(()))?.matched)
    }
}

/// A parsed update request.
pub(super) struct Change {
    /// By which a document matched, where the update looks at that; else an empty one.
    filter: Filter,
    update: Update,
    now: DateTime,
    timestamp: Option<DateTime>,
}

impl Change {
    pub(super) fn parse(
        request: &UpdateRequest,
        timestamp: Option<DateTime>,
        constants: &Document,
    ) -> Result<Self, QueryError> {
        if timestamp.is_some() {
            metadata::check_update(&request.update)?;
        }
        let update = request.update.compile(&request.array_filters, constants)?;
        if request.many && update.is_replacement() {
            return Err(QueryError::failed_to_parse("a replacement document cannot be applied to many documents"));
        }
        let none = Document::new();
        let filter = if update.is_positional() { &request.filter } else { &none };
        let filter = Filter::parse_with_constants(filter, constants)?;
        Ok(Self { filter, update, now: timestamp.unwrap_or_else(DateTime::now), timestamp })
    }

    /// By which a document matched, where the update looks at that.
    pub(super) fn filter(&self) -> &Filter {
        &self.filter
    }

    /// The kind of change, for watchers.
    fn kind(&self) -> ChangeKind {
        if self.update.is_replacement() { ChangeKind::Replace } else { ChangeKind::Update }
    }

    fn apply(&self, old: &RawDocument) -> Result<Option<RawDocumentBuf>, QueryError> {
        match self.update.apply(old, &self.filter, self.now)? {
            None => Ok(None),
            Some(new) => match self.timestamp {
                Some(at) => metadata::update(old, &new, self.update.is_replacement(), at),
                None => Ok(Some(new)),
            },
        }
    }
}

/// What is stored in place of `old`, where it is different.
fn settle_change(
    old: &RawDocument,
    new: RawDocumentBuf,
    replacement: bool,
    timestamp: Option<DateTime>,
) -> Result<Option<RawDocumentBuf>, QueryError> {
    match timestamp {
        Some(at) => metadata::update(old, &new, replacement, at),
        None => Ok(Some(new).filter(|new| new.as_bytes() != old.as_bytes())),
    }
}

fn id_key(document: &RawDocument) -> Result<Option<Vec<u8>>, QueryError> {
    Ok(document.get("_id")?.map(key::encode))
}
