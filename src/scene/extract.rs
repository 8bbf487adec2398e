//! Documents into a scene.
//!
//! A document is an object where it has `translation` or `geometry`; a frame (`parent` without `geometry`) is
//! none. Its pose is resolved into the scene's frame through the tree of frames. What is no valid object
//! is told apart, with the reason, so that the caller can refuse the whole or leave it out.

use std::collections::HashMap;
use std::collections::HashSet;
use std::fmt;

use bson::{Bson, Document, RawDocument};

use super::kind::{Kinds, NAME, ObjectKind};
use crate::formats::scene::{Object, Pose, Scene, document};
use crate::formats::shell;
use crate::memory::Memory;
use crate::memory::frames::{Frames, WayError};
use crate::query::QueryError;
use crate::store::{Find, Namespace, StoreError};

/// Which documents are looked at.
#[derive(Debug, Clone)]
pub struct Sources<'a> {
    /// Collections with queries.
    pub queries: Vec<(Namespace, Document)>,
    /// Kinds of objects by configuration.
    pub kinds: &'a [ObjectKind],
}

/// An object with the document that it is from.
#[derive(Debug, Clone, PartialEq)]
pub struct Located {
    /// The object, its pose in the scene's frame.
    pub object: Object,
    /// Where its document is.
    pub namespace: Namespace,
    /// The document's `_id`.
    pub id: Bson,
    /// The document's own frame.
    pub frame: String,
    /// The key that names it.
    pub name_key: String,
    /// Its pose in its own frame.
    pub own: Pose,
}

/// A document that should be an object and is none.
#[derive(Debug, Clone, PartialEq)]
pub struct Invalid {
    /// Where it is.
    pub namespace: Namespace,
    /// Its `_id`.
    pub id: Bson,
    /// What is wrong.
    pub reason: Reason,
}

/// Why a document is no object.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Reason {
    /// Its pose in the scene's frame is not known.
    #[error(transparent)]
    Frame(#[from] WayError),
    /// Something else is wrong with it.
    #[error("{0}")]
    Content(String),
}

impl From<String> for Reason {
    fn from(message: String) -> Self {
        Self::Content(message)
    }
}

impl Invalid {
    /// That an object has the name of another.
    #[must_use]
    pub fn twice(located: Located) -> Self {
        let reason = format!("there is another object with the name `{}`", located.object.name);
        Self { namespace: located.namespace, id: located.id, reason: reason.into() }
    }
}

impl fmt::Display for Invalid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "the document of {} with _id {} is not an object of a scene: {}",
            self.namespace,
            shell::relaxed_value(&self.id),
            self.reason
        )
    }
}

/// What was found.
#[derive(Debug, Clone, Default)]
pub struct Extraction {
    /// Objects, in the order in which they were found.
    pub objects: Vec<Located>,
    /// What is none.
    pub invalid: Vec<Invalid>,
}

impl Extraction {
    /// The scene, without where its objects are from.
    #[must_use]
    pub fn scene(&self, frame: &str) -> Scene {
        let objects = self.objects.iter().map(|located| located.object.clone()).collect();
        Scene { name: None, frame: Some(frame.to_owned()), objects, ..Scene::default() }
    }

    /// Whether there is no object, and nothing but that a frame is not known keeps documents from being one.
    #[must_use]
    pub fn is_nothing_for_want_of(&self, frame: &str) -> bool {
        let is_want = |invalid: &Invalid| matches!(&invalid.reason, Reason::Frame(WayError::Unknown { frame: unknown, .. }) if unknown == frame);
        self.objects.is_empty() && self.invalid.iter().all(is_want)
    }

    /// The objects by name.
    #[must_use]
    pub fn by_name(&self) -> HashMap<&str, &Located> {
        self.objects.iter().map(|located| (located.object.name.as_str(), located)).collect()
    }
}

/// How documents are read: those that computables made are objects like any other, or none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reading {
    /// All documents; computables run.
    All,
    /// Only what is stored, to write back to.
    Stored,
}

/// Reads the documents that `sources` name, with poses in `frame`.
///
/// # Errors
/// Where a store fails or a query is wrong; what is wrong with a single document is part of the result.
pub fn extract(
    memory: &Memory,
    sources: &Sources<'_>,
    frames: &Frames,
    frame: &str,
    reading: Reading,
) -> Result<Extraction, StoreError> {
    let mut extraction = Extraction::default();
    let mut names: HashSet<String> = HashSet::new();
    let mut ways = Ways::new(frames, frame);
    let is_single = sources.queries.len() == 1;
    let mut seen: HashSet<(Namespace, String)> = HashSet::new();
    for (namespace, filter) in &sources.queries {
        let kinds = Kinds::of(sources.kinds, namespace)?;
        let find = Find { filter: filter.clone(), ..Find::default() };
        let documents = match reading {
            Reading::All => memory.find(namespace, &find)?,
            Reading::Stored => memory.stored(namespace, &find)?,
        };
        for raw in documents {
            let raw = raw?;
            let Some(found) = locate(&raw, namespace, &kinds, &mut ways)? else { continue };
            let id = match &found {
                Ok(located) => &located.id,
                Err(invalid) => &invalid.id,
            };
            // A document may be of two kinds; the first counts.
            if !is_single && !seen.insert((namespace.clone(), shell::canonical_value(id))) {
                continue;
            }
            match found {
                Err(invalid) => extraction.invalid.push(invalid),
                Ok(located) if names.contains(&located.object.name) => extraction.invalid.push(Invalid::twice(located)),
                Ok(located) => {
                    names.insert(located.object.name.clone());
                    extraction.objects.push(located);
                }
            }
        }
    }
    Ok(extraction)
}

/// The ways from frames to the scene's, each found once.
pub struct Ways<'a> {
    frames: &'a Frames,
    frame: &'a str,
    known: HashMap<String, Result<Pose, WayError>>,
}

impl<'a> Ways<'a> {
    /// Ways to `frame`. To a frame without a name there is no way to go: poses stay as they are.
    #[must_use]
    pub fn new(frames: &'a Frames, frame: &'a str) -> Self {
        Self { frames, frame, known: HashMap::new() }
    }

    /// The pose of a frame in the scene's.
    ///
    /// # Errors
    /// Where there is no way.
    pub fn from(&mut self, frame: &str) -> Result<Pose, WayError> {
        if self.frame.is_empty() {
            return Ok(Pose::IDENTITY);
        }
        if let Some(known) = self.known.get(frame) {
            return known.clone();
        }
        let way = self.frames.way(frame, self.frame);
        self.known.insert(frame.to_owned(), way.clone());
        way
    }
}

/// Reads one document; `None` where it is not meant as an object.
///
/// # Errors
/// Where the document is malformed; what is wrong with it as an object is the inner result.
pub fn locate(
    raw: &RawDocument,
    namespace: &Namespace,
    kinds: &Kinds<'_>,
    ways: &mut Ways<'_>,
) -> Result<Option<Result<Located, Invalid>>, QueryError> {
    let has = |key: &str| raw.get(key).map(|value| value.is_some());
    let has_geometry = has("geometry")?;
    if !has_geometry && (!has("translation")? || has("parent")?) {
        return Ok(None);
    }
    let kind = kinds.find(raw)?;
    let document = Document::try_from(raw)?;
    let id = document.get("_id").cloned().unwrap_or(Bson::Null);
    let found = object(&document, kind, ways);
    Ok(Some(match found {
        Ok((object, frame, own)) => Ok(Located {
            object,
            namespace: namespace.clone(),
            id,
            frame,
            own,
            name_key: kind.map_or(NAME, |kind| &kind.name_key).to_owned(),
        }),
        Err(reason) => Err(Invalid { namespace: namespace.clone(), id, reason }),
    }))
}

/// The object with its pose in the scene's frame, its own frame, and its pose there.
fn object(
    document: &Document,
    kind: Option<&ObjectKind>,
    ways: &mut Ways<'_>,
) -> Result<(Object, String, Pose), Reason> {
    let key = kind.map_or(NAME, |kind| &kind.name_key);
    let name = match document.get(key) {
        Some(Bson::String(name)) if !name.is_empty() => name.clone(),
        Some(other) => return Err(format!("its `{key}` is {other}; expected a name as text").into()),
        None => {
            let wanted = "expected a name, or `name_key` of a [[scene.object]] in rmem.toml";
            return Err(format!("it has no `{key}`; {wanted}").into());
        }
    };
    let frame = match document.get("frame") {
        Some(Bson::String(frame)) => frame.clone(),
        Some(other) => return Err(format!("its `frame` is {other}; expected the name of a frame").into()),
        None => return Err("it has no `frame`".to_owned().into()),
    };
    let mut object = Object { name, ..document::read(document)? };
    if let Some(kind) = kind {
        kind.complete(&mut object);
    }
    let own = object.pose;
    object.pose = ways.from(&frame)?.around(&own);
    Ok((object, frame, own))
}
