//! Tests that a result is the same whether it is made in memory or in temporary files.

use bson::{Bson, DateTime, Document, RawDocumentBuf, doc};
use proptest::prelude::*;

use super::error::{QueryError, Result};
use super::{Distinct, Documents, Origin, Pipeline, Sort, Spill};
use crate::fault::{AtFault as _, Fault};

/// Values of all the types that accumulators tell apart, few enough that many are equal.
fn value() -> impl Strategy<Value = Option<Bson>> {
    let decimal = |number: i8| Bson::Decimal128(format!("{number}.50").parse().expect("a decimal"));
    prop_oneof![
        Just(None),
        Just(Some(Bson::Null)),
        (-3..3i32).prop_map(|number| Some(number.into())),
        any::<i64>().prop_map(|number| Some(number.into())),
        prop::num::f64::ANY.prop_map(|number| Some(number.into())),
        any::<i8>().prop_map(move |number| Some(decimal(number))),
        "[a-c]{0,2}".prop_map(|text| Some(text.into())),
        prop::collection::vec(0..3i32, 0..3).prop_map(|numbers| Some(numbers.into())),
        (0..3i32).prop_map(|number| Some(doc! { "x": number }.into())),
    ]
}

fn document() -> impl Strategy<Value = Document> {
    (value(), value(), 0..20i32).prop_map(|(key, value, group)| {
        let fields = [("k", key), ("v", value), ("g", Some(group.into()))];
        fields.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?))).collect()
    })
}

fn documents() -> impl Strategy<Value = Vec<RawDocumentBuf>> {
    let numbered = |documents: Vec<Document>| {
        let numbered = documents.into_iter().enumerate().map(|(number, mut document)| {
            document.insert("_id", number as i64);
            RawDocumentBuf::try_from(&document).expect("a document")
        });
        numbered.collect()
    };
    prop::collection::vec(document(), 0..120).prop_map(numbered)
}

fn within(limit: usize) -> Spill {
    Spill { limit, ..Spill::default() }
}

fn run(stages: &[Document], documents: &[RawDocumentBuf], limit: usize) -> Result<Vec<RawDocumentBuf>> {
    let pipeline = Pipeline::parse(stages)?;
    let input: Documents<'_, QueryError> = Box::new(documents.iter().cloned().map(Ok));
    let all = || Box::new(documents.iter().cloned().map(Ok)) as Documents<'_, QueryError>;
    let same = |_: &Origin, filter: Option<&Document>| Ok(filter.is_none().then(all));
    pipeline.run_within(input, DateTime::from_millis(0), &same, within(limit)).collect()
}

/// Window functions of each kind, over a window.
fn windows(bounds: Document, partition: Option<&str>) -> Document {
    let mut output: Document = ["$sum", "$avg", "$push", "$stdDevSamp", "$first", "$last"]
        .map(|function| (function.replace('$', ""), doc! { function: "$v", "window": bounds.clone() }.into()))
        .into_iter()
        .collect();
    let pair = doc! { "$covariancePop": ["$_id", "$g"], "window": bounds.clone() };
    let slope = doc! { "$derivative": { "input": "$g" }, "window": bounds.clone() };
    let area = doc! { "$integral": { "input": "$g" }, "window": bounds };
    output.extend(doc! {
        "pair": pair, "slope": slope, "area": area, "place": { "$rank": {} }, "number": { "$documentNumber": {} },
        "shift": { "$shift": { "output": "$v", "by": -2, "default": 7 } }, "ahead": { "$shift": { "output": "$_id", "by": 30 } },
        "average": { "$expMovingAvg": { "input": "$v", "N": 3 } }, "locf": { "$locf": "$v" }, "all": { "$max": "$v" },
        "line": { "$linearFill": { "$cond": [{ "$eq": [{ "$mod": ["$_id", 7] }, 0] }, "$g", null] } },
    });
    let mut stage = doc! { "sortBy": { "_id": 1 }, "output": output };
    stage.extend(partition.map(|field| ("partitionBy".to_owned(), field.into())));
    doc! { "$setWindowFields": stage }
}

/// All accumulators at once.
fn group(id: impl Into<Bson>) -> Document {
    let sorted = doc! { "v": -1, "g": 1 };
    let script = doc! {
        "init": "function() { return [] }", "accumulate": "function(all, id) { return all.concat([id]) }",
        "accumulateArgs": ["$_id"], "merge": "function(a, b) { return a.concat(b) }", "lang": "js",
    };
    doc! { "$group": {
        "_id": id,
        "sum": { "$sum": "$v" }, "avg": { "$avg": "$v" }, "pop": { "$stdDevPop": "$v" }, "samp": { "$stdDevSamp": "$v" },
        "min": { "$min": "$v" }, "max": { "$max": "$v" }, "first": { "$first": "$v" }, "last": { "$last": "$v" },
        "push": { "$push": "$v" }, "set": { "$addToSet": "$v" }, "merge": { "$mergeObjects": { "a": "$v", "b": "$g" } },
        "firstN": { "$firstN": { "input": "$v", "n": 2 } }, "lastN": { "$lastN": { "input": "$v", "n": 2 } },
        "minN": { "$minN": { "input": "$v", "n": 2 } }, "maxN": { "$maxN": { "input": "$v", "n": 2 } },
        "top": { "$top": { "output": "$_id", "sortBy": sorted.clone() } },
        "bottomN": { "$bottomN": { "output": ["$_id", "$v"], "sortBy": sorted, "n": 3 } },
        "count": { "$count": {} }, "script": { "$accumulator": script },
    } }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn groups_are_the_same(documents in documents(), limit in 0..60_000usize, by_group in any::<bool>()) {
        let stages = [group(if by_group { "$g" } else { "$k" })];
        prop_assert_eq!(run(&stages, &documents, limit)?, run(&stages, &documents, usize::MAX)?);
    }

    #[test]
    fn buckets_and_facets_are_the_same(documents in documents(), limit in 0..20_000usize, buckets in 1..9i32, exact in any::<bool>()) {
        let output = doc! { "n": { "$sum": 1 }, "ids": { "$push": "$_id" } };
        let mut auto = doc! { "groupBy": if exact { "$v" } else { "$g" }, "buckets": buckets, "output": output };
        if !exact {
            auto.insert("granularity", "R5");
        }
        let facet = doc! { "first": [{ "$limit": 3 }], "all": [{ "$sort": { "v": 1 } }], "auto": [{ "$bucketAuto": auto.clone() }] };
        for stage in [doc! { "$bucketAuto": auto }, doc! { "$facet": facet }] {
            // The bounds may be NaN, which is not equal to itself.
            let run = |limit| run(std::slice::from_ref(&stage), &documents, limit).map(|documents| format!("{documents:?}"));
            prop_assert_eq!(run(limit)?, run(usize::MAX)?);
        }
    }

    #[test]
    fn windows_are_the_same(documents in documents(), limit in 0..20_000usize, by_group in any::<bool>(), low in -3..1i32, width in 0..4i32) {
        let ends = [doc! { "documents": [low, low + width] }, doc! { "range": [low, low + width] },
            doc! { "documents": ["unbounded", "current"] }, doc! { "range": ["current", "unbounded"] }];
        for bounds in ends {
            let stages = [windows(bounds, by_group.then_some("$g"))];
            // NaN is not equal to itself.
            let run = |limit| run(&stages, &documents, limit).map(|documents| format!("{documents:?}"));
            prop_assert_eq!(run(limit)?, run(usize::MAX)?);
        }
    }

    #[test]
    fn joined_documents_are_the_same(documents in documents(), limit in 0..20_000usize, path in "[kvg]|v.x|_id") {
        let lookup = doc! { "from": "same", "localField": "k", "foreignField": &path, "as": "found" };
        let mut counted = lookup.clone();
        counted.insert("pipeline", vec![doc! { "$count": "n" }]);
        let graph = doc! { "from": "same", "startWith": "$k", "connectFromField": "v", "connectToField": &path, "as": "found" };
        for stage in [doc! { "$lookup": lookup }, doc! { "$lookup": counted }, doc! { "$graphLookup": graph }] {
            let run = |limit| run(std::slice::from_ref(&stage), &documents, limit).map(|documents| format!("{documents:?}"));
            prop_assert_eq!(run(limit)?, run(usize::MAX)?);
        }
    }

    #[test]
    fn sorts_are_the_same(documents in documents(), limit in 0..20_000usize, least in 0..150i64, backwards in any::<bool>()) {
        let sort = doc! { "$sort": { "v": if backwards { -1 } else { 1 }, "g": 1 } };
        for stages in [vec![sort.clone()], vec![sort, doc! { "$limit": least + 1 }]] {
            prop_assert_eq!(run(&stages, &documents, limit)?, run(&stages, &documents, usize::MAX)?);
        }
        for (pattern, most) in [(doc! { "$natural": -1 }, Some(7)), (doc! { "$natural": -1 }, None), (doc! {}, Some(7))] {
            let sort = Sort::parse(&pattern)?;
            let sorted = |limit| {
                let documents = documents.iter().cloned().map(Ok::<_, QueryError>);
                sort.sort(documents, most, &within(limit))?.collect::<Result<Vec<_>>>()
            };
            prop_assert_eq!(sorted(limit)?, sorted(usize::MAX)?);
        }
    }

    #[test]
    fn values_are_the_same(documents in documents(), limit in 0..5_000usize) {
        let values = |limit| {
            let values = Distinct::new("v", &within(limit))?;
            // NaN is not equal to itself.
            values.of(documents.iter().cloned().map(Ok::<_, QueryError>))?.map(|value| Ok(format!("{:?}", value?))).collect::<Result<Vec<_>>>()
        };
        prop_assert_eq!(values(limit)?, values(usize::MAX)?);
    }
}

#[test]
fn many_documents_with_few_values_are_joined() {
    let document = |n: i32| RawDocumentBuf::try_from(&doc! { "_id": n, "k": n % 7, "one": n % 2000 }).unwrap();
    let documents: Vec<_> = (0..3000).map(document).collect();
    let few =
        doc! { "from": "same", "localField": "_id", "foreignField": "k", "as": "n", "pipeline": [{ "$count": "n" }] };
    let one = doc! { "from": "same", "localField": "_id", "foreignField": "one", "as": "found" };
    let stages = [doc! { "$lookup": few }, doc! { "$lookup": one }];
    assert_eq!(run(&stages, &documents, 10_000).unwrap(), run(&stages, &documents, usize::MAX).unwrap());
}

#[test]
fn groups_by_a_random_number_stay_apart() {
    let documents: Vec<_> = (0..200).map(|n| RawDocumentBuf::try_from(&doc! { "_id": n }).unwrap()).collect();
    let groups = run(&[doc! { "$group": { "_id": { "$rand": {} }, "n": { "$sum": 1 } } }], &documents, 2_000).unwrap();
    assert_eq!(groups.len(), 200);
}

#[test]
fn a_folder_that_cannot_be_used_is_the_fault_of_the_store() {
    let documents = [RawDocumentBuf::try_from(&doc! { "_id": 1 }).unwrap()];
    let sort = Sort::parse(&doc! { "a": 1 }).unwrap();
    let spill = Spill { limit: 0, folder: "/nowhere".into() };
    let Err(error) = sort.sort(documents.into_iter().map(Ok::<_, QueryError>), None, &spill) else { panic!("sorted") };
    assert_eq!(error.fault(), Fault::Store);
    assert!(error.message.starts_with("cannot use a temporary file in /nowhere: "), "{error}");
}
