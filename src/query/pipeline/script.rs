//! `$accumulator`: an accumulator whose functions are JavaScript.

use bson::{Bson, Document};

use super::run::Run;
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Expression, Scope};
use crate::query::javascript::Program;
use crate::query::view::Fields;

/// A compiled `$accumulator`. Its state is a value of BSON between the calls.
#[derive(Debug)]
pub(super) struct Script {
    init: Program,
    init_arguments: Option<Expression>,
    accumulate: Program,
    accumulate_arguments: Expression,
    finalize: Option<Program>,
}

impl Script {
    pub(super) fn parse(argument: &Bson, scope: &Scope) -> Result<Self> {
        const KNOWN: [&str; 7] = ["init", "initArgs", "accumulate", "accumulateArgs", "merge", "finalize", "lang"];
        let Bson::Document(fields) = argument else {
            return Err(QueryError::invalid(4_544_703, "$accumulator needs an object"));
        };
        if let Some(name) = fields.keys().find(|name| !KNOWN.contains(&name.as_str())) {
            return Err(QueryError::invalid(4_544_706, format!("unrecognized argument to $accumulator: {name}")));
        }
        if fields.get("lang").and_then(Bson::as_str) != Some("js") {
            return Err(QueryError::invalid(4_544_704, "the 'lang' of $accumulator must be 'js'"));
        }
        let program = |name: &str| {
            let code = fields
                .get(name)
                .ok_or_else(|| QueryError::invalid(4_544_708, format!("$accumulator needs '{name}'")))?;
            Program::function("$accumulator", name, code)
        };
        let expression = |name: &str| fields.get(name).map(|value| Expression::parse_in(value, scope)).transpose();
        program("merge")?;
        let missing = || QueryError::invalid(4_544_707, "$accumulator needs 'accumulateArgs'");
        Ok(Self {
            init: program("init")?,
            init_arguments: expression("initArgs")?,
            accumulate: program("accumulate")?,
            accumulate_arguments: expression("accumulateArgs")?.ok_or_else(missing)?,
            finalize: fields.contains_key("finalize").then(|| program("finalize")).transpose()?,
        })
    }

    /// Returns the state before the first document of a group.
    pub(super) fn start<E>(&self, id: &Bson, run: &Run<'_, E>) -> Result<Option<Bson>> {
        let Some(expression) = &self.init_arguments else { return self.init.call(&[]) };
        let empty = Document::new();
        let id = id.as_document().unwrap_or(&empty);
        self.init.call(&arguments(expression, id.into(), run)?)
    }

    /// Returns the state after a document.
    pub(super) fn add<E>(&self, state: Option<Bson>, fields: Fields<'_>, run: &Run<'_, E>) -> Result<Option<Bson>> {
        let mut all = vec![state];
        all.extend(arguments(&self.accumulate_arguments, fields, run)?);
        self.accumulate.call(&all)
    }

    pub(super) fn finish(&self, state: Option<Bson>) -> Result<Bson> {
        let value = match &self.finalize {
            Some(finalize) => finalize.call(&[state])?,
            None => state,
        };
        Ok(value.filter(|value| *value != Bson::Undefined).unwrap_or(Bson::Null))
    }
}

fn arguments<E>(expression: &Expression, fields: Fields<'_>, run: &Run<'_, E>) -> Result<Vec<Option<Bson>>> {
    match expression.evaluate(&run.environment(fields))? {
        Some(Bson::Array(values)) => Ok(values.into_iter().map(Some).collect()),
        _ => {
            Err(QueryError::invalid(4_544_711, "the arguments of $accumulator must be an array").about("$accumulator"))
        }
    }
}
