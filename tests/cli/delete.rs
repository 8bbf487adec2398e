//! delete, drop.

use crate::lab::{assert_run, three_documents};

#[test]
fn delete_removes_the_first_match_and_drop_the_collection() {
    let lab = three_documents();
    assert_eq!(lab.rmem(&["delete", "robmem.worldmodel", "{relation: 'on-table'}"]).success(), "1\n");
    assert_eq!(lab.rmem(&["delete", "robmem.worldmodel", "{relation: 'on-table'}"]).success(), "1\n");
    assert_eq!(lab.rmem(&["collections"]).success(), "robmem.worldmodel\n");
    lab.rmem(&["drop", "robmem.worldmodel"]).success();
    assert_eq!(lab.rmem(&["collections"]).success(), "");
}

#[test]
fn a_whole_database_is_dropped() {
    let lab = three_documents();
    lab.rmem(&["insert", "robmem.other", "{_id: 1}"]).success();
    lab.rmem(&["insert", "robmem2.kept", "{_id: 1}"]).success();
    assert_run!(lab.rmem(&["drop", "--database", "robmem"]), @r"
    ------- stderr -------
    2 collections removed: robmem.other, robmem.worldmodel
    [exit code: 0]
    ");
    assert_eq!(lab.rmem(&["collections"]).success(), "robmem2.kept\n");
    assert_run!(lab.rmem(&["drop", "--database", "robmem"]), @r"
    ------- stderr -------
    warning: there is no database robmem
    [exit code: 0]
    ");
    lab.rmem(&["drop", "--database", "robmem2.kept"]).exits(2);
    lab.rmem(&["drop"]).exits(2);
}
