//! CLIPS text: what is read, what is written, what is refused.

use rmem::formats::Source;
use rmem::formats::clips::{Body, Fact, Item, Reader, Value, write_fact, write_value};

fn read(text: &str) -> Vec<Item> {
    Reader::new(&Source::new("t", text), []).collect::<Result<_, _>>().unwrap_or_else(|error| panic!("{error}"))
}

fn complaint(text: &str) -> String {
    let source = Source::new("t", text);
    Reader::new(&source, []).find_map(Result::err).expect("an error").to_string()
}

fn facts(text: &str) -> Vec<Fact> {
    let fact = |item| match item {
        Item::Fact(fact) => Some(fact),
        _ => None,
    };
    read(text).into_iter().filter_map(fact).collect()
}

/// The facts of a text, written again.
fn written(text: &str) -> String {
    let mut out = String::new();
    for fact in facts(text) {
        write_fact(&fact, write_value, &mut out);
        out.push('\n');
    }
    out
}

#[test]
fn what_clips_saved_is_written_again_as_it_was() {
    let saved = include_str!("../../fixtures/clips/saved.txt");
    assert_eq!(written(saved), saved);
}

#[test]
fn a_listing_of_facts_is_read_as_clips_prints_it() {
    let listing = "CLIPS> (facts)\nf-1     (block (name A) (on \"the table\"))\nf-12    (holding B 1.5)\n\
                   For a total of 2 facts.\nCLIPS> (facts)\nf-13    (empty)\nFor a total of 1 fact.\nCLIPS> ";
    assert_eq!(written(listing), "(block (name A) (on \"the table\"))\n(holding B 1.5)\n(empty)\n");
    for wrong in ["f-x (a)", "f-1 a", "f- (a)", "For a while (a)", "f-1"] {
        assert!(complaint(wrong).contains("expected a fact or a construct"), "{wrong}: {}", complaint(wrong));
    }
}

#[test]
fn deffacts_are_the_facts_that_clips_makes_of_them() {
    let program = include_str!("../../fixtures/clips/saved.clp");
    // Where CLIPS warns of a number that is too large, this is an error: none is in the file.
    let program = program
        .replace("123456789012345678901234567890", "9223372036854775807")
        .replace("9223372036854775808))", "9223372036854775807))")
        .replace("1e400", "inf.0");
    let saved = include_str!("../../fixtures/clips/saved.txt").replace("(initial-fact)\n", "");
    assert_eq!(written(&program), saved);
}

#[test]
fn values_have_the_type_that_clips_gives_them() {
    let facts = facts(r#"(v a "a" 1 1.0 [a] 1e3 +5 - "\"\\" TRUE)"#);
    let text = |text: &str| Value::Text(text.into());
    let symbol = |text: &str| Value::Symbol(text.into());
    let wanted = vec![
        symbol("a"),
        text("a"),
        Value::Integer(1),
        Value::Float(1.0),
        Value::Instance("a".into()),
        Value::Float(1000.0),
        Value::Integer(5),
        symbol("-"),
        text("\"\\"),
        symbol("TRUE"),
    ];
    assert_eq!(facts[0].body, Body::Ordered(wanted));
}

#[test]
fn floats_are_spelled_as_clips_spells_them() {
    let floats = "(f 1.0 -0.0 0.1 0.0001 1e-05 1.5e-07 123456.789 100000000000000.0 1e+15 1e+22 1.25e+300 5e-324)\n";
    assert_eq!(written(floats), floats);
    assert_eq!(written("(f 0.30000000000000004)"), "(f 0.30000000000000004)\n");
}

#[test]
fn a_list_in_deffacts_is_a_slot_or_a_call() {
    let text = "(deffacts d (range (min 1) (max 2)) (n (+ 1 2)) (n 0 (min 1 2)) (+ (a 1)))";
    assert_eq!(written(text), "(range (min 1) (max 2))\n(n 3)\n(n 0 1)\n(+ (a 1))\n");
    assert_eq!(
        written("(deffacts d (n (pi)) (m (x)) (time 1))\n(n (now))"),
        "(n 3.141592653589793)\n(m (x))\n(time 1)\n(n (now))\n"
    );
    assert_eq!(written("(deftemplate n (multislot now)) (deffacts d (n (now)))"), "(n (now))\n");
    assert_eq!(written("(deftemplate n (slot + )) (deffacts d (n (+ 1)))"), "(n (+ 1))\n");
}

#[test]
fn arithmetic_is_that_of_clips() {
    for (call, value) in [
        ("(+ 1 2 3)", "6"),
        ("(+ 1 2.0)", "3.0"),
        ("(/ 1 2)", "0.5"),
        ("(div 7 2)", "3"),
        ("(mod -7 2)", "-1"),
        ("(- 5 7 2)", "-4"),
        ("(* 2 (+ 1 (abs -2)))", "6"),
        ("(** 2 3)", "8.0"),
        ("(create$)", ""),
        ("(create$ a (create$ b c))", "a b c"),
        ("(str-cat a 1 \"b\")", "\"a1b\""),
        ("(max 1 2.5 2)", "2.5"),
        ("(round 2.5)", "2"),
        ("(integer -2.5)", "-2"),
    ] {
        let wanted = format!("(f x {value}").trim_end().to_owned() + ")\n";
        assert_eq!(written(&format!("(deffacts d (f x {call}))")), wanted, "{call}");
    }
}

#[test]
fn programs_are_passed_over_and_named() {
    let items = read(include_str!("../../fixtures/clips/program.clp"));
    let skipped: Vec<String> = items
        .iter()
        .filter_map(|item| match item {
            Item::Skipped { kind, name } => Some(format!("{kind} {name}")),
            _ => None,
        })
        .collect();
    assert_eq!(skipped, ["defglobal ?*X*", "defrule r1", "deffunction f", "reset ", "run "]);
    assert_eq!(items.iter().filter(|item| matches!(item, Item::Fact(_))).count(), 6);
}

#[test]
fn templates_are_read_alone_from_whatever_a_program_holds() {
    let text = "() (a ?x) (deffacts d (a (b (now))) (c ?*x*)) (deftemplate t (slot a)) ((b))";
    let source = Source::new("t", text);
    let items = Reader::of_templates(&source).collect::<Result<Vec<_>, _>>().unwrap_or_else(|error| panic!("{error}"));
    let templates = items.iter().filter(|item| matches!(item, Item::Template(_))).count();
    assert_eq!((items.len(), templates), (5, 1));
}

#[test]
fn a_template_says_what_its_slots_take() {
    let items = read(
        "(deftemplate m::t \"about\" (slot a (type INTEGER) (range 1 ?VARIABLE)) (multislot b (type NUMBER) (cardinality 1 2))
          (field c (allowed-symbols x y)) (slot d (default ?NONE)) (slot e (default-dynamic (gensym*))) (slot f (type STRING)))",
    );
    let [Item::Template(template)] = items.as_slice() else { panic!("{items:?}") };
    assert_eq!((template.name.as_str(), template.documentation.as_deref()), ("t", Some("about")));
    let fill = |slot: &str| template.slot(slot).and_then(|slot| slot.fill());
    assert_eq!(fill("a"), Some(vec![Value::Integer(1)]));
    assert_eq!(fill("b"), Some(vec![Value::Integer(0)]));
    assert_eq!(fill("c"), Some(vec![Value::Symbol("x".into())]));
    assert_eq!((fill("d"), fill("e")), (None, None));
    assert_eq!(fill("f"), Some(vec![Value::Text(String::new())]));
    let check = |slot: &str, values: &[Value]| template.slot(slot).expect("declared").check(values).err();
    assert_eq!(
        check("a", &[Value::Integer(0)]).as_deref(),
        Some("the slot `a` expected a number from 1 to ?VARIABLE, found `0`")
    );
    assert_eq!(check("a", &[]).as_deref(), Some("the slot `a` expected one value, found 0"));
    assert_eq!(check("b", &[]).as_deref(), Some("the slot `b` expected 1 to 2 values, found 0"));
    assert_eq!(
        check("b", &[Value::Text("1".into())]).as_deref(),
        Some("the slot `b` expected INTEGER or FLOAT, found STRING `\"1\"`")
    );
    assert_eq!(
        check("c", &[Value::Symbol("z".into())]).as_deref(),
        Some("the slot `c` expected one of x, y, found `z`")
    );
    assert_eq!(check("c", &[Value::Integer(3)]), None);
}

#[test]
fn what_is_wrong_is_said_at_its_place() {
    for (text, wanted) in [
        ("(a", "t:1:3: expected a value or `)`, found the end of the text"),
        ("(a (b 1)\n", "t:2:1: expected a slot `(name value)` or `)`, found the end of the text"),
        ("(a))", "t:1:4: expected a fact or a construct `(…)`, found `)`"),
        ("a", "t:1:1: expected a fact or a construct `(…)`, found `a`"),
        ("(1 2)", "t:1:2: expected the name of a template, found `1`"),
        ("(a (b \"c))", "t:1:7: a string without end"),
        ("(a\n ?x)", "t:2:2: expected a value, found the variable `?x`"),
        ("(a (b 1) 2)", "t:1:10: expected a slot `(name value)` or `)`, found `2`"),
        ("(a (b 1) (b 2))", "t:1:10: the slot `b` is given twice"),
        ("(a 9223372036854775808)", "t:1:4: expected an integer of at most 64 bits"),
        ("(a 1e999)", "t:1:4: expected a float of at most 64 bits"),
        ("(a 1 | 2)", "t:1:6: expected a value, found `|`"),
        ("(a \u{1})", "t:1:4: expected a word of CLIPS, found `\\u{1}`"),
        ("(deffacts d (a b (now)))", "t:1:18: expected `create$` or arithmetic, found the function `now`"),
        ("(deffacts d (a (now)))", "t:1:16: expected `create$` or arithmetic, found the function `now`"),
        (
            "(deffacts d (a (length$ (create$ x))))",
            "t:1:16: expected `create$` or arithmetic, found the function `length$`",
        ),
        (
            "(deffunction f () 1) (deffacts d (a (f)))",
            "t:1:37: expected `create$` or arithmetic, found the function `f`",
        ),
        ("(deffacts d (a (b 1) (now)))", "t:1:22: `now` is a function, which rmem does not evaluate here"),
        ("(deffacts d (a (/ 1 0)))", "t:1:16: the value of `/` is not a finite number"),
        ("(deffacts d (a (div 1 0)))", "t:1:16: `div` expected a number that is not zero"),
        ("(deffacts d (a (+ 9223372036854775807 1)))", "t:1:16: the result does not fit into 64 bits"),
        ("(deffacts d (a 1)", "t:1:18: expected a fact `(…)` or `)`, found the end of the text"),
        ("(defrule r (a))) (b)", "t:1:16: expected a fact or a construct `(…)`, found `)`"),
        ("(defrule r (a)", "t:1:15: expected `)`, found the end of the text"),
        ("(deftemplate t (slot a (type COLOR)))", "t:1:30: expected a type like SYMBOL"),
        ("(deftemplate t (slot a) (slot a))", "t:1:25: the slot `a` is declared twice"),
        ("(deftemplate t (slot a (type FLOAT) (default 3)))", "t:1:22: the slot `a` expected FLOAT, found INTEGER `3`"),
    ] {
        let complaint = complaint(text);
        assert!(complaint.starts_with(wanted), "{text}\n{complaint}");
    }
    assert!(complaint("(b)\n(a (c d)").ends_with("= hint: the list opened at 2:1 is not closed"));
}

#[test]
fn nesting_without_end_is_an_error_and_not_a_crash() {
    let deep = "(".repeat(100_000);
    assert!(complaint(&deep).contains("expected the name of a template"));
    assert!(complaint(&format!("(a (b {}", "(+ ".repeat(100_000))).contains("nested more than 200 deep"));
    assert!(complaint(&format!("(defrule r {deep}")).contains("found the end of the text"));
    assert!(complaint(&format!("(deftemplate r (slot a (default {}", "(+ ".repeat(100_000))).contains("nested more"));
    let rule = format!("(defrule r {deep}{})", ")".repeat(100_000));
    assert_eq!(read(&rule).len(), 1);
}

#[test]
fn long_texts_are_read() {
    let text = "(pose (name \"r 1\") (xy 1.0 2.5e-3)) ; a comment\n".repeat(20_000);
    assert_eq!(facts(&text).len(), 20_000);
    let long = format!("(a {})", "symbol ".repeat(200_000));
    assert!(matches!(&facts(&long)[0].body, Body::Ordered(values) if values.len() == 200_000));
    let quoted = format!("(a \"{}\")", "x(;\n".repeat(200_000));
    assert_eq!(facts(&quoted).len(), 1);
}
