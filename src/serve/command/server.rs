//! What a server says of itself: `serverStatus`, `hostInfo`, `getParameter` and others that tools ask for.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use bson::{Bson, DateTime, Document, doc};

use super::definition::{Command, raw};
use super::options::{self, Options, Type};
use crate::saturate::to_i64;
use crate::serve::call::Call;
use crate::serve::client::Client;
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::fields::{Fields, is_generic, number, whole};
use crate::serve::host::Host;
use crate::serve::request::Request;
use crate::serve::server::Server;
use crate::serve::session::TRANSACTION_LIMIT;
use crate::store::Namespace;

pub(super) const COMMANDS: &[Command] = &[
    Command::read("serverStatus", status),
    Command::here("hostInfo", host_info),
    Command::here("getParameter", parameter),
    Command::here("setParameter", set_parameter),
    Command::here("profile", profile),
    Command::here("getLog", log),
    Command::here("getCmdLineOpts", options),
    Command::read("top", top),
    Command::here("replSetGetStatus", set_status),
];

fn status(host: &mut Host<'_>, call: &Call) -> Answer {
    let server = Arc::clone(&host.server);
    let mut status = sections(&server);
    let all = host.memory().and_then(|memory| Ok((memory, call.access(memory).collections()?)));
    if let Ok((memory, all)) = all
        && all.iter().all(|ns| memory.is_current(ns).is_ok_and(|is_current| is_current))
    {
        let none = ["capped", "clustered", "timeseries", "views", "internalCollections", "internalViews"];
        let mut catalog = doc! { "collections": number(to_i64(all.len())) };
        catalog.extend(none.map(|name| (name.to_owned(), Bson::Int32(0))));
        status.insert("catalogStats", catalog);
    }
    let is_left_out = |name: &String| match call.request.body.get(name) {
        Some(Bson::Boolean(wanted)) => !wanted,
        Some(asked) => whole(asked) == Some(0),
        None => false,
    };
    raw(&status.into_iter().filter(|(name, _)| !SECTIONS.contains(&name.as_str()) || !is_left_out(name)).collect())
}

/// The parts of `serverStatus` that a client can do without, with `{NAME: 0}`.
const SECTIONS: [&str; 8] =
    ["catalogStats", "connections", "mem", "metrics", "network", "opcounters", "repl", "storageEngine"];

fn sections(server: &Server) -> Document {
    let counters = &server.counters;
    let count = |counter: &std::sync::atomic::AtomicU64| counter.load(Ordering::Relaxed).cast_signed();
    let size = to_i64::<usize>;
    let connected = server.connected();
    doc! {
        "host": host_name(),
        "version": super::handshake::VERSION,
        "process": "rmem",
        "pid": i64::from(std::process::id()),
        // Tools read a whole number in either type.
        "uptime": to_i64(server.since.elapsed().as_secs()),
        "uptimeMillis": to_i64(server.since.elapsed().as_millis()),
        "localTime": DateTime::now(),
        "connections": {
            "current": number(size(connected)),
            "available": number(size(server.options.connections.saturating_sub(connected))),
            "totalCreated": number(count(&counters.connections)),
        },
        "metrics": { "cursor": { "open": { "total": size(server.cursors.count()) } } },
        "network": {
            "bytesIn": count(&counters.received),
            "bytesOut": count(&counters.sent),
            "numRequests": count(&counters.commands),
        },
        "opcounters": server.usage.counts(),
        "mem": memory_used(),
        "storageEngine": { "name": "rmem", "persistent": true, "readOnly": server.options.read_only },
        "repl": { "setName": "rmem", "isWritablePrimary": true, "secondary": false },
    }
}

/// The memory of this process, in MiB, where the system says it.
fn memory_used() -> Document {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mebibytes = |name: &str| -> Option<i64> {
        let line = status.lines().find_map(|line| line.strip_prefix(name))?;
        Some(line.split_whitespace().next()?.parse::<i64>().ok()? >> 10)
    };
    match (mebibytes("VmRSS:"), mebibytes("VmSize:")) {
        (Some(resident), Some(all)) => {
            doc! { "bits": 64, "resident": number(resident), "virtual": number(all), "supported": true }
        }
        _ => doc! { "bits": 64, "supported": false },
    }
}

fn host_info(_: &mut Client, _: &Server, request: &Request) -> Answer {
    request.fields().known(&[])?;
    let cores = std::thread::available_parallelism().map_or(1, |count| i32::try_from(count.get()).unwrap_or(i32::MAX));
    raw(&doc! {
        "system": {
            "currentTime": DateTime::now(),
            "hostname": host_name(),
            "cpuAddrSize": 64,
            "numCores": cores,
            "cpuArch": std::env::consts::ARCH,
            "numaEnabled": false,
        },
        "os": { "type": std::env::consts::OS, "name": std::env::consts::OS, "version": "" },
        "extra": {},
    })
}

pub(super) fn host_name() -> String {
    rustix::system::uname().nodename().to_string_lossy().into_owned()
}

fn parameter(_: &mut Client, _: &Server, request: &Request) -> Answer {
    request.check_admin()?;
    if let Some(Bson::Document(asked)) = request.target() {
        const DETAILS: Options = &[("showDetails", Type::Flag), ("allParameters", Type::Flag)];
        options::check_inside("getParameter", asked, DETAILS)?;
    }
    let known = doc! {
        "featureCompatibilityVersion": { "version": "6.0" },
        "transactionLifetimeLimitSeconds": i64::try_from(TRANSACTION_LIMIT.as_secs()).unwrap_or(60),
        "authenticationMechanisms": [crate::serve::auth::MECHANISM],
        // That of SCRAM: mongorestore asks before it restores users.
        "authSchemaVersion": 5,
    };
    let asks_all = match request.target() {
        Some(Bson::String(all)) => all == "*",
        Some(Bson::Document(asked)) => Fields::new("getParameter", asked).flag("allParameters")?,
        _ => false,
    };
    let asked: Document = known.into_iter().filter(|(name, _)| asks_all || request.body.contains_key(name)).collect();
    match asked.is_empty() {
        true => Err(Failure::new(codes::INVALID_OPTIONS, "no option found to get")),
        false => raw(&asked),
    }
}

/// No parameter can be set while the server runs.
fn set_parameter(_: &mut Client, _: &Server, request: &Request) -> Answer {
    request.check_admin()?;
    let named = request.body.keys().skip(1).find(|name| !is_generic(name));
    let message = match named {
        Some(name) => format!("attempted to set unrecognized parameter [{name}]"),
        None => "no option found to set".to_owned(),
    };
    Err(Failure::new(codes::INVALID_OPTIONS, message))
}

/// Nothing is profiled: the level is 0, and cannot be raised.
fn profile(_: &mut Client, _: &Server, request: &Request) -> Answer {
    let fields = request.fields();
    fields.refuse(&["slowms", "sampleRate", "filter"])?;
    let level = fields.whole("profile")?.ok_or_else(|| fields.missing("profile"))?;
    match level {
        1 | 2 => Err(Failure::unsupported(&format!("profile: {level}"))),
        _ => raw(&doc! { "was": 0, "slowms": 100, "sampleRate": 1.0 }),
    }
}

fn log(_: &mut Client, _: &Server, request: &Request) -> Answer {
    request.check_admin()?;
    match request.target() {
        Some(Bson::String(name)) if name == "*" => raw(&doc! { "names": ["global", "startupWarnings"] }),
        Some(Bson::String(name)) if ["global", "startupWarnings"].contains(&name.as_str()) => {
            raw(&doc! { "totalLinesWritten": 0, "log": Bson::Array(Vec::new()) })
        }
        Some(Bson::String(_)) => {
            Err(Failure::new(codes::FAILED, "no log of that name; there are global and startupWarnings"))
        }
        None | Some(Bson::Null | Bson::Undefined) => Err(request.fields().missing("getLog")),
        _ => Err(Failure::new(codes::TYPE_MISMATCH, "getLog needs the name of a log")),
    }
}

fn options(_: &mut Client, _: &Server, request: &Request) -> Answer {
    request.check_admin()?;
    raw(&doc! { "argv": ["rmem", "serve"], "parsed": {} })
}

fn top(host: &mut Host<'_>, call: &Call) -> Answer {
    call.request.check_admin()?;
    let server = Arc::clone(&host.server);
    let mut totals = doc! { "note": "all times in microseconds" };
    let all: Vec<Namespace> = call.access(host.memory()?).databases()?.into_values().flatten().collect();
    totals.extend(all.iter().map(|ns| (ns.to_string(), Bson::Document(server.usage.of(&ns.to_string())))));
    raw(&doc! { "totals": totals })
}

fn set_status(client: &mut Client, server: &Server, request: &Request) -> Answer {
    request.check_admin()?;
    let member = doc! {
        "_id": 0,
        "name": &client.host,
        "health": 1.0,
        "state": 1,
        "stateStr": "PRIMARY",
        "uptime": i32::try_from(server.since.elapsed().as_secs()).unwrap_or(i32::MAX),
        "optimeDate": DateTime::now(),
        "electionDate": server.started,
        "self": true,
    };
    raw(&doc! {
        "set": "rmem",
        "date": DateTime::now(),
        "myState": 1,
        "term": 1_i64,
        "votingMembersCount": 1,
        "writableVotingMembersCount": 1,
        "members": [member],
    })
}
