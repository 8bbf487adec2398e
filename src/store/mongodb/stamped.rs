//! Updates that also write their stamps, in the server's own language.

use bson::{Bson, DateTime, Document, doc};

use crate::query::QueryError;
use crate::store::UpdateSpec;
use crate::store::stamp::{INFO, INSERTED, UPDATED};

/// Whether an update is a replacement document: one without operators.
pub(super) fn is_replacement(document: &Document) -> bool {
    !document.keys().next().is_some_and(|key| key.starts_with('$'))
}

/// The update with its stamps. A replacement becomes a pipeline, because it
/// has to keep when its predecessor was inserted.
pub(super) fn with_stamps(update: &UpdateSpec, at: DateTime) -> Result<UpdateSpec, QueryError> {
    match update {
        UpdateSpec::Document(document) if is_replacement(document) => replacement(document, at),
        UpdateSpec::Document(document) => Ok(UpdateSpec::Document(operators(document.clone(), at)?)),
        UpdateSpec::Pipeline(stages) => {
            let mut stages = stages.clone();
            stages.push(doc! { "$set": { path(UPDATED): at, path(INSERTED): inserted(at) } });
            Ok(UpdateSpec::Pipeline(stages))
        }
    }
}

fn operators(mut update: Document, at: DateTime) -> Result<Document, QueryError> {
    for (operator, key) in [("$set", UPDATED), ("$setOnInsert", INSERTED)] {
        match update.entry(operator.to_owned()).or_insert_with(|| Bson::Document(Document::new())) {
            Bson::Document(fields) => {
                fields.insert(path(key), at);
            }
            _ => return Err(QueryError::failed_to_parse(format!("{operator} takes a document of fields"))),
        }
    }
    Ok(update)
}

fn replacement(document: &Document, at: DateTime) -> Result<UpdateSpec, QueryError> {
    let mut document = document.clone();
    let own = match document.remove(INFO) {
        None => Document::new(),
        Some(Bson::Document(own)) => own,
        Some(_) => {
            return Err(QueryError::type_mismatch(format!("{INFO} holds rmem's metadata and has to be a document")));
        }
    };
    let info = doc! { "$mergeObjects": [{ "$literal": own }, { INSERTED: inserted(at), UPDATED: at }] };
    let whole = doc! { "$mergeObjects": [{ "_id": "$_id" }, { "$literal": document }, { INFO: info }] };
    Ok(UpdateSpec::Pipeline(vec![doc! { "$replaceWith": whole }]))
}

fn inserted(at: DateTime) -> Document {
    doc! { "$ifNull": [format!("${}", path(INSERTED)), at] }
}

fn path(key: &str) -> String {
    format!("{INFO}.{key}")
}
