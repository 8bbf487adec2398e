//! Regular expressions of Extended JSON v1, `{$regex: "…", "$options": "…"}`, which later became a query operator.

use bson::{Bson, Document};

use super::literal;

/// Returns the document with regular expressions in place of `{$regex, $options}`: for documents that are stored, as
/// `mongoexport` wrote them before version 4.2 and as `mongoimport` reads them.
#[must_use]
pub fn with_regexes(document: Document) -> Document {
    document.into_iter().map(|(key, value)| (key, converted(value, true))).collect()
}

/// Returns the query with regular expressions in place of `{$regex, $options}` in arrays, as in `$in`, where there is
/// no such operator.
#[must_use]
pub fn with_regexes_in_arrays(query: Document) -> Document {
    query.into_iter().map(|(key, value)| (key, converted(value, false))).collect()
}

/// The value; `here` says that it may itself be a regular expression.
fn converted(value: Bson, here: bool) -> Bson {
    match value {
        Bson::Document(document) => match regex(&document).filter(|_| here) {
            Some(regex) => regex,
            None => Bson::Document(document.into_iter().map(|(key, value)| (key, converted(value, here))).collect()),
        },
        Bson::Array(values) => Bson::Array(
            values
                .into_iter()
                .map(|value| match &value {
                    Bson::Document(document) => regex(document).unwrap_or_else(|| converted(value, here)),
                    _ => converted(value, here),
                })
                .collect(),
        ),
        other => other,
    }
}

/// The regular expression that a document was in version 1.
fn regex(document: &Document) -> Option<Bson> {
    let (pattern, options) = (document.get_str("$regex").ok()?, document.get_str("$options").ok()?);
    (document.len() == 2).then(|| literal::any_regex(pattern, options).ok()).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    #[test]
    fn a_stored_regular_expression_is_one_and_an_operator_stays() {
        let old = || doc! { "$regex": "^a", "$options": "i" };
        let new = literal::any_regex("^a", "i").unwrap();
        let document = doc! { "a": old(), "b": { "c": [old()] }, "d": { "$regex": "x" } };
        let stored = doc! { "a": new.clone(), "b": { "c": [new.clone()] }, "d": { "$regex": "x" } };
        assert_eq!(with_regexes(document), stored);
        let query = doc! { "a": old(), "b": { "$in": [old(), 1] }, "$or": [{ "c": old() }] };
        assert_eq!(
            with_regexes_in_arrays(query),
            doc! { "a": old(), "b": { "$in": [new, 1] }, "$or": [{ "c": old() }] }
        );
    }
}
