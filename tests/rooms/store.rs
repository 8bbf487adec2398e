//! The embedded store through its public interface.

use bson::{Bson, doc};
use rmem::store::{Embedded, Find, Namespace, Store as _};

fn blocks() -> Namespace {
    Namespace::parse("robmem.blocks").unwrap()
}

#[test]
fn documents_come_back_in_the_order_they_were_stored_in() {
    let store = Embedded::in_memory().unwrap();
    let documents: Vec<_> = (0..2_000).rev().map(|n| doc! { "_id": n, "pad": "x".repeat(300) }).collect();
    let inserted = store.insert(&blocks(), documents).unwrap();
    let found: Vec<_> = store
        .find(&blocks(), &Find::default())
        .unwrap()
        .map(|d| Bson::Int32(d.unwrap().get_i32("_id").unwrap()))
        .collect();
    assert_eq!(found, inserted.ids);
    assert_eq!(store.count(&blocks(), &doc! {}).unwrap(), 2_000);
}

#[test]
fn a_file_keeps_its_documents() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("robot.rmem");
    Embedded::open(&path).unwrap().insert(&blocks(), vec![doc! { "_id": 1 }]).unwrap();
    assert_eq!(Embedded::open(&path).unwrap().count(&blocks(), &doc! {}).unwrap(), 1);
    assert!(!folder.path().join("robot.rmem-wal").exists());
}
