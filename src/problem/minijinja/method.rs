//! The methods of documents, as Python's dictionaries have them.

use minijinja::value::{Value, ValueKind, from_args};
use minijinja::{Error, ErrorKind};

/// The methods of a document, and of any other map.
pub(super) const METHODS: [&str; 4] = ["get", "keys", "values", "items"];

/// Calls a method of a map. `get` gives none, or the second argument, where the map does not have the key.
pub(super) fn call(value: &Value, name: &str, arguments: &[Value]) -> Result<Value, Error> {
    if value.kind() != ValueKind::Map || !METHODS.contains(&name) {
        return Err(Error::from(ErrorKind::UnknownMethod));
    }
    if name == "get" {
        let (key, default): (Value, Option<Value>) = from_args(arguments)?;
        let found = value.get_item(&key)?;
        return Ok(if found.is_undefined() { default.unwrap_or_else(|| Value::from(())) } else { found });
    }
    let () = from_args(arguments)?;
    let keys = value.try_iter()?.checked().collect::<Result<Vec<_>, Error>>()?;
    let value_of = |key: &Value| value.get_item(key);
    match name {
        "keys" => Ok(Value::from(keys)),
        "values" => keys.iter().map(value_of).collect::<Result<Vec<_>, _>>().map(Value::from),
        _ => {
            let pair = |key: &Value| Ok(Value::from(vec![key.clone(), value_of(key)?]));
            keys.iter().map(pair).collect::<Result<Vec<_>, Error>>().map(Value::from)
        }
    }
}
