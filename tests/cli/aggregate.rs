//! aggregate.

use crate::lab::{Lab, assert_run};

#[test]
fn a_pipeline_does_not_leave_its_store() {
    let lab = Lab::new();
    lab.write(
        "rmem.toml",
        "memory = \"file:local.rmem\"\nshared = \"file:shared.rmem\"\nshared_databases = [\"team\"]\n",
    );
    lab.rmem(&["insert", "own.a", "{_id: 1}"]).success();
    lab.rmem(&["insert", "team.a", "{_id: 2}"]).success();
    let mut refused = String::new();
    for (ns, stage) in [
        ("own.a", "{$out: {db: 'team', coll: 'leak'}}"),
        ("team.a", "{$out: {db: 'own', coll: 'leak'}}"),
        ("team.a", "{$merge: {into: {db: 'own', coll: 'leak'}}}"),
        ("own.a", "{$lookup: {from: {db: 'team', coll: 'a'}, pipeline: [], as: 'x'}}"),
    ] {
        refused += &lab.transcript(&[&["aggregate", ns, &format!("[{stage}]")]]);
    }
    assert_run!(refused, @r#"
    $ rmem aggregate own.a "[{\$out: {db: 'team', coll: 'leak'}}]"
    ------- stderr -------
    error: <pipeline>:1:1: team.leak is in the shared store, and a pipeline over the private own.a does not leave its store; query one and insert into the other
      |
    1 | [{$out: {db: 'team', coll: 'leak'}}]
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    $ rmem aggregate team.a "[{\$out: {db: 'own', coll: 'leak'}}]"
    ------- stderr -------
    error: <pipeline>:1:1: own.leak is in the private store, and a pipeline over the shared team.a does not leave its store; query one and insert into the other
      |
    1 | [{$out: {db: 'own', coll: 'leak'}}]
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    $ rmem aggregate team.a "[{\$merge: {into: {db: 'own', coll: 'leak'}}}]"
    ------- stderr -------
    error: <pipeline>:1:1: own.leak is in the private store, and a pipeline over the shared team.a does not leave its store; query one and insert into the other
      |
    1 | [{$merge: {into: {db: 'own', coll: 'leak'}}}]
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    $ rmem aggregate own.a "[{\$lookup: {from: {db: 'team', coll: 'a'}, pipeline: [], as: 'x'}}]"
    ------- stderr -------
    error: <pipeline>:1:1: team.a is in the shared store, and a pipeline over the private own.a does not leave its store; query one and insert into the other
      |
    1 | [{$lookup: {from: {db: 'team', coll: 'a'}, pipeline: [], as: 'x'}}]
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    "#);
    lab.rmem(&["aggregate", "team.a", "[{$out: {db: 'team', coll: 'b'}}]"]).success();
    assert_eq!(lab.rmem(&["collections"]).success().lines().count(), 3);
}

#[test]
fn a_stage_with_two_keys_is_refused_wherever_it_stands() {
    let lab = Lab::new();
    lab.rmem(&["insert", "-q", "robmem.a", "{_id: 1}", "{_id: 2}"]).success();
    let two = "{$match: {}, $limit: 1}";
    for pipeline in [
        format!("[{two}]"),
        format!("[{{$match: {{}}}}, {two}]"),
        "[{$limit: 1, $match: {}}]".to_owned(),
        format!("[{{$lookup: {{from: 'a', pipeline: [{two}], as: 'x'}}}}]"),
        format!("[{{$lookup: {{from: 'a', pipeline: [{{$match: {{}}}}, {two}], as: 'x'}}}}]"),
        format!("[{{$unionWith: {{coll: 'a', pipeline: [{two}]}}}}]"),
        format!("[{{$facet: {{x: [{two}]}}}}]"),
        format!("[{{$match: {{}}}}, {{$facet: {{x: [{{$unionWith: {{coll: 'a', pipeline: [{two}]}}}}]}}}}]"),
    ] {
        let errors = lab.rmem(&["aggregate", "robmem.a", &pipeline]).stderr;
        assert!(
            errors.contains("a pipeline stage specification object must contain exactly one field"),
            "{pipeline}: {errors}"
        );
    }
    lab.write("two.j2", "<<#ONE||[{$match: {}, $limit: 1}]>><<_id>><</ONE>>");
    let errors = lab.rmem(&["gen-problem", "--template", "two.j2"]).stderr;
    assert!(errors.contains("exactly one field"), "{errors}");
    // Empty filters in front of what has to be first are still nothing.
    let found = lab.rmem(&["aggregate", "robmem.a", "[{$match: {}}, {$match: {}}, {$limit: 1}]"]).success();
    assert_eq!(found, "{\"_id\":1}\n");
}

#[test]
fn metadata_of_joined_documents_is_hidden() {
    let lab = Lab::new();
    lab.rmem(&["insert", "-q", "robmem.rooms", "{_id: 'kitchen'}"]).success();
    lab.rmem(&["insert", "-q", "robmem.cups", "{_id: 1, room: 'kitchen'}"]).success();
    let pipeline =
        "[{$lookup: {from: 'rooms', localField: 'room', foreignField: '_id', as: 'room'}}, {$project: {room: 1}}]";
    let plain = lab.rmem(&["aggregate", "robmem.cups", pipeline]).success();
    assert_eq!(plain, "{\"_id\":1,\"room\":[{\"_id\":\"kitchen\"}]}\n");
    // Unless it is asked for by its name.
    let named =
        lab.rmem(&["aggregate", "robmem.cups", "[{$project: {_id: 0, known: {$type: '$_robmem_info.inserted'}}}]"]);
    assert_eq!(named.success(), "{\"known\":\"date\"}\n");
}
