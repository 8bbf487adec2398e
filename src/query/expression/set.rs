//! Sets: arrays without order and duplicates.

use bson::Bson;

use super::operator::{ANY, Operator, at, is_null, wrong_type};
use super::value::Value;
use crate::query::compare::compare_values;
use crate::query::error::Result;
use crate::query::view::View;

pub(super) const OPERATORS: [Operator; 7] = [
    Operator { name: "$setEquals", arity: (2, ANY), call: equals },
    Operator { name: "$setIntersection", arity: (0, ANY), call: intersection },
    Operator { name: "$setUnion", arity: (0, ANY), call: union },
    Operator { name: "$setDifference", arity: (2, 2), call: difference },
    Operator { name: "$setIsSubset", arity: (2, 2), call: is_subset },
    Operator { name: "$allElementsTrue", arity: (1, 1), call: all_true },
    Operator { name: "$anyElementTrue", arity: (1, 1), call: any_true },
];

/// In BSON order, without duplicates.
pub(super) fn sorted(items: &[Bson]) -> Vec<Bson> {
    let mut items = items.to_vec();
    items.sort_by(compare_values);
    items.dedup_by(|a, b| compare_values(a, b).is_eq());
    items
}

fn contains(sorted: &[Bson], item: &Bson) -> bool {
    sorted.binary_search_by(|candidate| compare_values(candidate, item)).is_ok()
}

fn array<'a>(code: i32, operator: &str, value: &'a Bson) -> Result<&'a [Bson]> {
    match value {
        Bson::Array(items) => Ok(items),
        other => Err(wrong_type(code, operator, "arrays", other)),
    }
}

fn equals(values: &[Value]) -> Result<Value> {
    let mut first: Option<Vec<Bson>> = None;
    let mut equal = true;
    for index in 0..values.len() {
        let set = sorted(array(17_044, "$setEquals", at(values, index))?);
        match &first {
            None => first = Some(set),
            Some(first) => {
                equal &= first.len() == set.len() && first.iter().zip(&set).all(|(a, b)| compare_values(a, b).is_eq());
            }
        }
    }
    Ok(Some(Bson::Boolean(equal)))
}

fn intersection(values: &[Value]) -> Result<Value> {
    let mut common: Option<Vec<Bson>> = None;
    for index in 0..values.len() {
        let value = at(values, index);
        if is_null(value) {
            return Ok(Some(Bson::Null));
        }
        let set = sorted(array(17_047, "$setIntersection", value)?);
        common = Some(match common {
            None => set,
            // Of equal values, those of the smaller set stay.
            Some(common) if common.len() > set.len() => {
                set.into_iter().filter(|item| contains(&common, item)).collect()
            }
            Some(common) => common.into_iter().filter(|item| contains(&set, item)).collect(),
        });
    }
    Ok(Some(Bson::Array(common.unwrap_or_default())))
}

fn union(values: &[Value]) -> Result<Value> {
    let mut all = Vec::new();
    for index in 0..values.len() {
        let value = at(values, index);
        if is_null(value) {
            return Ok(Some(Bson::Null));
        }
        all.extend_from_slice(array(17_043, "$setUnion", value)?);
    }
    Ok(Some(Bson::Array(sorted(&all))))
}

fn difference(values: &[Value]) -> Result<Value> {
    let (from, without) = (at(values, 0), at(values, 1));
    if is_null(from) || is_null(without) {
        return Ok(Some(Bson::Null));
    }
    let from = array(17_048, "$setDifference", from)?;
    let without = sorted(array(17_049, "$setDifference", without)?);
    let mut left: Vec<Bson> = Vec::new();
    for item in from {
        if !contains(&without, item) && !left.iter().any(|known| compare_values(known, item).is_eq()) {
            left.push(item.clone());
        }
    }
    Ok(Some(Bson::Array(left)))
}

fn is_subset(values: &[Value]) -> Result<Value> {
    let subset = array(17_046, "$setIsSubset", at(values, 0))?;
    let set = sorted(array(17_042, "$setIsSubset", at(values, 1))?);
    Ok(Some(Bson::Boolean(subset.iter().all(|item| contains(&set, item)))))
}

fn all_true(values: &[Value]) -> Result<Value> {
    let items = array(17_040, "$allElementsTrue", at(values, 0))?;
    Ok(Some(Bson::Boolean(items.iter().all(|item| View::from(item).truthy()))))
}

fn any_true(values: &[Value]) -> Result<Value> {
    let items = array(17_041, "$anyElementTrue", at(values, 0))?;
    Ok(Some(Bson::Boolean(items.iter().any(|item| View::from(item).truthy()))))
}
