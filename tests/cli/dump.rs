//! dump.

use std::fs;

use crate::lab::{Lab, assert_run, three_documents};
use crate::restore::{dumped, lab};

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
fn a_dump_is_of_all_documents_or_none() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    let text = "x".repeat(100);
    let documents: String = (0..200).map(|id| format!("{{_id: {id}, text: '{text}'}}\n")).collect();
    lab.write("documents.jsonl", &documents);
    lab.rmem(&["insert", "a.b", "--file", "documents.jsonl"]).success();
    // A page of documents that seems to have fewer: their number is in its fourth and fifth byte.
    let path = lab.path().join("robot.rmem");
    let mut bytes = fs::read(&path).unwrap();
    let is_full =
        |page: &&mut [u8]| page[0] == 13 && page[4] > 9 && page.windows(100).any(|part| part == text.as_bytes());
    bytes.chunks_mut(4096).find(is_full).unwrap()[4] -= 2;
    fs::write(&path, bytes).unwrap();
    for arguments in [&["-o", "folder"][..], &["--archive", "-o", "archive"], &["-o", "world.json"]] {
        let dump = lab.rmem(&[&["dump", "a.b"], arguments].concat()).exits(4);
        assert!(dump.stderr.contains("a.b has 198 documents, and its index of _ids names 200"), "{dump}");
        assert!(!lab.path().join(arguments[arguments.len() - 1]).exists(), "{dump}");
    }
    let saved = lab.rmem(&["repair", "-o", "saved.rmem"]).exits(1);
    assert!(
        saved.stderr.contains("lost: a.b: the documents at positions ") || saved.stdout.contains("lost: "),
        "{saved}"
    );
}

#[test]
fn a_key_of_extended_json_is_no_key_in_a_world_file() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    lab.rmem(&["insert", "a.b", "{_id: 1, at: [{}]}"]).success();
    let field = "{$setField: {field: {$literal: '$date'}, input: {}, value: '2020-01-01T00:00:00Z'}}";
    lab.rmem(&["update", "a.b", "{_id: 1}", &format!("[{{$set: {{at: [{field}]}}}}]")]).success();
    assert_run!(lab.rmem(&["dump", "a.b", "-o", "world.json"]), @r"
    ------- stderr -------
    error: a.b: the document with _id 1 has the key `$date`, by which a world file says the type of a value; dump into a folder or an archive, which hold BSON
    [exit code: 3]
    ");
    assert!(!lab.path().join("world.json").exists());
    lab.rmem(&["dump", "a.b", "-o", "folder"]).success();
    lab.rmem(&["--memory", "file:copy.rmem", "restore", "folder"]).success();
    lab.rmem(&["diff", "file:robot.rmem", "file:copy.rmem"]).success();
}

#[test]
fn a_dump_never_overwrites_a_folder() {
    let lab = dumped(&[]);
    assert_run!(lab.rmem(&["dump", "robmem.blocks", "-o", "dump"]), @r"
    ------- stderr -------
    error: dump is not empty; name a folder that is not there yet
    [exit code: 3]
    ");
    fs::create_dir(lab.path().join("blank")).unwrap();
    lab.rmem(&["dump", "robmem.blocks", "-o", "blank"]).success();
    assert_run!(lab.rmem(&["dump", "robmem.blocks", "-o", "world.json", "--gzip"]), @r"
    ------- stderr -------
    error: --gzip packs the files of a folder, or an archive; expected -o PATH
    [exit code: 2]
    ");
    let left: Vec<_> = fs::read_dir(lab.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert!(!left.iter().any(|name| name.to_string_lossy().starts_with(".rmem-")), "{left:?}");
}

#[test]
fn a_dump_into_a_folder_that_is_not_there_is_refused() {
    let lab = lab();
    let commands = [
        &["dump", "--all", "-o", "missing/dump"][..],
        &["dump", "--all", "-o", "missing/world.json"],
        &["dump", "--all", "--archive", "-o", "missing/archive"],
    ];
    assert_run!(lab.transcript(&commands), @r"
    $ rmem dump --all -o missing/dump
    ------- stderr -------
    error: cannot write missing/dump: the folder missing does not exist; create it first
    [exit code: 4]
    $ rmem dump --all -o missing/world.json
    ------- stderr -------
    error: cannot write missing/world.json: the folder missing does not exist; create it first
    [exit code: 4]
    $ rmem dump --all --archive -o missing/archive
    ------- stderr -------
    error: cannot write missing/archive: the folder missing does not exist; create it first
    [exit code: 4]
    ");
}

#[test]
fn files_of_killed_dumps_are_removed_by_the_next() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    lab.rmem(&["insert", "a.b", "{_id: 1}"]).success();
    // A process of this boot whose id was used at another time.
    let boot = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap().trim().replace('-', "");
    let space = std::fs::read_link("/proc/self/ns/pid").unwrap().display().to_string();
    let space: String = space.chars().filter(char::is_ascii_alphanumeric).collect();
    let left = format!(".rmem-{boot}.{space}.{}.1-abcdef", std::process::id());
    for dump in [&["dump", "a.b", "-o", "world.json"][..], &["dump", "--all", "-o", "folder"], &["backup", "copy.rmem"]]
    {
        std::fs::create_dir(lab.path().join(&left)).unwrap();
        lab.rmem(dump).success();
        assert!(!lab.path().join(&left).exists(), "{dump:?}");
    }
}

#[test]
fn a_dump_or_a_backup_that_is_interrupted_leaves_nothing() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    let documents: String =
        (0..30_000).map(|n| format!("{{\"n\": {n}, \"pad\": \"{}\"}}\n", "x".repeat(2_000))).collect();
    lab.write("many.jsonl", &documents);
    lab.rmem(&["insert", "a.b", "--file", "many.jsonl"]).success();
    for signal in ["INT", "TERM"] {
        for command in ["dump --all -o out/folder", "dump --all --archive -o out/archive", "backup out/copy.rmem"] {
            let script = format!(
                "mkdir out; rmem {command} & until ls -A out | grep -q .; do :; done; kill -{signal} $!; wait $!"
            );
            lab.shell(&script).exits(130);
            assert_eq!(lab.shell("ls -AR out && rmdir out").success(), "out:\n", "{command}");
        }
    }
}

#[test]
fn a_dump_loads_again_and_gives_the_same_bytes() {
    let lab = three_documents();
    lab.rmem(&["dump", "--all", "-o", "world.json"]).success();
    let again = lab.rmem(&["--memory", "mem:", "--load", "world.json", "dump", "--all"]).success();
    assert_eq!(again, lab.read("world.json"));
}

#[test]
fn a_collection_that_does_not_exist_is_named() {
    let lab = crate::lab::three_documents();
    let dump = lab.rmem(&["dump", "robmem.worldmodl", "robmem.worldmodel"]).exits(0);
    assert_eq!(dump.stderr, "warning: no collection robmem.worldmodl; did you mean robmem.worldmodel?\n");
    crate::lab::assert_run!(lab.rmem(&["dump", "robmem.worldmodl", "-o", "world.json"]), @r"
    ------- stderr -------
    warning: no collection robmem.worldmodl; did you mean robmem.worldmodel?
    error: nothing was written: no such collection
    [exit code: 1]
    ");
    assert!(!lab.path().join("world.json").exists());
}

#[test]
fn a_world_file_says_which_indexes_it_leaves_out() {
    let lab = lab();
    lab.rmem(&["index", "robmem.blocks", "{block: 1}"]).success();
    let dump = ["dump", "robmem.blocks", "-o"];
    let world = lab.rmem(&[&dump[..], &["world.json"]].concat()).exits(0);
    let warning = "warning: a world file keeps no indexes, collations and validators; left out: block_1 of robmem.blocks; -o FOLDER keeps them\n";
    assert_eq!(world.stderr, warning);
    let folder = lab.rmem(&[&dump[..], &["folder"]].concat()).exits(0);
    assert!(!folder.stderr.contains("warning"), "{folder}");
}

#[cfg(unix)]
#[test]
fn a_world_is_written_to_a_device_or_a_pipe() {
    let lab = Lab::new();
    lab.rmem(&["insert", "-q", "a.b", "{_id: 1}"]).success();
    lab.rmem(&["dump", "a.b", "-o", "/dev/null"]).success();
    assert_eq!(lab.shell("rmem dump a.b -o /dev/stdout | cat").success(), lab.rmem(&["dump", "a.b"]).success());
}
