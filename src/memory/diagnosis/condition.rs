//! The conditions of a query, and the keys and values that they are about.

use bson::{Bson, Document, doc};

/// Operators that belong to another one of the same key.
const PARTS: [&str; 3] = ["$options", "$maxDistance", "$minDistance"];

/// Operators that are met by documents without the key.
const NEGATIVE: [&str; 4] = ["$ne", "$nin", "$not", "$exists"];

/// What a condition says of one key.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Test {
    pub(super) path: String,
    /// The values that it compares with.
    pub(super) values: Vec<Bson>,
    /// Whether a document meets it by having one of the values.
    pub(super) is_equality: bool,
}

/// Takes a query apart into conditions that have to hold together, each a query of its own.
pub(super) fn conditions(filter: &Document) -> Vec<Document> {
    let mut found = Vec::new();
    for (key, value) in filter {
        match value {
            Bson::Array(all) if key == "$and" => {
                found.extend(all.iter().filter_map(Bson::as_document).flat_map(conditions));
            }
            Bson::Document(operators) if is_apart(key, operators) => {
                found.extend(operators.iter().map(|(operator, value)| doc! { key: { operator: value.clone() } }));
            }
            value => found.push(doc! { key: value.clone() }),
        }
    }
    found
}

/// Whether each of several operators is a condition of its own.
fn is_apart(key: &str, operators: &Document) -> bool {
    let are_operators = operators.keys().next().is_some_and(|first| first.starts_with('$'));
    let is_joined = operators.keys().any(|operator| PARTS.contains(&operator.as_str()));
    !key.starts_with('$') && are_operators && !is_joined && operators.len() > 1
}

/// Returns what a condition says of keys, also in its alternatives.
pub(super) fn tests(condition: &Document) -> Vec<Test> {
    let mut found = Vec::new();
    for (key, value) in condition {
        match value {
            Bson::Array(branches) if ["$and", "$or", "$nor"].contains(&key.as_str()) => {
                found.extend(branches.iter().filter_map(Bson::as_document).flat_map(tests));
            }
            _ if key.starts_with('$') => {}
            Bson::Document(operators) if operators.keys().next().is_some_and(|first| first.starts_with('$')) => {
                found.extend(operators.iter().flat_map(|(operator, value)| of_operator(key, operator, value)));
            }
            value => found.push(Test { path: key.clone(), values: vec![value.clone()], is_equality: true }),
        }
    }
    found
}

fn of_operator(path: &str, operator: &str, value: &Bson) -> Vec<Test> {
    let test = |values: Vec<Bson>, is_equality| vec![Test { path: path.to_owned(), values, is_equality }];
    match (operator, value) {
        ("$eq", value) => test(vec![value.clone()], true),
        ("$in" | "$all", Bson::Array(values)) => test(values.clone(), true),
        ("$gt" | "$gte" | "$lt" | "$lte", value) => test(vec![value.clone()], false),
        ("$regex", _) => test(vec![Bson::String(String::new())], false),
        ("$mod", _) => test(vec![Bson::Int32(0)], false),
        ("$size", _) => test(vec![Bson::Array(Vec::new())], false),
        ("$elemMatch", Bson::Document(inner)) if inner.keys().all(|key| !key.starts_with('$')) => {
            tests(inner).into_iter().map(|test| Test { path: format!("{path}.{}", test.path), ..test }).collect()
        }
        ("$exists", value) if value != &Bson::Boolean(false) => test(Vec::new(), false),
        (operator, _) if NEGATIVE.contains(&operator) || PARTS.contains(&operator) => Vec::new(),
        _ => test(Vec::new(), false),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_query_is_taken_apart_into_what_has_to_hold_together() {
        let query = doc! { "a": 1, "$and": [{ "b": { "$gt": 2, "$lt": 5 } }, { "$or": [{ "c": 1 }, { "d": 2 }] }],
        "e": { "$regex": "x", "$options": "i" }, "f": { "g": 1 } };
        let wanted = [
            doc! { "a": 1 },
            doc! { "b": { "$gt": 2 } },
            doc! { "b": { "$lt": 5 } },
            doc! { "$or": [{ "c": 1 }, { "d": 2 }] },
            doc! { "e": { "$regex": "x", "$options": "i" } },
            doc! { "f": { "g": 1 } },
        ];
        assert_eq!(conditions(&query), wanted);
    }

    #[test]
    fn conditions_are_about_keys_and_values() {
        let paths = |condition: Document| tests(&condition).into_iter().map(|test| test.path).collect::<Vec<_>>();
        assert_eq!(paths(doc! { "$or": [{ "c": 1 }, { "$and": [{ "d": 2 }] }] }), ["c", "d"]);
        assert_eq!(paths(doc! { "a": { "$elemMatch": { "b": 1 } } }), ["a.b"]);
        assert!(paths(doc! { "a": { "$ne": 1 } }).is_empty(), "documents without the key meet it");
        assert!(paths(doc! { "$expr": { "$eq": ["$a", 1] } }).is_empty());
        let values = tests(&doc! { "a": { "$in": [1, "x"] } }).remove(0).values;
        assert_eq!(values, [Bson::Int32(1), Bson::from("x")]);
    }
}
