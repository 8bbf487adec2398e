//! Why a query matches what it matches: its conditions alone and together, and what is odd about them.
//!
//! A misspelt key, or "1" for 1, is no error in MongoDB's language: it matches nothing. The message about a
//! condition comes from counts of the store; keys and texts that are like those of the query come from the
//! first documents of the collection.

mod condition;
mod remark;
mod sample;

use bson::oid::ObjectId;
use bson::{Bson, DateTime, Document, doc};

use super::computables::{Answering, View};
use super::operations::Memory;
use crate::formats::shell;
use crate::query::is_condition;
use crate::saturate::to_i64;
use crate::store::{Find, Namespace, Store, StoreError};
use condition::{Test, conditions, tests};
pub use remark::Remark;
use remark::{TYPES, count, type_of};
use sample::Sample;

/// At most so many values of one condition are looked into.
const MOST_VALUES: usize = 8;

/// Why a query matches what it matches.
#[derive(Debug, Clone, PartialEq)]
pub struct Diagnosis {
    /// The collection.
    pub namespace: Namespace,
    /// How many documents it has.
    pub documents: u64,
    /// How many match.
    pub matching: u64,
    /// The conditions that have to hold together, in the order of the query.
    pub conditions: Vec<Condition>,
}

/// A condition of a query.
#[derive(Debug, Clone, PartialEq)]
pub struct Condition {
    /// As a query of its own.
    pub query: Document,
    /// How many documents meet it.
    pub alone: u64,
    /// How many meet it and all before it.
    pub together: u64,
    /// What keeps documents from meeting it.
    pub remarks: Vec<Remark>,
}

impl Memory {
    /// Says how many documents meet each condition of a query, alone and together, and why none meets one: a key that
    /// no document has, a value of another type or spelling.
    ///
    /// # Errors
    /// Where the store fails, or the query is wrong.
    pub fn diagnose(&self, ns: &Namespace, filter: &Document) -> Result<Diagnosis, StoreError> {
        self.answer(&[(ns, filter)], Answering::Asking, |view| {
            let extended = self.extended_whole(ns, filter, view)?;
            let store: &dyn Store = match &extended {
                Some(extended) => extended.store()?,
                None => self.routes.reading(ns)?,
            };
            let examiner = Examiner { store, ns, view };
            examiner.diagnose(filter)
        })
    }
}

/// Examines the documents that a query sees.
struct Examiner<'a> {
    store: &'a dyn Store,
    ns: &'a Namespace,
    view: &'a View,
}

impl Examiner<'_> {
    fn diagnose(&self, filter: &Document) -> Result<Diagnosis, StoreError> {
        let documents = self.count(&Document::new())?;
        let matching = self.count(filter)?;
        let mut sample = None;
        let (mut found, mut all): (Vec<Condition>, Vec<Document>) = (Vec::new(), Vec::new());
        for query in conditions(filter) {
            all.push(query.clone());
            let alone = self.count(&query)?;
            let together = if all.len() == 1 { alone } else { self.count(&doc! { "$and": all.clone() })? };
            let remarks = match alone == 0 && documents > 0 {
                true => self.remarks(&query, &mut sample)?,
                false => Vec::new(),
            };
            found.push(Condition { query, alone, together, remarks });
        }
        Ok(Diagnosis { namespace: self.ns.clone(), documents, matching, conditions: found })
    }

    fn count(&self, filter: &Document) -> Result<u64, StoreError> {
        let filter = self.view.filter(filter);
        // MongoDB counts with a pipeline, in which these cannot stand.
        let text = shell::relaxed(&filter);
        if ["$near", "$where"].iter().any(|operator| text.contains(operator)) {
            let find = Find { filter, projection: doc! { "_id": 1 }, ..Find::default() };
            let found: Vec<_> = self.store.find(self.ns, &find)?.collect::<Result<_, _>>()?;
            return Ok(found.len() as u64);
        }
        self.store.count(self.ns, (&filter).into())
    }

    fn sample(&self) -> Result<Sample, StoreError> {
        let find = Find { filter: self.view.visible(), limit: sample::SIZE, ..Find::default() };
        let raw = self.store.find(self.ns, &find)?;
        let documents = raw.map(|raw| Ok(Document::try_from(&*raw?).map_err(crate::query::QueryError::from)?));
        Ok(Sample::new(documents.collect::<Result<_, StoreError>>()?))
    }

    /// Why no document meets a condition.
    fn remarks(&self, condition: &Document, sample: &mut Option<Sample>) -> Result<Vec<Remark>, StoreError> {
        let mut remarks = Vec::new();
        for test in tests(condition) {
            let known = match sample.take() {
                Some(sample) => sample,
                None => self.sample()?,
            };
            remarks.extend(self.examine(&test, &known)?);
            *sample = Some(known);
        }
        Ok(remarks)
    }

    fn examine(&self, test: &Test, sample: &Sample) -> Result<Vec<Remark>, StoreError> {
        let path = test.path.as_str();
        let documents = self.count(&doc! { path: { "$exists": true } })?;
        if documents == 0 {
            let nearest = sample.nearest_path(path);
            let of = |nearest: &str| self.count(&doc! { nearest: { "$exists": true } });
            let nearest = nearest.map(|nearest| Ok::<_, StoreError>((nearest.to_owned(), of(nearest)?))).transpose()?;
            if let (None, Some(inner)) = (&nearest, self.inner(path, sample)?) {
                return Ok(vec![inner]);
            }
            let known = if nearest.is_none() { sample.keys() } else { Vec::new() };
            return Ok(vec![Remark::NoKey { path: path.to_owned(), nearest, known }]);
        }
        if let Some(remark) = test.values.iter().find_map(|value| self.operators(path, value)) {
            return Ok(vec![remark]);
        }
        let mut remarks = Vec::new();
        let wanted = test.values.iter().find_map(type_of);
        let types = self.types(path)?;
        if let Some(wanted) = wanted.filter(|wanted| types.iter().all(|(name, _)| name != wanted)) {
            remarks.push(Remark::OtherType { path: path.to_owned(), documents, types, wanted });
        }
        for value in test.values.iter().filter(|_| test.is_equality).take(MOST_VALUES) {
            match value {
                Bson::Document(parts) if !parts.is_empty() => remarks.extend(self.parts(path, parts, sample)?),
                value => remarks.extend(self.other(path, value, sample)?),
            }
        }
        Ok(remarks)
    }

    /// The condition that a document of names like `gt` was probably meant as.
    fn operators(&self, path: &str, value: &Bson) -> Option<Remark> {
        let names = value.as_document().filter(|names| !names.is_empty())?;
        let operators: Document = names.iter().map(|(name, value)| (format!("${name}"), value.clone())).collect();
        if !operators.keys().all(|operator| is_condition(operator)) {
            return None;
        }
        let query = doc! { path: operators };
        // As a query, it may be wrong.
        let documents = self.count(&query).ok()?;
        // Names of operators are names of keys as well.
        (documents > 0).then_some(Remark::NoDollar { query, documents })
    }

    /// What there is instead of a key in a document inside.
    fn inner(&self, path: &str, sample: &Sample) -> Result<Option<Remark>, StoreError> {
        let Some((parent, _)) = path.rsplit_once('.') else { return Ok(None) };
        let mut types = self.types(parent)?;
        // The elements of an array count as values, too.
        if types.iter().any(|(name, _)| *name == "an array") {
            types.retain(|(name, _)| ["a document", "an array"].contains(name));
        }
        if types.is_empty() {
            return Ok(None);
        }
        let (path, parent) = (path.to_owned(), parent.to_owned());
        Ok(Some(Remark::NoInner { keys: sample.keys_in(&parent), path, parent, types }))
    }

    /// What keeps a document inside from being equal: its parts may match, or one of them keeps it from that.
    fn parts(&self, path: &str, parts: &Document, sample: &Sample) -> Result<Vec<Remark>, StoreError> {
        let dotted: Document = parts.iter().map(|(key, value)| (format!("{path}.{key}"), value.clone())).collect();
        let documents = self.count(&dotted)?;
        if documents > 0 {
            return Ok(vec![Remark::Whole { path: path.to_owned(), parts: dotted, documents }]);
        }
        let mut remarks = Vec::new();
        for (path, value) in dotted {
            if self.count(&doc! { &path: value.clone() })? == 0 {
                remarks.extend(self.examine(&Test { path, values: vec![value], is_equality: true }, sample)?);
            }
        }
        Ok(remarks)
    }

    /// The types of the values under a key.
    fn types(&self, path: &str) -> Result<Vec<(&'static str, u64)>, StoreError> {
        let mut types = Vec::new();
        for (name, alias) in TYPES {
            let number = self.count(&doc! { path: { "$type": alias } })?;
            types.extend((number > 0).then_some((name, number)));
        }
        types.sort_by_key(|(_, number)| std::cmp::Reverse(*number));
        Ok(types)
    }

    /// A value that was probably meant, and that documents have.
    fn other(&self, path: &str, value: &Bson, sample: &Sample) -> Result<Option<Remark>, StoreError> {
        let mut candidates = readings(value);
        if let Bson::String(text) = value {
            let plain = |text: &str| text.trim().to_lowercase();
            let filter = doc! { path: { "$regex": format!(r"^\s*{}\s*$", escaped(text.trim())), "$options": "i" } };
            let alike = self.store.distinct(self.ns, path, (&self.view.filter(&filter)).into())?;
            candidates.extend(alike.into_iter().filter(|found| found.as_str().map(plain) == Some(plain(text))));
            candidates.extend(sample.nearest_text(path, text).map(Bson::String));
        }
        for value in candidates {
            let documents = self.count(&doc! { path: value.clone() })?;
            if documents > 0 {
                return Ok(Some(Remark::OtherValue { path: path.to_owned(), value, documents }));
            }
        }
        Ok(None)
    }
}

/// The values of other types that a value may have been meant as.
fn readings(value: &Bson) -> Vec<Bson> {
    match value {
        Bson::String(text) => {
            let text = text.trim();
            let whole = || text.parse::<i64>().ok().map(Bson::Int64);
            let fraction = || text.parse::<f64>().ok().filter(|number| number.is_finite()).map(Bson::Double);
            let number = whole().or_else(fraction);
            let flag = text.to_lowercase().parse::<bool>().ok().map(Bson::Boolean);
            let id = ObjectId::parse_str(text).ok().map(Bson::ObjectId);
            let date = DateTime::parse_rfc3339_str(text).ok().map(Bson::DateTime);
            [number, flag, id, date].into_iter().flatten().collect()
        }
        Bson::Int32(_) | Bson::Int64(_) | Bson::Double(_) => {
            let flag = match shell::relaxed_value(value).as_str() {
                "0" | "0.0" => Some(false),
                "1" | "1.0" => Some(true),
                _ => None,
            };
            let text = Bson::String(shell::relaxed_value(value));
            std::iter::once(text).chain(flag.map(Bson::Boolean)).collect()
        }
        Bson::Boolean(flag) => vec![Bson::String(flag.to_string()), Bson::Int32(i32::from(*flag))],
        Bson::ObjectId(id) => vec![Bson::String(id.to_hex())],
        _ => Vec::new(),
    }
}

/// A text as a regular expression that matches it alone.
fn escaped(text: &str) -> String {
    let is_special = |c: char| c.is_ascii_punctuation();
    text.chars().flat_map(|c| is_special(c).then_some('\\').into_iter().chain([c])).collect()
}

impl Diagnosis {
    /// Whether it says more than that nothing matches: of several conditions which, or why.
    #[must_use]
    pub fn is_telling(&self) -> bool {
        self.conditions.len() > 1 || self.conditions.iter().any(|condition| !condition.remarks.is_empty())
    }

    /// The diagnosis for people.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let Self { namespace, documents, matching, conditions } = self;
        let verb = if *matching == 1 { "matches" } else { "match" };
        let mut lines = vec![format!("{namespace}: {}, {matching} {verb}", count(*documents))];
        lines.extend((!conditions.is_empty()).then(|| "  alone  together  condition".to_owned()));
        for condition in conditions {
            let Condition { query, alone, together, remarks } = condition;
            lines.push(format!("{alone:>7}  {together:>8}  {}", shell::relaxed(query)));
            lines.extend(remarks.iter().map(|remark| format!("{:19}{remark}", "")));
        }
        lines
    }

    /// The diagnosis for programs.
    #[must_use]
    pub fn to_document(&self) -> Document {
        let number = to_i64::<u64>;
        let condition = |condition: &Condition| {
            let remarks: Vec<String> = condition.remarks.iter().map(ToString::to_string).collect();
            doc! {
                "query": condition.query.clone(), "alone": number(condition.alone),
                "together": number(condition.together), "remarks": remarks,
            }
        };
        doc! {
            "namespace": self.namespace.to_string(),
            "documents": number(self.documents),
            "matching": number(self.matching),
            "conditions": self.conditions.iter().map(condition).collect::<Vec<_>>(),
        }
    }
}
