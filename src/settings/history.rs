//! `keep_history` and `history_size`: whose history is kept, for how long, and how much of it.

use std::ops::Range;
use std::time::Duration;

use toml::{Spanned, Value};

use crate::formats::quantity;
use crate::store::{HistoryRule, Namespace, Scope};

/// The most bytes of changes, where nothing else is set.
pub(super) const DEFAULT_SIZE: u64 = 64 << 20;

/// Reads the rules; an error is a mistake with its place.
pub(super) fn rules(
    ages: Option<&Spanned<Value>>,
    size: Option<&Spanned<String>>,
) -> Result<Vec<HistoryRule>, (Range<usize>, String)> {
    let size = self::size(size)?;
    let Some(ages) = ages else { return Ok(Vec::new()) };
    let wrong = |message: String| (ages.span(), message);
    match ages.get_ref() {
        Value::Table(each) => each.iter().map(|(name, value)| rule(name, value, size).map_err(wrong)).collect(),
        value => Ok(vec![HistoryRule { scope: Scope::All, age: age(value).map_err(wrong)?, size }]),
    }
}

/// Reads the most bytes of changes.
pub(super) fn size(size: Option<&Spanned<String>>) -> Result<u64, (Range<usize>, String)> {
    let read = |size: &Spanned<String>| quantity::size(size.get_ref()).map_err(|error| (size.span(), error));
    size.map_or(Ok(DEFAULT_SIZE), read)
}

fn rule(name: &str, value: &Value, size: u64) -> Result<HistoryRule, String> {
    let age = age(value).map_err(|error| format!("`{name}`: {error}"))?;
    let scope = match Namespace::parse(name) {
        Ok(ns) => Scope::Collection(ns),
        Err(_) if Namespace::parse(&format!("{name}.x")).is_ok_and(|ns| ns.database == name) => {
            Scope::Database(name.to_owned())
        }
        Err(_) => return Err(format!("`{name}` is neither a database nor a collection")),
    };
    Ok(HistoryRule { scope, age, size })
}

fn age(value: &Value) -> Result<Duration, String> {
    match value {
        Value::String(text) if text == "off" => Ok(Duration::ZERO),
        Value::String(text) => quantity::duration(text).map_err(|error| format!("{error}; or \"off\"")),
        other => Err(format!(
            "expected a duration, like \"24h\", or a table of databases and collections, found {}",
            other.type_str()
        )),
    }
}
