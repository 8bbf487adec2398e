//! The collections that the documents of a collection are computed from.

use std::time::Duration;

use crate::memory::Memory;
use crate::store::{Namespace, StoreError};

/// Collections whose changes are changes of what is asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sources {
    /// The collections that are asked, and those that their computables are made from. What a program
    /// looks at is not known.
    pub namespaces: Vec<Namespace>,
    /// How long after a change the caches may hold what was computed before it.
    pub delay: Duration,
}

impl Memory {
    /// What the documents of these collections come from.
    ///
    /// # Errors
    /// Where the store fails, or what it keeps is not a computable.
    pub fn sources(&self, asked: &[Namespace]) -> Result<Sources, StoreError> {
        let mut sources = Sources { namespaces: asked.to_vec(), delay: Duration::ZERO };
        let mut next = 0;
        while let Some(namespace) = sources.namespaces.get(next).cloned() {
            next += 1;
            let registry = self.registry(&namespace)?;
            for computable in registry.iter().filter(|other| other.definition.namespace == namespace) {
                sources.delay = sources.delay.max(computable.definition.cache.unwrap_or_default());
                for source in computable.body.sources(&namespace) {
                    if !sources.namespaces.contains(&source) {
                        sources.namespaces.push(source);
                    }
                }
            }
        }
        Ok(sources)
    }
}
