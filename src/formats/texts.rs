//! Texts that are read together: a template and those that it includes, or several files of facts.

use std::fmt;

use super::{Diagnostic, Source, Span};

/// A text and others, one after the other in one range of offsets, so that a span says in which text it is.
#[derive(Debug, Clone, PartialEq)]
pub struct Texts {
    /// Each with the offset of its first byte; never empty.
    sources: Vec<(usize, Source)>,
}

impl Texts {
    /// The texts in this order, the first of them by itself.
    #[must_use]
    pub fn new(first: &Source, parts: impl IntoIterator<Item = Source>) -> Self {
        let mut sources = vec![(0, first.clone())];
        let mut base = first.text().len() + 1;
        for part in parts {
            let length = part.text().len() + 1;
            sources.push((base, part));
            base += length;
        }
        Self { sources }
    }

    /// The texts, each with the offset of its first byte.
    pub fn iter(&self) -> impl Iterator<Item = &(usize, Source)> {
        self.sources.iter()
    }

    /// The text that the offset is in, and the offset of its first byte.
    #[must_use]
    pub fn at(&self, offset: usize) -> (&Source, usize) {
        let next = self.sources.partition_point(|(base, _)| *base <= offset);
        let (base, source) = &self.sources[next.saturating_sub(1)];
        (source, *base)
    }

    /// The text of a span, and the span in it.
    #[must_use]
    pub fn locate(&self, span: Span) -> (&Source, Span) {
        let (source, base) = self.at(span.start);
        (source, Span::new(span.start - base, span.end.saturating_sub(base).max(span.start - base)))
    }

    /// A complaint about a span.
    #[must_use]
    pub fn complain(&self, span: Span, message: impl Into<String>) -> Diagnostic {
        let (source, span) = self.locate(span);
        Diagnostic::new(source, span, message)
    }

    /// Line and column of an offset in its text.
    #[must_use]
    pub fn position(&self, offset: usize) -> (usize, usize) {
        let (source, base) = self.at(offset);
        source.position(offset - base)
    }

    /// The text of a span.
    #[must_use]
    pub fn slice(&self, span: Span) -> &str {
        let (source, span) = self.locate(span);
        source.slice(span)
    }

    /// Where an offset is: `3:5`, with the name of its text where that is not the first.
    pub fn place(&self, offset: usize) -> impl fmt::Display {
        let (source, base) = self.at(offset);
        let (line, column) = source.position(offset - base);
        match base {
            0 => format!("{line}:{column}"),
            _ => format!("{}:{line}:{column}", source.name()),
        }
    }

    /// Where an offset is: `3:5`, with the name of its text where another offset is not in it.
    pub fn place_beside(&self, offset: usize, other: usize) -> impl fmt::Display {
        let (source, base) = self.at(offset);
        let (line, column) = source.position(offset - base);
        match base == self.at(other).1 {
            true => format!("{line}:{column}"),
            false => format!("{}:{line}:{column}", source.name()),
        }
    }

    /// The name of the text that an offset is in, where that is not the first.
    #[must_use]
    pub fn part(&self, offset: usize) -> Option<String> {
        let (source, base) = self.at(offset);
        (base > 0).then(|| source.name().to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_span_says_in_which_text_it_is() {
        let texts = Texts::new(&Source::new("a", "12\n3"), [Source::new("b", "45\n67")]);
        assert_eq!(texts.slice(Span::new(1, 2)), "2");
        assert_eq!(texts.place(3).to_string(), "2:1");
        assert_eq!(texts.place(4).to_string(), "2:2", "the end of the first");
        assert_eq!(texts.slice(Span::new(8, 10)), "67");
        assert_eq!(texts.place(9).to_string(), "b:2:2");
        assert_eq!(texts.place_beside(9, 7).to_string(), "2:2");
        assert_eq!(texts.place_beside(3, 7).to_string(), "a:2:1");
        assert!(texts.complain(Span::new(8, 9), "no").to_string().starts_with("b:2:1: no"));
    }
}
