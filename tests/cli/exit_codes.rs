//! Every exit code, reached through the command line.

use crate::lab::Lab;

#[test]
fn the_table_is_in_the_help() {
    let lab = Lab::new();
    let table = lab.rmem(&["exit-codes"]).success();
    let help = lab.rmem(&["help", "exit-codes"]).success();
    for line in table.lines() {
        assert!(help.contains(line.trim()), "{line}");
    }
    assert_eq!(table.lines().count(), 14);
}

#[test]
fn usage_is_2() {
    let lab = Lab::new();
    lab.rmem(&["no-such-command"]).exits(2);
    lab.rmem(&["query"]).exits(2);
    let run = lab.rmem(&["query", "no-dot"]).exits(2);
    assert!(run.stderr.contains("DATABASE.COLLECTION"), "{run}");
    let run = lab.rmem(&["delete", "robmem.x"]).exits(2);
    assert!(run.stderr.contains("--all"), "{run}");
    let run = lab.rmem(&["--format", "dot", "query", "robmem.x"]).exits(2);
    assert!(run.stderr.contains("no format `dot`"), "{run}");
}

#[test]
fn bad_input_is_3() {
    let lab = Lab::new();
    let run = lab.rmem(&["insert", "robmem.x", "{a: 1"]).exits(3);
    assert!(run.stderr.contains("<argument>:1:"), "{run}");
    lab.rmem(&["query", "robmem.x", "{a: {$nosuch: 1}}"]).exits(3);
    lab.rmem(&["insert", "robmem.x", "--file", "missing.json"]).exits(3);
    lab.rmem(&["--config", "missing.toml", "config"]).exits(3);
}

#[test]
fn an_unreachable_store_is_4() {
    let lab = Lab::new();
    let run = lab.rmem(&["--memory", "file:/proc/none/x.rmem", "query", "robmem.x"]).exits(4);
    assert!(run.stderr.contains("/proc/none/x.rmem"), "{run}");
    lab.write(
        "not-a-memory",
        "this is a text, long enough to be no database header of any kind ......................",
    );
    let run = lab.rmem(&["--memory", "file:not-a-memory", "query", "robmem.x"]).exits(4);
    assert!(run.stderr.contains("not-a-memory"), "{run}");
}

#[test]
fn a_taken_key_is_5() {
    let lab = Lab::new();
    lab.rmem(&["insert", "robmem.x", "{_id: 1}"]).success();
    let run = lab.rmem(&["insert", "robmem.x", "{_id: 0}", "{_id: 1}", "{_id: 2}"]).exits(5);
    assert!(run.stderr.contains("_id"), "{run}");
    assert_eq!(lab.rmem(&["count", "robmem.x"]).success(), "2\n");
}

#[test]
fn a_reader_that_leaves_is_no_error() {
    let lab = Lab::new();
    lab.rmem_with(&["insert", "robmem.x", "-q"], &"{a: 'some text to fill the pipe with'}\n".repeat(5_000)).success();
    let run = lab.shell("rmem query robmem.x | head -n 1 | wc -l");
    assert_eq!((run.stdout.trim(), run.stderr.as_str()), ("1", ""), "{run}");
}
