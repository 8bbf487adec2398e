//! Parses projections.

use bson::{Bson, Document};

use super::find::{FindOperator, Transform};
use super::tree::{Branch, Mode, Policy, Treatment, check_path};
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Expression, Scope, UNKNOWN_EXPRESSION};
use crate::query::number::Number;

/// MongoDB's code for such an expression that is the value of a field, and not within one.
const UNKNOWN_VALUE: i32 = 31_325;
/// How deep projections may be nested.
const MAX_DEPTH: usize = 100;

/// An entry of a projection, with its path written out.
enum Entry<'a> {
    Include,
    Exclude,
    Value(&'a Bson),
    Transform(FindOperator),
}

/// Reads a projection.
pub(super) fn projection(spec: &Document, policy: Policy, scope: &Scope) -> Result<(Branch, Vec<Transform>)> {
    if spec.is_empty() && policy == Policy::Stage {
        return Err(QueryError::invalid(51_272, "a projection must have at least one field"));
    }
    let mut entries = Vec::new();
    flatten("", spec, policy, &mut entries, 0)?;
    check_id(&entries)?;
    let mode = mode_of(&entries, policy)?;
    let mut root = Branch::new(mode);
    let mut transforms = Vec::new();
    let mut id = None;
    // Exclusions do not hold what is sliced, but may not collide with it.
    let mut named = Branch::new(mode);
    for (path, entry) in entries {
        if mode == Mode::Exclude && path != "_id" {
            named.insert(&path, Treatment::Named)?;
        }
        match entry {
            Entry::Include | Entry::Exclude if path == "_id" => {
                if id.is_some() {
                    return Err(QueryError::invalid(31_250, "path collision at _id"));
                }
                id = Some(matches!(entry, Entry::Include));
            }
            Entry::Include | Entry::Exclude => {
                let include = matches!(entry, Entry::Include);
                if include != (mode == Mode::Include) {
                    let message = if include {
                        format!("cannot do inclusion on field {path} in exclusion projection")
                    } else {
                        format!("cannot do exclusion on field {path} in inclusion projection")
                    };
                    return Err(QueryError::invalid(if include { 31_253 } else { 31_254 }, message));
                }
                root.insert(&path, Treatment::Named)?;
            }
            Entry::Value(value) => {
                if mode == Mode::Exclude && !is_meta(value) {
                    let message = format!("cannot use an expression for {path} in an exclusion projection");
                    return Err(QueryError::invalid(31_252, message));
                }
                id = if path == "_id" { Some(false) } else { id };
                let expression = Expression::parse_in(value, scope).map_err(|error| unknown(value, error))?;
                root.insert(&path, Treatment::Computed(expression))?;
            }
            Entry::Transform(operator) => {
                check_path(&path)?;
                if mode == Mode::Include {
                    root.insert(&path, Treatment::Named)?;
                }
                transforms.push(Transform { path, operator, in_place: mode == Mode::Exclude });
            }
        }
    }
    let names_id = root.child(b"_id").is_some();
    match (mode, id) {
        (Mode::Include, None | Some(true)) if !names_id => root.insert("_id", Treatment::Named)?,
        (Mode::Exclude, Some(false)) => root.insert("_id", Treatment::Named)?,
        _ => {}
    }
    if transforms.iter().filter(|transform| matches!(transform.operator, FindOperator::Positional)).count() > 1 {
        return Err(QueryError::invalid(31_276, "cannot specify more than one positional projection per query"));
    }
    Ok((root, transforms))
}

/// An operator that is not known has another code where it is the value itself, and not within one.
fn unknown(value: &Bson, mut error: QueryError) -> QueryError {
    let name = value.as_document().and_then(|value| value.keys().next());
    if error.code == UNKNOWN_EXPRESSION && error.names.first() == name {
        error.code = UNKNOWN_VALUE;
    }
    error
}

/// Refuses `_id` beside a field in it.
fn check_id(entries: &[(String, Entry<'_>)]) -> Result<()> {
    let whole = entries.iter().position(|(path, _)| path == "_id");
    let inner = entries.iter().position(|(path, _)| path.starts_with("_id."));
    match (whole, inner) {
        (Some(whole), Some(inner)) => {
            // MongoDB's code says which of them is the first.
            let code = if whole < inner { 31_249 } else { 31_250 };
            Err(QueryError::invalid(code, "path collision at _id"))
        }
        _ => Ok(()),
    }
}

/// Returns the first field other than `_id` decides.
fn mode_of(entries: &[(String, Entry<'_>)], policy: Policy) -> Result<Mode> {
    let (mut mode, mut id, mut matching) = (None, None, false);
    for (path, entry) in entries {
        match entry {
            Entry::Include if path == "_id" => id = Some(Mode::Include),
            Entry::Exclude if path == "_id" => id = Some(Mode::Exclude),
            // In a stage, it is a value like others where nothing else decides.
            Entry::Value(value) if is_meta(value) => matching |= policy == Policy::Stage,
            Entry::Include | Entry::Value(_) => mode = mode.or(Some(Mode::Include)),
            Entry::Exclude => mode = mode.or(Some(Mode::Exclude)),
            Entry::Transform(FindOperator::Slice { .. }) => {}
            Entry::Transform(FindOperator::ElementMatch(_)) => matching = true,
            Entry::Transform(FindOperator::Positional) => {
                if mode == Some(Mode::Exclude) {
                    return Err(QueryError::invalid(31_395, "positional projection cannot be used with exclusion"));
                }
                mode = Some(Mode::Include);
            }
        }
    }
    Ok(mode.or(matching.then_some(Mode::Include)).or(id).unwrap_or(Mode::Exclude))
}

/// Returns whether a field is given something beside the document, which decides nothing about the other fields.
fn is_meta(value: &Bson) -> bool {
    matches!(value, Bson::Document(inner) if inner.keys().next().is_some_and(|name| name == "$meta"))
}

/// Writes out nested documents as dotted paths.
fn flatten<'a>(
    prefix: &str,
    spec: &'a Document,
    policy: Policy,
    entries: &mut Vec<(String, Entry<'a>)>,
    depth: usize,
) -> Result<()> {
    if depth > MAX_DEPTH {
        return Err(QueryError::bad_value("the projection is nested too deeply"));
    }
    for (name, value) in spec {
        let path = if prefix.is_empty() { name.clone() } else { format!("{prefix}.{name}") };
        if policy == Policy::Find && path.ends_with(".$") {
            if matches!(value, Bson::Boolean(false)) || Number::of(value).is_some_and(Number::is_zero) {
                return Err(
                    QueryError::invalid(31_395, "positional projection cannot be used with exclusion").about(name)
                );
            }
            if matches!(value, Bson::Document(_)) {
                let message = "positional projection cannot be used with an expression or sub object";
                return Err(QueryError::invalid(31_271, message));
            }
            if !matches!(value, Bson::Boolean(true)) && Number::of(value).is_none() {
                return Err(QueryError::invalid(31_308, "positional projection cannot be used with a literal"));
            }
            let path = path.trim_end_matches(".$").to_owned();
            entries.push((path, Entry::Transform(FindOperator::Positional)));
            continue;
        }
        if name.is_empty() {
            return Err(QueryError::invalid(40_352, "a field path may not have an empty part"));
        }
        check_path(&path).map_err(|error| error.about(name))?;
        match value {
            Bson::Document(inner) => nested(path, value, inner, policy, entries, depth)?,
            Bson::Boolean(true) => entries.push((path, Entry::Include)),
            Bson::Boolean(false) => entries.push((path, Entry::Exclude)),
            value => match Number::of(value) {
                Some(number) if number.is_zero() => entries.push((path, Entry::Exclude)),
                Some(_) => entries.push((path, Entry::Include)),
                None => entries.push((path, Entry::Value(value))),
            },
        }
    }
    Ok(())
}

fn nested<'a>(
    path: String,
    value: &'a Bson,
    inner: &'a Document,
    policy: Policy,
    entries: &mut Vec<(String, Entry<'a>)>,
    depth: usize,
) -> Result<()> {
    let Some(first) = inner.keys().next() else {
        return Err(QueryError::invalid(51_270, "an empty sub-projection is not a valid value"));
    };
    if !first.starts_with('$') {
        return flatten(&path, inner, policy, entries, depth + 1);
    }
    if inner.len() > 1 {
        return Err(QueryError::invalid(16_410, "an expression must have exactly one field"));
    }
    let entry = match (first.as_str(), policy) {
        ("$slice", Policy::Find) => match FindOperator::slice(inner.get("$slice").unwrap_or(&Bson::Null))? {
            Some(operator) => Entry::Transform(operator),
            None => Entry::Value(value),
        },
        ("$elemMatch", Policy::Find) => {
            if path.contains('.') {
                return Err(QueryError::invalid(31_275, "cannot use $elemMatch projection on a nested field")
                    .about("$elemMatch"));
            }
            Entry::Transform(FindOperator::element_match(inner.get("$elemMatch").unwrap_or(&Bson::Null))?)
        }
        _ => Entry::Value(value),
    };
    entries.push((path, entry));
    Ok(())
}

/// Reads what `$addFields` takes: everything is an expression, nested documents are paths.
pub(super) fn additions(spec: &Document, scope: &Scope) -> Result<Branch> {
    let mut root = Branch::new(Mode::Add);
    add("", spec, scope, &mut root, 0)?;
    Ok(root)
}

fn add(prefix: &str, spec: &Document, scope: &Scope, root: &mut Branch, depth: usize) -> Result<()> {
    if depth > MAX_DEPTH {
        return Err(QueryError::bad_value("the specification is nested too deeply"));
    }
    for (name, value) in spec {
        let path = if prefix.is_empty() { name.clone() } else { format!("{prefix}.{name}") };
        check_path(&path)?;
        if !prefix.is_empty() && name.contains('.') {
            return Err(QueryError::invalid(40_183, format!("cannot use dotted field name '{name}' in a sub object")));
        }
        match value {
            Bson::Document(inner) if inner.keys().next().is_some_and(|name| !name.starts_with('$')) => {
                add(&path, inner, scope, root, depth + 1)?;
            }
            Bson::Document(inner) if inner.is_empty() => {
                return Err(QueryError::invalid(40_180, format!("an empty object is not a valid value for {path}")));
            }
            Bson::Document(inner) if inner.len() > 1 => {
                let message = format!("the expression at {path} must have exactly one field");
                return Err(QueryError::invalid(40_181, message));
            }
            value => {
                let expression = Treatment::Computed(Expression::parse_in(value, scope)?);
                root.insert(&path, expression).map_err(|error| match error.code {
                    31_249 | 31_250 => QueryError { code: 40_176, ..error },
                    _ => error,
                })?;
            }
        }
    }
    Ok(())
}

/// Reads the paths that `$unset` removes.
pub(super) fn removals(paths: &[Bson]) -> Result<Branch> {
    let mut root = Branch::new(Mode::Exclude);
    for path in paths {
        let Bson::String(path) = path else {
            return Err(QueryError::invalid(31_120, "$unset needs a string or an array of strings"));
        };
        root.insert(path, Treatment::Named)?;
    }
    Ok(root)
}
