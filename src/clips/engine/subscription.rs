//! Following changes of the memory while rules fire.

use std::time::Duration;

use bson::{Bson, Document, doc};

use super::exchange;
use super::native::{Environment, Value};
use super::state::State;
use super::subscriptions::{Subscriber, Subscription};
use super::table::Thing;
use crate::clips::facts;
use crate::error::Result;
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
    /// Subscribes a trigger; returns its number.
    pub(super) fn subscribe_trigger(&self, ns: &Namespace, filter: Document, name: String) -> Result<u64, StoreError> {
        let number = self.subscriptions.number.get() + 1;
        self.subscriptions.number.set(number);
        self.subscribe(Subscriber::Trigger(number, name), ns, filter, false)?;
        Ok(number)
    }

    /// Subscribes the shared world model.
    pub(super) fn subscribe_world(&self, ns: &Namespace) -> Result<(), StoreError> {
        self.subscribe(Subscriber::WorldModel, ns, Document::new(), true)
    }

    /// Subscribes the world model of executives.
    pub(super) fn subscribe_wm_facts(&self, ns: &Namespace) -> Result<(), StoreError> {
        self.subscribe(Subscriber::WmFacts, ns, Document::new(), false)
    }

    fn subscribe(
        &self,
        subscriber: Subscriber,
        namespace: &Namespace,
        filter: Document,
        metadata: bool,
    ) -> Result<(), StoreError> {
        let trigger = Trigger { namespace: namespace.clone(), filter, name: None, computed: false, metadata };
        let watch = self.memory.watch(trigger)?;
        let subscription = Subscription { subscriber, namespace: namespace.clone(), watch, lost: false };
        self.subscriptions.all.borrow_mut().push(subscription);
        self.subscriptions.count.set(self.subscriptions.count.get() + 1);
        Ok(())
    }

    /// Ends the subscription of a trigger.
    pub(super) fn forget_trigger(&self, number: u64) {
        self.subscriptions.ended.borrow_mut().push(number);
    }

    /// Whether there are subscriptions.
    pub(super) fn is_subscribed(&self) -> bool {
        self.subscriptions.count.get() > 0
    }

    /// Whether the last call of [`State::receive`] waited for nothing.
    pub(super) fn is_resting(&self) -> bool {
        self.subscriptions.resting.get()
    }

    /// Delivers changes to CLIPS, with `wait` after waiting for them; returns whether there were any.
    ///
    /// # Errors
    /// Where nothing more will come from a store.
    pub(super) fn receive(&self, clips: &Environment, wait: bool) -> Result<bool> {
        // Functions that are called meanwhile may add subscriptions.
        let mut open = std::mem::take(&mut *self.subscriptions.all.borrow_mut());
        let received = self.poll(&mut open, clips, wait);
        let ended = std::mem::take(&mut *self.subscriptions.ended.borrow_mut());
        let mut added = self.subscriptions.all.borrow_mut();
        open.append(&mut added);
        open.retain(|subscription| !matches!(subscription.subscriber, Subscriber::Trigger(number, _) if ended.contains(&number)));
        self.subscriptions.count.set(open.len());
        *added = open;
        let received = received?;
        self.subscriptions.resting.set(wait && !received);
        Ok(received)
    }

    fn poll(&self, open: &mut [Subscription<'m>], clips: &Environment, wait: bool) -> Result<bool> {
        let count = u32::try_from(open.len()).unwrap_or(u32::MAX).max(1);
        let left = self
            .stop()
            .deadline()
            .map_or(POLL_INTERVAL, |deadline| deadline.saturating_duration_since(std::time::Instant::now()));
        let timeout = if wait { POLL_INTERVAL.min(left) / count } else { Duration::ZERO };
        let mut received = false;
        for subscription in open {
            let mut timeout = timeout;
            let (mut taken, burst) =
                (0, if matches!(subscription.subscriber, Subscriber::Trigger(..)) { 1 } else { BURST });
            while taken < burst {
                match subscription.watch.next(timeout)? {
                    Next::Nothing => break,
                    Next::Interrupted(error) => {
                        if !std::mem::replace(&mut subscription.lost, true) {
                            clips.complain(&format!("[RMEM3] {error}; trying again"));
                        }
                        break;
                    }
                    Next::Change(change) => {
                        subscription.lost = false;
                        self.deliver(&subscription.subscriber, &subscription.namespace, &change, clips)?;
                        taken += 1;
                    }
                }
                timeout = Duration::ZERO;
            }
            if taken > 0 || wait {
                subscription.watch.done()?;
            }
            received |= taken > 0;
        }
        Ok(received)
    }

    fn deliver(&self, subscriber: &Subscriber, ns: &Namespace, change: &Change, clips: &Environment) -> Result<()> {
        match subscriber {
            Subscriber::WorldModel => self.world.receive(change, self, clips),
            Subscriber::WmFacts => self.wm_facts.receive(change, self, clips),
            Subscriber::Trigger(_, name) => {
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
        let delivered = facts::trigger(Some(name), event, facts::now()).map_err(|error| error.to_string())?;
        let address = self.table.borrow_mut().add(Thing::Document(with_oplog(event, kind)));
        let schema = exchange::schema(clips, ["robmem-trigger"]);
        for fact in &delivered {
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

/// The change with the keys that MongoDB's log and its change streams have for it, which Fawkes' agents read. They know
/// insert, update and delete only, and a document that took the place of another one as an update.
fn with_oplog(event: &Document, kind: ChangeKind) -> Document {
    let mut document = event.clone();
    document.insert("operationType", if kind == ChangeKind::Replace { "update" } else { kind.name() });
    for (key, original) in [("clusterTime", "time"), ("fullDocument", "after")] {
        document.extend(event.get(original).map(|value| (key.to_owned(), value.clone())));
    }
    document.extend(event.get("_id").map(|id| ("documentKey".to_owned(), Bson::Document(doc! { "_id": id.clone() }))));
    let letter = match kind {
        ChangeKind::Insert => "i",
        ChangeKind::Update | ChangeKind::Replace => "u",
        ChangeKind::Delete => "d",
        ChangeKind::Drop | ChangeKind::DropDatabase | ChangeKind::Rename => "c",
    };
    document.insert("op", letter);
    if let Some(object) = event.get("after").or_else(|| event.get("before")) {
        document.insert("o", object.clone());
    } else if let Some(id) = event.get("_id") {
        document.insert("o", doc! { "_id": id.clone() });
    }
    document
}
