//! `$facet`: several pipelines over one input.

use bson::{Bson, Document, RawDocumentBuf};

use super::Pipeline;
use super::argument::inner;
use super::documents::{Documents, encode};
use super::run::Run;
use super::stage::Stage;
use crate::query::error::{QueryError, Result};
use crate::query::expression::Scope;
use crate::query::interruption;
use crate::query::limit::Held;
use crate::query::spill::Spool;

/// A compiled `$facet`.
#[derive(Debug)]
pub(super) struct Facet {
    pipelines: Vec<(String, Pipeline)>,
}

/// Stages that stand at the front of a pipeline over a collection, and nowhere else.
const FRONT: [&str; 3] = ["$changeStream", "$collStats", "$indexStats"];

impl Facet {
    pub(super) fn parse(spec: &Document, scope: &Scope, depth: usize) -> Result<Self> {
        if spec.is_empty() {
            return Err(QueryError::invalid(40_169, "the $facet specification must be a non-empty object"));
        }
        let mut pipelines = Vec::new();
        for (name, value) in spec {
            if name.is_empty() || name.starts_with('$') || name.contains('.') {
                let code = match name.as_str() {
                    "" => 15_998,
                    name if name.starts_with('$') => 16_410,
                    _ => 16_412,
                };
                return Err(QueryError::invalid(code, format!("'{name}' cannot be a facet's name")));
            }
            let code = if matches!(value, Bson::Array(_)) { 40_171 } else { 40_170 };
            let stages = inner("$facet", value).map_err(|error| QueryError { code, ..error })?;
            let refused = || QueryError::invalid(40_600, "a stage is not allowed to be used within a $facet stage");
            if stages.iter().flat_map(Document::keys).any(|name| FRONT.contains(&name.as_str())) {
                return Err(refused());
            }
            let pipeline = Pipeline::parse_in(&stages, scope, depth + 1)?;
            if pipeline
                .stages
                .iter()
                .any(|stage| matches!(stage, Stage::Facet(_) | Stage::Documents(_) | Stage::GeoNear(_)))
                || pipeline.stages.iter().any(looks_up_facets)
                || pipeline.first_match().is_some_and(|filter| filter.search().is_some())
            {
                return Err(refused());
            }
            pipelines.push((name.clone(), pipeline));
        }
        Ok(Self { pipelines })
    }

    pub(super) fn run<'a, E: From<QueryError> + 'a>(
        &'a self,
        input: Documents<'a, E>,
        run: &Run<'a, E>,
    ) -> std::result::Result<Vec<RawDocumentBuf>, E> {
        let mut documents = Spool::new(run.spill());
        for document in input {
            documents.push(&document?)?;
        }
        let documents = documents.shared()?;
        let mut results = Document::new();
        for (name, pipeline) in &self.pipelines {
            let copy = documents.documents().map(|document| {
                interruption::check()?;
                Ok(document?)
            });
            let output = pipeline.run_with(Box::new(copy), run.clone());
            results.insert(name.clone(), array(output)?);
        }
        Ok(vec![encode(&results)?])
    }
}

/// Whether a stage joins by a pipeline with `$facet` in it.
fn looks_up_facets(stage: &Stage) -> bool {
    let Stage::Lookup(lookup) = stage else { return false };
    lookup
        .stages()
        .is_some_and(|stages| stages.iter().any(|stage| matches!(stage, Stage::Facet(_)) || looks_up_facets(stage)))
}

/// Collects documents into an array.
///
/// # Errors
/// If they have more than 64 MB, or need too much memory.
pub(super) fn array<E: From<QueryError>>(documents: Documents<'_, E>) -> std::result::Result<Bson, E> {
    let (mut items, mut held) = (Vec::new(), Held::default());
    for document in documents {
        let item = Bson::Document(Document::try_from(document?).map_err(QueryError::from)?);
        held.add(&item)?;
        items.push(item);
    }
    Ok(Bson::Array(items))
}
