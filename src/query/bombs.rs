//! Tests of short queries that describe values of any size: each ends with mongod's error, neither with the stack nor
//! with the memory.

use bson::{Bson, DateTime, Document, RawDocumentBuf, doc};

use super::error::{QueryError, Result};
use super::{Documents, Filter, Origin, Pipeline, Projection, Update};

/// `{$reduce: …}` that applies an expression of `$$value` so many times.
fn repeated(times: i32, initial: impl Into<Bson>, expression: impl Into<Bson>) -> Bson {
    let body: Bson = expression.into();
    doc! { "$reduce": { "input": { "$range": [0, times] }, "initialValue": initial.into(), "in": body } }.into()
}

fn nested(levels: i32) -> Bson {
    repeated(levels, 1, doc! { "a": "$$value" })
}

fn doubled(times: i32) -> Bson {
    repeated(times, "$s", doc! { "$concat": ["$$value", "$$value"] })
}

fn document() -> RawDocumentBuf {
    RawDocumentBuf::try_from(&doc! { "_id": 1, "s": "x".repeat(1000), "a": [1, 2, 3] }).unwrap()
}

/// The codes of what the stages make of one document.
fn run(stages: Vec<Document>) -> Result<Vec<RawDocumentBuf>> {
    let pipeline = Pipeline::parse(&stages)?;
    let input: Documents<'_, QueryError> = Box::new(std::iter::once(Ok(document())));
    let all = || Box::new(std::iter::once(Ok(document()))) as Documents<'_, QueryError>;
    let same = |_: &Origin, filter: Option<&Document>| Ok(filter.is_none().then(all));
    pipeline.run(input, DateTime::from_millis(0), &same).collect()
}

fn code(stages: Vec<Document>) -> i32 {
    run(stages).map_or_else(|error| error.code, |_| 0)
}

/// In a thread whose stack is as small as those that tests and workers have.
fn on_a_small_stack(work: impl FnOnce() + Send + 'static) {
    std::thread::Builder::new().stack_size(2 << 20).spawn(work).unwrap().join().unwrap();
}

#[test]
fn a_result_has_200_levels_at_most() {
    on_a_small_stack(|| {
        assert_eq!(code(vec![doc! { "$project": { "x": nested(199) } }]), 0);
        for levels in [200, 250, 399, 5000, 100_000] {
            assert_eq!(code(vec![doc! { "$project": { "x": nested(levels) } }]), 15, "{levels}");
        }
        let within = repeated(5000, 1, vec![Bson::from("$$value")]);
        assert_eq!(code(vec![doc! { "$project": { "x": within } }]), 15);
        let field = doc! { "$setField": { "field": "f", "input": {}, "value": "$$value" } };
        assert_eq!(code(vec![doc! { "$replaceWith": repeated(5000, 1, field) }]), 15);
        assert_eq!(code(vec![doc! { "$group": { "_id": nested(5000) } }]), 15);
        assert_eq!(code(vec![doc! { "$group": { "_id": 1, "x": { "$push": nested(199) } } }]), 15);
    });
}

#[test]
fn stages_that_nest_one_after_the_other_end_too() {
    on_a_small_stack(|| {
        let path = vec!["a"; 100].join(".");
        let stage = doc! { "$set": { &path: "$$ROOT" } };
        assert_eq!(code(vec![stage.clone(); 900]), 15);
        let update = Update::parse_pipeline(&vec![stage; 900]).unwrap();
        let all = Filter::parse(&Document::new()).unwrap();
        assert_eq!(update.apply(&document(), &all, DateTime::from_millis(0)).unwrap_err().code, 15);
    });
}

#[test]
fn a_deep_value_that_is_no_result_is_looked_at() {
    on_a_small_stack(|| {
        let shown = run(vec![doc! { "$project": { "x": { "$type": nested(250) } } }]).unwrap();
        assert_eq!(shown.first().unwrap().get_str("x").unwrap(), "object");
    });
}

#[test]
fn a_string_has_16_megabytes_at_most() {
    assert_eq!(code(vec![doc! { "$project": { "x": { "$strLenBytes": doubled(14) } } }]), 0);
    for times in [15, 34, 1000] {
        assert_eq!(code(vec![doc! { "$project": { "x": doubled(times) } }]), 16_493, "{times}");
    }
    let each = doc! { "$replaceAll": { "input": doubled(10), "find": "x", "replacement": "$s" } };
    assert_eq!(code(vec![doc! { "$project": { "x": each } }]), 16_493);
}

#[test]
fn arrays_end_with_the_memory_of_an_evaluation() {
    let project = |x: Bson| vec![doc! { "$project": { "x": x } }];
    let twice = doc! { "$concatArrays": ["$$value", "$$value"] };
    assert_eq!(code(project(repeated(60, vec![Bson::from(1)], twice))), 146);
    assert_eq!(code(project(doc! { "$range": [0, i32::MAX] }.into())), 146);
    assert_eq!(code(project(doc! { "$range": [0, 1_500_000] }.into())), 10_334);
    let many = doc! { "$map": { "input": { "$range": [0, 100_000] }, "in": doubled(10) } };
    assert_eq!(code(project(many.into())), 146);
    let rows = doc! { "inputs": vec![doc! { "$range": [0, 5000] }; 1000], "useLongestLength": true };
    assert_eq!(code(project(doc! { "$zip": rows }.into())), 146);
    // What is joined is not counted twice.
    let half = doc! { "$range": [0, 600_000] };
    let joined = doc! { "$concatArrays": [half.clone(), half.clone()] };
    assert_eq!(code(project(doc! { "$size": joined }.into())), 0);
    assert_eq!(code(project(doc! { "$size": { "$zip": { "inputs": [half.clone(), half] } } }.into())), 0);
    let split = doc! { "$split": [doubled(14), "x"] };
    assert_eq!(code(project(split.into())), 146);
}

#[test]
fn variables_that_double_one_another_end_too() {
    let body = (0..60).fold(Bson::from("$$a0"), |body, level| {
        let outer = format!("$$a{}", level + 1);
        doc! { "$let": { "vars": { format!("a{level}"): [outer.clone(), outer] }, "in": body } }.into()
    });
    let bound = doc! { "$let": { "vars": { "a60": "$s" }, "in": body } };
    assert_eq!(code(vec![doc! { "$project": { "x": bound } }]), 146);
}

#[test]
fn accumulators_end_with_their_memory() {
    let many = vec![doc! { "$project": { "x": { "$range": [0, 400] }, "s": doubled(10) } }, doc! { "$unwind": "$x" }];
    let several = doc! { "input": "$s", "n": 1000 };
    let sets = doc! { "$concat": ["$s", { "$toString": "$x" }] };
    for accumulator in [
        doc! { "$push": "$s" },
        doc! { "$addToSet": sets },
        doc! { "$firstN": several.clone() },
        doc! { "$maxN": several },
        doc! { "$topN": { "output": "$s", "sortBy": { "x": 1 }, "n": 1000 } },
    ] {
        let group = doc! { "$group": { "_id": 1, "all": accumulator.clone() } };
        assert_eq!(code([many.clone(), vec![group]].concat()), 146, "{accumulator}");
    }
    let few = doc! { "$group": { "_id": 1, "all": { "$lastN": { "input": "$s", "n": 3 } } } };
    assert_eq!(code([many, vec![few]].concat()), 0);
}

#[test]
fn filters_projections_and_updates_end_alike() {
    on_a_small_stack(|| {
        let all = Filter::parse(&Document::new()).unwrap();
        let now = DateTime::from_millis(0);
        for (bomb, expected) in [(nested(5000), 15), (doubled(34), 16_493)] {
            let filter = Filter::parse(&doc! { "$expr": { "$eq": [bomb.clone(), 1] } });
            let filter = filter.and_then(|filter| filter.matches(&document()));
            assert_eq!(filter.unwrap_err().code, expected);
            let projection = Projection::parse(&doc! { "x": bomb.clone() });
            let projected = projection.and_then(|projection| projection.apply(&document(), &all, now));
            assert_eq!(projected.unwrap_err().code, expected);
            let update = Update::parse_pipeline(&[doc! { "$set": { "x": bomb } }]).unwrap();
            assert_eq!(update.apply(&document(), &all, now).unwrap_err().code, expected);
            assert_eq!(update.upsert(&doc! { "s": "x".repeat(1000) }, now).unwrap_err().code, expected);
        }
    });
}

#[test]
fn a_redaction_looks_at_each_of_very_many_parts_by_itself() {
    let parts = doc! { "$map": { "input": { "$range": [0, 20_000] }, "in": { "n": "$$this" } } };
    let condition = doc! { "$cond": [{ "$eq": [{ "$mod": ["$n", 2] }, 1] }, "$$PRUNE", "$$DESCEND"] };
    let stages = vec![doc! { "$set": { "parts": parts } }, doc! { "$redact": condition }];
    let found = run(stages).unwrap();
    assert_eq!(found[0].get_array("parts").unwrap().into_iter().count(), 10_000);
}
