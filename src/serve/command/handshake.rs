//! The first commands of a client: the server's identity and abilities.

use bson::{Bson, DateTime, Document, doc, oid::ObjectId};

use super::definition::{Command, raw};
use crate::serve::access::Metadata;
use crate::serve::auth::MECHANISM;
use crate::serve::client::Client;
use crate::serve::failure::Answer;
use crate::serve::request::Request;
use crate::serve::server::Server;
use crate::serve::session::TIMEOUT_MINUTES;
use crate::serve::wire::{MAX_MESSAGE, ZLIB};
use crate::store::MAX_SIZE;

pub(super) const COMMANDS: &[Command] = &[
    Command::here("hello", hello).open(),
    Command::here("isMaster", hello).open(),
    Command::here("ping", ping).open(),
    Command::here("buildInfo", build_info).open(),
    Command::here("whatsmyuri", whats_my_uri).open(),
];

/// The name of the replica set that the server is the one member of: drivers repeat writes, and begin
/// transactions, with members of one only.
const SET: &str = "rmem";
/// The version of the wire protocol: that of MongoDB 6.0.
const WIRE_VERSION: i32 = 17;
/// The version of MongoDB whose commands and languages these are.
pub(super) const VERSION: &str = "6.0.0";
/// At most so many statements are in one command.
pub(super) const MAX_BATCH: usize = 100_000;

fn hello(client: &mut Client, server: &Server, request: &Request) -> Answer {
    let fields = request.fields();
    greet(client, server, fields.document("client")?);
    let now = DateTime::now();
    let time = server.clock.now();
    let written = doc! { "ts": time, "t": 1_i64 };
    let primary = if request.name == "hello" { "isWritablePrimary" } else { "ismaster" };
    let mut reply = doc! {
        "helloOk": true,
        primary: true,
        "lastWrite": { "opTime": written.clone(), "lastWriteDate": now, "majorityOpTime": written, "majorityWriteDate": now },
        "maxBsonObjectSize": size(MAX_SIZE),
        "maxMessageSizeBytes": size(MAX_MESSAGE),
        "maxWriteBatchSize": size(MAX_BATCH),
        "localTime": now,
        "logicalSessionTimeoutMinutes": TIMEOUT_MINUTES,
        "connectionId": i32::try_from(client.id).unwrap_or(i32::MAX),
        "minWireVersion": 0,
        "maxWireVersion": WIRE_VERSION,
        "readOnly": server.options.read_only,
    };
    reply.extend(role(client));
    let compressors = fields.array("compression")?.unwrap_or_default();
    if compressors.iter().any(|name| name.as_str() == Some(ZLIB)) {
        reply.insert("compression", vec![ZLIB]);
    }
    if server.options.users.is_some() && fields.document.contains_key("saslSupportedMechs") {
        reply.insert("saslSupportedMechs", vec![MECHANISM]);
    }
    if let Some(start) = fields.document("speculativeAuthenticate")?
        && let Some(answer) = super::login::speculative(client, server, start)
    {
        reply.insert("speculativeAuthenticate", answer);
    }
    raw(&reply)
}

/// What drivers take the server for: the one member of a replica set, found at `host`. A socket's path cannot be
/// the name of a member, since drivers write hosts in small letters; there it is a router (mongos), which is
/// found where it was found.
fn role(client: &Client) -> Document {
    if client.host.starts_with('/') {
        return doc! { "msg": "isdbgrid" };
    }
    doc! {
        "setName": SET,
        "setVersion": 1,
        "secondary": false,
        "primary": &client.host,
        "hosts": [&client.host],
        "me": &client.host,
        "electionId": ObjectId::from_bytes([0x7F, 0xFF, 0xFF, 0xFF, 0, 0, 0, 0, 0, 0, 0, 1]),
    }
}

/// The most characters of a client's name that the history has.
const LONGEST_AUTHOR: usize = 120;

/// Notes the client's description of itself. rmem itself keeps its metadata as it does on MongoDB.
fn greet(client: &mut Client, server: &Server, metadata: Option<&Document>) {
    let application = metadata.and_then(|metadata| metadata.get_document("application").ok());
    let name = application.and_then(|application| application.get_str("name").ok());
    let driver = metadata.and_then(|metadata| metadata.get_document("driver").ok());
    let driver = driver.and_then(|driver| driver.get_str("name").ok());
    if let Some(author) = name.or(driver) {
        client.author = author.chars().take(LONGEST_AUTHOR).collect::<String>().into();
    }
    if let Some(name) = name {
        client.metadata = if name == "rmem" { Metadata::Own } else { server.metadata() };
    }
}

fn size(bytes: usize) -> i32 {
    i32::try_from(bytes).unwrap_or(i32::MAX)
}

fn ping(_: &mut Client, _: &Server, request: &Request) -> Answer {
    request.fields().known(&[])?;
    crate::serve::host::empty()
}

fn build_info(_: &mut Client, _: &Server, _: &Request) -> Answer {
    raw(&doc! {
        "version": VERSION,
        "versionArray": [6, 0, 0, 0],
        "gitVersion": "rmem",
        "rmem": env!("CARGO_PKG_VERSION"),
        "modules": Bson::Array(Vec::new()),
        "allocator": "system",
        "javascriptEngine": "none",
        "sysInfo": "deprecated",
        "bits": 64,
        "debug": cfg!(debug_assertions),
        "maxBsonObjectSize": size(MAX_SIZE),
        "storageEngines": ["rmem"],
    })
}

fn whats_my_uri(client: &mut Client, _: &Server, _: &Request) -> Answer {
    raw(&doc! { "you": &client.peer })
}
