//! Following changes of the memory while rules fire.

use std::time::Duration;

use bson::{Document, doc};

use super::exchange;
use super::listeners::{Listener, Who};
use super::native::{Environment, Value};
use super::state::State;
use super::table::Thing;
use crate::clips::facts;
use crate::memory::watch::{Trigger, event};
use crate::store::{Change, ChangeKind, Namespace, Next, StoreError};

/// How many changes of the world model are taken in before rules fire again. Of those that a trigger is
/// about it is one, so that rules see them in their order, whatever CLIPS does with what is new.
const BURST: usize = 500;
/// How long one waits for changes at a stretch, where no rule can fire.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// The facts of triggers. `ptr` is the change as a document.
pub(super) const TEMPLATE: &str = "(deftemplate robmem-trigger
   (slot name (type STRING))
   (multislot rcvd-at (type INTEGER))
   (slot ptr (type EXTERNAL-ADDRESS SYMBOL) (default nil))
   (slot operation (type SYMBOL))
   (slot namespace (type STRING))
   (slot id (type STRING))
   (slot before (type STRING))
   (slot after (type STRING)))
";

impl<'m> State<'m> {
    /// Begins to follow what a trigger wants; gives its number.
    pub(super) fn listen_for_trigger(&self, ns: &Namespace, filter: Document, name: String) -> Result<u64, StoreError> {
        let number = self.listening.number.get() + 1;
        self.listening.number.set(number);
        self.listen(Who::Trigger(number, name), ns, filter, false)?;
        Ok(number)
    }

    /// Begins to follow the shared world model.
    pub(super) fn listen_for_world(&self, ns: &Namespace) -> Result<(), StoreError> {
        self.listen(Who::WorldModel, ns, Document::new(), true)
    }

    fn listen(&self, who: Who, namespace: &Namespace, filter: Document, metadata: bool) -> Result<(), StoreError> {
        let trigger = Trigger { namespace: namespace.clone(), filter, name: None, computed: false, metadata };
        let watch = self.memory.watch(trigger)?;
        let listener = Listener { who, namespace: namespace.clone(), watch, lost: false };
        self.listening.listeners.borrow_mut().push(listener);
        self.listening.count.set(self.listening.count.get() + 1);
        Ok(())
    }

    /// Follows a trigger no longer; says whether it was followed.
    pub(super) fn forget_trigger(&self, number: u64) {
        self.listening.ended.borrow_mut().push(number);
    }

    /// Whether anything is followed.
    pub(super) fn is_listening(&self) -> bool {
        self.listening.count.get() > 0
    }

    /// Whether the last thing that happened was waiting.
    pub(super) fn is_resting(&self) -> bool {
        self.listening.resting.get()
    }

    /// Tells CLIPS what has changed, waiting for it where `wait` says so; says whether anything has.
    ///
    /// # Errors
    /// Where nothing more will come from a store.
    pub(super) fn hear(&self, clips: &Environment, wait: bool) -> anyhow::Result<bool> {
        // Functions that are called meanwhile may add listeners.
        let mut listeners = std::mem::take(&mut *self.listening.listeners.borrow_mut());
        let heard = self.ask(&mut listeners, clips, wait);
        let ended = std::mem::take(&mut *self.listening.ended.borrow_mut());
        let mut added = self.listening.listeners.borrow_mut();
        listeners.append(&mut added);
        listeners.retain(|listener| !matches!(listener.who, Who::Trigger(number, _) if ended.contains(&number)));
        self.listening.count.set(listeners.len());
        *added = listeners;
        let heard = heard?;
        self.listening.resting.set(wait && !heard);
        Ok(heard)
    }

    fn ask(&self, listeners: &mut [Listener<'m>], clips: &Environment, wait: bool) -> anyhow::Result<bool> {
        let count = u32::try_from(listeners.len()).unwrap_or(u32::MAX).max(1);
        let left = self
            .stop()
            .deadline()
            .map_or(POLL_INTERVAL, |deadline| deadline.saturating_duration_since(std::time::Instant::now()));
        let timeout = if wait { POLL_INTERVAL.min(left) / count } else { Duration::ZERO };
        let mut heard = false;
        for listener in listeners {
            let mut timeout = timeout;
            let (mut taken, burst) = (0, if matches!(listener.who, Who::WorldModel) { BURST } else { 1 });
            while taken < burst {
                match listener.watch.next(timeout)? {
                    Next::Nothing => break,
                    Next::Interrupted(error) => {
                        if !std::mem::replace(&mut listener.lost, true) {
                            clips.complain(&format!("[RMEM3] {error}; trying again"));
                        }
                        break;
                    }
                    Next::Change(change) => {
                        listener.lost = false;
                        self.tell(&listener.who, &listener.namespace, &change, clips)?;
                        taken += 1;
                    }
                }
                timeout = Duration::ZERO;
            }
            if taken > 0 || wait {
                listener.watch.done()?;
            }
            heard |= taken > 0;
        }
        Ok(heard)
    }

    fn tell(&self, who: &Who, ns: &Namespace, change: &Change, clips: &Environment) -> anyhow::Result<()> {
        match who {
            Who::WorldModel => self.world.hear(change, self, clips),
            Who::Trigger(_, name) => {
                let event = event(ns, change)?;
                if let Err(message) = self.assert_trigger(name, &event, change.kind, clips) {
                    clips.complain(&format!("[RMEM4] Trigger '{name}': {message}"));
                }
                Ok(())
            }
        }
    }

    /// Asserts the facts of a trigger: those of [`facts::trigger`], with the change as a document.
    fn assert_trigger(
        &self,
        name: &str,
        event: &Document,
        kind: ChangeKind,
        clips: &Environment,
    ) -> Result<(), String> {
        let told = facts::trigger(Some(name), event, facts::now()).map_err(|error| error.to_string())?;
        let address = self.table.borrow_mut().add(Thing::Document(with_oplog(event, kind)));
        let schema = exchange::schema(clips, ["robmem-trigger"]);
        for fact in &told {
            if fact.name != "robmem-trigger" {
                exchange::assert(fact, clips)?;
                continue;
            }
            let crate::formats::clips::Body::Slots(slots) = &fact.body else { continue };
            let template = schema.get("robmem-trigger");
            // An agent may have its own template, with fewer slots.
            let known = |slot: &str| template.is_none_or(|template| template.slot(slot).is_some());
            let mut values = exchange::filled(slots, &schema, "robmem-trigger");
            values.push(("ptr".to_owned(), Value::Address(address)));
            values.retain(|(slot, _)| known(slot));
            clips.assert("robmem-trigger", &values)?;
        }
        Ok(())
    }
}

/// The change with the keys that MongoDB's log has for it, which Fawkes' agents read.
fn with_oplog(event: &Document, kind: ChangeKind) -> Document {
    let mut document = event.clone();
    let letter = match kind {
        ChangeKind::Insert => "i",
        ChangeKind::Update | ChangeKind::Replace => "u",
        ChangeKind::Delete => "d",
        ChangeKind::Drop => "c",
    };
    document.insert("op", letter);
    if let Some(object) = event.get("after").or_else(|| event.get("before")) {
        document.insert("o", object.clone());
    } else if let Some(id) = event.get("_id") {
        document.insert("o", doc! { "_id": id.clone() });
    }
    document
}
