//! Operators that evaluate all their arguments, and what they have in common.

use bson::{Bson, Document};

use super::value::Value;
use crate::query::error::{QueryError, Result};
use crate::query::view::View;
pub(super) use crate::query::view::type_name;

/// An operator with positional arguments, all evaluated.
#[derive(Debug)]
pub(in crate::query) struct Operator {
    pub(super) name: &'static str,
    /// The fewest and the most arguments.
    pub(super) arity: (usize, usize),
    pub(super) call: fn(&[Value]) -> Result<Value>,
}

/// An operator with named arguments, all evaluated.
#[derive(Debug)]
pub(in crate::query) struct Named {
    pub(super) name: &'static str,
    /// Names of arguments, and whether they must be given.
    pub(super) fields: &'static [(&'static str, bool)],
    /// Whether one argument may be given without its name.
    pub(super) bare: bool,
    pub(super) call: fn(&Arguments) -> Result<Value>,
}

/// The values of named arguments, in the order of their names.
pub(super) struct Arguments {
    pub(super) operator: &'static str,
    pub(super) values: Vec<Option<Value>>,
}

impl Arguments {
    /// Returns whether an argument was given, perhaps with a missing value.
    pub(super) fn given(&self, index: usize) -> bool {
        self.values.get(index).is_some_and(Option::is_some)
    }

    /// Returns the value; null where it is missing or was not given.
    pub(super) fn get(&self, index: usize) -> &Bson {
        self.values.get(index).and_then(|value| value.as_ref()).and_then(Option::as_ref).unwrap_or(&Bson::Null)
    }

    /// Returns the value; `None` if it is null, undefined, missing, or was not given.
    pub(super) fn present(&self, index: usize) -> Option<&Bson> {
        Some(self.get(index)).filter(|value| !is_null(value))
    }
}

impl Operator {
    pub(super) fn run(&self, arguments: &[Value]) -> Result<Value> {
        (self.call)(arguments).map_err(|error| error.about(self.name))
    }

    /// Returns the value that is known without the arguments that follow: some operators take one after the other,
    /// and end at one that is null.
    pub(super) fn ended(&self, arguments: &[Value]) -> Option<Value> {
        const ENDING: [&str; 6] = ["$add", "$multiply", "$concat", "$concatArrays", "$setIntersection", "$setUnion"];
        let ends = ENDING.contains(&self.name) && arguments.iter().any(is_nullish);
        self.run(arguments).ok().filter(|_| ends)
    }
}

impl Named {
    pub(super) fn run(&self, arguments: &Arguments) -> Result<Value> {
        (self.call)(arguments).map_err(|error| error.about(self.name))
    }
}

/// Any number of arguments.
pub(super) const ANY: usize = usize::MAX;

/// Returns whether a value is null or undefined.
pub(super) fn is_null(value: &Bson) -> bool {
    matches!(value, Bson::Null | Bson::Undefined)
}

/// Returns whether a value is missing, null or undefined.
pub(super) fn is_nullish(value: &Value) -> bool {
    value.as_ref().is_none_or(is_null)
}

/// Returns the argument at an index; missing is null.
pub(super) fn at(arguments: &[Value], index: usize) -> &Bson {
    arguments.get(index).and_then(Option::as_ref).unwrap_or(&Bson::Null)
}

/// The error for an argument of the wrong type.
pub(super) fn wrong_type(code: i32, operator: &str, wanted: &str, found: &Bson) -> QueryError {
    QueryError::invalid(code, format!("{operator} needs {wanted}, not {}", type_name(found)))
}

/// Returns a document of the given fields; for results of operators.
pub(super) fn document(fields: impl IntoIterator<Item = (&'static str, Bson)>) -> Bson {
    Bson::Document(fields.into_iter().map(|(name, value)| (name.to_owned(), value)).collect::<Document>())
}

/// Returns whether any argument is missing or null.
pub(super) fn any_null(values: &[Value]) -> bool {
    values.iter().any(is_nullish)
}

/// Returns MongoDB's truth of a value, in which a missing value is false.
pub(super) fn is_true(value: &Value) -> bool {
    value.as_ref().is_some_and(|value| View::from(value).truthy())
}
