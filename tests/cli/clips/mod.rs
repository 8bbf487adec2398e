//! clips import, export: documents as facts and back.

#[cfg(feature = "clips-engine")]
mod fawkes;
mod import;
#[cfg(feature = "clips-engine")]
mod plan;
#[cfg(feature = "clips-engine")]
mod run;
mod scenario;
mod spelling;

use crate::lab::{Lab, assert_run};

fn lab() -> Lab {
    Lab::new().env("RMEM_MEMORY", "file:m.rmem")
}

#[test]
fn documents_come_back_from_facts_as_they_were() {
    let lab = lab();
    let documents =
        "{relation: 'pose', name: 'r 1', xy: [1.0, 2.5], n: 3, ok: true}\n{relation: 'on', values: ['a', 'TRUE']}";
    lab.rmem_with(&["insert", "robmem.worldmodel", "-"], documents).success();
    let facts = lab.rmem(&["clips", "export"]).success();
    assert_eq!(facts, "(pose (name \"r 1\") (xy 1.0 2.5) (n 3) (ok TRUE))\n(on a \"TRUE\")\n");
    let report = lab.rmem_with(&["clips", "import", "--into", "robmem.copy"], &facts).success();
    assert_eq!(report, "{\"inserted\":2,\"replaced\":0,\"unchanged\":0}\n");
    let query = |ns| lab.rmem(&["query", ns, "--fields", "{_id: 0}"]).success();
    assert_eq!(query("robmem.copy"), query("robmem.worldmodel"));
}

#[test]
fn metadata_is_hidden_and_keeps_strings_strings() {
    let lab = lab();
    let facts = "(t (a \"x\") (b x) (c [i]))\n";
    lab.rmem_with(&["clips", "import"], facts).success();
    let plain = lab.rmem(&["query", "robmem.worldmodel", "--fields", "{_id: 0}"]).success();
    assert_eq!(plain, "{\"relation\":\"t\",\"a\":\"x\",\"b\":\"x\",\"c\":\"[i]\"}\n");
    lab.rmem(&["update", "robmem.worldmodel", "{}", "{$set: {d: 1}}"]).success();
    assert_eq!(lab.rmem(&["clips", "export"]).success(), "(t (a \"x\") (b x) (c [i]) (d 1))\n");
}

#[test]
fn facts_are_written_as_deffacts_and_assertions() {
    let lab = lab();
    lab.rmem(&["insert", "a.b", "{relation: 'on', values: ['=', 'b']}", "{relation: 't', x: 1}"]).success();
    let deffacts = "(deffacts world\n   (on (sym-cat \"=\") b)\n   (t (x 1))\n)\n";
    assert_eq!(lab.rmem(&["clips", "export", "a.b", "{}", "--as", "deffacts", "world"]).success(), deffacts);
    assert_eq!(lab.rmem(&["clips", "export", "--as", "assert", "a.b", "{x: 1}"]).success(), "(assert (t (x 1)))\n");
    lab.rmem_with(&["clips", "import", "-", "--into", "a.c"], deffacts).success();
    assert_eq!(lab.rmem(&["clips", "export", "a.c", "--as", "deffacts", "world"]).success(), deffacts);
    assert_run!(lab.rmem(&["clips", "export", "a.b", "--as", "deffacts"]), @r"
    ------- stderr -------
    error: expected --as deffacts NAME, the name a symbol
    [exit code: 2]
    ");
    assert_run!(lab.rmem(&["clips", "export", "a.b", "--as", "rules"]), @r"
    ------- stderr -------
    error: expected --as facts, --as deffacts NAME, or --as assert
    [exit code: 2]
    ");
}

#[test]
fn a_symbol_that_load_facts_cannot_read_is_refused_by_name() {
    let lab = lab();
    lab.write("t.clp", "(deftemplate t (slot op (type STRING)))");
    let documents = "{_id: 1, relation: 't', op: '='}\n{_id: 2, relation: 'on', values: ['a', '=']}\n{_id: 3, relation: 't', op: '=='}";
    lab.rmem_with(&["insert", "a.b", "-"], documents).success();
    assert_run!(lab.rmem(&["clips", "export", "a.b"]), @r#"
    ------- stderr -------
    error: a.b, document 1: the key `op` has the symbol `=`, which (load-facts) cannot read
      = hint: --as assert or --as deffacts NAME writes it as (sym-cat "="); in a slot of type STRING it is a string
    [exit code: 3]
    "#);
    let left = lab.rmem(&["clips", "export", "a.b", "--skip-invalid"]);
    assert!(
        left.to_string().starts_with("(t (op ==))\n") && left.to_string().contains("the key `values` has"),
        "{left}"
    );
    let with = ["clips", "export", "a.b", "{relation: 't'}", "--deftemplates", "t.clp"];
    assert_eq!(lab.rmem(&with).success(), "(t (op \"=\"))\n(t (op \"==\"))\n");
}

#[test]
fn the_facts_of_a_program_are_imported_and_its_rules_are_skipped_with_a_message() {
    assert_run!(lab().rmem(&["clips", "import", "fixtures/clips/program.clp"]), @r#"
    {"inserted":6,"replaced":0,"unchanged":0}
    ------- stderr -------
    passed over 1 deffunction: f
    passed over 1 defglobal: ?*X*
    passed over 1 defrule: r1
    passed over 1 reset
    passed over 1 run
    [exit code: 0]
    "#);
}

#[test]
fn templates_of_another_file_are_kept_to() {
    let lab = lab();
    lab.write("t.clp", "(deftemplate pose (slot c (type FLOAT)) (slot s (type STRING)))");
    let with = ["clips", "export", "--from", "-", "--deftemplates", "t.clp"];
    assert_eq!(lab.rmem_with(&with, "{relation: 'pose', c: 3, s: 'x'}").success(), "(pose (c 3.0) (s \"x\"))\n");
    assert_run!(lab.rmem_with(&with, "{relation: 'pose', c: 1.5}\n{relation: 'pose', c: 'x'}"), @r#"
    ------- stderr -------
    error: <stdin>:2:1: the key `c` does not fit: the slot `c` expected FLOAT, found STRING `"x"`
      |
    2 | {relation: 'pose', c: 'x'}
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    "#);
    let import = ["clips", "import", "-", "--deftemplates", "t.clp", "--strict"];
    assert_run!(lab.rmem_with(&import, "(pose (c 1.0))\n(pos (c 1.0))"), @r"
    ------- stderr -------
    error: <stdin>:2:1: the template `pos` is not known
      |
    2 | (pos (c 1.0))
      | ^^^^^^^^^^^^^
    [exit code: 3]
    ");
    assert!(!lab.path().join("m.rmem").exists());
}

#[test]
fn a_fact_replaces_the_document_with_the_same_key() {
    let lab = lab();
    let import = ["clips", "import", "--key", "sync-id"];
    lab.rmem_with(&import, "(initial-fact)\n(t (sync-id 1) (v a))\n(t (sync-id 2) (v a))").success();
    let report =
        lab.rmem_with(&import, "(t (sync-id 1) (v a))\n(t (sync-id 2) (v b))\n(t (sync-id 3) (v c))").success();
    assert_eq!(report, "{\"inserted\":1,\"replaced\":1,\"unchanged\":1}\n");
    let facts = "(t (sync-id 1) (v a))\n(t (sync-id 2) (v b))\n(t (sync-id 3) (v c))\n";
    assert_eq!(lab.rmem(&["clips", "export"]).success(), facts);
    assert_run!(lab.rmem_with(&import, "(t (sync-id 4))\n(t (sync-id 5))\n(u (sync-id 4))"), @r"
    ------- stderr -------
    error: <stdin>:3:1: another fact has the key `sync-id` 4
      |
    3 | (u (sync-id 4))
      | ^^^^^^^^^^^^^^^
      = hint: the other fact is at 1:1
    [exit code: 3]
    ");
    assert_run!(lab.rmem_with(&import, "(t (sync-id 4))\n(t (v 5))"), @r"
    ------- stderr -------
    error: <stdin>:2:1: expected the slot `sync-id`, the key
      |
    2 | (t (v 5))
      | ^^^^^^^^^
      = hint: import facts that have no such slot from a file of their own, without --key
    [exit code: 3]
    ");
    assert_eq!(lab.rmem(&["clips", "export"]).success(), facts);
    lab.rmem(&["insert", "robmem.worldmodel", "{relation: 't', 'sync-id': 1}"]).success();
    assert_run!(lab.rmem_with(&import, "(t (sync-id 9))\n(t (sync-id 1) (v z))"), @r"
    ------- stderr -------
    error: <stdin>:2:1: robmem.worldmodel has two documents with the `sync-id` 1; nothing was imported
      |
    2 | (t (sync-id 1) (v z))
      | ^^^^^^^^^^^^^^^^^^^^^
      = hint: name one more slot that tells them apart, like --key SLOT,SLOT, or delete one of them
    [exit code: 3]
    ");
    assert_eq!(lab.rmem(&["count", "robmem.worldmodel"]).success(), "4\n");
}

#[test]
fn nothing_of_a_bad_text_is_imported() {
    let lab = lab();
    assert_run!(lab.rmem_with(&["clips", "import"], "(a 1)\n(b (c 2)\n"), @r"
    ------- stderr -------
    error: <stdin>:3:1: expected a slot `(name value)` or `)`, found the end of the text
      |
    3 | 
      | ^
      = hint: the list opened at 2:1 is not closed
    [exit code: 3]
    ");
    assert!(!lab.path().join("m.rmem").exists());
}

#[test]
fn what_has_no_place_in_a_fact_is_refused_or_nested() {
    let lab = lab();
    lab.rmem(&["insert", "robmem.worldmodel", "{_id: 7, relation: 't', pose: {x: 1, y: 2}}"]).success();
    assert_run!(lab.rmem(&["clips", "export"]), @r"
    ------- stderr -------
    error: robmem.worldmodel, document 7: the key `pose` is a nested document, which no slot can hold
      = hint: --nested flatten makes slots of nested keys, --nested json writes a string
    [exit code: 3]
    ");
    assert_eq!(lab.rmem(&["clips", "export", "--nested", "flatten"]).success(), "(t (pose_x 1) (pose_y 2))\n");
    let from = ["clips", "export", "--from", "-"];
    assert_run!(lab.rmem_with(&from, "{relation: 't', a: null}"), @r"
    ------- stderr -------
    error: <stdin>:1:1: the key `a` is null, which no slot can hold
      |
    1 | {relation: 't', a: null}
      | ^^^^^^^^^^^^^^^^^^^^^^^^
      = hint: --nested json writes a string
    [exit code: 3]
    ");
    assert_run!(lab.rmem_with(&from, "{a: 1}"), @r"
    ------- stderr -------
    error: <stdin>:1:1: the key `relation` is missing; expected the name of a template
      |
    1 | {a: 1}
      | ^^^^^^
      = hint: the query {relation: {$type: 'string'}} leaves out documents without a template
    [exit code: 3]
    ");
}

#[test]
fn documents_that_no_fact_can_hold_are_left_out_where_that_is_asked_for() {
    let lab = lab();
    let documents =
        "{_id: 1, relation: 't', x: {y: 1}}\n{_id: 2, relation: 't', x: 2}\n{_id: 3, relation: 't', x: NaN}";
    lab.rmem_with(&["insert", "a.b", "-"], documents).success();
    lab.write("d.jsonl", documents);
    let export = |more: &'static [&'static str]| [&["clips", "export"], more].concat();
    let commands =
        [export(&["a.b"]), export(&["a.b", "--skip-invalid"]), export(&["--from", "d.jsonl", "--skip-invalid"])];
    assert_run!(lab.transcript(&commands.each_ref().map(|args| &args[..])), @r"
    $ rmem clips export a.b
    ------- stderr -------
    error: a.b, document 1: the key `x` is a nested document, which no slot can hold
      = hint: --nested flatten makes slots of nested keys, --nested json writes a string
    [exit code: 3]
    $ rmem clips export a.b --skip-invalid
    (t (x 2))
    ------- stderr -------
    warning: a.b, document 1: the key `x` is a nested document, which no slot can hold
      = hint: --nested flatten makes slots of nested keys, --nested json writes a string
    warning: a.b, document 3: the key `x` is NaN, which no slot can hold
      = hint: --nested json writes a string
    1 fact; 2 documents were left out
    [exit code: 0]
    $ rmem clips export --from d.jsonl --skip-invalid
    (t (x 2))
    ------- stderr -------
    warning: d.jsonl:1:1: the key `x` is a nested document, which no slot can hold
      |
    1 | {_id: 1, relation: 't', x: {y: 1}}
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
      = hint: --nested flatten makes slots of nested keys, --nested json writes a string
    warning: d.jsonl:3:1: the key `x` is NaN, which no slot can hold
      |
    3 | {_id: 3, relation: 't', x: NaN}
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
      = hint: --nested json writes a string
    1 fact; 2 documents were left out
    [exit code: 0]
    ");
}

#[test]
fn several_files_of_facts_are_imported_together() {
    let lab = lab();
    lab.write("types.clp", "(deftemplate machine (slot name) (slot n (type INTEGER)))\n(defglobal ?*N* = 7)\n");
    lab.write("one.clp", "(deffacts one (machine (name A) (n ?*N*)) (at A 1))\n");
    lab.write("two.clp", "\n(machine (name B) (n 2))\n(at A 1)\n");
    lab.write("wrong.clp", "(machine (name C) (n x))\n");
    lab.write("again.clp", "\n  (machine (name A) (n 3))\n");
    let import = |more: &'static [&'static str]| [&["clips", "import", "--into", "a.b"], more].concat();
    let commands = [
        import(&["types.clp", "one.clp", "wrong.clp"]),
        import(&["types.clp", "one.clp", "two.clp"]),
        import(&["types.clp", "two.clp", "again.clp", "--key", "name"]),
    ];
    assert_run!(lab.transcript(&commands.each_ref().map(|args| &args[..])), @r#"
    $ rmem clips import --into a.b types.clp one.clp wrong.clp
    ------- stderr -------
    error: wrong.clp:1:19: the slot `n` expected INTEGER, found SYMBOL `x`
      |
    1 | (machine (name C) (n x))
      |                   ^^^^^
    [exit code: 3]
    $ rmem clips import --into a.b types.clp one.clp two.clp
    {"inserted":3,"replaced":0,"unchanged":0}
    ------- stderr -------
    1 fact was in the text more than once; each was imported once
    used the values of 1 defglobal: ?*N*
    [exit code: 0]
    $ rmem clips import --into a.b types.clp two.clp again.clp --key name
    ------- stderr -------
    error: two.clp:3:1: expected the slot `name`, the key
      |
    3 | (at A 1)
      | ^^^^^^^^
      = hint: import facts that have no such slot from a file of their own, without --key
    [exit code: 3]
    "#);
    assert_eq!(lab.rmem(&["count", "a.b"]).success(), "3\n");
    lab.write("other.clp", "\n  (machine (name A) (n 9))\n");
    assert_run!(lab.rmem(&import(&["types.clp", "again.clp", "other.clp", "--key", "name"])), @r#"
    ------- stderr -------
    error: other.clp:2:3: another fact has the key `name` "A"
      |
    2 |   (machine (name A) (n 9))
      |   ^^^^^^^^^^^^^^^^^^^^^^^^
      = hint: the other fact is at again.clp:2:3
    [exit code: 3]
    "#);
}

#[test]
fn an_operator_that_there_is_not_is_shown_in_the_query_of_an_export() {
    let lab = lab();
    lab.rmem(&["insert", "a.b", "{n: 1}"]).success();
    let export = lab.rmem(&["clips", "export", "a.b", "{n: {$no: 1}}"]).exits(3);
    assert!(export.stderr.contains("<query>:1:"), "{export}");
    assert_eq!(export.stderr, lab.rmem(&["query", "a.b", "{n: {$no: 1}}"]).stderr);
}
