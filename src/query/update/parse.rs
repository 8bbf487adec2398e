//! Parses update operators; a table with one operator per line.

use bson::{Bson, Document};

use super::array::{self, Pull, Push};
use super::filters::ArrayFilters;
use super::modifier::{Action, Bitwise, Modifier, Segment, check_conflicts, order, path};
use crate::query::error::{BAD_VALUE, NameContext, QueryError, QueryMistake, Result};
use crate::query::number::Number;

/// Reads the argument of an operator at a path.
type Reader = fn(&str, &Bson) -> Result<Action>;

const OPERATORS: [(&str, Reader); 15] = [
    ("$set", |_, value| Ok(Action::Set(value.clone()))),
    ("$setOnInsert", |_, value| Ok(Action::SetOnInsert(value.clone()))),
    ("$unset", |_, _| Ok(Action::Unset)),
    ("$inc", |path, value| number("$inc", path, value).map(Action::Increment)),
    ("$mul", |path, value| number("$mul", path, value).map(Action::Multiply)),
    ("$min", |_, value| Ok(Action::Least(value.clone()))),
    ("$max", |_, value| Ok(Action::Greatest(value.clone()))),
    ("$rename", rename),
    ("$currentDate", current_date),
    ("$bit", bits),
    ("$push", |_, value| Push::parse(value).map(Action::Push)),
    ("$addToSet", |_, value| array::each(value).map(Action::AddToSet)),
    ("$pop", pop),
    ("$pull", |_, value| Pull::parse(value).map(Action::Pull)),
    ("$pullAll", |_, value| match value {
        Bson::Array(values) => Ok(Action::PullAll(values.clone())),
        _ => Err(QueryError::bad_value("$pullAll requires an array argument")),
    }),
];

/// All operators of an update, in the order in which they are applied.
pub(super) fn modifiers(update: &Document, filters: &ArrayFilters) -> Result<Vec<Modifier>> {
    let mut modifiers = Vec::new();
    for (name, argument) in update {
        let Some((_, read)) = OPERATORS.iter().find(|(known, _)| known == name) else {
            let message =
                format!("unknown modifier: {name}; expected an update operator, a replacement, or a pipeline");
            return Err(QueryError::failed_to_parse(message)
                .about(name)
                .of_kind(QueryMistake::UnknownName(NameContext::Update)));
        };
        let Bson::Document(fields) = argument else {
            return Err(
                QueryError::failed_to_parse(format!("modifiers operate on fields but {name} has none")).about(name)
            );
        };
        for (text, value) in fields {
            if name == "$rename" {
                check_renamed(text, value).map_err(|error| error.about(name))?;
            }
            let path = path(text).map_err(|error| error.about(text))?;
            for segment in &path {
                if let Segment::Filtered(identifier) = segment {
                    filters.mark(identifier)?;
                }
            }
            let action = read(text, value).map_err(|error| error.about(name))?;
            modifiers.push(match action {
                // Renames are ordered by their targets.
                Action::Rename(target) => {
                    if has_positions(&path) {
                        let message = format!("the source field for $rename may not be dynamic: {text}");
                        return Err(QueryError::bad_value(message).about(name));
                    }
                    if target.starts_with(&path) || path.starts_with(&target) {
                        let message = "the source and target field for $rename must not be on the same path";
                        return Err(QueryError::bad_value(format!("{message}: {text}")).about(name));
                    }
                    Modifier { path: target, text: text.clone(), action: Action::Rename(path) }
                }
                action => Modifier { path, text: text.clone(), action },
            });
        }
        conflicts(&modifiers)?;
    }
    filters.check_used()?;
    modifiers.sort_by(|a, b| order(&a.path, &b.path));
    Ok(modifiers)
}

fn conflicts(modifiers: &[Modifier]) -> Result<()> {
    let mut paths: Vec<(&[Segment], &str)> = Vec::new();
    for modifier in modifiers {
        paths.push((&modifier.path, &modifier.text));
        if let Action::Rename(source) = &modifier.action {
            paths.push((source, &modifier.text));
        }
    }
    check_conflicts(&paths)
}

fn has_positions(path: &[Segment]) -> bool {
    path.iter().any(|segment| !matches!(segment, Segment::Name(_)))
}

fn number(operator: &str, path: &str, value: &Bson) -> Result<Number> {
    Number::of(value).ok_or_else(|| {
        QueryError::type_mismatch(format!("cannot {operator} with non-numeric argument: {{{path}: {value}}}"))
    })
}

fn check_renamed(text: &str, target: &Bson) -> Result<()> {
    match target {
        Bson::String(_) => Ok(()),
        _ => Err(QueryError::bad_value(format!("the 'to' field for $rename must be a string: {text}: {target}"))),
    }
}

fn rename(text: &str, value: &Bson) -> Result<Action> {
    check_renamed(text, value)?;
    let target = value.as_str().unwrap_or_default();
    if target.starts_with('$') {
        return Err(QueryError::bad_value("the 'to' field for $rename may not start with '$'"));
    }
    if target.contains('\0') {
        return Err(QueryError::bad_value("the 'to' field for $rename cannot contain an embedded null byte"));
    }
    let target = path(target).map_err(|error| QueryError { code: BAD_VALUE, ..error })?;
    if has_positions(&target) {
        return Err(QueryError::bad_value("the destination field for $rename may not be dynamic"));
    }
    Ok(Action::Rename(target))
}

fn current_date(_: &str, value: &Bson) -> Result<Action> {
    let wrong = || QueryError::bad_value("$currentDate takes a boolean, or {$type: 'timestamp'} or {$type: 'date'}");
    match value {
        Bson::Boolean(_) => Ok(Action::CurrentDate { timestamp: false }),
        Bson::Document(argument) if argument.len() == 1 => match argument.get("$type") {
            Some(Bson::String(name)) if name == "timestamp" => Ok(Action::CurrentDate { timestamp: true }),
            Some(Bson::String(name)) if name == "date" => Ok(Action::CurrentDate { timestamp: false }),
            _ => Err(wrong()),
        },
        _ => Err(wrong()),
    }
}

fn bits(text: &str, value: &Bson) -> Result<Action> {
    let wrong = || QueryError::bad_value(format!("$bit at {text} takes {{and|or|xor: integer}}"));
    let Bson::Document(operations) = value else { return Err(wrong()) };
    if operations.is_empty() {
        return Err(wrong());
    }
    let read = operations.iter().map(|(name, mask)| {
        let operation = match name.as_str() {
            "and" => Bitwise::And,
            "or" => Bitwise::Or,
            "xor" => Bitwise::Xor,
            _ => return Err(wrong()),
        };
        match Number::of(mask) {
            Some(mask @ (Number::Int(_) | Number::Long(_))) => Ok((operation, mask)),
            _ => Err(wrong()),
        }
    });
    Ok(Action::Bits(read.collect::<Result<_>>()?))
}

fn pop(_: &str, value: &Bson) -> Result<Action> {
    match Number::of(value).and_then(Number::integral) {
        Some(-1) => Ok(Action::Pop { first: true }),
        Some(1) => Ok(Action::Pop { first: false }),
        _ => Err(QueryError::failed_to_parse("$pop expects 1 or -1")),
    }
}

#[cfg(test)]
mod tests {
    use crate::query::Update;
    use bson::doc;

    #[test]
    fn each_operator_has_its_codes_for_the_wrong_shape() {
        let table = [
            (doc! { "$push": { "a": { "$each": 1 } } }, 2),
            (doc! { "$push": { "a": { "$each": [], "$sort": { "a": 0 } } } }, 2),
            (doc! { "$addToSet": { "a": { "$each": 1 } } }, 14),
            (doc! { "$rename": { "a": "a" } }, 2),
            (doc! { "$rename": { "a": "$b" } }, 2),
            (doc! { "$set": { "a": 1 }, "$inc": { "a": 1 }, "$none": 1 }, 40),
            (doc! { "$set": { "$a": 1 } }, 0),
        ];
        for (update, expected) in table {
            let code = Update::parse(&update, &[]).map_or_else(|error| error.code, |_| 0);
            assert_eq!(code, expected, "{update}");
        }
    }
}
