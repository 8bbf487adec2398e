//! The embedded store through its public interface: files, and what goes wrong with them.

use std::path::Path;

use bson::{Bson, doc};
use rmem::store::{Embedded, Find, Index, Namespace, Role, Store as _, StoreError, StoreUri, open};

fn blocks() -> Namespace {
    Namespace::parse("robmem.blocks").unwrap()
}

/// Why `path` cannot be opened, with the folder it is in left out.
fn refusal(path: &Path) -> String {
    match Embedded::open(path) {
        Ok(_) => "opened".to_owned(),
        Err(error) => {
            let folder = path.parent().unwrap().display().to_string();
            error.to_string().replace(&folder, "…")
        }
    }
}

#[test]
fn documents_come_back_in_the_order_they_were_stored_in() {
    let store = Embedded::in_memory().unwrap();
    let documents: Vec<_> = (0..2_000).rev().map(|n| doc! { "_id": n, "pad": "x".repeat(300) }).collect();
    let inserted = store.insert(&blocks(), documents).unwrap();
    let ids = store.find(&blocks(), &Find::default()).unwrap().map(|found| found.unwrap().get_i32("_id").unwrap());
    assert_eq!(ids.map(Bson::Int32).collect::<Vec<_>>(), inserted.ids);
}

#[test]
fn a_file_keeps_its_documents() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("robot.rmem");
    let store = Embedded::open(&path).unwrap();
    store.insert(&blocks(), vec![doc! { "_id": 1 }]).unwrap();
    assert!(folder.path().join("robot.rmem-wal").exists(), "writes go to a log, so that readers need not wait");
    drop(store);
    assert_eq!(Embedded::open(&path).unwrap().count(&blocks(), (&doc! {}).into()).unwrap(), 1);
    let files: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|file| file.unwrap().file_name()).collect();
    assert_eq!(files, ["robot.rmem"], "a clean close leaves nothing beside the file");
}

#[test]
fn an_empty_file_becomes_a_memory() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("robot.rmem");
    std::fs::write(&path, "").unwrap();
    Embedded::open(&path).unwrap().insert(&blocks(), vec![doc! {}]).unwrap();
}

#[test]
fn a_file_that_is_no_memory_is_refused_and_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("notes.txt");
    let text = "(define (domain blocks)) ".repeat(100);
    std::fs::write(&path, &text).unwrap();
    assert_eq!(refusal(&path), "file:…/notes.txt: it is not an rmem memory; name another file");
    assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
}

#[test]
fn a_database_of_another_program_is_refused_and_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other.db");
    rusqlite::Connection::open(&path).unwrap().execute_batch("CREATE TABLE t (x)").unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let text = "file:…/other.db: it is an SQLite database of another program, not an rmem memory; name another file";
    assert_eq!(refusal(&path), text);
    assert_eq!(std::fs::read(&path).unwrap(), bytes);
}

#[test]
fn an_empty_database_of_another_program_with_a_write_ahead_log_is_refused_and_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other.db");
    let other = rusqlite::Connection::open(&path).unwrap();
    other.execute_batch("PRAGMA journal_mode = WAL; CREATE TABLE t (x); DROP TABLE t").unwrap();
    drop(other);
    let bytes = std::fs::read(&path).unwrap();
    let text = "file:…/other.db: it is an SQLite database of another program, not an rmem memory; name another file";
    assert_eq!(refusal(&path), text);
    assert_eq!(std::fs::read(&path).unwrap(), bytes);
}

#[test]
fn a_memory_of_a_newer_version_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("robot.rmem");
    drop(Embedded::open(&path).unwrap());
    rusqlite::Connection::open(&path).unwrap().pragma_update(None, "user_version", 99).unwrap();
    let text = "file:…/robot.rmem: is a memory of version 99, this rmem reads version 3; use a newer rmem";
    assert_eq!(refusal(&path), text);
}

#[test]
fn a_directory_and_a_missing_folder_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("inner");
    std::fs::create_dir(&inner).unwrap();
    assert_eq!(refusal(&inner), "cannot open file:…/inner: it is a directory; name a file in it");
    let text = "cannot open file:…/robot.rmem: its folder … does not exist; create it first";
    assert_eq!(refusal(&folder.path().join("missing/robot.rmem")), text);
    std::fs::write(folder.path().join("file"), "x").unwrap();
    assert!(refusal(&folder.path().join("file/robot.rmem")).starts_with("cannot open file:…/robot.rmem: "));
}

#[test]
fn a_damaged_file_is_an_error_and_no_crash() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("robot.rmem");
    let documents = (0..500).map(|n| doc! { "_id": n, "pad": "x".repeat(400) }).collect();
    Embedded::open(&path).unwrap().insert(&blocks(), documents).unwrap();
    let whole = std::fs::read(&path).unwrap();
    for start in (4_096..whole.len()).step_by(8_192) {
        let mut bytes = whole.clone();
        bytes.iter_mut().skip(start).take(1_500).for_each(|byte| *byte ^= 0x5A);
        std::fs::write(&path, bytes).unwrap();
        let Ok(store) = Embedded::open(&path) else { continue };
        let read = store.find(&blocks(), &Find { filter: doc! { "pad": "y" }, ..Find::default() });
        let _ = read.map(|documents| documents.map(|document| document.is_ok()).collect::<Vec<_>>());
        let _ = store.delete(&blocks(), (&doc! { "pad": { "$type": "string" } }).into(), false);
    }
    std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    let shortened =
        Embedded::open(&path).and_then(|store| store.find(&blocks(), &Find::default())?.collect::<Result<Vec<_>, _>>());
    assert!(shortened.is_err_and(|error| error.to_string().contains("is damaged")));
}

#[test]
fn a_damaged_page_of_an_index_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("robot.rmem");
    let store = Embedded::open(&path).unwrap();
    store.insert(&blocks(), (0..2_000).map(|n| doc! { "_id": n, "name": format!("block {n}") }).collect()).unwrap();
    store.create_index(&blocks(), &Index::on(doc! { "name": 1 })).unwrap();
    drop(store);
    let mut bytes = std::fs::read(&path).unwrap();
    // Leaves of indexes (SQLite's documentation, "Database File Format", section 1.6): behind a header of 8 bytes, each cell
    // has two bytes that say where it is; those of one cell now point to before all cells.
    for page in
        bytes.chunks_exact_mut(4_096).filter(|page| page[0] == 0x0A && u16::from_be_bytes([page[3], page[4]]) > 20)
    {
        page[8 + 20..8 + 22].copy_from_slice(&9_u16.to_be_bytes());
    }
    std::fs::write(&path, bytes).unwrap();
    let store = Embedded::open(&path).unwrap();
    // A page that was read before is looked at again: the second answer is no other than the first.
    for n in (0..2_000).chain(0..2_000) {
        let find = Find { filter: doc! { "name": format!("block {n}") }, ..Find::default() };
        let found = store.find(&blocks(), &find).and_then(Iterator::collect::<Result<Vec<_>, _>>);
        assert!(found.is_err() || found.unwrap().len() == 1, "block {n}");
    }
}

#[test]
fn a_file_that_cannot_be_written_can_be_read() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("robot.rmem");
    Embedded::open(&path).unwrap().insert(&blocks(), vec![doc! { "_id": 1 }]).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o444)).unwrap();
    let store = Embedded::open(&path).unwrap();
    assert_eq!(store.count(&blocks(), (&doc! { "_id": 1 }).into()).unwrap(), 1);
    // The superuser may write it all the same.
    if let Err(error) = store.insert(&blocks(), vec![doc! {}]) {
        assert!(error.to_string().contains("cannot be written; check the permissions"), "{error}");
    }
}

#[test]
fn an_update_that_fails_keeps_what_it_changed_before_but_not_in_a_step() {
    let store = Embedded::in_memory().unwrap();
    let documents = (0..10).map(|n| doc! { "_id": n, "n": if n == 7 { "text".into() } else { Bson::Int32(n) } });
    store.insert(&blocks(), documents.collect()).unwrap();
    let request = rmem::store::UpdateRequest {
        filter: doc! {},
        update: rmem::store::UpdateSpec::Document(doc! { "$inc": { "n": 100 } }),
        many: true,
        ..rmem::store::UpdateRequest::default()
    };
    let is_at_fault = |error: &StoreError| {
        let StoreError::Partial { done: 7, source } = error else { return false };
        matches!(&**source, StoreError::Query(error) if error.code == 14)
    };
    let changed = || store.count(&blocks(), (&doc! { "n": { "$gte": 100 } }).into()).unwrap();
    let step = store.atomically(&mut || store.update(&blocks(), &request, None).map(drop));
    assert!(step.is_err_and(|error| is_at_fault(&error)));
    assert_eq!(changed(), 0);
    assert!(store.update(&blocks(), &request, None).is_err_and(|error| is_at_fault(&error)));
    assert_eq!(changed(), 7);
    store.insert(&blocks(), vec![doc! { "_id": 10 }]).unwrap();
}

#[test]
fn an_answer_goes_on_while_its_collection_is_dropped() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("robot.rmem");
    let (reader, writer) = (Embedded::open(&path).unwrap(), Embedded::open(&path).unwrap());
    writer.insert(&blocks(), (0..5_000).map(|n| doc! { "_id": n }).collect()).unwrap();
    let mut answer = reader.find(&blocks(), &Find::default()).unwrap();
    assert!(answer.next().unwrap().is_ok());
    assert!(writer.drop(&blocks()).unwrap());
    writer.insert(&blocks(), vec![doc! { "_id": "new" }]).unwrap();
    assert!(answer.all(|document| document.is_ok_and(|document| document.get_i32("_id").is_ok())));
    assert_eq!(reader.count(&blocks(), (&doc! {}).into()).unwrap(), 1);
}

#[test]
fn an_interrupted_answer_keeps_no_lock() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("robot.rmem");
    let (reader, writer) = (Embedded::open(&path).unwrap(), Embedded::open(&path).unwrap());
    writer.insert(&blocks(), (0..5_000).map(|n| doc! { "_id": n }).collect()).unwrap();
    let mut answer = reader.find(&blocks(), &Find::default()).unwrap();
    assert!(answer.next().unwrap().is_ok());
    assert_eq!(writer.delete(&blocks(), (&doc! {}).into(), false).unwrap(), 5_000);
    reader.insert(&blocks(), vec![doc! {}]).unwrap();
}

#[test]
fn a_uri_opens_its_store() {
    let folder = tempfile::tempdir().unwrap();
    let uri = StoreUri::parse(&format!("file:{}", folder.path().join("a.rmem").display())).unwrap();
    open(&uri, Role::Local).unwrap().insert(&blocks(), vec![doc! {}]).unwrap();
    let store = open(&uri, Role::Local).unwrap();
    assert_eq!((store.count(&blocks(), (&doc! {}).into()).unwrap(), store.describe()), (1, uri.to_string()));
    assert_eq!(open(&StoreUri::parse("mem:").unwrap(), Role::Local).unwrap().describe(), "mem:");
}

#[cfg(not(feature = "mongodb"))]
#[test]
fn without_mongodb_its_uris_are_refused_with_what_to_do() {
    let uri = StoreUri::parse("mongodb://robot:secret@host").unwrap();
    let error = open(&uri, Role::Local).err().unwrap().to_string();
    assert!(error.starts_with("mongodb://host: this rmem was built without MongoDB; "), "{error}");
}

#[test]
fn the_order_of_the_key_column_is_the_order_of_a_sort() {
    let store = Embedded::in_memory().unwrap();
    let ns = Namespace::parse("a.b").unwrap();
    let ids = [
        bson::Bson::from(3),
        bson::Bson::from("b"),
        bson::Bson::from(2.5),
        bson::Bson::Null,
        bson::Bson::from(-7_i64),
        bson::Bson::from(doc! { "x": 1 }),
        bson::Bson::from(true),
        bson::Bson::from("B"),
        bson::Bson::from(bson::oid::ObjectId::from_bytes([9; 12])),
        bson::Bson::MinKey,
        bson::Bson::from(bson::DateTime::from_millis(5)),
        bson::Bson::Double(f64::NAN),
    ];
    store.insert(&ns, ids.iter().map(|id| doc! { "_id": id, "x": 1 }).collect()).unwrap();
    let found = |sort, skip, limit| -> Vec<bson::RawDocumentBuf> {
        let find = Find { sort, skip, limit, filter: doc! { "x": 1 }, ..Find::default() };
        store.find(&ns, &find).unwrap().collect::<Result<_, _>>().unwrap()
    };
    assert_eq!(found(doc! { "_id": 1 }, 0, 0).len(), ids.len());
    assert_eq!(found(doc! { "_id": 1 }, 0, 0), found(doc! { "_id": 1, "x": 1 }, 0, 0));
    assert_eq!(found(doc! { "_id": 1 }, 2, 3), found(doc! { "_id": 1, "x": 1 }, 2, 3));
}

#[test]
fn what_fails_within_one_step_leaves_nothing() {
    let store = Embedded::in_memory().unwrap();
    let ns = Namespace::parse("a.b").unwrap();
    let failed = store.atomically(&mut || {
        store.insert(&ns, vec![doc! { "_id": 1 }])?;
        store.insert(&ns, vec![doc! { "_id": 1 }]).map(drop)
    });
    assert!(failed.is_err());
    assert_eq!(store.count(&ns, (&doc! {}).into()).unwrap(), 0);
    store.atomically(&mut || store.insert(&ns, vec![doc! { "_id": 1 }]).map(drop)).unwrap();
    assert_eq!(store.count(&ns, (&doc! {}).into()).unwrap(), 1);
}
