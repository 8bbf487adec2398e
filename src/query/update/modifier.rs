//! Update operators and their paths.

use std::cmp::Ordering;
use std::collections::HashMap;
use std::fmt;

use bson::Bson;

use super::array::{Pull, Push};
use crate::query::error::{QueryError, Result};
use crate::query::number::Number;
use crate::query::path::array_index;

/// An operator at a path.
#[derive(Debug)]
pub(super) struct Modifier {
    pub(super) path: Vec<Segment>,
    pub(super) text: String,
    pub(super) action: Action,
}

impl Modifier {
    /// Returns a modifier of the same path, whose action is to be replaced.
    pub(super) fn moved(&self) -> Self {
        Self { path: self.path.clone(), text: self.text.clone(), action: Action::Unset }
    }
}

/// One part of a path of an update.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) enum Segment {
    /// A field, or the element of that index.
    Name(String),
    /// `$`: the element by which the filter matched.
    Matched,
    /// `$[]`: all elements.
    All,
    /// `$[identifier]`: elements that pass an array filter.
    Filtered(String),
}

impl fmt::Display for Segment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Name(name) => f.write_str(name),
            Self::Matched => f.write_str("$"),
            Self::All => f.write_str("$[]"),
            Self::Filtered(name) => write!(f, "$[{name}]"),
        }
    }
}

/// The action of an update operator.
#[derive(Debug)]
pub(super) enum Action {
    Set(Bson),
    SetOnInsert(Bson),
    Unset,
    Increment(Number),
    Multiply(Number),
    Least(Bson),
    Greatest(Bson),
    /// Moves the value from that path to the modifier's.
    Rename(Vec<Segment>),
    /// Now, as a date or a timestamp.
    CurrentDate {
        timestamp: bool,
    },
    /// Operations with their masks, in order.
    Bits(Vec<(Bitwise, Number)>),
    Push(Push),
    AddToSet(Vec<Bson>),
    Pop {
        first: bool,
    },
    Pull(Pull),
    PullAll(Vec<Bson>),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Bitwise {
    And,
    Or,
    Xor,
}

impl Action {
    /// Returns the operator's name.
    pub(super) fn operator(&self) -> &'static str {
        match self {
            Self::Set(_) => "$set",
            Self::SetOnInsert(_) => "$setOnInsert",
            Self::Unset => "$unset",
            Self::Increment(_) => "$inc",
            Self::Multiply(_) => "$mul",
            Self::Least(_) => "$min",
            Self::Greatest(_) => "$max",
            Self::Rename(_) => "$rename",
            Self::CurrentDate { .. } => "$currentDate",
            Self::Bits(_) => "$bit",
            Self::Push(_) => "$push",
            Self::AddToSet(_) => "$addToSet",
            Self::Pop { .. } => "$pop",
            Self::Pull(_) => "$pull",
            Self::PullAll(_) => "$pullAll",
        }
    }

    /// Returns whether a path through a scalar is ignored rather than an error.
    pub(super) fn ignores_dead_ends(&self) -> bool {
        matches!(self, Self::Unset)
    }

    /// Returns whether missing documents on the path are created.
    pub(super) fn creates(&self) -> bool {
        !matches!(self, Self::Unset | Self::Pop { .. } | Self::Pull(_) | Self::PullAll(_))
    }
}

/// Reads the path of an update.
pub(super) fn path(text: &str) -> Result<Vec<Segment>> {
    if text.is_empty() {
        return Err(QueryError::invalid(56, "an empty update path is not valid"));
    }
    let mut segments = Vec::new();
    for part in text.split('.') {
        segments.push(match part {
            "" => {
                let message = format!("the update path '{text}' contains an empty field name, which is not allowed");
                return Err(QueryError::invalid(56, message));
            }
            "$" => Segment::Matched,
            "$[]" => Segment::All,
            part => match part.strip_prefix("$[").and_then(|rest| rest.strip_suffix(']')) {
                Some(name) => Segment::Filtered(name.to_owned()),
                // Other names with a dollar are looked at where a document gets them.
                None if segments.is_empty() && part.starts_with("$[") => {
                    let message =
                        format!("the dollar ($) prefixed field '{part}' in '{text}' is not valid for storage");
                    return Err(QueryError::invalid(52, message));
                }
                None => Segment::Name(part.to_owned()),
            },
        });
    }
    if segments.len() > 200 {
        return Err(QueryError::invalid(15, "an update path has more than 200 parts"));
    }
    match segments.first() {
        Some(Segment::Name(_)) => {}
        _ => {
            return Err(QueryError::bad_value(format!(
                "cannot have array filter or `$` at the start of path '{text}'"
            )));
        }
    }
    if segments.iter().filter(|segment| **segment == Segment::Matched).count() > 1 {
        return Err(QueryError::bad_value(format!("too many positional (i.e. '$') elements found in path '{text}'")));
    }
    Ok(segments)
}

/// Returns the order in which paths are changed: numbers by value before names by bytes.
pub(super) fn order(a: &[Segment], b: &[Segment]) -> Ordering {
    for (first, second) in a.iter().zip(b) {
        let (first, second) = (spelled(first), spelled(second));
        let order = match (array_index(first), array_index(second)) {
            (Some(first), Some(second)) => first.cmp(&second),
            (Some(_), None) => Ordering::Less,
            (None, Some(_)) => Ordering::Greater,
            (None, None) => first.as_bytes().cmp(second.as_bytes()),
        };
        if order != Ordering::Equal {
            return order;
        }
    }
    a.len().cmp(&b.len())
}

fn spelled(segment: &Segment) -> &str {
    match segment {
        Segment::Name(name) => name,
        Segment::Matched => "$",
        Segment::All => "$[]",
        Segment::Filtered(name) => name,
    }
}

/// Refuses two paths of which one leads through the other, or which take the same value for an array and for something
/// with fields.
pub(super) fn check_conflicts(paths: &[(&[Segment], &str)]) -> Result<()> {
    let mut sorted: Vec<_> = paths.to_vec();
    sorted.sort_by(|a, b| order(a.0, b.0));
    for pair in sorted.windows(2) {
        if let [(first, text), (second, other)] = pair
            && second.starts_with(first)
        {
            let message = format!("updating the path '{other}' would create a conflict at '{text}'");
            return Err(QueryError::invalid(40, message));
        }
    }
    check_kinds(paths)
}

/// Refuses paths of which one has `$[]` or `$[identifier]` where another one that leads through the same value has a
/// field, an index or `$`.
fn check_kinds(paths: &[(&[Segment], &str)]) -> Result<()> {
    let is_of_array = |segment: &Segment| matches!(segment, Segment::All | Segment::Filtered(_));
    if !paths.iter().any(|(path, _)| path.iter().any(is_of_array)) {
        return Ok(());
    }
    let mut kinds: HashMap<&[Segment], bool> = HashMap::new();
    for (path, text) in paths {
        for (depth, segment) in path.iter().enumerate() {
            let (parent, is_array) = (path.get(..depth).unwrap_or_default(), is_of_array(segment));
            if kinds.insert(parent, is_array).is_some_and(|before| before != is_array) {
                let parent = parent.iter().map(Segment::to_string).collect::<Vec<_>>().join(".");
                let message = format!("updating the path '{text}' would create a conflict at '{parent}'");
                return Err(QueryError::invalid(40, message));
            }
        }
    }
    Ok(())
}
