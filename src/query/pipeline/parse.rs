//! Parses stages.

use bson::{Bson, Document};

use super::bucket::{AutoBucket, Bucket};
use super::densify::Densify;
use super::description::{is_description, misplaced};
use super::facet::Facet;
use super::fill;
use super::graph::GraphLookup;
use super::group::Group;
use super::lookup::{Lookup, Union};
use super::near::GeoNear;
use super::output::Output;
use super::redact::Redact;
use super::stage::Stage;
use super::unset::plain_names;
use super::unwind::Unwind;
use super::window::Window;
use crate::query::decimal::Rounding;
use crate::query::error::{NameContext, QueryError, QueryMistake, Result};
use crate::query::expression::{Expression, Scope};
use crate::query::filter::{Filter, Parser};
use crate::query::number::Number;
use crate::query::reshape::{Reshape, object};
use crate::query::sort::Sort;

/// The most stages of a pipeline.
const MAX_STAGES: usize = 1000;
/// How deep pipelines may contain pipelines.
const MAX_DEPTH: usize = 20;

/// Stages of MongoDB that rmem refuses by name.
const REFUSED: [&str; 18] = [
    "$changeStream",
    "$changeStreamSplitLargeEvent",
    "$currentOp",
    "$listCatalog",
    "$listClusterCatalog",
    "$listLocalSessions",
    "$listSessions",
    "$listSampledQueries",
    "$planCacheStats",
    "$search",
    "$searchMeta",
    "$vectorSearch",
    "$querySettings",
    "$queryStats",
    "$rankFusion",
    "$scoreFusion",
    "$shardedDataDistribution",
    "$operationMetrics",
];

/// Reads all stages; `$out` and `$merge` are given apart.
pub(super) fn stages(documents: &[Document], scope: &Scope, depth: usize) -> Result<(Vec<Stage>, Option<Output>)> {
    if documents.len() > MAX_STAGES {
        return Err(QueryError::invalid(7_749_501, "a pipeline has more than 1000 stages"));
    }
    if depth > MAX_DEPTH {
        return Err(QueryError::invalid(232, "the maximum number of nested sub-pipelines exceeded"));
    }
    let mut stages = Vec::with_capacity(documents.len());
    let mut output = None;
    for (index, document) in documents.iter().enumerate() {
        let (Some((name, argument)), 1) = (document.iter().next(), document.len()) else {
            let message = "a pipeline stage specification object must contain exactly one field";
            return Err(QueryError::invalid(40_323, message));
        };
        if let Some(found) = Output::parse(name, argument, scope).map_err(|error| error.about(name))? {
            if index + 1 != documents.len() {
                return Err(QueryError::invalid(40_601, format!("{name} can only be the final stage in the pipeline"))
                    .about(name));
            }
            output = Some(found);
            continue;
        }
        if name == "$geoNear" && !documents.iter().take(index).all(is_empty_match) {
            return Err(QueryError::invalid(40_603, "$geoNear must be the first stage of a pipeline").about(name));
        }
        if matches!(name.as_str(), "$documents" | "$changeStream") && index > 0 {
            let message = format!("{name} is only valid as the first stage in a pipeline");
            return Err(QueryError::invalid(40_602, message).about(name));
        }
        if is_description(name) {
            return Err(misplaced(name, index));
        }
        let is_first = documents.iter().take(index).all(is_empty_match);
        stage(name, argument, scope, Position { depth, is_first }, &mut stages).map_err(|error| error.about(name))?;
    }
    drop_resorted(&mut stages);
    if depth == 0 {
        place_lookups(&mut stages);
    }
    Ok((stages, output))
}

/// Where a stage is.
#[derive(Debug, Clone, Copy)]
struct Position {
    depth: usize,
    /// Whether nothing is done before it.
    is_first: bool,
}

fn stage(name: &str, argument: &Bson, scope: &Scope, place: Position, stages: &mut Vec<Stage>) -> Result<()> {
    let Position { depth, is_first } = place;
    if let Some(reshape) = Reshape::parse(name, argument, scope)? {
        let plain = if name == "$unset" { plain_names(argument) } else { None };
        stages.push(plain.map_or(Stage::Reshape(reshape), Stage::Unset));
        return Ok(());
    }
    let stage = match name {
        "$match" => {
            Stage::Match(Filter::parse_with(object(name, argument)?, &Parser::with_scope(scope).of_stage(is_first))?)
        }
        "$sort" => {
            let pattern = object(name, argument)?;
            if pattern.is_empty() {
                return Err(QueryError::invalid(15_976, "$sort stage must have at least one sort key"));
            }
            if let Some(name) = pattern.keys().find(|name| name.starts_with('$')) {
                return Err(
                    QueryError::invalid(16_410, format!("$sort takes paths of fields, not `{name}`")).about(name)
                );
            }
            Stage::Sort(Sort::parse(pattern)?)
        }
        "$limit" if Number::of(argument).and_then(Number::integral) == Some(0) => {
            return Err(QueryError::invalid(15_958, "the limit must be positive"));
        }
        "$limit" => Stage::Limit(positive(name, argument, 1)?),
        "$skip" => Stage::Skip(positive(name, argument, 0)?),
        "$count" => Stage::Count(count_name(argument)?),
        "$unwind" => Stage::Unwind(Unwind::parse(argument)?),
        "$group" => Stage::Group(Group::parse(object(name, argument)?, scope)?),
        "$sortByCount" => {
            let key = match argument {
                Bson::String(path) if path.starts_with('$') => argument,
                Bson::Document(inner) if inner.keys().next().is_some_and(|key| key.starts_with('$')) => argument,
                wrong => {
                    let code = match wrong {
                        Bson::Document(_) => 40_147,
                        Bson::String(_) => 40_148,
                        _ => 40_149,
                    };
                    return Err(QueryError::invalid(code, "the sortByCount field must be a $-path or an expression"));
                }
            };
            stages.push(Stage::Group(Group::counting(Expression::parse_in(key, scope)?)));
            let mut pattern = Document::new();
            pattern.insert("count", -1);
            Stage::Sort(Sort::parse(&pattern)?)
        }
        "$bucket" => Stage::Bucket(Bucket::parse(object(name, argument)?, scope)?),
        "$bucketAuto" => Stage::AutoBucket(AutoBucket::parse(object(name, argument)?, scope)?),
        "$lookup" => Stage::Lookup(Box::new(Lookup::parse(object(name, argument)?, scope, depth)?)),
        "$graphLookup" => Stage::GraphLookup(Box::new(GraphLookup::parse(object(name, argument)?, scope)?)),
        "$unionWith" => Stage::Union(Union::parse(argument, scope, depth)?),
        "$facet" => Stage::Facet(Facet::parse(object(name, argument)?, scope, depth)?),
        "$sample" => Stage::Sample(sample_size(object(name, argument)?)?),
        "$redact" => Stage::Redact(Redact::parse(argument, scope)?),
        "$geoNear" => Stage::GeoNear(Box::new(GeoNear::parse(argument, scope)?)),
        "$setWindowFields" => Stage::Window(Window::parse(object(name, argument)?, scope)?),
        "$densify" => Stage::Densify(Box::new(Densify::parse(object(name, argument)?)?)),
        "$fill" => {
            stages.extend(fill::stages(object(name, argument)?, scope)?);
            return Ok(());
        }
        "$documents" => Stage::Documents(Expression::parse_in(argument, scope)?),
        _ if REFUSED.contains(&name) => return Err(QueryError::unsupported(name)),
        _ => {
            let error = QueryError::invalid(40_324, format!("unrecognized pipeline stage name: '{name}'"));
            return Err(error.of_kind(QueryMistake::UnknownName(NameContext::Stage)));
        }
    };
    stages.push(stage);
    Ok(())
}

/// Drops sorts that a sort follows: of documents that are equal to the second, the first order does not count.
fn drop_resorted(stages: &mut Vec<Stage>) {
    let is_sort = |stage: Option<&Stage>| matches!(stage, Some(Stage::Sort(_)));
    let mut index = 0;
    while index < stages.len() {
        if is_sort(stages.get(index)) && is_sort(stages.get(index + 1)) {
            stages.remove(index);
        } else {
            index += 1;
        }
    }
}

/// Marks the plain `$lookup`s at the front of a pipeline. mongod runs them in its slot-based executor, which puts the
/// new field last. A `$lookup` whose results are unwound at once is not run there.
fn place_lookups(stages: &mut [Stage]) {
    for index in 0..stages.len() {
        let (before, after) = stages.split_at_mut(index + 1);
        match (before.last_mut(), after.first()) {
            (Some(Stage::Lookup(lookup)), next) => {
                let unwound = matches!(next, Some(Stage::Unwind(unwind)) if lookup.is_to(unwind.path()));
                if unwound || !lookup.is_plain() {
                    return;
                }
                lookup.last = true;
            }
            (Some(Stage::Match(_) | Stage::Sort(_) | Stage::Skip(_) | Stage::Limit(_) | Stage::Group(_)), _) => {}
            _ => return,
        }
    }
}

/// Returns whether a stage is `{$match: {}}`, which lets every document through.
#[must_use]
pub fn is_empty_match(stage: &Document) -> bool {
    // A second key is an error, which must not be dropped with the stage.
    stage.len() == 1 && stage.get_document("$match").is_ok_and(Document::is_empty)
}

fn positive(name: &str, argument: &Bson, least: i64) -> Result<u64> {
    Number::of(argument)
        .and_then(Number::integral)
        .filter(|number| *number >= least)
        .and_then(|number| u64::try_from(number).ok())
        .ok_or_else(|| {
            QueryError::invalid(
                5_107_200 + i32::from(name == "$limit"),
                format!("invalid argument to {name} stage: {argument}"),
            )
        })
}

fn count_name(argument: &Bson) -> Result<String> {
    let Bson::String(name) = argument else {
        return Err(QueryError::invalid(40_156, "the count field must be a non-empty string"));
    };
    if name.is_empty() || name.starts_with('$') || name.contains(['\0', '.']) || name == "_id" {
        let code = match name.as_str() {
            name if name.starts_with('$') => 40_158,
            name if name.contains('.') => 40_160,
            _ => 40_157,
        };
        let message = "the count field cannot be empty, start with '$', or contain '.' or NUL";
        return Err(QueryError::invalid(code, message));
    }
    Ok(name.clone())
}

fn sample_size(argument: &Document) -> Result<usize> {
    if let Some(name) = argument.keys().find(|name| *name != "size") {
        return Err(QueryError::invalid(28_748, format!("unrecognized option to $sample: {name}")));
    }
    let size = argument.get("size").ok_or_else(|| QueryError::invalid(28_749, "$sample needs a size"))?;
    let size = Number::of(size).ok_or_else(|| QueryError::invalid(28_746, "the size of $sample must be a number"))?;
    let size = match size {
        Number::Decimal(size) => Number::Decimal(size.round_to(0, Rounding::HalfEven)).to_long(),
        other => other.to_long(),
    };
    usize::try_from(size).map_err(|_| QueryError::invalid(28_747, "the size of $sample may not be negative"))
}

#[cfg(test)]
mod tests {
    use crate::query::Pipeline;
    use bson::{Document, doc};

    fn code(stage: &Document) -> i32 {
        Pipeline::parse(std::slice::from_ref(stage)).map_or_else(|error| error.code, |_| 0)
    }

    #[test]
    fn each_stage_has_its_codes_for_the_wrong_shape() {
        let table = [
            (doc! { "$group": 1 }, 15_947),
            (doc! { "$group": { "_id": 1, "x": 1 } }, 40_234),
            (doc! { "$group": { "_id": 1, "x": { "a": 1 } } }, 40_234),
            (doc! { "$group": { "_id": 1, "a.b": { "$sum": 1 } } }, 40_235),
            (doc! { "$group": { "_id": 1, "x": { "$count": [] } } }, 40_237),
            (doc! { "$group": { "_id": 1, "x": { "$topN": {} } } }, 5_788_003),
            (doc! { "$group": { "_id": 1, "x": { "$firstN": { "input": 1 } } } }, 5_787_906),
            (doc! { "$match": 1 }, 15_959),
            (doc! { "$match": { "a": { "$comment": "x" } } }, 2),
            (doc! { "$match": { "a": { "$size": -1 } } }, 2),
            (doc! { "$sort": { "a": "x" } }, 15_974),
            (doc! { "$sort": { "a": 2 } }, 15_975),
            (doc! { "$sort": { "a": {} } }, 17_312),
            (doc! { "$limit": 0 }, 15_958),
            (doc! { "$limit": "x" }, 5_107_201),
            (doc! { "$sample": { "size": 0 } }, 0),
            (doc! { "$sample": { "size": "x" } }, 28_746),
            (doc! { "$unwind": { "path": 1 } }, 28_808),
            (doc! { "$unwind": { "path": "$a", "includeArrayIndex": "$b" } }, 28_822),
            (doc! { "$count": "a.b" }, 40_160),
            (doc! { "$sortByCount": "a" }, 40_148),
            (doc! { "$facet": { "x": [1] } }, 40_171),
            (doc! { "$bucketAuto": { "groupBy": "$a", "buckets": 0 } }, 40_243),
            (doc! { "$bucket": { "groupBy": 1, "boundaries": [1, 2] } }, 40_202),
            (doc! { "$project": { "a": { "$nothing": 1 } } }, 31_325),
            (doc! { "$project": { "a": { "$add": [{ "$nothing": 1 }] } } }, 168),
            (doc! { "$project": { "a..b": 1 } }, 15_998),
            (doc! { "$addFields": { "a": 1, "a.b": 1 } }, 40_176),
            (doc! { "$replaceRoot": { "newRoot": "$a", "x": 1 } }, 40_415),
            (doc! { "$out": 1 }, 16_990),
            (doc! { "$merge": { "into": 1 } }, 51_178),
            (doc! { "$merge": {} }, 40_414),
        ];
        for (stage, expected) in table {
            assert_eq!(code(&stage), expected, "{stage}");
        }
    }
}
