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
mod outcome;
mod parse;
mod rename;
mod upsert;

use bson::{Bson, DateTime, Document, RawDocument, RawDocumentBuf};

use super::collation::during;
use super::compare::equal_values;
use super::decode::decode;
use super::dollar::check_id_names;
use super::error::{QueryError, Result};
use super::expression::{Scope, Variables};
use super::filter::Filter;
use super::nesting::MAX_DEPTH;
use super::reshape::Reshape;
use apply::Application;
use filters::ArrayFilters;
use modifier::{Modifier, Segment};
use outcome::{Effects, timestamp};

/// The largest document, in bytes.
const MAX_SIZE: usize = 16 * 1024 * 1024;

/// A compiled update.
#[derive(Debug)]
pub struct Update {
    form: Form,
}

/// The three forms of an update.
#[derive(Debug)]
enum Form {
    Replacement(Document),
    Operators(Vec<Modifier>, ArrayFilters),
    Pipeline(Vec<Reshape>, Variables),
}

impl Update {
    /// Reads operators, or a replacement document, which is one without operators.
    ///
    /// # Errors
    /// If MongoDB refuses it.
    pub fn parse(update: &Document, array_filters: &[Document]) -> Result<Self> {
        if update.keys().next().is_some_and(|name| name.starts_with('$')) {
            let filters = ArrayFilters::parse(array_filters)?;
            let modifiers = parse::modifiers(update, &filters)?;
            return Ok(Self { form: Form::Operators(modifiers, filters) });
        }
        if !array_filters.is_empty() {
            return Err(QueryError::failed_to_parse("arrayFilters need update operators"));
        }
        if let Some(name) = update.keys().find(|name| name.starts_with('$') && !super::dollar::is_reference_key(name)) {
            return Err(QueryError::invalid(52, format!("the field {name} in a replacement may not start with '$'"))
                .about(name));
        }
        Ok(Self { form: Form::Replacement(update.clone()) })
    }

    /// Reads an update in pipeline form.
    ///
    /// # Errors
    /// If MongoDB refuses it, or a stage cannot be in an update.
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
        Ok(Self { form: Form::Pipeline(stages, variables) })
    }

    /// Returns whether it is a replacement document, which MongoDB refuses for many documents.
    #[must_use]
    pub fn is_replacement(&self) -> bool {
        matches!(self.form, Form::Replacement(_))
    }

    /// Returns whether it looks at the place by which a document matched its filter.
    #[must_use]
    pub fn is_positional(&self) -> bool {
        let Form::Operators(modifiers, _) = &self.form else { return false };
        modifiers.iter().any(|modifier| modifier.path.contains(&Segment::Matched))
    }

    /// Returns the changed document, or nothing where it counts as unmodified. `filter`
    /// is the one the document matched, for the positional `$`. As in MongoDB, a
    /// replacement without `_id`, a `$push` and a sum that is NaN count as modifications even
    /// where the bytes are the same.
    ///
    /// # Errors
    /// If the update cannot be applied to this document.
    pub fn apply(&self, document: &RawDocument, filter: &Filter, now: DateTime) -> Result<Option<RawDocumentBuf>> {
        let before = decode(document)?;
        let id = before.get("_id").cloned();
        let touched;
        let after = match &self.form {
            Form::Replacement(replacement) => {
                // One that leaves `_id` to the document counts as a change, as in MongoDB. So does a pipeline.
                touched = !replacement.contains_key("_id");
                replaced(replacement, id.as_ref(), now)
            }
            Form::Pipeline(stages, variables) => {
                let after = reshaped(stages, variables, document, now)?;
                touched = !after.contains_key("_id");
                with_id(after, id.as_ref())
            }
            Form::Operators(modifiers, filters) => {
                let position = if self.is_positional() { filter.position(document.into(), now)? } else { None };
                let application = Application { filters, position, inserting: false, effects: Effects::new(now) };
                let after = application.apply(modifiers, before)?;
                touched = application.effects.touched.get();
                after
            }
        };
        self.keep_id(&after, id.as_ref())?;
        let after = encode(&after)?;
        Ok((touched || after.as_bytes() != document.as_bytes()).then_some(after))
    }

    /// Returns the document to insert where nothing matched `filter`. It has an `_id`
    /// first, a new ObjectId where neither filter nor update names one.
    ///
    /// # Errors
    /// If the update cannot be applied to the filter's equalities.
    pub fn upsert(&self, filter: &Document, now: DateTime) -> Result<RawDocumentBuf> {
        let base = upsert::equalities(filter, self.is_replacement())?;
        let id = base.get("_id").cloned();
        let document = match &self.form {
            Form::Replacement(replacement) => replaced(replacement, id.as_ref(), now),
            Form::Pipeline(stages, variables) => {
                let base = RawDocumentBuf::try_from(&base)?;
                with_id(reshaped(stages, variables, &base, now)?, id.as_ref())
            }
            Form::Operators(modifiers, filters) => {
                let effects = Effects::new(now);
                Application { filters, position: None, inserting: true, effects }.apply(modifiers, base)?
            }
        };
        self.keep_id(&document, id.as_ref())?;
        encode(&id_first(document)?)
    }

    /// Refuses a change of `_id`. Operators may not even change the type of a number.
    fn keep_id(&self, document: &Document, id: Option<&Bson>) -> Result<()> {
        let Some(id) = id else { return Ok(()) };
        let exact = matches!(self.form, Form::Operators(..));
        match document.get("_id") {
            Some(new) if during(None, || equal_values(new, id)) && (!exact || is_same(new, id)?) => Ok(()),
            _ => {
                Err(QueryError::invalid(66, "the (immutable) field '_id' was found to have been altered").about("_id"))
            }
        }
    }
}

/// Returns a document as it is stored by an insert: `_id` first (a new ObjectId where
/// there is none), empty timestamps at the top replaced by `now`.
///
/// # Errors
/// If it is nested too deeply, too large, or has an `_id` that cannot be one.
pub fn prepare(document: &Document, now: DateTime) -> Result<RawDocumentBuf> {
    encode(&id_first(replaced(document, None, now))?)
}

/// Runs the stages of a pipeline update.
fn reshaped(stages: &[Reshape], variables: &Variables, document: &RawDocument, now: DateTime) -> Result<Document> {
    let mut reshaped = document.to_owned();
    for stage in stages {
        reshaped = stage.apply(&reshaped, variables, now)?;
    }
    decode(&reshaped)
}

/// Returns the replacement, with the `_id` there was; empty timestamps at the top become now.
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

/// Returns whether two values are the same to the byte.
fn is_same(a: &Bson, b: &Bson) -> Result<bool> {
    let bytes =
        |value: &Bson| RawDocumentBuf::try_from(&bson::doc! {"": value.clone()}).map(RawDocumentBuf::into_bytes);
    Ok(a == b || bytes(a)? == bytes(b)?)
}

/// Returns the document with its `_id` first; makes one where there is none.
fn id_first(mut document: Document) -> Result<Document> {
    let id = match document.remove("_id") {
        Some(Bson::Array(_) | Bson::RegularExpression(_) | Bson::Undefined) => {
            return Err(QueryError::invalid(53, "the '_id' value cannot be of type array, regex or undefined"));
        }
        Some(id) => {
            check_id_names(&id)?;
            id
        }
        None => Bson::ObjectId(crate::query::object_id::new()),
    };
    let mut ordered = Document::new();
    ordered.insert("_id", id);
    ordered.extend(document);
    Ok(ordered)
}

/// Returns the bytes of a document that may be stored.
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
