//! config: the layers of the settings, their origins, mistakes.

use crate::lab::{Lab, assert_run};

#[test]
fn later_layers_win_and_origins_are_printed() {
    let lab = Lab::new();
    lab.write("rmem.toml", "memory = \"file:robot.rmem\"\ncollection = \"a.file\"\n");
    assert_run!(lab.rmem(&["config"]), @r#"
    # settings file: $LAB/rmem.toml
    memory = "file:$LAB/robot.rmem"  # $LAB/rmem.toml:1
    # shared is not set
    shared_databases = []  # default
    collection = "a.file"  # $LAB/rmem.toml:2
    template_path = []  # default
    # format is not set
    # keep_history is not set
    # history_size is not set
    # log is not set
    ------- stderr -------
    [exit code: 0]
    "#);
    let lab = lab.env("RMEM_COLLECTION", "an.env");
    let text = lab.rmem(&["config"]).success();
    assert!(text.contains("collection = \"an.env\"  # environment variable RMEM_COLLECTION"), "{text}");
    let text = lab.rmem(&["config", "--collection", "a.flag"]).success();
    assert!(text.contains("collection = \"a.flag\"  # --collection"), "{text}");
}

#[test]
fn the_nearest_file_upwards_is_used() {
    let lab = Lab::new();
    lab.write("rmem.toml", "collection = \"outer.x\"\n");
    lab.write("deep/er/rmem.toml", "");
    let text = lab.shell("cd deep && rmem config").success();
    assert!(text.contains("collection = \"outer.x\""), "{text}");
    let text = lab.shell("cd deep/er && rmem config").success();
    assert!(text.contains("collection = \"robmem.worldmodel\"  # default"), "{text}");
}

#[test]
fn a_mistake_in_the_file_is_shown_at_its_place() {
    let lab = Lab::new();
    lab.write("rmem.toml", "memory = \"mem:\"\ncollektion = \"a.b\"\n");
    assert_run!(lab.rmem(&["collections"]), @r#"
    ------- stderr -------
    error: $LAB/rmem.toml:2:1: unknown field `collektion`, expected one of `memory`, `shared`, `shared_databases`, `collection`, `template_path`, `format`, `log`, `keep_history`, `history_size`, `most_documents`, `planner`, `computable`, `backend`, `scene`
      |
    2 | collektion = "a.b"
      | ^^^^^^^^^^
    [exit code: 3]
    "#);
}

#[test]
fn credentials_are_never_shown() {
    let lab = Lab::new();
    let uri = "mongodb://robot:s3cret@127.0.0.1:1/?serverSelectionTimeoutMS=100";
    let run = lab.rmem(&["--memory", uri, "config"]);
    assert!(!run.stdout.contains("s3cret"), "{run}");
    lab.write("rmem.toml", &format!("memory = \"{uri}\" x\n"));
    assert_run!(lab.rmem(&["config"]), @r#"
    ------- stderr -------
    error: $LAB/rmem.toml:1:77: unexpected key or value, expected newline, `#`
      |
    1 | …mongodb://************@127.0.0.1:1/?serverSelectionTimeoutMS=100" x
      |                                                                    ^
    [exit code: 3]
    "#);
    lab.write("rmem.toml", "");
    // What the driver says differs with its version.
    let run = lab.rmem(&["--memory", uri, "query", "robmem.x", "-v"]).exits(4);
    assert!(!run.stderr.contains("s3cret"), "{run}");
    assert!(run.stderr.contains("127.0.0.1:1"), "{run}");
}

#[test]
fn the_flag_overrules_a_format_of_the_environment_that_does_not_exist() {
    let lab = Lab::new().env("RMEM_FORMAT", "xml");
    assert_run!(lab.rmem(&["collections", "--memory", "mem:", "--format", "json"]), @r"
    []
    ------- stderr -------
    [exit code: 0]
    ");
    assert_run!(lab.rmem(&["collections", "--memory", "mem:"]), @r"
    ------- stderr -------
    error: set by environment variable RMEM_FORMAT
      caused by: unknown format `xml`; expected one of jsonl, json, canonical, table, csv, tsv, text, clips, ff, document, shell, dot, svg, timeline, moveit, moveit-msg, mjcf, sdf, urdf, openrave
    [exit code: 2]
    ");
}

#[test]
fn a_format_set_for_good_is_for_the_commands_that_have_it() {
    let lab = Lab::new().env("RMEM_FORMAT", "clips");
    lab.rmem(&["insert", "robmem.x", "{_id: 1}", "-q"]).success();
    assert_run!(lab.rmem(&["query", "robmem.x"]), @r#"
    {"_id":1}
    ------- stderr -------
    warning: `rmem query` has no format `clips`, which RMEM_FORMAT names; it has jsonl, json, canonical, table, csv, tsv
    [exit code: 0]
    "#);
    lab.rmem(&["query", "robmem.x", "--format", "clips"]).exits(2);
    assert_eq!(lab.rmem(&["collections"]).exits(0).stderr.matches("no format").count(), 1);
    // A format of the settings is for the commands that have it.
    let lab = Lab::new();
    lab.write("rmem.toml", "format = 'clips'\n");
    assert_eq!(lab.rmem(&["--memory", "mem:", "collections"]).exits(0).stderr, "");
}

#[test]
fn a_variable_that_is_not_utf_8_is_refused() {
    assert_run!(Lab::new().shell("RMEM_MEMORY=$'file:\\xff' rmem count robmem.x"), @r"
    ------- stderr -------
    error: the environment variable RMEM_MEMORY is not valid UTF-8
    [exit code: 2]
    ");
}

#[test]
fn a_history_is_printed_as_it_is_written() {
    for (written, printed) in [
        ("keep_history = '24h'\n", "keep_history = \"1d\""),
        ("keep_history = '90m'\nhistory_size = '3M'\n", "keep_history = \"90m\""),
        (
            "[keep_history]\nrobmem = '1h'\n'robmem.camera' = 'off'\n",
            "keep_history = { \"robmem\" = \"1h\", \"robmem.camera\" = \"off\" }",
        ),
    ] {
        let lab = Lab::empty();
        lab.write("rmem.toml", written);
        let shown = lab.rmem(&["config"]).success();
        let lines: Vec<&str> =
            shown.lines().filter(|line| line.starts_with("keep_history") || line.starts_with("history_size")).collect();
        assert!(lines[0].starts_with(printed) && lines.len() == 2, "{shown}");
        // What is printed is read again, and is the same.
        lab.write("rmem.toml", &lines.join("\n"));
        assert!(lab.rmem(&["config"]).success().contains(printed), "{shown}");
    }
}

#[test]
fn a_memory_that_is_no_uri_is_an_error() {
    let lab = Lab::new();
    for (memory, instead) in
        [("localhost:27017", "use file:PATH, mem:, mongodb://…"), ("lager.rmem", "file:lager.rmem")]
    {
        let run = lab.rmem(&["--memory", memory, "config"]).exits(2);
        assert!(run.stderr.starts_with("error: ") && run.stderr.contains(instead), "{run}");
    }
}

#[test]
fn settings_in_yaml_are_an_error_that_says_so() {
    let lab = Lab::new();
    lab.write("robot-memory.yaml", "plugins/robot-memory:\n  database: robmem\n");
    let run = lab.rmem(&["--config", "robot-memory.yaml", "config"]);
    assert!(run.code != 0 && run.stderr.contains("= hint: settings are TOML, not YAML"), "{run}");
}

#[test]
fn an_address_in_the_file_that_is_none_is_an_error_at_its_place() {
    let lab = Lab::new();
    lab.write("memory.toml", "memory = \"foo\"\n");
    lab.write("shared.toml", "collection = 'a.b'\nshared = 'mongodb://me:s3cret@'\n");
    assert_run!(lab.rmem(&["--config", "memory.toml", "config"]), @r#"
    ------- stderr -------
    error: $LAB/memory.toml:1:10: `foo` is not the URI of a store; for a file write `file:foo`
      |
    1 | memory = "foo"
      |          ^^^^^
    [exit code: 3]
    "#);
    assert_run!(lab.rmem(&["--config", "shared.toml", "count", "a.b"]), @r"
    ------- stderr -------
    error: $LAB/shared.toml:2:10: the address has no host, or its port is not a number; expected mongodb://HOST:PORT, or mongodb://USER:PASSWORD@HOST:PORT
      |
    2 | shared = 'mongodb://*********@'
      |          ^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["--shared", "foo", "config"]), @r"
    ------- stderr -------
    error: `foo` is not the URI of a store; for a file write `file:foo` (set by --shared)
    [exit code: 2]
    ");
}

#[test]
fn a_wrong_type_is_said_in_plain_words() {
    let lab = Lab::new();
    lab.write("rmem.toml", "[backend.local]\npath = 'x'\nport = 'y'\n");
    assert_run!(lab.rmem(&["config"]), @r#"
    ------- stderr -------
    error: $LAB/rmem.toml:3:8: expected a whole number from 0 to 65535, found "y"
      |
    3 | port = 'y'
      |        ^^^
    [exit code: 3]
    "#);
    lab.write("rmem.toml", "[planner.x]\ncommand = ['true', '{foo}']\n");
    assert_run!(lab.rmem(&["config"]), @r"
    ------- stderr -------
    error: $LAB/rmem.toml:2:21: `{foo}` stands for no file of the run; expected `{domain}`, `{problem}` or `{plan}`, or blanks inside braces of the program's own
      |
    2 | command = ['true', '{foo}']
      |                     ^^^^^
    [exit code: 3]
    ");
}

#[test]
fn the_size_of_a_history_is_printed_with_its_own_origin_and_said_where_it_has_no_effect() {
    let lab = Lab::empty();
    lab.write("rmem.toml", "keep_history = '1h'\n");
    let shown = lab.rmem(&["config"]).success();
    assert!(shown.contains("history_size = \"64M\"  # default\n"), "{shown}");
    lab.write("rmem.toml", "keep_history = '1h'\nhistory_size = '3M'\n");
    let run = lab.rmem(&["config"]);
    assert!(run.stdout.contains("history_size = \"3M\"  # $LAB/rmem.toml:2\n") && run.stderr.is_empty(), "{run}");
    lab.write("rmem.toml", "history_size = '3M'\n");
    let run = lab.rmem(&["config"]);
    assert!(run.stdout.contains("history_size = \"3M\"  # $LAB/rmem.toml:1\n"), "{run}");
    assert_eq!(run.stderr, "warning: history_size has no effect without keep_history\n");
}

#[test]
fn the_kinds_of_objects_in_scenes_are_printed() {
    let lab = Lab::empty();
    lab.write("rmem.toml", "[[scene.object]]\nname = 'cup'\ncollection = 'robmem.things'\nquery = '{type: \"cup\"}'\n");
    let shown = lab.rmem(&["config"]).success();
    assert!(shown.contains("scene.object cup in robmem.things: {\"type\":\"cup\"}\n"), "{shown}");
    let shown = lab.rmem(&["config", "--format", "json"]).success();
    assert!(shown.contains(r#""key":"scene.object.cup""#) || shown.contains(r#""key": "scene.object.cup""#), "{shown}");
}

#[test]
fn credentials_in_a_command_or_a_path_are_not_shown_and_not_stored() {
    let uri = "mongodb://robot:s3cret@127.0.0.1:1/db";
    let lab = Lab::new().env("RMEM_MEMORY", "file:robot.rmem");
    lab.write(
        "rmem.toml",
        &format!(
            "[planner.db]\ncommand = [\"sh\", \"-c\", \"exit 3\", \"x\", \"{uri}\", \"{{domain}}\", \"{{problem}}\"]\n\
             [[computable]]\nname = \"c\"\ncollection = \"a.b\"\nspec = \"{{c: 1}}\"\ncommand = [\"sh\", \"-c\", \"exit 3\", \"{uri}\"]\n"
        ),
    );
    lab.rmem(&["insert", "-q", "a.b", "{_id: 1}"]).success();
    let domain = "domains/blocksworld/domain.pddl";
    lab.rmem(&[
        "gen-problem",
        "--load",
        "fixtures/blocksworld.json",
        "-t",
        "templates/blocksworld/problem.pddl.j2",
        "-o",
        "p.pddl",
        "--goal",
        "(on A B)",
    ])
    .success();
    for line in [
        &["plan", "-d", domain, "-p", "p.pddl", "--planner", "db"][..],
        &["query", "robmem.plans", "--meta"],
        &["plan", "why", "last"],
        &["config"],
        &["computables"],
        &["query", "a.b", "{c: 1}"],
        &["doctor"],
        &["restore", uri],
        &["backup", uri],
        &["dump", "a.b", "-o", uri],
        &["query", uri],
        &["query", "a.b", uri],
        &["query", "a.b", "--config", uri],
    ] {
        let run = lab.rmem(line);
        assert!(!run.stdout.contains("s3cret") && !run.stderr.contains("s3cret"), "{line:?}: {run}");
    }
    lab.write("ns.toml", &format!("collection = \"{uri}\"\n"));
    let run = lab.rmem(&["--config", "ns.toml", "config"]);
    assert!(!run.stderr.contains("s3cret"), "{run}");
}
