//! Trying a computable by itself: a query that its spec matches, and what its program answers.

use std::time::Duration;

use bson::{Bson, Document, doc};

use super::definition::{BodyKind, Definition};
use super::spec::Spec;
use crate::formats::shell;
use crate::process::Host;
use crate::query::Filter;

impl Definition {
    /// Returns a query that the spec matches, with made-up values where the spec leaves them open; none where none is
    /// found.
    #[must_use]
    pub fn example(&self) -> Option<Document> {
        let query = example(&self.spec)?;
        self.answers(&query).then_some(query)
    }

    /// Returns whether the spec matches a query.
    #[must_use]
    pub fn answers(&self, query: &Document) -> bool {
        Spec::parse(&self.spec).and_then(|spec| spec.matches(query)).unwrap_or_default()
    }

    /// Asks the program of the body, for at most a time; returns the documents that it gives. Nothing is stored. None for
    /// other bodies.
    ///
    /// # Errors
    /// What is wrong with the program or with what it prints, in a sentence.
    pub fn ask_program(
        &self,
        query: &Document,
        most: Duration,
        host: &Host<'static>,
    ) -> Option<Result<Vec<Document>, String>> {
        let BodyKind::Command { words, folder, timeout } = &self.body else { return None };
        let (words, folder) = (words.clone(), folder.clone());
        let program = super::command::Command { words, folder, timeout: most.min(*timeout), host: host.clone() };
        Some(program.answer(query, &[]).map_err(|error| error.to_string()).and_then(|documents| {
            let count = documents.len();
            if count > 0 && self.adds.is_none() && !documents.iter().any(|document| is_found(query, document)) {
                return Err(format!(
                    "of the {count} that it prints, the query finds none: {}",
                    shell::relaxed(&documents[0])
                ));
            }
            Ok(documents)
        }))
    }
}

/// Whether a query finds a document; also where it cannot be told here.
fn is_found(query: &Document, document: &Document) -> bool {
    Filter::parse(query).and_then(|filter| filter.matches_document(document)).unwrap_or(true)
}

/// A document that a query matches, as far as its operators say which.
fn example(spec: &Document) -> Option<Document> {
    let mut found = Document::new();
    fill(spec, &mut found)?;
    Some(found)
}

/// Adds to a document what a query wants.
fn fill(spec: &Document, found: &mut Document) -> Option<()> {
    for (key, value) in spec {
        match (key.as_str(), value) {
            ("$and", Bson::Array(parts)) => {
                parts.iter().try_for_each(|part| fill(part.as_document()?, found))?;
            }
            ("$or", Bson::Array(parts)) => fill(parts.first()?.as_document()?, found)?,
            ("$comment", _) => {}
            (operator, _) if operator.starts_with('$') => return None,
            (path, value) => {
                if let Some(value) = valued(value)? {
                    put(found, path, value)?;
                }
            }
        }
    }
    Some(())
}

/// A value that meets a condition; none inside where the key has to be absent, none at all where no value is known.
fn valued(condition: &Bson) -> Option<Option<Bson>> {
    let Bson::Document(operators) = condition else {
        return match condition {
            Bson::RegularExpression(pattern) => text_like(pattern.pattern.as_str()).map(Some),
            value => Some(Some(value.clone())),
        };
    };
    if !operators.keys().next().is_some_and(|key| key.starts_with('$')) {
        return Some(Some(condition.clone()));
    }
    let mut found = Some(Bson::Int32(1));
    for (operator, operand) in operators {
        found = Some(match (operator.as_str(), operand) {
            ("$exists", Bson::Boolean(false)) => return Some(None),
            ("$exists" | "$ne" | "$nin", _) => continue,
            ("$eq" | "$gte" | "$lte", value) => value.clone(),
            ("$in", Bson::Array(values)) => values.first()?.clone(),
            ("$gt", value) => Bson::Double(number(value)? + 1.0),
            ("$lt", value) => Bson::Double(number(value)? - 1.0),
            ("$regex", Bson::String(pattern)) => text_like(pattern)?,
            ("$type", Bson::String(name)) => of_type(name)?,
            _ => return None,
        });
    }
    Some(found)
}

/// The number that a value is.
fn number(value: &Bson) -> Option<f64> {
    match value {
        Bson::Int32(number) => Some(f64::from(*number)),
        Bson::Int64(number) => Some(*number as f64),
        Bson::Double(number) => Some(*number),
        _ => None,
    }
}

/// A text that a pattern matches, where the pattern is a text itself.
fn text_like(pattern: &str) -> Option<Bson> {
    let text = pattern.trim_start_matches('^').trim_end_matches('$');
    let is_plain = text.chars().all(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    is_plain.then(|| Bson::String(text.to_owned()))
}

fn of_type(name: &str) -> Option<Bson> {
    Some(match name {
        "string" => "x".into(),
        "number" | "int" => 1.into(),
        "long" => 1_i64.into(),
        "double" => 1.5.into(),
        "bool" => true.into(),
        "array" => Bson::Array(vec![1.into()]),
        "object" => doc! {}.into(),
        _ => return None,
    })
}

/// Puts a value at a dotted path.
fn put(document: &mut Document, path: &str, value: Bson) -> Option<()> {
    let Some((key, rest)) = path.split_once('.') else {
        document.insert(path, value);
        return Some(());
    };
    if !document.contains_key(key) {
        document.insert(key, Document::new());
    }
    put(document.get_document_mut(key).ok()?, rest, value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_example_is_matched_by_its_spec() {
        for spec in [
            doc! { "compute": "sum", "x": { "$exists": true }, "y": { "$exists": true } },
            doc! { "x": { "$gt": 3 }, "gone": { "$exists": false } },
            doc! { "x.$gt": { "$gte": 3 } },
            doc! { "$or": [{ "a": { "$in": ["b", "c"] } }, { "d": 1 }] },
            doc! { "$and": [{ "a.b": 1 }, { "a.c": { "$type": "string" } }] },
            doc! { "name": { "$regex": "^cup" }, "n": { "$lt": 0, "$exists": true } },
            doc! {},
        ] {
            let query = example(&spec).unwrap();
            assert!(Spec::parse(&spec).unwrap().matches(&query).unwrap(), "{spec}: {query}");
        }
    }

    #[test]
    fn where_no_example_is_known_there_is_none() {
        for spec in [
            doc! { "$expr": { "$gt": ["$x", "$y"] } },
            doc! { "name": { "$regex": "^(a|b)+" } },
            doc! { "at": { "$gt": Bson::DateTime(bson::DateTime::MIN) } },
            doc! { "x": { "$mod": [4, 1] } },
        ] {
            assert_eq!(example(&spec), None, "{spec}");
        }
    }
}
