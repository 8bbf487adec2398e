//! Sessions: they need no beginning, and end by themselves.

use bson::{Bson, doc};

use super::definition::{Command, raw};
use super::options::{self, Options, Type};
use crate::query::QueryError;
use crate::serve::call::Call;
use crate::serve::client::Client;
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::fields::Fields;
use crate::serve::host::{self, Host};
use crate::serve::job::{Abandoned, Job};
use crate::serve::request::Request;
use crate::serve::server::Server;
use crate::serve::session::{SessionId, TIMEOUT_MINUTES};

pub(super) const COMMANDS: &[Command] = &[
    Command::here("startSession", start),
    Command::here("refreshSessions", refresh),
    Command::read("endSessions", end),
    Command::read("killSessions", kill),
    Command::read("killAllSessions", kill_all),
    Command::read("killAllSessionsByPattern", kill_all),
];

fn start(_: &mut Client, _: &Server, _: &Request) -> Answer {
    raw(&doc! { "id": SessionId::random().to_document(), "timeoutMinutes": TIMEOUT_MINUTES })
}

fn refresh(_: &mut Client, _: &Server, request: &Request) -> Answer {
    sessions(request)?;
    host::empty()
}

fn end(host: &mut Host<'_>, call: &Call) -> Answer {
    call.request.fields().known(&[])?;
    let sessions = sessions(&call.request)?;
    host.server.cursors.kill_all(|origin| origin.session.as_ref().is_some_and(|session| sessions.contains(session)));
    let snapshots: Vec<SessionId> = sessions.iter().map(SessionId::of_snapshot).collect();
    host.server.readings.end_all(|session| sessions.contains(session) || snapshots.contains(session));
    host.server.writer.submit(Job::abandon(sessions))?;
    host::empty()
}

/// The same; what they are doing is stopped, too.
fn kill(host: &mut Host<'_>, call: &Call) -> Answer {
    let sessions = sessions(&call.request)?;
    stop(host, call, |session| sessions.contains(session));
    end(host, call)
}

/// Stops the operations of sessions, but not the one that asks for it.
fn stop(host: &Host<'_>, call: &Call, is_meant: impl Fn(&SessionId) -> bool) {
    host.server.stop_operations(QueryError::INTERRUPTED, |request| {
        request.operation != call.request.operation && request.session.as_ref().is_some_and(&is_meant)
    });
}

/// Ends the cursors of all sessions; whose transactions they are is not known here.
fn kill_all(host: &mut Host<'_>, call: &Call) -> Answer {
    let fields = call.request.fields();
    if call.request.name == "killAllSessions" {
        const OF_USER: Options = &[("user", Type::Text), ("db", Type::Text)];
        if let Some(user) = fields.documents("killAllSessions")?.unwrap_or_default().first() {
            options::check_inside("killAllSessions.killAllSessions", user, OF_USER)?;
            let user = Fields::new("killAllSessions.killAllSessions", user);
            let name = user.text("user")?.ok_or_else(|| user.missing("user"))?;
            let database = user.text("db")?.ok_or_else(|| user.missing("db"))?;
            // Users are no documents here, and sessions not theirs.
            let message = format!("Could not find user \"{name}\" for db \"{database}\"");
            return Err(Failure::new(codes::NO_USER, message));
        }
    }
    fields.documents(&call.request.name)?;
    stop(host, call, |_| true);
    host.server.cursors.kill_all(|origin| origin.session.is_some());
    host.server.readings.end_all(|_| true);
    host.server.writer.submit(Job::Abandon(Abandoned::All))?;
    host::empty()
}

fn sessions(request: &Request) -> Result<Vec<SessionId>, Failure> {
    let fields = Fields::new(&request.name, &request.body);
    let array = match request.target() {
        Some(Bson::Array(_)) => fields.documents(&request.name)?.unwrap_or_default(),
        None | Some(Bson::Null | Bson::Undefined) => return Err(fields.missing(&request.name)),
        Some(other) => return Err(fields.wrong(&request.name, other, "array")),
    };
    array.into_iter().map(SessionId::read).collect()
}
