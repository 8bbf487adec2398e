//! Dotted paths, and the values they reach: through documents, and through arrays of documents.

use super::dollar::is_reference_key;
use super::error::{QueryError, Result};
use super::view::{Fields, Items, View};

/// The most parts a path may have; what recursion over paths is bounded by.
const MAX_PARTS: usize = 200;

/// A dotted path, taken apart.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Path {
    text: String,
    parts: Vec<Part>,
}

/// One part of a path.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Part {
    /// A name of a field.
    pub(super) name: String,
    /// The index, where the name can also be one.
    pub(super) index: Option<usize>,
}

impl Part {
    pub(super) fn new(name: &str) -> Self {
        Self { name: name.to_owned(), index: array_index(name) }
    }
}

/// Returns the index that a name can be: digits without a leading zero.
pub(super) fn array_index(name: &str) -> Option<usize> {
    let plain = name == "0" || !name.starts_with('0');
    (plain && !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_digit())).then(|| name.parse().ok())?
}

/// Returns the index that a name is in an update: digits, leading zeros or not.
pub(super) fn padded_index(name: &str) -> Option<usize> {
    let significant = name.trim_start_matches('0');
    array_index(if significant.is_empty() && !name.is_empty() { "0" } else { significant })
}

impl Path {
    /// Takes a dotted path apart; empty parts are names too.
    ///
    /// # Errors
    /// If there are too many parts.
    pub(super) fn parse(text: &str) -> Result<Self> {
        let parts: Vec<Part> = text.split('.').map(Part::new).collect();
        if parts.len() > MAX_PARTS {
            return Err(QueryError::invalid(5_729_101, "a path has more than 200 parts"));
        }
        Ok(Self { text: text.to_owned(), parts })
    }

    pub(super) fn text(&self) -> &str {
        &self.text
    }

    pub(super) fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// Calls `test` with every value that the path reaches, until it returns true. Returns whether it did.
    ///
    /// With `leaves`, the elements of an array at the end of the path are shown before
    /// the array itself. A path that ends early shows nothing (`None`), except where the
    /// elements of an array on the way are not documents. The second argument of `test` is
    /// the index in the first array on the way.
    pub(super) fn any<'a>(
        &self,
        fields: Fields<'a>,
        leaves: bool,
        test: &mut impl FnMut(Option<View<'a>>, Option<usize>) -> bool,
    ) -> bool {
        in_fields(fields, &self.parts, leaves, None, test)
    }
}

fn in_fields<'a>(
    mut fields: Fields<'a>,
    mut parts: &[Part],
    leaves: bool,
    outer: Option<usize>,
    test: &mut impl FnMut(Option<View<'a>>, Option<usize>) -> bool,
) -> bool {
    while let Some((part, rest)) = parts.split_first() {
        match fields.get(&part.name) {
            Some(View::Array(items)) if rest.is_empty() || is_end(rest) => return at_leaf(items, leaves, outer, test),
            Some(View::Array(items)) => return in_items(items, rest, leaves, outer, test),
            Some(value) if rest.is_empty() => return test(Some(value), outer),
            Some(View::Document(inner)) => fields = inner,
            _ => return test(None, outer),
        }
        parts = rest;
    }
    false
}

/// Returns whether a path ends in a dot here, which says no more at an array.
fn is_end(parts: &[Part]) -> bool {
    matches!(parts, [part] if part.name.is_empty())
}

fn at_leaf<'a>(
    items: Items<'a>,
    leaves: bool,
    outer: Option<usize>,
    test: &mut impl FnMut(Option<View<'a>>, Option<usize>) -> bool,
) -> bool {
    if leaves {
        for (index, item) in items.iter().enumerate() {
            if test(Some(item), outer.or(Some(index))) {
                return true;
            }
        }
    }
    test(Some(View::Array(items)), outer)
}

/// Through the elements that are documents, and through the one whose index the path names.
fn in_items<'a>(
    items: Items<'a>,
    parts: &[Part],
    leaves: bool,
    outer: Option<usize>,
    test: &mut impl FnMut(Option<View<'a>>, Option<usize>) -> bool,
) -> bool {
    let Some((part, rest)) = parts.split_first() else { return false };
    for (index, item) in items.iter().enumerate() {
        if let View::Document(fields) = item
            && in_fields(fields, parts, leaves, outer.or(Some(index)), test)
        {
            return true;
        }
        // An element that the path names is not found by going through the array: it leaves no index.
        if part.index == Some(index) {
            let found = match item {
                item if rest.is_empty() => test(Some(item), outer),
                View::Document(fields) => in_fields(fields, rest, leaves, outer, test),
                View::Array(inner) => in_items(inner, rest, leaves, outer, test),
                _ => false,
            };
            if found {
                return true;
            }
        }
    }
    false
}

/// Refuses what is not a path of a field: one with empty parts, or parts with a `$`.
pub(super) fn check_plain(path: &str) -> Result<()> {
    let code = match path {
        "" => 40_352,
        path if path.ends_with('.') => 40_353,
        path if path.split('.').any(str::is_empty) => 15_998,
        path if path.split('.').any(|part| part.starts_with('$') && !is_reference_key(part)) => 16_410,
        _ => return Ok(()),
    };
    Err(QueryError::invalid(code, format!("the field path '{path}' has a part that is empty or starts with '$'")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use bson::{Document, doc};

    fn reached(document: &Document, path: &str) -> Vec<String> {
        let mut found = Vec::new();
        Path::parse(path).unwrap().any(document.into(), true, &mut |value, outer| {
            let shown = value.map_or("missing".to_owned(), |value| value.to_bson().to_string());
            found.push(format!("{shown}@{outer:?}").replace("@None", "").replace("Some(", "").replace(')', ""));
            false
        });
        found
    }

    #[test]
    fn reaches_through_arrays() {
        let document = doc! {"a": [{"b": 1}, {"c": 2}, 3, {"b": [4, 5]}], "d": {"e": 6}, "m": [[1, 2]]};
        assert_eq!(reached(&document, "a.b"), ["1@0", "missing@1", "4@3", "5@3", "[4, 5]@3"]);
        assert_eq!(reached(&document, "a.2"), ["missing@0", "missing@1", "3", "missing@3"]);
        assert_eq!(reached(&document, "d.e"), ["6"]);
        assert_eq!(reached(&document, "d.e.f"), ["missing"]);
        assert_eq!(reached(&document, "m.0.1"), ["2"]);
        assert_eq!(reached(&document, "m."), ["[1, 2]@0", "[[1, 2]]"]);
        assert_eq!(reached(&document, "m.x"), Vec::<String>::new());
    }
}
