//! The changes of a collection: a change stream, which goes on after whatever ends it.
//!
//! Documents before and after a change are the server's images of them. Where it has
//! none (versions before 6, a user without the right to switch them on, the moment after a
//! collection was made anew), the document after an update is looked up, and may be
//! newer than the change; that before is left out.
//!
//! A drop, and a rename, end a stream of the server's; it is opened again behind them. The
//! documents of a collection that was renamed to the watched one are read as they were
//! at that time, and given as inserts.
//!
//! An event with the documents before and after has no room in an answer of the server where they have about 8 MB each: it is
//! asked for again without them.

use std::time::{Duration, Instant};

use bson::{Bson, DateTime, Document, RawDocumentBuf, Timestamp, doc};
use mongodb::change_stream::event::{ChangeStreamEvent, OperationType, ResumeToken, UpdateDescription};
use mongodb::options::{FullDocumentBeforeChangeType, FullDocumentType};
use mongodb::sync::{ChangeStream, Cursor};

use super::position::{self, Position, time_of};
use super::{MongoDb, failure};
use crate::query::QueryError;
use crate::store::metadata::{INFO, INSERTED, UPDATED};
use crate::store::{Change, ChangeKind, Changes, Namespace, Next, StoreError};

/// How long the server waits for changes before it returns none, at most …
const MAX_AWAIT_TIME: Duration = Duration::from_millis(200);
/// … and where the caller does not wait: several streams are asked in turn, or keys are waited for.
const MIN_AWAIT_TIME: Duration = Duration::from_millis(10);
/// A description of what an update changed that has so many bytes is left out of an event that is too large.
const LARGE_DESCRIPTION: i32 = 1 << 20;

type Event = ChangeStreamEvent<RawDocumentBuf>;

/// How much the server is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Extent {
    /// The next events, with the documents before and after.
    Whole,
    /// One of these at a time: some event is too large, and those before it are not.
    Single,
    /// One event without documents, but for their metadata.
    Bare,
}

/// The changes of a collection.
pub(super) struct Stream<'a> {
    store: &'a MongoDb,
    namespace: Namespace,
    position: Option<Position>,
    images: bool,
    /// Whether it is for the history: that is told of the second step of an update, too, and has no document looked up that
    /// may be newer than a change.
    is_of_history: bool,
    extent: Extent,
    /// The second step of an update that was met last, for the history.
    date: Option<Change>,
    /// Whether the collection may be another than the one that keeps images.
    renewed: bool,
    stream: Option<ChangeStream<Event>>,
    /// How long the server waits in this stream.
    await_time: Duration,
    /// Where to open the stream again.
    token: Option<ResumeToken>,
    /// How far everything was given.
    given: Option<ResumeToken>,
    /// Since when, where the stream has no token.
    since: Option<Timestamp>,
    /// Whether nothing was given by its name before.
    is_new: bool,
    /// Up to which time of the server everything was given, where it said so last.
    reached: Option<Timestamp>,
    copy: Option<Copy>,
}

/// The documents that a rename brought, which are being given.
struct Copy {
    documents: Cursor<Document>,
    time: DateTime,
    position: String,
    count: u64,
}

impl MongoDb {
    pub(super) fn follow(&self, ns: &Namespace, name: Option<&str>) -> Result<Box<dyn Changes + '_>, StoreError> {
        Ok(Box::new(self.stream(ns, name, None, false)?))
    }

    /// The changes of a collection for its history, behind what was recorded by this name; where that is none, from a time of
    /// the server on.
    pub(super) fn follow_for_history(
        &self,
        ns: &Namespace,
        name: &str,
        since: Option<Timestamp>,
    ) -> Result<Stream<'_>, StoreError> {
        self.stream(ns, Some(name), since, true)
    }

    fn stream(
        &self,
        ns: &Namespace,
        name: Option<&str>,
        since: Option<Timestamp>,
        is_of_history: bool,
    ) -> Result<Stream<'_>, StoreError> {
        if ns.collection == position::COLLECTION {
            let reason = format!("{ns} holds how far watches are, and cannot be watched itself");
            return Err(StoreError::Unfit { address: self.address.clone(), reason });
        }
        let server = self.examine()?;
        let (position, token) = match name.map(|name| Position::take(self, ns, name)).transpose()? {
            Some((position, token)) => (Some(position), token),
            None => (None, None),
        };
        let mut stream = Stream {
            store: self,
            namespace: ns.clone(),
            position,
            images: server.images,
            is_of_history,
            extent: Extent::Whole,
            date: None,
            renewed: false,
            stream: None,
            await_time: MAX_AWAIT_TIME,
            since,
            is_new: token.is_none(),
            token,
            given: None,
            reached: None,
            copy: None,
        };
        if server.images {
            // A watch that goes on has seen its collection: where it is missing now, it was dropped.
            self.keep_images(ns, stream.is_new)?;
        }
        match stream.open() {
            Err(error) if is_too_large(&error) => stream.extent = Extent::Single,
            opened => opened.map_err(|error| stream.explain(&error))?,
        }
        stream.given.clone_from(&stream.token);
        stream.done()?;
        Ok(stream)
    }
}

impl Stream<'_> {
    /// Opens the stream of the server, behind what was given.
    fn open(&mut self) -> mongodb::error::Result<()> {
        let collection = self.store.collection(&self.namespace);
        let mut action = collection.watch().max_await_time(self.await_time);
        action = match self.images {
            true => action
                .full_document(FullDocumentType::WhenAvailable)
                .full_document_before_change(FullDocumentBeforeChangeType::WhenAvailable),
            false => action.full_document(FullDocumentType::UpdateLookup),
        };
        match (self.token.clone(), self.since) {
            (Some(token), _) => action = action.start_after(token),
            (None, Some(since)) => action = action.start_at_operation_time(since),
            (None, None) => {}
        }
        if self.extent != Extent::Whole {
            action = action.batch_size(1);
        }
        if self.extent == Extent::Bare {
            action = action.pipeline(bare());
        }
        let stream = action.run()?;
        if self.token.is_none() {
            self.token = stream.resume_token();
        }
        self.stream = Some(stream);
        Ok(())
    }

    /// Opens the stream anew where the server would wait for longer than the caller.
    fn wait_at_most(&mut self, timeout: Duration) {
        let await_time = timeout.clamp(MIN_AWAIT_TIME, MAX_AWAIT_TIME);
        if await_time < self.await_time {
            self.await_time = await_time;
            self.stream = None;
        }
    }

    /// Asks for less of the events that come, where that can be.
    fn ask_for_less(&mut self) -> bool {
        self.extent = match self.extent {
            Extent::Whole => Extent::Single,
            Extent::Single => Extent::Bare,
            Extent::Bare => return false,
        };
        self.stream = None;
        true
    }

    /// The second step of an update, where that was what came: the document with its date.
    pub(super) fn take_date(&mut self) -> Option<Change> {
        self.date.take()
    }

    /// Whether nothing was given by the name of the stream before it was opened.
    pub(super) fn is_new(&self) -> bool {
        self.is_new
    }

    /// Up to which time of the server everything was given; nothing where it did not say so.
    pub(super) fn reached(&self) -> Option<Timestamp> {
        self.reached
    }

    /// One look at the stream: an event, or nothing for now.
    fn look(&mut self) -> mongodb::error::Result<Option<Event>> {
        if self.stream.is_none() {
            self.open()?;
        }
        let Some(stream) = &mut self.stream else { return Ok(None) };
        let event = stream.next_if_any()?;
        match &event {
            Some(event) => self.token = Some(event.id.clone()),
            None => {
                self.token = stream.resume_token().or_else(|| self.token.take());
                if !stream.is_alive() {
                    self.stream = None;
                }
                if self.extent == Extent::Single {
                    (self.extent, self.stream) = (Extent::Whole, None);
                }
            }
        }
        Ok(event)
    }

    /// The change that an event of the server is, for a watcher.
    fn understand(&mut self, mut event: Event) -> Result<Option<Change>, StoreError> {
        let is_date = event.operation_type == OperationType::Update && is_metadata(event.update_description.as_ref());
        let is_bare = self.extent == Extent::Bare;
        if is_bare && !self.is_of_history {
            event.full_document = None;
        }
        let kind = match &event.operation_type {
            OperationType::Insert => ChangeKind::Insert,
            OperationType::Update if is_date && !self.is_of_history => return Ok(None),
            OperationType::Update => ChangeKind::Update,
            OperationType::Replace => ChangeKind::Replace,
            OperationType::Delete => ChangeKind::Delete,
            OperationType::Drop | OperationType::Rename => ChangeKind::Drop,
            OperationType::Invalidate => {
                self.stream = None;
                self.renewed = true;
                return Ok(None);
            }
            _ => return Ok(None),
        };
        let position = name(&event.id);
        let time = event.wall_time.unwrap_or_else(|| date(event.cluster_time));
        if event.operation_type == OperationType::Rename && self.is_target(&event) {
            self.copy = Some(self.copy(event.cluster_time, time, &position)?);
            if self.images {
                self.store.keep_images(&self.namespace, false)?;
            }
        }
        if kind == ChangeKind::Insert && self.images && std::mem::take(&mut self.renewed) {
            self.store.keep_images(&self.namespace, false)?;
        }
        let id = event.document_key.as_ref().and_then(|key| key.get("_id")).cloned();
        let looks_up = match kind {
            ChangeKind::Update => !is_bare || !self.is_of_history,
            ChangeKind::Insert | ChangeKind::Replace => is_bare && !self.is_of_history,
            _ => false,
        };
        let after = match (kind, event.full_document, &id) {
            (_, None, Some(id)) if looks_up => match self.look_up(id)? {
                // The document was removed meanwhile; that is the next event.
                None => return Ok(None),
                found => found,
            },
            (ChangeKind::Delete | ChangeKind::Drop, ..) => None,
            (_, after, _) => after,
        };
        let change = Change { kind, id, before: event.full_document_before_change, after, time, position };
        if is_date {
            self.date = Some(change);
            return Ok(None);
        }
        Ok(Some(change))
    }

    fn is_target(&self, event: &Event) -> bool {
        let target = |to: &mongodb::change_stream::event::ChangeNamespace| {
            to.db == self.namespace.database && to.coll.as_deref() == Some(&self.namespace.collection)
        };
        event.to.as_ref().is_some_and(target)
    }

    /// The documents of the collection as they were at a time, or where the server does
    /// not remember so far back, as they are.
    fn copy(&self, at: Option<Timestamp>, time: DateTime, position: &str) -> Result<Copy, StoreError> {
        let database = self.store.client().database(&self.namespace.database);
        let find = |concern: Document| {
            let command = doc! { "find": &self.namespace.collection, "readConcern": concern };
            database.run_cursor_command(command).run()
        };
        let snapshot = at.map(|at| find(doc! { "level": "snapshot", "atClusterTime": at }));
        let documents = match snapshot {
            Some(Ok(documents)) => documents,
            Some(Err(error)) if failure::code(&error).is_none() => return Err(self.store.explain(&error)),
            _ => find(doc! { "level": "majority" }).map_err(|e| self.store.explain(&e))?,
        };
        Ok(Copy { documents, time, position: position.to_owned(), count: 0 })
    }

    /// The next of the documents that a rename brought.
    fn copied(&mut self) -> Result<Option<Change>, StoreError> {
        let Some(copy) = &mut self.copy else { return Ok(None) };
        let Some(document) = copy.documents.next() else {
            self.copy = None;
            self.given.clone_from(&self.token);
            return Ok(None);
        };
        let document = document.map_err(|e| self.store.explain(&e))?;
        copy.count += 1;
        Ok(Some(Change {
            kind: ChangeKind::Insert,
            id: document.get("_id").cloned(),
            before: None,
            after: Some(RawDocumentBuf::try_from(&document).map_err(QueryError::from)?),
            time: copy.time,
            position: format!("{}+{}", copy.position, copy.count),
        }))
    }

    fn look_up(&self, id: &Bson) -> Result<Option<RawDocumentBuf>, StoreError> {
        let filter = doc! { "_id": { "$eq": id } };
        self.store
            .on_primary::<RawDocumentBuf>(&self.namespace)
            .find_one(filter)
            .run()
            .map_err(|e| self.store.explain(&e))
    }

    fn explain(&self, error: &mongodb::error::Error) -> StoreError {
        let forget = match &self.position {
            Some(position) => format!(
                ", and forget the name with `rmem watch {} --resume {} --forget`",
                self.namespace,
                position.name()
            ),
            None => String::new(),
        };
        match failure::code(error) {
            Some(failure::NO_STREAMS) => self.store.fail(failure::STANDALONE),
            Some(code) if failure::HISTORY_LOST.contains(&code) => self.store.fail(&format!(
                "the server's oplog does not reach back to what was seen last of {ns}, so changes are missing; read \
                 {ns} anew{forget}, and let the oplog be larger",
                ns = self.namespace
            )),
            _ => self.store.explain(error),
        }
    }

    /// The next change, where there is one by now.
    fn step(&mut self) -> Result<Step, StoreError> {
        if let Some(change) = self.copied()? {
            return Ok(Step::Change(change));
        }
        let event = loop {
            match self.look() {
                Ok(event) => break event,
                Err(error) if is_too_large(&error) && self.ask_for_less() => {}
                Err(error) if failure::is_passing(&error) => {
                    self.stream = None;
                    return Ok(Step::Lost(self.store.explain(&error)));
                }
                Err(error) => return Err(self.explain(&error)),
            }
        };
        let Some(event) = event else {
            self.given.clone_from(&self.token);
            self.reached = self.token.as_ref().and_then(|token| time_of(&name(token)));
            return Ok(Step::Nothing);
        };
        let before = self.given.clone();
        match self.understand(event) {
            Ok(change) => {
                if self.extent == Extent::Bare {
                    (self.extent, self.stream) = (Extent::Whole, None);
                }
                if self.copy.is_none() {
                    self.given.clone_from(&self.token);
                }
                Ok(change.map_or(Step::Passed, Step::Change))
            }
            // To look at the event again, one goes back behind the one before it.
            Err(error @ StoreError::Unreachable { .. }) => {
                (self.stream, self.copy) = (None, None);
                self.token = before;
                Ok(Step::Lost(error))
            }
            Err(error) => Err(error),
        }
    }
}

/// What one look at the stream gave.
enum Step {
    Change(Change),
    /// An event that is no change for a watcher.
    Passed,
    Nothing,
    Lost(StoreError),
}

impl Changes for Stream<'_> {
    fn next(&mut self, timeout: Duration) -> Result<Next, StoreError> {
        let start = Instant::now();
        self.renew()?;
        self.wait_at_most(timeout);
        loop {
            match self.step()? {
                Step::Change(change) => return Ok(Next::Change(Box::new(change))),
                Step::Lost(error) => return Ok(Next::Interrupted(error)),
                Step::Passed if self.date.is_some() => return Ok(Next::Nothing),
                Step::Nothing | Step::Passed if start.elapsed() >= timeout => return Ok(Next::Nothing),
                Step::Nothing | Step::Passed => {}
            }
        }
    }

    fn done(&mut self) -> Result<(), StoreError> {
        let (Some(position), Some(given)) = (&mut self.position, &self.given) else { return Ok(()) };
        passing(position.keep(self.store, given))
    }

    fn renew(&mut self) -> Result<(), StoreError> {
        self.position.as_mut().map_or(Ok(()), |position| passing(position.renew(self.store)))
    }
}

/// What cannot be written while the server is away is written later.
fn passing(written: Result<(), StoreError>) -> Result<(), StoreError> {
    match written {
        Err(StoreError::Unreachable { .. } | StoreError::Unconfirmed { .. } | StoreError::Failed { .. }) => Ok(()),
        written => written,
    }
}

impl Drop for Stream<'_> {
    fn drop(&mut self) {
        if let Some(position) = &self.position {
            position.release();
        }
    }
}

/// Whether an event has no room in an answer of the server.
fn is_too_large(error: &mongodb::error::Error) -> bool {
    failure::code(error) == Some(failure::TOO_LARGE)
}

/// The stages that leave documents out of an event, but for their metadata, and what an update changed where that is large.
fn bare() -> [Document; 2] {
    let info = format!("$fullDocument.{INFO}");
    let is_there = doc! { "$eq": [{ "$type": "$fullDocument" }, "object"] };
    let is_small = doc! { "$lt": [{ "$bsonSize": "$updateDescription" }, LARGE_DESCRIPTION] };
    let only = |condition: Document, value: Bson| doc! { "$cond": [condition, value, "$$REMOVE"] };
    [
        doc! { "$unset": "fullDocumentBeforeChange" },
        doc! { "$set": {
            "fullDocument": only(is_there, doc! { INFO: info }.into()),
            "updateDescription": only(is_small, "$updateDescription".into()),
        } },
    ]
}

/// Whether an update changed nothing but when a document was stored or changed: the
/// second step of rmem's own updates.
fn is_metadata(update: Option<&UpdateDescription>) -> bool {
    let Some(update) = update else { return false };
    let is_date = |path: &str| {
        path.strip_prefix(INFO)
            .and_then(|rest| rest.strip_prefix('.'))
            .is_some_and(|key| [INSERTED, UPDATED].contains(&key))
    };
    let is_dates = |value: &Bson| {
        value.as_document().is_some_and(|info| info.keys().all(|key| [INSERTED, UPDATED].contains(&key.as_str())))
    };
    !update.updated_fields.is_empty()
        && update.removed_fields.is_empty()
        && update.truncated_arrays.as_ref().is_none_or(Vec::is_empty)
        && update.updated_fields.iter().all(|(path, value)| is_date(path) || (path == INFO && is_dates(value)))
}

/// What a token is called: its text, where it has one.
fn name(token: &ResumeToken) -> String {
    let token = bson::serialize_to_bson(token).unwrap_or(Bson::Null);
    let text = token.as_document().and_then(|token| token.get_str("_data").ok());
    text.map_or_else(|| token.to_string(), str::to_owned)
}

fn date(time: Option<Timestamp>) -> DateTime {
    time.map_or_else(DateTime::now, |time| DateTime::from_millis(i64::from(time.time) * 1_000))
}
