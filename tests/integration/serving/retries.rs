//! Writes of which a client sends some statements again, with others or without.

use bson::{Bson, Document, doc};
use libtest_mimic::Failed;

use super::wire::Wire;
use super::{Beside, Case, Served};

pub(super) const CASES: &[(&str, Case)] = &[
    ("statements_that_connections_send_again_at_once_are_done_once_also_after_kills", at_once),
    ("writes_of_which_much_has_to_be_kept_are_done_once", large),
    ("a_write_whose_database_was_dropped_since_is_done_once", dropped),
];

/// What is compared with the answers of a mongod.
pub(super) const BESIDE: &[(&str, Beside)] =
    &[("serving::retries::statements_that_are_sent_again_are_answered_as_mongod_does", beside)];

/// A collection before the commands of a session, and those.
struct Scenario {
    documents: Vec<Document>,
    commands: Vec<Document>,
}

fn insert(ids: &[i32], statements: &[i32]) -> Document {
    let documents: Vec<Document> = ids.iter().map(|id| doc! { "_id": *id }).collect();
    doc! { "insert": "c", "documents": documents, "stmtIds": statements.to_vec() }
}

fn update(updates: &[Document], statements: &[i32]) -> Document {
    doc! { "update": "c", "updates": updates.to_vec(), "stmtIds": statements.to_vec() }
}

fn delete(ids: &[i32], statements: &[i32]) -> Document {
    let deletes: Vec<Document> = ids.iter().map(|id| doc! { "q": { "_id": *id }, "limit": 1 }).collect();
    doc! { "delete": "c", "deletes": deletes, "stmtIds": statements.to_vec() }
}

fn modify(id: i32, statement: i32) -> Document {
    doc! { "findAndModify": "c", "query": { "_id": id }, "update": { "$inc": { "n": 1 } }, "stmtId": statement }
}

fn remove(id: i32, statement: i32) -> Document {
    doc! { "findAndModify": "c", "query": { "_id": id }, "remove": true, "stmtId": statement }
}

fn add(id: i32) -> Document {
    doc! { "q": { "_id": id }, "u": { "$inc": { "n": 1 } } }
}

fn make(id: i32) -> Document {
    with(add(id), doc! { "upsert": true })
}

fn with(command: Document, more: Document) -> Document {
    command.into_iter().chain(more).collect()
}

fn unordered(command: Document) -> Document {
    with(command, doc! { "ordered": false })
}

fn scenarios() -> Vec<Scenario> {
    let of = |documents: &[Document], commands: Vec<Document>| Scenario { documents: documents.to_vec(), commands };
    let ids = |ids: &[i32]| ids.iter().map(|id| doc! { "_id": *id }).collect::<Vec<_>>();
    let text = [doc! { "_id": 1 }, doc! { "_id": 2, "n": "x" }, doc! { "_id": 3 }];
    let same = doc! { "q": { "_id": 2 }, "u": { "$set": { "n": 1 } } };
    let (broken, mixed) = (insert(&[1, 5, 2], &[0, 1, 2]), insert(&[1, 6, 2], &[0, 1, 2]));
    vec![
        of(&[], vec![insert(&[1, 2], &[0, 1]), insert(&[1, 2, 3], &[0, 1, 2]), insert(&[3, 1, 4], &[2, 0, 3])]),
        of(&[], vec![insert(&[1, 2], &[0, 1]), insert(&[2], &[1]), insert(&[2], &[2])]),
        of(&ids(&[5]), vec![broken.clone(), broken.clone(), mixed.clone()]),
        of(&ids(&[5]), vec![unordered(broken.clone()), unordered(broken.clone()), broken.clone(), unordered(mixed)]),
        of(&ids(&[1, 2]), vec![update(&[add(1), add(2)], &[0, 1]), update(&[add(1), add(2), add(1)], &[0, 1, 2])]),
        of(&ids(&[2]), vec![update(&[make(1), add(2)], &[0, 1]), update(&[make(3), add(2), make(1)], &[2, 1, 0])]),
        // A statement that changed nothing is done again.
        of(&[doc! { "_id": 2, "n": 1 }], {
            vec![update(&[add(9), same.clone()], &[0, 1]), insert(&[9], &[5]), update(&[add(9), same], &[0, 1])]
        }),
        of(&text, vec![update(&[add(1), add(2), add(3)], &[0, 1, 2]), update(&[add(1), add(2), add(3)], &[0, 1, 2])]),
        of(&text, {
            let changes = unordered(update(&[add(1), add(2), add(3)], &[0, 1, 2]));
            vec![changes.clone(), changes]
        }),
        of(&ids(&[1, 2]), vec![delete(&[1, 9], &[0, 1]), delete(&[1, 9, 2], &[0, 1, 2])]),
        of(&ids(&[1]), vec![modify(1, 0), modify(1, 0), modify(1, 1), modify(7, 2), modify(7, 2)]),
        of(&ids(&[1]), vec![remove(1, 0), remove(1, 0), delete(&[1], &[0]), modify(1, 0)]),
        of(&ids(&[1]), vec![with(modify(7, 0), doc! { "upsert": true }), with(modify(7, 0), doc! { "upsert": true })]),
        of(&ids(&[1]), vec![delete(&[1], &[0]), update(&[add(1)], &[0]), insert(&[4], &[0])]),
        // Of many documents is none: such a statement fails, and not the command.
        of(&ids(&[1, 2]), {
            let all = doc! { "q": {}, "u": { "$inc": { "n": 5 } }, "multi": true };
            let some = update(&[add(1), all, add(2)], &[0, 1, 2]);
            let removal = doc! { "delete": "c", "deletes": [{ "q": {}, "limit": 0 }], "stmtIds": [3] };
            vec![some.clone(), unordered(some), removal]
        }),
        of(&[], vec![insert(&[1], &[-1]), insert(&[1], &[-1])]),
        // What is wrong with an update only in the document that it makes is not seen without one.
        of(&ids(&[1]), {
            let modify = |update: Bson| doc! { "findAndModify": "c", "query": { "_id": 9 }, "update": update };
            let wrong = [doc! { "n": 1, "$x": 1 }, doc! { "$set": { "$n": 1 } }, doc! { "$x": 1 }];
            let unknown: Bson = vec![doc! { "$foo": 1 }].into();
            let updates = wrong.into_iter().map(Bson::from).chain([unknown.clone()]);
            let update = doc! { "update": "c", "updates": [{ "q": { "_id": 1 }, "u": unknown }] };
            updates.map(modify).chain([update]).collect()
        }),
        of(&[], {
            let (half, all): (Vec<i32>, Vec<i32>) = ((0..300).step_by(2).collect(), (0..300).collect());
            vec![insert(&half, &half), insert(&all, &all)]
        }),
        of(&[], vec![insert(&[1, 2], &[0]), with(insert(&[1], &[0]), doc! { "stmtId": 0 })]),
        of(&[], vec![with(modify(1, 0), doc! { "stmtIds": [0] }), with(insert(&[1], &[0]), doc! { "stmtIds": ["x"] })]),
        of(&[], vec![with(insert(&[1], &[0]), doc! { "txnNumber": 2_i64 }), insert(&[2], &[1])]),
    ]
}

/// What an answer says of statements, and of what failed.
fn said(answer: &Document) -> Document {
    let keys =
        ["ok", "n", "nModified", "upserted", "retriedStmtIds", "retriedStmtId", "lastErrorObject", "value", "code"];
    let mut said: Document =
        keys.iter().filter_map(|key| Some(((*key).to_owned(), answer.get(key)?.clone()))).collect();
    let place =
        |error: &Bson| error.as_document().map(|error| doc! { "index": error.get("index"), "code": error.get("code") });
    if let Ok(errors) = answer.get_array("writeErrors") {
        said.insert("writeErrors", errors.iter().filter_map(place).collect::<Vec<_>>());
    }
    said
}

/// What is answered to the commands of a session, and what is stored then.
fn outcome(wire: &mut Wire, database: &str, scenario: &Scenario) -> Result<Vec<Document>, Failed> {
    let own = |command: Document| with(command, doc! { "$db": database });
    wire.run(&own(doc! { "drop": "c" }))?;
    wire.run(&own(doc! { "create": "c" }))?;
    if !scenario.documents.is_empty() {
        wire.run(&own(doc! { "insert": "c", "documents": scenario.documents.clone() }))?;
    }
    let session = doc! { "lsid": { "id": bson::Uuid::new() }, "txnNumber": 1_i64 };
    let mut answers = Vec::new();
    for command in &scenario.commands {
        let missing = session.iter().filter(|(name, _)| !command.contains_key(name.as_str()));
        let missing = missing.map(|(name, value)| (name.clone(), value.clone())).collect();
        answers.push(said(&wire.run(&own(with(command.clone(), missing)))?));
    }
    let found = wire.run(&own(doc! { "find": "c", "sort": { "_id": 1 } }))?;
    answers.push(doc! { "stored": found.get_document("cursor")?.get_array("firstBatch")?.clone() });
    Ok(answers)
}

fn beside(mongod: &str) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    compare(mongod, &Served::start(folder.path(), &[])?, "retries")
}

/// Compares what is served with a mongod, where a database of this name is used.
pub(super) fn compare(mongod: &str, served: &Served, database: &str) -> Result<(), Failed> {
    let address = mongod.trim_start_matches("mongodb://").split('/').next().unwrap_or_default();
    let (mut real, mut own) = (Wire::connect(address)?, Wire::connect(served.address())?);
    for scenario in scenarios() {
        let expected = outcome(&mut real, database, &scenario)?;
        let found = outcome(&mut own, &format!("{database}_served"), &scenario)?;
        for (nth, (expected, found)) in expected.iter().zip(&found).enumerate() {
            assert_eq!(found, expected, "{:?}", scenario.commands.get(nth));
        }
    }
    Ok(())
}

/// Connections send the same statements at once, one more each time, and the server is killed in between.
fn at_once() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let mut served = Served::start(folder.path(), &[])?;
    let id = bson::Uuid::new();
    for last in 0..12 {
        let statements: Vec<i32> = (0..=last).collect();
        let updates: Vec<Document> = statements.iter().map(|id| make(*id)).collect();
        let own = doc! { "lsid": { "id": id }, "txnNumber": 1_i64, "$db": "a" };
        let command = with(update(&updates, &statements), own);
        let address = served.address().to_owned();
        let answers = std::thread::scope(|scope| {
            let send = || -> Result<Document, String> {
                let mut wire = Wire::connect(&address).map_err(|error| format!("{error:?}"))?;
                wire.run(&command).map_err(|error| format!("{error:?}"))
            };
            let threads: Vec<_> = (0..4).map(|_| scope.spawn(send)).collect();
            threads.into_iter().map(|thread| thread.join().expect("no panic")).collect::<Result<Vec<_>, _>>()
        })?;
        let retried = |answer: &Document| answer.get_array("retriedStmtIds").map_or(0, Vec::len);
        let mut counts: Vec<usize> = answers.iter().map(retried).collect();
        counts.sort_unstable();
        let (done, all) = (statements.len() - 1, statements.len());
        assert_eq!(counts, [done, all, all, all]);
        for answer in &answers {
            assert_eq!((answer.get_i32("n")?, answer.get_array("upserted")?.len()), (last + 1, all), "{answer}");
        }
        served.kill()?;
        served = Served::start(folder.path(), &[])?;
    }
    let found = Wire::connect(served.address())?.run(&doc! { "count": "c", "query": { "n": 1 }, "$db": "a" })?;
    assert_eq!(found.get_i32("n")?, 12);
    Ok(())
}

fn dropped() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let mut served = Served::start(folder.path(), &[])?;
    let own = doc! { "lsid": { "id": bson::Uuid::new() }, "txnNumber": 1_i64, "$db": "a" };
    let upsert = with(update(&[make(1)], &[0]), own);
    for restarts in [false, true] {
        let mut wire = Wire::connect(served.address())?;
        let answer = wire.run(&upsert)?;
        assert_eq!(answer.get_array("retriedStmtIds").map_or(0, Vec::len), usize::from(restarts), "{answer}");
        wire.run(&doc! { "dropDatabase": 1, "$db": "a" })?;
        if restarts {
            served.kill()?;
            served = Served::start(folder.path(), &[])?;
        }
        let mut wire = Wire::connect(served.address())?;
        let again = wire.run(&upsert)?;
        assert_eq!(again.get_array("retriedStmtIds").map(Vec::len).ok(), Some(1), "{again}");
        assert_eq!(wire.run(&doc! { "count": "c", "$db": "a" })?.get_i32("n")?, 0);
    }
    Ok(())
}

/// More has to be kept than a document has room for.
fn large() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let mut served = Served::start(folder.path(), &[])?;
    let id = bson::Uuid::new();
    let own =
        |number: i64, command: Document| with(command, doc! { "lsid": { "id": id }, "txnNumber": number, "$db": "a" });
    let count = |wire: &mut Wire, query: Document| -> Result<i32, Failed> {
        Ok(wire.run(&doc! { "count": "c", "query": query, "$db": "a" })?.get_i32("n")?)
    };
    let key = |nth: usize| format!("{nth:0>6000}");
    let upsert = |nth| doc! { "q": { "_id": key(nth) }, "u": { "$inc": { "n": 1 } }, "upsert": true };
    let upserts = own(1, doc! { "update": "c", "updates": (0..3000).map(upsert).collect::<Vec<_>>() });
    let upserted = Wire::connect(served.address())?.run(&upserts)?;
    assert_eq!(upserted.get_i32("n").ok(), Some(3000), "{:?}", upserted.get("errmsg"));
    served.kill()?;
    served = Served::start(folder.path(), &[])?;
    let mut wire = Wire::connect(served.address())?;
    let again = wire.run(&upserts)?;
    assert_eq!(again.get_array("retriedStmtIds")?.len(), 3000);
    assert_eq!(again.get_array("upserted")?, upserted.get_array("upserted")?);
    assert_eq!(count(&mut wire, doc! { "n": 1 })?, 3000);
    // The answer has the whole document.
    let text = "x".repeat((16 << 20) - 200);
    wire.run(&doc! { "insert": "c", "documents": [{ "_id": 1, "text": text }], "$db": "a" })?;
    let modification = own(2, doc! { "findAndModify": "c", "query": { "_id": 1 }, "update": { "$inc": { "m": 1 } } });
    let removal = own(3, doc! { "findAndModify": "c", "query": { "_id": 1 }, "remove": true });
    for command in [modification, removal] {
        let first = wire.run(&command)?;
        assert_eq!(first.get_document("value")?.get_i32("_id").ok(), Some(1));
        let second = wire.run(&command)?;
        assert_eq!(second.get("retriedStmtId"), Some(&Bson::Int32(0)));
        assert!(second.get("value") == first.get("value"));
    }
    // A later write is a small one again.
    wire.run(&own(4, doc! { "insert": "c", "documents": [{ "_id": 2 }] }))?;
    assert_eq!(count(&mut wire, doc! { "_id": { "$in": [1, 2] } })?, 1);
    Ok(())
}
