//! The filter `join`: names apart from each other, each spelled safely.

use minijinja::value::{Kwargs, Value, ValueKind};
use minijinja::{Error, ErrorKind, State};

use super::advice::Hint;
use super::context::{Context, invalid};

/// Joins values: by white space, they stay apart; by anything else, they become one text.
pub(super) fn join(
    context: &Context,
    state: &mut State<'_, '_>,
    value: &Value,
    between: Option<String>,
    named: Kwargs,
) -> Result<Value, Error> {
    let between = match between {
        Some(between) => between,
        None => named.get::<Option<String>>("d")?.unwrap_or_default(),
    };
    let attribute = named.get::<Option<String>>("attribute")?;
    named.assert_all_used()?;
    match value.kind() {
        ValueKind::Undefined => return Err(Error::from(ErrorKind::UndefinedError)),
        ValueKind::String => {
            let hint = Hint("`split` makes a list of a text: {{ names|split|join(' ') }}".to_owned());
            return Err(invalid("`join` is for a list, and this is a text").with_source(hint));
        }
        _ => {}
    }
    let elements = value
        .try_iter()
        .map_err(|error| invalid(format!("cannot join a value of type {}", value.kind())).with_source(error))?;
    let mut values = Vec::new();
    for element in elements.checked() {
        let element = element?;
        let value = match &attribute {
            Some(path) => path.split('.').try_fold(element, |value, key| value.get_attr(key))?,
            None => element,
        };
        if value.is_undefined() {
            let of = attribute.as_deref().map(|path| format!("`{path}` of ")).unwrap_or_default();
            let message = format!("`join`: {of}element {} of the list is undefined", values.len() + 1);
            return Err(Error::new(ErrorKind::UndefinedError, message));
        }
        values.push(value);
    }
    // No names at all are nothing, and not one name that is empty.
    let is_apart = values.is_empty() || values.len() > 1 && !between.is_empty() && between.trim().is_empty();
    if values.iter().any(Value::is_safe) && !is_apart {
        // What a macro wrote has its values in it already.
        let mut text = String::new();
        for (index, value) in values.iter().enumerate() {
            if index > 0 {
                text.push_str(&state.format(Value::from(between.as_str()))?);
            }
            text.push_str(&state.format(value.clone())?);
        }
        return Ok(Value::from_safe_string(text));
    }
    let texts: Vec<String> = values.iter().map(|value| context.plain(&value.to_string()).into_owned()).collect();
    let text = texts.join(&between);
    Ok(if is_apart { context.join(values, between, text) } else { Value::from(text) })
}
