//! Damaged memories: found, named, and repaired as far as possible; and copies of intact ones.

use rusqlite::Connection;

use crate::lab::Lab;

/// A folder with a memory of three documents and an index in `robot.rmem`.
fn lab() -> Lab {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    lab.rmem(&["insert", "a.b", "[{_id: 1, n: 1}, {_id: 2, n: 2}, {_id: 3, n: 3}]"]).success();
    lab.rmem(&["index", "a.b", "{n: 1}"]).success();
    lab
}

fn sql(lab: &Lab, file: &str, statements: &str) {
    Connection::open(lab.path().join(file)).unwrap().execute_batch(statements).unwrap();
}

/// Changes a byte inside of the document with `_id: 2`.
const DAMAGE: &str = "UPDATE documents_1 SET body = CAST(substr(body, 1, 20) || x'2a' || substr(body, 22) AS BLOB) \
     WHERE position = 2";

#[test]
fn a_damaged_document_is_named_and_never_answered() {
    let lab = lab();
    sql(&lab, "robot.rmem", DAMAGE);
    for command in [
        &["query", "a.b"][..],
        &["query", "a.b", "{m: 99}"],
        &["count", "a.b", "{m: {$exists: false}}"],
        &["aggregate", "a.b", "[{$group: {_id: null, n: {$sum: '$n'}}}]"],
        &["update", "a.b", "{}", "{$set: {x: 1}}", "--many"],
        &["dump", "a.b", "-o", "world.json"],
        &["dump", "--all", "-o", "folder"],
        &["diff", "file:robot.rmem", "mem:"],
    ] {
        let refused = lab.rmem(command).exits(4);
        let named = refused.stderr.contains("file:robot.rmem: the document with _id 2 of a.b is damaged");
        assert!(named, "{command:?}: {refused}");
    }
    assert_eq!(lab.rmem(&["query", "a.b", "{_id: 1}"]).success(), "{\"_id\":1,\"n\":1}\n");
}

#[test]
fn doctor_finds_damaged_documents_and_indexes() {
    let lab = lab();
    let sound = lab.rmem(&["doctor", "--deep"]).success();
    assert!(sound.contains("checked    file:robot.rmem: 1 collections, 3 documents, 1 indexes\n"), "{sound}");
    sql(&lab, "robot.rmem", DAMAGE);
    sql(&lab, "robot.rmem", "DELETE FROM entries_1 WHERE position = 3; INSERT INTO entries_1 VALUES (x'00', 77)");
    let found = lab.rmem(&["doctor", "--deep"]).exits(4).stdout;
    for line in [
        "damage     a.b: the document with _id 2 is damaged: its checksum is wrong\n",
        "damage     a.b: the index n_1 has 1 of 1 keys too few for the document with _id 3\n",
        "damage     a.b: the index n_1 has 2 keys of no document\n",
    ] {
        assert!(found.contains(line), "{line}{found}");
    }
}

#[test]
fn repair_makes_indexes_anew() {
    let lab = lab();
    sql(&lab, "robot.rmem", "DELETE FROM entries_1");
    assert_eq!(lab.rmem(&["count", "a.b", "{n: 2}"]).success(), "0\n");
    assert_eq!(lab.rmem(&["repair"]).success(), "1 collections, 3 documents, 1 indexes\n");
    assert_eq!(lab.rmem(&["count", "a.b", "{n: 2}"]).success(), "1\n");
    lab.rmem(&["doctor", "--deep"]).success();
}

#[test]
fn repair_copies_what_can_be_read() {
    let lab = lab();
    sql(&lab, "robot.rmem", DAMAGE);
    let repaired = lab.rmem(&["repair", "-o", "saved.rmem"]).exits(1).stdout;
    let expected = "1 collections, 2 documents, 1 indexes\nlost: a.b: the document with _id 2: its checksum is wrong\n";
    assert_eq!(repaired, expected);
    let saved = lab.rmem(&["--memory", "file:saved.rmem", "query", "a.b", "{n: {$gt: 0}}"]).success();
    assert_eq!(saved, "{\"_id\":1,\"n\":1}\n{\"_id\":3,\"n\":3}\n");
    lab.rmem(&["--memory", "file:saved.rmem", "doctor", "--deep"]).success();
    let again = lab.rmem(&["repair", "-o", "saved.rmem"]).exits(4);
    assert!(again.stderr.contains("exists already"), "{again}");
}

#[test]
fn repair_reads_around_damaged_pages() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    let lines: String = (0..2_000).map(|n| format!("{{_id: {n}, pad: '{}'}}\n", "x".repeat(200))).collect();
    lab.rmem_with(&["insert", "a.b"], &lines).success();
    let path = lab.path().join("robot.rmem");
    let mut bytes = std::fs::read(&path).unwrap();
    // A page in the middle of the file is overwritten.
    let (page, at) = (4096, bytes.len() / 4096 / 2);
    bytes[at * page..(at + 1) * page].fill(0xff);
    std::fs::write(&path, bytes).unwrap();
    lab.rmem(&["doctor", "--deep"]).exits(4);
    lab.rmem(&["repair", "-o", "saved.rmem"]).exits(1);
    let count = lab.rmem(&["--memory", "file:saved.rmem", "count", "a.b"]).success();
    let count: usize = count.trim().parse().unwrap();
    assert!((1_900..2_000).contains(&count), "{count}");
}

#[test]
fn a_file_of_version_1_gets_checksums_as_it_is_changed() {
    let lab = lab();
    // As version 1 stored documents: without the checksum of 8 bytes.
    sql(&lab, "robot.rmem", "UPDATE documents_1 SET body = substr(body, 1, length(body) - 8); PRAGMA user_version = 1");
    assert_eq!(lab.rmem(&["count", "a.b"]).success(), "3\n");
    lab.rmem(&["update", "a.b", "{_id: 1}", "{$set: {n: 5}}"]).success();
    let found = lab.rmem(&["doctor", "--deep"]).success();
    let expected = "3 documents, 2 of them without a checksum (stored by an earlier rmem), 1 indexes";
    assert!(found.contains(expected), "{found}");
    let version = Connection::open(lab.path().join("robot.rmem")).unwrap();
    let version: i32 = version.query_row("PRAGMA user_version", [], |row| row.get(0)).unwrap();
    assert_eq!(version, 2);
}

#[test]
fn a_backup_is_the_memory_at_one_moment() {
    let lab = lab();
    lab.rmem(&["backup", "copy.rmem"]).success();
    lab.rmem(&["delete", "a.b", "--all"]).success();
    let copied = lab.rmem(&["--memory", "file:copy.rmem", "query", "a.b", "{n: 2}"]).success();
    assert_eq!(copied, "{\"_id\":2,\"n\":2}\n");
    lab.rmem(&["--memory", "file:copy.rmem", "insert", "a.b", "{_id: 4}"]).success();
    lab.rmem(&["--memory", "file:copy.rmem", "doctor", "--deep"]).success();
    let again = lab.rmem(&["backup", "copy.rmem"]).exits(4);
    assert!(again.stderr.contains("exists already; name a file that does not exist yet"), "{again}");
    lab.rmem(&["backup", "missing/copy.rmem"]).exits(4);
    let mut files: Vec<_> =
        std::fs::read_dir(lab.path()).unwrap().map(|file| file.unwrap().file_name().into_string().unwrap()).collect();
    files.sort();
    assert_eq!(files, ["copy.rmem", "robot.rmem"]);
}

#[test]
fn a_store_that_cannot_be_read_is_4_wherever_it_is_read() {
    let lab = Lab::empty();
    lab.write("text.rmem", &"this is no memory ".repeat(100));
    for command in [
        &["dump", "--all"][..],
        &["dump", "a.b", "-o", "world.json"],
        &["dump", "a.b", "-o", "folder"],
        &["diff", "file:text.rmem", "mem:"],
        &["restore", "world.json"],
        &["plan", "list"],
    ] {
        lab.write("world.json", "{\"a.b\": []}");
        let refused = lab.rmem(&[&["--memory", "file:text.rmem"], command].concat()).exits(4);
        assert!(refused.stderr.contains("file:text.rmem: is not an rmem memory"), "{command:?} {refused}");
    }
}
