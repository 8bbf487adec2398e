//! map-reduce.

use crate::lab::{assert_run, three_documents};

#[test]
fn values_are_reduced_by_key_and_printed_or_stored() {
    let lab = three_documents();
    let functions =
        ["--map", "function() { emit(this.relation, this.n) }", "--reduce", "(key, values) => Array.sum(values)"];
    let printed = lab.rmem(&[["map-reduce", "robmem.worldmodel"].as_slice(), &functions].concat()).success();
    assert_eq!(printed, "{\"_id\":\"on\",\"value\":1.5}\n{\"_id\":\"on-table\",\"value\":7.0}\n");
    let stored = [["map-reduce", "robmem.worldmodel", "--out", "robmem.sums"].as_slice(), &functions].concat();
    assert_eq!(lab.rmem(&stored).success(), "");
    assert_eq!(lab.rmem(&["query", "robmem.sums", "{_id: 'on'}"]).success(), "{\"_id\":\"on\",\"value\":1.5}\n");
    let failing = ["map-reduce", "robmem.worldmodel", "--map", "function() { nothing() }", "--reduce", "() => 1"];
    assert_run!(lab.rmem(&failing), @r"
    ------- stderr -------
    error: <map>:1:1: JavaScript failed: ReferenceError: nothing is not defined
      |
    1 | function() { nothing() }
      | ^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    ");
}

#[test]
fn an_error_names_the_function_it_is_in() {
    let lab = three_documents();
    lab.write("sum.js", "\n(key, values) =>\n  total(values)\n");
    let map = "function() { emit(1, this.n) }";
    let run = |reduce: &str, finalize: &str| {
        let functions = ["--map", map, "--reduce", reduce, "--finalize", finalize];
        lab.rmem(&[["map-reduce", "robmem.worldmodel"].as_slice(), &functions].concat())
    };
    assert_run!(run("@sum.js", "(key, value) => value"), @r"
    ------- stderr -------
    error: sum.js:2:1: JavaScript failed: ReferenceError: total is not defined
      |
    2 | (key, values) =>
      | ^^^^^^^^^^^^^^^^
    [exit code: 3]
    ");
    assert_run!(run("() => 1", "(key, value) => value.a.b"), @r"
    ------- stderr -------
    error: <finalize>:1:1: JavaScript failed: TypeError: cannot read property 'b' of undefined
      |
    1 | (key, value) => value.a.b
      | ^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    ");
    assert_run!(run("@nofile", "() => 1"), @r"
    ------- stderr -------
    error: cannot read nofile: there is no such file or folder
    [exit code: 3]
    ");
}
