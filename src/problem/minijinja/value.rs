//! Documents as values of the template environment, read where they lie.

use std::borrow::Cow;
use std::cmp::Ordering;
use std::collections::HashSet;
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use bson::raw::RawBsonRef;
use bson::{Bson, Document, RawDocument, RawDocumentBuf};
use minijinja::value::{DynObject, Enumerator, Object, ObjectRepr, Value, ValueKind};
use minijinja::{Error, ErrorKind};

use super::advice::Hint;
use crate::formats::{Respelled, is_alike, shell};
use crate::problem::batch::Batch;
use crate::problem::origin::{DocumentId, document_id};
use crate::query::field;
use crate::store::{Namespace, metadata};

/// Brackets around the number of a value in rendered text. Unicode reserves
/// these characters for programs; texts that hold them are refused.
pub(super) const OPEN: char = '\u{FDD0}';
/// See [`OPEN`].
pub(super) const CLOSE: char = '\u{FDD1}';

/// How deep a value may nest that goes into a query.
const MAX_DEPTH: usize = 100;

/// Writes a finite number as PDDL spells it: with a point.
pub(super) fn write_double(out: &mut impl fmt::Write, number: f64) -> fmt::Result {
    if number.fract() == 0.0 { write!(out, "{number:.1}") } else { write!(out, "{number}") }
}

/// What the template looked at: the last document, and which numbers were of 64 bits, which minijinja
/// does not distinguish from those of 32.
#[derive(Debug, Default)]
pub(super) struct Looked {
    /// Whether neither is asked for.
    is_forgetful: bool,
    last: Mutex<Option<(Arc<Page>, usize)>>,
    longs: Mutex<HashSet<i64>>,
    missed: Mutex<Option<Missed>>,
    /// Keys that were found in another spelling.
    pub(super) respelled: Respelled,
}

/// A key that a document was asked for and does not have.
#[derive(Debug)]
struct Missed {
    page: Arc<Page>,
    nth: usize,
    /// The document inside that was asked.
    inner: Option<RawDocumentBuf>,
    key: String,
}

/// A key that a document does not have, for messages.
#[derive(Debug)]
pub(super) struct Missing {
    pub(super) key: String,
    /// The keys that it has.
    pub(super) keys: Vec<String>,
    pub(super) document: Option<DocumentId>,
}

impl Looked {
    /// One that does not remember the last document and the numbers.
    pub(super) fn forgetful() -> Self {
        Self { is_forgetful: true, ..Self::default() }
    }

    /// The last key that a document was asked for and does not have.
    pub(super) fn missing(&self) -> Option<Missing> {
        let Missed { page, nth, inner, key } = self.missed.lock().unwrap_or_else(PoisonError::into_inner).take()?;
        let keys = inner.as_deref().unwrap_or_else(|| page.batch.get(nth)).iter().filter_map(Result::ok);
        let keys = keys.map(|(key, _)| key.as_str().to_owned()).filter(|key| key != metadata::INFO).collect();
        Some(Missing { key, keys, document: page.id(nth) })
    }

    fn miss(&self, document: &Doc, key: &str) {
        let (page, inner) = (Arc::clone(&document.page), document.inner.clone());
        let missed = Missed { page, nth: document.nth, inner, key: key.to_owned() };
        *self.missed.lock().unwrap_or_else(PoisonError::into_inner) = Some(missed);
    }

    fn at(&self, page: &Arc<Page>, nth: usize) {
        if self.is_forgetful {
            return;
        }
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if !last.as_ref().is_some_and(|(last, place)| Arc::ptr_eq(last, page) && *place == nth) {
            *last = Some((Arc::clone(page), nth));
        }
    }

    fn long(&self, number: i64) {
        if self.is_forgetful {
            return;
        }
        self.longs.lock().unwrap_or_else(PoisonError::into_inner).insert(number);
    }

    /// Whether the number was seen with 64 bits.
    pub(super) fn is_long(&self, number: i64) -> bool {
        self.longs.lock().unwrap_or_else(PoisonError::into_inner).contains(&number)
    }

    /// The keys of the document that was looked at last.
    pub(super) fn keys(&self) -> Vec<String> {
        let last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let Some((page, nth)) = last.as_ref() else { return Vec::new() };
        let keys = page.batch.get(*nth).iter().filter_map(Result::ok).map(|(key, _)| key.as_str().to_owned());
        keys.filter(|key| !page.batch.hides(key)).collect()
    }

    /// What names the document that was looked at last, where it has one of the keys in an expression.
    pub(super) fn document_of(&self, expression: &str) -> Option<DocumentId> {
        let is_part = |c: char| c.is_alphanumeric() || c == '_' || c == '-';
        let keys = self.keys();
        let mut words = expression.split(|c| !is_part(c)).filter(|word| !word.is_empty());
        words.find(|word| keys.iter().any(|key| key == word || is_alike(key, word)))?;
        let last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        last.as_ref().and_then(|(page, nth)| page.id(*nth))
    }

    /// The last document's `_id`; nothing the next time.
    pub(super) fn take(&self) -> Option<DocumentId> {
        let (page, nth) = self.last.lock().unwrap_or_else(PoisonError::into_inner).take()?;
        page.id(nth)
    }
}

/// Documents of one query.
#[derive(Debug, Default)]
pub(super) struct Page {
    pub(super) batch: Batch,
    /// Where they are stored; nothing where they are not.
    namespace: Option<Arc<Namespace>>,
    /// What names the document that was asked for last.
    id: Mutex<Option<(usize, Option<DocumentId>)>>,
}

impl Page {
    /// Documents as the memory gives them.
    pub(super) fn new(batch: Batch, namespace: &Arc<Namespace>) -> Arc<Self> {
        Arc::new(Self { batch, namespace: Some(Arc::clone(namespace)), id: Mutex::default() })
    }

    /// What names a document.
    fn id(&self, nth: usize) -> Option<DocumentId> {
        let mut known = self.id.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, id)) = known.as_ref().filter(|(place, _)| *place == nth) {
            return id.clone();
        }
        let id = self.namespace.as_ref().and_then(|namespace| document_id(namespace, self.batch.get(nth)));
        *known = Some((nth, id.clone()));
        id
    }
}

/// A document, or one inside of it.
pub(super) struct Doc {
    page: Arc<Page>,
    /// Which document of the page it is, or is in.
    nth: usize,
    /// The one inside.
    inner: Option<RawDocumentBuf>,
    looked: Arc<Looked>,
}

impl fmt::Debug for Doc {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&shell::relaxed(&self.document().unwrap_or_default()))
    }
}

impl Doc {
    /// A document of a page.
    pub(super) fn value(page: &Arc<Page>, nth: usize, looked: &Arc<Looked>) -> Value {
        Value::from_object(Self { page: Arc::clone(page), nth, inner: None, looked: Arc::clone(looked) })
    }

    fn raw(&self) -> &RawDocument {
        self.inner.as_deref().unwrap_or_else(|| self.page.batch.get(self.nth))
    }

    /// Whether the template does not see a key.
    fn hides(&self, key: &str) -> bool {
        self.inner.is_none() && self.page.batch.hides(key)
    }

    /// The entries that the template sees.
    fn entries(&self) -> impl Iterator<Item = (&str, RawBsonRef<'_>)> {
        let entries = self.raw().iter().filter_map(Result::ok).map(|(key, value)| (key.as_str(), value));
        entries.filter(|(key, _)| !self.hides(key))
    }

    /// What the template sees.
    fn seen(&self) -> Option<Cow<'_, RawDocument>> {
        match self.hides(metadata::INFO) {
            true => Some(Cow::Owned(metadata::hide(self.raw().to_owned()).ok()?)),
            false => Some(Cow::Borrowed(self.raw())),
        }
    }

    /// The value of a key that differs from this one only in hyphens and underscores.
    fn alike(&self, key: &str) -> Option<RawBsonRef<'_>> {
        let (found, value) = self.entries().find(|(name, _)| is_alike(name, key))?;
        self.looked.respelled.add(key, found);
        Some(value)
    }

    fn document(&self) -> Result<Document, Error> {
        let mut document = Document::try_from(self.raw())
            .map_err(|error| Error::new(ErrorKind::InvalidOperation, error.to_string()))?;
        if self.hides(metadata::INFO) {
            document.remove(metadata::INFO);
        }
        Ok(document)
    }

    fn convert(&self, value: RawBsonRef<'_>) -> Value {
        match value {
            RawBsonRef::Document(inner) => {
                let (page, looked) = (Arc::clone(&self.page), Arc::clone(&self.looked));
                Value::from_object(Self { page, nth: self.nth, inner: Some(inner.to_owned()), looked })
            }
            RawBsonRef::Array(array) => {
                array.into_iter().filter_map(Result::ok).map(|element| self.convert(element)).collect()
            }
            RawBsonRef::String(text) | RawBsonRef::Symbol(text) => self::text(text),
            RawBsonRef::Int32(number) => Value::from(number),
            RawBsonRef::Int64(number) => {
                self.looked.long(number);
                Value::from(number)
            }
            RawBsonRef::Double(number) => Value::from(number),
            RawBsonRef::Boolean(flag) => Value::from(flag),
            RawBsonRef::Null => Value::from(()),
            other => Bson::try_from(other).map_or(Value::UNDEFINED, |value| Value::from_object(Other(value))),
        }
    }
}

impl Object for Doc {
    fn get_value(self: &Arc<Self>, key: &Value) -> Option<Value> {
        self.get_value_by_str(key.as_str()?)
    }

    fn get_value_by_str(self: &Arc<Self>, key: &str) -> Option<Value> {
        if self.page.namespace.is_some() {
            self.looked.at(&self.page, self.nth);
        }
        let value = field(self.raw(), key)
            .filter(|_| !self.hides(key))
            .or_else(|| self.alike(key))
            .map(|value| self.convert(value));
        if value.is_none() {
            self.looked.miss(self, key);
        }
        value
    }

    fn enumerate(self: &Arc<Self>) -> Enumerator {
        Enumerator::Values(self.entries().map(|(key, _)| Value::from(key)).collect())
    }

    fn custom_cmp(self: &Arc<Self>, other: &DynObject) -> Option<Ordering> {
        let other = other.downcast_ref::<Self>()?;
        Some(self.seen()?.as_bytes().cmp(other.seen()?.as_bytes()))
    }
}

/// A value that templates can compare, keep and put into queries, but that is not a name: a date, an ObjectId.
#[derive(Debug)]
pub(super) struct Other(pub(super) Bson);

impl Object for Other {
    fn repr(self: &Arc<Self>) -> ObjectRepr {
        ObjectRepr::Plain
    }

    fn custom_cmp(self: &Arc<Self>, other: &DynObject) -> Option<Ordering> {
        let other = other.downcast_ref::<Self>()?;
        match (&self.0, &other.0) {
            (Bson::DateTime(one), Bson::DateTime(other)) => Some(one.cmp(other)),
            (Bson::ObjectId(one), Bson::ObjectId(other)) => Some(one.cmp(other)),
            _ => Some(self.0.to_string().cmp(&other.0.to_string())),
        }
    }

    fn render(self: &Arc<Self>, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.0 {
            Bson::ObjectId(id) => f.write_str(&id.to_hex()),
            Bson::Decimal128(number) => write!(f, "{number}"),
            other => {
                let mut text = String::new();
                shell::write_relaxed(other, &mut text);
                f.write_str(&text)
            }
        }
    }
}

/// Values with white space between them. As a value they are one text; in a problem, each is a name or a number of its own.
#[derive(Debug)]
pub(super) struct Joined {
    pub(super) values: Vec<Value>,
    pub(super) between: String,
    /// The text. It is told from an equal text of another origin by where it lies in memory, so it is kept.
    pub(super) text: Arc<str>,
}

/// A text from outside.
pub(super) fn text(text: &str) -> Value {
    // Both begin with this byte, which texts seldom have.
    if memchr::memchr(0xEF, text.as_bytes()).is_some() && text.contains([OPEN, CLOSE]) {
        let message = "a value holds U+FDD0 or U+FDD1, which are not characters";
        return Value::from(Error::new(ErrorKind::InvalidOperation, message));
    }
    Value::from(text)
}

/// A parameter, or a distinct value.
pub(super) fn from_bson(value: &Bson, looked: &Arc<Looked>) -> Value {
    let Ok(raw) = RawDocumentBuf::try_from(&bson::doc! { "value": value.clone() }) else { return Value::UNDEFINED };
    let mut batch = Batch::default();
    batch.push(&raw);
    let page = Arc::new(Page { batch, ..Page::default() });
    let doc = Doc { page, nth: 0, inner: None, looked: Arc::clone(looked) };
    doc.raw().get("value").ok().flatten().map_or(Value::UNDEFINED, |value| doc.convert(value))
}

/// A value of the template as BSON, for queries. `plain` takes the numbers of values out of rendered text.
pub(super) fn to_bson(value: &Value, plain: &dyn Fn(&str) -> String) -> Result<Bson, Error> {
    nested(value, plain, 0)
}

fn nested(value: &Value, plain: &dyn Fn(&str) -> String, depth: usize) -> Result<Bson, Error> {
    let wrong = |message: String| Err(Error::new(ErrorKind::InvalidOperation, message));
    if depth > MAX_DEPTH {
        return wrong(format!("a query nests deeper than {MAX_DEPTH} levels"));
    }
    if let Some(Other(value)) = value.downcast_object_ref::<Other>() {
        return Ok(value.clone());
    }
    if let Some(doc) = value.downcast_object_ref::<Doc>() {
        return doc.document().map(Bson::Document);
    }
    match value.kind() {
        ValueKind::None => Ok(Bson::Null),
        ValueKind::Bool => Ok(Bson::Boolean(value.is_true())),
        ValueKind::Number => match value.as_i64().filter(|_| value.is_integer()) {
            Some(number) => Ok(i32::try_from(number).map_or(Bson::Int64(number), Bson::Int32)),
            None => f64::try_from(value.clone()).map(Bson::Double),
        },
        ValueKind::String => Ok(Bson::String(plain(value.as_str().unwrap_or_default()))),
        ValueKind::Seq | ValueKind::Iterable => {
            let elements = value.try_iter()?.checked().map(|element| nested(&element?, plain, depth + 1));
            elements.collect::<Result<_, _>>().map(Bson::Array)
        }
        ValueKind::Map => {
            let mut document = Document::new();
            for key in value.try_iter()?.checked() {
                let key = key?;
                if key.is_undefined() {
                    let hint =
                        Hint("a key is written in quotes: {'at': 'x'}, or all as one text: \"{at: 'x'}\"".to_owned());
                    let message = "a key of the query is a variable that is undefined";
                    return Err(Error::new(ErrorKind::InvalidOperation, message).with_source(hint));
                }
                document.insert(key.to_string(), nested(&value.get_item(&key)?, plain, depth + 1)?);
            }
            Ok(Bson::Document(document))
        }
        ValueKind::Undefined => wrong("a query holds an undefined value".to_owned()),
        kind => wrong(format!("a query cannot hold a value of type {kind}")),
    }
}
