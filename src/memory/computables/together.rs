//! Answers over stored documents and over others, which are in memory, as if those were stored behind them.

use bson::{Document, RawDocumentBuf};

use crate::query::collation::during;
use crate::query::{Filter, constants};
use crate::store::parsed::Parsed;
use crate::store::{Documents, Find, Namespace, Query, Store, StoreError};

/// The documents that match; none where it takes the store alone to say which: a hint, `$natural`, distances, a search.
pub(super) fn find<'s>(
    store: &'s dyn Store,
    ns: &Namespace,
    find: &Find,
    others: Vec<RawDocumentBuf>,
) -> Result<Option<Documents<'s>>, StoreError> {
    during(find.modifiers.collation.as_ref(), || {
        let parsed = Parsed::of(find)?;
        // The store has the natural order.
        if find.modifiers.hint.is_some() || parsed.sort.is_natural() || !is_plain(&parsed.filter) {
            return Ok(None);
        }
        let others = matching(&parsed.filter, &others)?;
        let most = u64::try_from(parsed.most()).unwrap_or(u64::MAX);
        let limit = if find.limit == 0 { 0 } else { most };
        let stored = Find { projection: Document::new(), skip: 0, limit, ..find.clone() };
        let all = store.find(ns, &stored)?.chain(others.into_iter().map(Ok));
        let answer = parsed.answer(Box::new(all), find.sort.is_empty())?;
        // They are read here, where the collation is in effect.
        let answer = answer.collect::<Result<Vec<_>, _>>()?;
        Ok(Some(Box::new(answer.into_iter().map(Ok)) as Documents<'s>))
    })
}

/// How many documents match; none where [`find`] gives none.
pub(super) fn count(
    store: &dyn Store,
    ns: &Namespace,
    query: Query<'_>,
    others: &[RawDocumentBuf],
) -> Result<Option<u64>, StoreError> {
    let matching = during(query.modifiers.collation.as_ref(), || {
        let filter = Filter::parse_with_constants(query.filter, &constants(&query.modifiers.variables)?)?;
        match query.modifiers.hint.is_some() || !is_plain(&filter) {
            true => Ok(None),
            false => matching(&filter, others).map(Some),
        }
    })?;
    matching.map(|matching| Ok(store.count(ns, query)? + matching.len() as u64)).transpose()
}

fn is_plain(filter: &Filter) -> bool {
    filter.near().is_none() && filter.search().is_none()
}

fn matching(filter: &Filter, documents: &[RawDocumentBuf]) -> Result<Vec<RawDocumentBuf>, StoreError> {
    let mut matching = Vec::new();
    for document in documents {
        if filter.matches(document)? {
            matching.push(document.clone());
        }
    }
    Ok(matching)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::query::Collation;
    use crate::store::{Embedded, Hint, Modifiers};
    use bson::{doc, rawdoc};

    #[test]
    fn an_answer_is_that_of_a_store_with_all_documents() {
        let ns = Namespace::parse("a.b").unwrap();
        let (stored, all) = (Embedded::in_memory().unwrap(), Embedded::in_memory().unwrap());
        let document =
            |n: i32| rawdoc! { "_id": n, "n": n * 7 % 10, "s": [n % 3, "x"], "t": if n % 2 == 0 { "u" } else { "U" } };
        let owned = |n: i32| Document::try_from(&*document(n)).unwrap();
        stored.insert(&ns, (0..30).map(owned).collect()).unwrap();
        all.insert(&ns, (0..40).map(owned).collect()).unwrap();
        let others: Vec<_> = (30..40).map(document).collect();
        let weak = Collation::parse(&doc! { "locale": "en", "strength": 2 }).ok();
        let mut compared = 0;
        for filter in
            [doc! {}, doc! { "n": { "$gt": 3 } }, doc! { "s": 1 }, doc! { "t": "u" }, doc! { "_id": { "$gte": 28 } }]
        {
            for sort in [doc! {}, doc! { "n": 1 }, doc! { "t": 1, "_id": -1 }, doc! { "_id": -1 }] {
                for (skip, limit) in [(0, 0), (0, 3), (2, 25), (35, 0)] {
                    for collation in [None, weak.clone()] {
                        let projection = if filter.contains_key("s") {
                            doc! { "s.$": 1 }
                        } else {
                            doc! { "t": 0 }
                        };
                        let modifiers = Modifiers { collation, ..Modifiers::default() };
                        let find = Find {
                            filter: filter.clone(),
                            sort: sort.clone(),
                            projection,
                            skip,
                            limit,
                            modifiers,
                            ..Find::default()
                        };
                        let wanted: Vec<_> = all.find(&ns, &find).unwrap().map(Result::unwrap).collect();
                        let found = super::find(&stored, &ns, &find, others.clone()).unwrap().unwrap();
                        assert_eq!(found.map(Result::unwrap).collect::<Vec<_>>(), wanted, "{find:?}");
                        let query = Query { filter: &filter, modifiers: &find.modifiers };
                        assert_eq!(count(&stored, &ns, query, &others).unwrap(), Some(all.count(&ns, query).unwrap()));
                        compared += 1;
                    }
                }
            }
        }
        assert_eq!(compared, 160);
        let hinted = Modifiers { hint: Some(Hint::Name("_id_".to_owned())), ..Modifiers::default() };
        let hinted = Find { modifiers: hinted, ..Find::default() };
        assert!(super::find(&stored, &ns, &hinted, others.clone()).unwrap().is_none());
        let natural = Find { sort: doc! { "$natural": -1 }, ..Find::default() };
        assert!(super::find(&stored, &ns, &natural, others).unwrap().is_none());
    }
}
