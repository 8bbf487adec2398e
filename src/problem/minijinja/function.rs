//! The functions and filters that templates have.

use std::collections::{HashMap, VecDeque};
use std::fmt;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bson::{Bson, Document, RawDocumentBuf, doc};
use minijinja::value::{Enumerator, Kwargs, Object, ObjectRepr, Rest, Value, ValueKind};
use minijinja::{Environment, Error, ErrorKind, Output};

use super::value::{CLOSE, Doc, Looked, OPEN, Other, from_bson, to_bson};
use crate::formats::{Source, Span, shell};
use crate::problem::answer::{Answer, Asker, Question};
use crate::problem::assembly::Emitted;
use crate::store::{Find, Namespace, StoreError};

/// What the functions of one rendering share.
#[derive(Debug)]
pub(super) struct Context {
    asker: Asker,
    /// Where each numbered place is in the template.
    pub(super) sites: Vec<Span>,
    /// The place of the expression that is written next.
    at: AtomicUsize,
    looked: Arc<Looked>,
    failure: Mutex<Option<StoreError>>,
    emitted: Mutex<Vec<Emitted>>,
    asked: Mutex<Vec<Asked>>,
    /// Whom the template asked, for whatever.
    namespaces: Mutex<Vec<Namespace>>,
    /// Values that the filter `name` made texts of, by those texts.
    named: Mutex<HashMap<String, Bson>>,
}

/// A query that was asked, perhaps several times with different filters.
#[derive(Debug, Clone)]
pub(super) struct Asked {
    pub(super) site: Option<usize>,
    pub(super) namespace: Arc<Namespace>,
    pub(super) query: Document,
    pub(super) matched: Arc<AtomicU64>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn invalid(message: impl Into<String>) -> Error {
    Error::new(ErrorKind::InvalidOperation, message.into())
}

impl Context {
    pub(super) fn new(asker: Asker, sites: Vec<Span>) -> Self {
        Self {
            asker,
            sites,
            at: AtomicUsize::new(usize::MAX),
            looked: Arc::default(),
            failure: Mutex::default(),
            emitted: Mutex::default(),
            asked: Mutex::default(),
            namespaces: Mutex::default(),
            named: Mutex::default(),
        }
    }

    /// Says that nothing more will be asked.
    pub(super) fn end(&self) {
        self.asker.end();
    }

    /// Why the store did not answer, if that is what ended the rendering.
    pub(super) fn failure(&self) -> Option<StoreError> {
        lock(&self.failure).take()
    }

    /// The values that were written, by number.
    pub(super) fn emitted(&self) -> Vec<Emitted> {
        std::mem::take(&mut *lock(&self.emitted))
    }

    /// The queries that were asked.
    pub(super) fn asked(&self) -> Vec<Asked> {
        lock(&self.asked).clone()
    }

    /// The namespaces that were asked.
    pub(super) fn namespaces(&self) -> Vec<Namespace> {
        lock(&self.namespaces).clone()
    }

    /// Keeps a value for the problem; its number in brackets stands for it in the rendered text.
    pub(super) fn emit(&self, value: &Value, out: &mut Output<'_>) -> Result<(), Error> {
        let (text, number) = self.spell(value)?;
        let value = self.typed(value).or_else(|| lock(&self.named).get(&text).cloned()).map(Box::new);
        self.keep(
            Emitted { text, number, template: self.site(), document: self.looked.take(), goal: false, value },
            out,
        )
    }

    /// Keeps the goal for the problem, like a value.
    pub(super) fn emit_goal(&self, goal: &str, out: &mut Output<'_>) -> Result<(), Error> {
        self.looked.take();
        let text = goal.to_owned();
        let goal = Emitted { text, number: false, template: self.site(), document: None, goal: true, value: None };
        self.keep(goal, out)
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
    fn name(&self, value: &Value) -> Result<String, Error> {
        let (text, _) = self.spell(value)?;
        if let Some(value) = self.typed(value) {
            lock(&self.named).entry(text.clone()).or_insert(value);
        }
        Ok(text)
    }

    /// The value in the memory, where it is no text.
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
    fn spell(&self, value: &Value) -> Result<(String, bool), Error> {
        if let Some(Other(other)) = value.downcast_object_ref::<Other>() {
            return match other {
                Bson::ObjectId(id) => Ok((id.to_hex(), false)),
                Bson::Decimal128(_) => Err(invalid("a decimal is no name; use the filter `number`")),
                Bson::DateTime(_) => Err(invalid("a date is no name; use the filter `number` for its milliseconds")),
                _ => Err(invalid(format!("{value} has no name in PDDL"))),
            };
        }
        match value.kind() {
            ValueKind::String => Ok((self.plain(value.as_str().unwrap_or_default()), false)),
            ValueKind::Bool => Ok((if value.is_true() { "true" } else { "false" }.to_owned(), false)),
            ValueKind::Number if value.is_integer() => Ok((value.to_string(), true)),
            ValueKind::Number => match f64::try_from(value.clone())? {
                number if !number.is_finite() => Err(invalid("NaN and infinity are no numbers in PDDL")),
                number if number.fract() == 0.0 => Ok((format!("{number:.1}"), true)),
                number => Ok((number.to_string(), true)),
            },
            ValueKind::None => Err(invalid("null has no name in PDDL; test with `is none` first")),
            ValueKind::Undefined => Err(Error::new(ErrorKind::UndefinedError, "there is no such value")),
            ValueKind::Seq | ValueKind::Iterable => Err(invalid("a list is no name; go through it with `for`")),
            ValueKind::Map => Err(invalid("a document is no name; take one of its keys")),
            kind => Err(invalid(format!("a value of type {kind} has no name in PDDL"))),
        }
    }

    /// Rendered text with the texts of the values instead of their numbers.
    pub(super) fn plain(&self, text: &str) -> String {
        if !text.contains(OPEN) {
            return text.to_owned();
        }
        let emitted = lock(&self.emitted);
        pieces(text)
            .map(|piece| match piece {
                Piece::Text(text) => text.to_owned(),
                Piece::Value(number) => emitted.get(number).map_or(String::new(), |value| value.text.clone()),
            })
            .collect()
    }

    /// Asks the memory; a failure is kept with its type.
    fn ask(&self, question: Question) -> Result<Answer, Error> {
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
    fn note(&self, site: Option<usize>, namespace: &Arc<Namespace>, query: &Document) -> Arc<AtomicU64> {
        let mut asked = lock(&self.asked);
        let known = asked.iter().find(|known| known.site == site && known.namespace == *namespace);
        if let Some(known) = known {
            return Arc::clone(&known.matched);
        }
        let matched = Arc::new(AtomicU64::new(0));
        let (namespace, query) = (Arc::clone(namespace), query.clone());
        asked.push(Asked { site, namespace, query, matched: Arc::clone(&matched) });
        matched
    }

    /// A filter, update or the like: a map, or text in the shell spelling.
    fn document(&self, value: Option<&Value>, what: &str) -> Result<Document, Error> {
        let Some(value) = value.filter(|value| !value.is_none()) else { return Ok(Document::new()) };
        match to_bson(value, &|text| self.plain(text))? {
            Bson::Document(document) => Ok(document),
            Bson::String(text) => shell::parse_document(&Source::new(format!("<{what}>"), text))
                .map_err(|error| invalid(format!("in the {what}: {}", first_line(&error.to_string())))),
            _ => Err(invalid(format!("the {what} must be a map, or text like \"{{key: 'value'}}\""))),
        }
    }

    fn pipeline(&self, value: &Value) -> Result<Vec<Document>, Error> {
        let wrong = || invalid("the pipeline must be a list of stages, or text like \"[{$match: …}]\"");
        match to_bson(value, &|text| self.plain(text))? {
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

/// `<filter>:1:5: expected …` without the lines below.
fn first_line(text: &str) -> &str {
    text.lines().next().unwrap_or_default()
}

/// A part of rendered text.
pub(super) enum Piece<'a> {
    Text(&'a str),
    /// The number of a value.
    Value(usize),
}

/// Takes rendered text apart.
pub(super) fn pieces(text: &str) -> impl Iterator<Item = Piece<'_>> {
    let mut rest = text;
    std::iter::from_fn(move || {
        if let Some(after) = rest.strip_prefix(OPEN) {
            let (number, after) = after.split_once(CLOSE).unwrap_or((after, ""));
            rest = after;
            return Some(Piece::Value(number.parse().unwrap_or(usize::MAX)));
        }
        let end = rest.find(OPEN).unwrap_or(rest.len());
        let (piece, after) = rest.split_at(end);
        rest = after;
        (!piece.is_empty()).then_some(Piece::Text(piece))
    })
}

/// The documents of a query, fetched as a loop asks for them.
struct Documents {
    context: Arc<Context>,
    namespace: Arc<Namespace>,
    asked: Selection,
    matched: Arc<AtomicU64>,
}

#[derive(Debug, Clone)]
enum Selection {
    Find(Box<Find>),
    Pipeline(Vec<Document>),
}

impl fmt::Debug for Documents {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "documents of {}", self.namespace)
    }
}

impl Documents {
    fn cursor(&self) -> Cursor {
        Cursor {
            context: Arc::clone(&self.context),
            namespace: Arc::clone(&self.namespace),
            open: Some(self.asked.clone()),
            number: None,
            ready: VecDeque::new(),
            matched: Arc::clone(&self.matched),
        }
    }
}

impl Object for Documents {
    fn repr(self: &Arc<Self>) -> ObjectRepr {
        ObjectRepr::Iterable
    }

    fn enumerate(self: &Arc<Self>) -> Enumerator {
        Enumerator::Iter(Box::new(self.cursor()))
    }

    fn enumerator_len(self: &Arc<Self>) -> Option<usize> {
        None
    }

    fn is_true(self: &Arc<Self>) -> bool {
        self.cursor().next().is_some()
    }
}

struct Cursor {
    context: Arc<Context>,
    namespace: Arc<Namespace>,
    /// What is to be asked at the first step.
    open: Option<Selection>,
    /// The answer that has more.
    number: Option<u64>,
    ready: VecDeque<RawDocumentBuf>,
    matched: Arc<AtomicU64>,
}

impl Cursor {
    fn advance(&mut self) -> Result<Option<RawDocumentBuf>, Error> {
        if let Some(selection) = self.open.take() {
            let ns = self.namespace.as_ref().clone();
            let question = match selection {
                Selection::Find(find) => Question::Find(ns, *find),
                Selection::Pipeline(pipeline) => Question::Aggregate(ns, pipeline),
            };
            if let Answer::Cursor(number) = self.context.ask(question)? {
                self.number = Some(number);
            }
        }
        if let (true, Some(number)) = (self.ready.is_empty(), self.number)
            && let Answer::Documents(documents, last) = self.context.ask(Question::Next(number))?
        {
            self.number = self.number.filter(|_| !last);
            self.ready.extend(documents);
        }
        Ok(self.ready.pop_front())
    }
}

impl Iterator for Cursor {
    type Item = Value;

    fn next(&mut self) -> Option<Value> {
        match self.advance() {
            Ok(document) => {
                let document = document?;
                self.matched.fetch_add(1, Ordering::Relaxed);
                Some(Doc::value(document, &self.namespace, &self.context.looked))
            }
            Err(error) => {
                self.number = None;
                Some(Value::from(error))
            }
        }
    }
}

impl Drop for Cursor {
    fn drop(&mut self) {
        if let Some(number) = self.number {
            let _ = self.context.asker.ask(Question::Close(number));
        }
    }
}

/// The arguments of a call, its place taken out.
struct Call {
    site: Option<usize>,
    positional: VecDeque<Value>,
    named: Kwargs,
}

impl Call {
    fn new(context: &Context, arguments: Rest<Value>, named: Kwargs) -> Self {
        let mut positional: VecDeque<Value> = arguments.0.into();
        let first = positional.front().filter(|value| value.is_integer()).and_then(Value::as_usize);
        let site = first.filter(|site| *site < context.sites.len());
        if site.is_some() {
            positional.pop_front();
        }
        Self { site, positional, named }
    }

    fn next(&mut self, name: &str) -> Result<Option<Value>, Error> {
        match self.positional.pop_front() {
            Some(value) => Ok(Some(value)),
            None => self.named.get::<Option<Value>>(name),
        }
    }

    fn namespace(&mut self, context: &Context) -> Result<Arc<Namespace>, Error> {
        let value = self.next("ns")?.ok_or_else(|| Error::new(ErrorKind::MissingArgument, "expected a namespace"))?;
        let text = value.as_str().ok_or_else(|| invalid("a namespace must be text like \"robmem.worldmodel\""))?;
        let namespace = Namespace::parse(text).map_err(|error| invalid(error.to_string()))?;
        let mut asked = lock(&context.namespaces);
        if !asked.contains(&namespace) {
            asked.push(namespace.clone());
        }
        Ok(Arc::new(namespace))
    }

    fn number(&mut self, name: &str) -> Result<u64, Error> {
        let Some(value) = self.named.get::<Option<Value>>(name)?.filter(|value| !value.is_none()) else { return Ok(0) };
        value
            .as_i64()
            .and_then(|number| u64::try_from(number).ok())
            .ok_or_else(|| invalid(format!("`{name}` must be a whole number from 0 on")))
    }

    fn find(&mut self, context: &Context) -> Result<Find, Error> {
        let filter = self.next("filter")?;
        let sort = self.named.get::<Option<Value>>("sort")?;
        if sort.as_ref().is_some_and(|sort| sort.kind() == ValueKind::Map && sort.len() > Some(1)) {
            return Err(invalid("a map has no order; write several sort keys as text like \"{a: 1, b: -1}\""));
        }
        let projection = self.named.get::<Option<Value>>("projection")?;
        Ok(Find {
            filter: context.document(filter.as_ref(), "filter")?,
            sort: context.document(sort.as_ref(), "sort")?,
            projection: context.document(projection.as_ref(), "projection")?,
            skip: self.number("skip")?,
            limit: self.number("limit")?,
        })
    }

    fn end(&self) -> Result<(), Error> {
        if !self.positional.is_empty() {
            return Err(Error::from(ErrorKind::TooManyArguments));
        }
        self.named.assert_all_used()
    }
}

fn query(context: &Arc<Context>, mut call: Call) -> Result<Value, Error> {
    let namespace = call.namespace(context)?;
    let find = call.find(context)?;
    call.end()?;
    let matched = context.note(call.site, &namespace, &find.filter);
    let context = Arc::clone(context);
    Ok(Value::from_object(Documents { context, namespace, asked: Selection::Find(Box::new(find)), matched }))
}

fn aggregate(context: &Arc<Context>, mut call: Call) -> Result<Value, Error> {
    let namespace = call.namespace(context)?;
    let pipeline =
        call.next("pipeline")?.ok_or_else(|| Error::new(ErrorKind::MissingArgument, "expected a pipeline"))?;
    let pipeline = context.pipeline(&pipeline)?;
    call.end()?;
    let matched = context.note(call.site, &namespace, &doc! { "pipeline": pipeline.clone() });
    let context = Arc::clone(context);
    Ok(Value::from_object(Documents { context, namespace, asked: Selection::Pipeline(pipeline), matched }))
}

fn find_one(context: &Arc<Context>, mut call: Call) -> Result<Value, Error> {
    let namespace = call.namespace(context)?;
    let find = Find { limit: 1, ..call.find(context)? };
    call.end()?;
    let (context, matched) = (Arc::clone(context), Arc::default());
    let documents = Documents { context, namespace, asked: Selection::Find(Box::new(find)), matched };
    let document = documents.cursor().advance()?;
    Ok(document
        .map_or(Value::from(()), |document| Doc::value(document, &documents.namespace, &documents.context.looked)))
}

fn count(context: &Arc<Context>, mut call: Call) -> Result<Value, Error> {
    let namespace = call.namespace(context)?;
    let filter = call.next("filter")?;
    let filter = context.document(filter.as_ref(), "filter")?;
    call.end()?;
    match context.ask(Question::Count(namespace.as_ref().clone(), filter))? {
        Answer::Count(count) => Ok(Value::from(count)),
        _ => Err(invalid("the memory gave no count")),
    }
}

fn distinct(context: &Arc<Context>, mut call: Call) -> Result<Value, Error> {
    let namespace = call.namespace(context)?;
    let field = call.next("field")?.ok_or_else(|| Error::new(ErrorKind::MissingArgument, "expected a field"))?;
    let field = field.as_str().ok_or_else(|| invalid("a field must be text like \"position.x\""))?.to_owned();
    let filter = call.next("filter")?;
    let filter = context.document(filter.as_ref(), "filter")?;
    call.end()?;
    let matched = context.note(call.site, &namespace, &doc! { "distinct": &field, "query": filter.clone() });
    match context.ask(Question::Distinct(namespace.as_ref().clone(), field, filter))? {
        Answer::Values(values) => {
            matched.fetch_add(values.len() as u64, Ordering::Relaxed);
            Ok(values.iter().map(|value| from_bson(value, &context.looked)).collect())
        }
        _ => Err(invalid("the memory gave no values")),
    }
}

/// A number from a number, from text that is one, or from a date (its milliseconds); rounded to `digits` decimals.
fn number(context: &Context, value: &Value, digits: Option<u32>) -> Result<Value, Error> {
    let parsed = match value.downcast_object_ref::<Other>() {
        Some(Other(Bson::DateTime(date))) => Value::from(date.timestamp_millis()),
        Some(Other(other)) => numeric(&other.to_string())?,
        None if value.kind() == ValueKind::Bool => Value::from(i32::from(value.is_true())),
        None if value.is_number() => value.clone(),
        None => numeric(context.plain(value.as_str().unwrap_or_default()).trim())?,
    };
    let Some(digits) = digits else { return Ok(parsed) };
    let scale = 10_f64.powi(digits.min(15) as i32);
    Ok(Value::from((f64::try_from(parsed)? * scale).round() / scale))
}

fn numeric(text: &str) -> Result<Value, Error> {
    if let Ok(number) = text.parse::<i64>() {
        return Ok(Value::from(number));
    }
    let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
    number.map(Value::from).ok_or_else(|| invalid(format!("`{}` is no number", text.escape_debug())))
}

/// Gives an environment what templates can call.
pub(super) fn register(environment: &mut Environment<'_>, context: &Arc<Context>, parameters: Vec<(String, Value)>) {
    type Function = fn(&Arc<Context>, Call) -> Result<Value, Error>;
    let functions: [(&'static str, Function); 5] =
        [("query", query), ("find_one", find_one), ("count", count), ("distinct", distinct), ("aggregate", aggregate)];
    for (name, function) in functions {
        let context = Arc::clone(context);
        environment.add_function(name, move |arguments: Rest<Value>, named: Kwargs| {
            function(&context, Call::new(&context, arguments, named))
        });
    }
    let shared = Arc::clone(context);
    environment.add_filter(super::instrument::AT, move |value: Value, site: usize| {
        shared.at.store(site, Ordering::Relaxed);
        value
    });
    let shared = Arc::clone(context);
    environment.add_filter("number", move |value: Value, digits: Option<u32>| number(&shared, &value, digits));
    let shared = Arc::clone(context);
    environment.add_filter("name", move |value: Value| shared.name(&value));
    environment.add_function("param", move |name: String, default: Option<Value>| {
        let found = parameters.iter().find(|(known, _)| *known == name).map(|(_, value)| value.clone());
        found.or(default).ok_or_else(|| invalid(format!("the parameter `{name}` is not given; say -D {name}=…")))
    });
}
