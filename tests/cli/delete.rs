//! delete, drop.

use crate::lab::three_documents;

#[test]
fn delete_removes_the_first_match_and_drop_the_collection() {
    let lab = three_documents();
    assert_eq!(lab.rmem(&["delete", "robmem.worldmodel", "{relation: 'on-table'}"]).success(), "1\n");
    assert_eq!(lab.rmem(&["delete", "robmem.worldmodel", "{relation: 'on-table'}"]).success(), "1\n");
    assert_eq!(lab.rmem(&["collections"]).success(), "robmem.worldmodel\n");
    lab.rmem(&["drop", "robmem.worldmodel"]).success();
    assert_eq!(lab.rmem(&["collections"]).success(), "");
}
