//! A full disk: a small file system of its own, where one can be mounted.

use std::io::Read as _;
use std::path::Path;
use std::process::{Command, Output};

use libtest_mimic::{Failed, Trial};
use tempfile::TempDir;

/// Ignored where no file system can be mounted.
pub(crate) fn trials() -> Vec<Trial> {
    let cannot_mount = SmallDisk::mount().is_none();
    [
        Trial::test("disk::deleting_helps_where_documents_filled_the_disk", || deleting_helps(&filled)),
        Trial::test("disk::deleting_helps_where_one_write_filled_the_disk", || deleting_helps(&filled_at_once)),
        Trial::test("disk::deleting_helps_where_changes_of_one_document_filled_the_disk", || deleting_helps(&changed)),
        #[cfg(all(feature = "mongodb", feature = "serve"))]
        Trial::test("disk::what_a_server_answers_with_an_error_is_not_stored", serve_without_room),
        Trial::test("disk::what_is_stored_is_read_where_others_filled_the_disk", read_without_room),
        Trial::test("disk::what_does_not_fit_leaves_no_file_and_is_said_in_one_way", leave_nothing),
        Trial::test("disk::a_sort_without_room_for_its_temporary_files_says_so", sort_without_room),
        Trial::test("disk::a_planner_that_fills_the_disk_of_its_files_is_no_failed_plan", plan_without_room),
    ]
    .into_iter()
    .map(|trial| trial.with_ignored_flag(cannot_mount))
    .collect()
}

/// A file system in memory, unmounted when it is dropped.
struct SmallDisk(TempDir);

impl SmallDisk {
    /// One of 4 MiB.
    fn mount() -> Option<Self> {
        Self::mount_of(4)
    }

    /// One of so many MiB.
    fn mount_of(size: u32) -> Option<Self> {
        let folder = tempfile::tempdir().ok()?;
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", &format!("size={size}m"), "tmpfs"]).arg(folder.path());
        mount.output().is_ok_and(|output| output.status.success()).then(|| Self(folder))
    }

    fn rmem(&self, args: &[&str]) -> Result<Output, Failed> {
        let memory = format!("file:{}", self.0.path().join("m.rmem").display());
        let mut rmem = Command::new(env!("CARGO_BIN_EXE_rmem"));
        rmem.args(["--memory", &memory, "--quiet"]).args(args).env("HOME", Path::new("/nonexistent"));
        Ok(rmem.output()?)
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(self.0.path()).status();
    }
}

/// No byte is free, since another program wrote.
fn read_without_room() -> Result<(), Failed> {
    let disk = SmallDisk::mount().ok_or("no file system can be mounted")?;
    let said = |args: &[&str]| -> Result<(Option<i32>, String, String), Failed> {
        let output = disk.rmem(args)?;
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().to_owned();
        Ok((output.status.code(), text(&output.stdout), text(&output.stderr)))
    };
    assert!(disk.rmem(&["insert", "a.b", "{_id: 1}"])?.status.success());
    let other = disk.0.path().join("other");
    let filled = std::io::copy(&mut std::io::repeat(0).take(8 << 20), &mut std::fs::File::create(&other)?);
    assert!(filled.is_err(), "the disk has room left");
    assert_eq!(said(&["count", "a.b"])?, (Some(0), "1".into(), String::new()));
    assert_eq!(said(&["query", "a.b"])?, (Some(0), "{\"_id\":1}".into(), String::new()));
    let elsewhere = tempfile::tempdir()?;
    let saved = elsewhere.path().join("saved.rmem").display().to_string();
    let repaired = "1 collection, 1 document, 0 indexes".to_owned();
    assert_eq!(said(&["repair", "-o", &saved])?, (Some(0), repaired, String::new()));
    let (code, _, message) = said(&["delete", "a.b", "{_id: 1}"])?;
    assert_eq!(code, Some(4), "{message}");
    assert!(message.contains("the disk is full, and a deletion needs a few pages"), "{message}");
    let (code, _, message) = said(&["insert", "a.b", "{_id: 2}"])?;
    assert_eq!(code, Some(4), "{message}");
    assert!(message.contains("the disk is full; remove other files, and repeat"), "{message}");
    std::fs::remove_file(other)?;
    assert!(disk.rmem(&["delete", "a.b", "{_id: 1}"])?.status.success());
    Ok(())
}

#[cfg(all(feature = "mongodb", feature = "serve"))]
fn serve_without_room() -> Result<(), Failed> {
    let disk = SmallDisk::mount_of(12).ok_or("no file system can be mounted")?;
    crate::serving::full_disk(disk.0.path())
}

/// A planner writes until its disk is full.
fn plan_without_room() -> Result<(), Failed> {
    let disk = SmallDisk::mount().ok_or("no file system can be mounted")?;
    let elsewhere = tempfile::tempdir()?;
    let write = |name: &str, text: &str| std::fs::write(elsewhere.path().join(name), text);
    write("rmem.toml", "[planner.greedy]\ncommand = [\"sh\", \"-c\", \"cat /dev/zero > large\"]\noutput = \"auto\"\n")?;
    write("d.pddl", "(define (domain d) (:predicates (p)) (:action a :parameters () :effect (p)))")?;
    write("p.pddl", "(define (problem q) (:domain d) (:init) (:goal (p)))")?;
    let rmem = |args: &[&str]| {
        let mut rmem = Command::new(env!("CARGO_BIN_EXE_rmem"));
        rmem.args(["--memory", "file:m.rmem"]).args(args).env("HOME", Path::new("/nonexistent"));
        rmem.env("TMPDIR", disk.0.path()).current_dir(elsewhere.path()).output()
    };
    let output = rmem(&["plan", "--domain", "d.pddl", "--problem", "p.pddl", "--planner", "greedy"])?;
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(4), "{message}");
    let expected = format!("{}: the disk is full", disk.0.path().display());
    assert!(message.contains(&expected), "{message}");
    let stored = rmem(&["count", "robmem.plans"])?;
    assert_ne!(String::from_utf8_lossy(&stored.stdout).trim(), "1", "a failed plan was stored");
    Ok(())
}

/// No byte is free, and files are made.
fn leave_nothing() -> Result<(), Failed> {
    let disk = SmallDisk::mount().ok_or("no file system can be mounted")?;
    let elsewhere = tempfile::tempdir()?;
    let memory = format!("file:{}", elsewhere.path().join("m.rmem").display());
    let on_disk = |name: &str| disk.0.path().join(name).display().to_string();
    let rmem_of = |memory: &str, args: &[&str]| {
        let mut rmem = Command::new(env!("CARGO_BIN_EXE_rmem"));
        rmem.args(["--memory", memory, "--quiet"]).args(args).env("HOME", Path::new("/nonexistent")).output()
    };
    let rmem = |args: &[&str]| rmem_of(&memory, args);
    let documents = (0..400).map(|n| format!("{{_id: {n}, text: '{}'}}\n", "x".repeat(1_000))).collect::<String>();
    let world = elsewhere.path().join("world.jsonl");
    std::fs::write(&world, documents)?;
    assert!(rmem(&["insert", "a.b", "--file", &world.display().to_string()])?.status.success());
    let filled = std::io::copy(&mut std::io::repeat(0).take(8 << 20), &mut std::fs::File::create(on_disk("other"))?);
    assert!(filled.is_err(), "the disk has room left");
    for kib in [8, 16, 32] {
        let other = std::fs::OpenOptions::new().write(true).open(on_disk("other"))?;
        other.set_len((4096 - kib) << 10)?;
        let output = rmem_of(&format!("file:{}", on_disk("new.rmem")), &["insert", "a.b", "{_id: 1}"])?;
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(message.contains("the disk is full; remove other files, and repeat"), "{kib}: {message}");
        assert_eq!(std::fs::read_dir(disk.0.path())?.count(), 1, "{kib}: {message}");
    }
    let filled = std::io::copy(&mut std::io::repeat(0).take(8 << 20), &mut std::fs::File::create(on_disk("other"))?);
    assert!(filled.is_err(), "the disk has room left");
    let (json, copy, new) = (on_disk("x.json"), on_disk("copy.rmem"), format!("file:{}", on_disk("new.rmem")));
    let (folder, archive, project) = (on_disk("dumped"), on_disk("x.archive"), on_disk("project"));
    let refused: [(&str, &[&str]); 8] = [
        (&memory, &["dump", "--all", "-o", &json]),
        (&memory, &["dump", "--all", "-o", &folder]),
        (&memory, &["dump", "--all", "--archive", "-o", &archive]),
        (&memory, &["backup", &copy]),
        (&memory, &["repair", "-o", &copy]),
        (&memory, &["init", &project]),
        (&memory, &["init", &on_disk("")]),
        (&new, &["insert", "a.b", "{_id: 1}"]),
    ];
    for (memory, args) in refused {
        let output = rmem_of(memory, args)?;
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && message.contains("the disk is full"), "{args:?}: {message}");
        assert!(!message.contains("delete documents"), "{args:?}: {message}");
        let left: Vec<_> = std::fs::read_dir(disk.0.path())?
            .map(|entry| entry.map(|entry| entry.file_name()))
            .collect::<Result<_, _>>()?;
        assert_eq!(left, ["other"], "{args:?}: {message}");
    }
    Ok(())
}

/// What is sorted is larger than the memory of a sort, and the disk.
fn sort_without_room() -> Result<(), Failed> {
    let disk = SmallDisk::mount().ok_or("no file system can be mounted")?;
    let world = tempfile::Builder::new().suffix(".jsonl").tempfile()?;
    let lines = (0..30).map(|n| format!("{{\"_id\": {n}, \"text\": \"{}\"}}\n", "x".repeat(2 << 20)));
    std::fs::write(world.path(), lines.collect::<String>())?;
    let memory = tempfile::tempdir()?;
    let memory = format!("file:{}", memory.path().join("m.rmem").display());
    let rmem = |args: &[&str]| {
        let mut rmem = Command::new(env!("CARGO_BIN_EXE_rmem"));
        rmem.args(["--memory", &memory, "--quiet"]).args(args).env("TMPDIR", disk.0.path()).output()
    };
    assert!(rmem(&["insert", "a.b", "--file", &world.path().display().to_string()])?.status.success());
    let sorted: [&[&str]; 3] = [
        &["query", "a.b", "--sort", "{text: 1}"],
        &["aggregate", "a.b", "[{$sort: {text: 1}}]"],
        &["aggregate", "a.b", "[{$group: {_id: '$_id', text: {$first: '$text'}}}]"],
    ];
    for args in sorted {
        let refused = rmem(args)?;
        let message = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(4), "{message}");
        let expected = format!("error: the disk is full: no room in {} for temporary files", disk.0.path().display());
        assert!(message.starts_with(&expected), "{message}");
    }
    Ok(())
}

/// What fills the disk until rmem refuses; gives the refusal.
type Fill = dyn Fn(&SmallDisk) -> Result<Output, Failed>;

fn filled(disk: &SmallDisk) -> Result<Output, Failed> {
    let documents = tempfile::NamedTempFile::new()?;
    let lines = (0..4_000).map(|n| format!("{{\"n\": {n}, \"text\": \"{}\"}}\n", "x".repeat(2_000)));
    std::fs::write(documents.path(), lines.collect::<String>())?;
    disk.rmem(&["insert", "a.b", "--file", &documents.path().display().to_string()])
}

/// The large document would fit into the file, but not into the log and the file.
fn filled_at_once(disk: &SmallDisk) -> Result<Output, Failed> {
    let insert = |size| {
        let document = tempfile::NamedTempFile::new()?;
        std::fs::write(document.path(), format!("{{\"text\": \"{}\"}}\n", "x".repeat(size)))?;
        disk.rmem(&["insert", "a.b", "--file", &document.path().display().to_string()])
    };
    for _ in 0..11 {
        let inserted = insert(200_000)?;
        assert!(inserted.status.success(), "{inserted:?}");
    }
    insert(1_000_000)
}

/// A watch keeps the changes.
fn changed(disk: &SmallDisk) -> Result<Output, Failed> {
    disk.rmem(&["insert", "a.b", "{_id: 1}"])?;
    disk.rmem(&["watch", "a.b", "--resume", "reader", "--timeout", "1ms"])?;
    let text = format!("{{$set: {{text: '{}'}}, $inc: {{n: 1}}}}", "x".repeat(20_000));
    for _ in 0..1_000 {
        let changed = disk.rmem(&["update", "a.b", "{_id: 1}", &text])?;
        if !changed.status.success() {
            return Ok(changed);
        }
    }
    Err("the disk is never full".into())
}

fn deleting_helps(fill: &Fill) -> Result<(), Failed> {
    let disk = SmallDisk::mount().ok_or("no file system can be mounted")?;
    let refused = fill(&disk)?;
    let message = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(4), "{message}");
    assert!(message.contains("the disk is full; make room or delete documents"), "{message}");
    assert!(!disk.rmem(&["count", "a.b"])?.stdout.is_empty());
    // What the reader has not read is kept for it.
    let forgotten = disk.rmem(&["watch", "a.b", "--resume", "reader", "--forget"])?;
    assert_ne!(forgotten.status.code(), Some(4), "{forgotten:?}");
    let deleted = disk.rmem(&["delete", "a.b", "--all"])?;
    assert!(deleted.status.success(), "{deleted:?}");
    let inserted = disk.rmem(&["insert", "a.b", "{n: 1}"])?;
    assert!(inserted.status.success(), "{inserted:?}");
    assert_eq!(disk.rmem(&["count", "a.b"])?.stdout, b"1\n");
    Ok(())
}
