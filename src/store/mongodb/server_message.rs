//! Reads what the message of a server is about. A server says it in words only: this is the one place that takes names
//! from a message.

use crate::query::{NameContext, QueryError, QueryMistake};

/// What the messages about unknown names begin with, in small letters, and where such a name stands.
const UNKNOWN_NAMES: [(&str, NameContext); 4] = [
    ("unknown operator: ", NameContext::Condition),
    ("unknown top level operator: ", NameContext::Filter),
    ("unknown modifier: ", NameContext::Update),
    ("unrecognized pipeline stage name: ", NameContext::Stage),
];

/// Returns the error for what a server refuses, with the operators that its message names, in their order.
pub(super) fn refusal(code: i32, message: &str) -> QueryError {
    let error = operators(message).fold(QueryError::invalid(code, message), QueryError::about);
    match mistake(message) {
        Some(mistake) => error.of_kind(mistake),
        None => error,
    }
}

/// The operators, stages and variables that a message names.
fn operators(message: &str) -> impl Iterator<Item = &str> {
    let words = message.split(|c: char| c != '$' && !c.is_alphanumeric());
    words.filter(|word| word.starts_with('$') && word.len() > 1)
}

/// What kind of mistake a message is about, where there is advice for it.
fn mistake(message: &str) -> Option<QueryMistake> {
    let words = message.to_lowercase();
    if let Some((_, context)) = UNKNOWN_NAMES.iter().find(|(beginning, _)| words.starts_with(beginning)) {
        return Some(QueryMistake::UnknownName(*context));
    }
    let is_list = |operator: &str| words.strip_prefix(operator).is_some_and(|rest| rest == " must be an array");
    if ["$and", "$or", "$nor"].into_iter().any(is_list) {
        return Some(QueryMistake::NoArray);
    }
    if words == "a group specification must include an _id" {
        return Some(QueryMistake::NoGroupId);
    }
    words.contains("hint").then_some(QueryMistake::Hint)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_names_its_operators_and_its_kind() {
        let unknown = |context| Some(QueryMistake::UnknownName(context));
        let table: [(&str, &[&str], Option<QueryMistake>); 8] = [
            ("unknown operator: $exits", &["$exits"], unknown(NameContext::Condition)),
            (
                "unknown top level operator: $gt. If you have a field name that starts with a '$' symbol, consider using \
                 $getField or $setField.",
                &["$gt", "$getField", "$setField"],
                unknown(NameContext::Filter),
            ),
            (
                "Unknown modifier: $sett. Expected a valid update modifier or pipeline-style update specified as an array",
                &["$sett"],
                unknown(NameContext::Update),
            ),
            ("Unrecognized pipeline stage name: '$mach'", &["$mach"], unknown(NameContext::Stage)),
            ("$or must be an array", &["$or"], Some(QueryMistake::NoArray)),
            ("a group specification must include an _id", &[], Some(QueryMistake::NoGroupId)),
            ("hint provided does not correspond to an existing index", &[], Some(QueryMistake::Hint)),
            ("Invalid $project :: caused by :: Unknown expression $nope", &["$project", "$nope"], None),
        ];
        for (message, names, mistake) in table {
            let error = refusal(2, message);
            assert_eq!(
                (error.names.as_slice(), error.mistake),
                (&*names.iter().map(ToString::to_string).collect::<Vec<_>>(), mistake),
                "{message}"
            );
            assert_eq!((error.code, error.message.as_str()), (2, message));
        }
    }
}
