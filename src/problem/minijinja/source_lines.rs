//! Where text comes from that an expression or a filter wrote.
//!
//! Text inside of `{% filter %}`, and of a macro or a `{% set %}` block that a template does more with than writing
//! it, has no marks. Where an expression or a filter writes such text, its lines are looked for among those of the
//! blocks that it came from. A line that is not there, since a filter changed it, was made by the filter or the
//! expression.

use super::blocks::{closes, opens};
use super::tags::{Tag, TagKind, tags};
use crate::formats::Texts;
use crate::formats::{Diagnostic, Span};
use crate::problem::assembly::{Assembler, Literal};

/// The lines of fixed text that an expression or a filter may write.
#[derive(Debug)]
pub(super) struct SourceLines<'t> {
    template: &'t Texts,
    /// Without white space around them.
    lines: Vec<Span>,
    /// The line that is likely next.
    next: usize,
    /// What a line comes from that is not among them.
    made: Span,
}

impl<'t> SourceLines<'t> {
    /// Those of the expression, or of the tag of a `{% filter %}`, at `site`.
    pub(super) fn of(site: Span, template: &'t Texts) -> Self {
        let (source, base) = template.at(site.start);
        let mut made = site;
        let blocks: Vec<Span> = match tags(source.text()).find(|tag| tag.span.start + base == site.start) {
            Some(tag) if tag.kind == TagKind::Statement => vec![moved(content(source.text(), &tag), base)],
            Some(expression) => {
                let named = named(&expression, template);
                if let [(tag, code, _)] = named.as_slice()
                    && code.contains('|')
                    && !expression.code().contains('|')
                {
                    made = *tag;
                }
                named.into_iter().map(|(_, _, content)| content).collect()
            }
            None => Vec::new(),
        };
        let lines = blocks.into_iter().flat_map(|block| lines(block, template)).collect();
        Self { template, lines, next: 0, made }
    }

    /// Adds text that was written to the problem.
    pub(super) fn write(&mut self, text: &str, assembler: &mut Assembler) -> Result<(), Diagnostic> {
        for line in text.split_inclusive('\n') {
            let mut rest = line;
            while !rest.trim().is_empty() {
                let (blank, body) = rest.split_at(rest.len() - rest.trim_start().len());
                assembler.text(blank)?;
                let whole = body.trim_end();
                let Some((start, length)) = self.find(whole) else {
                    assembler.made(whole, self.made)?;
                    rest = &body[whole.len()..];
                    break;
                };
                let (known, after) = body.split_at(length);
                assembler.literal(known, Literal { start, document: None })?;
                rest = after;
            }
            assembler.text(rest)?;
        }
        Ok(())
    }

    /// Finds the line that is this text, or else the longest that the text begins with; a filter may have changed upper and lower
    /// case. Returns where it starts, and its length.
    fn find(&mut self, text: &str) -> Option<(usize, usize)> {
        let begins = |span: &Span| {
            let line = self.template.slice(*span);
            let is_apart =
                |after: &str| after.is_empty() || after.starts_with(is_delimiter) || line.ends_with(is_delimiter);
            let split = text.split_at_checked(line.len());
            split.is_some_and(|(head, after)| head.eq_ignore_ascii_case(line) && is_apart(after))
        };
        let lines =
            || (self.next..self.lines.len()).chain(0..self.next).filter_map(|at| Some((at, self.lines.get(at)?)));
        let length = |span: &Span| span.end - span.start;
        let longest = lines().filter(|(_, span)| begins(span)).map(|(_, span)| length(span)).max()?;
        let (at, span) = lines().find(|(_, span)| length(span) == longest && begins(span))?;
        let start = span.start;
        self.next = at + 1;
        Some((start, longest))
    }
}

fn is_delimiter(c: char) -> bool {
    c.is_whitespace() || matches!(c, '(' | ')')
}

fn moved(span: Span, base: usize) -> Span {
    Span::new(span.start + base, span.end + base)
}

/// What is between the tag of a block and its end.
fn content(text: &str, block: &Tag<'_>) -> Span {
    let mut depth = 1_usize;
    for tag in tags(text).filter(|tag| tag.span.start > block.span.start) {
        if opens(&tag) {
            depth += 1;
        } else if closes(&tag).is_some() {
            depth -= 1;
            if depth == 0 {
                return Span::new(block.span.end, tag.span.start);
            }
        }
    }
    Span::new(block.span.end, text.len())
}

/// The macros and `{% set %}` blocks that an expression names: the tag, its code, and the content.
fn named<'t>(expression: &Tag<'_>, template: &'t Texts) -> Vec<(Span, &'t str, Span)> {
    let names: Vec<&str> = expression.words().into_iter().map(|(_, word)| word).collect();
    let mut found = Vec::new();
    for (base, source) in template.iter() {
        for tag in tags(source.text()).filter(opens) {
            let is_named = match tag.word() {
                "macro" | "set" => tag.words().get(1).is_some_and(|(_, name)| names.contains(name)),
                "call" => names.contains(&"caller"),
                _ => false,
            };
            if is_named {
                found.push((moved(tag.span, *base), tag.code(), moved(content(source.text(), &tag), *base)));
            }
        }
    }
    found
}

/// The lines of fixed text in a stretch of a template.
fn lines(stretch: Span, template: &Texts) -> Vec<Span> {
    let (source, base) = template.at(stretch.start);
    let (mut start, mut lines) = (stretch.start, Vec::new());
    let mut add = |from: usize, to: usize| {
        let mut at = from;
        for line in template.slice(Span::new(from, to.max(from))).split_inclusive('\n') {
            let blank = line.len() - line.trim_start().len();
            let length = line.trim().len();
            if length > 0 {
                lines.push(Span::new(at + blank, at + blank + length));
            }
            at += line.len();
        }
    };
    for tag in tags(source.text()) {
        let span = moved(tag.span, base);
        if span.start < stretch.start || span.end > stretch.end {
            continue;
        }
        add(start, span.start);
        if let Some(inside) = tag.raw() {
            add(base + inside.start, base + inside.end);
        }
        start = span.end;
    }
    add(start, stretch.end);
    lines
}
