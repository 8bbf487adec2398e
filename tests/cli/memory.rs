//! --memory: which memory a command opens, and which files are refused.

use std::os::unix::fs::PermissionsExt as _;

use crate::lab::{Lab, assert_run};
use crate::repair::{DAMAGE, lab, sql};

#[test]
fn a_file_that_is_not_there_is_no_empty_memory_to_commands_that_read() {
    let lab = Lab::new();
    let commands: [&[&str]; 9] = [
        &["query", "robmem.blocks"],
        &["count", "robmem.blocks"],
        &["collections"],
        &["update", "robmem.blocks", "{}", "{$set: {a: 1}}"],
        &["delete", "robmem.blocks", "{a: 1}"],
        &["drop", "robmem.blocks"],
        &["index", "robmem.blocks"],
        &["dump", "--all", "-o", "-"],
        &["gen-problem", "--template", "templates/blocksworld/problem.pddl.j2", "--goal", "(on A B)"],
    ];
    let lab = lab.env("RMEM_MEMORY", "file:tpyo.rmem");
    assert_run!(lab.transcript(&commands), @r"
    $ rmem query robmem.blocks
    ------- stderr -------
    error: cannot open file:tpyo.rmem: there is no such file; check its name, or make one: `rmem insert`, `rmem restore` and --load do
    [exit code: 4]
    $ rmem count robmem.blocks
    ------- stderr -------
    error: cannot open file:tpyo.rmem: there is no such file; check its name, or make one: `rmem insert`, `rmem restore` and --load do
    [exit code: 4]
    $ rmem collections
    ------- stderr -------
    error: cannot open file:tpyo.rmem: there is no such file; check its name, or make one: `rmem insert`, `rmem restore` and --load do
    [exit code: 4]
    $ rmem update robmem.blocks '{}' '{$set: {a: 1}}'
    ------- stderr -------
    error: cannot open file:tpyo.rmem: there is no such file; check its name, or make one: `rmem insert`, `rmem restore` and --load do
    [exit code: 4]
    $ rmem delete robmem.blocks '{a: 1}'
    ------- stderr -------
    error: cannot open file:tpyo.rmem: there is no such file; check its name, or make one: `rmem insert`, `rmem restore` and --load do
    [exit code: 4]
    $ rmem drop robmem.blocks
    ------- stderr -------
    error: cannot open file:tpyo.rmem: there is no such file; check its name, or make one: `rmem insert`, `rmem restore` and --load do
    [exit code: 4]
    $ rmem index robmem.blocks
    ------- stderr -------
    error: cannot open file:tpyo.rmem: there is no such file; check its name, or make one: `rmem insert`, `rmem restore` and --load do
    [exit code: 4]
    $ rmem dump --all -o -
    ------- stderr -------
    error: cannot open file:tpyo.rmem: there is no such file; check its name, or make one: `rmem insert`, `rmem restore` and --load do
    [exit code: 4]
    $ rmem gen-problem --template templates/blocksworld/problem.pddl.j2 --goal '(on A B)'
    ------- stderr -------
    error: cannot open file:tpyo.rmem: there is no such file; check its name, or make one: `rmem insert`, `rmem restore` and --load do
    [exit code: 4]
    ");
    lab.rmem(&["--memory", "file:tpyo.rmem", "query", "robmem.blocks"]).exits(4);
    assert!(!lab.path().join("tpyo.rmem").exists());
}

#[test]
fn what_stores_something_makes_the_file() {
    let lab = Lab::new();
    lab.write("world.json", r#"{"robmem.blocks": [{"_id": 1}]}"#);
    let commands: [&[&str]; 5] = [
        &["insert", "robmem.blocks", "{_id: 1}"],
        &["restore", "world.json"],
        &["restore", "world.json", "--drop"],
        &["--load", "world.json", "collections"],
        &["update", "robmem.blocks", "{_id: 1}", "{$set: {a: 1}}", "--upsert"],
    ];
    for (number, command) in commands.into_iter().enumerate() {
        let memory = format!("file:{number}.rmem");
        lab.rmem(&[&["--memory", &memory], command].concat()).success();
        assert_eq!(lab.rmem(&["--memory", &memory, "count", "robmem.blocks"]).success(), "1\n", "{command:?}");
    }
}

#[test]
fn the_memory_of_the_settings_may_be_empty_still() {
    let lab = Lab::new();
    assert_eq!(lab.rmem(&["count", "robmem.blocks"]).success(), "0\n");
    lab.write("rmem.toml", "memory = \"file:robot.rmem\"\n");
    assert_eq!(lab.rmem(&["count", "robmem.blocks"]).success(), "0\n");
    assert!(!lab.path().join("robot.rmem").exists());
}

#[test]
fn what_is_no_file_is_named_for_what_it_is() {
    let lab = Lab::empty();
    let script = "ln -s loop loop; mkfifo pipe";
    lab.shell(script).success();
    let other = rusqlite::Connection::open(lab.path().join("other")).unwrap();
    other.execute_batch("CREATE TABLE t (a); DROP TABLE t; VACUUM").unwrap();
    drop(other);
    let files = ["file:loop", "file:pipe", "file:/dev/null", "file:other"];
    let commands = files.map(|file| ["--memory", file, "insert", "a.b", "{}"]);
    assert_run!(lab.transcript(&commands.each_ref().map(|command| &command[..])), @r"
    $ rmem --memory file:loop insert a.b '{}'
    ------- stderr -------
    error: cannot open file:loop: it is a symbolic link that leads back to itself; name a file
    [exit code: 4]
    $ rmem --memory file:pipe insert a.b '{}'
    ------- stderr -------
    error: cannot open file:pipe: it is a pipe; name a file
    [exit code: 4]
    $ rmem --memory file:/dev/null insert a.b '{}'
    ------- stderr -------
    error: cannot open file:/dev/null: it is a device; name a file, or mem: for a memory without one
    [exit code: 4]
    $ rmem --memory file:other insert a.b '{}'
    ------- stderr -------
    error: file:other: it is an SQLite database of another program, not an rmem memory; name another file
    [exit code: 4]
    ");
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
    }
    assert_run!(lab.rmem(&["--memory", "mongodb://user:secret", "collections"]), @r"
    ------- stderr -------
    error: the address has no host, or its port is not a number; expected mongodb://HOST:PORT, or mongodb://USER:PASSWORD@HOST:PORT (set by --memory)
    [exit code: 2]
    ");
    assert_run!(lab.rmem(&["--memory", "mongodb+srv://u:secret", "collections"]), @r"
    ------- stderr -------
    error: the address has no host, or its port is not a number; expected mongodb+srv://HOST:PORT, or mongodb+srv://USER:PASSWORD@HOST:PORT (set by --memory)
    [exit code: 2]
    ");
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
    // The next words are the system's.
    assert!(refused.stderr.contains("cannot be written"), "{refused}");
}

#[test]
fn a_damaged_document_is_named_and_never_answered() {
    let lab = lab();
    sql(&lab, "robot.rmem", DAMAGE);
    let commands = [
        &["query", "a.b"][..],
        &["query", "a.b", "{m: 99}"],
        &["count", "a.b", "{m: {$exists: false}}"],
        &["aggregate", "a.b", "[{$group: {_id: null, n: {$sum: '$n'}}}]"],
        &["update", "a.b", "{}", "{$set: {x: 1}}", "--many"],
        &["dump", "a.b", "-o", "world.json"],
        &["dump", "--all", "-o", "folder"],
        &["diff", "file:robot.rmem", "mem:"],
    ];
    assert_run!(lab.transcript(&commands), @r#"
    $ rmem query a.b
    {"_id":1,"n":1}
    ------- stderr -------
    error: file:robot.rmem: the document with _id 2 of a.b is damaged: its checksum is wrong; list all damage with `rmem doctor --deep`, and copy what can be read into a new file with `rmem repair -o FILE`
    [exit code: 4]
    $ rmem query a.b '{m: 99}'
    ------- stderr -------
    error: file:robot.rmem: the document with _id 2 of a.b is damaged: its checksum is wrong; list all damage with `rmem doctor --deep`, and copy what can be read into a new file with `rmem repair -o FILE`
    [exit code: 4]
    $ rmem count a.b '{m: {$exists: false}}'
    ------- stderr -------
    error: file:robot.rmem: the document with _id 2 of a.b is damaged: its checksum is wrong; list all damage with `rmem doctor --deep`, and copy what can be read into a new file with `rmem repair -o FILE`
    [exit code: 4]
    $ rmem aggregate a.b "[{\$group: {_id: null, n: {\$sum: '\$n'}}}]"
    ------- stderr -------
    error: file:robot.rmem: the document with _id 2 of a.b is damaged: its checksum is wrong; list all damage with `rmem doctor --deep`, and copy what can be read into a new file with `rmem repair -o FILE`
    [exit code: 4]
    $ rmem update a.b '{}' '{$set: {x: 1}}' --many
    ------- stderr -------
    error: file:robot.rmem: the document with _id 2 of a.b is damaged: its checksum is wrong; list all damage with `rmem doctor --deep`, and copy what can be read into a new file with `rmem repair -o FILE`
    [exit code: 4]
    $ rmem dump a.b -o world.json
    ------- stderr -------
    error: file:robot.rmem: the document with _id 2 of a.b is damaged: its checksum is wrong; list all damage with `rmem doctor --deep`, and copy what can be read into a new file with `rmem repair -o FILE`
    [exit code: 4]
    $ rmem dump --all -o folder
    ------- stderr -------
    error: cannot read a.b
      caused by: file:robot.rmem: the document with _id 2 of a.b is damaged: its checksum is wrong; list all damage with `rmem doctor --deep`, and copy what can be read into a new file with `rmem repair -o FILE`
    [exit code: 4]
    $ rmem diff file:robot.rmem mem:
    ------- stderr -------
    error: file:robot.rmem: the document with _id 2 of a.b is damaged: its checksum is wrong; list all damage with `rmem doctor --deep`, and copy what can be read into a new file with `rmem repair -o FILE`
    [exit code: 4]
    "#);
    assert_eq!(lab.rmem(&["query", "a.b", "{_id: 1}"]).success(), "{\"_id\":1,\"n\":1}\n");
}

#[test]
fn a_store_that_cannot_be_read_is_4_wherever_it_is_read() {
    let lab = Lab::empty();
    lab.write("text.rmem", &"this is not a memory ".repeat(100));
    lab.write("world.json", "{\"a.b\": []}");
    let lab = lab.env("RMEM_MEMORY", "file:text.rmem");
    let commands = [
        &["dump", "--all"][..],
        &["dump", "a.b", "-o", "other.json"],
        &["dump", "a.b", "-o", "folder"],
        &["diff", "file:text.rmem", "mem:"],
        &["restore", "world.json"],
        &["plan", "list"],
    ];
    assert_run!(lab.transcript(&commands), @r"
    $ rmem dump --all
    ------- stderr -------
    error: file:text.rmem: it is not an rmem memory; name another file
    [exit code: 4]
    $ rmem dump a.b -o other.json
    ------- stderr -------
    error: file:text.rmem: it is not an rmem memory; name another file
    [exit code: 4]
    $ rmem dump a.b -o folder
    ------- stderr -------
    error: file:text.rmem: it is not an rmem memory; name another file
    [exit code: 4]
    $ rmem diff file:text.rmem mem:
    ------- stderr -------
    error: file:text.rmem: it is not an rmem memory; name another file
    [exit code: 4]
    $ rmem restore world.json
    ------- stderr -------
    error: cannot restore the dump; nothing was changed
      caused by: file:text.rmem: it is not an rmem memory; name another file
    [exit code: 4]
    $ rmem plan list
    ------- stderr -------
    error: file:text.rmem: it is not an rmem memory; name another file
    [exit code: 4]
    ");
}

#[test]
fn what_is_of_this_robot_alone_needs_no_team() {
    let lab = Lab::empty();
    lab.write(
        "rmem.toml",
        "memory = 'file:robot.rmem'\nshared = 'file:/proc/none/team.rmem'\nshared_databases = ['team']\n",
    );
    lab.rmem(&["insert", "own.a", "{_id: 1}"]).success();
    for (arguments, code) in [
        (&["query", "own.a", "{_id: 2}"][..], 0),
        (&["count", "own.b"], 0),
        (&["update", "own.a", "{_id: 2}", "{$set: {a: 1}}"], 0),
        (&["delete", "own.a", "{_id: 2}"], 0),
        (&["dump", "own.a", "-o", "a.json"], 0),
        (&["dump", "own.a", "-o", "folder"], 0),
        (&["watch", "own.a", "--timeout", "10ms"], 1),
        (&["diff", "file:robot.rmem", "a.json"], 0),
    ] {
        let run = lab.rmem(arguments).exits(code);
        assert!(!run.stderr.contains("/proc/none"), "{arguments:?}: {run}");
    }
    let copied = lab.rmem(&["backup", "copy.rmem"]).exits(0).stderr;
    assert!(copied.contains("what is shared is not in the copy: team at file:/proc/none/team.rmem\n"), "{copied}");
    lab.rmem(&["insert", "own.a", "{_id: 3, _robmem_info: {decay_time: ISODate('2001-01-01')}}"]).success();
    let expired = lab.rmem(&["expire"]).exits(4);
    assert!(expired.stdout.contains("\"decayed\":1"), "{expired}");
    let few = lab.rmem(&["expire", "--most", "team.a=1", "--most", "own.a=0"]).exits(4);
    assert!(few.stdout.contains("\"surplus\":1"), "{few}");
    lab.rmem(&["restore", "a.json", "--drop"]).success();
    let sum = "{name: 'sum', collection: 'own.a', spec: {sum: true}, pipeline: []}";
    lab.rmem(&["computables", "add", sum]).exits(0);
    // A file that is not there has no computables, but a server may have some.
    let shared = ["--shared", "mongodb://127.0.0.1:1/?serverSelectionTimeoutMS=100"];
    let kept = lab.rmem(&[&shared[..], &["computables"]].concat()).exits(4).stdout;
    assert!(kept.contains("\"sum\""), "{kept}");
    let listed = lab.rmem(&["collections"]).exits(4);
    assert_eq!(listed.stdout, "own.a\n");
    for arguments in [&["query", "team.a"][..], &["dump", "--all"], &["collections"]] {
        let run = lab.rmem(arguments).exits(4);
        assert!(run.stderr.contains("cannot open file:/proc/none/team.rmem"), "{arguments:?}: {run}");
    }
    let found = lab.rmem(&["doctor"]).exits(4).stdout;
    assert_run!(found.lines().skip(1).take(2).collect::<Vec<_>>().join("\n"), @r"
    memory     file:$LAB/robot.rmem: ok, 1 collection
    shared     file:/proc/none/team.rmem: cannot open file:/proc/none/team.rmem: its folder /proc/none does not exist; create it first
    ");
}
