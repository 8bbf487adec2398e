//! The names of operators and stages, for hints about misspelt and misplaced ones.

use super::error::NameContext;

/// The operators of a filter.
const FILTER: [&str; 37] = [
    "$all",
    "$and",
    "$bitsAllClear",
    "$bitsAllSet",
    "$bitsAnyClear",
    "$bitsAnySet",
    "$comment",
    "$elemMatch",
    "$eq",
    "$exists",
    "$expr",
    "$geoIntersects",
    "$geoWithin",
    "$gt",
    "$gte",
    "$in",
    "$jsonSchema",
    "$lt",
    "$lte",
    "$mod",
    "$ne",
    "$near",
    "$nearSphere",
    "$nin",
    "$nor",
    "$not",
    "$options",
    "$or",
    "$regex",
    "$sampleRate",
    "$size",
    "$text",
    "$type",
    "$where",
    "$within",
    "$alwaysTrue",
    "$alwaysFalse",
];

/// The operators of an update.
const UPDATE: [&str; 15] = [
    "$addToSet",
    "$bit",
    "$currentDate",
    "$inc",
    "$max",
    "$min",
    "$mul",
    "$pop",
    "$pull",
    "$pullAll",
    "$push",
    "$rename",
    "$set",
    "$setOnInsert",
    "$unset",
];

/// The stages of a pipeline.
const STAGES: [&str; 29] = [
    "$addFields",
    "$bucket",
    "$bucketAuto",
    "$collStats",
    "$count",
    "$densify",
    "$documents",
    "$facet",
    "$fill",
    "$geoNear",
    "$graphLookup",
    "$group",
    "$indexStats",
    "$limit",
    "$lookup",
    "$match",
    "$merge",
    "$out",
    "$project",
    "$redact",
    "$replaceRoot",
    "$replaceWith",
    "$sample",
    "$set",
    "$setWindowFields",
    "$skip",
    "$sort",
    "$sortByCount",
    "$unionWith",
];

/// The operators that stand at the top of a filter, and not behind a key.
const TOP: [&str; 10] =
    ["$alwaysFalse", "$alwaysTrue", "$and", "$expr", "$jsonSchema", "$nor", "$or", "$sampleRate", "$text", "$where"];

/// What gathers values in a group, and is no stage.
const GATHERING: [&str; 15] = [
    "$addToSet",
    "$avg",
    "$bottom",
    "$bottomN",
    "$first",
    "$firstN",
    "$last",
    "$lastN",
    "$max",
    "$min",
    "$push",
    "$stdDevPop",
    "$stdDevSamp",
    "$sum",
    "$top",
];

/// The stages that an update may have.
const UPDATE_STAGES: [&str; 6] = ["$addFields", "$project", "$replaceRoot", "$replaceWith", "$set", "$unset"];

/// Returns advice on where a name belongs that is not known where it stands; none where it is known nowhere. `meant` is
/// the condition with the name behind a key that was probably meant, where that is known.
#[must_use]
pub fn misplaced(context: NameContext, name: &str, meant: Option<String>) -> Option<String> {
    let is = |names: &[&str]| names.contains(&name);
    Some(match context {
        NameContext::Filter if name == "$not" => {
            "`$not` stands behind a key: {key: {$not: {$gt: 5}}}; at the top there is {$nor: [{key: 5}]}".to_owned()
        }
        NameContext::Filter if is(&FILTER) => {
            format!("`{name}` stands behind a key: {}", meant.unwrap_or_else(|| behind_key(name)))
        }
        NameContext::Condition if is(&TOP) => format!("`{name}` stands at the top: {}", at_top(name)),
        NameContext::Stage if is(&GATHERING) => {
            format!("`{name}` stands in a stage: [{{$group: {{_id: '$key', name: {{{name}: '$value'}}}}}}]")
        }
        NameContext::Stage if is(&FILTER) => {
            let filter = if is(&TOP) { at_top(name) } else { behind_key(name) };
            format!("`{name}` stands in a query: [{{$match: {filter}}}]")
        }
        NameContext::Update if is(&FILTER) => format!("`{name}` stands in a query, which is in front of the update"),
        NameContext::Update if is(&UPDATE_STAGES) => {
            format!("`{name}` is a stage; an update by stages has brackets: [{{{name}: {{…}}}}]")
        }
        NameContext::Filter | NameContext::Condition | NameContext::Stage if is(&UPDATE) => {
            format!("`{name}` stands in an update: rmem update NS QUERY '{{{name}: {{key: 5}}}}'")
        }
        NameContext::Filter | NameContext::Condition | NameContext::Update if is(&STAGES) => {
            format!("`{name}` is a stage of a pipeline: rmem aggregate NS '[{{{name}: …}}]'")
        }
        _ => return None,
    })
}

/// Returns whether an operator stands behind a key of a filter.
#[must_use]
pub fn is_condition(name: &str) -> bool {
    FILTER.contains(&name) && !TOP.contains(&name)
}

/// A condition with an operator behind a key, as an example.
fn behind_key(name: &str) -> String {
    let value = match name {
        "$in" | "$nin" | "$all" => "[1, 2]",
        "$exists" => "true",
        "$regex" => "'^A'",
        "$type" => "'string'",
        "$mod" => "[2, 0]",
        "$options" => return "{key: {$regex: '^A', $options: 'i'}}".to_owned(),
        "$elemMatch" | "$near" | "$nearSphere" | "$geoWithin" | "$geoIntersects" | "$within" => "{…}",
        _ => "5",
    };
    format!("{{key: {{{name}: {value}}}}}")
}

/// A query with an operator at the top, as an example.
fn at_top(name: &str) -> String {
    let value = match name {
        "$and" | "$or" | "$nor" => "[{a: 1}, {b: 2}]",
        "$expr" => "{$gt: ['$a', '$b']}",
        "$where" => "'this.a > this.b'",
        "$text" => "{$search: 'cup'}",
        "$sampleRate" => "0.5",
        "$alwaysTrue" | "$alwaysFalse" => "1",
        _ => "{…}",
    };
    format!("{{{name}: {value}}}")
}

/// Returns the names that are known at a place, one of which an unknown one may stand for.
#[must_use]
pub fn known_names(context: NameContext) -> &'static [&'static str] {
    match context {
        NameContext::Filter | NameContext::Condition => &FILTER,
        NameContext::Update => &UPDATE,
        NameContext::Stage => &STAGES,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::query::{Filter, Pipeline, QueryError, QueryMistake, Update};
    use bson::doc;

    /// Where the name stands that an error says is unknown; none where it is about something else.
    fn context(error: Option<&QueryError>) -> Option<NameContext> {
        match error?.mistake? {
            QueryMistake::UnknownName(context) => Some(context),
            _ => None,
        }
    }

    #[test]
    fn every_name_is_known() {
        let is_unknown = |error: Option<QueryError>| context(error.as_ref()).is_some();
        for name in FILTER {
            let inner = Filter::parse(&doc! { "a": { name: 1 } }).err();
            assert!(!is_unknown(inner) || !is_unknown(Filter::parse(&doc! { name: 1 }).err()), "{name}");
        }
        for name in UPDATE {
            assert!(!is_unknown(Update::parse(&doc! { name: { "a": 1 } }, &[]).err()), "{name}");
        }
        for name in STAGES {
            assert!(!is_unknown(Pipeline::parse(&[doc! { name: 1 }]).err()), "{name}");
        }
        assert!(is_unknown(Filter::parse(&doc! { "a": { "$exits": 1 } }).err()));
        assert_eq!(known_names(NameContext::Condition), FILTER);
    }

    #[test]
    fn a_name_in_the_wrong_place_has_a_right_one() {
        let advice = |error: Option<QueryError>, name: &str| misplaced(context(error.as_ref())?, name, None);
        let (mut top, mut behind_key) = (0, 0);
        for name in FILTER {
            if let Some(advice) = advice(Filter::parse(&doc! { name: 1 }).err(), name) {
                assert!(advice.starts_with(&format!("`{name}` stands behind a key: {{key: {{")), "{advice}");
                behind_key += 1;
            }
            if let Some(advice) = advice(Filter::parse(&doc! { "a": { name: 1 } }).err(), name) {
                assert!(advice.starts_with(&format!("`{name}` stands at the top: {{{name}: ")), "{advice}");
                top += 1;
            }
            let staged = Pipeline::parse(&[doc! { name: 1 }]).err();
            let staged = staged.filter(|error| context(Some(error)).is_some());
            assert!(staged.is_none() || advice(staged, name).is_some_and(|advice| advice.contains("$match")), "{name}");
        }
        assert_eq!((top, behind_key), (TOP.len(), FILTER.len() - TOP.len() - 1), "all but $comment");
        for name in UPDATE {
            assert!(advice(Filter::parse(&doc! { name: { "a": 1 } }).err(), name).is_some(), "{name}");
            assert!(advice(Filter::parse(&doc! { "a": { name: 1 } }).err(), name).is_some(), "{name}");
        }
        for name in STAGES.iter().filter(|name| !UPDATE.contains(name)) {
            let modified = Update::parse(&doc! { *name: { "a": 1 } }, &[]).err();
            assert!(advice(modified, name).is_some(), "{name}");
        }
        assert_eq!(misplaced(NameContext::Filter, "$nope", None), None);
        assert_eq!(advice(Filter::parse(&doc! { "$or": 1 }).err(), "$or"), None);
    }
}
