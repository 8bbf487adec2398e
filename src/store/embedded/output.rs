//! `$out` and `$merge`: the results of a pipeline into a collection.
//!
//! Where one fails, nothing is changed: `$merge` is one transaction (MongoDB keeps what it did before), and `$out`
//! takes the place of the collection at the end ([`super::staged`]).

use std::sync::Arc;

use bson::{Bson, DateTime, Document, RawDocument, RawDocumentBuf, doc};

use super::Embedded;
use super::catalog::Collection;
use super::indexed::Indexed;
use super::pipeline::named;
use super::scan::Found;
use crate::query::{Filter, Merge, Output, QueryError, Update, WhenMatched, WhenNotMatched, key};
use crate::store::{ChangeKind, Namespace, StoreError, TakenKey, document};

/// MongoDB's code where `$merge` finds no unique index on the fields of `on`.
const NO_UNIQUE_INDEX: i32 = 51_183;
/// MongoDB's code where `$merge` finds no document and is to fail then.
const NO_MATCH: i32 = 13_113;

/// The code of a document without a value to merge on.
const MISSING_ON: i32 = 51_132;
/// The code of a document with an array there.
const ARRAY_ON: i32 = 51_185;
/// The code of an attempt to change an `_id`.
const IMMUTABLE_FIELD: i32 = 66;

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

    fn merge(&self, ns: &Namespace, merge: &Merge, results: Results<'_>, now: DateTime) -> Result<(), StoreError> {
        self.write(|| {
            let collection = self.ensure(ns)?;
            self.sweep(ns, collection)?;
            let indexes = self.indexes_of(collection)?;
            let target = Target { ns, collection, index: unique_on(&indexes, merge)? };
            for result in results {
                let result = Document::try_from(&*result?).map_err(QueryError::from)?;
                self.merge_one(&target, merge, result, now)?;
            }
            Ok(())
        })
    }

    /// The document that a result belongs to.
    fn found_for(&self, target: &Target<'_>, result: &Document) -> Result<Option<Found>, StoreError> {
        match target.index {
            Some(index) => self.with_key_of(target.collection, index, result),
            None => self.with_id_of(target.collection, result),
        }
    }

    fn merge_one(&self, target: &Target<'_>, merge: &Merge, result: Document, now: DateTime) -> Result<(), StoreError> {
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
                WhenNotMatched::Insert => self.add(ns, collection, &id, &made(merge, &id, &result, body)?),
                WhenNotMatched::Discard => Ok(()),
                WhenNotMatched::Fail => {
                    let values = TakenKey::on(values);
                    Err(QueryError::invalid(NO_MATCH, format!("$merge found no document with {values} in {ns}")).into())
                }
            };
        };
        if !has_id {
            // It is a new one's, which was not needed.
            result.remove("_id");
        }
        let update = match &merge.when_matched {
            WhenMatched::KeepExisting => return Ok(()),
            WhenMatched::Fail => {
                return Err(StoreError::Duplicate {
                    namespace: ns.clone(),
                    key: TakenKey::on(values),
                    stored: Vec::new(),
                });
            }
            WhenMatched::Replace => Update::parse(&result, &[])?,
            WhenMatched::Merge => Update::parse(&bson::doc! { "$set": result }, &[])?,
            WhenMatched::Pipeline(stages) => Update::parse_pipeline_with(stages, &merge.constants(&result, now)?)?,
        };
        let filter = Arc::new(Filter::parse(&bson::doc! { "_id": { "$eq": id_of(&found.body)? } })?);
        let Some(changed) = update.apply(&found.body, &filter, now)? else { return Ok(()) };
        let mut changed = Document::try_from(&*changed).map_err(QueryError::from)?;
        document::fill_timestamps(&mut changed);
        let changed = RawDocumentBuf::try_from(&changed).map_err(QueryError::from)?;
        document::vet(&changed)?;
        if key::encode_value(&id_of(&changed)?) != key::encode_value(&id_of(&found.body)?) {
            let message = format!("$merge would change the _id of the document with {values} in {ns}");
            return Err(QueryError::invalid(IMMUTABLE_FIELD, message).into());
        }
        let kind = if update.is_replacement() { ChangeKind::Replace } else { ChangeKind::Update };
        self.rewrite(ns, collection, &found, &changed, kind)
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
                return Err(QueryError::invalid(MISSING_ON, message));
            }
            Some(Bson::Array(_)) => {
                let message = format!("the field '{field}' that $merge is on cannot be an array");
                return Err(QueryError::invalid(ARRAY_ON, message));
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
