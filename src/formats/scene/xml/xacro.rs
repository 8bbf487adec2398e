//! Xacro, the language of macros that makes URDF.

/// The prefix of its elements.
pub(super) const PREFIX: &str = "xacro";

/// Whether an element declares the prefix.
pub(super) fn declares(node: roxmltree::Node<'_, '_>) -> bool {
    node.namespaces().any(|namespace| namespace.name() == Some(PREFIX))
}

/// The first expression of Xacro in a text: `${…}` or `$(…)`.
pub(super) fn expression(text: &str) -> Option<&str> {
    let at = text.find("${").or_else(|| text.find("$("))?;
    let rest = text.get(at..)?;
    rest.split_inclusive(['}', ')']).next()
}
