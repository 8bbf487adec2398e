//! Parses the operators under a path.

use bson::{Bson, Document};

use super::bits::Bits;
use super::parse::{Parser, array, unknown};
use super::test::{Leaf, Order, Set, Test};
use super::types::TypeSet;
use crate::query::dollar::is_operator_object;
use crate::query::error::{NameContext, QueryError, Result};
use crate::query::geo::{OPERATORS, Region, alone};
use crate::query::number::{Number, double_to_long};
use crate::query::regex::Pattern;
use crate::query::view::View;

/// Returns the test that an operator stands for; `siblings` is the document it is in.
pub(super) fn field_operator(
    parser: &Parser<'_>,
    name: &str,
    value: &Bson,
    siblings: &Document,
) -> Result<Option<Test>> {
    let leaf = match name {
        "$eq" => return equal(name, value).map(Some),
        "$ne" => return Ok(Some(not(equal(name, value)?))),
        "$gt" => order(name, Order::Greater, value)?,
        "$gte" => order(name, Order::GreaterOrEqual, value)?,
        "$lt" => order(name, Order::Less, value)?,
        "$lte" => order(name, Order::LessOrEqual, value)?,
        "$in" => Leaf::In(set(name, value)?),
        "$nin" => return Ok(Some(not(Test::Leaf(Leaf::In(set(name, value)?))))),
        "$not" => return Ok(Some(not(negated(parser, value)?))),
        "$exists" => {
            let exists = Test::Leaf(Leaf::Exists);
            return Ok(Some(if View::from(value).truthy() { exists } else { not(exists) }));
        }
        "$type" => Leaf::Type(TypeSet::parse(value.into())?),
        "$regex" => Leaf::Regex(regex(value, siblings.get("$options"))?),
        "$options" => {
            if !siblings.contains_key("$regex") {
                return Err(QueryError::bad_value("$options needs a $regex"));
            }
            return Ok(None);
        }
        "$mod" => modulo(value)?,
        "$size" => size(value)?,
        "$all" => return all(parser, value).map(Some),
        "$elemMatch" => return parser.element_match(value).map(Some),
        "$bitsAllSet" => Leaf::Bits(Bits::parse(value.into(), true, true)?),
        "$bitsAllClear" => Leaf::Bits(Bits::parse(value.into(), true, false)?),
        "$bitsAnySet" => Leaf::Bits(Bits::parse(value.into(), false, true)?),
        "$bitsAnyClear" => Leaf::Bits(Bits::parse(value.into(), false, false)?),
        "$geoWithin" | "$within" => {
            alone(name, siblings)?;
            Leaf::Place(Box::new(Region::within(name, value)?))
        }
        "$geoIntersects" => {
            alone(name, siblings)?;
            Leaf::Place(Box::new(Region::meets(value)?))
        }
        _ if OPERATORS.contains(&name) => return Err(parser.misplaced(name)),
        _ => return Err(unknown(NameContext::Condition, name, "unknown operator")),
    };
    Ok(Some(Test::Leaf(leaf)))
}

fn not(test: Test) -> Test {
    Test::Not(Box::new(test))
}

fn equal(name: &str, value: &Bson) -> Result<Test> {
    match value {
        Bson::Undefined => Err(QueryError::bad_value("cannot compare to undefined")),
        Bson::RegularExpression(_) if name == "$ne" => Err(QueryError::bad_value("can't have regex as arg to $ne")),
        value => Ok(Test::Leaf(Leaf::Equal(value.clone()))),
    }
}

fn order(name: &str, order: Order, value: &Bson) -> Result<Leaf> {
    match value {
        Bson::Undefined => Err(QueryError::bad_value("cannot compare to undefined")),
        Bson::RegularExpression(_) => {
            Err(QueryError::bad_value(format!("can't have RegEx as arg to predicate {name}")))
        }
        value => Ok(Leaf::Order(order, value.clone())),
    }
}

fn set(name: &str, value: &Bson) -> Result<Set> {
    let (mut values, mut patterns) = (Vec::new(), Vec::new());
    for item in array(name, value)? {
        match item {
            Bson::RegularExpression(regex) => {
                patterns.push(Pattern::new(regex.pattern.as_str(), regex.options.as_str())?);
            }
            Bson::Undefined => return Err(QueryError::bad_value(format!("{name} cannot contain undefined"))),
            item if is_operator_object(item.into()) => {
                return Err(QueryError::bad_value(format!("cannot nest $ under {name}")));
            }
            item => values.push(item.clone()),
        }
    }
    Ok(Set::new(values, patterns))
}

/// What `$not` takes: a pattern, or operators.
fn negated(parser: &Parser<'_>, value: &Bson) -> Result<Test> {
    match value {
        Bson::RegularExpression(_) => parser.field(value),
        Bson::Document(operators) if operators.is_empty() => Err(QueryError::bad_value("$not cannot be empty")),
        Bson::Document(operators) => parser.operators(operators),
        _ => Err(QueryError::bad_value("$not needs a regex or a document")),
    }
}

fn regex(value: &Bson, options: Option<&Bson>) -> Result<Pattern> {
    let options = match options {
        None => None,
        Some(Bson::String(options)) => Some(options.as_str()),
        Some(_) => return Err(QueryError::bad_value("$options has to be a string")),
    };
    match value {
        Bson::String(pattern) => Pattern::new(pattern, options.unwrap_or_default()),
        Bson::RegularExpression(regex) => {
            let own = regex.options.as_str();
            if options.is_some() && !own.is_empty() {
                return Err(QueryError::invalid(51_074, "options set in both $regex and $options"));
            }
            Pattern::new(regex.pattern.as_str(), options.unwrap_or(own))
        }
        _ => Err(QueryError::bad_value("$regex has to be a string")),
    }
}

fn modulo(value: &Bson) -> Result<Leaf> {
    let Bson::Array(items) = value else {
        return Err(QueryError::bad_value("malformed mod, needs to be an array"));
    };
    let [divisor, remainder] = items.as_slice() else {
        return Err(QueryError::bad_value("malformed mod, needs exactly two elements"));
    };
    let divisor = whole("divisor", divisor)?;
    if divisor == 0 {
        return Err(QueryError::bad_value("divisor cannot be 0"));
    }
    Ok(Leaf::Mod(divisor, whole("remainder", remainder)?))
}

/// Returns a number cut to its integer part.
fn whole(what: &str, value: &Bson) -> Result<i64> {
    let wrong = || QueryError::bad_value(format!("malformed mod, {what} is not a number in the range of a long"));
    match Number::of(value).ok_or_else(wrong)? {
        Number::Double(value) => double_to_long(value).ok_or_else(wrong),
        Number::Decimal(value) => value.to_i128().and_then(|value| i64::try_from(value).ok()).ok_or_else(wrong),
        other => Ok(other.to_long()),
    }
}

fn size(value: &Bson) -> Result<Leaf> {
    let size = Number::of(value)
        .and_then(Number::integral_32)
        .map(i64::from)
        .ok_or_else(|| QueryError::bad_value("$size must be a 32-bit integer"))?;
    if size < 0 {
        return Err(QueryError::bad_value("$size may not be negative"));
    }
    Ok(Leaf::Size(size))
}

/// Every listed value, or every `$elemMatch`; an empty list matches nothing.
fn all(parser: &Parser<'_>, value: &Bson) -> Result<Test> {
    let items = array("$all", value)?;
    let element_match = |item: &Bson| match item {
        Bson::Document(inner) if inner.keys().next().is_some_and(|name| name == "$elemMatch") => Some(inner.clone()),
        _ => None,
    };
    if items.is_empty() {
        return Ok(Test::Leaf(Leaf::Never));
    }
    let of_elements = items.first().is_some_and(|item| element_match(item).is_some());
    let tests = items.iter().map(|item| match element_match(item) {
        Some(inner) if of_elements => {
            if inner.len() > 1 {
                return Err(QueryError::bad_value("$all/$elemMatch has to be consistent"));
            }
            parser.element_match(inner.get("$elemMatch").unwrap_or(&Bson::Null))
        }
        None if of_elements => Err(QueryError::bad_value("$all/$elemMatch has to be consistent")),
        _ if is_operator_object(item.into()) => Err(QueryError::bad_value("no $ expressions in $all")),
        _ => parser.field(item),
    });
    Ok(Test::And(tests.collect::<Result<_>>()?))
}
