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
    let run = lab.shell("rmem query robmem.x > /dev/full").exits(4);
    assert!(run.stderr.contains("stdout"), "{run}");
}

#[test]
fn an_input_that_cannot_be_read_is_3_and_an_output_that_cannot_be_written_4() {
    let lab = Lab::new();
    std::fs::create_dir(lab.path().join("folder")).unwrap();
    for args in [["insert", "robmem.x", "--file", "folder"], ["insert", "robmem.x", "--file", "missing"]] {
        let run = lab.rmem(&args).exits(3);
        assert!(run.stderr.contains("cannot read"), "{run}");
    }
    lab.rmem(&["insert", "robmem.x", "{a: 1}", "-q"]).success();
    for path in ["folder", "missing/out.json"] {
        let run = lab.rmem(&["dump", "robmem.x", "-o", path]);
        assert!(run.code == 4 || path == "folder", "{run}");
        assert!(!run.stderr.contains(".rmem-"), "{run}");
    }
}

#[test]
fn stdin_is_read_once() {
    let lab = Lab::new();
    for args in [&["insert", "robmem.x", "-", "-"][..], &["--load", "-", "insert", "robmem.x", "-"]] {
        let run = lab.rmem_with(args, "{}").exits(2);
        assert!(run.stderr.contains("stdin can be read only once"), "{run}");
    }
}

#[test]
fn a_query_mistake_is_shown_at_its_operator() {
    let lab = Lab::new();
    lab.rmem(&["insert", "robmem.x", "{a: 1}", "-q"]).success();
    let run = lab.rmem(&["query", "robmem.x", "{a: {$nosuch: 1}}"]).exits(3);
    assert!(run.stderr.contains("<query>:1:6: unknown operator: $nosuch"), "{run}");
    assert!(run.stderr.contains("^^^^^^^"), "{run}");
    let run = lab.rmem(&["update", "robmem.x", "{}", "{$nosuch: {a: 1}}"]).exits(3);
    assert!(run.stderr.contains("<update>:1:2:"), "{run}");
}
