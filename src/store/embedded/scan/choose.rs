//! Which way a scan takes: along the documents, along an index, or to known positions.

use std::cell::Cell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::sync::Arc;

use bson::Document;

use super::found::PAGE_DOCUMENTS;
use super::sharing::Sharing;
use super::{Examined, Rest, Scan};
use crate::query::{Filter, QueryError, Sort};
use crate::store::embedded::Embedded;
use crate::store::embedded::access::{Chosen, Way};
use crate::store::embedded::catalog::Collection;
use crate::store::embedded::indexed::{Indexes, decay};
use crate::store::{Find, Hint, KeyOptions, StoreError, metadata};

/// Which index is to be read, and between which keys.
#[derive(Clone, Copy)]
pub(in crate::store::embedded) struct Hinted<'q> {
    hint: Option<&'q Hint>,
    keys: Option<&'q KeyOptions>,
}

impl<'q> From<&'q Find> for Hinted<'q> {
    fn from(find: &'q Find) -> Self {
        Self { hint: find.modifiers.hint.as_ref(), keys: Some(&find.keys).filter(|keys| keys.is_bounded()) }
    }
}

impl<'q> From<Option<&'q Hint>> for Hinted<'q> {
    fn from(hint: Option<&'q Hint>) -> Self {
        Self { hint, keys: None }
    }
}

impl<'a> Scan<'a> {
    /// The matches in order of insertion.
    pub(in crate::store::embedded) fn new(
        store: &'a Embedded,
        collection: Collection,
        filter: &mut Arc<Filter>,
    ) -> Result<Self, StoreError> {
        Ok(Self::choose(store, collection, filter, &Sort::none(), None.into(), false)?.0)
    }

    /// The matches by the index that is to be read, or in the order of the sort, where an index has it, else in
    /// order of insertion; [`Scan::in_order`] says which.
    pub(in crate::store::embedded) fn sorted(
        store: &'a Embedded,
        collection: Collection,
        filter: &mut Arc<Filter>,
        sort: &Sort,
        hinted: Hinted<'_>,
    ) -> Result<Self, StoreError> {
        Ok(Self::choose(store, collection, filter, sort, hinted, false)?.0)
    }

    /// The same, with an explanation of the access path.
    pub(in crate::store::embedded) fn explained(
        store: &'a Embedded,
        collection: Collection,
        filter: &mut Arc<Filter>,
        sort: &Sort,
        hinted: Hinted<'_>,
    ) -> Result<(Self, Document), StoreError> {
        Self::choose(store, collection, filter, sort, hinted, true)
    }

    fn choose(
        store: &'a Embedded,
        collection: Collection,
        filter: &mut Arc<Filter>,
        sort: &Sort,
        Hinted { hint, keys }: Hinted<'_>,
        is_explained: bool,
    ) -> Result<(Self, Document), StoreError> {
        let indexes = store.indexes_of(collection)?;
        sharpen(&indexes, filter);
        let mut chosen = match (filter.near(), hint, keys) {
            (_, Some(_), _) | (_, _, None) if filter.search().is_some() => {
                store.by_words(collection, &indexes, filter, (sort, hint))?
            }
            (Some(_), _, Some(_)) => return Err(QueryError::unsupported("$near between keys (min, max)").into()),
            (None, _, Some(keys)) => store.between(collection, &indexes, sort, hint, keys)?,
            (None, Some(hint), None) => store.hinted(collection, &indexes, filter, sort, hint)?,
            (Some(near), _, None) => store.by_distance(collection, &indexes, filter, near, sort)?,
            (None, None, None) => store.choose(collection, &indexes, filter, sort, is_explained)?,
        };
        let explanation = std::mem::take(&mut chosen.explanation);
        Ok((Self::along(store, collection, filter, chosen)?, explanation))
    }

    /// The matches by a way that was chosen.
    pub(in crate::store::embedded) fn along(
        store: &'a Embedded,
        collection: Collection,
        filter: &Arc<Filter>,
        chosen: Chosen,
    ) -> Result<Self, StoreError> {
        let last = |store: &Embedded| collection.last(&store.connection).map_err(|e| store.explain(&e));
        let mut listings = Vec::new();
        let rest = match chosen.way {
            _ if filter.matches_none() => Rest::Nothing,
            Way::Walk => Rest::Between(i64::MIN, last(store)?),
            Way::Positions(positions, listed_by) => {
                listings = listed_by;
                Rest::At(positions)
            }
            // What it lists is read at one moment.
            Way::Listed(listing) => Rest::Listed(listing),
        };
        let examined = Examined { keys: Cell::new(chosen.keys), documents: Cell::default() };
        Ok(Self {
            store,
            collection,
            filter: Arc::clone(filter),
            // The rest of an index is listed with the first page, so that page is large.
            page_documents: if matches!(rest, Rest::Listed(_)) { PAGE_DOCUMENTS } else { 1 },
            is_whole: matches!(rest, Rest::Between(..)),
            rest,
            listings,
            page: VecDeque::new(),
            is_up_to_failure: false,
            failure: None,
            most: usize::MAX,
            is_sorted: chosen.is_sorted,
            examined: Rc::new(examined),
            sharing: Sharing::never(),
        })
    }
}

/// Removes the conditions on decay and computation from a filter where the collection has no decaying documents.
/// Computed documents decay.
pub(in crate::store::embedded) fn sharpen(indexes: &Indexes, filter: &mut Arc<Filter>) {
    if let (None, Some(filter)) = (decay(indexes), Arc::get_mut(filter)) {
        filter.assume_missing(&[metadata::DECAY_PATH, metadata::TOKEN_PATH]);
    }
}
