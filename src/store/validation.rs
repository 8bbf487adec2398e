//! Which documents a collection takes: its validator, and what is done with documents that do not pass it.

use std::cell::Cell;
use std::fmt;

use bson::{Bson, Document};

use super::index::COLLATION;
use super::namespace::Namespace;
use crate::formats::shell;
use crate::query::{Collation, QueryError};

/// The option of a collection that says which documents it takes.
pub const VALIDATOR: &str = "validator";
/// The option that says which writes are looked at.
pub const LEVEL: &str = "validationLevel";
/// The option that says what is done with a document that does not pass.
pub const ACTION: &str = "validationAction";

/// All of these options.
pub const OPTIONS: [&str; 3] = [VALIDATOR, LEVEL, ACTION];

/// How many rules a message names.
const MOST_RULES: usize = 3;

/// The options of a collection that say which documents it takes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Validation {
    /// The filter that documents have to match.
    pub validator: Option<Document>,
    /// Which writes are looked at; all where nothing is said.
    pub level: Option<ValidationLevel>,
    /// What is done with a document that does not pass; it is refused where nothing is said.
    pub action: Option<ValidationAction>,
}

/// Which writes are looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ValidationLevel {
    /// None.
    Off,
    /// All.
    Strict,
    /// All but updates of documents that did not pass before.
    Moderate,
}

/// What is done with a document that does not pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ValidationAction {
    /// It is refused.
    Error,
    /// It is stored, with a warning.
    Warn,
}

const LEVELS: [(&str, ValidationLevel); 3] =
    [("off", ValidationLevel::Off), ("strict", ValidationLevel::Strict), ("moderate", ValidationLevel::Moderate)];
const ACTIONS: [(&str, ValidationAction); 2] = [("error", ValidationAction::Error), ("warn", ValidationAction::Warn)];

impl Validation {
    /// Reads the options of a collection; others are not looked at. An empty validator is none.
    ///
    /// # Errors
    /// Where one has a wrong value.
    pub fn read(options: &Document) -> Result<Self, QueryError> {
        let validator = match options.get(VALIDATOR) {
            None | Some(Bson::Null | Bson::Undefined) => None,
            Some(Bson::Document(validator)) => Some(validator).filter(|validator| !validator.is_empty()).cloned(),
            Some(_) => return Err(QueryError::type_mismatch(format!("{VALIDATOR} has to be a document"))),
        };
        Ok(Self { validator, level: choice(options, LEVEL, &LEVELS)?, action: choice(options, ACTION, &ACTIONS)? })
    }

    /// What a collection says after these options are changed: what they leave out stays, or is what MongoDB sets then.
    ///
    /// # Errors
    /// Where one has a wrong value.
    pub fn changed(self, options: &Document) -> Result<Self, QueryError> {
        let said = Self::read(options)?;
        let is_kept = matches!(options.get(VALIDATOR), None | Some(Bson::Null | Bson::Undefined));
        Ok(Self {
            validator: if is_kept { self.validator } else { said.validator },
            level: said.level.or(self.level).or(Some(ValidationLevel::Strict)),
            action: said.action.or(self.action).or(Some(ValidationAction::Error)),
        })
    }

    /// The options, as MongoDB lists them.
    #[must_use]
    pub fn options(&self) -> Document {
        let mut options = Document::new();
        if let Some(validator) = &self.validator {
            options.insert(VALIDATOR, validator.clone());
        }
        let name_of = |level| LEVELS.iter().find(|(_, known)| *known == level).map(|(name, _)| *name);
        if let Some(name) = self.level.and_then(name_of) {
            options.insert(LEVEL, name);
        }
        let name_of = |action| ACTIONS.iter().find(|(_, known)| *known == action).map(|(name, _)| *name);
        if let Some(name) = self.action.and_then(name_of) {
            options.insert(ACTION, name);
        }
        options
    }

    /// Whether nothing is said.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// The options of a collection, as MongoDB lists them.
#[must_use]
pub fn collection_options(validation: Option<&Validation>, collation: Option<&Collation>) -> Document {
    let mut options = validation.map(Validation::options).unwrap_or_default();
    if let Some(collation) = collation {
        options.insert(COLLATION, collation.definition().clone());
    }
    options
}

fn choice<T: Copy>(options: &Document, name: &str, choices: &[(&str, T)]) -> Result<Option<T>, QueryError> {
    let said = match options.get(name) {
        None | Some(Bson::Null | Bson::Undefined) => return Ok(None),
        Some(Bson::String(said)) => said,
        Some(_) => return Err(QueryError::type_mismatch(format!("{name} has to be a text"))),
    };
    let found = choices.iter().find(|(known, _)| known == said);
    let names = || choices.iter().map(|(known, _)| *known).collect::<Vec<_>>().join(", ");
    found.map(|(_, value)| Some(*value)).ok_or_else(|| {
        QueryError::bad_value(format!("{name} is one of {}, not {}", names(), shell::relaxed_value(&said.into())))
    })
}

/// While this lives, something is the case; then it is as before, also where what is done meanwhile panics.
pub(super) struct During<'a> {
    is_case: &'a Cell<bool>,
    before: bool,
}

impl<'a> During<'a> {
    pub(super) fn begin(is_case: &'a Cell<bool>) -> Self {
        Self { is_case, before: is_case.replace(true) }
    }
}

impl Drop for During<'_> {
    fn drop(&mut self) {
        self.is_case.set(self.before);
    }
}

/// A document that does not pass the validator of its collection.
#[derive(Debug, Clone, PartialEq)]
pub struct InvalidDocument {
    /// The collection.
    pub namespace: Namespace,
    /// The `_id` of the document; none where a server does not say it.
    pub id: Option<Bson>,
    /// Why it does not pass, as MongoDB has it in `errInfo.details`; empty where that is too large, or not known.
    pub details: Document,
    /// Whether values are left out there.
    pub is_truncated: bool,
}

impl InvalidDocument {
    /// What MongoDB has in `errInfo`.
    #[must_use]
    pub fn info(&self) -> Document {
        let mut info = Document::new();
        if let Some(id) = &self.id {
            info.insert("failingDocumentId", id.clone());
        }
        match (self.details.is_empty(), self.is_truncated) {
            (true, true) => drop(info.insert("note", "detailed error was too large")),
            // A server did not say it.
            (true, false) => {}
            (false, is_truncated) => {
                if is_truncated {
                    info.insert("truncated", true);
                }
                info.insert("details", self.details.clone());
            }
        }
        info
    }
}

impl fmt::Display for InvalidDocument {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", self.namespace)?;
        match &self.id {
            Some(id) => write!(f, "the document with _id {}", shell::relaxed_value(id))?,
            None => f.write_str("a document")?,
        }
        f.write_str(" does not pass the validator of its collection")?;
        let mut rules = Vec::new();
        collect(&self.details, "", &mut rules);
        for (nth, rule) in rules.iter().take(MOST_RULES).enumerate() {
            write!(f, "{}{rule}", if nth == 0 { ": " } else { "; " })?;
        }
        match rules.len().saturating_sub(MOST_RULES) {
            0 => Ok(()),
            more => write!(f, "; and {more} more"),
        }
    }
}

/// Collects the rules that details name, each behind the path of what it is about.
fn collect(details: &Document, path: &str, rules: &mut Vec<String>) {
    let named = |name: &str| if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") };
    let property = ["propertyName", "failingProperty", "conditionalProperty"];
    let path = match property.iter().find_map(|key| details.get_str(key).ok()) {
        Some(name) => named(name),
        None => match details.get("itemIndex") {
            Some(index) => named(&index.to_string()),
            None => path.to_owned(),
        },
    };
    let own = rules.len();
    for value in details.iter().filter(|(name, _)| !is_value(name)).map(|(_, value)| value) {
        match value {
            Bson::Document(inner) => collect(inner, &path, rules),
            Bson::Array(items) => {
                items.iter().filter_map(Bson::as_document).for_each(|inner| collect(inner, &path, rules))
            }
            _ => {}
        }
    }
    if rules.len() > own {
        return;
    }
    if let Some(rule) = rule(details) {
        rules.push(if path.is_empty() { rule } else { format!("{path}: {rule}") });
    }
}

/// What of details is a value, and no other details.
fn is_value(name: &str) -> bool {
    matches!(
        name,
        "specifiedAs"
            | "consideredValue"
            | "consideredValues"
            | "duplicatedValue"
            | "expressionResult"
            | "additionalItems"
    )
}

/// A rule of its own, with the reason why it is not kept.
fn rule(details: &Document) -> Option<String> {
    let reason = details.get_str("reason").ok();
    let Ok(specified) = details.get_document("specifiedAs") else {
        let missing =
            details.get("missingProperties").map(|names| format!("{} is missing", shell::relaxed_value(names)));
        let operator = details.get_str("operatorName").ok();
        return missing.or_else(|| Some(format!("{}: {}", operator?, reason?)));
    };
    let mut text = shell::relaxed(specified);
    let labels = [
        ("missingProperties", "missing"),
        ("additionalProperties", "not allowed"),
        ("additionalItems", "not allowed"),
        ("consideredValue", ""),
        ("consideredValues", ""),
        ("numberOfProperties", ""),
    ];
    let shown = labels.iter().find_map(|(key, label)| Some((*label, shell::relaxed_value(details.get(key)?))));
    let (label, shown) = shown.unwrap_or_default();
    let parts: Vec<&str> = [reason.unwrap_or(label), &shown].into_iter().filter(|part| !part.is_empty()).collect();
    if !parts.is_empty() {
        text = format!("{text} ({})", parts.join(": "));
    }
    Some(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::query::Validator;
    use bson::doc;

    #[test]
    fn options_are_read_as_they_are_written() {
        let options = doc! { VALIDATOR: { "a": 1 }, LEVEL: "moderate", ACTION: "warn" };
        assert_eq!(Validation::read(&options).unwrap().options(), options);
        let nothing = Validation::read(&doc! { VALIDATOR: {}, LEVEL: Bson::Null, "capped": true }).unwrap();
        assert!(nothing.is_empty() && nothing.options().is_empty());
        for wrong in [doc! { VALIDATOR: 3 }, doc! { LEVEL: "loose" }, doc! { ACTION: 1 }] {
            assert!(Validation::read(&wrong).is_err(), "{wrong}");
        }
    }

    fn told(validator: Document, document: Document) -> String {
        let (details, is_truncated) = Validator::parse(&validator).unwrap().details(&document);
        let namespace = Namespace::parse("a.b").unwrap();
        InvalidDocument { namespace, id: document.get("_id").cloned(), details, is_truncated }.to_string()
    }

    #[test]
    fn a_message_names_the_document_and_the_rules_that_are_not_kept() {
        let behind = "a.b: the document with _id 7 does not pass the validator of its collection: ";
        assert_eq!(
            told(doc! { "n": { "$gt": 0 } }, doc! { "_id": 7, "n": 0 }),
            format!("{behind}{{\"n\":{{\"$gt\":0}}}} (comparison failed: 0)")
        );
        let schema = doc! {
            "required": ["name"],
            "properties": { "at": { "properties": { "x": { "bsonType": "double" } } } },
        };
        assert_eq!(
            told(doc! { "$jsonSchema": schema }, doc! { "_id": 7, "at": { "x": "far" } }),
            format!(
                "{behind}at.x: {{\"bsonType\":\"double\"}} (type did not match: \"far\"); {{\"required\":[\"name\"]}} (missing: [\"name\"])"
            )
        );
    }
}
