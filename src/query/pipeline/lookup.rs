//! `$lookup` and `$unionWith`: documents of other collections.

use std::cell::{Cell, OnceCell};
use std::rc::Rc;

use bson::{Bson, Document, RawDocument, RawDocumentBuf, doc};

use super::Pipeline;
use super::argument::{inner, origin, plain_path, target, text};
use super::documents::{Documents, Origin, encode};
use super::facet::array;
use super::foreign::{Foreign, key_of, with_value};
use super::run::Run;
use super::stage::Stage;
use super::unwind::put;
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Expression, Scope, check_name};
use crate::query::path::Path;
use crate::query::view::{Fields, View};

/// A compiled `$lookup`.
#[derive(Debug)]
pub(super) struct Lookup {
    from: Option<Origin>,
    fields: Option<(Path, Path)>,
    bindings: Vec<(usize, Expression)>,
    pipeline: Option<Pipeline>,
    to: Vec<String>,
    /// Whether the field that the results are put in goes last, wherever it was.
    pub(super) last: bool,
}

/// What documents that look for others by an index may cost, before all others are read and kept by their values.
const BY_INDEX: usize = 10_000;
/// What one of them costs, besides one for each value it looks for and one for each document that is read.
const BY_INDEX_ONCE: usize = 9;

/// Returns the keys of the values that a path reaches; of none, null.
fn local_keys(path: &Path, fields: Fields<'_>) -> Vec<Vec<u8>> {
    let mut keys = reached_keys(path, fields);
    if keys.is_empty() {
        keys.push(key_of(None));
    }
    keys
}

/// Returns the keys of the values that a path reaches: of an array, those of its elements.
pub(super) fn reached_keys(path: &Path, fields: Fields<'_>) -> Vec<Vec<u8>> {
    let mut keys = Vec::new();
    path.any(fields, false, &mut |value, _| {
        match value {
            Some(View::Array(items)) => keys.extend(items.iter().map(|item| key_of(Some(item)))),
            Some(value) => keys.push(key_of(Some(value))),
            None => {}
        }
        false
    });
    keys
}

impl Lookup {
    pub(super) fn parse(spec: &Document, scope: &Scope, depth: usize) -> Result<Self> {
        const KNOWN: [&str; 6] = ["from", "localField", "foreignField", "let", "pipeline", "as"];
        if let Some(name) = spec.keys().find(|name| !KNOWN.contains(&name.as_str())) {
            return Err(QueryError::failed_to_parse(format!("unknown argument to $lookup: {name}")));
        }
        let from = spec.get("from").map(|from| origin("$lookup", from)).transpose()?;
        let fields = match (text("$lookup", spec, "localField")?, text("$lookup", spec, "foreignField")?) {
            (Some(local), Some(foreign)) => Some((plain_path(local)?, plain_path(foreign)?)),
            (None, None) => None,
            _ => {
                return Err(QueryError::failed_to_parse(
                    "$lookup requires both or neither of 'localField' and 'foreignField'",
                ));
            }
        };
        let (mut inside, mut bindings) = (scope.clone(), Vec::new());
        match spec.get("let") {
            None => {}
            Some(Bson::Document(variables)) => {
                for (name, value) in variables {
                    check_name(name)?;
                    bindings.push((inside.add(name), Expression::parse_in(value, scope)?));
                }
            }
            Some(_) => return Err(QueryError::failed_to_parse("the 'let' of $lookup must be an object")),
        }
        let pipeline =
            spec.get("pipeline").map(|stages| Pipeline::parse_in(&inner("$lookup", stages)?, &inside, depth + 1));
        let pipeline = pipeline.transpose()?;
        if pipeline.is_none() && (fields.is_none() || spec.contains_key("let")) {
            return Err(QueryError::failed_to_parse(
                "$lookup needs 'pipeline', or 'localField' and 'foreignField' without 'let'",
            ));
        }
        if from.is_none() && !pipeline.as_ref().is_some_and(Pipeline::brings_documents) {
            return Err(QueryError::failed_to_parse("must specify 'from' field for a $lookup"));
        }
        Ok(Self { from, fields, bindings, pipeline, to: target("$lookup", spec)?, last: false })
    }

    /// Returns the stages of its pipeline.
    pub(super) fn stages(&self) -> Option<&[Stage]> {
        self.pipeline.as_ref().map(|pipeline| &*pipeline.stages)
    }

    /// Returns its pipeline, and the collection that is its input.
    pub(super) fn inner(&self) -> Option<(Option<&Origin>, &Pipeline)> {
        Some((self.from.as_ref(), self.pipeline.as_ref()?))
    }

    /// Returns whether it only compares fields, neither of which names an element by its index.
    pub(super) fn is_plain(&self) -> bool {
        let by_name = |path: &Path| path.parts().iter().all(|part| part.index.is_none());
        self.pipeline.is_none()
            && self.fields.as_ref().is_some_and(|(local, foreign)| by_name(local) && by_name(foreign))
    }

    /// Returns whether the results are put at this path.
    pub(super) fn is_to(&self, path: &[String]) -> bool {
        self.to == path
    }

    pub(super) fn run<'a, E: From<QueryError> + 'a>(
        &'a self,
        input: Documents<'a, E>,
        run: Run<'a, E>,
    ) -> Documents<'a, E> {
        let others = Others { all: OnceCell::new(), by_index: Rc::new(Cell::new(BY_INDEX)) };
        Box::new(input.map(move |document| {
            let document = document?;
            let found = self.found(&document, &run, &others)?;
            let mut document = Document::try_from(document).map_err(QueryError::from)?;
            if self.last {
                move_last(&mut document, &self.to);
            }
            put(&mut document, &self.to, found);
            Ok(encode(&document)?)
        }))
    }

    fn found<'a, E: From<QueryError> + 'a>(
        &'a self,
        document: &RawDocumentBuf,
        run: &Run<'a, E>,
        others: &Others<'a>,
    ) -> std::result::Result<Bson, E> {
        let foreign: Documents<'a, E> = match (&self.fields, &self.from) {
            (Some((local, foreign)), Some(from)) => {
                let keys = local_keys(local, (&**document).into());
                match others.indexed(from, foreign, plain_values(local, document), run)? {
                    Some(found) => with_value(found, foreign, keys),
                    None => others.of_values(from, foreign, keys, run)?,
                }
            }
            (None, Some(from)) => run.source(from)?,
            (_, None) => Box::new(std::iter::empty()),
        };
        let Some(pipeline) = &self.pipeline else { return array(foreign) };
        let mut variables = (*run.variables).clone();
        let environment = run.environment((&**document).into());
        for (slot, expression) in &self.bindings {
            variables.set(*slot, expression.evaluate(&environment)?);
        }
        array(pipeline.run_with(foreign, run.with(variables)))
    }
}

/// What the documents before have found of the other collection.
struct Others<'a> {
    /// All documents.
    all: OnceCell<Rc<Foreign<'a>>>,
    /// What is left for documents that look for others by an index, if there is one.
    by_index: Rc<Cell<usize>>,
}

impl<'a> Others<'a> {
    /// The documents that an index finds, and perhaps others; nothing where none does, or too many have asked.
    fn indexed<E: From<QueryError> + 'a>(
        &self,
        from: &Origin,
        foreign: &Path,
        values: Option<Vec<Bson>>,
        run: &Run<'a, E>,
    ) -> std::result::Result<Option<Documents<'a, E>>, E> {
        let left = if foreign.parts().iter().all(|part| part.index.is_none()) { self.by_index.get() } else { 0 };
        let cost = values.as_ref().map(|values| BY_INDEX_ONCE + values.len());
        let Some((values, cost)) = values.zip(cost.filter(|cost| *cost <= left)) else { return Ok(None) };
        let found = run.indexed(from, &doc! { foreign.text(): { "$in": values } })?;
        self.by_index.set(if found.is_some() { left - cost } else { 0 });
        let left = Rc::clone(&self.by_index);
        Ok(found
            .map(|found| Box::new(found.inspect(move |_| left.set(left.get().saturating_sub(1)))) as Documents<'a, E>))
    }

    /// The documents that have one of the values, among all, which are read once.
    fn of_values<E: From<QueryError> + 'a>(
        &self,
        from: &Origin,
        foreign: &'a Path,
        keys: Vec<Vec<u8>>,
        run: &Run<'a, E>,
    ) -> std::result::Result<Documents<'a, E>, E> {
        if self.all.get().is_none() {
            let _ = self.all.set(Foreign::read(run.source(from)?, foreign, true, run.spill())?);
        }
        let found = self.all.get().map(|all| all.find(keys)).transpose()?;
        Ok(Box::new(found.into_iter().flatten().map(|document| Ok(document?))))
    }
}

/// The values that a path reaches, for a filter; nothing where a filter would take one for something else, like a
/// regular expression.
fn plain_values(local: &Path, document: &RawDocument) -> Option<Vec<Bson>> {
    let mut values = Vec::new();
    local.any(document.into(), false, &mut |value, _| {
        match value {
            Some(View::Array(items)) => values.extend(items.iter()),
            value => values.extend(value),
        }
        false
    });
    let is_plain = |value: &View<'_>| {
        matches!(value, View::Number(_) | View::String(_) | View::ObjectId(_) | View::Bool(_) | View::Date(_))
    };
    let is_found = !values.is_empty() && values.iter().all(is_plain);
    is_found.then(|| values.into_iter().map(View::to_bson).collect())
}

/// Moves what is at each part of a path behind the other fields there.
fn move_last(document: &mut Document, path: &[String]) {
    let Some((name, rest)) = path.split_first() else { return };
    let Some(mut value) = document.remove(name) else { return };
    if let Bson::Document(inner) = &mut value {
        move_last(inner, rest);
    }
    document.insert(name, value);
}

/// A compiled `$unionWith`.
#[derive(Debug)]
pub(super) struct Union {
    from: Option<Origin>,
    pipeline: Option<Pipeline>,
}

impl Union {
    /// Returns its pipeline, and the collection that is its input.
    pub(super) fn inner(&self) -> Option<(Option<&Origin>, &Pipeline)> {
        Some((self.from.as_ref(), self.pipeline.as_ref()?))
    }

    pub(super) fn parse(argument: &Bson, scope: &Scope, depth: usize) -> Result<Self> {
        match argument {
            Bson::String(_) => Ok(Self { from: Some(origin("$unionWith", argument)?), pipeline: None }),
            Bson::Document(spec) => {
                if let Some(name) = spec.keys().find(|name| !matches!(name.as_str(), "coll" | "pipeline" | "db")) {
                    return Err(QueryError::failed_to_parse(format!("unknown argument to $unionWith: {name}")));
                }
                let from = spec.get("coll").map(|from| origin("$unionWith", from)).transpose()?;
                let pipeline = spec
                    .get("pipeline")
                    .map(|stages| Pipeline::parse_in(&inner("$unionWith", stages)?, scope, depth + 1));
                let pipeline = pipeline.transpose()?;
                let own = pipeline
                    .as_ref()
                    .is_some_and(|pipeline| matches!(pipeline.stages.first(), Some(Stage::Documents(_))));
                if from.is_none() && !own {
                    return Err(QueryError::failed_to_parse("$unionWith needs 'coll'"));
                }
                Ok(Self { from, pipeline })
            }
            _ => Err(QueryError::failed_to_parse("the $unionWith stage specification must be an object or string")),
        }
    }

    pub(super) fn run<'a, E: From<QueryError> + 'a>(
        &'a self,
        input: Documents<'a, E>,
        run: Run<'a, E>,
    ) -> Documents<'a, E> {
        let more = std::iter::once(()).flat_map(move |()| {
            let source = match &self.from {
                Some(from) => run.source(from),
                None => Ok(Box::new(std::iter::empty()) as Documents<'a, E>),
            };
            match (source, &self.pipeline) {
                (Ok(source), Some(pipeline)) => pipeline.run_with(source, run.clone()),
                (Ok(source), None) => source,
                (Err(error), _) => Box::new(std::iter::once(Err(error))),
            }
        });
        Box::new(input.chain(more))
    }
}
