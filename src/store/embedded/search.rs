//! `$text`: answered by a scan, but only with a text index, as in MongoDB.

use std::collections::{BTreeMap, HashSet};
use std::sync::Arc;

use bson::doc;

use super::Embedded;
use super::access::{Chosen, Way};
use super::catalog::Collection;
use super::indexed::{Indexed, Indexes, PARTIAL};
use super::scan::Scan;
use crate::query::text::{self, TextIndex};
use crate::query::{Filter, QueryError, QueryMistake, Sort};
use crate::store::{Documents, Hint, Namespace, StoreError};

/// MongoDB's code for a query that no index answers which needs one.
const NO_PLAN: i32 = 291;

impl Embedded {
    /// The way to the documents that a search finds: word by word, the best first.
    pub(super) fn by_words(
        &self,
        collection: Collection,
        indexes: &Indexes,
        filter: &Arc<Filter>,
        (sort, hint): (&Sort, Option<&Hint>),
    ) -> Result<Chosen, StoreError> {
        let index = text_index(indexes)?;
        if hint.is_some() {
            return Err(QueryError::bad_value("$text takes no hint: there is one text index")
                .of_kind(QueryMistake::Hint)
                .into());
        }
        check_fixed(index.1, filter)?;
        check_alternatives(indexes, filter)?;
        bind(filter, indexes)?;
        let search = filter.search().ok_or_else(|| self.fail("a search was lost"))?;
        let candidates = self.choose(collection, indexes, filter, &Sort::none(), false)?;
        let (mut by_word, mut unscored) = (BTreeMap::<String, Vec<(f64, i64)>>::new(), Vec::new());
        for found in Scan::along(self, collection, filter, candidates)? {
            let found = found?;
            match search.scores(&found.body)? {
                None => unscored.push(found.position),
                Some(scores) => {
                    for (word, score) in scores {
                        by_word.entry(word).or_default().push((score, found.position));
                    }
                }
            }
        }
        let mut seen = HashSet::new();
        let ranked = by_word.into_values().flat_map(|mut found| {
            found.sort_by(|a, b| b.0.total_cmp(&a.0).then(b.1.cmp(&a.1)));
            found.into_iter().map(|(_, position)| position)
        });
        let positions = ranked.chain(unscored).filter(|position| seen.insert(*position)).collect();
        let explanation = doc! { "index": &index.0.definition.name, "keys": index.0.definition.keys.clone() };
        Ok(Chosen { way: Way::Positions(positions, Vec::new()), is_sorted: sort.is_empty(), explanation, keys: 0 })
    }

    /// Lets the search of a filter know what it searches.
    ///
    /// # Errors
    /// Where the collection has no text index.
    pub(super) fn bind_search(&self, ns: &Namespace, filter: &Filter) -> Result<(), StoreError> {
        if let (Some(_), Some(collection)) = (filter.search(), self.collection(ns)?) {
            bind(filter, &self.indexes_of(collection)?)?;
        }
        Ok(())
    }
}

/// Lets the search of a filter know what it searches.
///
/// # Errors
/// Where there is no text index.
pub(super) fn bind(filter: &Filter, indexes: &Indexes) -> Result<(), QueryError> {
    let (index, text) = text_index(indexes)?;
    filter.bind(text, index.definition.other.get_document(PARTIAL).ok())
}

/// Documents with the score that a search gives them.
pub(super) fn scored<'a>(documents: Documents<'a>, filter: Arc<Filter>) -> Documents<'a> {
    Box::new(documents.map(move |document| {
        let document = document?;
        match filter.search().map(|search| search.score(&document)).transpose()?.flatten() {
            Some(score) => Ok(text::with_score(&document, score)?),
            None => Ok(document),
        }
    }))
}

/// The same documents without their scores.
pub(super) fn unscored(documents: Documents<'_>) -> Documents<'_> {
    Box::new(documents.map(|document| Ok(text::without_score(document?)?)))
}

/// The text index of a collection.
pub(super) fn text_index(indexes: &Indexes) -> Result<(&Indexed, &Arc<TextIndex>), QueryError> {
    let found = indexes.iter().find_map(|index| index.pattern.text().map(|text| (index, text)));
    match found {
        Some((index, _)) if index.is_hidden() => {
            Err(QueryError::invalid(NO_PLAN, "the text index is hidden, and $text needs it").about("$text"))
        }
        Some(found) => Ok(found),
        None => Err(text::no_index()),
    }
}

/// Refuses a search that does not say where in the index it is.
fn check_fixed(index: &TextIndex, filter: &Filter) -> Result<(), QueryError> {
    match index.fixed().find(|path| !filter.fixes(path)) {
        None => Ok(()),
        Some(path) => {
            let message = format!("the text index has the key {path} in front; give it a value beside $text");
            Err(QueryError::invalid(NO_PLAN, message).about("$text"))
        }
    }
}

/// Refuses alternatives to a search that no index finds: then it would not be the text index that finds all.
fn check_alternatives(indexes: &Indexes, filter: &Filter) -> Result<(), QueryError> {
    let begins_with = |index: &Indexed, path: &str| {
        let is_usable = !index.is_hidden() && index.definition.other.get(PARTIAL).is_none();
        is_usable && (index.pattern.is_wildcard() || index.definition.keys.keys().next().is_some_and(|key| key == path))
    };
    let is_indexed = |path: &str| path == "_id" || indexes.iter().any(|index| begins_with(index, path));
    if filter.has_indexed_alternatives(&is_indexed) {
        return Ok(());
    }
    let message = "$text within $or needs an index for each other alternative; make one, or ask in two queries";
    Err(QueryError::invalid(NO_PLAN, message).about("$text"))
}
