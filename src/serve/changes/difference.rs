//! `updateDescription`: what is different in a document, as MongoDB describes it.

use bson::{Bson, Document, doc};

/// Describes how `before` became `after`: `{updatedFields, removedFields, truncatedArrays}`.
pub(super) fn describe(before: &Document, after: &Document) -> Document {
    let mut difference = Difference::default();
    difference.fields("", before, after);
    let Difference { updated, removed, truncated } = difference;
    doc! { "updatedFields": updated, "removedFields": removed, "truncatedArrays": truncated }
}

#[derive(Default)]
struct Difference {
    updated: Document,
    removed: Vec<String>,
    truncated: Vec<Document>,
}

impl Difference {
    fn fields(&mut self, path: &str, before: &Document, after: &Document) {
        for name in before.keys().filter(|name| !after.contains_key(*name)) {
            self.removed.push(joined(path, name));
        }
        for (name, new) in after {
            let path = joined(path, name);
            match before.get(name) {
                Some(old) => self.value(&path, old, new),
                None => drop(self.updated.insert(path, new.clone())),
            }
        }
    }

    fn value(&mut self, path: &str, old: &Bson, new: &Bson) {
        match (old, new) {
            _ if old == new => {}
            (Bson::Document(old), Bson::Document(new)) if !new.is_empty() => self.fields(path, old, new),
            (Bson::Array(old), Bson::Array(new)) if !new.is_empty() => self.elements(path, old, new),
            _ => drop(self.updated.insert(path, new.clone())),
        }
    }

    fn elements(&mut self, path: &str, old: &[Bson], new: &[Bson]) {
        for (index, new) in new.iter().enumerate() {
            let path = joined(path, &index.to_string());
            match old.get(index) {
                Some(old) => self.value(&path, old, new),
                None => drop(self.updated.insert(path, new.clone())),
            }
        }
        if new.len() < old.len() {
            let size = i32::try_from(new.len()).unwrap_or(i32::MAX);
            self.truncated.push(doc! { "field": path, "newSize": size });
        }
    }
}

fn joined(path: &str, name: &str) -> String {
    if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_different_is_told_by_its_path() {
        let before = doc! { "_id": 1, "a": 1, "b": { "c": 1, "d": 2 }, "e": [1, 2, 3], "gone": 1 };
        let after = doc! { "_id": 1, "a": 2, "b": { "c": 1, "d": 3, "new": 1 }, "e": [1, 5] };
        assert_eq!(
            describe(&before, &after),
            doc! {
                "updatedFields": { "a": 2, "b.d": 3, "b.new": 1, "e.1": 5 },
                "removedFields": ["gone"],
                "truncatedArrays": [{ "field": "e", "newSize": 2 }],
            }
        );
    }

    #[test]
    fn a_value_of_another_kind_is_told_as_a_whole() {
        let described = describe(&doc! { "a": { "b": 1 }, "c": [1] }, &doc! { "a": [1], "c": [] });
        assert_eq!(described.get_document("updatedFields").unwrap(), &doc! { "a": [1], "c": [] });
    }
}
