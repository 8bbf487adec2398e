//! `$regexMatch`, `$regexFind`, `$regexFindAll`.

use bson::Bson;

use super::operator::{Arguments, Named, document, is_null, wrong_type};
use super::value::Value;
use crate::query::error::{QueryError, Result};
use crate::query::limit::check_elements;
use crate::query::regex::{Groups, Pattern};

const FIELDS: &[(&str, bool)] = &[("input", true), ("regex", true), ("options", false)];

pub(super) const NAMED: [Named; 3] = [
    Named { name: "$regexMatch", fields: FIELDS, bare: false, call: is_match },
    Named { name: "$regexFind", fields: FIELDS, bare: false, call: find },
    Named { name: "$regexFindAll", fields: FIELDS, bare: false, call: find_all },
];

/// Text and pattern; `None` if one is null.
fn prepared(arguments: &Arguments) -> Result<Option<(&str, Pattern)>> {
    let operator = arguments.operator;
    let input = match arguments.get(0) {
        value if is_null(value) => None,
        Bson::String(input) => Some(input.as_str()),
        other => return Err(wrong_type(51_104, operator, "a string as input", other)),
    };
    if !matches!(arguments.get(1), Bson::Null | Bson::Undefined | Bson::String(_) | Bson::RegularExpression(_)) {
        return Err(wrong_type(51_105, operator, "a string or regex", arguments.get(1)));
    }
    let options = match arguments.get(2) {
        value if is_null(value) => None,
        Bson::String(options) => Some(options.as_str()),
        other => return Err(wrong_type(51_106, operator, "a string of options", other)),
    };
    let pattern = match arguments.get(1) {
        Bson::String(pattern) => Some(Pattern::new(pattern, options.unwrap_or_default())?),
        Bson::RegularExpression(regex) => {
            let own = regex.options.as_str();
            if options.is_some() && !own.is_empty() {
                return Err(QueryError::invalid(
                    51_107,
                    format!("{operator}: options both in the regex and in 'options'"),
                ));
            }
            Some(Pattern::new(regex.pattern.as_str(), options.unwrap_or(own))?)
        }
        _ => None,
    };
    Ok(input.zip(pattern))
}

fn is_match(arguments: &Arguments) -> Result<Value> {
    let found = match prepared(arguments)? {
        Some((text, pattern)) => pattern.groups(text, 0)?.is_some(),
        None => false,
    };
    Ok(Some(Bson::Boolean(found)))
}

fn shown(text: &str, groups: &Groups, index: usize) -> Bson {
    let part = |group: &Option<(usize, usize)>| match group {
        Some((start, end)) => Bson::from(text.get(*start..*end).unwrap_or_default()),
        None => Bson::Null,
    };
    let whole = groups.first().unwrap_or(&None);
    document([
        ("match", part(whole)),
        ("idx", Bson::Int32(i32::try_from(index).unwrap_or(i32::MAX))),
        ("captures", Bson::Array(groups.iter().skip(1).map(part).collect())),
    ])
}

fn code_points(text: &str, end: usize) -> usize {
    text.get(..end).map_or(0, |before| before.chars().count())
}

fn find(arguments: &Arguments) -> Result<Value> {
    let Some((text, pattern)) = prepared(arguments)? else { return Ok(Some(Bson::Null)) };
    let found = pattern.groups(text, 0)?.map(|groups| {
        let start = groups.first().copied().flatten().map_or(0, |(start, _)| start);
        shown(text, &groups, code_points(text, start))
    });
    Ok(Some(found.unwrap_or(Bson::Null)))
}

/// Bytes of memory of a match with its fields.
const MATCH: usize = 768;
/// From so many matches on there may be many more.
const MANY: usize = 32;

fn find_all(arguments: &Arguments) -> Result<Value> {
    let Some((text, mut pattern)) = prepared(arguments)? else { return Ok(Some(Bson::Array(Vec::new()))) };
    let (mut all, mut from, mut counted, mut points) = (Vec::new(), 0, 0, 0);
    while from < text.len() || all.is_empty() && from == 0 {
        let Some(groups) = pattern.groups(text, from)? else { break };
        let (start, end) = groups.first().copied().flatten().unwrap_or((from, from));
        check_elements(all.len(), MATCH)?;
        points += text.get(counted..start).map_or(0, |between| between.chars().count());
        counted = start;
        all.push(shown(text, &groups, points));
        if all.len() == MANY {
            pattern = pattern.repeated();
        }
        from = if end > start {
            end
        } else {
            end + text.get(end..).and_then(|rest| rest.chars().next()).map_or(1, char::len_utf8)
        };
    }
    Ok(Some(Bson::Array(all)))
}
