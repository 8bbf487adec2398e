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

/// A query with the values of the parameters that its texts, patterns and keys name. A text that is nothing but
/// `%NAME%` becomes the value with its type; a key stays a key: no value makes an operator of it.
pub(super) fn filled(query: Document, request: &Request, place: Span) -> Result<Document, Diagnostic> {
    let mut result = Document::new();
    for (key, value) in query {
        let key = fill_key(key, request, place)?;
        if result.contains_key(&key) {
            let message = format!("the parameters make two keys `{}` of this query", key.escape_debug());
            return Err(Diagnostic::new(&request.template, place, message)
                .hint("a document has each key once; join the conditions with $and"));
        }
        result.insert(key, fill(value, request, place)?);
    }
    Ok(result)
}

fn fill(value: Bson, request: &Request, place: Span) -> Result<Bson, Diagnostic> {
    match value {
        Bson::String(text) => match whole(&text) {
            Some(name) => Ok(parameter(name, request, place)?.cloned().unwrap_or(Bson::String(text))),
            None => fill_text(&text, request, place).map(Bson::String),
        },
        Bson::RegularExpression(mut regex) => {
            let pattern = fill_text(regex.pattern.as_str(), request, place)?;
            regex.pattern = pattern.try_into().map_err(|_| {
                let message = "a parameter of this query has a null character, which a pattern cannot have";
                Diagnostic::new(&request.template, place, message.to_owned())
            })?;
            Ok(Bson::RegularExpression(regex))
        }
        Bson::Document(inner) => filled(inner, request, place).map(Bson::Document),
        Bson::Array(elements) => {
            let elements = elements.into_iter().map(|element| fill(element, request, place));
            elements.collect::<Result<_, _>>().map(Bson::Array)
        }
        other => Ok(other),
    }
}

/// The name in a text that is nothing but `%NAME%`.
fn whole(text: &str) -> Option<&str> {
    placeholders(text).next().map(|(_, name)| name).filter(|name| name.len() + 2 == text.len())
}

/// The value of a parameter; none for one that is not given, where that is no error.
fn parameter<'a>(name: &str, request: &'a Request, place: Span) -> Result<Option<&'a Bson>, Diagnostic> {
    let found = request.parameters.iter().find(|(known, _)| known == name).map(|(_, value)| value);
    if found.is_some() || request.lenient {
        return Ok(found);
    }
    let message = format!("there is no parameter `{name}` for `%{name}%`");
    let diagnostic = Diagnostic::new(&request.template, place, message);
    let diagnostic = match nearest(name, request.parameters.iter().map(|(known, _)| known.as_str())) {
        Some(near) => diagnostic.hint(format!("did you mean `%{near}%`?")),
        None => diagnostic,
    };
    Err(diagnostic.hint(format!("give it with -D {name}=…")))
}

fn fill_text(text: &str, request: &Request, place: Span) -> Result<String, Diagnostic> {
    let (mut result, mut copied) = (String::new(), 0);
    for (start, name) in placeholders(text) {
        let Some(value) = parameter(name, request, place)? else { continue };
        result.push_str(text.get(copied..start).unwrap_or_default());
        match value {
            Bson::String(text) => result.push_str(text),
            other => crate::formats::shell::write_relaxed(other, &mut result),
        }
        copied = start + name.len() + 2;
    }
    result.push_str(text.get(copied..).unwrap_or_default());
    Ok(result)
}

/// A key with the values of the parameters that it names: texts and whole numbers, which name a key or a path of keys.
fn fill_key(key: String, request: &Request, place: Span) -> Result<String, Diagnostic> {
    for (_, name) in placeholders(&key) {
        let Some(value) = parameter(name, request, place)? else { continue };
        let message = match value {
            Bson::String(text) if text.is_empty() => "is empty",
            Bson::String(text) if text.contains('\0') => "has a null character",
            Bson::String(text) if text.split('.').any(|part| part.starts_with('$')) => "would make it an operator",
            Bson::String(_) | Bson::Int32(_) | Bson::Int64(_) => continue,
            _ => "is neither text nor a whole number",
        };
        let message =
            format!("the parameter `{name}` cannot be used in the key `{}`: it {message}", key.escape_debug());
        return Err(Diagnostic::new(&request.template, place, message)
            .hint("a parameter in a key is the name of a key or a path, like `state` or `pose.x`"));
    }
    fill_text(&key, request, place)
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
