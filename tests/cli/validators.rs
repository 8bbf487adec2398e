//! Collections that take certain documents only.

use bson::doc;
use rmem::store::{Embedded, Namespace, Store as _, Validation, ValidationAction, ValidationLevel};

use crate::lab::{Lab, assert_run};

const NS: &str = "robmem.boxes";

fn lab() -> Lab {
    Lab::empty().env("RMEM_MEMORY", "file:robot.rmem")
}

/// Sets which documents the collection takes, as a client of `rmem serve` does.
fn validate(lab: &Lab, validation: &Validation) {
    let store = Embedded::open(lab.path().join("robot.rmem")).unwrap();
    store.set_validation(&Namespace::parse(NS).unwrap(), validation).unwrap();
}

fn weighed() -> Validation {
    let schema = doc! {
        "required": ["weight"], "additionalProperties": false,
        "properties": { "_id": {}, "name": {}, "weight": { "bsonType": "number", "minimum": 0 } },
    };
    Validation { validator: Some(doc! { "$jsonSchema": schema }), ..Validation::default() }
}

/// A box that passes the validator of its collection, and one that is older than that and does not.
fn boxes(validation: &Validation) -> Lab {
    let lab = lab();
    lab.rmem(&["insert", NS, "{_id: 1, weight: 2}", "{_id: 2, weight: 'light'}"]).success();
    validate(&lab, validation);
    lab
}

fn all(lab: &Lab) -> String {
    lab.rmem(&["query", NS, "--sort", "{_id: 1}"]).success()
}

#[test]
fn a_write_that_is_refused_says_which_document_and_which_rule() {
    let lab = boxes(&weighed());
    let before = all(&lab);
    assert_run!(lab.rmem(&["insert", NS, "{_id: 3, name: 'A', height: 3}"]), @r#"
    ------- stderr -------
    error: robmem.boxes: the document with _id 3 does not pass the validator of its collection: {"additionalProperties":false} (not allowed: ["height"]); {"required":["weight"]} (missing: ["weight"])
    [exit code: 5]
    "#);
    lab.write("more.jsonl", "{\"_id\": 4, \"weight\": 4}\n{\"_id\": 5, \"weight\": -1}\n");
    assert_run!(lab.rmem(&["insert", NS, "--file", "more.jsonl"]), @r#"
    4
    ------- stderr -------
    error: more.jsonl:2:1: the document cannot be stored: robmem.boxes: the document with _id 5 does not pass the validator of its collection: weight: {"minimum":0} (comparison failed: -1)
      |
    2 | {"_id": 5, "weight": -1}
      | ^
      1 document was stored before it
    [exit code: 5]
    "#);
    lab.rmem(&["delete", NS, "{_id: 4}"]).success();
    assert_run!(lab.rmem(&["update", NS, "{_id: 1}", "{$set: {weight: -1}}"]), @r#"
    ------- stderr -------
    error: robmem.boxes: the document with _id 1 does not pass the validator of its collection: weight: {"minimum":0} (comparison failed: -1)
    [exit code: 5]
    "#);
    for refused in [
        &["update", NS, "{_id: 1}", "{name: 'B'}", "--replace"][..],
        &["update", NS, "{_id: 1}", "[{$unset: 'weight'}]"],
        &["update", NS, "{_id: 9}", "{$set: {name: 'B'}}", "--upsert"],
        &["update", NS, "{_id: 2}", "{$set: {name: 'B'}}"],
        &["find-and-modify", NS, "{_id: 1}", "{$inc: {weight: -9}}"],
        &["aggregate", NS, "[{$match: {_id: 1}}, {$set: {weight: -1}}, {$merge: 'boxes'}]"],
        &["aggregate", NS, "[{$match: {_id: 2}}, {$out: 'boxes'}]"],
    ] {
        let run = lab.rmem(refused);
        assert_eq!(run.code, 5, "{run}");
        assert!(run.stderr.contains("does not pass the validator of its collection"), "{run}");
    }
    assert_eq!(all(&lab), before);
    lab.rmem(&["update", NS, "{_id: 1}", "{$set: {weight: 2.5}}"]).success();
    let options = lab.rmem(&["collections", "--options"]).success();
    assert!(options.starts_with("robmem.boxes {\"validator\":{\"$jsonSchema\""), "{options}");
}

#[test]
fn a_moderate_validator_lets_older_documents_be_changed_and_one_that_warns_is_heard() {
    let lab = boxes(&Validation { level: Some(ValidationLevel::Moderate), ..weighed() });
    lab.rmem(&["update", NS, "{_id: 2}", "{$set: {name: 'B'}}"]).success();
    assert_eq!(lab.rmem(&["update", NS, "{_id: 1}", "{$set: {weight: 'x'}}"]).code, 5);
    validate(&lab, &Validation { action: Some(ValidationAction::Warn), ..weighed() });
    assert_run!(lab.rmem(&["--log", "log.jsonl", "insert", NS, "{_id: 3}"]), @r#"
    3
    ------- stderr -------
    1 stored in robmem.boxes
    warning: robmem.boxes: the document with _id 3 does not pass the validator of its collection: {"required":["weight"]} (missing: ["weight"]); it is stored
    [exit code: 0]
    "#);
    let log = lab.read("log.jsonl");
    assert!(log.contains("{\"warning\":\"robmem.boxes: the document with _id 3"), "{log}");
}

#[test]
fn a_dump_carries_the_validator_and_is_restored_as_it_was() {
    let moderate = Validation { level: Some(ValidationLevel::Moderate), ..weighed() };
    let lab = boxes(&moderate);
    let (before, options) = (all(&lab), lab.rmem(&["collections", "--options"]).success());
    for way in [&["dump", NS, "-o", "dump"][..], &["dump", NS, "-o", "dump.archive", "--archive"]] {
        lab.rmem(way).success();
        for restore in [&["restore", way[3]][..], &["restore", way[3], "--drop"]] {
            let other = self::lab();
            let path = lab.path().join(restore[1]);
            other.rmem(&[&["restore", path.to_str().unwrap()], &restore[2..]].concat()).success();
            assert_eq!(
                (all(&other), other.rmem(&["collections", "--options"]).success()),
                (before.clone(), options.clone())
            );
            assert_eq!(other.rmem(&["insert", NS, "{_id: 3}"]).code, 5);
        }
    }
    let world = lab.rmem(&["dump", NS, "-o", "boxes.json"]);
    assert!(world.stderr.contains("left out: the validator of robmem.boxes; -o FOLDER keeps them"), "{world}");
    // A collection that is there keeps its own, also where the dump says nothing of it.
    validate(&lab, &weighed());
    lab.write("world.json", r#"{"robmem.boxes": [{"_id": 3}]}"#);
    for restore in [&["restore", "world.json"][..], &["restore", "world.json", "--drop"]] {
        for dry in [&[][..], &["--dry-run"]] {
            let run = lab.rmem(&[restore, dry].concat());
            assert!(run.code == 5 && run.stderr.contains("_id 3 does not pass"), "{run}");
        }
    }
    assert_eq!(all(&lab), before);
    validate(&lab, &Validation { validator: Some(doc! { "_id": { "$gt": 0 } }), ..Validation::default() });
    let run = lab.rmem(&["restore", "dump"]);
    assert!(run.code == 0 && run.stderr.contains("the validator of the collection is not restored"), "{run}");
}

#[test]
fn what_is_undone_has_to_pass_too() {
    let lab = lab();
    lab.write("rmem.toml", "keep_history = '1h'\n");
    lab.rmem(&["insert", NS, "{_id: 1, weight: 'light'}"]).success();
    lab.rmem(&["update", NS, "{_id: 1}", "{$set: {weight: 1}}"]).success();
    validate(&lab, &weighed());
    let run = lab.rmem(&["undo", NS]);
    assert!(run.code == 5 && run.stderr.contains("type did not match: \"light\""), "{run}");
    validate(&lab, &Validation::default());
    lab.rmem(&["undo", NS]).success();
}

#[test]
fn repair_and_backup_keep_the_validator() {
    let lab = boxes(&weighed());
    let options = lab.rmem(&["collections", "--options"]).success();
    lab.rmem(&["repair"]).success();
    lab.rmem(&["repair", "-o", "repaired.rmem"]).success();
    lab.rmem(&["backup", "copy.rmem"]).success();
    for memory in ["file:robot.rmem", "file:repaired.rmem", "file:copy.rmem"] {
        assert_eq!(lab.rmem(&["--memory", memory, "collections", "--options"]).success(), options, "{memory}");
        assert_eq!(lab.rmem(&["--memory", memory, "insert", NS, "{_id: 3}"]).code, 5, "{memory}");
        assert_eq!(lab.rmem(&["--memory", memory, "count", NS]).success().trim(), "2", "{memory}");
    }
    lab.rmem(&["doctor", "--deep"]).success();
}

#[test]
fn a_collection_is_made_with_a_validator_that_is_changed_and_removed() {
    let lab = lab();
    let create = ["create", NS, "--validator", "{weight: {$gt: 0}}", "--validation-action", "error"];
    lab.rmem(&create).success();
    assert_run!(lab.rmem(&create), @r"
    ------- stderr -------
    robmem.boxes exists already
    [exit code: 0]
    ");
    assert_run!(lab.rmem(&["create", NS, "--validator", "{weight: {$gt: 1}}"]), @r"
    ------- stderr -------
    warning: robmem.boxes exists and takes other documents; `rmem coll-mod robmem.boxes` changes that
    [exit code: 1]
    ");
    lab.rmem(&["insert", NS, "{_id: 1, weight: 0}"]).exits(5);
    assert_run!(lab.rmem(&["coll-mod", NS, "--validation-action", "warn"]), @r"
    ------- stderr -------
    [exit code: 0]
    ");
    assert_run!(lab.rmem(&["insert", NS, "{_id: 1, weight: 0}"]), @r#"
    1
    ------- stderr -------
    1 stored in robmem.boxes
    warning: robmem.boxes: the document with _id 1 does not pass the validator of its collection: {"weight":{"$gt":0}} (comparison failed: 0); it is stored
    [exit code: 0]
    "#);
    lab.rmem(&["coll-mod", NS, "--validation-level", "moderate", "--validation-action", "error"]).success();
    lab.rmem(&["update", NS, "{_id: 1}", "{$set: {name: 'A'}}"]).success();
    lab.rmem(&["insert", NS, "{_id: 2, weight: 0}"]).exits(5);
    lab.rmem(&["coll-mod", NS, "--validator", "{weight: {$type: 'string'}}"]).success();
    lab.rmem(&["insert", NS, "{_id: 2, weight: 'light'}"]).success();
    assert_run!(lab.rmem(&["collections", "--options"]), @r#"
    robmem.boxes {"validator":{"weight":{"$type":"string"}},"validationLevel":"moderate","validationAction":"error"}
    ------- stderr -------
    [exit code: 0]
    "#);
    lab.rmem(&["coll-mod", NS, "--validator", "{}"]).success();
    lab.rmem(&["insert", NS, "{_id: 3, weight: 0}"]).success();
    assert_run!(lab.rmem(&["collections", "--options", "--format", "json"]), @r#"
    [
      {
        "ns": "robmem.boxes",
        "options": {
          "validationLevel": "moderate",
          "validationAction": "error"
        }
      }
    ]
    ------- stderr -------
    [exit code: 0]
    "#);
}

#[test]
fn a_change_of_a_collection_that_cannot_be_done_says_why() {
    let lab = boxes(&weighed());
    let options = || lab.rmem(&["collections", "--options"]).success();
    let before = options();
    assert_run!(lab.rmem(&["coll-mod", NS]), @r"
    ------- stderr -------
    error: expected what to change: --validator QUERY, --validation-level LEVEL or --validation-action ACTION
    [exit code: 2]
    ");
    assert_run!(lab.rmem(&["coll-mod", "robmem.boxes1", "--validator", "{}"]), @r"
    ------- stderr -------
    error: no collection robmem.boxes1; did you mean robmem.boxes?
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["coll-mod", NS, "--validator", "{weight: {$greater: 0}}"]), @r"
    ------- stderr -------
    error: <validator>:1:11: unknown operator: $greater
      |
    1 | {weight: {$greater: 0}}
      |           ^^^^^^^^
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["coll-mod", NS, "--validator", "{$jsonSchema: {required: 'weight'}}"]), @r"
    ------- stderr -------
    error: <validator>:1:2: $jsonSchema keyword 'required' must be an array
      |
    1 | {$jsonSchema: {required: 'weight'}}
      |  ^^^^^^^^^^^
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["create", "robmem.others", "--validator", "{weight: {$near: [0, 0]}}"]), @r"
    ------- stderr -------
    error: <validator>:1:11: $geoNear, $near, and $nearSphere are not allowed in this context
      |
    1 | {weight: {$near: [0, 0]}}
      |           ^^^^^
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["create", "robmem.others", "--validator", "weight > 0"]), @r"
    ------- stderr -------
    error: <validator>:1:1: expected a value, found `weight`
      |
    1 | weight > 0
      | ^^^^^^
      = hint: strings are written in quotes
    [exit code: 3]
    ");
    assert_run!(lab.rmem(&["coll-mod", NS, "--validation-level", "loose"]), @r"
    ------- stderr -------
    error: invalid value 'loose' for '--validation-level <LEVEL>'
      [possible values: strict, moderate, off]

    For more information, try '--help'.
    [exit code: 2]
    ");
    assert_eq!(options(), before);
}
