//! Elements that another program has to replace before a file says what it means.

use super::Element;
use crate::formats::Diagnostic;

/// The namespace of XInclude.
const XINCLUDE: &str = "http://www.w3.org/2001/XInclude";

/// Refuses elements that stand for others.
pub(super) fn check(root: Element<'_>) -> Result<(), Diagnostic> {
    root.all().try_for_each(|element| {
        if element.node.tag_name().namespace() == Some(XINCLUDE) || element.name().starts_with("xi:") {
            let message = format!("<{}> includes another file, which is not read", element.name());
            return Err(element.wrong(message).hint("`xmllint --xinclude FILE` puts that file in its place"));
        }
        Ok(())
    })
}
