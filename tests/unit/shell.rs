use bson::spec::BinarySubtype;
use bson::{Binary, Bson, DateTime, Decimal128, Document, Regex, Timestamp, doc, oid::ObjectId};
use proptest::prelude::*;
use rmem::formats::Source;
use rmem::formats::shell::{
    MAX_DEPTH, canonical, parse_document, parse_documents, parse_pipeline, parse_value, parse_world, pretty, relaxed,
};

fn source(text: &str) -> Source {
    Source::new("<argument>", text)
}

fn value(text: &str) -> Bson {
    parse_value(&source(text)).unwrap_or_else(|error| panic!("{error}"))
}

fn document(text: &str) -> Document {
    parse_document(&source(text)).unwrap_or_else(|error| panic!("{error}"))
}

fn complaint(text: &str) -> String {
    parse_document(&source(text)).expect_err(text).to_string()
}

#[test]
fn reads_queries_as_they_are_typed_into_a_shell() {
    assert_eq!(
        document("{relation:'on-table', n:{$gt: 3}, 'rings.0': {$exists: true}, // a comment\n _x$1: [1, 2.0,],}"),
        doc! { "relation": "on-table", "n": { "$gt": 3 }, "rings.0": { "$exists": true }, "_x$1": [1, 2.0] }
    );
    assert_eq!(document("/* all */ {}"), doc! {});
    assert_eq!(document("{cap-loaded: 'NONE', a--b_1: -1}"), doc! { "cap-loaded": "NONE", "a--b_1": -1 });
    let now = document("{at: Date.now()}").get_i64("at").unwrap();
    assert!(DateTime::now().timestamp_millis() >= now && now > 1_700_000_000_000);
    assert_eq!(document(r#"{"a": "b\u00e9\n", 1: 2}"#), doc! { "a": "bé\n", "1": 2 });
}

#[test]
fn reads_every_constructor_of_the_shell() {
    let oid = ObjectId::parse_str("507f1f77bcf86cd799439011").unwrap();
    let bytes = Bson::Binary(Binary { subtype: BinarySubtype::Generic, bytes: b"foo".to_vec() });
    let regex = |pattern: &str, options: &str| {
        let (pattern, options) = (pattern.to_owned().try_into().unwrap(), options.to_owned().try_into().unwrap());
        Bson::RegularExpression(Regex { pattern, options })
    };
    for (text, wanted) in [
        ("ISODate('2012-12-24T12:15:30.501Z')", Bson::DateTime(DateTime::from_millis(1_356_351_330_501))),
        ("new Date(-1)", Bson::DateTime(DateTime::from_millis(-1))),
        ("Date(0)", Bson::DateTime(DateTime::from_millis(0))),
        ("new  Date(\"1969-12-31\")", Bson::DateTime(DateTime::from_millis(-86_400_000))),
        ("ObjectId('507f1f77bcf86cd799439011')", Bson::ObjectId(oid)),
        ("NumberLong(3)", Bson::Int64(3)),
        ("NumberLong('9007199254740993')", Bson::Int64(9_007_199_254_740_993)),
        ("NumberLong(9007199254740993)", Bson::Int64(9_007_199_254_740_993)),
        ("Long(-3)", Bson::Int64(-3)),
        ("Boolean(1)", Bson::Boolean(true)),
        ("new Boolean('')", Bson::Boolean(false)),
        ("Boolean(0.0)", Bson::Boolean(false)),
        ("Boolean(NaN)", Bson::Boolean(false)),
        ("Boolean([])", Bson::Boolean(true)),
        ("Boolean()", Bson::Boolean(false)),
        ("NumberInt('7')", Bson::Int32(7)),
        ("Int32(7)", Bson::Int32(7)),
        ("Double(3)", Bson::Double(3.0)),
        ("NumberDouble('-Infinity')", Bson::Double(f64::NEG_INFINITY)),
        ("NumberDecimal('1.10')", Bson::Decimal128("1.10".parse::<Decimal128>().unwrap())),
        ("Decimal128('2')", Bson::Decimal128("2".parse::<Decimal128>().unwrap())),
        ("BinData(0, 'Zm9v')", bytes.clone()),
        ("HexData(0, '666f6f')", bytes),
        ("Timestamp(5, 6)", Bson::Timestamp(Timestamp { time: 5, increment: 6 })),
        ("Timestamp({t: 5, i: 6})", Bson::Timestamp(Timestamp { time: 5, increment: 6 })),
        ("MinKey()", Bson::MinKey),
        ("MaxKey", Bson::MaxKey),
        ("undefined", Bson::Undefined),
        ("/a\\/b[/]/im", regex("a\\/b[/]", "im")),
        ("RegExp('^a', 'i')", regex("^a", "i")),
        ("Symbol('s')", Bson::Symbol("s".to_owned())),
        ("Code('x')", Bson::JavaScriptCode("x".to_owned())),
        ("DBRef('c', 1, 'd')", Bson::Document(doc! { "$ref": "c", "$id": 1, "$db": "d" })),
        ("-Infinity", Bson::Double(f64::NEG_INFINITY)),
        ("0xff", Bson::Int32(255)),
        ("+1", Bson::Int32(1)),
        (".5", Bson::Double(0.5)),
    ] {
        assert_eq!(value(text), wanted, "{text}");
    }
    assert!(matches!(value("NaN"), Bson::Double(number) if number.is_nan()));
    let Bson::Binary(uuid) = value("UUID('00112233-4455-6677-8899-aabbccddeeff')") else { panic!("a binary") };
    assert_eq!((uuid.subtype, uuid.bytes.len()), (BinarySubtype::Uuid, 16));
}

#[test]
fn reads_extended_json_of_both_kinds() {
    assert_eq!(
        document(
            r#"{"_id": {"$oid": "507f1f77bcf86cd799439011"}, "a": {"$numberLong": "9007199254740993"},
                "b": {"$date": {"$numberLong": "-1"}}, "c": {"$date": "1970-01-01T00:00:00Z"},
                "d": {"$timestamp": {"t": 1, "i": 2}}, "e": {"$numberDouble": "1"}, "f": {"$numberInt": "1"}}"#
        ),
        doc! { "_id": ObjectId::parse_str("507f1f77bcf86cd799439011").unwrap(), "a": 9_007_199_254_740_993_i64,
        "b": DateTime::from_millis(-1), "c": DateTime::from_millis(0),
        "d": Timestamp { time: 1, increment: 2 }, "e": 1.0, "f": 1 }
    );
    let far = DateTime::from_millis(i64::MAX);
    assert_eq!(document(&relaxed(&doc! { "far": far })), doc! { "far": far });
}

#[test]
fn leaves_query_operators_alone() {
    for text in [r#"{"a":{"$regex":"a","$options":"i"}}"#, r#"{"a":{"$type":"string"}}"#, r#"{"$ref":"c","$id":1}"#] {
        assert_eq!(relaxed(&document(text)), text);
    }
}

#[test]
fn refuses_malformed_extended_json_where_it_stands() {
    assert_eq!(
        complaint("{a: 1,\n b: {$oid: 'xyz'}}"),
        "<argument>:2:5: `$oid` takes a string of 24 hexadecimal digits, alone: {\"$oid\": \"…\"}\n  |\n\
         2 |  b: {$oid: 'xyz'}}\n  |     ^^^^^^^^^^^^^"
    );
    for text in [
        "{$numberLong: 3}",
        "{$numberInt: '2147483648'}",
        "{$date: 'yesterday'}",
        "{$date: 0, x: 1}",
        "{$binary: {base64: '!', subType: '00'}}",
        "{$timestamp: {t: -1, i: 0}}",
        "{$minKey: 2}",
        "{$code: 'x', $scope: 1}",
        "{$uuid: '1'}",
    ] {
        assert!(complaint(&format!("{{a: {text}}}")).starts_with("<argument>:1:5: `$"), "{text}");
    }
}

#[test]
fn refuses_what_the_robot_memory_before_refused() {
    for text in [
        "{key-:+'not existing'}",
        "{'testkey'::'value'}",
        "warbagarbl",
        "{'bad':1.2.3}",
        "{([})]",
        "{____:4.56!}",
        "",
        "{",
        "{a: 1} {b: 2}",
        "{a: 'x}",
        "{a: 01x}",
        "{cap-: 1}",
        "{-cap: 1}",
        "{a: cap-color}",
        "{a: Date.then()}",
        "{a: new Robot()}",
        "{a: /x/g}",
    ] {
        complaint(text);
    }
    assert_eq!(
        complaint("{'bad':1.2.3}"),
        "<argument>:1:8: expected a value, found `1.2.3`\n  |\n1 | {'bad':1.2.3}\n  |        ^^^^^"
    );
}

#[test]
fn names_the_first_token_that_does_not_fit() {
    for (text, place, message, hint) in [
        ("{a:1", "1:5", "expected `,` or `}`, found the end of the text", "the `{` at 1:1 is not closed"),
        ("{a: [1", "1:7", "expected `,` or `]`, found the end of the text", "the `[` at 1:5 is not closed"),
        ("{a:1 b:2}", "1:6", "expected `,` or `}`, found `b`", ""),
        ("{a 1}", "1:4", "expected `:`, found `1`", ""),
        ("{a-:1}", "1:3", "expected `:`, found `-`", "quote the key: 'a-'"),
        ("{a-b.c:1}", "1:5", "expected `:`, found `.c`", "quote the key: 'a-b.c'"),
        ("{a-b 1}", "1:6", "expected `:`, found `1`", ""),
        ("{a: Date.now(}", "1:14", "expected a value or `)`, found `}`", "the `(` at 1:13 is not closed"),
        ("{rings.0:1}", "1:7", "expected `:`, found `.0`", "quote the key: 'rings.0'"),
        (
            "{x: {: 1}}",
            "1:6",
            "expected a key or `}`, found `:`",
            "in double quotes, a shell replaces a name behind `$`; write `\\$` there, or use single quotes outside",
        ),
        ("{1a:1}", "1:2", "expected a key or `}`, found `1a`", "quote the key: '1a'"),
        ("{a:\"x}", "1:4", "the string has no end", "it ends with the same quote, on the same line"),
        ("{a:\"x\\\"}", "1:4", "the string has no end", "it ends with the same quote, on the same line"),
        ("{a:1}}", "1:6", "expected the end of the text, found `}`", ""),
        ("{a:1} /* x", "1:7", "the comment has no end", "it ends with `*/`"),
        ("{a: /x}", "1:5", "the regular expression has no end", ""),
        ("{a: [1,,2]}", "1:8", "expected a value or `]`, found `,`", ""),
        ("{a: ISODate('x'}", "1:16", "expected `,` or `)`, found `}`", "the `(` at 1:12 is not closed"),
        ("{'testkey'::'value'}", "1:12", "expected a value, found `:`", ""),
        ("{a: on table}", "1:5", "expected a value, found `on`", "strings are written in quotes"),
        ("{a: ,}", "1:5", "expected a value, found `,`", ""),
        ("{relation:'s'", "1:14", "expected `,` or `}`, found the end of the text", "the `{` at 1:1 is not closed"),
        ("-q", "1:1", "expected a value, found `-`", ""),
    ] {
        let error = parse_document(&source(text)).expect_err(text);
        assert!(error.to_string().starts_with(&format!("<argument>:{place}: {message}\n")), "{text}: {error}");
        assert_eq!(error.hints().join(""), hint, "{text}");
    }
}

#[test]
fn says_what_is_no_document_among_documents() {
    for (text, wanted) in [
        ("{a:1}}", "1:6: expected another document or the end, found `}`"),
        ("{a:1} 7", "1:7: expected a document `{…}`, found a number"),
        ("[1,2]", "1:2: expected a document `{…}`, found a number"),
        ("[{a:1}, ,]", "1:9: expected a document or `]`, found `,`"),
        ("{a:1}\n/* x", "2:1: the comment has no end"),
        ("/x", "1:1: the regular expression has no end"),
        ("{a:1}\n{b:'x\n{c:1}", "2:4: the string has no end"),
    ] {
        let error = parse_documents(&source(text)).expect_err(text).to_string();
        assert!(error.starts_with(&format!("<argument>:{wanted}")), "{text}: {error}");
    }
    for (text, wanted) in [
        ("{\"a.b\":[1]}", "1:9: expected a document `{…}`, found a number"),
        ("{\"a.b\":[] 'c.d':[]}", "1:11: expected `,` or `}` after an array, found `'`"),
        ("{\"a.b:[]}", "1:2: the string has no end"),
        ("{a.b []}", "1:6: expected `:` after the namespace, found `[`"),
    ] {
        let error = parse_world(&source(text)).expect_err(text).to_string();
        assert!(error.starts_with(&format!("<argument>:{wanted}")), "{text}: {error}");
    }
}

/// Each takes a second or less; going over the text again and again takes hours.
#[test]
fn long_strings_and_comments_take_time_linear_in_their_length() {
    let long = "x".repeat(5_000_000);
    for (text, fine) in [
        (format!("{{a: '{long}'}}"), true),
        (format!("{{a: 1 /* {long} */}}"), true),
        (format!("{{a: '{long}"), false),
        (format!("{{a: 1}} /* {long}"), false),
    ] {
        let source = source(&text);
        assert_eq!(parse_document(&source).is_ok(), fine);
        assert_eq!(parse_documents(&source).is_ok(), fine);
    }
}

#[test]
fn database_pointers_come_back_in_both_spellings_of_the_id() {
    let written = r#"{"p":{"$dbPointer":{"$ref":"a.b","$id":{"$oid":"507f1f77bcf86cd799439011"}}}}"#;
    let read = document(written);
    assert!(matches!(read.get("p"), Some(Bson::DbPointer(_))));
    assert_eq!(canonical(&read), written);
    assert_eq!(document("{p: {$dbPointer: {$ref: 'a.b', $id: ObjectId('507f1f77bcf86cd799439011')}}}"), read);
}

#[test]
fn refuses_a_key_given_twice() {
    assert!(complaint("{a: 1,\n 'a': 2}").starts_with("<argument>:2:2: the key `a` is given twice"));
}

#[test]
fn takes_documents_in_a_row_in_lines_and_in_an_array() {
    let wanted = vec![doc! { "a": 1 }, doc! { "b": "}" }, doc! {}];
    for text in
        ["{a: 1} {b: '}'}{}", "{a: 1}\n{b: '}'}\n\n{}\n", "{a: 1}, {b: '}'},{},", "[{a: 1}, {b: '}'}, {},] // end"]
    {
        let found = parse_documents(&source(text)).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(found.into_iter().map(|(_, document)| document).collect::<Vec<_>>(), wanted, "{text}");
    }
    assert_eq!(parse_documents(&source(" // nothing\n")).map(|found| found.len()), Ok(0));
    for text in ["[{a: 1} {b: 1}]", "[{a: 1}", "[{a: 1}] {}", "{a: 1} 7", "[1]", "{a: 1},,{b: 1}", "{a: 1"] {
        parse_documents(&source(text)).expect_err(text);
    }
    let (span, _) = parse_documents(&source("{a: 1}\n {b: 2}")).unwrap().pop().unwrap();
    assert_eq!((span.start, span.end), (8, 14));
}

#[test]
fn takes_one_stage_as_a_pipeline() {
    let stage = doc! { "$match": { "a": 1 } };
    assert_eq!(parse_pipeline(&source("{$match: {a: 1}}")), Ok(vec![stage.clone()]));
    assert_eq!(parse_pipeline(&source("[{$match: {a: 1}}, {$limit: 1}]")), Ok(vec![stage, doc! { "$limit": 1 }]));
    assert_eq!(parse_pipeline(&source("[]")), Ok(vec![]));
    for text in ["", "3", "{$match: {}} {$limit: 1}"] {
        parse_pipeline(&source(text)).expect_err(text);
    }
}

#[test]
fn reads_world_files() {
    let world = parse_world(&source("{'robmem.a': [{x: 1}, {x: 2}], // more\n \"b.c\": [],}")).unwrap();
    let found: Vec<_> =
        world.iter().map(|(name, span, documents)| (name.as_str(), span.start, documents.len())).collect();
    assert_eq!(found, [("robmem.a", 1, 2), ("b.c", 40, 0)]);
    for text in
        ["[]", "{'a.b': {}}", "{'a.b': [1]}", "{'a.b': [], 'a.b': []}", "{'a.b': []", "{'a.b': []} x", "{a.b []}"]
    {
        parse_world(&source(text)).expect_err(text);
    }
}

#[test]
fn nests_up_to_the_bound_and_no_deeper() {
    let nested = |depth: usize| format!("{{a: {}1{}}}", "[".repeat(depth), "]".repeat(depth));
    document(&nested(MAX_DEPTH - 1));
    let deepest = "{a: ".repeat(MAX_DEPTH) + "1" + &"}".repeat(MAX_DEPTH);
    assert_eq!(document(&relaxed(&document(&deepest))), document(&deepest));
    for text in [nested(MAX_DEPTH), "[".repeat(100_000), "{a:".repeat(100_000), "ISODate(".repeat(100_000)] {
        assert!(parse_value(&source(&text)).unwrap_err().message().contains("deeper than 200"));
        parse_documents(&source(&text)).unwrap_err();
        parse_world(&source(&text)).unwrap_err();
    }
}

#[test]
fn writes_the_spellings_of_the_specification() {
    let written = doc! { "z": 1, "a": 2_i64, "d": 1.0, "e": 1e300, "n": f64::NAN, "t": DateTime::from_millis(0), "s": "a\"\u{1}" };
    assert_eq!(
        relaxed(&written),
        r#"{"z":1,"a":2,"d":1.0,"e":1e300,"n":{"$numberDouble":"NaN"},"t":{"$date":"1970-01-01T00:00:00Z"},"s":"a\"\u0001"}"#
    );
    assert_eq!(
        canonical(&doc! { "a": 2_i64, "d": 1.0, "t": DateTime::from_millis(0) }),
        r#"{"a":{"$numberLong":"2"},"d":{"$numberDouble":"1.0"},"t":{"$date":{"$numberLong":"0"}}}"#
    );
    assert_eq!(pretty(&Bson::Document(doc! { "a": [1], "b": {} })), "{\n  \"a\": [\n    1\n  ],\n  \"b\": {}\n}");
}

/// Any value; keys do not look like Extended JSON's.
fn any_bson() -> impl Strategy<Value = Bson> {
    let leaf = prop_oneof![
        any::<i32>().prop_map(Bson::Int32),
        any::<i64>().prop_map(Bson::Int64),
        prop::num::f64::ANY.prop_filter("NaN is not equal to itself", |x| !x.is_nan()).prop_map(Bson::Double),
        any::<String>().prop_map(Bson::String),
        any::<bool>().prop_map(Bson::Boolean),
        Just(Bson::Null),
        Just(Bson::Undefined),
        Just(Bson::MinKey),
        Just(Bson::MaxKey),
        any::<[u8; 12]>().prop_map(|bytes| Bson::ObjectId(ObjectId::from_bytes(bytes))),
        any::<i64>().prop_map(|millis| Bson::DateTime(DateTime::from_millis(millis))),
        (any::<u32>(), any::<u32>()).prop_map(|(time, increment)| Bson::Timestamp(Timestamp { time, increment })),
        (any::<u8>(), any::<Vec<u8>>())
            .prop_map(|(kind, bytes)| Bson::Binary(Binary { subtype: BinarySubtype::from(kind), bytes })),
        ("[^\0]*", "[ilmsux]{0,2}").prop_map(|(pattern, options)| {
            let mut options: Vec<char> = options.chars().collect();
            options.sort_unstable();
            let options = options.into_iter().collect::<String>().try_into().expect("no NUL");
            Bson::RegularExpression(Regex { pattern: pattern.try_into().expect("no NUL"), options })
        }),
        any::<String>().prop_map(Bson::Symbol),
        any::<String>().prop_map(Bson::JavaScriptCode),
        (any::<String>(), "[^\0$]*", any::<i32>()).prop_map(|(code, key, number)| {
            Bson::JavaScriptCodeWithScope(bson::JavaScriptCodeWithScope { code, scope: doc! { key: number } })
        }),
        ("[a-zé.]*", any::<[u8; 12]>()).prop_map(|(name, id)| {
            value(&format!("{{$dbPointer: {{$ref: '{name}', $id: ObjectId('{}')}}}}", ObjectId::from_bytes(id)))
        }),
        (any::<i64>(), -6176_i32..6000)
            .prop_map(|(digits, exponent)| Bson::Decimal128(format!("{digits}E{exponent}").parse().expect("decimal"))),
    ];
    leaf.prop_recursive(4, 32, 6, |inner| {
        prop_oneof![
            prop::collection::vec(inner.clone(), 0..6).prop_map(Bson::Array),
            prop::collection::vec(("[^\0$]*", inner), 0..6)
                .prop_map(|members| Bson::Document(members.into_iter().collect())),
        ]
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(200) })]

    #[test]
    fn canonical_text_reads_back_as_the_same_value(value in any_bson()) {
        let document = doc! { "value": value };
        prop_assert_eq!(parse_document(&source(&canonical(&document))), Ok(document));
    }

    #[test]
    fn relaxed_text_reads_back_as_the_same_text(value in any_bson()) {
        let text = relaxed(&doc! { "value": value });
        let read = parse_document(&source(&text)).map(|document| relaxed(&document));
        prop_assert_eq!(read, Ok(text));
    }

    #[test]
    fn no_text_makes_it_panic(text in r#"[-{}\[\]()'"/\\:,.$a-e0-3 \n*xuE+]*"#) {
        let source = source(&text);
        let _ = (parse_value(&source), parse_documents(&source), parse_world(&source), parse_pipeline(&source));
        let _ = rmem::formats::shell::Reader::new("in", text.as_bytes()).count();
    }
}
