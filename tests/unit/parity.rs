//! Answers that a comparison with a real mongod found to be different once.

use bson::{Bson, Document, doc};
use rmem::store::{Embedded, Find, Index, Namespace, Store as _, StoreError, UpdateRequest, UpdateSpec, Updated};

fn store(documents: Vec<Document>) -> (Embedded, Namespace) {
    let (store, ns) = (Embedded::in_memory().unwrap(), Namespace::parse("a.c").unwrap());
    store.insert(&ns, documents).unwrap();
    (store, ns)
}

fn aggregated(documents: Vec<Document>, stages: &[Document]) -> Vec<Document> {
    let (store, ns) = store(documents);
    let found = store.aggregate(&ns, stages.into()).unwrap();
    found.map(|document| Document::try_from(&*document.unwrap()).unwrap()).collect()
}

fn sorted(documents: Vec<Document>, sort: Document) -> Result<Vec<Bson>, String> {
    let (store, ns) = store(documents);
    let found = store.find(&ns, &Find { sort, ..Find::default() }).map_err(|error| error.to_string())?;
    Ok(found.map(|document| Document::try_from(&*document.unwrap()).unwrap().remove("_id").unwrap()).collect())
}

fn upserted(filter: Document, update: Document) -> Document {
    let (store, ns) = store(vec![doc! { "_id": 0 }]);
    let update = UpdateSpec::Document(update);
    let request = UpdateRequest { filter, update, upsert: true, ..UpdateRequest::default() };
    store.update(&ns, &request, None).unwrap();
    let found = store.find(&ns, &Find { skip: 1, ..Find::default() }).unwrap();
    let mut made = found.map(|document| Document::try_from(&*document.unwrap()).unwrap()).next().unwrap();
    made.remove("_id");
    made
}

fn changed(document: Document, filter: Document, update: Document) -> Result<(Updated, Document), String> {
    let (store, ns) = store(vec![document]);
    let update = UpdateSpec::Document(update);
    let request = UpdateRequest { filter, update, ..UpdateRequest::default() };
    let updated = store.update(&ns, &request, None).map_err(|error| error.to_string())?;
    let after = store.find(&ns, &Find::default()).unwrap().next().unwrap().unwrap();
    Ok((updated, Document::try_from(&*after).unwrap()))
}

#[test]
fn a_sort_by_an_index_takes_an_empty_array_there_before_null() {
    let documents = vec![doc! { "_id": 11 }, doc! { "_id": 9, "a": [1, []] }];
    assert_eq!(sorted(documents, doc! { "a.1": 1 }), Ok(vec![9.into(), 11.into()]));
    assert!(sorted(vec![doc! { "_id": 1, "a": [], "b": [1] }], doc! { "b.0": 1, "a.1": 1 }).is_err());
    assert!(sorted(vec![doc! { "_id": 1, "a": [{ "b": [] }] }], doc! { "a.0.b": 1, "a": 1 }).is_ok());
}

#[test]
fn a_group_by_an_object_of_one_field_has_null_where_it_is_missing() {
    let group = |id: Document| aggregated(vec![doc! { "_id": 1 }], &[doc! { "$group": { "_id": id } }]);
    assert_eq!(group(doc! { "k": "$a" }), [doc! { "_id": { "k": null } }]);
    assert_eq!(group(doc! { "k": "$a", "j": "$b" }), [doc! { "_id": {} }]);
}

#[test]
fn the_best_of_a_group_is_found_by_whole_arrays_and_earlier_ones_win() {
    let documents = vec![doc! { "_id": 1, "a": [{ "b": 1 }] }, doc! { "_id": 2, "a": [{}, { "b": "x" }] }];
    let best = doc! { "$top": { "sortBy": { "a": -1 }, "output": "$_id" } };
    assert_eq!(aggregated(documents, &[doc! { "$group": { "_id": 0, "p": best } }]), [doc! { "_id": 0, "p": 1 }]);
    let equal = vec![doc! { "_id": 1, "a": 5 }, doc! { "_id": 2, "a": 5 }];
    let last = doc! { "$bottom": { "sortBy": { "a": 1 }, "output": "$_id" } };
    assert_eq!(aggregated(equal, &[doc! { "$group": { "_id": 0, "p": last } }]), [doc! { "_id": 0, "p": 1 }]);
}

#[test]
fn a_lookup_takes_a_missing_element_for_null_only_where_all_are_missing() {
    let found = |document: Document| {
        let lookup = doc! { "from": "c", "localField": "a.b", "foreignField": "x", "as": "r" };
        aggregated(vec![document], &[doc! { "$lookup": lookup }]).remove(0).get_array("r").unwrap().len()
    };
    assert_eq!(found(doc! { "_id": 1, "a": [{ "b": 1 }, {}] }), 0);
    assert_eq!(found(doc! { "_id": 1, "a": [{}] }), 1);
}

#[test]
fn a_search_through_a_graph_does_not_take_a_missing_field_for_null() {
    let graph = doc! {
        "from": "c", "startWith": "$n", "connectFromField": "to.id", "connectToField": "id", "as": "r",
    };
    let documents = vec![
        doc! { "_id": 1, "n": null, "id": "a" },
        doc! { "_id": 2, "n": "a" },
        doc! { "_id": 3, "n": "b", "id": "b", "to": [{ "id": ["a"] }] },
    ];
    let found = aggregated(documents, &[doc! { "$graphLookup": graph }]);
    let counts: Vec<usize> = found.iter().map(|document| document.get_array("r").unwrap().len()).collect();
    assert_eq!(counts, [0, 1, 2]);
}

#[test]
fn what_an_upsert_takes_from_its_filter_is_in_the_order_of_the_paths() {
    let made = upserted(doc! { "b": 1, "a": 2, "c": { "$in": [3, 3] } }, doc! { "$set": { "z": 1 } });
    assert_eq!(made.keys().collect::<Vec<_>>(), ["a", "b", "c", "z"]);
    assert_eq!(upserted(doc! { "q": 1, "b": { "$all": [] } }, doc! { "$set": { "z": 1 } }), doc! { "z": 1 });
}

#[test]
fn an_upsert_refuses_a_filter_that_names_a_field_and_what_is_in_it() {
    for filter in [doc! { "a.c": {}, "a": {} }, doc! { "a": { "c": 1 }, "a.c": 1 }] {
        let (store, ns) = store(Vec::new());
        let update = UpdateSpec::Document(doc! { "$set": { "z": 1 } });
        let request = UpdateRequest { filter, update, upsert: true, ..UpdateRequest::default() };
        let error = store.update(&ns, &request, None).unwrap_err().to_string();
        assert!(error.contains("matched twice"), "{error}");
        assert_eq!(store.count(&ns, (&doc! {}).into()).unwrap(), 0);
    }
}

#[test]
fn a_positional_operator_names_a_field_where_there_is_no_array() {
    let filter = doc! { "l.b": 1 };
    let document = doc! { "_id": 1, "l": [{ "b": 1 }], "b": {} };
    let (_, after) = changed(document, filter, doc! { "$set": { "b.$": 7 } }).unwrap();
    assert_eq!(after.get_document("b").unwrap(), &doc! { "0": 7 });
    let scalar = changed(doc! { "_id": 1, "a": [1] }, doc! {}, doc! { "$unset": { "a.$[].b.$[]": "" } });
    assert!(scalar.is_err());
}

#[test]
fn a_product_of_zero_that_stays_zero_is_no_modification() {
    let (updated, _) = changed(doc! { "_id": 1, "m": -0.0 }, doc! {}, doc! { "$mul": { "m": -1 } }).unwrap();
    assert_eq!((updated.matched, updated.modified), (1, 0));
}

#[test]
fn renaming_what_an_array_does_not_have_changes_nothing() {
    let rename = |path: &str| changed(doc! { "_id": 1, "a": [] }, doc! {}, doc! { "$rename": { path: "z" } });
    assert_eq!(rename("a.0").map(|(updated, _)| updated.modified), Ok(0));
    assert!(rename("a.b").is_err());
}

#[test]
fn slices_may_not_collide_with_other_paths() {
    let (store, ns) = store(vec![doc! { "_id": 1 }]);
    let projection = doc! { "a": { "$slice": 1 }, "a.b": 0 };
    assert!(store.find(&ns, &Find { projection, ..Find::default() }).is_err());
}

#[test]
fn some_combinations_of_merge_are_refused() {
    let (store, ns) = store(vec![doc! { "_id": 1 }]);
    let merge = doc! { "into": "w", "whenMatched": "keepExisting", "whenNotMatched": "discard" };
    assert!(store.aggregate(&ns, (&[doc! { "$merge": merge }]).into()).is_err());
}

/// What is in `a.w`, where two documents were, after some results were merged into it.
fn merged(index: Document, merge: Document, results: Vec<Document>) -> Result<Vec<Document>, i32> {
    let (store, ns) = store(results);
    let target = Namespace::parse("a.w").unwrap();
    store.insert(&target, vec![doc! { "_id": 1, "k": 5, "p": { "q": "a" } }, doc! { "_id": 2, "k": 6 }]).unwrap();
    store.create_index(&target, &Index::parse(&index).unwrap()).unwrap();
    let mut spec = doc! { "into": "w" };
    spec.extend(merge);
    let code = |error: StoreError| match error {
        StoreError::Query(error) => error.code,
        StoreError::Duplicate { .. } => 11_000,
        error => panic!("{error}"),
    };
    store.aggregate(&ns, (&[doc! { "$merge": spec }]).into()).map_err(code)?.for_each(drop);
    let found = store.find(&target, &Find { sort: doc! { "_id": 1 }, ..Find::default() }).unwrap();
    Ok(found.map(|document| Document::try_from(&*document.unwrap()).unwrap()).collect())
}

#[test]
fn results_are_merged_by_fields_with_a_unique_index() {
    let unique = |key: Document| doc! { "key": key, "unique": true };
    let on = |on: Bson| doc! { "on": on };
    let first = doc! { "_id": 1, "k": 5, "p": { "q": "a" } };
    let second = doc! { "_id": 2, "k": 6 };
    // By values that are equal, also of another type; the `_id` stays.
    let same = merged(unique(doc! { "k": 1 }), on("k".into()), vec![doc! { "_id": 2, "k": 6.0, "x": 1 }]);
    assert_eq!(same, Ok(vec![first.clone(), doc! { "_id": 2, "k": 6.0, "x": 1 }]));
    // By several, in any order, and by a path.
    let pair = merged(
        unique(doc! { "p.q": -1, "k": 1 }),
        doc! { "on": ["k", "p.q"], "whenMatched": "keepExisting" },
        vec![doc! { "_id": 9, "k": 5, "p": { "q": "a" } }, doc! { "_id": 3, "k": 5, "p": { "q": "b" } }],
    );
    let third = doc! { "_id": 3, "k": 5, "p": { "q": "b" } };
    assert_eq!(pair, Ok(vec![first.clone(), second.clone(), third]));
    // Results without an `_id` leave that of the document; new ones get one.
    let (source, ns) = store(vec![doc! { "_id": 1, "k": 6, "n": 1 }]);
    let target = Namespace::parse("a.w").unwrap();
    source.insert(&target, vec![second.clone()]).unwrap();
    source.create_index(&target, &Index { unique: true, ..Index::on(doc! { "k": 1 }) }).unwrap();
    let merge = doc! { "$merge": { "into": "w", "on": "k", "whenMatched": "replace" } };
    source.aggregate(&ns, (&[doc! { "$unset": "_id" }, merge]).into()).unwrap().for_each(drop);
    let found = source.find(&target, &Find::default()).unwrap().next().unwrap().unwrap();
    assert_eq!(Document::try_from(&*found).unwrap(), doc! { "_id": 2, "k": 6, "n": 1 });
    let plain = |results| merged(unique(doc! { "k": 1 }), on("k".into()), results);
    assert_eq!(plain(vec![doc! { "_id": 7, "k": 6 }]), Err(66));
    assert_eq!(plain(vec![doc! { "_id": 7 }]), Err(51_132));
    assert_eq!(plain(vec![doc! { "_id": 7, "k": Bson::Null }]), Err(51_132));
    assert_eq!(plain(vec![doc! { "_id": 7, "k": [6] }]), Err(51_185));
    assert_eq!(plain(vec![doc! { "_id": 1, "k": 7 }]), Err(11_000));
    let fail = doc! { "on": "k", "whenMatched": "fail" };
    assert_eq!(merged(unique(doc! { "k": 1 }), fail, vec![doc! { "_id": 2, "k": 6 }]), Err(11_000));
    // Another index will not do.
    for index in [
        doc! { "key": { "k": 1 } },
        doc! { "key": { "k": 1, "x": 1 }, "unique": true },
        doc! { "key": { "k": 1 }, "unique": true, "partialFilterExpression": { "k": { "$gt": 0 } } },
    ] {
        assert_eq!(merged(index, on("k".into()), vec![doc! { "_id": 2, "k": 6 }]), Err(51_183));
    }
}

#[test]
fn a_pipeline_of_merge_cannot_change_an_id() {
    let change = doc! { "whenMatched": [{ "$set": { "_id": 8 } }] };
    assert_eq!(merged(doc! { "key": { "k": 1 } }, change, vec![doc! { "_id": 1 }]), Err(66));
}

#[test]
fn facets_within_facets_are_refused_also_where_a_lookup_has_them() {
    let (store, ns) = store(vec![doc! { "_id": 1 }]);
    let lookup = doc! { "$lookup": { "from": "c", "pipeline": [{ "$facet": { "b": [] } }], "as": "j" } };
    let outer = doc! { "$lookup": { "from": "c", "pipeline": [lookup.clone()], "as": "j" } };
    for stage in [lookup.clone(), outer] {
        assert!(store.aggregate(&ns, (&[doc! { "$facet": { "a": [stage] } }]).into()).is_err());
    }
    assert!(store.aggregate(&ns, (&[lookup]).into()).is_ok());
}

#[test]
fn what_no_value_is_of_is_an_error() {
    let fails = |expression: Document| {
        let (store, ns) = store(vec![doc! { "_id": 1 }]);
        let found = store.aggregate(&ns, (&[doc! { "$project": { "r": expression } }]).into());
        found.is_err() || found.unwrap().any(|document| document.is_err())
    };
    let date = bson::DateTime::from_millis(0);
    let truncate = |bin: i64| doc! { "$dateTrunc": { "date": date, "unit": "year", "binSize": bin } };
    assert!(fails(truncate(100_000_000_001)) && !fails(truncate(1)));
    assert!(fails(doc! { "$unsetField": { "field": "a\0", "input": {} } }));
    assert!(fails(doc! { "$setField": { "field": "a\0", "input": {}, "value": 1 } }));
    let number = |text: &str, to: &str| fails(doc! { "$convert": { "input": text, "to": to } });
    assert!(number("1e-400", "double") && !number("0e-400", "double") && !number("-0.0", "double"));
    assert!(number("1E+6145", "decimal") && !number("Infinity", "decimal") && !number("-inf", "decimal"));
    let (store, ns) = store(vec![doc! { "_id": 1 }]);
    assert!(store.aggregate(&ns, (&[doc! { "$sort": { "$natural": 1 } }]).into()).is_err());
}

#[test]
fn the_logarithm_of_no_number_is_a_double() {
    for expression in
        [doc! { "$ln": "$n" }, doc! { "$log10": "$n" }, doc! { "$log": ["$n", 2] }, doc! { "$log": [2, "$n"] }]
    {
        let result = computed(doc! { "_id": 1, "n": decimal("NaN") }, expression);
        assert!(matches!(result, Bson::Double(number) if number.is_nan()), "{result}");
    }
}

fn computed(document: Document, expression: Document) -> Bson {
    let found = aggregated(vec![document], &[doc! { "$project": { "_id": 0, "r": expression } }]);
    found.into_iter().next().and_then(|mut document| document.remove("r")).unwrap_or(Bson::Undefined)
}

fn decimal(text: &str) -> Bson {
    Bson::Decimal128(text.parse().unwrap())
}

#[test]
fn an_integer_modulo_an_integral_double_stays_an_integer() {
    let of = |n: Bson, by: Bson| computed(doc! { "_id": 1, "n": n }, doc! { "$mod": ["$n", by] });
    assert_eq!(of(5.into(), 2.0.into()), Bson::Int32(1));
    assert_eq!(of(5i64.into(), 2.0.into()), Bson::Int64(1));
    assert_eq!(of(5.into(), 2.5.into()), Bson::Double(0.0));
    assert!(matches!(of((-0.0).into(), 3.into()), Bson::Double(zero) if zero.is_sign_negative()));
}

#[test]
fn constants_of_a_product_are_multiplied_first() {
    let factors = doc! { "$multiply": ["$n", 3, (1i64 << 53) + 1] };
    assert_eq!(computed(doc! { "_id": 1, "n": 2.0 }, factors), Bson::Double(5.404319552844596e16));
    let within = doc! { "$multiply": [{ "$multiply": [3, "$n"] }, (1i64 << 53) + 1] };
    assert_eq!(computed(doc! { "_id": 1, "n": 2.0 }, within), Bson::Double(5.404319552844596e16));
}

#[test]
fn constants_go_last_so_that_a_null_before_them_counts() {
    let document = || doc! { "_id": 1, "l": [2] };
    assert_eq!(computed(document(), doc! { "$setUnion": [[{ "$literal": 2.0 }], "$l"] }), Bson::from(vec![2]));
    assert_eq!(computed(document(), doc! { "$add": [{ "$literal": "x" }, "$missing"] }), Bson::Null);
    assert_eq!(computed(document(), doc! { "$add": ["$missing", { "$divide": [1, "$zero"] }] }), Bson::Null);
}

#[test]
fn of_equal_elements_those_of_the_smaller_set_are_in_the_intersection() {
    let common = doc! { "$setIntersection": ["$l", [{ "$literal": 3.0 }]] };
    assert_eq!(computed(doc! { "_id": 1, "l": [3, 1] }, common), Bson::from(vec![3.0]));
}

#[test]
fn what_a_case_that_never_holds_would_give_is_not_computed() {
    let never = doc! { "case": false, "then": { "$divide": [1, 0] } };
    let always = doc! { "case": true, "then": 7 };
    assert_eq!(
        computed(doc! { "_id": 1 }, doc! { "$switch": { "branches": [never.clone(), always, never] } }),
        7.into()
    );
}

#[test]
fn what_is_wrong_in_an_update_that_nothing_matches_is_no_error() {
    let (store, ns) = store(vec![doc! { "_id": 1 }]);
    let update = UpdateSpec::Pipeline(vec![doc! { "$set": { "r": { "$divide": [1, 0] } } }]);
    let request =
        |id: i32| UpdateRequest { filter: doc! { "_id": id }, update: update.clone(), ..UpdateRequest::default() };
    assert_eq!(store.update(&ns, &request(2), None).unwrap().matched, 0);
    assert!(store.update(&ns, &request(1), None).is_err());
}

#[test]
fn decimals_keep_their_digits_in_trigonometry() {
    let radians = computed(doc! { "_id": 1, "n": decimal("-3") }, doc! { "$degreesToRadians": "$n" });
    assert_eq!(radians, decimal("-0.05235987755982988730771072305465839"));
    assert_eq!(computed(doc! { "_id": 1 }, doc! { "$pow": [0, decimal("2.5")] }), decimal("0E-6176"));
    assert_eq!(computed(doc! { "_id": 1, "n": 2.5 }, doc! { "$acosh": "$n" }), Bson::Double(1.566799236972411));
}

#[test]
fn a_push_sorts_elements_by_their_fields_and_arrays_as_they_are() {
    let document = doc! { "_id": 3, "b": [{ "c": [] }] };
    let (_, after) =
        changed(document, doc! {}, doc! { "$push": { "b": { "$each": [1], "$sort": { "c": 1 } } } }).unwrap();
    assert_eq!(after.get_array("b").unwrap(), &vec![1.into(), Bson::from(doc! { "c": [] })]);
}

#[test]
fn a_rename_happens_at_its_target_and_not_through_arrays() {
    let renamed = |document: Document, update: Document| changed(document, doc! {}, update);
    let update = doc! { "$set": { "d": {} }, "$rename": { "b": "a.1" } };
    let (_, after) = renamed(doc! { "_id": 2, "b": [] }, update).unwrap();
    assert_eq!(after.keys().collect::<Vec<_>>(), ["_id", "a", "d"]);
    assert!(renamed(doc! { "_id": 1, "a": [1] }, doc! { "$rename": { "a.0.b": "b" } }).is_err());
    assert!(renamed(doc! { "_id": 1, "c": 1 }, doc! { "$rename": { "c": "_id" } }).is_err());
}

#[test]
fn a_number_that_is_an_index_and_a_field_cannot_be_sorted_by() {
    let ambiguous = vec![doc! { "_id": 1, "a": [{ "0": 1 }] }];
    assert!(sorted(ambiguous, doc! { "a.0": 1 }).unwrap_err().contains("ambiguous"));
}

#[test]
fn of_two_sorts_in_a_row_only_the_second_counts() {
    let stages = [doc! { "$unwind": "$b" }, doc! { "$sort": { "b": 1 } }, doc! { "$sort": { "_id": 1 } }];
    let found = aggregated(vec![doc! { "_id": 9, "b": [2, 1] }], &stages);
    assert_eq!(found, [doc! { "_id": 9, "b": 2 }, doc! { "_id": 9, "b": 1 }]);
}

#[test]
fn of_equal_greatest_values_the_latest_comes_first() {
    let most = doc! { "$maxN": { "n": 2, "input": "$n" } };
    let documents = vec![doc! { "_id": 1, "n": 0 }, doc! { "_id": 2, "n": 0.0 }, doc! { "_id": 3, "n": 0i64 }];
    let found = aggregated(documents, &[doc! { "$group": { "_id": 0, "p": most } }]);
    assert_eq!(found, [doc! { "_id": 0, "p": [0.0, 0] }]);
}

#[test]
fn fields_within_the_id_are_either_included_or_excluded() {
    let (store, ns) = store(vec![doc! { "_id": 1 }]);
    assert!(store.aggregate(&ns, (&[doc! { "$project": { "_id": { "b": 0, "c": 1 } } }]).into()).is_err());
}

#[test]
fn the_id_and_a_field_in_it_collide() {
    let (store, ns) = store(vec![doc! { "_id": { "a": 1 }, "x": 1 }]);
    let code = |result: Result<_, StoreError>| match result {
        Err(StoreError::Query(error)) => error.code,
        _ => 0,
    };
    for (first, second) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        for (projection, wanted) in
            [(doc! { "_id": first, "_id.a": second }, 31_249), (doc! { "_id.a": first, "_id": second }, 31_250)]
        {
            let stage = doc! { "$project": projection.clone() };
            assert_eq!(code(store.aggregate(&ns, (&[stage]).into())), wanted, "{projection}");
            let find = Find { projection: projection.clone(), ..Find::default() };
            assert_eq!(code(store.find(&ns, &find)), wanted, "{projection}");
        }
    }
}

#[test]
fn the_score_alone_is_an_inclusion_in_a_stage() {
    let (store, ns) = store(vec![doc! { "_id": 1, "t": "hello", "x": 1 }]);
    store.create_index(&ns, &Index::parse(&doc! { "key": { "t": "text" }, "name": "t" }).unwrap()).unwrap();
    let search = doc! { "$match": { "$text": { "$search": "hello" } } };
    let keys = |fields: Document| -> Vec<String> {
        let stages = [search.clone(), doc! { "$project": fields }];
        let found = store.aggregate(&ns, (&stages).into()).unwrap().next().unwrap().unwrap();
        Document::try_from(&*found).unwrap().keys().cloned().collect()
    };
    let score = doc! { "$meta": "textScore" };
    assert_eq!(keys(doc! { "score": score.clone() }), ["_id", "score"]);
    assert_eq!(keys(doc! { "_id": 0, "score": score.clone() }), ["score"]);
    assert_eq!(keys(doc! { "x": 0, "score": score }), ["_id", "t", "score"]);
}

fn found(documents: Vec<Document>, find: Find) -> Result<Vec<Document>, String> {
    let (store, ns) = store(documents);
    let found = store.find(&ns, &find).map_err(|error| error.to_string())?;
    found.map(|raw| Ok(Document::try_from(&*raw.map_err(|error| error.to_string())?).unwrap())).collect()
}

#[test]
fn a_positional_projection_takes_the_element_of_the_whole_array() {
    let at = |filter: Document, projection: Document| {
        let document = doc! { "_id": 1, "a": [1, { "b": 2 }], "arr": [10] };
        found(vec![document], Find { filter, projection, ..Find::default() })
    };
    let deep = at(doc! { "a.b": 2 }, doc! { "_id": 0, "a.b.$": 1 });
    assert_eq!(deep, Ok(vec![doc! { "a": [{ "b": 2 }] }]));
    assert!(at(doc! { "a": 1 }, doc! { "a.b.$": 1 }).unwrap_err().contains("mismatch"));
    assert!(at(doc! { "arr.0": 10 }, doc! { "arr.$": 1 }).is_err());
}

#[test]
fn a_slice_of_null_elements_is_null() {
    let projection = doc! { "_id": 0, "arr": { "$slice": [0, Bson::Null] } };
    let sliced = found(vec![doc! { "_id": 1, "arr": [1] }], Find { projection, ..Find::default() });
    assert_eq!(sliced, Ok(vec![doc! { "arr": Bson::Null }]));
}

#[test]
fn the_field_of_a_plain_lookup_goes_last() {
    let lookup = doc! { "$lookup": { "from": "none", "localField": "b", "foreignField": "b", "as": "a" } };
    let keys = |stages: &[Document]| -> Vec<String> {
        aggregated(vec![doc! { "_id": 1, "a": 0, "b": 1 }], stages).remove(0).keys().cloned().collect()
    };
    assert_eq!(keys(std::slice::from_ref(&lookup)), ["_id", "b", "a"]);
    assert_eq!(keys(&[doc! { "$set": { "c": 1 } }, lookup]), ["_id", "a", "b", "c"]);
}

#[test]
fn a_date_is_not_moved_by_what_is_no_number() {
    let moved = doc! { "$project": { "v": { "$add": [bson::DateTime::from_millis(5), "$n"] } } };
    for number in [decimal("NaN"), decimal("Infinity"), Bson::Double(f64::NAN), Bson::Double(1e300)] {
        let (store, ns) = store(vec![doc! { "_id": 1, "n": number.clone() }]);
        let error = store
            .aggregate(&ns, std::slice::from_ref(&moved).into())
            .and_then(|found| found.collect::<Result<Vec<_>, _>>());
        assert!(error.unwrap_err().to_string().contains("date overflow"), "{number}");
    }
}

#[test]
fn an_update_by_a_pipeline_that_drops_the_id_is_a_modification() {
    let (store, ns) = store(vec![doc! { "_id": 1 }]);
    let update = UpdateSpec::Pipeline(vec![doc! { "$unset": "_id" }]);
    let request = UpdateRequest { filter: doc! {}, update, ..UpdateRequest::default() };
    assert_eq!(store.update(&ns, &request, None).unwrap().modified, 1);
}

#[test]
fn what_is_wrong_with_constants_is_an_error_at_once_for_some_operators_only() {
    let nothing = |expression: Document| {
        let (store, ns) = store(Vec::new());
        store
            .aggregate(&ns, (&[doc! { "$project": { "r": expression } }]).into())
            .map(|_| ())
            .map_err(|error| error.to_string())
    };
    assert_eq!(nothing(doc! { "$zip": { "inputs": [[1], 1.0] } }), Ok(()));
    assert!(nothing(doc! { "$setIsSubset": ["$k", { "$literal": "a" }] }).is_err());
    assert!(nothing(doc! { "$indexOfArray": [{ "$literal": 1 }, "$x"] }).is_err());
    assert!(nothing(doc! { "$switch": { "branches": [{ "case": false, "then": "$s" }] } }).is_err());
    assert!(nothing(doc! { "$divide": [1, 0] }).is_err());
}

#[test]
fn what_a_group_would_not_keep_is_not_computed() {
    // `$firstN` learns of the value after its last that it has enough, `$first` at once.
    let documents =
        vec![doc! { "_id": 1, "n": 2, "m": 2 }, doc! { "_id": 2, "n": 0, "m": 1 }, doc! { "_id": 3, "m": 0 }];
    let half = |field: &str| doc! { "$divide": [1, field] };
    let first = doc! { "_id": 0, "p": { "$first": half("$n") }, "q": { "$firstN": { "n": 1, "input": half("$m") } } };
    assert_eq!(aggregated(documents, &[doc! { "$group": first }]), [doc! { "_id": 0, "p": 0.5, "q": [0.5] }]);
}
