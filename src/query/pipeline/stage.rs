//! The compiled stages and their execution.

use bson::{Document, RawDocumentBuf};

use super::Pipeline;
use super::bucket::{AutoBucket, Bucket};
use super::densify::Densify;
use super::documents::{Documents, Origin, deferred, encode, lazy};
use super::facet::Facet;
use super::graph::GraphLookup;
use super::group::Group;
use super::lookup::{Lookup, Union};
use super::near::GeoNear;
use super::redact::Redact;
use super::run::Run;
use super::unset;
use super::unwind::Unwind;
use super::window::Window;
use crate::query::element::field;
use crate::query::error::QueryError;
use crate::query::expression::Expression;
use crate::query::filter::{Context, Filter};
use crate::query::random::random;
use crate::query::reshape::Reshape;
use crate::query::sort::Sort;
use crate::query::text::{SCORE, SCORE_NAME};

/// A compiled stage.
#[derive(Debug)]
pub(super) enum Stage {
    Match(Filter),
    Reshape(Reshape),
    /// Leaves fields out at the top of documents.
    Unset(Vec<String>),
    Sort(Sort),
    Limit(u64),
    Skip(u64),
    Count(String),
    Unwind(Unwind),
    Group(Group),
    Bucket(Bucket),
    AutoBucket(AutoBucket),
    Lookup(Box<Lookup>),
    GraphLookup(Box<GraphLookup>),
    Union(Union),
    Facet(Facet),
    Sample(usize),
    Redact(Redact),
    Documents(Expression),
    GeoNear(Box<GeoNear>),
    Window(Window),
    Densify(Box<Densify>),
}

impl Stage {
    /// Returns whether the output for a document depends on no other input document.
    pub(super) fn is_piecewise(&self) -> bool {
        // `$lookup` is left out because it keeps an index of the foreign collection between documents.
        matches!(self, Self::Match(_) | Self::Reshape(_) | Self::Unset(_) | Self::Unwind(_) | Self::Redact(_))
    }

    /// Returns the pipeline within this stage, with its collection where it has one.
    pub(super) fn inner(&self) -> Option<(Option<&Origin>, &Pipeline)> {
        match self {
            Self::Lookup(lookup) => lookup.inner(),
            Self::Union(union) => union.inner(),
            _ => None,
        }
    }

    /// Returns the output of this stage; a sort stops after `limit` documents.
    pub(super) fn run<'a, E: From<QueryError> + 'a>(
        &'a self,
        input: Documents<'a, E>,
        run: &Run<'a, E>,
        limit: Option<u64>,
    ) -> Documents<'a, E> {
        let run = run.clone();
        match self {
            Self::Match(filter) => Box::new(input.filter_map(move |document| match document {
                Ok(document) => {
                    let mut context =
                        Context { now: Some(run.now), variables: Some(&run.variables), ..Context::default() };
                    match filter.matches_with((&*document).into(), &mut context) {
                        Ok(true) => Some(Ok(document)),
                        Ok(false) => None,
                        Err(error) => Some(Err(error.into())),
                    }
                }
                Err(error) => Some(Err(error)),
            })),
            Self::Reshape(reshape) => Box::new(input.map(move |document| {
                let document = document?;
                let mut shaped = reshape.apply(&document, &run.variables, run.now)?;
                if run.is_scored
                    && field(&shaped, SCORE).is_none()
                    && let Some(score) = field(&document, SCORE)
                {
                    shaped.append(SCORE_NAME, score);
                }
                Ok(shaped)
            })),
            Self::Unset(names) => Box::new(input.map(move |document| Ok(unset::without(document?, names)?))),
            Self::Sort(sort) => {
                let limit = limit.and_then(|limit| usize::try_from(limit).ok());
                lazy(move || {
                    let sorted = sort.sort(input, limit, run.spill())?;
                    Ok(Box::new(sorted.map(|document| Ok(document?))))
                })
            }
            Self::Limit(limit) => Box::new(input.take(usize::try_from(*limit).unwrap_or(usize::MAX))),
            Self::Skip(skip) => {
                let mut left = *skip;
                Box::new(input.filter(move |document| {
                    let skipped = left > 0 && document.is_ok();
                    left = left.saturating_sub(1);
                    !skipped
                }))
            }
            Self::Count(name) => deferred(move || count(name, input)),
            Self::Unwind(unwind) => unwind.run(input),
            Self::Group(group) => lazy(move || group.run(input, &run)),
            Self::Bucket(bucket) => deferred(move || bucket.run(input, &run)),
            Self::AutoBucket(bucket) => deferred(move || bucket.run(input, &run)),
            Self::Lookup(lookup) => lookup.run(input, run),
            Self::GraphLookup(lookup) => lookup.run(input, run),
            Self::Union(union) => union.run(input, run),
            Self::Facet(facet) => deferred(move || facet.run(input, &run)),
            Self::Sample(size) => deferred(move || sample(*size, input)),
            Self::Redact(redact) => redact.run(input, run),
            Self::GeoNear(near) => deferred(move || near.run(input, &run)),
            Self::Window(window) => lazy(move || window.run(input, run)),
            Self::Densify(densify) => deferred(move || densify.run(input)),
            Self::Documents(expression) => deferred(move || documents(expression, &run)),
        }
    }
}

fn count<E: From<QueryError>>(name: &str, input: Documents<'_, E>) -> std::result::Result<Vec<RawDocumentBuf>, E> {
    let mut count = 0i64;
    for document in input {
        document?;
        count += 1;
    }
    if count == 0 {
        return Ok(Vec::new());
    }
    let mut document = Document::new();
    document.insert(name, super::accumulator::count(count));
    Ok(vec![encode(&document)?])
}

/// Returns `size` documents chosen at random, in random order.
fn sample<E: From<QueryError>>(size: usize, input: Documents<'_, E>) -> std::result::Result<Vec<RawDocumentBuf>, E> {
    let mut keyed: Vec<(f64, RawDocumentBuf)> = Vec::new();
    for document in input {
        keyed.push((random(), document?));
        if keyed.len() >= size.saturating_mul(2).max(1024) {
            keyed.sort_by(|a, b| a.0.total_cmp(&b.0));
            keyed.truncate(size);
        }
    }
    keyed.sort_by(|a, b| a.0.total_cmp(&b.0));
    keyed.truncate(size);
    Ok(keyed.into_iter().map(|(_, document)| document).collect())
}

fn documents<E: From<QueryError>>(
    expression: &Expression,
    run: &Run<'_, E>,
) -> std::result::Result<Vec<RawDocumentBuf>, E> {
    let empty = Document::new();
    let value = expression.evaluate(&run.environment((&empty).into()))?;
    let Some(bson::Bson::Array(items)) = value else {
        return Err(QueryError::invalid(5_858_203, "$documents must be an array of objects")
            .about("$documents")
            .into());
    };
    items
        .iter()
        .map(|item| match item {
            bson::Bson::Document(document) => Ok(encode(document)?),
            _ => {
                Err(QueryError::invalid(40_228, "an element of $documents is not an object").about("$documents").into())
            }
        })
        .collect()
}
