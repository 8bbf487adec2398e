//! Accumulators of `$group` and the bucket stages.

use bson::{Bson, Document};

use super::collected::{Collected, Distinct};
use super::run::Run;
use super::script::Script;
use super::state::State;
use crate::query::compare::compare_values;
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Expression, Scope, field_value};
use crate::query::key;
use crate::query::limit::Memory;
use crate::query::number::Number;
use crate::query::sort::Sort;
use crate::query::statistics::{Deviation, Sum};
use crate::query::view::Fields;

/// The most values of `$firstN` and its kin.
const MAX_N: usize = 1 << 24;

/// An accumulator as a stage names it.
#[derive(Debug)]
pub(super) struct Accumulator {
    operator: Operator,
    input: Expression,
}

#[derive(Debug)]
enum Operator {
    Sum,
    Average,
    Deviation {
        sample: bool,
    },
    Extreme {
        greatest: bool,
    },
    First,
    Last,
    Push,
    AddToSet,
    Merge,
    /// `$firstN`, `$lastN`.
    FirstOrLast {
        first: bool,
        count: Expression,
    },
    /// `$minN`, `$maxN`.
    Extremes {
        greatest: bool,
        count: Expression,
    },
    /// `$top`, `$bottom`, `$topN`, `$bottomN`.
    Ranked {
        sort: Sort,
        bottom: bool,
        count: Option<Expression>,
    },
    Script(Box<Script>),
}

impl Accumulator {
    /// Reads `{$sum: …}`.
    pub(super) fn parse(spec: &Bson, scope: &Scope) -> Result<Self> {
        Self::read(spec, scope, false)
    }

    /// Reads `{$sum: …}` as a window function, whose argument may be an array.
    pub(super) fn of_window(spec: &Bson, scope: &Scope) -> Result<Self> {
        Self::read(spec, scope, true)
    }

    /// Returns whether it looks like one: an object that begins with an operator.
    pub(super) fn is_one(spec: &Bson) -> bool {
        matches!(spec, Bson::Document(spec) if spec.keys().next().is_some_and(|name| name.starts_with('$')))
    }

    fn read(spec: &Bson, scope: &Scope, takes_arrays: bool) -> Result<Self> {
        let Bson::Document(spec) = spec else {
            return Err(QueryError::invalid(40_234, "a computed field must be an accumulator object"));
        };
        let (Some((name, argument)), 1) = (spec.iter().next(), spec.len()) else {
            return Err(QueryError::invalid(40_238, "a computed field must specify exactly one accumulator"));
        };
        Self::named(name, argument, scope, takes_arrays).map_err(|error| error.about(name))
    }

    fn named(name: &str, argument: &Bson, scope: &Scope, takes_arrays: bool) -> Result<Self> {
        let takes_one = ["$count", "$top", "$topN", "$bottom", "$bottomN", "$accumulator"].contains(&name);
        if takes_one && !takes_arrays && matches!(argument, Bson::Array(_)) {
            return Err(QueryError::invalid(40_237, format!("the {name} accumulator is a unary operator")));
        }
        let operator = match name {
            "$sum" => Operator::Sum,
            "$avg" => Operator::Average,
            "$stdDevPop" => Operator::Deviation { sample: false },
            "$stdDevSamp" => Operator::Deviation { sample: true },
            "$min" => Operator::Extreme { greatest: false },
            "$max" => Operator::Extreme { greatest: true },
            "$first" => Operator::First,
            "$last" => Operator::Last,
            "$push" => Operator::Push,
            "$addToSet" => Operator::AddToSet,
            "$mergeObjects" => Operator::Merge,
            "$count" => {
                if !matches!(argument, Bson::Document(argument) if argument.is_empty()) {
                    return Err(QueryError::type_mismatch("$count takes no arguments, i.e. $count: {}"));
                }
                return Ok(Self { operator: Operator::Sum, input: Expression::Constant(Some(Bson::Int32(1))) });
            }
            "$firstN" | "$lastN" | "$minN" | "$maxN" => return Self::of_several(name, argument, scope),
            "$top" | "$bottom" | "$topN" | "$bottomN" => return Self::ranked(name, argument, scope),
            "$accumulator" => {
                let script = Script::parse(argument, scope)?;
                return Ok(Self { operator: Operator::Script(Box::new(script)), input: Expression::Constant(None) });
            }
            _ => return Err(QueryError::invalid(15_952, format!("unknown group operator '{name}'"))),
        };
        let argument = match argument {
            Bson::Array(_) if !takes_arrays => {
                return Err(QueryError::invalid(40_237, format!("the {name} accumulator is a unary operator")));
            }
            other => other,
        };
        Ok(Self { operator, input: Expression::parse_in(argument, scope)? })
    }

    /// Counts documents.
    pub(super) fn counting() -> Self {
        Self { operator: Operator::Sum, input: Expression::Constant(Some(Bson::Int32(1))) }
    }

    /// Returns whether it is `{$sum: 1}`.
    pub(super) fn counts(&self) -> bool {
        matches!((&self.operator, &self.input), (Operator::Sum, Expression::Constant(Some(Bson::Int32(1)))))
    }

    fn of_several(name: &str, argument: &Bson, scope: &Scope) -> Result<Self> {
        let fields = fields(name, argument, &["input", "n"])?;
        let count = Expression::parse_in(fields.get("n").unwrap_or(&Bson::Null), scope)?;
        let input = Expression::parse_in(fields.get("input").unwrap_or(&Bson::Null), scope)?;
        let operator = match name {
            "$firstN" | "$lastN" => Operator::FirstOrLast { first: name == "$firstN", count },
            _ => Operator::Extremes { greatest: name == "$maxN", count },
        };
        Ok(Self { operator, input })
    }

    fn ranked(name: &str, argument: &Bson, scope: &Scope) -> Result<Self> {
        let several = name.ends_with('N');
        let names: &[&str] = if several { &["output", "sortBy", "n"] } else { &["output", "sortBy"] };
        let fields = fields(name, argument, names)?;
        let pattern = match fields.get("sortBy") {
            Some(Bson::Document(pattern)) => pattern,
            Some(Bson::Array(items)) if !items.is_empty() => {
                return Err(QueryError::invalid(15_974, format!("{name} needs an object as sortBy, and no array")));
            }
            _ => return Err(QueryError::invalid(10_065, format!("{name} needs an object as sortBy"))),
        };
        let count =
            if several { Some(Expression::parse_in(fields.get("n").unwrap_or(&Bson::Null), scope)?) } else { None };
        let input = Expression::parse_in(fields.get("output").unwrap_or(&Bson::Null), scope)?;
        Ok(Self {
            operator: Operator::Ranked { sort: Sort::parse(pattern)?, bottom: name.starts_with("$bottom"), count },
            input,
        })
    }

    /// Returns the state before the first document; `fields` is the group's `_id` for counts that depend on it.
    pub(super) fn start<E>(&self, id: &Bson, run: &Run<'_, E>) -> Result<State> {
        Ok(match &self.operator {
            Operator::Sum => State::Sum(Sum::default()),
            Operator::Average => State::Average(Sum::default(), 0),
            Operator::Deviation { .. } => State::Deviation(Deviation::default()),
            Operator::Extreme { .. } | Operator::First | Operator::Last => State::One(None),
            Operator::Push => State::Many(Collected::default()),
            Operator::AddToSet => State::Distinct(Distinct::default()),
            Operator::Merge => State::Merged(Document::new(), Memory::default()),
            Operator::FirstOrLast { count, .. } | Operator::Extremes { count, .. } => {
                State::Counted(limit(count, id, run)?, Vec::new(), Memory::default())
            }
            Operator::Ranked { count: Some(count), .. } => {
                State::Ranked(limit(count, id, run)?, Vec::new(), Memory::default())
            }
            Operator::Script(script) => State::One(script.start(id, run)?),
            Operator::Ranked { count: None, .. } => State::Ranked(1, Vec::new(), Memory::default()),
        })
    }

    /// Takes the next document in.
    pub(super) fn add<E>(&self, state: &mut State, fields: Fields<'_>, run: &Run<'_, E>) -> Result<()> {
        // Values that would not be kept are not computed.
        match (&self.operator, &*state) {
            (Operator::First, State::One(Some(_))) => return Ok(()),
            // As in mongod, one value more than is kept is evaluated.
            (Operator::FirstOrLast { first: true, .. }, State::Counted(limit, values, _)) if values.len() > *limit => {
                return Ok(());
            }
            _ => {}
        }
        if let (Operator::Script(script), State::One(value)) = (&self.operator, &mut *state) {
            *value = script.add(value.take(), fields, run)?;
            return Ok(());
        }
        let value = self.input.evaluate(&run.environment(fields))?;
        let number = || value.as_ref().and_then(Number::of);
        match (&self.operator, state) {
            (Operator::Sum, State::Sum(sum)) => number().into_iter().for_each(|number| sum.add(number)),
            (Operator::Average, State::Average(sum, count)) => {
                if let Some(number) = number() {
                    sum.add(number);
                    *count += 1;
                }
            }
            (Operator::Deviation { .. }, State::Deviation(deviation)) => {
                number().into_iter().for_each(|number| deviation.add(number));
            }
            (Operator::Extreme { greatest }, State::One(best)) => add_extreme(best, value, *greatest),
            (Operator::First, State::One(first)) if first.is_none() => *first = Some(value.unwrap_or(Bson::Null)),
            (Operator::Last, State::One(last)) => *last = Some(value.unwrap_or(Bson::Null)),
            (Operator::Push, State::Many(values)) => value.map_or(Ok(()), |value| values.add(value))?,
            (Operator::AddToSet, State::Distinct(values)) => value.map_or(Ok(()), |value| values.add(value))?,
            (Operator::Merge, State::Merged(document, memory)) => add_fields(document, value, memory)?,
            (Operator::FirstOrLast { first, .. }, State::Counted(limit, values, memory)) => {
                let value = value.unwrap_or(Bson::Null);
                memory.add(&value)?;
                values.push(value);
                if !*first && values.len() > *limit {
                    memory.remove(&values.remove(0));
                }
            }
            (Operator::Extremes { greatest, .. }, State::Counted(limit, values, memory)) => {
                add_to_extremes(values, value, (*limit, *greatest), memory)?;
            }
            (Operator::Ranked { sort, bottom, .. }, State::Ranked(limit, ranked, memory)) => {
                add_ranked(ranked, (rank(sort, fields), value.unwrap_or(Bson::Null)), (*limit, *bottom), memory)?;
            }
            _ => {}
        }
        Ok(())
    }

    /// Returns the accumulated value.
    pub(super) fn finish(&self, state: State) -> Result<Bson> {
        Ok(match (&self.operator, state) {
            (Operator::Script(script), State::One(value)) => script.finish(value)?,
            (_, State::Sum(sum)) => sum.total().into(),
            (_, State::Average(sum, count)) => sum.mean(count).map_or(Bson::Null, Bson::from),
            (Operator::Deviation { sample }, State::Deviation(deviation)) => deviation.value(*sample),
            (_, State::One(value)) => value.unwrap_or(Bson::Null),
            (_, State::Many(values)) => Bson::Array(values.values()?),
            (_, State::Counted(limit, mut values, _)) => {
                values.truncate(limit);
                Bson::Array(values)
            }
            (_, State::Distinct(values)) => Bson::Array(values.into_collected().values()?),
            (_, State::Merged(document, _)) => Bson::Document(document),
            (Operator::Ranked { count: None, .. }, State::Ranked(_, ranked, _)) => {
                ranked.into_iter().next().map_or(Bson::Null, |(_, value)| value)
            }
            (_, State::Ranked(_, ranked, _)) => Bson::Array(ranked.into_iter().map(|(_, value)| value).collect()),
            (_, State::Deviation(deviation)) => deviation.value(false),
        })
    }
}

/// Takes a value for the least or greatest one.
fn add_extreme(best: &mut Option<Bson>, value: Option<Bson>, greatest: bool) {
    let Some(value) = value.filter(|value| !is_null(value)) else { return };
    let better = best.as_ref().is_none_or(|best| {
        let order = compare_values(&value, best);
        if greatest { order.is_gt() } else { order.is_lt() }
    });
    if better {
        *best = Some(value);
    }
}

/// Adds the fields of a value to a document.
fn add_fields(document: &mut Document, value: Option<Bson>, memory: &mut Memory) -> Result<()> {
    match value {
        Some(Bson::Document(more)) => {
            memory.add_new(document, &more)?;
            document.extend(more);
            Ok(())
        }
        Some(value) if !is_null(&value) => {
            Err(QueryError::invalid(40_400, "$mergeObjects requires object inputs").about("$mergeObjects"))
        }
        _ => Ok(()),
    }
}

/// Takes a value among the so many least or greatest ones. What equals the last does not take its place. Of equal ones, the
/// latest of the greatest comes first, and the earliest of the least.
fn add_to_extremes(
    values: &mut Vec<Bson>,
    value: Option<Bson>,
    (limit, greatest): (usize, bool),
    memory: &mut Memory,
) -> Result<()> {
    let Some(value) = value.filter(|value| !is_null(value)) else { return Ok(()) };
    let order = |known: &Bson| {
        let order = compare_values(known, &value);
        if greatest { order.reverse() } else { order }
    };
    if values.len() == limit && values.last().is_some_and(|last| order(last).is_le()) {
        return Ok(());
    }
    let at = values.partition_point(|known| order(known).is_lt() || !greatest && order(known).is_eq());
    memory.add(&value)?;
    values.insert(at, value);
    values.drain(limit.min(values.len())..).for_each(|value| memory.remove(&value));
    Ok(())
}

/// Takes a value by its rank among the so many first or last ones. Of equal ones, the earlier stays.
fn add_ranked(
    ranked: &mut Vec<(Vec<u8>, Bson)>,
    (key, value): (Vec<u8>, Bson),
    (limit, bottom): (usize, bool),
    memory: &mut Memory,
) -> Result<()> {
    if ranked.len() == limit {
        let worst = if bottom { 0 } else { ranked.len().saturating_sub(1) };
        match ranked.get(worst) {
            Some((known, _)) if bottom && key <= *known || !bottom && key >= *known => return Ok(()),
            _ => memory.remove(&ranked.remove(worst).1),
        }
    }
    let at = ranked.partition_point(|(known, _)| *known <= key);
    memory.add(&value)?;
    ranked.insert(at, (key, value));
    Ok(())
}

/// Returns the place of a document for `$top` and its like. Unlike in `$sort`, arrays count as a whole
/// there, except that an empty one comes before null.
fn rank(sort: &Sort, fields: Fields<'_>) -> Vec<u8> {
    let mut bytes = Vec::new();
    for (path, descending) in sort.fields() {
        let parts: Vec<String> = path.split('.').map(str::to_owned).collect();
        let value = match field_value(fields, &parts) {
            None => Bson::Null,
            Some(Bson::Array(items)) if items.is_empty() => Bson::Undefined,
            Some(value) => value,
        };
        let start = bytes.len();
        bytes.extend(key::collated(&value));
        if descending {
            bytes.iter_mut().skip(start).for_each(|byte| *byte = !*byte);
        }
    }
    bytes
}

fn is_null(value: &Bson) -> bool {
    matches!(value, Bson::Null | Bson::Undefined)
}

/// Returns a count as an int, or a long where it must be.
pub(super) fn count(count: i64) -> Bson {
    i32::try_from(count).map_or(Bson::Int64(count), Bson::Int32)
}

fn limit<E>(count: &Expression, id: &Bson, run: &Run<'_, E>) -> Result<usize> {
    let value = match id {
        Bson::Document(id) => count.evaluate(&run.environment(id.into()))?,
        _ => count.evaluate(&run.environment((&Document::new()).into()))?,
    };
    let wrong = |code| QueryError::invalid(code, "'n' must be a positive integral value");
    let limit = value.as_ref().and_then(Number::of).ok_or_else(|| wrong(5_787_902))?;
    let limit = limit.integral().ok_or_else(|| wrong(5_787_903))?;
    let limit = usize::try_from(limit).ok().filter(|limit| *limit > 0).ok_or_else(|| wrong(5_787_908))?;
    Ok(limit.min(MAX_N))
}

/// Returns the arguments of an accumulator: exactly these names.
fn fields<'a>(name: &str, argument: &'a Bson, names: &[&str]) -> Result<&'a Document> {
    let (shape, unknown) = match name {
        "$firstN" | "$lastN" => (5_787_801, 5_787_901),
        "$minN" | "$maxN" => (5_787_900, 5_787_901),
        _ => (5_788_001, 5_788_002),
    };
    let Bson::Document(fields) = argument else {
        return Err(QueryError::invalid(shape, format!("{name} needs an object")));
    };
    if let Some(other) = fields.keys().find(|known| !names.contains(&known.as_str())) {
        return Err(QueryError::invalid(unknown, format!("unknown argument to {name}: {other}")));
    }
    let is_ranked = names.contains(&"sortBy");
    let missing = ["n", "input", "output", "sortBy"].into_iter().zip(if is_ranked {
        [5_788_003, 0, 5_788_004, 5_788_005]
    } else {
        [5_787_906, 5_787_907, 0, 0]
    });
    match missing.into_iter().find(|(wanted, _)| names.contains(wanted) && !fields.contains_key(wanted)) {
        Some((wanted, code)) => Err(QueryError::invalid(code, format!("missing value for '{wanted}' of {name}"))),
        None => Ok(fields),
    }
}
