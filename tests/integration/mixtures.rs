//! A local and a shared store of any two kinds: every document is in the one its database belongs
//! to, and nothing is looked for in the other.

use bson::oid::ObjectId;
use bson::{Document, doc};
use libtest_mimic::{Failed, Trial};
use rmem::memory::Memory;
use rmem::store::{Find, Index, Namespace, StoreError, StoreUri, UpdateRequest, UpdateSpec};

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        Trial::test("mixtures::two_files", || mixed(&["file:a.rmem", "file:b.rmem"])),
        Trial::test("mixtures::a_file_and_a_process", || mixed(&["file:a.rmem", "mem:"])),
        Trial::test("mixtures::a_process_and_a_file", || mixed(&["mem:", "file:b.rmem"])),
        Trial::test("mixtures::what_is_shared_is_not_looked_for_at_home", nothing_falls_through),
    ]
}

type Case = fn(&str) -> Result<(), Failed>;

/// What is tried with a server, by its address.
pub(crate) const CASES: [(&str, Case); 3] = [
    ("mixtures::a_file_and_a_server", |uri| mixed(&["file:a.rmem", uri])),
    ("mixtures::a_server_and_a_file", |uri| mixed(&[uri, "file:b.rmem"])),
    ("mixtures::a_server_and_a_process", |uri| mixed(&[uri, "mem:"])),
];

fn at(folder: &std::path::Path, uri: &str) -> Result<StoreUri, Failed> {
    let uri = match uri.strip_prefix("file:") {
        Some(name) => format!("file:{}", folder.join(name).display()),
        None => uri.to_owned(),
    };
    Ok(StoreUri::parse(&uri)?)
}

/// Databases of one test: one that is private, and one that is shared.
fn databases() -> [String; 2] {
    let test = ObjectId::new().to_hex();
    [format!("local_{test}"), format!("shared_{test}")]
}

fn ns(database: &str, collection: &str) -> Namespace {
    Namespace { database: database.to_owned(), collection: collection.to_owned() }
}

fn change(filter: Document, update: Document, upsert: bool) -> UpdateRequest {
    let update = UpdateSpec::Document(update);
    UpdateRequest { filter, update, many: true, upsert, ..UpdateRequest::default() }
}

fn mixed(uris: &[&str; 2]) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let (local, shared) = (at(folder.path(), uris[0])?, at(folder.path(), uris[1])?);
    let [private, common] = databases();
    let memory = Memory::at(local.clone(), shared.clone(), vec![common.clone()]);
    let (mine, ours) = (ns(&private, "things"), ns(&common, "things"));
    memory.insert(&mine, vec![doc! { "_id": 1, "of": "mine" }])?;
    memory.insert(&ours, vec![doc! { "_id": 1, "of": "ours" }, doc! { "_id": 2, "of": "ours" }])?;
    memory.update(&ours, &change(doc! {}, doc! { "$set": { "seen": true } }, false))?;
    memory.update(&mine, &change(doc! { "_id": 3 }, doc! { "$set": { "of": "mine" } }, true))?;
    memory.create_index(&ours, &Index::on(doc! { "of": 1 }))?;
    assert_eq!(memory.count(&mine, &doc! { "of": "mine" })?, 2);
    assert_eq!(memory.count(&mine, &doc! { "seen": true })?, 0);
    assert_eq!(memory.count(&ours, &doc! { "of": "ours", "seen": true })?, 2);
    assert_eq!((memory.indexes(&mine)?.len(), memory.indexes(&ours)?.len()), (1, 2));
    assert_eq!(memory.delete(&ours, &doc! { "_id": 1 }, false)?, 1);
    assert_eq!(memory.count(&mine, &doc! { "_id": 1 })?, 1);
    let listed = memory.collections()?;
    assert!(listed.contains(&mine) && listed.contains(&ours), "{listed:?}");

    let there = doc! { "db": common, "coll": "made" };
    for across in [doc! { "$out": there.clone() }, doc! { "$merge": { "into": there } }] {
        let refused = memory.aggregate(&mine, &[across]).map(Iterator::count);
        assert!(refused.is_err_and(|error| error.to_string().contains("does not leave its store")));
    }

    // Each store alone has its own database, and not the other's.
    let (held, count) = (memory.count(&mine, &doc! {})?, memory.count(&ours, &doc! {})?);
    drop(memory);
    for (uri, own, size, other) in [(&local, &mine, held, &ours), (&shared, &ours, count, &mine)] {
        if uri.to_string() == "mem:" {
            continue;
        }
        let alone = Memory::at(uri.clone(), uri.clone(), Vec::new());
        assert_eq!(alone.count(own, &doc! {})?, size, "{uri}");
        assert_eq!(alone.count(other, &doc! {})?, 0, "{uri} has documents of the other store");
        assert!(!alone.collections()?.contains(other), "{uri}");
        alone.drop_collection(own)?;
    }
    Ok(())
}

/// A shared store that cannot be reached is an error, and no reason to ask the local one.
fn nothing_falls_through() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let local = at(folder.path(), "file:a.rmem")?;
    let [private, common] = databases();
    Memory::at(local.clone(), local.clone(), Vec::new()).insert(&ns(&common, "things"), vec![doc! { "_id": 1 }])?;
    let nowhere = at(folder.path(), "file:missing/b.rmem")?;
    let (mine, ours) = (ns(&private, "things"), ns(&common, "things"));
    let memory = Memory::at(local, nowhere, vec![common]);
    memory.insert(&mine, vec![doc! { "_id": 1 }])?;
    assert!(matches!(memory.insert(&ours, vec![doc! {}]), Err(StoreError::Unreachable { .. })));
    assert!(matches!(memory.count(&ours, &doc! {}), Err(StoreError::Unreachable { .. })));
    let found = memory.find(&ours, &Find::default()).map(Iterator::count);
    assert!(matches!(found, Err(StoreError::Unreachable { .. })), "{found:?}");
    assert_eq!(memory.count(&mine, &doc! {})?, 1);
    Ok(())
}
