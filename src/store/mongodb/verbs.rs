//! The operations of [`Store`], each one call of the driver.

use std::borrow::Cow;
use std::cell::RefCell;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use bson::raw::cstr;
use bson::{Bson, DateTime, Document, RawDocument, RawDocumentBuf, doc};
use mongodb::options::{ChangeStreamPreAndPostImages, UpdateModifications};
use mongodb::results::UpdateResult;

use super::action::{bypassing, hint_of_driver, max_time, modified, of_driver};
use super::history::Made;
use super::update::{is_replacement, replaces};
use super::visible::{behind_expression, for_server, in_stages};
use super::{MongoDb, failure, named, validation, write_command};
use crate::deadline;
use crate::query::{Collation, QueryError, object_id};
use crate::saturate::to_i64;
use crate::store::document::{settle, with_id_first};
use crate::store::metadata;
use crate::store::namespace::{NO_COLLECTION, is_internal};
use crate::store::validation::During;
use crate::store::{
    Aggregation, Changes, Documents, EventRequest, Events, Find, FindAndModify, History, HistoryRule, Index,
    IndexChange, Inserted, Modification, Modified, Modifiers, Name, Namespace, Put, Query, ServerEvents, Store,
    StoreError, UpdateRequest, UpdateSpec, Updated, Validated, Validation, Values, WriteConcern,
};

/// How many removed documents are known by their `_id`s, at most.
const MOST_KNOWN: usize = 10_000;

/// The same where each is named by a long condition, in a request with a collation.
const MOST_CONDITIONS: usize = 500;

/// A limit of time that is less is near.
const NEAR: Duration = Duration::from_secs(10);

impl Store for MongoDb {
    fn insert(&self, ns: &Namespace, documents: Vec<Document>) -> Result<Inserted, StoreError> {
        self.recorded(ns, made_by_insert, || self.insert_all(ns, documents))
    }

    fn put(&self, ns: &Namespace, documents: Vec<Document>, timestamp: Option<DateTime>) -> Result<Put, StoreError> {
        let timestamp = self.time_of_change(ns, timestamp);
        let done = RefCell::new((Put::default(), Vec::new()));
        let made = |put: Result<&Put, &StoreError>| {
            let (done, mut inserted) = done.take();
            let stored = put.err().map_or(&[][..], |error| error.stored());
            inserted.extend_from_slice(stored);
            Made::dated(done.inserted + done.replaced + stored.len() as u64, timestamp, Some(&inserted))
        };
        self.recorded(ns, made, || self.put_all(ns, documents, timestamp, &done))
    }

    fn find(&self, ns: &Namespace, find: &Find) -> Result<Documents<'_>, StoreError> {
        let collection = if find.current { self.on_primary(ns) } else { self.collection(ns) };
        let (filter, seen) = for_server(find)?;
        let mut action = collection.find(filter.into_owned());
        if !find.sort.is_empty() {
            action = action.sort(find.sort.clone());
        }
        if !find.projection.is_empty() {
            action = action.projection(find.projection.clone());
        }
        if find.skip > 0 {
            if i64::try_from(find.skip).is_err() {
                return Err(QueryError::bad_value(format!("skip may be at most {}", i64::MAX)).into());
            }
            action = action.skip(find.skip);
        }
        action = modified!(action, &find.modifiers, collation variables hint time);
        if !find.keys.min.is_empty() {
            action = action.min(find.keys.min.clone());
        }
        if !find.keys.max.is_empty() {
            action = action.max(find.keys.max.clone());
        }
        if find.keys.return_key {
            action = action.return_key(true);
        }
        if find.keys.show_record_id {
            action = action.show_record_id(true);
        }
        if find.limit > 0 {
            action = action.limit(to_i64(find.limit));
        }
        let cursor = action.run().map_err(|e| self.explain(&e))?;
        let found = cursor.map(|document| document.map_err(|e| self.explain(&e)));
        let Some(seen) = seen else { return Ok(Box::new(found)) };
        Ok(Box::new(found.filter_map(move |document| match document {
            Ok(document) => match seen.matches(&document) {
                Ok(is_seen) => is_seen.then_some(Ok(document)),
                Err(error) => Some(Err(error.into())),
            },
            Err(error) => Some(Err(error)),
        })))
    }

    fn explain(&self, ns: &Namespace, find: &Find) -> Result<Document, StoreError> {
        self.explanation(ns, find)
    }

    fn count(&self, ns: &Namespace, query: Query<'_>) -> Result<u64, StoreError> {
        // The driver counts what a stage matches, and these have no place in one.
        if named::has_operator(query.filter, &["$where", "$near", "$nearSphere"]) {
            return self.counted_by_command(ns, query);
        }
        let collection = self.collection(ns);
        let action = collection.count_documents(behind_expression(query.filter).into_owned());
        modified!(action, query.modifiers, collation hint time).run().map_err(|e| self.explain(&e))
    }

    fn values(&self, ns: &Namespace, field: &str, query: Query<'_>) -> Result<Values, StoreError> {
        let collection = self.collection(ns);
        let action = collection.distinct(field, behind_expression(query.filter).into_owned());
        let values = modified!(action, query.modifiers, collation time).run().map_err(|e| self.explain(&e))?;
        Ok(Box::new(values.into_iter().map(Ok)))
    }

    fn aggregate(&self, ns: &Namespace, pipeline: Aggregation<'_>) -> Result<Documents<'_>, StoreError> {
        let (database, collection) = (self.database(ns), self.collection(ns));
        let stages = in_stages(pipeline.stages);
        let action = match ns.collection == NO_COLLECTION {
            true => database.aggregate(stages),
            false => collection.aggregate(stages),
        };
        let action = bypassing!(self, action);
        let action = modified!(action, pipeline.modifiers, collation variables hint time);
        let run = action.with_type::<RawDocumentBuf>().run();
        let cursor = run.map_err(|e| failure::invalid(ns, &e).unwrap_or_else(|| self.explain(&e)))?;
        Ok(Box::new(cursor.map(|document| document.map_err(|e| self.explain(&e)))))
    }

    fn update(
        &self,
        ns: &Namespace,
        update: &UpdateRequest,
        timestamp: Option<DateTime>,
    ) -> Result<Updated, StoreError> {
        let timestamp = self.time_of_change(ns, timestamp);
        let count = |updated: &Updated| updated.modified + u64::from(updated.upserted.is_some());
        let made = |done: Result<&Updated, &StoreError>| {
            let inserted = done.ok().map(|done| done.upserted.as_slice());
            Made::dated(done.map_or_else(changed_before, count), timestamp, inserted)
        };
        self.recorded(ns, made, || self.change(ns, update, timestamp))
    }

    fn find_and_modify(
        &self,
        ns: &Namespace,
        request: &FindAndModify,
        timestamp: Option<DateTime>,
    ) -> Result<Modified, StoreError> {
        let timestamp = self.time_of_change(ns, timestamp);
        let mut asked = Cow::Borrowed(request);
        // Which document was removed is known by its `_id`, also where the client does not ask for that.
        let hides_id = matches!(request.modification, Modification::Remove)
            && request.projection.get("_id").is_some_and(is_left_out)
            && self.records(ns);
        if hides_id {
            asked.to_mut().projection.remove("_id");
        }
        let made = |done: Result<&Modified, &StoreError>| {
            let count = done.map_or(0, |done| u64::from(done.is_changed));
            match request.modification {
                // It is not known which document it was.
                Modification::Remove if asked.projection.contains_key("_id") => Made::unknown(),
                Modification::Remove => {
                    let removed = done.ok().and_then(|done| done.document.as_ref());
                    let id = removed.and_then(|document| named::id_of(document).ok());
                    Made::removals(count, id.as_slice())
                }
                Modification::Update { .. } => {
                    Made::dated(count, timestamp, done.ok().map(|done| done.upserted.as_slice()))
                }
            }
        };
        let mut done = self.recorded(ns, made, || self.modify_first(ns, &asked, timestamp))?;
        if hides_id && let Some(document) = &mut done.document {
            *document = without_id(document)?;
        }
        Ok(done)
    }

    fn delete(&self, ns: &Namespace, query: Query<'_>, first_only: bool) -> Result<u64, StoreError> {
        if !self.records(ns) {
            return self.remove(ns, query, first_only);
        }
        let ids = RefCell::new(Vec::new());
        let made = |count: Result<&u64, &StoreError>| match (count.copied().unwrap_or(0), ids.borrow().as_slice()) {
            // Some were removed by others before.
            (count, known) if !known.is_empty() && count != known.len() as u64 => Made::unknown(),
            (count, known) => Made::removals(count, known),
        };
        self.recorded(ns, made, || self.remove_known(ns, query, first_only, &ids))
    }

    fn drop(&self, ns: &Namespace) -> Result<bool, StoreError> {
        self.recorded(
            ns,
            |there| Made::removals(u64::from(there.is_ok_and(|there| *there)), &[]),
            || self.remove_collection(ns),
        )
    }

    fn rename(&self, from: &Namespace, to: &Namespace, drop_target: bool) -> Result<(), StoreError> {
        let command = doc! {
            "renameCollection": from.to_string(), "to": to.to_string(), "dropTarget": drop_target,
            "writeConcern": { "w": "majority" },
        };
        self.client().database("admin").run_command(command).run().map_err(|e| self.explain(&e))?;
        [from, to].into_iter().for_each(|ns| self.forget(ns));
        Ok(())
    }

    fn create_index(&self, ns: &Namespace, index: &Index) -> Result<bool, StoreError> {
        self.make_index(ns, index)
    }

    fn modify_index(&self, ns: &Namespace, name: &str, change: IndexChange) -> Result<bool, StoreError> {
        self.change_index(ns, name, change)
    }

    fn drop_index(&self, ns: &Namespace, name: &str) -> Result<bool, StoreError> {
        self.discard_index(ns, name)
    }

    fn indexes(&self, ns: &Namespace) -> Result<Vec<Index>, StoreError> {
        self.list_indexes(ns)
    }

    fn view(&self, ns: &Namespace) -> Result<Option<Document>, StoreError> {
        self.options_of(ns, &["view", "timeseries"])
    }

    fn collections(&self) -> Result<Vec<Namespace>, StoreError> {
        let mut all = Vec::new();
        for database in self.client().list_database_names().run().map_err(|e| self.explain(&e))? {
            if is_internal(&database) {
                continue;
            }
            let names =
                self.client().database(&database).list_collection_names().run().map_err(|e| self.explain(&e))?;
            let own = names.into_iter().filter(|name| !name.starts_with("system."));
            all.extend(own.map(|collection| Namespace { database: database.clone(), collection }));
        }
        all.sort();
        Ok(all)
    }

    fn watch(&self, ns: &Namespace, name: Option<&str>) -> Result<Box<dyn Changes + '_>, StoreError> {
        self.follow(ns, name)
    }

    fn note_dropped(&self, database: &str) -> Result<(), StoreError> {
        match self.client().database(database).drop().run() {
            // A user may have the right to drop collections only; then all of them are dropped.
            Err(error) if failure::code(&error) == Some(failure::UNAUTHORIZED) => Ok(()),
            dropped => dropped.map_err(|e| self.explain(&e)),
        }
    }

    fn set_images(&self, ns: &Namespace, are_kept: bool) -> Result<(), StoreError> {
        self.change_images(ns, are_kept)
    }

    fn server_events(
        &self,
        request: EventRequest,
        most: Option<u64>,
    ) -> Result<(Box<dyn ServerEvents>, Events), StoreError> {
        self.open_events(request, most)
    }

    fn forget(&self, ns: &Namespace, name: &str) -> Result<bool, StoreError> {
        self.forget_name(ns, name)
    }

    fn names(&self) -> Result<Vec<Name>, StoreError> {
        self.watch_names()
    }

    fn create(&self, ns: &Namespace, collation: Option<&Collation>) -> Result<bool, StoreError> {
        self.create_validating(ns, collation, &Validation::default(), None)
    }

    fn create_validating(
        &self,
        ns: &Namespace,
        collation: Option<&Collation>,
        validation: &Validation,
        images: Option<bool>,
    ) -> Result<bool, StoreError> {
        let database = self.client().database(&ns.database);
        let mut action = database.create_collection(&ns.collection);
        if let Some(enabled) = images {
            action = action
                .change_stream_pre_and_post_images(ChangeStreamPreAndPostImages::builder().enabled(enabled).build());
        }
        if let Some(collation) = collation.filter(|collation| !collation.is_simple()) {
            action = action.collation(of_driver(collation)?);
        }
        if let Some(validator) = &validation.validator {
            action = action.validator(validator.clone());
        }
        if let Some(level) = validation.level {
            action = action.validation_level(validation::level(level));
        }
        if let Some(what) = validation.action {
            action = action.validation_action(validation::action(what));
        }
        match action.run() {
            Ok(()) => Ok(true),
            Err(error) if failure::code(&error) == Some(48) => Ok(false),
            Err(error) => Err(self.explain(&error)),
        }
    }

    fn validation(&self, ns: &Namespace) -> Result<Option<Validation>, StoreError> {
        self.validation_of(ns)
    }

    fn set_validation(&self, ns: &Namespace, validation: &Validation) -> Result<(), StoreError> {
        self.change_validation(ns, validation)
    }

    fn validate(&self, ns: &Namespace, report: &mut dyn FnMut(&str)) -> Result<Option<Validated>, StoreError> {
        self.validated(ns, report)
    }

    fn unvalidated(&self, work: &mut dyn FnMut() -> Result<(), StoreError>) -> Result<(), StoreError> {
        let _bypassing = During::begin(&self.is_bypassing);
        work()
    }

    fn confirmed(
        &self,
        ns: &Namespace,
        concern: Option<&WriteConcern>,
        work: &mut dyn FnMut() -> bool,
    ) -> Result<Option<Document>, StoreError> {
        self.wait_for_all(ns, concern, work)
    }

    fn keep_history(&self, rules: &[HistoryRule]) {
        self.set_history(rules);
    }

    fn sign(&self, author: &str) {
        self.set_author(author);
    }

    fn history(&self, ns: &Namespace, after: Option<DateTime>) -> Result<Option<History<'_>>, StoreError> {
        self.past(ns, after)
    }

    fn as_of(&self, ns: &Namespace, at: DateTime) -> Result<Vec<RawDocumentBuf>, StoreError> {
        self.rewound(ns, at)
    }

    fn record(&self, ns: &Namespace, stop: &AtomicBool, begun: &mut dyn FnMut()) -> Result<u64, StoreError> {
        self.record_all(ns, stop, begun)
    }

    fn describe(&self) -> String {
        self.address.clone()
    }
}

/// Whether the value of a projection leaves a field out.
fn is_left_out(value: &Bson) -> bool {
    matches!(value, Bson::Int32(0) | Bson::Int64(0) | Bson::Boolean(false)) || value.as_f64() == Some(0.0)
}

fn without_id(document: &RawDocument) -> Result<RawDocumentBuf, QueryError> {
    let mut rest = RawDocumentBuf::new();
    for field in document {
        let (name, value) = field?;
        if name != cstr!("_id") {
            rest.append(name, value);
        }
    }
    Ok(rest)
}

/// Which changes an insert made, also one that ended early.
fn made_by_insert(inserted: Result<&Inserted, &StoreError>) -> Made {
    Made::inserts(inserted.map_or_else(|error| error.stored(), |inserted| &inserted.ids))
}

/// How many documents an update changed before it failed.
fn changed_before(error: &StoreError) -> u64 {
    match error {
        StoreError::Partial { done, .. } | StoreError::Interrupted { done } => *done,
        _ => 0,
    }
}

/// The documents as they are inserted.
fn with_metadata(documents: &[Document], timestamp: Option<DateTime>) -> Result<Vec<Document>, QueryError> {
    let mut documents = documents.to_vec();
    if let Some(at) = timestamp {
        for document in &mut documents {
            metadata::insert(document, at)?;
        }
    }
    Ok(documents)
}

impl MongoDb {
    pub(super) fn insert_all(&self, ns: &Namespace, documents: Vec<Document>) -> Result<Inserted, StoreError> {
        self.insert_with_room(ns, documents, &|| self.remove_decayed(ns))
    }

    /// Inserts documents. Where a key is taken, goes on if `make_room` removed something.
    fn insert_with_room(
        &self,
        ns: &Namespace,
        documents: Vec<Document>,
        make_room: &dyn Fn() -> Result<bool, StoreError>,
    ) -> Result<Inserted, StoreError> {
        self.expect_decay(ns, documents.iter())?;
        let count = documents.len();
        let (mut ids, mut bodies, mut refusal) = (Vec::with_capacity(count), Vec::with_capacity(count), None);
        for document in documents {
            match settle(document) {
                Ok((id, body)) => {
                    ids.push(id);
                    bodies.push(body);
                }
                Err(refused) => {
                    refusal = Some(StoreError::from(refused));
                    break;
                }
            }
        }
        let mut stored = 0;
        while stored < bodies.len() {
            let collection = self.collection(ns);
            let inserted = bypassing!(self, collection.insert_many(&bodies[stored..])).run();
            let Err(error) = inserted.map_err(|e| failure::explain_insert(&self.address, ns, &ids[stored..], &e))
            else {
                break;
            };
            let more = error.stored().len();
            let has_room = matches!(error, StoreError::Duplicate { .. })
                && make_room().map_err(|error| failure::behind(&ids[..stored + more], error))?;
            if !has_room {
                return Err(failure::behind(&ids[..stored], error));
            }
            stored += more;
        }
        match refusal {
            None => Ok(Inserted { ids }),
            Some(refusal) => Err(refusal.stopped(ids, count)),
        }
    }

    fn put_all(
        &self,
        ns: &Namespace,
        documents: Vec<Document>,
        timestamp: Option<DateTime>,
        done: &RefCell<(Put, Vec<Bson>)>,
    ) -> Result<Put, StoreError> {
        let identified = |document: Document| match document.contains_key("_id") {
            true => document,
            false => with_id_first(document, &object_id::new().into()),
        };
        let mut rest: Vec<_> = documents.into_iter().map(identified).collect();
        while !rest.is_empty() {
            let documents = with_metadata(&rest, timestamp)?;
            // A document whose `_id` is taken is replaced, decayed or not.
            let insert = || self.insert_with_room(ns, documents, &|| Ok(false));
            let inserted = match self.recorded(ns, made_by_insert, insert) {
                Ok(inserted) => inserted.ids,
                Err(StoreError::Duplicate { stored, .. }) => stored,
                Err(error) => return Err(error),
            };
            let mut taken = rest.split_off(inserted.len().min(rest.len()));
            {
                let (done, ids) = &mut *done.borrow_mut();
                done.inserted += inserted.len() as u64;
                ids.extend(inserted);
            }
            std::mem::swap(&mut taken, &mut rest);
            if !rest.is_empty() {
                let changed = self.put_over(ns, rest.remove(0), timestamp)?;
                let (done, _) = &mut *done.borrow_mut();
                (done.replaced, done.same) = (done.replaced + changed, done.same + 1 - changed);
            }
        }
        Ok(done.borrow().0)
    }

    fn change(
        &self,
        ns: &Namespace,
        update: &UpdateRequest,
        timestamp: Option<DateTime>,
    ) -> Result<Updated, StoreError> {
        if update.many && replaces(&update.update) {
            let refusal = "a replacement document cannot be applied to many documents";
            return Err(QueryError::failed_to_parse(refusal).into());
        }
        self.with_room(ns, &update.update, || match timestamp {
            Some(at) => self.update_with_metadata(ns, update, at),
            None => self.apply(ns, update.clone()),
        })
    }

    /// Changes documents. Where a key is taken, removes what has decayed and tries again.
    pub(super) fn with_room<T>(
        &self,
        ns: &Namespace,
        update: &UpdateSpec,
        change: impl Fn() -> Result<T, StoreError>,
    ) -> Result<T, StoreError> {
        match update {
            UpdateSpec::Document(document) => self.expect_decay(ns, std::iter::once(document))?,
            UpdateSpec::Pipeline(stages) => self.expect_decay(ns, stages.iter())?,
        }
        match change() {
            Err(StoreError::Duplicate { .. }) if self.remove_decayed(ns)? => change(),
            changed => changed,
        }
    }

    fn remove(&self, ns: &Namespace, query: Query<'_>, first_only: bool) -> Result<u64, StoreError> {
        if !first_only || has_near_limit() {
            return self.removed_by_command(ns, query, first_only);
        }
        let collection = self.collection(ns);
        let action = collection.delete_one(query.filter.clone());
        let deleted = modified!(action, query.modifiers, collation variables hint).run();
        deleted.map(|result| result.deleted_count).map_err(|e| failure::explain_change(&self.address, ns, &e))
    }

    fn counted_by_command(&self, ns: &Namespace, query: Query<'_>) -> Result<u64, StoreError> {
        let mut command = doc! { "count": &ns.collection, "query": behind_expression(query.filter).into_owned() };
        let Modifiers { collation, hint, .. } = query.modifiers;
        command.extend(collation.as_ref().map(|own| ("collation".to_owned(), own.definition().clone().into())));
        command.extend(hint.as_ref().map(|hint| ("hint".to_owned(), hint.to_bson())));
        command.extend(max_time().map(|left| ("maxTimeMS".to_owned(), left.into())));
        let answer = self.database(ns).run_command(command).run().map_err(|e| self.explain(&e))?;
        Ok(write_command::count(&answer, "n"))
    }

    /// Removes matches, and says which they were, if they are few: each has another history.
    fn remove_known(
        &self,
        ns: &Namespace,
        query: Query<'_>,
        first_only: bool,
        known: &RefCell<Vec<Bson>>,
    ) -> Result<u64, StoreError> {
        let most = if query.modifiers.collation.is_some() { MOST_CONDITIONS } else { MOST_KNOWN };
        let limit = if first_only { 1 } else { most + 1 };
        let find = Find {
            filter: query.filter.clone(),
            projection: doc! { "_id": 1 },
            limit: limit as u64,
            modifiers: query.modifiers.clone(),
            current: true,
            ..Find::default()
        };
        self.in_attempts(|_| {
            let mut ids = Vec::new();
            for document in self.find(ns, &find)? {
                ids.push(named::id_of(&document?)?);
            }
            if ids.len() > most {
                return self.remove(ns, query, first_only).map(Some);
            }
            let these = named::among(&ids, query.modifiers.collation.as_ref());
            let filter = doc! { "$and": [query.filter.clone(), these] };
            let removed = self.remove(ns, Query { filter: &filter, ..query }, first_only)?;
            let is_overtaken = first_only && removed == 0 && !ids.is_empty();
            known.replace(ids);
            Ok((!is_overtaken).then_some(removed))
        })
    }

    fn remove_collection(&self, ns: &Namespace) -> Result<bool, StoreError> {
        let database = self.client().database(&ns.database);
        let names = database.list_collection_names();
        let there = names.filter(doc! { "name": &ns.collection }).run().map_err(|e| self.explain(&e))?;
        self.collection(ns).drop().run().map_err(|e| self.explain(&e))?;
        self.forget(ns);
        Ok(!there.is_empty())
    }

    /// Replaces the document that has the `_id` of this one; returns how many changed.
    fn put_over(&self, ns: &Namespace, document: Document, timestamp: Option<DateTime>) -> Result<u64, StoreError> {
        let id = document.get("_id").cloned().unwrap_or(Bson::Null);
        let request = UpdateRequest {
            filter: named::same(&id),
            update: UpdateSpec::Document(with_id_first(document, &id)),
            upsert: true,
            ..UpdateRequest::default()
        };
        // It is a part of what has this time.
        Ok(self.change(ns, &request, timestamp)?.modified.min(1))
    }

    /// Updates in the server's own way.
    pub(super) fn apply(&self, ns: &Namespace, request: UpdateRequest) -> Result<Updated, StoreError> {
        let (done, unconfirmed) = self.applied(ns, request)?;
        unconfirmed.map_or(Ok(done), Err)
    }

    /// The same, also where not as many members confirmed it as were to.
    pub(super) fn applied(
        &self,
        ns: &Namespace,
        request: UpdateRequest,
    ) -> Result<(Updated, Option<StoreError>), StoreError> {
        // The driver sends no update of many again.
        if request.many || has_near_limit() {
            return self.applied_by_command(ns, &request);
        }
        let UpdateRequest { filter, update, array_filters, upsert, modifiers, .. } = request;
        let asked = Asked { filter, upsert, modifiers: &modifiers };
        let changed = match update {
            UpdateSpec::Document(document) if is_replacement(&document) => self.replace(ns, asked, &document)?,
            UpdateSpec::Document(document) => self.modify(ns, asked, document.into(), array_filters)?,
            UpdateSpec::Pipeline(stages) => self.modify(ns, asked, stages.into(), array_filters)?,
        };
        let UpdateResult { matched_count: matched, modified_count: modified, upserted_id: upserted, .. } = changed;
        Ok((Updated { matched, modified, upserted }, None))
    }

    fn modify(
        &self,
        ns: &Namespace,
        asked: Asked<'_>,
        changes: UpdateModifications,
        array_filters: Vec<Document>,
    ) -> Result<UpdateResult, StoreError> {
        let collection = self.collection(ns);
        let action = collection.update_one(asked.filter, changes);
        let mut action = bypassing!(self, modified!(action, asked.modifiers, collation variables hint));
        if !array_filters.is_empty() {
            action = action.array_filters(array_filters);
        }
        action.upsert(asked.upsert).run().map_err(|e| failure::explain_change(&self.address, ns, &e))
    }

    fn replace(&self, ns: &Namespace, asked: Asked<'_>, replacement: &Document) -> Result<UpdateResult, StoreError> {
        let body = RawDocumentBuf::try_from(replacement).map_err(QueryError::from)?;
        let collection = self.collection(ns);
        let action = collection.replace_one(asked.filter, body);
        let action = bypassing!(self, modified!(action, asked.modifiers, collation variables hint));
        action.upsert(asked.upsert).run().map_err(|e| failure::explain_change(&self.address, ns, &e))
    }
}

/// Which documents an update asks for.
struct Asked<'m> {
    filter: Document,
    upsert: bool,
    modifiers: &'m Modifiers,
}

/// Whether the operation has to end so soon that the server is told. The driver has no word for that, and a command of rmem's
/// own is not sent again where a connection is lost: a limit of longer is that of a client that does not want to wait for ever.
fn has_near_limit() -> bool {
    deadline::left().is_some_and(|left| left < NEAR)
}
