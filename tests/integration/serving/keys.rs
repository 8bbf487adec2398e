//! Queries that are between keys of an index, or ask for its keys and for places of documents.

use bson::{Bson, Document, doc};
use libtest_mimic::Failed;

use super::wire::Wire;
use super::{Beside, Case, Served};

pub(super) const CASES: &[(&str, Case)] =
    &[("keys_are_refused_where_documents_are_computed_or_keys_are_not_their_values", refused)];

/// What is compared with the answers of a mongod.
pub(super) const BESIDE: &[(&str, Beside)] =
    &[("serving::keys::queries_between_keys_are_answered_as_mongod_does", beside)];

/// The documents and the indexes that are asked.
fn prepare(wire: &mut Wire, database: &str) -> Result<(), Failed> {
    let documents: Vec<Document> = (0..8)
        .map(|n| doc! { "_id": n, "a": n % 5, "b": [n, n + 1], "s": format!("x{n}"), "d": { "e": n } })
        .chain([doc! { "_id": 20, "s": "z", "b": [] }])
        .collect();
    let collation = doc! { "locale": "en", "strength": 2 };
    let index = |key: Document, name: &str| doc! { "key": key, "name": name };
    let indexes = [
        index(doc! { "a": 1, "s": -1 }, "both"),
        index(doc! { "b": 1 }, "many"),
        index(doc! { "d.e": -1 }, "turned"),
        index(doc! { "w.$**": 1 }, "wild"),
        doc! { "key": { "q": 1 }, "name": "sparse", "sparse": true },
        doc! { "key": { "s": 1 }, "name": "words", "collation": collation },
        doc! { "key": { "p": 1 }, "name": "partial", "partialFilterExpression": { "a": { "$gt": 2 } } },
        doc! { "key": { "hid": 1 }, "name": "hidden", "hidden": true },
    ];
    for command in [
        doc! { "drop": "c" },
        doc! { "insert": "c", "documents": documents },
        doc! { "createIndexes": "c", "indexes": indexes.to_vec() },
    ] {
        wire.run(&command.into_iter().chain(doc! { "$db": database }).collect())?;
    }
    Ok(())
}

fn queries() -> Vec<Document> {
    let (both, many) = (doc! { "a": 1, "s": "x6" }, doc! { "b": 3 });
    let collation = || doc! { "locale": "en", "strength": 2 };
    vec![
        doc! { "min": { "a": 1 } },
        doc! { "min": { "a": 1 }, "hint": { "a": 1 } },
        doc! { "min": { "a": 1 }, "hint": "both" },
        doc! { "min": both.clone(), "hint": "both" },
        doc! { "min": both.clone(), "hint": "both", "skip": 1, "limit": 2 },
        doc! { "min": both.clone(), "hint": "both", "sort": { "a": -1 } },
        doc! { "min": both.clone(), "hint": "both", "sort": { "a": -1, "s": 1 }, "returnKey": true },
        doc! { "min": both.clone(), "hint": "both", "sort": { "d.e": -1 }, "projection": { "d": 1 } },
        doc! { "min": { "s": "x6", "a": 1 }, "hint": "both" },
        doc! { "min": both.clone(), "max": { "a": 3, "s": "x3" }, "hint": { "a": 1, "s": -1 } },
        doc! { "min": both.clone(), "max": { "s": "x3", "a": 3 }, "hint": "both" },
        doc! { "min": both.clone(), "max": both.clone(), "hint": "both" },
        doc! { "min": { "a": 2, "s": "x6" }, "max": both.clone(), "hint": "both" },
        doc! { "min": both, "max": { "b": 1 }, "hint": "both" },
        doc! { "max": { "a": 1, "s": "x1" }, "hint": "both" },
        doc! { "min": { "a": 1, "s": 1 }, "max": { "a": { "x": 1 }, "s": 2 }, "hint": "both", "returnKey": true },
        doc! { "max": many.clone(), "hint": "many" },
        doc! { "min": many.clone(), "max": { "b": 5 }, "hint": "many" },
        doc! { "min": many.clone(), "max": { "b": 5 }, "hint": "many", "sort": { "_id": -1 } },
        doc! { "min": many.clone(), "max": { "b": 5 }, "hint": "many", "filter": { "a": { "$gt": 2 } } },
        doc! { "min": many.clone(), "max": { "b": 5 }, "hint": "many", "returnKey": true },
        doc! { "min": many.clone(), "max": { "b": 5 }, "hint": "many", "showRecordId": true },
        doc! { "min": many.clone(), "max": {}, "hint": "many" },
        doc! { "min": {}, "hint": "many" },
        doc! { "min": {}, "max": {} },
        doc! { "min": many.clone(), "hint": "none" },
        doc! { "min": many.clone(), "hint": { "$natural": 1 } },
        doc! { "min": many.clone(), "max": { "b": 5 }, "hint": "many", "collation": collation() },
        doc! { "min": { "b": "x" }, "hint": "many", "collation": collation() },
        doc! { "min": { "b": [1, 2] }, "hint": "many" },
        doc! { "min": { "d.e": 5 }, "max": { "d.e": 2 }, "hint": "turned" },
        doc! { "min": { "d.e": 2 }, "max": { "d.e": 5 }, "hint": "turned" },
        doc! { "min": { "d": { "e": 2 } }, "hint": "turned" },
        doc! { "min": { "d.e": Bson::MaxKey }, "max": { "d.e": Bson::MinKey }, "hint": "turned" },
        doc! { "min": { "w.x": 3 }, "hint": "wild" },
        doc! { "min": { "q": 3 }, "hint": "sparse" },
        doc! { "min": { "p": Bson::Null }, "hint": "partial", "returnKey": true },
        doc! { "min": { "hid": Bson::Null }, "hint": "hidden" },
        doc! { "min": { "s": "X2" }, "hint": "words" },
        doc! { "min": { "s": 3 }, "hint": "words" },
        doc! { "min": { "s": "X2" }, "max": { "s": "X4" }, "hint": "words", "collation": collation() },
        doc! { "min": { "_id": 3 }, "max": { "_id": 6 }, "hint": "_id_", "sort": { "_id": -1 } },
        doc! { "min": { "_id": 3 }, "hint": { "_id": 1 }, "returnKey": true },
        doc! { "min": Bson::Null, "hint": "many" },
        doc! { "max": 3, "hint": "many" },
        doc! { "returnKey": true },
        doc! { "returnKey": true, "filter": { "_id": 3 } },
        doc! { "returnKey": true, "filter": { "b": 3 } },
        doc! { "returnKey": true, "filter": { "b": { "$gt": 4 } }, "hint": "many" },
        doc! { "returnKey": true, "filter": { "d.e": 3 }, "projection": { "d": 1, "_id": 0 }, "sort": { "_id": 1 } },
        doc! { "returnKey": true, "sort": { "a": 1, "s": -1 }, "limit": 3 },
        doc! { "returnKey": true, "hint": "many", "sort": { "_id": 1 } },
        doc! { "returnKey": true, "hint": { "$natural": -1 }, "limit": 2 },
        doc! { "returnKey": true, "projection": { "x": { "$bad": 1 } } },
        doc! { "returnKey": true, "showRecordId": true, "filter": { "d.e": 3 } },
        doc! { "returnKey": 1 },
        doc! { "showRecordId": Bson::Null },
        doc! { "showRecordId": true, "limit": 2 },
        doc! { "showRecordId": true, "projection": { "s": 1 }, "sort": { "s": -1 } },
        doc! { "showRecordId": true, "projection": { "b": 0, "d": 0 }, "hint": "turned" },
    ]
}

/// What a query is answered, and how often its explanation says it is.
fn answers(wire: &mut Wire, database: &str, query: &Document) -> Result<Document, Failed> {
    let find: Document = doc! { "find": "c" }.into_iter().chain(query.clone()).collect();
    let answer = wire.run(&find.clone().into_iter().chain(doc! { "$db": database }).collect())?;
    let found = answer.get_document("cursor").and_then(|cursor| cursor.get_array("firstBatch")).ok().cloned();
    let explained = wire.run(&doc! { "explain": find, "verbosity": "executionStats", "$db": database })?;
    let returned = explained.get_document("executionStats").and_then(|stats| stats.get_i32("nReturned")).ok();
    let plan = explained.get_document("queryPlanner").and_then(|planner| planner.get_document("winningPlan")).ok();
    let stage = plan.and_then(|plan| plan.get_str("stage").ok()).filter(|stage| *stage == "RETURN_KEY");
    Ok(
        doc! { "found": found, "code": answer.get("code"), "returned": returned, "explained": explained.get("code"), "stage": stage },
    )
}

fn beside(mongod: &str) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let address = mongod.trim_start_matches("mongodb://").split('/').next().unwrap_or_default();
    let (mut real, mut own) = (Wire::connect(address)?, Wire::connect(served.address())?);
    prepare(&mut real, "keys")?;
    prepare(&mut own, "keys")?;
    for query in queries() {
        let (expected, found) = (answers(&mut real, "keys", &query)?, answers(&mut own, "keys", &query)?);
        assert_eq!(found, expected, "{query}");
    }
    // In front of that mongod, the answers are its own.
    let folder = tempfile::tempdir()?;
    let served = Served::start_memory(folder.path(), mongod, &["--listen", "127.0.0.1:0"])?;
    let mut front = Wire::connect(served.address())?;
    for query in queries() {
        let (expected, found) = (answers(&mut real, "keys", &query)?, answers(&mut front, "keys", &query)?);
        assert_eq!((found.get("found"), found.get("code")), (expected.get("found"), expected.get("code")), "{query}");
    }
    Ok(())
}

fn refused() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let settings = "[[computable]]\nname = 'double'\ncollection = 'a.c'\nspec = \"{double: {$exists: true}}\"\n\
                    pipeline = \"[{$match: {n: {$exists: true}}}, {$project: {_id: 0, double: {$multiply: ['$n', 2]}}}]\"\n";
    std::fs::write(folder.path().join("rmem.toml"), settings)?;
    let served = Served::start(folder.path(), &[])?;
    let mut wire = Wire::connect(served.address())?;
    let collation = doc! { "locale": "en", "strength": 2 };
    let indexes = [
        doc! { "key": { "n": "hashed" }, "name": "hashed" },
        doc! { "key": { "s": 1 }, "name": "words", "collation": collation },
        doc! { "key": { "place": "2dsphere" }, "name": "places" },
    ];
    wire.run(&doc! { "insert": "c", "documents": [{ "_id": 1, "n": 1, "s": "x" }], "$db": "a" })?;
    wire.run(&doc! { "createIndexes": "c", "indexes": indexes.to_vec(), "$db": "a" })?;
    for query in [
        doc! { "filter": { "double": 2 }, "returnKey": true },
        doc! { "filter": { "double": 2 }, "showRecordId": true },
        doc! { "min": { "n": 1 }, "hint": "hashed" },
        doc! { "returnKey": true, "hint": "hashed" },
        doc! { "returnKey": true, "hint": "words" },
        doc! { "min": { "place": 1 }, "hint": "places" },
    ] {
        let find: Document = doc! { "find": "c" }.into_iter().chain(query).chain(doc! { "$db": "a" }).collect();
        let answer = wire.run(&find)?;
        assert_eq!(answer.get_i32("code")?, 115, "{find}: {answer}");
    }
    Ok(())
}
