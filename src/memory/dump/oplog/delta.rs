//! What an entry of the oplog says of an update since MongoDB 5: the difference of two documents.
//!
//! Of a document: `d` removes keys, `u` gives them other values, `i` adds them at the end, and `sKEY` is the difference
//! of the value of KEY. Of an array, which says `a: true`: `l` is its new length, `uN` the new value at N, and `sN` the
//! difference of the value at N. Source: the server's notes on its delta oplog entries.
//!
//! The document may be a later one than the difference is of, since it was read while it changed. Then a value that is
//! gone, or of another type, stays as it is: a later entry of the oplog explains it.

use bson::{Bson, Document};

/// The most elements that an array can have in a document of 16 MiB.
const LONGEST: usize = 1 << 22;

/// Changes a document by a difference.
///
/// # Errors
/// Where the difference is not one: what is wrong, in a sentence.
pub(super) fn apply(document: &mut Document, difference: &Document) -> Result<(), String> {
    for (name, value) in difference {
        match (name.as_str(), value) {
            ("d", Bson::Document(keys)) => keys.keys().for_each(|key| drop(document.remove(key))),
            ("u", Bson::Document(fields)) => document.extend(fields.clone()),
            ("i", Bson::Document(fields)) => {
                for (key, value) in fields {
                    document.remove(key);
                    document.insert(key, value.clone());
                }
            }
            (name, Bson::Document(inner)) if name.starts_with('s') => {
                let key = name.get(1..).unwrap_or_default();
                document.get_mut(key).map_or(Ok(()), |value| change(value, inner))?;
            }
            (name, _) => return Err(format!("has an unknown `{name}` in the difference of a document")),
        }
    }
    Ok(())
}

/// Changes a value inside a document or an array.
fn change(value: &mut Bson, difference: &Document) -> Result<(), String> {
    match (value, difference.get_bool("a")) {
        (Bson::Array(values), Ok(true)) => apply_to_array(values, difference),
        (Bson::Document(document), Err(_)) => apply(document, difference),
        _ => Ok(()),
    }
}

fn apply_to_array(values: &mut Vec<Bson>, difference: &Document) -> Result<(), String> {
    for (name, value) in difference {
        match (name.as_str(), value) {
            ("a", _) => {}
            ("l", length) => {
                let length = match length {
                    Bson::Int32(length) => usize::try_from(*length).ok(),
                    Bson::Int64(length) => usize::try_from(*length).ok(),
                    _ => None,
                };
                let length = length
                    .filter(|length| *length <= LONGEST)
                    .ok_or("has an `l` that is not the length of an array")?;
                values.resize(length, Bson::Null);
            }
            (name, value) => {
                let unknown = || format!("has an unknown `{name}` in the difference of an array");
                let place = name.get(1..).and_then(|digits| digits.parse::<usize>().ok());
                let place = place.filter(|place| *place < LONGEST).ok_or_else(unknown)?;
                if values.len() <= place {
                    values.resize(place + 1, Bson::Null);
                }
                let Some(there) = values.get_mut(place) else { continue };
                match (name.starts_with('u'), value) {
                    (true, value) => *there = value.clone(),
                    (false, Bson::Document(inner)) if name.starts_with('s') => change(there, inner)?,
                    _ => return Err(unknown()),
                }
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    #[track_caller]
    fn changed(mut document: Document, difference: &Document) -> Document {
        apply(&mut document, difference).unwrap();
        document
    }

    #[test]
    fn keys_are_removed_changed_and_added() {
        let before = doc! { "_id": 1, "a": 1, "b": 2, "c": { "d": 1, "e": 2 } };
        let difference = doc! { "d": { "a": false }, "u": { "b": 3 }, "i": { "f": 4 }, "sc": { "u": { "d": 5 } } };
        assert_eq!(changed(before, &difference), doc! { "_id": 1, "b": 3, "c": { "d": 5, "e": 2 }, "f": 4 });
        let moved = changed(doc! { "a": 1, "b": 2 }, &doc! { "i": { "a": 3 } });
        assert_eq!(moved.keys().collect::<Vec<_>>(), ["b", "a"]);
    }

    #[test]
    fn arrays_are_cut_lengthened_and_changed_inside() {
        let before = || doc! { "a": [1, { "b": 2 }, 3] };
        let inside = |difference: Document| changed(before(), &doc! { "sa": difference });
        assert_eq!(inside(doc! { "a": true, "l": 1 }), doc! { "a": [1] });
        assert_eq!(inside(doc! { "a": true, "u0": 7, "u4": 9 }), doc! { "a": [7, { "b": 2 }, 3, null, 9] });
        assert_eq!(inside(doc! { "a": true, "s1": { "u": { "b": 5 } } }), doc! { "a": [1, { "b": 5 }, 3] });
    }

    #[test]
    fn what_is_gone_or_of_another_type_stays() {
        let later = || doc! { "a": 1, "b": [1] };
        let difference = doc! { "sa": { "u": { "b": 1 } }, "sb": { "u": { "c": 1 } }, "sz": { "a": true, "l": 1 } };
        assert_eq!(changed(later(), &difference), later());
    }

    #[test]
    fn what_is_no_difference_is_refused() {
        for difference in [
            doc! { "x": 1 },
            doc! { "sc": { "x": 1 } },
            doc! { "sb": { "a": true, "l": 1_i64 << 40 } },
            doc! { "sb": { "a": true, "u999999999999": 1 } },
            doc! { "sb": { "a": true, "x0": 1 } },
        ] {
            assert!(apply(&mut doc! { "b": [1], "c": {} }, &difference).is_err(), "{difference}");
        }
    }
}
