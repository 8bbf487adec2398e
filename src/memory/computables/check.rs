//! Which computables a query would run, and why.

use std::sync::Arc;

use bson::{DateTime, Document};

use super::cache::{Entry, State};
use super::registry::Computable;
use crate::memory::Memory;
use crate::store::{Namespace, StoreError};

/// What a query means for one computable.
pub struct Check {
    /// The computable.
    pub computable: Arc<Computable>,
    /// What would become of it.
    pub verdict: Verdict,
}

/// What a query means for a computable.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// It would run.
    Runs,
    /// The cache holds what it gave for an equal query.
    Cached {
        /// Until when.
        until: DateTime,
        /// How many documents.
        documents: u64,
    },
    /// Another process computes for an equal query, which this one would wait for.
    Busy,
    /// It is not needed: these clauses of its spec are not matched by the query.
    Unneeded(Vec<Document>),
    /// It computes for another namespace.
    Elsewhere,
}

impl Memory {
    /// The computables that a query needs, in the order in which they run.
    ///
    /// # Errors
    /// Where the store fails, what it keeps is not a computable, or an expression in a spec fails on the query.
    pub fn needed(&self, ns: &Namespace, query: &Document) -> Result<Vec<Arc<Computable>>, StoreError> {
        self.registry(ns)?.matching(ns, query)
    }

    /// What a query would mean for each computable. Nothing is computed.
    ///
    /// # Errors
    /// Where the store fails, or an expression in a spec fails on the query.
    pub fn check_computables(&self, ns: &Namespace, query: &Document) -> Result<Vec<Check>, StoreError> {
        let check =
            |computable: Arc<Computable>| Ok(Check { verdict: self.verdict(&computable, ns, query)?, computable });
        self.computables()?.0.into_iter().map(check).collect()
    }

    fn verdict(&self, computable: &Computable, ns: &Namespace, query: &Document) -> Result<Verdict, StoreError> {
        if computable.definition.namespace != *ns {
            return Ok(Verdict::Elsewhere);
        }
        if !computable.spec.matches(query)? {
            return Ok(Verdict::Unneeded(computable.spec.missed(query)?));
        }
        let Some(cache) = computable.definition.cache else { return Ok(Verdict::Runs) };
        let entry = Entry::new(self.routes.reading(ns)?, ns, computable.key(query));
        Ok(match entry.state(self.clock.now(), cache)? {
            State::Good { until, documents, .. } => Verdict::Cached { until, documents },
            State::Busy { .. } => Verdict::Busy,
            State::Stale(_) => Verdict::Runs,
        })
    }
}
