//! Damaged fixtures: nothing that reads them panics, and errors have a place.
//!
//! What is done with each input is what the fuzz targets in `fuzz/` do.
//! `RMEM_FUZZ_CASES` wants more than a normal run has.

#[path = "../../fuzz/inputs.rs"]
mod inputs;

use std::path::Path;

use bson::{RawDocumentBuf, doc};
use proptest::prelude::*;
use proptest::sample::{Index, select};
use proptest::test_runner::{Config, TestRunner};
use rmem::formats::mongodump::{ArchiveWriter, Metadata};

/// How many inputs of a format a normal run damages.
const CASES: u32 = 2000;

/// Pieces that mean something in one of the formats, or are rarely thought of.
const PIECES: [&str; 42] = [
    "(",
    ")",
    "{",
    "}",
    "[",
    "]",
    "<<",
    ">>",
    "<<#",
    "<</",
    "{{",
    "}}",
    "{%",
    "%}",
    "\"",
    "'",
    "/",
    "\\",
    ":",
    ",",
    ";",
    "|",
    "$",
    ".",
    "-",
    "?",
    "\n",
    "\r",
    "\t",
    "\0",
    "é",
    "\u{feff}",
    "😀",
    "0",
    "99999999999999999999",
    "1e999",
    "-0",
    "null",
    "$date",
    "(((((((((((((((((((((((((((((((((",
    "{a:{a:{a:{a:{a:{a:{a:{a:{a:{a:",
    "[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[",
];

/// A change of an input.
#[derive(Debug, Clone)]
enum Damage {
    Cut(Index, usize),
    Repeat(Index, usize),
    Piece(Index, &'static str),
    Byte(Index, u8),
    End(Index),
}

fn damage() -> impl Strategy<Value = Damage> {
    prop_oneof![
        1 => (any::<Index>(), 1..40usize).prop_map(|(at, length)| Damage::Cut(at, length)),
        1 => (any::<Index>(), 1..40usize).prop_map(|(at, length)| Damage::Repeat(at, length)),
        3 => (any::<Index>(), select(&PIECES[..])).prop_map(|(at, piece)| Damage::Piece(at, piece)),
        1 => (any::<Index>(), any::<u8>()).prop_map(|(at, byte)| Damage::Byte(at, byte)),
        1 => any::<Index>().prop_map(Damage::End),
    ]
}

fn damaged(mut bytes: Vec<u8>, damages: &[Damage]) -> Vec<u8> {
    for damage in damages {
        let end = bytes.len();
        match damage {
            Damage::Cut(at, length) => {
                let at = at.index(end + 1);
                bytes.drain(at..(at + length).min(end));
            }
            Damage::Repeat(at, length) => {
                let at = at.index(end + 1);
                let copy = bytes[at..(at + length).min(end)].to_vec();
                bytes.splice(at..at, copy);
            }
            Damage::Piece(at, piece) => {
                let at = at.index(end + 1);
                bytes.splice(at..at, piece.bytes());
            }
            Damage::Byte(at, byte) if end > 0 => bytes[at.index(end)] = *byte,
            Damage::Byte(..) => {}
            Damage::End(at) => bytes.truncate(at.index(end + 1)),
        }
    }
    bytes
}

/// Gives damaged seeds to `read`; `cost` times fewer than of a cheap format.
fn fuzz(seeds: Vec<Vec<u8>>, cost: u32, read: fn(&[u8])) {
    assert!(!seeds.is_empty());
    let wanted = std::env::var("RMEM_FUZZ_CASES").map_or(CASES, |text| text.parse().expect("a number"));
    let cases = (wanted / cost).max(1);
    let config = Config { cases, failure_persistence: None, ..Config::default() };
    let inputs = (select(seeds), proptest::collection::vec(damage(), 0..4));
    let result = TestRunner::new(config).run(&inputs, |(seed, damages)| {
        read(&damaged(seed, &damages));
        Ok(())
    });
    if let Err(error) = result {
        panic!("{error}");
    }
}

/// The files below some paths that end in one of these ways.
fn files(paths: &[&str], endings: &[&str]) -> Vec<Vec<u8>> {
    let mut found = Vec::new();
    let mut waiting: Vec<_> = paths.iter().map(|path| Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).collect();
    while let Some(path) = waiting.pop() {
        if path.is_dir() {
            let entries = std::fs::read_dir(&path).expect("a folder");
            waiting.extend(entries.map(|entry| entry.expect("an entry").path()));
        } else if endings.iter().any(|ending| path.to_string_lossy().ends_with(ending)) {
            found.push(std::fs::read(&path).expect("a file"));
        }
    }
    found.sort();
    // The longest add nothing but time.
    found.retain(|bytes| bytes.len() < 6000);
    found
}

fn texts(texts: &[&str]) -> Vec<Vec<u8>> {
    texts.iter().map(|text| text.as_bytes().to_vec()).collect()
}

fn documents() -> Vec<RawDocumentBuf> {
    let documents = [doc! {}, doc! { "_id": 1, "a": [1, 2.5, "x", { "b": null }] }, doc! { "d": bson::DateTime::MIN }];
    documents.iter().map(|document| RawDocumentBuf::try_from(document).expect("a document")).collect()
}

#[test]
fn damaged_shell_syntax_is_an_error_with_a_place() {
    let mut seeds = texts(&[
        "{relation:'on-table', n:{$gt: 3}, re: /a/i, d: ISODate('2020-01-01'), o: ObjectId('0123456789abcdef01234567')}",
        "{\"$oid\": 1, a: NumberLong(3), b: NumberDecimal('1.5'), c: BinData(0, 'YWI='), t: Timestamp(1, 2)} // end",
        "[{$match: {a: 1}}, {$project: {b: '$a',},},]",
        "{\"a.b\": [{\"_id\": {\"$numberLong\": \"7\"}}], \"c.d\": []}",
    ]);
    seeds.extend(files(&["fixtures"], &[".json"]));
    fuzz(seeds, 1, inputs::shell);
}

#[test]
fn a_damaged_domain_is_an_error_with_a_place() {
    fuzz(
        files(&["domains", "fixtures/pddl", "fixtures/tasks", "fixtures/plans"], &["domain.pddl", "dom.pddl"]),
        4,
        inputs::pddl_domain,
    );
}

#[test]
fn a_damaged_problem_is_an_error_with_a_place() {
    fuzz(
        files(&["fixtures/pddl", "fixtures/tasks", "fixtures/plans"], &["problem.pddl", "p_plan.pddl"]),
        4,
        inputs::pddl_problem,
    );
}

#[test]
fn a_damaged_plan_is_an_error_with_a_place() {
    fuzz(files(&["fixtures/plans", "fixtures/transcripts"], &[".txt", ".out", ".plan", "stdout"]), 2, inputs::plan);
}

#[test]
fn damaged_facts_are_an_error_with_a_place() {
    fuzz(files(&["fixtures/clips"], &[".clp", ".txt"]), 1, inputs::clips);
}

#[test]
fn a_damaged_template_is_an_error_with_a_place() {
    let templates = || files(&["templates", "fixtures/problem"], &[".tmpl", ".j2"]);
    fuzz(templates(), 1, inputs::marker);
    fuzz(templates(), 8, inputs::template);
}

#[test]
fn a_damaged_bson_file_is_an_error() {
    let whole: Vec<u8> = documents().iter().flat_map(|document| document.as_bytes().to_vec()).collect();
    fuzz(vec![whole, documents()[1].as_bytes().to_vec()], 1, inputs::bson);
}

/// A message of the wire protocol with a command in it.
#[cfg(feature = "serve")]
fn message(operation: i32, body: &[u8]) -> Vec<u8> {
    let length = i32::try_from(16 + body.len()).expect("a length");
    let mut message: Vec<u8> = [length, 1, 0, operation].iter().flat_map(|number| number.to_le_bytes()).collect();
    message.extend_from_slice(body);
    message
}

#[cfg(feature = "serve")]
#[test]
fn a_damaged_message_is_an_error() {
    use std::io::Write as _;
    let command =
        RawDocumentBuf::try_from(&doc! { "insert": "c", "$db": "a", "documents": [{ "a": 1 }] }).expect("raw");
    let sequence =
        [b"\x01\x21\0\0\0documents\0".as_slice(), documents()[0].as_bytes(), documents()[0].as_bytes()].concat();
    let plain = [&[0; 5], command.as_bytes()].concat();
    let checked = [&[1, 0, 0, 0, 0], command.as_bytes(), &[0; 4]].concat();
    let query = [&[0; 4], b"admin.$cmd\0".as_slice(), &[0; 8], command.as_bytes()].concat();
    let mut packed = [2013_i32.to_le_bytes(), i32::try_from(plain.len()).expect("a length").to_le_bytes()].concat();
    packed.push(2);
    let mut encoder = flate2::write::ZlibEncoder::new(packed, flate2::Compression::fast());
    encoder.write_all(&plain).expect("written");
    let seeds = vec![
        message(2013, &plain),
        message(2013, &[plain.as_slice(), &sequence].concat()),
        message(2013, &checked),
        message(2004, &query),
        message(2012, &encoder.finish().expect("packed")),
    ];
    fuzz(seeds, 1, inputs::wire);
}

#[test]
fn a_damaged_archive_is_an_error() {
    let collections = [Metadata::plain("b"), Metadata::plain("c")];
    let named = collections.iter().map(|metadata| ("a", metadata));
    let mut archive = ArchiveWriter::new(Vec::new(), named).expect("an archive");
    for document in documents() {
        archive.document("a", "b", &document).expect("written");
    }
    archive.end("a", "b").expect("written");
    archive.end("a", "c").expect("written");
    fuzz(vec![archive.finish()], 1, inputs::archive);
}

#[test]
fn damaged_metadata_is_an_error_with_a_place() {
    let seeds = texts(&[
        r#"{"options":{},"indexes":[{"v":2,"key":{"_id":1},"name":"_id_"}],"collectionName":"b","type":"view"}"#,
    ]);
    fuzz(seeds, 1, inputs::metadata);
}

#[test]
fn no_query_update_or_pipeline_makes_the_store_panic() {
    let seeds = texts(&[
        "{a: {$gt: 1, $in: [1, 'x', null]}, $or: [{b: {$elemMatch: {c: 1}}}, {d: {$type: 'int', $mod: [2, 1]}}]}",
        "{$set: {'a.0.b': 1}, $inc: {n: 1}, $push: {l: {$each: [1], $sort: -1, $slice: 2, $position: 0}}, $pull: {k: {$gt: 1}}}",
        "{$project: {a: {$add: ['$b', 1]}, s: {$substrCP: ['$s', 0, 2]}, d: {$dateToString: {date: '$d', format: '%Y'}}}}",
        "{$group: {_id: '$a', n: {$sum: 1}, t: {$topN: {n: 2, sortBy: {a: 1}, output: '$b'}}}}",
        "{a: 1, 'b.c': -1, d: {$slice: [1, 2]}, 'e.$': 1, $jsonSchema: {properties: {a: {minimum: 1, pattern: 'x'}}}}",
        "{$lookup: {from: 'b', localField: 'a', foreignField: 'c', as: 'd', pipeline: [{$limit: 1}]}}",
        "{$bucket: {groupBy: '$a', boundaries: [0, 1, 2], default: 'x'}, $expr: {$regexMatch: {input: '$s', regex: '(a|b)*c'}}}",
    ]);
    fuzz(seeds, 1, inputs::query);
}

#[test]
#[ignore = "nested loops of thousands of steps take minutes; by hand, with --ignored"]
fn expressions_that_describe_large_values_end_within_the_limits() {
    let seeds =
        vec![vec![2, 3, 4], vec![7; 20], vec![0x33, 8, 8, 8], vec![6, 0x16, 0x26], vec![0x35, 12, 1], vec![15; 9]];
    fuzz(seeds, 40, inputs::bomb);
}
