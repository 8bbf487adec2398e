//! export mcap.

use crate::lab::{Lab, assert_run, kitchen};

#[test]
fn documents_become_a_log_of_messages_and_scenes() {
    let lab = Lab::new();
    let args = ["export", "mcap", "robmem.worldmodel", "--time", "mass", "-o", "log.mcap"];
    assert_run!(kitchen(&lab, &args), @r"
    ------- stderr -------
    2 documents, 2 of them objects of a scene; 4 without a time are left out
    [exit code: 0]
    ");
    let log = std::fs::read(lab.path().join("log.mcap")).unwrap();
    assert!(log.starts_with(b"\x89MCAP0\r\n") && log.ends_with(b"\x89MCAP0\r\n"));
    assert_run!(kitchen(&lab, &["export", "mcap", "robmem.worldmodel", "--time", "name", "-o", "none.mcap"]), @r"
    ------- stderr -------
    error: no document of robmem.worldmodel has a date or seconds under `name`
    [exit code: 3]
    ");
    assert!(!lab.path().join("none.mcap").exists());
}
