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
    error: JavaScript failed: ReferenceError: nothing is not defined
    [exit code: 3]
    ");
}
