//! The tags of a minijinja template: `{{ … }}`, `{% … %}`, `{# … #}`.
//!
//! They are found by a scan of our own: minijinja gives its lexer only with the feature `unstable_machinery`, whose interface
//! any release may change.

use crate::formats::Span;

/// What a tag is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TagKind {
    /// `{# … #}`
    Comment,
    /// `{% raw %} … {% endraw %}`, as a whole
    Raw,
    /// `{% … %}`
    Statement,
    /// `{{ … }}`
    Expression,
}

/// A tag and its place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tag<'a> {
    pub(super) kind: TagKind,
    pub(super) span: Span,
    /// The text with its brackets.
    pub(super) text: &'a str,
}

impl<'a> Tag<'a> {
    /// The keyword of a statement.
    pub(super) fn word(&self) -> &'a str {
        word(self.text)
    }

    /// What stands between the brackets, without the marks that remove white space.
    pub(super) fn code(&self) -> &'a str {
        let inner = self.text.get(2..).unwrap_or_default();
        let inner = inner.strip_suffix("%}").or_else(|| inner.strip_suffix("}}")).unwrap_or(inner);
        inner.trim_start_matches(['-', '+']).trim_end_matches(['-', '+']).trim()
    }

    /// The place of the text between `{% raw %}` and `{% endraw %}`.
    pub(super) fn raw(&self) -> Option<Span> {
        let start = self.text.find("%}").filter(|_| self.kind == TagKind::Raw)? + 2;
        let end = self.text.rfind("{%").filter(|end| *end >= start)?;
        Some(Span::new(self.span.start + start, self.span.start + end))
    }

    /// The words of the code, outside of strings, each with its offset in the code.
    pub(super) fn words(&self) -> Vec<(usize, &'a str)> {
        words(self.code())
    }
}

/// The tags of a template, in order.
pub(super) fn tags(template: &str) -> impl Iterator<Item = Tag<'_>> + Clone {
    let mut offset = 0;
    std::iter::from_fn(move || {
        let start = next_tag(template, offset)?;
        let (kind, end) = match template.as_bytes().get(start + 1) {
            Some(b'#') => {
                let end = template[start..].find("#}").map_or(template.len(), |length| start + length + 2);
                (TagKind::Comment, end)
            }
            Some(b'%') => {
                let end = tag_end(template, start, b'%');
                match word(&template[start..end]) {
                    "raw" => (TagKind::Raw, raw_end(template, end)),
                    _ => (TagKind::Statement, end),
                }
            }
            _ => (TagKind::Expression, tag_end(template, start, b'}')),
        };
        offset = end;
        Some(Tag { kind, span: Span::new(start, end), text: &template[start..end] })
    })
}

fn next_tag(template: &str, from: usize) -> Option<usize> {
    let rest = &template.as_bytes()[from..];
    rest.windows(2).position(|pair| pair[0] == b'{' && matches!(pair[1], b'{' | b'%' | b'#')).map(|at| from + at)
}

/// One past the end of the tag at `start`, past strings and brackets; `mark` stands before its last brace.
fn tag_end(template: &str, start: usize, mark: u8) -> usize {
    let bytes = template.as_bytes();
    let (mut at, mut depth, mut quote) = (start + 2, 0_usize, None);
    while let Some(byte) = bytes.get(at).copied() {
        match quote {
            Some(_) if byte == b'\\' => at += 1,
            Some(open) if byte == open => quote = None,
            Some(_) => {}
            None if depth == 0 && byte == mark && bytes.get(at + 1) == Some(&b'}') => return at + 2,
            None => match byte {
                b'"' | b'\'' => quote = Some(byte),
                b'(' | b'[' | b'{' => depth += 1,
                b')' | b']' | b'}' => depth = depth.saturating_sub(1),
                _ => {}
            },
        }
        at += 1;
    }
    template.len()
}

/// The keyword of a tag.
fn word(tag: &str) -> &str {
    let inner = tag[2..].trim_start_matches(['-', '+']).trim_start();
    let end = inner.find(|c: char| !is_word(c)).unwrap_or(inner.len());
    &inner[..end]
}

/// One past `{% endraw %}`.
fn raw_end(template: &str, from: usize) -> usize {
    let mut offset = from;
    while let Some(start) = template[offset..].find("{%").map(|at| offset + at) {
        let end = template[start..].find("%}").map_or(template.len(), |length| start + length + 2);
        if word(&template[start..end]) == "endraw" {
            return end;
        }
        offset = start + 2;
    }
    template.len()
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// The words of code, outside of strings.
pub(super) fn words(code: &str) -> Vec<(usize, &str)> {
    let mut words = Vec::new();
    let (mut quote, mut escaped, mut start) = (None, false, None);
    for (at, c) in code.char_indices() {
        if let Some(mark) = quote {
            (escaped, quote) = if escaped { (false, quote) } else { (c == '\\', quote.filter(|_| c != mark)) };
            continue;
        }
        if is_word(c) {
            start = start.or(Some(at));
            continue;
        }
        words.extend(start.take().and_then(|start| Some((start, code.get(start..at)?))));
        if matches!(c, '"' | '\'') {
            quote = Some(c);
        }
    }
    words.extend(start.and_then(|start| Some((start, code.get(start..)?))));
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tags_are_found_past_strings_comments_and_raw_text() {
        let template = "a {%- if x == '%}' -%} {{ {'a': {}} }}{# {{ #}{% raw %}{{ x }}{% endraw %}{{";
        let found: Vec<_> = tags(template).map(|tag| (tag.kind, tag.text)).collect();
        assert_eq!(
            found,
            [
                (TagKind::Statement, "{%- if x == '%}' -%}"),
                (TagKind::Expression, "{{ {'a': {}} }}"),
                (TagKind::Comment, "{# {{ #}"),
                (TagKind::Raw, "{% raw %}{{ x }}{% endraw %}"),
                (TagKind::Expression, "{{"),
            ]
        );
        let first = tags(template).next().unwrap();
        assert_eq!((first.word(), first.code()), ("if", "if x == '%}'"));
        assert_eq!(first.words(), [(0, "if"), (3, "x")]);
    }
}
