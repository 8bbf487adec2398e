//! Elements and expressions that another program has to replace before a file says what it means.

use super::element::Element;
use super::xacro::{self, PREFIX};
use crate::formats::Diagnostic;

/// The namespace of XInclude.
const XINCLUDE: &str = "http://www.w3.org/2001/XInclude";

/// Refuses elements that stand for others, and expressions that stand for values.
pub(super) fn check(root: Element<'_>) -> Result<(), Diagnostic> {
    // What Xacro wrote may still declare the prefix.
    let declares = xacro::declares(root.node);
    root.all().try_for_each(|element| {
        if element.node.tag_name().namespace() == Some(XINCLUDE) || element.name().starts_with("xi:") {
            let message = format!("<{}> includes another file, which is not read", element.name());
            return Err(element.wrong(message).hint("`xmllint --xinclude FILE` puts that file in its place"));
        }
        if element.name().split_once(':').is_some_and(|(prefix, _)| prefix == PREFIX) {
            return Err(expand_first(root, element.wrong(format!("<{}> is an element of Xacro", element.name()))));
        }
        match element.node.attributes().find(|attribute| declares && xacro::expression(attribute.value()).is_some()) {
            None => Ok(()),
            Some(attribute) => {
                let message = format!("`{}` has an expression of Xacro", attribute.name());
                Err(expand_first(root, element.wrong_attribute(attribute.name(), message)))
            }
        }
    })
}

fn expand_first(root: Element<'_>, wrong: Diagnostic) -> Diagnostic {
    wrong.hint(match root.name() {
        "robot" => "this file is Xacro: `xacro FILE > robot.urdf` makes the URDF",
        _ => "this file is Xacro: `xacro FILE > EXPANDED` replaces such elements",
    })
}
