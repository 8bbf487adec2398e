//! Every exit code, reached through the command line.

use crate::lab::{Lab, assert_run};

#[test]
fn the_table_is_in_the_help() {
    let lab = Lab::new();
    assert_run!(lab.rmem(&["exit-codes"]), @r"
      0  done; a plan was found (also an empty one)
      1  a well-formed no: different, invalid plan, trigger timed out
      2  usage
      3  bad input: document, query, template, PDDL, CLIPS, world file, answer of a computable
      4  store unreachable or failed; the program of a computable failed, or took too long
      5  conflict: unique key, validator, lock
     11  proven: no plan exists
     12  the planner gave up without proof
     22  out of memory limit
     23  out of time limit
     32  the planner crashed, or returned what is not a plan, or an invalid plan
     34  the planner cannot handle a feature the task uses
    127  planner program not found
    130  interrupted
    ------- stderr -------
    [exit code: 0]
    ");
    assert_run!(lab.rmem(&["help", "exit-codes"]), @r"
    Print the table of exit codes

    Usage: rmem exit-codes [OPTIONS]

    Options:
      -h, --help     Print help
      -V, --version  Print version

    Global options:
          --memory <URI>     Local store: file:PATH, mem:, or mongodb://… (default: a file in the user's
                             data directory) [env: RMEM_MEMORY]
          --shared <URI>     Store of shared databases (default: same as --memory) [env: RMEM_SHARED]
          --config <FILE>    Settings file (default: the nearest rmem.toml upwards, then the user's)
                             [env: RMEM_CONFIG]
          --load <WORLD>     Load a world file into the memory first (can be repeated)
          --format <FORMAT>  Output format: text, json (default: text) [env: RMEM_FORMAT]
          --collection <NS>  Default collection (default: robmem.worldmodel) [env: RMEM_COLLECTION]
      -q, --quiet            Print errors only
      -v, --verbose          Print each operation and its duration
          --color <WHEN>     Colour messages: auto, always, never (default: auto) [env: NO_COLOR]
          --log <FILE>       Append each operation to FILE as JSON lines [env: RMEM_LOG]

    Exit codes:
        0  done; a plan was found (also an empty one)
        1  a well-formed no: different, invalid plan, trigger timed out
        2  usage
        3  bad input: document, query, template, PDDL, CLIPS, world file, answer of a computable
        4  store unreachable or failed; the program of a computable failed, or took too long
        5  conflict: unique key, validator, lock
       11  proven: no plan exists
       12  the planner gave up without proof
       22  out of memory limit
       23  out of time limit
       32  the planner crashed, or returned what is not a plan, or an invalid plan
       34  the planner cannot handle a feature the task uses
      127  planner program not found
      130  interrupted

    Example:
      rmem help exit-codes
    ------- stderr -------
    [exit code: 0]
    ");
}

#[test]
fn usage_is_2() {
    let lab = Lab::new();
    assert_run!(lab.rmem(&["no-such-command"]), @r"
    ------- stderr -------
    error: unrecognized subcommand 'no-such-command'

    Usage: rmem [OPTIONS] <COMMAND>

    For more information, try '--help'.
    [exit code: 2]
    ");
    assert_run!(lab.rmem(&["query"]), @r"
    ------- stderr -------
    error: the following required arguments were not provided:
      <NS>

    Usage: rmem query <NS> [QUERY]

    For more information, try '--help'.
    [exit code: 2]
    ");
    assert_run!(lab.rmem(&["query", "no-dot"]), @r"
    ------- stderr -------
    error: invalid value 'no-dot' for '<NS>': `no-dot` is not a namespace: it has no dot; expected DATABASE.COLLECTION, like robmem.worldmodel

    For more information, try '--help'.
    [exit code: 2]
    ");
    assert_run!(lab.rmem(&["delete", "robmem.x"]), @r"
    ------- stderr -------
    error: an empty query matches every document of robmem.x; expected a query, or --all
    [exit code: 2]
    ");
    assert_run!(lab.rmem(&["--format", "dot", "query", "robmem.x"]), @r"
    ------- stderr -------
    error: `rmem query` has no format `dot`; it has jsonl, json, canonical, table, csv, tsv
    [exit code: 2]
    ");
}

#[test]
fn bad_input_is_3() {
    let lab = Lab::new();
    assert_run!(lab.rmem(&["insert", "robmem.x", "{a: 1"]), @r"
    ------- stderr -------
    error: <argument>:1:6: expected `,` or `}`, found the end of the text
      |
    1 | {a: 1
      |      ^
      = hint: the `{` at 1:1 is not closed
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["query", "robmem.x", "{a: {$nosuch: 1}}"]), @r"
    ------- stderr -------
    error: <query>:1:6: unknown operator: $nosuch
      |
    1 | {a: {$nosuch: 1}}
      |      ^^^^^^^
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["insert", "robmem.x", "--file", "missing.json"]), @r"
    ------- stderr -------
    error: cannot read missing.json: there is no such file or folder
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["--config", "missing.toml", "config"]), @r"
    ------- stderr -------
    error: cannot read the settings $LAB/missing.toml: there is no such file or folder
    [exit code: 3]
    ");
}

#[test]
fn an_unreachable_store_is_4() {
    let lab = Lab::new();
    assert_run!(lab.rmem(&["--memory", "file:/proc/none/x.rmem", "query", "robmem.x"]), @r"
    ------- stderr -------
    error: cannot open file:/proc/none/x.rmem: its folder /proc/none does not exist; create it first
    [exit code: 4]
    ");
    lab.write(
        "not-a-memory",
        "this is a text, long enough to be no database header of any kind ......................",
    );
    assert_run!(lab.rmem(&["--memory", "file:not-a-memory", "query", "robmem.x"]), @r"
    ------- stderr -------
    error: file:not-a-memory: it is not an rmem memory; name another file
    [exit code: 4]
    ");
}

#[test]
fn a_taken_key_is_5() {
    let lab = Lab::new();
    lab.rmem(&["insert", "robmem.x", "{_id: 1}"]).success();
    assert_run!(lab.rmem(&["insert", "robmem.x", "{_id: 0}", "{_id: 1}", "{_id: 2}"]), @r"
    0
    ------- stderr -------
    error: <argument 2>:1:1: robmem.x already has a document with _id: 1
      |
    1 | {_id: 1}
      | ^
      1 document was stored before it
    [exit code: 5]
    ");
    assert_eq!(lab.rmem(&["count", "robmem.x"]).success(), "2\n");
}

#[test]
fn a_reader_that_leaves_is_no_error() {
    let lab = Lab::new();
    lab.rmem_with(&["insert", "robmem.x", "-q"], &"{a: 'some text to fill the pipe with'}\n".repeat(5_000)).success();
    let run = lab.shell("rmem query robmem.x | head -n 1 | wc -l");
    assert_eq!((run.stdout.trim(), run.stderr.as_str()), ("1", ""), "{run}");
}

#[test]
fn a_reader_that_leaves_does_not_end_an_insert() {
    let lab = Lab::new();
    lab.write("many.jsonl", &"{a: 1}\n".repeat(20_000));
    lab.shell("rmem insert robmem.x --file many.jsonl | head -n 1").exits(0);
    assert_eq!(lab.rmem(&["count", "robmem.x"]).success(), "20000\n");
}

#[test]
fn a_full_stdout_is_4_and_named() {
    let lab = Lab::new();
    lab.rmem(&["insert", "robmem.x", "{a: 1}", "-q"]).success();
    assert_run!(lab.shell("rmem query robmem.x > /dev/full"), @r"
    ------- stderr -------
    error: cannot write to stdout: the disk is full
    [exit code: 4]
    ");
}

#[test]
fn an_input_that_cannot_be_read_is_3_and_an_output_that_cannot_be_written_4() {
    let lab = Lab::new();
    std::fs::create_dir(lab.path().join("folder")).unwrap();
    assert_run!(lab.rmem(&["insert", "robmem.x", "--file", "folder"]), @r"
    ------- stderr -------
    error: cannot read folder: it is a folder
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["insert", "robmem.x", "--file", "missing"]), @r"
    ------- stderr -------
    error: cannot read missing: there is no such file or folder
    [exit code: 3]
    ");
    lab.rmem(&["insert", "robmem.x", "{a: 1}", "-q"]).success();
    assert_run!(lab.rmem(&["dump", "robmem.x", "-o", "folder"]), @r"
    ------- stderr -------
    robmem.x: 1 document
    [exit code: 0]
    ");
    assert_run!(lab.rmem(&["dump", "robmem.x", "-o", "missing/out.json"]), @r"
    ------- stderr -------
    error: cannot write missing/out.json: the folder missing does not exist; create it first
    [exit code: 4]
    ");
}

#[test]
fn stdin_is_read_once() {
    let lab = Lab::new();
    assert_run!(lab.rmem_with(&["insert", "robmem.x", "-", "-"], "{}"), @r#"
    {"$oid":"[ID]"}
    ------- stderr -------
    error: stdin can be read only once; expected `-` for one input at most
      1 document was stored before it
    [exit code: 2]
    "#);
    assert_run!(lab.rmem_with(&["--load", "-", "insert", "robmem.x", "-"], "{}"), @r"
    ------- stderr -------
    error: stdin can be read only once; expected `-` for one input at most
    [exit code: 2]
    ");
}

#[test]
fn a_query_mistake_is_shown_at_its_operator() {
    let lab = Lab::new();
    lab.rmem(&["insert", "robmem.x", "{a: 1}", "-q"]).success();
    assert_run!(lab.rmem(&["query", "robmem.x", "{a: {$nosuch: 1}}"]), @r"
    ------- stderr -------
    error: <query>:1:6: unknown operator: $nosuch
      |
    1 | {a: {$nosuch: 1}}
      |      ^^^^^^^
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["update", "robmem.x", "{}", "{$nosuch: {a: 1}}"]), @r"
    ------- stderr -------
    error: <update>:1:2: unknown modifier: $nosuch; expected an update operator, a replacement, or a pipeline
      |
    1 | {$nosuch: {a: 1}}
      |  ^^^^^^^
    [exit code: 3]
    ");
}
