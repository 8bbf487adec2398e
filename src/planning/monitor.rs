//! Watching the memory for changes that may break a plan.

use std::time::{Duration, Instant};

use bson::{Document, doc};

use super::{Check, PlanningError, check};
use crate::memory::Memory;
use crate::memory::watch::{Trigger, Watch};
use crate::plan::{Repository, RepositoryError};
use crate::store::{Namespace, Next, StoreError};

/// How long to wait for a change before looking at the interruption flag.
const POLL_INTERVAL: Duration = Duration::from_millis(250);
/// How long nothing may change before the plan is checked: an action changes more than one document.
const QUIET_TIME: Duration = Duration::from_millis(150);
/// After this time the plan is checked even if changes go on.
const MAX_DELAY: Duration = Duration::from_secs(2);
/// How often a plan is checked again after a change, where caches of computables may hold what was there before: once
/// for what is computed from the change, and once for what is computed from that.
const RECHECKS: u32 = 2;
/// The pause before a store that failed is asked again.
const RETRY_DELAY: Duration = Duration::from_millis(500);

/// What is known of a plan under execution.
#[derive(Debug)]
pub enum PlanState {
    /// It still reaches its goal.
    Holds,
    /// It does not reach its goal any more.
    Broken(Box<Check>),
    /// It is not in the memory any more.
    Gone(RepositoryError),
}

impl PlanState {
    /// The state of a stored plan.
    ///
    /// The plan and what it is checked against are read one after the other. A step that is done in between would
    /// look like a change that breaks the plan: a plan is broken only where its steps are as they were before.
    ///
    /// # Errors
    /// Where the plan cannot be checked, or a store fails.
    pub fn of(id: &str, plans: &Namespace, memory: &Memory) -> Result<Self, PlanningError> {
        let start = Instant::now();
        let repository = Repository::new(memory, plans);
        let mut read = repository.get(id);
        loop {
            let record = match read {
                Ok(record) => record,
                Err(RepositoryError::Store(error)) => return Err(error.into()),
                Err(gone) => return Ok(Self::Gone(gone)),
            };
            let verdict = check(&record, None, memory);
            if verdict.as_ref().is_ok_and(Check::holds) {
                return Ok(Self::Holds);
            }
            std::thread::sleep(QUIET_TIME);
            read = repository.get(id);
            let is_same = read.as_ref().is_ok_and(|now| now.progress() == record.progress());
            if is_same || start.elapsed() > MAX_DELAY {
                return Ok(Self::Broken(Box::new(verdict?)));
            }
        }
    }
}

/// Waits for changes of the collections that a problem is made from, and of the plan's own steps.
pub struct Monitor<'a> {
    memory: &'a Memory,
    /// Changes of stored plans: steps that begin or end.
    plans: Watch<'a>,
    /// The collections that the problem is made from.
    sources: Vec<(Namespace, Watch<'a>)>,
    /// How long caches of computables may hold what was there before a change.
    delay: Duration,
    /// How often to check again although nothing more has changed.
    rechecks: u32,
}

impl<'a> Monitor<'a> {
    /// Watches the plans in a namespace.
    ///
    /// # Errors
    /// Where the store cannot be watched.
    pub fn new(plans: &Namespace, memory: &'a Memory) -> Result<Self, StoreError> {
        // A failure has no steps.
        let plans = watch(plans, doc! { "plan": { "$nin": ["fail", 0] } }, memory)?;
        Ok(Self { memory, plans, sources: Vec::new(), delay: Duration::ZERO, rechecks: 0 })
    }

    /// Watches collections from now on as well. Returns whether one of them was not watched before.
    ///
    /// # Errors
    /// Where the store cannot be watched.
    pub fn add(&mut self, namespaces: &[Namespace]) -> Result<bool, StoreError> {
        let before = self.sources.len();
        let sources = self.memory.sources(namespaces)?;
        for namespace in sources.namespaces {
            if !self.sources.iter().any(|(other, _)| *other == namespace) {
                let watch = watch(&namespace, Document::new(), self.memory)?;
                self.sources.push((namespace, watch));
            }
        }
        self.delay = self.delay.max(sources.delay);
        Ok(self.sources.len() > before)
    }

    /// Waits until something has changed and nothing changes any more. Returns false where `is_over` becomes true.
    /// `retried` gets the errors of stores that are asked again.
    ///
    /// # Errors
    /// Where a store fails for good.
    pub fn wait(
        &mut self,
        is_over: &dyn Fn() -> bool,
        retried: &mut dyn FnMut(&StoreError),
    ) -> Result<bool, StoreError> {
        let due = self.recheck_time();
        while !self.changes_within(POLL_INTERVAL, &Drain::new(is_over), retried)? {
            if is_over() {
                return Ok(false);
            }
            if due.is_some_and(|due| Instant::now() >= due) {
                self.rechecks -= 1;
                return Ok(true);
            }
        }
        self.rechecks = if self.delay.is_zero() { 0 } else { RECHECKS };
        let drain = Drain::new(is_over);
        while !drain.is_over() && self.changes_within(QUIET_TIME, &drain, retried)? {}
        Ok(!is_over())
    }

    /// When to check again: once the caches of computables that the last check may have filled have expired.
    fn recheck_time(&self) -> Option<Instant> {
        let now = Instant::now();
        (self.rechecks > 0).then(|| now.checked_add(self.delay + QUIET_TIME)).flatten()
    }

    /// Whether something changes within a time, which the watches share.
    fn changes_within(
        &mut self,
        time: Duration,
        drain: &Drain<'_>,
        retried: &mut dyn FnMut(&StoreError),
    ) -> Result<bool, StoreError> {
        let share = time / u32::try_from(self.sources.len() + 1).unwrap_or(u32::MAX);
        let mut any = false;
        for watch in self.sources.iter_mut().map(|(_, watch)| watch).chain([&mut self.plans]) {
            any |= drain.take(share, &mut |time| watch.next(time), retried)?;
            watch.done()?;
        }
        Ok(any)
    }
}

/// Takes changes, for [`MAX_DELAY`] at most.
struct Drain<'a> {
    start: Instant,
    is_interrupted: &'a dyn Fn() -> bool,
}

impl<'a> Drain<'a> {
    fn new(is_interrupted: &'a dyn Fn() -> bool) -> Self {
        Self { start: Instant::now(), is_interrupted }
    }

    /// Whether no more changes are to be taken.
    fn is_over(&self) -> bool {
        self.start.elapsed() >= MAX_DELAY || (self.is_interrupted)()
    }

    /// Takes the changes that come within a time, and those that are there already. Returns whether there were any.
    fn take(
        &self,
        mut time: Duration,
        next: &mut dyn FnMut(Duration) -> Result<Next, StoreError>,
        retried: &mut dyn FnMut(&StoreError),
    ) -> Result<bool, StoreError> {
        let mut any = false;
        loop {
            match next(time)? {
                Next::Change(_) => any = true,
                Next::Nothing => break,
                Next::Interrupted(error) => {
                    retried(&error);
                    std::thread::sleep(RETRY_DELAY);
                    break;
                }
            }
            if self.is_over() {
                break;
            }
            time = Duration::ZERO;
        }
        Ok(any)
    }
}

/// Watches every change of a collection except those that computables make.
fn watch<'a>(namespace: &Namespace, filter: Document, memory: &'a Memory) -> Result<Watch<'a>, StoreError> {
    memory.watch(Trigger { namespace: namespace.clone(), filter, name: None, computed: false, metadata: false })
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use bson::DateTime;

    use super::*;
    use crate::store::{Change, ChangeKind, Embedded};

    /// A change, as often as one is asked for.
    fn steady(_: Duration) -> Result<Next, StoreError> {
        let (time, position) = (DateTime::from_millis(0), String::new());
        let change = Change { kind: ChangeKind::Drop, id: None, before: None, after: None, time, position };
        Ok(Next::Change(Box::new(change)))
    }

    #[test]
    fn changes_without_end_are_taken_until_the_plan_has_to_be_checked() {
        let drain = Drain::new(&|| false);
        assert!(drain.take(POLL_INTERVAL, &mut steady, &mut |_| {}).unwrap());
        assert!(drain.start.elapsed() >= MAX_DELAY);
    }

    #[test]
    fn a_plan_is_checked_again_when_what_a_slow_check_cached_has_expired() {
        let folder = tempfile::tempdir().unwrap();
        let memory = Memory::new(Box::new(Embedded::open(folder.path().join("m.rmem")).unwrap()), None, Vec::new());
        let [plans, world] = ["robmem.plans", "robmem.world"].map(|name| Namespace::parse(name).unwrap());
        let mut monitor = Monitor::new(&plans, &memory).unwrap();
        monitor.add(std::slice::from_ref(&world)).unwrap();
        monitor.delay = Duration::from_millis(200);
        memory.insert(&world, vec![doc! {}]).unwrap();
        assert!(monitor.wait(&|| false, &mut |_| {}).unwrap());
        for _ in 0..RECHECKS {
            // The check takes longer than the caches hold what they have.
            std::thread::sleep(monitor.delay * 3);
            let end = Instant::now();
            assert!(monitor.wait(&|| false, &mut |_| {}).unwrap());
            assert!(end.elapsed() >= monitor.delay);
        }
        assert_eq!(monitor.recheck_time(), None);
    }

    #[test]
    fn changes_without_end_are_taken_until_an_interruption() {
        let looks = Cell::new(0);
        let is_over = || looks.replace(looks.get() + 1) == 3;
        assert!(Drain::new(&is_over).take(POLL_INTERVAL, &mut steady, &mut |_| {}).unwrap());
        assert_eq!(looks.get(), 4);
    }
}
