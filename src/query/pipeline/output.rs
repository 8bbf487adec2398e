//! `$out` and `$merge`: where results are written.

use std::collections::HashSet;

use bson::{Bson, Document};

use super::argument::{inner, origin};
use super::documents::Origin;
use crate::query::error::{QueryError, Result};
use crate::query::expression::{Expression, Scope};

/// Where results are written.
#[derive(Debug)]
pub enum Output {
    /// They replace a collection.
    Out(Origin),
    /// They are merged into a collection.
    Merge(Merge),
}

/// A compiled `$merge`.
#[derive(Debug)]
pub struct Merge {
    /// Where to.
    pub into: Origin,
    /// The fields that identify a document; there must be a unique index on them.
    pub on: Vec<String>,
    /// What happens where there is such a document.
    pub when_matched: WhenMatched,
    /// What happens where there is none.
    pub when_not_matched: WhenNotMatched,
    /// Constants and expressions of the result that the pipeline can use, as given.
    pub variables: Option<Document>,
}

/// What `$merge` does with a document that is there.
#[derive(Debug, Clone, PartialEq)]
pub enum WhenMatched {
    /// The new one takes its place.
    Replace,
    /// It stays.
    KeepExisting,
    /// It gets the new one's fields.
    Merge,
    /// An error.
    Fail,
    /// An update in pipeline form, with the new one as `$$new`.
    Pipeline(Vec<Document>),
}

/// What `$merge` does with a document that is not there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WhenNotMatched {
    /// It is inserted.
    Insert,
    /// It is dropped.
    Discard,
    /// An error.
    Fail,
}

impl Output {
    /// Reads a stage, where it is one of these.
    pub(super) fn parse(name: &str, argument: &Bson, scope: &Scope) -> Result<Option<Self>> {
        match name {
            "$out" => Ok(Some(Self::Out(place("$out", argument)?))),
            "$merge" => Ok(Some(Self::Merge(Merge::parse(argument, scope)?))),
            _ => Ok(None),
        }
    }

    /// The name of the stage.
    pub(super) fn stage(&self) -> &'static str {
        match self {
            Self::Out(_) => "$out",
            Self::Merge(_) => "$merge",
        }
    }
}

/// The codes of a place that is none: of its type, of its fields, and of the type of a field.
fn check_shape(stage: &str, value: &Bson) -> Result<()> {
    let is_out = stage == "$out";
    let wrong = |code| Err(QueryError::invalid(code, format!("{stage} needs the name of a collection")));
    match value {
        Bson::String(name) if name.is_empty() => wrong(73),
        Bson::String(_) => Ok(()),
        Bson::Document(fields) if is_out => match (fields.len(), fields.get("db"), fields.get("coll")) {
            (2, Some(Bson::String(_)), Some(Bson::String(_))) => Ok(()),
            (2, Some(_), Some(_)) => wrong(13_111),
            _ => wrong(16_994),
        },
        Bson::Document(_) => Ok(()),
        _ => wrong(if is_out { 16_990 } else { 51_178 }),
    }
}

fn place(stage: &str, value: &Bson) -> Result<Origin> {
    let is_out = stage == "$out";
    check_shape(stage, value)?;
    let place = origin(stage, value)?;
    let no_target = |code| Err(QueryError::invalid(code, format!("{stage} cannot write to '{}'", place.collection)));
    match place.collection.as_str() {
        name if name.starts_with('.') || name.contains('\0') => return no_target(73),
        name if name.starts_with("system.") => return no_target(if is_out { 17_385 } else { 31_319 }),
        name if name.contains('$') => return no_target(if is_out { 20 } else { 73 }),
        _ => {}
    }
    if let Some(database) = &place.database {
        if matches!(database.as_str(), "admin" | "local" | "config") {
            let code = if is_out { 31_321 } else { 31_320 };
            return Err(QueryError::invalid(code, format!("cannot {stage} to internal database: {database}")));
        }
        if database.is_empty() || database.len() > 63 || database.contains(|c| "/\\. \"$*<>:|?\0".contains(c)) {
            return Err(QueryError::invalid(73, format!("'{database}' is not a name for a database")));
        }
    }
    if place.collection.len() > 235 || place.collection.ends_with('.') || place.collection.contains("..") {
        return Err(QueryError::invalid(73, format!("'{}' is not a name for a collection", place.collection)));
    }
    Ok(place)
}

impl Merge {
    fn parse(argument: &Bson, scope: &Scope) -> Result<Self> {
        let mut merge = Self {
            into: Origin { database: None, collection: String::new() },
            on: vec!["_id".to_owned()],
            when_matched: WhenMatched::Merge,
            when_not_matched: WhenNotMatched::Insert,
            variables: None,
        };
        if !matches!(argument, Bson::Document(_) | Bson::String(_)) {
            return Err(QueryError::type_mismatch("$merge needs a string or an object"));
        }
        let Bson::Document(spec) = argument else {
            merge.into = place("$merge", argument)?;
            return Ok(merge);
        };
        for (name, value) in spec {
            match name.as_str() {
                "into" => {
                    merge.into = match value {
                        Bson::Document(fields) if fields.keys().any(|name| name != "db" && name != "coll") => {
                            return Err(QueryError::invalid(40_415, "'into' has an unknown field"));
                        }
                        Bson::Document(fields)
                            if fields.values().any(|name| !matches!(name, Bson::String(_) | Bson::Null)) =>
                        {
                            return Err(QueryError::type_mismatch("'db' and 'coll' of 'into' must be strings"));
                        }
                        Bson::Document(fields)
                            if matches!(fields.get("db"), None | Some(Bson::Null))
                                || fields.get("db").and_then(Bson::as_str) == Some("") =>
                        {
                            place("$merge", fields.get("coll").unwrap_or(&Bson::Null))?
                        }
                        value => place("$merge", value)?,
                    }
                }
                "whenNotMatched" if matches!(value, Bson::Null) => {}
                "on" => merge.on = fields(value)?,
                "whenMatched" => merge.when_matched = matched(value)?,
                "whenNotMatched" => merge.when_not_matched = not_matched(value)?,
                "let" if !matches!(value, Bson::Null) => merge.variables = variables(value, scope)?,
                "let" => {}
                _ => return Err(QueryError::invalid(40_415, format!("unknown field of $merge: {name}"))),
            }
        }
        if !spec.contains_key("into") {
            return Err(QueryError::invalid(40_414, "$merge needs 'into'"));
        }
        if merge.into.collection.is_empty() {
            return Err(QueryError::failed_to_parse("$merge needs 'into'"));
        }
        let simple = matches!(merge.when_matched, WhenMatched::KeepExisting | WhenMatched::Fail);
        if simple && !matches!(merge.when_not_matched, WhenNotMatched::Insert) {
            let message = "this combination of 'whenMatched' and 'whenNotMatched' is not supported by $merge";
            return Err(QueryError::invalid(51_181, message));
        }
        if merge.variables.is_some() && !matches!(merge.when_matched, WhenMatched::Pipeline(_)) {
            return Err(QueryError::invalid(51_199, "'let' of $merge needs a pipeline as 'whenMatched'"));
        }
        if let WhenMatched::Pipeline(stages) = &merge.when_matched {
            let mut constants = merge.variables.clone().unwrap_or_default();
            constants.entry("new").or_insert_with(|| Bson::Document(Document::new()));
            crate::query::Update::parse_pipeline_with(stages, &constants)?;
        }
        Ok(merge)
    }
}

fn fields(value: &Bson) -> Result<Vec<String>> {
    let wrong = |code| QueryError::invalid(code, "$merge 'on' must be a string or an array of different strings");
    let fields = match value {
        Bson::String(name) => vec![name.clone()],
        Bson::Array(items) => items
            .iter()
            .map(|item| item.as_str().map(str::to_owned).ok_or_else(|| wrong(51_134)))
            .collect::<Result<Vec<_>>>()?,
        _ => return Err(wrong(51_186)),
    };
    match fields.as_slice() {
        [] => Err(wrong(51_187)),
        names if names.iter().any(String::is_empty) => Err(wrong(40_352)),
        names if names.iter().any(|name| name.starts_with('$')) => Err(wrong(16_410)),
        names if names.iter().collect::<HashSet<_>>().len() < names.len() => Err(wrong(31_465)),
        _ => Ok(fields),
    }
}

fn matched(value: &Bson) -> Result<WhenMatched> {
    match value {
        Bson::Array(_) => Ok(WhenMatched::Pipeline(inner("$merge", value)?)),
        Bson::String(name) => match name.as_str() {
            "replace" => Ok(WhenMatched::Replace),
            "keepExisting" => Ok(WhenMatched::KeepExisting),
            "merge" => Ok(WhenMatched::Merge),
            "fail" => Ok(WhenMatched::Fail),
            _ => Err(QueryError::bad_value(format!("'{name}' is not a value for whenMatched"))),
        },
        _ => Err(QueryError::invalid(51_191, "whenMatched must be a string or an array")),
    }
}

fn not_matched(value: &Bson) -> Result<WhenNotMatched> {
    match value.as_str() {
        Some("insert") => Ok(WhenNotMatched::Insert),
        Some("discard") => Ok(WhenNotMatched::Discard),
        Some("fail") => Ok(WhenNotMatched::Fail),
        Some(_) => Err(QueryError::bad_value("whenNotMatched must be insert, discard or fail")),
        None => Err(QueryError::type_mismatch("whenNotMatched must be a string")),
    }
}

fn variables(value: &Bson, scope: &Scope) -> Result<Option<Document>> {
    let Bson::Document(variables) = value else {
        return Err(QueryError::type_mismatch("the 'let' of $merge must be an object"));
    };
    for (name, value) in variables {
        if name == "new" && value.as_str() != Some("$$ROOT") {
            let message = "'let' may not define a value for the reserved 'new' variable other than '$$ROOT'";
            return Err(QueryError::invalid(51_273, message));
        }
        Expression::parse_in(value, scope)?;
    }
    Ok(Some(variables.clone()))
}

impl Merge {
    /// Returns the constants that the update of [`WhenMatched::Pipeline`] sees for one result: `new`, and those of
    /// `let`.
    ///
    /// # Errors
    /// If an expression of `let` fails on the result.
    pub fn constants(&self, result: &Document, now: bson::DateTime) -> Result<Document> {
        let mut constants = Document::new();
        if let Some(variables) = &self.variables {
            let none = crate::query::expression::Variables::default();
            let environment = crate::query::expression::Environment::new(result.into(), &none, now);
            for (name, value) in variables {
                let value = Expression::parse(value)?.evaluate(&environment)?;
                constants.insert(name.clone(), value.unwrap_or(Bson::Null));
            }
        }
        if !constants.contains_key("new") {
            constants.insert("new", result.clone());
        }
        Ok(constants)
    }
}
