//! Logging in and out.

use bson::spec::BinarySubtype;
use bson::{Binary, Bson, Document, doc};

use super::definition::{Command, raw};
use crate::serve::auth::{Conversation, MECHANISM};
use crate::serve::client::{Client, User};
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::fields::Fields;
use crate::serve::request::Request;
use crate::serve::server::Server;

pub(super) const COMMANDS: &[Command] = &[
    Command::here("saslStart", start).open(),
    Command::here("saslContinue", go_on).open(),
    Command::here("logout", logout).open(),
    Command::here("connectionStatus", status).open(),
];

/// The database at which all users log in.
const USERS: &str = "admin";

fn start(client: &mut Client, server: &Server, request: &Request) -> Answer {
    raw(&begin(client, server, request.fields(), &request.database)?)
}

/// A login that begins in the handshake; where it is refused, the client begins again by itself.
pub(super) fn speculative(client: &mut Client, server: &Server, start: &Document) -> Option<Document> {
    let fields = Fields::new("saslStart", start);
    let database = fields.text("db").ok().flatten().unwrap_or("admin").to_owned();
    start.contains_key("saslStart").then(|| begin(client, server, fields, &database).ok()).flatten()
}

fn begin(client: &mut Client, server: &Server, fields: Fields<'_>, database: &str) -> Result<Document, Failure> {
    let mechanism = fields.text("mechanism")?.unwrap_or_default();
    let Some(users) = &server.options.users else {
        return Err(Failure::new(
            codes::AUTHENTICATION,
            "this memory is served without users; connect without a user name",
        ));
    };
    if database != USERS {
        let message = format!(
            "Authentication failed: the users of rmem serve are those of {USERS}; add authSource={USERS} to the URI"
        );
        return Err(Failure::new(codes::AUTHENTICATION, message));
    }
    if mechanism != MECHANISM {
        let message = format!("the mechanism {mechanism} is not offered; use {MECHANISM}");
        return Err(Failure::new(codes::NO_MECHANISM, message));
    }
    let begun = Conversation::begin(users, 1, database, payload(fields)?);
    let (mut conversation, answer) = begun.map_err(|_| refused())?;
    conversation.skips_empty = fields
        .document("options")?
        .is_some_and(|options| Fields::new("options", options).flag("skipEmptyExchange").unwrap_or(false));
    let id = conversation.id;
    client.login = Some(conversation);
    Ok(reply(id, false, &answer))
}

fn go_on(client: &mut Client, _: &Server, request: &Request) -> Answer {
    let fields = request.fields();
    // What fails is over.
    let Some(mut conversation) = client.login.take() else {
        return Err(Failure::new(codes::PROTOCOL, "No SASL session state found"));
    };
    if fields.whole("conversationId")? != Some(conversation.id.into()) {
        return Err(Failure::new(codes::PROTOCOL, "sasl: Mismatched conversation id"));
    }
    let (id, skips) = (conversation.id, conversation.skips_empty);
    if conversation.is_proven {
        client.user = Some(User { name: conversation.user, database: conversation.database });
        return raw(&reply(id, true, ""));
    }
    let answer = conversation.prove(payload(fields)?).map_err(|_| refused())?;
    if skips {
        client.user = Some(User { name: conversation.user, database: conversation.database });
    } else {
        client.login = Some(conversation);
    }
    raw(&reply(id, skips, &answer))
}

fn logout(client: &mut Client, _: &Server, _: &Request) -> Answer {
    (client.user, client.login) = (None, None);
    crate::serve::host::empty()
}

fn status(client: &mut Client, _: &Server, request: &Request) -> Answer {
    request.fields().known(&["showPrivileges"])?;
    let users: Vec<Bson> =
        client.user.iter().map(|user| doc! { "user": &user.name, "db": &user.database }.into()).collect();
    let roles: Vec<Bson> = client.user.iter().map(|_| doc! { "role": "root", "db": "admin" }.into()).collect();
    let mut info = doc! { "authenticatedUsers": users, "authenticatedUserRoles": roles };
    if request.fields().flag("showPrivileges")? {
        info.insert("authenticatedUserPrivileges", Bson::Array(Vec::new()));
    }
    raw(&doc! { "authInfo": info })
}

fn payload(fields: Fields<'_>) -> Result<&[u8], Failure> {
    match fields.document.get("payload") {
        Some(Bson::Binary(payload)) => Ok(&payload.bytes),
        Some(Bson::String(payload)) => Ok(payload.as_bytes()),
        _ => Err(fields.missing("payload")),
    }
}

fn reply(id: i32, is_done: bool, payload: &str) -> Document {
    let payload = Binary { subtype: BinarySubtype::Generic, bytes: payload.as_bytes().to_vec() };
    doc! { "conversationId": id, "done": is_done, "payload": payload }
}

fn refused() -> Failure {
    Failure::new(codes::AUTHENTICATION, "Authentication failed.")
}
