//! The tree of coordinate frames: documents `{frame, parent, translation, rotation}`, each the
//! pose of `frame` in `parent`. A frame without such a document is a root.

use std::collections::HashMap;

use bson::{Document, doc};

use crate::formats::scene::Pose;
use crate::formats::scene::document;
use crate::formats::shell;
use crate::query::QueryError;
use crate::store::{Documents, Find, Namespace, StoreError};

/// The frames of a collection, each with its parent, and its pose there.
#[derive(Debug, Clone)]
pub struct Frames {
    namespace: Namespace,
    frames: HashMap<String, (String, Pose)>,
}

/// Why the pose of a frame in another is not known.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum WayError {
    /// One of the frames is in no document.
    #[error("the frame `{frame}` is not known; {known}")]
    Unknown {
        /// Which one.
        frame: String,
        /// What there is.
        known: String,
    },
    /// The frames are in two trees.
    #[error("no way leads from the frame `{from}` to `{to}` in {namespace}")]
    Apart {
        /// The frame whose pose was asked for.
        from: String,
        /// The frame in which it was asked for.
        to: String,
        /// The collection of the frames.
        namespace: Namespace,
    },
    /// The parents of a frame lead back to it.
    #[error("the frames of {namespace} are not a tree: {}", cycle.join(" → "))]
    Cycle {
        /// The collection of the frames.
        namespace: Namespace,
        /// The frames, of which the last is the first again.
        cycle: Vec<String>,
    },
}

/// A frame and those around it, each with the pose of the first in it.
type Ancestors<'a> = Vec<(&'a str, Pose)>;

impl Frames {
    /// Reads the frames of a collection with `find`, which queries it.
    ///
    /// # Errors
    /// Where `find` fails, a frame has no pose, or two documents are about one frame.
    pub fn read<'a>(
        namespace: &Namespace,
        find: impl FnOnce(&Find) -> Result<Documents<'a>, StoreError>,
    ) -> Result<Self, StoreError> {
        let filter = doc! { "parent": { "$type": "string" }, "frame": { "$type": "string" } };
        let mut frames = Self { namespace: namespace.clone(), frames: HashMap::new() };
        for document in find(&Find { filter, ..Find::default() })? {
            frames.add(&Document::try_from(&*document?).map_err(QueryError::from)?).map_err(QueryError::bad_value)?;
        }
        Ok(frames)
    }

    fn add(&mut self, document: &Document) -> Result<(), String> {
        let (Ok(frame), Ok(parent)) = (document.get_str("frame"), document.get_str("parent")) else { return Ok(()) };
        let place = &self.namespace;
        let id = || document.get("_id").map(shell::relaxed_value).unwrap_or_default();
        let pose = document::pose(document)
            .map_err(|wrong| format!("the frame `{frame}` of {place} (_id {}) has no pose: {wrong}", id()))?;
        if self.frames.insert(frame.to_owned(), (parent.to_owned(), pose)).is_some() {
            return Err(format!("the frame `{frame}` is in {place} twice (_id {}); a frame has one parent", id()));
        }
        Ok(())
    }

    /// The collection.
    #[must_use]
    pub fn namespace(&self) -> &Namespace {
        &self.namespace
    }

    /// The pose of a frame in another.
    ///
    /// # Errors
    /// Where a frame is not known, no way leads from one to the other, or the frames are not a tree.
    pub fn way(&self, from: &str, to: &str) -> Result<Pose, WayError> {
        if from == to {
            return Ok(Pose::IDENTITY);
        }
        let (around_from, around_to) = (self.ancestors(from)?, self.ancestors(to)?);
        for (frame, pose) in &around_from {
            if let Some((_, other)) = around_to.iter().find(|(other, _)| other == frame) {
                return Ok(other.inverse().around(pose));
            }
        }
        let unknown = [from, to].into_iter().find(|frame| !self.knows(frame));
        Err(match unknown {
            Some(frame) => WayError::Unknown { frame: frame.to_owned(), known: self.known() },
            None => WayError::Apart { from: from.to_owned(), to: to.to_owned(), namespace: self.namespace.clone() },
        })
    }

    /// The frame and those around it, up to the root.
    fn ancestors<'b>(&'b self, frame: &'b str) -> Result<Ancestors<'b>, WayError> {
        let mut ancestors: Ancestors<'b> = vec![(frame, Pose::IDENTITY)];
        while let Some((last, pose)) = ancestors.last()
            && let Some((parent, own)) = self.frames.get(*last)
        {
            let next = (parent.as_str(), own.around(pose));
            if let Some(start) = ancestors.iter().position(|(frame, _)| *frame == next.0) {
                let cycle = ancestors.iter().skip(start).map(|(frame, _)| *frame).chain([next.0]);
                let cycle = cycle.map(str::to_owned).collect();
                return Err(WayError::Cycle { namespace: self.namespace.clone(), cycle });
            }
            ancestors.push(next);
        }
        Ok(ancestors)
    }

    /// Whether a frame is in the tree.
    #[must_use]
    pub fn knows(&self, frame: &str) -> bool {
        self.frames.iter().any(|(known, (parent, _))| known == frame || parent == frame)
    }

    /// Whether a frame is one of these, or in one of these.
    #[must_use]
    pub fn is_within(&self, frame: &str, others: &[String]) -> bool {
        let mut frame = frame;
        for _ in 0..=self.frames.len() {
            if others.iter().any(|other| other == frame) {
                return true;
            }
            let Some((parent, _)) = self.frames.get(frame) else { return false };
            frame = parent;
        }
        false
    }

    /// Whether there are any.
    #[must_use]
    pub fn has_any(&self) -> bool {
        !self.frames.is_empty()
    }

    /// What there is, for messages.
    #[must_use]
    pub fn known(&self) -> String {
        let mut known: Vec<&str> =
            self.frames.iter().flat_map(|(frame, (parent, _))| [frame.as_str(), parent]).collect();
        known.sort_unstable();
        known.dedup();
        match known.as_slice() {
            [] => format!("{} has no documents {{frame, parent, translation, rotation}}", self.namespace),
            some => format!("{} has {}", self.namespace, some.join(", ")),
        }
    }

    /// The frames, each with its parent and its pose there, in order of their names.
    #[must_use]
    pub fn all(&self) -> Vec<(&str, &str, Pose)> {
        let frames = self.frames.iter().map(|(frame, (parent, pose))| (frame.as_str(), parent.as_str(), *pose));
        let mut all: Vec<_> = frames.collect();
        all.sort_unstable_by_key(|(frame, ..)| *frame);
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn way(frames: &[(&str, &str, Pose)], way: &str) -> Result<Pose, WayError> {
        let namespace = Namespace::parse("robmem.frames").unwrap();
        let frames = frames.iter().map(|(frame, parent, pose)| ((*frame).to_owned(), ((*parent).to_owned(), *pose)));
        let (from, to) = way.split_once('>').unwrap();
        Frames { namespace, frames: frames.collect() }.way(from, to)
    }

    fn at(x: f64) -> Pose {
        Pose { translation: [x, 0.0, 0.0], ..Pose::IDENTITY }
    }

    #[test]
    fn ways_lead_over_the_common_ancestor() {
        let frames = [("arm", "base", at(1.0)), ("base", "map", at(1e6)), ("camera", "base", at(3.0))];
        for (name, x) in [("arm>base", 1.0), ("base>arm", -1.0), ("arm>camera", -2.0), ("camera>map", 1e6 + 3.0)] {
            assert_eq!(way(&frames, name).unwrap().translation, [x, 0.0, 0.0], "{name}");
        }
        assert_eq!(way(&[], "map>map"), Ok(Pose::IDENTITY));
    }

    #[test]
    fn what_is_no_way_is_said() {
        let frames = [("arm", "base", at(1.0)), ("hand", "wrist", at(1.0)), ("x", "y", at(0.0)), ("y", "x", at(0.0))];
        for (name, words) in [
            ("arm>nowhere", "`nowhere` is not known; robmem.frames has arm, base, hand, wrist, x, y"),
            ("arm>hand", "no way leads from the frame `arm` to `hand`"),
            ("arm>x", "are not a tree: x → y → x"),
        ] {
            let wrong = way(&frames, name).unwrap_err().to_string();
            assert!(wrong.contains(words), "{wrong}");
        }
    }
}
