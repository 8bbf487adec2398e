//! The queries of a pipeline: on its own collection, and on those it looks up.

use bson::{Bson, Document, doc};

use super::view::View;
use crate::memory::hidden_metadata;
use crate::query::is_empty_match;
use crate::store::Namespace;

/// Stages that have to be the first of a pipeline.
const FIRST_ONLY: [&str; 11] = [
    "$changeStream",
    "$collStats",
    "$currentOp",
    "$documents",
    "$geoNear",
    "$indexStats",
    "$listLocalSessions",
    "$listSessions",
    "$planCacheStats",
    "$search",
    "$searchMeta",
];

/// The queries that a pipeline asks, each with its namespace: the `$match` in
/// front, or everything; and so for the collections that it looks up.
pub(in crate::memory) fn questions(ns: &Namespace, stages: &[Document]) -> Vec<(Namespace, Document)> {
    let mut asked = Vec::new();
    if !stages.first().is_some_and(brings_documents) {
        asked.push((ns.clone(), first_match(stages)));
    }
    for (name, argument) in stages.iter().flatten() {
        match (name.as_str(), argument) {
            ("$lookup" | "$unionWith", Bson::Document(spec)) => {
                let inner = spec.get_array("pipeline").map(|stages| documents(stages)).unwrap_or_default();
                match origin(ns, spec.get("from").or(spec.get("coll"))) {
                    Some(other) => asked.extend(questions(&other, &inner)),
                    None => asked.extend(questions(ns, &inner).into_iter().skip(1)),
                }
            }
            ("$unionWith", name) => asked.extend(origin(ns, Some(name)).map(|other| (other, Document::new()))),
            ("$graphLookup", Bson::Document(spec)) => {
                let filter = spec.get_document("restrictSearchWithMatch").cloned().unwrap_or_default();
                asked.extend(origin(ns, spec.get("from")).map(|other| (other, filter)));
            }
            ("$facet", Bson::Document(facets)) => {
                for inner in facets.values().filter_map(Bson::as_array) {
                    // Their own collection is the one that is asked already.
                    asked.extend(questions(ns, &documents(inner)).into_iter().skip(1));
                }
            }
            _ => {}
        }
    }
    asked
}

/// The collection that a pipeline writes to, where it does.
pub(in crate::memory) fn target(ns: &Namespace, stages: &[Document]) -> Option<Namespace> {
    let (name, argument) = stages.last()?.iter().next()?;
    match (name.as_str(), argument) {
        ("$out", target) => origin(ns, Some(target)),
        ("$merge", Bson::Document(spec)) => origin(ns, spec.get("into")),
        ("$merge", target) => origin(ns, Some(target)),
        _ => None,
    }
}

/// The pipeline over the documents that are seen, in its own collection and in others. The stages see no metadata
/// unless it `is_shown`.
pub(in crate::memory) fn visible_stages(
    ns: &Namespace,
    stages: &[Document],
    view: &View,
    is_shown: bool,
) -> Vec<Document> {
    let mut stages = seen_stages(ns, stages, Sight { view, is_shown, is_inner: false });
    hidden_metadata::date_results(&mut stages, view.time());
    stages
}

/// What the stages of a pipeline see.
#[derive(Clone, Copy)]
struct Sight<'a> {
    view: &'a View,
    /// Whether they see the metadata.
    is_shown: bool,
    /// Whether it is a pipeline within another.
    is_inner: bool,
}

fn seen_stages(ns: &Namespace, stages: &[Document], sight: Sight<'_>) -> Vec<Document> {
    let view = sight.view;
    // An empty filter in front changes nothing, but would hide `$geoNear`, which may follow it. The others may not.
    let empty = stages.iter().take_while(|stage| is_empty_match(stage)).count();
    let has_to_be_first = |name: &String| name != "$geoNear" && FIRST_ONLY.contains(&name.as_str());
    if empty > 0 && stages.get(empty).is_some_and(|stage| stage.keys().any(has_to_be_first)) {
        return stages.to_vec();
    }
    let mut stages: Vec<Document> =
        stages.iter().skip(empty).flat_map(|stage| with_visible_others(ns, stage, sight)).collect();
    match stages.first_mut().and_then(|stage| stage.iter_mut().next()) {
        Some((name, Bson::Document(filter))) if name == "$match" => *filter = view.filter(filter),
        Some((name, Bson::Document(near))) if name == "$geoNear" => {
            let query = near.get_document("query").cloned().unwrap_or_default();
            near.insert("query", view.filter(&query));
        }
        Some((name, _)) if FIRST_ONLY.contains(&name.as_str()) => return stages,
        _ => stages.insert(0, doc! { "$match": view.visible() }),
    }
    if sight.is_shown {
        return stages;
    }
    let rest = stages.split_off(1);
    stages.extend(hidden_metadata::in_stages(rest, sight.is_inner));
    stages
}

/// A stage that looks other collections up, at what is seen of them, and perhaps one that hides the metadata of what it
/// found. What is not written as it should be stays as it is: the store complains about it.
fn with_visible_others(ns: &Namespace, stage: &Document, sight: Sight<'_>) -> Vec<Document> {
    let (mut stage, mut after) = (stage.clone(), None);
    let (view, inside) = (sight.view, Sight { is_inner: true, ..sight });
    for (name, argument) in stage.iter_mut() {
        match (name.as_str(), &mut *argument) {
            ("$lookup" | "$unionWith", Bson::Document(spec)) => {
                let Some(other) = origin(ns, spec.get("from").or(spec.get("coll"))) else { continue };
                match spec.get("pipeline") {
                    Some(Bson::Array(inner)) if inner.iter().all(|stage| stage.as_document().is_some()) => {
                        spec.insert("pipeline", seen_stages(&other, &documents(inner), inside));
                    }
                    None if !spec.contains_key("let") => {
                        spec.insert("pipeline", seen_stages(&other, &[], inside));
                    }
                    _ => {}
                }
            }
            ("$unionWith", Bson::String(collection)) => {
                let pipeline = seen_stages(ns, &[], inside);
                *argument = doc! { "coll": &*collection, "pipeline": pipeline }.into();
            }
            ("$graphLookup", Bson::Document(spec)) => {
                if origin(ns, spec.get("from")).is_none() {
                    continue;
                }
                match spec.get("restrictSearchWithMatch") {
                    Some(Bson::Document(filter)) => {
                        let filter = view.filter(filter);
                        spec.insert("restrictSearchWithMatch", filter);
                    }
                    None => {
                        spec.insert("restrictSearchWithMatch", view.visible());
                    }
                    Some(_) => {}
                }
                let path = spec.get_str("as").ok().filter(|path| !path.starts_with('$'));
                after = path.filter(|_| !sight.is_shown).map(hidden_metadata::in_array);
            }
            ("$facet", Bson::Document(facets)) => {
                for (_, inner) in facets.iter_mut() {
                    if let Bson::Array(stages) = inner {
                        let seen = |stage: &Bson| match stage {
                            Bson::Document(stage) => {
                                with_visible_others(ns, stage, sight).into_iter().map(Bson::from).collect()
                            }
                            other => vec![other.clone()],
                        };
                        *stages = stages.iter().flat_map(seen).collect();
                    }
                }
            }
            _ => {}
        }
    }
    std::iter::once(stage).chain(after).collect()
}

fn brings_documents(stage: &Document) -> bool {
    stage.keys().next().is_some_and(|name| FIRST_ONLY.contains(&name.as_str()) && name != "$geoNear")
}

fn first_match(stages: &[Document]) -> Document {
    let matched = |stage: &Document| match stage.get_document("$geoNear") {
        Ok(near) => near.get_document("query").ok().cloned(),
        Err(_) => stage.get_document("$match").ok().cloned(),
    };
    stages.first().and_then(matched).unwrap_or_default()
}

fn documents(stages: &[Bson]) -> Vec<Document> {
    stages.iter().filter_map(Bson::as_document).cloned().collect()
}

/// The collection that a stage names.
fn origin(ns: &Namespace, name: Option<&Bson>) -> Option<Namespace> {
    match name? {
        Bson::String(collection) => Some(Namespace { database: ns.database.clone(), collection: collection.clone() }),
        Bson::Document(spec) => Some(Namespace {
            database: spec.get_str("db").ok()?.to_owned(),
            collection: spec.get_str("coll").ok()?.to_owned(),
        }),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::DateTime;

    fn ns(text: &str) -> Namespace {
        Namespace::parse(text).unwrap()
    }

    #[test]
    fn a_pipeline_asks_its_first_match_and_what_it_looks_up() {
        let stages = [
            doc! { "$match": { "a": 1 } },
            doc! { "$lookup": { "from": "x", "pipeline": [{ "$match": { "b": 2 } }], "as": "x" } },
            doc! { "$lookup": { "from": "y", "localField": "a", "foreignField": "b", "as": "y" } },
            doc! { "$unionWith": "z" },
            doc! { "$facet": { "f": [{ "$graphLookup": { "from": "w", "restrictSearchWithMatch": { "c": 3 } } }] } },
        ];
        let asked = questions(&ns("d.c"), &stages);
        let expected = [
            (ns("d.c"), doc! { "a": 1 }),
            (ns("d.x"), doc! { "b": 2 }),
            (ns("d.y"), doc! {}),
            (ns("d.z"), doc! {}),
            (ns("d.w"), doc! { "c": 3 }),
        ];
        assert_eq!(asked, expected);
        assert_eq!(questions(&ns("d.c"), &[doc! { "$documents": [] }]), []);
        assert_eq!(questions(&ns("d.c"), &[doc! { "$sort": { "a": 1 } }]), [(ns("d.c"), doc! {})]);
    }

    #[test]
    fn what_has_decayed_is_not_looked_up() {
        let view = View::at(DateTime::from_millis(7));
        let visible = view.visible();
        let stages = [
            doc! { "$match": { "a": 1 } },
            doc! { "$lookup": { "from": "x", "pipeline": [{ "$sort": { "b": 1 } }], "as": "x" } },
            doc! { "$unionWith": "x" },
            doc! { "$facet": { "f": [{ "$graphLookup": { "from": "x", "as": "x" } }] } },
        ];
        let seen = visible_stages(&ns("d.c"), &stages, &view, true);
        let only = doc! { "$match": visible.clone() };
        assert_eq!(
            seen,
            [
                doc! { "$match": { "$and": [{ "a": 1 }, visible.clone()] } },
                doc! { "$lookup": { "from": "x", "pipeline": [only.clone(), { "$sort": { "b": 1 } }], "as": "x" } },
                doc! { "$unionWith": { "coll": "x", "pipeline": [only] } },
                doc! { "$facet": { "f": [{ "$graphLookup": { "from": "x", "as": "x", "restrictSearchWithMatch": visible } }] } },
            ]
        );
        let wrong = [doc! { "$match": 1 }, doc! { "$lookup": { "from": 3, "let": {} } }];
        assert_eq!(visible_stages(&ns("d.c"), &wrong, &view, true)[2..], wrong[1..]);
    }
}
