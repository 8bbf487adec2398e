//! The module query: MongoDB's semantics through its public interface.

use bson::{Bson, DateTime, Document, RawDocumentBuf, bson, doc};
use rmem::query::{Filter, Projection, Update};

fn raw(document: &Document) -> RawDocumentBuf {
    RawDocumentBuf::try_from(document).unwrap()
}

fn matches(filter: Document, document: Document) -> bool {
    Filter::parse(&filter).unwrap().matches(&raw(&document)).unwrap()
}

#[test]
fn null_equals_missing_and_ranges_stay_in_their_type() {
    assert!(matches(doc! {"a": null}, doc! {}));
    assert!(matches(doc! {"a": {"$ne": null}}, doc! {"a": 0}));
    assert!(!matches(doc! {"a": {"$gt": 3}}, doc! {"a": "x"}));
    assert!(matches(doc! {"a": 1i64}, doc! {"a": 1.0}));
    assert!(matches(doc! {"a.b": {"$gt": 3}}, doc! {"a": [{"b": 1}, {"b": 4}]}));
    assert!(!matches(doc! {"a": {"$elemMatch": {"$gt": 3, "$lt": 5}}}, doc! {"a": [1, 9]}));
    assert!(matches(doc! {"a": {"$gt": 3, "$lt": 5}}, doc! {"a": [1, 9]}));
}

#[test]
fn an_update_says_whether_it_changed_the_document() {
    let filter = Filter::parse(&doc! {}).unwrap();
    let change = |update: Document, document: Document| {
        let update = Update::parse(&update, &[]).unwrap();
        let after = update.apply(&raw(&document), &filter, DateTime::from_millis(0)).unwrap();
        after.map(|after| Document::try_from(&after).unwrap())
    };
    assert_eq!(change(doc! {"$set": {"a": 1}}, doc! {"_id": 1, "a": 1}), None);
    assert_eq!(
        change(doc! {"$set": {"z": 1, "b": 2}, "$inc": {"a.c": 1}}, doc! {"_id": 1}),
        Some(doc! {"_id": 1, "a": {"c": 1}, "b": 2, "z": 1})
    );
    assert_eq!(
        change(doc! {"$push": {"a": {"$each": [5, 1], "$sort": 1, "$slice": -2}}}, doc! {"_id": 1, "a": [3]}),
        Some(doc! {"_id": 1, "a": [3, 5]})
    );
}

#[test]
fn an_update_keeps_the_id_to_the_byte() {
    let filter = Filter::parse(&doc! {}).unwrap();
    let now = DateTime::from_millis(0);
    let document = raw(&doc! {"_id": 1, "a": [1, 2]});
    let pipeline = Update::parse_pipeline(&[doc! {"$replaceWith": {"z": 1}}]).unwrap();
    let after = pipeline.apply(&document, &filter, now).unwrap().unwrap();
    assert_eq!(Document::try_from(&after).unwrap(), doc! {"_id": 1, "z": 1});
    let upserted = pipeline.upsert(&doc! {"_id": 9}, now).unwrap();
    assert_eq!(Document::try_from(&upserted).unwrap(), doc! {"_id": 9, "z": 1});
    let code = |update: Document| {
        let after = Update::parse(&update, &[]).and_then(|update| update.apply(&document, &filter, now));
        after.map_err(|error| error.code)
    };
    assert_eq!(code(doc! {"$set": {"_id": 1.0}}), Err(66));
    assert_eq!(code(doc! {"$set": {"_id": 1}}), Ok(None));
    assert_eq!(code(doc! {"$set": {"$x": 1}}), Err(52));
    assert_eq!(code(doc! {"_id": 1, "a": [1, 2]}), Ok(None));
    assert!(code(doc! {"a": [1, 2]}).unwrap().is_some());
    let padded = code(doc! {"$set": {"a.01": 9}}).unwrap().unwrap();
    assert_eq!(Document::try_from(&padded).unwrap(), doc! {"_id": 1, "a": [1, 9]});
}

#[test]
fn the_first_computed_field_that_fails_says_why() {
    let filter = Filter::parse(&doc! {}).unwrap();
    let code = |stage: Document, a: Bson| {
        let pipeline = Update::parse_pipeline(&[stage]).unwrap();
        let document = raw(&doc! {"_id": 1, "a": a, "x": "q"});
        pipeline.apply(&document, &filter, DateTime::from_millis(0)).map(|_| 0).map_err(|error| error.code)
    };
    let divided = doc! {"$divide": [1, {"$subtract": ["$_id", 1]}]};
    let (inner, outer) = (doc! {"a.z": divided.clone()}, doc! {"c": {"$toInt": "$x"}});
    let both =
        |first: &Document, second: &Document| -> Document { first.clone().into_iter().chain(second.clone()).collect() };
    for a in [bson!({"b": 1}), bson!([{"b": 1}, 2]), bson!(1)] {
        assert_eq!(code(doc! {"$set": both(&inner, &outer)}, a.clone()), Err(2), "{a}");
        assert_eq!(code(doc! {"$set": both(&outer, &inner)}, a.clone()), Err(241), "{a}");
        let deep = doc! {"a": {"y": {"k": divided.clone()}}};
        assert_eq!(code(doc! {"$set": both(&deep, &outer)}, a), Err(2));
    }
    assert_eq!(code(doc! {"$set": both(&inner, &outer)}, bson!([])), Err(241), "nothing is divided");
    // Of two nested ones, also where the document has them in the other order, or lacks the first.
    let [a, x] = [doc! {"a": {"b": divided}}, doc! {"x": {"b": {"$toInt": "$x"}}}];
    let nested = [(both(&a, &x), 2), (both(&x, &a), 241), (both(&doc! {"n": a["a"].clone()}, &x), 2)];
    for (fields, wanted) in nested {
        assert_eq!(code(doc! {"$set": fields.clone()}, bson!(1)), Err(wanted), "{fields}");
    }
}

#[test]
fn array_updates_want_an_array_to_be_there() {
    let filter = Filter::parse(&doc! {}).unwrap();
    let code = |update: Document, document: Document| {
        let after = Update::parse(&update, &[])
            .and_then(|update| update.apply(&raw(&document), &filter, DateTime::from_millis(0)));
        after.map(|_| 0).map_err(|error| error.code)
    };
    for document in [doc! {"_id": 1, "a": [[]]}, doc! {"_id": 1, "a": [{}]}, doc! {"_id": 1, "a": [1]}, doc! {"_id": 1}]
    {
        assert_eq!(code(doc! {"$unset": {"a.$[].b.$[]": 1}}, document.clone()), Err(2), "{document}");
        assert_eq!(code(doc! {"$set": {"a.$[].b.$[]": 1}}, document.clone()), Err(2), "{document}");
    }
    assert_eq!(code(doc! {"$unset": {"a.$[].b.$[]": 1}}, doc! {"_id": 1, "a": []}), Ok(0));
}

#[test]
fn what_is_wrong_with_constants_is_said_before_there_is_a_document() {
    let code = |computed: Document| Projection::parse(&doc! {"r": computed}).map(|_| 0).map_err(|error| error.code);
    assert_eq!(code(doc! {"$setEquals": ["$k", {}]}), Err(5_887_502));
    assert_eq!(code(doc! {"$zip": {"inputs": []}}), Err(34_465));
    assert_eq!(code(doc! {"$zip": {"inputs": ["$k"], "defaults": [1]}}), Err(34_466));
    assert_eq!(code(doc! {"$sortArray": {"input": "$k", "sortBy": 3}}), Err(2_942_506));
    // These look at their input only when there is one.
    assert_eq!(code(doc! {"$regexMatch": {"input": {}, "regex": "a"}}), Ok(0));
    assert_eq!(code(doc! {"$setField": {"field": "a", "input": 1, "value": 1}}), Ok(0));
}

#[test]
fn paths_that_take_a_value_for_an_array_and_for_an_object_conflict() {
    let code = |update: Document, filters: &[Document]| Update::parse(&update, filters).map(|_| 0).map_err(|e| e.code);
    let one = [doc! {"e": {"$gt": 0}}];
    assert_eq!(code(doc! {"$unset": {"d.$[e].b": ""}, "$pull": {"d.$.c": 1}}, &one), Err(40));
    assert_eq!(code(doc! {"$max": {"d.$[]": 1}, "$inc": {"d.$.a": 1}}, &[]), Err(40));
    assert_eq!(code(doc! {"$set": {"a.0.b": 1, "a.$[].c": 2}}, &[]), Err(40));
    assert_eq!(code(doc! {"$rename": {"a.b": "z"}, "$set": {"a.$[].c": 2}}, &[]), Err(40));
    assert_eq!(code(doc! {"$set": {"a.$[].b": 1, "a.$[e].b": 2}}, &one), Ok(0));
    assert_eq!(code(doc! {"$set": {"a.b.$[].x": 1, "a.c.d": 2, "a.$.y": 3}}, &[]), Ok(0));
}

#[test]
fn an_upsert_refuses_what_names_no_one_document() {
    let now = DateTime::from_millis(0);
    let set = Update::parse(&doc! {"$set": {"z": 1}}, &[]).unwrap();
    let code = |filter: Document| set.upsert(&filter, now).map_err(|error| (error.code, error.names.join(" ")));
    assert_eq!(code(doc! {"_id": 9, "k": {"$all": [1, 2]}}), Err((54, "k".to_owned())));
    assert_eq!(code(doc! {"_id": 9, "$nor": [{"$expr": false}]}), Err((224, "$expr".to_owned())));
    let replacement = Update::parse(&doc! {"z": 1}, &[]).unwrap();
    assert!(replacement.upsert(&doc! {"_id": 9, "k": {"$all": [1, 2]}}, now).is_ok());
    assert_eq!(rmem::query::prepare(&doc! {"_id": {"a": {"$x": 1}}}, now).unwrap_err().code, 52);
    assert!(rmem::query::prepare(&doc! {"_id": {"$ref": "a", "$id": 1}}, now).is_ok());
}

#[test]
fn an_error_names_the_word_it_is_about() {
    let about = |filter: Document| Filter::parse(&filter).unwrap_err().names;
    assert_eq!(about(doc! {"a": {"$gt": 1, "$size": "x"}}), ["$size"]);
    assert_eq!(about(doc! {"$foo": 1}), ["$foo"]);
    assert_eq!(about(doc! {"$or": [{"a": {"$not": {"$size": "x"}}}]}), ["$size", "$not", "$or"]);
    let update = Update::parse(&doc! {"$inc": {"a": "x"}}, &[]).unwrap_err();
    assert_eq!(update.names, ["$inc"]);
    assert_eq!(Projection::parse(&doc! {"a.$": 0}).unwrap_err().code, 31_395);
}

#[test]
fn the_whole_part_of_a_decimal_has_bits_and_a_dot_at_the_end_is_the_array() {
    for (text, has_bits) in [("0.1", true), ("-0.9", true), ("NaN", false), ("Infinity", false)] {
        let decimal: bson::Decimal128 = text.parse().unwrap();
        assert_eq!(matches(doc! {"v": {"$bitsAnyClear": [0, 3]}}, doc! {"v": decimal}), has_bits, "{text}");
    }
    assert!(!matches(doc! {"v": {"$bitsAnyClear": [0, 3]}}, doc! {"v": 0.1}));
    assert!(matches(doc! {"w.": 3}, doc! {"w": [1, 2, 3]}));
    assert!(!matches(doc! {"w.": 3}, doc! {"w": 3}));
}

#[test]
fn the_positional_operator_takes_the_element_that_matched() {
    let filter = Filter::parse(&doc! {"a.b": 2}).unwrap();
    let document = raw(&doc! {"_id": 1, "a": [{"b": 1}, {"b": 2}]});
    let update = Update::parse(&doc! {"$set": {"a.$.c": 9}}, &[]).unwrap();
    let after = update.apply(&document, &filter, DateTime::from_millis(0)).unwrap().unwrap();
    assert_eq!(Document::try_from(&after).unwrap(), doc! {"_id": 1, "a": [{"b": 1}, {"b": 2, "c": 9}]});
    let projection = Projection::parse(&doc! {"_id": 0, "a.$": 1}).unwrap();
    let projected = projection.apply(&document, &filter, DateTime::from_millis(0)).unwrap();
    assert_eq!(Document::try_from(&projected).unwrap(), doc! {"a": [{"b": 2}]});
}

mod properties {
    use std::cmp::Ordering;

    use bson::oid::ObjectId;
    use bson::{Bson, DateTime, Document, RawDocumentBuf, Timestamp};
    use proptest::prelude::*;
    use rmem::query::{Filter, Sort, Spill, Update, compare_values, key};

    /// Values of all types that can be ordered, with numbers that are close to one another.
    fn value() -> impl Strategy<Value = Bson> {
        let number = prop_oneof![
            (-3i32..3).prop_map(Bson::Int32),
            any::<i32>().prop_map(Bson::Int32),
            any::<i64>().prop_map(Bson::Int64),
            (-3i64..3).prop_map(Bson::Int64),
            any::<f64>().prop_map(Bson::Double),
            (-30i32..30).prop_map(|n| Bson::Double(f64::from(n) / 10.0)),
            ((1i64 << 53) - 3..(1i64 << 53) + 3).prop_map(Bson::Int64),
            (-3000i32..3000, -3i32..3).prop_map(|(n, e)| Bson::Decimal128(format!("{n}E{e}").parse().unwrap())),
            Just(Bson::Decimal128("NaN".parse().unwrap())),
            Just(Bson::Decimal128("-Infinity".parse().unwrap())),
            Just(Bson::Double(f64::NAN)),
            Just(Bson::Double(f64::INFINITY)),
        ];
        let leaf = prop_oneof![
            4 => number,
            2 => "[ab\0é]{0,3}".prop_map(Bson::String),
            1 => "[ab]{0,2}".prop_map(Bson::Symbol),
            1 => any::<bool>().prop_map(Bson::Boolean),
            1 => Just(Bson::Null),
            1 => Just(Bson::Undefined),
            1 => Just(Bson::MinKey),
            1 => Just(Bson::MaxKey),
            1 => any::<i64>().prop_map(|n| Bson::DateTime(DateTime::from_millis(n))),
            1 => any::<[u8; 12]>().prop_map(|bytes| Bson::ObjectId(ObjectId::from_bytes(bytes))),
            1 => (0u32..3, 0u32..3).prop_map(|(time, increment)| Bson::Timestamp(Timestamp { time, increment })),
            1 => (0u8..3, proptest::collection::vec(0u8..3, 0..3))
                .prop_map(|(subtype, bytes)| Bson::Binary(bson::Binary { subtype: subtype.into(), bytes })),
        ];
        leaf.prop_recursive(3, 24, 4, |inner| {
            prop_oneof![
                proptest::collection::vec(inner.clone(), 0..4).prop_map(Bson::Array),
                proptest::collection::vec(("[ab]{0,2}", inner), 0..4)
                    .prop_map(|fields| Bson::Document(fields.into_iter().collect())),
            ]
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(500))]

        #[test]
        fn keys_are_ordered_as_values_are(a in value(), b in value()) {
            let by_key = key::encode_value(&a).cmp(&key::encode_value(&b));
            prop_assert_eq!(by_key, compare_values(&a, &b), "{:?} {:?}", a, b);
        }

        #[test]
        fn the_order_is_total(a in value(), b in value(), c in value()) {
            prop_assert_eq!(compare_values(&a, &a), Ordering::Equal);
            prop_assert_eq!(compare_values(&a, &b), compare_values(&b, &a).reverse());
            let mut sorted = [&a, &b, &c];
            sorted.sort_by(|a, b| compare_values(a, b));
            prop_assert_ne!(compare_values(sorted[0], sorted[2]), Ordering::Greater);
        }

        #[test]
        fn what_was_set_is_found(path in "[ab](\\.[ab0]){0,2}", value in value()) {
            prop_assume!(!matches!(value, Bson::Undefined));
            let mut fields = Document::new();
            fields.insert(path.clone(), value.clone());
            let mut operators = Document::new();
            operators.insert("$set", fields);
            let before = RawDocumentBuf::try_from(&bson::doc! {"_id": 1}).unwrap();
            let all = Filter::parse(&Document::new()).unwrap();
            let update = Update::parse(&operators, &[]).unwrap();
            let after = update.apply(&before, &all, DateTime::from_millis(0)).unwrap().unwrap();
            let mut wanted = Document::new();
            wanted.insert(path, bson::doc! {"$eq": value});
            prop_assert!(Filter::parse(&wanted).unwrap().matches(&after).unwrap(), "{:?}", after);
        }

        #[test]
        fn a_limited_sort_is_the_start_of_the_whole(values in proptest::collection::vec(value(), 0..12), limit in 0usize..14) {
            let sort = Sort::parse(&bson::doc! {"v": -1}).unwrap();
            let documents: Vec<RawDocumentBuf> = values
                .iter()
                .map(|value| RawDocumentBuf::try_from(&bson::doc! {"v": value.clone()}).unwrap())
                .collect();
            let input = || documents.iter().cloned().map(Ok::<_, rmem::query::QueryError>);
            let sorted = |limit| sort.sort(input(), limit, &Spill::default()).unwrap().map(Result::unwrap);
            let whole: Vec<_> = sorted(None).take(limit).collect();
            prop_assert_eq!(sorted(Some(limit)).collect::<Vec<_>>(), whole);
        }
    }
}

/// Nesting that the module must survive or refuse, in the small stack of a test's thread.
mod depth {
    use bson::{Bson, DateTime, Document, RawDocumentBuf, doc};
    use rmem::query::{Filter, Pipeline, QueryError, Update, compare_values, key};

    fn nested(levels: usize, inner: Bson, wrap: impl Fn(Bson) -> Bson) -> Bson {
        (0..levels).fold(inner, |inner, _| wrap(inner))
    }

    fn object(value: Bson) -> Document {
        match value {
            Bson::Document(document) => document,
            other => panic!("{other}"),
        }
    }

    #[test]
    fn documents_of_two_hundred_levels_are_compared_and_matched() {
        let deep = nested(198, Bson::Int32(1), |inner| Bson::Document(doc! {"a": inner}));
        assert!(compare_values(&deep, &deep.clone()).is_eq());
        assert_eq!(key::encode_value(&deep), key::encode_value(&deep.clone()));
        let document = RawDocumentBuf::try_from(&doc! {"_id": 1, "d": deep.clone()}).unwrap();
        assert!(Filter::parse(&doc! {"d": deep}).unwrap().matches(&document).unwrap());
    }

    #[test]
    fn deep_filters_and_expressions_are_answered_or_refused() {
        let document = RawDocumentBuf::try_from(&doc! {"_id": 1}).unwrap();
        for levels in [50, 99, 190, 1000] {
            let filter =
                object(nested(levels, Bson::Document(doc! {"_id": 1}), |inner| Bson::Document(doc! {"$and": [inner]})));
            match Filter::parse(&filter) {
                Ok(filter) => assert!(filter.matches(&document).unwrap()),
                Err(error) => assert!(levels > 90, "{error}"),
            }
            let sum = nested(levels, Bson::from("$_id"), |inner| Bson::Document(doc! {"$add": [inner, 0]}));
            match Pipeline::parse(&[doc! {"$project": {"sum": sum}}]) {
                Ok(pipeline) => {
                    let input = std::iter::once(Ok::<_, QueryError>(document.clone()));
                    let none = |_: &rmem::query::Origin, _: Option<&Document>| unreachable!();
                    let output: Vec<_> = pipeline.run(Box::new(input), DateTime::now(), &none).collect();
                    assert_eq!(output[0].as_ref().unwrap().get_i32("sum").unwrap(), 1);
                }
                Err(error) => assert!(levels > 190, "{error}"),
            }
        }
    }

    #[test]
    fn an_update_cannot_nest_deeper_than_two_hundred_levels() {
        let deep = nested(199, Bson::Int32(1), |inner| Bson::Document(doc! {"a": inner}));
        let update = Update::parse(&doc! {"$set": {"x.y.z": deep}}, &[]).unwrap();
        let document = RawDocumentBuf::try_from(&doc! {"_id": 1}).unwrap();
        let all = Filter::parse(&doc! {}).unwrap();
        assert_eq!(update.apply(&document, &all, DateTime::now()).unwrap_err().code, 15);
    }

    #[test]
    fn hostile_numbers_do_not_panic() {
        let extremes = [
            Bson::Int32(i32::MIN),
            Bson::Int64(i64::MIN),
            Bson::Int64(i64::MAX),
            Bson::Double(f64::NAN),
            Bson::Double(f64::MAX),
            Bson::Double(-5e-324),
            Bson::Decimal128("-9.999999999999999999999999999999999E+6144".parse().unwrap()),
            Bson::Decimal128("1E-6176".parse().unwrap()),
            Bson::Decimal128("NaN".parse().unwrap()),
        ];
        let operators =
            ["$add", "$subtract", "$multiply", "$divide", "$mod", "$pow", "$log", "$round", "$trunc", "$atan2"];
        for operator in operators {
            for a in &extremes {
                for b in &extremes {
                    let mut expression = Document::new();
                    expression.insert(operator, vec![a.clone(), b.clone()]);
                    let _ = Pipeline::parse(&[doc! {"$project": {"x": expression}}]);
                }
            }
        }
        for operator in [
            "$abs",
            "$ceil",
            "$floor",
            "$sqrt",
            "$exp",
            "$ln",
            "$log10",
            "$toInt",
            "$toLong",
            "$toDate",
            "$year",
            "$dateToString",
        ] {
            for a in &extremes {
                let mut expression = Document::new();
                expression.insert(operator, a.clone());
                let _ = Pipeline::parse(&[doc! {"$project": {"x": expression.clone()}}]);
                let mut date = Document::new();
                date.insert(operator, doc! {"date": {"$toDate": a.clone()}});
                let _ = Pipeline::parse(&[doc! {"$project": {"x": date}}]);
            }
        }
        for millis in [i64::MIN, i64::MAX, 0] {
            for unit in ["year", "quarter", "month", "week", "day", "hour", "millisecond"] {
                let date = DateTime::from_millis(millis);
                for amount in [i64::MIN, i64::MAX, 1] {
                    for zone in ["UTC", "+99:99", "Europe/Berlin"] {
                        let add =
                            doc! {"$dateAdd": {"startDate": date, "unit": unit, "amount": amount, "timezone": zone}};
                        let trunc =
                            doc! {"$dateTrunc": {"date": date, "unit": unit, "binSize": amount, "timezone": zone}};
                        let diff = doc! {"$dateDiff": {"startDate": date, "endDate": DateTime::from_millis(1), "unit": unit, "timezone": zone}};
                        for expression in [add, trunc, diff] {
                            let _ = Pipeline::parse(&[doc! {"$project": {"x": expression}}]);
                        }
                    }
                }
            }
        }
    }
}
