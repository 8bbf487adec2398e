//! `$graphLookup`: what can be reached from a document.

use std::cell::OnceCell;
use std::collections::{HashMap, HashSet};
use std::rc::Rc;

use bson::{Bson, Document, RawDocumentBuf};

use super::argument::{origin, plain_path, target};
use super::documents::{Documents, Origin, encode};
use super::foreign::Foreign;
use super::lookup::reached_keys;
use super::run::Run;
use super::unwind::put;
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Expression, Scope};
use crate::query::filter::{Context, Filter, Parser};
use crate::query::key;
use crate::query::limit::Memory;
use crate::query::number::Number;
use crate::query::path::Path;

/// A compiled `$graphLookup`.
#[derive(Debug)]
pub(super) struct GraphLookup {
    from: Origin,
    start: Expression,
    connect_from: Path,
    connect_to: Path,
    to: Vec<String>,
    max_depth: Option<i64>,
    depth_field: Option<Vec<String>>,
    restrict: Option<Filter>,
}

impl GraphLookup {
    pub(super) fn parse(spec: &Document, scope: &Scope) -> Result<Self> {
        const KNOWN: [&str; 8] = [
            "from",
            "startWith",
            "connectFromField",
            "connectToField",
            "as",
            "maxDepth",
            "depthField",
            "restrictSearchWithMatch",
        ];
        if let Some(name) = spec.keys().find(|name| !KNOWN.contains(&name.as_str())) {
            return Err(QueryError::invalid(40_104, format!("unknown argument to $graphLookup: {name}")));
        }
        let missing = || {
            QueryError::invalid(
                40_105,
                "$graphLookup requires 'from', 'as', 'startWith', 'connectFromField', and 'connectToField'",
            )
        };
        let text = |name: &str| match spec.get(name) {
            Some(Bson::String(text)) => Ok(text.as_str()),
            _ => Err(missing()),
        };
        let max_depth = match spec.get("maxDepth") {
            None => None,
            Some(value) => Some(
                Number::of(value)
                    .and_then(Number::integral)
                    .filter(|depth| *depth >= 0)
                    .ok_or_else(|| QueryError::invalid(40_100, "maxDepth requires a nonnegative integer"))?,
            ),
        };
        let depth_field = match spec.get("depthField") {
            None => None,
            Some(Bson::String(name)) => Some(plain_path(name)?.parts().iter().map(|part| part.name.clone()).collect()),
            Some(_) => return Err(QueryError::invalid(40_103, "depthField must be a string")),
        };
        let restrict = match spec.get("restrictSearchWithMatch") {
            None => None,
            Some(Bson::Document(filter)) => Some(Filter::parse_with(filter, &Parser::with_scope(scope))?),
            Some(_) => return Err(QueryError::invalid(40_185, "restrictSearchWithMatch must be an object")),
        };
        Ok(Self {
            from: origin("$graphLookup", spec.get("from").ok_or_else(missing)?)?,
            start: Expression::parse_in(spec.get("startWith").ok_or_else(missing)?, scope)?,
            connect_from: plain_path(text("connectFromField")?)?,
            connect_to: plain_path(text("connectToField")?)?,
            to: target("$graphLookup", spec)?,
            max_depth,
            depth_field,
            restrict,
        })
    }

    pub(super) fn run<'a, E: From<QueryError> + 'a>(
        &'a self,
        input: Documents<'a, E>,
        run: Run<'a, E>,
    ) -> Documents<'a, E> {
        let index: OnceCell<Rc<Foreign<'a>>> = OnceCell::new();
        Box::new(input.map(move |document| {
            let document = document?;
            if index.get().is_none() {
                let _ = index.set(Foreign::read(run.source(&self.from)?, &self.connect_to, false, run.spill())?);
            }
            let start = self.start.evaluate(&run.environment((&*document).into()))?;
            let found = match index.get() {
                Some(index) => self.reached(start, index, &run)?,
                None => Vec::new(),
            };
            let mut document = Document::try_from(document).map_err(QueryError::from)?;
            put(&mut document, &self.to, Bson::Array(found));
            Ok(encode(&document)?)
        }))
    }

    /// Breadth first; a document is given once, with the depth at which it was found.
    fn reached<E>(&self, start: Option<Bson>, index: &Rc<Foreign<'_>>, run: &Run<'_, E>) -> Result<Vec<Bson>> {
        let mut frontier = keys(start);
        let mut asked: HashSet<Vec<u8>> = frontier.iter().cloned().collect();
        let mut seen: HashMap<Vec<u8>, ()> = HashMap::new();
        let (mut found, mut memory) = (Vec::new(), Memory::default());
        let mut depth = 0i64;
        while !frontier.is_empty() && self.max_depth.is_none_or(|limit| depth <= limit) {
            let mut next = Vec::new();
            for document in index.find(frontier)? {
                let document = document?;
                if !self.passes(&document, run)? || seen.insert(identity(&document), ()).is_some() {
                    continue;
                }
                for key in reached_keys(&self.connect_from, (&*document).into()) {
                    if asked.insert(key.clone()) {
                        next.push(key);
                    }
                }
                let mut document = Document::try_from(document)?;
                if let Some(path) = &self.depth_field {
                    put(&mut document, path, Bson::Int64(depth));
                }
                let document = Bson::Document(document);
                memory.add(&document)?;
                found.push(document);
            }
            frontier = next;
            depth += 1;
        }
        Ok(found)
    }

    fn passes<E>(&self, document: &RawDocumentBuf, run: &Run<'_, E>) -> Result<bool> {
        let Some(filter) = &self.restrict else { return Ok(true) };
        let mut context = Context { now: Some(run.now), variables: Some(&run.variables), ..Context::default() };
        filter.matches_with((&**document).into(), &mut context)
    }
}

/// Returns the identity of a document: its `_id`, or the whole document.
fn identity(document: &RawDocumentBuf) -> Vec<u8> {
    match document.get("_id") {
        Ok(Some(id)) => key::encode(id),
        _ => document.as_bytes().to_vec(),
    }
}

/// Returns the keys of a value, or of the elements of an array.
fn keys(value: Option<Bson>) -> Vec<Vec<u8>> {
    match value {
        None => Vec::new(),
        Some(Bson::Array(items)) => items.iter().map(key::collated).collect(),
        Some(value) => vec![key::collated(&value)],
    }
}
