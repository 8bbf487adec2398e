//! Stages that describe their collection, `$collStats` and `$indexStats`: they begin a pipeline, and the store answers them.

use bson::{Bson, Document};

use crate::query::decimal::Rounding;
use crate::query::error::{QueryError, Result};
use crate::query::number::Number;
use crate::query::view::View;

/// MongoDB's code for a stage that has to be the first.
const NOT_FIRST: i32 = 40_602;
/// MongoDB's codes for arguments that are none.
const NO_OBJECT: i32 = 5_447_000;
const NOT_EMPTY: i32 = 28_803;
const UNKNOWN_FIELD: i32 = 40_415;
const BAD_SCALE: i32 = 51_024;

/// What a pipeline that begins with such a stage asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Description {
    /// The indexes of the collection (`$indexStats`).
    Indexes,
    /// How large the collection is (`$collStats`).
    Collection {
        /// The unit of sizes in bytes, where sizes are wanted.
        scale: Option<i64>,
        /// Whether the number of documents is wanted.
        count: bool,
    },
}

/// Returns whether a stage of this name describes the collection.
pub(super) fn is_description(name: &str) -> bool {
    name == "$collStats" || name == "$indexStats"
}

/// Returns the refusal of such a stage that is not at the front of a pipeline over its collection.
pub(super) fn misplaced(name: &str, index: usize) -> QueryError {
    if index > 0 {
        return QueryError::invalid(NOT_FIRST, format!("{name} is only valid as the first stage in a pipeline"))
            .about(name);
    }
    let mut refusal = QueryError::unsupported(name);
    refusal.message =
        format!("the embedded store answers {name} at the front of a pipeline, and not within another stage");
    refusal
}

impl Description {
    /// Reads a stage, where it is one of these.
    ///
    /// # Errors
    /// If MongoDB refuses its argument, or it asks for times, which the embedded store does not take.
    pub fn parse(stage: &Document) -> Result<Option<Self>> {
        if stage.len() != 1 {
            // That is a mistake of the pipeline, which says so.
            return Ok(None);
        }
        match stage.iter().next() {
            Some((name, argument)) if name == "$collStats" => collection(argument).map(Some),
            Some((name, argument)) if name == "$indexStats" => match argument {
                Bson::Document(argument) if argument.is_empty() => Ok(Some(Self::Indexes)),
                _ => Err(QueryError::invalid(NOT_EMPTY, "the argument of $indexStats must be an empty object")),
            },
            _ => Ok(None),
        }
    }
}

fn collection(argument: &Bson) -> Result<Description> {
    const KNOWN: [&str; 4] = ["latencyStats", "storageStats", "count", "queryExecStats"];
    let Bson::Document(wanted) = argument else {
        return Err(QueryError::invalid(NO_OBJECT, "$collStats takes an object, like {storageStats: {}}"));
    };
    if let Some(name) = wanted.keys().find(|name| !KNOWN.contains(&name.as_str())) {
        let message = format!("$collStats takes {}, not {name}", KNOWN.join(", "));
        return Err(QueryError::invalid(UNKNOWN_FIELD, message));
    }
    let latency = part(wanted, "latencyStats", &["histograms"])?;
    if let Some(histograms) = latency.and_then(|latency| latency.get("histograms"))
        && !matches!(histograms, Bson::Boolean(_))
    {
        return Err(QueryError::type_mismatch("histograms, of $collStats, is true or false"));
    }
    let scale = part(wanted, "storageStats", &["scale"])?.map(scale_of).transpose()?;
    let count = part(wanted, "count", &[])?.is_some();
    let queries = part(wanted, "queryExecStats", &[])?;
    for (name, asked) in [("latencyStats", latency), ("queryExecStats", queries)] {
        if asked.is_some() {
            let mut refusal = QueryError::unsupported(name);
            refusal.message =
                format!("{name} of $collStats is not measured by the embedded store; take storageStats or count");
            return Err(refusal);
        }
    }
    Ok(Description::Collection { scale, count })
}

/// Returns what is asked of one part; null asks for nothing.
fn part<'a>(wanted: &'a Document, name: &str, known: &[&str]) -> Result<Option<&'a Document>> {
    match wanted.get(name) {
        None | Some(Bson::Null) => Ok(None),
        Some(Bson::Document(asked)) => match asked.keys().find(|key| !known.contains(&key.as_str())) {
            Some(key) if name != "latencyStats" => {
                Err(QueryError::invalid(UNKNOWN_FIELD, format!("{name}, of $collStats, takes no {key}")))
            }
            _ => Ok(Some(asked)),
        },
        Some(_) => Err(QueryError::type_mismatch(format!("{name}, of $collStats, takes an object, like {{}}"))),
    }
}

fn scale_of(asked: &Document) -> Result<i64> {
    let number = match asked.get("scale") {
        None | Some(Bson::Null) => return Ok(1),
        Some(value) => Number::of(value).ok_or_else(|| {
            let found = View::from(value).type_name();
            QueryError::type_mismatch(format!("the scale of storageStats is a number, not {found}"))
        })?,
    };
    let whole = match number {
        Number::Decimal(decimal) => {
            let rounded = decimal.round_to(0, Rounding::HalfEven).to_i128();
            rounded.map_or(number.to_long(), |whole| i64::try_from(whole).unwrap_or(i64::MAX))
        }
        other => other.to_long(),
    };
    match whole.min(i64::from(i32::MAX)) {
        scale @ 1.. => Ok(scale),
        _ => Err(QueryError::invalid(BAD_SCALE, "the scale of storageStats must be 1 or more")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::doc;

    fn code(stage: Document) -> i32 {
        Description::parse(&stage).unwrap_err().code
    }

    #[test]
    fn what_is_asked_for_is_read() {
        let read = |wanted: Document| Description::parse(&doc! { "$collStats": wanted }).unwrap().unwrap();
        let asked = |scale, count| Description::Collection { scale, count };
        assert_eq!(read(doc! {}), asked(None, false));
        assert_eq!(read(doc! { "count": {}, "storageStats": { "scale": 2.9 } }), asked(Some(2), true));
        let half = "1.5".parse::<bson::Decimal128>().unwrap();
        assert_eq!(read(doc! { "count": Bson::Null, "storageStats": { "scale": half } }), asked(Some(2), false));
        assert_eq!(Description::parse(&doc! { "$indexStats": {} }).unwrap(), Some(Description::Indexes));
        assert_eq!(Description::parse(&doc! { "$match": {} }).unwrap(), None);
        assert_eq!(Description::parse(&doc! { "$indexStats": {}, "$match": {} }).unwrap(), None);
    }

    #[test]
    fn what_mongod_refuses_is_refused() {
        for (wanted, expected) in [
            (Bson::Int32(1), NO_OBJECT),
            (doc! { "size": {} }.into(), UNKNOWN_FIELD),
            (doc! { "storageStats": { "scale": 0 } }.into(), BAD_SCALE),
            (doc! { "storageStats": { "scale": "2" } }.into(), 14),
            (doc! { "count": 1 }.into(), 14),
            (doc! { "latencyStats": { "histograms": 1 } }.into(), 14),
            (doc! { "latencyStats": {} }.into(), 115),
        ] {
            assert_eq!(code(doc! { "$collStats": &wanted }), expected, "{wanted}");
        }
        assert_eq!(code(doc! { "$indexStats": { "a": 1 } }), NOT_EMPTY);
    }
}
