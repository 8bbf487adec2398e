//! `$changeStream`: what is to be followed, from where, and how it is reported.

use bson::{Bson, Document};

use super::token::{Token, TokenKind};
use crate::query::Pipeline;
use crate::serve::failure::{Failure, codes};
use crate::serve::fields::Fields;
use crate::serve::request::{Request, namespace};
use crate::store::Scope;
use crate::store::namespace::is_internal;

/// The stages that may follow `$changeStream`.
const STAGES: [&str; 9] = [
    "$addFields",
    "$match",
    "$project",
    "$redact",
    "$replaceRoot",
    "$replaceWith",
    "$set",
    "$unset",
    "$changeStreamSplitLargeEvent",
];

/// A change stream as it is asked for.
#[derive(Debug, Clone)]
pub(in crate::serve) struct Spec {
    pub(in crate::serve) scope: Scope,
    /// What is said of the stream, but for the scope.
    pub(super) options: Document,
    pub(super) after: After,
    pub(super) before: Before,
    pub(super) collation: Option<Document>,
    pub(super) variables: Option<Document>,
    /// The stages behind `$changeStream`.
    pub(super) stages: Vec<Document>,
}

/// Where a stream begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Start {
    Now,
    Behind(Token),
    At(bson::Timestamp),
}

/// Whether updates are reported with the document after them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum After {
    No,
    Available,
    Required,
}

/// Whether changes are reported with the document before them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Before {
    No,
    Available,
    Required,
}

impl Spec {
    /// Reads the pipeline of a change stream; none where it is that of something else.
    ///
    /// # Errors
    /// Where an option is wrong, or a stage cannot follow.
    pub(in crate::serve) fn read(request: &Request, stages: &[Document]) -> Result<Option<Self>, Failure> {
        let Some((first, rest)) = stages.split_first() else { return Ok(None) };
        let Some(options) = first.get("$changeStream") else { return Ok(None) };
        let Bson::Document(options) = options else {
            return Err(Failure::new(6_188_500, "$changeStream must take a nested object"));
        };
        let (document, options) = (options, Fields::new("$changeStream", options));
        options.known_inside(&[
            "allChangesForCluster",
            "fullDocument",
            "fullDocumentBeforeChange",
            "resumeAfter",
            "showExpandedEvents",
            "startAfter",
            "startAtOperationTime",
        ])?;
        options.strict_flag("showExpandedEvents")?;
        check_stages(rest)?;
        check_concern(request)?;
        Ok(Some(Self {
            scope: scope(request, options)?,
            options: document.clone(),
            after: after(options)?,
            before: before(options)?,
            collation: request.fields().document("collation")?.cloned(),
            variables: request.fields().document("let")?.cloned(),
            stages: rest.to_vec(),
        }))
    }
}

impl Spec {
    /// Refuses where the stream of a file cannot begin. A MongoDB server has tokens of its own.
    ///
    /// # Errors
    /// Where the token is none of a file, or more than one beginning is named.
    pub(in crate::serve) fn check_start(&self) -> Result<(), Failure> {
        self.start().map(drop)
    }

    /// The same, and where that is.
    pub(super) fn start(&self) -> Result<Start, Failure> {
        start(Fields::new("$changeStream", &self.options))
    }
}

fn check_stages(stages: &[Document]) -> Result<(), Failure> {
    for stage in stages {
        let Some(name) = stage.keys().next() else { continue };
        if name == "$changeStream" {
            return Err(Failure::new(codes::NOT_FIRST, "$changeStream is only valid as the first stage in a pipeline"));
        }
        if name == "$changeStreamSplitLargeEvent" {
            return Err(Failure::unsupported("the stage $changeStreamSplitLargeEvent"));
        }
        if !STAGES.contains(&name.as_str()) {
            // A stage that there is not is another mistake than one that cannot be here.
            if !matches!(name.as_str(), "$out" | "$merge") {
                Pipeline::parse(std::slice::from_ref(stage))?;
            }
            return Err(Failure::new(codes::ILLEGAL, format!("{name} is not permitted in a $changeStream pipeline")));
        }
    }
    Ok(())
}

/// Changes are reported once a majority has them, and not before.
fn check_concern(request: &Request) -> Result<(), Failure> {
    let concern = request.fields().document("readConcern")?;
    match concern.and_then(|concern| concern.get_str("level").ok()) {
        None | Some("majority") => Ok(()),
        Some(level) => {
            let message = format!("$changeStream cannot run with a readConcern other than 'majority', found '{level}'");
            Err(Failure::new(codes::INVALID_OPTIONS, message))
        }
    }
}

fn scope(request: &Request, options: Fields<'_>) -> Result<Scope, Failure> {
    let is_all = options.strict_flag("allChangesForCluster")?;
    match request.target() {
        Some(Bson::String(collection)) if is_all => {
            let message = format!(
                "allChangesForCluster is for `aggregate: 1` on the database admin, not for {}.{collection}",
                request.database
            );
            Err(Failure::new(codes::INVALID_OPTIONS, message))
        }
        _ if !is_all && is_internal(&request.database) => {
            let message = format!("$changeStream may not be opened on the internal {} database", request.database);
            Err(Failure::new(codes::INVALID_NAMESPACE, message))
        }
        Some(Bson::String(collection)) => Ok(Scope::Collection(namespace(&request.database, collection)?)),
        _ if is_all && request.database == "admin" => Ok(Scope::All),
        _ if is_all => Err(Failure::new(codes::INVALID_OPTIONS, "allChangesForCluster is for the database admin")),
        _ => Ok(Scope::Database(namespace(&request.database, "x")?.database)),
    }
}

fn start(options: Fields<'_>) -> Result<Start, Failure> {
    let (resume, after) = (options.document("resumeAfter")?, options.document("startAfter")?);
    let at = match options.document.get("startAtOperationTime") {
        None | Some(Bson::Null) => None,
        Some(Bson::Timestamp(at)) => Some(*at),
        Some(_) => return Err(Failure::new(codes::TYPE_MISMATCH, "startAtOperationTime has to be a timestamp")),
    };
    match (resume, after, at) {
        (None, None, None) => Ok(Start::Now),
        (None, None, Some(at)) => Ok(Start::At(at)),
        (Some(token), None, None) => match Token::read(token)? {
            Token { kind: TokenKind::End, .. } => {
                let message = "Attempting to resume a change stream using 'resumeAfter' is not allowed from an \
                               invalidate notification; use startAfter";
                Err(Failure::new(codes::INVALID_TOKEN, message))
            }
            token => Ok(Start::Behind(token)),
        },
        (None, Some(token), None) => Ok(Start::Behind(Token::read(token)?)),
        _ => {
            let message = "Only one of resumeAfter, startAfter and startAtOperationTime is allowed for $changeStream";
            Err(Failure::new(40_674, message))
        }
    }
}

fn after(options: Fields<'_>) -> Result<After, Failure> {
    match options.text("fullDocument")? {
        None | Some("default") => Ok(After::No),
        Some("updateLookup" | "whenAvailable") => Ok(After::Available),
        Some("required") => Ok(After::Required),
        Some(other) => Err(not_valid("fullDocument", other)),
    }
}

fn before(options: Fields<'_>) -> Result<Before, Failure> {
    match options.text("fullDocumentBeforeChange")? {
        None | Some("off") => Ok(Before::No),
        Some("whenAvailable") => Ok(Before::Available),
        Some("required") => Ok(Before::Required),
        Some(other) => Err(not_valid("fullDocumentBeforeChange", other)),
    }
}

fn not_valid(name: &str, value: &str) -> Failure {
    let message = format!("Enumeration value '{value}' for field '$changeStream.{name}' is not a valid value.");
    Failure::new(codes::BAD_VALUE, message)
}
