//! Hints for mistakes in templates: what there is instead of what is not.

use minijinja::{Error, ErrorKind};

use super::method::METHODS;
use super::value::Missing;
use crate::formats::nearest;
use crate::problem::origin::from_document;

/// The functions of templates.
pub(super) const FUNCTIONS: [&str; 9] =
    ["aggregate", "count", "dict", "distinct", "find_one", "namespace", "param", "query", "range"];

/// The filters of templates.
const FILTERS: [&str; 46] = [
    "abs",
    "attr",
    "batch",
    "bool",
    "capitalize",
    "chain",
    "count",
    "d",
    "default",
    "dictsort",
    "first",
    "float",
    "format",
    "groupby",
    "indent",
    "int",
    "items",
    "join",
    "last",
    "length",
    "lines",
    "list",
    "lower",
    "map",
    "max",
    "min",
    "name",
    "number",
    "pprint",
    "reject",
    "rejectattr",
    "replace",
    "reverse",
    "round",
    "select",
    "selectattr",
    "slice",
    "sort",
    "split",
    "string",
    "sum",
    "title",
    "trim",
    "unique",
    "upper",
    "zip",
];

/// The tests of templates.
const TESTS: [&str; 20] = [
    "boolean",
    "defined",
    "divisibleby",
    "endingwith",
    "even",
    "false",
    "float",
    "in",
    "integer",
    "iterable",
    "lower",
    "mapping",
    "none",
    "number",
    "odd",
    "sequence",
    "startingwith",
    "string",
    "true",
    "undefined",
];

/// Words of Python, mongosh and other dialects of Jinja, and what is written here.
const SYNONYMS: [(&str, &str); 22] = [
    ("find", "query"),
    ("select", "query"),
    ("search", "query"),
    ("findone", "find_one"),
    ("get", "find_one"),
    ("countdocuments", "count"),
    ("len", "length"),
    ("size", "length"),
    ("str", "string"),
    ("tostring", "string"),
    ("lowercase", "lower"),
    ("uppercase", "upper"),
    ("toupper", "upper"),
    ("tolower", "lower"),
    ("strip", "trim"),
    ("sorted", "sort"),
    ("order", "sort"),
    ("exists", "defined"),
    ("null", "none"),
    ("empty", "none"),
    ("dictionary", "mapping"),
    ("startswith", "startingwith"),
];

/// What to do about a mistake, each a hint of its own. `template` is the text with the mistake, `missing` the key that
/// the document in `expression` does not have.
pub(super) fn hints(error: &Error, template: &str, expression: &str, missing: Option<&Missing>) -> Vec<String> {
    let detail = error.detail().unwrap_or_default();
    match error.kind() {
        ErrorKind::UnknownFunction => function(detail.strip_suffix(" is unknown").unwrap_or(detail), template),
        ErrorKind::UnknownFilter => listed("filters", quoted(detail), &FILTERS),
        ErrorKind::UnknownTest => listed("tests", quoted(detail), &TESTS),
        ErrorKind::UnknownMethod => {
            let documents = format!("documents have the methods {}", METHODS.join(", "));
            vec![documents, "anything else is a filter, like {{ boxes|length }}".to_owned()]
        }
        ErrorKind::UndefinedError => missing.map(|missing| key(missing, expression)).unwrap_or_default(),
        _ => Vec::new(),
    }
}

/// The name in `filter NAME is unknown`.
pub(super) fn quoted(detail: &str) -> &str {
    detail.split_whitespace().nth(1).unwrap_or_default()
}

fn function(name: &str, template: &str) -> Vec<String> {
    let lower = name.to_lowercase();
    let synonym = SYNONYMS.iter().find(|(word, _)| *word == lower).map(|(_, known)| *known);
    if let Some(filter) = synonym.filter(|known| !FUNCTIONS.contains(known)).or_else(|| {
        let is_filter = FILTERS.contains(&lower.as_str());
        is_filter.then(|| FILTERS.iter().find(|filter| **filter == lower).copied()).flatten()
    }) {
        return vec![format!("`{filter}` is a filter: write {{{{ value|{filter} }}}}")];
    }
    let macros = template.split("macro").skip(1).filter_map(|rest| {
        let name = rest.trim_start().split(|c: char| !c.is_alphanumeric() && c != '_').next()?;
        (!name.is_empty()).then_some(name)
    });
    let mut known: Vec<&str> = FUNCTIONS.into_iter().chain(macros).collect();
    known.sort_unstable();
    known.dedup();
    hint("functions", &lower, synonym, &known)
}

fn listed(what: &str, name: &str, known: &[&str]) -> Vec<String> {
    let lower = name.to_lowercase();
    let synonym = SYNONYMS.iter().find(|(word, _)| *word == lower).map(|(_, known)| *known);
    hint(what, &lower, synonym.filter(|name| known.contains(name)), known)
}

fn hint(what: &str, name: &str, synonym: Option<&str>, known: &[&str]) -> Vec<String> {
    let meant = synonym.or_else(|| nearest(name, known.iter().copied()));
    let meant = meant.map(|name| format!("did you mean `{name}`?"));
    meant.into_iter().chain([format!("there are the {what} {}", known.join(", "))]).collect()
}

/// What to do about a key that not every document has.
fn key(missing: &Missing, expression: &str) -> Vec<String> {
    let Missing { key, keys, document } = missing;
    let base = owner(expression, key);
    let mut hints = Vec::new();
    hints.extend(document.as_deref().map(|(namespace, id)| from_document(namespace, id)));
    hints.push(match nearest(key, keys.iter().map(String::as_str)) {
        Some(nearest) => format!("did you mean `{nearest}`?"),
        None => format!("it has the keys {}", keys.join(", ")),
    });
    let is_name = key.chars().all(|c| c.is_alphanumeric() || c == '_') && !key.starts_with(|c: char| c.is_numeric());
    let path = if is_name { format!("{base}.{key}") } else { format!("{base}[\"{key}\"]") };
    hints.push(format!("where a document may lack it: {{% if {path} is defined %}}, or {base}.get(\"{key}\")"));
    hints
}

/// What stands before a key in an expression: `r.pose` before `.x`.
fn owner<'a>(expression: &'a str, key: &str) -> &'a str {
    let marks = [format!(".{key}"), format!("[\"{key}\""), format!("['{key}'")];
    let end = marks.iter().filter_map(|mark| expression.find(mark)).min();
    let before = end.and_then(|end| expression.get(..end)).unwrap_or_default();
    let is_part = |c: char| c.is_alphanumeric() || matches!(c, '_' | '.');
    let start =
        before.rfind(|c| !is_part(c)).map_or(0, |at| at + before[at..].chars().next().map_or(1, char::len_utf8));
    before.get(start..).filter(|owner| !owner.is_empty()).unwrap_or("d")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_listed_is_there() {
        let environment = minijinja::Environment::new();
        let is = |kind: &str, name: &str| {
            let expression = format!("'{name}' is {kind}");
            environment.compile_expression(&expression).unwrap().eval(()).unwrap().is_true()
        };
        let own = ["name", "number"];
        assert!(FILTERS.iter().all(|name| own.contains(name) || is("filter", name)));
        assert!(TESTS.iter().all(|name| is("test", name)), "{TESTS:?}");
        let known = |name: &&str| FUNCTIONS.contains(name) || FILTERS.contains(name) || TESTS.contains(name);
        assert!(SYNONYMS.iter().all(|(word, name)| known(name) && !FUNCTIONS.contains(word)));
    }
}
