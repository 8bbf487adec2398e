//! Wildcard indexes: `{"$**": 1}` and `{"a.$**": 1}`, perhaps with a projection.
//!
//! They are kept in the catalogue; what they could serve is answered by a scan.

use bson::{Bson, Document};

use crate::query::error::{QueryError, Result};
use crate::query::filter::{Leaf, Node, Test};
use crate::query::number::Number;

/// The end of a wildcard's key.
const ALL: &str = "$**";
/// MongoDB's code for an index that cannot be.
const CANNOT_CREATE: i32 = 67;
/// The option that says which paths are in the index.
pub(super) const PROJECTION: &str = "wildcardProjection";

/// The paths of a wildcard index.
#[derive(Debug)]
pub(super) struct Wildcard {
    /// The path that all of them are at or below; empty for the whole document.
    prefix: String,
    /// The paths of the projection, and whether they are left out.
    projection: Option<(Vec<String>, bool)>,
}

/// Returns whether a key is one of a wildcard index.
pub(super) fn is_key(name: &str) -> bool {
    name == ALL || name.ends_with(".$**")
}

impl Wildcard {
    /// Reads the only key of a pattern with the options of the index.
    ///
    /// # Errors
    /// If MongoDB refuses them.
    pub(super) fn parse(pattern: &Document, options: &Document) -> Result<Self> {
        let cannot = |message: &str| Err(QueryError::invalid(CANNOT_CREATE, message).about(ALL));
        let (Some((name, direction)), 1) = (pattern.iter().next(), pattern.len()) else {
            return cannot("a wildcard index has one key");
        };
        match Number::of(direction).map(Number::to_double) {
            Some(number) if number != 0.0 && !number.is_nan() => {}
            _ => return cannot("the key of a wildcard index takes 1 or -1"),
        }
        let prefix = name.strip_suffix(ALL).unwrap_or_default().trim_end_matches('.').to_owned();
        if prefix.split('.').any(|part| part.starts_with('$')) || name.contains("..") || name.starts_with('.') {
            return cannot("only the last part of a key is a wildcard");
        }
        let projection = match options.get(PROJECTION) {
            None => None,
            Some(_) if !prefix.is_empty() => {
                return Err(
                    QueryError::failed_to_parse("wildcardProjection is for the key `$**` only").about(PROJECTION)
                );
            }
            Some(Bson::Document(projection)) if projection.is_empty() => {
                return Err(QueryError::failed_to_parse("wildcardProjection cannot be empty"));
            }
            Some(Bson::Document(projection)) => Some(projected(projection)?),
            Some(_) => return Err(QueryError::type_mismatch("wildcardProjection must be an object")),
        };
        Ok(Self { prefix, projection })
    }

    /// Returns whether a filter asks for a path of the index, so that the index could serve it.
    pub(super) fn serves(&self, node: &Node) -> bool {
        match node {
            Node::And(children) => children.iter().any(|child| self.serves(child)),
            Node::Or(children) => children.iter().all(|child| self.serves(child)),
            Node::Field(path, test) => self.has(path.text()) && is_bounded(test),
            _ => false,
        }
    }

    fn has(&self, path: &str) -> bool {
        let Some((paths, is_exclusion)) = &self.projection else {
            return path != "_id" && is_within(path, &self.prefix);
        };
        match path {
            "_id" => !is_exclusion && paths.iter().any(|known| known == "_id"),
            path => paths.iter().any(|known| is_within(path, known)) != *is_exclusion,
        }
    }
}

/// Returns whether a test says which values there may be.
fn is_bounded(test: &Test) -> bool {
    match test {
        Test::And(tests) => tests.iter().any(is_bounded),
        Test::Not(_) => false,
        Test::Leaf(leaf) => match leaf {
            Leaf::Equal(value) => !matches!(value, Bson::Null | Bson::Array(_)),
            leaf => !matches!(leaf, Leaf::Never),
        },
    }
}

fn is_within(path: &str, outer: &str) -> bool {
    outer.is_empty() || path.strip_prefix(outer).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
}

/// Returns the paths of a projection, and whether it leaves them out.
fn projected(projection: &Document) -> Result<(Vec<String>, bool)> {
    let (mut taken, mut left_out) = (Vec::new(), Vec::new());
    flatten("", projection, &mut taken, &mut left_out)?;
    let is_id = |path: &String| path == "_id";
    match (taken.iter().all(is_id), left_out.iter().all(is_id)) {
        (false, false) => {
            Err(QueryError::invalid(31_254, "wildcardProjection either takes paths or leaves some out")
                .about(PROJECTION))
        }
        (true, false) => Ok((left_out, true)),
        (false, true) => Ok((taken, false)),
        (true, true) if taken.is_empty() => Ok((left_out, true)),
        (true, true) => Ok((taken, false)),
    }
}

fn flatten(outer: &str, projection: &Document, taken: &mut Vec<String>, left_out: &mut Vec<String>) -> Result<()> {
    for (name, value) in projection {
        let path = if outer.is_empty() { name.clone() } else { format!("{outer}.{name}") };
        let is_taken = match value {
            Bson::Document(inner) if !inner.is_empty() => {
                flatten(&path, inner, taken, left_out)?;
                continue;
            }
            Bson::Boolean(value) => *value,
            value => match Number::of(value) {
                Some(number) => !number.is_zero(),
                None => {
                    let message = "wildcardProjection takes each path with true or false, 1 or 0";
                    return Err(QueryError::invalid(51_271, message).about(PROJECTION));
                }
            },
        };
        if is_taken { taken.push(path) } else { left_out.push(path) }
    }
    Ok(())
}
