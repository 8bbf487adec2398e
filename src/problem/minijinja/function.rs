//! The functions and filters that templates have.

use std::sync::Arc;

use bson::{Bson, doc};
use minijinja::value::{Kwargs, Rest, Value, ValueKind};
use minijinja::{Environment, Error, ErrorKind, State};

use super::call::Call;
use super::casing;
use super::compare;
use super::context::{Context, Tally, invalid};
use super::documents::{Documents, Selection};
use super::join::join;
use super::method;
use super::plan::ROWS;
use super::rows::Rows;
use super::signature;
use super::value::{Other, from_bson};
use crate::problem::answer::{Answer, Question};
use crate::store::Find;

fn query(context: &Arc<Context>, mut call: Call) -> Result<Value, Error> {
    let namespace = call.namespace(context)?;
    let find = call.find(context)?;
    call.end()?;
    let tally = context.note(call.site, &namespace, &find.filter);
    Ok(Value::from_object(Documents::new(context, namespace, Selection::Find(Box::new(find)), tally)))
}

fn aggregate(context: &Arc<Context>, mut call: Call) -> Result<Value, Error> {
    let namespace = call.namespace(context)?;
    let pipeline =
        call.next("pipeline")?.ok_or_else(|| Error::new(ErrorKind::MissingArgument, "expected a pipeline"))?;
    let pipeline = context.pipeline(&pipeline)?;
    call.end()?;
    let tally = context.note(call.site, &namespace, &doc! { "pipeline": pipeline.clone() });
    Ok(Value::from_object(Documents::new(context, namespace, Selection::Pipeline(pipeline), tally)))
}

fn find_one(context: &Arc<Context>, mut call: Call) -> Result<Value, Error> {
    let namespace = call.namespace(context)?;
    let find = Find { limit: 1, ..call.find(context)? };
    call.end()?;
    let documents = Documents::new(context, namespace, Selection::Find(Box::new(find)), Tally::default());
    Ok(documents.first()?.unwrap_or_else(|| Value::from(())))
}

fn count(context: &Arc<Context>, mut call: Call) -> Result<Value, Error> {
    let namespace = call.namespace(context)?;
    let filter = call.next("filter")?;
    let filter = context.document(filter.as_ref(), "filter")?;
    call.end()?;
    match context.ask(Question::Count(namespace.as_ref().clone(), filter))? {
        Answer::Count(count) => Ok(Value::from(count)),
        _ => Err(invalid("the memory gave no count")),
    }
}

fn distinct(context: &Arc<Context>, mut call: Call) -> Result<Value, Error> {
    let namespace = call.namespace(context)?;
    let field = call.next("field")?.ok_or_else(|| Error::new(ErrorKind::MissingArgument, "expected a field"))?;
    let field = field.as_str().ok_or_else(|| invalid("a field must be text like \"position.x\""))?.to_owned();
    let filter = call.next("filter")?;
    let filter = context.document(filter.as_ref(), "filter")?;
    call.end()?;
    let tally = context.note(call.site, &namespace, &doc! { "distinct": &field, "query": filter.clone() });
    match context.ask(Question::Distinct(namespace.as_ref().clone(), field, filter))? {
        Answer::Values(values) => {
            tally.reach(values.len() as u64);
            Ok(values.iter().map(|value| from_bson(value, &context.looked)).collect())
        }
        _ => Err(invalid("the memory gave no values")),
    }
}

/// A number from a number, from text that is one, or from a date (its milliseconds); rounded to `digits` decimals.
fn number(context: &Context, value: &Value, digits: Option<u32>) -> Result<Value, Error> {
    let parsed = match value.downcast_object_ref::<Other>() {
        Some(Other(Bson::DateTime(date))) => Value::from(date.timestamp_millis()),
        Some(Other(other)) => numeric(&other.to_string())?,
        None if value.kind() == ValueKind::Bool => Value::from(i32::from(value.is_true())),
        None if value.is_number() => value.clone(),
        None => numeric(context.plain(value.as_str().unwrap_or_default()).trim())?,
    };
    let Some(digits) = digits else { return Ok(parsed) };
    let scale = 10_f64.powi(digits.min(15) as i32);
    Ok(Value::from((f64::try_from(parsed)? * scale).round() / scale))
}

fn numeric(text: &str) -> Result<Value, Error> {
    if let Ok(number) = text.parse::<i64>() {
        return Ok(Value::from(number));
    }
    let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
    number.map(Value::from).ok_or_else(|| invalid(format!("`{}` is not a number", text.escape_debug())))
}

/// Gives an environment what templates can call.
pub(super) fn register(environment: &mut Environment<'_>, context: &Arc<Context>, parameters: Vec<(String, Value)>) {
    type Function = fn(&Arc<Context>, Call) -> Result<Value, Error>;
    let functions: [(&'static str, Function); 5] =
        [("query", query), ("find_one", find_one), ("count", count), ("distinct", distinct), ("aggregate", aggregate)];
    for (name, function) in functions {
        let Some(signature) = signature::of(name) else { continue };
        let context = Arc::clone(context);
        environment.add_function(name, move |arguments: Rest<Value>, named: Kwargs| {
            function(&context, Call::new(signature, &context, arguments, named)?)
        });
    }
    environment.set_unknown_method_callback(|_, value, name, arguments| method::call(value, name, arguments));
    let shared = Arc::clone(context);
    environment.add_filter(super::instrument::AT, move |value: Value, site: usize| {
        shared.set_site(site);
        value
    });
    if !context.plans.is_empty() {
        let shared = Arc::clone(context);
        environment.add_function(ROWS, move |plan: usize, documents: Value| {
            let plan = shared.plans.get(plan).cloned().ok_or_else(|| invalid("there is no such loop"))?;
            Ok(Value::from_object(Rows { plan, documents }))
        });
    }
    let shared = Arc::clone(context);
    environment.add_function(super::instrument::PART, move |name: Value, is_optional: bool| {
        shared.names.choose(name, is_optional)
    });
    casing::register(environment, context);
    compare::register(environment, context);
    let shared = Arc::clone(context);
    environment.add_filter(super::instrument::BLOCK, move |value: Value, site: usize| {
        shared.set_site(site);
        casing::block(&shared, value)
    });
    let shared = Arc::clone(context);
    environment.add_filter("number", move |value: Value, digits: Option<u32>| number(&shared, &value, digits));
    let shared = Arc::clone(context);
    environment.add_filter(
        "join",
        move |state: &mut State<'_, '_>, value: &Value, between: Option<String>, named: Kwargs| {
            join(&shared, state, value, between, named)
        },
    );
    let shared = Arc::clone(context);
    environment.add_filter("name", move |value: Value| shared.name(&value));
    environment.add_function("param", move |name: String, default: Option<Value>| {
        let found = parameters.iter().find(|(known, _)| *known == name).map(|(_, value)| value.clone());
        found.or(default).ok_or_else(|| invalid(format!("the parameter `{name}` is not given; say -D {name}=…")))
    });
}
