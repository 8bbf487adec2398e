//! Reports of operations, for `-v` and `--log`.

use std::borrow::Cow;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crate::store::{Documents, Namespace, StoreError};

/// One operation that is over.
#[derive(Debug, Clone, PartialEq)]
pub struct Operation {
    /// What was done: `find`, `insert`, `compute on-table`, ….
    pub name: Cow<'static, str>,
    /// Where.
    pub namespace: Option<Namespace>,
    /// How many documents (or values) it concerned; none where it failed.
    pub count: Option<u64>,
    /// How long it took; for a query, until the last document that was asked for.
    pub took: Duration,
}

/// Documents or values, as they are read.
type Results<'a, T> = Box<dyn Iterator<Item = Result<T, StoreError>> + 'a>;

/// Called with each operation when it is over.
pub type Observer = Arc<dyn Fn(&Operation) + Send + Sync>;

/// The observer of a memory, if there is one, and the counter of documents.
#[derive(Clone, Default)]
pub(super) struct Journal {
    observer: Option<Observer>,
    meter: Option<Arc<AtomicU64>>,
}

impl Journal {
    /// The same, with this observer.
    pub(super) fn observed_by(self, observer: Observer) -> Self {
        Self { observer: Some(observer), ..self }
    }

    /// The same, where documents that are stored, or read to be written elsewhere, are counted.
    pub(super) fn counting(self, meter: Arc<AtomicU64>) -> Self {
        Self { meter: Some(meter), ..self }
    }

    /// Counts documents.
    pub(super) fn count(&self, documents: u64) {
        if let Some(meter) = &self.meter {
            meter.fetch_add(documents, Ordering::Relaxed);
        }
    }

    /// Counts documents as they are read.
    pub(super) fn counted<'a>(&self, documents: Documents<'a>) -> Documents<'a> {
        let Some(meter) = self.meter.clone() else { return documents };
        Box::new(documents.inspect(move |_| {
            meter.fetch_add(1, Ordering::Relaxed);
        }))
    }

    /// Runs an operation and reports it; `count` returns the size of its result.
    pub(super) fn note<T>(
        &self,
        name: &'static str,
        namespace: Option<&Namespace>,
        count: impl Fn(&T) -> u64,
        work: impl FnOnce() -> Result<T, StoreError>,
    ) -> Result<T, StoreError> {
        let Some(observer) = &self.observer else { return work() };
        let start = Instant::now();
        let result = work();
        let count = result.as_ref().ok().map(count);
        observer(&Operation { name: name.into(), namespace: namespace.cloned(), count, took: start.elapsed() });
        result
    }

    /// Reports an operation that is over.
    pub(super) fn report(&self, operation: &Operation) {
        if let Some(observer) = &self.observer {
            observer(operation);
        }
    }

    /// Reports a query when its results are dropped.
    pub(super) fn watch<'a, T: 'a>(
        &self,
        name: &'static str,
        namespace: &Namespace,
        start: Instant,
        results: Results<'a, T>,
    ) -> Results<'a, T> {
        let Some(observer) = &self.observer else { return results };
        let watched = Watched {
            observer: observer.clone(),
            operation: Operation {
                name: name.into(),
                namespace: Some(namespace.clone()),
                count: Some(0),
                took: start.elapsed(),
            },
            results,
        };
        Box::new(watched)
    }
}

/// Results that are counted, with the time spent on them alone.
struct Watched<'a, T> {
    observer: Observer,
    operation: Operation,
    results: Results<'a, T>,
}

impl<T> Iterator for Watched<'_, T> {
    type Item = Result<T, StoreError>;

    fn next(&mut self) -> Option<Self::Item> {
        let start = Instant::now();
        let next = self.results.next();
        let operation = &mut self.operation;
        operation.took += start.elapsed();
        match &next {
            Some(Ok(_)) => operation.count = operation.count.map(|count| count + 1),
            Some(Err(_)) => operation.count = None,
            None => {}
        }
        next
    }
}

impl<T> Drop for Watched<'_, T> {
    fn drop(&mut self) {
        (self.observer)(&self.operation);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn documents_are_counted_whether_the_observer_comes_before_the_meter_or_after_it() {
        let meter = Arc::new(AtomicU64::new(0));
        let observer: Observer = Arc::new(|_| {});
        Journal::default().counting(Arc::clone(&meter)).observed_by(Arc::clone(&observer)).count(2);
        Journal::default().observed_by(observer).counting(Arc::clone(&meter)).count(3);
        assert_eq!(meter.load(Ordering::Relaxed), 5);
    }
}
