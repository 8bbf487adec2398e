//! `$out` and `$merge`: the results of a pipeline into a collection.
//!
//! `$merge` changes one document after the other where it is not a part of a transaction, as on MongoDB, which sends them to
//! itself in unordered batches: where it fails at one, the others of its batch are changed all the same, and none behind them;
//! a result without a value to merge on is found before any is changed. `$out` takes the place of the collection at the end
//! ([`super::staged`]); where it fails, nothing is changed.

use std::cell::Cell;
use std::sync::Arc;

use bson::{Bson, DateTime, Document, RawBsonRef, RawDocument, RawDocumentBuf, doc};

use super::Embedded;
use super::catalog::Collection;
use super::indexed::Indexed;
use super::scan::Found;
use super::slices::Slice;
use crate::interrupt::InterruptGuard;
use crate::query::{Filter, Merge, Origin, Output, QueryError, Update, WhenMatched, WhenNotMatched, key};
use crate::store::{ChangeKind, Namespace, StoreError, TakenKey, document};

/// MongoDB's code where `$merge` finds no unique index on the fields of `on`.
const NO_UNIQUE_INDEX: i32 = 51_183;
/// MongoDB's code where `$merge` finds no document and is to fail then.
const NO_MATCH: i32 = 13_113;

/// How many documents MongoDB sends to itself at once …
const BATCH: u64 = 100_000;
/// … and how many bytes of them.
const BATCH_SIZE: usize = 16 << 20;

/// The code of a document without a value to merge on.
const MISSING_ON: i32 = 51_132;
/// The code of a document with an array there.
const ARRAY_ON: i32 = 51_185;
/// The code of an attempt to change an `_id`.
const IMMUTABLE_FIELD: i32 = 66;

/// The results of a pipeline.
pub(super) type Results<'a> = &'a mut dyn Iterator<Item = Result<RawDocumentBuf, StoreError>>;

/// The collection that a pipeline over `ns` names.
pub(super) fn named(origin: &Origin, ns: &Namespace) -> Namespace {
    let database = origin.database.as_ref().unwrap_or(&ns.database);
    Namespace { database: database.clone(), collection: origin.collection.clone() }
}

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
            Output::Merge(merge) => self.merge(&named(&merge.into, ns), merge, results, now),
        }
    }

    /// Removes all documents of a collection; its indexes stay, as MongoDB has it.
    pub(super) fn clear(&self, collection: Collection) -> Result<(), StoreError> {
        let indexes = self.indexes_of(collection)?;
        let tables = indexes.iter().filter(|index| index.is_kept()).map(|index| index.table());
        for table in tables.chain([collection.table()]) {
            let cleared = self.connection.execute(&format!("DELETE FROM {table}"), []);
            cleared.map_err(|e| self.explain(&e))?;
        }
        Ok(())
    }

    /// Checks that there is a unique index on the fields that results of a pipeline over `ns` are merged on.
    pub(super) fn check_mergeable(&self, ns: &Namespace, merge: &Merge) -> Result<(), StoreError> {
        let collection = self.collection(&named(&merge.into, ns))?;
        let indexes = collection.map(|collection| self.indexes_of(collection)).transpose()?;
        unique_on(indexes.as_ref().map_or(&[], |defined| defined), merge)?;
        Ok(())
    }

    /// Merges results into a collection, in slices that let other processes write in between.
    fn merge(&self, ns: &Namespace, merge: &Merge, results: Results<'_>, now: DateTime) -> Result<(), StoreError> {
        let _guard = InterruptGuard::stopping();
        let (mut is_swept, mut batch, mut first, changed) = (false, Batch::default(), None, Cell::new(0));
        self.in_slices(&changed, &mut |limit| {
            let collection = self.ensure(ns)?;
            if !std::mem::replace(&mut is_swept, true) {
                self.sweep(ns, collection)?;
            }
            let indexes = self.indexes_of(collection)?;
            let target = Target { ns, collection, index: unique_on(&indexes, merge)? };
            for result in &mut *results {
                let result = result?;
                if batch.begins_anew(result.as_bytes().len()) && first.is_some() {
                    break;
                }
                let result = Document::try_from(&*result).map_err(QueryError::from)?;
                match self.merge_one(&target, merge, result, now) {
                    Ok(is_changed) => changed.update(|count| count + u64::from(is_changed)),
                    Err(error) if error.is_of_document() => drop(first.get_or_insert(error)),
                    Err(error) => return Err(error),
                }
                if limit.is_over() {
                    return Ok(Slice::More);
                }
            }
            Ok(first.take().map_or(Slice::Last, Slice::Failed))
        })
    }

    /// The document that a result belongs to.
    fn found_for(&self, target: &Target<'_>, result: &Document) -> Result<Option<Found>, StoreError> {
        match target.index {
            Some(index) => self.with_key_of(target.collection, index, result),
            None => self.with_id_of(target.collection, result),
        }
    }

    /// Merges a result; says whether that changed something.
    fn merge_one(
        &self,
        target: &Target<'_>,
        merge: &Merge,
        result: Document,
        now: DateTime,
    ) -> Result<bool, StoreError> {
        let &Target { ns, collection, .. } = target;
        let values = on_values(merge, &result)?;
        let has_id = result.contains_key("_id");
        let (id, body) = document::settle(result)?;
        let mut result = Document::try_from(&*body).map_err(QueryError::from)?;
        let values = if values.is_empty() {
            doc! { "_id": &id }
        } else {
            values
        };
        let Some(found) = self.found_for(target, &result)? else {
            return match merge.when_not_matched {
                WhenNotMatched::Insert => {
                    self.add(ns, collection, &id, &made(merge, &id, &result, body)?).map(|()| true)
                }
                WhenNotMatched::Discard => Ok(false),
                WhenNotMatched::Fail => {
                    let values = TakenKey::on(values);
                    Err(QueryError::invalid(NO_MATCH, format!("$merge found no document with {values} in {ns}"))
                        .about("$merge")
                        .into())
                }
            };
        };
        if !has_id {
            // It is a new one's, which was not needed.
            result.remove("_id");
        }
        let update = match &merge.when_matched {
            WhenMatched::KeepExisting => return Ok(false),
            WhenMatched::Fail => {
                let key = match target.index {
                    Some(index) => TakenKey::of_index(&index.definition.name, values),
                    None => TakenKey::on(values),
                };
                return Err(StoreError::Duplicate { namespace: ns.clone(), key, stored: Vec::new() });
            }
            WhenMatched::Replace => Update::parse(&result, &[])?,
            WhenMatched::Merge => Update::parse(&bson::doc! { "$set": result }, &[])?,
            WhenMatched::Pipeline(stages) => Update::parse_pipeline_with(stages, &merge.constants(&result, now)?)?,
        };
        let filter = Arc::new(Filter::parse(&bson::doc! { "_id": { "$eq": id_of(&found.body)? } })?);
        let Some(changed) = update.apply(&found.body, &filter, now)? else { return Ok(false) };
        let mut changed = Document::try_from(&*changed).map_err(QueryError::from)?;
        document::fill_timestamps(&mut changed);
        let changed = RawDocumentBuf::try_from(&changed).map_err(QueryError::from)?;
        document::vet(&changed)?;
        if key::encode_value(&id_of(&changed)?) != key::encode_value(&id_of(&found.body)?) {
            let message = format!("$merge would change the _id of the document with {values} in {ns}");
            return Err(QueryError::invalid(IMMUTABLE_FIELD, message).about("$merge").into());
        }
        let kind = if update.is_replacement() { ChangeKind::Replace } else { ChangeKind::Update };
        self.rewrite(ns, collection, &found, &changed, kind).map(|()| true)
    }
}

/// What MongoDB would send to itself at once.
#[derive(Default)]
struct Batch {
    count: u64,
    bytes: usize,
}

impl Batch {
    /// Adds a document of this size; says whether it is the first of another batch.
    fn begins_anew(&mut self, size: usize) -> bool {
        let is_full = self.count == BATCH || self.bytes + size > BATCH_SIZE;
        if is_full {
            *self = Self::default();
        }
        self.count += 1;
        self.bytes += size;
        is_full
    }
}

/// Where results go.
struct Target<'a> {
    ns: &'a Namespace,
    collection: Collection,
    /// The unique index on the fields of `on`; none where that is `_id`.
    index: Option<&'a Indexed>,
}

/// The unique index on the fields that a merge is on; none for `_id`.
fn unique_on<'a>(indexes: &'a [Indexed], merge: &Merge) -> Result<Option<&'a Indexed>, QueryError> {
    if merge.on == ["_id"] {
        return Ok(None);
    }
    let fits = |index: &&Indexed| {
        let keys = &index.definition.keys;
        index.definition.unique
            && index.is_kept()
            && index.is_whole()
            && index.pattern.is_in_effect()
            && keys.len() == merge.on.len()
            && merge.on.iter().all(|field| keys.contains_key(field))
    };
    indexes.iter().find(fits).map(Some).ok_or_else(|| {
        let fields = merge.on.join(", ");
        let message = format!(
            "$merge on {fields} needs a unique index on exactly these fields, with the collation of the pipeline and for all documents"
        );
        QueryError::invalid(NO_UNIQUE_INDEX, message)
    })
}

/// Checks that a result has the values that it is to be merged on.
pub(super) fn check_merged(merge: &Merge, result: &RawDocument) -> Result<(), QueryError> {
    if merge.on == ["_id"]
        && !matches!(result.get("_id")?, Some(RawBsonRef::Array(_) | RawBsonRef::Null | RawBsonRef::Undefined))
    {
        return Ok(());
    }
    on_values(merge, &Document::try_from(result)?).map(drop)
}

/// The values that a result is merged on, for messages; nothing where that is an `_id` that it does not have yet.
fn on_values(merge: &Merge, result: &Document) -> Result<Document, QueryError> {
    let mut values = Document::new();
    for field in &merge.on {
        let mut steps = field.split('.');
        let mut value = steps.next().and_then(|step| result.get(step));
        for step in steps {
            value = match value {
                Some(Bson::Document(inner)) => inner.get(step),
                Some(array @ Bson::Array(_)) => Some(array),
                _ => None,
            };
        }
        match value {
            None if field == "_id" => {}
            None | Some(Bson::Null | Bson::Undefined) => {
                let message = format!("the field '{field}' that $merge is on cannot be missing or null");
                return Err(QueryError::invalid(MISSING_ON, message).about("$merge"));
            }
            Some(Bson::Array(_)) => {
                let message = format!("the field '{field}' that $merge is on cannot be an array");
                return Err(QueryError::invalid(ARRAY_ON, message).about("$merge"));
            }
            Some(value) => drop(values.insert(field, value)),
        }
    }
    Ok(values)
}

fn id_of(body: &RawDocument) -> Result<Bson, QueryError> {
    let id = body.get("_id")?.map(Bson::try_from).transpose()?;
    Ok(id.unwrap_or(Bson::Null))
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::{Aggregation, Find, Modifiers, Store};

    fn merge(store: &Embedded, options: Document) -> Result<(), StoreError> {
        let mut merge = doc! { "into": "to" };
        merge.extend(options);
        let stages = [doc! { "$merge": merge }];
        store.aggregate(&from(), Aggregation { stages: &stages, modifiers: Modifiers::none() }).map(drop)
    }

    fn from() -> Namespace {
        Namespace::parse("a.from").unwrap()
    }

    fn to() -> Namespace {
        Namespace::parse("a.to").unwrap()
    }

    #[test]
    fn others_write_while_results_are_merged() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.rmem");
        let (store, other) = (Embedded::open(&path).unwrap(), Namespace::parse("a.other").unwrap());
        store.insert(&from(), (0..40_000).map(|n| doc! { "_id": n, "n": n }).collect()).unwrap();
        std::thread::scope(|scope| {
            let merging = scope.spawn(|| merge(&Embedded::open(&path).unwrap(), doc! {}));
            let (mut seen, count) = (0, |ns: &Namespace| store.count(ns, (&doc! {}).into()).unwrap());
            while !merging.is_finished() {
                store.insert(&other, vec![doc! {}]).unwrap();
                seen += u64::from((1..40_000).contains(&count(&to())));
            }
            merging.join().unwrap().unwrap();
            assert!(seen > 0, "an insert was done before the end");
            assert_eq!(count(&to()), 40_000);
        });
    }

    #[test]
    fn results_that_cannot_be_merged_leave_the_others_merged() {
        let store = Embedded::in_memory().unwrap();
        store.insert(&from(), (1..=4).map(|n| doc! { "_id": n, "n": n }).collect()).unwrap();
        store.insert(&to(), vec![doc! { "_id": 2 }]).unwrap();
        let error = merge(&store, doc! { "whenMatched": "fail" }).unwrap_err();
        assert!(
            matches!(&error, StoreError::Partial { done: 3, source } if matches!(**source, StoreError::Duplicate { .. })),
            "{error:?}"
        );
        let ids: Vec<_> =
            store.find(&to(), &Find::default()).unwrap().map(|found| id_of(&found.unwrap()).unwrap()).collect();
        assert_eq!(ids, [2, 1, 3, 4].map(Bson::from));
        // Where none can be, nothing is left behind.
        Store::drop(&store, &to()).unwrap();
        let error = merge(&store, doc! { "whenNotMatched": "fail" }).unwrap_err();
        assert!(matches!(error, StoreError::Query(_)), "{error:?}");
        assert_eq!(store.collections().unwrap(), [from()]);
    }

    #[test]
    fn a_batch_is_full_by_its_size_too() {
        let mut batch = Batch::default();
        let begins: Vec<bool> = [6 << 20, 6 << 20, 6 << 20, 20 << 20].map(|size| batch.begins_anew(size)).into();
        assert_eq!(begins, [false, false, true, true]);
        let mut batch = Batch::default();
        assert_eq!((0..BATCH).filter(|_| batch.begins_anew(10)).count(), 0);
        assert!(batch.begins_anew(10));
    }
}
