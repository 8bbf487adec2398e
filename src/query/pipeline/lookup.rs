//! `$lookup` and `$unionWith`: documents of other collections.

use std::cell::OnceCell;
use std::rc::Rc;

use bson::{Bson, Document, RawDocumentBuf};

use super::Pipeline;
use super::argument::{inner, origin, plain_path, target, text};
use super::documents::{Documents, Origin, encode};
use super::facet::array;
use super::foreign::{Foreign, key_of};
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
        let index: OnceCell<Rc<Foreign<'a>>> = OnceCell::new();
        Box::new(input.map(move |document| {
            let document = document?;
            let found = self.found(&document, &run, &index)?;
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
        index: &OnceCell<Rc<Foreign<'a>>>,
    ) -> std::result::Result<Bson, E> {
        let foreign: Documents<'a, E> = match (&self.fields, &self.from) {
            (Some((local, foreign)), Some(from)) => {
                if index.get().is_none() {
                    let _ = index.set(Foreign::read(run.source(from)?, foreign, true, run.spill())?);
                }
                let keys = local_keys(local, (&**document).into());
                let found = index.get().map(|index| index.find(keys)).transpose()?;
                Box::new(found.into_iter().flatten().map(|document| Ok(document?)))
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
