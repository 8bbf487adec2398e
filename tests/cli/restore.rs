//! restore.

use std::fs;

use crate::lab::{Lab, assert_run};

/// A memory with two namespaces.
pub(crate) fn lab() -> Lab {
    let lab = Lab::new();
    lab.rmem(&[
        "insert",
        "robmem.blocks",
        "{_id: 2, name: 'A', n: NumberLong(3), _robmem_info: {persistent: false}}",
        "{_id: 1, name: 'B', at: ISODate('2026-01-02T03:04:05Z'), pose: {x: [1, 2.5, null]}}",
    ])
    .success();
    // Another program may have named a collection so; a person would not.
    lab.write("other.json", r#"{"other.a.b/c": [{"_id": "x"}]}"#);
    lab.rmem(&["restore", "other.json"]).success();
    fs::remove_file(lab.path().join("other.json")).unwrap();
    lab
}

pub(crate) fn dumped(args: &[&str]) -> Lab {
    let lab = lab();
    lab.rmem(&[&["dump", "--all", "-o", "dump"], args].concat()).success();
    lab
}

fn all(lab: &Lab) -> String {
    lab.rmem(&["dump", "--all"]).success()
}

pub(crate) fn changed(lab: &Lab) {
    lab.rmem(&["update", "robmem.blocks", "{_id: 1}", "{$set: {name: 'C'}}"]).success();
    lab.rmem(&["delete", "robmem.blocks", "{_id: 2}"]).success();
    lab.rmem(&["insert", "robmem.blocks", "{_id: 3}"]).success();
}

#[test]
fn what_is_restored_is_what_was_dumped() {
    for options in [&[][..], &["--gzip"]] {
        let lab = dumped(options);
        let before = all(&lab);
        for way in [&[][..], &["--drop"]] {
            let other = Lab::new();
            let path = lab.path().join("dump");
            let report = other.rmem(&[&["restore", path.to_str().unwrap()], way].concat()).success();
            let blocks = report.lines().find(|line| line.contains("robmem.blocks")).unwrap();
            assert!(blocks.contains(r#""inserted":2,"replaced":0,"skipped":0"#), "{report}");
            assert_eq!(all(&other), before);
        }
        assert!(before.contains("persistent"));
    }
}

#[test]
fn restoring_merges_and_prints_what_it_did() {
    let lab = dumped(&[]);
    changed(&lab);
    let before = all(&lab);
    let foreseen = lab.rmem(&["restore", "dump", "--dry-run"]).success();
    assert_eq!(all(&lab), before, "a dry run changed something");
    let report = lab.rmem(&["restore", "dump"]).success();
    assert_eq!(
        report,
        "{\"namespace\":\"other.a.b/c\",\"inserted\":0,\"replaced\":0,\"skipped\":1}\n\
         {\"namespace\":\"robmem.blocks\",\"inserted\":1,\"replaced\":1,\"skipped\":0}\n"
    );
    assert_eq!(foreseen, report);
    assert_eq!(lab.rmem(&["distinct", "robmem.blocks", "_id"]).success().lines().count(), 3);
    assert_run!(lab.rmem(&["restore", "dump"]), @r#"
    {"namespace":"other.a.b/c","inserted":0,"replaced":0,"skipped":1}
    {"namespace":"robmem.blocks","inserted":0,"replaced":0,"skipped":2}
    ------- stderr -------
    [exit code: 0]
    "#);
}

#[test]
fn with_drop_a_collection_is_replaced_as_a_whole() {
    let lab = dumped(&[]);
    let before = all(&lab);
    changed(&lab);
    let foreseen = lab.rmem(&["restore", "dump", "--drop", "--dry-run"]).success();
    assert!(lab.rmem(&["count", "robmem.blocks", "{_id: 3}"]).success() == "1\n", "a dry run changed something");
    let report = lab.rmem(&["restore", "dump", "--drop"]);
    assert_run!(report, @r#"
    {"namespace":"other.a.b/c","inserted":1,"replaced":0,"skipped":0,"dropped":1}
    {"namespace":"robmem.blocks","inserted":2,"replaced":0,"skipped":0,"dropped":2}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_eq!(foreseen, report.stdout);
    assert_eq!(all(&lab), before);
}

#[test]
fn a_failure_under_drop_leaves_the_old_content() {
    let lab = dumped(&[]);
    let mut bytes = fs::read(lab.path().join("dump/robmem/blocks.bson")).unwrap();
    let twice = bytes.clone();
    bytes.extend(twice);
    fs::write(lab.path().join("dump/robmem/blocks.bson"), bytes).unwrap();
    changed(&lab);
    let before = all(&lab);
    assert_run!(lab.rmem(&["restore", "dump", "--drop"]), @r"
    ------- stderr -------
    error: cannot restore robmem.blocks; nothing was changed
      caused by: robmem.blocks already has a document with _id: 2
    [exit code: 5]
    ");
    assert_eq!(all(&lab), before);
    assert_eq!(lab.rmem(&["collections"]).success(), "other.a.b/c\nrobmem.blocks\n");
}

#[test]
fn ids_are_proposed_for_documents_without_one_alone() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    let nested = (0..300).fold(b"\x05\0\0\0\0".to_vec(), |inner, _| {
        let length = u32::try_from(inner.len() + 8).unwrap().to_le_bytes();
        [&length[..], b"\x03a\0", &inner, b"\0"].concat()
    });
    fs::create_dir(lab.path().join("d")).unwrap();
    fs::write(lab.path().join("d/deep.bson"), nested).unwrap();
    fs::write(lab.path().join("d/plain.bson"), b"\x05\0\0\0\0").unwrap();
    let refused = lab.rmem(&["restore", "d/deep.bson", "--into", "a.b"]).exits(3);
    assert!(!refused.stderr.contains("--add-ids"), "{refused}");
    let refused = lab.rmem(&["restore", "d/plain.bson", "--into", "a.b"]).exits(3);
    assert!(refused.stderr.contains("the document has no _id; --add-ids gives it one"), "{refused}");
}

#[test]
fn a_damaged_byte_and_a_link_to_itself_are_said_in_plain_words() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    lab.rmem(&["insert", "a.b", "{_id: 1}"]).success();
    lab.rmem(&["dump", "--all", "--archive", "-o", "whole"]).success();
    let whole = fs::read(lab.path().join("whole")).unwrap();
    for at in 4..whole.len() {
        let mut bytes = whole.clone();
        bytes[at] = 0xff;
        fs::write(lab.path().join("damaged"), bytes).unwrap();
        if at % 7 == 0 || whole[at..].starts_with(b"a\0\x02") {
            let run = lab.rmem(&["restore", "damaged", "--dry-run"]);
            assert!(!run.stderr.contains("Error {") && !run.stderr.contains("not BSON: BSON error"), "{at}: {run}");
        }
    }
    std::os::unix::fs::symlink("l1", lab.path().join("l1")).unwrap();
    for command in
        [&["restore", "l1"][..], &["gen-problem", "--template", "l1"], &["--memory", "file:l1", "count", "a.b"]]
    {
        let refused = lab.rmem(command);
        assert!(refused.stderr.contains("it is a symbolic link that leads back to itself; name a file"), "{refused}");
    }
}

#[test]
fn one_file_or_one_database_is_restored_too() {
    let lab = dumped(&[]);
    lab.rmem(&["restore", "dump/robmem/blocks.bson", "--into", "copy.blocks"]).success();
    lab.rmem(&["restore", "dump/other"]).success();
    assert_eq!(lab.rmem(&["count", "copy.blocks"]).success(), "2\n");
    assert_run!(lab.rmem(&["restore", "dump", "--into", "copy.blocks"]), @r"
    ------- stderr -------
    error: --into takes a dump of one namespace, and dump has other.a.b/c, robmem.blocks
    [exit code: 2]
    ");
    lab.shell("cd dump/robmem && rmem restore blocks.bson --dry-run").success();
}

#[test]
fn a_world_file_is_restored_and_skipped_again() {
    let lab = lab();
    lab.rmem(&["dump", "--all", "-o", "world.json"]).success();
    changed(&lab);
    assert_run!(lab.rmem(&["restore", "world.json", "--drop"]), @r#"
    {"namespace":"other.a.b/c","inserted":1,"replaced":0,"skipped":0,"dropped":1}
    {"namespace":"robmem.blocks","inserted":2,"replaced":0,"skipped":0,"dropped":2}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_eq!(all(&lab), lab.read("world.json"));
    assert_run!(lab.rmem_with(&["restore", "-"], &lab.read("world.json")), @r#"
    {"namespace":"other.a.b/c","inserted":0,"replaced":0,"skipped":1}
    {"namespace":"robmem.blocks","inserted":0,"replaced":0,"skipped":2}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem_with(&["restore", "-"], "{\"nodot\": []}"), @r#"
    ------- stderr -------
    error: <stdin> is not a world file
      caused by: <stdin>:1:2: `nodot` is not a namespace: it has no dot; expected DATABASE.COLLECTION, like robmem.worldmodel
      |
    1 | {"nodot": []}
      |  ^^^^^^^
    [exit code: 3]
    "#);
}

#[test]
fn a_world_file_is_read_from_a_pipe() {
    let lab = lab();
    lab.rmem(&["dump", "--all", "-o", "world.json"]).success();
    let piped = ["cat world.json | rmem restore /dev/stdin", "gzip -c world.json | rmem restore /dev/stdin"];
    let others = ["gzip -c world.json | rmem restore -", "mkfifo fifo; cat world.json > fifo & rmem restore fifo"];
    for line in piped.iter().chain(&others) {
        assert_run!(lab.shell(line), @r#"
        {"namespace":"other.a.b/c","inserted":0,"replaced":0,"skipped":1}
        {"namespace":"robmem.blocks","inserted":0,"replaced":0,"skipped":2}
        ------- stderr -------
        [exit code: 0]
        "#);
    }
    assert_run!(lab.shell("cat world.json | rmem diff /dev/stdin world.json"), @r"
    ------- stderr -------
    [exit code: 0]
    ");
    lab.rmem(&["dump", "robmem.blocks", "-o", "dump"]).success();
    assert_run!(lab.shell("cat dump/robmem/blocks.bson | rmem restore /dev/stdin --into a.b"), @r"
    ------- stderr -------
    error: /dev/stdin: a dump of mongodump is read several times, which a pipe cannot be; write it to a file first
    [exit code: 3]
    ");
    assert_run!(lab.shell("printf '{a: 1}' | rmem restore /dev/stdin"), @r"
    ------- stderr -------
    error: /dev/stdin is not a world file
      caused by: /dev/stdin:1:5: expected an array of documents `[…]`, found `1`
      |
    1 | {a: 1}
      |     ^
      = hint: `rmem insert NS --file /dev/stdin` reads documents, such as JSON lines
    [exit code: 3]
    ");
}

#[test]
fn a_damaged_file_is_named_with_its_place_and_changes_nothing() {
    for packed in [false, true] {
        let lab = dumped(if packed { &["--gzip"] } else { &[] });
        let name = if packed { "blocks.bson.gz" } else { "blocks.bson" };
        let path = lab.path().join("dump/robmem").join(name);
        let whole = fs::read(&path).unwrap();
        lab.rmem(&["delete", "robmem.blocks", "{_id: 1}"]).success();
        let before = all(&lab);
        let mut damages = vec![whole[..whole.len() - 3].to_vec()];
        if !packed {
            let mut flipped = whole.clone();
            flipped[4] = 0x66;
            damages.push(flipped);
            damages.push([&whole[..], &[7, 0, 0]].concat());
            damages.push([&whole[..], &[5, 0, 0, 0, 0]].concat());
        }
        for damage in damages {
            fs::write(&path, damage).unwrap();
            for way in [&[][..], &["--drop"], &["--dry-run"]] {
                let failed = lab.rmem(&[&["restore", "dump"], way].concat()).exits(3);
                // Where a packed file ends is its compressor's.
                assert!(failed.stderr.contains(&format!("dump/robmem/{name}: byte ")), "{failed}");
                assert_eq!(all(&lab), before);
            }
        }
    }
}

#[test]
fn a_world_with_a_mistake_changes_nothing() {
    let lab = lab();
    let before = all(&lab);
    lab.write("bad.json", "{\"robmem.blocks\": [{\"_id\": 9}, {\"_id\": ]}");
    assert_run!(lab.rmem(&["restore", "bad.json"]), @r#"
    ------- stderr -------
    error: bad.json is not a world file
      caused by: bad.json:1:40: expected a value, found `]`
      |
    1 | {"robmem.blocks": [{"_id": 9}, {"_id": ]}
      |                                        ^
      = hint: the `{` at 1:32 is not closed
    [exit code: 3]
    "#);
    assert_eq!(all(&lab), before);
    assert_run!(lab.rmem(&["restore", "missing"]), @r"
    ------- stderr -------
    error: cannot read missing
      caused by: there is no such file or folder
    [exit code: 3]
    ");
    lab.write("text.md", "# No world\n");
    assert_run!(lab.rmem(&["restore", "text.md"]), @r#"
    ------- stderr -------
    error: text.md is not a world file
      caused by: text.md:1:1: expected a world `{"database.collection": [documents…], …}`
      |
    1 | # No world
      | ^
    [exit code: 3]
    "#);
    fs::create_dir(lab.path().join("empty")).unwrap();
    assert_run!(lab.rmem(&["restore", "empty"]), @r"
    ------- stderr -------
    error: empty: there is nothing to restore; expected DATABASE/COLLECTION.bson, as mongodump writes it
    [exit code: 3]
    ");
}

#[test]
fn an_archive_holds_everything_in_one_file() {
    for options in [&[][..], &["--gzip"]] {
        let lab = lab();
        lab.rmem(&[&["dump", "--all", "--archive", "-o", "all.json"], options].concat()).success();
        let before = all(&lab);
        lab.rmem(&["diff", "all.json", "all.json"]).success();
        changed(&lab);
        assert_run!(lab.rmem(&["restore", "all.json", "--drop"]), @r#"
        {"namespace":"other.a.b/c","inserted":1,"replaced":0,"skipped":0,"dropped":1}
        {"namespace":"robmem.blocks","inserted":2,"replaced":0,"skipped":0,"dropped":2}
        ------- stderr -------
        [exit code: 0]
        "#);
        assert_eq!(all(&lab), before);
        let bytes = fs::read(lab.path().join("all.json")).unwrap();
        fs::write(lab.path().join("cut"), &bytes[..bytes.len() - 60]).unwrap();
        // Where it ends depends on the compression.
        let failed = lab.rmem(&["restore", "cut"]).exits(3);
        assert!(failed.stderr.contains("cut: byte "), "{failed}");
        assert_run!(lab.rmem(&["restore", "all.json", "--into", "x.y"]), @r"
        ------- stderr -------
        error: --into takes a dump of one namespace, and all.json has other.a.b/c, robmem.blocks
        [exit code: 2]
        ");
    }
}

#[test]
fn what_is_the_servers_own_is_left_out_with_a_warning() {
    let lab = dumped(&[]);
    fs::write(lab.path().join("dump/robmem/system.users.bson"), b"").unwrap();
    lab.write("dump/robmem/seen.metadata.json", r#"{"options":{"viewOn":"blocks"},"indexes":[]}"#);
    lab.write("dump/robmem/blocks.metadata.json", r#"{"indexes":[{"key":{"n":"geoHaystack"},"name":"n_1"}]}"#);
    assert_run!(lab.rmem(&["restore", "dump"]), @r#"
    {"namespace":"other.a.b/c","inserted":0,"replaced":0,"skipped":1}
    {"namespace":"robmem.blocks","inserted":0,"replaced":0,"skipped":2}
    ------- stderr -------
    warning: dump/robmem/seen.metadata.json describes a view and is left out
    warning: dump/robmem/system.users.bson is the server's own and is left out
    warning: robmem.blocks: the index n_1 is not restored: an index of type `geoHaystack` is not supported by the embedded store
    [exit code: 0]
    "#);
}

#[test]
fn metadata_that_are_empty_are_taken_as_none() {
    let lab = dumped(&[]);
    lab.write("dump/robmem/blocks.metadata.json", "");
    lab.write("dump/robmem/gone.metadata.json", "");
    for path in ["dump", "dump/robmem/blocks.bson"] {
        let other = Lab::new();
        let report = other.rmem(&["restore", lab.path().join(path).to_str().unwrap()]).success();
        assert!(report.contains(r#"{"namespace":"robmem.blocks","inserted":2,"replaced":0,"skipped":0}"#), "{report}");
    }
    lab.write("dump/robmem/blocks.metadata.json", " ");
    lab.rmem(&["restore", "dump"]).exits(3);
}

#[test]
fn a_dump_carries_indexes_and_restore_makes_them() {
    for archive in [&["--archive"] as &[&str], &[]] {
        let lab = Lab::new();
        lab.rmem(&["insert", "robmem.objects", "{name: 'cup'}", "{name: 'jar'}"]).success();
        lab.rmem(&["index", "robmem.objects", "{name: 1}", "--unique"]).success();
        let listed = lab.rmem(&["index", "robmem.objects"]).success();
        lab.rmem(&[&["dump", "robmem.objects", "-o", "backup"], archive].concat()).success();
        for args in [&["--into", "robmem.copy"] as &[&str], &["--drop"]] {
            lab.rmem(&[&["restore", "backup"], args].concat()).success();
        }
        assert_eq!(lab.rmem(&["index", "robmem.copy"]).success(), listed);
        assert_eq!(lab.rmem(&["index", "robmem.objects"]).success(), listed);
        lab.rmem(&["insert", "robmem.copy", "{name: 'cup'}"]).exits(5);
    }
}

#[test]
fn a_world_file_takes_no_index_away() {
    let lab = Lab::new();
    lab.rmem(&["insert", "robmem.objects", "{_id: 1, name: 'cup'}"]).success();
    lab.rmem(&["index", "robmem.objects", "{name: 1}", "--unique"]).success();
    let listed = lab.rmem(&["index", "robmem.objects"]).success();
    lab.rmem(&["dump", "robmem.objects", "-o", "world.json"]).success();
    lab.rmem(&["restore", "world.json", "--drop"]).success();
    assert_eq!(lab.rmem(&["index", "robmem.objects"]).success(), listed);
    lab.write("twins.json", r#"{"robmem.objects": [{"_id": 5, "name": "jar"}, {"_id": 6, "name": "jar"}]}"#);
    assert_run!(lab.rmem(&["restore", "twins.json", "--drop"]), @r#"
    ------- stderr -------
    error: cannot restore robmem.objects; nothing was changed
      caused by: robmem.objects already has a document with name: "jar" (unique index name_1)
    [exit code: 5]
    "#);
    assert_eq!(lab.rmem(&["query", "robmem.objects"]).success(), "{\"_id\":1,\"name\":\"cup\"}\n");
}

#[test]
fn a_dry_run_reports_a_unique_key_that_is_taken() {
    let lab = Lab::new();
    lab.rmem(&["insert", "robmem.objects", "{_id: 1, name: 'cup'}", "{_id: 2, name: 'jar'}"]).success();
    lab.rmem(&["index", "robmem.objects", "{name: 1}", "--unique"]).success();
    lab.write("taken.json", r#"{"robmem.objects": [{"_id": 9, "name": "new"}, {"_id": 3, "name": "cup"}]}"#);
    lab.write("free.json", r#"{"robmem.objects": [{"_id": 1, "name": "lid"}, {"_id": 3, "name": "cup"}]}"#);
    assert_run!(lab.rmem(&["restore", "taken.json", "--dry-run"]), @r#"
    ------- stderr -------
    error: cannot restore robmem.objects; nothing was changed: robmem.objects already has a document with name: "cup" (unique index name_1): that with _id 1
    [exit code: 5]
    "#);
    assert_run!(lab.rmem(&["restore", "taken.json"]), @r#"
    ------- stderr -------
    error: cannot restore robmem.objects; nothing was changed: robmem.objects already has a document with name: "cup" (unique index name_1): that with _id 1
    [exit code: 5]
    "#);
    for args in [["restore", "taken.json", "--dry-run", "--drop"].as_slice(), &["restore", "free.json", "--dry-run"]] {
        lab.rmem(args).success();
    }
    // What the dump brings with it is checked too.
    lab.rmem(&["dump", "robmem.objects", "-o", "backup"]).success();
    lab.rmem(&["drop", "robmem.objects"]).success();
    lab.rmem(&["insert", "robmem.objects", "{_id: 7, name: 'cup'}"]).success();
    assert_run!(lab.rmem(&["restore", "backup", "--dry-run"]), @r#"
    ------- stderr -------
    error: cannot restore robmem.objects; nothing was changed: robmem.objects already has a document with name: "cup" (unique index name_1): that with _id 7
    [exit code: 5]
    "#);
    assert_run!(lab.rmem(&["restore", "backup"]), @r#"
    ------- stderr -------
    error: cannot restore robmem.objects; nothing was changed: robmem.objects already has a document with name: "cup" (unique index name_1): that with _id 7
    [exit code: 5]
    "#);
    assert_eq!(lab.rmem(&["count", "robmem.objects"]).success(), "1\n");
}

#[test]
fn the_indexes_of_a_collection_without_documents_are_restored() {
    let lab = Lab::new();
    lab.rmem(&["index", "robmem.objects", "{name: 1}", "--unique"]).success();
    let listed = lab.rmem(&["index", "robmem.objects"]).success();
    lab.rmem(&["dump", "robmem.objects", "-o", "backup"]).success();
    lab.rmem(&["drop", "robmem.objects"]).success();
    lab.rmem(&["insert", "robmem.objects", "{name: 'cup'}"]).success();
    assert_run!(lab.rmem(&["restore", "backup", "--drop"]), @r#"
    {"namespace":"robmem.objects","inserted":0,"replaced":0,"skipped":0,"dropped":1}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_eq!(lab.rmem(&["index", "robmem.objects"]).success(), listed);
    assert_eq!(lab.rmem(&["count", "robmem.objects"]).success(), "0\n");
}

#[test]
fn documents_that_a_collation_takes_for_one_are_a_conflict_and_nothing_is_replaced() {
    let lab = Lab::new();
    lab.rmem(&["create", "m.c", "--collation", "{locale: 'en', strength: 2}"]).success();
    lab.rmem(&["insert", "m.c", "{_id: 'A', keep: 'me'}"]).success();
    lab.write("one.json", r#"{"m.c": [{"_id": "a", "v": 1}]}"#);
    lab.write("two.json", r#"{"m.c": [{"_id": "b"}, {"_id": "B"}]}"#);
    for world in ["one.json", "two.json"] {
        for how in [&["--dry-run"][..], &[]] {
            lab.rmem(&[&["restore", world][..], how].concat()).exits(5);
        }
    }
    assert_eq!(lab.rmem(&["query", "m.c"]).success(), "{\"_id\":\"A\",\"keep\":\"me\"}\n");
    lab.rmem(&["dump", "m.c", "-o", "same.json"]).success();
    lab.rmem(&["restore", "same.json"]).success();
}

#[test]
fn a_collection_without_documents_is_restored_too() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    lab.write("w.json", "{'a.empty': [], 'a.full': [{_id: 1}]}");
    let both = "a.empty\na.full\n";
    lab.rmem(&["restore", "w.json"]).success();
    assert_eq!(lab.rmem(&["collections"]).success(), both);
    lab.rmem(&["insert", "-q", "a.empty", "{_id: 1}"]).success();
    lab.rmem(&["restore", "w.json", "--drop"]).success();
    assert_eq!(lab.rmem(&["collections"]).success(), both);
    assert_eq!(lab.rmem(&["count", "a.empty"]).success(), "0\n");
    lab.rmem(&["dump", "--all", "-o", "again.json"]).success();
    assert!(lab.read("again.json").contains("\"a.empty\": []"), "{}", lab.read("again.json"));
}
