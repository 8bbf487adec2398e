//! Updates: how a document changes.
//!
//! Operators act on paths in the order of the paths (numbers by value, then
//! names), which is the order in which new fields appear. Two operators cannot
//! act on one path or on a path and its parent. `_id` never changes.

mod apply;
mod array;
mod field;
mod filters;
mod modifier;
mod parse;
mod rename;
mod upsert;

use std::cell::Cell;

use bson::{Bson, DateTime, Document, RawDocument, RawDocumentBuf};

use super::compare::equal_values;
use super::error::{QueryError, Result};
use super::expression::{Scope, Variables};
use super::filter::Filter;
use super::nesting::MAX_DEPTH;
use super::pipeline::Reshape;
use apply::Application;
use filters::ArrayFilters;
use modifier::Modifier;

/// The largest document, in bytes.
const MAX_SIZE: usize = 16 * 1024 * 1024;

/// A compiled update.
#[derive(Debug)]
pub struct Update {
    kind: Kind,
}

#[derive(Debug)]
enum Kind {
    Replacement(Document),
    Operators(Vec<Modifier>, ArrayFilters),
    Pipeline(Vec<Reshape>, Variables),
}

impl Update {
    /// Reads operators, or a replacement document, which is one without operators.
    ///
    /// # Errors
    /// Where MongoDB refuses it.
    pub fn parse(update: &Document, array_filters: &[Document]) -> Result<Self> {
        if update.keys().next().is_some_and(|name| name.starts_with('$')) {
            let filters = ArrayFilters::parse(array_filters)?;
            let modifiers = parse::modifiers(update, &filters)?;
            return Ok(Self { kind: Kind::Operators(modifiers, filters) });
        }
        if !array_filters.is_empty() {
            return Err(QueryError::failed_to_parse("arrayFilters need update operators"));
        }
        if let Some(name) = update.keys().find(|name| name.starts_with('$') && !super::filter::is_reference_key(name)) {
            return Err(QueryError::invalid(52, format!("the field {name} in a replacement may not start with '$'")));
        }
        Ok(Self { kind: Kind::Replacement(update.clone()) })
    }

    /// Reads an update in pipeline form.
    ///
    /// # Errors
    /// Where MongoDB refuses it, or a stage cannot be in an update.
    pub fn parse_pipeline(stages: &[Document]) -> Result<Self> {
        Self::parse_pipeline_with(stages, &Document::new())
    }

    /// [`Update::parse_pipeline`] with constants its expressions can use as `$$name`.
    ///
    /// # Errors
    /// As [`Update::parse_pipeline`].
    pub fn parse_pipeline_with(stages: &[Document], constants: &Document) -> Result<Self> {
        let (mut scope, variables) = Scope::with_constants(constants)?;
        scope.lazy = true;
        let stages = stages.iter().map(|stage| Reshape::parse_update(stage, &scope)).collect::<Result<_>>()?;
        Ok(Self { kind: Kind::Pipeline(stages, variables) })
    }

    /// Whether it is a replacement document, which MongoDB refuses for many documents.
    #[must_use]
    pub fn is_replacement(&self) -> bool {
        matches!(self.kind, Kind::Replacement(_))
    }

    /// The changed document, or nothing where it counts as unmodified. `filter`
    /// is the one the document matched, for the positional `$`. As in MongoDB, a
    /// replacement without `_id`, a `$push` and a sum that is NaN count as modifications even
    /// where the bytes are the same.
    ///
    /// # Errors
    /// Where the update cannot be applied to this document.
    pub fn apply(&self, document: &RawDocument, filter: &Filter, now: DateTime) -> Result<Option<RawDocumentBuf>> {
        let before = Document::try_from(document)?;
        let id = before.get("_id").cloned();
        let touched;
        let after = match &self.kind {
            Kind::Replacement(replacement) => {
                // One that leaves `_id` to the document counts as a change, as in MongoDB. So does a pipeline.
                touched = !replacement.contains_key("_id");
                replaced(replacement, id.as_ref(), now)
            }
            Kind::Pipeline(stages, variables) => {
                let after = reshaped(stages, variables, before, now)?;
                touched = !after.contains_key("_id");
                with_id(after, id.as_ref())
            }
            Kind::Operators(modifiers, filters) => {
                let position = filter.position(document.into(), now)?;
                let application = Application { filters, position, now, inserting: false, touched: Cell::new(false) };
                let after = application.apply(modifiers, before)?;
                touched = application.touched.get();
                after
            }
        };
        self.keep_id(&after, id.as_ref())?;
        let after = encode(&after)?;
        Ok((touched || after.as_bytes() != document.as_bytes()).then_some(after))
    }

    /// The document to insert where nothing matched `filter`. It has an `_id`
    /// first, a new ObjectId where neither filter nor update names one.
    ///
    /// # Errors
    /// Where the update cannot be applied to the filter's equalities.
    pub fn upsert(&self, filter: &Document, now: DateTime) -> Result<RawDocumentBuf> {
        let base = upsert::equalities(filter, self.is_replacement())?;
        let id = base.get("_id").cloned();
        let document = match &self.kind {
            Kind::Replacement(replacement) => replaced(replacement, id.as_ref(), now),
            Kind::Pipeline(stages, variables) => with_id(reshaped(stages, variables, base, now)?, id.as_ref()),
            Kind::Operators(modifiers, filters) => {
                let touched = Cell::new(false);
                Application { filters, position: None, now, inserting: true, touched }.apply(modifiers, base)?
            }
        };
        self.keep_id(&document, id.as_ref())?;
        encode(&id_first(document)?)
    }

    /// Refuses a change of `_id`. Operators may not even change the type of a number.
    fn keep_id(&self, document: &Document, id: Option<&Bson>) -> Result<()> {
        let Some(id) = id else { return Ok(()) };
        let exact = matches!(self.kind, Kind::Operators(..));
        match document.get("_id") {
            Some(new) if equal_values(new, id) && (!exact || is_same(new, id)?) => Ok(()),
            _ => {
                Err(QueryError::invalid(66, "the (immutable) field '_id' was found to have been altered").about("_id"))
            }
        }
    }
}

/// A document as it is stored by an insert: `_id` first (a new ObjectId where
/// there is none), empty timestamps at the top replaced by `now`.
///
/// # Errors
/// Where it is nested too deeply, too large, or has an `_id` that cannot be one.
pub fn prepare(document: &Document, now: DateTime) -> Result<RawDocumentBuf> {
    encode(&id_first(replaced(document, None, now))?)
}

/// Runs the stages of a pipeline update.
fn reshaped(stages: &[Reshape], variables: &Variables, mut document: Document, now: DateTime) -> Result<Document> {
    for stage in stages {
        document = stage.apply(document, variables, now)?;
    }
    Ok(document)
}

/// The replacement, with the `_id` there was; empty timestamps at the top become now.
fn replaced(replacement: &Document, id: Option<&Bson>, now: DateTime) -> Document {
    let mut document = Document::new();
    if let Some(id) = id {
        document.insert("_id", replacement.get("_id").unwrap_or(id).clone());
    }
    for (name, value) in replacement {
        let value = match value {
            Bson::Timestamp(bson::Timestamp { time: 0, increment: 0 }) if name != "_id" => timestamp(now),
            value => value.clone(),
        };
        document.insert(name.clone(), value);
    }
    document
}

/// The moment as a timestamp.
fn timestamp(now: DateTime) -> Bson {
    let time = u32::try_from(now.timestamp_millis() / 1000).unwrap_or(0);
    Bson::Timestamp(bson::Timestamp { time, increment: 1 })
}

/// Puts back an `_id` that a pipeline dropped.
fn with_id(document: Document, id: Option<&Bson>) -> Document {
    match id {
        Some(id) if !document.contains_key("_id") => {
            let mut whole = Document::new();
            whole.insert("_id", id.clone());
            whole.extend(document);
            whole
        }
        _ => document,
    }
}

/// Whether two values are the same to the byte.
fn is_same(a: &Bson, b: &Bson) -> Result<bool> {
    let bytes =
        |value: &Bson| RawDocumentBuf::try_from(&bson::doc! {"": value.clone()}).map(RawDocumentBuf::into_bytes);
    Ok(a == b || bytes(a)? == bytes(b)?)
}

/// Refuses names with `$` within an `_id`, but for those of a reference.
fn check_id(id: &Bson) -> Result<()> {
    let mut left = vec![id];
    while let Some(value) = left.pop() {
        match value {
            Bson::Document(inner) => {
                let is_reference = inner.keys().next().is_some_and(|name| name == "$ref");
                let known = |name: &str| is_reference && super::filter::is_reference_key(name);
                if let Some(name) = inner.keys().find(|name| name.starts_with('$') && !known(name)) {
                    let message = format!("the '_id' may not contain fields that start with '$', like {name}");
                    return Err(QueryError::invalid(52, message).about(name));
                }
                left.extend(inner.values());
            }
            Bson::Array(items) => left.extend(items),
            _ => {}
        }
    }
    Ok(())
}

/// The document with its `_id` first; makes one where there is none.
fn id_first(mut document: Document) -> Result<Document> {
    let id = match document.remove("_id") {
        Some(Bson::Array(_) | Bson::RegularExpression(_) | Bson::Undefined) => {
            return Err(QueryError::invalid(53, "the '_id' value cannot be of type array, regex or undefined"));
        }
        Some(id) => {
            check_id(&id)?;
            id
        }
        None => Bson::ObjectId(crate::query::object_id::new()),
    };
    let mut ordered = Document::new();
    ordered.insert("_id", id);
    ordered.extend(document);
    Ok(ordered)
}

/// The bytes of a document that may be stored.
fn encode(document: &Document) -> Result<RawDocumentBuf> {
    if depth(document) > MAX_DEPTH {
        return Err(QueryError::invalid(15, "a document may not be nested deeper than 200 levels"));
    }
    let raw = RawDocumentBuf::try_from(document)?;
    if raw.as_bytes().len() > MAX_SIZE {
        return Err(QueryError::invalid(10_334, "a document may not be larger than 16 MiB"));
    }
    Ok(raw)
}

/// How deep a document is nested; stops counting past the limit.
fn depth(document: &Document) -> usize {
    fn of(value: &Bson, level: usize) -> usize {
        if level > MAX_DEPTH {
            return level;
        }
        match value {
            Bson::Document(inner) => inner.values().map(|value| of(value, level + 1)).max().unwrap_or(level + 1),
            Bson::Array(items) => items.iter().map(|value| of(value, level + 1)).max().unwrap_or(level + 1),
            _ => level,
        }
    }
    document.values().map(|value| of(value, 1)).max().unwrap_or(1)
}
