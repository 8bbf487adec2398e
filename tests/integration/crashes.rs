//! A writer that is killed in the middle, again and again: documents, indexes and the change log
//! are those of what it acknowledged, or of one step more.
//!
//! What the writer does follows from the number of the step, so that it can be done again here.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::Path;
use std::time::Duration;

use bson::{Bson, DateTime, Document, doc};
use libtest_mimic::{Failed, Trial};
use rmem::store::{
    ChangeKind, Embedded, Find, HistoryRule, Index, Namespace, Next, Scope, Store, UpdateRequest, UpdateSpec,
};

use super::processes::{Draws, KILLS, kill_one, number, spawn};

/// The name by which the changes are followed.
const WATCHER: &str = "harness";

pub(crate) fn trials() -> Vec<Trial> {
    vec![Trial::test(
        "crashes::a_killed_writer_leaves_indexes_and_the_change_log_as_the_documents_are",
        a_killed_writer_leaves_indexes_and_the_change_log_as_the_documents_are,
    )]
}

fn ns() -> Namespace {
    Namespace::parse("robmem.crashes").unwrap()
}

/// One step of the writer.
enum Step {
    Insert(Vec<Document>),
    Update(Document, Document),
    Delete(Document),
}

/// A number that looks random, and is the same for the same step.
fn noise(step: i32, salt: u64) -> i32 {
    let mixed = (u64::from(step.unsigned_abs()) + 1)
        .wrapping_mul(0x9E37_79B9_7F4A_7C15)
        .wrapping_add(salt.wrapping_mul(0xBF58_476D_1CE4_E5B9));
    i32::try_from((mixed ^ (mixed >> 29)).wrapping_mul(0x94D0_49BB_1331_11EB) >> 34).unwrap_or(0)
}

fn document(id: i32, step: i32) -> Document {
    let due = noise(id, 1) % 7 == 0;
    // Far behind or far ahead: whether it is due does not depend on when the test runs.
    let at = DateTime::from_millis(if due { 1_000_000_000_000 } else { 9_000_000_000_000 });
    let tags = vec![format!("t{}", noise(id, 2) % 5), format!("t{}", noise(step, 3) % 5)];
    doc! { "_id": id, "serial": id, "tags": tags, "at": at, "n": 0, "pad": "x".repeat(usize::try_from(noise(id, 4) % 900).unwrap_or(0)) }
}

fn step(number: i32) -> Step {
    let some = number - noise(number, 5) % 60;
    match noise(number, 6) % 20 {
        0 => Step::Delete(doc! { "_id": { "$lt": (number - 150) * 4 } }),
        1..4 => Step::Delete(doc! { "_id": some * 4 }),
        4..8 => Step::Update(
            doc! { "_id": some * 4 },
            doc! { "$set": { "serial": -number, "tags": [format!("t{}", noise(number, 7) % 5), "new"] } },
        ),
        8..10 => Step::Update(doc! { "tags": format!("t{}", noise(number, 8) % 5) }, doc! { "$inc": { "n": 1 } }),
        _ => Step::Insert((0..1 + noise(number, 9) % 4).map(|part| document(number * 4 + part, number)).collect()),
    }
}

/// Does one step after the other, from a number on, and says so once each is durable.
pub(crate) fn churn(store: &Embedded, mut number: i32) {
    let mut out = std::io::stdout().lock();
    loop {
        take(store, number);
        if writeln!(out, "{number}").and_then(|()| out.flush()).is_err() {
            return;
        }
        number += 1;
    }
}

fn take(store: &dyn Store, number: i32) {
    match step(number) {
        Step::Insert(documents) => drop(store.insert(&ns(), documents).unwrap()),
        Step::Delete(filter) => drop(store.delete(&ns(), (&filter).into(), false).unwrap()),
        Step::Update(filter, update) => {
            let update = UpdateSpec::Document(update);
            let request = UpdateRequest { filter, update, many: true, ..UpdateRequest::default() };
            drop(store.update(&ns(), &request, None).unwrap());
        }
    }
}

/// Documents by their `_id`.
type State = BTreeMap<i32, Document>;

fn state(store: &dyn Store) -> Result<State, Failed> {
    store
        .find(&ns(), &Find::default())?
        .map(|found| {
            let document = Document::try_from(&*found?)?;
            Ok((document.get_i32("_id")?, document))
        })
        .collect()
}

fn prepare(store: &Embedded) -> Result<(), Failed> {
    let indexes = [
        Index { unique: true, ..Index::on(doc! { "serial": 1 }) },
        Index::on(doc! { "tags": 1, "n": -1 }),
        Index { expire_after: Some(0), ..Index::on(doc! { "at": 1 }) },
    ];
    for index in &indexes {
        store.create_index(&ns(), index)?;
    }
    // From this write on, every process keeps the history.
    store.keep_history(&[HistoryRule { scope: Scope::All, age: Duration::from_secs(86_400), size: 1 << 30 }]);
    store.create(&ns(), None)?;
    Ok(())
}

fn a_killed_writer_leaves_indexes_and_the_change_log_as_the_documents_are() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("robot.rmem");
    // The same steps, done by a process that is not killed.
    let model = Embedded::in_memory()?;
    prepare(&model)?;
    let mut replica = State::new();
    {
        let store = Embedded::open(&path)?;
        prepare(&store)?;
        follow(&store, &mut replica)?;
    }
    let (mut next, mut draws) = (1, Draws::new());
    let kills = number(KILLS, 30);
    for round in 0..kills {
        let acknowledged = kill_one(spawn("churn", &path, "x", next)?, next, 8, draws.draw())?;
        let store = Embedded::open(&path).map_err(|error| format!("round {round}: {error}"))?;
        while next < acknowledged {
            take(&model, next);
            next += 1;
        }
        let found = state(&store)?;
        if found != state(&model)? {
            take(&model, next);
            next += 1;
            assert_eq!(found, state(&model)?, "round {round}: after step {next}");
        }
        check_indexes(&store, &found).map_err(|error| format!("round {round}: {error:?}"))?;
        follow(&store, &mut replica)?;
        assert_eq!(replica, found, "round {round}: the changes make other documents");
        check_history(&store, &found).map_err(|error| format!("round {round}: {error:?}"))?;
        check_file(&path)?;
    }
    draws.end();
    eprintln!("{kills} writers killed in {next} steps");
    Ok(())
}

/// The history, from the first change on, makes the documents that there are.
fn check_history(store: &Embedded, found: &State) -> Result<(), Failed> {
    let mut made = State::new();
    for entry in store.history(&ns(), None)?.ok_or("no history is kept")?.entries {
        let change = entry?.change;
        let id = change.id.as_ref().and_then(Bson::as_i32).ok_or("a change without an _id")?;
        assert_eq!(made.get(&id), decoded(change.before)?.as_ref(), "{:?} of {id}", change.kind);
        match decoded(change.after)? {
            Some(after) => drop(made.insert(id, after)),
            None => drop(made.remove(&id)),
        }
    }
    assert_eq!(&made, found, "the history makes other documents");
    let first = store.history(&ns(), None)?.ok_or("no history is kept")?.since;
    assert_eq!(store.as_of(&ns(), DateTime::now())?.len(), found.len());
    assert_eq!(store.as_of(&ns(), first)?.len(), 0);
    Ok(())
}

/// Every index lists what a walk over the documents finds, and nothing else.
fn check_indexes(store: &Embedded, found: &State) -> Result<(), Failed> {
    let by = |filter: Document, sort: Document, wanted: &dyn Fn(&Document) -> bool| -> Result<(), Failed> {
        let find = Find { filter: filter.clone(), sort, ..Find::default() };
        let explanation = store.explain(&ns(), &find)?;
        assert!(explanation.get_str("index").is_ok(), "{explanation}");
        let wanted = found.values().filter(|document| wanted(document)).count();
        let returned = store.find(&ns(), &find)?.count();
        assert_eq!(returned, wanted, "{filter}");
        assert_eq!(explanation.get_i64("keys_examined")?, i64::try_from(wanted)?, "{filter}: {explanation}");
        Ok(())
    };
    by(doc! { "serial": { "$gte": i32::MIN } }, doc! { "serial": 1 }, &|_| true)?;
    by(doc! { "_id": { "$gte": i32::MIN } }, doc! { "_id": -1 }, &|_| true)?;
    by(doc! { "at": { "$gte": DateTime::from_millis(0) } }, doc! {}, &|_| true)?;
    for tag in ["t0", "t1", "t2", "t3", "t4", "new"] {
        let has = |document: &Document| document.get_array("tags").is_ok_and(|tags| tags.contains(&Bson::from(tag)));
        by(doc! { "tags": tag }, doc! {}, &has)?;
    }
    Ok(())
}

/// Applies the changes that were noted.
fn follow(store: &Embedded, replica: &mut State) -> Result<(), Failed> {
    let mut changes = store.watch(&ns(), Some(WATCHER))?;
    while let Next::Change(change) = changes.next(Duration::ZERO)? {
        let id = change.id.as_ref().and_then(Bson::as_i32).ok_or("a change without an _id")?;
        let (before, after) = (decoded(change.before)?, decoded(change.after)?);
        assert_eq!(replica.get(&id), before.as_ref(), "{:?} of {id}", change.kind);
        match (change.kind, after) {
            (ChangeKind::Delete, None) => drop(replica.remove(&id)),
            (_, Some(after)) => drop(replica.insert(id, after)),
            (kind, None) => return Err(format!("{kind:?} without a document").into()),
        }
        changes.done()?;
    }
    Ok(())
}

fn decoded(document: Option<bson::RawDocumentBuf>) -> Result<Option<Document>, Failed> {
    Ok(document.map(|document| Document::try_from(&*document)).transpose()?)
}

fn check_file(path: &Path) -> Result<(), Failed> {
    let connection = rusqlite::Connection::open(path)?;
    let verdict: String = connection.query_row("PRAGMA integrity_check", [], |row| row.get(0))?;
    assert_eq!(verdict, "ok");
    Ok(())
}
