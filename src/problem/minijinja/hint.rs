//! Hints for mistakes in templates: what there is instead of what is not.

use minijinja::{Error, ErrorKind};

use super::advice::Hint;
use super::method::METHODS;
use super::value::Missing;
use crate::formats::{is_alike, nearest};
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

/// Ways to ask for the time. Templates have no clock, so that the same memory gives the same problem.
const CLOCKS: [&str; 9] = ["now", "today", "time", "date", "datetime", "timestamp", "utcnow", "strftime", "clock"];

/// Ways to ask how many there are, as methods and keys of other languages.
const LENGTHS: [&str; 5] = ["length", "len", "size", "count", "__len__"];

/// A mistake that minijinja found.
pub(super) struct Mistake<'a> {
    pub(super) error: &'a Error,
    /// The text with the mistake.
    pub(super) template: &'a str,
    /// The expression that is wrong.
    pub(super) expression: &'a str,
    /// The same, and what follows it in the template.
    pub(super) code: &'a str,
    /// The key that the document in the expression does not have.
    pub(super) missing: Option<&'a Missing>,
    /// The keys of the document that was looked at last.
    pub(super) keys: &'a [String],
}

/// What to do about a mistake, each a hint of its own.
pub(super) fn hints(mistake: &Mistake<'_>) -> Vec<String> {
    let Mistake { error, template, expression, code, missing, keys } = mistake;
    let detail = error.detail().unwrap_or_default();
    if let Some(Hint(hint)) = std::error::Error::source(error).and_then(|source| source.downcast_ref()) {
        return vec![hint.clone()];
    }
    match error.kind() {
        ErrorKind::UnknownFunction => function(detail.strip_suffix(" is unknown").unwrap_or(detail), template),
        ErrorKind::UnknownFilter => listed("filters", quoted(detail), &FILTERS),
        ErrorKind::UnknownTest => listed("tests", quoted(detail), &TESTS),
        ErrorKind::UnknownMethod if is_clock(detail) => vec![clock()],
        ErrorKind::UnknownMethod => {
            let length =
                called_length(detail).then(|| "how many there are is a filter: write {{ boxes|length }}".to_owned());
            let documents = format!("documents have the methods {}", METHODS.join(", "));
            let others = || vec![documents, "anything else is a filter, like {{ boxes|length }}".to_owned()];
            length.map_or_else(others, |length| vec![length])
        }
        ErrorKind::UndefinedError if missing.is_none() && LENGTHS.iter().any(|word| is_key(expression, word)) => {
            let owner = expression.rsplit_once('.').map_or("boxes", |(owner, _)| owner);
            vec![format!("how many there are is a filter: write {{{{ {owner}|length }}}}")]
        }
        ErrorKind::UndefinedError if *expression == "goal" => {
            vec!["give the goal with --goal, as in --goal '(on A B)'".to_owned()]
        }
        ErrorKind::UndefinedError if CLOCKS.contains(expression) => vec![clock()],
        ErrorKind::UndefinedError if missing.is_none() && expression.starts_with("query(") => {
            vec!["a query gives a list: take its first document with find_one(…), or loop over it".to_owned()]
        }
        ErrorKind::UndefinedError => match missing {
            Some(missing) => key(missing, expression),
            None => unquoted(expression).into_iter().collect(),
        },
        _ if detail.contains("is not a namespace") && is_joined(expression) => {
            vec!["texts side by side are one text; a comma is missing between the arguments".to_owned()]
        }
        ErrorKind::InvalidOperation if detail.contains("use - operator") => {
            // `r.at-r.x`: the key that is not there.
            let operand = detail.rsplit_once("(`").and_then(|(_, rest)| rest.strip_suffix("` is undefined)"));
            let missed = missing.zip(operand.filter(|operand| operand.contains('.')));
            match missed.map(|(missing, operand)| key(missing, operand)) {
                Some(hints) => hints,
                None => subtraction(code, keys).into_iter().collect(),
            }
        }
        _ => Vec::new(),
    }
}

/// The way to write a key that is in brackets without quotes: `r[name]`.
fn unquoted(expression: &str) -> Option<String> {
    let (owner, key) = expression.strip_suffix(']')?.rsplit_once('[')?;
    let is_name = !key.is_empty() && key.chars().all(|c| c.is_alphanumeric() || matches!(c, '_' | '-'));
    (is_name && key.starts_with(char::is_alphabetic))
        .then(|| format!("a key is written in quotes, {owner}[\"{key}\"]; without them, `{key}` is a variable"))
}

/// Whether two texts stand side by side, with blanks between them.
fn is_joined(expression: &str) -> bool {
    let mut quote = None;
    let mut behind = None;
    expression.chars().any(|c| {
        match (quote, c) {
            (Some(open), _) if open == c => (quote, behind) = (None, Some(false)),
            (Some(_), _) => {}
            (None, '"' | '\'') if behind == Some(true) => return true,
            (None, '"' | '\'') => quote = Some(c),
            (None, _) => behind = behind.filter(|_| c.is_whitespace()).map(|_| true),
        }
        false
    })
}

/// Whether an expression is something's key of this name.
fn is_key(expression: &str, key: &str) -> bool {
    expression.strip_suffix(key).is_some_and(|owner| owner.ends_with('.') && !owner.contains(' '))
}

fn clock() -> String {
    "a template has no clock, so that the same memory gives the same problem: give the time with -D now=… and write {{ now }}, \
     or compare dates in a query: {$expr: {$lt: ['$until', '$$NOW']}}"
        .to_owned()
}

/// Whether `… has no method named now (`datetime` is undefined)` asks for the time.
fn is_clock(detail: &str) -> bool {
    let undefined = detail.split('`').nth(1).filter(|_| detail.ends_with("is undefined)"));
    undefined.is_some_and(|name| CLOCKS.contains(&name))
}

/// Whether `… has no method named size` asks how many there are.
fn called_length(detail: &str) -> bool {
    let name = detail.split_once("has no method named ").map(|(_, rest)| rest.split(' ').next().unwrap_or_default());
    name.is_some_and(|name| LENGTHS.contains(&name))
}

/// The way to write a key with a hyphen, where `code` begins like one that was read as a subtraction: `r.at-x`. Where the
/// document has no such key, but the part of it before the hyphen, the way to write text behind that. `keys` are those of
/// the document.
fn subtraction(code: &str, keys: &[String]) -> Option<String> {
    let end = code.find(|c: char| !c.is_alphanumeric() && !matches!(c, '_' | '.' | '-')).unwrap_or(code.len());
    let path = code.get(..end)?.trim_end_matches('-');
    let (owner, key) = path.rsplit_once('.').filter(|(owner, _)| !owner.contains('-'))?;
    let is_hyphened = key.contains('-') && !key.starts_with(|c: char| c.is_numeric()) && !key.contains("--");
    let respelled = key.replace('-', "_");
    let (base, rest) = key.split_at_checked(key.find('-')?)?;
    let has = |key: &str| keys.iter().any(|known| is_alike(known, key));
    if is_hyphened && has(base) && !has(key) {
        return Some(format!("`-` subtracts; a text behind it is written {owner}.{base} ~ \"{rest}\""));
    }
    is_hyphened
        .then(|| format!("a key with a hyphen is written {owner}[\"{key}\"], or {owner}.{respelled}; `-` subtracts"))
}

/// The name in `filter NAME is unknown`.
pub(super) fn quoted(detail: &str) -> &str {
    detail.split_whitespace().nth(1).unwrap_or_default()
}

fn function(name: &str, template: &str) -> Vec<String> {
    let lower = name.to_lowercase();
    if CLOCKS.contains(&lower.as_str()) {
        return vec![clock()];
    }
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
