//! `COLL.metadata.json`: what a collection is called and which indexes it has.

use bson::{Bson, Document, doc};

use crate::formats::{Diagnostic, Source, shell};

/// What a dump says about a collection.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Metadata {
    /// Its name, if the dump has it.
    pub collection: Option<String>,
    /// What it is.
    pub kind: CollectionKind,
    /// The definitions of its indexes, but the one on `_id`.
    pub indexes: Vec<Document>,
    /// Its options, such as `collation` and `validator`, as far as it has any.
    pub options: Document,
}

/// What a collection is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CollectionKind {
    /// Documents.
    Collection,
    /// Something that has no documents of its own, like `view`.
    Other(String),
}

impl Metadata {
    /// The metadata of a plain collection.
    #[must_use]
    pub fn plain(collection: &str) -> Self {
        Self {
            collection: Some(collection.to_owned()),
            kind: CollectionKind::Collection,
            indexes: Vec::new(),
            options: Document::new(),
        }
    }

    /// Reads metadata; older ones lack name and type.
    ///
    /// # Errors
    /// Where the text is no JSON document.
    pub fn parse(source: &Source) -> Result<Self, Diagnostic> {
        let document = shell::parse_document(source)?;
        let text = |key: &str| document.get_str(key).ok().map(str::to_owned);
        let options = document.get_document("options").cloned().unwrap_or_default();
        let kind = match text("type").unwrap_or_else(|| "collection".to_owned()) {
            _ if options.contains_key("viewOn") => CollectionKind::Other("view".to_owned()),
            kind if kind == "collection" => CollectionKind::Collection,
            kind => CollectionKind::Other(kind),
        };
        let indexes = document.get_array("indexes").map(Vec::as_slice).unwrap_or_default();
        let definitions = indexes.iter().filter_map(Bson::as_document);
        let indexes = definitions.filter(|index| index.get_str("name").ok() != Some("_id_")).cloned().collect();
        Ok(Self { collection: text("collectionName"), kind, indexes, options })
    }

    /// The text for a collection.
    #[must_use]
    pub fn write(&self) -> String {
        let mut ids = doc! { "v": 2, "key": { "_id": 1 }, "name": "_id_" };
        let mut metadata = Document::new();
        if let Some(collation) = self.options.get("collation") {
            ids.insert("collation", collation.clone());
        }
        if !self.options.is_empty() {
            metadata.insert("options", self.options.clone());
        }
        let indexes: Vec<Document> = std::iter::once(ids).chain(self.indexes.iter().cloned()).collect();
        metadata.extend(doc! {
            "indexes": indexes,
            "collectionName": self.collection.clone().unwrap_or_default(),
            "type": "collection",
        });
        shell::canonical(&metadata)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Metadata {
        Metadata::parse(&Source::new("x.metadata.json", text)).unwrap()
    }

    #[test]
    fn what_is_written_is_read() {
        let indexed =
            Metadata { indexes: vec![doc! { "v": 2, "key": { "n": -1 }, "name": "n" }], ..Metadata::plain("x") };
        assert_eq!(parse(&indexed.write()), indexed);
        let options = doc! { "collation": { "locale": "en", "strength": 2 } };
        let collated = Metadata { options: options.clone(), ..indexed.clone() };
        assert_eq!(parse(&collated.write()), collated);
        let mut all = doc! { "validator": { "n": { "$gt": 0 } }, "validationAction": "warn" };
        all.extend(options);
        let validating = Metadata { options: all, ..collated.clone() };
        assert_eq!(parse(&validating.write()), validating);
        let metadata = Metadata::plain("a.b");
        assert_eq!(parse(&metadata.write()), metadata);
        assert_eq!(
            metadata.write(),
            r#"{"indexes":[{"v":{"$numberInt":"2"},"key":{"_id":{"$numberInt":"1"}},"name":"_id_"}],"collectionName":"a.b","type":"collection"}"#
        );
    }

    #[test]
    fn other_indexes_and_kinds_are_told() {
        let old =
            parse(r#"{"options":{},"indexes":[{"v":2,"key":{"_id":1},"name":"_id_"},{"key":{"n":1},"name":"n_1"}]}"#);
        assert_eq!(
            old,
            Metadata {
                collection: None,
                kind: CollectionKind::Collection,
                indexes: vec![doc! { "key": { "n": 1 }, "name": "n_1" }],
                options: Document::new(),
            }
        );
        assert_eq!(parse(r#"{"options":{"viewOn":"x"},"indexes":[]}"#).kind, CollectionKind::Other("view".to_owned()));
        assert_eq!(parse(r#"{"type":"timeseries"}"#).kind, CollectionKind::Other("timeseries".to_owned()));
    }
}
