//! Updates of one document that carry their metadata in one request.
//!
//! The metadata may be written only where a document changes. For two kinds of updates that needs no look at
//! the document: those that change whatever they meet, and those that set fields to values that the server can compare.
//! Of a document that is named by its `_id`, it compares them by the filter; of the first match of another filter, which would
//! be another one then, in a pipeline. Where a document has little beside the fields that are set, what a pipeline does to it
//! is a replacement for change streams; there, the pipeline is made to fail.
//!
//! mongod takes longer to read a long pipeline than to do it. So the first request asks by `$ne` alone, which finds most
//! changes; a pipeline fails where it finds none. The second request compares types and bytes, too.

use bson::{Bson, DateTime, Document, RawDocumentBuf, doc};

use super::dates::add_field;
use crate::query::{QueryError, type_name};
use crate::saturate::to_i64;
use crate::store::metadata::{INFO, UPDATED};
use crate::store::{UpdateRequest, UpdateSpec};

/// How many bytes the update has to be smaller by than the document behind it, so that it is one for change streams:
/// 65 on MongoDB 6.0, and some to spare.
const OVERHEAD: usize = 68;

/// The largest update, in bytes, whose values are sent with it a second time: a command has room for 16 MB.
const LARGEST_COMPARED: usize = 4 << 20;

/// A request that carries the metadata.
pub(super) struct Single {
    pub(super) request: UpdateRequest,
    pub(super) meaning: Meaning,
}

/// What the server's answer to it means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Meaning {
    /// What it says.
    Whole,
    /// Where nothing matches, the document may be the same already.
    IfDifferent,
    /// Where it is refused, the document may be the same already, or too small.
    IfTaken,
}

impl Single {
    fn new(request: &UpdateRequest, update: UpdateSpec, meaning: Meaning) -> Self {
        let (filter, modifiers) = (request.filter.clone(), request.modifiers.clone());
        Self { request: UpdateRequest { filter, update, modifiers, ..UpdateRequest::default() }, meaning }
    }
}

/// The requests that carry the metadata, to be tried in this order; none where one request cannot. Each is made when it is
/// asked for: most updates need only the first.
pub(super) fn with_metadata(request: &UpdateRequest, at: DateTime) -> Result<impl Iterator<Item = Single>, QueryError> {
    let (first, exact) = specs(request, at)?;
    let exact = exact.into_iter().map(move |(values, least)| {
        let update = UpdateSpec::Pipeline(compared(&values, least, at));
        Single::new(request, update, Meaning::IfTaken)
    });
    Ok(first.into_iter().chain(exact))
}

/// The first request, and what the second one compares: fields, and the fewest bytes of a document.
type Specs<'u> = (Option<Single>, Option<(Vec<(&'u str, &'u Bson)>, usize)>);

fn specs(request: &UpdateRequest, at: DateTime) -> Result<Specs<'_>, QueryError> {
    let UpdateSpec::Document(update) = &request.update else { return Ok((None, None)) };
    if request.many || !request.array_filters.is_empty() {
        return Ok((None, None));
    }
    if update.iter().any(|(operator, fields)| always_changes(operator, fields)) {
        return Ok((Some(Single::new(request, dated_update(update, at)?, Meaning::Whole)), None));
    }
    let Some(values) = plain_values(update) else { return Ok((None, None)) };
    let least = RawDocumentBuf::try_from(update).map_err(QueryError::from)?.as_bytes().len() + OVERHEAD;
    if least > LARGEST_COMPARED {
        return Ok((None, None));
    }
    // An upsert that inserts would take one request more.
    let is_named = !request.upsert && request.modifiers.collation.is_none() && names_id(&request.filter);
    let first = if is_named {
        let mut single = Single::new(request, dated_update(update, at)?, Meaning::IfDifferent);
        let others: Vec<Document> = values.iter().map(|(name, value)| doc! { *name: { "$ne": *value } }).collect();
        single.request.filter = doc! { "$and": [single.request.filter, { "$or": others }] };
        single
    } else {
        Single::new(request, UpdateSpec::Pipeline(changed(&values, least, at)), Meaning::IfTaken)
    };
    Ok((Some(first), is_comparable(&values).then_some((values, least))))
}

/// The update with the date of the change.
fn dated_update(update: &Document, at: DateTime) -> Result<UpdateSpec, QueryError> {
    let mut update = update.clone();
    add_field(&mut update, "$set", UPDATED, at)?;
    Ok(UpdateSpec::Document(update))
}

/// Whether a filter matches one document at most, by its `_id`.
fn names_id(filter: &Document) -> bool {
    filter.iter().any(|(name, value)| match (name.as_str(), value) {
        ("_id", Bson::RegularExpression(_)) => false,
        ("_id", Bson::Document(id)) => id.contains_key("$eq") || !id.keys().any(|key| key.starts_with('$')),
        ("_id", _) => true,
        ("$and", Bson::Array(parts)) => parts.iter().filter_map(Bson::as_document).any(names_id),
        _ => false,
    })
}

/// Whether an operator changes every document that the server lets it change. Paths with `$[]` may meet nothing. (A double
/// beyond 2^53 to which one is added stays as it is, and is called changed.)
pub(super) fn always_changes(operator: &str, fields: &Bson) -> bool {
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
    if operator != "$set" || fields.is_empty() || !fields.iter().all(|(name, value)| is_name(name) && is_literal(value))
    {
        return None;
    }
    let mut values: Vec<_> = fields.iter().map(|(name, value)| (name.as_str(), value)).collect();
    values.sort_unstable_by_key(|(name, _)| *name);
    Some(values)
}

/// Whether the server sets a field to the value as it is. (It writes the time into an empty timestamp.)
pub(super) fn is_literal(value: &Bson) -> bool {
    match value {
        Bson::Array(values) => values.iter().all(is_literal),
        Bson::Document(fields) => fields.values().all(is_literal),
        Bson::Double(_) | Bson::String(_) | Bson::Int32(_) | Bson::Int64(_) | Bson::Boolean(_) | Bson::Null => true,
        Bson::DateTime(_) | Bson::ObjectId(_) | Bson::Decimal128(_) | Bson::Binary(_) => true,
        _ => false,
    }
}

/// How many values the server compares with their types and bytes to see whether a document changes, at most.
const MOST_VALUES: usize = 32;

/// Whether the server can tell that none of the fields changes.
fn is_comparable(values: &[(&str, &Bson)]) -> bool {
    let count = values.iter().try_fold(0, |sum, (_, value)| Some(sum + count(value)?));
    count.is_some_and(|count| count <= MOST_VALUES)
}

/// How many values there are to compare; nothing where one is of a type for which the server has no exact comparison.
fn count(value: &Bson) -> Option<usize> {
    match value {
        Bson::Double(number) => (!number.is_nan()).then_some(1),
        Bson::String(_) | Bson::Int32(_) | Bson::Int64(_) | Bson::Boolean(_) | Bson::Null => Some(1),
        Bson::DateTime(_) | Bson::ObjectId(_) => Some(1),
        Bson::Array(values) => values.iter().try_fold(1, |sum, value| Some(sum + count(value)?)),
        Bson::Document(fields) => fields.values().try_fold(1, |sum, value| Some(sum + 1 + count(value)?)),
        _ => None,
    }
}

/// The stages that set fields, and the date of the change. They fail where the server's comparison finds no field changed,
/// which is less than that none is: 1 equals 1.0. They also fail where the document has fewer bytes then.
fn changed(values: &[(&str, &Bson)], least: usize, at: DateTime) -> Vec<Document> {
    let is_other = |(name, value): &(&str, &Bson)| doc! { "$ne": [format!("${name}"), { "$literal": *value }] };
    let mut differences = values.iter().map(is_other);
    let differs = match (differences.next(), values.len()) {
        (Some(only), 1) => only,
        (first, _) => doc! { "$or": first.into_iter().chain(differences).collect::<Vec<_>>() },
    };
    // `$mergeObjects` refuses what is no document.
    let date = doc! { "$cond": [differs, { INFO: dated(at) }, "unchanged"] };
    let set = doc! { "$replaceWith": { "$mergeObjects": ["$$ROOT", date, literal(values)] } };
    vec![set, doc! { "$replaceWith": where_large("$$ROOT", least) }]
}

/// The stage that does the same where a field is another than before, also where only its type or a byte is, and leaves
/// the document as it is where none is.
fn compared(values: &[(&str, &Bson)], least: usize, at: DateTime) -> Vec<Document> {
    let differences: Vec<Bson> = values.iter().map(|(name, value)| differs(format!("${name}"), value).into()).collect();
    let after = doc! { "$mergeObjects": ["$$ROOT", { INFO: dated(at) }, literal(values)] };
    let changed = doc! { "$let": { "vars": { "after": after }, "in": where_large("$$after", least) } };
    vec![doc! { "$replaceWith": { "$cond": [{ "$or": differences }, changed, "$$ROOT"] } }]
}

/// The metadata with the date of the change.
fn dated(at: DateTime) -> Document {
    doc! { "$mergeObjects": [format!("${INFO}"), { UPDATED: at }] }
}

/// The fields that are set.
fn literal(values: &[(&str, &Bson)]) -> Document {
    let fields: Document = values.iter().map(|(name, value)| ((*name).to_owned(), (*value).clone())).collect();
    doc! { "$literal": fields }
}

/// A document of at least so many bytes; a text, which is refused, where it has fewer.
fn where_large(document: &str, least: usize) -> Document {
    doc! { "$cond": [{ "$gte": [{ "$bsonSize": document }, whole(least)] }, document, "too small"] }
}

/// Whether an expression gives another value, or one of another type.
fn differs(found: impl Into<Bson>, value: &Bson) -> Document {
    let found = found.into();
    let element = |list: &Bson, nth: usize| doc! { "$arrayElemAt": [list.clone(), whole(nth)] };
    let differs = match value {
        Bson::String(text) => differs_in_bytes(&found, text),
        Bson::Double(zero) if *zero == 0.0 => {
            let sign = if zero.is_sign_negative() { 0 } else { -1 };
            let has_sign = doc! { "$eq": [{ "$indexOfBytes": [{ "$toString": &found }, "-"] }, sign] };
            doc! { "$not": [{ "$and": [{ "$eq": [&found, 0.0] }, has_sign] }] }
        }
        Bson::Array(values) => {
            let of_elements = values.iter().enumerate().map(|(nth, value)| differs(element(&found, nth), value).into());
            let others = doc! { "$ne": [{ "$size": &found }, whole(values.len())] };
            any(others, of_elements)
        }
        Bson::Document(fields) => {
            let (names, values) = (Bson::from("$$fields.k"), Bson::from("$$fields.v"));
            let of_fields = fields.iter().enumerate().flat_map(|(nth, (name, value))| {
                let name = differs_in_bytes(&element(&names, nth).into(), name);
                [name.into(), differs(element(&values, nth), value).into()]
            });
            let others = doc! { "$ne": [{ "$size": "$$fields" }, whole(fields.len())] };
            doc! { "$let": { "vars": { "fields": { "$objectToArray": &found } }, "in": any(others, of_fields) } }
        }
        other => doc! { "$ne": [&found, { "$literal": other.clone() }] },
    };
    doc! { "$cond": [{ "$eq": [{ "$type": found }, type_name(value)] }, differs, true] }
}

/// Whether one of the conditions holds.
fn any(first: Document, others: impl Iterator<Item = Bson>) -> Document {
    let all: Vec<Bson> = std::iter::once(first.into()).chain(others).collect();
    doc! { "$or": all }
}

/// Whether a text is another one, byte by byte: `$ne` takes texts for one that the collation of the collection equates.
fn differs_in_bytes(found: &Bson, text: &str) -> Document {
    let found = doc! { "$ifNull": [found, ""] };
    let is_there = doc! { "$eq": [{ "$indexOfBytes": [&found, { "$literal": text }] }, 0] };
    let is_as_long = doc! { "$eq": [{ "$strLenBytes": found }, whole(text.len())] };
    doc! { "$not": [{ "$and": [is_as_long, is_there] }] }
}

fn whole(number: usize) -> i64 {
    to_i64(number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_request_carries_what_surely_changes_and_what_the_server_can_compare() {
        let kind_of = |filter: Document, update: Document| {
            let request = UpdateRequest { filter, update: UpdateSpec::Document(update), ..UpdateRequest::default() };
            let requests = with_metadata(&request, DateTime::from_millis(1)).unwrap();
            match requests.map(|single| single.meaning).collect::<Vec<_>>().as_slice() {
                [Meaning::Whole] => "sure",
                [Meaning::IfTaken, Meaning::IfTaken] => "compared",
                [Meaning::IfDifferent, Meaning::IfTaken] => "named",
                [Meaning::IfTaken] => "compared unless equal",
                _ => "read",
            }
        };
        let kind = |update| kind_of(doc! { "name": "a" }, update);
        let set = || doc! { "$set": { "a": 1 } };
        for named in [
            doc! { "_id": 1 },
            doc! { "$and": [{ "n": 1 }, { "_id": { "$eq": { "x": 1 } } }] },
            doc! { "_id": { "x": 1 } },
        ] {
            assert_eq!(kind_of(named.clone(), set()), "named", "{named}");
        }
        let pattern =
            Bson::RegularExpression(bson::Regex { pattern: "a".try_into().unwrap(), options: "".try_into().unwrap() });
        for open in [doc! { "_id": { "$gt": 1 } }, doc! { "$or": [{ "_id": 1 }, { "n": 1 }] }, doc! { "_id": pattern }]
        {
            assert_eq!(kind_of(open.clone(), set()), "compared", "{open}");
        }
        for sure in [
            doc! { "$inc": { "n": 1 } },
            doc! { "$set": { "a.b": [1] }, "$push": { "l": 1 } },
            doc! { "$currentDate": { "t": true } },
        ] {
            assert_eq!(kind(sure.clone()), "sure", "{sure}");
        }
        for compared in [
            doc! { "$set": { "a": 1, "b": "x" } },
            doc! { "$set": { "a": Bson::Null, "position": [0.0, 1.5, 2], "pose": { "frame": "map", "x": 1.0 } } },
        ] {
            assert_eq!(kind(compared.clone()), "compared", "{compared}");
        }
        for unless_equal in [doc! { "$set": { "a": vec![1; 32] } }, doc! { "$set": { "a": [f64::NAN] } }] {
            assert_eq!(kind(unless_equal.clone()), "compared unless equal", "{unless_equal}");
        }
        for read in [
            doc! {},
            doc! { "a": 1 },
            doc! { "$set": {} },
            doc! { "$set": { "_id": 1 } },
            doc! { "$set": { "a.b": 1 } },
            doc! { "$set": { "1": 1 } },
            doc! { "$set": { "a": bson::Timestamp { time: 0, increment: 0 } } },
            doc! { "$set": { "a": 1 }, "$unset": { "b": 1 } },
            doc! { "$inc": { "n": 0 } },
            doc! { "$inc": { "l.$[].n": 1 } },
            doc! { "$push": { "l": { "$each": [] } } },
        ] {
            assert_eq!(kind(read.clone()), "read", "{read}");
        }
    }
}
