//! expire.

use crate::lab::{Lab, assert_run};

#[test]
fn expire_removes_what_decayed_and_at_a_restart_what_is_not_persistent() {
    let lab = Lab::new();
    let decayed = "{_id: 1, _robmem_info: {decay_time: ISODate('2001-01-01')}}";
    lab.rmem(&["insert", "robmem.seen", "{_id: 2, _robmem_info: {persistent: false}}", "{_id: 3}", decayed]).success();
    assert_eq!(lab.rmem(&["count", "robmem.seen"]).success(), "2\n");
    assert_eq!(
        lab.rmem(&["expire"]).success(),
        "{\"namespace\":\"robmem.seen\",\"decayed\":1,\"computed\":0,\"due\":0,\"not_persistent\":0}\n"
    );
    assert_eq!(lab.rmem(&["expire"]).success(), "");
    assert_run!(lab.rmem(&["expire", "--restart"]), @r#"
    {"namespace":"robmem.seen","decayed":0,"computed":0,"due":0,"not_persistent":1}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_eq!(lab.rmem(&["query", "robmem.seen"]).success(), "{\"_id\":3}\n");
}

#[test]
fn a_key_that_only_decayed_documents_have_is_free() {
    let lab = Lab::new();
    lab.rmem(&["index", "robmem.seen", "{tag: 1}", "--unique"]).success();
    let decayed: Vec<String> = (0..200)
        .map(|n| format!("{{_id: {n}, tag: 't{n}', _robmem_info: {{decay_time: ISODate('2001-01-01')}}}}"))
        .collect();
    let decayed: Vec<&str> = decayed.iter().map(String::as_str).collect();
    lab.rmem(&[&["insert", "robmem.seen"], &decayed[..]].concat()).success();
    lab.rmem(&["insert", "robmem.seen", "{_id: 199, tag: 'mine'}"]).success();
    lab.rmem(&["insert", "robmem.seen", "{_id: 'new', tag: 't198'}"]).success();
    assert_eq!(lab.rmem(&["count", "robmem.seen"]).success(), "2\n");
    lab.rmem(&["insert", "robmem.seen", "{_id: 199}"]).exits(5);
}
