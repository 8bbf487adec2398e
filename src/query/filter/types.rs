//! `$type`: types by name, number, or list of these.

use crate::query::error::{QueryError, Result};
use crate::query::number::Number;
use crate::query::view::{TYPE_NAMES, View};

/// A set of BSON types.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(in crate::query) struct TypeSet {
    codes: Vec<i32>,
}

/// The types that are numbers.
const NUMBERS: [i32; 4] = [1, 16, 18, 19];

impl TypeSet {
    /// Reads what `$type` takes.
    ///
    /// # Errors
    /// If a name or number is of no type.
    pub(super) fn parse(value: View<'_>) -> Result<Self> {
        let mut types = Self::default();
        match value {
            View::Array(items) if items.is_empty() => {
                return Err(QueryError::failed_to_parse("$type must match at least one type"));
            }
            View::Array(items) => {
                for item in items.iter() {
                    types.add(item)?;
                }
            }
            other => types.add(other)?,
        }
        Ok(types)
    }

    fn add(&mut self, value: View<'_>) -> Result<()> {
        match value {
            View::String(name) => self.add_name(name),
            View::Number(number) => {
                let code =
                    code_of(number).ok_or_else(|| QueryError::bad_value("invalid numerical type code for $type"))?;
                self.codes.push(code);
                Ok(())
            }
            _ => Err(QueryError::type_mismatch("type must be represented as a number or a string")),
        }
    }

    /// Adds a type by its name; `number` is all four.
    ///
    /// # Errors
    /// If no type has that name.
    pub(super) fn add_name(&mut self, name: &str) -> Result<()> {
        if name == "number" {
            self.codes.extend(NUMBERS);
            return Ok(());
        }
        let code = TYPE_NAMES.iter().find(|(known, _)| *known == name).map(|(_, code)| *code);
        self.codes.push(code.ok_or_else(|| QueryError::bad_value(format!("unknown type name alias: {name}")))?);
        Ok(())
    }

    pub(super) fn contains(&self, value: View<'_>) -> bool {
        self.codes.contains(&value.type_code())
    }
}

/// Returns the type of a code, as numbers of any type write it.
fn code_of(number: Number) -> Option<i32> {
    let code = number.integral_32()?;
    TYPE_NAMES.iter().any(|(_, known)| *known == code).then_some(code)
}
