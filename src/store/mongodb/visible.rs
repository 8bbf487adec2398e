//! The conditions by which documents are seen, where they cost least.
//!
//! Each condition takes mongod a few microseconds to read, and keeps it from its short way to a document by `_id`. Where
//! whole documents are read, and all of them, rmem evaluates the conditions: few documents have decayed and are not removed.
//!
//! Elsewhere they stand beside what is asked for, which may be an `$expr`.
//! mongod evaluates the parts of an `$and` in an order of its own: `$not` and `$exists` come before `$expr`. So it looks for
//! the metadata in every document, also where few documents satisfy the expression. Written into the expression, behind
//! what is asked for, the conditions are evaluated for those few only. An index that serves the expression serves it there,
//! too.
//!
//! Both are for expressions that cannot fail: another one could fail on a document that has decayed.

use std::borrow::Cow;

use bson::{Bson, DateTime, Document, doc};

use crate::query::Filter;
use crate::store::metadata::{self, DECAY_PATH, INFO, TOKEN_PATH};
use crate::store::{Find, StoreError};

/// Operators that have a value whatever their arguments are.
const TOTAL: [&str; 14] = [
    "$and", "$cmp", "$cond", "$eq", "$gt", "$gte", "$ifNull", "$isArray", "$lt", "$lte", "$ne", "$not", "$or", "$type",
];

/// Returns the filter with the conditions on the metadata behind its `$expr`, where it has one; else as it is.
pub(super) fn behind_expression(filter: &Document) -> Cow<'_, Document> {
    match parts(filter) {
        Some((asked, expression, at)) => {
            let mut asked = asked.clone();
            asked.insert("$expr", doc! { "$and": [expression.clone(), visible(at)] });
            Cow::Owned(asked)
        }
        None => Cow::Borrowed(filter),
    }
}

/// Returns stages with such filters in their `$match`.
pub(super) fn in_stages(stages: &[Document]) -> Vec<Document> {
    let filter = |(name, argument): (&String, &Bson)| match argument {
        Bson::Document(filter) if name == "$match" => (name.clone(), behind_expression(filter).into_owned().into()),
        _ => (name.clone(), argument.clone()),
    };
    stages.iter().map(|stage| stage.iter().map(filter).collect()).collect()
}

/// The filter for the server, and the condition by which what it returns is seen, where that is left to rmem.
pub(super) fn for_server(find: &Find) -> Result<(Cow<'_, Document>, Option<Filter>), StoreError> {
    Ok(match apart(find)? {
        Some((asked, seen)) => (Cow::Borrowed(asked), Some(seen)),
        None => (behind_expression(&find.filter), None),
    })
}

/// What is asked for, and the condition by which documents are seen; nothing where the server has to evaluate both, since
/// it counts documents or returns parts of them, or their keys.
fn apart(find: &Find) -> Result<Option<(&Document, Filter)>, StoreError> {
    let Some((asked, at)) = asked(&find.filter) else { return Ok(None) };
    if find.keys.return_key {
        return Ok(None);
    }
    let counts = find.skip > 0 || find.limit > 0 && !is_one(asked);
    if counts || !find.projection.is_empty() || !asked.iter().all(|(name, value)| never_fails(name, value)) {
        return Ok(None);
    }
    Ok(Some((asked, Filter::parse(&metadata::stored(at))?)))
}

/// What is asked for beside the conditions on the metadata, and the time at which stored documents are seen; nothing where
/// the filter has another form.
fn asked(filter: &Document) -> Option<(&Document, DateTime)> {
    let [Bson::Document(asked), Bson::Document(seen)] = filter.get_array("$and").ok()?.as_slice() else { return None };
    let at = *seen.get_document(DECAY_PATH).ok()?.get_document("$not").ok()?.get_datetime("$lte").ok()?;
    (filter.len() == 1 && *seen == metadata::stored(at)).then_some((asked, at))
}

/// Whether at most one document can match.
fn is_one(filter: &Document) -> bool {
    match filter.get("_id") {
        Some(Bson::Document(id)) => !id.keys().any(|key| key.starts_with('$')),
        id => matches!(id, Some(Bson::ObjectId(_) | Bson::String(_) | Bson::Int32(_) | Bson::Int64(_))),
    }
}

/// Whether no part of a filter can fail on a document.
fn never_fails(name: &str, value: &Bson) -> bool {
    match (name, value) {
        ("$expr", expression) => is_total(expression),
        ("$where", _) => false,
        (_, Bson::Document(fields)) => fields.iter().all(|(name, value)| never_fails(name, value)),
        (_, Bson::Array(items)) => items.iter().all(|item| never_fails("", item)),
        _ => true,
    }
}

/// What is asked for, its expression, and the time at which stored documents are seen; nothing where the filter has
/// another form.
fn parts(filter: &Document) -> Option<(&Document, &Bson, DateTime)> {
    let (asked, at) = asked(filter)?;
    let expression = asked.get("$expr").filter(|expression| is_total(expression))?;
    Some((asked, expression, at))
}

/// Whether an expression has a value for every document.
fn is_total(expression: &Bson) -> bool {
    match expression {
        Bson::Array(items) => items.iter().all(is_total),
        Bson::Document(fields) => fields.iter().all(|(name, value)| match name.as_str() {
            "$literal" => true,
            operator if operator.starts_with('$') => TOTAL.contains(&operator) && is_total(value),
            _ => is_total(value),
        }),
        _ => true,
    }
}

/// The expression that is true for stored documents that have not decayed. Most have neither a date nor a token.
fn visible(at: DateTime) -> Document {
    let is_missing = |path: &str| doc! { "$eq": [{ "$type": format!("${path}") }, "missing"] };
    let is_plain = doc! { "$and": [is_missing(DECAY_PATH), is_missing(TOKEN_PATH)] };
    doc! { "$or": [is_plain, { "$not": any_hidden(at) }] }
}

/// The expression that is true where the conditions of the filter are not. Their paths reach into arrays, and they look
/// at each element.
fn any_hidden(at: DateTime) -> Document {
    // Dates come behind truth values.
    let has_passed = doc! { "$and": [{ "$gt": ["$$date", true] }, { "$lte": ["$$date", at] }] };
    let decays = any("$$info.decay_time", "date", has_passed);
    let has_token = doc! { "$ne": [{ "$type": "$$computation.token" }, "missing"] };
    let has_token = doc! { "$and": [is_document("$$computation"), has_token] };
    let is_computed = any("$$info.computation", "computation", has_token);
    let is_hidden = doc! { "$and": [is_document("$$info"), { "$or": [decays, is_computed] }] };
    any(&format!("${INFO}"), "info", is_hidden)
}

/// Whether a condition holds for a value or, of an array, for one of its elements.
fn any(value: &str, name: &str, condition: Document) -> Document {
    let elements = doc! { "$cond": [{ "$isArray": value }, value, [value]] };
    doc! { "$anyElementTrue": { "$map": { "input": elements, "as": name, "in": condition } } }
}

fn is_document(value: &str) -> Document {
    doc! { "$eq": [{ "$type": value }, "object"] }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As a memory asks for stored documents.
    fn seen(asked: Document, at: DateTime) -> Document {
        doc! { "$and": [asked, metadata::stored(at)] }
    }

    /// Values that metadata of other clients may have, in arrays, too.
    fn values(depth: usize, inner: &[Bson]) -> Vec<Bson> {
        let mut values = inner.to_vec();
        for _ in 0..depth {
            let arrays: Vec<Bson> = values.iter().map(|value| vec![Bson::Int32(1), value.clone()].into()).collect();
            values.extend(arrays);
        }
        values.push(Bson::Array(Vec::new()));
        values
    }

    #[test]
    fn the_same_documents_are_seen_whatever_their_metadata_is() {
        let at = DateTime::from_millis(10);
        let dates = [at.into(), DateTime::from_millis(11).into(), Bson::Null, true.into(), Bson::MaxKey, "x".into()];
        let computed =
            [doc! { "token": 1 }.into(), doc! { "token": [] }.into(), doc! { "x": 1 }.into(), Bson::Int32(2)];
        let mut infos = vec![Bson::Int32(1), Document::new().into()];
        for date in values(2, &dates) {
            infos.push(doc! { "decay_time": date.clone() }.into());
            let both = |computation: Bson| doc! { "decay_time": date.clone(), "computation": computation }.into();
            infos.extend(values(2, &computed).into_iter().map(both));
        }
        infos.extend(values(2, &computed).into_iter().map(|computation| doc! { "computation": computation }.into()));
        let asked = seen(doc! { "$expr": { "$ne": ["$a", "$b"] } }, at);
        let moved = behind_expression(&asked);
        assert_ne!(*moved, asked);
        let (asked, moved) = (Filter::parse(&asked).unwrap(), Filter::parse(&moved).unwrap());
        for info in values(2, &infos) {
            for document in [doc! { "a": 1, INFO: info.clone() }, doc! { "a": 1, "b": 1, INFO: info }] {
                let matches = |filter: &Filter| filter.matches_document(&document).unwrap();
                assert_eq!(matches(&moved), matches(&asked), "{document}");
            }
        }
    }

    #[test]
    fn the_server_is_asked_alone_where_it_neither_counts_nor_cuts_and_cannot_fail() {
        let at = DateTime::from_millis(10);
        let find = |filter: Document| Find { filter, ..Find::default() };
        let limited = |filter: Document| Find { limit: 1, ..find(filter) };
        let alone = |find: &Find| apart(find).unwrap().map(|(asked, _)| asked.clone());
        for asked in [
            doc! { "name": "cup", "$or": [{ "n": { "$gt": 1 } }, { "$expr": { "$ne": ["$a", "$b"] } }] },
            doc! { "_id": { "$in": [1, 2] } },
        ] {
            assert_eq!(alone(&find(seen(asked.clone(), at))), Some(asked.clone()));
            assert_eq!(alone(&limited(seen(asked.clone(), at))), None, "{asked}");
        }
        for one in [doc! { "_id": 1 }, doc! { "_id": { "a": 1 }, "name": "cup" }] {
            assert_eq!(alone(&limited(seen(one.clone(), at))), Some(one));
        }
        for whole in [
            find(doc! { "name": "cup" }),
            find(seen(doc! { "$expr": { "$divide": [1, "$n"] } }, at)),
            find(seen(doc! { "$or": [{ "a": 1 }, { "$nor": [{ "$where": "this.a" }] }] }, at)),
            Find { skip: 1, ..find(seen(doc! { "_id": 1 }, at)) },
            Find { projection: doc! { "name": 1 }, ..find(seen(doc! { "_id": 1 }, at)) },
            limited(seen(doc! { "_id": Bson::Null }, at)),
        ] {
            assert_eq!(alone(&whole), None, "{whole:?}");
        }
        let stored = find(seen(doc! { "name": "cup" }, at));
        let (_, condition) = apart(&stored).unwrap().unwrap();
        let is_seen = |document: Document| condition.matches_document(&document).unwrap();
        assert!(is_seen(doc! { "name": "cup" }) && !is_seen(doc! { INFO: { "decay_time": at } }));
    }

    #[test]
    fn only_expressions_that_cannot_fail_are_evaluated_first() {
        let at = DateTime::from_millis(10);
        for moved in [
            doc! { "$expr": "$a" },
            doc! { "$expr": { "$not": [{ "$and": ["$a", { "$eq": ["$b", { "$literal": "$x" }] }] }] } },
            doc! { "name": "cup", "$expr": { "$gt": [{ "$ifNull": ["$a.b", 0] }, { "x": ["$c", 1] }] } },
        ] {
            let filter = seen(moved, at);
            assert_ne!(*behind_expression(&filter), filter, "{filter}");
        }
        let gt = |value: Document| doc! { "$expr": { "$gt": [value, 1] } };
        for kept in [
            seen(gt(doc! { "$toInt": "$a" }), at),
            seen(gt(doc! { "$cond": ["$a", { "$divide": [1, "$b"] }, 2] }), at),
            seen(doc! { "$or": [{ "$expr": "$a" }] }, at),
            doc! { "$and": [{ "$expr": "$a" }, { DECAY_PATH: { "$not": { "$lte": at } } }] },
            doc! { "$and": [{ "$expr": "$a" }, { DECAY_PATH: { "$not": { "$lte": at } }, TOKEN_PATH: { "$in": [Bson::Null] } }] },
            doc! { "$expr": "$a" },
        ] {
            assert_eq!(*behind_expression(&kept), kept);
        }
    }
}
