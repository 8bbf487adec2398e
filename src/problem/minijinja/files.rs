//! The texts that are rendered together: a template, and those that it names.

use super::bound;
use super::instrument::{Instrumented, Numbered, instrument};
use super::naming::Names;
use super::value::{CLOSE, OPEN};
use crate::formats::Texts;
use crate::formats::{Diagnostic, Source, Span};
use crate::problem::Request;

/// The texts that are rendered together.
pub(super) struct Files {
    /// As they were written, the template first.
    pub(super) texts: Texts,
    /// As minijinja gets them, in the same order, with the names that it knows them by.
    instrumented: Vec<(String, Instrumented)>,
}

impl Files {
    /// Checks and instruments the texts of a request, so that what they write says where it comes from if that `is_noted`.
    pub(super) fn read(request: &Request, is_noted: bool) -> Result<(Self, Numbered), Diagnostic> {
        let texts = Texts::new(&request.template, request.parts.iter().map(|part| part.source.clone()));
        let all: Vec<&str> = texts.iter().map(|(_, source)| source.text()).collect();
        let names = std::iter::once(request.template.name()).chain(request.parts.iter().map(|part| part.name.as_str()));
        let mut numbered = Numbered::default();
        let mut instrumented = Vec::with_capacity(all.len());
        for (name, (base, source)) in names.zip(texts.iter()) {
            if let Some(offset) = source.text().find([OPEN, CLOSE]) {
                return Err(Diagnostic::new(source, Span::at(offset), "a template cannot hold this character"));
            }
            bound::check(source)?;
            instrumented.push((name.to_owned(), instrument(source.text(), *base, &all, is_noted, &mut numbered)));
        }
        numbered.names = Names::of(request);
        Ok((Self { texts, instrumented }, numbered))
    }

    /// The instrumented texts with their names, that of the template first.
    pub(super) fn named(&self) -> impl Iterator<Item = (&str, &str)> {
        self.instrumented.iter().map(|(name, instrumented)| (name.as_str(), instrumented.text.as_str()))
    }

    /// The text that minijinja knows by a name, as it was written and as minijinja has it; the template where there is none.
    pub(super) fn of(&self, name: Option<&str>) -> Option<(&Source, &Instrumented)> {
        let found = self.instrumented.iter().skip(1).position(|(known, _)| Some(known.as_str()) == name);
        let place = found.map_or(0, |place| place + 1);
        let (_, source) = self.texts.iter().nth(place)?;
        Some((source, &self.instrumented.get(place)?.1))
    }
}
