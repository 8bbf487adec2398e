//! What is written to a collection of computables is checked, so that one wrong document does not concern others.

use bson::{Bson, Document};

use super::kept::read;
use super::record::COLLECTION;
use super::registry::Registry;
use crate::formats::shell;
use crate::memory::Memory;
use crate::query::collation::during;
use crate::query::{Filter, QueryError, constants};
use crate::store::{Find, FindAndModify, Namespace, StoreError, UpdateRequest};

impl Memory {
    /// Refuses documents that are no computables where only these are kept.
    pub(crate) fn check_kept(&self, ns: &Namespace, documents: &[Document]) -> Result<(), StoreError> {
        if ns.collection != COLLECTION {
            return Ok(());
        }
        documents.iter().try_for_each(|document| check(ns, document))
    }

    /// Refuses an update that would make of a computable what is none.
    pub(crate) fn check_kept_update(&self, ns: &Namespace, request: &UpdateRequest) -> Result<(), StoreError> {
        if ns.collection != COLLECTION {
            return Ok(());
        }
        let collation = match &request.modifiers.collation {
            Some(own) => Some(own.clone()),
            None => self.collation(ns)?,
        };
        during(collation.as_ref(), || self.check_update_of_kept(ns, request))
    }

    fn check_update_of_kept(&self, ns: &Namespace, request: &UpdateRequest) -> Result<(), StoreError> {
        let now = self.clock.now();
        let constants = constants(&request.modifiers.variables)?;
        let update = request.update.compile(&request.array_filters, &constants)?;
        let filter = Filter::parse_with_constants(&request.filter, &constants)?;
        let modifiers = request.modifiers.without_hint();
        let find = Find { filter: request.filter.clone(), modifiers, ..Find::default() };
        let mut is_matched = false;
        for raw in self.routes.reading(ns)?.find(ns, &find)? {
            let raw = raw?;
            is_matched = true;
            let changed = update.apply(&raw, &filter, now)?.unwrap_or(raw);
            check(ns, &Document::try_from(&*changed).map_err(QueryError::from)?)?;
        }
        if request.upsert && !is_matched {
            check(ns, &Document::try_from(&*update.upsert(&request.filter, now)?).map_err(QueryError::from)?)?;
        }
        Ok(())
    }

    /// The same of the document that is found and changed, by what is asked of all that match.
    pub(crate) fn check_kept_modification(&self, ns: &Namespace, request: &FindAndModify) -> Result<(), StoreError> {
        request.update_of(request.filter.clone()).map_or(Ok(()), |update| self.check_kept_update(ns, &update))
    }

    /// Refuses a collection in the place of one of computables, where it has others.
    pub(in crate::memory) fn check_kept_rename(&self, from: &Namespace, to: &Namespace) -> Result<(), StoreError> {
        if to.collection != COLLECTION {
            return Ok(());
        }
        for raw in self.routes.reading(from)?.find(from, &Find::default())? {
            check(to, &Document::try_from(&*raw?).map_err(QueryError::from)?)?;
        }
        Ok(())
    }
}

fn check(place: &Namespace, document: &Document) -> Result<(), StoreError> {
    let wrong = match document.get("_id") {
        None => Err("it has no _id; expected its name there".to_owned()),
        Some(_) => read(document, place).and_then(|definitions| Registry::default().check(definitions)),
    };
    wrong.map_err(|wrong| {
        let id = document.get("_id").or(document.get("name")).map_or_else(|| "new".to_owned(), name);
        let message = format!(
            "{place} keeps computables, and the document `{id}` is none: {wrong}; `rmem computables add` keeps one"
        );
        QueryError::bad_value(message).into()
    })
}

fn name(id: &Bson) -> String {
    id.as_str().map_or_else(|| shell::relaxed_value(id), str::to_owned)
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use bson::doc;

    use super::*;
    use crate::memory::computables::{Origin, read as read_record};
    use crate::store::StoreUri;

    fn good(name: &str, collection: &str) -> Document {
        doc! { "_id": name, "collection": collection, "spec": "{a: 1}", "pipeline": "[]" }
    }

    #[test]
    fn what_got_in_otherwise_stops_the_queries_that_it_concerns_and_no_others() {
        let folder = tempfile::tempdir().unwrap();
        let uri = StoreUri::parse(&format!("file:{}", folder.path().join("robot.rmem").display())).unwrap();
        let said: Arc<Mutex<Vec<String>>> = Arc::default();
        let sink = Arc::clone(&said);
        let memory = Memory::at(uri.clone(), uri, Vec::new())
            .with_warnings(Arc::new(move |warning| sink.lock().unwrap().push(warning.to_owned())));
        let place = Namespace::parse("a.rmem.computables").unwrap();
        let wrong = doc! { "_id": "wrong", "collection": ["a.bad", "a.worse"], "spec": 7 };
        let error = memory.insert(&place, vec![good("early", "a.early"), wrong.clone()]).unwrap_err();
        assert_eq!(error.stored(), ["early".into()]);
        let reason = std::error::Error::source(&error).map(ToString::to_string).unwrap_or_default();
        assert!(reason.contains("the document `wrong` is none: `spec`: expected a query"), "{reason}");
        // As a client of MongoDB writes it.
        let all = vec![wrong, doc! { "x": 1 }, good("fine", "a.good")];
        memory.routes.of(&place).unwrap().insert(&place, all).unwrap();
        let query = doc! { "a": 1 };
        let count = |collection: &str| memory.count(&Namespace::parse(collection).unwrap(), &query);
        assert_eq!((count("a.good").unwrap(), count("a.other").unwrap(), count("b.bad").unwrap()), (0, 0, 0));
        assert_eq!(said.lock().unwrap().len(), 2, "each once: {said:?}");
        let error = count("a.worse").unwrap_err().to_string();
        assert!(error.contains("a document with _id \"wrong\" that is not a computable: `spec`"), "{error}");
        let (computables, wrong) = memory.computables().unwrap();
        let names: Vec<&str> = computables.iter().map(|computable| computable.definition.name.as_str()).collect();
        assert_eq!((names, wrong.len()), (vec!["early", "fine"], 2));
        assert!(memory.forget_computable("wrong").unwrap().is_some());
        assert_eq!(count("a.worse").unwrap(), 0);
    }

    #[test]
    fn of_two_that_add_one_name_at_once_one_does_and_remove_takes_one() {
        let folder = tempfile::tempdir().unwrap();
        let uri = StoreUri::parse(&format!("file:{}", folder.path().join("robot.rmem").display())).unwrap();
        let memory = Memory::at(uri.clone(), uri, Vec::new());
        let definitions = |collection: &str| read_record(&good("one", collection), &Origin::program()).unwrap();
        memory.keep_computables(&[definitions("a.x")]).unwrap();
        let error = memory.keep_computables(&[definitions("a.y")]).unwrap_err();
        assert!(error.to_string().contains("a.rmem.computables keeps a computable `one` already"), "{error}");
        // Another database has another collection of computables.
        let other = Namespace::parse("b.rmem.computables").unwrap();
        memory.insert(&other, vec![good("one", "b.x")]).unwrap();
        assert_eq!(memory.computables().unwrap().1.len(), 1);
        let (place, others) = memory.forget_computable("one").unwrap().unwrap();
        assert_eq!((place.to_string().as_str(), others), ("a.rmem.computables", vec![other.clone()]));
        assert_eq!(memory.forget_computable("one").unwrap(), Some((other, Vec::new())));
        assert_eq!(memory.forget_computable("one").unwrap(), None);
    }
}
