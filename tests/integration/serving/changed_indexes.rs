//! Indexes that `collMod` changes, as a mongod changes them.

use std::time::Duration;

use bson::{Bson, DateTime, Document, doc};
use libtest_mimic::Failed;

use super::front::answers_alike;
use super::wire::Wire;
use super::{Beside, Case, Served};

pub(super) const CASES: &[(&str, Case)] =
    &[("what_expires_follows_an_index_that_is_changed", expiring), ("the_index_of_rmem_is_not_changed", own)];

/// What is compared with the answers of a mongod.
pub(super) const BESIDE: &[(&str, Beside)] =
    &[("serving::changed_indexes::they_are_answered_and_listed_as_on_mongod", beside)];

fn commands() -> Vec<Document> {
    let change = |index: Document| doc! { "collMod": "c", "index": index };
    let named = |name: &str, options: Document| {
        change([("name".to_owned(), name.into())].into_iter().chain(options).collect::<Document>())
    };
    let listed = || doc! { "listIndexes": "c" };
    let after = |seconds: Bson| named("t_1", doc! { "expireAfterSeconds": seconds });
    let dry = |mut command: Document| {
        command.insert("dryRun", true);
        command
    };
    let mut commands = vec![
        doc! { "insert": "c", "documents": [{ "_id": 1 }] },
        doc! { "createIndexes": "c", "indexes": [
            { "key": { "a": 1 }, "name": "a_1" },
            { "key": { "t": 1 }, "name": "t_1", "expireAfterSeconds": 1_000 },
            { "key": { "x": 1, "y": 1 }, "name": "x_1_y_1" },
            { "key": { "h": 1 }, "name": "h_1", "hidden": true },
            { "key": { "u": 1 }, "name": "u_1", "unique": true },
        ] },
        after(2_000.into()),
        after(2_000.into()),
        after(1.7.into()),
        after(5_i64.into()),
        after((-1).into()),
        after((1_i64 << 31).into()),
        after(f64::NAN.into()),
        after(1e300.into()),
        after("x".into()),
        after(Bson::Null),
        change(doc! { "keyPattern": { "t": 1 }, "expireAfterSeconds": 7 }),
        listed(),
    ];
    for (name, options) in [
        ("t_1", doc! { "expireAfterSeconds": 100, "hidden": true }),
        ("t_1", doc! { "expireAfterSeconds": 100, "hidden": true }),
        ("t_1", doc! { "expireAfterSeconds": 101, "hidden": false }),
        ("a_1", doc! { "expireAfterSeconds": 50 }),
        ("a_1", doc! { "expireAfterSeconds": 60, "hidden": true }),
        ("h_1", doc! { "expireAfterSeconds": 4, "hidden": true }),
        ("h_1", doc! { "expireAfterSeconds": 4, "hidden": false, "prepareUnique": false }),
        ("x_1_y_1", doc! { "expireAfterSeconds": 60 }),
        ("_id_", doc! { "expireAfterSeconds": 60 }),
        ("_id_", doc! { "hidden": true }),
        ("_id_", doc! { "hidden": false }),
        ("_id_", doc! { "unique": true }),
        ("u_1", doc! { "unique": true, "expireAfterSeconds": 9 }),
        ("nope", doc! { "expireAfterSeconds": 60 }),
        ("nope", doc! { "unique": false }),
        ("nope", doc! {}),
        ("a_1", doc! {}),
        ("a_1", doc! { "prepareUnique": false }),
        ("a_1", doc! { "prepareUnique": Bson::Null }),
        ("a_1", doc! { "unique": true }),
        ("a_1", doc! { "unique": false, "hidden": true }),
        ("a_1", doc! { "forceNonUnique": true, "expireAfterSeconds": 70 }),
        ("a_1", doc! { "forceNonUnique": false }),
        ("a_1", doc! { "forceNonUnique": true, "unique": true }),
        ("a_1", doc! { "keyPattern": { "a": 1 }, "hidden": false }),
    ] {
        commands.push(named(name, options));
    }
    commands.extend([
        listed(),
        change(doc! {}),
        change(doc! { "expireAfterSeconds": 3 }),
        change(doc! { "keyPattern": { "nope": 1 }, "expireAfterSeconds": 3 }),
        dry(after(7.into())),
        dry(named("a_1", doc! { "unique": true })),
        dry(named("u_1", doc! { "unique": true })),
        dry(doc! { "collMod": "c" }),
        doc! { "collMod": "c", "index": { "name": "nope", "hidden": true }, "viewOn": "x" },
        doc! { "collMod": "c", "index": Bson::Null },
        listed(),
    ]);
    commands
}

/// What of an answer is compared: all but words, what is of the cluster, and the order of the options of an index.
fn seen(answer: &Document) -> Document {
    let mut seen: Document = answer
        .iter()
        .filter(|(name, _)| !matches!(name.as_str(), "errmsg" | "$clusterTime" | "operationTime" | "commitQuorum"))
        .map(|(name, value)| (name.clone(), value.clone()))
        .collect();
    if let Ok(cursor) = answer.get_document("cursor") {
        let indexes = cursor.get_array("firstBatch").into_iter().flatten().filter_map(Bson::as_document);
        let sorted = |index: &Document| {
            let mut options: Vec<(String, Bson)> = index.clone().into_iter().collect();
            options.sort_by(|(one, _), (other, _)| one.cmp(other));
            options.into_iter().collect::<Document>()
        };
        seen.insert("cursor", indexes.map(sorted).collect::<Vec<_>>());
    }
    seen
}

fn run(wire: &mut Wire, command: &Document) -> Result<Document, Failed> {
    wire.run(&command.clone().into_iter().chain(doc! { "$db": "changed_indexes" }).collect())
}

fn beside(mongod: &str) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let address = mongod.trim_start_matches("mongodb://").split('/').next().unwrap_or_default();
    let (mut real, mut own) = (Wire::connect(address)?, Wire::connect(served.address())?);
    let mut expected = Vec::new();
    for wire in [&mut real, &mut own] {
        run(wire, &doc! { "dropDatabase": 1 })?;
    }
    for command in commands() {
        let (answer, real) = (seen(&run(&mut own, &command)?), seen(&run(&mut real, &command)?));
        // What an insert says of an election is of a replica set.
        if !command.contains_key("insert") {
            assert_eq!(answer, real, "{command}");
        }
        expected.push(answer);
    }
    // In front of that mongod, its indexes are changed.
    run(&mut real, &doc! { "dropDatabase": 1 })?;
    answers_alike(mongod, &commands(), &expected, |wire, command| Ok(seen(&run(wire, command)?)))?;
    run(&mut real, &doc! { "dropDatabase": 1 })?;
    Ok(())
}

fn expiring() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut wire = Wire::connect(served.address())?;
    let ago =
        |hours: u64| DateTime::from_system_time(std::time::SystemTime::now() - Duration::from_secs(hours * 3_600));
    let insert = |id: i32, hours: u64| doc! { "insert": "c", "documents": [{ "_id": id, "at": ago(hours) }] };
    let expire = |seconds: i32| {
        doc! { "collMod": "c", "index": { "keyPattern": { "at": 1 }, "expireAfterSeconds": seconds, "hidden": true } }
    };
    let ids = |wire: &mut Wire| -> Result<Vec<i32>, Failed> {
        let answer = run(wire, &doc! { "find": "c", "sort": { "_id": 1 } })?;
        let batch = answer.get_document("cursor")?.get_array("firstBatch")?;
        Ok(batch.iter().filter_map(|found| found.as_document()?.get_i32("_id").ok()).collect())
    };
    run(&mut wire, &insert(1, 5))?;
    run(&mut wire, &insert(2, 3))?;
    run(&mut wire, &doc! { "createIndexes": "c", "indexes": [{ "key": { "at": 1 }, "name": "at" }] })?;
    run(&mut wire, &insert(3, 1))?;
    assert_eq!(ids(&mut wire)?, [1, 2, 3], "no document expires by an index that says nothing of it");
    for (seconds, id, left) in
        [(4 * 3_600, 4, vec![2, 3, 4]), (2 * 3_600, 5, vec![3, 4, 5]), (9 * 3_600, 6, vec![3, 4, 5, 6])]
    {
        let answer = run(&mut wire, &expire(seconds))?;
        assert_eq!(answer.get_i64("expireAfterSeconds_new")?, i64::from(seconds), "{answer}");
        // Writers remove what has expired.
        run(&mut wire, &insert(id, 0))?;
        assert_eq!(ids(&mut wire)?, left, "after {seconds} s");
    }
    drop(served);
    // It is kept.
    let served = Served::start(folder.path(), &[])?;
    let mut wire = Wire::connect(served.address())?;
    let answer = run(&mut wire, &expire(1_800))?;
    assert_eq!(answer.get_i64("expireAfterSeconds_old")?, 9 * 3_600, "{answer}");
    run(&mut wire, &insert(7, 0))?;
    assert_eq!(ids(&mut wire)?, [4, 5, 6, 7]);
    Ok(())
}

fn own() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut wire = Wire::connect(served.address())?;
    let decaying = doc! { "_id": 1, "_robmem_info": { "decay_time": DateTime::MAX } };
    run(&mut wire, &doc! { "insert": "c", "documents": [decaying] })?;
    for change in [doc! { "expireAfterSeconds": 1 }, doc! { "hidden": true }] {
        let mut index = doc! { "keyPattern": { "_robmem_info.decay_time": 1 } };
        index.extend(change);
        let answer = run(&mut wire, &doc! { "collMod": "c", "index": index })?;
        assert_eq!(answer.get_i32("code")?, 27, "{answer}");
    }
    Ok(())
}
