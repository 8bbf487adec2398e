//! Aggregation pipelines, stage by stage.

use bson::{Bson, Document};

use super::arguments::{Arguments, parse};
use super::document::given;
use super::failure::Failure;
use super::function::{Function, function};
use crate::clips::engine::native::{Environment, Value};
use crate::clips::engine::state::State;
use crate::clips::engine::table::Thing;
use crate::formats::{Source, shell};
use crate::query::QueryError;

pub(super) const FUNCTIONS: &[Function] = &[
    function(&["rm-aggregate", "robmem-aggregate"], 2, 2, aggregate),
    function(&["rm-pipeline-create", "robmem-pipeline-create"], 0, 0, |state, _, _| {
        Ok(given(state, Thing::Array(Vec::new())))
    }),
    function(&["rm-pipeline-append", "robmem-pipeline-append"], 2, 2, append),
    function(&["rm-pipeline-destroy", "robmem-pipeline-destroy"], 1, 1, destroy),
];

const PIPELINE: &str = "pipeline (external address)";

/// Gives a cursor.
fn aggregate(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let ns = arguments.namespace(1)?;
    let stages = stages(state, arguments)?;
    let found = state.memory.aggregate(&ns, &stages).map_err(Failure::declined)?;
    let owned = found.map(|document| {
        let document = document.map_err(Failure::declined)?;
        Document::try_from(&*document).map_err(|error| Failure::declined(QueryError::from(error)))
    });
    Ok(given(state, Thing::Cursor(owned.collect::<Result<_, _>>()?)))
}

/// The stages of the second argument: a text, a pipeline or an array that was put together, or a multifield of stages.
fn stages(state: &State<'_>, arguments: Arguments<'_>) -> Result<Vec<Document>, Failure> {
    match arguments.get(2) {
        Some(Value::Symbol(text) | Value::Text(text)) => {
            shell::parse_pipeline(&Source::new("<pipeline>", text.as_str())).map_err(Failure::declined)
        }
        Some(Value::Many(values)) => {
            (1..).take(values.len()).map(|nth| Arguments::new(values).document(nth, state)).collect()
        }
        _ => {
            let address = arguments.address(2, "pipeline (external address) or string")?;
            let stages = state.table.borrow_mut().array(address).map_err(Failure::wrong)?.clone();
            stages.into_iter().map(stage).collect()
        }
    }
}

fn stage(value: Bson) -> Result<Document, Failure> {
    match value {
        Bson::Document(stage) => Ok(stage),
        Bson::String(text) => parse(&text),
        _ => Err(Failure::wrong("a stage of a pipeline is a document")),
    }
}

/// `(rm-pipeline-append PIPELINE STAGE)`
fn append(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let address = arguments.address(1, PIPELINE)?;
    let stage = Bson::Document(arguments.document(2, state)?);
    state.table.borrow_mut().array(address).map_err(Failure::wrong)?.push(stage);
    Ok(Value::truth(true))
}

fn destroy(state: &State<'_>, _: &Environment, arguments: Arguments<'_>) -> Result<Value, Failure> {
    let address = arguments.address(1, PIPELINE)?;
    let mut table = state.table.borrow_mut();
    table.array(address).map_err(Failure::wrong)?;
    Ok(Value::truth(table.remove(address)))
}
