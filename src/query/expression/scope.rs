//! Variables: their names while an expression is parsed, their values while it is evaluated.

use bson::{Bson, DateTime, Document};

use super::value::Value;
use crate::query::error::{QueryError, Result};
use crate::query::view::Fields;

/// The variables that an expression may use, by name.
#[derive(Debug, Default, Clone)]
pub(in crate::query) struct Scope {
    names: Vec<(String, usize)>,
    next: usize,
    /// Whether `$$KEEP`, `$$PRUNE` and `$$DESCEND` are in sight.
    pub(in crate::query) redacting: bool,
    /// Whether constants are evaluated only when their value is needed. mongod does not optimize updates.
    pub(in crate::query) lazy: bool,
}

/// Values of variables that hold for a whole run.
#[derive(Debug, Default, Clone)]
pub(in crate::query) struct Variables {
    values: Vec<(usize, Value)>,
}

impl Scope {
    /// Returns a scope of constants, with their values; undefined is a missing one.
    pub(in crate::query) fn with_constants(constants: &Document) -> Result<(Self, Variables)> {
        let (mut scope, mut variables) = (Self::default(), Variables::default());
        for (name, value) in constants {
            check_name(name)?;
            let slot = scope.add(name);
            variables.set(slot, Some(value.clone()).filter(|value| *value != Bson::Undefined));
        }
        Ok((scope, variables))
    }

    /// Adds a variable, which hides one of the same name.
    pub(in crate::query) fn add(&mut self, name: &str) -> usize {
        self.next += 1;
        self.names.push((name.to_owned(), self.next));
        self.next
    }

    pub(super) fn find(&self, name: &str) -> Option<usize> {
        self.names.iter().rev().find(|(known, _)| known == name).map(|(_, slot)| *slot)
    }
}

impl Variables {
    pub(in crate::query) fn set(&mut self, slot: usize, value: Value) {
        match self.values.iter_mut().find(|(known, _)| *known == slot) {
            Some((_, place)) => *place = value,
            None => self.values.push((slot, value)),
        }
    }

    fn get(&self, slot: usize) -> Option<&Bson> {
        self.values.iter().find(|(known, _)| *known == slot).and_then(|(_, value)| value.as_ref())
    }
}

/// Refuses names that users may not give to variables.
pub(in crate::query) fn check_name(name: &str) -> Result<()> {
    let Some(first) = name.chars().next() else {
        return Err(QueryError::failed_to_parse("empty variable names are not allowed"));
    };
    let starts = first.is_ascii_lowercase() || !first.is_ascii() || name == "CURRENT";
    let rest = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || !c.is_ascii());
    if !starts || !rest {
        return Err(QueryError::failed_to_parse(format!("'{name}' is not a valid name for a variable")));
    }
    Ok(())
}

/// The document, time and variables that an expression is evaluated with.
#[derive(Debug, Clone, Copy)]
pub(in crate::query) struct Environment<'a> {
    pub(super) root: Fields<'a>,
    pub(super) now: DateTime,
    variables: &'a Variables,
    frame: Option<&'a Frame<'a>>,
}

/// A variable bound by an expression, and those around it.
#[derive(Debug)]
pub(in crate::query) struct Frame<'a> {
    slot: usize,
    value: &'a Value,
    outer: Option<&'a Frame<'a>>,
}

impl<'a> Environment<'a> {
    pub(in crate::query) fn new(root: Fields<'a>, variables: &'a Variables, now: DateTime) -> Self {
        Self { root, now, variables, frame: None }
    }

    /// Returns a frame that binds one more variable.
    pub(in crate::query) fn frame(&self, slot: usize, value: &'a Value) -> Frame<'a> {
        Frame { slot, value, outer: self.frame }
    }

    pub(in crate::query) fn within<'b>(&self, frame: &'b Frame<'b>) -> Environment<'b>
    where
        'a: 'b,
    {
        Environment { root: self.root, now: self.now, variables: self.variables, frame: Some(frame) }
    }

    pub(super) fn variable(&self, slot: usize) -> Option<&'a Bson> {
        let mut frame = self.frame;
        while let Some(current) = frame {
            if current.slot == slot {
                return current.value.as_ref();
            }
            frame = current.outer;
        }
        self.variables.get(slot)
    }
}
