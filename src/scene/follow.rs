//! The operations on a scene as they happen.
//!
//! The changes of the objects' collections and of the frames are watched, each at least once. A changed
//! document is compared with what it was before; a changed frame moves every object in it. Poses are always
//! those of the frames as they are now, so that a change that is delivered again does no harm.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use bson::{Document, RawDocument};

use super::diff::changes;
use super::extract::{Invalid, Located, Sources, Ways, locate};
use super::kind::Kinds;
use crate::formats::scene::Operation;
use crate::formats::shell;
use crate::memory::Memory;
use crate::memory::frames::Frames;
use crate::memory::watch::{Trigger, Watch};
use crate::query::{Filter, QueryError};
use crate::store::{Change, ChangeKind, Find, Namespace, Next, StoreError};

/// How long one collection is waited for before the next is looked at.
const TURN: Duration = Duration::from_millis(5);

/// What is followed.
pub struct Follower<'a> {
    memory: &'a Memory,
    frame: String,
    frames: Frames,
    /// The objects' collections; the frames are the last.
    watches: Vec<(Namespace, Watch<'a>)>,
    sources: Vec<Source<'a>>,
    /// The documents of objects as they are now, by collection and `_id`.
    documents: BTreeMap<(usize, String), Located>,
    /// Those that are no objects as they are now: their frame is not known yet, perhaps.
    unplaced: BTreeSet<(usize, String)>,
    /// Whether it goes on where another was done: what is known of documents may be newer than their changes.
    is_resumed: bool,
    turn: usize,
}

/// A collection of objects.
struct Source<'a> {
    namespace: Namespace,
    query: Document,
    filter: Filter,
    kinds: Kinds<'a>,
}

/// What happened.
#[derive(Debug)]
pub enum Event {
    /// These operations, in order.
    Operations(Vec<Operation>),
    /// A document is no object any more.
    Invalid(Vec<Invalid>, Vec<Operation>),
    /// Nothing in this time.
    Nothing,
    /// The store cannot be reached; to ask again connects again.
    Interrupted(StoreError),
}

impl<'a> Follower<'a> {
    /// Begins to follow: first the changes, then what there is, so that nothing is missed between. With
    /// a name, goes on where the last follower of this name was done.
    ///
    /// # Errors
    /// Where a query is wrong, a store fails, or another process has the name.
    pub fn new(
        memory: &'a Memory,
        sources: &Sources<'a>,
        frames: &Namespace,
        frame: &str,
        name: Option<&str>,
    ) -> Result<Self, StoreError> {
        let mut own = Vec::new();
        for (namespace, filter) in &sources.queries {
            let kinds = Kinds::of(sources.kinds, namespace)?;
            own.push(Source {
                namespace: namespace.clone(),
                query: filter.clone(),
                filter: Filter::parse(filter)?,
                kinds,
            });
        }
        let mut watched: Vec<&Namespace> = own.iter().map(|source| &source.namespace).chain([frames]).collect();
        watched.sort();
        watched.dedup();
        // The frames are the last: objects are known before what moves them.
        watched.sort_by_key(|namespace| *namespace == frames);
        let first = own.first().map(|source| &source.namespace);
        let watches: Result<Vec<_>, StoreError> = watched
            .into_iter()
            .map(|namespace| {
                let trigger = Trigger {
                    namespace: namespace.clone(),
                    filter: Document::new(),
                    name: name.map(|name| own_name(name, namespace, first)),
                    computed: false,
                    metadata: false,
                };
                Ok((namespace.clone(), memory.watch(trigger)?))
            })
            .collect();
        let mut follower = Self {
            memory,
            frame: frame.to_owned(),
            frames: Frames::read(frames, |find| memory.find(frames, find))?,
            watches: watches?,
            sources: own,
            documents: BTreeMap::new(),
            unplaced: BTreeSet::new(),
            is_resumed: name.is_some(),
            turn: 0,
        };
        follower.read_all()?;
        Ok(follower)
    }

    /// How many objects there are now.
    #[must_use]
    pub fn count(&self) -> usize {
        self.documents.len()
    }

    /// Reads the documents as they are now; gives those that were no objects before.
    fn read_all(&mut self) -> Result<Vec<Located>, StoreError> {
        let mut ways = Ways::new(&self.frames, &self.frame);
        let mut new = Vec::new();
        for (index, source) in self.sources.iter().enumerate() {
            let find = Find { filter: source.query.clone(), ..Find::default() };
            for raw in self.memory.stored(&source.namespace, &find)? {
                match locate(&raw?, &source.namespace, &source.kinds, &mut ways)? {
                    Some(Ok(located)) => {
                        let key = (index, shell::canonical_value(&located.id));
                        if self.unplaced.remove(&key) {
                            new.push(located.clone());
                        }
                        self.documents.insert(key, located);
                    }
                    Some(Err(invalid)) => drop(self.unplaced.insert((index, shell::canonical_value(&invalid.id)))),
                    None => {}
                }
            }
        }
        Ok(new)
    }

    /// What happens next, or nothing within `timeout`. Properties of objects come before what moves
    /// them, so that nothing is moved that was not added.
    ///
    /// # Errors
    /// Where nothing more will come.
    pub fn next(&mut self, timeout: Duration) -> Result<Event, StoreError> {
        let start = Instant::now();
        loop {
            for index in 0..self.watches.len() {
                if let Some(event) = self.look(index, Duration::ZERO)? {
                    return Ok(event);
                }
            }
            let left = timeout.saturating_sub(start.elapsed());
            if left.is_zero() {
                return Ok(Event::Nothing);
            }
            self.turn = (self.turn + 1) % self.watches.len();
            if let Some(event) = self.look(self.turn, left.min(TURN))? {
                return Ok(event);
            }
        }
    }

    /// Looks at one collection for a change that is one of the scene.
    fn look(&mut self, index: usize, timeout: Duration) -> Result<Option<Event>, StoreError> {
        let (namespace, watch) = &mut self.watches[index];
        let namespace = namespace.clone();
        Ok(match watch.next(timeout)? {
            Next::Change(change) => Some(self.changed(&namespace, &change)?),
            Next::Interrupted(error) => Some(Event::Interrupted(error)),
            Next::Nothing => None,
        })
    }

    /// Says that all events given so far are dealt with.
    ///
    /// # Errors
    /// Where a store fails, or another process took the name.
    pub fn done(&mut self) -> Result<(), StoreError> {
        self.watches.iter_mut().try_for_each(|(_, watch)| watch.done())
    }

    fn changed(&mut self, namespace: &Namespace, change: &Change) -> Result<Event, StoreError> {
        let mut operations = Vec::new();
        let mut invalid = Vec::new();
        if namespace == self.frames.namespace() && is_frame(change)? {
            self.frame_changed(change, &mut operations, &mut invalid)?;
        }
        for index in 0..self.sources.len() {
            if self.sources[index].namespace == *namespace {
                self.object_changed(index, change, &mut operations, &mut invalid)?;
            }
        }
        Ok(match (operations.is_empty(), invalid.is_empty()) {
            (true, true) => Event::Nothing,
            (_, true) => Event::Operations(operations),
            _ => Event::Invalid(invalid, operations),
        })
    }

    /// Moves every object in the frame, and in the frames in it.
    fn frame_changed(
        &mut self,
        change: &Change,
        operations: &mut Vec<Operation>,
        invalid: &mut Vec<Invalid>,
    ) -> Result<(), StoreError> {
        let names: Vec<String> = frame_names(change)?;
        let namespace = self.frames.namespace();
        let now = Frames::read(namespace, |find| self.memory.find(namespace, find))?;
        let before = std::mem::replace(&mut self.frames, now);
        let mut ways = Ways::new(&self.frames, &self.frame);
        for located in self.documents.values_mut() {
            let is_in =
                |frames: &Frames| frames.is_within(&located.frame, &names) != frames.is_within(&self.frame, &names);
            if !is_in(&self.frames) && !is_in(&before) {
                continue;
            }
            match ways.from(&located.frame) {
                Ok(way) => {
                    located.object.pose = way.around(&located.own);
                    operations.push(Operation::Move { name: located.object.name.clone(), pose: located.object.pose });
                }
                Err(reason) => {
                    let (namespace, id) = (located.namespace.clone(), located.id.clone());
                    invalid.push(Invalid { namespace, id, reason });
                }
            }
        }
        if !self.unplaced.is_empty() {
            let new = self.read_all()?;
            operations.extend(new.into_iter().map(|located| Operation::Add(Box::new(located.object))));
        }
        Ok(())
    }

    fn object_changed(
        &mut self,
        index: usize,
        change: &Change,
        operations: &mut Vec<Operation>,
        invalid: &mut Vec<Invalid>,
    ) -> Result<(), StoreError> {
        let Some(id) = &change.id else {
            // The collection is gone.
            let (gone, kept) =
                std::mem::take(&mut self.documents).into_iter().partition(|((source, _), _)| *source == index);
            self.documents = kept;
            let gone: BTreeMap<(usize, String), Located> = gone;
            operations.extend(gone.into_values().map(|located| Operation::Remove { name: located.object.name }));
            return Ok(());
        };
        let key = (index, shell::canonical_value(id));
        let source = &self.sources[index];
        let mut ways = Ways::new(&self.frames, &self.frame);
        let mut read = |raw: &RawDocument| -> Result<Option<Result<Located, Invalid>>, QueryError> {
            if source.filter.matches(raw)? {
                locate(raw, &source.namespace, &source.kinds, &mut ways)
            } else {
                Ok(None)
            }
        };
        // Where the store does not have the document as it was, the one that is known stands for it.
        let is_imageless = change.before.is_none() && change.kind != ChangeKind::Insert;
        let before = change.before.as_deref().map(&mut read).transpose()?.flatten();
        let after = change.after.as_deref().map(&mut read).transpose()?.flatten();
        let before = before.and_then(Result::ok).or_else(|| self.documents.get(&key).filter(|_| is_imageless).cloned());
        let after = match after {
            Some(Err(wrong)) => {
                invalid.push(wrong);
                None
            }
            Some(Ok(located)) => Some(located),
            None => None,
        };
        match (&before, &after) {
            (Some(old), Some(new)) if old.object.name == new.object.name => {
                let count = operations.len();
                changes(&old.object, &new.object, 0.0, operations);
                // What is known is as it is after the change, perhaps; what the object was before is not known then.
                if is_imageless && self.is_resumed && operations.len() == count {
                    operations.push(Operation::Add(Box::new(new.object.clone())));
                }
            }
            _ => {
                operations.extend(before.map(|old| Operation::Remove { name: old.object.name }));
                operations.extend(after.as_ref().map(|new| Operation::Add(Box::new(new.object.clone()))));
            }
        }
        if invalid.is_empty() {
            self.unplaced.remove(&key);
        } else {
            self.unplaced.insert(key.clone());
        }
        match after {
            Some(located) => drop(self.documents.insert(key, located)),
            None => drop(self.documents.remove(&key)),
        }
        Ok(())
    }
}

/// The name under which the position in a collection is kept: a name belongs to one collection.
fn own_name(name: &str, namespace: &Namespace, first: Option<&Namespace>) -> String {
    if first == Some(namespace) { name.to_owned() } else { format!("{name}:{namespace}") }
}

/// Whether a change is about a frame.
fn is_frame(change: &Change) -> Result<bool, QueryError> {
    Ok(change.id.is_none() || !frame_names(change)?.is_empty())
}

/// The frames that a change is about, before and after it.
fn frame_names(change: &Change) -> Result<Vec<String>, QueryError> {
    let mut names = Vec::new();
    for document in [&change.before, &change.after].into_iter().flatten() {
        let text = |key: &str| document.get(key).map(|value| value.and_then(|value| value.as_str()));
        if let (Some(frame), Some(_)) = (text("frame")?, text("parent")?) {
            names.push(frame.to_owned());
        }
    }
    names.dedup();
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::kind::ObjectKind;
    use crate::store::Embedded;
    use bson::{DateTime, RawDocumentBuf, doc};

    /// What a follower makes of an update whose document is known only as it is now.
    fn imageless_update(name: Option<&str>) -> Event {
        let folder = tempfile::tempdir().unwrap();
        let memory = Memory::new(Box::new(Embedded::open(folder.path().join("m.rmem")).unwrap()), None, Vec::new());
        let [objects, frames] = ["robmem.objects", "robmem.frames"].map(|name| Namespace::parse(name).unwrap());
        let cup = doc! { "_id": 1, "name": "cup", "frame": "map", "translation": [1, 2, 3], "rotation": [0, 0, 0, 1] };
        memory.insert(&objects, vec![cup.clone()]).unwrap();
        let kinds: [ObjectKind; 0] = [];
        let sources = Sources { queries: vec![(objects.clone(), Document::new())], kinds: &kinds };
        let mut follower = Follower::new(&memory, &sources, &frames, "map", name).unwrap();
        let change = Change {
            kind: ChangeKind::Update,
            id: Some(1.into()),
            before: None,
            after: Some(RawDocumentBuf::try_from(&cup).unwrap()),
            time: DateTime::from_millis(0),
            position: String::new(),
        };
        follower.changed(&objects, &change).unwrap()
    }

    #[test]
    fn what_changed_while_a_follower_was_away_is_described_anew_where_the_store_has_no_images() {
        let Event::Operations(operations) = imageless_update(Some("planner")) else { panic!() };
        assert!(matches!(&operations[..], [Operation::Add(cup)] if cup.name == "cup"), "{operations:?}");
    }

    #[test]
    fn what_is_as_it_was_known_is_no_operation() {
        assert!(matches!(imageless_update(None), Event::Nothing));
    }
}
