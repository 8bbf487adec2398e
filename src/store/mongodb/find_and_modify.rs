//! Finding a document and changing it in one step, by the server's own command.
//!
//! As with updates, the metadata is written only where the document changes. Where one request cannot carry it
//! (`single_step`), the document is read first, and changed if it is still as it was read.

use bson::raw::RawBsonRef;
use bson::{Bson, DateTime, Document, RawDocumentBuf, doc};
use mongodb::options::{ReturnDocument, UpdateModifications};

use super::action::{bypassing, hint_of_driver, modified, of_driver};
use super::attempts::{any_of, choices};
use super::dates::path;
use super::named::{exactly, id_of, none_of, same};
use super::prediction::{Prediction, predict};
use super::single_step::{self, Meaning, Single};
use super::unchanged::{as_read, with_the_same_metadata};
use super::update::{as_it_was, is_replacement, may_be_done_by_others, with_updated, without_metadata};
use super::{MongoDb, failure};
use crate::query::collation::during;
use crate::query::text::asks_for_score;
use crate::query::{Collation, Filter, Projection, QueryError, constants, is_positional};
use crate::store::metadata::{self, INFO, UPDATED};
use crate::store::{
    Find, FindAndModify, Modification, Modified, Modifiers, Namespace, Store as _, StoreError, UpdateRequest,
    UpdateSpec,
};

/// So often a change that another client may have made as well is tried; then it is made as soon as the document matches, and
/// has the date of the change even where nothing changes.
const PATIENT: u32 = 16;

/// What came of one attempt.
enum Attempt {
    Done(Modified),
    /// Nothing matches.
    Unmatched,
    /// Another client changed the document meanwhile.
    Overtaken,
}

/// What the server is to do to the first match of a filter, and what to return.
struct Change<'a> {
    filter: Document,
    sort: &'a Document,
    update: UpdateSpec,
    array_filters: &'a [Document],
    modifiers: &'a Modifiers,
    new: bool,
    projection: &'a Document,
}

impl MongoDb {
    pub(super) fn modify_first(
        &self,
        ns: &Namespace,
        request: &FindAndModify,
        at: Option<DateTime>,
    ) -> Result<Modified, StoreError> {
        let Modification::Update { update, .. } = &request.modification else { return self.remove_first(ns, request) };
        self.with_room(ns, update, || self.change_first(ns, request, at))
    }

    fn remove_first(&self, ns: &Namespace, request: &FindAndModify) -> Result<Modified, StoreError> {
        let collection = self.collection(ns);
        let action = collection.find_one_and_delete(request.filter.clone()).sort(request.sort.clone());
        let action = modified!(action, &request.modifiers, collation variables hint time);
        let removed = action.projection(request.projection.clone()).run();
        let document = removed.map_err(|e| failure::explain_change(&self.address, ns, &e))?;
        let is_found = document.is_some();
        Ok(Modified { document, is_found, is_changed: is_found, upserted: None })
    }

    fn change_first(
        &self,
        ns: &Namespace,
        request: &FindAndModify,
        at: Option<DateTime>,
    ) -> Result<Modified, StoreError> {
        let Some(update) = request.update_of(request.filter.clone()) else { return Ok(Modified::default()) };
        match self.change_in_attempts(ns, request, &update, at) {
            Err(StoreError::Query(mistake)) if at.is_some() => {
                // Of several mistakes, that of the update is the first.
                let (filter, projection) = (Document::new(), Document::new());
                match self.check(ns, &FindAndModify { filter, projection, ..request.clone() }, &update) {
                    Err(first @ StoreError::Query(_)) => Err(first),
                    // The document may be changed: no other error says so.
                    _ => Err(mistake.into()),
                }
            }
            done => done,
        }
    }

    /// Changes the first match, also where others change it meanwhile.
    fn change_in_attempts(
        &self,
        ns: &Namespace,
        request: &FindAndModify,
        update: &UpdateRequest,
        at: Option<DateTime>,
    ) -> Result<Modified, StoreError> {
        if at.is_some() {
            metadata::check_update(&update.update)?;
            request.check()?;
        }
        self.in_attempts(|attempt| {
            let done = match at {
                Some(at) => self.change_with_metadata(ns, request, update, at, attempt)?,
                None => self.as_it_is(ns, request, update)?,
            };
            match done {
                Attempt::Done(modified) => Ok(Some(modified)),
                Attempt::Overtaken => Ok(None),
                Attempt::Unmatched if update.upsert => self.insert_unmatched(ns, request, update, at),
                Attempt::Unmatched => Ok(Some(Modified::default())),
            }
        })
    }

    /// The change without metadata.
    fn as_it_is(&self, ns: &Namespace, request: &FindAndModify, update: &UpdateRequest) -> Result<Attempt, StoreError> {
        let found = self.change_one(ns, Change::asked(request, update, update.update.clone()))?;
        Ok(found.map_or(Attempt::Unmatched, Attempt::changed))
    }

    fn change_with_metadata(
        &self,
        ns: &Namespace,
        request: &FindAndModify,
        update: &UpdateRequest,
        at: DateTime,
        attempt: u32,
    ) -> Result<Attempt, StoreError> {
        // The second one would not say whether anything changed.
        if let Some(Single { request: single, meaning }) = single_step::with_metadata(update, at)?.next() {
            // What is shown may fail when the document is changed already, which is no mistake of a pipeline, and may be an
            // element that the filter matched.
            let is_plain = || !is_positional(&request.projection) && request.projection.values().all(is_choice);
            let fits = match meaning {
                Meaning::Whole => true,
                Meaning::IfDifferent => is_plain(),
                Meaning::IfTaken => is_plain() && self.notes_what_pipelines_change()?,
            };
            if fits {
                let change = Change { filter: single.filter, ..Change::asked(request, update, single.update) };
                match (self.change_one(ns, change), meaning) {
                    // What the request has may also not go with a pipeline.
                    (Err(StoreError::Query(_)), Meaning::IfTaken) => {}
                    (Ok(None), Meaning::IfDifferent) => {}
                    (changed, _) => return Ok(changed?.map_or(Attempt::Unmatched, Attempt::changed)),
                }
            }
        }
        // Without an order, any match will do.
        let limit = if request.sort.is_empty() { choices(&request.filter, attempt) } else { 1 };
        let find = Find { limit, ..request.find(Document::new()) };
        let matches = self.find(ns, &find)?.collect::<Result<_, _>>()?;
        let Some(before) = any_of(matches) else {
            self.check(ns, request, update)?;
            return Ok(Attempt::Unmatched);
        };
        self.change_what_is_read(ns, request, update, (before, attempt), at)
    }

    /// Has the server check the request, by a change of nothing.
    fn check(&self, ns: &Namespace, request: &FindAndModify, update: &UpdateRequest) -> Result<(), StoreError> {
        let filter = none_of(&request.filter);
        self.change_one(ns, Change { filter, ..Change::asked(request, update, update.update.clone()) }).map(drop)
    }

    /// Changes the document that was read, with the date of the change where it is predicted that it changes.
    fn change_what_is_read(
        &self,
        ns: &Namespace,
        request: &FindAndModify,
        update: &UpdateRequest,
        (before, attempt): (RawDocumentBuf, u32),
        at: DateTime,
    ) -> Result<Attempt, StoreError> {
        let id = id_of(&before)?;
        let this = this(request, &id);
        let read = vec![(id, before)];
        let plain = without_metadata(&update.update, &read, at)?;
        let collation = self.comparing(ns, update)?;
        let prediction = predict(&plain, update, collation.as_ref(), &read, at).and_then(|all| all.first().copied());
        let [(_, before)] = read.as_slice() else { return Ok(Attempt::Overtaken) };
        match prediction {
            Some(Prediction::Changes) => {
                let change = with_updated(&plain, at)?;
                let mut conditions = vec![this, as_it_was(&update.update, &read)?];
                if attempt < PATIENT && may_be_done_by_others(&plain) {
                    conditions.push(the_same(request, update, before)?);
                }
                let filter = doc! { "$and": conditions };
                let changed = self.change_one(ns, Change { filter, ..Change::asked(request, update, change) })?;
                Ok(changed.map_or(Attempt::Overtaken, Attempt::changed))
            }
            Some(Prediction::Moves) => {
                self.check(ns, request, update)?;
                let shown = self.show(ns, request, (update, this), before, at)?;
                Ok(shown.map_or(Attempt::Overtaken, |document| Attempt::done(document, false)))
            }
            _ => self.change_and_date(ns, request, update, (plain, before), at),
        }
    }

    /// Changes a document if it is as it was read, and then writes the date where it is another one.
    fn change_and_date(
        &self,
        ns: &Namespace,
        request: &FindAndModify,
        update: &UpdateRequest,
        (plain, before): (UpdateSpec, &RawDocumentBuf),
        at: DateTime,
    ) -> Result<Attempt, StoreError> {
        let id = id_of(before)?;
        let filter = doc! { "$and": [this(request, &id), the_same(request, update, before)?] };
        let change = Change { filter, ..Change::asked(request, update, plain) };
        // The document may be changed, too, where it cannot be shown.
        let shown = match self.change_one(ns, change) {
            Ok(None) => return Ok(Attempt::Overtaken),
            Ok(Some(document)) => Ok(document),
            Err(mistake @ StoreError::Query(_)) => Err(mistake),
            Err(error) => return Err(error),
        };
        let find = Find { filter: same(&id), limit: 1, current: true, ..Find::default() };
        let after = self.find(ns, &find).and_then(|mut found| found.next().transpose());
        let after = after.map_err(|error| failure::behind_change(ns, shown.is_ok(), error))?;
        let is_changed = after.is_some_and(|after| after != *before);
        if !is_changed {
            return Ok(Attempt::done(shown?, false));
        }
        let date = UpdateSpec::Document(doc! { "$set": { path(UPDATED): at } });
        let is_dated = self.apply(ns, UpdateRequest { filter: same(&id), update: date, ..UpdateRequest::default() });
        is_dated.map_err(|error| failure::behind_change(ns, true, error))?;
        let document = shown?;
        Ok(Attempt::changed(if request.new { dated(document, &request.projection, at)? } else { document }))
    }

    /// A document that was read, as it is asked for. Where only the server can show it, it is read again by the filter, and is
    /// nothing where it is another one by then.
    fn show(
        &self,
        ns: &Namespace,
        request: &FindAndModify,
        (update, filter): (&UpdateRequest, Document),
        document: &RawDocumentBuf,
        at: DateTime,
    ) -> Result<Option<RawDocumentBuf>, StoreError> {
        if request.projection.is_empty() {
            return Ok(Some(document.clone()));
        }
        let collation = self.showing(ns, request)?;
        match Shown::parse(request, collation) {
            Ok(shown) if !asks_for_score(&request.projection) => Ok(Some(shown.of(document, at)?)),
            _ => {
                let filter = doc! { "$and": [filter, the_same(request, update, document)?] };
                let modifiers = request.modifiers.without_hint();
                let find = Find { filter, modifiers, ..request.find(request.projection.clone()) };
                self.find(ns, &find)?.next().transpose()
            }
        }
    }

    /// The collation in which a projection compares strings.
    fn showing(&self, ns: &Namespace, request: &FindAndModify) -> Result<Option<Collation>, StoreError> {
        let is_plain = request.projection.values().all(is_choice) && !is_positional(&request.projection);
        match &request.modifiers.collation {
            None if !is_plain => self.default_collation(ns),
            own => Ok(own.clone()),
        }
    }

    /// Inserts what filter and update describe; nothing where another client has just inserted a document that matches. (The
    /// server would change that one, and not say whether it did.)
    fn insert_unmatched(
        &self,
        ns: &Namespace,
        request: &FindAndModify,
        update: &UpdateRequest,
        at: Option<DateTime>,
    ) -> Result<Option<Modified>, StoreError> {
        let collation = match self.comparing(ns, update)? {
            None => self.showing(ns, request)?,
            collation => collation,
        };
        let shown = Shown::parse(request, collation)?;
        let now = at.unwrap_or_else(DateTime::now);
        let made = shown.within(|| {
            let made = update.update.compile(&update.array_filters, &shown.constants)?;
            let made = made.upsert(&request.filter, now)?;
            at.map_or(Ok(made.clone()), |at| metadata::upsert(&made, at))
        })?;
        let document = Document::try_from(&*made).map_err(QueryError::from)?;
        match self.insert_all(ns, vec![document]) {
            Ok(_) => {}
            Err(StoreError::Duplicate { .. }) if self.find(ns, &request.find(Document::new()))?.next().is_some() => {
                return Ok(None);
            }
            Err(error) => return Err(error),
        }
        let document = if request.new { Some(shown.of(&made, now)?) } else { None };
        Ok(Some(Modified { document, is_found: false, is_changed: true, upserted: Some(id_of(&made)?) }))
    }

    /// The server's own command; returns the document that was changed.
    fn change_one(&self, ns: &Namespace, change: Change<'_>) -> Result<Option<RawDocumentBuf>, StoreError> {
        let collection = self.collection(ns);
        let returned = if change.new { ReturnDocument::After } else { ReturnDocument::Before };
        let changed = match change.update {
            UpdateSpec::Document(document) if is_replacement(&document) => {
                let body = RawDocumentBuf::try_from(&document).map_err(QueryError::from)?;
                let action = bypassing!(self, collection.find_one_and_replace(change.filter, body));
                let action = modified!(action, change.modifiers, collation variables hint time);
                let action = action.sort(change.sort.clone()).projection(change.projection.clone());
                action.return_document(returned).run()
            }
            update => {
                let update = match update {
                    UpdateSpec::Document(document) => UpdateModifications::Document(document),
                    UpdateSpec::Pipeline(stages) => UpdateModifications::Pipeline(stages),
                };
                let action = bypassing!(self, collection.find_one_and_update(change.filter, update));
                let mut action = modified!(action, change.modifiers, collation variables hint time);
                if !change.array_filters.is_empty() {
                    action = action.array_filters(change.array_filters.to_vec());
                }
                let action = action.sort(change.sort.clone()).projection(change.projection.clone());
                action.return_document(returned).run()
            }
        };
        changed.map_err(|e| failure::explain_change(&self.address, ns, &e))
    }
}

impl Attempt {
    fn done(document: RawDocumentBuf, is_changed: bool) -> Self {
        Self::Done(Modified { document: Some(document), is_found: true, is_changed, upserted: None })
    }

    fn changed(document: RawDocumentBuf) -> Self {
        Self::done(document, true)
    }
}

/// The document that a request is about, where it still matches. No expression goes with the positional `$` of a projection.
fn this(request: &FindAndModify, id: &Bson) -> Document {
    let collation = request.modifiers.collation.as_ref().filter(|_| !is_positional(&request.projection));
    doc! { "$and": [request.filter.clone(), exactly(id, collation)] }
}

/// The condition that a document is as it was read, as far as a command can say that.
fn the_same(
    request: &FindAndModify,
    update: &UpdateRequest,
    document: &RawDocumentBuf,
) -> Result<Document, QueryError> {
    if is_positional(&request.projection) {
        return with_the_same_metadata(document);
    }
    as_read(document, update)
}

impl<'a> Change<'a> {
    /// What is asked for, by this update.
    fn asked(request: &'a FindAndModify, asked: &'a UpdateRequest, update: UpdateSpec) -> Self {
        Self {
            filter: request.filter.clone(),
            sort: &request.sort,
            update,
            array_filters: &asked.array_filters,
            modifiers: &request.modifiers,
            new: request.new,
            projection: &request.projection,
        }
    }
}

/// A document that is shown as it is after a change, with the date of that, where its metadata is shown as a whole.
fn dated(document: RawDocumentBuf, projection: &Document, at: DateTime) -> Result<RawDocumentBuf, QueryError> {
    let is_of_info = |path: &str| path.split('.').next() == Some(INFO);
    let is_whole =
        projection.iter().filter(|(path, _)| is_of_info(path)).all(|(path, value)| path == INFO && is_choice(value));
    match document.get(INFO)? {
        Some(RawBsonRef::Document(_)) if is_whole => {
            let mut document = Document::try_from(&*document)?;
            if let Some(Bson::Document(info)) = document.get_mut(INFO) {
                info.insert(UPDATED, at);
            }
            Ok(RawDocumentBuf::try_from(&document)?)
        }
        _ => Ok(document),
    }
}

/// Whether the value of a projection only says whether the field is shown.
fn is_choice(value: &Bson) -> bool {
    matches!(value, Bson::Int32(_) | Bson::Int64(_) | Bson::Double(_) | Bson::Boolean(_))
}

/// How a document is shown that rmem has itself.
struct Shown {
    filter: Filter,
    projection: Projection,
    constants: Document,
    collation: Option<Collation>,
}

impl Shown {
    fn parse(request: &FindAndModify, collation: Option<Collation>) -> Result<Self, QueryError> {
        let constants = constants(&request.modifiers.variables)?;
        let filter = Filter::parse_with_constants(&request.filter, &constants)?;
        let projection = Projection::parse_with(&request.projection, &constants)?;
        Ok(Self { filter, projection, constants, collation })
    }

    /// Does some work in which strings compare by the collation.
    fn within<T>(&self, work: impl FnOnce() -> T) -> T {
        during(self.collation.as_ref(), work)
    }

    fn of(&self, document: &RawDocumentBuf, now: DateTime) -> Result<RawDocumentBuf, QueryError> {
        self.within(|| self.projection.apply(document, &self.filter, now))
    }
}
