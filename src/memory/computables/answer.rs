//! Answering: compute what a query needs, then ask the store.

use std::time::Instant;

use bson::oid::ObjectId;
use bson::{Bson, Document, RawDocumentBuf, doc};

use super::body::{Asked, ComputeError, Source};
use super::cache::{self, Lifetime, after};
use super::extended;
use super::questions::{questions, visible_stages};
use super::report::Computed;
use super::state::{COMPUTE_TIMEOUT, Others, Running, Wanted};
use super::storing::remove;
use super::view::{Answering, View};
use crate::fault::{AtFault, Fault};
use crate::memory::journal::Operation;
use crate::memory::operations::Memory;
use crate::query::{QueryError, field, object_id};
use crate::store::{Aggregation, Documents, Find, Modifiers, Namespace, StoreError, metadata};

/// How often an answer is made from shared computations; where they were replaced meanwhile each time, the next one
/// computes for its query alone.
const ATTEMPTS: usize = 5;
/// How deep computables may depend on each other.
const DEPTH: usize = 16;
/// At most so many documents of one computation.
const MOST_DOCUMENTS: usize = 100_000;

/// A computation whose documents count.
pub(super) struct Held {
    pub(super) namespace: Namespace,
    pub(super) key: String,
    pub(super) token: ObjectId,
    pub(super) life: Lifetime,
    pub(super) made: Made,
    /// The state of the store with these documents, where it is known; see [`Store::state`](crate::store::Store::state).
    pub(super) state: Option<(i64, u64)>,
}

/// For whom the documents of a computation were made.
pub(super) enum Made {
    /// For an earlier query: the cache had them.
    Before,
    /// For this query, and for those that ask the same while the cache holds; their `_id`s.
    Now(Vec<Bson>),
    /// For this query alone ([`super::once`]).
    Alone,
}

impl Held {
    fn is_shared(&self) -> bool {
        !matches!(self.made, Made::Alone)
    }
}

/// The `_id`s of documents.
fn ids(documents: &[RawDocumentBuf]) -> Vec<Bson> {
    documents.iter().filter_map(|document| field(document, "_id").and_then(|id| Bson::try_from(id).ok())).collect()
}

impl Source for Memory {
    fn find(&self, ns: &Namespace, find: &Find) -> Result<Documents<'_>, StoreError> {
        Self::find(self, ns, find)
    }

    fn aggregate(&self, ns: &Namespace, pipeline: &[Document]) -> Result<Documents<'_>, StoreError> {
        Self::aggregate(self, ns, pipeline)
    }

    fn aggregate_over(
        &self,
        ns: &Namespace,
        documents: &[RawDocumentBuf],
        pipeline: &[Document],
    ) -> Result<Documents<'_>, StoreError> {
        // The documents are asked for by their `_id`s, of which there may be many: that is made only where it is looked at.
        let asks_for_ids = self.registry(ns)?.may_match(ns, "_id");
        let stages = |documents| {
            let chosen = doc! { "$match": { "_id": { "$in": ids(documents) } } };
            std::iter::once(chosen).chain(pipeline.iter().cloned()).collect::<Vec<Document>>()
        };
        let asked = questions(ns, &stages(if asks_for_ids { documents } else { &[] }));
        let asked: Vec<_> = asked.iter().map(|(ns, query)| (ns, query)).collect();
        if let (wanted, false) = self.wanted(&asked)?
            && wanted.is_empty()
        {
            let stages = visible_stages(ns, pipeline, &self.computables.view(self.clock.now()), false);
            let modifiers = Modifiers { collation: self.collation(ns)?, ..Modifiers::default() };
            let aggregation = Aggregation { stages: &stages, modifiers: &modifiers };
            if let Some(results) = extended::run(aggregation, documents)? {
                return Ok(Box::new(results.into_iter().map(|document| Ok(metadata::hide_within(document)?))));
            }
        }
        Self::aggregate(self, ns, &stages(documents))
    }
}

impl Memory {
    /// Does `work` once all that the questions need is computed.
    pub(in crate::memory) fn answer<T>(
        &self,
        questions: &[(&Namespace, &Document)],
        answering: Answering,
        mut work: impl FnMut(&View) -> Result<T, StoreError>,
    ) -> Result<T, StoreError> {
        let _operation = self.computables.operate();
        let (wanted, adds_keys) = self.wanted(questions)?;
        self.computables.forget_last();
        let mut work = |view: &View| {
            if answering != Answering::Reading {
                self.store_once()?;
            }
            work(view)
        };
        if wanted.is_empty() {
            return work(&self.computables.view(self.clock.now()).with_keys(adds_keys));
        }
        let mut held = Vec::new();
        let mut work = |view: View| work(&view.with_keys(adds_keys));
        let answered = self.answer_computed(&wanted, answering != Answering::Writing, &mut held, &mut work);
        let tidied = held.iter().try_for_each(|held: &Held| self.tidy(held));
        answered.and_then(|answer| tidied.map(|()| answer))
    }

    fn answer_computed<T>(
        &self,
        all: &[Wanted<'_>],
        is_repeatable: bool,
        held: &mut Vec<Held>,
        work: &mut impl FnMut(View) -> Result<T, StoreError>,
    ) -> Result<T, StoreError> {
        let (mut attempt, mut computed) = (0, Vec::new());
        loop {
            attempt += 1;
            let alone = attempt > ATTEMPTS;
            if alone {
                held.retain(|held| !held.is_shared());
            }
            let mut view = self.computables.view(self.clock.now());
            held.iter().for_each(|held| view.allow(held.token));
            for (index, wanted) in all.iter().enumerate() {
                if !held.iter().any(|held| held.key == wanted.key) {
                    let earlier: Vec<ObjectId> = held.iter().map(|held| held.token).collect();
                    let others = Others { earlier: &earlier, later: all.get(index + 1..).unwrap_or_default() };
                    // What was computed for this query and then replaced by another process is not shared again.
                    let obtained = self.obtain(wanted, others, alone || computed.contains(&wanted.key))?;
                    view.allow(obtained.token);
                    if matches!(obtained.made, Made::Now(_)) {
                        computed.push(obtained.key.clone());
                    }
                    held.push(obtained);
                }
            }
            let answer = work(view)?;
            if !is_repeatable || alone || self.still_holds(held)? {
                return Ok(answer);
            }
        }
    }

    /// Whether all computed documents of an answer existed all the time. Removes the others from `held`.
    fn still_holds(&self, held: &mut Vec<Held>) -> Result<bool, StoreError> {
        if let [Held { namespace, state: Some(state), .. }] = held.as_slice()
            && self.state(namespace)? == Some(*state)
        {
            return Ok(true);
        }
        let now = self.clock.now();
        let mut current = Vec::new();
        let mut namespaces: Vec<&Namespace> =
            held.iter().filter(|held| held.is_shared()).map(|held| &held.namespace).collect();
        namespaces.sort();
        namespaces.dedup_by(|a, b| a.database == b.database);
        for ns in namespaces {
            let entries: Vec<_> = held
                .iter()
                .filter(|held| held.is_shared() && held.namespace.database == ns.database)
                .map(|held| (held.key.clone(), held.token))
                .collect();
            current.extend(cache::current(self.routes.reading(ns)?, ns, &entries)?);
        }
        let before = held.len();
        let mut holding = Vec::with_capacity(before);
        for held in held.drain(..) {
            let holds = match &held.made {
                Made::Alone => true,
                _ if !current.contains(&held.key) => false,
                _ if held.life.until > now => true,
                Made::Before => false,
                // Whatever the cache time, the answer to the query that computed them has them.
                Made::Now(ids) => {
                    let store = self.routes.reading(&held.namespace)?;
                    let listed = cache::listed(ids);
                    cache::are_whole(store, &held.namespace, held.token, listed, ids.len() as u64)?
                }
            };
            if holds {
                holding.push(held);
            }
        }
        *held = holding;
        Ok(held.len() == before)
    }

    /// The state of the store of a collection, where it knows that.
    fn state(&self, ns: &Namespace) -> Result<Option<(i64, u64)>, StoreError> {
        let (store, mut state) = (self.routes.reading(ns)?, None);
        store.find_chosen(ns, &mut |_| {
            state = store.state();
            Ok(None)
        })?;
        Ok(state)
    }

    /// The computation that answers the query: of the cache, or a new one; `alone` for a new one that is not shared.
    fn obtain(&self, wanted: &Wanted<'_>, others: Others<'_>, alone: bool) -> Result<Held, StoreError> {
        let start = Instant::now();
        let definition = &wanted.computable.definition;
        // A computable needs no stored documents, so the file need not exist.
        self.routes.excuse(&definition.namespace);
        let (held, cached, documents) = match definition.cache {
            Some(cache) if !alone => self.obtain_cached(wanted, others, cache)?,
            _ => self.compute_once(wanted, others)?,
        };
        let computed = Computed {
            name: definition.name.clone(),
            namespace: definition.namespace.clone(),
            cached,
            documents,
            took: start.elapsed(),
        };
        self.journal.report(&Operation {
            name: format!("{} {}", if cached { "cached" } else { "compute" }, computed.name).into(),
            namespace: Some(computed.namespace.clone()),
            count: Some(computed.documents),
            took: computed.took,
        });
        self.computables.computed.borrow_mut().push(computed);
        Ok(held)
    }

    /// Computes for this query alone.
    fn compute_once(&self, wanted: &Wanted<'_>, others: Others<'_>) -> Result<(Held, bool, u64), StoreError> {
        let documents = self.compute(wanted, others, None)?;
        let (namespace, key) = (wanted.computable.definition.namespace.clone(), wanted.key.clone());
        let (token, until) = (object_id::new(), after(self.clock.now(), COMPUTE_TIMEOUT));
        let life = Lifetime { until, kept: until };
        let count = self.keep_once(wanted, documents, token, life)?;
        Ok((Held { namespace, key, token, life, made: Made::Alone, state: None }, false, count))
    }

    /// Runs the body; `documents` are those that it adds keys to, where it does.
    pub(super) fn compute(
        &self,
        wanted: &Wanted<'_>,
        others: Others<'_>,
        documents: Option<&[RawDocumentBuf]>,
    ) -> Result<Vec<Document>, StoreError> {
        let definition = &wanted.computable.definition;
        self.check_cycle(wanted)?;
        self.check_within()?;
        self.computables.runs.update(|runs| runs + 1);
        let later = others.later.iter().map(|other| &other.computable.definition);
        let later = later.filter(|other| other.namespace == definition.namespace);
        let running = Running {
            name: definition.name.clone(),
            namespace: definition.namespace.clone(),
            key: wanted.key.clone(),
            later: later.map(|other| other.name.clone()).collect(),
            earlier: others.earlier.to_vec(),
        };
        self.computables.running.borrow_mut().push(running);
        let asked = Asked { memory: self, namespace: &definition.namespace, query: wanted.query, documents };
        let computed = wanted.computable.body.compute(&asked);
        self.computables.running.borrow_mut().pop();
        let documents = computed.map_err(|error| match error {
            ComputeError::Store(error @ StoreError::Computable { .. }) if is_cycle(&error) => error,
            ComputeError::Store(error) => failed(wanted, error),
            ComputeError::Query(error) => failed(wanted, error),
            error => failed(wanted, error),
        })?;
        if documents.len() > MOST_DOCUMENTS {
            let wrong = format!("it gave {} documents, more than {MOST_DOCUMENTS}", documents.len());
            return Err(failed(wanted, QueryError::bad_value(wrong)));
        }
        Ok(documents)
    }

    /// Refuses a computable that depends on itself.
    pub(super) fn check_cycle(&self, wanted: &Wanted<'_>) -> Result<(), StoreError> {
        let running = self.computables.running.borrow();
        let name = &wanted.computable.definition.name;
        let start = running.iter().position(|at| at.key == wanted.key);
        if start.is_none() && running.len() < DEPTH {
            return Ok(());
        }
        let names = running.iter().skip(start.unwrap_or(0)).map(|at| at.name.as_str());
        let chain = names.chain([name.as_str()]).collect::<Vec<_>>().join(" → ");
        let reason = match start {
            Some(_) => {
                format!("computables depend on each other in a cycle: {chain}; narrow the spec or the query of one")
            }
            None => format!("computables depend on each other more than {DEPTH} deep: {chain}"),
        };
        Err(failed(wanted, Cycle(QueryError::bad_value(reason))))
    }

    /// Removes what was computed for one query, also where its time in the cache was over before the query was answered.
    /// Where the store's next write removes what has decayed by then, it is left to that.
    fn tidy(&self, held: &Held) -> Result<(), StoreError> {
        let now = self.clock.now();
        let ids = match &held.made {
            Made::Alone => return self.forget_once(held.token),
            Made::Now(ids) if held.life.until <= now => ids,
            _ => return Ok(()),
        };
        let store = self.routes.reading(&held.namespace)?;
        if held.life.kept <= now && store.is_atomic() {
            return Ok(());
        }
        cache::write(store, || {
            if !cache::discard(store, &held.namespace, &held.key, held.token)? {
                // Another process has removed them.
                return Ok(());
            }
            remove(store, &held.namespace, ids, held.token)
        })
    }
}

/// Computables that depend on each other, by how they were declared.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct Cycle(#[source] QueryError);

impl AtFault for Cycle {
    fn fault(&self) -> Fault {
        Fault::Input
    }
}

/// A cycle is reported once, and not by every computable in it.
fn is_cycle(error: &StoreError) -> bool {
    matches!(error, StoreError::Computable { source, .. } if source.is::<Cycle>())
}

pub(super) fn failed(wanted: &Wanted<'_>, error: impl AtFault) -> StoreError {
    StoreError::computable(&wanted.computable.definition.name, error)
}
