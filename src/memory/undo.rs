//! Taking changes back: documents become again what the history says they were.
//!
//! Changes that were made later to the same documents would be overwritten. They are reported, and
//! kept unless it is forced. What is done is itself a change, of which there is a history.

use std::collections::{BTreeMap, HashSet};

use bson::{Bson, DateTime, Document, RawDocumentBuf, doc};

use super::Memory;
use super::history::Selection;
use crate::query::{Collation, QueryError, key};
use crate::store::history::{Entry, History};
use crate::store::{ChangeKind, Find, Namespace, StoreError};

/// How many of the last runs of commands are taken back where nothing else is selected.
pub const DEFAULT_LAST: usize = 1;

/// What is to be done to one document.
#[derive(Debug, Clone, PartialEq)]
pub struct Restoration {
    /// Which document.
    pub id: Bson,
    /// What it becomes; none where it goes.
    pub target: Option<Document>,
    /// The changes made later, that would be overwritten.
    pub later: Vec<Entry>,
    /// Whether it is not what the last selected change made it, though no later change is known.
    pub differs: bool,
}

/// A run of a command whose oldest changes are not kept any more.
#[derive(Debug, Clone, PartialEq)]
pub struct PartialRun {
    /// How many of its changes are kept and selected.
    pub kept: usize,
    /// The newest of them.
    pub newest: Entry,
}

/// What taking changes back does.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct UndoPlan {
    /// How many changes are taken back.
    pub changes: usize,
    /// The oldest run of a command of which not all changes are kept any more.
    pub partial: Option<PartialRun>,
    /// The newest of them.
    pub newest: Option<Entry>,
    /// What becomes of the documents, in the order of their first change.
    pub documents: Vec<Restoration>,
    /// How strings compared in the collection, where it was dropped and that was not byte by byte.
    pub collation: Option<Collation>,
}

impl Restoration {
    /// Whether something else would be lost.
    #[must_use]
    pub fn is_conflict(&self) -> bool {
        self.differs || !self.later.is_empty()
    }
}

impl UndoPlan {
    /// The documents of which something else would be lost.
    pub fn conflicts(&self) -> impl Iterator<Item = &Restoration> {
        self.documents.iter().filter(|document| document.is_conflict())
    }
}

/// The changes of one document.
struct Changes {
    order: usize,
    first: Option<Entry>,
    last: Option<Entry>,
    later: Vec<Entry>,
}

impl Memory {
    /// Plans to take back what a selection wants; of that the changes of the `last` runs of commands, or
    /// all of them.
    ///
    /// # Errors
    /// Where the history is not kept, or has not what a document was; where the store fails.
    pub fn plan_undo(&self, selection: &Selection, last: Option<usize>) -> Result<UndoPlan, StoreError> {
        let ns = &selection.namespace;
        let mut selected: Vec<Entry> = self.history(selection)?.collect::<Result<_, _>>()?;
        selected.retain(|entry| entry.change.id.is_some());
        if let Some(last) = last {
            selected = of_last_runs(selected, last);
        }
        let partial = self.partial_run(selection, &selected)?;
        let whole =
            Selection { filter: Document::new(), since: None, by: None, positions: Vec::new(), ..selection.clone() };
        let mut changes: BTreeMap<Vec<u8>, Changes> = BTreeMap::new();
        let mut waiting = selected.iter().peekable();
        let count = selected.len();
        let mut collation = None;
        for (order, entry) in self.history(&whole)?.enumerate() {
            let entry = entry?;
            if entry.change.kind == ChangeKind::Drop {
                collation.clone_from(&entry.collation);
            }
            let Some(id) = &entry.change.id else { continue };
            let key = key::encode_value(id);
            let is_selected = waiting.peek().is_some_and(|next| next.change.position == entry.change.position);
            if is_selected {
                waiting.next();
                let of = changes.entry(key).or_insert(Changes { order, first: None, last: None, later: Vec::new() });
                of.first.get_or_insert_with(|| entry.clone());
                of.last = Some(entry);
            } else if let Some(of) = changes.get_mut(&key) {
                of.later.push(entry);
            }
        }
        let mut ordered: Vec<Changes> = changes.into_values().collect();
        ordered.sort_by_key(|changes| changes.order);
        let documents = ordered.into_iter().filter_map(|changes| self.restoration(ns, changes).transpose());
        let documents = documents.collect::<Result<_, _>>()?;
        Ok(UndoPlan { changes: count, partial, newest: selected.pop(), documents, collation })
    }

    /// The oldest run of these changes of which a selection may want more than is kept.
    fn partial_run(&self, selection: &Selection, selected: &[Entry]) -> Result<Option<PartialRun>, StoreError> {
        let ns = &selection.namespace;
        let history = self.routes.reading(ns)?.history(ns, Some(DateTime::now()))?;
        let Some(History { since: whole_since, cut_runs, .. }) = history else { return Ok(None) };
        let is_whole = selection.since.is_some_and(|since| since >= whole_since);
        if is_whole || !selection.positions.is_empty() {
            return Ok(None);
        }
        let run = selected.iter().filter_map(|entry| entry.run).find(|run| cut_runs.contains(run));
        let mut kept = selected.iter().filter(|entry| run.is_some() && entry.run == run);
        let count = kept.clone().count();
        Ok(kept.next_back().map(|newest| PartialRun { kept: count, newest: newest.clone() }))
    }

    /// What becomes of a document; nothing where it stays as it is.
    fn restoration(&self, ns: &Namespace, changes: Changes) -> Result<Option<Restoration>, StoreError> {
        let (Some(first), Some(last)) = (changes.first, changes.last) else { return Ok(None) };
        let id = first.change.id.clone().unwrap_or(Bson::Null);
        if first.change.before.is_none() && first.change.kind != ChangeKind::Insert {
            let message = format!(
                "the history of {ns} has not what the document with _id {id} was before; on a MongoDB server, it is not kept of \
                 documents of about 8 MB or more, nor before version 6"
            );
            return Err(QueryError::bad_value(message).into());
        }
        let find = Find { filter: doc! { "_id": { "$eq": &id } }, limit: 1, current: true, ..Find::default() };
        let now: Option<RawDocumentBuf> = self.routes.reading(ns)?.find(ns, &find)?.next().transpose()?;
        let target = first.change.before;
        if now == target {
            return Ok(None);
        }
        let expected = last.change.after.filter(|_| last.change.kind != ChangeKind::Delete);
        let differs = changes.later.is_empty() && now != expected;
        let target = target.map(|before| Document::try_from(&*before)).transpose().map_err(QueryError::from)?;
        Ok(Some(Restoration { id, target, later: changes.later, differs }))
    }

    /// Does what was planned where it still is what the selection asks for: on an embedded store, nothing is changed between the
    /// look and the change. So of two processes that take back the same change, one does.
    ///
    /// # Errors
    /// Where another process has changed the collection since the plan was made, or the store fails.
    pub fn undo_unless_changed(
        &self,
        selection: &Selection,
        last: Option<usize>,
        plan: &UndoPlan,
    ) -> Result<(), StoreError> {
        let ns = &selection.namespace;
        self.as_one(ns, &mut || {
            if self.plan_undo(selection, last)? == *plan {
                return self.undo(ns, plan);
            }
            let what = format!(
                "another process has changed {ns} meanwhile, and nothing was done; `rmem history {ns}` shows how, and \
                 `rmem undo` again takes back what is last now"
            );
            Err(StoreError::Held { what })
        })
    }

    /// Does what was planned, on an embedded store as one change.
    ///
    /// # Errors
    /// Where a unique key is taken meanwhile, or the store fails.
    pub fn undo(&self, ns: &Namespace, plan: &UndoPlan) -> Result<(), StoreError> {
        let store = self.routes.of(ns)?;
        let work = || {
            store.atomically(&mut || {
                for gone in plan.documents.iter().filter(|document| document.target.is_none()) {
                    store.delete(ns, (&doc! { "_id": { "$eq": &gone.id } }).into(), true)?;
                }
                let back: Vec<Document> =
                    plan.documents.iter().filter_map(|document| document.target.clone()).collect();
                if let (false, Some(collation)) = (back.is_empty(), &plan.collation) {
                    // One that is there stays as it is.
                    store.create(ns, Some(collation))?;
                }
                store.put(ns, back, None).map(drop)
            })
        };
        let count = plan.documents.len() as u64;
        self.journal.note("undo", Some(ns), |()| count, work)
    }
}

/// The changes of the last runs of commands, also where those of other runs are between them.
fn of_last_runs(entries: Vec<Entry>, last: usize) -> Vec<Entry> {
    let (mut runs, mut count) = (HashSet::new(), 0);
    let mut of_these: Vec<Entry> = entries
        .into_iter()
        .rev()
        .filter(|entry| {
            if entry.run.is_some_and(|run| runs.contains(&run)) {
                return true;
            }
            // A change of which no run is known is one by itself.
            count += 1;
            let is_taken = count <= last;
            runs.extend(entry.run.filter(|_| is_taken));
            is_taken
        })
        .collect();
    of_these.reverse();
    of_these
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::fault::{AtFault as _, Fault};
    use crate::store::{Change, HistoryRule, Scope, StoreUri};

    #[test]
    fn of_two_that_take_back_the_same_change_one_does() {
        let folder = tempfile::tempdir().unwrap();
        let uri = StoreUri::parse(&format!("file:{}", folder.path().join("robot.rmem").display())).unwrap();
        let rules = [HistoryRule { scope: Scope::All, age: Duration::from_secs(3600), size: 1 << 20 }];
        let open = |name| Memory::at(uri.clone(), uri.clone(), Vec::new()).with_history(&rules, name);
        let (one, other) = (open("one"), open("other"));
        let ns = Namespace::parse("robmem.worldmodel").unwrap();
        one.insert(&ns, vec![doc! { "_id": 1 }]).unwrap();
        one.sign("one again");
        one.insert(&ns, vec![doc! { "_id": 2 }]).unwrap();
        let selection =
            Selection { namespace: ns.clone(), filter: doc! {}, since: None, by: None, positions: Vec::new() };
        let planned = other.plan_undo(&selection, Some(1)).unwrap();
        one.sign("an undo");
        let plan = one.plan_undo(&selection, Some(1)).unwrap();
        one.undo_unless_changed(&selection, Some(1), &plan).unwrap();
        let error = other.undo_unless_changed(&selection, Some(1), &planned).unwrap_err();
        assert_eq!(error.fault(), Fault::Conflict, "{error}");
        assert_eq!(one.count(&ns, &doc! {}).unwrap(), 1, "the undo is not taken back");
        // From what is there now, an undo takes the undo back.
        let planned = other.plan_undo(&selection, Some(1)).unwrap();
        other.undo_unless_changed(&selection, Some(1), &planned).unwrap();
        assert_eq!(one.count(&ns, &doc! {}).unwrap(), 2);
    }

    #[test]
    fn runs_are_taken_back_whole_where_others_are_between() {
        let entry = |n: i32, run| {
            let change = Change {
                kind: ChangeKind::Insert,
                id: Some(n.into()),
                before: None,
                after: None,
                time: DateTime::from_millis(0),
                position: n.to_string(),
            };
            Entry { change, dropped: false, author: None, run, collation: None }
        };
        let runs = [Some(1), Some(2), None, Some(2), Some(1), Some(3), Some(1)];
        let taken = |last| {
            let entries = (0..).zip(runs).map(|(n, run)| entry(n, run)).collect();
            of_last_runs(entries, last).into_iter().filter_map(|entry| entry.change.id?.as_i32()).collect::<Vec<_>>()
        };
        assert_eq!(taken(0), [0; 0]);
        assert_eq!(taken(1), [0, 4, 6]);
        assert_eq!(taken(2), [0, 4, 5, 6]);
        assert_eq!(taken(3), [0, 1, 3, 4, 5, 6]);
        assert_eq!(taken(9), [0, 1, 2, 3, 4, 5, 6]);
    }
}
