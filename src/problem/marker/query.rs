//! Parameters in the queries of sections: `%NAME%` inside of a text.

use bson::{Bson, Document};

use crate::formats::{Diagnostic, Span, nearest};
use crate::problem::Request;

/// The parameters that a text names, each with the offset of its `%`.
pub(super) fn placeholders(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut offset = 0;
    std::iter::from_fn(move || {
        loop {
            let start = offset + text.get(offset..)?.find('%')?;
            let rest = text.get(start + 1..)?;
            let length = rest.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(rest.len());
            let name = rest.get(..length)?;
            let is_name = rest.get(length..)?.starts_with('%') && name.starts_with(|c: char| !c.is_ascii_digit());
            offset = start + 1 + length + usize::from(is_name);
            if is_name && !name.is_empty() {
                return Some((start, name));
            }
        }
    })
}

/// A query with the values of the parameters that its texts name. A text that is nothing but `%NAME%` becomes the value with its type.
pub(super) fn filled(query: Document, request: &Request, place: Span) -> Result<Document, Diagnostic> {
    query.into_iter().map(|(key, value)| Ok((key, fill(value, request, place)?))).collect()
}

fn fill(value: Bson, request: &Request, place: Span) -> Result<Bson, Diagnostic> {
    match value {
        Bson::String(text) => fill_text(text, request, place),
        Bson::Document(inner) => filled(inner, request, place).map(Bson::Document),
        Bson::Array(elements) => {
            let elements = elements.into_iter().map(|element| fill(element, request, place));
            elements.collect::<Result<_, _>>().map(Bson::Array)
        }
        other => Ok(other),
    }
}

fn fill_text(text: String, request: &Request, place: Span) -> Result<Bson, Diagnostic> {
    let (mut result, mut copied) = (String::new(), 0);
    for (start, name) in placeholders(&text) {
        let found = request.parameters.iter().find(|(known, _)| known == name).map(|(_, value)| value);
        let Some(value) = found else {
            if request.lenient {
                continue;
            }
            let message = format!("there is no parameter `{name}` for `%{name}%`");
            let diagnostic = Diagnostic::new(&request.template, place, message);
            let near = nearest(name, request.parameters.iter().map(|(known, _)| known.as_str()));
            let diagnostic = match near {
                Some(near) => diagnostic.hint(format!("did you mean `%{near}%`?")),
                None => diagnostic,
            };
            return Err(diagnostic.hint(format!("give it with -D {name}=…")));
        };
        let length = name.len() + 2;
        if length == text.len() {
            return Ok(value.clone());
        }
        result.push_str(text.get(copied..start).unwrap_or_default());
        match value {
            Bson::String(text) => result.push_str(text),
            other => crate::formats::shell::write_relaxed(other, &mut result),
        }
        copied = start + length;
    }
    if copied == 0 {
        return Ok(Bson::String(text));
    }
    result.push_str(text.get(copied..).unwrap_or_default());
    Ok(Bson::String(result))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_placeholder_is_a_name_between_percent_signs() {
        let names = |text| placeholders(text).map(|(_, name)| name).collect::<Vec<_>>();
        assert_eq!(names("{team: '%TEAM%', n: '%a_1%%B%'}"), ["TEAM", "a_1", "B"]);
        assert_eq!(names("100% of %% and %1x% %x"), [""; 0]);
    }
}
