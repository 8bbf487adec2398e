//! Arrays.

use bson::{Bson, Document};

use super::operator::{ANY, Arguments, Named, Operator, at, is_null, is_nullish, type_name, wrong_type};
use super::value::Value;
use crate::query::compare::{compare_values, equal_values};
use crate::query::error::{QueryError, Result};
use crate::query::limit::check_elements;
use crate::query::number::Number;
use crate::query::ranking::Ranking;

pub(super) const OPERATORS: [Operator; 13] = [
    Operator { name: "$arrayElemAt", arity: (2, 2), call: element },
    Operator { name: "$concatArrays", arity: (0, ANY), call: concatenated },
    Operator { name: "$first", arity: (1, 1), call: |v| end("$first", v, true) },
    Operator { name: "$last", arity: (1, 1), call: |v| end("$last", v, false) },
    Operator { name: "$in", arity: (2, 2), call: is_in },
    Operator { name: "$indexOfArray", arity: (2, 4), call: index_of },
    Operator { name: "$isArray", arity: (1, 1), call: |v| Ok(Some(Bson::Boolean(matches!(at(v, 0), Bson::Array(_))))) },
    Operator { name: "$range", arity: (2, 3), call: range },
    Operator { name: "$reverseArray", arity: (1, 1), call: reversed },
    Operator { name: "$size", arity: (1, 1), call: size },
    Operator { name: "$slice", arity: (2, 3), call: slice },
    Operator { name: "$arrayToObject", arity: (1, 1), call: to_object },
    Operator { name: "$objectToArray", arity: (1, 1), call: from_object },
];

pub(super) const NAMED: [Named; 6] = [
    Named {
        name: "$zip",
        fields: &[("inputs", true), ("useLongestLength", false), ("defaults", false)],
        bare: false,
        call: zip,
    },
    Named { name: "$sortArray", fields: &[("input", true), ("sortBy", true)], bare: false, call: sorted },
    Named { name: "$firstN", fields: &[("input", true), ("n", true)], bare: false, call: |a| take(a, Take::First) },
    Named { name: "$lastN", fields: &[("input", true), ("n", true)], bare: false, call: |a| take(a, Take::Last) },
    Named { name: "$minN", fields: &[("input", true), ("n", true)], bare: false, call: |a| take(a, Take::Least) },
    Named { name: "$maxN", fields: &[("input", true), ("n", true)], bare: false, call: |a| take(a, Take::Greatest) },
];

/// Returns the array; `None` if it is null.
fn array<'a>(code: i32, operator: &str, value: &'a Bson) -> Result<Option<&'a [Bson]>> {
    match value {
        Bson::Array(items) => Ok(Some(items)),
        value if is_null(value) => Ok(None),
        other => Err(wrong_type(code, operator, "an array", other)),
    }
}

/// The same, with a code for what is not a number.
fn whole(codes: (i32, i32), operator: &str, value: &Bson) -> Result<i64> {
    if Number::of(value).is_none() {
        return Err(wrong_type(codes.0, operator, "a number", value));
    }
    integer(codes.1, operator, value).map(i64::from)
}

/// Returns an integer of 32 bits, as any number writes it.
fn integer(code: i32, operator: &str, value: &Bson) -> Result<i32> {
    Number::of(value)
        .and_then(Number::integral_32)
        .ok_or_else(|| QueryError::invalid(code, format!("{operator} needs a 32-bit integer, not {value}")))
}

fn element(values: &[Value]) -> Result<Value> {
    if values.iter().any(is_nullish) {
        return Ok(Some(Bson::Null));
    }
    let Some(items) = array(28_689, "$arrayElemAt", at(values, 0))? else { return Ok(Some(Bson::Null)) };
    let index = at(values, 1);
    if Number::of(index).is_none() {
        return Err(wrong_type(28_690, "$arrayElemAt", "a numeric index", index));
    }
    let index = i64::from(integer(28_691, "$arrayElemAt", index)?);
    let length = i64::try_from(items.len()).unwrap_or(i64::MAX);
    let index = if index < 0 { index + length } else { index };
    Ok(usize::try_from(index).ok().and_then(|index| items.get(index).cloned()))
}

fn end(operator: &str, values: &[Value], first: bool) -> Result<Value> {
    match array(28_689, operator, at(values, 0))? {
        None => Ok(Some(Bson::Null)),
        Some(items) => Ok(if first { items.first() } else { items.last() }.cloned()),
    }
}

fn concatenated(values: &[Value]) -> Result<Value> {
    let mut arrays = Vec::with_capacity(values.len());
    for index in 0..values.len() {
        match array(28_664, "$concatArrays", at(values, index))? {
            None => return Ok(Some(Bson::Null)),
            Some(items) => arrays.push(items),
        }
    }
    check_elements(arrays.iter().map(|items| items.len()).sum(), 0)?;
    Ok(Some(Bson::Array(arrays.concat())))
}

fn is_in(values: &[Value]) -> Result<Value> {
    match at(values, 1) {
        Bson::Array(items) => {
            let found = match values.first().and_then(Option::as_ref) {
                Some(value) => items.iter().any(|item| equal_values(item, value)),
                None => false,
            };
            Ok(Some(Bson::Boolean(found)))
        }
        other => Err(wrong_type(40_081, "$in", "an array as a second argument", other)),
    }
}

fn index_of(values: &[Value]) -> Result<Value> {
    let Some(items) = array(40_090, "$indexOfArray", at(values, 0))? else { return Ok(Some(Bson::Null)) };
    let bound = |index: usize, default: usize| -> Result<usize> {
        match values.get(index) {
            None => Ok(default),
            Some(_) => {
                let value = integer(40_096, "$indexOfArray", at(values, index))?;
                usize::try_from(value)
                    .map_err(|_| QueryError::invalid(40_097, "$indexOfArray needs a bound that is not negative"))
            }
        }
    };
    let (start, end) = (bound(2, 0)?, bound(3, items.len())?.min(items.len()));
    let wanted = values.get(1).and_then(Option::as_ref);
    let found = (start..end).find(|index| match (items.get(*index), wanted) {
        (Some(item), Some(wanted)) => equal_values(item, wanted),
        _ => false,
    });
    Ok(Some(Bson::Int32(found.and_then(|index| i32::try_from(index).ok()).unwrap_or(-1))))
}

fn range(values: &[Value]) -> Result<Value> {
    let numeric = |index: usize, codes| whole(codes, "$range", at(values, index));
    let (start, end) = (numeric(0, (34_443, 34_444))?, numeric(1, (34_445, 34_446))?);
    let step = if values.len() > 2 { numeric(2, (34_447, 34_448))? } else { 1 };
    if step == 0 {
        return Err(QueryError::invalid(34_449, "$range requires a non-zero step value"));
    }
    let count = if step > 0 { (end - start + step - 1) / step } else { (end - start + step + 1) / step };
    check_elements(usize::try_from(count).unwrap_or(0), 0)?;
    let items = (0..count.max(0)).filter_map(|index| i32::try_from(start + index * step).ok().map(Bson::Int32));
    Ok(Some(Bson::Array(items.collect())))
}

fn reversed(values: &[Value]) -> Result<Value> {
    let items = array(34_435, "$reverseArray", at(values, 0))?;
    Ok(Some(items.map_or(Bson::Null, |items| Bson::Array(items.iter().rev().cloned().collect()))))
}

fn size(values: &[Value]) -> Result<Value> {
    match at(values, 0) {
        Bson::Array(items) => Ok(Some(Bson::Int32(i32::try_from(items.len()).unwrap_or(i32::MAX)))),
        other => Err(wrong_type(17_124, "$size", "an array", other)),
    }
}

fn slice(values: &[Value]) -> Result<Value> {
    if values.iter().take(2).any(is_nullish) {
        return Ok(Some(Bson::Null));
    }
    let Some(items) = array(28_724, "$slice", at(values, 0))? else { return Ok(Some(Bson::Null)) };
    let length = i64::try_from(items.len()).unwrap_or(i64::MAX);
    let first = whole((28_725, 28_726), "$slice", at(values, 1))?;
    let (start, count) = if values.len() == 3 {
        if is_null(at(values, 2)) {
            return Ok(Some(Bson::Null));
        }
        let count = whole((28_727, 28_728), "$slice", at(values, 2))?;
        if count <= 0 {
            return Err(QueryError::invalid(28_729, "the third argument to $slice must be positive"));
        }
        (if first < 0 { (length + first).max(0) } else { first.min(length) }, count)
    } else if first < 0 {
        ((length + first).max(0), length)
    } else {
        (0, first)
    };
    let start = usize::try_from(start).unwrap_or(0);
    let count = usize::try_from(count).unwrap_or(0);
    Ok(Some(Bson::Array(items.iter().skip(start).take(count).cloned().collect())))
}

fn to_object(values: &[Value]) -> Result<Value> {
    let Some(items) = array(40_386, "$arrayToObject", at(values, 0))? else { return Ok(Some(Bson::Null)) };
    let mut document = Document::new();
    let mut pairs: Option<bool> = None;
    for item in items {
        let is_pair = matches!(item, Bson::Array(_));
        if pairs.is_some_and(|pairs| pairs != is_pair) {
            return Err(QueryError::invalid(40_391, "$arrayToObject requires a consistent input format"));
        }
        pairs = Some(is_pair);
        let (key, value) = match item {
            Bson::Array(pair) => match pair.as_slice() {
                [key, value] => (key, value),
                _ => return Err(QueryError::invalid(40_397, "$arrayToObject requires an array of size 2 arrays")),
            },
            Bson::Document(pair) => match (pair.get("k"), pair.get("v"), pair.len()) {
                (Some(key), Some(value), 2) => (key, value),
                _ => return Err(QueryError::invalid(40_392, "$arrayToObject requires objects with exactly k and v")),
            },
            other => return Err(wrong_type(40_398, "$arrayToObject", "objects or arrays", other)),
        };
        let Bson::String(key) = key else {
            return Err(wrong_type(40_394, "$arrayToObject", "keys of type string", key));
        };
        if key.contains('\0') {
            return Err(QueryError::invalid(4_940_400, "a key cannot contain a NUL"));
        }
        document.insert(key.clone(), value.clone());
    }
    Ok(Some(Bson::Document(document)))
}

/// Bytes of memory of a document `{k, v}`.
const PAIR: usize = 512;

fn from_object(values: &[Value]) -> Result<Value> {
    match at(values, 0) {
        Bson::Document(document) => {
            check_elements(document.len(), PAIR)?;
            let pairs = document.iter().map(|(key, value)| {
                let mut pair = Document::new();
                pair.insert("k", key.clone());
                pair.insert("v", value.clone());
                Bson::Document(pair)
            });
            Ok(Some(Bson::Array(pairs.collect())))
        }
        value if is_null(value) => Ok(Some(Bson::Null)),
        other => Err(wrong_type(40_390, "$objectToArray", "an object", other)),
    }
}

fn zip(arguments: &Arguments) -> Result<Value> {
    let longest = match arguments.get(1) {
        Bson::Boolean(longest) => *longest,
        _ if !arguments.given(1) => false,
        _ => return Err(QueryError::invalid(34_463, "useLongestLength must be a bool")),
    };
    let defaults = match arguments.get(2) {
        Bson::Array(items) => items.as_slice(),
        _ if !arguments.given(2) => &[],
        value if is_null(value) => &[],
        other => return Err(wrong_type(34_462, "$zip", "an array of defaults", other)),
    };
    if arguments.given(2) && !longest {
        return Err(QueryError::invalid(34_466, "cannot specify defaults unless useLongestLength is true"));
    }
    let Bson::Array(inputs) = arguments.get(0) else {
        if is_null(arguments.get(0)) {
            return Ok(Some(Bson::Null));
        }
        return Err(QueryError::invalid(34_461, "inputs must be an array of expressions"));
    };
    if inputs.is_empty() {
        return Err(QueryError::invalid(34_465, "$zip requires at least one input array"));
    }
    if !defaults.is_empty() && defaults.len() != inputs.len() {
        return Err(QueryError::invalid(34_467, "defaults and inputs must have the same length"));
    }
    let mut arrays = Vec::with_capacity(inputs.len());
    for input in inputs {
        match array(34_468, "$zip", input)? {
            None => return Ok(Some(Bson::Null)),
            Some(items) => arrays.push(items),
        }
    }
    let lengths = arrays.iter().map(|items| items.len());
    let length = if longest { lengths.max() } else { lengths.min() }.unwrap_or(0);
    check_elements(length, arrays.len().saturating_mul(size_of::<Bson>()))?;
    let rows = (0..length).map(|row| {
        let cells = arrays
            .iter()
            .enumerate()
            .map(|(column, items)| items.get(row).or_else(|| defaults.get(column)).cloned().unwrap_or(Bson::Null));
        Bson::Array(cells.collect())
    });
    Ok(Some(Bson::Array(rows.collect())))
}

fn sorted(arguments: &Arguments) -> Result<Value> {
    let order = arguments.get(1);
    let by_value = Number::of(order).map(Number::integral);
    let pattern = match order {
        Bson::Document(pattern) => {
            Some(Ranking::parse(pattern).map_err(|error| QueryError { code: 2_942_505, ..error })?)
        }
        _ if matches!(by_value, Some(Some(1 | -1))) => None,
        other if by_value.is_some() => return Err(wrong_type(2_942_506, "$sortArray", "1 or -1", other)),
        other => return Err(wrong_type(2_942_507, "$sortArray", "a pattern, 1 or -1", other)),
    };
    let Some(items) = array(2_942_504, "$sortArray", arguments.get(0))? else { return Ok(Some(Bson::Null)) };
    let mut items = items.to_vec();
    match pattern {
        None if by_value == Some(Some(1)) => items.sort_by(compare_values),
        None => items.sort_by(|a, b| compare_values(b, a)),
        Some(pattern) => pattern.sort(&mut items),
    }
    Ok(Some(Bson::Array(items)))
}

/// Which elements `$firstN` and its kin take.
enum Take {
    First,
    Last,
    Least,
    Greatest,
}

fn take(arguments: &Arguments, which: Take) -> Result<Value> {
    let wrong = |code| QueryError::invalid(code, format!("{} needs a positive integral 'n'", arguments.operator));
    let count = Number::of(arguments.get(1)).ok_or_else(|| wrong(5_787_902))?;
    let count = count.integral().ok_or_else(|| wrong(5_787_903))?;
    let count = usize::try_from(count).ok().filter(|count| *count > 0).ok_or_else(|| wrong(5_787_908))?;
    let Bson::Array(items) = arguments.get(0) else {
        let found = type_name(arguments.get(0));
        return Err(QueryError::invalid(5_788_200, format!("{} needs an array, not {found}", arguments.operator)));
    };
    let mut items = items.clone();
    match which {
        Take::First => items.truncate(count),
        Take::Last => {
            items.drain(..items.len().saturating_sub(count));
        }
        Take::Least | Take::Greatest => {
            items.retain(|item| !is_null(item));
            if matches!(which, Take::Least) {
                items.sort_by(compare_values);
                items.truncate(count);
            } else {
                items.sort_by(|a, b| compare_values(b, a));
                items.truncate(count);
                // Of equal ones, the latest comes first.
                items.reverse();
                items.sort_by(|a, b| compare_values(b, a));
            }
        }
    }
    Ok(Some(Bson::Array(items)))
}
