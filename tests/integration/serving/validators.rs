//! Validators of collections: what is refused, and why, as a mongod says it.

use bson::{Bson, Document, doc};
use libtest_mimic::Failed;

use super::front::answers_alike;
use super::wire::Wire;
use super::{Beside, Case, Served, TIMEOUT, code};

pub(super) const CASES: &[(&str, Case)] = &[
    ("validators_hold_in_transactions_and_for_writes_that_are_sent_again", in_transactions),
    ("a_document_that_is_stored_with_a_warning_is_logged", warned),
    ("an_answer_about_many_documents_that_validators_refuse_can_be_sent", many),
];

/// What is compared with the answers of a mongod.
pub(super) const BESIDE: &[(&str, Beside)] =
    &[("serving::validators::writes_are_refused_as_mongod_refuses_them", beside)];

const DATABASE: &str = "validators";

/// Commands, each of which finds what those before it have left.
fn commands() -> Vec<Document> {
    let listed = || doc! { "listCollections": 1, "filter": { "name": "c" } };
    let insert = |documents: Vec<Document>| doc! { "insert": "c", "documents": documents };
    let update = |filter: Document, update: Bson| doc! { "update": "c", "updates": [{ "q": filter, "u": update }] };
    let set = |id: i32, n: i32| update(doc! { "_id": id }, doc! { "$set": { "n": n } }.into());
    let upserted = |filter: Document| {
        let change = doc! { "$set": { "n": 0 } };
        doc! { "update": "c", "updates": [{ "q": filter, "u": change, "upsert": true }] }
    };
    let bypassing = |mut command: Document| {
        command.insert("bypassDocumentValidation", true);
        command
    };
    let modified = |options: Document| doc! { "collMod": "c" }.into_iter().chain(options).collect::<Document>();
    let found = || doc! { "find": "c", "sort": { "_id": 1 } };
    let results = |stage: Document| doc! { "aggregate": "from", "pipeline": [stage], "cursor": {} };
    let mut commands = vec![
        doc! { "insert": "from", "documents": [{ "_id": 1, "n": 1 }, { "_id": 2, "n": -1 }] },
        doc! { "create": "c", "validator": { "n": { "$gt": 0 } } },
        doc! { "create": "c", "validator": { "n": { "$gt": 0 } } },
        listed(),
        insert(vec![doc! { "_id": 1, "n": 0 }]),
        insert(vec![doc! { "_id": 1, "n": 1 }, doc! { "_id": 2, "n": 0 }, doc! { "_id": 3, "n": 3 }]),
        doc! {
            "insert": "c", "ordered": false,
            "documents": [{ "_id": 4, "n": 4 }, { "_id": 5 }, { "_id": 6, "n": 6 }, { "_id": 4, "n": 0 }, { "_id": 4, "n": 1 }],
        },
        bypassing(insert(vec![doc! { "_id": 7, "n": 0 }, doc! { "_id": 8, "n": "x" }])),
        set(1, -1),
        set(7, 0),
        update(doc! { "_id": 7 }, doc! { "$set": { "m": 1 } }.into()),
        set(7, 7),
        bypassing(set(7, 0)),
        update(doc! { "_id": 1 }, doc! { "m": 1 }.into()),
        update(doc! { "_id": 1 }, vec![doc! { "$set": { "n": { "$subtract": ["$n", 5] } } }].into()),
        upserted(doc! { "_id": 99 }),
        doc! { "update": "c", "updates": [{ "q": {}, "u": { "$inc": { "n": -1 } }, "multi": true }] },
        found(),
        doc! {
            "update": "c",
            "updates": [
                { "q": { "_id": 4 }, "u": { "$inc": { "n": 1 } } },
                { "q": { "_id": 4 }, "u": { "$set": { "n": -1 } } },
                { "q": { "_id": 4 }, "u": { "$inc": { "n": 1 } } },
            ],
        },
        doc! { "findAndModify": "c", "query": { "_id": 4 }, "update": { "$set": { "n": -1 } } },
        doc! { "findAndModify": "c", "query": { "_id": 300 }, "update": { "$set": { "n": -1 } }, "upsert": true },
        bypassing(doc! { "findAndModify": "c", "query": { "_id": 4 }, "update": { "$set": { "n": -1 } } }),
        doc! { "delete": "c", "deletes": [{ "q": { "_id": 4 }, "limit": 1 }] },
        modified(doc! { "validationLevel": "moderate" }),
        listed(),
        insert(vec![doc! { "_id": 20, "n": 0 }]),
        update(doc! { "_id": 7 }, doc! { "$set": { "m": 1 } }.into()),
        set(1, 0),
        upserted(doc! { "_id": 99 }),
        modified(doc! { "validationAction": "warn" }),
        insert(vec![doc! { "_id": 21, "n": 0 }]),
        modified(doc! { "validationAction": "error", "validationLevel": "off" }),
        insert(vec![doc! { "_id": 22, "n": 0 }]),
        modified(doc! { "validator": {}, "validationLevel": "strict" }),
        listed(),
        insert(vec![doc! { "_id": 23, "n": 0 }]),
        modified(doc! { "validator": { "$where": "1" } }),
        modified(doc! { "validator": { "n": { "$exists": true } } }),
        insert(vec![doc! { "_id": 24 }]),
        found(),
    ];
    for stage in
        [doc! { "$out": "c" }, doc! { "$merge": "c" }, doc! { "$merge": { "into": "c", "whenMatched": "replace" } }]
    {
        for is_bypassing in [false, true] {
            commands.extend([
                doc! { "drop": "c" },
                doc! { "create": "c", "validator": { "n": { "$gt": 0 } } },
                insert(vec![doc! { "_id": 2, "n": 9 }]),
                if is_bypassing { bypassing(results(stage.clone())) } else { results(stage.clone()) },
                listed(),
                found(),
            ]);
        }
    }
    commands
}

/// Validators that are set, or refused.
fn validators() -> Vec<Document> {
    vec![
        doc! { "$where": "1" },
        doc! { "n": { "$near": [1, 2] } },
        doc! { "n": { "$not": { "$near": [1, 2] } } },
        doc! { "$text": { "$search": "x" } },
        doc! { "$nor": [{ "$text": { "$search": "x" } }] },
        doc! { "$expr": { "$lt": ["$n", "$$NOW"] } },
        doc! { "$expr": { "$eq": ["$$other", 1] } },
        doc! { "$expr": { "$function": { "body": "x", "args": [], "lang": "js" } } },
        doc! { "$expr": { "$rand": {} } },
        doc! { "$sampleRate": 0.5 },
        doc! { "$jsonSchema": { "properties": { "a": { "enum": [{ "x": 1, "y": 2 }, { "y": 2, "x": 1 }] } } } },
        doc! { "$jsonSchema": { "enum": [1, 2.5, 1_i64] } },
        doc! { "$jsonSchema": { "required": ["a", "b", "a"] } },
        doc! { "$other": 1 },
        doc! { "n": { "$other": 1 } },
        doc! { "$jsonSchema": { "other": 1 } },
        doc! { "$jsonSchema": 3 },
        doc! { "$or": [] },
        doc! { "n": { "$type": "other" } },
        doc! { "$comment": "x" },
        doc! {},
    ]
}

/// Validators with documents that do not pass them, at all or in some way.
fn refusals() -> Vec<(Document, Vec<Document>)> {
    let schema = |schema: Document| doc! { "$jsonSchema": schema };
    let point = doc! { "type": "Point", "coordinates": [1, 1] };
    vec![
        (doc! { "n": 1 }, vec![doc! { "n": 2 }, doc! {}, doc! { "n": [2, 3] }, doc! { "n": [] }]),
        (doc! { "n": { "$ne": 1 } }, vec![doc! { "n": 1 }, doc! { "n": [2, 1] }]),
        (doc! { "n": { "$lte": 1 } }, vec![doc! { "n": "x" }, doc! { "n": (2..30).collect::<Vec<i32>>() }]),
        (doc! { "n": { "$in": [1, "x"] } }, vec![doc! { "n": 2 }, doc! { "n": [[1]] }]),
        (doc! { "n": { "$nin": [1, Bson::Null] } }, vec![doc! { "n": 1 }, doc! {}]),
        (doc! { "n": { "$exists": true, "$type": "int" } }, vec![doc! {}, doc! { "n": [1.5, "x"] }]),
        (doc! { "n": { "$exists": false } }, vec![doc! { "n": 1 }]),
        (doc! { "n": { "$regex": "^x", "$options": "i" } }, vec![doc! { "n": "y" }, doc! { "n": 1 }]),
        (doc! { "n": { "$mod": [3, 1] } }, vec![doc! { "n": 3 }, doc! { "n": ["x", "y"] }]),
        (doc! { "n.m": { "$size": 2 } }, vec![doc! { "n": [{ "m": [1] }, { "m": [] }] }, doc! { "n": { "m": 1 } }]),
        (doc! { "n": { "$all": [1, 2] } }, vec![doc! { "n": [1] }, doc! { "n": 3 }]),
        (doc! { "n": { "$elemMatch": { "m": 1 } } }, vec![doc! { "n": [{ "m": 2 }] }, doc! { "n": 2 }]),
        (doc! { "n": { "$bitsAllSet": 3 } }, vec![doc! { "n": 1 }, doc! { "n": "x" }]),
        (doc! { "n": { "$geoWithin": { "$center": [[0, 0], 1] } } }, vec![doc! { "n": [5, 5] }, doc! { "n": "x" }]),
        (doc! { "n": { "$not": { "$geoIntersects": { "$geometry": &point } } } }, vec![doc! { "n": &point }]),
        (doc! { "$and": [{ "n": 1 }, { "$or": [{ "m": 1 }, { "n": 3, "m": 2 }] }] }, vec![doc! { "n": 3 }, doc! {}]),
        (
            doc! { "$nor": [{ "n": 1, "m": 1 }, { "n": { "$ne": 2 } }, { "$nor": [{ "n": 3 }] }] },
            vec![doc! {
                "n": 1, "m": 1,
            }],
        ),
        (doc! { "n": { "$not": { "$gt": 1, "$lt": 5 } } }, vec![doc! { "n": 2 }]),
        (doc! { "$expr": { "$eq": ["$n", 1] }, "m": 1 }, vec![doc! { "n": 2 }]),
        (schema(doc! { "required": ["b", "a"] }), vec![doc! {}, doc! { "a": 1 }]),
        (
            schema(doc! {
                "title": "T", "required": ["a"],
                "properties": {
                    "a": { "bsonType": "int", "minimum": 1, "maximum": 9, "description": "the a" },
                    "b": { "type": "string", "enum": ["x"], "minLength": 2 },
                },
            }),
            vec![doc! { "a": 0, "b": 1 }, doc! { "a": 10, "b": "y" }, doc! { "b": "x" }],
        ),
        (
            schema(doc! { "properties": { "a": { "minimum": 3, "exclusiveMinimum": true, "multipleOf": 5 } } }),
            vec![doc! { "a": 3 }],
        ),
        (
            schema(doc! { "properties": { "_id": {}, "a": {} }, "additionalProperties": false }),
            vec![doc! { "a": 1, "b": 2, "c": 3 }],
        ),
        (
            schema(doc! {
                "properties": { "_id": {} }, "patternProperties": { "^s": { "bsonType": "string" } },
                "additionalProperties": { "bsonType": "int" },
            }),
            vec![doc! { "sa": 1, "sb": 2, "t": "x" }],
        ),
        (schema(doc! { "minProperties": 5 }), vec![doc! { "a": 1 }]),
        (
            schema(doc! { "dependencies": { "a": ["c", "b"], "d": { "required": ["e"] } } }),
            vec![doc! { "a": 1, "d": 1 }],
        ),
        (
            schema(doc! {
                "properties": { "a": {
                    "bsonType": "array", "minItems": 4, "uniqueItems": true,
                    "items": { "required": ["x"], "properties": { "x": { "minimum": 3 } } },
                } },
            }),
            vec![doc! { "a": [{ "x": 4 }, {}, { "x": 4 }] }, doc! { "a": 1 }],
        ),
        (
            schema(doc! {
                "properties": { "a": { "items": [{ "bsonType": "int" }], "additionalItems": false } },
            }),
            vec![doc! { "a": ["x", 2] }],
        ),
        (
            schema(doc! {
                "allOf": [{ "required": ["a"] }, { "title": "t", "required": ["b"] }],
                "anyOf": [{ "required": ["c"] }, { "properties": { "a": { "bsonType": "string" } } }],
                "not": { "required": ["a"] },
            }),
            vec![doc! { "a": 1 }],
        ),
        (
            schema(doc! { "oneOf": [{ "required": ["a"] }, { "required": ["b"] }] }),
            vec![doc! {}, doc! { "a": 1, "b": 1 }],
        ),
        (schema(doc! { "bsonType": "array" }), vec![doc! {}]),
        // The order of fields does not matter.
        (
            schema(doc! { "properties": { "a": { "uniqueItems": true } } }),
            vec![
                doc! { "a": [{ "b": 1, "c": [{ "x": 1, "y": 2 }] }, { "d": 1 }, { "c": [{ "y": 2, "x": 1 }], "b": 1 }] },
                doc! { "a": [3, "x", 2, 3.0, "x"] },
            ],
        ),
        (
            schema(doc! { "properties": { "a": { "enum": [{ "x": 1, "y": 2 }, [{ "x": 1, "y": 2 }]] } } }),
            vec![doc! { "a": { "x": 1 } }, doc! { "a": [{ "y": 2 }] }],
        ),
        // What has the type of no keyword beside it, and what no document can be.
        (
            schema(doc! { "properties": {
                "a": { "type": "boolean", "minimum": 3, "minLength": 3, "minItems": 3, "required": ["b"], "enum": [1] },
                "b": { "bsonType": ["bool", "null"], "minimum": 3, "pattern": "x" },
                "c": { "bsonType": "int", "minimum": 3, "exclusiveMinimum": false },
            } }),
            vec![doc! { "a": 1, "b": 1, "c": 1.5 }, doc! { "a": "x", "b": "y" }, doc! { "a": [1] }, doc! { "a": {} }],
        ),
        (
            schema(doc! {
                "allOf": [{ "title": "t", "bsonType": "int" }, { "title": "u", "allOf": [{ "enum": [1] }] }],
                "anyOf": [{ "type": "array" }, { "required": ["b"], "description": "d" }],
                "dependencies": { "a": { "type": "null" }, "c": { "enum": [1] } },
            }),
            vec![doc! { "a": 1, "c": 1 }],
        ),
        (
            schema(doc! {
                "properties": {
                    "a": { "items": { "title": "t", "bsonType": "int" } },
                    "b": { "items": [{ "title": "t" }], "additionalItems": { "title": "u", "bsonType": "int" } },
                },
                "patternProperties": { "^s": { "title": "v", "bsonType": "int" } },
                "additionalProperties": { "description": "w", "bsonType": ["objectId", "int"] },
            }),
            vec![doc! { "a": ["x"], "b": [1, "x"], "s": "x", "t": "x" }],
        ),
        (
            doc! { "$and": [schema(doc! { "title": "t", "required": ["b"] }), { "c": 1 }, schema(doc! { "title": "u", "type": "null" })] },
            vec![doc! { "a": 1 }],
        ),
        (doc! { "$nor": [schema(doc! { "description": "d" })] }, vec![doc! { "a": 1 }]),
        (doc! { "n": { "$mod": [3, 1] }, "m": { "$regex": "x" } }, vec![doc! { "n": [], "m": [] }]),
        // What would be too large is shortened.
        (
            schema(doc! { "title": "T", "properties": { "a": { "maxLength": 1, "pattern": "y", "title": "t" } } }),
            vec![doc! { "a": "x".repeat(7 << 20) }],
        ),
        (doc! { "$nor": [schema(doc! { "required": ["a"] })] }, vec![doc! { "a": 1 }]),
    ]
}

/// What of an answer is compared: all but words, and what is drawn.
fn seen(answer: &Document) -> Document {
    let without_words = |error: &Document| -> Document {
        let kept = error.iter().filter(|(name, _)| *name != "errmsg");
        kept.map(|(name, value)| (name.clone(), value.clone())).collect()
    };
    let errors = answer.get_array("writeErrors").into_iter().flatten().filter_map(Bson::as_document);
    let batch = answer.get_document("cursor").and_then(|cursor| cursor.get_array("firstBatch"));
    let batch = batch.into_iter().flatten().filter_map(Bson::as_document).map(|found| match found.get("options") {
        Some(options) => options.clone(),
        None => found.clone().into(),
    });
    doc! {
        "code": answer.get("code"), "codeName": answer.get("codeName"), "n": answer.get("n"),
        "nModified": answer.get("nModified"), "value": answer.get("value"), "errInfo": answer.get("errInfo"),
        "writeErrors": errors.map(without_words).collect::<Vec<_>>(), "batch": batch.collect::<Vec<_>>(),
    }
}

fn run(wire: &mut Wire, command: &Document) -> Result<Document, Failed> {
    wire.run(&command.clone().into_iter().chain(doc! { "$db": DATABASE }).collect())
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
        expected.push(seen(&run(&mut real, &command)?));
        assert_eq!(seen(&run(&mut own, &command)?), *expected.last().ok_or("nothing was asked")?, "{command}");
    }
    for validator in validators() {
        for wire in [&mut real, &mut own] {
            run(wire, &doc! { "drop": "c" })?;
        }
        let create = doc! { "create": "c", "validator": &validator };
        let (real, own) = (run(&mut real, &create)?, run(&mut own, &create)?);
        assert_eq!(own.get("code"), real.get("code"), "{validator}: {own}");
    }
    for (validator, documents) in refusals() {
        for wire in [&mut real, &mut own] {
            run(wire, &doc! { "drop": "c" })?;
            run(wire, &doc! { "create": "c", "validator": &validator })?;
        }
        for mut document in documents {
            document.insert("_id", 1);
            let insert = doc! { "insert": "c", "documents": [&document] };
            let (real, own) = (seen(&run(&mut real, &insert)?), seen(&run(&mut own, &insert)?));
            assert_eq!(real.get_array("writeErrors")?.len(), 1, "{validator} takes {document}");
            assert_eq!(own, real, "{validator}: {document}");
        }
    }
    // In front of that mongod, the answers are its own.
    run(&mut real, &doc! { "dropDatabase": 1 })?;
    answers_alike(mongod, &commands(), &expected, |wire, command| Ok(seen(&run(wire, command)?)))?;
    run(&mut real, &doc! { "dropDatabase": 1 })?;
    Ok(())
}

fn in_transactions() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let client = served.client()?;
    let mut wire = Wire::connect(served.address())?;
    let validator = doc! { "$jsonSchema": {
        "required": ["name"], "additionalProperties": false,
        "properties": { "_id": {}, "name": { "bsonType": "string" } },
    } };
    run(&mut wire, &doc! { "create": "c", "validator": validator })?;
    let things = client.database(DATABASE).collection::<Document>("c");
    // The driver sends these with numbers, so that they may be sent again.
    things.insert_one(doc! { "_id": 1, "name": "A" }).run()?;
    assert_eq!(code(things.insert_one(doc! { "_id": 2 }).run()), Some(121));
    let mut session = client.start_session().run()?;
    session.start_transaction().run()?;
    things.insert_one(doc! { "_id": 3, "name": "C" }).session(&mut session).run()?;
    let change = things.update_one(doc! { "_id": 1 }, doc! { "$set": { "name": 5 } }).session(&mut session).run();
    assert_eq!(code(change), Some(121));
    assert!(session.commit_transaction().run().is_err(), "it ended with the write that was refused");
    assert_eq!(things.count_documents(doc! {}).run()?, 1);
    session.start_transaction().run()?;
    things.insert_one(doc! { "_id": 4 }).bypass_document_validation(true).session(&mut session).run()?;
    session.commit_transaction().run()?;
    assert_eq!(things.count_documents(doc! {}).run()?, 2);
    Ok(())
}

fn many() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let mut wire = Wire::connect(served.address())?;
    let parts: Vec<Document> = (0..50).map(|n| doc! { "text": n }).collect();
    run(&mut wire, &doc! { "create": "c", "validator": { "$and": parts } })?;
    let documents: Vec<Document> = (0..300).map(|n| doc! { "_id": n, "text": "x".repeat(4_000) }).collect();
    let answer = run(&mut wire, &doc! { "insert": "c", "documents": documents, "ordered": false })?;
    let errors: Vec<&Document> = answer.get_array("writeErrors")?.iter().filter_map(Bson::as_document).collect();
    let has = |nth: usize, name: &str| errors[nth].get_document("errInfo").is_ok_and(|info| info.contains_key(name));
    assert!(errors.len() == 300 && has(0, "details") && has(299, "note") && has(299, "failingDocumentId"));
    Ok(())
}

fn warned() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let log = folder.path().join("log.jsonl");
    let served = Served::start(folder.path(), &["--log", log.to_str().ok_or("no path")?])?;
    let mut wire = Wire::connect(served.address())?;
    run(&mut wire, &doc! { "create": "c", "validator": { "n": 1 }, "validationAction": "warn" })?;
    let answer = run(&mut wire, &doc! { "insert": "c", "documents": [{ "_id": 7, "n": 2 }, { "_id": 8, "n": 1 }] })?;
    assert_eq!(answer.get_i32("n")?, 2);
    let end = std::time::Instant::now() + TIMEOUT / 2;
    let text = loop {
        let text = std::fs::read_to_string(&log)?;
        if text.contains("warning") || std::time::Instant::now() > end {
            break text;
        }
        std::thread::sleep(std::time::Duration::from_millis(20));
    };
    let warnings: Vec<&str> = text.lines().filter(|line| line.contains("\"warning\"")).collect();
    assert!(warnings.len() == 1 && warnings[0].contains("validators.c: the document with _id 7"), "{text}");
    Ok(())
}
