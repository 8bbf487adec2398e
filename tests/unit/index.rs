//! Indexes change how documents are found, never which.

use bson::{Bson, DateTime, Document, RawDocumentBuf, bson, doc};
use proptest::prelude::*;
use proptest::sample::select;
use rmem::query::Sort;
use rmem::store::{
    Embedded, Find, Hint, Index, Modifiers, Namespace, Query, Store as _, StoreError, UpdateRequest, UpdateSpec,
};

fn ns() -> Namespace {
    Namespace::parse("robmem.objects").unwrap()
}

fn leaf() -> impl Strategy<Value = Bson> + Clone {
    select(vec![
        Bson::Null,
        bson!(1),
        bson!(2),
        bson!(2.5),
        bson!(-3i64),
        bson!(f64::NAN),
        bson!("a"),
        bson!("ab"),
        bson!("b"),
        bson!(true),
        DateTime::from_millis(5).into(),
        Bson::Undefined,
        Bson::MinKey,
    ])
}

fn value() -> impl Strategy<Value = Bson> + Clone {
    let field = select(vec!["b", "c", "0"]);
    leaf().prop_recursive(3, 8, 3, move |inner| {
        prop_oneof![
            prop::collection::vec(inner.clone(), 0..3).prop_map(Bson::Array),
            prop::collection::vec((field.clone(), inner), 0..3)
                .prop_map(|fields| Bson::Document(fields.into_iter().map(|(k, v)| (k.to_owned(), v)).collect())),
        ]
    })
}

fn document() -> impl Strategy<Value = Document> {
    prop::collection::vec((select(vec!["a", "b"]), value()), 0..3)
        .prop_map(|fields| fields.into_iter().map(|(key, value)| (key.to_owned(), value)).collect())
}

fn pattern() -> impl Strategy<Value = Document> {
    select(vec![
        doc! {"a": 1},
        doc! {"a": -1},
        doc! {"a.b": 1},
        doc! {"a.0": 1},
        doc! {"a.0.b": -1},
        doc! {"a": 1, "b": -1},
        doc! {"b": 1, "a": 1},
        doc! {"a.b": 1, "a.c": 1},
        doc! {"a.b": -1, "b": 1},
    ])
}

fn index() -> impl Strategy<Value = Index> {
    (pattern(), any::<bool>()).prop_map(|(keys, sparse)| Index { sparse, ..Index::on(keys) })
}

fn path() -> impl Strategy<Value = &'static str> {
    select(vec!["a", "b", "a.b", "a.c", "a.0", "a.0.b"])
}

fn operator() -> impl Strategy<Value = Bson> {
    let storable = value()
        .prop_filter("queries for undefined are not compared", |value| {
            !value.to_string().contains("undefined") && !matches!(value, Bson::Undefined)
        })
        .boxed();
    prop_oneof![
        storable.clone(),
        (select(vec!["$eq", "$gt", "$gte", "$lt", "$lte", "$ne"]), storable.clone())
            .prop_map(|(name, value)| Bson::Document(doc! { name: value })),
        (storable.clone(), storable.clone()).prop_map(|(low, high)| bson!({"$gte": low, "$lt": high})),
        prop::collection::vec(storable.clone(), 0..3).prop_map(|values| bson!({"$in": values})),
        storable.clone().prop_map(|value| bson!({"$elemMatch": {"$gte": value}})),
        (select(vec!["b", "c"]), storable.clone())
            .prop_map(|(name, value)| bson!({"$elemMatch": {name: value, "c": {"$ne": 7}}})),
        (storable.clone(), storable).prop_map(|(low, high)| bson!({"$elemMatch": {"$gt": low, "$lte": high}})),
        any::<bool>().prop_map(|exists| bson!({"$exists": exists})),
        select(vec!["^a", "^ab*", "b"]).prop_map(|pattern| bson!({"$regex": pattern})),
    ]
}

fn filter() -> impl Strategy<Value = Document> {
    let condition = (path(), operator()).prop_map(|(path, operator)| doc! { path: operator }).boxed();
    prop_oneof![
        condition.clone(),
        (condition.clone(), condition.clone()).prop_map(|(a, b)| doc! { "$and": [a, b] }),
        (condition.clone(), condition.clone()).prop_map(|(a, b)| doc! { "$or": [a, b] }),
        (condition.clone(), condition.clone(), condition)
            .prop_map(|(a, b, c)| doc! { "$and": [{ "$or": [a, b] }, { "$and": [c] }] }),
    ]
}

fn sort() -> impl Strategy<Value = Document> {
    select(vec![
        doc! {},
        doc! {},
        doc! {"a": 1},
        doc! {"a": -1},
        doc! {"a": -1, "b": 1},
        doc! {"b": 1},
        doc! {"a.b": 1},
        doc! {"_id": -1},
        doc! {"$natural": -1},
    ])
}

fn found(store: &Embedded, filter: &Document, sort: &Document) -> Result<Vec<RawDocumentBuf>, String> {
    let find = Find { filter: filter.clone(), sort: sort.clone(), ..Find::default() };
    let found = store.find(&ns(), &find).map_err(|error| error.to_string())?;
    found.map(|document| document.map_err(|error| error.to_string())).collect()
}

/// The places of documents in a sort.
fn places(documents: &[RawDocumentBuf], sort: &Document) -> Vec<Vec<u8>> {
    let sort = Sort::parse(sort).unwrap();
    documents.iter().map(|document| sort.key(document).unwrap_or_default()).collect()
}

fn by_id(mut documents: Vec<RawDocumentBuf>) -> Vec<RawDocumentBuf> {
    documents.sort_by_key(|document| document.get_i32("_id").unwrap());
    documents
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]

    #[test]
    fn a_query_finds_the_same_with_and_without_indexes(
        documents in prop::collection::vec(document(), 0..12),
        indexes in prop::collection::vec(index(), 1..3),
        changes in prop::collection::vec((filter(), path(), value()), 0..3),
        queries in prop::collection::vec((filter(), sort()), 1..6),
    ) {
        let (plain, indexed) = (Embedded::in_memory().unwrap(), Embedded::in_memory().unwrap());
        for index in &indexes {
            // Two of them may have one name.
            let _ = indexed.create_index(&ns(), index);
        }
        for (id, document) in documents.into_iter().enumerate() {
            let mut identified = doc! { "_id": i32::try_from(id).unwrap() };
            identified.extend(document);
            // What cannot be indexed is stored in neither.
            if indexed.insert(&ns(), vec![identified.clone()]).is_ok() {
                plain.insert(&ns(), vec![identified]).unwrap();
            }
        }
        for (filter, path, value) in changes {
            let update = UpdateRequest {
                filter,
                update: UpdateSpec::Document(doc! { "$set": { path: value } }),
                many: true, ..UpdateRequest::default() };
            let mut changed = None;
            // What fails at one document changes none in a step.
            let step = indexed.atomically(&mut || {
                changed = Some(indexed.update(&ns(), &update, None)?);
                Ok(())
            });
            if let (Ok(()), Some(changed)) = (step, changed) {
                prop_assert_eq!(plain.update(&ns(), &update, None).unwrap(), changed);
            }
        }
        for (filter, sort) in queries {
            let (without, with) = (found(&plain, &filter, &sort), found(&indexed, &filter, &sort));
            if sort.is_empty() || without.is_err() {
                prop_assert_eq!(&without, &with, "{}", filter);
            }
            let (Ok(without), Ok(with)) = (without, with) else { continue };
            prop_assert_eq!(places(&without, &sort), places(&with, &sort), "{} {}", filter, sort);
            prop_assert_eq!(by_id(without.clone()), by_id(with), "{} {}", filter, sort);
            prop_assert_eq!(indexed.count(&ns(), (&filter).into()).unwrap(), without.len() as u64);
        }
    }
}

fn store(count: i32) -> Embedded {
    let store = Embedded::in_memory().unwrap();
    let document = |n| doc! { "_id": n, "name": format!("object{n}"), "place": n % 10, "tags": [n % 3, n % 5] };
    store.insert(&ns(), (0..count).map(document).collect()).unwrap();
    store
}

fn explained(store: &Embedded, filter: Document, sort: Document, limit: u64) -> Document {
    store.explain(&ns(), &Find { filter, sort, limit, ..Find::default() }).unwrap()
}

fn numbers(explanation: &Document) -> [i64; 3] {
    ["keys_examined", "documents_examined", "returned"].map(|name| explanation.get_i64(name).unwrap())
}

#[test]
fn an_explanation_tells_the_index_its_bounds_and_what_was_looked_at() {
    let store = store(100);
    store.create_index(&ns(), &Index::on(doc! { "place": 1, "name": -1 })).unwrap();
    let explanation = explained(&store, doc! { "place": 3, "name": { "$gt": "object5" } }, doc! {}, 0);
    assert_eq!(
        explanation,
        doc! {
            "index": "place_1_name_-1",
            "keys": { "place": 1, "name": -1 },
            "bounds": { "place": ["[3, 3]"], "name": ["(\"object5\", …]"] },
            "keys_examined": 5i64, "documents_examined": 5i64, "returned": 5i64,
        }
    );
    let scan = explained(&store, doc! { "name": "object7" }, doc! {}, 0);
    assert_eq!(
        scan,
        doc! {
            "index": Bson::Null, "keys_examined": 0i64, "documents_examined": 100i64, "returned": 1i64
        }
    );
}

#[test]
fn a_sort_that_an_index_has_looks_at_no_more_than_is_wanted() {
    let store = store(100);
    store.create_index(&ns(), &Index::on(doc! { "place": 1, "name": -1 })).unwrap();
    for (filter, sort, limit) in [
        (doc! {}, doc! { "place": -1 }, 3),
        (doc! { "place": 4 }, doc! { "name": 1 }, 3),
        (doc! { "place": { "$gte": 4 } }, doc! { "place": 1, "name": -1 }, 3),
        (doc! { "_id": { "$lt": 50 } }, doc! { "_id": -1 }, 3),
    ] {
        let explanation = explained(&store, filter.clone(), sort, limit);
        assert_eq!(explanation.get_str("sort").unwrap(), "index", "{explanation}");
        assert!(numbers(&explanation)[0] < 8, "{explanation}");
    }
    let memory = explained(&store, doc! { "place": 4 }, doc! { "_id": -1, "name": 1 }, 3);
    assert_eq!(memory.get_str("sort").unwrap(), "memory", "{memory}");
}

#[test]
fn alternatives_use_an_index_each() {
    let store = store(100);
    store.create_index(&ns(), &Index::on(doc! { "tags": 1 })).unwrap();
    let explanation = explained(&store, doc! { "$or": [{ "tags": 4 }, { "_id": 0 }] }, doc! {}, 0);
    assert_eq!(explanation.get_array("any").unwrap().len(), 2);
    assert_eq!(numbers(&explanation), [21, 21, 21]);
}

#[test]
fn the_index_with_fewer_keys_is_taken() {
    let store = store(100);
    store.create_index(&ns(), &Index::on(doc! { "place": 1 })).unwrap();
    store.create_index(&ns(), &Index::on(doc! { "name": 1 })).unwrap();
    let explanation = explained(&store, doc! { "place": 3, "name": "object13" }, doc! {}, 0);
    assert_eq!((explanation.get_str("index").unwrap(), numbers(&explanation)), ("name_1", [1, 1, 1]));
}

#[test]
fn a_failed_write_leaves_its_index_as_the_documents_are() {
    let store = store(10);
    store.create_index(&ns(), &Index { unique: true, ..Index::on(doc! { "name": 1 }) }).unwrap();
    let update = UpdateRequest {
        filter: doc! {},
        update: UpdateSpec::Document(doc! { "$set": { "name": "same" } }),
        many: true,
        ..UpdateRequest::default()
    };
    assert!(store.update(&ns(), &update, None).is_err());
    for n in 0..10 {
        // The first was changed before the second failed.
        let name = if n == 0 { "same".to_owned() } else { format!("object{n}") };
        let explanation = explained(&store, doc! { "name": name }, doc! {}, 0);
        assert_eq!(numbers(&explanation), [1, 1, 1]);
    }
}

#[test]
fn a_walk_through_an_index_shows_each_document_once_whatever_is_changed_meanwhile() {
    for backwards in [1, -1] {
        let store = store(3_000);
        store.create_index(&ns(), &Index::on(doc! { "rank": 1 })).unwrap();
        let update = |filter: Document, update: Document| {
            let update = UpdateSpec::Document(update);
            let request = UpdateRequest { filter, update, many: true, ..UpdateRequest::default() };
            store.update(&ns(), &request, None).unwrap()
        };
        update(doc! {}, doc! { "$set": { "rank": 0 } });
        let find = Find { sort: doc! { "rank": backwards }, ..Find::default() };
        let mut seen = std::collections::BTreeMap::new();
        for (number, found) in store.find(&ns(), &find).unwrap().enumerate() {
            *seen.entry(found.unwrap().get_i32("_id").unwrap()).or_insert(0) += 1;
            if number == 400 {
                // Half of them go where the walk was, half where it will be.
                update(doc! { "place": { "$lt": 5 } }, doc! { "$set": { "rank": -1 } });
                update(doc! { "place": { "$gte": 5 } }, doc! { "$set": { "rank": 1 } });
            }
        }
        assert_eq!(seen.len(), 3_000);
        assert!(seen.values().all(|times| *times == 1), "{seen:?}");
    }
}

#[test]
fn what_no_document_can_be_is_not_looked_for() {
    let store = store(100);
    let decayed = explained(&store, doc! { "_robmem_info.decay_time": { "$lte": DateTime::now() } }, doc! {}, 0);
    assert_eq!(numbers(&decayed), [0, 0, 0]);
}

#[test]
fn a_wildcard_index_is_hinted_only_for_its_paths() {
    let store = Embedded::in_memory().unwrap();
    store.insert(&ns(), vec![doc! { "_id": 1, "a": { "b": 1 }, "c": 2 }, doc! { "_id": 2, "c": 2 }]).unwrap();
    let inside = Index::on(doc! { "a.$**": 1 });
    let without = Index { other: doc! { "wildcardProjection": { "c": 0 } }, ..Index::on(doc! { "$**": 1 }) };
    for index in [&inside, &without] {
        assert!(store.create_index(&ns(), index).unwrap());
    }
    let count = |filter: Document, index: &Index| {
        let hint = Some(Hint::Name(index.name.clone()));
        store.count(&ns(), Query { filter: &filter, modifiers: &Modifiers { hint, ..Modifiers::default() } })
    };
    assert_eq!(count(doc! { "a.b": 1 }, &inside).unwrap(), 1);
    assert_eq!(count(doc! { "a.b": 1, "c": 2 }, &without).unwrap(), 1);
    for (filter, index) in [(doc! { "c": 2 }, &inside), (doc! { "c": 2 }, &without), (doc! { "_id": 1 }, &without)] {
        assert!(count(filter.clone(), index).unwrap_err().to_string().contains("none of its paths"), "{filter}");
    }
    let refused = |keys: Document, projection: Option<Document>| {
        let other = projection.map(|projection| doc! { "wildcardProjection": projection }).unwrap_or_default();
        match store.create_index(&ns(), &Index { other, ..Index::on(keys) }).unwrap_err() {
            StoreError::Query(error) => error.code,
            other => panic!("{other}"),
        }
    };
    assert_eq!(refused(doc! { "$**": 0 }, None), 67);
    assert_eq!(refused(doc! { "$**": 1, "a": 1 }, None), 67);
    assert_eq!(refused(doc! { "$**.a": 1 }, None), 67);
    assert_eq!(refused(doc! { "a.$**": 1 }, Some(doc! { "a": 1 })), 9);
    assert_eq!(refused(doc! { "$**": 1 }, Some(doc! {})), 9);
    assert_eq!(refused(doc! { "$**": 1 }, Some(doc! { "a": 1, "b": 0 })), 31_254);
    assert_eq!(refused(doc! { "$**": 1 }, Some(doc! { "a": "1" })), 51_271);
    assert_eq!(refused(doc! { "a": 1 }, Some(doc! { "a": 1 })), 2);
}
