//! Computables that add keys to stored documents while a query is answered. What they add is stored nowhere.
//!
//! The documents that the query may match are read, and get the added keys; over them the query is
//! answered ([`extended`](super::extended)). A key that a document has already stays as it is stored. Where the keys
//! are known (`adds = ["distance"]`), the query may ask for them, too: its conditions on them are left out when the
//! documents are chosen.

use std::collections::{BTreeMap, HashMap};
use std::time::Instant;

use bson::{Bson, Document, RawDocument, RawDocumentBuf};

use super::extended::Extended;
use super::report::Computed;
use super::state::{Others, Wanted};
use super::view::View;
use crate::formats::shell;
use crate::memory::Memory;
use crate::memory::journal::Operation;
use crate::query::{QueryError, field, key};
use crate::store::{Find, Modifiers, Namespace, StoreError, document, metadata};

/// What is asked of a collection, and the computables that add keys to its documents.
#[derive(Default)]
struct Part<'a> {
    queries: Vec<&'a Document>,
    wanted: Vec<Wanted<'a>>,
}

impl Memory {
    /// The documents that the questions, asked with these modifiers, may match, with the keys that computables add to them;
    /// nothing where none does.
    pub(in crate::memory) fn extended(
        &self,
        questions: &[(&Namespace, &Document)],
        modifiers: &Modifiers,
        view: &View,
    ) -> Result<Option<Extended<'_>>, StoreError> {
        self.copied(questions, modifiers, view, false)
    }

    /// All documents of a collection, with the keys that computables add to them for a query; nothing where none does.
    pub(in crate::memory) fn extended_whole(
        &self,
        ns: &Namespace,
        query: &Document,
        view: &View,
    ) -> Result<Option<Extended<'_>>, StoreError> {
        self.copied(&[(ns, query)], Modifiers::none(), view, true)
    }

    /// The query that chooses the documents which computables add keys to; none where none does.
    pub(in crate::memory) fn choosing(
        &self,
        ns: &Namespace,
        query: &Document,
        view: &View,
    ) -> Result<Option<Document>, StoreError> {
        let wanted = self.adding(ns, query)?;
        Ok((!wanted.is_empty()).then(|| view.filter(&without(query, &added(&wanted)))))
    }

    fn copied(
        &self,
        questions: &[(&Namespace, &Document)],
        modifiers: &Modifiers,
        view: &View,
        is_whole: bool,
    ) -> Result<Option<Extended<'_>>, StoreError> {
        if !view.adds_keys() {
            return Ok(None);
        }
        let mut parts: BTreeMap<&Namespace, Part<'_>> = BTreeMap::new();
        for (ns, query) in questions {
            let part = parts.entry(ns).or_default();
            part.queries.push(query);
            part.wanted.extend(self.adding(ns, query)?);
        }
        if parts.values().all(|part| part.wanted.is_empty()) {
            return Ok(None);
        }
        let mut collections = Vec::new();
        for (ns, part) in parts {
            collections.push((ns.clone(), self.with_added(ns, &part, modifiers, view, is_whole)?));
        }
        Ok(Some(Extended::new(self, collections)))
    }

    /// Whether computables add keys to the documents of these questions.
    pub(in crate::memory) fn is_extended(&self, questions: &[(&Namespace, &Document)]) -> Result<bool, StoreError> {
        for (ns, query) in questions {
            if !self.adding(ns, query)?.is_empty() {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The documents of a collection that may match, with the keys that are added.
    fn with_added(
        &self,
        ns: &Namespace,
        part: &Part<'_>,
        modifiers: &Modifiers,
        view: &View,
        is_whole: bool,
    ) -> Result<Vec<RawDocumentBuf>, StoreError> {
        let filter = match part.queries.as_slice() {
            [query] if !is_whole => without(query, &added(&part.wanted)),
            _ => Document::new(),
        };
        let find = Find { filter: view.filter(&filter), modifiers: modifiers.without_hint(), ..Find::default() };
        let mut documents = self.read(ns, &find, view)?.collect::<Result<Vec<_>, _>>()?;
        for wanted in &part.wanted {
            let start = Instant::now();
            let others = Others { earlier: &view.computations(), later: &[] };
            let mut keys = HashMap::new();
            for computed in self.compute(wanted, others, Some(&documents))? {
                if let Some(id) = computed.get("_id") {
                    keys.insert(key::encode_value(id), computed);
                }
            }
            let mut count = 0;
            for document in &mut documents {
                let id = field(document, "_id").map(key::encode).unwrap_or_default();
                if let Some(computed) = keys.remove(&id) {
                    count += 1;
                    let named = wanted.computable.definition.adds.as_deref().unwrap_or_default();
                    *document = add(document, computed, named)
                        .map_err(|wrong| StoreError::computable(&wanted.computable.definition.name, wrong))?;
                }
            }
            self.report(wanted, count, start);
        }
        Ok(documents)
    }

    /// Reports how many documents of a collection got keys.
    fn report(&self, wanted: &Wanted<'_>, documents: u64, start: Instant) {
        let definition = &wanted.computable.definition;
        let (name, namespace, took) = (definition.name.clone(), definition.namespace.clone(), start.elapsed());
        self.journal.report(&Operation {
            name: format!("add {name}").into(),
            namespace: Some(namespace.clone()),
            count: Some(documents),
            took,
        });
        self.computables.computed.borrow_mut().push(Computed { name, namespace, cached: false, documents, took });
    }
}

/// A document with the keys that it does not have; where some are `named`, no others.
fn add(document: &RawDocument, computed: Document, named: &[String]) -> Result<RawDocumentBuf, QueryError> {
    let mut keys = Document::new();
    for (key, value) in computed {
        if key == metadata::INFO || field(document, &key).is_some() {
            continue;
        }
        if !named.is_empty() && !named.contains(&key) {
            let id = document.get("_id")?.map(Bson::try_from).transpose()?;
            let id = id.as_ref().map(shell::relaxed_value).unwrap_or_default();
            let message = format!(
                "it gives the key `{key}` to the document with _id {id}, and `adds` names {}; name that one, too, or leave it out",
                named.join(", ")
            );
            return Err(QueryError::bad_value(message));
        }
        keys.insert(key, value);
    }
    document::extend(document, keys)
}

/// The keys that computables name.
fn added<'a>(wanted: &'a [Wanted<'_>]) -> Vec<&'a str> {
    let named = wanted.iter().flat_map(|wanted| wanted.computable.definition.adds.iter().flatten());
    named.map(String::as_str).collect()
}

/// The conditions of a query that do not depend on keys that are added.
fn without(query: &Document, added: &[&str]) -> Document {
    let is_added = |path: &str| added.contains(&path.split('.').next().unwrap_or_default());
    let conditions = query.iter().filter_map(|(key, value)| match (key.as_str(), value) {
        ("$and", Bson::Array(parts)) => {
            let parts: Vec<Document> =
                parts.iter().filter_map(Bson::as_document).map(|part| without(part, added)).collect();
            Some((key.clone(), parts.into())).filter(|_| !parts_are_empty(value))
        }
        // What they say of the added keys is not separated here; fewer conditions only choose more documents.
        ("$or" | "$nor" | "$expr" | "$where", _) if !added.is_empty() => None,
        (path, _) if is_added(path) => None,
        (_, value) => Some((key.clone(), value.clone())),
    });
    conditions.collect()
}

fn parts_are_empty(value: &Bson) -> bool {
    value.as_array().is_some_and(Vec::is_empty)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::{doc, rawdoc};

    #[test]
    fn conditions_on_added_keys_choose_no_documents() {
        let query = doc! {
            "type": "cup", "distance": { "$lt": 1 }, "distance.x": 1, "$or": [{ "distance": 1 }, { "a": 1 }],
            "$and": [{ "b": 1, "distance": 2 }, { "distance": 3 }],
        };
        assert_eq!(without(&query, &["distance"]), doc! { "type": "cup", "$and": [{ "b": 1 }, {}] });
        assert_eq!(without(&query, &[]), query);
    }

    #[test]
    fn a_stored_key_stays() {
        let document = rawdoc! { "_id": 1, "a": 1 };
        let computed = doc! { "_id": 1, "a": 2, "b": 3, "_robmem_info": {} };
        let extended = add(&document, computed.clone(), &["b".to_owned()]).unwrap();
        assert_eq!(extended, rawdoc! { "_id": 1, "a": 1, "b": 3 });
        assert!(add(&document, computed, &["c".to_owned()]).unwrap_err().message.contains("`b`"));
    }
}
