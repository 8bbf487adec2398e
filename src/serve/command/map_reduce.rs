//! `mapReduce`: values reduced by key, with functions in JavaScript.

use bson::{Bson, Document, RawDocumentBuf, doc};

use super::definition::{Command, Run};
use crate::memory::Memory;
use crate::query::collation::during;
use crate::query::{MapReduce, Merging};
use crate::serve::access::Access;
use crate::serve::call::Call;
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::fields::Fields;
use crate::serve::host::Host;
use crate::serve::request::{Request, namespace};
use crate::store::{Aggregation, Find, MAX_SIZE, Modifiers, Namespace};

pub(super) const COMMANDS: &[Command] =
    &[Command { name: "mapReduce", run: Run::Either(writes, inline, store), is_open: false, in_transaction: false }];

/// What is taken, or makes no difference here.
const TAKEN: [&str; 12] = [
    "bypassDocumentValidation",
    "collation",
    "finalize",
    "jsMode",
    "limit",
    "map",
    "out",
    "query",
    "reduce",
    "scope",
    "sort",
    "verbose",
];

/// How results get into a collection, and what MongoDB calls it.
const MERGINGS: [(&str, Merging); 3] =
    [("replace", Merging::Replace), ("merge", Merging::Merge), ("reduce", Merging::Reduce)];

/// Where the results go.
enum Out {
    /// Into the answer.
    Inline,
    Collection {
        ns: Namespace,
        merging: Merging,
        /// What the answer names: the collection, or it and the database that was given.
        named: Bson,
    },
}

impl Out {
    fn read(request: &Request) -> Result<Self, Failure> {
        let fields = request.fields();
        let out = match fields.document.get("out") {
            None => return Err(fields.missing("out")),
            Some(Bson::String(collection)) => {
                let ns = namespace(&request.database, collection)?;
                return Ok(Self::Collection { ns, merging: Merging::Replace, named: collection.as_str().into() });
            }
            Some(Bson::Document(out)) => Fields::new("mapReduce.out", out),
            Some(_) => return Err(Failure::new(codes::FAILED_TO_PARSE, "'out' must be either a string or an object")),
        };
        out.known_inside(&["inline", "replace", "merge", "reduce", "db", "sharded", "nonAtomic"])?;
        if out.document.contains_key("inline") {
            return Ok(Self::Inline);
        }
        let named = MERGINGS.iter().find(|(name, _)| out.document.contains_key(name));
        let Some((name, merging)) = named else {
            let message = "'out' requires one of 'inline', 'replace', 'merge' and 'reduce'";
            return Err(Failure::new(codes::BAD_VALUE, message));
        };
        let collection = out.text(name)?.ok_or_else(|| out.missing(name))?;
        let database = out.text("db")?;
        let named = match database {
            Some(database) => doc! { "db": database, "collection": collection }.into(),
            None => collection.into(),
        };
        let ns = namespace(database.unwrap_or(&request.database), collection)?;
        if ns.database != request.database {
            return Err(Failure::unsupported("mapReduce into another database"));
        }
        Ok(Self::Collection { ns, merging: *merging, named })
    }
}

fn writes(request: &Request) -> bool {
    !matches!(Out::read(request), Ok(Out::Inline))
}

/// The text of a function, with the variables that came with it.
fn function<'a>(fields: Fields<'a>, name: &str, scope: &mut Document) -> Result<Option<&'a str>, Failure> {
    match fields.document.get(name) {
        Some(Bson::JavaScriptCode(code)) => Ok(Some(code)),
        Some(Bson::JavaScriptCodeWithScope(code)) => {
            scope.extend(code.scope.clone());
            Ok(Some(&code.code))
        }
        _ => fields.text(name),
    }
}

fn read(fields: Fields<'_>) -> Result<MapReduce, Failure> {
    fields.known(&TAKEN)?;
    let mut scope = fields.document_or_empty("scope")?;
    let mut read = |name| function(fields, name, &mut scope);
    let (map, reduce, finalize) = (read("map")?, read("reduce")?, read("finalize")?);
    let (map, reduce) = (map.ok_or_else(|| fields.missing("map"))?, reduce.ok_or_else(|| fields.missing("reduce"))?);
    Ok(MapReduce::parse(map, reduce, finalize, &scope)?)
}

fn results(call: &Call, access: Access<'_>, functions: &MapReduce) -> Result<Vec<Document>, Failure> {
    let fields = call.request.fields();
    let ns = call.request.readable()?;
    let collation = match fields.modifiers()?.collation {
        Some(own) => Some(own),
        None => access.memory.collation(&ns)?,
    };
    let find = Find {
        filter: fields.document_or_empty("query")?,
        sort: fields.document_or_empty("sort")?,
        limit: fields.size("limit")?.unwrap_or(0),
        modifiers: Modifiers { collation: collation.clone(), ..Modifiers::default() },
        ..Find::default()
    };
    let documents = access.find(&ns, &find)?;
    let found = during(collation.as_ref(), || functions.run(documents))?;
    call.request.check_ending()?;
    Ok(found)
}

fn inline(host: &mut Host<'_>, call: &Call) -> Answer {
    if call.request.write_concern.is_some() {
        return Err(Failure::without_write_concern());
    }
    let functions = read(call.request.fields())?;
    let found = results(call, call.access(host.memory()?), &functions)?;
    let reply = RawDocumentBuf::try_from(&doc! { "results": found })?;
    match reply.as_bytes().len() {
        0..=MAX_SIZE => Ok(reply),
        size => {
            let message = format!("the results have {size} bytes, more than the {MAX_SIZE} of an answer: use `out`");
            Err(Failure::new(codes::TOO_LARGE, message))
        }
    }
}

fn store(memory: &Memory, call: &Call) -> Answer {
    let functions = read(call.request.fields())?;
    let Out::Collection { ns, merging, named } = Out::read(&call.request)? else {
        return Err(Failure::new(codes::INTERNAL, "results for the answer are not written"));
    };
    let access = call.access(memory);
    let mut found = results(call, access, &functions)?;
    if merging == Merging::Reduce {
        for result in &mut found {
            let filter = doc! { "_id": { "$eq": result.get("_id") } };
            let stored = access.find(&ns, &Find { filter, limit: 1, ..Find::default() })?.next().transpose()?;
            if let Some(stored) = stored {
                functions.merge(&Document::try_from(stored.as_ref())?, result)?;
            }
        }
    }
    let stages = merging.stages(&ns.database, &ns.collection, found);
    let writing = Aggregation { stages: &stages, modifiers: &Modifiers::default() };
    access.aggregate(&ns, writing)?.try_for_each(|document| document.map(drop))?;
    super::definition::raw(&doc! { "result": named })
}
