//! XML with places: elements whose attributes and texts are read as numbers, and escapes for writing.

mod expanded;
mod malformed;
mod text;

use std::ops::Range;

use super::{Mesh, Object, Pose, Solid};
use crate::formats::{Diagnostic, Source, Span};
use text::Text;

/// How deep elements may be nested; no scene is deeper than some ten.
const MAX_DEPTH: usize = 100;

/// An element, with the text that it stands in.
#[derive(Clone, Copy)]
pub(super) struct Element<'a> {
    text: &'a Text<'a>,
    node: roxmltree::Node<'a, 'a>,
}

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

/// The root element's name, where a text looks like XML.
pub(super) fn root(text: &str) -> Option<&str> {
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
fn tag_name(tag: &str) -> &str {
    tag.split(|c: char| c.is_whitespace() || c == '>' || c == '/').next().unwrap_or_default()
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

impl<'a> Element<'a> {
    /// The tag's name, with its prefix.
    pub(super) fn name(&self) -> &'a str {
        if self.node.tag_name().namespace().is_none() {
            return self.node.tag_name().name();
        }
        let tag = self.node.document().input_text().get(self.node.range().start + 1..);
        tag.map(tag_name).unwrap_or_default()
    }

    /// Whether both are one element of one text.
    pub(super) fn is(&self, other: &Self) -> bool {
        self.node == other.node
    }

    /// The elements in it. Those whose name has a prefix are for other programs.
    pub(super) fn children(&self) -> impl Iterator<Item = Element<'a>> + 'a {
        let text = self.text;
        let elements = self.node.children().filter(roxmltree::Node::is_element);
        elements.map(move |node| Element { text, node }).filter(|element| !element.name().contains(':'))
    }

    /// The element, all elements in it, and those in them.
    fn all(&self) -> impl Iterator<Item = Element<'a>> + 'a {
        let text = self.text;
        self.node.descendants().filter(roxmltree::Node::is_element).map(move |node| Element { text, node })
    }

    /// Whether it declares the prefix of Xacro, as files for it do, and those that it wrote.
    pub(super) fn is_of_xacro(&self) -> bool {
        expanded::declares_xacro(*self)
    }

    /// The first element in it that has this name.
    pub(super) fn child(&self, name: &str) -> Option<Element<'a>> {
        self.children().find(|child| child.name().eq_ignore_ascii_case(name))
    }

    /// The element of this name, which has to be there.
    pub(super) fn needs(&self, name: &str) -> Result<Element<'a>, Diagnostic> {
        self.child(name).ok_or_else(|| self.wrong(format!("<{}> has no <{name}>", self.name())))
    }

    /// The text in it, trimmed.
    pub(super) fn text(&self) -> &'a str {
        self.node.text().unwrap_or_default().trim()
    }

    /// A complaint about the element.
    pub(super) fn wrong(&self, message: impl Into<String>) -> Diagnostic {
        let start = self.node.range().start;
        self.text.wrong(start..start + 1 + self.name().len(), message)
    }

    /// A complaint about the text in it.
    fn wrong_text(&self, message: impl Into<String>) -> Diagnostic {
        let range = self.node.first_child().map_or_else(|| self.node.range(), |text| text.range());
        let text = self.text.part(range.clone());
        let start = range.start + text.len() - text.trim_start().len();
        self.text.wrong(start..start + text.trim().len().max(1), message)
    }

    /// An attribute.
    pub(super) fn attribute(&self, name: &str) -> Option<&'a str> {
        self.node.attribute(name)
    }

    /// An attribute that has to be there.
    pub(super) fn needs_attribute(&self, name: &str) -> Result<&'a str, Diagnostic> {
        self.attribute(name).ok_or_else(|| self.wrong(format!("<{}> has no `{name}`", self.name())))
    }

    /// A complaint about an attribute.
    pub(super) fn wrong_attribute(&self, name: &str, message: impl Into<String>) -> Diagnostic {
        let Some(attribute) = self.node.attribute_node(name) else { return self.wrong(message) };
        self.text.wrong(attribute.range_value(), message)
    }

    /// Exactly so many numbers in an attribute, where it is there.
    pub(super) fn numbers<const N: usize>(&self, name: &str) -> Result<Option<[f64; N]>, Diagnostic> {
        let Some(text) = self.attribute(name) else { return Ok(None) };
        numbers(text).map(Some).map_err(|wrong| self.wrong_attribute(name, format!("`{name}` {wrong}")))
    }

    /// Any count of numbers in an attribute; none where it is not there.
    pub(super) fn list(&self, name: &str) -> Result<Vec<f64>, Diagnostic> {
        let Some(text) = self.attribute(name) else { return Ok(Vec::new()) };
        list(text).map_err(|wrong| self.wrong_attribute(name, format!("`{name}` {wrong}")))
    }

    /// Exactly so many numbers as its text.
    pub(super) fn own_numbers<const N: usize>(&self) -> Result<[f64; N], Diagnostic> {
        numbers(self.text()).map_err(|wrong| self.wrong_text(format!("<{}> {wrong}", self.name())))
    }

    /// Red, green, blue and opacity as its text; a colour of three numbers is opaque.
    pub(super) fn own_color(&self) -> Result<[f64; 4], Diagnostic> {
        match list(self.text()).as_deref() {
            Ok([r, g, b]) => Ok([*r, *g, *b, 1.0]),
            Ok([r, g, b, a]) => Ok([*r, *g, *b, *a]),
            Ok(other) => {
                Err(self.wrong_text(format!("<{}> has {} numbers; expected 3 or 4", self.name(), other.len())))
            }
            Err(wrong) => Err(self.wrong_text(format!("<{}> {wrong}", self.name()))),
        }
    }

    /// A number as the text of a child that has to be there.
    pub(super) fn number_in(&self, name: &str) -> Result<f64, Diagnostic> {
        self.needs(name)?.own_numbers().map(|[number]| number)
    }

    /// A truth value as its text.
    pub(super) fn own_truth(&self) -> Result<bool, Diagnostic> {
        match self.text() {
            "true" | "1" | "True" => Ok(true),
            "false" | "0" | "False" => Ok(false),
            other => Err(self.wrong_text(format!("<{}> is `{other}`; expected true or false", self.name()))),
        }
    }

    /// Refuses elements that are in neither list. `ignored` are those that say nothing about the scene.
    pub(super) fn only(&self, known: &[&str], ignored: &[&str]) -> Result<(), Diagnostic> {
        let is_known = |name: &str| known.iter().chain(ignored).any(|other| other.eq_ignore_ascii_case(name));
        match self.children().find(|child| !is_known(child.name())) {
            None => Ok(()),
            Some(include) if include.name().eq_ignore_ascii_case("include") => {
                let message = format!("<{}> takes what another file has, which is not read", include.name());
                Err(include.wrong(message).hint("write what that file has in its place"))
            }
            Some(unknown) => {
                let message =
                    format!("unknown element <{}> in <{}>; expected {}", unknown.name(), self.name(), tags(known));
                Err(unknown.wrong(message))
            }
        }
    }

    /// Refuses attributes that are not in the list. Those whose name has a prefix are for other programs.
    pub(super) fn only_attributes(&self, known: &[&str]) -> Result<(), Diagnostic> {
        let mut own = self.node.attributes().filter(|attribute| attribute.namespace().is_none());
        match own.find(|attribute| !known.contains(&attribute.name())) {
            None => Ok(()),
            Some(unknown) => {
                let name = unknown.name();
                let message = format!("unknown attribute `{name}` of <{}>; expected {}", self.name(), known.join(", "));
                let start = unknown.range().start;
                Err(self.text.wrong(start..start + name.len(), message))
            }
        }
    }

    /// A mass that was read here.
    pub(super) fn mass(&self, mass: f64) -> Result<f64, Diagnostic> {
        if mass > 0.0 { Ok(mass) } else { Err(self.wrong(format!("a mass of {mass}; expected more than 0 kilograms"))) }
    }

    /// A colour that was read here.
    pub(super) fn color<const N: usize>(&self, color: [f64; N]) -> Result<[f64; N], Diagnostic> {
        let is_color = color.iter().all(|part| (0.0..=1.0).contains(part));
        if is_color { Ok(color) } else { Err(self.wrong("a colour that is not of numbers from 0 to 1")) }
    }

    /// The pose of a translation and a rotation that were read here.
    pub(super) fn pose(&self, translation: [f64; 3], rotation: [f64; 4]) -> Result<Pose, Diagnostic> {
        let length = super::pose::norm(&rotation);
        Pose::new(translation, rotation).filter(|_| (length - 1.0).abs() <= 1e-3).ok_or_else(|| {
            self.wrong(format!("a quaternion of length {length:.6} in <{}>; expected a unit quaternion", self.name()))
        })
    }
}

fn tags(names: &[&str]) -> String {
    names.iter().map(|name| format!("<{name}>")).collect::<Vec<_>>().join(", ")
}

fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let found = list(text)?;
    let count = found.len();
    found.try_into().map_err(|_| format!("has {count} numbers; expected {N}"))
}

fn list(text: &str) -> Result<Vec<f64>, String> {
    let number = |word: &str| {
        word.parse::<f64>()
            .ok()
            .filter(|number| number.is_finite())
            .ok_or_else(|| format!("has `{word}`; expected a finite number"))
    };
    if let Some(expression) = expanded::expression(text) {
        return Err(format!("has `{expression}`, an expression of Xacro; `xacro FILE > robot.urdf` makes the URDF"));
    }
    text.split_ascii_whitespace().map(number).collect()
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
