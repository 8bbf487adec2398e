//! Keeps `wm-fact`s in common as executives (CX) do: by their `id`, the change with the later `update-timestamp` wins.
//!
//! CX finds the facts that its rules changed by their index, which CLIPS 6.40 keeps where 6.30 gave a new one. Here they
//! are found by what they say, after rules have fired.

use std::collections::BTreeMap;

use bson::{Bson, DateTime, Document, doc};

use super::exchange;
use super::native::{Environment, FactRef, Value};
use super::state::State;
use super::wm_facts::{TEMPLATE, WmFacts, key};
use crate::error::Result;
use crate::query::QueryError;
use crate::store::{Change, ChangeKind, Find, Namespace, StoreError, UpdateRequest, UpdateSpec};

/// Where CX has the documents.
const COLLECTION: &str = "syncedrobmem.worldmodel";
/// When a document was changed.
const TIME: &str = "update-timestamp";

/// A `wm-fact` as it is now.
struct Present {
    id: String,
    key: Vec<String>,
    content: Document,
}

fn namespace() -> Result<Namespace> {
    Ok(Namespace::parse(COLLECTION)?)
}

impl WmFacts {
    /// Begins to keep facts in common whose ids begin so.
    pub(super) fn enable(&self, prefix: &str, state: &State<'_>) -> Result<()> {
        if self.prefixes.borrow().is_empty() {
            state.subscribe_wm_facts(&namespace()?)?;
        }
        self.prefixes.borrow_mut().push(key(prefix));
        Ok(())
    }

    /// Makes the facts that begin so as the documents are; returns how many there are.
    pub(super) fn restore(&self, prefix: &[String], state: &State<'_>, clips: &Environment) -> Result<u64> {
        let mut count = 0;
        let found = state.memory.find(&namespace()?, &Find::default())?;
        let documents = found.map(|document| Ok(Document::try_from(&*document?).map_err(QueryError::from)?));
        for document in documents.collect::<Result<Vec<_>>>()? {
            if document.get_str("_id").is_ok_and(|id| key(id).starts_with(prefix)) {
                self.take(&document, state, clips);
                count += 1;
            }
        }
        Ok(count)
    }

    /// Removes all documents; the facts stay.
    pub(super) fn flush(&self, state: &State<'_>) -> Result<u64> {
        Ok(state.memory.delete(&namespace()?, &Document::new(), false)?)
    }

    /// Writes what rules have changed since the last time. Until the fact `/cx/identity` says who this is, nothing is
    /// written.
    pub(super) fn push(&self, state: &State<'_>, clips: &Environment) {
        if self.prefixes.borrow().is_empty() {
            return;
        }
        let (mut identity, mut present) = (None, BTreeMap::new());
        for fact in clips.facts_of(TEMPLATE) {
            let Some(found) = read(&fact, state, clips) else { continue };
            if found.key == ["cx", "identity"] {
                identity = found.content.get("value").cloned();
            }
            if self.is_enabled(&found.key) {
                present.insert(found.id, found.content);
            }
        }
        let Some(identity) = identity else {
            if !present.is_empty() && !self.is_told.replace(true) {
                clips.complain(
                    "[RMEM4] wm-robmem-sync: nothing is shared until a wm-fact with the id \"/cx/identity\" says who this is",
                );
            }
            return;
        };
        let now = DateTime::now();
        let removed = |(id, known): (&String, &super::wm_facts::Known)| {
            (known.content.is_some() && !present.contains_key(id)).then(|| id.clone())
        };
        let removed: Vec<String> = self.known.borrow().iter().filter_map(removed).collect();
        let written = present.into_iter().map(|(id, content)| (id, Some(content)));
        for (id, content) in written.chain(removed.into_iter().map(|id| (id, None))) {
            if self.known.borrow().get(&id).is_some_and(|known| known.content == content) {
                continue;
            }
            if let Err(error) = write(&id, content.as_ref(), &identity, now, state) {
                clips.complain(&format!("[RMEM3] {COLLECTION}, {id}: {error:#}"));
                continue;
            }
            self.keep(&id, content, now);
        }
    }

    /// Takes in a change of the memory.
    pub(super) fn receive(&self, change: &Change, state: &State<'_>, clips: &Environment) -> Result<()> {
        match (change.kind, &change.id, &change.after) {
            (ChangeKind::Delete, Some(Bson::String(id)), _) => {
                let is_there = state.memory.count(&namespace()?, &doc! { "_id": id })? > 0;
                let is_newer = self.known.borrow().get(id).is_none_or(|known| known.time < change.time);
                if self.is_enabled(&key(id)) && is_newer && !is_there {
                    self.keep(id, None, change.time);
                    if let Some(fact) = find(id, state, clips) {
                        clips.retract(&fact);
                    }
                }
            }
            (ChangeKind::Insert | ChangeKind::Update | ChangeKind::Replace, _, Some(after)) => {
                let document = Document::try_from(&**after).map_err(QueryError::from)?;
                self.take(&document, state, clips);
            }
            _ => {}
        }
        Ok(())
    }

    /// Makes the fact of a document as the document is, where that is newer.
    fn take(&self, document: &Document, state: &State<'_>, clips: &Environment) {
        let Ok(id) = document.get_str("_id") else { return };
        let time = document.get_datetime(TIME).copied().unwrap_or(DateTime::from_millis(0));
        let is_newer = self.known.borrow().get(id).is_none_or(|known| known.time < time);
        if !is_newer || !self.is_enabled(&key(id)) {
            return;
        }
        match make(id, document, state, clips) {
            Ok(fact) => self.keep(id, read(&fact, state, clips).map(|present| present.content), time),
            Err(message) => clips.complain(&format!("[RMEM4] {COLLECTION}, {id}: {message}")),
        }
    }
}

/// Asserts or changes the fact of a document.
fn make(id: &str, document: &Document, state: &State<'_>, clips: &Environment) -> Result<FactRef, String> {
    let kind = document.get_str("type").unwrap_or("UNKNOWN");
    let symbol = |text: &str| Value::Symbol(text.to_owned());
    let is_list = document.get("is-list").is_some_and(|flag| matches!(flag, Bson::Boolean(true)));
    let value = |value: &Bson| match value {
        Bson::String(text) if matches!(kind, "SYMBOL" | "BOOL") => symbol(text),
        value => exchange::to_value(value, &mut state.table.borrow_mut()),
    };
    let values = document.get_array("values").ok().filter(|_| is_list);
    let content = vec![
        ("type".to_owned(), symbol(kind)),
        ("is-list".to_owned(), Value::truth(is_list)),
        ("value".to_owned(), document.get("value").filter(|_| !is_list).map_or_else(|| symbol("nil"), value)),
        ("values".to_owned(), Value::Many(values.into_iter().flatten().map(value).collect())),
    ];
    if let Some(fact) = find(id, state, clips) {
        return clips.modify(&fact, &content);
    }
    let key = key(id).iter().map(|word| symbol(word)).collect();
    let name = [("id".to_owned(), Value::Text(id.to_owned())), ("key".to_owned(), Value::Many(key))];
    clips.assert(TEMPLATE, &name.into_iter().chain(content).collect::<Vec<_>>())
}

/// The fact with this id.
fn find(id: &str, state: &State<'_>, clips: &Environment) -> Option<FactRef> {
    clips.facts_of(TEMPLATE).into_iter().find(|fact| read(fact, state, clips).is_some_and(|present| present.id == id))
}

/// What a fact says; nothing where it has no id yet, or holds what no document can.
fn read(fact: &FactRef, state: &State<'_>, clips: &Environment) -> Option<Present> {
    let slots = clips.slots(fact);
    let slot = |name: &str| slots.iter().find(|(slot, _)| slot == name).map(|(_, value)| value);
    let id = match slot("id")? {
        Value::Text(id) | Value::Symbol(id) if !id.is_empty() => id.clone(),
        _ => return None,
    };
    let is_list = slot("is-list") == Some(&Value::truth(true));
    let name = if is_list { "values" } else { "value" };
    let mut content = Document::new();
    for name in ["type", "is-list", name] {
        content.insert(name, exchange::to_bson(slot(name)?, &mut state.table.borrow_mut()).ok()?);
    }
    Some(Present { key: key(&id), id, content })
}

/// Writes a fact, or removes its document, unless the memory has a later change of it.
fn write(id: &str, content: Option<&Document>, identity: &Bson, now: DateTime, state: &State<'_>) -> Result<()> {
    let filter = doc! { "_id": id, TIME: { "$lte": now } };
    let Some(content) = content else {
        state.memory.delete(&namespace()?, &filter, true)?;
        return Ok(());
    };
    let mut document = doc! { TIME: now, "source": identity.clone() };
    document.extend(content.clone());
    let update = UpdateSpec::Document(document);
    let request = UpdateRequest { filter, update, upsert: true, ..UpdateRequest::default() };
    match state.memory.update(&namespace()?, &request) {
        // The document has a later change, which is on its way here.
        Ok(_) | Err(StoreError::Duplicate { .. }) => Ok(()),
        Err(error) => Err(error.into()),
    }
}
