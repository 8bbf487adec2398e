//! The effect of each action on the value at its path.

use std::cmp::Ordering;

use bson::Bson;

use super::array;
use super::modifier::{Action, Bitwise, Modifier};
use super::outcome::{Effects, Outcome, timestamp};
use crate::query::arithmetic::{Overflow, add, multiply};
use crate::query::compare::compare_values;
use crate::query::error::{QueryError, Result};
use crate::query::number::Number;

/// Returns the outcome of a modifier on a value, which may be missing.
pub(super) fn change(modifier: &Modifier, value: Option<&Bson>, effects: &Effects) -> Result<Outcome> {
    changed(&modifier.action, value, effects).map_err(|error| {
        let message = format!("{}, in the field `{}`", error.message, modifier.text);
        QueryError { message, ..error }.about(modifier.action.operator())
    })
}

fn changed(action: &Action, value: Option<&Bson>, effects: &Effects) -> Result<Outcome> {
    Ok(match action {
        Action::Set(new) | Action::SetOnInsert(new) => Outcome::Put(new.clone()),
        Action::Unset => Outcome::Remove,
        Action::Rename(_) => Outcome::Keep,
        Action::Increment(by) => match value {
            None => Outcome::Put((*by).into()),
            Some(value) => {
                let sum = add(numeric("$inc", value)?, *by, Overflow::Refuse)?;
                effects.touched.set(effects.touched.get() || sum.is_nan());
                put_unless_same(value, sum)
            }
        },
        Action::Multiply(by) => {
            let factor = value.map_or(Ok(Number::Int(0)), |value| numeric("$mul", value))?;
            let product = multiply(factor, *by, Overflow::Refuse)?;
            effects.touched.set(effects.touched.get() || product.is_nan());
            match value {
                Some(value) => put_unless_same(value, product),
                None => Outcome::Put(product.into()),
            }
        }
        Action::Least(new) => replace_if(value, new, Ordering::Less),
        Action::Greatest(new) => replace_if(value, new, Ordering::Greater),
        Action::CurrentDate { timestamp: true } => Outcome::Put(timestamp(effects.now)),
        Action::CurrentDate { timestamp: false } => Outcome::Put(Bson::DateTime(effects.now)),
        Action::Bits(operations) => bits(operations, value)?,
        Action::Push(push) => {
            effects.touched.set(effects.touched.get() || push.counts(value));
            push.apply(value)?
        }
        Action::AddToSet(new) => array::add_to_set(value, new)?,
        Action::Pop { first } => array::pop(value, *first)?,
        Action::Pull(pull) => array::without("$pull", value, |item| pull.takes(item))?,
        Action::PullAll(values) => array::without("$pullAll", value, |item| Ok(array::contains(values, item)))?,
    })
}

/// Returns the new number, where it differs from the old one in type or value; 0 and -0 do not.
fn put_unless_same(old: &Bson, new: Number) -> Outcome {
    let new = Bson::from(new);
    match new.element_type() == old.element_type() && compare_values(&new, old).is_eq() {
        true => Outcome::Keep,
        false => Outcome::Put(new),
    }
}

fn numeric(operator: &str, value: &Bson) -> Result<Number> {
    Number::of(value).ok_or_else(|| {
        QueryError::type_mismatch(format!("cannot apply {operator} to a value of non-numeric type: {value}"))
    })
}

fn replace_if(value: Option<&Bson>, new: &Bson, order: Ordering) -> Outcome {
    match value {
        Some(value) if compare_values(new, value) != order => Outcome::Keep,
        _ => Outcome::Put(new.clone()),
    }
}

fn bits(operations: &[(Bitwise, Number)], value: Option<&Bson>) -> Result<Outcome> {
    let mut current = match value.map(Number::of) {
        None => Number::Int(0),
        Some(Some(number @ (Number::Int(_) | Number::Long(_)))) => number,
        Some(_) => return Err(QueryError::bad_value("cannot apply $bit to a value of non-integral type")),
    };
    for (operation, mask) in operations {
        current = match (current, mask) {
            (Number::Int(a), Number::Int(b)) => {
                Number::Int(i32::try_from(bit(*operation, a.into(), (*b).into())).unwrap_or(0))
            }
            (a, b) => Number::Long(bit(*operation, a.to_long(), b.to_long())),
        };
    }
    Ok(Outcome::Put(current.into()))
}

fn bit(operation: Bitwise, a: i64, b: i64) -> i64 {
    match operation {
        Bitwise::And => a & b,
        Bitwise::Or => a | b,
        Bitwise::Xor => a ^ b,
    }
}
