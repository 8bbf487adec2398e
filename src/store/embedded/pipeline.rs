//! Aggregation.

use std::sync::Arc;

use bson::{DateTime, Document, RawDocumentBuf};

use super::Embedded;
use super::output::{check_merged, named};
use super::scan::Scan;
use super::search::{bind, scored, unscored};
use crate::query::{
    Description, Filter, Origin, Output, Pipeline, QueryError, Sort, Spill, Spool, constants, is_empty_match,
};
use crate::store::{Aggregation, Documents, Hint, Namespace, Query, StoreError, metadata};

/// How many documents at a time go through a pipeline whose stages allow it.
const PIECE: usize = 256;

impl Embedded {
    /// Runs a pipeline. Where its stages allow it, results are computed as they are read;
    /// otherwise all of them before, and kept in a temporary file where they are many.
    pub(super) fn run_pipeline(
        &self,
        ns: &Namespace,
        Aggregation { stages, modifiers }: Aggregation<'_>,
    ) -> Result<Documents<'_>, StoreError> {
        let description = stages.first().map(Description::parse).transpose()?.flatten();
        let described = description.map(|description| self.described(ns, description)).transpose()?;
        let stages = if described.is_some() { stages.get(1..).unwrap_or_default() } else { stages };
        let stages = &self.with_near_key(ns, stages)?;
        let constants = constants(&modifiers.variables)?;
        let mut pipeline = Pipeline::parse_with(stages, &constants)?;
        if let (Some(near), Some(collection)) = (pipeline.near(), self.collection(ns)?) {
            self.check_near(collection, near)?;
        }
        self.bind_searches(ns, &pipeline)?;
        if let Some(Output::Merge(merge)) = pipeline.output() {
            self.check_mergeable(ns, merge)?;
        }
        if described.is_none() && pipeline.counted(0).is_some() {
            let query = Query { filter: &first_filter(stages), modifiers };
            let counted = pipeline.counted(self.tally(ns, query)?).unwrap_or_default();
            let counted =
                counted.iter().map(|document| Ok(RawDocumentBuf::try_from(document).map_err(QueryError::from)?));
            return Ok(Box::new(counted.collect::<Vec<_>>().into_iter()));
        }
        let is_filtered = described.is_none() && !stages.first().is_some_and(is_empty_match);
        let input: Documents<'_> = match (described, pipeline.brings_documents()) {
            (Some(documents), _) => Box::new(documents.into_iter().map(Ok)),
            (None, true) => Box::new(std::iter::empty()),
            (None, false) => {
                self.input(ns, &first_filter(stages), &constants, (modifiers.hint.as_ref(), pipeline.is_scored()))?
            }
        };
        if is_filtered {
            pipeline.assume_first_match();
        }
        let is_scored = pipeline.is_scored();
        let now = DateTime::now();
        if pipeline.is_piecewise() && pipeline.output().is_none() {
            let results = self.pieces(ns, pipeline, input, now);
            return Ok(if is_scored { unscored(results) } else { results });
        }
        let sources = |origin: &Origin, filter: Option<&Document>| self.source(&named(origin, ns), filter);
        let found = pipeline.run(input, now, &sources);
        let mut results = Spool::new(&Spill::default());
        for result in if is_scored { unscored(found) } else { found } {
            let result = result?;
            match pipeline.output() {
                Some(Output::Merge(merge)) => {
                    check_merged(merge, &result).and_then(|()| metadata::check_result(&result))
                }
                Some(Output::Out(_)) => metadata::check_result(&result),
                None => Ok(()),
            }?;
            results.push(&result)?;
        }
        let results = results.read()?.map(|result| Ok(result?));
        match pipeline.output() {
            None => Ok(Box::new(results)),
            Some(output) => {
                self.write_results(ns, output, &mut results.into_iter(), now)?;
                Ok(Box::new(std::iter::empty()))
            }
        }
    }

    /// Lets the searches of a pipeline know what they search.
    ///
    /// # Errors
    /// Where a collection has no text index.
    fn bind_searches(&self, ns: &Namespace, pipeline: &Pipeline) -> Result<(), StoreError> {
        for (origin, filter) in pipeline.searches() {
            let other = origin.map(|origin| named(origin, ns));
            if let Some(collection) = self.collection(other.as_ref().unwrap_or(ns))? {
                bind(filter, &self.indexes_of(collection)?)?;
            }
        }
        Ok(())
    }

    /// The results of a pipeline, made of some documents at a time.
    fn pieces<'a>(
        &'a self,
        ns: &Namespace,
        pipeline: Pipeline,
        mut input: Documents<'a>,
        now: DateTime,
    ) -> Documents<'a> {
        let ns = ns.clone();
        let mut results = Vec::new().into_iter();
        let mut is_over = false;
        Box::new(std::iter::from_fn(move || {
            loop {
                if let Some(result) = results.next() {
                    return Some(result);
                }
                if is_over {
                    return None;
                }
                let piece: Vec<_> = input.by_ref().take(PIECE).collect();
                is_over = piece.len() < PIECE;
                let sources = |origin: &Origin, filter: Option<&Document>| self.source(&named(origin, &ns), filter);
                let made = until_failed(pipeline.run(Box::new(piece.into_iter()), now, &sources));
                is_over |= made.last().is_some_and(Result::is_err);
                results = made.into_iter();
            }
        }))
    }

    /// The documents that match, in natural order.
    pub(super) fn matches(&self, ns: &Namespace, filter: &Document) -> Result<Documents<'_>, StoreError> {
        self.input(ns, filter, &Document::new(), (None, false))
    }

    /// The documents of a collection that a stage names; those that match a filter where an index finds them, else nothing.
    fn source(&self, ns: &Namespace, filter: Option<&Document>) -> Result<Option<Documents<'_>>, StoreError> {
        let Some(filter) = filter else { return self.matches(ns, &Document::new()).map(Some) };
        let Some(collection) = self.collection(ns)? else { return Ok(None) };
        let scan = Scan::new(self, collection, &mut Arc::new(Filter::parse(filter)?))?;
        Ok(match scan.looks_at_all() {
            true => None,
            false => Some(Box::new(scan.map(|found| found.map(|found| found.body)))),
        })
    }

    /// The documents that match: in natural order, or in that of the index that is to be read.
    fn input(
        &self,
        ns: &Namespace,
        filter: &Document,
        constants: &Document,
        (hint, is_scored): (Option<&Hint>, bool),
    ) -> Result<Documents<'_>, StoreError> {
        let mut filter = Arc::new(Filter::parse_with_constants(filter, constants)?);
        let Some(collection) = self.collection(ns)? else { return Ok(Box::new(std::iter::empty())) };
        let scan = Scan::sorted(self, collection, &mut filter, &Sort::none(), hint.into())?.shared();
        let documents: Documents<'_> = Box::new(scan.map(|found| found.map(|found| found.body)));
        Ok(if is_scored { scored(documents, filter) } else { documents })
    }
}

/// What there is up to the first failure: nothing behind it is computed.
fn until_failed<T, E>(results: impl Iterator<Item = Result<T, E>>) -> Vec<Result<T, E>> {
    let mut made = Vec::new();
    for result in results {
        let has_failed = result.is_err();
        made.push(result);
        if has_failed {
            break;
        }
    }
    made
}

/// The filter of a `$match` or `$geoNear` in front: only what it matches needs to be read.
fn first_filter(stages: &[Document]) -> Document {
    let matched = |stage: &Document| match stage.get_document("$geoNear") {
        Ok(near) => near.get_document("query").ok().cloned(),
        Err(_) => stage.get_document("$match").ok().cloned(),
    };
    stages.iter().find(|stage| !is_empty_match(stage)).and_then(matched).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use bson::{Bson, bson, doc};

    use super::*;
    use crate::store::{Index, Modifiers, Store as _};

    #[test]
    fn nothing_is_computed_behind_a_failure() {
        let mut asked = 0;
        let results = (0..9).map(|number| if number == 2 { Err(number) } else { Ok(number) }).inspect(|_| asked += 1);
        assert_eq!(until_failed(results), [Ok(0), Ok(1), Err(2)]);
        assert_eq!(asked, 3);
    }

    #[test]
    fn a_lookup_finds_the_same_documents_with_an_index_and_without() {
        let store = Embedded::in_memory().unwrap();
        let ns = |name: &str| Namespace { database: "a".into(), collection: name.into() };
        let regex =
            Bson::RegularExpression(bson::Regex { pattern: "a".try_into().unwrap(), options: "i".try_into().unwrap() });
        let values: [Bson; 12] = [
            bson!(1),
            bson!(1.0),
            bson!("a"),
            bson!(["a", 1]),
            bson!([["a"], 2]),
            bson!([]),
            Bson::Null,
            bson!({ "b": 1 }),
            bson!([{ "b": 1 }, { "b": [2, 3] }]),
            bson!(true),
            bson!(f64::NAN),
            regex,
        ];
        let documents = || values.iter().enumerate().map(|(nth, value)| doc! { "_id": nth as i32, "v": value.clone() });
        let missing = doc! { "_id": 99 };
        for name in ["ours", "theirs"] {
            store.insert(&ns(name), documents().chain([missing.clone()]).collect()).unwrap();
        }
        let answers = |local: &str, foreign: &str| -> Vec<RawDocumentBuf> {
            let lookup = doc! { "from": "theirs", "localField": local, "foreignField": foreign, "as": "found" };
            let stages = [doc! { "$lookup": lookup }];
            let aggregation = Aggregation { stages: &stages, modifiers: &Modifiers::default() };
            store.aggregate(&ns("ours"), aggregation).unwrap().collect::<Result<_, _>>().unwrap()
        };
        for (local, foreign) in [("v", "v"), ("v", "v.b"), ("v.b", "v.b"), ("v", "_id"), ("v.b", "v.b.0")] {
            let expected = answers(local, foreign);
            store.create_index(&ns("theirs"), &Index::on(doc! { foreign: 1 })).unwrap();
            assert_eq!(answers(local, foreign), expected, "{local} and {foreign}");
        }
    }

    #[test]
    fn what_a_stage_leaves_out_takes_no_memory() {
        let store = Embedded::in_memory().unwrap();
        let ns = Namespace { database: "a".into(), collection: "b".into() };
        let items: Vec<i32> = (0..10_000).collect();
        store.insert(&ns, vec![doc! { "_id": 1, "a": 1, "items": items }]).unwrap();
        let with_number = doc! { "path": "$items", "includeArrayIndex": "n" };
        let stages = [
            doc! { "$unwind": "$items" },
            doc! { "$unwind": with_number },
            doc! { "$project": { "a": 1 } },
            doc! { "$project": { "items": 0 } },
            doc! { "$set": { "items": 1 } },
            doc! { "$replaceWith": { "a": "$a" } },
        ];
        for stage in stages {
            let aggregation = Aggregation { stages: std::slice::from_ref(&stage), modifiers: &Modifiers::default() };
            for made in store.aggregate(&ns, aggregation).unwrap() {
                assert!(made.unwrap().into_bytes().capacity() < 200, "{stage}");
            }
        }
    }

    #[test]
    fn a_lookup_of_many_values_finds_all_with_an_index() {
        let store = Embedded::in_memory().unwrap();
        let ns = |name: &str| Namespace { database: "a".into(), collection: name.into() };
        let wide = |n: i32| doc! { "_id": n, "all": (n..n + 4_000).collect::<Vec<i32>>() };
        store.insert(&ns("wide"), (0..5).map(wide).collect()).unwrap();
        store.insert(&ns("few"), (0..10).map(|n| doc! { "_id": n, "k": 1 }).collect()).unwrap();
        let lookup = doc! { "from": "few", "localField": "all", "foreignField": "_id", "as": "found" };
        let stages = [doc! { "$lookup": lookup }, doc! { "$project": { "n": { "$size": "$found" } } }];
        let aggregation = Aggregation { stages: &stages, modifiers: &Modifiers::default() };
        let found = store.aggregate(&ns("wide"), aggregation).unwrap();
        // After the second document, the index is not asked any more.
        let expected: Vec<RawDocumentBuf> = (0..5).map(|n| bson::rawdoc! { "_id": n, "n": 10 - n }).collect();
        assert_eq!(found.collect::<Result<Vec<_>, _>>().unwrap(), expected);
    }

    #[test]
    fn what_matches_is_counted_as_it_is_when_it_is_read() {
        let store = Embedded::in_memory().unwrap();
        let ns = Namespace { database: "a".into(), collection: "b".into() };
        let answer = |stages: &[Document]| -> Vec<Document> {
            let aggregation = Aggregation { stages, modifiers: &Modifiers::default() };
            let found = store.aggregate(&ns, aggregation).unwrap();
            found.map(|document| Document::try_from(document.unwrap()).unwrap()).collect()
        };
        for documents in [0, 9] {
            if documents > 0 {
                store.insert(&ns, (0..documents).map(|n| doc! { "_id": n, "n": n % 3 }).collect()).unwrap();
            }
            let lasts = [
                doc! { "$count": "all" },
                doc! { "$group": { "_id": null, "n": { "$sum": 1 } } },
                doc! { "$group": { "_id": 1, "n": { "$sum": 1 } } },
            ];
            for last in lasts {
                for filter in [doc! {}, doc! { "n": { "$lt": 2 } }, doc! { "n": 7 }] {
                    let stages = [doc! { "$match": filter }, last.clone()];
                    // With a stage that changes nothing, all documents are read.
                    let read = [stages[0].clone(), doc! { "$skip": 0 }, last.clone()];
                    assert_eq!(answer(&stages), answer(&read), "{stages:?}");
                }
                assert_eq!(answer(std::slice::from_ref(&last)), answer(&[doc! { "$skip": 0 }, last.clone()]));
            }
        }
    }

    #[test]
    fn a_filter_in_front_is_asked_once() {
        let store = Embedded::in_memory().unwrap();
        let ns = Namespace { database: "a".into(), collection: "b".into() };
        store.insert(&ns, (0..2_000).map(|n| doc! { "_id": n, "n": n % 2 }).collect()).unwrap();
        let count = |stages: &[Document]| {
            let aggregation = Aggregation { stages, modifiers: &Modifiers::default() };
            store.aggregate(&ns, aggregation).unwrap().map(Result::unwrap).count()
        };
        let some = count(&[doc! { "$match": { "$sampleRate": 0.5 } }]);
        // Asked twice, a quarter would be left.
        assert!((800..1_200).contains(&some), "{some}");
        let matching = |filter: Document| doc! { "$match": filter };
        for in_front in [doc! {}, doc! { "$comment": "all" }, doc! { "_id": { "$gte": 0 } }] {
            let all = [matching(in_front), matching(doc! { "n": 1 }), doc! { "$project": { "n": 1 } }];
            assert_eq!(count(&all), 1_000, "{all:?}");
        }
    }
}
