//! A world model that several engines keep together: facts with a `sync-id`, a document each.
//!
//! The memory decides. An engine changes the document first and then its fact. All engines receive the
//! changes in the order in which the memory made them, and set their facts to the document of each
//! change. So all of them end with the same facts.
//!
//! A change that is older than an engine's own change of the same document would undo that for a moment,
//! and is skipped: each change writes a mark under `_robmem_info.clips.by`, and until an engine receives
//! its own mark it skips changes of that document. A change names only the slots that it is about, so
//! two engines that change different slots of one fact at the same time both keep theirs.

use std::time::{Duration, Instant};

use bson::{Bson, Document, doc};

use super::exchange;
use super::model::{Known, MARK, WorldModel, key, mark_of, mark_path};
use super::native::{Environment, FactRef, Value};
use super::state::State;
use crate::clips::facts::record;
use crate::error::Result;
use crate::formats::clips::{Body, Fact, Item, Reader};
use crate::formats::{Source, Span, shell};
use crate::query::{QueryError, object_id};
use crate::store::{Change, ChangeKind, Find, StoreError, UpdateRequest, UpdateSpec, metadata};

/// The slot, and the key of the document, that tells facts apart.
pub(super) const SYNC_ID: &str = "sync-id";
/// How long the start waits for the documents of the memory.
const SYNC_TIMEOUT: Duration = Duration::from_secs(10);
/// How many numbers are tried for a new fact; the second is hardly ever needed.
const TRIES: usize = 5;

impl State<'_> {
    /// Begins to keep the shared world model, where the command line wants that from the start.
    pub(super) fn begin(&self, clips: &Environment) -> Result<()> {
        match self.job.is_synced {
            true => self.world.start(self, clips),
            false => Ok(()),
        }
    }
}

impl WorldModel {
    /// Begins to keep the world model, if that was not begun: asserts what the memory has of it.
    pub(super) fn start(&self, state: &State<'_>, clips: &Environment) -> Result<()> {
        if self.started.replace(true) {
            return Ok(());
        }
        state.subscribe_world(&self.namespace)?;
        if state.memory.is_current(&self.namespace)? {
            let found = state.memory.find_with_metadata(&self.namespace, &Find::default())?;
            let documents = found.map(|document| Ok(Document::try_from(&*document?).map_err(QueryError::from)?));
            for document in documents.collect::<Result<Vec<_>>>()? {
                self.take(&document, state, clips);
            }
            return Ok(());
        }
        // The nearest member may be behind, so the documents are requested as changes.
        let mark = self.mark();
        *self.resync.borrow_mut() = Some(mark.clone());
        let everyone = request(Document::new(), vec![doc! { "$set": { mark_path(): &mark } }], true);
        let resynced = state.memory.update(&self.namespace, &everyone)?.matched;
        let start = Instant::now();
        while self.resynced.get() < resynced && start.elapsed() < SYNC_TIMEOUT && !state.stop().is_due() {
            state.receive(clips, true)?;
        }
        Ok(())
    }

    /// Takes in a change of the memory.
    pub(super) fn receive(&self, change: &Change, state: &State<'_>, clips: &Environment) -> Result<()> {
        match (change.kind, &change.id, &change.after) {
            (ChangeKind::Delete, Some(id), _) => {
                self.gone.borrow_mut().remove(&key(id));
                self.forget(&key(id), clips);
            }
            (ChangeKind::Drop, ..) => {
                let settled = |(key, known): (&Vec<u8>, &Known)| known.pending.is_none().then(|| key.clone());
                let settled: Vec<Vec<u8>> = self.known.borrow().iter().filter_map(settled).collect();
                settled.iter().for_each(|key| self.forget(key, clips));
            }
            (_, _, Some(after)) => {
                let document = Document::try_from(&**after).map_err(QueryError::from)?;
                if self.resync.borrow().as_deref().is_some_and(|resync| mark_of(&document) == Some(resync)) {
                    self.resynced.set(self.resynced.get() + 1);
                }
                self.take(&document, state, clips);
            }
            _ => {}
        }
        Ok(())
    }

    /// Makes the fact of a document as the document is.
    fn take(&self, document: &Document, state: &State<'_>, clips: &Environment) {
        let Some(id) = document.get("_id") else { return };
        let key = key(id);
        if self.gone.borrow().contains(&key) || self.is_older(&key, document) {
            return;
        }
        if let Err(message) = self.make(&key, id, document, clips) {
            let name = document.get_str(crate::clips::facts::RELATION).unwrap_or_default().to_owned();
            if self.strange.borrow_mut().insert(name) {
                state.sender().note(format!(
                    "{}, document {}: {message}; it is not a fact here",
                    self.namespace,
                    shell::relaxed_value(id)
                ));
            }
            self.forget(&key, clips);
        }
    }

    fn make(&self, key: &[u8], id: &Bson, document: &Document, clips: &Environment) -> Result<(), String> {
        let sync_id = integer(document.get(SYNC_ID)).ok_or("it has no integer `sync-id`")?;
        let name = document.get_str(crate::clips::facts::RELATION).unwrap_or_default();
        let schema = exchange::schema(clips, [name]);
        let template = schema.get(name).ok_or_else(|| format!("there is no deftemplate `{name}`"))?;
        if template.slot(SYNC_ID).is_none() {
            return Err(format!("the deftemplate `{name}` has no slot `sync-id`"));
        }
        let Body::Slots(slots) = exchange::exported(document, &schema)?.body else {
            return Err("it is an ordered fact".to_owned());
        };
        let slots = exchange::filled(&slots, &schema, name);
        let before = self.known.borrow().get(key).and_then(|known| known.fact.clone());
        let before = before.filter(|fact| clips.exists(fact));
        let fact = match before {
            Some(fact) if clips.template_of(&fact) == template.name => {
                let now = clips.slots(&fact);
                let differs = |slot: &&(String, Value)| !now.contains(slot);
                let changed: Vec<_> = slots.iter().filter(differs).cloned().collect();
                if changed.is_empty() { fact } else { clips.modify(&fact, &changed)? }
            }
            other => {
                if let Some(fact) = other {
                    clips.retract(&fact);
                }
                clips.assert(name, &slots)?
            }
        };
        let pending = self.known.borrow().get(key).and_then(|known| known.pending.clone());
        self.keep(key, Known { id: id.clone(), sync_id, fact: Some(fact), pending });
        Ok(())
    }

    /// Asserts a fact of a text here and in the memory.
    pub(super) fn assert(&self, text: &str, state: &State<'_>, clips: &Environment) -> Result<FactRef, String> {
        let mut fact = read(text)?;
        let schema = exchange::schema(clips, [fact.name.as_str()]);
        let template = schema.get(&fact.name).ok_or_else(|| format!("there is no deftemplate `{}`", fact.name))?;
        if template.slot(SYNC_ID).is_none() {
            return Err(format!("the deftemplate `{}` has no slot `sync-id`", fact.name));
        }
        if matches!(&fact.body, Body::Ordered(values) if values.is_empty()) {
            fact.body = Body::Slots(Vec::new());
        }
        let Body::Slots(slots) = &mut fact.body else { return Err("expected a fact with slots".to_owned()) };
        slots.retain(|slot| slot.name != SYNC_ID);
        exchange::check(&fact, &schema).map_err(|misfit| misfit.message)?;
        for nth in 1..=TRIES {
            let sync_id = number();
            let Body::Slots(slots) = &mut fact.body else { break };
            slots.retain(|slot| slot.name != SYNC_ID);
            slots.push(exchange::slot(SYNC_ID, Value::Integer(sync_id))?);
            let asserted = exchange::assert(&fact, clips)?;
            let stored = exchange::fact(&asserted, clips).and_then(|fact| exchange::imported(&fact, &schema)).and_then(
                |document| self.insert(document, sync_id, state).map_err(|error| (nth, error)).or_else(again),
            );
            match stored {
                Ok(Some(mark)) => {
                    let id = Bson::Int64(sync_id);
                    self.keep(&key(&id), Known { id, sync_id, fact: Some(asserted.clone()), pending: Some(mark) });
                    return Ok(asserted);
                }
                Ok(None) => {
                    clips.retract(&asserted);
                }
                Err(message) => {
                    clips.retract(&asserted);
                    return Err(message);
                }
            }
        }
        Err("no free `sync-id` was found".to_owned())
    }

    fn insert(&self, document: Document, sync_id: i64, state: &State<'_>) -> Result<Option<String>, StoreError> {
        let mark = self.mark();
        let mut document: Document = doc! { "_id": sync_id }.into_iter().chain(document).collect();
        document.insert(SYNC_ID, sync_id);
        let info = document.entry(metadata::INFO.to_owned()).or_insert_with(|| Bson::Document(Document::new()));
        if let Bson::Document(info) = info {
            let clips = info.entry(record::KEY.to_owned()).or_insert_with(|| Bson::Document(Document::new()));
            if let Bson::Document(clips) = clips {
                clips.insert(MARK, &mark);
            }
        }
        state.memory.insert(&self.namespace, vec![document])?;
        Ok(Some(mark))
    }

    /// Changes slots of a fact, in the memory and here. Nothing comes back where the fact is gone in the
    /// memory; then it is retracted. With `expected`, the slots have to be in the memory as they are
    /// here.
    pub(super) fn modify(
        &self,
        fact: &FactRef,
        changes: &[(String, Value)],
        expected: bool,
        state: &State<'_>,
        clips: &Environment,
    ) -> Result<Modified, String> {
        let key = self.key_of(fact, clips)?;
        let name = clips.template_of(fact);
        let schema = exchange::schema(clips, [name.as_str()]);
        let before = imported(clips.slots(fact), &name, &schema)?;
        let mut slots = clips.slots(fact);
        for (name, value) in changes {
            let slot = slots.iter_mut().find(|(slot, _)| slot == name);
            let slot = slot.ok_or_else(|| format!("`{name}` is not a slot of the fact"))?;
            if name == SYNC_ID || name.contains('.') {
                return Err(format!("the slot `{name}` cannot be changed"));
            }
            slot.1 = value.clone();
        }
        let after = imported(slots, &name, &schema)?;
        let id = self.known.borrow().get(&key).map(|known| known.id.clone()).unwrap_or(Bson::Null);
        let mut filter = doc! { "_id": id };
        let names: Vec<&str> = changes.iter().map(|(name, _)| name.as_str()).collect();
        if expected {
            let slots = names
                .iter()
                .filter_map(|name| Some(((*name).to_owned(), doc! { "$eq": before.get(*name)?.clone() }.into())));
            filter.extend(slots);
        }
        let mark = self.mark();
        let pipeline = vec![update(&before, &after, &names, &mark)];
        let updated = state.memory.update(&self.namespace, &request(filter.clone(), pipeline, false));
        if updated.map_err(|error| error.to_string())?.matched == 0 {
            if expected {
                return Ok(Modified::Differs);
            }
            self.forget(&key, clips);
            return Ok(Modified::Gone);
        }
        if let Some(known) = self.known.borrow_mut().get_mut(&key) {
            known.pending = Some(mark);
        }
        let changed = clips.modify(fact, changes)?;
        if let Some(known) = self.known.borrow_mut().get_mut(&key) {
            known.fact = Some(changed.clone());
        }
        Ok(Modified::Fact(changed))
    }

    /// The fact as it is now in the shared world, where it is there.
    pub(super) fn current(&self, sync_id: i64, clips: &Environment) -> Option<FactRef> {
        let key = self.keys.borrow().get(&sync_id).cloned()?;
        let fact = self.known.borrow().get(&key).and_then(|known| known.fact.clone());
        fact.filter(|fact| clips.exists(fact))
    }

    /// Retracts a fact, in the memory and here.
    pub(super) fn retract(&self, fact: &FactRef, state: &State<'_>, clips: &Environment) -> Result<(), String> {
        let key = self.key_of(fact, clips)?;
        let id = self.known.borrow().get(&key).map(|known| known.id.clone()).unwrap_or(Bson::Null);
        let deleted = state.memory.delete(&self.namespace, &doc! { "_id": id }, true);
        if deleted.map_err(|error| error.to_string())? > 0 {
            self.gone.borrow_mut().insert(key.clone());
        }
        self.forget(&key, clips);
        clips.retract(fact);
        Ok(())
    }

    fn key_of(&self, fact: &FactRef, clips: &Environment) -> Result<Vec<u8>, String> {
        if !clips.exists(fact) {
            return Err("the fact is gone".to_owned());
        }
        let sync_id = sync_id(fact, clips).ok_or("the fact has no `sync-id`")?;
        let key = self.keys.borrow().get(&sync_id).cloned();
        key.ok_or_else(|| "the fact is none of the shared world model".to_owned())
    }
}

/// The result of changing a fact.
pub(super) enum Modified {
    /// The fact as it is now.
    Fact(FactRef),
    /// Another engine has retracted it.
    Gone,
    /// It is not there, or not as it was expected to be.
    Differs,
}

/// The number of a fact of a shared world.
pub(super) fn sync_id(fact: &FactRef, clips: &Environment) -> Option<i64> {
    clips.slots(fact).into_iter().find_map(|(name, value)| match value {
        Value::Integer(number) if name == SYNC_ID => Some(number),
        _ => None,
    })
}

/// What a number that is taken means: another one is tried.
fn again((nth, error): (usize, StoreError)) -> Result<Option<String>, String> {
    match error {
        StoreError::Duplicate { .. } if nth < TRIES => Ok(None),
        error => Err(error.to_string()),
    }
}

/// A fact of a text.
fn read(text: &str) -> Result<Fact, String> {
    let source = Source::new("<fact>", text);
    let mut items = Reader::new(&source, []);
    match (items.next(), items.next()) {
        (Some(Ok(Item::Fact(fact))), None) => Ok(fact),
        (Some(Err(error)), _) | (_, Some(Err(error))) => Err(error.to_string()),
        _ => Err(format!("expected one fact, like \"(pose (name r1))\", found {text:?}")),
    }
}

fn imported(slots: Vec<(String, Value)>, name: &str, schema: &crate::clips::facts::Schema) -> Result<Document, String> {
    let slots = slots.into_iter().map(|(name, value)| exchange::slot(&name, value)).collect::<Result<_, _>>()?;
    exchange::imported(&Fact { name: name.to_owned(), body: Body::Slots(slots), span: Span::default() }, schema)
}

/// The stage that changes what differs, and what is noted of the types of these slots.
fn update(before: &Document, after: &Document, slots: &[&str], mark: &str) -> Document {
    let mut set = Document::new();
    for (name, value) in
        after.iter().filter(|(name, value)| *name != metadata::INFO && before.get(*name) != Some(value))
    {
        set.insert(name, doc! { "$literal": value.clone() });
    }
    let noted = after.get_document(metadata::INFO).and_then(|info| info.get_document(record::KEY)).cloned();
    let noted = noted.unwrap_or_default();
    for list in ["strings", "instances"] {
        let of_slot = |label: &Bson| {
            let slot = label.as_str().map(|label| label.rsplit_once(' ').map_or(label, |(slot, _)| slot));
            slot.is_some_and(|slot| slots.contains(&slot))
        };
        let labels: Vec<Bson> =
            noted.get_array(list).into_iter().flatten().filter(|label| of_slot(label)).cloned().collect();
        let path = format!("{}.{}.{list}", metadata::INFO, record::KEY);
        let others = doc! { "$filter": {
            "input": { "$ifNull": [format!("${path}"), []] },
            "cond": { "$not": [{ "$in": [{ "$arrayElemAt": [{ "$split": ["$$this", " "] }, 0] }, { "$literal": slots }] }] },
        } };
        set.insert(path, doc! { "$concatArrays": [others, { "$literal": labels }] });
    }
    set.insert(mark_path(), mark);
    doc! { "$set": set }
}

fn integer(value: Option<&Bson>) -> Option<i64> {
    match value? {
        Bson::Int32(number) => Some(i64::from(*number)),
        Bson::Int64(number) => Some(*number),
        _ => None,
    }
}

/// A random number, positive and exact in every language.
fn number() -> i64 {
    use std::hash::{BuildHasher as _, Hasher as _};
    let mut hasher = std::collections::hash_map::RandomState::new().build_hasher();
    hasher.write(&object_id::new().bytes());
    i64::try_from(hasher.finish() >> 11).unwrap_or(1).max(1)
}

fn request(filter: Document, pipeline: Vec<Document>, many: bool) -> UpdateRequest {
    UpdateRequest { filter, update: UpdateSpec::Pipeline(pipeline), many, ..UpdateRequest::default() }
}
