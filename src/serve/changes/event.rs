//! A change as MongoDB reports it.

use bson::{Bson, Document, RawDocument, RawDocumentBuf, doc};

use super::difference;
use super::joined::{self, Joined};
use super::spec::{After, Before};
use super::token::{Token, TokenKind};
use crate::query::QueryError;
use crate::serve::access::Metadata;
use crate::serve::clock;
use crate::serve::failure::{Failure, NOT_RESUMABLE, codes};
use crate::store::{Change, ChangeKind, Namespace, metadata};

/// How changes are reported.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shape {
    pub(super) after: After,
    pub(super) before: Before,
    pub(super) metadata: Metadata,
}

impl Shape {
    /// The event of a change; none where the stream does not report it.
    pub(super) fn event(
        &self,
        ns: &Namespace,
        mut change: Change,
        position: i64,
        joined: Option<&Joined>,
    ) -> Result<Option<Document>, Failure> {
        if change.kind == ChangeKind::Rename {
            let mut event = heading(&change, position, joined);
            event.extend(names(change.after.as_deref())?);
            return Ok(Some(event));
        }
        let (Some(before), Some(after)) = (self.shown(change.before.take())?, self.shown(change.after.take())?) else {
            return Ok(None);
        };
        let is_update = change.kind == ChangeKind::Update;
        if self.metadata == Metadata::Hidden && is_update && before == after {
            return Ok(None);
        }
        let mut event = heading(&change, position, joined);
        let has_after = matches!(change.kind, ChangeKind::Insert | ChangeKind::Replace);
        if has_after || (is_update && self.after != After::No) {
            event.insert("fullDocument", checked(&after, self.after == After::Required)?);
        }
        event.insert(
            "ns",
            match change.kind {
                ChangeKind::DropDatabase => doc! { "db": &ns.database },
                _ => doc! { "db": &ns.database, "coll": &ns.collection },
            },
        );
        event.extend(change.id.map(|id| ("documentKey".to_owned(), doc! { "_id": id }.into())));
        if let (true, Some(before), Some(after)) = (is_update, &before, &after) {
            event.insert("updateDescription", difference::describe(before, after));
        }
        let had_before = matches!(change.kind, ChangeKind::Update | ChangeKind::Replace | ChangeKind::Delete);
        if had_before && self.before != Before::No {
            event.insert("fullDocumentBeforeChange", checked(&before, self.before == Before::Required)?);
        }
        Ok(Some(event))
    }

    /// The document as the stream shows it: the outer `None` where it is not shown, the inner where there is none.
    #[expect(clippy::option_option, reason = "a missing document differs from one that is not shown")]
    fn shown(&self, document: Option<RawDocumentBuf>) -> Result<Option<Option<Document>>, Failure> {
        let Some(document) = document else { return Ok(Some(None)) };
        let shown = match self.metadata {
            Metadata::Own => document,
            _ if is_computed(&document)? => return Ok(None),
            Metadata::Shown => document,
            Metadata::Hidden => metadata::hide(document)?,
        };
        Ok(Some(Some(Document::try_from(&*shown)?)))
    }
}

/// What the events of all changes begin with.
fn heading(change: &Change, position: i64, joined: Option<&Joined>) -> Document {
    let mut event = doc! {
        "_id": Token { position, kind: TokenKind::Change }.to_document(),
        "operationType": change.kind.name(),
        "clusterTime": joined::time(change, position, joined),
        "wallTime": change.time,
    };
    event.extend(joined.map(Joined::fields).unwrap_or_default());
    event
}

/// The names of a rename, for streams of either name.
fn names(names: Option<&RawDocument>) -> Result<Document, Failure> {
    let names = names.map(Document::try_from).transpose()?.unwrap_or_default();
    let name = |field: &str| names.get(field).cloned().unwrap_or(Bson::Null);
    let of = |field: &str| doc! { "db": name("db"), "coll": name(field) };
    Ok(doc! { "ns": of("from"), "to": of("to") })
}

/// The end of a stream whose collection is gone.
pub(super) fn invalidate(at: bson::DateTime, position: i64) -> Document {
    doc! {
        "_id": Token { position, kind: TokenKind::End }.to_document(),
        "operationType": "invalidate",
        "clusterTime": clock::of(at, position),
        "wallTime": at,
    }
}

fn checked(image: &Option<Document>, is_required: bool) -> Result<Bson, Failure> {
    match image {
        Some(document) => Ok(document.clone().into()),
        None if is_required => {
            Err(Failure::new(codes::STREAM_FATAL, "an image of the document is required and was not kept")
                .labeled(NOT_RESUMABLE))
        }
        None => Ok(Bson::Null),
    }
}

/// Whether a computable made the document.
fn is_computed(document: &RawDocument) -> Result<bool, QueryError> {
    let info = document.get(metadata::INFO)?.and_then(|info| info.as_document());
    let computed = info.map(|info| info.get("computed")).transpose()?.flatten();
    Ok(computed.and_then(|computed| computed.as_bool()).unwrap_or(false))
}
