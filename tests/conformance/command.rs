//! The fields of MongoDB's commands, and why there is no answer to one.

use bson::{Bson, Document};
use rmem::query::{Collation, QueryError};
use rmem::store::{Hint, Modifiers, StoreError};

/// Why there is no answer.
#[derive(Debug)]
pub(crate) enum Failure {
    /// Not supported, by name.
    Refused(String),
    /// An error.
    Failed(String),
}

impl From<QueryError> for Failure {
    fn from(error: QueryError) -> Self {
        match (error.unsupported, error.names.into_iter().next()) {
            (true, Some(operator)) => Self::Refused(operator),
            _ => Self::Failed(format!("{}: {}", error.code, error.message)),
        }
    }
}

impl From<StoreError> for Failure {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::Query(error) => error.into(),
            StoreError::Stopped { source, .. } => Self::from(*source),
            other => Self::Failed(other.to_string()),
        }
    }
}

impl From<bson::error::Error> for Failure {
    fn from(error: bson::error::Error) -> Self {
        Self::Failed(error.to_string())
    }
}

pub(crate) type Answer = Result<Document, Failure>;

/// Options of commands that rmem's stores have no word for.
const OPTIONS: [&str; 20] = [
    "allowDiskUse",
    "bypassDocumentValidation",
    "readConcern",
    "writeConcern",
    "explain",
    "max",
    "min",
    "returnKey",
    "showRecordId",
    "tailable",
    "awaitData",
    "apiVersion",
    "apiStrict",
    "viewOn",
    "timeseries",
    "capped",
    "validator",
    "clusteredIndex",
    "maxTimeMS",
    "size",
];

pub(crate) fn refuse_options(command: &Document) -> Result<(), Failure> {
    match command.keys().find(|name| OPTIONS.contains(&name.as_str())) {
        Some(name) => Err(Failure::Refused(format!("option {name}"))),
        None => Ok(()),
    }
}

/// What a command says beside its query; `names` are those that it takes.
pub(crate) fn modifiers(command: &Document, names: &[&str]) -> Result<Modifiers, Failure> {
    if let Some(name) =
        ["collation", "let", "hint"].iter().find(|name| command.contains_key(**name) && !names.contains(name))
    {
        return Err(Failure::Failed(format!("unknown field {name}")));
    }
    let collation = document(command, "collation")?.filter(|collation| !collation.is_empty());
    let hint = command.get("hint").map(Hint::parse).transpose()?;
    Ok(Modifiers {
        collation: collation.map(Collation::parse).transpose()?,
        variables: document(command, "let")?.cloned().unwrap_or_default(),
        hint: hint.flatten(),
    })
}

/// Refuses options that no command has.
pub(crate) fn known(command: &Document, names: &[&str]) -> Result<(), Failure> {
    refuse_options(command)?;
    const ALL: [&str; 6] = ["$db", "comment", "cursor", "collation", "let", "hint"];
    match command.keys().skip(1).find(|name| !names.contains(&name.as_str()) && !ALL.contains(&name.as_str())) {
        Some(name) => Err(Failure::Failed(format!("unknown field {name}"))),
        None => Ok(()),
    }
}

pub(crate) fn document<'a>(command: &'a Document, name: &str) -> Result<Option<&'a Document>, Failure> {
    match command.get(name) {
        None | Some(Bson::Null) => Ok(None),
        Some(Bson::Document(document)) => Ok(Some(document)),
        Some(_) => Err(Failure::Failed(format!("{name} must be an object"))),
    }
}

pub(crate) fn documents(command: &Document, name: &str) -> Result<Vec<Document>, Failure> {
    let wrong = || Failure::Failed(format!("{name} must be an array of objects"));
    match command.get(name) {
        None => Ok(Vec::new()),
        Some(Bson::Array(items)) => items.iter().map(|item| item.as_document().cloned().ok_or_else(wrong)).collect(),
        Some(_) => Err(wrong()),
    }
}

pub(crate) fn whole(command: &Document, name: &str) -> Result<Option<i64>, Failure> {
    match command.get(name) {
        None | Some(Bson::Null) => Ok(None),
        Some(Bson::Int32(value)) => Ok(Some((*value).into())),
        Some(Bson::Int64(value)) => Ok(Some(*value)),
        Some(Bson::Double(value)) => Ok(Some(*value as i64)),
        Some(Bson::Decimal128(value)) => match value.to_string().parse::<f64>() {
            Ok(value) => Ok(Some(value.round_ties_even() as i64)),
            _ => Err(Failure::Failed(format!("{name} must be a number"))),
        },
        Some(_) => Err(Failure::Failed(format!("{name} must be a number"))),
    }
}

pub(crate) fn unsigned(command: &Document, name: &str) -> Result<usize, Failure> {
    let value = whole(command, name)?.unwrap_or(0);
    usize::try_from(value).map_err(|_| Failure::Failed(format!("{name} must not be negative")))
}

pub(crate) fn flag(command: &Document, name: &str) -> Result<bool, Failure> {
    match command.get(name) {
        None | Some(Bson::Null) => Ok(false),
        Some(Bson::Boolean(value)) => Ok(*value),
        Some(Bson::Int32(value)) => Ok(*value != 0),
        Some(Bson::Int64(value)) => Ok(*value != 0),
        Some(Bson::Double(value)) => Ok(*value != 0.0),
        Some(Bson::Decimal128(value)) => Ok(value.to_string().parse::<f64>().is_ok_and(|value| value != 0.0)),
        Some(_) => Err(Failure::Failed(format!("{name} must be a boolean"))),
    }
}
