//! index, query --explain, expire, bench.

use crate::lab::Lab;

#[test]
fn an_index_is_made_listed_and_dropped() {
    let lab = Lab::new();
    let name = lab.rmem(&["index", "robmem.objects", "{name: 1, 'at.x': -1}", "--unique"]).success();
    assert_eq!(name, "name_1_at.x_-1\n");
    let listed = lab.rmem(&["index", "robmem.objects"]).success();
    assert_eq!(
        listed,
        "{\"v\":2,\"key\":{\"_id\":1},\"name\":\"_id_\"}\n\
         {\"v\":2,\"key\":{\"name\":1,\"at.x\":-1},\"name\":\"name_1_at.x_-1\",\"unique\":true}\n"
    );
    lab.rmem(&["index", "robmem.objects", "{name: 1, 'at.x': -1}", "--drop"]).success();
    assert_eq!(lab.rmem(&["index", "robmem.objects"]).success().lines().count(), 1);
}

#[test]
fn a_taken_unique_key_is_a_conflict_that_names_key_and_index() {
    let lab = Lab::new();
    lab.rmem(&["index", "robmem.objects", "{name: 1}", "--unique", "--name", "names"]).success();
    lab.rmem(&["insert", "robmem.objects", "{name: 'cup'}"]).success();
    let refused = lab.rmem(&["insert", "robmem.objects", "{name: 'cup'}"]).exits(5);
    assert!(refused.stderr.contains("name: \"cup\" (unique index names)"), "{refused}");
    lab.rmem(&["index", "robmem.objects", "{name: 1}", "--name", "names"]).exits(3);
}

#[test]
fn what_is_no_index_is_refused() {
    let lab = Lab::new();
    for (args, code) in [
        (vec!["index", "robmem.objects", "--unique"], 2),
        (vec!["index", "robmem.objects", "--drop"], 2),
        (vec!["index", "robmem.objects", "{a: 1}", "--ttl", "500ms"], 2),
        (vec!["index", "robmem.objects", "{a: 1, b: 1}", "--ttl", "1s"], 3),
        (vec!["index", "robmem.objects", "{a: 'text'}"], 3),
        (vec!["index", "robmem.objects", "{a: 0}"], 3),
    ] {
        lab.rmem(&args).exits(code);
    }
}

#[test]
fn explain_tells_how_a_query_is_answered() {
    let lab = Lab::new();
    lab.rmem(&["index", "robmem.objects", "{name: 1}"]).success();
    lab.rmem(&["insert", "robmem.objects", "{name: 'cup'}", "{name: 'jar'}"]).success();
    let account = lab.rmem(&["query", "robmem.objects", "{name: 'cup'}", "--explain"]).success();
    assert_eq!(
        account,
        "{\"index\":\"name_1\",\"keys\":{\"name\":1},\"bounds\":{\"name\":[\"[\\\"cup\\\", \\\"cup\\\"]\"]},\
         \"keys_examined\":1,\"documents_examined\":1,\"returned\":1}\n"
    );
    let scan = lab.rmem(&["query", "robmem.objects", "{mass: {$gt: 1}}", "--explain"]).success();
    assert_eq!(scan, "{\"index\":null,\"keys_examined\":0,\"documents_examined\":2,\"returned\":0}\n");
}

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
    assert!(lab.rmem(&["expire", "--restart"]).success().contains("\"not_persistent\":1"));
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
fn documents_do_not_expire_by_their_id() {
    let lab = Lab::new();
    let refused = lab.rmem(&["index", "robmem.seen", "{_id: 1}", "--ttl", "1s"]).exits(3);
    assert!(refused.stderr.contains("_id"), "{refused}");
}

#[test]
fn bench_measures_every_kind_of_work_and_draws_it() {
    let lab = Lab::new();
    let told = lab.rmem(&["bench", "--documents", "20", "--documents", "10", "--rounds", "2", "--plot", "plots"]);
    let told = told.success();
    assert_eq!(told.lines().count(), 12, "{told}");
    assert!(told.starts_with("{\"documents\":10,\"work\":\"insert\",\"embedded_us\":"), "{told}");
    assert!(lab.read("plots/memory.svg").contains("indexed update"));
    lab.rmem(&["bench", "--against", "file:x.rmem"]).exits(2);
}

#[test]
fn a_drop_without_a_name_says_how_an_index_is_named() {
    let lab = Lab::new();
    lab.rmem(&["index", "robmem.objects", "{name: 1}"]).success();
    let refused = lab.rmem(&["index", "robmem.objects", "--drop"]).exits(2);
    assert!(refused.stderr.contains("expected KEYS, like '{name: 1}', or --name NAME"), "{refused}");
}

#[test]
fn a_partial_index_is_unique_among_the_documents_that_match() {
    let store = rmem::store::Embedded::in_memory().unwrap();
    use rmem::store::{Index, Namespace, Store as _};
    let ns = Namespace { database: "robmem".to_owned(), collection: "objects".to_owned() };
    let partial = bson::doc! { "key": { "a": 1 }, "unique": true, "partialFilterExpression": { "n": { "$gt": 1 } } };
    store.create_index(&ns, &Index::parse(&partial).unwrap()).unwrap();
    let insert = |n: i32| store.insert(&ns, vec![bson::doc! { "a": 1, "n": n }]).is_ok();
    assert_eq!([insert(0), insert(1), insert(2), insert(3)], [true, true, true, false]);
    let find = rmem::store::Find { filter: bson::doc! { "a": 1 }, ..Default::default() };
    assert_eq!(store.find(&ns, &find).unwrap().count(), 3);
    for wrong in [
        bson::doc! { "n": { "$ne": 1 } },
        bson::doc! { "n": { "$exists": false } },
        bson::doc! { "$nor": [{ "n": 1 }] },
    ] {
        let partial = bson::doc! { "key": { "b": 1 }, "partialFilterExpression": wrong };
        assert!(store.create_index(&ns, &Index::parse(&partial).unwrap()).is_err());
    }
}
