//! An open change stream: a position, and how changes behind it are reported. It holds nothing of a thread or a store.

use std::collections::VecDeque;
use std::time::Instant;

use bson::raw::cstr;
use bson::{DateTime, Document, RawArrayBuf, RawDocumentBuf, Timestamp};

use super::event::{Shape, invalidate};
use super::joined::{self, Joined};
use super::scopes::Scopes;
use super::spec::{Spec, Start};
use super::token::{Token, TokenKind};
use crate::memory::Memory;
use crate::query::{Origin, Pipeline, QueryError};
use crate::serve::access::Metadata;
use crate::serve::age::Ages;
use crate::serve::clock;
use crate::serve::failure::{Failure, NOT_RESUMABLE, codes};
use crate::store::{ChangeKind, Events, Kept, MAX_SIZE, Scope};

/// An event that is larger is not sent: a document of 16 MB and what is said about it, as in MongoDB.
const MAX_EVENT: usize = MAX_SIZE + (16 << 10);

/// How many changes are read at once.
const PAGE: usize = 1000;

/// An open change stream.
pub(in crate::serve) struct Stream {
    pub(in crate::serve) used: Instant,
    scope: Scope,
    /// All changes up to here have been looked at.
    position: i64,
    /// Where it begins at a time: changes before that are left out, up to the first at or after it.
    from: Option<Timestamp>,
    shape: Shape,
    stages: Vec<Document>,
    /// What was not sent yet, each with its token.
    pending: VecDeque<(Token, RawDocumentBuf)>,
    token: Token,
    /// The token of the end, where the collection is gone: nothing more comes.
    end: Option<Token>,
}

impl Stream {
    /// Opens a stream; the changes of its scope are being kept.
    ///
    /// # Errors
    /// Where it is to begin with changes that are not kept any more, or a stage is wrong.
    pub(in crate::serve) fn open(
        memory: &Memory,
        spec: Spec,
        kept: Kept,
        (scopes, ages): (&Scopes, &Ages),
        metadata: Metadata,
    ) -> Result<Self, Failure> {
        Pipeline::parse(&spec.stages)?;
        let start = spec.start()?;
        let position = match start {
            Start::Now => kept.last,
            Start::Behind(token) => token.position,
            Start::At(time) => {
                let since = memory.position_at(&spec.scope, clock::date(time))?;
                if !since.is_whole && scopes.may_have_lost(&spec.scope, time, ages) {
                    let message = "changes between that time and now may not have been kept; read the documents anew";
                    return Err(Failure::new(codes::HISTORY_LOST, message).labeled(NOT_RESUMABLE));
                }
                since.position
            }
        };
        let from = match start {
            Start::At(time) => Some(time),
            Start::Now | Start::Behind(_) => None,
        };
        let shape = Shape { after: spec.after, before: spec.before, metadata };
        let mut stream = Self {
            used: Instant::now(),
            scope: spec.scope,
            position,
            from,
            shape,
            stages: spec.stages,
            pending: VecDeque::new(),
            token: Token { position, kind: TokenKind::Between },
            end: None,
        };
        if matches!(start, Start::Behind(Token { kind: TokenKind::Change, .. })) {
            stream.end_behind(memory)?;
        }
        // What is not kept any more is an error now, not later.
        stream.turn(memory)?;
        Ok(stream)
    }

    pub(in crate::serve) fn scope(&self) -> &Scope {
        &self.scope
    }

    /// The next events that are there.
    pub(in crate::serve) fn next(&mut self, memory: &Memory, most: Option<u64>) -> Result<Events, Failure> {
        self.used = Instant::now();
        let (mut events, mut bytes, mut count) = (RawArrayBuf::new(), 0, 0);
        while most.is_none_or(|most| (count as u64) < most) {
            if self.pending.is_empty() && !self.turn(memory)? {
                break;
            }
            let Some((token, event)) = self.pending.pop_front() else { continue };
            let size = event.as_bytes().len() + 16;
            if size > MAX_EVENT {
                let message = format!(
                    "the event has {size} bytes, more than the {MAX_EVENT} of a message; leave documents out of it with $project"
                );
                return Err(Failure::new(codes::TOO_LARGE, message).labeled(NOT_RESUMABLE));
            }
            if count > 0 && bytes + size > MAX_SIZE {
                self.pending.push_front((token, event));
                break;
            }
            events.push(event.as_ref());
            self.token = token;
            (bytes, count) = (bytes + size, count + 1);
        }
        let is_over = self.end.is_some() && self.pending.is_empty();
        if self.pending.is_empty() {
            // Where a stage leaves the end out, the stream is to be gone on with behind it all the same.
            self.token = self.end.unwrap_or(Token { position: self.position, kind: TokenKind::Between });
        }
        Ok(Events { events, count, token: Some(self.token.to_document()), is_over })
    }

    /// Reads the next page of changes; says whether there was one.
    fn turn(&mut self, memory: &Memory) -> Result<bool, Failure> {
        if self.end.is_some() {
            return Ok(false);
        }
        let page = memory.changes(&self.scope, self.position, PAGE)?;
        let is_empty = page.until == self.position;
        let mut events = Vec::new();
        let joined = match page.changes.is_empty() {
            true => Vec::new(),
            false => {
                Joined::between(memory, self.scope.database().unwrap_or("config"), (self.position + 1, page.until))?
            }
        };
        for (ns, change) in page.changes {
            let position = change.position.parse().unwrap_or(page.until);
            let joined = Joined::of(&joined, position);
            let time = joined::time(&change, position, joined);
            if self.from.is_some_and(|from| clock::packed(time) < clock::packed(from)) {
                continue;
            }
            self.from = None;
            let (ends, at) = (is_end(&self.scope, change.kind), change.time);
            if let Some(event) = self.shape.event(&ns, change, position, joined)? {
                events.push((Token { position, kind: TokenKind::Change }, event));
            }
            if ends {
                let end = Token { position, kind: TokenKind::End };
                events.push((end, invalidate(at, position)));
                self.end = Some(end);
                break;
            }
        }
        self.position = page.until;
        for (token, event) in events {
            self.pending.extend(self.through_stages(token, &event)?);
        }
        Ok(!is_empty)
    }

    /// Ends, where the change that the stream is to go on behind has ended it before.
    fn end_behind(&mut self, memory: &Memory) -> Result<(), Failure> {
        // Where the change itself is not kept any more, it is not known; those behind it are there.
        let Ok(page) = memory.changes(&self.scope, self.position - 1, 1) else { return Ok(()) };
        let end = page
            .changes
            .first()
            .filter(|(_, change)| change.position.parse() == Ok(self.position) && is_end(&self.scope, change.kind));
        if let Some((_, change)) = end {
            let token = Token { position: self.position, kind: TokenKind::End };
            let event = invalidate(change.time, self.position);
            self.pending.extend(self.through_stages(token, &event)?);
            self.end = Some(token);
        }
        Ok(())
    }

    fn through_stages(&self, token: Token, event: &Document) -> Result<Option<(Token, RawDocumentBuf)>, Failure> {
        let raw = RawDocumentBuf::try_from(event)?;
        if self.stages.is_empty() {
            return Ok(Some((token, raw)));
        }
        let pipeline = Pipeline::parse(&self.stages)?;
        let none = |_: &Origin, _: Option<&Document>| Ok::<_, QueryError>(None);
        let mut results = pipeline.run(Box::new(std::iter::once(Ok(raw))), DateTime::now(), &none);
        let Some(result) = results.next().transpose()? else { return Ok(None) };
        let wanted = RawDocumentBuf::try_from(&token.to_document())?;
        let id = result.get(cstr!("_id")).ok().flatten().and_then(|id| id.as_document());
        if id.map(bson::RawDocument::as_bytes) != Some(wanted.as_bytes()) {
            let message = "Encountered an event whose _id field, which contains the resume token, was modified by \
                           the pipeline. Modifying the _id field of an event makes it impossible to resume the stream \
                           from that point.";
            return Err(Failure::new(codes::STREAM_FATAL, message).labeled(NOT_RESUMABLE));
        }
        Ok(Some((token, result)))
    }
}

/// Whether a change ends the streams of a scope: the collection or the database is gone.
fn is_end(scope: &Scope, kind: ChangeKind) -> bool {
    match scope {
        Scope::Collection(_) => matches!(kind, ChangeKind::Drop | ChangeKind::Rename),
        Scope::Database(_) => kind == ChangeKind::DropDatabase,
        Scope::All => false,
    }
}
