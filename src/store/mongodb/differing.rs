//! The condition under which an update changes a document, as the server can tell it.

use bson::{Bson, Document, doc};

use super::single_step::{always_changes, is_literal};

/// The condition under which an update changes a document: an empty one where it changes whatever it meets, nothing where the
/// server cannot tell. One that holds is true; of what the server takes for equal (1 and 1.0) it does not hold.
pub(super) fn differing(update: &Document) -> Option<Document> {
    if update.iter().any(|(operator, fields)| always_changes(operator, fields)) {
        return Some(Document::new());
    }
    let mut differences = Vec::new();
    for (operator, fields) in update.iter().filter(|(operator, _)| *operator != "$setOnInsert") {
        for (path, value) in fields.as_document()? {
            differences.push(doc! { path: difference(operator, path, value)? });
        }
    }
    (!differences.is_empty()).then(|| doc! { "$or": differences })
}

fn difference(operator: &str, path: &str, value: &Bson) -> Option<Document> {
    if path.contains('$') {
        return None;
    }
    match operator {
        "$set" | "$addToSet" if is_value(value) => Some(doc! { "$ne": value }),
        "$pullAll" if value.as_array().is_some_and(|items| items.iter().all(is_value)) => Some(doc! { "$in": value }),
        "$unset" => Some(doc! { "$exists": true }),
        _ => None,
    }
}

/// Whether a condition takes a value for what it is, and not for operators.
fn is_value(value: &Bson) -> bool {
    is_literal(value) && !value.as_document().is_some_and(|fields| fields.keys().any(|key| key.starts_with('$')))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_server_is_asked_what_it_can_tell() {
        for (update, condition) in [
            (doc! { "$inc": { "n": 1 }, "$set": { "l.$.x": 1 } }, doc! {}),
            (doc! { "$set": { "a.b": 1 } }, doc! { "$or": [{ "a.b": { "$ne": 1 } }] }),
            (
                doc! { "$unset": { "a": 1 }, "$addToSet": { "l": "x" }, "$setOnInsert": { "z": 1 } },
                doc! { "$or": [{ "a": { "$exists": true } }, { "l": { "$ne": "x" } }] },
            ),
            (doc! { "$pullAll": { "l": [1, 2] } }, doc! { "$or": [{ "l": { "$in": [1, 2] } }] }),
        ] {
            assert_eq!(differing(&update), Some(condition), "{update}");
        }
        for update in [
            doc! { "$set": { "l.$.x": 1 } },
            doc! { "$set": { "a": 1, "t": bson::Timestamp { time: 0, increment: 0 } } },
            doc! { "$addToSet": { "l": { "$each": [1] } } },
            doc! { "$mul": { "n": 2 } },
            doc! { "$pullAll": { "l": [2, { "$ref": "c", "$id": 1 }] } },
            doc! { "$setOnInsert": { "n": 2 } },
        ] {
            assert_eq!(differing(&update), None, "{update}");
        }
    }
}
