//! Updates of several documents by a statement each, in one command.
//!
//! A statement changes its document if that is as it was read. The server's answer says how many were changed, and not which,
//! but names the first statement that fails. So each is an upsert, whose insertion fails: it is one where the document is
//! another one meanwhile, or has gone. (Where the collection has gone, the server would make it before: see `identity`.)

use bson::raw::cstr;
use bson::{Bson, Document, RawArrayBuf, RawDocumentBuf, doc, rawdoc};

use super::identity::IS_OTHER;
use super::known::Identity;
use super::named::{beside_ids, has_operator};
use super::unchanged::LARGEST_COMMAND;
use super::{MongoDb, failure};
use crate::query::QueryError;
use crate::store::{Namespace, StoreError, UpdateRequest, UpdateSpec};

/// About how many bytes of statements one command has.
const MOST_BYTES: usize = 8 << 20;
/// The longest filter, in bytes, that each statement has, also where the document is shorter.
const SHORT_FILTER: usize = 1 << 10;

/// Operators of filters that the server does not take for an upsert.
const NOT_FOR_UPSERTS: [&str; 7] = ["$expr", "$where", "$near", "$nearSphere", "$geoNear", "$text", "$sampleRate"];

/// Codes for a command that is too long, or too deeply nested.
const TOO_MUCH: [i32; 2] = [10_334, 15];

/// What the server did of several statements.
pub(super) struct Sent {
    /// How many it did.
    pub(super) done: usize,
    /// Whether the one behind these failed.
    pub(super) has_failed: bool,
    /// Where not as many members confirmed it as were to.
    pub(super) unconfirmed: Option<StoreError>,
}

impl Sent {
    /// Of the statements, none can be done.
    fn nothing() -> Self {
        Self { done: 0, has_failed: true, unconfirmed: None }
    }
}

impl MongoDb {
    /// Sends statements until one fails, or cannot be made, as many as a command has room for; nothing where the collection is
    /// not there.
    pub(super) fn send(
        &self,
        ns: &Namespace,
        request: &UpdateRequest,
        statements: impl Iterator<Item = Result<Option<Document>, QueryError>>,
    ) -> Result<Option<Sent>, StoreError> {
        let (mut sent, mut count, mut bytes) = (RawArrayBuf::new(), 0, 0);
        for statement in statements {
            let Some(statement) = statement? else { break };
            let statement = RawDocumentBuf::try_from(&statement).map_err(QueryError::from)?;
            bytes += statement.as_bytes().len();
            if bytes > if count > 0 { MOST_BYTES } else { LARGEST_COMMAND } {
                break;
            }
            sent.push(statement);
            count += 1;
        }
        if count == 0 {
            return Ok(Some(Sent::nothing()));
        }
        let answer = match self.send_all(ns, request, &sent)? {
            Some(Ok(answer)) => answer,
            Some(Err(error)) if failure::code(&error).is_some_and(|code| TOO_MUCH.contains(&code)) => {
                return Ok(Some(Sent::nothing()));
            }
            Some(Err(error)) => return Err(failure::explain_change(&self.address, ns, &error)),
            None => return Ok(None),
        };
        let done = failed(&answer).map(|(place, _)| place);
        let unconfirmed = self.unconfirmed(ns, &answer);
        Ok(Some(Sent { done: done.unwrap_or(count), has_failed: done.is_some(), unconfirmed }))
    }

    /// The answer to statements for the collection that is there now; nothing where there is none.
    fn send_all(
        &self,
        ns: &Namespace,
        request: &UpdateRequest,
        statements: &RawArrayBuf,
    ) -> Result<Option<mongodb::error::Result<Document>>, StoreError> {
        loop {
            let (identity, is_new) = self.identity(ns)?;
            let more = match identity {
                Identity::Known(id) => rawdoc! { "ordered": true, "collectionUUID": id },
                Identity::Unknown => rawdoc! { "ordered": true },
                Identity::Missing => return Ok(None),
            };
            let variables = &request.modifiers.variables;
            let answer = self.write(ns, (cstr!("update"), cstr!("updates"), statements), &more, variables)?;
            let is_other = answer.as_ref().ok().and_then(failed).is_some_and(|(_, code)| code == IS_OTHER);
            if is_other {
                self.identities.forget(ns);
            }
            if is_new || !is_other || answer.as_ref().ok().and_then(failed).is_some_and(|(place, _)| place > 0) {
                return Ok(Some(answer));
            }
        }
    }
}

/// The place of the first statement that failed, and the code of its failure.
fn failed(answer: &Document) -> Option<(usize, i32)> {
    let first = answer.get_array("writeErrors").ok()?.first()?.as_document()?;
    Some((usize::try_from(first.get_i32("index").ok()?).ok()?, first.get_i32("code").unwrap_or_default()))
}

/// What the statements of an update have in common.
pub(super) struct Statements<'a> {
    request: &'a UpdateRequest,
    /// The update with the date of the change.
    dated: &'a UpdateSpec,
    /// The fields that the update touches; none where it is a pipeline, or they cannot be asked for.
    touched: Option<Vec<String>>,
    /// What the filter asks for beside the `_id`.
    filter: Document,
    /// How many bytes that has; nothing where no statement can have it.
    length: Option<usize>,
    is_positional: bool,
}

impl<'a> Statements<'a> {
    pub(super) fn new(
        request: &'a UpdateRequest,
        plain: &UpdateSpec,
        dated: &'a UpdateSpec,
    ) -> Result<Self, QueryError> {
        let filter = beside_ids(&request.filter);
        let can_have = request.modifiers.collation.is_none() && !has_operator(&filter, &NOT_FOR_UPSERTS);
        let length = if can_have { Some(RawDocumentBuf::try_from(&filter)?.as_bytes().len()) } else { None };
        let touched = touched(plain).filter(|touched| touched.iter().all(|name| is_plain(name)));
        Ok(Self { request, dated, touched, filter, length, is_positional: is_positional(plain) })
    }

    /// The statement that updates a document if it is as it was read; nothing where a statement cannot say that.
    pub(super) fn of(&self, (id, body): (&Bson, &RawDocumentBuf)) -> Result<Option<Document>, QueryError> {
        let before = Document::try_from(&**body)?;
        // One with a field twice cannot be written as a condition, and no field of such a name be asked for.
        if RawDocumentBuf::try_from(&before)? != *body || !before.keys().all(|name| is_plain(name)) {
            return Ok(None);
        }
        let (mut conditions, update) = match self.dated.clone() {
            UpdateSpec::Document(mut update) => {
                // Fails where the statement would insert.
                let insertion = update.entry("$setOnInsert".to_owned()).or_insert_with(|| Document::new().into());
                let Bson::Document(insertion) = insertion else { return Ok(None) };
                insertion.insert("_id", doc! { "not": id });
                let Some(touched) = &self.touched else { return Ok(None) };
                // A document that is the same as a whole matches still.
                let longest = SHORT_FILTER.max(2 * body.as_bytes().len());
                let conditions = match self.length {
                    Some(length) if self.is_positional || length <= longest => {
                        let as_read = |name: &String| match before.get(name) {
                            Some(value) => doc! { name: { "$eq": value } },
                            None => doc! { name: { "$exists": false } },
                        };
                        std::iter::once(self.filter.clone()).chain(touched.iter().map(as_read)).collect()
                    }
                    // Which element `$` is depends on the filter.
                    _ if self.is_positional => return Ok(None),
                    _ => whole(&before),
                };
                (conditions, Bson::Document(update))
            }
            UpdateSpec::Pipeline(mut stages) if before.len() > 1 => {
                let is_inserted = doc! { "$eq": ["$$ROOT", { "$literal": { "_id": id } }] };
                stages.insert(0, doc! { "$replaceWith": { "$cond": [is_inserted, "changed meanwhile", "$$ROOT"] } });
                (whole(&before), Bson::from(stages))
            }
            UpdateSpec::Pipeline(_) => return Ok(None),
        };
        conditions.insert(0, doc! { "_id": { "$eq": id } });
        let mut statement = doc! { "q": { "$and": conditions }, "u": update, "upsert": true };
        if !self.request.array_filters.is_empty() {
            statement.insert("arrayFilters", self.request.array_filters.clone());
        }
        Ok(Some(statement))
    }
}

/// Whether a field of this name can be asked for.
fn is_plain(name: &str) -> bool {
    !name.is_empty() && !name.starts_with('$') && !name.contains('.')
}

/// The conditions that a document has these fields with these values, and no others. None is an equality, which an upsert
/// would insert.
fn whole(before: &Document) -> Vec<Document> {
    let names: Vec<&String> = before.keys().collect();
    let known: Document = before.keys().map(|name| (name.clone(), Bson::Document(Document::new()))).collect();
    let schema = doc! { "$jsonSchema": { "properties": known, "required": names, "additionalProperties": false } };
    let values = before.iter().filter(|(name, _)| *name != "_id");
    let values = values.map(|(name, value)| doc! { name: { "$gte": value, "$lte": value } });
    std::iter::once(schema).chain(values).collect()
}

/// The fields of the document that an update with operators changes, or has parts of.
fn touched(update: &UpdateSpec) -> Option<Vec<String>> {
    let UpdateSpec::Document(update) = update else { return None };
    let mut names = Vec::new();
    for (operator, fields) in update {
        for (path, value) in fields.as_document()? {
            let target = value.as_str().filter(|_| operator == "$rename");
            for path in std::iter::once(path.as_str()).chain(target) {
                let name = path.split('.').next().unwrap_or_default().to_owned();
                if !names.contains(&name) {
                    names.push(name);
                }
            }
        }
    }
    Some(names)
}

fn is_positional(update: &UpdateSpec) -> bool {
    let UpdateSpec::Document(update) = update else { return false };
    let mut paths = update.values().filter_map(Bson::as_document).flat_map(Document::keys);
    paths.any(|path| path.split('.').any(|part| part == "$"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(filter: Document, update: UpdateSpec, before: &Document) -> Option<Document> {
        let request = UpdateRequest { filter, ..UpdateRequest::default() };
        let body = RawDocumentBuf::try_from(before).unwrap();
        Statements::new(&request, &update, &update).unwrap().of((&before["_id"], &body)).unwrap()
    }

    #[test]
    fn a_statement_asks_for_the_fields_that_it_changes_or_for_all() {
        let before = doc! { "_id": 1, "a": { "b": 1 }, "l": [1] };
        let update = |document: Document| UpdateSpec::Document(document);
        let made =
            of(doc! { "n": 1 }, update(doc! { "$mul": { "a.b": 2 }, "$rename": { "x": "y.z" } }), &before).unwrap();
        let touched = [
            doc! { "_id": { "$eq": 1 } },
            doc! { "n": 1 },
            doc! { "a": { "$eq": { "b": 1 } } },
            doc! { "x": { "$exists": false } },
            doc! { "y": { "$exists": false } },
        ];
        assert_eq!(made.get_document("q").unwrap(), &doc! { "$and": touched.to_vec() });
        let insertion = made.get_document("u").unwrap().get_document("$setOnInsert").unwrap();
        assert_ne!(insertion.get("_id"), Some(&before["_id"]));
        // An upsert takes no expression.
        let expression = doc! { "$and": [{ "$expr": { "$gt": ["$n", 1] } }] };
        let made = of(expression.clone(), update(doc! { "$mul": { "n": 2 } }), &before).unwrap();
        let asked = made.get_document("q").unwrap().get_array("$and").unwrap();
        assert_eq!((asked.len(), made.get("upsert")), (4, Some(&true.into())));
        assert!(asked.contains(&doc! { "a": { "$gte": { "b": 1 }, "$lte": { "b": 1 } } }.into()), "{made}");
        assert_eq!(of(expression, update(doc! { "$set": { "l.$": 2 } }), &before), None);
        // A long filter is left out where the document says as much, and where it says what is known.
        let long = doc! { "n": { "$in": (0..500).collect::<Vec<i32>>() } };
        let asked = |filter, field: &str| {
            let made = of(filter, update(doc! { "$mul": { field: 2 } }), &before).unwrap();
            made.get_document("q").unwrap().get_array("$and").unwrap().clone()
        };
        assert!(!asked(long.clone(), "a.b").contains(&long.clone().into()));
        assert!(asked(long.clone(), "l.$").contains(&long.into()));
        let ids = doc! { "_id": { "$in": [1, 2] }, "$and": [{ "_id": 1 }, { "l": 1 }] };
        assert!(asked(ids, "l.$").contains(&doc! { "$and": [{}, { "l": 1 }] }.into()));
        let pipeline = || UpdateSpec::Pipeline(vec![doc! { "$set": { "n": 1 } }]);
        assert!(of(doc! {}, pipeline(), &before).is_some());
        for odd in [doc! { "_id": 1 }, doc! { "_id": 1, "a.b": 1 }, doc! { "_id": 1, "$a": 1 }] {
            assert_eq!(of(doc! {}, pipeline(), &odd), None, "{odd}");
        }
    }
}
