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

#[test]
fn a_collection_keeps_at_most_so_many_documents() {
    let lab = Lab::new();
    for id in 0..5 {
        lab.rmem(&["insert", "a.seen", &format!("{{_id: {}}}", 10 - id)]).success();
    }
    lab.rmem(&["update", "a.seen", "{_id: 10}", "{$set: {n: 1}}"]).success();
    lab.rmem(&["insert", "a.other", "{_id: 1}", "{_id: 2}"]).success();
    assert_run!(lab.rmem(&["expire", "--most", "a.seen=3"]), @r#"
    {"namespace":"a.seen","decayed":0,"computed":0,"due":0,"not_persistent":0,"surplus":2}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_eq!(lab.rmem(&["distinct", "a.seen", "_id"]).success(), "6\n7\n8\n");
    lab.write("rmem.toml", "[most_documents]\n\"a.seen\" = 1\n'a.other' = 2\n");
    assert_run!(lab.rmem(&["expire"]), @r#"
    {"namespace":"a.seen","decayed":0,"computed":0,"due":0,"not_persistent":0,"surplus":2}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_eq!(lab.rmem(&["distinct", "a.seen", "_id"]).success(), "6\n");
    assert_eq!(lab.rmem(&["count", "a.other"]).success(), "2\n");
    assert!(lab.rmem(&["config"]).success().contains("most_documents.a.seen = 1\n"));
    for wrong in ["a.seen", "a.seen=x", "seen=3"] {
        lab.rmem(&["expire", "--most", wrong]).exits(2);
    }
}

#[test]
fn of_many_documents_the_newest_stay() {
    let lab = Lab::new();
    lab.write("many.jsonl", &(0..2_500).map(|id| format!("{{\"_id\": {id}}}\n")).collect::<String>());
    lab.rmem(&["insert", "a.seen", "--file", "many.jsonl"]).success();
    lab.rmem(&["expire", "--most", "a.seen=100"]).success();
    assert_eq!(lab.rmem(&["count", "a.seen", "{_id: {$gte: 2400}}"]).success(), "100\n");
    assert_eq!(lab.rmem(&["count", "a.seen"]).success(), "100\n");
}
