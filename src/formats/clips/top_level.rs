//! The lists that stand at the top of a text, found without reading what is inside of them.

use crate::formats::Span;

/// A list at the top of a text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TopLevel<'a> {
    /// From its `(` to its `)`, or to the end where it is not closed.
    pub span: Span,
    /// Its first word: `defrule`, say; empty where it is no plain word.
    pub head: &'a str,
    /// Its second word, if that is a plain one.
    pub name: &'a str,
}

/// Returns the lists at the top of a text, in order. What stands between them is passed over.
pub fn top_level(text: &str) -> impl Iterator<Item = TopLevel<'_>> {
    let mut at = 0;
    std::iter::from_fn(move || {
        let bytes = text.as_bytes();
        while let Some(byte) = bytes.get(at) {
            match byte {
                b'(' => {
                    let end = end(bytes, at);
                    let (head, behind) = word(text, at + 1);
                    let (name, _) = word(text, behind);
                    let span = Span::new(at, end);
                    at = end;
                    return Some(TopLevel { span, head, name });
                }
                b';' => at = line_end(bytes, at),
                b'"' => at = string_end(bytes, at),
                _ => at += 1,
            }
        }
        None
    })
}

/// Behind the `)` of the list at `start`.
fn end(bytes: &[u8], start: usize) -> usize {
    let (mut at, mut depth) = (start, 0_usize);
    while let Some(byte) = bytes.get(at) {
        match byte {
            b';' => at = line_end(bytes, at),
            b'"' => at = string_end(bytes, at),
            b'(' => {
                depth += 1;
                at += 1;
            }
            b')' => {
                depth -= 1;
                at += 1;
                if depth == 0 {
                    return at;
                }
            }
            _ => at += 1,
        }
    }
    bytes.len()
}

fn line_end(bytes: &[u8], at: usize) -> usize {
    let rest = bytes.get(at..).unwrap_or_default();
    at + rest.iter().position(|byte| matches!(byte, b'\n' | b'\r')).unwrap_or(rest.len())
}

/// Behind the quote that ends the string at `start`.
fn string_end(bytes: &[u8], start: usize) -> usize {
    let mut at = start + 1;
    while let Some(byte) = bytes.get(at) {
        match byte {
            b'\\' => at += 2,
            b'"' => return at + 1,
            _ => at += 1,
        }
    }
    bytes.len()
}

/// The word at a place or behind the blanks and remarks there, and where it ends; empty where there is no plain word.
fn word(text: &str, start: usize) -> (&str, usize) {
    let (bytes, mut at) = (text.as_bytes(), start);
    loop {
        match bytes.get(at) {
            Some(b';') => at = line_end(bytes, at),
            Some(byte) if byte.is_ascii_whitespace() => at += 1,
            _ => break,
        }
    }
    let inner = |byte: &&u8| !byte.is_ascii_whitespace() && !b"()\";&|~".contains(byte);
    let length = bytes.get(at..).unwrap_or_default().iter().take_while(inner).count();
    (text.get(at..at + length).unwrap_or_default(), at + length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_found_whatever_stands_in_strings_and_comments() {
        let text = "; (a)\n(deffunction f (?x) \"(\" ; )\n x) \"(b)\" (c \"\\\"(\" (d)) (\"e\") (open";
        let found: Vec<_> =
            top_level(text).map(|list| (list.head, list.name, text.get(list.span.start..list.span.end))).collect();
        assert_eq!(
            found,
            [
                ("deffunction", "f", Some("(deffunction f (?x) \"(\" ; )\n x)")),
                ("c", "", Some("(c \"\\\"(\" (d))")),
                ("", "", Some("(\"e\")")),
                ("open", "", Some("(open")),
            ]
        );
    }
}
