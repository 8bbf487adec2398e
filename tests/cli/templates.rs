//! Mistakes in templates, and templates of several files.

use crate::lab::{Lab, assert_run};

const DOMAIN: &str = "(define (domain d) (:predicates (idle ?x) (up ?x))
  (:action go :parameters (?x) :precondition (idle ?x) :effect (up ?x)))";

fn lab() -> Lab {
    let lab = Lab::new();
    lab.write("d.pddl", DOMAIN);
    lab
}

/// Renders a template that is written as `t.j2`.
#[track_caller]
fn rendered(lab: &Lab, template: &str, more: &[&str]) -> crate::lab::Finished {
    lab.write("t.j2", template);
    lab.rmem(&[&["--memory", "mem:", "gen-problem", "-t", "t.j2", "-d", "d.pddl"], more].concat())
}

#[test]
fn mistakes_in_fixed_text_are_shown_at_their_own_line_and_column() {
    let template = "\
{% set machines = ['A', 'B'] -%}
(define (problem p) (:domain d)
  (:objects {% for m in machines %}{{ m }} {% endfor %})
  (:init
{% for m in machines -%}
  {% if m == 'A' %}
    (idle {{ m }})
    (idel A)
  {% else %}
    (up {{ m }}) (up x)
  {% endif %}
{%- endfor %}
{% macro busy(x) %}(up {{ x }}) (bussy {{ x }}){% endmacro %}
{{ busy('A') }}
  )
  (:goal (and)))
";
    assert_run!(rendered(&lab(), template, &[]), @r"
    ------- stderr -------
    error: t.j2:8:6: predicate `idel` is not declared
      |
    8 |     (idel A)
      |      ^^^^
      = hint: did you mean `idle`?
      = hint: it became line 6 of the problem: (idel A)
    error: t.j2:10:22: object `x` is not declared
       |
    10 |     (up {{ m }}) (up x)
       |                      ^
       = hint: it became line 8 of the problem: (up B) (up x)
    error: t.j2:13:34: predicate `bussy` is not declared
       |
    13 | {% macro busy(x) %}(up {{ x }}) (bussy {{ x }}){% endmacro %}
       |                                  ^^^^^
       = hint: it became line 11 of the problem: (up A) (bussy A)
    [exit code: 3]
    ");
}

#[test]
fn what_brackets_in_blocks_open_and_close_is_said_of_the_template() {
    let closed = "(define (problem p) (:domain d) (:objects A)\n\n  (:init\n{% for m in ['A', 'B'] %}\n  (idle {{ m }}))\n{% endfor %}\n  )\n(:goal (and)))";
    assert_run!(rendered(&lab(), closed, &[]), @r"
    ------- stderr -------
    error: t.j2:7:3: expected the end of the text, found `)`
      |
    7 |   )
      |   ^
      = hint: the list that begins with `define` was closed at 5:17
      = hint: it became line 9 of the problem: )
    [exit code: 3]
    ");
    let open = "{% if true %}\n(define (problem p) (:domain d)\n  (:goal (and))\n{% endif %}\n";
    assert_run!(rendered(&lab(), open, &[]), @r"
    ------- stderr -------
    error: t.j2:3:16: expected `)`, found the end of the text
      |
    3 |   (:goal (and))
      |                ^
      = hint: the list opened at 2:1 is not closed
      = hint: it became line 3 of the problem: (:goal (and))
    [exit code: 3]
    ");
}

#[test]
fn an_atom_of_fixed_text_is_explained_at_its_own_place() {
    let template = "(define (problem p) (:domain d) (:objects A)\n(:init {% for m in ['A'] %}\n{% if m %}\n (up {{ m }})\n (idle A)\n{% endif %}{% endfor %})\n(:goal (and)))";
    assert_run!(rendered(&lab(), template, &["--explain", "(idle A)"]), @r"
    (idle A): in the initial state, line 5 of the problem
      t.j2:5:2: (idle A)
    ------- stderr -------
    [exit code: 0]
    ");
}

#[test]
fn a_block_without_its_end_is_named_where_it_was_opened() {
    assert_run!(rendered(&lab(), "(define (problem p)\n  {% for m in ['A'] %}\n  (idle {{ m }})\n", &[]), @r"
    ------- stderr -------
    error: t.j2:2:3: {% for %} is not closed: expected {% endfor %} before the end of the template
      |
    2 |   {% for m in ['A'] %}
      |   ^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    ");
    assert_run!(rendered(&lab(), "{% for m in ['A'] %}\n{% if m %}(idle {{ m }})\n{% endfor %}\n", &[]), @r"
    ------- stderr -------
    error: t.j2:2:1: {% if %} is not closed: expected {% endif %} before {% endfor %} at 3:1
      |
    2 | {% if m %}(idle {{ m }})
      | ^^^^^^^^^^
    [exit code: 3]
    ");
}

#[test]
fn what_a_template_does_not_use_is_refused_with_the_nearest_name_that_it_does() {
    let template =
        "(define (problem p) (:domain d) (:objects {{ robot }} {{ param('team', 'CYAN') }}) (:init) (:goal (and)))";
    assert_run!(rendered(&lab(), template, &["-D", "robot=R1", "-D", "taem=CYAN"]), @r"
    ------- stderr -------
    error: <parameter>:1:1: the template does not use a parameter `taem`
      |
    1 | taem
      | ^^^^
      = hint: did you mean `team`?
    [exit code: 3]
    ");
    assert_run!(rendered(&lab(), template, &["-D", "robot=R1", "-D", "speed:=3"]), @r"
    ------- stderr -------
    error: <parameter>:1:1: the template does not use a parameter `speed`
      |
    1 | speed
      | ^^^^^
      = hint: it uses robot, team
    [exit code: 3]
    ");
    assert_run!(rendered(&lab(), template, &["-D", "robot=R1", "--goal", "(up R1)"]), @r"
    ------- stderr -------
    error: <goal>:1:1: t.j2 does not use the goal
      |
    1 | (up R1)
      | ^^^^^^^
      = hint: write (:goal {% if goal is defined %}{{ goal }}{% else %}(and …){% endif %}) in it, or leave --goal out
    [exit code: 3]
    ");
    let lab = lab();
    rendered(&lab, template, &["-D", "robot=R1", "--goal", "(up R1)", "--lenient"]).success();
    lab.rmem(&["plan", "-q", "-t", "t.j2", "-d", "d.pddl", "-D", "robot=R1", "--goal", "(up R1)", "--lenient"])
        .success();
    let why = lab.rmem(&["plan", "why", "last"]).success();
    assert!(why.contains("\ngoal        (and)\n"), "{why}");
    let marker = "(define (problem p) (:domain d) (:objects <<robot>> <<pose_x>>) (:init) (:goal (and)))";
    let given = ["-D", "robot=R1", "-D", "pose:={x: 'a'}"];
    rendered(&lab, marker, &given).success();
    assert_run!(rendered(&lab, marker, &[&given[..], &["-D", "robt=R1"]].concat()), @r"
    ------- stderr -------
    error: <parameter>:1:1: the template does not use a parameter `robt`
      |
    1 | robt
      | ^^^^
      = hint: did you mean `robot`?
    [exit code: 3]
    ");
    assert_run!(rendered(&lab, marker, &[&given[..], &["--goal", "(up R1)"]].concat()), @r"
    ------- stderr -------
    error: <goal>:1:1: t.j2 does not use the goal
      |
    1 | (up R1)
      | ^^^^^^^
      = hint: write (:goal <<GOAL>>) in it, or leave --goal out
    [exit code: 3]
    ");
}

#[test]
fn messages_have_names_as_the_memory_has_them() {
    let template =
        "(define (problem p) (:domain d) (:objects {{ 'ä' }}) (:init (idle {{ 'box #1' }})) (:goal {{ goal }}))";
    assert_run!(rendered(&lab(), template, &["--goal", "(and (up \"box #18\") (up ä))"]), @r#"
    ------- stderr -------
    error: t.j2:1:67: object `box #1` is not declared
      |
    1 | (define (problem p) (:domain d) (:objects {{ 'ä' }}) (:init (idle {{ 'box #1' }})) (:goal {{ goal }}
      |                                                                   ^^^^^^^^^^^^^^
      = hint: it became line 1 of the problem: (define (problem p) (:domain d) (:objects ä) (:init (idle "box #1")) (:goal (and (up "box #18") (up ä))))
    error: t.j2:1:91: object `box #18` is not declared
      |
    1 | …main d) (:objects {{ 'ä' }}) (:init (idle {{ 'box #1' }})) (:goal {{ goal }}))
      |                                                                    ^^^^^^^^^^
      = hint: the goal is (and (up "box #18") (up ä))
      = hint: it became line 1 of the problem: (define (problem p) (:domain d) (:objects ä) (:init (idle "box #1")) (:goal (and (up "box #18") (up ä))))
    [exit code: 3]
    "#);
    assert_run!(rendered(&lab(), template, &["--goal", "(up \"box #18\""]), @r#"
    ------- stderr -------
    error: <goal>:1:14: expected `)`, found the end of the goal
      |
    1 | (up "box #18"
      |              ^
    [exit code: 3]
    "#);
}
