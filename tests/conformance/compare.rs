//! Whether two answers are the same: documents with order and types, counts, and whether it is an error.

use bson::{Bson, Document};

use crate::command::Failure;

/// Compares the recorded reply with ours.
pub(crate) fn replies(command: &Document, recorded: &Document, ours: &Result<Document, Failure>) -> Result<(), String> {
    let name = command.keys().next().map_or("", String::as_str);
    let ok = number(recorded.get("ok")) == Some(1.0);
    let ours = match (ok, ours) {
        (false, Err(_)) => return Ok(()),
        (false, Ok(ours)) if matches!(name, "drop" | "dropDatabase" | "listCollections" | "getMore") => {
            let _ = ours;
            return Ok(());
        }
        (false, Ok(ours)) => {
            return Err(format!("mongod: error {}: {}; ours: {ours}", code(recorded), text(recorded, "errmsg")));
        }
        (true, Err(Failure::Failed(message))) => {
            return Err(format!("mongod: {}; ours: error {message}", shown(recorded)));
        }
        (true, Err(Failure::Refused(_))) => return Ok(()),
        (true, Ok(ours)) => ours,
    };
    let relaxed = relaxation(command);
    for field in fields(name) {
        let (theirs, mine) = (find(recorded, field), find(ours, field));
        let same = match (theirs, mine) {
            (None, None) => true,
            (Some(theirs), Some(mine)) => equal(theirs, mine, &relaxed),
            (Some(_), None) | (None, Some(_)) => false,
        };
        if !same {
            let show = |value: Option<&Bson>| {
                value.map_or("nothing".to_owned(), |value| value.to_string().chars().take(700).collect())
            };
            return Err(format!("{field}: mongod {}\n    ours {}", show(theirs), show(mine)));
        }
    }
    let errors = |reply: &Document| reply.get_array("writeErrors").map_or(0, Vec::len);
    if errors(recorded) != errors(ours) {
        return Err(format!(
            "mongod: {} write errors {:?}; ours: {:?}",
            errors(recorded),
            recorded.get("writeErrors"),
            ours.get("writeErrors")
        ));
    }
    Ok(())
}

fn code(reply: &Document) -> String {
    reply.get("code").map_or_else(String::new, Bson::to_string)
}

fn text(reply: &Document, name: &str) -> String {
    reply.get(name).map_or_else(String::new, Bson::to_string)
}

fn shown(reply: &Document) -> String {
    reply.to_string().chars().take(500).collect()
}

fn number(value: Option<&Bson>) -> Option<f64> {
    match value? {
        Bson::Double(value) => Some(*value),
        Bson::Int32(value) => Some(f64::from(*value)),
        _ => None,
    }
}

/// What is compared of a command's reply.
fn fields(name: &str) -> &'static [&'static str] {
    match name {
        "insert" | "delete" | "count" => &["n"],
        "find" | "aggregate" => &["cursor.firstBatch"],
        "getMore" => &["cursor.nextBatch"],
        "update" => &["n", "nModified"],
        "distinct" => &["values"],
        "findAndModify" => &["value"],
        _ => &[],
    }
}

fn find<'a>(reply: &'a Document, path: &str) -> Option<&'a Bson> {
    match path.split_once('.') {
        None => reply.get(path),
        Some((name, rest)) => reply.get(name).and_then(Bson::as_document).and_then(|inner| find(inner, rest)),
    }
}

/// Where mongod's order, or its values, are not defined.
struct Relaxed {
    /// Documents come in any order.
    documents: bool,
    /// Elements of arrays come in any order.
    arrays: bool,
    /// Values are random.
    values: bool,
}

fn relaxation(command: &Document) -> Relaxed {
    let pipeline = command.get("pipeline").map_or_else(String::new, Bson::to_string);
    let uses = |name: &str| pipeline.contains(name);
    let last = |name: &str| pipeline.rfind(name);
    let sorted_last = last("\"$sort\"") > last("\"$group\"").max(last("\"$sortByCount\""));
    Relaxed {
        documents: (uses("\"$group\"") || uses("\"$sortByCount\"")) && !sorted_last || uses("\"$sample\""),
        arrays: uses("\"$addToSet\"") || uses("\"$graphLookup\"") || uses("\"$facet\""),
        values: uses("\"$rand\"") || uses("\"$sample\""),
    }
}

fn equal(theirs: &Bson, ours: &Bson, relaxed: &Relaxed) -> bool {
    if relaxed.values {
        return match (theirs, ours) {
            (Bson::Array(a), Bson::Array(b)) => a.len() == b.len(),
            _ => true,
        };
    }
    match (theirs, ours) {
        (Bson::Array(a), Bson::Array(b)) if relaxed.documents || relaxed.arrays => in_any_order(a, b, relaxed),
        (a, b) => same(a, b, relaxed.arrays),
    }
}

fn in_any_order(a: &[Bson], b: &[Bson], relaxed: &Relaxed) -> bool {
    let mut left: Vec<&Bson> = b.iter().collect();
    a.len() == b.len()
        && a.iter().all(|item| {
            let place = left.iter().position(|other| same(item, other, relaxed.arrays));
            place.map(|place| left.swap_remove(place)).is_some()
        })
}

/// The same value of the same type. What is the time now, or an `_id` made now, for both is the same.
fn same(a: &Bson, b: &Bson, any_order: bool) -> bool {
    match (a, b) {
        // Each server has resume tokens of its own.
        (Bson::Document(a), Bson::Document(b)) if a.contains_key("_data") && b.contains_key("_data") => true,
        (Bson::Document(a), Bson::Document(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|((n1, v1), (n2, v2))| n1 == n2 && same(v1, v2, any_order))
        }
        (Bson::Array(a), Bson::Array(b)) if any_order => {
            in_any_order(a, b, &Relaxed { documents: true, arrays: true, values: false })
        }
        (Bson::Array(a), Bson::Array(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b, any_order)),
        (Bson::Double(a), Bson::Double(b)) => {
            a.to_bits() == b.to_bits()
                || a.is_nan() && b.is_nan()
                || a == b && *a == 0.0 && a.is_sign_negative() == b.is_sign_negative()
        }
        (Bson::DateTime(a), Bson::DateTime(b)) => {
            a == b || is_now(b.timestamp_millis()) && is_recent(a.timestamp_millis())
        }
        (Bson::Timestamp(a), Bson::Timestamp(b)) => {
            a == b || is_now(i64::from(b.time) * 1000) && is_recent(i64::from(a.time) * 1000)
        }
        (Bson::ObjectId(a), Bson::ObjectId(b)) => {
            let millis = |id: &bson::oid::ObjectId| id.timestamp().timestamp_millis();
            a == b || is_now(millis(b)) && is_recent(millis(a))
        }
        (Bson::Decimal128(a), Bson::Decimal128(b)) => {
            a.bytes() == b.bytes() || a.to_string() == "NaN" && b.to_string() == "NaN"
        }
        (a, b) => a == b,
    }
}

fn is_now(millis: i64) -> bool {
    (bson::DateTime::now().timestamp_millis() - millis).abs() < 3_600_000
}

/// Whether a moment can be that of the recording.
fn is_recent(millis: i64) -> bool {
    (1_700_000_000_000..2_000_000_000_000).contains(&millis)
}
