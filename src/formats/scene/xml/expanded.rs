//! Elements and expressions that another program has to replace before a file says what it means.

use super::Element;
use crate::formats::Diagnostic;

/// The namespace of XInclude.
const XINCLUDE: &str = "http://www.w3.org/2001/XInclude";

/// The prefix of Xacro's elements.
const XACRO: &str = "xacro";

/// Refuses elements that stand for others, and expressions that stand for values.
pub(super) fn check(root: Element<'_>) -> Result<(), Diagnostic> {
    // What Xacro wrote may still declare the prefix.
    let declares = declares_xacro(root);
    root.all().try_for_each(|element| {
        if element.node.tag_name().namespace() == Some(XINCLUDE) || element.name().starts_with("xi:") {
            let message = format!("<{}> includes another file, which is not read", element.name());
            return Err(element.wrong(message).hint("`xmllint --xinclude FILE` puts that file in its place"));
        }
        if element.name().split_once(':').is_some_and(|(prefix, _)| prefix == XACRO) {
            return Err(xacro(root, element.wrong(format!("<{}> is an element of Xacro", element.name()))));
        }
        match element.node.attributes().find(|attribute| declares && expression(attribute.value()).is_some()) {
            None => Ok(()),
            Some(attribute) => {
                let message = format!("`{}` has an expression of Xacro", attribute.name());
                Err(xacro(root, element.wrong_attribute(attribute.name(), message)))
            }
        }
    })
}

/// Whether an element declares the prefix of Xacro.
pub(super) fn declares_xacro(element: Element<'_>) -> bool {
    element.node.namespaces().any(|namespace| namespace.name() == Some(XACRO))
}

fn xacro(root: Element<'_>, wrong: Diagnostic) -> Diagnostic {
    wrong.hint(match root.name() {
        "robot" => "this file is Xacro: `xacro FILE > robot.urdf` makes the URDF",
        _ => "this file is Xacro: `xacro FILE > EXPANDED` replaces such elements",
    })
}

/// The first expression of Xacro in a text: `${…}` or `$(…)`.
pub(super) fn expression(text: &str) -> Option<&str> {
    let at = text.find("${").or_else(|| text.find("$("))?;
    let rest = text.get(at..)?;
    rest.split_inclusive(['}', ')']).next()
}
