//! What an update does to documents that were read, as rmem computes it.

use bson::{Bson, DateTime, Document, RawDocumentBuf};

use super::MongoDb;
use crate::query::collation::during;
use crate::query::{Collation, Filter, constants};
use crate::store::{Namespace, StoreError, UpdateRequest, UpdateSpec, index, metadata};

/// Documents as they were read, by `_id`.
pub(super) type Before = Vec<(Bson, RawDocumentBuf)>;

/// What an update is predicted to do to a document.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Prediction {
    Changes,
    Stays,
    /// Only the metadata would get another place, which is no change; the server would count it.
    Moves,
    Fails,
}

/// What an update does to each of the documents; nothing where only the server can decide, or refuses the update.
pub(super) fn predict(
    plain: &UpdateSpec,
    request: &UpdateRequest,
    collation: Option<&Collation>,
    before: &Before,
    at: DateTime,
) -> Option<Vec<Prediction>> {
    if is_uncertain(plain, &request.modifiers.variables) {
        return None;
    }
    during(collation, || {
        let constants = constants(&request.modifiers.variables).ok()?;
        let update = plain.compile(&request.array_filters, &constants).ok()?;
        let none = Document::new();
        let filter = if update.is_positional() { &request.filter } else { &none };
        let filter = Filter::parse_with_constants(filter, &constants).ok()?;
        let predicted = |(_, body): &(Bson, RawDocumentBuf)| match update.apply(body, &filter, at) {
            Ok(Some(after)) => match metadata::update(body, &after, false, at) {
                Ok(None) => Prediction::Moves,
                _ => Prediction::Changes,
            },
            Ok(None) => Prediction::Stays,
            Err(_) => Prediction::Fails,
        };
        Some(before.iter().map(predicted).collect())
    })
}

impl MongoDb {
    /// The collation by which an update compares strings. The server is asked for that of the collection only where it does.
    pub(super) fn comparing(&self, ns: &Namespace, request: &UpdateRequest) -> Result<Option<Collation>, StoreError> {
        match &request.modifiers.collation {
            None if compares(request) => self.default_collation(ns),
            own => Ok(own.clone()),
        }
    }

    /// The collation of a collection.
    pub(super) fn default_collation(&self, ns: &Namespace) -> Result<Option<Collation>, StoreError> {
        if let Some(known) = self.collations.get(ns) {
            return Ok(known);
        }
        let indexes = self.list_indexes(ns)?;
        let collation = index::collation(&indexes);
        // One that is not there yet may get another one.
        if !indexes.is_empty() {
            self.collations.learn(ns, collation.clone());
        }
        Ok(collation)
    }
}

/// Whether what an update gives depends on chance or on the server's clock; a field that is set to the time itself differs from
/// what it was.
pub(super) fn is_uncertain(update: &UpdateSpec, variables: &Document) -> bool {
    fn within(value: &Bson) -> bool {
        match value {
            Bson::Document(fields) => {
                fields.iter().any(|(name, value)| matches!(name.as_str(), "$rand" | "$function") || within(value))
            }
            Bson::Array(items) => items.iter().any(within),
            Bson::String(text) => text.starts_with("$$NOW") || text.starts_with("$$CLUSTER_TIME"),
            _ => false,
        }
    }
    let in_stage = |(name, argument): (&String, &Bson)| match (name.as_str(), argument) {
        ("$set" | "$addFields", Bson::Document(fields)) => {
            fields.values().any(|value| value.as_str() != Some("$$NOW") && within(value))
        }
        _ => within(argument),
    };
    let UpdateSpec::Pipeline(stages) = update else { return false };
    stages.iter().flatten().any(in_stage) || variables.values().any(within)
}

/// Whether an update compares values of the document with others.
pub(super) fn compares(request: &UpdateRequest) -> bool {
    let UpdateSpec::Document(update) = &request.update else { return true };
    let is_comparing = |(operator, fields): (&String, &Bson)| {
        let compares = ["$pull", "$pullAll", "$addToSet", "$min", "$max", "$push"].contains(&operator.as_str());
        // Which element `$` is depends on the filter.
        compares || fields.as_document().is_some_and(|fields| fields.keys().any(|path| path.contains(".$")))
    };
    update.iter().any(is_comparing)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    #[test]
    fn only_updates_that_compare_strings_need_the_collation() {
        let compares = |update: Document| {
            compares(&UpdateRequest { update: UpdateSpec::Document(update), ..UpdateRequest::default() })
        };
        assert!(!compares(doc! { "$set": { "a.b": "x" }, "$inc": { "n": 1 } }));
        assert!(!compares(doc! { "a": { "$literal": 1 } }));
        for update in [
            doc! { "$pull": { "l": "A" } },
            doc! { "$set": { "a": 1 }, "$addToSet": { "l": "A" } },
            doc! { "$min": { "a": "B" } },
            doc! { "$set": { "l.$[e].x": 1 } },
            doc! { "$set": { "l.$": 1 } },
        ] {
            assert!(compares(update.clone()), "{update}");
        }
    }

    #[test]
    fn what_depends_on_chance_or_the_clock_is_not_predicted() {
        let none = Document::new();
        let uncertain = |set: Document, variables: &Document| {
            is_uncertain(&UpdateSpec::Pipeline(vec![doc! { "$set": set }]), variables)
        };
        assert!(uncertain(doc! { "x": { "$cond": [{ "$lt": [{ "$rand": {} }, 0.5] }, 1, 2] } }, &none));
        assert!(uncertain(doc! { "x": { "$lt": ["$y", "$$NOW"] } }, &none));
        assert!(uncertain(doc! { "x": "$$v" }, &doc! { "v": { "$rand": {} } }));
        assert!(!uncertain(doc! { "x": { "$cond": [{ "$lt": ["$y", 0.5] }, 1, 2] }, "at": "$$NOW" }, &doc! { "v": 1 }));
    }

    #[test]
    fn the_collation_decides_what_an_update_does() {
        let before = vec![(Bson::Int32(1), bson::rawdoc! { "_id": 1, "l": ["b"] })];
        let ignoring_case = Collation::parse(&doc! { "locale": "en", "strength": 2 }).unwrap();
        let request = UpdateRequest::default();
        let predicted = |update: Document, collation: Option<&Collation>| {
            predict(&UpdateSpec::Document(update), &request, collation, &before, DateTime::now()).unwrap()
        };
        let (pull, add) = (doc! { "$pull": { "l": "B" } }, doc! { "$addToSet": { "l": "B" } });
        assert_eq!(predicted(pull.clone(), None), [Prediction::Stays]);
        assert_eq!(predicted(pull, Some(&ignoring_case)), [Prediction::Changes]);
        assert_eq!(predicted(add.clone(), None), [Prediction::Changes]);
        assert_eq!(predicted(add, Some(&ignoring_case)), [Prediction::Stays]);
    }
}
