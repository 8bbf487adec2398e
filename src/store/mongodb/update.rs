//! Updates that write their metadata only to documents that change.
//!
//! The server has no update that sets a field only where another field changes. Where one request cannot carry both
//! (`single_step`), the matching documents are read first, from the primary since other members may be behind it,
//! and rmem predicts which of them the update changes.
//! The server updates those with their metadata in the same step, and the others without. (Metadata in every update would
//! report documents as changed that are not; a change computed here would not be the server's.)
//!
//! Many documents are read and updated in a transaction, in parts: no other client changes them in between. Where others
//! are always faster, or a document is refused, each is updated by itself, if it is as it was read. A server without
//! transactions updates those that still match. Only where nothing can be
//! predicted, or where the server changes a document that was to stay the same, is the
//! metadata written in a second step.
//!
//! An upsert inserts the document that rmem makes, with its metadata, where the server finds nothing, too.

use std::collections::{HashMap, HashSet};

use bson::{Bson, DateTime, Document, RawDocumentBuf, Timestamp, doc};

use super::MongoDb;
use super::attempts::{any_of, choices};
use super::dates::{add_field, inserted, path};
use super::named::{self, none_of};
use super::prediction::{Before, Prediction, compares, is_uncertain, predict};
use super::single_step::{self, Meaning, Single};
use super::transaction::{Ended, Transaction, Tried};
use super::unchanged::{as_read, dates, fits};
use crate::interrupt::stops_work;
use crate::query::collation::during;
use crate::query::{Collation, QueryError, check_upsert, constants, key};
use crate::store::document::with_id_first;
use crate::store::metadata::{self, INFO, INSERTED, UPDATED};
use crate::store::{Find, Modifiers, Namespace, Store as _, StoreError, UpdateRequest, UpdateSpec, Updated};

/// How many documents are updated by one command.
const CHUNK: usize = 1_000;
/// The same where each is named by a longer condition, with a collation.
const CHUNK_WITH_COLLATION: usize = 100;
/// About how many bytes of `_id`s one command names. With a collation each is named five times.
const CHUNK_BYTES: usize = 2 << 20;
/// About how many bytes of documents are read and updated by one command.
const CHUNK_READ: usize = 48 << 20;

/// A timestamp in whose place an insert writes the time.
const EMPTY: Bson = Bson::Timestamp(Timestamp { time: 0, increment: 0 });

/// Which of the matches are updated.
#[derive(Clone, Copy)]
enum Which<'i> {
    /// All, if they are so many at most.
    All { most: usize },
    /// Those with these `_id`s.
    These(&'i [Bson]),
}

/// What came of an attempt to update some documents in a transaction.
enum Part {
    Done(Updated),
    /// They are too many, or too large, to be read at once.
    TooLarge,
    /// Others were always faster, or one of the documents cannot be updated.
    OneByOne,
    /// The server has no transactions for them.
    Unable,
}

/// An update of documents that are read before.
struct Work<'a> {
    ns: &'a Namespace,
    request: &'a UpdateRequest,
    at: DateTime,
    /// By which the update compares strings.
    collation: Option<Collation>,
}

impl MongoDb {
    pub(super) fn update_with_metadata(
        &self,
        ns: &Namespace,
        request: &UpdateRequest,
        at: DateTime,
    ) -> Result<Updated, StoreError> {
        metadata::check_update(&request.update)?;
        if request.upsert {
            check_upsert(&request.filter)?;
        }
        self.in_attempts(|_| {
            let done = match self.in_one_request(ns, request, at)? {
                Some(done) => done,
                None => self.update_what_is_read(ns, request, at)?,
            };
            if done.matched > 0 || !request.upsert {
                return Ok(Some(done));
            }
            match self.upsert(ns, request, at) {
                Err(StoreError::Duplicate { .. }) if self.matches(ns, request)? => Ok(None),
                done => done,
            }
        })
    }

    /// Inserts what filter and update describe, with its metadata; nothing where another client has just inserted a match.
    fn upsert(&self, ns: &Namespace, request: &UpdateRequest, at: DateTime) -> Result<Option<Updated>, StoreError> {
        let Some(made) = self.made(ns, request, at)? else {
            // Only the server can make it, and dates a match that it finds now.
            let update = with_metadata_of(&request.update, at)?;
            return self.apply(ns, UpdateRequest { update, ..request.clone() }).map(Some);
        };
        if let UpdateSpec::Document(update) = &request.update
            && keeps_query(update)
            && !made.keys().any(|name| name.is_empty() || name.starts_with('$') || name.contains('.'))
        {
            // A match that is there now stays as it is.
            let update = UpdateSpec::Document(doc! { "$setOnInsert": made.clone() });
            let asked = UpdateRequest { update, array_filters: Vec::new(), ..request.clone() };
            if fits(&asked)? {
                let done = self.apply(ns, asked)?;
                return Ok((done.matched == 0).then_some(done));
            }
        }
        let upserted = made.get("_id").cloned();
        self.insert_all(ns, vec![made])?;
        Ok(Some(Updated { upserted, ..Updated::default() }))
    }

    /// The document that an upsert inserts; nothing where only the server can make it, or refuse to.
    fn made(&self, ns: &Namespace, request: &UpdateRequest, at: DateTime) -> Result<Option<Document>, StoreError> {
        if is_uncertain(&request.update, &request.modifiers.variables) {
            return Ok(None);
        }
        let collation = self.comparing(ns, request)?;
        let made = during(collation.as_ref(), || {
            let constants = constants(&request.modifiers.variables)?;
            let update = request.update.compile(&request.array_filters, &constants)?;
            Document::try_from(&*metadata::upsert(&update.upsert(&request.filter, at)?, at)?).map_err(QueryError::from)
        });
        match made {
            // The server would be asked by a pipeline, with which it refuses other queries.
            Err(mistake) if replaces(&request.update) => Err(mistake.into()),
            // It would write the time into what is to stay empty.
            Ok(made) if made.values().any(|value| *value == EMPTY) => Ok(None),
            made => Ok(made.ok()),
        }
    }

    /// Whether there is anything to be updated.
    fn matches(&self, ns: &Namespace, request: &UpdateRequest) -> Result<bool, StoreError> {
        Ok(self.find(ns, &matching(request, request.filter.clone(), 1))?.next().transpose()?.is_some())
    }

    /// Updates the first match with its metadata by one request; nothing is done where none of those tried can.
    fn in_one_request(
        &self,
        ns: &Namespace,
        request: &UpdateRequest,
        at: DateTime,
    ) -> Result<Option<Updated>, StoreError> {
        for Single { request, meaning } in single_step::with_metadata(request, at)? {
            if meaning == Meaning::IfTaken && !self.notes_what_pipelines_change() {
                return Ok(None);
            }
            match (self.apply(ns, request), meaning) {
                // What the request has may also not go with a pipeline.
                (Err(StoreError::Query(_)), Meaning::IfTaken) => {}
                (Ok(Updated { matched: 0, .. }), Meaning::IfDifferent) => {}
                (done, _) => return done.map(Some),
            }
        }
        Ok(None)
    }

    fn update_what_is_read(
        &self,
        ns: &Namespace,
        request: &UpdateRequest,
        at: DateTime,
    ) -> Result<Updated, StoreError> {
        let work = Work { ns, request, at, collation: self.comparing(ns, request)? };
        let done = if request.many { self.update_all(&work)? } else { self.update_first(&work)? };
        if done.matched == 0 && !request.upsert {
            // An update of nothing is checked by the server, too.
            self.apply(ns, UpdateRequest { filter: none_of(&request.filter), ..request.clone() })?;
        }
        Ok(done)
    }

    fn update_first(&self, work: &Work<'_>) -> Result<Updated, StoreError> {
        let Work { ns, request, .. } = *work;
        self.in_attempts(|attempt| {
            let find = matching(request, request.filter.clone(), choices(&request.filter, attempt));
            let Some(chosen) = any_of(with_ids(self.find(ns, &find)?)?) else { return Ok(Some(Updated::default())) };
            let done = self.update_chunk(work, vec![chosen])?;
            Ok((done.matched > 0).then_some(done))
        })
    }

    fn update_all(&self, work: &Work<'_>) -> Result<Updated, StoreError> {
        let Work { ns, request, .. } = *work;
        let each = makes_new_documents(&request.update);
        let most = match &request.modifiers.collation {
            Some(_) if compares(request) => CHUNK_WITH_COLLATION,
            _ => CHUNK,
        };
        if !each && let Part::Done(done) = self.update_part(work, Which::All { most })? {
            return Ok(done);
        }
        // All are looked up before the first is changed, so that none is met again where an index puts it elsewhere.
        let find = Find { projection: doc! { "_id": 1 }, ..matching(request, request.filter.clone(), 0) };
        let matches: Vec<Bson> = with_ids(self.find(ns, &find)?)?.into_iter().map(|(id, _)| id).collect();
        let mut parts = chunks(&matches, most);
        parts.reverse();
        let mut done = Updated::default();
        while let Some(ids) = parts.pop() {
            if stops_work() {
                return Err(StoreError::Interrupted { done: done.modified });
            }
            let part = if each {
                Part::OneByOne
            } else {
                self.update_part(work, Which::These(ids)).map_err(|e| e.after(done.modified))?
            };
            match part {
                Part::Done(more) => add(&mut done, &more),
                Part::TooLarge if ids.len() > 1 => {
                    let (first, second) = ids.split_at(ids.len() / 2);
                    parts.extend([second, first]);
                }
                Part::TooLarge | Part::OneByOne => self.update_one_by_one(work, ids, &mut done)?,
                Part::Unable => self.update_what_matches(work, ids, &mut done)?,
            }
        }
        Ok(done)
    }

    /// Updates matches in a transaction.
    fn update_part(&self, work: &Work<'_>, which: Which<'_>) -> Result<Part, StoreError> {
        let Work { ns, request, .. } = *work;
        let find = match which {
            Which::All { most } => matching(request, request.filter.clone(), most as u64 + 1),
            Which::These(ids) => {
                let these = doc! { "$and": [request.filter.clone(), named::among(ids, None)] };
                let modifiers = request.modifiers.without_hint();
                Find { modifiers, ..matching(request, these, 0) }
            }
        };
        // With a collation, texts that differ may be equal.
        let known: Option<HashSet<_>> = match which {
            Which::These(ids) if request.modifiers.collation.is_some() => {
                Some(ids.iter().map(key::encode_value).collect())
            }
            _ => None,
        };
        let tried = self.in_transaction(ns, |transaction| {
            let Some(mut matches) = transaction.read(&find, CHUNK_READ)? else { return Ok(Part::TooLarge) };
            if matches!(which, Which::All { most } if matches.len() > most) {
                return Ok(Part::TooLarge);
            }
            if let Some(known) = &known {
                matches.retain(|(id, _)| known.contains(&key::encode_value(id)));
            }
            if matches.is_empty() {
                return Ok(Part::Done(Updated::default()));
            }
            Ok(self.update_in(transaction, work, matches)?.map_or(Part::OneByOne, Part::Done))
        });
        match tried {
            Ok(Tried::Done(part)) => Ok(part),
            Ok(Tried::Overtaken) => Ok(Part::OneByOne),
            Ok(Tried::Unable) => Ok(Part::Unable),
            // Those before the one that is refused are updated.
            Err(error) if error.is_of_document() => Ok(Part::OneByOne),
            Err(error) => Err(error),
        }
    }

    /// Updates documents in the transaction in which they were read; nothing where one of them cannot be updated.
    fn update_in(
        &self,
        transaction: &mut Transaction<'_>,
        work: &Work<'_>,
        before: Before,
    ) -> Result<Option<Updated>, Ended> {
        let Work { request, at, .. } = *work;
        let matched = before.len() as u64;
        let plain = without_metadata(&request.update, &before, at)?;
        let (changing, rest) = match predict(&plain, request, work.collation.as_ref(), &before, at) {
            None => (Before::new(), before),
            Some(predictions) if predictions.contains(&Prediction::Fails) => return Ok(None),
            Some(predictions) => {
                let (mut changing, mut rest) = (Before::new(), Before::new());
                for (document, prediction) in before.into_iter().zip(predictions) {
                    match prediction {
                        Prediction::Changes => changing.push(document),
                        // The server would count it.
                        Prediction::Moves => {}
                        Prediction::Stays | Prediction::Fails => rest.push(document),
                    }
                }
                (changing, rest)
            }
        };
        let mut modified = 0;
        if !changing.is_empty() {
            modified += transaction.update(of_these(request, with_updated(&plain, at)?, &changing))?.modified;
        }
        if !rest.is_empty() {
            let more = transaction.update(of_these(request, plain, &rest))?.modified;
            if more > 0 {
                let find = Find { filter: named::among(&ids(&rest), None), ..Find::default() };
                let after = transaction.read(&find, usize::MAX)?.unwrap_or_default();
                transaction.update(dating(changed(&rest, after), at))?;
            }
            modified += more;
        }
        Ok(Some(Updated { matched, modified, upserted: None }))
    }

    /// Updates these documents, those that still match, each by itself.
    fn update_one_by_one(&self, work: &Work<'_>, these: &[Bson], done: &mut Updated) -> Result<(), StoreError> {
        let Work { ns, request, .. } = *work;
        for id in these {
            if stops_work() {
                return Err(StoreError::Interrupted { done: done.modified });
            }
            let filter =
                doc! { "$and": [request.filter.clone(), named::exactly(id, request.modifiers.collation.as_ref())] };
            let find = matching(request, filter, 1);
            let one = self.in_attempts(|_| {
                let before = with_ids(self.find(ns, &find)?)?;
                if before.is_empty() {
                    return Ok(Some(Updated::default()));
                }
                let done = self.update_chunk(work, before)?;
                Ok((done.matched > 0).then_some(done))
            });
            add(done, &one.map_err(|error| error.after(done.modified))?);
        }
        Ok(())
    }

    /// Updates those of these documents that still match, on a server without transactions.
    fn update_what_matches(&self, work: &Work<'_>, these: &[Bson], done: &mut Updated) -> Result<(), StoreError> {
        let Work { ns, request, at, .. } = *work;
        let filter =
            doc! { "$and": [request.filter.clone(), named::among(these, request.modifiers.collation.as_ref())] };
        let mut before = with_ids(self.find(ns, &matching(request, filter, 0))?)?;
        // By `_id`s they come in another order, and where one cannot be changed, those before it are.
        let places: HashMap<Vec<u8>, usize> =
            these.iter().enumerate().map(|(place, id)| (key::encode_value(id), place)).collect();
        before.sort_by_cached_key(|(id, _)| places.get(&key::encode_value(id)).copied());
        if !before.is_empty() {
            let more = self.update_chunk(work, before);
            add(done, &more.map_err(|error| self.counted(ns, error, (these, at), done.modified))?);
        }
        Ok(())
    }

    /// The error of an update that failed at one of these documents, after it had changed so many others. The server does not
    /// say how many of them it changed; they have the date of the update.
    fn counted(&self, ns: &Namespace, error: StoreError, (ids, at): (&[Bson], DateTime), done: u64) -> StoreError {
        if !error.is_of_document() {
            return error.after(done);
        }
        let filter = doc! { "_id": { "$in": ids }, path(UPDATED): at };
        match self.on_primary::<Document>(ns).count_documents(filter).run() {
            Ok(more) => error.after(done + more),
            // How many there were is not known.
            Err(_) => error,
        }
    }

    /// Updates those of the documents that still match, with the metadata where it is
    /// predicted that they change.
    fn update_chunk(&self, work: &Work<'_>, before: Before) -> Result<Updated, StoreError> {
        let Work { ns, request, at, .. } = *work;
        let plain = without_metadata(&request.update, &before, at)?;
        let Some(predictions) = predict(&plain, request, work.collation.as_ref(), &before, at) else {
            return self.update_then_metadata(ns, request, plain, &before, at);
        };
        // Those behind one that cannot be updated stay as they are, unless the server updates that one.
        let last = predictions.iter().position(|prediction| *prediction == Prediction::Fails).unwrap_or(before.len());
        let (mut changing, mut rest, mut behind, mut moved) = (Before::new(), Before::new(), Before::new(), 0);
        for (nth, (document, prediction)) in before.into_iter().zip(predictions).enumerate() {
            match prediction {
                _ if nth > last => behind.push(document),
                Prediction::Changes => changing.push(document),
                Prediction::Moves => moved += 1,
                Prediction::Stays | Prediction::Fails => rest.push(document),
            }
        }
        // Those that are not changed are not sent.
        let mut done = Updated { matched: moved, ..Updated::default() };
        if !changing.is_empty() {
            let mut asked = among(request, with_updated(&plain, at)?, &changing)?;
            let single = match changing.as_slice() {
                [(_, body)] if may_be_done_by_others(&plain) => Some(body),
                _ => None,
            };
            if let Some(body) = single {
                let unchanged = as_read(body, &asked)?;
                asked.filter = doc! { "$and": [asked.filter, unchanged] };
            }
            let sent = self.apply(ns, asked)?;
            add(&mut done, &sent);
            if single.is_some() && sent.matched == 0 {
                add(&mut done, &self.update_changed_by_others(work, &changing)?);
            }
        }
        for others in [rest, behind].iter().filter(|others| !others.is_empty()) {
            add(&mut done, &self.update_then_metadata(ns, request, plain.clone(), others, at)?);
        }
        Ok(done)
    }

    /// Updates a document that others changed meanwhile, which may have what the update gives already.
    fn update_changed_by_others(&self, work: &Work<'_>, this: &Before) -> Result<Updated, StoreError> {
        let Work { ns, request, at, .. } = *work;
        let this = named::among(&ids(this), request.modifiers.collation.as_ref());
        let filter = doc! { "$and": [request.filter.clone(), this] };
        let left = with_ids(self.find(ns, &matching(request, filter, 0))?)?;
        if left.is_empty() {
            return Ok(Updated::default());
        }
        let plain = without_metadata(&request.update, &left, at)?;
        self.update_then_metadata(ns, request, plain, &left, at)
    }

    /// Updates those of the documents that still match, and then writes the metadata of those
    /// that changed, also where the update fails in the middle.
    fn update_then_metadata(
        &self,
        ns: &Namespace,
        request: &UpdateRequest,
        plain: UpdateSpec,
        before: &Before,
        at: DateTime,
    ) -> Result<Updated, StoreError> {
        let ids = ids(before);
        let done = self.apply(ns, among(request, plain, before)?);
        let changed = match &done {
            Ok(done) if done.modified == 0 => return Ok(done.clone()),
            Ok(done) if done.modified == ids.len() as u64 => ids,
            _ => {
                let find = Find { filter: named::among(&ids, None), current: true, ..Find::default() };
                changed(before, with_ids(self.find(ns, &find)?)?)
            }
        };
        let dates = dating(changed, at);
        // The driver retries no update of many documents; the same dates may be set again.
        let is_unconfirmed = matches!(done, Err(StoreError::Unconfirmed { .. }));
        let waited = is_unconfirmed.then(|| self.without_majority());
        let store = waited.as_ref().unwrap_or(self);
        match store.apply(ns, dates.clone()) {
            Err(StoreError::Unreachable { .. }) => store.apply(ns, dates)?,
            applied => applied?,
        };
        done
    }
}

/// The `_id`s of the documents that are not as they were.
fn changed(before: &Before, after: Before) -> Vec<Bson> {
    let known: HashMap<Vec<u8>, &RawDocumentBuf> =
        before.iter().map(|(id, body)| (key::encode_value(id), body)).collect();
    let is_new = |(id, body): &(Bson, RawDocumentBuf)| known.get(&key::encode_value(id)).is_none_or(|old| *old != body);
    after.into_iter().filter(is_new).map(|(id, _)| id).collect()
}

/// The request that writes the date of a change.
fn dating(changed: Vec<Bson>, at: DateTime) -> UpdateRequest {
    let update = UpdateSpec::Document(doc! { "$set": { path(UPDATED): at } });
    UpdateRequest { filter: named::among(&changed, None), update, many: true, ..UpdateRequest::default() }
}

/// The request for documents that are as they were read. What does not compare needs neither filter nor collation, with which
/// a document is not found by its `_id`.
fn of_these(request: &UpdateRequest, update: UpdateSpec, these: &Before) -> UpdateRequest {
    let modifiers = request.modifiers.without_hint();
    let (filter, modifiers) = match compares(request) {
        true => {
            let these = named::among(&ids(these), request.modifiers.collation.as_ref());
            (doc! { "$and": [request.filter.clone(), these] }, modifiers)
        }
        false => (named::among(&ids(these), None), Modifiers { collation: None, ..modifiers }),
    };
    UpdateRequest { filter, update, upsert: false, modifiers, ..request.clone() }
}

/// The query for matches of an update, at most so many (0 for all), by another filter.
fn matching(request: &UpdateRequest, filter: Document, limit: u64) -> Find {
    Find { filter, limit, modifiers: request.modifiers.clone(), current: true, ..Find::default() }
}

/// The parts of a list of `_id`s, in order, of at most so many, and of so many bytes that a command takes them.
fn chunks(ids: &[Bson], most: usize) -> Vec<&[Bson]> {
    let mut chunks = Vec::new();
    let (mut start, mut bytes) = (0, 0);
    for (place, id) in ids.iter().enumerate() {
        let size = key::encode_value(id).len();
        if place > start && (place - start >= most || bytes + size > CHUNK_BYTES) {
            chunks.extend(ids.get(start..place));
            (start, bytes) = (place, 0);
        }
        bytes += size;
    }
    chunks.extend(ids.get(start..).filter(|rest| !rest.is_empty()));
    chunks
}

fn ids(documents: &Before) -> Vec<Bson> {
    documents.iter().map(|(id, _)| id.clone()).collect()
}

fn add(done: &mut Updated, more: &Updated) {
    done.matched += more.matched;
    done.modified += more.modified;
}

/// The request for those of the documents that still match.
fn among(request: &UpdateRequest, update: UpdateSpec, before: &Before) -> Result<UpdateRequest, QueryError> {
    let these = named::among(&ids(before), request.modifiers.collation.as_ref());
    Ok(UpdateRequest {
        filter: doc! { "$and": [request.filter.clone(), these, as_it_was(&request.update, before)?] },
        update,
        upsert: false,
        ..request.clone()
    })
}

/// The update with a timestamp, for documents that it changes.
pub(super) fn with_updated(plain: &UpdateSpec, at: DateTime) -> Result<UpdateSpec, QueryError> {
    match plain {
        UpdateSpec::Document(document) if is_replacement(document) => {
            let mut document = document.clone();
            if let Some(Bson::Document(info)) = document.get_mut(INFO) {
                info.insert(UPDATED, at);
            }
            Ok(UpdateSpec::Document(document))
        }
        UpdateSpec::Document(document) => {
            let mut document = document.clone();
            add_field(&mut document, "$set", UPDATED, at)?;
            Ok(UpdateSpec::Document(document))
        }
        UpdateSpec::Pipeline(stages) => {
            let mut stages = stages.clone();
            stages.push(doc! { "$set": { path(UPDATED): at } });
            Ok(UpdateSpec::Pipeline(stages))
        }
    }
}

fn with_ids(documents: crate::store::Documents<'_>) -> Result<Before, StoreError> {
    documents
        .map(|document| {
            let document = document?;
            Ok((named::id_of(&document)?, document))
        })
        .collect()
}

/// Whether an update is a replacement document: one without operators.
pub(super) fn is_replacement(document: &Document) -> bool {
    !document.keys().next().is_some_and(|key| key.starts_with('$'))
}

/// Whether what an update with operators inserts has all that the query asks for.
fn keeps_query(update: &Document) -> bool {
    !is_replacement(update) && !update.contains_key("$unset") && !update.contains_key("$rename")
}

/// Whether an update replaces the whole document.
pub(super) fn replaces(update: &UpdateSpec) -> bool {
    matches!(update, UpdateSpec::Document(document) if is_replacement(document))
}

/// Whether a pipeline may give documents without what they had.
fn makes_new_documents(update: &UpdateSpec) -> bool {
    let UpdateSpec::Pipeline(stages) = update else { return false };
    let new = ["$replaceWith", "$replaceRoot", "$project"];
    stages.iter().flat_map(Document::keys).any(|name| new.contains(&name.as_str()))
}

/// The update without a new timestamp, and with those that there were.
pub(super) fn without_metadata(update: &UpdateSpec, before: &Before, at: DateTime) -> Result<UpdateSpec, QueryError> {
    match (update, before.as_slice()) {
        (UpdateSpec::Document(document), [(id, old)]) if is_replacement(document) => {
            let old = dates(old)?;
            let (mut document, mut info) = apart(document);
            info.insert(INSERTED, old.get(INSERTED).cloned().unwrap_or_else(|| at.into()));
            info.extend(old.get(UPDATED).cloned().map(|updated| (UPDATED.to_owned(), updated)));
            document.insert(INFO, info);
            if !document.contains_key("_id") {
                // Without it, the server takes the same document for another.
                document = with_id_first(document, id);
            }
            Ok(UpdateSpec::Document(document))
        }
        (UpdateSpec::Pipeline(stages), [(_, document)]) if makes_new_documents(update) => {
            let kept: Document = dates(document)?
                .into_iter()
                .map(|(key, value)| (path(&key), doc! { "$literal": value }.into()))
                .collect();
            let mut stages = stages.clone();
            stages.push(doc! { "$unset": [path(INSERTED), path(UPDATED)] });
            if !kept.is_empty() {
                stages.push(doc! { "$set": kept });
            }
            Ok(UpdateSpec::Pipeline(stages))
        }
        _ => Ok(update.clone()),
    }
}

/// The condition that the dates of a document are the known ones: a replacement keeps when its
/// predecessor was inserted, and another client may have replaced that.
pub(super) fn as_it_was(update: &UpdateSpec, before: &Before) -> Result<Document, QueryError> {
    match (update, before.as_slice()) {
        (UpdateSpec::Document(document), [(_, old)]) if is_replacement(document) => {
            let inserted = dates(old)?.get(INSERTED).cloned().unwrap_or(Bson::Null);
            Ok(doc! { path(INSERTED): { "$eq": inserted } })
        }
        _ => Ok(Document::new()),
    }
}

/// Whether an update that changes a document as it was read may find it as it would leave it: another client may have done
/// the same.
pub(super) fn may_be_done_by_others(update: &UpdateSpec) -> bool {
    let UpdateSpec::Document(document) = update else { return true };
    let cuts = |fields: &Bson| {
        let mut each = fields.as_document().into_iter().flat_map(Document::values).filter_map(Bson::as_document);
        each.any(|modifiers| modifiers.contains_key("$slice"))
    };
    !document.iter().any(|(operator, fields)| match operator.as_str() {
        "$inc" | "$currentDate" => true,
        "$push" => !cuts(fields),
        _ => false,
    })
}

/// A replacement without its metadata, and the application's part of the metadata.
fn apart(document: &Document) -> (Document, Document) {
    let mut document = document.clone();
    let mut own = match document.remove(INFO) {
        Some(Bson::Document(own)) => own,
        _ => Document::new(),
    };
    own.remove(INSERTED);
    own.remove(UPDATED);
    (document, own)
}

/// The update with its metadata, for a document that is inserted by it. A
/// replacement becomes a pipeline, because it has to keep when its predecessor
/// was inserted, should there be one by then.
fn with_metadata_of(update: &UpdateSpec, at: DateTime) -> Result<UpdateSpec, QueryError> {
    match update {
        UpdateSpec::Document(document) if is_replacement(document) => replacement(document, at),
        UpdateSpec::Document(document) => Ok(UpdateSpec::Document(operators(document.clone(), at)?)),
        UpdateSpec::Pipeline(stages) => {
            let mut stages = stages.clone();
            stages.push(doc! { "$set": { path(UPDATED): at, path(INSERTED): inserted(at) } });
            Ok(UpdateSpec::Pipeline(stages))
        }
    }
}

fn operators(mut update: Document, at: DateTime) -> Result<Document, QueryError> {
    add_field(&mut update, "$set", UPDATED, at)?;
    add_field(&mut update, "$setOnInsert", INSERTED, at)?;
    Ok(update)
}

/// A replacement whose metadata is the application's, when it was made, and when the
/// document was inserted.
fn replacement(document: &Document, at: DateTime) -> Result<UpdateSpec, QueryError> {
    let (document, own) = apart(document);
    let info = doc! { "$mergeObjects": [{ "$literal": own }, { INSERTED: inserted(at), UPDATED: at }] };
    let whole = doc! { "$mergeObjects": [{ "_id": "$_id" }, { "$literal": document }, { INFO: info }] };
    Ok(UpdateSpec::Pipeline(vec![doc! { "$replaceWith": whole }]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_command_names_too_much() {
        let sizes = |ids: &[Bson], most| chunks(ids, most).into_iter().map(<[Bson]>::len).collect::<Vec<_>>();
        assert_eq!(sizes(&[], 3), [0_usize; 0]);
        let few: Vec<Bson> = (0..7).map(Bson::Int32).collect();
        assert_eq!((sizes(&few, 3), sizes(&few, 1)), (vec![3, 3, 1], vec![1; 7]));
        let long: Vec<Bson> =
            ["a", "b", "c", "d", "e"].iter().map(|text| text.repeat(CHUNK_BYTES / 2).into()).collect();
        assert_eq!(sizes(&long, 100), [1; 5]);
        let half: Vec<Bson> = long.iter().map(|text| text.as_str().unwrap()[..CHUNK_BYTES / 3].into()).collect();
        assert_eq!(sizes(&half, 100), [2, 2, 1]);
    }

    #[test]
    fn only_what_may_be_there_already_is_looked_at() {
        let may = |update: Document| may_be_done_by_others(&UpdateSpec::Document(update));
        for update in [
            doc! { "$addToSet": { "l": 1 } },
            doc! { "$max": { "n": 1 }, "$set": { "a.b": 1 } },
            doc! { "n": 1 },
            doc! { "$pop": { "l": 1 } },
            doc! { "$push": { "l": { "$each": [1], "$slice": 1 } } },
        ] {
            assert!(may(update.clone()), "{update}");
        }
        for update in [doc! { "$inc": { "n": 1 } }, doc! { "$set": { "a.b": 1 }, "$push": { "l": { "$each": [1] } } }] {
            assert!(!may(update.clone()), "{update}");
        }
        let pipeline = UpdateSpec::Pipeline(vec![doc! { "$set": { "n": 1 } }]);
        assert!(may_be_done_by_others(&pipeline));
    }
}
