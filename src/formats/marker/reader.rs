//! Text to tree: markers by the grammar, sections by an explicit stack.

use pest::Parser as _;
use pest::iterators::Pair;

use super::{Node, Query, QueryKind, Section, Template};
use crate::formats::{Diagnostic, Source, Span};

/// How deep sections may be nested.
const MAX_DEPTH: usize = 100;

#[derive(pest_derive::Parser)]
#[grammar = "grammars/marker.pest"]
struct Grammar;

/// What rules are called in messages.
fn rename(rule: &Rule) -> String {
    match rule {
        Rule::EOI => "the end of the template",
        Rule::open | Rule::close | Rule::value | Rule::comment => "a marker",
        Rule::name => "a name of letters, digits, `_` and `-`",
        Rule::pipeline => "a pipeline",
        Rule::filter => "a query",
        _ => "text",
    }
    .to_owned()
}

/// A section whose end has not been seen.
struct Open {
    section: Section,
    separator: bool,
}

/// Reads a template.
///
/// # Errors
/// A bad name, a marker without end, a section without end or with another's
/// end, each at its place.
pub fn parse(source: &Source) -> Result<Template, Diagnostic> {
    let pairs = Grammar::parse(Rule::template, source.text()).map_err(|error| explain(source, &error))?;
    let mut open: Vec<Open> = Vec::new();
    let mut nodes: Vec<Node> = Vec::new();
    for pair in pairs.flat_map(Pair::into_inner) {
        let span = Span::new(pair.as_span().start(), pair.as_span().end());
        match pair.as_rule() {
            Rule::comment | Rule::EOI => {}
            Rule::text => place(Node::Text(span), &mut open, &mut nodes),
            Rule::value => place(Node::Value { key: name(&pair), span }, &mut open, &mut nodes),
            Rule::open => {
                if open.len() == MAX_DEPTH {
                    let message = format!("sections nested more than {MAX_DEPTH} deep");
                    return Err(Diagnostic::new(source, span, message));
                }
                open.push(opened(source, pair, span, open.last())?);
            }
            Rule::close => {
                let Some(Open { section, separator }) = open.pop() else {
                    let message = format!("`<</{}>>` closes a section that is not open", name(&pair));
                    return Err(Diagnostic::new(source, span, message));
                };
                if section.name != name(&pair) {
                    return Err(mismatch(source, span, &section));
                }
                let node = if separator { Node::Separator(section.body) } else { Node::Section(section) };
                place(node, &mut open, &mut nodes);
            }
            rule => unreachable!("the grammar has no {rule:?} here"),
        }
    }
    match open.pop() {
        None => Ok(Template { nodes }),
        Some(Open { section, .. }) => Err(unclosed(source, &section)),
    }
}

/// Puts a node into the innermost open section, or at the top.
fn place(node: Node, open: &mut [Open], top: &mut Vec<Node>) {
    match open.last_mut() {
        Some(innermost) => innermost.section.body.push(node),
        None => top.push(node),
    }
}

fn opened(source: &Source, pair: Pair<'_, Rule>, span: Span, outer: Option<&Open>) -> Result<Open, Diagnostic> {
    let name = name(&pair);
    let query = pair.into_inner().nth(1).map(|query| Query {
        kind: if query.as_rule() == Rule::pipeline { QueryKind::Pipeline } else { QueryKind::Find },
        text: query.as_str().to_owned(),
        span: Span::new(query.as_span().start(), query.as_span().end()),
    });
    if let Some(query) = query.as_ref().filter(|query| query.text.trim().is_empty()) {
        return Err(Diagnostic::new(source, query.span, format!("expected a query behind `{name}|`"))
            .hint("like <<#ON|{relation: 'on'}>>; {} asks for every document"));
    }
    let separator = query.is_none()
        && outer.is_some_and(|outer| name.strip_suffix("_separator") == Some(outer.section.name.as_str()));
    Ok(Open { section: Section { name, span, query, body: Vec::new() }, separator })
}

fn name(pair: &Pair<'_, Rule>) -> String {
    pair.clone().into_inner().next().map(|name| name.as_str().to_owned()).unwrap_or_default()
}

fn mismatch(source: &Source, span: Span, section: &Section) -> Diagnostic {
    let (line, column) = source.position(section.span.start);
    Diagnostic::new(source, span, format!("expected `<</{0}>>`, the end of section `{0}`", section.name))
        .hint(format!("section `{}` was opened at {line}:{column}", section.name))
}

fn unclosed(source: &Source, section: &Section) -> Diagnostic {
    Diagnostic::new(source, section.span, format!("section `{}` has no end", section.name))
        .hint(format!("write `<</{}>>` where it ends", section.name))
}

/// A `<<` that starts no marker is where pest stops.
fn explain(source: &Source, error: &pest::error::Error<Rule>) -> Diagnostic {
    let diagnostic = Diagnostic::from_pest(source, error, rename);
    let text = source.text();
    let offset = diagnostic.span().start;
    let start = text.get(..offset).and_then(|before| before.rfind("<<")).unwrap_or(offset);
    let inside = !text.get(start..offset).unwrap_or_default().contains(">>");
    let start = if text[offset..].starts_with("<<") {
        offset
    } else if inside {
        start
    } else {
        offset
    };
    let rest = &text[start..];
    let line = rest.find('\n').unwrap_or(rest.len());
    let (message, hint) = match rest.find(">>") {
        None => ("a marker without end".to_owned(), "expected `>>`"),
        Some(end) if end < line || rest.starts_with("<<#") => {
            let inner = rest[2..end].split('|').next().unwrap_or_default().trim_start_matches(['#', '/']);
            let query = inner.find(['{', '[']).filter(|_| rest.starts_with("<<#"));
            let shown: String = inner.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
            match query {
                Some(at) => (
                    format!("expected `|` before the query, found `{}`", &inner[at..=at]),
                    "like <<#ON|{relation: 'on'}>>, or <<#ON||[{$match: {relation: 'on'}}]>> for a pipeline",
                ),
                None => (
                    format!("`{shown}` is not the name of a marker"),
                    "expected letters, digits, `_` and `-`; the keys of nested documents are joined with `_`",
                ),
            }
        }
        Some(_) => ("a marker without end on its line".to_owned(), "expected `>>`"),
    };
    let end = rest.find(">>").map_or(line, |end| (end + 2).min(line));
    Diagnostic::new(source, Span::new(start, start + end), message).hint(hint)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A template in short: text as itself, `<key>`, `[NAME …]`, `{separator}`.
    fn short(text: &str) -> String {
        let source = Source::new("t", text);
        fn write(source: &Source, nodes: &[Node], out: &mut String) {
            for node in nodes {
                match node {
                    Node::Text(span) => out.push_str(source.slice(*span)),
                    Node::Value { key, .. } => *out += &format!("<{key}>"),
                    Node::Section(section) => {
                        let query = section.query.as_ref().map(|query| {
                            let bars = if query.kind == QueryKind::Find { "|" } else { "||" };
                            format!("{bars}{}", query.text)
                        });
                        *out += &format!("[{}{}: ", section.name, query.unwrap_or_default());
                        write(source, &section.body, out);
                        out.push(']');
                    }
                    Node::Separator(body) => {
                        out.push('{');
                        write(source, body, out);
                        out.push('}');
                    }
                }
            }
        }
        let mut out = String::new();
        write(&source, &parse(&source).unwrap().nodes, &mut out);
        out
    }

    fn complaint(text: &str) -> String {
        parse(&Source::new("t", text)).unwrap_err().to_string()
    }

    #[test]
    fn sections_hold_what_is_between_their_ends() {
        assert_eq!(
            short("a<<#ON|{relation:'on'}>> (on <<top>> <<x>>)\n<</ON>>b"),
            "a[ON|{relation:'on'}:  (on <top> <x>)\n]b"
        );
        assert_eq!(short("<<#A||[{$match: {a: {$in: ['|']}}}]>><</A>>"), "[A||[{$match: {a: {$in: ['|']}}}]: ]");
        assert_eq!(short("<<#A|{}>>x<<#B>>y<</B>><</A>>"), "[A|{}: x[B: y]]");
    }

    #[test]
    fn a_separator_belongs_to_its_section() {
        assert_eq!(short("<<#A|{}>>x<<#A_separator>>, <</A_separator>><</A>>"), "[A|{}: x{, }]");
        assert_eq!(short("<<#B_separator>>x<</B_separator>>"), "[B_separator: x]");
    }

    #[test]
    fn comments_go_and_everything_else_stays() {
        assert_eq!(short("a <<! a | comment\n >> b"), "a  b");
        assert_eq!(
            short("; <<x>> stays a marker in a PDDL comment\t \n"),
            "; <x> stays a marker in a PDDL comment\t \n"
        );
        assert_eq!(short("<<<GOAL>>>"), "<<GOAL>>");
        assert_eq!(short("(<= (n) 3) (>= 1 2) a < b > c"), "(<= (n) 3) (>= 1 2) a < b > c");
    }

    #[test]
    fn queries_may_run_over_lines() {
        assert_eq!(short("<<#A|{a:\n1}>><</A>>"), "[A|{a:\n1}: ]");
    }

    #[test]
    fn names_may_have_hyphens() {
        assert_eq!(short("<<#ON-TABLE|{}>><<caps-on-shelf>><</ON-TABLE>>"), "[ON-TABLE|{}: <caps-on-shelf>]");
    }

    #[test]
    fn what_is_wrong_is_said_at_its_place() {
        assert!(complaint("x\n <<#A|{}>> y").starts_with("t:2:2: section `A` has no end"));
        assert!(complaint("<<#A|{}>>\n<</B>>").starts_with("t:2:1: expected `<</A>>`, the end of section `A`"));
        assert!(complaint("<</B>>").starts_with("t:1:1: `<</B>>` closes a section that is not open"));
        assert!(
            complaint("a <<b.c>>").starts_with("t:1:3: `b.c` is not the name of a marker"),
            "{}",
            complaint("a <<b.c>>")
        );
        assert!(complaint("a <<b").starts_with("t:1:3: a marker without end"), "{}", complaint("a <<b"));
        assert!(
            complaint("<<#A|>><</A>>").starts_with("t:1:6: expected a query behind `A|`"),
            "{}",
            complaint("<<#A|>><</A>>")
        );
        let bare = complaint("<<#ONT{relation: 'on'}>><</ONT>>");
        assert!(bare.starts_with("t:1:1: expected `|` before the query, found `{`"), "{bare}");
        assert!(complaint("<<it's>>").starts_with("t:1:1: `it's` is not the name"), "{}", complaint("<<it's>>"));
        assert!(complaint("<<>>").starts_with("t:1:1: `` is not the name"), "{}", complaint("<<>>"));
    }

    #[test]
    fn deep_nesting_is_an_error_and_not_a_crash() {
        let text = "<<#A>>".repeat(100_000);
        assert!(complaint(&text).contains("nested more than 100 deep"));
    }

    #[test]
    fn a_long_text_is_read() {
        let text = "(on <<a>> b) ; filling\n".repeat(50_000);
        assert_eq!(parse(&Source::new("t", text)).unwrap().nodes.len(), 100_001);
    }
}
