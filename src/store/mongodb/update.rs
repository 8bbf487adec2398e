//! Updates that write their metadata only to documents that change.
//!
//! The server has no update that sets a field only where another field changes. Where one request cannot carry both
//! (`single_step`), the matching documents are read first, from the primary since other members may be behind it,
//! and rmem predicts which of them the update changes.
//! The server updates those with their metadata in the same step, and the others without. (Metadata in every update would
//! report documents as changed that are not; a change computed here would not be the server's.)
//!
//! Many documents are updated in parts: by one request, where the server can tell which of them change (`differing`), else by
//! a statement each (`statements`). So each is changed once, by whomever, and no update of another client is lost. A document
//! that is another one meanwhile is read and updated by itself. Only where nothing can be
//! predicted, or where the server changes a document that was to stay the same, is the
//! metadata written in a second step.
//!
//! An upsert inserts the document that rmem makes, with its metadata, where the server finds nothing, too.

use std::cell::RefCell;
use std::collections::HashMap;

use bson::{Bson, DateTime, Document, RawDocumentBuf, Timestamp, doc};

use super::attempts::{any_of, check_going_on, choices};
use super::dates::{add_field, inserted, path};
use super::differing::differing;
use super::named::{self, none_of};
use super::prediction::{Before, Prediction, compares, is_uncertain, predict};
use super::single_step::{self, Meaning, Single};
use super::statements::Statements;
use super::unchanged::{as_read, dates, fits};
use super::{MongoDb, failure};
use crate::query::collation::during;
use crate::query::{Collation, Filter, QueryError, check_upsert, constants, key};
use crate::store::document::with_id_first;
use crate::store::metadata::{self, INFO, INSERTED, UPDATED};
use crate::store::{Find, Namespace, Store as _, StoreError, UpdateRequest, UpdateSpec, Updated};

/// How many documents are updated by one command.
const CHUNK: usize = 1_000;
/// The same where each is named by a longer condition, with a collation.
const CHUNK_WITH_COLLATION: usize = 100;
/// About how many bytes of `_id`s one command names. With a collation each is named up to five times.
const CHUNK_BYTES: usize = 2 << 20;
/// About how many bytes of documents are read and updated by one command.
const CHUNK_READ: usize = 48 << 20;

/// A timestamp in whose place an insert writes the time.
const EMPTY: Bson = Bson::Timestamp(Timestamp { time: 0, increment: 0 });

/// An update of documents that are read before.
struct Work<'a> {
    ns: &'a Namespace,
    request: &'a UpdateRequest,
    at: DateTime,
    /// By which the update compares strings.
    collation: Option<Collation>,
    /// Where not as many members confirmed a part as were to: the others are done all the same.
    unconfirmed: RefCell<Option<StoreError>>,
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
            if meaning == Meaning::IfTaken && !self.notes_what_pipelines_change()? {
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
        let unconfirmed = RefCell::default();
        let work = Work { ns, request, at, collation: self.comparing(ns, request)?, unconfirmed };
        let done = if request.many { self.update_all(&work)? } else { self.update_first(&work)? };
        if done.matched == 0 && !request.upsert {
            // An update of nothing is checked by the server, too.
            self.apply(ns, UpdateRequest { filter: none_of(&request.filter), ..request.clone() })?;
        }
        work.unconfirmed.take().map_or(Ok(()), |error| Err(error.after(done.modified)))?;
        Ok(done)
    }

    fn update_first(&self, work: &Work<'_>) -> Result<Updated, StoreError> {
        let Work { ns, request, .. } = *work;
        self.in_attempts(|attempt| {
            let find = matching(request, request.filter.clone(), choices(&request.filter, attempt));
            let Some(chosen) = any_of(with_ids(self.find(ns, &find)?)?) else { return Ok(Some(Updated::default())) };
            let done = self.update_single(work, chosen)?;
            Ok((done.matched > 0).then_some(done))
        })
    }

    fn update_all(&self, work: &Work<'_>) -> Result<Updated, StoreError> {
        let mut done = Updated::default();
        match self.update_in_parts(work, &mut done) {
            Ok(()) => Ok(done),
            Err(error) => Err(error.after(done.modified)),
        }
    }

    fn update_in_parts(&self, work: &Work<'_>, done: &mut Updated) -> Result<(), StoreError> {
        let Work { ns, request, .. } = *work;
        let each = makes_new_documents(&request.update);
        let most = match &request.modifiers.collation {
            Some(_) if compares(request) => CHUNK_WITH_COLLATION,
            _ => CHUNK,
        };
        let few = matching(request, request.filter.clone(), most as u64 + 1);
        if !each
            && let Some(all) =
                self.read(ns, &few)?.filter(|all| all.len() <= most && chunks(&ids(all), most).len() <= 1)
        {
            return self.update_several(work, all, done);
        }
        // All are looked up before the first is changed, so that none is met again where an index puts it elsewhere.
        let find = Find { projection: doc! { "_id": 1 }, ..matching(request, request.filter.clone(), 0) };
        let matches: Vec<Bson> = with_ids(self.find(ns, &find)?)?.into_iter().map(|(id, _)| id).collect();
        let mut parts = chunks(&matches, most);
        parts.reverse();
        while let Some(ids) = parts.pop() {
            check_going_on(done.modified)?;
            let part = if each { None } else { self.part(work, ids)? };
            match part {
                Some(before) => self.update_several(work, before, done)?,
                None if !each && ids.len() > 1 => {
                    let (first, second) = ids.split_at(ids.len() / 2);
                    parts.extend([second, first]);
                }
                None => self.update_one_by_one(work, ids, done)?,
            }
        }
        Ok(())
    }

    /// The matches; nothing where they have too many bytes.
    fn read(&self, ns: &Namespace, find: &Find) -> Result<Option<Before>, StoreError> {
        let (mut matches, mut bytes) = (Before::new(), 0);
        for document in self.find(ns, find)? {
            let document = document?;
            bytes += document.as_bytes().len();
            if bytes > CHUNK_READ && !matches.is_empty() {
                return Ok(None);
            }
            matches.push((named::id_of(&document)?, document));
        }
        Ok(Some(matches))
    }

    /// Those of these documents that still match, in this order; nothing where they have too many bytes.
    fn part(&self, work: &Work<'_>, ids: &[Bson]) -> Result<Option<Before>, StoreError> {
        let Work { ns, request, .. } = *work;
        let these = doc! { "$and": [beside_ids(request), named::among(ids, None)] };
        let find = Find { modifiers: request.modifiers.without_hint(), ..matching(request, these, 0) };
        let Some(before) = self.read(ns, &find)? else { return Ok(None) };
        let places: HashMap<Vec<u8>, usize> =
            ids.iter().enumerate().map(|(place, id)| (key::encode_value(id), place)).collect();
        // With a collation, texts that differ may be equal: the others have no place.
        let place = |document: (Bson, RawDocumentBuf)| Some((*places.get(&key::encode_value(&document.0))?, document));
        let mut placed: Vec<_> = before.into_iter().filter_map(place).collect();
        placed.sort_by_key(|(place, _)| *place);
        Ok(Some(placed.into_iter().map(|(_, document)| document).collect()))
    }

    /// Updates documents as they were read, up to one that cannot be updated.
    fn update_several(&self, work: &Work<'_>, before: Before, done: &mut Updated) -> Result<(), StoreError> {
        let Work { request, at, .. } = *work;
        if before.is_empty() {
            return Ok(());
        }
        let plain = without_metadata(&request.update, &before, at)?;
        let Some(predictions) = predict(&plain, request, work.collation.as_ref(), &before, at) else {
            return self.update_and_date(work, &plain, &before, done);
        };
        let (mut changing, mut rest) = (Before::new(), Before::new());
        for (document, prediction) in before.into_iter().zip(predictions) {
            match prediction {
                Prediction::Changes => changing.push(document),
                // The server would count it.
                Prediction::Moves => done.matched += 1,
                Prediction::Stays => rest.push(document),
                Prediction::Fails => {
                    self.update_changing(work, &plain, std::mem::take(&mut changing), done)?;
                    self.update_and_date(work, &plain, &std::mem::take(&mut rest), done)?;
                    // The server says why it cannot be updated, or updates it.
                    self.update_one_by_one(work, &[document.0], done)?;
                }
            }
        }
        self.update_changing(work, &plain, changing, done)?;
        self.update_and_date(work, &plain, &rest, done)
    }

    /// The same for documents that may stay as they are.
    fn update_and_date(
        &self,
        work: &Work<'_>,
        plain: &UpdateSpec,
        these: &[(Bson, RawDocumentBuf)],
        done: &mut Updated,
    ) -> Result<(), StoreError> {
        if these.len() > 1 && !fits(&among(work.request, plain.clone(), these)?)? {
            let (first, second) = these.split_at(these.len() / 2);
            self.update_and_date(work, plain, first, done)?;
            return self.update_and_date(work, plain, second, done);
        }
        if !these.is_empty() {
            let more = self.update_then_metadata(work.ns, work.request, plain.clone(), these, work.at);
            add(done, &more.map_err(|error| error.after(done.modified))?);
        }
        Ok(())
    }

    /// The same for documents that change.
    fn update_changing(
        &self,
        work: &Work<'_>,
        plain: &UpdateSpec,
        these: Before,
        done: &mut Updated,
    ) -> Result<(), StoreError> {
        let Work { request, .. } = *work;
        if these.is_empty() {
            return Ok(());
        }
        let has_collation = request.modifiers.collation.is_some();
        let condition = match plain {
            UpdateSpec::Document(update) if !has_collation || compares(request) => differing(update),
            _ => None,
        };
        match condition {
            Some(condition) => self.update_differing(work, plain, &condition, these, done),
            // By a statement, each would be looked for among all.
            None if has_collation && compares(request) => self.update_differing(work, plain, &doc! {}, these, done),
            None => self.update_by_statements(work, plain, &these, done),
        }
    }

    /// The same by a request for all, which changes those of them for which a condition holds.
    fn update_differing(
        &self,
        work: &Work<'_>,
        plain: &UpdateSpec,
        condition: &Document,
        these: Before,
        done: &mut Updated,
    ) -> Result<(), StoreError> {
        let Work { ns, request, at, .. } = *work;
        let collation = match &request.modifiers.collation {
            None if !condition.is_empty() => self.default_collation(ns)?,
            own => own.clone(),
        };
        let (differing, alike): (Before, Before) = during(collation.as_ref(), || {
            let condition = Filter::parse(condition)?;
            let (mut differing, mut alike) = (Before::new(), Before::new());
            for document in these {
                if condition.matches(&document.1)? { differing.push(document) } else { alike.push(document) }
            }
            Ok::<_, QueryError>((differing, alike))
        })?;
        if differing.is_empty() {
            return self.update_and_date(work, plain, &alike, done);
        }
        let mut asked = among(request, with_updated(plain, at)?, &differing)?;
        let these = asked.filter.clone();
        if !condition.is_empty() {
            asked.filter = doc! { "$and": [&these, condition] };
        }
        if fits(&asked)? {
            let sent = self.applied(ns, asked);
            let (sent, unconfirmed) =
                sent.map_err(|error| self.counted(ns, error, (&ids(&differing), at), done.modified))?;
            if unconfirmed.is_some() {
                work.unconfirmed.replace(unconfirmed);
            }
            add(done, &sent);
            if !condition.is_empty() && sent.matched < differing.len() as u64 {
                let kept = self.still_matching(work, plain, &differing, collation.as_ref());
                let find = doc! { "$and": [these, { "$nor": [condition] }] };
                let now =
                    with_ids(self.find(ns, &Find { projection: doc! { "_id": 1 }, ..matching(request, find, 0) })?)?;
                // To the others, another client has done the same. Those changed here may match as well.
                done.matched += (now.len() as u64).saturating_sub(sent.matched.min(kept));
            }
        } else if request.modifiers.collation.is_some() {
            self.update_one_by_one(work, &ids(&differing), done)?;
        } else {
            self.update_by_statements(work, plain, &differing, done)?;
        }
        self.update_and_date(work, plain, &alike, done)
    }

    /// How many of the documents match as an update leaves them.
    fn still_matching(
        &self,
        work: &Work<'_>,
        plain: &UpdateSpec,
        these: &Before,
        collation: Option<&Collation>,
    ) -> u64 {
        let Work { request, at, .. } = *work;
        let count = || {
            let constants = constants(&request.modifiers.variables)?;
            let update = plain.compile(&request.array_filters, &constants)?;
            let filter = Filter::parse_with_constants(&request.filter, &constants)?;
            let mut count = 0;
            for (_, body) in these {
                let after = update.apply(body, &filter, at)?;
                count += u64::from(filter.matches(after.as_ref().unwrap_or(body))?);
            }
            Ok::<_, QueryError>(count)
        };
        // What only the server understands is taken to be so still.
        during(collation, count).unwrap_or(these.len() as u64)
    }

    /// The same by a statement each.
    fn update_by_statements(
        &self,
        work: &Work<'_>,
        plain: &UpdateSpec,
        these: &Before,
        done: &mut Updated,
    ) -> Result<(), StoreError> {
        let Work { ns, request, at, .. } = *work;
        let dated = with_updated(plain, at)?;
        let statements = Statements::new(request, plain, &dated)?;
        let (mut place, mut most) = (0, CHUNK);
        while let Some((id, _)) = these.get(place) {
            check_going_on(done.modified)?;
            let some = these.iter().skip(place).take(most).map(|(id, body)| statements.of((id, body)));
            let sent = self.send(ns, request, some).map_err(|error| error.after(done.modified))?;
            let Some(sent) = sent else { return Ok(()) };
            if sent.unconfirmed.is_some() {
                work.unconfirmed.replace(sent.unconfirmed);
            }
            done.matched += sent.done as u64;
            done.modified += sent.done as u64;
            if sent.has_failed {
                // Where others change many of them, few are sent in vain.
                most = CHUNK.min(2 * sent.done + 8);
                let failed = these.get(place + sent.done).map_or_else(|| id.clone(), |(id, _)| id.clone());
                self.update_one_by_one(work, &[failed], done)?;
                place += 1;
            } else {
                most = CHUNK.min(2 * most);
            }
            place += sent.done;
        }
        Ok(())
    }

    /// Updates these documents, those that still match, each by itself.
    fn update_one_by_one(&self, work: &Work<'_>, these: &[Bson], done: &mut Updated) -> Result<(), StoreError> {
        let Work { ns, request, .. } = *work;
        for id in these {
            check_going_on(done.modified)?;
            let filter =
                doc! { "$and": [beside_ids(request), named::exactly(id, request.modifiers.collation.as_ref())] };
            let find = matching(request, filter, 1);
            let one = self.in_attempts(|_| {
                let Some(found) = with_ids(self.find(ns, &find)?)?.pop() else { return Ok(Some(Updated::default())) };
                let done = self.update_single(work, found)?;
                Ok((done.matched > 0).then_some(done))
            });
            add(done, &one.map_err(|error| error.after(done.modified))?);
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

    /// Updates a document if it still matches, with the metadata where it is predicted that it changes.
    fn update_single(&self, work: &Work<'_>, document: (Bson, RawDocumentBuf)) -> Result<Updated, StoreError> {
        let Work { ns, request, at, .. } = *work;
        let before = vec![document];
        let plain = without_metadata(&request.update, &before, at)?;
        let prediction = predict(&plain, request, work.collation.as_ref(), &before, at);
        match (prediction.and_then(|all| all.first().copied()), before.as_slice()) {
            (Some(Prediction::Moves), _) => Ok(Updated { matched: 1, ..Updated::default() }),
            (Some(Prediction::Changes), [(_, body)]) => {
                let mut asked = among(request, with_updated(&plain, at)?, &before)?;
                let may_be_done = may_be_done_by_others(&plain);
                if may_be_done {
                    let unchanged = as_read(body, &asked)?;
                    asked.filter = doc! { "$and": [asked.filter, unchanged] };
                }
                let done = self.apply(ns, asked)?;
                if may_be_done && done.matched == 0 { self.update_changed_by_others(work, &before) } else { Ok(done) }
            }
            _ => self.update_then_metadata(ns, request, plain, &before, at),
        }
    }

    /// Updates a document that others changed meanwhile, which may have what the update gives already.
    fn update_changed_by_others(&self, work: &Work<'_>, this: &Before) -> Result<Updated, StoreError> {
        let Work { ns, request, at, .. } = *work;
        let this = named::among(&ids(this), request.modifiers.collation.as_ref());
        let filter = doc! { "$and": [beside_ids(request), this] };
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
        before: &[(Bson, RawDocumentBuf)],
        at: DateTime,
    ) -> Result<Updated, StoreError> {
        let ids = ids(before);
        let done = self.apply(ns, among(request, plain, before)?);
        let is_made = done.is_ok();
        let behind = |error| failure::behind_change(ns, is_made, error);
        let changed = match &done {
            Err(StoreError::Unreachable { may_be_done: false, .. }) => return done,
            Ok(done) if done.modified == 0 => return Ok(done.clone()),
            Ok(done) if done.modified == ids.len() as u64 => ids,
            _ => {
                let find = Find { filter: named::among(&ids, None), current: true, ..Find::default() };
                changed(before, self.find(ns, &find).and_then(with_ids).map_err(behind)?)
            }
        };
        let dates = dating(changed, at);
        // The driver retries no update of many documents; the same dates may be set again.
        let is_unconfirmed = matches!(done, Err(StoreError::Unconfirmed { .. }));
        let waited = is_unconfirmed.then(|| self.without_majority());
        let store = waited.as_ref().unwrap_or(self);
        match store.apply(ns, dates.clone()) {
            Err(StoreError::Unreachable { .. }) => store.apply(ns, dates),
            applied => applied,
        }
        .map_err(behind)?;
        done
    }
}

/// The `_id`s of the documents that are not as they were.
fn changed(before: &[(Bson, RawDocumentBuf)], after: Before) -> Vec<Bson> {
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

fn ids(documents: &[(Bson, RawDocumentBuf)]) -> Vec<Bson> {
    documents.iter().map(|(id, _)| id.clone()).collect()
}

fn add(done: &mut Updated, more: &Updated) {
    done.matched += more.matched;
    done.modified += more.modified;
}

/// What the filter asks for beside the `_id`s, where these are named exactly.
fn beside_ids(request: &UpdateRequest) -> Document {
    match request.modifiers.collation {
        None => named::beside_ids(&request.filter),
        Some(_) => request.filter.clone(),
    }
}

/// The request for those of the documents that still match.
fn among(
    request: &UpdateRequest,
    update: UpdateSpec,
    before: &[(Bson, RawDocumentBuf)],
) -> Result<UpdateRequest, QueryError> {
    let these = named::among(&ids(before), request.modifiers.collation.as_ref());
    Ok(UpdateRequest {
        filter: doc! { "$and": [beside_ids(request), these, as_it_was(&request.update, before)?] },
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
pub(super) fn as_it_was(update: &UpdateSpec, before: &[(Bson, RawDocumentBuf)]) -> Result<Document, QueryError> {
    match (update, before) {
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
