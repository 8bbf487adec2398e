//! The codes of commands whose arguments are wrong.

use bson::{Bson, Document, doc, oid::ObjectId};
use libtest_mimic::Failed;

use super::wire::Wire;
use super::{Beside, Served};

/// What is compared with the answers of a mongod.
pub(super) const BESIDE: &[(&str, Beside)] = &[("serving::arguments::wrong_ones_have_the_codes_of_mongod", beside)];

/// A value of each of some types.
fn values() -> Vec<Bson> {
    vec![
        1.into(),
        1_i64.into(),
        1.5.into(),
        true.into(),
        "x".into(),
        Bson::Array(Vec::new()),
        Document::new().into(),
        Bson::Null,
        bson::DateTime::from_millis(0).into(),
        ObjectId::from_bytes([0; 12]).into(),
    ]
}

/// 1.5 as a decimal: 15, and an exponent of -1.
const ONE_AND_A_HALF: [u8; 16] = [15, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x3E, 0x30];

/// Numbers and others that are of a right type, but odd.
fn odd() -> Vec<Bson> {
    vec![
        false.into(),
        0.into(),
        (-1).into(),
        (1_i64 << 40).into(),
        f64::NAN.into(),
        Bson::Decimal128(bson::Decimal128::from_bytes(ONE_AND_A_HALF)),
        "".into(),
        vec![Bson::Int32(1)].into(),
        vec![Document::new()].into(),
        doc! { "x": 1 }.into(),
        Bson::MinKey,
    ]
}

/// Options of commands that are taken in any type that a mongod takes them in.
fn options() -> Vec<Document> {
    let with = |command: &Document, option: &str, value: &Bson| -> Document {
        command.clone().into_iter().chain([(option.to_owned(), value.clone())]).collect()
    };
    let all: Vec<Bson> = values().into_iter().chain(odd()).collect();
    let create = doc! { "create": "d" };
    let indexes = doc! { "createIndexes": "c", "indexes": [{ "key": { "q": 1 }, "name": "q" }] };
    let find = doc! { "find": "c" };
    let mut commands = Vec::new();
    for value in &all {
        for option in ["autoIndexId", "max", "pipeline", "recordPreImages", "size", "temp", "writeConcern"] {
            commands.push(with(&create, option, value));
        }
        for option in ["pipeline", "recordPreImages", "timeseries", "viewOn", "writeConcern"] {
            commands.push(with(&doc! { "collMod": "c" }, option, value));
        }
        for option in ["expireAfterSeconds", "forceNonUnique", "hidden", "keyPattern", "name", "unique"] {
            let index = with(&doc! { "name": "a_1" }, option, value);
            commands.push(doc! { "collMod": "c", "index": index });
        }
        for option in
            ["2dsphereIndexVersion", "background", "bits", "key", "max", "min", "name", "sparse", "unique", "v"]
        {
            let index = with(&doc! { "key": { "q": 1 }, "name": "q" }, option, value);
            commands.push(doc! { "createIndexes": "c", "indexes": [index] });
        }
        for option in ["ignoreUnknownIndexOptions", "readConcern"] {
            commands.push(with(&indexes, option, value));
        }
        commands.push(doc! { "createIndexes": "c", "indexes": value });
        for option in ["collation", "filter", "let", "max", "min", "noCursorTimeout", "oplogReplay"] {
            commands.push(with(&find, option, value));
        }
        for option in ["allowPartialResults", "projection", "returnKey", "singleBatch", "sort"] {
            commands.push(with(&find, option, value));
        }
        // A millisecond may be too short.
        let is_short = matches!(value, Bson::Int32(1) | Bson::Int64(1) | Bson::Decimal128(_));
        let generic = ["readConcern", "writeConcern", "maxTimeMS"];
        for option in generic.into_iter().filter(|option| *option != "maxTimeMS" || !is_short) {
            commands.push(with(&find, option, value));
            commands.push(with(&doc! { "aggregate": "c", "pipeline": [], "cursor": {} }, option, value));
            commands.push(with(&doc! { "count": "c" }, option, value));
            commands.push(with(&doc! { "insert": "c", "documents": [{}] }, option, value));
        }
        for command in ["aggregate", "collMod", "count", "distinct", "drop", "find", "findAndModify", "listIndexes"] {
            let rest = doc! { "key": "a", "pipeline": [], "cursor": {}, "remove": true };
            let known: &[&str] = match command {
                "aggregate" => &["pipeline", "cursor"],
                "distinct" => &["key"],
                "findAndModify" => &["remove"],
                _ => &[],
            };
            let rest = rest.into_iter().filter(|(name, _)| known.contains(&name.as_str()));
            commands.push([(command.to_owned(), value.clone())].into_iter().chain(rest).collect());
        }
    }
    // What rmem does not have is refused by its name where a mongod takes it.
    let is_no_flag = |value: &&Bson| !matches!(value, Bson::Boolean(true));
    for value in all.iter().filter(is_no_flag) {
        commands.extend(["awaitData", "tailable"].map(|option| with(&find, option, value)));
    }
    let is_no_number =
        |value: &&Bson| !matches!(value, Bson::Int32(0..) | Bson::Int64(_) | Bson::Double(_) | Bson::Decimal128(_));
    commands.extend(all.iter().filter(is_no_number).map(|value| with(&find, "ntoreturn", value)));
    for value in [Bson::Null, "x".into(), Document::new().into(), doc! { "x": 1 }.into(), doc! { "key": {} }.into()] {
        commands.push(with(&create, "clusteredIndex", &value));
    }
    for series in [
        doc! { "x": 1 },
        doc! { "timeField": 1 },
        doc! { "timeField": Bson::Null },
        doc! { "timeField": "t", "granularity": "days" },
        doc! { "timeField": "t", "bucketMaxSpanSeconds": 0 },
        doc! { "timeField": "t", "x": 1 },
    ] {
        commands.push(doc! { "create": "d", "timeseries": series });
    }
    for fields in
        [doc! { "x": 1 }, doc! {}, doc! { "fields": Bson::Null }, doc! { "fields": [1] }, doc! { "fields": 1 }]
    {
        commands.push(doc! { "create": "d", "encryptedFields": fields });
    }
    let images = doc! { "recordPreImages": true, "changeStreamPreAndPostImages": { "enabled": true } };
    commands.push(create.into_iter().chain(images.clone()).collect());
    commands.push(doc! { "collMod": "c" }.into_iter().chain(images).collect());
    for ids in [doc! { "v": Bson::Null }, doc! { "v": 1.5 }, doc! { "key": Bson::Null }] {
        let mut definition = doc! { "key": { "_id": 1 }, "name": "_id_" };
        definition.extend(ids);
        commands.push(doc! { "create": "d", "idIndex": definition });
    }
    commands
}

/// The command with an option of each type.
fn of_each_type(command: &Document, option: &str) -> Vec<Document> {
    let with = |value: Bson| command.clone().into_iter().chain([(option.to_owned(), value)]).collect();
    values().into_iter().map(with).collect()
}

fn commands() -> Vec<Document> {
    let (create, modify) = (doc! { "create": "d" }, doc! { "collMod": "c" });
    let rename = doc! { "renameCollection": "arguments.c", "to": "arguments.d" };
    let mut all = Vec::new();
    let common = ["validationLevel", "validationAction", "changeStreamPreAndPostImages", "bogus"];
    for option in common.iter().chain(&["size", "max", "flags", "autoIndexId", "storageEngine", "indexOptionDefaults"])
    {
        all.extend(of_each_type(&create, option));
    }
    for option in
        common.iter().chain(&["viewOn", "cappedSize", "cappedMax", "expireAfterSeconds", "timeseries", "dryRun"])
    {
        all.extend(of_each_type(&modify, option));
    }
    for option in ["dropTarget", "stayTemp"] {
        all.extend(of_each_type(&rename, option));
    }
    for option in ["includeBuildUUIDs", "includeIndexBuildInfo"] {
        all.extend(of_each_type(&doc! { "listIndexes": "c" }, option));
    }
    all.extend(of_each_type(&doc! { "dropIndexes": "c" }, "index"));
    for command in ["dropDatabase", "explain", "getLog", "create"] {
        all.extend(values().into_iter().map(|value| doc! { command: value }));
    }
    all.extend([doc! { "dropDatabase": 0 }, doc! { "dropDatabase": 2 }, doc! { "dropDatabase": -1.5 }]);
    for level in ["off", "moderate", "strict", "OFF", ""] {
        all.push(doc! { "create": "d", "validationLevel": level });
        all.push(doc! { "collMod": "c", "validationLevel": level });
    }
    for action in ["error", "warn", "Error"] {
        all.push(doc! { "collMod": "c", "validationAction": action });
    }
    for images in [doc! { "enabled": 1 }, doc! { "enabled": true }, doc! { "enabled": true, "x": 1 }, doc! { "x": 1 }] {
        all.push(doc! { "create": "d", "changeStreamPreAndPostImages": images.clone() });
        all.push(doc! { "collMod": "c", "changeStreamPreAndPostImages": images });
    }
    let key = doc! { "_id": 1 };
    for ids in [
        doc! { "key": key.clone(), "name": "_id_" },
        doc! { "key": key.clone() },
        doc! { "name": "_id_" },
        doc! { "key": key.clone(), "name": 1 },
        doc! { "key": key.clone(), "name": "" },
        doc! { "key": 1, "name": "_id_" },
        doc! { "key": {}, "name": "_id_" },
        doc! { "key": { "x": 1 }, "name": "_id_" },
        doc! { "key": { "_id": -1 }, "name": "_id_" },
        doc! { "key": { "_id": "1" }, "name": "_id_" },
        doc! { "key": key.clone(), "name": "_id_", "v": "x" },
        doc! { "key": key.clone(), "name": "_id_", "v": 3 },
        doc! { "key": key.clone(), "name": "_id_", "unique": true },
        doc! { "key": key.clone(), "name": "_id_", "bogus": 1 },
        doc! { "key": key, "name": "_id_", "collation": { "locale": "en" } },
    ] {
        all.push(doc! { "create": "d", "idIndex": ids });
    }
    for engine in [doc! { "wiredTiger": {} }, doc! { "wiredTiger": 1 }, doc! { "other": {} }] {
        all.push(doc! { "create": "d", "storageEngine": engine.clone() });
        all.push(doc! { "create": "d", "indexOptionDefaults": { "storageEngine": engine } });
    }
    for strength in values().into_iter().chain([0.into(), 5.9.into(), 6.into()]) {
        all.push(doc! { "find": "c", "collation": { "locale": "en", "strength": strength } });
    }
    for flag in values() {
        all.push(doc! { "find": "c", "collation": { "locale": "en", "numericOrdering": flag } });
    }
    all.extend([
        doc! { "create": "d", "capped": true },
        doc! { "create": "d", "expireAfterSeconds": 1 },
        doc! { "create": "d", "pipeline": [] },
        doc! { "create": "d", "temp": true },
        doc! { "create": "d", "timeseries": {} },
        doc! { "collMod": "none", "validationLevel": "x" },
        doc! { "collMod": "none" },
        doc! { "collMod": "c", "index": {} },
        doc! { "collMod": "c", "index": { "name": "_id_", "keyPattern": { "_id": 1 } } },
        doc! { "collMod": "c", "index": { "name": "none", "hidden": true } },
        doc! { "collMod": "c", "index": { "name": "_id_", "bogus": true } },
        doc! { "killSessions": 1 },
        doc! { "killAllSessions": [{ "user": 1, "db": "x" }] },
        doc! { "killAllSessions": [{ "user": "x" }] },
        doc! { "abortTransaction": 1, "query": 1, "$db": "admin" },
        doc! { "getParameter": 1, "logLevel": 1 },
        doc! { "getParameter": { "allParameters": "x" }, "$db": "admin" },
        doc! { "hostInfo": 1, "bogus": 1, "$db": "admin" },
        doc! { "aggregate": "c", "pipeline": [{ "$collStats": 1 }], "cursor": {} },
        doc! { "aggregate": "c", "pipeline": [{ "$collStats": { "latencyStats": { "histograms": 1 } } }], "cursor": {} },
    ]);
    let project =
        |expression: Bson| doc! { "aggregate": "c", "pipeline": [{ "$project": { "r": expression } }], "cursor": {} };
    for path in ["$", "$$", "$.", "$a.", "$a..b", "$.a", "$$.a", "$$1", "$$nothing", "$$ROOT.", "$$ROOT..a", "$a.$b"] {
        all.push(project(doc! { "$toString": path }.into()));
    }
    for number in [f64::INFINITY, f64::NAN, -1.5, -1.0, 0.0, 2.0, 101.0, 1e12] {
        let of = |expression: Document| project(expression.into());
        all.push(of(doc! { "$round": [1.5, number] }));
        all.push(of(doc! { "$trunc": [1.5, number] }));
        all.push(of(doc! { "$filter": { "input": [1], "cond": true, "limit": number } }));
        all.push(of(doc! { "$substrCP": ["abc", number, 1] }));
        all.push(of(doc! { "$substrCP": ["abc", 0, number] }));
    }
    for value in values().into_iter().chain([(-1).into()]) {
        for name in ["$maxDistance", "$minDistance"] {
            let filter = doc! { "loc": { "$near": [0, 0], name: value.clone() } };
            all.push(doc! { "find": "c", "filter": filter });
            let point = doc! { "type": "Point", "coordinates": [0, 0] };
            let filter = doc! { "loc": { "$near": { "$geometry": point, name: value.clone() } } };
            all.push(doc! { "find": "c", "filter": filter });
        }
        let near = doc! { "near": [0, 0], "distanceField": "d", "key": "loc", "maxDistance": value.clone() };
        all.push(doc! { "aggregate": "c", "pipeline": [{ "$geoNear": near }], "cursor": {} });
        let index = doc! { "key": { "q": 1 }, "name": "q", "expireAfterSeconds": value };
        all.push(doc! { "createIndexes": "c", "indexes": [index] });
    }
    all
}

/// Makes the collections what they were at first.
fn prepare(wire: &mut Wire) -> Result<(), Failed> {
    for prepare in [
        doc! { "drop": "d" },
        doc! { "drop": "c" },
        doc! { "insert": "c", "documents": [{ "_id": 1 }] },
        doc! { "createIndexes": "c", "indexes": [{ "key": { "a": 1 }, "name": "a_1" }] },
    ] {
        wire.run(&prepare.into_iter().chain(doc! { "$db": "arguments" }).collect())?;
    }
    Ok(())
}

/// Stages where they may not stand, and values, commands and databases that are not known.
fn misplaced() -> Vec<Document> {
    let pipeline =
        |collection: &str, stages: Vec<Document>| doc! { "aggregate": collection, "pipeline": stages, "cursor": {} };
    let count = || doc! { "$collStats": { "count": {} } };
    let changes = || doc! { "$changeStream": {} };
    let behind = |stage: Document| pipeline("c", vec![doc! { "$match": {} }, stage]);
    let within = |stage: Document| pipeline("c", vec![doc! { "$facet": { "x": [stage] } }]);
    let after = |token: Document| pipeline("c", vec![doc! { "$changeStream": { "resumeAfter": token } }]);
    vec![
        behind(count()),
        behind(doc! { "$indexStats": {} }),
        behind(changes()),
        within(count()),
        within(doc! { "$indexStats": {} }),
        within(changes()),
        pipeline("none", vec![count()]),
        pipeline("none", vec![doc! { "$collStats": { "storageStats": {} } }]),
        after(doc! {}),
        after(doc! { "_data": "" }),
        after(doc! { "_data": "8" }),
        after(doc! { "_data": "zz" }),
        after(doc! { "_data": 5 }),
        doc! { "explain": { "insert": "c", "documents": [{}] } },
        doc! { "explain": { "ping": 1 } },
        doc! { "explain": { "none": 1 } },
        doc! { "explain": { "find": "c" }, "verbosity": "all" },
        doc! { "find": "c", "readConcern": { "level": "past" } },
        doc! { "ping": 1, "readConcern": { "level": "past" } },
        doc! { "getCmdLineOpts": 1 },
        doc! { "getLog": "global", "$db": "arguments" },
        doc! { "replSetGetStatus": 1 },
    ]
}

fn code(wire: &mut Wire, command: &Document) -> Result<i32, Failed> {
    let database = match command.keys().next().map(String::as_str) {
        Some("renameCollection" | "getLog") => "admin",
        _ => "arguments",
    };
    let mut command = command.clone();
    command.entry("$db".to_owned()).or_insert_with(|| database.into());
    Ok(wire.run(&command)?.get_i32("code").unwrap_or_default())
}

fn beside(mongod: &str) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let served = Served::start(folder.path(), &[])?;
    let address = mongod.trim_start_matches("mongodb://").split('/').next().unwrap_or_default();
    let (mut real, mut own) = (Wire::connect(address)?, Wire::connect(served.address())?);
    let (mut different, mut is_changed) = (Vec::new(), true);
    for command in commands().into_iter().chain(options()).chain(misplaced()) {
        if is_changed {
            prepare(&mut real)?;
            prepare(&mut own)?;
        }
        let (expected, found) = (code(&mut real, &command)?, code(&mut own, &command)?);
        if expected != found {
            different.push(format!("{command}: {expected}, not {found}"));
        }
        // What is refused, and what reads, changes nothing.
        let reads = ["aggregate", "count", "distinct", "explain", "find", "getLog", "getParameter", "listIndexes"];
        is_changed = (expected == 0 || found == 0) && !reads.iter().any(|name| command.contains_key(name));
    }
    assert!(different.is_empty(), "{}", different.join("\n"));
    Ok(())
}
