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
use super::pose::Pose;
use crate::formats::shell;
use crate::store::{Find, Namespace, StoreError};

/// The keys of the query that are not about the documents as they are.
const OWN: [&str; 4] = ["frame", "allow_tf", "translation", "rotation"];

/// The builtin body. `frames` is the namespace of the tree of frames (default: the collection
/// `frames` of the computable's database).
pub(super) const BUILTIN: Builtin = Builtin { name: "transform", keys: &["frames"], make };

fn make(options: &Options, ns: &Namespace) -> Result<Box<dyn Body>, WrongOption> {
    let frames = match options.get("frames") {
        Some(name) => Namespace::parse(name).map_err(|error| ("frames", error.to_string()))?,
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
        let tree = Tree::read(asked.memory, &self.frames)?;
        let mut ways = HashMap::new();
        documents.into_iter().map(|document| tree.transform(document, target, &mut ways)).collect()
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

/// The tree of frames: each with its parent, and its pose there.
struct Tree<'a> {
    place: &'a Namespace,
    frames: HashMap<String, (String, Pose)>,
}

/// A frame and those around it, each with the pose of the first in it.
type Ancestors<'a> = Vec<(&'a str, Pose)>;

impl<'a> Tree<'a> {
    fn read(memory: &dyn Source, place: &'a Namespace) -> Result<Self, ComputeError> {
        let mut frames = HashMap::new();
        for document in found(memory, place, doc! { "parent": { "$type": "string" }, "frame": { "$type": "string" } })?
        {
            let (Ok(frame), Ok(parent)) = (document.get_str("frame"), document.get_str("parent")) else { continue };
            let pose = Pose::of(&document)
                .map_err(|wrong| ComputeError::wrong(format!("the frame `{frame}` of {place} has no pose: {wrong}")))?;
            if frames.insert(frame.to_owned(), (parent.to_owned(), pose)).is_some() {
                return Err(ComputeError::wrong(format!(
                    "the frame `{frame}` is in {place} twice; a frame has one parent"
                )));
            }
        }
        Ok(Self { place, frames })
    }

    fn transform(
        &self,
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
                    let way = self.way(&frame, target).map_err(wrong)?;
                    ways.insert(frame, way);
                    way
                }
            };
            let pose = way.around(&Pose::of(&document).map_err(wrong)?);
            document.insert("frame", target);
            document.insert("translation", pose.translation.to_vec());
            document.insert("rotation", pose.rotation.to_vec());
        }
        document.insert("allow_tf", true);
        Ok(document)
    }

    /// The pose of a frame in another.
    fn way(&self, from: &str, to: &str) -> Result<Pose, String> {
        let (around_from, around_to) = (self.ancestors(from)?, self.ancestors(to)?);
        for (frame, pose) in &around_from {
            if let Some((_, other)) = around_to.iter().find(|(other, _)| other == frame) {
                return Ok(other.inverse().around(pose));
            }
        }
        let unknown = [from, to].into_iter().find(|frame| !self.knows(frame));
        Err(match unknown {
            Some(frame) => format!("the frame `{frame}` is not known; {}", self.known()),
            None => format!("no way leads from the frame `{from}` to `{to}` in {}", self.place),
        })
    }

    /// The frame and those around it, up to the root.
    fn ancestors<'b>(&'b self, frame: &'b str) -> Result<Ancestors<'b>, String> {
        let mut ancestors: Ancestors<'b> = vec![(frame, Pose::IDENTITY)];
        while let Some((last, pose)) = ancestors.last()
            && let Some((parent, own)) = self.frames.get(*last)
        {
            let next = (parent.as_str(), own.around(pose));
            if let Some(start) = ancestors.iter().position(|(frame, _)| *frame == next.0) {
                let cycle: Vec<&str> = ancestors.iter().skip(start).map(|(frame, _)| *frame).chain([next.0]).collect();
                return Err(format!("the frames of {} are no tree: {}", self.place, cycle.join(" → ")));
            }
            ancestors.push(next);
        }
        Ok(ancestors)
    }

    fn knows(&self, frame: &str) -> bool {
        self.frames.iter().any(|(known, (parent, _))| known == frame || parent == frame)
    }

    /// What there is, for messages.
    fn known(&self) -> String {
        let mut known: Vec<&str> =
            self.frames.iter().flat_map(|(frame, (parent, _))| [frame.as_str(), parent]).collect();
        known.sort_unstable();
        known.dedup();
        match known.as_slice() {
            [] => format!("{} has no documents {{frame, parent, translation, rotation}}", self.place),
            some => format!("{} has {}", self.place, some.join(", ")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tree(frames: &[(&str, &str, Pose)], place: &'static str) -> Result<Pose, String> {
        let ns = Namespace::parse("robmem.frames").unwrap();
        let frames = frames.iter().map(|(frame, parent, pose)| ((*frame).to_owned(), ((*parent).to_owned(), *pose)));
        let (from, to) = place.split_once('>').unwrap();
        Tree { place: &ns, frames: frames.collect() }.way(from, to)
    }

    fn at(x: f64) -> Pose {
        Pose { translation: [x, 0.0, 0.0], ..Pose::IDENTITY }
    }

    #[test]
    fn ways_lead_over_the_common_ancestor() {
        let frames = [("arm", "base", at(1.0)), ("base", "map", at(1e6)), ("camera", "base", at(3.0))];
        for (way, x) in [("arm>base", 1.0), ("base>arm", -1.0), ("arm>camera", -2.0), ("camera>map", 1e6 + 3.0)] {
            assert_eq!(tree(&frames, way).unwrap().translation, [x, 0.0, 0.0], "{way}");
        }
    }

    #[test]
    fn what_is_no_way_is_said() {
        let frames = [("arm", "base", at(1.0)), ("hand", "wrist", at(1.0)), ("x", "y", at(0.0)), ("y", "x", at(0.0))];
        for (way, words) in [
            ("arm>nowhere", "`nowhere` is not known; robmem.frames has arm, base, hand, wrist, x, y"),
            ("arm>hand", "no way leads from the frame `arm` to `hand`"),
            ("arm>x", "are no tree: x → y → x"),
        ] {
            let wrong = tree(&frames, way).unwrap_err();
            assert!(wrong.contains(words), "{wrong}");
        }
    }
}
