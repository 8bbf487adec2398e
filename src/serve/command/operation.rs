//! `currentOp`, `killOp`: what is being done, and its end before it is done.

use std::fmt::{self, Write as _};

use bson::{Bson, DateTime, Document, RawDocumentBuf, doc};

use super::definition::{Command, raw};
use super::server::host_name;
use crate::query::{Filter, QueryError, type_name};
use crate::saturate::to_i64;
use crate::serve::client::Client;
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::fields::{is_generic, number, whole};
use crate::serve::request::Request;
use crate::serve::server::Server;
use crate::store::namespace::NO_COLLECTION;

pub(super) const COMMANDS: &[Command] = &[Command::here("currentOp", current), Command::here("killOp", kill)];

/// What `currentOp` takes beside conditions on what it lists.
const OPTIONS: [&str; 4] = ["currentOp", "$all", "$ownOps", "$truncateOps"];
/// A command that is longer than so many bytes is listed as the beginning of its text.
const MOST_SHOWN: usize = 1_000;
/// Commands that are listed without what they bring: it is part of a login.
const SECRET: [&str; 2] = ["saslStart", "saslContinue"];

fn current(_: &mut Client, server: &Server, request: &Request) -> Answer {
    request.check_admin()?;
    let conditions = request.body.iter().filter(|(name, _)| !is_generic(name) && !OPTIONS.contains(&name.as_str()));
    let conditions: Document = conditions.map(owned).collect();
    let filter = Filter::parse(&conditions)?;
    let lists_idle = request.fields().flag("$all")?;
    let mut found = Vec::new();
    for operation in operations(server, lists_idle) {
        if filter.matches(&RawDocumentBuf::try_from(&operation)?)? {
            found.push(operation);
        }
    }
    raw(&doc! { "inprog": found })
}

/// What connections are doing, and those that do nothing where they are to be listed.
pub(super) fn operations(server: &Server, lists_idle: bool) -> Vec<Document> {
    let (host, now) = (host_name(), DateTime::now().try_to_rfc3339_string().unwrap_or_default());
    server.connections(|connections| {
        let mut listed: Vec<(i64, Document)> = connections
            .filter_map(|(id, handle)| {
                let request = handle.activity.current();
                let mut operation = doc! {
                    "type": "op",
                    "host": &host,
                    "desc": format!("conn{id}"),
                    "connectionId": number(id),
                    "client": &handle.peer,
                    "active": request.is_some(),
                    "currentOpTime": &now,
                };
                match request {
                    Some(request) => operation.extend(described(&request)),
                    None if !lists_idle => return None,
                    None => {}
                }
                Some((id, operation))
            })
            .collect();
        listed.sort_by_key(|(id, _)| *id);
        listed.into_iter().map(|(_, operation)| operation).collect()
    })
}

/// What is said of an operation.
fn described(request: &Request) -> Document {
    let (op, of) = match request.name.as_str() {
        "find" => ("query", request.target()),
        "getMore" => ("getmore", request.body.get("collection")),
        "insert" => ("insert", request.target()),
        "update" => ("update", request.target()),
        "delete" => ("remove", request.target()),
        _ => ("command", request.target()),
    };
    let collection = match of {
        Some(Bson::String(collection)) => collection,
        _ if request.name == "aggregate" => NO_COLLECTION,
        _ => "$cmd",
    };
    let elapsed = request.since.elapsed();
    let mut described = doc! {
        "threaded": true,
        "opid": request.operation,
        "secs_running": to_i64(elapsed.as_secs()),
        "microsecs_running": to_i64(elapsed.as_micros()),
        "op": op,
        "ns": format!("{}.{collection}", request.database),
        "command": shown(request),
    };
    described.extend(request.session.as_ref().map(|session| ("lsid".to_owned(), session.to_document().into())));
    if let Some(part) = request.transaction.filter(|part| part.is_multi) {
        let parameters = doc! { "txnNumber": part.number, "autocommit": false };
        described.insert("transaction", doc! { "parameters": parameters });
    }
    described
}

/// The command, as far as it is short.
fn shown(request: &Request) -> Document {
    if SECRET.contains(&request.name.as_str()) {
        return doc! { &request.name: 1, "$db": &request.database };
    }
    let mut text = Beginning(String::new());
    match write!(text, "{}", request.body) {
        // The time of the cluster is not read.
        Ok(()) => request.body.iter().filter(|(name, _)| *name != "$clusterTime").map(owned).collect(),
        Err(fmt::Error) => doc! { "$truncated": text.0 },
    }
}

fn owned((name, value): (&String, &Bson)) -> (String, Bson) {
    (name.clone(), value.clone())
}

/// The beginning of a text; writing more than that fails.
struct Beginning(String);

impl fmt::Write for Beginning {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let left = MOST_SHOWN - self.0.len();
        if text.len() <= left {
            self.0.push_str(text);
            return Ok(());
        }
        let ends = text.char_indices().map(|(start, one)| start + one.len_utf8());
        let end = ends.take_while(|end| *end <= left).last().unwrap_or(0);
        self.0.push_str(&text[..end]);
        Err(fmt::Error)
    }
}

fn kill(_: &mut Client, server: &Server, request: &Request) -> Answer {
    request.check_admin()?;
    let meant = operation(request)?;
    server.stop_operations(QueryError::INTERRUPTED, |running| i64::from(running.operation) == meant);
    // Whether there is one, MongoDB does not say either.
    raw(&doc! { "info": "attempting to kill op" })
}

/// The number of the operation that is to end.
fn operation(request: &Request) -> Result<i64, Failure> {
    let Some(given) = request.body.get("op") else {
        return Err(Failure::new(codes::NO_SUCH_KEY, "Missing expected field \"op\""));
    };
    let Some(whole) = whole(given) else {
        let message = format!("Expected field \"op\" to have numeric type, but found {}", type_name(given));
        return Err(Failure::new(codes::TYPE_MISMATCH, message));
    };
    if !crate::query::compare_values(given, &Bson::Int64(whole)).is_eq() {
        let message = format!(
            "Expected field \"op\" to have a value exactly representable as a 64-bit integer, but found op: {given}"
        );
        return Err(Failure::new(codes::BAD_VALUE, message));
    }
    if whole < i32::MIN.into() || whole > u32::MAX.into() {
        let message = format!("invalid op : {whole}. Op ID cannot be represented with 32 bits");
        return Err(Failure::new(26_823, message));
    }
    Ok(whole)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_command_is_listed_as_the_beginning_of_its_text() {
        let listed = |body: Document| shown(&Request::read(body).unwrap());
        let short = doc! { "find": "c", "filter": { "n": 1 }, "$db": "a" };
        assert_eq!(listed(short.clone()), short);
        let long = listed(doc! { "find": "c", "filter": { "n": "\u{e9}".repeat(MOST_SHOWN) }, "$db": "a" });
        let text = long.get_str("$truncated").unwrap();
        assert!(text.starts_with("{ \"find\": \"c\"") && text.len() > MOST_SHOWN - 2 && text.len() <= MOST_SHOWN);
        let login = doc! { "saslStart": 1, "payload": "secret", "$db": "admin" };
        assert_eq!(listed(login), doc! { "saslStart": 1, "$db": "admin" });
    }

    #[test]
    fn the_number_of_an_operation_has_32_bits() {
        let code = |op: Bson| {
            let request = Request::read(doc! { "killOp": 1, "op": op, "$db": "admin" }).unwrap();
            operation(&request).map_or_else(|failure| failure.code, |_| 0)
        };
        assert_eq!((code(7.into()), code((-5).into()), code(5.0.into())), (0, 0, 0));
        assert_eq!((code("x".into()), code(5.5.into()), code((1_i64 << 40).into())), (14, 2, 26_823));
    }
}
