//! Obtaining what the cache has for a query, and computing it again where its time is over.
//!
//! A process that computes claims the entry first, so that no other one does the same. Where the last computation was
//! quick, and needed no other one, that would take longer than computing: it is done within the transaction that stores
//! what it makes, for which other writers wait. Where it is not quick any more, it is given up and done without.

use std::time::{Duration, Instant};

use bson::oid::ObjectId;
use bson::{Bson, Document};

use super::answer::{Held, Made, failed};
use super::body::ComputeError;
use super::cache::{self, Done, Entry, Former, Lifetime, State, after};
use super::definition::BodyKind;
use super::state::{COMPUTE_TIMEOUT, Others, Wanted, Within};
use super::storing::{self, remove};
use crate::memory::Memory;
use crate::query::object_id;
use crate::store::{Namespace, Store, StoreError};

/// How long a waiting process sleeps at first …
const MIN_BACKOFF: Duration = Duration::from_millis(2);
/// … and at most.
const MAX_BACKOFF: Duration = Duration::from_millis(50);

/// How long a computation may read while writers wait.
const READ_TIME_LIMIT: Duration = Duration::from_millis(30);

/// What was obtained, whether the cache had it, and how many documents it is.
type Obtained = (Held, bool, u64);

/// A computation whose time is over.
struct Renewal<'a> {
    store: &'a dyn Store,
    entry: Entry<'a>,
    wanted: &'a Wanted<'a>,
    others: Others<'a>,
    /// How long what is computed is good.
    good_for: Duration,
    /// How long computing may take.
    timeout: Duration,
}

impl Renewal<'_> {
    fn held(&self, token: ObjectId, life: Lifetime, made: Made) -> Held {
        let namespace = self.wanted.computable.definition.namespace.clone();
        Held { namespace, key: self.wanted.key.clone(), token, life, made, state: None }
    }
}

impl Memory {
    pub(super) fn obtain_cached(
        &self,
        wanted: &Wanted<'_>,
        others: Others<'_>,
        good_for: Duration,
    ) -> Result<Obtained, StoreError> {
        let ns = &wanted.computable.definition.namespace;
        let store = self.routes.keeping(ns)?;
        let entry = Entry::new(store, ns, wanted.key.clone());
        let timeout = wanted.computable.body.timeout().map_or(COMPUTE_TIMEOUT, |timeout| timeout + COMPUTE_TIMEOUT);
        let renewal = Renewal { store, entry, wanted, others, good_for, timeout };
        let (started, mut pause) = (Instant::now(), MIN_BACKOFF);
        loop {
            match renewal.entry.state(self.clock.now(), good_for)? {
                State::Good { token, until, documents } => {
                    let life = Lifetime { until, kept: until };
                    return Ok((renewal.held(token, life, Made::Before), true, documents));
                }
                State::Busy { .. } if started.elapsed() < timeout * 2 => {
                    self.check_cycle(wanted)?;
                    self.check_within()?;
                    std::thread::sleep(pause);
                    pause = (pause * 2).min(MAX_BACKOFF);
                }
                State::Busy { until } => {
                    let words = format!("another process has been computing it for long, and may until {until}");
                    return Err(failed(wanted, ComputeError::Failed(words)));
                }
                State::Stale(former) => {
                    let renewed = match &former {
                        Some(former) if self.may_be_within(&renewal, former) => self.renew_within(&renewal, former)?,
                        _ => self.renew(&renewal, former.as_ref())?,
                    };
                    if let Some(renewed) = renewed {
                        return Ok(renewed);
                    }
                }
            }
        }
    }

    /// Claims the entry, computes, and stores what that gives. Returns nothing where another process has the entry.
    fn renew(&self, renewal: &Renewal<'_>, former: Option<&Former>) -> Result<Option<Obtained>, StoreError> {
        let Renewal { store, entry, wanted, .. } = renewal;
        let (definition, now) = (&wanted.computable.definition, self.clock.now());
        let (token, until) = (object_id::new(), after(now, renewal.timeout));
        let mut is_claimed = false;
        cache::write(*store, || {
            is_claimed = entry.claim(former, definition, wanted.query, token, until)?;
            Ok(())
        })
        .map_err(|error| storing::unstorable(definition, error))?;
        if !is_claimed {
            return Ok(None);
        }
        let mut kept = None;
        let made = self.timed(renewal).and_then(|(documents, took)| {
            let life = self.life(renewal);
            let mut documents = Some(documents);
            cache::write(*store, || {
                let ids = self.keep(renewal, former, documents.take().unwrap_or_default(), token, life)?;
                if !entry.finish(Done { token, ids: &ids, life, took })? {
                    // Another process has claimed the entry, because this one took too long.
                    return remove(*store, &definition.namespace, &ids, token);
                }
                let count = ids.len() as u64;
                kept = Some((renewal.held(token, life, Made::Now(ids)), false, count));
                entry.sweep(now)
            })
        });
        if let Err(error) = made {
            entry.release(token, self.clock.now())?;
            return Err(error);
        }
        Ok(kept)
    }

    /// Computes within the transaction that stores what that gives. Returns nothing where another process was quicker.
    fn renew_within(&self, renewal: &Renewal<'_>, former: &Former) -> Result<Option<Obtained>, StoreError> {
        let Renewal { store, entry, wanted, .. } = renewal;
        let definition = &wanted.computable.definition;
        let (token, mut until) = (object_id::new(), None);
        let before = self.computables.computed.borrow().len();
        let depth = self.computables.running.borrow().len();
        self.computables.within.set(Some(Within { depth, is_refused: false }));
        let (mut kept, mut is_known) = (None, false);
        let made = cache::write(*store, || {
            if !entry.is_still(former)? {
                return Ok(());
            }
            let (begun, mut computed) = (store.state(), (Vec::new(), None));
            let end = *until.insert(Instant::now() + READ_TIME_LIMIT);
            store.reading_until(end, &mut || {
                computed = self.timed(renewal)?;
                Ok(())
            })?;
            let (documents, took) = computed;
            // Nothing else was written since the computables were read, and by the body neither.
            is_known = store.state() == begun && self.has_read_computables(definition, entry.seen(), begun);
            let life = self.life(renewal);
            let ids = self.keep(renewal, Some(former), documents, token, life)?;
            entry.replace(former, Done { token, ids: &ids, life, took })?;
            let count = ids.len() as u64;
            let held = renewal.held(token, life, Made::Now(ids));
            kept = Some((Held { state: store.state(), ..held }, false, count));
            Ok(())
        });
        let is_refused = self.computables.within.take().is_some_and(|within| within.is_refused);
        match made {
            Ok(()) => {
                if let Some((held, ..)) = kept.as_ref().filter(|_| is_known) {
                    self.keep_computables_read(&definition.namespace, held.state);
                }
                Ok(kept)
            }
            // Nothing of it was kept.
            Err(_) if is_refused || until.is_some_and(|until| Instant::now() >= until) => {
                self.computables.computed.borrow_mut().truncate(before);
                self.renew(renewal, Some(former))
            }
            Err(error) => Err(error),
        }
    }

    /// Stores what was computed in place of what was computed before; returns the `_id`s.
    fn keep(
        &self,
        renewal: &Renewal<'_>,
        former: Option<&Former>,
        documents: Vec<Document>,
        token: ObjectId,
        life: Lifetime,
    ) -> Result<Vec<Bson>, StoreError> {
        former.into_iter().try_for_each(|former| renewal.entry.clear(former))?;
        let definition = &renewal.wanted.computable.definition;
        let documents = storing::marked(definition, documents, token, life, self.clock.now())?;
        storing::insert(renewal.store, definition, documents, token)
    }

    /// Whether a computation may be a part of a write: its last run was quick, and it looks at nothing but this file.
    fn may_be_within(&self, renewal: &Renewal<'_>, former: &Former) -> bool {
        let computable = &renewal.wanted.computable;
        let ns = &computable.definition.namespace;
        let is_near = |source: &Namespace| self.routes.is_shared(source) == self.routes.is_shared(ns);
        former.was_quick()
            && renewal.store.is_atomic()
            && self.computables.within.get().is_none()
            && !matches!(computable.definition.body, BodyKind::Command { .. })
            && computable.body.sources(ns).iter().all(is_near)
    }

    /// Runs the body; returns how long it took, where no other computation was a part of it.
    fn timed(&self, renewal: &Renewal<'_>) -> Result<(Vec<Document>, Option<Duration>), StoreError> {
        let (started, runs) = (Instant::now(), self.computables.runs.get());
        let documents = self.compute(renewal.wanted, renewal.others, None)?;
        let is_alone = self.computables.runs.get() == runs + 1;
        Ok((documents, is_alone.then(|| started.elapsed())))
    }

    fn life(&self, renewal: &Renewal<'_>) -> Lifetime {
        let (done, good_for) = (self.clock.now(), renewal.good_for);
        Lifetime { until: after(done, good_for), kept: after(done, good_for.max(renewal.others.time())) }
    }

    /// Refuses a computation that one needs which is a part of a write.
    pub(super) fn check_within(&self) -> Result<(), StoreError> {
        match self.computables.within.get() {
            Some(within) if self.computables.running.borrow().len() > within.depth => {
                self.computables.within.set(Some(Within { is_refused: true, ..within }));
                Err(StoreError::Held { what: "a computation that writers wait for needs another one".to_owned() })
            }
            _ => Ok(()),
        }
    }
}
