//! The template that makes a problem of its documents again.
//!
//! Only what the problem has is in it, so that it is a beginning for templates of one's own.

use crate::formats::pddl::ast::{Condition, ConditionKind, Expression, Init, Problem, Term};
use crate::problem::names;
use crate::store::Namespace;

/// Terms and atoms.
const TERM: &str = r#"
{%- macro term(t) -%}
{%- if t is not mapping %}{{ t }}{% elif t.variable is defined %}?{{ t.variable }}{% else %}{{ call(t) }}{% endif -%}
{%- endmacro -%}
{%- macro call(c) -%}
({{ c.name }}{% for a in c.args %} {{ term(a) }}{% endfor %})
{%- endmacro -%}
"#;

/// Arithmetic.
const EXPRESSION: &str = r##"
{%- macro expression(e) -%}
{%- if e is mapping and e.op is defined -%}
({% if e.op == "+" %}+{% elif e.op == "-" %}-{% elif e.op == "*" %}*{% else %}/{% endif %}{% for p in e.parts %} {{ expression(p) }}{% endfor %})
{%- elif e is mapping and e.elapsed is defined %}#t
{%- else %}{{ term(e) }}{% endif -%}
{%- endmacro -%}
"##;

/// Types after a dash.
const KIND: &str = r#"
{%- macro kind(t) -%}
{%- if t.type is not defined %} - object
{%- elif t.type is string %} - {{ t.type }}
{%- else %} - (either{% for one in t.type %} {{ one }}{% endfor %}){% endif -%}
{%- endmacro -%}
"#;

/// Conditions. Operators are written out, because a value is never one.
const CONDITION: &str = r#"
{%- macro condition(c) -%}
{%- if c.op is not defined %}{{ call(c) }}
{%- elif c.left is defined -%}
({% if c.op == "<" %}<{% elif c.op == "<=" %}<={% elif c.op == ">" %}>{% elif c.op == ">=" %}>={% else %}={% endif %} {{ expression(c.left) }} {{ expression(c.right) }})
{%- elif c.variables is defined -%}
({% if c.op == "forall" %}forall{% else %}exists{% endif %} ({% for v in c.variables %}?{{ v.name }}{{ kind(v) }} {% endfor %}){% for p in c.parts %} {{ condition(p) }}{% endfor %})
{%- else -%}
({% if c.op == "and" %}and{% elif c.op == "or" %}or{% elif c.op == "not" %}not{% elif c.op == "imply" %}imply
{%- elif c.op == "preference" %}preference{% if c.name is defined %} {{ c.name }}{% endif %}
{%- elif c.op == "at start" %}at start{% elif c.op == "at end" %}at end{% elif c.op == "over all" %}over all
{%- elif c.op == "always" %}always{% elif c.op == "sometime" %}sometime{% elif c.op == "at-most-once" %}at-most-once
{%- elif c.op == "sometime-after" %}sometime-after{% elif c.op == "sometime-before" %}sometime-before
{%- elif c.op == "within" %}within{% elif c.op == "hold-after" %}hold-after
{%- elif c.op == "always-within" %}always-within{% else %}hold-during{% endif %}
{%- if c.numbers is defined %}{% for n in c.numbers %} {{ n }}{% endfor %}{% endif %}
{%- for p in c.parts %} {{ condition(p) }}{% endfor %})
{%- endif -%}
{%- endmacro -%}
"#;

pub(super) fn write(tree: &Problem, namespace: &Namespace) -> String {
    let needs = Needs::of(tree);
    let mut text = format!("{{%- set world = \"{namespace}\" -%}}");
    for (is_needed, part) in
        [(needs.terms, TERM), (needs.expressions, EXPRESSION), (needs.kinds, KIND), (needs.conditions, CONDITION)]
    {
        if is_needed {
            text.push_str(part);
        }
    }
    text.push_str(&format!("\n(define (problem {})\n", names::mangle(&names::restore(tree.name.as_str()))));
    if let Some(domain) = &tree.domain {
        text.push_str(&format!("  (:domain {domain})\n"));
    }
    if !tree.requirements.is_empty() {
        let words: Vec<&str> = tree.requirements.iter().map(|word| word.as_str()).collect();
        text.push_str(&format!("  (:requirements {})\n", words.join(" ")));
    }
    text.push_str(&objects(tree));
    text.push_str(&init(tree, &needs));
    if let Some(goal) = &tree.goal {
        text.push_str(&self::goal(goal));
    }
    if tree.constraints.is_some() {
        text.push_str(
            "  (:constraints {% for c in query(world, \"{relation: 'domain-constraints'}\") %}{{ condition(c.condition) }}{% endfor %})\n",
        );
    }
    if let Some(metric) = &tree.metric {
        let direction = if metric.minimize { "minimize" } else { "maximize" };
        text.push_str(&format!(
            "  (:metric {direction} {{% for m in query(world, \"{{relation: 'domain-metric'}}\") %}}{{{{ expression(m.expression) }}}}{{% endfor %}})\n"
        ));
    }
    if !tree.length.is_empty() {
        let parts: Vec<String> = tree.length.iter().map(|(name, number)| format!("({name} {number})")).collect();
        text.push_str(&format!("  (:length {})\n", parts.join(" ")));
    }
    text.push_str(")\n");
    text
}

/// The macros that a problem asks for.
#[derive(Default)]
struct Needs {
    terms: bool,
    expressions: bool,
    kinds: bool,
    conditions: bool,
    /// Whether values of functions are more than numbers and names.
    values: bool,
}

impl Needs {
    fn of(tree: &Problem) -> Self {
        let (parts, _) = parts(tree.goal.as_ref());
        let conditions = tree.constraints.is_some() || !parts.iter().all(is_plain_atom);
        let values = tree.init.iter().any(|element| match element {
            Init::Value(_, value) => !matches!(value, Expression::Number(..) | Expression::Term(Term::Name(_))),
            _ => false,
        });
        let calls = tree.init.iter().any(|element| match element {
            Init::Atom(atom) | Init::Not(atom) | Init::At(_, _, atom) => has_calls(&atom.arguments),
            Init::Value(Term::Call(atom), _) => has_calls(&atom.arguments),
            Init::Value(..) => false,
        });
        let expressions = conditions || values || tree.metric.is_some();
        let kinds = conditions || tree.objects.iter().any(|object| object.kind.is_some());
        Self { terms: expressions || calls, expressions, kinds, conditions, values }
    }
}

fn has_calls(terms: &[Term]) -> bool {
    terms.iter().any(|term| !matches!(term, Term::Name(_)))
}

/// The parts of a goal, and whether it is a conjunction of them.
fn parts(goal: Option<&Condition>) -> (&[Condition], bool) {
    match goal {
        None => (&[], true),
        Some(Condition { kind: ConditionKind::And(parts), .. }) => (parts, true),
        Some(goal) => (std::slice::from_ref(goal), false),
    }
}

fn is_plain_atom(condition: &Condition) -> bool {
    matches!(&condition.kind, ConditionKind::Atom(atom) if !has_calls(&atom.arguments))
}

fn objects(tree: &Problem) -> String {
    if tree.objects.is_empty() {
        return String::new();
    }
    let typed = tree.objects.iter().any(|object| object.kind.is_some());
    let kind = if typed { "{{ kind(object) }}" } else { "" };
    format!(
        "  (:objects\n{}    {{{{ object.name }}}}{kind}\n{{%- endfor %}}\n  )\n",
        each("object", "relation: 'domain-object'")
    )
}

/// A loop over documents in the order of the problem.
fn each(name: &str, filter: &str) -> String {
    format!("{{%- for {name} in query(world, \"{{{filter}}}\", sort=\"{{_id: 1}}\") %}}\n")
}

fn init(tree: &Problem, needs: &Needs) -> String {
    let value = if needs.terms { "{{ term(value) }}" } else { "{{ value }}" };
    let atom = format!("({{{{ fact.name }}}}{{% for value in fact.param_values %}} {value}{{% endfor %}})");
    let mut text = "  (:init\n".to_owned();
    let mut section = |is_there: bool, filter: &str, line: &str| {
        if is_there {
            text.push_str(&format!("{}    {line}\n{{%- endfor %}}\n", each("fact", filter)));
        }
    };
    let any = |test: fn(&Init) -> bool| tree.init.iter().any(test);
    let value = if needs.values { "{{ expression(fact.value) }}" } else { "{{ fact.value }}" };
    let bare = "fact.param_values is defined";
    section(
        any(|element| matches!(element, Init::Atom(_))),
        "relation: 'domain-fact', negated: {$exists: false}",
        &atom,
    );
    section(
        any(|element| matches!(element, Init::Not(_))),
        "relation: 'domain-fact', negated: true",
        &format!("(not {atom})"),
    );
    section(
        any(|element| matches!(element, Init::Value(..))),
        "relation: 'domain-function'",
        &format!("(= {{% if {bare} %}}{atom}{{% else %}}{{{{ fact.name }}}}{{% endif %}} {value})"),
    );
    section(
        any(|element| matches!(element, Init::At(_, true, _))),
        "relation: 'domain-timed-fact', negated: {$exists: false}",
        &format!("(at {{{{ fact.time }}}} {atom})"),
    );
    section(
        any(|element| matches!(element, Init::At(_, false, _))),
        "relation: 'domain-timed-fact', negated: true",
        &format!("(at {{{{ fact.time }}}} (not {atom}))"),
    );
    text.push_str("  )\n");
    text
}

fn goal(goal: &Condition) -> String {
    let (parts, conjunction) = parts(Some(goal));
    let part = match parts.iter().all(is_plain_atom) && !parts.is_empty() {
        true => "({{ part.condition.name }}{% for value in part.condition.args %} {{ value }}{% endfor %})",
        false => "{{ condition(part.condition) }}",
    };
    let (open, close) = if conjunction { ("(and", ")") } else { ("", "") };
    format!(
        "  (:goal {{% if goal is defined %}}{{{{ goal }}}}{{% else %}}{open}\n{}    {part}\n{{%- endfor %}}{close}{{% endif %}})\n",
        each("part", "relation: 'domain-goal'")
    )
}
