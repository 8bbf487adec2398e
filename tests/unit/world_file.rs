//! World files and the memory they are loaded into, through the public interface.

use std::sync::atomic::{AtomicBool, Ordering};

use bson::{DateTime, Document, doc};
use rmem::formats::Source;
use rmem::memory::dump::RestoreError;
use rmem::memory::dump::read::Dump;
use rmem::memory::dump::restore::{RestoreOptions, restore};
use rmem::memory::dump::world_file;
use rmem::memory::expiry::Expired;
use rmem::memory::{Clock, Memory};
use rmem::store::{Embedded, Find, Index, Namespace, Store as _, StoreUri, UpdateRequest, UpdateSpec};

fn ns(text: &str) -> Namespace {
    Namespace::parse(text).unwrap()
}

fn at(millis: i64) -> DateTime {
    DateTime::from_millis(millis)
}

fn memory() -> Memory {
    Memory::new(Box::new(Embedded::in_memory().unwrap()), None, Vec::new()).with_clock(Clock::Stopped(at(1_000)))
}

fn load(memory: &Memory, text: &str) -> String {
    world_file::load(memory, &Source::new("world.json", text)).unwrap().to_string()
}

fn all(memory: &Memory, text: &str) -> Vec<Document> {
    let documents = memory.find(&ns(text), &Find::default()).unwrap();
    documents.map(|document| Document::try_from(&*document.unwrap()).unwrap()).collect()
}

const WORLD: &str = r#"{
  "b.blocks": [
    {"block": "B"},
    {"block": "A"},
    {"block": "A"},
    {"_id": 1, "n": {"$numberLong": "5"}, "x": 1.0}
  ],
  "a.empty": []
}"#;

#[test]
fn documents_are_loaded_in_the_order_of_the_file() {
    let memory = memory();
    assert_eq!(
        load(&memory, WORLD),
        "b.blocks: 4 new, 0 replaced, 0 unchanged; a.empty: 0 new, 0 replaced, 0 unchanged"
    );
    let blocks = all(&memory, "b.blocks");
    let names: Vec<_> = blocks.iter().filter_map(|block| block.get_str("block").ok()).collect();
    assert_eq!(names, ["B", "A", "A"]);
    assert_eq!(blocks[3], doc! { "_id": 1, "n": 5_i64, "x": 1.0 });
}

#[test]
fn loading_a_file_again_changes_nothing() {
    let memory = memory();
    load(&memory, WORLD);
    let before = world_file::dump(&memory, &memory.collections().unwrap()).unwrap();
    let memory = memory.with_clock(Clock::Stopped(at(2_000)));
    assert_eq!(
        load(&memory, WORLD),
        "b.blocks: 0 new, 0 replaced, 4 unchanged; a.empty: 0 new, 0 replaced, 0 unchanged"
    );
    assert_eq!(world_file::dump(&memory, &memory.collections().unwrap()).unwrap(), before);
    assert_eq!(memory.count(&ns("b.blocks"), &doc! { "_robmem_info.updated": { "$exists": true } }).unwrap(), 0);
}

#[test]
fn a_document_with_an_id_takes_the_place_of_the_other() {
    let memory = memory();
    load(&memory, r#"{"a.b": [{"_id": 1, "x": 1}, {"_id": 2, "x": 2}]}"#);
    assert_eq!(load(&memory, r#"{"a.b": [{"y": 3, "_id": 1}]}"#), "a.b: 0 new, 1 replaced, 0 unchanged");
    assert_eq!(all(&memory, "a.b"), [doc! { "_id": 1, "y": 3 }, doc! { "_id": 2, "x": 2 }]);
}

#[test]
fn a_dump_has_a_document_on_each_line() {
    let memory = memory();
    let documents = vec![
        doc! { "_id": 2, "pose": { "x": 0.5 }, "n": 3_i64, "_robmem_info": { "persistent": false } },
        doc! { "_id": 1, "name": "cup" },
    ];
    memory.insert(&ns("tidyup.objects"), documents).unwrap();
    memory.insert(&ns("a.b"), vec![doc! { "_id": "x" }]).unwrap();
    let namespaces = [ns("tidyup.objects"), ns("a.b"), ns("a.none")];
    assert_eq!(
        world_file::dump(&memory, &namespaces).unwrap(),
        r#"{
  "a.b": [
    {"_id":"x"}
  ],
  "a.none": [],
  "tidyup.objects": [
    {"_id":1,"name":"cup"},
    {"_id":2,"pose":{"x":0.5},"n":{"$numberLong":"3"},"_robmem_info":{"persistent":false}}
  ]
}
"#
    );
}

#[test]
fn a_dump_that_is_loaded_dumps_the_same_bytes() {
    let first = memory();
    load(&first, WORLD);
    let text = world_file::dump(&first, &first.collections().unwrap()).unwrap();
    let second = memory().with_clock(Clock::Stopped(at(9)));
    load(&second, &text);
    assert_eq!(world_file::dump(&second, &second.collections().unwrap()).unwrap(), text);
    assert_eq!(world_file::dump(&second, &[]).unwrap(), "{}\n");
}

#[test]
fn a_wrong_namespace_is_an_error_at_its_place() {
    let source = Source::new("world.json", "{\n  \"blocks\": []\n}");
    let error = world_file::WorldFile::parse(&source).unwrap_err();
    assert_eq!((error.name(), error.position()), ("world.json", (2, 3)));
    assert!(error.message().contains("it has no dot"), "{error}");
    assert!(world_file::load(&memory(), &source).is_err());
}

#[test]
fn a_document_that_cannot_be_stored_is_an_error_at_its_place_before_anything_is_stored() {
    for (document, message) in [
        (r#"{"_id": 7}"#, "the _id 7 is given twice"),
        (r#"{"_id": 7.0}"#, "the _id 7.0 is given twice"),
        (r#"{"_id": [1]}"#, "the _id may not be an array"),
        (r#"{"_robmem_info": {"persistent": "yes"}}"#, "_robmem_info.persistent has to be true or false"),
    ] {
        let memory = memory();
        let text = format!("{{\"a.b\": [{{\"_id\": 1}}],\n \"a.c\": [{{\"_id\": 7}},\n   {document}]}}");
        match world_file::load(&memory, &Source::new("world.json", text)) {
            Err(world_file::WorldError::Text { source, .. }) => {
                assert_eq!((source.position(), source.message()), ((3, 4), message));
            }
            other => panic!("{other:?}"),
        }
        assert_eq!(memory.collections().unwrap(), []);
    }
}

#[test]
fn metadata_is_kept_and_hidden() {
    let memory = memory();
    let blocks = ns("robmem.blocks");
    memory.insert(&blocks, vec![doc! { "_id": 1, "a": 1 }]).unwrap();
    let memory = memory.with_clock(Clock::Stopped(at(2_000)));
    let request = |update| UpdateRequest {
        filter: doc! { "_id": 1 },
        update: UpdateSpec::Document(update),
        ..UpdateRequest::default()
    };
    memory.update(&blocks, &request(doc! { "$set": { "a": 1 } })).unwrap();
    assert_eq!(memory.count(&blocks, &doc! { "_robmem_info.updated": { "$exists": true } }).unwrap(), 0);
    memory.update(&blocks, &request(doc! { "b": 2 })).unwrap();
    assert_eq!(all(&memory, "robmem.blocks"), [doc! { "_id": 1, "b": 2 }]);

    let with_metadata = memory.find_with_metadata(&blocks, &Find::default()).unwrap().next().unwrap().unwrap();
    let info = doc! { "inserted": at(1_000), "updated": at(2_000) };
    assert_eq!(Document::try_from(&*with_metadata).unwrap(), doc! { "_id": 1, "b": 2, "_robmem_info": info });
    assert_eq!(memory.count(&blocks, &doc! { "_robmem_info.inserted": at(1_000) }).unwrap(), 1);
    assert!(memory.insert(&blocks, vec![doc! { "_robmem_info": 3 }]).is_err());
}

#[test]
fn metadata_that_is_asked_for_is_shown() {
    let memory = memory();
    memory.insert(&ns("a.b"), vec![doc! { "_id": 1 }]).unwrap();
    let find = Find { projection: doc! { "_robmem_info.inserted": 1 }, ..Find::default() };
    let found = memory.find(&ns("a.b"), &find).unwrap().next().unwrap().unwrap();
    assert_eq!(Document::try_from(&*found).unwrap(), doc! { "_id": 1, "_robmem_info": { "inserted": at(1_000) } });
}

#[test]
fn shared_databases_live_in_the_other_store() {
    let folder = tempfile::tempdir().unwrap();
    let uri = |name: &str| StoreUri::file(folder.path().join(name));
    let memory = Memory::at(uri("local"), uri("shared"), vec!["synced".to_owned()]);
    memory.insert(&ns("own.x"), vec![doc! { "_id": 1 }]).unwrap();
    memory.insert(&ns("synced.x"), vec![doc! { "_id": 2 }]).unwrap();
    assert_eq!(memory.collections().unwrap(), [ns("own.x"), ns("synced.x")]);

    let local = Memory::at(uri("local"), uri("local"), vec!["synced".to_owned()]);
    assert_eq!(local.collections().unwrap(), [ns("own.x")]);
    assert_eq!(all(&local, "synced.x"), []);
}

#[test]
fn a_store_is_opened_when_it_is_needed() {
    let folder = tempfile::tempdir().unwrap();
    let uri = |name: &str| StoreUri::file(folder.path().join(name));
    let nowhere = || uri("no/such/folder");
    let memory = Memory::at(uri("local"), nowhere(), vec!["synced".to_owned()]);
    memory.insert(&ns("own.x"), vec![doc! {}]).unwrap();
    assert!(memory.insert(&ns("synced.x"), vec![doc! {}]).is_err());
    let memory = Memory::at(nowhere(), uri("shared"), vec!["synced".to_owned()]);
    memory.insert(&ns("synced.x"), vec![doc! {}]).unwrap();
    assert!(memory.count(&ns("own.x"), &doc! {}).is_err());
}

#[test]
fn a_restore_that_is_told_to_stop_changes_nothing() {
    let memory = memory();
    memory.insert(&ns("a.b"), vec![doc! { "_id": 1 }]).unwrap();
    let dump = Dump::world(&Source::new("world.json", r#"{"a.b": [{"_id": 2}]}"#)).unwrap();
    let stop = AtomicBool::new(true);
    let stopped =
        restore(&memory, &dump, RestoreOptions { drop: true, stop: Some(&stop), ..RestoreOptions::default() });
    assert!(matches!(stopped, Err(RestoreError::Interrupted(_))), "{stopped:?}");
    assert_eq!(all(&memory, "a.b"), [doc! { "_id": 1 }]);
    stop.store(false, Ordering::Relaxed);
    restore(&memory, &dump, RestoreOptions { drop: true, stop: Some(&stop), ..RestoreOptions::default() }).unwrap();
    assert_eq!(all(&memory, "a.b"), [doc! { "_id": 2 }]);
    assert_eq!(memory.collections().unwrap(), [ns("a.b")]);
}

#[test]
fn a_restored_document_is_inserted_now_and_keeps_what_else_is_known_of_it() {
    let text = r#"{"a.b": [{"_id": 1, "_robmem_info": {"persistent": false,
        "inserted": {"$date": "2001-01-01T00:00:00Z"}, "updated": {"$date": "2001-01-01T00:00:00Z"}}}]}"#;
    let dump = Dump::world(&Source::new("world.json", text)).unwrap();
    for drop in [false, true] {
        let memory = memory();
        restore(&memory, &dump, RestoreOptions { drop, ..RestoreOptions::default() }).unwrap();
        let found = memory.find_with_metadata(&ns("a.b"), &Find::default()).unwrap().next().unwrap().unwrap();
        let document = Document::try_from(&*found).unwrap();
        assert_eq!(document, doc! { "_id": 1, "_robmem_info": { "persistent": false, "inserted": at(1_000) } });
    }
}

#[test]
fn reading_makes_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("robot.rmem");
    let memory = Memory::at(StoreUri::file(&path), StoreUri::file(&path), Vec::new());
    assert_eq!(memory.count(&ns("a.b"), &doc! {}).unwrap(), 0);
    assert_eq!(all(&memory, "a.b"), []);
    assert_eq!(memory.collections().unwrap(), []);
    assert!(!memory.drop_collection(&ns("a.b")).unwrap());
    assert_eq!(memory.delete(&ns("a.b"), &doc! {}, false).unwrap(), 0);
    assert!(!path.exists());
    memory.insert(&ns("a.b"), vec![doc! { "_id": 1 }]).unwrap();
    assert!(path.exists());
    assert_eq!(memory.count(&ns("a.b"), &doc! {}).unwrap(), 1);
}

#[test]
fn a_document_that_has_decayed_is_invisible() {
    let blocks = ns("a.b");
    let memory = memory();
    let decaying = doc! { "decay_time": at(1_500) };
    memory
        .insert(&blocks, vec![doc! { "_id": 1, "n": 1, "_robmem_info": decaying }, doc! { "_id": 2, "n": 2 }])
        .unwrap();
    assert_eq!(memory.count(&blocks, &doc! {}).unwrap(), 2);
    let memory = memory.with_clock(Clock::Stopped(at(1_500)));
    assert_eq!(all(&memory, "a.b"), [doc! { "_id": 2, "n": 2 }]);
    assert_eq!(memory.count(&blocks, &doc! { "_id": 1 }).unwrap(), 0);
    assert_eq!(memory.distinct(&blocks, "n", &doc! {}).unwrap(), [bson::Bson::Int32(2)]);
    for pipeline in [vec![doc! { "$match": { "n": { "$gt": 0 } } }], vec![]] {
        assert_eq!(memory.aggregate(&blocks, &pipeline).unwrap().count(), 1);
    }
    let request = UpdateRequest {
        filter: doc! {},
        update: UpdateSpec::Document(doc! { "$inc": { "n": 1 } }),
        many: true,
        ..UpdateRequest::default()
    };
    assert_eq!(memory.update(&blocks, &request).unwrap().matched, 1);
    assert_eq!(memory.delete(&blocks, &doc! { "_id": 1 }, false).unwrap(), 0);
}

#[test]
fn what_lies_under_the_metadata_is_checked() {
    let blocks = ns("a.b");
    let memory = memory();
    for info in [doc! { "persistent": "yes" }, doc! { "decay_time": "soon" }, doc! { "foo": 2 }] {
        assert!(memory.insert(&blocks, vec![doc! { "_robmem_info": info.clone() }]).is_err(), "{info}");
        assert!(memory.put(&blocks, vec![doc! { "_robmem_info": info.clone() }]).is_err(), "{info}");
    }
    assert_eq!(memory.collections().unwrap(), []);
}

#[test]
fn what_decayed_is_removed_by_later_writers() {
    let folder = tempfile::tempdir().unwrap();
    let store = Embedded::open(folder.path().join("robot.rmem")).unwrap();
    let blocks = ns("a.b");
    let past = doc! { "decay_time": at(1) };
    store.insert(&blocks, vec![doc! { "_id": 1, "_robmem_info": past }, doc! { "_id": 2 }]).unwrap();
    assert_eq!(store.count(&blocks, (&doc! {}).into()).unwrap(), 2, "whoever stores does not remove what is stored");
    let ttl = Index { expire_after: Some(60), ..Index::on(doc! { "seen": -1 }) };
    store.create_index(&blocks, &ttl).unwrap();
    let seen = |id: i32, at: DateTime| doc! { "_id": id, "seen": [at, DateTime::from_millis(i64::MAX)] };
    store.insert(&blocks, vec![seen(3, at(5)), seen(4, DateTime::now())]).unwrap();
    assert_eq!(store.count(&blocks, (&doc! {}).into()).unwrap(), 3);
    store.insert(&blocks, vec![doc! { "_id": 5 }]).unwrap();
    assert_eq!(store.distinct(&blocks, "_id", (&doc! {}).into()).unwrap(), [2, 4, 5].map(bson::Bson::Int32));
}

#[test]
fn counting_leaves_out_what_decayed_with_and_without_a_filter() {
    let (memory, blocks) = (memory(), ns("a.b"));
    let documents = (0..10).map(|n| doc! { "_id": n, "n": n % 2, "_robmem_info": { "decay_time": at(1_000 + n) } });
    memory.insert(&blocks, documents.chain([doc! { "_id": 99, "n": 0 }]).collect()).unwrap();
    let memory = memory.with_clock(Clock::Stopped(at(1_003)));
    assert_eq!(memory.count(&blocks, &doc! {}).unwrap(), 7);
    assert_eq!(memory.count(&blocks, &doc! { "n": 0 }).unwrap(), 4);
}

#[test]
fn expire_removes_what_is_over_and_says_what() {
    let (start, blocks) = (DateTime::now().timestamp_millis(), ns("a.b"));
    let minutes = |minutes: i64| at(start + minutes * 60_000);
    let info = |info: bson::Document| doc! { "_robmem_info": info };
    let computed =
        |until: i64| info(doc! { "computed": true, "cached_until": minutes(until), "decay_time": minutes(until) });
    let store = Embedded::in_memory().unwrap();
    store.insert(&blocks, vec![computed(12), computed(92)]).unwrap();
    let memory = Memory::new(Box::new(store), None, Vec::new());
    memory
        .insert(
            &blocks,
            vec![
                info(doc! { "decay_time": minutes(15) }),
                info(doc! { "decay_time": minutes(95) }),
                info(doc! { "persistent": false }),
                info(doc! { "persistent": true }),
                doc! { "seen": minutes(10) },
                doc! { "seen": minutes(90) },
            ],
        )
        .unwrap();
    let ttl = Index { expire_after: Some(1), ..Index::on(doc! { "seen": 1 }) };
    memory.create_index(&blocks, &ttl).unwrap();
    memory.insert(&ns("a.untouched"), vec![doc! { "_id": 1 }]).unwrap();
    assert_eq!(memory.expire(false).0, [], "nothing is over yet");
    let memory = memory.with_clock(Clock::Stopped(minutes(20)));
    let expired = Expired { decayed: 1, computed: 1, due: 1, not_persistent: 0, surplus: 0 };
    assert_eq!(memory.expire(false).0, [(blocks.clone(), expired)]);
    let expired = Expired { not_persistent: 1, ..Expired::default() };
    assert_eq!(memory.expire(true).0, [(blocks.clone(), expired)]);
    assert_eq!(memory.count(&blocks, &doc! {}).unwrap(), 4);
}
