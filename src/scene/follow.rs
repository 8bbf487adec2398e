//! The operations on a scene as they happen.
//!
//! The changes of the objects' collections and of the frames are watched, each at least once. A changed
//! document is compared with what it was before; a changed frame moves every object in it. Poses are always
//! those of the frames as they are now, so that a change that is delivered again does no harm. What changes do
//! not tell, that objects went with a dropped collection, is found by reading all documents again.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use bson::{Document, RawDocument};

use super::diff::changes;
use super::extract::{Invalid, Located, Sources, Ways, locate};
use super::kind::Kinds;
use super::reported::{Key, Reported};
use crate::formats::scene::Operation;
use crate::formats::shell;
use crate::memory::Memory;
use crate::memory::frames::Frames;
use crate::memory::watch::{Trigger, Watch};
use crate::query::{Filter, QueryError};
use crate::store::{Change, ChangeKind, Find, Namespace, Next, StoreError};

/// How long to wait for a change of one collection before the next one is asked. Short, because they are asked in turn.
const POLL_TIMEOUT: Duration = Duration::from_millis(5);

/// What is followed.
pub struct Follower<'a> {
    memory: &'a Memory,
    frame: String,
    frames: Frames,
    /// The objects' collections; the frames are the last.
    watches: Vec<(Namespace, Watch<'a>)>,
    sources: Vec<Source<'a>>,
    /// The documents of objects as they are now.
    documents: BTreeMap<Key, Located>,
    /// Those that are no objects as they are now: their frame is not known yet, perhaps.
    unplaced: BTreeSet<Key>,
    reported: Reported<'a>,
    /// Whether objects may be there or gone although no change says so.
    is_unsettled: bool,
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

/// What is to be printed: operations, and what is wrong with documents that are no objects.
#[derive(Default)]
struct Report {
    operations: Vec<Operation>,
    invalid: Vec<Invalid>,
}

/// The documents as they are.
#[derive(Default)]
struct Found {
    objects: BTreeMap<Key, Located>,
    invalid: Vec<(Key, Invalid)>,
}

/// What happened.
#[derive(Debug)]
pub enum Event {
    /// These operations, in order.
    Operations(Vec<Operation>),
    /// A document is not an object any more.
    Invalid(Vec<Invalid>, Vec<Operation>),
    /// Nothing in this time.
    Nothing,
    /// The store cannot be reached; to ask again connects again.
    Interrupted(StoreError),
}

impl<'a> Follower<'a> {
    /// Begins to follow: first the changes, then what there is, so that nothing is missed between. With
    /// a name, goes on where the last follower of this name was done. Gives also the documents that are no objects.
    ///
    /// # Errors
    /// Where a query is wrong, a store fails, or another process has the name.
    pub fn new(
        memory: &'a Memory,
        sources: &Sources<'a>,
        frames: &Namespace,
        frame: &str,
        name: Option<&str>,
    ) -> Result<(Self, Vec<Invalid>), StoreError> {
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
        let objects = first.unwrap_or(frames).clone();
        let follower = Self {
            memory,
            frame: frame.to_owned(),
            frames: Frames::read(frames, |find| memory.find(frames, find))?,
            watches: watches?,
            reported: Reported::load(memory, &objects, name)?,
            sources: own,
            documents: BTreeMap::new(),
            unplaced: BTreeSet::new(),
            is_unsettled: false,
            is_resumed: name.is_some(),
            turn: 0,
        };
        follower.begin()
    }

    /// Reads what there is. All of it counts as reported where no watch of this name reported anything.
    fn begin(mut self) -> Result<(Self, Vec<Invalid>), StoreError> {
        let found = self.read_all()?;
        self.is_unsettled = self.reported.is_known();
        if !self.is_unsettled {
            found.objects.iter().for_each(|(key, located)| self.reported.add(key.clone(), &located.object.name));
        }
        self.documents = found.objects;
        let (unplaced, invalid): (BTreeSet<Key>, Vec<Invalid>) = found.invalid.into_iter().unzip();
        self.unplaced = unplaced;
        self.reported.save()?;
        Ok((self, invalid))
    }

    /// How many objects there are now.
    #[must_use]
    pub fn count(&self) -> usize {
        self.documents.len()
    }

    /// Reads the documents as they are now. Of those with one name, the first is an object.
    fn read_all(&self) -> Result<Found, StoreError> {
        let mut ways = Ways::new(&self.frames, &self.frame);
        let (mut found, mut seen, mut names) = (Found::default(), BTreeSet::new(), BTreeSet::new());
        for source in &self.sources {
            let find = Find { filter: source.query.clone(), ..Find::default() };
            for raw in self.memory.stored(&source.namespace, &find)? {
                let Some(read) = locate(&raw?, &source.namespace, &source.kinds, &mut ways)? else { continue };
                let id = match &read {
                    Ok(located) => &located.id,
                    Err(invalid) => &invalid.id,
                };
                let key = (source.namespace.clone(), shell::canonical_value(id));
                // A document may be of two kinds; the first counts.
                if !seen.insert(key.clone()) {
                    continue;
                }
                match read {
                    Ok(located) if names.insert(located.object.name.clone()) => {
                        found.objects.insert(key, located);
                    }
                    Ok(located) => found.invalid.push((key, Invalid::twice(located))),
                    Err(invalid) => found.invalid.push((key, invalid)),
                }
            }
        }
        Ok(found)
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
                // All changes are delivered.
                let mut report = Report::default();
                if std::mem::take(&mut self.is_unsettled) {
                    self.settle(&mut report)?;
                }
                return self.announced(report);
            }
            self.turn = (self.turn + 1) % self.watches.len();
            if let Some(event) = self.look(self.turn, left.min(POLL_TIMEOUT))? {
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
        self.reported.save()?;
        self.watches.iter_mut().try_for_each(|(_, watch)| watch.done())
    }

    fn changed(&mut self, namespace: &Namespace, change: &Change) -> Result<Event, StoreError> {
        let mut report = Report::default();
        if namespace == self.frames.namespace() && is_frame(change)? {
            self.frame_changed(change, &mut report)?;
        }
        if self.sources.iter().any(|source| source.namespace == *namespace) {
            match &change.id {
                Some(id) => {
                    self.object_changed((namespace.clone(), shell::canonical_value(id)), change, &mut report)?;
                }
                None => self.collection_changed(namespace, &mut report),
            }
        }
        self.announced(report)
    }

    /// Gives what is to be reported, after it is stored that it may have been.
    fn announced(&self, report: Report) -> Result<Event, StoreError> {
        self.reported.announce()?;
        Ok(report.into_event())
    }

    /// Moves every object in the frame, and in the frames in it.
    fn frame_changed(&mut self, change: &Change, report: &mut Report) -> Result<(), StoreError> {
        let names: Vec<String> = frame_names(change)?;
        let namespace = self.frames.namespace();
        let now = Frames::read(namespace, |find| self.memory.find(namespace, find))?;
        let before = std::mem::replace(&mut self.frames, now);
        let mut ways = Ways::new(&self.frames, &self.frame);
        let mut gone = Vec::new();
        for (key, located) in &mut self.documents {
            let is_in =
                |frames: &Frames| frames.is_within(&located.frame, &names) != frames.is_within(&self.frame, &names);
            // Where the collection is gone, every frame in it is.
            let is_affected = match change.id {
                Some(_) => is_in(&self.frames) || is_in(&before),
                None => located.frame != self.frame,
            };
            if !is_affected || !self.reported.contains(key) {
                continue;
            }
            match ways.from(&located.frame) {
                Ok(way) => {
                    located.object.pose = way.around(&located.own);
                    let (name, pose) = (located.object.name.clone(), located.object.pose);
                    report.operations.push(Operation::Move { name, pose });
                }
                Err(reason) => {
                    let (namespace, id) = (located.namespace.clone(), located.id.clone());
                    report.invalid.push(Invalid { namespace, id, reason: reason.into() });
                    gone.push(key.clone());
                }
            }
        }
        for key in gone {
            self.remove(&key, report);
            self.unplaced.insert(key);
        }
        if change.id.is_none() {
            self.is_unsettled = true;
        } else if !self.unplaced.is_empty() {
            self.settle(report)?;
        }
        Ok(())
    }

    /// A collection of objects is gone, with all that was in it.
    fn collection_changed(&mut self, namespace: &Namespace, report: &mut Report) {
        for key in self.reported.of(Some(namespace)) {
            self.remove(&key, report);
        }
        self.documents.retain(|(of, _), _| of != namespace);
        self.unplaced.retain(|(of, _)| of != namespace);
        self.is_unsettled = true;
    }

    fn object_changed(&mut self, key: Key, change: &Change, report: &mut Report) -> Result<(), StoreError> {
        let mut ways = Ways::new(&self.frames, &self.frame);
        let sources = &self.sources;
        let mut read = |raw: &RawDocument| -> Result<Option<Result<Located, Invalid>>, QueryError> {
            for source in sources.iter().filter(|source| source.namespace == key.0) {
                if source.filter.matches(raw)? {
                    return locate(raw, &source.namespace, &source.kinds, &mut ways);
                }
            }
            Ok(None)
        };
        // Where the store does not have the document as it was, the one that is known stands for it.
        let is_imageless = change.before.is_none() && change.kind != ChangeKind::Insert;
        let before = change.before.as_deref().map(&mut read).transpose()?.flatten();
        let after = change.after.as_deref().map(&mut read).transpose()?.flatten();
        let known = || self.documents.get(&key).filter(|_| is_imageless).map(|known| (known.clone(), false));
        let before = before.and_then(Result::ok).map(|image| (image, true)).or_else(known);
        let before = before.filter(|_| self.reported.contains(&key));
        self.unplaced.remove(&key);
        let invalid = match after {
            Some(Ok(new)) if self.has_name(&key, &new) => {
                self.replace(key, before, new, report);
                return Ok(());
            }
            Some(Ok(new)) => Invalid::twice(new),
            Some(Err(invalid)) => invalid,
            None => {
                self.remove(&key, report);
                return Ok(());
            }
        };
        self.remove(&key, report);
        report.invalid.push(invalid);
        self.unplaced.insert(key);
        Ok(())
    }

    /// Reports what leads from an object, where there was one, to what it is now. With the object as it was comes whether
    /// the store had it so, or it is the one that is known.
    fn replace(&mut self, key: Key, before: Option<(Located, bool)>, new: Located, report: &mut Report) {
        match before {
            Some((old, is_image)) if old.object.name == new.object.name => {
                let count = report.operations.len();
                changes(&old.object, &new.object, 0.0, &mut report.operations);
                // What is known is as it is after the change, perhaps; what the object was before is not known then.
                if !is_image && self.is_resumed && report.operations.len() == count {
                    report.operations.push(Operation::Add(Box::new(new.object.clone())));
                }
                self.documents.insert(key, new);
            }
            Some(_) => {
                self.remove(&key, report);
                self.add(key, new, report);
            }
            None => self.add(key, new, report),
        }
    }

    /// Whether no other object has its name.
    fn has_name(&self, key: &Key, located: &Located) -> bool {
        self.reported.key(&located.object.name).is_none_or(|other| other == key)
    }

    fn add(&mut self, key: Key, located: Located, report: &mut Report) {
        self.reported.add(key.clone(), &located.object.name);
        report.operations.push(Operation::Add(Box::new(located.object.clone())));
        self.documents.insert(key, located);
    }

    /// Removes an object, where it was reported.
    fn remove(&mut self, key: &Key, report: &mut Report) {
        self.documents.remove(key);
        if let Some(name) = self.reported.remove(key) {
            report.operations.push(Operation::Remove { name });
            // Another document may have its name.
            self.is_unsettled |= !self.unplaced.is_empty();
        }
    }

    /// Compares what was reported with what there is: adds what is new, removes what is gone. What is known of other objects
    /// stays: changes that are still to come are compared with it.
    fn settle(&mut self, report: &mut Report) -> Result<(), StoreError> {
        let found = self.read_all()?;
        let known = std::mem::take(&mut self.unplaced);
        for (key, invalid) in found.invalid {
            if !known.contains(&key) {
                report.invalid.push(invalid);
            }
            self.unplaced.insert(key);
        }
        for key in self.reported.of(None).iter().filter(|key| !found.objects.contains_key(*key)) {
            self.remove(key, report);
        }
        for (key, located) in found.objects {
            if self.reported.is_sure(&key) {
                self.documents.entry(key).or_insert(located);
            } else if self.has_name(&key, &located) {
                self.add(key, located, report);
            }
        }
        self.is_unsettled = false;
        Ok(())
    }
}

impl Report {
    fn into_event(self) -> Event {
        match (self.operations.is_empty(), self.invalid.is_empty()) {
            (true, true) => Event::Nothing,
            (_, true) => Event::Operations(self.operations),
            _ => Event::Invalid(self.invalid, self.operations),
        }
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
        let mut follower = Follower::new(&memory, &sources, &frames, "map", name).unwrap().0;
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
