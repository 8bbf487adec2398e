//! --verbose and --log.

use crate::lab::{Lab, assert_run};

#[test]
fn operations_are_printed_under_v_and_logged() {
    let lab = Lab::new();
    lab.rmem(&["insert", "robmem.x", "{a: 1}", "{a: 2}", "-q"]).success();
    assert_run!(lab.rmem(&["query", "robmem.x", "-v", "--log", "rmem.log"]), @r#"
    {"_id":{"$oid":"[ID]"},"a":1}
    {"_id":{"$oid":"[ID]"},"a":2}
    ------- stderr -------
    find robmem.x: 2 documents in [DURATION]
    [exit code: 0]
    "#);
    let entry: serde_json::Value = serde_json::from_str(lab.read("rmem.log").trim()).unwrap();
    assert_eq!((&entry["operation"], &entry["subject"]), (&"find".into(), &"robmem.x".into()));
    assert!(entry["milliseconds"].is_f64());
    let run = lab.rmem(&["query", "robmem.x", "-q"]).exits(0);
    assert_eq!(run.stderr, "");
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
