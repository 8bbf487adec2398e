//! `$out` and `$merge`: the results of a pipeline into a collection.
//!
//! All of them in one transaction: where one fails, nothing is changed.
//! (MongoDB keeps what `$merge` did before.)

use std::rc::Rc;

use bson::{Bson, DateTime, Document, RawDocumentBuf};

use super::Embedded;
use super::catalog::Collection;
use super::pipeline::named;
use crate::query::{Filter, Merge, Output, QueryError, Update, WhenMatched, WhenNotMatched};
use crate::store::{ChangeKind, Namespace, StoreError, document};

/// MongoDB's code where `$merge` finds no unique index on the fields of `on`.
const NO_UNIQUE_INDEX: i32 = 51_183;
/// MongoDB's code where `$merge` finds no document and is to fail then.
const NO_MATCH: i32 = 13_113;

/// The code of a document without a value to merge on.
const MISSING_ON: i32 = 51_132;

/// The results of a pipeline.
pub(super) type Results<'a> = &'a mut dyn Iterator<Item = Result<RawDocumentBuf, StoreError>>;

impl Embedded {
    /// Writes the results of a pipeline over `ns`.
    pub(super) fn write_results(
        &self,
        ns: &Namespace,
        output: &Output,
        results: Results<'_>,
        now: DateTime,
    ) -> Result<(), StoreError> {
        match output {
            Output::Out(origin) => self.replace_collection(&named(origin, ns), results),
            Output::Merge(merge) if merge.on != ["_id"] => {
                let message = "$merge `on` needs fields with a unique index; here that is _id only";
                Err(QueryError::invalid(NO_UNIQUE_INDEX, message).into())
            }
            Output::Merge(merge) => self.merge(&named(&merge.into, ns), merge, results, now),
        }
    }

    fn replace_collection(&self, ns: &Namespace, results: Results<'_>) -> Result<(), StoreError> {
        self.write(|| {
            let collection = Collection::ensure(&self.connection, ns).map_err(|e| self.explain(&e))?;
            self.note_drop(ns, collection)?;
            self.clear(collection)?;
            for result in results {
                let (id, body) = document::settle(Document::try_from(&*result?).map_err(QueryError::from)?)?;
                self.add(ns, collection, &id, &body)?;
            }
            Ok(())
        })
    }

    /// Removes all documents of a collection; its indexes stay, as MongoDB has it.
    fn clear(&self, collection: Collection) -> Result<(), StoreError> {
        let indexes = self.indexes_of(collection)?;
        let tables = indexes.iter().filter(|index| index.is_kept()).map(|index| index.table());
        for table in tables.chain([collection.table()]) {
            let cleared = self.connection.execute(&format!("DELETE FROM {table}"), []);
            cleared.map_err(|e| self.explain(&e))?;
        }
        Ok(())
    }

    fn merge(&self, ns: &Namespace, merge: &Merge, results: Results<'_>, now: DateTime) -> Result<(), StoreError> {
        self.write(|| {
            let collection = Collection::ensure(&self.connection, ns).map_err(|e| self.explain(&e))?;
            self.sweep(ns, collection)?;
            for result in results {
                let result = Document::try_from(&*result?).map_err(QueryError::from)?;
                self.merge_one(ns, collection, merge, result, now)?;
            }
            Ok(())
        })
    }

    fn merge_one(
        &self,
        ns: &Namespace,
        collection: Collection,
        merge: &Merge,
        result: Document,
        now: DateTime,
    ) -> Result<(), StoreError> {
        if let Some(Bson::Null | Bson::Undefined) = result.get("_id") {
            let message = "the field '_id' that $merge is on cannot be null";
            return Err(QueryError::invalid(MISSING_ON, message).into());
        }
        let (id, body) = document::settle(result)?;
        let result = Document::try_from(&*body).map_err(QueryError::from)?;
        let Some(found) = self.with_id_of(collection, &result)? else {
            return match merge.when_not_matched {
                WhenNotMatched::Insert => self.add(ns, collection, &id, &made(merge, &id, &result, body)?),
                WhenNotMatched::Discard => Ok(()),
                WhenNotMatched::Fail => {
                    Err(QueryError::invalid(NO_MATCH, format!("$merge found no document with _id: {id} in {ns}"))
                        .into())
                }
            };
        };
        let update = match &merge.when_matched {
            WhenMatched::KeepExisting => return Ok(()),
            WhenMatched::Fail => {
                let key = format!("_id: {id}");
                return Err(StoreError::Duplicate { namespace: ns.clone(), key, stored: Vec::new() });
            }
            WhenMatched::Replace => Update::parse(&result, &[])?,
            WhenMatched::Merge => Update::parse(&bson::doc! { "$set": result }, &[])?,
            WhenMatched::Pipeline(stages) => Update::parse_pipeline_with(stages, &merge.constants(&result, now)?)?,
        };
        let filter = Rc::new(Filter::parse(&bson::doc! { "_id": { "$eq": &id } })?);
        let Some(changed) = update.apply(&found.body, &filter, now)? else { return Ok(()) };
        let mut changed = Document::try_from(&*changed).map_err(QueryError::from)?;
        document::fill_timestamps(&mut changed);
        let changed = RawDocumentBuf::try_from(&changed).map_err(QueryError::from)?;
        document::vet(&changed)?;
        let kind = if update.is_replacement() { ChangeKind::Replace } else { ChangeKind::Update };
        self.rewrite(ns, collection, &found, &changed, kind)
    }
}

/// The document that `$merge` inserts: where it would have merged fields, it
/// comes of an upsert of them, which sorts them by name.
fn made(merge: &Merge, id: &Bson, result: &Document, body: RawDocumentBuf) -> Result<RawDocumentBuf, QueryError> {
    if !matches!(merge.when_matched, WhenMatched::Merge | WhenMatched::KeepExisting) {
        return Ok(body);
    }
    let mut fields: Vec<_> = result.iter().filter(|(name, _)| *name != "_id").collect();
    fields.sort_by_key(|(name, _)| *name);
    let mut made = bson::doc! { "_id": id };
    made.extend(fields.into_iter().map(|(name, value)| (name.clone(), value.clone())));
    Ok(RawDocumentBuf::try_from(&made)?)
}
