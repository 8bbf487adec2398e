//! A body that gives poses in another frame.
//!
//! Asked for `{frame: TARGET, allow_tf: true, …}`, it takes the documents with
//! `frame`, `translation` (x, y, z) and `rotation` (x, y, z, w) that match the
//! rest of the query, and gives each with its pose in the frame TARGET, with
//! `allow_tf: true`, so that the query matches it. What the query says of poses
//! is meant in the target frame, and so is no part of that rest.
//!
//! The tree of frames are documents `{frame, parent, translation, rotation}`:
//! the pose of `frame` in `parent`. A frame without such a document is a root.

use std::collections::HashMap;

use bson::{Bson, Document, doc};

use super::body::{Asked, Body, Builtin, ComputeError, Options, Source, WrongOption};
use crate::formats::scene::Pose;
use crate::formats::scene::document::pose;
use crate::formats::shell;
use crate::memory::frames::Frames;
use crate::store::{Find, Namespace, NamespaceError, StoreError};

/// The keys of the query that are not about the documents as they are.
const OWN: [&str; 4] = ["frame", "allow_tf", "translation", "rotation"];

/// The builtin body. `frames` is the namespace of the tree of frames (default: the collection
/// `frames` of the computable's database).
pub(super) const BUILTIN: Builtin = Builtin { name: "transform", keys: &["frames"], make };

fn make(options: &Options, ns: &Namespace) -> Result<Box<dyn Body>, WrongOption> {
    let frames = match options.get("frames") {
        Some(name) => name.parse().map_err(|error: NamespaceError| ("frames", error.to_string()))?,
        None => Namespace { database: ns.database.clone(), collection: "frames".to_owned() },
    };
    Ok(Box::new(Transform { frames }))
}

/// Poses in another frame.
struct Transform {
    frames: Namespace,
}

impl Body for Transform {
    fn compute(&self, asked: &Asked<'_>) -> Result<Vec<Document>, ComputeError> {
        let Some(Bson::String(target)) = asked.query.get("frame") else {
            let wanted = "it needs one frame to transform into, like {frame: 'map', allow_tf: true}";
            return Err(ComputeError::wrong(wanted));
        };
        let mut filter = doc! {
            "$nor": [{ "allow_tf": true }],
            "frame": { "$type": "string" },
            "translation": { "$exists": true },
            "rotation": { "$exists": true },
        };
        let rest = asked.query.iter().filter(|(key, _)| !is_own(key));
        filter.extend(rest.map(|(key, value)| (key.clone(), value.clone())));
        let documents = found(asked.memory, asked.namespace, filter)?;
        let frames = Frames::read(&self.frames, |find| asked.memory.find(&self.frames, find))?;
        let mut ways = HashMap::new();
        documents.into_iter().map(|document| transform(&frames, document, target, &mut ways)).collect()
    }

    fn sources(&self, asked: &Namespace) -> Vec<Namespace> {
        vec![asked.clone(), self.frames.clone()]
    }

    fn describe(&self) -> String {
        format!("transform, with the frames of {}", self.frames)
    }
}

/// Whether a key of the query is not about the documents as they are: one of poses, or an
/// operator, which may have such keys in it.
fn is_own(key: &str) -> bool {
    key.starts_with('$') || key.split('.').next().is_some_and(|first| OWN.contains(&first))
}

fn found(memory: &dyn Source, ns: &Namespace, filter: Document) -> Result<Vec<Document>, StoreError> {
    let found = memory.find(ns, &Find { filter, ..Find::default() })?;
    found.map(|document| Ok(Document::try_from(&*document?).map_err(crate::query::QueryError::from)?)).collect()
}

/// The document with its pose in the frame `target`; `ways` are those that were found before.
fn transform(
    frames: &Frames,
    mut document: Document,
    target: &str,
    ways: &mut HashMap<String, Pose>,
) -> Result<Document, ComputeError> {
    let id = document.remove("_id");
    let frame = document.get_str("frame").unwrap_or_default().to_owned();
    if frame != target {
        let wrong = |wrong: String| {
            let id = id.as_ref().map(shell::relaxed_value).unwrap_or_default();
            ComputeError::wrong(format!("the document with _id {id} cannot be transformed: {wrong}"))
        };
        let way = match ways.get(&frame) {
            Some(way) => *way,
            None => {
                let way = frames.way(&frame, target).map_err(|error| wrong(error.to_string()))?;
                ways.insert(frame, way);
                way
            }
        };
        let pose = way.around(&pose(&document).map_err(wrong)?);
        document.insert("frame", target);
        document.insert("translation", pose.translation.to_vec());
        document.insert("rotation", pose.rotation.to_vec());
    }
    document.insert("allow_tf", true);
    Ok(document)
}
