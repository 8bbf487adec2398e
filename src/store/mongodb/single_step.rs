//! Updates of one document that carry their metadata in one request.
//!
//! The metadata may be written only where a document changes. For two kinds of updates that needs no look at
//! the document: those that change whatever they meet, and those that set fields of the document itself to
//! plain values, which the server can compare in a pipeline.

use bson::{Bson, DateTime, Document, doc};

use super::update::add_field;
use crate::query::{QueryError, type_name};
use crate::store::metadata::{INFO, UPDATED};
use crate::store::{UpdateRequest, UpdateSpec};

/// The update with its metadata, where one request can carry both.
pub(super) fn with_metadata(request: &UpdateRequest, at: DateTime) -> Result<Option<UpdateSpec>, QueryError> {
    let UpdateSpec::Document(update) = &request.update else { return Ok(None) };
    if request.many || !request.array_filters.is_empty() {
        return Ok(None);
    }
    if update.iter().any(|(operator, fields)| always_changes(operator, fields)) {
        let mut update = update.clone();
        add_field(&mut update, "$set", UPDATED, at)?;
        return Ok(Some(UpdateSpec::Document(update)));
    }
    Ok(plain_values(update).map(|values| UpdateSpec::Pipeline(compared(values, at))))
}

/// Whether an operator changes every document that the server lets it change. Paths with `$[]` may meet nothing. (A double
/// beyond 2^53 to which one is added stays as it is, and is called changed.)
fn always_changes(operator: &str, fields: &Bson) -> bool {
    let Bson::Document(fields) = fields else { return false };
    fields.iter().filter(|(path, _)| !path.contains('$')).any(|(_, value)| match (operator, value) {
        ("$inc", Bson::Int32(number)) => *number != 0,
        ("$inc", Bson::Int64(number)) => *number != 0,
        ("$push", Bson::Document(value)) => !value.keys().any(|key| key.starts_with('$')),
        ("$push" | "$currentDate", _) => true,
        _ => false,
    })
}

/// The fields of a `$set` that is the whole update, in the order in which the server adds them.
fn plain_values(update: &Document) -> Option<Vec<(&str, &Bson)>> {
    let mut entries = update.iter();
    let (Some((operator, Bson::Document(fields))), None) = (entries.next(), entries.next()) else { return None };
    let is_name = |name: &str| {
        // Names that begin with a digit are ordered as numbers.
        !matches!(name, "" | "_id" | INFO)
            && !name.starts_with(|c: char| c.is_ascii_digit())
            && !name.contains(['.', '$'])
    };
    if operator != "$set" || fields.is_empty() || !fields.iter().all(|(name, value)| is_name(name) && is_plain(value)) {
        return None;
    }
    let mut values: Vec<_> = fields.iter().map(|(name, value)| (name.as_str(), value)).collect();
    values.sort_unstable_by_key(|(name, _)| *name);
    Some(values)
}

/// Whether two values of this type that are equal for an expression are the same for an update.
fn is_plain(value: &Bson) -> bool {
    match value {
        // Zero has two signs.
        Bson::Double(number) => *number != 0.0 && !number.is_nan(),
        Bson::String(_) | Bson::Int32(_) | Bson::Int64(_) | Bson::Boolean(_) | Bson::Null => true,
        Bson::DateTime(_) | Bson::ObjectId(_) => true,
        _ => false,
    }
}

/// The stages that set fields, and the date of the change where one of them is another than before.
fn compared(values: Vec<(&str, &Bson)>, at: DateTime) -> Vec<Document> {
    let differences: Vec<Bson> = values.iter().map(|(name, value)| differs(name, value).into()).collect();
    let mut set = Document::new();
    let info = format!("${INFO}");
    set.insert(
        INFO,
        doc! { "$cond": [
            { "$or": differences },
            { "$mergeObjects": [&info, { UPDATED: at }] },
            &info,
        ] },
    );
    let mut fields = Document::new();
    for (name, value) in values {
        fields.insert(name, doc! { "$literal": value.clone() });
    }
    vec![doc! { "$set": set }, doc! { "$set": fields }]
}

/// Whether a field has another value, or one of another type. Texts are compared byte by byte: for `$ne`, those that
/// the collation of the collection equates are equal.
fn differs(name: &str, value: &Bson) -> Document {
    let field = format!("${name}");
    let differs = match value {
        Bson::String(text) => {
            let is_there = doc! { "$eq": [{ "$indexOfBytes": [&field, { "$literal": text }] }, 0] };
            let is_as_long =
                doc! { "$eq": [{ "$strLenBytes": &field }, i64::try_from(text.len()).unwrap_or(i64::MAX)] };
            doc! { "$not": [{ "$and": [is_as_long, is_there] }] }
        }
        other => doc! { "$ne": [&field, { "$literal": other.clone() }] },
    };
    doc! { "$cond": [{ "$eq": [{ "$type": &field }, type_name(value)] }, differs, true] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_request_carries_what_surely_changes_and_what_the_server_can_compare() {
        let kind = |update: Document| {
            let request = UpdateRequest { update: UpdateSpec::Document(update), ..UpdateRequest::default() };
            match with_metadata(&request, DateTime::from_millis(1)).unwrap() {
                Some(UpdateSpec::Document(_)) => "sure",
                Some(UpdateSpec::Pipeline(_)) => "compared",
                None => "read",
            }
        };
        for sure in [
            doc! { "$inc": { "n": 1 } },
            doc! { "$set": { "a.b": [1] }, "$push": { "l": 1 } },
            doc! { "$currentDate": { "t": true } },
        ] {
            assert_eq!(kind(sure.clone()), "sure", "{sure}");
        }
        for compared in [doc! { "$set": { "a": 1, "b": "x" } }, doc! { "$set": { "a": Bson::Null } }] {
            assert_eq!(kind(compared.clone()), "compared", "{compared}");
        }
        for read in [
            doc! {},
            doc! { "a": 1 },
            doc! { "$set": {} },
            doc! { "$set": { "_id": 1 } },
            doc! { "$set": { "a.b": 1 } },
            doc! { "$set": { "a": [1] } },
            doc! { "$set": { "a": 0.0 } },
            doc! { "$set": { "1": 1 } },
            doc! { "$set": { "a": 1 }, "$unset": { "b": 1 } },
            doc! { "$inc": { "n": 0 } },
            doc! { "$inc": { "l.$[].n": 1 } },
            doc! { "$push": { "l": { "$each": [] } } },
        ] {
            assert_eq!(kind(read.clone()), "read", "{read}");
        }
    }
}
