//! `explain`: of which command, and how much.

use std::sync::Arc;

use bson::{Bson, Document};

use super::definition::{Command, raw};
use super::explanation::{explained, of_pipeline};
use super::{aggregate, find};
use crate::serve::call::Call;
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::fields::Fields;
use crate::serve::host::Host;
use crate::serve::request::Request;
use crate::store::Find;

pub(super) const COMMANDS: &[Command] = &[Command::read("explain", explain)];

/// The commands that are explained.
const EXPLAINED: [&str; 8] =
    ["aggregate", "count", "delete", "distinct", "find", "findAndModify", "mapReduce", "update"];

fn explain(host: &mut Host<'_>, call: &Call) -> Answer {
    let fields = call.request.fields();
    fields.known(&["verbosity"])?;
    let inner = match call.request.target() {
        Some(Bson::Document(inner)) => inner,
        None | Some(Bson::Null | Bson::Undefined) => return Err(fields.missing("explain")),
        Some(other) => return Err(fields.wrong("explain", other, "object")),
    };
    let mut inner = inner.clone();
    inner.insert("$db", &call.request.database);
    let is_run = match fields.text("verbosity")?.unwrap_or("allPlansExecution") {
        "queryPlanner" => false,
        "executionStats" | "allPlansExecution" => true,
        other => {
            let message = format!(
                "verbosity string must be one of {{'queryPlanner', 'executionStats', 'allPlansExecution'}}, not '{other}'"
            );
            return Err(Failure::new(codes::BAD_VALUE, message));
        }
    };
    let name = inner.keys().next().map_or("", String::as_str);
    match super::find(name) {
        Some(_) if EXPLAINED.contains(&name) => {}
        Some(_) => return Err(Failure::new(codes::ILLEGAL, format!("Cannot explain cmd: {name}"))),
        None => {
            return Err(Failure::new(codes::NO_COMMAND, format!("Explain failed due to unknown command: {name}")));
        }
    }
    let inner = Call::new(Arc::new(Request::read(inner)?), call.metadata, &call.author);
    let ns = inner.request.readable()?;
    let fields = inner.request.fields();
    let asked = match inner.request.name.as_str() {
        "find" => find::read(fields)?,
        "count" => Find { filter: fields.document_or_empty("query")?, ..Find::default() },
        "distinct" => Find { filter: fields.document_or_empty("query")?, ..Find::default() },
        "mapReduce" => Find {
            filter: fields.document_or_empty("query")?,
            sort: fields.document_or_empty("sort")?,
            limit: fields.size("limit")?.unwrap_or(0),
            ..Find::default()
        },
        "findAndModify" => Find {
            filter: fields.document_or_empty("query")?,
            sort: fields.document_or_empty("sort")?,
            limit: 1,
            ..Find::default()
        },
        "update" => Find { filter: statement(fields, "updates")?, ..Find::default() },
        "delete" => Find { filter: statement(fields, "deletes")?, ..Find::default() },
        "aggregate" => {
            let (ns, stages) = aggregate::pipeline(&inner, fields)?;
            return of_pipeline(host, &inner, &ns, &stages);
        }
        other => return Err(Failure::new(codes::ILLEGAL, format!("Cannot explain cmd: {other}"))),
    };
    raw(&explained(host, &inner, &ns, &asked, is_run)?)
}

/// What the first statement of a write looks for.
fn statement(fields: Fields<'_>, name: &str) -> Result<Document, Failure> {
    let statements = fields.documents(name)?.unwrap_or_default();
    let first = statements.first().ok_or_else(|| fields.missing(name))?;
    Fields::new(name, first).document_or_empty("q")
}
