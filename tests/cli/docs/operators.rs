//! What `docs/mongodb.md` calls supported is known to the embedded store, and what it calls refused is refused.

use bson::{Bson, Document, doc};
use rmem::query::{Filter, Pipeline, QueryError, Update};

use super::markdown::code_spans;
use super::text;

/// What messages say about names that are not known.
const UNKNOWN: [&str; 4] = ["unknown", "unrecognized", "Unrecognized", "is not supported"];

/// Where an operator can stand: what the store says to it in each of these places.
type Probe = fn(&str) -> Vec<Result<(), QueryError>>;

#[test]
fn operators_that_the_page_on_mongodb_lists_are_known() {
    let page = text("docs/mongodb.md");
    let supported = section(&page, "## Supported", "**Indexes**");
    for (heading, probe) in [
        ("**Filters**", filter as Probe),
        ("**Updates**", update),
        ("**Stages**", stage),
        ("**Accumulators**", accumulator),
        ("**Expressions**", expression),
    ] {
        let names: Vec<&str> = operators(section(supported, heading, "\n**")).collect();
        assert!(names.len() > 10, "{heading}: {names:?}");
        for name in names {
            let answers = probe(name);
            assert!(answers.iter().any(is_known), "{heading} {name}: {answers:?}");
        }
    }
}

#[test]
fn operators_that_the_page_on_mongodb_calls_refused_are_refused() {
    let page = text("docs/mongodb.md");
    let refused = section(&page, "## Refused", "## Differs");
    for (row, probe) in [("| expressions", expression as Probe), ("| stages", stage)] {
        for name in operators(section(refused, row, "\n")) {
            let mut answers = probe(name).into_iter().chain(accumulator(name));
            let is_refused = answers.any(|answer| answer.is_err_and(|error| error.unsupported));
            assert!(is_refused, "{name} is not refused; move it to what is supported");
        }
    }
}

/// Whether the store knows the operator, even if the argument is wrong.
fn is_known(answer: &Result<(), QueryError>) -> bool {
    answer.as_ref().map_or_else(|error| !UNKNOWN.iter().any(|word| error.message.contains(word)), |()| true)
}

/// The part of a text from the start of one to the start of another.
fn section<'a>(text: &'a str, from: &str, to: &str) -> &'a str {
    let start = text.find(from).unwrap_or_else(|| panic!("no {from}"));
    let rest = &text[start + from.len()..];
    &rest[..rest.find(to).unwrap_or(rest.len())]
}

fn operators(text: &str) -> impl Iterator<Item = &str> {
    let is_name = |name: &&str| {
        name.strip_prefix('$').is_some_and(|rest| !rest.is_empty() && rest.chars().all(char::is_alphanumeric))
    };
    code_spans(text).filter(is_name)
}

/// Below a key, as a shape of a place, at the top of a filter.
fn filter(name: &str) -> Vec<Result<(), QueryError>> {
    let filters = [doc! { "a": { name: 1 } }, doc! { "a": { "$geoWithin": { name: [] } } }, doc! { name: 1 }];
    filters.iter().map(|filter| Filter::parse(filter).map(drop)).collect()
}

/// As an operator, and as a modifier of `$push`.
fn update(name: &str) -> Vec<Result<(), QueryError>> {
    let updates = [doc! { name: { "a": 1 } }, doc! { "$push": { "a": { "$each": [], name: 1 } } }];
    updates.iter().map(|update| Update::parse(update, &[]).map(drop)).collect()
}

fn stage(name: &str) -> Vec<Result<(), QueryError>> {
    vec![Pipeline::parse(&[doc! { name: 1 }]).map(drop)]
}

fn accumulator(name: &str) -> Vec<Result<(), QueryError>> {
    vec![Pipeline::parse(&[doc! { "$group": { "_id": Bson::Null, "a": { name: Document::new() } } }]).map(drop)]
}

fn expression(name: &str) -> Vec<Result<(), QueryError>> {
    vec![Pipeline::parse(&[doc! { "$project": { "a": { name: 1 } } }]).map(drop)]
}
