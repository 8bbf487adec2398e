//! What a store keeps of changes: the history of a collection, and the collection as it was.

use std::collections::HashSet;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

use bson::DateTime;

use super::error::StoreError;
use super::namespace::Namespace;
use super::watch::{Change, Scope};
use crate::calendar::day_and_time;
use crate::query::Collation;

/// How long, and how much of, the history of a scope is kept. Of several rules for a collection, that
/// of the smallest scope counts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HistoryRule {
    /// Which collections.
    pub scope: Scope,
    /// How long a change is kept; zero keeps none.
    pub age: Duration,
    /// The most bytes of changes that are kept.
    pub size: u64,
}

/// A kept change.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// The change, with the documents before and after it.
    pub change: Change,
    /// Whether the document went because its collection was dropped, renamed or replaced.
    pub dropped: bool,
    /// The command or program that made the change, where that is known.
    pub author: Option<String>,
    /// What the changes of one run of a command have in common.
    pub run: Option<i64>,
    /// How strings compared in a collection that was dropped, where that was not byte by byte.
    pub collation: Option<Collation>,
}

/// The kept changes of a collection.
pub struct History<'a> {
    /// All changes since then are kept.
    pub since: DateTime,
    /// The runs of commands of which the oldest changes are not kept any more.
    pub cut_runs: HashSet<i64>,
    /// The changes in order.
    pub entries: Box<dyn Iterator<Item = Result<Entry, StoreError>> + 'a>,
}

impl HistoryRule {
    /// Returns the rule for a collection.
    #[must_use]
    pub fn of<'r>(rules: &'r [Self], ns: &Namespace) -> Option<&'r Self> {
        Self::fitting(rules, ns).filter(|rule| !rule.age.is_zero())
    }

    /// Returns whether a rule says that none is kept.
    #[must_use]
    pub fn is_off(rules: &[Self], ns: &Namespace) -> bool {
        Self::fitting(rules, ns).is_some_and(|rule| rule.age.is_zero())
    }

    fn fitting<'r>(rules: &'r [Self], ns: &Namespace) -> Option<&'r Self> {
        let fits = |rule: &&Self| match &rule.scope {
            Scope::Collection(own) => own == ns,
            Scope::Database(database) => *database == ns.database && !ns.is_own(),
            Scope::All => !ns.is_own(),
        };
        let narrowness = |rule: &&Self| match rule.scope {
            Scope::Collection(_) => 2,
            Scope::Database(_) => 1,
            Scope::All => 0,
        };
        rules.iter().filter(fits).max_by_key(narrowness)
    }
}

/// The error where the history of a collection is not kept.
#[must_use]
pub fn not_kept(ns: &Namespace, rules: &[HistoryRule]) -> StoreError {
    let reason = match HistoryRule::of(rules, ns) {
        Some(_) => "nothing was changed since rmem.toml has keep_history; the history begins with the next write",
        None => "no history is kept; keep_history = \"24h\" in rmem.toml keeps it from the next write on",
    };
    StoreError::Unfit { address: ns.to_string(), reason: reason.to_owned() }
}

/// The error where the history of a collection does not reach back to a time.
#[must_use]
pub fn too_old(ns: &Namespace, at: DateTime, since: DateTime) -> StoreError {
    let text = |time: DateTime| day_and_time(time.timestamp_millis());
    let clock = if since > DateTime::now() { " by a clock that was set back since" } else { "" };
    let reason =
        format!("the history begins at {} UTC{clock}; what was there at {} is not known", text(since), text(at));
    StoreError::Unfit { address: ns.to_string(), reason }
}

/// A number for changes that are taken back together, larger than all before it. The time and the process make it another one
/// than that of any other process, and the last number another one than that of any other thread.
pub(super) fn next_run() -> i64 {
    static LAST: AtomicI64 = AtomicI64::new(0);
    let now = DateTime::now().timestamp_millis().saturating_sub(1_700_000_000_000);
    let own = now.saturating_mul(1 << 20).saturating_add(i64::from(std::process::id()) & 0xF_FFFF);
    let next = |last: i64| own.max(last.saturating_add(1 << 20));
    let last = LAST.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |last| Some(next(last)));
    next(last.unwrap_or_else(|last| last))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_threads_have_the_same_run() {
        let runs = || (0..1000).map(|_| next_run()).collect::<Vec<_>>();
        let mut all: Vec<i64> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..4).map(|_| scope.spawn(runs)).collect();
            threads.into_iter().flat_map(|thread| thread.join().unwrap()).collect()
        });
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), 4000);
    }

    #[test]
    fn the_rule_of_the_smallest_scope_counts() {
        let ns = |text: &str| Namespace::parse(text).unwrap();
        let rule = |scope, seconds| HistoryRule { scope, age: Duration::from_secs(seconds), size: 1 };
        let rules = [
            rule(Scope::Collection(ns("a.b")), 3),
            rule(Scope::All, 1),
            rule(Scope::Database("a".to_owned()), 2),
            rule(Scope::Collection(ns("a.off")), 0),
        ];
        let age = |name: &str| HistoryRule::of(&rules, &ns(name)).map(|rule| rule.age.as_secs());
        assert_eq!([age("a.b"), age("a.c"), age("x.y")], [Some(3), Some(2), Some(1)]);
        assert_eq!([age("a.off"), age("a.rmem.own")], [None, None]);
        let is_off = |name: &str| HistoryRule::is_off(&rules, &ns(name));
        assert_eq!([is_off("a.off"), is_off("a.b"), is_off("a.rmem.own")], [true, false, false]);
    }
}
