//! Names of watches: how far each is, kept in the collection `rmem.watchers` of the watched database,
//! one of those that a memory does not show.
//!
//! `{_id: NAME, namespace, token, holder, until}`: the token of the last change that is
//! done, the process that has the name, and the end of its lease, which counts where other
//! processes cannot see whether it is running. Times are the server's.

use std::time::{Duration, Instant};

use bson::{Bson, Document, Timestamp, doc};
use mongodb::change_stream::event::ResumeToken;
use mongodb::sync::Collection;

use super::{MongoDb, failure};
use crate::process::holder::{Holder, Life};
use crate::store::watch::Name;
use crate::store::{Namespace, Store as _, StoreError};

/// The collection of names.
pub(super) const COLLECTION: &str = "rmem.watchers";
/// What the names begin with that record histories (`history`).
const HISTORY: &str = "rmem.history:";
/// The lease of a process that cannot be seen from here, in milliseconds.
const LEASE: i64 = 15_000;
/// How often the lease is renewed.
const HEARTBEAT_INTERVAL: Duration = Duration::from_secs(4);
/// The server's code for a taken `_id`.
const DUPLICATE: i32 = 11_000;

/// A name that this process has.
pub(super) struct Position {
    names: Collection<Document>,
    name: String,
    myself: String,
    /// What is kept.
    token: Option<ResumeToken>,
    heartbeat: Instant,
}

impl Position {
    /// Takes the name. The token is where to go on; none where the name is new.
    pub(super) fn take(store: &MongoDb, ns: &Namespace, name: &str) -> Result<(Self, Option<ResumeToken>), StoreError> {
        let place = Namespace { database: ns.database.clone(), collection: COLLECTION.to_owned() };
        let names = store.on_primary(&place);
        let myself = Holder::myself().to_string();
        let mut position = Self { names, name: name.to_owned(), myself, token: None, heartbeat: Instant::now() };
        loop {
            let found = position.names.find_one(doc! { "_id": name }).run().map_err(|e| store.explain(&e))?;
            let Some(found) = found else {
                if position.create(store, ns)? {
                    return Ok((position, None));
                }
                continue;
            };
            check_namespace(&found, ns, name)?;
            let holder = found.get_str("holder").ok().map(str::to_owned);
            // A name that is held may be taken where its lease is over or its process seen to have ended.
            let mut free = vec![doc! { "holder": null }];
            match holder.as_deref().map(|text| (text, text.parse::<Holder>())) {
                Some((text, Ok(other)))
                    if other.life() == Life::Over || (other.life() == Life::Running && other.ends()) =>
                {
                    free.push(doc! { "holder": text });
                }
                // A release of this process may have failed; what it holds, it holds on to before its lease is over.
                Some((text, Ok(other))) if other.life() == Life::Running && text != position.myself => {
                    return Err(held(name, holder.as_deref()));
                }
                _ => free.push(doc! { "$expr": { "$lte": ["$until", "$$NOW"] } }),
            }
            let filter = doc! { "_id": name, "$or": free };
            let taken = vec![doc! { "$set": { "holder": { "$literal": &position.myself }, "until": until() } }];
            let updated = position.names.update_one(filter, taken).run().map_err(|e| store.explain(&e))?;
            if updated.matched_count > 0 {
                let token = found.get("token").cloned().and_then(|token| bson::deserialize_from_bson(token).ok());
                position.token = token.clone();
                return Ok((position, token));
            }
            return Err(held(name, holder.as_deref()));
        }
    }

    /// Creates the name; returns false where another process was faster.
    fn create(&self, store: &MongoDb, ns: &Namespace) -> Result<bool, StoreError> {
        let new = doc! {
            "namespace": { "$literal": ns.to_string() }, "holder": { "$literal": &self.myself }, "until": until(),
        };
        let filter = doc! { "_id": &self.name, "holder": &self.myself };
        match self.names.update_one(filter, vec![doc! { "$set": new }]).upsert(true).run() {
            Ok(_) => Ok(true),
            Err(error) if failure::code(&error) == Some(DUPLICATE) => Ok(false),
            Err(error) => Err(store.explain(&error)),
        }
    }

    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// Keeps how far this is.
    pub(super) fn keep(&mut self, store: &MongoDb, token: &ResumeToken) -> Result<(), StoreError> {
        if self.token.as_ref() == Some(token) {
            return Ok(());
        }
        let kept =
            bson::serialize_to_bson(token).map_err(|error| store.fail(&format!("cannot keep a position: {error}")))?;
        self.write(store, doc! { "token": { "$literal": kept }, "until": until() })?;
        self.token = Some(token.clone());
        Ok(())
    }

    /// Renews the lease, if the last renewal is a while ago.
    pub(super) fn renew(&mut self, store: &MongoDb) -> Result<(), StoreError> {
        if self.heartbeat.elapsed() < HEARTBEAT_INTERVAL {
            Ok(())
        } else {
            self.write(store, doc! { "until": until() })
        }
    }

    fn write(&mut self, store: &MongoDb, set: Document) -> Result<(), StoreError> {
        let mine = doc! { "_id": &self.name, "holder": &self.myself };
        let updated = self.names.update_one(mine, vec![doc! { "$set": set }]).run().map_err(|e| store.explain(&e))?;
        if updated.matched_count == 0 {
            return Err(StoreError::Held {
                what: format!("another process has taken over, or forgotten, the name `{}`", self.name),
            });
        }
        self.heartbeat = Instant::now();
        Ok(())
    }

    /// Releases the name.
    pub(super) fn release(&self) {
        // If it cannot be released now, it is free once its process has ended, and for that process once its lease is over.
        let mine = doc! { "_id": &self.name, "holder": &self.myself };
        let _ = self.names.update_one(mine, doc! { "$unset": { "holder": 1, "until": 1 } }).run();
    }
}

impl MongoDb {
    /// Forgets a name; returns whether there was one.
    pub(super) fn forget_name(&self, ns: &Namespace, name: &str) -> Result<bool, StoreError> {
        let place = Namespace { database: ns.database.clone(), collection: COLLECTION.to_owned() };
        let names: Collection<Document> = self.on_primary(&place);
        let found = names.find_one(doc! { "_id": name }).run().map_err(|e| self.explain(&e))?;
        let Some(found) = found else { return Ok(false) };
        check_namespace(&found, ns, name)?;
        let (position, _) = Position::take(self, ns, name)?;
        let mine = doc! { "_id": name, "holder": &position.myself };
        names.delete_one(mine).run().map_err(|e| self.explain(&e))?;
        Ok(true)
    }
}

impl MongoDb {
    /// Up to which time of the server the changes of a collection are recorded, where that is known.
    pub(super) fn recorded_until(&self, ns: &Namespace) -> Result<Option<Timestamp>, StoreError> {
        let place = Namespace { database: ns.database.clone(), collection: COLLECTION.to_owned() };
        let names: Collection<Document> = self.on_primary(&place);
        let found = names.find_one(doc! { "_id": name_of_history(ns) }).run().map_err(|e| self.explain(&e))?;
        let token = found.as_ref().and_then(|found| found.get_document("token").ok()?.get_str("_data").ok());
        Ok(token.and_then(time_of))
    }

    /// The names, with the process that follows each.
    pub(super) fn watch_names(&self) -> Result<Vec<Name>, StoreError> {
        let mut names = Vec::new();
        for place in self.collections()?.into_iter().filter(|place| place.collection == COLLECTION) {
            let kept: Collection<Document> = self.client().database(&place.database).collection(COLLECTION);
            let now = doc! { "$gt": ["$until", "$$NOW"] };
            let stages = [doc! { "$sort": { "_id": 1 } }, doc! { "$set": { "leased": now } }];
            for found in kept.aggregate(stages).run().map_err(|e| self.explain(&e))? {
                names.extend(name(&found.map_err(|e| self.explain(&e))?));
            }
        }
        Ok(names)
    }
}

fn name(found: &Document) -> Option<Name> {
    let holder = found.get_str("holder").ok().and_then(|holder| holder.parse::<Holder>().ok());
    let is_leased = found.get_bool("leased").unwrap_or(false);
    let is_followed = |holder: &Holder| match holder.life() {
        Life::Running => true,
        Life::Over => false,
        Life::Unseen | Life::Elsewhere => is_leased,
    };
    let own = found.get_str("_id").ok().filter(|name| !name.starts_with(HISTORY))?;
    Some(Name {
        name: own.to_owned(),
        namespace: Namespace::parse(found.get_str("namespace").ok()?).ok()?,
        process: holder.filter(is_followed).map(|holder| holder.process()),
        missed: false,
        waiting: None,
    })
}

fn check_namespace(found: &Document, ns: &Namespace, name: &str) -> Result<(), StoreError> {
    match found.get("namespace") {
        Some(Bson::String(other)) if *other != ns.to_string() => {
            Err(StoreError::Held { what: format!("the name `{name}` follows {other}; use another name") })
        }
        _ => Ok(()),
    }
}

fn held(name: &str, holder: Option<&str>) -> StoreError {
    let holder = holder.and_then(|text| text.parse::<Holder>().ok());
    let what = match holder.map(|holder| (holder.life(), holder.process())) {
        Some((Life::Running, process)) => {
            format!("process {process} follows changes by the name `{name}`; end it first")
        }
        _ => format!(
            "another process follows changes by the name `{name}`; end it first, or wait {} s where it was lost",
            LEASE / 1_000
        ),
    };
    StoreError::Held { what }
}

/// The end of a lease that begins now, by the server's clock.
fn until() -> Document {
    doc! { "$add": ["$$NOW", LEASE] }
}

/// The name by which a collection is recorded.
pub(super) fn name_of_history(ns: &Namespace) -> String {
    format!("{HISTORY}{}", ns.collection)
}

/// The time of the server that a token stands for: behind the type of a timestamp (130), its seconds and its number among
/// those of a second, four bytes each, the highest first (MongoDB's `KeyString`).
pub(super) fn time_of(token: &str) -> Option<Timestamp> {
    let (kind, rest) = token.split_at_checked(2)?;
    let number = |from: usize| u32::from_str_radix(rest.get(from..from + 8)?, 16).ok();
    (kind == "82").then_some(Timestamp { time: number(0)?, increment: number(8)? })
}

/// Whether a time of the server is reached, where both are known.
pub(super) fn is_behind(reached: Option<Timestamp>, until: Option<Timestamp>) -> bool {
    reached.zip(until).is_some_and(|(reached, until)| reached >= until)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_says_its_time() {
        let of_event = "826566E2A3000000072B022C0100296E5A1004";
        assert_eq!(time_of(of_event), Some(Timestamp { time: 0x6566_E2A3, increment: 7 }));
        for other in ["", "8", "82", "826566E2A3", "816566E2A300000007", "82é66E2A300000007", "82zzzzzzzz00000007"] {
            assert_eq!(time_of(other), None, "{other}");
        }
    }
}
