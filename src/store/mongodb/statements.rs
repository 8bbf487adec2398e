//! Updates of several documents by a statement each, in one command.
//!
//! A statement changes its document if that is as it was read. The server's answer says how many were changed, and not which,
//! but names the first statement that fails. So each is an upsert, whose insertion fails: it is one where the document is
//! another one meanwhile, or has gone.

use bson::{Bson, Document, RawDocumentBuf, doc};

use super::named::has_operator;
use super::{MongoDb, failure};
use crate::query::QueryError;
use crate::store::{Namespace, StoreError, UpdateRequest, UpdateSpec};

/// About how many bytes of statements one command has.
const MOST_BYTES: usize = 8 << 20;

/// Operators of filters that the server does not take for an upsert.
const NOT_FOR_UPSERTS: [&str; 7] = ["$expr", "$where", "$near", "$nearSphere", "$geoNear", "$text", "$sampleRate"];

/// What the server did of several statements.
pub(super) struct Sent {
    /// How many it did.
    pub(super) done: usize,
    /// Whether the one behind these failed.
    pub(super) has_failed: bool,
}

impl MongoDb {
    /// Sends statements until one fails, as many as a command has room for.
    pub(super) fn send(
        &self,
        ns: &Namespace,
        request: &UpdateRequest,
        statements: &[Document],
    ) -> Result<Sent, StoreError> {
        let (mut count, mut bytes) = (0, 0);
        for statement in statements {
            bytes += RawDocumentBuf::try_from(statement).map_err(QueryError::from)?.as_bytes().len();
            if count > 0 && bytes > MOST_BYTES {
                break;
            }
            count += 1;
        }
        let concern = bson::serialize_to_document(&self.write_policy.of_one()).map_err(QueryError::from)?;
        let sent = statements.get(..count).unwrap_or_default();
        let mut command = doc! { "update": &ns.collection, "updates": sent, "ordered": true, "writeConcern": concern };
        if !request.modifiers.variables.is_empty() {
            command.insert("let", request.modifiers.variables.clone());
        }
        if self.is_bypassing.get() {
            command.insert("bypassDocumentValidation", true);
        }
        let answer = match self.client().database(&ns.database).run_command(command).run() {
            Ok(answer) => answer,
            // It says at the first document what it does not like.
            Err(error) if failure::code(&error).is_some() => return Ok(Sent { done: 0, has_failed: true }),
            Err(error) => return Err(failure::explain_change(&self.address, ns, &error)),
        };
        let failed = answer
            .get_array("writeErrors")
            .ok()
            .and_then(|errors| errors.first()?.as_document()?.get_i32("index").ok());
        let done = failed.and_then(|index| usize::try_from(index).ok());
        match answer.get_document("writeConcernError") {
            Ok(concern) => {
                let reason = concern.get_str("errmsg").unwrap_or_default();
                Err(failure::unconfirmed(&self.address, &format!("the change of {ns}"), reason))
            }
            Err(_) => Ok(Sent { done: done.unwrap_or(count), has_failed: done.is_some() }),
        }
    }
}

/// The statement that updates a document with the date of the change (`dated`), if it is as it was read; nothing where a
/// statement cannot say that.
pub(super) fn statement(
    request: &UpdateRequest,
    plain: &UpdateSpec,
    dated: &UpdateSpec,
    (id, body): (&Bson, &RawDocumentBuf),
) -> Result<Option<Document>, QueryError> {
    let before = Document::try_from(&**body)?;
    // One with a field twice cannot be written as a condition, and no field of such a name be asked for.
    let is_plain = |name: &String| !name.is_empty() && !name.starts_with('$') && !name.contains('.');
    if RawDocumentBuf::try_from(&before)? != *body || !before.keys().all(is_plain) {
        return Ok(None);
    }
    let (mut conditions, update) = match dated.clone() {
        UpdateSpec::Document(mut update) => {
            // Fails where the statement would insert.
            let insertion = update.entry("$setOnInsert".to_owned()).or_insert_with(|| Document::new().into());
            let Bson::Document(insertion) = insertion else { return Ok(None) };
            insertion.insert("_id", doc! { "not": id });
            let Some(touched) = touched(plain).filter(|touched| touched.iter().all(is_plain)) else { return Ok(None) };
            let conditions =
                if request.modifiers.collation.is_none() && !has_operator(&request.filter, &NOT_FOR_UPSERTS) {
                    let as_read = |name: &String| match before.get(name) {
                        Some(value) => doc! { name: { "$eq": value } },
                        None => doc! { name: { "$exists": false } },
                    };
                    std::iter::once(request.filter.clone()).chain(touched.iter().map(as_read)).collect()
                } else if is_positional(plain) {
                    // Which element `$` is depends on the filter.
                    return Ok(None);
                } else {
                    whole(&before)
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
    if !request.array_filters.is_empty() {
        statement.insert("arrayFilters", request.array_filters.clone());
    }
    Ok(Some(statement))
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
        statement(&request, &update, &update, (&before["_id"], &body)).unwrap()
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
        let pipeline = || UpdateSpec::Pipeline(vec![doc! { "$set": { "n": 1 } }]);
        assert!(of(doc! {}, pipeline(), &before).is_some());
        for odd in [doc! { "_id": 1 }, doc! { "_id": 1, "a.b": 1 }, doc! { "_id": 1, "$a": 1 }] {
            assert_eq!(of(doc! {}, pipeline(), &odd), None, "{odd}");
        }
    }
}
