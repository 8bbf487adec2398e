//! A scene, or operations, back into documents.
//!
//! Poses are written in each document's own frame. What a format cannot express is left as it is in the
//! document. New objects become documents in the scene's frame. What the scene does not have any more is
//! removed only where that is asked for.

use std::collections::{HashMap, HashSet};

use bson::{Bson, Document, doc};

use super::diff::is_reshaped;
use super::extract::{Extraction, Located};
use super::mesh::Meshes;
use crate::formats::scene::{Attachment, Kind, Object, Operation, Pose, Scene, Spelling, document, operation};
use crate::memory::Memory;
use crate::memory::frames::Frames;
use crate::store::{Namespace, StoreError, UpdateRequest, UpdateSpec};

/// What is done to one document.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// What it is called: add, move, reshape, attach, detach, remove, or several of them.
    pub words: Vec<&'static str>,
    /// The object.
    pub name: String,
    /// Where its document is.
    pub namespace: Namespace,
    /// How.
    pub effect: Effect,
}

/// How a document is changed.
#[derive(Debug, Clone, PartialEq)]
pub enum Effect {
    /// It is new.
    Insert(Document),
    /// Keys are set, and others taken away.
    Update {
        /// Which document.
        id: Bson,
        /// The new values.
        set: Document,
        /// The keys that go.
        unset: Document,
    },
    /// It goes.
    Delete {
        /// Which document.
        id: Bson,
    },
    /// It should go, and stays, since removing was not asked for.
    Keep {
        /// Which document.
        id: Bson,
    },
}

/// What a scene is applied to.
pub struct Target<'a> {
    /// The objects of the memory, in the frame of the scene.
    pub known: &'a Extraction,
    /// The tree of frames.
    pub frames: &'a Frames,
    /// The frame of the scene.
    pub frame: &'a str,
    /// Where new objects go.
    pub into: &'a Namespace,
    /// Whether objects that the scene does not have any more are removed.
    pub remove: bool,
    /// Numbers that differ by at most this are equal.
    pub tolerance: f64,
}

impl Target<'_> {
    /// What a whole scene of this format changes.
    ///
    /// # Errors
    /// Which object cannot be written back, and why.
    pub fn scene(&self, scene: &Scene, spelling: &Spelling, meshes: &mut Meshes) -> Result<Vec<Change>, String> {
        let known = self.known.by_name();
        let mut changes = Vec::new();
        let mut names = HashSet::new();
        for object in &scene.objects {
            if !names.insert(object.name.as_str()) {
                return Err(format!("there are two objects with the name `{}`", object.name));
            }
            match known.get(object.name.as_str()) {
                None => changes.push(self.insert(object)),
                Some(located) => changes.extend(self.update(located, object, spelling, meshes)?),
            }
        }
        let gone = self.known.objects.iter().filter(|located| !names.contains(located.object.name.as_str()));
        changes.extend(gone.map(|located| self.gone(located)));
        Ok(changes)
    }

    /// What operations change, one after the other.
    ///
    /// # Errors
    /// Which object is not there, or cannot be written back.
    pub fn operations(&self, operations: &[Operation]) -> Result<Vec<Change>, String> {
        let known = self.known.by_name();
        let mut new: HashMap<&str, usize> = HashMap::new();
        let mut changes: Vec<Change> = Vec::new();
        for operation in operations {
            let name = operation.name();
            match (known.get(name), new.get(name), operation) {
                (Some(located), _, _) => changes.extend(self.operate(located, operation)?),
                (None, None, Operation::Add(object)) => {
                    new.insert(name, changes.len());
                    changes.push(self.insert(object));
                }
                (None, Some(index), _) => {
                    let index = *index;
                    self.amend(&mut changes[index], operation);
                }
                // What was to be removed is not there.
                (None, None, Operation::Remove { .. }) => {}
                (None, None, _) => {
                    let word = operation.word();
                    return Err(format!("there is no object `{name}` in {} to {word}", self.into));
                }
            }
        }
        Ok(changes)
    }

    fn insert(&self, object: &Object) -> Change {
        let mut written = doc! { "name": &object.name, "frame": self.frame };
        written.extend(document::write(object));
        Change {
            words: vec!["add"],
            name: object.name.clone(),
            namespace: self.into.clone(),
            effect: Effect::Insert(written),
        }
    }

    fn update(
        &self,
        located: &Located,
        object: &Object,
        spelling: &Spelling,
        meshes: &mut Meshes,
    ) -> Result<Option<Change>, String> {
        let mut before = located.object.clone();
        if spelling.limits.kinds.contains(&Kind::Triangles) && !spelling.limits.kinds.contains(&Kind::MeshFile) {
            meshes.load(&mut before).map_err(|wrong| format!("`{}`: {wrong}", object.name))?;
        }
        let before = spelling.expressible(&before);
        let mut update = Update::of(located);
        if is_reshaped(&before, object, self.tolerance) {
            update.reshape(object, spelling);
        }
        if !before.pose.is_near(&object.pose, self.tolerance) {
            update.move_to(self.own(located, &object.pose)?);
        }
        if spelling.limits.attachment && before.attachment != object.attachment {
            update.attach(object.attachment.as_ref());
        }
        Ok(update.change())
    }

    fn operate(&self, located: &Located, operation: &Operation) -> Result<Option<Change>, String> {
        let mut update = Update::of(located);
        match operation {
            Operation::Remove { .. } => return Ok(Some(self.gone(located))),
            Operation::Move { pose, .. } => update.move_to(self.own(located, pose)?),
            Operation::Attach { attachment, .. } => update.attach(Some(attachment)),
            Operation::Detach { .. } => update.attach(None),
            Operation::Reshape(object) => update.reshape(object, &crate::formats::scene::json::SPELLING),
            // An object that is there already is as if it were described anew.
            Operation::Add(object) => {
                update.reshape(object, &crate::formats::scene::json::SPELLING);
                update.move_to(self.own(located, &object.pose)?);
                update.attach(object.attachment.as_ref());
            }
        }
        Ok(update.change())
    }

    /// Changes a document that is not stored yet.
    fn amend(&self, change: &mut Change, operation: &Operation) {
        let Effect::Insert(written) = &mut change.effect else { return };
        match operation {
            Operation::Move { pose, .. } => written.extend(document::pose_keys(pose)),
            Operation::Attach { attachment, .. } => {
                drop(written.insert("attached_to", document::attachment_value(attachment)))
            }
            Operation::Detach { .. } => drop(written.remove("attached_to")),
            Operation::Reshape(object) => written.extend(operation::shape_keys(object)),
            Operation::Add(object) => *change = self.insert(object),
            Operation::Remove { .. } => written.clear(),
        }
    }

    fn gone(&self, located: &Located) -> Change {
        let id = located.id.clone();
        let effect = if self.remove { Effect::Delete { id } } else { Effect::Keep { id } };
        Change {
            words: vec!["remove"],
            name: located.object.name.clone(),
            namespace: located.namespace.clone(),
            effect,
        }
    }

    /// A pose of the scene in the document's own frame.
    fn own(&self, located: &Located, pose: &Pose) -> Result<Pose, String> {
        let way = self.frames.way(self.frame, &located.frame);
        way.map(|way| way.around(pose))
            .map_err(|wrong| format!("`{}` cannot be written back: {wrong}", located.object.name))
    }
}

/// What changes in a document, as it is put together.
struct Update<'a> {
    located: &'a Located,
    words: Vec<&'static str>,
    set: Document,
    unset: Document,
}

impl<'a> Update<'a> {
    fn of(located: &'a Located) -> Self {
        Self { located, words: Vec::new(), set: Document::new(), unset: Document::new() }
    }

    fn move_to(&mut self, pose: Pose) {
        self.words.push("move");
        self.set.extend(document::pose_keys(&pose));
    }

    fn attach(&mut self, attachment: Option<&Attachment>) {
        match attachment {
            Some(attachment) => {
                self.words.push("attach");
                self.set.insert("attached_to", document::attachment_value(attachment));
            }
            None if self.located.object.attachment.is_some() => {
                self.words.push("detach");
                self.unset.insert("attached_to", "");
            }
            None => {}
        }
    }

    /// Everything but pose and attachment, as far as the format can express it.
    fn reshape(&mut self, object: &Object, spelling: &Spelling) {
        self.words.push("reshape");
        let written = operation::shape_keys(object);
        let limits = &spelling.limits;
        let known = [
            ("geometry", true),
            ("color", true),
            ("mass", limits.mass != crate::formats::scene::Mass::None),
            ("static", limits.fixed),
            ("subframes", limits.subframes),
            ("model", limits.model != crate::formats::scene::Model::None),
        ];
        let before = operation::shape_keys(&self.located.object);
        for (key, _) in known.into_iter().filter(|(_, known)| *known) {
            match written.get(key) {
                Some(value) if before.get(key) != Some(value) => drop(self.set.insert(key, value.clone())),
                None if before.contains_key(key) => drop(self.unset.insert(key, "")),
                _ => {}
            }
        }
    }

    fn change(self) -> Option<Change> {
        let Self { located, words, set, unset } = self;
        let (name, namespace) = (located.object.name.clone(), located.namespace.clone());
        let effect = Effect::Update { id: located.id.clone(), set, unset };
        (!words.is_empty()).then_some(Change { words, name, namespace, effect })
    }
}

/// Makes the changes; all of them or, where the store can, none.
///
/// # Errors
/// Where the store fails.
pub fn commit(memory: &Memory, changes: &[Change]) -> Result<(), StoreError> {
    let mut namespaces: Vec<&Namespace> = changes.iter().map(|change| &change.namespace).collect();
    namespaces.sort();
    namespaces.dedup();
    memory.atomically(&namespaces, |error| error, |_| changes.iter().try_for_each(|change| write(memory, change)))
}

fn write(memory: &Memory, change: &Change) -> Result<(), StoreError> {
    let namespace = &change.namespace;
    match &change.effect {
        Effect::Insert(document) if document.is_empty() => Ok(()),
        Effect::Insert(document) => memory.insert(namespace, vec![document.clone()]).map(drop),
        Effect::Delete { id } => memory.delete(namespace, &doc! { "_id": id }, true).map(drop),
        Effect::Keep { .. } => Ok(()),
        Effect::Update { id, set, unset } => {
            let mut update = Document::new();
            if !set.is_empty() {
                update.insert("$set", set);
            }
            if !unset.is_empty() {
                update.insert("$unset", unset);
            }
            if update.is_empty() {
                return Ok(());
            }
            let request = UpdateRequest {
                filter: doc! { "_id": id },
                update: UpdateSpec::Document(update),
                ..UpdateRequest::default()
            };
            memory.update(namespace, &request).map(drop)
        }
    }
}
