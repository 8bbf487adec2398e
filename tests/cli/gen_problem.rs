//! gen-problem: both syntaxes, sections, names, checks, files.

use crate::lab::{Lab, TASK, assert_run};

/// The example of the robot memory's first description: sections ONTABLE, ON and HOLDING.
const MARKER: &str = "\
(define (problem blocks_world_generated)
  (:domain blocksworld)
  (:objects A B C D)
  (:goal <<GOAL>>)
  (:init
    <<#ONTABLE|{relation:'on-table'}>>
      (on-table <<object>>) <</ONTABLE>>
    <<#ON|{relation:'on'}>>
      (on <<object_top>> <<object_bottom>>)
    <</ON>>
    <<#HOLDING|{relation:'holding'}>>
      (holding <<object>>) <</HOLDING>>
  ))
";

const WORLD: &str = "{'robmem.worldmodel': [
  {relation: 'on-table', object: 'A'},
  {relation: 'on-table', object: 'C'},
  {relation: 'on', object_top: 'D', object_bottom: 'A'},
  {relation: 'holding', object: 'B'},
]}";

fn lab() -> Lab {
    let lab = Lab::new();
    lab.write("problem.tmpl", MARKER);
    lab.write("world.json", WORLD);
    lab
}

/// The words of a text, one blank apart.
fn words(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[test]
fn the_first_example_comes_out() {
    let run = lab().rmem(&[
        "gen-problem",
        "--memory",
        "mem:",
        "--load",
        "world.json",
        "--template",
        "problem.tmpl",
        "--goal",
        "(on A B)",
    ]);
    assert_run!(run, @r"
    (define (problem blocks_world_generated)
      (:domain blocksworld)
      (:objects A B C D)
      (:goal (on A B))
      (:init
        
          (on-table A) 
          (on-table C) 
        
          (on D A)
        
        
          (holding B) 
      ))
    ------- stderr -------
    [exit code: 0]
    ");
}

#[test]
fn quiet_leaves_out_the_sections_and_their_counts() {
    let args = ["gen-problem", "--memory", "mem:", "--load", "world.json", "-t", "problem.tmpl", "--goal", "(on A B)"];
    let (loud, quiet) = (lab().rmem(&args).exits(0), lab().rmem(&[&args[..], &["-q"]].concat()).exits(0));
    assert_eq!(quiet.stdout, loud.stdout);
    assert_eq!(quiet.stderr, "");
    assert_eq!(loud.stderr, "", "counts are printed under -v");
    let verbose = lab().rmem(&[&args[..], &["-v"]].concat()).exits(0);
    assert_eq!(verbose.stderr.lines().filter(|line| line.starts_with("line ")).count(), 3, "{verbose}");
}

#[test]
fn a_section_that_matches_nothing_is_a_warning_or_under_strict_an_error() {
    let lab = lab();
    let args = ["gen-problem", "--memory", "mem:", "-t", "problem.tmpl", "--goal", "(on A B)"];
    assert_run!(lab.rmem(&args), @r"
    (define (problem blocks_world_generated)
      (:domain blocksworld)
      (:objects A B C D)
      (:goal (on A B))
      (:init
        
        
        
      ))
    ------- stderr -------
    warning: line 6: ONTABLE in robmem.worldmodel: 0 documents
      no collection robmem.worldmodel; the memory is empty
    warning: line 8: ON in robmem.worldmodel: 0 documents
    warning: line 11: HOLDING in robmem.worldmodel: 0 documents
    [exit code: 0]
    ");
    assert_run!(lab.rmem(&[&args[..], &["--strict", "-o", "p.pddl"]].concat()), @r"
    ------- stderr -------
    warning: line 6: ONTABLE in robmem.worldmodel: 0 documents
      no collection robmem.worldmodel; the memory is empty
    warning: line 8: ON in robmem.worldmodel: 0 documents
    warning: line 11: HOLDING in robmem.worldmodel: 0 documents
    error: problem.tmpl:6:5: no document of robmem.worldmodel matches this section
      |
    6 |     <<#ONTABLE|{relation:'on-table'}>>
      |     ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    error: problem.tmpl:8:5: no document of robmem.worldmodel matches this section
      |
    8 |     <<#ON|{relation:'on'}>>
      |     ^^^^^^^^^^^^^^^^^^^^^^^
    error: problem.tmpl:11:5: no document of robmem.worldmodel matches this section
       |
    11 |     <<#HOLDING|{relation:'holding'}>>
       |     ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    ");
    assert!(!lab.path().join("p.pddl").exists());
}

#[test]
fn the_collection_is_what_marker_sections_query() {
    let lab = lab();
    lab.write("other.json", "{'lab.other': [{relation: 'on-table', object: 'Z'}]}");
    let text = lab
        .rmem(&[
            "gen-problem",
            "--memory",
            "mem:",
            "--load",
            "other.json",
            "--collection",
            "lab.other",
            "-t",
            "problem.tmpl",
            "--goal",
            "(on A B)",
        ])
        .success();
    assert!(text.contains("(on-table Z)"), "{text}");
}

#[test]
fn a_value_cannot_inject_syntax() {
    let lab = lab();
    lab.write("evil.json", r#"{"robmem.worldmodel": [{"relation": "on-table", "object": "A) (on B"}]}"#);
    let text = lab
        .rmem(&["gen-problem", "--memory", "mem:", "--load", "evil.json", "-t", "problem.tmpl", "--goal", "(on A B)"])
        .success();
    assert_eq!(text.matches("(on-table").count(), 1, "{text}");
    assert!(!text.contains("(on B"), "{text}");
}

#[test]
fn the_same_memory_gives_the_same_bytes() {
    let lab = Lab::new();
    let args = [
        "gen-problem",
        "--memory",
        "mem:",
        "--load",
        "fixtures/rcll.json",
        "--template",
        "templates/rcll/problem.pddl.j2",
        "--domain",
        "domains/rcll/domain.pddl",
    ];
    assert_eq!(lab.rmem(&args).success(), lab.rmem(&args).success());
}

#[test]
fn mistakes_are_shown_at_the_templates_line() {
    let lab = lab();
    lab.write("broken.tmpl", "(define (problem x)\n  <<#ON|{relation:'on'}>>\n  (on <<object_top>>)\n");
    assert_run!(lab.rmem(&["gen-problem", "--memory", "mem:", "-t", "broken.tmpl"]), @r"
    ------- stderr -------
    error: broken.tmpl:2:3: section `ON` has no end
      |
    2 |   <<#ON|{relation:'on'}>>
      |   ^^^^^^^^^^^^^^^^^^^^^^^
      = hint: write `<</ON>>` where it ends
    [exit code: 3]
    ");
    lab.write("key.tmpl", "<<#ON|{relation:'on'}>>\n  (on <<objekt_top>>)\n<</ON>>\n");
    let args = ["gen-problem", "--memory", "mem:", "--load", "identified.json", "-t", "key.tmpl"];
    lab.write(
        "identified.json",
        "{'robmem.worldmodel': [{_id: 7, relation: 'on', object_top: 'D', object_bottom: 'A'}]}",
    );
    assert_run!(lab.rmem(&args), @r"
    ------- stderr -------
    error: key.tmpl:2:7: the document has no key `objekt_top`
      |
    2 |   (on <<objekt_top>>)
      |       ^^^^^^^^^^^^^^
      = hint: from document _id 7 of robmem.worldmodel
      = hint: --lenient leaves it empty, as Fawkes does
    [exit code: 3]
    ");
    lab.write("unknown.j2", "(define (problem x)\n  (:goal {{ gaol }}))\n");
    assert_run!(lab.rmem(&["gen-problem", "--memory", "mem:", "-t", "unknown.j2"]), @r"
    ------- stderr -------
    error: unknown.j2:2:10: `gaol` is undefined
      |
    2 |   (:goal {{ gaol }}))
      |          ^^^^^^^^^^
    [exit code: 3]
    ");
    lab.write("query.j2", "{% for d in query('robmem.x', {'a': {'$nosuch': 1}}) %}{% endfor %}\n");
    assert_run!(lab.rmem(&["gen-problem", "--memory", "mem:", "-t", "query.j2"]), @r"
    ------- stderr -------
    error: query.j2:1:13: unknown operator: $nosuch
      |
    1 | {% for d in query('robmem.x', {'a': {'$nosuch': 1}}) %}{% endfor %}
      |             ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    ");
}

#[test]
fn a_filter_that_would_make_more_than_any_memory_holds_is_refused() {
    let (lab, mut refusals) = (Lab::new(), String::new());
    for expression in [
        "'%0999999999d'|format(1)",
        "'%d %.100001f'|format(1, 1.5)",
        "'a\\nb'|indent(999999999)",
        "[1]|batch(999999999, 0)",
        "[1]|slice(999999999)",
        "('a' * 99999)|replace('a', 'b' * 99999)",
    ] {
        lab.write("t.j2", &format!("{{{{ {expression} }}}}\n"));
        let refused = lab.rmem(&["gen-problem", "--memory", "mem:", "-t", "t.j2"]).exits(3);
        refusals += refused.stderr.lines().next().unwrap_or_default();
        refusals += "\n";
    }
    insta::assert_snapshot!(refusals, @r"
    error: t.j2:1:19: 0999999999 is too large; expected at most 100000
    error: t.j2:1:19: 100001 is too large; expected at most 100000
    error: t.j2:1:11: 999999999 is too large; expected at most 100000
    error: t.j2:1:8: 999999999 is too large; expected at most 100000
    error: t.j2:1:8: 999999999 is too large; expected at most 100000
    error: t.j2:1:18: the replaced text would have 9999800001 bytes; expected at most 67108864
    ");
    lab.write("t.j2", "{{ '%05.1f'|format(1.25)|replace('.', '-')|indent(2) }} {{ [1, 2]|batch(2)|list|length }}\n");
    assert_run!(lab.rmem(&["gen-problem", "--memory", "mem:", "-t", "t.j2"]), @r"
    x--001_2d2--x 1
    ------- stderr -------
    [exit code: 0]
    ");
}

#[test]
fn a_template_that_is_too_long_for_its_parser_is_refused_before_a_goal_is_looked_for_in_it() {
    let lab = Lab::new();
    for (template, wanted) in [
        (format!("{{{{ {}1 }}}}", "-".repeat(20_000)), "an expression has more than 1000 operators"),
        (
            format!("{{% if a %}}{}{{% endif %}}", "{% elif b %}".repeat(10_000)),
            "more than 500 `elif` in one condition",
        ),
        ("{% if a %}".repeat(200_000), "more than 150 blocks are open here"),
    ] {
        lab.write("t.j2", &template);
        let refused = lab.rmem(&["gen-problem", "--memory", "mem:", "-t", "t.j2", "--goal", "(a)"]).exits(3);
        assert!(refused.stderr.contains(wanted), "{refused}");
    }
}

#[test]
fn an_operator_or_a_block_that_would_make_more_than_any_memory_holds_is_refused() {
    let lab = Lab::new();
    let doubled = |change: &str| {
        format!("{{% set ns = namespace(x='aaaaaaaa', l=[1]) %}}{{% for i in range(60) %}}{change}{{% endfor %}}")
    };
    let mut refusals = String::new();
    for template in [
        doubled("{% set ns.x = ns.x ~ ns.x %}"),
        doubled("{% set ns.x = ns.x + ns.x %}"),
        doubled("{% set ns.l = ns.l + ns.l %}") + "{{ ns.l|list|length }}",
        doubled("{% set ns.l = [ns.l, ns.l] %}") + "{{ (ns.l ~ '')|length }}",
        doubled("{% set ns.x %}{{ ns.x }}{{ ns.x }}{% endset %}"),
        "{{ ('a' * 5000000)|list|length }}".to_owned(),
    ] {
        lab.write("t.j2", &template);
        let refused = lab.rmem(&["gen-problem", "--memory", "mem:", "-t", "t.j2"]).exits(3);
        refusals += refused.stderr.lines().next().unwrap_or_default();
        refusals += "\n";
    }
    insta::assert_snapshot!(refusals, @r"
    error: t.j2:1:88: a text of 134217728 bytes is too long for an operator; expected at most 67108864
    error: t.j2:1:88: a text of 134217728 bytes is too long for an operator; expected at most 67108864
    error: t.j2:1:88: a list of 4194304 elements is too long; expected at most 4000000
    error: t.j2:1:111: a list or map is too long to be written as text; expected at most 4194304 bytes
    error: t.j2:1:84: the template writes more than 512 MiB of text
    error: t.j2:1:20: a list of 5000000 elements is too long; expected at most 4000000
    ");
    lab.write(
        "t.j2",
        "{% set a = 'x' %}{{ a ~ ([a] + ['y'])|length }} {{ ([a] + ['z'])|join('_') ~ a|lower }} {{ 1 + a|length }}\n",
    );
    assert_eq!(lab.rmem(&["gen-problem", "--memory", "mem:", "-t", "t.j2"]).success(), "x2 x_zx 2\n");
}

#[test]
fn the_mark_of_a_templates_byte_order_is_not_in_its_problem() {
    let lab = Lab::new();
    lab.write("t.j2", "\u{feff}{% include 'part.j2' %}(b)\n");
    lab.write("part.j2", "\u{feff}(a)");
    lab.write("t.tmpl", "\u{feff}(a)(b)\n");
    for template in ["t.j2", "t.tmpl"] {
        let problem = lab.rmem(&["gen-problem", "--memory", "mem:", "-t", template]).success();
        assert_eq!(problem, "(a)(b)\n", "{template}");
    }
}

#[test]
fn the_check_against_a_domain_names_template_line_and_document() {
    let lab = lab();
    lab.write("typo.tmpl", &MARKER.replace("(on-table <<object>>)", "(on-tabel <<object>>)"));
    let (load, domain) = (["--load", "world.json"], ["--domain", "domains/blocksworld/domain.pddl"]);
    let args = ["gen-problem", "--memory", "mem:", "-t", "typo.tmpl", "--goal", "(on A B)", "-o", "p.pddl"];
    assert_run!(lab.rmem(&[&args[..], &load, &domain].concat()), @r"
    ------- stderr -------
    error: typo.tmpl:7:8: predicate `on-tabel` is not declared
      |
    7 |       (on-tabel <<object>>) <</ONTABLE>>
      |        ^^^^^^^^
      = hint: did you mean `on-table`?
      = hint: it became line 7 of the problem: (on-tabel A)
      = hint: from document _id [ID] of robmem.worldmodel
      = hint: and from 1 more place
    [exit code: 3]
    ");
    assert!(!lab.path().join("p.pddl").exists());
}

#[test]
fn parameters_are_text_or_typed() {
    let lab = Lab::new();
    lab.write("p.j2", "{{ robot }} {{ n + 1 }} {{ param('speed', 2) }}");
    let text = lab.rmem(&["gen-problem", "--memory", "mem:", "-t", "p.j2", "-D", "robot=R1", "-D", "n:=41"]).success();
    assert_eq!(text.trim(), "R1 42 2");
}

#[test]
fn the_example_worlds_give_the_problems_on_record() {
    let lab = Lab::new();
    for (world, goal) in [("blocksworld", Some("(and (on A B) (on B C))")), ("rcll", None), ("tidyup", None)] {
        let load = format!("fixtures/{world}.json");
        let (template, domain) = (format!("templates/{world}/problem.pddl.j2"), format!("domains/{world}/domain.pddl"));
        let mut args =
            vec!["gen-problem", "--memory", "mem:", "--load", &load, "--template", &template, "--domain", &domain];
        args.extend(goal.map(|goal| ["--goal", goal]).into_iter().flatten());
        let problem = lab.rmem(&args).success();
        insta::assert_snapshot!(format!("problem_{world}"), problem);
    }
}

#[test]
fn both_spellings_give_one_problem() {
    let lab = Lab::new();
    let problem = |template: &str| {
        let args = [
            "gen-problem",
            "--memory",
            "mem:",
            "--load",
            "fixtures/blocksworld.json",
            "--template",
            template,
            "--goal",
            "(on A B)",
            "--domain",
            "domains/blocksworld/domain.pddl",
        ];
        let text = lab.rmem(&args).success();
        let mut atoms: Vec<Vec<String>> = text
            .split('(')
            .map(|atom| {
                let mut words: Vec<String> =
                    words(atom).trim_end_matches([')', ' ']).split(' ').map(str::to_owned).collect();
                if words[0] == ":objects" {
                    // Objects are a set: each spelling lists them in the order in which it asks for them.
                    words.sort();
                }
                words
            })
            .collect();
        atoms.sort();
        atoms
    };
    assert_eq!(problem("templates/blocksworld/problem.pddl.j2"), problem("templates/blocksworld/problem.pddl.tmpl"));
}

const BLOCKS: [&str; 7] =
    ["gen-problem", "-q", "--load", "fixtures/blocksworld.json", "--goal", "(and (on A B) (clear D))", "--template"];

#[test]
fn an_atom_is_explained_by_its_template_line_its_query_and_its_document() {
    let lab = Lab::new();
    let explain = |template: &str, atom: &str| lab.rmem(&[&BLOCKS[..], &[template, "--explain", atom]].concat());
    let template = "templates/blocksworld/problem.pddl.j2";
    assert_run!(explain(template, "(ON d a)"), @r#"
    (on D A): in the initial state, line 9 of the problem
      templates/blocksworld/problem.pddl.j2:15:5: (on {{ fact.object_top }} {{ fact.object_bottom }})
      line 14: query(world, "{relation: 'on'}", sort="{object_top: 1}") asks {"relation":"on"} in robmem.worldmodel: 1 document
      {"_id":{"$oid":"[ID]"},"relation":"on","object_top":"D","object_bottom":"A"} in robmem.worldmodel
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(explain(template, "(clear D)"), @r#"
    (clear D): in the initial state, line 11 of the problem
      templates/blocksworld/problem.pddl.j2:18:5: (clear {{ fact.object }})
      line 17: query(world, "{relation: 'clear'}", sort="{object: 1}") asks {"relation":"clear"} in robmem.worldmodel: 2 documents
      {"_id":{"$oid":"[ID]"},"relation":"clear","object":"D"} in robmem.worldmodel
    (clear D): in the goal, line 15 of the problem
      templates/blocksworld/problem.pddl.j2:29:10: (:goal {{ goal }})
      line 8: distinct(world, "object_top", "{relation: 'on'}") asks {"distinct":"object_top","query":{"relation":"on"}} in robmem.worldmodel: 1 document
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(explain(template, "C"), @r#"
    C: an object, line 4 of the problem
      templates/blocksworld/problem.pddl.j2:7:97: {%- for block in distinct(world, "object", "{relation: {$in: ['on-table', 'holding']}}") %} {{ block }}{% endfor %}
      line 7: distinct(world, "object", "{relation: {$in: ['on-table', 'holding']}}") asks {"distinct":"object","query":{"relation":{"$in":["on-table","holding"]}}} in robmem.worldmodel: 3 documents
    ------- stderr -------
    [exit code: 0]
    "#);
    let template = "templates/blocksworld/problem.pddl.tmpl";
    assert_run!(explain(template, "(ON d a)"), @r#"
    (on D A): in the initial state, line 8 of the problem
      templates/blocksworld/problem.pddl.tmpl:7:24: <</ONTABLE>><<#ON>>    (on <<object_top>> <<object_bottom>>)
      line 3: ON asks {"relation":"on"} in robmem.worldmodel: 1 document
      {"_id":{"$oid":"[ID]"},"relation":"on","object_top":"D","object_bottom":"A"} in robmem.worldmodel
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(explain(template, "(clear D)"), @r#"
    (clear D): in the initial state, line 10 of the problem
      templates/blocksworld/problem.pddl.tmpl:8:42: <</ON>><<#CLEAR|{relation: 'clear'}>>    (clear <<object>>)
      line 8: CLEAR asks {"relation":"clear"} in robmem.worldmodel: 2 documents
      {"_id":{"$oid":"[ID]"},"relation":"clear","object":"D"} in robmem.worldmodel
    (clear D): in the goal, line 4 of the problem
      templates/blocksworld/problem.pddl.tmpl:4:10: (:goal <<GOAL>>)
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(explain(template, "C"), @r#"
    C: an object, line 3 of the problem
      templates/blocksworld/problem.pddl.tmpl:3:48: (:objects<<#ONTABLE|{relation: 'on-table'}>> <<object>><</ONTABLE>><<#ON|{relation: 'on'}>> <<object_top>><</ON>><<#HOLDING|{relation: 'holding'}>> <<object>><</HOLDING>>)
      line 3: ONTABLE asks {"relation":"on-table"} in robmem.worldmodel: 2 documents
      {"_id":{"$oid":"[ID]"},"relation":"on-table","object":"C"} in robmem.worldmodel
    ------- stderr -------
    [exit code: 0]
    "#);
}

#[test]
fn an_atom_that_is_not_in_the_problem_is_explained_by_the_line_that_would_write_it() {
    let lab = Lab::new();
    let template = "templates/blocksworld/problem.pddl.j2";
    let args = [&BLOCKS[..1], &BLOCKS[2..], &[template, "--explain", "(on C D)"]].concat();
    assert_run!(lab.rmem(&args), @r#"
    ------- stderr -------
    error: `(on C D)` is not in the problem
    templates/blocksworld/problem.pddl.j2:15: would be written by (on {{ fact.object_top }} {{ fact.object_bottom }})
      line 14: query(world, "{relation: 'on'}", sort="{object_top: 1}") asks {"relation":"on"} in robmem.worldmodel: 1 document
    [exit code: 1]
    "#);
    assert_run!(lab.rmem(&[&BLOCKS[..], &[template, "--explain", "()"]].concat()), @r"
    ------- stderr -------
    error: expected an atom like `(on A B)`, or an object
    [exit code: 3]
    ");
}

#[test]
fn a_number_is_explained_by_its_function() {
    let lab = Lab::new();
    lab.write("t.j2", "(define (problem p) (:domain d)\n (:init\n{% for r in query('lab.r') %}\n(= (fuel {{ r.name }}) {{ r.fuel }})\n{% endfor %})\n (:goal (and)))");
    lab.rmem(&["insert", "lab.r", "{_id: 4, name: 'r1', fuel: 3}"]).success();
    let explain = |atom| lab.transcript(&[&["gen-problem", "-t", "t.j2", "--explain", atom]]);
    assert_run!(explain("(fuel r1)"), @r#"
    $ rmem gen-problem -t t.j2 --explain '(fuel r1)'
    (= (fuel r1) 3): in the initial state, line 4 of the problem
      t.j2:4:4: (= (fuel {{ r.name }}) {{ r.fuel }})
      line 3: query('lab.r') asks {} in lab.r: 1 document
      {"_id":4,"name":"r1","fuel":3} in lab.r
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(explain("(= (fuel r1) 3)"), @r#"
    $ rmem gen-problem -t t.j2 --explain '(= (fuel r1) 3)'
    (= (fuel r1) 3): in the initial state, line 4 of the problem
      t.j2:4:4: (= (fuel {{ r.name }}) {{ r.fuel }})
      line 3: query('lab.r') asks {} in lab.r: 1 document
      {"_id":4,"name":"r1","fuel":3} in lab.r
    ------- stderr -------
    [exit code: 0]
    "#);
    assert_run!(explain("(= (fuel r1) 4)"), @r"
    $ rmem gen-problem -t t.j2 --explain '(= (fuel r1) 4)'
    ------- stderr -------
    error: `(= (fuel r1) 4)` is not in the problem
    t.j2:4: would be written by (= (fuel {{ r.name }}) {{ r.fuel }})
      line 3: query('lab.r') asks {} in lab.r: 1 document
    [exit code: 1]
    ");
}

/// The header of a template as an editor reads it: the program and its arguments.
fn header(page: &str) -> (String, Vec<String>) {
    let line = page.lines().find(|line| line.starts_with(";;!pre-parsing:")).unwrap();
    let command = line.split("command: \"").nth(1).unwrap().split('"').next().unwrap();
    let args = line.split("args: [").nth(1).unwrap().split(']').next().unwrap();
    (command.to_owned(), args.split(',').map(|word| word.trim().trim_matches('"').to_owned()).collect())
}

#[test]
fn the_header_in_the_documentation_makes_rmem_the_preprocessor_of_an_editor() {
    let page = std::fs::read_to_string(crate::lab::root().join("docs/templates.md")).unwrap();
    let (command, args) = header(&page);
    assert_eq!(command, "rmem");
    let lab = Lab::new();
    lab.rmem(&["count", "robmem.worldmodel", "--load", "fixtures/blocksworld.json", "--memory", "file:robot.rmem"])
        .success();
    let template = lab.read("templates/blocksworld/problem.pddl.j2");
    let line = page.lines().find(|line| line.starts_with(";;!pre-parsing:")).unwrap();
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    // The editor sends the whole file, its header too, and takes what is printed.
    let problem = lab.rmem_with(&args, &format!("{template}{line}\n")).success();
    assert!(problem.ends_with(&format!(")\n{line}\n")) && problem.contains("(on D A)"), "{problem}");
    lab.write("made.pddl", &problem);
    lab.rmem(&["validate", "domains/blocksworld/domain.pddl", "made.pddl"]).success();
}

pub(crate) fn problem(lab: &Lab) -> String {
    let args = [
        "gen-problem",
        "--load",
        "fixtures/blocksworld.json",
        "--template",
        "templates/blocksworld/problem.pddl.j2",
        "--goal",
        "(on A B)",
    ];
    lab.rmem(&args).success()
}

#[test]
fn an_absent_atom_is_explained_by_what_could_have_written_it() {
    let lab = Lab::new();
    let explain = |atom: &str| lab.rmem(&[&["gen-problem"], &TASK[..], &["--explain", atom]].concat()).exits(1);
    let run = explain("(on C D)");
    assert!(run.stderr.contains("problem.pddl.j2:") && run.stderr.contains("would be written by (on "), "{run}");
    assert!(run.stderr.contains("asks {\"relation\":\"on\"}") && run.stderr.contains(": 1 document"), "{run}");
    let run = explain("(flies A)");
    assert!(run.stderr.contains("no line of templates/blocksworld/problem.pddl.j2 writes `(flies …)`"), "{run}");
}

#[test]
fn a_section_that_is_used_again_is_explained_by_its_own_query() {
    let lab = Lab::new();
    lab.write(
        "w.json",
        "{'a.b': [{is: 'machine', name: 'M1'}, {is: 'robot', name: 'R1', at: 'M1', _id: 7}, {is: 'wp', name: 'W1', at: 'M1', _id: 8}]}",
    );
    lab.write(
        "t.tmpl",
        "(define (problem p) (:domain d)
 (:objects <<#A|{is: 'machine'}>><<name>> <</A>>- machine <<#R|{at: {$exists: true}}>><<name>> <</R>> - robot)
 (:init
  (day monday)
  <<#W|{is: 'wp'}>>(wp-at <<name>> <<at>>)<<#R>>(near <<name>>)<</R>>(wp-in <<name>>)<</W>>
  <<#R>>(robot-at <<name>> <<at>>)<</R>>
  <<#A>>(idle <<name>>)<</A>>)
 (:goal (and)))
",
    );
    let explain = |atom: &str| {
        let args = ["gen-problem", "--memory", "mem:", "--load", "w.json", "-t", "t.tmpl", "--collection", "a.b", "-q"];
        lab.rmem(&[&args[..9], &["--explain", atom]].concat())
    };
    let absent = |atom: &str| explain(atom).exits(1).stderr;
    assert_run!(explain("(idle XX)"), @r#"
    ------- stderr -------
    error: `(idle XX)` is not in the problem
    t.tmpl:7: would be written by <<#A>>(idle <<name>>)<</A>>)
      line 2: A asks {"is":"machine"} in a.b: 1 document
    [exit code: 1]
    "#);
    assert!(absent("(robot-at XX)").contains("line 2: R asks {\"at\":{\"$exists\":true}} in a.b: 2 documents"));
    assert!(absent("(wp-in XX)").contains("line 5: W asks {\"is\":\"wp\"}"));
    assert!(absent("(near XX)").contains("line 2: R asks"));
    assert!(!absent("(day tuesday)").contains("asks"), "{}", absent("(day tuesday)"));
    // The document is in the answers of R and W.
    let wp = explain("(wp-at W1 M1)").success();
    assert!(wp.contains("line 5: W asks {\"is\":\"wp\"}") && wp.contains("{\"_id\":8,"), "{wp}");
    let robot = explain("(robot-at R1 M1)").success();
    assert!(robot.contains("line 2: R asks") && robot.contains("{\"_id\":7,"), "{robot}");
}

/// A template with a loop, a macro, a condition and the goal, and a domain for it.
fn large(lab: &Lab) {
    lab.write(
        "large.j2",
        "\
{% macro at(thing) %}(at {{ thing.name }} {{ thing.location }}){% endmacro %}
(define (problem tidy-up) (:domain tidy) ; all things
  (:objects
{%- for thing in query('a.b', {'type': 'thing'}) %}
    {{ thing.name }} - thing
{%- endfor %} shelf - place)
  (:init
{%- for thing in query('a.b', {'type': 'thing'}) %}
    {{ at(thing) }}
{%- if thing.tidied %}
    (tidied {{ thing.name }}) (= (weight {{ thing.name }}) {{ thing.weight }})
{%- endif %}
{%- endfor %})
  (:goal {{ goal }}))
",
    );
    lab.write(
        "tidy.pddl",
        "(define (domain tidy) (:requirements :strips :typing :fluents) (:types thing place)
  (:predicates (at ?thing - thing ?place - place) (tidied ?thing - thing)) (:functions (weight ?thing - thing)))",
    );
}

/// Things by number; the documents of the last one come from `last`.
fn things(lab: &Lab, count: usize, last: &str) {
    let thing = |n: usize| {
        format!(
            "{{\"type\": \"thing\", \"name\": \"thing{n}\", \"location\": \"shelf\", \"tidied\": {}, \"weight\": {}.5}}\n",
            n.is_multiple_of(3),
            n % 7
        )
    };
    let lines: String = (0..count).map(thing).collect();
    lab.write("things.jsonl", &format!("{lines}{last}"));
    assert_eq!(lab.rmem(&["insert", "a.b", "--file", "things.jsonl", "-q"]).code, 0);
}

#[test]
fn a_problem_that_is_larger_than_a_part_is_the_same_however_it_is_made() {
    let lab = Lab::new();
    large(&lab);
    things(&lab, 3000, "");
    let goal = ["--template", "large.j2", "--goal", "(at thing7 shelf)"];
    let rmem = |more: &[&str]| lab.rmem(&[&["gen-problem"], &goal[..], more].concat());
    let streamed = rmem(&[]);
    assert_eq!((streamed.code, streamed.stderr.as_str()), (0, ""));
    assert!(streamed.stdout.len() > 150_000, "{}", streamed.stdout.len());
    assert!(streamed.stdout.contains("(at thing2999 shelf)"));
    let checked = rmem(&["--domain", "tidy.pddl", "-o", "checked.pddl"]);
    assert_eq!((checked.code, checked.stderr.as_str()), (0, ""));
    assert_eq!(lab.read("checked.pddl"), streamed.stdout);
    // As JSON, the text is held.
    let held = rmem(&["--domain", "tidy.pddl", "--format", "json"]);
    let held: serde_json::Value = serde_json::from_str(&held.stdout).unwrap();
    assert_eq!(held["problem"], streamed.stdout);
    assert_eq!(held["sections"][0]["documents"], 3000);
}

#[test]
fn a_mistake_behind_many_documents_leaves_the_file_as_it_was() {
    let wrong = [
        (
            "{\"type\": \"thing\", \"name\": \"Thing5\", \"location\": \"shelf\", \"tidied\": false}\n",
            "are one name to PDDL",
        ),
        (
            "{\"type\": \"thing\", \"name\": \"last\", \"location\": \"attic\", \"tidied\": false}\n",
            "object `attic` is not declared",
        ),
        (
            "{\"type\": \"thing\", \"name\": \"last\", \"location\": \"thing5\", \"tidied\": false}\n",
            "is of type `thing`",
        ),
        ("{\"type\": \"thing\", \"name\": \"last\", \"location\": \"shelf\"}\n", "`thing.tidied` is undefined"),
    ];
    for (last, message) in wrong {
        let lab = Lab::new();
        large(&lab);
        things(&lab, 3000, last);
        lab.write("problem.pddl", "as it was");
        let arguments = ["--template", "large.j2", "--domain", "tidy.pddl", "--goal", "(tidied thing0)"];
        let to_file = lab.rmem(&[&["gen-problem", "-o", "problem.pddl"], &arguments[..]].concat());
        assert_eq!((to_file.code, to_file.stdout.as_str()), (3, ""), "{}", to_file.stderr);
        assert!(to_file.stderr.contains(message) && to_file.stderr.contains("large.j2:"), "{}", to_file.stderr);
        assert_eq!(to_file.stderr.matches("error").count(), 1, "{}", to_file.stderr);
        assert_eq!(lab.read("problem.pddl"), "as it was");
        let to_stdout = lab.rmem(&[&["gen-problem"], &arguments[..]].concat());
        assert_eq!((to_stdout.code, to_stdout.stdout.as_str()), (3, ""));
        assert_eq!(to_stdout.stderr, to_file.stderr);
    }
}

#[test]
fn text_that_is_collected_is_written_as_often_as_the_template_says() {
    let lab = Lab::new();
    lab.write(
        "twice.j2",
        "{% set name %}{{ find_one('a.b', {}).name }}{% endset %}({{ name }} {{ name }})\n\
         {% filter upper %}(a {{ find_one('a.b', {}).name }}){% endfilter %}\n\
         {% macro f(x) %}{{ x.name }}{% endmacro %}{% if f(find_one('a.b', {})) == 'box 1' %}(same){% endif %}\n",
    );
    lab.rmem(&["insert", "a.b", "{name: 'box 1'}", "-q"]);
    let run = lab.rmem(&["gen-problem", "--template", "twice.j2"]);
    assert_eq!(run.stdout, "(x--box_201--x x--box_201--x)\n(A x--box_201--x)\n\n", "{}", run.stderr);
}

#[test]
fn an_interrupted_problem_leaves_nothing_beside_its_file() {
    let lab = Lab::empty().env("RMEM_MEMORY", "file:robot.rmem");
    lab.write("many.jsonl", &(0..2_000).map(|n| format!("{{\"n\": {n}}}\n")).collect::<String>());
    lab.rmem(&["insert", "a.b", "--file", "many.jsonl"]).success();
    let query = "in query('a.b')";
    lab.write(
        "long.j2",
        &format!("{{% for r {query} %}}{{% for s {query} %}}({{{{ s.n }}}}){{% endfor %}}{{% endfor %}}"),
    );
    let script = "mkdir out; rmem gen-problem --template long.j2 -o out/problem.pddl &
                  until ls -A out | grep -q .; do sleep 0.01; done; kill -INT $!; wait $!";
    lab.shell(script).exits(130);
    assert_eq!(lab.shell("ls -A out").success(), "");
}

#[test]
fn a_name_that_differs_in_case_and_comes_from_no_document_has_one_hint() {
    let lab = Lab::new();
    lab.rmem(&["insert", "a.b", "{x: 'a'}", "{x: 'A'}"]).success();
    lab.write("t.j2", "(define (problem p) (:domain d)\n  (:objects {{ distinct('a.b', 'x') | join(' ') }}))\n");
    assert_run!(lab.rmem(&["gen-problem", "--template", "t.j2"]), @r"
    ------- stderr -------
    error: t.j2:2:13: `A` and `a` are one name to PDDL, which takes no notice of case
      |
    2 |   (:objects {{ distinct('a.b', 'x') | join(' ') }}))
      |             ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
      = hint: `A` comes at 2:13
    [exit code: 3]
    ");
}

#[test]
fn an_open_quote_in_the_goal_is_shown_where_it_opens() {
    let lab = Lab::new();
    lab.write("t.j2", "(define (problem p) (:domain d) (:goal {{ goal }}))\n");
    assert_run!(lab.rmem(&["gen-problem", "--template", "t.j2", "--goal", "(box-on \"box #18 packing)"]), @r#"
    ------- stderr -------
    error: <goal>:1:9: this text has no closing `"`
      |
    1 | (box-on "box #18 packing)
      |         ^
    [exit code: 3]
    "#);
}

#[test]
fn a_problem_for_a_standard_stream_is_added_to_the_file_that_is_behind_it() {
    for (name, to) in [
        ("-", ">>"),
        ("/dev/stdout", ">>"),
        ("/dev/fd/1", ">>"),
        ("/proc/self/fd/1", ">>"),
        ("/dev/stderr", "2>>"),
        ("/dev/fd/2", "2>>"),
    ] {
        let lab = Lab::empty();
        lab.write("t.j2", "(define (problem p) (:domain d))\n");
        lab.write("log", "earlier\n");
        lab.shell(&format!("rmem -q gen-problem --memory mem: --template t.j2 -o {name} {to} log")).success();
        assert_eq!(lab.read("log"), "earlier\n(define (problem p) (:domain d))\n", "{name}");
    }
}
