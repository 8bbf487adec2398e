//! One test of the values that a path reaches.

use bson::{Bson, Document, doc};

use crate::query::path::Path;
use crate::query::view::{View, type_name};

/// The most values that are shown.
const MOST: usize = 10;

const NUMBERS: [&str; 4] = ["decimal", "double", "int", "long"];
const NUMBERS_AND_BITS: [&str; 5] = ["binData", "decimal", "double", "int", "long"];

/// What an operator is about, in MongoDB's words.
struct Words {
    fails: &'static str,
    holds: &'static str,
    /// The types that it looks at; all where there are none.
    types: &'static [&'static str],
}

/// The words of operators that look at values; none for one that is not known.
fn words(operator: &str) -> Option<Words> {
    let (fails, holds, types): (_, _, &[&str]) = match operator {
        "$eq" | "$gt" | "$gte" | "$lt" | "$lte" => ("comparison failed", "comparison succeeded", &[]),
        "$ne" => ("comparison succeeded", "comparison failed", &[]),
        "$in" => ("no matching value found in array", "matching value found in array", &[]),
        "$nin" => ("matching value found in array", "no matching value found in array", &[]),
        "$type" => ("type did not match", "type did match", &[]),
        "$regex" => {
            ("regular expression did not match", "regular expression did match", &["regex", "string", "symbol"])
        }
        "$mod" => ("$mod did not evaluate to expected remainder", "$mod did evaluate to expected remainder", &NUMBERS),
        "$size" => ("array length was not equal to given size", "array length was equal to given size", &["array"]),
        "$all" => ("array did not contain all specified values", "array did contain all specified values", &[]),
        "$elemMatch" => {
            ("array did not satisfy the child predicate", "array did satisfy the child predicate", &["array"])
        }
        "$bitsAllSet" | "$bitsAllClear" | "$bitsAnySet" | "$bitsAnyClear" => {
            ("bitwise operator failed to match", "bitwise operator matched successfully", &NUMBERS_AND_BITS)
        }
        "$geoWithin" | "$within" => (
            "none of the considered geometries were contained within the expression’s geometry",
            "at least one of considered geometries was contained within the expression’s geometry",
            &[],
        ),
        "$geoIntersects" => (
            "none of the considered geometries intersected the expression’s geometry",
            "at least one of considered geometries intersected the expression’s geometry",
            &[],
        ),
        _ => return None,
    };
    Some(Words { fails, holds, types })
}

/// Returns why a test of a path does not hold for a document or, with `holds`, why it does.
pub(super) fn explain(
    path: &str,
    (operator, operand): (&str, &Bson),
    specified: Document,
    document: &Document,
    holds: bool,
) -> Option<Document> {
    let mut details = doc! { "operatorName": operator, "specifiedAs": specified };
    if operator == "$exists" {
        let is_there = View::from(operand).truthy() == holds;
        details.insert("reason", if is_there { "path does exist" } else { "path does not exist" });
        return Some(details);
    }
    if matches!((operator, operand), ("$all", Bson::Array(items)) if items.is_empty()) {
        details.insert("reason", "expression always evaluates to false");
        return Some(details);
    }
    let words = words(operator)?;
    let considered = considered(path, document, matches!(operator, "$size" | "$elemMatch" | "$all"));
    let types = Types::of(considered.as_deref().unwrap_or_default());
    match &considered {
        None => {
            details.insert("reason", "field was missing");
        }
        Some(_) if !holds && types.have_none_of(words.types) => {
            details.insert("reason", "type did not match");
            types.show("consideredType", &mut details);
            Types(words.types.to_vec()).show("expectedType", &mut details);
        }
        Some(values) if operator.starts_with("$geo") && !values.is_empty() && values.iter().all(is_no_place) => {
            details.insert("reason", "could not find a valid geometry at the given path");
        }
        Some(_) => {
            details.insert("reason", if holds { words.holds } else { words.fails });
        }
    }
    if let Some(values) = considered {
        show(values, &mut details);
        if operator == "$type" {
            types.show("consideredType", &mut details);
        }
    }
    Some(details)
}

fn is_no_place(value: &Bson) -> bool {
    !matches!(value, Bson::Document(_) | Bson::Array(_) | Bson::Double(_) | Bson::Int32(_) | Bson::Int64(_))
}

/// The values that a path reaches, arrays at its end by their elements unless they are meant whole; none where it reaches
/// nothing.
fn considered(path: &str, document: &Document, whole: bool) -> Option<Vec<Bson>> {
    let (mut values, mut is_reached) = (Vec::new(), false);
    Path::parse(path).ok()?.any(document.into(), false, &mut |value, _| {
        match value {
            Some(View::Array(items)) if !whole => values.extend(items.to_vec()),
            Some(value) => values.push(value.to_bson()),
            None => return false,
        }
        is_reached = true;
        false
    });
    is_reached.then_some(values)
}

fn show(mut values: Vec<Bson>, details: &mut Document) {
    if values.len() == 1 {
        details.insert("consideredValue", values.remove(0));
        return;
    }
    let is_cut = values.len() > MOST;
    values.truncate(MOST);
    details.insert("consideredValues", values);
    if is_cut {
        details.insert("consideredValuesTruncated", true);
    }
}

/// Types by name, each once, sorted.
struct Types(Vec<&'static str>);

impl Types {
    fn of(values: &[Bson]) -> Self {
        let mut names: Vec<_> = values.iter().map(type_name).collect();
        names.sort_unstable();
        names.dedup();
        Self(names)
    }

    /// Whether no type is one of those that are expected, where some are.
    fn have_none_of(&self, expected: &[&str]) -> bool {
        !expected.is_empty() && !self.0.iter().any(|name| expected.contains(name))
    }

    /// Shows one type under a name, or several under its plural.
    fn show(&self, name: &str, details: &mut Document) {
        match self.0.as_slice() {
            [] => {}
            [one] => drop(details.insert(name, *one)),
            several => drop(details.insert(format!("{name}s"), several.to_vec())),
        }
    }
}
