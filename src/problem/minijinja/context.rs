//! What the functions of one rendering share: the memory, its answers, and what was written.

use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use bson::{Bson, Document, RawDocumentBuf};
use minijinja::value::{Value, ValueKind};
use minijinja::{Error, ErrorKind, Output};

use super::compared::Compared;
use super::direct::{Direct, lock};
use super::instrument::Numbered;
use super::naming::Names;
use super::pieces::{Piece, is_cut, is_marked, may_be_marked, pieces};
use super::plan::Plan;
use super::value::{CLOSE, Joined, Looked, Missing, OPEN, Other, to_bson, write_double};
use crate::formats::{Source, Span, shell};
use crate::problem::answer::{Answer, Asker, Question};
use crate::problem::assembly::Emitted;
use crate::problem::stream::Stream;
use crate::store::{Namespace, StoreError};

/// What the functions of one rendering share.
#[derive(Debug)]
pub(super) struct Context {
    pub(super) asker: Asker,
    /// Where each numbered place is in the template.
    pub(super) sites: Vec<Span>,
    /// The place of the expression that is written next.
    pub(super) at: AtomicUsize,
    /// Whether nothing was written since that place was set.
    is_next: AtomicBool,
    /// Whether what is written now is what that place gave, and no part of it.
    is_placed: AtomicBool,
    /// The numbered places whose text is written as it is.
    written: HashSet<usize>,
    /// The loops that are written without minijinja.
    pub(super) plans: Vec<Arc<Plan>>,
    /// What one of them goes through, where that ended the rendering.
    pub(super) stopped: Mutex<Option<Span>>,
    /// The names of templates that may be computed.
    pub(super) names: Names,
    pub(super) looked: Arc<Looked>,
    pub(super) compared: Compared,
    failure: Mutex<Option<StoreError>>,
    emitted: Mutex<Vec<Emitted>>,
    /// Where the problem goes while it is rendered, if that is not noted.
    pub(super) direct: Option<Arc<Direct>>,
    asked: Mutex<Vec<Asked>>,
    /// The memory that the template queries.
    namespaces: Mutex<Vec<Namespace>>,
    /// Values that the filter `name` made texts of, by those texts.
    named: Mutex<HashMap<String, Bson>>,
    /// Values that were joined, by where their text lies.
    joined: Mutex<HashMap<usize, Arc<Joined>>>,
    /// Whether there are any.
    has_joined: AtomicBool,
}

/// A query that was asked, perhaps several times with different filters.
#[derive(Debug, Clone)]
pub(super) struct Asked {
    pub(super) site: Option<usize>,
    pub(super) namespace: Arc<Namespace>,
    pub(super) query: Document,
    pub(super) matched: Arc<AtomicU64>,
    /// How many documents of each of its queries were counted, by the query's hash.
    counted: HashMap<u64, Arc<AtomicU64>>,
}

/// Counts the documents of a query, each once, however often the template goes through them.
#[derive(Debug, Clone, Default)]
pub(super) struct Tally {
    matched: Arc<AtomicU64>,
    counted: Arc<AtomicU64>,
}

impl Tally {
    /// Counts the documents of the answer up to this number.
    pub(super) fn reach(&self, number: u64) {
        let before = self.counted.fetch_max(number, Ordering::Relaxed);
        self.matched.fetch_add(number.saturating_sub(before), Ordering::Relaxed);
    }
}

/// Where a text lies in memory.
fn address(text: &str) -> usize {
    text.as_ptr().addr()
}

pub(super) fn invalid(message: impl Into<String>) -> Error {
    Error::new(ErrorKind::InvalidOperation, message.into())
}

impl Context {
    pub(super) fn new(asker: Asker, numbered: Numbered) -> Self {
        let Numbered { sites, written, compared, plans, names, .. } = numbered;
        Self {
            asker,
            sites,
            at: AtomicUsize::new(usize::MAX),
            is_next: AtomicBool::new(false),
            is_placed: AtomicBool::new(false),
            written,
            plans: plans.into_iter().map(Arc::new).collect(),
            stopped: Mutex::default(),
            names,
            looked: Arc::default(),
            compared: Compared::new(compared),
            failure: Mutex::default(),
            emitted: Mutex::default(),
            direct: None,
            asked: Mutex::default(),
            namespaces: Mutex::default(),
            named: Mutex::default(),
            joined: Mutex::default(),
            has_joined: AtomicBool::new(false),
        }
    }

    /// The same for a problem that is made while it is rendered.
    pub(super) fn streaming(asker: Asker, numbered: Numbered, stream: Stream) -> Self {
        let looked = Arc::new(Looked::forgetful());
        Self { looked, direct: Some(Arc::new(Direct::new(stream))), ..Self::new(asker, numbered) }
    }

    /// Says that nothing more will be asked.
    pub(super) fn end(&self) {
        self.asker.end();
    }

    /// Why the store did not answer, if that is what ended the rendering.
    pub(super) fn failure(&self) -> Option<StoreError> {
        lock(&self.failure).take()
    }

    /// Whether the store did not answer.
    pub(super) fn has_failed(&self) -> bool {
        lock(&self.failure).is_some()
    }

    /// The values that were written, by number.
    pub(super) fn emitted(&self) -> Vec<Emitted> {
        std::mem::take(&mut *lock(&self.emitted))
    }

    /// The queries that were asked.
    pub(super) fn asked(&self) -> Vec<Asked> {
        lock(&self.asked).clone()
    }

    /// The last key that was asked for and that its document does not have.
    pub(super) fn missing(&self) -> Option<Missing> {
        self.looked.missing()
    }

    /// The namespaces that were asked.
    pub(super) fn namespaces(&self) -> Vec<Namespace> {
        lock(&self.namespaces).clone()
    }

    /// Keeps a value for the problem; its number in brackets stands for it in the rendered text.
    pub(super) fn emit(&self, value: &Value, out: &mut Output<'_>) -> Result<(), Error> {
        let (text, number) = self.spell(value)?;
        if let Some(direct) = &self.direct {
            return direct.emit(&text, number, false, out);
        }
        let text = text.into_owned();
        let value = self.typed(value).or_else(|| lock(&self.named).get(&text).cloned()).map(Box::new);
        let is_placed = self.is_placed.load(Ordering::Relaxed);
        let (template, document) = (self.site(), self.looked.take());
        self.keep(Emitted { text, number, template, is_placed, document, goal: false, value }, out)
    }

    /// Keeps joined values, each for itself.
    pub(super) fn emit_joined(&self, joined: &Joined, out: &mut Output<'_>) -> Result<(), Error> {
        for (index, value) in joined.values.iter().enumerate() {
            if index > 0 {
                out.write_str(&joined.between)?;
            }
            match (value.as_str().filter(|_| value.is_safe()), self.joined(value)) {
                (Some(written), _) => out.write_str(written)?,
                (None, Some(inner)) => self.emit_joined(&inner, out)?,
                (None, None) => self.emit(value, out)?,
            }
        }
        Ok(())
    }

    /// Sets the place of what is written next.
    pub(super) fn set_site(&self, site: usize) {
        self.at.store(site, Ordering::Relaxed);
        self.is_next.store(true, Ordering::Relaxed);
    }

    /// Takes the number of the place that is written, where its text may get marks; nothing the next time.
    pub(super) fn take_written(&self) -> Option<usize> {
        let site = self.at.load(Ordering::Relaxed);
        let is_next = self.is_next.swap(false, Ordering::Relaxed);
        self.is_placed.store(is_next, Ordering::Relaxed);
        (is_next && self.written.contains(&site)).then_some(site)
    }

    /// The text of values that are joined by white space. As long as it is passed on as it is, it is known by where it
    /// lies; whatever a filter makes of it is a text like any other, and one name.
    pub(super) fn join(&self, values: Vec<Value>, between: String, text: String) -> Value {
        let text: Arc<str> = text.into();
        let joined = Joined { values, between, text: Arc::clone(&text) };
        lock(&self.joined).insert(address(&text), Arc::new(joined));
        self.has_joined.store(true, Ordering::Relaxed);
        Value::from(text)
    }

    /// What was joined to this text.
    pub(super) fn joined(&self, value: &Value) -> Option<Arc<Joined>> {
        if !self.has_joined.load(Ordering::Relaxed) {
            return None;
        }
        let text = value.as_str()?;
        let found = lock(&self.joined).get(&address(text)).cloned()?;
        (found.text.len() == text.len()).then_some(found)
    }

    /// Keeps the goal for the problem, like a value.
    pub(super) fn emit_goal(&self, goal: &str, out: &mut Output<'_>) -> Result<(), Error> {
        if let Some(direct) = &self.direct {
            return direct.emit(goal, false, true, out);
        }
        self.looked.take();
        let text = goal.to_owned();
        let template = self.site();
        let is_placed = true;
        self.keep(Emitted { text, number: false, template, is_placed, document: None, goal: true, value: None }, out)
    }

    /// The place of the expression that is written.
    fn site(&self) -> Span {
        self.sites.get(self.at.load(Ordering::Relaxed)).copied().unwrap_or_default()
    }

    fn keep(&self, value: Emitted, out: &mut Output<'_>) -> Result<(), Error> {
        let mut emitted = lock(&self.emitted);
        emitted.push(value);
        Ok(write!(out, "{OPEN}{}{CLOSE}", emitted.len() - 1)?)
    }

    /// The name of a value as text; what it was is remembered.
    pub(super) fn name(&self, value: &Value) -> Result<String, Error> {
        let (text, _) = self.spell(value)?;
        let text = text.into_owned();
        if let Some(value) = self.typed(value).filter(|_| self.direct.is_none()) {
            lock(&self.named).entry(text.clone()).or_insert(value);
        }
        Ok(text)
    }

    /// The value in the memory, where it is not a text.
    fn typed(&self, value: &Value) -> Option<Bson> {
        if let Some(Other(other)) = value.downcast_object_ref::<Other>() {
            return matches!(other, Bson::ObjectId(_)).then(|| other.clone());
        }
        match value.kind() {
            ValueKind::Bool => Some(Bson::Boolean(value.is_true())),
            ValueKind::Number if value.is_integer() => {
                let number = value.as_i64()?;
                let short = i32::try_from(number).ok().filter(|_| !self.looked.is_long(number));
                Some(short.map_or(Bson::Int64(number), Bson::Int32))
            }
            ValueKind::Number => f64::try_from(value.clone()).ok().map(Bson::Double),
            _ => None,
        }
    }

    /// A value's text, and whether it is a number.
    fn spell<'v>(&self, value: &'v Value) -> Result<(Cow<'v, str>, bool), Error> {
        if let Some(Other(other)) = value.downcast_object_ref::<Other>() {
            return match other {
                Bson::ObjectId(id) => Ok((id.to_hex().into(), false)),
                Bson::Decimal128(_) => Err(invalid("a decimal is not a name; use the filter `number`")),
                Bson::DateTime(_) => Err(invalid("a date is not a name; use the filter `number` for its milliseconds")),
                _ => Err(invalid(format!("{value} has no name in PDDL"))),
            };
        }
        match value.kind() {
            ValueKind::String => match value.as_str().unwrap_or_default() {
                text if !may_be_marked(text) => Ok((Cow::Borrowed(text), false)),
                text if is_cut(text) => {
                    Err(invalid("a filter took rendered text apart; apply it to the values before they are rendered"))
                }
                text => Ok((self.plain(text), false)),
            },
            ValueKind::Bool => Ok((if value.is_true() { "true" } else { "false" }.into(), false)),
            ValueKind::Number if value.is_integer() => Ok((value.to_string().into(), true)),
            ValueKind::Number => match f64::try_from(value.clone())? {
                number if !number.is_finite() => Err(invalid("NaN and infinity are not numbers in PDDL")),
                number => {
                    let mut text = String::new();
                    write_double(&mut text, number).map_err(|_| ErrorKind::WriteFailure)?;
                    Ok((text.into(), true))
                }
            },
            ValueKind::None => Err(invalid("null has no name in PDDL; test with `is none` first")),
            ValueKind::Undefined => Err(Error::new(ErrorKind::UndefinedError, "there is no such value")),
            ValueKind::Seq | ValueKind::Iterable => Err(invalid("a list is not a name; go through it with `for`")),
            ValueKind::Map => Err(invalid("a document is not a name; take one of its keys")),
            kind => Err(invalid(format!("a value of type {kind} has no name in PDDL"))),
        }
    }

    /// Rendered text with the texts of the values instead of their numbers.
    pub(super) fn plain<'t>(&self, text: &'t str) -> Cow<'t, str> {
        if !is_marked(text) {
            return Cow::Borrowed(text);
        }
        let emitted = lock(&self.emitted);
        let value = |number| match &self.direct {
            Some(direct) => direct.text(number),
            None => emitted.get(number).map(|value| value.text.clone()),
        };
        let piece = |piece| match piece {
            Piece::Text(text) => text.to_owned(),
            Piece::Mark(_) | Piece::Begin(_) | Piece::End => String::new(),
            Piece::Value(number) => value(number).unwrap_or_default(),
        };
        Cow::Owned(pieces(text).map(piece).collect())
    }

    /// Asks the memory; a failure is kept with its type.
    pub(super) fn ask(&self, question: Question) -> Result<Answer, Error> {
        match self.asker.ask(question) {
            Some(Answer::Failed(error)) => {
                let message = error.to_string();
                lock(&self.failure).get_or_insert(error);
                Err(invalid(message))
            }
            Some(answer) => Ok(answer),
            None => Err(invalid("the memory is gone")),
        }
    }

    /// Notes a query; the same place and namespace share a count.
    pub(super) fn note(&self, site: Option<usize>, namespace: &Arc<Namespace>, query: &Document) -> Tally {
        let mut asked = lock(&self.asked);
        let known = asked.iter().position(|known| known.site == site && known.namespace == *namespace);
        let place = known.unwrap_or_else(|| {
            let (namespace, query) = (Arc::clone(namespace), query.clone());
            asked.push(Asked { site, namespace, query, matched: Arc::default(), counted: HashMap::new() });
            asked.len() - 1
        });
        let Some(asked) = asked.get_mut(place) else { return Tally::default() };
        let counted = asked.counted.entry(hash(query)).or_default();
        Tally { matched: Arc::clone(&asked.matched), counted: Arc::clone(counted) }
    }

    /// Notes a namespace that is asked.
    pub(super) fn note_namespace(&self, namespace: &Namespace) {
        let mut known = lock(&self.namespaces);
        if !known.contains(namespace) {
            known.push(namespace.clone());
        }
    }

    /// A filter, update or the like: a map, or text in the shell spelling.
    pub(super) fn document(&self, value: Option<&Value>, what: &str) -> Result<Document, Error> {
        let Some(value) = value.filter(|value| !value.is_none()) else { return Ok(Document::new()) };
        match to_bson(value, &|text| self.plain(text).into_owned())? {
            Bson::Document(document) => Ok(document),
            Bson::String(text) => shell::parse_document(&Source::new(format!("<{what}>"), text))
                .map_err(|error| invalid(format!("in the {what}: {}", first_line(&error.to_string())))),
            _ => Err(invalid(format!("the {what} must be a map, or text like \"{{key: 'value'}}\""))),
        }
    }

    pub(super) fn pipeline(&self, value: &Value) -> Result<Vec<Document>, Error> {
        let wrong = || invalid("the pipeline must be a list of stages, or text like \"[{$match: …}]\"");
        match to_bson(value, &|text| self.plain(text).into_owned())? {
            Bson::String(text) => shell::parse_pipeline(&Source::new("<pipeline>", text))
                .map_err(|error| invalid(format!("in the pipeline: {}", first_line(&error.to_string())))),
            Bson::Document(stage) => Ok(vec![stage]),
            Bson::Array(stages) => {
                let stages = stages.into_iter().map(|stage| match stage {
                    Bson::Document(stage) => Some(stage),
                    _ => None,
                });
                stages.collect::<Option<_>>().ok_or_else(wrong)
            }
            _ => Err(wrong()),
        }
    }
}

fn hash(query: &Document) -> u64 {
    let mut hasher = DefaultHasher::new();
    // Every document that was read or written as text can be encoded.
    RawDocumentBuf::try_from(query).unwrap_or_default().as_bytes().hash(&mut hasher);
    hasher.finish()
}

/// `<filter>:1:5: expected …` without the lines below.
fn first_line(text: &str) -> &str {
    text.lines().next().unwrap_or_default()
}
