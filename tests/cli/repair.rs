//! repair, and damaged memories.

use rusqlite::Connection;

use crate::lab::{Lab, assert_run};

/// A folder with a memory of three documents and an index in `robot.rmem`.
pub(crate) fn lab() -> Lab {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    lab.rmem(&["insert", "a.b", "[{_id: 1, n: 1}, {_id: 2, n: 2}, {_id: 3, n: 3}]"]).success();
    lab.rmem(&["index", "a.b", "{n: 1}"]).success();
    lab
}

pub(crate) fn sql(lab: &Lab, file: &str, statements: &str) {
    Connection::open(lab.path().join(file)).unwrap().execute_batch(statements).unwrap();
}

/// Changes a byte inside of the document with `_id: 2`.
pub(crate) const DAMAGE: &str = "UPDATE documents_1 SET body = CAST(substr(body, 1, 20) || x'2a' || substr(body, 22) AS BLOB) \
     WHERE position = 2";

#[test]
fn an_empty_file_is_a_memory_without_documents_and_another_program_s_file_is_none() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:empty.rmem");
    lab.write("empty.rmem", "");
    assert_eq!(lab.rmem(&["repair", "-o", "saved.rmem"]).success(), "0 collections, 0 documents, 0 indexes\n");
    assert_eq!(lab.rmem(&["--memory", "file:saved.rmem", "collections"]).success(), "");
    sql(&lab, "other.db", "CREATE TABLE t (x)");
    let refused = lab.rmem(&["--memory", "file:other.db", "repair", "-o", "saved2.rmem"]).exits(4);
    assert!(refused.stderr.contains("an SQLite database of another program"), "{refused}");
}

#[test]
fn repair_makes_indexes_anew() {
    let lab = lab();
    sql(&lab, "robot.rmem", "DELETE FROM entries_1");
    assert_eq!(lab.rmem(&["count", "a.b", "{n: 2}"]).success(), "0\n");
    assert_eq!(lab.rmem(&["repair"]).success(), "1 collection, 3 documents, 1 index\n");
    assert_eq!(lab.rmem(&["count", "a.b", "{n: 2}"]).success(), "1\n");
    lab.rmem(&["doctor", "--deep"]).success();
}

#[test]
fn repair_copies_what_can_be_read() {
    let lab = lab();
    sql(&lab, "robot.rmem", DAMAGE);
    let repaired = lab.rmem(&["repair", "-o", "saved.rmem"]).exits(1).stdout;
    let expected = "1 collection, 2 documents, 1 index\nlost: a.b: the document with _id 2: its checksum is wrong\n";
    assert_eq!(repaired, expected);
    let mut files: Vec<_> = std::fs::read_dir(lab.path()).unwrap().map(|file| file.unwrap().file_name()).collect();
    files.sort();
    assert_eq!(files, ["robot.rmem", "saved.rmem"]);
    let saved = lab.rmem(&["--memory", "file:saved.rmem", "query", "a.b", "{n: {$gt: 0}}"]).success();
    assert_eq!(saved, "{\"_id\":1,\"n\":1}\n{\"_id\":3,\"n\":3}\n");
    lab.rmem(&["--memory", "file:saved.rmem", "doctor", "--deep"]).success();
    assert_run!(lab.rmem(&["repair", "-o", "saved.rmem"]), @r"
    ------- stderr -------
    error: file:saved.rmem: exists already; name a file that does not exist yet
    [exit code: 4]
    ");
}

#[test]
fn a_damaged_document_stops_the_repair_in_place_also_without_an_index() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    lab.rmem(&["insert", "a.b", "[{_id: 1, n: 1}, {_id: 2, n: 2}, {_id: 3, n: 3}]"]).success();
    sql(&lab, "robot.rmem", DAMAGE);
    let refused = lab.rmem(&["repair"]).exits(4);
    assert!(refused.stderr.contains("the document with _id 2"), "{refused}");
}

#[test]
fn repair_copies_what_is_left_of_a_file_without_its_end() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    let lines: String = (0..2_000).map(|n| format!("{{_id: {n}, pad: '{}'}}\n", "x".repeat(200))).collect();
    lab.rmem_with(&["insert", "a.b"], &lines).success();
    let file = std::fs::File::options().write(true).open(lab.path().join("robot.rmem")).unwrap();
    let length = file.metadata().unwrap().len();
    for (percent, saved) in [(95, "a.rmem"), (70, "b.rmem")] {
        file.set_len(length * percent / 100).unwrap();
        lab.rmem(&["repair", "-o", saved]).exits(1);
        let count = lab.rmem(&["--memory", &format!("file:{saved}"), "count", "a.b"]).success();
        let count: u64 = count.trim().parse().unwrap();
        assert!(count > 20 * percent - 200, "{percent}: {count}");
    }
}

#[test]
fn repair_copies_the_collections_whose_names_can_be_read() {
    let lab = lab();
    lab.rmem(&["insert", "a.lost", "{_id: 1}"]).success();
    sql(&lab, "robot.rmem", "UPDATE collections SET name = CAST(x'ff' AS TEXT) WHERE name = 'lost'");
    let repaired = lab.rmem(&["repair", "-o", "saved.rmem"]).exits(1).stdout;
    assert_eq!(repaired, "1 collection, 3 documents, 1 index\nlost: a collection: its name cannot be read\n");
    assert_eq!(lab.rmem(&["--memory", "file:saved.rmem", "count", "a.b"]).success(), "3\n");
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
    // The other lines differ with the machine.
    let expected = "3 documents, 2 of them without a checksum (stored by an earlier rmem), 1 index";
    assert!(found.contains(expected), "{found}");
    let version = Connection::open(lab.path().join("robot.rmem")).unwrap();
    let version: i32 = version.query_row("PRAGMA user_version", [], |row| row.get(0)).unwrap();
    assert_eq!(version, 2);
}

/// A memory of 3000 documents with an index.
fn many() -> Lab {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    let lines: String = (0..3_000).map(|n| format!("{{_id: {n}, n: {n}}}\n")).collect();
    lab.rmem_with(&["insert", "a.b"], &lines).success();
    lab.rmem(&["index", "a.b", "{n: 1}"]).success();
    lab
}

#[test]
fn a_document_that_an_index_lists_and_that_is_gone_is_damage() {
    let lab = many();
    sql(&lab, "robot.rmem", "DELETE FROM documents_1 WHERE position = 1501");
    for args in [
        &["query", "a.b", "--sort", "{n: 1}"][..],
        &["query", "a.b", "{n: {$gte: 0}}", "--sort", "{n: -1}"],
        &["query", "a.b", "{n: {$gte: 0}}"],
        &["query", "a.b", "{n: 1500}"],
        &["query", "a.b", "{n: {$gte: 1500}}", "--sort", "{n: 1}", "--limit", "2"],
        &["query", "a.b", "{}", "--hint", "{n: 1}"],
        &["query", "a.b", "{$or: [{n: 1500}, {n: 7}]}"],
        &["count", "a.b", "{n: {$gt: 10}}"],
        &["update", "a.b", "{n: 1500}", "{$set: {m: 1}}"],
        &["delete", "a.b", "{n: 1500}"],
    ] {
        let run = lab.rmem(args).exits(4);
        let expected = "error: file:robot.rmem: it is damaged (an index lists a document that is not there)";
        assert!(run.stderr.starts_with(expected), "{args:?}: {run}");
    }
    lab.write(
        "problem.j2",
        "(define (problem p) {% for one in query('a.b', sort='{n: 1}') %}{{ one.n }} {% endfor %})",
    );
    let run = lab.rmem(&["gen-problem", "-t", "problem.j2"]).exits(4);
    assert!(run.stderr.contains("it is damaged (an index lists a document that is not there)"), "{run}");
    assert_eq!(lab.rmem(&["query", "a.b", "{n: 1499}"]).success(), "{\"_id\":1499,\"n\":1499}\n");
    lab.rmem(&["repair"]).success();
    assert_eq!(lab.rmem(&["query", "a.b", "--sort", "{n: 1}"]).success().lines().count(), 2_999);
}

#[test]
fn a_document_that_the_index_on_id_lists_and_that_is_gone_is_damage() {
    let lab = many();
    // The row goes, and its entry stays: while the table has no index on `_id`.
    let root = Connection::open(lab.path().join("robot.rmem")).unwrap();
    let index = "SELECT rootpage FROM sqlite_schema WHERE name = 'sqlite_autoindex_documents_1_1'";
    let root: i64 = root.query_row(index, [], |row| row.get(0)).unwrap();
    for statements in [
        "PRAGMA writable_schema = ON; DELETE FROM sqlite_schema WHERE name = 'sqlite_autoindex_documents_1_1';
         UPDATE sqlite_schema SET sql = replace(sql, ' UNIQUE', '') WHERE name = 'documents_1'",
        "DELETE FROM documents_1 WHERE position = 1501",
        &format!(
            "PRAGMA writable_schema = ON;
             UPDATE sqlite_schema SET sql = replace(sql, 'key BLOB NOT NULL', 'key BLOB NOT NULL UNIQUE')
             WHERE name = 'documents_1';
             INSERT INTO sqlite_schema VALUES ('index', 'sqlite_autoindex_documents_1_1', 'documents_1', {root}, NULL)"
        ),
    ] {
        sql(&lab, "robot.rmem", statements);
    }
    assert!(lab.rmem(&["insert", "a.b", "{_id: 1500}"]).exits(5).stderr.contains("_id: 1500"), "the entry is there");
    for args in [
        &["query", "a.b", "--sort", "{_id: 1}"][..],
        &["query", "a.b", "--sort", "{_id: -1}"],
        &["query", "a.b", "{_id: {$gt: 100}}"],
        &["query", "a.b", "{_id: 1500}"],
    ] {
        let run = lab.rmem(args).exits(4);
        assert!(run.stderr.starts_with("error: file:robot.rmem: it is damaged ("), "{args:?}: {run}");
    }
}

#[test]
fn what_is_no_file_of_a_memory_is_said_and_leaves_no_file() {
    let lab = Lab::empty();
    std::os::unix::fs::symlink("loop.rmem", lab.path().join("loop.rmem")).unwrap();
    assert!(std::process::Command::new("mkfifo").arg(lab.path().join("pipe.rmem")).status().unwrap().success());
    for (source, expected) in [
        ("/dev/null", "cannot open file:/dev/null: it is a device; name a file"),
        ("pipe.rmem", "cannot open file:pipe.rmem: it is a pipe; name a file"),
        ("loop.rmem", "cannot open file:loop.rmem: it is a symbolic link that leads back to itself"),
        ("/tmp", "cannot open file:/tmp: it is a directory; name a file in it"),
        ("/proc/version", "file:/proc/version: it is not an rmem memory; name another file"),
    ] {
        let run = lab.rmem(&["--memory", &format!("file:{source}"), "repair", "-o", "saved.rmem"]).exits(4);
        assert!(run.stderr.contains(expected), "{run}");
    }
    for options in [&["repair", "-o", "saved.rmem"][..], &["repair"]] {
        let run = lab.rmem(&[&["--memory", "file:missing.rmem"], options].concat()).exits(4);
        assert!(run.stderr.contains("cannot open file:missing.rmem: there is no such file; check its name"), "{run}");
    }
    let mut left: Vec<_> = std::fs::read_dir(lab.path()).unwrap().map(|file| file.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["loop.rmem", "pipe.rmem"]);
}

#[test]
fn a_memory_without_its_marks_is_saved_and_one_without_its_tables_is_called_damaged() {
    let lab = lab();
    let whole = std::fs::read(lab.path().join("robot.rmem")).unwrap();
    sql(&lab, "robot.rmem", "PRAGMA application_id = 0; PRAGMA user_version = 0");
    let refused = lab.rmem(&["count", "a.b"]).exits(4);
    let expected =
        "file:robot.rmem: it is damaged: its first page has lost the marks of a memory; copy what can be read";
    assert!(refused.stderr.contains(expected), "{refused}");
    lab.rmem(&["repair", "-o", "saved.rmem"]).success();
    assert_eq!(lab.rmem(&["--memory", "file:saved.rmem", "count", "a.b"]).success(), "3\n");
    for length in [100, 1_000] {
        std::fs::write(lab.path().join("robot.rmem"), &whole[..length]).unwrap();
        let refused = lab.rmem(&["repair", "-o", "none.rmem"]).exits(4);
        assert!(refused.stderr.contains("file:robot.rmem: it is damaged"), "{length}: {refused}");
    }
    let mut beheaded = whole;
    beheaded[..16].fill(0);
    std::fs::write(lab.path().join("robot.rmem"), beheaded).unwrap();
    for args in [&["repair", "-o", "none.rmem"][..], &["count", "a.b"]] {
        let refused = lab.rmem(args).exits(4);
        assert!(refused.stderr.contains("it is damaged: it does not begin as a memory does"), "{refused}");
    }
    assert!(!lab.path().join("none.rmem").exists());
}

#[test]
fn a_document_under_the_key_of_another_stops_the_repair_in_place() {
    let lab = lab();
    sql(&lab, "robot.rmem", "UPDATE documents_1 SET key = x'00' WHERE position = 2");
    let refused = lab.rmem(&["repair"]).exits(4);
    let expected = "file:robot.rmem: the document with _id 2 of a.b is damaged: it is stored under another _id";
    assert!(refused.stderr.contains(expected), "{refused}");
    lab.rmem(&["repair", "-o", "saved.rmem"]).success();
    lab.rmem(&["--memory", "file:saved.rmem", "doctor", "--deep"]).success();
    assert_eq!(
        lab.rmem(&["--memory", "file:saved.rmem", "query", "a.b", "{_id: 2}"]).success(),
        "{\"_id\":2,\"n\":2}\n"
    );
}
