//! Filters for one text: they leave what macros and blocks wrote what it is, and refuse lists.

use std::borrow::Cow;
use std::sync::Arc;

use minijinja::value::{StringInput, Value, ValueKind};
use minijinja::{Environment, Error, State, filters};

use super::advice::Hint;
use super::context::{Context, invalid};
use super::limits;
use super::value::{CLOSE, OPEN};

/// Gives an environment the filters.
pub(super) fn register(environment: &mut Environment<'_>, context: &Arc<Context>) {
    type Filter = fn(StringInput<'_>) -> Value;
    let plain: [(&'static str, Filter); 4] = [
        ("upper", filters::upper),
        ("lower", filters::lower),
        ("capitalize", filters::capitalize),
        ("title", |text| text.preserve_safety(filters::title(Cow::Borrowed(text.as_str())))),
    ];
    for (name, filter) in plain {
        environment.add_filter(name, move |state: &mut State<'_, '_>, value: &Value| {
            one(name, value)?;
            StringInput::new(state, value).map(filter)
        });
    }
    environment.add_filter("trim", |state: &mut State<'_, '_>, value: &Value, chars: Option<Cow<'_, str>>| {
        one("trim", value)?;
        Ok::<_, Error>(filters::trim(StringInput::new(state, value)?, chars))
    });
    environment.add_filter("replace", |state: &mut State<'_, '_>, value: &Value, from: &Value, to: &Value| {
        [value, from, to].into_iter().try_for_each(|value| one("replace", value))?;
        let (value, from, to) =
            (StringInput::new(state, value)?, StringInput::new(state, from)?, StringInput::new(state, to)?);
        limits::replacing(value.as_str(), from.as_str(), to.as_str())?;
        if !value.is_safe() {
            return filters::replace(state, value, from, to);
        }
        // The marks of values are no text.
        let to = to.format(state)?;
        Ok(Value::from_safe_string(outside(value.as_str(), |text| text.replace(from.as_str(), &to))))
    });
    for name in ["length", "count"] {
        let shared = Arc::clone(context);
        environment.add_filter(name, move |value: &Value| match value.as_str().filter(|_| value.is_safe()) {
            // What is written has marks in it.
            Some(text) => Ok(shared.plain(text).chars().count()),
            None => filters::length(value),
        });
    }
}

/// Refuses a list or a document where one text is expected: all of it would become one name.
fn one(filter: &str, value: &Value) -> Result<(), Error> {
    let what = match value.kind() {
        ValueKind::Seq | ValueKind::Iterable => "a list",
        ValueKind::Map => "a document",
        _ => return Ok(()),
    };
    let error = invalid(format!("`{filter}` is for a text, and this is {what}"));
    Err(match filter {
        "replace" => error,
        _ => error.with_source(Hint(format!("for each of a list: {{{{ names|map('{filter}')|join(' ') }}}}"))),
    })
}

/// Changes what of a text is not a mark.
fn outside(text: &str, change: impl Fn(&str) -> String) -> String {
    let mut changed = String::with_capacity(text.len());
    let mut rest = text;
    while let Some((before, marked)) = rest.split_once(OPEN) {
        let (mark, after) = marked.split_once(CLOSE).unwrap_or((marked, ""));
        changed.push_str(&change(before));
        changed.push(OPEN);
        changed.push_str(mark);
        changed.push(CLOSE);
        rest = after;
    }
    changed + &change(rest)
}

/// What the filters of a `{% filter %}` block made, where it is text still.
pub(super) fn block(context: &Context, value: Value) -> Result<Value, Error> {
    let is_text = value.is_safe() || context.joined(&value).is_some();
    let has_values = value.as_str().is_some_and(|text| text.contains(OPEN));
    if is_text || !(has_values || matches!(value.kind(), ValueKind::Seq | ValueKind::Iterable | ValueKind::Map)) {
        return Ok(value);
    }
    let hint = "upper, lower, capitalize, title, trim, replace and indent leave text what it is; any other is for values: \
                {{ name|filter }}";
    Err(invalid("the filters of this block make one value of its text").with_source(Hint(hint.to_owned())))
}
