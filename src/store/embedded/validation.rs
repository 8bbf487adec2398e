//! Which documents collections take: their validators, and what they do with documents that do not pass them.
//!
//! A validator is kept as the options of its collection, in a table that is made with the first of them. It is compiled
//! with the indexes of the collection, once for each generation, and looked at wherever the body of a document is made.

use bson::{Document, RawDocument, RawDocumentBuf};
use rusqlite::{Connection, OptionalExtension as _, params};

use super::catalog::Collection;
use super::indexed::{Defined, of_ids};
use super::validating::Validating;
use super::{Embedded, body as stored, file};
use crate::query::{Collation, QueryError};
use crate::store::{Namespace, StoreError, Validation};

const TABLE: &str =
    "CREATE TABLE IF NOT EXISTS validators (collection INTEGER PRIMARY KEY, options BLOB NOT NULL) STRICT";

impl Embedded {
    /// Refuses a document that does not pass the validator of its collection, or warns of it. `before` is what it takes the
    /// place of.
    pub(super) fn check_valid(
        &self,
        ns: &Namespace,
        definition: &Defined,
        body: &RawDocument,
        before: Option<&RawDocument>,
    ) -> Result<(), StoreError> {
        let Some(validating) = definition.validation.as_ref().filter(|_| !self.is_bypassing.get()) else {
            return Ok(());
        };
        let Some(invalid) = validating.failure(ns, body, before)? else { return Ok(()) };
        if !validating.only_warns() {
            return Err(StoreError::Invalid(Box::new(invalid)));
        }
        if let Some(warn) = &*self.warn.borrow() {
            warn(&format!("{invalid}; it is stored"));
        }
        Ok(())
    }

    /// What a collection says of the documents that it takes.
    pub(super) fn validation_of(&self, ns: &Namespace) -> Result<Option<Validation>, StoreError> {
        let Some(collection) = self.collection(ns)? else { return Ok(None) };
        Ok(self.indexes_of(collection)?.validation.as_ref().map(|validating| validating.options.clone()))
    }

    /// Sets what a collection says of the documents that it takes.
    pub(super) fn change_validation(&self, ns: &Namespace, validation: &Validation) -> Result<(), StoreError> {
        self.write(|| {
            let Some(collection) = self.collection(ns)? else {
                return Err(self.fail(&format!("there is no collection {ns} to get a validator")));
            };
            let indexes = self.indexes_of(collection)?;
            // One that is switched off has to be one, too.
            let switched_on = Validation { level: None, ..validation.clone() };
            Validating::new(switched_on, of_ids(&indexes).and_then(|ids| ids.pattern.collation()))?;
            if validation.is_empty() {
                self.forget_validation(collection)?;
            } else {
                let options = RawDocumentBuf::try_from(&validation.options()).map_err(QueryError::from)?;
                self.connection
                    .execute_batch(TABLE)
                    .and_then(|()| {
                        let sql = "INSERT OR REPLACE INTO validators (collection, options) VALUES (?, ?)";
                        self.connection.execute(sql, params![collection.id, stored::seal(&options)])
                    })
                    .and_then(|_| file::mark_validators(&self.connection))
                    .map_err(|e| self.explain(&e))?;
            }
            self.catalog_cache.advance(&self.connection, collection).map_err(|e| self.explain(&e))
        })
    }

    /// Reads what a collection says of the documents that it takes.
    pub(super) fn load_validation(
        &self,
        collection: Collection,
        collation: Option<&Collation>,
    ) -> Result<Option<Validating>, StoreError> {
        let Some(bytes) = kept(&self.connection, collection.id).map_err(|e| self.explain(&e))? else { return Ok(None) };
        let options = read(&bytes).map_err(|damage| {
            let ns = collection.namespace(&self.connection).ok().flatten().map(|ns| ns.to_string());
            self.fail(&format!(
                "the validator of {} is damaged: {damage}; copy what can be read into a new file with `rmem repair -o FILE`",
                ns.as_deref().unwrap_or("a collection")
            ))
        })?;
        Ok(Some(Validating::new(options, collation)?))
    }

    /// Forgets what a collection says of the documents that it takes. In a write transaction only.
    pub(super) fn forget_validation(&self, collection: Collection) -> Result<(), StoreError> {
        let forget = || -> rusqlite::Result<()> {
            if is_there(&self.connection)? {
                self.connection.execute("DELETE FROM validators WHERE collection = ?", [collection.id])?;
            }
            Ok(())
        };
        forget().map_err(|e| self.explain(&e))
    }
}

fn is_there(connection: &Connection) -> rusqlite::Result<bool> {
    connection.prepare_cached("SELECT 1 FROM sqlite_schema WHERE name = 'validators'")?.exists([])
}

/// What a file has of a collection.
pub(super) fn kept(connection: &Connection, collection: i64) -> rusqlite::Result<Option<Vec<u8>>> {
    if !is_there(connection)? {
        return Ok(None);
    }
    let mut options = connection.prepare_cached("SELECT options FROM validators WHERE collection = ?")?;
    options.query_row([collection], |row| row.get(0)).optional()
}

/// Reads what a file has.
///
/// # Errors
/// Where it is damaged: how, as a clause.
pub(super) fn read(bytes: &[u8]) -> Result<Validation, String> {
    let options = stored::open(bytes).map_err(|damage| damage.describe().to_owned())?;
    let options = Document::try_from(options).map_err(|error| error.to_string())?;
    Validation::read(&options).map_err(|error| error.message)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::{Find, Index, Store, UpdateRequest, UpdateSpec, ValidationAction, ValidationLevel, metadata};
    use bson::{Bson, DateTime, doc};
    use std::sync::{Arc, Mutex};

    fn ns() -> Namespace {
        Namespace::parse("a.b").unwrap()
    }

    fn positive() -> Validation {
        Validation { validator: Some(doc! { "n": { "$gt": 0 } }), ..Validation::default() }
    }

    /// A store with two documents, of which the second does not pass the validator that is set behind it.
    fn filled(validation: Validation) -> Embedded {
        let store = Embedded::in_memory().unwrap();
        store.insert(&ns(), vec![doc! { "_id": 1, "n": 1 }, doc! { "_id": 2, "n": -2 }]).unwrap();
        store.set_validation(&ns(), &validation).unwrap();
        store
    }

    fn update(filter: Document, update: UpdateSpec) -> UpdateRequest {
        UpdateRequest { filter, update, ..UpdateRequest::default() }
    }

    fn set(id: i32, change: Document) -> UpdateRequest {
        update(doc! { "_id": id }, UpdateSpec::Document(doc! { "$set": change }))
    }

    fn id_of<T: std::fmt::Debug>(refused: Result<T, StoreError>) -> Bson {
        let error = refused.unwrap_err();
        let invalid = error.invalid().unwrap_or_else(|| panic!("{error:?}"));
        assert_eq!(invalid.namespace, ns());
        assert_eq!(invalid.details.get_str("operatorName").unwrap(), "$gt");
        invalid.id.clone().unwrap()
    }

    fn documents(store: &Embedded) -> Vec<Document> {
        let found = store.find(&ns(), &Find::default()).unwrap();
        found.map(|found| Document::try_from(&*found.unwrap()).unwrap()).collect()
    }

    #[test]
    fn every_kind_of_write_keeps_the_validator() {
        let store = filled(positive());
        let before = documents(&store);
        assert_eq!(id_of(store.insert(&ns(), vec![doc! { "_id": 3, "n": 0 }])), 3.into());
        assert_eq!(id_of(store.put(&ns(), vec![doc! { "_id": 4 }], None)), 4.into());
        assert_eq!(id_of(store.put(&ns(), vec![doc! { "_id": 1 }], None)), 1.into());
        assert_eq!(id_of(store.update(&ns(), &set(1, doc! { "n": -1 }), None)), 1.into());
        assert_eq!(id_of(store.update(&ns(), &set(2, doc! { "m": 1 }), None)), 2.into());
        let replacement = UpdateSpec::Document(doc! { "m": 1 });
        assert_eq!(id_of(store.update(&ns(), &update(doc! { "_id": 1 }, replacement), None)), 1.into());
        let pipeline = UpdateSpec::Pipeline(vec![doc! { "$set": { "n": { "$subtract": ["$n", 9] } } }]);
        assert_eq!(id_of(store.update(&ns(), &update(doc! { "_id": 1 }, pipeline), None)), 1.into());
        let upsert = UpdateRequest { upsert: true, ..set(5, doc! { "n": 0 }) };
        assert_eq!(id_of(store.update(&ns(), &upsert, None)), 5.into());
        let from = Namespace::parse("a.from").unwrap();
        store.insert(&from, vec![doc! { "_id": 6, "n": 0 }]).unwrap();
        let merge = [doc! { "$merge": { "into": "b" } }];
        assert_eq!(id_of(store.aggregate(&from, (&merge).into()).map(drop)), 6.into());
        let out = [doc! { "$out": "b" }];
        assert_eq!(id_of(store.aggregate(&from, (&out).into()).map(drop)), 6.into());
        assert_eq!(documents(&store), before);
        // What changes nothing is no write, and what passes is done.
        store.update(&ns(), &set(2, doc! { "n": -2 }), None).unwrap();
        store.update(&ns(), &set(2, doc! { "n": 2 }), None).unwrap();
        store.insert(&ns(), vec![doc! { "_id": 7, "n": 7 }]).unwrap();
    }

    #[test]
    fn of_several_documents_those_before_the_first_that_does_not_pass_are_stored() {
        let store = filled(positive());
        let documents = [3, 4, 0, 5].map(|n| doc! { "_id": 10 + n, "n": n }).to_vec();
        let error = store.insert(&ns(), documents).unwrap_err();
        assert_eq!(error.stored(), [Bson::from(13), Bson::from(14)]);
        assert_eq!(id_of(Err::<(), _>(error)), 10.into());
        assert_eq!(store.count(&ns(), (&doc! {}).into()).unwrap(), 4);
    }

    #[test]
    fn a_moderate_one_lets_documents_be_changed_that_did_not_pass_before() {
        let store = filled(Validation { level: Some(ValidationLevel::Moderate), ..positive() });
        store.update(&ns(), &set(2, doc! { "m": 1 }), None).unwrap();
        assert_eq!(id_of(store.update(&ns(), &set(1, doc! { "n": 0 }), None)), 1.into());
        assert_eq!(id_of(store.insert(&ns(), vec![doc! { "_id": 3 }])), 3.into());
    }

    #[test]
    fn one_that_warns_or_is_off_or_is_bypassed_refuses_nothing() {
        let (heard, store) = (Arc::new(Mutex::new(Vec::new())), filled(positive()));
        let sink = Arc::clone(&heard);
        store.warn_by(Arc::new(move |warning| sink.lock().unwrap().push(warning.to_owned())));
        store.unvalidated(&mut || store.insert(&ns(), vec![doc! { "_id": 3 }]).map(drop)).unwrap();
        assert_eq!(id_of(store.insert(&ns(), vec![doc! { "_id": 4 }])), 4.into());
        store.set_validation(&ns(), &Validation { level: Some(ValidationLevel::Off), ..positive() }).unwrap();
        store.insert(&ns(), vec![doc! { "_id": 4 }]).unwrap();
        assert!(heard.lock().unwrap().is_empty());
        store.set_validation(&ns(), &Validation { action: Some(ValidationAction::Warn), ..positive() }).unwrap();
        store.insert(&ns(), vec![doc! { "_id": 5 }, doc! { "_id": 6, "n": 6 }]).unwrap();
        let heard = heard.lock().unwrap();
        assert!(heard.len() == 1 && heard[0].contains("a.b: the document with _id 5"), "{heard:?}");
    }

    #[test]
    fn what_is_no_validator_is_not_set_even_where_it_is_off() {
        let store = filled(positive());
        for level in [None, Some(ValidationLevel::Off)] {
            let wrong = Validation { validator: Some(doc! { "$where": "1" }), level, action: None };
            assert!(matches!(store.set_validation(&ns(), &wrong), Err(StoreError::Query(_))));
        }
        assert_eq!(store.validation(&ns()).unwrap(), Some(positive()));
        store.set_validation(&ns(), &Validation::default()).unwrap();
        assert_eq!(store.validation(&ns()).unwrap(), None);
        store.insert(&ns(), vec![doc! { "_id": 3 }]).unwrap();
    }

    #[test]
    fn metadata_is_not_looked_at() {
        let store = Embedded::in_memory().unwrap();
        let schema = doc! { "additionalProperties": false, "properties": { "_id": {}, "n": { "minimum": 1 } } };
        let validator = Some(doc! { "$jsonSchema": schema });
        store.create_validating(&ns(), None, &Validation { validator, ..Validation::default() }, None).unwrap();
        let at = DateTime::from_millis(5);
        store.insert(&ns(), vec![doc! { "_id": 1, "n": 1, metadata::INFO: { metadata::INSERTED: at } }]).unwrap();
        store.update(&ns(), &set(1, doc! { "n": 2 }), Some(at)).unwrap();
        let error = store.insert(&ns(), vec![doc! { "_id": 2, "m": 1 }]).unwrap_err();
        assert!(error.to_string().contains("additionalProperties"), "{error}");
    }

    #[test]
    fn strings_compare_as_in_the_collection_whatever_the_operation_says() {
        let store = Embedded::in_memory().unwrap();
        let collation = Collation::parse(&doc! { "locale": "en", "strength": 2 }).unwrap();
        let validator = Some(doc! { "name": "ABC" });
        store
            .create_validating(&ns(), Some(&collation), &Validation { validator, ..Validation::default() }, None)
            .unwrap();
        store.insert(&ns(), vec![doc! { "_id": 1, "name": "abc" }]).unwrap();
        assert!(store.insert(&ns(), vec![doc! { "_id": 2, "name": "abx" }]).is_err());
    }

    #[test]
    fn another_process_keeps_it_from_when_it_is_set_until_it_is_taken_off() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.rmem");
        let (store, other) = (Embedded::open(&path).unwrap(), Embedded::open(&path).unwrap());
        let version = || {
            let version = store.connection.query_row("PRAGMA user_version", [], |row| row.get::<_, i32>(0));
            version.unwrap()
        };
        store.insert(&ns(), vec![doc! { "_id": 1 }]).unwrap();
        assert_eq!(version(), 2);
        other.insert(&ns(), vec![doc! { "_id": 2 }]).unwrap();
        store.set_validation(&ns(), &positive()).unwrap();
        assert_eq!(version(), file::VERSION, "no rmem that knows of no validators writes to it");
        assert_eq!(id_of(other.insert(&ns(), vec![doc! { "_id": 3 }])), 3.into());
        let again = Embedded::open(&path).unwrap();
        assert_eq!(again.validation(&ns()).unwrap(), Some(positive()));
        other.set_validation(&ns(), &Validation::default()).unwrap();
        store.insert(&ns(), vec![doc! { "_id": 3 }]).unwrap();
        let failed = store.atomically(&mut || {
            store.set_validation(&ns(), &positive())?;
            Err(store.fail("taken back"))
        });
        assert!(failed.is_err());
        store.insert(&ns(), vec![doc! { "_id": 4 }]).unwrap();
    }

    #[test]
    fn it_goes_with_the_collection_and_stays_where_the_documents_are_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.rmem");
        let store = Embedded::open(&path).unwrap();
        let (from, new) = (Namespace::parse("a.from").unwrap(), Namespace::parse("a.new").unwrap());
        store.insert(&from, vec![doc! { "_id": 6, "n": 6 }]).unwrap();
        store.create_validating(&ns(), None, &positive(), None).unwrap();
        store.create_index(&ns(), &Index::on(doc! { "n": 1 })).unwrap();
        let out = [doc! { "$out": "b" }];
        store.aggregate(&from, (&out).into()).unwrap().for_each(drop);
        assert_eq!(documents(&store), [doc! { "_id": 6, "n": 6 }]);
        assert_eq!(store.validation(&ns()).unwrap(), Some(positive()));
        store.rename(&ns(), &new, true).unwrap();
        assert_eq!((store.validation(&ns()).unwrap(), store.validation(&new).unwrap()), (None, Some(positive())));
        store.rename(&new, &ns(), true).unwrap();
        store.unvalidated(&mut || store.insert(&ns(), vec![doc! { "_id": 7 }]).map(drop)).unwrap();
        let (copy, saved) = (folder.path().join("copy.rmem"), folder.path().join("saved.rmem"));
        store.backup(&copy).unwrap();
        let repaired = Embedded::salvage(&path, &saved).unwrap();
        assert!(repaired.documents == 3 && repaired.lost.is_empty(), "{repaired:?}");
        store.rebuild_indexes().unwrap();
        for file in [&path, &copy, &saved] {
            let copy = Embedded::open(file).unwrap();
            assert_eq!(copy.validation(&ns()).unwrap(), Some(positive()));
            assert_eq!(id_of(copy.insert(&ns(), vec![doc! { "_id": 8 }])), 8.into());
        }
        Store::drop(&store, &ns()).unwrap();
        store.insert(&ns(), vec![doc! { "_id": 8 }]).unwrap();
        assert_eq!(store.validation(&ns()).unwrap(), None);
    }

    #[test]
    fn one_that_is_damaged_is_reported_and_left_out_by_a_repair() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.rmem");
        let store = Embedded::open(&path).unwrap();
        store.create_validating(&ns(), None, &positive(), None).unwrap();
        store.insert(&ns(), vec![doc! { "_id": 1, "n": 1 }]).unwrap();
        store.connection.execute("UPDATE validators SET options = x'05'", []).unwrap();
        let error = Embedded::open(&path).unwrap().insert(&ns(), vec![doc! { "n": 2 }]).unwrap_err().to_string();
        assert!(error.contains("the validator of a.b is damaged"), "{error}");
        let repaired = Embedded::salvage(&path, &folder.path().join("saved.rmem")).unwrap();
        assert!(repaired.documents == 1 && repaired.lost.len() == 1, "{repaired:?}");
        assert!(repaired.lost[0].contains("a.b: its validator"), "{repaired:?}");
    }
}
