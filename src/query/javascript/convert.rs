//! Values of BSON as values of JavaScript, and back.
//!
//! Ints and doubles are numbers, and numbers come back as doubles. All other types of BSON are objects that come back
//! as they were.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use bson::oid::ObjectId;
use bson::spec::BinarySubtype;
use bson::{Binary, Bson, DateTime, Document, Regex, Timestamp};
use rquickjs::{Array, Ctx, Error, Function, IntoJs as _, Object, Result, Value};

use crate::query::error::QueryError;
use crate::query::limit::Held;
use crate::query::nesting::MAX_DEPTH;
use crate::query::number::Number;
use crate::query::view::{Fields, View};

/// Why a call failed: in the engine, or because a value cannot be converted.
pub(super) enum Fault {
    Engine(Error),
    Value(QueryError),
}

impl From<Error> for Fault {
    fn from(error: Error) -> Self {
        Self::Engine(error)
    }
}

impl From<QueryError> for Fault {
    fn from(error: QueryError) -> Self {
        Self::Value(error)
    }
}

/// The functions of the prelude that make and take apart BSON's types.
pub(super) struct Types<'a, 'js>(pub(super) &'a Object<'js>);

impl<'js> Types<'_, 'js> {
    fn make<A: rquickjs::function::IntoArgs<'js>>(&self, name: &str, arguments: A) -> Result<Value<'js>> {
        self.0.get::<_, Function<'js>>(name)?.call(arguments)
    }
}

/// Returns a document as an object, with some of its fields or all.
pub(super) fn to_document<'js>(
    ctx: &Ctx<'js>,
    types: &Types<'_, 'js>,
    document: Fields<'_>,
    fields: Option<&[String]>,
) -> Result<Object<'js>> {
    let Some(fields) = fields else { return object(ctx, types, document, 0) };
    let object = Object::new(ctx.clone())?;
    for name in fields {
        if let Some(value) = document.get(name) {
            object.set(name.as_str(), to_value(ctx, types, value, 1)?)?;
        }
    }
    Ok(object)
}

fn object<'js>(ctx: &Ctx<'js>, types: &Types<'_, 'js>, fields: Fields<'_>, level: usize) -> Result<Object<'js>> {
    let object = Object::new(ctx.clone())?;
    for (name, value) in fields.iter() {
        object.set(name, to_value(ctx, types, value, level + 1)?)?;
    }
    Ok(object)
}

/// Returns a value of BSON as one of JavaScript.
pub(super) fn to_value<'js>(
    ctx: &Ctx<'js>,
    types: &Types<'_, 'js>,
    value: View<'_>,
    level: usize,
) -> Result<Value<'js>> {
    if level > 2 * MAX_DEPTH {
        return Err(rquickjs::Error::new_into_js_message("BSON", "a value", "it is nested too deeply"));
    }
    match value {
        View::Number(Number::Int(number)) => Ok(Value::new_int(ctx.clone(), number)),
        View::Number(Number::Double(number)) => Ok(Value::new_number(ctx.clone(), number)),
        View::Number(Number::Long(number)) => types.make("long", (number.to_string(),)),
        View::Number(Number::Decimal(number)) => types.make("decimal", (bson::Decimal128::from(number).to_string(),)),
        View::String(text) | View::Symbol(text) => text.into_js(ctx),
        View::Bool(value) => Ok(Value::new_bool(ctx.clone(), value)),
        View::Null => Ok(Value::new_null(ctx.clone())),
        View::Undefined => Ok(Value::new_undefined(ctx.clone())),
        View::Document(fields) => Ok(object(ctx, types, fields, level)?.into_value()),
        View::Array(items) => {
            let array = Array::new(ctx.clone())?;
            for (index, item) in items.iter().enumerate() {
                array.set(index, to_value(ctx, types, item, level + 1)?)?;
            }
            Ok(array.into_value())
        }
        #[expect(clippy::cast_precision_loss, reason = "JavaScript's dates are doubles")]
        View::Date(millis) => types.make("date", (millis as f64,)),
        View::ObjectId(id) => types.make("id", (id.to_hex(),)),
        View::Regex(pattern, options) => types.make("regex", (pattern, options)),
        View::Timestamp(time, increment) => types.make("timestamp", (time, increment)),
        View::Binary(subtype, bytes) => types.make("binary", (subtype, STANDARD.encode(bytes))),
        View::Code(text) | View::CodeWithScope(text, _) => types.make("code", (text,)),
        View::MinKey => types.make("min", ()),
        View::MaxKey => types.make("max", ()),
        View::DbPointer(pointer) => pointer.text().into_js(ctx),
    }
}

/// Returns a value of JavaScript as one of BSON.
pub(super) fn from_value<'js>(
    types: &Types<'_, 'js>,
    value: Value<'js>,
    level: usize,
) -> std::result::Result<Bson, Fault> {
    if level > MAX_DEPTH {
        return Err(QueryError::invalid(15, "JavaScript returned a value nested deeper than 200 levels").into());
    }
    if let Some(number) = value.as_number() {
        return Ok(Bson::Double(number));
    }
    if let Some(text) = value.as_string() {
        return Ok(Bson::String(text.to_string()?));
    }
    if let Some(value) = value.as_bool() {
        return Ok(Bson::Boolean(value));
    }
    if value.is_null() {
        return Ok(Bson::Null);
    }
    if value.is_undefined() {
        return Ok(Bson::Undefined);
    }
    match value.as_object() {
        Some(object) => from_object(types, object, level),
        None => Err(QueryError::bad_value(format!("JavaScript returned a {}", value.type_name())).into()),
    }
}

fn from_object<'js>(types: &Types<'_, 'js>, object: &Object<'js>, level: usize) -> std::result::Result<Bson, Fault> {
    let parts: Vec<String> = types.0.get::<_, Function<'_>>("parts")?.call((restored(object),))?;
    let part = |index: usize| parts.get(index).map_or("", String::as_str);
    let wrong = || QueryError::bad_value(format!("JavaScript returned an invalid value of type {}", part(0)));
    Ok(match part(0) {
        "document" => {
            let (mut document, mut held) = (Document::new(), Held::default());
            for field in object.props::<String, Value<'js>>() {
                let (name, value) = field?;
                let value = from_value(types, value, level + 1)?;
                held.add(&value)?;
                document.insert(name, value);
            }
            Bson::Document(document)
        }
        "array" => {
            let (mut items, mut held) = (Vec::new(), Held::default());
            for item in object.as_array().into_iter().flat_map(|array| array.iter::<Value<'js>>()) {
                let item = from_value(types, item?, level + 1)?;
                held.add(&item)?;
                items.push(item);
            }
            Bson::Array(items)
        }
        "plain" => {
            let plain: Value<'js> = types.0.get::<_, Function<'_>>("plain")?.call((restored(object),))?;
            from_value(types, plain, level + 1)?
        }
        #[expect(clippy::cast_possible_truncation, reason = "JavaScript's dates are far within the range")]
        "date" => Bson::DateTime(DateTime::from_millis(part(1).parse::<f64>().map_err(|_| wrong())? as i64)),
        "regex" => Bson::RegularExpression(Regex {
            pattern: part(1).try_into().map_err(|_| wrong())?,
            options: part(2).try_into().map_err(|_| wrong())?,
        }),
        "code" => Bson::JavaScriptCode(part(1).to_owned()),
        "id" => Bson::ObjectId(ObjectId::parse_str(part(1)).map_err(|_| wrong())?),
        "long" => Bson::Int64(part(1).parse().map_err(|_| wrong())?),
        "int" => Bson::Int32(part(1).parse().map_err(|_| wrong())?),
        "decimal" => Bson::Decimal128(part(1).parse().map_err(|_| wrong())?),
        "timestamp" => Bson::Timestamp(Timestamp {
            time: part(1).parse().map_err(|_| wrong())?,
            increment: part(2).parse().map_err(|_| wrong())?,
        }),
        "binary" => {
            let subtype: u8 = part(1).parse().map_err(|_| wrong())?;
            Bson::Binary(Binary::from_base64(part(2), BinarySubtype::from(subtype)).map_err(|_| wrong())?)
        }
        "min" => Bson::MinKey,
        "max" => Bson::MaxKey,
        _ => return Err(wrong().into()),
    })
}

fn restored<'js>(object: &Object<'js>) -> Value<'js> {
    object.as_value().clone()
}
