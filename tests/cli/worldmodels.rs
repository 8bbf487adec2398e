//! dump, restore, diff.

use std::fs;

use crate::lab::Lab;

/// A memory with two namespaces.
fn lab() -> Lab {
    let lab = Lab::new();
    lab.rmem(&[
        "insert",
        "robmem.blocks",
        "{_id: 2, name: 'A', n: NumberLong(3), _robmem_info: {persistent: false}}",
        "{_id: 1, name: 'B', at: ISODate('2026-01-02T03:04:05Z'), pose: {x: [1, 2.5, null]}}",
    ])
    .success();
    lab.rmem(&["insert", "other.a.b/c", "{_id: 'x'}"]).success();
    lab
}

fn dumped(args: &[&str]) -> Lab {
    let lab = lab();
    lab.rmem(&[&["dump", "--all", "-o", "dump"], args].concat()).success();
    lab
}

fn all(lab: &Lab) -> String {
    lab.rmem(&["dump", "--all"]).success()
}

fn changed(lab: &Lab) {
    lab.rmem(&["update", "robmem.blocks", "{_id: 1}", "{$set: {name: 'C'}}"]).success();
    lab.rmem(&["delete", "robmem.blocks", "{_id: 2}"]).success();
    lab.rmem(&["insert", "robmem.blocks", "{_id: 3}"]).success();
}

#[test]
fn a_folder_is_laid_out_as_mongodump_does() {
    let lab = dumped(&[]);
    let metadata = lab.read("dump/other/a.b%2Fc.metadata.json");
    assert_eq!(
        metadata,
        r#"{"indexes":[{"v":{"$numberInt":"2"},"key":{"_id":{"$numberInt":"1"}},"name":"_id_"}],"collectionName":"a.b/c","type":"collection"}"#
    );
    let bytes = fs::read(lab.path().join("dump/other/a.b%2Fc.bson")).unwrap();
    let document = bson::Document::from_reader(bytes.as_slice()).unwrap();
    assert_eq!(document.get_str("_id").unwrap(), "x");
    assert!(document.get_document("_robmem_info").unwrap().contains_key("inserted"));
    let mut names: Vec<_> =
        fs::read_dir(lab.path().join("dump/robmem")).unwrap().map(|e| e.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["blocks.bson", "blocks.metadata.json"]);
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
            assert!(
                report.contains(r#"{"namespace":"robmem.blocks","inserted":2,"replaced":0,"skipped":0"#),
                "{report}"
            );
            assert_eq!(all(&other), before);
        }
        assert!(before.contains("persistent"));
    }
}

#[test]
fn restoring_merges_and_says_what_it_did() {
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
    let again = lab.rmem(&["restore", "dump"]).success();
    assert!(again.contains(r#""robmem.blocks","inserted":0,"replaced":0,"skipped":2"#), "{again}");
}

#[test]
fn with_drop_a_collection_is_replaced_as_a_whole() {
    let lab = dumped(&[]);
    let before = all(&lab);
    changed(&lab);
    let foreseen = lab.rmem(&["restore", "dump", "--drop", "--dry-run"]).success();
    assert!(lab.rmem(&["count", "robmem.blocks", "{_id: 3}"]).success() == "1\n", "a dry run changed something");
    let report = lab.rmem(&["restore", "dump", "--drop"]).success();
    assert!(report.contains(r#""robmem.blocks","inserted":2,"replaced":0,"skipped":0,"dropped":2"#), "{report}");
    assert_eq!(foreseen, report);
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
    let failed = lab.rmem(&["restore", "dump", "--drop"]).exits(5);
    assert!(failed.stderr.contains("nothing was changed"), "{failed}");
    assert_eq!(all(&lab), before);
    assert_eq!(lab.rmem(&["collections"]).success(), "other.a.b/c\nrobmem.blocks\n");
}

#[test]
fn one_file_or_one_database_is_restored_too() {
    let lab = dumped(&[]);
    lab.rmem(&["restore", "dump/robmem/blocks.bson", "--into", "copy.blocks"]).success();
    lab.rmem(&["restore", "dump/other"]).success();
    assert_eq!(lab.rmem(&["count", "copy.blocks"]).success(), "2\n");
    let refused = lab.rmem(&["restore", "dump", "--into", "copy.blocks"]).exits(2);
    assert!(refused.stderr.contains("has other.a.b/c, robmem.blocks"), "{refused}");
    lab.shell("cd dump/robmem && rmem restore blocks.bson --dry-run").success();
}

#[test]
fn a_world_file_is_restored_and_skipped_again() {
    let lab = lab();
    lab.rmem(&["dump", "--all", "-o", "world.json"]).success();
    changed(&lab);
    let report = lab.rmem(&["restore", "world.json", "--drop"]).success();
    assert!(report.contains(r#""robmem.blocks","inserted":2"#), "{report}");
    assert_eq!(all(&lab), lab.read("world.json"));
    let again = lab.rmem_with(&["restore", "-"], &lab.read("world.json")).success();
    assert!(again.contains(r#""robmem.blocks","inserted":0,"replaced":0,"skipped":2"#), "{again}");
    let wrong = lab.rmem_with(&["restore", "-"], "{\"nodot\": []}").exits(3);
    assert!(wrong.stderr.contains("<stdin>:1:"), "{wrong}");
}

#[test]
fn a_damaged_file_is_named_with_its_place_and_changes_nothing() {
    for packed in [false, true] {
        let lab = dumped(if packed { &["--gzip"] } else { &[] });
        let name = if packed { "blocks.bson.gz" } else { "blocks.bson" };
        let path = lab.path().join("dump/robmem").join(name);
        let whole = fs::read(&path).unwrap();
        lab.rmem(&["delete", "other.a.b/c", "--all"]).success();
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
    let failed = lab.rmem(&["restore", "bad.json"]).exits(3);
    assert!(failed.stderr.contains("bad.json:1:"), "{failed}");
    assert_eq!(all(&lab), before);
    for (path, code) in [("missing", 3), ("domains/README.md", 3)] {
        lab.rmem(&["restore", path]).exits(code);
    }
    fs::create_dir(lab.path().join("empty")).unwrap();
    let failed = lab.rmem(&["restore", "empty"]).exits(3);
    assert!(failed.stderr.contains("nothing to restore"), "{failed}");
}

#[test]
fn an_archive_holds_everything_in_one_file() {
    for options in [&[][..], &["--gzip"]] {
        let lab = lab();
        lab.rmem(&[&["dump", "--all", "--archive", "-o", "all.json"], options].concat()).success();
        let before = all(&lab);
        lab.rmem(&["diff", "all.json", "all.json"]).success();
        changed(&lab);
        let report = lab.rmem(&["restore", "all.json", "--drop"]).success();
        assert!(report.contains(r#""robmem.blocks","inserted":2,"replaced":0,"skipped":0,"dropped":2"#), "{report}");
        assert_eq!(all(&lab), before);
        let bytes = fs::read(lab.path().join("all.json")).unwrap();
        fs::write(lab.path().join("cut"), &bytes[..bytes.len() - 60]).unwrap();
        let failed = lab.rmem(&["restore", "cut"]).exits(3);
        assert!(failed.stderr.contains("cut: byte "), "{failed}");
        lab.rmem(&["restore", "all.json", "--into", "x.y"]).exits(2);
    }
}

#[test]
fn what_is_the_servers_own_is_left_out_aloud() {
    let lab = dumped(&[]);
    fs::write(lab.path().join("dump/robmem/system.users.bson"), b"").unwrap();
    lab.write("dump/robmem/seen.metadata.json", r#"{"options":{"viewOn":"blocks"},"indexes":[]}"#);
    lab.write("dump/robmem/blocks.metadata.json", r#"{"indexes":[{"key":{"n":"text"},"name":"n_1"}]}"#);
    let done = lab.rmem(&["restore", "dump"]).exits(0);
    for said in [
        "system.users.bson is the server's own",
        "describes a view",
        "robmem.blocks: the index n_1 is not restored: an index of type `text`",
    ] {
        assert!(done.stderr.contains(said), "{done}");
    }
}

#[test]
fn a_dump_never_overwrites_a_folder() {
    let lab = dumped(&[]);
    let refused = lab.rmem(&["dump", "robmem.blocks", "-o", "dump"]).exits(3);
    assert!(refused.stderr.contains("dump is not empty"), "{refused}");
    fs::create_dir(lab.path().join("blank")).unwrap();
    lab.rmem(&["dump", "robmem.blocks", "-o", "blank"]).success();
    lab.rmem(&["dump", "robmem.blocks", "-o", "missing/dump"]).exits(4);
    lab.rmem(&["dump", "robmem.blocks", "-o", "world.json", "--gzip"]).exits(2);
    let left: Vec<_> = fs::read_dir(lab.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert!(!left.iter().any(|name| name.to_string_lossy().starts_with(".rmem-")), "{left:?}");
}

#[test]
fn differences_are_a_line_a_document() {
    let lab = dumped(&["--gzip"]);
    lab.rmem(&["dump", "--all", "-o", "world.json"]).success();
    let memory = format!("file:{}", lab.path().join("home/.local/share/rmem/memory.rmem").display());
    for (a, b) in [("dump", "world.json"), ("world.json", memory.as_str()), (memory.as_str(), "dump")] {
        assert_eq!(lab.rmem(&["diff", a, b]).success(), "");
    }
    changed(&lab);
    let found = lab.rmem(&["diff", "dump", &memory]).exits(1);
    assert_eq!(
        found.stdout,
        "~ robmem.blocks 1 {\"name\":\"B\"} -> {\"name\":\"C\"}\n\
         - robmem.blocks {\"_id\":2,\"name\":\"A\",\"n\":3}\n\
         + robmem.blocks {\"_id\":3}\n"
    );
    assert_eq!(lab.rmem(&["diff", "world.json", &memory]).exits(1).stdout, found.stdout);
    lab.write("a.json", "{\"a.b\": [{\"_id\": 1, \"n\": 1, \"m\": 2}]}");
    lab.write("b.json", "{\"a.b\": [{\"_id\": 1, \"n\": {\"$numberLong\": \"1\"}, \"m\": 2}]}");
    lab.write("c.json", "{\"a.b\": [{\"_id\": 1, \"m\": 2, \"n\": 1}]}");
    let types = lab.rmem(&["diff", "a.json", "b.json"]).exits(1).stdout;
    assert_eq!(types, "~ a.b 1 {\"n\":{\"$numberInt\":\"1\"}} -> {\"n\":{\"$numberLong\":\"1\"}}\n");
    let order = lab.rmem(&["diff", "a.json", "c.json"]).exits(1).stdout;
    assert_eq!(order, "~ a.b 1 {\"_id\":1,\"n\":1,\"m\":2} -> {\"_id\":1,\"m\":2,\"n\":1}\n");
    lab.write("d.json", "{\"a.b\": [{\"n\": 1, \"_id\": 1, \"m\": 2}]}");
    assert_eq!(lab.rmem(&["diff", "a.json", "d.json"]).success(), "", "a store has the _id first, wherever it stood");
    lab.rmem(&["diff", "a.json", "missing.json"]).exits(3);
    lab.rmem(&["diff", "a.json", "file:missing.rmem"]).exits(3);
    assert!(!lab.path().join("missing.rmem").exists());
    lab.rmem(&["diff", "a.json", "mem:x"]).exits(2);
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
    let refused = lab.rmem(&["restore", "twins.json", "--drop"]).exits(5);
    assert!(refused.stderr.contains("nothing was changed"), "{refused}");
    assert_eq!(lab.rmem(&["query", "robmem.objects"]).success(), "{\"_id\":1,\"name\":\"cup\"}\n");
}

#[test]
fn a_dry_run_tells_of_a_unique_key_that_is_taken() {
    let lab = Lab::new();
    lab.rmem(&["insert", "robmem.objects", "{_id: 1, name: 'cup'}", "{_id: 2, name: 'jar'}"]).success();
    lab.rmem(&["index", "robmem.objects", "{name: 1}", "--unique"]).success();
    lab.write("taken.json", r#"{"robmem.objects": [{"_id": 9, "name": "new"}, {"_id": 3, "name": "cup"}]}"#);
    lab.write("free.json", r#"{"robmem.objects": [{"_id": 1, "name": "lid"}, {"_id": 3, "name": "cup"}]}"#);
    for args in [["restore", "taken.json", "--dry-run"].as_slice(), &["restore", "taken.json"]] {
        let refused = lab.rmem(args).exits(5);
        assert!(refused.stderr.contains("robmem.objects") && refused.stderr.contains("name: \"cup\""), "{refused}");
    }
    for args in [["restore", "taken.json", "--dry-run", "--drop"].as_slice(), &["restore", "free.json", "--dry-run"]] {
        lab.rmem(args).success();
    }
    // What the dump brings with it is checked too.
    lab.rmem(&["dump", "robmem.objects", "-o", "backup"]).success();
    lab.rmem(&["drop", "robmem.objects"]).success();
    lab.rmem(&["insert", "robmem.objects", "{_id: 7, name: 'cup'}"]).success();
    for args in [["restore", "backup", "--dry-run"].as_slice(), &["restore", "backup"]] {
        let refused = lab.rmem(args).exits(5);
        assert!(refused.stderr.contains("nothing was changed"), "{refused}");
    }
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
    let report = lab.rmem(&["restore", "backup", "--drop"]).success();
    assert!(report.contains(r#""inserted":0,"replaced":0,"skipped":0,"dropped":1"#), "{report}");
    assert_eq!(lab.rmem(&["index", "robmem.objects"]).success(), listed);
    assert_eq!(lab.rmem(&["count", "robmem.objects"]).success(), "0\n");
}

#[test]
fn a_dump_into_a_folder_that_is_not_there_says_so() {
    let lab = lab();
    for args in [["-o", "missing/dump"].as_slice(), &["-o", "missing/world.json"], &["--archive", "-o", "missing/a"]] {
        let refused = lab.rmem(&[&["dump", "--all"], args].concat()).exits(4);
        assert!(refused.stderr.contains("there is no folder missing; make it first"), "{refused}");
    }
}
