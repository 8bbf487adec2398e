//! Commands: what each is called, where it runs, and what it does.
//!
//! One file a group of commands, one line of its table a command.

mod aggregate;
mod collection;
mod cursor;
mod database;
mod delete;
mod explain;
mod find;
mod handshake;
mod index;
mod insert;
mod login;
mod modify;
mod server;
mod session;
mod statistics;
mod transaction;
mod update;
mod write;

use std::sync::Arc;

use bson::raw::cstr;
use bson::{Document, RawDocumentBuf, rawdoc};

use super::access::{Access, Metadata};
use super::client::Client;
use super::failure::{Answer, Failure, codes};
use super::host::Host;
use super::mailbox::Mailbox;
use super::request::Request;
use super::server::Server;
use super::transaction::{Action, Step};
use super::wire::Form;
use super::writer::{Job, Once};
use crate::memory::Memory;
use crate::store::Namespace;

/// All groups.
const GROUPS: [&[Command]; 17] = [
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
    cursor::COMMANDS,
    explain::COMMANDS,
    collection::COMMANDS,
    database::COMMANDS,
    index::COMMANDS,
    statistics::COMMANDS,
];

/// A command.
struct Command {
    name: &'static str,
    run: Run,
    /// Before somebody has logged in, too.
    is_open: bool,
    /// Whether it may be a part of a transaction.
    in_transaction: bool,
}

/// Where a command runs, and what it does.
#[derive(Clone, Copy)]
enum Run {
    /// On the connection alone; it needs no memory.
    Here(fn(&mut Client, &Server, &Request) -> Answer),
    /// Where it reads, on the connection's own memory.
    Read(for<'h, 'm> fn(&'h mut Host<'m>, &Call) -> Answer),
    /// Where it writes, by the writer.
    Write(fn(&Memory, &Call) -> Answer),
    /// One or the other, as the first function says.
    Either(fn(&Request) -> bool, for<'h, 'm> fn(&'h mut Host<'m>, &Call) -> Answer, fn(&Memory, &Call) -> Answer),
}

impl Command {
    const fn here(name: &'static str, run: fn(&mut Client, &Server, &Request) -> Answer) -> Self {
        Self { name, run: Run::Here(run), is_open: false, in_transaction: false }
    }

    const fn read(name: &'static str, run: for<'h, 'm> fn(&'h mut Host<'m>, &Call) -> Answer) -> Self {
        Self { name, run: Run::Read(run), is_open: false, in_transaction: false }
    }

    const fn write(name: &'static str, run: fn(&Memory, &Call) -> Answer) -> Self {
        Self { name, run: Run::Write(run), is_open: false, in_transaction: false }
    }

    /// The same, for everybody.
    const fn open(self) -> Self {
        Self { is_open: true, ..self }
    }

    /// The same, in transactions, too.
    const fn transactional(self) -> Self {
        Self { in_transaction: true, ..self }
    }
}

/// A command that is being run.
pub(super) struct Call {
    pub(super) request: Request,
    pub(super) metadata: Metadata,
}

impl Call {
    fn access<'m>(&self, memory: &'m Memory) -> Access<'m> {
        Access::new(memory, self.metadata)
    }
}

/// Runs a command of a client.
pub(super) fn run(host: &mut Host<'_>, client: &mut Client, body: Document, form: Form) -> Answer {
    let request = Request::read(body)?;
    let wants_others = request.wants_others;
    let mut reply = dispatch(host, client, request, form)?;
    if wants_others {
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
    let call = Call { request, metadata: client.metadata };
    if call.request.is_in_transaction() {
        return in_transaction(host, client, command, call);
    }
    match command.run {
        Run::Here(_) => super::host::empty(),
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
    host.write(home, once, Box::new(move |memory| run(memory, &call)))
}

/// A collection of the database that a command is about: it says which store.
fn home(request: &Request) -> Namespace {
    Namespace { database: request.database.clone(), collection: "rmem.retries".to_owned() }
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
        _ => Action::Run { starts: part.starts, ns, command: Box::new(move |host| inside(host, command, &call)) },
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
fn inside(host: &mut Host<'_>, command: &Command, call: &Call) -> Answer {
    let is_writing = match command.run {
        Run::Here(_) | Run::Read(_) => false,
        Run::Write(_) => true,
        Run::Either(writes, ..) => writes(&call.request),
    };
    if is_writing && host.server.options.read_only {
        return Err(Failure::new(codes::ILLEGAL, "this memory is served read-only"));
    }
    match command.run {
        Run::Here(_) => super::host::empty(),
        Run::Read(run) => run(host, call),
        Run::Either(_, run, _) if !is_writing => run(host, call),
        Run::Write(run) | Run::Either(_, _, run) => {
            let memory = host.memory()?;
            super::writer::attempt(memory, &home(&call.request), |memory| run(memory, call))
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

fn unknown(request: &Request) -> Failure {
    Failure::new(codes::NO_COMMAND, format!("no such command: '{}'", request.name))
}

/// An answer in bytes.
fn raw(document: &Document) -> Answer {
    Ok(RawDocumentBuf::try_from(document)?)
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
