use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use bson::{Bson, DateTime, Document, RawDocumentBuf, doc, oid::ObjectId};
use proptest::prelude::*;
use rmem::formats::pddl::Dialect;
use rmem::formats::{Diagnostic, Source, Span, shell};
use rmem::memory::Memory;
use rmem::pddl::Domain;
use rmem::problem::{Generated, ProblemError, Request, Syntax, generate, names, stream};
use rmem::query::Collation;
use rmem::store::embedded::Embedded;
use rmem::store::{
    Aggregation, Documents, Find, FindAndModify, Index, IndexChange, Inserted, Modified, Name, Namespace, Put, Query,
    Store, StoreError, UpdateRequest, Updated, Values,
};

fn memory(documents: Vec<Document>) -> Memory {
    let memory = Memory::new(Box::new(Embedded::in_memory().expect("a store")), None, Vec::new());
    if !documents.is_empty() {
        memory.insert(&namespace(), documents).expect("stored");
    }
    memory
}

fn namespace() -> Namespace {
    Namespace { database: "robmem".to_owned(), collection: "worldmodel".to_owned() }
}

fn request(template: &str) -> Request {
    Request {
        template: Source::new("t", template),
        parts: Vec::new(),
        syntax: Syntax::Auto,
        collection: namespace(),
        goal: None,
        parameters: Vec::new(),
        lenient: false,
    }
}

fn blocks() -> Vec<Document> {
    vec![
        doc! { "_id": 1, "relation": "on-table", "object": "A" },
        doc! { "_id": 2, "relation": "on-table", "object": "C" },
        doc! { "_id": 3, "relation": "on", "top": "D", "bottom": "A" },
        doc! { "_id": 4, "relation": "holding", "object": "B" },
    ]
}

fn made(template: &str, documents: Vec<Document>) -> Generated {
    generate(&request(template), &memory(documents)).unwrap_or_else(|error| panic!("{template}: {error}"))
}

fn text(template: &str, documents: Vec<Document>) -> String {
    made(template, documents).text
}

/// The text of a problem that is written while it is rendered; nothing where it has to be rendered again.
fn streamed(template: &str, documents: Vec<Document>) -> Option<String> {
    let made = stream(&request(template), &memory(documents), None, Dialect::default(), None).expect(template);
    made.map(|mut made| {
        let mut bytes = Vec::new();
        made.copy_to(&mut bytes).expect("read");
        String::from_utf8(bytes).expect("text")
    })
}

#[test]
fn a_loop_over_keys_is_written_as_the_engine_writes_it() {
    let documents = || {
        vec![
            doc! { "_id": 1, "name": "box 1", "n": 5, "f": 2.0, "on": true, "p": { "x-y": 3_i64 }, "l": [1], "z": Bson::Null },
            doc! { "on": false, "_id": ObjectId::from_bytes([7; 12]), "l": [], "p": { "x_y": -2.5 }, "name": "", "n": 0, "f": 1e21,
            "z": DateTime::from_millis(1) },
            doc! { "_id": "c", "name": "Not", "n": 1_i64 << 40, "f": 0.1, "on": true, "p": { "x_y": "a" }, "l": [[]], "z": {}, "long-name": 1 },
        ]
    };
    let text = |template: &str| generate(&request(template), &memory(documents())).map(|made| made.text).ok();
    let loops = [
        "(at {{ r.name }} {{r.n}}) {{- r.f -}} x{{ r.on }}",
        "{% if r.on %} a{{ r._id }}{% elif r.l %}l{% else %}\n{{- r.p.x_y }}{%- endif %} ;",
        "{#- a note -#} {% if not r.z or r.name == 'Not' and r.n %}({{ r.name }}-I){% endif +%}\n",
        "{% if r.n != 'x' %}O{{ r.n }}{% endif %}?{{ r.name }} ",
    ];
    for (nth, body) in loops.iter().enumerate() {
        for around in [
            "{L}",
            "{% macro m() %}{L}{% endmacro %}{{ m() }} {{ m() }}",
            "{% set v %}{L}{% endset %}{{ v }}",
            "{% filter upper %}{L}{% endfilter %}",
            "{% for s in query('robmem.worldmodel') %}{{ s.name|upper }} {L}{% endfor %}",
        ] {
            let template = around
                .replace("{L}", &format!("a {{%- for r in query('robmem.worldmodel') -%}} {body} {{%- endfor %}} b"));
            assert!(text(&template).is_some(), "{nth} {template}");
            assert_eq!(streamed(&template, documents()), text(&template), "{nth} {template}");
        }
    }
    // What is wrong in a row is reported by minijinja.
    for (nth, wrong) in [
        "{{ r.z }}",
        "{{ r.l }}",
        "{{ r.p }}",
        "{{ r.no }}",
        "{{ r.long_name }}",
        "{% if r.no %}{% endif %}",
        "{{ r.p.x_y.z }}",
        "{{ r.n.z }}",
    ]
    .iter()
    .enumerate()
    {
        let template = format!("{{% for r in query('robmem.worldmodel') %}}{wrong} {{% endfor %}}");
        assert_eq!((streamed(&template, documents()), text(&template)), (None, None), "{nth} {template}");
    }
    let template = "{% for r in query('robmem.worldmodel') %}{{ r._robmem_info.inserted|number }}{% endfor %}";
    assert_eq!((streamed(template, documents()), text(template)), (None, None));
    let marked = || vec![doc! { "name": "a\u{fdd0}0\u{fdd1}" }];
    for body in ["{{ r.name }}", "{% if r.name %}x{% endif %}", "{% if r.name == 'x' %}x{% endif %}"] {
        let template = format!("{{% for r in query('robmem.worldmodel') %}}{body}{{% endfor %}}");
        assert_eq!(streamed(&template, marked()), None);
        assert!(complaint(&template, marked()).contains("U+FDD0"), "{}", complaint(&template, marked()));
    }
}

fn complaint(template: &str, documents: Vec<Document>) -> String {
    match generate(&request(template), &memory(documents)) {
        Err(ProblemError::Template(diagnostic)) => diagnostic.to_string(),
        other => panic!("{template}: {other:?}"),
    }
}

fn lenient(template: &str, documents: Vec<Document>) -> String {
    let request = Request { lenient: true, ..request(template) };
    generate(&request, &memory(documents)).unwrap_or_else(|error| panic!("{error}")).text
}

#[test]
fn blocks_on_a_table_become_the_problem_of_the_thesis() {
    for path in ["fixtures/problem/blocks.tmpl", "fixtures/problem/blocks.j2"] {
        let template = std::fs::read_to_string(path).expect("the fixture");
        let request = Request { goal: Some("(on A B)".to_owned()), ..request(&template) };
        let problem = generate(&request, &memory(blocks())).unwrap_or_else(|error| panic!("{error}")).text;
        let words: Vec<&str> = problem.split_whitespace().collect();
        assert_eq!(
            words.join(" "),
            "(define (problem stacking) (:domain blocksworld) (:objects A B C D) (:goal (on A B)) \
             (:init (on-table A) (on-table C) (on D A) (holding B) ) )",
            "{path}"
        );
    }
}

#[test]
fn the_templates_of_the_shipped_worlds_give_problems() {
    for (world, template) in [
        ("blocksworld", "blocksworld/problem.pddl.j2"),
        ("blocksworld", "blocksworld/problem.pddl.tmpl"),
        ("rcll", "rcll/problem.pddl.j2"),
        ("rcll", "rcll/problem.pddl.tmpl"),
        ("tidyup", "tidyup/problem.pddl.j2"),
        ("tidyup", "tidyup/problem.pddl.tmpl"),
    ] {
        let read = |path: String| Source::new(path.as_str(), std::fs::read_to_string(&path).expect("the file"));
        let memory = memory(Vec::new());
        for (name, _, documents) in shell::parse_world(&read(format!("fixtures/{world}.json"))).expect("a world") {
            let documents = documents.into_iter().map(|(_, document)| document).collect();
            memory.insert(&Namespace::parse(&name).expect("a namespace"), documents).expect("stored");
        }
        let goal = (!template.contains("j2") || world == "blocksworld").then(|| "(and)".to_owned());
        let request = Request { template: read(format!("templates/{template}")), goal, ..request("") };
        let first = generate(&request, &memory).unwrap_or_else(|error| panic!("{template}: {error}"));
        let domain = Domain::read(&read(format!("domains/{world}/domain.pddl")), Dialect::default()).expect("a domain");
        first
            .check(&domain, Dialect::default())
            .unwrap_or_else(|errors| panic!("{template}: {errors:?}\n{}", first.text));
        assert_eq!(generate(&request, &memory).expect("the same again"), first);
    }
}

#[test]
fn what_the_checker_says_is_said_of_the_template_and_the_document() {
    let domain = "(define (domain d) (:requirements :strips) (:predicates (on-table ?x)))";
    let domain = Domain::read(&Source::new("d", domain), Dialect::default()).expect("a domain");
    let template = "(define (problem p) (:domain d) (:objects A)\n\
        (:init <<#T|{relation: 'on-table'}>>\n (on-table <<object>>)<</T>>)\n(:goal (and)))";
    let errors = made(template, blocks()).check(&domain, Dialect::default()).expect_err("C is not an object");
    let error = errors.first().expect("one").to_string();
    assert!(error.starts_with("t:3:12: "), "{error}");
    assert!(error.contains("from document _id 2 of robmem.worldmodel"), "{error}");
}

mod marker {
    use super::*;

    #[test]
    fn every_row_of_the_spelling_holds() {
        let id = ObjectId::parse_str("a07f1f77bcf86cd799439011").unwrap();
        let one = || {
            vec![doc! { "_id": id, "position": { "translation": [1, 2.5] }, "values": ["a", "b"],
            "n": 7, "m": 8_i64, "yes": true, "caps-on-shelf": 3, "rings": ["BLUE"], "id": 1, "name": "RS" }]
        };
        for (body, wanted) in [
            ("<<n>> <<m>>", "7 8"),
            ("<<position_translation_0>> <<position_translation_1>>", "1 2.500000"),
            ("(printed <<values>>)", "(printed  a b)"),
            ("<<yes>>", "1"),
            ("<<_id>> i<<_id>>", "a07f1f77bcf86cd799439011 ia07f1f77bcf86cd799439011"),
            ("N<<caps-on-shelf>>", "N3"),
            ("O<<id>> RING_<<rings_0>> <<name>>-I", "O1 RING_BLUE RS-I"),
            ("; <<name>> \t", "; RS \t"),
            ("<<! gone >>x", "x"),
        ] {
            assert_eq!(text(&format!("<<#A|{{}}>>{body}<</A>>"), one()), wanted, "{body}");
        }
    }

    #[test]
    fn sections_expand_as_upstream() {
        let two = || vec![doc! { "_id": 1, "x": "a" }, doc! { "_id": 2, "x": "b" }];
        for (template, wanted) in [
            ("[<<#A|{x: 'z'}>> no<</A>>]", "[]"),
            ("<<#A|{}>>(<<x>>)<</A>> <<#A>><<x>> <</A>>", "(a)(b) a b "),
            ("<<#A|{}>><<x>><<#A_separator>>, <</A_separator>><</A>>", "a, b"),
            ("<<#A|{x: 'a'}>>o:<<#B|{}>>(<<x>>)<</B>> <</A>>", "o:(a)(b) "),
            ("<<#A|{x: /B/i}>><<x>><</A>>", "b"),
        ] {
            assert_eq!(text(template, two()), wanted, "{template}");
        }
        let outer = complaint("<<#A|{}>><<#B|{}>><<y>><</B>><</A>>", two());
        assert!(outer.starts_with("t:1:19: the document has no key `y`"), "{outer}");
    }

    #[test]
    fn the_goal_is_seen_everywhere_but_behind_a_key_of_its_name() {
        let goal = |template: &str, document: Document| {
            let request = Request { goal: Some("(on A B)".to_owned()), ..request(template) };
            generate(&request, &memory(vec![document])).unwrap_or_else(|error| panic!("{error}")).text
        };
        assert_eq!(goal("<<<GOAL>>>", doc! {}), "<(on A B)>");
        assert_eq!(goal("<<#A|{}>><<GOAL>><</A>>", doc! {}), "(on A B)");
        assert_eq!(goal("<<#A|{}>><<GOAL>><</A>>", doc! { "GOAL": "mine" }), "mine");
    }

    #[test]
    fn what_was_empty_upstream_is_an_error_unless_lenient() {
        let odd = || vec![doc! { "_id": 7, "no": Bson::Null, "when": DateTime::from_millis(0), "a": { "b": 1 } }];
        for (body, message) in [
            ("<<gone>>", "the document has no key `gone`"),
            ("<<no>>", "the value of `no` is null"),
            ("<<when>>", "the value of `when` is a date"),
            ("<<a>>", "the document has no key `a`"),
        ] {
            let template = format!("<<#A|{{}}>>\n {body}<</A>>");
            let error = complaint(&template, odd());
            assert!(error.starts_with(&format!("t:2:2: {message}")), "{error}");
            assert!(error.contains("from document _id 7 of robmem.worldmodel"), "{error}");
            let wanted = if message.starts_with("the value") { "\n INVALID_VALUE_TYPE" } else { "\n " };
            assert_eq!(lenient(&template, odd()), wanted);
        }
        assert!(complaint("<<GOAL>>", Vec::new()).starts_with("t:1:1: there is no goal"));
        assert!(complaint("<<#A>>x<</A>>", Vec::new()).starts_with("t:1:1: there is no section `A`"));
        assert_eq!(lenient("<<GOAL>><<#A>>x<</A>>", Vec::new()), "");
    }

    #[test]
    fn bad_queries_are_complained_about_where_they_stand() {
        let error = complaint("\n<<#A|{x: }>><</A>>", Vec::new());
        assert!(error.starts_with("t:2:10: expected a value, found `}`"), "{error}");
        let error = complaint("\n<<#A|{$wrong: 1}>><</A>>", Vec::new());
        assert!(error.starts_with("t:2:6: "), "{error}");
    }
}

#[test]
fn a_template_of_both_spellings_asks_which_is_meant() {
    let error = complaint("<<name>> {{ goal }}", Vec::new());
    assert!(error.contains("--syntax"), "{error}");
    assert_eq!(text("<<#A|{$or: [{a: {b: {c: 1}}}]}>><</A>>", Vec::new()), "");
    assert_eq!(text("(a << b)", Vec::new()), "(a << b)");
}

#[test]
fn expressions_loops_and_macros_work_as_in_minijinja() {
    for (template, wanted) in [
        (
            "{% for d in query('robmem.worldmodel', {'relation': 'on-table'}) %}{{ loop.index }}{{ d.object }} {% endfor %}",
            "x--1--xA x--2--xC ",
        ),
        (
            "{% for d in query('robmem.worldmodel', '{}', sort='{_id: -1}', skip=1, limit=2) %}{{ d._id }} {% endfor %}",
            "3 2 ",
        ),
        ("{% for x in distinct('robmem.worldmodel', 'object') %}{{ x }}{{ ' ' if false }}\n{% endfor %}", "A\nB\nC\n"),
        ("{{ count('robmem.worldmodel', \"{relation: 'on'}\") + 1 }}", "2"),
        ("{{ find_one('robmem.worldmodel', {'_id': 3}).top }}", "D"),
        ("{% if find_one('robmem.worldmodel', {'_id': 9}) is none %}none{% endif %}", "none"),
        ("{% macro atom(p, x) %}({{ p }} {{ x }}){% endmacro %}{{ atom('on', 'A) (b') }}", "(on x--_41_29_20_28b--x)"),
        ("{% set n = 'O' ~ 12 %}{{ n }} {{ 'a' ~ ' b' }} O{{ 12 }}", "O12 x--a_20b--x O12"),
        ("{% set n %}O{{ 12 }}{% endset %}{{ n }} {{ n ~ 'x' }}", "O12 O12x"),
        (
            "{{ 7 / 2 }} {{ 4 / 2 }} {{ '3.50'|number }} {{ 1.23456|number(2) }} {{ 1e20 }}",
            "3.5 2.0 3.5 1.23 100000000000000000000.0",
        ),
        ("{{ 12|name }} {{ true }}", "x--12--x true"),
        ("{{ param('team', 'CYAN') }}\n", "CYAN\n"),
        (
            "{% for d in query('robmem.worldmodel', {'relation': 'on'}) %}{% for e in query('robmem.worldmodel', {'object': d.bottom}) %}{{ e.object }}{% endfor %}{% endfor %}",
            "A",
        ),
        ("{% if query('robmem.worldmodel', {'relation': 'none'}) %}some{% else %}no{% endif %}", "no"),
        ("{% if goal is defined %}a{% else %}b{% endif %}", "b"),
    ] {
        assert_eq!(text(template, blocks()), wanted, "{template}");
    }
}

#[test]
fn parameters_are_values_and_the_goal_is_pddl() {
    let request = Request {
        goal: Some("(on A B) (clear C)".to_owned()),
        parameters: vec![
            ("team".to_owned(), "A) (b".into()),
            ("list".to_owned(), Bson::Array(vec![1.into(), "x".into()])),
        ],
        ..request("{{ goal }} {{ team }} {{ list[1] }} {{ param('list')[0] }}")
    };
    let problem = generate(&request, &memory(Vec::new())).unwrap_or_else(|error| panic!("{error}")).text;
    assert_eq!(problem, "(and (on A B) (clear C)) x--_41_29_20_28b--x x 1");
    let unbalanced = Request { goal: Some("(on A B))".to_owned()), ..request };
    let error = generate(&unbalanced, &memory(Vec::new())).unwrap_err().to_string();
    assert!(error.starts_with("<goal>:1:9: "), "{error}");
}

#[test]
fn mistakes_are_complained_about_at_their_place() {
    for (template, wanted) in [
        ("a\n  {{ nothing }}", "t:2:3: `nothing` is undefined"),
        ("\n{% for d in query('robmem.worldmodel') %}\n{{ d.gone }}{% endfor %}", "t:3:1: `d.gone` is undefined"),
        (
            "{% for d in\n query('robmem.worldmodel', '{a: }') %}{% endfor %}",
            "t:2:2: in the filter: <filter>:1:5: expected a value",
        ),
        ("{% for d in\n query('robmem.worldmodel', {'$wrong': 1}) %}{% endfor %}", "t:"),
        ("\n{% for %}", "t:2:"),
        ("{{ [1] }}", "t:1:1: a list is not a name"),
        ("{{ none }}", "t:1:1: null has no name"),
        ("{% include 'x' %}", "t:1:4: there is no such template"),
        ("{{ 'a b'|safe }}", "t:1:"),
        ("{{ param('x') }}", "t:1:"),
        ("{{ count('robmem') }}", "t:1:"),
        ("{{ query('robmem.worldmodel', sort={'a': 1, 'b': 1}) }}", "t:1:"),
        ("{% macro m() %}{{ m() }}{% endmacro %}{{ m() }}", "t:1:"),
        ("{{ {'a': 1} }}", "t:1:1: a document is not a name"),
        ("\u{FDD0}", "t:1:1: a template cannot hold"),
    ] {
        let error = complaint(template, blocks());
        assert!(error.starts_with(wanted), "{template}: {error}");
    }
}

#[test]
fn a_mistake_in_a_template_says_what_there_is() {
    let holding = "{% for d in query('robmem.worldmodel', '{_id: 4}') %}";
    for (template, words) in [
        (
            "{{ find('robmem.worldmodel') }}",
            vec!["unknown function `find`", "did you mean `query`?", "aggregate, count"],
        ),
        ("{{ qurey('robmem.worldmodel') }}", vec!["unknown function `qurey`", "did you mean `query`?"]),
        ("{% macro block(x) %}{% endmacro %}{{ blok(1) }}", vec!["unknown function `blok`", "did you mean `block`?"]),
        ("{{ len('abc') }}", vec!["unknown function `len`", "`length` is a filter: write {{ value|length }}"]),
        ("{{ 'a'|uper }}", vec!["unknown filter `uper`", "did you mean `upper`?", "there are the filters abs, "]),
        ("{% if 1 is defind %}{% endif %}", vec!["unknown test `defind`", "did you mean `defined`?"]),
        ("{{ [1].count() }}", vec!["how many there are is a filter: write {{ boxes|length }}"]),
        ("{{ [1].push(2) }}", vec!["documents have the methods get, keys, values, items"]),
        (
            "{% for d in query('robmem.worldmodel', fields={'a': 1}) %}{% endfor %}",
            vec![
                "unknown keyword argument `fields`, did you mean `projection`?",
                "query(ns, filter, sort=, projection=, ",
            ],
        ),
        ("{{ count('robmem.worldmodel', limit=1) }}", vec!["unknown keyword argument `limit`", "count(ns, filter)"]),
        ("{{ count('robmem.worldmodel', {}, 3) }}", vec!["expected count(ns, filter)"]),
        ("{{ count('robmem.worldmodel', ns='a.b') }}", vec!["unknown keyword argument 'ns'"]),
        (
            "{{ count(\"db.orders.find({})\") }}",
            vec!["is not a namespace: it has a `(`", "hint: write: query(\"robmem.orders\")"],
        ),
    ] {
        let error = complaint(template, blocks());
        assert!(words.iter().all(|word| error.contains(word)), "{template}: {error}");
    }
    for (body, words) in [
        (
            "{% if d.carries %}x{% endif %}",
            vec![
                "`d.carries` is undefined",
                "_id 4 of robmem.worldmodel",
                "it has the keys _id, relation, object",
                "{% if d.carries is defined %}, or d.get(\"carries\")",
            ],
        ),
        ("{{ d.objekt }}", vec!["t:1:54: `d.objekt` is undefined", "did you mean `object`?"]),
        ("{{ d['at-home'] }}", vec!["is undefined", "{% if d[\"at-home\"] is defined %}, or d.get(\"at-home\")"]),
    ] {
        let error = complaint(&format!("{holding}{body}{{% endfor %}}"), blocks());
        assert!(words.iter().all(|word| error.contains(word)), "{body}: {error}");
    }
    let nothing = complaint("{{ nothing }}", blocks());
    assert!(!nothing.contains("the keys"), "{nothing}");
}

#[test]
fn documents_have_the_methods_of_dictionaries_and_queries_a_length() {
    let mut documents = blocks();
    documents.push(doc! { "_id": 5, "at": "T", "odd key": "K", "items": "I", "caps-on-shelf": 3, "pose": { "x": 7 } });
    let odd = "{% for r in query('robmem.worldmodel', {'_id': 5}) %}";
    for (template, wanted) in [
        ("{{ query('robmem.worldmodel')|length }}", "5"),
        ("{% if query('robmem.worldmodel', skip=1, limit=2)|length == 2 %}two{% endif %}", "two"),
        ("{% if aggregate('robmem.worldmodel', '[{$limit: 3}]')|length == 3 %}three{% endif %}", "three"),
        ("{% for d in query('robmem.worldmodel') %}{% if d.get('top') %}{{ d.top }}{% endif %}{% endfor %}", "D"),
        (
            &format!("{odd}{{{{ r['at'] }}}}{{{{ r[\"odd key\"] }}}}{{{{ r.items }}}}{{{{ r.at }}}}{{% endfor %}}"),
            "TKIT",
        ),
        (
            &format!(
                "{odd}{{{{ r['caps-on-shelf'] }}}} {{{{ r.pose.get('x') }}}} {{{{ r.get('y', 'N') }}}}{{% endfor %}}"
            ),
            "3 7 N",
        ),
        (&format!("{odd}{{% if r.get('gone') is none %}}none{{% endif %}}{{% endfor %}}"), "none"),
        (&format!("{odd}{{% if 'pose' in r.keys() and 'I' in r.values() %}}yes{{% endif %}}{{% endfor %}}"), "yes"),
        ("{% for k, v in {'a': 'b'}.items() %}{{ k }}{{ v }}{% endfor %}{{ {'a': 'c'}.values()[0] }}", "abc"),
    ] {
        assert_eq!(text(template, documents.clone()), wanted, "{template}");
    }
}

#[test]
fn a_section_is_counted_once_with_each_of_its_documents_once() {
    let low = "query('robmem.worldmodel', {'relation': 'on-table'})";
    let twice = format!(
        "{{% set b = {low} %}}{{% if b %}}{{% for d in b %}}{{{{ d.object }}}}{{% endfor %}}{{% for d in b %}}{{{{ d.object }}}}\
         {{% endfor %}}{{{{ b|length }}}}{{% endif %}}"
    );
    let within =
        format!("{{% for x in [1, 2, 3] %}}{{% for d in {low} %}}{{{{ d.object }}}} {{% endfor %}}{{% endfor %}}");
    for template in [twice, within] {
        let sections = made(&template, blocks()).sections;
        assert_eq!(sections.iter().map(|section| section.matched).collect::<Vec<_>>(), [2], "{template}");
    }
}

#[test]
fn a_value_cannot_inject_syntax() {
    let evil = || vec![doc! { "_id": 1, "x": "A) (on B", "y": "; gone", "z": "\u{e9} \"" }];
    for template in [
        "(p <<#A|{}>><<x>> <<y>> <<z>><</A>>)",
        "(p {% for d in query('robmem.worldmodel') %}{{ d.x }} {{ d.y }} {{ d.z }}{% endfor %})",
        "(p {% for d in query('robmem.worldmodel') %}{{ [d.x, d.y]|join('') }} {{ d.y|upper }} {{ d.z|replace('a', 'b') }}{% endfor %})",
    ] {
        let problem = text(template, evil());
        assert_eq!(problem.matches(['(', ')', ';', '"']).count(), 2, "{problem}");
        assert_eq!(problem.split_whitespace().count(), 4, "{problem}");
    }
}

#[test]
fn names_that_pddl_cannot_tell_apart_are_refused_with_both_documents() {
    let two = vec![doc! { "_id": 1, "x": "Box" }, doc! { "_id": 2, "x": "box" }];
    let error = complaint("{% for d in query('robmem.worldmodel') %}\n({{ d.x }}){% endfor %}", two);
    assert!(error.starts_with("t:2:2: `Box` and `box` are one name"), "{error}");
    assert!(error.contains("`Box` comes from document _id 1 of robmem.worldmodel at 2:2"), "{error}");
    assert!(error.contains("`box` comes from document _id 2"), "{error}");
}

/// A store that records its queries: pipelines come back as documents, finds
/// give numbered documents without end, and `broken` fails.
#[derive(Default, Clone)]
struct Talkative {
    given: Arc<AtomicUsize>,
}

impl Store for Talkative {
    fn find(&self, ns: &Namespace, _: &Find) -> Result<Documents<'_>, StoreError> {
        // No computables are kept here.
        if ns.collection.starts_with("rmem.") {
            return Ok(Box::new(std::iter::empty()));
        }
        let broken = ns.collection == "broken";
        Ok(Box::new((0..).map(move |number: i32| {
            if broken && number == 2 {
                return Err(StoreError::Failed { address: "here".to_owned(), reason: "disk full".to_owned() });
            }
            self.given.fetch_add(1, Ordering::Relaxed);
            Ok(RawDocumentBuf::try_from(&doc! { "_id": number, "x": format!("n{number}") }).expect("BSON"))
        })))
    }

    fn aggregate(&self, _: &Namespace, pipeline: Aggregation<'_>) -> Result<Documents<'_>, StoreError> {
        let documents = pipeline.stages.iter().map(|stage| RawDocumentBuf::try_from(stage).expect("BSON"));
        Ok(Box::new(documents.collect::<Vec<_>>().into_iter().map(Ok)))
    }

    fn count(&self, _: &Namespace, _: Query<'_>) -> Result<u64, StoreError> {
        Err(StoreError::Unreachable { address: "there".to_owned(), reason: "no answer".to_owned(), may_be_done: false })
    }

    fn collections(&self) -> Result<Vec<Namespace>, StoreError> {
        Ok(Vec::new())
    }

    fn explain(&self, _: &Namespace, _: &Find) -> Result<Document, StoreError> {
        unreachable!()
    }

    fn create_index(&self, _: &Namespace, _: &Index) -> Result<bool, StoreError> {
        unreachable!()
    }

    fn modify_index(&self, _: &Namespace, _: &str, _: IndexChange) -> Result<bool, StoreError> {
        unreachable!()
    }

    fn drop_index(&self, _: &Namespace, _: &str) -> Result<bool, StoreError> {
        unreachable!()
    }

    fn indexes(&self, _: &Namespace) -> Result<Vec<Index>, StoreError> {
        unreachable!()
    }

    fn describe(&self) -> String {
        "talkative".to_owned()
    }

    fn insert(&self, _: &Namespace, _: Vec<Document>) -> Result<Inserted, StoreError> {
        unreachable!("templates only read")
    }

    fn values(&self, _: &Namespace, _: &str, _: Query<'_>) -> Result<Values, StoreError> {
        unreachable!("not asked here")
    }

    fn update(&self, _: &Namespace, _: &UpdateRequest, _: Option<DateTime>) -> Result<Updated, StoreError> {
        unreachable!("templates only read")
    }

    fn find_and_modify(&self, _: &Namespace, _: &FindAndModify, _: Option<DateTime>) -> Result<Modified, StoreError> {
        unreachable!("templates only read")
    }

    fn put(&self, _: &Namespace, _: Vec<Document>, _: Option<DateTime>) -> Result<Put, StoreError> {
        unreachable!("templates only read")
    }

    fn delete(&self, _: &Namespace, _: Query<'_>, _: bool) -> Result<u64, StoreError> {
        unreachable!("templates only read")
    }

    fn create(&self, _: &Namespace, _: Option<&Collation>) -> Result<bool, StoreError> {
        unreachable!("templates only read")
    }

    fn drop(&self, _: &Namespace) -> Result<bool, StoreError> {
        unreachable!("templates only read")
    }

    fn rename(&self, _: &Namespace, _: &Namespace, _: bool) -> Result<(), StoreError> {
        unreachable!("templates only read")
    }

    fn watch(&self, _: &Namespace, _: Option<&str>) -> Result<Box<dyn rmem::store::Changes + '_>, StoreError> {
        unreachable!("templates only read")
    }

    fn forget(&self, _: &Namespace, _: &str) -> Result<bool, StoreError> {
        unreachable!("templates only read")
    }

    fn names(&self) -> Result<Vec<Name>, StoreError> {
        unreachable!("templates only read")
    }
}

fn asked(template: &str, store: &Talkative) -> Result<Generated, ProblemError> {
    generate(&request(template), &Memory::new(Box::new(store.clone()), None, Vec::new()))
}

#[test]
fn pipelines_reach_the_store_stage_by_stage() {
    for template in [
        "<<#A||[{$match: {x: {$in: ['b', '|']}}},\n {$limit: 3}]>>s;<</A>>".to_owned(),
        "{% for d in aggregate('a.b', [{'$match': {}}, {'$limit': 3}]) %}s;{% endfor %}".to_owned(),
        "{% for d in aggregate('a.b', '[{$match: {}}, {$limit: 3}]') %}s;{% endfor %}".to_owned(),
        // The memory puts a stage in front: for documents that have not decayed.
        "{% for d in aggregate('a.b', '{$limit: 3}') %}s;{% endfor %}".to_owned(),
    ] {
        let generated = asked(&template, &Talkative::default()).unwrap_or_else(|error| panic!("{template}: {error}"));
        assert_eq!(generated.text, "s;s;", "{template}");
    }
}

#[test]
fn a_query_is_only_followed_as_far_as_the_template_looks() {
    let store = Talkative::default();
    let generated = asked("{{ find_one('a.b').x }} {% if query('a.b') %}some{% endif %}", &store).expect("a problem");
    assert_eq!(generated.text, "n0 some");
    assert!(store.given.load(Ordering::Relaxed) <= 1024, "{}", store.given.load(Ordering::Relaxed));
}

#[test]
fn a_store_that_fails_is_told_from_a_bad_template() {
    for template in ["\n {{ count('a.b') }}", "\n {% for d in query('a.broken') %}{{ d.x }}{% endfor %}"] {
        match asked(template, &Talkative::default()) {
            Err(ProblemError::Store { place, .. }) => assert!(place.starts_with("t:2:"), "{place}"),
            other => panic!("{template}: {other:?}"),
        }
    }
    let request = Request { collection: Namespace::parse("a.broken").unwrap(), ..request("<<#A|{}>><<x>><</A>>") };
    let memory = Memory::new(Box::new(Talkative::default()), None, Vec::new());
    assert!(matches!(generate(&request, &memory), Err(ProblemError::Store { place, .. }) if place == "t:1:6"));
}

#[test]
fn sections_say_how_many_documents_they_matched() {
    let sections = |template: &str| -> Vec<(String, u64, usize)> {
        made(template, blocks()).sections.into_iter().map(|s| (s.name, s.matched, s.line)).collect()
    };
    assert_eq!(
        sections("<<#T|{relation: 'on-table'}>><</T>>\n<<#N|{relation: 'none'}>><</N>><<#T>><</T>>"),
        [("T".to_owned(), 2, 1), ("N".to_owned(), 0, 2)]
    );
    let template = "{% if count('robmem.worldmodel', {'relation': 'none'}) == 0 %}{% endif %}\n\
        {% for d in query('robmem.worldmodel', {'relation': 'on-table'}) %}\n\
        {% for e in query('robmem.worldmodel', {'object': d.object}) %}{% endfor %}{% endfor %}";
    assert_eq!(
        sections(template),
        [
            ("query('robmem.worldmodel', {'relation': 'on-table'})".to_owned(), 2, 2),
            ("query('robmem.worldmodel', {'object': d.object})".to_owned(), 2, 3)
        ]
    );
}

#[test]
fn what_is_wrong_in_the_goal_is_said_of_its_marker() {
    let domain = "(define (domain d) (:requirements :strips) (:predicates (on-table ?x) (on ?x ?y)))";
    let domain = Domain::read(&Source::new("d", domain), Dialect::default()).expect("a domain");
    let head = "(define (problem p) (:domain d)\n(:objects A C)\n";
    for template in [
        format!(
            "{head}(:init {{% for d in query('robmem.worldmodel', {{'relation': 'on-table'}}) %}}(on-table {{{{ d.object }}}}){{% endfor %}})\n(:goal {{{{ goal }}}}))"
        ),
        format!("{head}(:init <<#T|{{relation: 'on-table'}}>>(on-table <<object>>)<</T>>)\n(:goal <<GOAL>>))"),
    ] {
        for documents in [blocks(), Vec::new()] {
            let request = Request { goal: Some("(on A Z)".to_owned()), ..request(&template) };
            let generated = generate(&request, &memory(documents)).unwrap_or_else(|error| panic!("{error}"));
            let errors = generated.check(&domain, Dialect::default()).expect_err("Z is not an object");
            let errors: Vec<String> = errors.iter().map(ToString::to_string).collect();
            assert_eq!(errors.len(), 1, "{errors:?}");
            assert!(errors[0].starts_with("t:4:8: "), "{}", errors[0]);
            assert!(errors[0].contains("hint: the goal is (on A Z)"), "{}", errors[0]);
        }
    }
}

#[test]
fn text_of_a_section_leads_back_to_its_place_for_every_document() {
    let generated = made("(:init\n<<#T|{relation: 'on-table'}>>(on <<object>> B) (x <<object>>)\n<</T>>)", blocks());
    let places = |part: &str| -> Vec<_> {
        let found = generated.text.match_indices(part);
        found
            .map(|(offset, _)| generated.locate(offset))
            .map(|at| (at.line, at.column, at.document.map(|found| found.1)))
            .collect()
    };
    let id = |id| Some(Bson::Int32(id));
    assert_eq!(places("on "), [(2, 31, id(1)), (2, 31, id(2))]);
    assert_eq!(places("B)"), [(2, 45, id(1)), (2, 45, id(2))]);
    assert_eq!(places("x "), [(2, 49, id(1)), (2, 49, id(2))]);
}

#[test]
fn chains_that_would_exhaust_the_stack_are_refused_and_shorter_ones_are_read() {
    for (start, link, end) in [
        ("{{ 1", "+1", " }}"),
        ("{{ ", "-", "1 }}"),
        ("{{ ", "not ", "1 }}"),
        ("{{ a", ".a", " }}"),
        ("{{ a", "[0]", " }}"),
        ("{{ 1", "|int", " }}"),
        ("{{ 'a'", "~'b'", " }}"),
        ("{{ 1", "**1", " }}"),
        ("{{ 1", " and 1", " }}"),
        ("{{ 1", " if 1 else 1", " }}"),
        ("{{ a", "()", " }}"),
        ("{% if 0 %}", "{% elif 0 %}", "{% endif %}"),
    ] {
        let template = |count| format!("{start}{}{end}", link.repeat(count));
        let error = complaint(&template(20_000), Vec::new());
        assert!(error.contains("more than"), "{link}: {error}");
        // It may be an error of the value, but it comes back.
        let _ = generate(&request(&template(490)), &memory(Vec::new()));
    }
}

#[test]
fn a_query_that_holds_its_own_end_is_explained() {
    let error = complaint("<<#T|{a: '>>'}>><</T>>", Vec::new());
    assert!(error.starts_with("t:1:10: the string has no end"), "{error}");
    assert!(error.contains("a query ends at the first `>>`"), "{error}");
    assert_eq!(text("<<#T|{a: '\\u003e\\u003e'}>>x<</T>>", vec![doc! { "a": ">>" }]), "x");
}

#[test]
fn parameters_cannot_take_the_place_of_the_goal_or_a_function() {
    for (template, name) in [("{{ count('a.b') }}", "count"), ("{{ goal }}", "goal"), ("<<GOAL>>", "GOAL")] {
        let parameters = vec![(name.to_owned(), Bson::from("x"))];
        let error = generate(&Request { parameters, ..request(template) }, &memory(Vec::new())).expect_err(name);
        assert!(error.to_string().contains(&format!("a parameter cannot be called `{name}`")), "{error}");
    }
}

#[test]
fn a_place_of_the_problem_leads_back_to_template_and_document() {
    for template in [
        "(:init\n{% for d in query('robmem.worldmodel', {'relation': 'on-table'}) %}\n  (onn {{ d.object }})\n{% endfor %})",
        "(:init\n<<#T|{relation: 'on-table'}>>\n  (onn <<object>>)\n<</T>>)",
    ] {
        let generated = made(template, blocks());
        let offset = generated.text.rfind("onn").expect("the atom");
        let origin = generated.locate(offset);
        assert_eq!((origin.line, origin.column), (3, 4), "{template}");
        let value = generated.locate(generated.text.rfind('C').expect("the name"));
        assert_eq!(
            (value.line, value.column, value.document),
            (3, 8, Some((namespace(), Bson::Int32(2)))),
            "{template}"
        );
        assert_eq!(generated.locate(3).line, 1);
        assert_eq!(generated.locate(generated.text.len() - 1).line, 4);
        let complaint = Diagnostic::new(&generated.source(), Span::new(offset, offset + 3), "no predicate `onn`");
        let explained = generated.explain(vec![complaint]).pop().expect("one").to_string();
        assert!(explained.starts_with("t:3:4: no predicate `onn`"), "{explained}");
        assert!(explained.contains("from document _id 2 of robmem.worldmodel"), "{explained}");
        assert!(explained.contains(": (onn C)"), "{explained}");
        for offset in 0..generated.text.len() + 3 {
            let _ = generated.locate(offset);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(40) })]

    #[test]
    fn every_text_in_a_document_is_one_token_that_is_restored(value in any::<String>()) {
        let memory = memory(vec![doc! { "x": &value }]);
        for template in ["(p <<#A|{}>><<x>><</A>>)", "(p {% for d in query('robmem.worldmodel') %}{{ d.x }}{% endfor %})"] {
            let problem = generate(&request(template), &memory).map_err(|error| TestCaseError::fail(error.to_string()))?.text;
            let name = problem.strip_prefix("(p ").and_then(|rest| rest.strip_suffix(')')).unwrap_or_default();
            prop_assert!(names::is_legal(name));
            prop_assert_eq!(names::restore(name), value.as_str());
        }
    }

    #[test]
    fn no_template_makes_it_panic(template in r#"([ab.( )'|{}%<>#/-]|\{\{|\}\}|\{%|%\}|query|set|if|endif|for|in|endfor|raw|<<#A\|)*"#) {
        let memory = memory(Vec::new());
        for syntax in [Syntax::Auto, Syntax::Minijinja, Syntax::Marker] {
            let _ = generate(&Request { syntax, ..request(&template) }, &memory);
        }
    }
}
