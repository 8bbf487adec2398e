//! init, and the words of other tools that newcomers type.

use crate::lab::{Lab, assert_run};

#[test]
fn init_makes_a_project_that_plans_two_commands_later() {
    let lab = Lab::empty();
    let made = lab.rmem(&["init", "delivery"]).exits(0);
    assert_eq!(made.stdout.lines().count(), 4, "{made}");
    let line = made.stderr.lines().find_map(|line| line.split_once("a plan: ")).map(|(_, line)| line.to_owned());
    let run = lab.shell(&line.unwrap_or_else(|| panic!("{made}"))).exits(0);
    let steps: Vec<&str> = run.stdout.lines().filter(|line| line.starts_with("(") && line.ends_with(')')).collect();
    assert_eq!(
        steps,
        [
            "(go hall kitchen)",
            "(pick-up cup kitchen)",
            "(go kitchen hall)",
            "(go hall office)",
            "(put-down cup office)"
        ],
        "{run}"
    );
    let doctor = lab.shell("cd delivery && rmem doctor --domain domain.pddl --template problem.pddl.j2").exits(0);
    assert!(doctor.stdout.contains("template   problem.pddl.j2: ok"), "{doctor}");
}

#[test]
fn the_line_that_init_prints_can_be_pasted_for_any_folder() {
    let lab = Lab::new();
    assert_run!(lab.rmem(&["init", "--quiet", "bob's #1"]), @r"
    bob's #1/rmem.toml
    bob's #1/domain.pddl
    bob's #1/problem.pddl.j2
    bob's #1/world.json
    ------- stderr -------
    [exit code: 0]
    ");
    let printed = lab.rmem(&["init", "ann's #2"]).exits(0).stderr;
    let line = printed.lines().find_map(|line| line.strip_prefix("a plan: ")).unwrap();
    assert!(lab.shell(line).success().contains("; cost = "), "{line}");
}

#[test]
fn an_empty_memory_is_the_reason_that_is_said_where_the_problem_is_wrong() {
    let lab = Lab::new();
    lab.rmem(&["init", "p"]).success();
    assert_run!(lab.shell("cd p && rmem plan --domain domain.pddl --template problem.pddl.j2"), @r#"
    ------- stderr -------
    warning: line 5: query("robmem.rooms", "{}") in robmem.rooms: 0 documents
      no collection robmem.rooms; the memory is empty
    warning: line 6: query("robmem.things", "{}") in robmem.things: 0 documents
      no collection robmem.things; the memory is empty
    warning: line 8: query("robmem.robots", "{}") in robmem.robots: 0 documents
      no collection robmem.robots; the memory is empty
    warning: line 12: query("robmem.doors", "{open: true}") in robmem.doors: 0 documents
      no collection robmem.doors; the memory is empty
    warning: line 15: query("robmem.things", "{room: {$exists: true}}") in robmem.things: 0 documents
    warning: line 21: query("robmem.orders", "{done: false}") in robmem.orders: 0 documents
      no collection robmem.orders; the memory is empty
    warning: problem.pddl.j2:20:49: the goal is empty, so nothing has to be done
       |
    20 |     {% if goal is defined %}{{ goal }}{% else %}(and
       |                                                 ^
       = hint: it became line 9 of the problem: (and
       = hint: line 21: query("robmem.orders", "{done: false}") matched no document
    error: problem.pddl.j2:5:78: in `:objects`: expected a name before `-` and a type
      |
    5 | …room in query("robmem.rooms", "{}") %}{{ room.name }} {% endfor %}- room
      |                                                                    ^^
      = hint: this is written (:objects NAME … - TYPE …)
      = hint: it became line 4 of the problem: - room
    [exit code: 3]
    "#);
    // Each query of the template is asked once, although its problem is wrong.
    let verbose = lab.shell("cd p && rmem -v plan --domain domain.pddl --template problem.pddl.j2").exits(3);
    let asked = |query: &str| verbose.stderr.matches(query).count();
    assert_eq!((asked("find robmem.rooms:"), asked("find robmem.robots:")), (1, 1), "{verbose}");
}

#[test]
fn init_overwrites_nothing() {
    let lab = Lab::empty();
    lab.write("domain.pddl", "mine");
    let refused = lab.rmem(&["init"]).exits(3);
    assert!(refused.stderr.contains(". has domain.pddl already, and nothing is overwritten"), "{refused}");
    assert_eq!((lab.read("domain.pddl").as_str(), lab.path().join("rmem.toml").exists()), ("mine", false));
    assert!(lab.rmem(&["init", "domain.pddl"]).exits(3).stderr.contains("is not a folder"));
    lab.rmem(&["init", "new/deep"]).success();
    assert!(lab.rmem(&["init", "new/deep"]).exits(3).stderr.contains("rmem.toml, domain.pddl"));
}

#[test]
fn words_of_other_tools_name_the_command() {
    let lab = Lab::empty();
    for (word, tip) in [
        ("find", "rmem query"),
        ("import", "rmem restore"),
        ("log", "rmem history"),
        ("rollback", "rmem undo"),
        ("new", "rmem init"),
        ("benchmark", "rmem compare"),
    ] {
        let run = lab.rmem(&[word, "robmem.worldmodel"]).exits(2);
        assert!(run.stderr.contains(tip), "{word}: {run}");
    }
    let run = lab.rmem(&["export", "robmem.worldmodel"]).exits(2);
    assert!(run.stderr.contains("rmem dump robmem.worldmodel") && run.stderr.contains("rmem clips export"), "{run}");
    let typo = lab.rmem(&["qeury", "robmem.worldmodel"]).exits(2);
    assert!(typo.stderr.contains("query"), "{typo}");
}
