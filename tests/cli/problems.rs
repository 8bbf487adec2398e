//! gen-problem: both spellings, sections, names, checks, files.

use crate::lab::Lab;

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
    let text = words(&run.success());
    assert!(text.contains("(:init (on-table A) (on-table C) (on D A) (holding B) ))"), "{text}");
    assert!(text.contains("(:goal (on A B))"), "{text}");
}

#[test]
fn the_sections_and_their_counts_are_told() {
    let run = lab()
        .rmem(&["gen-problem", "--memory", "mem:", "--load", "world.json", "-t", "problem.tmpl", "--goal", "(on A B)"])
        .exits(0);
    for line in ["ONTABLE in robmem.worldmodel: 2 documents", "ON in robmem.worldmodel: 1 document"] {
        assert!(run.stderr.contains(line), "{run}");
    }
}

#[test]
fn a_section_that_matches_nothing_is_a_warning_or_under_strict_an_error() {
    let lab = lab();
    let args = ["gen-problem", "--memory", "mem:", "-t", "problem.tmpl", "--goal", "(on A B)"];
    let run = lab.rmem(&args).exits(0);
    assert!(run.stderr.contains("warning: line 6: ONTABLE"), "{run}");
    let run = lab.rmem(&[&args[..], &["--strict", "-o", "p.pddl"]].concat()).exits(3);
    assert!(run.stderr.contains("ONTABLE"), "{run}");
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
fn a_value_cannot_smuggle_in_syntax() {
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
    let run = lab.rmem(&["gen-problem", "--memory", "mem:", "-t", "broken.tmpl"]).exits(3);
    assert!(run.stderr.contains("broken.tmpl:2:3:"), "{run}");
    lab.write("key.tmpl", "<<#ON|{relation:'on'}>>\n  (on <<objekt_top>>)\n<</ON>>\n");
    let run = lab.rmem(&["gen-problem", "--memory", "mem:", "--load", "world.json", "-t", "key.tmpl"]).exits(3);
    assert!(run.stderr.contains("key.tmpl:2:7:"), "{run}");
    lab.write("unknown.j2", "(define (problem x)\n  (:goal {{ gaol }}))\n");
    let run = lab.rmem(&["gen-problem", "--memory", "mem:", "-t", "unknown.j2"]).exits(3);
    assert!(run.stderr.contains("unknown.j2:2:"), "{run}");
    lab.write("query.j2", "{% for d in query('robmem.x', {'a': {'$nosuch': 1}}) %}{% endfor %}\n");
    let run = lab.rmem(&["gen-problem", "--memory", "mem:", "-t", "query.j2"]).exits(3);
    assert!(run.stderr.contains("query.j2:1:") && run.stderr.contains("$nosuch"), "{run}");
}

#[test]
fn the_check_against_a_domain_names_template_line_and_document() {
    let lab = lab();
    lab.write("typo.tmpl", &MARKER.replace("(on-table <<object>>)", "(on-tabel <<object>>)"));
    let run = lab
        .rmem(&[
            "gen-problem",
            "--memory",
            "mem:",
            "--load",
            "world.json",
            "-t",
            "typo.tmpl",
            "--goal",
            "(on A B)",
            "--domain",
            "domains/blocksworld/domain.pddl",
            "-o",
            "p.pddl",
        ])
        .exits(3);
    assert!(run.stderr.contains("typo.tmpl:7:"), "{run}");
    assert!(run.stderr.contains("on-tabel") && run.stderr.contains("on-table"), "{run}");
    assert!(run.stderr.contains("_id"), "{run}");
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
    for (template, line) in
        [("templates/blocksworld/problem.pddl.j2", "15:5"), ("templates/blocksworld/problem.pddl.tmpl", "7:24")]
    {
        let explain = |atom: &str| lab.rmem(&[&BLOCKS[..], &[template, "--explain", atom]].concat());
        let told = explain("(ON d a)").success();
        assert!(told.starts_with("(on D A): in the initial state, line "), "{told}");
        assert!(told.contains(&format!("  {template}:{line}: ")), "{told}");
        assert!(told.contains("asks {\"relation\":\"on\"} in robmem.worldmodel: 1 document"), "{told}");
        assert!(
            told.contains("\"relation\":\"on\",\"object_top\":\"D\",\"object_bottom\":\"A\"} in robmem.worldmodel"),
            "{told}"
        );
        // In the initial state, and in the goal.
        let told = explain("(clear D)").success();
        assert!(told.contains("(clear D): in the initial state") && told.contains("(clear D): in the goal"), "{told}");
        assert!(explain("C").success().starts_with("C: an object"));
    }
}

#[test]
fn what_is_not_in_the_problem_is_not_explained_but_said_where_it_would_be_written() {
    let lab = Lab::new();
    let template = "templates/blocksworld/problem.pddl.j2";
    let args = [&BLOCKS[..1], &BLOCKS[2..], &[template, "--explain", "(on C D)"]].concat();
    let run = lab.rmem(&args).exits(1);
    assert!(run.stdout.is_empty() && run.stderr.contains("problem.pddl.j2:15: would be written by (on "), "{run}");
    lab.rmem(&[&BLOCKS[..], &[template, "--explain", "()"]].concat()).exits(3);
}

#[test]
fn a_number_is_explained_by_its_function() {
    let lab = Lab::new();
    lab.write("t.j2", "(define (problem p) (:domain d)\n (:init\n{% for r in query('lab.r') %}\n(= (fuel {{ r.name }}) {{ r.fuel }})\n{% endfor %})\n (:goal (and)))");
    lab.rmem(&["insert", "lab.r", "{_id: 4, name: 'r1', fuel: 3}"]).success();
    for atom in ["(fuel r1)", "(= (fuel r1) 3)"] {
        let told = lab.rmem(&["gen-problem", "-t", "t.j2", "--explain", atom]).success();
        assert!(told.contains("t.j2:4:") && told.contains("{\"_id\":4,"), "{told}");
    }
    lab.rmem(&["gen-problem", "-t", "t.j2", "--explain", "(= (fuel r1) 4)"]).exits(1);
}

#[test]
fn a_problem_becomes_documents_and_a_template_makes_it_again() {
    let lab = Lab::new();
    let problem = "fixtures/tasks/numeric/problem.pddl";
    lab.rmem(&[
        "import-problem",
        problem,
        "--into",
        "lab.task",
        "--template",
        "t.j2",
        "-d",
        "fixtures/tasks/numeric/domain.pddl",
    ])
    .success();
    let objects = lab.rmem(&["count", "lab.task", "{relation: 'domain-object'}"]).success();
    assert_ne!(objects, "0\n");
    let task = ["-d", "fixtures/tasks/numeric/domain.pddl"];
    let from_file = lab.rmem(&[&["plan", "--no-store", "-p", problem], &task[..]].concat()).success();
    assert_eq!(lab.rmem(&[&["plan", "--no-store", "-t", "t.j2"], &task[..]].concat()).success(), from_file);
    let run = lab.rmem(&["import-problem", problem, "--into", "lab.task"]).exits(3);
    assert!(run.stderr.contains("--replace"), "{run}");
    let all = lab.rmem(&["count", "lab.task"]).success();
    lab.rmem(&["import-problem", problem, "--into", "lab.task", "--replace"]).success();
    assert_eq!(lab.rmem(&["count", "lab.task"]).success(), all);
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
