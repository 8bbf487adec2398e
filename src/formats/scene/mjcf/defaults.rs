//! `<default>`: attributes that elements have without saying so.
//!
//! They are not read. A file may have those that change nothing in a scene, as friction and the gains of motors.

use super::super::xml::Element;
use crate::formats::Diagnostic;

/// Attributes that change a scene, by the element that they are of.
const REFUSED: [(&str, &[&str]); 3] = [
    (
        "geom",
        &[
            "type",
            "size",
            "pos",
            "quat",
            "axisangle",
            "euler",
            "xyaxes",
            "zaxis",
            "fromto",
            "rgba",
            "mass",
            "mesh",
            "hfield",
        ],
    ),
    ("mesh", &["file", "scale", "vertex", "face", "refpos", "refquat"]),
    ("joint", &["type"]),
];

/// Refuses defaults that change a scene, in a class and the classes in it.
pub(super) fn check(default: Element<'_>) -> Result<(), Diagnostic> {
    for element in default.children() {
        if element.name() == "default" {
            check(element)?;
            continue;
        }
        let attributes =
            REFUSED.iter().find(|(name, _)| *name == element.name()).map_or(&[][..], |(_, refused)| refused);
        if let Some(name) = attributes.iter().find(|name| element.attribute(name).is_some()) {
            let message =
                format!("`{name}` in the defaults of <{}> changes the scene, and is not read", element.name());
            let hint = format!("give each <{}> its own `{name}`", element.name());
            return Err(element.wrong_attribute(name, message).hint(hint));
        }
    }
    Ok(())
}
