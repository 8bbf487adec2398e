//! `listDatabases`, `dropDatabase`

use bson::{Bson, Document, RawDocumentBuf, doc, rawdoc};

use super::definition::{Command, raw};
use super::statistics;
use crate::memory::Memory;
use crate::query::Filter;
use crate::serve::access::{OF_FILES, RECORDS};
use crate::serve::call::Call;
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::fields::whole;
use crate::serve::host::{Host, empty};
use crate::store::Namespace;

pub(super) const COMMANDS: &[Command] =
    &[Command::read("listDatabases", list), Command::write("dropDatabase", drop_database)];

/// MongoDB's code for a `dropDatabase` of anything but 1.
const NOT_ONE: i32 = 5_255_100;

fn list(host: &mut Host<'_>, call: &Call) -> Answer {
    let fields = call.request.fields();
    fields.known(&["filter", "nameOnly", "authorizedDatabases"])?;
    fields.boolean("authorizedDatabases")?;
    if call.request.database != "admin" {
        let message = "listDatabases may only be run against the admin database.";
        return Err(Failure::new(codes::UNAUTHORIZED, message));
    }
    let (filter, name_only) = (Filter::parse(&fields.document_or_empty("filter")?)?, fields.flag("nameOnly")?);
    let memory = host.memory()?;
    let (mut databases, mut total) = (Vec::new(), 0_i64);
    for (name, collections) in call.access(memory).databases()? {
        let size = if name_only { 0 } else { statistics::bytes(memory, &collections)? };
        let mut entry: Document = doc! { "name": name };
        if !name_only {
            entry.extend(doc! { "sizeOnDisk": size, "empty": false });
        }
        if filter.matches(&RawDocumentBuf::try_from(&entry)?)? {
            total += size;
            databases.push(Bson::Document(entry));
        }
    }
    let mut reply = doc! { "databases": databases };
    if !name_only {
        reply.extend(doc! { "totalSize": total, "totalSizeMb": total >> 20 });
    }
    raw(&reply)
}

fn drop_database(memory: &Memory, call: &Call) -> Answer {
    let fields = call.request.fields();
    fields.known(&[])?;
    match call.request.target() {
        None | Some(Bson::Null | Bson::Undefined) => return Err(fields.missing("dropDatabase")),
        Some(value) => match whole(value) {
            Some(1) => {}
            Some(_) => return Err(Failure::new(NOT_ONE, "Have to pass 1 as 'drop' parameter")),
            None => return Err(fields.wrong("dropDatabase", value, "[long, int, decimal, double]")),
        },
    }
    if call.request.database == "admin" {
        return Err(Failure::new(codes::ILLEGAL, "Dropping the 'admin' database is prohibited."));
    }
    let mut all = memory.collections_of(&call.request.database)?;
    // What writes of all databases were answered stays.
    all.retain(|ns| ns.database != OF_FILES || ns.collection != RECORDS);
    // What is noted of the others goes behind them.
    all.sort_by_key(Namespace::is_own);
    for ns in &all {
        call.access(memory).drop(ns)?;
    }
    let Some(ns) = all.first() else { return empty() };
    memory.note_dropped(&call.request.database)?;
    match call.request.unmet_concern() {
        Some(failure) if memory.is_current(ns)? => Err(unreplicated(&call.request.database, &all, &failure)),
        _ => empty(),
    }
}

/// The failure of a `dropDatabase` whose write concern cannot be met. The collections are dropped, and the command fails, as on
/// MongoDB.
fn unreplicated(database: &str, dropped: &[Namespace], failure: &Failure) -> Failure {
    let count = dropped.iter().filter(|ns| ns.collection != RECORDS).count();
    let message = format!(
        "dropDatabase {database} failed waiting for {count} collection drop(s) to replicate. :: caused by :: {}",
        failure.message
    );
    let details = rawdoc! { "writeConcernError": failure.concern_error() };
    let details = Box::new(Document::try_from(&*details).unwrap_or_default());
    Failure { details, ..Failure::new(failure.code, message) }.after_the_rest()
}
