//! Changes of many documents, in slices that let other processes write in between.
//!
//! One transaction over a million documents would make all other writers wait for seconds. As on
//! MongoDB, such an operation is atomic for each document, not as a whole: where it fails at one, those
//! before it stay changed. A slice begins with the documents as they are then, matched again. Within a
//! transaction there is one slice, which is a part of it.

use std::cell::Cell;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::Embedded;
use super::catalog::Collection;
use super::scan::{Found, Scan};
use crate::interrupt::stops_work;
use crate::query::{Filter, Sort};
use crate::store::{Hint, Namespace, StoreError};

/// How long a slice takes.
const SLICE_DURATION: Duration = Duration::from_millis(100);
/// The same, where the disk is nearly full: it has room for a short log.
const SHORT_SLICE_DURATION: Duration = Duration::from_millis(10);
/// The pause between two slices, in which every waiting writer tries once.
const PAUSE_BETWEEN_SLICES: Duration = Duration::from_millis(15);

/// Which matches are meant, and how they are found.
#[derive(Debug, Clone, Copy)]
pub(super) struct Selection<'a> {
    /// At most so many.
    pub(super) most: u64,
    /// The index that is read.
    pub(super) hint: Option<&'a Hint>,
    /// Whether expired documents are removed before.
    pub(super) is_sweeping: bool,
}

/// How many documents were met.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Met {
    /// How many matched.
    pub(super) matched: u64,
    /// How many of those were changed.
    pub(super) changed: u64,
}

/// What came of a slice.
pub(super) enum Slice {
    /// There is more to be done.
    More,
    /// All is done.
    Last,
    /// A document could not be changed, or the store has failed.
    Failed(StoreError),
}

/// How long a slice still has.
pub(super) struct SliceLimit {
    start: Instant,
    limit: Duration,
    /// Whether it is a transaction by itself, and not a part of another.
    is_alone: bool,
}

impl SliceLimit {
    /// Whether others are to have their turn. A part of a transaction takes as long as it needs.
    pub(super) fn is_over(&self) -> bool {
        self.is_alone && self.start.elapsed() >= self.limit
    }
}

/// What is done with a match; says whether it was changed.
type Work<'a> = &'a mut dyn FnMut(Collection, &Found) -> Result<bool, StoreError>;

impl Embedded {
    /// Does `work` with each match that is selected, or `otherwise` where there is none.
    ///
    /// # Errors
    /// Where a document cannot be changed and others were before it, [`StoreError::Partial`]; where the user interrupts it
    /// between two slices, [`StoreError::Interrupted`].
    pub(super) fn each_match(
        &self,
        ns: &Namespace,
        filter: &mut Arc<Filter>,
        selection: Selection<'_>,
        work: Work<'_>,
        otherwise: &mut dyn FnMut() -> Result<(), StoreError>,
    ) -> Result<Met, StoreError> {
        let Selection { most, hint, is_sweeping } = selection;
        let (mut open, mut matched, changed) = (None, 0, Cell::new(0));
        self.in_slices(&changed, &mut |limit| {
            let Some(collection) = self.collection(ns)? else { return end(matched, otherwise) };
            if open.is_none() && is_sweeping {
                self.sweep(ns, collection)?;
            }
            let (id, scan) = match &mut open {
                Some((id, scan)) => {
                    Scan::unread(scan);
                    (*id, scan)
                }
                None => {
                    let most = usize::try_from(most).unwrap_or(usize::MAX);
                    let scan = Scan::sorted(self, collection, filter, &Sort::none(), hint.into())?;
                    let (id, scan) = open.insert((collection.id, scan.at_most(most).up_to_failure()));
                    (*id, scan)
                }
            };
            while matched < most && id == collection.id {
                let Some(found) = scan.next() else { break };
                match found.and_then(|found| work(collection, &found)) {
                    Ok(is_changed) => changed.update(|count| count + u64::from(is_changed)),
                    Err(error) => return Ok(Slice::Failed(error)),
                }
                matched += 1;
                if limit.is_over() {
                    return Ok(Slice::More);
                }
            }
            end(matched, otherwise)
        })?;
        Ok(Met { matched, changed: changed.get() })
    }

    /// Does something in slices; `changed` counts the documents that it changes. Where it fails at one document, those before
    /// it stay changed; where the store fails, the slices before do.
    ///
    /// # Errors
    /// Where some stay changed, [`StoreError::Partial`]; where the user interrupts it between two slices,
    /// [`StoreError::Interrupted`].
    pub(super) fn in_slices(
        &self,
        changed: &Cell<u64>,
        work: &mut dyn FnMut(&SliceLimit) -> Result<Slice, StoreError>,
    ) -> Result<(), StoreError> {
        let is_alone = self.connection.is_autocommit();
        loop {
            let kept = changed.get();
            let slice = self.write(|| {
                let slice = work(&SliceLimit { start: Instant::now(), limit: self.slice(), is_alone })?;
                match slice {
                    Slice::Failed(error) if changed.get() == 0 || !error.is_of_document() => Err(error),
                    slice => Ok(slice),
                }
            });
            match slice.map_err(|error| error.after(kept))? {
                Slice::Last => return Ok(()),
                Slice::Failed(error) => return Err(error.after(changed.get())),
                Slice::More if stops_work() => return Err(StoreError::Interrupted { done: changed.get() }),
                Slice::More => std::thread::sleep(PAUSE_BETWEEN_SLICES),
            }
        }
    }

    /// How long a slice may take.
    fn slice(&self) -> Duration {
        if self.is_crowded() { SHORT_SLICE_DURATION } else { SLICE_DURATION }
    }
}

/// The end of the last slice.
fn end(matched: u64, otherwise: &mut dyn FnMut() -> Result<(), StoreError>) -> Result<Slice, StoreError> {
    if matched == 0 {
        otherwise()?;
    }
    Ok(Slice::Last)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::{Store as _, UpdateRequest, UpdateSpec};
    use bson::doc;
    use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

    #[test]
    fn documents_that_are_removed_meanwhile_are_not_changed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.rmem");
        let (ns, other) = (Namespace::parse("a.b").unwrap(), Namespace::parse("a.c").unwrap());
        let count = 40_000;
        Embedded::open(&path).unwrap().insert(&ns, (0..count).map(|n| doc! { "_id": n }).collect()).unwrap();
        let done = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let writer = scope.spawn(|| {
                let store = Embedded::open(&path).unwrap();
                let mut written = 0;
                while !done.load(Ordering::Relaxed) {
                    store.insert(&other, vec![doc! {}]).unwrap();
                    // A document that is changed meanwhile is matched again.
                    store.delete(&ns, (&doc! { "_id": count - 1 - written }).into(), true).unwrap();
                    written += 1;
                    std::thread::sleep(Duration::from_millis(5));
                }
            });
            let store = Embedded::open(&path).unwrap();
            let update = UpdateSpec::Document(doc! { "$inc": { "n": 1 } });
            let request = UpdateRequest { filter: doc! {}, update, many: true, ..UpdateRequest::default() };
            let updated = store.update(&ns, &request, None).unwrap();
            done.store(true, Ordering::Relaxed);
            writer.join().unwrap();
            assert!(updated.matched <= u64::try_from(count).unwrap());
            let left = store.count(&ns, (&doc! {}).into()).unwrap();
            assert_eq!(store.count(&ns, (&doc! { "n": 1 }).into()).unwrap(), left, "each was changed once");
            assert_eq!(store.delete(&ns, (&doc! {}).into(), false).unwrap(), left);
        });
    }

    #[test]
    fn others_write_between_the_slices() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.rmem");
        let (ns, other) = (Namespace::parse("a.b").unwrap(), Namespace::parse("a.c").unwrap());
        let store = Embedded::open(&path).unwrap();
        store.insert(&ns, (0..20_000).map(|n| doc! { "_id": n }).collect()).unwrap();
        let written = AtomicU64::new(0);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let store = Embedded::open(&path).unwrap();
                for _ in 0..3 {
                    store.insert(&other, vec![doc! {}]).unwrap();
                    written.fetch_add(1, Ordering::Relaxed);
                }
            });
            // The work lasts until the others have written, were it for 20,000 documents.
            let mut wait = |_, _: &Found| {
                if written.load(Ordering::Relaxed) < 3 {
                    std::thread::sleep(Duration::from_millis(1));
                }
                Ok(true)
            };
            let mut filter = Arc::new(Filter::parse(&doc! {}).unwrap());
            store
                .each_match(
                    &ns,
                    &mut filter,
                    Selection { most: u64::MAX, hint: None, is_sweeping: false },
                    &mut wait,
                    &mut || Ok(()),
                )
                .unwrap();
            assert_eq!(written.load(Ordering::Relaxed), 3, "written before the end");
        });
    }
}
