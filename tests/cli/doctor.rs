//! doctor.

use crate::lab::assert_run;
use crate::repair::{DAMAGE, lab, sql};

#[test]
fn doctor_finds_damaged_documents_and_indexes() {
    let lab = lab();
    let sound = lab.rmem(&["doctor", "--deep"]).success();
    assert!(sound.contains("checked    file:robot.rmem: 1 collection, 3 documents, 1 index\n"), "{sound}");
    sql(&lab, "robot.rmem", DAMAGE);
    sql(&lab, "robot.rmem", "DELETE FROM entries_1 WHERE position = 3; INSERT INTO entries_1 VALUES (x'00', 77)");
    let found = lab.rmem(&["doctor", "--deep"]).exits(4).stdout;
    let damage: Vec<&str> = found.lines().filter(|line| line.starts_with("damage ")).collect();
    assert_run!(damage.join("\n"), @r"
    damage     a.b: the document with _id 2 is damaged: its checksum is wrong
    damage     a.b: the index n_1 lacks 1 of 1 keys of the document with _id 3
    damage     a.b: the index n_1 has 2 keys of no document
    ");
}
