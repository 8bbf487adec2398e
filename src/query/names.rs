//! The names of operators and stages, for hints about misspelt ones.

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

/// Returns the names that an unknown one may stand for, by the message about it; none where the message is about something else.
#[must_use]
pub fn known_names(message: &str) -> &'static [&'static str] {
    let kinds: [(&str, &[&str]); 4] = [
        ("unknown operator: ", &FILTER),
        ("unknown top level operator: ", &FILTER),
        ("unknown modifier: ", &UPDATE),
        ("unrecognized pipeline stage name: ", &STAGES),
    ];
    kinds.iter().find(|(words, _)| message.starts_with(words)).map_or(&[], |(_, names)| names)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::query::{Filter, Pipeline, Update};
    use bson::doc;

    #[test]
    fn every_name_is_known() {
        let unknown = |message: Option<String>| message.is_some_and(|message| !known_names(&message).is_empty());
        for name in FILTER {
            let inner = Filter::parse(&doc! { "a": { name: 1 } }).err().map(|error| error.message);
            let top = Filter::parse(&doc! { name: 1 }).err().map(|error| error.message);
            assert!(!unknown(inner) || !unknown(top), "{name}");
        }
        for name in UPDATE {
            assert!(
                !unknown(Update::parse(&doc! { name: { "a": 1 } }, &[]).err().map(|error| error.message)),
                "{name}"
            );
        }
        for name in STAGES {
            assert!(!unknown(Pipeline::parse(&[doc! { name: 1 }]).err().map(|error| error.message)), "{name}");
        }
        assert_eq!(known_names("unknown operator: $exits"), FILTER);
    }
}
