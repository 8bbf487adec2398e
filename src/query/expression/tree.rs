//! The compiled expression and its evaluation.

use bson::{Bson, Document};

use super::form::Form;
use super::operator::{Arguments, Named, Operator, is_true};
use super::scope::{Environment, Variables};
use super::value::Value;
use crate::query::error::Result;
use crate::query::limit::{Held, check_copy, holds_much};
use crate::query::view::{Fields, View};

/// A compiled expression.
#[derive(Debug)]
pub(in crate::query) enum Expression {
    Constant(Value),
    /// A variable, or a path in it.
    Path(Source, Vec<String>),
    Document(Vec<(String, Expression)>),
    Array(Vec<Expression>),
    Call(&'static Operator, Vec<Expression>),
    Named(&'static Named, Vec<Option<Expression>>),
    Form(Box<Form>),
}

/// What a path starts from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::query) enum Source {
    /// The document.
    Root,
    /// The time of the operation.
    Now,
    /// `$$CLUSTER_TIME`: the same as a timestamp.
    ClusterTime,
    /// A variable.
    Slot(usize),
}

impl Expression {
    /// Returns whether it gives the same value for every document.
    pub(super) fn is_constant(&self) -> bool {
        matches!(self, Self::Constant(_))
    }

    /// Returns the value for a document; nothing where it is missing.
    ///
    /// # Errors
    /// If an operator cannot work with its arguments.
    pub(in crate::query) fn evaluate(&self, environment: &Environment<'_>) -> Result<Value> {
        match self {
            Self::Constant(value) => Ok(value.clone()),
            Self::Path(source, path) => {
                if holds_much() {
                    borrowed(*source, path, environment).map_or(Ok(()), check_copy)?;
                }
                Ok(at_path(*source, path, environment))
            }
            Self::Document(fields) => {
                let (mut document, mut held) = (Document::new(), Held::default());
                for (name, expression) in fields {
                    if let Some(value) = expression.evaluate(environment)? {
                        held.add(&value)?;
                        document.insert(name.clone(), value);
                    }
                }
                Ok(Some(Bson::Document(document)))
            }
            Self::Array(items) => {
                let (mut values, mut held) = (Vec::with_capacity(items.len()), Held::default());
                for item in items {
                    let value = item.evaluate(environment)?.unwrap_or(Bson::Null);
                    held.add(&value)?;
                    values.push(value);
                }
                Ok(Some(Bson::Array(values)))
            }
            Self::Call(operator, arguments) => {
                let (mut values, mut held) = (Vec::with_capacity(arguments.len()), Held::default());
                for argument in arguments {
                    match argument.evaluate(environment) {
                        Ok(value) => {
                            value.as_ref().map_or(Ok(()), |value| held.add(value))?;
                            values.push(value);
                        }
                        Err(error) => return operator.ended(&values).ok_or(error),
                    }
                }
                operator.run(&values)
            }
            Self::Named(operator, arguments) => {
                let (mut values, mut held) = (Vec::with_capacity(arguments.len()), Held::default());
                for argument in arguments {
                    let value = argument.as_ref().map(|argument| argument.evaluate(environment)).transpose()?;
                    value.iter().flatten().try_for_each(|value| held.add(value))?;
                    values.push(value);
                }
                operator.run(&Arguments { operator: operator.name, values })
            }
            Self::Form(form) => form.evaluate(environment),
        }
    }

    /// Returns the names of two fields of the document itself, where the expression is that they differ.
    pub(in crate::query) fn differing(&self) -> Option<[&str; 2]> {
        match self {
            Self::Form(form) => form.differing(),
            _ => None,
        }
    }

    /// Returns whether the value is true.
    pub(in crate::query) fn truth(&self, environment: &Environment<'_>) -> Result<bool> {
        if let Self::Form(form) = self {
            return form.truth(environment);
        }
        Ok(is_true(&self.evaluate(environment)?))
    }

    /// Calls a function with the value, which is borrowed from the document if it can be.
    pub(super) fn show<T>(&self, environment: &Environment<'_>, look: impl FnOnce(Option<View<'_>>) -> T) -> Result<T> {
        match self {
            Self::Constant(value) => Ok(look(value.as_ref().map(View::from))),
            Self::Path(Source::Root, path) => {
                let mut value = Some(View::Document(environment.root));
                for name in path {
                    value = match value {
                        Some(View::Document(fields)) => fields.get(name),
                        Some(View::Array(_)) => {
                            let value = self.evaluate(environment)?;
                            return Ok(look(value.as_ref().map(View::from)));
                        }
                        _ => None,
                    };
                }
                Ok(look(value))
            }
            _ => {
                let value = self.evaluate(environment)?;
                Ok(look(value.as_ref().map(View::from)))
            }
        }
    }
}

/// Returns the value of a constant expression, for which no document is needed.
pub(super) fn constant(expression: &Expression) -> Result<Value> {
    let (none, empty) = (Variables::default(), Document::new());
    expression.evaluate(&Environment::new((&empty).into(), &none, bson::DateTime::now()))
}

/// Returns the value at a path through documents alone, where there is one.
fn borrowed<'a>(source: Source, path: &[String], environment: &Environment<'a>) -> Option<View<'a>> {
    let value = match source {
        Source::Root => View::Document(environment.root),
        Source::Slot(slot) => environment.variable(slot)?.into(),
        Source::Now | Source::ClusterTime => return None,
    };
    path.iter().try_fold(value, |value, name| match value {
        View::Document(fields) => fields.get(name),
        _ => None,
    })
}

fn at_path(source: Source, path: &[String], environment: &Environment<'_>) -> Value {
    match source {
        Source::Root => in_fields(environment.root, path),
        Source::Now => path.is_empty().then_some(Bson::DateTime(environment.now)),
        Source::ClusterTime => path.is_empty().then_some(Bson::Timestamp(cluster_time(environment.now))),
        Source::Slot(slot) => environment.variable(slot).and_then(|value| in_value(value.into(), path)),
    }
}

/// The time of the only member: the second that it is.
fn cluster_time(now: bson::DateTime) -> bson::Timestamp {
    let seconds = now.timestamp_millis().div_euclid(1_000);
    bson::Timestamp { time: u32::try_from(seconds.max(0)).unwrap_or(u32::MAX), increment: 1 }
}

/// Returns the value at a path; through an array, the array of the values in its elements.
pub(in crate::query) fn field_value(fields: Fields<'_>, path: &[String]) -> Value {
    in_fields(fields, path)
}

fn in_fields(fields: Fields<'_>, path: &[String]) -> Value {
    in_value(View::Document(fields), path)
}

fn in_value(mut value: View<'_>, mut path: &[String]) -> Value {
    while let Some((name, rest)) = path.split_first() {
        match value {
            View::Document(fields) => value = fields.get(name)?,
            View::Array(items) => {
                let inner = items.iter().filter(|item| matches!(item, View::Document(_)));
                return Some(Bson::Array(inner.filter_map(|item| in_value(item, path)).collect()));
            }
            _ => return None,
        }
        path = rest;
    }
    Some(value.to_bson())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cluster_time_is_the_second_of_the_operation() {
        let expression = Expression::parse(&"$$CLUSTER_TIME".into()).unwrap();
        let (none, empty) = (Variables::default(), Document::new());
        for (millis, time) in [(5_999, 5), (-1, 0), (i64::MAX, u32::MAX)] {
            let now = bson::DateTime::from_millis(millis);
            let value = expression.evaluate(&Environment::new((&empty).into(), &none, now)).unwrap();
            assert_eq!(value, Some(Bson::Timestamp(bson::Timestamp { time, increment: 1 })));
        }
    }
}
