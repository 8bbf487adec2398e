//! The definition of a text index, and the strings of a document that it searches.

use std::collections::BTreeMap;

use bson::{Bson, Document, RawDocument, doc};

use super::language::Language;
use crate::query::error::{QueryError, Result};
use crate::query::number::Number;
use crate::query::view::{Fields, View};

/// The kind of a key whose strings are searched.
const KIND: &str = "text";
/// The key that stands for all strings of a document.
const ALL: &str = "$**";
/// The keys that stand for the searched fields in a stored definition.
const STORED: [&str; 2] = ["_fts", "_ftsx"];
/// MongoDB's code for an index that cannot be.
const CANNOT_CREATE: i32 = 67;
/// MongoDB's codes for documents whose language is not a string, or not a language.
const NO_LANGUAGE: i32 = 17_261;
const BAD_LANGUAGE: i32 = 17_262;
/// The greatest weight, exclusive.
const MAX_WEIGHT: f64 = 1_000_000_000.0;
/// The options of a text index.
pub const OPTIONS: [&str; 4] = ["weights", "default_language", "language_override", "textIndexVersion"];

/// What a text index searches.
#[derive(Debug)]
pub struct TextIndex {
    /// Keys that a search has to fix before those that are searched, and keys behind them.
    before: Vec<(String, Bson)>,
    behind: Vec<(String, Bson)>,
    /// The weights of paths.
    weights: BTreeMap<String, f64>,
    /// Whether all strings are searched.
    is_whole: bool,
    language: Language,
    /// The field that says in which language a document is.
    language_field: String,
}

/// Returns whether a key of a pattern is one of a text index.
#[must_use]
pub fn is_key(kind: &Bson) -> bool {
    kind.as_str() == Some(KIND)
}

impl TextIndex {
    /// Reads a key pattern, as it is given or as it is stored, with the options of the index.
    ///
    /// # Errors
    /// If MongoDB refuses them, or rmem does not support the language.
    pub(in crate::query) fn parse(pattern: &Document, options: &Document) -> Result<Self> {
        let cannot = |message: &str| QueryError::invalid(CANNOT_CREATE, message).about(KIND);
        let (mut before, mut behind, mut searched) = (Vec::new(), Vec::new(), Vec::new());
        for (name, kind) in pattern {
            match is_key(kind) || STORED.contains(&name.as_str()) {
                true if !behind.is_empty() => return Err(cannot("the text keys of an index must all be adjacent")),
                true if name == ALL || STORED.contains(&name.as_str()) => searched.push(name.as_str()),
                true => {
                    check_path(name)?;
                    searched.push(name.as_str());
                }
                false => {
                    check_plain(name, kind)?;
                    let keys = if searched.is_empty() { &mut before } else { &mut behind };
                    keys.push((name.clone(), kind.clone()));
                }
            }
        }
        let is_simple = |collation: &Bson| {
            collation
                .as_document()
                .is_some_and(|collation| collation.get_str("locale").is_ok_and(|locale| locale == "simple"))
        };
        if options.get("collation").is_some_and(|collation| !is_simple(collation)) {
            return Err(cannot("a text index compares words, and takes no collation but {locale: \"simple\"}"));
        }
        let mut weights = weights(options)?;
        for name in searched.into_iter().filter(|name| !STORED.contains(name)) {
            weights.entry(name.to_owned()).or_insert(1.0);
        }
        if weights.is_empty() {
            return Err(cannot("a text index needs weights"));
        }
        let is_whole = weights.remove(ALL).is_some();
        let language = match options.get("default_language") {
            None => Language::English,
            Some(Bson::String(name)) => Language::parse(name, CANNOT_CREATE)?,
            Some(_) => return Err(QueryError::type_mismatch("the default_language of an index is a string")),
        };
        let language_field = match options.get("language_override") {
            None => "language".to_owned(),
            Some(Bson::String(name)) if name.is_empty() || name.starts_with('$') => {
                return Err(cannot("the language_override of an index is the name of a field"));
            }
            Some(Bson::String(name)) => name.clone(),
            Some(_) => return Err(QueryError::type_mismatch("the language_override of an index is a string")),
        };
        check_version(options)?;
        Ok(Self { before, behind, weights, is_whole, language, language_field })
    }

    /// Returns the keys and options as MongoDB stores them, in place of those that were given.
    #[must_use]
    pub fn stored(&self, options: &Document) -> (Document, Document) {
        let mut keys: Document = self.before.iter().cloned().collect();
        keys.extend(doc! { "_fts": KIND, "_ftsx": 1 });
        keys.extend(self.behind.iter().cloned());
        let given = options.get_document("weights").ok();
        let all = self.is_whole.then_some(ALL);
        let weights = self.weights.keys().map(String::as_str).chain(all).collect::<std::collections::BTreeSet<_>>();
        let weight = |name: &str| given.and_then(|given| given.get(name)).cloned().unwrap_or(Bson::Int32(1));
        let weights: Document = weights.into_iter().map(|name| (name.to_owned(), weight(name))).collect();
        let mut other: Document = options
            .iter()
            .filter(|(name, _)| !OPTIONS.contains(&name.as_str()))
            .map(|(name, value)| (name.clone(), value.clone()))
            .collect();
        let version = options.get("textIndexVersion").cloned().unwrap_or(Bson::Int32(3));
        let language = options.get("default_language").cloned().unwrap_or_else(|| self.language.name().into());
        other.extend(doc! {
            "weights": weights, "default_language": language, "language_override": &self.language_field,
            "textIndexVersion": version,
        });
        (keys, other)
    }

    /// Returns the keys that a search has to fix.
    pub fn fixed(&self) -> impl Iterator<Item = &str> {
        self.before.iter().map(|(name, _)| name.as_str())
    }

    pub(super) fn language(&self) -> Language {
        self.language
    }

    /// Checks the languages that a document names.
    ///
    /// # Errors
    /// If one is not a language that can be searched.
    pub(in crate::query) fn check(&self, document: &RawDocument) -> Result<()> {
        self.each(document.into(), &mut |_, _, _| {})
    }

    /// Shows the strings of a document that are searched, each with its language and weight.
    ///
    /// # Errors
    /// As [`Self::check`].
    pub(super) fn each(&self, fields: Fields<'_>, show: &mut dyn FnMut(&str, Language, f64)) -> Result<()> {
        self.walk(fields, self.language, "", show)
    }

    fn walk(
        &self,
        fields: Fields<'_>,
        outer: Language,
        path: &str,
        show: &mut dyn FnMut(&str, Language, f64),
    ) -> Result<()> {
        let language = match fields.get(&self.language_field) {
            None => outer,
            Some(View::String(name)) => Language::parse(name, BAD_LANGUAGE)?,
            Some(_) => {
                let message = format!("the language of a document, in `{}`, must be a string", self.language_field);
                return Err(QueryError::invalid(NO_LANGUAGE, message).about(&self.language_field));
            }
        };
        for (name, value) in fields.iter() {
            if self.is_whole && name == self.language_field {
                continue;
            }
            let inner = if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") };
            self.value(value, language, &inner, false, show)?;
        }
        Ok(())
    }

    fn value(
        &self,
        value: View<'_>,
        language: Language,
        path: &str,
        in_array: bool,
        show: &mut dyn FnMut(&str, Language, f64),
    ) -> Result<()> {
        let weight = self.weights.get(path).copied();
        match value {
            View::String(text) if weight.is_some() || self.is_whole => show(text, language, weight.unwrap_or(1.0)),
            View::Document(fields) if self.is_whole || weight.is_none() && self.leads_to_text(path) => {
                self.walk(fields, language, path, show)?;
            }
            View::Array(items) if self.is_whole || !in_array && (weight.is_some() || self.leads_to_text(path)) => {
                items.iter().try_for_each(|item| self.value(item, language, path, true, show))?;
            }
            _ => {}
        }
        Ok(())
    }

    /// Returns whether a searched path is below this one.
    fn leads_to_text(&self, path: &str) -> bool {
        let below = format!("{path}.");
        self.weights.range(below.clone()..).next().is_some_and(|(known, _)| known.starts_with(&below))
    }
}

/// Reads the weights of fields.
fn weights(options: &Document) -> Result<BTreeMap<String, f64>> {
    let mut weights = BTreeMap::new();
    match options.get("weights") {
        None => {}
        Some(Bson::Document(given)) => {
            for (name, weight) in given {
                if name != ALL {
                    check_path(name)?;
                }
                match Number::of(weight).map(Number::to_double) {
                    Some(weight) if weight > 0.0 && weight < MAX_WEIGHT => weights.insert(name.clone(), weight),
                    _ => {
                        let message = "the weight of a field in a text index is a number from 1 to 99999";
                        return Err(QueryError::invalid(CANNOT_CREATE, message).about(name));
                    }
                };
            }
        }
        Some(_) => return Err(QueryError::type_mismatch("the weights of an index are an object")),
    }
    Ok(weights)
}

fn check_version(options: &Document) -> Result<()> {
    let bad = |code| Err(QueryError::invalid(code, "the textIndexVersion of an index is 1, 2 or 3"));
    match options.get("textIndexVersion").map(Number::of) {
        None => Ok(()),
        Some(Some(version)) if version.integral().is_some_and(|version| (1..=3).contains(&version)) => Ok(()),
        Some(Some(_)) => bad(CANNOT_CREATE),
        Some(None) => bad(super::super::error::TYPE_MISMATCH),
    }
}

/// Refuses a key beside those that are searched which is no plain one.
fn check_plain(name: &str, kind: &Bson) -> Result<()> {
    check_path(name)?;
    match Number::of(kind).map(Number::to_double) {
        Some(number) if number != 0.0 && !number.is_nan() => Ok(()),
        _ => {
            let message = format!("the key `{name}` of a text index takes 1, -1 or \"text\"");
            Err(QueryError::invalid(CANNOT_CREATE, message).about(name))
        }
    }
}

fn check_path(name: &str) -> Result<()> {
    match name.split('.').any(|part| part.is_empty() || part.starts_with('$')) {
        false => Ok(()),
        true => {
            let message = format!("`{name}` is not a path of a text index; for all strings, take \"$**\"");
            Err(QueryError::invalid(CANNOT_CREATE, message).about(name))
        }
    }
}
