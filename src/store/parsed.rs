//! A query whose parts are read, and the answer to it over documents that a store, or a list, gives.

use std::sync::Arc;

use bson::{DateTime, RawDocumentBuf};

use super::key_options::keep_record_id;
use super::{Documents, Find, StoreError};
use crate::query::text::{self, asks_for_score};
use crate::query::{Filter, Projection, QueryError, Sort, Spill, check_positional, constants};

/// The parts of a query.
pub(crate) struct Parsed {
    pub(crate) filter: Arc<Filter>,
    pub(crate) sort: Sort,
    projection: Option<Projection>,
    skip: usize,
    /// At most so many documents.
    limit: usize,
    /// Whether documents have to carry the score of a search.
    pub(crate) is_scored: bool,
    /// Whether documents carry their place in the collection, also behind a projection.
    is_placed: bool,
}

impl Parsed {
    /// Reads a query.
    ///
    /// # Errors
    /// Where a part of it is wrong.
    pub(crate) fn of(find: &Find) -> Result<Self, QueryError> {
        let constants = constants(&find.modifiers.variables)?;
        let filter = Arc::new(Filter::parse_with_constants(&find.filter, &constants)?);
        find.keys.check()?;
        let sort = Sort::parse(&find.sort)?;
        let projection = match find.projection.is_empty() {
            true => None,
            false => Some(Projection::parse_with(&find.projection, &constants)?),
        };
        check_positional(&find.filter, &find.projection)?;
        // Keys are returned as they are.
        let projection = projection.filter(|_| !find.keys.return_key);
        let is_scored = asks_for_score(&find.projection) || asks_for_score(&find.sort);
        if is_scored && filter.search().is_none() {
            return Err(text::no_score());
        }
        let limit = if find.limit == 0 { usize::MAX } else { count(find.limit) };
        let is_placed = find.keys.show_record_id;
        Ok(Self { filter, sort, projection, skip: count(find.skip), limit, is_scored, is_placed })
    }

    /// How many documents are looked at, where they come in the order of the sort.
    pub(crate) fn most(&self) -> usize {
        self.skip.saturating_add(self.limit)
    }

    /// The answer, made of all that match.
    ///
    /// # Errors
    /// Where the matches cannot be sorted.
    pub(crate) fn answer(self, matches: Documents<'_>, is_sorted: bool) -> Result<Documents<'_>, StoreError> {
        let most = self.most();
        let ordered: Documents<'_> = match is_sorted {
            true => matches,
            false => {
                let sorted = self.sort.sort(matches, (most < usize::MAX).then_some(most), &Spill::default())?;
                Box::new(sorted.map(|document| Ok(document?)))
            }
        };
        let chosen: Documents<'_> = match (self.skip, self.limit) {
            (0, usize::MAX) => ordered,
            (skip, limit) => Box::new(ordered.skip(skip).take(limit)),
        };
        let now = DateTime::now();
        Ok(match self.projection {
            None => chosen,
            Some(_) => Box::new(chosen.map(move |document| Ok(self.shown(document?, now)?))),
        })
    }

    /// A match as it is asked for.
    ///
    /// # Errors
    /// Where the projection fails on it.
    pub(crate) fn shown(&self, document: RawDocumentBuf, now: DateTime) -> Result<RawDocumentBuf, QueryError> {
        let Some(projection) = &self.projection else { return Ok(document) };
        let mut shown = projection.apply(&document, &self.filter, now)?;
        if self.is_placed {
            keep_record_id(&document, &mut shown);
        }
        Ok(shown)
    }
}

fn count(number: u64) -> usize {
    usize::try_from(number).unwrap_or(usize::MAX)
}
