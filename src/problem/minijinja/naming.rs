//! The tags by which a template names others. A name is a text in quotes, or computed from such texts and from parameters:
//! only these are looked for in the folders of templates before anything is rendered.

use std::collections::HashSet;
use std::path::{Component, Path};

use minijinja::value::{Value, ValueKind};
use minijinja::{Error, ErrorKind};

use super::advice::Hint;
use super::tags::{Tag, TagKind, tags};
use crate::formats::Span;
use crate::problem::Request;

/// The words of these tags.
const WORDS: [&str; 4] = ["include", "extends", "import", "from"];

/// A tag that names other templates.
pub(super) struct Naming<'t> {
    /// What the name is computed from, and its offset in the tag.
    pub(super) expression: &'t str,
    pub(super) at: usize,
    /// Whether the template may be missing.
    pub(super) is_optional: bool,
}

/// How a name is given.
pub(super) enum Given<'t> {
    /// As a text in quotes.
    Name(&'t str),
    /// As the first of these that is there.
    List(Vec<&'t str>),
    Computed,
}

impl<'t> Naming<'t> {
    pub(super) fn of(tag: &Tag<'t>) -> Option<Self> {
        let word = tag.word();
        if tag.kind != TagKind::Statement || !WORDS.contains(&word) {
            return None;
        }
        let (code, words) = (tag.code(), tag.words());
        let pair = |first: &str, second: &str| {
            let found = words.windows(2).skip(1).find(|pair| pair[0].1 == first && pair[1].1 == second);
            found.map(|pair| pair[0].0)
        };
        let single = |wanted: &str| words.iter().skip(1).find(|(_, word)| *word == wanted).map(|(at, _)| *at);
        let ignoring = pair("ignore", "missing");
        let end = match word {
            "include" => {
                let ends = [ignoring, pair("with", "context"), pair("without", "context")];
                ends.into_iter().flatten().min().unwrap_or(code.len())
            }
            "import" => single("as")?,
            "from" => single("import")?,
            _ => code.len(),
        };
        let expression = code.get(word.len()..end)?;
        let blanks = expression.len() - expression.trim_start().len();
        let at = tag.text.find(code)? + word.len() + blanks;
        let expression = expression.trim();
        (!expression.is_empty()).then_some(Self { expression, at, is_optional: ignoring.is_some() })
    }

    pub(super) fn given(&self) -> Given<'t> {
        let mut rest = self.expression.to_owned();
        let names: Vec<&str> = quoted(self.expression).collect();
        for name in &names {
            rest = rest.replacen(&format!("\"{name}\""), "", 1).replacen(&format!("'{name}'"), "", 1);
        }
        let rest: String = rest.chars().filter(|c| !c.is_whitespace()).collect();
        let commas = rest.matches(',').count();
        match names.as_slice() {
            [name] if rest.is_empty() => Given::Name(name),
            [_, ..] if ["[]", "()"].contains(&rest.replace(',', "").as_str()) && commas + 1 >= names.len() => {
                Given::List(names)
            }
            _ => Given::Computed,
        }
    }
}

/// The tags of a template that name others.
pub(super) fn namings(template: &str) -> impl Iterator<Item = (Tag<'_>, Naming<'_>)> {
    tags(template).filter_map(|tag| Naming::of(&tag).map(|naming| (tag, naming)))
}

/// A template that another one names.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::problem) struct Reference {
    pub(in crate::problem) name: String,
    /// The tag that names it.
    pub(in crate::problem) span: Span,
    /// Whether it may be missing.
    pub(in crate::problem) is_optional: bool,
}

/// The templates that a template includes, extends or imports by names in quotes.
pub(in crate::problem) fn references(template: &str) -> Vec<Reference> {
    let mut references = Vec::new();
    for (tag, naming) in namings(template) {
        let (names, is_optional) = match naming.given() {
            Given::Name(name) => (vec![name], naming.is_optional),
            Given::List(names) => (names, true),
            Given::Computed => continue,
        };
        let reference = |name: &str| Reference { name: name.to_owned(), span: tag.span, is_optional };
        references.extend(names.into_iter().map(reference));
    }
    references
}

/// Whether a template computes the name of another one.
pub(in crate::problem) fn computes_names(template: &str) -> bool {
    namings(template).any(|(_, naming)| matches!(naming.given(), Given::Computed))
}

/// The texts in quotes of a template's tags.
pub(in crate::problem) fn quoted_texts(template: &str) -> impl Iterator<Item = &str> {
    let is_code = |tag: &Tag<'_>| matches!(tag.kind, TagKind::Statement | TagKind::Expression);
    tags(template).filter(is_code).flat_map(|tag| quoted(tag.text))
}

/// The texts in quotes in code, as they are written.
fn quoted(code: &str) -> impl Iterator<Item = &str> {
    let mut rest = code;
    std::iter::from_fn(move || {
        let start = rest.find(['"', '\''])?;
        let quote = rest.get(start..)?.chars().next()?;
        let text = rest.get(start + 1..)?;
        let mut is_escaped = false;
        let end = text.find(|c| {
            let is_end = c == quote && !is_escaped;
            is_escaped = c == '\\' && !is_escaped;
            is_end
        })?;
        rest = text.get(end + 1..)?;
        text.get(..end)
    })
}

/// Whether a name leads to no place outside of the folder that it is looked for in, as far as it tells.
pub(in crate::problem) fn is_inside(name: &str) -> bool {
    let is_inner = |part| matches!(part, Component::Normal(_) | Component::CurDir);
    !name.is_empty() && Path::new(name).components().all(is_inner) && !name.contains(['\\', '\0'])
}

fn refused(message: String) -> Error {
    Error::new(ErrorKind::InvalidOperation, message)
}

/// The names that templates may compute.
#[derive(Debug, Default)]
pub(super) struct Names {
    /// Those of templates that are there.
    loaded: HashSet<String>,
    /// All that were looked for.
    written: HashSet<String>,
}

impl Names {
    /// The names of the templates of a request; none where all are given in quotes.
    pub(super) fn of(request: &Request) -> Self {
        let texts = || std::iter::once(&request.template).chain(request.parts.iter().map(|part| &part.source));
        let is_chosen = |text: &str| namings(text).any(|(_, naming)| !matches!(naming.given(), Given::Name(_)));
        if !texts().any(|source| is_chosen(source.text())) {
            return Self::default();
        }
        let parameters = request.parameters.iter().filter_map(|(_, value)| value.as_str());
        Self {
            loaded: request.parts.iter().map(|part| part.name.clone()).collect(),
            written: texts()
                .flat_map(|source| quoted_texts(source.text()))
                .chain(parameters)
                .map(str::to_owned)
                .collect(),
        }
    }

    /// The name of the template that a value names: the first of a list that is there.
    pub(super) fn choose(&self, value: Value, is_optional: bool) -> Result<Value, Error> {
        let choices: Vec<Value> = match value.kind() {
            ValueKind::Seq => value.try_iter()?.collect(),
            _ => vec![value.clone()],
        };
        for choice in &choices {
            // What is no text is refused where it is used.
            let Some(name) = choice.as_str() else { return Ok(value) };
            if self.loaded.contains(name) {
                return Ok(Value::from(name));
            }
            if !is_inside(name) {
                return Err(refused(format!("`{}` leads out of the folders of templates", name.escape_debug())));
            }
            if !self.written.contains(name) {
                let message =
                    format!("`{}` is not the name of a template that is written in quotes", name.escape_debug());
                let hint = "a name may be chosen, but not put together: write each as a whole, or give it with -D";
                return Err(refused(message).with_source(Hint(hint.to_owned())));
            }
        }
        let names: Vec<String> = choices.iter().filter_map(Value::as_str).map(|name| format!("`{name}`")).collect();
        let message = match names.as_slice() {
            _ if is_optional => return Ok(value),
            [name] => format!("there is no template {name}"),
            names => format!("there is none of the templates {}", names.join(", ")),
        };
        let hint = "it is looked for in the folder of the template, and in those of --template-path";
        Err(refused(message).with_source(Hint(hint.to_owned())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn templates_are_named_by_what_is_written_in_quotes_as_a_whole() {
        let named = "{% extends 'a.j2' %}{% include [\"b.j2\", 'c.j2'] %}{% from 'd' import e %}{% include x ignore missing %}\
             {% include 'f' ~ 'g' %}{%- import 'h' as i -%}{% include 'j' ignore missing %}{% include 'k' if x else 'l' %}";
        let named: Vec<_> = references(named).into_iter().map(|one| (one.name, one.is_optional)).collect();
        let wanted = [("a.j2", false), ("b.j2", true), ("c.j2", true), ("d", false), ("h", false), ("j", true)];
        assert_eq!(named, wanted.map(|(name, is_optional)| (name.to_owned(), is_optional)));
    }
}
