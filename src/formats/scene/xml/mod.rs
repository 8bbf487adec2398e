//! XML with places: elements whose attributes and texts are read as numbers, and escapes for writing.

mod element;
mod expanded;
mod malformed;
mod text;
mod xacro;

use super::{Mesh, Object, Solid};
use crate::formats::{Diagnostic, Source, Span};
use text::Text;

pub(super) use element::Element;
pub(super) use text::root;

/// How deep elements may be nested; no scene is deeper than some ten.
const MAX_DEPTH: usize = 100;

/// Parses a text and gives its root element to `read`.
pub(super) fn parse<T>(
    source: &Source,
    read: impl FnOnce(Element<'_>) -> Result<T, Diagnostic>,
) -> Result<T, Diagnostic> {
    check_depth(source)?;
    let mut text = Text::new(source);
    loop {
        let whole = text.whole();
        match roxmltree::Document::parse(&whole) {
            Ok(document) => {
                let root = Element { text: &text, node: document.root_element() };
                return expanded::check(root).and_then(|()| read(root));
            }
            Err(roxmltree::Error::UnknownNamespace(prefix, _)) if text.declare(&prefix) => {}
            Err(error) => return Err(malformed::explain(&text, &whole, &error)),
        }
    }
}

/// Refuses what is nested too deeply, before anything recurses: counts start and end tags.
fn check_depth(source: &Source) -> Result<(), Diagnostic> {
    let bytes = source.text().as_bytes();
    let mut depth = 0_usize;
    for at in memchr::memchr_iter(b'<', bytes) {
        match bytes.get(at + 1) {
            Some(b'/') => depth = depth.saturating_sub(1),
            Some(b'!' | b'?') | None => {}
            Some(_) => depth += usize::from(!closes_itself(&bytes[at..])),
        }
        if depth > MAX_DEPTH {
            let message = format!("elements are nested more than {MAX_DEPTH} deep");
            return Err(Diagnostic::new(source, Span::new(at, at + 1), message));
        }
    }
    Ok(())
}

/// Whether the tag at the beginning ends with `/>`.
fn closes_itself(tag: &[u8]) -> bool {
    let mut quote = None;
    for (at, byte) in tag.iter().enumerate() {
        match (quote, byte) {
            (None, b'"' | b'\'') => quote = Some(*byte),
            (Some(open), close) if open == *close => quote = None,
            (None, b'>') => return at > 0 && tag[at - 1] == b'/',
            _ => {}
        }
    }
    false
}

/// A text as XML, in an attribute or between tags.
pub(super) fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\t' | '\n' | '\r' => escaped.push_str(&format!("&#{};", u32::from(c))),
            c => escaped.push(c),
        }
    }
    escaped
}

/// Says why a text cannot be in XML 1.0: it has control characters.
fn check_text(what: &str, text: &str) -> Result<(), String> {
    let is_bad = |c: char| {
        (c.is_control() && !"\t\n\r\u{7f}".contains(c) && c < '\u{80}') || ('\u{fffe}'..='\u{ffff}').contains(&c)
    };
    match text.chars().find(|c| is_bad(*c)) {
        Some(c) => Err(format!("its {what} has the character {}, which XML cannot express", c.escape_default())),
        None if text.is_empty() => Err(format!("its {what} is empty")),
        None => Ok(()),
    }
}

/// Says why an object's name, or that of one of its files, cannot be in XML 1.0.
pub(super) fn check_names(object: &Object) -> Result<(), String> {
    check_text("name", &object.name)?;
    let files = object.shapes.iter().filter_map(|shape| match &shape.solid {
        Solid::Mesh(Mesh::File { file, .. }) => Some(file),
        _ => None,
    });
    files
        .map(|file| check_text("mesh", file))
        .chain(object.model.iter().map(|file| check_text("model", file)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nesting_is_refused_before_anything_recurses() {
        let source = Source::new("deep.xml", "<a>".repeat(1_000_000));
        let wrong = parse(&source, |_| Ok(())).unwrap_err();
        assert!(wrong.to_string().contains("nested more than 100 deep"), "{wrong}");
    }

    #[test]
    fn what_is_no_xml_is_shown_at_its_place() {
        let source = Source::new("x.xml", "<a>\n  <b></c>\n</a>");
        let wrong = parse(&source, |_| Ok(())).unwrap_err().to_string();
        assert!(wrong.starts_with("x.xml:2:"), "{wrong}");
        let source = Source::new("x.xml", "<!DOCTYPE a [<!ENTITY b \"c\">]><a>&b;</a>");
        assert!(parse(&source, |_| Ok(())).is_err());
    }

    #[test]
    fn escaped_texts_read_back() {
        for text in ["a & b", "<\"'>", "Öl\n\t\r", "a]]>b"] {
            let source = Source::new("x.xml", format!("<a b=\"{}\"/>", escape(text)));
            let read = parse(&source, |root| Ok(root.attribute("b").map(str::to_owned))).unwrap();
            assert_eq!(read.as_deref(), Some(text));
        }
        assert!(check_text("name", "a\u{1}").is_err() && check_text("name", "").is_err());
    }

    #[test]
    fn the_root_is_found_behind_comments_and_declarations() {
        for text in
            ["<?xml version=\"1.0\"?>\n<!-- a > b -->\n<sdf version='1.9'>", "\u{feff}<sdf>", " <!DOCTYPE x><sdf/>"]
        {
            assert_eq!(root(text), Some("sdf"), "{text}");
        }
        assert_eq!(root("{}"), None);
        assert_eq!(root("<!--"), None);
    }
}
