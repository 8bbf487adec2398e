//! Folds the constants among the arguments of an operator.
//!
//! Where the order of its arguments does not matter to an operator, mongod puts the constants last, and what one
//! call of the operator within another takes beside the other's own. Of values that are equal, of numbers of
//! several types, and of a null beside an error, that decides which one counts.

use super::operator::Operator;
use super::tree::{Expression, constant};
use crate::query::error::Result;

/// Operators to which only the order of their arguments matters, or not even that.
const GATHERING: [(&str, Order); 9] = [
    ("$add", Order::Any),
    ("$multiply", Order::Any),
    ("$setIntersection", Order::Any),
    ("$setUnion", Order::Any),
    ("$max", Order::Any),
    ("$min", Order::Any),
    ("$sum", Order::Any),
    ("$concat", Order::Kept),
    ("$concatArrays", Order::Kept),
];

/// Whether the order of arguments matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Order {
    Any,
    Kept,
}

/// How an operator's arguments are gathered, where they are. An accumulator takes a single one for a list.
fn order_of(operator: &Operator, arguments: &[Expression]) -> Option<Order> {
    let lists = matches!(operator.name, "$max" | "$min" | "$sum") && arguments.len() == 1;
    let known = GATHERING.iter().find(|(name, _)| *name == operator.name && !lists);
    known.map(|(_, order)| *order)
}

/// Returns the arguments with constants gathered.
///
/// # Errors
/// If the operator cannot work with its constants.
pub(super) fn gathered(operator: &'static Operator, arguments: Vec<Expression>) -> Result<Vec<Expression>> {
    let Some(order) = order_of(operator, &arguments) else { return Ok(arguments) };
    let (mut gathered, mut constants) = (Vec::with_capacity(arguments.len()), Vec::new());
    for argument in flat(operator, arguments) {
        if argument.is_constant() {
            constants.push(argument);
            continue;
        }
        if order == Order::Kept {
            together(operator, &mut constants, &mut gathered)?;
        }
        gathered.push(argument);
    }
    together(operator, &mut constants, &mut gathered)?;
    Ok(gathered)
}

/// Returns the arguments, with those of calls of the same operator in the place of the calls.
fn flat(operator: &Operator, arguments: Vec<Expression>) -> Vec<Expression> {
    let is_same = |inner: &Operator, own: &[Expression]| inner.name == operator.name && order_of(inner, own).is_some();
    let inner = |argument| match argument {
        Expression::Call(inner, own) if is_same(inner, &own) => own,
        argument => vec![argument],
    };
    arguments.into_iter().flat_map(inner).collect()
}

/// Puts what the constants come to behind the others.
fn together(operator: &'static Operator, constants: &mut Vec<Expression>, others: &mut Vec<Expression>) -> Result<()> {
    if constants.len() > 1 {
        let call = Expression::Call(operator, std::mem::take(constants));
        constants.push(Expression::Constant(constant(&call)?));
    }
    others.append(constants);
    Ok(())
}
