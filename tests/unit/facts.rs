//! Documents ⇄ CLIPS facts: both laws, and what has no place in a fact.

use bson::{Bson, Document, doc};
use proptest::prelude::*;
use rmem::clips::facts::{Exporter, Importer, Nested, Schema};
use rmem::formats::Source;
use rmem::formats::Span;
use rmem::formats::clips::{
    Body, Fact, Filled, Item, Reader, Value, is_construct, is_instance, is_symbol, write_fact, write_remark,
    write_value,
};

fn schema(text: &str) -> Schema {
    let mut schema = Schema::default();
    for item in Reader::new(&Source::new("templates", text), []) {
        if let Item::Template(template) = item.unwrap() {
            schema.add(template);
        }
    }
    schema
}

fn exporter(schema: &Schema) -> Exporter<'_> {
    Exporter { schema, nested: Nested::Refuse, strict: false }
}

fn text(fact: &Fact) -> String {
    let mut out = String::new();
    write_fact(fact, write_value, &mut out);
    write_remark(fact, &mut out);
    out
}

fn export(document: &Document) -> String {
    text(&exporter(&Schema::default()).fact(document).unwrap())
}

fn refusal(document: &Document, schema: &Schema) -> String {
    exporter(schema).fact(document).unwrap_err().to_string()
}

fn import(fact: &str, schema: &Schema) -> Document {
    try_import(fact, schema).unwrap()
}

fn try_import(fact: &str, schema: &Schema) -> Result<Document, String> {
    let names: Vec<String> = schema.names().map(str::to_owned).collect();
    let source = Source::new("t", fact);
    let Some(Ok(Item::Fact(fact))) = Reader::new(&source, names).next() else { panic!("{fact}") };
    Importer { schema, strict: false }.document(&fact).map_err(|misfit| misfit.message)
}

#[test]
fn relation_is_the_template_and_keys_are_slots() {
    let document = doc! { "_id": 1, "relation": "pose", "sync-id": 3, "name": "r 1", "xy": [1.0, -0.0], "ok": true, "_robmem_info": {} };
    assert_eq!(export(&document), r#"(pose (sync-id 3) (name "r 1") (xy 1.0 -0.0) (ok TRUE))"#);
    assert_eq!(export(&doc! { "relation": "on", "values": ["a", "b c", 1] }), r#"(on a "b c" 1)"#);
    assert_eq!(export(&doc! { "relation": "handempty" }), "(handempty)");
    assert_eq!(export(&doc! { "relation": "t", "m": [] }), "(t (m))");
}

#[test]
fn a_string_that_reads_back_as_a_symbol_is_one() {
    for (string, written) in [
        ("green", "green"),
        ("A-1", "A-1"),
        ("3", "\"3\""),
        ("1e3", "\"1e3\""),
        ("", "\"\""),
        ("TRUE", "\"TRUE\""),
        ("[x]", "\"[x]\""),
        ("?x", "\"?x\""),
        ("a\"\\b", "\"a\\\"\\\\b\""),
        ("a) (b", "\"a) (b\""),
    ] {
        assert_eq!(export(&doc! { "relation": "r", "values": [string] }), format!("(r {written})"));
    }
}

#[test]
fn types_that_a_document_would_lose_are_recorded() {
    let document = import(r#"(t (a "x") (b x) (m x "y" [z]) (c "x y") (relation r) (_id 1))"#, &Schema::default());
    let wanted = doc! {
        "relation": "t", "a": "x", "b": "x", "m": ["x", "y", "[z]"], "c": "x y", "relation_": "r", "_id_": 1,
        "_robmem_info": { "clips": {
            "strings": ["a", "m y"], "instances": ["m [z]"], "names": { "_id_": "_id", "relation_": "relation" },
        } },
    };
    assert_eq!(document, wanted);
    assert_eq!(import("(t (a x))", &Schema::default()), doc! { "relation": "t", "a": "x" });
}

#[test]
fn a_string_of_an_array_stays_one_where_the_array_changes() {
    let mut document = import(r#"(t (m x "y" [z]))"#, &Schema::default());
    document.insert("m", vec!["new", "y", "[z]", "x"]);
    assert_eq!(export(&document), "(t (m new \"y\" [z] x))");
    // A text that is a symbol as well is told from it by its place.
    let both = import(r#"(t (m y "y"))"#, &Schema::default());
    assert_eq!(both.get_document("_robmem_info").unwrap(), &doc! { "clips": { "strings": ["m 1"] } });
    assert_eq!(export(&both), "(t (m y \"y\"))");
}

#[test]
fn texts_true_and_false_are_symbols_in_slots_of_symbols() {
    let schema = schema("(deftemplate t (slot s (type SYMBOL)) (multislot m (type SYMBOL)) (slot a))");
    let document = doc! { "relation": "t", "s": "FALSE", "m": ["TRUE", "x"], "a": "TRUE" };
    assert_eq!(text(&exporter(&schema).fact(&document).unwrap()), r#"(t (s FALSE) (m TRUE x) (a "TRUE"))"#);
}

#[test]
fn words_of_clips_are_no_facts() {
    for text in ["(not a)", "(exists 1)", "(deffacts d (assert a))"] {
        let error = try_import(text, &Schema::default()).unwrap_err();
        assert!(error.contains("which CLIPS keeps for itself"), "{text}: {error}");
    }
}

#[test]
fn a_remark_keeps_an_array_of_one_value_an_array() {
    let document = doc! { "relation": "t", "a": [1], "b": ["x", "y"], "c": ["z"], "d": 1 };
    assert_eq!(export(&document), "(t (a 1) (b x y) (c z) (d 1)) ; rmem: multislot a c");
    for remarked in [
        "(t (a 1) (b x y) (c z) (d 1)) ; rmem: multislot a c",
        "(assert (t (a 1) (b x y) (c z) (d 1))) ; rmem: multislot a c",
        "(deffacts w\n(t (a 1) (b x y) (c z) (d 1)) ; rmem: multislot a c\n(t (d 2))\n)",
    ] {
        assert_eq!(import(remarked, &Schema::default()), document, "{remarked}");
    }
    let plain = doc! { "relation": "t", "a": 1 };
    for other in
        ["(t (a 1))\n; rmem: multislot a", "; rmem: multislot a\n(t (a 1))", "(t (a 1)) (u (a 1)) ; rmem: multislot a"]
    {
        assert_eq!(import(other, &Schema::default()), plain, "{other}");
    }
    let known = schema("(deftemplate t (multislot a))");
    let fact = exporter(&known).fact(&doc! { "relation": "t", "a": [1] }).unwrap();
    assert_eq!(text(&fact), "(t (a 1))");
}

#[test]
fn templates_decide_types_and_fill_in_defaults() {
    let schema = schema(
        "(deftemplate t (slot s (type STRING)) (slot f (type FLOAT)) (multislot m) (slot i (type INTEGER) (default 7)))",
    );
    let document = doc! { "relation": "t", "s": "green", "f": 3 };
    assert_eq!(text(&exporter(&schema).fact(&document).unwrap()), r#"(t (s "green") (f 3.0))"#);
    let wanted = doc! { "relation": "t", "m": ["x"], "s": "", "f": 0.0, "i": 7 };
    assert_eq!(import("(t (m x))", &schema), wanted);
    assert_eq!(import("(t)", &schema).get("m"), Some(&Bson::Array(Vec::new())));
    assert!(try_import("(t (f 3))", &schema).unwrap_err().contains("expected FLOAT, found INTEGER `3`"));
    assert!(try_import("(t (s green))", &schema).unwrap_err().contains("expected STRING, found SYMBOL `green`"));
    assert!(try_import("(t (x 1))", &schema).unwrap_err().contains("`x` is not a slot of `t`; expected s, f, m, i"));
    assert!(try_import("(t 1)", &schema).unwrap_err().contains("expected the slots of `t`"));
}

#[test]
fn what_has_no_place_in_a_fact_is_refused_by_its_key() {
    let none = Schema::default();
    for (value, why) in [
        (Bson::Null, "null"),
        (Bson::Double(f64::NAN), "NaN"),
        (Bson::Double(f64::INFINITY), "an infinite number"),
        (bson::bson!({ "x": 1 }), "a nested document"),
        (bson::bson!([[1]]), "an array in an array"),
        (Bson::DateTime(bson::DateTime::from_millis(0)), "a date"),
    ] {
        let wanted = format!("the key `k` is {why}, which no slot can hold");
        assert_eq!(refusal(&doc! { "relation": "t", "k": value }, &none), wanted);
    }
    assert!(refusal(&doc! { "relation": "t", "k": "a\0b" }, &none).contains("`k` holds a NUL"));
    assert!(refusal(&doc! { "relation": "t", "a b": 1 }, &none).contains("`a b` is not a symbol"));
    assert!(refusal(&doc! { "a": 1 }, &none).contains("`relation` is missing"));
    assert!(refusal(&doc! { "relation": "a) (b" }, &none).contains("not a symbol"));
    assert!(refusal(&doc! { "relation": "deffacts" }, &none).contains("keeps for itself"));
    let t = schema("(deftemplate t (slot k (allowed-values a b)) (slot n (default ?NONE)) (slot s (type SYMBOL)))");
    assert!(refusal(&doc! { "relation": "t", "n": 1, "k": "c" }, &t).contains("expected one of a, b, found `c`"));
    assert!(refusal(&doc! { "relation": "t", "k": "a" }, &t).contains("`n` is missing"));
    assert!(refusal(&doc! { "relation": "t", "n": 1, "s": "a b" }, &t).contains("expected SYMBOL"));
    assert!(refusal(&doc! { "relation": "t", "n": [1, 2] }, &t).contains("expected one value, found 2"));
}

#[test]
fn nested_values_are_flattened_or_written_as_json() {
    let schema = Schema::default();
    let document = doc! { "relation": "t", "p": { "x": 1, "q": { "y": "a" } }, "m": [[1], [2, [3]]] };
    let with = |nested| Exporter { nested, ..exporter(&schema) }.fact(&document).map(|fact| text(&fact)).unwrap();
    assert_eq!(with(Nested::Flatten), "(t (p_x 1) (p_q_y a) (m 1 2 3))");
    assert_eq!(with(Nested::Json), r#"(t (p "{\"x\":1,\"q\":{\"y\":\"a\"}}") (m "[1]" "[2,[3]]"))"#);
    let clash = doc! { "relation": "t", "p": { "x": 1 }, "p_x": 2 };
    let error = Exporter { nested: Nested::Flatten, ..exporter(&schema) }.fact(&clash).unwrap_err();
    assert!(error.to_string().starts_with("the key `p_x` comes twice"), "{error}");
}

fn symbols() -> impl Strategy<Value = String> {
    prop_oneof![
        "[a-z]{1,3}",
        "[!#-%'*-:=->@-\\{}ä€<][!#-%'*-:=-\\{}ä€]{0,4}",
        Just("TRUE".to_owned()),
        Just("relation".to_owned()),
        Just("values".to_owned()),
        Just("_id".to_owned()),
        Just("$a.b".to_owned()),
    ]
    .prop_filter("a symbol", |text| is_symbol(text))
}

fn values() -> impl Strategy<Value = Value> {
    prop_oneof![
        symbols().prop_map(Value::Symbol),
        prop_oneof!["[^\u{0}]{0,6}", "[a-z]{1,3}", "-?[0-9]{1,3}", "\\[[a-z]\\]", symbols()].prop_map(Value::Text),
        any::<i64>().prop_map(Value::Integer),
        (-3..3_i64).prop_map(Value::Integer),
        any::<f64>().prop_filter("finite", |number| number.is_finite()).prop_map(Value::Float),
        symbols().prop_filter("a name", |text| is_instance(text)).prop_map(Value::Instance),
    ]
}

fn slots() -> impl Strategy<Value = Vec<Filled>> {
    let values = prop_oneof![3 => values().prop_map(|value| vec![value]), 1 => prop::collection::vec(values(), 0..4)];
    prop::collection::btree_map(symbols(), values, 1..5).prop_map(|slots| {
        let filled = |(name, values)| Filled { name, values, multiple: false, computed: false, span: Span::default() };
        slots.into_iter().map(filled).collect()
    })
}

fn any_fact() -> impl Strategy<Value = Fact> {
    let body =
        prop_oneof![slots().prop_map(Body::Slots), prop::collection::vec(values(), 0..4).prop_map(Body::Ordered)];
    let reserved = ["and", "or", "not", "test"];
    let name =
        symbols().prop_filter("a template", move |name| !is_construct(name) && !reserved.contains(&name.as_str()));
    (name, body).prop_map(|(name, body)| Fact { name, body, span: Span::default() })
}

fn any_value() -> impl Strategy<Value = Bson> {
    prop_oneof![
        "[^\u{0}]{0,6}".prop_map(Bson::String),
        symbols().prop_map(Bson::String),
        any::<i32>().prop_map(Bson::Int32),
        any::<i64>().prop_filter("large", |number| i32::try_from(*number).is_err()).prop_map(Bson::Int64),
        any::<f64>().prop_filter("finite", |number| number.is_finite()).prop_map(Bson::Double),
        any::<bool>().prop_map(Bson::Boolean),
    ]
}

/// Documents that a fact can hold.
fn any_document() -> impl Strategy<Value = Document> {
    let many = prop::collection::vec(any_value(), 0..4);
    let value = prop_oneof![3 => any_value(), 1 => many.prop_map(Bson::Array)];
    let slots = prop::collection::btree_map("[a-z-]{1,5}", value, 1..5);
    ("r[a-z]", slots).prop_map(|(relation, slots)| {
        doc! { "relation": relation }.into_iter().chain(slots.into_iter().filter(|(key, _)| key != "values")).collect()
    })
}

proptest! {
    #[test]
    fn facts_to_documents_to_facts_is_the_identity(fact in any_fact()) {
        let schema = Schema::default();
        let once = text(&fact);
        let document = import(&once, &schema);
        let again = text(&exporter(&schema).fact(&document).unwrap());
        prop_assert_eq!(once, again);
    }

    #[test]
    fn documents_to_facts_to_documents_is_the_identity(document in any_document()) {
        prop_assume!(document.len() > 1);
        let schema = Schema::default();
        let fact = text(&exporter(&schema).fact(&document).unwrap());
        prop_assert_eq!(import(&fact, &schema), document);
    }

    #[test]
    fn no_text_makes_the_reader_panic(text in "[()\"a-c1.;?\\\\ \n=+-]{0,40}|(\\((deffacts|deftemplate|slot|a|defrule|\\+)? ?){0,9}[)]{0,9}") {
        let source = Source::new("t", text);
        for item in Reader::new(&source, []) {
            let _ = item.map_err(|error| error.to_string());
        }
    }
}
