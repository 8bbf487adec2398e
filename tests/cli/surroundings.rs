//! What rmem makes of strange files, addresses, clocks and full disks.

use std::os::unix::fs::PermissionsExt as _;

use crate::lab::Lab;

#[test]
fn what_is_no_file_is_named_for_what_it_is() {
    let lab = Lab::empty();
    let script = "ln -s loop loop; mkfifo pipe";
    lab.shell(script).success();
    let other = rusqlite::Connection::open(lab.path().join("other")).unwrap();
    other.execute_batch("CREATE TABLE t (a); DROP TABLE t; VACUUM").unwrap();
    drop(other);
    for (file, reason) in [
        ("loop", "is a symbolic link that leads back to itself"),
        ("pipe", "is a pipe; name a file"),
        ("/dev/null", "is a device; name a file, or mem: for a memory without one"),
        ("other", "is an SQLite database of another program"),
    ] {
        let refused = lab.rmem(&["--memory", &format!("file:{file}"), "insert", "a.b", "{}"]).exits(4);
        assert!(refused.stderr.contains(reason), "{file}: {refused}");
    }
}

#[test]
fn a_password_without_a_host_is_not_repeated() {
    let lab = Lab::empty();
    for uri in
        ["mongodb://user:secret", "mongodb://user:secret/", "mongodb://user:secret?w=1", "mongodb+srv://u:secret"]
    {
        for command in [&["collections"][..], &["config"], &["doctor"]] {
            let shown = lab.rmem(&[&["--memory", uri], command].concat());
            assert!(!shown.stdout.contains("secret") && !shown.stderr.contains("secret"), "{shown}");
        }
        let refused = lab.rmem(&["--memory", uri, "collections"]).exits(2);
        assert!(refused.stderr.contains("://USER:PASSWORD@HOST:PORT"), "{refused}");
    }
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
fn a_cached_computation_that_ends_too_far_ahead_is_stale() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    lab.write(
        "rmem.toml",
        "[[computable]]\nname = \"now\"\ncollection = \"a.b\"\nspec = \"{compute: 'now'}\"\ncache = \"1m\"\n\
         command = [\"sh\", \"-c\", \"echo {compute: \\\\\\\"now\\\\\\\", n: $(date +%N)}\"]\n",
    );
    let query = || lab.rmem(&["query", "a.b", "{compute: 'now'}"]).success();
    let first = query();
    assert_eq!(first, query(), "the cache holds");
    // As if the clock had been a day ahead when it was computed.
    let later = "{$set: {'_robmem_info.cached_until': new Date(4102444800000)}}";
    let store = rmem::store::Embedded::open(lab.path().join("robot.rmem")).unwrap();
    let update = rmem::formats::shell::parse_document(&rmem::formats::Source::new("u", later)).unwrap();
    let request = rmem::store::UpdateRequest {
        filter: bson::doc! {},
        update: rmem::store::UpdateSpec::Document(update),
        array_filters: Vec::new(),
        many: true,
        upsert: false,
    };
    let ns = rmem::store::Namespace { database: "a".into(), collection: "rmem.computed".into() };
    rmem::store::Store::update(&store, &ns, &request, None).unwrap();
    drop(store);
    assert_ne!(first, query());
}

#[test]
fn a_file_that_anyone_may_write_is_read_in_a_folder_that_one_may_not() {
    if rustix::process::geteuid().is_root() {
        // Root may write everywhere.
        return;
    }
    let lab = Lab::empty();
    lab.shell("mkdir other; rmem --memory file:other/robot.rmem insert a.b '{_id: 1}'").success();
    let folder = lab.path().join("other");
    std::fs::set_permissions(folder.join("robot.rmem"), std::fs::Permissions::from_mode(0o666)).unwrap();
    std::fs::set_permissions(&folder, std::fs::Permissions::from_mode(0o555)).unwrap();
    lab.rmem(&["--memory", "file:other/robot.rmem", "count", "a.b"]).success();
    let refused = lab.rmem(&["--memory", "file:other/robot.rmem", "insert", "a.b", "{}"]).exits(4);
    std::fs::set_permissions(&folder, std::fs::Permissions::from_mode(0o755)).unwrap();
    assert!(refused.stderr.contains("cannot be written"), "{refused}");
}

#[test]
fn a_log_that_cannot_be_written_is_reported_once() {
    let lab = Lab::empty();
    if !std::path::Path::new("/dev/full").exists() {
        return;
    }
    let finished = lab.rmem(&["--memory", "mem:", "--log", "/dev/full", "insert", "a.b", "[{_id: 1}, {_id: 2}]"]);
    assert_eq!(finished.stderr.matches("the log cannot be written").count(), 1, "{finished}");
    finished.success();
}

#[test]
fn a_supervisor_that_was_stopped_is_continued() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    // The parent of the program is its supervisor.
    lab.write(
        "rmem.toml",
        "[[computable]]\nname = \"stop\"\ncollection = \"a.b\"\nspec = \"{compute: 'stop'}\"\n\
         command = [\"sh\", \"-c\", \"kill -STOP $PPID; sleep 0.2; echo '{compute: \\\"stop\\\"}'\"]\n",
    );
    let answer = lab.rmem(&["count", "a.b", "{compute: 'stop'}"]).success();
    assert_eq!(answer, "1\n");
}

#[test]
fn a_run_without_room_for_its_files_is_4_and_no_failed_plan() {
    let lab = Lab::new().env("RMEM_MEMORY", "file:robot.rmem").env("TMPDIR", "/nonexistent");
    let refused = crate::lab::plan(&lab, &["--planner", "ff"]).exits(4);
    assert!(refused.stderr.contains("no files can be made for a run in /nonexistent"), "{refused}");
    assert_eq!(lab.rmem(&["count", "robmem.plans"]).success(), "0\n");
}
