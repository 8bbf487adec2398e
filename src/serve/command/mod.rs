//! Commands: what each is called, where it runs, and what it does.
//!
//! One file a group of commands, one line of its table a command.

mod aggregate;
mod coll_mod;
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
mod operation;
mod options;
mod results;
mod server;
mod session;
mod statistics;
mod transaction;
mod update;
mod write;

use std::sync::Arc;
use std::time::Instant;

use bson::raw::cstr;
use bson::{Bson, Document, doc, rawdoc};

use super::access::in_database;
use super::attempt::attempt;
use super::call::Call;
use super::client::Client;
use super::confirmation::confirmed;
use super::failure::{Answer, Failure, codes};
use super::host::{self, Host};
use super::job::{Action, Job, Step};
use super::past;
use super::reading;
use super::request::Request;
use super::server::Server;
use super::session::{Finished, How, Once, started, superseded};
use super::statements::{Repeatable, Statements};
use super::wire::Form;
use crate::deadline::Deadline;
use crate::memory::Memory;
use crate::store::Namespace;
use definition::{Command, Run, raw};

/// All groups.
const GROUPS: [&[Command]; 21] = [
    COMMANDS,
    handshake::COMMANDS,
    login::COMMANDS,
    server::COMMANDS,
    operation::COMMANDS,
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
    coll_mod::COMMANDS,
    collection::COMMANDS,
    database::COMMANDS,
    index::COMMANDS,
    statistics::COMMANDS,
];

/// What MongoDB 6.0 answers as OP_QUERY, too: with these, drivers of before 2020 begin.
const QUERIED: [&str; 5] = ["hello", "isMaster", "buildInfo", "saslStart", "saslContinue"];

/// Writes that may be repeated.
const RETRYABLE: [&str; 4] = ["insert", "update", "delete", "findAndModify"];

/// The command about all commands.
const COMMANDS: &[Command] = &[Command::here("listCommands", list)];

/// Runs a command of a client.
pub(super) fn run(host: &mut Host<'_>, client: &mut Client, body: Document, form: Form) -> Answer {
    let command = body.keys().next().and_then(|name| find(name));
    if body.contains_key("writeConcern") && command.is_some_and(|command| !command.takes_write_concern()) {
        return Err(Failure::without_write_concern());
    }
    let request = Arc::new(Request::read(body)?);
    let activity = Arc::clone(&client.activity);
    let _active = activity.begin(&request);
    let writes = |command: &Command| command.is_writing(&request) || command.name == "commitTransaction";
    let failure = request.unmet_concern().filter(|_| command.is_some_and(writes));
    let is_unacknowledged = request.is_unacknowledged();
    let ns = failure.as_ref().map(|_| home(&request));
    let unacknowledged = match request.name.as_str() {
        "insert" | "delete" => Some(rawdoc! { "n": 0 }),
        "update" => Some(rawdoc! { "n": 0, "nModified": 0 }),
        _ => None,
    };
    let Some(command) = command else { return Err(unknown(&request)) };
    let mut reply = noted(host, client, command, request, form)?;
    if let Some(unacknowledged) = unacknowledged.filter(|_| is_unacknowledged) {
        return Ok(unacknowledged);
    }
    // A MongoDB server was asked itself.
    if let Some((failure, ns)) = failure.zip(ns)
        && host.memory()?.is_current(&ns)?
    {
        reply.append(cstr!("writeConcernError"), failure.concern_error());
    }
    Ok(reply)
}

/// Dispatches a command, and notes how long it took.
fn noted(
    host: &mut Host<'_>,
    client: &mut Client,
    command: &'static Command,
    request: Arc<Request>,
    form: Form,
) -> Answer {
    let known = Arc::clone(&request);
    let answer = dispatch(host, client, command, request, form);
    if answer.is_ok() {
        host.server.usage.note(&known, command.is_writing(&known), known.since.elapsed());
    }
    answer
}

fn dispatch(
    host: &mut Host<'_>,
    client: &mut Client,
    command: &'static Command,
    request: Arc<Request>,
    form: Form,
) -> Answer {
    if form == Form::Query && !QUERIED.contains(&command.name) {
        let message = format!("Unsupported OP_QUERY command: {}; use OP_MSG", request.name);
        return Err(Failure::new(codes::NO_QUERY, message));
    }
    let server = Arc::clone(&host.server);
    if client.needs_login && client.user.is_none() && !command.is_open {
        let message = format!("command {} requires authentication", request.name);
        return Err(Failure::new(codes::UNAUTHORIZED, message));
    }
    check_number(command, &request)?;
    if request.reads_snapshot() {
        let call = Call::new(request, client.metadata, &client.author);
        return past::read(host, &home(&call.request), call, inside);
    }
    if let Run::Here(run) = command.run {
        return match request.is_in_transaction() {
            true => Err(outside_only(command)),
            false => run(client, &server, &request),
        };
    }
    let call = Call::new(request, client.metadata, &client.author);
    if call.request.is_in_transaction() {
        return in_transaction(host, client, command, call);
    }
    let _deadline = Deadline::set(call.request.limits());
    match command.run {
        Run::Here(_) => host::empty(),
        Run::Read(run) => run(host, &call),
        Run::Either(writes, read, _) | Run::Sliced(writes, read, _) if !writes(&call.request) => read(host, &call),
        Run::Write(run) | Run::Either(_, _, run) => write(host, run, call),
        Run::Sliced(_, _, run) => write_in_slices(host, run, &call),
    }
}

/// Refuses the number of a write that may be repeated where the command is no such write.
fn check_number(command: &Command, request: &Request) -> Result<(), Failure> {
    let is_numbered = request.transaction.is_some_and(|part| !part.is_multi);
    match command.run {
        _ if !is_numbered || RETRYABLE.contains(&command.name) => Ok(()),
        Run::Here(_) => {
            let message = format!("It is illegal to provide a txnNumber for the command {}", command.name);
            Err(Failure::new(codes::NO_NUMBER, message))
        }
        _ => {
            let message = format!(
                "txnNumber may only be provided for multi-document transactions and retryable write commands. \
                 autocommit:false was not provided, and {} is not a retryable write command.",
                command.name
            );
            Err(Failure::new(codes::NOT_RETRYABLE, message))
        }
    }
}

/// Refuses to write where the memory is served read-only.
fn check_writable(host: &Host<'_>, request: &Request) -> Result<(), Failure> {
    match host.server.options.read_only {
        true => {
            let message = format!("{}: this memory is served read-only", request.name);
            Err(Failure::new(codes::ILLEGAL, message))
        }
        false => Ok(()),
    }
}

/// Writes in slices, between which others write.
fn write_in_slices(host: &mut Host<'_>, run: fn(&Memory, &Call) -> Answer, call: &Call) -> Answer {
    check_writable(host, &call.request)?;
    let ns = home(&call.request);
    host.write_in_slices(&ns, call.request.limits(), |memory| {
        memory.sign(&call.author);
        confirmed(memory, &ns, &call.request, |memory| perform(memory, &ns, call, run))
    })
}

/// Runs a command that writes; where it says so, also what does not pass a validator is stored.
fn perform(memory: &Memory, ns: &Namespace, call: &Call, run: fn(&Memory, &Call) -> Answer) -> Answer {
    if !call.request.is_unvalidated {
        return run(memory, call);
    }
    let mut answer = host::empty();
    memory.unvalidated(ns, &mut || {
        answer = run(memory, call);
        Ok(())
    })?;
    answer
}

/// Has something written; once, where the command has a number.
fn write(host: &mut Host<'_>, run: fn(&Memory, &Call) -> Answer, mut call: Call) -> Answer {
    check_writable(host, &call.request)?;
    let once = match (&call.request.session, call.request.transaction) {
        (Some(session), Some(part)) => Some(Once { session: session.clone(), number: part.number }),
        _ => None,
    };
    if let Some(once) = &once {
        if host.server.readings.has(once) || host.server.sessions.has_transaction(once) {
            let message = "Cannot retry a retryable write that has been converted into a transaction";
            return Err(Failure::new(codes::CONVERTED, message));
        }
        if let Some(later) = host.server.readings.later(once) {
            return Err(superseded(once, later));
        }
        host.server.readings.end_before(once);
    }
    if once.is_some() {
        call.statements = Arc::new(Statements::read(&call.request)?);
    }
    let once = once.map(|once| Repeatable { once, statements: Arc::clone(&call.statements) });
    let (home, limits) = (home(&call.request), call.request.limits());
    let ns = home.clone();
    let work = move |memory: &Memory| {
        memory.sign(&call.author);
        confirmed(memory, &ns, &call.request, |memory| perform(memory, &ns, &call, run))
    };
    host.write(home, once, limits, Box::new(work))
}

/// A collection of the database that a command is about: it says which store.
fn home(request: &Request) -> Namespace {
    in_database(&request.database)
}

/// Sends a command to its transaction.
fn in_transaction(host: &mut Host<'_>, client: &mut Client, command: &'static Command, call: Call) -> Answer {
    let (Some(session), Some(part)) = (call.request.session.clone(), call.request.transaction) else {
        return Err(Failure::new(codes::INTERNAL, "a transaction without a session"));
    };
    if !command.in_transaction {
        return Err(outside_only(command));
    }
    check_in_transaction(&call.request, part.starts)?;
    let ns = home(&call.request);
    if !host.memory()?.is_current(&ns)? {
        let message = "transactions are for databases in a file; this one is on a MongoDB server: connect to that";
        return Err(Failure::new(codes::NOT_SUPPORTED, message));
    }
    let once = Once { session: session.clone(), number: part.number };
    if part.starts && matches!(command.name, "commitTransaction" | "abortTransaction") {
        let message = format!("Cannot start a transaction with {}", command.name);
        return Err(Failure::new(codes::NOT_IN_TRANSACTION, message));
    }
    if part.starts {
        client.transactions.insert(session.clone(), part.number);
    }
    let end = match command.name {
        "commitTransaction" => Some((Action::Commit(client.digest()), How::Committed)),
        "abortTransaction" => Some((Action::Abort, How::Aborted)),
        _ => None,
    };
    match end {
        Some((action, how)) => {
            client.transactions.remove(&session);
            end_transaction(host, once, action, how)
        }
        None => step(host, command, once, part.starts, &Arc::new(call)),
    }
}

/// The failure of a command that is of no transaction, and leaves the one that is open as it is.
fn outside_only(command: &Command) -> Failure {
    let message = format!("Cannot run '{}' in a multi-document transaction.", command.name);
    Failure::new(codes::NOT_IN_TRANSACTION, message)
}

/// Refuses what a command of a transaction may not say: only the first says what it reads, and only the last who confirms it.
fn check_in_transaction(request: &Request, starts: bool) -> Result<(), Failure> {
    let body = &request.body;
    let is_end = matches!(request.name.as_str(), "commitTransaction" | "abortTransaction");
    if is_end {
        request.check_admin()?;
    }
    if !is_end && matches!(request.database.as_str(), "config" | "local") {
        let message = format!("Cannot run command against the '{}' database in a transaction.", request.database);
        return Err(Failure::new(codes::NOT_IN_TRANSACTION, message));
    }
    let invalid = |message: &str| Err(Failure::new(codes::INVALID_OPTIONS, message));
    if !is_end && body.contains_key("writeConcern") {
        return invalid("writeConcern is not allowed within a multi-statement transaction");
    }
    match body.get_document("readConcern") {
        Ok(_) if !starts => invalid("Only the first command in a transaction may specify a readConcern"),
        Ok(concern) if matches!(concern.get_str("level"), Ok("available" | "linearizable")) => {
            invalid("The readConcern level must be either 'local' (default), 'majority' or 'snapshot' in a transaction")
        }
        _ => Ok(()),
    }
}

/// Ends a transaction: one that has only read is over, others are ended by the writer.
fn end_transaction(host: &mut Host<'_>, once: Once, action: Action, how: How) -> Answer {
    if host.server.readings.end(&once) {
        let finished = Finished { number: once.number, how, at: Instant::now() };
        host.server.sessions.finish(&once.session, finished);
        return host::empty();
    }
    host.submit(|reply| Job::Step(Step { once, action, reply, since: Instant::now() }))
}

/// Runs a command of a transaction: where it has only read, in its own thread; else by the writer.
fn step(host: &mut Host<'_>, command: &Command, once: Once, starts: bool, call: &Arc<Call>) -> Answer {
    let ns = home(&call.request);
    let server = Arc::clone(&host.server);
    if starts {
        server.readings.end_before(&once);
    }
    if starts && server.readings.has(&once) {
        return Err(started(&once));
    }
    let is_writing = command.is_writing(&call.request);
    let begins = starts && !is_writing;
    if begins {
        match server.sessions.open(&once.session) {
            Some(open) if open == once.number => return Err(started(&once)),
            Some(open) if open > once.number => return Err(superseded(&once, open)),
            Some(_) => server.writer.submit(Job::abandon(vec![once.session.clone()]))?,
            None => {}
        }
    }
    if let Some(Bson::Int64(cursor)) = call.request.target()
        && command.name == "getMore"
        && server.readings.keeps_cursor(&once, *cursor)
    {
        let answer = inside(host, call);
        if answer.is_err() {
            server.writer.submit(Job::abandon(vec![once.session]))?;
        }
        return answer;
    }
    let work: (_, reading::Command) = (&ns, inside);
    if !is_writing && let Some(answer) = reading::run(host, &once, call, begins.then_some(work))? {
        return answer;
    }
    let snapshot = reading::snapshot(host, &once)?;
    let starts = starts || snapshot.is_some();
    let action = Action::Run { starts, ns, call: Arc::clone(call), snapshot };
    let step = |reply| Job::Step(Step { once: once.clone(), action, reply, since: Instant::now() });
    let answer = host.submit(step);
    if answer.is_err() {
        server.readings.end(&once);
    }
    answer
}

/// Runs a command where its transaction is.
pub(super) fn inside(host: &mut Host<'_>, call: &Call) -> Answer {
    let Some(command) = find(&call.request.name) else { return Err(unknown(&call.request)) };
    let _deadline = Deadline::set(call.request.limits());
    let is_writing = command.is_writing(&call.request);
    if is_writing {
        check_writable(host, &call.request)?;
    }
    match command.run {
        Run::Here(_) => host::empty(),
        Run::Read(run) => run(host, call),
        Run::Either(_, run, _) | Run::Sliced(_, run, _) if !is_writing => run(host, call),
        Run::Write(run) | Run::Either(_, _, run) | Run::Sliced(_, _, run) => {
            let memory = host.memory()?;
            memory.sign(&call.author);
            let ns = home(&call.request);
            attempt(memory, &ns, |memory| perform(memory, &ns, call, run))
        }
    }
}

fn find(name: &str) -> Option<&'static Command> {
    let mut all = GROUPS.iter().flat_map(|group| group.iter());
    all.find(|command| command.name == name || (is_alias(name) && command.name.eq_ignore_ascii_case(name)))
}

/// Whether a command only reads, so that it need not come to its end.
pub(super) fn only_reads(request: &Request) -> bool {
    find(&request.name).is_some_and(|command| !command.is_writing(request))
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
