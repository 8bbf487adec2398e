//! What a plan was made from, kept with it, so that its problem can be instantiated again.
//!
//! Texts are kept, not only where they were: an executive may ask from another folder or
//! machine, and the files may have changed since. Under `_robmem_info.lineage.sources`:
//!
//! ```text
//! { domain: {name, text}, template: {name, text}, parts: [{as, part: {name, text}}], syntax, collection, goal, parameters: {…}, lenient }
//! { domain: {name, text}, problem: {name, text}, lenient }
//! ```
//!
//! `parts` are the templates that the template names, by the names it has for them. `goal` is there where one was
//! given, and `name` says where a text was read. The address of the memory, which may hold credentials, is not part of
//! it.

use bson::{Bson, Document, doc};

use crate::fault::{AtFault, Fault};
use crate::formats::pddl::Dialect;
use crate::formats::{Diagnostics, Source};
use crate::pddl::Domain;
use crate::problem::{Request, Syntax, TemplatePart};
use crate::store::Namespace;

/// The longest text that is kept, in bytes; a document has 16 MiB at most.
const LONGEST: usize = 4 << 20;

/// What a plan was made from.
#[derive(Debug, Clone, PartialEq)]
pub struct TaskSource {
    /// The domain's text.
    pub domain: Source,
    /// The problem, or what generates it.
    pub input: Input,
    /// Whether `//` is a comment, as `--lenient` says.
    pub lenient: bool,
}

/// How a problem was given.
#[derive(Debug, Clone, PartialEq)]
pub enum Input {
    /// As a text.
    Problem(Source),
    /// As a template with all it needs but the memory.
    Template(Box<Request>),
}

/// Why a stored plan's problem cannot be instantiated again.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SourceError {
    /// A text or a setting is not there.
    #[error("the plan does not say its {0}, which is needed to instantiate its problem again")]
    Missing(&'static str),
    /// A text was longer than what is kept.
    #[error("the plan's {0} was longer than {limit} MiB and is not kept with it", limit = LONGEST >> 20)]
    TooLong(&'static str),
}

impl AtFault for SourceError {
    fn fault(&self) -> Fault {
        Fault::Input
    }
}

impl Input {
    /// The text of the problem, or of the template.
    #[must_use]
    pub fn text(&self) -> &Source {
        match self {
            Self::Problem(problem) => problem,
            Self::Template(request) => &request.template,
        }
    }
}

impl TaskSource {
    /// Reads and checks the domain.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn read_domain(&self) -> Result<Domain, Diagnostics> {
        Domain::read(&self.domain, Dialect { lenient: self.lenient }).map_err(Diagnostics)
    }

    /// Whether the problem comes from the memory.
    #[must_use]
    pub fn is_template(&self) -> bool {
        matches!(self.input, Input::Template(_))
    }

    /// The document.
    #[must_use]
    pub fn to_document(&self) -> Document {
        let mut document = doc! { "domain": kept(&self.domain) };
        match &self.input {
            Input::Problem(problem) => {
                document.insert("problem", kept(problem));
            }
            Input::Template(request) => {
                document.insert("template", kept(&request.template));
                if !request.parts.is_empty() {
                    let part = |part: &TemplatePart| doc! { "as": &part.name, "part": kept(&part.source) };
                    document.insert("parts", request.parts.iter().map(part).collect::<Vec<_>>());
                }
                document.insert("syntax", word(request.syntax));
                document.insert("collection", request.collection.to_string());
                if let Some(goal) = &request.goal {
                    document.insert("goal", goal);
                }
                document.insert("parameters", request.parameters.iter().cloned().collect::<Document>());
            }
        }
        document.insert("lenient", self.lenient);
        document
    }

    /// Reads what [`TaskSource::to_document`] wrote.
    ///
    /// # Errors
    /// What is missing.
    pub fn from_document(document: &Document) -> Result<Self, SourceError> {
        let lenient = document.get_bool("lenient").unwrap_or_default();
        let domain = read(document, "domain")?;
        if document.contains_key("problem") {
            return Ok(Self { domain, input: Input::Problem(read(document, "problem")?), lenient });
        }
        let collection = document.get_str("collection").ok().and_then(|name| Namespace::parse(name).ok());
        let parameters = document.get_document("parameters").map_err(|_| SourceError::Missing("parameters"))?;
        let request = Request {
            template: read(document, "template")?,
            parts: document.get_array("parts").into_iter().flatten().map(part).collect::<Result<_, _>>()?,
            syntax: document.get_str("syntax").ok().and_then(syntax).ok_or(SourceError::Missing("syntax"))?,
            collection: collection.ok_or(SourceError::Missing("collection"))?,
            goal: document.get_str("goal").ok().map(str::to_owned),
            parameters: parameters.iter().map(|(name, value)| (name.clone(), value.clone())).collect(),
            lenient,
        };
        Ok(Self { domain, input: Input::Template(Box::new(request)), lenient })
    }
}

fn kept(source: &Source) -> Bson {
    let mut kept = doc! { "name": source.name() };
    if source.text().len() <= LONGEST {
        kept.insert("text", source.text());
    }
    kept.into()
}

fn read(document: &Document, what: &'static str) -> Result<Source, SourceError> {
    let kept = document.get_document(what).map_err(|_| SourceError::Missing(what))?;
    let name = kept.get_str("name").map_err(|_| SourceError::Missing(what))?;
    let text = kept.get_str("text").map_err(|_| SourceError::TooLong(what))?;
    Ok(Source::new(name, text))
}

/// A template that another one names.
fn part(part: &Bson) -> Result<TemplatePart, SourceError> {
    let part = part.as_document().ok_or(SourceError::Missing("parts"))?;
    let name = part.get_str("as").map_err(|_| SourceError::Missing("parts"))?;
    Ok(TemplatePart { name: name.to_owned(), source: read(part, "part")? })
}

const SYNTAXES: [(Syntax, &str); 3] =
    [(Syntax::Auto, "auto"), (Syntax::Minijinja, "minijinja"), (Syntax::Marker, "marker")];

fn word(syntax: Syntax) -> &'static str {
    SYNTAXES.iter().find(|(known, _)| *known == syntax).map_or("auto", |(_, word)| word)
}

fn syntax(word: &str) -> Option<Syntax> {
    SYNTAXES.iter().find(|(_, known)| *known == word).map(|(syntax, _)| *syntax)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_reads_back_the_same() {
        let request = Request {
            template: Source::new("t.j2", "{{ goal }}"),
            parts: vec![TemplatePart { name: "m.j2".to_owned(), source: Source::new("lib/m.j2", "{# macros #}") }],
            syntax: Syntax::Minijinja,
            collection: Namespace::parse("lab.world").unwrap(),
            goal: Some("(on A B)".to_owned()),
            parameters: vec![("team".to_owned(), "CYAN".into()), ("n".to_owned(), Bson::Int32(3))],
            lenient: true,
        };
        let domain = Source::new("d.pddl", "(define (domain d))");
        let template = TaskSource { domain: domain.clone(), input: Input::Template(Box::new(request)), lenient: true };
        let problem = TaskSource { domain, input: Input::Problem(Source::new("-", "(define)")), lenient: false };
        for source in [template, problem] {
            assert_eq!(TaskSource::from_document(&source.to_document()), Ok(source));
        }
    }

    #[test]
    fn a_text_that_is_too_long_is_left_out_and_missed() {
        let long = Source::new("p.pddl", "x".repeat(LONGEST + 1));
        let source = TaskSource { domain: Source::new("d", ""), input: Input::Problem(long), lenient: false };
        let read = TaskSource::from_document(&source.to_document());
        assert_eq!(read, Err(SourceError::TooLong("problem")));
        assert_eq!(TaskSource::from_document(&doc! {}), Err(SourceError::Missing("domain")));
    }
}
