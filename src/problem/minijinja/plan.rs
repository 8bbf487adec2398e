//! Loops over documents that do without minijinja: their bodies are fixed text, keys of the document, and conditions on
//! such keys.
//!
//! `{% for r in query(…) %}(on {{ r.a }} {{ r.b }}){% endfor %}` becomes `{{ _rows(n, query(…)) }}`, where `n` is the number
//! of the loop's plan, and [`rows`](super::rows) writes what the loop would. This is only where nothing is noted of what is
//! written: what is wrong in a row makes the problem doubtful, and minijinja finds it again and says so.

use std::iter::Peekable;

use super::comparisons::comparisons;
use super::tags::{Tag, TagKind};
use crate::formats::Span;
use crate::store::metadata;

/// The function that a planned loop is given to.
pub(super) const ROWS: &str = "_rows";

/// How deep conditions may nest in a plan.
const MAX_DEPTH: usize = 16;
/// The functions whose documents are gone through.
const ASKING: [&str; 2] = ["query(", "aggregate("];
/// Names that minijinja does not let a loop set.
const RESERVED: [&str; 10] = ["true", "True", "false", "False", "none", "None", "loop", "self", "in", "not"];

/// What a loop writes for each document.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Plan {
    /// The keys of the document that are looked at, each once.
    pub(super) keys: Vec<String>,
    pub(super) steps: Vec<Step>,
    /// Where what is gone through is written, among the texts.
    pub(super) documents: Span,
}

#[derive(Debug, PartialEq, Eq)]
pub(super) enum Step {
    Text(String),
    Value(Path),
    /// The steps of the first of these conditions that is true, or the others.
    Choice(Vec<(Condition, Vec<Step>)>, Vec<Step>),
}

/// A key of the document, by its number, and keys within its value.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Path {
    pub(super) key: usize,
    pub(super) inner: Vec<String>,
}

#[derive(Debug, PartialEq, Eq)]
pub(super) enum Condition {
    Holds(Path),
    Equals(Path, String),
    Not(Box<Condition>),
    All(Vec<Condition>),
    Any(Vec<Condition>),
}

/// A loop that has a plan, and where its parts are in the template.
pub(super) struct Planned {
    pub(super) plan: Plan,
    /// What is gone through.
    pub(super) documents: Span,
    /// Whether white space goes before the loop, and behind it.
    pub(super) trims: (bool, bool),
    pub(super) end: usize,
}

/// The code of a tag between its brackets and marks, and whether white space goes before and behind it.
struct Inside<'a> {
    code: &'a str,
    start: usize,
    trims: (bool, bool),
}

impl<'a> Inside<'a> {
    fn of(tag: &Tag<'a>) -> Option<Self> {
        let inner = tag.text.get(2..)?;
        let inner =
            inner.strip_suffix("%}").or_else(|| inner.strip_suffix("}}")).or_else(|| inner.strip_suffix("#}"))?;
        let open = inner.strip_prefix(['-', '+']).unwrap_or(inner);
        let code = open.strip_suffix(['-', '+']).unwrap_or(open);
        let trims =
            (open.len() < inner.len() && inner.starts_with('-'), code.len() < open.len() && open.ends_with('-'));
        let (before, trimmed) = (inner.len() - open.len(), start(code));
        let start = tag.span.start + 2 + before + code.len() - trimmed.len();
        Some(Self { code: trimmed.trim_end_matches(is_blank), start, trims })
    }
}

/// Plans the loop that begins with `tag`, whose body and end follow in `tags`; nothing where it needs minijinja.
pub(super) fn plan<'t>(template: &'t str, tag: &Tag<'t>, tags: impl Iterator<Item = Tag<'t>>) -> Option<Planned> {
    let head = Inside::of(tag).filter(|_| tag.kind == TagKind::Statement && tag.word() == "for")?;
    let rest = head.code.strip_prefix("for")?;
    let (target, rest) = word(start(rest.strip_prefix(is_blank)?))?;
    let documents = start(start(rest.strip_prefix(is_blank)?).strip_prefix("in")?.strip_prefix(is_blank)?);
    if RESERVED.contains(&target) || !is_call(documents) {
        return None;
    }
    let from = head.start + head.code.len() - documents.len();
    let mut body = Body {
        template,
        target,
        plan: Plan::default(),
        tags: tags.peekable(),
        from: tag.span.end,
        trims: head.trims.1,
    };
    let steps = body.steps(0)?;
    let end = body.tags.next().filter(|end| end.word() == "endfor")?;
    let inside = Inside::of(&end).filter(|inside| inside.code == "endfor")?;
    Some(Planned {
        plan: Plan { steps, documents: Span::default(), ..body.plan },
        documents: Span::new(from, from + documents.len()),
        trims: (head.trims.0, inside.trims.1),
        end: end.span.end,
    })
}

/// Whether the code is one call of a function that gives documents, and nothing else.
fn is_call(code: &str) -> bool {
    if !ASKING.iter().any(|name| code.starts_with(name)) {
        return false;
    }
    let (mut depth, mut quote, mut escaped) = (0_usize, None, false);
    for (at, c) in code.char_indices() {
        if let Some(mark) = quote {
            (escaped, quote) = if escaped { (false, quote) } else { (c == '\\', quote.filter(|_| c != mark)) };
            continue;
        }
        match c {
            '"' | '\'' => quote = Some(c),
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => {
                depth = depth.saturating_sub(1);
                if depth == 0 {
                    return at + 1 == code.len();
                }
            }
            _ => {}
        }
    }
    false
}

/// What minijinja passes over in code.
fn is_blank(c: char) -> bool {
    c.is_ascii_whitespace()
}

fn start(code: &str) -> &str {
    code.trim_start_matches(is_blank)
}

/// The name that the code begins with, and what follows.
fn word(code: &str) -> Option<(&str, &str)> {
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let (word, rest) = code.split_at(code.find(|c| !is_part(c)).unwrap_or(code.len()));
    // minijinja knows other letters, too.
    let is_whole = !word.is_empty() && rest.chars().next().is_none_or(|c| c.is_ascii());
    (is_whole && !word.starts_with(|c: char| c.is_ascii_digit())).then_some((word, rest))
}

/// The body of a loop, as it is read.
struct Body<'t, T: Iterator<Item = Tag<'t>>> {
    template: &'t str,
    /// The name of the document.
    target: &'t str,
    plan: Plan,
    tags: Peekable<T>,
    /// Where the text before the next tag begins, and whether its first white space goes.
    from: usize,
    trims: bool,
}

impl<'t, T: Iterator<Item = Tag<'t>>> Body<'t, T> {
    /// The steps up to the tag that ends or divides the block, which remains.
    fn steps(&mut self, depth: usize) -> Option<Vec<Step>> {
        let mut steps = Vec::new();
        loop {
            let tag = *self.tags.peek()?;
            let inside = Inside::of(&tag)?;
            let text = self.template.get(self.from..tag.span.start)?;
            let text = if self.trims { text.trim_start() } else { text };
            let text = if inside.trims.0 { text.trim_end() } else { text };
            if !text.is_empty() {
                steps.push(Step::Text(text.to_owned()));
            }
            (self.from, self.trims) = (tag.span.end, inside.trims.1);
            match (tag.kind, tag.word()) {
                (TagKind::Comment, _) if tag.text.len() > "{#--#}".len() => drop(self.tags.next()),
                (TagKind::Expression, _) => {
                    self.tags.next();
                    steps.push(Step::Value(self.path(inside.code)?));
                }
                (TagKind::Statement, "if") if depth < MAX_DEPTH => {
                    self.tags.next();
                    steps.push(self.choice(&tag, inside.code, depth + 1)?);
                }
                (TagKind::Statement, "elif" | "else" | "endif" | "endfor") => return Some(steps),
                _ => return None,
            }
        }
    }

    /// The rest of an `if`, whose tag was read.
    fn choice(&mut self, tag: &Tag<'t>, code: &str, depth: usize) -> Option<Step> {
        let mut ways = Vec::new();
        let (mut condition, mut steps) = (self.condition(tag, code.strip_prefix("if")?)?, self.steps(depth)?);
        loop {
            ways.push((condition, steps));
            let tag = self.tags.next()?;
            let code = Inside::of(&tag)?.code;
            match tag.word() {
                "elif" => (condition, steps) = (self.condition(&tag, code.strip_prefix("elif")?)?, self.steps(depth)?),
                "else" if code == "else" => {
                    let others = self.steps(depth)?;
                    let end = self.tags.next()?;
                    return (Inside::of(&end)?.code == "endif").then_some(Step::Choice(ways, others));
                }
                _ => return (code == "endif").then_some(Step::Choice(ways, Vec::new())),
            }
        }
    }

    /// `r.a.b`
    fn path(&mut self, code: &str) -> Option<Path> {
        let (path, rest) = self.path_and_rest(code)?;
        start(rest).is_empty().then_some(path)
    }

    fn path_and_rest<'c>(&mut self, code: &'c str) -> Option<(Path, &'c str)> {
        let (_, mut rest) = word(start(code)).filter(|(target, _)| *target == self.target)?;
        let mut names = Vec::new();
        while let Some(behind) = rest.strip_prefix('.') {
            let (name, after) = word(behind)?;
            names.push(name.to_owned());
            rest = after;
        }
        // A document itself is no value; `r.f(…)` and `r['a']` are for minijinja.
        if names.is_empty() || rest.starts_with(['(', '[']) {
            return None;
        }
        let first = names.remove(0);
        if first == metadata::INFO {
            return None;
        }
        let known = self.plan.keys.iter().position(|key| *key == first);
        let key = known.unwrap_or_else(|| {
            self.plan.keys.push(first);
            self.plan.keys.len() - 1
        });
        Some((Path { key, inner: names }, rest))
    }

    /// `r.a`, `not r.a`, `r.a == 'text'`, and these joined by `and` and `or`; nothing where the comparison is watched.
    fn condition(&mut self, tag: &Tag<'t>, code: &str) -> Option<Condition> {
        if !code.starts_with(is_blank) || !comparisons(tag.text).is_empty() {
            return None;
        }
        let (condition, rest) = self.any(code)?;
        start(rest).is_empty().then_some(condition)
    }

    fn any<'c>(&mut self, code: &'c str) -> Option<(Condition, &'c str)> {
        let (first, mut rest) = self.all(code)?;
        let mut parts = vec![first];
        while let Some(behind) = keyword(rest, "or") {
            let (part, after) = self.all(behind)?;
            parts.push(part);
            rest = after;
        }
        Some((if parts.len() > 1 { Condition::Any(parts) } else { parts.pop()? }, rest))
    }

    fn all<'c>(&mut self, code: &'c str) -> Option<(Condition, &'c str)> {
        let (first, mut rest) = self.one(code)?;
        let mut parts = vec![first];
        while let Some(behind) = keyword(rest, "and") {
            let (part, after) = self.one(behind)?;
            parts.push(part);
            rest = after;
        }
        Some((if parts.len() > 1 { Condition::All(parts) } else { parts.pop()? }, rest))
    }

    fn one<'c>(&mut self, code: &'c str) -> Option<(Condition, &'c str)> {
        if let Some(behind) = keyword(code, "not") {
            let (condition, rest) = self.one(behind)?;
            return Some((Condition::Not(Box::new(condition)), rest));
        }
        let (path, rest) = self.path_and_rest(code)?;
        let behind = start(rest);
        let (is_equal, literal) = match (behind.strip_prefix("=="), behind.strip_prefix("!=")) {
            (Some(literal), _) => (true, literal),
            (_, Some(literal)) => (false, literal),
            _ => return Some((Condition::Holds(path), rest)),
        };
        let literal = start(literal);
        let quote = literal.chars().next().filter(|c| ['"', '\''].contains(c))?;
        let (text, rest) = literal.get(1..)?.split_once(quote).filter(|(text, _)| !text.contains('\\'))?;
        let equals = Condition::Equals(path, text.to_owned());
        Some((if is_equal { equals } else { Condition::Not(Box::new(equals)) }, rest))
    }
}

/// What follows a word that the code begins with.
fn keyword<'c>(code: &'c str, wanted: &str) -> Option<&'c str> {
    word(start(code)).filter(|(word, _)| *word == wanted).map(|(_, rest)| rest)
}

#[cfg(test)]
mod tests {
    use super::super::tags::tags;
    use super::*;

    fn planned(template: &str) -> Option<Planned> {
        let mut tags = tags(template);
        let first = tags.next()?;
        plan(template, &first, tags)
    }

    #[test]
    fn a_loop_over_keys_has_a_plan() {
        let template = "{%- for r in query('a.b', {'x': '}'}) -%}\n (at {{ r.name }}{# - #} {{- r.p.x -}} )\
                        {% if r.on and not r.off or r.kind == 'box' %} on {% elif r.off %}{% else %}!{%- endif %}{% endfor -%} z";
        let Planned { plan, documents, trims, end } = planned(template).unwrap();
        assert_eq!(&template[documents.start..documents.end], "query('a.b', {'x': '}'})");
        assert_eq!((trims, &template[end..]), ((true, true), " z"));
        assert_eq!(plan.keys, ["name", "p", "on", "off", "kind"]);
        let path = |key, inner: &[&str]| Path { key, inner: inner.iter().map(|name| (*name).to_owned()).collect() };
        let text = |text: &str| Step::Text(text.to_owned());
        let all = vec![Condition::Holds(path(2, &[])), Condition::Not(Box::new(Condition::Holds(path(3, &[]))))];
        let any = Condition::Any(vec![Condition::All(all), Condition::Equals(path(4, &[]), "box".to_owned())]);
        let ways = vec![(any, vec![text(" on ")]), (Condition::Holds(path(3, &[])), vec![])];
        let wanted = [
            text("(at "),
            Step::Value(path(0, &[])),
            Step::Value(path(1, &["x"])),
            text(")"),
            Step::Choice(ways, vec![text("!")]),
        ];
        assert_eq!(plan.steps, wanted);
    }

    #[test]
    fn what_needs_minijinja_has_no_plan() {
        for body in [
            "{{ r }}",
            "{{ s.a }}",
            "{{ r.a|upper }}",
            "{{ r.a() }}",
            "{{ r['a'] }}",
            "{{ loop.index }}",
            "{{ -r.a }}",
            "{{--r.a }}",
            "{{ r.a --}}",
            "{{ r.a ~ r.b }}",
            "{{ r. a }}",
            "{{ r.1 }}",
            "{{ r.ä }}",
            "{{ r.aä }}",
            "{{ }}",
            "{{ r._robmem_info }}",
            "{% for s in query('a.b') %}{% endfor %}",
            "{% set a = 1 %}",
            "{% raw %}{% endraw %}",
            "{% if r.a == 3 %}{% endif %}",
            "{% if r.a == '3' %}{% endif %}",
            "{% if r.a < 'b' %}{% endif %}",
            "{% if (r.a) %}{% endif %}",
            "{% if r.a is defined %}{% endif %}",
            "{% if r.a == 'a\\n' %}{% endif %}",
            "{% if r.a == r.b %}{% endif %}",
            "{% if r.a %}",
            "{% if r.a %}{% else %}{% elif r.b %}{% endif %}",
            "{% if r.a %}{% else if %}{% endif %}",
            "{% if r.a == 'a' == 'b' %}{% endif %}",
            "{% ifr.a %}{% endif %}",
            "{% else %}",
            "{% endif %}",
            "{% if r.a 'b' %}{% endif %}",
            "{% if r.a and %}{% endif %}",
        ] {
            assert!(planned(&format!("{{% for r in query('a.b') %}}{body}{{% endfor %}}")).is_none(), "{body}");
        }
        for head in [
            "for r in rows",
            "for r in query('a.b')|list",
            "for r in query('a.b') if r.a",
            "for r, s in query('a.b')",
            "for r in query('a.b') recursive",
            "for loop in query('a.b')",
            "for in in query('a.b')",
            "for not in query('a.b')",
            "for r in query('a.b')[0]",
            "for r in query('a.b'",
            "for (r) in query('a.b')",
            "if query('a.b')",
            "forx in query('a.b')",
            "for r inquery('a.b')",
        ] {
            assert!(planned(&format!("{{% {head} %}}{{{{ r.a }}}}{{% endfor %}}")).is_none(), "{head}");
        }
        assert!(planned("{{ for r in query('a.b') }}{{ r.a }}{% endfor %}").is_none());
        assert!(planned("{% for r in query('a.b') %}{{ r.a }}").is_none());
        assert!(planned("{% for r in query('a.b') %}{{ r.a }}{% endfor").is_none());
        assert!(planned("{% for r in query('a.b') %}{{ r.a }}{% endfor x %}").is_none());
    }
}
