//! Keeps the memory's metadata out of sight of expressions and pipelines.
//!
//! The metadata is stored in documents, so that `$$ROOT`, `$lookup` or `$out` would see it. Stages and
//! expressions are rewritten in MongoDB's own language, so that both stores do the same: a pipeline removes the metadata
//! before the first stage that sees whole documents, and `$$ROOT` stands for the document without it. What names
//! `_robmem_info` is not rewritten: there, it is asked for.

use std::borrow::Cow;

use bson::{Bson, DateTime, Document, doc};

use crate::store::metadata::{INFO, INSERTED, info_path};
use crate::store::{Find, UpdateSpec};

/// Stages that give the documents which they get, and look only at the fields that they name.
const PASSING: [&str; 6] = ["$match", "$sort", "$limit", "$skip", "$sample", "$unwind"];
/// Stages whose results have only the fields that they name.
const CONSUMING: [&str; 5] = ["$group", "$count", "$bucket", "$bucketAuto", "$sortByCount"];
/// Operators that see the whole document.
const SEEING: [&str; 3] = ["$where", "$jsonSchema", "$function"];

/// Returns a filter whose expressions do not see the metadata.
pub(in crate::memory) fn in_filter(filter: &Document) -> Document {
    let condition = |(key, value): (&String, &Bson)| {
        let value = match (key.as_str(), value) {
            ("$expr", expression) => in_expression(expression),
            ("$jsonSchema", Bson::Document(schema)) => in_schema(schema).into(),
            ("$and" | "$or" | "$nor", Bson::Array(parts)) => {
                let part = |part: &Bson| part.as_document().map_or_else(|| part.clone(), |part| in_filter(part).into());
                Bson::Array(parts.iter().map(part).collect())
            }
            _ => value.clone(),
        };
        (key.clone(), value)
    };
    filter.iter().map(condition).collect()
}

/// Returns a query whose filter does not see the metadata.
pub(in crate::memory) fn in_filter_of(find: &Find) -> Cow<'_, Find> {
    match find.filter.keys().any(|key| key.starts_with('$')) {
        true => Cow::Owned(find.with_filter(in_filter(&find.filter))),
        false => Cow::Borrowed(find),
    }
}

/// Returns a query whose projection does not see the metadata.
pub(in crate::memory) fn in_find(find: &Find) -> Cow<'_, Find> {
    if find.projection.is_empty() {
        return Cow::Borrowed(find);
    }
    Cow::Owned(Find { projection: in_projection(&find.projection), ..find.clone() })
}

/// Returns a projection that does not see the metadata.
pub(in crate::memory) fn in_projection(projection: &Document) -> Document {
    match names(projection) {
        true => projection.clone(),
        false => projection.iter().map(|(key, value)| (key.clone(), in_field(value))).collect(),
    }
}

/// The value of a field in a projection; `$elemMatch` is a filter, and its strings are values.
fn in_field(value: &Bson) -> Bson {
    match value {
        Bson::Document(fields) if fields.contains_key("$elemMatch") => value.clone(),
        value => in_expression(value),
    }
}

/// Returns an update that does not see the metadata, and leaves it as it is.
pub(in crate::memory) fn in_update(update: &UpdateSpec) -> UpdateSpec {
    match update {
        UpdateSpec::Document(_) => update.clone(),
        UpdateSpec::Pipeline(stages) => UpdateSpec::Pipeline(stages.iter().map(in_update_stage).collect()),
    }
}

/// Returns whether it is written as something else than a document: a mistake, which is said as it is.
fn is_no_root(root: &Bson) -> bool {
    match root {
        Bson::Document(_) => false,
        Bson::String(text) => !text.starts_with('$'),
        _ => true,
    }
}

fn in_update_stage(stage: &Document) -> Document {
    if names(stage) {
        return stage.clone();
    }
    let keeping = |root: &Bson| doc! { "$setField": { "field": INFO, "input": in_expression(root), "value": format!("${INFO}") } };
    let rewritten = |(name, argument): (&String, &Bson)| {
        let argument = match (name.as_str(), argument) {
            ("$replaceWith", root) if is_no_root(root) => root.clone(),
            ("$replaceWith", root) => keeping(root).into(),
            ("$replaceRoot", Bson::Document(spec)) if spec.len() == 1 => match spec.get("newRoot") {
                Some(root) if !is_no_root(root) => doc! { "newRoot": keeping(root) }.into(),
                _ => argument.clone(),
            },
            ("$project", Bson::Document(fields)) if is_inclusion(fields) => {
                let mut fields: Document =
                    fields.iter().map(|(key, value)| (key.clone(), in_expression(value))).collect();
                fields.insert(INFO, 1);
                fields.into()
            }
            (_, argument) => in_expression(argument),
        };
        (name.clone(), argument)
    };
    stage.iter().map(rewritten).collect()
}

/// Returns a pipeline that removes the metadata before a stage could see it; its documents come from a stage in front of
/// these. The results of an inner pipeline are seen by the stages around it.
pub(in crate::memory) fn in_stages(mut stages: Vec<Document>, is_inner: bool) -> Vec<Document> {
    stages.last_mut().into_iter().for_each(in_merge);
    if stages.iter().any(writes) {
        return stages;
    }
    let named = stages.iter().rposition(names_own).map_or(0, |place| place + 1);
    let first = stages.iter().skip(named).position(|stage| !is_of(stage, &PASSING)).map(|place| place + named);
    match first.map(|place| (place, stages.get(place))) {
        Some((_, Some(stage))) if is_of(stage, &CONSUMING) || is_projection(stage) => {}
        Some((place, _)) => stages.insert(place, doc! { "$unset": INFO }),
        None if is_inner => stages.push(doc! { "$unset": INFO }),
        None => {}
    }
    stages
}

/// The pipeline by which `$merge` changes what is there does not see the metadata, and leaves it as it is.
fn in_merge(stage: &mut Document) {
    let Ok(merge) = stage.get_document_mut("$merge") else { return };
    let Ok(matched) = merge.get_array_mut("whenMatched") else { return };
    for stage in matched {
        if let Bson::Document(stage) = stage {
            *stage = in_update_stage(stage);
        }
    }
}

/// Adds the date at which documents are inserted in front of a final `$out`.
pub(in crate::memory) fn date_results(stages: &mut Vec<Document>, at: DateTime) {
    if stages.last().is_some_and(|stage| stage.contains_key("$out")) {
        stages.insert(stages.len() - 1, doc! { "$set": { info_path(INSERTED): at } });
    }
}

/// Returns the stage that removes the metadata of the documents in an array.
pub(in crate::memory) fn in_array(path: &str) -> Document {
    let plain = doc! { "$unsetField": { "field": INFO, "input": "$$this" } };
    doc! { "$set": { path: { "$map": { "input": format!("${path}"), "in": plain } } } }
}

/// Whether a stage is one of these, and does not see whole documents.
fn is_of(stage: &Document, names: &[&str]) -> bool {
    stage.iter().all(|(name, argument)| names.contains(&name.as_str()) && !sees_all(argument))
}

fn is_projection(stage: &Document) -> bool {
    stage.get_document("$project").is_ok_and(|fields| is_inclusion(fields) && !fields.values().any(sees_all))
}

/// Whether a projection gives only what it names. Nested fields may be excluded; then it is not known here.
fn is_inclusion(fields: &Document) -> bool {
    fields.iter().filter(|(name, _)| *name != "_id").any(|(_, value)| match value {
        Bson::Boolean(is_wanted) => *is_wanted,
        Bson::Int32(number) => *number != 0,
        Bson::Int64(number) => *number != 0,
        Bson::Double(number) => *number != 0.0,
        Bson::String(_) => true,
        Bson::Document(inner) => inner.keys().next().is_some_and(|name| name.starts_with('$')),
        _ => false,
    })
}

/// Whether an argument has an operator or a variable that is about the whole document.
fn sees_all(value: &Bson) -> bool {
    match value {
        Bson::String(text) => is_root(text),
        Bson::Array(items) => items.iter().any(sees_all),
        Bson::Document(fields) => fields.iter().any(|(name, value)| SEEING.contains(&name.as_str()) || sees_all(value)),
        _ => false,
    }
}

/// Whether a stage gives documents metadata of the application's: that is kept, also in a collection that `$out` writes.
fn writes(stage: &Document) -> bool {
    ["$set", "$addFields", "$project"].iter().any(|name| {
        let fields = stage.get_document(name);
        fields.is_ok_and(|fields| fields.keys().any(|path| path.split('.').next() == Some(INFO)))
    })
}

/// Whether a stage names the metadata of its own documents; those of the collection that it joins are another matter.
fn names_own(stage: &Document) -> bool {
    stage.iter().any(|(name, argument)| match (name.as_str(), argument) {
        ("$lookup" | "$graphLookup" | "$unionWith", Bson::Document(spec)) => {
            let foreign = ["pipeline", "foreignField", "connectToField", "connectFromField", "restrictSearchWithMatch"];
            spec.iter().any(|(key, value)| !foreign.contains(&key.as_str()) && is_named(value))
        }
        _ => is_named(argument),
    })
}

/// Whether a key, a path or a variable is about the metadata.
fn names(document: &Document) -> bool {
    document.iter().any(|(key, value)| key.contains(INFO) || is_named(value))
}

fn is_named(value: &Bson) -> bool {
    match value {
        Bson::String(text) => text.contains(INFO),
        Bson::Array(items) => items.iter().any(is_named),
        Bson::Document(fields) => names(fields),
        _ => false,
    }
}

/// An expression in which `$$ROOT` is the document without its metadata.
fn in_expression(expression: &Bson) -> Bson {
    if !sees_all(expression) || is_named(expression) {
        return expression.clone();
    }
    rewritten(expression, binds_current(expression)).into_owned()
}

fn rewritten(expression: &Bson, is_bound: bool) -> Cow<'_, Bson> {
    match expression {
        Bson::String(text) if is_root(text) && !(is_bound && text == "$$CURRENT") => {
            Cow::Owned(doc! { "$unsetField": { "field": INFO, "input": text } }.into())
        }
        Bson::Array(items) => {
            Cow::Owned(Bson::Array(items.iter().map(|item| rewritten(item, is_bound).into_owned()).collect()))
        }
        Bson::Document(fields) => {
            let field = |(name, value): (&String, &Bson)| match name.as_str() {
                "$literal" => (name.clone(), value.clone()),
                _ => (name.clone(), rewritten(value, is_bound).into_owned()),
            };
            Cow::Owned(Bson::Document(fields.iter().map(field).collect()))
        }
        other => Cow::Borrowed(other),
    }
}

/// Whether `$let` gives `$$CURRENT` another value.
fn binds_current(expression: &Bson) -> bool {
    match expression {
        Bson::Array(items) => items.iter().any(binds_current),
        Bson::Document(fields) => fields.iter().any(|(name, value)| name == "CURRENT" || binds_current(value)),
        _ => false,
    }
}

fn is_root(text: &str) -> bool {
    text == "$$ROOT" || text == "$$CURRENT"
}

/// A schema that allows the metadata where it allows no other keys, and does not count it.
fn in_schema(schema: &Document) -> Document {
    let mut schema = schema.clone();
    if names(&schema) {
        return schema;
    }
    if schema.contains_key("additionalProperties")
        && let Bson::Document(properties) =
            schema.entry("properties".to_owned()).or_insert_with(|| Document::new().into())
    {
        properties.insert(INFO, Document::new());
    }
    for keyword in ["minProperties", "maxProperties"] {
        // What is no number is refused as it is.
        let Some(one_more) = schema.get(keyword).and_then(one_more) else { continue };
        let Some(count) = schema.remove(keyword) else { continue };
        let either = doc! { "anyOf": [
            { "required": [INFO], keyword: one_more },
            { "not": { "required": [INFO] }, keyword: count },
        ] };
        if let Bson::Array(all) = schema.entry("allOf".to_owned()).or_insert_with(|| Vec::<Bson>::new().into()) {
            all.push(either.into());
        }
    }
    schema
}

/// A count of properties, and one more.
fn one_more(count: &Bson) -> Option<Bson> {
    match count {
        Bson::Int32(count) if *count >= 0 => Some(Bson::Int64(i64::from(*count) + 1)),
        Bson::Int64(count) if *count >= 0 => count.checked_add(1).map(Bson::Int64),
        Bson::Double(count) if *count >= 0.0 && *count < 1e15 && count.fract() == 0.0 => {
            Some(Bson::Double(count + 1.0))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hidden() -> Document {
        doc! { "$unset": INFO }
    }

    #[test]
    fn the_metadata_goes_before_the_first_stage_that_sees_it() {
        let push = doc! { "$group": { "_id": null, "all": { "$push": "$$ROOT" } } };
        let sort = doc! { "$sort": { "a": 1 } };
        let out = doc! { "$out": "x" };
        let stages = |stages: &[&Document]| stages.iter().map(|stage| (*stage).clone()).collect::<Vec<_>>();
        for (given, expected) in [
            (vec![&sort, &push], vec![&sort, &hidden(), &push]),
            (vec![&out], vec![&hidden(), &out]),
            (vec![&sort], vec![&sort]),
            (vec![&doc! { "$group": { "_id": "$a" } }, &out], vec![&doc! { "$group": { "_id": "$a" } }, &out]),
            (vec![&doc! { "$project": { "a": 1 } }, &push], vec![&doc! { "$project": { "a": 1 } }, &push]),
            (vec![&doc! { "$project": { "a": 0 } }], vec![&hidden(), &doc! { "$project": { "a": 0 } }]),
            (
                vec![&doc! { "$set": { "t": "$_robmem_info.inserted" } }, &push],
                vec![&doc! { "$set": { "t": "$_robmem_info.inserted" } }, &hidden(), &push],
            ),
            (
                vec![&doc! { "$set": { "_robmem_info.persistent": false } }, &out],
                vec![&doc! { "$set": { "_robmem_info.persistent": false } }, &out],
            ),
        ] {
            assert_eq!(in_stages(stages(&given), false), stages(&expected));
        }
        assert_eq!(in_stages(stages(&[&sort]), true), [sort, hidden()]);
    }

    #[test]
    fn the_root_of_an_expression_is_the_document_without_metadata() {
        let root = doc! { "$unsetField": { "field": INFO, "input": "$$ROOT" } };
        for (given, expected) in [
            (doc! { "$eq": ["$$ROOT", 1] }, doc! { "$eq": [root.clone(), 1] }),
            (doc! { "$literal": "$$ROOT" }, doc! { "$literal": "$$ROOT" }),
            (doc! { "$eq": ["$$ROOT.a", "$b"] }, doc! { "$eq": ["$$ROOT.a", "$b"] }),
            (doc! { "$eq": ["$$ROOT", "$_robmem_info"] }, doc! { "$eq": ["$$ROOT", "$_robmem_info"] }),
            (
                doc! { "$let": { "vars": { "CURRENT": "$a" }, "in": ["$$CURRENT", "$$ROOT"] } },
                doc! { "$let": { "vars": { "CURRENT": "$a" }, "in": ["$$CURRENT", root.clone()] } },
            ),
        ] {
            let filter = doc! { "$or": [{ "a": "$$ROOT", "$expr": given }] };
            assert_eq!(in_filter(&filter), doc! { "$or": [{ "a": "$$ROOT", "$expr": expected }] });
        }
    }

    #[test]
    fn an_update_keeps_the_metadata_of_the_document_that_it_replaces() {
        let updated = |stage: Document| match in_update(&UpdateSpec::Pipeline(vec![stage])) {
            UpdateSpec::Pipeline(stages) => stages,
            UpdateSpec::Document(document) => vec![document],
        };
        let root = doc! { "$unsetField": { "field": INFO, "input": "$$ROOT" } };
        let kept = doc! { "$setField": { "field": INFO, "input": root, "value": "$_robmem_info" } };
        let replaced = doc! { "$replaceWith": kept };
        let expected = vec![replaced.clone()];
        assert_eq!(updated(doc! { "$replaceWith": "$$ROOT" }), expected);
        assert_eq!(updated(replaced), expected);
        assert_eq!(updated(doc! { "$project": { "a": 1 } }), [doc! { "$project": { "a": 1, INFO: 1 } }]);
    }
}
