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

const PARTS: [(&str, &str); 3] = [
    (
        "base.j2",
        "(define (problem p) (:domain d)\n  (:objects {% block objects %}{% endblock %})\n  (:init {% block init %}{% endblock %})\n  (:goal (and)))\n",
    ),
    ("lib/facts.j2", "{% macro idle(name) %}(idle {{ name }}){% endmacro %}\n"),
    ("shared/more.j2", "\n    (up {{ machine }}) {% for m in query('a.b') %}(idle {{ m.name }}){% endfor %}"),
];

const CHILD: &str = "{% extends 'base.j2' %}{% from 'lib/facts.j2' import idle %}
{% block objects %}{{ machine }}{% endblock %}
{% block init %}{{ idle(machine) }} {% include 'more.j2' %}{% endblock %}";

/// A folder with templates that name each other.
fn parts() -> Lab {
    let lab = lab().env("RMEM_MEMORY", "file:m.rmem");
    PARTS.iter().for_each(|(name, text)| lab.write(name, text));
    lab.write("child.j2", CHILD);
    lab.rmem(&["insert", "-q", "a.b", "{_id: 1, name: 'A'}"]).success();
    lab
}

#[test]
fn templates_extend_import_and_include_others_of_their_folder_and_of_the_template_path() {
    let lab = parts();
    let words = ["gen-problem", "-d", "d.pddl", "-t", "child.j2", "-D", "machine=A"];
    assert_run!(lab.rmem(&words), @r"
    ------- stderr -------
    error: child.j2:3:37: there is no template `more.j2`
      |
    3 | {% block init %}{{ idle(machine) }} {% include 'more.j2' %}{% endblock %}
      |                                     ^^^^^^^^^^^^^^^^^^^^^^^
      = hint: looked for it in .; --template-path names more folders
      = hint: did you mean `base.j2`?
    [exit code: 3]
    ");
    let path = ["--template-path", "shared"];
    assert_run!(lab.rmem(&[&words[..], &path].concat()), @r"
    (define (problem p) (:domain d)
      (:objects A)
      (:init (idle A) 
        (up A) (idle A))
      (:goal (and)))
    ------- stderr -------
    [exit code: 0]
    ");
    assert_run!(lab.rmem(&[&words[..], &path, &["--explain", "(idle A)"]].concat()), @r#"
    (idle A): in the initial state, line 3 of the problem
      lib/facts.j2:1:23: {% macro idle(name) %}(idle {{ name }}){% endmacro %}
    (idle A): in the initial state, line 4 of the problem
      shared/more.j2:2:51: (up {{ machine }}) {% for m in query('a.b') %}(idle {{ m.name }}){% endfor %}
      line 2 of shared/more.j2: query('a.b') asks {} in a.b: 1 document
      {"_id":1,"name":"A"} in a.b
    ------- stderr -------
    [exit code: 0]
    "#);
    lab.write("rmem.toml", "template_path = ['shared']\n");
    lab.rmem(&words).success();
    // The texts of all of them are kept with a plan.
    lab.rmem(&["plan", "-q", "-d", "d.pddl", "-t", "child.j2", "-D", "machine=A"]).success();
    for name in ["base.j2", "lib/facts.j2", "shared/more.j2", "child.j2"] {
        std::fs::remove_file(lab.path().join(name)).unwrap();
    }
    lab.rmem(&["plan", "check", "last"]).success();
}

#[test]
fn mistakes_in_included_templates_are_shown_there() {
    let lab = parts();
    let words = ["gen-problem", "-d", "d.pddl", "-t", "child.j2", "-D", "machine=A", "--template-path", "shared"];
    lab.write("shared/more.j2", "\n  (upp A)\n");
    assert_run!(lab.rmem(&words), @r"
    ------- stderr -------
    error: shared/more.j2:2:4: predicate `upp` is not declared
      |
    2 |   (upp A)
      |    ^^^
      = hint: did you mean `up`?
      = hint: it became line 4 of the problem: (upp A)
    [exit code: 3]
    ");
    lab.write("shared/more.j2", "\n  {% for m in query('a.b') %}(up {{ m.nme }}){% endfor %}\n");
    assert_run!(lab.rmem(&words), @r#"
    ------- stderr -------
    error: shared/more.j2:2:34: `m.nme` is undefined
      |
    2 |   {% for m in query('a.b') %}(up {{ m.nme }}){% endfor %}
      |                                  ^^^^^^^^^^^
      = hint: from document _id 1 of a.b
      = hint: did you mean `name`?
      = hint: where a document may lack it: {% if m.nme is defined %}, or m.get("nme")
    [exit code: 3]
    "#);
    lab.write("shared/more.j2", "\n  {% for m in query('a.b') %}(up {{ m.name }})\n");
    assert_run!(lab.rmem(&words), @r"
    ------- stderr -------
    error: shared/more.j2:2:3: {% for %} is not closed: expected {% endfor %} before the end of the template
      |
    2 |   {% for m in query('a.b') %}(up {{ m.name }})
      |   ^^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    ");
    lab.write("lib/facts.j2", "{% macro idle(name) %}\n (idel {{ name }}){% endmacro %}\n");
    lab.write("shared/more.j2", "");
    assert_run!(lab.rmem(&words), @r"
    ------- stderr -------
    error: lib/facts.j2:2:3: predicate `idel` is not declared
      |
    2 |  (idel {{ name }}){% endmacro %}
      |   ^^^^
      = hint: did you mean `idle`?
      = hint: it became line 4 of the problem: (idel A) )
    [exit code: 3]
    ");
}

#[test]
fn no_name_leads_out_of_the_folders_of_templates() {
    let lab = parts();
    lab.write("inner/t.j2", "");
    std::os::unix::fs::symlink("../base.j2", lab.path().join("inner/up.j2")).unwrap();
    std::os::unix::fs::symlink("t.j2", lab.path().join("inner/same.j2")).unwrap();
    std::os::unix::fs::symlink("/etc/hostname", lab.path().join("inner/host.j2")).unwrap();
    for name in ["../base.j2", "/etc/hostname", "a/../../base.j2", "up.j2", "host.j2", "a\\\\b", "lib"] {
        lab.write("inner/x.j2", &format!("{{% include '{name}' %}}"));
        let run = lab.rmem(&["gen-problem", "-t", "inner/x.j2"]).exits(3);
        assert!(run.stderr.starts_with("error: inner/x.j2:1:1: "), "{name}: {run}");
        assert!(!run.stderr.contains("define"), "{run}");
    }
    lab.write("inner/x.j2", "{% include 'same.j2' %}{% include 'none.j2' ignore missing %}");
    lab.rmem(&["gen-problem", "-t", "inner/x.j2"]).success();
    lab.write("inner/x.j2", "{% include '../base.j2' %}");
    assert_run!(lab.rmem(&["gen-problem", "-t", "inner/x.j2"]), @r"
    ------- stderr -------
    error: inner/x.j2:1:1: `../base.j2` leads out of the folders of templates
      |
    1 | {% include '../base.j2' %}
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    ");
    lab.write("inner/x.j2", "{% include 'up.j2' %}");
    assert_run!(lab.rmem(&["gen-problem", "-t", "inner/x.j2"]), @r"
    ------- stderr -------
    error: inner/x.j2:1:1: `up.j2` is a symbolic link out of inner
      |
    1 | {% include 'up.j2' %}
      | ^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    ");
    for (name, message) in [
        ("../base.j2", "`../base.j2` leads out of the folders of templates"),
        ("/etc/hostname", "`/etc/hostname` leads out of the folders of templates"),
        ("./../base.j2", "`./../base.j2` leads out of the folders of templates"),
        ("up.j2", "there is no template `up.j2`"),
        ("host.j2", "there is no template `host.j2`"),
    ] {
        for template in [
            format!("{{% set name = '{name}' %}}{{% include name %}}"),
            "{% include param('name') %}".to_owned(),
            format!("{{% for name in ['none.j2', '{name}'] %}}{{% include name ignore missing %}}{{% endfor %}}x"),
        ] {
            lab.write("inner/x.j2", &template);
            let given = format!("name={name}");
            let options: &[&str] = if template.contains("param") { &["-D", &given] } else { &[] };
            let run = lab.rmem(&[&["gen-problem", "-t", "inner/x.j2"], options].concat());
            if template.contains("missing") && !message.contains("leads") {
                assert_eq!(run.success(), "x");
            } else {
                assert!(run.exits(3).stderr.contains(&format!(": {message}\n")), "{template}");
            }
        }
    }
}

#[test]
fn names_of_templates_may_be_chosen_whatever_was_included_before() {
    let lab = parts();
    lab.write("a.j2", "(a)");
    lab.write("b.j2", "(b {% include next %})");
    lab.write("lib/c.j2", "{% macro c() %}(c){% endmacro %}(d)");
    let made = |template: &str| {
        lab.write("x.j2", template);
        lab.rmem(&["gen-problem", "-t", "x.j2", "--template-path", "lib", "-D", "kind=a.j2"])
    };
    for (template, text) in [
        ("{% set t = 'a.j2' %}{% include t %}{% if kind %}{% endif %}", "(a)"),
        ("{% include kind %}", "(a)"),
        ("{% set next = kind %}{% for t in ['a.j2', \"b.j2\"] %}{% include t %}{% endfor %}", "(a)(b (a))"),
        ("{% include 'a.j2' %}{% set t = 'a.j2' %}{%- include t -%}{% if kind %}{% endif %}", "(a)(a)"),
        ("{% include 'a.j2' if kind == 'b.j2' else 'c.j2' %}", "(d)"),
        ("{% include ['no.j2', kind] %}", "(a)"),
        ("{% include kind ~ '' ignore missing %}", "(a)"),
        ("{% set t = ['c.j2'] %}{% import t[0] as c %}{{ c.c() }}{% include kind with context %}", "(c)(a)"),
        ("{% from {'a': 'c.j2'}[kind|first] import c %}{{ c() }}", "(c)"),
        ("{% set t = 'no.j2' %}{% include t ignore missing %}{% include kind %}", "(a)"),
    ] {
        let run = made(template);
        assert_eq!((run.code, run.stdout.as_str()), (0, text), "{template}: {run}");
    }
    assert_run!(made("{% include 'a.j2' %}\n{% include kind|first ~ '.j2' %}\n{% include 'b' ~ '.j2' ignore missing %}"), @r"
    ------- stderr -------
    error: x.j2:3:1: `b.j2` is not the name of a template that is written in quotes
      |
    3 | {% include 'b' ~ '.j2' ignore missing %}
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
      = hint: a name may be chosen, but not put together: write each as a whole, or give it with -D
    [exit code: 3]
    ");
    assert_run!(made("{% include kind %}\n{% for t in ['a.j2', 'no.j2'] %}{% include t %}{% endfor %}"), @r"
    ------- stderr -------
    error: x.j2:2:33: there is no template `no.j2`
      |
    2 | {% for t in ['a.j2', 'no.j2'] %}{% include t %}{% endfor %}
      |                                 ^^^^^^^^^^^^^^^
      = hint: it is looked for in the folder of the template, and in those of --template-path
    [exit code: 3]
    ");
    assert_run!(made("{% include kind %}{% include ['no.j2', 'none.j2'] %}"), @r"
    ------- stderr -------
    error: x.j2:1:19: there is none of the templates `no.j2`, `none.j2`
      |
    1 | {% include kind %}{% include ['no.j2', 'none.j2'] %}
      |                   ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
      = hint: it is looked for in the folder of the template, and in those of --template-path
    [exit code: 3]
    ");
    assert_run!(made("{% include kind %}{% include 3 %}"), @r"
    ------- stderr -------
    error: x.j2:1:22: template name was not a string
      |
    1 | {% include kind %}{% include 3 %}
      |                      ^^^^^^^^^
    [exit code: 3]
    ");
}

#[test]
fn names_that_are_joined_by_blanks_are_names_of_their_own() {
    let lab = Lab::new();
    let made = |template: &str| {
        lab.write("t.j2", template);
        lab.rmem(&["--memory", "mem:", "gen-problem", "-t", "t.j2"]).success()
    };
    assert_eq!(
        made("(go {{ ['g1', 'hand over', 3, 'x) (y']|join(' ') }})"),
        "(go g1 x--hand_20over--x 3 x--x_29_20_28y--x)"
    );
    assert_eq!(made("({{ ['a', 'b']|join('_') }} {{ ['a b', 'c']|join(', ') }})"), "(a_b x--a_20b_2c_20c--x)");
    assert_eq!(
        made(
            "{% set all = [{'n': {'x': 'a b'}}, {'n': {'x': 'c'}}]|join(' ', attribute='n.x') %}({{ all }}){{ all|upper }}"
        ),
        "(x--a_20b--x c)x--_41_20_42_20_43--x"
    );
    assert_eq!(
        made("{% macro at(x) %}(at {{ x }}){% endmacro %}{{ [at('a b'), at('c')]|join(' ') }}"),
        "(at x--a_20b--x) (at c)"
    );
}

#[test]
fn what_cannot_be_joined_is_an_error_and_nothing_is_nothing() {
    let lab = lab();
    lab.write("w.json", r#"{"robmem.orders": [{"_id": 1, "at": "x", "names": []}]}"#);
    let made = |template: &str| {
        let template = format!("{{% set r = find_one('robmem.orders') %}}{template}");
        rendered(&lab, &template, &["--load", "w.json"])
    };
    assert_run!(made("({{ r.nope|join(' ') }})"), @r#"
    ------- stderr -------
    error: t.j2:1:44: `r.nope` is undefined
      |
    1 | {% set r = find_one('robmem.orders') %}({{ r.nope|join(' ') }})
      |                                            ^^^^^^
      = hint: from document _id 1 of robmem.orders
      = hint: it has the keys _id, at, names
      = hint: where a document may lack it: {% if r.nope is defined %}, or r.get("nope")
    [exit code: 3]
    "#);
    assert_run!(made("({{ [r.at, r.nope]|join('_') }})"), @r"
    ------- stderr -------
    error: t.j2:1:59: `join`: element 2 of the list is undefined
      |
    1 | {% set r = find_one('robmem.orders') %}({{ [r.at, r.nope]|join('_') }})
      |                                                           ^^^^^^^^^
    [exit code: 3]
    ");
    assert_run!(made("({{ r.at|join(' ') }})"), @r"
    ------- stderr -------
    error: t.j2:1:49: `join` is for a list, and this is a text
      |
    1 | {% set r = find_one('robmem.orders') %}({{ r.at|join(' ') }})
      |                                                 ^^^^^^^^^
      = hint: `split` makes a list of a text: {{ names|split|join(' ') }}
    [exit code: 3]
    ");
    lab.write("t.j2", "({{ []|join(' ') }}{{ []|join }}{{ find_one('robmem.orders').names|join('_') }})");
    let args = ["--memory", "mem:", "--load", "w.json", "gen-problem", "-t", "t.j2"];
    assert_eq!(lab.rmem(&args).success(), "()");
}

#[test]
fn filters_of_text_keep_names_apart() {
    let lab = Lab::new();
    lab.write("w.json", r#"{"robmem.orders": [{"_id": "r 1", "at": "b) (x"}, {"_id": "r2", "at": "B"}]}"#);
    let made = |template: &str| {
        lab.write("t.j2", template);
        lab.rmem(&["--memory", "mem:", "--load", "w.json", "gen-problem", "-t", "t.j2", "-D", "n=A) (B"])
    };
    let each = "{% for r in query('robmem.orders') %}(at {{ r._id }} {{ r.at }} go on){% endfor %}";
    let block = |filter: &str| format!("{{% filter {filter} %}}{each}{{% endfilter %}}{{% if n %}}{{% endif %}}");
    for (filter, text) in [
        ("upper", "(AT x--r_201--x x--b_29_20_28x--x GO ON)(AT r2 B GO ON)"),
        ("title", "(At x--r_201--x x--b_29_20_28x--x Go On)(At r2 B Go On)"),
        ("capitalize", "(at x--r_201--x x--b_29_20_28x--x go on)(at r2 B go on)"),
        // What is replaced is text of the template, and no part of a value or its mark.
        ("replace('0', '1')|replace('r', 'q')", "(at x--r_201--x x--b_29_20_28x--x go on)(at r2 B go on)"),
        (
            "replace('go on', n)",
            "(at x--r_201--x x--b_29_20_28x--x x--_41_29_20_28_42--x)(at r2 B x--_41_29_20_28_42--x)",
        ),
        ("length", "35"),
    ] {
        assert_eq!(made(&block(filter)).success(), text, "{filter}");
    }
    assert_run!(made(&block("pprint")), @r"
    ------- stderr -------
    error: t.j2:1:1: the filters of this block make one value of its text
      |
    1 | {% filter pprint %}{% for r in query('robmem.orders') %}(at {{ r._id }} {{ r.at }} go on){% endfor %
      | ^^^^^^^^^^^^^^^^^^^
      = hint: upper, lower, capitalize, title, trim, replace and indent leave text what it is; any other is for values: {{ name|filter }}
    [exit code: 3]
    ");
    for (template, message) in [
        ("{% set text %}{{ n }}{% endset %}({{ text|first }})", "t.j2:1:35: a filter took rendered text apart"),
        ("({{ [n, 'b']|upper }})", "t.j2:1:14: `upper` is for a text, and this is a list"),
    ] {
        let stderr = made(template).exits(3).stderr;
        assert!(stderr.contains(message), "{stderr}");
    }
}

#[test]
fn strict_does_not_hide_what_is_wrong_with_the_problem() {
    let lab = lab();
    lab.write("w.json", r#"{"robmem.orders": [{"_id": 1}]}"#);
    let template = within_init("{% for r in query('robmem.orders', {'at': 1}) %}{% endfor %}(idel b)");
    assert_run!(rendered(&lab, &template, &["--load", "w.json", "--strict"]), @r#"
    ------- stderr -------
    warning: line 3: query('robmem.orders', {'at': 1}) in robmem.orders: 0 documents
      robmem.orders: 1 document, 0 match
        alone  together  condition
            0         0  {"at":1}
                         no document has the key `at`; there are _id
    error: t.j2:3:62: predicate `idel` is not declared
      |
    3 | {% for r in query('robmem.orders', {'at': 1}) %}{% endfor %}(idel b)
      |                                                              ^^^^
      = hint: did you mean `idle`?
      = hint: it became line 3 of the problem: (idel b)
    [exit code: 3]
    "#);
    let plan = ["plan", "--memory", "mem:", "--load", "w.json", "-t", "t.j2", "-d", "d.pddl", "--strict"];
    let stderr = lab.rmem(&plan).exits(3).stderr;
    assert!(stderr.contains("`idel` is not declared") && !stderr.contains("sections that match"), "{stderr}");
}

#[test]
fn a_template_that_is_not_there_is_an_error_that_names_those_that_are() {
    let lab = Lab::new();
    lab.write("common.j2", "x");
    lab.write("lib/base.j2", "x");
    lab.write("parts/one.j2", "x");
    lab.write("rmem.toml", "x = 1");
    for (name, hint) in [
        ("comon.j2", "did you mean `common.j2`?"),
        ("parts/two.j2", "did you mean `parts/one.j2`?"),
        ("zzzzzz.j2", "there is base.j2, common.j2"),
        ("x.md", ""),
    ] {
        lab.write("t.j2", &format!("(a)\n  {{% include '{name}' %}}"));
        let run = lab.rmem(&[
            "--config",
            "/dev/null",
            "--memory",
            "mem:",
            "gen-problem",
            "-t",
            "t.j2",
            "--template-path",
            "lib",
        ]);
        let tag = format!("{{% include '{name}' %}}");
        let hint = if hint.is_empty() { String::new() } else { format!("  = hint: {hint}\n") };
        assert_eq!(
            run.exits(3).stderr,
            format!(
                "error: t.j2:2:3: there is no template `{name}`\n  |\n2 |   {tag}\n  |   {}\n  = hint: looked for it in ., lib; \
                 --template-path names more folders\n{hint}",
                "^".repeat(tag.len())
            )
        );
    }
}

#[test]
fn an_included_template_that_is_not_utf8_is_shown_at_its_place() {
    let lab = Lab::new();
    lab.write("t.j2", "{% include 'part.j2' %}");
    std::fs::write(lab.path().join("part.j2"), b"(a)\n; cup\xe9").unwrap();
    let run = lab.rmem(&["--config", "/dev/null", "--memory", "mem:", "gen-problem", "-t", "t.j2"]).exits(3);
    let wanted = "error: part.j2:2:6: expected UTF-8 text, found invalid UTF-8\n  |\n2 | ; cup";
    assert!(run.stderr.starts_with(wanted), "{run}");
}

#[test]
fn what_is_joined_is_a_text_where_it_is_used_as_a_value() {
    let lab = Lab::new();
    for (expression, made) in [
        ("j == 'a b c'", "true"),
        ("j != 'a b c'", "false"),
        ("j == k", "true"),
        ("j is string", "true"),
        ("j|length", "5"),
        ("'b' in j", "true"),
        ("j in ['a b c']", "true"),
        ("{'a b c': 7}[j]", "7"),
        ("[j, 'a b c']|unique|list|length", "1"),
        ("j|split|length", "3"),
        ("j|split(' ')|last", "c"),
        ("j|first", "a"),
        // A part of it, and what a filter makes of it, is a text like any other: one name.
        ("j[0:3]", "x--a_20b--x"),
        ("j|lower", "x--a_20b_20c--x"),
        ("j|replace('b', '(')", "x--a_20_28_20c--x"),
        ("j + '!'", "x--a_20b_20c_21--x"),
        ("j ~ '!'", "x--a_20b_20c_21--x"),
        // So is an equal text.
        ("'a b c'", "x--a_20b_20c--x"),
        ("k", "x--a_20b_20c--x"),
        // As it is, it is names apart, however it came there.
        ("j", "x--a_20b--x c"),
        ("j|default('x')", "x--a_20b--x c"),
        ("[j]|first", "x--a_20b--x c"),
        ("[j, 'q r']|join(' ')", "x--a_20b--x c x--q_20r--x"),
        ("[j, 'q']|join('_')", "x--a_20b_20c_5fq--x"),
    ] {
        lab.write(
            "t.j2",
            &format!("{{% set j = ['a b', 'c']|join(' ') %}}{{% set k = 'a b' ~ ' c' %}}{{{{ {expression} }}}}"),
        );
        assert_eq!(lab.rmem(&["--memory", "mem:", "gen-problem", "-t", "t.j2"]).success(), made, "{expression}");
    }
    lab.rmem(&["--memory", "file:m.rmem", "insert", "a.b", "{_id: 1, names: 'a b c'}", "{_id: 2, names: 'x'}"])
        .success();
    lab.write("t.j2", "{% for d in query('a.b', {'names': ['a b', 'c']|join(' ')}) %}{{ d._id }}{% endfor %}");
    assert_eq!(lab.rmem(&["--memory", "file:m.rmem", "gen-problem", "-t", "t.j2"]).success(), "1");
}

#[test]
fn a_domain_may_be_a_template() {
    let lab = parts();
    lab.write(
        "dom.pddl.j2",
        "(define (domain d) (:predicates (idle ?x) (up ?x)) (:constants A)\n{% for m in query('a.b') %}(:action {{ verb }}-{{ m.name }} :parameters ()\n  :precondition (idle {{ m.name }}) :effect (up {{ m.name }})){% endfor %})",
    );
    lab.write("p.j2", "(define (problem p) (:domain d) (:init (idle A)) (:goal {{ goal }}))");
    let task = ["-d", "dom.pddl.j2", "-t", "p.j2", "--goal", "(up A)"];
    assert_run!(lab.rmem(&[&["plan", "-q"], &task[..], &["-D", "verb=start"]].concat()), @r"
    (start-A)
    ; cost = 1 (unit cost)
    ------- stderr -------
    [exit code: 0]
    ");
    lab.rmem(&["plan", "check", "last"]).success();
    lab.rmem(&[&["gen-problem"], &task[..], &["-D", "verb=start"]].concat()).success();
    assert_run!(lab.rmem(&[&["plan"], &task[..], &["-D", "verb=start", "-D", "x=1"]].concat()), @r"
    ------- stderr -------
    error: <parameter>:1:1: the template does not use a parameter `x`
      |
    1 | x
      | ^
      = hint: it uses verb
    [exit code: 3]
    ");
    lab.write("dom.pddl.j2", "(define (domain d)\n{% if verb %}\n  (:predicats (idle ?x)){% endif %})");
    assert_run!(lab.rmem(&[&["plan"], &task[..], &["-D", "verb=start"]].concat()), @r"
    ------- stderr -------
    error: dom.pddl.j2:3:4: expected a section of a domain, found `:predicats`
      |
    3 |   (:predicats (idle ?x)){% endif %})
      |    ^^^^^^^^^^
      = hint: there are :requirements, :types, :constants, :predicates, :functions, :constraints, :derived, :action, :durative-action
      = hint: it became line 3 of the domain: (:predicats (idle ?x)))
    [exit code: 3]
    ");
}

#[test]
fn queries_of_markers_take_parameters() {
    let lab = parts();
    lab.rmem(&["insert", "-q", "a.b", "{_id: 2, name: 'B', n: 3}"]).success();
    let words = ["gen-problem", "-t", "q.tmpl", "--collection", "a.b"];
    lab.write(
        "q.tmpl",
        "<<#M|{name: '%NAME%'}>>(idle <<name>>)<</M>><<#N||[{$match: {n: '%N%'}}]>>(up <<name>>)<</N>>",
    );
    assert_eq!(lab.rmem(&[&words[..], &["-D", "NAME=A", "-D", "N:=3"]].concat()).success(), "(idle A)(up B)");
    assert_run!(lab.rmem(&[&words[..], &["-D", "N:=3"]].concat()), @r"
    ------- stderr -------
    error: q.tmpl:1:6: there is no parameter `NAME` for `%NAME%`
      |
    1 | <<#M|{name: '%NAME%'}>>(idle <<name>>)<</M>><<#N||[{$match: {n: '%N%'}}]>>(up <<name>>)<</N>>
      |      ^^^^^^^^^^^^^^^^
      = hint: give it with -D NAME=…
    [exit code: 3]
    ");
}

#[test]
fn keys_and_patterns_of_marker_queries_take_parameters() {
    let lab = parts();
    lab.rmem(&["insert", "-q", "a.b", "{_id: 2, name: 'B', n: 3, at: {x: 3}, xs: [1, 7]}"]).success();
    lab.rmem(&["insert", "-q", "a.b", "{_id: 3, name: 'C', n: 4, at: {x: 4}, k3: 1}"]).success();
    let words = ["gen-problem", "-t", "q.tmpl", "--collection", "a.b"];
    let rendered = |query: &str, parameters: &[&str]| {
        lab.write("q.tmpl", &format!("<<#M{query}>>(idle <<name>>)<</M>>"));
        lab.rmem(&[&words[..], parameters].concat())
    };
    assert_eq!(rendered("|{'%K%': 3}", &["-D", "K=n"]).success(), "(idle B)");
    assert_eq!(rendered("|{'%K%': '%V%'}", &["-D", "K=at.x", "-D", "V:=4"]).success(), "(idle C)");
    assert_eq!(rendered("|{$or: [{'at.%K%': {$gt: 3}}]}", &["-D", "K=x"]).success(), "(idle C)");
    assert_eq!(rendered("|{'xs.%I%': 7, 'k%I%': null}", &["-D", "I:=1"]).success(), "(idle B)");
    assert_eq!(rendered("||[{$match: {'%K%': 3}}]", &["-D", "K=n"]).success(), "(idle B)");
    assert_eq!(rendered("|{name: /^%P%$/i}", &["-D", "P=[bx]"]).success(), "(idle B)");
    assert_eq!(rendered("|{'%K%': 3}", &["--lenient"]).success(), "");
    assert_run!(rendered("|{'%K%': '1'}", &["-D", "K=$where"]), @r"
    ------- stderr -------
    error: q.tmpl:1:6: the parameter `K` cannot be used in the key `%K%`: it would make it an operator
      |
    1 | <<#M|{'%K%': '1'}>>(idle <<name>>)<</M>>
      |      ^^^^^^^^^^^^
      = hint: a parameter in a key is the name of a key or a path, like `state` or `pose.x`
    [exit code: 3]
    ");
    assert_run!(rendered("|{'at.%K%': 1}", &["-D", "K=x.$y"]), @r"
    ------- stderr -------
    error: q.tmpl:1:6: the parameter `K` cannot be used in the key `at.%K%`: it would make it an operator
      |
    1 | <<#M|{'at.%K%': 1}>>(idle <<name>>)<</M>>
      |      ^^^^^^^^^^^^^
      = hint: a parameter in a key is the name of a key or a path, like `state` or `pose.x`
    [exit code: 3]
    ");
    assert_run!(rendered("|{'%K%': 1}", &["-D", "K:={\"$gt\": 1}"]), @r"
    ------- stderr -------
    error: q.tmpl:1:6: the parameter `K` cannot be used in the key `%K%`: it is neither text nor a whole number
      |
    1 | <<#M|{'%K%': 1}>>(idle <<name>>)<</M>>
      |      ^^^^^^^^^^
      = hint: a parameter in a key is the name of a key or a path, like `state` or `pose.x`
    [exit code: 3]
    ");
    assert_run!(rendered("|{'%K%': 1}", &["-D", "K="]), @r"
    ------- stderr -------
    error: q.tmpl:1:6: the parameter `K` cannot be used in the key `%K%`: it is empty
      |
    1 | <<#M|{'%K%': 1}>>(idle <<name>>)<</M>>
      |      ^^^^^^^^^^
      = hint: a parameter in a key is the name of a key or a path, like `state` or `pose.x`
    [exit code: 3]
    ");
    assert_run!(rendered("|{n: 3, '%K%': 4}", &["-D", "K=n"]), @r"
    ------- stderr -------
    error: q.tmpl:1:6: the parameters make two keys `n` of this query
      |
    1 | <<#M|{n: 3, '%K%': 4}>>(idle <<name>>)<</M>>
      |      ^^^^^^^^^^^^^^^^
      = hint: a document has each key once; join the conditions with $and
    [exit code: 3]
    ");
    assert_run!(rendered("|{'%K%': 1}", &["-D", "L=n"]), @r"
    ------- stderr -------
    error: <parameter>:1:1: the template does not use a parameter `L`
      |
    1 | L
      | ^
      = hint: it uses K, name
    [exit code: 3]
    ");
}

#[test]
fn a_goal_for_a_problem_that_has_its_own_is_refused() {
    let lab = lab();
    lab.write("p.pddl", "(define (problem p) (:domain d) (:objects A) (:init (idle A)) (:goal (up A)))");
    assert_run!(lab.rmem(&["plan", "-d", "d.pddl", "-p", "p.pddl", "--goal", "(idle A)"]), @r"
    ------- stderr -------
    error: --goal is for a template; the problem of --problem has a goal of its own
    [exit code: 2]
    ");
}

/// A template of a problem with this text in its initial state.
fn within_init(text: &str) -> String {
    format!("(define (problem p) (:domain d) (:objects a b)\n (:init (idle a)\n{text}\n )\n (:goal (and)))\n")
}

#[test]
fn mistakes_in_text_that_filters_and_variables_write_are_at_their_own_places() {
    let raw = "{% raw %}\n  (idle b)\n  (idel b)\n{% endraw %}";
    assert_run!(rendered(&lab(), &within_init(raw), &[]), @r"
    ------- stderr -------
    error: t.j2:5:4: predicate `idel` is not declared
      |
    5 |   (idel b)
      |    ^^^^
      = hint: did you mean `idle`?
      = hint: it became line 5 of the problem: (idel b)
    [exit code: 3]
    ");
    let upper =
        "{% filter upper %}\n  (idle b) (idel b)\n  (up {{ 'b' }}) (upp {{ 'b' }})\n  (idel b)\n{% endfilter %}";
    assert_run!(rendered(&lab(), &within_init(upper), &[]), @r"
    ------- stderr -------
    error: t.j2:4:13: predicate `IDEL` is not declared
      |
    4 |   (idle b) (idel b)
      |             ^^^^
      = hint: did you mean `idle`?
      = hint: it became line 4 of the problem: (IDLE B) (IDEL B)
    error: t.j2:5:19: predicate `UPP` is not declared
      |
    5 |   (up {{ 'b' }}) (upp {{ 'b' }})
      |                   ^^^
      = hint: did you mean `up`?
      = hint: it became line 5 of the problem: (UP b) (UPP b)
    error: t.j2:6:4: predicate `IDEL` is not declared
      |
    6 |   (idel b)
      |    ^^^^
      = hint: did you mean `idle`?
      = hint: it became line 6 of the problem: (IDEL B)
    [exit code: 3]
    ");
    let replace = "{%- filter replace('idel', 'ydel')|indent(2) -%}\n  (idle b)\n  (idel b)\n{% endfilter %}";
    assert_run!(rendered(&lab(), &within_init(replace), &[]), @r"
    ------- stderr -------
    error: t.j2:3:1: predicate `ydel` is not declared
      |
    3 | {%- filter replace('idel', 'ydel')|indent(2) -%}
      | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
      = hint: did you mean `idle`?
      = hint: it became line 3 of the problem: (ydel b)
    [exit code: 3]
    ");
    let set = "{% set facts %}\n  (idle b)\n  (idel b)\n{% endset %}\n{% if facts|length > 3 %}{{ facts }}{% endif %}";
    assert_run!(rendered(&lab(), &within_init(set), &[]), @r"
    ------- stderr -------
    error: t.j2:5:4: predicate `idel` is not declared
      |
    5 |   (idel b)
      |    ^^^^
      = hint: did you mean `idle`?
      = hint: it became line 6 of the problem: (idel b)
    [exit code: 3]
    ");
    let filtered = "{% set facts | replace('idel', 'ydel') %}\n  (idle b)\n  (idel b)\n{% endset %}\n{{ facts }}";
    assert_run!(rendered(&lab(), &within_init(filtered), &[]), @r"
    ------- stderr -------
    error: t.j2:7:1: predicate `ydel` is not declared
      |
    7 | {{ facts }}
      | ^^^^^^^^^^^
      = hint: did you mean `idle`?
      = hint: it became line 6 of the problem: (ydel b)
    [exit code: 3]
    ");
    let called = "{% macro f(x) %}\n  (idle b)\n  (idel {{ x }}) (idelx b)\n{% endmacro %}\n{% if f('b') %}{{ f('b') }}{% endif %}";
    assert_run!(rendered(&lab(), &within_init(called), &[]), @r"
    ------- stderr -------
    error: t.j2:5:4: predicate `idel` is not declared
      |
    5 |   (idel {{ x }}) (idelx b)
      |    ^^^^
      = hint: did you mean `idle`?
      = hint: it became line 6 of the problem: (idel b) (idelx b)
    error: t.j2:5:19: predicate `idelx` is not declared
      |
    5 |   (idel {{ x }}) (idelx b)
      |                   ^^^^^
      = hint: did you mean `idle`?
      = hint: it became line 6 of the problem: (idel b) (idelx b)
    [exit code: 3]
    ");
    let title = "{% filter title %}(idle b) (idel b){% endfilter %}";
    assert_run!(rendered(&lab(), &within_init(title), &[]), @r"
    ------- stderr -------
    error: t.j2:3:29: predicate `Idel` is not declared
      |
    3 | {% filter title %}(idle b) (idel b){% endfilter %}
      |                             ^^^^
      = hint: did you mean `idle`?
      = hint: it became line 3 of the problem: (Idle B) (Idel B)
    [exit code: 3]
    ");
}

#[test]
fn text_that_a_template_compares_is_as_it_is_written() {
    let template = "{% set kind %}{% if true %}idle{% endif %}{% endset %}\
        {% macro same(x) %}{% filter lower %}{% raw %}IDLE{% endraw %}{% endfilter %}{% endmacro %}\
        {% if kind == 'idle' and same(1) == 'idle' %}({{ kind }} b){% endif %}";
    let printed = rendered(&lab(), &within_init(template), &[]);
    assert!(printed.success().contains("\n(idle b)\n"), "{template}");
}

#[test]
fn what_other_languages_write_gets_a_hint() {
    let lab = lab();
    lab.write("w.json", r#"{"robmem.orders": [{"_id": 1, "name": "o1", "at-x": 3}]}"#);
    let orders = "{% for r in query('robmem.orders') %}";
    let length = |of: &str| format!("how many there are is a filter: write {{{{ {of}|length }}}}");
    let clock = "a template has no clock, so that the same memory gives the same problem: give the time with -D now=… and write \
                 {{ now }}, or compare dates in a query: {$expr: {$lt: ['$until', '$$NOW']}}";
    for (expression, hint) in [
        ("{% set docs = query('robmem.orders') %}{{ docs.length }}", length("docs")),
        ("{{ query('robmem.orders').size() }}", length("boxes")),
        (&format!("{orders}{{{{ r.name.length }}}}{{% endfor %}}"), length("r.name")),
        (
            &format!("{orders}{{{{ r.at-x }}}}{{% endfor %}}"),
            "a key with a hyphen is written r[\"at-x\"], or r.at_x; `-` subtracts".to_owned(),
        ),
        (
            &format!("{orders}{{{{ r.name-x }}}}{{% endfor %}}"),
            "`-` subtracts; a text behind it is written r.name ~ \"-x\"".to_owned(),
        ),
        (
            &format!("{orders}{{{{ r.name-r.x-1 }}}}{{% endfor %}}"),
            "from document _id 1 of robmem.orders\nit has the keys _id, name, at-x\nwhere a document may lack it: \
             {% if r.x is defined %}, or r.get(\"x\")"
                .to_owned(),
        ),
        (
            "{% for r in query('robmem.orders', {name: 'o1'}) %}{% endfor %}",
            "a key is written in quotes: {'at': 'x'}, or all as one text: \"{at: 'x'}\"".to_owned(),
        ),
        (
            "{% for r in query(\"db.orders.find({team: 'CYAN'})\") %}{% endfor %}",
            "write: query(\"robmem.orders\", \"{team: 'CYAN'}\")".to_owned(),
        ),
        ("{{ datetime.now() }}", clock.to_owned()),
        ("{{ now() }}", clock.to_owned()),
    ] {
        let finished = rendered(&lab, expression, &["--load", "w.json"]).exits(3);
        let hints: Vec<&str> =
            finished.stderr.lines().filter_map(|line| line.trim().strip_prefix("= hint: ")).collect();
        assert_eq!(hints.join("\n"), hint, "{expression}");
    }
    assert_run!(rendered(&lab, "{{ goal }}", &["-D", "goal=(idle a)"]), @r"
    ------- stderr -------
    error: <parameter>:1:1: the template does not use a parameter `goal`
      |
    1 | goal
      | ^^^^
      = hint: give the goal with --goal
    [exit code: 3]
    ");
}

#[test]
fn a_goal_that_a_part_would_use_that_was_left_out_is_not_recorded() {
    let lab = lab();
    let template = "(define (problem p) (:domain d) (:objects a b) (:init (idle a) (idle b))
      (:goal {% if query('robmem.orders') %}{{ goal }}{% else %}(up b){% endif %}))";
    lab.write("t.j2", template);
    let task = ["plan", "-d", "d.pddl", "-t", "t.j2", "--goal", "(up a)"];
    assert_run!(lab.rmem(&task), @r"
    (go b)
    ; cost = 1 (unit cost)
    ------- stderr -------
    warning: line 2: query('robmem.orders') in robmem.orders: 0 documents
      no collection robmem.orders; the memory is empty
    warning: the goal is not in the problem: the part of the template that uses it was left out
    stored in robmem.plans as [ID]
    [exit code: 0]
    ");
    assert!(lab.rmem(&["plan", "why", "last"]).success().contains("goal        (up b)\n"));
    // The goal is kept for the next time.
    lab.rmem(&["insert", "robmem.orders", "{}"]).success();
    assert!(lab.rmem(&["plan", "rerun", "last"]).success().contains("(go a)"));
}

/// A lab with documents whose keys have numbers and texts.
fn typed() -> Lab {
    let lab = lab();
    lab.write(
        "w.json",
        "{'a.n': [{_id: 1, n: 3, t: '3', d: NumberDecimal('3'), x: null, o: ObjectId('65a000000000000000000001')}]}",
    );
    lab
}

/// Renders an expression of the document as the condition of an atom.
#[track_caller]
fn conditional(condition: &str) -> crate::lab::Finished {
    let lab = typed();
    lab.write(
        "t.j2",
        &format!("(define (problem p) (:domain d) (:objects A)\n(:init {{% for r in query('a.n', {{}}) %}}{{% if {condition} %}} (idle A){{% endif %}}{{% endfor %}})\n(:goal (and)))"),
    );
    lab.rmem(&["--memory", "mem:", "--load", "w.json", "gen-problem", "-t", "t.j2", "-d", "d.pddl", "-D", "p=3"])
}

#[test]
fn a_number_compared_with_a_text_that_reads_as_it_is_a_warning() {
    assert_run!(conditional("r.n == '3' or p == ''"), @r#"
    (define (problem p) (:domain d) (:objects A)
    (:init )
    (:goal (and)))------- stderr -------
    warning: t.j2:2:45: 3 (a number) and "3" (a text) are never equal
      |
    2 | (:init {% for r in query('a.n', {}) %}{% if r.n == '3' or p == '' %} (idle A){% endif %}{% endfor %}
      |                                             ^^^^^^^^^^
      = hint: write 3 without quotes
    [exit code: 0]
    "#);
    assert_run!(conditional("r.n == p"), @r#"
    (define (problem p) (:domain d) (:objects A)
    (:init )
    (:goal (and)))------- stderr -------
    warning: t.j2:2:45: 3 (a number) and "3" (a text) are never equal
      |
    2 | (:init {% for r in query('a.n', {}) %}{% if r.n == p %} (idle A){% endif %}{% endfor %})
      |                                             ^^^^^^^^
      = hint: write p|int, or give it as a number: -D p:=3
    [exit code: 0]
    "#);
    for (condition, wanted) in [
        ("r.t != 3 and p", "\"3\" (a text) and 3 (a number) are never equal\n  = hint: write r.t|int"),
        ("p == r['n']", "= hint: write p|int"),
        ("r.n not in ['1', '3'] and p", "= hint: write r.n|string"),
        ("p in [1, r.n]", "= hint: write p|int"),
        ("r.d == 3 and p", "3 (a decimal) and 3 (a number) are never equal\n  = hint: write r.d|number"),
        ("r.o == '65a000000000000000000001' and p", "= hint: write r.o|string"),
        (
            "r.n + 0.5 == '3.5' and p",
            "3.5 (a number) and \"3.5\" (a text) are never equal\n  = hint: write 3.5 without quotes",
        ),
    ] {
        let said = conditional(condition).to_string();
        let lines: Vec<&str> = said.lines().filter(|line| !line.contains(" |")).collect();
        assert!(lines.join("\n").contains(wanted), "{condition}: {said}");
        assert_eq!(said.matches("warning:").count(), 1, "{said}");
    }
    for alike in [
        "r.n == 3 and p",
        "r.t == '3' and p",
        "r.n != '4' and p",
        "r.n in [3, '3'] and p",
        "r.n == 3.0 and p",
        "r.x == 3 and p",
    ] {
        let said = conditional(alike).to_string();
        assert!(!said.contains("warning"), "{alike}: {said}");
    }
}

#[test]
fn values_without_an_order_are_not_ordered() {
    assert_run!(conditional("r.n > '3' and p"), @r#"
    ------- stderr -------
    error: t.j2:2:45: 3 (a number) and "3" (a text) have no order
      |
    2 | (:init {% for r in query('a.n', {}) %}{% if r.n > '3' and p %} (idle A){% endif %}{% endfor %})
      |                                             ^^^^^^^^^
      = hint: write 3 without quotes
    [exit code: 3]
    "#);
    assert_run!(conditional("p and 2 < r.x <= 5"), @r"
    ------- stderr -------
    error: t.j2:2:51: 2 (a number) and null have no order
      |
    2 | (:init {% for r in query('a.n', {}) %}{% if p and 2 < r.x <= 5 %} (idle A){% endif %}{% endfor %})
      |                                                   ^^^^^^^
      = hint: test for null first: {% if r.x is not none and … %}
    [exit code: 3]
    ");
    assert_run!(conditional("p and [r]|selectattr('t', 'gt', 2)|list"), @r#"
    ------- stderr -------
    error: t.j2:2:55: "3" (a text) and 2 (a number) have no order
      |
    2 | (:init {% for r in query('a.n', {}) %}{% if p and [r]|selectattr('t', 'gt', 2)|list %} (idle A){% en
      |                                                       ^^^^^^^^^^^^^^^^^^^^^^^^
      = hint: convert one of them, for example with `|int`
    [exit code: 3]
    "#);
    assert_run!(conditional("p and r.d >= 2"), @r"
    ------- stderr -------
    error: t.j2:2:51: 3 (a decimal) and 2 (a number) have no order
      |
    2 | (:init {% for r in query('a.n', {}) %}{% if p and r.d >= 2 %} (idle A){% endif %}{% endfor %})
      |                                                   ^^^^^^^^
      = hint: write r.d|number
    [exit code: 3]
    ");
}

#[test]
fn a_goal_that_no_document_fills_is_a_warning() {
    let lab = lab();
    lab.write("w.json", "{'a.b': [{_id: 1, name: 'A'}]}");
    let goal = "(:goal (and {% for r in query('a.b', {'lost': true}) %}\n  (up {{ r.name }}){% endfor %})))";
    lab.write("t.j2", &format!("(define (problem p) (:domain d) (:objects A)\n(:init (idle A))\n{goal}"));
    let run = |command: &[&str]| {
        lab.rmem(&[&["--memory", "mem:", "--load", "w.json"], command, &["-t", "t.j2", "-d", "d.pddl"]].concat())
    };
    assert_run!(run(&["gen-problem"]), @r#"
    (define (problem p) (:domain d) (:objects A)
    (:init (idle A))
    (:goal (and )))------- stderr -------
    warning: line 3: query('a.b', {'lost': true}) in a.b: 0 documents
      a.b: 1 document, 0 match
        alone  together  condition
            0         0  {"lost":true}
                         no document has the key `lost`; there are _id, name
    warning: t.j2:3:8: the goal is empty, so nothing has to be done
      |
    3 | (:goal (and {% for r in query('a.b', {'lost': true}) %}
      |        ^
      = hint: it became line 3 of the problem: (:goal (and )))
      = hint: line 3: query('a.b', {'lost': true}) matched no document
    [exit code: 0]
    "#);
    assert_run!(run(&["plan", "--no-store"]), @r#"
    ; cost = 0 (unit cost)
    ------- stderr -------
    warning: line 3: query('a.b', {'lost': true}) in a.b: 0 documents
      a.b: 1 document, 0 match
        alone  together  condition
            0         0  {"lost":true}
                         no document has the key `lost`; there are _id, name
    warning: t.j2:3:8: the goal is empty, so nothing has to be done
      |
    3 | (:goal (and {% for r in query('a.b', {'lost': true}) %}
      |        ^
      = hint: it became line 3 of the problem: (:goal (and )))
      = hint: line 3: query('a.b', {'lost': true}) matched no document
    [exit code: 0]
    "#);
    // One that is written so is meant.
    lab.write("t.j2", "(define (problem p) (:domain d) (:init {% for r in query('a.b', {'lost': true}) %}(up A){% endfor %}) (:goal (and)))");
    assert!(!run(&["gen-problem"]).to_string().contains("goal is empty"));
}

#[test]
fn what_is_not_pddl_has_a_warning_also_where_no_domain_checks_it() {
    let lab = Lab::new().env("RMEM_MEMORY", "mem:");
    let metric = "(:metric minimize {% for r in query('a.b') %}{{ r.n }}{% endfor %})";
    lab.write("t.j2", &format!("(define (problem p) (:domain d) // one\n (:goal (x))\n {metric})"));
    lab.write(
        "t.tmpl",
        "(define (problem p) (:domain d) ; http://one // two\n (:metric minimize <<#N|{n: 1}>><<n>><</N>>))",
    );
    lab.write("d.pddl", "(define (domain d) (:predicates (x)))");
    let warnings = |args: &[&str]| {
        let text = lab.rmem(&[&["gen-problem", "-o", "p.pddl"], args].concat()).exits(0).to_string();
        let lines = text.lines().filter(|line| line.starts_with("warning: t.") || line.contains("hint: "));
        lines.map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(
        warnings(&["-t", "t.j2"]),
        [
            "warning: t.j2:3:2: the metric is empty, which is not PDDL",
            "  = hint: this is written (:metric minimize EXPRESSION); leave all of it out where there is no expression",
            "  = hint: it became line 3 of the problem: (:metric minimize ))",
            "warning: t.j2:1:33: the problem has a comment that begins with `//`, which is not PDDL",
            "  = hint: comments begin with `;`; rmem reads `//` with --lenient, planners and other programs do not",
            "  = hint: it became line 1 of the problem: (define (problem p) (:domain d) // one",
        ]
    );
    assert_eq!(warnings(&["-t", "t.tmpl"]).len(), 3);
    lab.write("t.j2", "(define (problem p) (:domain d) // one\n (:init) (:goal (x)))");
    assert_eq!(warnings(&["-t", "t.j2", "-d", "d.pddl", "--lenient"]).len(), 3);
    lab.write("t.j2", "(define (problem p) (:domain d) ; one // two\n (:init) (:goal (x)))");
    assert_eq!(warnings(&["-t", "t.j2"]), [""; 0]);
}

#[test]
fn a_problem_does_not_replace_what_it_is_made_from() {
    let lab = lab();
    lab.write("t.j2", "(define (problem p) (:domain d) (:init {% include 'part.j2' %}) (:goal (and)))");
    lab.write("part.j2", "(idle A)");
    let write = |output: &'static str| ["gen-problem", "-t", "t.j2", "-d", "d.pddl", "-o", output];
    assert_run!(lab.transcript(&["./t.j2", "d.pddl", "part.j2"].map(write).each_ref().map(|args| &args[..])), @r"
    $ rmem gen-problem -t t.j2 -d d.pddl -o ./t.j2
    ------- stderr -------
    error: cannot write the problem to t.j2: the problem is made from it; expected another file for --output
    [exit code: 2]
    $ rmem gen-problem -t t.j2 -d d.pddl -o d.pddl
    ------- stderr -------
    error: cannot write the problem to d.pddl: the problem is made from it; expected another file for --output
    [exit code: 2]
    $ rmem gen-problem -t t.j2 -d d.pddl -o part.j2
    ------- stderr -------
    error: cannot write the problem to part.j2: the problem is made from it; expected another file for --output
    [exit code: 2]
    ");
    assert_eq!((lab.read("part.j2"), lab.read("d.pddl")), ("(idle A)".to_owned(), DOMAIN.to_owned()));
}

#[test]
fn a_marker_with_a_query_of_the_wrong_kind_gets_its_bars() {
    let lab = Lab::new().env("RMEM_MEMORY", "mem:");
    let refused = |template: &str| {
        lab.write("t.tmpl", template);
        lab.rmem(&["gen-problem", "-t", "t.tmpl", "--syntax", "marker"]).exits(3).stderr
    };
    let pipeline = refused("<<#ONT|[{$match: {a: 1}}]>>x<</ONT>>");
    assert!(pipeline.contains("= hint: a pipeline has two bars: <<#ONT||[…]>>"), "{pipeline}");
    let bare = refused("<<#ONT{is: 'on'}>>x<</ONT>>");
    assert!(bare.contains("expected `|` before the query, found `{`") && !bare.contains('\\'), "{bare}");
}

#[test]
fn a_template_only_reads() {
    let lab = Lab::new();
    lab.write("out.j2", r#"{% for m in aggregate("robmem.worldmodel", "[{$out: 'copied'}]") %}{% endfor %}"#);
    lab.write("merge.pddl", "(define (problem p) (:init <<#A||[{$match: {}}, {$merge: 'copied'}]>>(x)<</A>>))");
    assert_run!(lab.rmem(&["gen-problem", "-t", "out.j2"]), @r#"
    ------- stderr -------
    error: out.j2:1:13: $out writes, and here a pipeline only reads; `rmem aggregate` runs it
      |
    1 | {% for m in aggregate("robmem.worldmodel", "[{$out: 'copied'}]") %}{% endfor %}
      |             ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    "#);
    assert_run!(lab.rmem(&["gen-problem", "-t", "merge.pddl"]), @r"
    ------- stderr -------
    error: merge.pddl:1:34: $merge writes, and here a pipeline only reads; `rmem aggregate` runs it
      |
    1 | (define (problem p) (:init <<#A||[{$match: {}}, {$merge: 'copied'}]>>(x)<</A>>))
      |                                  ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    [exit code: 3]
    ");
    let plot = ["plot", "robmem.worldmodel", "[{$out: 'copied'}]", "--x", "a", "--y", "b", "-o", "p.svg"];
    lab.rmem(&plot).exits(3);
    assert!(!lab.rmem(&["collections"]).success().contains("copied"));
}
