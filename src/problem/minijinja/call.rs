//! A call of a function that asks the memory: its place and its arguments.

use std::collections::VecDeque;
use std::sync::Arc;

use minijinja::value::{Kwargs, Rest, Value, ValueKind};
use minijinja::{Error, ErrorKind};

use super::advice::Hint;
use super::context::{Context, invalid};
use super::signature::Signature;
use crate::formats::mongosh;
use crate::store::{Find, Namespace};

/// The arguments of a call, its place taken out.
pub(super) struct Call {
    signature: &'static Signature,
    pub(super) site: Option<usize>,
    positional: VecDeque<Value>,
    named: Kwargs,
}

impl Call {
    pub(super) fn new(
        signature: &'static Signature,
        context: &Context,
        arguments: Rest<Value>,
        named: Kwargs,
    ) -> Result<Self, Error> {
        signature.check(named.args())?;
        let mut positional: VecDeque<Value> = arguments.0.into();
        let first = positional.front().filter(|value| value.is_integer()).and_then(Value::as_usize);
        let site = first.filter(|site| *site < context.sites.len());
        if site.is_some() {
            positional.pop_front();
        }
        Ok(Self { signature, site, positional, named })
    }

    pub(super) fn next(&mut self, name: &str) -> Result<Option<Value>, Error> {
        match self.positional.pop_front() {
            Some(value) => Ok(Some(value)),
            None => self.named.get::<Option<Value>>(name),
        }
    }

    pub(super) fn namespace(&mut self, context: &Context) -> Result<Arc<Namespace>, Error> {
        let value = self.next("ns")?.ok_or_else(|| Error::new(ErrorKind::MissingArgument, "expected a namespace"))?;
        let text = value.as_str().ok_or_else(|| invalid("a namespace must be text like \"robmem.worldmodel\""))?;
        let namespace = text.parse::<Namespace>().map_err(|error| {
            let wrong = invalid(error.to_string());
            let call = mongosh::call(text).map(|call| Hint(format!("write: {call}")));
            call.into_iter().fold(wrong, Error::with_source)
        })?;
        context.note_namespace(&namespace);
        Ok(Arc::new(namespace))
    }

    fn number(&mut self, name: &str) -> Result<u64, Error> {
        let Some(value) = self.named.get::<Option<Value>>(name)?.filter(|value| !value.is_none()) else { return Ok(0) };
        value
            .as_i64()
            .and_then(|number| u64::try_from(number).ok())
            .ok_or_else(|| invalid(format!("`{name}` must be a whole number from 0 on")))
    }

    pub(super) fn find(&mut self, context: &Context) -> Result<Find, Error> {
        let filter = self.next("filter")?;
        let sort = self.named.get::<Option<Value>>("sort")?;
        if sort.as_ref().is_some_and(|sort| sort.kind() == ValueKind::Map && sort.len() > Some(1)) {
            return Err(invalid("a map has no order; write several sort keys as text like \"{a: 1, b: -1}\""));
        }
        let projection = self.named.get::<Option<Value>>("projection")?;
        Ok(Find {
            filter: context.document(filter.as_ref(), "filter")?,
            sort: context.document(sort.as_ref(), "sort")?,
            projection: context.document(projection.as_ref(), "projection")?,
            skip: self.number("skip")?,
            limit: self.number("limit")?,
            ..Find::default()
        })
    }

    pub(super) fn end(&self) -> Result<(), Error> {
        match self.positional.is_empty() {
            // One that was given by place as well was not used.
            true => self.named.assert_all_used(),
            false => Err(Error::new(ErrorKind::TooManyArguments, self.signature.to_string())),
        }
    }
}
