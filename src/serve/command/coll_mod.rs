//! `collMod`: which documents a collection takes, and what its indexes do.

use bson::{Bson, Document, doc};

use super::collection::{ACTION, GRANULARITY, IMAGES, LEVEL, images, validation};
use super::definition::{Command, raw};
use super::options::{self, Options, Type};
use crate::memory::Memory;
use crate::serve::call::Call;
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::fields::{Fields, whole};
use crate::store::validation::OPTIONS;
use crate::store::{Index, IndexChange, Namespace, index};

pub(super) const COMMANDS: &[Command] = &[Command::write("collMod", modify)];

/// The options of `collMod`.
const OF_MODIFY: Options = &[
    ("cappedMax", Type::Number),
    ("cappedSize", Type::Number),
    ("changeStreamPreAndPostImages", IMAGES),
    ("dryRun", Type::Flag),
    ("expireAfterSeconds", Type::Given(&Type::Either(&Type::Text, &Type::Number))),
    ("index", Type::Of(&[], OF_INDEX)),
    ("pipeline", Type::Objects),
    ("recordPreImages", Type::Flag),
    ("timeseries", Type::Of(&[], &[("granularity", GRANULARITY)])),
    ("validationAction", ACTION),
    ("validationLevel", LEVEL),
    ("validator", Type::Object),
    ("viewOn", Type::Text),
];

/// What it may change of an index.
const OF_INDEX: Options = &[
    ("expireAfterSeconds", Type::Number),
    ("forceNonUnique", Type::Flag),
    ("hidden", Type::Flag),
    ("keyPattern", Type::Object),
    ("name", Type::Text),
    ("prepareUnique", Type::Flag),
    ("unique", Type::Flag),
];

/// Options for views, capped collections and time series.
const OF_OTHERS: [&str; 6] = ["viewOn", "pipeline", "cappedSize", "cappedMax", "expireAfterSeconds", "timeseries"];

/// An index can be hidden, and be made to remove what has expired; the validator can be changed, and whether a MongoDB
/// server keeps documents before and after changes. Nothing else can be modified.
fn modify(memory: &Memory, call: &Call) -> Answer {
    let (ns, fields) = (call.request.namespace()?, call.request.fields());
    options::check("collMod", fields.document, OF_MODIFY)?;
    if fields.text("viewOn")? == Some("") {
        return Err(Failure::new(codes::BAD_VALUE, "'viewOn' cannot be empty"));
    }
    let images = images(fields)?;
    if !memory.collections_of(&ns.database)?.contains(&ns) {
        return Err(Failure::new(codes::NO_NAMESPACE, format!("ns does not exist: {ns}")));
    }
    let is_dry = fields.flag("dryRun")?;
    let asked = fields.document("index")?.map(|asked| Asked::read(memory, call, &ns, asked)).transpose()?;
    let invalid = |message: String| Err(Failure::new(codes::INVALID_OPTIONS, message));
    match &asked {
        None if is_dry => return invalid("dry run mode requires an valid index modification.".to_owned()),
        Some(asked) if is_dry && !asked.is_to_be_unique => {
            return invalid("dry run mode requires an index modification with unique: true.".to_owned());
        }
        _ => {}
    }
    if let Some(name) = OF_OTHERS.iter().find(|name| is_said(fields, name)) {
        return invalid(format!(
            "the option {name} is not for a collection that is no view, not capped and no time series"
        ));
    }
    if is_dry {
        return crate::serve::host::empty();
    }
    modify_validation(memory, &ns, fields)?;
    if let Some(are_kept) = images {
        memory.set_images(&ns, are_kept)?;
    }
    match asked {
        Some(asked) => asked.modify(memory, &ns),
        None => crate::serve::host::empty(),
    }
}

fn is_said(fields: Fields<'_>, name: &str) -> bool {
    !matches!(fields.document.get(name), None | Some(Bson::Null | Bson::Undefined))
}

/// Changes which documents a collection takes, where the command says something of it; what it does not say stays.
fn modify_validation(memory: &Memory, ns: &Namespace, fields: Fields<'_>) -> Result<(), Failure> {
    if !OPTIONS.iter().any(|name| is_said(fields, name)) {
        return Ok(());
    }
    validation(memory, ns, fields).map_err(|failure| match failure.code {
        codes::INVALID_OPTIONS => failure,
        _ => {
            let message = format!("Parsing of collection validator failed :: caused by :: {}", failure.message);
            Failure { message, ..failure }
        }
    })?;
    let changed = memory.validation(ns)?.unwrap_or_default().changed(fields.document)?;
    Ok(memory.set_validation(ns, &changed)?)
}

/// What is asked of an index that is there.
struct Asked {
    index: Index,
    /// What is asked that the index is not already.
    change: IndexChange,
    /// How long after its date a document is to be removed, where that is asked.
    expire_after: Option<i64>,
    is_to_be_unique: bool,
}

impl Asked {
    fn read(memory: &Memory, call: &Call, ns: &Namespace, asked: &Document) -> Result<Self, Failure> {
        let fields = Fields::new("collMod.index", asked);
        let invalid = |message: &str| Failure::new(codes::INVALID_OPTIONS, message);
        let (unique, force) = (fields.optional_flag("unique")?, fields.optional_flag("forceNonUnique")?);
        if unique == Some(true) && force == Some(true) {
            let message = "collMod does not support 'unique' and 'forceNonUnique' options at the same time";
            return Err(invalid(message));
        }
        let (name, keys) = (fields.text("name")?, fields.document("keyPattern")?);
        match (name, keys) {
            (None, None) => return Err(invalid("Must specify either index name or key pattern.")),
            (Some(_), Some(_)) => return Err(invalid("Cannot specify both key pattern and name.")),
            _ => {}
        }
        let all = OF_INDEX.iter().filter(|(option, _)| !matches!(*option, "name" | "keyPattern"));
        if !all.clone().any(|(option, _)| is_said(fields, option)) {
            return Err(invalid("no expireAfterSeconds, hidden, unique, or prepareUnique field"));
        }
        let is_meant = |index: &Index| name == Some(&index.name) || keys.is_some_and(|keys| index.has_keys(keys));
        let Some(index) = super::index::shown(memory, call, ns)?.into_iter().find(is_meant) else {
            let meant = name.map_or_else(|| keys.cloned().unwrap_or_default().to_string(), str::to_owned);
            return Err(Failure::new(codes::NO_INDEX, format!("cannot find index {meant} for ns {ns}")));
        };
        let expire_after = expiry(&index, asked.get("expireAfterSeconds"))?;
        let hidden = fields.optional_flag("hidden")?;
        if hidden.is_some() && index.name == index::ID {
            return Err(Failure::new(codes::BAD_VALUE, "can't hide _id index"));
        }
        check_unique(&index, (unique, force, fields.optional_flag("prepareUnique")?))?;
        let change = IndexChange {
            hidden: hidden.filter(|hidden| *hidden != index.is_hidden()),
            expire_after: expire_after.filter(|seconds| index.expire_after != Some(*seconds)),
        };
        Ok(Self { index, change, expire_after, is_to_be_unique: unique == Some(true) })
    }

    fn modify(self, memory: &Memory, ns: &Namespace) -> Answer {
        if self.change != IndexChange::default() {
            memory.modify_index(ns, &self.index.name, self.change)?;
        }
        let mut reply = Document::new();
        if let Some(seconds) = self.expire_after {
            if let Some(before) = self.index.expire_after {
                reply.insert("expireAfterSeconds_old", before);
            }
            reply.insert("expireAfterSeconds_new", seconds);
        }
        if let Some(hidden) = self.change.hidden {
            reply.extend(doc! { "hidden_old": !hidden, "hidden_new": hidden });
        }
        raw(&reply)
    }
}

/// How many seconds after its date a document is to be removed, as far as the index can do that.
fn expiry(index: &Index, asked: Option<&Bson>) -> Result<Option<i64>, Failure> {
    let Some(seconds) = asked.and_then(whole) else { return Ok(None) };
    let wrong = match seconds {
        _ if index.has_keys(&doc! { "_id": 1 }) => "the _id field does not support TTL indexes",
        _ if index.keys.len() > 1 => "TTL indexes are single-field indexes, compound indexes do not support TTL",
        ..0 => "TTL index 'expireAfterSeconds' option cannot be less than 0",
        _ => return Ok(Some(seconds.min(i32::MAX.into()))),
    };
    Err(Failure::new(codes::INVALID_OPTIONS, wrong))
}

/// Refuses to make an index unique, or no longer unique.
fn check_unique(index: &Index, asked: (Option<bool>, Option<bool>, Option<bool>)) -> Result<(), Failure> {
    let (unique, force, prepare) = asked;
    let is_unique = index.unique || index.name == index::ID;
    let wrong = |message: &str| Err(Failure::new(codes::BAD_VALUE, message));
    match unique {
        Some(false) => return wrong("Cannot make index non-unique"),
        Some(true) if !is_unique => {
            let message = "Cannot make index unique with 'prepareUnique=false'. Run collMod to set it first.";
            return Err(Failure::new(codes::INVALID_OPTIONS, message));
        }
        _ => {}
    }
    match (force, prepare) {
        (Some(false), _) => wrong("'forceNonUnique: false' is not supported"),
        (Some(true), _) if is_unique => Err(Failure::unsupported("the option `forceNonUnique` of a unique index")),
        (_, Some(true)) => Err(Failure::unsupported("the option `prepareUnique` of collMod.index")),
        _ => Ok(()),
    }
}
