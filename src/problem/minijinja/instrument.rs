//! Makes a minijinja template say where it is.
//!
//! Minijinja passes neither to a function nor to the formatter which place of the
//! template called it. So each `{{ x }}` becomes `{{( x )|_at(n)}}`, and each
//! `query(…)` becomes `query(n, …)`, where `n` is the number of the place.
//! [`Instrumented::original`] turns offsets of the result back.
//! A template whose name is computed, as in `{% include x %}`, goes through a function: `{% include _part(x, false) %}`.
//! Fixed text gets a mark, `OPEN-nCLOSE`, in front of its first character that is no white space. A `{% filter x %}` becomes
//! `{% filter x|_block(n) %}`. Comparisons and the operands of
//! `~` and `+` get filters, see [`comparisons`] and [`operands`].

use std::collections::{BTreeMap, HashSet};

use super::compared::Side;
use super::comparisons::comparisons;
use super::fixed::Fixed;
use super::naming::{Given, Names, Naming};
use super::operands::operands;
use super::plan::{Plan, Planned, ROWS, plan};
use super::tags::{TagKind, tags};
use super::value::{CLOSE, OPEN};
use crate::formats::Span;

/// The functions that get their place.
pub(in crate::problem) const PLACED: [&str; 5] = ["query", "find_one", "count", "distinct", "aggregate"];

/// The filter that gets its place.
pub(super) const AT: &str = "_at";

/// The same, for a `{% filter %}` block: its text has to remain text.
pub(super) const BLOCK: &str = "_block";

/// The function that finds out which template a computed name means.
pub(super) const PART: &str = "_part";

/// The places that have a number, in all texts.
#[derive(Debug, Default)]
pub(super) struct Numbered {
    /// Expressions, filters and calls.
    pub(super) sites: Vec<Span>,
    /// The sites whose text is written as it is.
    pub(super) written: HashSet<usize>,
    /// Stretches of fixed text.
    pub(super) texts: Vec<Span>,
    /// Loops that are written without minijinja.
    pub(super) plans: Vec<Plan>,
    /// The names of templates that may be computed.
    pub(super) names: Names,
    /// The two sides of each comparison, by its site.
    pub(super) compared: BTreeMap<usize, (Side, Side)>,
}

/// A template with its places numbered.
#[derive(Debug, Default)]
pub(super) struct Instrumented {
    /// What minijinja gets.
    pub(super) text: String,
    /// The offset of the original among the texts.
    base: usize,
    /// Where text was inserted or left out, as offsets of the result, how much was inserted, and how much left out.
    changed: Vec<(usize, usize, usize)>,
}

impl Instrumented {
    /// The original offset, among the texts, of an offset in the result.
    pub(super) fn original(&self, offset: usize) -> usize {
        let (mut inserted, mut left_out) = (0, 0);
        for (at, length, without) in &self.changed {
            if offset < at + length {
                return self.base + left_out + offset.min(*at) - inserted;
            }
            inserted += length;
            left_out += without;
        }
        self.base + left_out + offset - inserted
    }

    /// Whether the offset of the result is in what was inserted.
    pub(super) fn is_inserted(&self, offset: usize) -> bool {
        self.changed.iter().any(|(at, length, _)| (*at..at + length).contains(&offset))
    }

    fn insert(&mut self, text: &str) {
        self.replace(0, text);
    }

    /// Inserts text in place of so many bytes of the original.
    fn replace(&mut self, length: usize, text: &str) {
        self.changed.push((self.text.len(), text.len(), length));
        self.text.push_str(text);
    }
}

/// Numbers the places of a template, whose first byte is at `base` among the texts; `all` are these texts. Without `is_noted`,
/// only calls get their place, and loops that do without minijinja get a plan instead.
pub(super) fn instrument(
    template: &str,
    base: usize,
    all: &[&str],
    is_noted: bool,
    numbered: &mut Numbered,
) -> Instrumented {
    let mut result = Instrumented { base, ..Instrumented::default() };
    let Fixed { stretches, written } = if is_noted { Fixed::of(template, all) } else { Fixed::default() };
    let mut stretches = stretches.into_iter().peekable();
    // A template with a macro of that name would be called instead.
    let is_planned = !is_noted && !all.iter().any(|text| text.contains(ROWS));
    let mut offset = 0;
    let mut text = |span: Span, numbered: &mut Numbered, result: &mut Instrumented| {
        let stretch = stretches.next_if(|stretch| stretch.start < span.end);
        let at = stretch.map_or(span.end, |stretch| stretch.start);
        result.text.push_str(&template[span.start..at]);
        if let Some(stretch) = stretch {
            result.insert(&format!("{OPEN}-{}{CLOSE}", numbered.texts.len()));
            numbered.texts.push(Span::new(base + stretch.start, base + stretch.end));
        }
        result.text.push_str(&template[at..span.end]);
    };
    let mut all_tags = tags(template);
    while let Some(tag) = all_tags.next() {
        if tag.span.start < offset {
            continue;
        }
        text(Span::new(offset, tag.span.start), numbered, &mut result);
        if is_planned && let Some(planned) = plan(template, &tag, all_tags.clone()) {
            offset = planned.end;
            planned_loop(template, tag.span, planned, numbered, &mut result);
            continue;
        }
        if written.contains(&tag.span.start) {
            numbered.written.insert(numbered.sites.len());
        }
        match tag.kind {
            TagKind::Comment => result.text.push_str(tag.text),
            TagKind::Raw => text(tag.span, numbered, &mut result),
            TagKind::Expression if !is_noted => calls(template, tag.span, numbered, &mut result),
            TagKind::Statement if tag.word() == "filter" => filter(template, tag.span, numbered, &mut result),
            TagKind::Statement => match Naming::of(&tag).filter(|naming| !matches!(naming.given(), Given::Name(_))) {
                Some(naming) => part(template, tag.span, &naming, numbered, &mut result),
                None => calls(template, tag.span, numbered, &mut result),
            },
            TagKind::Expression => expression(template, tag.span, numbered, &mut result),
        }
        offset = tag.span.end;
    }
    text(Span::new(offset, template.len()), numbered, &mut result);
    result
}

/// `{% for r in query(…) %}…{% endfor %}` to `{{ _rows(n, query(…)) }}`.
fn planned_loop(template: &str, head: Span, planned: Planned, numbered: &mut Numbered, result: &mut Instrumented) {
    let Planned { plan, documents, trims, end } = planned;
    let mark = |is_trimmed: bool| if is_trimmed { "-" } else { "" };
    result.replace(documents.start - head.start, &format!("{{{{{} {ROWS}({}, ", mark(trims.0), numbered.plans.len()));
    calls(template, documents, numbered, result);
    result.replace(end - documents.end, &format!(") {}}}}}", mark(trims.1)));
    let documents = Span::new(result.base + documents.start, result.base + documents.end);
    numbered.plans.push(Plan { documents, ..plan });
}

/// `{{ x }}` to `{{( x )|_at(n)}}`.
fn expression(template: &str, tag: Span, numbered: &mut Numbered, result: &mut Instrumented) {
    let text = &template[tag.start..tag.end];
    let Some(inner) = text.strip_suffix("}}").filter(|inner| inner.len() > 2) else {
        return result.text.push_str(text);
    };
    let open = 2 + usize::from(inner[2..].starts_with(['-', '+']));
    let close = inner.len() - usize::from(inner.len() > open && inner.ends_with(['-', '+']));
    if inner[open..close].trim().is_empty() {
        return result.text.push_str(text);
    }
    result.text.push_str(&text[..open]);
    result.insert("(");
    let site = numbered.sites.len();
    numbered.sites.push(Span::new(result.base + tag.start, result.base + tag.end));
    calls(template, Span::new(tag.start + open, tag.start + close), numbered, result);
    result.insert(&format!(")|{AT}({site})"));
    result.text.push_str(&text[close..]);
}

/// `{% include x %}` to `{% include _part(x, false) %}`.
fn part(template: &str, tag: Span, naming: &Naming<'_>, numbered: &mut Numbered, result: &mut Instrumented) {
    numbered.sites.push(Span::new(result.base + tag.start, result.base + tag.end));
    let start = tag.start + naming.at;
    let end = start + naming.expression.len();
    result.text.push_str(&template[tag.start..start]);
    result.insert(&format!("{PART}("));
    calls(template, Span::new(start, end), numbered, result);
    result.insert(&format!(", {})", naming.is_optional));
    result.text.push_str(&template[end..tag.end]);
}

/// `{% filter x %}` to `{% filter x|_block(n) %}`.
fn filter(template: &str, tag: Span, numbered: &mut Numbered, result: &mut Instrumented) {
    let site = numbered.sites.len();
    numbered.sites.push(Span::new(result.base + tag.start, result.base + tag.end));
    let text = &template[tag.start..tag.end];
    let code = text.strip_suffix("%}").map(|code| code.trim_end_matches(['-', '+']).trim_end());
    let Some(code) = code.filter(|code| !code.ends_with("filter")) else {
        return result.text.push_str(text);
    };
    calls(template, Span::new(tag.start, tag.start + code.len()), numbered, result);
    result.insert(&format!("|{BLOCK}({site})"));
    result.text.push_str(&text[code.len()..]);
}

/// Copies a stretch of code, giving each call of such a function its number.
fn calls(template: &str, code: Span, numbered: &mut Numbered, result: &mut Instrumented) {
    let text = &template[code.start..code.end];
    let mut additions = additions(text, result.base + code.start, numbered).into_iter().peekable();
    let mut add = |at: usize, result: &mut Instrumented| {
        while let Some((_, addition)) = additions.next_if(|(offset, _)| *offset <= at) {
            result.insert(&addition);
        }
    };
    let mut open: Vec<Option<usize>> = Vec::new();
    let mut chars = text.char_indices().peekable();
    let (mut quote, mut escaped, mut called) = (None, false, None);
    let mut previous = String::new();
    while let Some((at, c)) = chars.next() {
        add(at, result);
        if let Some(mark) = quote {
            result.text.push(c);
            (escaped, quote) = if escaped { (false, quote) } else { (c == '\\', quote.filter(|_| c != mark)) };
            continue;
        }
        if c.is_alphabetic() || c == '_' {
            let rest = &text[at..];
            let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
            let name = &rest[..end];
            result.text.push_str(name);
            while chars.peek().is_some_and(|(next, _)| *next < at + end) {
                chars.next();
            }
            let own = PLACED.contains(&name) && !matches!(previous.as_str(), "." | "|" | "macro" | "is" | "block");
            called = own.then_some(at);
            name.clone_into(&mut previous);
            continue;
        }
        result.text.push(c);
        match c {
            _ if c.is_whitespace() => continue,
            '"' | '\'' => quote = Some(c),
            '(' => {
                let site = called.map(|name| {
                    let site = numbered.sites.len();
                    let start = result.base + code.start;
                    numbered.sites.push(Span::new(start + name, start + at + 1));
                    let empty = text[at + 1..].trim_start().starts_with(')');
                    result.insert(&if empty { site.to_string() } else { format!("{site}, ") });
                    site
                });
                open.push(site);
            }
            '[' | '{' => open.push(None),
            ')' | ']' | '}' => {
                if let Some(site) = open.pop().flatten().and_then(|site| numbered.sites.get_mut(site)) {
                    site.end = result.base + code.start + at + 1;
                }
            }
            _ => {}
        }
        called = None;
        previous.clear();
        previous.push(c);
    }
    add(text.len(), result);
}

/// What is added to the comparisons of the code, which is at `base` among the texts, in the order of its offsets.
fn additions(code: &str, base: usize, numbered: &mut Numbered) -> Vec<(usize, String)> {
    // Filters of operands stand before those of the comparisons that end with them.
    let mut additions = operands(code);
    for comparison in comparisons(code) {
        let site = numbered.sites.len();
        let side = |(start, end): (usize, usize)| Side {
            span: Span::new(base + start, base + end),
            text: code[start..end].split_whitespace().collect::<Vec<_>>().join(" "),
        };
        let (left, right) = (side(comparison.left), side(comparison.right));
        numbered.sites.push(Span::new(left.span.start, right.span.end));
        numbered.compared.insert(site, (left, right));
        additions.extend(comparison.additions(site));
    }
    additions.sort_by_key(|(at, _)| *at);
    additions
}

#[cfg(test)]
mod tests {
    use super::*;

    fn instrumented(template: &str) -> (Instrumented, Numbered) {
        let mut numbered = Numbered::default();
        (instrument(template, 0, &[template], true, &mut numbered), numbered)
    }

    #[test]
    fn numbers_expressions_and_calls() {
        for (template, wanted) in [
            ("a {{ x }} b", "<-0>a {{( x )|_at(0)}} <-1>b"),
            ("{{- x -}}", "{{-( x )|_at(0)-}}"),
            ("{% for d in query('a.b', {'x': {'y': 1}}) %}", "{% for d in query(0, 'a.b', {'x': {'y': 1}}) %}"),
            ("{% if doc.count (1) or x|count() %}", "{% if doc.count (1) or x|count() %}"),
            ("{{ count() }}", "{{( count(1) )|_at(0)}}"),
            ("{% raw %}{{ x }}{% endraw %}{# {{ x }} #}", "{% raw %}<-0>{{ x }}{% endraw %}{# {{ x }} #}"),
            ("{%- filter f(1) -%}a{% endfilter %}", "{%- filter f(1)|_block(0) -%}a{% endfilter %}"),
            ("{%- include x -%}", "{%- include _part(x, false) -%}"),
            ("{% import f(x) as y %}", "{% import _part(f(x), false) as y %}"),
            ("{% include ['a', 'b'] ignore missing %}", "{% include _part(['a', 'b'], true) ignore missing %}"),
            ("{% include 'a' %}{% extends \"b\" %}", "{% include 'a' %}{% extends \"b\" %}"),
            ("{% filter %}a{% endfilter %}", "{% filter %}a{% endfilter %}"),
            ("{{ '}}' ~ {'a': {}} }}", "{{( '}}' ~ {'a': {}}|_written )|_at(0)}}"),
            ("{{ 'count(' }}", "{{( 'count(' )|_at(0)}}"),
            ("{{ }} {{", "{{ }} {{"),
            ("{% if x -%} a\n{%- endif %}", "{% if x -%} <-0>a\n{%- endif %}"),
        ] {
            assert_eq!(instrumented(template).0.text.replace(OPEN, "<").replace(CLOSE, ">"), wanted);
        }
    }

    #[test]
    fn turns_offsets_back() {
        let template = "é {{ a }} {% set x = count('n.s', {}) %} {{ b }}";
        let (result, numbered) = instrumented(template);
        for name in ["é", "a", "'n.s'", "b"] {
            let at = if name == "a" { result.text.find("( a").map(|at| at + 2) } else { result.text.rfind(name) };
            let original = if name == "a" { template.find("{{ a").map(|at| at + 3) } else { template.rfind(name) };
            assert_eq!(at.map(|at| result.original(at)), original, "{name}");
        }
        let call = numbered.sites[1];
        assert_eq!(&template[call.start..call.end], "count('n.s', {})");
        for offset in 0..result.text.len() + 5 {
            let _ = result.original(offset);
        }
    }
}
