//! What an operator is, and the register of all of them.

use std::cell::Cell;
use std::hash::{BuildHasher as _, RandomState};

use bson::Bson;

use super::Value;
use super::{arithmetic, array, convert, date, object, pattern, set, string, trigonometry};
use crate::query::error::{QueryError, Result};
use crate::query::view::View;

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
    /// Whether an argument was given, perhaps with a missing value.
    pub(super) fn given(&self, index: usize) -> bool {
        self.values.get(index).is_some_and(Option::is_some)
    }

    /// The value; null where it is missing or was not given.
    pub(super) fn get(&self, index: usize) -> &Bson {
        self.values.get(index).and_then(|value| value.as_ref()).and_then(Option::as_ref).unwrap_or(&Bson::Null)
    }

    /// The value; nothing where it is null, undefined, missing, or was not given.
    pub(super) fn present(&self, index: usize) -> Option<&Bson> {
        Some(self.get(index)).filter(|value| !is_null(value))
    }
}

impl Operator {
    pub(super) fn run(&self, arguments: &[Value]) -> Result<Value> {
        (self.call)(arguments)
    }

    /// The value that is known without the arguments that follow: some operators take one after the other,
    /// and end at one that is null.
    pub(super) fn ended(&self, arguments: &[Value]) -> Option<Value> {
        const ENDING: [&str; 6] = ["$add", "$multiply", "$concat", "$concatArrays", "$setIntersection", "$setUnion"];
        let ends = ENDING.contains(&self.name) && arguments.iter().any(is_nullish);
        self.run(arguments).ok().filter(|_| ends)
    }
}

impl Named {
    pub(super) fn run(&self, arguments: &Arguments) -> Result<Value> {
        (self.call)(arguments)
    }
}

/// Any number of arguments.
pub(super) const ANY: usize = usize::MAX;

/// All families of positional operators.
const FAMILIES: [&[Operator]; 8] = [
    &arithmetic::OPERATORS,
    &array::OPERATORS,
    &convert::OPERATORS,
    &object::OPERATORS,
    &set::OPERATORS,
    &string::OPERATORS,
    &trigonometry::OPERATORS,
    &date::OPERATORS,
];

/// All families of operators with named arguments.
const NAMED: [&[Named]; 6] =
    [&array::NAMED, &convert::NAMED, &date::NAMED, &object::NAMED, &pattern::NAMED, &string::NAMED];

/// Operators of MongoDB that rmem refuses by name.
const REFUSED: [&str; 4] = ["$function", "$accumulator", "$meta", "$toHashedIndexKey"];

pub(super) fn positional(name: &str) -> Option<&'static Operator> {
    FAMILIES.iter().flat_map(|family| family.iter()).find(|operator| operator.name == name)
}

pub(super) fn named(name: &str) -> Option<&'static Named> {
    NAMED.iter().flat_map(|family| family.iter()).find(|operator| operator.name == name)
}

/// The complaint about a name that is no operator here.
pub(super) fn unknown(name: &str) -> QueryError {
    if REFUSED.contains(&name) {
        return QueryError::unsupported(name);
    }
    QueryError::invalid(168, format!("unrecognized expression '{name}'"))
}

/// Whether a value is null or undefined.
pub(super) fn is_null(value: &Bson) -> bool {
    matches!(value, Bson::Null | Bson::Undefined)
}

/// Whether a value is missing, null or undefined.
pub(super) fn is_nullish(value: &Value) -> bool {
    value.as_ref().is_none_or(is_null)
}

/// The argument at an index; missing is null.
pub(super) fn at(arguments: &[Value], index: usize) -> &Bson {
    arguments.get(index).and_then(Option::as_ref).unwrap_or(&Bson::Null)
}

/// The name of a type, for messages.
pub(super) fn type_of(value: &Bson) -> &'static str {
    View::from(value).type_name()
}

/// A complaint about the type of an argument.
pub(super) fn wrong_type(code: i32, operator: &str, wanted: &str, found: &Bson) -> QueryError {
    QueryError::invalid(code, format!("{operator} needs {wanted}, not {}", type_of(found)))
}

thread_local! {
    static STATE: Cell<u64> = Cell::new(RandomState::new().hash_one(0u8));
}

/// A random number from 0 to below 1 (xorshift, seeded from the system).
pub(in crate::query) fn random() -> f64 {
    STATE.with(|state| {
        let mut bits = state.get() | 1;
        bits ^= bits << 13;
        bits ^= bits >> 7;
        bits ^= bits << 17;
        state.set(bits);
        let mantissa = u32::try_from(bits.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 32).unwrap_or(0);
        f64::from(mantissa) / (f64::from(u32::MAX) + 1.0)
    })
}
