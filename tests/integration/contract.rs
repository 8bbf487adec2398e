//! What every store does, written once and run over all of them.
//!
//! A case is a function over `&dyn Store` and a namespace of its own; to add
//! one, write it and name it in [`CASES`].

use std::collections::BTreeMap;
use std::time::Duration;

use bson::{Bson, DateTime, Document, doc};
use libtest_mimic::{Failed, Trial};
use rmem::query::Collation;
use rmem::store::{
    Aggregation, ChangeKind, Embedded, Find, FindAndModify, HistoryRule, Index, IndexChange, Inserted, Modification,
    Modified, Modifiers, Namespace, Query, Scope, Store, StoreError, UpdateRequest, UpdateSpec, Updated,
};

type Case = fn(&dyn Store, &Namespace);

macro_rules! cases {
    ($($name:ident),* $(,)?) => { &[$((stringify!($name), $name as Case)),*] };
}

const CASES: &[(&str, Case)] = cases![
    documents_without_an_id_get_one,
    the_id_becomes_the_first_key,
    ids_come_back_in_the_order_of_the_documents,
    a_duplicate_stops_an_insert_and_what_was_before_it_stays,
    equal_numbers_of_different_types_are_the_same_id,
    some_ids_are_refused,
    a_refused_document_stops_an_insert_and_what_was_before_it_stays,
    documents_may_be_nested_as_deeply_as_mongodb_nests_them,
    inserting_nothing_is_fine,
    natural_order_is_the_order_of_insertion,
    an_empty_collection_has_no_documents,
    filters_choose_documents,
    filters_look_into_arrays_and_below,
    an_id_is_found_by_equality_and_by_in,
    unknown_operators_are_refused_when_the_query_is_made,
    sort_skip_and_limit_apply_in_this_order,
    projections_choose_fields,
    counting_agrees_with_finding,
    distinct_values_come_once,
    pipelines_are_run,
    a_pipeline_may_read_another_collection,
    unknown_stages_are_refused,
    results_may_go_into_another_collection,
    many_documents_come_in_pages,
    an_update_that_fails_at_a_document_keeps_those_before,
    an_update_changes_the_first_match,
    an_update_of_many_changes_all,
    an_update_that_changes_nothing_is_no_modification,
    a_replacement_keeps_the_id,
    a_replacement_of_many_is_refused,
    the_id_cannot_change,
    array_filters_choose_elements,
    a_pipeline_takes_no_array_filters,
    a_replacement_counts_as_a_modification_also_where_it_changes_nothing,
    what_is_set_to_not_a_number_again_is_modified,
    empty_timestamps_at_the_top_become_the_time,
    an_upsert_inserts_what_filter_and_update_say,
    an_upsert_that_matches_updates,
    an_expression_goes_with_no_upsert_and_no_positional_projection,
    modifiers_apply_to_every_operation,
    a_collection_has_a_collation_that_everything_inherits,
    slopes_and_areas_have_the_types_of_what_they_are_made_of,
    words_are_searched_by_a_text_index,
    a_stamped_update_says_when,
    a_stamped_replacement_keeps_when_it_was_inserted,
    a_stamped_update_that_changes_nothing_is_no_modification,
    a_stamped_update_that_only_moves_the_metadata_is_no_modification,
    a_stamped_update_compares_values_and_their_types,
    what_the_memory_notes_cannot_be_changed,
    a_pipeline_cannot_lose_when_a_document_was_inserted,
    the_first_match_is_changed_and_returned,
    what_is_found_by_chance_is_what_is_changed,
    documents_with_any_id_are_found_and_changed,
    a_document_is_found_by_its_place_whatever_its_fields_are_called,
    a_change_by_chance_is_dated_where_it_changes,
    ids_that_a_collation_takes_for_equal_are_changed_once,
    an_update_that_fails_has_changed_the_documents_before,
    a_change_compares_as_the_collection_does,
    the_score_of_what_is_changed_is_shown,
    a_document_takes_what_a_command_has_room_for,
    the_metadata_that_is_returned_is_that_of_the_change,
    putting_replaces_by_id,
    deleting_the_first_leaves_the_others,
    deleting_all_counts_them,
    dropping_says_whether_there_was_one,
    a_renamed_collection_takes_the_place_of_another,
    a_rename_replaces_another_collection_only_where_that_is_asked_for,
    renaming_what_is_not_there_changes_nothing,
    collections_are_listed_in_order,
    documents_may_be_read_while_others_are_written,
    values_of_every_type_come_back,
    an_index_is_listed_until_it_is_dropped,
    an_index_is_changed_in_its_place,
    an_index_with_other_options_is_a_conflict,
    a_unique_index_refuses_a_taken_key_by_its_name,
    a_unique_index_is_not_made_over_duplicates,
    a_sparse_unique_index_lets_documents_lack_the_field,
    indexes_move_with_their_collection_and_stay_below_results,
    an_explanation_names_the_index_and_counts_what_was_looked_at,
    what_is_near_comes_the_nearest_first,
    what_is_near_needs_an_index,
    a_pipeline_may_begin_with_what_is_near,
    an_index_of_places_refuses_what_is_none,
    the_first_document_that_decays_makes_the_index_for_it,
    an_update_that_lets_a_document_decay_makes_the_index_too,
    a_decayed_document_takes_no_key,
    an_expression_sees_the_stored_documents_whatever_their_metadata_is,
    the_runs_that_lost_their_oldest_changes_are_known,
    a_collection_with_a_history_can_be_dropped,
    the_keys_of_a_reference_are_fields_of_paths,
];

/// A store to be examined, and the folder that is removed after it.
pub(crate) struct Subject {
    pub(crate) store: Box<dyn Store>,
    pub(crate) folder: Option<tempfile::TempDir>,
}

/// The names of all cases over a store called `prefix`.
#[cfg(feature = "mongodb")]
pub(crate) fn names(prefix: &str) -> Vec<String> {
    CASES.iter().map(|(name, _)| format!("{prefix}::{name}")).collect()
}

/// All cases over the stores that `open` gives.
pub(crate) fn trials(prefix: &str, open: impl Fn() -> Result<Subject, Failed> + Clone + Send + 'static) -> Vec<Trial> {
    let trial = |(name, case): &(&'static str, Case)| {
        let (name, case, open) = (*name, *case, open.clone());
        Trial::test(format!("{prefix}::{name}"), move || {
            let subject = open()?;
            let ns = Namespace { database: "contract".to_owned(), collection: name.to_owned() };
            case(subject.store.as_ref(), &ns);
            drop(subject.store);
            drop(subject.folder);
            Ok(())
        })
    };
    CASES.iter().map(trial).collect()
}

/// All cases over the embedded store, in a file and in memory.
pub(crate) fn embedded() -> Vec<Trial> {
    let mut trials = trials("contract::file", || {
        let folder = tempfile::tempdir()?;
        let store = Embedded::open(folder.path().join("robot.rmem"))?;
        Ok(Subject { store: Box::new(store), folder: Some(folder) })
    });
    trials.extend(self::trials("contract::mem", || {
        Ok(Subject { store: Box::new(Embedded::in_memory()?), folder: None })
    }));
    trials
}

fn insert(store: &dyn Store, ns: &Namespace, documents: impl IntoIterator<Item = Document>) -> Vec<Bson> {
    store.insert(ns, documents.into_iter().collect()).unwrap().ids
}

fn found(store: &dyn Store, ns: &Namespace, find: &Find) -> Vec<Document> {
    store.find(ns, find).unwrap().map(|raw| Document::try_from(&*raw.unwrap()).unwrap()).collect()
}

fn all(store: &dyn Store, ns: &Namespace) -> Vec<Document> {
    found(store, ns, &Find::default())
}

/// The `_id`s of the matches, in order.
fn ids(store: &dyn Store, ns: &Namespace, filter: Document) -> Vec<i32> {
    let find = Find { filter, ..Find::default() };
    found(store, ns, &find).iter().map(|document| document.get_i32("_id").unwrap()).collect()
}

fn update(filter: Document, update: Document) -> UpdateRequest {
    UpdateRequest { filter, update: UpdateSpec::Document(update), ..UpdateRequest::default() }
}

fn changed(matched: u64, modified: u64) -> Updated {
    Updated { matched, modified, upserted: None }
}

/// MongoDB's code of a refusal.
#[track_caller]
fn code<T>(result: Result<T, StoreError>) -> i32 {
    match result {
        Ok(_) => panic!("not refused"),
        Err(StoreError::Query(error)) => error.code,
        Err(error) => panic!("refused as {error:?}"),
    }
}

fn documents_without_an_id_get_one(store: &dyn Store, ns: &Namespace) {
    let ids = insert(store, ns, [doc! { "a": 1 }, doc! { "a": 2 }]);
    assert!(matches!(ids.as_slice(), [Bson::ObjectId(first), Bson::ObjectId(second)] if first != second));
    assert_eq!(all(store, ns)[0], doc! { "_id": ids[0].clone(), "a": 1 });
}

fn the_id_becomes_the_first_key(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "a": 1, "_id": 7, "b": 2 }]);
    assert_eq!(all(store, ns)[0].keys().collect::<Vec<_>>(), ["_id", "a", "b"]);
}

fn ids_come_back_in_the_order_of_the_documents(store: &dyn Store, ns: &Namespace) {
    assert_eq!(
        insert(store, ns, [doc! { "_id": 2 }, doc! { "_id": "b" }, doc! { "_id": { "x": 1 } }]),
        [Bson::Int32(2), "b".into(), doc! { "x": 1 }.into()]
    );
}

fn a_duplicate_stops_an_insert_and_what_was_before_it_stays(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 3 }]);
    let documents = (1..=5).map(|n| doc! { "_id": n }).collect();
    match store.insert(ns, documents) {
        Err(StoreError::Duplicate { namespace, key, stored }) => {
            assert_eq!((&namespace, key.text()), (ns, "_id: 3"));
            assert_eq!(stored, [Bson::Int32(1), Bson::Int32(2)]);
        }
        other => panic!("{other:?}"),
    }
    assert_eq!(ids(store, ns, doc! {}), [3, 1, 2]);
}

fn equal_numbers_of_different_types_are_the_same_id(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1 }]);
    for id in [Bson::Int64(1), Bson::Double(1.0)] {
        assert!(matches!(store.insert(ns, vec![doc! { "_id": id }]), Err(StoreError::Duplicate { .. })));
    }
    insert(store, ns, [doc! { "_id": true }, doc! { "_id": "1" }, doc! { "_id": Bson::Null }]);
    assert_eq!(store.count(ns, (&doc! { "_id": 1.0 }).into()).unwrap(), 1);
}

fn some_ids_are_refused(store: &dyn Store, ns: &Namespace) {
    let regex = bson::Regex { pattern: "a".try_into().unwrap(), options: "".try_into().unwrap() };
    for id in [Bson::Array(vec![]), Bson::RegularExpression(regex), Bson::Undefined] {
        assert_eq!(code(store.insert(ns, vec![doc! { "_id": id }])), 53);
    }
    assert_eq!(code(store.insert(ns, vec![doc! { "_id": { "$a": 1 } }])), 52);
    insert(store, ns, [doc! { "_id": 1, "$price": 2, "a.b": 3, "": 4 }]);
}

fn a_refused_document_stops_an_insert_and_what_was_before_it_stays(store: &dyn Store, ns: &Namespace) {
    let documents = vec![doc! { "_id": 1 }, doc! { "_id": [] }, doc! { "_id": 2 }];
    match store.insert(ns, documents) {
        Err(StoreError::Stopped { stored, document, source }) => {
            assert_eq!((stored, document), (vec![Bson::Int32(1)], Some(2)));
            assert!(matches!(*source, StoreError::Query(error) if error.code == 53));
        }
        other => panic!("{other:?}"),
    }
    assert_eq!(ids(store, ns, doc! {}), [1]);
    let error = store.insert(ns, vec![doc! { "_id": [] }, doc! { "_id": 2 }]).unwrap_err();
    assert_eq!((error.stored(), error.to_string().as_str()), (&[][..], "document 1 cannot be stored"));
    assert_eq!(ids(store, ns, doc! {}), [1]);
}

fn documents_may_be_nested_as_deeply_as_mongodb_nests_them(store: &dyn Store, ns: &Namespace) {
    let nested = |id: i32, levels: usize| {
        let inner = (2..levels).fold(doc! { "x": 1 }, |inner, _| doc! { "a": inner });
        doc! { "_id": id, "a": inner }
    };
    insert(store, ns, [nested(1, rmem::store::MAX_DEPTH)]);
    assert_eq!(all(store, ns), [nested(1, rmem::store::MAX_DEPTH)]);
    assert_eq!(code(store.insert(ns, vec![nested(2, rmem::store::MAX_DEPTH + 1)])), 15);
}

fn inserting_nothing_is_fine(store: &dyn Store, ns: &Namespace) {
    assert_eq!(insert(store, ns, []), []);
    assert_eq!(store.count(ns, (&doc! {}).into()).unwrap(), 0);
}

fn natural_order_is_the_order_of_insertion(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [5, 1, 4].map(|n| doc! { "_id": n, "kind": "a" }));
    insert(store, ns, [3, 2].map(|n| doc! { "_id": n, "kind": "a" }));
    store.update(ns, &update(doc! { "_id": 1 }, doc! { "$set": { "pad": "x".repeat(9_000) } }), None).unwrap();
    assert_eq!(ids(store, ns, doc! {}), [5, 1, 4, 3, 2]);
    assert_eq!(ids(store, ns, doc! { "kind": "a" }), [5, 1, 4, 3, 2]);
}

fn an_empty_collection_has_no_documents(store: &dyn Store, ns: &Namespace) {
    assert_eq!(all(store, ns), []);
    assert_eq!(store.count(ns, (&doc! { "a": 1 }).into()).unwrap(), 0);
    assert_eq!(store.delete(ns, (&doc! {}).into(), false).unwrap(), 0);
    assert_eq!(store.update(ns, &update(doc! {}, doc! { "$set": { "a": 1 } }), None).unwrap(), changed(0, 0));
    assert_eq!(store.distinct(ns, "a", (&doc! {}).into()).unwrap(), []);
}

fn filters_choose_documents(store: &dyn Store, ns: &Namespace) {
    insert(
        store,
        ns,
        [
            doc! { "_id": 1, "relation": "on", "n": 5 },
            doc! { "_id": 2, "relation": "on-table", "n": 7.5 },
            doc! { "_id": 3, "relation": "holding", "n": Bson::Null },
            doc! { "_id": 4 },
        ],
    );
    for (filter, wanted) in [
        (doc! { "relation": "on" }, vec![1]),
        (doc! { "relation": { "$in": ["holding", "on"] } }, vec![1, 3]),
        (doc! { "n": { "$gt": 5 } }, vec![2]),
        (doc! { "n": { "$gte": 5.0, "$lt": 7 } }, vec![1]),
        (doc! { "n": Bson::Null }, vec![3, 4]),
        (doc! { "n": { "$exists": false } }, vec![4]),
        (doc! { "relation": { "$ne": "on" } }, vec![2, 3, 4]),
        (doc! { "$or": [{ "n": 5 }, { "relation": "holding" }] }, vec![1, 3]),
        (doc! { "$nor": [{ "n": 5 }, { "relation": "holding" }] }, vec![2, 4]),
        (doc! { "relation": { "$regex": "^on" } }, vec![1, 2]),
        (doc! { "n": { "$not": { "$gt": 5 } } }, vec![1, 3, 4]),
        (doc! { "n": { "$mod": [5, 0] } }, vec![1]),
        (doc! { "$expr": { "$gt": ["$n", 5] } }, vec![2]),
    ] {
        assert_eq!(ids(store, ns, filter.clone()), wanted, "{filter}");
    }
}

fn filters_look_into_arrays_and_below(store: &dyn Store, ns: &Namespace) {
    insert(
        store,
        ns,
        [
            doc! { "_id": 1, "tags": ["red", "small"], "pose": { "x": 1 } },
            doc! { "_id": 2, "tags": [], "pose": { "x": 2 } },
            doc! { "_id": 3, "rings": [{ "color": "blue", "n": 2 }, { "color": "red", "n": 1 }] },
        ],
    );
    for (filter, wanted) in [
        (doc! { "tags": "red" }, vec![1]),
        (doc! { "tags": [] }, vec![2]),
        (doc! { "tags": { "$size": 2 } }, vec![1]),
        (doc! { "tags": { "$all": ["small", "red"] } }, vec![1]),
        (doc! { "pose.x": 2 }, vec![2]),
        (doc! { "rings.color": "red" }, vec![3]),
        (doc! { "rings.0.color": "red" }, vec![]),
        (doc! { "rings": { "$elemMatch": { "color": "red", "n": 2 } } }, vec![]),
        (doc! { "rings": { "$elemMatch": { "color": "red", "n": 1 } } }, vec![3]),
    ] {
        assert_eq!(ids(store, ns, filter.clone()), wanted, "{filter}");
    }
}

fn an_id_is_found_by_equality_and_by_in(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, (0..50).map(|n| doc! { "_id": n, "even": n % 2 == 0 }));
    assert_eq!(ids(store, ns, doc! { "_id": 7 }), [7]);
    assert_eq!(ids(store, ns, doc! { "_id": 7.0 }), [7]);
    assert_eq!(ids(store, ns, doc! { "_id": { "$in": [3, 9, 9, 99] } }), [3, 9]);
    assert_eq!(ids(store, ns, doc! { "_id": 7, "even": true }), [0; 0]);
    assert_eq!(ids(store, ns, doc! { "$and": [{ "_id": { "$in": [4, 5] } }, { "even": true }] }), [4]);
    assert_eq!(ids(store, ns, doc! { "$or": [{ "_id": 1 }, { "_id": 48 }] }), [1, 48]);
    assert_eq!(ids(store, ns, doc! { "_id": { "$gt": 47 } }), [48, 49]);
}

fn unknown_operators_are_refused_when_the_query_is_made(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1, "a": 1 }]);
    for filter in [doc! { "a": { "$nonsense": 1 } }, doc! { "$nonsense": 1 }, doc! { "a": { "$in": 1 } }] {
        assert_eq!(code(store.find(ns, &Find { filter: filter.clone(), ..Find::default() })), 2, "{filter}");
        assert_eq!(code(store.count(ns, (&filter).into())), 2, "{filter}");
        assert_eq!(code(store.delete(ns, (&filter).into(), false)), 2, "{filter}");
    }
    assert_eq!(code(store.update(ns, &update(doc! {}, doc! { "$nonsense": { "a": 1 } }), None)), 9);
    assert_eq!(code(store.find(ns, &Find { sort: doc! { "a": 7 }, ..Find::default() })), 15975);
}

fn sort_skip_and_limit_apply_in_this_order(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [3, 1, 2, 5, 4].map(|n| doc! { "_id": n, "group": n % 2 }));
    let order = |sort: Document, skip, limit| {
        let find = Find { sort, skip, limit, ..Find::default() };
        found(store, ns, &find).iter().map(|document| document.get_i32("_id").unwrap()).collect::<Vec<_>>()
    };
    assert_eq!(order(doc! { "_id": 1 }, 0, 0), [1, 2, 3, 4, 5]);
    assert_eq!(order(doc! { "_id": -1 }, 1, 2), [4, 3]);
    assert_eq!(order(doc! { "group": 1, "_id": -1 }, 0, 3), [4, 2, 5]);
    assert_eq!(order(doc! {}, 1, 2), [1, 2]);
    assert_eq!(order(doc! {}, 9, 0), [0; 0]);
    assert_eq!(order(doc! { "_id": 1 }, 4, 9), [5]);
}

fn projections_choose_fields(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1, "a": 2, "pose": { "x": 3, "y": 4 } }]);
    let projected = |projection: Document| found(store, ns, &Find { projection, ..Find::default() }).remove(0);
    assert_eq!(projected(doc! { "a": 1 }), doc! { "_id": 1, "a": 2 });
    assert_eq!(projected(doc! { "_id": 0, "pose.y": 1 }), doc! { "pose": { "y": 4 } });
    assert_eq!(projected(doc! { "pose": 0 }), doc! { "_id": 1, "a": 2 });
    assert_eq!(code(store.find(ns, &Find { projection: doc! { "a": 1, "pose": 0 }, ..Find::default() })), 31254);
}

fn counting_agrees_with_finding(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, (0..100).map(|n| doc! { "_id": n, "n": n % 10 }));
    for filter in [doc! {}, doc! { "n": 3 }, doc! { "n": { "$lt": 5 } }, doc! { "_id": 4 }, doc! { "x": 1 }] {
        assert_eq!(store.count(ns, (&filter).into()).unwrap(), ids(store, ns, filter.clone()).len() as u64, "{filter}");
    }
}

fn distinct_values_come_once(store: &dyn Store, ns: &Namespace) {
    insert(
        store,
        ns,
        [
            doc! { "_id": 1, "a": 2, "b": [{ "c": 1 }, { "c": [2, 3] }] },
            doc! { "_id": 2, "a": [1, 2.0, "x"], "b": { "c": 1 } },
            doc! { "_id": 3, "a": [[9]] },
            doc! { "_id": 4 },
        ],
    );
    let distinct = |field: &str, filter: Document| store.distinct(ns, field, (&filter).into()).unwrap();
    assert_eq!(distinct("a", doc! { "_id": { "$lt": 3 } }), [Bson::Int32(1), Bson::Int32(2), "x".into()]);
    assert_eq!(distinct("a", doc! { "_id": 3 }), [Bson::Array(vec![Bson::Int32(9)])]);
    assert_eq!(distinct("b.c", doc! {}), [1, 2, 3].map(Bson::Int32));
    assert_eq!(distinct("b.1.c", doc! {}), [2, 3].map(Bson::Int32));
    assert_eq!(distinct("none", doc! {}), []);
    for path in ["", "a.", ".a", "a..b", "$a"] {
        assert!(store.distinct(ns, path, (&doc! {}).into()).is_err(), "{path:?}");
    }
}

fn aggregated(store: &dyn Store, ns: &Namespace, pipeline: &[Document]) -> Vec<Document> {
    let results = store.aggregate(ns, pipeline.into()).unwrap();
    results.map(|raw| Document::try_from(&*raw.unwrap()).unwrap()).collect()
}

fn pipelines_are_run(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, (0..10).map(|n| doc! { "_id": n, "kind": if n % 3 == 0 { "a" } else { "b" }, "n": n }));
    let group = doc! { "$group": { "_id": "$kind", "sum": { "$sum": "$n" } } };
    let pipeline = [doc! { "$match": { "n": { "$gt": 2 } } }, group, doc! { "$sort": { "_id": 1 } }];
    let wanted = [doc! { "_id": "a", "sum": 18 }, doc! { "_id": "b", "sum": 24 }];
    assert_eq!(aggregated(store, ns, &pipeline), wanted);
    let pipeline = [doc! { "$match": { "_id": { "$in": [7, 2] } } }, doc! { "$project": { "kind": 0 } }];
    assert_eq!(aggregated(store, ns, &pipeline), [doc! { "_id": 2, "n": 2 }, doc! { "_id": 7, "n": 7 }]);
    assert_eq!(aggregated(store, ns, &[doc! { "$count": "all" }]), [doc! { "all": 10 }]);
    assert_eq!(aggregated(store, ns, &[]).len(), 10);
}

fn a_pipeline_may_read_another_collection(store: &dyn Store, ns: &Namespace) {
    let other = Namespace { collection: format!("{}.other", ns.collection), ..ns.clone() };
    insert(store, ns, [doc! { "_id": 1, "on": "B" }, doc! { "_id": 2, "on": "none" }]);
    insert(store, &other, [doc! { "_id": "B", "x": 5 }]);
    let lookup = doc! { "from": &other.collection, "localField": "on", "foreignField": "_id", "as": "below" };
    assert_eq!(
        aggregated(store, ns, &[doc! { "$lookup": lookup }, doc! { "$sort": { "_id": 1 } }]),
        [doc! { "_id": 1, "on": "B", "below": [{ "_id": "B", "x": 5 }] }, doc! { "_id": 2, "on": "none", "below": [] }]
    );
}

fn results_may_go_into_another_collection(store: &dyn Store, ns: &Namespace) {
    let other = Namespace { collection: format!("{}.other", ns.collection), ..ns.clone() };
    insert(store, ns, (1..=3).map(|n| doc! { "_id": n, "n": n }));
    insert(store, &other, [doc! { "_id": 9 }]);
    let pipeline = [doc! { "$match": { "n": { "$gt": 1 } } }, doc! { "$out": &other.collection }];
    assert_eq!(aggregated(store, ns, &pipeline), []);
    assert_eq!(all(store, &other), [doc! { "_id": 2, "n": 2 }, doc! { "_id": 3, "n": 3 }]);

    let merge = |specification: Document| {
        let mut merge = doc! { "into": &other.collection };
        merge.extend(specification);
        let pipeline = [doc! { "$project": { "m": { "$add": ["$n", 10] } } }, doc! { "$merge": merge }];
        store.aggregate(ns, (&pipeline).into()).and_then(Iterator::collect::<Result<Vec<_>, _>>)
    };
    assert_eq!(merge(doc! {}).unwrap(), [] as [bson::RawDocumentBuf; 0]);
    let merged = [doc! { "_id": 2, "n": 2, "m": 12 }, doc! { "_id": 3, "n": 3, "m": 13 }, doc! { "_id": 1, "m": 11 }];
    assert_eq!(all(store, &other), merged);
    store.delete(&other, (&doc! { "_id": 1 }).into(), false).unwrap();
    merge(doc! { "whenMatched": "replace", "whenNotMatched": "discard" }).unwrap();
    assert_eq!(all(store, &other), [doc! { "_id": 2, "m": 12 }, doc! { "_id": 3, "m": 13 }]);
    let sum = bson::bson!([{ "$set": { "m": { "$add": ["$m", "$$new.m"] } } }]);
    merge(doc! { "whenMatched": sum, "whenNotMatched": "discard" }).unwrap();
    assert_eq!(all(store, &other), [doc! { "_id": 2, "m": 24 }, doc! { "_id": 3, "m": 26 }]);
    assert!(merge(doc! { "whenMatched": "fail" }).is_err());
    store.delete(&other, (&doc! { "_id": 1 }).into(), false).unwrap();
    assert!(merge(doc! { "whenNotMatched": "fail" }).is_err());
    assert!(merge(doc! { "on": "m" }).is_err());
}

fn unknown_stages_are_refused(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! {}]);
    assert_eq!(code(store.aggregate(ns, (&[doc! { "$nonsense": {} }]).into())), 40324);
}

fn many_documents_come_in_pages(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, (0..3_000).map(|n| doc! { "_id": n, "pad": "x".repeat(500), "third": n % 3 == 0 }));
    assert_eq!(ids(store, ns, doc! {}), (0..3_000).collect::<Vec<_>>());
    assert_eq!(ids(store, ns, doc! { "third": true }), (0..3_000).step_by(3).collect::<Vec<_>>());
    assert_eq!(store.find(ns, &Find::default()).unwrap().take(2).count(), 2);
}

fn an_update_that_fails_at_a_document_keeps_those_before(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1, "n": 1 }, doc! { "_id": 2, "n": "x" }, doc! { "_id": 3, "n": 3 }]);
    let request = UpdateRequest { many: true, ..update(doc! {}, doc! { "$inc": { "n": 1 } }) };
    assert!(store.update(ns, &request, None).is_err());
    assert_eq!(all(store, ns), [doc! { "_id": 1, "n": 2 }, doc! { "_id": 2, "n": "x" }, doc! { "_id": 3, "n": 3 }]);
}

fn an_update_changes_the_first_match(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, (1..=3).map(|n| doc! { "_id": n, "a": 1 }));
    let request = update(doc! { "a": 1 }, doc! { "$set": { "b": "new" }, "$inc": { "a": 5 } });
    assert_eq!(store.update(ns, &request, None).unwrap(), changed(1, 1));
    assert_eq!(all(store, ns)[0], doc! { "_id": 1, "a": 6, "b": "new" });
    assert_eq!(ids(store, ns, doc! { "a": 1 }), [2, 3]);
}

fn an_update_of_many_changes_all(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, (1..=1_200).map(|n| doc! { "_id": n, "a": n % 2 }));
    let request = UpdateRequest { many: true, ..update(doc! { "a": 1 }, doc! { "$push": { "seen": "x" } }) };
    assert_eq!(store.update(ns, &request, None).unwrap(), changed(600, 600));
    assert_eq!(store.count(ns, (&doc! { "seen": ["x"] }).into()).unwrap(), 600);
    let request = UpdateRequest { many: true, ..update(doc! {}, doc! { "$unset": { "seen": "" } }) };
    assert_eq!(store.update(ns, &request, None).unwrap(), changed(1_200, 600));
}

fn an_update_that_changes_nothing_is_no_modification(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1, "a": 1 }]);
    for change in [doc! { "$set": { "a": 1 } }, doc! { "$unset": { "b": "" } }, doc! { "_id": 1, "a": 1 }] {
        assert_eq!(store.update(ns, &update(doc! {}, change.clone()), None).unwrap(), changed(1, 0), "{change}");
    }
}

fn a_replacement_keeps_the_id(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1, "a": 1 }, doc! { "_id": 2, "a": 1 }]);
    assert_eq!(store.update(ns, &update(doc! { "a": 1 }, doc! { "b": 2 }), None).unwrap(), changed(1, 1));
    assert_eq!(all(store, ns), [doc! { "_id": 1, "b": 2 }, doc! { "_id": 2, "a": 1 }]);
    assert_eq!(store.update(ns, &update(doc! { "_id": 2 }, doc! {}), None).unwrap(), changed(1, 1));
    assert_eq!(all(store, ns)[1], doc! { "_id": 2 });
}

fn a_replacement_of_many_is_refused(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1 }]);
    let request = UpdateRequest { many: true, ..update(doc! {}, doc! { "b": 2 }) };
    assert_eq!(code(store.update(ns, &request, None)), 9);
}

fn the_id_cannot_change(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1, "a": 1 }]);
    for change in [doc! { "$set": { "_id": 2 } }, doc! { "_id": 2 }, doc! { "$unset": { "_id": "" } }] {
        assert_eq!(code(store.update(ns, &update(doc! {}, change.clone()), None)), 66, "{change}");
    }
    assert_eq!(all(store, ns), [doc! { "_id": 1, "a": 1 }]);
}

fn array_filters_choose_elements(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1, "rings": [{ "n": 1 }, { "n": 5 }] }]);
    let request = UpdateRequest {
        array_filters: vec![doc! { "big.n": { "$gt": 3 } }],
        ..update(doc! {}, doc! { "$set": { "rings.$[big].seen": true } })
    };
    assert_eq!(store.update(ns, &request, None).unwrap(), changed(1, 1));
    assert_eq!(all(store, ns)[0], doc! { "_id": 1, "rings": [{ "n": 1 }, { "n": 5, "seen": true }] });
}

fn a_pipeline_takes_no_array_filters(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1, "rings": [1] }]);
    let request = UpdateRequest {
        update: UpdateSpec::Pipeline(vec![doc! { "$set": { "seen": true } }]),
        array_filters: vec![doc! { "big": { "$gt": 3 } }],
        ..update(doc! {}, doc! {})
    };
    assert!(store.update(ns, &request, None).is_err());
    assert_eq!(all(store, ns)[0], doc! { "_id": 1, "rings": [1] });
}

fn a_replacement_counts_as_a_modification_also_where_it_changes_nothing(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1, "a": 1 }]);
    assert_eq!(store.update(ns, &update(doc! {}, doc! { "a": 1 }), None).unwrap(), changed(1, 1));
}

fn what_is_set_to_not_a_number_again_is_modified(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1, "a": f64::NAN }]);
    assert_eq!(store.update(ns, &update(doc! {}, doc! { "$inc": { "a": 1 } }), None).unwrap(), changed(1, 1));
}

fn empty_timestamps_at_the_top_become_the_time(store: &dyn Store, ns: &Namespace) {
    let empty = bson::Timestamp { time: 0, increment: 0 };
    insert(store, ns, [doc! { "_id": empty, "a": empty, "b": [empty] }]);
    let stored = all(store, ns).remove(0);
    assert!(stored.get_timestamp("a").unwrap().time > 1_700_000_000, "{stored}");
    assert_eq!(stored.get_timestamp("_id").unwrap(), empty);
    assert_eq!(stored.get_array("b").unwrap(), &[Bson::Timestamp(empty)]);
}

fn an_upsert_inserts_what_filter_and_update_say(store: &dyn Store, ns: &Namespace) {
    let request = UpdateRequest {
        upsert: true,
        ..update(doc! { "_id": 9, "kind": "a" }, doc! { "$set": { "n": 1 }, "$setOnInsert": { "m": 2 } })
    };
    let upserted = store.update(ns, &request, None).unwrap();
    assert_eq!(upserted, Updated { matched: 0, modified: 0, upserted: Some(Bson::Int32(9)) });
    assert_eq!(ids(store, ns, doc! { "_id": 9, "kind": "a", "n": 1, "m": 2 }), [9]);

    let request = UpdateRequest { upsert: true, ..update(doc! { "kind": "b" }, doc! { "whole": true }) };
    let Some(Bson::ObjectId(id)) = store.update(ns, &request, None).unwrap().upserted else { panic!("no id") };
    assert_eq!(all(store, ns)[1], doc! { "_id": id, "whole": true });
}

fn an_upsert_that_matches_updates(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1, "a": 1 }]);
    let request = UpdateRequest { upsert: true, ..update(doc! { "a": 1 }, doc! { "$set": { "b": 1 } }) };
    assert_eq!(store.update(ns, &request, None).unwrap(), changed(1, 1));
    assert_eq!(store.count(ns, (&doc! {}).into()).unwrap(), 1);
}

fn an_expression_goes_with_no_upsert_and_no_positional_projection(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1, "l": [1] }]);
    for filter in
        [doc! { "$expr": { "$eq": ["$_id", 1] } }, doc! { "$and": [{ "l": 1 }, { "$nor": [{ "$expr": false }] }] }]
    {
        for spec in [doc! { "$set": { "a": 1 } }, doc! { "$mul": { "a": 2 } }] {
            let request = UpdateRequest { upsert: true, ..update(filter.clone(), spec) };
            assert_eq!(code(store.update(ns, &request, None)), 224, "{filter}");
            assert_eq!(code(store.update(ns, &request, Some(instant(1)))), 224, "{filter}");
        }
        let shown = Find { filter: filter.clone(), projection: doc! { "l.$": 1 }, ..Find::default() };
        let read = store.find(ns, &shown).and_then(Iterator::collect::<Result<Vec<_>, _>>);
        assert_eq!(code(read), 224, "{filter}");
    }
}

fn modifiers_apply_to_every_operation(store: &dyn Store, ns: &Namespace) {
    let Ok(collation) = Collation::parse(&doc! { "locale": "en", "strength": 2 }) else {
        return; // This build has no collations.
    };
    insert(store, ns, [doc! { "_id": 1, "name": "Box" }, doc! { "_id": 2, "name": "BOX" }, doc! { "_id": 3 }]);
    let variables = doc! { "least": 2 };
    let modifiers = Modifiers { collation: Some(collation), variables, hint: None };
    let filter = doc! { "name": "box" };
    let query = Query { filter: &filter, modifiers: &modifiers };
    assert_eq!(store.count(ns, query).unwrap(), 2);
    assert_eq!(store.count(ns, (&filter).into()).unwrap(), 0);
    assert_eq!(store.distinct(ns, "name", query).unwrap(), ["Box".into()]);
    let stages = [doc! { "$match": { "name": "box", "$expr": { "$gte": ["$_id", "$$least"] } } }];
    let aggregation = Aggregation { stages: &stages, modifiers: &modifiers };
    assert_eq!(store.aggregate(ns, aggregation).unwrap().count(), 1);
    for timestamp in [None, Some(instant(5))] {
        let name = if timestamp.is_some() { "twice" } else { "once" };
        let spec = UpdateSpec::Pipeline(vec![doc! { "$set": { name: "$$least" } }]);
        let request =
            UpdateRequest { update: spec, many: true, modifiers: modifiers.clone(), ..update(filter.clone(), doc! {}) };
        assert_eq!(store.update(ns, &request, timestamp).unwrap(), changed(2, 2));
    }
    assert_eq!(ids(store, ns, doc! { "once": 2, "twice": 2, "_robmem_info.updated": instant(5) }), [1, 2]);
    assert_eq!(store.delete(ns, query, false).unwrap(), 2);
    assert_eq!(ids(store, ns, doc! {}), [3]);
}

fn a_collection_has_a_collation_that_everything_inherits(store: &dyn Store, ns: &Namespace) {
    let Ok(collation) = Collation::parse(&doc! { "locale": "en", "strength": 2 }) else {
        return; // This build has no collations.
    };
    let duplicate = |result: Result<Inserted, StoreError>| match result {
        Err(StoreError::Stopped { source, .. }) => matches!(*source, StoreError::Duplicate { .. }),
        other => matches!(other, Err(StoreError::Duplicate { .. })),
    };
    assert!(store.create(ns, Some(&collation)).unwrap());
    assert!(!store.create(ns, None).unwrap());
    insert(store, ns, [doc! { "_id": "a", "name": "Box" }, doc! { "_id": "b", "name": "cup" }, doc! { "_id": "c" }]);
    let (mine, bytes) =
        (doc! { "name": "BOX" }, Modifiers { collation: Some(Collation::simple()), ..Modifiers::default() });
    let plain = Query { filter: &mine, modifiers: &bytes };
    let counts = || (store.count(ns, (&mine).into()).unwrap(), store.count(ns, plain).unwrap());
    assert_eq!(counts(), (1, 0));
    assert!(store.create_index(ns, &Index::on(doc! { "name": 1 })).unwrap());
    assert!(!store.create_index(ns, &Index::on(doc! { "name": 1 })).unwrap());
    let simple = Index { name: "plain".to_owned(), ..Index::on(doc! { "name": 1 }).standing_alone() };
    assert!(store.create_index(ns, &simple).unwrap());
    let listed = store.indexes(ns).unwrap();
    let names: Vec<_> = listed.iter().map(|index| (index.name.as_str(), index.collation().is_some())).collect();
    assert_eq!(names, [("_id_", true), ("name_1", true), ("plain", false)]);
    assert_eq!(listed[0].collation().as_ref(), Some(&collation));
    assert_eq!(counts(), (1, 0));
    assert!(duplicate(store.insert(ns, vec![doc! { "_id": "A" }])));
    assert_eq!(ids_of(store, ns, doc! { "_id": "B" }), ["b"]);
    let sort = Find { sort: doc! { "_id": -1 }, filter: doc! { "_id": { "$gt": "A" } }, ..Find::default() };
    let sorted = found(store, ns, &sort);
    assert_eq!(sorted.iter().map(|found| found.get_str("_id").unwrap()).collect::<Vec<_>>(), ["c", "b"]);
    let stages =
        [doc! { "$group": { "_id": { "$cond": [{ "$eq": ["$name", "CUP"] }, "cup", "other"] }, "n": { "$sum": 1 } } }];
    assert_eq!(store.aggregate(ns, (&stages).into()).unwrap().count(), 2);
    assert_eq!(
        store.update(ns, &update(doc! { "name": "CUP" }, doc! { "$set": { "n": 1 } }), None).unwrap(),
        changed(1, 1)
    );
    store.put(ns, vec![doc! { "_id": "b", "name": "CUP" }], None).unwrap();
    assert_eq!(store.distinct(ns, "name", (&doc! { "name": "cup" }).into()).unwrap(), ["CUP".into()]);
    assert_eq!(store.delete(ns, (&mine).into(), false).unwrap(), 1);
    assert_eq!(ids_of(store, ns, doc! {}), ["b", "c"]);
}

fn ids_of(store: &dyn Store, ns: &Namespace, filter: Document) -> Vec<String> {
    let found = found(store, ns, &Find { filter, ..Find::default() });
    found.iter().map(|found| found.get_str("_id").unwrap().to_owned()).collect()
}

/// The answers are mongod's.
fn slopes_and_areas_have_the_types_of_what_they_are_made_of(store: &dyn Store, ns: &Namespace) {
    let decimal = |text: &str| Bson::Decimal128(text.parse().unwrap());
    let documents = [Bson::Int32(1), Bson::Int32(2), decimal("3")].into_iter().zip([0, 10, 20]).map(|(value, x)| {
        doc! { "_id": x, "x": x, "at": instant(i64::from(x) * 1_000), "v": value }
    });
    insert(store, ns, documents);
    let values = |name: &str, by: &str, unit: Option<&str>| -> Vec<Bson> {
        let mut argument = doc! { "input": "$v" };
        argument.extend(unit.map(|unit| ("unit".to_owned(), unit.into())));
        let window = doc! { "documents": ["unbounded", "current"] };
        let output = doc! { "value": { name: argument, "window": window } };
        let stages = [doc! { "$setWindowFields": { "sortBy": { by: 1 }, "output": output } }];
        let found = store.aggregate(ns, (&stages).into()).unwrap();
        found.map(|found| Document::try_from(&*found.unwrap()).unwrap().remove("value").unwrap()).collect()
    };
    let zero = Bson::Double(0.0);
    assert_eq!(values("$integral", "x", None), [Bson::Int32(0), 15.0.into(), decimal("40")]);
    assert_eq!(values("$integral", "at", Some("second")), [zero.clone(), 15.0.into(), decimal("40")]);
    let hours = decimal("0.01111111111111111111111111111111111");
    assert_eq!(values("$integral", "at", Some("hour")), [zero, 0.004_166_666_666_666_667.into(), hours]);
    assert_eq!(values("$derivative", "x", None), [Bson::Null, 0.1.into(), decimal("0.1")]);
    assert_eq!(values("$derivative", "at", Some("second")), [Bson::Null, 0.1.into(), decimal("0.1000")]);
    for (value, codes) in [(Bson::Null, [5_423_900, 5_624_903]), ("x".into(), [5_423_900, 14])] {
        store.put(ns, vec![doc! { "_id": 0, "x": 0, "v": value }], None).unwrap();
        for (name, code_of) in ["$integral", "$derivative"].into_iter().zip(codes) {
            let window = doc! { "documents": ["unbounded", "current"] };
            let output = doc! { "value": { name: { "input": "$v" }, "window": window } };
            let stages = [doc! { "$setWindowFields": { "sortBy": { "x": 1 }, "output": output } }];
            let done = store.aggregate(ns, (&stages).into()).and_then(Iterator::collect::<Result<Vec<_>, _>>);
            assert_eq!(code(done), code_of, "{name}");
        }
    }
}

fn words_are_searched_by_a_text_index(store: &dyn Store, ns: &Namespace) {
    insert(
        store,
        ns,
        [
            doc! { "_id": 1, "name": "red cup", "note": "on the table" },
            doc! { "_id": 2, "name": "table", "note": "four red legs" },
            doc! { "_id": 3, "name": "lamp" },
        ],
    );
    let search = |words: &str| doc! { "$text": { "$search": words } };
    assert_eq!(code(store.count(ns, (&search("cup")).into())), 27);
    let keys = doc! { "name": "text", "note": "text" };
    let index = Index { other: doc! { "weights": { "name": 3 } }, ..Index::on(keys) };
    assert!(store.create_index(ns, &index).unwrap() && !store.create_index(ns, &index).unwrap());
    assert_eq!(code(store.create_index(ns, &Index::on(doc! { "other": "text" }))), 85);
    let listed = store.indexes(ns).unwrap().pop().unwrap();
    assert_eq!((listed.keys, listed.name), (doc! { "_fts": "text", "_ftsx": 1 }, index.name));
    assert_eq!(listed.other.get_document("weights").unwrap(), &doc! { "name": 3, "note": 1 });
    let score = doc! { "score": { "$meta": "textScore" } };
    let best = Find { filter: search("tables red"), sort: score.clone(), projection: score, ..Find::default() };
    let found: Vec<_> = found(store, ns, &best).iter().map(|found| found.get_f64("score").unwrap()).collect();
    assert_eq!(found, [3.0 + 2.0 / 3.0, 2.25 + 1.0]);
    assert_eq!(ids(store, ns, search("\"red legs\"")), [2]);
    assert_eq!(ids(store, ns, search("red -table")), [0; 0]);
    let stages = [doc! { "$match": search("lamps") }, doc! { "$project": { "name": 1 } }];
    assert_eq!(aggregated(store, ns, &stages), [doc! { "_id": 3, "name": "lamp" }]);
    assert_eq!(
        code(store.aggregate(ns, (&[doc! { "$limit": 1 }, doc! { "$match": search("a") }]).into()).map(drop)),
        17_313
    );
    let request = update(search("lamp"), doc! { "$set": { "name": "light" } });
    assert_eq!(store.update(ns, &request, None).unwrap(), changed(1, 1));
    assert_eq!(store.delete(ns, (&search("lamp light")).into(), false).unwrap(), 1);
}

fn instant(millis: i64) -> bson::DateTime {
    bson::DateTime::from_millis(millis)
}

fn a_stamped_update_says_when(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1, "a": 1, "_robmem_info": { "inserted": instant(1), "persistent": false } }]);
    store.update(ns, &update(doc! { "_id": 1 }, doc! { "$inc": { "a": 1 } }), Some(instant(5))).unwrap();
    let info = doc! { "inserted": instant(1), "persistent": false, "updated": instant(5) };
    assert_eq!(all(store, ns)[0], doc! { "_id": 1, "a": 2, "_robmem_info": info });
    let request = UpdateRequest { upsert: true, ..update(doc! { "_id": 2 }, doc! { "$set": { "a": 1 } }) };
    store.update(ns, &request, Some(instant(6))).unwrap();
    let filter = doc! { "_robmem_info.inserted": instant(6), "_robmem_info.updated": instant(6) };
    assert_eq!(ids(store, ns, filter), [2]);
}

fn a_stamped_replacement_keeps_when_it_was_inserted(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1, "a": 1, "_robmem_info": { "inserted": instant(1) } }]);
    let request = update(doc! { "a": 1 }, doc! { "b": { "$x": "$y" } });
    assert_eq!(store.update(ns, &request, Some(instant(5))).unwrap(), changed(1, 1));
    let info = doc! { "inserted": instant(1), "updated": instant(5) };
    assert_eq!(all(store, ns)[0], doc! { "_id": 1, "b": { "$x": "$y" }, "_robmem_info": info });
}

fn a_stamped_update_that_changes_nothing_is_no_modification(store: &dyn Store, ns: &Namespace) {
    let info = doc! { "inserted": instant(1) };
    insert(store, ns, (1..=3).map(|n| doc! { "_id": n, "a": [n], "b": 1, "_robmem_info": info.clone() }));
    let updates = [
        doc! { "$set": { "b": 1 } },
        doc! { "$addToSet": { "a": 2 } },
        doc! { "$unset": { "c": "" } },
        doc! { "$pull": { "a": 9 } },
        doc! { "$rename": { "c": "d" } },
        doc! { "$setOnInsert": { "b": 2 } },
        doc! { "a": [2], "b": 1 },
    ];
    for change in updates {
        let request = update(doc! { "_id": 2 }, change.clone());
        assert_eq!(store.update(ns, &request, Some(instant(5))).unwrap(), changed(1, 0), "{change}");
    }
    let request = UpdateRequest {
        update: UpdateSpec::Pipeline(vec![doc! { "$set": { "b": 1 } }]),
        ..update(doc! { "_id": 2 }, doc! {})
    };
    assert_eq!(store.update(ns, &request, Some(instant(5))).unwrap(), changed(1, 0));
    assert_eq!(store.count(ns, (&doc! { "_robmem_info.updated": { "$exists": true } }).into()).unwrap(), 0);

    let request = UpdateRequest { many: true, ..update(doc! {}, doc! { "$addToSet": { "a": 2 } }) };
    assert_eq!(store.update(ns, &request, Some(instant(6))).unwrap(), changed(3, 2));
    assert_eq!(ids(store, ns, doc! { "_robmem_info.updated": instant(6) }), [1, 3]);
}

/// A field that was added later stands behind the metadata, which go last where a document is made anew.
fn a_stamped_update_that_only_moves_the_metadata_is_no_modification(store: &dyn Store, ns: &Namespace) {
    let document = doc! { "_id": 1, "_robmem_info": { "inserted": instant(1) }, "b": 1 };
    insert(store, ns, [document.clone()]);
    let made = doc! { "field": "_robmem_info", "input": { "_id": 1, "b": "$b" }, "value": "$_robmem_info" };
    let made = UpdateSpec::Pipeline(vec![doc! { "$replaceWith": { "$setField": made } }]);
    for same in [UpdateSpec::Document(doc! { "b": 1 }), made] {
        for many in [false, matches!(same, UpdateSpec::Pipeline(_))] {
            let (filter, update) = (doc! { "b": 1 }, same.clone());
            let request = UpdateRequest { filter, update, many, ..UpdateRequest::default() };
            assert_eq!(store.update(ns, &request, Some(instant(9))).unwrap(), changed(1, 0), "{same:?}");
        }
        let modification = Modification::Update { update: same, array_filters: Vec::new(), upsert: false };
        let request = FindAndModify { modification, projection: doc! {}, ..first(doc! {}) };
        assert_eq!(modified(store, ns, &request), (Some(document.clone()), true, false, None));
    }
    assert_eq!(all(store, ns), [document]);
}

fn a_stamped_update_compares_values_and_their_types(store: &dyn Store, ns: &Namespace) {
    let collation = Collation::parse(&doc! { "locale": "en", "strength": 1 });
    store.create(ns, collation.ok().as_ref()).unwrap();
    let now = bson::DateTime::now();
    let values = [
        Bson::Null,
        1_i32.into(),
        1_i64.into(),
        1.0.into(),
        0.0.into(),
        (-0.0).into(),
        f64::NAN.into(),
        "a".into(),
        "A".into(),
        "ab".into(),
        "".into(),
        "$a".into(),
        true.into(),
        now.into(),
        bson::oid::ObjectId::from_bytes([7; 12]).into(),
        bson::bson!([]),
        bson::bson!([1]),
        bson::bson!([1.0]),
        bson::bson!([1, 0.0]),
        bson::bson!([1, -0.0]),
        bson::bson!(["a"]),
        bson::bson!(["A"]),
        bson::bson!([[1]]),
        bson::bson!({}),
        bson::bson!({ "a": 1 }),
        bson::bson!({ "A": 1 }),
        bson::bson!({ "a": 1.0 }),
        bson::bson!({ "a": 1, "b": 2 }),
        bson::bson!({ "b": 2, "a": 1 }),
        bson::bson!({ "a": { "b": [1, "$x"] } }),
        bson::bson!([{ "a": 1 }, { "a": 2 }]),
    ];
    // Small documents are updated in another way on MongoDB.
    insert(store, ns, [doc! { "_id": 1, "pad": "x".repeat(2_000), "_robmem_info": { "inserted": instant(1) } }]);
    let (mut millis, mut last) = (1, String::new());
    let mut set = |filter: &Document, value: &Bson| {
        millis += 1;
        let change = update(filter.clone(), doc! { "$set": { "v": value.clone() } });
        let updated = store.update(ns, &change, Some(instant(millis))).unwrap();
        let stored = all(store, ns).remove(0);
        let date = stored.get_document("_robmem_info").unwrap().get_datetime("updated");
        let shown = format!("{value:?}");
        let expected = shown != last;
        assert_eq!(updated, changed(1, u64::from(expected)), "{last} becomes {shown}");
        assert_eq!(date.ok() == Some(&instant(millis)), expected, "{last} becomes {shown}: {stored}");
        assert_eq!(format!("{:?}", stored.get("v").unwrap()), shown);
        last = shown;
    };
    // So are those that are named by their `_id`.
    for filter in [doc! { "_id": 1 }, doc! { "pad": { "$exists": true } }] {
        for before in &values {
            for after in &values {
                set(&filter, before);
                set(&filter, after);
            }
        }
    }
    let missing = update(doc! { "_id": 2 }, doc! { "$set": { "v": 1 } });
    assert_eq!(store.update(ns, &missing, Some(instant(9))).unwrap(), changed(0, 0));
    // Fields that are new come in the order of their names, those that look like numbers in that of numbers.
    let fields = doc! { "b": 1, "a": "x", "c": 2.5, "10": 1, "9": 1 };
    for fields in [doc! { "b": 1, "a": "x", "c": 2.5 }, fields] {
        store.delete(ns, (&doc! {}).into(), false).unwrap();
        insert(store, ns, [doc! { "_id": 1 }]);
        store.update(ns, &update(doc! {}, doc! { "$set": fields.clone() }), Some(instant(9))).unwrap();
        let stored = all(store, ns).remove(0);
        let names: Vec<&str> = stored.keys().map(String::as_str).filter(|name| fields.contains_key(*name)).collect();
        let expected: &[&str] = if fields.len() == 3 { &["a", "b", "c"] } else { &["9", "10", "a", "b", "c"] };
        assert_eq!(names, expected, "{stored}");
    }
    let sure = doc! { "$push": { "l": 1 }, "$inc": { "n": 1 }, "$set": { "a": "x" } };
    assert_eq!(store.update(ns, &update(doc! { "a": "x" }, sure), Some(instant(12))).unwrap(), changed(1, 1));
    assert_eq!(ids(store, ns, doc! { "_robmem_info.updated": instant(12), "l": [1], "n": 1 }), [1]);
    assert_eq!(code(store.update(ns, &update(doc! {}, doc! { "$inc": { "a": 1 } }), Some(instant(13)))), 14);
}

fn what_the_memory_notes_cannot_be_changed(store: &dyn Store, ns: &Namespace) {
    let stored = doc! { "_id": 1, "a": 1, "_robmem_info": { "inserted": instant(1) } };
    insert(store, ns, [stored.clone()]);
    for change in [
        doc! { "$set": { "_robmem_info.inserted": 5 } },
        doc! { "$set": { "_robmem_info": {} } },
        doc! { "$set": { "_robmem_info.decay_time": "soon" } },
        doc! { "$unset": { "_robmem_info": 1 } },
        doc! { "$rename": { "a": "_robmem_info.inserted" } },
        doc! { "$rename": { "_robmem_info.inserted": "a" } },
        doc! { "$currentDate": { "_robmem_info.updated": true } },
        doc! { "_robmem_info": { "persistent": 3 } },
        doc! { "b": 1, "_robmem_info": { "computed": true } },
        doc! { "$set": { "_robmem_info.cached_until": instant(9) } },
        doc! { "$rename": { "a": "_robmem_info.computation" } },
        doc! { "$set": { "_robmem_info.lineage": 3 } },
    ] {
        assert!(store.update(ns, &update(doc! {}, change.clone()), Some(instant(5))).is_err(), "{change}");
    }
    for stage in [
        doc! { "$set": { "_robmem_info": 1 } },
        doc! { "$unset": "_robmem_info.inserted" },
        doc! { "$replaceWith": { "_id": 1, "_robmem_info": { "computed": true } } },
        doc! { "$project": { "a": 1, "_robmem_info.computation.token": "x" } },
    ] {
        let request = UpdateRequest { update: UpdateSpec::Pipeline(vec![stage.clone()]), ..update(doc! {}, doc! {}) };
        assert!(store.update(ns, &request, Some(instant(5))).is_err(), "{stage}");
    }
    assert_eq!(all(store, ns), [stored]);
    let request = update(doc! {}, doc! { "$set": { "_robmem_info.decay_time": instant(9) } });
    assert_eq!(store.update(ns, &request, Some(instant(5))).unwrap(), changed(1, 1));
}

fn a_pipeline_cannot_lose_when_a_document_was_inserted(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, (1..=2).map(|n| doc! { "_id": n, "_robmem_info": { "inserted": instant(i64::from(n)) } }));
    for (many, stage) in [
        (true, doc! { "$replaceWith": { "_id": "$_id", "z": 1 } }),
        (false, doc! { "$project": { "z": 2 } }),
        (true, doc! { "$replaceRoot": { "newRoot": { "_id": "$_id", "_robmem_info": { "inserted": instant(7) } } } }),
    ] {
        let update = UpdateSpec::Pipeline(vec![stage.clone()]);
        let request = UpdateRequest { update, many, ..self::update(doc! {}, doc! {}) };
        store.update(ns, &request, Some(instant(5))).unwrap();
        for n in 1..=2 {
            assert_eq!(ids(store, ns, doc! { "_robmem_info.inserted": instant(n) }), [n as i32], "{stage}");
        }
    }
}

/// The first by `n`, changed in this way.
fn first(update: Document) -> FindAndModify {
    let update = UpdateSpec::Document(update);
    FindAndModify {
        filter: doc! {},
        sort: doc! { "n": 1 },
        modification: Modification::Update { update, array_filters: Vec::new(), upsert: false },
        new: true,
        projection: doc! { "_robmem_info": 0 },
        modifiers: Modifiers::default(),
    }
}

/// What is found and modified, with the document decoded.
fn modified(
    store: &dyn Store,
    ns: &Namespace,
    request: &FindAndModify,
) -> (Option<Document>, bool, bool, Option<Bson>) {
    let Modified { document, is_found, is_changed, upserted } =
        store.find_and_modify(ns, request, Some(instant(9))).unwrap();
    (document.map(|raw| Document::try_from(&*raw).unwrap()), is_found, is_changed, upserted)
}

fn the_first_match_is_changed_and_returned(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1, "n": 2, "l": [1, 2] }, doc! { "_id": 2, "n": 1, "l": [3] }]);
    let done = |request: &FindAndModify| modified(store, ns, request);
    let found = |document: Document, is_changed| (Some(document), true, is_changed, None);
    // By one request: what surely changes, and what the server compares.
    assert_eq!(done(&first(doc! { "$inc": { "n": 4 } })), found(doc! { "_id": 2, "n": 5, "l": [3] }, true));
    let before = FindAndModify { new: false, projection: doc! { "n": 1 }, ..first(doc! { "$set": { "n": 3 } }) };
    assert_eq!(done(&before), found(doc! { "_id": 1, "n": 2 }, true));
    assert_eq!(done(&first(doc! { "$set": { "n": 3 } })), found(doc! { "_id": 1, "n": 3, "l": [1, 2] }, false));
    // The type of a value counts.
    assert_eq!(done(&first(doc! { "$set": { "n": 3.0 } })), found(doc! { "_id": 1, "n": 3.0, "l": [1, 2] }, true));
    // What depends on the document.
    let positional =
        FindAndModify { filter: doc! { "l": 2 }, ..first(doc! { "$set": { "l.$": 8 }, "$unset": { "x": "" } }) };
    assert_eq!(done(&positional), found(doc! { "_id": 1, "n": 3.0, "l": [1, 8] }, true));
    let removing = first(doc! { "$pull": { "l": 4 } });
    assert_eq!(done(&removing), found(doc! { "_id": 1, "n": 3.0, "l": [1, 8] }, false));
    let replaced = FindAndModify { projection: doc! { "n": 1, "_id": 0 }, ..first(doc! { "n": 4 }) };
    assert_eq!(done(&replaced), found(doc! { "n": 4 }, true));
    let collation = Some(Collation::parse(&doc! { "locale": "en", "strength": 1 }).unwrap());
    let folded = FindAndModify {
        filter: doc! { "s": { "$ne": "x" } },
        modifiers: Modifiers { collation, ..Modifiers::default() },
        ..first(doc! { "$addToSet": { "l": 3 }, "$unset": { "n": 1 } })
    };
    assert_eq!(done(&folded), found(doc! { "_id": 1, "l": [3] }, true));
    // What is shown compares as the query does, and `$rand` chooses once.
    let list = bson::bson!([{ "k": "A" }, { "k": "b" }]);
    for new in [false, true] {
        let shown = FindAndModify {
            projection: doc! { "l": { "$elemMatch": { "k": "B" } }, "t": { "$eq": ["$$v", "$$v"] } },
            modifiers: Modifiers { variables: doc! { "v": 1 }, ..folded.modifiers.clone() },
            new,
            ..first(doc! { "$set": { "l": list.clone(), "q.r": new } })
        };
        let wanted = if new {
            doc! { "_id": 1, "l": [{ "k": "b" }], "t": true }
        } else {
            doc! { "_id": 1, "t": true }
        };
        assert_eq!(done(&shown), found(wanted, true));
    }
    let half = doc! { "$expr": { "$lt": [{ "$rand": {} }, 0.5] } };
    for n in 0..20 {
        let request = FindAndModify { filter: half.clone(), ..first(doc! { "$set": { "q.r": n, "l": [3] } }) };
        let (document, is_found, is_changed, _) = done(&request);
        let changed = document.is_some_and(|document| document.get_document("q").unwrap().get_i32("r").unwrap() == n);
        assert_eq!((changed, is_changed), (is_found, is_found));
    }
    store.update(ns, &update(doc! {}, doc! { "$set": { "l": [3] }, "$unset": { "q": "" } }), None).unwrap();
    let remove = FindAndModify { new: false, modification: Modification::Remove, ..first(doc! {}) };
    assert_eq!(done(&remove), found(doc! { "_id": 1, "l": [3] }, true));
    let shown = |new| FindAndModify {
        filter: doc! { "l": 8 },
        projection: doc! { "l.$": 1 },
        new,
        ..first(doc! { "$set": { "l": [8, 9] } })
    };
    assert_eq!(code(store.find_and_modify(ns, &shown(true), Some(instant(9)))), 2);
    // Where nothing matches, a wrong update is still refused.
    let none = FindAndModify { filter: doc! { "n": 99 }, ..first(doc! { "$inc": { "n": 1 } }) };
    assert_eq!(done(&none), (None, false, false, None));
    let wrong = FindAndModify { filter: doc! { "n": 99 }, ..first(doc! { "$nothing": { "n": 1 } }) };
    assert_eq!(code(store.find_and_modify(ns, &wrong, Some(instant(9)))), 9);
    let update = UpdateSpec::Document(doc! { "$inc": { "m": 1 } });
    let upsert = Modification::Update { update, array_filters: Vec::new(), upsert: true };
    let upsert = FindAndModify { filter: doc! { "_id": 7 }, modification: upsert, ..first(doc! {}) };
    assert_eq!(done(&upsert), (Some(doc! { "_id": 7, "m": 1 }), false, true, Some(7.into())));
    let again = FindAndModify { new: false, ..upsert };
    assert_eq!(done(&again), found(doc! { "_id": 7, "m": 1 }, true));
    assert_eq!(store.count(ns, (&doc! { "_id": 7, "m": 2 }).into()).unwrap(), 1);
}

fn what_is_found_by_chance_is_what_is_changed(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, (1..=6).map(|id| doc! { "_id": id, "l": [id, 0] }).collect::<Vec<_>>());
    let half = doc! { "$expr": { "$lt": [{ "$rand": {} }, 0.5] } };
    let by_chance = |n: i32| FindAndModify {
        filter: half.clone(),
        sort: doc! {},
        projection: doc! { "_robmem_info": 0, "l": { "$slice": 1 } },
        ..first(doc! { "$set": { "q.r": n } })
    };
    for n in 1..=20 {
        let request = FindAndModify { new: n % 2 == 0, ..by_chance(n) };
        let (document, is_found, is_changed, _) = modified(store, ns, &request);
        assert_eq!((document.is_some(), is_changed), (is_found, is_found));
        if let Some(document) = document {
            assert_eq!(ids(store, ns, doc! { "q.r": n }), [document.get_i32("_id").unwrap()]);
        }
    }
    for _ in 0..10 {
        let before = ids(store, ns, doc! {});
        let request = FindAndModify { new: false, modification: Modification::Remove, ..by_chance(0) };
        let gone = modified(store, ns, &request).0.map(|document| document.get_i32("_id").unwrap());
        let wanted: Vec<i32> = before.into_iter().filter(|id| Some(*id) != gone).collect();
        assert_eq!(ids(store, ns, doc! {}), wanted);
    }
}

fn documents_with_any_id_are_found_and_changed(store: &dyn Store, ns: &Namespace) {
    let long = "/".repeat(17_000);
    for id in ["a\0b", "", "^a.$", long.as_str()] {
        insert(store, ns, [doc! { "_id": id }]);
        let inc = FindAndModify { filter: doc! { "_id": id }, ..first(doc! { "$inc": { "n": 1 } }) };
        assert_eq!(modified(store, ns, &inc).0, Some(doc! { "_id": id, "n": 1 }));
        let remove = FindAndModify { new: false, modification: Modification::Remove, ..inc };
        assert!(modified(store, ns, &remove).1);
        assert_eq!(store.count(ns, (&doc! {}).into()).unwrap(), 0);
    }
}

fn a_document_is_found_by_its_place_whatever_its_fields_are_called(store: &dyn Store, ns: &Namespace) {
    for place in [Bson::Int64(2), Bson::Int64(77), "x".into()] {
        insert(store, ns, [doc! { "_id": 1, "n": 1, "$recordId": place }, doc! { "_id": 2, "n": 2 }]);
        let request = FindAndModify { projection: doc! { "_id": 1 }, ..first(doc! { "$set": { "m": 1 } }) };
        assert_eq!(modified(store, ns, &request).0, Some(doc! { "_id": 1 }));
        assert_eq!(ids(store, ns, doc! { "m": 1 }), [1]);
        store.delete(ns, (&doc! {}).into(), false).unwrap();
    }
}

fn ids_that_a_collation_takes_for_equal_are_changed_once(store: &dyn Store, ns: &Namespace) {
    let Ok(collation) = Collation::parse(&doc! { "locale": "en", "strength": 2 }) else {
        return; // This build has no collations.
    };
    insert(store, ns, [doc! { "_id": "A", "n": 0 }, doc! { "_id": "a", "n": 0 }, doc! { "_id": 1, "n": 0 }]);
    let modifiers = Modifiers { collation: Some(collation), ..Modifiers::default() };
    let next = doc! { "$replaceWith": { "_id": "$_id", "n": { "$add": ["$n", 1] } } };
    let updates = [
        UpdateSpec::Document(doc! { "$inc": { "n": 1 } }),
        UpdateSpec::Document(doc! { "$inc": { "n": 1 }, "$unset": { "x.y": 1 } }),
        UpdateSpec::Pipeline(vec![next]),
    ];
    for (n, spec) in (1..).zip(updates) {
        let all = UpdateRequest { update: spec, many: true, modifiers: modifiers.clone(), ..update(doc! {}, doc! {}) };
        assert_eq!(store.update(ns, &all, Some(instant(n))).unwrap(), changed(3, 3));
        let dated = doc! { "n": n, "_robmem_info.updated": instant(n) };
        assert_eq!(store.count(ns, (&dated).into()).unwrap(), 3, "{n}");
    }
    let one = FindAndModify {
        filter: doc! { "_id": "a" },
        sort: doc! { "_id": 1 },
        modifiers,
        ..first(doc! { "$addToSet": { "l": 1 } })
    };
    assert!(modified(store, ns, &one).2);
    assert_eq!(store.count(ns, (&doc! { "l": 1 }).into()).unwrap(), 1);
}

fn an_update_that_fails_has_changed_the_documents_before(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 4, "n": 1 }, doc! { "_id": 3, "n": "x" }, doc! { "_id": 1, "n": 1 }]);
    let all = UpdateRequest { many: true, ..update(doc! {}, doc! { "$inc": { "n": 1 } }) };
    assert!(store.update(ns, &all, Some(instant(5))).is_err());
    assert_eq!(ids(store, ns, doc! { "n": 2 }), [4]);
}

fn a_change_by_chance_is_dated_where_it_changes(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1, "x": 0 }]);
    let add = doc! { "$cond": [{ "$lt": [{ "$rand": {} }, 0.5] }, { "$add": ["$x", 1] }, "$x"] };
    let update = UpdateSpec::Pipeline(vec![doc! { "$set": { "x": add } }]);
    let mut x = 0;
    for n in 1..=30 {
        let is_changed = if n % 2 == 0 {
            let request =
                UpdateRequest { filter: doc! { "_id": 1 }, update: update.clone(), ..UpdateRequest::default() };
            store.update(ns, &request, Some(instant(n))).unwrap().modified == 1
        } else {
            let modification =
                Modification::Update { update: update.clone(), array_filters: Vec::new(), upsert: false };
            let request = FindAndModify { modification, ..first(doc! {}) };
            store.find_and_modify(ns, &request, Some(instant(n))).unwrap().is_changed
        };
        x += i32::from(is_changed);
        assert_eq!(ids(store, ns, doc! { "x": x }), [1]);
        assert_eq!(!ids(store, ns, doc! { "_robmem_info.updated": instant(n) }).is_empty(), is_changed);
    }
}

fn a_change_compares_as_the_collection_does(store: &dyn Store, ns: &Namespace) {
    let Ok(collation) = Collation::parse(&doc! { "locale": "en", "strength": 2 }) else {
        return; // This build has no collations.
    };
    assert!(store.create(ns, Some(&collation)).unwrap());
    let (pull, add) = (doc! { "$pull": { "l": "A" } }, doc! { "$addToSet": { "l": "B" } });
    for id in [1, 2] {
        insert(store, ns, [doc! { "_id": id, "l": ["a", "b"] }]);
        let is_changed = |change: &Document| match id {
            1 => modified(store, ns, &FindAndModify { filter: doc! { "_id": id }, ..first(change.clone()) }).2,
            _ => store.update(ns, &update(doc! { "_id": id }, change.clone()), Some(instant(9))).unwrap().modified == 1,
        };
        assert!(!is_changed(&add));
        assert!(ids(store, ns, doc! { "_id": id, "_robmem_info.updated": instant(9) }).is_empty());
        assert!(is_changed(&pull));
        assert_eq!(ids(store, ns, doc! { "_id": id, "_robmem_info.updated": instant(9), "l": ["b"] }), [id]);
    }
}

fn the_score_of_what_is_changed_is_shown(store: &dyn Store, ns: &Namespace) {
    store.create_index(ns, &Index::on(doc! { "t": "text" })).unwrap();
    let shown = |new, upsert, words: &str, change: Document| FindAndModify {
        filter: doc! { "$text": { "$search": words } },
        new,
        modification: Modification::Update { update: UpdateSpec::Document(change), array_filters: Vec::new(), upsert },
        sort: doc! {},
        projection: doc! { "_id": 1, "s": { "$meta": "textScore" } },
        ..first(doc! {})
    };
    for new in [false, true] {
        insert(store, ns, [doc! { "_id": 1, "t": "cup" }]);
        let change = doc! { "$set": { "n.m": 1, "t": "plum" } };
        let document = modified(store, ns, &shown(new, false, "cup", change)).0.unwrap();
        assert!(document.get_f64("s").unwrap() > 1.0, "{document}");
        assert_eq!(store.delete(ns, (&doc! { "t": "plum" }).into(), false).unwrap(), 1);
    }
    // Also where the query says which element is meant.
    insert(store, ns, [doc! { "_id": 1, "t": "cup", "l": [{ "k": 1 }] }]);
    let positional = shown(true, false, "cup", doc! { "$inc": { "l.$.k": 5 } });
    let filter = doc! { "$text": { "$search": "cup" }, "l.k": { "$gt": 0 } };
    let document = modified(store, ns, &FindAndModify { filter, ..positional }).0.unwrap();
    assert!(document.get_f64("s").unwrap() > 1.0, "{document}");
    assert_eq!(ids(store, ns, doc! { "l.k": 6, "_robmem_info.updated": instant(9) }), [1]);
    let upsert = shown(true, true, "pear", doc! { "$set": { "_id": 7 } });
    assert_eq!(modified(store, ns, &upsert).0, Some(doc! { "_id": 7 }));
}

fn a_document_takes_what_a_command_has_room_for(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1 }]);
    for (n, id) in [("a", doc! { "_id": 1 }), ("b", doc! { "_id": { "$lt": 2 } })] {
        let large = update(id.clone(), doc! { "$set": { "x": n.repeat(9 << 20) } });
        assert_eq!(store.update(ns, &large, Some(instant(5))).unwrap(), changed(1, 1));
        assert_eq!(store.update(ns, &large, Some(instant(6))).unwrap(), changed(1, 0));
        let request = FindAndModify {
            filter: id,
            projection: doc! { "_id": 1 },
            ..first(doc! { "$set": { "x": n.repeat(8 << 20) } })
        };
        assert_eq!(modified(store, ns, &request), (Some(doc! { "_id": 1 }), true, true, None));
    }
}

fn the_metadata_that_is_returned_is_that_of_the_change(store: &dyn Store, ns: &Namespace) {
    let old = doc! { "inserted": instant(1), "updated": instant(2) };
    let shown = |request: FindAndModify| {
        let request = FindAndModify { projection: doc! { "_robmem_info": 1, "_id": 0 }, ..request };
        let document = modified(store, ns, &request).0.unwrap();
        document.get_document("_robmem_info").unwrap().clone()
    };
    let new = doc! { "inserted": instant(1), "updated": instant(9) };
    let updates = [
        doc! { "$inc": { "n": 4 } },
        doc! { "$set": { "n": 3 } },
        doc! { "$set": { "l.0": 3 } },
        doc! { "$mul": { "n": 2 } },
        doc! { "n": 7 },
    ];
    for update in updates {
        store.delete(ns, (&doc! {}).into(), false).unwrap();
        insert(store, ns, [doc! { "_id": 1, "n": 2, "l": [1], "_robmem_info": old.clone() }]);
        let is_new = |new| FindAndModify { new, ..first(update.clone()) };
        assert_eq!(shown(is_new(false)), old, "{update}");
        store.delete(ns, (&doc! {}).into(), false).unwrap();
        insert(store, ns, [doc! { "_id": 1, "n": 2, "l": [1], "_robmem_info": old.clone() }]);
        assert_eq!(shown(is_new(true)), new, "{update}");
    }
    for same in [doc! { "$set": { "n": 7 } }, doc! { "$mul": { "n": 1 } }, doc! { "$unset": { "x": "" } }] {
        store.delete(ns, (&doc! {}).into(), false).unwrap();
        insert(store, ns, [doc! { "_id": 1, "n": 7, "_robmem_info": old.clone() }]);
        assert_eq!(shown(first(same.clone())), old, "{same}");
    }
    let update = UpdateSpec::Document(doc! { "$inc": { "m": 1 } });
    let upsert = Modification::Update { update, array_filters: Vec::new(), upsert: true };
    let upsert = FindAndModify { filter: doc! { "_id": 7 }, modification: upsert, ..first(doc! {}) };
    assert_eq!(shown(upsert), doc! { "inserted": instant(9), "updated": instant(9) });
}

fn putting_replaces_by_id(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 2, "old": true }, doc! { "_id": 4, "old": true }]);
    let documents = (1..=5).map(|n| doc! { "_id": n, "n": n }).chain([doc! { "none": 1 }]).collect();
    let put = store.put(ns, documents, None).unwrap();
    assert_eq!((put.inserted, put.replaced, put.same), (4, 2, 0));
    assert_eq!(store.count(ns, (&doc! { "old": true }).into()).unwrap(), 0);
    assert_eq!(store.count(ns, (&doc! {}).into()).unwrap(), 6);
    let put = store.put(ns, vec![doc! { "n": 4, "_id": 4 }, doc! { "_id": 5, "n": 0 }], None).unwrap();
    assert_eq!((put.inserted, put.replaced, put.same), (0, 1, 1));
}

fn deleting_the_first_leaves_the_others(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, (1..=3).map(|n| doc! { "_id": n, "a": 1 }));
    assert_eq!(store.delete(ns, (&doc! { "a": 1 }).into(), true).unwrap(), 1);
    assert_eq!(ids(store, ns, doc! {}), [2, 3]);
    assert_eq!(store.delete(ns, (&doc! { "a": 2 }).into(), true).unwrap(), 0);
}

fn deleting_all_counts_them(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, (0..1_500).map(|n| doc! { "_id": n, "even": n % 2 == 0 }));
    assert_eq!(store.delete(ns, (&doc! { "even": true }).into(), false).unwrap(), 750);
    assert_eq!(store.delete(ns, (&doc! {}).into(), false).unwrap(), 750);
    assert_eq!(all(store, ns), []);
}

fn dropping_says_whether_there_was_one(store: &dyn Store, ns: &Namespace) {
    assert!(!store.drop(ns).unwrap());
    insert(store, ns, [doc! { "_id": 1 }]);
    assert!(store.drop(ns).unwrap());
    assert_eq!(all(store, ns), []);
    insert(store, ns, [doc! { "_id": 1 }]);
    assert_eq!(ids(store, ns, doc! {}), [1]);
}

fn a_renamed_collection_takes_the_place_of_another(store: &dyn Store, ns: &Namespace) {
    let other = Namespace { database: ns.database.clone(), collection: format!("{}.staged", ns.collection) };
    insert(store, ns, [doc! { "_id": 1 }, doc! { "_id": 2 }]);
    insert(store, &other, [doc! { "_id": 9 }, doc! { "_id": 2, "new": true }]);
    store.rename(&other, ns, true).unwrap();
    assert_eq!(all(store, ns), [doc! { "_id": 9 }, doc! { "_id": 2, "new": true }]);
    assert_eq!(store.count(&other, (&doc! {}).into()).unwrap(), 0);
    assert!(!store.collections().unwrap().contains(&other));
    insert(store, ns, [doc! { "_id": 3 }]);
    store.rename(ns, &other, true).unwrap();
    assert_eq!(ids(store, &other, doc! {}), [9, 2, 3]);
    assert_eq!(all(store, ns), []);
}

fn a_rename_replaces_another_collection_only_where_that_is_asked_for(store: &dyn Store, ns: &Namespace) {
    let other = Namespace { database: ns.database.clone(), collection: format!("{}.other", ns.collection) };
    insert(store, ns, [doc! { "_id": 1 }]);
    insert(store, &other, [doc! { "_id": 2 }]);
    assert_eq!(code(store.rename(&other, ns, false)), 48);
    assert_eq!((ids(store, ns, doc! {}), ids(store, &other, doc! {})), (vec![1], vec![2]));
    store.drop(ns).unwrap();
    store.rename(&other, ns, false).unwrap();
    assert_eq!(ids(store, ns, doc! {}), [2]);
}

fn renaming_what_is_not_there_changes_nothing(store: &dyn Store, ns: &Namespace) {
    let other = Namespace { database: ns.database.clone(), collection: format!("{}.none", ns.collection) };
    insert(store, ns, [doc! { "_id": 1 }]);
    assert!(store.rename(&other, ns, true).is_err());
    assert_eq!(ids(store, ns, doc! {}), [1]);
}

fn collections_are_listed_in_order(store: &dyn Store, ns: &Namespace) {
    let own = |name: &str| Namespace { database: "listing".to_owned(), collection: format!("{}{name}", ns.collection) };
    for name in ["b", "a.c", "a"] {
        insert(store, &own(name), [doc! {}]);
    }
    let mut listed = store.collections().unwrap();
    assert!(listed.is_sorted());
    listed.retain(|ns| ns.database == "listing");
    assert_eq!(listed, [own("a"), own("a.c"), own("b")]);
}

fn documents_may_be_read_while_others_are_written(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, (0..40).map(|n| doc! { "_id": n }));
    for document in store.find(ns, &Find::default()).unwrap() {
        let id = document.unwrap().get_i32("_id").unwrap();
        store.update(ns, &update(doc! { "_id": id }, doc! { "$set": { "seen": true } }), None).unwrap();
        insert(store, ns, [doc! { "_id": 1_000 + id }]);
    }
    assert_eq!(store.count(ns, (&doc! { "seen": true }).into()).unwrap(), 40);
    assert_eq!(store.count(ns, (&doc! {}).into()).unwrap(), 80);
}

fn values_of_every_type_come_back(store: &dyn Store, ns: &Namespace) {
    let values = doc! {
        "_id": 1,
        "int32": 3,
        "int64": 3_i64,
        "double": 3.0,
        "decimal": "1.50".parse::<bson::Decimal128>().unwrap(),
        "string": "ü \u{0} x",
        "true": true,
        "null": Bson::Null,
        "date": instant(-5),
        "id": bson::oid::ObjectId::from_bytes([7; 12]),
        "binary": bson::Binary { subtype: bson::spec::BinarySubtype::Generic, bytes: vec![0, 1] },
        "regex": bson::Regex { pattern: "a.b".try_into().unwrap(), options: "i".try_into().unwrap() },
        "timestamp": bson::Timestamp { time: 5, increment: 6 },
        "symbol": Bson::Symbol("s".to_owned()),
        "code": Bson::JavaScriptCode("f()".to_owned()),
        "min": Bson::MinKey,
        "max": Bson::MaxKey,
        "nested": { "array": [1, [2, { "x": 3 }]], "empty": {} },
    };
    insert(store, ns, [values.clone()]);
    assert_eq!(all(store, ns), [values]);
}

fn duplicate(error: StoreError) -> String {
    match error {
        StoreError::Duplicate { key, .. } => key.to_string(),
        other => panic!("{other}"),
    }
}

fn an_index_is_listed_until_it_is_dropped(store: &dyn Store, ns: &Namespace) {
    assert_eq!(store.indexes(ns).unwrap(), []);
    let wanted = Index { expire_after: Some(60), ..Index::on(doc! { "at": -1 }) };
    assert!(store.create_index(ns, &wanted).unwrap());
    assert!(!store.create_index(ns, &wanted).unwrap(), "it is there already");
    assert_eq!(store.indexes(ns).unwrap(), [Index::of_ids(), wanted]);
    assert!(store.drop_index(ns, "at_-1").unwrap());
    assert!(!store.drop_index(ns, "at_-1").unwrap());
    assert_eq!(store.indexes(ns).unwrap(), [Index::of_ids()]);
    assert!(store.drop_index(ns, "_id_").is_err());
}

fn an_index_is_changed_in_its_place(store: &dyn Store, ns: &Namespace) {
    let wanted = Index { expire_after: Some(60), ..Index::on(doc! { "at": -1 }) };
    store.create_index(ns, &wanted).unwrap();
    let change = IndexChange { hidden: Some(true), expire_after: Some(90) };
    assert!(store.modify_index(ns, "at_-1", change).unwrap());
    assert_eq!(store.indexes(ns).unwrap(), [Index::of_ids(), wanted.clone().changed(change)]);
    let change = IndexChange { hidden: Some(false), expire_after: None };
    assert!(store.modify_index(ns, "at_-1", change).unwrap());
    assert_eq!(store.indexes(ns).unwrap()[1], Index { expire_after: Some(90), ..wanted });
    assert!(!store.modify_index(ns, "other", change).unwrap());
    for change in [change, IndexChange { hidden: None, expire_after: Some(1) }] {
        assert!(store.modify_index(ns, "_id_", change).is_err(), "{change:?}");
    }
}

fn an_index_with_other_options_is_a_conflict(store: &dyn Store, ns: &Namespace) {
    let code = |index: Index| match store.create_index(ns, &index) {
        Err(StoreError::Query(error)) => error.code,
        other => panic!("{other:?}"),
    };
    let plain = Index::on(doc! { "a": 1 });
    store.create_index(ns, &plain).unwrap();
    assert_eq!(code(Index { unique: true, ..plain.clone() }), 86);
    assert_eq!(code(Index { name: "other".to_owned(), ..plain.clone() }), 85);
    assert_eq!(code(Index { name: "a_1".to_owned(), ..Index::on(doc! { "b": 1 }) }), 86);
    assert_eq!(code(Index { name: "x".to_owned(), expire_after: Some(1), ..plain.clone() }), 85);
    let unique = Index { name: "unique".to_owned(), unique: true, ..plain };
    assert!(store.create_index(ns, &unique).unwrap(), "unique or not is another index");
    assert!(store.create_index(ns, &Index::on(doc! { "a": 0 })).is_err());
    assert!(store.create_index(ns, &Index::on(doc! {})).is_err());
}

fn a_unique_index_refuses_a_taken_key_by_its_name(store: &dyn Store, ns: &Namespace) {
    store.create_index(ns, &Index { unique: true, ..Index::on(doc! { "name": 1 }) }).unwrap();
    insert(store, ns, [doc! { "_id": 1, "name": "a" }, doc! { "_id": 2, "name": ["b", "c"] }]);
    let taken = |documents| duplicate(store.insert(ns, documents).unwrap_err());
    assert_eq!(taken(vec![doc! { "_id": 3, "name": "a" }]), "name: \"a\" (unique index name_1)");
    assert_eq!(taken(vec![doc! { "_id": 3, "name": ["d", "c"] }]), "name: \"c\" (unique index name_1)");
    let stopped = store.insert(ns, vec![doc! { "_id": 4 }, doc! { "_id": 5, "name": Bson::Null }, doc! { "_id": 6 }]);
    assert_eq!(stopped.unwrap_err().stored(), [Bson::Int32(4)], "missing is null");
    let rename = update(doc! { "_id": 1 }, doc! { "$set": { "name": "b" } });
    assert_eq!(duplicate(store.update(ns, &rename, None).unwrap_err()), "name: \"b\" (unique index name_1)");
    let same = update(doc! { "_id": 1 }, doc! { "$set": { "name": "a", "n": 1 } });
    assert_eq!(store.update(ns, &same, None).unwrap().modified, 1, "its own key is no conflict");
    store.delete(ns, (&doc! { "_id": 2 }).into(), false).unwrap();
    assert_eq!(store.update(ns, &rename, None).unwrap().modified, 1, "a deleted document's keys are free");
    assert_eq!(ids(store, ns, doc! {}), [1, 4]);
}

fn a_unique_index_is_not_made_over_duplicates(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1, "a": 1 }, doc! { "_id": 2, "a": 1 }]);
    let unique = Index { unique: true, ..Index::on(doc! { "a": 1 }) };
    assert_eq!(duplicate(store.create_index(ns, &unique).unwrap_err()), "a: 1 (unique index a_1)");
    assert_eq!(store.indexes(ns).unwrap(), [Index::of_ids()]);
    insert(store, ns, [doc! { "_id": 3, "a": 1 }]);
}

fn a_sparse_unique_index_lets_documents_lack_the_field(store: &dyn Store, ns: &Namespace) {
    let index = Index { unique: true, sparse: true, ..Index::on(doc! { "a.b": 1, "c": 1 }) };
    store.create_index(ns, &index).unwrap();
    insert(store, ns, [doc! { "_id": 1 }, doc! { "_id": 2 }, doc! { "_id": 3, "c": 1 }]);
    assert!(duplicate(store.insert(ns, vec![doc! { "_id": 4, "c": 1 }]).unwrap_err()).contains("c: 1"));
    let arrays = doc! { "_id": 5, "a": [{ "b": 1 }], "c": [1] };
    assert!(matches!(store.insert(ns, vec![arrays]), Err(StoreError::Query(error)) if error.code == 171));
    assert_eq!(ids(store, ns, doc! {}), [1, 2, 3]);
}

fn indexes_move_with_their_collection_and_stay_below_results(store: &dyn Store, ns: &Namespace) {
    let other = Namespace { collection: format!("{}_other", ns.collection), ..ns.clone() };
    let unique = Index { unique: true, ..Index::on(doc! { "a": 1 }) };
    store.create_index(ns, &unique).unwrap();
    insert(store, ns, [doc! { "_id": 1, "a": 1 }]);
    insert(store, &other, [doc! { "_id": 7, "a": 1 }, doc! { "_id": 8, "a": 2 }]);
    let out = |filter: Document| [doc! { "$match": filter }, doc! { "$out": &ns.collection }];
    store.aggregate(&other, (&out(doc! {})).into()).unwrap().for_each(drop);
    assert_eq!(store.indexes(ns).unwrap().len(), 2);
    assert!(store.insert(ns, vec![doc! { "a": 2 }]).is_err());
    store.rename(ns, &other, true).unwrap();
    assert_eq!((store.indexes(ns).unwrap().len(), store.indexes(&other).unwrap().len()), (0, 2));
    assert!(store.insert(&other, vec![doc! { "a": 2 }]).is_err());
    store.drop(&other).unwrap();
    insert(store, &other, [doc! { "a": 2 }, doc! { "a": 2 }]);
}

fn an_explanation_names_the_index_and_counts_what_was_looked_at(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, (0..50).map(|n| doc! { "_id": n, "n": n, "tags": [n % 5, n % 7] }));
    store.create_index(ns, &Index::on(doc! { "n": 1 })).unwrap();
    store.create_index(ns, &Index::on(doc! { "tags": 1 })).unwrap();
    let number = |explanation: &Document, name: &str| match explanation.get(name) {
        Some(Bson::Int32(number)) => i64::from(*number),
        Some(Bson::Int64(number)) => *number,
        other => panic!("{other:?} in {explanation}"),
    };
    let explanation = |filter, sort| store.explain(ns, &Find { filter, sort, ..Find::default() }).unwrap();
    for (filter, sort, index, documents, returned) in [
        (doc! { "n": { "$gte": 10, "$lt": 20 } }, doc! {}, Some("n_1"), 10, 10),
        (doc! { "n": { "$gte": 10, "$lt": 20 }, "tags": 9 }, doc! {}, None, 0, 0),
        (doc! { "tags": 6 }, doc! {}, Some("tags_1"), 7, 7),
        (doc! { "_id": 3 }, doc! {}, Some("_id_"), 1, 1),
        (doc! { "other": 3 }, doc! {}, None, 50, 0),
        (doc! {}, doc! { "n": -1 }, Some("n_1"), 50, 50),
    ] {
        let explanation = explanation(filter, sort.clone());
        if index.is_some() {
            assert_eq!(explanation.get_str("index").ok(), index, "{explanation}");
        }
        assert_eq!(number(&explanation, "documents_examined"), documents, "{explanation}");
        assert_eq!(number(&explanation, "returned"), returned, "{explanation}");
        assert_eq!(explanation.get_str("sort").ok(), (!sort.is_empty()).then_some("index"), "{explanation}");
    }
    let sorted = explanation(doc! {}, doc! { "other": 1 });
    assert_eq!(sorted.get_str("sort").unwrap(), "memory", "{sorted}");
    let either = explanation(doc! { "$or": [{ "n": 3 }, { "tags": 6 }] }, doc! {});
    assert_eq!(either.get_array("any").map(Vec::len).unwrap_or_default(), 2, "{either}");
}

fn what_is_near_comes_the_nearest_first(store: &dyn Store, ns: &Namespace) {
    store.create_index(ns, &Index::on(doc! { "at": "2dsphere" })).unwrap();
    store.create_index(ns, &Index::on(doc! { "xy": "2d" })).unwrap();
    let point = |x: f64, y: f64| doc! { "type": "Point", "coordinates": [x, y] };
    let line = doc! { "type": "LineString", "coordinates": [[0, 3], [3, 3]] };
    insert(
        store,
        ns,
        [
            doc! { "_id": 1, "at": point(2.0, 0.0), "xy": [5, 0], "n": 1 },
            doc! { "_id": 2, "at": point(1.0, 0.0), "xy": [0, 1], "n": 2 },
            doc! { "_id": 3, "at": line, "xy": [[40, 40], [2, 2]], "n": 3 },
            doc! { "_id": 4, "n": 4 },
        ],
    );
    let near = doc! { "at": { "$near": { "$geometry": point(0.0, 0.0), "$maxDistance": 300_000 } } };
    assert_eq!(ids(store, ns, near.clone()), [2, 1]);
    assert_eq!(ids(store, ns, doc! { "$and": [{ "n": { "$ne": 2 } }, near.clone()] }), [1]);
    assert_eq!(ids(store, ns, doc! { "xy": { "$near": [0, 0] } }), [2, 3, 1]);
    assert_eq!(ids(store, ns, doc! { "xy": { "$near": [0, 0], "$minDistance": 1.5, "$maxDistance": 5 } }), [3, 1]);
    assert_eq!(ids(store, ns, doc! { "at": { "$nearSphere": [0, 0], "$maxDistance": 0.02 } }), [2]);
    let sorted = Find { filter: near.clone(), sort: doc! { "n": 1 }, ..Find::default() };
    assert_eq!(found(store, ns, &sorted)[0].get_i32("_id").unwrap(), 1);
    let nearest = Find { filter: near.clone(), limit: 1, ..Find::default() };
    assert_eq!(found(store, ns, &nearest)[0].get_i32("_id").unwrap(), 2);
    store.update(ns, &update(near, doc! { "$set": { "taken": true } }), None).unwrap();
    assert_eq!(ids(store, ns, doc! { "taken": true }), [2]);
}

fn what_is_near_needs_an_index(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1, "at": [1, 1] }]);
    let refused = |query: Document| {
        let find = Find { filter: doc! { "at": query }, ..Find::default() };
        let found = store.find(ns, &find).and_then(|found| found.collect::<Result<Vec<_>, _>>());
        found.unwrap_err().to_string()
    };
    let geojson = doc! { "$near": { "$geometry": { "type": "Point", "coordinates": [0, 0] } } };
    for query in [doc! { "$near": [0, 0] }, doc! { "$nearSphere": [0, 0] }, geojson.clone()] {
        let message = refused(query);
        assert!(message.contains("unable to find") && message.contains("index"), "{message}");
    }
    store.create_index(ns, &Index::on(doc! { "at": "2d" })).unwrap();
    assert!(refused(geojson).contains("index"), "a 2d index answers no GeoJSON");
    assert!(refused(doc! { "$near": [0, 500] }).contains("180"), "out of its bounds");
    assert_eq!(ids(store, ns, doc! { "at": { "$nearSphere": [0, 0] } }), [1]);
    let both = doc! { "$or": [{ "at": { "$near": [0, 0] } }, { "_id": 1 }] };
    assert!(store.find(ns, &Find { filter: both, ..Find::default() }).is_err());
}

fn a_pipeline_may_begin_with_what_is_near(store: &dyn Store, ns: &Namespace) {
    let bounds = doc! { "min": -1000, "max": 1000 };
    store.create_index(ns, &Index { other: bounds, ..Index::on(doc! { "at": "2d" }) }).unwrap();
    insert(store, ns, [doc! { "_id": 1, "at": [300, 400] }, doc! { "_id": 2, "at": [3, 4], "kind": "cup" }]);
    let results = |stages: &[Document]| -> Vec<Document> {
        let results = store.aggregate(ns, stages.into()).unwrap();
        results.map(|raw| Document::try_from(&*raw.unwrap()).unwrap()).collect()
    };
    let near = doc! { "near": [0, 0], "distanceField": "how.far", "includeLocs": "where", "distanceMultiplier": 2 };
    assert_eq!(
        results(&[doc! { "$geoNear": near.clone() }]),
        [
            doc! { "_id": 2, "at": [3, 4], "kind": "cup", "how": { "far": 10.0 }, "where": [3, 4] },
            doc! { "_id": 1, "at": [300, 400], "how": { "far": 1000.0 }, "where": [300, 400] },
        ]
    );
    let mut cups = near.clone();
    cups.extend(doc! { "key": "at", "query": { "kind": "cup" } });
    let counted = [doc! { "$geoNear": cups }, doc! { "$count": "n" }];
    assert_eq!(results(&counted), [doc! { "n": 1 }]);
    assert!(store.aggregate(ns, (&[doc! { "$limit": 1 }, doc! { "$geoNear": near }]).into()).is_err());
}

fn the_keys_of_a_reference_are_fields_of_paths(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1, "at": { "$ref": "places", "$id": 5 } }, doc! { "_id": 5 }]);
    let one = doc! { "$match": { "_id": 1 } };
    for (stage, wanted) in [
        (doc! { "$project": { "place": "$at.$id", "in": "$at.$ref" } }, doc! { "_id": 1, "place": 5, "in": "places" }),
        (doc! { "$project": { "at.$id": 1 } }, doc! { "_id": 1, "at": { "$id": 5 } }),
        (doc! { "$unset": "at.$ref" }, doc! { "_id": 1, "at": { "$id": 5 } }),
        (doc! { "$group": { "_id": "$at.$id" } }, doc! { "_id": 5 }),
    ] {
        assert_eq!(aggregated(store, ns, &[one.clone(), stage.clone()]), [wanted], "{stage}");
    }
    let place = doc! { "from": &ns.collection, "localField": "at.$id", "foreignField": "_id", "as": "place" };
    let joined = aggregated(store, ns, &[one.clone(), doc! { "$lookup": place }]);
    assert_eq!(joined[0].get_array("place").unwrap(), &[doc! { "_id": 5 }.into()]);
    let find = Find { filter: doc! { "_id": 1 }, projection: doc! { "at.$id": 1 }, ..Find::default() };
    assert_eq!(found(store, ns, &find), [doc! { "_id": 1, "at": { "$id": 5 } }]);
    let other = doc! { "$project": { "x": "$at.$other" } };
    assert!(store.aggregate(ns, [one, other].as_slice().into()).is_err());
}

fn an_index_of_places_refuses_what_is_none(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1, "at": [1, 1] }, doc! { "_id": 2 }]);
    assert!(store.create_index(ns, &Index::on(doc! { "at": "2dsphere" })).unwrap());
    // Tools that restore a dump take one without a version for an old one.
    let definition = store.indexes(ns).unwrap().pop().unwrap().definition();
    assert_eq!(definition.get("2dsphereIndexVersion"), Some(&Bson::Int32(3)));
    assert!(!store.create_index(ns, &Index::on(doc! { "at": "2dsphere" })).unwrap());
    let refused = |at: Bson| store.insert(ns, vec![doc! { "_id": 9, "at": at }]).is_err();
    assert!(refused("here".into()));
    assert!(refused(bson::bson!({ "type": "Point", "coordinates": [181, 0] })));
    assert!(store.update(ns, &update(doc! { "_id": 1 }, doc! { "$set": { "at": 5 } }), None).is_err());
    assert_eq!(all(store, ns), [doc! { "_id": 1, "at": [1, 1] }, doc! { "_id": 2 }]);
    store.drop_index(ns, "at_2dsphere").unwrap();
    insert(store, ns, [doc! { "_id": 9, "at": "here" }]);
    assert!(store.create_index(ns, &Index::on(doc! { "at": "2dsphere" })).is_err());
    assert_eq!(store.indexes(ns).unwrap(), [Index::of_ids()]);
}

fn the_first_document_that_decays_makes_the_index_for_it(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1 }]);
    assert_eq!(store.indexes(ns).unwrap(), [Index::of_ids()]);
    let later = bson::DateTime::from_millis(4_000_000_000_000);
    insert(store, ns, [doc! { "_id": 2, "_robmem_info": { "decay_time": later } }]);
    assert_eq!(store.indexes(ns).unwrap(), [Index::of_ids(), Index::of_decay()]);
    assert!(store.drop_index(ns, &Index::of_decay().name).is_err());
    assert_eq!(ids(store, ns, doc! {}), [1, 2]);
}

/// A memory asks for stored documents with these conditions; other clients write what they like into the metadata.
fn an_expression_sees_the_stored_documents_whatever_their_metadata_is(store: &dyn Store, ns: &Namespace) {
    let at = |millis: i64| Bson::from(instant(4_000_000_000_000 + millis));
    let dates = [at(-1), at(0), at(1), true.into(), Bson::Null];
    let tokens = [Bson::Null, Bson::from(1)];
    let mut infos = vec![Bson::Null, doc! {}.into(), doc! { "computation": [] }.into()];
    for date in &dates {
        infos.push(doc! { "decay_time": date.clone() }.into());
        infos.push(doc! { "decay_time": [at(1), date.clone()] }.into());
        infos.push(doc! { "decay_time": [[date.clone()]] }.into());
    }
    for token in &tokens {
        infos.push(doc! { "computation": { "token": token.clone() } }.into());
        infos.push(doc! { "computation": [1, { "token": token.clone() }] }.into());
        infos.push(doc! { "computation": [[{ "token": token.clone() }]], "decay_time": at(1) }.into());
    }
    let arrays: Vec<Bson> =
        infos.iter().flat_map(|info| [vec![info.clone()], vec![vec![info.clone()].into()]]).map(Bson::from).collect();
    infos.extend(arrays);
    let document = |(id, info): (i32, &Bson)| doc! { "_id": id, "a": id % 3, "b": 1, "_robmem_info": info.clone() };
    let documents: Vec<Document> = (0..).zip(&infos).map(document).collect();
    insert(store, ns, documents.into_iter().chain([doc! { "_id": -1, "a": 0, "b": 1 }]));
    let seen = doc! {
        "_robmem_info.decay_time": { "$not": { "$lte": at(0) } },
        "_robmem_info.computation.token": { "$exists": false },
    };
    for (expression, filter) in [
        (doc! { "$ne": ["$a", "$b"] }, doc! { "a": { "$ne": 1 } }),
        (doc! { "$eq": ["$a", 1] }, doc! { "a": 1 }),
        (doc! { "$gt": [{ "$toInt": "$a" }, 0] }, doc! { "a": { "$gt": 0 } }),
    ] {
        let expected = ids(store, ns, doc! { "$and": [filter, seen.clone()] });
        let asked = doc! { "$and": [{ "$expr": expression }, seen.clone()] };
        assert_eq!(ids(store, ns, asked.clone()), expected);
        assert_eq!(store.count(ns, (&asked).into()).unwrap(), expected.len() as u64);
        let stages = [doc! { "$match": asked }];
        let matches = store.aggregate(ns, (&stages[..]).into()).unwrap();
        assert_eq!(matches.map(Result::unwrap).count(), expected.len());
    }
}

fn a_decayed_document_takes_no_key(store: &dyn Store, ns: &Namespace) {
    store.create_index(ns, &Index { unique: true, ..Index::on(doc! { "n": 1 }) }).unwrap();
    let decayed = |n: i32| doc! { "_id": n, "n": n, "_robmem_info": { "decay_time": instant(0) } };
    insert(store, ns, [decayed(1), decayed(2), doc! { "_id": 3, "n": 3 }]);
    // The first and the last are new, and the one between is in the place of what decayed.
    insert(store, ns, [doc! { "_id": 0, "n": 0 }, doc! { "_id": 1, "n": 4 }, doc! { "_id": 5, "n": 5 }]);
    insert(store, ns, [decayed(6)]);
    let mut request = update(doc! { "_id": 6 }, doc! { "$set": { "n": 6 } });
    request.filter.extend(doc! { "_robmem_info.decay_time": { "$exists": false } });
    request.upsert = true;
    store.update(ns, &request, None).unwrap();
    let mut there = ids(store, ns, doc! { "_robmem_info.decay_time": { "$exists": false } });
    there.sort_unstable();
    assert_eq!(there, [0, 1, 3, 5, 6]);
    let taken = store.insert(ns, vec![doc! { "_id": 7 }, doc! { "_id": 3 }, doc! { "_id": 8 }]).unwrap_err();
    assert_eq!(taken.stored(), [7.into()]);
}

fn an_update_that_lets_a_document_decay_makes_the_index_too(store: &dyn Store, ns: &Namespace) {
    insert(store, ns, [doc! { "_id": 1 }]);
    let later = bson::DateTime::from_millis(4_000_000_000_000);
    let request = update(doc! { "_id": 1 }, doc! { "$set": { "_robmem_info.decay_time": later } });
    store.update(ns, &request, None).unwrap();
    assert_eq!(store.indexes(ns).unwrap().len(), 2);
}

/// A memory in this process keeps no history.
fn the_runs_that_lost_their_oldest_changes_are_known(store: &dyn Store, ns: &Namespace) {
    // What a server keeps of a database's history has one bound: the other tests have theirs in another one.
    let ns = &Namespace { database: format!("{}_cut", ns.database), ..ns.clone() };
    let (scope, age) = (Scope::Collection(ns.clone()), Duration::from_secs(3600));
    store.keep_history(&[HistoryRule { scope, age, size: 1 << 20 }]);
    store.sign("rmem insert");
    insert(store, ns, (0..20).map(|id| doc! { "_id": id, "n": 0, "pad": "x".repeat(20_000) }));
    for n in 1..6 {
        store.sign("rmem update");
        let update = UpdateSpec::Document(doc! { "$set": { "n": n } });
        let request = UpdateRequest { update, many: true, ..UpdateRequest::default() };
        assert_eq!(store.update(ns, &request, Some(DateTime::now())).unwrap().modified, 20);
    }
    let Some(history) = store.history(ns, None).unwrap() else { return };
    let mut kept: BTreeMap<i64, usize> = BTreeMap::new();
    for entry in history.entries {
        *kept.entry(entry.unwrap().run.unwrap()).or_default() += 1;
    }
    let is_whole = |count: &usize| *count == 20;
    assert!(!history.cut_runs.is_empty() && kept.values().any(is_whole), "{kept:?}");
    for (run, count) in &kept {
        assert_eq!(history.cut_runs.contains(run), !is_whole(count), "{run}: {kept:?} {:?}", history.cut_runs);
    }
}

fn a_collection_with_a_history_can_be_dropped(store: &dyn Store, ns: &Namespace) {
    let (scope, age) = (Scope::Collection(ns.clone()), Duration::from_secs(3600));
    store.keep_history(&[HistoryRule { scope, age, size: 1 << 20 }]);
    insert(store, ns, [doc! { "_id": 1 }, doc! { "_id": 2 }]);
    store.drop(ns).unwrap();
    assert!(!store.collections().unwrap().contains(ns));
    let Some(history) = store.history(ns, None).unwrap() else { return };
    let kinds: Vec<ChangeKind> = history.entries.map(|entry| entry.unwrap().change.kind).collect();
    assert_eq!(kinds.iter().filter(|kind| **kind == ChangeKind::Insert).count(), 2, "{kinds:?}");
    assert!(!store.collections().unwrap().contains(ns));
}
