//! Elements whose attributes and texts are read as numbers, and complaints about them at their place.

use super::super::Pose;
use super::text::{Text, tag_name};
use super::xacro;
use crate::formats::Diagnostic;

/// An element, with the text that it stands in.
#[derive(Clone, Copy)]
pub(in super::super) struct Element<'a> {
    pub(super) text: &'a Text<'a>,
    pub(super) node: roxmltree::Node<'a, 'a>,
}

impl<'a> Element<'a> {
    /// The tag's name, with its prefix.
    pub(in super::super) fn name(&self) -> &'a str {
        if self.node.tag_name().namespace().is_none() {
            return self.node.tag_name().name();
        }
        let tag = self.node.document().input_text().get(self.node.range().start + 1..);
        tag.map(tag_name).unwrap_or_default()
    }

    /// Whether both are one element of one text.
    pub(in super::super) fn is(&self, other: &Self) -> bool {
        self.node == other.node
    }

    /// The elements in it. Those whose name has a prefix are for other programs.
    pub(in super::super) fn children(&self) -> impl Iterator<Item = Element<'a>> + 'a {
        let text = self.text;
        let elements = self.node.children().filter(roxmltree::Node::is_element);
        elements.map(move |node| Element { text, node }).filter(|element| !element.name().contains(':'))
    }

    /// The element, all elements in it, and those in them.
    pub(super) fn all(&self) -> impl Iterator<Item = Element<'a>> + 'a {
        let text = self.text;
        self.node.descendants().filter(roxmltree::Node::is_element).map(move |node| Element { text, node })
    }

    /// Whether it declares the prefix of Xacro, as files for it do, and those that it wrote.
    pub(in super::super) fn is_of_xacro(&self) -> bool {
        xacro::declares(self.node)
    }

    /// The first element in it that has this name.
    pub(in super::super) fn child(&self, name: &str) -> Option<Element<'a>> {
        self.children().find(|child| child.name().eq_ignore_ascii_case(name))
    }

    /// The element of this name, which has to be there.
    pub(in super::super) fn needs(&self, name: &str) -> Result<Element<'a>, Diagnostic> {
        self.child(name).ok_or_else(|| self.wrong(format!("<{}> has no <{name}>", self.name())))
    }

    /// The text in it, trimmed.
    pub(in super::super) fn text(&self) -> &'a str {
        self.node.text().unwrap_or_default().trim()
    }

    /// A complaint about the element.
    pub(in super::super) fn wrong(&self, message: impl Into<String>) -> Diagnostic {
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
    pub(in super::super) fn attribute(&self, name: &str) -> Option<&'a str> {
        self.node.attribute(name)
    }

    /// An attribute that has to be there.
    pub(in super::super) fn needs_attribute(&self, name: &str) -> Result<&'a str, Diagnostic> {
        self.attribute(name).ok_or_else(|| self.wrong(format!("<{}> has no `{name}`", self.name())))
    }

    /// A complaint about an attribute.
    pub(in super::super) fn wrong_attribute(&self, name: &str, message: impl Into<String>) -> Diagnostic {
        let Some(attribute) = self.node.attribute_node(name) else { return self.wrong(message) };
        self.text.wrong(attribute.range_value(), message)
    }

    /// Exactly so many numbers in an attribute, where it is there.
    pub(in super::super) fn numbers<const N: usize>(&self, name: &str) -> Result<Option<[f64; N]>, Diagnostic> {
        let Some(text) = self.attribute(name) else { return Ok(None) };
        numbers(text).map(Some).map_err(|wrong| self.wrong_attribute(name, format!("`{name}` {wrong}")))
    }

    /// Any count of numbers in an attribute; none where it is not there.
    pub(in super::super) fn list(&self, name: &str) -> Result<Vec<f64>, Diagnostic> {
        let Some(text) = self.attribute(name) else { return Ok(Vec::new()) };
        list(text).map_err(|wrong| self.wrong_attribute(name, format!("`{name}` {wrong}")))
    }

    /// Exactly so many numbers as its text.
    pub(in super::super) fn own_numbers<const N: usize>(&self) -> Result<[f64; N], Diagnostic> {
        numbers(self.text()).map_err(|wrong| self.wrong_text(format!("<{}> {wrong}", self.name())))
    }

    /// Red, green, blue and opacity as its text; a colour of three numbers is opaque.
    pub(in super::super) fn own_color(&self) -> Result<[f64; 4], Diagnostic> {
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
    pub(in super::super) fn number_in(&self, name: &str) -> Result<f64, Diagnostic> {
        self.needs(name)?.own_numbers().map(|[number]| number)
    }

    /// A truth value as its text.
    pub(in super::super) fn own_truth(&self) -> Result<bool, Diagnostic> {
        match self.text() {
            "true" | "1" | "True" => Ok(true),
            "false" | "0" | "False" => Ok(false),
            other => Err(self.wrong_text(format!("<{}> is `{other}`; expected true or false", self.name()))),
        }
    }

    /// Refuses elements that are in neither list. `ignored` are those that say nothing about the scene.
    pub(in super::super) fn only(&self, known: &[&str], ignored: &[&str]) -> Result<(), Diagnostic> {
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
    pub(in super::super) fn only_attributes(&self, known: &[&str]) -> Result<(), Diagnostic> {
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
    pub(in super::super) fn mass(&self, mass: f64) -> Result<f64, Diagnostic> {
        if mass > 0.0 { Ok(mass) } else { Err(self.wrong(format!("a mass of {mass}; expected more than 0 kilograms"))) }
    }

    /// A colour that was read here.
    pub(in super::super) fn color<const N: usize>(&self, color: [f64; N]) -> Result<[f64; N], Diagnostic> {
        let is_color = color.iter().all(|part| (0.0..=1.0).contains(part));
        if is_color { Ok(color) } else { Err(self.wrong("a colour that is not of numbers from 0 to 1")) }
    }

    /// The pose of a translation and a rotation that were read here.
    pub(in super::super) fn pose(&self, translation: [f64; 3], rotation: [f64; 4]) -> Result<Pose, Diagnostic> {
        let length = super::super::pose::norm(&rotation);
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
    if let Some(expression) = xacro::expression(text) {
        return Err(format!("has `{expression}`, an expression of Xacro; `xacro FILE > robot.urdf` makes the URDF"));
    }
    text.split_ascii_whitespace().map(number).collect()
}
