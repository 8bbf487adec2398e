//! Expands templates in the Fawkes spelling.

mod query;
mod value;

use std::collections::{HashMap, HashSet};
use std::rc::Rc;
use std::sync::Arc;

use bson::raw::RawBsonRef;
use bson::{Bson, Document, RawDocument, RawDocumentBuf, doc};

use super::assembly::{Assembled, Assembler, Emitted, Literal};
use super::origin::{DocumentId, StretchKind, document_id};
use super::taken::Taken;
use super::{Generated, ProblemError, Request, SectionReport};
use crate::formats::Texts;
use crate::formats::marker::{self, Node, QueryKind, Section};
use crate::formats::{Diagnostic, Respelled, Source, Span, shell};
use crate::memory::Memory;
use crate::store::{Documents, Find, Namespace, StoreError};
use query::{filled, placeholders};
use value::{kind, resolve, resolve_alike, spell};

/// What Fawkes writes for a value that it has no text for.
const INVALID: &str = "INVALID_VALUE_TYPE";

/// Renders the template over the memory.
pub(super) fn expand(request: &Request, goal: Option<&str>, memory: &Memory) -> Result<Generated, ProblemError> {
    let template = marker::parse(&request.template)?;
    let mut kept = HashSet::new();
    find_kept(&template.nodes, false, &mut kept);
    let parameters: Document = request.parameters.iter().cloned().collect();
    let parameters = RawDocumentBuf::try_from(&parameters).map_err(|error| {
        Diagnostic::new(&request.template, Span::default(), format!("a parameter cannot be used: {error}"))
    })?;
    let texts = Texts::new(&request.template, []);
    let mut expander = Expander {
        request,
        goal,
        memory,
        parameters,
        namespace: Arc::new(request.collection.clone()),
        assembler: Assembler::new(&texts),
        reports: Vec::new(),
        kept,
        answered: HashMap::new(),
        latest: HashMap::new(),
        respelled: Respelled::default(),
    };
    expander.nodes(&template.nodes, None)?;
    let Assembled { text, placed, values } = expander.assembler.finish()?;
    let namespaces = expander.reports.first().map(|report| report.namespace.clone()).into_iter().collect();
    let (sections, respelled) = (expander.reports, expander.respelled.take());
    let is_goal_unused = goal.is_some() && !placed.iter().any(|placed| placed.kind == StretchKind::Goal);
    let (remarks, template) = (Vec::new(), texts.clone());
    Ok(Generated { text, sections, namespaces, respelled, remarks, is_goal_unused, template, placed, values })
}

/// What the template takes from outside: keys of its markers may be those of documents, too.
pub(super) fn taken(template: &Source) -> Taken {
    fn note(nodes: &[Node], taken: &mut Taken) {
        for node in nodes {
            match node {
                Node::Value { key, .. } if key == "GOAL" => taken.takes_goal = true,
                Node::Value { key, .. } => drop(taken.names.insert(key.clone())),
                Node::Section(section) => {
                    let query = section.query.as_ref().map_or("", |query| query.text.as_str());
                    taken.names.extend(placeholders(query).map(|(_, name)| name.to_owned()));
                    note(&section.body, taken);
                }
                Node::Separator(body) => note(body, taken),
                Node::Text(_) => {}
            }
        }
    }
    let Ok(template) = marker::parse(template) else { return Taken::unknown() };
    let mut taken = Taken::default();
    note(&template.nodes, &mut taken);
    taken
}

/// The sections whose documents are needed more than once: those inside of others, and those used again by name.
fn find_kept(nodes: &[Node], nested: bool, kept: &mut HashSet<String>) {
    for node in nodes {
        match node {
            Node::Section(section) => {
                if nested || section.query.is_none() {
                    kept.insert(section.name.clone());
                }
                find_kept(&section.body, true, kept);
            }
            Node::Separator(body) => find_kept(body, true, kept),
            Node::Text(_) | Node::Value { .. } => {}
        }
    }
}

/// The document of the innermost section.
#[derive(Clone, Copy)]
struct Scope<'a> {
    document: &'a RawDocument,
    id: Option<&'a DocumentId>,
    last: bool,
}

struct Expander<'a> {
    request: &'a Request,
    goal: Option<&'a str>,
    memory: &'a Memory,
    parameters: RawDocumentBuf,
    namespace: Arc<Namespace>,
    assembler: Assembler,
    reports: Vec<SectionReport>,
    kept: HashSet<String>,
    /// Documents of kept sections, by the place of their query.
    answered: HashMap<usize, Rc<Vec<RawDocumentBuf>>>,
    /// The same, by the section's name.
    latest: HashMap<String, Rc<Vec<RawDocumentBuf>>>,
    /// Keys that were found in another spelling.
    respelled: Respelled,
}

impl<'a> Expander<'a> {
    /// The reader bounds how deep sections nest.
    fn nodes(&mut self, nodes: &[Node], scope: Option<Scope<'_>>) -> Result<(), ProblemError> {
        for node in nodes {
            match node {
                Node::Text(span) => {
                    let place = Literal { start: span.start, document: scope.and_then(|scope| scope.id).cloned() };
                    self.assembler.literal(self.request.template.slice(*span), place)?;
                }
                Node::Value { key, span } => self.value(key, *span, scope)?,
                Node::Section(section) => self.section(section)?,
                Node::Separator(body) if scope.is_some_and(|scope| !scope.last) => self.nodes(body, scope)?,
                Node::Separator(_) => {}
            }
        }
        Ok(())
    }

    fn section(&mut self, section: &Section) -> Result<(), ProblemError> {
        if section.query.is_some() && !self.kept.contains(&section.name) {
            return self.stream(section);
        }
        let Some(documents) = self.documents(section)? else { return Ok(()) };
        for (index, document) in documents.iter().enumerate() {
            let last = index + 1 == documents.len();
            let id = document_id(&self.namespace, document);
            self.nodes(&section.body, Some(Scope { document, id: id.as_ref(), last }))?;
        }
        Ok(())
    }

    /// Expands a section that is used once, one document at a time.
    fn stream(&mut self, section: &Section) -> Result<(), ProblemError> {
        let (mut documents, report) = self.ask(section)?;
        let mut matched = 0;
        let mut next = documents.next();
        while let Some(document) = next {
            let document = document.map_err(|error| self.failed(section, error))?;
            next = documents.next();
            matched += 1;
            let id = document_id(&self.namespace, &document);
            self.nodes(&section.body, Some(Scope { document: &document, id: id.as_ref(), last: next.is_none() }))?;
        }
        self.reports.get_mut(report).into_iter().for_each(|report| report.matched = matched);
        Ok(())
    }

    /// The documents of a section that is used more than once; `None` if there is no such section and that is fine.
    fn documents(&mut self, section: &Section) -> Result<Option<Rc<Vec<RawDocumentBuf>>>, ProblemError> {
        let Some(query) = &section.query else {
            if let Some(documents) = self.latest.get(&section.name) {
                return Ok(Some(Rc::clone(documents)));
            }
            if self.request.lenient {
                return Ok(None);
            }
            let message = format!("there is no section `{}` with a query before this one", section.name);
            return Err(Diagnostic::new(&self.request.template, section.span, message)
                .hint(format!("write <<#{}|{{query}}>>", section.name))
                .into());
        };
        if let Some(documents) = self.answered.get(&query.span.start) {
            return Ok(Some(Rc::clone(documents)));
        }
        let (documents, report) = self.ask(section)?;
        let documents = documents.collect::<Result<Vec<_>, _>>().map_err(|error| self.failed(section, error))?;
        self.reports.get_mut(report).into_iter().for_each(|report| report.matched = documents.len() as u64);
        let documents = Rc::new(documents);
        self.answered.insert(query.span.start, Rc::clone(&documents));
        self.latest.insert(section.name.clone(), Rc::clone(&documents));
        Ok(Some(documents))
    }

    /// Asks a section's query; returns its answer and the number of its report.
    fn ask(&mut self, section: &Section) -> Result<(Documents<'a>, usize), ProblemError> {
        let template = &self.request.template;
        let ns = &self.request.collection;
        let Some(query) = &section.query else { return Ok((Box::new(std::iter::empty()), 0)) };
        let (asked, answer) = match query.kind {
            QueryKind::Find => {
                let filter = shell::parse_document_in(template, query.span).map_err(cut_short).map_err(|error| {
                    match query.text.trim_start().starts_with('[') {
                        true => {
                            error.without_hints().hint(format!("a pipeline has two bars: <<#{}||[…]>>", section.name))
                        }
                        false => error,
                    }
                })?;
                let filter = filled(filter, self.request, query.span)?;
                (filter.clone(), self.memory.find(ns, &Find { filter, ..Find::default() }))
            }
            QueryKind::Pipeline => {
                let pipeline = shell::parse_pipeline_in(template, query.span).map_err(cut_short)?;
                let pipeline = pipeline.into_iter().map(|stage| filled(stage, self.request, query.span));
                let pipeline = pipeline.collect::<Result<Vec<_>, _>>()?;
                (doc! { "pipeline": pipeline.clone() }, self.memory.aggregate_reading(ns, &pipeline))
            }
        };
        let documents = answer.map_err(|error| self.failed(section, error))?;
        let (line, column) = template.position(section.span.start);
        let message = format!("no document of {ns} matches this section");
        self.reports.push(SectionReport {
            unmatched: Diagnostic::new(template, section.span, message),
            name: section.name.clone(),
            namespace: ns.clone(),
            query: asked,
            matched: 0,
            part: None,
            line,
            column,
        });
        Ok((documents, self.reports.len() - 1))
    }

    fn failed(&self, section: &Section, error: StoreError) -> ProblemError {
        let span = section.query.as_ref().map_or(section.span, |query| query.span);
        ProblemError::store(&self.request.template, span, error)
    }

    fn value(&mut self, key: &str, span: Span, scope: Option<Scope<'_>>) -> Result<(), ProblemError> {
        let wrong = |message: String| Diagnostic::new(&self.request.template, span, message);
        if let Some(value) = scope.and_then(|scope| resolve(scope.document, key)) {
            return self.emit(key, value, span, scope.and_then(|scope| scope.id));
        }
        if let (true, Some(goal)) = (key == "GOAL", self.goal) {
            return Ok(self.assembler.goal(goal, span)?);
        }
        let parameters = self.parameters.clone();
        if let Some(value) = resolve(&parameters, key) {
            return self.emit(key, value, span, None);
        }
        let scoped = scope.and_then(|scope| Some((resolve_alike(scope.document, key)?, scope.id)));
        let given = || resolve_alike(&parameters, key).map(|found| (found, None));
        if let Some(((found, value), id)) = scoped.or_else(given) {
            self.respelled.add(key, &found);
            return self.emit(key, value, span, id);
        }
        if self.request.lenient {
            return Ok(());
        }
        let diagnostic = match (key, scope.and_then(|scope| scope.id).map(AsRef::as_ref)) {
            ("GOAL", _) => wrong("there is no goal for `<<GOAL>>`".to_owned()).hint("give one with --goal"),
            (_, Some((namespace, id))) => wrong(format!("the document has no key `{key}`"))
                .hint(super::origin::from_document(namespace, id))
                .hint("--lenient leaves it empty, as Fawkes does"),
            _ => wrong(format!("there is no value for `<<{key}>>`"))
                .hint("outside of sections there are GOAL and what -D gives"),
        };
        Err(diagnostic.into())
    }

    /// Adds a value; of an array every element, each after a blank.
    fn emit(
        &mut self,
        key: &str,
        value: RawBsonRef<'_>,
        template: Span,
        document: Option<&DocumentId>,
    ) -> Result<(), ProblemError> {
        if let RawBsonRef::Array(array) = value {
            for element in array.into_iter().filter_map(Result::ok) {
                self.assembler.text(" ")?;
                self.scalar(key, element, template, document)?;
            }
            return Ok(());
        }
        self.scalar(key, value, template, document)
    }

    fn scalar(
        &mut self,
        key: &str,
        value: RawBsonRef<'_>,
        template: Span,
        document: Option<&DocumentId>,
    ) -> Result<(), ProblemError> {
        if let Some((text, number)) = spell(value) {
            let value = Bson::try_from(value).ok().filter(|value| !matches!(value, Bson::String(_) | Bson::Symbol(_)));
            let (document, value) = (document.cloned(), value.map(Box::new));
            let emitted = Emitted { text, number, template, is_placed: true, document, goal: false, value };
            self.assembler.value(&emitted, template);
            return Ok(());
        }
        if self.request.lenient {
            return Ok(self.assembler.text(INVALID)?);
        }
        let message = format!("the value of `{key}` is {}, which PDDL has no name for", kind(value));
        let diagnostic = Diagnostic::new(&self.request.template, template, message);
        let diagnostic = match document.map(AsRef::as_ref) {
            Some((namespace, id)) => diagnostic.hint(super::origin::from_document(namespace, id)),
            None => diagnostic,
        };
        Err(diagnostic.hint(format!("--lenient writes {INVALID}, as Fawkes does")).into())
    }
}

/// A query that is not finished may be one that holds what ends it.
fn cut_short(error: Diagnostic) -> Diagnostic {
    if error.is_unterminated() {
        return error.hint("a query ends at the first `>>`; write `\\u003e` for `>` in its strings");
    }
    error
}
