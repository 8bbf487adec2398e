//! A text as the XML parser takes it: prefixes that nothing declares are declared at the root element.
//!
//! SDF and URDF have elements and attributes of other programs, as `<drake:proximity_properties>`, and their own
//! readers do not ask for the declaration of the prefix that XML asks for.

use std::borrow::Cow;
use std::ops::Range;

use crate::formats::{Diagnostic, Source, Span};

/// How many prefixes are declared; files of other programs have one or two.
const MAX_PREFIXES: usize = 16;

/// A text with declarations in it.
pub(super) struct Text<'a> {
    source: &'a Source,
    /// Where the declarations are inserted: behind the name of the root element.
    at: usize,
    declarations: String,
    count: usize,
}

impl<'a> Text<'a> {
    pub(super) fn new(source: &'a Source) -> Self {
        let at = root_range(source.text()).map_or(0, |name| name.end);
        Self { source, at, declarations: String::new(), count: 0 }
    }

    /// Declares a prefix, unless there are too many.
    pub(super) fn declare(&mut self, prefix: &str) -> bool {
        let can = self.at > 0 && self.count < MAX_PREFIXES;
        if can {
            self.count += 1;
            self.declarations.push_str(&format!(" xmlns:{prefix}=\"{prefix}\""));
        }
        can
    }

    /// The text with the declarations.
    pub(super) fn whole(&self) -> Cow<'a, str> {
        match self.source.text().split_at_checked(self.at) {
            Some((head, tail)) if !self.declarations.is_empty() => {
                Cow::Owned(format!("{head}{}{tail}", self.declarations))
            }
            _ => Cow::Borrowed(self.source.text()),
        }
    }

    /// The place in the source of a place in the whole text.
    pub(super) fn place(&self, range: Range<usize>) -> Range<usize> {
        let place = |offset: usize| offset.saturating_sub(self.declarations.len()).max(offset.min(self.at));
        place(range.start)..place(range.end)
    }

    /// A part of the source, by its place in the whole text.
    pub(super) fn part(&self, range: Range<usize>) -> &'a str {
        self.source.text().get(self.place(range)).unwrap_or_default()
    }

    /// A complaint about a place in the whole text.
    pub(super) fn wrong(&self, range: Range<usize>, message: impl Into<String>) -> Diagnostic {
        let place = self.place(range);
        Diagnostic::new(self.source, Span::new(place.start, place.end), message)
    }
}

/// The root element's name, where a text looks like XML.
pub(in super::super) fn root(text: &str) -> Option<&str> {
    text.get(root_range(text)?)
}

/// Where the root element's name is.
fn root_range(text: &str) -> Option<Range<usize>> {
    let mut rest = text.trim_start_matches('\u{feff}').trim_start();
    loop {
        rest = rest.strip_prefix('<')?;
        let end = match rest.as_bytes().first()? {
            b'?' => rest.find("?>")? + 2,
            b'!' => {
                rest.strip_prefix("!--")
                    .and_then(|comment| comment.find("-->"))
                    .map_or_else(|| rest.find('>'), |end| Some(end + 5))?
                    + 1
            }
            _ => {
                let start = text.len() - rest.len();
                return Some(start..start + tag_name(rest).len());
            }
        };
        rest = rest.get(end..)?.trim_start();
    }
}

/// The name at the beginning of what follows a `<`.
pub(super) fn tag_name(tag: &str) -> &str {
    tag.split(|c: char| c.is_whitespace() || c == '>' || c == '/').next().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_behind_the_declarations_are_those_of_the_source() {
        let source = Source::new("a.xml", "<?xml version='1.0'?><!-- a --><ab c='d'/>");
        let mut text = Text::new(&source);
        assert_eq!(text.whole(), source.text());
        assert!(text.declare("x") && text.declare("y"));
        let whole = text.whole();
        assert!(whole.ends_with("<ab xmlns:x=\"x\" xmlns:y=\"y\" c='d'/>"), "{whole}");
        for part in ["xml", "<ab", "c='d'"] {
            let at = whole.find(part).unwrap();
            assert_eq!(text.part(at..at + part.len()), part);
        }
        // What is in the declarations is at their place.
        let at = whole.find("xmlns:y").unwrap();
        assert_eq!(text.part(at..at + 3), "");
    }

    #[test]
    fn no_more_prefixes_are_declared_than_files_have() {
        let source = Source::new("a.xml", "<a/>");
        let mut text = Text::new(&source);
        let taken = (0..100).take_while(|number| text.declare(&format!("p{number}"))).count();
        assert_eq!(taken, MAX_PREFIXES);
    }
}
