//! Commands: what each is called, where it runs, and what it does.
//!
//! One file a group of commands, one line of its table a command.

mod aggregate;
mod collection;
mod cursor;
mod database;
mod definition;
mod delete;
mod explain;
mod explanation;
mod find;
mod handshake;
mod index;
mod insert;
mod login;
mod map_reduce;
mod modify;
mod server;
mod session;
mod statistics;
mod transaction;
mod update;
mod write;

use std::sync::Arc;

use bson::raw::cstr;
use bson::{Document, doc, rawdoc};

use super::access::RECORDS;
use super::attempt::attempt;
use super::call::Call;
use super::client::Client;
use super::failure::{Answer, Failure, codes};
use super::host::{self, Host};
use super::job::{Action, Job, Step};
use super::mailbox::Mailbox;
use super::request::{Confirmation, Request};
use super::server::Server;
use super::session::Once;
use super::wire::Form;
use crate::memory::Memory;
use crate::store::Namespace;
use definition::{Command, Run, raw};

/// All groups.
const GROUPS: [&[Command]; 19] = [
    COMMANDS,
    handshake::COMMANDS,
    login::COMMANDS,
    server::COMMANDS,
    session::COMMANDS,
    transaction::COMMANDS,
    insert::COMMANDS,
    update::COMMANDS,
    delete::COMMANDS,
    modify::COMMANDS,
    find::COMMANDS,
    aggregate::COMMANDS,
    map_reduce::COMMANDS,
    cursor::COMMANDS,
    explain::COMMANDS,
    collection::COMMANDS,
    database::COMMANDS,
    index::COMMANDS,
    statistics::COMMANDS,
];

/// The command about all commands.
const COMMANDS: &[Command] = &[Command::here("listCommands", list)];

/// Runs a command of a client.
pub(super) fn run(host: &mut Host<'_>, client: &mut Client, body: Document, form: Form) -> Answer {
    let request = Request::read(body)?;
    let confirmation = request.confirmation;
    let unconfirmed = match request.name.as_str() {
        "insert" | "delete" => Some(rawdoc! { "n": 0 }),
        "update" => Some(rawdoc! { "n": 0, "nModified": 0 }),
        _ => None,
    };
    let mut reply = dispatch(host, client, request, form)?;
    if let (Confirmation::None, Some(unconfirmed)) = (confirmation, unconfirmed) {
        return Ok(unconfirmed);
    }
    if confirmation == Confirmation::Others {
        let message = "Not enough data-bearing nodes: rmem is one member";
        let error = rawdoc! { "code": 100, "codeName": "UnsatisfiableWriteConcern", "errmsg": message };
        reply.append(cstr!("writeConcernError"), error);
    }
    Ok(reply)
}

fn dispatch(host: &mut Host<'_>, client: &mut Client, request: Request, form: Form) -> Answer {
    let Some(command) = find(&request.name) else { return Err(unknown(&request)) };
    if form == Form::Query && !matches!(command.name, "hello" | "isMaster") {
        let message = format!("Unsupported OP_QUERY command: {}; use OP_MSG", request.name);
        return Err(Failure::new(codes::NO_QUERY, message));
    }
    let server = Arc::clone(&host.server);
    if client.needs_login && client.user.is_none() && !command.is_open {
        let message = format!("command {} requires authentication", request.name);
        return Err(Failure::new(codes::UNAUTHORIZED, message));
    }
    if let Run::Here(run) = command.run {
        return run(client, &server, &request);
    }
    let call = Call { request, metadata: client.metadata, author: Arc::clone(&client.author) };
    if call.request.is_in_transaction() {
        return in_transaction(host, client, command, call);
    }
    match command.run {
        Run::Here(_) => host::empty(),
        Run::Read(run) => run(host, &call),
        Run::Either(writes, read, _) if !writes(&call.request) => read(host, &call),
        Run::Write(run) | Run::Either(_, _, run) => write(host, run, call),
    }
}

/// Has something written; once, where the command has a number.
fn write(host: &mut Host<'_>, run: fn(&Memory, &Call) -> Answer, call: Call) -> Answer {
    if host.server.options.read_only {
        let message = format!("{}: this memory is served read-only", call.request.name);
        return Err(Failure::new(codes::ILLEGAL, message));
    }
    let once = match (&call.request.session, call.request.transaction) {
        (Some(session), Some(part)) => Some(Once { session: session.clone(), number: part.number }),
        _ => None,
    };
    let home = home(&call.request);
    let work = move |memory: &Memory| {
        memory.sign(&call.author);
        run(memory, &call)
    };
    host.write(home, once, Box::new(work))
}

/// A collection of the database that a command is about: it says which store.
fn home(request: &Request) -> Namespace {
    Namespace { database: request.database.clone(), collection: RECORDS.to_owned() }
}

/// Sends a command to its transaction.
fn in_transaction(host: &mut Host<'_>, client: &mut Client, command: &'static Command, call: Call) -> Answer {
    let (Some(session), Some(part)) = (call.request.session.clone(), call.request.transaction) else {
        return Err(Failure::new(codes::INTERNAL, "a transaction without a session"));
    };
    if !command.in_transaction {
        let message = format!("Cannot run '{}' in a multi-document transaction.", command.name);
        return Err(Failure::new(codes::NOT_IN_TRANSACTION, message));
    }
    let ns = home(&call.request);
    if !host.memory()?.is_current(&ns)? {
        let message = "transactions are for databases in a file; this one is on a MongoDB server: connect to that";
        return Err(Failure::new(codes::ILLEGAL, message));
    }
    let once = Once { session: session.clone(), number: part.number };
    let action = match command.name {
        "commitTransaction" => Action::Commit,
        "abortTransaction" => Action::Abort,
        _ => Action::Run { starts: part.starts, ns, call: Box::new(call) },
    };
    if part.starts {
        client.transactions.insert(session.clone());
    }
    let is_end = !matches!(action, Action::Run { .. });
    let reply: Mailbox = host.inbox.mailbox();
    let answer = host.submit(Job::Step(Step { once, action, reply, since: std::time::Instant::now() }));
    if is_end {
        client.transactions.remove(&session);
    }
    answer
}

/// Runs a command where its transaction is.
pub(super) fn inside(host: &mut Host<'_>, call: &Call) -> Answer {
    let Some(command) = find(&call.request.name) else { return Err(unknown(&call.request)) };
    let is_writing = match command.run {
        Run::Here(_) | Run::Read(_) => false,
        Run::Write(_) => true,
        Run::Either(writes, ..) => writes(&call.request),
    };
    if is_writing && host.server.options.read_only {
        return Err(Failure::new(codes::ILLEGAL, "this memory is served read-only"));
    }
    match command.run {
        Run::Here(_) => host::empty(),
        Run::Read(run) => run(host, call),
        Run::Either(_, run, _) if !is_writing => run(host, call),
        Run::Write(run) | Run::Either(_, _, run) => {
            let memory = host.memory()?;
            memory.sign(&call.author);
            attempt(memory, &home(&call.request), |memory| run(memory, call))
        }
    }
}

fn find(name: &str) -> Option<&'static Command> {
    let mut all = GROUPS.iter().flat_map(|group| group.iter());
    all.find(|command| command.name == name || (is_alias(name) && command.name.eq_ignore_ascii_case(name)))
}

/// Names that MongoDB takes in small letters, too.
fn is_alias(name: &str) -> bool {
    matches!(
        name,
        "ismaster"
            | "buildinfo"
            | "findandmodify"
            | "getlasterror"
            | "dbstats"
            | "collstats"
            | "listcollections"
            | "listdatabases"
            | "deleteindexes"
    )
}

fn list(_: &mut Client, _: &Server, _: &Request) -> Answer {
    let all = GROUPS.iter().flat_map(|group| group.iter());
    let commands: Document = all
        .map(|command| (command.name.to_owned(), doc! { "help": "", "requiresAuth": !command.is_open }.into()))
        .collect();
    raw(&doc! { "commands": commands })
}

fn unknown(request: &Request) -> Failure {
    Failure::new(codes::NO_COMMAND, format!("no such command: '{}'", request.name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_commands_have_one_name() {
        let names: Vec<&str> = GROUPS.iter().flat_map(|group| group.iter()).map(|command| command.name).collect();
        let mut sorted = names.clone();
        sorted.sort_unstable();
        sorted.dedup();
        assert_eq!(sorted.len(), names.len());
        assert!(find("ismaster").is_some() && find("find").is_some() && find("FIND").is_none());
    }
}
