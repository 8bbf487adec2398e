//! Finding a document and changing it in one step: one transaction, in which the query is asked once. A query whose answer is
//! not always the same (`$rand`) so names the document that is changed.

use std::sync::Arc;

use bson::{DateTime, RawDocumentBuf};

use super::Embedded;
use super::catalog::Collection;
use super::change::Change;
use super::scan::{Found, Scan};
use super::search::scored;
use crate::query::collation::during;
use crate::query::{QueryError, Spill, constants, text};
use crate::store::key_options::RECORD_ID;
use crate::store::parsed::Parsed;
use crate::store::{Documents, Find, FindAndModify, Modification, Modified, Namespace, StoreError};

/// MongoDB's code for a name of a field that begins with `$`.
const DOLLAR_PREFIXED: i32 = 52;

impl Embedded {
    pub(super) fn modify_first(
        &self,
        ns: &Namespace,
        request: &FindAndModify,
        timestamp: Option<DateTime>,
    ) -> Result<Modified, StoreError> {
        let _deleting = matches!(request.modification, Modification::Remove).then(|| self.deleting());
        let collation = self.collation(self.collection(ns)?, &request.modifiers)?;
        during(collation.as_ref(), || self.write(|| self.modify(ns, request, timestamp)))
    }

    fn modify(
        &self,
        ns: &Namespace,
        request: &FindAndModify,
        timestamp: Option<DateTime>,
    ) -> Result<Modified, StoreError> {
        // Of several mistakes, that of the update is the first.
        let constants = constants(&request.modifiers.variables)?;
        let update = request.update_of(request.filter.clone());
        let change = match update.as_ref().map(|update| Change::parse(update, timestamp, &constants)) {
            // Names of fields are for the document itself.
            Some(Err(mistake)) if mistake.code != DOLLAR_PREFIXED => return Err(mistake.into()),
            change => change,
        };
        request.check()?;
        let find = request.find(request.projection.clone());
        let mut parsed = Parsed::of(&find)?;
        let collection = self.collection(ns)?;
        if let (Some(collection), Some(_), false) = (collection, &change, ns.is_own()) {
            self.sweep(ns, collection)?;
        }
        let found = match collection {
            Some(collection) => self.first(collection, &find, &mut parsed)?.map(|found| (collection, found)),
            None => None,
        };
        let shown = Shown { parsed, is_new: request.new, now: timestamp.unwrap_or_else(DateTime::now) };
        match (found, change) {
            (Some((collection, found)), None) => {
                self.erase(ns, collection, &found)?;
                Ok(shown.change(found.body, None, true)?)
            }
            (Some((collection, found)), Some(change)) => {
                let change = change?;
                self.bind_search(ns, change.filter())?;
                let after = self.change_one(ns, collection, &found, &change)?;
                let is_changed = after.is_some();
                Ok(shown.change(found.body, after, is_changed)?)
            }
            (None, Some(change)) if update.is_some_and(|update| update.upsert) => {
                let (id, body) = self.upsert(ns, &request.filter, &change?)?;
                let document = if request.new { Some(shown.of(body, None)?) } else { None };
                Ok(Modified { document, is_found: false, is_changed: true, upserted: Some(id) })
            }
            (None, _) => Ok(Modified::default()),
        }
    }

    /// The first match.
    fn first(&self, collection: Collection, find: &Find, parsed: &mut Parsed) -> Result<Option<Found>, StoreError> {
        let scan = Scan::sorted(self, collection, &mut parsed.filter, &parsed.sort, find.into())?;
        if scan.in_order() {
            return scan.at_most(1).up_to_failure().next().transpose();
        }
        let matches: Documents<'_> = Box::new(scan.map(|found| found.map(Found::with_position)));
        let matches = if parsed.is_scored { scored(matches, Arc::clone(&parsed.filter)) } else { matches };
        let first = parsed.sort.sort(matches, Some(1), &Spill::default())?.next().transpose()?;
        first.and_then(|first| position(&first)).map(|position| self.at(collection, position)).transpose()
    }
}

/// The place that a document was given to be sorted with: behind its own fields, one of which may have that name.
fn position(document: &RawDocumentBuf) -> Option<i64> {
    let named = document.iter().flatten().filter(|(name, _)| *name == RECORD_ID);
    named.last().and_then(|(_, position)| position.as_i64())
}

/// What is returned of the document that was found.
struct Shown {
    parsed: Parsed,
    is_new: bool,
    now: DateTime,
}

impl Shown {
    /// The document before or after a change, with the score by which it was found; after none, it is as it was.
    fn change(
        &self,
        before: RawDocumentBuf,
        after: Option<RawDocumentBuf>,
        is_changed: bool,
    ) -> Result<Modified, QueryError> {
        let search = self.parsed.filter.search().filter(|_| self.parsed.is_scored);
        let score = search.map(|search| search.score(&before)).transpose()?.flatten();
        let document = after.filter(|_| self.is_new).unwrap_or(before);
        Ok(Modified { document: Some(self.of(document, score)?), is_found: true, is_changed, upserted: None })
    }

    fn of(&self, document: RawDocumentBuf, score: Option<f64>) -> Result<RawDocumentBuf, QueryError> {
        match score {
            None => self.parsed.shown(document, self.now),
            Some(score) => text::without_score(self.parsed.shown(text::with_score(&document, score)?, self.now)?),
        }
    }
}
