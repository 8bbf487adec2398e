//! Names that differ only in hyphens and underscores: slots of CLIPS, keys of documents, markers of templates.

use super::lab;
use crate::lab::assert_run;

/// A fact base of an executive, as CLIPS has it.
const FACTS: &str = "(domain-object (name r1) (type robot))
(domain-object (name c1) (type station))
(domain-fact (name at) (param-values r1 c1))\n";

#[test]
fn a_template_with_underscores_finds_slots_with_hyphens() {
    let lab = lab();
    lab.rmem_with(&["clips", "import"], FACTS).success();
    lab.write(
        "marker.pddl",
        "(define (problem p) (:domain d)
 (:objects <<#O|{relation: 'domain-object'}>><<name>> - <<type>> <</O>>)
 (:init <<#F|{relation: 'domain-fact'}>>(<<name>><<param_values>>)(first <<param_values_0>>)<</F>>) (:goal (and)))\n",
    );
    assert_run!(lab.rmem(&["gen-problem", "--template", "marker.pddl"]), @r"
    (define (problem p) (:domain d)
     (:objects r1 - robot c1 - station )
     (:init (at r1 c1)(first r1)) (:goal (and)))
    ------- stderr -------
    `param_values` was found as `param-values`
    `param_values_0` was found as `param-values_0`
    [exit code: 0]
    ");
    lab.write(
        "jinja.pddl",
        "(define (problem p) (:domain d) (:init
{%- for f in query('robmem.worldmodel', {'relation': 'domain-fact'}) %} ({{ f.name }} {{ f.param_values[0] }} {{ f['param-values'][1] }}){% endfor %}) (:goal (and)))\n",
    );
    assert_run!(lab.rmem(&["gen-problem", "--template", "jinja.pddl"]), @r"
    (define (problem p) (:domain d) (:init (at r1 c1)) (:goal (and)))
    ------- stderr -------
    `param_values` was found as `param-values`
    [exit code: 0]
    ");
    // The exact spelling goes first, and says nothing.
    lab.rmem(&["update", "robmem.worldmodel", "{relation: 'domain-fact'}", "{$set: {param_values: ['c1', 'r1']}}"])
        .success();
    assert_run!(lab.rmem(&["gen-problem", "--template", "jinja.pddl"]), @"
    (define (problem p) (:domain d) (:init (at c1 c1)) (:goal (and)))
    ------- stderr -------
    [exit code: 0]
    ");
}

#[test]
fn a_slot_is_found_by_a_key_with_underscores() {
    let lab = lab();
    lab.write("t.clp", "(deftemplate domain-fact (slot name) (multislot param-values) (slot sync-id (default 0)))");
    let export = ["clips", "export", "--from", "-", "--deftemplates", "t.clp"];
    let document = "{relation: 'domain-fact', name: 'at', param_values: ['r1'], sync_id: 3}";
    assert_run!(lab.rmem_with(&export, document), @r"
    (domain-fact (name at) (param-values r1) (sync-id 3))
    ------- stderr -------
    `param_values` was found as `param-values`
    `sync_id` was found as `sync-id`
    1 fact
    [exit code: 0]
    ");
    assert_run!(lab.rmem_with(&export, "{relation: 'domain-fact', 'param-values': ['r1'], param_values: ['r2']}"), @r"
    ------- stderr -------
    error: <stdin>:1:1: the key `param_values` is not a slot of `domain-fact`; expected name, param-values, sync-id
      |
    1 | {relation: 'domain-fact', 'param-values': ['r1'], param_values: ['r2']}
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    ");
    let import = ["clips", "import", "--deftemplates", "t.clp", "--key", "sync_id"];
    assert_run!(lab.rmem_with(&import, "(domain-fact (name at) (param_values r1 c1) (sync-id 3))"), @r#"
    {"inserted":1,"replaced":0,"unchanged":0}
    ------- stderr -------
    `param_values` was found as `param-values`
    `sync_id` was found as `sync-id`
    [exit code: 0]
    "#);
    let stored = "{\"relation\":\"domain-fact\",\"name\":\"at\",\"param-values\":[\"r1\",\"c1\"],\"sync-id\":3}\n";
    assert_eq!(lab.rmem(&["query", "robmem.worldmodel", "--fields", "{_id: 0}"]).success(), stored);
}

#[test]
fn a_stored_key_is_found_by_the_other_spelling() {
    let lab = lab();
    let import = ["clips", "import", "--into", "a.b", "--key", "name,sync-id", "-"];
    lab.rmem(&[
        "insert",
        "a.b",
        "{_id: 1, relation: 'at', name: 'r1', sync_id: 3, x: 1}",
        "{_id: 2, name: 'r1', sync_id: 4}",
    ])
    .success();
    assert_run!(lab.rmem_with(&import, "(at (name r1) (sync-id 3) (x 2)) (at (name r2) (sync-id 3) (x 2))"), @r#"
    {"inserted":1,"replaced":1,"unchanged":0}
    ------- stderr -------
    `sync-id` was found as `sync_id`
    [exit code: 0]
    "#);
    // The exact spelling goes first; two that are alike are one too many.
    lab.rmem(&["insert", "a.b", "{_id: 3, relation: 'at', name: 'r1', sync_id: 3, x: 1}"]).success();
    assert_run!(lab.rmem_with(&import, "(at (name r1) (sync-id 3) (x 4))"), @r#"
    {"inserted":0,"replaced":1,"unchanged":0}
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(lab.rmem(&["query", "a.b", "{}", "--sort", "{_id: 1}"]), @r#"
    {"_id":1,"relation":"at","name":"r1","sync-id":3,"x":4}
    {"_id":2,"name":"r1","sync_id":4}
    {"_id":3,"relation":"at","name":"r1","sync_id":3,"x":1}
    {"_id":{"$oid":"[ID]"},"relation":"at","name":"r2","sync-id":3,"x":2}
    ------- stderr -------
    [exit code: 0]
    "#);
    lab.rmem(&["delete", "a.b", "{_id: 1}"]).success();
    lab.rmem(&["insert", "a.b", "{_id: 4, relation: 'at', name: 'r1', sync_id: 3, x: 1}"]).success();
    assert_run!(lab.rmem_with(&import, "(at (name r1) (sync-id 3) (x 5))"), @r#"
    ------- stderr -------
    error: <stdin>:1:1: a.b has two documents with the `name` "r1", `sync_id` 3; nothing was imported
      |
    1 | (at (name r1) (sync-id 3) (x 5))
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
      = hint: name one more slot that tells them apart, like --key SLOT,SLOT, or delete one of them
    [exit code: 3]
    "#);
}
