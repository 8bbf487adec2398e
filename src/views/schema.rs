//! What fields documents have: types, counts, distinct values, the least, the greatest and the most frequent.

use std::collections::{BTreeMap, HashMap};

use bson::{Bson, Document, doc};

use crate::formats::shell;
use crate::query::{compare_values as compare, type_name};
use crate::saturate::to_i64;

/// So many different values of a field are told apart; beyond them there are only "more".
const DISTINCT: usize = 10_000;
/// So many of the most frequent values are shown.
const FREQUENT: usize = 3;

/// What is known of the fields of documents.
#[derive(Debug, Default)]
pub struct Schema {
    documents: u64,
    fields: Vec<Field>,
    known: HashMap<String, usize>,
}

/// What is known of one field.
#[derive(Debug)]
struct Field {
    path: String,
    documents: u64,
    types: BTreeMap<&'static str, u64>,
    least: Option<Bson>,
    greatest: Option<Bson>,
    /// Values as text, with how often there are.
    values: HashMap<String, (Bson, u64)>,
    /// Whether there are more values than are counted.
    overflows: bool,
}

impl Schema {
    /// Adds a document.
    pub fn add(&mut self, document: &Document) {
        self.documents += 1;
        self.fields_of(document, "");
    }

    fn fields_of(&mut self, document: &Document, prefix: &str) {
        for (key, value) in document {
            let path = format!("{prefix}{key}");
            self.field(&path).add(value);
            if let Bson::Document(inner) = value {
                self.fields_of(inner, &format!("{path}."));
            }
        }
    }

    fn field(&mut self, path: &str) -> &mut Field {
        let index = *self.known.entry(path.to_owned()).or_insert_with(|| {
            self.fields.push(Field::new(path));
            self.fields.len() - 1
        });
        &mut self.fields[index]
    }

    /// How many documents there are.
    #[must_use]
    pub fn documents(&self) -> u64 {
        self.documents
    }

    /// A document for each field, in the order in which they were found: `{field, documents, share, types,
    /// distinct, least, greatest, frequent}`.
    #[must_use]
    pub fn describe(&self) -> Vec<Document> {
        self.fields.iter().map(|field| field.describe(self.documents)).collect()
    }
}

impl Field {
    fn new(path: &str) -> Self {
        Self {
            path: path.to_owned(),
            documents: 0,
            types: BTreeMap::new(),
            least: None,
            greatest: None,
            values: HashMap::new(),
            overflows: false,
        }
    }

    fn add(&mut self, value: &Bson) {
        self.documents += 1;
        *self.types.entry(type_name(value)).or_default() += 1;
        if matches!(value, Bson::Document(_) | Bson::Array(_)) {
            return;
        }
        if self.least.as_ref().is_none_or(|least| compare(value, least).is_lt()) {
            self.least = Some(value.clone());
        }
        if self.greatest.as_ref().is_none_or(|greatest| compare(value, greatest).is_gt()) {
            self.greatest = Some(value.clone());
        }
        let (key, is_full) = (shell::canonical_value(value), self.values.len() >= DISTINCT);
        match self.values.get_mut(&key) {
            Some((_, count)) => *count += 1,
            None if !is_full => drop(self.values.insert(key, (value.clone(), 1))),
            None => self.overflows = true,
        }
    }

    fn describe(&self, total: u64) -> Document {
        let integer = to_i64::<u64>;
        let share = self.documents as f64 / total.max(1) as f64;
        let types: Document =
            self.types.iter().map(|(name, count)| ((*name).to_owned(), integer(*count).into())).collect();
        let mut described =
            doc! { "field": &self.path, "documents": integer(self.documents), "share": share, "types": types };
        if self.values.is_empty() {
            return described;
        }
        let distinct = integer(self.values.len() as u64);
        described
            .insert("distinct", if self.overflows { Bson::from(format!("over {distinct}")) } else { distinct.into() });
        described.extend(self.least.clone().map(|least| ("least".to_owned(), least)));
        described.extend(self.greatest.clone().map(|greatest| ("greatest".to_owned(), greatest)));
        if !self.overflows && self.values.values().any(|(_, count)| *count > 1) {
            described.insert("frequent", self.frequent());
        }
        described
    }

    /// The most frequent values that are there more than once.
    fn frequent(&self) -> Vec<Document> {
        let mut values: Vec<(&String, &(Bson, u64))> =
            self.values.iter().filter(|(_, (_, count))| *count > 1).collect();
        values.sort_by(|a, b| b.1.1.cmp(&a.1.1).then_with(|| a.0.cmp(b.0)));
        let shown = values.into_iter().take(FREQUENT);
        shown.map(|(_, (value, count))| doc! { "value": value, "count": to_i64(*count) }).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_described_with_types_counts_and_extremes() {
        let mut schema = Schema::default();
        for document in [
            doc! { "name": "a", "n": 1, "pose": { "x": 1.5 } },
            doc! { "name": "b", "n": 5_i64, "pose": { "x": -2.0 } },
            doc! { "name": "a", "n": "many", "tags": [1, 2] },
        ] {
            schema.add(&document);
        }
        let described = schema.describe();
        let field = |name: &str| {
            described.iter().find(|field| field.get_str("field").is_ok_and(|known| known == name)).unwrap().clone()
        };
        let name = field("name");
        assert_eq!(name.get("frequent"), Some(&vec![doc! { "value": "a", "count": 2_i64 }].into()));
        assert_eq!((name.get_i64("documents").unwrap(), name.get_i64("distinct").unwrap()), (3, 2));
        assert_eq!(field("n").get_document("types").unwrap(), &doc! { "int": 1_i64, "long": 1_i64, "string": 1_i64 });
        assert_eq!(field("n").get("least"), Some(&Bson::Int32(1)));
        assert_eq!(field("n").get("greatest"), Some(&Bson::from("many")));
        assert_eq!(field("pose.x").get("least"), Some(&Bson::Double(-2.0)));
        assert_eq!(field("tags").get("distinct"), None);
    }
}
