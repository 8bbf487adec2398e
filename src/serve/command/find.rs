//! `find`, `count`, `distinct`

use bson::{Bson, doc};

use super::definition::{Command, raw};
use super::options::{self, Options, Type};
use crate::serve::call::Call;
use crate::serve::failure::{Answer, Failure, codes};
use crate::serve::fields::{Fields, integral, whole};
use crate::serve::host::{FirstBatch, Host};
use crate::store::{Find, KeyOptions, MAX_SIZE, Query};

/// MongoDB's code for values of `distinct` that are too large for an answer.
const TOO_MANY_VALUES: i32 = 17_217;

pub(super) const COMMANDS: &[Command] = &[
    Command::read("find", find).transactional(),
    Command::read("count", count),
    Command::read("distinct", distinct).transactional(),
];

/// The options of `find`; some make no difference here.
const OF_FIND: Options = &[
    ("allowDiskUse", Type::Strict),
    ("allowPartialResults", Type::Strict),
    ("awaitData", Type::Strict),
    ("batchSize", Type::Number),
    ("collation", Type::Given(&Type::Object)),
    ("encryptionInformation", Type::Of(&["schema"], &[("schema", Type::Object), ("type", Type::Number)])),
    ("filter", Type::Given(&Type::Object)),
    ("hint", Type::Any),
    ("let", Type::Object),
    ("limit", Type::Number),
    ("max", Type::Given(&Type::Object)),
    ("min", Type::Given(&Type::Object)),
    ("noCursorTimeout", Type::Strict),
    ("ntoreturn", Type::Within(0, i64::MAX)),
    ("oplogReplay", Type::Given(&Type::Bool)),
    ("projection", Type::Given(&Type::Object)),
    ("returnKey", Type::Strict),
    ("runtimeConstants", Type::Any),
    ("showRecordId", Type::Strict),
    ("singleBatch", Type::Strict),
    ("skip", Type::Number),
    ("sort", Type::Given(&Type::Object)),
    ("tailable", Type::Strict),
];

/// What this rmem has no word for.
const REFUSED: [&str; 4] = ["tailable", "awaitData", "ntoreturn", "encryptionInformation"];

fn find(host: &mut Host<'_>, call: &Call) -> Answer {
    let (ns, fields) = (call.request.readable()?, call.request.fields());
    let find = read(fields)?;
    let memory = host.memory()?;
    let limit = find.limit;
    let batch = FirstBatch {
        size: fields.size("batchSize")?,
        is_only: fields.flag("singleBatch")?,
        never_expires: fields.flag("noCursorTimeout")?,
    };
    // One batch, of as many as there may be.
    let size = if batch.is_only && limit > 0 { Some(limit.min(batch.size.unwrap_or(limit))) } else { batch.size };
    let documents = call.access(memory).find(&ns, &find)?;
    call.request.check_ending()?;
    host.answer(&ns, call.request.origin(), documents, FirstBatch { size, ..batch })
}

/// The query of a `find`.
pub(super) fn read(fields: Fields<'_>) -> Result<Find, Failure> {
    options::check(fields.of, fields.document, OF_FIND)?;
    fields.refuse(&REFUSED)?;
    Ok(Find {
        filter: fields.document_or_empty("filter")?,
        sort: fields.document_or_empty("sort")?,
        skip: fields.size("skip")?.unwrap_or(0),
        limit: fields.size("limit")?.unwrap_or(0),
        projection: fields.document_or_empty("projection")?,
        modifiers: fields.modifiers()?,
        current: false,
        keys: KeyOptions {
            min: fields.document_or_empty("min")?,
            max: fields.document_or_empty("max")?,
            return_key: fields.flag("returnKey")?,
            show_record_id: fields.flag("showRecordId")?,
        },
    })
}

/// At most so many documents are counted; of a negative number, only the size matters.
fn limit(fields: Fields<'_>) -> Result<u64, Failure> {
    let limit = match fields.document.get("limit") {
        None | Some(Bson::Null) => 0,
        Some(given) => {
            whole(given).ok_or_else(|| Failure::new(codes::BAD_VALUE, format!("the limit is no number: {given}")))?
        }
    };
    if limit == i64::MIN {
        return Err(Failure::new(codes::BAD_VALUE, "the limit is too small"));
    }
    Ok(limit.unsigned_abs())
}

fn count(host: &mut Host<'_>, call: &Call) -> Answer {
    let (ns, fields) = (call.request.readable()?, call.request.fields());
    fields.check(&["query", "limit", "skip", "hint", "fields", "collation"], &["encryptionInformation"])?;
    let memory = host.memory()?;
    let (filter, modifiers) = (fields.document_or_empty("query")?, fields.modifiers()?);
    let all = call.access(memory).count(&ns, Query { filter: &filter, modifiers: &modifiers })?;
    check_limit(fields)?;
    let rest = all.saturating_sub(fields.size("skip")?.unwrap_or(0));
    let n = match limit(fields)? {
        0 => rest,
        limit => rest.min(limit),
    };
    raw(&doc! { "n": i32::try_from(n).map_or_else(|_| Bson::Int64(n.cast_signed()), Bson::Int32) })
}

/// Refuses a limit of `count` that is not whole: there, MongoDB does not round it.
fn check_limit(fields: Fields<'_>) -> Result<(), Failure> {
    match fields.document.get("limit") {
        Some(given) if whole(given).is_some() && integral(given).is_none() => {
            Err(Failure::new(codes::FAILED_TO_PARSE, format!("Expected an integer: limit: {given}")))
        }
        _ => Ok(()),
    }
}

fn distinct(host: &mut Host<'_>, call: &Call) -> Answer {
    let (ns, fields) = (call.request.readable()?, call.request.fields());
    fields.known(&["key", "query", "hint", "collation"])?;
    let key = fields.text("key")?.ok_or_else(|| fields.missing("key"))?;
    let (filter, modifiers) = (fields.document_or_empty("query")?, fields.modifiers()?);
    let query = Query { filter: &filter, modifiers: &modifiers };
    let values = call.access(host.memory()?).distinct(&ns, key, query)?;
    let reply = raw(&doc! { "values": values })?;
    match reply.as_bytes().len() {
        ..=MAX_SIZE => Ok(reply),
        _ => Err(Failure::new(TOO_MANY_VALUES, "distinct too big, 16mb cap")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::Document;

    #[test]
    fn options_of_the_wrong_type_are_refused() {
        let code = |body: Document| read(Fields::new("find", &body)).map_or_else(|failure| failure.code, |_| 0);
        assert_eq!(code(doc! { "find": "c", "limit": -1 }), 51_024);
        assert_eq!(code(doc! { "find": "c", "allowDiskUse": 1 }), codes::TYPE_MISMATCH);
        assert_eq!(code(doc! { "find": "c", "sort": Bson::Null }), codes::TYPE_MISMATCH);
        assert_eq!(code(doc! { "find": "c", "limit": 1, "allowDiskUse": true }), 0);
    }
}
