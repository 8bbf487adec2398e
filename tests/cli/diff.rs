//! diff.

use crate::lab::{Lab, assert_run};
use crate::restore::{changed, dumped};

#[test]
fn a_memory_in_the_place_of_a_file_is_named_as_one() {
    let lab = Lab::empty();
    lab.rmem(&["--memory", "file:c.rmem", "insert", "a.b", "{_id: 1}"]).success();
    lab.rmem(&["--memory", "file:c.rmem", "dump", "--all", "-o", "world.json"]).success();
    for sides in [["c.rmem", "world.json"], ["world.json", "c.rmem"]] {
        let refused = lab.rmem(&["diff", sides[0], sides[1]]).exits(3);
        let wanted = "error: c.rmem: it is a memory, which file:c.rmem names, or another SQLite database\n";
        assert_eq!(refused.stderr, wanted);
    }
    assert_eq!(lab.rmem(&["diff", "file:c.rmem", "world.json"]).success(), "");
}

#[test]
fn what_is_no_memory_is_named_without_a_password() {
    let lab = Lab::empty();
    for wrong in ["MongoDB://user:s3cret@h/", "postgres://user:s3cret@h/db"] {
        let refused = lab.rmem(&["diff", "mem:", wrong]).exits(2);
        assert!(refused.stderr.contains("no store has the scheme") && !refused.stderr.contains("s3cret"), "{refused}");
    }
    lab.rmem(&["diff", "mem:", "file:missing.rmem"]).exits(4);
    assert!(!lab.path().join("missing.rmem").exists());
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
    assert_run!(lab.rmem(&["diff", "a.json", "missing.json"]), @r"
    ------- stderr -------
    error: cannot read missing.json
      caused by: there is no such file or folder
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["diff", "a.json", "file:missing.rmem"]), @r"
    ------- stderr -------
    error: cannot open file:missing.rmem: there is no such file; check its name, or make one: `rmem insert`, `rmem restore` and --load do
    [exit code: 4]
    ");
    assert!(!lab.path().join("missing.rmem").exists());
    assert_run!(lab.rmem(&["diff", "a.json", "mem:x"]), @r"
    ------- stderr -------
    error: `mem:` takes no path; for a file write file:PATH
    [exit code: 2]
    ");
}

#[test]
fn only_the_named_collections_are_compared() {
    let lab = Lab::new();
    lab.write("a.json", "{'a.b': [{_id: 1}], 'a.c': [{_id: 1}], 'a.d': []}");
    lab.write("b.json", "{'a.b': [{_id: 1, n: 1}], 'a.c': [{_id: 1}], 'x.y': [{_id: 1}]}");
    let diff = |more: &[&'static str]| lab.rmem(&[&["diff", "a.json", "b.json"], more].concat());
    assert_eq!(diff(&["--only", "a.c"]).success(), "");
    assert_eq!(diff(&["--only", "x.y"]).exits(1).stdout, "+ x.y {\"_id\":1}\n");
    assert_eq!(diff(&["--only", "a.c", "--only", "a.b"]).exits(1).stdout, "~ a.b 1 {} -> {\"n\":1}\n");
    assert_run!(diff(&["--only", "x.z"]), @r"
    ------- stderr -------
    error: neither A nor B has a collection x.z; did you mean x.y?
    [exit code: 3]
    ");
}

#[test]
fn a_value_that_is_not_a_number_is_not_named_where_it_stays() {
    let lab = Lab::new();
    lab.write("a.json", r#"{"a.b": [{"_id": 1, "x": {"$numberDouble": "NaN"}, "y": 1}]}"#);
    lab.write("b.json", r#"{"a.b": [{"_id": 1, "x": {"$numberDouble": "NaN"}, "y": 2}]}"#);
    assert_eq!(lab.rmem(&["diff", "a.json", "b.json"]).exits(1).stdout, "~ a.b 1 {\"y\":1} -> {\"y\":2}\n");
}
